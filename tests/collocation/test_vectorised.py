"""Operations over arrays against CasADi point by point."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from casahunt.collocation.ensemble_points import OPERATIONS, OverArrays

x, y, p = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("p")
EXPRESSIONS = [
    x + y, x - y, x * y, x / (2 + y), -x, ca.exp(x), ca.log(2 + x), ca.power(2 + x, y), ca.power(2 + x, 2.5),
    ca.sqrt(2 + x), x**2, x + x, 1 / (2 + x), ca.sin(x), ca.cos(x), ca.tan(x), ca.asin(x), ca.acos(x), ca.atan(x),
    ca.sinh(x), ca.cosh(x), ca.tanh(x), ca.asinh(x), ca.acosh(2 + x), ca.atanh(x), ca.atan2(x, y), ca.floor(3 * x),
    ca.ceil(3 * x), ca.fmod(3 * x, 2 + y), ca.fabs(x), ca.sign(x), ca.sign(0 * x), ca.copysign(y, x), ca.fmin(x, y),
    ca.fmax(x, y), ca.log1p(x), ca.expm1(x), ca.hypot(x, y), ca.erf(x), x < y, ca.floor(3 * x) <= ca.floor(3 * y),
    ca.eq(ca.floor(3 * x), ca.floor(3 * y)), ca.ne(ca.floor(3 * x), ca.floor(3 * y)),
    ca.logic_not(x < y), ca.logic_and(x < 0, y < 0), ca.logic_or(x < 0, y < 0), ca.if_else(x < y, p * x, ca.log(y)),
]  # fmt: skip
POINTS = np.random.default_rng(0).uniform(-0.9, 0.9, (2, 3, 5))
OWN = np.array([[0.3], [-2.0], [1.5]])


def by_casadi(function):
    out = np.empty((function.nnz_out(0), 3, 5))
    for i in range(3):
        for j in range(5):
            out[:, i, j] = np.ravel(function(POINTS[:, i, j], OWN[i, 0]).nonzeros())
    return out


def over(function):
    found = OverArrays(function)
    (entries,) = found(list(POINTS), [OWN])
    return found.by_numpy, np.array([np.broadcast_to(entry, (3, 5)) for entry in entries])


def test_every_operation():
    function = ca.Function("f", [ca.vertcat(x, y), p], [ca.vertcat(*EXPRESSIONS)])
    seen = {function.instruction_id(k) for k in range(function.n_instructions())}
    left_out = {ca.OP_ASSIGN, ca.OP_CONSTPOW}
    assert set(OPERATIONS) - seen <= left_out
    by_numpy, found = over(function)
    known = by_casadi(function)
    assert by_numpy
    assert np.array_equal(np.isnan(found), np.isnan(known)) and np.isnan(known).any()
    assert np.allclose(found, known, rtol=1e-14, atol=0, equal_nan=True)


@pytest.mark.parametrize("outputs", [1, 2])
def test_a_call_that_is_not_inlined_is_left_to_casadi(outputs):
    z = ca.SX.sym("z")
    inner = ca.Function("inner", [z], [z**3 + 1], {"never_inline": True})
    function = ca.Function("f", [ca.vertcat(x, y), p], [ca.vertcat(*[inner(x) * p + k for k in range(outputs)])])
    by_numpy, found = over(function)
    assert not by_numpy
    assert np.allclose(found, by_casadi(function), rtol=1e-14, atol=0)


def test_a_point_knows_nothing_of_the_others():
    function = ca.Function("f", [ca.vertcat(x, y), p], [ca.sin(x) * ca.exp(y) + ca.log(2 + x) ** p])
    whole = over(function)[1][0]
    (entries,) = OverArrays(function)([POINTS[0, 1:2, 2:], POINTS[1, 1:2, 2:]], [OWN[1:2]])
    assert np.array_equal(entries[0][0], whole[1, 2:])
