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
NEARBY = {"switch": 3.0, "lugre": 1.25}
"""Ratios P(a)/a, or their inverses, up to which Newton is tried at once."""
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
SLOW_MAP = 0.5
"""Slope of the map at a cycle that hardly attracts: P(a)/a is next to one far from it, too."""
SWINGS_TO_SETTLE = 10
"""Of a LuGre motion whose bristle is not at rest between them: some milliseconds each."""
ONE_STEP_IN = 2.0
"""Factor by which stick positions go inwards until the servo comes to rest nearer."""
CREEPS_AFTER = 4.0
"""Times that the servo moves in the stable cycle, after which it is creeping to rest."""
TOO_STEEP = 1e-8
"""Relative width of the bracket at which the map is too steep, or jumps."""
CLEARLY_UNSTABLE = (2.0, 1e6)
"""Half multipliers at a glance between which no closer look is needed."""
BESIDE_AN_UNSTABLE_ONE = 0.9
"""P(a)/a from which a motion that comes to rest nearer is closed."""


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

    @cached_property
    def problem(self) -> Hunting:
        """The boundary value problem."""
        return hunting(self.P.model, self.P.servo, self.P.gain, half=self.options.half)

    @cached_property
    def rigid_cycle(self) -> HalfCycle | None:
        """A motion of the Switch servo close to its stable cycle, or None.

        By a few secant steps; where a bristle is sought beside it, by a scan too, which costs as much as one motion of
        that.
        """
        near = near_typical(self.P.rigid)
        return near if near is not None or self.P.model == "switch" else scan(self.P.rigid).upper


def stable_at(servo: Servo, model: Model, gain: float, *, options: Options) -> AtOneGain:
    """The hunting cycle at a gain on the stable side of the fold; close to it the solver can slip over to the other.

    servo, model, gain, options: the problem, checked by `check_problem`, and the method. Returns met; its orbit is None
    where no motion led to one. Raises NoOrbit: one was found, and could not be computed.
    """
    q = AtGain(StickMap(model, servo, gain), options)
    met = _by_newton(q)
    if met is not None:
        return met
    # A motion close to a stable fixed point of the event map: the LuGre cycle lies close to the Switch cycle, whose map
    # costs a tenth.  Where none is seen so, a scan looks everywhere.
    start, seen = q.rigid_cycle, None
    if start is not None and q.P.model == "lugre":
        start = near_stable(q.P, start.start)
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
    met = _by_newton(AtGain(StickMap(model, servo, gain), options, beside, start))
    return None if met is None else met.orbit


def _by_newton(q: AtGain) -> AtOneGain | None:
    """The stable cycle by Newton's method alone: where that is lost, a scan or a lower gain costs less than IPOPT."""
    if q.options.solver == "ipopt":
        return None
    met = _at_once(q)
    if met is None and q.start:
        q = replace(q, start=0.0)
        met = _at_once(q)
    if met is not None or q.P.model != "switch" or (near := q.beside or q.rigid_cycle) is None:
        return met
    # The fixed point itself, closely followed: where a slip begins within microseconds, as that of Table 1 with an
    # inertia of 1e-6 kg m2 does, a per cent beside it is too far, and so is a coarse mesh.
    near = near_stable(q.P, near.fixed, close=CLOSER, slope=near.slope) or near
    with suppress(MarchFailure):
        near = replace(q.P(near.fixed, tol=CLOSELY), slope=near.slope)
    return _at_once(replace(q, beside=near))


def _at_once(q: AtGain) -> AtOneGain | None:
    """The stable cycle by Newton from a motion that starts where most cycles stick, or None.

    The event map is flat at most stable cycles: its values are close to them.  Where they are not, or where the solver
    does not arrive at a clearly stable cycle, the careful way has to be gone.  A LuGre motion from which Newton is lost
    is followed on: its bristle may still move when the next swing begins.
    """
    problem, options = q.problem, replace(q.options, solver="newton")
    degree, kind = options.scheme_of(problem)

    def closed(motion: HalfCycle) -> HuntingOrbit:
        phases = phases_of(motion, problem, options)
        found: HuntingOrbit = orbit_from_motion(problem, *phases, options, remesh=q.P.model != "switch")
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
        rigid = q.beside or q.rigid_cycle
        if rigid is None:
            return None
        if 1 + rigid.slope > SLOW_MAP:
            # A LuGre motion beside a cycle to which motions come slowly, by secants from the Switch servo's, or None
            near = near_stable(q.P, rigid.fixed, slope=rigid.slope)
            if near is None or (degree, kind) == SCHEMES[q.P.model]:
                return near
            return q.P(near.start, degree=degree, kind=kind)
        a = OUTSIDE * rigid.fixed
    motion = q.P(a, degree=degree, kind=kind)
    nearby = RINGING_NEARBY if _rings(motion) else NEARBY[q.P.model]
    return motion if 1 / nearby < motion.ratio < nearby else None


def _solved_from(start: HalfCycle, q: AtGain) -> HuntingOrbit:
    """The cycle next to a motion; NoOrbit where it is not computed."""
    problem = q.problem
    degree, kind = q.options.scheme_of(problem)
    if (degree, kind) != problem.scheme:
        start = q.P(start.start, degree=degree, kind=kind)
    phases, what = phases_of(start, problem, q.options), "the stable hunting cycle"
    orbit: HuntingOrbit = orbit_from_motion(problem, *phases, q.options, what=what)
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
    problem = hunting("switch", P.servo, P.gain, half=options.half)
    for inside, outside in _narrowing(P, outer, CREEPS_AFTER * moving):
        if inside.ratio > BESIDE_AN_UNSTABLE_ONE and inside.segments[-1].mode == "stick":
            orbit = _solved(problem, inside, options)
            if orbit is None or not inside.start < abs(float(orbit.arcs[0].states[0, 0, 0])) < outside:
                return None
            return orbit if unstable(orbit) else None
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
