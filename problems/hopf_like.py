"""Cycles born from a point in Hopf-like ways, as Simpson's review of twenty lists them: what the files below share.

A stationary point (an equilibrium on a switching manifold, a fold or two of them, a focus, a pseudo-equilibrium) loses
its stability or its form as a parameter lambda passes lambda_0, and sends out one cycle.  With d = |lambda - lambda_0|

    amplitude  ~  A d^a,        period  ~  P d^b   (b = 0: it tends to P)

with exponents a and b that depend on the way.  The parameters are named, the points are their own, the fields are the
simplest that have the way; most have a return map in closed form.

    boundary_equilibria.py   an equilibrium on a switching manifold: continuous fields, Filippov's with sliding, stops
    folds_and_foci.py        foci and folds on a switching manifold that slip along it or change stability there
    kicks_and_relays.py      kicks, relays with hysteresis, two switching manifolds that intersect

Source: D. J. W. Simpson, Twenty Hopf-like bifurcations in piecewise-smooth dynamical systems, Physics Reports 970 (2022)
1-80, arXiv 1905.01329.  The exponents are those of the paper; the constants follow from the return maps here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from casahunt.hybrid import System
from casahunt.orbits import SystemOrbit, find_cycle

Array = np.ndarray


@dataclass(frozen=True)
class Birth:
    """One way in which a cycle is born.

    Attributes
    ----------
    name : what becomes of what.
    system : whose cycle it is.
    vary, value : parameter, and its value at the birth.
    begin : value at which the cycle is sought.
    start : states next to the cycle at `begin`, in the mode `mode`.
    mode : as said.
    measure : the state whose extent is the amplitude.
    amplitude, period : exponents (a, b).
    limits : (y/d^a, period/d^b) as d -> 0, y the truth's.
    truth : value -> (period, y), y the magnitude of the state `measure` at the event that begins the mode `mode`.
    point : where the cycle is born, (x, y).
    settled : the cycle is unstable: start next to it.
    """

    name: str
    system: System
    vary: str
    value: float
    begin: float
    start: Mapping[str, float]
    mode: str
    measure: str
    amplitude: float
    period: float
    limits: tuple[float, float]
    truth: Callable[[float], tuple[float, float]]
    point: tuple[float, float] = (0.0, 0.0)
    settled: bool = False

    def cycle(self, value: float | None = None, tol: float = 1e-9) -> SystemOrbit:
        """The cycle at a value of the parameter, by default where it is begun.

        Parameters
        ----------
        value
            of the parameter.
        tol
            tolerance.

        Returns
        -------
        The orbit, measured by `measure`.
        """
        at = {self.vary: self.begin if value is None else value}
        how: dict[str, Any] = {"parameters": at, "start": dict(self.start), "follow": self.vary}
        return find_cycle(self.system, self.mode, tol=tol, measure=self.measure, settled=self.settled, **how)


def flight(A: Array, centre: tuple[float, float], y: float) -> tuple[float, float]:
    """Time and y at which the linear motion z' = A (z - centre) from (0, y) is next at x = 0.

    Parameters
    ----------
    A, centre
        of the field.
    y
        where it starts.

    Returns
    -------
    The time and y.
    """
    alpha = np.trace(A) / 2
    square = alpha**2 - np.linalg.det(A)
    rate = math.sqrt(abs(square))
    start = np.array([-centre[0], y - centre[1]])
    turned = (A - alpha * np.eye(2)) @ start

    def place(t: float) -> Array:
        even, odd = (math.cos, math.sin) if square < 0 else (math.cosh, math.sinh)
        share = odd(rate * t) / rate if rate else t
        return np.asarray(centre + math.exp(alpha * t) * (even(rate * t) * start + share * turned))

    times = np.geomspace(1e-3, 20.0, 2000)
    side = np.sign([place(t)[0] for t in times])
    k = int(np.argmax(side != side[0]))
    t = brentq(lambda t: place(t)[0], times[k - 1], times[k], xtol=1e-15, rtol=1e-15)
    return float(t), float(place(t)[1])


def fixed(step: Callable[[float], float], low: float, high: float) -> float:
    """The y with step(y) = y between two bounds.

    Parameters
    ----------
    step
        a return map.
    low, high
        bounds.

    Returns
    -------
    The y.
    """
    return float(brentq(lambda y: step(y) / y - 1, low, high, xtol=1e-16, rtol=1e-14))
