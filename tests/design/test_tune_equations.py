"""The equations of a tuning: folds as constraints, margins with delay, gain margins, sets of loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tuning import TIME, crossover_phase

from casahunt import Drive, Servo, find_fold
from casahunt.continuation import FoldConstraints
from casahunt.design.tune.demands import Demands, log_numbers
from casahunt.design.tune.problem import Cut, Round, solve_round
from casahunt.design.tune.tuning import tune
from casahunt.design.uncertainty.set import Uncertainty
from casahunt.errors import NoOrbit
from casahunt.orbits.orbit import unknowns_of
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.margins import margins
from casahunt.servo.linear.sampled_loop import Lag
from problems import table1


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_fold_conditions_hold_at_a_fold_and_their_jacobian_is_the_derivative(servo, model):
    fold = find_fold(servo, model)
    t, u, _ = unknowns_of(fold.orbit)
    conditions = FoldConstraints.of(fold, servo.controller_names)
    q = np.log([servo.controller.lead_time, servo.controller.integral_time])
    x = np.concatenate([q, u, [0.0], conditions.n])

    def value(x):
        z = x[2 : 3 + t.size]
        return np.array(conditions.equations(x[:2], z, x[3 + t.size :])).ravel()

    held = value(x)
    assert np.max(np.abs(held[:-1])) < 1e-8  # residual of the orbit and of its adjoint
    assert held[-1] == pytest.approx(1.0, abs=1e-8)
    v, h = np.random.default_rng(1).normal(size=x.size), 1e-6
    difference = (value(x + h * v) - value(x - h * v)) / (2 * h)
    z = x[2 : 3 + t.size]
    exact = np.array(conditions.jacobian(x[:2], z, x[3 + t.size :])) @ v
    # h^2 of a third derivative, and eps/h of the values
    assert np.max(np.abs(difference - exact)) < 1e-9 * np.max(np.abs(exact)) + 1e-7


def test_margins_without_delay_are_those_of_the_linear_loop(servo):
    steep = servo.replace(**{"friction.viscous": 0.01})  # with a lower limit of the gain
    for each, gain in ((servo, 0.7), (steep, 0.04), (steep, 2.0)):
        ours, theirs = margins(each, gain), linear_loop(each, gain)
        assert ours.frequency == pytest.approx(theirs.gain_crossovers[0].frequency, rel=1e-9)
        assert ours.phase_margin == pytest.approx(theirs.gain_crossovers[0].margin, abs=1e-7)
        assert ours.stable == theirs.stable
        assert ours.lowest_factor == pytest.approx(theirs.lowest_factor, rel=1e-9)
        assert ours.highest_factor == theirs.highest_factor == math.inf


def test_margins_with_delay(servo):
    free, late = margins(servo, 0.7), margins(servo, 0.7, delay=0.004)
    assert late.phase_margin == pytest.approx(free.phase_margin - math.degrees(free.frequency * 0.004), abs=1e-9)
    # At the largest gain the loop is just stable: no phase margin is left.
    edge = margins(servo, 0.7 * late.highest_factor * (1 - 1e-9), delay=0.004)
    assert 0 < edge.phase_margin < 1e-6
    assert not margins(servo, 0.7 * late.highest_factor * 1.001, delay=0.004).stable


@pytest.mark.parametrize("drive, free", [
    (Drive(sample_time=0.004), ()),
    pytest.param(Drive(sample_time=0.003, delay=0.003, integration="trapezoid"), (), marks=pytest.mark.slow),
    pytest.param(Drive(sample_time=0.004), ("lead_time",), marks=pytest.mark.slow),
])  # fmt: skip
def test_a_tuning_has_the_phase_of_the_sampled_loop(unscanned, servo, drive, free):
    """Settling wants all the gain that the phase margin leaves; without samples there would be no limit."""
    asked = 50
    found = tune(
        servo, "switch", cost="settling", demands=Demands(phase_margin=asked, drive=drive), free=free,
        bounds={"gain": (0.5, 20)},
    )  # fmt: skip
    assert "phase margin" in found.binding and found.verification.loops_kept
    exact = margins(found.servo, found.gain, drive=drive)
    assert exact.phase_margin == pytest.approx(asked, abs=1e-2)
    assert found.verification.loops["nominal"] == exact


@pytest.mark.parametrize("factor", [1.5, 3.0])
def test_gain_margins_of_one_problem(servo, factor):
    """No phase margin, no fold: K is a factor from where the loop gets unstable, at the times as given."""
    J, cm, T, f = servo.inertia, servo.motor_gain, TIME, factor

    def gain_of(each: Servo, cost: str, demand: str, off: float, lag: float) -> float:
        q = log_numbers(each)
        cut = Cut(each.replace(**{"servo.motor_gain": off * cm}), demand, 0.0)
        point = solve_round(Round(each, cost, q, math.log(0.5), q, q, (1e-3, 100.0), 1.1, [], [cut], Lag(lag)))
        assert point.converged and np.max(point.slack) < 1e-9
        return math.exp(point.k)

    # The Routh-Hurwitz condition K cm tau_d + sigma2 > J/(tau_d + tau_i), in which the least gain is wanted.
    light = servo.replace(**{"friction.viscous": 0.01})
    lowest = (J / (2 * T) - 0.01) / (cm * T)
    assert gain_of(light, "gain", "gain margin (lowering)", 1 / f, 0.0) == pytest.approx(f * lowest, rel=1e-8)
    # Settling wants the largest gain: at f times it the loop with delay has no phase left.
    highest = gain_of(servo, "settling", "gain margin (raising)", f, 0.005)
    assert crossover_phase(servo, f * highest, 0.005) == pytest.approx(0, abs=1e-4)


INERTIA = Uncertainty({"servo.inertia": (0.008, 0.026)})


@pytest.mark.slow
def test_a_set_with_an_unstable_loop_is_refused_with_both_sides_in_numbers(servo):
    """At J = 0.008 the loop at 1.1 times the fold is unstable, although the fold is that of J = 0.026."""
    with pytest.raises(NoOrbit, match="cannot be met") as error:
        tune(servo, "switch", demands=Demands(delay=0.008), uncertainty=INERTIA)
    said = str(error.value)
    needed = 1.1 * table1.REFERENCE["switch"]["fold"]["K"]
    assert f"asks for a gain of at least {needed:.6g}" in said
    assert crossover_phase(servo.replace(**{"servo.inertia": 0.008}), needed, 0.008) < -10
    # The largest gain with 30 degrees for every inertia: a scan over inertias on the frequency axis.
    low, high = 0.1, 1.0
    members = [servo.replace(**{"servo.inertia": float(J)}) for J in np.linspace(0.008, 0.026, 4)]
    for _ in range(16):
        middle = math.sqrt(low * high)
        kept = min(crossover_phase(member, middle, 0.008) for member in members) >= 30
        low, high = (middle, high) if kept else (low, middle)
    allowed = float(said.partition("allows gains of ")[2].split(";")[0].split(" to ")[1])
    assert allowed == pytest.approx(low, rel=1e-4)


@pytest.mark.slow
def test_margins_hold_for_every_servo_of_a_set(servo):
    """Settling wants all the gain that the phase margin of the worst loop leaves."""
    ranges = {"servo.inertia": (0.012, 0.03), "servo.motor_gain": (14.0, 17.0), "friction.viscous": (0.05, 0.12)}
    found = tune(
        servo, "switch", cost="settling", demands=Demands(delay=0.003, phase_margin=40, gain_margin=1.5),
        uncertainty=Uncertainty(ranges), bounds={"gain": (0.5, 5.0)},
    )  # fmt: skip
    assert found.verification.ok and found.verification.loops_checked > 200
    random = np.random.default_rng(3)
    low, high = np.array(list(ranges.values())).T
    points = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    least = math.inf
    for q in [*points, *(low + (high - low) * random.random((200, 3)))]:
        member = servo.replace(**dict(zip(ranges, map(float, q), strict=True)))
        phases = [crossover_phase(member, f * found.gain, 0.003) for f in (1.0, 1 / 1.5, 1.5)]
        assert phases[0] >= 40 - 1e-3 and min(phases) > -1e-3
        least = min(least, phases[0] - 40, phases[1], phases[2])
    assert "gain" not in " ".join(found.binding) or least < 0.5  # no room is left unused
    assert least < 0.5
