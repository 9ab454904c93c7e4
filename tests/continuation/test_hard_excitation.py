"""Continuation on the oscillator with hard excitation and shear (problems/stuart_landau.py): every cycle is known."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hard_excitation_support import LARGEST, NU, TOL, B, assert_true, c_of, cycle, period, square, values

from casahunt import Options
from casahunt.collocation.mesh import halved, phase_breaks, transfer
from casahunt.collocation.transcription import transcribe
from casahunt.continuation import crossings as crossings_module
from casahunt.continuation import special_points_between
from casahunt.continuation import walk as walks
from casahunt.continuation.curve import bend, bent_through, curve_point, ends, predict, secant_direction
from casahunt.continuation.fold import turns_back
from casahunt.continuation.locating import locate_special_point
from casahunt.continuation.special_points import (
    FOLD,
    GRAZING,
    SUPERSTABLE,
    SYMMETRY_BREAKING,
    special_point,
    user_monitor,
)
from casahunt.continuation.walk import step_along, walk, walk_naturally, walk_to_end
from casahunt.hybrid.system import Cycle
from casahunt.orbits import adapt
from problems import stuart_landau as sl
from problems.fixed_sequence import FixedSequence

# The curve and its predictor -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("mesh", ["the same", "finer", "other lengths"])
def test_the_cubic_passes_through_both_points_along_their_tangents(mesh):
    """Hermite's conditions, in the units of the later point and on its mesh."""
    before, after = cycle(3.2), cycle(3.3)
    start, end = ends(before, after, "c")
    if mesh != "the same":  # the same point of the curve on another mesh, in other units
        (b,) = phase_breaks(start.t, start.setting.fractions)
        breaks = halved([b]) if mesh == "finer" else [b + 0.3 * np.sin(2 * np.pi * b) / (2 * np.pi)]
        t, u, fractions = transfer(start.t, start.u / np.append(np.full(start.u.size - 1, 2.0), 1.0),
                                   start.setting.fractions, breaks)  # fmt: skip
        _, du, _ = transfer(start.t, start.du / np.append(np.full(start.u.size - 1, 2.0), 1.0),
                            start.setting.fractions, breaks)  # fmt: skip
        row = start.row * [0.5, 0.5, 1, 1]
        setting = replace(start.setting, fractions=fractions, scale=2 * start.setting.scale)
        start = replace(start, t=t, u=u, du=du, row=row, setting=setting)
    cubic = bend(start, end, (3.2 / 3.3 - 1, 3.2 / 3.3))
    assert cubic is not None and bend(start, end, (3.2 / 3.3 - 1, 3.2 / 3.3), side=1.0) is None
    point = replace(end, bend=cubic)
    # Where the earlier point lies along the later tangent, from the exact radii.
    r = np.sqrt([square(3.2), square(3.3)])
    T = period(r**2)
    s = float(point.row @ [(r[0] - r[1]) / r[1], 0.0, np.log(T[0] / T[1]), 3.2 / 3.3 - 1])
    u, lam, _ = predict(point, s)
    assert lam == pytest.approx(3.2 / 3.3 - 1, rel=1e-8)
    exact = end.u * np.append(np.full(u.size - 1, r[0] / r[1]), T[0] / T[1])
    np.testing.assert_allclose(u, exact, rtol=0, atol=1e-7)
    # The tangents at either end: r dr = (d r^2/dc) dc/2, and lambda = dc/c.
    h = 1e-5
    for at, c in ((s, 3.2), (0.0, 3.3)):
        (u_low, l_low, _), (u_high, l_high, _) = predict(point, at - h), predict(point, at + h)
        slope = (u_high[0] - u_low[0]) / (l_high - l_low)
        dr = (np.sqrt(square(c + 1e-5)) - np.sqrt(square(c - 1e-5))) / 2e-5
        assert slope == pytest.approx(dr * 3.3 / r[1], rel=1e-5)


def test_predictions_get_better_with_the_fourth_power_of_the_step():
    """The error of a cubic through two points and their tangents, a step further on."""
    errors = []
    for step in (0.08, 0.04):
        before, after = cycle(3.0 - step), cycle(3.0)
        start, end = ends(before, after, "c")
        point = replace(end, bend=bend(start, end, (-step / 3.0, 1 - step / 3.0)))
        ds = 1e-2 * step / 0.08
        u, lam, _ = predict(point, ds)
        errors.append(abs(u[0] - np.sqrt(square(3.0 * (1 + lam)) / square(3.0))))
    assert 8 < errors[0] / errors[1] < 40 and errors[0] < 1e-5


@pytest.mark.parametrize("bent", [False, True])
def test_a_predictor_bent_through_a_correction_leads_there(bent):
    before, last = cycle(3.1), cycle(3.2)
    start, point = ends(before, last, "c")
    if bent:
        point = replace(point, bend=bend(start, point, (3.1 / 3.2 - 1, 3.1 / 3.2)))
    ds = 0.03
    orbit, solved, reached = step_along(point, last, "c", ds, 0.0, 10.0, Options(tol=TOL))
    assert not reached
    assert_true(orbit, 1)
    lam = c_of(orbit) / 3.2 - 1
    better = bent_through(point, ds, solved, lam)
    u, told, _ = predict(better, ds)
    # The corrector keeps the length along the tangent in T_1, the predictor in ln T_1: to the square of a correction.
    corrected = np.log(solved.solution.u[-1] / predict(point, ds)[0][-1])
    assert told == pytest.approx(lam, abs=1e-14 + corrected**2)
    np.testing.assert_allclose(u, solved.solution.u, rtol=0, atol=1e-13 + 2 * solved.solution.u[-1] * corrected**2)
    # The corrector moves across the tangent alone: the length along it is ds.
    assert float(point.row @ secant_direction(last, orbit, "c")) == pytest.approx(ds, rel=1e-6)


@pytest.mark.parametrize(("c", "branch"), [(3.0, 1), (3.0, -1), (3.599, 1)])
def test_the_tangent(c, branch):
    """(dr/r, 0, dT/T, dc/c), of length one."""
    h = 1e-6
    logs = np.array([[np.log(s) / 2, np.log(period(s))] for s in (square(c - h, branch), square(c + h, branch))])
    dr, dT = (logs[1] - logs[0]) / (2 * h)
    expected = np.array([dr, 0, dT, 1 / c])
    expected /= np.linalg.norm(expected)
    for sense in (1.0, -1.0):
        point = curve_point(cycle(c, branch), "c", sense=sense)
        np.testing.assert_allclose(point.row, sense * expected, atol=1e-6)
    np.testing.assert_allclose(curve_point(cycle(c, branch), "c", like=-expected).row, -expected, atol=1e-6)


# Walks --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["newton", "ipopt"])
def test_round_the_fold_and_back(solver):
    options = Options(tol=TOL, solver=solver)
    orbits, why = walk_to_end(walk(cycle(3.0), low=2.5, high=9.0, options=options, largest_step=0.2))
    assert why == "c reached 2.5, the end of the range" and c_of(orbits[-1]) == 2.5
    assert max(map(c_of, orbits)) == pytest.approx(LARGEST, rel=0.02)
    top = max(range(len(orbits)), key=lambda k: c_of(orbits[k]))
    for k, orbit in enumerate(orbits):
        assert_true(orbit, 1 if orbit.amplitude**2 > B / (2 * c_of(orbit)) else -1)
        assert (orbit.amplitude**2 > B / (2 * c_of(orbit))) or k >= top
    lengths = [np.linalg.norm(secant_direction(a, b, "c")) for a, b in itertools.pairwise(orbits)]
    assert max(lengths) < 0.2 * 1.2
    assert orbits[0].error_estimate <= TOL


@pytest.mark.parametrize(("share", "taken"), [(-0.5, False), (0.1, False), (0.9, True), (1.4, True), (2.5, False)])
def test_a_step_ends_about_where_it_was_to_end(monkeypatch, share, taken):
    """A corrector that comes out at another place of the curve is not accepted."""
    last, ds = cycle(3.0), 0.05
    point = curve_point(last, "c")
    true = walks.corrected

    def elsewhere(predicted, lam, *others, **more):
        u, other, setting = predict(point, share * ds)
        solved = true((point.t, u, setting), other, *others, **more)
        return replace(solved, solution=replace(solved.solution, parameter=solved.solution.parameter + other - lam))

    monkeypatch.setattr(walks, "corrected", elsewhere)
    outcome = step_along(point, last, "c", ds, 0.0, 9.0, Options(tol=TOL))
    assert isinstance(outcome, str) is not taken
    if taken:
        assert_true(outcome[0], 1)
    else:
        assert "another part of the curve" in outcome


def test_natural_steps_are_relative_changes_of_the_parameter():
    way = walk_naturally(cycle(2.0), low=1.5, high=2.6, options=Options(tol=TOL), first_step=0.01, largest_step=0.03)
    began = time.perf_counter()
    orbits, why = walk_to_end(way)
    assert 0 < sum(o.wall_s for o in orbits) < time.perf_counter() - began
    values = [2.0, *map(c_of, orbits)]
    steps = [b / a - 1 for a, b in itertools.pairwise(values)]
    assert steps[0] == pytest.approx(0.01, rel=1e-12) and values[-1] == 2.6 and "reached 2.6" in why
    assert max(steps) == pytest.approx(0.03, rel=1e-12)
    for a, b in itertools.pairwise(steps):
        assert b <= 2 * a * (1 + 1e-12)
    for orbit in orbits:
        assert_true(orbit, 1)


def test_natural_continuation_ends_below_the_fold():
    orbits, why = walk_to_end(walk_naturally(cycle(3.59), low=1.0, high=9.0, options=Options(tol=TOL)))
    assert "the branch ends at c = 3.5" in why and "fold" in why
    assert LARGEST * (1 - 1e-3) < c_of(orbits[-1]) <= LARGEST
    assert all(b > a for a, b in itertools.pairwise(map(c_of, orbits)))
    assert_true(orbits[0], 1)


# Special points ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize(("low", "high"), [(3.5, 3.55), (3.2, 3.59), (3.599, 3.0)])
def test_the_fold_between_two_cycles(low, high, swap):
    """One on either part of the branch."""
    before, after = cycle(low), cycle(high, -1)
    if swap:
        before, after = after, before
    orbit = locate_special_point(before, after, FOLD, vary="c", options=Options(tol=TOL)).orbit
    assert c_of(orbit) == pytest.approx(LARGEST, rel=TOL)
    assert orbit.amplitude**2 == pytest.approx(B / (2 * LARGEST), rel=1e-7)  # c is of second order in it
    assert turns_back(before, after, "c")
    found, missed = special_points_between(before, after, vary="c", monitors=(FOLD,), options=Options(tol=TOL))
    assert [s.kind for s in found] == ["fold"] and not missed


def test_where_there_is_none():
    for branch in (1, -1):
        before, after = cycle(3.2, branch), cycle(3.3, branch)
        assert special_points_between(before, after, vary="c", monitors=(FOLD,), options=Options(tol=TOL)) == ([], [])
        assert not turns_back(before, after, "c") and not turns_back(after, before, "c")


@pytest.mark.parametrize("wanted", [0.55, 0.5, 0.451])
def test_where_a_function_of_the_users_vanishes(wanted):
    """r^2 = wanted: c = (b r^2 - 1 + nu)/r^4."""
    before, after = cycle(2.8), cycle(3.5)
    monitor = user_monitor("that size", lambda o: o.amplitude**2 - wanted)
    c = (B * wanted - 1 + NU) / wanted**2
    for first, last in ((before, after), (after, before)):
        found, missed = special_points_between(first, last, vary="c", monitors=(monitor,), options=Options(tol=TOL))
        (special,) = found
        assert not missed and special.kind == "that size"
        assert c_of(special.orbit) == pytest.approx(c, rel=1e-7)
        said = float(special.meaning.rpartition(" ")[2])
        assert "that size at c = " in special.meaning and said == pytest.approx(c, rel=1e-6)


def test_a_fold_that_is_not_located_is_told(monkeypatch):
    monkeypatch.setattr(crossings_module, "locate_special_point", lambda *_, **__: None)
    before, after = cycle(3.59), cycle(3.595, -1)
    found, (missed,) = special_points_between(before, after, vary="c", monitors=(FOLD,), options=Options(tol=TOL))
    assert not found and missed.kind == "fold" and "c = 3.59 and 3.595" in missed.meaning
    # Where both sides of it agree to the tolerance, the larger parameter is it.
    (special,), missed = special_points_between(before, after, vary="c", monitors=(FOLD,), options=Options(tol=1e-2))
    assert not missed and special.orbit is after
    other = user_monitor("size", lambda o: o.amplitude**2 - B / 7.2)
    found, (missed,) = special_points_between(before, after, vary="c", monitors=(other,), options=Options(tol=1e-2))
    assert not found and missed.kind == "size"


@dataclass(frozen=True)
class Narrow(FixedSequence):
    """A cycle is called wide as long as r^2 > 1/2, and narrow where it is not."""

    def cycle(self, signature, repeats):
        return WIDE if signature == WIDE.signature else NARROW


def narrow(posed, start, phase, *, soft):
    t, u, setting = start
    return [(transcribe(NARROW, t.counts, t.degree, t.kind), u, setting)]


def renamed(name: str, condition) -> Cycle:
    (phase,) = sl.SHEARED.phases
    return replace(sl.SHEARED, phases=(replace(phase, mode=replace(phase.mode, name=name, admissible=condition)),))


WIDE, NARROW = renamed("wide", lambda x, p, sign: x[0] ** 2 + x[1] ** 2 - 0.5), renamed("narrow", None)


def test_where_the_sequence_changes(monkeypatch):
    """At r^2 = 1/2, the last cycle with the phases of the first one."""
    monkeypatch.setattr(adapt, "other_sequences", narrow)
    before, after = cycle(2.8), cycle(3.55, -1)
    before = replace(before, problem=Narrow(WIDE, values(2.8), "c"), arcs=(replace(before.arcs[0], mode="wide"),))
    after = replace(after, problem=Narrow(NARROW, values(3.55), "c"), arcs=(replace(after.arcs[0], mode="narrow"),))
    found, missed = special_points_between(before, after, vary="c", monitors=(GRAZING,), options=Options(tol=1e-8))
    (special,) = found
    assert special.kind == "grazing" and not missed and special.orbit.signature == before.signature
    assert 0 <= special.orbit.amplitude**2 - 0.5 < 1e-5
    assert not special_points_between(before, before, vary="c", monitors=(GRAZING,), options=Options(tol=1e-8))[0]


def test_a_jump_is_not_located():
    jump = user_monitor("a jump", lambda o: 1.0 if o.amplitude**2 > 0.5 else -1.0)
    options = Options(tol=1e-6)
    found, (missed,) = special_points_between(cycle(2.8), cycle(3.5), vary="c", monitors=(jump,), options=options)
    assert not found and missed.kind == "a jump" and "was not located" in missed.meaning


def test_a_step_short_of_the_tolerance_is_none(at_most):
    rough = cycle(3.0, tol=1e-2, intervals=2)
    at_most(2)
    options = Options(tol=1e-11)
    outcome = step_along(curve_point(rough, "c"), rough, "c", 0.1, 0.0, 9.0, options)
    assert isinstance(outcome, str) and "tolerance" in outcome
    assert walk_to_end(walk_naturally(rough, low=2.0, high=4.0, options=options))[0] == []


def test_monitors_vanish_where_they_say():
    for mu in (-1.0, -0.25, 0.0, 0.5):
        orbit = SimpleNamespace(half_multiplier=mu)
        assert SYMMETRY_BREAKING.value(orbit, None) == mu + 1 and SUPERSTABLE.value(orbit, None) == mu


def test_a_value_is_said_in_the_digits_that_are_known():
    orbit = replace(cycle(3.2), parameter_error=0.0, period_error=2e-4, amplitude_error=0.0)
    orbit = replace(orbit, problem=orbit.problem.with_value("c", 3.23456789))
    assert "c = 3.235:" in special_point(FOLD, orbit, "c").meaning
    assert "c = 3.234568:" in special_point(FOLD, orbit, "c", 3e-7).meaning
    assert "c = 3.23457:" in special_point(FOLD, replace(orbit, parameter_error=3e-6), "c").meaning
