"""A few of the random tasks of scripts/tuning.py, and whether its judges can tell right from wrong."""

from __future__ import annotations

import numpy as np
import pytest
from peer_support import needs

from casahunt import Servo
from casahunt.design.tune.demands import Demands
from casahunt.design.tune.tuning import tune
from casahunt.design.uncertainty.set import Uncertainty
from problems import table1
from scripts import tuning
from scripts.peers.stick_map import Hunts, largest_ratio, row_of, stick_ratio
from scripts.peers.switch_digits import SwitchMap

needs("control")
needs("heyoka")

FOLD = table1.REFERENCE["switch"]["fold"]["K"]


def test_the_event_map_of_the_judge_knows_the_fold():
    row = row_of(Servo())[None]
    below, above = (largest_ratio(row, FOLD * (1 + part))[0] for part in (-1e-4, 1e-4))
    assert below > 1 > above
    hunts = Hunts()
    assert hunts(row, FOLD * (1 - 1e-4)) and not hunts(row, FOLD * (1 + 1e-4)) and hunts(row, 0.3 * FOLD)


@pytest.mark.parametrize(
    "task, gain, units",
    [
        (502, 8.6e-4, 0.008),  # it creeps to its set point, and is then driven past it by the integral
        pytest.param(502, 8.6e-6, 6e-4, marks=pytest.mark.slow),
        (512, 0.92, 3e-4),
        # it reverses a dozen times before it sticks
        pytest.param(507, 1.7e-4, 1.6, marks=pytest.mark.slow),
        (502, 8.6e-3, 9.0),  # from far above the Stribeck velocity
    ],
)
def test_the_event_map_of_the_judge_in_decimal_arithmetic(task, gain, units):
    """Taylor series in doubles are good to some 1e-12; at 8.6e-6 the slip magnifies its start 8 times."""
    servo, _ = tuning.random_task(task)
    row = row_of(servo)
    a = units * servo.friction.static / servo.torque_gains(gain)[0]
    truth = abs(float(SwitchMap(servo, gain, 22).half(a).position))
    assert stick_ratio(row, gain, a) * a == pytest.approx(truth, rel=1e-9)


def test_a_slip_that_only_creeps_to_its_set_point_has_no_swing():
    """Far above the fold every pole of the slip is real: x1 tends to 0 from one side, in closed form without a stop."""
    servo, _ = tuning.random_task(502)
    gain = 8.6
    kp, kd, ki = servo.torque_gains(gain)
    poles = np.roots([servo.inertia, kd + servo.friction.viscous, kp, ki])
    assert np.all(poles.imag == 0) and np.all(poles.real < 0)
    assert stick_ratio(row_of(servo), gain, servo.friction.static / kp) == 0.0


def test_a_slip_that_creeps_onto_its_set_point_is_followed_to_its_end():
    """Ten fold gains: every motion stops at the set point to rounding, the torque being Fs but for the last digit."""
    row = np.array([
        0.12403131979765544, 1.9805829914128932, 0.049815533087248086, 0.12751686526427994, 0.10159275269823816,
        0.0514265195985105, 0.04042218005192416, 0.34532947296876604,
    ])  # fmt: skip
    assert largest_ratio(row[None], 44.986315593926044, rounds=1)[0] < 1e-9


def test_the_grid_search_finds_a_gain_where_there_is_one():
    """Table 1 without uncertainty: any gain from 1.1 fold gains on keeps 30 degrees; not so with a lag of 0.1 s."""
    uncertainty = Uncertainty({"friction.static": (0.529, 0.53)})
    task = {"demands": Demands(margin=0.1, phase_margin=30), "uncertainty": uncertainty, "free": [], "cost": "gain"}
    assert "gain" in tuning.grid_search(Servo(), task, 0, 3)
    late = task | {"demands": Demands(margin=0.1, phase_margin=30, delay=0.1)}
    assert tuning.grid_search(Servo(), late, 0, 3) == ""
    assert "lead_time" in tuning.grid_search(Servo(), task | {"free": ["lead_time"]}, 0, 3)


def test_the_loop_judge_sees_a_pole_and_a_margin():
    slow, fast = (row_of(Servo().replace(**{"servo.inertia": J})) for J in (0.026, 0.008))
    demands = Demands(delay=0.008, phase_margin=30, gain_margin=1)
    assert any("unstable" in fault for fault in tuning.loop_faults(fast, 0.71207, demands))
    assert tuning.loop_faults(slow, 0.3, demands) == []
    assert any("pole crosses" in fault for fault in tuning.loop_faults(slow, 0.5, Demands(delay=0.008, gain_margin=5)))


@pytest.mark.slow
def test_the_judge_finds_an_answer_for_the_nominal_servo_wrong():
    """The gain for the nominal friction, put to the set."""
    found = tune(Servo(), "switch", uncertainty=Uncertainty({"friction.static": (0.53, 0.5301)}))
    wider = Uncertainty({"friction.static": (0.52, 0.54)})
    object.__setattr__(found, "uncertainty", wider)
    assert any("hunts" in fault for fault in tuning.judge_answer(found, 0, 5))


@pytest.mark.slow
@pytest.mark.parametrize("task", [5, 6])
def test_random_tasks_are_right_by_other_engines(task):
    result = tuning.one(task, True, 0)
    assert result["outcome"] in ("verified", "infeasible"), result
