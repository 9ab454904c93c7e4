"""Static and Coulomb friction with which one swing is that of a record.

Behind breakaway at -a the torque of the motor is Fs + kp (x1 + a) + kd x2 + ki int x1 dt, so Fs drops out of the slip:
where it ends depends on Fs - Fc alone, and the more Fs, the longer the stick behind it.  With T of the record,

    A(Fs - Fc) = a,        T/2 = t_slip + t_stick,    d t_stick/d Fs = 2/(ki a)

are one bracketed root and one division for Switch, as long as it sticks where it stops.  Where it slips back from
there, and for LuGre, both equations are solved in logarithms by Broyden's method, with the slopes of Switch, whose
motions (servo/event_map) cost a tenth.  What is matched is a motion and no cycle: there is one whether or not the servo
hunts with such friction, and where both equations hold it is a cycle.

Symbols: a stick position, T period, u = (ln(Fs - Fc), ln Fs).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from ...motion import MarchFailure
from ...roots import Bracket
from ...servo.event_map.half_cycle import HalfCycle, StickMap
from ...servo.friction import Model
from ...servo.servo import Servo
from .fit import Array, Data

STATIC, COULOMB = "friction.static", "friction.coulomb"
SWING_MARCH, FRICTION_DIFFERENCE = 1e-5, 0.01
"""Tolerance of the motions, and step of the differences."""
MATCHED, NEARLY_MATCHED = 0.003, 0.2
"""Size of the logarithms that is none; and up to which there may be such a cycle nearby."""
MOST_TRIED, NEXT_FALL = 20, 2.0
"""Motions of one model; factor of Fs - Fc until the root is bracketed."""
LARGEST_FRICTION_STEP, LEAST_FRICTION_STEP = 0.5, 0.02
"""Of u, and one that is not halved."""
LONGEST_SWING = 2.0
"""After which a servo has come to rest, or is far off."""
LEAST_COULOMB_SHARE = 1e-3
"""In units of static friction."""


class Swing(NamedTuple):
    """A half cycle of a servo, and by how much the logarithms of its amplitude and period are off."""

    servo: Servo
    motion: HalfCycle
    off: Array

    @property
    def size(self) -> float:
        """How far it is off."""
        return float(np.hypot(*self.off))

    @property
    def u(self) -> Array:
        """The unknowns."""
        friction = self.servo.friction
        return np.log([friction.static - friction.coulomb, friction.static])


def matched(servo: Servo, model: Model, data: Data) -> Servo | None:
    """The servo with the static and Coulomb friction with which it swings about as a record does.

    None where none is found with which amplitude and period are those of the record to `NEARLY_MATCHED`.
    """
    found = _balanced(servo, data)
    for kind in dict.fromkeys(("switch", model)):
        found = found and _closer(servo, kind, data, found)
    return found.servo if found is not None and found.size < NEARLY_MATCHED else None


def static_of(servo: Servo, data: Data) -> float:
    """About the static friction of a record, as if it slipped at once [N m]."""
    kp, _, ki = servo.torque_gains(data.gain)
    return kp * data.amplitude + ki * data.period / 4 * float(np.mean(np.abs(data.shape)))


def _swing(servo: Servo, model: Model, data: Data, u: Array) -> Swing | None:
    """The swing with friction u; None where the servo does not come across."""
    a, T = data.amplitude, data.period
    fall, Fs = np.exp(u)
    try:
        servo = servo.replace(**{STATIC: Fs, COULOMB: max(Fs - fall, LEAST_COULOMB_SHARE * Fs)})
        motion = StickMap(model, servo, data.gain)(a, tol=SWING_MARCH, longest=LONGEST_SWING * T)
    except (InputError, MarchFailure):
        return None
    if not motion.position > 0:
        return None
    reached = motion.position
    if model != "switch":  # the bristle bends: it sticks nearer than it turned
        reached = max(float(np.abs(segment.w[:, 0]).max()) for segment in motion.segments)
    lasted = 2 * sum(segment.duration for segment in motion.segments)
    return Swing(servo, motion, np.log([reached / a, lasted / T]))


def _balanced(servo: Servo, data: Data) -> Swing | None:
    """The nearest swing of the Switch servo: the root in ln(Fs - Fc), and Fs on the way."""
    _, _, ki = servo.torque_gains(data.gain)
    Fs = static_of(servo, data)
    x = math.log(max(servo.friction.static - servo.friction.coulomb, LEAST_COULOMB_SHARE * Fs))
    ends: dict[bool, tuple[float, float]] = {}
    bracket: Bracket | None = None
    best: Swing | None = None
    for _ in range(MOST_TRIED):
        Fs = max(Fs, math.exp(x) / (1 - LEAST_COULOMB_SHARE))
        at = _swing(servo, "switch", data, np.array([x, math.log(Fs)]))
        best = min((one for one in (best, at) if one is not None), key=lambda one: one.size, default=None)
        if best is not None and best.size < MATCHED:
            break
        if at is not None and at.motion.segments[-1].mode == "stick":
            Fs -= ki * at.motion.position * data.period / 2 * math.expm1(at.off[1]) / 2
        off = -math.inf if at is None else float(at.off[0])
        if bracket is not None and off:
            bracket = bracket.told(x, off)
        elif off:
            ends[off > 0] = (x, off)
            bracket = Bracket(*ends[False], *ends[True]) if len(ends) == 2 else None
        if off:
            x = bracket.illinois if bracket is not None else x - math.copysign(math.log(NEXT_FALL), off)
    return best


def _closer(servo: Servo, model: Model, data: Data, rigid: Swing) -> Swing | None:
    """The nearest swing of a model, from one of the Switch servo."""
    if model == "switch" and rigid.size < MATCHED:
        return rigid
    beside = [_swing(servo, "switch", data, rigid.u + change) for change in FRICTION_DIFFERENCE * np.eye(2)]
    columns = [(one.off - rigid.off) / FRICTION_DIFFERENCE for one in beside if one is not None]
    u, at = rigid.u, _swing(servo, model, data, rigid.u)
    if len(columns) < 2:
        return at
    slopes = np.column_stack(columns)
    while at is None and u[0] < u[1]:
        u = u + [math.log(NEXT_FALL), 0.0]
        at = _swing(servo, model, data, u)
    best = at
    for _ in range(MOST_TRIED):
        if at is None or best is None or best.size < MATCHED:
            break
        step = -np.linalg.lstsq(slopes, at.off)[0]
        if not step.any():
            break
        step *= min(1.0, LARGEST_FRICTION_STEP / max(float(np.linalg.norm(step)), LEAST_FRICTION_STEP))
        new = _swing(servo, model, data, at.u + step)
        while new is None and np.linalg.norm(step) > LEAST_FRICTION_STEP:
            step /= 2
            new = _swing(servo, model, data, at.u + step)
        if new is not None:
            slopes += np.outer(new.off - at.off - slopes @ step, step) / (step @ step)
            best = min(best, new, key=lambda one: one.size)
        at = new
    return best
