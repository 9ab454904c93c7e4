"""A hunting cycle at one gain from one motion or a scan of the event map, without following any branch.

    one motion -> mesh from its error estimate -> Newton -> clearly stable? -> Orbit
    where not     event map -> fixed point -> IPOPT -> orbits/adapt.py -> Orbit

The short way, `_at_once`, settles most questions.  What neither way finds is not thereby shown to be absent: just below
a fold two fixed points fit between any two motions of a scan.  find_orbit.py has the last word, from the fold.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from ..checks import COMPUTED, known, sensible
from ..collocation.solve import Solver
from ..errors import InputError, NoOrbit, Status
from ..motion.march import MarchFailure
from ..orbits.adapt import Options, finished, remeshed, solve_adaptively
from ..orbits.restart import Start
from .event_map.scan import CLOSER, TYPICAL, HalfCycle, Scan, half_cycle, near_stable, scan
from .hunting import MODELS, Model
from .problem import Hunting, HuntingOrbit
from .sequences import from_half_cycle
from .servo import Servo

CLEARLY_STABLE = -0.8
"""Slope of log(P/a) against log a below which a fixed point is the stable one beyond doubt (0 at the fold)."""
SPREAD = 1 / math.sqrt(np.finfo(float).eps)
"""Largest ratio of the times of a servo: half of the digits of double arithmetic."""
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

    orbit: HuntingOrbit | None
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


def unstable_at(servo: Servo, model: Model, gain: float, *, options: Options) -> tuple[HuntingOrbit | None, Scan]:
    """(the cycle next to the inner fixed point of the event map or None, the scan); arguments as `stable_at`."""
    seen = scan(model, servo, gain, want_lower=True)
    if seen.lower is None:
        return None, seen
    return _solved_from(seen.lower, servo, model, gain, options, "the unstable hunting cycle"), seen


def _at_once(servo: Servo, model: Model, gain: float, options: Options) -> HuntingOrbit | None:
    """The stable cycle by Newton from one motion or two that start where most cycles stick, or None.

    The event map is flat at most stable cycles: its values are close to them.  Where they are not, or where the solver
    does not arrive at a clearly stable cycle, the careful way has to be gone.
    """
    if options.solver == "ipopt":
        return None
    began = time.perf_counter()
    problem = Hunting(model, servo, gain)
    degree, kind = options.scheme_of(problem)
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
        first = remeshed(_start(motion, problem, options), options)
        solved = solve_adaptively(problem, first, options, solver="newton")
        orbit = finished(solved, problem, options, began, "")
    except (MarchFailure, NoOrbit):
        return None
    linearisation = solved.solution.linearisation
    if linearisation is None or not linearisation.return_map_eigenvalues().real.max() < 1 + CLEARLY_STABLE:
        return None
    return orbit


def _solved_from(
    start: HalfCycle, servo: Servo, model: Model, gain: float, options: Options, what: str
) -> HuntingOrbit:
    began = time.perf_counter()
    problem = Hunting(model, servo, gain)
    degree, kind = options.scheme_of(problem)
    if (degree, kind) != problem.scheme:
        start = half_cycle(model, servo, gain, start.start, degree=degree, kind=kind)
    solver: Solver = "ipopt" if options.solver == "auto" else options.solver
    solved = solve_adaptively(problem, _start(start, problem, options), options, solver=solver)
    return finished(solved, problem, options, began, what)


def _start(motion: HalfCycle, problem: Hunting, options: Options) -> Start:
    """A motion as the starting point of the boundary value problem."""
    if motion.segments[-1].event == "":  # next to a jump of the map the motion may do that on another mesh
        raise NoOrbit(
            f"the hunting cycle of {problem.title} at gain {problem.gain:g} was not computed: the motion from the "
            f"stick position {motion.start:.6g} rad, next to it on the event map, comes to rest; the map jumps there",
            Status.NOT_CONVERGED,
        )
    degree, kind = options.scheme_of(problem)
    return from_half_cycle(
        problem.model, motion.segments, problem.vector(), problem.direction(problem.principal),
        degree=degree, kind=kind, half=options.half,
    )  # fmt: skip


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


def check_times(servo: Servo, model: Model, gain: float = math.nan) -> None:
    """Raise InputError where a time in which the servo moves is more than `SPREAD` times the controller's, or less.

    Too fast may be the drop of the friction, J vs/(Fs - Fc), viscous friction, J/sigma2, and the LuGre bristle,
    sqrt(J/sigma0), J/sigma1 and Fc/(sigma0 vs); too slow the drop, the bristle, and at a gain the controller itself,
    sqrt(J/kp) and (kd + sigma2)/kp.  Without a gain the largest one that hunts is looked for, where both controller
    times act.
    """
    J, f, c = servo.inertia, servo.friction, servo.controller
    both, fast, slow = {}, {}, {}
    if f.static > f.coulomb:
        drop = J * f.stribeck_velocity / (f.static - f.coulomb)
        both["the drop of the friction curve (inertia * stribeck_velocity/(static - coulomb))"] = drop
    fast["viscous friction (inertia/viscous)"] = J / f.viscous if f.viscous else math.inf
    if model == "lugre":
        both["the bristle (coulomb/(stiffness * stribeck_velocity))"] = f.coulomb / (f.stiffness * f.stribeck_velocity)
        fast["the bristle (square root of inertia/stiffness)"] = math.sqrt(J / f.stiffness)
        fast["the damping of the bristle (inertia/damping)"] = J / f.damping if f.damping else math.inf
    if math.isnan(gain):
        fast["the shorter one alone"] = min(c.lead_time, c.integral_time) or math.inf
    else:
        kp, kd, _ = servo.torque_gains(gain)
        slow[f"the controller at gain {gain:g}"] = max(math.sqrt(J / kp), (kd + f.viscous) / kp)
    whole = c.lead_time + c.integral_time
    early = [(what, t) for what, t in (both | fast).items() if t < whole / SPREAD]
    for what, t in [*early, *((what, t) for what, t in (both | slow).items() if t > SPREAD * whole)]:
        raise InputError(
            f"the controller's times are {whole:.2g} s together, but {what} takes {t:.2g} s: cycles are computed up to "
            f"a factor of {SPREAD:.2g} between them, because double arithmetic must have half of its digits left for "
            "the answer; are all parameters meant?"
        )


def stiff_at(servo: Servo, gain: float) -> bool:
    """The controller's damping acts so fast, in J/(kd + sigma2), that no motion can be computed."""
    c, (_, kd, _) = servo.controller, servo.torque_gains(gain)
    return SPREAD * servo.inertia < (kd + servo.friction.viscous) * (c.lead_time + c.integral_time)

