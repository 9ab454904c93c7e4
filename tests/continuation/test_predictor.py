"""Predictions along a branch, on meshes that move: against exact fronts, exact powers and the orbits further on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import Options, Servo, find_orbit
from casahunt.collocation.mesh import phase_breaks, transfer
from casahunt.continuation import walk as walks
from casahunt.continuation.curve import bend, bent_through, curve_point, predict, secant_direction, seen_from
from casahunt.continuation.predictor import carried, drift_along, resampled, starts
from casahunt.continuation.walk import step_along, walk
from casahunt.hybrid.examples import ball, belt
from casahunt.orbits import find_cycle
from casahunt.orbits.orbit import unknowns_of

OPTIONS = Options(tol=1e-6)


@pytest.fixture(scope="module")
def slipping():
    """Transcription, unknowns and mesh of the block on a belt, whose phases are a slip and a stick."""
    t, u, setting = unknowns_of(find_cycle(belt, "slip", x=0.0, v=0.0))
    return t, u, setting.fractions


@pytest.fixture(scope="module")
def stiff():
    """Three orbits of a LuGre servo in the order of a walk: a stiff mode, ten phases."""
    start = find_orbit(Servo(), "lugre", 0.2, options=OPTIONS)
    steps = walk(start, low=0.2, high=1.0, options=OPTIONS, first_step=0.05, largest_step=0.05)
    return [start, next(steps), next(steps)]


def along(orbits, vary="gain"):
    """The curve at the second of some orbits, bent through the first."""
    before, after = orbits[:2]
    way = secant_direction(before, after, vary)
    start, end = curve_point(before, vary, like=way), curve_point(after, vary, like=way)
    seen = seen_from(end, after, vary, before.problem.value(vary))
    return replace(end, bend=bend(start, end, seen))


def test_a_mesh_goes_with_a_front_that_moves(slipping):
    """x = tanh((tau - c)/w) and its derivative by c: nodes within the front go as fast as it does, the ends stay."""
    t, u, _ = slipping
    c, w, nodes = 0.6, 0.02, np.array([0.3, 0.5, 0.57, 0.59, 0.6, 0.61, 0.63, 0.7, 1.0])
    fractions = np.diff(nodes, prepend=0.0)
    times = starts(t, fractions)[:, None] + fractions[:, None] * t.scheme.points
    front = np.zeros_like(u), np.zeros_like(u)
    shapes = np.tanh((times - c) / w), -1 / np.cosh((times - c) / w) ** 2 / w
    for each, shape in zip(front, shapes, strict=True):
        t.intervals_of(each).reshape(t.intervals, t.degree + 1, t.n)[:, :, 0] = shape
    ends = np.cumsum(fractions * drift_along(t, *front, fractions))
    np.testing.assert_allclose(ends[2:7], 1.0, atol=0.12)  # a mesh resists
    assert ends[-1] == pytest.approx(0, abs=1e-12) and ends[0] == pytest.approx(0.3 / 0.5 * ends[1], rel=1e-3)


def test_polynomials_on_another_mesh_are_those_that_transfer_finds(slipping):
    t, u, fractions = slipping
    breaks = [b + 0.2 * np.sin(2 * np.pi * b) / (2 * np.pi) for b in phase_breaks(t, fractions)]
    new, expected, f = transfer(t, u, fractions, breaks)
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    got = resampled(t, w, fractions, new, f).reshape(new.intervals, -1)
    np.testing.assert_allclose(got[:, t.n :], new.intervals_of(expected)[:, t.n :], atol=1e-12)


def test_values_carried_by_a_mesh_that_moves(slipping):
    """Against differences of the values on meshes to either side."""
    t, u, fractions = slipping
    w, h = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n), 1e-6
    rates = fractions * np.cos(np.arange(t.intervals))
    for first, count in zip(t.first_intervals, t.collocated_counts, strict=True):
        own = slice(first, first + count)
        rates[own] -= fractions[own] * rates[own].sum()
    ahead, behind = (resampled(t, w, fractions, t, fractions + s * rates) for s in (h, -h))
    by_differences = (ahead - behind) / (2 * h)
    np.testing.assert_allclose(carried(t, w, fractions, rates)[:, 1:-1], by_differences[:, 1:-1], atol=2e-4)


def test_meshes_of_stiff_modes_move_along_and_predict_better():
    """The same cubic on the mesh of the last orbit errs by several times as much: as a rule, not from every orbit."""
    ratios = []
    for gain in (0.15, 0.2, 0.25, 0.4):
        start = find_orbit(Servo(), "lugre", gain, options=OPTIONS)
        orbits = [start, next(walk(start, low=0.1, high=1.0, options=OPTIONS, first_step=0.05))]
        assert along(orbits).bend.drift.any()
        moved, fixed = (
            step_along(one(orbits), orbits[1], "gain", 0.1, 0.0, 1.0, OPTIONS)[1].off for one in (along, along_fixed)
        )
        ratios.append(moved / fixed)
    assert np.exp(np.mean(np.log(ratios))) < 0.5


def along_fixed(orbits):
    """As `along`, on a mesh that stays, which is what the moving one is compared with: hence the patch."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("casahunt.continuation.curve.stiff", lambda t: False)
        return along(orbits)


def test_a_predicted_mesh_fills_every_phase(stiff):
    point = along(stiff)
    _, _, setting = predict(point, 0.3)
    sums = np.add.reduceat(setting.fractions, point.t.first_intervals)
    np.testing.assert_allclose(sums, 1.0, rtol=0, atol=1e-14)
    assert setting.fractions.min() > 0
    far = predict(point, 1e4)[2].fractions / point.setting.fractions  # MOST_STRETCHED: else it overflows
    assert np.exp(-2) < far.min() and far.max() < np.exp(2)
    np.testing.assert_array_equal(predict(point, 0.0)[2].p, point.setting.p)


def test_smooth_modes_keep_their_mesh():
    start = find_cycle(belt, "slip", x=0.0, v=0.0)
    orbits = [start, next(walk(start, vary="belt", low=0.2, high=0.5, options=OPTIONS))]
    point = along(orbits, "belt")
    assert not point.bend.drift.any()
    assert predict(point, 0.1)[2].fractions is point.setting.fractions


@pytest.mark.parametrize("ds", [0.05, 0.3])
def test_predictions_keep_the_length_along_the_tangent(stiff, ds):
    point = along(stiff)
    u, lam, _ = predict(point, ds)
    t, first = point.t, point.t.node_index[0]
    longer = np.log(t.durations_of(u)[0] / t.durations_of(point.u)[0])
    came = np.concatenate([u[first] - point.u[first], [longer, lam]])
    assert float(point.row @ came) == pytest.approx(ds, abs=1e-13)


def test_a_prediction_goes_back_to_the_point_before(stiff):
    """Through another mesh and back: to what polynomials of a mesh for 1e-6 show between its nodes."""
    point, before = along(stiff), stiff[0]
    way = secant_direction(before, stiff[1], "gain")
    s = -float(point.row @ (way * np.append(before.scale / point.setting.scale, [1.0, 1.0])))
    _, lam, _ = predict(point, s)
    assert stiff[1].problem.moved("gain", lam) == pytest.approx(before.gain, rel=1e-2)


def test_a_parameter_that_changes_sign_is_no_logarithm():
    """The earlier value of the other sign has no logarithm: nothing is said of the way on."""
    start = find_cycle(belt, "slip", x=0.0, v=0.0)
    after = next(walk(start, vary="belt", low=0.2, high=0.5, options=OPTIONS))
    way = secant_direction(start, after, "belt")
    here, there = curve_point(start, "belt", like=way), curve_point(after, "belt", like=way)
    seen = seen_from(there, after, "belt", start.problem.value("belt"))
    assert bend(here, there, seen) is not None
    relative = replace(there, setting=replace(there.setting, dp=np.where(there.setting.dp, there.setting.p, 0.0)))
    assert bend(here, relative, (-1.5, 1.0)) is None


def test_a_state_that_was_zero_has_no_logarithm(stiff):
    way = secant_direction(stiff[0], stiff[1], "gain")
    here, there = (curve_point(orbit, "gain", like=way) for orbit in stiff[:2])
    seen = seen_from(there, stiff[1], "gain", stiff[0].gain)
    u = here.u.copy()
    u[: -here.t.phases].reshape(-1, here.t.n)[:, 3] = 0.0  # zero at the start as it is
    assert bend(here, there, seen) is not None and bend(replace(here, u=u), there, seen) is None


def test_bent_through_another_mesh_says_nothing(stiff):
    point = along(stiff)
    outcome = step_along(point, stiff[1], "gain", 0.05, 0.0, 1.0, OPTIONS)
    solved, lam = outcome[1], 0.01
    other = replace(solved, setting=replace(solved.setting, fractions=solved.setting.fractions[::-1]))
    assert bent_through(point, 0.05, other, lam) is point


def test_a_fold_next_to_an_orbit_is_met():
    from casahunt.continuation import follow

    start = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    branch = follow(start, "a", to=0.005)
    assert [special.kind for special in branch.special] == ["fold"]
    # g (1 - r) pi/((1 + r) omega^2) is exact
    assert branch.special[0].value == pytest.approx(0.00856084, rel=1e-6)


@pytest.mark.parametrize(("off", "iterations", "moving", "room"), [
    (0.05, 4, True, 7 / 4), (0.05, 14, True, 1.0), (0.05 / 16, 14, True, 2.0), (1e-9, 14, True, 4.0),
    (1e-9, 14, False, 1.0), (0.06, 14, False, 0.5), (1.0, 1, True, 2.0),
])  # fmt: skip
def test_how_much_longer_the_next_step_may_be(stiff, off, iterations, moving, room):
    point = along(stiff)
    if not moving:
        point = replace(point, bend=replace(point.bend, drift=np.zeros_like(point.bend.drift)))
    outcome = step_along(point, stiff[1], "gain", 0.02, 0.0, 1.0, OPTIONS)
    solved = replace(outcome[1], off=off, iterations=iterations)
    assert walks._room(point, solved, OPTIONS) == pytest.approx(room)
    if iterations == 14:  # half of that for a provisional orbit, which needs fewer
        assert walks._room(point, replace(solved, iterations=10), Options(provisional=True)) == pytest.approx(room)
