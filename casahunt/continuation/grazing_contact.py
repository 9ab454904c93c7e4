"""Cycles that contact an event: what vanishes there, and a family in which they have neighbours on both sides.

    inside   the scalar h of an event has a largest value (for one that rises; else smallest) of zero inside a phase
    end      a phase ends with h = 0 and dh/dt = 0: its event is met with no speed
    corner   a phase ends where another event of its mode has h = 0: both are met at once

On one side of a grazing the cycle with the same phases is no motion of the system, on the other side the roots of its
equations go on all the same.  `Loose` is the family of these roots: it asks nothing of one phase.  A cycle that grazes
is judged by the rules of the system again, and no event may be passed on it without notice.

A phase that vanishes at a grazing has no neighbours in its duration, which cannot be negative.  The cycle without it is
sought where its motion would lead if the event before it did nothing; it grazes that event inside a phase.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, ClassVar, cast

import numpy as np

from ..collocation.admissibility import check_admissible
from ..collocation.joints import event_rate
from ..collocation.resolution import RESOLUTION
from ..collocation.transcription import Transcription, transcribe
from ..errors import InputError, NoOrbit, Status
from ..hybrid.language import System
from ..hybrid.system import Cycle, Exit, Signature, VectorEvent
from ..orbits.adapt import Options
from ..orbits.cycle_search import find_cycle
from ..orbits.event_passage import passed, turning_values
from ..orbits.family import Cycles
from ..orbits.marched_mesh import cleared
from ..orbits.orbit import AnyOrbit, Arc, Orbit, unknowns_of
from ..orbits.sequences import Posed
from ..roots import secant
from .curve import CurvePoint, parameter_value, solved_at
from .special_points import GRAZING, Monitor

Array = np.ndarray

CONTACT = 1e-6
"""How far the scalar of an event, or the condition of a mode, may be beyond zero where a cycle grazes it."""
CONTACT_RANGE = 0.05
"""Scalars of events that are no nearer to zero than this are not grazed by a cycle next to it."""
BESIDE_CONTACT, CONTACT_ROUNDS = 1e-6, 12
"""How far from a cycle, in lambda, the next one is looked at for where it grazes; steps of that search."""
NEAR_CONTACT = 1e-3
"""An exit that a cycle comes this near, in units of the way that it goes off it, is grazed where no step leads on:
between the nodes a solution shows no more.  And it is grazed within this, in lambda."""
ROUNDING_OF_A_MIDDLE = 1e-12
"""Part of its size to which a state in the middle of a phase is rounding."""
VANISHING_SHARE = 1e-3
"""A phase that takes less of the period than this has vanished."""


class Loose(Cycles):
    """The cycles of a problem, and the roots of their equations that are none because of what one phase does.

    Attributes
    ----------
    kind : the class of the problem, of which `loosened` makes one of these.
    loose : number of the phase of which nothing is asked.
    """

    kind: ClassVar[Any]
    loose: int

    def cycle(self, signature: Signature, repeats: int) -> Cycle:
        """The cycle with these phases.

        signature, repeats: as in `Problem`. Raises ValueError: the system has no such phase.
        """
        return self.asking(super().cycle(signature, repeats), None)

    def asking(self, cycle: Cycle, slack: float | None) -> Cycle:
        """A cycle of the system with less asked of the loose phase.

        slack: how far its condition may fall below zero; None for anywhere.
        """
        if slack is None:
            cycle = replace(cycle, phases=tuple(replace(phase, exits=()) for phase in cycle.phases))
        phase = cycle.phases[self.loose]
        mode = replace(phase.mode, admissible=None) if slack is None else replace(phase.mode, slack=slack)
        phase = replace(phase, mode=mode, direction=0, exits=())
        return replace(cycle, phases=(*cycle.phases[: self.loose], phase, *cycle.phases[self.loose + 1 :]))

    @property
    def strict(self) -> Cycles:
        """The problem of the system."""
        strict: Cycles = self.kind(**{each.name: getattr(self, each.name) for each in fields(self.kind)})
        return strict

    def asked(self) -> Posed:
        """With no other sequence: the phases are those of the cycle that grazes."""
        return replace(super().asked(), alone=True)


@lru_cache(maxsize=16)
def _loose(kind: type[Cycles]) -> Any:
    """The class of loose problems of a kind: its fields, and one more."""
    own = {"__annotations__": {"loose": "int"}, "loose": 0, "kind": kind, "__module__": __name__}
    return dataclass(frozen=True)(type("Loose", (Loose, kind), own))


@dataclass(frozen=True)
class Contact:
    """Where a cycle grazes an event.

    Attributes
    ----------
    phase, event, direction : number of the phase, name of the event, +1 where it rises through zero.
    at_end : whether it is grazed at the end of the phase, which is then met with no speed; else inside.
    corner : whether it is met at the end of the phase, at once with the event that ends it.
    piece : number of the computed piece in the period, where that is made up of several.
    """

    phase: int
    event: str
    direction: int
    at_end: bool
    piece: int = 0
    corner: bool = False

    @property
    def monitor(self) -> Monitor:
        """Vanishes where the cycle grazes."""
        return Monitor(GRAZING.kind, self._value, "grazing at {name} = {value:.10g}: " + f"{self.event!r} is grazed")

    def _value(self, orbit: Orbit, point: CurvePoint | None) -> float:
        return contact_value(self, orbit)

    def loosened(self, orbit: Any) -> Any:
        """The orbit as one of the loose family."""
        family = orbit.problem
        own = {each.name: getattr(family, each.name) for each in fields(family)}
        return replace(orbit, problem=_loose(cast(Any, type(family)))(**own, loose=self.phase))

    def reported(self, orbit: Any) -> Any:
        """An orbit of the loose family that grazes, as one of the system; a sentence where it is none."""
        family = cast(Loose, orbit.problem)
        t, u, setting = unknowns_of(orbit)
        if violated := self._violated(orbit):
            return f"beyond, the cycle that grazes {self.event!r} is no motion of the system: {violated}"
        for k, way_out in _exits(family, orbit):
            for piece in range(orbit.repeats):
                if passed(t, u, setting, _scalar(way_out.event), k, way_out.direction, slack=CONTACT, piece=piece):
                    return f"beyond, phase {k + 1} passes {way_out.event.name!r}: another event is grazed"
        return replace(orbit, problem=family.strict)

    def _violated(self, orbit: Any) -> str:
        """What a grazing orbit of the loose family violates, or "".

        Nothing has asked for a mesh that shows the condition of the loose phase: where this one does not, its
        polynomials are looked at in parts, and accepted to what they are known to.
        """
        family = cast(Loose, orbit.problem)
        t, u, setting = unknowns_of(orbit)

        def asked(slack: float) -> Transcription:
            cycle = family.asking(family.strict.cycle(orbit.signature, orbit.repeats), slack)
            return transcribe(cycle, t.counts, t.degree, t.kind)

        verdict = check_admissible(asked(CONTACT), u, setting)
        if not verdict.violated and verdict.unclear.any():
            w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)[verdict.unclear]
            known = RESOLUTION * float(np.max(np.abs(t.scheme.last_mode @ w)))
            verdict = check_admissible(*cleared((asked(CONTACT + known), u, setting)))
        return verdict.violated


@dataclass(frozen=True)
class _Still:
    """h(x; p) of an event of a user's system, as `extrema` wants it."""

    function: Callable[[Any, Any, Any], Any]

    def __call__(self, x: Any, p: Any) -> Any:
        return self.function(x, 0.0, p)


def _scalar(event: VectorEvent) -> _Still:
    return _Still(event.function)


def _exits(family: Cycles, orbit: Orbit) -> Iterator[tuple[int, Exit]]:
    """(number of the phase, exit of its mode) of all phases, but for sections."""
    for k, arc in enumerate(orbit.arcs):
        for way_out in family.system.vector_form.exits.get(arc.mode, ()):
            yield k, way_out


def events_of(orbit: Orbit) -> list[str]:
    """Names of the events that a cycle of a system may graze; one that several phases may graze is there for each."""
    return [way_out.event.name for _, way_out in _exits(cast(Cycles, orbit.problem), orbit)]


def contact_value(contact: Contact, orbit: Orbit) -> float:
    """What vanishes where an orbit grazes.

    contact, orbit: where it may graze, and the orbit.
    Returns the scalar where it turns inside the phase, counted along its direction, nearest to being passed; or its
    rate at the end, times the period; or, at a corner, the scalar there.  NaN where it does not turn inside.
    """
    t, u, setting = unknowns_of(orbit)
    phase = t.cycle.phases[contact.phase]
    x = t.nodes_of(u)[t.phase_end[contact.phase]] * setting.scale
    if contact.at_end:
        return contact.direction * event_rate(phase, x, orbit.arcs[contact.phase].duration, setting.p)[0] * orbit.period
    exits = cast(Cycles, orbit.problem).system.vector_form.exits[phase.mode.name]
    event = next(e.event for e in exits if e.event.name == contact.event)
    if contact.corner:
        return contact.direction * float(event.function(x, 0.0, setting.p))
    turning = turning_values(t, u, setting, _scalar(event), contact.phase, contact.direction, piece=contact.piece)
    return max((contact.direction * g for g in turning), default=float("nan"))


def contacts(orbit: Orbit, event: str | None = None) -> list[tuple[float, Contact]]:
    """Where a cycle of a user's system may graze an event, the nearest first.

    event: name of the event; default any. Returns (how far it is from grazing, the place) each.
    """
    family = cast(Cycles, orbit.problem)
    found = []
    for k, way_out in _exits(family, orbit):
        name = way_out.event.name
        if event is not None and name != event:
            continue
        ways = [(False, piece) for piece in range(orbit.repeats)]
        for at_end, piece in [*ways, (True, 0)] if name == orbit.arcs[k].event else ways:
            contact = Contact(k, name, way_out.direction, at_end, piece)
            value = abs(contact_value(contact, orbit))
            if np.isfinite(value):
                found.append((value, contact))
    return sorted(found, key=lambda pair: pair[0])


def grazing_at(last: AnyOrbit, event: str, vary: str, options: Options) -> tuple[Contact, AnyOrbit] | None:
    """The cycle next to one that grazes an event inside a phase, and where.

    last, event, vary, options: the cycle, names of the event and of the parameter, tolerance and method.
    Returns (place, orbit); None where it is none of the system's.
    """
    for _, place in contacts(last, event):
        if place.at_end or place.piece:
            continue
        found = _grazing(place.loosened(last), place, vary, options)
        if not isinstance(found, str):
            return place, found
    return None


def corner_at(last: AnyOrbit, vary: str, options: Options) -> tuple[Contact, AnyOrbit] | None:
    """The cycle next to one at which a phase meets two events of its mode at once, and where.

    last, vary, options: the cycle, the name of the parameter, tolerance and method.
    Returns (place, orbit); None where it is none of the system's.
    """
    corners = (
        Contact(k, way_out.event.name, way_out.direction, at_end=False, corner=True)
        for k, way_out in _exits(cast(Cycles, last.problem), last)
        if way_out.event.name != last.arcs[k].event
    )
    for place in sorted(corners, key=lambda place: abs(contact_value(place, last))):
        if abs(contact_value(place, last)) <= NEAR_CONTACT:
            found = _grazing(place.loosened(last), place, vary, options)
            if not isinstance(found, str):
                return place, found
    return None


def _grazing(loose: AnyOrbit, place: Contact, vary: str, options: Options) -> AnyOrbit | str:
    """The cycle of the loose family next to one that grazes, as one of the system's; a sentence where it is none."""
    start, seen = unknowns_of(loose), []

    def beyond(lam: float) -> float:
        problem = loose.problem.with_value(vary, loose.problem.moved(vary, float(lam)))
        orbit = solved_at(problem, start, options) if abs(lam) <= NEAR_CONTACT else None
        if orbit is None:
            return math.nan
        seen.append(orbit)
        return contact_value(place, orbit)

    _, left = secant(beyond, 0.0, BESIDE_CONTACT, tolerance=place.monitor.tolerance, rounds=CONTACT_ROUNDS)
    reached = abs(left) <= place.monitor.tolerance
    return cast(AnyOrbit | str, place.reported(seen[-1])) if reached else "no cycle next to it grazes the event"


def contact_of(orbit: AnyOrbit, vary: str, options: Options) -> tuple[Contact, AnyOrbit]:
    """Where a cycle next to a grazing grazes, and the cycle of the loose family to go on with.

    vary, options: the parameter of the branch; tolerance and method.
    Returns contact, and the orbit; another one where a phase has vanished: that which keeps clear of the event before
    it. Raises InputError: it is no cycle of a user's system; NoOrbit: it grazes nothing.
    """
    if orbit.problem.system is None:
        raise InputError(f"a grazing of {orbit.problem.title}: only cycles of a user's system are followed along it")
    shares = [arc.duration * orbit.repeats / orbit.period for arc in orbit.arcs]
    if min(shares) < VANISHING_SHARE and len(orbit.arcs) > 1:
        orbit = _without(orbit, int(np.argmin(shares)), options)
    near = [contact for distance, contact in contacts(orbit) if distance <= CONTACT_RANGE]
    if not near:
        at = f"{vary} = {parameter_value(orbit, vary):.8g}"
        raise NoOrbit(f"the cycle of {orbit.problem.title} at {at} grazes no event", Status.NOT_FOUND)
    return near[0], near[0].loosened(orbit)


def _without(orbit: AnyOrbit, vanishing: int, options: Options) -> AnyOrbit:
    """The cycle next to one with a phase that has vanished, without it: where the event before it did nothing."""
    family = cast(Cycles, orbit.problem)
    before = orbit.arcs[vanishing - 1]
    modes = tuple(
        replace(mode, holds=None, ends=tuple(e for e in mode.ends if e.name != before.event))
        if mode.name == before.mode else mode
        for mode in family.system.modes
    )  # fmt: skip
    sentence = f"phase {vanishing + 1} ({orbit.arcs[vanishing].mode}) vanishes, and no cycle was found without it"
    with suppress(InputError, NoOrbit):
        system = replace(family.system, modes=modes)
        near = cycle_near(family, before.mode, middle_of(orbit, before), options, system=system, settled=True)
        return cast(AnyOrbit, near)
    raise NoOrbit(f"{sentence}; `grazing` takes one that keeps clear of {before.event!r}", Status.NOT_FOUND)


def middle_of(orbit: Orbit, arc: Arc) -> Array:
    """(n,) a state in the middle of a phase of a cycle, off the events at its ends; nothing where rounding left
    something, which a motion would take for the size of that state."""
    states = arc.states.reshape(-1, arc.end.size)
    x = states[len(states) // 2]
    return np.where(np.abs(x) > ROUNDING_OF_A_MIDDLE * orbit.scale, x, 0.0)


def cycle_near(
    problem: Cycles, mode: str, x: Array, options: Options, *, system: System | None = None, settled: bool = False
) -> Orbit:
    """The cycle of a problem on which the motion from a state settles, or (`settled`) next to which it lies.

    mode, x: of the state (n,); system: whose motion is followed instead of the problem's own.
    Raises NoOrbit: as `find_cycle`.
    """
    names, p = problem.system.names, problem.vector()
    found = find_cycle(
        system or problem.system, mode, parameters=dict(zip(names.parameters, p.tolist(), strict=True)),
        follow=names.parameters[problem.names.index(problem.principal)] if problem.names else None,
        measure=problem.measured, options=options, start=names.numbers(x, p), settled=settled,
    )  # fmt: skip
    how = cast(Cycles, found.problem)
    own = problem.closing(how.closure, how.sections)
    return (problem.orbit_type or Orbit)(**{e.name: getattr(found, e.name) for e in fields(Orbit)} | {"problem": own})
