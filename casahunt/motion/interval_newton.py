"""Newton's method for one interval as a compiled function: a step, and chords with what it has factorised.

    S Y_F = rhs,   Y_E = R + M Y_F,   X <- X - Y        (substitution.py)

S is factorised without pivoting: it tends to the identity as the interval becomes short.  Where a pivot is small or
zero, steps do not shrink or are no numbers, and whoever called makes the interval shorter.  Steps that go on with the
same factors (chords) cost a fifth of a first one, and how much shorter they are tells what is left.

Where the interval begins is a polynomial, extrapolated or cut off; it need not be close.

Symbols: n states, d stages, R = n (d + 1), c nodes of the scheme; all states scaled.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.polynomial import legendre

from ..collocation.scheme import Kind, Scheme, scheme
from ..collocation.substitution import Substitution
from ..compiled import Caller, caller, kept
from ..hybrid.system import Field

Array = np.ndarray

CHORDS = 2
"""Steps with the factors of the first one."""
MOST_UNKNOWNS = 24
"""Rows of S up to which it is spelt out; beyond, numpy's LU is faster, and the function would take long to build."""


def _triangular(S: ca.SX) -> tuple[list[ca.SX], list[ca.SX], list[ca.SX]]:
    """Columns of L below its diagonal, rows of U right of it, and the inverse pivots."""
    lower, upper, inverse = [], [], []
    while S.size1() > 0:
        inverse.append(1 / S[0, 0])
        lower.append(S[1:, 0] * inverse[-1])
        upper.append(S[0, 1:])
        S = S[1:, 1:] - ca.mtimes(lower[-1], upper[-1])
    return lower, upper, inverse


def _solved(factors: tuple[list[ca.SX], list[ca.SX], list[ca.SX]], rhs: ca.SX) -> ca.SX:
    """S^-1 rhs."""
    pivots, rest = [], rhs
    for below in factors[0]:
        pivots.append(rest[0])
        rest = rest[1:, 0] - below * rest[0]
    found = ca.SX(0, 1)
    for pivot, right, inverse in zip(*(reversed(part) for part in (pivots, *factors[1:])), strict=True):
        found = ca.vertcat((pivot - ca.mtimes(right, found) if found.numel() else pivot) * inverse, found)
    return found


def _foretold(s: Scheme, w: ca.SX, begins: ca.SX, part: ca.SX) -> ca.SX:
    """(d, n) the polynomial through w (d + 1, n) at the local times begins + part c, by its Legendre coefficients."""
    coefficients = ca.mtimes(ca.DM(np.linalg.inv(legendre.legvander(2 * s.points - 1, s.degree))), w)
    t = 2 * (begins + part * ca.DM(s.stages)) - 1
    basis = [ca.SX.ones(s.degree, 1), t]
    for k in range(1, s.degree):
        basis.append(((2 * k + 1) * t * basis[k] - k * basis[k - 1]) / (k + 1))
    return ca.mtimes(ca.horzcat(*basis[: s.degree + 1]), coefficients)


class _Equations:
    """The stages' equations along a field; step length, sign, p and scale are symbols of whoever asks."""

    def __init__(self, field: Field, n: int, s: Scheme, step: ca.SX, others: Sequence[ca.SX]) -> None:
        sign, p, scale = others
        z = ca.SX.sym("z", n)
        f = ca.densify(ca.SX(field(scale * z, p, sign)) / scale)
        J = ca.jacobian(f, z)
        places = list(zip(*J.sparsity().get_triplet(), strict=True))
        varies = ca.which_depends(ca.vertcat(*J.nonzeros()), z, 1, True) if places else []
        self.varies = dict(zip(places, varies, strict=True))
        self._f = ca.Function("rate", [z, *others], [f])
        self._jet = ca.Function("jet", [z, *others], ca.cse([f, J]))
        self.s, self.n, self.step, self.A, self._fixed = s, n, step, ca.DM(s.matrix), others

    def __call__(self, X: ca.SX, x: ca.SX) -> tuple[ca.SX, list[list[list[ca.SX]]]]:
        """(d, n) X - x - step A f(X), and the df_a/dx_c there: of every stage where it varies, else one or none."""
        jets = [self._jet(X[j, :].T, *self._fixed) for j in range(self.s.degree)]
        rates: list[list[list[ca.SX]]] = [[[] for _ in range(self.n)] for _ in range(self.n)]
        for (a, c), varies in self.varies.items():
            rates[a][c] = [jet[1][a, c] for jet in jets] if varies else [jets[0][1][a, c]]
        return self._residual(X, x, [jet[0] for jet in jets]), rates

    def residual(self, X: ca.SX, x: ca.SX) -> ca.SX:
        """The first of these alone."""
        return self._residual(X, x, [self._f(X[j, :].T, *self._fixed) for j in range(self.s.degree)])

    def _residual(self, X: ca.SX, x: ca.SX, fields: list[ca.SX]) -> ca.SX:
        return X - ca.repmat(x.T, self.s.degree, 1) - self.step * ca.mtimes(self.A, ca.horzcat(*fields).T)


class _Reduced:
    """S, factorised, for steps with any residual (d, n)."""

    def __init__(self, equations: _Equations, rates: list[list[list[ca.SX]]]) -> None:
        d = equations.s.degree
        reduced = Substitution(equations.s.matrix, equations.step, rates)
        self.F, self.E, self.rates, self.equations = reduced.F, reduced.E, rates, equations
        self.rows = len(self.F) * d
        if self.rows > MOST_UNKNOWNS:
            return
        self.factors, self.M = _triangular(reduced.left()), reduced.of_others()
        self.order = np.argsort([*self.F, *self.E]).tolist()

    def step(self, residual: ca.SX, first: bool) -> ca.SX:
        """(d, n) Y; behind the first step nothing is left of the equations that are linear."""
        known: dict[int, ca.SX] = {}
        for e in self.E:
            nothing = not first and all(len(weights) <= 1 for weights in self.rates[e])
            own = ca.SX(self.equations.s.degree, 1) if nothing else residual[:, e]
            known[e] = own + self._integral(e, known)
        Y_F = _solved(self.factors, ca.vertcat(*(residual[:, f] + self._integral(f, known) for f in self.F)))
        Y = ca.vertcat(Y_F, ca.vertcat(*known.values()) + ca.mtimes(self.M, Y_F)) if self.E else Y_F
        return ca.reshape(Y, -1, self.equations.n)[:, self.order]

    def _integral(self, a: int, known: dict[int, ca.SX]) -> ca.SX:
        """step A sum_c diag(J_ac) R_c, c in E."""
        found = ca.SX(self.equations.s.degree, 1)
        for c, R in known.items():
            if weights := self.rates[a][c]:
                found += (weights[0] if len(weights) == 1 else ca.vertcat(*weights)) * R
        return self.equations.step * ca.mtimes(self.equations.A, found)


@kept(maxsize=64)
def newton_steps(field: Field, n: int, parameters: int, degree: int, kind: Kind) -> Caller | None:
    """A Newton step and `CHORDS` chords for one interval.

    field: f(x, p, sign) of the mode.
    Returns caller of x (n), w (R) and (begins, part), the polynomial at whose local times begins + part c the stages
    begin, step length, sign, p, scale.  Outputs: stages (d n); end (n); largest |step| of each of the 1 + `CHORDS`
    steps, then the largest |x| and |X|, the largest last Legendre coefficient, and the sum of x and X, which is no
    number where one of them is none: the maximum of a number and none is the number.  None where S has too many rows.
    """
    s = scheme(degree, kind)
    x, w, place = ca.SX.sym("x", n), ca.SX.sym("w", n, degree + 1), ca.SX.sym("place", 2)
    step, sign = ca.SX.sym("step"), ca.SX.sym("sign")
    p, scale = ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    equations = _Equations(field, n, s, step, (sign, p, scale))
    X = _foretold(s, w.T, place[0], place[1])
    residual, rates = equations(X, x)
    reduced = _Reduced(equations, rates)
    if reduced.rows > MOST_UNKNOWNS:
        return None
    sizes = []
    for k in range(1 + CHORDS):
        Y = reduced.step(residual if k == 0 else equations.residual(X, x), k == 0)
        sizes.append(ca.mmax(ca.fabs(Y)))
        X = X - (Y if k == 0 else (sizes[k] < sizes[k - 1]) * Y)  # where they grow, the next step is better
    points = ca.vertcat(x.T, X)
    end = ca.mtimes(ca.DM(s.interpolation(np.array([1.0]))), points).T
    error = ca.mmax(ca.fabs(ca.mtimes(ca.DM(s.last_mode).T, points)))
    told = ca.vertcat(*sizes, ca.mmax(ca.fabs(points)), error, ca.sum1(ca.sum2(points)))
    outputs = [ca.densify(out) for out in (ca.vec(X.T), end, told)]
    function = ca.Function("newton", [x, w, place, step, sign, p, scale], outputs)
    return caller(function, [n, (degree + 1, n), 2, 1, 1, parameters, n], [degree * n, n, CHORDS + 4])
