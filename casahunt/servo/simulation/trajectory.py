"""A simulated motion as data; what becomes of it is seen by following it on (parts/ahead.py).

States are x1 = theta - theta_d [rad], x2 = theta' [rad/s], x3 = integral of x1 [rad s] and, for LuGre, x4 = z [rad].
Inside an interval a motion is its collocation polynomial; simulate.py computes it.

Symbols: n states, d stages, N intervals, m samples.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...collocation import Scheme
from ...errors import InputError, Status
from ...export import Columns
from ...results import Result
from ..cycles import SCHEMES, motor_torque
from ..hunting import Model
from ..outcome import Outcome
from ..parts.ahead import Moved, ahead
from ..parts.plain_loop import loop_of
from ..servo import Servo

Array = np.ndarray

COLUMNS = ("time_s", "position_rad", "velocity_rad_per_s", "integral_rad_s", "torque_Nm", "mode")
"""Columns of the table of a motion; for LuGre bristle_rad stands before the torque."""
STATES = ("x1", "x2", "x3", "x4")
"""Of a trajectory, by the names of a loop."""
PEAK_POINTS = 16
"""Points of an interval at which its torque is looked at: a peak between two of them is missed by 1e-3 of its size at
most, where the interval is half a swing."""


@dataclass(frozen=True, repr=False)
class Happening(Result):
    """An event of a motion.

    Attributes
    ----------
    time : [s].
    name : "stop", "breakaway+", "breakaway-" (Switch), "reversal", "centre" (LuGre), "band", "slip+", "slip-",
        "stick" (Switch with a stick band).
    before, after : modes.  A stop that is followed by a slip is a reversal without stick.
    error : estimated error of the time [s]; nan where the coarser motion did not have the same events.
    """

    _quantities = ("name", "time [s] +- error", "before", "after")

    time: float
    name: str
    before: str
    after: str
    error: float


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Result):
    """A simulated motion.

    Attributes
    ----------
    model, servo, gain, set_point : the problem; set point theta_d [rad].
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

    Examples
    --------
    >>> from casahunt import Servo, simulate
    >>> motion = simulate(Servo(), "switch", 0.04, time=20.0)
    >>> motion.events[0].name, round(motion.events[0].time, 3)  # s
    ('stop', 0.566)
    >>> motion.sample([10.0]).shape
    (3, 1)
    """

    _quantities = (
        "model", "gain [V/rad]", "set_point [rad]", "duration [s]", "number_of_events = events.size", "time_error [s]",
        "end_error", "status",
    )  # fmt: skip
    _details = (
        "servo", "time = duration [s]", "tol", "verdict = verdict.kind", "reason = verdict.sentence",
        "amplitude = verdict.amplitude [rad]", "period = verdict.period [s]", "pattern = verdict.pattern", "end",
        "peak_torque [N m]", "peak_voltage [V]", "state_errors", "intervals = modes.size", "wall_s [s]",
    )  # fmt: skip

    model: Model
    servo: Servo
    gain: float
    set_point: float
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
        return Scheme.of(*SCHEMES[self.model])

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

    @cached_property
    def peak_torque(self) -> float:
        """The largest |m| of the motor [N m], at points `PEAK_POINTS` to an interval."""
        return float(np.abs(self.torque(self.dense(PEAK_POINTS)[1])).max())

    @property
    def peak_voltage(self) -> float:
        """The largest |voltage| [V]: that of the largest torque."""
        return self.peak_torque / self.servo.motor_gain

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
    def verdict(self) -> Outcome:
        """What becomes of the motion: hunting, decaying, growing, at rest or undecided."""
        loop = loop_of(self.servo, self.model, self.gain)
        order = [STATES.index(name) for name in loop.system.states]
        return ahead(loop, Moved(self.times, self.states[order], self.state_errors[order]))

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return float(self.times[-1])

    def table(self, times: Array | None = None) -> Columns:
        """The motion as columns: `COLUMNS`; for LuGre bristle_rad stands before the torque.

        Parameters
        ----------
        times
            (m,) [s]; default: dense where the motion is fast.
        """
        t, x = self.dense() if times is None else (times, self.sample(times))
        numbers = (t, self.set_point + x[0], *x[1:], self.torque(x))
        names = [*COLUMNS[:4], *(["bristle_rad"] if len(x) > 3 else []), *COLUMNS[4:]]
        return dict(zip(names, (*numbers, self.mode_at(t)), strict=True))

    def _columns(self) -> Columns:
        return self.table()

    def _more(self) -> dict[str, Any]:
        x, seen = self.end, self.verdict
        return {
            "ahead": {"swings": seen.swings, "lasts": seen.lasts, "followed_for": seen.behind, "waits": seen.waits},
            "rests_since": seen.rests_since,
            "position": self.set_point + x[0],
            "velocity": x[1],
            "integral": x[2],
            "bristle": x[3] if x.size > 3 else None,
            "events": [(e.time, e.name, e.before, e.after, e.error) for e in self.events],
            "ended": self.ended or None,
        }
