"""Friction that falls from the first motion on, exp(-|v|/vs): hunting ends with no fold, it shrinks to nothing.

Next to the set point all is linear, J x''' + (kd + b - (Fs - Fc)/vs) x'' + kp x' + ki x = 0 from a stop at x = -1 to
the next one: that is as far on the other side at the gain at which hunting ends.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from casahunt import find_fold, find_orbit, fold_curve, remedies
from casahunt.continuation import Vanishing, follow
from casahunt.errors import NoOrbit
from casahunt.servo.parts import INERTIA, INTEGRATOR, PID_BY_TIMES, WITH_EXPONENT, Loop
from casahunt.servo.stable_up_to import stable_ranges

TIGHT = {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853"}


def falling(exponent=1.0, **values):
    parts = (INERTIA, WITH_EXPONENT, PID_BY_TIMES, INTEGRATOR)
    return Loop(parts, {"gain": 0.4, "stribeck_exponent": exponent, **values})


def stops_at(loop, gain):
    p = {**loop.parameters, "gain": gain}
    k = p["motor_gain"] * gain
    kp, kd, ki = k * (1 + p["lead_time"] / p["integral_time"]), k * p["lead_time"], k / p["integral_time"]
    damping = kd + p["viscous"] - (p["static"] - p["coulomb"]) / p["stribeck_velocity"]

    def stands(_, z):
        return z[1]

    stands.terminal, stands.direction = True, -1
    rate = lambda _, z: [z[1], z[2], -(damping * z[2] + kp * z[1] + ki * z[0]) / p["inertia"]]  # noqa: E731
    return solve_ivp(rate, (0, 5), [-1, 0, 0], events=stands, first_step=1e-3, **TIGHT).y[0, -1]


def ends_at(loop):
    return brentq(lambda gain: stops_at(loop, gain) - 1, 0.5, 1.6, xtol=1e-13)


@pytest.mark.parametrize("values", [{}, {"viscous": 0.6}, {"static": 0.5, "stribeck_velocity": 0.015}])
def test_the_gain_at_which_hunting_shrinks_to_nothing(values):
    loop = falling(**values)
    end, truth = find_fold(loop), ends_at(loop)
    assert isinstance(end, Vanishing)
    assert abs(end.value - truth) <= end.absolute_error < 1e-9
    assert stable_ranges(end, loop)[-1][1] == end.value


def test_what_that_gain_hangs_on():
    end = find_fold(falling())
    for name in ("static", "stribeck_velocity", "viscous", "inertia"):
        value = falling().parameters[name]
        step = 1e-4 * value
        slope = (ends_at(falling(**{name: value + step})) - ends_at(falling(**{name: value - step}))) / (2 * step)
        assert end.sensitivities[name] == pytest.approx(slope, rel=1e-3)


def test_a_branch_that_comes_to_rest():
    branch = follow(find_orbit(falling()), "gain", to=3.0)
    assert branch.end.kind == "comes to rest" and not branch.special and not branch.missed
    assert abs(branch.end.value - ends_at(falling())) <= branch.end.error < 1e-9
    assert (branch.end.exponent, branch.end.period_exponent) == pytest.approx((1.0, -1.0), abs=0.01)


def test_friction_that_falls_as_steeply_as_one_likes_hunts_at_every_gain():
    with pytest.raises(NoOrbit, match="has shrunk to .* of what it was at gain = .*no value of gain is seen"):
        find_fold(falling(0.7))


def test_a_state_that_passes_zero_is_no_rest():
    """The fold of the exponent 2, which swings a millionth of a radian at its border, is one."""
    assert not isinstance(find_fold(falling(2.0)), Vanishing)
    assert np.isfinite(find_fold(falling(1.1)).value)


@pytest.mark.slow
def test_the_gain_as_a_remedy():
    (gain,) = remedies(falling(), only=["gain"]).remedies
    assert gain.kind == "comes to rest" and abs(gain.size - ends_at(falling())) <= gain.size_error < 1e-6


def test_there_is_no_curve_of_folds():
    with pytest.raises(NoOrbit, match="without a fold, its swings shrink to nothing"):
        fold_curve(falling(), None, vary="viscous", start=0.1, end=0.2)
