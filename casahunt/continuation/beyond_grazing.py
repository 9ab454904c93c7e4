"""Behind a contact: the cycle with which a branch goes on where an event is met with no speed, or leads elsewhere.

    a phase has vanished           the cycle without it                                     (vanishing.py)
    an event is grazed once more   the cycle that meets it, at first with no speed: its speed, or the time in the mode
                                   that it leads to, tells how far it is along
    the successor changes          `to` of an event names another mode from here on: the cycle with a phase of that
                                   mode, at first of no duration, where it is left at once
    an event is only grazed        the cycle next to it that keeps clear of it, on either side of the parameter: where
    or met together with another    the motion settles on one that is nearly the same

Where an event is grazed once more, the equations of the cycle go on beyond the contact, and between its points a phase
shows the event no better than its polynomial: the contact is where the scalar of the event turns at zero
(grazing_contact.py). At the contact the cycle with one more boundary has a regular tangent, although h' = 0 there:
along it the phase before that boundary is cut the shorter, while x_0 and the parameter may go like the square of that.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Generic, NamedTuple, cast

import numpy as np

from ..collocation.successors import behind, undecided
from ..errors import NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.family import Cycles
from ..orbits.orbit import AnyOrbit, Complaint, Orbit, unknowns_of
from ..orbits.sequences import nearest_touch, with_successor, without
from ..orbits.simulated_phases import may_vanish
from .curve import along, parameter_value, solved_at
from .grazing_contact import (
    NEAR_CONTACT,
    VANISHING_SHARE,
    Contact,
    contact_value,
    corner_at,
    cycle_near,
    grazing_at,
    middle_of,
)
from .poincare_section import same_events
from .special_points import GRAZING, Monitor, SpecialPoint, special_point
from .vanishing import BORN_PARTS, UNLOCATED, lacking, last_before, next_to, with_duration, with_one_more

BESIDE_GRAZING = (1e-5, -1e-5, 1e-4, -1e-4, 1e-3, -1e-3)
"""Where beside a grazing, in lambda, the first return of a motion is looked at."""
NEARLY_THE_SAME = 0.05
"""Cycles on the two sides of a grazing differ by less than this part of their ranges and periods."""
MET_WITHOUT_SPEED = replace(
    GRAZING,
    meaning="grazing at {name} = {value:.8g}: an event is met with no speed, and no cycle with these phases follows",
)
MET_AT_ONCE = replace(
    GRAZING,
    meaning="grazing at {name} = {value:.10g}: two events are met at once, and no cycle with these phases follows",
)
PHASE_ENDS = "grazing at {{name}} = {{value:.10g}}: the phase {mode!r} shrinks to nothing{follows}"
GOES_ON = ", and it goes on with the cycle next to it that has others"
NONE_WITHOUT = ", and no cycle without it was found: there is none, or beyond it is one of many"

SUCCESSOR_CHANGES = "the successor changes"
LEADS_ELSEWHERE = Complaint("an event leads to another mode than the one that follows", Status.INADMISSIBLE)
"""Why a walk is left at an orbit at which a successor has changed by less than counts."""
ROUNDING_SHARE = 1e-9
"""A phase that takes less of the period than this may be rounding."""
PHASE_GONE = Complaint("a phase has as good as gone", Status.INADMISSIBLE)
"""Why a walk is left at an orbit with a phase of no duration but for rounding, beside which equations turn back."""
MET_FROM_BEHIND = Complaint("an event is met with no speed", Status.INADMISSIBLE)
"""Why a walk is left at an orbit that meets an event from behind by less than counts."""


class Behind(NamedTuple, Generic[AnyOrbit]):
    """What a branch has come to: the grazing and the cycle that it goes on with, None for either where there is none.

    Attributes
    ----------
    grazing, following : the special point and the orbit.
    passed : whether an orbit of the branch has passed it by less than counts; None where none can have.
    """

    grazing: SpecialPoint[AnyOrbit] | None
    following: AnyOrbit | None
    passed: Callable[[Orbit], bool] | None = None

    def reached(self, orbits: tuple[AnyOrbit, ...]) -> tuple[AnyOrbit, ...]:
        """The orbits of the branch up to the contact, and the one there."""
        if self.passed is None or self.grazing is None:
            return orbits
        return *_not_beyond(orbits, self.passed), self.grazing.orbit


def leads_elsewhere(orbit: Orbit) -> bool:
    """Whether an event of a cycle leads to another mode than the one that follows, by less than counts."""
    return bool(undecided(*unknowns_of(orbit)))


def lacks_a_phase(orbit: Orbit, vary: str) -> bool:
    """Whether a phase is gone but for rounding."""
    shortest = min(arc.duration for arc in orbit.arcs) * orbit.repeats
    return shortest <= ROUNDING_SHARE * orbit.period and phase_ends(orbit, vary) is not None


def without_speed(orbit: Orbit, *, within: float = 0.0) -> bool:
    """Whether an event at the end of a phase is met with no speed, or from behind by less than counts.

    within: with how much, per period.
    """
    phases = enumerate(orbit.cycle.phases)
    ends = (Contact(k, phase.end.name, phase.direction, at_end=True) for k, phase in phases if phase.direction)
    return any(contact_value(end, orbit) <= within for end in ends)


def behind_grazing(orbits: tuple[AnyOrbit, ...], vary: str, failure: Complaint, options: Options) -> Behind[AnyOrbit]:
    """The grazing that a branch has come to, and the cycle that it goes on with.

    orbits, vary: of the branch, the last one that of a walk; and the name of the parameter.
    """
    last = orbits[-1]
    if leads_elsewhere(last):
        return _at_changed_successor(orbits, vary, options)
    posed, start = last.problem.asked(), unknowns_of(last)
    sense = float(np.sign(parameter_value(last, vary) - parameter_value(orbits[-2:][0], vary))) or 1.0
    for _, fewer in without(posed, start):
        other = solved_at(last.problem, fewer, options)
        if other is not None and not same_events(other, last) and _alike(last, other):
            other = next((o for o in next_to(other, vary, sense, options) if o.signature == other.signature), other)
            return Behind(special_point(GRAZING, last, vary), cast(AnyOrbit, other))
    distance, mode, event = nearest_touch(posed, start)
    if distance > NEAR_CONTACT:
        if (error := phase_ends(last, vary)) is not None:
            following = _clear_of_it(last, vary, options)
            shortest = min(last.arcs, key=lambda arc: arc.duration)
            meaning = PHASE_ENDS.format(mode=shortest.mode, follows=NONE_WITHOUT if following is None else GOES_ON)
            return Behind(special_point(replace(GRAZING, meaning=meaning), last, vary, error), following)
        if failure.status is not Status.INADMISSIBLE and not without_speed(last, within=NEAR_CONTACT):
            return Behind(None, None)
        corner = corner_at(last, vary, options)
        if corner is None:
            special = special_point(MET_WITHOUT_SPEED, last, vary, error=UNLOCATED)
            return Behind(special, _clear_of_it(last, vary, options))
        place, orbit = corner
        return Behind(special_point(MET_AT_ONCE, orbit, vary), _clear_of_it(last, vary, options), _beyond(place))
    what = f"grazing at {{name}} = {{value:.10g}}: mode {mode!r} meets {event!r} once more, with no speed"
    located = grazing_at(last, event, vary, options)
    if located is None:  # the last cycle is as near to it as its polynomials show
        called = replace(GRAZING, meaning=f"{what}; no cycle with these phases follows")
        special = special_point(called, last, vary, error=NEAR_CONTACT)
        return Behind(special, _clear_of_it(last, vary, options))
    place, orbit = located
    more = with_one_more(orbit, place, vary, options)
    follows = "no cycle with these phases follows" if more is None else "it goes on with the cycle that meets it"
    contact = special_point(replace(GRAZING, meaning=f"{what}; {follows}"), orbit, vary)
    return Behind(contact, more or _clear_of_it(last, vary, options), _beyond(place))


def phase_ends(last: Orbit, vary: str) -> float | None:
    """The error of the parameter at which the shortest phase of a cycle shrinks to nothing; None where it does not."""
    k = may_vanish([arc.duration for arc in last.arcs])
    if k is None or last.arcs[k].duration * last.repeats > VANISHING_SHARE * last.period:
        return None
    t, u, setting = unknowns_of(last)
    lacks = lacking((t, u, replace(setting, dp=along(last.problem, vary))), k)
    return max(lacks, last.error_estimate) if lacks <= NEAR_CONTACT else None


def _beyond(place: Contact) -> Callable[[Orbit], bool]:
    """Whether an orbit has passed a contact."""
    return lambda orbit: contact_value(place, orbit) > 0


def _not_beyond(orbits: tuple[AnyOrbit, ...], passed: Callable[[Orbit], bool]) -> tuple[AnyOrbit, ...]:
    """The orbits of a branch without the last ones, with the same phases, that have passed something; one at least."""
    many = len(orbits)
    while many > 1 and orbits[many - 1].signature == orbits[-1].signature and passed(orbits[many - 1]):
        many -= 1
    return orbits[:many]


def _at_changed_successor(orbits: tuple[AnyOrbit, ...], vary: str, options: Options) -> Behind[AnyOrbit]:
    """Where the successor of an event changes: the last orbits of the branch have passed that by less than counts."""
    last = orbits[-1]
    kept = _not_beyond(orbits, leads_elsewhere)
    same = kept[-1].signature == last.signature and len(kept) < len(orbits)
    there = last_before(kept[-1], orbits[len(kept)], vary, options, leads_elsewhere) if same else last
    at = unknowns_of(last)
    k = undecided(*at)[0]
    event, name = last.arcs[k].event, last.cycle.phases[k].leads_to(behind(*at, k), at[2].p)
    start = with_successor(cast(Cycles, there.problem).asked(), unknowns_of(there), k, name)
    more = None if start is None else with_duration(there.problem, start, k + 1, BORN_PARTS, vary, options)
    follows = "no cycle with it was found next to this one" if more is None else "it goes on with the cycle that has it"
    what = f"{SUCCESSOR_CHANGES} at {{name}} = {{value:.10g}}: {event!r} leads to {name!r} beyond; {follows}"
    point = special_point(
        Monitor(SUCCESSOR_CHANGES, GRAZING.value, what), there, vary, error=0.0 if same else UNLOCATED
    )
    following = cast("AnyOrbit | None", more) or _clear_of_it(last, vary, options)
    return Behind(point, following, leads_elsewhere)


def _clear_of_it(last: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The cycle with other phases to which the first return of a motion leads next to a grazing one, on either side."""
    family = last.problem
    if family.system is None:
        return None
    arc = max(last.arcs, key=lambda arc: arc.duration)  # from its middle, far from where the event grazes
    near_by = replace(options, solver="newton")
    for lam in BESIDE_GRAZING:
        beside = cast(Cycles, family.with_value(vary, family.moved(vary, lam)))
        with suppress(NoOrbit):
            other = cycle_near(beside, arc.mode, middle_of(last, arc), near_by, settled=True)
            if not same_events(last, other) and _alike(last, other):
                return cast(AnyOrbit, other)
    return None


def _alike(one: Orbit, other: Orbit) -> bool:
    """Whether the ranges of all states and the periods are nearly the same."""
    if abs(one.period - other.period) > NEARLY_THE_SAME * one.period:
        return False
    states = len(one.problem.vocabulary(one.cycle.states).states)
    x, y = one.sample()[1][:states], other.sample()[1][:states]
    size = np.ptp(x, axis=1)
    off = np.maximum(np.abs(x.max(axis=1) - y.max(axis=1)), np.abs(x.min(axis=1) - y.min(axis=1)))
    return bool(np.all(off <= NEARLY_THE_SAME * size))
