"""The unstable Switch cycle inside the stable one, from motions between the two: without a way along the branch.

    y(a) = log P(a)/a:    y(a_s) = 0, falling;    y > 0 next inside;    y < 0 far enough inside

Halving on log a comes close to where y changes sign.  P is steep there, with multipliers of 1e5 and more, and a motion
that comes back to P(a) = a needs as many digits; but one that comes back anywhere differs from the cycle at its end
alone.  It is closed there,

    x1(stick) := a,    T(stick) := (x3(breakaway) - x3(stop))/a,    x3(breakaway) = (Fs - kp a)/ki,

and Newton's method on the boundary value problem does the rest.  What it leads to counts where it lies between the last
two motions; which cycle that is, its multipliers tell.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..errors import NoOrbit
from ..motion.march import MarchFailure, Segment
from ..orbits.adapt import Options, finished, solve_adaptively
from ..orbits.orbit import unknowns_of
from ..orbits.restart import Start
from .cold_start import CAME_TO_REST, started
from .event_map.scan import SCAN_LOW, HalfCycle, half_cycle
from .problem import Hunting, HuntingOrbit, hunting
from .servo import Servo

ONE_STEP_IN = 2.0
"""Factor by which stick positions go inwards until the servo comes to rest nearer."""
CREEPS_AFTER = 4.0
"""Times that the servo moves in the stable cycle, after which it is creeping to rest."""
TOO_STEEP = 1e-8
"""Relative width of the bracket at which the map is too steep, or jumps."""
CLEARLY_UNSTABLE = (2.0, 1e6)
"""Half multipliers at a glance between which no closer look is needed."""
MOST_SOLVED, ACROSS = 3, 4.0
"""Boundary value problems that may fail; the factor by which P(a)/a of the next motion is nearer to one."""


def inner_cycle(servo: Servo, gain: float, outer: float, moving: float, options: Options) -> HuntingOrbit | None:
    """The unstable cycle at the first change of sign of y inside the stable one.

    outer, moving: stick position of the stable cycle [rad], about; time that the servo moves in half of it [s].
    Returns the cycle; None where none was met.
    """
    problem, failed, needed = hunting("switch", servo, gain, half=options.half), 0, CAME_TO_REST
    for inside, outside in _narrowing(servo, gain, outer, CREEPS_AFTER * moving):
        if inside.ratio < needed or inside.segments[-1].mode != "stick":
            continue
        orbit = _solved(problem, inside, options)
        if orbit is not None and inside.start < abs(float(orbit.arcs[0].states[0, 0, 0])) < outside and unstable(orbit):
            return orbit
        failed, needed = failed + 1, needed ** (1 / ACROSS)
        if failed == MOST_SOLVED:
            break
    return None


def _narrowing(servo: Servo, gain: float, outer: float, longest: float) -> Iterator[tuple[HalfCycle, float]]:
    """(motion that comes to rest nearer, stick position of one that does not), ever closer; each motion once."""
    kp, _, _ = servo.torque_gains(gain)
    smallest, high, low = SCAN_LOW * servo.friction.static / kp, outer, 0.0
    while high - low > TOO_STEEP * high:
        a = math.sqrt(low * high) if low else high / ONE_STEP_IN
        if a < smallest:
            return
        try:
            run = half_cycle("switch", servo, gain, a, longest=longest)
        except MarchFailure:
            return
        if run.ratio < 1:
            low = a
            yield run, high
        else:
            high = a


def _solved(problem: Hunting, motion: HalfCycle, options: Options) -> HuntingOrbit | None:
    """The cycle next to a motion that comes to rest elsewhere, by Newton's method; None where that leads to none."""
    began = time.perf_counter()
    closed = _closed(problem, motion, options)
    if closed is None:
        return None
    try:
        solved = solve_adaptively(problem, closed, replace(options, solver="newton"), solver="newton")
        return finished(solved, problem, options, began, "")
    except NoOrbit:
        return None


def _closed(problem: Hunting, motion: HalfCycle, options: Options) -> Start | None:
    """A motion with the stick that would close it; None where that would be over before it begins."""
    degree, kind = options.scheme_of(problem)
    if (degree, kind) != problem.scheme:
        motion = half_cycle("switch", problem.servo, problem.gain, motion.start, degree=degree, kind=kind)
    *slips, stick = motion.segments
    a, x3_stop, x3_breakaway = motion.start, float(slips[-1].end[2]), -float(slips[0].start[2])
    if (duration := (x3_breakaway - x3_stop) / a) <= 0:
        return None
    begins, ends = np.array([a, 0.0, x3_stop]), np.array([a, 0.0, x3_breakaway])
    stick = Segment(stick.mode, stick.event, duration, stick.breaks, begins[None], ends)
    return started(replace(motion, segments=[*slips, stick]), problem, options)


def unstable(orbit: HuntingOrbit) -> bool:
    """Whether the leading half multiplier is larger than one: at a glance, or computed where that leaves a doubt.

    A glance leaves few digits of a large one, and of one beyond them not even its sign.
    """
    with suppress(np.linalg.LinAlgError):
        t, u, setting = unknowns_of(orbit)
        leading = float(t.linearise(u, setting).return_map_eigenvalues().real.max())
        if CLEARLY_UNSTABLE[0] < leading < CLEARLY_UNSTABLE[1]:
            return True
    return orbit.multipliers.leading.real > 1
