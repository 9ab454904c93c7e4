"""Cycles born from a point in Hopf-like ways, as Simpson's review of twenty lists them: what the files below share.

A stationary point (an equilibrium on a switching manifold, a fold or two of them, a focus, a pseudo-equilibrium) loses
its stability or its form where a parameter passes lambda_0, and sends out one cycle.  With d = |lambda - lambda_0|

    extent of the cycle  ~  A d^a,        period  ~  P d^b   (b = 0: it tends to P)

and the exponents a and b tell the ways apart.  The fields are the simplest ones that have the way in question; all
return maps have a closed form, up to the root of one equation.

boundary_equilibria.py  an equilibrium on a switching manifold: continuous fields, Filippov's with sliding, stops
folds_and_foci.py       foci and folds on a switching manifold that slip along it, or change stability there
kicks_and_relays.py     kicks, relays with hysteresis, two switching manifolds that intersect

Source: D. J. W. Simpson, Twenty Hopf-like bifurcations in piecewise-smooth dynamical systems, arXiv 1905.01329 (2019):
the ways are its; the systems are made for them, and exponents and constants follow from the return maps here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

Field = Callable[[Any, Any], dict[str, Any]]
MOST_TERMS = 60
"""Of a power series whose terms fall at least like 2^-n."""


class Turn(NamedTuple):
    """A cycle in closed form: its period, and where its first mode begins."""

    period: float
    x: float
    y: float


@dataclass(frozen=True)
class Birth:
    """One way in which a cycle is born.

    Attributes
    ----------
    name : the way.
    system : whose cycle it is, with states x and y.
    vary, value : parameter, and its value at the birth.
    begin : value from which the cycle is followed there.
    mode : with which the turn begins.
    measure : the state whose extent is the amplitude.
    exponents : (a, b).
    limits : limits of (distance of `measure` from that of `point` where the mode begins)/d^a and of period/d^b.
    turn : value of the parameter -> Turn.
    point : (x, y) where the cycle is born.
    settled : the cycle attracts no motion.
    """

    name: str
    system: System
    vary: str
    value: float
    begin: float
    mode: str
    measure: str
    exponents: tuple[float, float]
    limits: tuple[float, float]
    turn: Callable[[float], Turn]
    point: tuple[float, float] = (0.0, 0.0)
    settled: bool = False

    def cycle(self, tol: float = 1e-9) -> SystemOrbit:
        """The cycle where it begins to be followed."""
        _, x, y = self.turn(self.begin)
        how: dict[str, Any] = {"parameters": {self.vary: self.begin}, "follow": self.vary, "measure": self.measure}
        return find_cycle(self.system, self.mode, tol=tol, settled=self.settled, start={"x": x, "y": y}, **how)


def two_sides(name: str, parameter: tuple[str, float], left: Field, right: Field) -> System:
    """A system with one field on either side of x = 0, through which the motion goes."""
    to_right = Event("to the right", lambda x, p: x.x, +1, to="right")
    to_left = Event("to the left", lambda x, p: x.x, -1, to="left")
    modes = (
        Mode("left", left, holds=lambda x, p: -x.x, ends=(to_right,)),
        Mode("right", right, holds=lambda x, p: x.x, ends=(to_left,)),
    )
    return System(name, ("x", "y"), dict([parameter]), modes)


def zero(function: Callable[[float], float], low: float, high: float) -> float:
    """The zero of a function between two bounds, by halving what is between them to rounding.

    Raises ValueError: the function has the same sign at both bounds.
    """
    falls = function(low) > 0
    if falls == (function(high) > 0):
        raise ValueError(f"no change of sign between {low!r} and {high!r}")
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if (function(middle) > 0) == falls else (low, middle)
    return middle


def series(term: Callable[[int], float], first: int) -> float:
    """The sum of term(first), term(first + 1), ..., which fall at least like 2^-n.

    term: n -> the term.
    """
    return math.fsum(term(n) for n in range(first, first + MOST_TERMS))


def flight(A: np.ndarray, centre: tuple[float, float], y: float) -> tuple[float, float]:
    """How the linear motion z' = A (z - centre) from (0, y) comes back to x = 0.

    y: where it starts. Returns the time, and y.
    """
    alpha = np.trace(A) / 2
    square = alpha**2 - np.linalg.det(A)
    rate = math.sqrt(abs(square))
    even, odd = (np.cos, np.sin) if square < 0 else (np.cosh, np.sinh)
    start = np.array([-centre[0], y - centre[1]])
    turned = (A - alpha * np.eye(2)) @ start / rate

    def place(i: int, t: Any) -> Any:
        return centre[i] + np.exp(alpha * t) * (even(rate * t) * start[i] + odd(rate * t) * turned[i])

    times = np.geomspace(1e-3, 20.0, 2000)
    side = np.sign(place(0, times))
    k = int(np.argmax(side != side[0]))
    t = zero(lambda t: float(place(0, t)), times[k - 1], times[k])
    return t, float(place(1, t))
