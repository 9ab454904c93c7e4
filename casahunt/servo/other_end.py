"""What a servo that comes to rest could have come to instead: the stable cycle at the same gain, and a start for it.

    theta(0) = theta_d - a,   theta'(0) = 0,   x3(0) = max(0, (kp a - 0.9 Fs)/ki)      stuck, not yet broken away

a is the stick position of the cycle (basin.py), in as few digits as lead there; where none does, the motion starts on
the cycle, where it turns round.  Stuck at |x1| = a, one number decides the whole future; that a start ends in the cycle
is shown by a motion from it, whose verdict is asked for.  A servo stuck nearer than the unstable cycle, or flung far
past the stable one, may rest: both ends are true of one servo, the start tells which.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..axis_units import in_its_units
from ..errors import NoOrbit
from .basin import stick_position
from .event_map.half_cycle import SECTION
from .find_orbit import find_orbit
from .outcome import SETTLES
from .parts.plain_loop import servo_of_loop
from .problem import HuntingOrbit
from .servo import Servo
from .simulate import simulate
from .trajectory import Trajectory

START_DIGITS, DIGITS_ON_IT = (2, 4), 10
"""Digits of the distance from the set point that starts are tried with, the first that leads to hunting being given;
of a start on the cycle itself."""
FOLLOWED = 5
"""Of the cycle, that the motion from such a start is followed at least."""


@dataclass(frozen=True, eq=False)
class OtherEnd:
    """A hunting cycle at the gain of a motion that comes to rest.

    Attributes
    ----------
    orbit : the symmetric cycle on the stable side of the fold; None where there is none, or none was found.
    reason : why there is none, or what was tried; "" with an orbit.
    none : there is none, with the evidence in `reason`.
    start : position [rad], integral [rad s], time [s] and, on the cycle, velocity [rad/s] and bristle [rad], keywords
        of `simulate` at the same set point: a motion from there was followed and hunts; empty where none tried does.
    """

    orbit: HuntingOrbit | None
    reason: str = ""
    none: bool = False
    start: dict[str, float] = field(default_factory=dict)

    @property
    def hunts(self) -> bool:
        """A motion that hunts was found."""
        return bool(self.start)


@in_its_units
def other_end(motion: Trajectory) -> OtherEnd | None:
    """The cycle that a servo at rest could be on, and a start.

    None for a motion whose verdict names another end, and of a loop with other parts than those of a servo.
    """
    asked = servo_of_loop(motion.loop)
    if motion.verdict.kind not in SETTLES or asked is None:
        return None
    try:
        orbit = find_orbit(*asked)
    except NoOrbit as error:
        return OtherEnd(None, str(error), error.status is None)
    time = max(motion.duration, math.ceil(FOLLOWED * orbit.period))
    for start in _starts(motion, orbit):
        with suppress(NoOrbit):
            again = simulate(motion.loop, set_point=motion.set_point, tol=motion.tol, time=time, **start)
            if again.verdict.kind == "hunting":
                return OtherEnd(orbit, start={**start, "time": time})
    return OtherEnd(orbit)


def _starts(motion: Trajectory, orbit: HuntingOrbit) -> Iterator[dict[str, Any]]:
    """Where motions are let go: beside the set point, in ever more digits; then on the cycle, where it turns round."""
    with suppress(NoOrbit):
        a = stick_position(orbit)
        yield from (_stuck(orbit.servo, orbit.gain, motion.set_point, a, digits) for digits in START_DIGITS)
    _, x = orbit.sample()
    turn = x[:, np.argmax(np.abs(x[0]))]
    names = ("position", "velocity", "integral", "bristle")[: len(turn)]
    values = (motion.set_point + turn[0], 0.0, *turn[2:])
    yield {name: float(f"{value:.{DIGITS_ON_IT}g}") for name, value in zip(names, values, strict=True)}


def _stuck(servo: Servo, gain: float, set_point: float, a: float, digits: int) -> dict[str, Any]:
    """Stuck at the distance a from the set point, the distance rounded to so many digits."""
    kp, _, ki = servo.torque_gains(gain)
    decimals = digits - 1 - math.floor(math.log10(a))
    position = round(set_point - round(a, decimals), max(decimals, 0))
    integral = (kp * (set_point - position) - SECTION * servo.friction.static) / ki
    return {"position": position, "integral": float(f"{max(0.0, integral):.{digits + 1}g}")}
