"""Every way to fail is forced, and comes out as a status or a sentence, never as a number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import InputError, NoOrbit, Options, Servo, Status, find_orbit
from casahunt.collocation.admissibility import check_admissible
from casahunt.collocation.error_estimate import estimate
from casahunt.collocation.ipopt import ipopt
from casahunt.collocation.newton import newton
from casahunt.collocation.transcription import transcribe
from casahunt.orbits.adapt import refined, solve_adaptively
from casahunt.orbits.orbit import unknowns_of
from casahunt.servo.problem import Hunting
from casahunt.servo.servo import PARAMETERS


def test_every_status_has_advice():
    for status in Status:
        assert len(status.advice) > 8
        assert status.ok == (status is Status.CONVERGED)


def test_not_finite(orbit):
    t, u, setting = unknowns_of(orbit("switch", 0.3))
    u = u.copy()
    u[3] = np.nan
    assert newton(t, u, setting).status is Status.NOT_FINITE


def test_not_converged(orbit):
    t, u, setting = unknowns_of(orbit("switch", 0.3))
    rng = np.random.default_rng(0)
    wild = u + 5 * rng.standard_normal(u.size)
    wild[-t.phases :] = np.abs(wild[-t.phases :])
    for solver in (newton, ipopt):
        assert not solver(t, wild, setting).status.ok


def test_far_from_guess(orbit):
    t, u, setting = unknowns_of(orbit("switch", 0.3))
    assert newton(t, u * 1.02, setting, largest_move=1e-4).status is Status.FAR_FROM_GUESS


def test_past_the_fold_nothing_converges_admissibly(orbit):
    """IPOPT and Newton, from the orbit next to the fold, at a gain one per cent beyond it."""
    last = orbit("switch", 0.6473)
    t, u, setting = unknowns_of(last)
    beyond = replace(setting, p=np.append(setting.p[:-1], 0.654))
    for solver in ("newton", "ipopt"):
        solved = solve_adaptively(last.problem, (t, u, beyond), Options(tol=1e-6), solver=solver)
        assert not solved.status.ok
        assert solved.complaint()


def test_wrong_sequence_is_inadmissible(orbit):
    """The stick of the mirrored sequence: same equations up to signs, no motion of the servo."""
    t, u, setting = unknowns_of(orbit("switch", 0.3))
    nodes = t.nodes_of(u)
    wrong = Hunting("switch", Servo(), 0.3).cycle((("slip-", "stop"), ("stick", "breakaway-")), 2)
    other = transcribe(wrong, t.counts, t.degree, t.kind)
    verdict = check_admissible(other, other.pack(t.intervals_of(u), nodes, t.durations_of(u)), setting)
    assert not verdict.admissible
    assert "slip-" in verdict.violated


def test_a_stick_that_holds_more_than_static_friction_is_none(orbit):
    """The cycle of a servo with more static friction: it slips forward, and sticks until m = -Fs/0.9.

    Along the stick |m| is largest at its end, so the condition 1 - |m|/Fs falls to 1 - 1/0.9.
    """
    t, u, setting = unknowns_of(orbit("switch", 0.3))
    assert check_admissible(t, u, setting).admissible
    weaker = setting.p * np.where(np.arange(setting.p.size) == PARAMETERS.index("friction.static"), 0.9, 1.0)
    verdict = check_admissible(t, u, replace(setting, p=weaker))
    assert not verdict.admissible and verdict.phase == 1
    assert "phase 2 is no stick" in verdict.violated
    assert float(verdict.violated.rpartition(" ")[2]) == pytest.approx(1 - 1 / 0.9, rel=1e-2)


def test_too_coarse_a_mesh_is_not_clear(orbit):
    """Two intervals over a slip: the Stribeck drop hides, and the verdict says where."""
    t, u, setting = unknowns_of(orbit("switch", 0.04))
    coarse = transcribe(t.cycle, (1, 0), t.degree, t.kind)
    from casahunt.collocation.mesh import transfer

    coarse, u, fractions = transfer(t, u, setting.fractions, [np.array([0.0, 1.0])], target=coarse)
    verdict = check_admissible(coarse, u, replace(setting, fractions=fractions))
    assert verdict.unclear.any()


def test_tolerance_not_reached(at_most):
    rough = find_orbit(Servo(), "switch", 0.3, options=Options(tol=1e-2, degree=3))
    at_most(5)
    with pytest.raises(NoOrbit, match="error estimate stays above the tolerance"):
        refined(rough, Options(tol=1e-12))


def test_estimate_sees_a_perturbed_mesh(orbit):
    """An orbit on a mesh that is too coarse has an estimate of the size of its true error."""
    fine = orbit("switch", 0.04, tol=1e-11)
    for tol in (1e-3, 1e-5):
        rough = orbit("switch", 0.04, tol=tol)
        t, u, setting = unknowns_of(rough)
        e = estimate(t, u, setting)
        true = abs(rough.period / fine.period - 1)
        assert true <= 10 * e.period
        assert e.period <= 100 * true


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: find_orbit(Servo(), "swich", 0.1), "did you mean 'switch'"),
        (lambda: find_orbit(Servo(), "switch", -1), "gain = -1: must be greater than 0"),
        (lambda: find_orbit(Servo(), "switch", float("nan")), "must be a finite number"),
        (lambda: find_orbit(Servo(), "switch", 0.1, branch="upper"), "unknown branch"),
        (lambda: Options(tol=1e-15), "must lie between"),
        (lambda: Options(solver="newtn"), "did you mean 'newton'"),  # type: ignore[arg-type]
        (lambda: find_orbit(Servo(), "switch", 0.1, options=Options(degree=40)), "degree"),
    ],
)
def test_bad_input_is_one_sentence(call, words):
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.parametrize(
    ("model", "gain", "static"),
    [
        ("switch", 0.9, 0.53),
        ("switch", 0.1, 0.44),
        pytest.param("lugre", 0.9, 0.53, marks=pytest.mark.slow),  # test_find_orbit denies by the same fold
    ],
)
def test_no_cycle_says_what_was_scanned(model, gain, static):
    servo = Servo().replace(**{"friction.static": static})
    said = "no hunting limit cycle.*(in a fold|cannot sustain an oscillation).*scanned stick positions"
    with pytest.raises(NoOrbit, match=said) as caught:
        find_orbit(servo, model, gain)
    assert caught.value.status is None


@pytest.mark.parametrize(
    ("model", "gain"),
    [("switch", 0.6473), ("switch", 0.64733), pytest.param("lugre", 0.62029, marks=pytest.mark.slow)],
)
def test_a_hair_below_the_fold_both_cycles_are_found(model, gain):
    stable = find_orbit(Servo(), model, gain)
    unstable = find_orbit(Servo(), model, gain, branch="unstable")
    assert 0 < stable.half_multiplier < 1 < unstable.half_multiplier
    assert unstable.amplitude < stable.amplitude


def test_repeated_solves_give_the_same_bits():
    for model in ("switch", "lugre"):
        a, b = (find_orbit(Servo(), model, 0.3) for _ in range(2))
        assert (a.amplitude, a.period, a.half_multiplier) == (b.amplitude, b.period, b.half_multiplier)


@pytest.mark.slow
def test_a_jump_of_the_map_is_no_crash():
    """Next to the unstable cycle of this servo half cycles end without coming to a stop: an answer or a sentence."""
    changes = {
        "servo.inertia": 0.002952, "servo.motor_gain": 51.42, "controller.integral_time": 0.3576,
        "controller.lead_time": 0.137, "friction.static": 1.0507, "friction.stribeck_velocity": 0.004985,
        "friction.viscous": 0.08072,
    }  # fmt: skip
    servo = Servo().replace(**changes)
    try:
        found = find_orbit(servo, "switch", 2.686877765727051, branch="unstable")
    except NoOrbit as error:
        assert error.status is not None and len(str(error)) > 40
    else:
        assert found.status.ok and found.multipliers.leading.real > 1
