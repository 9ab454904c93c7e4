"""One interval of a motion: its stages by Newton, from where the one before it foretells them.

    w = (x, stages),    residual(w, h) = 0,    x_next = the end of the polynomial

The equations are those of the boundary value problem (collocation/interval.py).  The last Legendre coefficient of the
polynomial, in units of the state scale, tells how well it is resolved.

Symbols: n states, d stages, R = n (d + 1); all states scaled.
"""

from __future__ import annotations

import numpy as np

from ..collocation.interval import interval_map
from ..collocation.scheme import Scheme
from ..hybrid.system import Exit, Field

Array = np.ndarray

NEWTON_LIMIT = 12
MOST_SLOW = 2  # Newton steps that do not halve before an interval is given up
STALLED = 1e-12  # a Newton step of this relative size that does not shrink any more is rounding
EXTRAPOLATED = 1.0  # the longest interval that its predecessor foretells, in units of that one's length


class Stepper:
    """One interval from x of length h: Newton on its stages."""

    def __init__(self, field: Field, s: Scheme, p: Array, scale: Array, sign: float, dp: Array | None = None) -> None:
        self.function = interval_map(field, scale.size, p.size, s.degree, s.kind, 1)
        self.scheme, self.p, self.scale, self.sign = s, p, scale, sign
        self.dp, self.no_next = np.zeros(p.size) if dp is None else dp, np.zeros(scale.size)

    def scale_of(self, way_out: Exit) -> float:
        """Size of an event in a motion of the size of the state scale."""
        return abs(float(way_out.event.function(self.scale, 0.0, self.p)))

    def slope(self, x: Array) -> Array:
        """f(x), scaled: minus d(node row)/dT of an interval whose stages all sit at x."""
        rows = x.size * (self.scheme.degree + 1)
        return -self._call(np.tile(x, self.scheme.degree + 1), 0.0)[rows + 1, rows - x.size :]

    def through(self, x: Array, stages: Array, h: float) -> Array:
        """Sensitivity of the end of an interval to its start, its length, and lambda, which moves p along dp.

        Parameters
        ----------
        x, stages
            (n,) start and (n d,) stages, scaled.
        h
            its length.

        Returns
        -------
        (n, n + 2) d end/d (start, length, lambda), scaled.
        """
        n, rows = x.size, x.size + stages.size
        columns = self._call(np.concatenate([x, stages]), h).T
        by_stages, by_known = columns[:, n + 1 : rows + 1], columns[:, [*range(1, n + 1), rows + 1, rows + 2]]
        eliminated = np.linalg.solve(by_stages[: rows - n], by_known[: rows - n])
        return by_stages[rows - n :] @ eliminated - by_known[rows - n :]

    def _call(self, w: Array, h: float) -> Array:
        return self.function(w, self.no_next, h, 1.0, self.sign, self.p, self.dp, self.scale)[0]

    def __call__(self, x: Array, stages: Array, h: float, goal: float) -> tuple[Array, Array] | None:
        """(stages, end), both scaled, to an error of about `goal`, or None where Newton does not converge."""
        n, rows = x.size, x.size + stages.size
        w = np.concatenate([x, stages])
        last, slow = np.inf, 0
        for _ in range(NEWTON_LIMIT):
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
                return w[n:], jacobian[rows - n :] @ step - residual[rows - n :]
            slow += size > 0.5 * last
            if slow > MOST_SLOW or size > min(2 * last, 1e6):
                return None
            last = size
        return None


def predict(s: Scheme, previous: tuple[Array, float] | None, start: Array, h: float) -> Array:
    """Stages extrapolated from the previous interval; constant where that reaches too far.

    Parameters
    ----------
    s
        the scheme.
    previous
        ((d + 1) n,) start and stages of the previous interval, and its length [s]; None: there is none.
    start, h
        (n,) start and length [s] of the new one.

    Returns
    -------
    (d n,) stages.
    """
    d, n = s.degree, start.size
    if not reaches(previous, h):
        return np.tile(start, d)
    assert previous is not None
    w, last = previous
    return (s.interpolation(1 + s.stages * (h / last)) @ w.reshape(d + 1, n)).ravel()


def reaches(previous: tuple[Array, float] | None, h: float) -> bool:
    """Whether the previous interval may be extrapolated to one of another length.

    Parameters
    ----------
    previous
        ((d + 1) n,) its start and stages, and its length [s]; None: there is none.
    h
        the other length [s].

    Returns
    -------
    False where it is too long.
    """
    return previous is not None and h <= EXTRAPOLATED * previous[1]


def last_mode(s: Scheme, start: Array, stages: Array) -> float:
    """The largest last Legendre coefficient of the states.

    Parameters
    ----------
    s
        the scheme.
    start, stages
        (n,), (d n,) states of the interval.

    Returns
    -------
    Its absolute value, in the units of the states.
    """
    return float(np.max(np.abs(s.last_mode @ np.concatenate([start, stages]).reshape(s.degree + 1, -1))))
