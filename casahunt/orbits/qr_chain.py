"""Orthogonal iteration along a chain of small matrices, compiled.

    Q_{e+1} R_{e+1} = A_e Q_e,    T_{e+1} = R_{e+1} T_e        e = 1..E

Every factorisation is by Givens rotations of rows (j, i), which zero entry (i, j),

    c = a/r, s = b/r,    r = m sqrt((a/m)^2 + (b/m)^2), m = max(|a|, |b|):    nothing overflows.

A call of numpy's `qr` for a matrix of 3 x 3 takes 30 us, of which nearly all is its way there; a factor here takes 1.

Symbols: n directions, E factors.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..compiled import Caller, caller, kept

Array = np.ndarray

FACTORS_AT_ONCE, MANY_AT_ONCE = 12, 48
"""Factors of one call; the product may grow by 1e150 during the fewer ones."""
LARGEST_COMPILED = 8
"""Directions beyond which the compiled expressions would be longer than they are worth."""


def swept(factors: Array, q: Array, triangular: Array) -> tuple[Array, Array, Array]:
    """The frame behind some factors, their triangular factors, and these multiplied to `triangular`.

    factors: (k, n, n), k <= MANY_AT_ONCE; q, triangular: (n, n) orthonormal frame in front of them, and the product so
    far. Returns (n, n), (k, n, n), (n, n).
    """
    n = len(q)
    if n > LARGEST_COMPILED:
        steps = np.empty_like(factors)
        for k, factor in enumerate(factors):
            q, steps[k] = np.linalg.qr(factor @ q)
            triangular = steps[k] @ triangular
        return q, steps, triangular
    count = len(factors)
    buffers = _sweep(n, _calls_of(count)).buffers
    # What stands in the places of the factors that are too few comes after all that is read.
    buffers.inputs[0][:], buffers.inputs[1][:], buffers.inputs[2][:count] = q, triangular, factors
    buffers.trigger()
    frames, products, steps = buffers.outputs
    return frames[count - 1].copy(), steps[:count].copy(), products[count - 1].copy()


@kept(maxsize=16)
def _sweep(n: int, count: int) -> Caller:
    """`swept` for so many factors, compiled."""
    A, q, T = ca.SX.sym("A", n, n), ca.SX.sym("q", n, n), ca.SX.sym("T", n, n)
    after, r = _givens(ca.mtimes(A.T, q.T))  # numpy's order of axes is the reverse of CasADi's
    one = ca.Function("factor", [q, T, A], [ca.densify(x.T) for x in (after, ca.mtimes(r, T.T), r)])
    function = one.mapaccum("sweep", count, 2)
    return caller(function, [(n, n), (n, n), (count, n, n)], [(count, n, n)] * 3)


def _calls_of(count: int) -> int:
    """The compiled length for some factors."""
    return next(length for length in (FACTORS_AT_ONCE, 2 * FACTORS_AT_ONCE, MANY_AT_ONCE) if length >= count)


def carried_backwards(steps: Array, z: Array) -> Array:
    """A row vector carried backwards through a chain, z_e = z_{e+1} R_{e+1}, each to a scale of its own.

    steps: (E, n, n) the R; z: (n,) real, behind the last. Returns (E, n) the z behind every R.
    """
    E, n = len(steps), len(z)
    found = np.empty((E, n))
    if n > LARGEST_COMPILED:
        for e in range(E - 1, -1, -1):
            found[e] = z
            z = z @ steps[e]
            z = z / (np.abs(z).max() or 1.0)
        return found
    end = E
    while end > 0:
        count = min(end, MANY_AT_ONCE)
        buffers = _backwards(n, _calls_of(count)).buffers
        buffers.inputs[0][:], buffers.inputs[1][:count] = z, steps[end - count : end][::-1]
        buffers.trigger()
        carried = buffers.outputs[0]
        found[end - 1], found[end - count : end - 1] = z, carried[: count - 1][::-1]
        z = carried[count - 1].copy()
        end -= count
    return found


@kept(maxsize=16)
def _backwards(n: int, count: int) -> Caller:
    """`carried_backwards` for so many factors in reverse order, compiled."""
    z, A = ca.SX.sym("z", n), ca.SX.sym("A", n, n)
    through = ca.mtimes(A, z)  # numpy's order of axes is the reverse of CasADi's
    size = ca.mmax(ca.fabs(through))
    one = ca.Function("factor", [z, A], [through / ca.if_else(size > 0, size, 1)])
    return caller(one.mapaccum("backwards", count), [n, (count, n, n)], [(count, n)])


def _givens(m: Any) -> tuple[Any, Any]:
    """(Q, R) with m = Q R, of symbols."""
    n = m.size1()
    r, q = ca.SX(m), ca.SX.eye(n)
    q = ca.densify(q)
    for j in range(n):
        for i in range(n - 1, j, -1):
            a, b = r[i - 1, j], r[i, j]
            size = ca.fmax(ca.fabs(a), ca.fabs(b))
            unit = ca.if_else(size > 0, size, 1)
            length = ca.sqrt((a / unit) ** 2 + (b / unit) ** 2)
            c = ca.if_else(size > 0, a / unit / ca.if_else(size > 0, length, 1), 1)
            s = ca.if_else(size > 0, b / unit / ca.if_else(size > 0, length, 1), 0)
            upper, lower = r[i - 1, :], r[i, :]
            r[i - 1, :], r[i, :] = c * upper + s * lower, c * lower - s * upper
            r[i, j] = 0
            left, right = q[:, i - 1], q[:, i]
            q[:, i - 1], q[:, i] = c * left + s * right, c * right - s * left
    return q, r
