"""The cycle that a motion which rests has not come to, against Taylor series; and what the command says of it."""

from __future__ import annotations

import json
import math

import pytest

from casahunt import NoOrbit, Servo, Status, cli, effort, simulate
from casahunt.servo import other_end as module
from casahunt.servo.other_end import other_end
from casahunt.views.answers.simulate import elsewhere
from problems import table1
from problems.taylor import switch_cycle, switch_half_cycle

NEAR = 0.9995
"""A start [rad] from which Table 1 comes to rest at K = 0.5: the unstable cycle has 1.2 mrad, the stable one 2.3."""


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_servo_that_rests_may_hunt_from_elsewhere(model):
    motion = simulate(Servo(), model, 0.5, position=NEAR)
    assert motion.verdict.kind == "at rest"
    found = other_end(motion)
    assert found.hunts and not found.none and found.orbit.stable
    a = 1 - found.start["position"]
    if model == "switch":
        amplitude, period = switch_cycle(Servo(), 0.5, 0.0023)
        assert found.orbit.amplitude == pytest.approx(amplitude, rel=1e-6)
        assert found.orbit.period == pytest.approx(period, rel=1e-6)
        for _ in range(8):  # where the start leads, by another engine
            a = abs(switch_half_cycle(Servo(), 0.5, a)[0])
        assert a == pytest.approx(amplitude, rel=2e-3)  # from 1.4e-2 off, a factor of 0.66 each time
    again = simulate(Servo(), model, 0.5, **{**found.start, "time": 2 * found.start["time"]})
    assert again.verdict.kind == "hunting"
    assert again.verdict.amplitude == pytest.approx(found.orbit.amplitude, rel=1e-3)
    assert other_end(again) is None  # its verdict names its end


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_above_the_fold_there_is_no_other_end(model):
    found = other_end(simulate(Servo(), model, 0.7, position=NEAR))
    assert found.none and not found.hunts and found.orbit is None
    assert f"{table1.REFERENCE[model]['fold']['K']:.6f}"[:7] in found.reason


def test_a_start_with_an_integral():
    """Beyond Fs/kp a servo without an integral does not stick: the start is given one that holds it."""
    servo = Servo().replace(**{"friction.stribeck_velocity": 0.5, "friction.viscous": 0.0})
    motion = simulate(servo, "switch", 0.04, set_point=0.0, position=1e-9)
    start = module._stuck(servo, 0.04, motion.set_point, 2 * servo.friction.static / servo.torque_gains(0.04)[0], 4)
    kp, _, ki = servo.torque_gains(0.04)
    torque = -(kp * start["position"] + ki * start["integral"])
    assert start["integral"] > 0 and abs(torque) == pytest.approx(0.9 * servo.friction.static, rel=1e-3)


@pytest.mark.slow
def test_a_cycle_that_motions_leave_is_no_end():
    """Past the symmetry breaking of Canudas' servo (problems/canudas.toml): K = 46.61 to 48.58, Switch."""
    from problems import canudas_servo

    motion = simulate(canudas_servo.servo(), "switch", 47.0, time=40.0, tol=1e-4)
    found = other_end(motion)
    assert motion.verdict.kind == "decaying" and found.orbit.half_multiplier < -1 and not found.hunts
    assert "no motion was found that stays beside it" in elsewhere(found, 100.0)


def test_only_a_motion_shows_that_a_start_hunts(monkeypatch):
    """Where every start that is tried rests, none is named."""
    motion = simulate(Servo(), "switch", 0.5, position=NEAR)
    monkeypatch.setattr(module, "simulate", lambda *_, **__: motion)
    found = other_end(motion)
    assert found.orbit.stable and not found.hunts and found.start == {}


def test_what_the_command_says(capsys):
    words = ["simulate", "--gain", "0.5", "--position", str(NEAR), "--quiet"]
    assert cli.main(words) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "at rest, but not from every start" in out
    assert "let go at rest with --position 0.9977 it hunts: it ends in a stable cycle of amplitude 0.002333" in out
    assert cli.main([*words, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "at rest" and said["other_end_reason"] is None
    assert said["other_end"]["start"] == {"position": 0.9977, "integral": 0.0, "time": 100.0}
    assert math.isclose(said["other_end"]["amplitude"], switch_cycle(Servo(), 0.5, 0.0023)[0], rel_tol=1e-6)
    assert cli.main(["simulate", "--gain", "0.9", "--quiet"]) == 0
    out = capsys.readouterr().out
    assert "at rest\n" in out and "at this gain there is no hunting cycle to end in" in " ".join(out.split())


@pytest.mark.parametrize("trouble", [NoOrbit("not met", Status.NOT_FOUND), effort.GivenUp("given up")], ids=type)
def test_not_found_is_not_none(capsys, monkeypatch, trouble):
    def fails(*_, **__):
        raise trouble

    monkeypatch.setattr(module, "find_orbit", fails)
    assert cli.main(["simulate", "--gain", "0.5", "--position", str(NEAR), "--quiet"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "0.5 V/rad, from 0.9995 rad to set point 1 rad, 100 s: at rest because" in out
    assert "whether there is a hunting cycle at this gain is not known" in out
