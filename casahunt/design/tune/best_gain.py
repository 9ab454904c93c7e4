"""A tuning at given controller times: the best gain for every servo of the set, and the servos that are in the way.

At given times everything is a matter of the gain alone.  The hunting margin asks for K >= (1 + margin) K_b, b the worst
servo of the set, and every demand on the linear loops allows intervals of K (loop_set.py); the cost picks one of what
they have in common.  To the accuracy of a table,

    v(tau_d, tau_i) = min over K of max(ln((1 + margin) K_b / K), phases missed [rad])

tells how far times are from being feasible (v <= 0).

Folds and worst servos that have been met are kept: every one of them must keep the demands at all times.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import NoOrbit
from ...orbits import Options
from ...servo.friction import Model
from ...servo.gains import integral_gain
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import loop_asked
from ...servo.servo import Servo
from ..nearby import AnyFold, fold_beside, servo_at, values_of, vectors
from ..uncertainty.set import Uncertainty
from ..uncertainty.worst_corner import WorstCase, worst_corner
from .demands import (
    DEMANDS,
    NUMBERS,
    Demands,
    at_the_start,
    cost_of,
    log_numbers,
    silent,
    with_numbers,
)
from .loop_set import LoopBox, Table, WorstLoop, allowed, common, loop_box, lowest, shortfall
from .parts_set import parts_box
from .problem import Cut

Array = np.ndarray

GAINS = (1e-3, 10.0)
"""Default bounds of the gain, in units of (1 + margin) times the worst fold gain."""
IN_THE_TORQUE = ("servo.motor_gain", *(f"controller.{name}" for name in NUMBERS))
"""Parameters on which the torque at the start of a step depends."""
GUARD = 2.0
"""Free times keep the demands with this many tolerances to spare: another mesh must not put the answer outside."""
ON_BOUND = 1e-5
"""A constraint kept with less than this to spare is binding."""
SAFE = 1e-12
"""The gain is rounded up by this part, so that rounding cannot put it below its bound."""
FASTEST = 200
"""Gains among which the fastest settling is looked for, before it is polished."""


@dataclass(frozen=True, eq=False)
class Answer:
    """The best gain at some times.

    Attributes
    ----------
    servo : with these times.
    gain : K.
    worst : the worst servo for the fold.
    loops : for each demand on the loops the worst one at that gain.
    binding : what keeps the cost from being less, in words.
    """

    servo: Any
    gain: float
    worst: WorstCase
    loops: dict[str, WorstLoop]
    binding: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Outlook:
    """Times as they look to the accuracy of a table: `missed` is v, `gain` the best one, or the nearest to one."""

    q: Array
    missed: float
    gain: float
    cost: float


class Given:
    """What is asked for, and what is known of it at some times.

    Attributes
    ----------
    limits : bounds of the gain, where given, and of the free times.
    numbers : whose logarithms are q: all numbers of the controller of a servo, of a loop those that are free.
    members : servos that must not hunt, with the times of `servo` times their own factors.
    cuts : loops that must keep a demand.
    points : points of the set from which its worst servo is searched too.
    evaluations : folds computed by the searches for the worst servo.
    tell : takes sentences that say where the search is.
    """

    def __init__(
        self, servo: Servo | Loop, model: Model | None, demands: Demands, uncertainty: Uncertainty | None,
        free: tuple[str, ...], limits: dict[str, tuple[float, float]], cost: str, options: Options,
        tell: Callable[[str], None] = silent,
    ) -> None:  # fmt: skip
        self.servo: Any = servo
        self.model, self.demands, self.uncertainty = model, demands, uncertainty
        self.free, self.limits, self.cost, self.options, self.tell = free, dict(limits), cost, options, tell
        self.evaluations = 0
        own = {name.removeprefix("controller."): name for name in servo.tunable_names}
        self.numbers = tuple(own[name] for name in free) if isinstance(servo, Loop) else servo.controller_names
        self.own = own
        self.folds: dict[bytes, tuple[Any, AnyFold | None]] = {}
        self.members: list[Any] = [servo]
        self.cuts: list[Cut] = []
        self.points: list[Array] = []

    @property
    def step(self) -> float:
        """The largest step of the set point [rad]."""
        return self.demands.step or float(self.servo.units.step)

    # One gain

    def gains(self, needed: float, servo: Any) -> tuple[float, float]:
        """Bounds of the gain.

        needed: (1 + margin) times the worst fold gain [V/rad]; 0 where nothing hunts.
        Returns (low, high) [V/rad]: as given, or wide around what is needed.
        """
        if "gain" in self.limits:
            return self.limits["gain"]
        typical = servo.value("gain") if isinstance(servo, Loop) else integral_gain(servo)
        base = needed or (1 + self.demands.margin) * typical
        return GAINS[0] * base, GAINS[1] * base

    def first_torque(self, servo: Any) -> float:
        """The largest torque with which a servo of the set begins the largest step, a unit of the gain [N m/(V/rad)].

        The integral is empty there and nothing moves yet: kp times the step, the peak unless a later one is larger; and
        what a filter makes of it at once, which a lead makes larger.
        """
        known = (*IN_THE_TORQUE, "motor_gain", *servo.controller_names)
        names = [name for name in (self.uncertainty.parameters if self.uncertainty else ()) if name in known]
        ends = []
        if self.uncertainty is not None:
            low, high = self.uncertainty.box(servo)
            ends = [(low[i], high[i]) for i, name in enumerate(self.uncertainty.parameters) if name in names]
        corners = [servo_at(servo, names, np.array(at)) for at in itertools.product(*ends)]
        return max(abs(at_the_start(corner, of, -self.step)) for corner in corners for of in ("demand", "command"))

    def largest_gain(self, servo: Any) -> float:
        """The gain with which the largest step begins with the largest torque that is allowed; inf without a limit."""
        most = self.demands.max_torque
        return max(most - self.held(servo), 0.0) / self.first_torque(servo) if math.isfinite(most) else most

    def held(self, servo: Any) -> float:
        """The torque of the motor that carries a constant load [N m], beside that of a step against it."""
        loop = loop_asked(servo, None, 1.0, usual="switch")
        return abs(loop.signal_at("torque", loop.at_rest(0.0)))

    def room(self, needed: float, servo: Any) -> tuple[float, float]:
        """As `gains`, up to the largest that the torque allows; where it allows none, the first is above the second."""
        low, high = self.gains(needed, servo)
        return low, min(high, self.largest_gain(servo))

    def boxes(self, q: Array) -> list[LoopBox]:
        """The loops of the set, and the nominal one where the set does not contain it."""
        servo, lag = self.at(q), self.demands.lag
        box_of: Any = parts_box if isinstance(servo, Loop) else loop_box
        boxes = [box_of(servo, {}, lag)]
        if self.uncertainty is not None:
            low, high = self.uncertainty.box(servo)
            pairs = zip(low.tolist(), high.tolist(), strict=True)
            whole = box_of(servo, dict(zip(self.uncertainty.parameters, pairs, strict=True)), lag)
            own = values_of(servo, self.uncertainty.parameters)
            inside = bool(((low <= own) & (own <= high)).all())
            boxes = [whole] if inside else [whole, *boxes]
        return boxes

    def at(self, q: Array) -> Any:
        """The nominal servo with the times exp(q), where they are free."""
        return with_numbers(self.servo, q, self.numbers) if self.free else self.servo

    def answer(self, q: Array) -> tuple[Answer | None, WorstCase]:
        """The best gain at these times, the whole set considered; None where there is none."""
        servo, boxes = self.at(q), self.boxes(q)
        worst = self.worst(servo)
        self.join(worst, q)
        gain = self._best_gain(servo, boxes, (1 + self.demands.margin) * worst.gain * (1 + SAFE))
        if gain is None:
            return None, worst
        loops = {name: shortfall(boxes, self.demands, gain, name)[1] for name in DEMANDS}
        return Answer(servo, gain, worst, loops, self._binding(servo, gain, worst, loops)), worst

    def _best_gain(self, servo: Any, boxes: list[LoopBox], needed: float) -> float | None:
        """The gain of least cost that keeps every demand at these times, to rounding."""
        demands = self.demands
        low, high = self.room(needed, servo)
        first = max(needed, low)
        if first > high:
            return None
        if self.cost != "settling" and all(shortfall(boxes, demands, first, name)[0] <= 0 for name in DEMANDS):
            return first
        table = Table(boxes, demands, low, high)
        sets = common([[(first, high)], *(allowed(boxes, demands, table, name) for name in DEMANDS)])
        if not sets:
            return None
        return (
            sets[0][0]
            if self.cost != "settling"
            else min((fastest(servo, *interval) for interval in sets), key=lambda k: cost_of(self.cost, servo, k))
        )

    def _binding(self, servo: Any, gain: float, worst: WorstCase, loops: dict[str, WorstLoop]) -> tuple[str, ...]:
        demands = self.demands
        bounded = ON_BOUND + (2 * GUARD * self.options.tol if self.free else 0.0)
        found = []
        if worst.gain and gain <= (1 + demands.margin) * worst.gain * (1 + bounded):
            found.append("hunting margin")
        for name, loop in loops.items():
            if loop.phase - demands.least(name) <= bounded:
                found.append(name)
        if gain >= self.largest_gain(servo) * (1 - bounded):
            found.append("largest torque")
        for name in ("gain", *self.free):
            if name not in self.limits:
                continue
            value = gain if name == "gain" else servo.value(self.own[name])
            low, high = self.limits[name]
            if value <= low * (1 + ON_BOUND):
                found.append(f"lower bound of {name}")
            if value >= high * (1 - ON_BOUND):
                found.append(f"upper bound of {name}")
        return tuple(found)

    # The worst servos of the set

    def worst(self, servo: Any) -> WorstCase:
        """The worst servo of the set, with the controller of `servo`."""
        nominal = self._fold(servo)
        if self.uncertainty is None:
            self.evaluations += 1
            return WorstCase(servo, nominal, {}, 1)
        worst = worst_corner(
            servo, self.model, self.uncertainty, options=self.options, fold=nominal, starts=self.points,
            report=lambda i: self.tell(f"searching the worst servo of the set: fold {i}"),
        )  # fmt: skip
        self.evaluations += worst.evaluations
        if nominal is not None and nominal.value > worst.gain:  # intervals may leave the servo itself out
            return WorstCase(servo, nominal, {}, worst.evaluations, worst.failures)
        return worst

    def join(self, worst: WorstCase, q: Array) -> bool:
        """Keep the worst servo at some times.

        q: (2,) ln of the times there [s]. Returns whether it is a new one.
        """
        self.folds.setdefault(_key(worst.servo), (worst.servo, worst.fold))
        own = self._moved(worst.servo, self.start - q) if self.free else worst.servo
        if any(_same(own, member) for member in self.members):
            return False
        self.members.append(own)
        return True

    def cut(self, q: Array, gain: float) -> bool:
        """Add the worst loops at a point to those that constrain the problem.

        q: (2,) ln of the times [s]; gain: K > 0 [V/rad]. Returns whether there are new ones.
        """
        new = False
        for name in DEMANDS:
            for box in self.boxes(q):
                _, loop = shortfall([box], self.demands, gain, name)
                servo = self.servo.replace(**loop.values, **{"servo.motor_gain": loop.kappa / gain})
                own = self._moved(servo, self.start - q)
                cut = Cut(own, name, self.demands.least(name) + self.guard)
                if not any(_same(cut.servo, c.servo, 1e-6) and c.demand == name for c in self.cuts):
                    self.cuts.append(cut)
                    new = True
        return new

    @property
    def guard(self) -> float:
        """Relative room that the problems over the times keep."""
        return GUARD * self.options.tol

    @property
    def start(self) -> Array:
        """(numbers,) q as given."""
        return log_numbers(self.servo, self.numbers)

    def _moved(self, servo: Any, by: Array) -> Any:
        """The servo with other controller numbers, by so much in their logarithms."""
        return with_numbers(servo, log_numbers(servo, self.numbers) + by, self.numbers) if by.any() else servo

    def _fold(self, servo: Any) -> AnyFold | None:
        if (key := _key(servo)) not in self.folds:
            self.tell(f"computing fold {len(self.folds) + 1} of the servos that must not hunt")
            known = [(_distance(of, servo), fold) for of, fold in self.folds.values() if fold is not None]
            _, near = min(known, key=lambda pair: pair[0], default=(0.0, None))
            self.folds[key] = servo, fold_beside(servo, self.model, near, options=self.options)
        return self.folds[key][1]

    def folds_at(self, q: Array) -> list[AnyFold]:
        """The folds of the members that have one, at the times exp(q).

        Raises NoOrbit: one was not computed.
        """
        members = [self._moved(member, q - self.start) for member in self.members]
        return [fold for fold in map(self._fold, members) if fold is not None]

    # Times as they look

    def outlook(self, q: Array) -> Outlook | None:
        """v, gain and cost at times, with the servos known so far; None where a fold was not computed."""
        try:
            needed = (1 + self.demands.margin) * max((f.value for f in self.folds_at(q)), default=0.0)
        except NoOrbit:
            return None
        servo = self.at(q)
        low, high = self.room(needed, servo)
        if low >= high:
            return Outlook(q, math.log(max(needed, low) / high), high, math.inf)
        table = Table(self.boxes(q), self.demands, low, high)
        extra = [needed * (1 + self.guard)] if low < needed < high else []
        gains = np.append(table.gains, extra)
        loops = table.missed.max(axis=0)
        loops = np.append(loops, np.interp(np.log(extra), np.log(table.gains), loops))
        missed = np.maximum(loops, math.log(needed) - np.log(gains) if needed else -np.inf)
        fine = np.flatnonzero(missed <= 0)
        if fine.size:
            costs = [cost_of(self.cost, servo, float(k)) for k in gains[fine]]
            i = int(np.argmin(costs))
            return Outlook(q, float(missed.min()), float(gains[fine[i]]), costs[i])
        i = int(np.argmin(missed))
        return Outlook(q, float(missed[i]), float(gains[i]), math.inf)


def fastest(servo: Any, low: float, high: float) -> float:
    """The gain of fastest settling between two: the best of a row of gains, polished by golden section.

    low, high: gains [V/rad]. Returns K [V/rad].
    """

    def settling(gain: float) -> float:
        return cost_of("settling", servo, gain)

    row = np.geomspace(low, high, FASTEST)
    row[0], row[-1] = low, high
    i = int(np.argmin([settling(float(k)) for k in row]))
    between = lowest(settling, float(row[max(i - 1, 0)]), float(row[min(i + 1, row.size - 1)]))
    return min([float(row[i]), low, high, between], key=settling)


def _vector(servo: Any) -> Array:
    return np.asarray(vectors(servo, (), np.empty((1, 0)))[0])


def _key(servo: Any) -> bytes:
    """By which the folds of equal servos are known."""
    return _vector(servo).tobytes()


def _same(a: Any, b: Any, rtol: float = 1e-9) -> bool:
    return bool(np.allclose(_vector(a), _vector(b), rtol=rtol, atol=0.0))


def _distance(a: Any, b: Any) -> float:
    """How far apart two servos are in the logarithms of their parameters (1 for one that is 0 in one of them)."""
    x, y = _vector(a), _vector(b)
    both = (x > 0) & (y > 0)
    far = np.where(both, np.log(np.where(both, x, 1.0) / np.where(both, y, 1.0)), x != y)
    return float(np.linalg.norm(far))
