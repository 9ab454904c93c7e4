"""A simulated motion as data, and what its end shows: hunting, decaying, growing, at rest or undecided.

States are x1 = theta - theta_d [rad], x2 = theta' [rad/s], x3 = integral of x1 [rad s] and, for LuGre, x4 = z [rad].
Inside an interval a motion is its collocation polynomial; simulate.py computes it.

Symbols: n states, d stages, N intervals, m samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from .collocation import Scheme, scheme
from .errors import InputError, Status
from .hunting import SCHEMES, Model, motor_torque
from .servo import Servo

Array = np.ndarray

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


def unit_of(trajectory: Trajectory) -> float:
    """Fs/kp [rad], the error at which the proportional torque is static friction."""
    return trajectory.servo.friction.static / trajectory.servo.torque_gains(trajectory.gain)[0]


def _rest(trajectory: Trajectory) -> str:
    """The sentence of a servo at rest at its set point; "" for one that is not."""
    t, x = trajectory.dense(8)
    late = t >= t[-1] / 2
    allowed = REST * unit_of(trajectory)
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
