"""Equilibria of one smooth field, and how it behaves next to them.

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

from functools import partial
from itertools import product
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..compiled import alone, kept
from ..hybrid.system import Field

Array = np.ndarray

AT_REST, REST_ROUNDS = 1e-13, 20
"""Newton's method for the equilibrium ends at a step of this relative size."""
CANCELLED = 1e-12
"""Sums that are less than this part of their terms are rounding."""


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


def at_rest(field: Field, sign: float, x: Array, p: Array) -> Array | None:
    """The equilibrium next to a state, by Newton's method.

    field, sign, x, p: as of `rates`. Returns (n,) state; None where there is none, or not just one.
    """
    for _ in range(REST_ROUNDS):
        here = rates(field, sign, x, p)
        if not here.finite:
            return None
        try:
            step = np.linalg.solve(here.A, here.f)
        except np.linalg.LinAlgError:
            return None
        x = x - step
        if np.max(np.abs(step)) <= AT_REST * max(1.0, float(np.max(np.abs(x)))):
            return x
    return None


def growth(field: Field, sign: float, x: Array, p: Array, omega: float) -> float:
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
