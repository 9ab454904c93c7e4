"""The closed loop from any initial state: marching collocation, event by event, with an error estimate.

    x1 = theta - theta_d,   x1' = x2,   J x2' = m - F,   x3' = x1,   m = -(kp x1 + kd x2 + ki x3)

theta [rad] is the position of the servo, theta_d [rad] its constant set point; x1 [rad], x2 [rad/s],
x3 [rad s] and, for LuGre, x4 = z [rad].  Friction F: hunting.py (Switch as an exact event system, LuGre)
or regularised.py (Switch with the report's stick band).  The regulator task of the report (section 3.3) is
theta_d = 1 rad from rest at theta = 0.

Accuracy.  `march` bounds the last Legendre coefficient of each interval; the ends of the intervals are
superconvergent, and what that does to the times of the events depends on the servo.  Measured on 100 s of
the regulator task at K = 0.04: event times err by 1e-4 to 20 times the march tolerance [s].  So that is
not promised: the motion is computed twice, the second time with a march tolerance `REFINEMENT` times
smaller, and the difference is the error estimate.  While it exceeds the tolerance, the next pair follows.
The finer motion of the last pair is the result; as a rule its error is well below the estimate.  Two motions
may agree by chance: no estimate is smaller than `LEAST` of the finer march tolerance.

Symbols: n states, d stages, N intervals, m samples.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from . import regularised as band
from .adapt import TOLERANCE_RANGE
from .checks import known, number, require
from .collocation import Scheme, scheme
from .errors import InputError, NoOrbit, Status
from .event_map import state_scale
from .hunting import MODELS, SCHEMES, SYSTEMS, Model, System, motor_torque
from .march import MarchFailure, Segment, march
from .servo import Servo

Array = np.ndarray

REFINEMENT = 30.0
"""Ratio of the march tolerances of two motions that are compared."""
FIRST, COARSEST, FINEST = 1 / 3, 1e-4, 1e-11
"""March tolerance of the first motion in units of the tolerance; the largest one; the smallest one that rounding lets
the march reach with states of up to `SPAN` scales."""
LEAST = 0.1
"""Smallest error estimate in units of the finer march tolerance."""
HOPELESS = 1e-2
"""No motion is marched with a larger tolerance."""
SPAN = 20.0
"""States may start at so many times the scale that their errors are measured in."""
UNIT = 0.1
"""Expected size of the motion in units of Fs/kp, the error at which the proportional torque is static friction."""
MOST_EVENTS = 100_000
THROWN_OUT = 100.0
"""A servo this many times farther out than it started, or than `UNIT`, is not followed further."""
CHATTER = 50
"""Events in a row within `INSTANT` seconds, relative to the time so far, that are not a motion any more."""
INSTANT = 1e-12

SWINGS = 4
"""Full periods (overlapping, one per half period) that a verdict looks at."""
AGREE = 1e-3
"""Relative spread of amplitude and period up to which swings agree."""
SETTLED = 1e-2
"""Relative change of the amplitude still to come, extrapolated, up to which swings have settled."""
FADING = 0.5
"""Decaying means an extrapolated amplitude below this part of the last one."""
REST = 1e-6
"""At rest means a position that stays within this part of Fs/kp of the set point, for half of the time at least."""
NOTHING = 1e-9
"""Positions within this part of Fs/kp of the set point are rounding."""

Kind = Literal["hunting", "decaying", "growing", "at rest", "undecided"]


@dataclass(frozen=True)
class Happening:
    """An event of a motion.

    Attributes
    ----------
    time : [s].
    name : "stop", "breakaway+", "breakaway-" (Switch), "reversal", "centre" (LuGre), "band", "slip+", "slip-",
        "stick" (Switch with a stick band).
    before, after : modes.  A stop that is followed by a slip is a reversal without stick.
    error : estimated error of the time [s]; nan where the coarser motion did not have the same events.
    """

    time: float
    name: str
    before: str
    after: str
    error: float


@dataclass(frozen=True)
class Verdict:
    """What the end of a motion shows.

    Attributes
    ----------
    kind : "hunting", "decaying", "growing", "at rest" or "undecided".
    sentence : what supports it.
    amplitude : mean of half the peak-to-peak position over the periods looked at [rad]; nan without any.
    period : mean of these periods [s]; nan without any.
    swings : number of (overlapping) periods looked at.
    """

    kind: Kind
    sentence: str
    amplitude: float
    period: float
    swings: int


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A simulated motion.

    Attributes
    ----------
    model, servo, gain, set_point : the problem; set point theta_d [rad].
    regularised : with the report's stick band (Switch).
    times : (N + 1,) interval boundaries [s].
    states : (n, N + 1) states there: x1 [rad], x2 [rad/s], x3 [rad s] and, for LuGre, x4 = z [rad].
    modes : (N,) names of the mode in each interval.
    events : in order.
    tol : the tolerance asked for.
    time_error : estimated largest error of an event time [s].
    end_error : estimated error of x1, x2, x3 at the end, relative to the largest |x1|, |x2|, |x3| of the motion.
    state_errors : (n,) estimated largest error of each state at any time, in its own unit.
    status : CONVERGED where time_error and end_error are at most `tol`.
    ended : why the motion was not followed to the time asked for; "" where it was.
    wall_s : time to compute it [s].
    """

    model: Model
    servo: Servo
    gain: float
    set_point: float
    regularised: bool
    times: Array
    states: Array
    modes: tuple[str, ...]
    events: tuple[Happening, ...]
    tol: float
    time_error: float
    end_error: float
    state_errors: Array
    status: Status
    ended: str
    wall_s: float
    stages: Array = field(repr=False)
    """(N, d + 1, n) start and stages of each interval."""

    @property
    def error_estimate(self) -> float:
        """The larger one of time_error [s] and end_error."""
        return max(self.time_error, self.end_error)

    @property
    def end(self) -> Array:
        """(n,) state at the end."""
        return self.states[:, -1]

    @property
    def scheme(self) -> Scheme:
        """The collocation scheme."""
        return scheme(*SCHEMES[self.model])

    def sample(self, times: Array) -> Array:
        """States at any times of the motion.

        Parameters
        ----------
        times
            (m,) [s], between 0 and the end of the motion.

        Returns
        -------
        (n, m).

        Raises
        ------
        InputError : a time outside the motion, or not a number.
        """
        t = np.asarray(times, float).ravel()
        outside = ~((t >= 0) & (t <= self.times[-1]))
        if outside.any():
            raise InputError(f"time = {t[outside][0]!r}: must lie between 0 and {self.times[-1]:.6g} s")
        return self._inside(t, self._interval_at(t))

    def _interval_at(self, t: Array) -> Array:
        return np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, self.times.size - 2)

    def _inside(self, t: Array, i: Array) -> Array:
        length = self.times[i + 1] - self.times[i]
        tau = np.divide(t - self.times[i], length, out=np.zeros_like(t), where=length > 0)
        x = np.einsum("mj,mjn->nm", self.scheme.interpolation(tau), self.stages[i])
        # The end of an interval is more accurate than its polynomial.
        last = t == self.times[-1]
        x[:, last] = self.states[:, -1:]
        return x

    def dense(self, per_interval: int = 4) -> tuple[Array, Array]:
        """Times (m,) and states (n, m), dense where the motion is fast."""
        tau = np.linspace(0, 1, per_interval, endpoint=False)
        t = np.append((self.times[:-1, None] + np.diff(self.times)[:, None] * tau).ravel(), self.times[-1])
        i = np.append(np.repeat(np.arange(self.times.size - 1), per_interval), self.times.size - 2)
        return t, self._inside(t, i)

    def mode_at(self, times: Array) -> list[str]:
        """Names of the modes at times (m,) [s]."""
        return [self.modes[i] for i in self._interval_at(np.asarray(times, float).ravel())]

    def torque(self, states: Array) -> Array:
        """Motor torque m (m,) [N m] at states (n, m)."""
        return np.asarray(motor_torque(states, self.servo.parameters(self.gain)), float)

    def shape(self) -> tuple[Array, Array]:
        """Swings of the motion from one crossing of the set point to the next.

        Returns
        -------
        crossings : (k,) times [s] at which x1 changes sign.
        peaks : (k + 1,) largest |x1| [rad] before the first crossing, between crossings and after the last one.
        """
        t, x = self.dense(8)
        side = np.sign(x[0])
        seen = np.flatnonzero(side)
        turn = np.flatnonzero(np.diff(side[seen]))
        low, high, sign = t[seen[turn]], t[seen[turn + 1]], side[seen[turn]]
        for _ in range(60):
            middle = (low + high) / 2
            before = self.sample(middle)[0] * sign > 0 if middle.size else np.zeros(0, bool)
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        edges = np.concatenate([[0], seen[turn + 1], [t.size]])
        peaks = [float(np.max(np.abs(x[0, a:b]))) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        return (low + high) / 2, np.array(peaks)

    @cached_property
    def verdict(self) -> Verdict:
        """What the end of the motion shows: hunting, decaying, growing, at rest or undecided."""
        return judge_motion(self)


def simulate(
    servo: Servo,
    model: Model,
    gain: float,
    *,
    set_point: float = 1.0,
    time: float = 100.0,
    position: float = 0.0,
    velocity: float = 0.0,
    integral: float = 0.0,
    bristle: float = 0.0,
    tol: float = 1e-6,
    regularised: bool = False,
) -> Trajectory:
    """The motion of the closed loop from an initial state.

    Parameters
    ----------
    servo, model, gain
        the problem; gain > 0.
    set_point
        theta_d [rad].
    time
        length of the motion [s], > 0.
    position, velocity
        theta [rad] and theta' [rad/s] at the start.
    integral
        x3 [rad s] at the start: the integral of theta - theta_d so far.
    bristle
        z [rad] at the start (LuGre only).
    tol
        bound on the error of event times [s] and of the final x1, x2, x3 relative to their largest values.
    regularised
        Switch with the report's stick band eta and rate alpha instead of an exact stick.

    Returns
    -------
    Trajectory; its status is TOLERANCE_NOT_REACHED where the estimated errors stay above `tol`.

    Raises
    ------
    InputError : a value out of range.
    NoOrbit : the motion could not be computed.
    """
    began = clock.perf_counter()
    known("model", model, MODELS)
    require("gain", gain, above=0)
    require("time", time, above=0)
    tol = number("tol", tol)
    low, high = TOLERANCE_RANGE
    if not low <= tol <= high:
        raise InputError(f"tol = {tol:g}: must lie between {low:g} and {high:g}")
    if regularised and model != "switch":
        raise InputError(f"regularised: must be left out with the model {model!r}, the stick band is for 'switch'")
    if bristle != 0 and model != "lugre":
        raise InputError(f"bristle = {bristle!r}: must be 0 with the model {model!r}, which has no bristle")
    values = {"set_point": set_point, "position": position, "velocity": velocity, "integral": integral}
    numbers = {key: number(key, value) for key, value in values.items()}
    theta_d = numbers["set_point"]
    x = [numbers["position"] - theta_d, numbers["velocity"], numbers["integral"]]
    start = np.array(x + ([number("bristle", bristle)] if model == "lugre" else []))
    run = _Run(servo, model, gain, start, time, regularised)

    found = _refined(run, tol, lambda coarse, fine: _trajectory(run, coarse, fine, tol, theta_d, began))
    if isinstance(found, MarchFailure):
        where = f"the motion of the {model} servo at gain {gain:g} was not computed"
        raise NoOrbit(f"{where}: {found}", Status.NOT_CONVERGED)
    return found


def _refined(run: _Run, tol: float, compared: Callable[[_Motion, _Motion], Trajectory]) -> Trajectory | MarchFailure:
    """The finer motion of the first pair that agrees to `tol`, or of the finest pair that could be marched.

    Stiff and wide motions meet rounding before the march reaches `FINEST`: then the pair is made of the
    finest motion there is and a coarser one.
    """
    tau = max(min(FIRST * tol, COARSEST), FINEST * REFINEMENT)
    coarse: _Motion | None = None
    found: Trajectory | None = None
    while True:
        try:
            fine = run(tau)
        except MarchFailure as failure:
            if found is not None:
                return found
            if coarse is None:
                tau *= REFINEMENT
                if tau > HOPELESS:
                    return failure
                continue
            try:
                return compared(run(tau * REFINEMENT**2), coarse)
            except MarchFailure:
                return failure
        if coarse is not None:
            found = compared(coarse, fine)
            if found.status.ok or tau <= FINEST:
                return found
        coarse, tau = fine, max(tau / REFINEMENT, FINEST)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Segments of a motion with start times and the mode after each, why it ended early, and its march tolerance."""

    segments: list[Segment]
    starts: Array
    after: list[str]
    ended: str
    tau: float

    @property
    def event_times(self) -> Array:
        """Times [s] of the ends of the segments that ended in an event."""
        ends = self.starts + np.array([s.duration for s in self.segments])
        return ends[[bool(s.event) for s in self.segments]]


class _Run:
    """One problem, marched with any march tolerance."""

    def __init__(self, servo: Servo, model: Model, gain: float, start: Array, time: float, regularised: bool) -> None:
        self.servo, self.model, self.gain, self.start, self.time = servo, model, gain, start, time
        self.regularised = regularised
        self.system: System = band.REGULARISED if regularised else SYSTEMS[model]
        self.p = band.parameters(servo, gain) if regularised else servo.parameters(gain)
        kp = servo.torque_gains(gain)[0]
        self.unit = servo.friction.static / kp
        self.scale = state_scale(model, servo, gain, UNIT * self.unit)
        self.scale = np.maximum(self.scale, np.abs(start) / SPAN)

    def first_mode(self) -> str:
        """The mode of the initial state."""
        if self.regularised:
            return band.mode_of(self.start, self.p)
        slip = "slip" if self.model == "switch" else "slide"
        if self.start[1] != 0:
            return f"{slip}{'+' if self.start[1] > 0 else '-'}"
        # At x2 = 0 the law is that of a stop, or of a reversal, which is the first exit of every slip.
        return self.system.exits[f"{slip}+"][0].successor(self.start, self.p)

    def __call__(self, tau: float) -> _Motion:
        degree, kind = SCHEMES[self.model]
        x, mode, now = self.start, self.first_mode(), 0.0
        segments: list[Segment] = []
        starts: list[float] = []
        after: list[str] = []
        ended, instant = "", 0
        limit = THROWN_OUT * max(abs(float(x[0])), self.unit)
        while now < self.time * (1 - 1e-15):
            (segment,) = march(
                self.system, mode, x, self.p, scale=self.scale, until=lambda _: True, tol=tau,
                degree=degree, kind=kind, max_time=self.time - now,
            )  # fmt: skip
            if segment.duration > self.time - now:  # a closed form knows no end of time
                segment = self._cut(segment, self.time - now)
            segments.append(segment)
            starts.append(now)
            now += segment.duration
            x = segment.end
            if not segment.event:
                after.append(mode)
                continue
            way_out = next(e for e in self.system.exits[mode] if e.event.name == segment.event)
            mode = way_out.successor(x, self.p)
            after.append(mode)
            instant = instant + 1 if segment.duration <= INSTANT * max(now, 1.0) else 0
            if instant > CHATTER:
                raise MarchFailure(f"mode {segment.mode!r}: events without end at {now:.6g} s")
            if len(segments) > MOST_EVENTS:
                ended = f"{MOST_EVENTS} events by {now:.6g} s"
            elif abs(float(x[0])) > limit:
                ended = f"{abs(float(x[0])):.3g} rad away from the set point at {now:.6g} s"
            if ended:
                break
        return _Motion(segments, np.array(starts), after, ended, tau)

    def _cut(self, segment: Segment, duration: float) -> Segment:
        end = self.flow(segment, np.array([duration]))[0]
        return Segment(segment.mode, "", duration, segment.breaks, segment.w, end)

    def flow(self, segment: Segment, times: Array) -> Array:
        """(m, n) states of a closed-form segment at times (m,) after its start."""
        flow = self.system.modes[segment.mode].flow
        assert flow is not None
        return np.array([np.array(flow(segment.start, t, self.p)).ravel() for t in times])


def _trajectory(run: _Run, coarse: _Motion, fine: _Motion, tol: float, set_point: float, began: float) -> Trajectory:
    """The finer motion as a Trajectory, with the differences to the coarser one as error estimates."""
    result = _laid_out(run, fine, tol, set_point)
    other = _laid_out(run, coarse, tol, set_point)
    errors, time_error = _event_errors(result, other)
    least = LEAST * fine.tau
    errors, time_error = errors + least, time_error + least
    t, x = result.dense(3)
    common = t <= other.times[-1]
    difference = np.abs(x[:, common] - other.sample(t[common]))
    size = np.max(np.abs(x), axis=1)
    difference += least * size[:, None]
    last = difference[:3, -1] / np.where(size[:3] > 0, size[:3], 1.0)
    # Motions that were both thrown out are compared at the last time that they share.
    end_error = float(np.max(last)) if bool(fine.ended) == bool(coarse.ended) else np.inf
    ok = time_error <= tol and end_error <= tol
    events = tuple(
        Happening(e.time, e.name, e.before, e.after, float(error))
        for e, error in zip(result.events, errors, strict=True)
    )
    return Trajectory(
        **{
            name: getattr(result, name)
            for name in ("model", "servo", "gain", "set_point", "regularised", "times", "states", "modes", "stages")
        },
        events=events,
        tol=tol,
        time_error=time_error,
        end_error=end_error,
        state_errors=np.max(difference, axis=1),
        status=Status.CONVERGED if ok else Status.TOLERANCE_NOT_REACHED,
        ended=fine.ended,
        wall_s=clock.perf_counter() - began,
    )


def _event_errors(fine: Trajectory, coarse: Trajectory) -> tuple[Array, float]:
    """Differences of the times of the events of `fine` (nan where there are none), and the largest.

    Infinite where the two motions have not the same events in the same order.  Not compared are the events of
    a servo at rest, which are rounding, and, where they differ in number, the reversals of the LuGre servo: too
    weak ones come and go, but the crossings of the set point may not.
    """
    errors = np.full(len(fine.events), np.nan)
    ours, theirs = (np.array([e.time <= _alive_until(t) for e in t.events], bool) for t in (fine, coarse))
    for only in ("", "centre"):
        if only:
            ours, theirs = (
                here & np.array([e.name == only for e in t.events], bool)
                for here, t in ((ours, fine), (theirs, coarse))
            )
            if not ours.any():
                break
        a, b = ([t.events[i] for i in np.flatnonzero(here)] for t, here in ((fine, ours), (coarse, theirs)))
        if [(e.before, e.name) for e in a] == [(e.before, e.name) for e in b]:
            errors[ours] = [abs(e.time - f.time) for e, f in zip(a, b, strict=True)]
            return errors, float(np.max(errors[ours], initial=0.0))
    return errors, np.inf


def _alive_until(trajectory: Trajectory) -> float:
    """The last time [s] at which the position differs from the set point by more than rounding."""
    far = np.abs(trajectory.states[0]) > NOTHING * _unit(trajectory)
    return float(trajectory.times[np.flatnonzero(far)[-1]]) if far.any() else 0.0


def _laid_out(run: _Run, motion: _Motion, tol: float, set_point: float) -> Trajectory:
    """A motion as a Trajectory, without error estimates."""
    s = scheme(*SCHEMES[run.model])
    n = run.start.size
    times: list[Array] = []
    stages: list[Array] = []
    modes: list[str] = []
    for start, segment in zip(motion.starts, motion.segments, strict=True):
        times.append(start + segment.duration * segment.breaks[:-1])
        closed = run.system.modes[segment.mode].flow is not None
        if closed:  # linear in time, which the interpolation polynomial reproduces
            stages.append(run.flow(segment, segment.duration * s.points)[None])
        else:
            stages.append(segment.w.reshape(-1, s.degree + 1, n))
        modes += [segment.mode] * len(segment.w)
    end = motion.segments[-1]
    w = np.concatenate(stages)
    last = float(motion.starts[-1] + end.duration)
    if not motion.ended:
        last = run.time  # to the last bit
    named = [i for i, segment in enumerate(motion.segments) if segment.event]
    return Trajectory(
        model=run.model,
        servo=run.servo,
        gain=run.gain,
        set_point=set_point,
        regularised=run.regularised,
        times=np.append(np.concatenate(times), last),
        states=np.vstack([w[:, 0], end.end]).T,
        modes=tuple(modes),
        events=tuple(
            Happening(float(t), motion.segments[i].event, motion.segments[i].mode, motion.after[i], np.nan)
            for t, i in zip(motion.event_times, named, strict=True)
        ),
        tol=tol,
        time_error=np.inf,
        end_error=np.inf,
        state_errors=np.full(n, np.inf),
        status=Status.TOLERANCE_NOT_REACHED,
        ended=motion.ended,
        wall_s=0.0,
        stages=w,
    )


# The verdict ---------------------------------------------------------------------------------------------


def judge_motion(trajectory: Trajectory) -> Verdict:
    """What the end of a motion shows.

    Amplitudes A_k are means of two consecutive peaks |x1|, so that a lopsided cycle counts as one; their
    differences shrink by the half multiplier mu near a cycle.  From the last three the amplitude still to
    come is extrapolated (Aitken): that tells the end of a convergence from a slow decay, in which each
    swing differs little from the one before and the sum of the differences is everything.
    """
    crossings, peaks = trajectory.shape()
    halves = np.diff(crossings)
    A = (peaks[1:-2] + peaks[2:-1]) / 2  # complete swings only
    T = halves[:-1] + halves[1:]
    count = min(SWINGS, A.size)
    amplitude, period = (float(np.mean(v[-count:])) if count else float("nan") for v in (A, T))

    def verdict(kind: Kind, sentence: str) -> Verdict:
        return Verdict(kind, sentence, amplitude, period, count)

    rest = _rest(trajectory)
    if rest:
        return Verdict("at rest", rest, float("nan"), float("nan"), 0)
    # For growth and decay the swing under way counts, once it has turned, and so does the first one.
    P = peaks if _has_turned(trajectory, crossings) else peaks[:-1]
    if trajectory.ended and "away" in trajectory.ended:
        return verdict("growing", f"the servo is thrown out: {trajectory.ended}")
    if A.size >= SWINGS:
        a, T = A[-SWINGS:], T[-SWINGS:]
        spread = [float(np.ptp(v) / np.mean(v)) for v in (a, T)]
        to_come = _still_to_come(A)
        if max(spread) <= AGREE and abs(to_come) <= SETTLED * a[-1]:
            return verdict(
                "hunting",
                f"the last {SWINGS + 1} half periods agree to {spread[0]:.1e} in amplitude and {spread[1]:.1e} in "
                f"period; extrapolated, the amplitude changes by another {to_come / a[-1]:+.1e} of itself",
            )
    if P.size >= SWINGS:
        B = (P[:-1] + P[1:]) / 2
        steps = np.diff(B)[-(SWINGS - 2) :]
        factors = P[1:] / P[:-1]
        change = f"from {B[-1 - steps.size]:.4g} to {B[-1]:.4g} rad"
        text = f"over the last {steps.size + 1} periods the amplitude goes {change}"
        to_come = _still_to_come(B)
        if (steps < 0).all() and B[-1] + to_come < FADING * B[-1]:
            return verdict(
                "decaying", f"{text}, the last swing {factors[-1]:.4g} times the one before, and tends to no cycle"
            )
        if (steps > 0).all() and to_come > FADING * B[-1]:
            return verdict("growing", f"{text}, the last swing {factors[-1]:.4g} times the one before")
        if abs(to_come) <= SETTLED * B[-1]:
            return verdict("undecided", f"{text}: the swings are settling; more time is needed")
        return verdict("undecided", f"{text}, neither steady nor steadily growing or decaying; more time is needed")
    return verdict("undecided", _stuck(trajectory) or f"only {P.size} swings in {trajectory.times[-1]:.4g} s")


def _still_to_come(A: Array) -> float:
    """Sum of the differences of A still to come, if they go on as a geometric series; -A, +inf where they diverge."""
    if A.size < 3:
        return float("nan")
    d0, d1 = float(A[-2] - A[-3]), float(A[-1] - A[-2])
    if abs(d1) <= 1e-12 * float(A[-1]):
        return 0.0
    ratio = d1 / d0 if d0 else np.inf
    if abs(ratio) < 1:
        return d1 * ratio / (1 - ratio)
    # Differences of alternating sign that do not shrink lead nowhere in particular.
    return float("nan") if ratio < 0 else (-float(A[-1]) if d1 < 0 else np.inf)


def _unit(trajectory: Trajectory) -> float:
    return trajectory.servo.friction.static / trajectory.servo.torque_gains(trajectory.gain)[0]


def _rest(trajectory: Trajectory) -> str:
    """The sentence of a servo at rest at its set point; "" for one that is not."""
    t, x = trajectory.dense(8)
    late = t >= t[-1] / 2
    allowed = REST * _unit(trajectory)
    if trajectory.regularised:  # a stick is a creep by up to eta/alpha
        friction = trajectory.servo.friction
        allowed = max(allowed, 2 * friction.stick_band / friction.stick_rate)
    if np.max(np.abs(x[0, late])) > allowed:
        return ""
    since = float(t[np.flatnonzero(np.abs(x[0]) > allowed)[-1]]) if (np.abs(x[0]) > allowed).any() else 0.0
    return f"within {allowed:.2g} rad of the set point since {since:.4g} s"


def _has_turned(trajectory: Trajectory, crossings: Array) -> bool:
    """The last swing has had its peak."""
    t, x = trajectory.dense(8)
    late = np.abs(x[0, t > (crossings[-1] if crossings.size else -1.0)])
    return bool(late.size and np.max(late) > late[-1]) or trajectory.modes[-1] == "stick"


def _stuck(trajectory: Trajectory) -> str:
    """The sentence of a servo stuck beside its set point with time running out; "" elsewhere."""
    x = trajectory.end
    _, _, ki = trajectory.servo.torque_gains(trajectory.gain)
    static = trajectory.servo.friction.static
    m = float(trajectory.torque(x[:, None])[0])
    slow = abs(float(x[1])) <= 1e-3 * max(float(np.max(np.abs(trajectory.states[1]))), 1e-300)
    if not slow or abs(m) > static or x[0] == 0:
        return ""
    wait = (m + np.sign(x[0]) * static) / (ki * float(x[0]))
    return (
        f"the motion ends stuck at {float(x[0]):+.4g} rad beside the set point; the integral action breaks it away "
        f"about {wait:.4g} s later"
    )
