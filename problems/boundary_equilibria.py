"""Cycles born where an equilibrium meets the switching manifold x = 0, at mu = 0 (hopf_like.py says what is told).

    continuous   x' = t x + y,  y' = mu - d x,  (t, d) by the sign of x: a focus or a node gives way to a focus
    Filippov     x' = a (x - mu) - y,  y' = x - mu + a y right of x = 0;  x' = 1, y' = -k left of it; sliding between
    at once      x' = a (x - mu) - w y,  y' = w (x - mu) + a y,  (a, w) by the sign of x: two foci meet x = 0 together
    stop         x' = y,  y' = t y - d (x - mu),  y -> -r y at x = 0;  mu > 0: the focus lies before the stop;
                 mu < 0: a focus, or a node, lies behind it, and the cycle is unstable

Amplitude ~ |mu|, and the period tends to a limit.  All fields but the sliding one are linear in x, y and mu together:
there the cycle at mu is |mu| times that at +-1, and the period is the same for all.  The sliding is Filippov's, the
convex combination of both fields that stays at x = 0, with s = a mu + y (the speed at which the right field comes in):

    y' = (a y - mu - k s)/(1 + s),   until s = 0

Source: the review named in hopf_like.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from casahunt.hybrid import Event, Mode, System

from .hopf_like import Birth, Field, Turn, flight, two_sides, zero

Pair = tuple[float, float]
Motion = Callable[[float], Turn]

FOCI, NODE = ((-1.0, 1.0), (0.4, 1.0)), ((-3.0, 2.0), (0.4, 1.0))
"""(t, d) left and right, of the continuous fields."""
AT_ONCE = ((-0.4, 1.0), (0.6, 2.0))
"""(a, w) left and right, of the foci that meet x = 0 together."""
GROWTH, DRIFT = 0.2, 1.0
"""a and k of Filippov's."""
BEFORE, BEHIND, NODE_BEHIND = (0.4, 1.0, 0.4), (0.4, 1.0, 0.8), (3.0, 2.0, 0.6)
"""(t, d, r) of the stops."""


def continuous(numbers: Pair) -> Field:
    """The continuous field on one side.

    Returns (x, p) -> the derivatives by name.
    """
    t, d = numbers
    return lambda x, p: {"x": t * x.x + x.y, "y": p.mu - d * x.x}


def turning(numbers: Pair) -> Field:
    """A focus at (mu, 0).

    Returns (x, p) -> the derivatives by name.
    """
    a, w = numbers
    return lambda x, p: {"x": a * (x.x - p.mu) - w * x.y, "y": w * (x.x - p.mu) + a * x.y}


def linear(field: Field) -> tuple[np.ndarray, Pair]:
    """A linear field at mu = 1.

    Returns its matrix, and where it is zero.
    """

    def at(x: float, y: float) -> np.ndarray:
        rates = field(_At(x=x, y=y), _At(mu=1.0))
        return np.array([rates["x"], rates["y"]])

    b = at(0, 0)
    A = np.column_stack([at(1, 0) - b, at(0, 1) - b])
    x, y = np.linalg.solve(A, -b)
    return A, (float(x), float(y))


class _At:
    """Numbers by their names."""

    def __init__(self, **values: float) -> None:
        self.__dict__.update(values)


def crossing(left: Field, right: Field, bounds: Pair) -> Motion:
    """The truth of two linear fields.

    bounds: of y where the motion goes to the right, at mu = 1. Returns mu -> Turn.
    """

    def through(y: float) -> tuple[float, float]:
        first, across = flight(*linear(right), y)
        second, back = flight(*linear(left), across)
        return first + second, back

    y = zero(lambda y: through(y)[1] / y - 1, *bounds)
    period = through(y)[0]
    return lambda mu: Turn(period, 0.0, y * mu)


def incoming(x: Any, p: Any) -> Any:
    """The speed s at which the right field of Filippov's comes in, -x' at x = 0."""
    return GROWTH * p.mu + x.y


def sliding(x: Any, p: Any) -> dict[str, Any]:
    """Filippov's combination of both fields."""
    s = incoming(x, p)
    return {"x": 0.0, "y": (GROWTH * x.y - p.mu - DRIFT * s) / (1 + s)}


SLIDES = System(
    "sliding next to a focus",
    ("x", "y"),
    {"mu": 0.5},
    (
        Mode("right", turning((GROWTH, 1.0)), holds=lambda x, p: x.x,
             ends=(Event("lands", lambda x, p: x.x, -1, to="slides"),)),
        Mode("slides", sliding, holds=incoming, ends=(Event("lifts off", incoming, -1, to="right"),)),
    ),
)  # fmt: skip


def slid(mu: float) -> Turn:
    """The truth of the cycle that slides: y' = (c + m y)/(e + y) while it does."""
    lift = -GROWTH
    flown, y = flight(*linear(turning((GROWTH, 1.0))), lift)
    m, c, e = GROWTH - DRIFT, -mu - DRIFT * GROWTH * mu, 1 + GROWTH * mu
    time = (lift - y) * mu / m + (e - c / m) / m * math.log((c + m * lift * mu) / (c + m * y * mu))
    return Turn(flown + time, 0.0, lift * mu)


def sliding_limit() -> Pair:
    """Limits of -y/mu and of the period, for the one that slides.

    Returns both: what is left of `slid` as mu -> 0.
    """
    flown, y = flight(*linear(turning((GROWTH, 1.0))), -GROWTH)
    m, c = GROWTH - DRIFT, -1 - DRIFT * GROWTH
    return GROWTH, flown + math.log((c - m * GROWTH) / (c + m * y)) / m


def stop(t: float, d: float, r: float) -> System:
    """An oscillator with a stop at x = 0.

    Returns system with the parameter mu.
    """
    hit = Event("impact", lambda x, p: x.x, -1, to="free", reset=lambda x, p: {"y": -r * x.y})
    free = Mode("free", lambda x, p: {"x": x.y, "y": t * x.y - d * (x.x - p.mu)}, holds=lambda x, p: x.x, ends=(hit,))
    return System("oscillator with a stop", ("x", "y"), {"mu": 0.5}, (free,))


def impacts(t: float, d: float, r: float, side: int, bounds: Pair) -> Motion:
    """The truth of an oscillator with a stop.

    bounds: of y after an impact, at mu = +-1. Returns mu -> Turn.
    """
    A = np.array([[0.0, 1.0], [-d, t]])
    y = zero(lambda y: r * flight(A, (side, 0.0), y)[1] / y + 1, *bounds)
    period = flight(A, (side, 0.0), y)[0]
    return lambda mu: Turn(period, 0.0, y * abs(mu))


def _birth(name: str, system: System, turn: Motion, side: int = 1, limits: Pair | None = None) -> Birth:
    mode, at = "free" if system.modes[0].name == "free" else "right", turn(side)
    limits = limits or (abs(at.y), at.period)
    return Birth(name, system, "mu", 0.0, side / 2, mode, "y", (1.0, 0.0), limits, turn, settled=side < 0)


def _pair(name: str, kind: Callable[[Pair], Field], numbers: tuple[Pair, Pair], bounds: Pair) -> Birth:
    left, right = map(kind, numbers)
    return _birth(name, two_sides(name, ("mu", 0.5), left, right), crossing(left, right, bounds))


BIRTHS = (
    _pair("continuous, focus to focus", continuous, FOCI, (0.1, 50.0)),
    _pair("continuous, node to focus", continuous, NODE, (0.1, 50.0)),
    _birth("Filippov, pseudo-node to focus", SLIDES, slid, limits=sliding_limit()),
    _pair("Filippov, two foci at once", turning, AT_ONCE, (-50.0, -0.31)),
    _birth("stop, focus before it", stop(*BEFORE), impacts(*BEFORE, 1, (0.1, 50.0))),
    _birth("stop, focus behind it", stop(*BEHIND), impacts(*BEHIND, -1, (0.1, 50.0)), -1),
    _birth("stop, node behind it", stop(*NODE_BEHIND), impacts(*NODE_BEHIND, -1, (0.1, 0.999)), -1),
)
