"""The search of a tuning over controller times, worst servos of the set as cutting planes.

v and cost at given times: best_gain.py.  They are computed on a coarse grid over the bounds of the free times; the
problem of problem.py is solved from the cheapest feasible times, and where that fails, from the next ones.
Without feasible times on the grid the search goes on where v is least.

The mesh of a fold is made for its servo, so the times move by at most `STEP` in their logarithms; then the folds are
solved again, on meshes of their own, and the next problem starts from there, until nothing moves.  The worst servos of
the set, for the fold and for each demand on the loop, are searched again at the result; new ones join the constraints
(cutting planes), until there is none.  The gain of the answer is the best one at its times.

"Cannot be met" is said of free times where v > 0 all over the grid and where, in every cell of it, v varies less
between its corners and its middle than the smallest v there is; cells are halved until it is so.  That is evidence
from samples.  Where it cannot be had the answer is "not found".

What is in the way: at given times each demand is a set of gains, K >= (1 + margin) K_b of the hunting margin, intervals
of each demand on the linear loops (loop_set.py), the bounds.  The smallest number of them without a gain in common is.
"""

from __future__ import annotations

import itertools
import math
from contextlib import suppress
from typing import NoReturn

import numpy as np

from ...axis_units import quantity
from ...errors import NoOrbit, Status
from ..nearby import said
from ..uncertainty.worst_corner import WorstCase
from .best_gain import Answer, Given, Outlook
from .demands import DEMANDS, Demands, controller_said, cost_of
from .loop_set import Intervals, Table, allowed, common
from .problem import Round, solve_round

Array = np.ndarray

STEP = 0.25
"""Largest change of ln tau between two meshes."""
SMALLEST_LOG_STEP = 1e-3
"""Where the folds are not found again the step is quartered, and below this given up: four times."""
LAST_CHANGE_OF_TIMES = 1e-6
"""Change of ln tau at which the rounds end."""
ROUNDS, SEARCHES = 40, 8
"""Most problems from one start, and most searches for worst servos."""
COARSE = {"switch": (9, 5), "lugre": (5, 3), None: (5, 3)}
"""Points of the grid along the free times: of one free time, and of each of two."""
MOST_TIMES = {"switch": 90, "lugre": 25, None: 25}
"""Pairs of times looked at before nothing is said to be possible."""
ATTEMPTS = 3
"""Times from which the problem is tried."""
WORTH = 1e-4
"""Part of the cost from which other times, or another round, are worth their while."""
FINEST_STEP = 0.01
"""Smallest step in ln tau of the search without derivatives."""
WIDER = 100.0
"""How far beyond the gains that matter the demands are looked at."""


def refusal(
    given: Given, q: Array, worst: WorstCase, *, times: int = 0, missed: float = 0.0, proven: bool = True
) -> str:
    """What cannot be met, or was not found, and which demand stands against which.

    q, worst: ln of the times [s] that come nearest to what is asked for, and the worst servo there; times, missed: with
    free times: how many pairs were looked at, and v at the nearest one; proven: whether they are evidence that there
    are none.
    """
    servo, demands, boxes = given.at(q), given.demands, given.boxes(q)
    needed, bounds = (1 + demands.margin) * worst.gain, given.limits.get("gain")
    low, high = given.gains(needed, servo)
    table = Table(boxes, demands, min(low, needed or math.inf) / WIDER, max(high, needed) * WIDER)
    asked = {
        "hunting margin": (
            [(needed, math.inf)],
            f"the hunting margin of {100 * demands.margin:g} % asks for a gain of at least {needed:.6g} (the fold gain "
            f"is {worst.gain:.6g}{f' at {said(worst.corner)}' if worst.corner else ''})",
        )
    }
    for name in DEMANDS:
        sets = allowed(boxes, demands, table, name)
        asked[name] = sets, _of_a_loop(name, sets, demands, table)
    if math.isfinite(demands.max_torque):
        most = given.largest_gain(servo)
        torque, takes, step = quantity(demands.max_torque, "N m", "g"), "", quantity(given.step, "rad", "g")
        if needed > most:
            least = given.held(servo) + needed * given.first_torque(servo)
            takes = f"; {needed:.6g} takes {quantity(least, 'N m', '.4g')}"
        asked["largest torque"] = [(0.0, most)], (
            f"the largest torque of {torque} on a step of {step} allows gains of at most "
            f"{most:.6g}{takes}, and what ends hunting with less torque is told by casahunt remedies"
        )
    if bounds is not None:
        asked["bounds"] = [bounds], f"the bounds of the gain allow {bounds[0]:g} to {bounds[1]:g}"
    ways = "; ".join(asked[name][1] for name in _against_each_other({name: each[0] for name, each in asked.items()}))
    if not given.free:
        return f"the tuning cannot be met; in the way: {ways}"
    by_times = "controller.lead_time" in servo.controller_names
    what = "pairs of controller times" if by_times else "controllers"
    evidence = f"{times} {what} between the bounds were tried"
    if proven:
        head = f"the tuning cannot be met: {evidence}, and what is missing is everywhere more than it varies in between"
    else:
        head = f"a tuning that meets the demands was not found: {evidence}"
    amount = ""
    if missed > 0:
        amount = f", where {100 * math.expm1(missed):.3g} % of gain or {math.degrees(missed):.3g} degrees are missing"
    return f"{head}; nearest at {controller_said(servo)}{amount}; there in the way: {ways}"


def _against_each_other(sets: dict[str, Intervals]) -> tuple[str, ...]:
    """Those of the demands that make up the smallest groups without a common gain; all of them where none does."""
    for n in range(1, len(sets) + 1):
        groups = [names for names in itertools.combinations(sets, n) if not common([sets[name] for name in names])]
        if groups:
            return tuple(name for name in sets if any(name in group for group in groups))
    return tuple(sets)


def _of_a_loop(name: str, sets: Intervals, demands: Demands, table: Table) -> str:
    """The gains that one of `DEMANDS` allows, in words."""
    late = {"a delay of": demands.delay, "samples of": demands.sample_time}
    lag = " and ".join(f"{words} {size:g} s" for words, size in late.items() if size)
    lag = f" with {lag}" if lag else ""
    what = f"the gain margin of {demands.gain_margin:g} when the gain {'falls' if name == DEMANDS[1] else 'rises'}{lag}"
    if name == DEMANDS[0]:
        what = f"the phase margin of {demands.phase_margin:g} degrees{lag}"
    if not sets:
        row = table.missed[DEMANDS.index(name)]
        i = int(np.argmin(row))
        best = math.degrees(demands.least(name) - float(row[i]))
        margin = f"the smallest phase margin is {best:.4g} degrees at best, at gain {table.gains[i]:.4g}"
        return f"{what} is kept at no gain ({margin})"
    texts = [
        f"at most {high:.6g}" if low == 0 else f"at least {low:.6g}" if high == math.inf else f"{low:.6g} to {high:.6g}"
        for low, high in sets
    ]
    return f"{what} allows gains of {' or '.join(texts)}"


class TuningSearch:
    """The search of the module docstring.

    Attributes
    ----------
    given : the task, with what is known of it.
    rounds : problems solved.
    gain_only : the cost with the times as given; None where that cannot be met, or where nothing is free.
    """

    def __init__(self, given: Given) -> None:
        self.given = given
        self.rounds = 0
        self.gain_only: float | None = None
        self.seen: dict[tuple[float, ...], Outlook | None] = {}
        self.members = 0
        """Servos and loops known when these times were looked at."""
        self.excluded = False
        self.names = [name.removeprefix("controller.") for name in given.numbers]
        self.axes = self._axes(given.start)
        self.low, self.high = (np.array([axis[end] for axis in self.axes]) for end in (0, -1))

    def run(self) -> Answer:
        """The answer.

        Raises NoOrbit: the task cannot be met, or nothing was found; or a fold was not computed.
        """
        q = self.given.start
        answer, worst = self.given.answer(q)
        if answer is None and not self.given.free:
            raise NoOrbit(refusal(self.given, q, worst))
        if answer is not None:
            if not self.given.free:
                return answer
            self.gain_only = self._cost(answer)
        found = self._over_times()
        if found is not None and (answer is None or self._cost(found) <= self._cost(answer)):
            return found
        return answer or self._refuse_times()

    def again(self, q: Array, points: list[Array]) -> Answer:
        """The answer at the times of an answer, or anew, now that points of the set are known that hunt more.

        q: (2,) ln of the times [s]; points: (k,) parameter values each.
        Raises NoOrbit: the task cannot be met, or nothing was found; or a fold was not computed.
        """
        self.given.points += points
        answer, worst = self.given.answer(q)
        if answer is None and not self.given.free:
            raise NoOrbit(refusal(self.given, q, worst))
        return answer or self._over_times() or self._refuse_times()

    # Free times

    def _over_times(self) -> Answer | None:
        """The best answer over the times; None where none is found."""
        best: Answer | None = None
        in_parts = self.given.model is None  # of which the problem of problem.py knows no linear loops
        for start in self._starts()[: 0 if in_parts else ATTEMPTS]:
            with suppress(NoOrbit):
                best = self._descend(start)
            if best is not None:
                break
        # What is known of the grid by now, should no problem have been solved, or one from the wrong start.
        for o in sorted(self._good(), key=lambda o: o.cost)[:ATTEMPTS]:
            now = self._outlook(o.q)
            if now is not None and now.missed <= 0 and (best is None or now.cost < self._cost(best) * (1 - WORTH)):
                found = self.given.answer(self._compass(now).q)[0]
                best = found if found is not None and (best is None or self._cost(found) < self._cost(best)) else best
        return best

    def _cost(self, answer: Answer) -> float:
        return cost_of(self.given.cost, answer.servo, answer.gain)

    def _descend(self, start: Outlook) -> Answer | None:
        """From feasible times to the best ones, servos that turn out to be in the way joining in between."""
        q, gain = start.q, start.gain
        self.given.cut(q, gain)
        answer: Answer | None = None
        for _ in range(SEARCHES):
            q, gain = self._rounds(q, gain)
            members = len(self.given.members)
            answer, _ = self.given.answer(q)
            new = self.given.cut(q, answer.gain if answer is not None else gain)
            if len(self.given.members) == members and not new:
                break
            if answer is not None and self._cost(answer) <= cost_of(self.given.cost, answer.servo, gain) * (1 + WORTH):
                break  # the new ones do not matter there
        return answer

    def _rounds(self, q: Array, gain: float) -> tuple[Array, float]:
        """The times of least cost, from mesh to mesh, and the gain there."""
        step = STEP
        folds = self.given.folds_at(q)
        for _ in range(ROUNDS):
            self.rounds += 1
            self.given.tell(f"optimising the controller times: round {self.rounds}")
            given, servo = self.given, self.given.at(q)
            needed = (1 + given.demands.margin) * (1 + given.guard)
            gains = given.gains(needed * max((fold.value for fold in folds), default=0.0), servo)
            point = solve_round(
                Round(
                    given.servo, given.cost, q, math.log(min(max(gain, gains[0]), gains[1])),
                    np.maximum(q - step, self.low), np.minimum(q + step, self.high),
                    gains, needed, folds, given.cuts, given.demands.lag,
                    given.largest_gain(servo) * servo.torque_gains(1.0)[0],
                )
            )  # fmt: skip
            moved = point.q - q
            try:
                if not point.converged:
                    raise NoOrbit(f"the optimisation problem was not solved ({point.message})", Status.NOT_CONVERGED)
                if np.max(np.abs(moved)) <= LAST_CHANGE_OF_TIMES:
                    return q, math.exp(point.k)
                folds = self.given.folds_at(point.q)
            except NoOrbit:
                step /= 4
                if step < SMALLEST_LOG_STEP:
                    raise
                continue
            q, gain, step = point.q, math.exp(point.k), min(STEP, 2 * step)
        return q, gain

    def _outlook(self, q: Array) -> Outlook | None:
        """The outlook at times, computed once as long as no servo joins."""
        if len(self.given.members) != self.members:
            self.members = len(self.given.members)
            self.seen.clear()
        key = tuple(np.round(q, 12).tolist())
        if key not in self.seen:
            self.given.tell(f"looking at controller times: pair {len(self.seen) + 1}")
            self.seen[key] = self.given.outlook(q)
        return self.seen[key]

    def _axes(self, q: Array) -> list[list[float]]:
        """Grid of ln tau for each time, the given ones among them; one point for a time that is not free."""
        points = COARSE[self.given.model][len(self.given.free) - 1]
        axes = []
        for i, name in enumerate(self.names):
            if name not in self.given.free:
                axes.append([float(q[i])])
                continue
            low, high = np.log(self.given.limits[name])
            grid = np.linspace(low, high, points)
            own = float(q[i])
            far = np.abs(grid - own) > 0.4 * (grid[1] - grid[0])
            keep = far | np.isin(np.arange(points), (0, points - 1))
            axes.append(sorted({*map(float, grid[keep]), own}))
        return axes

    def _starts(self) -> list[Outlook]:
        """Feasible times, cheapest first; the nearest to feasible where none was found, none where there are none."""
        for pair in itertools.product(*self.axes):
            self._outlook(np.array(pair))
        if not self._good():
            self.excluded = self._exclude()
            if not self._good() and not self.excluded and self._known():
                nearest = self._compass(min(self._known(), key=lambda o: o.missed))
                return self._good() or [nearest]
        return sorted(self._good(), key=lambda o: o.cost)

    def _known(self) -> list[Outlook]:
        return [o for o in self.seen.values() if o is not None]

    def _good(self) -> list[Outlook]:
        return [o for o in self._known() if o.missed <= 0]

    def _exclude(self) -> bool:
        """Whether v varies less than its size in every cell of the grid, cells halved where it does not.

        With the middle among the points a valley between straight walls is no deeper than they vary.
        """
        edges = [list(zip(axis, axis[1:], strict=False)) or [(axis[0], axis[0])] for axis in self.axes]
        cells = list(itertools.product(*edges))
        while cells:
            cell = cells.pop(0)
            corners: list[tuple[float, ...]] = list(itertools.product(*[sorted(set(side)) for side in cell]))
            corners.append(tuple((a + b) / 2 for a, b in cell))
            if len(self.seen) + len(corners) > MOST_TIMES[self.given.model]:
                return False
            found = [self._outlook(np.array(corner)) for corner in corners]
            if any(o is None for o in found):
                return False
            values = [o.missed for o in found if o is not None]
            if min(values) <= 0:
                return False
            if max(values) - min(values) < min(values):
                continue
            halves = [[(a, b)] if a == b else [(a, (a + b) / 2), ((a + b) / 2, b)] for a, b in cell]
            cells += itertools.product(*halves)
        return True

    def _compass(self, start: Outlook) -> Outlook:
        """From times downhill along the axes and diagonals: in v as long as that is positive, then in the cost."""
        here, step = start, STEP
        moves = [np.array(m, float) for m in itertools.product((-1, 0, 1), repeat=len(self.names)) if any(m)]
        moves = [m for m in moves if all(name in self.given.free or m[i] == 0 for i, name in enumerate(self.names))]
        while step >= FINEST_STEP:
            tried = [self._outlook(np.clip(here.q + step * m, self.low, self.high)) for m in moves]
            best = min((o for o in tried if o is not None), key=_rank, default=here)
            if _rank(best) < _rank(here):
                here = best
            else:
                step /= 2
        return here

    # What is in the way

    def _refuse_times(self) -> NoReturn:
        if not self._known():
            raise NoOrbit("no fold was computed at any of the times tried; try other bounds", Status.NOT_CONVERGED)
        nearest = min(self._known(), key=lambda o: o.missed)
        worst = self.given.worst(self.given.at(nearest.q))
        sentence = refusal(
            self.given, nearest.q, worst, times=len(self.seen), missed=nearest.missed, proven=self.excluded
        )
        raise NoOrbit(sentence, None if self.excluded else Status.NOT_CONVERGED)


def _rank(o: Outlook) -> tuple[float, float]:
    return max(o.missed, 0.0), o.cost
