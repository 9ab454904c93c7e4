"""What becomes of motions of two masses: at rest from every start, irregular hunting; by scipy's DOP853 with events."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from belt_support import stops
from scipy.integrate import solve_ivp

from casahunt import Servo
from casahunt.errors import ComesToRest, HuntsIrregularly
from casahunt.orbits import find_cycle
from casahunt.servo.outcome import SETTLES
from casahunt.servo.parts import (
    BY_DIRECTION,
    DERIVATIVE_FILTER,
    FEEDFORWARD,
    INERTIA,
    INTEGRATOR,
    LEAK,
    PID_BY_GAINS,
    SWITCH,
    TORQUE_LIMIT,
    TWO_MASSES,
    Loop,
    loop_of,
    verbs,
)
from casahunt.servo.parts.ahead import measured
from casahunt.servo.parts.fate import LEFT_OF_A_SWING, NEARLY_THERE, Swing, fate, on_the_cycle
from casahunt.servo.parts.verbs import loop_cycle
from scripts.axes import Axis
from scripts.peers.axis_motion import AxisMotion

RESTS = {"inertia": 4e-4, "load_inertia": 1.6e-3, "shaft_stiffness": 14.2, "shaft_damping": 0.003, "motor_gain": 1.0,
         "kp": 6.0, "ki": 60.0, "kd": 0.12, "gain": 1.0, "static": 0.25, "coulomb": 0.18, "stribeck_velocity": 0.2,
         "viscous": 0.002}  # fmt: skip
HUNTS = RESTS | {"shaft_stiffness": 60.0, "shaft_damping": 0.01, "kp": 2.0, "ki": 12.0, "kd": 0.06, "gain": 0.5,
                 "stribeck_velocity": 0.05}  # fmt: skip


def loop(numbers: dict[str, float]) -> Loop:
    return Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), numbers)


@pytest.mark.slow
def test_what_comes_to_rest_from_every_start_is_said_to():
    """DOP853: from 0.03 rad, too, it stops a few times and never again."""
    with pytest.raises(ComesToRest, match=r"comes to rest from each of 13 starts, 0\.33 to 8\.1e-05 rad"):
        loop_cycle(loop(RESTS))
    assert len(stops(RESTS, -0.03, 100)) < 60


@pytest.mark.slow
def test_irregular_hunting_is_told_by_how_far_and_how_long_it_swings():
    """DOP853 from another start: its turns lie where these do, to a part in a hundred of the range."""
    with pytest.raises(HuntsIrregularly, match="hunts irregularly, turning 0.051") as refusal:
        loop_cycle(loop(HUNTS))
    seen = refusal.value
    times, places = np.array(stops(HUNTS, -0.2, 160)[100:]).T
    turning = places[1:-1][(places[1:-1] - places[:-2]) * (places[2:] - places[1:-1]) < 0]
    width = seen.amplitude[1] - seen.amplitude[0]
    assert np.abs(turning).min() == pytest.approx(seen.amplitude[0], abs=0.1 * width)
    assert np.abs(turning).max() == pytest.approx(seen.amplitude[1], abs=0.1 * width)
    assert np.diff(times).min() == pytest.approx(seen.between[0], rel=2e-3)
    assert seen.swing.irregular and seen.swing.period == pytest.approx(2 * np.diff(times).mean(), rel=1e-2)
    assert np.diff(times).max() == pytest.approx(seen.between[1], rel=2e-3)


def test_what_moves_at_one_rate_through_a_look_does_not_rest():
    """With next to no integral action it sticks for (Fs - kp x)/(ki x), longer than the first looks, and hunts on: 60
    turns and more by scripts/peers/axis.c.
    """
    slow = loop(HUNTS | {"ki": 12.0 / 256})
    start, (kp, ki) = slow.at_rest(-0.05), (0.5 * slow.value(name) for name in ("kp", "ki"))
    seen = fate(slow, start, Swing(start, 0.05, 2.8), rest=LEFT_OF_A_SWING)
    stuck = (slow.value("static") - kp * 0.05) / (ki * 0.05)
    first_slip = [phase.mode for phase in seen.motion.phases].index("slip+")
    waited = sum(phase.duration for phase in seen.motion.phases[:first_slip])
    assert seen.kind == "hunting" and waited == pytest.approx(stuck, rel=1e-6)


def test_a_motion_that_grows_hides_no_cycle_nearer_to_the_set_point():
    """A torque at its limit without anti-windup: from 1 rad it winds up for ever, from 0.01 rad it hunts.

    scipy's DOP853 at 1e-12 (scripts/peers/part_motion.py): 3.10900038 s, 0.0004121312694 rad.
    """
    numbers = {"inertia": 1.3e-4, "motor_gain": 1.0, "gain": 1.0, "kp": 0.095, "kd": 0.0072, "ki": 1.16,
               "static": 3.8e-4, "coulomb": 3e-4, "stribeck_velocity": 2.1e-4, "viscous": 3.4e-4,
               "torque_limit": 8.4e-4}  # fmt: skip
    cycle = loop_cycle(Loop((INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR, TORQUE_LIMIT), numbers))
    assert cycle.period == pytest.approx(3.10900038, rel=1e-8)
    assert cycle.amplitude == pytest.approx(0.0004121312694, rel=1e-8)


def test_swings_that_grow_by_as_much_in_every_turn_are_no_irregular_hunting():
    """A screw axis (m, kg) whose force is limited to 1.2 times static friction, without anti-windup: from 1 m it swings
    0.08 m farther in every turn, twice as far as it began after 50, and from 0.24 mm it hunts.

    scripts/peers/axis.c, Runge-Kutta's formula of order 4: it grows; 0.6751295081248 s and 2.395274686e-05 m.
    """
    numbers = {"motor_gain": 1.0, "gain": 1.0, "load_inertia": 48.59978888916206, "shaft_stiffness": 3933782.620832481,
               "shaft_damping": 1282.4999072280696, "inertia": 48.642945102985884, "static": 294.1308379869908,
               "stribeck_velocity": 0.0004145865327465063, "coulomb": 230.54529927568223, "viscous": 543.407316797561,
               "kp": 1454387.185651859, "kd": 20490.58126163913, "ki": 70805271.97755332,
               "torque_limit": 351.0495606328852}  # fmt: skip
    screw = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR, TORQUE_LIMIT), numbers)
    seen = fate(screw, screw.at_rest(-1.0), Swing({}, 1.0, 10.0))
    assert seen.kind == "undecided" and seen.still_grows
    cycle = loop_cycle(screw)
    assert cycle.period == pytest.approx(0.6751295081248, rel=1e-8)
    assert cycle.amplitude == pytest.approx(2.395274686e-05, rel=1e-8)


FAR = {"motor_gain": 1.0, "gain": 1.0, "load_inertia": 218.33662265224083, "shaft_stiffness": 14767090.821684731,
       "shaft_damping": 2110.6957446432375, "inertia": 123.51658065308678, "stribeck_velocity": 0.00034954563895922254,
       "static": 540.3558468686196, "coulomb": 469.51841720205863, "viscous": 416.83655612431045,
       "kp": 421783.8441122657, "kd": 16380.805359017908, "ki": 2549762.164614706,
       "derivative_filter": 0.007581984694510403}  # fmt: skip
RINGS = {"motor_gain": 1.0, "gain": 1.0, "load_inertia": 0.00019805054362281914, "shaft_stiffness": 42.11081613566268,
         "shaft_damping": 0.001621873095904368, "inertia": 0.0006389973944973399, "static": 0.020258915840599037,
         "stribeck_velocity": 0.01654235211799808, "coulomb": 0.01770547470148201, "viscous": 0.0031600034068209573,
         "kp": 0.4290227965553392, "kd": 0.03370614031091657, "ki": 1.9577066068137932}  # fmt: skip


def test_from_far_away_a_small_cycle_is_seen_as_well_as_from_beside_it():
    """A screw axis (m, kg) that hunts with 86 um, from 1 m; scripts/peers/axis.c: 8.61750159e-05 m, 9.3744312475 s."""
    screw = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR, DERIVATIVE_FILTER), FAR)
    seen = fate(screw, screw.at_rest(-1.0), measured(screw, screw.at_rest(-1.0), 1.0))
    assert seen.pattern == 2 and seen.turns.size < 100
    near = 5 * NEARLY_THERE  # how near to its cycle a motion is followed
    assert seen.swing.amplitude == pytest.approx(8.61750159e-05, rel=near)
    assert seen.swing.period == pytest.approx(9.3744312475, rel=near)


def test_a_cycle_is_found_whose_load_rings_hundreds_of_times_while_the_motor_sticks():
    """Sticks of 7 s with a load of 73 Hz; scripts/peers/axis.c: 14.33675935 s."""
    cycle = loop_cycle(Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), RINGS))
    assert cycle.period == pytest.approx(14.33675935, rel=1e-9) and len(cycle.arcs) <= 4


def test_beyond_the_fold_every_start_comes_to_rest_and_the_fold_is_named():
    """Table 1: K = 0.64733908 (the event map); starts from 8 * 0.53 N m over the torque per rad on."""
    with pytest.raises(ComesToRest, match=r"from each of 13 starts, 0\.19 to .* fold at gain = 0\.6473390"):
        loop_cycle(Loop((INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR), {"gain": 0.7}))


def test_the_way_from_a_smaller_gain_has_a_bound(monkeypatch):
    monkeypatch.setattr(verbs, "WORK_OF_THE_WAY", 100.0)
    with pytest.raises(ComesToRest, match=r"each of 13 starts.* cycle of gain 0\.35 was not followed up to 0\.7 with"):
        loop_cycle(Loop((INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR), {"gain": 0.7}))


@pytest.mark.slow
def test_a_cycle_that_has_become_unstable_is_no_hunting():
    """At half the gain it is stable; at it motions rest from each of 13 starts (scripts/peers/axis.c)."""
    numbers = {"motor_gain": 1.0, "gain": 1.0, "load_inertia": 0.0009392, "shaft_stiffness": 99.32,
               "shaft_damping": 0.02115, "static_back": 0.04586, "coulomb_back": 0.02622, "viscous_back": 0.0007273,
               "inertia": 0.001113, "stribeck_velocity": 0.07043, "static": 0.05218, "coulomb": 0.03987,
               "viscous": 0.000574, "kp": 1.025, "kd": 0.0512, "ki": 2.349}  # fmt: skip
    with pytest.raises(ComesToRest, match="each of 13 starts.* unstable, and motions leave it"):
        loop_cycle(Loop((TWO_MASSES, BY_DIRECTION, PID_BY_GAINS, INTEGRATOR), numbers))


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs cc")
def test_swings_that_shrink_to_a_twelfth_are_waited_for_though_each_lasts_twelve_times_as_long():
    """Axis 3 of seed 41 at gain 1.25, from 0.5 urad; a C program goes the same way down from 50."""
    axis = Axis(41, 3)
    hunting = Swing.of(loop_cycle(axis.loop))
    axis.loop = axis.loop.replace(gain=1.25)
    near, far = (axis.loop.at_rest(-x) for x in (5.4e-7, 5.4e-5))
    assert fate(axis.loop, near, hunting).kind in SETTLES
    axis.n |= {name: 1.25 * axis.n[name] for name in ("kp", "kd", "ki")}
    down = AxisMotion(axis.n, axis.state(far), axis.scale)
    down.gone = 0.0
    there = down.on(2, 3e3)[:, 1]
    assert there == pytest.approx(fate(axis.loop, far, hunting).turns[:2], rel=1e-3)
    assert np.abs(there[1]) == pytest.approx(np.abs(there[0]) / 12, rel=0.1)


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs cc")
def test_a_look_that_is_cut_short_at_a_breakaway_tells_no_size_of_the_slip():
    """Axis 22 of seed 41: the 150 intervals of the look end with the stick; beside it the velocity is 1e-24 rad/s."""
    axis = Axis(41, 22)
    found = loop_cycle(axis.loop)
    on = axis.motion(on_the_cycle(found), 200 * found.period)
    assert on.amplitude == pytest.approx(found.amplitude, rel=1e-6)
    assert on.period == pytest.approx(found.period, rel=1e-6)


def test_a_motor_whose_breakaway_is_balanced_while_its_load_rings_rests():
    """Axis 14 of seed 41 with a leak: its load rings on by 1e-9, and on which side of the breakaway the motor is then
    is rounding. C sees it at rest with any leak of 0.355 1/s or more."""
    axis = Axis(41, 14)
    held, cycle = axis.loop.with_parts(LEAK, leak=0.5), loop_cycle(axis.loop)
    x = cycle.arcs[0].states.reshape(-1, cycle.scale.size)[3]
    for factor in np.arange(0.9, 1.1, 0.01):  # two of these could not be followed
        start = dict(zip(held.system.states, factor * x, strict=True))
        assert fate(held, start, Swing.of(cycle)).kind == "at rest"


@pytest.mark.parametrize("velocity", [-3.7e-24, 1e-24, -1e-15, 0.0])
def test_a_stuck_velocity_of_rounding_tells_no_size_of_the_slip(velocity):
    """From where another cycle's stick is, as rounding leaves it; the amplitude is that of the event map."""
    loop = loop_of(Servo(), "switch", 0.04)
    found = find_cycle(loop.system, "stick", start={"x1": 0.05005, "x2": velocity, "x3": -0.1164})
    assert found.amplitude == pytest.approx(0.0500469727, rel=1e-8)


def test_a_leak_that_holds_a_servo_is_seen_to_hold_it():
    """Whatever the rounding of its rates makes of a long time; there its torque, (kp + ki/leak) x, is within Fs."""
    axis = Axis(41, 22)
    held, before = axis.loop.with_parts(LEAK, leak=3.745), Swing.of(loop_cycle(axis.loop))
    for x in (0.002334, -0.003237):
        seen = fate(held, held.at_rest(x), before)
        assert seen.kind == "at rest"
        ends = abs(seen.motion.phases[-1].end[held.system.states.index("x1")])
        assert 0 < ends * (axis.n["kp"] + axis.n["ki"] / 3.745) <= axis.n["Fs"]


def test_what_bristles_swing_by_are_turns_where_it_is_they_that_hunt():
    """A jump of the torque with the direction pushes a LuGre servo away from rest, whose bristles it keeps swinging: by
    a bristle's bend, of which 10,000 phases saw 22 turns. By DOP853, from reversal to reversal."""
    loop = loop_of(Servo(), "lugre", 0.1).with_parts(FEEDFORWARD, compensated=0.32)
    v, start = loop.parameters, {"x1": -1.6e-5, "x2": 1.86e-4, "x4": -1.38e-5, "x3": -3.5e-9}
    J, s0, s1, b, Fc, Fs, vs = (v[name] for name in ("inertia", "stiffness", "damping", "viscous", "coulomb", "static",
                                                     "stribeck_velocity"))  # fmt: skip
    kp, ki, kd = (float(loop.signal(name, loop.mode_at(**start), np.zeros((4, 1)))[0]) for name in ("kp", "ki", "kd"))

    def rate(t, y, sign):
        x1, x2, x3, z = y
        bent = x2 - abs(x2) * s0 * z / (Fc + (Fs - Fc) * np.exp(-((x2 / vs) ** 2)))
        torque = -(kp * x1 + kd * x2 + ki * x3) + 0.32 * Fc * sign
        return [x2, (torque - s0 * z - s1 * bent - b * x2) / J, x1, bent]

    def stops_at(t, y, sign):
        return y[1] * sign if t > 1e-9 else 1.0

    stops_at.terminal, stops_at.direction = True, -1
    y, sign, places = np.array([start[name] for name in ("x1", "x2", "x3", "x4")]), 1.0, []
    for _ in range(40):
        swing = solve_ivp(rate, (0, 1), y, "DOP853", events=stops_at, args=(sign,), rtol=1e-11, atol=1e-18)
        y, sign = swing.y_events[0][0], -sign
        places.append(y[0])
    before = Swing(start, 1.65e-5, 8.1e-3)
    found = fate(loop, start, before, LEFT_OF_A_SWING)
    assert found.turns[:40] == pytest.approx(places, rel=1e-6) and len(found.motion.phases) < 1000
