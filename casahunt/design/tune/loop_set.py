"""The linear loops of a box of servos: the worst one, and the gains that keep the margins for every one.

kappa = K cm g [N m/rad], g a factor by which the gain may be off, and phi [rad] at |L| g = 1: crossover.py.

What is asked of every servo of the box:

    phase margin               phi >= PM     for g = 1
    gain margin (lowering)     phi >= 0      for 1/f <= g <= 1        stable at every gain from K/f
    gain margin (raising)      phi >= 0      for 1 <= g <= f          ... to f K

cm and g are in kappa alone, so each is a bound on the smallest phi over a box in (J, sigma2, c, kappa), c the numbers
of the controller: (tau_d, tau_i) or (kp', ki', kd').  With several crossovers phi > 0 at all of them is enough for a
stable loop, and not needed: loops that are stable otherwise are passed over.

`worst` finds it: a grid with all corners of the box, then grids of 3^d points around the `SEARCH_STARTS` best ones,
halved `HALVINGS` times; phi may have its minimum inside of the box.  `Table` gives the smallest phi at many kappa at
once, for curves over omega (no crossover to be solved for) interpolated in ln kappa, as a guide to where a gain is
worth trying.

Symbols: d uncertain parameters of the loop, m points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...servo.servo import Servo, flatten
from .crossover import crossover_phase, log_kappa, phase_at

Array = np.ndarray

Intervals = list[tuple[float, float]]

DEMANDS = ("phase margin", "gain margin (lowering)", "gain margin (raising)")
GRID_POINTS, TABLE_POINTS = 4000, 700
"""Points of the grid of a search, and of the curves of a table, at most."""
MOST_ALONG = 65
"""Grid points along one parameter, at most."""
SEARCH_STARTS, HALVINGS = 6, 26
LOG_STEP = 0.02
"""Step of a table in ln kappa."""
EDGE_STEPS = 60
BARELY_STABLE = 1e-6
NEAR_MISS = 0.05
"""A demand missed by less [rad] at a gain of a table may be kept between two of them."""


@dataclass(frozen=True, eq=False)
class LoopBox:
    """Loops whose parameters lie in intervals.

    Attributes
    ----------
    names : what the loops depend on besides the gain, in the order of every array here: inertia, viscous friction, the
        numbers of the controller, motor gain.
    low, high : (names,) bounds.
    lag : D [s].
    """

    names: tuple[str, ...]
    low: Array
    high: Array
    lag: float


@dataclass(frozen=True)
class WorstLoop:
    """The loop of least phase at the crossover.

    Attributes
    ----------
    phase : phi there [rad].
    values : {parameter: value} of inertia, viscous friction and controller.
    kappa : K cm g there [N m/rad].
    """

    phase: float
    values: dict[str, float]
    kappa: float


def loop_box(servo: Servo, bounds: Mapping[str, tuple[float, float]], lag: float) -> LoopBox:
    """The loops of a servo with some parameters in intervals.

    bounds: (low, high) by parameter name; names that the loop does not depend on are left out; lag: D [s], half a
    sample time included.
    """
    own = flatten(servo)
    names = ("servo.inertia", "friction.viscous", *servo.controller_names, "servo.motor_gain")
    low, high = np.array([bounds.get(name, (own[name], own[name])) for name in names], float).T
    return LoopBox(names, low, high, lag)


def worst(box: LoopBox, gain: float, factors: tuple[float, float] = (1.0, 1.0)) -> WorstLoop:
    """The loop of least phase over the box, with the gain multiplied by anything between two factors.

    gain: K > 0 [V/rad]; factors: (lowest, highest) g.
    """
    ends = math.log(gain * factors[0] * box.low[-1]), math.log(gain * factors[1] * box.high[-1])
    low, high = np.append(box.low[:-1], ends[0]), np.append(box.high[:-1], ends[1])
    varied = np.flatnonzero(high > low)
    points = _grid(low, high, varied, GRID_POINTS)
    phases = crossover_phase(points, box.lag)
    if not varied.size:
        return _worst_loop(box, points[0], float(phases[0]))
    best = _apart(points, phases, (high - low)[varied], varied)
    along = _along(varied.size, GRID_POINTS)
    width = (high - low)[varied] / (along - 1)
    offsets = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=varied.size)))
    values = np.full(len(best), np.inf)
    for _ in range(HALVINGS):
        tried = np.repeat(best[:, None, :], len(offsets), axis=1)
        tried[:, :, varied] = np.clip(tried[:, :, varied] + offsets * width, low[varied], high[varied])
        found = crossover_phase(tried.reshape(-1, low.size), box.lag).reshape(len(best), -1)
        pick = np.argmin(found, axis=1)
        best, values = tried[np.arange(len(best)), pick], found[np.arange(len(best)), pick]
        width = width / 2
    i = int(np.argmin(values))
    return _worst_loop(box, best[i], float(values[i]))


def _worst_loop(box: LoopBox, point: Array, phase: float) -> WorstLoop:
    *values, kappa = map(float, point)
    return WorstLoop(phase, dict(zip(box.names[:-1], values, strict=True)), math.exp(kappa))


def _along(d: int, most: int) -> int:
    """Grid points along each of d parameters."""
    return 1 if d == 0 else max(2, min(MOST_ALONG, int(most ** (1 / d) + 1e-9)))


def _grid(low: Array, high: Array, varied: Array, most: int) -> Array:
    """(m, k) points of a box, its corners among them."""
    n = _along(varied.size, most)
    axes = [np.linspace(low[i], high[i], n) if i in varied else low[i : i + 1] for i in range(low.size)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)


def _apart(points: Array, phases: Array, size: Array, varied: Array) -> Array:
    """The best points, no two of which are neighbours."""
    chosen: list[Array] = []
    spacing = 1.5 / (_along(varied.size, GRID_POINTS) - 1)
    for i in np.argsort(phases):
        if all(np.max(np.abs((points[i] - other)[varied]) / size) > spacing for other in chosen):
            chosen.append(points[i])
        if len(chosen) == SEARCH_STARTS:
            break
    return np.array(chosen)


@dataclass(frozen=True)
class LoopDemands:
    """Phase margin PM [rad] and gain margin f >= 1."""

    phase_margin: float
    gain_margin: float

    def factors(self, name: str) -> tuple[float, float]:
        """The range of g of a demand (`DEMANDS`)."""
        f = self.gain_margin
        return {DEMANDS[0]: (1.0, 1.0), DEMANDS[1]: (1 / f, 1.0), DEMANDS[2]: (1.0, f)}[name]

    def least(self, name: str) -> float:
        """The smallest phi [rad] that a demand allows; a loop without a phase margin asked for must be stable."""
        return max(self.phase_margin, BARELY_STABLE) if name == DEMANDS[0] else 0.0


def shortfall(boxes: Sequence[LoopBox], demands: LoopDemands, gain: float, name: str) -> tuple[float, WorstLoop]:
    """By how much a demand is missed at a gain.

    gain: K > 0 [V/rad]; name: which of `DEMANDS`.
    Returns phase missed [rad], negative where the demand is kept, and the worst loop.
    """
    found = min((worst(box, gain, demands.factors(name)) for box in boxes), key=lambda loop: loop.phase)
    return demands.least(name) - found.phase, found


class Table:
    """By how much each demand is missed at many gains, to the accuracy of a grid.

    Attributes
    ----------
    gains : (m,) rising.
    missed : (3, m) [rad], one row for each of `DEMANDS`; negative where it is kept.
    """

    def __init__(self, boxes: Sequence[LoopBox], demands: LoopDemands, low: float, high: float) -> None:
        n = max(2, int(math.ceil(math.log(high / low) / LOG_STEP)) + 1)
        self.gains = np.geomspace(low, high, n)
        rows = [self._of_box(box, demands) for box in boxes]
        self.missed = np.max(rows, axis=0)

    def _of_box(self, box: LoopBox, demands: LoopDemands) -> Array:
        f, k = demands.gain_margin, np.log(self.gains)
        first, last = k[0] + math.log(box.low[-1] / f), k[-1] + math.log(box.high[-1] * f)
        x = np.arange(first, last + LOG_STEP, LOG_STEP)
        least = _least_phase(box, x)
        missed = []
        for name in DEMANDS:
            g = demands.factors(name)
            left, right = k + math.log(g[0] * box.low[-1]), k + math.log(g[1] * box.high[-1])
            missed.append(demands.least(name) - _window_minimum(x, least, left, right))
        return np.array(missed)


def _least_phase(box: LoopBox, x: Array) -> Array:
    """(m,) smallest phi at ln kappa = x over J, sigma2 and the controller of the box."""
    varied = np.flatnonzero(box.high[:-1] > box.low[:-1])
    points = _grid(box.low[:-1], box.high[:-1], varied, TABLE_POINTS)
    if points.shape[1] == 5:
        return np.min([_least_phase_by_gains(point, x, box.lag) for point in points], axis=0)
    ends = []
    for goal in (x[0], x[-1]):
        lows, highs = np.full(len(points), -60.0), np.full(len(points), 60.0)
        for _ in range(30):
            middle = (lows + highs) / 2
            J, sigma2, lead, integral = points.T
            below = log_kappa(J, sigma2, lead, integral, middle) < goal
            lows, highs = np.where(below, middle, lows), np.where(below, highs, middle)
        ends.append((float(lows.min()), float(highs.max())))
    y = np.arange(ends[0][0] - LOG_STEP, ends[1][1] + LOG_STEP, LOG_STEP / 2)
    found = np.full(x.size, np.inf)
    for point in points:
        J, sigma2, lead, integral = point
        phi = phase_at(J, sigma2, lead, integral, np.exp(y), lag=box.lag)
        found = np.minimum(found, np.interp(x, log_kappa(J, sigma2, lead, integral, y), phi))
    return found


def _least_phase_by_gains(point: Array, x: Array, lag: float) -> Array:
    """(m,) smallest phi at ln kappa = x of one loop by gains, of all its crossovers."""
    return crossover_phase(np.column_stack([np.tile(point, (x.size, 1)), x]), lag)


def _window_minimum(x: Array, values: Array, left: Array, right: Array) -> Array:
    """Smallest value of a piecewise linear function between left and right, for each pair."""
    at_ends = np.minimum(np.interp(left, x, values), np.interp(right, x, values))
    i, j = np.searchsorted(x, left), np.searchsorted(x, right)
    width = int(np.max(j - i, initial=0))
    inside = np.full(left.size, np.inf)
    for k in range(width):
        here = i + k < j
        inside = np.where(here, np.minimum(inside, values[np.minimum(i + k, x.size - 1)]), inside)
    return np.minimum(at_ends, inside)


def allowed(boxes: Sequence[LoopBox], demands: LoopDemands, table: Table, name: str) -> Intervals:
    """The gains that keep a demand.

    The table says where to look; ends, and intervals that fit between its gains, come from `worst`.

    boxes, demands, table, name: the loops, the margins asked for, by how much they are missed, and which of `DEMANDS`.
    Returns intervals [V/rad] within the table, rising; 0 and inf where they go on beyond it.
    """

    def missed(gain: float) -> float:
        return shortfall(boxes, demands, gain, name)[0]

    row, gains = table.missed[DEMANDS.index(name)], table.gains
    last = gains.size - 1
    padded = np.concatenate([[np.inf], row, [np.inf]])
    narrow = (padded[1:-1] <= padded[:-2]) & (padded[1:-1] < padded[2:]) & (row > 0) & (row < NEAR_MISS)
    fine = np.flatnonzero((row <= 0) | narrow)
    found: Intervals = []
    for run in np.split(fine, np.flatnonzero(np.diff(fine) > 1) + 1) if fine.size else []:
        a, b = max(int(run[0]) - 1, 0), min(int(run[-1]) + 1, last)
        best = float(gains[run[int(np.argmin(row[run]))]])
        if missed(best) > 0:
            best = _least(missed, float(gains[a]), float(gains[b]))
            if missed(best) > 0:
                continue
        outer = float(gains[a]), float(gains[b])
        low, high = (k if missed(k) <= 0 else _edge(missed, best, k) for k in outer)
        found.append((0.0 if low == gains[0] else low, math.inf if high == gains[last] else high))
    return found


def common(sets: Sequence[Intervals]) -> Intervals:
    """The gains in every one of the sets."""
    found: Intervals = [(0.0, math.inf)]
    for intervals in sets:
        pairs = itertools.product(found, intervals)
        found = [(max(a, c), min(b, d)) for (a, b), (c, d) in pairs if max(a, c) <= min(b, d)]
    return sorted(found)


def _least(missed: Callable[[float], float], low: float, high: float) -> float:
    """The gain between two at which a demand is missed least, or one at which it is kept: golden section."""
    a, b = math.log(low), math.log(high)
    part = (math.sqrt(5) - 1) / 2
    c, d = b - part * (b - a), a + part * (b - a)
    fc, fd = missed(math.exp(c)), missed(math.exp(d))
    while b - a > 1e-7 and min(fc, fd) > 0:
        if fc <= fd:
            b, d, fd = d, c, fc
            c = b - part * (b - a)
            fc = missed(math.exp(c))
        else:
            a, c, fc = c, d, fd
            d = a + part * (b - a)
            fd = missed(math.exp(d))
    return math.exp(c if fc <= fd else d)


def _edge(missed: Callable[[float], float], kept: float, broken: float) -> float:
    """The gain next to a demand's limit where it is still kept, between one that keeps it and one that breaks it.

    `missed` of a gain is at most 0 where the demand is kept.
    """
    a, b = math.log(kept), math.log(broken)
    fa, fb = missed(kept), missed(broken)
    side = 0
    for _ in range(EDGE_STEPS):
        if abs(b - a) <= 1e-12:
            break
        middle = (a + b) / 2 if not math.isfinite(fb - fa) or fa == fb else a - fa * (b - a) / (fb - fa)
        inset = 1e-13 * max(1.0, abs(a))
        middle = min(max(middle, min(a, b) + inset), max(a, b) - inset)
        value = missed(math.exp(middle))
        if value <= 0:  # Illinois: the end that stays loses half of its weight
            a, fa = middle, value
            fb = fb / 2 if side == 1 else fb
            side = 1
            if value > -1e-11:
                break
        else:
            b, fb = middle, value
            fa = fa / 2 if side == -1 else fa
            side = -1
    return math.exp(a)
