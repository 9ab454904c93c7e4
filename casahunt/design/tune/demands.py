"""What a tuning may be asked for: demands, bounds, costs.

    cost    c = ln K, ln(K tau_d), ln(K kd') by gains (high-frequency gain), or -ln rho (settling)

rho [1/s] is the decay rate of the slowest pole of the linear loop without delay; settling time to two per cent:
ln(50)/rho.  Symbols as in servo/servo.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...checks import choice_of, require, sensible, shown
from ...errors import InputError
from ...servo.controller import BY_GAINS, BY_TIMES
from ...servo.drive import Drive
from ...servo.linear.linear_loop import linear_loop
from ...servo.linear.sampled_loop import Lag
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import loop_asked
from ...servo.parts.wiring import UNGIVEN
from ...servo.servo import Servo
from ...servo.units import unit_of

Array = np.ndarray

COSTS = {
    "gain": "gain K [V/rad]",
    "high-frequency": "high-frequency gain K tau_d, or K kd [V s/rad]",
    "settling": "settling time of the linear loop to two per cent [s]",
}
DEMANDS = ("phase margin", "gain margin (lowering)", "gain margin (raising)")
"""What is asked of the linear loop of every servo (loop_set.py)."""
BARELY_STABLE = 1e-6
"""Phase margin [rad] that is always asked for: on the edge of stability rounding decides."""
LARGEST_FACTOR = 1e6
"""Largest margins that can be asked for; loops keep 10 or 100."""
FREE_FACTOR = 2.0
"""Default bounds of a free number of the controller: this factor to both sides."""
NUMBERS = BY_TIMES + BY_GAINS
"""What may be freed: the numbers of the servo's controller, of one of its two forms."""
MOST_FREE = 2
"""Numbers of a controller that are free at once, besides the gain."""


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
    delay, sample_time : of the loop [s]; >= 0; left out where `drive` has them.
    drive : as built; with a sample time alone, one with every default.  The search has most of it in its margins,
        the checks, which may speak against a tuning, all (`margins`).
    max_torque : largest torque of the motor on the simulated tasks [N m]; > 0.
    step : of the set point in these tasks, and a tenth of it [rad]; > 0; None: 1 rad, or one unit of length.

    Examples
    --------
    >>> from casahunt import Demands
    >>> Demands(margin=0.2, delay=0.001).lag.delay  # [s]
    0.001
    """

    margin: float = 0.1
    phase_margin: float = 30.0
    gain_margin: float = 2.0
    delay: float = 0.0
    sample_time: float = 0.0
    drive: Drive | None = None
    max_torque: float = math.inf
    step: float | None = None

    def __post_init__(self) -> None:
        require("margin", self.margin, at_least=0, at_most=LARGEST_FACTOR)
        require("phase-margin", self.phase_margin, at_least=0, at_most=180, unit="degrees")
        require("gain-margin", self.gain_margin, at_least=1, at_most=LARGEST_FACTOR)
        sensible("delay", self.delay, zero=True, unit="s")
        sensible("sample-time", self.sample_time, zero=True, unit="s")
        if self.max_torque != math.inf:
            sensible("max-torque", self.max_torque, unit="N m")
        if self.step is not None:
            sensible("step", self.step, unit="rad")
        for key in ("delay", "sample_time") if self.drive is not None else ():
            of_drive = getattr(self.drive, key)
            if getattr(self, key) not in (0, of_drive):
                raise InputError(f"{key} = {shown(getattr(self, key))}: must be left out, or that of the drive")
            object.__setattr__(self, key, of_drive)

    @property
    def built(self) -> Drive | None:
        """`drive`, or one of the sample time; None where the loop is continuous."""
        plain = Drive(sample_time=self.sample_time, delay=self.delay) if self.sample_time else None
        return self.drive or plain

    @property
    def lag(self) -> Lag:
        """What the loops of the search have of it."""
        drive = self.built
        return Lag(self.delay, self.sample_time / 2, drive is None or drive.integration == "rectangle")

    def factors(self, name: str) -> tuple[float, float]:
        """The range of factors of the gain over which one of `DEMANDS` must hold."""
        f = self.gain_margin
        return {DEMANDS[0]: (1.0, 1.0), DEMANDS[1]: (1 / f, 1.0), DEMANDS[2]: (1.0, f)}[name]

    def least(self, name: str) -> float:
        """The smallest phi [rad] that one of `DEMANDS` allows."""
        return max(math.radians(self.phase_margin), BARELY_STABLE) if name == DEMANDS[0] else 0.0


def check_bounds(
    servo: Servo | Loop, free: Sequence[str], bounds: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """The bounds of what is tuned, all checked.

    servo: its controller is where the search starts; free: the numbers of the controller to be tuned; bounds: (low,
    high) by name; K in V/rad, times in s.
    Returns (low, high) of every free number, by default `FREE_FACTOR` to both sides, and of the gain where given.
    Raises InputError: an unknown name, a bound that is no bound, or one that leaves the servo's own number out.
    """
    own = {name.removeprefix("controller."): name for name in servo.tunable_names}
    for name in free:
        choice_of("free", name, own)
    if set(BY_GAINS) <= set(free):
        raise InputError(f"free {', '.join(free)}: must leave one out, because the gain multiplies all three")
    if len(free) > MOST_FREE:
        raise InputError(f"free {', '.join(free)}: must be {MOST_FREE} at most")
    found: dict[str, tuple[float, float]] = {}
    for name, (low, high) in bounds.items():
        choice_of("bounds", name, ("gain", *own))
        sensible(f"bounds {name}", low)
        sensible(f"bounds {name}", high)
        if not low < high:
            raise InputError(f"bounds {name} = {shown(low)},{shown(high)}: the first must be less than the second")
        if name != "gain" and name not in free:
            pair = f"{shown(low)},{shown(high)}"
            raise InputError(f"bounds {name} = {pair}: must be left out unless --free {name} is given")
        found[name] = (float(low), float(high))
    for name in free:
        value = servo.value(own[name])
        if value <= 0:
            raise InputError(f"free {name}: {own[name]} = {shown(value)} must be greater than 0 to be tuned")
        low, high = found.setdefault(name, (value / FREE_FACTOR, value * FREE_FACTOR))
        if not low <= value <= high:
            raise InputError(
                f"bounds {name} = {shown(low)},{shown(high)}: must contain the servo's own value {shown(value)}, "
                "where the search starts"
            )
    return found


def cost_of(cost: str, servo: Servo | Loop, gain: float) -> float:
    """One of `COSTS` of a loop at gain K > 0 [V/rad], in its unit; inf for the settling of an unstable loop."""
    if cost == "gain":
        return gain
    if cost == "high-frequency":
        loop = loop_asked(servo, None, 1.0, usual="switch")
        return gain * at_the_start(loop, "kd", 0.0) / loop.value("motor_gain")
    rate = -max(float(np.max(linear_loop(servo, gain, back=back).poles.real)) for back in (False, True))
    return math.log(50) / rate if rate > 0 else math.inf


def at_the_start(servo: Servo | Loop, signal: str, position: float) -> float:
    """A signal of a servo of gain 1 V/rad that stands still beside its set point [rad], with nothing wound up.

    At another gain it is so many times as large, which is not so of what carries a load.  Raises InputError: no part
    gives it.
    """
    one = loop_asked(servo, None, 1.0, usual="switch")
    if signal not in UNGIVEN and not any(signal in part.gives for part in one.present):
        parts = " and ".join(repr(part.name) for part in one.present if "demand" in part.gives)
        raise InputError(f"{signal}: {parts or 'no part'} gives none, so that nothing can be said of it")
    return one.signal_at(signal, one.settled(dict.fromkeys(one.angles, position)))


def controller_said(servo: Servo | Loop) -> str:
    """The controller's numbers for a person.

    Returns names, values and units, such as "lead_time 0.15915 s, integral_time 0.15915 s".
    """
    names = [(name, name.removeprefix("controller.")) for name in servo.controller_names]
    return ", ".join(f"{short} {servo.value(name):.5g} {unit_of(name)}".rstrip() for name, short in names)


def log_numbers(servo: Any, names: Sequence[str] | None = None) -> Array:
    """Logarithms of the controller's numbers.

    names: which; default (2,) of tau_d, tau_i [s], or (3,) of kp, ki, kd.
    """
    return np.log([servo.value(name) for name in (servo.controller_names if names is None else names)])


def with_numbers(servo: Any, q: Array, names: Sequence[str] | None = None) -> Any:
    """The servo with other controller numbers.

    q, names: their logarithms, as `log_numbers` gives them. Raises InputError: a number that a controller cannot have.
    """
    names = servo.controller_names if names is None else names
    return servo.replace(**{name: float(value) for name, value in zip(names, np.exp(q), strict=True)})
