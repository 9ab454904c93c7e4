"""The plain servo as a loop of parts: one inertia, its friction, a PID controller, an integrator.

The controller is given by its gains, which are those of any PID: kp, ki and kd are then parameters of the loop.
"""

from __future__ import annotations

from ..hunting import Model, called
from ..servo import Servo, flatten
from .inertia import INERTIA
from .loop import Loop
from .lugre import LUGRE
from .pid import INTEGRATOR, PID_BY_GAINS
from .switch import SWITCH

FRICTIONS = {"switch": SWITCH, "lugre": LUGRE}


def loop_of(servo: Servo, model: Model, gain: float) -> Loop:
    """A servo as a loop.

    gain: K > 0 [V/rad].
    """
    pid = servo.controller.pid()
    own = flatten(servo)
    numbers = dict(zip(called(own), own.values(), strict=True))
    numbers |= {"kp": pid.kp, "ki": pid.ki, "kd": pid.kd, "gain": gain}
    parts = (INERTIA, FRICTIONS[model], PID_BY_GAINS, INTEGRATOR)
    wanted = {name for part in parts for name in part.parameters}
    return Loop(parts, {name: value for name, value in numbers.items() if name in wanted}, f"{model} servo")
