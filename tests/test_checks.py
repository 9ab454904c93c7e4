"""What is of the wrong type is refused at once, in a sentence that says what it is and what is wanted."""

from __future__ import annotations

import re
from decimal import Decimal

import numpy as np
import pytest

import casahunt
from casahunt import Controller, Friction, InputError, Options, Pid, Servo, Uncertainty
from casahunt.checks import choice_of
from casahunt.continuation import follow
from casahunt.motion import simulate as simulate_system
from casahunt.orbits import find_cycle
from casahunt.servo.linear.linear_loop import linear_loop

SERVO = Servo()
A_SERVO = "must be a Servo, such as Servo(inertia=0.02); load(path) reads one from a file"
UNCERTAIN = Uncertainty({"friction.static": (0.52, 0.54)})
TAKE_A_SERVO = {
    "find_orbit": lambda s: casahunt.find_orbit(s, "switch", 0.1),
    "find_fold": lambda s: casahunt.find_fold(s, "switch"),
    "simulate": lambda s: casahunt.simulate(s, "switch", 0.1),
    "tune": lambda s: casahunt.tune(s, "switch"),
    "diagram": lambda s: casahunt.diagram(s, "switch"),
    "fold_curve": lambda s: casahunt.fold_curve(s, "switch", vary="friction.static", start=0.5, end=0.6),
    "fold_map": lambda s: casahunt.fold_map(s, "switch", ("friction.static", "friction.viscous"), [1, 2], [1, 2]),
    "fold_ensemble": lambda s: casahunt.fold_ensemble(s, "switch", ["friction.static"], [[0.5]]),
    "orbit_ensemble": lambda s: casahunt.orbit_ensemble(s, "switch", 0.1, ["friction.static"], [[0.5]]),
    "sample_fold_gains": lambda s: casahunt.sample_fold_gains(s, "switch", UNCERTAIN, 2),
    "worst_corner": lambda s: casahunt.worst_corner(s, "switch", UNCERTAIN),
    "basin": lambda s: casahunt.basin(s, "switch", 0.1),
    "equilibria": lambda s: casahunt.equilibria(s, "switch", 0.1),
    "linear_loop": lambda s: casahunt.linear_loop(s, 0.1),
    "margins": lambda s: casahunt.margins(s, 0.1),
    "fixed_points": lambda s: casahunt.fixed_points(s, 0.1),
    "no_cycle": lambda s: casahunt.no_cycle(s, "switch"),
}


@pytest.mark.parametrize("name", TAKE_A_SERVO)
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("servo.toml", "servo = 'servo.toml' (of type str): "),
        ({"inertia": 0.1}, "servo = {'inertia': 0.1} (of type dict): "),
        (None, "servo = None (of type NoneType): "),
        (Servo, "(the class Servo itself): "),
    ],
)
def test_what_is_no_servo(name, wrong, said):
    with pytest.raises(InputError, match=re.escape(said + A_SERVO)):
        TAKE_A_SERVO[name](wrong)


REFUSED = {
    "servo.inertia = '0.1': must be a finite number": lambda: Servo(inertia="0.1"),
    "servo.inertia = None: must be a finite number": lambda: Servo(inertia=None),
    "servo.inertia = True: must be a finite number": lambda: Servo(inertia=True),
    "servo.inertia = np.True_: must be a finite number": lambda: Servo(inertia=np.True_),
    "servo.inertia = array([0.1]): must be a finite number": lambda: Servo(inertia=np.array([0.1])),
    "servo.motor_gain = 1j: must be a finite number": lambda: Servo(motor_gain=1j),
    "friction = {'static': 0.5} (of type dict): must be a Friction": lambda: Servo(friction={"static": 0.5}),
    "friction = Controller(": lambda: Servo(friction=Controller()),
    "controller = None (of type NoneType): must be a Controller": lambda: Servo(controller=None),
    "friction.static = '0.5': must be a finite number": lambda: Friction(static="0.5"),
    "controller.lead_time = [0.1]: must be a finite number": lambda: Controller(lead_time=[0.1]),
    "controller.kp = '1': must be a finite number": lambda: Pid(kp="1", ki=6, kd=0.1),
    "friction.static = '0.5': must be": lambda: SERVO.replace(**{"friction.static": "0.5"}),
    "tol = '1e-8': must be a finite number": lambda: Options(tol="1e-8"),
    "unknown solver 'newtn'; did you mean 'newton'?": lambda: Options(solver="newtn"),
    "degree = 2.5: must be a whole number, at least 1": lambda: Options(degree=2.5),
    "degree = -1: must be a whole number": lambda: Options(degree=-1),
    "degree = '3': must be a finite number": lambda: Options(degree="3"),
    "half = 1 (of type int): must be a bool": lambda: Options(half=1),
    "intervals = [('friction.static', (0.5, 0.6))] (of type list)": lambda: Uncertainty(
        [("friction.static", (0.5, 0.6))]
    ),
    "friction.static = 0.5: must be an interval": lambda: Uncertainty({"friction.static": 0.5}),
    "names = 'friction.static': must be a list": lambda: Uncertainty(names="friction.static", covariance=[[1.0]]),
    "options = 1e-08 (of type float): must be an Options": lambda: casahunt.find_orbit(
        SERVO, "switch", 0.1, options=1e-8
    ),
    "options = {'tol': 1e-08} (of type dict)": lambda: casahunt.find_fold(SERVO, "switch", options={"tol": 1e-8}),
    "gain = '0.1': must be a finite number": lambda: casahunt.find_orbit(SERVO, "switch", "0.1"),
    "model = 3: must be one of switch, lugre": lambda: casahunt.find_orbit(SERVO, 3, 0.1),
    "unknown model 'swich'; did you mean 'switch'?": lambda: casahunt.simulate(SERVO, "swich", 0.1),
    "uncertainty = {'friction.static': (0.5, 0.6)} (of type dict)": lambda: casahunt.tune(
        SERVO, "switch", uncertainty={"friction.static": (0.5, 0.6)}
    ),
    "uncertainty = 'friction.toml' (of type str)": lambda: casahunt.worst_corner(SERVO, "switch", "friction.toml"),
    "demands = 0.2 (of type float): must be a Demands": lambda: casahunt.tune(SERVO, "switch", demands=0.2),
    "unknown free 'lead'": lambda: casahunt.tune(SERVO, "switch", free="lead"),
    "system = 'belt' (of type str): must be a System": lambda: find_cycle("belt", x=0.0),
    "system = None (of type NoneType)": lambda: simulate_system(None, duration=1.0, x=0.0),
    "orbit = 'orbit.npz' (of type str): must be an Orbit": lambda: follow("orbit.npz", "belt", to=1.0),
    "record = 3 (of type int): must be a Record": lambda: casahunt.measure(3),
}


@pytest.mark.parametrize("said", REFUSED)
def test_the_sentence_of_a_refusal(said):
    with pytest.raises(InputError, match=re.escape(said)):
        REFUSED[said]()


NUMBERS = (np.float32(0.03), np.float64(0.03), np.array(0.03), Decimal("0.03"), np.int64(3), 3)


@pytest.mark.parametrize("number", NUMBERS)
def test_numbers_of_other_kinds_are_numbers(number):
    """And are computed with in full: a float32 among them would leave seven digits of everything."""
    servo, plain = Servo(inertia=number, friction=Friction(viscous=number)), Servo(inertia=float(number))
    assert type(servo.inertia) is float and type(servo.friction.viscous) is float and servo.inertia == float(number)
    assert type(Controller(lead_time=number).lead_time) is float and type(Pid(kp=number, ki=1, kd=0).ki) is float
    plain = plain.replace(**{"friction.viscous": float(number)})
    assert servo == plain and linear_loop(servo, 0.1).poles.tolist() == linear_loop(plain, 0.1).poles.tolist()


def test_names_with_a_comma_are_told_apart():
    with pytest.raises(InputError, match=r"\(known: two masses, 'two masses, load measured'\)"):
        choice_of("part", "three masses", ["two masses", "two masses, load measured"])
