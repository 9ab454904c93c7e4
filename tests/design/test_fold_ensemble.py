"""Folds of many servos at once: references, exact symmetries, each of them alone, in any company, on any executor."""

from __future__ import annotations

import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from map_support import map_fold

from casahunt import InputError, Options, Servo, Status, find_fold
from casahunt.continuation import fold_ensemble as engine
from casahunt.continuation import fold_expansion, smallest
from casahunt.continuation.fold_ensemble import confirmed_many
from casahunt.design import ensemble
from casahunt.design.ensemble import fold_ensemble
from casahunt.design.nearby import known_fold
from casahunt.design.sensitivity import fold_sensitivities
from casahunt.effort import MEMBERS_OF_A_PASS, ROWS_OF_A_TASK
from casahunt.orbits import find_cycle
from problems import bouncing_ball, table1

SHARP = Options(tol=1e-8)
NAMES = {
    "switch": tuple(name for name in Servo().names[:-1] if name not in ("friction.stiffness", "friction.damping")),
    "lugre": Servo().names[:-1],
}


@pytest.fixture(scope="module")
def folds():
    return {model: find_fold(Servo(), model, options=SHARP) for model in ("switch", "lugre")}


def rows_about(model, n, spread=0.02, seed=5):
    names = NAMES[model]
    own = np.array([value for value in (Servo().parameters(1.0)[Servo().names.index(name)] for name in names)])
    return own * (1 + spread * np.random.default_rng(seed).uniform(-1, 1, (n, len(names))))


def numbers(found):
    return np.column_stack([
        found.gains, found.gain_errors, found.periods, found.period_errors, found.amplitudes, found.amplitude_errors,
    ])  # fmt: skip


@pytest.mark.parametrize("row", [
    [0.6142, 0.4705, 0.029, 0.0574], [0.5267, 0.5049, 0.0161, 0.0855], [0.4563, 0.4296, 0.0234, 0.2006],
    [0.5901, 0.4856, 0.013, 0.1044], [0.5912, 0.4117, 0.0188, 0.0492], [0.4864, 0.4025, 0.0116, 0.0636],
])  # fmt: skip
def test_what_one_expansion_does_not_reach_is_led_to(folds, row):
    """Friction that differs by a tenth, Stribeck velocity and damping by a half: the last fold of the event map."""
    names = [f"friction.{name}" for name in ("static", "coulomb", "stribeck_velocity", "viscous")]
    found = fold_ensemble(Servo(), "switch", names, [row], options=SHARP, fold=folds["switch"])
    truth = map_fold(Servo().replace(**dict(zip(names, row, strict=True)))).gain
    assert found.how == ("recut",) and found.gains[0] == pytest.approx(truth, rel=2e-8)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_the_way_back_to_the_reference(model):
    """The fold of Table 1 from that of a servo with one per cent more static friction."""
    near = Servo().replace(**{"friction.static": 0.5353})
    fold = find_fold(near, model, options=SHARP)
    found = fold_ensemble(near, model, ["friction.static"], [[0.53]], options=SHARP, fold=fold)
    reference = table1.REFERENCE[model]["fold"]
    assert found.gain_errors[0] < SHARP.tol
    assert found.gains[0] == pytest.approx(reference["K"], rel=found.gain_errors[0])
    assert found.periods[0] == pytest.approx(reference["period"], rel=1e-8)
    assert found.amplitudes[0] == pytest.approx(reference["amplitude"], rel=1e-8)
    assert found.how[0] in ("batch", "recut")


@pytest.mark.parametrize(
    ("model", "n"),
    [("switch", 3), *(pytest.param(model, 10, marks=pytest.mark.slow) for model in ("switch", "lugre"))],
)
def test_random_servos_as_alone(model, folds, n):
    rows = rows_about(model, n)
    found = fold_ensemble(Servo(), model, NAMES[model], rows, options=SHARP, fold=folds[model])
    assert not found.failures and found.how.count("alone") <= n // 10
    assert found.gain_errors.max() <= SHARP.tol
    for i, row in enumerate(rows):
        one = find_fold(Servo().replace(**dict(zip(NAMES[model], map(float, row), strict=True))), model, options=SHARP)
        orbit = one.orbit
        assert abs(found.gains[i] / one.gain - 1) <= found.gain_errors[i] + one.gain_error
        assert abs(found.periods[i] / orbit.period - 1) <= found.period_errors[i] + orbit.period_error
        assert abs(found.amplitudes[i] / orbit.amplitude - 1) <= found.amplitude_errors[i] + orbit.amplitude_error


def test_exact_symmetries(folds):
    """K goes like 1/motor gain, and depends on static and Coulomb friction through their difference."""
    names = ("servo.motor_gain", "friction.static", "friction.coulomb")
    found = fold_ensemble(
        Servo(), "switch", names, [[16, 0.53, 0.44], [16.5, 0.53, 0.44], [16, 0.535, 0.445]], options=SHARP,
        fold=folds["switch"], elasticities=True,
    )  # fmt: skip
    gain = folds["switch"].gain
    assert found.gains == pytest.approx([gain, gain * 16 / 16.5, gain], rel=2e-9)
    drop, static, coulomb = 0.09, 0.53, 0.44
    # d ln K/d ln static = static/drop where K goes like a function of the drop alone: their sum is that function's.
    assert found.elasticities[:, 0] == pytest.approx(-1, rel=1e-9)
    assert found.elasticities[0, 1] / static == pytest.approx(-found.elasticities[0, 2] / coulomb, rel=1e-9)
    assert drop == pytest.approx(static - coulomb)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_elasticities_as_alone(model, folds):
    names = NAMES[model]
    own = np.array([[folds[model].orbit.problem.value(name) for name in names]])
    found = fold_ensemble(Servo(), model, names, own, options=SHARP, fold=folds[model], elasticities=True)
    known = fold_sensitivities(folds[model]).elasticities
    # The two folds are on meshes of their own, both known to 1e-8.
    assert found.elasticities[0] == pytest.approx([known[name] for name in names], rel=1e-6, abs=1e-8)


def test_in_any_company(folds):
    """To the last bit: more than a pass and a task, in another order, one by one, in threads."""
    rows = rows_about("switch", 60)
    rows = np.concatenate([rows, rows[:50]])
    assert len(rows) > ROWS_OF_A_TASK > MEMBERS_OF_A_PASS

    def gains(rows, **words):
        return numbers(fold_ensemble(Servo(), "switch", NAMES["switch"], rows, fold=folds["switch"], **words))

    together = gains(rows)
    assert np.array_equal(together[60:], together[:50])
    order = np.random.default_rng(1).permutation(60)
    assert np.array_equal(gains(rows[order]), together[order])
    assert np.array_equal(gains(rows[7:8]), together[7:8])
    done: list[int] = []
    with ThreadPoolExecutor(2) as pool:
        assert np.array_equal(gains(rows, executor=pool, report=done.append), together)
    assert done == [ROWS_OF_A_TASK, 110]


def test_a_recut_member_in_any_company(folds):
    """One that has other phases than the known fold is computed from its own turning point."""
    rows = rows_about("lugre", 12)
    found = fold_ensemble(Servo(), "lugre", NAMES["lugre"], rows, options=SHARP, fold=folds["lugre"])
    assert {"batch", "recut"} <= set(found.how)
    i = found.how.index("recut")
    again = fold_ensemble(Servo(), "lugre", NAMES["lugre"], rows[i : i + 1], options=SHARP, fold=folds["lugre"])
    assert np.array_equal(numbers(again)[0], numbers(found)[i])


@pytest.mark.slow
def test_far_away_and_none_at_all(folds):
    """Half the Stribeck velocity is far from what is expected, and exact; pure Coulomb friction has no cycle."""
    names = ("friction.static", "friction.stribeck_velocity")
    found = fold_ensemble(
        Servo(), "switch", names, [[0.53, 0.02], [0.53, 0.008], [0.44, 0.02]], options=SHARP, fold=folds["switch"]
    )
    assert found.how[0] == "batch" and found.how[2] == "alone"
    assert found.gains[0] == pytest.approx(folds["switch"].gain, rel=2e-8)
    far = find_fold(Servo().replace(**{"friction.stribeck_velocity": 0.008}), "switch", options=SHARP)
    assert found.gains[1] == pytest.approx(far.gain, rel=found.gain_errors[1] + far.gain_error)
    assert found.gains[2] == 0 and np.isnan(found.periods[2]) and not found.failures
    assert "1 that cannot hunt, 0 not computed" in repr(found) and "\n" not in repr(found)
    assert found.statuses[0] is Status.CONVERGED


def test_nothing_is_believed_that_is_not_confirmed(folds, monkeypatch):
    """Errors above the tolerance, cycles that are no motion: the single way is asked."""
    rows = rows_about("switch", 3)

    def how():
        return fold_ensemble(Servo(), "switch", NAMES["switch"], rows, fold=folds["switch"]).how

    assert how() == ("batch",) * 3

    def unsure(known, u, settings, bend):
        out = confirmed_many(known, u, settings, bend)
        out[3, ::2] = 1e-3
        return out

    # No fold near Table 1's fails its confirmation: each doubt is put there, and the single way must answer.
    monkeypatch.setattr(engine, "confirmed_many", unsure)
    assert how() == ("alone", "batch", "alone")
    monkeypatch.undo()
    honest = engine.admissible_many

    def doubting(halves):
        meshes = []

        def doubts(t, u, settings):
            meshes.append(t.intervals)
            accepted = (t.intervals > meshes[0]) != halves
            return honest(t, u, settings) & (accepted | (settings.p[:, 4] != rows[1, 4]))

        return doubts

    # Of the fold, which is then judged on a mesh of its own; and of what a Newton step on the halved mesh makes of it.
    for halves, otherwise in ((False, "recut"), (True, "alone")):
        monkeypatch.setattr(engine, "admissible_many", doubting(halves))
        assert how() == ("batch", otherwise, "batch")
        monkeypatch.undo()
    monkeypatch.setattr(engine, "FARTHEST_SECOND", 1e-15)  # the fold of the halved mesh is another one
    assert how() == ("alone",) * 3
    monkeypatch.undo()
    known = known_fold(Servo(), NAMES["switch"], folds["switch"], 1e-6)
    monkeypatch.setattr(fold_expansion, "LARGEST_MOVE", 1e-9)  # another fold than the one that was expected
    monkeypatch.setattr(ensemble, "known_fold", lambda *_: known)
    assert how() == ("alone",) * 3
    monkeypatch.undo()
    monkeypatch.setattr(ensemble, "known_fold", lambda *_: None)
    assert how() == ("alone",) * 3


def test_neighbours_that_fail_leave_no_derivative(folds, monkeypatch):
    honest = engine.from_expansion

    def spoilt(*given, **more):
        found, settings = honest(*given, **more)
        found.u[0, -1], found.statuses[0] = -1.0, Status.INADMISSIBLE
        return found, settings

    # A neighbour so close never fails; here the first one does.
    monkeypatch.setattr(engine, "from_expansion", spoilt)
    known = known_fold(Servo(), NAMES["switch"], folds["switch"], 1e-6)
    assert known is not None and not known.first[0].any() and not known.second[0].any() and known.first[1:].any()


def test_folds_of_a_ball():
    """A user's own system, a smallest value: a w^2 = pi g (1 - e)/(1 + e) is the fold, for every restitution."""
    _, state = bouncing_ball.truth(0.0125, 1, +1)
    orbit = find_cycle(bouncing_ball.SYSTEM, settled=True, start=state, tol=1e-9)
    fold = smallest(orbit, "a")
    known = engine.expansion(fold, ("e", "g"), 1e-9)
    names = bouncing_ball.SYSTEM.names.parameters
    p = np.repeat(orbit.problem.vector()[None], 20, axis=0)
    p[:, names.index("e")] = np.linspace(0.77, 0.83, 20)
    p[:, names.index("g")] = np.linspace(9.6, 10.0, 20)[::-1]
    found = engine.folds_near(known, p, 1e-9, slopes_by=("e", "g"))
    e, g, w = (p[:, names.index(name)] for name in ("e", "g", "w"))
    assert found.values == pytest.approx(np.pi * g * (1 - e) / (1 + e) / w**2, rel=1e-10)
    assert found.slopes[:, 1] == pytest.approx(1, rel=1e-8)
    assert found.slopes[:, 0] == pytest.approx(-2 * e / (1 - e**2), rel=1e-8)
    assert set(found.how) == {"batch"}


def test_by_way_of_the_fold_halfway(folds, monkeypatch):
    """2.4 times the drop, or 2.4 times less Stribeck velocity: the same fold, too far for the expansion alone."""
    rows = [[0.656, 0.02], [0.53, 0.02 / 2.4]]
    names = ("friction.static", "friction.stribeck_velocity")
    found = fold_ensemble(Servo(), "switch", names, rows, options=SHARP, fold=folds["switch"])
    assert "alone" not in found.how
    assert found.gains[0] == pytest.approx(found.gains[1], rel=found.gain_errors.sum())
    known = known_fold(Servo(), names, folds["switch"], 1e-8)
    p = np.array([Servo().replace(**dict(zip(names, row, strict=True))).parameters(1.0) for row in rows])
    assert any(s is not Status.CONVERGED for s in fold_expansion.from_expansion(known, p, 1e-8, 0)[0].statuses)


def test_bad_tables(folds):
    with pytest.raises(InputError, match="row 2 of 2: friction.static = 0.3: must be at least 0.44"):
        fold_ensemble(Servo(), "switch", ["friction.static"], [[0.53], [0.3]], fold=folds["switch"])
    with pytest.raises(InputError, match="unknown model"):
        fold_ensemble(Servo(), "dahl", ["friction.static"], [[0.53]])
    with pytest.raises(InputError, match="unknown parameter 'friction.statik'"):
        fold_ensemble(Servo(), "switch", ["friction.statik"], [[0.53]])


def test_none_at_all(folds):
    found = fold_ensemble(Servo(), "switch", ["friction.static"], np.zeros((0, 1)), fold=folds["switch"])
    assert len(found) == 0 and found.elasticities.shape == (0, 0)


# Dask leaves sockets and loops to the garbage collector when its cluster closes.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing(folds):
    distributed = pytest.importorskip("distributed")
    rows = rows_about("switch", 8 * ROWS_OF_A_TASK)
    alone = fold_ensemble(Servo(), "switch", NAMES["switch"], rows[:ROWS_OF_A_TASK], fold=folds["switch"])
    done: list[int] = []
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        killed = threading.Event()

        def report(n):
            done.append(n)
            if n >= len(rows) // 4 and not killed.is_set():
                killed.set()
                os.kill(pids[0], signal.SIGKILL)

        found = fold_ensemble(
            Servo(), "switch", NAMES["switch"], rows, fold=folds["switch"], executor=client.get_executor(),
            report=report,
        )  # fmt: skip
        while pids[0] in (now := list(client.run(os.getpid).values())) or len(now) < 2:
            time.sleep(0.1)
    assert killed.is_set()
    assert done == [min((i + 1) * ROWS_OF_A_TASK, len(rows)) for i in range(8)]
    assert not found.failures and np.isfinite(found.gains).all()
    assert np.array_equal(numbers(found)[:ROWS_OF_A_TASK], numbers(alone))
    assert len(set(found.gains.tolist())) == len(rows)
