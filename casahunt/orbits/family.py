"""The cycles of a user's system (hybrid/language.py) at one parameter vector: its side of hybrid/problem.py.

A cycle is given by its phases, in the words of the system, and by how it closes,

    x(start) = S x(end) - c,    S^repeats = 1        (closure.py)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import known, number
from ..collocation.transcription import Setting, Transcription
from ..hybrid.language import System
from ..hybrid.problem import Kind, Problem
from ..hybrid.system import Cycle, Phase, Signature
from ..hybrid.vector_form import Names
from ..motion.march import MarchFailure, march
from . import archive
from .closure import Closure, Section, with_sections
from .restart import Start, from_segments, in_scale
from .system_orbit import SystemOrbit

Array = np.ndarray

RESTART_TOLERANCE = 1e-6
RESTART_PERIODS = 2.5
"""A motion is followed for so many of its supposed periods."""
CLOSES, RESTARTS = 0.3, 2
"""How near to its start it must come back, in units of the state scale; so many of the ways are tried."""


@dataclass(frozen=True)
class Family(Problem):
    """The cycles of a system that close in one way, at one p.

    Attributes
    ----------
    system : the system.
    values : its parameters, in the order of their names.
    closure : how they close.
    followed : the principal parameter.
    measured : the state whose largest magnitude at the ends of phases is the amplitude.
    sections : planes at which phases may end besides the events of the system.
    """

    orbit_type = SystemOrbit

    system: System
    values: tuple[float, ...]
    closure: Closure
    followed: str
    measured: str
    sections: tuple[Section, ...] = ()

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

        Parameters
        ----------
        name, value
            a parameter of the system, and its value.

        Returns
        -------
        Family.

        Raises
        ------
        InputError : there is no such parameter, or it is no number.
        """
        at = self.names.index(known("parameter", name, self.names))
        return replace(self, values=(*self.values[:at], number(name, value), *self.values[at + 1 :]))

    def vocabulary(self, states: tuple[str, ...]) -> Names:
        """Those of the system: in a forced one the time is x.t."""
        return self.system.names

    def unit(self, name: str, value: float | None = None) -> float:
        """The size of a value, or of the system's own one where that is larger; 1 where both are zero.

        Parameters
        ----------
        name, value
            a parameter of the system; where it stands, default the value here.

        Returns
        -------
        The unit of lambda.
        """
        return max(abs(self.value(name) if value is None else value), abs(self.system.parameters[name])) or 1.0

    def moved(self, name: str, lam: float, more: float = 0.0) -> float:
        """Value of a parameter along a branch, in steps of its `unit`.

        Parameters
        ----------
        name, lam, more
            a parameter of the system; lambda, in two parts.

        Returns
        -------
        Its value there, which may be zero or below.
        """
        return self.value(name) + (lam + more) * self.unit(name)

    def distance(self, name: str, value: float, here: float | None = None) -> float:
        """The lambda that leads from here to a value of a parameter.

        Parameters
        ----------
        name, value, here
            a parameter of the system, the value, and where it stands: default the value here.

        Returns
        -------
        lambda.
        """
        return (value - (self.value(name) if here is None else here)) / self.unit(name, here)

    def range_of(self, name: str) -> tuple[float, float]:
        """Any number."""
        return -math.inf, math.inf

    def cycle(self, signature: Signature, repeats: int) -> Cycle:
        """The cycle with these phases.

        Parameters
        ----------
        signature
            the phases, (mode, event) each.
        repeats
            how often they make up the period: that of the closure.

        Returns
        -------
        Cycle.

        Raises
        ------
        ValueError : the system has no such phase, or its cycles close otherwise.
        """
        if repeats != self.closure.repeats:
            raise ValueError(f"a cycle of {self.title} closes {self.closure.repeats} times, not {repeats}")
        return _cycle(self.system, self.sections, self.closure, self.measured, signature)

    def next_sequence(self, t: Transcription, u: Array, setting: Setting, phase: int, *, soft: bool) -> list[Start]:
        """The phases that the motion from the start of u really has, where they lead back to it.

        Parameters
        ----------
        t, u, setting
            a root of the equations that is no motion.
        phase, soft
            number of the phase that is none; whether last resorts are allowed: there are no others.

        Returns
        -------
        Starting points, the ones that close best first.
        """
        return motions_from(self, t, u, setting)

    def record(self) -> dict[str, Any]:
        """The problem as JSON can say it; `posed` reads it."""
        return {
            "problem": self.title,
            "parameters": dict(zip(self.names, self.values, strict=True)),
            "followed": self.followed,
            "measured": self.measured,
            "closure": {"matrix": self.closure.matrix, "shift": self.closure.shift, "repeats": self.closure.repeats},
            "sections": [[s.mode, s.state, s.level, s.size] for s in self.sections],
        }


def posed(system: System, record: Mapping[str, Any]) -> Family:
    """The family of a system that a `Family.record` describes.

    Parameters
    ----------
    system
        the system.
    record
        what `Family.record` gave.

    Returns
    -------
    Family.

    Raises
    ------
    KeyError, ValueError : it is of another system.
    """
    if record["problem"] != system.name or list(record["parameters"]) != list(system.parameters):
        raise ValueError(f"it is an orbit of {record['problem']!r}, not of {system.name!r}")
    c = record["closure"]
    closure = Closure.of(np.array(c["matrix"], float), np.array(c["shift"], float), int(c["repeats"]))
    sections = tuple(Section(mode, state, float(level), float(size)) for mode, state, level, size in record["sections"])
    values = tuple(float(v) for v in record["parameters"].values())
    return Family(system, values, closure, record["followed"], record["measured"], sections)


def load_orbit(path: str | Path, system: System) -> SystemOrbit:
    """Read a cycle of a system that `SystemOrbit.save` has written.

    Parameters
    ----------
    path
        the file (npz).
    system
        the system: functions are not kept in files.

    Returns
    -------
    SystemOrbit.

    Raises
    ------
    InputError : it is none of this system, or damaged; says what is wrong.
    """
    loaded: SystemOrbit = archive.load_orbit(path, lambda record: posed(system, record))
    return loaded


def motions_from(family: Family, t: Transcription, u: Array, setting: Setting) -> list[Start]:
    """The motion from the start of u, cut where it comes back to its start, as starting points.

    Parameters
    ----------
    family, t, u, setting
        the problem, and unknowns that are no motion of its.

    Returns
    -------
    Starting points in the units of `setting`, the ones that close best first.
    """
    form = with_sections(family.system, family.sections)
    x, span = t.nodes_of(u)[0] * setting.scale, float(np.sum(np.abs(t.durations_of(u))))
    try:
        segments = march(
            form, t.cycle.phases[0].mode.name, x, setting.p, scale=setting.scale, until=lambda segment: False,
            tol=RESTART_TOLERANCE, degree=t.degree, kind=t.kind, max_time=RESTART_PERIODS * span,
        )  # fmt: skip
    except MarchFailure:
        return []
    S, shift = np.array(family.closure.matrix), np.array(family.closure.shift)
    found = []
    for m, segment in enumerate(segments, start=1):
        distance = float(np.max(np.abs(S @ segment.behind - shift - x) / setting.scale))
        if segment.event and distance < CLOSES:
            found.append((distance, m))
    starts = []
    for _, m in sorted(found)[:RESTARTS]:
        cycle = family.cycle(tuple((s.mode, s.event) for s in segments[:m]), family.closure.repeats)
        passes = [(1.0, s) for s in segments[:m]]
        fresh = from_segments(cycle, passes, setting.p, setting.dp, degree=t.degree, kind=t.kind)
        starts.append(in_scale(fresh, setting.scale))
    return starts


@lru_cache(maxsize=256)
def _cycle(
    system: System, sections: tuple[Section, ...], closure: Closure, measured: str, signature: Signature
) -> Cycle:
    form = with_sections(system, sections)
    phases = []
    for mode, event in signature:
        way_out = next((e for e in form.exits.get(mode, ()) if e.event.name == event), None)
        if way_out is None:
            raise ValueError(f"{system.name} has no mode {mode!r} that ends with {event!r}")
        phases.append(Phase(form.modes[mode], way_out.event, way_out.reset, way_out.direction))
    shift = closure.shift if any(closure.shift) else ()
    return Cycle(
        system.name, form.states, system.names.parameters, tuple(phases),
        np.array(closure.matrix), closure.repeats, form.states.index(measured), shift,
    )  # fmt: skip
