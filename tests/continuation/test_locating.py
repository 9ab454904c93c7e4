"""The fold located by its turning point, against IPOPT's optimum; what stands guard over it."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casahunt import NoOrbit, Options, find_fold
from casahunt.collocation.admissibility import check_admissible
from casahunt.collocation.graphs import graphs
from casahunt.collocation.ipopt import maximise_parameter, solve
from casahunt.collocation.mesh import on_halved_mesh
from casahunt.collocation.node_system import Linearisation
from casahunt.collocation.transcription import settings_of
from casahunt.continuation import locating, next_fold
from casahunt.continuation.curve import along
from casahunt.continuation.fold import fold_slopes, located
from casahunt.continuation.fold_conditions import data_of
from casahunt.continuation.locating import turned_between
from casahunt.errors import Status
from casahunt.orbits import adapt
from casahunt.orbits.bordering import curve_border, row_along
from casahunt.orbits.orbit import unknowns_of
from problems import table1

FOLD = table1.REFERENCE["switch"]["fold"]


@pytest.fixture
def at_fold(orbit):
    """Transcription, unknowns, setting and row at the fold of Table 1, lambda in units of the gain."""
    best = find_fold(table1.servo(), "switch", options=Options(tol=1e-9)).orbit
    t, u, setting = unknowns_of(best)
    setting = replace(setting, dp=along(best.problem, "gain"))
    return t, u, setting, row_along(t, u, setting)


def turning_place(t, u, setting, *, bend=-np.inf, accuracy=0.0, row=None):
    """(u, lambda) at the turning point next to a point of the curve; None where there is none."""
    border = curve_border(t, u, row_along(t, u, setting) if row is None else row)
    found = solve(t, u, setting, solver="newton", border=border, accuracy=accuracy, bend=bend)
    return (found.u, found.parameter) if found.status.ok else None


@pytest.fixture
def beside(orbit):
    """An orbit on either side of the fold."""
    return orbit("switch", 0.64), orbit("switch", 0.64, "unstable")


def test_turning_point_and_optimum_agree(at_fold):
    """Without and with the Hessian; and how it moves, by the adjoint of the condensed equations and IPOPT's own."""
    t, u, setting, row = at_fold
    (_, ours), theirs = turning_place(t, u, setting, row=row), maximise_parameter(t, u, setting)
    assert theirs.status is Status.CONVERGED and ours == pytest.approx(theirs.parameter, abs=1e-12)
    g, ways = graphs(t), np.diag(setting.p)
    column = ca.Function("column", [g.z, g.data], [ca.densify(g.jacobian[:, t.size])])
    moves = [
        -float(theirs.multipliers @ np.array(column(np.append(u, 0.0), data_of(replace(setting, dp=way)))).ravel())
        for way in ways
    ]
    one = settings_of(setting, setting.p[None], setting.dp[None])
    assert fold_slopes(t, u[None], one, row, ways[None])[0] == pytest.approx(moves, abs=1e-6)
    assert np.abs(moves).max() > 1


def test_a_row_is_found_where_the_first_node_does_not_move(at_fold, monkeypatch):
    """Next to the sharpest folds its rate is none: the first duration has one.  Patched: those take long to compute."""
    t, u, setting, row = at_fold
    honest, asked = Linearisation.tangent, []

    def tangent(self, border):
        asked.append(border)
        du, y = honest(self, border)
        return (du, np.nan * y) if len(asked) == 1 else (du, y)

    monkeypatch.setattr(Linearisation, "tangent", tangent)
    again = row_along(t, u, setting)
    assert len(asked) == 2 and abs(again @ row) == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("wrong", [0.2, 1.0, 5.0, 1e-6, np.inf])
def test_a_bend_need_be_known_about(at_fold, orbit, wrong):
    """Five times off either way, a million times too small, or not but for its sign."""
    t, u, setting, row = at_fold
    bend = solve(t, u, setting, solver="newton", border=curve_border(t, u, row), bend=-np.inf).bend
    near = orbit("switch", 0.647)
    t, u, setting = unknowns_of(near)
    setting = replace(setting, dp=along(near.problem, "gain"))
    place = turning_place(t, u, setting, accuracy=1e-12, bend=wrong * bend)
    honest = turning_place(t, u, setting)
    assert place is not None and honest is not None
    assert place[1] == pytest.approx(honest[1], abs=1e-13)
    assert t.nodes_of(place[0]) == pytest.approx(t.nodes_of(honest[0]), abs=1e-10)


@pytest.mark.parametrize("bend", [-40.0, -np.inf])
def test_of_a_smallest_gain_no_bend_makes_a_largest(orbit, bend):
    """The slopes on the way show the sign of the bend, whatever it was said to be."""
    near = orbit("switch", 0.6465)
    t, u, setting = unknowns_of(near)
    setting = replace(setting, dp=-along(near.problem, "gain"))
    assert turning_place(t, u, setting, accuracy=1e-11, bend=bend) is None


def test_an_equation_that_cannot_be_solved_has_no_turning_point(at_fold):
    t, u, setting, row = at_fold
    assert turning_place(t, np.nan * u, setting, accuracy=1e-11, bend=-4.0, row=row) is None


def test_a_fold_is_solved_for_where_the_branch_turns(beside):
    """Between two orbits that lie far apart, in either order."""
    for before, after in (beside, beside[::-1]):
        found = located(before, after, "gain", Options(tol=1e-10))
        assert found.orbit.gain == pytest.approx(FOLD["K"], rel=1e-11)
        assert found.orbit.amplitude == pytest.approx(FOLD["amplitude"], rel=1e-9)
        assert found.orbit.error_estimate <= 1e-10


def test_what_is_not_between_the_two_orbits_is_another_fold(beside, orbit, monkeypatch):
    """Patched: where a cubic turns between two orbits of this servo, Newton's method leads to the fold there."""
    monkeypatch.setattr(locating, "turned_orbit", lambda *_: orbit("switch", 0.3))
    assert turned_between(*beside, "gain", Options(tol=1e-8)) is None


@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_between_two_orbits_of_one_side_there_is_no_fold(orbit, branch):
    """The cubic through them turns beyond them, if at all: it leads to the fold, which is not between them."""
    ends = orbit("switch", 0.6, branch), orbit("switch", 0.64, branch)
    assert turned_between(*ends, "gain", Options(tol=1e-8)) is None


def test_what_is_no_motion_is_no_fold(beside, monkeypatch):
    """Patched: the fold of this servo is a motion.  It has the mesh it was solved on, or that of the motion itself."""
    judged = []
    monkeypatch.setattr(
        adapt, "check_admissible", lambda *a: judged.append(a) or replace(check_admissible(*a), violated="a slip")
    )
    assert turned_between(*beside, "gain", Options(tol=1e-8)) is None
    assert len({t.intervals for t, *_ in judged}) <= 2, "no mesh makes it one"


def test_intervals_that_are_not_clear_are_cut(beside, monkeypatch):
    """Once everything is unclear, by a patch: the mesh has four times the intervals, the fold is the same."""
    judged = []

    def unclear(t, u, setting):
        verdict = check_admissible(t, u, setting)
        judged.append(t.intervals)
        blank = len(judged) == 1
        return replace(verdict, unclear=np.ones(t.intervals, bool)) if blank else verdict

    monkeypatch.setattr(adapt, "check_admissible", unclear)
    found = turned_between(*beside, "gain", Options(tol=1e-6))
    assert found.gain == pytest.approx(FOLD["K"], rel=1e-9)
    assert judged[1] == 4 * judged[0]


def test_turning_point_is_not_sought_without_end(at_fold):
    """An accuracy that rounding does not grant is not waited for."""
    t, u, setting, row = at_fold
    bend = solve(t, u, setting, solver="newton", border=curve_border(t, u, row), bend=-np.inf).bend
    assert turning_place(t, u, setting, accuracy=1e-18, bend=bend, row=row) is not None


@pytest.mark.parametrize(("gain", "off"), [(0.64, 0.0), (0.647, 0.1)])
def test_slopes_are_believed_on_the_curve_and_compared_far_apart(orbit, gain, off):
    """From an orbit a percent below the fold; from unknowns a tenth off the curve, by a bend that is about known."""
    near = orbit("switch", gain)
    t, u, setting = unknowns_of(near)
    setting = replace(setting, dp=along(near.problem, "gain"))
    start = u * (1 + off * np.random.default_rng(1).uniform(-1, 1, u.size))
    found = turning_place(t, start, setting, row=row_along(t, u, setting), accuracy=1e-11, bend=-4.0)
    assert found is not None and gain * (1 + found[1]) == pytest.approx(FOLD["K"], rel=1e-9)


def test_a_turning_point_beyond_the_freedom_is_not_next_to_the_start(orbit):
    with pytest.raises(NoOrbit, match="not located on its branch"):
        next_fold(orbit("switch", 0.1), "gain", Options(tol=1e-8, solver="newton"))


def test_a_turning_point_is_a_maximum_where_only_the_sign_of_the_bend_is_known(orbit):
    """Of minus the gain it is a minimum, of which no step of any length makes a maximum; nor is there one at 0.4."""
    fold = find_fold(table1.servo(), "switch", options=Options(tol=1e-9)).orbit
    for at, sense, there in ((fold, 1.0, True), (fold, -1.0, False), (orbit("switch", 0.4), 1.0, False)):
        t, u, setting = unknowns_of(at)
        setting = replace(setting, dp=sense * along(at.problem, "gain"))
        assert (turning_place(t, u, setting) is not None) == there
    t, u, setting = unknowns_of(fold)
    setting = replace(setting, dp=-along(fold.problem, "gain"))
    assert turning_place(t, u, setting, bend=np.inf) is not None, "a smallest one is found where it is asked for"


def test_the_place_of_a_fold_without_multipliers(orbit):
    """From 0.647, on a finer mesh, to the reference."""
    near = orbit("switch", 0.647)
    t, u, setting = unknowns_of(near)
    t, u, fractions = on_halved_mesh(t, u, setting.fractions)
    setting = replace(setting, fractions=fractions, dp=along(near.problem, "gain"))
    found = turning_place(t, u, setting)
    assert found is not None
    assert 0.647 * (1 + found[1]) == pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-10)
