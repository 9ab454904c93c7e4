"""A motion of a loop as data; what becomes of it is seen by following it on (parts/ahead.py).

The engine has followed it (motion/simulation.py), twice, as simulate.py says: inside an interval it is its collocation
polynomial.  Its states are told with x1 = theta - theta_d [rad], x2 = theta' [rad/s] and x3, the integral of x1
[rad s], first, where the loop has them; x4 is LuGre's bristle [rad].

Symbols: n states, N + 1 ends of intervals, m samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..axis_units import in_its_units, suffix
from ..errors import InputError, Status
from ..export import Columns
from ..motion import Motion
from ..results import Result
from .move import Move, moving
from .outcome import Outcome
from .parts.ahead import Moved, ahead
from .parts.loop import Loop
from .parts.plain_loop import LoopResult

Array = np.ndarray

FIRST_STATES = ("x1", "x2", "x3")
"""Position and velocity of the motor, and the integral: the states that are told first."""
STATE_NAMES = {"x2": "velocity", "x3": "integral", "x4": "bristle"}
"""Columns of the table of a motion, by states; any other state has its own name, from the set point if it is an
angle."""
PEAK_POINTS = 16
"""Points of an interval at which its torque is looked at: a peak between two of them is missed by 1e-3 of its size at
most, where the interval is half a swing."""


def told_first(names: Sequence[str]) -> tuple[str, ...]:
    """States in the order in which they are told."""
    first = [name for name in FIRST_STATES if name in names]
    return (*first, *(name for name in names if name not in first))


def named_columns(loop: Loop, states: Mapping[str, Array], names: Mapping[str, str]) -> Columns:
    """States as columns, with the units of a loop; names: of those that are not called as they are."""
    return {names.get(state, state) + suffix(loop.unit_of(state)): values for state, values in states.items()}


@dataclass(frozen=True, repr=False)
class Happening(Result):
    """An event of a motion.

    Attributes
    ----------
    time : [s].
    name : such as "stop", "breakaway+", "breakaway-" (Switch), "reversal", "centre" (LuGre).
    before, after : modes.  A stop that is followed by a slip is a reversal without stick.
    error : estimated error of the time [s]; nan where the coarser motion has no such event.
    """

    _quantities = ("name", "time [s] +- error", "before", "after")

    time: float
    name: str
    before: str
    after: str
    error: float


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(LoopResult):
    """A simulated motion.

    Attributes
    ----------
    loop, set_point : the loop; set point theta_d [rad].
    duration : length of the motion [s].
    motion : as the engine has it, whose phases sum up to that but for rounding.
    events : in order.
    tol : the tolerance asked for.
    time_error : estimated largest error of an event time [s].
    end_error : estimated error of the states at the end, each relative to its largest value in the motion.
    state_errors : (n,) estimated largest error of each state at any time, in its own unit.
    status : CONVERGED where time_error and end_error are at most `tol`.
    ended : why the motion was not followed to the time asked for; "" where it was.
    wall_s : time to compute it [s].
    move : the profile of the set point; None where it is at theta_d from the start.

    Examples
    --------
    >>> from casahunt import Servo, simulate
    >>> motion = simulate(Servo(), "switch", 0.04, time=20.0)
    >>> motion.events[0].name, round(motion.events[0].time, 3)  # s
    ('stop', 0.566)
    >>> motion.names, motion.sample([10.0]).shape
    (('x1', 'x2', 'x3'), (3, 1))
    """

    _quantities = (
        "model", "gain [V/rad]", "set_point [rad]", "duration [s]", "number_of_events = events.size", "time_error [s]",
        "end_error", "status",
    )  # fmt: skip
    _details = (
        "parts", "time = duration [s]", "tol", "verdict = verdict.kind", "reason = verdict.sentence",
        "amplitude = verdict.amplitude [rad]", "period = verdict.period [s]", "pattern = verdict.pattern",
        "peak_torque [N m]", "peak_voltage [V]", "intervals", "wall_s [s]", "move",
    )  # fmt: skip

    loop: Loop
    set_point: float
    duration: float
    motion: Motion
    events: tuple[Happening, ...]
    tol: float
    time_error: float
    end_error: float
    state_errors: Array
    status: Status
    ended: str
    wall_s: float
    move: Move | None = None

    @property
    def error_estimate(self) -> float:
        """The larger one of time_error [s] and end_error."""
        return max(self.time_error, self.end_error)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the n states."""
        return told_first(self.loop.system.states)

    @cached_property
    def _order(self) -> list[int]:
        return [self.motion.system.states.index(name) for name in self.names]

    @property
    def distance(self) -> float:
        """How far theta_d is from the start [rad]."""
        return -float(self.motion.phases[0].start[self._order[0]])

    @cached_property
    def moving(self) -> Loop:
        """The loop with its move."""
        return moving(self.loop, self.move, self.distance)

    @property
    def intervals(self) -> int:
        """N, of the mesh."""
        return sum(len(phase.w) for phase in self.motion.phases)

    @property
    def times(self) -> Array:
        """(N + 1,) ends of intervals [s]."""
        return self.dense(1)[0]

    @property
    def states(self) -> Array:
        """(n, N + 1) states there."""
        return self.dense(1)[1]

    @property
    def end(self) -> Array:
        """(n,) state at the end."""
        return self.motion.phases[-1].end[self._order]

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
        return self.motion.at(self._inside(times))[self._order]

    def _inside(self, times: Array) -> Array:
        t = np.asarray(times, float).ravel()
        outside = ~((t >= 0) & (t <= self.duration))
        if outside.any():
            raise InputError(f"time = {t[outside][0]!r}: must lie between 0 and {self.duration:.6g} s")
        return t

    def dense(self, per_interval: int = 4) -> tuple[Array, Array]:
        """Times (m,) and states (n, m), dense where the motion is fast; at an event, those behind it."""
        times, states = self.motion.sample(per_interval)
        kept, times = np.append(np.diff(times) > 0, True), np.minimum(times, self.duration)
        times[-1] = self.duration
        return times[kept], states[self._order][:, kept]

    def mode_at(self, times: Array) -> list[str]:
        """Names of the modes at times (m,) [s]; at an event, of that behind it."""
        return [self.motion.phases[k].mode for k in self.motion.phase_at(self._inside(times))]

    def signal(self, name: str, times: Array) -> Array:
        """A signal of the loop.

        Parameters
        ----------
        name
            such as "torque" [N m], or "moving": 0 where the motor sticks.
        times
            (m,) [s].

        Returns
        -------
        (m,); at an event, that behind it.
        """
        return self.moving.along(name, self.motion, self._inside(times))

    @cached_property
    def peak_torque(self) -> float:
        """The largest |m| of the motor [N m], at points `PEAK_POINTS` to an interval."""
        return float(np.abs(self.signal("torque", self.dense(PEAK_POINTS)[0])).max())

    @property
    def peak_voltage(self) -> float:
        """The largest |voltage| [V]: that of the largest torque; nan where the motor has no gain."""
        return self.peak_torque / self.loop.parameters.get("motor_gain", np.nan)

    @property
    def sticks(self) -> list[tuple[float, float]]:
        """From when to when the motor sticks [s]: where a mode lets it."""
        ends = np.cumsum([0.0, *(phase.duration for phase in self.motion.phases)])
        stuck = [self.moving.signal("moving", each.mode, each.start[:, None])[0] == 0 for each in self.motion.phases]
        return [(a, b) for a, b, at in zip(ends[:-1], ends[1:], stuck, strict=True) if at]

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
    @in_its_units
    def verdict(self) -> Outcome:
        """What becomes of the motion: hunting, decaying, growing, at rest or undecided."""
        (times, states), names = self.motion.sample(1), self.loop.system.states
        errors = dict(zip(self.names, self.state_errors.tolist(), strict=True))
        kept = [self.motion.system.states.index(name) for name in names]
        last = self.motion.phases[-1].mode
        mode = last if last in self.loop.system.vector_form.modes else ""  # what was thrown out may not have arrived
        return ahead(self.loop, Moved(times, states[kept], np.array([errors[name] for name in names]), mode))

    def table(self, times: Array | None = None) -> Columns:
        """The motion as columns: time_s, position_rad, the other states (`STATE_NAMES`), torque_Nm, mode.

        Parameters
        ----------
        times
            (m,) [s]; default: dense where the motion is fast.
        """
        t, x = self.dense() if times is None else (np.asarray(times, float), self.sample(times))
        states = dict(zip(self.names, x, strict=True))
        first = {"time_s": t, "position_rad": self.set_point + states.pop("x1")}
        named = named_columns(self.loop, states, STATE_NAMES)
        if self.move is not None:
            first["set_point_rad"] = self.set_point - self.signal("remaining", t)
        return {**first, **named, "torque_Nm": self.signal("torque", t), "mode": self.mode_at(t)}

    def _columns(self) -> Columns:
        return self.table()

    def _more(self) -> dict[str, Any]:
        end, seen = dict(zip(self.names, self.end.tolist(), strict=True)), self.verdict
        return {
            "parameters": self.loop.parameters,
            "ahead": {"swings": seen.swings, "lasts": seen.lasts, "followed_for": seen.behind, "waits": seen.waits},
            "rests_since": seen.rests_since,
            "position": self.set_point + end["x1"],
            "velocity": end["x2"],
            "integral": end.get("x3"),
            "bristle": end.get("x4"),
            "start": dict(zip(self.names, self.sample(np.zeros(1))[:, 0].tolist(), strict=True)),
            "end": end,
            "state_errors": dict(zip(self.names, self.state_errors.tolist(), strict=True)),
            "events": [(e.time, e.name, e.before, e.after, e.error) for e in self.events],
            "ended": self.ended or None,
        }
