"""Stages eliminated: states in the right order, and the same numbers as from the whole system of an interval."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from casahunt.collocation.elimination import elimination, jet, kept_states
from casahunt.collocation.interval import interval_function
from casahunt.collocation.newton import _Step, _sure, newton
from casahunt.errors import Status
from casahunt.orbits.orbit import unknowns_of


def pattern(*rows: str) -> np.ndarray:
    return np.array([[entry == "x" for entry in row] for row in rows])


def test_states_whose_rates_contain_no_loop_are_substituted():
    assert kept_states(pattern(".x.", "xxx", "x..")) == ((1,), (0, 2))  # a servo: the integral after the position
    assert kept_states(pattern(".x..", "xxxx", "x...", ".x.x")) == ((1, 3), (0, 2))
    assert kept_states(pattern("x")) == ((0,), ())
    assert kept_states(pattern("xx", "xx")) == ((0, 1), ())
    assert kept_states(pattern(".x", "x.")) == ((0,), (1,))  # each the other's integral: one has to stay
    assert kept_states(pattern("..x", "x..", "..x")) == ((2,), (0, 1))
    assert kept_states(np.eye(13, dtype=bool)) == (tuple(range(13)), ())


def servo_like(x, p, sign):
    return ca.vertcat(x[1], -p[0] * x[0] - sign * ca.exp(-(x[1] ** 2)) - x[2], x[0])


def curved(x, p, sign):
    """Rates that depend on the state, of states that are integrals of others all the same."""
    return ca.vertcat(x[1] * x[2], x[2] ** 2 + p[1] * x[3], -p[0] * x[0] * x[2] - sign * x[3], ca.sin(x[2]) + p[1])


def coupled(x, p, sign):
    return ca.vertcat(p[0] * x[0] - x[0] * x[1], sign * x[0] * x[1] - p[1] * x[1] ** 2)


FIELDS = {
    "servo": (servo_like, 3, (1,)), "curved": (curved, 4, (2,)), "coupled": (coupled, 2, (0, 1)),
    "one": (lambda x, p, sign: p[0] - sign * x**3, 1, (0,)), "none": (lambda x, p, sign: p[0] + 0 * x, 1, (0,)),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["gauss", "radau"])
@pytest.mark.parametrize("name", FIELDS)
def test_the_whole_system_of_an_interval_has_the_same_solution(name, kind):
    """Against the dense block of interval.py, its LU and its own node rows."""
    field, n, kept = FIELDS[name]
    assert jet(field, n, 2).F == kept
    N, d, rng = 3, 4, np.random.default_rng(2)
    w, x_next = rng.standard_normal((N, n * (d + 1))), rng.standard_normal((N, n))
    T, h, sign = rng.uniform(1, 3, N), rng.uniform(0.1, 0.6, N), rng.choice([-1.0, 1.0], N)
    p, dp, scale = np.array([0.7, 1.3]), np.array([0.3, -0.4]), rng.uniform(0.5, 2, n)
    found = elimination(field, n, 2, d, kind, N)(w, x_next, T, h, sign, p, dp, scale)
    whole, rows = interval_function(field, n, 2, d, kind), n * (d + 1)
    for i in range(N):
        block = np.array(whole(w[i], x_next[i], T[i], h[i], sign[i], p, dp, scale))
        known = np.hstack([block[:, : n + 1], block[:, rows + 1 :]])
        stages = np.linalg.solve(block[: n * d, n + 1 : rows + 1], known[: n * d])
        maps = block[n * d :, n + 1 : rows + 1] @ stages - known[n * d :]
        np.testing.assert_allclose(found.residual[i], block[:, 0], rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.stages[i], stages, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(found.maps[i], maps, rtol=1e-10, atol=1e-11)


def test_stages_that_cannot_be_eliminated_are_said_to_be_so():
    """x' = x over an interval whose length is an eigenvalue of A^-1: only LU could tell."""
    run = elimination(lambda x, p, sign: p[0] * x, 1, 1, 1, "gauss", 1)
    with pytest.raises(np.linalg.LinAlgError):  # one stage in the middle: x_1 = x + h/2 x_1
        run(np.ones((1, 2)), np.ones((1, 1)), np.full(1, 2.0), *[np.ones(1)] * 5)


@pytest.mark.parametrize("case", [("switch", 0.4), ("lugre", 0.4)])
def test_what_is_left_of_the_equations_without_their_jacobian(orbit, case):
    t, u, setting = unknowns_of(orbit(*case))
    rng = np.random.default_rng(5)
    for size in (0.0, 1e-9, 1e-4, 1e-2):
        v = u * (1 + size * rng.standard_normal(u.size))
        whole = t.linearise(v, setting).residual_norm()
        assert t.residual_norm(v, setting) == pytest.approx(whole, rel=1e-9, abs=1e-13)
    v[t.size // 2] = np.nan
    assert np.isnan(t.residual_norm(v, setting))


def test_a_rough_solution_leaves_out_the_last_steps_and_no_equation(orbit, monkeypatch):
    """Steps of 1e-2, 1e-4, 1e-8 foreseen: the third is not taken; where the equations do not hold, all are."""
    t, u, setting = unknowns_of(orbit("switch", 0.4))
    start = u * (1 + 1e-3 * np.cos(np.arange(u.size)))
    whole, rough = newton(t, start, setting), newton(t, start, setting, rough=1e-5)
    assert whole.status.ok and rough.status.ok and rough.iterations < whole.iterations
    assert rough.residual <= 1e-5 and np.abs(rough.u - whole.u).max() < 1e-4
    monkeypatch.setattr(type(t), "residual_norm", lambda *_: np.inf)
    again = newton(t, start, setting, rough=1e-5)
    assert again.status.ok and again.residual < 1e-10


def test_a_rough_solution_that_is_lost_is_given_up(orbit):
    """A first step larger than the orbit: Newton's method goes on for seven, to another cycle."""
    t, u, setting = unknowns_of(orbit("switch", 0.4, tol=1e-8))
    start = u * (1 + 2 * np.cos(np.arange(u.size)))
    start[-t.phases :] = u[-t.phases :]
    assert newton(t, start, setting).status is Status.FAR_FROM_GUESS
    lost = newton(t, start, setting, rough=1e-5)
    assert lost.status is Status.NOT_CONVERGED and lost.iterations == 1


def test_a_step_that_is_sure_to_be_small_is_not_computed(orbit, monkeypatch):
    t, u, setting = unknowns_of(orbit("switch", 0.4))
    start = u * (1 + 1e-3 * np.cos(np.arange(u.size)))
    whole, early = (newton(t, start, setting, accuracy=1e-9, nearby=nearby) for nearby in (0.0, 1e-3))
    assert early.status.ok and early.iterations == whole.iterations - 1 and early.residual < 1e-8
    assert np.abs(early.u - whole.u).max() < 1e-9
    assert newton(t, start, setting, accuracy=1e-9, nearby=1e-12).iterations == whole.iterations
    monkeypatch.setattr(type(t), "residual_norm", lambda *_: 1.0)  # where the equations do not hold it is
    assert newton(t, start, setting, accuracy=1e-9, nearby=1e-3).iterations >= whole.iterations


@pytest.mark.parametrize(
    ("sizes", "dlam", "sure"),
    [
        ((1e-3, 1e-6), 0.0, True),  # quadratic, with 1e-12 to follow
        ((5e-5, 1e-6), 0.0, False),  # linear so far: 2e-8 may follow
        ((1e-3, 1e-6), 2e-5, False),  # next to a fold lambda has still a way to go
        ((1e-3, 9e-6), 0.0, True),
        ((1e-3, np.nan), 0.0, False),
    ],
)
def test_what_quadratic_convergence_makes_sure(sizes, dlam, sure):
    before, step = (_Step(np.zeros(1), dlam, size, None) for size in sizes)
    assert _sure(step, before, 1e-5, 1e-9) is sure
    assert not _sure(step, None, 1e-5, 1e-9)
