"""A loop of parts whose friction is sought: its own motions are fitted, from where one inertia would have it.

    J = motor + load,  kp, kd, ki of the loop   ->   friction by the event map   ->   the fit of the loop itself

Taken as one inertia an axis may be explained by a friction that it does not have; that is a start, and no more.
What a drive adds to the motion is computed where the fit ends, all of it (built.py): the loop is fitted without lags.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...errors import InputError
from ...orbits import Options
from ...servo.controller import Pid
from ...servo.drive import Drive
from ...servo.friction import Friction, Model
from ...servo.linear.sampled_loop import lag_of
from ...servo.parts import BY_DIRECTION
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import loop_asked
from ...servo.sampled.plant import as_run
from ...servo.servo import Servo
from ..nearby import servo_at
from ..record.file import Record
from .best import best_of_starts
from .fit import ALL_BUT_NOTHING, Data, Question
from .start import COULOMB, STATIC, STRIBECK, VISCOUS, lowest_of, scales_of
from .suitable import drive_taken, free_of, gains_of

FRICTION = {name.rpartition(".")[2]: name for name in (STATIC, COULOMB, VISCOUS, STRIBECK)}
"""What can be sought of a loop, and what it is called of a servo."""


def sought(
    servo: Servo | Loop, model: Model | None, gains: float | Sequence[float] | None, free: Sequence[str],
    drive: Drive | None, records: Sequence[Record],
) -> tuple[tuple[str, ...], list[float], Drive | None, float]:  # fmt: skip
    """The free parameters, the gain of each record, the drive that is taken into account, and what it leaves out.

    Raises InputError: one of these cannot be.
    """
    if isinstance(servo, Loop):
        names = check_axis(loop_asked(servo, model, None), free, records)
        each = gains_of(servo.value("gain") if gains is None else gains, len(records))
        return names, each, *lags_taken(servo, each, drive)
    names, each = free_of(free, servo, model), gains_of(() if gains is None else gains, len(records))
    return names, each, *drive_taken(records, servo, each, names, drive)


def lags_taken(loop: Loop, gains: Sequence[float], drive: Drive | None) -> tuple[Drive | None, float]:
    """The drive whose lags, sampling and counts are taken into account; and what they leave out, relative to the
    amplitude, where the loop as built is not followed.

    Swings to and fro are compared as one, so that no drive of a loop is taken whose friction differs by direction.
    Raises InputError: it does not run such a loop.
    """
    if drive is None or BY_DIRECTION in loop.present:
        return None, 0.0
    as_run(loop, drive)
    one = rigid(loop)
    kp, _, _ = one.torque_gains(max(gains))
    return drive, math.sqrt(kp / one.inertia) * lag_of(drive, one)


def check_axis(loop: Loop, free: Sequence[str], records: Sequence[Record]) -> tuple[str, ...]:
    """The parameters that are sought of a loop.

    Raises InputError: one of them is none of one friction, a torque is given, which no such fit takes in, or the
    controller has no gains that are those of one inertia.
    """
    names = tuple(name.rpartition(".")[2] for name in ((free,) if isinstance(free, str) else free))
    known = [name for name in FRICTION if name in loop.names]
    frictions = " and ".join(repr(part.name) for part in loop.present if "static" in part.parameters) or "no part"
    for name in names:
        if name not in known:
            raise InputError(f"free = {name}: must be one of {', '.join(known)}, the friction of {frictions}")
    if not names or len(set(names)) < len(names):
        raise InputError("free: must be at least one parameter, each once")
    if any(record.torque is not None for record in records):
        raise InputError("torque: must be left out, of a loop of parts positions alone are fitted")
    rigid(loop)
    return names


def rigid(loop: Servo | Loop) -> Servo:
    """Motor and load as one inertia, under the gains of the loop's controller; a servo as it is.

    Raises InputError: the controller has no such gains.
    """
    if isinstance(loop, Servo):
        return loop
    one = loop.replace(gain=1.0)
    start = one.at_rest(0.0)
    for signal in ("kp", "kd", "ki"):
        if not any(signal in part.gives for part in one.present):
            parts = " and ".join(repr(part.name) for part in one.present if "demand" in part.gives) or "no part"
            raise InputError(f"{parts}: gives no {signal}, and a fit begins with the one inertia that has it")
    x, mode = np.array(list(start.values()))[:, None], one.mode_at(**start)
    kp, kd, ki = (float(one.signal(signal, mode, x)[0]) for signal in ("kp", "kd", "ki"))
    own = {name: loop.value(name) for name in FRICTION if name in loop.names}
    inertia = sum(loop.value(name) for name in ("inertia", "load_inertia") if name in loop.names)
    return Servo(inertia=inertia, motor_gain=1.0, controller=Pid(kp=kp, ki=ki, kd=kd), friction=Friction(**own))


def question_of(
    servo: Servo | Loop, model: Model | None, records: tuple[Data, ...], free: tuple[str, ...], options: Options
) -> Question:
    """What is fitted: a servo, or a loop with those that have the friction of one inertia to begin with."""
    one, names = rigid(servo), tuple(FRICTION.get(name, name) for name in free)
    scales, lowest = scales_of(records[0], one, names), lowest_of(one, names)
    question = Question(records, one, model or "switch", names, options, scales, lowest)
    if one is servo:
        return question
    found, least = best_of_starts(question), np.full(len(free), ALL_BUT_NOTHING)
    tried = () if found is None else (servo_at(servo, free, question.numbers(found[0].z)),)
    return Question(records, servo, None, free, options, scales, least, tried=tried)
