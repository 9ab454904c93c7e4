"""A system as its user writes it (language.py) in the terms of the engine (system.py): functions of vectors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..compiled import kept
from . import system as engine
from .vector_form import Always, Bound, Field, FieldOfFlow, Flow, Names, Reset, Scalar, Successor


@kept(maxsize=64)
def vector_form_of(system: Any) -> engine.VectorSystem:
    """The system in the terms of the engine."""
    modes = {mode.name: _engine_mode(mode, system.names) for mode in system.modes}
    exits = {mode.name: tuple(_exits(mode, system)) for mode in system.modes}
    return engine.VectorSystem(system.name, system.names.entries, modes, exits)


def _engine_mode(mode: Any, names: Names) -> engine.VectorMode:
    signed, sign = mode.sign is not None, mode.sign or 0.0
    if mode.field is not None:
        vector_field = Field(mode.field, names, signed)
    else:
        assert mode.flow is not None
        vector_field = FieldOfFlow(mode.flow, names, signed)
    return engine.VectorMode(
        mode.name,
        vector_field,
        sign,
        flow=None if mode.flow is None else Flow(mode.flow, names, signed, sign),
        admissible=None if mode.holds is None else Scalar(mode.holds, names, signed),
        slack=mode.slack,
        smooth=mode.smooth,
        stiff=mode.stiff,
        feature=None if mode.feature is None else Bound(Scalar(mode.feature, names, signed), sign),
        unsplit=mode.unsplit or "",
    )


def _boundary(event: Any, mode: Any, names: Names) -> engine.VectorEvent:
    scalar = Scalar(event.function, names, mode.sign is not None)
    return engine.VectorEvent(event.name, Bound(scalar, mode.sign or 0.0))


def _exits(mode: Any, system: Any) -> Iterator[engine.Exit]:
    """The ways out of a mode; two for an event that is crossed either way."""
    names, signed, sign = system.names, mode.sign is not None, mode.sign or 0.0
    known_modes = tuple(m.name for m in system.modes)
    for event in mode.ends:
        what = f"event {event.name!r} of mode {mode.name!r}"
        boundary = _boundary(event, mode, names)
        asked = mode.holds is None and event.reset is None and not isinstance(event.to, str)
        others = tuple(
            (_engine_mode(m, names), tuple((_boundary(e, m, names), e.direction) for e in m.ends))
            for m in system.modes if asked and m is not mode
        )  # fmt: skip
        next_mode = (
            Always(event.to) if isinstance(event.to, str) else Successor(event.to, names, what, known_modes, mode.sign)
        )
        mark = event.to == mode.name or event.reset is not None
        reset = None if event.reset is None else Reset(event.reset, names, signed, sign)
        for direction in (event.direction,) if event.direction else (+1, -1):
            yield engine.Exit(boundary, direction, next_mode, mark, reset, others)
