"""The LuGre servo under a constant torque m: its Taylor series, from one change of sign of the velocity to the next.

    J v' = m - sigma0 z - sigma1 z' - sigma2 v,   z' = v - sigma0 s v z/g(v),   s = sgn v
    g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)

With u = s v >= 0, c = s z, M = s m, r = z' s, and the time tau = t/h in a step of h,

    u' = h (M - sigma0 c - sigma1 r - sigma2 u)/J,   c' = h r,   r = u (1 - sigma0 c/g)
    g = Fs - (Fs - Fc) w,   w = 1 - exp(-(u/vs)^2)

The coefficients in tau follow from each other.  A step is as long as the last ones are below rounding, which bounds it
where the bristle is stiff, too, to a part of its swing; so u is zero once in a step at most.  There it ends, and
behind it s is the sign of m - sigma0 z.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from ... import effort
from ...compiled import Caller, caller, kept
from ..friction import Friction
from .slip import LAST_COEFFICIENTS, LEAST_SHARE, LOOKED, ORDER, TAKEN_OFF, UNSEEN_FROM, first_zero, integral, value_at

SMALLEST_TAIL = 1e-300
"""Next to nothing, for a step as long as may be."""


@kept(None)
def _series() -> Caller:
    """(u, c, M, h, J, Fs, Fc, vs, sigma0, sigma1, sigma2) -> coefficients of u and c in tau (ORDER + 1,) each, and the
    last ones of either by its largest."""
    given = ca.SX.sym("given", 11)
    u0, c0, M, h, J, Fs, Fc, vs, sigma0, sigma1, sigma2 = ca.vertsplit(given)
    u, c = [u0], [c0]
    square, w = [(u0 / vs) ** 2], [-ca.expm1(-((u0 / vs) ** 2))]
    rest = [ca.exp(-((u0 / vs) ** 2))]  # 1 - w
    product: list[ca.SX] = []  # u c
    share: list[ca.SX] = []  # u c/g
    for k in range(ORDER):
        product.append(sum(u[i] * c[k - i] for i in range(k + 1)))
        g = Fs - (Fs - Fc) * w[0]
        known = sum(-(Fs - Fc) * w[j] * share[k - j] for j in range(1, k + 1))
        share.append((product[k] - known) / g)
        r = u[k] - sigma0 * share[k]
        torque = (M if k == 0 else 0) - sigma0 * c[k] - sigma1 * r - sigma2 * u[k]
        u.append(h * torque / (J * (k + 1)))
        c.append(h * r / (k + 1))
        square.append(sum(u[i] * u[k + 1 - i] for i in range(k + 2)) / vs**2)
        w.append(sum((j + 1) * square[j + 1] * rest[k - j] for j in range(k + 1)) / (k + 1))
        rest.append(-w[k + 1])
    tails = []
    for series in (u, c):
        size = ca.mmax(ca.fabs(ca.vertcat(*series)))
        tails.append(ca.fmax(ca.fabs(series[-1]), ca.fabs(series[-2])) / ca.fmax(size, SMALLEST_TAIL))
    out = ca.vertcat(ca.fmax(*tails), *u, *c)
    return caller(ca.Function("bristle", [given], [out]), [(11,)], [(2 * ORDER + 3,)])


class Bristles:
    """The motions of one LuGre servo; z: its bristle [rad].

    J, friction: its inertia and friction; z: at the start.
    """

    def __init__(self, J: float, friction: Friction, z: float) -> None:
        buffers = _series().buffers
        (self._given,), (self._found,), self._evaluate = buffers.inputs, buffers.outputs, buffers.trigger
        f = friction
        self._numbers = (J, f.static, f.coulomb, f.stribeck_velocity, f.stiffness, f.damping, f.viscous)
        self.static, self.z, self._stiffness, self._steps = f.static, z, f.stiffness, 0
        self._far, self._next = UNSEEN_FROM * f.stribeck_velocity, math.inf

    def __call__(self, x: float, v: float, m: float, lasts: float) -> tuple[float, float, list[float]]:
        """(x1, v) after `lasts` seconds of the torque m, and the times [s] at which v changes its sign."""
        now, stops = 0.0, []
        while now < lasts:
            pull = m - self._stiffness * self.z
            if v == 0 and pull == 0:
                break
            s = math.copysign(1.0, v if v != 0 else pull)
            u, way, c, taken, stopped = self._step(s * v, s * self.z, s * m, lasts - now)
            now = lasts if taken == lasts - now else now + taken
            x, v, self.z = x + s * way, s * u, s * c
            if stopped:
                pass
                stops.append(now)
        return x, v, stops

    def _share(self, tail: float) -> float:
        """Of a step, that the next one should have."""
        return TAKEN_OFF * (LAST_COEFFICIENTS / max(tail, SMALLEST_TAIL)) ** (1 / ORDER) if tail < np.inf else 0.0

    def _step(self, u: float, c: float, M: float, longest: float) -> tuple[float, float, float, float, bool]:
        """(u, way, c, time, whether v changes its sign there) of one step, of `longest` seconds at most."""
        h = min(longest, self._next)
        while True:
            self._given[:] = u, c, M, h, *self._numbers
            self._evaluate()
            self._steps += 1
            if self._steps % LOOKED == 0:
                effort.pieces(LOOKED)
            tail = float(self._found[0])
            if tail <= LAST_COEFFICIENTS:
                velocity = self._found[1 : ORDER + 2].tolist()
                if u <= self._far or value_at(velocity, 1.0) >= u / 2:
                    break
                h /= 2
                continue
            h *= max(self._share(tail), LEAST_SHARE)
        self._next = h * min(self._share(tail), 1 / LEAST_SHARE)
        bristle = self._found[ORDER + 2 :].tolist()
        end = value_at(velocity, 1.0)
        tau = 1.0 if end > 0 else first_zero(velocity)
        return max(end, 0.0), h * integral(velocity, tau), value_at(bristle, tau), h * tau, end <= 0
