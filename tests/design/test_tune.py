"""Tuning against folds computed apart and closed forms: the gain, a set, the controller's times."""

from __future__ import annotations

import json

import numpy as np
import pytest
from tuning import TIME

from casahunt import Options, find_fold
from casahunt.cli import main
from casahunt.design.tune.demands import Demands
from casahunt.design.tune.tuning import tune
from casahunt.design.uncertainty.set import Uncertainty
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.margins import margins
from problems import table1


def test_table_1_with_ten_per_cent(plain):
    reference = table1.REFERENCE["switch"]["fold"]["K"]
    assert plain.gain == pytest.approx(1.1 * reference, rel=1e-9)
    assert plain.gain >= 1.1 * plain.fold_gain  # never below its bound
    assert plain.binding == ("hunting margin",)
    assert plain.verification.ok and plain.status.ok
    assert plain.verification.scan_clear
    assert [task.motion.verdict.kind for task in plain.verification.tasks] == ["at rest"] * 3


def test_a_larger_phase_margin_takes_over(unscanned, servo):
    found = tune(servo, "switch", demands=Demands(phase_margin=85))
    assert found.binding == ("phase margin",)
    loop = linear_loop(servo, found.gain)
    assert loop.gain_crossovers[0].margin == pytest.approx(85, abs=1e-6)


def test_the_worst_friction_of_a_set_counts(unscanned, servo):
    # The fold rises with static and falls with Coulomb friction (signs of the elasticities).
    box = {"friction.static": (0.525, 0.535), "friction.coulomb": (0.438, 0.442)}
    found = tune(servo, "switch", uncertainty=Uncertainty(box))
    worst = find_fold(servo.replace(**{"friction.static": 0.535, "friction.coulomb": 0.438}), "switch")
    assert found.gain == pytest.approx(1.1 * worst.gain, rel=1e-6)
    assert found.corner == pytest.approx({"friction.static": 0.535, "friction.coulomb": 0.438})
    assert found.verification.ok
    assert {task.friction for task in found.verification.tasks} == {"nominal", "worst"}


# Controller times


@pytest.mark.slow
def test_a_longer_lead_lowers_the_gain_to_its_bound(unscanned, servo):
    found = tune(servo, "switch", free=["lead_time"], bounds={"lead_time": (0.15, 0.18)}, options=Options(tol=1e-8))
    # Swapping the times leaves the motion alone with K/tau_i fixed: another servo's fold gives the answer.
    swapped = servo.replace(**{"controller.lead_time": TIME, "controller.integral_time": 0.18})
    expected = 1.1 * find_fold(swapped, "switch", options=Options(tol=1e-8)).gain * TIME / 0.18
    assert found.servo.controller.lead_time == pytest.approx(0.18, rel=1e-6)
    assert found.gain == pytest.approx(expected, rel=1e-6)
    assert found.gain_only is not None and found.cost_value < found.gain_only
    assert found.binding == ("hunting margin", "upper bound of lead_time")


@pytest.mark.slow
@pytest.mark.parametrize("cost", ["gain", "high-frequency", "settling"])
def test_freed_times_never_cost_more(unscanned, servo, cost):
    found = tune(
        servo, "switch", cost=cost, free=["lead_time", "integral_time"], demands=Demands(delay=0.002, phase_margin=50)
    )
    assert found.gain_only is not None and found.cost_value <= found.gain_only
    assert found.verification.ok
    assert margins(found.servo, found.gain, delay=0.002).phase_margin >= 50 - 1e-3


@pytest.mark.slow
def test_no_point_of_a_grid_is_better(unscanned, servo):
    lead, integral = (0.14, 0.18), (0.15, 0.19)
    found = tune(
        servo, "switch", cost="high-frequency", free=["lead_time", "integral_time"],
        bounds={"lead_time": lead, "integral_time": integral},
    )  # fmt: skip
    for a in np.linspace(*lead, 4):
        for b in np.linspace(*integral, 4):
            other = servo.replace(**{"controller.lead_time": float(a), "controller.integral_time": float(b)})
            assert found.cost_value <= 1.1 * find_fold(other, "switch").gain * a * (1 + 1e-6)


@pytest.mark.slow
def test_lugre(servo):
    found = tune(servo, "lugre", free=["lead_time"], bounds={"lead_time": (0.15, 0.18)})
    expected = find_fold(servo.replace(**{"controller.lead_time": 0.18}), "lugre").gain
    assert found.gain == pytest.approx(1.1 * expected, rel=1e-5)
    assert found.verification.ok


def test_json(unscanned, capsys):
    assert main(["tune", "--json", "--quiet"]) == 0
    record = json.loads(capsys.readouterr().out)
    for key in ("model", "gain", "lead_time", "integral_time", "cost", "fold_gain", "margin", "worst", "binding",
                "verification", "status", "wall_s"):  # fmt: skip
        assert key in record
    assert record["status"] == "converged"
