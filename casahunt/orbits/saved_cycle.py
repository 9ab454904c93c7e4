"""Cycles of a user's system in files: what a file cannot hold, functions, its reader hands in again.

    file = (numbers of the orbit, record of its family)  +  system [, measure]  ->  orbit

What is handed in is held against what the file says: name, parameters, and the amplitude of what is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..hybrid.language import Function, System
from .amplitude import amplitude_off
from .archive import Archive
from .closure import Closure, Section
from .family import Family
from .orbit import unknowns_of
from .system_orbit import SystemOrbit

OTHER_MEASURE, SAME_MEASURE = 10.0, 1e-9
"""An amplitude off by more than this part of its error, and more than this, is that of another function."""


def posed(system: System, record: Mapping[str, Any], measure: str | Function | None = None) -> Family:
    """The family of a system that a `Family.record` describes.

    record: what `Family.record` gave; measure: what its amplitude is, where that is a function: no record holds one.
    Raises KeyError, ValueError: it is of another system.
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
