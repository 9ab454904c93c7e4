"""The closed loop from any initial state: a march, event by event, with an error estimate.

    x1 = theta - theta_d,   x1' = x2,   J x2' = m - F,   x3' = x1,   m = -(kp x1 + kd x2 + ki x3)

theta [rad] is the position of the servo, theta_d [rad] its constant set point; x1 [rad], x2 [rad/s],
x3 [rad s] and, for LuGre, x4 = z [rad].  Friction F: servo/hunting.py (Switch as an exact event system, LuGre).
The regulator task of the report is theta_d = 1 rad from rest at theta = 0.

Accuracy.  `march` bounds the last Legendre coefficient of each interval; the ends of the intervals are
much better, and what that does to the times of the events depends on the servo.  Measured on 100 s of
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
from dataclasses import dataclass, replace

import numpy as np

from ... import effort
from ...checks import COMPUTED, choice_of, moderate, number, sensible
from ...collocation import Scheme, flow_at
from ...errors import InputError, NoOrbit, Status
from ...motion import MarchFailure, Segment, march
from ...orbits import Options
from ..cycles import SCHEMES, system_of
from ..event_map.half_cycle import StickMap
from ..gains import matrix
from ..hunting import MODELS, Model
from ..servo import Servo, a_servo
from .trajectory import Happening, Trajectory

Array = np.ndarray

REFINEMENT = 30.0
"""Ratio of the march tolerances of two motions that are compared."""
FIRST, COARSEST, FINEST = 1 / 10, 1e-4, 1e-11
"""March tolerance of the first motion in units of the tolerance; the largest one; the smallest one that rounding lets
the march reach with states of up to `SPAN` scales."""
LEAST = 0.1
"""Smallest error estimate in units of the finer march tolerance."""
HOPELESS = 1e-2
"""No motion is marched with a larger tolerance."""
SPAN = 20.0
"""States may start at so many times the scale that their errors are measured in."""
ESCAPE = {"switch": 1.05, "lugre": 2.0}
"""What |w . x| must exceed in units of the certain bound; a LuGre bristle that is being bent adds sigma1 z'."""
UNIT = 0.1
"""Expected size of the motion in units of Fs/kp, the error at which the proportional torque is static friction."""
MOST_EVENTS = 20_000
"""Events after which a motion is not followed further: some thousand periods."""
THROWN_OUT = 100.0
"""A servo that never comes back is not followed beyond so many times its first distance, or Fs/kp."""
CHATTER = 50
"""Events in a row within `INSTANT` seconds, relative to the time so far, that are not a motion any more."""
INSTANT = 1e-12

NOTHING = 1e-9
"""Positions within this part of Fs/kp of the set point are rounding."""


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

    Returns
    -------
    Trajectory; its status is TOLERANCE_NOT_REACHED where the estimated errors stay above `tol`.

    Raises
    ------
    InputError : a value out of range.
    NoOrbit : the motion could not be computed.

    Examples
    --------
    >>> from casahunt import Servo, simulate
    >>> motion = simulate(Servo(), "switch", 0.04, time=60.0)
    >>> motion.verdict.kind, motion.status.ok
    ('hunting', True)
    """
    began = clock.perf_counter()
    a_servo(servo)
    choice_of("model", model, MODELS)
    sensible("gain", gain, power=COMPUTED)
    sensible("time", time, power=COMPUTED)
    tol = number("tol", tol)
    low, high = Options.TOLERANCES
    if not low <= tol <= high:
        raise InputError(f"tol = {tol:g}: must lie between {low:g} and {high:g}")
    if bristle != 0 and model != "lugre":
        raise InputError(f"bristle = {bristle!r}: must be 0 with the model {model!r}, which has no bristle")
    values = {"set_point": set_point, "position": position, "velocity": velocity, "integral": integral}
    numbers = {key: moderate(key, value, power=COMPUTED) for key, value in values.items()}
    theta_d = numbers["set_point"]
    x = [numbers["position"] - theta_d, numbers["velocity"], numbers["integral"]]
    start = np.array(x + ([moderate("bristle", bristle, power=COMPUTED)] if model == "lugre" else []))
    run = _Marcher(servo, model, gain, start, time)

    found = _refined(run, tol, lambda coarse, fine: _trajectory(run, coarse, fine, tol, theta_d, began))
    if isinstance(found, MarchFailure):
        where = f"the motion of the {model} servo at gain {gain:g} was not computed"
        raise NoOrbit(f"{where}: {found}", Status.NOT_CONVERGED)
    return found


def escapes(servo: Servo, model: Model, gain: float, x: Array) -> bool:
    """Whether the motion from a state x (n,) grows without bound, whatever the friction does; False: not certain.

    With w A = lambda w, Re lambda > 0, A the loop without dry friction, y = w . x obeys |y|' >= Re lambda |y| - |w_2|
    Fs/J, as |F - sigma2 x2| <= Fs: |y| > |w_2| Fs/(J Re lambda) grows for ever.
    """
    values, vectors = np.linalg.eig(matrix(servo, gain).T)
    static = servo.friction.static / servo.inertia
    return any(
        value.real > 0 and abs(w @ x[:3]) > ESCAPE[model] * abs(w[1]) * static / value.real
        for value, w in zip(values, vectors.T, strict=True)
    )


def _refined(
    run: _Marcher, tol: float, compared: Callable[[_MarchedMotion, _MarchedMotion], Trajectory]
) -> Trajectory | MarchFailure:
    """The finer motion of the first pair that agrees to `tol`, or of the finest pair that could be marched.

    Stiff and wide motions meet rounding before the march reaches `FINEST`: then the pair is made of the
    finest motion there is and a coarser one.
    """
    tau = max(min(FIRST * tol, COARSEST), FINEST * REFINEMENT)
    coarse: _MarchedMotion | None = None
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
class _MarchedMotion:
    """Segments of a motion, the mode after the last one, why it ended early, and its march tolerance."""

    segments: list[Segment]
    after: str
    ended: str
    tau: float

    @property
    def starts(self) -> Array:
        """Times [s] at which the segments begin, and at which the last one ends."""
        return np.cumsum([0.0, *(segment.duration for segment in self.segments)])


class _Marcher:
    """One problem, marched with any march tolerance."""

    def __init__(self, servo: Servo, model: Model, gain: float, start: Array, time: float) -> None:
        self.servo, self.model, self.gain, self.start, self.time = servo, model, gain, start, time
        self.p = servo.parameters(gain)
        self.system = system_of(model, self.p.size).vector_form
        stick_map = StickMap(model, servo, gain)
        self.unit = stick_map.unit
        self.scale = np.maximum(stick_map.scale(UNIT * self.unit), np.abs(start) / SPAN)

    def first_mode(self) -> str:
        """The mode of the initial state."""
        slip = "slip" if self.model == "switch" else "slide"
        if self.start[1] != 0:
            return f"{slip}{'+' if self.start[1] > 0 else '-'}"
        # At x2 = 0 the law is that of a stop, or of a reversal, which is the first exit of every slip.
        return self.system.exits[f"{slip}+"][0].successor(self.start, self.p)

    def __call__(self, tau: float) -> _MarchedMotion:
        degree, kind = SCHEMES[self.model]
        x, mode, now = self.start, self.first_mode(), 0.0
        segments: list[Segment] = []
        ended, instant = "", 0
        limit = THROWN_OUT * max(abs(float(x[0])), self.unit)
        began = clock.monotonic()
        effort.at(
            lambda: f"followed to {now:.4g} s of {self.time:.4g} s{effort.left(now, self.time, began)}, to the march "
            f"tolerance {tau:.0e}"
        )  # fmt: skip
        while now < self.time * (1 - 1e-15) and not ended:
            left = self.time - now
            (segment,) = march(
                self.system, mode, x, self.p, scale=self.scale, until=lambda _: True, tol=tau,
                degree=degree, kind=kind, max_time=left, after=segments[-1] if segments else None,
            )  # fmt: skip
            if self.closed(segment) and segment.duration > left:  # a closed form knows no end of time
                segment = replace(segment, event="", duration=left, end=self.flow(segment, np.array([left]))[0])
            segments.append(segment)
            now, x = now + segment.duration, segment.end
            if not segment.event:
                continue
            mode = self.system.ways_out(mode, segment.event)[0].successor(x, self.p)
            instant = instant + 1 if segment.duration <= INSTANT * max(now, 1.0) else 0
            if instant > CHATTER:
                raise MarchFailure(f"mode {segment.mode!r}: events without end at {now:.6g} s")
            if len(segments) > MOST_EVENTS:
                ended = f"{MOST_EVENTS} events by {now:.6g} s"
            elif abs(float(x[0])) > limit and escapes(self.servo, self.model, self.gain, x):
                ended = f"{abs(float(x[0])):.3g} rad away from the set point at {now:.6g} s"
        return _MarchedMotion(segments, mode, ended, tau)

    def closed(self, segment: Segment) -> bool:
        """Whether a segment is known in closed form."""
        return self.system.modes[segment.mode].flow is not None

    def flow(self, segment: Segment, times: Array) -> Array:
        """(m, n) states of such a segment at times (m,) after its start."""
        return flow_at(self.system.modes[segment.mode], segment.start, times, self.p)


def _trajectory(
    run: _Marcher, coarse: _MarchedMotion, fine: _MarchedMotion, tol: float, set_point: float, began: float
) -> Trajectory:
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
    return replace(
        result,
        events=tuple(replace(e, error=float(error)) for e, error in zip(result.events, errors, strict=True)),
        time_error=time_error,
        end_error=end_error,
        state_errors=np.max(difference, axis=1),
        status=Status.CONVERGED if ok else Status.TOLERANCE_NOT_REACHED,
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
    servo = trajectory.servo
    far = np.abs(trajectory.states[0]) > NOTHING * servo.friction.static / servo.torque_gains(trajectory.gain)[0]
    return float(trajectory.times[np.flatnonzero(far)[-1]]) if far.any() else 0.0


def _laid_out(run: _Marcher, motion: _MarchedMotion, tol: float, set_point: float) -> Trajectory:
    """A motion as a Trajectory, without error estimates."""
    s, n = Scheme.of(*SCHEMES[run.model]), run.start.size
    starts, segments = motion.starts, motion.segments
    times = [t + segment.duration * segment.breaks[:-1] for t, segment in zip(starts, segments, strict=False)]
    w = np.concatenate([
        # linear in time, which the interpolation polynomial reproduces
        run.flow(segment, segment.duration * s.points)[None] if run.closed(segment)
        else segment.w.reshape(-1, s.degree + 1, n)
        for segment in segments
    ])  # fmt: skip
    last = float(starts[-1]) if motion.ended else run.time  # to the last bit
    after = [*(segment.mode for segment in segments[1:]), motion.after]
    return Trajectory(
        model=run.model,
        servo=run.servo,
        gain=run.gain,
        set_point=set_point,
        times=np.append(np.concatenate(times), last),
        states=np.vstack([w[:, 0], segments[-1].end]).T,
        modes=tuple(segment.mode for segment in segments for _ in segment.w),
        events=tuple(
            Happening(float(t), segment.event, segment.mode, behind, np.nan)
            for t, segment, behind in zip(starts[1:], segments, after, strict=True)
            if segment.event
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
