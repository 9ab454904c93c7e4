"""The stages of the intervals of many members eliminated, as elimination.py does for one.

With the notation there, and every array with its stages last, so that h T A is applied to all intervals of a member by
one product with A^T:

    Y_e = R_e + sum_f M_ef Y_f         states E that are integrals of others, put in terms of the others F
    S Y_F = rhs                        |F| d rows, stacked solves
    Y_e = K_e + h T A sum_c diag(J_ec) Y_c

Symbols: B members, n states, d stages, N intervals, m directions,
c = n + 2 + m columns [residual | d/dx | d/dT | d/dq].
"""

from __future__ import annotations

import numpy as np

from ..compiled import kept
from ..hybrid.system import Field
from .elimination import kept_states
from .ensemble_points import Jets, jacobian_pattern
from .transcription import Transcription

Array = np.ndarray


def eliminate_many(
    t: Transcription, w: Array, x_next: Array, step: Array, fractions: Array, jets: Jets
) -> tuple[Array, Array, Array]:
    """The intervals without their stages.

    w, x_next: (B, N, d + 1, n) starts and stages, (B, N, n) next nodes; step, fractions: (B, N) durations h T of the
    intervals, and h. Returns (residual (B, N, R), eliminated (B, N, n d, c), maps (B, N, n, c)); NaN for a member with
    a singular interval.
    """
    reduced = _Reduced(t, step, jets.J)
    B, N, n, d = len(w), t.intervals, t.n, t.degree
    known, residual = _known(t, w, x_next, step, fractions, jets)
    Y = reduced.solved(known)
    stages = np.empty((B, N, d, n, known.shape[-2]))
    for a in range(n):
        stages[:, :, :, a] = Y[a].transpose(0, 1, 3, 2)
    end = t.scheme.interpolation(np.array([1.0]))[0]
    maps = np.stack([-np.matmul(Y[a].reshape(B, -1, d), end[1:]).reshape(B, N, -1) for a in range(n)], axis=2)
    maps[..., 0] += np.matmul(known[:, :, :, 0], end[1:]).transpose(1, 2, 0) - residual[:, :, d]
    own = np.arange(n)
    maps[:, :, own, 1 + own] += end[0]
    return residual.reshape(B, N, -1), stages.reshape(B, N, d * n, -1), maps


def _known(
    t: Transcription, w: Array, x_next: Array, step: Array, fractions: Array, jets: Jets
) -> tuple[Array, Array]:
    """(K (n, B, N, c, d) of every state, residual (B, N, d + 1, n) of stages and node)."""
    n, d, m, h = t.n, t.degree, jets.q.shape[1], fractions[..., None]
    At, b, hT = np.ascontiguousarray(t.scheme.matrix.T), t.scheme.weights, step[..., None]
    sums = np.matmul(jets.f, At)
    K = np.zeros((n, len(w), t.intervals, n + 2 + m, d))
    stages = w[:, :, 1:].transpose(3, 0, 1, 2)
    K[..., 0, :] = stages - w[:, :, 0].transpose(2, 0, 1)[..., None] - hT * sums
    for a in range(n):
        K[a, :, :, 1 + a] = -1.0
    K[..., n + 1, :] = -h * sums
    for k in range(m):
        K[..., n + 2 + k, :] = -hT * np.matmul(jets.q[:, k], At)
    residual = np.empty_like(w)
    residual[:, :, :d] = K[..., 0, :].transpose(1, 2, 3, 0)
    residual[:, :, d] = x_next - w[:, :, 0] - step[..., None] * np.matmul(jets.f, b).transpose(1, 2, 0)
    return K, residual


@kept(maxsize=32)
def _plan(fields: tuple[Field, ...], n: int, parameters: int) -> tuple[Array, tuple[int, ...], tuple[int, ...]]:
    """(which rates contain which states, in any of the fields (n, n), F, E)."""
    rates = np.zeros((n, n), dtype=bool)
    for field in fields:
        for place in jacobian_pattern(field, n, parameters):
            rates[place] = True
    return rates, *kept_states(rates)


class _Reduced:
    """The stage systems of all intervals, put in terms of the states F."""

    def __init__(self, t: Transcription, step: Array, J: Array) -> None:
        self._rates, self.F, self.E = _plan(tuple(field for field, _ in t.groups), t.n, len(t.cycle.parameters))
        self._J, self._At = J, np.ascontiguousarray(t.scheme.matrix.T)
        self._hT = step[..., None, None]
        d = t.degree
        M: dict[int, dict[int, Array]] = {}
        for e in self.E:
            M[e] = self._integrals_of(e, M)
        S = np.zeros((*step.shape, len(self.F) * d, len(self.F) * d))
        for i, f in enumerate(self.F):
            for g, term in self._integrals_of(f, M).items():
                k = self.F.index(g)
                S[:, :, i * d : (i + 1) * d, k * d : (k + 1) * d] = -term.swapaxes(2, 3)
        own = np.arange(len(self.F) * d)
        S[:, :, own, own] += 1.0
        self._S = S

    def _integrals_of(self, a: int, M: dict[int, dict[int, Array]]) -> dict[int, Array]:
        """h T A sum_c diag(J_ac) M_cf by f, transposed: (B, N, d, d)."""
        found: dict[int, Array] = {}
        for f in self.F:
            terms = [self._J[a, e][:, :, None] * M[e][f] for e in self.E if self._rates[a, e] and f in M.get(e, {})]
            if terms:
                found[f] = self._applied(sum(terms[1:], terms[0]))
            if self._rates[a, f]:
                direct = (self._hT * self._J[a, f][..., None]) * self._At
                found[f] = found[f] + direct if f in found else direct
        return found

    def _applied(self, values: Array) -> Array:
        """h T A applied to the stages of (B, N, k, d)."""
        B, N, k, d = values.shape
        return self._hT * np.matmul(values.reshape(B, N * k, d), self._At).reshape(B, N, k, d)

    def _with_integrals(self, a: int, known: Array, Y: dict[int, Array]) -> Array:
        """K_a + h T A sum_c diag(J_ac) Y_c over the states c in Y."""
        terms = [self._J[a, c][:, :, None] * Y[c] for c in Y if self._rates[a, c]]
        return known[a] + self._applied(sum(terms[1:], terms[0])) if terms else known[a]

    def solved(self, known: Array) -> dict[int, Array]:
        """Y by state, (B, N, c, d)."""
        _, B, N, c, d = known.shape
        R: dict[int, Array] = {}
        for e in self.E:
            R[e] = self._with_integrals(e, known, R)
        rhs = np.concatenate([self._with_integrals(f, known, R) for f in self.F], axis=3)
        found = _solved(self._S, rhs.swapaxes(2, 3)).reshape(B, N, len(self.F), d, c)
        Y = {f: np.ascontiguousarray(found[:, :, i].swapaxes(2, 3)) for i, f in enumerate(self.F)}
        for e in self.E:
            Y[e] = self._with_integrals(e, known, Y)
        return Y


def _solved(K: Array, known: Array) -> Array:
    """K^-1 known, stacked; NaN for a member one of whose intervals is singular."""
    try:
        return np.linalg.solve(K, known)
    except np.linalg.LinAlgError:
        out = np.full_like(known, np.nan)
        for b in range(len(K)):
            try:
                out[b] = np.linalg.solve(K[b], known[b])
            except np.linalg.LinAlgError:
                continue
        return out
