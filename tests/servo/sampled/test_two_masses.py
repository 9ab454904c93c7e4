"""Two masses under a drive: against scipy's motion between samples, whose controller is written out by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from casahunt import Drive, InputError, as_built, load, simulate_sampled
from casahunt.servo.parts import (
    CLAMPING,
    INERTIA,
    INTEGRATOR,
    P_PI_FILTERED,
    PID_BY_GAINS,
    SWITCH,
    TWO_MASSES,
    TWO_MASSES_LOAD_SEEN,
    Loop,
    Part,
)
from casahunt.servo.parts.verbs import loop_cycle
from casahunt.servo.sampled.plant import Plant, plant_of

PROBLEMS = Path(__file__).parents[3] / "problems"
BELT = {
    "inertia": 4e-4, "load_inertia": 1.6e-3, "shaft_stiffness": 60.0, "shaft_damping": 0.01, "motor_gain": 1.0,
    "kp": 2.0, "ki": 12.0, "kd": 0.06, "gain": 1.0, "static": 0.25, "coulomb": 0.18, "stribeck_velocity": 0.05,
    "viscous": 0.002,
}  # fmt: skip
DRIVE = Drive(sample_time=1e-3, encoder=8192, delay=1.4e-3)
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15}


def belt(plant: Part = TWO_MASSES, *more: Part, **values: float) -> Loop:
    """A motor with friction, a shaft and a load."""
    return Loop((plant, SWITCH, PID_BY_GAINS, INTEGRATOR, *more), {**BELT, **values})


def moved(x: np.ndarray, m: float, lasts: float) -> np.ndarray:
    """x1, x2, load angle, load rate after a torque: slips and sticks, event by event."""
    J, JL, k, d = (BELT[name] for name in ("inertia", "load_inertia", "shaft_stiffness", "shaft_damping"))
    Fs, Fc, vs, b = (BELT[name] for name in ("static", "coulomb", "stribeck_velocity", "viscous"))

    def shaft(y):
        return k * (y[0] - y[2]) + d * (y[1] - y[3])

    t = 0.0
    while t < lasts:
        pull = m - shaft(x)
        s = math.copysign(1, x[1]) if x[1] else math.copysign(1, pull) if abs(pull) > Fs else 0

        def slip(_, y, s=s):
            friction = s * (Fc + (Fs - Fc) * math.exp(-((y[1] / vs) ** 2))) + b * y[1]
            return [y[1], (m - shaft(y) - friction) / J, y[3], shaft(y) / JL]

        def stick(_, y):
            return [0, 0, y[3], shaft(y) / JL]

        events = [(lambda _, y: y[1])] if s else [(lambda _, y, w=w: w * (m - shaft(y)) - Fs) for w in (1, -1)]
        for event in events:
            event.terminal, event.direction = True, -s if s else 1
        found = solve_ivp(slip if s else stick, (t, lasts), x, events=events, **TIGHT)
        x, t = found.y[:, -1], found.t[-1]
        if found.status == 1 and s:
            x[1] = 0.0
        elif found.status == 1:
            x[1] = math.copysign(1e-18, m - shaft(x))
    return x


CASCADE = {"position_gain": 30.0, "velocity_gain": 0.06, "reset_time": 0.05, "velocity_filter": 4e-3}
"""Of a P-PI whose velocity is filtered."""


def cascade(T: float, start: float):
    """The law of a P-PI cascade as it is programmed, m of the error that is read; start: the sum of velocities."""
    Kp, Kv, Tn, Tf = CASCADE.values()
    speed, summed, last = 0.0, start, None

    def law(e: float) -> float:
        nonlocal speed, summed, last
        speed += T / (T + Tf) * ((0.0 if last is None else (e - last) / T) - speed)
        last = e
        u = Kp * e + speed
        summed += T * u
        return -Kv * (u + summed / Tn)

    return law


def by_hand(drive: Drive, samples: int, x: np.ndarray, ki: float, *, load_seen: bool, law=None) -> np.ndarray:
    """(samples + 1, 5) x1, x2, x3, load angle, load rate at the samples; set point 0; law: of another controller."""
    T, q, sum_, states = drive.sample_time, drive.count, 0.0, []
    late, part = divmod(drive.delay, T)
    waiting, last = [0.0] * (int(late) + 1), None
    for _ in range(samples):
        states.append([x[0], x[1], sum_, x[2], x[3]])
        e = q * math.floor(x[2 if load_seen else 0] / q + 0.5)
        sum_ += T * e
        rate = 0.0 if last is None else (e - last) / T
        last = e
        waiting.append(law(e) if law else -(BELT["kp"] * e + ki * sum_ + BELT["kd"] * rate))
        before = waiting.pop(0)
        x = moved(moved(x, before, part), waiting[0], T - part)
    return np.array([*states, [x[0], x[1], sum_, x[2], x[3]]])


@pytest.mark.parametrize("plant", [TWO_MASSES, TWO_MASSES_LOAD_SEEN])
def test_another_program_has_the_same_motion(plant):
    """Slips, a stop while the load rings on, a stick, and the next slip; up to where a count decides otherwise."""
    start = np.array([-0.3, 0.0, -0.3, 0.0])
    theirs = by_hand(DRIVE, 400, start, 60.0, load_seen=plant is TWO_MASSES_LOAD_SEEN)
    motion = simulate_sampled(belt(plant, ki=60.0), None, DRIVE, set_point=0.0, position=-0.3, time=0.4)
    ours = motion.states[[motion.names.index(n) for n in ("x1", "x2", "x3", "load_angle", "load_rate")]].T
    sizes = np.abs(theirs).max(axis=0)
    assert (theirs[:, 1] == 0).sum() > 20 and (np.abs(np.diff(theirs[:, 1] != 0)) > 0).sum() >= 3
    assert (np.abs(ours - theirs) / sizes).max() < 1e-8


def test_a_cascade_that_filters_its_velocity_is_run_as_it_is_programmed():
    begins = -391 * DRIVE.count
    start, law = np.array([begins, 0.0, begins, 0.0]), cascade(DRIVE.sample_time, begins)
    theirs = by_hand(DRIVE, 400, start, 0.0, load_seen=False, law=law)[:, [0, 1, 3, 4]]
    shared = {name: value for name, value in BELT.items() if name not in ("kp", "ki", "kd")}
    loop = Loop((TWO_MASSES, SWITCH, P_PI_FILTERED, INTEGRATOR), {**shared, **CASCADE})
    motion = simulate_sampled(loop, None, DRIVE, set_point=0.0, position=begins, time=0.4)
    ours = motion.states[[motion.names.index(name) for name in ("x1", "x2", "load_angle", "load_rate")]].T
    assert (theirs[:, 1] == 0).sum() > 20
    assert np.abs(ours - theirs).max(axis=0) == pytest.approx(0, abs=1e-7 * np.abs(theirs).max())


def test_its_limit_is_the_continuous_loop():
    """Whose cycle collocation has; what is left is of first order in the sample time."""
    cycle, motion = loop_cycle(belt()), simulate_sampled(belt(), None, Drive(sample_time=1e-4), time=20.0)
    assert motion.verdict.amplitude == pytest.approx(cycle.amplitude, rel=1e-3)
    assert motion.verdict.period == pytest.approx(cycle.period, rel=1e-3)


def test_it_rests_for_ever_though_its_load_still_rings():
    """The proof of rest is not a claim: the load rings down as its linear motion says, and the motor never moves."""
    drive = Drive(sample_time=1e-3, encoder=8192, dead_band=0.03)
    motion = simulate_sampled(belt(), None, drive, time=6.0)
    k = round(motion.rests_since / 1e-3)
    rate = motion.states[motion.names.index("load_rate")]
    assert motion.verdict.kind == "at rest" and np.abs(rate[k]) > 1e-4
    assert np.ptp(motion.states[0, k:]) == 0 and not motion.states[1, k:].any()
    load = motion.states[motion.names.index("load_angle")] - motion.states[0]
    damped, w = BELT["shaft_damping"] / 2 / BELT["load_inertia"], math.sqrt(BELT["shaft_stiffness"] / 1.6e-3)
    t, own = 1e-3 * np.arange(load.size - k), math.sqrt(w**2 - damped**2)
    exact = np.exp(-damped * t) * (load[k] * np.cos(own * t) + (rate[k] + damped * load[k]) / own * np.sin(own * t))
    assert load[k:] == pytest.approx(exact, abs=1e-9 * np.abs(load[k:]).max() + 1e-14)


def test_a_load_that_rings_enough_breaks_it_away_again():
    """The torque alone would hold it."""
    motion = simulate_sampled(
        belt(), None, Drive(sample_time=1e-3, dead_band=1.0), set_point=0.0, time=0.2, start={"load_rate": 2.0},
    )
    assert np.abs(motion.torque).max() < BELT["static"] and np.ptp(motion.states[0]) > 1e-3


@pytest.mark.parametrize("beyond", [-1e-12, 0.0, 2e-14, 1.677e-11, 1e-9])
def test_on_the_verge_of_breaking_away_rounding_does_not_go_to_and_fro(beyond):
    """Where the pull is that of static friction to 1e-14 N, slip and stick follow each other in no time."""
    axis = load(PROBLEMS / "belt_axis.toml")
    stuck = {"x1": -0.00014852620603278549, "load_angle": -0.00014852620603995252, "load_rate": 1.4325678052831546e-11}
    plant = Plant(plant_of(axis)[0], stuck)
    assert len(plant(75.0 + beyond, 5.4e-4)) <= 3
    k, d, b = 4e6, 2000.0, 300.0  # it slips so little that friction stays 75 N, and the load draws it on
    A = np.array([[0, 1, 0, 0], [-k / 6, -(d + b) / 6, k / 6, d / 6], [0, 0, 0, 1], [k / 20, d / 20, -k / 20, -d / 20]])
    start = [0.0, 0.0, stuck["load_angle"] - stuck["x1"], stuck["load_rate"]]
    exact = expm(5.4e-4 * np.block([[A, np.array([[0], [beyond / 6], [0], [0]])], [np.zeros((1, 5))]])) @ [*start, 1.0]
    assert plant.x[1] == pytest.approx(exact[1], rel=1e-3)


def test_clamping_is_that_of_the_samples():
    """At its limit the sum stands; nothing that the drive asks for is beyond it."""
    motion = simulate_sampled(belt(TWO_MASSES, CLAMPING, torque_limit=0.6), None, DRIVE, time=2.0)
    w, limited = motion.states[motion.names.index("x3")], np.abs(motion.torque) >= 0.6
    assert np.abs(motion.torque).max() == 0.6 and limited[1:200].sum() > 20
    assert np.all(np.diff(w)[limited] == 0) and not np.all(np.diff(w)[~limited] == 0)


def test_a_check_as_built_takes_it():
    assert as_built(belt(ki=40.0), None, Drive(sample_time=2e-3, encoder=2000, dead_band=0.05)).kind == "at rest"


def test_what_no_motor_moves_is_refused():
    with pytest.raises(InputError, match="no part of it is moved by the motor"):
        plant_of(Loop((PID_BY_GAINS, INTEGRATOR)))


@pytest.mark.parametrize("rule", ["rectangle", "trapezoid"])
@pytest.mark.parametrize("sample_time", [2e-3, 3.37e-3, 1e-2])
def test_nothing_goes_out_beyond_the_limit(sample_time, rule):
    """Where the sum leads beyond it when it is on, and back when it is off: 0.146 N m went out of 0.137."""
    values = {
        "inertia": 0.00251, "static": 0.122, "coulomb": 0.0649, "stribeck_velocity": 0.0821, "viscous": 0.0259,
        "motor_gain": 1.0, "gain": 1.0, "kp": 0.81, "ki": 6.21, "kd": 0.0795, "torque_limit": 0.137,
    }  # fmt: skip
    axis = Loop((INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR, CLAMPING), values)
    motion = simulate_sampled(axis, None, Drive(sample_time=sample_time, integration=rule), time=3.0)
    assert np.abs(motion.torque).max() == 0.137
    x3, limited = motion.states[motion.names.index("x3")], np.abs(motion.torque) == 0.137
    half = 0.5 * sample_time * np.abs(motion.states[0]).max() if rule == "trapezoid" else 0.0  # of the sample before
    assert np.abs(np.diff(x3)[limited]).max() <= half
