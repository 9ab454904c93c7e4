"""The cycles of a user's system (hybrid/language.py) at one parameter vector: its side of hybrid/problem.py.

A cycle is given by its phases, in the words of the system, and by how it closes,

    x(start) = S x(end) - c,    S^repeats = 1        (closure.py)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, ClassVar, Self

import numpy as np

from ..checks import choice_of, number
from ..collocation.transcription import Setting, Transcription
from ..hybrid.expressions import check_scalar
from ..hybrid.language import Function, System
from ..hybrid.problem import Kind, Problem
from ..hybrid.system import Cycle, Feature, Signature
from ..hybrid.vector_form import Names
from ..motion.phases import Segment
from .closure import Closure, Section, with_sections
from .observables import scalar_of
from .other_start import rotated, strongest
from .recurrence import image_of
from .restart import Start
from .sequences import Posed, in_parts, nearest_touch, split, unsplit, with_contact, without
from .simulated_phases import marched
from .stated_cycle import cycle_of, mode_after_last
from .system_orbit import SystemOrbit

Array = np.ndarray


class Cycles(Problem):
    """The cycles of a system that close in one way: what is known of them whatever their parameters are called.

    Attributes
    ----------
    system : the system.
    closure : how they close.
    sections : planes at which phases may end besides the events of the system.
    measured : name of a state, or a function (x, p), whose largest magnitude over the cycle is the amplitude.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import Cycles, find_cycle
    >>> problem = find_cycle(belt, "slip", x=0.0, v=0.0).problem
    >>> isinstance(problem, Cycles), problem.measured, problem.closure.repeats
    (True, 'x', 1)
    """

    system: System
    closure: Closure
    sections: tuple[Section, ...]
    measured: str | Function
    watched: ClassVar[bool] = True
    """Whether the exits of a mode are looked for inside its phases: where its condition says it all, they need not."""

    def closing(self, closure: Closure, sections: tuple[Section, ...] = ()) -> Self:
        """The problem of the cycles that close otherwise, or are cut by other planes.

        Parameters
        ----------
        closure, sections
            how they close, and planes at which phases may end.

        Returns
        -------
        The problem.
        """
        return replace(self, closure=closure, sections=sections)  # type: ignore[type-var]

    @property
    def marks(self) -> frozenset[str]:
        """Names of the events of its sections."""
        entries = self.system.names.entries
        return frozenset(way.event.name for section in self.sections for way in section.exits(entries))

    @property
    def forced(self) -> bool:
        """As the system is."""
        return self.system.forcing_period is not None

    def vocabulary(self, states: tuple[str, ...]) -> Names:
        """Those of the system: in a forced one the time is x.t."""
        return self.system.names

    def cycle(self, signature: Signature, repeats: int) -> Cycle:
        """The cycle with these phases.

        Parameters
        ----------
        signature, repeats
            the phases, (mode, event) each; how often they make up the period: that of the closure.

        Returns
        -------
        Cycle.

        Raises
        ------
        ValueError : the system has no such phase, or its cycles close otherwise.
        """
        if repeats != self.closure.repeats:
            raise ValueError(f"{self.title}: no cycle closes {repeats} times, but {self.closure.repeats} times")
        after = mode_after_last(self.system, self.closure, signature, self.vector()) if self.watched else None
        return cycle_of(self.system, self.sections, self.closure, self.amplitude_of(), signature, after)

    def amplitude_of(self) -> int | Feature:
        """What is measured, as a cycle knows it: `Cycle.measured`."""
        return scalar_of(self.measured, self.system.names)

    def next_sequence(self, t: Transcription, u: Array, setting: Setting, phase: int, *, soft: bool) -> Iterator[Start]:
        """Boundaries put in where the root crosses exits; a short phase taken out; the phases of the motion itself.

        Parameters
        ----------
        t, u, setting, phase, soft
            as in `Problem`; the last resort is a part of a mode left unsplit.

        Yields
        ------
        Starting points, most promising first: to follow the motion takes longer than all else, and is not done where a
        point before it serves.
        """
        start, posed = (t, u, setting), self.asked()
        if (more := split(posed, start, phase)) is not None:
            yield more
        yield from (fewer for _, fewer in islice(without(posed, start), 1))
        if soft and (softer := unsplit(posed, start, phase)) is not None:
            yield softer
        yield from marched(posed, start)

    def split(self, t: Transcription, u: Array, setting: Setting, phase: int) -> Start | None:
        """Boundaries put in where a phase passes events: see `sequences.split`.

        Parameters
        ----------
        t, u, setting, phase
            as in `Problem`.

        Returns
        -------
        Starting point; None where it does not come back.
        """
        return split(self.asked(), (t, u, setting), phase)

    def remarch(self, t: Transcription, u: Array, setting: Setting) -> Start | None:
        """The phases that the motion really has.

        Parameters
        ----------
        t, u, setting
            as in `Problem`.

        Returns
        -------
        Starting point; None where the motion does not lead back.
        """
        return next(iter(marched(self.asked(), (t, u, setting))), None)

    def expected(self, t: Transcription, u: Array, setting: Setting) -> Iterator[Start]:
        """The sequence at hand; then without a phase that is about to vanish, and without its image in the other half.

        Unsplit phases are the parts that they mostly are by now.

        Parameters
        ----------
        t, u, setting
            as in `Problem`.

        Yields
        ------
        Starting points, in turn.
        """
        yield (start := in_parts(self.asked(), (t, u, setting)))
        for _ in range(2):
            if (fewer := next(self.vanishing(*start), None)) is None:
                return
            yield (start := fewer[1])

    def vanishing(self, t: Transcription, u: Array, setting: Setting) -> Iterator[tuple[int, Start]]:
        """The phases that may be about to vanish, and the cycle without each.

        Parameters
        ----------
        t, u, setting
            as in `Problem`.

        Yields
        ------
        Number of the phase, and starting point.
        """
        return without(self.asked(), (t, u, setting))

    def strongest(self, t: Transcription, u: Array, setting: Setting) -> int:
        """The phase at whose start an event is crossed the fastest: the last one to become a contact.

        Parameters
        ----------
        t, u, setting
            as in `Problem`.

        Returns
        -------
        Number of the phase.
        """
        return strongest((t, u, setting))

    def starting_at(self, first: int, t: Transcription, u: Array, setting: Setting) -> Start | None:
        """The same cycle from another phase on.

        Parameters
        ----------
        first, t, u, setting
            as in `Problem`.

        Returns
        -------
        Starting point; None where the images of its phases are not known.
        """
        return rotated(self.asked(), (t, u, setting), first)

    def with_contact(self, phase: int, event: str, t: Transcription, u: Array, setting: Setting) -> Start | None:
        """A cycle that grazes an event, as one that meets it with no speed: see `sequences.with_contact`.

        Parameters
        ----------
        phase, event, t, u, setting
            as in `Problem`.

        Returns
        -------
        Starting point; None where it does not.
        """
        return with_contact(self.asked(), (t, u, setting), phase, event)

    def nearest_touch(self, t: Transcription, u: Array, setting: Setting) -> tuple[float, str, str]:
        """How near a cycle comes to an exit that it does not meet: see `sequences.nearest_touch`.

        Parameters
        ----------
        t, u, setting
            as in `Problem`.

        Returns
        -------
        Relative distance, mode and event.
        """
        return nearest_touch(self.asked(), (t, u, setting))

    def asked(self) -> Posed:
        """What sequences.py asks of it."""
        form, closure = with_sections(self.system, self.sections), self.closure

        def cycle(signature: Signature) -> Cycle:
            return self.cycle(signature, closure.repeats)

        def image(segment: Segment, p: Array, scale: Array) -> tuple[str, str] | None:
            return image_of(form, segment, closure, p, scale)

        return Posed(form, closure, cycle, image)


@dataclass(frozen=True)
class Family(Cycles):
    """The cycles of a system that close in one way, at one p.

    Attributes
    ----------
    system : the system.
    values : its parameters, in the order of their names.
    closure : how they close.
    followed : the principal parameter.
    measured : name of a state, or a function (x, p), whose largest magnitude over the cycle is the amplitude.
    sections : planes at which phases may end besides the events of the system.
    span : how far a parameter is moved that is zero in the system, and has no size of its own.
    """

    orbit_type = SystemOrbit

    system: System
    values: tuple[float, ...]
    closure: Closure
    followed: str
    measured: str | Function
    sections: tuple[Section, ...] = ()
    span: float = 1.0

    @property
    def scheme(self) -> tuple[int, Kind]:
        """Gauss, and Radau IIA where a mode is stiff."""
        return (7, "radau") if any(mode.stiff for mode in self.system.modes) else (7, "gauss")

    @property
    def title(self) -> str:
        """The name of the system."""
        return self.system.name

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the system."""
        return self.system.names.parameters

    @property
    def principal(self) -> str:
        """As given."""
        return self.followed

    def vector(self) -> Array:
        """(np,) the values."""
        return np.array(self.values, float)

    def with_value(self, name: str, value: float) -> Family:
        """The same at another p.

        name, value: a parameter of the system, and its value.
        Raises InputError: there is no such parameter, or it is no number.
        """
        at = self.names.index(choice_of("parameter", name, self.names))
        return replace(self, values=(*self.values[:at], number(name, value), *self.values[at + 1 :]))

    def unit(self, name: str, value: float | None = None) -> float:
        """The size of a value, or of the system's own one where that is larger; the `span` where the latter is zero.

        name, value: a parameter of the system; where it stands, default the value here.
        """
        own = abs(self.system.parameters[name]) or self.span
        return max(abs(self.value(name) if value is None else value), own)

    def moved(self, name: str, lam: float, more: float = 0.0) -> float:
        """Value of a parameter along a branch, in steps of its `unit`.

        name, lam, more: a parameter of the system; lambda, in two parts.
        Returns its value there, which may be zero or below.
        """
        return self.value(name) + (lam + more) * self.unit(name)

    def distance(self, name: str, value: float, here: float | None = None) -> float:
        """The lambda that leads from here to a value of a parameter.

        name, value, here: a parameter of the system, the value, and where it stands: default the value here.
        """
        return (value - (self.value(name) if here is None else here)) / self.unit(name, here)

    def over(self, span: float) -> Family:
        """The same with another `span`."""
        return replace(self, span=span)

    def range_of(self, name: str) -> tuple[float, float]:
        """Any number."""
        return -math.inf, math.inf

    def record(self) -> dict[str, Any]:
        """The problem as JSON can say it; `posed` reads it.  Of a measured function only the name can be told."""
        g = self.measured
        measured = {"state": g} if isinstance(g, str) else {"function": str(getattr(g, "__name__", "function"))}
        return {
            "problem": self.title,
            "parameters": dict(zip(self.names, self.values, strict=True)),
            "followed": self.followed,
            "measured": measured,
            "closure": {"matrix": self.closure.matrix, "shift": self.closure.shift, "repeats": self.closure.repeats},
            "sections": [[s.mode, s.state, s.level, s.size] for s in self.sections],
        }


def measured_of(system: System, measure: str | Function | None) -> str | Function:
    """What is measured of a system's cycles, checked.

    measure: name of a state, or a function (x, p); None for the first state that is no angle, whose turns are no size.
    Raises InputError: there is no such state, or the function returns no scalar of the system's.
    """
    if measure is None:
        return next((state for state in system.states if state not in system.angles), system.states[0])
    g = scalar_of(measure, system.names)
    check_scalar("measure", g.function, g.names)
    return measure
