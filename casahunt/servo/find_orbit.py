"""From a servo to an orbit, without a guess from the user.

    stable cycle    at this gain alone (cold_start.py)
    unstable cycle  the stable one, then a walk up round the fold and down again, or the map inside the stable one
    otherwise       the fold from nothing (find_fold.py): above it there is none; below it a walk down from there,
                    on the side that was asked for

"There is none" is said only with the fold below the gain, which continuation/fold.py locates on the branch and confirms
as an optimum.  Where no fold can be located either, the sentence is "not found", and says what was tried.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from typing import Literal

from ..checks import known, to_error
from ..continuation.fold import WALK_TOLERANCE, confirmed_smallest
from ..continuation.special_points import FOLD, SpecialPoint, locate
from ..continuation.walk import curve_point, walk
from ..errors import NoOrbit, Status
from ..orbits.adapt import Options, refined
from .cold_start import Met, check_problem, check_times, stable_at, stiff_at, unstable_at
from .find_fold import find_fold
from .hunting import Model
from .problem import HuntingFold, HuntingOrbit
from .servo import Servo

BranchName = Literal["stable", "unstable"]
BRANCHES: tuple[BranchName, ...] = ("stable", "unstable")
TIGHT = 1e-9
"""Tolerance of the fold where its error at the user's does not tell on which side of it the gain lies."""
FAR = 0.9
"""Part of the fold gain below which the way down from the fold may be rough, its end being refined."""
VANISHED = 1e-6
"""Amplitude in units of Fs/kp, where the proportional torque equals static friction, that counts as none."""
DOWNWARDS = 0.01
"""First step away from a fold, in arclength."""


def find_orbit(
    servo: Servo,
    model: Model,
    gain: float,
    *,
    branch: BranchName = "stable",
    options: Options | None = None,
) -> HuntingOrbit:
    """The hunting cycle of a servo at one gain, from nothing but the servo.

    Parameters
    ----------
    servo, model, gain
        the problem; gain > 0.
    branch
        the stable cycle, or the unstable one that bounds its basin.
    options
        tolerance and method.

    Returns
    -------
    Orbit with status CONVERGED.

    Raises
    ------
    InputError : a value out of range.
    NoOrbit : there is no such cycle (status None, with the fold that shows it), none was found, or it could not be
        computed.
    """
    began = time.perf_counter()
    options = options or Options()
    check_problem(servo, model, gain)
    check_times(servo, model, gain)
    known("branch", branch, BRANCHES)
    find = _stable if branch == "stable" else _unstable
    return replace(find(servo, model, gain, options), wall_s=time.perf_counter() - began)


def _stable(servo: Servo, model: Model, gain: float, options: Options) -> HuntingOrbit:
    if stiff_at(servo, gain):
        return _beside_the_fold(servo, model, gain, "stable", options, Met(None, False, None))
    try:
        met = stable_at(servo, model, gain, options=options)
    except NoOrbit as error:  # close to a fold, or with too rough a start, the solver does not arrive
        try:
            return _beside_the_fold(servo, model, gain, "stable", options, Met(None, False, None))
        except NoOrbit as other:
            raise (other if other.status is None else error) from None
    if met.orbit is not None and (met.clearly_stable or met.orbit.multipliers.leading.real <= 1):
        return met.orbit
    return _beside_the_fold(servo, model, gain, "stable", options, met)


def _unstable(servo: Servo, model: Model, gain: float, options: Options) -> HuntingOrbit:
    """Multipliers of 1e5 and more leave no way that is sure but round the fold; else the inner fixed point."""
    rough = replace(options, tol=max(options.tol, WALK_TOLERANCE))
    met = Met(None, False, None)
    if not stiff_at(servo, gain):
        with suppress(NoOrbit):
            met = stable_at(servo, model, gain, options=rough)
    orbit = None
    if met.orbit is not None:
        orbit = _round_the_fold(met.orbit, rough, options) or _inner_fixed_point(servo, model, gain, options)
    # Last, because next to the sharpest folds it takes minutes.
    return orbit or _beside_the_fold(servo, model, gain, "unstable", options, met)


def _inner_fixed_point(servo: Servo, model: Model, gain: float, options: Options) -> HuntingOrbit | None:
    """The unstable cycle inside the stable one at the same gain, where a scan of the map leads to it."""
    try:
        orbit, _ = unstable_at(servo, model, gain, options=options)
    except NoOrbit:
        return None
    return orbit if orbit is not None and orbit.multipliers.leading.real > 1 else None


def _round_the_fold(stable: HuntingOrbit, rough: Options, options: Options) -> HuntingOrbit | None:
    """The unstable cycle at the gain of a stable one, up to the fold and down again; None where it is not reached."""
    for way in (rough, options):  # the accurate way is the slow one, and seldom needed
        last = stable
        for last in walk(stable, low=stable.gain, high=stable.gain * 1e9, options=way):
            if _vanished(last):
                return None
        if last is stable or last.gain != stable.gain or last.amplitude >= stable.amplitude:
            continue
        try:
            orbit = refined(last, options)
        except NoOrbit:
            continue
        if orbit.multipliers.leading.real > 1:
            return orbit
    return None


def _beside_the_fold(
    servo: Servo, model: Model, gain: float, branch: BranchName, options: Options, met: Met
) -> HuntingOrbit:
    """The cycle on one side of a fold above the gain; NoOrbit with the fold as evidence where it lies below."""
    return _down_from(_fold_above(servo, model, gain, options, met), gain, branch, options)


def _fold_above(servo: Servo, model: Model, gain: float, options: Options, met: Met) -> HuntingFold:
    """The fold of a servo, if it lies above `gain`."""
    seen = met.seen
    also = "" if seen is None else f"; {seen.sentence()}"
    if seen is not None and not seen.conclusive:
        raise NoOrbit(
            f"whether the {model} servo hunts at gain {gain:g} is not known, because its motion could not be computed; "
            f"are all parameters meant?{also}",
            Status.NOT_CONVERGED,
        )
    for tol in sorted({options.tol, min(options.tol, TIGHT)}, reverse=True):
        try:
            fold = find_fold(servo, model, options=replace(options, tol=tol), start=met.orbit)
        except NoOrbit as error:
            raise NoOrbit(
                f"no hunting limit cycle of the {model} servo was found at gain {gain:g}, which does not prove that "
                f"there is none: the largest gain at which it hunts was not located either ({error}){also}",
                Status.NOT_FOUND,
            ) from None
        if abs(gain / fold.gain - 1) > 2 * fold.gain_error:
            break
    else:
        raise NoOrbit(
            f"the gain {gain:.12g} lies within the error of the fold gain {to_error(fold.gain, fold.gain_error)} of "
            f"the {model} servo, where the stable and the unstable hunting cycle merge: on which side it lies is not "
            "known; ask for another gain, or for a smaller tolerance",
            Status.TOLERANCE_NOT_REACHED,
        )
    if gain > fold.gain:
        raise NoOrbit(
            f"no hunting limit cycle of the {model} servo at gain {gain:.10g}: its cycles end at gain "
            f"{to_error(fold.gain, fold.gain_error)}, in a fold, where the stable and the unstable one merge (located "
            f"on their branch, and again as the largest gain of all cycles near it){also}"
        )
    return fold


def _down_from(fold: HuntingFold, gain: float, branch: BranchName, options: Options) -> HuntingOrbit:
    """The cycle at `gain` on one side of the fold above it."""
    rough = replace(options, tol=max(options.tol, WALK_TOLERANCE))
    ways = (rough, options) if gain < FAR * fold.gain and rough != options else (options,)
    reached = ""
    for way in ways:
        last, ended = _followed_down(fold, gain, branch, way, options)
        if last.gain != gain:
            reached = f"to gain {last.gain:.8g} only ({ended})"
            continue
        try:
            orbit = refined(last, options) if way is not options else last
        except NoOrbit as error:
            reached = f"to this gain, but not to the tolerance ({error})"
            continue
        if (orbit.multipliers.leading.real > 1) == (branch == "unstable"):
            return orbit
        reached = f"to this gain, where the cycle has the half multiplier {orbit.half_multiplier:.4g}"
    raise NoOrbit(
        f"the {branch} hunting cycle of the {fold.orbit.model} servo at gain {gain:g} was not found: its cycles, which "
        f"end in a fold at gain {to_error(fold.gain, fold.gain_error)}, were followed down from there {reached}",
        Status.NOT_FOUND,
    )


def _followed_down(
    fold: HuntingFold, gain: float, branch: BranchName, way: Options, options: Options
) -> tuple[HuntingOrbit, str]:
    """(last orbit, why the walk ends with it) down from a fold on the stable or the unstable side.

    Raises
    ------
    NoOrbit : the branch turns back to larger gains in another fold, which is located above `gain`.
    """
    row = curve_point(fold.orbit, "gain").row
    for heading in (row, -row):
        steps = walk(
            fold.orbit, low=gain, high=2 * fold.gain, heading=heading, options=way, first_step=DOWNWARDS
        )
        before, last = fold.orbit, next(steps, None)
        if last is None or (last.multipliers.leading.real > 1) != (branch == "unstable"):
            continue
        while last.gain < before.gain:
            if _vanished(last):
                return last, "there the amplitude of the unstable one shrinks to nothing"
            try:
                before, last = last, next(steps)
            except StopIteration as end:
                return last, str(end.value)
        _deny_below(before, last, fold, gain, branch, options)
        return before, "there they turn back to larger gains"
    return fold.orbit, "no step away from the fold converged"


def _vanished(orbit: HuntingOrbit) -> bool:
    """P(a)/a tends to a limit as a does to 0; where the gain takes that limit to one, the unstable cycle ends there."""
    kp, _, _ = orbit.servo.torque_gains(orbit.gain)
    return orbit.amplitude * kp < VANISHED * orbit.servo.friction.static


def _deny_below(
    before: HuntingOrbit, after: HuntingOrbit, fold: HuntingFold, gain: float, branch: BranchName, options: Options
) -> None:
    """NoOrbit where the lower fold between two orbits of a walk is located above `gain`."""
    lowest = locate(before, after, FOLD, vary="gain", options=options)
    if lowest is None:
        return
    try:
        lower = confirmed_smallest(SpecialPoint(FOLD.kind, lowest, ""), "gain", options)
    except NoOrbit:
        return
    if gain < lower.gain * (1 - 2 * lower.gain_error):
        raise NoOrbit(
            f"no {branch} hunting cycle of the {fold.orbit.model} servo at gain {gain:.10g}: followed down from their "
            f"largest gain {to_error(fold.gain, fold.gain_error)}, its cycles turn back at "
            f"{to_error(lower.gain, lower.gain_error)}, in a second fold (located on their branch, and again as the "
            "smallest gain of all cycles near it)"
        )
