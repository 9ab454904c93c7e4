"""Up to which gain a stable cycle exists: against Taylor series, against problems/canudas_gain.py, and by motions."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from casahunt import NoOrbit, Servo, cli, find_fold, find_orbit, simulate
from casahunt.servo import stable_up_to as module
from casahunt.servo.stable_up_to import stable_ranges
from casahunt.views.answers.fold import hunts
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
    fold = find_fold(Servo(), model)
    ((low, high),) = stable_ranges(fold)
    assert low < high == fold.gain == pytest.approx(table1.REFERENCE[model]["fold"]["K"], rel=1e-6)
    assert hunts(fold, ((low, high),)) == "up to that gain motions end in a cycle"


def test_a_sharp_fold_has_none_that_a_servo_could_follow():
    """mu = -1 where the program says, by another engine; the fold is 5 % above."""
    fold = find_fold(SHARP, "switch")
    ((_, gain),) = stable_ranges(fold)
    assert gain < 0.95 * fold.gain
    a, _ = switch_cycle(SHARP, gain, find_orbit(SHARP, "switch", gain).amplitude)
    assert slope(SHARP, gain, a) == pytest.approx(-1, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "low", "high"), [(0.98, 0.985, 1.015), (1.02, 0.0, 0.5)])
def test_no_lopsided_cycle_takes_over_there(factor, low, high):
    """Below, motions beside the cycle come closer to it; above, where a pair would draw them, they come to rest."""
    gain = factor * stable_ranges(find_fold(SHARP, "switch"))[-1][1]
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
    fold = find_fold(canudas_servo.servo(), "lugre")
    found = stable_ranges(fold)
    edges = [gain for pair in found for gain in pair][1:]
    assert edges == pytest.approx([*canudas_gain.BREAKING, canudas_gain.FOLD], rel=2e-7) and edges[-1] == fold.gain
    said = "up to 48.02 V/rad, and from 48.44 V/rad to its fold, motions end in that cycle, elsewhere they may"
    assert hunts(fold, found).startswith(said)


@pytest.mark.slow
def test_a_pair_of_stable_lopsided_cycles():
    """The LuGre servo with the numbers of SHARP: beside the symmetric cycle swings settle to a longer and a shorter."""
    gain = 1.003 * stable_ranges(find_fold(SHARP, "lugre"))[-1][1]
    orbit = find_orbit(SHARP, "lugre", gain)
    x = orbit.sample()[1][:, 0]
    start = {"position": 1.01 * x[0], "velocity": 1.01 * x[1], "integral": x[2], "bristle": x[3], "set_point": 0.0}
    swings = simulate(SHARP, "lugre", gain, time=120 * orbit.period, tol=1e-5, **start).shape()[1][-9:-1]
    assert orbit.half_multiplier < -1 and abs(swings[0] / swings[1] - 1) > 1e-3
    assert swings[:-2] == pytest.approx(swings[2:], rel=2e-4)


def test_from_an_unstable_start_stable_cycles_are_found_farther_off():
    """The cycle that the search for the fold begins with has a half multiplier below -1."""
    servo = Servo().replace(**draw(777, 5))
    ((_, gain),) = stable_ranges(find_fold(servo, "switch"))
    a, _ = switch_cycle(servo, gain, find_orbit(servo, "switch", gain).amplitude)
    assert slope(servo, gain, a) == pytest.approx(-1, abs=1e-4)


def test_a_branch_that_turns_back_at_another_fold_does_not_tell():
    fold = find_fold(Servo(), "switch")
    assert stable_ranges(fold) and not stable_ranges(replace(fold, value=1.01 * fold.value))


@pytest.mark.parametrize("fails", ["find_any_orbit", "follow"])
def test_nothing_is_said_where_no_stable_cycle_leads_to_the_fold(monkeypatch, fails):
    """Patched: motions lead to the stable cycles of a servo that has some, and they are followed."""

    def none(*_, **__):
        raise NoOrbit("none")

    fold = find_fold(Servo(), "switch")
    monkeypatch.setattr(module, fails, none)
    assert stable_ranges(fold) == () and "up to which gain motions end in a cycle is not known" in hunts(fold, ())


def test_what_fold_prints(capsys):
    words = ["fold", "--quiet", *(f"--set={key}={value!r}" for key, value in draw(2026, 2).items())]
    assert cli.main([*words, "--details"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "goes up to gain 15.15 V/rad; its cycles go on, unstable, to their fold at 15.98 V/rad" in out
    assert "up to 15.15 V/rad motions end in that cycle" in out and "it hunts up to 15.1496" in out
    assert cli.main([*words, "--json"]) == 0
    stable = json.loads(capsys.readouterr().out)["stable"]
    assert stable["value"] == stable["ranges"][-1][1] < 15.15


def test_what_fold_prints_of_gains_in_between(capsys):
    """From 8.962 to 9.306 V/rad: simulated motions that start next to the cycle end in it below, and leave it there."""
    values = {
        "servo.inertia": 0.004, "servo.motor_gain": 1.8, "controller.kp": 2.0, "controller.ki": 12.0,
        "controller.kd": 0.06, "friction.static": 0.22, "friction.coulomb": 0.16, "friction.viscous": 0.004,
    }  # fmt: skip
    words = [f"--set={key}={value!r}" for key, value in values.items()]
    assert cli.main(["fold", "--quiet", *words]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "up to 8.962 V/rad, and from 9.306 V/rad to its fold, motions end in that cycle" in out
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
    assert check["stable"]["value"] < 0.95 * check["fold_gain"]
    assert record["gain"] >= 1.1 * check["fold_gain"] * (1 - 1e-6)
    cli.main([*words, "--details"])
    assert "it hunts up to 15.149" in " ".join(capsys.readouterr().out.split())
