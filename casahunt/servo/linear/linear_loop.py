"""The servo without dry friction as a linear loop: stability, poles, crossovers.

    loop          L(s) of open_loop.py
    closed loop   the zeros of 1 + L; of one inertia chi(s) = J s^3 + (kd + sigma2) s^2 + kp s + ki, gains.py
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...axis_units import Units, carried, in_its_units
from ...export import Columns
from ...results import Result
from ..parts.loop import Loop
from ..parts.plain_loop import loop_asked
from ..servo import Servo
from ..units import column
from .margins import Crossover, gain_crossovers, phase_crossovers
from .open_loop import either_way, open_loop

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class LinearLoop(Result):
    """The linear loop at one gain.

    Attributes
    ----------
    gain : K.
    kp, kd, ki : torque gains of a servo [N m/rad, N m s/rad, N m/(rad s)]; nan of a loop of parts.
    poles : (n,) complex poles [rad/s], by decreasing real part.
    stable : by the criterion of Routh and Hurwitz, not by the rounded poles.
    gain_crossovers : where |L| = 1, with phase margins [deg].
    phase_crossovers : where arg L = -180 degrees, with gain factors.
    lowest_factor, highest_factor : the loop stays as it is, stable or unstable, while the gain is multiplied by
        anything between them; 0 and inf where there is no such limit.
    direction : "forwards" or "back", whose viscous friction it has; "" where that is the same in both.
    units : how its numbers are shown.

    Examples
    --------
    >>> from casahunt import Servo, linear_loop
    >>> loop = linear_loop(Servo(), 0.1)
    >>> loop.stable, round(loop.damping_ratio, 3)
    (True, 0.493)
    """

    _quantities = ("gain [V/rad]", "stable", "poles [1/s]", "lowest_factor", "highest_factor")
    _details = ("kp [N m/rad]", "kd [N m s/rad]", "ki [N m/(rad s)]", "damping_ratio")

    gain: float
    kp: float
    kd: float
    ki: float
    poles: Array
    stable: bool
    gain_crossovers: tuple[Crossover, ...]
    phase_crossovers: tuple[Crossover, ...]
    lowest_factor: float
    highest_factor: float
    direction: str = ""
    units: Units = carried()

    def _columns(self) -> Columns:
        """A row; of the phase margins the least."""
        least = min(self.gain_crossovers, key=lambda c: abs(c.margin), default=None)
        row: dict[str, Any] = {
            column("gain"): self.gain,
            **({"direction": self.direction} if self.direction else {}),
            "stable": bool(self.stable),
            "phase_margin_deg": least.margin if least else math.nan,
            "crossover_rad_per_s": least.frequency if least else math.nan,
            "lowest_factor": self.lowest_factor,
            "highest_factor": self.highest_factor,
            "damping_ratio": self.damping_ratio,
            "kp_Nm_per_rad": self.kp,
            "ki_Nm_per_rad_s": self.ki,
            "kd_Nms_per_rad": self.kd,
        }
        for i, pole in enumerate(self.poles, 1):
            row |= {f"pole_{i}_re_per_s": pole.real, f"pole_{i}_im_per_s": pole.imag}
        return {name: [value] for name, value in row.items()}

    def _more(self) -> dict[str, Any]:
        crossings = (self.gain_crossovers, "phase_margin_deg"), (self.phase_crossovers, "gain_factor")
        gain, phase = ([{"frequency": c.frequency, name: c.margin} for c in items] for items, name in crossings)
        way = {"direction": self.direction} if self.direction else {}
        return {"gain_crossovers": gain, "phase_crossovers": phase, **way}

    @property
    def damping_ratio(self) -> float:
        """-Re s/|s| of the least damped pole; negative for an unstable loop."""
        return float(np.min(-self.poles.real / np.abs(self.poles)))


@in_its_units
def linear_loop(servo: Servo | Loop, gain: float | None = None, *, back: bool = False) -> LinearLoop:
    """Poles, stability, crossovers and margins of the loop without dry friction.

    Parameters
    ----------
    servo, gain
        the servo and its gain K [V/rad]; or a loop of parts, which has its own.
    back
        of viscous friction by direction, with that of a motion back in the place of that forwards.

    Returns
    -------
    LinearLoop; poles [1/s] by falling real part.

    Raises
    ------
    InputError : gain not a finite number > 0, or a loop that is not linear.

    Examples
    --------
    >>> from casahunt import Servo, linear_loop
    >>> linear_loop(Servo(), 0.1).poles.round(3).tolist()
    [(-4.424+7.817j), (-4.424-7.817j), (-4.793+0j)]
    """
    direction, servo = list(either_way(servo).items())[-1 if back else 0]
    loop = open_loop(servo, gain)
    if isinstance(servo, Loop):
        gain, (kp, kd, ki) = loop_asked(servo, None, gain, usual="switch").value("gain"), (math.nan,) * 3
    else:
        assert gain is not None  # else the loop was not opened
        kp, kd, ki = servo.torque_gains(gain)
    crossings = phase_crossovers(loop.numerator, loop.denominator)
    factors = [c.margin for c in crossings]
    return LinearLoop(
        gain=gain,
        kp=kp,
        kd=kd,
        ki=ki,
        poles=loop.poles,
        stable=loop.stable,
        gain_crossovers=gain_crossovers(loop.numerator, loop.denominator),
        phase_crossovers=crossings,
        lowest_factor=max((f for f in factors if f <= 1), default=0.0),
        highest_factor=min((f for f in factors if f >= 1), default=math.inf),
        direction=direction,
    )
