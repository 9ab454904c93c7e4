"""What is known of remedies: a row for each, and their table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from ...axis_units import Units, carried
from ...continuation import Branch, follow
from ...errors import InputError
from ...export import Columns
from ...orbits import SystemOrbit
from ...orbits.adapt import Options
from ...results import Result
from ...servo.friction import Model
from ...servo.move import Move, told
from ...servo.outcome import SETTLES, Kind
from ...servo.parts.loop import Loop
from ...servo.parts.remedy import Corners
from .border import BORDERS

MARGIN_TO_CHOOSE = 0.1
"""What is recommended is so much more than the border, relatively: friction is seldom known better than to a tenth."""
AROUND_A_FOLD = 1e-3
"""So much farther than the border, as a part of the way there, cycles are drawn for pictures where that is a fold."""
MOST_DRAWN = 250
"""Cycles of a branch for a picture: behind its fold it goes on."""


@dataclass(frozen=True, eq=False, repr=False)
class Cure(Result):
    """One remedy.

    Attributes
    ----------
    name, unit : what it is called, and the unit of its size.
    kind : how hunting ends: "fold", "grazing", "Hopf", "comes to rest", "instability" (border.py): up to `size` there
        are stable cycles; "motions": up to `size` simulated motions hunt, cycles could not be followed so far; "none"
        where hunting goes on up to the last size that was looked at, "not found" where nobody knows, "does not fit"
        where it does not go with the loop's parts.
    size, size_error : the smallest size that ends hunting, and its estimated error, in `unit`; nan where there is none.
    recommended : more of it by the margin; of the worst servo's size where one was asked for, and found.
    rests : the set of rest positions at the recommended size, or at the last one that was looked at: corners (x1 [rad],
        torque of the motor [N m]) of a convex polygon, of an uncertain servo where it rests farthest away; () where
        nobody knows, as where friction is not the same in both directions.
    rest_error : the largest error at which the servo may stand still for ever, at `size` [rad].
    recommended_rest_error : the largest error of `rests` [rad]: demands are held against it.
    peak_torque, peak_voltage : on the step of the table, or its move, at the recommended size [N m], [V].
    settling : since its start [s]; nan where it has not settled.
    beyond, stays : sizes from the recommended one up to three times the border, and the worst that motions do there:
        "at rest", "decaying", "undecided", "hunting", "growing".
    phase_margin, lowest_factor, highest_factor : of the linear loop without dry friction at the recommended size [deg],
        as `linear_loop` has them for the servo; nan where the remedy makes the loop nonlinear (dead bands, reset,
        freeze), or the factors where it is unstable.
    moves : by how much the size moves, relatively, with a relative change of each parameter of the loop, such as static
        friction; {} where the border is no fold.
    worst_size : the largest border found among servos of an uncertain one, as it is given and at corners of its box to
        which the slopes of the border point, from corner to corner, or where there are no slopes the size with which
        motions end at all of them, in `unit`; nan where none was asked for, or found.  A servo inside of the box that
        is worse than those may exist.
    fold : where the branch of cycles folds, if hunting ends elsewhere; nan else.
    why : a sentence: why it is not seen to end hunting, or why it was not found.
    evidence : what stopped the search where it was not found, in the words of the trade; "" where nothing did.
    followed_to : the size up to which its cycles were followed, in `unit`; nan where there is none.
    first : the cycle with a small remedy, from which its branch begins; None where there is none.
    units : in which its numbers are shown.

    Examples
    --------
    >>> from casahunt import Servo, remedies
    >>> leak = remedies(Servo(), "switch", 0.04, only=["leak"]).remedies[0]
    >>> leak.kind, round(leak.size, 6), leak.unit
    ('fold', 0.246845, '1/s')
    """

    _quantities = (
        "name", "kind", "size +- size_error", "unit", "rest_error [rad]", "peak_torque [N m]", "settling [s]",
    )  # fmt: skip
    _details = (
        "size_error", "recommended", "recommended_rest_error [rad]", "rests", "peak_voltage [V]", "phase_margin [deg]",
        "lowest_factor", "highest_factor", "beyond", "stays", "moves", "worst_size", "fold", "why", "evidence",
        "followed_to",
    )  # fmt: skip

    name: str
    unit: str
    kind: str
    size: float = math.nan
    size_error: float = math.nan
    recommended: float = math.nan
    rests: Corners = ()
    rest_error: float = math.nan
    recommended_rest_error: float = math.nan
    peak_torque: float = math.nan
    peak_voltage: float = math.nan
    settling: float = math.nan
    beyond: tuple[float, ...] = ()
    stays: tuple[Kind, ...] = ()
    phase_margin: float = math.nan
    lowest_factor: float = math.nan
    highest_factor: float = math.nan
    moves: dict[str, float] = field(default_factory=dict)
    worst_size: float = math.nan
    fold: float = math.nan
    why: str = ""
    evidence: str = ""
    followed_to: float = math.nan
    first: SystemOrbit | None = None
    units: Units = carried()

    def branch(self) -> Branch[SystemOrbit]:
        """The cycles from the small remedy up to the border, and where that is a fold some behind it, for pictures.

        Returns
        -------
        Branch.

        Raises
        ------
        InputError : there is none, since no cycle was found.
        """
        if self.first is None or not math.isfinite(self.size):
            raise InputError(f"{self.name}: no cycle was found from which a branch could begin")
        vary = self.first.problem.principal
        # A fold to this tolerance may lie on either side of the size: its branch comes back from there all the same.
        beyond = AROUND_A_FOLD * (self.size - self.first.problem.value(vary)) if self.kind == "fold" else 0.0
        return follow(
            self.first, vary, to=self.size + beyond, options=Options(tol=1e-5), monitors=(), max_points=MOST_DRAWN
        )  # fmt: skip

    @property
    def ends_hunting(self) -> bool:
        """A border was found, and at the recommended size nothing hunts."""
        return self.kind in BORDERS and self.stays[0] in SETTLES

    @property
    def keeps_it_ended(self) -> bool:
        """At no larger size that was looked at anything hunts."""
        return self.ends_hunting and all(seen in SETTLES for seen in self.stays)


@dataclass(frozen=True, eq=False, repr=False)
class Cures(Result):
    """The table of remedies.

    Attributes
    ----------
    loop, model, gain : the loop without a remedy, its friction model, K [V/rad].
    amplitude, period : of its hunting cycle [rad], [s].
    margin : by how much more than the border is recommended, relatively.
    remedies : the rows, the cheapest first; behind them those that do not end hunting.
    best : the name of the cheapest that meets the demands and keeps hunting ended at larger sizes too, of an uncertain
        servo the cheapest whose size for the worst one was found, if there is one; "" where none meets the demands.
    stable : whether motions end in that cycle; where they leave it, hunting may have ended at a lower gain.
    irregular : whether the hunting repeats in no pattern: it swings up to the amplitude, its period is a mean one, and
        all sizes are as motions show them, seen and not proved.
    step, move : by which the rows are priced: how far [rad], and the profile; None for a step of the set point.

    Examples
    --------
    >>> from casahunt import Servo, remedies
    >>> remedies(Servo(), "switch", 0.04, only=["dead band", "gain"]).best  # 0.043 rad, or 18 times the torque
    'dead band'
    """

    _quantities = ("name", "model", "gain [V/rad]", "amplitude [rad]", "period [s]", "best")
    _details = ("margin", "stable", "irregular", "step [rad]", "move")

    loop: Loop
    model: Model
    gain: float
    amplitude: float
    period: float
    remedies: tuple[Cure, ...]
    best: str
    margin: float = MARGIN_TO_CHOOSE
    stable: bool = True
    irregular: bool = False
    step: float = 1.0
    move: Move | None = None

    @property
    def task(self) -> str:
        """What the rows are priced by, in words."""
        return told(self.move, self.step) + (" either way" if len(self.loop.ways) > 1 else "")

    @property
    def name(self) -> str:
        """What the loop is called."""
        return self.loop.name

    def _columns(self) -> Columns:
        units = {"rest_error": "rad", "peak_torque": "Nm", "peak_voltage": "V", "settling": "s", "phase_margin": "deg"}
        said = ("name", "kind", "size", "size_error", "unit", "recommended", "worst_size", *units, "lowest_factor",
                "highest_factor", "why")  # fmt: skip
        columns = {
            {"name": "remedy"}.get(key, f"{key}_{units[key]}" if key in units else key): [
                getattr(row, key) for row in self.remedies
            ]
            for key in said
        }
        moving = dict.fromkeys(name for row in self.remedies for name in row.moves)
        return columns | {
            f"moves_with_{name}": [row.moves.get(name, math.nan) for row in self.remedies] for name in moving
        }

    def _more(self) -> dict[str, Any]:
        return {"remedies": [row.to_dict() for row in self.remedies]}
