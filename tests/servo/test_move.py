"""Moves by a profile: the profile by its limits, the motion by an integrator that is not this package's."""

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import Controller, Friction, InputError, Move, Servo, load, remedies, simulate
from casahunt.servo.move import CLOCK, moving
from casahunt.servo.parts import LUGRE, TWO_MASSES, Loop, loop_of
from casahunt.servo.parts.table import remedy_of, with_remedy

MOVES = [
    (Move(speed=0.5, acceleration=2.0), 1.0), (Move(speed=3.0, acceleration=2.0), -1.0),
    (Move(speed=0.5, acceleration=2.0, jerk=20.0), 1.0), (Move(speed=5.0, acceleration=2.0, jerk=20.0), 1.0),
    (Move(speed=0.1, acceleration=2.0, jerk=20.0), -1.0), (Move(speed=5.0, acceleration=50.0, jerk=20.0), 0.3),
]  # fmt: skip


def profile(move, distance):
    """(times, way ahead, speed) by summing up the stretches in small steps: the jerk alone is taken from them."""
    t, r, v, a = [0.0], [abs(distance)], [0.0], 0.0
    for duration, begins, jerk in move.stretches(distance):
        steps = 4000
        h, a = duration / steps, begins if jerk == 0 or abs(begins) > 0 else a
        for _ in range(steps):
            r.append(r[-1] - h * (v[-1] + h * (a / 2 + h * jerk / 6)))
            v.append(v[-1] + h * (a + h * jerk / 2))
            a += h * jerk
            t.append(t[-1] + h)
    return np.array(t), np.array(r), np.array(v)


@pytest.mark.parametrize(("move", "distance"), MOVES)
def test_a_profile_arrives_within_its_limits(move, distance):
    t, r, v = profile(move, distance)
    assert t[-1] == pytest.approx(move.time(distance)) and abs(r[-1]) < 1e-9 and abs(v[-1]) < 1e-9
    a = np.diff(v) / np.diff(t)
    assert v.max() <= move.speed * (1 + 1e-9) and np.abs(a).max() <= move.acceleration * (1 + 1e-9) and v.min() > -1e-9


def test_a_profile_takes_no_longer_than_its_limits_ask_for():
    """Closed forms of the shortest times: with and without a stretch at full speed, and at full acceleration."""
    assert Move(speed=0.5, acceleration=2.0).time(1.0) == pytest.approx(1 / 0.5 + 0.5 / 2)
    assert Move(speed=3.0, acceleration=2.0).time(1.0) == pytest.approx(2 * math.sqrt(1 / 2))
    assert Move(speed=0.5, acceleration=2.0, jerk=20.0).time(1.0) == pytest.approx(1 / 0.5 + 0.5 / 2 + 2 / 20)
    assert Move(speed=5.0, acceleration=50.0, jerk=20.0).time(0.3) == pytest.approx(4 * (0.3 / 2 / 20) ** (1 / 3))
    assert Move(speed=0.1, acceleration=2.0, jerk=20.0).time(1.0) == pytest.approx(1 / 0.1 + 2 * math.sqrt(0.1 / 20))
    assert Move(speed=0.1, acceleration=2.0).time(0.0) == 0


def switch_motion(servo, gain, distance, where, ahead):
    """(3, m) states of the Switch servo at times (m,), and its largest torque, by DOP853, slip by slip.

    ahead(t): way ahead of the set point and its rate.
    """
    kp, kd, ki = servo.torque_gains(gain)
    f, J = servo.friction, servo.inertia

    def torque(t, x):
        r, rate = ahead(t)
        return -(kp * (x[0] + r) + kd * (x[1] + rate) + ki * x[2])

    def rates(t, x, s):
        drag = 0.0 if s == 0 else s * (
            f.coulomb + (f.static - f.coulomb) * math.exp(-((x[1] / f.stribeck_velocity) ** 2))) + f.viscous * x[1]
        return [x[1] * (s != 0), (torque(t, x) - drag) / J * (s != 0), x[0] + ahead(t)[0]]

    t, x, s, found, peak, time = 0.0, np.array([-distance, 0.0, 0.0]), 0, np.empty((3, where.size)), 0.0, where[-1]
    while t < time:
        def leaves(t, x, s=s, began=t):
            return abs(torque(t, x)) - f.static if s == 0 else s * x[1] + (1e-15 if t == began else 0.0)

        leaves.terminal, leaves.direction = True, 1 if s == 0 else -1
        seen = solve_ivp(rates, (t, time), x, method="DOP853", rtol=1e-11, atol=1e-13, events=leaves, args=(s,),
                         max_step=0.01, dense_output=True)  # fmt: skip
        inside = (where >= t) & (where <= seen.t[-1])
        found[:, inside] = seen.sol(where[inside])
        dense = np.linspace(t, seen.t[-1], 2 + 400 * seen.t.size)
        peak = max(peak, *(abs(torque(t, x)) for t, x in zip(dense, seen.sol(dense).T, strict=True)))
        t, x = float(seen.t[-1]), seen.y[:, -1].copy()
        if s == 0:
            s = int(math.copysign(1, torque(t, x)))
        else:
            x[1] = 0.0
            s = 0 if abs(torque(t, x)) <= f.static else int(math.copysign(1, torque(t, x)))
    return found, peak


@pytest.mark.parametrize(("move", "distance"), [
    MOVES[0], *(pytest.param(*each, marks=pytest.mark.slow) for each in MOVES[2:5])
])  # fmt: skip
def test_a_motion_by_a_profile_is_that_of_another_integrator(move, distance):
    time = move.time(distance) + 8.0
    at, r, v = profile(move, distance)
    sign = math.copysign(1, distance)

    def ahead(t):
        k = min(int(np.searchsorted(at, t, "right")) - 1, at.size - 2)
        if t >= at[-1]:
            return 0.0, 0.0
        h, a = t - at[k], (v[k + 1] - v[k]) / (at[k + 1] - at[k])
        return sign * (r[k] - h * (v[k] + h * a / 2)), -sign * (v[k] + h * a)

    where = np.linspace(0.0, time, 60)
    truth, peak = switch_motion(Servo(), 0.04, distance, where, ahead)
    motion = simulate(Servo(), "switch", 0.04, set_point=distance, time=time, move=move)
    assert motion.status.ok and motion.names == ("x1", "x2", "x3")
    for x, values in zip(motion.sample(where), truth, strict=True):
        assert x == pytest.approx(values, abs=1e-7 * np.abs(values).max())
    assert motion.peak_torque == pytest.approx(peak, rel=1e-4)  # looked for among points of the motion
    assert motion.table()["set_point_rad"][[0, -1]] == pytest.approx([0.0, distance], abs=1e-12)


@pytest.mark.slow
def test_what_becomes_of_it_is_that_of_the_servo_that_stands():
    """The move is over; it hunts with the amplitude of the cycle, as from a step."""
    move = Move(speed=0.5, acceleration=2.0, jerk=50.0)
    seen = [simulate(Servo(), "switch", 0.04, time=60.0, move=how).verdict for how in (move, None)]
    assert seen[0].kind == seen[1].kind == "hunting" and seen[0].amplitude == pytest.approx(seen[1].amplitude, rel=1e-3)
    loop = Loop((TWO_MASSES, *loop_of(Servo(), "switch", 0.04).parts[1:]), {"gain": 0.04, "shaft_damping": 0.1})
    assert simulate(loop, time=20.0, move=move).status.ok


@pytest.mark.slow
def test_a_price_is_that_of_the_move_that_is_asked_for():
    """Largest torque and settling time of the row: those of the loop with the size to choose, simulated."""
    move = Move(speed=0.5, acceleration=2.0)
    found = remedies(Servo(), "switch", 0.04, only=["leak"], step=0.5, move=move)
    row = found.remedies[0]
    loop = with_remedy(found.loop, remedy_of("leak", "switch"), row.recommended)
    motion = simulate(loop, set_point=0.5, time=60.0, move=move)
    assert row.peak_torque == pytest.approx(motion.peak_torque, rel=1e-4)
    t, x = motion.dense(16)
    within = max(row.recommended_rest_error, 0.02 * 0.5)
    assert row.settling == pytest.approx(t[np.flatnonzero(np.abs(x[0]) > within)[-1]], rel=2e-2)
    assert found.task == "move of 0.5 rad with 0.5 rad/s, 2 rad/s2"
    at_once = remedies(Servo(), "switch", 0.04, only=["leak"], step=0.5).remedies[0]
    assert at_once.size == row.size and at_once.peak_torque > row.peak_torque


def test_of_a_bristle_the_move_starts_at_rest():
    motion = simulate(Servo(), "lugre", 0.3, set_point=-0.2, time=5.0, move=Move(speed=0.5, acceleration=4.0))
    assert motion.status.ok and LUGRE in motion.loop.present and CLOCK not in motion.names
    whole = moving(motion.loop, motion.move, -0.2)
    assert motion.end[0] == pytest.approx(0.0, abs=0.03) and CLOCK in whole.system.states


def test_a_servo_that_grows_may_not_arrive():
    """Its linear loop is unstable, by the criterion of Routh, and it is thrown out during the move."""
    servo = Servo(controller=Controller(lead_time=0.01, integral_time=0.05), friction=Friction(viscous=1e-3))
    kp, kd, ki = servo.torque_gains(0.5)
    assert (kd + servo.friction.viscous) * kp < servo.inertia * ki
    motion = simulate(servo, "switch", 0.5, time=60.0, move=Move(speed=0.02, acceleration=0.1))
    assert motion.verdict.kind == "growing" and motion.duration < motion.move.time(1.0)


def test_no_way_is_no_move():
    assert simulate(Servo(), "switch", 0.04, set_point=0.0, time=5.0, move=MOVES[0][0]).verdict.kind == "at rest"


@pytest.mark.parametrize(("call", "said"), [
    (lambda: Move(speed=0.0, acceleration=1.0), "speed = 0"),
    (lambda: Move(speed=1.0, acceleration=math.nan), "acceleration"),
    (lambda: Move(speed=1.0, acceleration=1.0, jerk=-1.0), "jerk"),
    (lambda: simulate(Servo(), "switch", 0.04, time=2.0, move=Move(speed=0.5, acceleration=2.0)),
     "must be longer than the move, which takes 2.25 s"),
    (lambda: remedies(Servo(), "switch", 0.04, step=-1.0), "step"),
    (lambda: simulate(Servo(), "switch", 0.04, move=0.5), "move = 0.5"),
    (lambda: remedies(Servo(), "switch", 0.04, move=0.5), "move = 0.5"),
])  # fmt: skip
def test_bad_input(call, said):
    with pytest.raises(InputError, match=said):
        call()


@pytest.mark.slow
def test_a_filter_of_the_error_sees_the_move_too():
    """Of a short time it is nearly none: what it delays is the error that remains of the move."""
    plain, move = loop_of(Servo(), "switch", 0.04), Move(speed=0.5, acceleration=2.0)
    where = np.linspace(0.0, 6.0, 25)
    x = [
        simulate(loop, time=6.0, move=move).sample(where)[0]
        for loop in (plain, with_remedy(plain, remedy_of("error filter", "switch"), 1e-3))
    ]
    assert x[1] == pytest.approx(x[0], abs=5e-3) and np.ptp(x[0]) > 1


@pytest.mark.slow
def test_a_row_of_another_thread_speaks_of_the_axis():
    """Of a linear one in mm, which no other thread or process knows by itself."""
    servo = load(Path(__file__).parents[2] / "problems" / "ball_screw.toml")
    with ThreadPoolExecutor(1) as executor:
        found = remedies(servo, "switch", 1.0, only=["error dead band"], step=5e-3, executor=executor)
    assert found.remedies[0].why.startswith("hunting goes on up to 1.144 mm")
