"""The hunting servo (hunting.py) in the terms of the engine: its vectors and its schemes.

    x = (x1, x2, x3 [, x4]),    p = servo.PARAMETERS or PID_PARAMETERS, whose length tells which

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
from .hunting import hunting_system
from .parts.plain_loop import parts_of_servo
from .servo import Servo

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
