"""The largest exponent of hunting: of cycles by their multipliers, of a belt by a C program of its own (axis.c)."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest

from casahunt import Servo
from casahunt.errors import HuntsIrregularly, Status
from casahunt.servo.parts import (
    INTEGRATOR,
    LOAD_SWITCH,
    PID_BY_GAINS,
    PID_BY_TIMES,
    SWITCH,
    TWO_MASSES,
    Loop,
    exponent,
    loop_of,
)
from casahunt.servo.parts.ahead import measured
from casahunt.servo.parts.exponent import in_words, largest_exponent
from casahunt.servo.parts.fate import Swing, fate
from casahunt.servo.parts.verbs import loop_cycle
from scripts.axes import Axis
from scripts.peers.axis_motion import NAMES, AxisMotion

BELT = {
    "inertia": 4e-4, "load_inertia": 1.6e-3, "shaft_stiffness": 60.0, "shaft_damping": 0.01, "motor_gain": 1.0,
    "kp": 2.0, "ki": 12.0, "kd": 0.06, "gain": 0.5, "static": 0.25, "coulomb": 0.18, "stribeck_velocity": 0.05,
    "viscous": 0.002,
}  # fmt: skip


@pytest.mark.parametrize("loop", [loop_of(Servo(), "switch", 0.04), loop_of(Servo(), "switch", 0.6), Axis(41, 7).loop])
def test_of_a_stable_cycle_it_is_that_of_its_leading_multiplier(loop):
    cycle = loop_cycle(loop)
    found, error = largest_exponent(loop, Swing.of(cycle), 24)
    period = cycle.period / (2 if cycle.half else 1)
    assert found == pytest.approx(math.log(abs(cycle.multipliers.leading)) / period, rel=1e-3)
    assert error < 1e-3 * abs(found) and "dies out" in in_words((found, error))


def in_c(stops):
    """The exponent of the belt's motion and its standard error by another program, each stop taken from its state."""
    n = dict.fromkeys(NAMES, 0.0) | {"M": 1e300, "J": 4e-4, "JL": 1.6e-3, "k": 60.0, "d": 0.01, "vs": 0.05}
    n |= {name: BELT["gain"] * BELT[name] for name in ("kp", "ki", "kd")}
    for back in ("", "_back"):
        n |= {f"Fs{back}": 0.25, f"Fc{back}": 0.18, f"b{back}": 0.002}
    n["longest_step"] = 3 / np.sqrt(60 * (1 / 4e-4 + 1 / 1.6e-3))
    motion = AxisMotion(n, np.array([-1.0, 0, 0, -1.0, 0, 0, 0, 0]), 0.25 / n["kp"], 1e-12)
    motion.on(100, 1e4)
    size, aside, grown = np.where(motion.y, np.abs(motion.y), 0.0), np.random.default_rng(1).random(8), []
    for _ in range(stops):
        other = AxisMotion(n, motion.y, 0.25 / n["kp"], 1e-12)
        other.sign, other.at, other.time, other.size = (
            type(x)(x.value) if hasattr(x, "value") else x.copy()
            for x in (motion.sign, motion.at, motion.time, motion.size)
        )
        aside[1] = 0.0  # stuck
        other.y = motion.y + 1e-7 * size * aside / np.linalg.norm(aside)
        began = motion.time.value
        (here,), (there,) = motion.on(1, 1e6), other.on(1, 1e6)
        aside = (there[1:9] - here[1:9]) / np.where(size > 0, size, 1.0)
        if (far := np.linalg.norm(aside)) < 1e-2:
            grown.append((math.log(far / 1e-7), motion.time.value - began))
    growth, lasted = np.array([part.sum(axis=0) for part in np.array_split(grown[20:], 8)]).T
    return growth.sum() / lasted.sum(), np.std(growth / lasted, ddof=1) / math.sqrt(8)


@pytest.mark.skipif(shutil.which("cc") is None, reason="cc is not installed")
def test_of_irregular_hunting_it_is_positive_and_that_of_another_program():
    loop = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), BELT)
    with pytest.raises(HuntsIrregularly) as refusal:
        loop_cycle(loop)
    (found, error), (other, known) = refusal.value.exponent, in_c(260)
    assert found > 3 * error and other > 3 * known
    assert abs(found - other) <= 3 * math.hypot(error, known)
    assert f"grows e-fold every {1 / found:.3g} s" in in_words((found, error))


@pytest.mark.parametrize("beside", [1e-5, 1e-7])
def test_it_is_that_of_any_small_difference_also_where_the_load_sticks(monkeypatch, beside):
    """Of a load with friction of its own: what is stuck stays so beside, whatever the size of the difference."""
    loop = Loop((TWO_MASSES, SWITCH, LOAD_SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.04, "shaft_damping": 0.05})
    swing = fate(loop, loop.at_rest(-1.0), measured(loop, loop.at_rest(-1.0), 1.0)).swing
    known = largest_exponent(loop, swing, 60)
    monkeypatch.setattr(exponent, "BEGINS_BESIDE", beside)
    assert largest_exponent(loop, swing, 60) == pytest.approx(known, rel=0.05)


def test_what_is_not_known_is_not_said():
    none = HuntsIrregularly("it hunts irregularly", Status.NOT_FOUND, amplitude=(0.1, 0.2), between=(1.0, 3.0)).exponent
    assert np.isnan(none).all() and in_words(none) == ""
    assert "was not seen" in in_words((0.1, 0.2))
