"""The PID servo of Canudas de Wit et al. (1995), complex zeros: its cycle at its own gains, by Taylor series."""

from __future__ import annotations

import pytest

from casahunt import Options, find_fold, find_orbit
from problems import canudas_servo
from problems.taylor import lugre_half_cycle, switch_cycle


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_the_cycle_at_the_gains_of_the_paper(model):
    found = find_orbit(canudas_servo.servo(), model, canudas_servo.GAIN, options=Options(tol=1e-9))
    expected = canudas_servo.REFERENCE[model]
    assert found.amplitude == pytest.approx(expected["amplitude"], rel=3e-10)
    assert found.period == pytest.approx(expected["period"], rel=3e-10)
    assert found.half_multiplier == pytest.approx(expected.get("mu", found.half_multiplier), abs=5e-5)


@pytest.mark.slow
def test_the_reference_values():
    """Computed again; the LuGre cycle from a start 1e-3 off in velocity."""
    amplitude, period = switch_cycle(canudas_servo.servo(), canudas_servo.GAIN, 0.067)
    assert amplitude == pytest.approx(canudas_servo.REFERENCE["switch"]["amplitude"], rel=1e-10)
    assert period == pytest.approx(canudas_servo.REFERENCE["switch"]["period"], rel=1e-9)
    x = find_orbit(canudas_servo.servo(), "lugre", canudas_servo.GAIN).sample()[1][:, 0] * [0, 1.001, 1, 1]
    periods, sign = [], 1
    for _ in range(10):
        x, half, largest = lugre_half_cycle(canudas_servo.servo(), canudas_servo.GAIN, sign * x)
        periods.append(2 * half)
        sign = -1
    reference = canudas_servo.REFERENCE["lugre"]
    assert periods[-1] == pytest.approx(reference["period"], rel=3e-11)
    assert largest == pytest.approx(reference["amplitude"], rel=1e-10)
    assert (periods[4] - periods[3]) / (periods[3] - periods[2]) == pytest.approx(reference["mu"], abs=1e-3)


@pytest.mark.slow
def test_its_fold_is_far_above():
    """It stops hunting above some 48 times the paper's gains: both models say so, and the gain scales all three."""
    folds = [find_fold(canudas_servo.servo(), model).gain for model in ("switch", "lugre")]
    assert folds[0] == pytest.approx(folds[1], rel=0.01)
    doubled = {"controller.kp": 6.0, "controller.ki": 8.0, "controller.kd": 12.0}
    scaled = canudas_servo.servo().replace(**doubled)
    assert find_fold(scaled, "switch").gain == pytest.approx(folds[0] / 2, rel=1e-6)
