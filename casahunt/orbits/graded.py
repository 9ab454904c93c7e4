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
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .qr_chain import FACTORS_AT_ONCE, swept

Array = np.ndarray

MULTIPLIER_ROUNDS = 12
ROUND_TOLERANCE = 1e-13
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
"""A value whose relative uncertainty by rounding is larger is known by its bound only."""


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

    Parameters
    ----------
    factors
        (n, n) matrices.
    noise
        (E,) absolute uncertainty delta_e of each of them.
    frame
        (n, n) directions to start from, such as those of a product that is nearly the same.
    rounds
        around the cycle, at most.
    wanted
        those of a smaller modulus delay nothing.

    Returns
    -------
    Spectrum.
    """
    chain = np.asarray(factors)
    n = chain.shape[2]
    if n == 0:
        return Spectrum(np.zeros(0), np.zeros(0), 0.0, np.zeros((0, 0)))
    q = _first_frame(n) if frame is None else frame
    previous = np.full(n, np.inf, dtype=complex)
    for _ in range(rounds):
        start = q
        q, steps, triangular, exponent = _round(chain, q)
        turn = start.T @ q
        if wanted and not exponent:
            raw, resolved = _resolved(turn, triangular, wanted)
        else:
            raw, resolved = np.linalg.eigvals(turn @ triangular), False
        values = _cut(raw, exponent)
        values = values[np.argsort(-np.abs(values), kind="stable")]
        alive = np.abs(values) > SMALLEST_MULTIPLIER
        change = np.abs(np.abs(values) - np.abs(previous))[alive] / np.abs(values[alive])
        if resolved or not alive.any() or float(np.max(change)) < ROUND_TOLERANCE:
            break
        previous = values
    low = np.abs(values) < READ_OFF * np.abs(values[0])
    if low.any():
        values = np.where(low, _cut(_of_blocks(turn, triangular), exponent), values)
    if noise is None:
        return Spectrum(values, np.zeros(n), 0.0, q)
    r = np.concatenate(steps)
    return Spectrum(values, _floor(r, noise), _uncertainty(r, noise, turn, triangular), q)


def _round(chain: Array, q: Array) -> tuple[Array, list[Array], Array, int]:
    """Once around the cycle: the frame behind, the triangular factors, and their product times 2^-exponent."""
    triangular, exponent, steps = np.eye(len(q)), 0, []
    for e in range(0, len(chain), FACTORS_AT_ONCE):
        q, some, triangular = swept(chain[e : e + FACTORS_AT_ONCE], q, triangular)
        steps.append(some)
        size = float(np.abs(triangular).max())
        if size > LARGEST_MULTIPLIER:  # by a power of two: no digit changes
            power = math.frexp(size)[1]
            triangular, exponent = np.ldexp(triangular, -power), exponent + power
    return q, steps, triangular, exponent


@lru_cache
def _first_frame(n: int) -> Array:
    """(n, n) directions of no meaning."""
    return np.linalg.qr(np.random.default_rng(1).standard_normal((n, n)))[0]


def _cut(values: Array, exponent: int) -> Array:
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
    moved = (((left @ np.abs(turn)) @ np.abs(triangular)) * np.abs(right).T).sum(axis=1)
    lost = EPS * moved > ONE_ROUND * sizes
    return values, not (lost & (sizes >= wanted)).any()


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
    rights = _carried(steps, whole)
    z = _leading_vector(whole.T) @ turn  # from the basis at the start to the one at the end
    left = _behind(steps, z)
    carried = (left[:, None] @ steps)[:, 0]
    stretch = np.abs(np.sum(carried * rights, axis=1))
    if not stretch.all():
        last = int(np.flatnonzero(stretch == 0)[-1])
        return math.inf if carried[last].any() else 0.0
    sizes = np.linalg.norm(left, axis=1) * np.linalg.norm(rights, axis=1)
    total = float(np.sum(noise * sizes / stretch))
    return total / (0.5 + math.sqrt(0.25 + total))


def _behind(steps: Array, z: Array) -> Array:
    """(E, n) the left eigenvector behind every factor, each to a scale of its own; z (n,) stands behind the last.

    Some factors at a time: products from the ends of all chunks backwards, and z through whole chunks.
    """
    n, size = len(z), FACTORS_AT_ONCE
    chunks = -(-len(steps) // size)
    before = chunks * size - len(steps)
    padded = np.concatenate([np.broadcast_to(np.eye(n), (before, n, n)), steps]).reshape(chunks, size, n, n)
    product = np.broadcast_to(np.eye(n), (chunks, n, n))
    products = np.empty_like(padded)
    for k in range(size - 1, -1, -1):
        products[:, k] = product
        product = product @ padded[:, k]
        largest = np.abs(product).max(axis=(1, 2), keepdims=True)
        product = product / np.where(largest > 0, largest, 1.0)
    found = np.empty((chunks, size, n), dtype=z.dtype)
    for c in range(chunks - 1, -1, -1):
        found[c] = z @ products[c]
        z = z @ product[c]
        z = z / (np.abs(z).max() or 1.0)
    return found.reshape(-1, n)[before:]


def _carried(steps: Array, whole: Array) -> Array:
    """(E, n) the right eigenvector in front of every factor: the first direction of the frame, where that is real."""
    v = _leading_vector(whole)
    if np.isrealobj(v) or not v.imag.any():
        return np.broadcast_to(np.eye(len(whole))[0], (len(steps), len(whole)))
    rights = []
    for step in steps:
        rights.append(v / np.abs(v).max())
        v = step @ rights[-1]
    return np.array(rights)


def _leading_vector(matrix: Array) -> Array:
    """(n,) eigenvector of the eigenvalue of largest modulus."""
    values, vectors = np.linalg.eig(matrix)
    return np.asarray(vectors[:, int(np.argmax(np.abs(values)))])
