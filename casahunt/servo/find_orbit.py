"""From a servo to an orbit, without a guess from the user.

    stable cycle    at this gain alone (cold_start.py)
    unstable cycle  the stable one, then a walk up round the fold and down again, or the map inside the stable one
    otherwise       the fold from nothing (find_fold.py): above it there is none; below it a walk down from there,
                    on the side that was asked for

The ways stand in the tables `STABLE` and `UNSTABLE`.

"There is none" is said only with the fold below the gain, which continuation/fold.py locates on the branch and confirms
as an optimum, or with a proof (denial.py).  Where there is neither, the sentence is "not found": what was tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, overload

from ..axis_units import in_its_units
from ..checks import choice_of, of_kind, to_error, to_error_beside
from ..continuation.walk import walk
from ..errors import InputError, NoOrbit, Status
from ..orbits import Options, Orbit, SystemOrbit, find_cycle, refined
from .cold_start import AtOneGain, inner_cycle, quickly_at, stable_at, unstable
from .denial import no_cycle
from .event_map.half_cycle import HalfCycle, StickMap
from .event_map.secant_search import BESIDE_A_CYCLE, climbed, near_typical
from .find_fold import FOLD_DIGITS, MOST_WALKED, deny_below, find_fold
from .friction import Model
from .linear.open_loop import open_loop
from .lopsided import lopsided_at
from .parts.fate import on_the_cycle
from .parts.loop import Loop
from .parts.plain_loop import ASKED_ALONE, loop_asked, servo_of_loop
from .parts.verbs import check_present, loop_cycle, unstable_cycle
from .problem import HuntingFold, HuntingOrbit
from .refused import check_hunts, check_problem, check_times, stiff_at
from .servo import Servo

BranchName = Literal["stable", "unstable", "lopsided"]
BRANCHES: tuple[BranchName, ...] = ("stable", "unstable", "lopsided")
TIGHT_FOLD = 1e-9
"""Tolerance of the fold where its error at the user's does not tell on which side of it the gain lies."""
NO_AMPLITUDE = 1e-6
"""Amplitude in units of Fs/kp, where the proportional torque equals static friction, that counts as none."""
DOWNWARDS = 0.01
"""First step away from a fold, in arclength."""


@overload
def find_orbit(
    servo: Servo, model: Model, gain: float, *, branch: BranchName = ..., options: Options | None = ...
) -> HuntingOrbit: ...
@overload
def find_orbit(
    servo: Loop, model: None = ..., gain: float | None = ..., *, branch: BranchName = ..., vary: str = ...,
    start: Mapping[str, float] | None = ..., options: Options | None = ...,
) -> SystemOrbit: ...  # fmt: skip
@in_its_units
def find_orbit(
    servo: Servo | Loop, model: Model | None = None, gain: float | None = None, *, branch: BranchName = "stable",
    vary: str = "gain", start: Mapping[str, float] | None = None, options: Options | None = None,
) -> Orbit:  # fmt: skip
    """The hunting cycle of a servo, from nothing but the servo.

    Parameters
    ----------
    servo, model, gain
        the servo, "switch" or "lugre", and the gain > 0; or a loop of parts, without a model, at its own gain or
        another one.
    branch
        the stable cycle, or the unstable one that bounds its basin; of a servo also one of the lopsided pair that
        branches off from the symmetric cycle where its half multiplier passes -1, the other one being its mirror image.
    vary
        of a loop: the parameter in which the cycle is to be followed.
    start
        of a loop: states at the start of the one motion that is to settle on it, by name, all others zero; default:
        motions from rest, nearer and nearer to the set point, then cycles at smaller gains; of a loop that is a servo,
        the cycle of that.
    options
        tolerance and method; of a loop, default a tolerance of 1e-9.

    Returns
    -------
    Orbit with status CONVERGED.

    Raises
    ------
    InputError : a value out of range, or no such parameter of a loop.
    NoOrbit : there is no such cycle (status None, with the fold that shows it or the proof), none was found, or it
        could not be computed.
    ComesToRest, HuntsIrregularly : a NoOrbit, of a loop: what its motions do instead.

    Examples
    --------
    >>> from casahunt import Servo, find_orbit
    >>> orbit = find_orbit(Servo(), "switch", 0.1)
    >>> round(orbit.amplitude, 5), round(orbit.period, 3), orbit.error_estimate < 1e-6  # rad, s
    (0.01771, 11.356, True)
    >>> find_orbit(Servo(), "switch", 0.1, branch="unstable").stable
    False
    """
    if isinstance(servo, Loop):
        return _of_a_loop(loop_asked(servo, model, gain), branch, vary, start, options or Options(tol=1e-9))
    if model is None or gain is None:
        raise InputError(ASKED_ALONE)
    if vary != "gain" or start is not None:
        raise InputError("vary, start: must be left out with a Servo; casahunt.servo.parts.loop_of makes a loop of it")
    began = time.perf_counter()
    options = of_kind("options", options or Options(), Options)
    check_problem(servo, model, gain)
    check_times(servo, model, gain)
    choice_of("branch", branch, BRANCHES)
    check_hunts(servo, model)
    search = _OrbitSearch(servo, model, gain, branch, options)
    what = f"the {branch} hunting cycle of the {model} servo at gain {gain:g} was not found:"
    if branch == "lopsided":
        symmetric = find_orbit(servo, model, gain, options=replace(options, half=True))
        return replace(lopsided_at(symmetric, options), wall_s=time.perf_counter() - began)
    orbit = first_of(STABLE if branch == "stable" else UNSTABLE, search, what)
    return replace(orbit, wall_s=time.perf_counter() - began)


def _of_a_loop(
    loop: Loop, branch: BranchName, vary: str, start: Mapping[str, float] | None, options: Options
) -> SystemOrbit:
    """The cycle of a loop; one that is a servo is begun on the cycle of that, whose refusals are its own."""
    choice_of("branch of a loop", branch, BRANCHES[:2])
    check_present(loop, vary)
    servo = servo_of_loop(loop) if start is None else None
    if servo is not None:
        orbit = find_orbit(*servo, branch=branch, options=options)
        if branch == "unstable" and servo[1] == "lugre":  # from one state on a motion leaves it before it returns
            return unstable_cycle(loop_cycle(loop, vary, options=options), vary, options=options)
        on_it = on_the_cycle(orbit)
        return find_cycle(
            loop.system, loop.mode_at(**on_it), start=on_it, follow=vary, settled=True, options=options
        )
    cycle = loop_cycle(loop, vary, start=start, options=options)
    return cycle if branch == "stable" else unstable_cycle(cycle, vary, options=options)


@dataclass(eq=False)
class _OrbitSearch:
    """What is sought, and what the strategies have met on the way."""

    servo: Servo
    model: Model
    gain: float
    branch: BranchName
    options: Options
    walked: int = 0
    """Orbits on the last way up to the fold: at MOST_WALKED no other way up is tried."""

    @cached_property
    def met(self) -> AtOneGain:
        """What motions at this gain lead to; `_from_motions` puts in its place what it has met itself."""
        if self.branch == "unstable" and not self.stiff:
            with suppress(NoOrbit):
                return stable_at(self.servo, self.model, self.gain, options=self.rough)
        return AtOneGain(None, False, None)

    @cached_property
    def rigid(self) -> StickMap:
        """The event map of the Switch servo at this gain."""
        return StickMap("switch", self.servo, self.gain)

    @cached_property
    def beside(self) -> HalfCycle | None:
        """A motion of the Switch servo beside its stable cycle at this gain, where a few steps lead to one."""
        return near_typical(self.rigid, close=BESIDE_A_CYCLE)

    @property
    def rough(self) -> Options:
        """Enough for a way whose end is refined."""
        return self.options.rough()

    @property
    def stiff(self) -> bool:
        """No motion can be computed."""
        return stiff_at(self.servo, self.gain)

    @property
    def by_newton(self) -> bool:
        """Motions can be computed, and IPOPT is not to work alone."""
        return not self.stiff and self.options.solver != "ipopt"


Ways = tuple[tuple[str, Callable[[_OrbitSearch], HuntingOrbit | str | None]], ...]
"""Names, and ways from the search to the cycle, to a sentence that says how it ended without one, or None where there
was nothing to try."""


def _from_motions(s: _OrbitSearch) -> HuntingOrbit | str:
    """The stable cycle where motions at this gain lead to one that is certainly it."""
    s.met = stable_at(s.servo, s.model, s.gain, options=s.options)
    orbit = s.met.orbit
    if orbit is None:
        return s.met.seen.sentence() if s.met.seen is not None else "none was found"
    if s.met.clearly_stable or orbit.multipliers.leading.real <= 1:
        return orbit
    return f"they led to a cycle with half multiplier {orbit.half_multiplier:.4g}, which is not the stable one"


def _inside_the_stable_one(s: _OrbitSearch) -> HuntingOrbit | None:
    """The unstable cycle from motions inside the stable one; None where they lead to none."""
    if s.beside is not None:
        return inner_cycle(s.rigid, s.beside.fixed, s.beside.moving, s.options)
    stable = s.met.orbit
    if stable is None:
        return None
    moving = sum(arc.duration for arc in stable.arcs if arc.mode != "stick") * stable.repeats / 2
    return inner_cycle(s.rigid, stable.amplitude, moving, s.options)


def _from_next_to_the_fold(s: _OrbitSearch) -> HuntingOrbit | str | None:
    """`_round_the_fold` from a higher gain, to which the event map of the Switch servo climbs; None where it does not.

    With a bristle the fold lies elsewhere: a motion that leads to no stable cycle at one gain may at a lower one.
    """
    if s.beside is None:
        return None
    for gain, motion in reversed(climbed(s.rigid, s.beside)):
        start = quickly_at(s.servo, s.model, gain, options=replace(s.rough, provisional=True), beside=motion)
        if start is not None:
            return _round_the_fold(s, start, max(start.amplitude, s.beside.fixed))
    return None


def _from_here(s: _OrbitSearch) -> HuntingOrbit | str | None:
    """`_round_the_fold` from the stable cycle at this gain; None where none was found."""
    return None if s.met.orbit is None else _round_the_fold(s, s.met.orbit, s.met.orbit.amplitude)


def _round_the_fold(s: _OrbitSearch, start: HuntingOrbit, outer: float) -> HuntingOrbit | str:
    """The unstable cycle from a stable one at this gain or above: up to the fold and down again, with rough steps.

    `outer` is the amplitude of the stable cycle at the gain itself.
    """
    last = start
    provisional = replace(s.rough, provisional=s.rough != s.options)
    way = walk(start, low=s.gain, high=start.gain * 1e9, options=provisional, max_points=MOST_WALKED)
    for s.walked, last in enumerate(way, 1):
        if _vanished(last):
            return f"at gain {last.gain:.6g} the amplitude of the unstable one shrinks to nothing"
    if last is start or last.gain != s.gain or last.amplitude >= outer:
        return f"the way ended at gain {last.gain:.6g} with the half multiplier {last.half_multiplier:.3g}"
    try:
        orbit = refined(last, s.options)
    except NoOrbit as error:
        return f"it led to this gain, but not to the tolerance ({error})"
    return orbit if unstable(orbit) else "it led to a cycle that is not the unstable one"


def _from_the_fold(s: _OrbitSearch) -> HuntingOrbit:
    """The cycle on one side of a fold above the gain; NoOrbit with the fold as evidence where it lies below."""
    return _down_from(_fold_above(s.servo, s.model, s.gain, s.options, s.met), s.gain, s.branch, s.options)


# In the order in which they are tried, the quick ones first: 5 ms, LuGre 30 ms; 0.1 s, LuGre 1 s, from nothing minutes.
STABLE: Ways = (
    ("motions at this gain", lambda s: None if s.stiff else _from_motions(s)),
    ("down from the fold", _from_the_fold),
)
# Multipliers of 1e5 and more leave no way that is sure but round the fold.  8 ms; 20 ms, LuGre 0.2 s; 30 ms; as above.
UNSTABLE: Ways = (
    ("inside the stable one", lambda s: _inside_the_stable_one(s) if s.model == "switch" and s.by_newton else None),
    ("round the fold, from next to it", lambda s: _from_next_to_the_fold(s) if s.by_newton else None),
    ("round the fold, from this gain", lambda s: _from_here(s) if s.walked < MOST_WALKED else None),
    ("down from the fold", lambda s: _from_the_fold(s) if s.walked < MOST_WALKED else None),
)


def first_of(ways: Ways, search: _OrbitSearch, what: str) -> HuntingOrbit:
    """What the first way that finds one has found.  Raises NoOrbit: a way denied that there is one, or all have failed.

    A denial, NoOrbit without a status, ends the search: what is shown to be absent is not sought any further.  Where
    all have failed, the refusal is the sentence of the one that came farthest (a cycle met and not computed tells more
    than "not found"), and names the others that were tried; what: its beginning where no way has a sentence of its own.
    """
    ended: list[tuple[str, NoOrbit | str]] = []
    for name, way in ways:
        try:
            found = way(search)
        except NoOrbit as refusal:
            if refusal.status is None:
                raise
            ended.append((name, refusal))
            continue
        if isinstance(found, str):
            ended.append((name, found))
        elif found is not None:
            return found
    met = [each for _, each in ended if isinstance(each, NoOrbit)]
    lead = next((each for each in reversed(met) if each.status is not Status.NOT_FOUND), met[-1] if met else None)
    others = [(name, each.plain if isinstance(each, NoOrbit) else each) for name, each in ended if each is not lead]
    if lead is None:
        named = others[0][1] if len(others) == 1 else "; ".join(f"{name} {how}" for name, how in others)
        raise NoOrbit(f"{what} {named}", Status.NOT_FOUND)
    also = "tried besides: " + "; ".join(f"{name}: {how}" for name, how in others) if others else ""
    raise NoOrbit(lead.plain, lead.status, evidence="; ".join(filter(None, (lead.evidence, also))))


def _fold_above(servo: Servo, model: Model, gain: float, options: Options, met: AtOneGain) -> HuntingFold:
    """The fold of a servo, if it lies above `gain`."""
    seen = met.seen
    also = "" if seen is None else seen.sentence()
    if seen is not None and not seen.conclusive:
        _deny_proved(servo, model, gain, also)
        raise NoOrbit(
            f"whether the {model} servo hunts at gain {gain:g} is not known, because its motion could not be computed; "
            "are all parameters meant?",
            Status.NOT_CONVERGED,
        )
    for tol in sorted({options.tol, min(options.tol, TIGHT_FOLD)}, reverse=True):
        try:
            fold = find_fold(servo, model, options=replace(options, tol=tol), start=met.orbit)
        except NoOrbit as error:
            _deny_proved(servo, model, gain, also)
            leaves = "" if open_loop(servo, gain).stable else (
                "; the loop is unstable there without dry friction too (casahunt loop): are all units meant?"
            )  # fmt: skip
            raise NoOrbit(
                f"no hunting limit cycle of the {model} servo was found at gain {gain:g}, which does not prove that "
                f"there is none: the largest gain at which it hunts was not located either{leaves}",
                Status.NOT_FOUND, evidence=str(error),
            ) from None  # fmt: skip
        if abs(gain / fold.gain - 1) > 2 * fold.gain_error:
            break
    else:
        raise NoOrbit(
            f"the gain {gain:.12g} lies within the error of the fold gain {to_error(fold.gain, fold.gain_error)} of "
            f"the {model} servo, where hunting ends: on which side it lies is not known; ask for another gain, or for "
            "a smaller tolerance",
            Status.TOLERANCE_NOT_REACHED,
        )
    if gain > fold.gain:
        raise NoOrbit(
            f"no hunting limit cycle of the {model} servo at gain {gain:.10g}: it can hunt up to gain "
            f"{to_error_beside(fold.gain, fold.gain_error, gain, FOLD_DIGITS)} V/rad, and not above",
            evidence="; ".join(filter(None, (
                f"its cycles end at gain {to_error(fold.gain, fold.gain_error)}, in a fold, located on their branch, "
                "and again as the largest gain of all cycles near it", also,
            ))),
        )  # fmt: skip
    return fold


def _deny_proved(servo: Servo, model: Model, gain: float, also: str) -> None:
    """NoOrbit where it is proved that there is no cycle at a gain."""
    why = no_cycle(servo, model, gain)
    if why:
        message = f"no hunting limit cycle of the {model} servo at gain {gain:g} or above: {why}"
        raise NoOrbit(message, evidence=also) from None


def _down_from(fold: HuntingFold, gain: float, branch: BranchName, options: Options) -> HuntingOrbit:
    """The cycle at `gain` on one side of the fold above it."""
    last, ended = _followed_down(fold, gain, branch, options)
    if last.gain == gain and _on_the_side(last, branch):
        return last
    how = f"to this gain, where the cycle has the half multiplier {last.half_multiplier:.4g}"
    raise NoOrbit(
        f"the {branch} hunting cycle of the {fold.orbit.model} servo at gain {gain:g} was not found; try another gain "
        "or tolerance",
        Status.NOT_FOUND,
        evidence=f"its cycles, which end in a fold at gain {to_error(fold.gain, fold.gain_error)}, were followed down "
        "from there " + (how if last.gain == gain else f"to gain {last.gain:.8g} only: {ended}"),
    )


def _followed_down(fold: HuntingFold, gain: float, branch: BranchName, options: Options) -> tuple[HuntingOrbit, str]:
    """(last orbit, why the walk ends with it) down from a fold on the stable or the unstable side.

    Raises NoOrbit: the branch turns back to larger gains in another fold, which is located above `gain`.
    """
    for sense in (1.0, -1.0):  # of rounding, at a fold: one is either way along the branch
        steps = walk(fold.orbit, low=gain, high=2 * fold.gain, sense=sense, first_step=DOWNWARDS, options=options)
        last = next(steps, None)
        if last is None or not _on_the_side(last, branch):
            continue
        trail = [fold.orbit, last]
        while trail[-1].gain < trail[-2].gain:
            if _vanished(trail[-1]):
                return trail[-1], "there the amplitude of the unstable one shrinks to nothing"
            try:
                trail.append(next(steps))
            except StopIteration as end:
                return trail[-1], str(end.value)
        deny_below(trail[-3:], fold, gain, branch, options)
        return trail[-2], "there they turn back to larger gains"
    return fold.orbit, "no step away from the fold converged"


def _on_the_side(orbit: HuntingOrbit, branch: BranchName) -> bool:
    """Whether a cycle is on that side of the fold.

    By its multipliers: at a glance (`unstable`) the size and even the sign of one of -1e6 may be lost, and next to the
    folds that are left for this way there are such.
    """
    return (orbit.multipliers.leading.real > 1) == (branch == "unstable")


def _vanished(orbit: HuntingOrbit) -> bool:
    """P(a)/a tends to a limit as a does to 0; where the gain takes that limit to one, the unstable cycle ends there."""
    kp, _, _ = orbit.servo.torque_gains(orbit.gain)
    return orbit.amplitude * kp < NO_AMPLITUDE * orbit.servo.friction.static
