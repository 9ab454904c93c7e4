"""Servos whose friction hardly drops: cycles that attract weakly, folds at tiny gains, P(a) next to a over decades.

Truth: long double Taylor series for the Switch servo (problems/taylor.py); for the LuGre servo motions alone, to 1e-9,
without any boundary value problem.
"""

from dataclasses import replace

import numpy as np
import pytest
from map_support import double, watched

from casahunt import Options, Servo, find_fold
from casahunt.servo import cold_start
from casahunt.servo.cold_start import AtGain, quickly_at
from casahunt.servo.event_map.half_cycle import HalfCycle, StickMap, half_cycle
from casahunt.servo.event_map.scan import IN_VAIN, _highest, _vertex, scan
from casahunt.servo.event_map.secant_search import (
    BESIDE_A_CYCLE,
    BESIDE_A_WEAK_ONE,
    CONVERGING,
    MOST_LOWERED,
    lowered,
    near_stable,
)
from problems.taylor import switch_fold


def dropping(static: float) -> Servo:
    """The servo of Table 1 with another static friction; 0.44 is no drop."""
    servo = Servo()
    return replace(servo, friction=replace(servo.friction, static=static))


ENDS_BELOW = replace(
    Servo(),
    inertia=0.0424,
    friction=replace(
        Servo().friction, coulomb=1.0911, static=1.09235, stribeck_velocity=0.0208, viscous=0.0864, stiffness=7620,
        damping=6.38,
    ),
)  # fmt: skip
"""Without dry friction its loop is unstable at low gains: the rigid cycles end less than a factor of two below their
fold, and the LuGre fold lies between.  (Drawn at random.)"""


@pytest.mark.slow
def test_the_fold_of_a_rigid_servo_with_hardly_any_drop():
    servo = dropping(0.4415)
    found = find_fold(servo, "switch")
    gain, amplitude = switch_fold(servo, found.gain, found.orbit.amplitude)
    assert found.gain == pytest.approx(gain, rel=10 * found.orbit.error_estimate)
    assert found.orbit.amplitude == pytest.approx(amplitude, rel=1e-6)  # the tolerance: first order beside a fold


@pytest.mark.parametrize("servo", [
    pytest.param(dropping(0.44065), id="hardly any drop", marks=pytest.mark.slow),
    pytest.param(ENDS_BELOW, id="cycles end below"),
])  # fmt: skip
def test_a_lugre_fold_far_below_that_of_the_rigid_servo(servo):
    """Just below it some motion goes farther out, just above it none does."""
    found = find_fold(servo, "lugre")
    places = found.orbit.amplitude * np.exp(np.linspace(-0.1, 0.1, 9))

    def largest(gain):
        return max(half_cycle("lugre", servo, gain, float(a), tol=1e-9).ratio for a in places)

    assert largest(0.99 * found.gain) > 1 > largest(1.01 * found.gain)


def test_next_to_a_weak_cycle_is_where_it_sticks_and_not_where_the_ratio_is_next_to_one():
    servo, gain = dropping(0.44065), 1.566e-5
    rigid = scan(StickMap("switch", servo, gain)).upper
    found = near_stable(StickMap("lugre", servo, gain), rigid.fixed, slope=rigid.slope)
    far = half_cycle("lugre", servo, gain, rigid.fixed)
    assert abs(np.log(far.ratio)) < CONVERGING["lugre"]  # by the ratio alone this one would do
    inner, outer = (half_cycle("lugre", servo, gain, found.start * f, tol=1e-9) for f in (0.97, 1.03))
    slope = np.log(outer.ratio / inner.ratio) / np.log(1.03 / 0.97)
    place = np.log(outer.start) - np.log(outer.ratio) / slope
    assert abs(np.log(found.start) - place) < 2 * BESIDE_A_WEAK_ONE  # the secant over 6 % is off by as much again
    assert abs(np.log(far.start) - place) > 10 * BESIDE_A_WEAK_ONE
    assert found.slope == pytest.approx(slope, rel=0.2)  # what the tolerance of other motions leaves of it is noise


def test_a_motion_that_comes_to_rest_leads_to_no_weak_cycle():
    def at_rest(P, honest, a, *, tol=None, longest=np.inf):
        run = honest(a)
        return run if tol is None else HalfCycle(a, 0.0, run.segments)

    P = double(StickMap("switch", dropping(0.4408), 2.5e-4), at_rest)
    assert near_stable(P, 0.066, slope=-0.04) is None


@pytest.mark.parametrize("degree", [None, 6])
def test_newton_starts_beside_a_weak_cycle_in_any_scheme(degree):
    servo, gain = dropping(0.4408), 2.5e-4
    rigid = scan(StickMap("switch", servo, gain)).upper
    found = quickly_at(servo, "lugre", gain, options=Options(degree=degree), beside=rigid)
    assert found is not None
    assert found.stable
    assert degree in (None, found.degree)


def test_a_motion_that_leads_next_to_its_start_is_not_taken_for_one_next_to_a_cycle():
    """At 0.1 Fs/kp it comes back to 0.95 of that, as everywhere far out; the cycle sticks 100 times nearer."""
    known = [
        cold_start._beside_the_rigid_cycle(AtGain(StickMap("lugre", servo, gain), Options()))
        for servo, gain in ((dropping(0.4408), 2.5e-4), (Servo(), 0.05))
    ]
    assert known[0] == 0
    assert known[1] > 0


def test_where_the_map_is_flat_one_motion_tells():
    P, seen = watched(StickMap("lugre", Servo(), 0.05))
    assert cold_start._beside_the_rigid_cycle(AtGain(P, Options())) > 0
    assert len(seen) == 1


def test_lower_gains_come_closer_together_only_where_cycles_end():
    def from_there(servo, gain):
        P = StickMap("switch", servo, gain)
        start = near_stable(P, P.typical, close=BESIDE_A_CYCLE) or scan(P).upper
        return [gain / lower for lower, _ in lowered(P, start)]

    assert from_there(Servo(), 0.1) == [2.0**k for k in range(1, MOST_LOWERED + 1)]
    assert from_there(ENDS_BELOW, 0.0065)[0] == pytest.approx(1.4)


class Peak:
    """Motions of which log a and P/a are known."""

    def __init__(self, ratio):
        self.ratio, self.seen = ratio, []

    @property
    def asked(self):
        return len(self.seen)

    def __call__(self, a):
        ratio = self.ratio(np.log(a))
        self.seen.append(ratio)
        return None if ratio is None else HalfCycle(a, a * ratio, [])

    def top(self, low=-0.31, middle=0.04, high=0.25):
        inner, best, outer = (HalfCycle(np.exp(x), np.exp(x) * self.ratio(x), []) for x in (low, middle, high))
        return _highest(self, inner, best, outer)


def test_a_smooth_peak_is_found_by_a_few_motions():
    peak = Peak(lambda x: 0.95 * np.exp(-0.3 * (x + 0.02) ** 2 + 0.1 * x**3))
    found = peak.top()
    assert peak.asked <= 6
    assert 1 - found.ratio == pytest.approx(0.05, rel=0.02)


@pytest.mark.parametrize("bend", [1.0, 0.0])
def test_a_peak_that_is_there_already_and_none_at_all(bend):
    peak = Peak(lambda x: 0.5 - bend * x**2)
    assert peak.top(-0.25, 0.0, 0.25).ratio == 0.5
    assert peak.asked <= 6
    assert _vertex((-1.0, 0.4), (0.0, 0.5), (1.0, 0.4))[0] != 0  # where it looked already


@pytest.mark.parametrize("height", [1 + 1e-7, 1 - 1e-7])
def test_a_peak_next_to_one_is_climbed_until_it_is_clear(height):
    peak = Peak(lambda x: height - 0.2 * (x + 0.05) ** 2 - 0.5 * (x + 0.05) ** 4 + 0.1 * (x + 0.05) ** 3)
    found = peak.top()
    assert (found.ratio >= 1) == (height > 1)


def test_a_sharp_peak_is_climbed_where_parabolas_foretell_nothing():
    peak = Peak(lambda x: 1.0004 - abs(x + 0.137) ** 0.9)
    assert peak.top().ratio >= 1
    assert sum(ratio >= 1 for ratio in peak.seen) == 1  # it is left at once


def test_the_edge_of_a_jump_below_one_is_left():
    peak = Peak(lambda x: 0.667 + 0.01 * x if x < 0.0612345 else -0.7)
    assert peak.top().ratio == pytest.approx(0.6676, abs=1e-4)
    assert peak.asked <= IN_VAIN + 2  # to the width at which a peak is found: 22 by golden section


def test_motions_that_fail_are_no_peak():
    peak = Peak(lambda x: None if -0.1 < x < 0 else 0.9 - x**2)
    assert peak.top().ratio == pytest.approx(0.9, abs=2e-3)
