"""Rest of an axis whose load is measured and rings: against a plain program that goes by small steps, and by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from casahunt import Drive, simulate_sampled
from casahunt.servo.parts import INTEGRATOR, PID_BY_GAINS, SWITCH, TWO_MASSES_LOAD_SEEN, Loop

AXIS = {
    "inertia": 0.02, "load_inertia": 0.02, "shaft_stiffness": 2000.0, "shaft_damping": 1.0, "motor_gain": 1.0,
    "gain": 1.0, "kp": 30.0, "ki": 100.0, "kd": 1.2, "static": 0.5, "coulomb": 0.35, "stribeck_velocity": 0.03,
    "viscous": 0.1,
}  # fmt: skip
T, STEPS, HALVINGS = 1e-3, 20, 60


def axis(**values: float) -> Loop:
    return Loop((TWO_MASSES_LOAD_SEEN, SWITCH, PID_BY_GAINS, INTEGRATOR), AXIS | values)


def plain(drive: Drive, samples: int, x: float, load_rate: float = 0.0, **values: float) -> np.ndarray:
    """(samples, 4) motor angle, load angle, sum, torque at the samples; from rest but for the load, set point 0.

    A slip goes by steps of Runge and Kutta, the last one cut where the motor stops; a stick by the matrix exponential.
    """
    p = AXIS | values
    J, JL, k, d, Fs, Fc = (
        p[name] for name in ("inertia", "load_inertia", "shaft_stiffness", "shaft_damping", "static", "coulomb")
    )
    h, y, sense, w, last, found = T / STEPS, np.array([x, 0.0, x, load_rate]), 0.0, 0.0, None, []

    def rung(t):
        return expm(t * np.array([[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [k / JL, 0, -k / JL, -d / JL]]))

    ring = rung(h)

    def rates(y, u):
        v, shaft = y[1], k * (y[0] - y[2]) + d * (y[1] - y[3])
        friction = sense * (Fc + (Fs - Fc) * math.exp(-((v / p["stribeck_velocity"]) ** 2))) + p["viscous"] * v
        return np.array([v, (u - shaft - friction) / J, y[3], shaft / JL])

    def slipped(y, u, h):
        a = rates(y, u)
        b = rates(y + h / 2 * a, u)
        c = rates(y + h / 2 * b, u)
        return y + h / 6 * (a + 2 * b + 2 * c + rates(y + h * c, u))

    for _ in range(samples):
        e = drive.count * math.floor(y[2] / drive.count + 0.5) if drive.count else y[2]
        w += T * (e * (abs(e) > drive.dead_band) - drive.leak * w)
        u = -(p["kp"] * e + p["ki"] * w + p["kd"] * (0.0 if last is None else (e - last) / T))
        last = e
        found.append([y[0], y[2], w, u])
        for _ in range(STEPS):
            pull = u - k * (y[0] - y[2]) + d * y[3]
            if not sense and abs(pull) > Fs:
                sense = math.copysign(1.0, pull)
            if not sense:
                y = ring @ y
                continue
            after = slipped(y, u, h)
            if sense * after[1] <= 0:
                low, high = 0.0, h
                for _ in range(HALVINGS):
                    middle = (low + high) / 2
                    low, high = (middle, high) if sense * slipped(y, u, middle)[1] > 0 else (low, middle)
                y, sense = slipped(y, u, high), 0.0
                y[1] = 0.0
                y = rung(h - high) @ y
            else:
                y = after
    return np.array(found)


@pytest.mark.parametrize("encoder", [20000, 0])
@pytest.mark.parametrize("stiffness", [2000.0, 900.0])
def test_it_rests_where_it_never_moves_again(stiffness, encoder):
    """The other program goes on for ten times as long, and stands where this one says so, with the same sum."""
    drive = Drive(sample_time=T, encoder=encoder, dead_band=0.02)
    motion = simulate_sampled(axis(shaft_stiffness=stiffness), None, drive, set_point=0.0, position=-0.2, time=8.0)
    theirs, k = plain(drive, 8000, -0.2, shaft_stiffness=stiffness), round(motion.rests_since / T)
    assert motion.verdict.kind == "at rest" and k < 2500
    assert np.ptp(theirs[k:, 0]) == 0 and np.abs(theirs[k:, 3]).max() < 0.5
    assert np.ptp(motion.states[0, k:]) == 0 and np.ptp(motion.states[motion.names.index("x3"), k:]) == 0
    assert motion.states[0, -1] == pytest.approx(theirs[-1, 0], abs=1e-6)
    assert motion.torque[-1] == pytest.approx(theirs[-1, 3], abs=1e-4)


@pytest.mark.parametrize("encoder", [20000, 0])
def test_with_a_smaller_dead_band_it_hunts(encoder):
    """It stands outside of it for seconds, while its load has rung down: its integral goes on."""
    drive = Drive(sample_time=T, encoder=encoder, dead_band=0.001)
    theirs = plain(drive, 12000, -0.2)
    stood = np.flatnonzero(np.diff(theirs[:, 0]) == 0)
    assert (np.diff(stood) > 1).sum() >= 3 and np.ptp(theirs[-4000:, 0]) > 0.004
    motion = simulate_sampled(axis(), None, drive, set_point=0.0, position=-0.2, time=80.0)
    assert motion.verdict.kind == "hunting" and math.isnan(motion.rests_since)


@pytest.mark.parametrize("encoder", [20000, 0])
def test_a_shaft_without_damping_is_no_rest(encoder):
    """Its load rings for ever; damped ever so little it rests, at once."""
    drive = Drive(sample_time=T, encoder=encoder, dead_band=0.02)
    start = {"set_point": 0.0, "position": 0.005, "time": 4.0, "start": {"load_rate": 1e-6, "load_angle": 0.005}}
    rings, damped = (simulate_sampled(axis(shaft_damping=d), None, drive, **start) for d in (0.0, 1e-2))
    assert np.ptp(rings.states[0]) == 0 and rings.verdict.kind != "at rest"
    assert np.ptp(damped.states[0]) == 0 and damped.verdict.kind == "at rest"


@pytest.mark.parametrize("encoder", [200000, 0])
def test_a_leak_holds_what_it_holds(encoder):
    """Stuck at x its torque goes to (kp + ki/leak) x: 0.5 N m at 2.17 mrad, from kp x in seconds."""
    drive = Drive(sample_time=T, encoder=encoder, leak=0.5)
    start = {"set_point": 0.0, "time": 12.0}
    held, lost = (
        simulate_sampled(axis(), None, drive, position=x, start={"load_angle": x, "load_rate": 1e-3}, **start)
        for x in (0.0021, 0.00225)
    )
    assert 0.00214 * (30 + 100 / 0.5) < 0.5 < 0.00222 * (30 + 100 / 0.5)  # a count of 31 urad beside either
    assert held.verdict.kind == "at rest" and np.ptp(held.states[0]) == 0
    breaks = np.flatnonzero(np.diff(lost.states[0]))
    assert breaks[0] > 4000 and not lost.rests_since < T * breaks[-1]


@pytest.mark.parametrize("encoder", [200000, 0])
@pytest.mark.parametrize(("load_rate", "kd"), [(1e-5, 1.2), (1e-4, 1.2), (1e-3, 1.2), (3e-5, 20.0)])
def test_it_is_not_at_rest_while_its_load_may_break_it_away(load_rate, kd, encoder):
    """Held by 0.4 mN m less than static friction; the load that rings adds to that by shaft and controller."""
    drive = Drive(sample_time=T, encoder=encoder, dead_band=0.02)
    x = 0.4996 / 30
    theirs = plain(drive, 100, x, load_rate, kd=kd)
    start = {"load_angle": x, "load_rate": load_rate}
    motion = simulate_sampled(axis(kd=kd), None, drive, set_point=0.0, position=x, start=start, time=0.1)
    moved = np.ptp(theirs[:, 0]) > 0
    assert (np.ptp(motion.states[0]) > 0) == moved
    assert not motion.rests_since < T * (np.flatnonzero(np.diff(theirs[:, 0]))[-1] if moved else 0)
