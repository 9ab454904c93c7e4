"""The move that a servo makes: the set point goes from where it is to where it is to be, at once or by a profile.

    r(t)    distance that is ahead of the set point;   r = distance, r' = 0 at the start;   r = 0, r' = 0 at the end
    trapezoid (jerk infinite)    speeds up with A to the speed v, cruises, slows down with A
    S-curve                      speeds up with the jerk J, the acceleration A, the jerk -J; cruises; the same backwards

    time to speed up      v/A + A/J,   where v < A^2/J, and A is not reached, 2 sqrt(v/J)
    the speed v           V; of a shorter way what is reached half-way: A (sqrt((A/J)^2 + 4 D/A) - A/J)/2, or
                          (J D^2/4)^(1/3) where A is not reached

The controller sees the error x1 + r and its rate x2 - v, in a part of the loop whose modes are the stretches of the
profile (parts/part.py), x1 being measured from the end of the move, as ever.

Source: Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, Springer 2008, section 3.4.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from ..axis_units import quantity
from ..checks import floated, of_kind, sensible
from .parts.loop import Loop
from .parts.part import Edge, Function, Law, Part, PartMode

CLOCK = "move_time"
"""The state that counts the time of a move [s]."""
NO_TIME = 1e-9
"""Part of a move below which a stretch of it has no length."""


@dataclass(frozen=True)
class Move:
    """A profile of the set point.

    Attributes
    ----------
    speed : the largest one [rad/s], > 0.
    acceleration : the largest one [rad/s2], > 0.
    jerk : the largest one [rad/s3]; infinite for a trapezoid.

    Examples
    --------
    >>> from casahunt import Move, Servo, simulate
    >>> Move(speed=0.5, acceleration=2.0).time(1.0)  # of a move of 1 rad: 0.25 s up, 1.75 s at 0.5 rad/s, 0.25 s down
    2.25
    >>> motion = simulate(Servo(), "switch", 0.04, time=60.0, move=Move(speed=0.5, acceleration=2.0))
    >>> motion.verdict.kind, bool(motion.peak_torque < simulate(Servo(), "switch", 0.04, time=60.0).peak_torque)
    ('hunting', True)
    """

    speed: float
    acceleration: float
    jerk: float = math.inf

    def __post_init__(self) -> None:
        sensible("speed", self.speed)
        sensible("acceleration", self.acceleration)
        if self.jerk != math.inf:
            sensible("jerk", self.jerk)
        floated(self)

    def stretches(self, distance: float) -> tuple[tuple[float, float, float], ...]:
        """Duration [s], acceleration at the start [rad/s2] and jerk [rad/s3] of each stretch, on the way ahead.

        distance: [rad], of any sign.
        """
        D, A, J = abs(distance), self.acceleration, self.jerk
        if D == 0:
            return ()
        to_A = A / J
        v = A * (math.sqrt(to_A**2 + 4 * D / A) - to_A) / 2
        v = min(self.speed, v if v >= A * to_A else (J * D**2 / 4) ** (1 / 3))
        if v >= A * to_A:
            up = [(to_A, 0.0, J), (v / A - to_A, A, 0.0), (to_A, A, -J)] if to_A else [(v / A, A, 0.0)]
        else:
            half = math.sqrt(v / J)
            up = [(half, 0.0, J), (half, J * half, -J)]
        cruise = D / v - sum(duration for duration, *_ in up)
        down = [(t, -(a + j * t if j else a), j) for t, a, j in reversed(up)]
        every = [*up, (cruise, 0.0, 0.0), *down]
        return tuple(each for each in every if each[0] > NO_TIME * D / v)

    def time(self, distance: float) -> float:
        """How long a move takes.

        Parameters
        ----------
        distance
            [rad], of any sign.

        Returns
        -------
        [s].
        """
        return sum(duration for duration, *_ in self.stretches(distance))


@lru_cache(maxsize=64)
def move_part(distance: float, speed: float, acceleration: float, jerk: float) -> Part:
    """A move as a part of a loop."""
    modes, t, r, v = list[PartMode](), 0.0, abs(distance), 0.0
    sign, stretches = math.copysign(1.0, distance), Move(speed, acceleration, jerk).stretches(distance)
    for k, (duration, a, j) in enumerate(stretches, 1):
        last = k == len(stretches)
        law = Law({CLOCK: lambda x, s, p: 1.0}, _ahead(sign, t, (r, v, a, j)))
        end, following = t + duration, "" if last else f"move {k + 1} of {len(stretches)}"
        ends = (Edge("arrives" if last else "goes on", _until(end), +1, following),)
        modes.append(PartMode(f"move {k} of {len(stretches)}", law, ends, where=_before(end)))
        r -= duration * (v + duration * (a / 2 + duration * j / 6))
        v, t = v + duration * (a + duration * j / 2), end
    return Part("move", (CLOCK,), modes=(*modes, PartMode("")), even=(CLOCK,),
                made_by=(move_part, (distance, speed, acceleration, jerk)))  # fmt: skip


def _until(end: float) -> Function:
    """What rises through zero at a time [s]."""
    return lambda x, s, p: x.move_time / end - 1


def _before(end: float) -> Function:
    """Whether it is earlier."""
    return lambda x, s, p: x.move_time < end


def _ahead(sign: float, start: float, of: tuple[float, float, float, float]) -> dict[str, Any]:
    """What a stretch gives: the way that is ahead of the set point, and the rate of that.

    start: time; of: way ahead, speed, acceleration there, and jerk.
    """
    r, v, a, j = of

    def remaining(x: Any, s: Any, p: Any) -> Any:
        t = x.move_time - start
        return sign * (r - t * (v + t * (a / 2 + t * j / 6)))

    def rate(x: Any, s: Any, p: Any) -> Any:
        t = x.move_time - start
        return -sign * (v + t * (a + t * j / 2))

    return {"remaining": remaining, "remaining_rate": rate}


def told(move: Move | None, distance: float) -> str:
    """What a move is called: "step of 1 rad" where it is none."""
    way = quantity(distance, "rad", "g")
    if move is None:
        return f"step of {way}"
    jerk = "" if math.isinf(move.jerk) else f" and {quantity(move.jerk, 'rad/s3', 'g')}"
    limits = f"{quantity(move.speed, 'rad/s', 'g')}, {quantity(move.acceleration, 'rad/s2', 'g')}"
    return f"move of {way} with {limits}{jerk}"


def moving(loop: Loop, move: Move | None, distance: float) -> Loop:
    """A loop that makes a move of a distance [rad], from the error zero: with x1 = -distance; itself without one."""
    if move is None:
        return loop
    return loop.with_parts(move_part(distance, move.speed, move.acceleration, move.jerk))


def begins_in(loop: Loop, move: Move | None, start: Mapping[str, float]) -> str:
    """The mode in which a motion begins; of a move one that two others are parts of: nothing pulls to a side yet."""
    named = loop.mode_at(**start)
    whole = next(mode.unsplit for mode in loop.system.modes if mode.name == named)
    return named if move is None else whole or named


def a_move(value: Any) -> Move | None:
    """What must be a move, or None for a step.  Raises InputError: it is neither."""
    how = "such as Move(speed=0.5, acceleration=2.0), or None for a step"
    move: Move | None = None if value is None else of_kind("move", value, Move, how)
    return move
