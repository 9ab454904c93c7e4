"""The hunting cycles at one gain from motions, without following any branch.

    stable      one motion -> mesh from its error estimate -> Newton -> clearly stable? -> Orbit
                a few motions to the fixed point of the event map, or a scan of it -> Newton, or IPOPT -> Orbit
    unstable    motions between it and the stable one -> closed where they come back -> Newton -> Orbit

One motion settles most questions away from a fold, a scan those next to it.  What none of them finds is not thereby
shown to be absent: just below a fold two fixed points fit between any two motions of a scan.  find_orbit.py has the
last word, from the fold.

The unstable Switch cycle inside the stable one.

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
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ..axis_units import quantity
from ..errors import NoOrbit, Status
from ..motion import MarchFailure, Segment
from ..orbits import Options, orbit_from_motion
from .event_map.half_cycle import HalfCycle, StickMap
from .event_map.scan import SCAN_LOW, Scan, scan
from .event_map.secant_search import CLOSER, near_stable, near_typical
from .friction import Model
from .problem import SCHEMES, Hunting, HuntingOrbit, Kind, hunting, mirrored
from .servo import Servo

CLEARLY_STABLE = -0.8
"""Slope of log(P/a) against log a below which a fixed point is the stable one beyond doubt (0 at the fold)."""
NEARBY, FIRST_MOTIONS = {"switch": 3.0, "lugre": 1.25}, 2
"""Ratios P(a)/a, or their inverses, up to which Newton is tried at once; motions computed to come so close."""
FLAT = 1.5
"""The same up to which the Switch servo's next stick position is close enough to its cycle for a LuGre motion."""
INWARDS = 0.7
"""Part of the typical stick position from which the Switch cycle is sought first where that is not so: next to the fold
cycles may stick nearer."""
OUTSIDE = 1.05
"""A LuGre motion starts by this factor outside the Switch cycle, whence it comes in as long as there is a cycle: the
unstable LuGre cycle, inside which motions creep to rest for hundreds of intervals, lies farther out than the rigid."""
CLOSELY = 1e-8
"""Tolerance of a motion whose mesh is to show all that the equations need."""
RINGING = 20
"""Phases of a motion from which it is followed again, to the tolerance that sees a stiff bristle ring out: a coarse one
steps over the last hundred reversals, and equations that start without them have a root that is no motion."""
RINGING_NEARBY = 1.1
"""As NEARBY for such a motion: farther off other reversals are there, and IPOPT takes 20 s over so many equations."""
HARDLY_MOVED, SLOW_MAP = 0.1, 0.5
"""|log P(a)/a| up to which a motion may be far from a cycle that hardly attracts; part of it that is left after another
motion, above which it is, and slope of the map at such a cycle."""
SWINGS_TO_SETTLE = 10
"""Of a LuGre motion whose bristle is not at rest between them: some milliseconds each."""
CAME_TO_REST = 0.1
"""P(a)/a below which a motion has come to rest: what starts from there is none."""


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


@dataclass(frozen=True, eq=False)
class AtOneGain:
    """What was found at one gain.

    Attributes
    ----------
    orbit : the cycle, or None where no motion led to one.
    clearly_stable : it is the stable one beyond doubt; otherwise its multiplier has to tell.
    seen : the scan, where one was made.
    """

    orbit: HuntingOrbit | None
    clearly_stable: bool
    seen: Scan | None


@dataclass(frozen=True, eq=False)
class AtGain:
    """A search for the stable cycle at one gain; `beside`, a motion of the Switch servo beside its cycle if known; and
    `start`, about where the cycle sticks [rad], 0 where nobody knows."""

    P: StickMap
    options: Options
    beside: HalfCycle | None = None
    start: float = 0.0

    @property
    def newton(self) -> bool:
        """Whether Newton's method may be tried: IPOPT is not to work alone."""
        return self.options.solver != "ipopt"

    @cached_property
    def problem(self) -> Hunting:
        """The boundary value problem."""
        return hunting(self.P.model, self.P.servo, self.P.gain, half=self.options.half)

    @cached_property
    def rigid_cycle(self) -> HalfCycle | None:
        """A motion of the Switch servo close to its stable cycle, by a few secant steps, or None."""
        rigid = self.P.rigid
        inwards = near_stable(rigid, INWARDS * rigid.typical)
        return inwards if inwards is not None else near_typical(rigid)


def stable_at(servo: Servo, model: Model, gain: float, *, options: Options) -> AtOneGain:
    """The hunting cycle at a gain on the stable side of the fold; close to it the solver can slip over to the other.

    servo, model, gain, options: the problem, checked by `check_problem`, and the method. Returns met; its orbit is None
    where no motion led to one. Raises NoOrbit: one was found, and could not be computed.
    """
    q = AtGain(StickMap(model, servo, gain), options)
    met = _at_once(q) if q.newton else None
    if met is None and q.newton and model == "switch" and (near := q.rigid_cycle) is not None:
        # The fixed point itself, closely followed: where a slip begins within microseconds a per cent beside it is too
        # far, and so is a coarse mesh.  Where Newton's method is lost from there too, a scan costs less than IPOPT.
        near = near_stable(q.P, near.fixed, close=CLOSER, slope=near.slope) or near
        with suppress(MarchFailure):
            near = replace(q.P(near.fixed, tol=CLOSELY), slope=near.slope)
        met = _at_once(replace(q, options=replace(options, solver="newton"), beside=near))
    if met is not None:
        return met
    # A motion close to a stable fixed point of the event map: the LuGre cycle lies close to the Switch cycle, whose map
    # costs a tenth.  Where none is seen so, a scan looks everywhere.
    start, seen = q.rigid_cycle, None
    if q.P.model == "lugre":
        start = start or scan(q.P.rigid).upper
        start = near_stable(q.P, start.start) if start is not None else None
    if start is None:
        seen = scan(q.P)
        start = seen.upper
    # How P/a falls at the start does not tell where the solver has gone from there: next to a fold, to the other side.
    return AtOneGain(None if start is None else _solved_from(start, q), False, seen)


def quickly_at(
    servo: Servo, model: Model, gain: float, *, options: Options, beside: HalfCycle | None = None, start: float = 0.0
) -> HuntingOrbit | None:
    """The stable cycle at a gain where one motion leads to it.

    servo, model, gain, options: as in `stable_at`; beside: a motion of the Switch servo beside its cycle at this gain,
    with the slope of the map, where one is known; start: about where the cycle sticks [rad], where that is known.
    Returns the cycle; None where the careful way has to be gone, or where IPOPT is to work alone.
    """
    # Where Newton's method is lost, a lower gain costs less than IPOPT here.
    q = AtGain(StickMap(model, servo, gain), replace(options, solver="newton"), beside)
    if options.solver == "ipopt":
        return None
    met = _at_once(replace(q, start=start)) if start else None
    if met is None:
        met = _at_once(q)
    if met is None and model == "switch":
        closer = q.rigid_cycle
        if beside is not None:
            closer = near_stable(q.P, beside.fixed, close=CLOSER, slope=beside.slope)
        met = None if closer is None else _at_once(replace(q, beside=closer))
    return None if met is None else met.orbit


def _at_once(q: AtGain) -> AtOneGain | None:
    """The stable cycle by Newton from one motion or two that start where most cycles stick, or None.

    The event map is flat at most stable cycles: its values are close to them.  Where they are not, or where the solver
    does not arrive at a clearly stable cycle, the careful way has to be gone.  A LuGre motion from which Newton is lost
    is followed on: its bristle may still move when the next swing begins.
    """
    problem = q.problem
    degree, kind = q.options.scheme_of(problem)

    def closed(motion: HalfCycle) -> HuntingOrbit:
        phases = phases_of(motion, problem, q.options)
        found: HuntingOrbit = orbit_from_motion(problem, *phases, q.options, remesh=q.P.model != "switch")
        return found

    try:
        motion = _first_motion(q, degree, kind)
        if motion is None:
            return None
        try:
            orbit = closed(motion)
        except NoOrbit:
            if q.P.model == "switch":
                return None
            orbit = closed(replace(q.P, swings=SWINGS_TO_SETTLE)(motion.start, degree=degree, kind=kind))
    except (MarchFailure, NoOrbit):
        return None
    leading = orbit.provisional_multiplier
    return AtOneGain(orbit, leading < 1 + CLEARLY_STABLE, None) if leading < 1 else None


def _first_motion(q: AtGain, degree: int, kind: Kind) -> HalfCycle | None:
    """A motion so close to the stable cycle that Newton is tried, or None."""
    if q.beside is not None and q.P.model == "switch" and (degree, kind) == SCHEMES["switch"]:
        return q.beside
    a = q.start or (q.P.typical if q.beside is None else q.beside.fixed)
    if q.P.model == "lugre" and not q.start:
        if q.beside is not None and 1 + q.beside.slope > SLOW_MAP:
            # A LuGre motion beside a cycle to which motions come slowly, by secants from the Switch servo's, or None
            near = near_stable(q.P, q.beside.fixed, slope=q.beside.slope)
            if near is None or (degree, kind) == SCHEMES[q.P.model]:
                return near
            return q.P(near.start, degree=degree, kind=kind)
        a = _beside_the_rigid_cycle(q) if q.beside is None else OUTSIDE * a
    for _ in range(FIRST_MOTIONS):
        if a <= 0:
            return None
        motion = q.P(a, degree=degree, kind=kind)
        a = motion.position if motion.ratio > CAME_TO_REST else 0.0
        nearby = RINGING_NEARBY if _rings(motion) else NEARBY[q.P.model]
        if 1 / nearby < motion.ratio < nearby:
            return motion
    return None


def _beside_the_rigid_cycle(q: AtGain) -> float:
    """A stick position of the Switch servo next to its cycle, from which a LuGre motion starts; 0 where none is met."""
    motion = q.P.rigid(q.P.typical)
    if 1 / FLAT < motion.ratio < FLAT and not _hardly_moves(q, motion):
        return motion.position
    return OUTSIDE * q.rigid_cycle.start if q.rigid_cycle is not None else 0.0


def _hardly_moves(q: AtGain, motion: HalfCycle) -> bool:
    """Whether a motion of the Switch servo leads next to where it started, and the next one no closer to a cycle."""
    excess = abs(math.log(motion.ratio))
    if excess > HARDLY_MOVED:
        return False
    following = q.P.rigid(motion.position)
    return not following.ratio > 0 or abs(math.log(following.ratio)) > SLOW_MAP * excess


def _solved_from(start: HalfCycle, q: AtGain) -> HuntingOrbit:
    """The cycle next to a motion; NoOrbit where it is not computed."""
    problem = q.problem
    degree, kind = q.options.scheme_of(problem)
    if (degree, kind) != problem.scheme:
        start = q.P(start.start, degree=degree, kind=kind)
    phases, what = phases_of(start, problem, q.options), "the stable hunting cycle"
    solver: Literal["newton", "ipopt"] = "newton" if _rings(start) else "ipopt"
    orbit: HuntingOrbit = orbit_from_motion(problem, *phases, q.options, solver=solver, what=what)
    return orbit


def _rings(motion: HalfCycle) -> bool:
    return len(motion.segments) > RINGING


Phases = tuple[tuple[tuple[str, str], ...], list[tuple[float, Segment]]]
"""((mode, event) of each phase of a cycle, (factor, segment): its states are so many times those of the segment)."""


def phases_of(motion: HalfCycle, problem: Hunting, options: Options) -> Phases:
    """The phases of a cycle as a motion has them.

    motion, problem, options: half a cycle, of the problem at its gain, in the scheme of the options. Raises NoOrbit:
    the motion comes to rest.
    """
    if motion.segments[-1].event == "":  # next to a jump of the map the motion may do that on another mesh
        raise NoOrbit(
            f"the hunting cycle of {problem.title} at gain {problem.gain:g} was not computed: the motion from the "
            f"stick position {quantity(motion.start, 'rad', '.6g')}, next to it on the event map, comes to rest; the "
            "map jumps there",
            Status.NOT_CONVERGED,
        )
    degree, kind = options.scheme_of(problem)
    if _rings(motion):
        P = StickMap(problem.model, problem.servo, problem.gain, motion.swings)
        motion = P(motion.start, tol=CLOSELY, degree=degree, kind=kind)
    segments = motion.segments
    signature, sign = tuple((s.mode, s.event) for s in segments), 1.0
    if segments[0].mode.endswith("-"):  # every cycle begins with the positive slip
        signature, sign = mirrored(signature), -1.0
    whole = signature if options.half else signature + mirrored(signature)
    factors = (sign,) if options.half else (sign, -sign)
    return whole, [(factor, segment) for factor in factors for segment in segments]


def inner_cycle(P: StickMap, outer: float, moving: float, options: Options) -> HuntingOrbit | None:
    """The unstable cycle at the first change of sign of y inside the stable one.

    outer, moving: stick position of the stable cycle [rad], about; time that the servo moves in half of it [s].
    Returns the cycle; None where none was found.
    """
    problem, failed, needed = hunting("switch", P.servo, P.gain, half=options.half), 0, CAME_TO_REST
    for inside, outside in _narrowing(P, outer, CREEPS_AFTER * moving):
        if inside.ratio < needed or inside.segments[-1].mode != "stick":
            continue
        orbit = _solved(problem, inside, options)
        if orbit is not None and inside.start < abs(float(orbit.arcs[0].states[0, 0, 0])) < outside and unstable(orbit):
            return orbit
        failed, needed = failed + 1, needed ** (1 / ACROSS)
        if failed == MOST_SOLVED:
            break
    return None


def _narrowing(P: StickMap, outer: float, longest: float) -> Iterator[tuple[HalfCycle, float]]:
    """(motion that comes to rest nearer, stick position of one that does not), ever closer; each motion once."""
    smallest, high, low = SCAN_LOW * P.unit, outer, 0.0
    while high - low > TOO_STEEP * high:
        a = math.sqrt(low * high) if low else high / ONE_STEP_IN
        if a < smallest:
            return
        try:
            run = P(a, longest=longest)
        except MarchFailure:
            return
        if run.ratio < 1:
            low = a
            yield run, high
        else:
            high = a


def _solved(problem: Hunting, motion: HalfCycle, options: Options) -> HuntingOrbit | None:
    """The cycle next to a motion that comes to rest elsewhere, by Newton's method; None where that leads to none."""
    closed = _closed(problem, motion, options)
    if closed is None:
        return None
    orbit: HuntingOrbit | None = None
    with suppress(NoOrbit):
        orbit = orbit_from_motion(problem, *closed, replace(options, solver="newton"))
    return orbit


def _closed(problem: Hunting, motion: HalfCycle, options: Options) -> Phases | None:
    """A motion with the stick that would close it; None where that would be over before it begins."""
    degree, kind = options.scheme_of(problem)
    if (degree, kind) != problem.scheme:
        motion = StickMap("switch", problem.servo, problem.gain)(motion.start, degree=degree, kind=kind)
    *slips, stick = motion.segments
    a, x3_stop, x3_breakaway = motion.start, float(slips[-1].end[2]), -float(slips[0].start[2])
    if (duration := (x3_breakaway - x3_stop) / a) <= 0:
        return None
    begins, ends = np.array([a, 0.0, x3_stop]), np.array([a, 0.0, x3_breakaway])
    stick = Segment(stick.mode, stick.event, duration, stick.breaks, begins[None], ends)
    return phases_of(replace(motion, segments=[*slips, stick]), problem, options)


def unstable(orbit: HuntingOrbit) -> bool:
    """Whether the leading half multiplier is larger than one: at a glance, or computed where that leaves a doubt.

    A glance leaves few digits of a large one, and of one beyond them not even its sign.
    """
    if CLEARLY_UNSTABLE[0] < orbit.provisional_multiplier < CLEARLY_UNSTABLE[1]:
        return True
    return orbit.multipliers.leading.real > 1
