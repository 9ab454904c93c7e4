"""A branch of hunting cycles as data: orbits in order, special points, and why it ends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import choice_of, require
from ..continuation import FOLD, Missed, SpecialPoint
from ..export import Columns, columns_from
from ..orbits import Archive, write_archive
from ..orbits.archive import save_orbit
from ..results import Result
from .friction import MODELS, Model
from .problem import Hunting, HuntingOrbit
from .servo import Servo, record_of, servo_of_record

Array = np.ndarray

CSV_COLUMNS = (
    "gain",
    "amplitude_rad",
    "period_s",
    "half_multiplier",
    "log10_abs_half_multiplier",
    "stable",
    "trivial_multiplier_error",
    "error_estimate",
    "status",
    "unknowns",
    "iterations",
    "special",
    "lopsided",
)
"""Columns of the table of a branch."""


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Result):
    """Hunting cycles of one servo along a varied parameter.

    Attributes
    ----------
    model, servo : the problem; `servo` holds the values that are not varied.
    orbits : in the order of computation.
    special : located special points.
    ended : one sentence that says why the branch ends where it does.
    missed : special points that were not located, and pairs that were not followed.
    lopsided : branches of lopsided cycles, one of each pair that branches off (`with_lopsided`); the other one is its
        mirror image.

    Examples
    --------
    >>> from casahunt import Servo, diagram
    >>> branch = diagram(Servo(), "switch", start=0.6)
    >>> [special.kind for special in branch.special]
    ['superstable', 'fold']
    >>> f"{branch.gains.max():.2f}"  # V/rad
    '0.65'
    """

    _quantities = ("model", "points = orbits.size", "ended")
    _details = ("servo", "gain_range [V/rad]", "missed", "lopsided")

    model: Model
    servo: Servo
    orbits: tuple[HuntingOrbit, ...]
    ended: str
    special: tuple[SpecialPoint[HuntingOrbit], ...] = ()
    missed: tuple[Missed, ...] = ()
    lopsided: tuple[Branch, ...] = ()

    @property
    def gains(self) -> Array:
        """(m,) controller gains K."""
        return np.array([orbit.gain for orbit in self.orbits])

    @property
    def amplitudes(self) -> Array:
        """(m,) amplitudes max |x1| [rad]."""
        return np.array([orbit.amplitude for orbit in self.orbits])

    @property
    def periods(self) -> Array:
        """(m,) periods [s]."""
        return np.array([orbit.period for orbit in self.orbits])

    @property
    def half_multipliers(self) -> Array:
        """(m,) leading half multipliers mu; computed now where nobody has read them before."""
        return np.array([orbit.half_multiplier for orbit in self.orbits])

    @property
    def stable(self) -> Array:
        """(m,) bool: which are known to be."""
        return np.array([orbit.stable is True for orbit in self.orbits])

    @property
    def gain_range(self) -> tuple[float, ...]:
        """The smallest and the largest gain; empty without orbits."""
        return (float(self.gains.min()), float(self.gains.max())) if self.orbits else ()

    def _columns(self) -> Columns:
        kinds = {id(special.orbit): special.kind for special in self.special}
        rows = [csv_row(orbit, kinds.get(id(orbit), "")) for orbit in self.orbits]
        rows += [row for number, pair in enumerate(self.lopsided, 1) for row in pair_rows(pair, number)]
        return columns_from(CSV_COLUMNS, rows)

    def _more(self) -> dict[str, Any]:
        special = [
            {**s.to_dict(table=False), "gain": s.orbit.gain, "amplitude": s.orbit.amplitude, "period": s.orbit.period}
            for s in self.special
        ]
        return {"special": special}


def pair_rows(pair: Branch, number: int) -> list[list[Any]]:
    """The rows of a branch of lopsided cycles, its special points behind the others; number: which pair, from 1."""
    special = [csv_row(found.orbit, found.kind, number) for found in pair.special]
    return [csv_row(orbit, "", number) for orbit in pair.orbits] + special


def csv_row(orbit: HuntingOrbit, special: str, lopsided: int = 0) -> list[Any]:
    """One row of the CSV file.

    special: kind of the special point; "" for none; lopsided: number of the pair, 0 for a symmetric cycle, as which a
    cycle that a pair meets is told too. Returns values in the order of `CSV_COLUMNS`.
    """
    multipliers = orbit.multipliers
    trusted, symmetric = multipliers.trusted, not lopsided or orbit.half
    return [
        orbit.gain,
        orbit.amplitude,
        orbit.period,
        orbit.half_multiplier if trusted and symmetric else math.nan,
        multipliers.log10_leading if trusted and symmetric and not multipliers.leading_floor else math.nan,
        orbit.stable if trusted and special != FOLD.kind else "",  # at a fold it is neither
        multipliers.trivial_error,
        orbit.error_estimate,
        orbit.status.name.lower(),
        orbit.unknowns,
        orbit.iterations,
        special,
        lopsided,
    ]


# Hunting cycles and branches of them on disk (orbits/archive.py): the problem is written as model, servo and gain

__all__ = ["load_branch", "load_orbit", "save_branch", "save_orbit"]

INTERRUPTED = "interrupted"
"""Why a branch or a curve ends that is not at its end."""


def _pose(record: Mapping[str, Any]) -> Hunting:
    model: Any = choice_of("model", record["model"], MODELS)
    half = Hunting(model, servo_of_record(record), require("gain", record["gain"], above=0))
    return half if record["half"] else half.whole()


def load_orbit(path: str | Path) -> HuntingOrbit:
    """Read an orbit written by `save_orbit`.

    Parameters
    ----------
    path
        the file (npz).

    Returns
    -------
    HuntingOrbit.

    Raises
    ------
    InputError : it is anything else; says what is wrong.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt import Servo, find_orbit, load_orbit, save_orbit
    >>> orbit = find_orbit(Servo(), "switch", 0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_orbit(orbit, Path(folder, "orbit.npz"))
    ...     load_orbit(Path(folder, "orbit.npz")).period == orbit.period
    True
    """
    archive = Archive(path, "orbit")
    orbit: HuntingOrbit = archive.checked(lambda: archive.orbit(archive.metadata["orbit"], _pose))
    return orbit


def save_branch(
    branch: Branch, path: str | Path, *, said: dict[Any, Any] | None = None
) -> None:
    """Write a branch to `path` (npz).

    Parameters
    ----------
    branch, path
        what, and where to.
    said
        what a file of the same branch, shorter, has put into words already; what is new is added.

    Raises
    ------
    InputError : there can be no file at `path`, or the branch holds NaN or infinity.
    OSError : the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt import Branch, Servo, find_orbit, load_branch, save_branch
    >>> branch = Branch("switch", Servo(), (find_orbit(Servo(), "switch", 0.1),), "one point")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_branch(branch, Path(folder, "branch.npz"))
    ...     again = load_branch(Path(folder, "branch.npz"))
    >>> again.gains.tolist(), again.ended
    ([0.1], 'one point')
    """
    content = {
        "model": branch.model,
        **record_of(branch.servo),
        **_content(branch),
        "lopsided": [_content(pair) for pair in branch.lopsided],
    }
    write_archive(path, "branch", content, said=said)


def _content(branch: Branch) -> dict[str, Any]:
    """What a branch has of its own."""
    return {
        "ended": branch.ended,
        "special": [
            {
                "kind": s.kind, "meaning": s.meaning, "at": s.at, "vary": s.vary, "orbit": s.orbit,
                "error": s.error if math.isfinite(s.error) else None, "multiplicity": s.multiplicity,
            }
            for s in branch.special  # fmt: skip
        ],
        "orbits": branch.orbits,
        "missed": [{"kind": m.kind, "meaning": m.meaning} for m in branch.missed],
    }


def load_branch(path: str | Path) -> Branch:
    """Read a branch written by `save_branch`.

    Parameters
    ----------
    path
        the file (npz).

    Returns
    -------
    Branch.

    Raises
    ------
    InputError : it is anything else; says what is wrong.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt import Branch, Servo, find_orbit, load_branch, save_branch
    >>> branch = Branch("switch", Servo(), (find_orbit(Servo(), "switch", 0.1),), "one point")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_branch(branch, Path(folder, "branch.npz"))
    ...     again = load_branch(Path(folder, "branch.npz"))
    >>> again.gains.tolist(), again.ended
    ([0.1], 'one point')
    """
    archive = Archive(path, "branch")
    return archive.checked(lambda: _branch(archive))


def _branch(archive: Archive) -> Branch:
    branch = _own(archive, archive.metadata)
    return replace(branch, lopsided=tuple(_own(archive, pair) for pair in archive.metadata.get("lopsided", [])))


def _own(archive: Archive, content: Mapping[str, Any]) -> Branch:
    """What `_content` has said of a branch, of the model and the servo that a file is about."""
    branch = Branch(
        model=archive.metadata["model"],
        servo=servo_of_record(archive.metadata),
        orbits=tuple(archive.orbit(record, _pose) for record in content["orbits"]),
        ended=str(content["ended"]),
        special=tuple(
            SpecialPoint(
                kind=str(s["kind"]),
                orbit=archive.orbit(s["orbit"], _pose),
                meaning=str(s["meaning"]),
                at=None if s.get("at") is None else float(s["at"]),  # version 0.2 wrote neither this nor the next
                vary=str(s.get("vary", "")),
                error=math.nan if s.get("error") is None else float(s["error"]),  # older files have neither
                multiplicity=int(s.get("multiplicity", 1)),
            )
            for s in content["special"]
        ),
        missed=tuple(Missed(str(m["kind"]), str(m["meaning"])) for m in content.get("missed", [])),
    )
    others = [orbit.model for orbit in (*branch.orbits, *(s.orbit for s in branch.special))]
    if any(model != branch.model for model in others):
        raise ValueError("the branch holds orbits of another model")
    return branch
