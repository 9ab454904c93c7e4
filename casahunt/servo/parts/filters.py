"""Filters in series behind any controller: lead, notch, low-pass, by numbers that have names.

    command = F1(s) F2(s) ... demand

    lead                   (s/lead_zero + 1)/(s/lead_pole + 1)                                          [rad/s]
    notch                  (s^2 + 2 notch_depth notch_damping w s + w^2)/(s^2 + 2 notch_damping w s + w^2)
    low-pass               1/(s/low_pass + 1)
    second-order low-pass  w^2/(s^2 + 2 filter_damping w s + w^2)

with w = notch_frequency, filter_frequency.  All are 1 at rest: integral action is that of the controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ...checks import SMALLEST, choice_of, quoted
from ...compiled import kept
from ...errors import InputError
from .part import Function, Law, Part, PartMode

Polynomial = Callable[[Any], tuple[Any, ...]]  # the parameters -> coefficients, from the highest power on


class Filter(NamedTuple):
    """numerator/denominator, each with order + 1 coefficients, the denominator's first one 1."""

    parameters: Mapping[str, float]
    numerator: Polynomial
    denominator: Polynomial
    order: int


def _square(w: Any, damping: Any) -> tuple[Any, ...]:
    return 1.0, 2 * damping * w, w**2


FILTERS = {
    "lead": Filter(
        {"lead_zero": 10.0, "lead_pole": 100.0},
        lambda p: (p.lead_pole / p.lead_zero, p.lead_pole), lambda p: (1.0, p.lead_pole), 1,
    ),
    "notch": Filter(
        {"notch_frequency": 100.0, "notch_damping": 0.5, "notch_depth": 0.1},
        lambda p: _square(p.notch_frequency, p.notch_depth * p.notch_damping),
        lambda p: _square(p.notch_frequency, p.notch_damping), 2,
    ),
    "low-pass": Filter({"low_pass": 100.0}, lambda p: (0.0, p.low_pass), lambda p: (1.0, p.low_pass), 1),
    "second-order low-pass": Filter(
        {"filter_frequency": 100.0, "filter_damping": 0.7},
        lambda p: (0.0, 0.0, p.filter_frequency**2), lambda p: _square(p.filter_frequency, p.filter_damping), 2,
    ),
}  # fmt: skip
MAY_BE_ZERO = ("notch_depth",)


def series(*filters: str) -> Part:
    """Filters behind a controller, one after the other.

    Parameters
    ----------
    *filters
        "lead", "notch", "low-pass", "second-order low-pass", each once.

    Returns
    -------
    Part with the filters' numbers as parameters.

    Raises
    ------
    InputError : no filter, one that there is not, or twice.

    Examples
    --------
    >>> from casahunt.servo.parts import series
    >>> part = series("notch", "low-pass")
    >>> part.states, sorted(part.parameters)
    (('notch1', 'notch2', 'low_pass1'), ['low_pass', 'notch_damping', 'notch_depth', 'notch_frequency'])
    """
    for name in filters:
        choice_of("filter", name, FILTERS)
        if filters.count(name) > 1:
            raise InputError(f"series: {quoted(name)} twice: each filter can be there once")
    if not filters:
        raise InputError(f"series: must have a filter: {', '.join(FILTERS)}")
    return _series(filters)


@kept(maxsize=64)
def _series(filters: tuple[str, ...]) -> Part:
    gives, rates = dict[str, Function](), dict[str, Function]()
    came = "demand"
    for name in filters:
        goes = "command" if name == filters[-1] else f"behind {name}"
        gives[goes], more = _one(FILTERS[name], name.replace("-", "_").replace(" ", "_"), came, goes)
        rates, came = rates | more, goes
    numbers = {key: value for name in filters for key, value in FILTERS[name].parameters.items()}
    return Part(
        "series of " + ", ".join(filters), tuple(rates), numbers, gives=gives, modes=(PartMode("", Law(rates)),),
        ranges={key: (SMALLEST, math.inf) for key in numbers if key not in MAY_BE_ZERO}, made_by=(series, filters),
    )  # fmt: skip


def _one(of: Filter, called: str, came: str, goes: str) -> tuple[Function, dict[str, Function]]:
    """A filter from one signal to another: y = b0 u + c1, c_i' = b_i u - a_i y + c_i+1; (y, rates by state)."""
    states = tuple(f"{called}{i + 1}" for i in range(of.order))

    def output(x: Any, s: Any, p: Any) -> Any:
        return of.numerator(p)[0] * getattr(s, came) + getattr(x, states[0])

    def rate(i: int) -> Function:
        def of_state(x: Any, s: Any, p: Any) -> Any:
            following = getattr(x, states[i + 1]) if i + 1 < of.order else 0.0
            return of.numerator(p)[i + 1] * getattr(s, came) - of.denominator(p)[i + 1] * getattr(s, goes) + following

        return of_state

    return output, {state: rate(i) for i, state in enumerate(states)}
