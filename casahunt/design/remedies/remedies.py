"""The table of remedies: for each the smallest size that ends hunting, its error, its price.

cycle of the servo at its gain -> border of each remedy (border.py) -> a little more of it: its price (price.py)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from ...checks import choice_of, require
from ...continuation import Branch, follow
from ...errors import InputError
from ...export import Columns
from ...orbits import SystemOrbit
from ...orbits.adapt import Options
from ...results import Result
from ...servo.find_orbit import find_orbit
from ...servo.hunting import MODELS, Model, called
from ...servo.parts.linear import linear_margins
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import loop_of
from ...servo.parts.remedy import Corners, Remedy
from ...servo.parts.table import REMEDIES, REMEDY_NAMES, remedy_name
from ...servo.problem import HuntingOrbit
from ...servo.servo import Servo, a_servo
from ..uncertainty.set import Uncertainty, check_box
from .border import BORDERS, Border, Scales, border, with_remedy
from .price import LOOKED_PERIODS, MOST_WINDOWS, Verdict, task, verdict

MARGIN_TO_CHOOSE = 0.1
"""What is recommended is so much more than the border, relatively: friction is seldom known better than to a tenth."""
LARGER_SIZES = (1.5, 2.0, 3.0)
"""So many times the border is looked at besides: whether a larger size keeps hunting ended."""
ENDED = ("rests", "decays")
"""Verdicts of motions that hunt no more."""
MOST_DRAWN = 250
"""Cycles of a branch for a picture: behind its fold it goes on."""
MOST_CORNERS = 4
"""Corners of an uncertain servo at which the border is computed: slopes there lead to the next one."""


@dataclass(frozen=True, eq=False, repr=False)
class Cure(Result):
    """One remedy.

    Attributes
    ----------
    name, unit : what it is called, and the unit of its size.
    kind : how hunting ends: "fold", "grazing", "Hopf", "unstable" (border.py): up to `size` there are cycles, the last
        of which may be unstable, so that hunting may end with less; "none" where hunting goes on up to the last size
        that was looked at, "not found" where nobody knows.
    size, size_error : the smallest size that ends hunting, and its estimated error, in `unit`; nan where there is none.
    recommended : more of it by the margin; of the worst servo's size where one was asked for, and found.
    rests : the set of rest positions at the recommended size, or at the last one that was looked at: corners (x1 [rad],
        torque of the motor [N m]) of a convex polygon; () where nobody knows.
    rest_error : the largest error at which the servo may stand still for ever, at `size` [rad].
    recommended_rest_error : the same at the recommended size [rad]: demands are held against it.
    peak_torque, peak_voltage : on a step of 1 rad, at the recommended size [N m], [V].
    settling : of that step [s]; nan where it has not settled.
    beyond, stays : sizes from the recommended one up to three times the border, and the worst that motions do there:
        "rests", "decays", "undecided", "hunts", "grows".
    phase_margin, lowest_factor, highest_factor : of the linear loop without dry friction at the recommended size [deg],
        as `linear_loop` has them for the servo; nan where the remedy makes the loop nonlinear (dead bands, reset,
        freeze), or the factors where it is unstable.
    moves : by how much the size moves, relatively, with a relative change of each parameter of the loop, such as static
        friction; {} where the border is no fold.
    worst_size : the largest border found among servos of an uncertain one, at corners of its box to which the slopes of
        the border point, from corner to corner (at each of up to four where there are no slopes), in `unit`; nan where
        none was asked for, or found.  A servo inside of the box that is worse than those may exist.
    why : a sentence: why it is not seen to end hunting, or why it was not found.
    followed_to : the size up to which its cycles were followed, in `unit`; nan where there is none.
    first : the cycle with a small remedy, from which its branch begins; None where there is none.

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
        "lowest_factor", "highest_factor", "beyond", "stays", "moves", "worst_size", "why",
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
    stays: tuple[Verdict, ...] = ()
    phase_margin: float = math.nan
    lowest_factor: float = math.nan
    highest_factor: float = math.nan
    moves: dict[str, float] = field(default_factory=dict)
    worst_size: float = math.nan
    why: str = ""
    followed_to: float = math.nan
    first: SystemOrbit | None = None

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
        return follow(
            self.first, vary, to=self.size, options=Options(tol=1e-5), monitors=(), max_points=MOST_DRAWN
        )  # fmt: skip

    @property
    def ends_hunting(self) -> bool:
        """A border was found, and at the recommended size nothing hunts."""
        return self.kind in BORDERS and self.stays[0] in ENDED

    @property
    def keeps_it_ended(self) -> bool:
        """At no larger size that was looked at anything hunts."""
        return self.ends_hunting and all(seen in ENDED for seen in self.stays)


@dataclass(frozen=True, eq=False, repr=False)
class Cures(Result):
    """The table of remedies.

    Attributes
    ----------
    servo, model, gain : the problem; gain K [V/rad].
    amplitude, period : of the hunting cycle without a remedy [rad], [s].
    margin : by how much more than the border is recommended, relatively.
    remedies : the rows, the cheapest first; behind them those that do not end hunting.
    best : the name of the cheapest that meets the demands; "" where none does.

    Examples
    --------
    >>> from casahunt import Servo, remedies
    >>> remedies(Servo(), "switch", 0.04, only=["dead band", "gain"]).best  # 0.043 rad, or 18 times the torque
    'dead band'
    """

    _quantities = ("model", "gain [V/rad]", "amplitude [rad]", "period [s]", "best")
    _details = ("margin",)

    servo: Servo
    model: Model
    gain: float
    amplitude: float
    period: float
    remedies: tuple[Cure, ...]
    best: str
    margin: float = MARGIN_TO_CHOOSE

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


def remedies(
    servo: Servo,
    model: Model = "switch",
    gain: float = 1.0,
    *,
    only: Sequence[str] = (),
    max_error: float | None = None,
    max_torque: float | None = None,
    margin: float = MARGIN_TO_CHOOSE,
    uncertainty: Uncertainty | None = None,
    options: Options | None = None,
    progress: Callable[[Cure], None] | None = None,
) -> Cures:
    """What stops the hunting: the smallest size of each remedy, and its price.

    Parameters
    ----------
    servo, model, gain
        the problem; gain K > 0 [V/rad].
    only
        names of the remedies that are looked at; default all that go with the friction model.
    max_error, max_torque
        demands: largest error at rest [rad], largest torque on a step of 1 rad [N m].
    margin
        how much more of a remedy than at its border is recommended, relatively; above 0.
    uncertainty
        what is uncertain of the servo: each row then has the size for the worst one.
    options
        tolerance of the sizes; default 1e-8.
    progress
        called with every row as it is found.

    Returns
    -------
    Cures: its rows are sorted by price.

    Raises
    ------
    InputError : an unknown name, or a number out of range.
    NoOrbit : the servo does not hunt at this gain, or its cycle was not found.

    Examples
    --------
    >>> from casahunt import Servo, remedies
    >>> table = remedies(Servo(), "switch", 0.04, only=["dead band"])
    >>> round(table.remedies[0].size, 8)  # rad
    0.04334572
    """
    a_servo(servo)
    choice_of("model", model, MODELS)
    wanted = [remedy_name(name) for name in only] or list(REMEDY_NAMES)
    error = math.inf if max_error is None else require("max_error", max_error, above=0)
    torque = math.inf if max_torque is None else require("max_torque", max_torque, above=0)
    require("margin", margin, above=0, at_most=LARGER_SIZES[-1])
    if uncertainty is not None:
        check_box(servo, uncertainty)
    options = options or Options(tol=1e-8)
    orbit = find_orbit(servo, model, gain, options=options)
    asked = _Asked(loop_of(servo, model, gain), orbit, _on_the_cycle(orbit), options, uncertainty, margin)
    rows = []
    for remedy in REMEDIES:
        if model in remedy.needs and remedy.name in wanted:
            rows.append(_row(asked, remedy))
            if progress is not None:
                progress(rows[-1])
    rows.sort(key=_price(task(asked.loop, orbit.amplitude, orbit.period, 0.0).peak_torque, orbit))
    within = (row.name for row in rows if row.recommended_rest_error <= error and row.peak_torque <= torque
              and row.ends_hunting)  # fmt: skip
    return Cures(servo, model, gain, orbit.amplitude, orbit.period, tuple(rows), next(within, ""), margin)


@dataclass(frozen=True, eq=False)
class _Asked:
    """What all rows are about: the loop without a remedy, its cycle and a state on it, how it is computed, what is
    uncertain, the margin."""

    loop: Loop
    orbit: HuntingOrbit
    start: dict[str, float]
    options: Options
    uncertainty: Uncertainty | None
    margin: float

    @property
    def scales(self) -> Scales:
        """What sizes are measured by."""
        return Scales(self.orbit.amplitude, self.orbit.period)


def _on_the_cycle(orbit: HuntingOrbit) -> dict[str, float]:
    """A state of a cycle away from events: where it has just stopped, or in mid-slip."""
    stuck = next((arc for arc in orbit.arcs if arc.mode == "stick"), None)
    states = (stuck or orbit.arcs[0]).states
    state = dict(zip(orbit.problem.system.states, map(float, states[0, states.shape[1] // 2]), strict=True))
    return state if stuck is None else state | {"x2": 0.0}  # not the rounding of zero, which would slip


def _price(today: float, orbit: HuntingOrbit) -> Callable[[Cure], tuple[bool, float]]:
    """By what rows are sorted: those that end hunting first; then the sum of

    error at rest / amplitude of the hunting + (peak torque / that of today - 1) + settling time / its period.
    """

    def of(row: Cure) -> tuple[bool, float]:
        settling = row.settling if math.isfinite(row.settling) else LOOKED_PERIODS * MOST_WINDOWS * orbit.period
        price = row.recommended_rest_error / orbit.amplitude + (row.peak_torque / today - 1) + settling / orbit.period
        return not row.ends_hunting, price if math.isfinite(price) else math.inf

    return of


def _row(asked: _Asked, remedy: Remedy) -> Cure:
    """One remedy, found and priced."""
    loop, found = asked.loop, border(asked.loop, remedy, asked.start, asked.scales, asked.options)
    numbers = _numbers(loop)
    if found.kind == "not found":
        return Cure(remedy.name, remedy.unit, found.kind, why=found.why, followed_to=found.size, first=found.first)
    if found.kind == "none":
        tried = f"hunting goes on up to {found.size:.4g} {remedy.unit}".rstrip()
        return Cure(
            remedy.name, remedy.unit, found.kind, rests=remedy.rests(found.size, numbers),
            why=f"{tried}, the last size looked at: {remedy.why_not}".rstrip(": "), followed_to=found.size,
            first=found.first,
        )  # fmt: skip
    size, absent = found.size, remedy.part.absent if remedy.part is not None and remedy.part.size else 0.0
    worst = _worst(asked, remedy, found)
    least = worst if math.isfinite(worst) else size
    beyond = tuple(_more(least, absent, factor, remedy.sense) for factor in (1 + asked.margin, *LARGER_SIZES))
    recommended, last = beyond[0], found.orbit or asked.orbit
    mended = with_remedy(loop, remedy, recommended)
    rests = remedy.rest(recommended, numbers)
    step = task(mended, last.amplitude, last.period, rests)
    linear = linear_margins(mended)
    return Cure(
        remedy.name, remedy.unit, found.kind, size, found.error, recommended,
        rests=remedy.rests(recommended, numbers), rest_error=remedy.rest(size, numbers), recommended_rest_error=rests,
        peak_torque=step.peak_torque, peak_voltage=step.peak_torque / loop.value("motor_gain"), settling=step.settling,
        beyond=beyond,
        stays=tuple(verdict(with_remedy(loop, remedy, at), last.amplitude, last.period) for at in beyond),
        phase_margin=math.nan if linear is None else linear.phase_margin,
        lowest_factor=math.nan if linear is None else linear.lowest_factor,
        highest_factor=math.nan if linear is None else linear.highest_factor,
        moves={name: slope * loop.value(name) / size for name, slope in found.moves.items() if name in loop.parameters},
        worst_size=worst, why=found.why, followed_to=size, first=found.first,
    )  # fmt: skip


def _worst(asked: _Asked, remedy: Remedy, found: Border) -> float:
    """The size for the worst servo of a set: from corner to corner of its box, as slopes of the border point."""
    if asked.uncertainty is None:
        return math.nan
    low, high = asked.uncertainty.box(asked.orbit.servo)
    box = dict(zip(called(asked.uncertainty.parameters), zip(low.tolist(), high.tolist(), strict=True), strict=True))

    def ahead(at: Border) -> list[tuple[float, ...]]:
        """Corners to which slopes point, or all where there are few and no slopes."""
        if not at.moves:
            return list(product(*box.values())) if 2 ** len(box) <= MOST_CORNERS else []
        return [tuple(ends[at.moves.get(name, 0.0) * remedy.sense > 0] for name, ends in box.items())]

    seen: dict[tuple[float, ...], Border] = {}
    waiting = ahead(found)
    while waiting and len(seen) < MOST_CORNERS:
        corner = waiting.pop()
        if corner in seen:
            continue
        loop = asked.loop.replace(**dict(zip(box, corner, strict=True)))
        seen[corner] = border(loop, remedy, asked.start, asked.scales, asked.options)
        if seen[corner].kind in BORDERS and seen[corner].moves:
            waiting += ahead(seen[corner])
    sizes = [at.size for at in seen.values() if at.kind in BORDERS]
    return max(sizes, key=lambda size: size * remedy.sense) if len(sizes) == len(seen) and sizes else math.nan


def _more(size: float, absent: float, factor: float, sense: int) -> float:
    """More of a remedy: farther from its absence, which may be at infinity or, where less is more, at zero."""
    if absent == 0:
        return size * factor if sense > 0 else size / factor
    return size / factor if math.isinf(absent) else absent + (size - absent) * factor


def _numbers(loop: Loop) -> dict[str, float]:
    """The numbers of a loop, with kp, kd and ki in torque."""
    factor = loop.value("gain") * loop.value("motor_gain")
    return loop.parameters | {name: factor * loop.value(name) for name in ("kp", "kd", "ki")}
