"""What the commands share where they are asked about a loop of parts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ....axis_units import shown
from ....checks import to_and_back
from ....continuation import Branch, Fold, follow
from ....errors import InputError
from ....orbits import Options, SystemOrbit

if TYPE_CHECKING:
    from ....servo.parts import Loop

def title(loop: Loop, called: str = "loop") -> str:
    """What a loop is called in the first line."""
    return f"{called} at gain {loop.value('gain'):.10g} V/rad"


def way_to(fold: Fold[SystemOrbit], loop: Loop) -> str:
    """To which side of a loop's own value a fold lies: "up" or "down"."""
    return "up" if fold.value > loop.value(fold.parameter) else "down"


def parts_line(loop: Loop) -> str:
    """The parts that are there, as a line."""
    return f"  parts            {', '.join(part.name for part in loop.present)}"


def record_of(loop: Loop) -> dict[str, Any]:
    """The loop, for JSON."""
    return {"parts": [part.name for part in loop.present], "parameters": loop.parameters, "gain": loop.value("gain")}


def with_unit(number: str, name: str) -> str:
    """A parameter of a loop with its unit, where that is known."""
    from ....servo.parts.table import unit_of

    return f"{number} {shown().si.label(unit_of(name))}".rstrip()


def named(name: str) -> str:
    """A parameter of a loop, with its unit in brackets where that is known."""
    from ....servo.parts.table import unit_of

    unit = shown().si.label(unit_of(name))
    return f"{name} [{unit}]" if unit else name


def branch_of(
    loop: Loop, vary: str, start: float | None, to: float | None, options: Options,
    progress: Callable[[SystemOrbit], None],
) -> Branch[SystemOrbit]:  # fmt: skip
    """The branch of a loop in one of its parameters: from its own value or `start`, to `to` or far up."""
    from ....servo.parts.verbs import FAR_UP, check_present, loop_cycle

    if start is not None:
        loop = loop.replace(**{vary: start})
    check_present(loop, vary)
    here = loop.value(vary)
    if to is None and here <= 0:
        raise InputError(f"to: must be given, {vary} = {here:g} at the start cannot be multiplied")
    to, _ = to_and_back(vary, here, FAR_UP * here if to is None else to, None)
    return follow(loop_cycle(loop, vary, options=options), vary, to=to, options=options, progress=progress)
