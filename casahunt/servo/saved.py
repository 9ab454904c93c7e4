"""Hunting cycles and branches of them on disk (orbits/archive.py): the problem is written as model, servo and gain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..checks import choice_of, require
from ..continuation import Missed, SpecialPoint
from ..orbits import Archive, write_archive
from ..orbits.archive import save_orbit
from .branch import Branch
from .friction import MODELS
from .problem import Hunting, HuntingOrbit
from .servo import record_of, servo_of_record

__all__ = ["load_branch", "load_orbit", "load_run", "save_branch", "save_orbit"]

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
    branch: Branch, path: str | Path, *, run: Mapping[str, Any] | None = None, said: dict[Any, Any] | None = None
) -> None:
    """Write a branch to `path` (npz).

    Parameters
    ----------
    branch, path
        what, and where to.
    run
        how it was computed, as JSON can say it: `load_run` gives it back.
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
        "run": dict(run or {}),
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
    return load_run(path)[0]


def load_run(path: str | Path) -> tuple[Branch, dict[str, Any]]:
    """A branch, and what `save_branch` was told about its run; empty where nothing was.  Raises as `load_branch`."""
    archive = Archive(path, "branch")
    run = archive.metadata.get("run", {})
    return archive.checked(lambda: _branch(archive)), run if isinstance(run, dict) else {}


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
