"""A few of the random tasks of scripts/tuning.py, and whether its judges can tell right from wrong."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import Servo
from casahunt.tune import tune
from casahunt.tune_demands import Demands
from casahunt.uncertainty import Uncertainty
from problems import table1

pytest.importorskip("control")

from scripts import tuning

FOLD = table1.REFERENCE["switch"]["fold"]["K"]


def test_the_event_map_of_the_judge_knows_the_fold():
    row = tuning.row_of(Servo())[None]
    ratio = tuning.largest_ratio(np.repeat(row, 2, axis=0), FOLD * np.array([1 - 1e-3, 1 + 1e-3]))
    assert ratio[0] > 1 > ratio[1]


def test_the_loop_judge_sees_a_pole_and_a_margin():
    slow, fast = (tuning.row_of(Servo().replace(**{"servo.inertia": J})) for J in (0.026, 0.008))
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
