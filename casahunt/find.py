"""From a servo to an orbit, without a guess from the user.

    stable cycle    one motion -> mesh from its error estimate -> Newton -> clearly stable? -> Orbit
    where not       event map -> outer fixed point -> IPOPT -> adapt.py -> Orbit
    no fixed point  a walk up from lower gains, or NoOrbit with what was scanned
    unstable cycle  stable one -> walk round the fold -> Orbit; where that fails, inner fixed point -> IPOPT

The short way, `_at_once`, settles most questions; it never decides that there is no cycle, and an orbit that it finds
must be admissible, accurate and clearly stable like any other.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Literal

from .adapt import Options, Solved, remeshed, solve_adaptively
from .checks import known, require
from .continuation import run, walk
from .errors import NoOrbit, Status
from .event_map import CLOSER, TYPICAL, HalfCycle, Scan, half_cycle, near_stable, scan
from .hunting import MODELS, SCHEMES, Model
from .march import MarchFailure
from .orbit import Orbit, direction_of, orbit_of, unknowns_of
from .resequence import Start, from_segments
from .servo import Servo
from .solve import Solver

BranchName = Literal["stable", "unstable"]
CLEARLY_STABLE = -0.8
"""Slope of log(P/a) against log a below which a fixed point is the stable one beyond doubt (0 at the fold)."""
LOWER_GAINS = (0.95, 0.7)
"""Parts of the gain from which a cycle is sought by walking up, where the scan found none."""
NEARBY, FIRST_MOTIONS = {"switch": 3.0, "lugre": 1.25}, 2
"""Ratios P(a)/a, or their inverses, up to which Newton is tried at once; motions computed to come so close."""
WALK_TOLERANCE = 1e-5
"""The way round the fold needs no more accuracy than this; its end is computed to the tolerance."""
BRANCHES: tuple[BranchName, ...] = ("stable", "unstable")


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
    servo, model, gain
        the problem; gain > 0.
    branch
        the stable cycle, or the unstable one that bounds its basin.
    options
        tolerance and method.

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
    if branch == "unstable":
        return replace(_round_the_fold(servo, model, gain, options), wall_s=time.perf_counter() - began)
    at_once = _at_once(servo, model, gain, options)
    if at_once is not None:
        return replace(at_once, wall_s=time.perf_counter() - began)
    start, seen = starting_half_cycle(servo, model, gain)
    if start is None:
        assert seen is not None
        orbit = _from_below(servo, model, gain, options, seen)
    else:
        try:
            orbit = _solved_from(start, servo, model, gain, options, "the stable hunting cycle")
        except NoOrbit:
            closer = near_stable(model, servo, gain, start.start, close=CLOSER)
            if closer is None:
                raise
            orbit = _solved_from(closer, servo, model, gain, options, "the stable hunting cycle")
        # Far from the fold the slope of the map tells the branch; close to it the solver can slip over.
        if not start.slope < CLEARLY_STABLE and orbit.multipliers.leading.real > 1:
            orbit = _other_side(orbit, options)
    return replace(orbit, wall_s=time.perf_counter() - began)


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


def _from_below(servo: Servo, model: Model, gain: float, options: Options, seen: Scan) -> Orbit:
    """The stable cycle at `gain` by walking up from a lower gain; NoOrbit with the evidence where none is met.

    Just below a fold the fixed points of the map are too close for a scan; a walk tells on which side of
    the fold the gain lies.
    """
    evidence = seen.sentence()
    if not seen.conclusive:
        raise NoOrbit(
            f"whether the {model} servo hunts at gain {gain:g} is not known, because its motion could not be computed; "
            f"are all parameters meant? ({evidence})",
            Status.NOT_CONVERGED,
        )
    nothing = f"no hunting limit cycle of the {model} servo at gain {gain:g}"
    for factor in LOWER_GAINS:
        start, _ = starting_half_cycle(servo, model, factor * gain)
        if start is None:
            continue
        try:
            first = _solved_from(start, servo, model, factor * gain, options, "a stable hunting cycle")
        except NoOrbit:
            continue
        orbits, ended = run(walk(first, low=first.gain * (1 - 1e-9), high=gain, options=options))
        if orbits and orbits[-1].gain == gain:
            return orbits[-1] if orbits[-1].multipliers.leading.real <= 1 else _other_side(orbits[-1], options)
        highest = max([first, *orbits], key=lambda orbit: orbit.gain)
        if orbits and orbits[-1].gain < highest.gain:
            raise NoOrbit(
                f"{nothing}: the branch of cycles, followed up from gain {first.gain:g}, turns back in a fold near "
                f"{highest.gain:.6g}; {evidence}"
            )
        raise NoOrbit(
            f"no hunting limit cycle of the {model} servo was found at gain {gain:g}, and it is not certain that there "
            f"is none: its cycles were followed up from gain {first.gain:g} to {highest.gain:.8g} only ({ended}); "
            f"{evidence}",
            Status.NOT_CONVERGED,
        )
    raise NoOrbit(f"{nothing}: {evidence}")


def _other_side(orbit: Orbit, options: Options) -> Orbit:
    """The cycle at the same gain on the other side of the fold next to it."""
    last = orbit
    for following in walk(orbit, low=orbit.gain, high=orbit.gain * 2, options=options, first_step=1e-3):
        last = following
    if last.gain != orbit.gain or last is orbit:
        raise NoOrbit(
            f"the cycle of the {orbit.model} servo at gain {orbit.gain:g} on this side of the fold was not computed: "
            f"the solver converged to the other one (half multiplier {orbit.half_multiplier:.4g}); the gain is very "
            "close to the fold, where the two merge",
            Status.FAR_FROM_GUESS,
        )
    return last


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


def _round_the_fold(servo: Servo, model: Model, gain: float, options: Options) -> Orbit:
    """The unstable cycle at `gain`: from the stable one at the same gain up to the fold and down again.

    Multipliers of 1e5 and more leave no other way that is sure; where it does not lead round the fold, the
    inner fixed point of the event map is tried.
    """
    rough = replace(options, tol=max(options.tol, WALK_TOLERANCE))
    try:
        stable = find_orbit(servo, model, gain, options=rough)
    except NoOrbit as error:
        if error.status is None or rough == options:
            raise
        stable = find_orbit(servo, model, gain, options=options)
    orbit = None
    for way in (rough, options):  # the accurate way is the slow one, and seldom needed
        last = stable
        for last in walk(stable, low=gain, high=gain * 1e9, options=way):  # noqa: B007 - the last one counts
            pass
        if last is stable or last.gain != gain or last.amplitude >= stable.amplitude:
            continue
        try:
            orbit = refined(last, options)
            break
        except NoOrbit:
            continue
    if orbit is None:
        return _inner_fixed_point(servo, model, gain, options)
    return _unstable(orbit, "the branch leads round a fold to")


def refined(orbit: Orbit, options: Options) -> Orbit:
    """The same orbit to another tolerance."""
    began = time.perf_counter()
    solved = solve_adaptively(orbit.model, unknowns_of(orbit), options, solver="newton")
    return finished(solved, orbit.model, orbit.servo, orbit.gain, options, began, "the hunting cycle")


def _inner_fixed_point(servo: Servo, model: Model, gain: float, options: Options) -> Orbit:
    seen = scan(model, servo, gain, want_lower=True)
    if seen.lower is None:
        raise NoOrbit(
            f"the unstable hunting cycle of the {model} servo at gain {gain:g} was not found, though a stable "
            f"one exists there: the branch could not be followed round its fold to this gain, and the scan is too "
            f"coarse ({seen.sentence()})",
            Status.NOT_CONVERGED,
        )
    orbit = _solved_from(seen.lower, servo, model, gain, options, "the unstable hunting cycle")
    return _unstable(orbit, "the solver converged to")


def _unstable(orbit: Orbit, how: str) -> Orbit:
    """`orbit` if a multiplier beyond +1 shows that it lies past the fold, or NoOrbit."""
    if orbit.multipliers.leading.real > 1:
        return orbit
    raise NoOrbit(
        f"the unstable hunting cycle of the {orbit.model} servo at gain {orbit.gain:g} was not computed: {how} a cycle "
        f"with the half multiplier {orbit.half_multiplier:.4g}",
        Status.FAR_FROM_GUESS,
    )


def check_problem(servo: Servo, model: Model, gain: float) -> None:
    """Raise InputError for an unknown model or a gain not positive, NoOrbit with a scan for pure Coulomb friction."""
    known("model", model, MODELS)
    require("gain", gain, above=0)
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
