"""The cyclic fold: the largest gain at which the servo can hunt.

Two ways that share nothing but the collocation equations:

* along the branch: the point where the tangent has no parameter component (monitor.py), the mesh adapted
  and the error of the gain estimated there by an adjoint;
* as an optimisation problem: maximise lambda subject to the transcription, IPOPT with the exact Hessian.
  Its multipliers are the adjoint of the fold, d gain/d q = -nu . dG/dq for every parameter q.

`find_fold` does both from nothing but the servo and refuses where they disagree.  An extended system
(J v = 0, |v| = 1) serves as a third opinion in the tests.

The walk needs a gain at which the servo hunts, not far below the fold.  The search starts at the gain below
which the frictionless linear loop is unstable, J / (cm tau_d (tau_d + tau_i)) (Routh-Hurwitz; report, section
2), goes up and down from there in factors of two to the first cycle, and then up as far as the event map
finds one.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from .adapt import Options
from .branch import SpecialPoint
from .continuation import walk
from .errors import InputError, NoOrbit, Status
from .event_map import near_stable, scan
from .find import WALK_TOLERANCE, check_problem, find_orbit, refined
from .hunting import Model
from .linear_loop import routh_hurwitz_gain
from .monitor import FOLD, crossings
from .orbit import Orbit, direction_of, unknowns_of
from .servo import Servo
from .solve import Maximum, maximise_parameter

Array = np.ndarray

SEARCH_FACTORS = 12
"""Gains searched for a first cycle: up to this many factors of two from the Routh-Hurwitz gain, each way."""
LUGRE_SEARCHES = 5
"""Gains at which a LuGre cycle is sought by its own, slow map where the Switch servo has none."""
CLIMB = (4.0, 2.0, 1.4)
MOST_CLIMBS = 20
"""Factors by which the gain is raised, each as long as a cycle is found."""
HIGHEST = 1e9
"""Gain, in units of the first one, beyond which no fold is looked for."""


@dataclass(frozen=True, eq=False)
class Fold:
    """A cyclic fold in the gain.

    Attributes
    ----------
    orbit : the orbit at the fold.
    gain : the fold gain.
    gain_error : estimated relative error of the gain.
    optimised_gain : the fold gain of the optimisation problem on the same mesh.
    multipliers : (size,) IPOPT's multipliers of the collocation equations, the adjoint of the fold.
    status, wall_s : as everywhere.
    """

    orbit: Orbit
    gain: float
    gain_error: float
    optimised_gain: float
    multipliers: Array
    status: Status
    wall_s: float

    @property
    def error_estimate(self) -> float:
        """The largest estimated relative error of gain, amplitude and period."""
        return max(self.gain_error, self.orbit.error_estimate)


def find_any_orbit(servo: Servo, model: Model, *, options: Options) -> Orbit:
    """A stable hunting cycle at some gain, preferably not far below the fold.

    The event map of the Switch servo finds a gain with a cycle and climbs from there; it costs a hundredth of
    an orbit.  The first gain, from the highest down, at which the model's own cycle is found wins.

    Raises
    ------
    NoOrbit : none of the gains searched has one; says which were searched.
    """
    base = routh_hurwitz_gain(servo)
    if not np.isfinite(base):
        base = servo.inertia / (servo.motor_gain * servo.controller.integral_time**2)
    check_problem(servo, model, base)
    gains = [base * 2.0**k for n in range(SEARCH_FACTORS + 1) for k in ((n, -n) if n else (0,))]
    for gain in gains:
        rigid = scan("switch", servo, gain).upper
        if rigid is None:
            continue
        for higher in reversed(_climb(servo, gain, rigid.start)):
            try:
                return find_orbit(servo, model, higher, options=options)
            except NoOrbit:
                continue
    if model != "switch":
        for gain in gains[:LUGRE_SEARCHES]:
            try:
                return find_orbit(servo, model, gain, options=options)
            except NoOrbit:
                continue
    raise NoOrbit(
        f"no hunting limit cycle of the {model} servo found: {len(gains)} gains from {min(gains):.3g} to "
        f"{max(gains):.3g} were scanned"
        + ("" if servo.friction.falls else "; its friction rises with the velocity everywhere: nothing feeds a cycle")
    )


def _climb(servo: Servo, gain: float, a: float) -> list[float]:
    """Increasing gains at which the Switch servo has a stable cycle, from one with stick position a."""
    gains = [gain]
    for factor in CLIMB:
        for _ in range(MOST_CLIMBS):
            found = near_stable("switch", servo, gain * factor, a / factor)
            if found is None:
                break
            gain, a = gain * factor, found.start
            gains.append(gain)
    return gains


def find_fold(servo: Servo, model: Model, *, options: Options | None = None, start: Orbit | None = None) -> Fold:
    """The fold gain of a servo, from nothing but the servo.

    Parameters
    ----------
    servo, model
        the problem.
    options
        `tol` bounds the relative errors of gain, amplitude and period.
    start
        a stable orbit to walk from; default: searched for.

    Raises
    ------
    NoOrbit : no cycle, no fold in range, or two answers that differ.
    """
    began = time.perf_counter()
    options = options or Options()
    rough = replace(options, tol=max(options.tol, WALK_TOLERANCE))
    first = start or find_any_orbit(servo, model, options=rough)
    before, fold = first, None
    steps = walk(first, low=first.gain * 1e-3, high=first.gain * HIGHEST, options=rough)
    ended = ""
    while fold is None:
        try:
            after = next(steps)
        except StopIteration as end:
            ended = str(end.value)
            break
        special = crossings(before, after, vary="gain", monitors=(FOLD,), options=options)
        fold = special[0] if special else None
        before = after
    if fold is None:
        raise NoOrbit(
            f"the fold of the {model} servo was not found: its cycles were followed from gain {first.gain:.6g} to "
            f"{before.gain:.8g}, where the half multiplier is {before.half_multiplier:.3g}: {ended}",
            Status.NOT_CONVERGED,
        )
    if fold.orbit.error_estimate > options.tol:
        fold = replace(fold, orbit=refined(fold.orbit, options))
    return confirmed(fold, options, began)


def confirmed(special: SpecialPoint, options: Options, began: float | None = None) -> Fold:
    """A located fold, checked against the optimisation problem.

    Raises
    ------
    InputError : the special point is no fold.
    NoOrbit : the two fold gains differ by more than the tolerance, or an error estimate exceeds it.
    """
    if special.kind != FOLD.kind:
        raise InputError(f"special point {special.kind!r}: must be a fold")
    began = time.perf_counter() if began is None else began
    orbit = special.orbit
    best = optimum(orbit)
    gain = orbit.gain * (1 + best.parameter)
    if not best.status.ok or abs(best.parameter) > options.tol:
        found = f"gives {gain:.10g}" if best.status.ok else f"was not solved ({best.status.advice})"
        raise NoOrbit(
            f"the fold of the {orbit.model} servo at gain {orbit.gain:.10g} is not confirmed: the optimisation problem "
            f"{found}; try another tolerance",
            best.status,
        )
    error = max(orbit.parameter_error, abs(best.parameter))
    if max(error, orbit.error_estimate) > options.tol:
        raise NoOrbit(
            f"the fold of the {orbit.model} servo at gain {orbit.gain:.10g} is not known to the tolerance: the error "
            f"estimate is {max(error, orbit.error_estimate):.2g}; ask for a larger tolerance",
            Status.TOLERANCE_NOT_REACHED,
        )
    return Fold(orbit, orbit.gain, error, gain, best.multipliers, orbit.status, time.perf_counter() - began)


def optimum(orbit: Orbit) -> Maximum:
    """The optimisation problem on the mesh of an orbit near the fold, gain relative to the orbit's."""
    t, u, setting = unknowns_of(orbit)
    return maximise_parameter(t, u, replace(setting, dp=direction_of("gain") * orbit.gain))
