"""Special points of branches of cycles by shooting with scipy's DOP853, and with matrix exponentials.

Smooth systems: (x, T, lambda) with the variational equations at 1e-13, whose Jacobian is taken by complex steps,

    S phi_T(x; lambda) - x = 0,    x_k = c,    g = 0,    M = S dphi_T/dx,

c a section, S a symmetry or 1, and g from the characteristic polynomial of M, the flow's own multiplier divided out:
zero where one is +1 (fold), -1 (flip, symmetry breaking), or two have the product 1 (Neimark-Sacker, n = 3).  On the
branch lambda is held, next to a fold a state: a secant on g.  Hopf points: two eigenvalues of the equilibrium whose sum
is zero.  Piecewise linear ones: exp(A t) of each piece, its durations unknown, the fields continuous at the borders.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

Array = np.ndarray
Rates = Callable[[float, Any, Any], Sequence[Any]]
"""(t, x, lambda) -> the derivatives; of complex arrays as well."""
TINY = 1e-30
TIGHT = 1e-13
ROUNDS = 40
CLOSE = 1e-8
"""A step of Newton's method after which the error is the square of it."""


class Smooth:
    """Cycles of x' = f(t, x; lambda) by shooting.

    Parameters
    ----------
    rates
        f.
    section
        (number of a state, its value) at the start; None for a forced system, whose period is `forced`.
    mirror
        diagonal of S where half a cycle is shot.
    forced
        lambda -> duration of what is shot, of a forced system.
    """

    def __init__(
        self, rates: Rates, section: tuple[int, float] | None = None, mirror: Sequence[float] | None = None,
        forced: Callable[[Any], Any] | None = None,
    ) -> None:  # fmt: skip
        self.rates, self.section, self.mirror, self.forced = rates, section, mirror, forced

    def _f(self, t: Any, x: Any, value: Any) -> Array:
        return np.array([np.broadcast_to(r, np.shape(x[0])) for r in self.rates(t, x, value)])

    def shot(self, x: Array, T: float, value: float) -> tuple[Array, Array, Array]:
        """(end, its derivatives by the start, by lambda), time in parts of T."""
        n = x.size
        speed = (lambda v: self.forced(v)) if self.forced else (lambda v: T)
        steps = np.hstack([np.zeros((n, 1)), 1j * TINY * np.eye(n), np.zeros((n, 1))])
        values = np.append(np.full(n + 1, value, complex), value + 1j * TINY)

        def rates(t: float, y: Array) -> Array:
            z = y.reshape(n, n + 2)
            T_of = np.array([speed(v) for v in values[[0, -1]]])
            T_all = np.append(np.full(n + 1, T_of[0]), T_of[1])
            f = T_all * self._f(t * T_all, z[:, :1] + steps, values)
            A = f[:, 1 : n + 1].imag / TINY
            by_value = A @ z[:, -1] + f[:, -1].imag / TINY
            return np.column_stack([f[:, 0].real, A @ z[:, 1:-1], by_value]).ravel()

        start = np.column_stack([x, np.eye(n), np.zeros(n)]).ravel()
        end = solve_ivp(rates, (0, 1), start, method="DOP853", rtol=TIGHT, atol=TIGHT).y[:, -1].reshape(n, n + 2)
        S = np.ones(n) if self.mirror is None else np.array(self.mirror, float)
        end = S[:, None] * end
        return end[:, 0], end[:, 1:-1], end[:, -1]

    def solved(self, y: Array, held: int) -> tuple[Array, Array]:
        """((x, T, lambda), M) of the cycle next to y, its entry number `held` kept; of a forced one (x, lambda)."""
        y, keep = y.copy(), y[held]
        n = y.size - (1 if self.forced else 2)
        for _ in range(ROUNDS):
            end, M, by_value = self.shot(y[:n], 0.0 if self.forced else y[n], y[-1])
            rows = [np.hstack([M - np.eye(n), np.zeros((n, y.size - n - 1)), by_value[:, None]])]
            residual = [end - y[:n]]
            if self.section is not None:
                f = self._f(0.0, self._back(end), y[-1])
                rows[0][:, n] = f * (1 if self.mirror is None else np.array(self.mirror))
                rows.append(np.eye(y.size)[self.section[0]][None])
                residual.append(np.array([y[self.section[0]] - self.section[1]]))
            rows.append(np.eye(y.size)[held][None])
            residual.append(np.array([y[held] - keep]))
            step = np.linalg.solve(np.vstack(rows), np.concatenate(residual))
            y -= step
            if np.max(np.abs(step) / (1 + np.abs(y))) < CLOSE:
                return y, M
        raise ArithmeticError(f"no cycle next to {y}")

    def _back(self, end: Array) -> Array:
        return end if self.mirror is None else end * np.array(self.mirror)

    def gap(self, kind: str, M: Array) -> float:
        """What vanishes at a special point of that kind."""
        coefficients = np.poly(M).real
        if not self.forced:
            coefficients, _ = np.polydiv(coefficients, [1.0, -1.0])
        if kind == "Neimark-Sacker":
            return float(coefficients[-1] - 1)
        at = np.polyval(coefficients, 1.0 if kind == "fold" else -1.0)
        return float(at / np.max(np.abs(coefficients)))

    def special(self, kind: str, y: Sequence[float], held: int = -1, step: float = 1e-4) -> Array:
        """(x, T, lambda) at the special point next to y; `held` is the entry that the secant moves."""
        a = np.array(y, float)
        a, M = self.solved(a, held)
        ga = self.gap(kind, M)
        b = a.copy()
        b[held] += step * max(1.0, abs(b[held]))
        for _ in range(ROUNDS):
            b, M = self.solved(b, held)
            gb = self.gap(kind, M)
            if gb == ga or abs(b[held] - a[held]) <= 1e-13 * max(1.0, abs(b[held])):
                break
            c = b + (b - a) * (-gb / (gb - ga))
            a, ga, b = b, gb, c
        return b


class Linear:
    """Cycles of piecewise linear motions, forced or not: z' = A_k(lambda) z, z = (x, 1) or (x, cos wt, sin wt, 1).

    Parameters
    ----------
    pieces
        lambda -> A_k of the phases in order.
    borders
        the (row, level) of the border row z = level at the end of each.
    n
        number of the states x.
    turn
        lambda -> the angular frequency of a forced system.
    """

    def __init__(
        self, pieces: Callable[[float], Sequence[Array]], borders: Sequence[tuple[Array, float]], n: int,
        turn: Callable[[float], float] | None = None,
    ) -> None:  # fmt: skip
        self.pieces, self.borders, self.n, self.turn = pieces, borders, n, turn

    def flown(self, y: Array) -> tuple[Array, Array]:
        """(what vanishes on a cycle, its monodromy matrix); y = (x, [phase], durations, lambda)."""
        n, P = self.n, len(self.borders)
        forcing = [np.cos(y[n]), np.sin(y[n])] if self.turn else []
        z, M, off = np.array([*y[:n], *forcing, 1.0]), np.eye(n), []
        for A, (row, level), tau in zip(self.pieces(y[-1]), self.borders, y[-1 - P : -1], strict=True):
            E = expm(A * tau)
            z, M = E @ z, E[:n, :n] @ M
            off.append(row @ z[:n] - level)
        if self.turn:
            off.append(np.sum(y[-1 - P : -1]) - 2 * np.pi / self.turn(y[-1]))
        return np.array([*(z[:n] - y[:n]), *off]), M

    def solved(self, y: Array, held: int) -> tuple[Array, Array]:
        """As of `Smooth`; the last border is met by closing, so its row goes."""
        y, h = y.copy(), 1e-7
        for _ in range(ROUNDS):
            at, M = self.flown(y)
            steps = [(self.flown(y + h * e)[0] - self.flown(y - h * e)[0]) / (2 * h) for e in np.eye(y.size)]
            matrix = np.vstack([np.array(steps).T, np.eye(y.size)[held]])
            step, *_ = np.linalg.lstsq(matrix, np.append(at, 0.0), rcond=None)
            y = y - step
            if np.max(np.abs(step)) < 1e-12:
                break
        return y, M

    def gap(self, kind: str, M: Array) -> float:
        """As of `Smooth`."""
        coefficients = np.poly(M).real
        if not self.turn:
            coefficients, _ = np.polydiv(coefficients, [1.0, -1.0])
        return float(np.polyval(coefficients, 1.0 if kind == "fold" else -1.0))

    special = Smooth.special


def hopf(rates: Rates, x: Sequence[float], value: float) -> float:
    """lambda next to `value` at which the equilibrium next to x has two eigenvalues with the sum zero."""

    def at(value: float, x: Array) -> tuple[float, Array]:
        n = x.size
        for _ in range(ROUNDS):
            f = np.array(
                [
                    np.broadcast_to(r, n + 1)
                    for r in rates(0.0, x[:, None] + np.hstack([np.zeros((n, 1)), 1j * TINY * np.eye(n)]), value)
                ]
            )
            A = f[:, 1:].imag / TINY
            step = np.linalg.solve(A, f[:, 0].real)
            x = x - step
            if np.max(np.abs(step)) < 1e-15 * (1 + np.max(np.abs(x))):
                break
        eig = np.linalg.eigvals(A)
        pair = eig[np.argsort(-np.abs(eig.imag))[:2]]
        return float(pair.sum().real), x

    z = np.array(x, float)
    a, b = value, value * (1 + 1e-4)
    fa, z = at(a, z)
    for _ in range(ROUNDS):
        fb, z = at(b, z)
        if fb == fa or abs(b - a) < 1e-15 * abs(b):
            break
        a, b, fa = b, b - fb * (b - a) / (fb - fa), fb
    return b
