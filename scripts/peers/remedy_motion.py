"""Motions of a servo with Switch friction and a remedy, by scipy's solve_ivp with events: nothing of the program.

    J x1'' = m - F,   m = -(kp e + kd e' + ki x3),   x3' = input(e) - leak x3;   stuck where x1' = 0 and |m| <= Fs

The swings are |x1| where x1' = 0.  A servo hunts where they repeat, one by one or in a pattern of up to eight; it does
not where it is stuck for ever, or where they shrink to nothing or grow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from scipy.special import erf

Array = np.ndarray

RTOL = 1e-9
MOST_SWINGS, PATTERN, REPEATS = 400, 8, 1e-6
"""Swings that are followed; how many a pattern has at most, and how well it repeats."""
LEAST_MOVED = 1e-3
"""Less of a swing than this is a motion that creeps, breaking away and stopping, to where it rests."""
GONE, GROWN = 1e-5, 30.0
"""Swings that are so small a part of the amplitude without a remedy have shrunk to nothing; so many times it, grown."""
FOR_EVER = 1e3
"""A phase that lasts for so many periods of the hunting without the remedy lasts for ever."""
STARTS = tuple(np.geomspace(1e-3, 5.0, 24).tolist())
"""Starts at the brink of breaking away, so many amplitudes beside the set point."""

BANDS, BESIDE_BAND = ("dead band", "shifted dead band", "hysteresis"), (1.0001, 1.001, 1.004, 1.01, 1.03, 1.1)
"""Remedies within whose size nothing is left; starts beside that, as parts of it."""


@dataclass
class RemedyMotion:
    """A servo with a remedy.

    servo: J, Fs, Fc, vs, b; gains: kp, kd, ki in torque; amplitude, period: of the hunting without the remedy.
    """

    servo: dict[str, float]
    gains: tuple[float, float, float]
    remedy: str
    size: float
    amplitude: float
    period: float
    enter_ratio: float = 0.5
    inside: bool = field(default=False, init=False)
    """Of the hysteresis: whether the integrator stands."""

    def error(self, y: Array) -> tuple[float, float]:
        """e, e'."""
        if self.remedy == "error filter":
            return y[3], (y[0] - y[3]) / self.size
        if self.remedy == "error dead band":
            return (math.copysign(abs(y[0]) - self.size, y[0]), y[1]) if abs(y[0]) > self.size else (0.0, 0.0)
        return y[0], y[1]

    def input(self, e: float) -> float:
        """What is integrated."""
        if self.remedy == "dead band":
            return e if abs(e) > self.size else 0.0
        if self.remedy == "shifted dead band":
            return math.copysign(abs(e) - self.size, e) if abs(e) > self.size else 0.0
        if self.remedy == "hysteresis":
            return 0.0 if self.inside else e
        return e

    def torque(self, y: Array) -> float:
        """m."""
        (kp, kd, ki), (e, rate) = self.gains, self.error(y)
        return -(kp * e + kd * rate + ki * y[2])

    def friction(self, v: float, sign: float) -> float:
        """F of a slip with this sign; with dither the mean over a normal distribution of rates."""
        Fs, Fc, vs, b = (self.servo[name] for name in ("Fs", "Fc", "vs", "b"))
        if self.remedy == "dither":
            c = vs / math.hypot(vs, math.sqrt(2) * self.size)
            reach = v / (self.size * math.sqrt(2))
            return float(Fc * erf(reach) + (Fs - Fc) * c * math.exp(-((c * v / vs) ** 2)) * erf(c * reach) + b * v)
        drive = self.size * Fc if self.remedy == "feedforward" else 0.0
        return sign * (Fc + (Fs - Fc) * math.exp(-((v / vs) ** 2)) - drive) + b * v

    def field(self, sign: float) -> Callable[[float, Array], list[float]]:
        """The motion in a slip with a sign, or stuck: 0."""
        leak = self.size if self.remedy == "leak" else 0.0

        def rates(t: float, y: Array) -> list[float]:
            e, _ = self.error(y)
            v = y[1] if sign else 0.0
            a = (self.torque(y) - self.friction(v, sign)) / self.servo["J"] if sign else 0.0
            out = [v, a, self.input(e) - leak * y[2]]
            return [*out, (y[0] - y[3]) / self.size] if self.remedy == "error filter" else out

        return rates

    def edges(self) -> list[tuple[Callable[[float, Array], float], float]]:
        """Where the remedy changes: (scalar, direction of its crossing)."""
        if self.remedy == "hysteresis":
            bound = self.size if self.inside else self.enter_ratio * self.size
            return [(lambda t, y: abs(y[0]) - bound, +1.0 if self.inside else -1.0)]
        if "dead band" in self.remedy:
            return [(lambda t, y: abs(y[0]) - self.size, 0.0)]
        if self.remedy == "reset":
            return [(lambda t, y: y[0], 0.0)]
        return []

    def changed(self, y: Array) -> Array:
        """Behind an edge."""
        if self.remedy == "hysteresis":
            self.inside = not self.inside
        return y * np.array([1.0, 1.0, self.size]) if self.remedy == "reset" else y

    def stuck(self, y: Array) -> tuple[Array, float] | None:
        """(where it breaks away, the sign of the slip), or None: never."""
        Fs, for_ever = self.servo["Fs"], FOR_EVER * self.period
        forward, back = (lambda t, y: self.torque(y) - Fs), (lambda t, y: self.torque(y) + Fs)
        begun, event = self.torque(y), [_ends(forward, +1), _ends(back, -1)]
        if abs(begun) > Fs * (1 - 1e-12):
            ahead = y + 1e-6 * self.period * np.array(self.field(0.0)(0.0, y))
            if abs(self.torque(ahead)) > Fs:
                return y, math.copysign(1.0, begun)
        longest = self.size if self.remedy == "freeze" else for_ever
        steps = {} if self.remedy in ("error filter", "leak") else {"max_step": math.inf, "first_step": longest / 8}
        run = solve_ivp(self.field(0.0), (0.0, longest), y, "RK45", events=event, rtol=RTOL, atol=1e-14, **steps)
        if not any(t.size for t in run.t_events):
            return None
        return run.y[:, -1], 1.0 if run.t_events[0].size else -1.0

    def slips(self, y: Array, sign: float) -> Array | None:
        """Where x1' is zero again; None: never."""
        left = FOR_EVER * self.period
        while left > 0:
            at_rest = _ends(lambda t, y: y[1] if t > 0 else sign, -sign)
            edges = [_ends(function, direction) for function, direction in self.edges()]
            v = self.servo["vs"]
            run = solve_ivp(
                self.field(sign), (0.0, left), y, "LSODA", events=[at_rest, *edges], rtol=RTOL,
                atol=[1e-11 * self.amplitude, 1e-11 * v, 1e-11 * self.amplitude * self.period,
                      1e-11 * self.amplitude][: y.size],
            )  # fmt: skip
            y, left = run.y[:, -1], left - run.t[-1]
            if run.t_events[0].size:
                y[1] = 0.0
                return y
            if not any(t.size for t in run.t_events):
                return None
            y = self.changed(y)
            beyond = max(1e-9 * left, 1e-12)
            y = solve_ivp(self.field(sign), (0.0, beyond), y, "RK45", rtol=RTOL).y[:, -1]  # away from the edge
            if sign * y[1] <= 0:
                y[1] = 0.0
                return y
        return None

    def verdict(self, y: Array) -> str:
        """Of the motion from a state at rest: "hunts", "rests", "decays", "grows", "undecided"."""
        swings: list[float] = []
        for _ in range(MOST_SWINGS):
            sign = math.copysign(1.0, self.torque(y))
            if self.remedy != "dither":
                away = self.stuck(y) if abs(self.torque(y)) <= self.servo["Fs"] * (1 + 1e-12) else (y, sign)
                if away is None:
                    return "rests"
                y, sign = away
            ended = self.slips(y, sign)
            if ended is None:
                return "decays"
            y = ended
            swings.append(float(y[0]))
            if abs(swings[-1]) < GONE * self.amplitude:
                return "decays"
            if abs(swings[-1]) > GROWN * max(self.amplitude, abs(swings[0])):
                return "grows"
            if repeats(swings):
                return "hunts"
        return "undecided"

    def at_brink(self, start: float) -> Array:
        """The state so many amplitudes beside the set point that is about to break away."""
        y = np.zeros(4 if self.remedy == "error filter" else 3)
        y[0] = -start * self.amplitude
        if y.size == 4:
            y[3] = y[0]
        y[2] = -(self.servo["Fs"] * (1 - 1e-9) + self.gains[0] * self.error(y)[0]) / self.gains[2]
        self.inside = self.remedy == "hysteresis" and abs(y[0]) <= self.enter_ratio * self.size
        return y

    def growth(self, start: float) -> float:
        """The first swing beyond the set point, as a part of the start."""
        y = self.slips(self.at_brink(start), 1.0)
        return -1.0 if y is None else float(y[0]) / (start * self.amplitude)

    def largest_growth(self) -> float:
        """The start whose first swing is the largest part of it."""
        seen = [self.growth(start) for start in STARTS]
        k = int(np.argmax(seen))
        bounds = STARTS[max(k - 1, 0)], STARTS[min(k + 1, len(STARTS) - 1)]
        best = minimize_scalar(lambda a: -self.growth(a), bounds=bounds, method="bounded", options={"maxiter": 30})
        return float(best.x) if -best.fun > seen[k] else STARTS[k]

    def hunts(self) -> tuple[bool | None, list[str]]:
        """(whether it hunts from any start; None where that is not clear, what became of the starts)."""
        said: list[str] = []
        beside = [self.size / self.amplitude * k for k in BESIDE_BAND] if self.remedy in BANDS else []
        for start in (self.largest_growth(), *beside, *STARTS[::-1]):
            said.append(self.verdict(self.at_brink(start)))
            if said[-1] == "hunts":
                return True, said
        return (None if "undecided" in said else False), said


def repeats(swings: Sequence[float]) -> bool:
    """Whether the last swings are a pattern that has come three times, or its mirror image, and move."""
    for n in range(1, PATTERN + 1):
        if len(swings) >= max(3 * n, 12):
            last, before, first = (np.array(swings[len(swings) - (k + 1) * n : len(swings) - k * n]) for k in range(3))
            for mirror in (1.0, -1.0):
                near = REPEATS * np.abs(last)
                if np.all(np.abs(last - mirror * before) < near) and np.all(np.abs(last - first) < near):
                    return bool(np.ptp([*last, *before]) > LEAST_MOVED * np.abs(last).max())
    return False


def _ends(function: Callable[[float, Array], float], direction: float) -> Any:
    """An event of solve_ivp that ends it."""

    def event(t: float, y: Array) -> float:
        return function(t, y)

    event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
    return event
