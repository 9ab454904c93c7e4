"""S and M of elimination.py as expressions: for one interval that is compiled with its factors.

    M_ef = h T A (diag(J_ef) + sum_c diag(J_ec) M_cf),   S_fg = 1 - h T A (diag(J_fg) + sum_c diag(J_fc) M_cg),  c in E.

Where J_ac is the same at all stages, products of h T A J are powers of A, which are numbers.

Symbols: n states, d stages, step = h T; F the states that stay, E those that are put in terms of them.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from .elimination import kept_states

Array = np.ndarray


class _Polynomial:
    """sum_k coefficients[k] A^k + rest: a (d, d) matrix of which the powers of A are numbers."""

    def __init__(self, A: Array, coefficients: dict[int, ca.SX], rest: ca.SX | None = None) -> None:
        self.A, self.coefficients, self.rest = A, coefficients, rest

    def full(self) -> ca.SX:
        """The matrix."""
        out = ca.SX.zeros(*self.A.shape) if self.rest is None else self.rest
        for k, value in self.coefficients.items():
            out = out + value * ca.DM(np.linalg.matrix_power(self.A, k))
        return out

    def after(self, weights: list[ca.SX], step: ca.SX) -> _Polynomial:
        """step A diag(weights) times it; `weights` has one entry where they are the same."""
        A = ca.DM(self.A)
        if len(weights) > 1:
            if set(self.coefficients) == {0} and self.rest is None:
                row = (step * self.coefficients[0]) * ca.vertcat(*weights).T
                return _Polynomial(self.A, {}, A * ca.repmat(row, len(self.A), 1))
            weighted = ca.repmat(ca.vertcat(*weights), 1, len(self.A)) * self.full()
            return _Polynomial(self.A, {}, step * ca.mtimes(A, weighted))
        factor = step * weights[0]
        rest = None if self.rest is None else factor * ca.mtimes(A, self.rest)
        return _Polynomial(self.A, {k + 1: factor * value for k, value in self.coefficients.items()}, rest)

    def __add__(self, other: _Polynomial) -> _Polynomial:
        both = dict(self.coefficients)
        for k, value in other.coefficients.items():
            both[k] = both[k] + value if k in both else value
        rests = [rest for rest in (self.rest, other.rest) if rest is not None]
        return _Polynomial(self.A, both, rests[0] + rests[1] if len(rests) == 2 else next(iter(rests), None))


class Substitution:
    """Y_e = R_e + sum_f M_ef Y_f, state by state, and what is left to be solved for.

    `rates` (n, n) has the J_ac as lists of one entry or of d, empty where there is none.
    """

    def __init__(self, A: Array, step: ca.SX, rates: list[list[list[ca.SX]]]) -> None:
        present = np.array([[bool(weights) for weights in row] for row in rates])
        self.F, self.E = kept_states(present)
        self.A, self.step, self.rates = A, step, rates
        self._M = {f: {f: _Polynomial(A, {0: ca.SX(1.0)})} for f in self.F}
        for e in self.E:
            self._M[e] = self._sums(e, step)

    def _sums(self, a: int, step: ca.SX) -> dict[int, _Polynomial]:
        """step A sum_c diag(J_ac) M_cf of each f that it contains."""
        sums: dict[int, _Polynomial] = {}
        for c, terms in self._M.items():
            if weights := self.rates[a][c]:
                for f, factor in terms.items():
                    term = factor.after(weights, step)
                    sums[f] = sums[f] + term if f in sums else term
        return sums

    def left(self) -> ca.SX:
        """S, (|F| d, |F| d)."""
        d, rows = len(self.A), []
        for f in self.F:
            sums = self._sums(f, -self.step)
            blocks = [sums[g].full() if g in sums else ca.SX.zeros(d, d) for g in self.F]
            blocks[self.F.index(f)] += np.eye(d)
            rows.append(ca.horzcat(*blocks))
        return ca.vertcat(*rows)

    def of_others(self) -> ca.SX:
        """M, (|E| d, |F| d)."""
        d = len(self.A)
        if not self.E:
            return ca.SX(0, len(self.F) * d)
        zero = ca.SX.zeros(d, d)
        return ca.blockcat([[self._M[e][f].full() if f in self._M[e] else zero for f in self.F] for e in self.E])
