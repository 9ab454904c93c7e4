"""What the solvers call a solution, on cycles that are known."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from test_convergence import P_KEPLER, circle_guess

from casahunt.collocation import newton as newton_module
from casahunt.collocation.ipopt import POLISHING, Maximum, ipopt, ipopt_then_newton, maximise_parameter, minimise, solve
from casahunt.collocation.newton import ROUNDED, newton
from casahunt.collocation.transcription import Setting, transcribe
from casahunt.errors import Status
from casahunt.orbits.bordering import curve_border, row_along
from problems import stuart_landau as sl

SLOW = (0.25e-3, 1.5e-3, 0.8, 0.2)
"""The oscillator with a period of 4000 s."""


def solved(p=P_KEPLER):
    t, u, setting = circle_guess(sl.KEPLER, p, 24, 4, "gauss")
    found = newton(t, u, setting)
    assert found.status.ok
    return t, found.u, setting


def test_steps_are_measured_in_the_scale_and_durations_in_themselves():
    """A point is a solution as it stands where the step is within the accuracy: of every state, of every duration."""
    t, exact, setting = solved(SLOW)
    for place in (0, 1, 7, t.size // 2, t.size - 2, t.size - 1):
        unit = exact[-1] if place == t.size - 1 else 1.0
        for off, accuracy, stands in ((5e-10, 1e-9, True), (5e-9, 1e-9, False), (5e-8, 1.0, False)):
            start = exact.copy()
            start[place] += off * unit
            found = newton(t, start, setting, accuracy=accuracy)
            assert found.status.ok and accuracy <= ROUNDED or not stands
            if stands:
                np.testing.assert_array_equal(found.u, start)
                assert found.iterations == 1 and found.residual == t.linearise(start, setting).residual_norm()
            else:
                assert abs(found.u[place] - exact[place]) < 1e-11 * unit


def test_when_the_next_step_is_sure_to_be_small():
    """Steps e, C e^2, C (C e^2)^2, ...: from the two at hand the third is foreseen, and no smaller one is promised."""
    lin = None
    for factor, first in ((3.0, 1e-3), (0.1, 1e-2), (50.0, 1e-4)):
        second = factor * first**2
        third = factor * second**2
        before, step = (newton_module._Step(np.zeros(1), 0.0, size, lin) for size in (first, second))
        for accuracy, nearby, sure in ((1.01 * third, 1.0, True), (0.99 * third, 1.0, False), (1.0, second / 2, False)):
            assert newton_module._sure(step, before, nearby, accuracy) is sure
        along = replace(step, size=0.0, dlam=second)  # next to a fold the parameter alone may have a way to go
        assert newton_module._sure(along, before, 1.0, 1.01 * third)
        assert not newton_module._sure(along, before, 1.0, 0.99 * third)
        assert not newton_module._sure(step, None, 1.0, 1.0)
        slow = replace(before, size=50 * second)  # not yet shrinking like that
        assert not newton_module._sure(step, slow, 1.0, 1.0)


def test_no_step_more_than_it_takes():
    """Newton's steps from 10 % off: 1e-1, 1e-2, 1e-4, 1e-8 and nothing to do."""
    t, u, setting = circle_guess(sl.KEPLER, P_KEPLER, 24, 4, "gauss")
    found = newton(t, u, setting)
    again = newton(t, found.u, setting)
    assert found.iterations <= 7 and again.iterations == 1
    assert np.max(np.abs(again.u - found.u)) < 1e-10
    assert newton(t, u, setting, max_iterations=2).status is Status.NOT_CONVERGED
    # From 1e-4 off the steps are 1e-4 and 1e-8; the third would be below 1e-11, and is not taken.
    near = newton(t, found.u * np.append(np.full(t.size - 1, 1 + 1e-4), 1.0), setting)
    assert near.status.ok and near.iterations == 2
    assert np.max(np.abs(near.u - found.u)) < 1e-10


@pytest.mark.parametrize("solver", [newton, ipopt])
def test_a_solution_far_from_its_guess_is_another_one(solver):
    """States 2 % off, in units of the radius."""
    t, exact, setting = solved()
    start = exact * np.append(np.full(t.size - 1, 1.02), 1.0)
    moved = np.max(np.abs(t.nodes_of(start) - t.nodes_of(exact)))
    assert moved == pytest.approx(0.02, rel=1e-6)
    assert solver(t, start, setting, largest_move=0.021).status is Status.CONVERGED
    assert solver(t, start, setting, largest_move=0.019).status is Status.FAR_FROM_GUESS
    assert solve(t, start, setting, solver=solver.__name__).solver == solver.__name__


def test_time_does_not_run_backwards():
    """The circle run through from its end is a root with a negative duration."""
    t, u, setting = circle_guess(sl.UNIFORM, P_KEPLER[:2], 24, 4, "gauss")
    forwards = newton(t, u, setting).u
    w, nodes = t.intervals_of(forwards).reshape(t.intervals, -1, 2), t.nodes_of(forwards)
    mirrored = [1.0, -1.0]  # x(-t) of the uniform circle
    back = t.pack((w * mirrored).reshape(t.intervals, -1), nodes * mirrored, -t.durations_of(forwards))
    assert t.linearise(back, setting).residual_norm() < 1e-9  # what 24 intervals of degree 4 leave
    for start in (back, back + 1e-4):
        for accuracy in (0.0, 1e-8):
            assert newton(t, start, setting, accuracy=accuracy).status is Status.INADMISSIBLE
    assert not ipopt(t, back, setting).status.ok


def test_ipopt_then_newton_is_the_one_after_the_other():
    t, u, setting = circle_guess(sl.KEPLER, P_KEPLER, 24, 4, "gauss")
    first = ipopt(t, u, setting)
    then = newton(t, first.u, setting, max_iterations=POLISHING)
    both = ipopt_then_newton(t, u, setting)
    np.testing.assert_array_equal(both.u, then.u)
    assert both.status.ok and both.iterations == first.iterations + then.iterations > 3
    # The way is measured from where it began.
    assert ipopt_then_newton(t, np.append(3.5 * u[:-1], u[-1]), setting).status in (
        Status.FAR_FROM_GUESS, Status.NOT_CONVERGED,
    )  # fmt: skip


# The largest parameter -------------------------------------------------------------------------------------------

B, C = 1.2, 0.9
SMALLEST = 1 - B**2 / (4 * C)


def where_the_slope_vanishes(t, u, setting, *, freedom):
    border = curve_border(t, u, row_along(t, u, setting))
    found = solve(t, u, setting, solver="newton", border=border, bend=-np.inf)
    status = found.status if abs(found.parameter) < freedom else Status.NOT_CONVERGED
    return Maximum(found.u, found.parameter, np.zeros(t.size), status, found.iterations)


@pytest.mark.parametrize("search", [maximise_parameter, where_the_slope_vanishes])
@pytest.mark.parametrize("beside", [1e-3, 8e-3, 3e-2])
def test_the_fold_is_found_within_the_freedom(search, beside):
    """lambda = 1 - nu_f/nu downwards from a cycle at nu; T is 2 pi/omega and r^2 = b/(2 c)."""
    omega = 1.5
    nu = SMALLEST * (1 + beside)
    t = transcribe(sl.HARD, (8,), 8, "gauss")
    angles = 2 * np.pi / 8 * (np.arange(8)[:, None] + t.scheme.points)
    r = np.sqrt((B + np.sqrt(B**2 - 4 * C * (1 - nu))) / (2 * C))
    w = r * np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(8, -1)
    start = t.pack(w, np.vstack([w[:, :2], w[0, :2]]), np.array([2 * np.pi / omega]))
    down = np.array([-nu, 0, 0, 0])
    setting = Setting(np.full(8, 1 / 8), np.array([nu, omega, B, C]), np.ones(2), down)
    u = newton(t, start, setting).u
    way = 1 - SMALLEST / nu
    found = search(t, u, setting, freedom=1.2 * way)
    if found.status.ok or search is maximise_parameter:
        assert found.status is Status.CONVERGED
        assert found.parameter == pytest.approx(way, abs=1e-9)
        assert t.durations_of(found.u)[0] == pytest.approx(2 * np.pi / omega, rel=1e-9)
        # lambda is of second order in r: to the root of what it is good to; Newton's method looks at its slope.
        exact = pytest.approx(B / (2 * C), abs=1e-5 if search is maximise_parameter else 1e-8)
        assert t.nodes_of(found.u)[0, 0] ** 2 == exact
        assert found.iterations > 0 and found.multipliers.shape == (t.size,)
    else:
        assert beside > 1e-2, "only from afar"
    refused = search(t, u, setting, freedom=0.8 * way)
    assert refused.status is Status.NOT_CONVERGED


# Small problems ----------------------------------------------------------------------------------------------------


def nearest(row: float, bounds, row_bounds=None):
    """The point of x + y = row nearest to (1, 2)."""
    x = ca.MX.sym("x", 2)
    rows = x[0] + x[1]
    limits = np.array([[row, row]]) if row_bounds is None else np.array([row_bounds])
    return minimise(
        x, (x[0] - 1) ** 2 + (x[1] - 2) ** 2, rows, ca.MX(ca.DM.ones(1, 2)), np.array([0.7, 0.2]),
        np.array(bounds, float), limits,
    )  # fmt: skip


def test_a_small_cost_under_equations():
    wide = [[-9, 9], [-9, 9]]
    for found, expected in (
        (nearest(1.0, wide), (0, 1)),
        (nearest(1.0, [[0.5, 9], [-9, 9]]), (0.5, 0.5)),
        (nearest(1.0, [[-9, 9], [-9, 0.25]]), (0.75, 0.25)),
        (nearest(0.0, wide, (-1.0, 5.0)), (1, 2)),
        (nearest(0.0, wide, (4.0, 5.0)), (1.5, 2.5)),
    ):
        assert found.status is Status.CONVERGED and found.message == "Solve_Succeeded" and found.iterations > 0
        np.testing.assert_allclose(found.x, expected, atol=1e-6)
    impossible = nearest(5.0, [[0, 1], [0, 1]])
    assert impossible.status is Status.NOT_CONVERGED and "nfeasible" in impossible.message


def test_a_setting_that_is_no_number_is_no_solution():
    t, u, setting = solved()
    for solver in (newton, ipopt):
        assert solver(t, u, replace(setting, p=np.full(4, np.nan))).status is Status.NOT_FINITE
