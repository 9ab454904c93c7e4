"""The largest gain at which a servo can hunt: from nothing but the servo to its confirmed fold (continuation/fold.py).

The walk needs a gain at which the servo hunts, not far below the fold.  The search starts at the gain below
which the frictionless linear loop is unstable, J / (cm tau_d (tau_d + tau_i)) (Routh-Hurwitz; report, section
2), goes up and down from there in factors of two to the first cycle, and then up as far as the event map
finds one.  Where motions go farther out at one of these gains, and not at the next, cycles are looked for in between.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from .. import effort
from ..continuation.fold import WALK_TOLERANCE, confirmed, located, turns_back
from ..continuation.walk import walk
from ..errors import NoOrbit, Status
from ..motion.march import MarchFailure
from ..orbits.adapt import TOLERANCE_RANGE, Options
from .cold_start import check_problem, check_times, stable_at
from .event_map.fixed_points import fixed_points
from .event_map.scan import GROWING, TYPICAL, HalfCycle, Scan, half_cycle, near_stable, scan
from .hunting import Model
from .linear_loop import routh_hurwitz_gain
from .problem import HuntingFold, HuntingOrbit
from .servo import Servo

SEARCH_FACTORS = 12
"""Gains searched for a first cycle: up to this many factors of two from the Routh-Hurwitz gain, each way."""
HALVINGS = 8
"""Gains searched between one at which motions go farther out and twice that, at which they do not."""
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
SHARP_TOLERANCE = 1e-8
"""Of the walk to a fold that the rough walk has not led to."""
HIGHEST = 1e9
"""Gain, in units of the first one, beyond which no fold is looked for."""


def find_any_orbit(servo: Servo, model: Model, *, options: Options) -> HuntingOrbit:
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
    check_times(servo, model)
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
    farther: dict[float, bool | None] = {}
    for gain in gains:
        rigid, farther[gain] = _rigid_cycle(servo, gain, seen)
        if rigid is not None:
            yield from reversed(_climb(servo, gain, rigid.start))
            continue
        for low in (gain / 2, gain):  # where this turns within a factor of two, cycles may be in between
            if farther.get(low) is True and farther.get(2 * low) is False:
                between = _between(servo, low, 2 * low, seen)
                yield from reversed(_climb(servo, *between) if between else [])
    if model != "switch":
        yield from ((gain, None) for gain in gains[:LUGRE_SEARCHES])


def _rigid_cycle(
    servo: Servo, gain: float, seen: list[tuple[float, Scan]]
) -> tuple[HalfCycle | None, bool | None]:
    """(the Switch servo's stable cycle or None; without one: does the motion from a = Fs/kp go farther out?)."""
    unit = servo.friction.static / servo.torque_gains(gain)[0]
    near = near_stable("switch", servo, gain, TYPICAL * unit)
    if near is None:
        scanned = scan("switch", servo, gain)
        near = scanned.upper
        if near is None:
            seen.append((gain, scanned))
    if near is not None:
        return near, None
    try:
        return None, half_cycle("switch", servo, gain, unit).ratio >= 1
    except MarchFailure:
        return None, None


def _between(
    servo: Servo, low: float, high: float, seen: list[tuple[float, Scan]]
) -> tuple[float, float] | None:
    """(gain, stick position) of a cycle between a gain at which motions go farther out and one at which they do not.

    With a loop that is unstable without dry friction, cycles exist from the gain at which large swings stop just short
    of going on for ever to the fold: that range may be narrow.
    """
    for _ in range(HALVINGS):
        gain = float(np.sqrt(low * high))
        rigid, farther = _rigid_cycle(servo, gain, seen)
        if rigid is not None:
            return gain, rigid.start
        if farther is None:
            return None
        low, high = (gain, high) if farther else (low, gain)
    return None


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


def find_fold(
    servo: Servo, model: Model, *, options: Options | None = None, start: HuntingOrbit | None = None
) -> HuntingFold:
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


def _walked_to(first: HuntingOrbit, way: Options, options: Options, began: float) -> HuntingFold:
    """The confirmed fold at the end of a walk from `first` with the tolerance of `way`."""
    before, model = first, first.model
    steps = walk(first, low=first.gain * 1e-3, high=first.gain * HIGHEST, options=way)
    while True:
        effort.at(partial(_on_the_way, before))
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
            if not turns_back(before, after, "gain"):
                break
            try:
                return confirmed(located(before, after, "gain", sharp), "gain", options, began)
            except NoOrbit:
                if finer == FINER[-1]:
                    raise
        before = after


def _on_the_way(orbit: HuntingOrbit) -> str:
    return f"on the way to the fold, at gain {orbit.gain:.6g}"
