"""Roots of a function of one number, and the boundary of a condition: bracketed, and polished inside the bracket.

    bracket          f(a) f(b) < 0;  the end whose sign f(x) has moves to x
    false position   x = b - f_b (b - a)/(f_b - f_a)
    Illinois         the same, with f of an end halved for every time in a row that the other one moved
    Newton           x - f/f' where that is inside, else the middle
    inverse          s(0) of the polynomial s(f) through the three points of smallest |f|
    parabolas        whether two zeros may hide between neighbouring places, by those through three places each
    secant           x_2 = x_1 - f_1 (x_1 - x_0)/(f_1 - f_0), without a bracket
    golden section   where f is least

A simple root costs Illinois steps of order 1.44, Newton's of order 2, inverse interpolation of order 1.84.  At a jump
and at a multiple root (of odd order) all of them are slow, and only halving is sure: n halvings leave (b - a)/2^n.

An end of which only the sign is known has f = +inf or -inf: the next place is the middle.  Nothing here calls a costly
function: a bracket is asked for a place and told what is there, so that whoever evaluates decides what a failure means
and when to stop.  Only `boundary` and `secant`, for cheap functions, run to their end.

Source: Dowell and Jarratt, BIT 11 (1971) 168-174, for Illinois steps and their order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

Array = np.ndarray

INVERSE_ROUNDS = 8
"""Rounds of inverse interpolation, which mostly needs four; then the safe Illinois steps alone."""
CLOSED = 1e-13
"""Width of a bracket, in units of that of the search, that is down to rounding."""
MOST_HALVINGS = 60
"""Of an interval: what is left of it is below the rounding of any place in it, whatever was looked for."""
LOOKED_AT = np.linspace(0.0, 1.0, 17)
"""Parts of a step, an interval or a phase at which it is looked at, more than an interval's polynomial has zeros."""
DOUBTED = 4.0
"""So many times what parabolas differ by they may be off: a narrow pair of zeros shows but a part of itself."""
GOLDEN_PART = (math.sqrt(5) - 1) / 2
BESIDE = 0.02
"""Where f cannot be computed, the next place is this part of the bracket further on, then further back, and so on."""


@dataclass(frozen=True)
class Bracket:
    """Two places between which f changes sign; a may be the larger one.

    Attributes
    ----------
    a, f_a, b, f_b : the ends and f there, of opposite signs; +inf or -inf where no more than the sign is known.
    halved_a, halved_b : times in a row that the other end has moved, less one: f there is halved as often.
    moved : end that moved last, "" for neither.

    Raises
    ------
    ValueError : f has one sign at both ends, or is zero or NaN at one.
    """

    a: float
    f_a: float
    b: float
    f_b: float
    halved_a: int = 0
    halved_b: int = 0
    moved: str = ""

    def __post_init__(self) -> None:
        if not (self.f_a < 0 < self.f_b or self.f_b < 0 < self.f_a):
            raise ValueError(
                f"no bracket: f({self.a:.17g}) = {self.f_a:.3g} and f({self.b:.17g}) = {self.f_b:.3g} "
                "must have opposite signs"
            )

    @property
    def width(self) -> float:
        """|b - a|."""
        return abs(self.b - self.a)

    @property
    def middle(self) -> float:
        """(a + b)/2."""
        return (self.a + self.b) / 2

    def holds(self, x: float) -> bool:
        """Whether x is between the ends and none of them."""
        return self.a < x < self.b or self.b < x < self.a

    def at(self, share: float) -> float:
        """The place that part of the way from a to b."""
        return self.a + share * (self.b - self.a)

    def share(self, edge: float = 0.0) -> float:
        """Part of the way from a to b at which false position has the root, at least `edge` off both ends."""
        if not (math.isfinite(self.f_a) and math.isfinite(self.f_b)):
            return 0.5
        return min(max(self.f_a / (self.f_a - self.f_b), edge), 1 - edge)

    @property
    def illinois(self) -> float:
        """The place of the Illinois step; the middle where an end has no value, or rounding leads out."""
        if not (math.isfinite(self.f_a) and math.isfinite(self.f_b)):
            return self.middle
        f_a, f_b = math.ldexp(self.f_a, -self.halved_a), math.ldexp(self.f_b, -self.halved_b)
        x = self.b - f_b * (self.b - self.a) / (f_b - f_a)
        return x if self.holds(x) else self.middle

    def newton(self, x: float, f: float, slope: float) -> float:
        """Newton's step, where that is inside.

        Returns x - f/slope; the middle where that is outside.
        """
        step = x - f / slope if slope else math.inf
        return step if self.holds(step) else self.middle

    def told(self, x: float, f: float) -> Bracket:
        """The bracket with one end moved.

        Returns bracket; the end where f has this sign is at x. Raises ValueError: f is zero, and x the root; or NaN.
        """
        if (f > 0) == (self.f_b > 0):
            return Bracket(self.a, self.f_a, x, f, self.halved_a + (self.moved == "b"), 0, "b")
        return Bracket(x, f, self.b, self.f_b, 0, self.halved_b + (self.moved == "a"), "a")


@dataclass(frozen=True)
class Search:
    """A bracket with a memory, for a costly f that may fail: ask for a place, tell f there or that there is none.

    Attributes
    ----------
    bracket : where the root is.
    seen : (x, f) told so far, the finite ends of the first bracket included.
    rounds : times told.
    failures : failures in a row.
    """

    bracket: Bracket
    seen: tuple[tuple[float, float], ...]
    rounds: int = 0
    failures: int = 0

    @staticmethod
    def within(bracket: Bracket) -> Search:
        """The search that starts from a bracket."""
        ends = ((bracket.a, bracket.f_a), (bracket.b, bracket.f_b))
        return Search(bracket, tuple(end for end in ends if math.isfinite(end[1])))

    def ask(self) -> float:
        """The next place, inside the bracket."""
        x = inverse_interpolation(self.seen) if 0 < self.rounds < INVERSE_ROUNDS else math.nan
        if not self.bracket.holds(x):
            x = self.bracket.illinois
        if self.failures:  # near by: whatever fails may fall into place there
            sense = 1 if self.failures % 2 else -1
            x += sense * BESIDE * self.failures * (self.bracket.b - self.bracket.a)
        return x if self.bracket.holds(x) else self.bracket.middle

    def told(self, x: float, f: float) -> Search:
        """What to ask next, after a place was told.

        x, f: the place, and f there; NaN and infinity are failures. Raises ValueError: f is zero, and x the root.
        """
        if not math.isfinite(f):
            return self.failed()
        return Search(self.bracket.told(x, f), (*self.seen, (x, f)), self.rounds + 1)

    def failed(self) -> Search:
        """What to ask next after f was not computed at the place asked for."""
        return replace(self, rounds=self.rounds + 1, failures=self.failures + 1)


def inverse_interpolation(seen: Sequence[tuple[float, float]]) -> float:
    """x at f = 0 of the polynomial x(f) through the three points (x, f) of smallest |f|; nan where two coincide."""
    if len(seen) < 2:
        return math.nan
    s, f = np.array(sorted(seen, key=lambda point: abs(point[1]))[:3]).T
    with np.errstate(all="ignore"):
        weights = [np.prod([f[j] / (f[j] - f[i]) for j in range(f.size) if j != i]) for i in range(f.size)]
        return float(np.dot(weights, s))


def boundary(
    beyond: Callable[[float], bool], low: float, high: float, *, width: float = 0.0, rounds: int = 2000
) -> tuple[float, float]:
    """The boundary of a condition that holds at one end of a range and not at the other.

    beyond: the condition, monotone in the coordinate; a place where it cannot be told counts as the caller answers. It
    is not asked at the ends; low, high: ends, where it does not hold and where it does; `low` may be the larger one;
    width: to stop at; 0 for neighbouring floating-point numbers; rounds: halvings after which to stop at any width.
    Returns last place before the boundary, first place beyond it.
    """
    for _ in range(rounds):
        middle = (low + high) / 2
        if abs(high - low) <= width or middle in (low, high):
            break
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return low, high


def secant(
    f: Callable[[float], float], x0: float, x1: float, *, tolerance: float, rounds: int = 50
) -> tuple[float, float]:
    """Secant steps to a root, exact after one where f is linear.

    x0, x1: places where it begins; tolerance: of |f|, to stop at. Returns x and f(x); |f(x)| > `tolerance`, or NaN,
    tells that there was no root within reach: f is flat, fails, or needs more `rounds`.
    """
    f0, f1 = f(x0), f(x1)
    for _ in range(rounds):
        if f1 == f0 or math.isnan(f0) or math.isnan(f1):
            break
        x0, x1, f0 = x1, x1 - f1 * (x1 - x0) / (f1 - f0), f1
        f1 = f(x1)
        if abs(f1) <= tolerance:
            break
    return x1, f1


def golden(f: Callable[[float], float], a: float, b: float, width: float, enough: float = -math.inf) -> list[float]:
    """Two places about which f is least between a and b, the better one first; or one where f is `enough`.

    width: of what is left between the ends.
    """
    c, d = b - GOLDEN_PART * (b - a), a + GOLDEN_PART * (b - a)
    f_c, f_d = f(c), f(d)
    while b - a > width and min(f_c, f_d) > enough:
        if f_c <= f_d:
            b, d, f_d = d, c, f_c
            f_c = f(c := b - GOLDEN_PART * (b - a))
        else:
            a, c, f_c = c, d, f_d
            f_d = f(d := a + GOLDEN_PART * (b - a))
    return [c, d] if f_c <= f_d else [d, c]


def hides_a_pair(at: Array, values: Array, low: float, high: float, mean: float | None = None) -> bool:
    """Whether a function may have a pair of zeros between two of the places at which it is known.

    at, values: (m,) places, in order, and values; m from 2 to 4; low, high: the two places between which it is asked:
    neighbours; mean: of the function between them, where it is known: a further parabola. Returns True where the
    parabolas, or a single one and the line, differ by more than a part of the distance from zero, or cross it; where
    two places are all that is known.
    """
    k = int(np.flatnonzero(at == low)[0])
    if values[k] * values[k + 1] < 0:
        return False
    if at.size < 3 and mean is None:
        return True
    s, sign = low + (high - low) * LOOKED_AT, np.sign(values[k])
    curves = [_parabola(at[j : j + 3], values[j : j + 3], s) for j in range(at.size - 2)]
    line = values[k] + (values[k + 1] - values[k]) * LOOKED_AT
    if mean is not None:
        curves.append(line + 6 * (mean - line.mean()) * LOOKED_AT * (1 - LOOKED_AT))
    others = curves[1:] or [line if at.size < 3 else (curves[0] + line) / 2]
    spread = max(float(np.max(np.abs(curves[0] - other))) for other in others)
    nearest = min(float(np.min(sign * curve)) for curve in curves)
    return nearest <= DOUBTED * spread


def _parabola(at: Array, values: Array, s: Array) -> Array:
    """The parabola through three places, by divided differences."""
    (a, b, c), (f, g, h) = at, values
    first, second = (g - f) / (b - a), (h - g) / (c - b)
    return np.asarray(f + (s - a) * (first + (s - b) * (second - first) / (c - a)))
