"""The pairs of lopsided cycles of a servo: x(t + T/2) is not -x(t), and -x(t + T/2) is the other one of the pair.

A pair branches off where the half multiplier of the symmetric cycle passes -1.  One of the two is computed, on its
whole period, by `branch_off` and `follow` as a cycle of any system: round its folds, past its flips, to the end of the
range or to where it meets its own image, which is the symmetric cycle again.

    symmetric cycle, mu = -1  ->  the one next to it  ->  away from there, until the gain or the end is reached
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

from ..continuation import (
    SYMMETRY_BREAKING,
    Branch,
    End,
    Missed,
    SpecialPoint,
    branch_off,
    follow,
    monitors_of,
    special_points_between,
)
from ..continuation.walk import walk
from ..errors import NoOrbit, Status
from ..orbits import Options, refined
from .find_fold import HIGHEST
from .problem import HuntingOrbit

LOWEST = 0.5
"""Down to this part of a gain a loss of symmetry is looked for from there; upwards the symmetric cycle has a fold."""
SAME_POINT = 1e-5
"""Two losses of symmetry whose gains differ by no more than this part, as far as a pair tells it, are one."""


def lopsided_branch(
    special: SpecialPoint[HuntingOrbit], low: float, high: float, *, options: Options | None = None,
    progress: Callable[[HuntingOrbit], None] | None = None,
) -> Branch[HuntingOrbit]:  # fmt: skip
    """One of the pair that branches off at a symmetry breaking, followed away from there.

    special, low, high: the point, and the range of the gain; progress: called with every cycle. Raises NoOrbit: the
    cycle next to the point was not computed.
    """
    first = branch_off(special, "gain", options=options)
    to, back = (low, high) if first.gain < special.value else (high, low)
    if not low < first.gain < high:
        ended = f"the pair leaves the range at gain {special.value:.8g}, where it branches off"
        return Branch("gain", (first,), end=End("range", ended))
    if progress is not None:
        progress(first)
    return follow(first, "gain", to=to, back=back, options=options, monitors=monitors_of(first), progress=progress)


def with_lopsided(
    branch: Branch[HuntingOrbit], *, options: Options | None = None,
    progress: Callable[[HuntingOrbit], None] | None = None,
) -> Branch[HuntingOrbit]:  # fmt: skip
    """A branch of symmetric cycles with the pairs of lopsided ones that branch off from it.

    Parameters
    ----------
    branch
        the branch, such as `diagram` gives it.
    options
        tolerance and method; default those of the orbits at the symmetry breakings.
    progress
        called with every lopsided cycle as it is found.

    Returns
    -------
    Branch, whose `lopsided` has one cycle of each pair, followed in the range of its gains and above; `missed` says
    which pair was not computed.

    Examples
    --------
    >>> from casahunt import Servo, diagram, with_lopsided
    >>> branch = diagram(Servo(), "switch", start=0.6)
    >>> with_lopsided(branch).lopsided  # this servo's cycle keeps its symmetry
    ()
    """
    pairs: list[Branch[HuntingOrbit]] = []
    missed: list[Missed] = []
    low = min(branch.range, default=0.0)
    for special in branch.special:
        met = [other.value for pair in pairs for other in pair.special if other.kind == special.kind]
        begun = any(math.isclose(special.value, gain, rel_tol=SAME_POINT) for gain in met)
        if special.kind != SYMMETRY_BREAKING.kind or begun:
            continue
        try:
            pairs.append(lopsided_branch(special, low, special.value * HIGHEST, options=options, progress=progress))
        except NoOrbit as error:
            missed.append(Missed(special.kind, f"the lopsided pair was not followed: {error}"))
    return replace(branch, lopsided=tuple(pairs), missed=(*branch.missed, *missed))


def lopsided_at(symmetric: HuntingOrbit, options: Options) -> HuntingOrbit:
    """One of a pair of lopsided cycles at the gain of a symmetric one; one that is stable, where one is found.

    Raises NoOrbit: none was found.
    """
    gain, found = symmetric.gain, []
    rough = options.rough()
    said = f"from gain {LOWEST * gain:.6g} on, up to its fold, the symmetric cycle was not seen to lose its symmetry"
    for special in sorted(_breakings(symmetric, rough), key=lambda special: abs(special.value - gain)):
        low, high = (0.0, gain) if special.value < gain else (gain, gain * HIGHEST)
        said = f"the pair that branches off at gain {special.value:.8g} does not lead to it"
        with suppress(NoOrbit):
            last = lopsided_branch(special, low, high, options=rough).orbits[-1]
            if last.gain == gain and last.repeats == 1:
                found.append(refined(last, options))
                if found[-1].stable:
                    break
    if found:
        return next((orbit for orbit in found if orbit.stable), found[0])
    raise NoOrbit(
        f"no lopsided hunting cycle of {symmetric.problem.title} was found at gain {gain:.10g}, which does not prove "
        f"that there is none: {said}",
        Status.NOT_FOUND,
    )


def _breakings(symmetric: HuntingOrbit, options: Options) -> Iterator[SpecialPoint[HuntingOrbit]]:
    """The losses of symmetry next to a symmetric cycle on its branch, below it and above."""
    gain = symmetric.gain
    for sense, low, high in ((-1.0, LOWEST * gain, gain), (1.0, gain, gain * HIGHEST)):
        steps = walk(symmetric, low=low, high=high, sense=sense, options=options)
        way = [symmetric, *_up_to_the_fold(steps)]
        for earlier, before, after in zip([None, *way], way, way[1:], strict=False):
            found, _ = special_points_between(
                before, after, vary="gain", monitors=(SYMMETRY_BREAKING,), options=options, earlier=earlier
            )
            if found:
                yield found[0]
                break


def _up_to_the_fold(steps: Iterator[HuntingOrbit]) -> Iterator[HuntingOrbit]:
    """The orbits of a walk on this side of the next fold, and the first one behind it."""
    for orbit in steps:
        yield orbit
        if orbit.half_multiplier > 1:
            return
