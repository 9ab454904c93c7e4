"""What the commands share where they are asked about a loop of parts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ....checks import choice_of
from ....continuation import Fold, largest, smallest
from ....errors import NoOrbit, Status
from ....orbits import Options, SystemOrbit
from ....servo.units import PARAMETER_UNITS

if TYPE_CHECKING:
    from ....servo.parts import Loop

BRANCHES_OF_A_LOOP = ("stable", "unstable")


def title(loop: Loop) -> str:
    """What a loop is called in the first line."""
    return f"loop at gain {loop.value('gain'):.10g} V/rad"


def parts_line(loop: Loop) -> str:
    """The parts that are there, as a line."""
    return f"  parts            {', '.join(part.name for part in loop.present)}"


def record_of(loop: Loop) -> dict[str, Any]:
    """The loop, for JSON."""
    return {"parts": [part.name for part in loop.present], "parameters": loop.parameters, "gain": loop.value("gain")}


def cycle_on(loop: Loop, branch: str, options: Options) -> SystemOrbit:
    """The cycle on one of its branches in the gain.  Raises InputError: unknown branch; NoOrbit."""
    from ....servo.parts import loop_cycle, unstable_cycle  # not read for a servo

    choice_of("branch of a loop", branch, BRANCHES_OF_A_LOOP)
    cycle = loop_cycle(loop, options=options)
    return cycle if branch == "stable" else unstable_cycle(cycle, options=options)


def border_of(loop: Loop, vary: str, options: Options) -> tuple[Fold[SystemOrbit], str]:
    """Where hunting ends in a parameter, at a fold above the loop's own value or else below; "up" or "down".

    Raises NoOrbit: the loop does not hunt as it is, its branch turns nowhere, or the fold is not computed.
    """
    from ....servo.parts import loop_cycle

    cycle = loop_cycle(loop, vary, options=options)
    try:
        return largest(cycle, vary, options=options), "up"
    except NoOrbit as above:
        if above.status is not Status.NOT_FOUND:
            raise
        try:
            return smallest(cycle, vary, options=options), "down"
        except NoOrbit as below:
            raise NoOrbit(f"{above}; {below}", below.status) from None


def with_unit(number: str, name: str) -> str:
    """A parameter of a loop with its unit, where that is known: of the servo's own parameters and of remedies."""
    from ....servo.parts import REMEDIES

    units = {key.rpartition(".")[2]: unit for key, unit in PARAMETER_UNITS.items()}
    units |= {remedy.size: remedy.unit for remedy in REMEDIES}
    return f"{number} {units.get(name, '')}".rstrip()
