"""Charts of a curve of special points, as plane_curve.py wants them: a sheet of orbits and the monitor on it.

    phi(s, m) = the monitor at the orbit (s, m) of the sheet,    phi_s, phi_m by differences
    slope       d lambda/d m = lambda_m - lambda_s phi_m/phi_s along the curve;  exactly, by the adjoint, at a fold

A place where phi vanishes is confirmed before it is one: a fold as an extremum of the parameter on two meshes
(fold.py), a flip or a loss of symmetry by its multiplier -1, a torus by a complex pair on the unit circle.  Multipliers
may jump where the phases of the cycle change, and its grazing contact is one of its phases: their curves end there.
A fold stands for itself, whatever its phases; the slopes of two tell whether they are of one curve.

Error of the parameter: that of lambda along the branch, and what an error e of phi moves the place by along the branch,

    ds = e/|phi_s|,   no more than  ds = (e/|grad phi|)^(1/2)  where the curve turns back and phi_s vanishes.

A curve of folds in batches: many of its points at once, predicted from one of them.

    a fold, expanded in ln q -> the next places in a batch (fold_ensemble.py) -> those that follow
           ^                                                                  |        | none
           +---- the last of them, expanded <---------------------------------+        v
                                                                 left to the single way (two_parameters.py)

A fold follows another where it has converged, is confirmed, is of the same kind and near where it was expected, and
the slopes of both explain the change of the first parameter between them: the batch does not leap to another sheet of
folds, nor over a cusp, next to which nothing converges.  Where q is not positive there is no logarithm to expand in,
nor a slope; the first parameter keeps its sign.

In a batch a fold takes 1.5 ms where step by step it takes 18 (a slip-stick cycle of two phases), or 6 ms against 55
(a stiff one of twelve).  Symbols: q the second parameter, c its place in its range, m places at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ..errors import InputError, NoOrbit
from ..orbits.adapt import Options
from ..orbits.orbit import Orbit
from .bifurcations import COMPLEX, FLIP, NEIMARK_SACKER, SYMMETRY_LOST, pair_of
from .curve import parameter_value
from .fold import Fold
from .fold_check import confirmed
from .fold_ensemble import expansion_at, expansion_beside, folds_near
from .fold_expansion import Expansion
from .plane_curve import LOCATED, Evaluation
from .sheet import DIFFERENCE, NEXT_TO_CUSP, Sheet, explained, sheet_of
from .special_points import FOLD, Monitor, SpecialPoint

PLACES_TOGETHER = 6
"""Places of a batch: what lies farther is better predicted from one of them."""
FEWEST = 3
"""Places that follow a fold just expanded: where fewer do, the single way is quicker."""
STEEPEST_STEP = 1 / 128
"""Part of the spacing below which no place is put between two."""
GROWTH_BETWEEN = 0.3
"""Of the parameter from one point to the next, at most: a cubic of points and their slopes is then right to 1e-4."""


@dataclass(frozen=True, eq=False)
class _Known:
    """The last fold that is known: its place, the parameter and d ln(parameter)/dc there."""

    c: float
    value: float
    steepness: float


def folds_ahead(sheet: Sheet, first: SpecialOrbit, sense: float, tol: float) -> Generator[SpecialOrbit]:
    """The folds that follow one on its curve, as far as batches lead.

    sheet, first: that fold; sense, tol: +1 towards larger c, -1 towards smaller; relative error of every fold.
    """
    axis = sheet.axis
    if parameter_value(first.orbit, sheet.vary) == 0:
        return
    try:
        base = expansion_at(first.orbit, sheet.vary, (axis.vary,), tol)
    except (NoOrbit, InputError):
        return
    at = sheet.position
    last = _known(sheet, at, first)
    pending = _places(at, 1.0 if sense > 0 else 0.0, sheet.spacing)
    while pending:
        found = _computed(sheet, base, pending[:PLACES_TOGETHER], tol)
        fresh = last.c == at
        points, last, steep = _that_follow(sheet, last, found, pending)
        yield from points
        pending = pending[len(points) :]
        if len(points) == len(found):
            continue
        if fresh and not steep and len(points) < FEWEST:
            return
        if steep:
            if abs(pending[0] - last.c) < STEEPEST_STEP * sheet.spacing:
                return
            pending.insert(0, (pending[0] + last.c) / 2)
        if last.c != at:
            following = expansion_beside(base, _parameters(base, axis.vary, np.array([axis.value(last.c)]))[0], tol)
            if following is None:
                return
            base, at = following, last.c


def _known(sheet: Sheet, c: float, special: SpecialOrbit) -> _Known:
    value = parameter_value(special.orbit, sheet.vary)
    return _Known(c, value, special.slope / value * sheet.axis.rate(c))


def _that_follow(
    sheet: Sheet, last: _Known, found: list[SpecialOrbit | None], places: list[float]
) -> tuple[list[SpecialOrbit], _Known, bool]:
    """(those found that follow the last one, the last of them, whether the parameter changes much then)."""
    points: list[SpecialOrbit] = []
    for point, place in zip(found, places, strict=False):
        if point is None:
            break
        there = _known(sheet, place, point)
        m, ratio = place - last.c, there.value / last.value
        rise = math.log(ratio) if ratio > 0 else math.inf
        steep = abs(rise) > GROWTH_BETWEEN
        if steep or not explained(rise, last.steepness * m, there.steepness * m):
            return points, last, steep
        points.append(point)
        last = there
    return points, last, False


def _places(c: float, end: float, spacing: float) -> list[float]:
    """Equally far from each other, from behind c to the end."""
    count = max(1, int(np.ceil(abs(end - c) / spacing - 1e-9)))
    return [float(x) for x in np.linspace(c, end, count + 1)[1:-1]] + [end]


def _parameters(base: Expansion, vary: str, values: Array) -> Array:
    """(m, np) parameters of the problems at values of q."""
    p = np.repeat(base.problem.vector()[None], values.size, axis=0)
    p[:, base.problem.names.index(vary)] = values
    return p


def _computed(sheet: Sheet, base: Expansion, places: list[float], tol: float) -> list[SpecialOrbit | None]:
    """The folds at a few places; None where there is none."""
    axis = sheet.axis
    values = np.array([axis.value(c) for c in places])
    folds = folds_near(base, _parameters(base, axis.vary, values), tol, slopes_by=(axis.vary,))
    numbers = np.array([
        folds.values, folds.value_errors, folds.periods, folds.period_errors, folds.amplitudes, folds.amplitude_errors
    ])  # fmt: skip
    out: list[SpecialOrbit | None] = []
    for i, (q, solution) in enumerate(zip(values.tolist(), folds.solutions, strict=True)):
        out.append(None)
        if solution is None or q <= 0:
            continue
        value = float(folds.values[i])
        with suppress(InputError):  # the equations know nothing of the values that a parameter may have
            there = base.problem.with_value(axis.vary, q).with_value(sheet.vary, value)
            orbit, across = solution.orbit(there, numbers[:, i])
            slope = value * float(folds.slopes[i, 0]) / q
            out[-1] = SpecialOrbit(orbit, float(folds.errors[i]), slope, across, how="batch")
    return out


Array = np.ndarray

KINK = 1e-6
"""By how much the angles of a pair of multipliers at three places in a row are out of line where it has passed 0 or pi
between them [rad]."""
ENOUGH = 0.1
"""Part of the tolerance that may be left of a monitor: parameter, period and amplitude are off by about as much."""
CONFIRMED = 1e-5
"""How far from where it should be the multiplier of a special point may be, besides its estimated error."""


@dataclass(frozen=True, eq=False)
class SpecialOrbit:
    """A place of the curve.

    Attributes
    ----------
    orbit : the orbit there.
    error : estimated relative error of the first parameter, in its unit.
    slope : derivative of the first parameter by the second along the curve; infinite where it turns.
    across : phi_s; at a fold the second derivative of lambda along the branch: < 0 where the parameter is largest, > 0
        where it is smallest, 0 at a cusp.
    turns : whether the curve turns back in the second parameter here.
    how : "followed" step by step, or in a "batch" with others.

    Examples
    --------
    >>> from casahunt.continuation import Axis, largest, special_walk
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import Options, find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> walk = special_walk(largest(orbit, "g").orbit, "g", Axis("r", 0.8, 0.79), sense=1.0, options=Options())
    >>> first = next(walk)
    >>> first.how, first.turns, first.across < 0
    ('followed', False, True)
    """

    orbit: Any
    error: float
    slope: float
    across: float
    turns: bool = False
    how: Literal["followed", "batch"] = "followed"


@dataclass(frozen=True, eq=False)
class ChartSetting:
    """What all charts of a curve share.

    Attributes
    ----------
    monitor : vanishes on the curve.
    options : tolerance and method of the special points.
    reported : (orbit of the sheet) -> that which a user gets, or a sentence about why it is no such point.
    """

    monitor: Monitor
    options: Options
    reported: Callable[[Any], Any]


@dataclass(frozen=True, eq=False)
class SpecialChart:
    """Coordinates (s, m) around a special point (plane_curve.Chart)."""

    task: ChartSetting
    sheet: Sheet
    gradient: tuple[float, float] = (0.0, 0.0)
    special: SpecialOrbit | None = None
    angle: tuple[float, float, float] | None = None
    """Of the pair of multipliers of a torus, in (0, pi), with its derivatives by s and m."""

    @property
    def position(self) -> float:
        """The place of the second parameter in its range."""
        return self.sheet.position

    @property
    def reach(self) -> tuple[float, float]:
        """The largest steps in s and in m."""
        return self.sheet.reach

    def value(self, s: float, m: float) -> Evaluation | str:
        """Read the monitor at a place of the sheet.

        Returns its value with the orbit there, or a sentence that says why there is none.
        """
        orbit = self.sheet.orbit_at(s, m)
        if isinstance(orbit, str):
            return orbit
        if orbit.signature != self.sheet.orbit.signature and self.task.monitor is not FOLD:
            return "the phases of the cycle change: it grazes an event, or one of them vanishes"
        value = self.task.monitor.value(orbit, self.sheet.point_of(orbit))
        near = max(LOCATED, ENOUGH * self.task.options.tol)
        return Evaluation(value, orbit, near) if np.isfinite(value) else "its multipliers are not known well enough"

    def along_s(self) -> tuple[Evaluation, Evaluation, float] | str:
        """What is read a little further on and further back along the branch, and phi_s; or a sentence."""
        above, below = self.value(DIFFERENCE, 0.0), self.value(-DIFFERENCE, 0.0)
        if isinstance(above, str):
            return above
        return below if isinstance(below, str) else (above, below, (above.value - below.value) / (2 * DIFFERENCE))

    def moved(self, s: float, m: float, reading: Evaluation) -> SpecialChart | str:
        """The chart of the special point that was read at a place of the sheet.

        s, m: the place, as in `value`. Returns chart, or a sentence that says why there is none.
        """
        found = special_chart(self.task, reading, self.sheet, m)
        if isinstance(found, str):
            return found
        if not self.sheet.agrees(found.sheet, s):
            return f"the corrector went to another {self.task.monitor.kind}"
        return passes_resonance(self, found, s, m) or found


def special_chart(task: ChartSetting, reading: Evaluation, like: Sheet, m: float) -> SpecialChart | str:
    """The chart of a place where the monitor vanishes, confirmed, with its gradient, slope and error.

    like, m: the sheet in whose direction the branch is followed, and where on it the place lies.
    Returns chart, or a sentence that says why there is none.
    """
    orbit, vary, axis = reading.data, like.vary, like.axis
    complaint = not_what_it_is_called(task.monitor, orbit)
    if complaint:
        return complaint
    position = like.position + m
    sheet = sheet_of(orbit, vary, axis, position, options=like.options, spacing=like.spacing, like=like)
    bare = SpecialChart(task, replace(sheet, steepness=like.steepness))
    beside = bare.along_s()
    if isinstance(beside, str):
        return beside
    above, below, phi_s = beside
    try:
        # The fold at an orbit, confirmed as the largest or the smallest value; None next to a cusp, and of other
        # points
        if task.monitor is not FOLD or abs(phi_s) <= NEXT_TO_CUSP:
            fold = None
        else:
            point = SpecialPoint(FOLD.kind, orbit, "")
            found: Fold = confirmed(point, vary, task.options, sense=1.0 if phi_s < 0 else -1.0)
            fold = found
    except NoOrbit as refusal:
        return str(refusal)
    if fold is not None:
        steepness = fold.sensitivities[axis.vary] * axis.rate(position) / orbit.problem.unit(vary)
        bare = replace(bare, sheet=replace(sheet, steepness=steepness))
    step = sheet.inwards
    ahead, behind = bare.value(0.0, step), reading if fold is not None else bare.value(0.0, -step)
    if isinstance(ahead, str):
        return ahead
    back = -step
    if behind is reading or isinstance(behind, str):  # beyond its range a parameter has no value: one side is enough
        behind, back = reading, 0.0
    phi_m = (ahead.value - behind.value) / (step - back)
    if fold is None:
        steepness = (sheet.growth_to(ahead.data) - sheet.growth_to(behind.data)) / (step - back)
    sheet = replace(sheet, steepness=steepness).tilted(ahead.data, step)
    special = _special_orbit(task, sheet, (phi_s, phi_m), reading, fold)
    if isinstance(special, str):
        return special
    if task.monitor.kind != NEIMARK_SACKER.kind:
        return SpecialChart(task, sheet, (phi_s, phi_m), special)
    reads = reading, above, below, ahead, behind
    at, right, left, up, down = (abs(float(np.angle(pair_of(read.data)[0]))) for read in reads)
    bent = abs(right + left - 2 * at) - abs(right - left), abs(up + down - 2 * at) - abs(up - down) if back else 0.0
    if max(bent) > KINK:
        return f"the pair of multipliers meets at {_resonance(at > np.pi / 2)}"
    angle = at, (right - left) / (2 * DIFFERENCE), (up - down) / (step - back)
    return SpecialChart(task, sheet, (phi_s, phi_m), special, angle)


def _special_orbit(
    task: ChartSetting, sheet: Sheet, gradient: tuple[float, float], reading: Evaluation, fold: Fold | None
) -> SpecialOrbit | str:
    """What a user gets of the place at the origin of a sheet."""
    (phi_s, phi_m), vary, axis = gradient, sheet.vary, sheet.axis
    if fold is not None:
        return SpecialOrbit(fold.orbit, fold.error_estimate, fold.sensitivities[axis.vary], phi_s)
    orbit, along_s = sheet.orbit, float(sheet.point.row[-1])
    of_monitor = task.monitor.noise(orbit) if task.monitor.by_multipliers else task.monitor.tolerance
    noise = abs(reading.value) + of_monitor
    off = noise / max(abs(phi_s), float(np.sqrt(noise * np.hypot(phi_s, phi_m)))) if noise else 0.0
    error = max(orbit.parameter_error, orbit.error_estimate) + abs(along_s) * off
    slope = orbit.problem.unit(vary) * sheet.steepness / axis.rate(sheet.position)
    if task.monitor is not FOLD:  # whose parameter changes along the curve as it does along s = 0
        slope -= orbit.problem.unit(vary) * along_s * phi_m / phi_s / axis.rate(sheet.position) if phi_s else np.inf
    shown = task.reported(orbit)
    return shown if isinstance(shown, str) else SpecialOrbit(shown, float(error), float(slope), phi_s)


def not_what_it_is_called(monitor: Monitor, orbit: Orbit) -> str:
    """What speaks against a place where a monitor of multipliers vanishes.

    monitor, orbit: the monitor and the orbit at which it vanishes.
    Returns A sentence, or "" where it is what it is called, or has no multipliers to tell.
    """
    if monitor.kind not in (FLIP.kind, SYMMETRY_LOST.kind, NEIMARK_SACKER.kind):
        return ""
    multipliers = orbit.multipliers
    if not multipliers.trusted:
        return f"the multipliers are not known well enough: their error is {multipliers.error:.2g}"
    mu = multipliers.half[1:]
    slack = CONFIRMED + 10 * multipliers.error
    if monitor.kind != NEIMARK_SACKER.kind:
        off = float(np.min(np.abs(mu + 1), initial=np.inf))
        return "" if off <= slack else f"no multiplier is -1: the nearest is off by {off:.2g}"
    a, b = pair_of(orbit)
    if abs(a * b - 1) > 2 * slack:
        return "no pair of multipliers lies on the unit circle"
    if abs(a.imag) > COMPLEX:
        return ""
    return f"the pair of multipliers becomes real at {_resonance(a.real < 0)}, and no torus branches off beyond"


def passes_resonance(here: SpecialChart, there: SpecialChart, s: float, m: float) -> str:
    """Whether the pair of multipliers of a torus meets at -1 or +1 between two points of its curve.

    Returns A sentence, or "".  The angle of the pair comes back from 0 or pi, where it would have gone beyond.
    """
    if here.angle is None or there.angle is None:
        return ""
    angle, first = here.angle[0], here.angle[1] * s + here.angle[2] * m
    second = there.angle[1] * s + there.angle[2] * m
    left = np.pi - angle if first > 0 else angle
    if first * second < 0 and abs(first) + abs(second) > left:
        return f"the pair of multipliers meets at {_resonance(first > 0)}"
    return ""


def _resonance(turned: bool) -> str:
    return "-1: a 1:2 resonance" if turned else "+1: a 1:1 resonance"
