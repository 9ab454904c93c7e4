"""Eigenvalues of a long product of matrices that spans many decades, and what arithmetic can resolve of them.

    M = A_E ... A_1,    Q_{e+1} R_{e+1} = A_e Q_e    (orthogonal iteration around the cycle)

Each factor stays near one; after a few rounds Q has ordered the directions by growth, the product of the triangular
factors is graded, and its small and large eigenvalues are both accurate.  Those many decades below the largest are read
off the diagonal blocks of the product, which no larger one enters.

A factor is known to delta_e, its noise.  With v and z the right and left eigenvectors carried along in the Q's, the
largest eigenvalue is uncertain by

    kappa = sum_e  delta_e |z_{e+1}| |v_e| / |z_{e+1} . R_e v_e|

of itself to first order.  Where it meets another one, both near zero, that is far too much: of two that meet,
lambda' (lambda' - lambda) = kappa lambda^2, and the uncertainty sqrt(1/4 + kappa) - 1/2 is taken.

The i-th one is the product of the i-th diagonal entries r_e; where delta_e is no smaller than r_e, nothing but its
being below the product of max(|r_e|, delta_e) is known.

Symbols: n directions, E factors.

Orthogonal iteration along a chain of small matrices, compiled.

    Q_{e+1} R_{e+1} = A_e Q_e,    T_{e+1} = R_{e+1} T_e        e = 1..E

Every factorisation is by Givens rotations of rows (j, i), which zero entry (i, j),

    c = a/r, s = b/r,    r = m sqrt((a/m)^2 + (b/m)^2), m = max(|a|, |b|):    nothing overflows.

A call of numpy's `qr` for a matrix of 3 x 3 takes 30 us, of which nearly all is its way there; a factor here takes 1.

Symbols: n directions, E factors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..compiled import Caller, caller, kept

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


Array = np.ndarray

MULTIPLIER_ROUNDS = 12
ONE_ROUND, EPS = 1e-12, float(np.finfo(float).eps)
"""Relative effect of rounding on a value that is known from one round; rounding."""
SMALLEST_MULTIPLIER = 1e-12
"""Half multipliers below this are zero for every purpose and do not delay the iteration."""
LARGEST_MULTIPLIER = 1e150
"""Half multipliers beyond this are cut to it, and the set is not trusted: their squares would overflow."""
READ_OFF = 1e-12
"""Eigenvalues below this part of the largest one are read off the diagonal blocks."""
BLOCK_GAP, BLOCK_LEAK = 1e3, 1e-10
"""Neighbouring blocks differ in size by BLOCK_GAP; what is left of the larger one's directions in the smaller one's."""
UNCERTAIN = 0.1
"""A value whose relative uncertainty, by rounding or by the mesh, is larger is known by its bound only."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues of a product.

    Attributes
    ----------
    values : (n,) complex, by decreasing modulus; moduli beyond `LARGEST_MULTIPLIER` are cut to it.
    floor : (n,) bound on the modulus of a value that the noise of the factors hides; 0 where it does not.
    uncertainty : that of the largest value, relative, by the noise of the factors; 0 where none is given.
    frame : (n, n) orthonormal directions at the start, by decreasing growth.
    """

    values: Array
    floor: Array
    uncertainty: float
    frame: Array


def spectrum(
    factors: Array | list[Array],
    noise: Array | None = None,
    frame: Array | None = None,
    *,
    rounds: int = MULTIPLIER_ROUNDS,
    wanted: float = 0.0,
) -> Spectrum:
    """Eigenvalues of factors[-1] ... factors[0], largest first, each to its own relative accuracy.

    factors: (n, n) matrices; noise: (E,) absolute uncertainty delta_e of each of them; frame: (n, n) directions to
    start from, such as those of a product that is nearly the same.
    """
    chain = np.asarray(factors)
    n = chain.shape[2]
    if n == 0:
        return Spectrum(np.zeros(0), np.zeros(0), 0.0, np.zeros((0, 0)))
    q = _first_frame(n) if frame is None else frame
    previous: list[float] = []
    for _ in range(rounds):
        start = q
        q, steps, triangular, exponent = _round(chain, q)
        turn, resolved = start.T @ q, False
        if wanted and not exponent:
            raw, resolved = _resolved(turn, triangular, wanted)
        else:
            raw = _eigenvalues(turn, triangular)
        values = _limited(raw, exponent)
        sizes = np.abs(values)
        order = np.argsort(-sizes, kind="stable")
        values, now = values[order], sizes[order].tolist()
        if resolved or (previous and _same(now, previous)):
            break
        previous = now
    low = sizes[order] < READ_OFF * now[0]
    if n > 2 and low.any():
        values = np.where(low, _limited(_of_blocks(turn, triangular), exponent), values)
    if noise is None:
        return Spectrum(values, np.zeros(n), 0.0, q)
    r = steps[0] if len(steps) == 1 else np.concatenate(steps)
    return Spectrum(values, _floor(r, noise), _uncertainty(r, noise, turn, triangular), q)


def _same(sizes: list[float], previous: list[float]) -> bool:
    """Whether moduli are those of the round before, but for those that are zero for every purpose."""
    pairs = zip(sizes, previous, strict=True)
    return all(abs(size - before) < ONE_ROUND * size for size, before in pairs if size > SMALLEST_MULTIPLIER)


def _round(chain: Array, q: Array) -> tuple[Array, list[Array], Array, int]:
    """Once around the cycle: the frame behind, the triangular factors, and their product times 2^-exponent."""
    triangular, exponent, steps = np.eye(len(q)), 0, []
    e, at_once = 0, MANY_AT_ONCE
    while e < len(chain):
        after, some, product = swept(chain[e : e + at_once], q, triangular)
        size = float(np.abs(product).max())
        if at_once > FACTORS_AT_ONCE and not size < LARGEST_MULTIPLIER**2:  # too many at once
            at_once = FACTORS_AT_ONCE
            continue
        q, triangular = after, product
        steps.append(some)
        e += len(some)
        if size > LARGEST_MULTIPLIER:  # by a power of two: no digit changes
            power = math.frexp(size)[1]
            triangular, exponent = np.ldexp(triangular, -power), exponent + power
    return q, steps, triangular, exponent


@lru_cache
def _first_frame(n: int) -> Array:
    """(n, n) directions of no meaning."""
    return np.linalg.qr(np.random.default_rng(1).standard_normal((n, n)))[0]


def _limited(values: Array, exponent: int) -> Array:
    """values 2^exponent, with moduli of at most `LARGEST_MULTIPLIER`."""
    if exponent == 0 and np.abs(values).max() < LARGEST_MULTIPLIER:
        return values
    with np.errstate(divide="ignore"):
        logs = np.log(np.abs(values)) + exponent * math.log(2)
    large = logs > math.log(LARGEST_MULTIPLIER)
    if not large.any():
        return values if exponent == 0 else np.ldexp(values.real, exponent) + 1j * np.ldexp(values.imag, exponent)
    size = np.where(values == 0, 1.0, np.abs(values))
    direction = values.real / size + 1j * (values.imag / size)  # a complex quotient of subnormal numbers overflows
    return direction * np.where(large, LARGEST_MULTIPLIER, np.exp(np.minimum(logs, math.log(LARGEST_MULTIPLIER))))


def _eigenvalues(turn: Array, triangular: Array) -> Array:
    """(n,) eigenvalues of turn @ triangular; of two, the smaller one by their product, of which it has all digits.

    Half the distance of two, squared, is ((a - d) / 2)^2 + b c = ((a + d) / 2)^2 - det: the sum that cancels less.
    """
    whole = turn @ triangular
    if len(whole) != 2:
        return np.linalg.eigvals(whole)
    (a, b), (c, d) = whole.tolist()
    ((e, f), (g, h)), ((p, _), (_, r)) = turn.tolist(), triangular.tolist()
    middle, apart, turned = (a + d) / 2, (a - d) / 2, e * h - f * g
    product = turned * p * r
    if apart * apart + abs(b * c) < middle * middle + abs(product):
        squared = apart * apart + b * c
    else:
        squared = middle * middle - product
    if squared < 0:
        return np.array([complex(middle, math.sqrt(-squared)), complex(middle, -math.sqrt(-squared))])
    large = middle + math.copysign(math.sqrt(squared), middle)
    return np.array([large, turned * p * (r / large) if large else 0.0])


def _resolved(turn: Array, triangular: Array, wanted: float) -> tuple[Array, bool]:
    """Eigenvalues (n,) of turn @ triangular, and whether rounding leaves those alone that are at least `wanted`.

    The one with the right and left eigenvectors x and y, y . x = 1, moves by eps |y| |turn| |triangular| |x|: by no
    more than its own size says, where the frame has taken the directions apart.
    """
    values, right = np.linalg.eig(turn @ triangular)
    sizes = np.abs(values)
    try:
        left = np.abs(np.linalg.inv(right))
    except np.linalg.LinAlgError:
        return values, False
    with np.errstate(over="ignore", invalid="ignore"):  # of eigenvectors that are all but one: no number, and not known
        moved = (((left @ np.abs(turn)) @ np.abs(triangular)) * np.abs(right).T).sum(axis=1)
        # One that rounding has made small may be one that is wanted: what moves it says so, not its size.
        known = EPS * moved <= ONE_ROUND * np.maximum(sizes, wanted)
    return values, bool(known.all())


def _of_blocks(turn: Array, triangular: Array) -> Array:
    """(n,) eigenvalues of the diagonal blocks of turn @ triangular, cut where sizes differ by much.

    In the whole matrix an eigenvalue solver loses what lies 16 decades below the largest entry.
    """
    n, sizes = len(turn), np.abs(np.diag(triangular))
    cuts = [
        k for k in range(1, n)
        if sizes[:k].min() > BLOCK_GAP * sizes[k:].max() and np.max(np.abs(turn[k:, :k])) < BLOCK_LEAK
    ]  # fmt: skip
    found = []
    for a, b in zip([0, *cuts], [*cuts, n], strict=True):
        block = np.linalg.eigvals(turn[a:b, a:b] @ triangular[a:b, a:b])
        found.append(block[np.argsort(-np.abs(block), kind="stable")])
    return np.concatenate(found).astype(complex)


def _floor(steps: Array, noise: Array) -> Array:
    """(n,) see `Spectrum`; from the triangular factors (E, n, n)."""
    r = np.abs(np.diagonal(steps, axis1=1, axis2=2))
    delta = np.broadcast_to(noise[:, None], r.shape)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        hidden = np.sum(np.where(delta > 0, delta / r, 0.0), axis=0) > UNCERTAIN
        bound = np.exp(np.sum(np.log(np.maximum(r, delta)), axis=0))
    return np.where(hidden, bound, 0.0)


def _uncertainty(steps: Array, noise: Array, turn: Array, triangular: Array) -> float:
    """See `Spectrum`."""
    whole = turn @ triangular
    z = _leading_vector(whole.T) @ turn  # from the basis at the start to the one at the end
    if np.isrealobj(z) or not z.imag.any():
        left, rights = carried_backwards(steps, z.real), np.eye(len(whole))[:1]  # the frame's first direction
    else:
        left, rights = _left_behind(steps, z), _carried(steps, whole)
    carried = (left[:, None] @ steps)[:, 0]
    stretch = np.abs(np.sum(carried * rights, axis=1))
    if not stretch.all():
        last = int(np.flatnonzero(stretch == 0)[-1])
        return math.inf if carried[last].any() else 0.0
    sizes = np.linalg.norm(left, axis=1) * np.linalg.norm(rights, axis=1)
    total = float(np.sum(noise * sizes / stretch))
    return total / (0.5 + math.sqrt(0.25 + total))


def _left_behind(steps: Array, z: Array) -> Array:
    """(E, n) the complex left eigenvector behind every factor, z behind the last, each to a scale of its own.

    Of z = x + i y the frame's first two directions hold all that grows, and a real factor takes x and y apart.
    """
    left = []
    for step in steps[::-1]:
        left.append(z / (np.abs(z).max() or 1.0))
        z = left[-1] @ step
    return np.array(left[::-1])


def _carried(steps: Array, whole: Array) -> Array:
    """(E, n) the complex right eigenvector in front of every factor, each to a scale of its own."""
    v, rights = _leading_vector(whole), []
    for step in steps:
        rights.append(v / (np.abs(v).max() or 1.0))
        v = step @ rights[-1]
    return np.array(rights)


def _leading_vector(matrix: Array) -> Array:
    """(n,) eigenvector of the eigenvalue of largest modulus."""
    if len(matrix) == 1:
        return np.ones(1)
    values, vectors = np.linalg.eig(matrix)
    return np.asarray(vectors[:, int(np.argmax(np.abs(values)))])
