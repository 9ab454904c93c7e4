"""The cycle with given phases of a user's system, as data: what its system says of each, and what must follow it.

    (mode, event), ..., how it closes     ->      Cycle (hybrid/system.py), equal for equal systems and signatures
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..hybrid.language import System
from ..hybrid.system import Cycle, Feature, Phase, Signature, VectorSystem
from ..motion.phases import Segment
from .closure import Closure, Plane, Section, with_sections
from .recurrence import TRIED, image_of
from .sequences import parts_of

Array = np.ndarray


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
