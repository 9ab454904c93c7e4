"""Where a phase of a cycle shrinks to nothing: T_k = 0; and where between two orbits of a branch the phases change.

    G(u, lambda) = 0,    T_k = given -> 0

A phase between two events that are about to become one contact lasts like a square root of the way that the parameter
has left, so the parameter is no coordinate there: the duration is.  Held at ever smaller values, with the parameter
free, it leads to the contact; behind it stands the cycle without the phase.  Between two orbits with other phases it is

    the shortest phase of the orbit with more of them, shrunk to nothing
    where that is too far, the same from the orbits of a walk towards the other one, nearer and nearer
    where no phase vanishes, the cycle with fewer phases that grazes an event, or the last of them found

The other way round, a phase that begins at a contact is held at a small duration there, with the parameter free; where
one event more begins, and no phase of another mode, the phase before it is held at a little less than it lasted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import chain, islice, takewhile
from typing import cast

import numpy as np

from ..collocation.mesh import halved, phase_breaks
from ..collocation.newton import newton
from ..collocation.transcription import Setting, Transcription
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, on_breaks
from ..orbits.family import Cycles
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..orbits.restart import Start
from ..orbits.sequences import nearest_touch, with_contact, without
from ..orbits.simulated_phases import may_vanish, rotated, speeds_of_starts, strongest
from ..roots import boundary
from .curve import CurvePoint, along, backwards, curve_point, parameter_value, secant_direction, solved_at
from .grazing_contact import CONTACT_RANGE, Contact, grazing_at
from .locating import length_to, nearer
from .poincare_section import beside_the_plane, same_events
from .walk import step_along

Array = np.ndarray

SHRINKS_TO, SLOWEST = 0.25, 0.95
"""Part of its duration that is left of the phase in one step; where the step fails, its root, which is at most this."""
VANISHED_PART = 1e-7
"""Part of its duration at which a phase has vanished: what the parameter lacks is this part or its square."""
WELL = 2
"""Iterations of Newton's method with which a shorter phase is found as long as rounding has no part in it."""
MESHES_OF_A_TOUCH = 6
"""How often a mesh is halved for the contact, two as a rule; one that moves even then, by the tolerance, is none."""
SOON = 0.7
"""A phase that has shrunk to this part from one orbit to the next vanishes, by a square root, within as long a way."""
AS_FAR = 3.0
"""A contact farther away than this many of the last steps is none that the branch has come to."""
BEHIND = 1e-4
"""How far behind a grazing contact, along the branch, the next cycle is looked for."""
BORN_PARTS = (1.0, 0.1, 0.01)
"""Parts of its first duration with which a phase that begins at a contact is sought."""
MET_SOONER = (0.9999, 0.999, 0.99)
"""Parts of its duration at a contact that the phase before an event takes where that is met: the sooner, the faster."""
SEEN_BETTER = 10.0
"""A branch is seen better from another phase on where so many times as much of a step is seen there."""
UNLOCATED = 1e-5
"""Relative error of the parameter at the last cycle before one that is another motion, where what that meets was not
located: admissibility has a slack, and where the place was located afterwards it lay 1e-6 beside."""
TURNS_FROM = 1.5
"""Power of a duration from which on what the parameter lacks goes like its square."""
CHANGE_WIDTH, CHANGE_ROUNDS = 1e-7, 40
"""Relative width to which the last orbit with the phases of the first one is sought; steps of that search."""


def orbit_at_contact(orbit: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The cycle at which the shortest phase of one has vanished, without it; and without its image in the other half.

    orbit: a cycle with a phase that is about to vanish. Returns Orbit; None where no phase vanishes.
    """
    problem, k = orbit.problem, may_vanish([arc.duration for arc in orbit.arcs])
    if k in (0, len(orbit.arcs) - 1):  # it is joined with its neighbours; the image of the first phase is none yet
        orbit, _ = from_strongest(orbit, None, options)
    start = unknowns_of(orbit)
    found = next(without(problem.asked(), start), None)
    contact = None if found is None else _contact(problem, start, found[0], vary, options.tol)
    if found is None or contact is None:
        return None
    (t, u, setting), lam, error = contact
    there = problem.with_value(vary, problem.moved(vary, lam))
    posed = there.asked()
    alone = [fewer for gone, fewer in without(posed, (t, u, setting.moved(lam))) if gone == found[0]]
    with_image = (fewest for fewer in alone for _, fewest in islice(without(posed, fewer), 1))
    for fewer in chain(alone, with_image):
        other = solved_at(there, fewer, options)
        if other is not None and not same_events(other, orbit):
            return cast(AnyOrbit, replace(other, parameter_error=max(other.parameter_error, error)))
    return None


def first_shrinks(before: Orbit, after: Orbit) -> bool:
    """Whether the first phase has become one that may vanish, so that a branch had better start with another one."""
    if before.signature != after.signature:
        return False
    first = [may_vanish([arc.duration for arc in orbit.arcs]) == 0 for orbit in (before, after)]
    return first == [False, True] and beside_the_plane(after) == math.inf


def from_strongest(orbit: AnyOrbit, previous: AnyOrbit | None, options: Options) -> tuple[AnyOrbit, AnyOrbit | None]:
    """The same cycles from the boundary on that is crossed the fastest: next to one that is grazed, x_0 turns back.

    There its distance from the contact goes like a square root of the parameter's, as if the branch had a fold.

    orbit, previous: the cycle, and the one before it on the branch or None.
    Returns both; as they are where that is not known.
    """
    posed = orbit.problem.asked()
    if posed is None or previous is not None and previous.signature != orbit.signature:
        return orbit, previous
    first = strongest(unknowns_of(orbit))
    turned = []
    for one in (orbit,) if previous is None else (orbit, previous):
        start = rotated(posed, unknowns_of(one), first) if first else None
        found = None if start is None else solved_at(one.problem, start, options)
        if found is None:
            return orbit, previous
        turned.append(cast(AnyOrbit, found))
    return turned[0], turned[1] if previous is not None else None


def seen_better(orbit: AnyOrbit, point: CurvePoint, options: Options) -> AnyOrbit | None:
    """The same cycle from the start of the phase on where node, duration and lambda move the most along the branch.

    By these a step is measured: where what moves lies elsewhere in the cycle, it turns back as if at a sharp fold.  So
    it does at a boundary that is about to be grazed, which is crossed slowly.

    orbit, point: the cycle, and the curve there.
    Returns Orbit; None where it is seen well enough, or cannot be cut there.
    """
    t, du, posed = point.t, point.du, orbit.problem.asked()
    longer, nodes = t.durations_of(du) / t.durations_of(point.u), t.nodes_of(du)[t.phase_start]
    moves = np.sqrt(np.sum(nodes**2, axis=1) + longer**2 + point.row[-1] ** 2)
    better = moves >= SEEN_BETTER * moves[0]
    if posed is None or not better.any():
        return None
    told = np.where(better, moves * speeds_of_starts((t, point.u, point.setting)), 0.0)
    start = rotated(posed, unknowns_of(orbit), int(np.argmax(told)))
    return None if start is None else cast("AnyOrbit | None", solved_at(orbit.problem, start, options))


def _contact(problem: Problem, start: Start, k: int, vary: str, tol: float) -> tuple[Start, float, float] | None:
    """(cycle, lambda, its error) where phase k has become `VANISHED_PART` times as long; None where it gets not there.

    What lambda lacks to the contact is some part of d lambda / d ln T_k, and what a mesh of half the intervals shows is
    off by 2^d times as much, or more.
    """
    t, u, setting = start
    setting = replace(setting, dp=along(problem, vary))
    end = _shrunk(t, u, setting, k, tol)
    fine = None if end is None else _on_fine_mesh((t, end[0], setting), end[1], k, tol)
    if fine is None:
        return None
    (t, u, setting), lam, off = fine
    return fine[0], lam, max(lacking((t, u, setting.moved(lam)), k), off / 2**t.degree)


def lacking(start: Start, k: int) -> float:
    """|d lambda / d ln T_k|: what lambda lacks to where phase k has no duration is some part of this, next to it."""
    t, u, setting = start
    return abs(float(t.linearise(u, setting).tangent(_row(t, u, k))[1][-1]))


def turns_where_it_vanishes(orbits: Sequence[Orbit], vary: str, tol: float) -> bool:
    """Whether the parameter turns where the phase that vanishes at the end of a branch has no duration.

    What it lacks goes like the square of the duration there, like the duration itself where the branch only ends.
    """
    k, lacks = may_vanish([arc.duration for arc in orbits[-1].arcs]), []
    if k is None:
        return False
    for orbit in takewhile(lambda orbit: orbit.signature == orbits[-1].signature, reversed(orbits)):
        t, u, setting = unknowns_of(orbit)
        short = lacking((t, u, replace(setting, dp=along(orbit.problem, vary))), k)
        lacks.append((math.log(orbit.arcs[k].duration), short))
        if len(lacks) > 1 and lacks[-2][1] > tol:  # nearer to the end they are rounding, and the error of the mesh
            (after, less), (before, more) = lacks[-2:]
            return math.log(more / less) > TURNS_FROM * (before - after)
    return False


def _shrunk(t: Transcription, u: Array, setting: Setting, k: int, tol: float) -> tuple[Array, float] | None:
    """(u, lambda) where phase k has become `VANISHED_PART` times as long; None where it does not get there.

    Where the end of that phase hardly tells anything any more, less than the tolerance before, where it still did.  Nor
    where lambda turns round on the way, by more than the tolerance: near the end its slope is rounding.
    """
    goal, lam, part = VANISHED_PART * float(t.durations_of(u)[k]), 0.0, SHRINKS_TO
    way, well = 0.0, (u, lam)
    while float(t.durations_of(u)[k]) > goal:
        row = _row(t, u, k)
        du, y = t.linearise(u, setting.moved(lam)).tangent(row)
        if way * y[-1] < 0 and abs(y[-1]) > tol:
            return None  # lambda turns round: a fold comes first
        way = way or float(y[-1])
        ahead = u + (part - 1) * du, lam + (part - 1) * float(y[-1])
        solution = newton(t, ahead[0], setting, border=row, parameter=ahead[1], accuracy=1e-3 * tol)
        if solution.status.ok:
            u, lam, part = solution.u, solution.parameter, max(part**2, SHRINKS_TO)
            well = (u, lam) if solution.iterations <= WELL else well
        elif abs(y[-1]) <= tol:
            return well
        elif (part := float(np.sqrt(part))) > SLOWEST:
            return None
    return u, lam


def _row(t: Transcription, u: Array, k: int) -> Array:
    """The border row of ln T_k."""
    durations = np.zeros(t.phases)
    durations[k] = 1.0 / t.durations_of(u)[k]
    return t.system.border(durations=durations)


def _on_fine_mesh(start: Start, lam: float, k: int, tol: float) -> tuple[Start, float, float] | None:
    """The same on meshes on which lambda moves no more, by the tolerance: the mesh was that of another cycle.

    Returns start, lambda, by how much it has moved last; None where it still moves on the last one that is solved on:
    that is no place where anything is grazed.
    """
    t, u, setting = start
    for _ in range(MESHES_OF_A_TOUCH):
        finer, v, there = on_breaks((t, u, setting), halved(phase_breaks(t, setting.fractions)))
        row = _row(t, u, k)
        solution = newton(finer, v, there, border=row, parameter=lam, accuracy=1e-3 * tol)
        if not solution.status.ok:
            return None
        off = abs(solution.parameter - lam)
        t, u, setting, lam = finer, solution.u, there, solution.parameter
        if off <= tol:
            return (t, u, setting), lam, off
    return None


def vanishing_soon(
    before: AnyOrbit, after: AnyOrbit, vary: str, options: Options, *, at_kinks: bool = True
) -> tuple[AnyOrbit, AnyOrbit] | None:
    """Where the shortest phase of the last of two orbits is about to vanish: the contact, and the cycle behind it.

    at_kinks: whether it is asked where the motion hardly changes, since the field has but a kink there.
    Returns (the cycle at the contact, one behind it); None where no phase vanishes soon, or none continues.
    """
    k = may_vanish([arc.duration for arc in after.arcs]) if before.signature == after.signature else None
    if k is None or after.arcs[k].duration > SOON * before.arcs[k].duration:
        return None
    if not at_kinks and after.cycle.at_a_kink(k - 1) and after.cycle.at_a_kink(k):
        return None
    contact = orbit_at_contact(after, vary, options)
    if contact is None:
        return None
    value, last = parameter_value(contact, vary), parameter_value(after, vary)
    came = last - parameter_value(before, vary)
    if abs(value - last) > AS_FAR * abs(came) or (value - last) * came < 0:
        return None  # far away, or where the branch comes from
    sense = float(np.sign(value - last)) or 1.0
    each = next_to(contact, vary, sense, options)
    return next(((contact, orbit) for orbit in each if orbit.signature == contact.signature), None)


def next_to(contact: AnyOrbit, vary: str, sense: float, options: Options) -> Iterator[AnyOrbit]:
    """The cycles next to a contact that steps from it lead to, the one in the sense of the parameter first."""
    point = curve_point(contact, vary, sense=sense)
    for way in (point, backwards(point)):
        outcome = step_along(way, contact, vary, BEHIND, *contact.problem.range_of(vary), options)
        if not isinstance(outcome, str):
            yield outcome[0]


def change_of_phases(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit at which the phases change from those of `before` to those of `after`.

    It is the cycle at which a phase of the longer sequence has vanished, or the one with fewer phases that grazes an
    event, or the last of those that was found; of what is no user's system, the last one with the phases of `before`.
    Where only a plane cuts the one elsewhere than the other, no phase of the motion changes.

    vary, options: name of the parameter; tolerance and method of the orbits.
    Returns Orbit; None where the events are the same.
    """
    found = contact_between(before, after, vary, options)
    return None if found is None else cast(AnyOrbit, found[0])


@lru_cache(maxsize=16)  # the walk asks for it, and again what lies in its steps
def contact_between(before: Orbit, after: Orbit, vary: str, options: Options) -> tuple[Orbit, Orbit | None] | None:
    """The same, and a cycle on the side of more phases, up to which there is no fold.

    It is the one from which on a phase shrinks to nothing, or one next to the contact that meets its event slowly.
    None in its place where none was found.
    """
    if same_events(before, after):
        return None
    fewer, more = sorted((before, after), key=lambda orbit: len(orbit.arcs))
    alike = takewhile(lambda orbit: orbit.signature == more.signature, nearer(more, fewer, vary, options))
    for orbit in chain((more,), alike):
        gone = orbit_at_contact(orbit, vary, options)
        if gone is not None and _on_the_way(before, gone, after, vary):
            return gone, orbit
    last = last_before(fewer, more, vary, options, lambda orbit: orbit.signature != fewer.signature)
    distance, _, event = nearest_touch(last.problem.asked(), unknowns_of(last))
    contact = grazing_at(last, event, vary, options) if distance <= CONTACT_RANGE else None
    if contact is None:
        return replace(last, parameter_error=UNLOCATED), None
    return contact[1], with_one_more(contact[1], contact[0], vary, options)


def _on_the_way(before: Orbit, contact: Orbit, after: Orbit, vary: str) -> bool:
    """Whether a grazing contact is that between two orbits.

    It need not lie between them: the branch may turn there, and the cycle without the phase goes on beyond it by what a
    mode puts up with.
    """
    if min(_way(before, contact, after, vary), _way(after, contact, before, vary)) > 0:
        return True
    fewer, more = sorted((before, after), key=lambda orbit: len(orbit.arcs))
    off, step = (abs(parameter_value(orbit, vary) - parameter_value(fewer, vary)) for orbit in (contact, more))
    return len(contact.arcs) == len(fewer.arcs) and off <= AS_FAR * step


def _way(one: Orbit, between: Orbit, other: Orbit, vary: str) -> float:
    """How far an orbit is from one towards another, in the parameter."""
    here = parameter_value(one, vary)
    return (parameter_value(between, vary) - here) * float(np.sign(parameter_value(other, vary) - here))


def last_before(
    before: AnyOrbit, after: AnyOrbit, vary: str, options: Options, beyond: Callable[[AnyOrbit], bool]
) -> AnyOrbit:
    """The last orbit on the way from one to another that is not beyond something."""
    start = curve_point(before, vary, like=secant_direction(before, after, vary))
    length = length_to(after, before, start, vary)
    found = [before]

    def passed(ds: float) -> bool:
        outcome = step_along(start, before, vary, ds, *before.problem.range_of(vary), options)
        if isinstance(outcome, str) or beyond(outcome[0]):
            return True
        found.append(outcome[0])
        return False

    low = 0.0
    for far in (length, 2 * length, 4 * length):  # where the branch turns back, it is farther than the other orbit
        low, high = boundary(passed, low, far, width=CHANGE_WIDTH * length, rounds=CHANGE_ROUNDS)
        if high < far:
            break
    return found[-1]


def with_duration(
    problem: Problem, start: Start, k: int, parts: Sequence[float], vary: str, options: Options
) -> Orbit | None:
    """The cycle next to a contact in which a phase has been given a duration: T_k is held, the parameter free.

    problem, start, k: the problem at the contact; the cycle there with the phase, and its number; parts: of its
    duration there, the first one taken that leads to a cycle.
    Returns Orbit; None where there is none with these phases next to the contact.
    """
    t, begun, setting = start
    setting = replace(setting, p=problem.vector(), dp=along(problem, vary))
    for part in parts:
        u = begun.copy()
        t.durations_of(u)[k] *= part
        solution = newton(t, u, setting, border=_row(t, u, k), accuracy=1e-3 * options.tol)
        if not solution.status.ok:
            continue
        there = problem.with_value(vary, problem.moved(vary, solution.parameter))
        found = solved_at(there, (t, solution.u, setting), options)
        if found is not None and found.signature == t.cycle.signature:
            return found
    return None


def with_one_more(orbit: AnyOrbit, place: Contact, vary: str, options: Options) -> AnyOrbit | None:
    """The cycle next to one that grazes an event which meets it, slowly; None where none was found."""
    family, k = cast(Cycles, orbit.problem), place.phase
    for start in with_contact(family.asked(), unknowns_of(orbit), k, place.event):
        leads_elsewhere = start[0].phases > len(orbit.arcs) + 1  # to another mode, and from there back
        held, parts = (k + 1, BORN_PARTS) if leads_elsewhere else (k, MET_SOONER)
        found = with_duration(family, start, held, parts, vary, options)
        if found is not None:
            return cast(AnyOrbit, found)
    return None
