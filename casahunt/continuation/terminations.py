"""Where branches of cycles end, by name.

    Hopf                   the cycle shrinks to an equilibrium of a smooth mode, its period does not
    shrinks to a point     the same where modes meet, and where the period shrinks, too: a birth at a switching
    comes to rest          what moves shrinks, some states alone, as beside a line of rests, and it stands ever longer
    grows without bound    the cycle's size tends to infinity
    vertical family        the parameter stands still, and every size has its cycle
    homoclinic orbit       the cycle comes up to an equilibrium, and its period grows without bound
    level reached          the same where the level of an event comes up to the equilibrium of the mode that it ends

Towards such an end something b tends to zero, and the parameter with a power of it,

    lambda - lambda_0 = c b^p        b = size, 1/size, 1/T or exp(-T),   1/p the exponent of b in |lambda - lambda_0|

Three orbits tell lambda_0, c and p; the three before them foretell it.  It is accepted where the two agree to a part of
the way that is left, and the branch has ended where b is small and no more is learnt.

Next to a Hopf bifurcation the cycle goes round the equilibrium x* at a distance A, and

    f(x*; p) = 0,    mu +- i omega among the eigenvalues of df/dx,    mu = 0 there, omega = 2 pi / T,
    lambda - lambda_H = c A^2

The branch of cycles leads to lambda_H; the point itself is computed from the equilibrium.

Through the rest that a forced cycle shrinks to, where its forcing passes zero, the cycle goes on,

    x(t; lambda) = x*(t) + (lambda - lambda_0) y(t) + ...

for it keeps its period, and a rest is one of its cycles.  Its size is |lambda - lambda_0| times a constant, whichever
the sign.  In units of its own size it takes for ever to come there; so it is looked for as far on the other side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..checks import to_error
from ..collocation.interval import field_at
from ..collocation.mesh import phase_breaks, transfer
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..orbits.restart import in_scale
from ..results import Result
from ..roots import boundary, secant
from . import equilibrium
from .curve import parameter_value, solved_at
from .poincare_section import cut_by_planes
from .special_points import SpecialPoint

Array = np.ndarray

MUCH_SMALLER = 1e-2
"""A cycle is next to an end when its size, or one over it, is less than this part of what it was ..."""
BARELY_SHRUNK = 0.3
"""... or less than this where no step leads on."""
SHRUNK_TO = 1e-3
"""One that is cut by a plane has lost it when its states range over less than this part of what they did."""
NOT_SMALLER = 1e-6
"""Below this part of what it was it is a point: what is left is rounding of what it goes round."""
WELL_KNOWN = 1e-10
"""lambda_0 is known so well that no further step is worth its while."""
AGREE = 0.1
"""Two fits agree when their lambda_0 differ by less than this part of the way that is left."""
POWERS = (0.02, 50.0)
"""Powers p that are looked for."""
LEAST_CHANGE, NEARLY_ONE = 0.03, 0.1
"""Between orbits that differ by less than this part of their b no power is told; one so near to one is one."""
STANDS_STILL, AT_AN_EQUILIBRIUM = 1e-7, 1e-4
"""A parameter that has changed by less than this, in lambda; a cycle that somewhere moves by less than this part of its
range in a period."""
NEARLY_STILL, NEXT_TO_ONE = 1e-4, 1e-3
"""The same where no step has led on: rounding may have stopped it a little before."""
AS_FORETOLD = 0.1
"""The point lies where A^2 leads to zero, to this part of the way."""
POINT_KIND = "shrinks to a point"
SPACED = 0.25
"""Orbits from which a law is read differ by this part of their size, or more."""
VERTICAL_ORBITS, VERTICAL_STILL, VERTICAL_MULTIPLIER = 4, 1e-10, 1e-5
"""Orbits in a row, changing in size, with parameters that differ by less than this, in lambda, and with a multiplier
that is 1 to this."""
HOMOCLINIC = (
    "{name} tends to {value} while the period grows without bound: the cycle comes up to an equilibrium and takes "
    "for ever to pass it (a homoclinic orbit), which is where it ends"
)
LEVEL = (
    "{name} tends to {value} while the period grows without bound: the level of {event!r} comes up to the equilibrium "
    "of the mode {mode!r} and is reached no more, which is where the cycle ends"
)
POINT = (
    "{name} tends to {value} while the cycle shrinks to a point, its size like |{away}|^{size}, its period "
    "{period}: which is where it ends"
)
REST_KIND = "comes to rest"
TO_REST = (
    "{name} tends to {value} while what moves of the cycle shrinks to nothing, like |{away}|^{size}, and it stands "
    "ever longer, its period {period}: which is where it ends, without a fold"
)
AS_GOOD_AS_REST = (
    "what moves of the cycle has shrunk to {part} of what it was at {name} = {value}, and stands ever longer; no value "
    "of {name} is seen at which that ends"
)
UNBOUNDED = (
    "{name} tends to {value} while the cycle grows without bound, its size like |{away}|^{size}, its period "
    "{period}: which is where it ends"
)
VERTICAL = (
    "{name} stands still at {value} while the size of the cycle changes and a multiplier is 1: a vertical family, in "
    "which every size has its cycle, and the branch ends"
)
BEYOND_REST = 30.0
"""How many times farther from the rest than the last cycle the next one is."""


@dataclass(frozen=True, eq=False, repr=False)
class End(Result):
    """Why a branch ends where it does.

    Attributes
    ----------
    kind : "range" (a bound of the parameter is reached), "points", "time" (as many as were asked for), "closed" (it
        meets its own image, or where it began), "Hopf", "shrinks to a point", "comes to rest" (what moves shrinks to
        nothing, and it stands ever longer), "grows without bound", "vertical family", "one of many" (at the same
        parameters), "homoclinic orbit", "level reached", "grazing", "the successor changes" (no cycle was found behind
        one), the kind of a special point at which it was to end, or "stuck" (no step converged: nothing is known of
        what follows).
    sentence : the same in words.
    value : value of the parameter that the branch tends to; NaN where it only stops.
    error : estimated absolute error of that.
    exponent, period_exponent : powers of |parameter - value| with which the size and the period of the cycle go; NaN
        where there is none.

    Examples
    --------
    >>> from casahunt.continuation import follow
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> follow(orbit, "a", to=0.013).end.kind
    'range'
    """

    _quantities = ("kind", "value +- error", "exponent", "period_exponent")
    _details = ("sentence",)

    kind: str
    sentence: str
    value: float = math.nan
    error: float = math.nan
    exponent: float = math.nan
    period_exponent: float = math.nan

    def __str__(self) -> str:
        return self.sentence


class PowerLaw(NamedTuple):
    """lambda - lambda_0 = c b^p: `value` is lambda_0, `power` p, `error` how far the fit before it was off."""

    value: float
    power: float
    error: float


def ranges(orbit: Orbit) -> Array:
    """(n,) largest less smallest value of every state."""
    return _ranges(orbit)


@lru_cache(maxsize=256)
def _ranges(orbit: Orbit) -> Array:
    states = orbit.sample()[1]
    many = len(orbit.problem.vocabulary(orbit.cycle.states).states)
    return np.asarray(np.ptp(states[:many], axis=1))


def law_of(values: Sequence[float], b: Sequence[float] | Array) -> PowerLaw | None:
    """The power law that four values of a parameter follow.

    values, b: (4,) of the parameter and of what tends to zero, which falls from each to the next.
    Returns law; None where they follow none that leads on, or the first three foretell another end.
    """
    lam, size = np.asarray(values, float), np.asarray(b, float)
    if not np.all(size[1:] < (1 - LEAST_CHANGE) * size[:-1]) or not np.all(size > 0):
        return None
    first, last = _fitted(lam[:3], size[:3]), _fitted(lam[1:], size[1:])
    if first is None or last is None:
        return None
    error = abs(first[0] - last[0])
    return PowerLaw(*last, error) if error <= AGREE * abs(lam[-1] - last[0]) else None


def polynomial_law(values: Sequence[float], b: Array) -> PowerLaw:
    """The law of a parameter that is a polynomial of what tends to zero: known better, and sooner, than by a power."""

    def at_zero(lam: Array, b: Array) -> float:
        others = ~np.eye(b.size, dtype=bool)
        weights = np.array([np.prod(b[k] / (b[k] - b[i])) for i, k in enumerate(others)])
        return float(weights @ lam)

    lam = np.asarray(values, float)
    value = at_zero(lam, b)
    return PowerLaw(value, 1.0, abs(value - at_zero(lam[1:], b[1:])))


def _fitted(lam: Array, b: Array) -> tuple[float, float] | None:
    """(lambda_0, p) of three points; None where no power of `POWERS` leads through them."""
    steps = lam[:-1] - lam[1:]
    if not steps[0] * steps[1] > 0:
        return None
    ratio, logs = steps[1] / steps[0], np.log(b / b[0])

    def steeper(log_p: float) -> bool:
        c = np.exp(math.exp(log_p) * logs)
        return bool((c[1] - c[2]) / (c[0] - c[1]) < ratio)

    low, high = np.log(POWERS)
    if steeper(low) or not steeper(high):
        return None
    p = math.exp(boundary(steeper, low, high, width=1e-14)[0])
    c = np.exp(p * (logs - logs[1]))
    return float(lam[2] - steps[1] * c[2] / (c[1] - c[2])), p


def comes_to(orbits: Sequence[Orbit], vary: str, *, stuck: bool = False) -> End | None:
    """The end that a branch is next to.

    orbits, vary: of the branch, in order, and the name of its parameter; stuck: whether no step has led on.
    Returns end; None where none is near.
    """
    if len(orbits) < VERTICAL_ORBITS:
        return _takes_for_ever(orbits, vary, stuck) if len(orbits) > 1 else None
    return _vertical(orbits, vary) or _scaled(orbits, vary, stuck) or _takes_for_ever(orbits, vary, stuck)


def _scaled(orbits: Sequence[Orbit], vary: str, stuck: bool) -> End | None:
    """The end at which the size of the cycle tends to zero, or to infinity."""
    first = ranges(orbits[0])
    moves = first > 0

    def by(extreme: Any) -> Callable[[Orbit], float]:
        return lambda orbit: float(extreme(ranges(orbit)[moves] / first[moves])) if moves.any() else 0.0

    unit = orbits[-1].problem.unit(vary)
    for size_of, sign, kind, words in (
        (by(np.max), 1, POINT_KIND, POINT), (by(np.max), -1, "grows without bound", UNBOUNDED),
        (by(np.min), 1, REST_KIND, TO_REST),
    ):  # fmt: skip
        last = size_of(orbits[-1])
        if not last > 0 or last**sign > (BARELY_SHRUNK if stuck else MUCH_SMALLER):
            continue
        four, sizes = _spaced(orbits, size_of, sign)
        values = [parameter_value(orbit, vary) for orbit in four]
        b = np.array(sizes) ** sign
        if kind == REST_KIND and not (len(four) == 4 and four[-1].period > (1 + SPACED) * four[0].period):
            continue  # one state passes zero
        law = law_of(values, b) if len(four) == 4 else None
        if kind == REST_KIND and law is None and last <= NOT_SMALLER:
            return End(kind, AS_GOOD_AS_REST.format(name=vary, value=f"{values[-1]:.6g}", part=f"{last:.1g}"))
        if kind == REST_KIND and law is not None and abs(law.power - 1) < NEARLY_ONE:
            law = polynomial_law(values, b)
        unknown = max((orbit.parameter_error for orbit in four), default=math.inf) * abs(unit)
        enough = max(WELL_KNOWN * unit, unknown if kind == REST_KIND else 0.0)
        if law is None or not (stuck or law.error <= enough or b[-1] <= NOT_SMALLER):
            continue
        away = np.abs(np.array(values) - law.value)
        of_period = float(np.log(four[-1].period / four[-2].period) / np.log(away[-1] / away[-2]))
        size = sign / law.power
        tends = f"to {four[-1].period:.6g}" if abs(of_period) < LEAST_CHANGE else f"like its power {of_period:.3g}"
        value = _shown(law.value, law.error, unit)
        distance = {"0": vary}.get(value, f"{vary} + {value[1:]}" if value.startswith("-") else f"{vary} - {value}")
        sentence = words.format(name=vary, value=value, away=distance, size=f"{size:.3g}", period=tends)
        error = law.error + unknown
        return End(kind, sentence, law.value, error, size, 0.0 if abs(of_period) < LEAST_CHANGE else of_period)
    return None


def _spaced(orbits: Sequence[Orbit], size_of: Callable[[Orbit], float], sign: int) -> tuple[list[Orbit], list[float]]:
    """The last four orbits that differ in size by enough to tell a power, and their sizes; fewer where there are none.

    Steps shrink where they fail.
    """
    four, sizes = [orbits[-1]], [size_of(orbits[-1])]
    for orbit in reversed(orbits[:-1]):
        times = (size_of(orbit) / sizes[-1]) ** sign
        if len(four) == 4 or times < 1 - LEAST_CHANGE:
            break
        if times >= 1 + SPACED:
            four.append(orbit)
            sizes.append(size_of(orbit))
    return four[::-1], sizes[::-1]


def _shown(value: float, error: float, unit: float) -> str:
    """A value to the digits that its error vouches for; zero within that is zero."""
    return "0" if abs(value) <= max(error, WELL_KNOWN * unit) else to_error(value, max(error / abs(value), 1e-12))


def _vertical(orbits: Sequence[Orbit], vary: str) -> End | None:
    """The vertical family in which the last orbits are."""
    some = orbits[-VERTICAL_ORBITS:]
    value = parameter_value(some[-1], vary)
    if any(abs(orbit.problem.distance(vary, value)) > VERTICAL_STILL for orbit in some):
        return None
    sizes = [float(np.max(ranges(orbit))) for orbit in some]
    if min(abs(b / a - 1) for a, b in zip(sizes[:-1], sizes[1:], strict=True)) < LEAST_CHANGE:
        return None
    off = [float(np.min(np.abs(orbit.multipliers.half[1:] - 1), initial=np.inf)) for orbit in some]
    if not max(off) <= VERTICAL_MULTIPLIER:
        return None
    value_text = _shown(value, some[-1].parameter_error * abs(value), some[-1].problem.unit(vary))
    return End("vertical family", VERTICAL.format(name=vary, value=value_text), value, VERTICAL_STILL)


def _takes_for_ever(orbits: Sequence[Orbit], vary: str, stuck: bool) -> End | None:
    """The end at which the period tends to infinity, the cycle coming up to an equilibrium."""
    before, last = orbits[-2:]
    value = parameter_value(last, vary)
    moved = abs(before.problem.distance(vary, value))
    if moved > (NEARLY_STILL if stuck else STANDS_STILL) or not last.period > before.period:
        return None
    slowest, mode, event = _slowest(last)
    if not slowest < (NEXT_TO_ONE if stuck else AT_AN_EQUILIBRIUM):
        return None
    error = abs(value - parameter_value(before, vary))
    four, _ = _spaced(orbits, lambda orbit: 1 / orbit.period, 1)
    if len(orbits) >= 4:
        four = four if len(four) == 4 else list(orbits[-4:])
        values, T = [parameter_value(orbit, vary) for orbit in four], np.array([orbit.period for orbit in four])
        # Past a saddle T goes like a logarithm, past a saddle-node like a power.
        laws = [law_of(values, b) for b in (1 / T, np.exp(-(T - T[0]) / (T[-1] - T[0])))]
        law = min((law for law in laws if law is not None), key=lambda law: law.error, default=None)
        error = max(error, abs(value - values[-2]))
        value, error = (value, error) if law is None else (law.value, max(law.error, abs(value - law.value) * AGREE))
    text = _shown(value, error, last.problem.unit(vary))
    if event:
        return End("level reached", LEVEL.format(name=vary, value=text, event=event, mode=mode), value, error)
    return End("homoclinic orbit", HOMOCLINIC.format(name=vary, value=text), value, error)


def _slowest(orbit: Orbit) -> tuple[float, str, str]:
    """The least max_i |x_i'| T / (max x_i - min x_i) over the nodes and stages of the collocated phases, and its place.

    The mode there, and the event where the phase still is as slow when it meets that; "" elsewhere.
    """
    size, p, scale = ranges(orbit), orbit.problem.vector(), orbit.scale
    moves = np.append(size > 0, np.zeros(scale.size - size.size, bool))
    size = np.append(size, np.ones(scale.size - size.size))
    least, mode, event = np.inf, "", ""
    for arc, phase in zip(orbit.arcs, orbit.cycle.phases, strict=True):
        if phase.mode.flow is None:
            places = np.concatenate([arc.states.reshape(-1, scale.size), arc.end[None]])
            rates = np.array([scale * field_at(phase.mode.field, x / scale, phase.mode.sign, p, scale) for x in places])
            speeds = np.max(np.abs(rates[:, moves] / size[moves]), axis=1, initial=0.0)
            if speeds.min() < least:
                own = arc.event not in orbit.problem.marks
                least, mode = float(speeds.min()), arc.mode
                event = arc.event if own and speeds[-1] * orbit.period < NEXT_TO_ONE else ""
    return least * orbit.period, mode, event


def hopf_point(before: AnyOrbit, last: AnyOrbit, vary: str) -> SpecialPoint[AnyOrbit] | None:
    """The Hopf bifurcation that two successive cycles shrink to.

    before, last: the cycles, cut by planes, the smaller one last.
    Returns SpecialPoint, whose `at` is the value of the parameter; None where they do not lead to one.
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
    steps = np.diff(times) / (times[-1] - times[0])
    centre = (states[:, 1:] + states[:, :-1]) @ steps / 2  # numpy 1 has no trapezoid
    omega = 2 * math.pi / last.period
    field, sign = last.cycle.phases[0].mode.field, last.cycle.phases[0].mode.sign

    def growth(value: float) -> float:
        p = problem.with_value(vary, float(value)).vector()
        return equilibrium.growth_rate(field, sign, centre, p, omega)

    value, left = secant(growth, here, here + way, tolerance=1e-13 * omega)
    if not (abs(left) <= 1e-9 * omega and abs(value - here - way) <= AS_FORETOLD * abs(way) + 1e-9 * abs(here)):
        return None
    meaning = f"Hopf bifurcation at {vary} = {value:.10g}: the cycle has shrunk to an equilibrium, and ends there"
    return SpecialPoint("Hopf", last, meaning, float(value), vary)


def through_rest(orbits: Sequence[AnyOrbit], vary: str, value: float, options: Options) -> Any:
    """The cycle on the other side of the rest that a branch of forced cycles shrinks to.

    orbits, vary: of the branch, and the name of its parameter; value: of the parameter where they are at rest.
    Returns Orbit; None where the system is not forced, or none was found.
    """
    before, last = orbits[-2:]
    family = last.problem
    if not family.forced:
        return None
    if before.signature != last.signature:
        return None
    t, u, setting = unknowns_of(last)
    other, v, its = in_scale(unknowns_of(before), setting.scale)
    _, v, _ = transfer(other, v, its.fractions, phase_breaks(t, setting.fractions), target=t)
    away = [parameter_value(orbit, vary) - value for orbit in (before, last)]
    rate = (u - v) / (away[1] - away[0])
    beyond = -BEYOND_REST * away[1]
    start = t, u + (beyond - away[1]) * rate, setting
    return solved_at(family.with_value(vary, value + beyond), start, options)
