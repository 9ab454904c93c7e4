"""A remedy against hunting: a part of a loop, and what is to be known of it to find and to price its smallest size.

    size      the parameter of the part, at whose value `absent` the loop is the one without it
    at rest   the set of (x1, torque m) at which the servo may stand still for ever: a convex polygon, mirrored in zero

Without a remedy, stuck next to the set point the integrator winds up until the servo breaks away: x1 = 0, |m| <= Fs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .part import Part

Corners = tuple[tuple[float, float], ...]
"""Those of a convex polygon: x1 [rad], torque of the motor [N m]."""
Rests = Callable[[float, Mapping[str, float]], Corners]
"""(size, numbers of the loop with kp, kd, ki in torque) -> the set of rest positions."""


def at_the_set_point(size: float, p: Mapping[str, float]) -> Corners:
    """Rest at the set point alone, with any torque that friction holds."""
    return (0.0, p["static"]), (0.0, -p["static"])


def anywhere_within(size: float, p: Mapping[str, float]) -> Corners:
    """Rest at any |x1| <= size, with any torque that friction holds."""
    return (-size, p["static"]), (size, p["static"]), (size, -p["static"]), (-size, -p["static"])


@dataclass(frozen=True, eq=False, repr=False)
class Remedy:
    """A remedy.

    Attributes
    ----------
    name : what it is called, such as "dead band".
    size : the parameter that is its size.
    unit : the unit of the size; "" for a number.
    rests : the set of rest positions, by the size.
    part : the part that comes to the loop; None where the size is a parameter of the loop as it is.
    instead : part of the loop in whose place it comes, by name.
    sense : +1 where a larger size is more of the remedy, -1 where a smaller one is.
    first, last : sizes between which its border is sought, as parts of `scale`.
    scale : what sizes are measured by: "amplitude" [rad], "rate" 1/period [1/s], "period" [s], "own" for the value
        that the loop has, "one" for a number.
    needs : the friction models with which it goes.
    why_not : what a user is told where no size ends hunting.

    Examples
    --------
    >>> from casahunt.servo.parts import REMEDIES
    >>> leak = next(remedy for remedy in REMEDIES if remedy.name == "leak")
    >>> leak.size, leak.unit, leak.part
    ('leak', '1/s', <Part: leak>)
    >>> corner, _ = leak.rests(0.25, {"static": 0.53, "kp": 1.28, "ki": 4.02})  # |kp x1 + ki x1/leak| <= Fs
    >>> round(corner[0], 4)  # rad
    -0.0305
    """

    name: str
    size: str
    unit: str
    rests: Rests
    part: Part | None = None
    instead: str = ""
    sense: int = 1
    first: float = 0.05
    last: float = 1.0
    scale: str = "one"
    needs: tuple[str, ...] = ("switch", "lugre")
    why_not: str = ""

    def __repr__(self) -> str:
        return f"<Remedy: {self.name}>"

    @property
    def starts_at_one(self) -> bool:
        """Whether the remedy is absent at one, as a factor is."""
        return self.part is not None and self.part.absent == 1.0
