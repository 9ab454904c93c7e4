"""The axes of the documentation, each asked as a user would: a gimbal, a ball screw in mm, a belt axis with its drive.

Truths: the report for Table 1; scipy's DOP853 with events for the others, whose cascade is a PID at a set point.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from belt_support import stops

from casahunt import Drive, find_orbit, load, margins, simulate_sampled
from casahunt.cli import main
from casahunt.servo.parts import load_loop

PROBLEMS = Path(__file__).parents[2] / "problems"
BELT = PROBLEMS / "belt_axis.toml"


def by_dop853(numbers: dict[str, float], start: float) -> tuple[float, float]:
    """(amplitude, period) in which the motor's stops end."""
    times, places = np.array(stops(numbers, start, 60)).T
    return float(np.abs(places[-2:]).max()), float(times[-1] - times[-3])


def test_the_belt_axis_hunts_as_an_integrator_has_it():
    loop = load_loop(BELT)
    Kp, Kv, Tn = (loop.value(name) for name in ("position_gain", "velocity_gain", "reset_time"))
    pid = {"kp": Kv * (Kp + 1 / Tn), "ki": Kv * Kp / Tn, "kd": Kv}
    cycle = find_orbit(loop)
    assert (cycle.amplitude, cycle.period) == pytest.approx(by_dop853(loop.parameters | pid, -3e-4), rel=1e-6)
    assert (cycle.amplitude, cycle.period) == pytest.approx((0.1506e-3, 0.8757), rel=1e-3)  # what the page says


def test_as_built_it_hunts_nearly_so():
    drive = Drive(sample_time=1e-3, encoder=2 * np.pi / 1e-6)
    seen = simulate_sampled(load_loop(BELT), drive=drive, time=20.0, set_point=0.0, position=1e-3).verdict
    assert seen.kind == "hunting" and seen.amplitude == pytest.approx(0.1506e-3, rel=0.05)
    assert 45 < margins(load_loop(BELT), drive=drive).phase_margin < 60


def test_the_page_shows_the_file():
    page = (PROBLEMS.parent / "docs" / "reference" / "servo_file.md").read_text(encoding="utf-8")
    shown = next(block for block in page.split("```toml")[1:] if "two masses" in block).partition("```")[0]
    assert tomllib.loads(shown) == tomllib.loads(BELT.read_text(encoding="utf-8"))


@pytest.mark.parametrize("file", ["table1.toml", "ball_screw.toml", "belt_axis.toml"])
@pytest.mark.parametrize("command", ["orbit", "fold", "loop"])
def test_every_axis_is_answered(file, command, capsys):
    gain = [] if file != "table1.toml" or command == "fold" else ["--gain", "0.04"]
    assert main([command, str(PROBLEMS / file), "--quiet", *gain]) == 0
    assert "mm" in (said := capsys.readouterr().out) or "um" in said or file == "table1.toml" or command == "loop"


def test_the_gimbal_is_the_report_s():
    """Hensen, van de Molengraft and Steinbuch, DCT 2001.021: hunting up to K = 0.647."""
    assert find_orbit(load(PROBLEMS / "table1.toml"), "switch", 0.04).stable
