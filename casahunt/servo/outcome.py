"""What becomes of a motion: one vocabulary for every servo, as its equations have it or as its drive runs it.

    at rest    nothing moves any more, or it is at the set point, but for what the motion is known to
    decaying   it comes to rest behind its end, or its swings shrink geometrically towards nothing
    hunting    it goes on for ever: its swings repeat, after a pattern of so many, or irregularly, in none of up to 8
    growing    it leaves the set point for good
    undecided  none of these was seen, and the sentence says how far it was looked for
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..axis_units import Units, carried
from ..results import Result

Kind = Literal["at rest", "decaying", "undecided", "hunting", "growing"]
BY_SEVERITY: tuple[Kind, ...] = ("at rest", "decaying", "undecided", "hunting", "growing")
SETTLES: tuple[Kind, ...] = ("at rest", "decaying")
"""Kinds of a motion that rests or is on its way to."""


@dataclass(frozen=True, repr=False)
class Outcome(Result):
    """What becomes of a motion.

    Attributes
    ----------
    kind : "hunting", "decaying", "growing", "at rest" or "undecided".
    sentence : what supports it, or what is missing.
    amplitude : half of the largest swing, from turning point to turning point, of the hunting [rad], to
        some 1e-4 of itself; nan where it does not hunt.
    period : of the whole pattern [s]; without one, mean time of two swings; nan likewise.
    pattern : swings after which hunting repeats; 0 where it hunts irregularly, or does not.
    swings, lasts : the last ones [rad], and how long they take [s].
    behind : time behind the end of the motion for which it was followed on until that was seen [s].
    rests_since : time from which on it has not moved, but for what it is known to [s]; nan where it does.
    waits : time behind the end at which a servo that is stuck for now breaks away [s]; nan elsewhere.
    units : in which the sentence is.

    Examples
    --------
    >>> from casahunt import Drive, Servo, simulate, simulate_sampled
    >>> simulate(Servo(), "switch", 1.0, position=0.99, time=40.0).verdict.kind
    'at rest'
    >>> seen = simulate_sampled(Servo(), 0.04, Drive(sample_time=2e-3), time=150.0).verdict
    >>> seen.kind, seen.pattern, round(seen.period, 1)  # s
    ('hunting', 2, 10.3)
    """

    _quantities = ("kind", "amplitude [rad]", "period [s]", "pattern")
    _details = ("sentence", "swings", "lasts", "mean_period [s]", "behind [s]")

    kind: Kind
    sentence: str
    amplitude: float = math.nan
    period: float = math.nan
    pattern: int = 0
    swings: tuple[float, ...] = ()
    lasts: tuple[float, ...] = ()
    behind: float = 0.0
    rests_since: float = math.nan
    waits: float = math.nan
    units: Units = carried()

    @property
    def irregular(self) -> bool:
        """Whether it hunts, and repeats in no pattern."""
        return self.kind == "hunting" and not self.pattern

    @property
    def mean_period(self) -> float:
        """Mean time of two swings [s]."""
        return self.period / max(self.pattern / 2, 1)

    @property
    def unevenness(self) -> float:
        """By how much the swings of a pattern, or the last ones, differ in size or time, relative to the largest or
        longest."""
        sizes, times = (np.array(values[-self.pattern :]) for values in (self.swings, self.lasts))
        return max(float(np.ptp(values) / values.max()) for values in (sizes, times))
