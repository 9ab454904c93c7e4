"""A plant, a controller and a remedy that nobody here wrote (strangers.py): every verb answers for them, and rightly.

Truths: three masses with stiff shafts are one inertia; the controller is a transfer function; the remedy by scipy's
DOP853 from slip to slip, with sticks in closed form.
"""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import (
    Drive,
    Servo,
    basin,
    equilibria,
    find_fold,
    find_orbit,
    fold_curve,
    linear_loop,
    margins,
    remedies,
    simulate,
    simulate_sampled,
)
from casahunt.servo.parts import (
    INERTIA,
    INTEGRATOR,
    PID_BY_GAINS,
    PID_BY_TIMES,
    REMEDIES,
    SWITCH,
    Loop,
    transfer_function,
)
from tests.servo.strangers import FORGETS_WHERE_IT_STANDS, OBSERVING_PI, STANDING_LEAK, THREE_MASSES

FRICTION = {"static": 0.8, "coulomb": 0.55, "stribeck_velocity": 0.08, "viscous": 0.02}
PID = {"motor_gain": 1.0, "gain": 1.0, "kp": 4.0, "ki": 30.0, "kd": 0.12}
LOOPS = {
    "three masses": Loop((THREE_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), PID | FRICTION),
    "observing PI": Loop((INERTIA, SWITCH, OBSERVING_PI), {"inertia": 0.0056} | FRICTION),
    "standing leak": Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR, STANDING_LEAK), {"standing_leak": 0.05}),
}
DRIVE = Drive(sample_time=1e-3, encoder=200_000)
VERBS = {
    "find_orbit": lambda loop: find_orbit(loop).error_estimate < 1e-6,
    "find_fold": lambda loop: find_fold(loop).value_error < 1e-6,
    "fold_curve": lambda loop: fold_curve(
        loop, vary="static", start=loop.value("static"), end=1.01 * loop.value("static")).status.ok,
    "simulate": lambda loop: simulate(loop, time=2.0).status.ok,
    "simulate_sampled": lambda loop: simulate_sampled(loop, drive=DRIVE, time=0.5).peak_torque > 0,
    "equilibria": lambda loop: equilibria(loop).position_limit > 0,
    "linear_loop": lambda loop: linear_loop(loop).stable,
    "margins": lambda loop: margins(loop).phase_margin > 0,
    "margins as built": lambda loop: margins(loop, drive=DRIVE).phase_margin > 0,
    "basin": lambda loop: basin(loop).confirmed,
    "remedies": lambda loop: remedies(loop, only=["leak"]).best == "leak",
    "another process": lambda loop: pickle.loads(pickle.dumps(loop)).parts == loop.parts,
}  # fmt: skip
SLOW = "remedies", "basin", "fold_curve"


@pytest.mark.parametrize("verb", [pytest.param(v, marks=pytest.mark.slow) if v in SLOW else v for v in VERBS])
@pytest.mark.parametrize("name", LOOPS)
def test_every_verb_answers(verb, name):
    if (verb, name) != ("remedies", "standing leak"):  # two leaks of one integrator do not go together
        assert VERBS[verb](LOOPS[name])


def test_every_remedy_goes_to_another_process():
    for remedy in (*REMEDIES, FORGETS_WHERE_IT_STANDS):
        sent = pickle.loads(pickle.dumps(remedy))
        assert (sent.name, sent.part, sent.rests) == (remedy.name, remedy.part, remedy.rests)


def test_three_masses_with_stiff_shafts_are_one_inertia():
    """Their cycle differs from that of the sum by as much less as the shafts are stiffer."""
    rigid = find_orbit(Loop((INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR), {"inertia": 0.0056} | PID | FRICTION))
    soft = {"shaft_stiffness": 180.0, "belt_stiffness": 400.0}
    off = []
    for stiffer in (30.0, 90.0):
        stiff = {name: stiffer * k for name, k in soft.items()} | {"shaft_damping": 5.0, "belt_damping": 5.0}
        off.append(abs(find_orbit(LOOPS["three masses"].replace(**stiff)).amplitude / rigid.amplitude - 1))
    assert off[0] < 4e-3 and off[1] < 0.4 * off[0]


def test_a_controller_that_observes_is_its_transfer_function():
    kp, ki, kd, late = 4.0, 30.0, 0.12, 1e-3
    same = transfer_function([kd + kp * late, kp + ki * late, ki], [late, 1.0, 0.0])
    numbers = {"inertia": 0.0056, "motor_gain": 1.0, "gain": 1.0} | FRICTION
    cycle, other = find_orbit(LOOPS["observing PI"]), find_orbit(Loop((INERTIA, SWITCH, same), numbers))
    assert (cycle.period, cycle.amplitude) == pytest.approx((other.period, other.amplitude), rel=1e-8)


def test_a_drive_runs_a_controller_by_its_own_rule():
    """Of an angle that grows by v T in a sample the observed rate is v (1 - exp(-n T/T_f)) to rounding."""
    T, v, n = 1e-3, 0.7, 25
    loop = LOOPS["observing PI"].replace(forgetting_time=4e-3)
    moved = simulate_sampled(
        loop.replace(gain=1e-12, static=1e-12, coulomb=0.0, viscous=0.0), drive=Drive(sample_time=T), time=n * T,
        set_point=0.0, position=0.1, velocity=v,
    )  # fmt: skip
    seen = moved.states[moved.names.index("rate_seen")]
    assert seen[1:n] == pytest.approx(v * (1 - np.exp(-T / 4e-3 * np.arange(n - 1))), abs=1e-9)  # a rate needs two


def stops(leak: float, start: float, most: int) -> list[float]:
    """Places at which Table 1's servo at 0.04 V/rad stops, from rest beside the set point, until it stays."""
    servo, f = Servo(), Servo().friction
    kp, kd, ki = servo.torque_gains(0.04)
    x, w, found = start, 0.0, []
    for _ in range(most):
        # stuck: w goes to x/leak, and it breaks away where |kp x + ki w| = Fs
        goes_to, breaks = x / leak, (math.copysign(f.static, x) - kp * x) / ki
        if abs(kp * x) < f.static:
            if not (breaks - goes_to) * (w - goes_to) > 0:
                return found
            w = breaks
        sign = -math.copysign(1.0, kp * x + ki * w)

        def slips(t, y, sign=sign):
            drop = (f.static - f.coulomb) * math.exp(-((y[1] / f.stribeck_velocity) ** 2))
            return [y[1], (-kp * y[0] - kd * y[1] - ki * y[2] - sign * (f.coulomb + drop) - f.viscous * y[1])
                    / servo.inertia, y[0]]  # fmt: skip

        def still(t, y, sign=sign):
            return sign * y[1]

        still.terminal, still.direction = True, -1
        slip = solve_ivp(slips, (0.0, 1e3), [x, sign * 1e-9, w], "DOP853", events=still, rtol=1e-11, atol=1e-13)
        x, _, w = slip.y[:, -1]
        found.append(x)
    return found


@pytest.mark.slow
def test_the_smallest_size_of_a_remedy_of_ones_own():
    """With 3 % less of it a motion hunts on; with 3 % more it stays from each of ten starts."""
    row = remedies(Servo(), "switch", 0.04, only=[FORGETS_WHERE_IT_STANDS]).remedies[0]
    assert row.ends_hunting and row.unit == "1/s"
    swings = stops(0.97 * row.size, -0.05, 200)
    assert len(swings) == 200 and np.abs(swings[-50:]).min() > 0.01
    for start in np.geomspace(0.01, 0.2, 10):
        assert len(stops(1.03 * row.size, -start, 200)) < 200
