"""Motions of a servo with Switch friction and a remedy, by Taylor series (heyoka, extra `bench`).

    J x1'' = m - F,   m = -(kp e + kd e' + ki x3),   x3' = input(e) - leak x3;   stuck where x1' = 0 and |m| <= Fs

in units of the amplitude A without the remedy, of t0 = sqrt(J/kp) and of the torque kp A.  Within a slip x1 goes one
way, so that the edges of a remedy are met in order; in each piece of it

    e = slope x1 + offset (the filter: its own state),   input = share e + beside,   F = s g(v) + b v

and a stick has a closed form.  The swings are |x1| where x1' = 0.  A servo hunts where they repeat, one by one or in a
pattern of up to eight; it does not where it is stuck for ever, or where they shrink to nothing or grow.

P(a) is where the slip from breakaway at x1 = -a ends in a stick; motions start beside its fixed points, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

Array = np.ndarray

MOST_SWINGS, PATTERN, REPEATS = 3000, 8, 1e-6
"""Swings that are followed; how many a pattern has at most, and how well it repeats."""
LEAST_MOVED = 1e-3
"""Less of a swing than this is a motion that creeps, breaking away and stopping, to where it rests."""
STANDS = 1e-13
"""Less is rounding: it creeps to the edge of a band, breaking away and stopping ever nearer to it."""
IRREGULAR = 0.1
"""Swings that differ by more than this part for ever repeat in no pattern, and do not end."""
GONE, GROWN = 1e-5, 30.0
"""Swings that are so small a part of the amplitude without a remedy have shrunk to nothing; so many times it, grown."""
FOR_EVER = 1e3
"""A phase that lasts for so many periods of the hunting without the remedy lasts for ever."""
STARTS = tuple(np.geomspace(2e-3, 5.0, 14).tolist())
"""Starts at the brink of breaking away, so many amplitudes beside the set point."""
BANDS, BESIDE_BAND = ("dead band", "shifted dead band", "hysteresis"), (1.0001, 1.001, 1.004, 1.01, 1.03, 1.1)
"""Remedies within whose size nothing is left; starts beside that, as parts of it."""
BESIDE_CYCLE = (0.98, 1.005)
"""Starts beside a fixed point of P: on it motions stay, whether or not it attracts."""
FAR = 6.1
"""Speed in vs from which exp(-(v/vs)^2) is below the last digit: a step from there would not see the drop."""
AT_REST = 1e-4
"""A slip so near to where it rests, at a torque and a speed so small, has no swing left; in parts of its start."""
CHUNK, MOST_STEPS = 50, 20_000
"""Steps between two looks at a slip, and most of them."""
MAP_POINTS, NARROWED = 120, 60
"""Points at which P(a) is looked at, and evaluations that narrow its largest surplus down."""
BESIDE_EDGE, FIXED = 1e-7, 1e-6
"""Nearer to an edge, as a part of it, an event there is lost; at a fixed point of P, not where it jumps, it is this
near to it."""
NEVER = 1e7
"""An edge so far away is none."""


@lru_cache(maxsize=3)
def _pieces(kind: str) -> tuple[Any, Any]:
    """Integrators of a piece of a slip: a first step without an eye on the speed, and one that ends at v = 0."""
    import heyoka as hy

    x, v, w, f = hy.make_vars("x", "v", "w", "f")
    kd, ki, Fc, drop, vs, b, s, slope, offset = (hy.par[i] for i in range(9))
    share, beside, leak, edge, far, near, T, a = (hy.par[i] for i in range(9, 17))
    e, rate = slope * x + offset, slope * v
    if kind == "filtered":
        e, rate = f, (x - f) / T
    friction = s * (Fc + drop * hy.exp(-(v / vs) * (v / vs)))
    if kind == "dithered":
        c, reach = vs / hy.sqrt(vs * vs + 2.0 * a * a), v / (a * math.sqrt(2.0))
        friction = Fc * hy.erf(reach) + drop * c * hy.exp(-(c * v / vs) * (c * v / vs)) * hy.erf(c * reach)
    system = [(x, v), (v, -(e + kd * rate + ki * w) - friction - b * v), (w, share * e + beside - leak * w)]
    if kind == "filtered":
        system.append((f, (x - f) / T))
    down, up = hy.event_direction.negative, hy.event_direction.positive
    events = [
        hy.t_event(s * v, direction=down), hy.t_event(s * (x - edge), direction=up),
        hy.t_event(s * v - far, direction=down, callback=lambda *_: True),
        hy.t_event(s * v - near, direction=down, callback=lambda *_: True),
    ]  # fmt: skip
    first, seeing = (
        hy.taylor_adaptive(system, state=[0.0] * len(system), tol=1e-15, t_events=seen)
        for seen in ([], events)
    )
    return first, seeing


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
    hunted: Array | None = field(default=None, init=False)
    """Where a motion that hunts has just stopped."""

    def __post_init__(self) -> None:
        (kp, kd, ki), J, A = self.gains, self.servo["J"], self.amplitude
        t0 = math.sqrt(J / kp)
        self.kd, self.ki, self.for_ever = kd / (kp * t0), ki * t0 / kp, FOR_EVER * self.period / t0
        self.Fs, self.Fc = self.servo["Fs"] / (kp * A), self.servo["Fc"] / (kp * A)
        self.drop, self.vs, self.b = self.Fs - self.Fc, self.servo["vs"] * t0 / A, self.servo["b"] / (kp * t0)
        units = {"leak": 1 / t0, "freeze": t0, "error filter": t0, "dither": A / t0, "reset": 1.0, "feedforward": 1.0}
        self.scaled = self.size / units.get(self.remedy, A)
        self.kind = {"error filter": "filtered", "dither": "dithered"}.get(self.remedy, "plain")
        if self.remedy == "feedforward":
            self.Fc *= 1 - self.size

    def error(self, x: float) -> tuple[float, float]:
        """(slope, offset) of e in x1."""
        if self.remedy != "error dead band":
            return 1.0, 0.0
        return (1.0, -math.copysign(self.scaled, x)) if abs(x) > self.scaled else (0.0, 0.0)

    def input(self, x: float) -> tuple[float, float]:
        """(share, beside) of what is integrated, in e."""
        if self.remedy == "hysteresis":
            return (0.0 if self.inside else 1.0), 0.0
        if self.remedy in ("dead band", "shifted dead band") and abs(x) <= self.scaled:
            return 0.0, 0.0
        return 1.0, -math.copysign(self.scaled, x) if self.remedy == "shifted dead band" else 0.0

    def edge(self, x: float, sign: float) -> float:
        """Where the remedy changes next, for a motion from x1 with this sign; NEVER if nowhere."""
        if self.remedy == "hysteresis":
            places = (self.scaled,) if self.inside else (-self.enter_ratio * self.scaled,)
        elif "dead band" in self.remedy:
            places = -self.scaled, self.scaled
        else:
            places = (0.0,) if self.remedy == "reset" else ()
        return sign * next((place for place in places if sign * x < place), NEVER)

    def torque(self, y: Array) -> float:
        """m at rest."""
        e = y[3] if self.kind == "filtered" else float(np.dot(self.error(y[0]), (y[0], 1.0)))
        rate = (y[0] - y[3]) / self.scaled if self.kind == "filtered" else 0.0
        return float(-(e + self.kd * rate + self.ki * y[2]))

    def stuck(self, y: Array) -> tuple[Array, float] | None:
        """(where it breaks away, the sign of the slip), or None: never."""
        if self.kind == "filtered":
            return self._stuck_filtered(y)
        m, (slope, offset), (share, beside) = self.torque(y), self.error(y[0]), self.input(y[0])
        e = slope * y[0] + offset
        filled, leak = share * e + beside, self.scaled if self.remedy == "leak" else 0.0
        # m' = -ki (filled - leak x3): towards the sign of that, at first and for ever
        falls = self.ki * (filled - leak * y[2])
        if falls == 0:
            return None
        sign = -math.copysign(1.0, falls)
        needed = (sign * self.Fs - m) / -self.ki  # of x3
        if leak:
            part = 1 - leak * needed / (filled - leak * y[2])
            lasts = -math.log(part) / leak if part > 0 else math.inf
        else:
            lasts = needed / filled
        longest = self.scaled if self.remedy == "freeze" else self.for_ever
        if lasts > longest:
            return None
        return np.array([y[0], 0.0, -(e + sign * self.Fs) / self.ki]), sign

    def _stuck_filtered(self, y: Array) -> tuple[Array, float] | None:
        """The filter goes to x1 while the integral grows: m = c0 + c1 t + c2 exp(-t/T), of one extremum at most."""
        T, x, gap = self.scaled, y[0], y[3] - y[0]
        c1, c2 = -self.ki * x, -gap * (1 - self.kd / T - self.ki * T)
        c0 = self.torque(y) - c2

        def m(t: float) -> float:
            return c0 + c1 * t + c2 * math.exp(-t / T)

        turn = -T * math.log(c1 * T / c2) if c1 * c2 > 0 and c1 * T / c2 > 0 else 0.0
        parts = [0.0, turn, self.for_ever] if 0 < turn < self.for_ever else [0.0, self.for_ever]
        for low, high in zip(parts[:-1], parts[1:], strict=True):
            if abs(m(high)) > self.Fs:
                sign = math.copysign(1.0, m(high))
                begun = sign * m(low) >= self.Fs
                t = low if begun else brentq(lambda t, s=sign: s * m(t) - self.Fs, low, high, xtol=1e-15, rtol=1e-14)
                f = x + gap * math.exp(-t / T)
                w = -(sign * self.Fs + f + self.kd * (x - f) / T) / self.ki
                return np.array([x, 0.0, w, f]), sign
        return None

    def slips(self, y: Array, sign: float) -> Array | None:
        """Where x1' is zero again; None: never."""
        first, seeing = _pieces(self.kind)
        start, blind = abs(y[0]) or 1.0, True
        dither = self.scaled * math.sqrt(2) if self.kind == "dithered" else 0.0
        far, near = FAR * math.hypot(self.vs, dither), FAR * dither
        for _ in range(4):
            pars = (self.kd, self.ki, self.Fc, self.drop, self.vs, self.b, sign, *self.error(_ahead(y[0], sign)),
                    *self.input(_ahead(y[0], sign)), self.scaled if self.remedy == "leak" else 0.0,
                    self.edge(y[0], sign), far, near or 2 * far, self.scaled, self.scaled)  # fmt: skip
            if blind:  # v = 0 at the start is no stop
                first.time, first.pars[:], first.state[:] = 0.0, pars[: len(first.pars)], y
                fastest = 1 + self.kd + self.b + self.ki
                first.step(1e-2 / (fastest + (1 / self.scaled if self.kind == "filtered" else 0.0)))
                y, blind = first.state.copy(), False
                if not sign * y[1] > 0:
                    y[1] = 0.0
                    return y
            seeing.time, seeing.pars[:], seeing.state[:] = 0.0, pars[: len(seeing.pars)], y
            seeing.reset_cooldowns()
            outcome = self._followed(seeing, start)
            y = seeing.state.copy()
            if outcome == -1:
                y[1] = 0.0
                return y
            if outcome != -2:
                return None
            y[0] = self.edge(_ahead(y[0], -sign), sign)  # on the edge, not a rounding beside it
            self.inside ^= self.remedy == "hysteresis"
            y[2] *= self.scaled if self.remedy == "reset" else 1.0
        return None

    def _followed(self, seeing: Any, start: float) -> int:
        """Follow a piece; heyoka's outcome, 0 where it never ends."""
        for _ in range(MOST_STEPS // CHUNK):
            outcome = int(seeing.propagate_until(self.for_ever, max_steps=CHUNK)[0])
            if outcome in (-1, -2):
                return outcome
            y = seeing.state
            sizes = abs(y[0]), abs(y[1]) / min(1.0, self.vs), abs(self.torque(y))
            if max(sizes) < AT_REST * start or not abs(y[0]) < NEVER or seeing.time >= self.for_ever:
                return 0
        raise TooLong

    def verdict(self, y: Array) -> str:
        """Of the motion from a state at rest: "hunts", "rests", "decays", "grows", "undecided"."""
        swings: list[float] = []
        try:
            for _ in range(MOST_SWINGS):
                ended = self._next(y)
                if ended is None or isinstance(ended, str):
                    return ended or "decays"
                y = ended
                swings.append(float(y[0]))
                if abs(swings[-1]) < GONE:
                    return "decays"
                if abs(swings[-1]) > GROWN * max(1.0, abs(swings[0])):
                    return "grows"
                if (seen := repeats(swings)) is not None:
                    self.hunted = y
                    return seen
        except TooLong:
            return "undecided"
        sizes = np.abs(swings[-MOST_SWINGS // 3 :])
        return "hunts irregularly" if np.ptp(sizes) > IRREGULAR * sizes.max() else "undecided"

    def _next(self, y: Array) -> Array | str | None:
        """From one place at which x1' = 0 to the next."""
        sign = math.copysign(1.0, self.torque(y))
        if self.kind != "dithered" and abs(self.torque(y)) <= self.Fs * (1 + 1e-12):
            away = self.stuck(y)
            if away is None:
                return "rests"
            y, sign = away
        return self.slips(y, sign)

    def at_brink(self, start: float) -> Array:
        """The state so many amplitudes beside the set point that is about to break away."""
        y = np.zeros(4 if self.kind == "filtered" else 3)
        y[0] = -start
        if y.size == 4:
            y[3] = y[0]
        slope, offset = self.error(y[0])
        y[2] = -(self.Fs * (1 - 1e-9) + slope * y[0] + offset) / self.ki
        self.inside = self.remedy == "hysteresis" and start <= self.enter_ratio * self.scaled
        return y

    def stopped(self, a: float) -> Array | None:
        """Where the slip from breakaway at -a stops; None where it does not."""
        try:
            return self.slips(self.at_brink(a), 1.0)
        except TooLong:
            return None

    def sticks(self, y: Array) -> bool:
        """Whether a slip that stops is stuck there, and breaks away again."""
        return abs(self.torque(y)) <= self.Fs * (1 + 1e-12) and self.stuck(y) is not None

    def surplus(self, a: float) -> float:
        """P(a)/a - 1, whether or not it is stuck there; -1 where it does not stop."""
        y = self.stopped(a)
        return -1.0 if y is None else float(y[0]) / a - 1

    def cycles(self) -> list[float]:
        """Fixed points of P at which it sticks: brackets of a grid, and those beside its largest surpluses."""
        widest = max(10.0, 3 * self.scaled) if self.remedy == "error dead band" else 10.0
        grid = list(np.geomspace(1e-3, widest, MAP_POINTS))
        if self.remedy in BANDS:
            grid = sorted([*grid, *(self.scaled * (1 + k) for k in np.geomspace(BESIDE_EDGE, 1, MAP_POINTS // 2))])
        values = [self.surplus(a) for a in grid]
        for i in range(1, len(values) - 1):
            if max(values[i - 1], values[i + 1]) <= values[i] <= 0:
                best = minimize_scalar(lambda a: -self.surplus(a), bounds=(grid[i - 1], grid[i + 1]), method="bounded",
                                       options={"maxiter": NARROWED, "xatol": 1e-9 * grid[i]})  # fmt: skip
                if -best.fun > 0:
                    grid, values = [*grid, float(best.x)], [*values, -best.fun]
        points = sorted(zip(grid, values, strict=True))
        found = []
        for (a, fa), (b, fb) in zip(points[:-1], points[1:], strict=True):
            if fa * fb < 0:
                root = brentq(self.surplus, a, b, xtol=1e-13 * a, rtol=1e-13)
                y = self.stopped(root * (1 + 1e-12 * (fb > 0)))
                if y is not None and abs(float(y[0]) / root - 1) < FIXED and self.sticks(y):
                    found.append(float(root))
        return found

    def hunts(self, before: Array | None = None) -> tuple[bool | None, list[str]]:
        """(whether it hunts from any start; None where that is not clear, what became of the starts).

        before: where it has just stopped hunting with less of the remedy, a start too.
        """
        said: list[str] = []
        beside = [self.scaled * k for k in BESIDE_BAND] if self.remedy in BANDS else []
        cycles = [] if self.kind != "plain" else [a * side for a in self.cycles() for side in BESIDE_CYCLE]
        points = [*cycles, *beside, *STARTS[::-1]]
        for start in [*([] if before is None else [before]), *points]:
            said.append(self.verdict(self.at_brink(start) if isinstance(start, float) else start))
            if said[-1].startswith("hunts"):
                return True, said
        return (None if "undecided" in said else False), said


class TooLong(Exception):
    """A slip of too many steps."""


def _ahead(x: float, sign: float) -> float:
    """A place just beyond x1, on the side to which the motion goes."""
    return x + sign * 1e-12 * max(abs(x), 1e-3)


def repeats(swings: Sequence[float]) -> str | None:
    """Of the last swings: "hunts" where they are a pattern that has come three times, or its mirror image, and move;
    "creeps" where they have come to rest but for rounding; None else."""
    for n in range(1, PATTERN + 1):
        if len(swings) >= max(3 * n, 12):
            last, before, first = (np.array(swings[len(swings) - (k + 1) * n : len(swings) - k * n]) for k in range(3))
            for mirror in (1.0, -1.0):
                near = REPEATS * np.abs(last)
                if np.all(np.abs(last - mirror * before) < near) and np.all(np.abs(last - first) < near):
                    moved = float(np.ptp([*last, *before])) / float(np.abs(last).max())
                    return "hunts" if moved > LEAST_MOVED else "creeps" if moved < STANDS else None
    return None
