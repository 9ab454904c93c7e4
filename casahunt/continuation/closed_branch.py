"""Where a branch closes: it meets its own image, or comes back to where it began, round an isola.

And what a whole branch shows: its parameter turns round at folds and grazings, and nowhere else.

Where a branch meets its own image: a pitchfork or a flip, come to along the branch that branches off there.

    d = S x(half of the phases later) - c - x_0        passes zero: the cycle is its own image, mirrored (S), or half a
                                                       period later (S = 1)
    prod (mu_i + 1) = 0                                of that cycle's own map, half of the phases long

Along the branch the parameter turns back there, lambda - lambda_0 = a d^2, and the equations of the whole cycle become
singular: they know lambda_0 badly.  Those of half the phases are regular.  So the point is located on the branch of the
cycle that is its own image, where its multiplier passes -1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from ..collocation.mesh import phase_breaks, transfer
from ..hybrid.language import System
from ..orbits.adapt import Options
from ..orbits.closure import Closure, turned, with_sections
from ..orbits.family import Cycles
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..orbits.recurrence import is_symmetry, symmetries
from ..orbits.restart import Start, in_scale
from ..orbits.sequences import segments_of, start_of
from ..roots import secant as secant_root
from .bifurcations import BRANCH_POINT, FLIP, SYMMETRY_LOST
from .branch import Branch, Run
from .crossings import Passed, special_points_between
from .curve import curve_point, in_units_of, parameter_value, secant_direction, solved_at
from .special_points import ACCEPTED_TOLERANCES, FOLD, GRAZING, Missed, Monitor, SpecialPoint, special_point
from .terminations import End, ranges
from .walk import step_along

LEAST_ROUND = 6
"""Orbits that a closed branch has at least: round two folds."""
SURELY_MOVED = 10.0
"""A parameter that has moved by more than so many of its errors has moved."""
MET_AGAIN = 100.0
"""Tolerances to which a cycle that is met again is the same: ranges are read off samples."""


def came_round(run: Run[AnyOrbit], after: AnyOrbit) -> End | None:
    """The end of a branch that comes back to where it began.

    Returns end; None where it does not.
    """
    orbits = run.branch.orbits
    if len(orbits) < LEAST_ROUND:
        return None
    first, begun = run.value(orbits[0]), run.value(orbits[1])
    before, value = run.value(run.last), run.value(after)
    if not min(before, value) <= first <= max(before, value) or (value - before) * (begun - first) <= 0:
        return None
    problem = after.problem.with_value(run.branch.vary, first)
    there = cast("AnyOrbit | None", solved_at(problem, unknowns_of(after), run.options))
    if there is None or not _the_same(there, orbits[0], run.options.tol):
        return None
    run.add(there)
    run.add(passed=run.line.past(there))
    run.add(passed=run.line.rest())
    return End("closed", f"at {run.branch.vary} = {first:.8g} the branch comes back to where it began", first)


def _the_same(one: Orbit, other: Orbit, tol: float) -> bool:
    """Whether two cycles at one value of the parameter have the same ranges and the same period."""
    sizes = np.append(ranges(one), one.period), np.append(ranges(other), other.period)
    return bool(np.all(np.abs(sizes[0] - sizes[1]) <= MET_AGAIN * tol * np.abs(sizes[1])))


def met_itself(run: Run[AnyOrbit], after: AnyOrbit) -> End | None:
    """The end of a branch that meets its own image before the next orbit: what follows is what it has passed.

    run, after: the branch, which is told what was missed where that could not be located, and the next orbit.
    Returns end; None where it does not.
    """
    before, vary = run.last, run.branch.vary
    met = reunion(before, after, run.options.tol) if run.looked_for else None
    if met is None:
        return None
    point = met_at(before, after, met, vary, run.options)
    if isinstance(point, Missed):
        run.add(passed=Passed((), (point,)))
        return None
    run.add(passed=run.line.rest())
    kinds = (FOLD.kind, BRANCH_POINT.kind, met.reached.kind)
    others = tuple(monitor for monitor in run.looked_for if monitor.kind not in kinds)
    # Behind the point follow the images: what lies before it is seen between the last orbit and one next to it.
    near = short_of(before, after, met, vary, run.options) or after
    found, missed = special_points_between(before, near, vary=vary, monitors=others, options=run.options)
    special = (*(special for special in found if not met.off(special.orbit) <= 0), point)
    run.add(*([point.orbit] if met.same_period else []), passed=Passed(special, tuple(missed)))
    value = run.value(point.orbit)
    return End(
        "closed", f"at {vary} = {value:.8g} the cycle is its own image; what follows are the images of what was passed",
        value,
    )  # fmt: skip


def unseen_turns(branch: Branch[AnyOrbit]) -> tuple[Missed, ...]:
    """Whether the parameter of a branch has turned round more often than its special points say.

    branch: with all its orbits and special points, and what was missed.
    Returns what is missed besides: a fold, or nothing.
    """
    values = branch.values
    if values.size < 3:
        return ()
    errors = np.array([orbit.error_estimate * orbit.problem.unit(branch.vary) for orbit in branch.orbits])
    sure = np.abs(np.diff(values)) > SURELY_MOVED * (errors[1:] + errors[:-1])
    places = np.flatnonzero(sure)
    turned = places[1:][np.diff(np.sign(np.diff(values)[places])) != 0]
    kinds = [point.kind for point in branch.special] + [point.kind for point in branch.missed]
    said = sum(kind in (FOLD.kind, GRAZING.kind) for kind in kinds)
    if turned.size <= said:
        return ()
    about = " and ".join(f"{values[k]:.6g}" for k in turned[: turned.size - said])
    sentence = f"{branch.vary} turns round {turned.size} times, next to {about} too, and not all its folds were located"
    return (Missed(FOLD.kind, f"{sentence}; smaller steps may show them"),)


Array = np.ndarray

LOPSIDED = 1e-5
"""Cycles less far from their image, in units of the state scale, are not told from it."""
BESIDE_MINUS_ONE, MINUS_ONE_ROUNDS = 1e-5, 8
"""How far aside, in lambda, the second cycle is when the multiplier -1 is sought; the most steps of that search."""
ALREADY = 1e-2
"""An orbit less far from its image than this, in parts of the way from one orbit to the next, may be its own image."""
SHORT_OF_IT = 0.05
"""An orbit less far from its image than this, in the same parts, has passed what there is before that."""
MUCH_NEARER, APPROACHES = (0.3, 0.1, 0.03), 16
"""How far from its image, in the same parts, an orbit may be that tells where it is its own, and next to a fold, where
one so near told too little; tries to come there."""
SYMMETRY_REACHED = replace(
    SYMMETRY_LOST,
    meaning="symmetry breaking at {name} = {value:.10g}: a pair of lopsided cycles meets in the symmetric one",
)
FLIP_REACHED = replace(
    FLIP, meaning="flip at {name} = {value:.10g}: the cycle meets the one of half its period that it branches off from"
)


@dataclass(frozen=True, eq=False)
class Reunion:
    """What lies between two orbits where one is on the one side of its own image, and the other on the other.

    Attributes
    ----------
    matrix : S, whose image of the cycle half of the phases later is meant.
    off : (orbit) -> how far before it on the branch an orbit is, in parts of the way between the two; 0 where it is not
        told from its image, NaN where it has other phases.
    reached : the kind of point that it is, by the multipliers of the cycle that is its own image.
    """

    matrix: Array
    off: Callable[[Orbit], float]
    reached: Monitor

    @property
    def same_period(self) -> bool:
        """Whether the cycle that is its own image has the period of the branch; else half of it."""
        return _parts(self.matrix) == 2


def reunion(before: Orbit, after: Orbit, tol: float) -> Reunion | None:
    """Whether a branch meets its own image between two orbits.

    Returns reunion; None where there is nothing such.
    """
    if before.problem.system is None or before.repeats != 1:
        return None
    system, scale = before.problem.system, before.scale
    for S, reached in ((np.eye(scale.size), FLIP_REACHED), *((S, SYMMETRY_REACHED) for S in symmetries(system))):
        a, b = _off_its_image(before, system, S, scale), _off_its_image(after, system, S, scale)
        least = max(LOPSIDED, 10 * tol)
        if a is None or b is None or not np.max(np.abs(a)) > least or not np.max(np.abs(a - b)) > least:
            continue
        gone_over = np.max(np.abs(b)) <= least  # the step led to the cycles that are their own image: b is rounding
        if not (a @ b < 0 or gone_over):
            continue
        way = (a - b) / float((a - b) @ (a - b))

        def before_it(orbit: Orbit, S: Array = S, way: Array = way, least: float = least) -> float:
            off = _off_its_image(orbit, system, S, scale)
            return math.nan if off is None else float(way @ off) if np.max(np.abs(off)) > least else 0.0

        return Reunion(S, before_it, reached)
    return None


def _off_its_image(orbit: Orbit, system: System, S: Array, scale: Array) -> Array | None:
    """(n,) how far the cycle half of its phases later is from its image; None where these are not alike."""
    half, odd = divmod(len(orbit.arcs), 2)
    segments = [] if odd else segments_of(*unknowns_of(orbit))
    if odd or any(a.event == "" for a in segments):
        return None
    x, y = segments[0].start, segments[half].start
    parts = _parts(S)
    shift = turned(system, x, S @ y, parts=parts)
    form, p = with_sections(system, orbit.problem.sections), orbit.problem.vector()
    if parts == 2 and not is_symmetry(form, segments, S, shift, p, scale):
        return None
    if parts == 1 and orbit.signature[:half] != orbit.signature[half:]:
        return None
    return (S @ y - shift - x) / scale


def _parts(S: Array) -> int:
    """How often half of the phases make up the period of a cycle that is its own image."""
    return 1 if np.array_equal(S, np.eye(len(S))) else 2


def met_at(
    before: AnyOrbit, after: AnyOrbit, met: Reunion, vary: str, options: Options
) -> SpecialPoint[AnyOrbit] | Missed:
    """The point at which a branch meets its own image, on the branch of the cycle that is its own image.

    before, after, met: the orbits that it lies between, and what it is.
    Returns special point, whose orbit is computed on half of the phases; what is missed where it is not located.
    """
    step = float(np.linalg.norm(secant_direction(before, after, vary)))
    for nearer in MUCH_NEARER:
        pair = _beside(before, after, met, vary, options, nearer)
        orbit = None if pair is None else _minus_one_next_to(*pair, met, vary, options, nearer, step)
        if orbit is not None:
            return special_point(met.reached, cast(AnyOrbit, orbit), vary)
    kind, value = met.reached.kind, parameter_value(after, vary)
    sentence = f"a {kind} point next to {vary} = {value:.6g}, where the cycle meets its own image, was not located"
    return Missed(kind, f"{sentence}; another tolerance may lead there")


def _minus_one_next_to(
    before: Orbit, after: Orbit, met: Reunion, vary: str, options: Options, nearer: float, step: float
) -> Orbit | None:
    """The cycle that is its own image where its multiplier is -1, from a guess that two orbits make of it.

    It lies no farther from the guess than `step` in units of the state: beyond is another one. None where it is not
    found.
    """
    problem, begin = _half(before, after, met, vary, nearer)
    first, found = begin[0].nodes_of(begin[1])[0] * begin[2].scale, []

    def minus_one(lam: float) -> float:
        orbit = solved_at(problem.with_value(vary, problem.moved(vary, float(lam))), begin, options)
        if orbit is None or not np.max(np.abs(orbit.arcs[0].states[0, 0] - first) / begin[2].scale) <= step:
            return math.nan
        found.append(orbit)
        return float(met.reached.value(orbit, curve_point(orbit, vary)))

    _, left = secant_root(minus_one, 0.0, BESIDE_MINUS_ONE, tolerance=met.reached.tolerance, rounds=MINUS_ONE_ROUNDS)
    return found[-1] if abs(left) <= ACCEPTED_TOLERANCES * met.reached.tolerance else None


def _beside(
    before: AnyOrbit, after: AnyOrbit, met: Reunion, vary: str, options: Options, nearer: float
) -> tuple[AnyOrbit, AnyOrbit] | None:
    """Two orbits of the branch next to the one that is its own image, the second one much nearer to it.

    A step of a walk may have gone over to the cycles that are their own image, or far across: shorter ones come up to
    the point.  None where none does: what the two orbits as they are lead to may be another such point.
    """
    here, first, way = before, 1.0, secant_direction(before, after, vary)
    length = float(np.linalg.norm(way))
    for _ in range(APPROACHES):
        off = met.off(after)
        if ALREADY <= abs(off) <= nearer:
            return here, after
        if off > nearer:
            here = after
        else:
            first /= 2
        point = curve_point(here, vary, like=in_units_of(way, before.scale, here.scale))
        outcome = step_along(point, here, vary, first * length, *before.problem.range_of(vary), options)
        if isinstance(outcome, str):
            first /= 2
        else:
            after = outcome[0]
    return None


def short_of(before: AnyOrbit, after: AnyOrbit, met: Reunion, vary: str, options: Options) -> AnyOrbit | None:
    """An orbit between the first one and the one that is its own image, next to that.

    before, after, met, vary, options: as in `met_at`. Returns Orbit; None where no step leads next to it.
    """
    point = curve_point(before, vary, like=secant_direction(before, after, vary))
    low, high = 0.0, float(np.linalg.norm(secant_direction(before, after, vary)))
    for _ in range(APPROACHES):
        ds = (low + high) / 2
        outcome = step_along(point, before, vary, ds, *before.problem.range_of(vary), options)
        off = -1.0 if isinstance(outcome, str) else met.off(outcome[0])
        if 0 < off <= SHORT_OF_IT and not isinstance(outcome, str):
            return outcome[0]
        low, high = (ds, high) if off > 0 else (low, ds)
    return None


def _half(before: Orbit, after: Orbit, met: Reunion, vary: str, nearer: float) -> tuple[Cycles, Start]:
    """The family of the cycle that is its own image, about at the point, and a guess of that cycle.

    Of two orbits the states are linear in their distance from the image, and the parameter in its square.
    """
    near, far = sorted((before, after), key=lambda orbit: abs(met.off(orbit)))
    a, b = met.off(near), met.off(far)
    t, u, setting = unknowns_of(near)
    other, v, its = in_scale(unknowns_of(far), setting.scale)
    if other.cycle == t.cycle:
        _, v, _ = transfer(other, v, its.fractions, phase_breaks(t, setting.fractions), target=t)
        u = u + a / (a - b) * (v - u)
    segments = segments_of(t, u, setting)
    half = segments[: len(segments) // 2]
    family, parts = cast(Cycles, near.problem), _parts(met.matrix)
    way = family.distance(vary, parameter_value(far, vary))
    if abs(a) <= 2 * nearer * abs(b):
        family = family.with_value(vary, family.moved(vary, way * a**2 / (a**2 - b**2)))
    shift = turned(family.system, half[0].start, met.matrix @ half[-1].behind, parts=parts)
    events, entries = {segment.event for segment in half}, family.system.names.entries
    kept = tuple(s for s in family.sections if events & {e.event.name for e in s.exits(entries)})
    problem = family.closing(Closure.of(met.matrix, shift, parts), kept)
    return problem, start_of(problem.asked(), half, (t, u, setting))
