"""The table of remedies: for each the smallest size that ends hunting, its error, its price.

cycle of the loop -> border of each remedy (border.py) -> a little more of it: its price (price.py)

A servo is the loop of its parts; what is looked at is a loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from ...axis_units import in_its_units, shown_in, units_of
from ...checks import choice_of, require, sensible
from ...errors import HuntsIrregularly, InputError
from ...orbits.adapt import Options
from ...servo.find_orbit import find_orbit
from ...servo.friction import MODELS, Model
from ...servo.linear.margins import Margins, margins_of_parts
from ...servo.move import Move, a_move
from ...servo.parts.cascade import P_PI, P_PI_FILTERED
from ...servo.parts.fate import Swing
from ...servo.parts.filtered_derivative import DERIVATIVE_FILTER, DERIVATIVE_FILTER_BY_N
from ...servo.parts.inertia import INERTIA
from ...servo.parts.loop import Loop
from ...servo.parts.lugre import LUGRE
from ...servo.parts.pid import INTEGRATOR, PID_BY_GAINS, PID_BY_TIMES
from ...servo.parts.plain_loop import FRICTIONS, by_gains, loop_of
from ...servo.parts.remedy import Corners, Remedy
from ...servo.parts.switch import SWITCH
from ...servo.parts.table import REMEDY_NAMES, remedy_name, remedy_of, with_remedy
from ...servo.parts.verbs import loop_cycle
from ...servo.parts.with_exponent import WITH_EXPONENT
from ...servo.servo import Servo, a_servo, called
from ..uncertainty.set import Uncertainty, are_servos, check_box
from .border import BORDERS, MOTIONS_KNOW, Border, border
from .cures import MARGIN_TO_CHOOSE, Cure, Cures
from .handed_on import end_of_motions
from .larger_sizes import stays
from .price import task
from .sizes import more_of, scale_of, sized

NEVER_SETTLES = 30.0
"""Periods of the hunting that count for a step that does not settle."""
LARGER_SIZES = (1.5, 2.0, 3.0)
"""So many times the border is looked at besides: whether a larger size keeps hunting ended."""
NOT_LINEAR = Margins(math.nan, math.nan, math.nan, math.nan, False)
"""The margins of a loop that has none."""
RESTS_OF_THE_SERVO = {INERTIA, SWITCH, WITH_EXPONENT, LUGRE, PID_BY_TIMES, PID_BY_GAINS, P_PI, P_PI_FILTERED,
                      INTEGRATOR, DERIVATIVE_FILTER, DERIVATIVE_FILTER_BY_N}  # fmt: skip
"""Parts with which a loop rests where the plain servo does."""
MOST_FOR_THE_WORST = 10.0
"""By how much more of a remedy than the servo as given needs the worst of a set may need, for it to be sought."""
STATIC = "static"
"""Of the parameters of a loop, the only one with which the error at rest grows."""
MOST_CORNERS, MOST_UNCERTAIN = 4, 6
"""Corners of an uncertain servo at which the border is computed, where slopes lead to the next one; and parameters that
may be uncertain where all corners are looked at."""


@in_its_units
def remedies(
    servo: Servo | Loop,
    model: Model | None = None,
    gain: float | None = None,
    *,
    only: str | Sequence[str | Remedy] = (),
    max_error: float | None = None,
    max_torque: float | None = None,
    margin: float = MARGIN_TO_CHOOSE,
    uncertainty: Uncertainty | None = None,
    step: float | None = None,
    move: Move | None = None,
    options: Options | None = None,
    progress: Callable[[Cure], None] | None = None,
    executor: Executor | None = None,
) -> Cures:
    """What stops the hunting: the smallest size of each remedy, and its price.

    Parameters
    ----------
    servo, model, gain
        the servo, its friction model (default "switch") and gain K > 0 [V/rad] (default 1); or a loop of parts, which
        says both itself.
    only
        the remedies that are looked at, or the only one, by name, or remedies of one's own; default all that there
        are.  Of one that does not go with the loop its row says why.
    max_error, max_torque
        demands: largest error at rest [rad], largest torque on the step [N m].
    margin
        how much more of a remedy than at its border is recommended, relatively; above 0.
    uncertainty
        what is uncertain of the servo: each row then has the size for the worst one.
    step, move
        by which remedies are priced: how far the servo goes [rad], default 1 rad or one unit of length, and the profile
        of its set point; default: at once.
    options
        tolerance of the sizes; default 1e-8.
    progress
        called with every row as it is found.
    executor
        any concurrent.futures.Executor, such as a ProcessPoolExecutor (spawn), to which the rows are shared out;
        default: one after the other.

    Returns
    -------
    Cures: its rows are sorted by price.

    Raises
    ------
    InputError : an unknown name, a number out of range, or remedies none of which goes with the loop.
    NoOrbit : the servo does not hunt at this gain, or its cycle was not found.

    Examples
    --------
    >>> from casahunt import Servo, remedies
    >>> table = remedies(Servo(), "switch", 0.04, only=["dead band"])
    >>> round(table.remedies[0].size, 8)  # rad
    0.04334572
    """
    each_only = [only] if isinstance(only, str) else only
    wanted = [each if isinstance(each, Remedy) else remedy_name(each) for each in each_only] or list(REMEDY_NAMES)
    error = None if max_error is None else require("max_error", max_error, above=0)
    torque = math.inf if max_torque is None else require("max_torque", max_torque, above=0)
    require("margin", margin, above=0, at_most=LARGER_SIZES[-1])
    step, move = None if step is None else sensible("step", step), a_move(move)
    asked = _asked(servo, model, gain, options or Options(tol=1e-8), uncertainty, margin)
    asked = replace(asked, step=step or asked.loop.units.step, move=move)
    looked_at = [remedy_of(name, asked.model) for name in REMEDY_NAMES if name in wanted]
    tasks = [(asked, remedy) for remedy in (*looked_at, *(each for each in wanted if isinstance(each, Remedy)))]
    rows = list[Cure]()
    for row in (executor.map if executor else map)(_row_of, tasks):
        rows.append(row)
        if progress:
            progress(row)
    if all(row.kind == "does not fit" for row in rows):
        said = "; ".join(f"{row.name}: {row.why}" for row in rows)
        raise InputError(f"none of these remedies goes with this loop: {said}")
    loop, swing = asked.loop, asked.swing
    rows.sort(key=_price(task(loop, swing, 0.0, asked.step, move).peak_torque, swing))
    best = cheapest(rows, error, torque, of_a_set=asked.uncertain is not None)
    own = loop.value("gain"), swing.amplitude, swing.period
    return Cures(loop, asked.model, *own, tuple(rows), best, margin, asked.stable, swing.irregular, asked.step, move)


def cheapest(rows: Sequence[Cure], error: float | None, torque: float, *, of_a_set: bool) -> str:
    """The name of the cheapest within the demands; of a set one of which is known what the worst servo needs, and else
    one that keeps hunting ended at the larger sizes too, if there is one; "" where none is.

    rows: the cheapest first; error: at rest, at most [rad], None for any; torque: at most [N m].
    """
    within = [row for row in rows if row.ends_hunting and row.peak_torque <= torque
              and (error is None or row.recommended_rest_error <= error)]  # fmt: skip
    within.sort(key=lambda row: (of_a_set and math.isnan(row.worst_size), not row.keeps_it_ended))
    return within[0].name if within else ""


@dataclass(frozen=True, eq=False)
class _Asked:
    """What all rows are about: the loop without a remedy, its friction model, its hunting and whether motions stay
    there, how it is computed, what is uncertain of which servo; the margin; the step and the move of its price."""

    loop: Loop
    model: Model
    swing: Swing
    stable: bool
    options: Options
    uncertain: tuple[Servo, Uncertainty] | None
    margin: float
    step: float = 1.0
    move: Move | None = None

    @cached_property
    def box(self) -> dict[str, tuple[float, float]]:
        """The intervals of the uncertain parameters of the loop."""
        if self.uncertain is None:
            return {}
        servo, uncertainty = self.uncertain
        ends = zip(*(end.tolist() for end in uncertainty.box(servo)), strict=True)
        return dict(zip(called(uncertainty.parameters), ends, strict=True))

    def has(self, corner: tuple[float, ...]) -> bool:
        """Whether a corner of the box is a servo."""
        if self.uncertain is None:
            return False
        servo, uncertainty = self.uncertain
        return bool(are_servos(servo, uncertainty.parameters, np.array([corner])).all())

    @cached_property
    def farthest_at_rest(self) -> Loop:
        """The loop of the corner that may rest farthest away: friction holds most, the controller pulls least."""
        return self.at(tuple(high if name == STATIC else low for name, (low, high) in self.box.items()))

    def at(self, corner: tuple[float, ...]) -> Loop:
        """The loop of a corner of the box."""
        return self.loop.replace(**dict(zip(self.box, corner, strict=True)))


def _asked(
    servo: Servo | Loop, model: Model | None, gain: float | None, options: Options, uncertainty: Uncertainty | None,
    margin: float,
) -> _Asked:  # fmt: skip
    """What is asked, with the cycle.  Raises InputError, NoOrbit."""
    if isinstance(servo, Loop):
        if uncertainty is not None:
            raise InputError("uncertainty: is one of a servo's parameters; of a loop of parts it is not known")
        if model is not None or gain is not None:
            raise InputError("model, gain: must be left out, a loop of parts says both itself: loop.replace(gain=...)")
        loop = by_gains(servo)
        found: Model = "lugre" if LUGRE in loop.present else "switch"
        try:
            cycle = loop_cycle(loop, options=options)
        except HuntsIrregularly as irregular:
            return _Asked(loop, found, irregular.swing, True, options, None, margin)
        return _Asked(loop, found, Swing.of(cycle), cycle.stable is not False, options, None, margin)
    a_servo(servo)
    model, gain = model or "switch", 1.0 if gain is None else gain
    choice_of("model", model, MODELS)
    if uncertainty is not None:
        check_box(servo, uncertainty)
    uncertain = None if uncertainty is None else (servo, uncertainty)
    orbit, loop = find_orbit(servo, model, gain, options=options), loop_of(servo, model, gain)
    return _Asked(loop, model, Swing.of(orbit), orbit.stable is not False, options, uncertain, margin)


def _price(today: float, hunting: Swing) -> Callable[[Cure], tuple[bool, float]]:
    """By what rows are sorted: those that end hunting first; then the sum of

    error at rest / amplitude of the hunting + (peak torque / that of today - 1) + settling time / its period.
    """

    def of(row: Cure) -> tuple[bool, float]:
        settling = row.settling if math.isfinite(row.settling) else NEVER_SETTLES * hunting.period
        rest = row.recommended_rest_error if row.rests else 0.0  # of none of the rows it is known
        price = rest / hunting.amplitude + (row.peak_torque / today - 1) + settling / hunting.period
        return not row.ends_hunting, price if math.isfinite(price) else math.inf

    return of


def _row_of(task: tuple[_Asked, Remedy]) -> Cure:
    """One remedy, found and priced where it fits."""
    asked, remedy = task
    with shown_in(units_of(asked.loop)):  # which another process does not know
        misfit = _misfit(asked, remedy)
        return Cure(remedy.name, remedy.unit, "does not fit", why=misfit) if misfit else _row(asked, remedy)


def _row(asked: _Asked, remedy: Remedy) -> Cure:
    """One remedy, found and priced."""
    loop = asked.loop
    found, numbers = border(loop, remedy, asked.swing, asked.options), _numbers(loop)
    if found.kind == "not found":
        return Cure(remedy.name, remedy.unit, found.kind, why=found.why, evidence=found.evidence,
                    followed_to=found.size, first=found.first)  # fmt: skip
    if found.kind == "none":
        return _without_end(asked, remedy, found)
    size = found.size
    worst = _worst(asked, remedy, found)
    least = worst if math.isfinite(worst) else size
    beyond = tuple(more_of(remedy, least, factor) for factor in (1 + asked.margin, *LARGER_SIZES))
    recommended, before = beyond[0], _last_hunting(asked, found)
    mended = with_remedy(loop, remedy, recommended)
    corners = _rests(remedy, recommended, _numbers(asked.farthest_at_rest))
    rest, rests = _largest(_rests(remedy, size, numbers)), _largest(corners)
    step = task(mended, asked.swing, rests, asked.step, asked.move)
    linear = margins_of_parts(mended) or NOT_LINEAR
    return Cure(
        remedy.name, remedy.unit, found.kind, size, found.error, recommended,
        rests=corners, rest_error=rest, recommended_rest_error=rests,
        peak_torque=step.peak_torque, peak_voltage=step.peak_torque / loop.value("motor_gain"), settling=step.settling,
        beyond=beyond,
        stays=stays(loop, remedy, beyond, before),
        phase_margin=linear.phase_margin,
        lowest_factor=linear.lowest_factor,
        highest_factor=linear.highest_factor,
        moves={name: slope * loop.value(name) / size for name, slope in found.moves.items() if name in loop.parameters},
        worst_size=worst, fold=found.fold, why=found.why, evidence=found.evidence, followed_to=size, first=found.first,
    )  # fmt: skip


def _last_hunting(asked: _Asked, found: Border) -> Swing:
    """The last that was seen in front of a border."""
    return found.swing or (asked.swing if found.orbit is None else Swing.of(found.orbit))


def _without_end(asked: _Asked, remedy: Remedy, found: Border) -> Cure:
    """A remedy with which motions hunt at the last size."""
    size, to = sized(found.size, remedy), "up to" if remedy.sense > 0 else "down to"
    why = f"hunting goes on {to} {size}, {found.why or 'the last size looked at'}: {remedy.why_not}".rstrip(": ")
    return Cure(remedy.name, remedy.unit, "none", rests=_rests(remedy, found.size, _numbers(asked.loop)), why=why,
                followed_to=found.size, first=found.first)  # fmt: skip


def _misfit(asked: _Asked, remedy: Remedy) -> str:
    """Why a remedy does not go with a loop; "" where it does."""
    loop = asked.loop
    if asked.model not in remedy.needs:
        return f"it goes with {' and '.join(FRICTIONS[model].name for model in remedy.needs)} alone"
    if remedy.part is None and remedy.size not in loop.parameters:
        return f"its size is {remedy.size}, which no part of this loop has"
    if remedy.instead and remedy.instead not in [part.name for part in loop.present]:
        return f"it takes the place of {remedy.instead}, which this loop does not have"
    try:
        _ = with_remedy(loop, remedy, remedy.first).system
    except InputError as refusal:
        return str(refusal)
    return ""


def _worst(asked: _Asked, remedy: Remedy, found: Border) -> float:
    """The size for the worst servo of a set: from corner to corner of its box, as slopes of the border point.

    Where it has none: with which motions end at all corners.  The servo as given counts as well: of a border that does
    not rise all the way a corner may need less.
    """
    box = asked.box
    if not box:
        return math.nan
    remedy = _no_farther(asked, remedy, more_of(remedy, found.size, MOST_FOR_THE_WORST))
    if not found.moves:
        return _worst_by_motions(asked, remedy, found)
    seen: dict[tuple[float, ...], Border] = {}
    at = found
    while at.moves and len(seen) < MOST_CORNERS:
        corner = tuple(ends[at.moves.get(name, 0.0) * remedy.sense > 0] for name, ends in box.items())
        if corner in seen:
            break
        if not asked.has(corner):
            return math.nan
        at = border(asked.at(corner), remedy, asked.swing, asked.options)
        if at.kind not in BORDERS:
            return math.nan
        seen[corner] = at
    return max((found.size, *(each.size for each in seen.values())), key=lambda size: size * remedy.sense)


def _no_farther(asked: _Asked, remedy: Remedy, size: float) -> Remedy:
    """The remedy, its border sought up to a size only."""
    last = size / scale_of(remedy, asked.loop, asked.swing)
    return replace(remedy, last=min(last, remedy.last, key=lambda each: each * remedy.sense))


def _worst_by_motions(asked: _Asked, remedy: Remedy, found: Border) -> float:
    """The size with which motions end at all corners of the box; nan where these are too many, or one hunts on."""
    size, last = found.size, remedy.last * scale_of(remedy, asked.loop, asked.swing)
    swing = _last_hunting(asked, found)
    if len(asked.box) > MOST_UNCERTAIN:
        return math.nan
    for corner in filter(asked.has, product(*asked.box.values())):
        begin = more_of(remedy, size, 1 - MOTIONS_KNOW)
        more = end_of_motions(asked.at(corner), remedy, swing, begin, last, MOTIONS_KNOW)
        if math.isnan(more.ended):
            return math.nan
        if more.ended * remedy.sense > size * remedy.sense:
            size, swing = more.ended, more.swing or swing
    return size


def _rests(remedy: Remedy, size: float, numbers: dict[str, float] | None) -> Corners:
    """The set of rest positions; () where it is not known."""
    return () if numbers is None else remedy.rests(size, numbers)


def _largest(rests: Corners) -> float:
    """The largest error of a set of rest positions [rad]."""
    return max((abs(x1) for x1, _ in rests), default=math.nan)


def _numbers(loop: Loop) -> dict[str, float] | None:
    """The numbers of a loop, with kp and ki in torque; None where its sets of rest positions are not known."""
    if not set(loop.present) <= RESTS_OF_THE_SERVO:
        return None
    nowhere, (mode, *_) = np.zeros((len(loop.system.states), 1)), loop.system.modes
    return loop.parameters | {name: float(loop.signal(name, mode.name, nowhere)[0]) for name in ("kp", "ki")}
