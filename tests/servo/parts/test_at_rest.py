"""Where filters of the error begin: where they are after the servo has stood still, so that a step is no kick."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import Drive, Move, simulate, simulate_sampled
from casahunt.design.tune.demands import at_the_start
from casahunt.servo.parts import (
    DEAD_BAND,
    DERIVATIVE_FILTER,
    DERIVATIVE_FILTER_BY_N,
    ERROR_FILTER,
    INERTIA,
    INTEGRATOR,
    P_PI,
    PID_BY_GAINS,
    SWITCH,
    Loop,
)

KP, KI, KD, TF = 20.0, 15.0, 0.9, 2e-3
NUMBERS = {"gain": 1.0, "motor_gain": 1.0, "kp": KP, "ki": KI, "kd": KD, "derivative_filter": TF}
AXIS = Loop((INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR, DERIVATIVE_FILTER), NUMBERS)


def first_swing():
    """Turning point and largest torque of a step of 1 rad: the derivative's filter has seen the error for long."""
    J, Fs, Fc, vs, viscous = (AXIS.value(n) for n in ("inertia", "static", "coulomb", "stribeck_velocity", "viscous"))

    def torque(y):
        return -KP * y[0] - KI * y[2] - KD * (y[0] - y[3]) / TF

    def rates(_, y):
        friction = Fc + (Fs - Fc) * np.exp(-((y[1] / vs) ** 2)) + viscous * y[1]
        return [y[1], (torque(y) - friction) / J, y[0], (y[0] - y[3]) / TF]

    def stops(_, y):
        return y[1] + 1e-12

    stops.terminal, stops.direction = True, -1
    found = solve_ivp(rates, (0, 5), [-1.0, 0.0, 0.0, -1.0], "Radau", events=stops, rtol=1e-10, atol=1e-13)
    return found.y[0, -1], max(abs(torque(y)) for y in found.y.T)


def test_a_step_is_no_kick():
    """Largest torque and turning point are those of another integrator; kd/Tf would ask for 470 N m at once."""
    turns, peak = first_swing()
    motion = simulate(AXIS, time=1.0)
    assert max(motion.states[0]) == pytest.approx(turns, abs=1e-7)
    assert motion.peak_torque == pytest.approx(peak, rel=1e-6) and peak == pytest.approx(KP, rel=1e-4)
    assert at_the_start(AXIS, "torque", -1.0) == pytest.approx(KP, rel=1e-6)


def test_as_built_it_begins_in_the_same_way():
    """With samples of 20 us the drive asks for as much as the continuous loop does."""
    built = simulate_sampled(AXIS, drive=Drive(sample_time=2e-5), time=0.05)
    assert built.peak_torque == pytest.approx(KP, rel=1e-3)


@pytest.mark.parametrize("last", [DERIVATIVE_FILTER, DERIVATIVE_FILTER_BY_N])
@pytest.mark.parametrize("first", [None, ERROR_FILTER, DEAD_BAND])
def test_every_filter_stands(first, last):
    """Whatever is in front of it: beside the set point, at rest, no state of a filter moves."""
    sizes = {each.size: 0.01 for each in (first, last) if each is not None}
    parts = (INERTIA, SWITCH, P_PI, INTEGRATOR, last, *([first] if first is not None else []))
    loop = Loop(parts, sizes | {"gain": 1.0, "motor_gain": 1.0})
    for angle in (-1.0, 0.3, 0.0):
        start = loop.at_rest(angle)
        mode = loop.mode_at(**start)
        field = loop.system.vector_form.modes[mode]
        rates = np.asarray(field.field(np.array(list(start.values())), loop.system.values(None), field.sign)).ravel()
        still = [state for part in loop.parts for state in part.stands]
        assert len(still) == len(sizes) - (first is DEAD_BAND)
        assert all(rates[list(start).index(state)] == 0 for state in still)


def test_a_filter_that_is_given_is_left_where_it_is():
    kicked = simulate(AXIS, time=0.01, start={"lagging": 0.0})
    assert kicked.peak_torque == pytest.approx(KP + KD / TF, rel=1e-6)


def test_before_a_move_the_error_is_zero():
    """The set point begins where the servo stands: a filter that had the whole way in it would drive it off."""
    loop = Loop((*AXIS.parts, ERROR_FILTER), NUMBERS | {"filter_time": 1e-3})
    motion = simulate(loop, time=3.0, move=Move(speed=1.0, acceleration=4.0))
    first = dict(zip(motion.motion.system.states, motion.motion.phases[0].start, strict=True))
    assert (first["x1"], first["filtered"], first["lagging"]) == (-1.0, 0.0, 0.0)
    assert motion.peak_torque < KP / 2
