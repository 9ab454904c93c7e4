"""Hunting cycles and branches of them on disk (orbits/archive.py): the problem is written as model, servo and gain.

Of a loop of parts, whose functions no file holds, a branch is read by handing in the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import choice_of, finite_or_none, require
from ..continuation import Branch, End, Missed, SpecialPoint
from ..errors import InputError
from ..orbits import Archive, Orbit, posed, write_archive
from .friction import MODELS
from .parts.loop import Loop
from .problem import Hunting, HuntingOrbit
from .servo import servo_of_record

TINY_SPAN = 1e-12
"""Span below which all values of a parameter, or all amplitudes, are the same."""


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
    record = archive.metadata.get("orbit")
    if isinstance(record, dict) and "problem" in record:
        what = "holds the cycle of a loop of parts, or of a System, but not its functions"
        raise InputError(f"{str(path)!r} {what}: casahunt.orbits.load_orbit(path, loop.system) reads it")
    orbit: HuntingOrbit = archive.checked(lambda: archive.orbit(archive.metadata["orbit"], _pose))
    return orbit


def save_branch(branch: Branch[Any], path: str | Path) -> None:
    """Write a branch to `path` (npz).

    Parameters
    ----------
    branch, path
        what, and where to.

    Raises
    ------
    InputError : there can be no file at `path`, or the branch holds NaN or infinity.
    OSError : the disk is full.

    Examples
    --------
    >>> from pathlib import Path
    >>> from casahunt import Branch, InputError, Servo, find_orbit, save_branch
    >>> try:
    ...     save_branch(Branch("gain", (find_orbit(Servo(), "switch", 0.1),)), Path("no", "such", "folder.npz"))
    ... except InputError as refusal:
    ...     print(str(refusal)[:12])
    cannot write
    """
    lopsided = [_content(pair) for pair in branch.lopsided]
    write_archive(path, "branch", {**_content(branch), "lopsided": lopsided})


def _content(branch: Branch[Any]) -> dict[str, Any]:
    """What a branch has of its own."""
    place = {id(orbit): k for k, orbit in enumerate(branch.orbits)}
    return {
        "vary": branch.vary,
        "ended": branch.ended,
        "end": {f.name: _told(getattr(branch.end, f.name)) for f in fields(End) if f.name != "sentence"},
        "special": [
            {
                **{f.name: _told(getattr(special, f.name)) for f in fields(SpecialPoint) if f.name != "behind"},
                "behind": place.get(id(special.behind)),
            }
            for special in branch.special
        ],
        "orbits": branch.orbits,
        "missed": [{"kind": m.kind, "meaning": m.meaning} for m in branch.missed],
    }


def _told(value: Any) -> Any:
    """A value as JSON has it."""
    return finite_or_none(value) if isinstance(value, float) else value


def load_branch(path: str | Path, loop: Loop | None = None) -> Branch[Any]:
    """Read a branch written by `save_branch`.

    Parameters
    ----------
    path
        the file (npz).
    loop
        the loop of parts, where it is a branch of one, at any values of its parameters.

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
    >>> branch = Branch("gain", (find_orbit(Servo(), "switch", 0.1),))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_branch(branch, Path(folder, "branch.npz"))
    ...     again = load_branch(Path(folder, "branch.npz"))
    >>> again.values.tolist()
    [0.1]
    """
    archive = Archive(path, "branch")
    pose = _pose if loop is None else partial(posed, loop.system)

    def read() -> Branch[Any]:
        pairs = tuple(_branch(archive, pair, pose) for pair in archive.metadata.get("lopsided", []))
        return replace(_branch(archive, archive.metadata, pose), lopsided=pairs)

    return archive.checked(read)


def _branch(archive: Archive, content: Mapping[str, Any], pose: Callable[[Mapping[str, Any]], Any]) -> Branch[Any]:
    """What `_content` has said of a branch; earlier versions knew branches in the gain alone, and less of each."""
    vary, orbits = content.get("vary", "gain"), tuple(archive.orbit(record, pose) for record in content["orbits"])
    special = []
    for s in content["special"]:
        at, error = (None if s.get(name) is None else float(s[name]) for name in ("at", "error"))
        alone, many = archive.orbit(s["orbit"], pose), int(s.get("multiplicity", 1))
        orbit = next((one for one in orbits if _sizes(one, vary) == _sizes(alone, vary)), alone)
        behind = s["behind"] if "behind" in s else _behind(orbits, orbit, vary)
        special.append(
            SpecialPoint(
                str(s["kind"]), orbit, str(s["meaning"]), at, str(s.get("vary", "")),
                math.nan if error is None else error, many, None if behind is None else orbits[behind],
            )
        )  # fmt: skip
    if len({each.problem.title for each in (*orbits, *(s.orbit for s in special))}) > 1:
        raise ValueError("the branch holds orbits of another model")
    end: dict[str, Any] = {name: math.nan if x is None else x for name, x in content.get("end", {"kind": ""}).items()}
    missed = tuple(Missed(str(m["kind"]), str(m["meaning"])) for m in content.get("missed", []))
    return Branch(vary, orbits, tuple(special), missed, End(sentence=str(content["ended"]), **end))


def _sizes(orbit: Orbit, vary: str) -> tuple[float, ...]:
    """By which it is told whether a special point is one of the orbits."""
    return orbit.problem.value(vary), orbit.period, orbit.amplitude


def _behind(orbits: tuple[Orbit, ...], special: Orbit, vary: str) -> int | None:
    """Behind which orbit a special point lies of which that is not told: where the detour to it is shortest.

    That is in the parameter and the logarithm of the amplitude, over their spans.
    """
    if len(orbits) < 2:
        return None
    places = np.array([(o.problem.value(vary), math.log(o.amplitude)) for o in (*orbits, special)])
    places /= np.maximum(np.ptp(places, axis=0), TINY_SPAN)
    path, to = places[:-1], np.linalg.norm(places[:-1] - places[-1], axis=1)
    return int(np.argmin(to[:-1] + to[1:] - np.linalg.norm(np.diff(path, axis=0), axis=1)))
