"""What a tuning may be asked for: demands, bounds, costs.

    cost    c = ln K, ln(K tau_d) (high-frequency gain), or -ln rho (settling)

rho [1/s] is the decay rate of the slowest pole of the linear loop without delay; settling time to two per cent:
ln(50)/rho.  Symbols as in servo/servo.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...checks import known, require, sensible, shown
from ...errors import InputError
from ...servo.linear_loop import linear_loop
from ...servo.servo import Servo
from .loop_set import LoopDemands

Array = np.ndarray

COSTS = {
    "gain": "gain K [V/rad]",
    "high-frequency": "high-frequency gain K tau_d [V s/rad]",
    "settling": "settling time of the linear loop to two per cent [s]",
}
FREE = ("lead_time", "integral_time")
BOUNDED = ("gain", *FREE)
LARGEST_FACTOR = 1e6
"""Largest margins that can be asked for; loops keep 10 or 100."""
TIMES_FACTOR = 2.0
"""Default bounds of a free time: this factor to both sides."""
TIMES = ("controller.lead_time", "controller.integral_time")
"""The parameters behind `FREE`."""


def silent(sentence: str) -> None:
    """For those who do not ask where the computation is."""


@dataclass(frozen=True, kw_only=True)
class Demands:
    """What the tuned servo must keep.

    Attributes
    ----------
    margin : K >= (1 + margin) K_fold; 0 to 1e6.
    phase_margin : [deg], 0 to 180.
    gain_margin : factor by which the gain may fall or rise and the linear loop stays stable; 1 to 1e6.
    delay, sample_time : of the loop [s]; >= 0.
    """

    margin: float = 0.1
    phase_margin: float = 30.0
    gain_margin: float = 2.0
    delay: float = 0.0
    sample_time: float = 0.0

    def __post_init__(self) -> None:
        require("margin", self.margin, at_least=0, at_most=LARGEST_FACTOR)
        require("phase-margin", self.phase_margin, at_least=0, at_most=180, unit="degrees")
        require("gain-margin", self.gain_margin, at_least=1, at_most=LARGEST_FACTOR)
        sensible("delay", self.delay, zero=True, unit="s")
        sensible("sample-time", self.sample_time, zero=True, unit="s")

    @property
    def lag(self) -> float:
        """D = delay + half a sample [s]."""
        return self.delay + self.sample_time / 2

    @property
    def loops(self) -> LoopDemands:
        """Those on the linear loop."""
        return LoopDemands(math.radians(self.phase_margin), self.gain_margin)


def check_bounds(
    servo: Servo, free: Sequence[str], bounds: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """The bounds of what is tuned, all checked.

    Parameters
    ----------
    servo
        its times are where the search starts.
    free
        the times to be tuned.
    bounds
        (low, high) by name; K in V/rad, times in s.

    Returns
    -------
    (low, high) of every free time, by default `WIDE` to both sides, and of the gain where given.

    Raises
    ------
    InputError : an unknown name, a bound that is no bound, or one that leaves the servo's own time out.
    """
    for name in free:
        known("free", name, FREE)
    found: dict[str, tuple[float, float]] = {}
    for name, (low, high) in bounds.items():
        known("bounds", name, BOUNDED)
        sensible(f"bounds {name}", low)
        sensible(f"bounds {name}", high)
        if not low < high:
            raise InputError(f"bounds {name} = {shown(low)},{shown(high)}: the first must be less than the second")
        if name != "gain" and name not in free:
            pair = f"{shown(low)},{shown(high)}"
            raise InputError(f"bounds {name} = {pair}: must be left out unless --free {name} is given")
        found[name] = (float(low), float(high))
    for name in free:
        value = getattr(servo.controller, name)
        if value <= 0:
            raise InputError(f"free {name}: controller.{name} = {shown(value)} must be greater than 0 to be tuned")
        low, high = found.setdefault(name, (value / TIMES_FACTOR, value * TIMES_FACTOR))
        if not low <= value <= high:
            raise InputError(
                f"bounds {name} = {shown(low)},{shown(high)}: must contain the servo's own value {shown(value)}, "
                "where the search starts"
            )
    return found


def cost_of(cost: str, servo: Servo, gain: float) -> float:
    """The cost in the unit of `COSTS`; inf for the settling of an unstable loop.

    Parameters
    ----------
    cost
        one of `COSTS`.
    servo, gain
        the loop; gain K > 0 [V/rad].

    Returns
    -------
    In the unit of `COSTS`; inf for the settling of an unstable loop.
    """
    if cost == "gain":
        return gain
    if cost == "high-frequency":
        return gain * servo.controller.lead_time
    rate = -float(np.max(linear_loop(servo, gain).poles.real))
    return math.log(50) / rate if rate > 0 else math.inf


def log_times(servo: Servo) -> Array:
    """(2,) ln tau_d, ln tau_i."""
    return np.log([servo.controller.lead_time, servo.controller.integral_time])


def with_times(servo: Servo, q: Array) -> Servo:
    """The servo with other controller times.

    Parameters
    ----------
    servo
        the servo.
    q
        (2,) ln of lead and integral time [s].

    Returns
    -------
    Servo.

    Raises
    ------
    InputError : a time that a controller cannot have.
    """
    return servo.replace(**{name: float(value) for name, value in zip(TIMES, np.exp(q), strict=True)})
