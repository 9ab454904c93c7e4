"""Tuning a controller by gains: as by times where they are the same, complex zeros against folds and margins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import InputError, Options, Pid, find_fold
from casahunt.design.tune.demands import Demands, log_numbers
from casahunt.design.tune.problem import Cut, Round, solve_round
from casahunt.design.tune.tuning import tune
from casahunt.servo.linear.margins import margins
from casahunt.servo.linear.sampled_loop import Lag


@pytest.mark.slow
def test_both_forms_of_a_controller_are_tuned_alike(unscanned, servo):
    """The same demands bind at the same gain; freed, kd goes to its bound, where that servo's fold gives the answer."""
    same = replace(servo, controller=servo.controller.pid())
    demands = Demands(delay=0.005, phase_margin=45)
    for cost, bounds in (("gain", {}), ("settling", {"gain": (0.5, 5.0)})):
        a, b = (tune(s, "switch", cost=cost, demands=demands, bounds=bounds) for s in (servo, same))
        assert b.gain == pytest.approx(a.gain, rel=1e-9) and a.binding == b.binding
    found = tune(same, "switch", free=["kd"], bounds={"kd": (0.15, 0.2)}, options=Options(tol=1e-8))
    fold = find_fold(same.replace(**{"controller.kd": 0.2}), "switch", options=Options(tol=1e-8))
    assert found.servo.controller.kd == pytest.approx(0.2, rel=1e-9)
    assert found.gain == pytest.approx(1.1 * fold.gain, rel=1e-6)
    assert found.binding == ("hunting margin", "upper bound of kd") and found.verification.ok


def test_a_problem_without_folds_in_both_forms(servo):
    """Settling and high-frequency gain against a gain margin and the decay of the slowest pole, numbers held."""
    other = replace(servo, controller=servo.controller.pid())
    tasks = ("settling", "gain margin (raising)", 3.0, 0.005), ("high-frequency", "phase margin", 1.0, 0.0)
    for cost, demand, off, lag in tasks:
        found = []
        for each in (servo, other):
            q = log_numbers(each)
            cut = Cut(each.replace(**{"servo.motor_gain": off * each.motor_gain}), demand, 0.5)
            point = solve_round(Round(each, cost, q, math.log(0.5), q, q, (0.01, 100.0), 1.1, [], [cut], Lag(lag)))
            assert point.converged and np.max(point.slack) < 1e-9
            found.append(point.k)
        assert found[1] == pytest.approx(found[0], abs=1e-6)
    # Settling alone, where no margin is in the way: the gain at which the slowest poles of chi decay fastest.
    q = log_numbers(other)
    point = solve_round(Round(other, "settling", q, math.log(0.5), q, q, (0.01, 1.0), 1.1, [], [], Lag(), math.inf))
    rates = {k: -np.roots([0.026, k * 16 * other.controller.kd + 0.1, k * 32, k * 16 * other.controller.ki]).real.max()
             for k in np.geomspace(0.01, 1.0, 2001).tolist()}  # fmt: skip
    assert math.exp(point.k) == pytest.approx(max(rates, key=rates.__getitem__), rel=5e-3)


@pytest.mark.slow
def test_two_gains_with_complex_zeros(unscanned, servo):
    """High-frequency gain with a phase margin over (ki, kd) with kp' = 1, against a grid of folds and margins.

    At a place of the grid the gain is the least that keeps both demands, if there is one.
    """
    pid = replace(servo, controller=Pid(kp=1.0, ki=6.0, kd=0.15))  # complex zeros
    demands = Demands(delay=0.004, phase_margin=50)
    ranges = {"ki": (4.0, 8.0), "kd": (0.1, 0.2)}
    found = tune(pid, "switch", cost="high-frequency", free=["ki", "kd"], bounds=ranges, demands=demands)
    assert found.verification.ok
    best = math.inf
    for ki in np.linspace(4, 8, 3):
        for kd in np.linspace(0.1, 0.2, 5):
            other = pid.replace(**{"controller.ki": float(ki), "controller.kd": float(kd)})
            gain = 1.1 * find_fold(other, "switch").gain
            while margins(other, gain, delay=0.004).phase_margin < 50 and gain < 5:
                gain *= 1.01
            if gain < 5 and margins(other, gain, delay=0.004).lowest_factor <= 0.5:
                best = min(best, gain * kd)
    assert best * 0.9 < found.cost_value <= best * (1 + 1e-6)


def test_three_gains_are_one_too_many(servo):
    pid = replace(servo, controller=servo.controller.pid())
    with pytest.raises(InputError, match="free kp, ki, kd: must leave one out, because the gain multiplies all three"):
        tune(pid, "switch", free=["kp", "ki", "kd"])
    with pytest.raises(InputError, match="unknown free 'lead_time'"):
        tune(pid, "switch", free=["lead_time"])
    with pytest.raises(InputError, match="controller.kd = 0: must be greater than 0 to tune"):
        tune(pid.replace(**{"controller.kd": 0.0}), "switch")
