"""Cycles of many problems at once: closed forms, the truths of independent programs, and each of them alone."""

from __future__ import annotations

import math
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from casahunt import InputError, NoOrbit, Options, Servo, Status, find_orbit
from casahunt.collocation.transcription import settings_of
from casahunt.design.ensemble import orbit_ensemble as hunting_ensemble
from casahunt.effort import MEMBERS_OF_A_PASS
from casahunt.orbits import ensemble as module
from casahunt.orbits import find_cycle, orbit_ensemble
from casahunt.orbits.ensemble import newton_of_many
from casahunt.orbits.fold_side import side_of
from casahunt.orbits.orbit import unknowns_of
from problems import belt, bouncing_ball, table1

SHARP = Options(tol=1e-8)
NAMES = tuple(name for name in Servo().names if name != "gain")


@pytest.fixture(scope="module")
def bouncing():
    _, state = bouncing_ball.truth(0.0125, 1, +1)
    return find_cycle(bouncing_ball.SYSTEM, settled=True, start=state, tol=1e-9)


def test_a_ball_on_many_tables(bouncing):
    """Period and multipliers are known in closed form: T = 2 pi/w, the trace that of the impact map."""
    amplitudes = np.linspace(0.0118, 0.0135, 60)
    found = orbit_ensemble(bouncing, ("a",), amplitudes[:, None], options=Options(tol=1e-9), multipliers=True)
    assert found.periods == pytest.approx(np.full(60, 2 * math.pi / 20), rel=1e-12)
    for i in (0, 59):
        known, _ = bouncing_ball.truth(float(amplitudes[i]), 1, +1)
        pair = found.multipliers[i], np.conj(found.multipliers[i])
        off = max(min(abs(mu - truth) for mu in pair) for truth in known.multipliers)
        assert off <= 10 * found.multiplier_errors[i] + 1e-9 and found.multiplier_errors[i] < 1e-5
        assert found.multipliers[i].imag != 0
        assert found.amplitudes[i] == pytest.approx(known.extrema["x"][1], rel=1e-9)
    assert set(found.how) == {"batch"} and not found.failures


def test_belts_of_any_speed():
    """From 0.2 to 0.5, far beyond what is expected from the first: the truths of the gallery."""
    slow = find_cycle(belt.BELT, "slip", x=0.0, v=0.0, tol=1e-9)
    speeds = np.array(list(belt.TRUTH))
    found = orbit_ensemble(slow, ["belt"], speeds[:, None], options=Options(tol=1e-9))
    for i, truth in enumerate(belt.TRUTH.values()):
        assert abs(found.periods[i] / truth.period - 1) <= found.period_errors[i] + 1e-13
        assert found.amplitudes[i] == pytest.approx(max(map(abs, truth.extrema["x"])), rel=2e-9)
    assert repr(found).startswith("<cycles of 3 times block on a belt, periods 8.28274 to 12.001: ")


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_gains_against_the_references(model):
    rows = table1.REFERENCE[model]["stable"][2:]
    orbit = find_orbit(table1.servo(), model, 0.4, options=SHARP)
    found = hunting_ensemble(
        table1.servo(), model, 0.4, ["gain"], [[row["K"]] for row in rows], options=SHARP, orbit=orbit
    )
    for i, row in enumerate(rows):
        assert found.periods[i] == pytest.approx(row["period"], rel=1e-8)
        assert found.amplitudes[i] == pytest.approx(row["amplitude"], rel=1e-8)


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_random_servos_as_alone(model):
    n = 30
    own = find_orbit(Servo(), model, 0.4, options=SHARP)
    values = np.array([own.problem.value(name) for name in NAMES])
    rows = values * (1 + 0.02 * np.random.default_rng(5).uniform(-1, 1, (n, values.size)))
    found = hunting_ensemble(Servo(), model, 0.4, NAMES, rows, options=SHARP, orbit=own)
    assert "alone" not in found.how and not found.failures
    for i, row in enumerate(rows):
        one = find_orbit(Servo().replace(**dict(zip(NAMES, map(float, row), strict=True))), model, 0.4, options=SHARP)
        assert abs(found.periods[i] / one.period - 1) <= found.period_errors[i] + one.period_error
        assert abs(found.amplitudes[i] / one.amplitude - 1) <= found.amplitude_errors[i] + one.amplitude_error
    assert (found.period_errors <= SHARP.tol).all() and (found.amplitude_errors <= SHARP.tol).all()


def test_what_the_halved_mesh_leaves_of_a_stiff_motion():
    """A LuGre cycle whose error the halved mesh shows too small: within the estimate all the same."""
    values = np.array([Servo().parameters(0.4)[Servo().names.index(name)] for name in NAMES])
    row = values * (1 + 0.02 * np.random.default_rng(5).uniform(-1, 1, (2, values.size)))[1]
    servo = Servo().replace(**dict(zip(NAMES, map(float, row), strict=True)))
    truth, orbit = (find_orbit(servo, "lugre", 0.4, options=Options(tol=tol)) for tol in (1e-11, 1e-7))
    assert 2e-9 < abs(orbit.amplitude / truth.amplitude - 1) <= orbit.amplitude_error <= 1e-7
    assert 2e-9 < abs(orbit.period / truth.period - 1) <= orbit.period_error <= 1e-7


def numbers(found):
    return np.column_stack([found.periods, found.period_errors, found.amplitudes, found.amplitude_errors])


def test_in_any_company(bouncing):
    """To the last bit: more than a pass, in another order, one by one, in threads."""
    values = np.random.default_rng(2).uniform(0.0118, 0.0135, (MEMBERS_OF_A_PASS + 9, 1))
    together = numbers(orbit_ensemble(bouncing, ["a"], values))
    order = np.random.default_rng(3).permutation(len(values))
    assert np.array_equal(numbers(orbit_ensemble(bouncing, ["a"], values[order])), together[order])
    assert np.array_equal(numbers(orbit_ensemble(bouncing, ["a"], values[50:51])), together[50:51])
    done: list[int] = []
    with ThreadPoolExecutor(2) as pool:
        threads = orbit_ensemble(bouncing, ["a"], np.tile(values, (3, 1)), executor=pool, report=done.append)
    assert np.array_equal(numbers(threads), np.tile(together, (3, 1)))
    assert done[-1] == len(threads) == 3 * len(values) and len(done) == 2
    assert pickle.loads(pickle.dumps(threads)).how == threads.how


def test_who_fails_says_so():
    """Beyond the fold no servo hunts; 5 % of the stick's torque changes the fold by a third."""
    own = find_orbit(Servo(), "switch", 0.6, options=SHARP)
    found = hunting_ensemble(
        Servo(), "switch", 0.6, ["friction.static"], [[0.53], [0.51], [0.55]], options=SHARP, orbit=own
    )
    assert found.how == ("batch", "alone", found.how[2]) and found.how[2] != "alone"
    assert np.isnan(found.periods[1]) and np.isfinite(found.periods[[0, 2]]).all()
    ((index, sentence),) = found.failures
    assert index == 1 and "of the switch servo" in sentence
    assert found.statuses[1] is not Status.CONVERGED
    assert found.periods[0] == pytest.approx(table1.REFERENCE["switch"]["stable"][4]["period"], rel=1e-8)


def test_nothing_is_believed_that_is_not_known(bouncing, monkeypatch):
    """A cycle that is no motion, or not known to the tolerance, goes on alone: patched, one after the other."""
    rows = [[0.0124], [0.0126]]

    honest = module.admissible_many
    monkeypatch.setattr(module, "admissible_many", lambda t, u, s: honest(t, u, s) & (s.p[:, 0] != 0.0124))
    assert orbit_ensemble(bouncing, ["a"], rows).how == ("recut", "batch")
    monkeypatch.undo()
    estimates = module.functional_errors
    too_large = np.array([[0.0, 0.0], [0.0, 1.0]])
    monkeypatch.setattr(module, "functional_errors", lambda *how: (too_large, *estimates(*how)[1:]))
    assert orbit_ensemble(bouncing, ["a"], rows).how == ("batch", "recut")
    # Where the cycle that a root leads to is behind a fold, and the one found from the known cycle too.
    monkeypatch.setattr(module, "odd_beyond_one", lambda *_: True)
    found = orbit_ensemble(bouncing, ["a"], rows)
    assert found.how == ("batch", "alone") and found.statuses[1] is Status.FAR_FROM_GUESS
    assert "the other side of a fold" in found.failures[0][1] and np.isnan(found.periods[1])


def test_alone_is_asked_last(bouncing):
    asked = []

    def alone(problem, options):
        asked.append(problem.value("a"))
        raise NoOrbit("no ball bounces there", Status.NOT_CONVERGED)

    found = orbit_ensemble(bouncing, ["a"], [[0.0125], [0.001]], alone=alone)
    assert asked == [0.001] and found.failures == ((1, "no ball bounces there"),)


def test_a_diverging_member_leaves_the_others(bouncing):
    t, u, setting = unknowns_of(bouncing)
    p = np.repeat(setting.p[None], 3, axis=0)
    start = np.repeat(u[None], 3, axis=0)
    start[1] = np.nan
    many = settings_of(setting, p, np.zeros_like(p))
    found, converged = newton_of_many(t, start, many, 1e-9, side_of(t, u, setting))
    assert converged.tolist() == [True, False, True]
    assert np.array_equal(found[0], found[2])


def test_a_root_far_from_where_it_was_expected_is_none(bouncing):
    t, u, setting = unknowns_of(bouncing)
    many, side = settings_of(setting, setting.p[None], np.zeros((1, setting.p.size))), side_of(t, u, setting)
    assert newton_of_many(t, 1.01 * u[None], many, 1e-9, side)[1].all()
    assert not newton_of_many(t, 3.5 * u[None], many, 1e-9, side)[1].any()  # it is solved, some turns away


@pytest.fixture(scope="module")
def next_to_the_fold():
    """The two cycles of the Switch servo at 99.94 % of its fold gain."""
    return {side: find_orbit(Servo(), "switch", 0.647, branch=side, options=SHARP) for side in ("stable", "unstable")}


def test_neighbours_of_a_cycle_next_to_a_fold_are_on_its_side(next_to_the_fold):
    """Newton's method leads from the unstable cycle to the stable ones of these servos."""
    rows = np.random.default_rng(1).uniform(-1, 1, (400, 8))[[25, 186, 329]]
    names = tuple(name for name in NAMES if name not in ("friction.stiffness", "friction.damping"))
    rows = np.array([Servo().parameters(1.0)[Servo().names.index(name)] for name in names]) * (1 + 0.01 * rows)
    for side, own in next_to_the_fold.items():
        found = hunting_ensemble(Servo(), "switch", 0.647, names, rows, options=SHARP, orbit=own)
        for i, row in enumerate(rows):
            servo = Servo().replace(**dict(zip(names, map(float, row), strict=True)))
            one = find_orbit(servo, "switch", 0.647, branch=side, options=SHARP)
            both = found.amplitude_errors[i] + one.amplitude_error
            assert found.amplitudes[i] == pytest.approx(one.amplitude, rel=both)


def test_the_two_sides_of_a_fold(next_to_the_fold):
    """Each cycle lies on its own side and not on the other's, though both have the same phases and parameters."""
    stable, unstable = (unknowns_of(next_to_the_fold[side]) for side in ("stable", "unstable"))
    assert not side_of(*stable).odd and side_of(*unstable).odd
    t, u, setting = stable
    many = settings_of(setting, setting.p[None], np.zeros((1, setting.p.size)))
    own = side_of(t, u, setting)
    assert newton_of_many(t, u[None], many, 1e-8, own)[1].all()
    assert not newton_of_many(t, u[None], many, 1e-8, replace(own, left=-own.left))[1].any()


def test_multipliers_as_alone(next_to_the_fold, monkeypatch):
    """Each with its sign, beside the fold too; one by one, by a patch, where the batch's meshes leave them unsure."""
    own = next_to_the_fold["unstable"]
    rows = [[0.53], [0.54]]
    words = {"options": SHARP, "orbit": own, "multipliers": True}
    found = hunting_ensemble(Servo(), "switch", 0.647, ["friction.static"], rows, **words)
    for i, ((static,), size) in enumerate(zip(rows, (1.0, 10.0), strict=True)):
        servo = Servo().replace(**{"friction.static": static})
        truth = find_orbit(servo, "switch", 0.647, branch="unstable", options=Options(tol=1e-10)).multipliers
        assert abs(truth.leading) > size and truth.trusted
        # An error of the cycle is one of mu, (mu - 1) times as large and next to the fold more.
        assert found.multipliers[i] == pytest.approx(truth.leading, rel=1e-5)
    monkeypatch.setattr(module, "leading_of_many", lambda t, u, s: (np.full(len(u), np.nan),) * 2)
    again = hunting_ensemble(Servo(), "switch", 0.647, ["friction.static"], rows, **words)
    assert again.multipliers == pytest.approx(found.multipliers, rel=1e-6)
    assert np.array_equal(numbers(again), numbers(found)) and again.how == found.how


@pytest.mark.parametrize(
    ("names", "rows", "sentence"),
    [
        (["b"], [[1.0]], "unknown parameter 'b'"),
        (["a"], [1.0], "1 columns, not of shape"),
        (["a", "a"], [[1.0, 1.0]], "each once"),
        ([], np.zeros((1, 0)), "at least one parameter"),
        (["a"], [["x"]], "a table of numbers"),
        (["a"], [[0.0125], [math.nan]], "row 2 of 2: a = nan"),
    ],
)
def test_bad_tables(bouncing, names, rows, sentence):
    with pytest.raises(InputError, match=sentence):
        orbit_ensemble(bouncing, names, rows)


def test_values_between_which_there_is_no_servo():
    """Static and Coulomb friction both above the old static one: one after the other would be refused."""
    problem = find_orbit(Servo(), "switch", 0.4).problem
    moved = problem.with_values(("friction.coulomb", "friction.static", "gain"), np.array([0.6, 0.7, 0.3]))
    assert moved == replace(
        problem, servo=Servo().replace(**{"friction.coulomb": 0.6, "friction.static": 0.7}), gain=0.3
    )
