"""The largest gain at which a servo can hunt: from nothing but the servo to its confirmed fold (continuation/fold.py).

The walk needs a gain at which the servo hunts, not far below the fold.  The search starts at the gain below which the
frictionless linear loop is unstable, J / (cm kd' kp/ki) (Routh-Hurwitz; report, section 2), goes up and down from there
in factors of two to the first cycle, and then up as far as the event map finds one.  Where motions go farther out at
one of these gains, and not at the next, cycles are looked for in between.

That no gain was found is not shown by looking at some: status None, "there is none", is said with a proof only
(denial.py).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any, cast, overload

import numpy as np

from .. import effort
from ..axis_units import in_its_units
from ..checks import of_kind, to_error, to_error_beside
from ..continuation import Fold, fold_between, largest, left_by_motions, smallest
from ..continuation.walk import walk
from ..errors import InputError, NoOrbit, Status
from ..motion import MarchFailure
from ..orbits import Options, SystemOrbit
from .cold_start import quickly_at, stable_at
from .denial import no_cycle
from .event_map.fixed_points import fixed_points
from .event_map.half_cycle import HalfCycle, StickMap
from .event_map.scan import GROWING, Scan, scan
from .event_map.secant_search import BESIDE_A_CYCLE, climbed, lowered, near_typical
from .friction import Model
from .gains import typical_gain
from .linear.open_loop import open_loop
from .parts.loop import Loop
from .parts.plain_loop import loop_asked, model_asked
from .parts.verbs import loop_fold
from .problem import HuntingFold, HuntingOrbit
from .refused import check_hunts, check_problem, check_times
from .servo import Servo

SEARCH_FACTORS = 12
"""Gains searched for a first cycle: up to this many factors of two from the Routh-Hurwitz gain, each way."""
GAIN_HALVINGS = 8
"""Gains searched between one at which motions go farther out and twice that, at which they do not."""
LUGRE_SEARCHES = 5
"""Gains at which a LuGre cycle is sought by its own, slow map where the Switch servo has none."""
MOST_FAILED = 8
"""Cycles that may turn out not to be computable before the search is given up."""
SAME_GAIN = 1.1
"""Ratio of gains within which a careful search is not repeated."""
AROUND, AROUND_POINTS = 3.0, 5
"""Factor each way, and motions at first, within which a fixed point seen in a search is looked at again."""
SHARP_TOLERANCE = 1e-8
"""Of the walk to a fold that the rough walk has not led to: next to a very sharp one the errors of the rough way are as
large as what is left of the branch."""
LOCATED_TO = (0.1, 1e-3)
"""Parts of the tolerance to which a fold is located, in turn: its place on the branch takes a finer mesh than its gain,
period and amplitude being of first order in it."""
FOLD_DIGITS = 4
"""Digits of a fold gain in a refusal where they tell it from the gain asked: friction is known to per cents."""
HIGHEST = 1e9
"""Gain, in units of the first one, beyond which no fold is looked for."""
MOST_WALKED = 1000
"""Orbits of a walk to a fold: of random servos 3 to 420; where the multiplier runs away below -1 there is no end."""


def find_any_orbit(servo: Servo, model: Model, *, options: Options) -> HuntingOrbit:
    """A stable hunting cycle at some gain, preferably not far below the fold.

    The event map of the Switch servo finds a gain with a cycle and climbs from there; it costs a hundredth of
    an orbit.  The first gain, from the highest down, at which the model's own cycle is found wins.

    Returns HuntingOrbit, stable, at the gain that was found.
    Raises InputError: unknown model, or times too far apart (`check_times`); NoOrbit: there is provably none (status
    None), or none of the gains searched has one; says which were searched.
    """
    base = typical_gain(servo)
    check_problem(servo, model, base)
    check_times(servo, model)
    check_hunts(servo, model)
    gains = [base * 2.0**k for n in range(SEARCH_FACTORS + 1) for k in ((n, -n) if n else (0,))]
    hunt = _Hunt(servo, model)
    promised: list[tuple[float, HalfCycle]] = []
    failed: list[str] = []
    for gain, beside, quickly in _gains_to_try(hunt, gains):
        if beside is not None and quickly:
            orbit = quickly_at(servo, model, gain, options=options, beside=beside)
            if orbit is not None:
                return orbit
            continue
        promised += [(gain, beside)] if beside is not None else []
        try:
            met = stable_at(servo, model, gain, options=options)
        except NoOrbit as error:
            failed.append(str(error))
            if len(failed) == MOST_FAILED:
                break
            continue
        if met.orbit is not None:
            return met.orbit
    tried = f"{len(failed)} of them were tried: {failed[-1]}" if failed else "none of them led to one"
    if any(_has_fixed_point(servo, gain, beside.start) for gain, beside in promised):
        raise NoOrbit(
            f"no hunting limit cycle of the {model} servo was computed, though the event map of the Switch servo shows "
            "some; try another tolerance",
            Status.NOT_CONVERGED if failed else Status.NOT_FOUND, evidence=tried,
        )  # fmt: skip
    # Which gains were scanned without a cycle, and from which one up it is proved that there is none
    looked = [gain for gain in gains if gain not in hunt.proved]
    evidence = "none was scanned"
    if looked:
        evidence = f"{len(looked)} gains from {min(looked):.3g} to {max(looked):.3g} were scanned{_most(hunt.seen)}"
    if hunt.proved:
        lowest = min(hunt.proved)
        evidence += f"; from gain {lowest:.3g} up the Switch servo provably has none: {hunt.proved[lowest]}"
    if failed:
        evidence += f"; at some, motions come back so close to where they started that cycles were sought, and {tried}"
    raise NoOrbit(
        f"no hunting limit cycle of the {model} servo was found, which does not prove that there is none",
        Status.NOT_FOUND, evidence=evidence,
    )  # fmt: skip


Place = tuple[float, HalfCycle | None, bool]
"""(gain, motion of the Switch servo beside its cycle there, whether it is to lead to one quickly or not at all); None
where the Switch servo has none and LuGre's own is sought."""


@dataclass(eq=False)
class _Hunt:
    """A search for a gain with a cycle, and what it has seen.

    Attributes
    ----------
    seen : the scans that show no cycle, by gain.
    farther : by gain: does the motion from a = Fs/kp go farther out?  None where there is a cycle, or no motion.
    proved : by gain: why the Switch servo has no cycle there (denial.py).
    carefully : the gains at which a cycle was sought by every strategy.
    """

    servo: Servo
    model: Model
    seen: list[tuple[float, Scan]] = field(default_factory=list)
    farther: dict[float, bool | None] = field(default_factory=dict)
    proved: dict[float, str] = field(default_factory=dict)
    carefully: list[float] = field(default_factory=list)

    def searched(self, gain: float) -> bool:
        """Whether a gain next to it has been searched carefully; if not, this one is about to be."""
        known = any(1 / SAME_GAIN < gain / other < SAME_GAIN for other in self.carefully)
        self.carefully += [] if known else [gain]
        return known

    def rigid_cycle(self, P: StickMap) -> HalfCycle | None:
        """The Switch servo's stable cycle; without one, `farther` is found out."""
        if why := no_cycle(self.servo, "switch", P.gain):  # nor do swings grow: far out the loop is stable
            self.farther[P.gain], self.proved[P.gain] = False, why
            return None
        self.farther[P.gain] = None
        near = near_typical(P, close=BESIDE_A_CYCLE)
        if near is not None:
            return near
        scanned = scan(P)
        if scanned.upper is None:
            self.seen.append((P.gain, scanned))
            with suppress(MarchFailure):
                self.farther[P.gain] = P(P.unit).ratio >= 1
        return scanned.upper


def _gains_to_try(hunt: _Hunt, gains: list[float]) -> Iterator[Place]:
    """Where there may be a cycle: at every gain and above it, else next to it; then LuGre's own."""
    for gain in gains:
        P = StickMap("switch", hunt.servo, gain)
        rigid = hunt.rigid_cycle(P)
        found = [(P, rigid)] if rigid is not None else _next_to(hunt, P)
        for there, beside in found:
            yield from _downwards(hunt, there, climbed(there, beside))
    if hunt.model != "switch":
        yield from ((gain, None, False) for gain in gains[:LUGRE_SEARCHES] if not hunt.searched(gain))


def _next_to(hunt: _Hunt, P: StickMap) -> Iterator[tuple[StickMap, HalfCycle]]:
    """Cycles between a gain at which motions go farther out and one a factor of two off at which they do not.

    With a loop that is unstable without dry friction, cycles exist from the gain at which large swings stop just short
    of going on for ever to the fold: that range may be narrow.  The ranges on both sides of the gain are searched.
    """
    for low in (P.gain / 2, P.gain):
        high = 2 * low
        if hunt.farther.get(low) is not True or hunt.farther.get(high) is not False:
            continue
        for _ in range(GAIN_HALVINGS):
            middle = P.at_gain(float(np.sqrt(low * high)))
            rigid = hunt.rigid_cycle(middle)
            if rigid is not None:
                yield middle, rigid
                break
            farther = hunt.farther[middle.gain]
            if farther is None:
                break
            low, high = (middle.gain, high) if farther else (low, middle.gain)


def _downwards(hunt: _Hunt, P: StickMap, places: list[tuple[float, HalfCycle]]) -> Iterator[Place]:
    """Where there may be a cycle, from the highest gain down: first those to which a motion leads quickly.

    With a bristle the fold lies at a lower gain, where the drop of friction is small at a much lower one.
    """
    yield from ((gain, beside, True) for gain, beside in reversed(places))
    if hunt.model != "switch":
        yield from ((gain, beside, True) for gain, beside in lowered(P, places[0][1]))
    yield from ((gain, beside, False) for gain, beside in reversed(places) if not hunt.searched(gain))


def _has_fixed_point(servo: Servo, gain: float, a: float) -> bool:
    """Whether the event map of the Switch servo, computed to rounding, has a fixed point next to a.

    The motions of a search are good for 1e-4 of P(a)/a, which at tiny gains is itself that close to one.
    """
    return bool(fixed_points(servo, gain, a / AROUND, a * AROUND, points=AROUND_POINTS).fixed)


def _most(seen: list[tuple[float, Scan]]) -> str:
    """How far the motions of scans without a cycle came back, in words."""
    known = [(s.best, gain, s) for gain, s in seen if s.motions]
    if not known:
        return ""
    best, gain, s = max(known, key=lambda k: k[:2])
    growing = [k[1] for k in known if k[0] > GROWING]
    if growing:
        return (
            f"; at gains from {min(growing):.3g} to {max(growing):.3g} motions grow and no stable cycle bounds them, "
            "as with an unstable linear loop"
        )
    return f" with the Switch servo; the farthest back it comes at gain {gain:.3g}: {s.sentence()}"


@overload
def find_fold(
    servo: Servo, model: Model, *, options: Options | None = ..., start: HuntingOrbit | None = ...
) -> HuntingFold: ...
@overload
def find_fold(
    servo: Loop, model: None = ..., *, vary: str = ..., options: Options | None = ...
) -> Fold[SystemOrbit]: ...
@in_its_units
def find_fold(
    servo: Servo | Loop, model: Model | None = None, *, vary: str = "gain", options: Options | None = None,
    start: HuntingOrbit | None = None,
) -> Fold[Any]:  # fmt: skip
    """Where hunting ends: the fold gain of a servo, or the fold of a loop in any parameter.

    Parameters
    ----------
    servo, model
        the servo, and "switch" or "lugre"; or a loop of parts, which hunts at its own numbers.
    vary
        of a loop: the parameter; the fold is sought above its own value, and where there is none below it; the fold
        gain also where the loop comes to rest.
    options
        `tol` bounds the relative errors of gain, amplitude and period.
    start
        of a servo: a stable orbit to walk from; default: searched for.

    Returns
    -------
    Fold, confirmed on the mesh of halved intervals.

    Raises
    ------
    InputError : unknown model or parameter, or times too far apart (`check_times`).
    NoOrbit : no cycle, no fold in range, or two answers that differ.

    Examples
    --------
    >>> from casahunt import Servo, find_fold
    >>> fold = find_fold(Servo(), "switch")
    >>> round(fold.gain, 5), round(fold.orbit.period, 3)  # V/rad, s
    (0.64734, 20.468)
    """
    if isinstance(servo, Loop):
        if start is not None:
            raise InputError("start: must be left out, a loop begins where it hunts by itself")
        return loop_fold(loop_asked(servo, model, None), vary, options)[0]
    if vary != "gain":
        raise InputError(f"vary = {vary}: must be gain of a servo; of a loop of parts it is any parameter (loop_of)")
    began = time.perf_counter()
    friction = model_asked(servo, model)
    options = of_kind("options", options or Options(), Options)
    rough = replace(options.rough(), provisional=True)
    first = start or find_any_orbit(servo, friction, options=rough)
    try:
        return _walked(first, rough, options, began)
    except NoOrbit as error:
        if error.status is Status.NOT_FOUND:  # finer steps do not lead farther
            raise
    return _walked(first, replace(options, tol=min(options.tol, SHARP_TOLERANCE)), options, began)


def _walked(first: HuntingOrbit, way: Options, options: Options, began: float) -> HuntingFold:
    """The confirmed fold at the end of a walk up from an orbit."""
    before, passed = first, [first]
    steps = walk(first, low=first.gain * 1e-3, high=first.gain * HIGHEST, options=way, max_points=MOST_WALKED)
    while True:
        effort.at(partial("on the way to the fold, at gain {0:.6g}".format, before.gain))
        try:
            after = next(steps)
        except StopIteration as end:
            raise NoOrbit(
                f"the gain at which the {first.model} servo stops hunting was not found: its cycles were followed from "
                f"gain {first.gain:.6g} to {before.gain:.6g} V/rad only{left_by_motions(passed, 'gain')}",
                Status.NOT_FOUND if getattr(end.value, "kind", "") == "points" else Status.NOT_CONVERGED,
                evidence=f"where the half multiplier is {before.half_multiplier:.3g}: {end.value}",
            ) from None
        if (fold := confirmed_between(before, after, options)) is not None:
            return replace(fold, wall_s=time.perf_counter() - began)
        before = after
        passed.append(after)


def confirmed_between(
    before: HuntingOrbit, after: HuntingOrbit, options: Options, *, sense: float = 1.0
) -> HuntingFold | None:
    """The confirmed fold between two orbits, located to a part of the tolerance and confirmed to the whole of it.

    sense: as of `fold_between`.  Returns None where the gain does not turn back between the two.
    """
    extremum = largest if sense > 0 else smallest
    for part in LOCATED_TO:
        try:
            special = fold_between(before, after, "gain", options.finer(part), sense)
            return None if special is None else cast(HuntingFold, extremum(special, "gain", options=options))
        except NoOrbit:
            if part == LOCATED_TO[-1]:
                raise
    raise AssertionError("no part of the tolerance")


def deny_below(
    around: list[HuntingOrbit], fold: HuntingFold, gain: float, branch: str, options: Options
) -> None:
    """NoOrbit where the lower fold, on one of the two sides of the smallest gain met, is located above `gain`.

    A fold above a gain at which a cycle was found is not where they end.
    """
    least = min(orbit.gain for orbit in around) * (1 + options.tol)
    for before, after in reversed(list(pairwise(around))):
        lower = None
        with suppress(NoOrbit):  # what is between these two is not known: the fold may lie between the others
            lower = confirmed_between(before, after, options, sense=-1.0)
        if lower is not None and lower.gain <= least:
            break
    else:
        return
    if gain < lower.gain * (1 - 2 * lower.gain_error):
        unstable = f"; at {gain:.4g} V/rad the loop is unstable: large motions grow"
        grows = "" if open_loop(fold.orbit.servo, gain).stable else unstable
        raise NoOrbit(
            f"no {branch} hunting cycle of the {fold.orbit.model} servo at gain {gain:.10g}: it has such cycles from "
            f"gain {to_error_beside(lower.gain, lower.gain_error, gain, FOLD_DIGITS)} to "
            f"{to_error(fold.gain, fold.gain_error, most=FOLD_DIGITS)} V/rad{grows}",
            evidence=f"followed down from their largest gain {to_error(fold.gain, fold.gain_error)}, its cycles turn "
            f"back at {to_error(lower.gain, lower.gain_error)}, in a second fold, located on their branch, and again "
            "as the smallest gain of all cycles near it",
        )
