"""The cycles of a user's system (hybrid/language.py) at one parameter vector: its side of hybrid/problem.py.

A cycle is given by its phases, in the words of the system, and by how it closes,

    x(start) = S x(end) - c,    S^repeats = 1        (closure.py)

The cycle with given phases of a user's system, as data: what its system says of each, and what must follow it.

(mode, event), ..., how it closes     ->      Cycle (hybrid/system.py), equal for equal systems and signatures

Cycles of a user's system in files: what a file cannot hold, functions, its reader hands in again.

    file = (numbers of the orbit, record of its family)  +  system [, measure]  ->  orbit

What is handed in is held against what the file says: name, parameters, and the amplitude of what is measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from ..checks import choice_of, number
from ..errors import InputError
from ..hybrid.expressions import check_scalar
from ..hybrid.language import Function, System
from ..hybrid.problem import Kind, Problem
from ..hybrid.system import Cycle, Feature, Phase, Signature, VectorSystem
from ..hybrid.vector_form import Names
from ..motion.phases import Segment
from .amplitude import amplitude_off
from .archive import Archive
from .closure import Closure, Plane, Section, with_sections
from .observables import scalar_of
from .orbit import unknowns_of
from .recurrence import TRIED, image_of
from .sequences import Posed, parts_of
from .system_orbit import SystemOrbit


def mode_after_last(system: System, closure: Closure, signature: Signature, p: Array) -> str:
    """The mode that follows the last phase: the first, or what that is one computed piece later; "" if not known."""
    if np.array_equal(closure.matrix, np.eye(len(closure.matrix))):
        return signature[0][0]
    return _image(system, closure, p.tobytes(), signature[0][0])


@lru_cache(maxsize=256)
def _image(system: System, closure: Closure, p: bytes, mode: str) -> str:
    """The image of a mode one computed piece later, however it ends, at parameters p as bytes; "" where it has none."""
    form, n = system.vector_form, len(system.names.entries)
    states = np.random.default_rng(0).standard_normal((TRIED, n))
    for way_out in form.exits[mode]:
        jumped = None if way_out.reset is None else states[0]
        segment = Segment(mode, way_out.event.name, 1.0, np.array([0.0, 1.0]), states, states[0], jumped)
        if (image := image_of(form, segment, closure, np.frombuffer(p), np.ones(n))) is not None:
            return image[0]
    return ""


@lru_cache(maxsize=256)
def cycle_of(
    system: System, sections: tuple[Section, ...], closure: Closure, measured: int | Feature, signature: Signature,
    after: str | None,
) -> Cycle:  # fmt: skip
    """The cycle with these phases.

    measured: as of a `Cycle`; after: the mode behind its last phase, "" where that is not known; None where conditions
    say all, and neither ways out nor successors are looked at.
    Raises ValueError: the system has no such phase.
    """
    form = with_sections(system, sections)
    phases = []
    for (mode, event), (follower, _) in zip(signature, (*signature[1:], (after, "")), strict=True):
        ways_out = form.ways_out(mode, event) or tuple(
            way for part in parts_of(form, mode) for way in form.ways_out(part.name, event)
        )
        if not ways_out:
            raise ValueError(f"{system.name}: no cycle with the phases {signature}: no {mode!r} ends with {event!r}")
        way_out, direction = ways_out[0], sum(e.direction for e in ways_out)  # 0 for either way
        exits = tuple(e for e in form.exits[mode] if not isinstance(e.event.function, Plane))
        watch = () if after is None else (direction, exits, _read_as(form, follower or ""))
        phases.append(Phase(form.modes[mode], way_out.event, way_out.reset, *watch))
    shift = closure.shift if any(closure.shift) else ()
    return Cycle(
        system.name, form.states, system.names.parameters, tuple(phases),
        np.array(closure.matrix), closure.repeats, measured, shift,
    )  # fmt: skip


def _read_as(form: VectorSystem, mode: str) -> tuple[str, ...]:
    """The mode, and what it is a part of, and the other parts of that: between them the field has but a kink."""
    if not mode:
        return ()
    whole = form.modes[mode].unsplit or mode
    return tuple(name for name, other in form.modes.items() if (other.unsplit or name) == whole)


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

    def asked(self) -> Posed:
        """What sequences.py must know of it."""
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


OTHER_MEASURE, SAME_MEASURE = 10.0, 1e-9
"""An amplitude off by more than this part of its error, and more than this, is that of another function."""


def posed(system: System, record: Mapping[str, Any], measure: str | Function | None = None) -> Family:
    """The family of a system that a `Family.record` describes.

    Parameters
    ----------
    system, record
        the system, and what `Problem.record` gave.
    measure
        what its amplitude is, where that is a function: no record holds one.

    Returns
    -------
    The problem.

    Raises
    ------
    KeyError, ValueError : it is of another system.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle, posed
    >>> problem = find_cycle(belt, "slip", x=0.0, v=0.0).problem
    >>> posed(belt, problem.record()).value("belt")
    0.2
    """
    if record["problem"] != system.name or list(record["parameters"]) != list(system.parameters):
        raise ValueError(f"it is an orbit of {record['problem']!r}, not of {system.name!r}")
    c = record["closure"]
    closure = Closure.of(np.array(c["matrix"], float), np.array(c["shift"], float), int(c["repeats"]))
    sections = tuple(Section(mode, state, float(level), float(size)) for mode, state, level, size in record["sections"])
    values = tuple(float(v) for v in record["parameters"].values())
    measured = record["measured"].get("state", measure)
    if measured is None:
        raise ValueError("a function is measured, which no record holds")
    return Family(system, values, closure, record["followed"], measured, sections)


def load_orbit(path: str | Path, system: System, *, measure: str | Function | None = None) -> SystemOrbit:
    """Read a cycle of a system that `SystemOrbit.save` has written.

    Parameters
    ----------
    path
        the file (npz).
    system
        the system: functions are not kept in files.
    measure
        the function that was measured (`find_cycle`), for the same reason; not needed where it was a state.

    Returns
    -------
    SystemOrbit.

    Raises
    ------
    InputError : it is none of this system or measure, or damaged; says what is wrong.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle, load_orbit
    >>> orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     orbit.save(Path(folder, "orbit.npz"))
    ...     load_orbit(Path(folder, "orbit.npz"), belt).period == orbit.period
    True
    """
    archive = Archive(path, "orbit")
    measured = archive.checked(lambda: dict(archive.metadata["orbit"]["measured"]))
    if "state" in measured and measure not in (None, measured["state"]):
        raise InputError(f"{str(path)!r}: its amplitude is that of the state {measured['state']!r}; leave out measure=")
    if "state" not in measured and not callable(measure):
        raise InputError(
            f"{str(path)!r}: its amplitude is that of a function, {measured.get('function')!r}, which no file holds: "
            "give it as measure="
        )
    loaded: SystemOrbit = archive.checked(
        lambda: archive.orbit(archive.metadata["orbit"], lambda record: posed(system, record, measure))
    )
    off = amplitude_off(*unknowns_of(loaded), loaded.amplitude)
    if not off <= max(OTHER_MEASURE * loaded.amplitude_error, SAME_MEASURE):
        raise InputError(
            f"{str(path)!r}: its amplitude is {loaded.amplitude:.10g}, which is not the largest magnitude of "
            f"{'this function' if callable(measure) else measured['state']} over the cycle; it differs by {off:.2g}"
        )
    return loaded
