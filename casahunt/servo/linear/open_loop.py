"""The loop without dry friction, opened at the torque: a rational transfer function.

    one inertia       L(s) = K cm C(s) / (s (J s + sigma2)),    C(s) of controller.py at K = 1
    a loop of parts   x' = A x + b u,   torque that is demanded = -c x:
                      L(s) = c (s I - A)^-1 b = (n_0 s^(n-1) + ... + n_(n-1)) / (s^n + d_1 s^(n-1) + ... + d_n)
                      n_k = sum over i <= k of d_i h_(k-i),   h_k = c A^k b: what is zero comes out as zero

Viscous friction stays.  Only a loop of which every part has one law and no event is linear: in a dead band, or with
a reset, there is no L.  Stability is that of denominator + numerator, by Routh's array, not by rounded poles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import casadi as ca
import numpy as np

from ...checks import COMPUTED, sensible
from ...errors import InputError
from ..parts.loop import Loop
from ..parts.part import Part
from ..parts.wiring import Signals, wired
from ..servo import Servo, a_servo

Array = np.ndarray

NO_COEFFICIENT = 1e-12
"""A coefficient of the characteristic polynomial below this part of what its degree would have is zero."""
OPENED = Part("opened loop", gives={"torque": lambda x, s, p: p.opened})
VISCOUS = Part("viscous friction", gives={
    "friction": lambda x, s, p: p.viscous * s.motor_rate, "moving": lambda x, s, p: 1.0,
    "direction": lambda x, s, p: 0.0,
})  # fmt: skip


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """L(s).

    Attributes
    ----------
    numerator, denominator : coefficients, highest power first.
    """

    numerator: Array
    denominator: Array

    def response(self, omega: Array | float, delay: float = 0.0) -> Array:
        """L(i omega) exp(-i omega delay) at frequencies (m,) [rad/s]; complex ones are i times a point of the plane."""
        s = 1j * np.asarray(omega)
        L = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(L * np.exp(-s * delay) if delay else L)

    @property
    def closed(self) -> Array:
        """The characteristic polynomial of the closed loop, highest power first."""
        return np.polyadd(self.numerator, self.denominator)

    @property
    def poles(self) -> Array:
        """(n,) poles of the closed loop [1/s], by falling real part."""
        poles = np.roots(self.closed)
        return poles[np.lexsort((-poles.imag, -poles.real))]

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable."""
        return is_hurwitz(self.closed)


def open_loop(servo: Servo | Loop, gain: float | None = None) -> OpenLoop:
    """L of a servo at a gain [V/rad], or of a loop of parts, which has its own.

    Raises InputError: a gain out of range, or that a loop of parts has itself; or a loop that is not linear.
    """
    if isinstance(servo, Loop):
        if gain is not None:
            raise InputError("gain: must be left out, a loop of parts has its own: loop.replace(gain=...)")
        found = open_loop_of_parts(servo)
        if found is None:
            raise InputError(f"{servo.name}: is not linear: {_not_linear(servo)}; there are no margins")
        return found
    a_servo(servo)
    gain = sensible("gain", gain, power=COMPUTED)
    numerator, factor = servo.controller.polynomials
    denominator = factor * np.array([servo.inertia, servo.friction.viscous, 0.0, 0.0])
    return OpenLoop(np.trim_zeros(gain * servo.motor_gain * numerator, "f"), denominator)


def is_hurwitz(polynomial: Sequence[float] | Array) -> bool:
    """Whether all roots lie to the left of the imaginary axis: the first column of Routh's array has one sign."""
    c = np.trim_zeros(np.asarray(polynomial, float), "f")
    above, row = c[::2], c[1::2]
    for _ in range(c.size - 1):
        if not row[0] / above[0] > 0:
            return False
        reach = np.append(row[1:], np.zeros(above.size - row.size))
        above, row = row, above[1:] - above[0] / row[0] * reach
    return True


def open_loop_of_parts(loop: Loop) -> OpenLoop | None:
    """L of a loop of parts; None where it is not linear, or its friction has no viscous part."""
    if _not_linear(loop):
        return None
    parts = [*_others(loop), VISCOUS, OPENED]
    wiring = wired(tuple((part, part.modes[0].law, None) for part in parts))
    x, u = {state: ca.SX.sym(state) for part in parts for state in part.states}, ca.SX.sym("u")
    seen, p = SimpleNamespace(**x), SimpleNamespace(**loop.parameters, opened=u)
    rates, at = wiring.field(seen, p), ca.vertcat(*x.values())
    rate = ca.vertcat(*[rates[state] for state in x])
    slopes = ca.jacobian(rate, at), ca.jacobian(rate, u), ca.jacobian(-Signals(wiring, seen, p).demand, at)
    if any(ca.symvar(slope) for slope in slopes):
        return None
    A, b, c = (np.array(ca.DM(slope)) for slope in slopes)
    return OpenLoop(*_polynomials(A, b[:, 0], c[0]))


def linear_stable(loop: Loop) -> bool | None:
    """Whether a loop of parts without dry friction is stable; None where it is not linear."""
    opened = open_loop_of_parts(loop)
    return None if opened is None else opened.stable


def _others(loop: Loop) -> list[Part]:
    """The parts that are not the friction."""
    return [part for part in loop.present
            if not any("friction" in {**part.gives, **mode.law.gives} for mode in part.modes)]  # fmt: skip


def _not_linear(loop: Loop) -> str:
    """Why a loop is not linear, as far as its parts say it; "" where it may be."""
    if "viscous" not in loop.parameters:
        return "its friction has no viscous part"
    switching = [part.name for part in _others(loop) if len(part.modes) > 1 or part.modes[0].ends or part.upon]
    return f"{' and '.join(switching)} switch" if switching else ""


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
