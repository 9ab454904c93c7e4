"""What is refused before any cycle is sought: no problem at all, times too far apart, proofs that there is no cycle.

Double arithmetic must have half of its digits left for the answer: between what is fast in a servo, its friction and
its bristle, and its controller there may be a factor of `SPREAD`, in either direction.
"""

from __future__ import annotations

import math

import numpy as np

from ..checks import COMPUTED, choice_of, sensible
from ..errors import InputError, NoOrbit, Status
from .denial import no_cycle
from .event_map.half_cycle import StickMap
from .event_map.scan import scan
from .friction import MODELS, Model
from .servo import Servo, a_servo

SPREAD = 1 / math.sqrt(np.finfo(float).eps)
"""Largest ratio of the times of a servo: half of the digits of double arithmetic."""


def check_problem(servo: Servo, model: Model, gain: float) -> None:
    """Refuse what is no problem, and pure Coulomb friction with what a scan shows.

    Below a gain at which the loop without dry friction is stable, pure Coulomb friction proves nothing.  Of a bristle
    the proof for rigid friction proves nothing either: where a scan shows no cycle of it, none was found.

    servo, model, gain: the problem; gain K [V/rad]. Raises InputError: unknown model, or a gain that is not a finite
    number > 0; NoOrbit: there is provably no cycle; or a scan of a bristle shows none, and none was found.
    """
    a_servo(servo)
    choice_of("model", model, MODELS)
    sensible("gain", gain, power=COMPUTED)
    if servo.friction.static > servo.friction.coulomb:
        return
    if why := no_cycle(servo, model, gain):
        where = "any gain" if no_cycle(servo, model) else f"gain {gain:g} or above"
        seen = scan(StickMap(model, servo, gain)).sentence()
        message = f"no hunting limit cycle of the {model} servo at {where}: {why}"
        raise NoOrbit(message, evidence=f"at gain {gain:g}, {seen}")
    if why := no_cycle(servo, "switch", gain):
        bristles = scan(StickMap(model, servo, gain))
        if bristles.upper is None:
            raise NoOrbit(
                f"no hunting limit cycle of the {model} servo was found at gain {gain:g}, which does not prove that "
                f"there is none: in the limit of stiff bristles there is none, because {why}",
                Status.NOT_FOUND, evidence=f"with these bristles, {bristles.sentence()}",
            )  # fmt: skip


def check_hunts(servo: Servo, model: Model) -> None:
    """Refuse a servo that is proved to have no cycle at any gain.

    Raises NoOrbit: there is such a proof (denial.py).
    """
    why = no_cycle(servo, model)
    if why:
        raise NoOrbit(f"no hunting limit cycle of the {model} servo at any gain: {why}")


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
