"""The border between settling and hunting: against the reference amplitudes and by the Taylor engine."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from casahunt import InputError, NoOrbit, Options, Servo, cli
from casahunt.servo.basin import basin, stick_position, until_settled
from problems import table1
from problems.taylor import switch_half_cycle

UNSTABLE = {model: {row["K"]: row for row in table1.REFERENCE[model]["unstable"]} for model in ("switch", "lugre")}


@pytest.mark.parametrize("gain", [0.1, 0.4, 0.61])
def test_switch_border(gain):
    found = basin(Servo(), "switch", gain, options=Options(tol=1e-9))
    assert found.border == pytest.approx(UNSTABLE["switch"][gain]["amplitude"], rel=3e-9)
    assert found.confirmed and found.inside.start < found.border < found.outside.start
    for sign in (-1, 1):  # the first swing, by the independent engine
        a = found.border * (1 + sign * 0.01)
        assert (switch_half_cycle(Servo(), gain, a)[0] > a) == (sign > 0)


@pytest.mark.parametrize("gain", [0.1, 0.6])
def test_lugre_border(gain):
    """The unstable amplitude is the reference's; the stick position lies within 4 Fs/sigma0 of it."""
    found = basin(Servo(), "lugre", gain)
    assert found.unstable.amplitude == pytest.approx(UNSTABLE["lugre"][gain]["amplitude"], rel=2e-6)
    assert found.confirmed and 0 < found.unstable.amplitude - found.border < 4 * 0.53 / 2.2e4


def test_the_outer_motion_starts_half_way_to_the_outer_cycle():
    """Next to the fold both cycles are nearer to each other than the offset."""
    found = basin(Servo(), "switch", 0.64, offset=0.5)
    assert found.outer_position < 1.5 * found.border
    assert found.outside.start == pytest.approx((found.border + found.outer_position) / 2, rel=1e-12)
    assert found.inside.start == pytest.approx(0.5 * found.border, rel=1e-12) and found.confirmed


@pytest.mark.parametrize(
    ("P", "start", "stable", "hunting", "outcome"),
    [
        (lambda a: -a * (0.5 + a / 2), 0.99, True, 2.0, "settles"),
        (lambda a: -(2 + (a - 2) / 2), 1.01, True, 2.0, "hunts"),
        (lambda a: 1.5 * a, 1.01, True, math.nan, "grows"),
        (lambda a: 1.5 * a, 1.01, True, 2.0, "undecided"),
        (lambda a: 3.6 - a, 1.2, False, 2.0, "hunts"),  # the outer cycle is not stable, a lopsided one is
        (lambda a: 3.6 - a, 1.2, True, 2.0, "undecided"),
        (lambda a: 1.9 - a, 1.1, False, 2.0, "undecided"),  # it comes back inside
        (lambda a: a, 0.99, True, 2.0, "undecided"),
        (lambda a: math.nan, 0.99, True, 2.0, "undecided"),
    ],
)
def test_what_becomes_of_a_motion(monkeypatch, P, start, stable, hunting, outcome):
    """Maps made by hand; the border is at 1."""
    monkeypatch.setattr(sys.modules[basin.__module__], "map_at", lambda _, __, a: SimpleNamespace(position=P(a)))
    found = until_settled(Servo(), "switch", 0.1, start, 1.0, hunting, stable=stable, swings=40)
    assert found.outcome == outcome and found.positions[0] == start


def test_a_border_is_confirmed_from_both_sides():
    found = basin(Servo(), "switch", 0.4)
    for inside, outside, confirmed in (
        ("settles", "hunts", True), ("settles", "grows", True), ("settles", "settles", False),
        ("hunts", "hunts", False), ("undecided", "hunts", False), ("settles", "undecided", False),
    ):  # fmt: skip
        sides = {"inside": replace(found.inside, outcome=inside), "outside": replace(found.outside, outcome=outside)}
        assert replace(found, **sides).confirmed is confirmed


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_where_a_lugre_servo_is_stuck(side):
    """It creeps by 1e-3 rad/s while m comes up linearly: |x1| where m = 0.9 Fs, not where a slip passes that torque."""
    servo, t = Servo(), np.linspace(0, 1, 6)
    kp, kd, ki = servo.torque_gains(0.1)

    def stuck(creep, at):
        x1, m = -(0.02 - creep * t), (0.9 + 0.5 * (t - at)) * servo.friction.static
        v = np.where(t < 0.9, creep, 1.0)  # at the end it slips
        x = side * np.stack([x1, v, -(m + kp * x1 + kd * v) / ki, 0 * t])
        return SimpleNamespace(model="lugre", servo=servo, gain=0.1, sample=lambda: (t, x))

    assert stick_position(stuck(1e-3, 0.47)) == pytest.approx(0.02 - 0.47e-3, rel=1e-12)
    with pytest.raises(NoOrbit, match="does not stand still"):
        stick_position(stuck(0.02, 0.47))


def test_no_cycle_no_border(capsys):
    with pytest.raises(NoOrbit, match="no hunting limit cycle"):
        basin(Servo(), "switch", 0.7)
    with pytest.raises(InputError):
        basin(Servo(), "switch", 0.1, offset=0.9)
    assert cli.main(["basin", "--gain", "0.7"]) == 1
    assert cli.main(["basin"]) == 2
    capsys.readouterr()
    assert cli.main(["basin", "--gain", "0.6", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["confirmed"] and record["inside"]["outcome"] == "settles"
    assert cli.main(["basin", "--gain", "0.6", "--details"]) == 0 and "settles" in capsys.readouterr().out
