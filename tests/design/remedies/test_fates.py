"""What becomes of motions: those that creep to the set point, take too long to follow, or outgrow what was before."""

import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import Friction, Pid, Servo, Uncertainty, effort, find_orbit, remedies
from casahunt.design.remedies import border, price
from casahunt.design.remedies import remedies as table
from casahunt.servo.parts.plain_loop import loop_of
from casahunt.servo.parts.table import remedy_of

CREEPS = Servo(
    inertia=0.0049, motor_gain=13.6, controller=Pid(kp=1.6, ki=0.018, kd=0.3),
    friction=Friction(static=0.1044, coulomb=0.0538, stribeck_velocity=0.0092, viscous=0.63),
)  # fmt: skip
"""With so little integral action that its motions creep to the set point for minutes."""


def test_a_motion_that_creeps_to_the_set_point_is_over_there():
    """What follows is rounding: two looks at most are as long as a motion takes, from wherever it starts; without the
    rule the work of some of them is ten times as large."""
    loop = loop_of(CREEPS, "switch", 0.0182)
    for start in (0.5, 0.8, 1.0, 1.25, 2.0, 3.0):
        for size in (0.017, 0.018, 0.0185):
            with effort.counting_work(None, limit=1e9) as spent:
                seen = price.fate(loop.replace(ki=size), loop.at_rest(-0.0476 * start), 0.0476, 1409.0)
            assert seen.verdict in price.ENDED and spent.work < 12000, (start, size)


def test_a_look_that_takes_too_long_is_a_shorter_one(monkeypatch):
    """Until it is as short as it may be: then the motion is undecided, and taken to hunt by who hands it on."""
    servo = Servo()
    cycle, loop = find_orbit(servo, "switch", 0.1), loop_of(servo, "switch", 0.1)
    lengths = []

    def motion(loop, length, **how):
        lengths.append(length)
        effort.problem(10)

    monkeypatch.setattr(price, "loop_motion", motion)
    monkeypatch.setattr(price, "MOST_WORK_OF_A_LOOK", 5)
    assert price.fate(loop, loop.at_rest(-0.1), cycle.amplitude, cycle.period).verdict == "undecided"
    assert np.allclose(np.divide(lengths[1:], lengths[:-1]), 0.5)
    assert lengths[0] == 2 * cycle.period and lengths[-1] < 3 * price.SHORTEST_LOOK * lengths[0]
    before = border.Swing(loop.at_rest(-0.1), cycle.amplitude, cycle.period)
    assert border._hunting(loop, before, (1.0,)) is before


def test_a_cycle_that_is_much_larger_than_before_is_hunting():
    """As next to the border of a servo the cycle of a worse one is: to a verdict on a remedy it grows."""
    servo = Servo()
    cycle, loop = find_orbit(servo, "switch", 0.1), loop_of(servo, "switch", 0.1)
    small = border.Swing(loop.at_rest(-0.25 * cycle.amplitude), cycle.amplitude / 10, cycle.period)
    seen = border._hunting(loop, small, (1.0,))
    assert seen is not small and seen.amplitude == pytest.approx(cycle.amplitude, rel=0.01)
    grows = price.fate(loop, loop.at_rest(-0.25 * cycle.amplitude), cycle.amplitude / 10, cycle.period)
    assert grows.verdict == "grows"


@pytest.mark.parametrize(("times", "known"), [(10.0, True), (1.001, False)])
def test_the_worst_servo_may_need_so_much_more(monkeypatch, times, known):
    """Ten times the size of the servo as given are looked at; what is beyond is told as not found."""
    monkeypatch.setattr(table, "MOST_FOR_THE_WORST", times)
    uncertain = Uncertainty({"friction.static": (0.53, 0.55)})
    (row,) = remedies(Servo(), "switch", 0.1, only=["dead band"], uncertainty=uncertain).remedies
    assert math.isfinite(row.worst_size) == known and row.ends_hunting


def test_corners_that_are_no_servo_are_left_out(monkeypatch):
    """The worst servo of a set is one with static above Coulomb friction; slopes may point to another one."""
    set_ = Uncertainty({"friction.static": (0.42, 0.53), "friction.coulomb": (0.40, 0.46)})
    loop, seen = loop_of(Servo(), "switch", 0.1), []
    asked = table._Asked(loop, "switch", None, {}, None, (Servo(), set_), 0.1)
    found = border.Border("motions", 0.1, 0.0, None, None, {}, swing=border.Swing({}, 1.0, 1.0))

    def looked_at(at, *more):
        seen.append((at.value("static"), at.value("coulomb")))
        return 0.2, found.swing

    monkeypatch.setattr(table, "end_of_motions", looked_at)
    leak = remedy_of("leak", "switch")
    monkeypatch.setattr(border.Scales, "of", lambda *given: 1.0)
    monkeypatch.setattr(table._Asked, "scales", border.Scales(1.0, 1.0))
    assert table._worst(asked, leak, found) == 0.2
    assert seen == [(0.42, 0.40), (0.53, 0.40), (0.53, 0.46)]
    slopes = replace(found, kind="fold", moves={"static": -1.0, "coulomb": 1.0})
    monkeypatch.setattr(table, "border", lambda *given: replace(slopes, size=0.3, moves={}))
    assert math.isnan(table._worst(asked, leak, slopes))
    assert table._worst(asked, leak, replace(slopes, moves={"static": 1.0, "coulomb": -1.0})) == 0.3
