"""What the functions of a user's system return for symbols, checked: one sentence with whose function it is.

    scalar    one number or expression of the symbols that the function was given, with no NaN and no infinity in it
    states    such a scalar for each state, by name

A symbol has no value: math.sin makes NaN of it, and a comparison cannot decide an `if`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np

from ..checks import quoted
from ..compiled import alone
from ..errors import InputError
from .jumps import Looked, check_jumps
from .vector_form import Names, listed, returned, symbols

HINTS = {
    "truth value": "what depends on a comparison is written with casadi.if_else, fmin, fmax; what jumps, as two modes",
    "not subscriptable": "states and parameters are written x.name and p.name",
    "positional argument": "a field takes (x, p), and so do events, resets and conditions; a flow takes (x, t, p)",
}
"""Part of a message of Python or CasADi: what to do about it."""


def evaluated(what: str, function: Callable[..., Any], *symbols: Any) -> Any:
    """What a function of the user's returns.

    Raises InputError: it raises an exception itself.
    """
    try:
        return function(*symbols)
    except InputError as error:
        raise InputError(f"{what}: {error}") from None
    except Exception as error:  # whatever a user's function raises
        hint = next((f" ({hint})" for part, hint in HINTS.items() if part in str(error)), "")
        raise InputError(f"{what} cannot be evaluated with CasADi's symbols: {error}{hint}") from error


def _one_value(what: str, value: Any) -> ca.SX:
    """What was returned as an expression.  Raises InputError where it is no scalar."""
    try:
        scalar = value if isinstance(value, ca.SX) else ca.SX(value)
    except Exception:  # whatever CasADi makes of a dict, a text, None
        raise InputError(f"{what} must return a scalar, not {quoted(value)}") from None
    if scalar.shape != (1, 1):
        raise InputError(f"{what} must return a scalar, not one of shape {scalar.shape}")
    return scalar


def _check_graph(scalars: list[tuple[str, ca.SX]], symbols: list[ca.SX]) -> None:
    """Nothing but the symbols and finite numbers stands in the expressions: looked at together, for speed."""
    graph = ca.Function("graph", symbols, [ca.vertcat(*[scalar for _, scalar in scalars])], {"allow_free": True})
    constants = [graph.instruction_constant(k) for k in range(graph.n_instructions())
                 if graph.instruction_id(k) == ca.OP_CONST]  # fmt: skip
    if not graph.has_free() and all(map(math.isfinite, constants)):
        return
    if len(scalars) > 1:  # whose fault it is
        for one in scalars:
            _check_graph([one], symbols)
    what = scalars[0][0]
    if graph.has_free():
        free = ", ".join(map(str, graph.free_sx()))
        raise InputError(f"{what} depends on {free}, which is no state and no parameter")
    if any(map(math.isnan, constants)):
        raise InputError(
            f"{what} is NaN, whatever the state: symbols need casadi's functions, such as casadi.sin, not those of math"
        )
    raise InputError(f"{what} holds an infinite number")


def _by_name(what: str, values: Any, states: tuple[str, ...], *, partly: bool) -> list[tuple[str, ca.SX]]:
    """States by name, a scalar each.

    what, values, states: what it is called in messages; what a function returned; names of the states; partly: states
    may be missing. Returns of each, what it is called and its value. Raises InputError: it is no mapping, a state is
    missing or unknown, or one of them no scalar.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{what} must return states by name, such as {{{states[0]!r}: ...}}, not {quoted(values)}")
    unknown = [str(name) for name in values if name not in states]
    if unknown:
        raise InputError(f"{what} speaks of {listed(unknown)}; the states are {listed(states)}")
    missing = [name for name in states if name not in values]
    if missing and not partly:
        raise InputError(f"{what} says nothing of the state {listed(missing)}")
    named = [(f"{what} of the state {name!r}", value) for name, value in values.items()]
    return [(called, _one_value(called, value)) for called, value in named]


@alone
def check_scalar(what: str, function: Callable[..., Any], names: Names) -> None:
    """A function of (x, p) of a user's is called with symbols.

    function, names: the function, and what x and p are called.
    Raises InputError: it is no scalar of states and parameters, or cannot be evaluated with symbols.
    """
    value = evaluated(what, returned, function, names, False, False)
    _check_graph([(what, _one_value(what, value))], list(symbols(names)))


@alone
def check_functions(system: Any) -> None:
    """Every function of a system (language.py) is called with symbols, once.

    Raises InputError: one does not name what there is, or does not return what it should.
    """
    names = system.names
    given = symbols(names)
    found: list[tuple[str, ca.SX]] = []
    events: list[tuple[str, ca.SX]] = []
    looked: dict[Any, list[Looked]] = {}
    for what, function, kind, mode in _user_functions(system):
        if kind == "turn":
            value = evaluated(what, function, names.p(given[2]))
        else:
            value = evaluated(what, returned, function, names, mode.sign is not None, kind == "flow")
        if kind in ("field", "flow", "reset"):
            scalars = _by_name(what, value, system.states, partly=kind == "reset")
        else:
            scalars = [(what, _one_value(what, value))]
        found += scalars
        if kind == "event":
            events += scalars
        if kind in ("field", "flow", "event"):
            looked.setdefault(mode.sign, []).extend(Looked(*scalar, kind == "event") for scalar in scalars)
    _check_graph(found, list(given))
    slopes = ca.jacobian(ca.vertcat(*[scalar for _, scalar in events]), given[0]) if events else ca.SX(0, 0)
    for k, (what, _) in enumerate(events):
        if slopes[k, :].is_zero():
            raise InputError(f"{what} does not change with any state; an event is where a scalar goes through zero")

    for sign, some in looked.items():
        check_jumps(some, given, names, np.array(list(system.parameters.values())), sign or 0.0)

def _user_functions(system: Any) -> Iterator[tuple[str, Callable[..., Any], str, Any]]:
    """(what it is called, the function, its kind, its mode)."""
    if system.forcing_period is not None:
        yield f"system {system.name!r}: forcing_period", system.forcing_period, "turn", None
    for mode in system.modes:
        what = f"mode {mode.name!r}"
        for kind in ("field", "holds", "feature", "flow"):
            if getattr(mode, kind) is not None:
                yield f"{what}: {kind}", getattr(mode, kind), kind, mode
        for event in mode.ends:
            where = f"event {event.name!r} of {what}"
            yield f"{where}: function", event.function, "event", mode
            if event.reset is not None:
                yield f"{where}: reset", event.reset, "reset", mode
