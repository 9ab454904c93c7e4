"""Equilibria of a mode of a user's system, followed in one of its parameters.

    f(x; p) = 0 along s:    f_x x' + f_p p' = 0,    |(x, lambda)'| = 1

x and lambda are in units of their largest magnitude so far.  Special points (equilibrium_crossings.py) lie where

    fold            lambda' = 0                                 two equilibria meet
    Hopf            a pair of eigenvalues of f_x is imaginary   cycles are born
    branch point    an eigenvalue is 0 without a fold           another branch of equilibria crosses
    boundary        holds = 0, or an event of the mode = 0      the equilibrium leaves its mode, and the branch ends

Symbols: n states.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..checks import choice_of, given_once, of_kind, require, to_and_back, to_error
from ..errors import InputError, NoOrbit, Status
from ..export import Columns
from ..hybrid.language import System
from ..results import Result
from .equilibrium import BOUNDARY, BRANCH_POINT, FOLD_POINT, HOPF, Curve, NormalForm, Place, at_rest, units_of
from .equilibrium_crossings import CHANGE, Line, Lost, Passed, turns_back
from .special_points import Missed

Array = np.ndarray

LONGEST_ARC, FIRST_ARC, SHORTEST_ARC = 0.1, 0.01, 1e-9
"""Length of a step."""
LEAST_STEPS = 10
"""A range is passed in so many steps, at least, however small it is beside its values."""
QUICK = 3
"""Newton steps up to which the next step may be longer."""


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium(Result):
    """An equilibrium of a mode of a user's system.

    Attributes
    ----------
    system, mode : whose it is; name of the mode.
    parameters, states : by name.
    eigenvalues : (n,) complex, of the field linearised there, the one that grows fastest first.
    rounding : (n,) what rounding leaves of each.

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
    rounding: Array

    @property
    def stable(self) -> bool:
        """Every eigenvalue has a negative real part, beyond rounding."""
        return bool(np.all(self.eigenvalues.real < -self.rounding))


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
        where another eigenvalue is zero there too, or another pair passes.
    error : estimated absolute error of the value.
    multiplicity : how many eigenvalues, or complex pairs of them, pass the imaginary axis there.

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
    _details = ("value", "vary", "error", "multiplicity", "equilibrium")

    kind: str
    equilibrium: Equilibrium
    vary: str
    meaning: str
    normal_form: NormalForm | None = None
    error: float = math.nan
    multiplicity: int = 1

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
    first = _first(curve, x, float(np.sign(to - here)))
    steps = _Steps(curve, name, vary, bounds, longest, [first])
    ended = steps.run(max_points)
    points = tuple(steps.equilibrium(place) for place in steps.places)
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
    """A walk along the curve, with what is met; the places grow with it.

    looked, known : number of the last place that it was looked up to; (n,) the signs there, or last that were sure.
    """

    curve: Curve
    mode: str
    vary: str
    bounds: tuple[float, float]
    longest: float
    places: list[Place]

    def __post_init__(self) -> None:
        self.special: list[SpecialEquilibrium] = []
        self.missed: list[Missed] = []
        self.looked, self.known = 0, self.places[0].signs

    def run(self, max_points: int) -> str:
        """Steps to the end of the branch; why it ends."""
        ds = min(FIRST_ARC, self.longest)
        while len(self.places) < max_points:
            place = self.places[-1]
            along = abs(float(place.tangent[-1] * place.units[-1]))
            ds = min(ds, (self.bounds[1] - self.bounds[0]) / LEAST_STEPS / max(along, np.finfo(float).tiny))
            step = self.curve.ahead(place, ds)
            while step is None:
                ds /= 2
                if ds < SHORTEST_ARC:
                    return f"no step from {self.vary} = {place.y[-1]:.8g} converged"
                step = self.curve.ahead(place, ds)
            after, corrections = step
            beyond = not self.bounds[0] <= after.y[-1] <= self.bounds[1]
            ended = self.met(after, last=beyond)
            if not ended and beyond:
                ended = self.landed(place, after)
            if ended:
                return ended
            self.places.append(self.curve.in_units(after, units_of(after.units, after.y)))
            ds = min(ds * (1.5 if corrections <= QUICK else 0.8), self.longest)
        return f"stopped after {max_points} points at {self.vary} = {self.places[-1].y[-1]:.6g}"

    def landed(self, place: Place, after: Place) -> str:
        """Put the point of a step at which the parameter meets its bound to the others; why the branch ends there."""
        bound = self.bounds[1] if after.y[-1] > self.bounds[1] else self.bounds[0]
        if place.y[-1] != bound:  # it is, where the first step goes out of the range
            line = Line(self.curve, place, after)
            at = line.zero(0.0, line.length, lambda one: (float(one.y[-1]) - bound, 0.0))
            if at is None:
                return f"no step from {self.vary} = {place.y[-1]:.8g} leads to the end of the range"
            place = replace(at.place, y=np.append(at.place.y[:-1], bound))
        self.places.append(place)
        return f"{self.vary} reached {bound:.6g}, the end of the range"

    def met(self, after: Place, *, last: bool) -> str:
        """Put what lies in the step to a point to what is there; why the branch ends in it.

        A point at which rounding hides which side an eigenvalue is on is no end of a step: the next one is, if not
        `last`.
        """
        if not last and self.looked == len(self.places) - 1 and self.places[-1].unclear(after):
            return ""
        line, before = Line(self.curve, *self.places[self.looked :], after), self.places[self.looked]
        self.looked = len(self.places)
        if np.any((before.signs == 0) & (self.known * after.signs < 0)):  # rounding hid it for several steps
            self.told(Lost(CHANGE, before, after))
        self.known = np.where(after.signs != 0, after.signs, self.known)
        for low, high in pairwise(line.stations()):
            end = line.left(low, high)
            for one in line.passed(low, end.at.s if isinstance(end, Passed) else high):
                self.told(one)
            if end is not None and self.told(end):
                assert isinstance(end, Passed)
                self.places.append(end.at.place)
                return self.special[-1].meaning
        around = [*self.places[-2:], after]
        for one in Line(self.curve, *around).beside() if len(around) == 3 and turns_back(*around) else ():
            self.told(one)
        return ""

    def told(self, one: Passed | Lost) -> bool:
        """Put something to what is there, where it lies in the range; whether it is a special point."""
        place = one.before if isinstance(one, Lost) else one.at.place
        off = max(self.bounds[0] - place.y[-1], place.y[-1] - self.bounds[1])
        if isinstance(one, Passed) and off <= one.at.error:
            self.special.append(self.special_point(one))
            return True
        if isinstance(one, Lost) and off <= 0:
            between = f"{self.vary} = {place.y[-1]:.8g} and {one.after.y[-1]:.8g}"
            sentence = f"a {one.kind} between {between} was not located; shorter steps may lead there"
            self.missed.append(Missed(one.kind, sentence))
        return False

    def equilibrium(self, place: Place) -> Equilibrium:
        """A point as the user reads it."""
        system, p = self.curve.system, self.curve.at(place.y[-1])
        parameters = dict(zip(system.names.parameters, map(float, p), strict=True))
        states = system.names.numbers(place.y[:-1], p)
        return Equilibrium(system, self.mode, parameters, states, place.mu, place.noise)

    def special_point(self, one: Passed) -> SpecialEquilibrium:
        """A located point."""
        at, error, many, form = one.at.place, one.at.error, one.many, None
        value = float(at.y[-1])
        name = f"{self.vary} = {to_error(value, error / abs(value), 10) if abs(value) > error else '0'}"
        meaning = {
            FOLD_POINT: f"fold at {name}: two equilibria meet; beyond it there is neither",
            BRANCH_POINT: f"branch point at {name}: another branch of equilibria crosses this one",
            BOUNDARY: f"at {name} the equilibrium leaves mode {self.mode!r} (a boundary equilibrium)",
        }.get(one.kind, "")
        if one.kind == HOPF:
            k = int(np.argmin(np.where(at.turning, np.abs(at.mu.real), np.inf)))
            omega, others = abs(float(at.mu[k].imag)), np.delete(at.mu, [k, k + 1])
            form = self.curve.normal_form(at, omega) if many == 1 else None
            born = "degenerate, for other eigenvalues have no real part there either"
            meaning = f"Hopf bifurcation at {name}: {_born(form, self.curve.i, self.vary, others) if form else born}"
        if many > 1:
            meaning += f" ({many} {'pairs of ' * (one.kind == HOPF)}eigenvalues at once)"
        return SpecialEquilibrium(one.kind, self.equilibrium(at), self.vary, meaning, form, error, many)


def _born(form: NormalForm, i: int, vary: str, others: Array) -> str:
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
