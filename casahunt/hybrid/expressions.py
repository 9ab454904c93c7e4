"""What the functions of a user's system return for symbols, checked: one sentence with whose function it is.

    scalar    one number or expression of the symbols that the function was given, with no NaN and no infinity in it
    states    such a scalar for each state, by name

A symbol has no value: math.sin makes NaN of it, and a comparison cannot decide an `if`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from ..checks import quoted
from ..errors import InputError
from .vector_form import listed

HINTS = {
    "truth value": "what depends on a comparison is written with casadi.if_else, fmin, fmax, or as two modes",
    "not subscriptable": "states and parameters are written x.name and p.name",
    "positional argument": "a field takes (x, p), and so do events, resets and conditions; a flow takes (x, t, p)",
}
"""Part of a message of Python or CasADi: what to do about it."""


def evaluated(what: str, function: Callable[..., Any], *symbols: Any) -> Any:
    """What a function of the user's returns.

    Parameters
    ----------
    what
        what it is called in messages.
    function
        the function.
    *symbols
        what it is called with.

    Returns
    -------
    Whatever it returns.

    Raises
    ------
    InputError : it raises an exception itself.
    """
    try:
        return function(*symbols)
    except InputError as error:
        raise InputError(f"{what}: {error}") from None
    except Exception as error:  # whatever a user's function raises
        hint = next((f" ({hint})" for part, hint in HINTS.items() if part in str(error)), "")
        raise InputError(f"{what} cannot be evaluated with CasADi's symbols: {error}{hint}") from error


def check_scalar(what: str, value: Any, symbols: list[ca.SX]) -> ca.SX:
    """A scalar of the symbols.

    Parameters
    ----------
    what
        what it is called in messages.
    value
        what a function returned.
    symbols
        all that it may depend on.

    Returns
    -------
    The value as an expression.

    Raises
    ------
    InputError : it is no scalar, depends on something else, or is no finite number.
    """
    try:
        scalar = ca.SX(value)
    except Exception:  # whatever CasADi makes of a dict, a text, None
        raise InputError(f"{what} must return a scalar, not {quoted(value)}") from None
    if scalar.shape != (1, 1):
        raise InputError(f"{what} must return a scalar, not one of shape {scalar.shape}")
    graph = ca.Function("graph", symbols, [scalar], {"allow_free": True})
    if graph.has_free():
        free = ", ".join(map(str, graph.free_sx()))
        raise InputError(f"{what} depends on {free}, which is no state and no parameter")
    constants = [graph.instruction_constant(k) for k in range(graph.n_instructions())
                 if graph.instruction_id(k) == ca.OP_CONST]  # fmt: skip
    if any(math.isnan(c) for c in constants):
        raise InputError(
            f"{what} is NaN, whatever the state: symbols need casadi's functions, such as casadi.sin, not those of math"
        )
    if any(math.isinf(c) for c in constants):
        raise InputError(f"{what} holds an infinite number")
    return scalar


def check_states(what: str, values: Any, states: tuple[str, ...], symbols: list[ca.SX], *, partly: bool) -> None:
    """States by name, a scalar each.

    Parameters
    ----------
    what, values, states
        what it is called in messages; what a function returned; names of the states.
    symbols
        all that it may depend on.
    partly
        states may be missing.

    Raises
    ------
    InputError : it is no mapping, a state is missing or unknown, or one of them no scalar.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{what} must return states by name, such as {{{states[0]!r}: ...}}, not {quoted(values)}")
    unknown = [str(name) for name in values if name not in states]
    if unknown:
        raise InputError(f"{what} speaks of {listed(unknown)}; the states are {listed(states)}")
    missing = [name for name in states if name not in values]
    if missing and not partly:
        raise InputError(f"{what} says nothing of the state {listed(missing)}")
    for name, value in values.items():
        check_scalar(f"{what} of the state {name!r}", value, symbols)
