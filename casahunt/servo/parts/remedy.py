"""A remedy against hunting: a part of a loop, and what is to be known of it to find and to price its smallest size.

    size      the parameter of the part, at whose value `absent` the loop is the one without it
    at rest   |x1| <= rest(size): the largest error at which the servo may stand still for ever
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from .part import Part

Rest = Callable[[float, Mapping[str, float]], float]
"""(size, numbers of the loop with kp, kd, ki in torque) -> the largest error at rest [rad]."""


@dataclass(frozen=True, eq=False)
class Remedy:
    """A remedy.

    Attributes
    ----------
    name : what it is called, such as "dead band".
    size : the parameter that is its size.
    unit : the unit of the size; "" for a number.
    rest : the largest error at rest, by the size.
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
    >>> round(leak.rest(0.25, {"static": 0.53, "kp": 1.28, "ki": 4.02}), 4)  # rad: |kp e + ki e/leak| <= Fs
    0.0305
    """

    name: str
    size: str
    unit: str
    rest: Rest
    part: Part | None = None
    instead: str = ""
    sense: int = 1
    first: float = 0.05
    last: float = 1.0
    scale: str = "one"
    needs: tuple[str, ...] = ("switch", "lugre")
    why_not: str = ""

    @property
    def starts_at_one(self) -> bool:
        """Whether the remedy is absent at one, as a factor is."""
        return self.part is not None and self.part.absent == 1.0
