"""Equilibria of a mode of a user's system, followed in one of its parameters.

    f(x; p) = 0 along s:    f_x x' + f_p p' = 0,    |(x, lambda)'| = 1

x and lambda are in units of their largest magnitude so far.  Special points lie where one of these changes its sign:

    fold            lambda' = 0                                 two equilibria meet
    Hopf            prod (mu_i + mu_j) = 0, of a complex pair   cycles are born
    branch point    det f_x = 0 without a fold                  another branch of equilibria crosses
    boundary        holds = 0, or an event of the mode = 0      the equilibrium leaves its mode, and the branch ends

mu_i being the eigenvalues of f_x.  A step is halved until the parabola through each of these at its ends and its middle
changes sign as often as the values do: two zeros inside a step are both found.

Symbols: n states.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise

import numpy as np

from ..checks import choice_of, given_once, of_kind, require, to_and_back, to_error
from ..errors import InputError, NoOrbit, Status
from ..export import Columns
from ..hybrid.language import System
from ..results import Result
from ..roots import CLOSED, Bracket, Search
from .equilibrium import (
    BOUNDARY,
    BRANCH_POINT,
    FOLD_POINT,
    HOPF,
    KINDS,
    Curve,
    NormalForm,
    Place,
    at_rest,
    units_of,
    value_of,
)
from .special_points import Missed

Array = np.ndarray

LONGEST_ARC, FIRST_ARC, SHORTEST_ARC = 0.1, 0.01, 1e-9
"""Length of a step."""
QUICK = 3
"""Newton steps up to which the next step may be longer."""
SHORTEST_PART = 1e-4
"""A step is halved no more below this length: zeros that are nearer to each other are one point."""
AT_A_POINT, LOCATING_ROUNDS = 1e-11, 60
"""Length to which a special point is located."""
COMPLEX_PAIR = 1e-6
"""Imaginary part of a pair, relative to the largest eigenvalue, below which it is two real ones."""


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Result):
    """An equilibrium of a mode of a user's system.

    Attributes
    ----------
    system, mode : whose it is; name of the mode.
    parameters, states : by name.
    eigenvalues : (n,) complex, of the field linearised there, the one that grows fastest first.

    Examples
    --------
    >>> from casahunt.continuation import equilibria
    >>> from casahunt.hybrid import Mode, System
    >>> swing = System("swing", ("x", "v"), {"d": 0.2}, (Mode("free", lambda x, p: {"x": x.v, "v": -x.x - p.d * x.v}),))
    >>> equilibria(swing, vary="d", to=1.0, x=0.3, v=0.0).points[0].stable
    True
    """

    _quantities = ("mode", "states", "stable")
    _details = ("parameters", "eigenvalues")

    system: System
    mode: str
    parameters: dict[str, float]
    states: dict[str, float]
    eigenvalues: Array

    @property
    def stable(self) -> bool:
        """Every eigenvalue has a negative real part."""
        return bool(np.all(self.eigenvalues.real < 0))


@dataclass(frozen=True, eq=False, repr=False)
class SpecialEquilibrium(Result):
    """A located point of a branch of equilibria.

    Attributes
    ----------
    kind : "fold", "Hopf", "branch point" or "boundary".
    equilibrium : the equilibrium there.
    vary : name of the parameter.
    meaning : one sentence for the user.
    normal_form : of a Hopf bifurcation, else None; `l1` is its first Lyapunov coefficient, `omega` the frequency.  None
        where another eigenvalue is zero there too.

    Examples
    --------
    >>> from casahunt.continuation import equilibria
    >>> from casahunt.hybrid import Mode, System
    >>> def fitzhugh(x, p):
    ...     return {"v": x.v - x.v**3 / 3 - x.w + p.I, "w": 0.08 * (x.v + 0.7 - 0.8 * x.w)}
    >>> nerve = System("FitzHugh-Nagumo", ("v", "w"), {"I": 0.0}, (Mode("smooth", fitzhugh),))
    >>> low, high = equilibria(nerve, vary="I", to=2.0, v=-1.2, w=-0.6).special
    >>> low.kind, round(low.value, 6), round(low.normal_form.omega, 4), low.normal_form.l1 > 0
    ('Hopf', 0.331281, 0.2755, True)
    """

    _quantities = ("kind", "meaning")
    _details = ("value", "vary", "equilibrium")

    kind: str
    equilibrium: Equilibrium
    vary: str
    meaning: str
    normal_form: NormalForm | None = None

    @property
    def value(self) -> float:
        """The value of the parameter."""
        return self.equilibrium.parameters[self.vary]


@dataclass(frozen=True, eq=False, repr=False)
class EquilibriumBranch(Result):
    """Equilibria along a parameter.

    Attributes
    ----------
    vary : name of the parameter.
    points : the equilibria, in the order of computation.
    special : the special points that were located, in the same order.
    missed : those that the branch has, but that were not located.
    ended : one sentence that says why the branch ends where it does.

    Examples
    --------
    >>> from casahunt.continuation import equilibria
    >>> from casahunt.hybrid import Mode, System
    >>> folded = System("fold", ("x",), {"a": -1.0}, (Mode("smooth", lambda x, p: {"x": p.a + x.x**2}),))
    >>> branch = equilibria(folded, vary="a", to=1.0, x=-1.0)
    >>> [special.kind for special in branch.special], branch.ended
    (['fold'], 'a reached -1, the end of the range')
    """

    _quantities = ("vary", "number_of_points = points.size", "ended")
    _details = ("special", "missed")

    vary: str
    points: tuple[Equilibrium, ...]
    special: tuple[SpecialEquilibrium, ...]
    missed: tuple[Missed, ...]
    ended: str

    @property
    def values(self) -> Array:
        """(m,) values of the parameter."""
        return np.array([point.parameters[self.vary] for point in self.points])

    @property
    def stable(self) -> Array:
        """(m,) bool."""
        return np.array([point.stable for point in self.points])

    def __str__(self) -> str:
        head = f"{len(self.points)} equilibria along {self.vary}; {self.ended}"
        return "\n".join([head, *[special.meaning for special in self.special], *[m.meaning for m in self.missed]])

    def _columns(self) -> Columns:
        states = {name: [point.states[name] for point in self.points] for name in self.points[0].states}
        return {self.vary: self.values, **states, "stable": self.stable}


def equilibria(
    system: System,
    mode: str | None = None,
    *,
    vary: str,
    to: float,
    back: float | None = None,
    parameters: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    largest_step: float = LONGEST_ARC,
    max_points: int = 2000,
    **states: float,
) -> EquilibriumBranch:
    """Follow an equilibrium in a parameter, round folds, to where cycles are born.

    Parameters
    ----------
    system
        a system that time does not enter.
    mode
        name of the mode that it is an equilibrium of; default the first one.
    vary
        name of the parameter.
    to, back
        value towards which it goes, and at which it ends; value at which it ends on the other side, where a fold has
        turned it round: default the one it starts at.
    parameters
        those that differ from the system's, by name.
    start
        states near the equilibrium, by name.
    largest_step, max_points
        length of a step, in units of the largest states and parameter so far; number of equilibria after which it ends.
    **states
        the same as keywords, for those that are not in `start`.

    Returns
    -------
    EquilibriumBranch.

    Raises
    ------
    InputError : a name or number is wrong, or time enters the system.
    NoOrbit : there is no equilibrium of the mode next to the states.

    Examples
    --------
    >>> from casahunt.continuation import equilibria
    >>> from casahunt.hybrid import Mode, System
    >>> def field(x, p):
    ...     return {"x": x.v, "v": p.mu * x.v - x.x - x.v**3}
    >>> rayleigh = System("Rayleigh's oscillator", ("x", "v"), {"mu": -1.0}, (Mode("smooth", field),))
    >>> (hopf,) = equilibria(rayleigh, vary="mu", to=1.0, x=0.0, v=0.0).special
    >>> abs(hopf.value) < 1e-10, hopf.normal_form.l1 < 0
    (True, True)
    """
    of_kind("system", system, System)
    if system.forcing_period is not None:
        raise InputError(f"{system.name}: time enters it, and it has no equilibria; follow a cycle of it")
    p, x = system.values(parameters), system.state(given_once(start, states), parameters)
    name = system.mode(mode).name if mode is not None else system.modes[0].name
    curve = Curve(system, name, p, choice_of("parameter", vary, system.names.parameters))
    here = float(p[curve.i])
    to, back = to_and_back(vary, here, to, back)
    longest, bounds = require("largest_step", largest_step, above=0.0), (min(to, back), max(to, back))
    steps = _Steps(curve, name, vary, bounds, longest, [_first(curve, x, float(np.sign(to - here)))])
    ended = steps.run(max_points)
    points = tuple(steps.equilibrium(place.y) for place in steps.places)
    return EquilibriumBranch(vary, points, tuple(steps.special), tuple(steps.missed), ended)


def _first(curve: Curve, x: Array, sense: float) -> Place:
    """The equilibrium next to the states, and the way on.  Raises NoOrbit."""
    name, value = curve.mode.name, float(curve.p[curve.i])
    found = at_rest(curve.mode.field, curve.mode.sign, x, curve.p)
    near = "" if found is None else f" (its states are {', '.join(f'{v:.6g}' for v in found)})"
    if found is None:
        sentence = f"no equilibrium of mode {name!r} was found next to the states, or none that stands alone"
        raise NoOrbit(f"{sentence}; start nearer to it", Status.NOT_FOUND)
    y = np.append(found, value)
    if np.any(curve.margins(y) <= 0):
        sentence = f"the equilibrium next to the states is none of mode {name!r}, or lies on its boundary{near}"
        raise NoOrbit(f"{sentence}; ask for another mode, or start elsewhere", Status.INADMISSIBLE)
    units = units_of(np.zeros(y.size), y)
    tangent = curve.tangent(y, units, np.append(np.zeros(x.size), sense))
    assert tangent is not None
    return curve.place(y, tangent, units)


@dataclass
class _Steps:
    """A walk along the curve, with what is met; the places grow with it."""

    curve: Curve
    mode: str
    vary: str
    bounds: tuple[float, float]
    longest: float
    places: list[Place]

    def __post_init__(self) -> None:
        self.special: list[SpecialEquilibrium] = []
        self.missed: list[Missed] = []

    def run(self, max_points: int) -> str:
        """Steps to the end of the branch; why it ends."""
        ds = min(FIRST_ARC, self.longest)
        while len(self.places) < max_points:
            place = self.places[-1]
            step = self.curve.ahead(place, ds)
            while step is None:
                ds /= 2
                if ds < SHORTEST_ARC:
                    return f"no step from {self.vary} = {place.y[-1]:.8g} converged"
                step = self.curve.ahead(place, ds)
            after, corrections = step
            beyond = not self.bounds[0] <= after.y[-1] <= self.bounds[1]
            if beyond:
                landed = self.landed(place, after)
                if landed is None:
                    return f"no step from {self.vary} = {place.y[-1]:.8g} leads to the end of the range"
                after = landed
            if (ended := self.met(place, after)) or beyond:
                return ended or f"{self.vary} reached {after.y[-1]:.6g}, the end of the range"
            self.places[-1] = self.curve.in_units(after, units_of(after.units, after.y))
            ds = min(ds * (1.5 if corrections <= QUICK else 0.8), self.longest)
        return f"stopped after {max_points} points at {self.vary} = {self.places[-1].y[-1]:.6g}"

    def landed(self, place: Place, after: Place) -> Place | None:
        """The point of a step at which the parameter meets its bound."""
        bound = self.bounds[1] if after.y[-1] > self.bounds[1] else self.bounds[0]
        if place.y[-1] == bound:  # the first step
            return place
        found = self.root(place, after, lambda at: float(at.y[-1]) - bound)
        return None if found is None else replace(found, y=np.append(found.y[:-1], bound))

    def met(self, before: Place, after: Place) -> str:
        """Put the special points of a step and the point behind it to what is there; why the branch ends there."""
        for a, b in pairwise(self.refined(before, after)):
            signs = zip(KINDS, a.values, b.values, strict=True)
            changes = [kind for kind, f, g in signs if f * g < 0 or (g == 0 and f != 0)]
            located = [(kind, self.root(a, b, partial(value_of, kind))) for kind in changes]
            located.sort(key=lambda one: 0.0 if one[1] is None else float((one[1].y - a.y) / a.units @ a.tangent))
            for kind, at in located:
                point = None if at is None else self.special_point(kind, at)
                if at is None:
                    self.miss(kind, a, b)
                elif point is not None and not (kind == BRANCH_POINT and FOLD_POINT in changes):
                    self.special.append(point)
                if kind == BOUNDARY and at is not None and point is not None:
                    self.places.append(at)
                    return point.meaning
            grow = [int(np.sum(self.curve.eigenvalues(at.y).real > 0)) for at in (a, b)]
            if not changes and grow[0] != grow[1]:
                self.miss("change of stability", a, b)
        self.places.append(after)
        return ""

    def miss(self, kind: str, a: Place, b: Place) -> None:
        """Say that something was not located."""
        between = f"{self.vary} = {a.y[-1]:.8g} and {b.y[-1]:.8g}"
        self.missed.append(Missed(kind, f"a {kind} between {between} was not located; shorter steps may lead there"))

    def refined(self, a: Place, b: Place) -> list[Place]:
        """The ends of a step, and points between that part the zeros of every monitor."""
        length = float(np.linalg.norm((b.y - a.y) / a.units))
        step = self.curve.ahead(a, length / 2) if length > SHORTEST_PART else None
        if step is None:
            return [a, b]
        m = step[0]
        f = np.array([at.values for at in (a, m, b)])
        if not any(_turns_through(*column) for column in f.T):
            return [a, m, b] if np.any(f[0] * f[1] < 0) or np.any(f[1] * f[2] < 0) else [a, b]
        return [*self.refined(a, m), *self.refined(m, b)[1:]]

    def root(self, a: Place, b: Place, function: Callable[[Place], float]) -> Place | None:
        """The point between two at which a function is zero; None where the steps there do not lead to one."""
        length = float((b.y - a.y) / a.units @ a.tangent)
        f_a, f_b = function(a), function(b)
        if f_b == 0:
            return b
        search, best = Search.within(Bracket(0.0, f_a, length, f_b)), (b if abs(f_b) < abs(f_a) else a)
        least = min(abs(f_a), abs(f_b))
        for _ in range(LOCATING_ROUNDS):
            s = search.ask()
            step = self.curve.ahead(a, s)
            if step is None:
                search = search.failed()
                continue
            f = function(step[0])
            if abs(f) <= least:
                least, best = abs(f), step[0]
            if f == 0 or search.bracket.width <= max(AT_A_POINT, CLOSED * length):
                return best
            search = search.told(s, f)
        return None

    def equilibrium(self, y: Array) -> Equilibrium:
        """A point as the user reads it."""
        system, p = self.curve.system, self.curve.at(y[-1])
        parameters = dict(zip(system.names.parameters, map(float, p), strict=True))
        return Equilibrium(system, self.mode, parameters, system.names.numbers(y[:-1], p), self.curve.eigenvalues(y))

    def special_point(self, kind: str, at: Place) -> SpecialEquilibrium | None:
        """A located point; None where two real eigenvalues of opposite signs look like a Hopf bifurcation."""
        kind = BRANCH_POINT if kind == FOLD_POINT and self.curve.crossed(at) else kind
        here, form, name = self.equilibrium(at.y), None, f"{self.vary} = {float(to_error(at.y[-1], 1e-10)):.10g}"
        if abs(at.y[-1]) <= 1e-10 * at.units[-1]:
            name = f"{self.vary} = 0"
        meaning = {
            FOLD_POINT: f"fold at {name}: two equilibria meet; beyond it there is neither",
            BRANCH_POINT: f"branch point at {name}: another branch of equilibria crosses this one",
            BOUNDARY: f"at {name} the equilibrium leaves mode {self.mode!r} (a boundary equilibrium)",
        }.get(kind, "")
        if kind == HOPF:
            mu = here.eigenvalues
            a, b = min(combinations(mu, 2), key=lambda two: abs(two[0] + two[1]) / (abs(two[0]) + abs(two[1]) or 1.0))
            if not abs(a.imag) > COMPLEX_PAIR * np.max(np.abs(mu)):
                return None
            form = self.curve.normal_form(at, abs(a.imag))
            others = [c for c in mu if c not in (a, b)]
            born = "degenerate, for other eigenvalues are zero too"
            meaning = f"Hopf bifurcation at {name}: {_born(form, self.curve.i, self.vary, others) if form else born}"
        return SpecialEquilibrium(kind, here, self.vary, meaning, form)


def _turns_through(f: float, g: float, h: float) -> bool:
    """Whether the parabola through three values, the second one half-way, has zeros that their signs do not show."""
    if f * g < 0 or g * h < 0:
        return False
    bends, slope = 2 * (f - 2 * g + h), 4 * g - 3 * f - h
    turn = -slope / (2 * bends) if bends else math.nan
    return bool(0 < turn < 1 and (f + turn * (slope + turn * bends)) * g < 0)


def _born(form: NormalForm, i: int, vary: str, others: list[complex]) -> str:
    """What is born at a Hopf bifurcation."""
    passes = float(form.by_p[i].real)
    if form.l1 == 0 or passes == 0:
        return f"degenerate, its first Lyapunov coefficient being {form.l1:.4g}"
    way = "larger" if form.l1 * passes < 0 else "smaller"
    stable = form.l1 < 0 and all(mu.real < 0 for mu in others)
    return (
        f"cycles of period {2 * math.pi / form.omega:.6g} are born, {'stable' if stable else 'unstable'}, towards "
        f"{way} {vary} (first Lyapunov coefficient {form.l1:.4g})"
    )
