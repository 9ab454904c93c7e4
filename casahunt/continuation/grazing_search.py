"""The first cycle on the way of a parameter that grazes an event, from one that keeps clear of it.

h(x(t); p) = 0, dh/dt = 0        sought along the cycles of the loose family (grazing_contact.py), which pass the event
"""

from __future__ import annotations

from ..checks import choice_of, number
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit
from .branching import as_whole_as_needed
from .curve import parameter_value
from .following import follow
from .grazing_contact import contacts, events_of
from .special_points import SpecialPoint


def grazing(
    orbit: AnyOrbit, vary: str, event: str, *, to: float, options: Options | None = None
) -> SpecialPoint[AnyOrbit]:
    """The first cycle on the way of a parameter that grazes an event.

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
    NoOrbit : the cycle grazes it nowhere on the way.

    Examples
    --------
    >>> import casadi
    >>> from casahunt.continuation import grazing
    >>> from casahunt.hybrid import Event, Mode, System
    >>> from casahunt.orbits import find_cycle
    >>> def free(x, p):
    ...     return {"x": x.v, "v": p.A * casadi.cos(x.t) - 0.1 * x.v - 4 * x.x}
    >>> impact = Event("impact", lambda x, p: x.x - 1, +1, to="free", reset=lambda x, p: {"v": -0.8 * x.v})
    >>> modes, turn = (Mode("free", free, ends=(impact,)),), 2 * casadi.pi
    >>> wall = System("oscillator beside a wall", ("x", "v"), {"A": 1.0}, modes, forcing_period=lambda p: turn)
    >>> grazing = grazing(find_cycle(wall, x=0.0, v=0.0), "A", "impact", to=5.0)
    >>> round(grazing.orbit.problem.value("A"), 6)  # the square root of 9.01
    3.001666
    """
    if orbit.problem.system is None:
        raise InputError(f"a grazing of {orbit.problem.title}: only cycles of a user's system are followed along it")
    choice_of("parameter", vary, orbit.problem.names)
    choice_of("event", event, events_of(orbit))
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    orbit = as_whole_as_needed(orbit, (vary,), (number("to", to),), options)
    said = ["the scalar of the event turns inside no phase"]
    for _, contact in contacts(orbit, event):
        branch = follow(contact.loosened(orbit), vary, to=to, monitors=(contact.monitor,), options=options)
        for special in branch.special:
            shown = contact.reported(special.orbit)
            if not isinstance(shown, str):
                return SpecialPoint(special.kind, shown, special.meaning, vary=vary)
            said.append(shown)
        said.append(branch.ended)
    at = f"on the way of {vary} from {parameter_value(orbit, vary):.6g} to {to:.6g}"
    raise NoOrbit(f"no cycle of {orbit.problem.title} grazes {event!r} {at}: {said[-1]}", Status.NOT_FOUND)
