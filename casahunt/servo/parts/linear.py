"""The linear loop of a loop of parts, as that of a servo (linear_loop.py): without dry friction, opened at the torque.

    x' = A x + b u,   demand = -c x,   u = demand: the closed loop is A - b c
    L(s) = c (s I - A)^-1 b = (n_0 s^(n-1) + ... + n_(n-1)) / (s^n + d_1 s^(n-1) + ... + d_n)
    n_k = sum over i <= k of d_i h_(k-i),   h_k = c A^k b the Markov parameters: what is zero comes out as zero

Viscous friction stays.  Only a loop of which every part has one law and no event is linear: in a dead band, or with
a reset, there are no margins.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ..delayed_loop import Margins
from ..linear_loop import gain_crossovers, phase_crossovers
from .loop import Loop
from .part import Part
from .wiring import Signals, wired

Array = np.ndarray

NO_COEFFICIENT = 1e-12
"""A coefficient of the characteristic polynomial below this part of what its degree would have is zero."""
OPENED = Part("opened loop", gives={"torque": lambda x, s, p: p.opened})
VISCOUS = Part("viscous friction", gives={
    "friction": lambda x, s, p: p.viscous * s.motor_rate, "moving": lambda x, s, p: 1.0,
    "direction": lambda x, s, p: 0.0,
})  # fmt: skip


def linear_margins(loop: Loop) -> Margins | None:
    """Margins of the loop without dry friction; None where it is not linear, or its friction has no viscous part."""
    matrices = _opened(loop)
    if matrices is None:
        return None
    A, b, c = matrices
    numerator, denominator = _polynomials(A, b, c)
    crossovers = gain_crossovers(numerator, denominator)
    if not crossovers:
        return None
    stable = _closed_is_stable(A, b, c)
    least = min(crossovers, key=lambda at: at.margin % 360 if stable else at.margin)
    if not stable:
        return Margins(least.frequency, min(least.margin, 0.0), math.nan, math.nan, False)
    factors = [at.margin for at in phase_crossovers(numerator, denominator)]
    low, high = max((f for f in factors if f < 1), default=0.0), min((f for f in factors if f > 1), default=math.inf)
    return Margins(least.frequency, least.margin % 360, low, high, True)


def linear_stable(loop: Loop) -> bool | None:
    """Whether the loop without dry friction is stable; None where it is not linear."""
    matrices = _opened(loop)
    return None if matrices is None else _closed_is_stable(*matrices)


def _closed_is_stable(A: Array, b: Array, c: Array) -> bool:
    return bool(np.linalg.eigvals(A - np.outer(b, c)).real.max() < 0)


def _opened(loop: Loop) -> tuple[Array, Array, Array] | None:
    """A (n, n), b (n,), c (n,); None where there are none."""
    rough = [part for part in loop.present if any("friction" in {**part.gives, **m.law.gives} for m in part.modes)]
    others = [part for part in loop.present if part not in rough]
    numbers = loop.parameters
    if "viscous" not in numbers or any(len(part.modes) > 1 or part.modes[0].ends or part.upon for part in others):
        return None
    parts = [*others, VISCOUS, OPENED]
    wiring = wired(tuple((part, part.modes[0].law, None) for part in parts))
    states = [state for part in parts for state in part.states]
    x, u = {state: ca.SX.sym(state) for state in states}, ca.SX.sym("u")
    seen, p = SimpleNamespace(**x), SimpleNamespace(**numbers, opened=u)
    rates, at = wiring.field(seen, p), ca.vertcat(*x.values())
    rate = ca.vertcat(*[rates[state] for state in states])
    slopes = ca.jacobian(rate, at), ca.jacobian(rate, u), ca.jacobian(-Signals(wiring, seen, p).demand, at)
    if any(ca.symvar(slope) for slope in slopes):
        return None
    A, b, c = (np.array(ca.DM(slope)) for slope in slopes)
    return A, b[:, 0], c[0]


def _polynomials(A: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Numerator and denominator of L(s), highest power first."""
    denominator = np.real(np.poly(A))
    n, scale = len(b), float(np.abs(np.linalg.eigvals(A)).max())
    denominator[np.abs(denominator) <= NO_COEFFICIENT * scale ** np.arange(n + 1)] = 0.0
    markov, column = [], b
    for _ in range(n):
        markov.append(float(c @ column))
        column = A @ column
    return np.convolve(denominator, markov)[:n], denominator
