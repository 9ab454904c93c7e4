"""Where a branch meets its own image: a pitchfork or a flip, come to along the branch that branches off there.

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
from .bifurcations import FLIP, SYMMETRY_LOST
from .curve import curve_point, in_units_of, parameter_value, secant_direction, solved_at
from .special_points import ACCEPTED_TOLERANCES, Missed, Monitor, SpecialPoint, special_point
from .walk import step_along

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
