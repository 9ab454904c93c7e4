"""The linear loops of a box of servos: the worst one, and the gains that keep the margins for every one.

With kappa = K cm g, g a factor by which the gain may be off, and w = omega^2, |L| g = 1 at

    w^2 (J^2 w + sigma2^2) = kappa^2 (kp'^2 w + (kd' w - ki')^2),                                         [N m/rad]
    phi = atan2(kp' omega, ki' - kd' w) - atan2(J omega, sigma2) - omega D                                     [rad]

(`Lag`, which for a sampled loop has the gains, the frequency and the loss of phase too), a cubic in w.  It may have
three roots, one in each of the stretches between the zeros of its derivative, which are bisected; phi is the least of
them.  By times, which are gains too (servo/controller.py), there is one.

What is asked of every servo of the box (demands.py):

    phase margin               phi >= PM     for g = 1
    gain margin (lowering)     phi >= 0      for 1/f <= g <= 1        stable at every gain from K/f
    gain margin (raising)      phi >= 0      for 1 <= g <= f          ... to f K

cm and g are in kappa alone, so each is a bound on the smallest phi over a box in (J, sigma2, c, kappa), c the numbers
of the controller: (tau_d, tau_i) or (kp', ki', kd').  With several crossovers phi > 0 at all of them is enough for a
stable loop, and not needed: loops that are stable otherwise are passed over.

`LoopBox.worst` finds it: a grid with all corners of the box, then grids of 3^d points around the `SEARCH_STARTS` best
ones, halved `HALVINGS` times; phi may have its minimum inside of the box.  `Table` gives the smallest phi at many kappa
at once, for curves over omega (no crossover to be solved for) interpolated in ln kappa, as a guide to where a gain is
worth trying.

Symbols: d uncertain parameters of the loop, m points.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...roots import Bracket, golden
from ...servo.controller import torque_gains_of
from ...servo.linear.sampled_loop import Lag, squared_size
from ...servo.servo import Servo, flatten
from .demands import DEMANDS, Demands

Array = np.ndarray

Intervals = list[tuple[float, float]]

LOG_OMEGA, BISECTIONS = 60.0, 50
"""Largest |ln omega| that is looked at, and how often a stretch of it is halved: to 1e-13."""
GRID_POINTS, TABLE_POINTS = 4000, 700
"""Points of the grid of a search, and of the curves of a table, at most."""
MOST_ALONG = 65
"""Grid points along one parameter, at most."""
SEARCH_STARTS, HALVINGS = 6, 26
"""Places of a grid that are polished, and how often: 2^-26 of its spacing, squared, is rounding at a smooth minimum."""
LOG_STEP = 0.02
"""Step of a table in ln kappa."""
EDGE_STEPS, AT_THE_EDGE = 60, 1e-12
"""Steps to the edge of a demand, and how near to it in ln K [and rad] they end."""
LEAST_WIDTH = 1e-10
"""Width in ln K to which a smallest value is searched for: a minimum may be a kink."""
NEAR_MISS = 0.05
"""A demand missed by less [rad] at a gain of a table may be kept between two of them."""


@dataclass(frozen=True)
class WorstLoop:
    """The loop of least phase at the crossover.

    Attributes
    ----------
    phase : phi there [rad].
    values : {parameter: value}, of one inertia those of inertia, viscous friction and controller.
    kappa : K cm g there [N m/rad].
    """

    phase: float
    values: dict[str, float]
    kappa: float


@dataclass(frozen=True, eq=False)
class LoopBox:
    """Loops whose parameters lie in intervals, of one inertia (`loop_box`) or of parts (parts_set.py).

    Attributes
    ----------
    names : what the loops depend on besides the gain, the motor gain last.
    low, high : (names,) bounds.
    worst : (gain K > 0, (lowest, highest) factor of it) -> the loop of least phase.
    along : ln kappa (m,) -> (ln kappa, phi) along the frequency, of loops of the box.
    """

    names: tuple[str, ...]
    low: Array
    high: Array
    worst: Callable[[float, tuple[float, float]], WorstLoop]
    along: Callable[[Array], Iterable[tuple[Array, Array]]]


def loop_box(servo: Servo, bounds: Mapping[str, tuple[float, float]], lag: Lag) -> LoopBox:
    """The loops of a servo with some parameters in intervals.

    bounds: (low, high) by parameter name; names that the loop does not depend on are left out; lag: sampling and delay.
    """
    own = flatten(servo)
    names = ("servo.inertia", "friction.viscous", *servo.controller_names, "servo.motor_gain")
    low, high = np.array([bounds.get(name, (own[name], own[name])) for name in names], float).T
    return LoopBox(names, low, high, partial(_worst, names, low, high, lag), partial(_curves, low, high, lag))


def _curves(low: Array, high: Array, lag: Lag, x: Array) -> Iterator[tuple[Array, Array]]:
    """(ln kappa, phi) along the frequency of loops of a grid, where ln kappa is in x (m,)."""
    varied = np.flatnonzero(high[:-1] > low[:-1])
    loops = _loops_of(_grid(low[:-1], high[:-1], varied, TABLE_POINTS), lag)
    ends = [crossovers(loops, np.full(loops.shape[1], goal))[1] for goal in (x[0], x[-1])]
    omega = np.exp(np.arange(ends[0].min() - LOG_STEP, ends[1].max() + LOG_STEP, LOG_STEP / 2))
    for loop in loops.T:
        yield -np.log(squared_size(loop, omega)) / 2, lag.phase(loop, omega)


def crossovers(loops: Array, goal: Array) -> tuple[Array, Array]:
    """Where loops cross: which of them, and ln omega there, as many as there are.

    loops, goal: (5, m) J, sigma2, kp', kd', ki', and (m,) ln kappa.
    """
    J, sigma2, kp, kd, ki = loops
    k2 = np.exp(2 * goal)
    a, b, c = J**2, sigma2**2 - (k2 * kd) * kd, k2 * (2 * kd * ki - kp**2)  # of w^3, w^2, w
    square = b**2 - 3 * a * c
    two = (square > 0) & (b < 0) & (c > 0)  # zeros w1 < w2 of the derivative
    w2 = np.where(two, -b + np.sqrt(np.where(two, square, 0.0)), 1.0) / (3 * a)
    w1 = np.where(two, c, 1.0) / (3 * a * w2)
    low = np.full(goal.size, -LOG_OMEGA)
    ends = np.array([low, np.where(two, np.log(w1) / 2, low), np.where(two, np.log(w2) / 2, low), -low])

    sides = squared_size(loops, np.exp(ends)) * k2 > 1
    stretch, i = np.nonzero(sides[:-1] != sides[1:])
    left, right, side = ends[stretch, i], ends[stretch + 1, i], sides[stretch, i]
    loops, k2 = loops[:, i], k2[i]
    for _ in range(BISECTIONS):
        middle = (left + right) / 2
        same = (squared_size(loops, np.exp(middle)) * k2 > 1) == side
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    return i, (left + right) / 2


def _loops_of(points: Array, lag: Lag) -> Array:
    """(5, m) J, sigma2, kp', kd', ki' of (m, 4 or 5) points, whose controllers may be by times, as they are seen."""
    J, sigma2, *numbers = points.T
    return np.array(lag.seen(J, sigma2, *torque_gains_of(1.0, *numbers)))


def _least_phases(points: Array, lag: Lag) -> Array:
    """(m,) phi [rad] of loops at their crossovers, the least where there are several.

    points: (m, 5 or 6) J, sigma2, the numbers of the controller, ln kappa.
    """
    loops, phi = _loops_of(points[:, :-1], lag), np.full(len(points), np.inf)
    i, y = crossovers(loops, points[:, -1])
    np.minimum.at(phi, i, lag.phase(loops[:, i], np.exp(y)))
    return phi


def _worst(
    names: tuple[str, ...], low: Array, high: Array, lag: Lag, gain: float, factors: tuple[float, float]
) -> WorstLoop:
    """The loop of least phase between bounds, with the gain multiplied by anything between two factors."""
    ends = math.log(gain * factors[0] * low[-1]), math.log(gain * factors[1] * high[-1])
    low, high = np.append(low[:-1], ends[0]), np.append(high[:-1], ends[1])
    varied = np.flatnonzero(high > low)
    points = _grid(low, high, varied, GRID_POINTS)
    phases = _least_phases(points, lag)
    best, values = points[:1], phases[:1]
    if varied.size:
        along, chosen = _along(varied.size, GRID_POINTS), list[Array]()
        width = (high - low)[varied] / (along - 1)
        for i in np.argsort(phases):  # the best points, no two of which are neighbours
            if all(np.max(np.abs((points[i] - other)[varied]) / width) > 1.5 for other in chosen):
                chosen.append(points[i])
            if len(chosen) == SEARCH_STARTS:
                break
        best = np.array(chosen)
        offsets = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=varied.size)))
        for _ in range(HALVINGS):
            tried = np.repeat(best[:, None, :], len(offsets), axis=1)
            tried[:, :, varied] = np.clip(tried[:, :, varied] + offsets * width, low[varied], high[varied])
            found = _least_phases(tried.reshape(-1, low.size), lag).reshape(len(best), -1)
            pick = np.argmin(found, axis=1)
            best, values = tried[np.arange(len(best)), pick], found[np.arange(len(best)), pick]
            width = width / 2
    i = int(np.argmin(values))
    *at, kappa = best[i].tolist()
    return WorstLoop(float(values[i]), dict(zip(names[:-1], at, strict=True)), math.exp(kappa))


def _along(d: int, most: int) -> int:
    """Grid points along each of d parameters."""
    return 1 if d == 0 else max(2, min(MOST_ALONG, int(most ** (1 / d) + 1e-9)))


def _grid(low: Array, high: Array, varied: Array, most: int) -> Array:
    """(m, k) points of a box, its corners among them."""
    n = _along(varied.size, most)
    axes = [np.linspace(low[i], high[i], n) if i in varied else low[i : i + 1] for i in range(low.size)]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)


def shortfall(boxes: Sequence[LoopBox], demands: Demands, gain: float, name: str) -> tuple[float, WorstLoop]:
    """By how much a demand is missed at a gain.

    gain: K > 0 [V/rad]; name: which of `DEMANDS`.
    Returns phase missed [rad], negative where the demand is kept, and the worst loop.
    """
    found = min((box.worst(gain, demands.factors(name)) for box in boxes), key=lambda loop: loop.phase)
    return demands.least(name) - found.phase, found


class Table:
    """By how much each demand is missed at many gains, to the accuracy of a grid.

    Attributes
    ----------
    gains : (m,) rising.
    missed : (3, m) [rad], one row for each of `DEMANDS`; negative where it is kept.
    """

    def __init__(self, boxes: Sequence[LoopBox], demands: Demands, low: float, high: float) -> None:
        n = max(2, int(math.ceil(math.log(high / low) / LOG_STEP)) + 1)
        self.gains = np.geomspace(low, high, n)
        f, k, missed = demands.gain_margin, np.log(self.gains), np.full((len(DEMANDS), n), -np.inf)
        for box in boxes:
            first, last = k[0] + math.log(box.low[-1] / f), k[-1] + math.log(box.high[-1] * f)
            x = np.arange(first, last + LOG_STEP, LOG_STEP)
            least = _least_phase(box, x)
            for row, name in zip(missed, DEMANDS, strict=True):
                g = demands.factors(name)
                left, right = k + math.log(g[0] * box.low[-1]), k + math.log(g[1] * box.high[-1])
                phases = np.minimum(np.interp(left, x, least), np.interp(right, x, least))
                windows = zip(np.searchsorted(x, left), np.searchsorted(x, right), strict=True)
                phases = np.minimum(phases, [least[i:j].min(initial=np.inf) for i, j in windows])
                row[:] = np.maximum(row, demands.least(name) - phases)
        self.missed = missed


def _least_phase(box: LoopBox, x: Array) -> Array:
    """(m,) smallest phi at ln kappa = x over the loops of the box."""
    found = np.full(x.size, np.inf)
    for goal, phi in box.along(x):
        rises = np.diff(goal) > 0
        turns = np.flatnonzero(rises[1:] != rises[:-1]) + 1
        for a, b in zip([0, *turns], [*turns, goal.size - 1], strict=True):  # from turn to turn kappa rises, or falls
            way = slice(a, b + 1) if rises[a] else slice(b, a - 1 if a else None, -1)
            found = np.minimum(found, np.interp(x, goal[way], phi[way], left=np.inf, right=np.inf))
    return found


def allowed(boxes: Sequence[LoopBox], demands: Demands, table: Table, name: str) -> Intervals:
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
            best = lowest(missed, float(gains[a]), float(gains[b]))
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


def lowest(f: Callable[[float], float], low: float, high: float) -> float:
    """The gain between two at which f is least, or one at which it is not positive: golden section."""
    return math.exp(golden(lambda k: f(math.exp(k)), math.log(low), math.log(high), LEAST_WIDTH, 0.0)[0])


def _edge(missed: Callable[[float], float], kept: float, broken: float) -> float:
    """The gain next to a demand's limit where it is still kept, between one that keeps it and one that breaks it.

    `missed` of a gain is at most 0 where the demand is kept.
    """
    least = missed(kept)
    if least == 0:
        return kept
    bracket = Bracket(math.log(kept), least, math.log(broken), missed(broken))
    for _ in range(EDGE_STEPS):
        x = bracket.illinois
        value = missed(math.exp(x))
        if value == 0:
            return math.exp(x)
        bracket = bracket.told(x, value)
        if bracket.width <= AT_THE_EDGE or -10 * AT_THE_EDGE < bracket.f_a:
            break
    return math.exp(bracket.a)
