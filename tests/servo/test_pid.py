"""Controllers by gains: the same servo in both forms, and complex zeros against engines that know no casahunt."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from map_support import map_fold
from servo_files import dump

from casahunt import (
    InputError,
    Options,
    Pid,
    Servo,
    cli,
    diagram,
    find_fold,
    find_orbit,
    load_orbit,
    save_orbit,
    simulate,
    walk,
)
from casahunt.design.fold_curve import fold_curve
from casahunt.design.nearby import values_of
from casahunt.design.sensitivity import fold_sensitivities
from casahunt.design.uncertainty.set import Uncertainty, check_box
from casahunt.servo.basin import basin
from casahunt.servo.denial import no_cycle
from casahunt.servo.equilibria import equilibria
from casahunt.servo.event_map.fixed_points import fixed_points
from casahunt.servo.event_map.slopes import map_at
from casahunt.servo.gains import lowest_stable_gain, routh_hurwitz_gain
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.margins import margins
from casahunt.servo.linear.open_loop import open_loop
from casahunt.servo.parts.file import load
from casahunt.servo.servo import flatten, with_overrides
from problems.taylor import lugre_half_cycle, switch_cycle, switch_half_cycle

FINE = Options(tol=1e-9)
TIMES = Servo()
UNEVEN = Servo().replace(**{"controller.lead_time": 0.09, "controller.integral_time": 0.21, "friction.viscous": 0.03})
PAIRS = [(servo, Servo(friction=servo.friction, controller=servo.controller.pid())) for servo in (TIMES, UNEVEN)]
COMPLEX = Servo(controller=Pid(kp=1.0, ki=6.0, kd=0.15))
"""Zeros -3.33 +- 5.37 j, kp^2 < 2 kd ki; the rest of it is Table 1."""


def by_gains(**values: float) -> Servo:
    """The servo of Table 1 with other gains."""
    return COMPLEX.replace(**{f"controller.{name}": value for name, value in values.items()})


def same(found: float, expected: float) -> None:
    assert found == pytest.approx(expected, rel=1e-9)


# The same servo in both forms


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("times", "gains"), PAIRS)
def test_orbit_fold_and_multipliers_of_both_forms(model, times, gains):
    for branch in ("stable", "unstable"):
        a, b = (find_orbit(servo, model, 0.3, branch=branch, options=FINE) for servo in (times, gains))
        same(b.period, a.period)
        same(b.amplitude, a.amplitude)
        same(b.half_multiplier, a.half_multiplier)
    a, b = (find_fold(servo, model, options=FINE) for servo in (times, gains))
    same(b.gain, a.gain)


@pytest.mark.parametrize(("times", "gains"), PAIRS)
def test_loop_and_equilibria_of_both_forms(times, gains):
    assert times.torque_gains(0.7) == pytest.approx(gains.torque_gains(0.7), rel=1e-15)
    same(routh_hurwitz_gain(gains), routh_hurwitz_gain(times))
    same(lowest_stable_gain(gains), lowest_stable_gain(times))
    for gain, delay in ((0.01, 0.0), (0.1, 0.02), (1.0, 0.001)):
        a, b = (linear_loop(servo, gain) for servo in (times, gains))
        np.testing.assert_allclose(b.poles, a.poles, rtol=1e-9)
        assert b.stable == a.stable and len(b.gain_crossovers) == len(a.gain_crossovers) == 1
        same(b.gain_crossovers[0].margin, a.gain_crossovers[0].margin)
        c, d = (margins(servo, gain, delay=delay) for servo in (times, gains))
        for name in ("frequency", "phase_margin", "lowest_factor", "highest_factor"):
            assert getattr(d, name) == pytest.approx(getattr(c, name), rel=1e-9, nan_ok=True)
        same(*(linear_loop(each, gain / 0.3).gain_crossovers[-1].frequency for each in (gains, times)))
        e, f = (equilibria(servo, "lugre", gain) for servo in (times, gains))
        for x, y in zip((*f.sharp, *f.simple, f.integral_limit), (*e.sharp, *e.simple, e.integral_limit), strict=True):
            same(x, y)
        omega = np.geomspace(0.1, 100, 7)
        by_gains, by_times = (open_loop(servo, gain).response(omega) for servo in (gains, times))
        np.testing.assert_allclose(by_gains, by_times, rtol=1e-12)


@pytest.mark.slow
def test_map_and_motion_of_both_forms():
    times, gains = PAIRS[0]
    a, b = (map_at(servo, 0.1, 0.02) for servo in (times, gains))
    same(b.position, a.position)
    same(b.slope, a.slope)
    same(b.gain_slope, a.gain_slope)
    a, b = ([point.amplitude for point in fixed_points(servo, 0.1).fixed] for servo in (times, gains))
    assert b == pytest.approx(a, rel=1e-9)
    a, b = (simulate(servo, "switch", 0.1, time=6.0) for servo in (times, gains))
    np.testing.assert_allclose(b.states[:, -1], a.states[:, -1], atol=1e-9)
    assert b.mode_at([6.0]) == a.mode_at([6.0])


@pytest.mark.slow
def test_fold_of_the_map_basin_and_bristles_of_both_forms():
    times, gains = PAIRS[0]
    same(map_fold(gains).gain, map_fold(times).gain)
    same(basin(gains, "switch", 0.3).border, basin(times, "switch", 0.3).border)
    a, b = (simulate(servo, "lugre", 0.1, time=6.0, tol=1e-8) for servo in (times, gains))
    np.testing.assert_allclose(b.states[:, -1], a.states[:, -1], atol=1e-9)


def test_elasticities_of_both_forms():
    """K kp, K ki and K kd are all there is: they sum to -1.  Chain rule: kp' = 1 + tau_d/tau_i, ki' = 1/tau_i."""
    times, gains = PAIRS[1]
    a, b = (fold_sensitivities(find_fold(servo, "switch", options=FINE)).elasticities for servo in (times, gains))
    kp, ki, kd = (b[f"controller.{name}"] for name in ("kp", "ki", "kd"))
    assert kp + ki + kd == pytest.approx(-1, abs=1e-8)
    c = times.controller
    part = c.lead_time / c.integral_time / (1 + c.lead_time / c.integral_time)
    assert a["controller.lead_time"] == pytest.approx(kd + part * kp, rel=1e-7)
    assert a["controller.integral_time"] == pytest.approx(-ki - part * kp, rel=1e-7)
    for name in ("servo.inertia", "friction.static", "friction.viscous"):
        assert a[name] == pytest.approx(b[name], rel=1e-7)


def test_the_proof_is_that_of_both_forms():
    """Of Switch, and of LuGre without a drop, whose bristle is damped little enough for it."""
    gains = (0.0, 0.01, 0.1, 1.0, 10.0)
    for servo in (TIMES, UNEVEN, TIMES.replace(**{"friction.static": 0.44, "friction.damping": 0.001})):
        other = replace(servo, controller=servo.controller.pid())
        for model in ("switch", "lugre"):
            said = [no_cycle(servo, model, gain) for gain in gains]
            assert said == [no_cycle(other, model, gain) for gain in gains]
    assert all(said)


# Complex zeros


@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_switch_cycles_with_complex_zeros(branch):
    found = find_orbit(COMPLEX, "switch", 0.6, branch=branch, options=FINE)
    amplitude, period = switch_cycle(COMPLEX, 0.6, found.amplitude * (1 + 1e-5))
    # Unstable, a goes into P(a) 1200 times: a period from P(a) is known so much worse than a.
    assert found.amplitude == pytest.approx(amplitude, rel=2e-9)
    assert found.period == pytest.approx(period, rel=1e-8)
    h = 1e-5 if branch == "stable" else 1e-8  # P moves 1300 times as much
    ends = [switch_half_cycle(COMPLEX, 0.6, amplitude * (1 + d))[0] / amplitude for d in (-h, h)]
    assert found.half_multiplier == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-4)


@pytest.mark.slow
def test_a_lugre_cycle_with_complex_zeros():
    found = find_orbit(COMPLEX, "lugre", 0.6, options=FINE)
    x, half, largest = lugre_half_cycle(COMPLEX, 0.6, found.sample()[1][:, 0])
    for _ in range(2):
        x, half, largest = lugre_half_cycle(COMPLEX, 0.6, -x)
    assert found.period == pytest.approx(2 * half, rel=3e-9)
    assert found.amplitude == pytest.approx(largest, rel=1e-5)  # of steps; the peak lies between them


@pytest.mark.parametrize("gains", [{}, {"kp": 0.5}, {"kp": 2.0, "ki": 20.0, "kd": 0.2}, {"kd": 0.0}])
def test_folds_with_complex_zeros_and_without_derivative_action(gains):
    """At the fold P(a) = a and P'(a) = 1: by the Taylor engine, the gain's error from the map's curvature in it."""
    servo = by_gains(**gains)
    fold = find_fold(servo, "switch", options=FINE)
    a = fold.orbit.amplitude

    def excess(gain: float, a: float) -> float:
        return switch_half_cycle(servo, gain, a)[0] / a - 1

    by_gain = (excess(fold.gain * (1 + 1e-6), a) - excess(fold.gain * (1 - 1e-6), a)) / 2e-6
    assert abs(excess(fold.gain, a) / by_gain) < 1e-8
    slope = (excess(fold.gain, a * 1.001) - excess(fold.gain, a * 0.999)) / 0.002
    curvature = (excess(fold.gain, a * 1.01) + excess(fold.gain, a * 0.99)) / 1e-4
    assert abs(slope / curvature) < 1e-3 and curvature < 0 > by_gain


def test_branches_and_fold_curves_in_a_gain():
    """Every point is what is found there from nothing; the slope of the curve is the elasticity."""
    curve = fold_curve(COMPLEX, "switch", vary="controller.ki", start=5.0, end=8.0, points=4, options=Options(tol=1e-8))
    assert curve.status.ok and len(curve.points) >= 4
    for point in (curve.points[0], curve.points[-1]):
        found = find_fold(by_gains(ki=point.value), "switch", options=Options(tol=1e-8))
        assert point.gain == pytest.approx(found.gain, rel=1e-6)
        elasticity = fold_sensitivities(found).elasticities["controller.ki"]
        assert point.slope * point.value / point.gain == pytest.approx(elasticity, rel=1e-4)
    *_, last = walk(find_orbit(COMPLEX, "switch", 0.6), vary="controller.kd", low=0.1, high=0.16, options=FINE)
    there = find_orbit(last.servo, "switch", 0.6, options=FINE)
    assert last.servo.controller.kd != 0.15 and last.period == pytest.approx(there.period, rel=1e-7)
    branch = diagram(COMPLEX, "lugre", start=0.7)
    fold = next(point for point in branch.special if point.kind == "fold")
    assert fold.orbit.gain == pytest.approx(find_fold(COMPLEX, "lugre").gain, rel=1e-5)


@pytest.mark.parametrize(("gain", "kinds"), [(0.6, ("hunting",)), (1.2, ("at rest", "decaying"))])
def test_verdicts_with_complex_zeros(gain, kinds):
    """Below the fold at 0.961 a step ends in the cycle that the Taylor engine has; above, at rest."""
    verdict = simulate(COMPLEX, "switch", gain, time=100.0).verdict
    assert verdict.kind in kinds
    if verdict.kind == "hunting":
        assert verdict.amplitude == pytest.approx(switch_cycle(COMPLEX, gain, 0.0036669)[0], rel=1e-4)


def test_elasticities_with_complex_zeros():
    e = fold_sensitivities(find_fold(COMPLEX, "switch", options=FINE)).elasticities
    for name, value in (("kp", 1.0), ("ki", 6.0), ("kd", 0.15)):
        h = 1e-3
        up, down = (find_fold(by_gains(**{name: value * (1 + d)}), "switch", options=FINE).gain for d in (h, -h))
        assert e[f"controller.{name}"] == pytest.approx((np.log(up) - np.log(down)) / (2 * h), rel=1e-4)


def test_a_slip_with_coulomb_friction_in_closed_form():
    """Fs = Fc: in slip x' = A x + b is linear, x(t) = x* + exp(A t)(x0 - x*)."""
    servo = COMPLEX.replace(**{"friction.static": 0.44})
    K, f = 0.5, servo.friction
    kp, ki, kd = K * 16 * 1.0, K * 16 * 6.0, K * 16 * 0.15
    A = np.array([[0, 1, 0], [-kp, -kd - f.viscous, -ki], [1, 0, 0]]) / np.array([[1], [servo.inertia], [1]])
    b = np.array([0, -f.coulomb / servo.inertia, 0])
    rest = np.linalg.solve(A, -b)
    values, vectors = np.linalg.eig(A)
    x0 = np.array([-1.0, 0, 0])
    motion = simulate(servo, "switch", K, time=10.0, tol=1e-10)
    slip = np.linspace(0, motion.events[0].time, 40)  # the first one
    for t, x in zip(slip, motion.sample(slip).T, strict=True):
        exact = rest + (vectors @ (np.exp(values * t) * np.linalg.solve(vectors, x0 - rest))).real
        np.testing.assert_allclose(x, exact, atol=1e-9)


# The proof that there is no cycle


def test_a_cycle_is_denied_only_where_motions_shrink():
    """(kd + sigma2 - s) kp/ki = J with complex zeros: above it every motion does, and known cycles are not denied."""
    servo = by_gains(kp=1.0, ki=30.0, kd=0.15).replace(**{"friction.stribeck_velocity": 0.5})
    assert servo.controller.kp ** 2 < 4 * servo.controller.ki * servo.controller.kd
    v = np.linspace(0, 1.5, 30001)
    g = 0.44 + 0.09 * np.exp(-((v / 0.5) ** 2))
    steepest = float(np.max(-np.diff(g) / np.diff(v)))
    gain = (0.026 * 30.0 + steepest - 0.1) / (16 * 0.15)
    assert no_cycle(servo, "switch", gain * (1 - 1e-6)) == ""
    assert "more energy is lost" in no_cycle(servo, "switch", gain * (1 + 1e-6))
    unit = servo.friction.static / servo.torque_gains(gain)[0]
    for part in (0.02, 0.1, 0.3, 1.0, 3.0, 10.0):
        assert abs(switch_half_cycle(servo, 1.01 * gain, part * unit, thrown_out=100 * unit)[0]) < part * unit
    assert no_cycle(COMPLEX, "switch", find_fold(COMPLEX, "switch").gain) == ""


def test_an_uncertainty_in_the_other_form_is_refused():
    with pytest.raises(InputError, match="unknown parameter 'controller.lead_time' .known: controller.kp"):
        check_box(COMPLEX, Uncertainty({"controller.lead_time": (0.1, 0.2)}))
    with pytest.raises(InputError, match="unknown parameter 'controller.kp'"):
        values_of(Servo(), ["controller.kp"])


# Files and the command line

TOML = "[controller]\nkp = 1.0\nki = 6.0\nkd = 0.15\n"


def test_files_and_overrides(tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text(TOML)
    assert load(path) == COMPLEX
    path.write_text(dump(COMPLEX))
    assert load(path) == COMPLEX
    assert with_overrides(Servo(), ["controller.kp=1", "controller.ki=6", "controller.kd=0.15"]) == COMPLEX
    assert with_overrides(COMPLEX, ["controller.kd=0.2"]) == by_gains(kd=0.2)
    back = with_overrides(COMPLEX, ["controller.lead_time=0.1", "controller.integral_time=0.2"])
    assert flatten(back)["controller.lead_time"] == 0.1 and not any(".k" in key for key in flatten(back))
    found = find_orbit(COMPLEX, "switch", 0.6)
    save_orbit(found, tmp_path / "orbit.npz")
    again = load_orbit(tmp_path / "orbit.npz")
    assert again.servo == COMPLEX and again.period == found.period


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (TOML + "lead_time = 0.1\n", "controller.kp, controller.lead_time: must not be given both"),
        ("[controller]\nkp = 1.0\nki = 6.0\n", "controller.kd: must be given too: kp, ki and kd go together"),
        ("[controller]\nkd = 1.0\n", "controller.kp: must be given too"),
        (TOML.replace("1.0", "0"), "controller.kp = 0: must be greater than 0"),
        (TOML.replace("6.0", "0"), "controller.ki = 0: must be greater than 0 (it is the integral action"),
        (TOML.replace("6.0", "-1"), "controller.ki = -1: must be greater than 0"),
        (TOML.replace("0.15", "-0.1"), "controller.kd = -0.1: must be at least 0"),
        (TOML.replace("6.0", "1e-12").replace("1.0", "9.0"), "kp/ki must be between 1e-12 and 1e+12 s"),
    ],
)
def test_wrong_controllers_are_one_sentence(text, said, tmp_path, capsys):
    path = tmp_path / "servo.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load(path)
    assert said in str(caught.value) and "\n" not in str(caught.value)
    assert cli.main(["loop", str(path), "--gain", "0.1"]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("servo", "changes", "said"),
    [
        (Servo(), ["controller.kp=1"], "controller.kp: must come with controller.ki and controller.kd"),
        (COMPLEX, ["controller.lead_time=1"], "controller.lead_time: must come with controller.integral_time"),
        (COMPLEX, [f"controller.{key}=1" for key in ("kp", "lead_time", "integral_time")], "must not be given both"),
    ],
)
def test_one_form_at_a_time(servo, changes, said):
    with pytest.raises(InputError) as caught:
        with_overrides(servo, changes)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_commands_take_gains(capsys):
    words = ["--set", "controller.kp=1", "--set", "controller.ki=6", "--set", "controller.kd=0.15"]
    assert cli.main(["fold", "--json", *words]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["gain"] == pytest.approx(find_fold(COMPLEX, "switch").gain, rel=1e-6)
    assert {"controller.kp", "controller.ki", "controller.kd"} <= set(record["elasticities"])
    assert "controller.lead_time" not in record["elasticities"]
    for command in (["loop", "--gain", "0.6"], ["equilibria", "--gain", "0.6"], ["map", "--gain", "0.6"]):
        assert cli.main([*command, *words]) == 0, capsys.readouterr().err
    assert cli.main(["fold-curve", "--vary", "controller.lead_time", "--from", "0.1", "--to", "0.2", *words]) == 2
    assert "unknown parameter 'controller.lead_time'" in capsys.readouterr().err
