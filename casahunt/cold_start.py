"""A hunting cycle at one gain from one motion or a scan of the event map, without following any branch.

    one motion -> mesh from its error estimate -> Newton -> clearly stable? -> Orbit
    where not     event map -> fixed point -> IPOPT -> adapt.py -> Orbit

The short way, `_at_once`, settles most questions.  What neither way finds is not thereby shown to be absent: just below
a fold two fixed points fit between any two motions of a scan.  find.py has the last word, from the fold.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from .adapt import Options, Solved, remeshed, solve_adaptively
from .checks import COMPUTED, known, sensible
from .errors import NoOrbit, Status
from .event_map import CLOSER, TYPICAL, HalfCycle, Scan, half_cycle, near_stable, scan
from .hunting import MODELS, SCHEMES, Model
from .march import MarchFailure
from .orbit import Orbit, direction_of, orbit_of, unknowns_of
from .resequence import Start, from_segments
from .servo import Servo
from .solve import Solver

CLEARLY_STABLE = -0.8
"""Slope of log(P/a) against log a below which a fixed point is the stable one beyond doubt (0 at the fold)."""
NEARBY, FIRST_MOTIONS = {"switch": 3.0, "lugre": 1.25}, 2
"""Ratios P(a)/a, or their inverses, up to which Newton is tried at once; motions computed to come so close."""


def starting_half_cycle(servo: Servo, model: Model, gain: float) -> tuple[HalfCycle | None, Scan | None]:
    """(a half cycle close to the stable orbit or None, the scan where one was made).

    Most stable cycles have a stick position of about 0.1 Fs/kp, and a few secant steps from there find them; the
    LuGre cycle lies close to the Switch cycle, whose map costs a tenth.  Where these short cuts do not lead to a
    stable fixed point, the whole range is scanned.
    """
    kp, _, _ = servo.torque_gains(gain)
    rigid = near_stable("switch", servo, gain, TYPICAL * servo.friction.static / kp)
    if model == "switch" and rigid is not None:
        return rigid, None
    if model == "lugre":
        rigid = rigid or scan("switch", servo, gain).upper
        if rigid is not None:
            start = near_stable(model, servo, gain, rigid.start)
            if start is not None:
                return start, None
    seen = scan(model, servo, gain)
    return seen.upper, seen


@dataclass(frozen=True, eq=False)
class Met:
    """What was met at one gain.

    Attributes
    ----------
    orbit : the cycle, or None where no motion led to one.
    clearly_stable : it is the stable one beyond doubt; otherwise its multiplier has to tell.
    seen : the scan, where one was made.
    """

    orbit: Orbit | None
    clearly_stable: bool
    seen: Scan | None


def stable_at(servo: Servo, model: Model, gain: float, *, options: Options) -> Met:
    """The hunting cycle at a gain on the stable side of the fold; close to it the solver can slip over to the other.

    Parameters
    ----------
    servo, model, gain, options
        the problem, checked by `check_problem`, and the method.

    Raises
    ------
    NoOrbit : one was met, and could not be computed.
    """
    at_once = _at_once(servo, model, gain, options)
    if at_once is not None:
        return Met(at_once, True, None)
    start, seen = starting_half_cycle(servo, model, gain)
    if start is None:
        return Met(None, False, seen)
    what = "the stable hunting cycle"
    try:
        orbit = _solved_from(start, servo, model, gain, options, what)
    except NoOrbit:
        closer = near_stable(model, servo, gain, start.start, close=CLOSER)
        if closer is None:
            raise
        orbit = _solved_from(closer, servo, model, gain, options, what)
    # How P/a falls at the start does not tell where the solver has gone from there: next to a fold, to the other side.
    return Met(orbit, False, seen)


def unstable_at(servo: Servo, model: Model, gain: float, *, options: Options) -> tuple[Orbit | None, Scan]:
    """(the cycle next to the inner fixed point of the event map or None, the scan); arguments as `stable_at`."""
    seen = scan(model, servo, gain, want_lower=True)
    if seen.lower is None:
        return None, seen
    return _solved_from(seen.lower, servo, model, gain, options, "the unstable hunting cycle"), seen


def _at_once(servo: Servo, model: Model, gain: float, options: Options) -> Orbit | None:
    """The stable cycle by Newton from one motion or two that start where most cycles stick, or None.

    The event map is flat at most stable cycles: its values are close to them.  Where they are not, or where the solver
    does not arrive at a clearly stable cycle, the careful way has to be gone.
    """
    if options.solver == "ipopt":
        return None
    began = time.perf_counter()
    degree, kind = options.scheme_of(model)
    kp, _, _ = servo.torque_gains(gain)
    a = TYPICAL * servo.friction.static / kp
    try:
        if model == "lugre":
            a = half_cycle("switch", servo, gain, a).position
        for _ in range(FIRST_MOTIONS):
            if a <= 0:
                return None
            motion = half_cycle(model, servo, gain, a, degree=degree, kind=kind)
            a = motion.position
            if 1 / NEARBY[model] < motion.ratio < NEARBY[model]:
                break
        else:
            return None
        first = remeshed(_start(motion, servo, model, gain, options), options)
        solved = solve_adaptively(model, first, options, solver="newton")
        orbit = finished(solved, model, servo, gain, options, began, "")
    except (MarchFailure, NoOrbit):
        return None
    linearisation = solved.solution.linearisation
    if linearisation is None or not linearisation.return_map_eigenvalues().real.max() < 1 + CLEARLY_STABLE:
        return None
    return orbit


def _solved_from(
    start: HalfCycle, servo: Servo, model: Model, gain: float, options: Options, what: str
) -> Orbit:
    began = time.perf_counter()
    degree, kind = options.scheme_of(model)
    if (degree, kind) != SCHEMES[model]:
        start = half_cycle(model, servo, gain, start.start, degree=degree, kind=kind)
    solver: Solver = "ipopt" if options.solver == "auto" else options.solver
    solved = solve_adaptively(model, _start(start, servo, model, gain, options), options, solver=solver)
    return finished(solved, model, servo, gain, options, began, what)


def _start(motion: HalfCycle, servo: Servo, model: Model, gain: float, options: Options) -> Start:
    """A motion as the starting point of the boundary value problem."""
    if motion.segments[-1].event == "":  # next to a jump of the map the motion may do that on another mesh
        raise NoOrbit(
            f"the hunting cycle of the {model} servo at gain {gain:g} was not computed: the motion from the stick "
            f"position {motion.start:.6g} rad, next to it on the event map, comes to rest; the map jumps there",
            Status.NOT_CONVERGED,
        )
    degree, kind = options.scheme_of(model)
    return from_segments(
        model, motion.segments, servo.parameters(gain), direction_of("gain"),
        degree=degree, kind=kind, half=options.half,
    )  # fmt: skip


def refined(orbit: Orbit, options: Options) -> Orbit:
    """The same orbit to another tolerance."""
    began = time.perf_counter()
    solved = solve_adaptively(orbit.model, unknowns_of(orbit), options, solver="newton")
    return finished(solved, orbit.model, orbit.servo, orbit.gain, options, began, "the hunting cycle")


def check_problem(servo: Servo, model: Model, gain: float) -> None:
    """Raise InputError for an unknown model or a gain not positive, NoOrbit with a scan for pure Coulomb friction."""
    known("model", model, MODELS)
    sensible("gain", gain, power=COMPUTED)
    if servo.friction.static == servo.friction.coulomb:
        seen = scan(model, servo, gain)
        raise NoOrbit(
            f"no hunting limit cycle of the {model} servo at any gain: static equals Coulomb friction, and without a "
            "drop in the friction curve the integral action cannot sustain an oscillation (Bisoffi et al.); at gain "
            f"{gain:g}, {seen.sentence()}"
        )


def finished(
    solved: Solved, model: Model, servo: Servo, gain: float, options: Options, began: float, what: str
) -> Orbit:
    """The Orbit of a converged `Solved`, or NoOrbit with the advice."""
    if not solved.status.ok or solved.estimate is None:
        alone = "" if options.solver == "auto" else f"; {options.solver} worked alone, the solver auto tries both"
        sentence = f"{what} of the {model} servo at gain {gain:g} was not computed: {solved.complaint()}{alone}"
        raise NoOrbit(sentence, solved.status)
    return orbit_of(
        solved.t, solved.solution, solved.setting, solved.estimate,
        model=model, servo=servo, gain=gain, status=solved.status,
        iterations=solved.iterations, wall_s=time.perf_counter() - began,
    )  # fmt: skip
