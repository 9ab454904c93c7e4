"""The cyclic fold: the largest gain at which the servo can hunt.

Two ways that share nothing but the collocation equations:

* along the branch: the point where the tangent has no parameter component (monitor.py), the mesh adapted
  and the error of the gain estimated there by an adjoint;
* as an optimisation problem: maximise lambda subject to the transcription, IPOPT with the exact Hessian.
  Its multipliers are the adjoint of the fold, d gain/d q = -nu . dG/dq for every parameter q.  Where Newton is to
  work alone, the turning point of the curve on a fixed mesh takes its place (turning_point.py).

`find_fold` does both from nothing but the servo and refuses where they disagree.  An extended system
(J v = 0, |v| = 1) serves as a third opinion in the tests.

The walk needs a gain at which the servo hunts, not far below the fold.  The search starts at the gain below
which the frictionless linear loop is unstable, J / (cm tau_d (tau_d + tau_i)) (Routh-Hurwitz; report, section
2), goes up and down from there in factors of two to the first cycle, and then up as far as the event map
finds one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .adapt import TOLERANCE_RANGE, Options, curve_border
from .admissibility import judge
from .branch import SpecialPoint
from .cold_start import check_problem, stable_at
from .continuation import ends, secant, walk
from .errors import InputError, NoOrbit, Status
from .event_map import GROWING, TYPICAL, Scan, near_stable, scan
from .fixed_points import fixed_points
from .hunting import Model
from .linear_loop import routh_hurwitz_gain
from .mesh import amplitude_row, better_breaks, estimate, on_halved_mesh, transfer
from .monitor import FOLD, locate, special_point
from .orbit import Orbit, direction_of, orbit_of, unknowns_of
from .servo import Servo
from .solve import Maximum, Solution, Solver, maximise_parameter
from .transcription import Setting, Transcription
from .turning_point import turning_point

Array = np.ndarray

SEARCH_FACTORS = 12
"""Gains searched for a first cycle: up to this many factors of two from the Routh-Hurwitz gain, each way."""
LUGRE_SEARCHES = 5
"""Gains at which a LuGre cycle is sought by its own, slow map where the Switch servo has none."""
MOST_FAILED = 8
"""Cycles that may turn out not to be computable before the search is given up."""
BESIDE, BESIDE_POINTS = 3.0, 5
"""Factor each way, and motions at first, within which a fixed point seen in a search is looked at again."""
CLIMB = (4.0, 2.0, 1.4)
MOST_CLIMBS = 20
"""Factors by which the gain is raised, each as long as a cycle is found."""
FINER = (0.1, 1e-3)
"""Parts of the tolerance to which the fold is located, in turn: its place on the branch takes a finer mesh than its
gain, period and amplitude being first order in it."""
WALK_TOLERANCE = 1e-5
"""The way to a fold and round it needs no more accuracy than this; its end is computed to the tolerance."""
SHARP_TOLERANCE = 1e-8
"""Of the walk to a fold that the rough walk has not led to."""
OPTIMAL_ROUNDS, SMALL_STEPS = 8, 6
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
    optimised_gain : the fold gain of the optimisation problem on the same mesh; that of the turning point there where
        Newton works alone.
    multipliers : (size,) multipliers of the collocation equations, the adjoint of the fold.
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
    seen: list[tuple[float, Scan]] = []
    promised: list[tuple[float, float]] = []
    failed: list[str] = []
    for gain, a in _gains_to_try(servo, model, gains, seen):
        promised += [(gain, a)] if a is not None else []
        try:
            met = stable_at(servo, model, gain, options=options)
        except NoOrbit as error:
            failed.append(str(error))
            if len(failed) == MOST_FAILED:
                break
            continue
        if met.orbit is not None:
            return met.orbit
    tried = f"{len(failed)} of them were tried: {failed[-1]}" if failed else "none of them led to one"
    if any(_has_fixed_point(servo, gain, a) for gain, a in promised):
        raise NoOrbit(
            f"no hunting limit cycle of the {model} servo was computed, though the event map of the Switch servo shows "
            f"some: {tried}",
            Status.NOT_CONVERGED if failed else Status.NOT_FOUND,
        )
    evidence = f"{len(gains)} gains from {min(gains):.3g} to {max(gains):.3g} were scanned{_most(seen)}"
    if failed:
        evidence += f"; at some, motions come back so close to where they started that cycles were sought, and {tried}"
    raise NoOrbit(
        f"no hunting limit cycle of the {model} servo was found: {evidence}", Status.NOT_FOUND if failed else None
    )


def _gains_to_try(
    servo: Servo, model: Model, gains: list[float], seen: list[tuple[float, Scan]]
) -> Iterator[tuple[float, float | None]]:
    """(gain, stick position) where the Switch servo seems to hunt, the highest of each climb first; then, for LuGre,
    (gain, None).  The scans that show no cycle are added to `seen`."""
    for gain in gains:
        unit = servo.friction.static / servo.torque_gains(gain)[0]
        rigid = near_stable("switch", servo, gain, TYPICAL * unit)
        if rigid is None:
            scanned = scan("switch", servo, gain)
            rigid = scanned.upper
            if rigid is None:
                seen.append((gain, scanned))
        if rigid is not None:
            yield from reversed(_climb(servo, gain, rigid.start))
    if model != "switch":
        yield from ((gain, None) for gain in gains[:LUGRE_SEARCHES])


def _has_fixed_point(servo: Servo, gain: float, a: float) -> bool:
    """Whether the event map of the Switch servo, computed to rounding, has a fixed point next to a.

    The motions of a search are good for 1e-4 of P(a)/a, which at tiny gains is itself that close to one.
    """
    return bool(fixed_points(servo, gain, a / BESIDE, a * BESIDE, points=BESIDE_POINTS).fixed)


def _most(seen: list[tuple[float, Scan]]) -> str:
    """How far the motions of scans without a cycle came back, in words."""
    known = [(s.best, gain, s) for gain, s in seen if s.motions]
    if not known:
        return ""
    best, gain, s = max(known, key=lambda k: k[:2])
    growing = [k[1] for k in known if k[0] > GROWING]
    if growing:
        return (
            f"; at gains from {min(growing):.3g} to {max(growing):.3g} motions grow and no stable cycle bounds them, "
            "as with an unstable linear loop"
        )
    return f" with the Switch servo; the farthest back it comes at gain {gain:.3g}: {s.sentence()}"


def _climb(servo: Servo, gain: float, a: float) -> list[tuple[float, float | None]]:
    """Increasing gains at which the Switch servo has a stable cycle, each with its stick position, from (gain, a)."""
    gains: list[tuple[float, float | None]] = [(gain, a)]
    for factor in CLIMB:
        for _ in range(MOST_CLIMBS):
            found = near_stable("switch", servo, gain * factor, a / factor)
            if found is None:
                break
            gain, a = gain * factor, found.start
            gains.append((gain, a))
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
    try:
        return _walked_to(first, rough, options, began)
    except NoOrbit:
        # Next to a very sharp fold the errors of the rough way are as large as what is left of the branch.
        return _walked_to(first, replace(options, tol=min(options.tol, SHARP_TOLERANCE)), options, began)


def _walked_to(first: Orbit, way: Options, options: Options, began: float) -> Fold:
    """The confirmed fold at the end of a walk from `first` with the tolerance of `way`."""
    before, model = first, first.model
    steps = walk(first, low=first.gain * 1e-3, high=first.gain * HIGHEST, options=way)
    while True:
        try:
            after = next(steps)
        except StopIteration as end:
            raise NoOrbit(
                f"the fold of the {model} servo was not found: its cycles were followed from gain {first.gain:.6g} to "
                f"{before.gain:.8g}, where the half multiplier is {before.half_multiplier:.3g}: {end.value}",
                Status.NOT_CONVERGED,
            ) from None
        for finer in FINER:
            sharp = replace(options, tol=max(options.tol * finer, TOLERANCE_RANGE[0]))
            if not _turns_back(before, after):
                break
            try:
                return confirmed(_located(before, after, sharp), options, began)
            except NoOrbit:
                if finer == FINER[-1]:
                    raise
        before = after


def _turns_back(before: Orbit, after: Orbit) -> bool:
    """Whether the gain has a maximum between two successive orbits of a walk."""
    here, there = ends(before, after, "gain")
    return FOLD.value(before, here) > 0 >= FOLD.value(after, there)


def _located(before: Orbit, after: Orbit, options: Options) -> SpecialPoint:
    """The fold between two orbits: as a point of the branch, or where that is too sharp as the optimum next to them."""
    orbit = locate(before, after, FOLD, vary="gain", options=options)
    if orbit is None:  # the way between the two bends too much for one tangent to measure it
        orbit = _located_in_small_steps(before, after, options)
    if orbit is None:
        orbit = _optimal(max(before, after, key=lambda o: o.gain), options)
    return special_point(FOLD, orbit, "gain")


def _located_in_small_steps(before: Orbit, after: Orbit, options: Options) -> Orbit | None:
    step = float(np.linalg.norm(secant(before, after, "gain"))) / SMALL_STEPS
    rough = replace(options, tol=max(options.tol, WALK_TOLERANCE))
    steps = walk(
        before, low=0.5 * before.gain, high=2 * before.gain, options=rough, first_step=step, largest_step=step,
        max_points=4 * SMALL_STEPS,
    )  # fmt: skip
    here = before
    for following in steps:
        if _turns_back(here, following):
            return locate(here, following, FOLD, vary="gain", options=options)
        here = following
    return None


def _optimal(orbit: Orbit, options: Options) -> Orbit:
    """The orbit of largest gain next to an orbit near the fold, on meshes adapted to the tolerance."""
    t, u, setting = unknowns_of(orbit)
    setting = replace(setting, dp=direction_of("gain") * orbit.gain)
    across = np.append(np.zeros(t.n), [1.0, 0.0])  # at a fold the slip's duration moves, the gain does not
    for k in range(OPTIMAL_ROUNDS):
        best = _largest(t, u, setting, options)
        if not best.status.ok:
            break
        moved = setting.moved(best.parameter)
        error = estimate(t, best.u, moved, border=curve_border(t, best.u, across))
        if error.error <= options.tol and judge(t, best.u, moved).admissible:
            lin = t.linearise(best.u, moved)
            by = _maximiser(options)
            solution = Solution(best.u, 0.0, best.status, best.iterations, lin.residual_norm(), lin, by)
            return orbit_of(
                t, solution, moved, error, model=orbit.model, servo=orbit.servo, gain=orbit.gain * (1 + best.parameter),
                status=best.status, iterations=best.iterations, wall_s=orbit.wall_s,
            )  # fmt: skip
        breaks = better_breaks(t, setting.fractions, error, options.tol, k)
        t, u, fractions = transfer(t, best.u, setting.fractions, breaks)
        setting = replace(setting, fractions=fractions)
    raise NoOrbit(
        f"the fold of the {orbit.model} servo next to gain {orbit.gain:.10g} was not located on its branch, and as an "
        "optimisation problem it was not solved to the tolerance; try another tolerance",
        Status.NOT_CONVERGED,
    )


def next_fold(orbit: Orbit, options: Options) -> SpecialPoint:
    """The fold right above an orbit, from that orbit alone: where natural continuation ends.

    Raises
    ------
    NoOrbit : the largest gain next to the orbit is not found, or not confirmed.
    """
    best = _optimal(orbit, options)
    found = confirmed(special_point(FOLD, best, "gain"), options)
    return special_point(FOLD, found.orbit, "gain", found.gain_error)


def _maximiser(options: Options) -> Solver:
    """Who looks for the largest gain: IPOPT, where it is not to be Newton alone."""
    return "newton" if options.solver == "newton" else "ipopt"


def _largest(t: Transcription, u: Array, setting: Setting, options: Options) -> Maximum:
    """The largest gain next to u, as an optimisation problem, or as a turning point where Newton is to work alone."""
    return (maximise_parameter if _maximiser(options) == "ipopt" else turning_point)(t, u, setting)


def confirmed(special: SpecialPoint, options: Options, began: float | None = None) -> Fold:
    """A located fold, checked against the optimisation problem on its mesh and on the mesh with halved intervals.

    What a coarse mesh does to the place of the fold along the branch, no estimate at a point of the branch can see;
    the second optimum does, and the errors of the orbit of the result are not less than the distance to it.

    Raises
    ------
    InputError : the special point is no fold.
    NoOrbit : the fold gains differ by more than the tolerance, or an error estimate exceeds it.
    """
    if special.kind != FOLD.kind:
        raise InputError(f"special point {special.kind!r}: must be a fold")
    began = time.perf_counter() if began is None else began
    orbit = special.orbit
    t, u, setting = unknowns_of(orbit)
    setting = replace(setting, dp=direction_of("gain") * orbit.gain)
    best = _largest(t, u, setting, options)
    gain = orbit.gain * (1 + best.parameter)
    if not best.status.ok or abs(best.parameter) > options.tol:
        found = f"gives {gain:.10g}" if best.status.ok else f"was not solved ({best.status.advice})"
        raise NoOrbit(
            f"the fold of the {orbit.model} servo at gain {orbit.gain:.10g} is not confirmed: the optimisation problem "
            f"{found}; try another tolerance",
            best.status,
        )
    finer, u, fractions = on_halved_mesh(t, best.u, setting.fractions)
    check = _largest(finer, u, replace(setting.moved(best.parameter), fractions=fractions), options)
    if not check.status.ok:
        raise NoOrbit(
            f"the fold of the {orbit.model} servo at gain {orbit.gain:.10g} is not confirmed: on a mesh of half the "
            "intervals' length the optimisation problem was not solved; try another tolerance",
            check.status,
        )
    period = float(np.sum(finer.durations_of(check.u))) * t.cycle.repeats
    amplitude = amplitude_row(finer, check.u)[0] * float(setting.scale[0])
    error = max(orbit.parameter_error, abs(best.parameter), abs(best.parameter + check.parameter))
    orbit = replace(
        orbit,
        period_error=max(orbit.period_error, abs(period / orbit.period - 1)),
        amplitude_error=max(orbit.amplitude_error, abs(amplitude / orbit.amplitude - 1)),
        parameter_error=error,
    )
    if orbit.error_estimate > options.tol:
        raise NoOrbit(
            f"the fold of the {orbit.model} servo at gain {orbit.gain:.10g} is not known to the tolerance: the error "
            f"estimate is {orbit.error_estimate:.2g}; ask for a larger tolerance",
            Status.TOLERANCE_NOT_REACHED,
        )
    return Fold(orbit, orbit.gain, error, gain, best.multipliers, orbit.status, time.perf_counter() - began)


def confirmed_smallest(special: SpecialPoint, options: Options) -> Fold:
    """A located fold at which the gain is smallest, checked against the optimisation problem on its mesh.

    Raises
    ------
    NoOrbit : the fold gains differ by more than the tolerance, or an error estimate exceeds it.
    """
    orbit = special.orbit
    t, u, setting = unknowns_of(orbit)
    least = _largest(t, u, replace(setting, dp=-direction_of("gain") * orbit.gain), options)
    error = max(orbit.parameter_error, orbit.error_estimate, abs(least.parameter))
    if not least.status.ok or error > options.tol:
        raise NoOrbit(f"the fold at gain {orbit.gain:.10g} is not confirmed as the smallest gain", least.status)
    gain = orbit.gain * (1 - least.parameter)
    return Fold(orbit, orbit.gain, error, gain, -least.multipliers, orbit.status, orbit.wall_s)
