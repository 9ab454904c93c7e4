"""The random servos script: its engine against published digits, its verdicts where the answer is known to be wrong."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from peer_support import needs

from casahunt import NoOrbit, Options, Servo, Status, find_orbit
from problems.table1 import REFERENCE
from scripts import random_servos
from scripts.limits import TooSlow, within
from scripts.peers import switch_digits
from scripts.peers.switch_search import SwitchTruth


@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_the_engine_gives_the_reference_rows(branch):
    """Two programs that share nothing: Taylor series in extended precision, and these in decimal arithmetic."""
    for row in REFERENCE["switch"][branch][:3:2]:
        truth = switch_digits.SwitchMap(Servo(), row["K"], 24).cycle(row["amplitude"])
        assert abs(truth.amplitude / Decimal(row["amplitude"]) - 1) < 1e-9
        assert abs(truth.period / Decimal(row["period"]) - 1) < 1e-8
        assert abs(truth.mu / Decimal(row["mu"]) - 1) < 1e-6


def test_more_digits_and_differences_agree():
    rough, fine = (switch_digits.SwitchMap(Servo(), 0.04, digits) for digits in (20, 34))
    one, other = rough.half(0.05), fine.half(0.05)
    assert abs(one.position / other.position - 1) < 1e-17
    assert abs(one.slope / other.slope - 1) < 1e-15
    step = Decimal("1e-9")
    left, right = (fine.half(Decimal("0.05") + k * step).position for k in (-1, 1))
    assert abs((right - left) / (2 * step) / fine.half(Decimal("0.05")).slope - 1) < 1e-12


def test_the_fold():
    row = REFERENCE["switch"]["fold"]
    truth = switch_digits.fold(Servo(), row["K"] * (1 + 1e-6), row["amplitude"] * (1 - 1e-5), digits=24)
    assert abs(truth.gain / Decimal(row["K"]) - 1) < 2e-12
    assert abs(truth.amplitude / Decimal(row["amplitude"]) - 1) < 2e-10


@pytest.mark.parametrize(("branch", "place"), [("stable", 1), ("stable", 4), ("unstable", 0)])
def test_the_lugre_engine_gives_the_reference_rows(branch, place):
    needs("heyoka")
    from scripts.peers import lugre_digits

    row = REFERENCE["lugre"][branch][place]
    orbit = find_orbit(Servo(), "lugre", row["K"], branch=branch, options=Options(tol=1e-8))
    truth, _ = lugre_digits.cycle(Servo(), row["K"], orbit.arcs[0].states[0, 0][1:], orbit.period / 2)
    assert abs(float(truth.amplitude) / row["amplitude"] - 1) < 5e-12
    assert abs(float(truth.period) / row["period"] - 1) < 5e-12
    assert abs(float(truth.mu) / row["mu"] - 1) < 1e-6  # differences over 1e-9
    error = max(abs(orbit.amplitude / row["amplitude"] - 1), abs(orbit.period / row["period"] - 1))
    assert error < 10 * orbit.error_estimate + 5e-12


@pytest.mark.slow
def test_quadruple_precision_judges_multipliers_that_extended_precision_cannot():
    """A multiplier of 6e8: the rounding of the one engine is 10 % of its answer, that of the other 2e-23."""
    needs("heyoka")
    servo = Servo(inertia=0.084591, motor_gain=8.1634).replace(**{
        "controller.integral_time": 0.083489, "controller.lead_time": 0.020825, "friction.static": 2.3315,
        "friction.coulomb": 1.1523, "friction.stribeck_velocity": 0.017676, "friction.viscous": 0.016928,
    })  # fmt: skip
    orbit = find_orbit(servo, "lugre", 34.757, branch="unstable", options=Options(tol=1e-9))
    from scripts.peers.lugre_search import LugreTruth

    truth = LugreTruth(servo).next_to(orbit)
    assert truth is not None and truth.noise < 1e-20
    assert float(truth.mu) == pytest.approx(orbit.half_multiplier, rel=1e-9) and float(truth.mu) > 1e8
    assert abs(float(truth.mu) / orbit.half_multiplier - 1) < orbit.multipliers.error < 1e-6
    assert abs(float(truth.period) / orbit.period - 1) < 10 * orbit.error_estimate < 1e-8


@pytest.mark.parametrize(("gain", "a"), [(0.1, 0.02), (0.4, 0.000963095232), (0.6, 0.05), (0.005, 0.8)])
def test_extended_precision_gives_the_map_of_the_decimals(gain, a):
    """Two integrators of one map, in a motion that reverses without sticking, and at a multiplier of 1e5."""
    needs("heyoka")
    from scripts.peers.switch_long import LongMap

    fast, exact = LongMap(Servo(), gain).half(a), switch_digits.SwitchMap(Servo(), gain, 24).half(a)
    steep = max(1.0, abs(float(exact.slope)))
    assert fast.slips == exact.slips
    assert abs(fast.position / exact.position - 1) < 1e-15 * steep
    assert abs(fast.slope / exact.slope - 1) < 1e-14 * steep
    assert abs(fast.duration / exact.duration - 1) < 1e-15 * steep


@pytest.fixture
def half_the_fold(monkeypatch):
    """One gain instead of five: what is asked at each is the same."""
    monkeypatch.setattr(random_servos, "SHARES", (0.5,))


@pytest.mark.slow
def test_a_servo_and_the_file(tmp_path, capsys, monkeypatch, half_the_fold):
    """One servo at half its fold; a second run computes nothing and prints the same."""
    arguments = ["--only", "1", "--tol", "1e-6", "--out", str(tmp_path / "servos.jsonl")]
    assert random_servos.main(arguments) == 0
    first = capsys.readouterr().out
    (line,) = (tmp_path / "servos.jsonl").read_text().splitlines()
    rows = json.loads(line)["rows"]
    assert [row["branch"] for row in rows] == ["fold", "stable", "unstable"]
    assert all(row["verdict"] == "solved" and row["ratio"] < 10 for row in rows)
    monkeypatch.setattr(random_servos, "examine", None)
    assert random_servos.main(arguments) == 0
    assert capsys.readouterr().out == first


def test_rows_of_strategies_are_counted(tmp_path, capsys, half_the_fold):
    """Every question has one answer: of each table that answers questions, the counts add up to those asked."""
    out = tmp_path / "servos.jsonl"
    assert random_servos.main(["--only", "1", "2", "--tol", "1e-6", "--rows", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert said.endswith("6 questions about 2 servos\n")
    for line in out.read_text().splitlines():
        counts = json.loads(line)["strategies"]
        assert all(tried >= answers for tried, answers in counts.values())
        for table in ("STABLE", "UNSTABLE"):
            assert sum(answers for name, (_, answers) in counts.items() if name.startswith(f"{table}:")) == 1


def test_a_false_denial_and_a_small_estimate_are_called_so():
    servo, gain = Servo(), 0.61
    engine = SwitchTruth(servo)
    engine.top = switch_digits.Truth(*(Decimal(str(x)) for x in (0.647339083653, 0.00155239272991, 0, 0, 1)))
    truth = engine.own(gain, "unstable")
    assert truth is not None
    (row,) = (r for r in REFERENCE["switch"]["unstable"] if r["K"] == gain)
    assert abs(truth.amplitude / Decimal(row["amplitude"]) - 1) < 1e-9
    asked = {"branch": "unstable", "tol": 1e-6}
    assert random_servos.judge(dict(asked), None, truth, "none", True)["verdict"] == "false denial"
    assert random_servos.judge(dict(asked), None, truth, "lost", False)["verdict"] == "refused"
    assert random_servos.judge(dict(asked), None, None, "none", True)["verdict"] == "none"
    stable = find_orbit(servo, "switch", gain)
    truth = engine.next_to(stable)
    right = {"branch": "stable", "tol": 1e-6}
    assert random_servos.judge(dict(right), stable, truth, "", False)["verdict"] == "solved"
    proud = replace(stable, period_error=1e-15, amplitude_error=1e-15, amplitude=stable.amplitude * (1 + 1e-9))
    assert random_servos.judge(dict(right), proud, truth, "", False)["verdict"] == "wrong"
    assert random_servos.judge(right | {"branch": "unstable"}, stable, truth, "", False)["verdict"] == "wrong"
    for noise, verdict in ((1e-8, "unchecked"), (1e-10, "wrong")):  # an engine that cannot see 1e-9 has no say
        dim = replace(truth, noise=noise)
        assert random_servos.judge(dict(right), proud, dim, "", False)["verdict"] == verdict
        assert random_servos.judge(right | {"branch": "unstable"}, stable, dim, "", False)["verdict"] == "wrong"


@pytest.mark.slow
def test_the_fold_by_its_peaks():
    """The way for folds narrower than any difference quotient, where the quotients do well too."""
    row = REFERENCE["switch"]["fold"]
    truth = switch_digits._fold_by_peaks(Servo(), row["K"] * (1 + 1e-6), row["amplitude"] * (1 - 1e-5), 24, 1e-3)
    assert abs(truth.gain / Decimal(row["K"]) - 1) < 1e-11
    assert abs(truth.amplitude / Decimal(row["amplitude"]) - 1) < 1e-9


@pytest.mark.slow
def test_a_cycle_whose_neighbour_is_nearer_than_the_error():
    """Two fixed points 1e-11 apart, P < a on both sides of the pair: P - a changes its sign between them only."""
    servo = Servo().replace(
        **{
            "friction.static": 1.028209161172163, "friction.coulomb": 0.6417663697523452,
            "friction.stribeck_velocity": 0.09191676355190645, "friction.viscous": 0.06887648566413603,
            "servo.inertia": 0.009396352841557093, "servo.motor_gain": 4.926762454339205,
            "controller.integral_time": 0.2182702653624465, "controller.lead_time": 0.6685683486065149,
        }
    )  # fmt: skip
    found = find_orbit(servo, "switch", 0.3924257390484524, options=Options(tol=1e-8))
    truth = switch_digits.SwitchMap(servo, found.gain).cycle(found.amplitude, error=found.error_estimate)
    asked = {"branch": "stable", "tol": 1e-8}
    assert random_servos.judge(asked, found, truth, "", False)["verdict"] == "solved"
    assert abs(found.half_multiplier / float(truth.mu) - 1) < 1e-6


def test_a_busy_machine_refuses_no_more():
    """The limit is one of processor time."""
    with within(0.05):
        time.sleep(0.2)
    with pytest.raises(TooSlow), within(0.05):
        while True:
            pass


def test_what_denies(monkeypatch):
    for status in (None, Status.NOT_CONVERGED):

        def refuse(*_, status=status, **__):
            raise NoOrbit("no such cycle", status)

        monkeypatch.setattr(random_servos, "find_orbit", refuse)
        assert random_servos.answer("switch", Servo(), 0.1, "stable", 1e-6)[2] is (status is None)


def test_servos_are_drawn_from_the_ranges():
    drawn = [random_servos.draw(3, number) for number in range(300)]
    for key, (low, high) in random_servos.RANGES.items():
        values = np.array([p["friction.static"] / p[key] if key == "friction.coulomb" else p[key] for p in drawn])
        values = values[values > 0]
        assert low * 0.999 <= values.min() and values.max() <= high * 1.001
        assert abs(np.log(values).mean() - np.log(low * high) / 2) < 0.1 * np.log(high / low)
    assert 30 < sum(p["friction.viscous"] == 0 for p in drawn) < 90
    assert random_servos.draw(3, 7) == drawn[7]


def test_a_controller_by_gains_has_the_map_of_the_same_one_by_times():
    by_times = Servo()
    by_gains = replace(by_times, controller=by_times.controller.pid())
    maps = [switch_digits.SwitchMap(servo, 0.04, 24) for servo in (by_times, by_gains)]
    one, other = (m.half(0.05) for m in maps)
    assert abs(one.position / other.position - 1) < 1e-13 and abs(one.slope / other.slope - 1) < 1e-12


def test_servos_by_gains(half_the_fold, capsys):
    """Every third has complex zeros; one of those is asked and checked."""
    needs("heyoka")  # decimal arithmetic takes a minute
    drawn = [random_servos.draw(11, number, "pid") for number in range(200)]
    for key, (low, high) in random_servos.CONTROLLERS["pid"].items():
        values = np.array([p[key] for p in drawn])
        assert low * 0.999 <= values.min() and values.max() <= high * 1.001
    pairs = [p["controller.kp"] ** 2 / p["controller.kd"] / p["controller.ki"] for p in drawn]
    assert 0.2 < np.mean(np.array(pairs) < 4) < 0.5
    assert not {"controller.lead_time", "controller.integral_time"} & set(drawn[0])
    assert pairs[18] < 4
    assert random_servos.main(["--controller", "pid", "--only", "18", "--tol", "1e-6", "--fast"]) == 0
    assert "#18: 3 solved" in capsys.readouterr().err
