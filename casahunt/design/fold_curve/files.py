"""A fold curve on the disk, whole after every point, taken up again where a run was ended.

The orbits at the folds are written as a branch (orbits/archive.py), the numbers of the points beside them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...errors import InputError, Status
from ...servo.branch import Branch
from ...servo.hunting import Model
from ...servo.saved import load_run, same_task, save_branch
from ...servo.servo import Servo
from .data import FoldCurve, FoldPoint

_NUMBERS = ("value", "gain", "slope", "error_estimate", "curvature", "turns")


def save_curve(curve: FoldCurve, path: Path, settings: Mapping[str, Any]) -> None:
    """Write a fold curve (npz) with the settings it was computed with.

    settings: by their names on the command line. Raises InputError, OSError: as `save_branch`.
    """
    run = {
        "settings": dict(settings),
        "points": [[getattr(p, name) for name in _NUMBERS] + [p.status.name] for p in curve.points],
        "how": [p.how for p in curve.points],
        "curve": [curve.vary, curve.status.name, curve.wall_s, curve.vanishes],
    }
    orbits = tuple(point.orbit for point in curve.points)
    save_branch(Branch(curve.model, curve.servo, orbits, curve.ended), path, run=run)


def load_curve(path: Path) -> tuple[FoldCurve, dict[str, Any]]:
    """(curve, settings) that `save_curve` has written.

    Raises InputError: the file is missing or damaged, or holds something else.
    """
    branch, run = load_run(path)
    try:
        points = tuple(
            FoldPoint(**dict(zip(_NUMBERS, numbers, strict=True)), orbit=orbit, status=Status[status], how=how)
            for (*numbers, status), how, orbit in zip(run["points"], run["how"], branch.orbits, strict=True)
        )
        vary, status, wall_s, vanishes = run["curve"]
        cusps = tuple(point for point in points if point.turns)
        curve = FoldCurve(
            branch.model, branch.servo, vary, points, cusps, branch.ended, Status[status], wall_s, vanishes
        )
        return curve, dict(run["settings"])
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{str(path)!r} holds a branch, not the points of a fold curve") from None


def saved_curve(path: Path, servo: Servo, model: Model, settings: Mapping[str, Any]) -> FoldCurve | None:
    """The curve of an earlier run of the same task.

    settings: by their names on the command line. Returns the curve, or what there is of it; None where there is no
    file. Raises InputError: the file is damaged, or is of another task.
    """
    if not path.exists():
        return None
    curve, theirs = load_curve(path)
    same_task(path, curve, theirs, servo, model, settings)
    return curve
