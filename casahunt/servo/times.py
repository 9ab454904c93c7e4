"""How far apart the times of a servo may be.

Double arithmetic must have half of its digits left for the answer: between what is fast in a servo, its friction and
its bristle, and its controller there may be a factor of `SPREAD`, in either direction.
"""

from __future__ import annotations

import math

import numpy as np

from ..errors import InputError
from .hunting import Model
from .servo import Servo

SPREAD = 1 / math.sqrt(np.finfo(float).eps)
"""Largest ratio of the times of a servo: half of the digits of double arithmetic."""


def check_times(servo: Servo, model: Model, gain: float = math.nan) -> None:
    """Refuse a servo that moves in times too far from those of its controller.

    Too fast may be the drop of the friction, J vs/(Fs - Fc), viscous friction, J/sigma2, and the LuGre bristle,
    sqrt(J/sigma0), J/sigma1 and Fc/(sigma0 vs); too slow the drop, the bristle, and at a gain the controller itself,
    sqrt(J/kp) and (kd + sigma2)/kp.

    gain: K [V/rad]; nan: the largest one that hunts is looked for, where both controller times act.
    Raises InputError: one of these times is more than `SPREAD` times tau_d + tau_i, or less than that part of it.
    """
    J, f, c = servo.inertia, servo.friction, servo.controller
    both, fast, slow = {}, {}, {}
    if f.static > f.coulomb:
        drop = J * f.stribeck_velocity / (f.static - f.coulomb)
        both["the drop of the friction curve (inertia * stribeck_velocity/(static - coulomb))"] = drop
    fast["viscous friction (inertia/viscous)"] = J / f.viscous if f.viscous else math.inf
    if model == "lugre":
        both["the bristle (coulomb/(stiffness * stribeck_velocity))"] = f.coulomb / (f.stiffness * f.stribeck_velocity)
        fast["the bristle (square root of inertia/stiffness)"] = math.sqrt(J / f.stiffness)
        fast["the damping of the bristle (inertia/damping)"] = J / f.damping if f.damping else math.inf
    if math.isnan(gain):
        fast["the shorter one alone"] = min(c.corners) or math.inf
    else:
        kp, kd, _ = servo.torque_gains(gain)
        slow[f"the controller at gain {gain:g}"] = max(math.sqrt(J / kp), (kd + f.viscous) / kp)
    whole = c.reset_time
    early = [(what, t) for what, t in (both | fast).items() if t < whole / SPREAD]
    for what, t in [*early, *((what, t) for what, t in (both | slow).items() if t > SPREAD * whole)]:
        raise InputError(
            f"the controller's times are {whole:.2g} s together, but {what} takes {t:.2g} s: cycles are computed up to "
            f"a factor of {SPREAD:.2g} between them, because double arithmetic must have half of its digits left for "
            "the answer; are all parameters meant?"
        )


def stiff_at(servo: Servo, gain: float) -> bool:
    """Whether the controller's damping acts so fast that no motion can be computed.

    servo, gain: the problem; gain K [V/rad].
    Returns True where J/(kd + sigma2) is less than 1/`SPREAD` of tau_d + tau_i.
    """
    c, (_, kd, _) = servo.controller, servo.torque_gains(gain)
    return SPREAD * servo.inertia < (kd + servo.friction.viscous) * c.reset_time
