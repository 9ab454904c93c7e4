"""From a servo to an orbit, without a guess from the user.

    event map -> half cycle -> transcription -> IPOPT -> adapt.py -> Orbit

The stable cycle is found next to the outer fixed point of the event map, the unstable one next to the
inner fixed point.  Where the map shows that there is none, the error says what was scanned.
"""

from __future__ import annotations

import time
from typing import Literal

import numpy as np

from .adapt import SCHEMES, Options, Solved, solve_adaptively
from .checks import known, require
from .errors import NoOrbit, Status
from .event_map import HalfCycle, half_cycle, near_stable, scan
from .hunting import MODELS, Model
from .orbit import Orbit, direction_of, orbit_of
from .resequence import from_segments
from .servo import Servo

Array = np.ndarray
BranchName = Literal["stable", "unstable"]
BRANCHES: tuple[BranchName, ...] = ("stable", "unstable")


def starting_half_cycle(
    servo: Servo, model: Model, gain: float, branch: BranchName
) -> tuple[HalfCycle | None, str]:
    """(a half cycle close to the wanted orbit or None, the evidence of the scan in words).

    The LuGre cycle mostly lies close to the Switch cycle, whose map costs a tenth; the full LuGre scan is
    for servos where that short cut does not lead to a stable fixed point.
    """
    if model == "lugre" and branch == "stable":
        rigid = scan("switch", servo, gain)
        if rigid.upper is not None:
            start = near_stable(model, servo, gain, rigid.upper.start)
            if start is not None:
                return start, ""
    seen = scan(model, servo, gain, want_lower=branch == "unstable")
    return (seen.upper if branch == "stable" else seen.lower), seen.sentence()


def find_orbit(
    servo: Servo,
    model: Model,
    gain: float,
    *,
    branch: BranchName = "stable",
    options: Options | None = None,
) -> Orbit:
    """The hunting cycle of a servo at one gain, from nothing but the servo.

    Parameters
    ----------
    servo, model, gain : the problem; gain > 0.
    branch : the stable cycle, or the unstable one that bounds its basin.
    options : tolerance and method.

    Returns
    -------
    Orbit with status CONVERGED.

    Raises
    ------
    InputError : a value out of range.
    NoOrbit : there is no such cycle (with the scan that shows it), or it could not be computed.
    """
    began = time.perf_counter()
    options = options or Options()
    check_problem(servo, model, gain)
    known("branch", branch, BRANCHES)
    start, evidence = starting_half_cycle(servo, model, gain, branch)
    if start is None:
        raise NoOrbit(f"no hunting limit cycle ({branch} branch) of the {model} servo at gain {gain:g}: {evidence}")
    degree, kind = options.scheme_of(model)
    if (degree, kind) != SCHEMES[model]:
        start = half_cycle(model, servo, gain, start.start, degree=degree, kind=kind)
    first = from_segments(
        model, start.segments, servo.parameters(gain), direction_of("gain"),
        degree=degree, kind=kind, half=options.half,
    )  # fmt: skip
    solved = solve_adaptively(model, first, options, solver=options.solver)
    orbit = finished(solved, model, servo, gain, options, began, f"the {branch} hunting cycle")
    if orbit.stable != (branch == "stable") and _wrong_branch(orbit, branch):
        raise NoOrbit(
            f"the {branch} hunting cycle of the {model} servo at gain {gain:g} was not computed: the solver "
            f"converged to the other branch (half multiplier {orbit.half_multiplier:.4g}); the gain is close to the "
            "fold, where the two cycles merge",
            Status.FAR_FROM_GUESS,
        )
    return orbit


def _wrong_branch(orbit: Orbit, branch: BranchName) -> bool:
    """A multiplier beyond +1 belongs to the unstable branch; one beyond -1 to a broken symmetry."""
    beyond_fold = orbit.multipliers.leading.real > 1
    return beyond_fold if branch == "stable" else not beyond_fold


def check_problem(servo: Servo, model: Model, gain: float) -> None:
    """Raise InputError for an unknown model or a gain that is not positive, NoOrbit for pure Coulomb friction."""
    known("model", model, MODELS)
    require("gain", gain, above=0)
    if servo.friction.static == servo.friction.coulomb:
        raise NoOrbit(
            "no hunting limit cycle: static equals Coulomb friction, and without a Stribeck drop in the friction "
            "curve the integral action cannot sustain an oscillation (Bisoffi et al.); no gain had to be scanned"
        )


def finished(
    solved: Solved, model: Model, servo: Servo, gain: float, options: Options, began: float, what: str
) -> Orbit:
    """The Orbit of a converged `Solved`, or NoOrbit with the advice."""
    if not solved.status.ok or solved.estimate is None:
        raise NoOrbit(f"{what} of the {model} servo at gain {gain:g} was not computed: {solved.complaint()}", solved.status)
    return orbit_of(
        solved.t, solved.solution, solved.setting, solved.estimate,
        model=model, servo=servo, gain=gain, status=solved.status, solver=options.solver,
        iterations=solved.iterations, wall_s=time.perf_counter() - began,
    )  # fmt: skip
