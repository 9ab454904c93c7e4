"""Collocation on one interval: nodes, weights and interpolation.  Pure numpy.

A polynomial of degree d through the start of the interval and d stages c_1..c_d in (0, 1]
satisfies the differential equation at the stages.  As a Runge-Kutta method

    X_j = x + h sum_l A_jl f(X_l),        x(h) = x + h sum_l b_l f(X_l),
    A_jl = integral of L_l from 0 to c_j,    b_l = integral of L_l from 0 to 1,

L_l being the Lagrange polynomials of the stages (Hairer, Norsett and Wanner, section II.7).
Order at the end of the interval: 2d for Gauss-Legendre, 2d - 1 for Radau IIA; inside it d + 1.

Symbols: d stages, m evaluation points.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache

import numpy as np
from numpy.polynomial import legendre

from ..errors import InputError
from ..hybrid.problem import Kind

Array = np.ndarray

MAX_DEGREE = 12
"""Above this degree the stages are so many that smaller intervals serve better."""


@dataclass(frozen=True)
class Scheme:
    """Coefficients of one collocation scheme; checks its own order conditions.

    Attributes
    ----------
    kind, degree : name ("gauss" or "radau") and number d of stages.
    stages : (d,) the c_j in (0, 1].
    matrix : (d, d) Runge-Kutta matrix A.
    weights : (d,) quadrature weights b.
    order : classical order at the end of an interval.
    points : (d + 1,) interpolation points: the start of the interval, then the stages.
    last_mode : (d + 1,) row that gives the degree-d Legendre coefficient of the polynomial through `points`.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.collocation import Scheme
    >>> scheme = Scheme.of(3, "radau")
    >>> scheme.order, scheme.points.round(3).tolist()
    (5, [0.0, 0.155, 0.645, 1.0])
    >>> cubic = scheme.interpolation(np.array([0.5])) @ scheme.points**3
    >>> round(float(cubic[0]), 12)
    0.125
    """

    kind: Kind
    degree: int
    stages: Array
    matrix: Array
    weights: Array
    order: int
    points: Array = field(repr=False)
    last_mode: Array = field(repr=False)

    @staticmethod
    def of(degree: int, kind: Kind = "gauss") -> Scheme:
        """The scheme of a degree and a kind, such as an orbit or a segment of a motion is computed in.

        Parameters
        ----------
        degree, kind
            number of stages, 1 to 12; "gauss" or "radau".

        Returns
        -------
        Scheme.

        Raises
        ------
        InputError : another degree or kind.
        """
        return scheme(degree, kind)

    def __post_init__(self) -> None:
        c, d = self.stages, self.degree
        if not np.allclose(self.matrix.sum(axis=1), c, atol=1e-13):
            raise ValueError("the rows of A must sum to c")
        for k in range(1, d + 1):
            if abs(self.weights @ c ** (k - 1) - 1 / k) > 1e-13:
                raise ValueError(f"quadrature condition B({k}) fails")

    @cached_property
    def sums(self) -> Array:
        """(d + 1, d) A above b: from the slopes at the stages to those of stages and end."""
        return np.vstack([self.matrix, self.weights])

    @cached_property
    def halves(self) -> Array:
        """(2, d + 1, d + 1) interpolation to the `points` of the first and the second half of the interval."""
        return np.array([self.interpolation(self.points / 2), self.interpolation((1 + self.points) / 2)])

    def interpolation(self, tau: Array) -> Array:
        """Values at tau in [0, 1] from (start, stages) of the interval.

        tau: (m,) local times.
        Returns (m, d + 1) matrix; row k times the stacked states [x, X_1, ..., X_d] is the state at tau_k.
        """
        return lagrange(self.points, np.asarray(tau, float), self._barycentric)

    @cached_property
    def _barycentric(self) -> Array:
        return barycentric_weights(self.points)


def lagrange(nodes: Array, x: Array, weights: Array | None = None) -> Array:
    """Lagrange polynomials, exact at their nodes.

    L_j(x) = w_j / (x - x_j) prod_k (x - x_k), to rounding at any distance from a node (Higham, IMA J. Numer. Anal.
    24, 2004).

    nodes: (k,); x: (m,) places; weights: `barycentric_weights(nodes)`, where they are at hand. Returns (m, k) values.
    """
    off = x[:, None] - nodes
    product = np.multiply.reduce(off, axis=1)[:, None] * (barycentric_weights(nodes) if weights is None else weights)
    if off.all():
        return product / off
    met = off == 0.0
    out = product / np.where(met, 1.0, off)
    at_node = met.any(axis=1)
    out[at_node] = met[at_node]
    return out


def barycentric_weights(nodes: Array) -> Array:
    """(k,) the w_j = 1 / prod_k (x_j - x_k)."""
    gaps = nodes[:, None] - nodes
    np.fill_diagonal(gaps, 1.0)
    return 1 / np.multiply.reduce(gaps, axis=1)


def _radau_stages(d: int) -> Array:
    """Roots of P_d - P_{d-1} on [0, 1]; the last one is 1."""
    series = np.zeros(d + 1)
    series[d], series[d - 1] = 1.0, -1.0
    roots = np.sort(np.real(legendre.legroots(series)))
    for _ in range(3):  # Newton polish: the companion roots lose a digit or two
        derivative = legendre.legval(roots, legendre.legder(series))
        roots = roots - legendre.legval(roots, series) / derivative
    roots[-1] = 1.0
    return (roots + 1) / 2


@cache
def scheme(degree: int, kind: Kind = "gauss") -> Scheme:
    """The coefficients of a collocation scheme.

    degree: number of stages, 1..12. Raises InputError: another degree or kind.
    """
    if not 1 <= degree <= MAX_DEGREE:
        raise InputError(f"degree = {degree!r}: the collocation degree must lie in 1..{MAX_DEGREE}")
    if kind not in ("gauss", "radau"):
        raise InputError(f"scheme = {kind!r}: must be 'gauss' or 'radau'")
    c = (legendre.leggauss(degree)[0] + 1) / 2 if kind == "gauss" else _radau_stages(degree)
    # Integrals of the Lagrange polynomials (degree d - 1) by Gauss quadrature: exact and, unlike
    # monomials, free of cancellation.
    nodes, weights = legendre.leggauss((degree + 1) // 2 + 1)
    nodes, weights = (nodes + 1) / 2, weights / 2
    matrix = np.array([cj * (weights @ lagrange(c, cj * nodes)) for cj in c])
    b = weights @ lagrange(c, nodes)
    order = 2 * degree if kind == "gauss" else 2 * degree - 1
    points = np.concatenate([[0.0], c])
    last_mode = np.linalg.inv(legendre.legvander(2 * points - 1, degree))[-1]
    return Scheme(kind, degree, c, matrix, b, order, points, last_mode)


@lru_cache(maxsize=64)
def equal_parts(degree: int, kind: Kind, count: int) -> Array:
    """Interpolation to the `points` of each of some equal parts of an interval.

    Returns (count, d + 1, d + 1).
    """
    s = scheme(degree, kind)
    return np.array([s.interpolation((k + s.points) / count) for k in range(count)])
