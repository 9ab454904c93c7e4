"""The hunting servo as a system: modes, fields, events, in the words that any user's system is written in.

Controller (see controller.py):   m = -(kp x1 + kd x2 + ki x3),   J x2' = m - F,   x1' = x2,   x3' = x1.

Switch friction, states (x1, x2, x3), a Filippov system with eta -> 0:
    slip+, slip-   s x2 > 0:  F = s g(x2) + sigma2 x2, until x2 = 0 ("stop")
    stick          x2 = 0, x1 constant, x3' = x1, |m| <= Fs; closed form, until m = s Fs ("breakaway")
    at a stop with |m| > Fs the servo slips on with sign(m) at once: reversal without stick.
  Half cycle: slip+ | stick, closed by S = -I.

LuGre friction, states (x1, x2, x3, x4 = z), the kink |x2| split off as a mode:
    slide+, slide-  s x2 >= 0: |x2| = s x2, until x2 = 0 ("reversal")
    slide           |x2| as it is, the mode that both are parts of: once the net torque at a reversal is below
                    `WEAK` Fs, the kink is too weak to deserve a phase boundary, and tiny reversals come and go
                    along a branch
  Half cycle: from x1 = 0 in mid-slip ("centre", always transversal) to the next one: slip, ring-down
  of alternating short slides, then the long stick and the take-off in the last phase.

Events are scaled to order one: velocities by vs, torques by Fs, x1 by Fs/kp.

Parameters are called by the last part of their names in a servo file: p.static is friction.static, Fs; p.sign is s.
The cycles of these modes are those of cycles.py; the report's own form of the Switch servo is in scripts/report.

Report: Hensen, van de Molengraft and Steinbuch, DCT 2001.021, sections 3.1 and 3.2.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

import casadi as ca

from ..hybrid import Event, Mode, System
from .controller import torque_gains_of
from .friction import bristle_rate, stribeck
from .servo import Servo

Model = Literal["switch", "lugre"]
MODELS: tuple[Model, ...] = ("switch", "lugre")

WEAK = 1e-8
"""A LuGre reversal whose net torque |J x2'| is below this part of Fs gets no phase boundary.

Measured at Table 1, tolerance 1e-9: with boundaries at every reversal above 1e-5 the mesh takes 80 to 110
intervals and 0.06 to 0.1 s and the multipliers are right to 1e-8; above 1e-2, 110 to 130 intervals, 0.5 to
1.1 s and 1e-4, because kinks inside intervals spoil the order."""


def torque_gains(p: Any) -> tuple[Any, Any, Any]:
    """(kp, kd, ki), of a controller by its gains or by its times."""
    factor = p.gain * p.motor_gain
    if "kp" in p:
        return torque_gains_of(factor, p.kp, p.ki, p.kd)
    return torque_gains_of(factor, p.lead_time, p.integral_time)


def motor_torque(x: Any, p: Any) -> Any:
    """The torque of the motor.

    Returns m = -(kp x1 + kd x2 + ki x3) [N m].
    """
    kp, kd, ki = torque_gains(p)
    return -(kp * x.x1 + kd * x.x2 + ki * x.x3)


# Switch friction ---------------------------------------------------------------------------------------------


def _slip(x: Any, p: Any) -> dict[str, Any]:
    F = p.sign * stribeck(x.x2, p.static, p.coulomb, p.stribeck_velocity) + p.viscous * x.x2
    return {"x1": x.x2, "x2": (motor_torque(x, p) - F) / p.inertia, "x3": x.x1}


def _stick(x: Any, t: Any, p: Any) -> dict[str, Any]:
    """Only the integrator moves."""
    return {"x1": x.x1, "x2": x.x2, "x3": x.x3 + t * x.x1}


def _velocity(x: Any, p: Any) -> Any:
    return x.x2 / p.stribeck_velocity


def _moves_forward(x: Any, p: Any) -> Any:
    return p.sign * x.x2 / p.stribeck_velocity


def _stribeck_drop(x: Any, p: Any) -> Any:
    """exp(-(x2/vs)^2): invisible to an interval whose points all lie beyond a few vs."""
    return ca.exp(-((x.x2 / p.stribeck_velocity) ** 2))


def _torque_below_static(x: Any, p: Any) -> Any:
    return 1 - ca.fabs(motor_torque(x, p)) / p.static


def _torque_up(x: Any, p: Any) -> Any:
    return motor_torque(x, p) / p.static - 1


def _torque_down(x: Any, p: Any) -> Any:
    return motor_torque(x, p) / p.static + 1


def _after_stop(x: Any, p: Any) -> str:
    m = motor_torque(x, p)
    return "stick" if abs(m) <= p.static else ("slip+" if m > 0 else "slip-")


BREAKAWAY_UP = Event("breakaway+", _torque_up, +1, to="slip+")
BREAKAWAY_DOWN = Event("breakaway-", _torque_down, -1, to="slip-")

SLIP_FORWARD = Mode("slip+", _slip, sign=+1, holds=_moves_forward, feature=_stribeck_drop,
                    ends=(Event("stop", _velocity, -1, to=_after_stop),))  # fmt: skip
SLIP_BACK = Mode("slip-", _slip, sign=-1, holds=_moves_forward, feature=_stribeck_drop,
                 ends=(Event("stop", _velocity, +1, to=_after_stop),))  # fmt: skip
STICK = Mode("stick", flow=_stick, holds=_torque_below_static, ends=(BREAKAWAY_UP, BREAKAWAY_DOWN))


# LuGre friction ----------------------------------------------------------------------------------------------


def _slide(x: Any, p: Any) -> dict[str, Any]:
    speed = ca.if_else(p.sign == 0, ca.fabs(x.x2), p.sign * x.x2)
    g = stribeck(x.x2, p.static, p.coulomb, p.stribeck_velocity)
    rate = bristle_rate(x.x2, speed, x.x4, g, p.stiffness)
    F = p.stiffness * x.x4 + p.damping * rate + p.viscous * x.x2
    return {"x1": x.x2, "x2": (motor_torque(x, p) - F) / p.inertia, "x3": x.x1, "x4": rate}


def _slides_forward(x: Any, p: Any) -> Any:
    """s x2 as the reversal strength of a ring-down with that peak speed: x2 sqrt(sigma0 J)/Fs."""
    return p.sign * x.x2 * ca.sqrt(p.stiffness * p.inertia) / p.static


def _position(x: Any, p: Any) -> Any:
    return x.x1 * torque_gains(p)[0] / p.static


def _after_reversal(x: Any, p: Any) -> str:
    """By the net torque J x2'/Fs at x2 = 0, whose sign is that of the motion to come."""
    strength = (motor_torque(x, p) - (p.stiffness * x.x4 + p.damping * x.x2)) / p.static
    return "slide" if abs(strength) < WEAK else ("slide+" if strength > 0 else "slide-")


def _as_it_slides(x: Any, p: Any) -> str:
    return "slide+" if x.x2 > 0 else "slide-"


SLIDE_FORWARD = Mode("slide+", _slide, sign=+1, holds=_slides_forward, slack=10 * WEAK, feature=_stribeck_drop,
                     stiff=True, unsplit="slide",
                     ends=(Event("reversal", _velocity, -1, to=_after_reversal),
                           Event("centre", _position, +1, to="slide+")))  # fmt: skip
SLIDE_BACK = Mode("slide-", _slide, sign=-1, holds=_slides_forward, slack=10 * WEAK, feature=_stribeck_drop,
                  stiff=True, unsplit="slide",
                  ends=(Event("reversal", _velocity, +1, to=_after_reversal),
                        Event("centre", _position, -1, to="slide-")))  # fmt: skip
SLIDE = Mode("slide", _slide, sign=0, smooth=False, feature=_stribeck_drop, stiff=True,
             ends=(Event("centre", _position, 0, to=_as_it_slides),))  # fmt: skip


# The systems -------------------------------------------------------------------------------------------------

STATES = {"switch": ("x1", "x2", "x3"), "lugre": ("x1", "x2", "x3", "x4")}
MODES: Mapping[str, tuple[Mode, ...]] = {
    "switch": (SLIP_FORWARD, SLIP_BACK, STICK),
    "lugre": (SLIDE_FORWARD, SLIDE_BACK, SLIDE),
}
TITLES = {"switch": "servo with Switch friction", "lugre": "servo with LuGre friction"}


def called(names: Iterable[str]) -> tuple[str, ...]:
    """What the parameters of a servo are called in its functions: the last parts of their names."""
    return tuple(name.rsplit(".", 1)[-1] for name in names)


def hunting_system(servo: Servo, model: Model, gain: float) -> System:
    """A servo as a system like any user's, for `casahunt.motion.simulate` and `casahunt.orbits.find_cycle`.

    servo, model, gain: the problem; gain K > 0 [V/rad]. Returns system with the parameters of `Servo.names`, by the
    last parts of their names. Raises InputError: a value out of range.
    """
    values = dict(zip(called(servo.names), map(float, servo.parameters(gain)), strict=True))
    return System(TITLES[model], STATES[model], values, MODES[model])
