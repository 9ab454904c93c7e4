"""Following a curve phi(s, c) = 0 in a plane by pseudo-arclength, through the places where it turns back in c.

    tangent     (t_s, t_c) along (-phi_c, phi_s), of length 1, oriented forwards
    predictor   h (t_s, t_c) from the last place
    corrector   the root of phi on the line across the tangent: inverse interpolation, in a bracket once there is one
    turn        t_c changes sign: the curve turns back in c; located in h

Every place of the curve has coordinates (s, m = c - position) of its own with itself at the origin, a chart: phi may be
costly, and what it starts from is best taken near by (surface.Place computes an orbit for every value).  It has

    position, gradient, reach   c of the place;  (phi_s, phi_c) there;  the largest steps in s and in c
    value(s, m)                 phi at a place (`Evaluation`), or a sentence about why there is none
    moved(s, m, reading)        the chart of a place found on the curve, s oriented as here, or why it is none

c is absolute, and runs over a range; the curve ends on its bounds.  phi is of order one away from the curve.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..roots import CLOSED, Bracket, Search, inverse_interpolation
from .walk import CAUTION, RECOVERY

Array = np.ndarray

LOCATED = 1e-9
"""|phi| at which a point lies on the curve, where a reading does not say another."""
ACCEPTED = 1e-5
"""|phi| with which a point is accepted where rounding or a change of mesh allows no less."""
LINE_ROUNDS = 40
"""Readings across a curve, four as a rule; so many halvings leave 1e-12 of the width at a jump."""
SHORTEST = 1e-4
"""Part of the largest step below which the curve is given up."""
TURNED, UPRIGHT = 1e-6, 1e-3
"""|t_c| at which a turn is located, and with which it is accepted."""
EASY_ANGLE = 0.35
"""Angle between successive tangents [rad] at which the step is left as it is."""
NEARLY = 1.3
"""A step that leads to within this part of itself of a bound is made to end there."""
WIDTH = 0.5
"""A root lies within this part of the step to either side of the predicted place, where the step is not too long."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """phi at a place, with whatever it was computed from; |phi| <= accuracy lies on the curve."""

    value: float
    data: Any = None
    accuracy: float = LOCATED


@dataclass(frozen=True, eq=False)
class PlanePoint:
    """A place on the curve.

    Attributes
    ----------
    chart : its coordinates.
    tangent : (t_s, t_c), forwards.
    turns, last : whether the curve turns back in c here; whether it lies on a bound of c.
    """

    chart: Any
    tangent: Array
    turns: bool = False
    last: bool = False


def tangent_at(chart: Any, like: Array) -> Array:
    """The unit tangent of the curve at the origin of a chart.

    like: (2,) unit vector with which it is to make an acute angle.
    Returns (2,) along s and c; `like` itself where the gradient vanishes.
    """
    phi_s, phi_c = chart.gradient
    length = float(np.hypot(phi_s, phi_c))
    if not length > 0:
        return like
    tangent = np.array([-phi_c, phi_s]) / length
    return tangent if tangent @ like >= 0 else -tangent


def follow_curve(
    chart: Any, *, sense: float, low: float = 0.0, high: float = 1.0, most: int = 200
) -> Generator[PlanePoint, None, str]:
    """Places along the curve, the given one first, until c leaves [low, high].

    chart: of a place on the curve; sense: +1 to start towards larger, -1 towards smaller c; low, high: range of c; the
    last place lies on the bound. Yields place; those where the curve turns back are among them.  The generator returns
    "" where a bound was reached, or the sentence that says why it ended.
    """
    last = PlanePoint(chart, tangent_at(chart, np.array([0.0, sense])))
    yield last
    share = ceiling = 1.0
    for _ in range(most):
        step = share * float(min(r / max(abs(t), 1e-9) for r, t in zip(last.chart.reach, last.tangent, strict=True)))
        found, turn = _stepped(last, step, low, high), None
        if not isinstance(found, str) and found.tangent[1] * last.tangent[1] < 0:
            turn = _located_turn(last, step, found, low, high)
            if turn is None:  # a jump of the tangent, not a turn
                found = "the curve seems to turn back, but no place is found where it does"
        if isinstance(found, str):
            ceiling = CAUTION * share
            share *= 0.5
            if share < SHORTEST:
                return found
            continue
        yield from (found,) if turn is None else (turn, found)
        if found.last:
            return ""
        # Angle between two directions where the largest steps in s and c count alike
        a, b = found.tangent / last.chart.reach, last.tangent / last.chart.reach
        angle = float(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))
        share = min(ceiling, share * float(np.clip(EASY_ANGLE / max(angle, 1e-3), 0.4, 2.0)))
        ceiling = min(RECOVERY * ceiling, 1.0)
        last = found
    return f"stopped after {most} places"


def _stepped(last: PlanePoint, step: float, low: float, high: float) -> PlanePoint | str:
    """The place a step further on, or a sentence."""
    chart = last.chart
    at = step * last.tangent
    across = np.array([-last.tangent[1], last.tangent[0]])
    end = chart.position + NEARLY * at[1]
    reached = not low < end < high
    if reached:  # land on the bound: shorten the step and look for the root along it
        m = (high if end >= high else low) - chart.position
        at, across = at * (m / at[1] if at[1] else 1.0), np.array([1.0, 0.0])
        at[1] = m
    found = root_across(chart, at, across, max(WIDTH * step, 1e-6))
    if isinstance(found, str):
        return found
    (s, m), reading = found
    if not low - 1e-12 <= chart.position + m <= high + 1e-12:
        return "the corrector left the range"
    fresh = chart.moved(s, m, reading)
    if isinstance(fresh, str):
        return fresh
    return PlanePoint(fresh, tangent_at(fresh, last.tangent), last=reached)


def root_across(chart: Any, at: Array, across: Array, width: float) -> tuple[Array, Evaluation] | str:
    """The root of phi on a line.

    at, across: (2,) places at + n across of the line; width: bound of |n|.
    Returns ((s, m), what was read there), or a sentence about why there is none.
    """
    n, slope = 0.0, float(np.dot(chart.gradient, across))
    seen: list[tuple[float, float]] = []
    search: Search | None = None
    read: list[tuple[Array, Evaluation]] = []
    for _ in range(LINE_ROUNDS):
        place = at + n * across
        reading = chart.value(float(place[0]), float(place[1]))
        if isinstance(reading, str):
            return reading
        f = reading.value
        if not np.isfinite(f):
            return "phi is not finite"
        read.append((place, reading))
        if abs(f) <= reading.accuracy or (search and search.bracket.width <= CLOSED * width):
            break
        if search is not None:
            search = search.told(n, f)
        elif seen and f * seen[-1][1] < 0:
            search = Search(Bracket(*seen[-1], n, f), (*seen, (n, f)), rounds=1)
        seen.append((n, f))
        if search is not None:
            n = search.ask()
            continue
        if slope == 0:
            return "phi does not change across the curve"
        further = float(np.clip(inverse_interpolation(seen) if len(seen) > 1 else -f / slope, -width, width))
        if not abs(further - n) > 0:
            return "no root near the predicted place"
        n = further
    best = min(read, key=lambda each: abs(each[1].value))
    return best if abs(best[1].value) <= ACCEPTED else "the root across the curve was not located"


def _located_turn(before: PlanePoint, step: float, after: PlanePoint, low: float, high: float) -> PlanePoint | None:
    """The place between two at which t_c vanishes, by Illinois in the length of the step from the first."""
    bracket = Bracket(0.0, float(before.tangent[1]), step, float(after.tangent[1]))
    best: PlanePoint | None = None
    for _ in range(LINE_ROUNDS // 2):
        h = bracket.illinois
        place = _stepped(before, h, low, high)
        if isinstance(place, str):
            break
        f = float(place.tangent[1])
        if best is None or abs(f) < abs(best.tangent[1]):
            best = place
        if abs(f) <= TURNED:
            break
        bracket = bracket.told(h, f)
    return None if best is None or abs(best.tangent[1]) > UPRIGHT else replace(best, turns=True, last=False)
