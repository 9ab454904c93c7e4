"""The hunting servo as a system: one inertia, its friction, a PID controller and the integrator, as parts (parts/).

Controller (see controller.py):   m = -(kp x1 + kd x2 + ki x3),   J x2' = m - F,   x1' = x2,   x3' = x1.

Switch friction, states (x1, x2, x3), a Filippov system with eta -> 0 (parts/switch.py):
    slip+, slip-   s x2 > 0:  F = s g(x2) + sigma2 x2, until x2 = 0 ("stop")
    stick          x2 = 0, x1 constant, x3' = x1, |m| <= Fs; closed form, until m = s Fs ("breakaway")
    at a stop with |m| > Fs the servo slips on with sign(m) at once: reversal without stick.
  Half cycle: slip+ | stick, closed by S = -I.

LuGre friction, states (x1, x2, x3, x4 = z), the kink |x2| split off as a mode (parts/lugre.py):
    slide+, slide-  s x2 >= 0: |x2| = s x2, until x2 = 0 ("reversal")
    slide           |x2| as it is, the mode that both are parts of: once the net torque at a reversal is below
                    `lugre.WEAK` Fs, the kink is too weak to deserve a phase boundary, and tiny reversals come and go
                    along a branch
  Half cycle: from x1 = 0 in mid-slip ("centre", always transversal) to the next one: slip, ring-down
  of alternating short slides, then the long stick and the take-off in the last phase.

Events are scaled to order one: velocities by vs, torques by Fs, x1 by Fs/kp.

Parameters are called by the last part of their names in a servo file: p.static is friction.static, Fs; p.sign is s.
The report's own form of the Switch servo is in scripts/report.

Report: Hensen, van de Molengraft and Steinbuch, DCT 2001.021, sections 3.1 and 3.2.

In the terms of the engine: x = (x1, x2, x3 [, x4]), p = servo.PARAMETERS or PID_PARAMETERS, whose length tells which.
Half a cycle closes by its mirror image, S = -I, the whole of it by itself (problem.py).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from ..compiled import kept
from ..hybrid import System
from .controller import Controller
from .friction import Model
from .parts.plain_loop import parts_of_servo
from .parts.product import modes_of
from .servo import Servo, called

STATES = {"switch": ("x1", "x2", "x3"), "lugre": ("x1", "x2", "x3", "x4")}
TITLES = {"switch": "servo with Switch friction", "lugre": "servo with LuGre friction"}
Kind = Literal["gauss", "radau"]
"""Collocation at Gauss points, for smooth fields, or at Radau IIA points, for stiff ones (`collocation.Scheme`)."""
SCHEMES: dict[str, tuple[int, Kind]] = {"switch": (8, "gauss"), "lugre": (7, "radau")}
"""Default collocation degree and kind: Gauss for the smooth slip, Radau IIA for the stiff bristle."""

_FORMS = {len(form.names): form for form in (Servo(), Servo(controller=Controller().pid()))}
"""By the length of p, a servo with such a controller: no function depends on its numbers."""
_MIRROR = str.maketrans("+-", "-+")


@kept(maxsize=8)
def system_of(model: Model, parameters: int) -> System:
    """The servo as a system, its numbers those of any servo; parameters: the length of p, which tells its form."""
    return hunting_system(_FORMS[parameters], model, 1.0)


def motor_torque(x: Any, p: Any) -> Any:
    """The torque of the motor.

    x: (n,) or (n, m) states of either model. Returns m [N m], one number or (m,).
    """
    names, (_, pid, *_) = system_of("switch", p.shape[0]).names, parts_of_servo("switch", _FORMS[p.shape[0]])
    seen = names.x(x, p)
    signals = SimpleNamespace(error=seen.x1, derivative=seen.x2, integral=seen.x3)
    return pid.gives["demand"](seen, signals, names.p(p))


def slips_back(x: np.ndarray, p: np.ndarray) -> bool:
    """Whether the Switch servo, stopped at x, is reversed at once by more torque than static friction holds.

    x: (3,) state with x2 = 0. Returns False where it sticks.
    """
    return system_of("switch", p.size).vector_form.ways_out("slip+", "stop")[0].successor(x, p) != "stick"


def mirrored(signature: tuple[tuple[str, str], ...]) -> tuple[tuple[str, str], ...]:
    """The phase sequence of the motion -x(t)."""
    return tuple((mode.translate(_MIRROR), event.translate(_MIRROR)) for mode, event in signature)


def hunting_system(servo: Servo, model: Model, gain: float) -> System:
    """A servo as a system like any user's, for `casahunt.motion.simulate` and `casahunt.orbits.find_cycle`.

    servo, model, gain: the problem; gain K > 0 [V/rad]. Returns system with the parameters of `Servo.names`, by the
    last parts of their names. Raises InputError: a value out of range.
    """
    values = dict(zip(called(servo.names), map(float, servo.parameters(gain)), strict=True))
    return System(TITLES[model], STATES[model], values, modes_of(parts_of_servo(model, servo), tuple(values)))
