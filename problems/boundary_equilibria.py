"""Cycles born where an equilibrium meets a switching manifold, x = 0 (hopf_like.py says what is told of each).

An equilibrium passes from one side of x = 0 to the other at mu = 0.  All fields here are linear in x, y and mu together,
so the cycle at mu is mu times that at mu = 1: the amplitude is linear in mu, and the period does not depend on it.

    continuous        x' = t x + y,  y' = mu - d x,  (t, d) by the sign of x;  a focus and a focus, or a focus and a node
    Filippov          x' = a (x - mu) - y,  y' = x - mu + a y  for x > 0,  x' = 1, y' = -k for x < 0, sliding between
    both at once      foci on both sides, x' = a (x - mu) - w y,  y' = w (x - mu) + a y, (a, w) by the sign of x
    a stop at x = 0   x' = y,  y' = t y - d (x - mu),  y -> -r y at x = 0;  mu > 0: the focus is before the stop;
                      mu < 0: a focus, or a node, is behind it, and the cycle is unstable

The sliding is Filippov's: the convex combination of the two fields that keeps x = 0, until the right one points away.

Source: the review named in hopf_like.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from casahunt.hybrid import Event, Mode, System

from .hopf_like import Birth, fixed, flight

Pair = tuple[float, float]
TO_RIGHT = Event("to the right", lambda x, p: x.x, +1, to="right")
TO_LEFT = Event("to the left", lambda x, p: x.x, -1, to="left")


def two_sides(name: str, field: Callable[[Any, Any, Pair], dict[str, Any]], left: Pair, right: Pair) -> System:
    """A system of two fields that differ in two numbers.

    Parameters
    ----------
    name
        of the system.
    field
        (x, p, the two numbers) -> derivatives.
    left, right
        the two numbers.

    Returns
    -------
    System with the parameter mu.
    """
    modes = (
        Mode("left", lambda x, p: field(x, p, left), holds=lambda x, p: -x.x, ends=(TO_RIGHT,)),
        Mode("right", lambda x, p: field(x, p, right), holds=lambda x, p: x.x, ends=(TO_LEFT,)),
    )
    return System(name, ("x", "y"), {"mu": 0.5}, modes)


def continuous(x: Any, p: Any, numbers: Pair) -> dict[str, Any]:
    """The continuous pair of fields.

    Parameters
    ----------
    x, p
        states and parameters.
    numbers
        trace and determinant.

    Returns
    -------
    The derivatives by name.
    """
    trace, determinant = numbers
    return {"x": trace * x.x + x.y, "y": p.mu - determinant * x.x}


def turning(x: Any, p: Any, numbers: Pair) -> dict[str, Any]:
    """A focus at (mu, 0).

    Parameters
    ----------
    x, p
        states and parameters.
    numbers
        growth and turn.

    Returns
    -------
    The derivatives by name.
    """
    a, w = numbers
    return {"x": a * (x.x - p.mu) - w * x.y, "y": w * (x.x - p.mu) + a * x.y}


def of_continuous(left: Pair, right: Pair) -> Callable[[float], Pair]:
    """The truth of the continuous pair.

    Parameters
    ----------
    left, right
        traces and determinants.

    Returns
    -------
    mu -> (period, y where it goes to the right).
    """

    def matrix(numbers: Pair) -> Any:
        return np.array([[numbers[0], 1.0], [-numbers[1], 0.0]])

    def centre(numbers: Pair) -> Pair:
        trace, determinant = numbers
        return 1 / determinant, -trace / determinant

    def through(y: float) -> tuple[float, float]:
        first, low = flight(matrix(right), centre(right), y)
        second, high = flight(matrix(left), centre(left), low)
        return first + second, high

    y = fixed(lambda y: through(y)[1], 0.1, 50.0)
    return lambda mu: (through(y)[0], y * mu)


def of_turning(left: Pair, right: Pair) -> Callable[[float], Pair]:
    """The truth of two foci that meet the manifold at once.

    Parameters
    ----------
    left, right
        growths and turns.

    Returns
    -------
    mu -> (period, -y where it goes to the right).
    """

    def matrix(numbers: Pair) -> Any:
        a, w = numbers
        return np.array([[a, -w], [w, a]])

    def through(y: float) -> tuple[float, float]:
        first, high = flight(matrix(right), (1.0, 0.0), -y)
        second, low = flight(matrix(left), (1.0, 0.0), high)
        return first + second, -low

    y = fixed(lambda y: through(y)[1], 0.31, 50.0)
    return lambda mu: (through(y)[0], y * mu)


FOCI, NODE = ((-1.0, 1.0), (0.4, 1.0)), ((-3.0, 2.0), (0.4, 1.0))
"""(left, right) of the continuous fields, each (trace, determinant)."""
AT_ONCE = ((-0.4, 1.0), (0.6, 2.0))
"""(left, right), each (growth, turn)."""
GROWTH, DRIFT = 0.2, 1.0


def right_of(x: Any, p: Any) -> dict[str, Any]:
    """The field right of the manifold.

    Parameters
    ----------
    x, p
        states and parameters.

    Returns
    -------
    The derivatives by name.
    """
    return turning(x, p, (GROWTH, 1.0))


def speed(x: Any, p: Any) -> Any:
    """How fast the right field comes to the manifold, -x' at x = 0.

    Parameters
    ----------
    x, p
        states and parameters.

    Returns
    -------
    The speed.
    """
    return GROWTH * p.mu + x.y


def sliding(x: Any, p: Any) -> dict[str, Any]:
    """Filippov's combination of the right field and (1, -DRIFT), in which x stays.

    Parameters
    ----------
    x, p
        states and parameters.

    Returns
    -------
    The derivatives by name.
    """
    share = 1 / (1 + speed(x, p))
    return {"x": 0.0, "y": share * (GROWTH * x.y - p.mu) - (1 - share) * DRIFT}


SLIDES = System(
    "Filippov focus",
    ("x", "y"),
    {"mu": 0.5},
    (
        Mode("right", right_of, holds=lambda x, p: x.x,
             ends=(Event("lands", lambda x, p: x.x, -1, to="slides"),)),
        Mode("slides", sliding, holds=speed, ends=(Event("lifts off", speed, -1, to="right"),)),
    ),
)  # fmt: skip


def of_sliding(mu: float) -> Pair:
    """The truth of the cycle that slides.

    Parameters
    ----------
    mu
        the parameter.

    Returns
    -------
    The period, and -y where it lifts off.
    """
    lift = -GROWTH * mu
    flown, y = flight(np.array([[GROWTH, -1.0], [1.0, GROWTH]]), (mu, 0.0), lift)
    # y' = (GROWTH y - mu - DRIFT s)/(1 + s) with s = GROWTH mu + y: numerator c + m y, denominator e + y.
    m, c, e = GROWTH - DRIFT, -mu - DRIFT * GROWTH * mu, 1 + GROWTH * mu
    slid = (lift - y) / m + (e - c / m) / m * np.log((c + m * lift) / (c + m * y))
    return flown + float(slid), -lift


def stopped(name: str, trace: float, determinant: float, restitution: float) -> System:
    """An oscillator with a stop at x = 0.

    Parameters
    ----------
    name
        of the system.
    trace, determinant
        of its field.
    restitution
        at the stop.

    Returns
    -------
    System with the parameter mu.
    """

    def free(x: Any, p: Any) -> dict[str, Any]:
        return {"x": x.y, "y": trace * x.y - determinant * (x.x - p.mu)}

    hit = Event("impact", lambda x, p: x.x, -1, to="free", reset=lambda x, p: {"y": -restitution * x.y})
    return System(name, ("x", "y"), {"mu": 0.5}, (Mode("free", free, holds=lambda x, p: x.x, ends=(hit,)),))


def of_stop(trace: float, determinant: float, restitution: float, side: int, bounds: Pair) -> Callable[[float], Pair]:
    """The truth of an oscillator with a stop.

    Parameters
    ----------
    trace, determinant, restitution
        as in `stopped`.
    side
        sign of mu.
    bounds
        of y at mu = side.

    Returns
    -------
    mu -> (period, y after the impact).
    """
    A = np.array([[0.0, 1.0], [-determinant, trace]])
    y = fixed(lambda y: -restitution * flight(A, (side, 0.0), y)[1], *bounds)
    return lambda mu: (flight(A, (side, 0.0), y)[0], y * abs(mu))


STOPS = {"focus before": (0.4, 1.0, 0.4), "focus behind": (0.4, 1.0, 0.8), "node behind": (3.0, 2.0, 0.6)}
"""(trace, determinant, restitution)."""


def born(name: str, system: System, truth: Callable[[float], Pair], side: int, mode: str, sign: float) -> Birth:
    """A birth of this file: amplitude linear, period finite.

    Parameters
    ----------
    name, system, truth, mode
        as in Birth.
    side
        sign of mu where there is a cycle.
    sign
        of y where the mode begins.

    Returns
    -------
    Birth.
    """
    begin = 0.5 * side
    period, y = truth(begin)
    start = {"x": 0.0, "y": sign * y}
    laws = {"amplitude": 1.0, "period": 0.0, "limits": (2 * y, period)}
    settled = "behind" in name
    return Birth(name, system, "mu", 0.0, begin, start, mode, "y", truth=truth, settled=settled, **laws)  # type: ignore[arg-type]


BIRTHS = (
    born("continuous, focus to focus", two_sides("two foci", continuous, *FOCI), of_continuous(*FOCI), 1, "right", 1.0),
    born("continuous, node to focus", two_sides("focus and node", continuous, *NODE), of_continuous(*NODE), 1, "right", 1.0),
    born("Filippov, pseudo-node to focus", SLIDES, of_sliding, 1, "right", -1.0),
    born("Filippov, two foci at once", two_sides("two foci at once", turning, *AT_ONCE), of_turning(*AT_ONCE), 1, "right", -1.0),
    born("stop, focus before it", stopped("focus before a stop", *STOPS["focus before"]),
         of_stop(*STOPS["focus before"], 1, (0.1, 50.0)), 1, "free", 1.0),
    born("stop, focus behind it", stopped("focus behind a stop", *STOPS["focus behind"]),
         of_stop(*STOPS["focus behind"], -1, (0.1, 50.0)), -1, "free", 1.0),
    born("stop, node behind it", stopped("node behind a stop", *STOPS["node behind"]),
         of_stop(*STOPS["node behind"], -1, (0.1, 0.999)), -1, "free", 1.0),
)  # fmt: skip
