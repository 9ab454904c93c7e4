"""Cycles of a servo made of parts, by scipy's solve_ivp and events of its own: nothing of the program.

    J x1'' = m - F - k (x1 - phi) - d (x1' - phi'),   JL phi'' = k (x1 - phi) + d (x1' - phi')
    u = -(kp x1 + kd r + ki x3),   r = x1' or (x1 - f)/Tf with Tf f' = x1 - f,   |m| = min(|u|, M)
    x3' = x1; at the limit 0 (clamping) or x1 + (u - m)/(ki T) (back calculation)

F = g(v) of the direction, stuck where x1' = 0 and -Fs_back <= pull <= Fs.  A motion is followed until its breakaways
nearly repeat, and from there on to where Steffensen's method sees it go.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray
Curve = Callable[[float], float]

RTOL, ATOL = 1e-12, 1e-15
REPEATS, NEARLY, PATTERN = 1e-10, 1e-2, 6
"""How well a cycle closes, as a part of the states' sizes, and a motion before; breakaways in a period at most."""
MOST_LEAPS, MOST_PHASES = 40, 1000


@dataclass
class PartMotion:
    """A servo of parts.

    curve: friction at |v| of either direction; static: breakaway of either; gains: kp, kd, ki in torque; shaft: load
    inertia, stiffness, damping; filter_time, limit, unwinding: None for none (clamping: 0).
    """

    inertia: float
    curve: tuple[Curve, Curve]
    static: tuple[float, float]
    gains: tuple[float, float, float]
    shaft: tuple[float, float, float] | None = None
    filter_time: float | None = None
    limit: float = math.inf
    unwinding: float | None = None
    size: Array = field(default_factory=lambda: np.zeros(0), init=False)
    """The largest of each state so far."""

    @property
    def lagging(self) -> int:
        """The place of the filter's state."""
        return 5 if self.shaft else 3

    def rest(self, angle: float) -> Array:
        """The state at rest beside the set point."""
        y = np.zeros(self.lagging + (self.filter_time is not None))
        y[0] = angle
        if self.shaft:
            y[3] = angle
        return y

    def command(self, y: Array) -> float:
        """u."""
        kp, kd, ki = self.gains
        rate = y[1] if self.filter_time is None else (y[0] - y[self.lagging]) / self.filter_time
        return float(-(kp * y[0] + kd * rate + ki * y[2]))

    def pull(self, y: Array, at: int) -> float:
        """What pulls at the motor, the torque at its upper limit (+1), its lower one (-1) or free (0)."""
        m = at * self.limit if at else self.command(y)
        if self.shaft:
            _, k, d = self.shaft
            m -= k * (y[0] - y[3]) + d * (y[1] - y[4])
        return m

    def field(self, sign: int, at: int) -> Callable[[float, Array], Array]:
        """The motion in a slip with a sign, or stuck: 0."""

        def rates(t: float, y: Array) -> Array:
            out, v = np.zeros(y.size), y[1]
            if sign:
                force = sign * self.curve[0 if sign > 0 else 1](sign * v)
                out[:2] = v, (self.pull(y, at) - force) / self.inertia
            if not at:
                out[2] = y[0]
            elif self.unwinding is None:
                out[2] = y[0]
            elif self.unwinding:
                out[2] = y[0] + (self.command(y) - at * self.limit) / (self.gains[2] * self.unwinding)
            if self.shaft:
                JL, k, d = self.shaft
                out[3:5] = y[4], (k * (y[0] - y[3]) + d * (v - y[4])) / JL
            if self.filter_time is not None:
                out[self.lagging] = (y[0] - y[self.lagging]) / self.filter_time
            return out

        return rates

    def edges(self, sign: int, at: int) -> list[tuple[str, Callable[[Array], float], int]]:
        """(what happens, scalar, direction of its crossing)."""
        out: list[tuple[str, Callable[[Array], float], int]] = []
        if sign:
            out.append(("stop", lambda y: float(y[1]), -sign))
        else:
            out.append(("+", lambda y: self.pull(y, at) - self.static[0], +1))
            out.append(("-", lambda y: self.pull(y, at) + self.static[1], -1))
        if math.isfinite(self.limit):
            if at:
                out.append(("free", lambda y: at * self.command(y) - self.limit, -1))
            else:
                out.append(("upper", lambda y: self.command(y) - self.limit, +1))
                out.append(("lower", lambda y: self.command(y) + self.limit, -1))
        return out

    def cycle(self, y: Array, longest: float) -> tuple[float, float, int]:
        """(period, amplitude, breakaways in a period) of the cycle that a motion settles on.

        longest: time in which it settles, and of a phase.  Raises RuntimeError: it settles on none.
        """
        at = 0 if abs(self.command(y)) < self.limit else int(np.sign(self.command(y)))
        t, now, seen = 0.0, (self.sign(y, at), at), [np.append(y, 0.0)]
        self.size = np.abs(y)
        while t < longest:
            lasted, y, now, swing = self.to_breakaway(y, now, longest)
            t, seen = t + lasted, [*seen, np.append(y, 3.0 * now[0] + now[1])]
            n = repeats(seen, np.append(self.size, 1.0), NEARLY)
            if n:
                return self.closed(y, now, n, longest)
        raise RuntimeError("it settles on no cycle")

    def closed(self, y: Array, now: tuple[int, int], n: int, longest: float) -> tuple[float, float, int]:
        """The cycle next to a state of n breakaways."""
        for _ in range(MOST_LEAPS):
            states, T, a = [y], 0.0, 0.0
            for _ in range(2):
                T, a = 0.0, 0.0
                for _ in range(n):
                    lasted, y, now, swing = self.to_breakaway(y, now, longest)
                    T, a = T + lasted, max(a, swing)
                states.append(y)
            first, second = ((after - before) / (self.size + 1e-300) for before, after in itertools.pairwise(states))
            if np.abs(second).max() < REPEATS:
                return T, a, n
            factor = min(max(float(first @ second) / float(first @ first), -1.5), 0.99)
            y = y + factor / (1 - factor) * (states[2] - states[1])
        raise RuntimeError("the cycle does not close")

    def to_breakaway(
        self, y: Array, now: tuple[int, int], longest: float
    ) -> tuple[float, Array, tuple[int, int], float]:
        """(time, state, (sign, at), largest |x1| at a stop) of the motion up to the next breakaway."""
        (sign, at), t, swing = now, 0.0, 0.0
        for _ in range(MOST_PHASES):
            lasted, y, what = self.phase(y, sign, at, longest)
            t += lasted
            if what == "stop":
                y[1], swing = 0.0, max(swing, abs(float(y[0])))
                sign = self.sign(y, at)
            elif what in "+-":
                return t, y, ((1 if what == "+" else -1), at), swing
            else:
                at = {"upper": 1, "lower": -1, "free": 0}[what]
        raise RuntimeError("it never breaks away")

    def sign(self, y: Array, at: int) -> int:
        """Of the motion that starts at rest."""
        pull = self.pull(y, at)
        return 1 if pull > self.static[0] else -1 if pull < -self.static[1] else 0

    def phase(self, y: Array, sign: int, at: int, longest: float) -> tuple[float, Array, str]:
        """(time, state, what happened) at the end of a phase."""
        edges = self.edges(sign, at)
        run = solve_ivp(self.field(sign, at), (0.0, longest), y, "DOP853", rtol=RTOL, atol=ATOL,
                        events=[ends(function, way) for _, function, way in edges])  # fmt: skip
        self.size = np.maximum(self.size, np.abs(run.y).max(axis=1))
        for (what, _, _), times, states in zip(edges, run.t_events, run.y_events, strict=True):
            if times.size:
                return float(times[0]), np.array(states[0]), what
        raise RuntimeError("a phase has no end")


def repeats(seen: list[Array], size: Array, within: float) -> int:
    """After how many breakaways the state is the same again, three times; 0 for none."""
    states = np.array(seen[-1 - 3 * PATTERN :]) / (size + 1e-300)
    for n in range(1, PATTERN + 1):
        if len(states) > 3 * n and all(np.abs(states[-1] - states[-1 - j * n]).max() < within for j in (1, 2, 3)):
            return n
    return 0


def ends(function: Callable[[Array], float], way: int) -> Any:
    """An event of solve_ivp that ends it; at the start of a phase it has not come."""

    def event(t: float, y: Array) -> float:
        return function(y)

    event.terminal, event.direction = True, way  # type: ignore[attr-defined]
    return event
