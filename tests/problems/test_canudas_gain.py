"""problems/canudas_gain.py against Taylor series and against scipy's Radau IIA."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt.continuation import branch_off, follow
from casahunt.continuation.closed_branch import MUCH_NEARER, _beside, _minus_one_next_to, met_at, reunion
from casahunt.continuation.curve import curve_point, secant_direction
from casahunt.continuation.walk import step_along
from casahunt.orbits import Options, find_cycle
from casahunt.orbits.adapt import finished, solve_adaptively
from casahunt.orbits.bordering import curve_border
from casahunt.orbits.orbit import unknowns_of
from problems import canudas_gain

FLIPS = (47.99822556, 48.43318444)
"""K at which the lopsided pair flips, to the digits that are given."""


def started(K: float):
    return find_cycle(
        canudas_gain.SYSTEM, "backwards", tol=canudas_gain.TOL, parameters={"K": K}, x=1.0, v=0.0, w=0.0, z=0.0
    )


@cache
def round_the_fold(tol: float = canudas_gain.TOL):
    """The symmetric branch from K = 44, round its fold and back; the tests of one tolerance share it."""
    return follow(started(44.0), "K", to=60.0, back=40.0, options=Options(tol=tol))


def flown_off(orbit) -> tuple[float, float]:
    """The relative errors of period and K that the defects of all intervals make, by scipy's Radau IIA, to first order.

    Every interval is integrated from its own start, so that no error grows; where it ends beside its end is put on the
    right of one Newton step of the whole cycle.  On the branch, so that a fold has a step too.
    """
    point = curve_point(orbit, "K")
    t, u, setting = point.t, point.u, point.setting
    lin = t.linearise(u, setting)
    p, form, defects = setting.p, orbit.problem.system.vector_form, []
    for arc in orbit.arcs:
        mode = form.modes[arc.mode]
        x, parameters = ca.SX.sym("x", 4), ca.SX.sym("p", p.size)
        f = mode.field(x, parameters, mode.sign)
        field = ca.Function("f", [x, parameters], [f])
        slope = ca.Function("df", [x, parameters], [ca.jacobian(f, x)])
        nodes = np.vstack([arc.states[:, 0], arc.end])
        for i, span in enumerate(np.diff(arc.breaks) * arc.duration):
            flown = solve_ivp(
                lambda _, y, field=field: np.array(field(y, p)).ravel(), (0.0, span), nodes[i], method="Radau",
                rtol=1e-10, atol=1e-12 * orbit.scale, jac=lambda _, y, slope=slope: np.array(slope(y, p)),
            )  # fmt: skip
            defects.append((flown.y[:, -1] - nodes[i + 1]) / setting.scale)
    rhs = lin.rhs()
    rhs[: t.elements * t.n] = np.ravel(defects)
    y = t.system.solve(lin.matrix(curve_border(t, u, point.row)), rhs)
    return float(y[(t.elements + 1) * t.n : -1].sum() / t.durations_of(u).sum()), float(y[-1])


def assert_flown(orbit) -> None:
    """What is promised: period and K are within the tolerance of those of the true motion."""
    assert np.max(np.abs(flown_off(orbit))) < canudas_gain.TOL


def between_changes(values: list[float], level: float) -> int:
    """How often a number along a branch passes a level."""
    signs = np.sign(np.array(values) - level)
    return int(np.sum(signs[1:] != signs[:-1]))


@pytest.mark.slow
def test_losses_of_symmetry_and_the_lopsided_pair():
    branch = round_the_fold()
    breaking = [special for special in branch.special if special.kind == "symmetry breaking"]
    folds = [special for special in branch.special if special.kind == "fold"]
    found = [special.orbit.problem.value("K") for special in (*breaking, *folds)]
    assert found == pytest.approx([*canudas_gain.BREAKING, canudas_gain.FOLD], rel=1e-7)
    multipliers = [orbit.half_multiplier for orbit in branch.orbits]
    assert len(breaking) == between_changes(multipliers, -1.0) and len(folds) == between_changes(multipliers, 1.0) == 1
    assert not branch.missed and len(branch.special) == 3
    for special in branch.special:
        assert_flown(special.orbit)
    for orbit in branch.orbits[::24]:
        assert_flown(orbit)
    pair = canudas_gain.lopsided(breaking[0], -0.02)
    kinds = [special.kind for special in pair.special]
    assert kinds == ["fold", "flip", "flip", "symmetry breaking"] and "own image" in pair.ended
    assert "meets in the symmetric one" in pair.special[-1].meaning
    assert pair.special[-1].orbit.problem.value("K") == pytest.approx(canudas_gain.BREAKING[1], rel=1e-6)
    leading = [orbit.multipliers.full[1].real for orbit in pair.orbits]
    assert leading[-1] == pytest.approx(1.0, abs=1e-6)  # there it branches off
    assert between_changes(leading, -1.0) == 2 and between_changes(leading[1:-1], 1.0) == 1
    for orbit in pair.orbits[::24]:
        assert_flown(orbit)
    one, other = (branch_off(breaking[0], "K", off=off) for off in (0.02, -0.02))
    middle = breaking[0].orbit.arcs[0].states[0, 0]
    assert (one.arcs[0].states[0, 0] - middle) @ (other.arcs[0].states[0, 0] - middle) < 0
    assert_flown(other)
    assert_met_from_any_step(pair)


def assert_met_from_any_step(pair) -> None:
    """However far a step goes past the symmetric cycle, the point at which the pair meets in it is the same."""
    options, met = Options(tol=canudas_gain.TOL), []
    before = pair.orbits[-3]
    way = secant_direction(before, pair.orbits[-2], "K")
    for length in np.linalg.norm(way) * np.arange(1.0, 3.5, 0.3):
        outcome = step_along(curve_point(before, "K", like=way), before, "K", length, 40.0, 100.0, options)
        found = None if isinstance(outcome, str) else reunion(before, outcome[0], options.tol)
        if found is None:
            continue
        met.append(met_at(before, outcome[0], found, "K", options))
        # However near orbits come, they lead to that point or to none: not, as a far step may, to where the pair began.
        for nearer in MUCH_NEARER:
            beside = _beside(before, outcome[0], found, "K", options, nearer)
            near = beside and _minus_one_next_to(*beside, found, "K", options, nearer, float(length))
            assert near is None or near.problem.value("K") == pytest.approx(canudas_gain.BREAKING[1], rel=1e-7)
    assert met and [point.value for point in met] == pytest.approx([canudas_gain.BREAKING[1]] * len(met), rel=1e-7)


@pytest.mark.slow
def test_a_reversal_that_dies_is_located_from_both_sides():
    up = follow(started(13.4), "K", to=13.8, options=Options(tol=canudas_gain.TOL))
    down = follow(started(14.0), "K", to=13.4, options=Options(tol=canudas_gain.TOL))
    (dies,), (is_born,) = up.special, down.special
    assert dies.kind == is_born.kind == "grazing" and not up.missed and not down.missed
    K = dies.orbit.problem.value("K")
    assert is_born.orbit.problem.value("K") == pytest.approx(K, rel=1e-6)
    # At the contact the velocity comes to zero inside the phase, and the motion goes on in it.
    (arc,) = dies.orbit.arcs
    assert_flown(dies.orbit)
    speeds = np.abs(arc.states[1:, 0, 1])
    early = arc.breaks[1:-1] * arc.duration < 0.1
    assert np.min(speeds[early]) < 1e-4 * np.max(speeds)


@pytest.mark.slow
def test_from_the_paper_round_the_fold_and_back():
    """110 cycles; half of them behind the fold, where the multiplier grows to 1e10 and beyond."""
    branch = canudas_gain.symmetric()
    kinds = [special.kind for special in branch.special]
    values = [special.orbit.problem.value("K") for special in branch.special]
    assert kinds == ["grazing", "symmetry breaking", "symmetry breaking", "fold", "grazing"] and not branch.missed
    assert values[1:4] == pytest.approx([*canudas_gain.BREAKING, canudas_gain.FOLD], rel=1e-7)
    assert branch.values[0] == 1.0 and branch.values[-1] == 0.99
    multipliers = [orbit.half_multiplier for orbit in branch.orbits]
    assert between_changes(multipliers, -1.0) == 2 and between_changes(multipliers, 1.0) == 1
    phases = np.array([len(orbit.arcs) for orbit in branch.orbits])
    assert np.sum(phases[1:] != phases[:-1]) == 2 and np.argmax(branch.values) > np.flatnonzero(phases == 1)[0]


@pytest.mark.slow
def test_branching_is_looked_for_nearer():
    """At 0.02 of the sizes of states nothing is found next to this loss of symmetry."""
    first = branch_off(round_the_fold().special[0], "K", off=0.02)
    x, y = first.arcs[0].states[0, 0], first.arcs[1].states[0, 0]
    assert 1e-5 < np.max(np.abs(x + y) / first.scale) < 0.02


def assert_next_to(special, off: float) -> None:
    """The cycle that branches off has the parameter of the square-root law, and the multiplier of its normal form.

    x -> -(1 + nu) x + c x^3 has the pair c x^2 = -nu with the multiplier 1 - 4 nu of two rounds, in which that of x = 0
    is 1 + 2 nu: to first order the one moves by -2 times as much as the other.
    """
    by, mu = [], []
    for part in (1.0, 0.5):
        first = branch_off(special, "K", off=off * part)
        by.append(first.parameters["K"] - special.value)
        mu.append(first.multipliers.full[1].real - 1)
    assert by[0] == pytest.approx(4 * by[1], rel=0.1) and mu[0] == pytest.approx(4 * mu[1], rel=0.1)
    old = special.orbit
    problem = old.problem.with_value("K", special.value + by[1])
    beside = finished(
        solve_adaptively(problem, unknowns_of(old), Options(tol=1e-8), solver="newton"), problem, Options(), 0.0, "it"
    )
    assert mu[1] == pytest.approx(-2 * ((beside.multipliers.leading**2).real - 1), rel=0.1)


@pytest.mark.slow
def test_what_branches_off_lies_before_the_next_flip():
    """The lopsided pair from K = 48.4446 flips at 48.43318 already."""
    branch = round_the_fold()
    for special, off in zip(branch.special[:2], (0.005, 0.0003), strict=True):
        assert special.kind == "symmetry breaking"
        assert_next_to(special, off)
    second = branch.special[1]
    for off in (0.5, 0.02, -0.02):
        first = branch_off(second, "K", off=off)
        assert FLIPS[1] < first.parameters["K"] < second.value and abs(first.multipliers.full[1]) < 1
    x, y = (branch_off(second, "K", off=off).arcs[0].states[0, 0] for off in (3e-4, -3e-4))
    middle = second.orbit.arcs[0].states[0, 0]
    assert (x - middle) @ (y - middle) < 0  # one and the other of the pair


@pytest.mark.slow
@pytest.mark.parametrize(("off", "tol"), [(0.02, 1e-6), (-0.02, 1e-9)])
def test_cycles_of_twice_the_period_are_next_to_the_lopsided_flips(off, tol):
    first = branch_off(round_the_fold(tol).special[1], "K", off=off)
    pair = follow(first, "K", to=40.0, back=100.0, options=Options(tol=tol), largest_step=0.3)
    flips = {special.value: special for special in pair.special if special.kind == "flip"}
    assert sorted(flips) == pytest.approx(FLIPS, rel=1e-7)
    for value in sorted(flips):
        twice = branch_off(flips[value], "K")
        assert twice.period == pytest.approx(2 * flips[value].orbit.period, rel=1e-3) and twice.stable
        assert FLIPS[0] < twice.parameters["K"] < FLIPS[1]
        for far in (0.01, 0.02, -0.02):  # no farther off than was asked, or than a quarter of it, or a sixteenth ...
            arcs = branch_off(flips[value], "K", off=far).arcs
            away = np.linalg.norm((arcs[0].states[0, 0] - arcs[2].states[0, 0]) / flips[value].orbit.scale) / 2
            quarters = np.round(np.log(abs(far) / away) / np.log(4))
            assert away * 4**quarters == pytest.approx(abs(far), rel=0.25)
        assert_next_to(flips[value], 1e-5)
