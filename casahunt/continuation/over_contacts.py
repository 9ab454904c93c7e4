"""Where a step of a walk comes to a contact, or leads over one: how the branch goes on from there.

    before ---- contact | beside ---- after        beside: next to the contact, with the phases of the longer sequence

At a contact the branch has a corner, and its parameter may turn round there as at a fold: what begins is reached from
the contact on, in the direction in which the phases that begin lead (vanishing.py).  A step over a contact is one
where both pieces of it are: each with tangents that agree at its ends and along it, its parameter going one way.

    the first piece is none    the walk takes shorter steps from `before` on; so it does where it came from the contact
    the second one is none     the branch goes on from the contact, with the orbit next to it
    nothing was found beside   the step is kept, and what it may have left out is missed, and said so
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from ..collocation.joints import event_rate
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit
from .branch import Departure, Run
from .crossings import Passed
from .curve import curve_point, parameter_value, secant_direction
from .poincare_section import apart_by_kinks, beside_the_plane, same_events
from .special_points import GRAZING, Missed, SpecialPoint, special_point
from .terminations import STANDS_STILL, End
from .vanishing import BEHIND, contact_between, next_to, vanishing_soon
from .walk import ASTRAY_BY, LEAST_COSINE

Array = np.ndarray

SHORTER = 0.25
"""Part of the length of a step over a contact with which the walk tries again from in front of it."""
TURNS_BACK = "; {name} turns back there: no fold"
NOT_JOINED = (
    "phases change between {name} = {low:.8g} and {high:.8g}: next to where they do no cycle with those behind was "
    "found, and whether the branch leads from there to the next cycle is not known"
)


def phase_gone(run: Run[AnyOrbit], before: AnyOrbit, after: AnyOrbit) -> AnyOrbit | Departure[AnyOrbit] | None:
    """Whether a phase vanishes behind the last two orbits: the branch has the contact then, and goes on without it."""
    if beside_the_plane(after) < math.inf:
        return None
    over = vanishing_soon(before, after, run.branch.vary, run.options, at_kinks=run.line.at_kinks)
    if over is None or not run.within(over[0]):
        return None
    contact, behind = over
    _given(run, contact, turns_round((before, after), contact, behind, run.branch.vary))
    if not run.within(behind):
        return behind
    run.add(behind, passed=run.line.past(behind))
    return Departure(1.0, contact)


def leapt_over(
    run: Run[AnyOrbit], after: AnyOrbit, way: Departure[AnyOrbit]
) -> AnyOrbit | Departure[AnyOrbit] | End | None:
    """How the branch goes on where a step over a contact leaves out what is there; None where it does not."""
    before, vary, options = run.last, run.branch.vary, run.options
    if not run.line.at_kinks and apart_by_kinks(before, after):
        return None
    found = contact_between(before, after, vary, options)
    if found is None:
        return None
    contact = cast(AnyOrbit, found[0])
    near, far = _beside(contact, cast("AnyOrbit | None", found[1]), before, after, vary, options)
    if near is None or far is None:
        low, high = parameter_value(before, vary), parameter_value(after, vary)
        meaning = NOT_JOINED.format(name=vary, low=low, high=high)
        run.add(passed=Passed((), (Missed(GRAZING.kind, meaning),)))
        return None
    length = float(np.linalg.norm(secant_direction(before, after, vary)))
    whole = length <= BEHIND or _one_piece(contact, near, before, after, vary)
    if not whole or length > run.how["smallest_step"] and _came_from(run, contact):
        previous = (way.previous, *run.branch.orbits)[-2]
        return replace(way, previous=previous, heading=None, first_step=SHORTER * length)
    turns = turns_round((near,), contact, far, vary)
    if not turns and _one_piece(contact, far, after, before, vary):
        return None
    special = _given(run, contact, turns)
    return End(special.kind, special.meaning, special.value, special.error) if run.natural and turns else far


def _came_from(run: Run[AnyOrbit], contact: Orbit) -> bool:
    """Whether a branch has its last phases from this contact on: a step that leads over it leads back."""
    began = next((orbit for orbit in reversed(run.branch.orbits) if not same_events(orbit, run.last)), None)
    if began is None or began.signature != contact.signature:
        return False
    lam = contact.problem.distance(run.branch.vary, run.value(began))
    return abs(lam) <= run.options.tol + contact.parameter_error + began.parameter_error


def _given(run: Run[AnyOrbit], contact: AnyOrbit, turns: bool) -> SpecialPoint[AnyOrbit]:
    """The contact that a branch has been given, which goes on from there."""
    special = special_point(GRAZING, contact, run.branch.vary)
    special = said_to_turn(special) if turns else special
    run.add(passed=run.line.rest())
    run.add(contact, passed=run.of_contact(special))
    run.line.go_on_from(contact)
    return special


def turns_round(orbits: Sequence[Orbit], contact: Orbit, behind: Orbit, vary: str) -> bool:
    """Whether the parameter turns round at a contact.

    orbits, contact, behind: those that lead to it, the contact, and the orbit behind it.
    """
    came = (contact.problem.distance(vary, parameter_value(orbit, vary)) for orbit in reversed(orbits))
    goes = contact.problem.distance(vary, parameter_value(behind, vary))
    return next((way for way in came if abs(way) > STANDS_STILL), 0.0) * goes > 0


def said_to_turn(contact: SpecialPoint[AnyOrbit]) -> SpecialPoint[AnyOrbit]:
    """A contact whose sentence says that the parameter turns round there."""
    return replace(contact, meaning=contact.meaning + TURNS_BACK.format(name=contact.vary))


def _beside(
    contact: AnyOrbit, more: AnyOrbit | None, before: AnyOrbit, after: AnyOrbit, vary: str, options: Options
) -> Iterator[AnyOrbit | None]:
    """The cycles next to a contact that meet the events of the one before it, and of the one behind it.

    Where a step leads over several contacts, one that meets others.

    more: the one with more phases, or None.
    """
    sense = float(np.sign(parameter_value(after, vary) - parameter_value(before, vary))) or 1.0
    found = [*next_to(contact, vary, sense, options), *([] if more is None else [more])]
    for side, other in ((before, after), (after, before)):
        own = [orbit for orbit in found if same_events(orbit, side)]
        yield next(iter(own or [orbit for orbit in found if not same_events(orbit, other)]), None)


def _one_piece(contact: Orbit, beside: Orbit, end: Orbit, other: Orbit, vary: str) -> bool:
    """Whether one step leads from next to a contact to the end of a step over it, whose other end is beyond.

    That is to say away from the contact, along the tangents at both ends, and as the walk goes.  They may be cut by
    other planes: they are seen where an event is met that all of them meet once.
    """
    if not same_events(beside, end):
        return False
    orbits = (contact, beside, end, other)
    shared = [label for label in beside.signature if all(orbit.signature.count(label) == 1 for orbit in orbits)]
    if not shared:
        return True
    label = max(shared, key=lambda label: _seen(beside, vary, label).rate)
    first, here, there, beyond = (_seen(orbit, vary, label) for orbit in orbits)
    unit = np.append(beside.scale, abs(beside.problem.unit(vary)))
    out, way, whole = ((a.place - b.place) / unit for a, b in ((here, first), (there, here), (there, beyond)))
    away, arriving = here.tangent / unit, there.tangent / unit
    away, arriving = away * np.sign(away @ out), arriving * np.sign(arriving @ whole)
    length, least = np.linalg.norm(way), LEAST_COSINE * np.linalg.norm(away) * np.linalg.norm(arriving)
    straight = length <= BEHIND or ASTRAY_BY * (away @ way) >= length * np.linalg.norm(away)
    return bool(straight and away @ arriving >= least and away[-1] * arriving[-1] > 0)


class _Seen(NamedTuple):
    """An orbit where it meets an event: the state there and the parameter (n + 1,), how they go along the branch, and
    the rate with which the event is met."""

    place: Array
    tangent: Array
    rate: float


def _seen(orbit: Orbit, vary: str, label: tuple[str, str]) -> _Seen:
    k, point = orbit.signature.index(label), curve_point(orbit, vary)
    t, setting = point.t, point.setting
    x, dx = (t.nodes_of(values)[t.phase_end[k]] * setting.scale for values in (point.u, point.du))
    rate = abs(event_rate(t.cycle.phases[k], x, orbit.arcs[k].duration, setting.p)[0]) * orbit.period
    value, along = parameter_value(orbit, vary), point.row[-1] * orbit.problem.unit(vary)
    return _Seen(np.append(x, value), np.append(dx, along), float(rate))
