"""The amplitude below which a stuck servo settles: the unstable hunting cycle, checked by following the motion.

The servo stands at x1 = -a on the verge of breakaway. The event map a -> |P(a)| (servo/event_map/slopes.py for Switch,
servo/event_map/half_cycle.py for LuGre) follows it from stick to stick. On the symmetric part of the phase space that
the map describes, the unstable cycle a* = P(a*) is the border: from below it the swings die out, from above it they
grow. Where P jumps close above a* the border stays a*: the map is increasing there.

What they grow to.  As a rule the stable cycle.  Past a symmetry breaking (half multiplier mu < -1) the symmetric cycle
is unstable too and the servo hunts next to it, lopsidedly; where the linear loop is unstable and the stable cycle has
left the branch, nothing that was computed bounds them.  The border is the same in all three cases.

What is compared.  Switch: the stick position is the amplitude, max |x1|, and the check starts from (1 -+ delta) a*.
LuGre: while the servo is stuck x1 creeps by the bend of the bristle, of the size of Fs/sigma0, so the stick
position is read where m = 0.9 Fs before breakaway, on the unstable orbit too; the start of the check is stuck on a
steadily bent bristle, which is the orbit's state there up to its creep.  The border is given as that stick position
and as max |x1| of the unstable orbit.

delta: one rounding error of a grows to mu eps; delta = 0.01 is 1e-2/eps times larger and the first swing
already takes the motion away by mu delta.  The claim tested is that of the two sides, not the last digit of a*; the
digits are those of the orbit's error estimate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import of_kind, require
from ..errors import InputError, NoOrbit, Status
from ..export import Columns, columns_from
from ..motion import MarchFailure
from ..orbits import Options
from ..results import Result
from .cycles import motor_torque
from .event_map.half_cycle import SECTION, half_cycle
from .event_map.slopes import map_at
from .find_orbit import find_orbit
from .friction import Model
from .problem import HuntingOrbit
from .servo import Servo

Array = np.ndarray

OFFSET = 0.01
"""`delta` of the module docstring."""
FEW_SWINGS, MOST_SWINGS = 60, 2000
"""Swings followed: three times those that the multipliers of the two cycles need to carry a motion away from the one
and close to the other, and these at least and at most."""
SHRUNK = 0.5
"""Below this part of the border, and still shrinking, a motion has settled."""
ARRIVED = 0.2
"""Part of the way between the two cycles that a motion which has grown to the stable one may be away from it."""
GROWN = 3.0
"""Times the border at which a motion that no stable cycle bounds has grown beyond doubt."""


CSV_COLUMNS = ("from", "swing", "stick_position_rad", "outcome", "border_rad", "border_error_rad")
"""Columns of the table of a border: the stick positions of the two motions."""


@dataclass(frozen=True, eq=False, repr=False)
class Trial(Result):
    """A motion followed from one side of the border.

    Attributes
    ----------
    start : stick position [rad].
    positions : (s + 1,) stick positions after each swing, `start` first [rad].
    outcome : "settles"; "hunts", where it arrives at the stable cycle, or goes on beyond the border to the last swing
        next to a symmetric cycle that is not stable; "grows", where no stable cycle is known; or "undecided".
    """

    _quantities = ("start [rad]", "outcome")
    _details = ("positions",)

    start: float
    positions: Array
    outcome: str


@dataclass(frozen=True, eq=False, repr=False)
class Basin(Result):
    """The border between settling and hunting.

    Attributes
    ----------
    unstable : the unstable cycle.
    outer : the symmetric cycle on the stable side of the fold; None where it was not found.
    why_no_outer : the sentence of the refusal where it was not.
    border : stick position of the unstable cycle [rad]; for Switch its amplitude.
    outer_position : stick position of the outer cycle [rad]; nan where there is none.
    error_estimate : relative, of the unstable cycle's amplitude and period.
    inside, outside : the motions from both sides.
    offset : relative distance from the border at which they start, at most.

    Examples
    --------
    >>> from casahunt import Servo, basin
    >>> found = basin(Servo(), "switch", 0.5)
    >>> found.inside.outcome, found.outside.outcome, found.confirmed
    ('settles', 'hunts', True)
    """

    _quantities = (
        "model = unstable.model", "gain = unstable.gain [V/rad]", "border [rad] ~ error_estimate",
        "outer_position [rad]", "confirmed",
    )  # fmt: skip
    _details = (
        "unstable_amplitude = unstable.amplitude [rad]", "outer_amplitude = outer.amplitude [rad]", "unstable", "outer",
        "why_no_outer", "inside", "outside", "offset",
    )  # fmt: skip

    unstable: HuntingOrbit
    outer: HuntingOrbit | None
    why_no_outer: str
    border: float
    outer_position: float
    error_estimate: float
    inside: Trial
    outside: Trial
    offset: float

    def _more(self) -> dict[str, Any]:
        multiplier, stable = (self.outer.half_multiplier, self.outer.stable) if self.outer else (None, None)
        return {"outer_half_multiplier": multiplier, "outer_stable": stable}

    def _columns(self) -> Columns:
        error = self.border * self.error_estimate
        rows = [
            (name, i, position, trial.outcome, self.border, error)
            for name, trial in (("inside", self.inside), ("outside", self.outside))
            for i, position in enumerate(trial.positions)
        ]
        return columns_from(CSV_COLUMNS, rows)

    @property
    def confirmed(self) -> bool:
        """The motion from inside settles, the one from outside does not."""
        return self.inside.outcome == "settles" and self.outside.outcome in ("hunts", "grows")


def basin(servo: Servo, model: Model, gain: float, *, options: Options | None = None, offset: float = OFFSET) -> Basin:
    """The stick position below which a servo at a gain settles, checked by two motions.

    Parameters
    ----------
    servo, model, gain
        the problem; gain K > 0 [V/rad].
    options
        tolerance of the two cycles.
    offset
        relative distance from the border at which the two motions start, between 1e-6 and 0.5; the outer one starts at
        most half-way to the outer cycle.

    Returns
    -------
    Basin: both cycles, their stick positions [rad] and the two motions; without an outer cycle, why there is none.

    Raises
    ------
    InputError : a value out of range.
    NoOrbit : there is no hunting cycle (everything settles, as far as the scan shows), or it was not computed.

    Examples
    --------
    >>> from casahunt import Servo, basin
    >>> round(1e3 * basin(Servo(), "switch", 0.5).border, 3)  # mrad
    1.181
    """
    if not 1e-6 <= require("offset", offset) <= 0.5:
        raise InputError(f"offset = {offset:g}: must lie between 1e-6 and 0.5")
    options = of_kind("options", options or Options(), Options)
    unstable = find_orbit(servo, model, gain, branch="unstable", options=replace(options, half=True))
    outer, why = None, ""
    try:
        outer = find_orbit(servo, model, gain, options=options)
    except NoOrbit as error:
        why = str(error)
    border = stick_position(unstable)
    hunting = stick_position(outer) if outer is not None else float("nan")
    beyond = offset if outer is None else min(offset, 0.5 * abs(hunting / border - 1))
    away = np.log10(1 / min(offset, beyond)) / max(unstable.multipliers.log10_leading, 1e-6)
    towards = 0.0 if outer is None else np.log10(1 / ARRIVED) / max(-outer.multipliers.log10_leading, 1e-6)
    swings = int(np.clip(3 * (away + towards), FEW_SWINGS, MOST_SWINGS))
    inside, outside = (
        until_settled(
            servo, model, gain, border * factor, border, hunting,
            stable=outer is not None and outer.stable is True, swings=swings,
        )
        for factor in (1 - offset, 1 + beyond)
    )  # fmt: skip
    return Basin(unstable, outer, why, border, hunting, unstable.error_estimate, inside, outside, offset)


def stick_position(orbit: HuntingOrbit) -> float:
    """|x1| of the stuck servo [rad]: the amplitude for Switch, |x1| where m = 0.9 Fs comes up for LuGre.

    Raises NoOrbit: the torque does not come up to 0.9 Fs at a standstill.
    """
    if orbit.model == "switch":
        return orbit.amplitude
    _, x = orbit.sample()
    torque = np.asarray(motor_torque(x, orbit.servo.parameters(orbit.gain)), float)
    level = SECTION * orbit.servo.friction.static
    # Breakaway in either direction: stuck on one side of the set point, torque towards the other.
    for side in (-1.0, 1.0):
        m = -side * torque
        rising = np.flatnonzero((m[:-1] < level) & (m[1:] >= level) & (side * x[0, :-1] > 0))
        slow = [i for i in rising if abs(x[1, i]) < 1e-2 * np.max(np.abs(x[1]))]
        if slow:
            i = slow[-1]
            weight = (level - m[i]) / (m[i + 1] - m[i])
            return float(abs(x[0, i] + weight * (x[0, i + 1] - x[0, i])))
    raise NoOrbit(
        f"the {orbit.model} cycle at gain {orbit.gain:g} does not stand still at {SECTION:g} Fs: no stick position",
        Status.INADMISSIBLE,
    )


def until_settled(
    servo: Servo,
    model: Model,
    gain: float,
    a: float,
    border: float,
    hunting: float,
    *,
    stable: bool = True,
    swings: int = FEW_SWINGS,
) -> Trial:
    """Follow a motion from the stick position `a` until it has settled or hunts.

    a: where it starts [rad], > 0; border, hunting: stick positions of the unstable and of the outer cycle [rad]; nan
    where there is no outer one; stable: whether the outer cycle is stable, so that a motion next to it has arrived.
    Returns trial: the stick positions [rad] and what has become of the motion. Raises InputError: a not > 0.
    """
    a = require("a", a, above=0)
    start, positions, outcome = a, [a], "undecided"
    for _ in range(swings):
        try:
            following = (
                map_at(servo, gain, a).position if model == "switch" else half_cycle(model, servo, gain, a).position
            )
        except MarchFailure:
            break
        previous, a = a, abs(following)
        if not np.isfinite(a):
            break
        positions.append(a)
        if a < SHRUNK * border and a < previous:
            outcome = "settles"
            break
        if stable and abs(a - hunting) < ARRIVED * abs(hunting - border):
            outcome = "hunts"
            break
        if not np.isfinite(hunting) and a > GROWN * border:
            outcome = "grows"
            break
    else:
        if not stable and min(positions) > border and max(positions) < GROWN * hunting:
            outcome = "hunts"
    return Trial(start, np.array(positions), outcome)
