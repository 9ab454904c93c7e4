"""Where cycles end that nothing else follows.

    Hopf bifurcation    the cycle shrinks to an equilibrium, its period does not
    homoclinic orbit    the cycle comes up to an equilibrium, and its period grows without bound
    no time             the cycle and its period shrink to nothing, as a relay's without hysteresis

Towards the last two the parameter stands still: lambda - lambda_0 falls with exp(-T), or with a power of T.

Next to a Hopf bifurcation the cycle goes round the equilibrium x* at a distance A, and

    f(x*; p) = 0,    mu +- i omega among the eigenvalues of df/dx,    mu = 0 there, omega = 2 pi / T,
    lambda - lambda_H = c A^2

The branch of cycles leads to lambda_H; the point itself is computed from the equilibrium.
"""

from __future__ import annotations

import math

import numpy as np

from ..collocation.interval import field_at
from ..hybrid.roots import secant
from ..orbits.orbit import AnyOrbit, Orbit
from . import equilibrium
from .curve import parameter_value
from .recut import cut_by_planes
from .special_points import SpecialPoint

Array = np.ndarray

SHRUNK_TO = 1e-3
"""A cycle is next to an equilibrium when its states range over less than this part of what they did."""
HOMOCLINIC = (
    "{name} tends to {value:.8g} while the period grows without bound: the cycle comes up to an equilibrium and takes "
    "for ever to pass it (a homoclinic orbit), which is where it ends"
)
NO_TIME = (
    "{name} tends to {value:.8g} while the cycle and its period shrink to nothing: its events follow each other ever "
    "faster, which is where it ends"
)
SHRINKS = 0.5
STANDS_STILL, AT_AN_EQUILIBRIUM = 1e-7, 1e-4
"""A parameter that has changed by less than this, in lambda; a cycle that somewhere moves by less than this part of its
range in a period."""
NEARLY_STILL, NEXT_TO_ONE = 1e-4, 1e-3
"""The same where no step has led on: rounding may have stopped it a little before."""
AS_FORETOLD = 0.1
"""The point lies where A^2 leads to zero, to this part of the way."""


def ranges(orbit: Orbit) -> Array:
    """(n,) largest less smallest value of every state."""
    return np.ptp(orbit.sample()[1], axis=1)


def runs_out(before: Orbit, last: Orbit, vary: str, *, stuck: bool = False) -> str:
    """Why a cycle is next to the end of all cycles, the parameter standing still.

    Parameters
    ----------
    before, last
        two successive cycles of a branch.
    vary, stuck
        name of the parameter; whether no step has led on.

    Returns
    -------
    A sentence; "" where it is not.
    """
    value = parameter_value(last, vary)
    if abs(before.problem.distance(vary, value)) > (NEARLY_STILL if stuck else STANDS_STILL):
        return ""
    if last.period > before.period and _slowest(last) < (NEXT_TO_ONE if stuck else AT_AN_EQUILIBRIUM):
        return HOMOCLINIC.format(name=vary, value=value)
    if last.period < SHRINKS * before.period and np.all(ranges(last) <= SHRINKS * ranges(before)):
        return NO_TIME.format(name=vary, value=value)
    return ""


def _slowest(orbit: Orbit) -> float:
    """The least max_i |x_i'| T / (max x_i - min x_i) over the nodes and stages of the collocated phases."""
    size, p, scale = ranges(orbit), orbit.problem.vector(), orbit.scale
    moves = size > 0
    least = np.inf
    for arc, phase in zip(orbit.arcs, orbit.cycle.phases, strict=True):
        if phase.mode.flow is None:
            for x in arc.states.reshape(-1, scale.size):
                rate = scale * field_at(phase.mode.field, x / scale, phase.mode.sign, p, scale)
                least = min(least, float(np.max(np.abs(rate[moves]) / size[moves], initial=0.0)))
    return least * orbit.period


def hopf_point(before: AnyOrbit, last: AnyOrbit, vary: str) -> SpecialPoint[AnyOrbit] | None:
    """The Hopf bifurcation that two successive cycles shrink to.

    Parameters
    ----------
    before, last
        the cycles, cut by planes, the smaller one last.
    vary
        name of the parameter.

    Returns
    -------
    SpecialPoint, whose `at` is the value of the parameter; None where they do not lead to one.
    """
    if not cut_by_planes(last):
        return None
    problem = last.problem
    whole = ranges(before)
    moving = whole > 0
    part = float(np.max(ranges(last)[moving] / whole[moving]))
    here = parameter_value(last, vary)
    if not 0 < part < 1:
        return None
    way = (here - parameter_value(before, vary)) * part**2 / (1 - part**2)
    if way == 0:
        return None
    times, states = last.sample()
    centre = np.trapezoid(states, times, axis=1) / (times[-1] - times[0])
    omega = 2 * math.pi / last.period
    field, sign = last.cycle.phases[0].mode.field, last.cycle.phases[0].mode.sign

    def growth(value: float) -> float:
        p = problem.with_value(vary, float(value)).vector()
        return equilibrium.growth(field, sign, centre, p, omega)

    value, left = secant(growth, here, here + way, tolerance=1e-13 * omega)
    if not (abs(left) <= 1e-9 * omega and abs(value - here - way) <= AS_FORETOLD * abs(way) + 1e-9 * abs(here)):
        return None
    meaning = f"Hopf bifurcation at {vary} = {value:.10g}: the cycle has shrunk to an equilibrium, and ends there"
    return SpecialPoint("Hopf", last, meaning, float(value), vary)
