"""A hunting cycle at one gain from one motion or a scan of the event map, without following any branch.

    one motion -> mesh from its error estimate -> Newton -> clearly stable? -> Orbit
    where not     event map -> fixed point -> IPOPT -> orbits/adapt.py -> Orbit

The ways stand in three tables: `AT_ONE_GAIN`, to a cycle; `STARTS`, to a motion beside a fixed point of the map;
`SOLVES`, from there to the cycle.  The first, `_at_once`, settles most questions.  What none of them finds is not
thereby shown to be absent: just below a fold two fixed points fit between any two motions of a scan.  find_orbit.py has
the last word, from the fold.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from ..collocation.newton import Solver
from ..collocation.remesh import shape_limit
from ..collocation.scheme import Kind
from ..errors import NoOrbit, Status
from ..motion.march import MarchFailure
from ..orbits.adapt import Options, finished, solve_adaptively
from ..orbits.marched_mesh import remeshed
from ..orbits.restart import Start
from .cycles import SCHEMES
from .event_map.scan import CLOSER, TYPICAL, HalfCycle, Scan, half_cycle, near_stable, near_typical, scan
from .hunting import Model
from .problem import Hunting, HuntingOrbit, hunting
from .sequences import from_half_cycle
from .servo import Servo
from .strategies import Strategy, first_of

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
RINGING, RINGS_OUT = 20, 1e-8
"""Phases of a motion from which it is followed again, to the tolerance that sees a stiff bristle ring out: a coarse one
steps over the last hundred reversals, and equations that start without them have a root that is no motion."""
RINGING_NEARBY = 1.1
"""As NEARBY for such a motion: farther off other reversals are there, and IPOPT takes 20 s over so many equations."""
HARDLY_MOVED, SLOW_MAP = 0.1, 0.5
"""|log P(a)/a| up to which a motion may be far from a cycle that hardly attracts; part of it that is left after another
motion, above which it is, and slope of the map at such a cycle."""
CAME_TO_REST = 0.1
"""P(a)/a below which a motion has come to rest: what starts from there is none."""


@dataclass(frozen=True, eq=False)
class Met:
    """What was met at one gain.

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
    """What the strategies of this module are asked: for the stable cycle at one gain; `start`, for `SOLVES` only;
    `beside`, a motion of the Switch servo beside its cycle where one is known.
    """

    servo: Servo
    model: Model
    gain: float
    options: Options
    start: HalfCycle | None = None
    beside: HalfCycle | None = None

    @property
    def typical(self) -> float:
        """Stick position of most stable cycles [rad]."""
        kp, _, _ = self.servo.torque_gains(self.gain)
        return TYPICAL * self.servo.friction.static / kp


def stable_at(servo: Servo, model: Model, gain: float, *, options: Options) -> Met:
    """The hunting cycle at a gain on the stable side of the fold; close to it the solver can slip over to the other.

    servo, model, gain, options: the problem, checked by `check_problem`, and the method. Returns met; its orbit is None
    where no motion led to one. Raises NoOrbit: one was met, and could not be computed.
    """
    where = f"the stable hunting cycle of the {model} servo at gain {gain:g} was not met"
    return first_of(AT_ONE_GAIN, AtGain(servo, model, gain, options), where)


def quickly_at(
    servo: Servo, model: Model, gain: float, *, options: Options, beside: HalfCycle
) -> HuntingOrbit | None:
    """The stable cycle at a gain where one motion leads to it.

    servo, model, gain, options: as in `stable_at`; beside: a motion of the Switch servo beside its cycle at this gain,
    with the slope of the map.
    Returns the cycle; None where the careful way has to be gone, or where IPOPT is to work alone.
    """
    if options.solver == "ipopt":
        return None
    alone = replace(options, solver="newton")  # where Newton's method is lost, a lower gain costs less than IPOPT here
    met = _at_once(AtGain(servo, model, gain, alone, beside=beside))
    if met is None and model == "switch":
        closer = near_stable(model, servo, gain, beside.fixed, close=CLOSER, slope=beside.slope)
        met = None if closer is None else _at_once(AtGain(servo, model, gain, alone, beside=closer))
    return None if met is None else met.orbit


def unstable_at(servo: Servo, model: Model, gain: float, *, options: Options) -> tuple[HuntingOrbit | None, Scan]:
    """The hunting cycle next to the inner fixed point of the event map.

    servo, model, gain, options: the problem, checked by `check_problem`, and the method.
    Returns (the cycle, None where the scan has no inner fixed point; the scan).
    Raises NoOrbit: the map has the fixed point, but the cycle could not be computed.
    """
    seen = scan(model, servo, gain, want_lower=True)
    if seen.lower is None:
        return None, seen
    return _solved_from(seen.lower, servo, model, gain, options, "the unstable hunting cycle"), seen


def _at_once(q: AtGain) -> Met | None:
    """The stable cycle by Newton from one motion or two that start where most cycles stick, or None.

    The event map is flat at most stable cycles: its values are close to them.  Where they are not, or where the solver
    does not arrive at a clearly stable cycle, the careful way has to be gone.
    """
    began = time.perf_counter()
    problem = hunting(q.model, q.servo, q.gain, half=q.options.half)
    degree, kind = q.options.scheme_of(problem)
    try:
        motion = _first_motion(q, degree, kind)
        if motion is None:
            return None
        first = started(motion, problem, q.options)
        first = first if q.model == "switch" else remeshed(first, q.options)
        solved = solve_adaptively(problem, first, q.options, solver="newton")
        orbit = finished(solved, problem, q.options, began, "")
    except (MarchFailure, NoOrbit):
        return None
    linearisation = solved.solution.linearisation
    leading = np.inf if linearisation is None else float(linearisation.return_map_eigenvalues().real.max())
    return Met(orbit, leading < 1 + CLEARLY_STABLE, None) if leading < 1 else None


def _beside_the_fixed_point(q: AtGain) -> Met | None:
    """`_at_once` from a motion to which a few secant steps on the event map lead."""
    rigid = _rigid_cycle(q)
    alone = replace(q.options, solver="newton")  # where Newton's method is lost, the event map is asked before IPOPT
    return None if rigid is None else _at_once(replace(q, options=alone, beside=rigid))


def _first_motion(q: AtGain, degree: int, kind: Kind) -> HalfCycle | None:
    """A motion so close to the stable cycle that Newton is tried, or None."""
    if q.beside is not None and q.model == "switch" and (degree, kind) == SCHEMES["switch"]:
        return q.beside
    a = q.typical if q.beside is None else q.beside.fixed
    if q.model == "lugre":
        if q.beside is not None and 1 + q.beside.slope > SLOW_MAP:
            return _slowly_met(q, q.beside, degree, kind)
        a = _beside_the_rigid_cycle(q) if q.beside is None else OUTSIDE * a
    for _ in range(FIRST_MOTIONS):
        if a <= 0:
            return None
        motion = half_cycle(q.model, q.servo, q.gain, a, degree=degree, kind=kind)
        a = motion.position if motion.ratio > CAME_TO_REST else 0.0
        nearby = RINGING_NEARBY if _rings(motion) else NEARBY[q.model]
        if 1 / nearby < motion.ratio < nearby:
            return motion
    return None


def _beside_the_rigid_cycle(q: AtGain) -> float:
    """A stick position of the Switch servo next to its cycle, from which a LuGre motion starts; 0 where none is met."""
    motion = half_cycle("switch", q.servo, q.gain, q.typical)
    if 1 / FLAT < motion.ratio < FLAT and not _hardly_moves(q, motion):
        return motion.position
    rigid = _rigid_cycle(q)
    return OUTSIDE * rigid.start if rigid is not None else 0.0


def _hardly_moves(q: AtGain, motion: HalfCycle) -> bool:
    """Whether a motion of the Switch servo leads next to where it started, and the next one no closer to a cycle."""
    excess = abs(math.log(motion.ratio))
    if excess > HARDLY_MOVED:
        return False
    following = half_cycle("switch", q.servo, q.gain, motion.position)
    return not following.ratio > 0 or abs(math.log(following.ratio)) > SLOW_MAP * excess


def _slowly_met(q: AtGain, rigid: HalfCycle, degree: int, kind: Kind) -> HalfCycle | None:
    """A LuGre motion beside a cycle to which motions come slowly, by secants from the Switch servo's, or None."""
    near = near_stable(q.model, q.servo, q.gain, rigid.fixed, slope=rigid.slope)
    if near is None or (degree, kind) == SCHEMES[q.model]:
        return near
    return half_cycle(q.model, q.servo, q.gain, near.start, degree=degree, kind=kind)


def _rigid_cycle(q: AtGain) -> HalfCycle | None:
    """A motion of the Switch servo close to its stable cycle, by a few secant steps, or None."""
    inwards = near_stable("switch", q.servo, q.gain, INWARDS * q.typical)
    return inwards if inwards is not None else near_typical(q.servo, q.gain)


def _by_the_map(q: AtGain) -> Met:
    """The cycle next to a stable fixed point of the event map; without one, what was seen."""
    start, seen = first_of(STARTS, q, "")
    if start is None:
        return Met(None, False, seen)
    # How P/a falls at the start does not tell where the solver has gone from there: next to a fold, to the other side.
    what = f"the stable hunting cycle of the {q.model} servo at gain {q.gain:g} was not computed"
    return Met(first_of(SOLVES, replace(q, start=start), what), False, seen)


Begun = tuple[HalfCycle | None, Scan | None]
"""(a half cycle close to the stable orbit or None, the scan where one was made)."""


def _a_few_motions(q: AtGain) -> Begun | None:
    """Most stable cycles have a stick position of about 0.1 Fs/kp, and a few secant steps from there find them."""
    start = _rigid_cycle(q)
    return (start, None) if start is not None else None


def _beside_the_switch_cycle(q: AtGain) -> Begun | None:
    """The LuGre cycle lies close to the Switch cycle, whose map costs a tenth."""
    rigid = _rigid_cycle(q) or scan("switch", q.servo, q.gain).upper
    start = near_stable(q.model, q.servo, q.gain, rigid.start) if rigid is not None else None
    return (start, None) if start is not None else None


def _whole_range(q: AtGain) -> Begun:
    seen = scan(q.model, q.servo, q.gain)
    return seen.upper, seen


def _solved_there(q: AtGain) -> HuntingOrbit:
    assert q.start is not None
    return _solved_from(q.start, q.servo, q.model, q.gain, q.options, "the stable hunting cycle")


def _solved_closer(q: AtGain) -> HuntingOrbit | None:
    assert q.start is not None
    closer = near_stable(q.model, q.servo, q.gain, q.start.start, close=CLOSER)
    return None if closer is None else _solved_there(replace(q, start=closer))


AT_ONE_GAIN = (
    Strategy(
        "one motion from where most cycles stick", "IPOPT is not to work alone", "5 ms; LuGre 30 ms",
        _at_once, lambda q: q.options.solver != "ipopt",
    ),
    Strategy(
        "a few motions to where this one sticks", "Switch, and IPOPT is not to work alone", "8 ms",
        _beside_the_fixed_point, lambda q: q.model == "switch" and q.options.solver != "ipopt",
    ),
    Strategy("the event map", "always", "30 ms, scanned 0.3 s; LuGre 0.2 s, scanned 5 s", _by_the_map),
)  # fmt: skip
STARTS = (
    Strategy("a few motions", "Switch", "5 ms", _a_few_motions, lambda q: q.model == "switch"),
    Strategy(
        "a few motions beside the Switch cycle", "LuGre", "0.1 s", _beside_the_switch_cycle,
        lambda q: q.model == "lugre",
    ),
    Strategy("a scan of all stick positions", "always", "0.3 s; LuGre 5 s", _whole_range),
)  # fmt: skip
SOLVES = (
    Strategy("from a motion beside the fixed point", "always", "20 ms; LuGre 0.1 s", _solved_there),
    Strategy("from a motion still closer to it", "there is one", "30 ms; LuGre 0.2 s", _solved_closer),
)


def _solved_from(
    start: HalfCycle, servo: Servo, model: Model, gain: float, options: Options, what: str
) -> HuntingOrbit:
    began = time.perf_counter()
    problem = hunting(model, servo, gain, half=options.half)
    degree, kind = options.scheme_of(problem)
    if (degree, kind) != problem.scheme:
        start = half_cycle(model, servo, gain, start.start, degree=degree, kind=kind)
    first: Solver = "newton" if _rings(start) else "ipopt"
    solver = first if options.solver == "auto" else options.solver
    solved = solve_adaptively(problem, started(start, problem, options), options, solver=solver)
    return finished(solved, problem, options, began, what)


def _rings(motion: HalfCycle) -> bool:
    return len(motion.segments) > RINGING


def started(motion: HalfCycle, problem: Hunting, options: Options) -> Start:
    """A motion as the starting point of the boundary value problem.

    motion, problem, options: half a cycle, of the problem at its gain, in the scheme of the options; their tolerance
    chooses the intervals of what was followed along series. Returns transcription, unknowns, setting. Raises NoOrbit:
    the motion comes to rest.
    """
    if motion.segments[-1].event == "":  # next to a jump of the map the motion may do that on another mesh
        raise NoOrbit(
            f"the hunting cycle of {problem.title} at gain {problem.gain:g} was not computed: the motion from the "
            f"stick position {motion.start:.6g} rad, next to it on the event map, comes to rest; the map jumps there",
            Status.NOT_CONVERGED,
        )
    degree, kind = options.scheme_of(problem)
    if _rings(motion):
        motion = half_cycle(
            problem.model, problem.servo, problem.gain, motion.start, tol=RINGS_OUT, degree=degree, kind=kind
        )
    segments = [segment.meshed(shape_limit(options.tol)) for segment in motion.segments]
    return from_half_cycle(
        problem.model, segments, problem.vector(), problem.direction(problem.principal),
        degree=degree, kind=kind, half=options.half,
    )  # fmt: skip
