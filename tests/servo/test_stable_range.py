"""Up to which gain a stable cycle exists: against Taylor series, against problems/canudas_gain.py, and by motions."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from casahunt import NoOrbit, Servo, cli, find_fold, find_orbit, simulate
from casahunt.orbits import Options
from casahunt.servo import stable_range as module
from casahunt.servo.stable_range import stable_range
from casahunt.views.answers.fold import stability_of
from problems import canudas_gain, canudas_servo, table1
from problems.taylor import switch_cycle, switch_half_cycle
from scripts.random_servos import draw

SHARP = Servo().replace(**draw(2026, 2))
"""A random servo whose fold is sharp: at 0.99999 of its gain the half multiplier is -3.7e3."""


def slope(servo: Servo, gain: float, a: float, h: float = 1e-4) -> float:
    """P'(a) by Taylor series."""
    P = [switch_half_cycle(servo, gain, a * (1 + k * h))[0] for k in (-1, 1)]
    return (P[1] - P[0]) / (2 * h * a)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_smooth_fold_has_stable_cycles_up_to_it(model):
    found = stable_range(find_fold(Servo(), model))
    assert found.beyond == "fold" and found.gain == pytest.approx(table1.REFERENCE[model]["fold"]["K"], rel=1e-6)
    assert found.ranges == ((pytest.approx(found.gain / 2, rel=1e-9), found.gain),)
    assert stability_of(found.fold, Options())["sentence"] == "up to that gain"


def test_a_sharp_fold_has_none_that_a_servo_could_follow():
    """mu = -1 where the program says, by another engine; the fold is 5 % above."""
    fold = find_fold(SHARP, "switch")
    found = stable_range(fold)
    assert found.beyond == "none" and len(found.ranges) == 1 and found.gain < 0.95 * fold.gain and found.largest > 3
    a, _ = switch_cycle(SHARP, found.gain, find_orbit(SHARP, "switch", found.gain).amplitude)
    assert slope(SHARP, found.gain, a) == pytest.approx(-1, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "low", "high"), [(0.98, 0.985, 1.015), (1.02, 0.0, 0.5)])
def test_no_lopsided_cycle_takes_over_there(factor, low, high):
    """Below, motions beside the cycle come closer to it; above, where a pair would draw them, they come to rest."""
    gain = factor * stable_range(find_fold(SHARP, "switch")).gain
    a, _ = switch_cycle(SHARP, gain, find_orbit(SHARP, "switch", gain).amplitude)
    b = 1.02 * a
    for _ in range(60):
        b = abs(switch_half_cycle(SHARP, gain, b)[0])
        if b < 0.5 * a:
            break
    assert low <= b / a < high


@pytest.mark.slow
def test_losing_and_regaining_stability():
    """Canudas' LuGre servo, all gains K times: symmetric and stable up to K = 48.0202, and from 48.4446 to the fold."""
    found = stable_range(find_fold(canudas_servo.servo(), "lugre"))
    edges = [gain for pair in found.ranges for gain in pair][1:]
    assert edges == pytest.approx([*canudas_gain.BREAKING, canudas_gain.FOLD], rel=2e-7)
    assert found.beyond == "fold" and found.gain == found.fold.gain
    said = stability_of(found.fold, Options())["sentence"]
    low, high = (f"{gain:.5f}" for gain in canudas_gain.BREAKING)
    assert said == f"up to {low} and from {high} V/rad to that gain; in between lopsided ones may be stable"


@pytest.mark.slow
def test_a_step_over_both_changes_is_looked_at_again():
    """Stable at both ends of the step, and not in between: from K = 48.0202 to 48.4446 (problems/canudas_gain.py)."""
    before, after = (find_orbit(canudas_servo.servo(), "lugre", gain) for gain in (47.5, 48.452))
    assert before.stable and after.stable
    seen = module._looked_closer([before, after], Options(tol=1e-5))
    low, high = canudas_gain.BREAKING
    assert [orbit.stable for orbit in seen] == [not low < orbit.gain < high for orbit in seen]
    assert any(not orbit.stable for orbit in seen) and (seen[0], seen[-1]) == (before, after)


@pytest.mark.slow
def test_a_pair_of_stable_lopsided_cycles():
    """The LuGre servo with the numbers of SHARP: beside the symmetric cycle swings settle to a longer and a shorter."""
    found = stable_range(find_fold(SHARP, "lugre"))
    assert found.beyond == "lopsided"
    gain = 1.003 * found.gain
    orbit = find_orbit(SHARP, "lugre", gain)
    x = orbit.sample()[1][:, 0]
    start = {"position": 1.01 * x[0], "velocity": 1.01 * x[1], "integral": x[2], "bristle": x[3], "set_point": 0.0}
    swings = simulate(SHARP, "lugre", gain, time=120 * orbit.period, tol=1e-5, **start).shape()[1][-9:-1]
    assert orbit.half_multiplier < -1 and abs(swings[0] / swings[1] - 1) > 1e-3
    assert swings[:-2] == pytest.approx(swings[2:], rel=2e-4)


def test_a_change_that_is_an_error_of_the_multipliers_lies_next_to_it():
    """Both cycles are stable; of the second a mesh that was too coarse has said it is not."""
    gain = stable_range(find_fold(SHARP, "switch")).gain
    before, after = (find_orbit(SHARP, "switch", part * gain, options=Options(tol=1e-6)) for part in (0.999, 0.9999))
    rough = replace(after, period_error=1e-3, amplitude_error=1e-3)
    vars(rough)["multipliers"] = replace(after.multipliers, leading=-1.02 + 0j, log10_leading=math.log10(1.02))
    assert before.stable and after.stable and not rough.stable
    assert module._located(before, rough, Options(tol=1e-6)).gain == pytest.approx(after.gain, rel=1e-6)


def test_nothing_is_said_where_no_stable_cycle_is_met(monkeypatch):
    """Patched: motions lead to the stable cycles of a servo that has some."""

    def fails(*_, **__):
        raise NoOrbit("none")

    fold = find_fold(Servo(), "switch")
    monkeypatch.setattr(module, "stable_at", fails)
    found = stable_range(fold)  # from the cycle that the search for the fold begins with
    assert found.gain == fold.gain and found.ranges[0][0] > 0.5 * fold.gain
    monkeypatch.setattr(module, "find_any_orbit", fails)
    with pytest.raises(NoOrbit, match="no motion of the switch servo led to a stable cycle"):
        stable_range(fold)
    assert "up to which gain is not known" in stability_of(fold, Options())["sentence"]


def test_a_branch_that_is_not_followed_is_not_stable_up_to_the_fold(monkeypatch):
    """Patched: branches of servos are followed."""
    fold = find_fold(canudas_servo.servo(), "lugre")
    monkeypatch.setattr(module, "_upwards", lambda *_: [])
    with pytest.raises(NoOrbit, match="were followed to gain"):
        stable_range(fold)


def test_what_fold_prints(capsys):
    words = ["fold", "--quiet", *(f"--set={key}={value!r}" for key, value in draw(2026, 2).items())]
    assert cli.main([*words, "--details"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "hunting is possible up to gain 15.98 V/rad" in out and "gain there 15.976" in out
    assert "up to 15.15 V/rad motions end in a cycle" in out and "a stable cycle up to gain 15.149" in out
    assert "Keep above 15.976" in out and "no cycle is left" in out
    assert cli.main([*words, "--json"]) == 0
    stable = json.loads(capsys.readouterr().out)["stable"]
    assert stable["beyond"] == "none" and stable["gain"] == stable["ranges"][-1][1] < stable["seen"] < 15.98


def test_what_fold_prints_of_gains_in_between(capsys):
    """From 8.962 to 9.306 V/rad: simulated motions that start next to the cycle end in it below, and leave it there."""
    values = {
        "servo.inertia": 0.004, "servo.motor_gain": 1.8, "controller.kp": 2.0, "controller.ki": 12.0,
        "controller.kd": 0.06, "friction.static": 0.22, "friction.coulomb": 0.16, "friction.viscous": 0.004,
    }  # fmt: skip
    words = [f"--set={key}={value!r}" for key, value in values.items()]
    assert cli.main(["fold", "--quiet", *words]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "up to 8.962 V/rad motions end in a cycle; from there to 9.306 V/rad swings that reach farther to one" in out
    verdicts = []
    for gain, amplitude in ((8.9, 0.000668), (9.2, 0.0006445)):
        assert cli.main(["simulate", "--quiet", "--json", *words, f"--gain={gain}",
                         f"--position={1 + amplitude}"]) == 0  # fmt: skip
        verdicts.append(json.loads(capsys.readouterr().out)["verdict"])
    assert verdicts == ["hunting", "at rest"]


@pytest.mark.slow
def test_what_tune_prints(capsys):
    """The margin is above the larger gain, that of any cycle."""
    words = ["tune", "--quiet", *(f"--set={key}={value!r}" for key, value in draw(2026, 2).items())]
    cli.main([*words, "--json"])
    record = json.loads(capsys.readouterr().out)
    check = record["verification"]
    assert check["stable"]["beyond"] == "none" and check["stable"]["gain"] < 0.95 * check["fold_gain"]
    assert record["gain"] >= 1.1 * check["fold_gain"] * (1 - 1e-6)
    cli.main([*words, "--details"])
    assert "a stable cycle up to gain 15.149" in " ".join(capsys.readouterr().out.split())
