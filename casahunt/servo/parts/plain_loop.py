"""The plain servo as a loop of parts: one inertia, its friction, a PID controller, an integrator.

The controller is given by its gains, which are those of any PID: kp, ki and kd are then parameters of the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ...checks import COMPUTED, choice_of, sensible
from ...errors import InputError
from ...results import Result
from ..controller import Pid, torque_gains_of
from ..friction import MODELS, Model
from ..servo import PID_PARAMETERS, Servo, a_servo, called, flatten, unflatten
from .inertia import INERTIA
from .loop import Loop
from .lugre import LUGRE
from .part import Part
from .pid import INTEGRATOR, PID_BY_GAINS, PID_BY_TIMES
from .switch import SWITCH

FRICTIONS: Mapping[str, Part] = {"switch": SWITCH, "lugre": LUGRE}
ASKED_ALONE = 'model, gain: must be given with a Servo, such as (servo, "switch", 0.04); a loop of parts has both'
"""Said of a servo without them."""
PID_KEYS = PID_PARAMETERS[:-1]
"""Of a servo whose controller is given by its gains, without the gain of the loop."""


def parts_of_servo(model: Model, servo: Servo) -> tuple[Part, ...]:
    """The parts of a servo, in the order of its states x1, x2, x3, x4."""
    pid = PID_BY_GAINS if isinstance(servo.controller, Pid) else PID_BY_TIMES
    return INERTIA, pid, INTEGRATOR, FRICTIONS[model]


def loop_of(servo: Servo, model: Model, gain: float) -> Loop:
    """A servo as a loop.

    Parameters
    ----------
    servo, model, gain
        the servo, "switch" or "lugre", K > 0 [V/rad].

    Returns
    -------
    Loop of one inertia, friction, PID by gains and integrator, to which other parts can be added.

    Examples
    --------
    >>> from casahunt import Servo
    >>> from casahunt.continuation import largest
    >>> from casahunt.orbits import find_cycle
    >>> from casahunt.servo.parts import loop_of
    >>> loop = loop_of(Servo(), "switch", 0.04)
    >>> start = loop.state(x1=-0.05)
    >>> cycle = find_cycle(loop.system, loop.mode_at(**start), start=start, follow="gain", tol=1e-9)
    >>> round(largest(cycle, "gain").value, 8)  # V/rad, as find_fold has it
    0.64733908
    """
    pid = servo.controller.pid()
    own = flatten(servo)
    numbers = dict(zip(called(own), own.values(), strict=True))
    numbers |= {"kp": pid.kp, "ki": pid.ki, "kd": pid.kd, "gain": gain}
    parts = (INERTIA, FRICTIONS[model], PID_BY_GAINS, INTEGRATOR)
    wanted = {name for part in parts for name in part.parameters}
    values = {name: value for name, value in numbers.items() if name in wanted}
    return Loop(parts, values, f"{model} servo", servo.units)


class LoopResult(Result):
    """What is known of a loop: its friction model, its gain and its parts."""

    loop: Loop

    @property
    def model(self) -> Model:
        """The friction model: "lugre", or "switch" of any friction that is rigid."""
        return "lugre" if LUGRE in self.loop.present else "switch"

    @property
    def gain(self) -> float:
        """K [V/rad]."""
        return self.loop.value("gain")

    @property
    def parts(self) -> tuple[str, ...]:
        """The names of the loop's parts."""
        return tuple(part.name for part in self.loop.present)


def model_asked(servo: Servo | Loop, model: Model | None, usual: Model | None = None) -> Any:
    """The friction model of a servo, `usual` where none is given, or None of a loop.

    Raises InputError: it is neither, an unknown model, or a loop with one.
    """
    if not isinstance(servo, Loop):
        a_servo(servo)
        return choice_of("model", str(model or usual), MODELS)
    if model is not None:
        raise InputError(f"model = {model!r}: must be left out, a loop has its friction as a part")
    return None


def loop_asked(
    servo: Servo | Loop, model: Model | None, gain: float | None, *, usual: Model | None = None
) -> Loop:
    """What is asked about as a loop: a servo with a friction model at a gain, or a loop at its own gain or another.

    usual: the model of a servo, where none is given. Raises InputError: as `model_asked`, or a servo without a gain.
    """
    if isinstance(servo, Servo) and None in (gain, model or usual):
        raise InputError(ASKED_ALONE)
    friction = model_asked(servo, model, usual)
    gain = None if gain is None else sensible("gain", gain, power=COMPUTED)
    if isinstance(servo, Loop):
        return servo if gain is None else servo.replace(gain=gain)
    assert gain is not None
    return loop_of(servo, friction, gain)


def servo_of_loop(loop: Loop) -> tuple[Servo, Model, float] | None:
    """The servo that a loop is, its friction model and its gain; None where it has other parts, or no servo has its
    numbers, as without integral action."""
    model: Any = next((model for model, part in FRICTIONS.items() if part in loop.present), None)
    if model is None or {*by_gains(loop).present} != {INERTIA, FRICTIONS[model], PID_BY_GAINS, INTEGRATOR}:
        return None
    numbers = by_gains(loop).parameters
    keys = {key: name for key, name in zip(PID_KEYS, called(PID_KEYS), strict=True) if name in numbers}
    try:
        servo = replace(unflatten({key: numbers[name] for key, name in keys.items()}), units=loop.units)
        return servo, model, sensible("gain", numbers["gain"], power=COMPUTED)
    except InputError:
        return None


def not_of_a_servo(loop: Loop) -> list[str]:
    """The names of the parts that no servo has."""
    own = {INERTIA, PID_BY_GAINS, PID_BY_TIMES, INTEGRATOR, *FRICTIONS.values()}
    return [part.name for part in loop.present if part not in own]


def by_gains(loop: Loop) -> Loop:
    """A loop whose PID is given by times, with that PID given by gains; any other loop as it is."""
    if PID_BY_TIMES not in loop.parts:
        return loop
    parts = tuple(PID_BY_GAINS if part is PID_BY_TIMES else part for part in loop.parts)
    kept = {name: loop.value(name) for part in parts for name in part.parameters if part is not PID_BY_GAINS}
    kp, kd, ki = torque_gains_of(1.0, loop.value("lead_time"), loop.value("integral_time"))
    own = {"kp": kp, "kd": kd, "ki": ki, "gain": loop.value("gain"), "motor_gain": loop.value("motor_gain")}
    return replace(loop, parts=parts, values=kept | own)
