"""What is asked of a loop as of a servo: its hunting cycle, the other one, a fold.

    cycle     motions from rest beside the set point, by 8, 4, 2, ... times the error that breaks away: the cycle on
              which the first one settles
              (where turns are events, a state of it is known from fate.py, and no motion that rests is searched)
              else: that of a smaller gain, followed up to the gain
    fold      of its branch; where hunting goes on a little beyond it, or at larger gains if its branch has none, that
              of the other hunting, and so on

All else the engine does with such a cycle: `follow` leads along its branch in any parameter, `special_curve` along its
fold in two.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import chain

from ... import effort
from ...axis_units import quantity, several
from ...checks import choice_of
from ...continuation import FOLD, Fold, follow, largest, smallest
from ...errors import ComesToRest, HuntsIrregularly, InputError, NoOrbit, Status
from ...orbits import Options, SystemOrbit, find_cycle, refined
from ..outcome import SETTLES
from .ahead import LAST_TURNS, errors_of, measured, ranges
from .exponent import largest_exponent
from .fate import Fate, Swing, fate
from .loop import Loop
from .turns import PATTERN

FIRST_OFF, STARTS_HALVED = 8.0, 12
"""Off the set point by so many times the error that breaks away a motion starts first, and so many times by half as
much: an axis that moves by micrometres hunts as one that turns by radians."""
SMALLER_GAINS = (0.5, 0.25, 0.125, 0.0625)
"""Parts of the gain at which a cycle is looked for where no motion settles on one."""
TOLERANCE_ON_THE_WAY = 1e-6
"""Of cycles between that of a smaller gain and that which is asked for: at 1e-9 the way takes three times as long."""
MOST_UNSETTLED = 2
"""Motions that neither rest nor settle after which no further one is followed: such a one takes seconds."""
WORK_OF_A_FIRST_LOOK = 1e5
"""Work (effort.py) of a motion whose turns are no events, before those from nearer to the set point: ten times that of
one that settles.  With a torque limit a motion from afar may grow for ever, which no search for its cycle sees."""
WORK_OF_A_START, WORK_OF_THE_WAY = 3e6, 8e4
"""Work (effort.py) of a motion: 240 turns, after which it repeats in no pattern, of two masses that ring; and of
following a cycle to another gain, five seconds of a processor or less."""
BESIDE_A_FOLD, OF_ITS_AMPLITUDE = 0.01, (2.0, 1.0, 0.5)
"""How far beyond a fold other hunting is looked for, and from where motions start at rest there."""
LARGER_GAINS = (1.5, 4.0)
"""Times its own at which hunting of a loop is looked for where the branch of its cycle leads to no fold."""
MOST_BEYOND = 8
"""Folds of loops beyond which other hunting is looked for, one after the other."""
MOST_CYCLES_TO_A_FOLD = 1000
"""Cycles on the way to a fold: where slips creep for long before they jump, half of them lie within 1 % of it."""
FAR_UP, FARTHEST_FOLD = 1e3, 1e6
"""A parameter that hunting does not end in is followed to so many times its value; the gain, where its fold is looked
for, to so many times or that part: where hunting ends nowhere, as with too much of a feedforward, it becomes ever
stiffer."""


def loop_cycle(
    loop: Loop, vary: str = "gain", *, start: Mapping[str, float] | None = None, options: Options | None = None,
    or_below: bool = False,
) -> SystemOrbit:  # fmt: skip
    """The hunting cycle of a loop, to be followed in a parameter.

    start: states at the start of the one motion that is to settle on it, by name, all others zero; default: motions
    from rest, nearer and nearer to the set point, then cycles at smaller gains, followed up to the loop's; or_below:
    where these do not lead up to it, the one at the smaller gain.
    Raises InputError: no such parameter; ComesToRest, HuntsIrregularly, NoOrbit: as find_orbit.py.
    """
    options = options or Options(tol=1e-9)
    check_present(loop, vary)
    if start is not None:
        return _settled(loop, vary, loop.state(**start), options)
    found = _from_rest(loop, vary, options)
    if isinstance(found, SystemOrbit):
        return found
    irregular = next((each for each in found if isinstance(each, HuntsIrregularly)), None)
    if irregular is not None:
        raise irregular
    return _of_a_smaller_gain(loop, vary, options, found, or_below)


def _of_a_smaller_gain(
    loop: Loop, vary: str, options: Options, found: list[NoOrbit], or_below: bool
) -> SystemOrbit:  # fmt: skip
    """The cycle to which those of smaller gains lead; or_below: else, where all motions rest, the one that does.

    found: why no motion settles at the loop's.  Raises NoOrbit: what is known then.
    """
    smaller, lower = "", None
    if "gain" in loop.parameters and any(isinstance(each, ComesToRest) for each in found):
        lower = _at_a_smaller_gain(loop, options, vary)
        if lower is not None:
            try:
                return _followed_up(lower, loop.value("gain"), options)
            except NoOrbit as ended:
                smaller = f"; {ended}"
    resting = [each for each in found if isinstance(each, ComesToRest)]
    lively = next((each for each in found if each not in resting and not isinstance(each, _Grows)), None)
    if lively is not None:
        raise lively
    far = first_off(loop)
    sizes = several((far, far / 2**STARTS_HALVED), "rad", _two_digits, " to ")
    starts = f"{len(found)} starts, {sizes} beside the set point"
    grows = next((each for each in found if isinstance(each, _Grows)), None)
    if grows is not None:
        raise NoOrbit(f"{grows}; from {len(resting)} of {starts}, it comes to rest{smaller}", Status.NOT_FOUND)
    if or_below and lower is not None:
        return lower
    rests = f"the motion comes to rest from each of {starts}{smaller}"
    raise ComesToRest(f"no hunting was found: {rests}", Status.NOT_FOUND)


def first_off(loop: Loop) -> float:
    """How far beside the set point the first motion begins [rad]."""
    return FIRST_OFF * (errors_of(loop)[0] or 1.0)


def _two_digits(x: float) -> str:
    return f"{float(f'{x:.2g}'):g}"


def _at_a_smaller_gain(loop: Loop, options: Options, vary: str) -> SystemOrbit | None:
    """A cycle of a loop at the largest of some smaller gains at which motions lead to one; None where none does.

    Nor where they hunt irregularly: through there no cycle of still smaller gains would be followed up.
    """
    for part in SMALLER_GAINS:
        found = _from_rest(loop.replace(gain=part * loop.value("gain")), vary, options, unsettled=1)
        if isinstance(found, SystemOrbit):
            return found
        if any(isinstance(each, HuntsIrregularly) for each in found):
            break
    return None


def check_present(loop: Loop, name: str) -> None:
    """Refuse a parameter of a part that is not there.  Raises InputError: there is none, or it has no size."""
    every = {name: part for part in loop.parts for name in part.parameters}
    part = every[choice_of("parameter", name, every)]
    if part not in loop.present:
        absent = f"{part.size} = {loop.value(part.size):g}"
        raise InputError(f"{name}: with {absent} there is no {part.name}; give it another {part.size} to begin with")


def _settled(loop: Loop, vary: str, state: dict[str, float], options: Options) -> SystemOrbit:
    """The cycle on which one motion settles.  Raises NoOrbit."""
    return find_cycle(loop.system, loop.mode_at(**state), start=state, follow=vary, options=options)


def _from_rest(
    loop: Loop, vary: str, options: Options, unsettled: int = MOST_UNSETTLED
) -> SystemOrbit | list[NoOrbit]:
    """The cycle on which the first motion from rest settles; where none does, why not, of each.

    unsettled: motions that neither rest nor settle, behind which no further one is followed.
    """
    refusals, irregular, grown, put_off = list[NoOrbit](), None, math.inf, list[float]()
    first_look = math.inf if _turns_are_events(loop) else WORK_OF_A_FIRST_LOOK
    far = first_off(loop)
    looks = ((far / 2**k, first_look) for k in range(STARTS_HALVED + 1))
    for off, work in chain(looks, ((off, math.inf) for off in put_off)):
        try:
            with effort.at_most(work):
                return _settled(loop, vary, _led_on(loop, loop.at_rest(-off), irregular, grown), options)
        except effort.PartGivenUp:
            if work is math.inf:
                raise
            put_off.append(off)
        except NoOrbit as refusal:
            refusals.append(refusal)
            grown = off if isinstance(refusal, _Grows) else grown
            irregular = refusal.swing if isinstance(refusal, HuntsIrregularly) else irregular
            if sum(not isinstance(each, (ComesToRest, _Grows)) for each in refusals) == unsettled:
                break
    return refusals


def _turns_are_events(loop: Loop) -> bool:
    return not any(mode.stiff or not mode.ends for mode in loop.system.modes)


class _Grows(NoOrbit):
    """A motion that grows: one from nearer to the set point may settle."""


def _led_on(
    loop: Loop, start: dict[str, float], irregular: Swing | None = None, grown: float = math.inf
) -> dict[str, float]:
    """A state of the hunting to which a motion leads; its start where that is not known.

    irregular: hunting that another start has led to: whether this one does so, too, is seen in fewer turns; grown: how
    far from the set point another motion began that grows.
    Raises ComesToRest, HuntsIrregularly, NoOrbit: it grows, or is not decided.
    """
    if not _turns_are_events(loop):
        return start
    before = irregular or measured(loop, start, first_off(loop))
    seen = fate(loop, start, before, work=WORK_OF_A_START, grown=grown)
    if seen.kind in SETTLES:
        lasted = f"followed for {seen.motion.duration:.6g}"
        raise ComesToRest("no hunting was found: the motion comes to rest", Status.NOT_FOUND,
                          evidence=lasted)  # fmt: skip
    if seen.kind == "growing" or seen.still_grows:
        far = abs(seen.turns[-2:]).max()
        between = several((abs(start["x1"]), far), "rad", ".3g", " to ")
        why = f"the motion grows, from {between} beside the set point and on"
        raise _Grows(f"no hunting was found: {why}", Status.NOT_FOUND)
    if seen.swing is not None and not seen.pattern:
        raise _irregular(loop, seen)
    if seen.kind == "undecided" and seen.turns.size > LAST_TURNS:
        why = f"the motion neither rests nor repeats within {seen.turns.size} turns"
        raise NoOrbit(f"no hunting was found: {why}", Status.NOT_FOUND)
    return start if seen.swing is None else seen.swing.state


def _irregular(loop: Loop, seen: Fate) -> HuntsIrregularly:
    """What is said of a motion that goes on for ever and repeats in no pattern."""
    said, amplitude, times = ranges(seen)
    sentence = (
        f"{loop.name} hunts irregularly, {said}, and no pattern of up to {PATTERN} turns repeats within "
        f"{seen.turns.size}; no cycle was computed that could be followed"
    )
    measure = None if seen.swing is None else partial(largest_exponent, loop, seen.swing)
    return HuntsIrregularly(
        sentence, Status.NOT_FOUND, amplitude=amplitude, between=times, swing=seen.swing, measure=measure
    )


def _followed_up(lower: SystemOrbit, gain: float, options: Options) -> SystemOrbit:
    """The cycle at a gain, from one at a smaller gain.

    Raises NoOrbit: its branch does not lead there, or to one that is unstable: no motion hunts there.
    """
    on_the_way = replace(options, tol=max(options.tol, TOLERANCE_ON_THE_WAY))
    try:
        with effort.at_most(WORK_OF_THE_WAY):
            branch = follow(lower, "gain", to=gain, options=on_the_way, monitors=(FOLD,))
    except effort.PartGivenUp:
        way = f"the cycle of gain {lower.problem.value('gain'):.6g} was not followed up to {gain:.6g}"
        further = "with the work allowed; casahunt.continuation.follow leads on from there"
        raise NoOrbit(f"{way} {further}", Status.NOT_FOUND) from None
    end = branch.special[0].meaning if branch.special else branch.ended
    if branch.end.kind == "range" and branch.values[-1] == gain:
        cycle = refined(branch.orbits[-1], options)
        if cycle.stable is not False:
            return cycle
        end = f"it has become unstable, and motions leave it (period {cycle.period:.6g})"
    sentence = f"no motion settles on a cycle, and that of gain {branch.values[0]:.6g} does not lead to one"
    raise NoOrbit(f"gain {gain:.6g}: {sentence}: {end}", Status.NOT_FOUND)


def unstable_cycle(cycle: SystemOrbit, vary: str = "gain", *, options: Options | None = None) -> SystemOrbit:
    """The other cycle at the same parameters: behind the fold of the branch that goes up from here.

    Raises NoOrbit: the branch does not come back, or as a stable cycle; says where it ends.
    """
    here = cycle.problem.value(vary)
    branch = follow(cycle, vary, to=FAR_UP * here, options=options, monitors=())
    if branch.end.kind == "range" and len(branch.orbits) > 1 and branch.values[-1] == here:
        found = branch.orbits[-1]
        if not found.stable:
            return found
        back = f"with a stable cycle of amplitude {quantity(found.amplitude, 'rad')}"
        raise NoOrbit(f"the branch of the stable cycle comes back to {vary} = {here:.6g} {back}", Status.NOT_FOUND)
    raise NoOrbit(f"the branch of the stable cycle does not come back to {vary} = {here:.6g}: {branch.end}",
                  Status.NOT_FOUND)  # fmt: skip


Beyond = SystemOrbit | HuntsIrregularly | None
"""What hunts a little beyond a fold all the same, where it is not known where that ends."""


def loop_fold(loop: Loop, vary: str, options: Options | None) -> tuple[Fold[SystemOrbit], Beyond]:
    """The fold of a loop above the parameter's own value, or else below; of the gain also from a smaller one.

    Where other hunting goes on beyond, as where slips ring in other numbers, its fold; the farthest of up to so many,
    and what still hunts beyond that.
    Raises NoOrbit: the loop does not hunt as it is, its branch turns nowhere, or the fold is not computed.
    """
    cycle = loop_cycle(loop, vary, options=options, or_below=vary == "gain")
    why, status, senses = "", Status.NOT_FOUND, (1, -1) if cycle.problem.value(vary) == loop.value(vary) else (1,)
    for sense in senses:
        try:
            fold = fold_in(cycle, vary, sense=sense, options=options)
        except NoOrbit as refusal:
            further = _of_a_larger_gain(loop, cycle, options) if vary == "gain" and sense > 0 else None
            if further is not None:
                return _farthest(loop, further, options)
            why += f"; {refusal}" if why else str(refusal)
            status = refusal.status or status
            if status is not Status.NOT_FOUND and vary == "gain":  # of which the largest is asked for
                break
        else:
            return _farthest(loop, fold, options)
    raise NoOrbit(why, status)


def _of_a_larger_gain(loop: Loop, cycle: SystemOrbit, options: Options | None) -> Fold[SystemOrbit] | None:
    """The fold of what hunts at some larger gains than a cycle whose branch does not lead to one: a lopsided one ends
    where it meets the symmetric one, another where slips ring in other numbers.  None where none is found."""
    for factor in LARGER_GAINS:
        at = loop.replace(gain=factor * cycle.problem.value("gain"))
        if isinstance(other := hunting_from(at, "gain", cycle.amplitude), SystemOrbit):
            with suppress(NoOrbit):
                return fold_in(other, "gain", options=options)
    return None


def _farthest(loop: Loop, fold: Fold[SystemOrbit], options: Options | None) -> tuple[Fold[SystemOrbit], Beyond]:
    """The fold of what hunts beyond a fold, and beyond that one, as far as such hunting is found and followed."""
    for _ in range(MOST_BEYOND):
        other = hunting_beyond(loop, fold)
        if not isinstance(other, SystemOrbit):
            return fold, other
        try:
            further = fold_in(other, fold.parameter, sense=int(fold.sense), options=options)
        except NoOrbit:
            return fold, other
        if not further.sense * (further.value - fold.value) > 0:
            return fold, other
        fold = further
    return fold, hunting_beyond(loop, fold)


def fold_in(
    cycle: SystemOrbit, vary: str, *, sense: int = 1, to: float | None = None, options: Options | None = None,
    max_points: int = MOST_CYCLES_TO_A_FOLD, progress: Callable[[SystemOrbit], None] | None = None,
) -> Fold[SystemOrbit]:  # fmt: skip
    """Where the branch of a cycle turns back in a parameter, on the way up (sense +1) or down.

    to: as of `largest`; default, of the gain, `FARTHEST_FOLD`.

    Raises InputError, NoOrbit: as of `largest`.
    """
    extremum = largest if sense > 0 else smallest
    if to is None:  # other parameters than the gain may go through zero
        to = cycle.problem.value(vary) * FARTHEST_FOLD**sense if vary == "gain" else sense * math.inf
    return extremum(cycle, vary, to=to, options=options, max_points=max_points, progress=progress)


def hunting_beyond(loop: Loop, fold: Fold[SystemOrbit]) -> Beyond:
    """What hunts all the same a little beyond a fold, where the cycle that was followed has ended.

    As of `hunting_from`.
    """
    return hunting_from(loop.replace(**{fold.parameter: beyond_fold(fold)}), fold.parameter, fold.orbit.amplitude)


def hunting_from(loop: Loop, vary: str, amplitude: float) -> Beyond:
    """What motions lead to from rest about as far beside the set point as an amplitude.

    None where they come to rest, or it is not known of any what it leads to.
    """
    for part in OF_ITS_AMPLITUDE:
        try:
            with effort.at_most(WORK_OF_A_START):
                state = _led_on(loop, loop.at_rest(-part * amplitude))
                return _settled(loop, vary, state, Options(tol=TOLERANCE_ON_THE_WAY))
        except HuntsIrregularly as irregular:
            return irregular
        except (NoOrbit, effort.PartGivenUp):
            continue
    return None


def beyond_fold(fold: Fold[SystemOrbit]) -> float:
    """The value of the parameter at which `hunting_beyond` looks."""
    return fold.value + fold.sense * BESIDE_A_FOLD * abs(fold.orbit.problem.unit(fold.parameter))
