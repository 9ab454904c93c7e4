"""One interval of a motion: its stages by Newton, from where the one before it foretells them.

    residual(stages, h) = 0,    end = the polynomial through start and stages at 1

The equations are those of the boundary value problem (collocation/interval.py).  Where few of them are left when
positions are eliminated, the whole iteration is one compiled function (interval_newton.py), else numpy factorises.
The last Legendre coefficient of the polynomial, in units of the state scale, tells how well it is resolved.

Symbols: n states, d stages, R = n (d + 1); all states scaled.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..collocation.interval import IntervalMap, field_at, interval_map
from ..collocation.newton import MOST_NEWTON_STEPS
from ..collocation.scheme import Scheme
from ..hybrid.system import Exit, Field
from .interval_newton import newton_steps

Array = np.ndarray

CALLS = 4  # of compiled steps, each at most half as long as the one before
MOST_SLOW = 2  # Newton steps that do not halve before an interval is given up
STALLED = 1e-12  # a Newton step of this relative size that does not shrink any more is rounding
NOTHING_LESS = 1e-16  # relative to the states, nothing smaller is left of an interval's equations
LED_ASTRAY = 0.1  # error of foretold stages, in units of the way to go, beyond which constant ones are no worse


class ExtrapolatedStages(NamedTuple):
    """Where Newton begins: the polynomial through w at the local times begins + part c, c those of the stages.

    Attributes
    ----------
    w : (d + 1, n) start and stages of the polynomial; (n,) for one that is constant.
    begins, part : where in its interval the new one begins, and its length in units of that interval's.
    """

    w: Array
    begins: float = 0.0
    part: float = 1.0


class Previous(NamedTuple):
    """An interval that is done: (d + 1, n) start and stages, length [s], largest last Legendre coefficient."""

    w: Array
    h: float
    error: float


class SolvedInterval(NamedTuple):
    """An interval: (d n,) stages, (n,) end, largest last Legendre coefficient of a state."""

    stages: Array
    end: Array
    error: float


class Stepper:
    """One interval from x of length h: Newton on its stages."""

    def __init__(self, field: Field, s: Scheme, p: Array, scale: Array, sign: float, dp: Array | None = None) -> None:
        self.field, self.scheme, self.p, self.scale, self.sign = field, s, p, scale, sign
        self.dp, self.no_next = np.zeros(p.size) if dp is None else dp, np.zeros(scale.size)
        self._compiled = newton_steps(field, scale.size, p.size, s.degree, s.kind)

    @cached_property
    def function(self) -> IntervalMap:
        """The equations with their derivatives."""
        return interval_map(self.field, self.scale.size, self.p.size, self.scheme.degree, self.scheme.kind, 1)

    def scale_of(self, way_out: Exit) -> float:
        """Size of an event in a motion of the size of the state scale."""
        return abs(float(way_out.event.function(self.scale, 0.0, self.p)))

    def slope(self, x: Array) -> Array:
        """f(x), scaled."""
        return field_at(self.field, x, self.sign, self.p, self.scale)

    def through(self, x: Array, stages: Array, h: float) -> Array:
        """Sensitivity of the end of an interval to its start, its length, and lambda, which moves p along dp.

        x, stages: (n,) start and (n d,) stages, scaled. Returns (n, n + 2) d end/d (start, length, lambda), scaled.
        """
        n, rows = x.size, x.size + stages.size
        columns = self._call(np.concatenate([x, stages]), h).T
        by_stages, by_known = columns[:, n + 1 : rows + 1], columns[:, [*range(1, n + 1), rows + 1, rows + 2]]
        eliminated = np.linalg.solve(by_stages[: rows - n], by_known[: rows - n])
        return by_stages[rows - n :] @ eliminated - by_known[rows - n :]

    def _call(self, w: Array, h: float) -> Array:
        return self.function(w, self.no_next, h, 1.0, self.sign, self.p, self.dp, self.scale)[0]

    def __call__(self, x: Array, guess: ExtrapolatedStages, h: float, goal: float) -> SolvedInterval | None:
        """The interval to an error of about `goal`, or None where Newton does not converge."""
        goal = max(goal, NOTHING_LESS)
        return self._stepped(x, guess, h, goal) if self._compiled is not None else self._factorised(x, guess, h, goal)

    def _stepped(self, x: Array, guess: ExtrapolatedStages, h: float, goal: float) -> SolvedInterval | None:
        """By compiled steps, a few at a time."""
        assert self._compiled is not None
        buffers = self._compiled.buffers
        start, w, place, length, sign, p, scale = buffers.inputs
        start[:], w[:], place[0], place[1], length[0] = x, guess.w, guess.begins, guess.part, h
        sign[0], p[:], scale[:] = self.sign, self.p, self.scale
        stages, end, told = buffers.outputs
        last = math.inf
        for _ in range(CALLS):
            buffers.trigger()
            *sizes, size, error, total = told.tolist()
            if not math.isfinite(total):
                return None
            before, final = sizes[-2:]
            shrinks = final / before if before > 0 else 0.0
            stalled = shrinks > 0.3 and final <= STALLED * max(1.0, size)
            if stalled or shrinks < 0.5 and final * shrinks / (1 - shrinks) <= goal * max(1.0, size):
                return SolvedInterval(stages.copy(), end.copy(), error)
            if sizes[0] > min(0.5 * last, 1e6):
                return None
            last = sizes[0]
            w[0], w[1:], place[0], place[1] = x, stages.reshape(-1, x.size), 0.0, 1.0
        return None

    def _factorised(self, x: Array, guess: ExtrapolatedStages, h: float, goal: float) -> SolvedInterval | None:
        """By numpy's LU of the whole."""
        n, d = x.size, self.scheme.degree
        rows = n * (d + 1)
        if guess.w.ndim == 1:
            stages = np.tile(guess.w, d)
        else:
            stages = (self.scheme.interpolation(guess.begins + guess.part * self.scheme.stages) @ guess.w).ravel()
        w = np.concatenate([x, stages])
        last, slow = np.inf, 0
        for _ in range(MOST_NEWTON_STEPS):
            block = self._call(w, h)
            residual, jacobian = block[0], block[n + 1 : rows + 1].T
            try:
                step = np.linalg.solve(jacobian[: rows - n], residual[: rows - n])
            except np.linalg.LinAlgError:
                return None
            size = float(abs(step).max())
            if not size < np.inf:
                return None
            w[n:] -= step
            stalled = size > 0.3 * last and size <= STALLED * max(1.0, float(abs(w).max()))
            if size * size <= goal or stalled:  # the square of a Newton step is what it leaves
                end = jacobian[rows - n :] @ step - residual[rows - n :]
                return SolvedInterval(w[n:], end, last_mode(self.scheme, w.reshape(d + 1, n)))
            slow += size > 0.5 * last
            if slow > MOST_SLOW or size > min(2 * last, 1e6):
                return None
            last = size
        return None


def extrapolated_stages(d: int, previous: Previous | None, start: Array, h: float) -> ExtrapolatedStages:
    """Stages extrapolated from the previous interval; constant where that leads astray.

    Its last Legendre coefficient grows on the way to the end of the new interval by less than the Chebyshev polynomial
    of its degree does; what comes after it is about as large there.

    previous: the previous interval; None: there is none; start, h: (n,) start and length [s] of the new one.
    """
    if previous is None:
        return ExtrapolatedStages(start)
    part = h / previous.h
    astray = previous.error * math.cosh(d * math.acosh(1 + 2 * part))
    moves = part * float(np.abs(previous.w[-1] - previous.w[0]).max())
    return ExtrapolatedStages(previous.w, 1.0, part) if astray <= LED_ASTRAY * moves else ExtrapolatedStages(start)


def last_mode(s: Scheme, w: Array) -> float:
    """The largest last Legendre coefficient of the states.

    w: (d + 1, n) start and stages. Returns its absolute value, in the units of the states.
    """
    return float(np.max(np.abs(s.last_mode @ w)))
