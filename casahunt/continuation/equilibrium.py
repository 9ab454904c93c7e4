"""Equilibria of one smooth field: their curve in one parameter, and how the field behaves next to them.

    f(x; p) = 0 along s:    f_x x' + f_p p' = 0,    |(x, lambda)'| = 1,    x and lambda in units of their own

    f(x*; p) = 0,    A = df/dx,    A q = i omega q,    A^T r = -i omega r,    <r, q> = 1        at a Hopf bifurcation

On the centre manifold, x = x* + 2 Re(z q + z^2 h_20 / 2) + |z|^2 h_11 + ...,  with B and C the second and third
derivatives of f as forms,

    z' = (mu + i omega) z + c z |z|^2,      h_11 = -A^-1 B(q, q*),      h_20 = (2 i omega - A)^-1 B(q, q)
    c = <r, C(q, q, q*) + 2 B(q, h_11) + B(q*, h_20)> / 2,              l_1 = Re c / omega

l_1 is the first Lyapunov coefficient: cycles of |z|^2 = -mu / Re c are stable on the manifold where it is negative.  It
is counted in units of q, which has length one here.

Source: Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, Springer 1998, sections 3.5 and 5.4.
Symbols: n states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..compiled import alone, kept
from ..hybrid.language import System
from ..hybrid.system import Field

Array = np.ndarray

AT_REST, REST_ROUNDS = 1e-13, 20
"""Newton's method for the equilibrium ends at a step of this relative size."""
CANCELLED = 1e-12
"""Sums that are less than this part of their terms are rounding."""
CORRECTIONS, CORRECTED = 8, 1e-12
"""Newton steps after which a step has failed; length of the last one."""
DOWN_TO_ROUNDING, SHRINKS_BY = 1e-8, 0.3
"""One below this that is not shorter than the one before by this is rounding: next to a place where curves cross."""
LEAST_ALONG = 0.95
"""Cosine between the tangents at both ends of a step, at least: a fold is rounded in several."""
ROUNDING_OF_MU, IS_COMPLEX = 10.0, 10.0
"""Rounding of a real part, in units of what one of the point and of the matrix in the last digit makes; and of that the
imaginary part of one of a pair, at least."""
BESIDE_IT = 1e-8
"""A Lyapunov coefficient that changes its sign, or by its size, so far aside in units of the parameter is zero."""

FOLD_POINT, HOPF, BRANCH_POINT, BOUNDARY = "fold", "Hopf", "branch point", "boundary"
"""What is met on a branch of equilibria."""


class Rates(NamedTuple):
    """A field at a point: f (n,), df/dx (n, n), df/dp (n, np)."""

    f: Array
    A: Array
    by_p: Array

    @property
    def finite(self) -> bool:
        """No NaN and no infinity."""
        return all(bool(np.isfinite(part).all()) for part in self)


class NormalForm(NamedTuple):
    """What the module docstring says of a Hopf bifurcation.

    Attributes
    ----------
    omega : frequency.
    q, r : (n,) right and left eigenvector.
    c : the cubic coefficient.
    h_11, h_20 : (n,) second order of the centre manifold.
    l1 : first Lyapunov coefficient; 0 where it is rounding.
    by_p : (np,) complex, derivative of mu + i omega by every parameter, the equilibrium moving along.
    x_by_p : (n, np) how the equilibrium moves.
    """

    omega: float
    q: Array
    r: Array
    c: complex
    h_11: Array
    h_20: Array
    l1: float
    by_p: Array
    x_by_p: Array


@kept(maxsize=16)
def _linearised(field: Field, n: int, parameters: int) -> ca.Function:
    """(x, p, sign) -> f, df/dx, df/dp."""
    x, p, sign = ca.SX.sym("x", n), ca.SX.sym("p", parameters), ca.SX.sym("sign")
    f = field(x, p, sign)
    parts = [ca.densify(part) for part in (f, ca.jacobian(f, x), ca.jacobian(f, p))]
    return ca.Function("linearised", [x, p, sign], parts)


@kept(maxsize=16)
def _forms(field: Field, n: int, parameters: int) -> ca.Function:
    """(x, p, sign, u, v, w) -> B(u, v), C(u, v, w), and d(A u)/dp."""
    x, p, sign = ca.SX.sym("x", n), ca.SX.sym("p", parameters), ca.SX.sym("sign")
    u, v, w = (ca.SX.sym(name, n) for name in "uvw")
    once = ca.jtimes(field(x, p, sign), x, u)
    twice = ca.jtimes(once, x, v)
    parts = [ca.densify(part) for part in (twice, ca.jtimes(twice, x, w), ca.jacobian(once, p))]
    return ca.Function("forms", [x, p, sign, u, v, w], parts)


@alone
def rates(field: Field, sign: float, x: Array, p: Array) -> Rates:
    """The field at a point.

    field, sign: of a mode (hybrid/system.py); x, p: (n,) state and (np,) parameters.
    """
    f, A, by_p = _linearised(field, x.size, p.size)(x, p, sign)
    return Rates(np.array(f).ravel(), np.array(A), np.array(by_p).reshape(x.size, p.size))


def solved(matrix: Array, right: Array) -> Array | None:
    """The solution of linear equations; None where the matrix is singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None


def without_rounding(x: Array, step: Array) -> Array:
    """(n,) a point behind a Newton step (n,): what is no larger than the step is none of its components."""
    return np.where(np.abs(x) <= np.abs(step), 0.0, x)


def at_rest(field: Field, sign: float, x: Array, p: Array) -> Array | None:
    """The equilibrium next to a state, by Newton's method.

    field, sign, x, p: as of `rates`. Returns (n,) state; None where there is none, or not just one.
    """
    for _ in range(REST_ROUNDS):
        here = rates(field, sign, x, p)
        step = solved(here.A, here.f) if here.finite else None
        if step is None:
            return None
        x = x - step
        if np.max(np.abs(step)) <= AT_REST * max(1.0, float(np.max(np.abs(x)))):
            return without_rounding(x, step)
    return None


def growth_rate(field: Field, sign: float, x: Array, p: Array, omega: float) -> float:
    """How fast what turns with a frequency grows next to an equilibrium.

    field, sign, x, p: as of `rates`; the equilibrium is the one next to x.
    Returns real part of the eigenvalue next to i omega; nan where there is no equilibrium.
    """
    x_rest = at_rest(field, sign, x, p)
    if x_rest is None:
        return float("nan")
    values = np.linalg.eigvals(rates(field, sign, x_rest, p).A)
    return float(values[np.argmin(np.abs(values - 1j * omega))].real)


def normal_form(field: Field, sign: float, x: Array, p: Array, omega: float) -> NormalForm:
    """The normal form of a Hopf bifurcation.

    field, sign, x, p: as of `rates`; x is the equilibrium at the bifurcation.
    """
    A, by_p = rates(field, sign, x, p)[1:]
    values, vectors = np.linalg.eig(A)
    k = int(np.argmin(np.abs(values - 1j * omega)))
    omega, q = float(values[k].imag), vectors[:, k] / np.linalg.norm(vectors[:, k])
    others, adjoint = np.linalg.eig(A.T)
    r = adjoint[:, np.argmin(np.abs(others + 1j * omega))]
    r = r / np.conj(np.vdot(r, q))
    forms = partial(_complex_forms, field, sign, x, p)
    h_11 = -np.linalg.solve(A, forms(q, q.conj())[0])
    h_20 = np.linalg.solve(2j * omega * np.eye(x.size) - A, forms(q, q)[0])
    third, (second, turned), last = forms(q, q, q.conj())[1], forms(q, h_11)[::2], forms(q.conj(), h_20)[0]
    parts = np.conj(r) @ np.column_stack([third / 2, second, last / 2])
    c, x_by_p = complex(parts.sum()), -np.linalg.solve(A, by_p)
    known = abs(c.real) > CANCELLED * float(np.abs(parts).sum())
    carried = np.array([forms(q, column)[0] for column in x_by_p.T]).reshape(p.size, x.size).T
    grows = np.conj(r) @ (turned + carried)
    return NormalForm(omega, q, r, c, h_11.real, h_20, c.real / omega if known and omega else 0.0, grows, x_by_p)


def _complex_forms(
    field: Field, sign: float, x: Array, p: Array, u: Array, v: Array, w: Array | None = None
) -> tuple[Array, Array, Array]:
    """B(u, v), C(u, v, w) and d(A u)/dp of complex vectors, by those of their real and imaginary parts."""
    second, third, by_p = np.zeros(x.size, complex), np.zeros(x.size, complex), np.zeros((x.size, p.size), complex)
    w = np.zeros(x.size) if w is None else w
    for (a, of_u), (b, of_v), (c, of_w) in product(*(((1, z.real), (1j, z.imag)) for z in (u, v, w))):
        two, three, change = _real_forms(field, sign, x, p, of_u, of_v, of_w)
        third += a * b * c * three
        if c == 1:
            second += a * b * two
        if b == c == 1:
            by_p += a * change
    return second, third, by_p


@alone
def _real_forms(field: Field, sign: float, x: Array, p: Array, *vectors: Array) -> tuple[Array, Array, Array]:
    """The same of real vectors."""
    second, third, by_p = _forms(field, x.size, p.size)(x, p, sign, *vectors)
    return np.array(second).ravel(), np.array(third).ravel(), np.array(by_p).reshape(x.size, p.size)


def _sorted(mu: Array) -> Array:
    """(n,) complex eigenvalues, the one that grows fastest first."""
    return mu[np.argsort(-mu.real, kind="stable")].astype(complex)


@cache
def _signs(n: int) -> Array:
    """(n, n) of the rounding of a matrix: any will do, and both ways, for a double eigenvalue parts in one or other."""
    return np.random.default_rng(n).choice([-1.0, 1.0], (n, n))


@dataclass(frozen=True, eq=False)
class Place:
    """A point of the curve.

    Attributes
    ----------
    y, tangent, units : (n + 1,) each: (x, lambda), the direction of the curve there, of length one in these units.
    mu, noise : (n,) eigenvalues of f_x by decreasing real part, and what rounding leaves of each.
    inside : above zero where the equilibrium is one of its mode.
    """

    y: Array
    tangent: Array
    units: Array
    mu: Array
    noise: Array
    inside: float

    @property
    def signs(self) -> Array:
        """(n,) of the real parts; 0 where rounding does not tell."""
        return np.where(np.abs(self.mu.real) > self.noise, np.sign(self.mu.real), 0.0)

    @property
    def turning(self) -> Array:
        """(n,) bool: which eigenvalues are one of a complex pair."""
        return np.asarray(np.abs(self.mu.imag) > IS_COMPLEX * self.noise)

    @property
    def growing(self) -> tuple[int, int]:
        """How many real eigenvalues are positive, and how many pairs have a positive real part."""
        grow = self.signs > 0
        return int(np.sum(grow & ~self.turning)), int(np.sum(grow & self.turning)) // 2

    @property
    def orientation(self) -> float:
        """The sign of det f_x; 0 where rounding does not tell."""
        size = np.abs(self.mu)
        return float(np.sign(np.prod(self.mu / size).real)) if np.all(size > self.noise) else 0.0

    def unclear(self, after: Place) -> bool:
        """Whether rounding hides at a point behind this one what it does not hide here."""
        hidden = np.any((after.signs == 0) & (self.signs != 0))
        return bool(hidden or (after.orientation == 0 and self.orientation != 0))

    def det(self, size: float) -> tuple[float, float]:
        """The product of the eigenvalues in units of a size, and its error."""
        off = float(np.max(self.noise / np.maximum(np.abs(self.mu), self.noise)))
        return (det := float(np.prod(self.mu / size).real)), off * abs(det)

    def growth(self, ranks: Array) -> tuple[float, float]:
        """The mean of some of the real parts, by number, and its error."""
        return float(np.mean(self.mu[ranks].real)), float(np.max(self.noise[ranks]))


class Curve:
    """f(x; p) = 0 as a curve in (x, one parameter)."""

    def __init__(self, system: System, mode: str, p: Array, vary: str) -> None:
        self.system, self.p, self.i = system, p, system.names.parameters.index(vary)
        form = system.vector_form
        self.mode, self.exits = form.modes[mode], form.exits[mode]

    def at(self, value: float) -> Array:
        """(np,) the parameters."""
        p = self.p.copy()
        p[self.i] = value
        return p

    def rates(self, y: Array, units: Array) -> tuple[Rates, Array]:
        """The field at a point, and (n, n + 1) [f_x f_p] in some units."""
        here = rates(self.mode.field, self.mode.sign, y[:-1], self.at(y[-1]))
        return here, np.column_stack([here.A, here.by_p[:, self.i]]) * units

    def tangent(self, y: Array, units: Array, like: Array) -> Array | None:
        """The direction of the curve at a point.

        y, units, like: (n + 1,) each: the point, units of its entries, and a direction that it makes an acute angle
        with. Returns (n + 1,) y' in these units, of length one; None where the field is not finite.
        """
        here, matrix = self.rates(y, units)
        if not here.finite:
            return None
        size = np.linalg.norm(matrix, axis=1, keepdims=True)
        found = np.linalg.svd(matrix / np.where(size > 0, size, 1.0))[2][-1]
        return found if float(found @ like) >= 0 else -found

    def corrected(self, y: Array, row: Array, units: Array) -> tuple[Array, int] | None:
        """The point of the curve in a plane.

        y, row, units: (n + 1,) each: a point of the plane, the direction that is orthogonal to it, and the units of
        both. Returns the point and the number of Newton steps; None where they do not converge.
        """
        last = math.inf
        for k in range(CORRECTIONS):
            here, matrix = self.rates(y, units)
            step = solved(np.vstack([matrix, row]), np.append(here.f, 0.0)) if here.finite else None
            if step is None:
                return None
            y = y - step * units
            size = math.hypot(*step) / max(1.0, math.hypot(*(y / units)))
            if size <= CORRECTED or (size <= DOWN_TO_ROUNDING and size > SHRINKS_BY * last):
                return without_rounding(y, step * units), k + 1
            last = size
        return None

    def ahead(self, place: Place, ds: float) -> tuple[Place, int] | None:
        """The point a step further on.

        place, ds: where the step begins, and its length along the tangent there.
        Returns the point and the number of Newton steps; None where the curve turns away.
        """
        guess = place.y + ds * place.tangent * place.units
        found = self.corrected(guess, place.tangent, place.units)
        if found is None or np.linalg.norm((found[0] - guess) / place.units) > abs(ds):
            return None
        tangent = self.tangent(found[0], place.units, place.tangent)
        if tangent is None or float(tangent @ place.tangent) < LEAST_ALONG:
            return None
        return self.place(found[0], tangent, place.units), found[1]

    def in_units(self, place: Place, units: Array) -> Place:
        """A point in other units.

        place, units: the point, and (n + 1,) units of its entries.
        """
        tangent = place.tangent * place.units / units
        return replace(place, tangent=tangent / np.linalg.norm(tangent), units=units)

    def margins(self, y: Array) -> Array:
        """What must not be negative for the equilibrium to be one of the mode: `holds`, and its events."""
        x, p = y[:-1], self.at(y[-1])
        found = [] if self.mode.admissible is None else [float(self.mode.admissible(x, p, self.mode.sign))]
        for way_out in self.exits:
            if not way_out.mark or way_out.reset is not None:
                found.append(-way_out.direction * float(way_out.event.function(x, 0.0, p)))
        return np.array(found)

    def place(self, y: Array, tangent: Array, units: Array) -> Place:
        """A point, its tangent and units (n + 1,) each, as of `Place`, with what is known there."""
        off = np.finfo(float).eps * y * _signs(y.size)[-1]
        A, *others = (self.rates(z, units)[0].A * units[:-1] / units[:-1, None] for z in (y, y + off, y - off))
        rounding = np.finfo(float).eps * float(np.linalg.norm(A)) * _signs(A.shape[0])
        mu, *nearby = (_sorted(np.linalg.eigvals(B)) for B in (A, others[0] + rounding, others[1] - rounding))
        off = np.max([np.abs(mu.real - other.real) for other in nearby], axis=0) + np.max(np.abs(rounding))
        inside = float(np.min(self.margins(y), initial=np.inf))
        inside = inside / (1 + abs(inside)) if math.isfinite(inside) else 1.0
        return Place(y, tangent, units, mu, ROUNDING_OF_MU * off, inside)

    def normal_form(self, place: Place, omega: float) -> NormalForm | None:
        """The normal form of a Hopf bifurcation, its Lyapunov coefficient 0 where it is one of a point aside.

        Returns NormalForm; None where another eigenvalue is zero there, or the pair is two real ones next to it.
        """
        field, sign, x, value = self.mode.field, self.mode.sign, place.y[:-1], float(place.y[-1])
        aside = BESIDE_IT * float(place.units[-1])
        try:
            with np.errstate(all="ignore"):  # of a double pair, which has no normal form, what comes out is not finite
                form = normal_form(field, sign, x, self.at(value), omega)
                other = normal_form(field, sign, x + aside * form.x_by_p[:, self.i], self.at(value + aside), omega)
        except np.linalg.LinAlgError:
            return None
        if not (form.omega > 0 and other.omega > 0 and math.isfinite(abs(form.c))):
            return None
        return form if abs(other.l1 - form.l1) < abs(form.l1) else form._replace(l1=0.0)


def units_of(before: Array, y: Array) -> Array:
    """The units of a point.

    before, y: (n + 1,) those of the point before, zeros for none, and the point.
    Returns (n + 1,) the largest magnitudes so far; 1 for what has been zero.
    """
    larger = np.maximum(np.where(before == 1.0, 0.0, before), np.abs(y))
    return np.where(larger > 0, larger, 1.0)
