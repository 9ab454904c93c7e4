"""Functions (x, p) of wired parts, such as a system has them: equal where their parts and laws are.

    field   x' = f(x; p);   flow   x(t), where f is affine with a nilpotent matrix;   scalars, and resets, of one part
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from .part import Function
from .wiring import Wiring, packed, unpacked


class Compared:
    """What is compared by its class and `key`, so that equal loops share what is compiled."""

    key: tuple[Any, ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Compared) and type(self) is type(other) and self.key == other.key

    def __hash__(self) -> int:
        return hash((type(self), self.key))

    def __reduce__(self) -> Any:
        wiring: Wiring = self.key[0]
        return _made_again, (type(self), wiring, packed(self.key[1:], wiring.parts))


def _made_again(kind: Callable[..., Compared], wiring: Wiring, others: Any) -> Compared:
    return kind(wiring, *unpacked(others))


class FieldOf(Compared):
    """(x, p) -> the derivative of every state."""

    def __init__(self, wiring: Wiring) -> None:
        self.key = (wiring,)

    def __call__(self, x: Any, p: Any) -> dict[str, Any]:
        wiring: Wiring = self.key[0]
        return wiring.field(x, p)


class ScalarOf(Compared):
    """(x, p) -> a scalar of one part: an event, a condition, a feature."""

    def __init__(self, wiring: Wiring, function: Function, sign: float | None) -> None:
        self.key = wiring, function, sign

    def __call__(self, x: Any, p: Any) -> Any:
        wiring, function, sign = self.key
        return wiring.value(function, sign, x, p)


class ResetOf(Compared):
    """(x, p) -> the states that jump, by name."""

    def __init__(self, wiring: Wiring, jumps: tuple[tuple[str, Function], ...], sign: float | None) -> None:
        self.key = wiring, jumps, sign

    def __call__(self, x: Any, p: Any) -> dict[str, Any]:
        wiring, jumps, sign = self.key
        return {state: wiring.value(function, sign, x, p) for state, function in jumps}


class FlowOf(Compared):
    """(x, t, p) -> the states a time t later, where the field is affine and its matrix A nilpotent, A^n = 0.

    x(t) = x + sum over k of t^k/k! A^(k-1) f(x): while the servo sticks nothing moves but integrators.
    """

    def __init__(self, wiring: Wiring, states: tuple[str, ...]) -> None:
        self.key = wiring, states

    def __call__(self, x: Any, t: Any, p: Any) -> dict[str, Any]:
        wiring, states = self.key
        here = ca.vertcat(*[getattr(x, state) for state in states])
        f = wiring.field(x, p)
        rate, moved, factor = ca.vertcat(*[f[state] for state in states]), here, 1.0
        A = ca.jacobian(rate, here)
        for k in range(1, len(states) + 1):
            factor = factor * t / k
            moved, rate = moved + factor * rate, ca.mtimes(A, rate)
        return {state: moved[i] for i, state in enumerate(states)}


def nilpotent(rate: ca.SX, x: ca.SX) -> bool:
    """Whether a field of symbols is affine, with a matrix of which a power vanishes: its structure says it."""
    A = ca.jacobian(rate, x)
    if not ca.jacobian(ca.vec(A), x).is_zero():
        return False
    power = A
    for _ in range(x.numel() - 1):
        power = ca.mtimes(power, A)
    return bool(ca.sparsify(power).nnz() == 0)
