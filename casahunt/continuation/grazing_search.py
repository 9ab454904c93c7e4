"""The first cycle on the way of a parameter that touches an event, from one that keeps clear of it.

    h(x(t); p) = 0, dh/dt = 0        sought along the cycles of the loose family (touching.py), which pass the event
"""

from __future__ import annotations

from ..checks import known, number
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.family import Family
from ..orbits.orbit import AnyOrbit
from .branch import follow
from .curve import parameter_value
from .special_points import SpecialPoint
from .touching import events_of, touches


def grazing(
    orbit: AnyOrbit, vary: str, event: str, *, to: float, options: Options | None = None
) -> SpecialPoint[AnyOrbit]:
    """The first cycle on the way of a parameter that touches an event.

    Parameters
    ----------
    orbit
        a cycle of a user's system that keeps clear of the event, or that ends a phase with it.
    vary
        name of the parameter.
    event
        name of the event.
    to
        value of the parameter at which the search ends.
    options
        tolerance and method; default the tolerance to which the orbit is known, or 1e-8.

    Returns
    -------
    SpecialPoint of the kind "grazing", for `special_curve`.

    Raises
    ------
    InputError : unknown parameter or event, or no cycle of a user's system.
    NoOrbit : the cycle touches it nowhere on the way.
    """
    if not isinstance(orbit.problem, Family):
        raise InputError(f"a grazing of {orbit.problem.title}: only cycles of a user's system are followed along it")
    known("parameter", vary, orbit.problem.names)
    known("event", event, events_of(orbit.problem, orbit))
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    said = ["the scalar of the event turns inside no phase"]
    for _, touch in touches(orbit, event):
        branch = follow(touch.loosened(orbit), vary, to=number("to", to), monitors=(touch.monitor,), options=options)
        for special in branch.special:
            shown = touch.reported(special.orbit)
            if not isinstance(shown, str):
                return SpecialPoint(special.kind, shown, special.meaning, vary=vary)
            said.append(shown)
        said.append(branch.ended)
    at = f"on the way of {vary} from {parameter_value(orbit, vary):.6g} to {to:.6g}"
    raise NoOrbit(f"no cycle of {orbit.problem.title} touches {event!r} {at}: {said[-1]}", Status.NOT_FOUND)
