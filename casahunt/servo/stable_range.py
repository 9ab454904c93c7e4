"""Where the cycles below a fold are stable: the largest gain of any cycle, and that of one that a servo can follow.

    K_s <= K_f      K_f the gain of the fold, K_s the largest one with |mu| < 1 below it, on the stable side of the fold

Next to a smooth fold mu passes from below 1 to above it, and cycles are stable up to the fold.  Next to a sharp one mu
falls through -1 at K_s and goes on to -1e38 and beyond, before it comes back to 1 within a part of K_f that no gain is
set to.  At mu = -1 a pair of lopsided cycles branches off.  With P(a), next stick position after a, near P(a*) = a*,

    c = P''^2/2 + P'''/3 at P' = -1      c > 0: the pair is stable, and lies where the symmetric cycle is not
                                         c < 0: it is unstable, and lies where the symmetric one is stable

Above the fold there is no cycle: that is the bound to keep away from.  Between K_s and K_f motions may swing for long
next to a cycle that is not stable.  Source of c: Guckenheimer and Holmes, Nonlinear oscillations, section 3.5.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

from ..axis_units import in_its_units
from ..continuation.walk import walk
from ..errors import NoOrbit, Status
from ..motion import MarchFailure
from ..orbits import Options, refined
from ..results import Result
from ..roots import Bracket, Search
from .basin import stick_position
from .cold_start import stable_at
from .event_map.half_cycle import half_cycle
from .event_map.slopes import map_at
from .find_fold import find_any_orbit
from .problem import HuntingFold, HuntingOrbit

STABLE_AT = (0.5, 0.75, 0.9, 0.25, 0.1, 0.97)
"""Gains at which a stable cycle is looked for to begin with, in units of the fold gain."""
GAIN_SET_TO = 1e-6
"""Relative width of a range of gains that counts: no gain is set more finely."""
TOO_NARROW = GAIN_SET_TO**2
"""Width of a stable range in front of the fold, by the law 1 - mu ~ sqrt(K_f - K), that there is no use in seeking."""
LOOKED_STEP = 0.15
"""Largest arclength between the cycles that are looked at."""
LOOKED_AGAIN, EDGE_ROUNDS = 4, 30
"""Halvings of a step over which mu may have passed -1 and come back; steps of the search for where it passes."""
EDGE_CYCLES = 0.1
"""Part of the tolerance of the gain to which cycles are computed where mu = -1 is sought: next to a sharp fold their
multipliers follow their errors, and the gain follows the multipliers."""
SHIFT, SHIFTED_MARCH = 0.02, 1e-9
"""Relative step of the differences that P' to P''' are taken from, and tolerance of a motion of LuGre.  The cycle next
to the point (`branch_off`) tells less: it may be unstable where motions a little farther off settle to a pair."""
NOT_MINUS_ONE, CRITICAL = 0.02, 0.05
"""Difference of P' from -1 above which the event map does not tell what branches off; |c| below which it does not."""

Beyond = Literal["fold", "lopsided", "none", "unknown"]


@dataclass(frozen=True, eq=False, repr=False)
class StableRange(Result):
    """Where the symmetric hunting cycles below a fold are stable.

    Attributes
    ----------
    fold : the fold; above its gain there is no cycle.
    gain : the largest gain with a stable symmetric cycle [V/rad]: that of the fold, or where it loses its stability.
    ranges : (low, high) gains with a stable symmetric cycle [V/rad], rising; looked at from the first low on.
    beyond : what there is above `gain`: "fold", nothing; "lopsided", a pair of stable lopsided cycles, not followed;
        "none", no stable cycle next to the symmetric one; "unknown", one of the two.
    seen : the gain up to which cycles were looked at [V/rad]; between it and the fold no stable range is expected.
    largest : log10 of the largest |mu| met above `gain`; -inf where nothing is above.
    """

    _quantities = ("gain [V/rad]", "beyond", "ranges")
    _details = ("fold_gain = fold.gain [V/rad]", "seen [V/rad]", "largest_log10_half_multiplier = largest")

    fold: HuntingFold
    gain: float
    ranges: tuple[tuple[float, float], ...]
    beyond: Beyond
    seen: float
    largest: float


@in_its_units
def stable_range(fold: HuntingFold, *, options: Options | None = None) -> StableRange:
    """Up to which gain a stable cycle exists, on the stable side of a fold.

    options: tolerance of the gains, and method. Raises NoOrbit: no stable cycle was found below the fold, or the branch
    was not followed up to it.
    """
    options = options or Options()
    rough = options.rough()
    first = _stable_one(fold, rough)
    orbits = _looked_closer(_up_to_the_fold(first, fold, rough), rough)
    last = orbits[-1]
    changes = [_located(a, b, options) for a, b in zip(orbits, orbits[1:], strict=False) if a.stable != b.stable]
    edges = [first.gain, *(orbit.gain for orbit in changes), *([fold.gain] if last.stable else [])]
    ranges = tuple(zip(edges[::2], edges[1::2], strict=True))
    beyond: Beyond = "fold" if last.stable else _branching(changes[-1])
    above = [orbit.multipliers.log10_leading for orbit in orbits if orbit.gain > ranges[-1][1]]
    return StableRange(fold, ranges[-1][1], ranges, beyond, last.gain, max(above, default=-math.inf))


def _stable_one(fold: HuntingFold, options: Options) -> HuntingOrbit:
    """A stable cycle below the fold."""
    servo, model = fold.orbit.servo, fold.orbit.model

    def at(share: float | None) -> HuntingOrbit | None:
        if share is None:  # there may be cycles next to the fold alone
            return find_any_orbit(servo, model, options=options)
        return stable_at(servo, model, share * fold.gain, options=options).orbit

    for share in (*STABLE_AT, None):
        with suppress(NoOrbit):
            orbit = at(share)
            if orbit is not None and orbit.gain < fold.gain and orbit.stable and orbit.multipliers.trusted:
                return orbit
    raise NoOrbit(
        f"no motion of the {model} servo led to a stable cycle below its fold at gain {fold.gain:.8g}",
        Status.NOT_FOUND,
    )


def _up_to_the_fold(first: HuntingOrbit, fold: HuntingFold, options: Options) -> list[HuntingOrbit]:
    """The cycles from one up to where nothing can happen any more before the fold: mu > 0, or hopelessly below -1."""
    found, top = [first], fold.gain * (1 - GAIN_SET_TO)
    while True:
        last = found[-1]
        mu, left = last.multipliers.leading.real, 1 - last.gain / fold.gain
        if (last.stable and mu > 0) or left * (2 / (1 - mu)) ** 2 < TOO_NARROW or last.gain >= top:
            return found
        following = _upwards(last, top, options) or _upwards(last, (last.gain + top) / 2, options)
        if not following:
            break
        found += following
    if last.stable:
        raise NoOrbit(
            f"up to which gain a stable cycle of the {last.model} servo exists was not found: its cycles were followed "
            f"to gain {last.gain:.8g} only, of {fold.gain:.8g} at the fold",
            Status.NOT_CONVERGED,
        )
    return found


def _upwards(start: HuntingOrbit, top: float, options: Options) -> list[HuntingOrbit]:
    """The cycles above one, up to a gain or to where the branch turns back, or mu is hopelessly below -1."""
    found: list[HuntingOrbit] = []
    last = start
    for orbit in walk(start, low=start.gain * (1 - GAIN_SET_TO), high=top, options=options, largest_step=LOOKED_STEP):
        mu = orbit.multipliers.leading.real
        if orbit.gain <= last.gain or mu > 1:
            break
        found.append(last := orbit)
        if (2 / (1 - mu)) ** 2 < TOO_NARROW:
            break
    return found


def _looked_closer(orbits: list[HuntingOrbit], options: Options, halvings: int = LOOKED_AGAIN) -> list[HuntingOrbit]:
    """The same, and those between two over which mu changes by more than it is away from -1."""
    found = orbits[:1]
    for before, after in zip(orbits, orbits[1:], strict=False):
        mu = [orbit.multipliers.leading.real for orbit in (before, after)]
        if halvings and before.stable and after.stable and abs(mu[1] - mu[0]) > 1 + min(mu):
            way = _upwards(before, (before.gain + after.gain) / 2, options)
            found += _looked_closer([before, *way, after], options, halvings - 1)[1:-1]
        found.append(after)
    return found


def _located(before: HuntingOrbit, after: HuntingOrbit, options: Options) -> HuntingOrbit:
    """The cycle between two whose multiplier is of size one, as nearly as the tolerance of the gain asks for."""
    finer = replace(options, tol=EDGE_CYCLES * options.tol)
    try:
        ends = [refined(orbit, finer) if orbit.error_estimate > finer.tol else orbit for orbit in (before, after)]
    except NoOrbit:  # there is rounding
        finer, ends = options, [before, after]
    if ends[0].stable != ends[1].stable:  # else the change is within the errors that they had: next to one of them
        before, after = ends
    low = before.gain

    def off(orbit: HuntingOrbit) -> float:
        return max(-1.0, min(1.0, orbit.multipliers.log10_leading))

    search = Search.within(Bracket(0.0, off(before), after.gain - low, off(after)))
    best = min(before, after, key=lambda orbit: abs(off(orbit)))
    for _ in range(EDGE_ROUNDS):
        if search.bracket.width <= options.tol * after.gain:
            break
        at = search.ask()
        way = _upwards(before, low + at, finer) if low + at > before.gain else []
        if not way or way[-1].gain != low + at:
            search = search.failed()
            continue
        best = min(best, way[-1], key=lambda orbit: abs(off(orbit)))
        search = search.told(at, off(way[-1]))
        before = way[-1] if way[-1].stable == before.stable else before
        if abs(off(best)) <= options.tol:
            break
    return best


def _branching(orbit: HuntingOrbit) -> Beyond:
    """What branches off where mu = -1, by the event map next to it."""
    try:
        a = stick_position(orbit)
        P = [_next(orbit, a * (1 + k * SHIFT)) / a for k in (-2, -1, 0, 1, 2)]
    except (MarchFailure, NoOrbit):
        return "unknown"
    slope = (P[0] - 8 * P[1] + 8 * P[3] - P[4]) / (12 * SHIFT)
    second = (P[1] - 2 * P[2] + P[3]) / SHIFT**2
    third = (-P[0] + 2 * P[1] - 2 * P[3] + P[4]) / (2 * SHIFT**3)
    c = second**2 / 2 + third / 3
    if not (abs(slope + 1) < NOT_MINUS_ONE and abs(c) > CRITICAL):  # nan is neither
        return "unknown"
    return "lopsided" if c > 0 else "none"


def _next(orbit: HuntingOrbit, a: float) -> float:
    """P(a) [rad]."""
    if orbit.model == "switch":
        return map_at(orbit.servo, orbit.gain, a).position
    return half_cycle(orbit.model, orbit.servo, orbit.gain, a, tol=SHIFTED_MARCH).position
