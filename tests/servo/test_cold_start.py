"""The unstable Switch cycle from motions inside the stable one, and the stable one next to the fold."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from map_support import double, watched

from casahunt import NoOrbit, Options, Servo, find_orbit
from casahunt.collocation.mesh import shape
from casahunt.collocation.remesh import shape_limit
from casahunt.motion.phases import MarchFailure, Segment
from casahunt.orbits.marched_mesh import start_from_motion
from casahunt.servo import cold_start
from casahunt.servo import find_orbit as orbits
from casahunt.servo.event_map import secant_search as near_by
from casahunt.servo.event_map.fixed_points import fixed_points
from casahunt.servo.event_map.half_cycle import HalfCycle, StickMap, half_cycle
from casahunt.servo.event_map.secant_search import FAR_OFF, MUCH_LONGER, near_stable, near_typical
from casahunt.servo.problem import Hunting
from problems import table1

FOLD = table1.REFERENCE["switch"]["fold"]["K"]
FAR_STICKS = Servo().replace(**{
    "friction.static": 0.605, "friction.coulomb": 0.361, "friction.stribeck_velocity": 0.0205,
    "friction.viscous": 0.0, "servo.inertia": 0.168, "servo.motor_gain": 5.96,
    "controller.integral_time": 0.137, "controller.lead_time": 0.132,
})  # fmt: skip
"""Next to its fold it sticks twice as far out as most; from where those do, it comes to rest."""
FAR_GAIN = 5.4
ACCURATE = Options(tol=1e-8)


def inner(gain: float, servo: Servo | None = None):
    P = StickMap("switch", servo or Servo(), gain)
    outer = near_typical(P, close=0.3)
    return cold_start.inner_cycle(P, outer.fixed, outer.moving, ACCURATE)


def between(P: StickMap, outer: float = 0.003, moving: float = 0.2):
    return cold_start.inner_cycle(P, outer, moving, ACCURATE)


AT_04 = StickMap("switch", Servo(), 0.4)


@pytest.mark.parametrize(("part", "vanished"), [(0.9e-6, True), (1.1e-6, False), (1.0, False)])
def test_an_amplitude_that_counts_as_none(part, vanished):
    """A millionth of Fs/kp, where the proportional torque is static friction."""
    kp, _, _ = Servo().torque_gains(0.3)
    orbit = SimpleNamespace(servo=Servo(), gain=0.3, amplitude=part * Servo().friction.static / kp)
    assert orbits._vanished(orbit) == vanished


@pytest.mark.parametrize(("servo", "gain"), [
    *((Servo(), gain) for gain in (0.05, 0.4, 0.64, FOLD * (1 - 1e-6))), (FAR_STICKS, 1.1), (FAR_STICKS, FAR_GAIN),
])  # fmt: skip
def test_the_unstable_cycle(servo, gain):
    """The inner fixed point of the map to rounding, which shares nothing with it but the motion."""
    found = find_orbit(servo, "switch", gain, branch="unstable", options=ACCURATE)
    a = found.amplitude
    near = fixed_points(servo, gain, a * (1 - 1e-4), a * (1 + 1e-4), points=5).fixed
    assert len(near) == 1 and a == pytest.approx(near[0].amplitude, rel=10 * found.error_estimate + 1e-12)
    assert found.half_multiplier == pytest.approx(near[0].multiplier, rel=1e-4) and near[0].multiplier > 1


@pytest.mark.parametrize(("branch", "outside"), [("unstable", 3.0), ("stable", 1.9)])
def test_what_lies_elsewhere_or_is_stable_is_none(orbit, branch, outside):
    """Motions that lead to the unstable cycle, farther in than where they are said to begin; and to the stable one."""
    there = orbit("switch", 0.4, branch).amplitude

    def motion(P, honest, a, **how):
        return replace(honest(there), start=a, position=0.9 * a)

    assert between(double(AT_04, motion), outside * there) is None


def test_given_up_where_a_motion_fails_or_the_map_jumps():
    def jumping(P, honest, a, **how):
        tried.append(a)
        return honest(0.002 if a > 0.001 else 0.0001)

    tried: list[float] = []
    assert between(double(AT_04, jumping)) is None
    assert len(tried) < 40 and min(abs(a - 0.001) for a in tried) < 1e-10

    def failing(*_, **__):
        raise MarchFailure

    assert between(double(AT_04, failing)) is None


def test_where_every_motion_inside_grows_none_is_followed_to_nothing():
    tried = []

    def growing(P, honest, a, **how):
        tried.append(a)
        return honest(0.002)

    assert between(double(AT_04, growing)) is None
    assert min(tried) > 1e-4 * Servo().friction.static / Servo().torque_gains(0.4)[0] and len(tried) < 12


def test_a_servo_that_creeps_to_rest_is_not_waited_for():
    """Where it sticks at half of the stable cycle's, it would creep on for more than an hour."""
    P, motions = watched(StickMap("switch", Servo(), 0.64))
    outer = near_typical(P, close=0.3)
    motions.clear()
    assert between(P, outer.fixed, outer.moving) is not None
    assert max(run.moving for _, _, run, _ in motions) == pytest.approx(cold_start.CREEPS_AFTER * outer.moving)


def test_a_motion_that_swings_on_is_not_closed():
    """One that was followed for so many slips; its last one is no stick."""
    motion = half_cycle("switch", Servo(), 0.4, 0.00096)
    swinging = replace(motion, position=0.9 * motion.start, segments=motion.segments[:1])
    assert between(double(AT_04, lambda *_, **__: swinging)) is None


def test_a_motion_is_closed_by_the_stick_that_its_start_asks_for():
    """The equations of the stick and the closure hold then, and nothing else is moved."""
    motion = half_cycle("switch", Servo(), 0.4, 0.00096)
    problem = Hunting("switch", Servo(), 0.4)
    t, u, setting = start_from_motion(problem, *cold_start._closed(problem, motion, ACCURATE), ACCURATE)
    nodes, (slip, stick) = t.nodes_of(u) * setting.scale, t.durations_of(u)
    assert slip == motion.segments[0].duration and motion.ratio < 0.5
    assert nodes[-1] == pytest.approx(-nodes[0], rel=1e-14)
    assert nodes[-2, 2] + stick * 0.00096 == pytest.approx(nodes[-1, 2], rel=1e-12)
    kp, _, ki = Servo().torque_gains(0.4)
    assert kp * nodes[-1, 0] + ki * nodes[-1, 2] == pytest.approx(Servo().friction.static, rel=1e-12)


def test_a_motion_that_stops_beyond_the_next_breakaway_cannot_be_closed():
    motion = half_cycle("switch", Servo(), 0.4, 0.00096)
    motion.segments[0].end[:] += np.array([0.0, 0.0, 1.0])
    assert cold_start._closed(Hunting("switch", Servo(), 0.4), motion, ACCURATE) is None


def test_by_ipopt_alone():
    found = find_orbit(Servo(), "switch", 0.64, branch="unstable", options=Options(solver="ipopt"))
    assert found.half_multiplier > 1 and found.solver == "ipopt"


@pytest.mark.parametrize("options", [Options(half=False), Options(degree=5, kind="radau")])
def test_in_other_forms(orbit, options):
    found = find_orbit(Servo(), "switch", 0.4, branch="unstable", options=options)
    assert found.amplitude == pytest.approx(orbit("switch", 0.4, "unstable").amplitude, rel=1e-6)
    assert found.degree == (options.degree or 8) and found.repeats == (2 if options.half else 1)


# The stable cycle next to the fold ------------------------------------------------------------------------------------


def test_a_step_too_far_inwards_goes_back_half_of_it():
    """At 0.64 the second motion comes to rest, which is not waited for."""
    P, motions = watched(StickMap("switch", Servo(), 0.64))
    found = near_typical(P)
    assert found is not None and found.ratio == pytest.approx(1, abs=0.03)
    (_, outside, first, _), (_, inside, lost, longest), (_, between, _, _) = motions[:3]
    assert inside < between < outside and between == pytest.approx((inside * outside) ** 0.5)
    assert lost.ratio < 1 / FAR_OFF and longest == MUCH_LONGER * first.moving and lost.moving < 1.01 * longest


@pytest.mark.parametrize(
    ("model", "ratios", "longest"),
    [
        ("switch", [0.5, 20.0], [np.inf, 10.0]),  # a step inwards, to where it is thrown out
        ("switch", [2.0, 0.0], [np.inf, 10.0]),  # a step outwards, to where it comes to rest
        ("lugre", [0.5, 0.8, 0.0], [np.inf, np.inf, np.inf]),  # whose motions cost ten times as much, and are no slips
    ],
)
def test_only_a_step_too_far_inwards_is_taken_back(model, ratios, longest):
    told, asked = iter(ratios), []

    def played(P, honest, a, *, longest):
        asked.append(longest)
        return HalfCycle(a, a * next(told), [Segment("slip+", "stop", 1.0, *np.zeros((3, 2)))])

    assert near_stable(double(StickMap(model, Servo(), 0.4), played), 0.003) is None and asked == longest


def test_a_motion_is_meshed_for_the_tolerance():
    """No other mesh is needed then: last Legendre coefficients fall with the power of the degree."""
    motion, problem = near_typical(StickMap("switch", Servo(), 0.2)), Hunting("switch", Servo(), 0.2)
    for tol in (1e-4, 1e-8, 1e-12):
        options = Options(tol=tol)
        t, u, _ = start_from_motion(problem, *cold_start.phases_of(motion, problem, options), options)
        assert 1e-3 * shape_limit(tol) < shape(t, u).max() <= shape_limit(tol)


def test_from_farther_out_where_cycles_stick_there():
    P, motions = watched(StickMap("switch", FAR_STICKS, FAR_GAIN))
    assert near_stable(P, P.typical) is None and len(motions) == 1
    found = near_typical(P)
    near = fixed_points(FAR_STICKS, FAR_GAIN, 0.7 * found.fixed, 1.4 * found.fixed, points=5).fixed
    assert near and near[-1].multiplier < 1 and found.fixed == pytest.approx(near[-1].amplitude, rel=1e-3)


@pytest.mark.parametrize(("servo", "gain"), [(Servo(), 0.647), (FAR_STICKS, FAR_GAIN)])
def test_stable_cycles_next_to_the_fold(servo, gain):
    found = find_orbit(servo, "switch", gain, options=ACCURATE)
    near = fixed_points(servo, gain, 0.999 * found.amplitude, 1.001 * found.amplitude, points=5).fixed
    assert len(near) == 1 and found.half_multiplier == pytest.approx(near[0].multiplier, rel=1e-4)


def test_above_the_fold_a_few_motions_show_none():
    P, motions = watched(StickMap("switch", Servo(), 1.02 * FOLD))
    assert near_typical(P) is None
    assert len(motions) <= 2 * near_by.SECANT_ROUNDS
    with pytest.raises(NoOrbit):
        find_orbit(Servo(), "switch", 1.02 * FOLD, branch="unstable")


@pytest.mark.parametrize(("name", "amplitude", "period"), [
    ("friction.stribeck_velocity", 0.01642836, 12.1058349), ("servo.inertia", 0.01087585915, 18.3654095),
])  # fmt: skip
def test_a_slip_that_begins_within_microseconds_is_solved_from_the_maps_own_cycle(name, amplitude, period):
    """A per cent beside the fixed point Newton's method is lost; the truths are the event map's, to their digits."""
    orbit = find_orbit(table1.servo().replace(**{name: 1e-6}), "switch", 0.1)
    assert orbit.amplitude == pytest.approx(amplitude, rel=1e-6) and orbit.period == pytest.approx(period, rel=1e-6)
