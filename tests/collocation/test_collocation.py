"""Coefficient identities of the collocation schemes: published tables and order conditions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import legendre

from casahunt.collocation.interval import interval_function, interval_map
from casahunt.collocation.scheme import MAX_DEGREE, lagrange, scheme
from casahunt.errors import InputError

DEGREES = range(1, MAX_DEGREE + 1)
ALL = [(kind, d) for kind in ("gauss", "radau") for d in DEGREES]
# Sums of at most 12 products of numbers below one, whose factors carry a few units of rounding.
ROUNDING = 1e-13

# Hairer, Norsett and Wanner I, table II.7.3; Hairer and Wanner II, tables IV.5.5 and IV.5.6.
R3, R6 = np.sqrt(3), np.sqrt(6)
PUBLISHED = [
    ("gauss", [0.5], [[0.5]], [1.0]),
    ("gauss", [1 / 2 - R3 / 6, 1 / 2 + R3 / 6], [[1 / 4, 1 / 4 - R3 / 6], [1 / 4 + R3 / 6, 1 / 4]], [1 / 2, 1 / 2]),
    ("radau", [1.0], [[1.0]], [1.0]),
    ("radau", [1 / 3, 1.0], [[5 / 12, -1 / 12], [3 / 4, 1 / 4]], [3 / 4, 1 / 4]),
    (
        "radau",
        [(4 - R6) / 10, (4 + R6) / 10, 1.0],
        [
            [(88 - 7 * R6) / 360, (296 - 169 * R6) / 1800, (-2 + 3 * R6) / 225],
            [(296 + 169 * R6) / 1800, (88 + 7 * R6) / 360, (-2 - 3 * R6) / 225],
            [(16 - R6) / 36, (16 + R6) / 36, 1 / 9],
        ],
        [(16 - R6) / 36, (16 + R6) / 36, 1 / 9],
    ),
]


@pytest.mark.parametrize(("kind", "c", "A", "b"), PUBLISHED)
def test_published_tables(kind, c, A, b):
    s = scheme(len(c), kind)
    np.testing.assert_allclose(s.stages, c, atol=ROUNDING)
    np.testing.assert_allclose(s.matrix, A, atol=ROUNDING)
    np.testing.assert_allclose(s.weights, b, atol=ROUNDING)


@pytest.mark.parametrize(("kind", "d"), ALL)
def test_stages_lie_in_order_inside_the_interval(kind, d):
    s = scheme(d, kind)
    assert s.stages.shape == (d,) and s.weights.shape == (d,) and s.matrix.shape == (d, d)
    assert np.all(np.diff(s.points) > 0) and s.points[0] == 0
    assert s.stages[-1] == 1 if kind == "radau" else s.stages[-1] < 1
    assert s.order == (2 * d if kind == "gauss" else 2 * d - 1)


@pytest.mark.parametrize(("kind", "d"), ALL)
def test_quadrature_condition_B(kind, d):
    """sum_j b_j c_j^(k-1) = 1/k for k up to the order of the scheme, and not beyond."""
    s = scheme(d, kind)
    k = np.arange(1, s.order + 1)
    np.testing.assert_allclose(s.weights @ s.stages[:, None] ** (k - 1), 1 / k, atol=ROUNDING)
    if d <= 5:  # the defect of the next condition, (d!)^4/((2d + 1) (2d)!^2) for Gauss, shrinks to 1e-6 at d = 5
        assert abs(s.weights @ s.stages**s.order - 1 / (s.order + 1)) > 1e-9


@pytest.mark.parametrize(("kind", "d"), ALL)
def test_stage_condition_C(kind, d):
    """sum_l A_jl c_l^(k-1) = c_j^k/k for k up to d."""
    s = scheme(d, kind)
    k = np.arange(1, d + 1)
    powers = s.stages[:, None] ** k
    np.testing.assert_allclose(s.matrix @ s.stages[:, None] ** (k - 1), powers / k, atol=ROUNDING)


@pytest.mark.parametrize(("kind", "d"), ALL)
def test_condition_D(kind, d):
    """sum_j b_j c_j^(k-1) A_jl = b_l (1 - c_l^k)/k for k up to d (Gauss) or d - 1 (Radau IIA)."""
    s = scheme(d, kind)
    for k in range(1, d + 1 if kind == "gauss" else d):
        left = (s.weights * s.stages ** (k - 1)) @ s.matrix
        np.testing.assert_allclose(left, s.weights * (1 - s.stages**k) / k, atol=ROUNDING)


@pytest.mark.parametrize(("kind", "d"), ALL)
def test_stability_at_infinity(kind, d):
    """R(infinity) = 1 - b A^-1 1: Radau IIA forgets at once, Gauss keeps the modulus."""
    s = scheme(d, kind)
    at_infinity = 1 - s.weights @ np.linalg.solve(s.matrix, np.ones(d))
    # The inverse of A costs its condition number, below 1e3 up to degree 12.
    assert at_infinity == pytest.approx((-1.0) ** d if kind == "gauss" else 0.0, abs=1e-10)


@pytest.mark.parametrize(("kind", "d"), ALL)
def test_last_mode_is_the_last_legendre_coefficient(kind, d):
    s = scheme(d, kind)
    values = np.random.default_rng(d).standard_normal((d + 1, 3))
    expected = legendre.legfit(2 * s.points - 1, values, d)[-1]
    np.testing.assert_allclose(s.last_mode @ values, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("d", DEGREES)
def test_lagrange_reproduces_polynomials(d):
    rng = np.random.default_rng(d)
    series = rng.standard_normal(d + 1)
    nodes = scheme(d, "gauss").points
    x = np.concatenate([np.linspace(0, 1, 21), nodes])
    matrix = lagrange(nodes, x)
    exact = legendre.legval(2 * x - 1, series)
    np.testing.assert_allclose(matrix @ legendre.legval(2 * nodes - 1, series), exact, atol=1e-11)
    np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-11)
    np.testing.assert_array_equal(matrix[21:], np.eye(d + 1))


def test_interpolation_reproduces_polynomials_from_start_and_stages():
    s = scheme(4, "radau")
    tau = np.linspace(-0.5, 1.5, 9)
    exact = 3 * tau**4 - tau**2 + 2
    np.testing.assert_allclose(s.interpolation(tau) @ (3 * s.points**4 - s.points**2 + 2), exact, atol=1e-12)


@pytest.mark.parametrize("degree", [0, -1, MAX_DEGREE + 1])
def test_degree_out_of_range(degree):
    with pytest.raises(InputError, match=rf"degree = {degree}: .* 1\.\.{MAX_DEGREE}"):
        scheme(degree, "gauss")


def test_unknown_kind():
    with pytest.raises(InputError, match="'lobatto'.*'gauss' or 'radau'"):
        scheme(3, "lobatto")


@pytest.mark.parametrize("intervals", [1, 64, 197])
def test_a_map_over_many_intervals_is_one_over_each(intervals):
    """197 = 3 64 + 4 + 1 intervals are mapped in five pieces."""
    n, degree, random = 2, 3, np.random.default_rng(2)
    rows = n * (degree + 1)
    w, after = random.standard_normal((intervals, rows)), random.standard_normal((intervals, n))
    each = random.random((3, intervals))  # duration, fraction, sign
    shared = (random.random(1), random.random(1), 1 + random.random(n))
    blocks = interval_map(shaken, n, 1, degree, "gauss", intervals)(w, after, *each, *shared).copy()
    one = interval_function(shaken, n, 1, degree, "gauss")
    for i in range(0, intervals, 7):
        expected = np.array(one(w[i], after[i], *each[:, i], *shared))
        np.testing.assert_allclose(blocks[i].T, expected, rtol=1e-14, atol=1e-14)


def shaken(x, p, sign):
    """A pendulum pushed by a constant."""
    return ca.vertcat(x[1], sign * p[0] - ca.sin(x[0]))
