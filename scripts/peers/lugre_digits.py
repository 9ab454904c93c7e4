"""Half a LuGre cycle in extended or quadruple precision: heyoka's adaptive Taylor series with events.

    x1' = x2,   J x2' = m - (s0 z + s1 z' + s2 x2),   x3' = x1,   z' = x2 - s0 s x2 z/g(x2),   s = sign of x2

From x1 = 0 in mid-slip, y = (x2, x3, z), to the next x1 = 0; every x2 = 0 on the way is an event at which s becomes the
sign of the net torque.  The symmetric cycle is y = -Phi(y), found by Newton with differences of Phi, its half
multiplier the leading eigenvalue of -dPhi/dy.  Explicit steps, small ones through a stiff stick, but of a few
microseconds each in extended precision (mantissa 64 bits), some thirty times more in quadruple precision (113 bits),
which multipliers above 1e5 need.  No collocation, no CasADi, nothing shared with the program but the equations.

Needs heyoka (`pip install heyoka`), which is no dependency of the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from typing import Any

import numpy as np

from casahunt import Servo

from .switch_digits import Lost, Truth, shape


@dataclass(frozen=True)
class Precision:
    """A floating-point type of heyoka, its rounding, relative differences for derivatives, steps that end Newton."""

    real: Any
    eps: float
    step: float
    last: float


EXTENDED = Precision(np.longdouble, 2.0**-63, 1e-9, 1e-15)


def quadruple() -> Precision:
    """113 bits.  A small difference: rounding is far below, and a multiplier of 1e9 bends the map within 1e-15."""
    import heyoka as hy

    return Precision(hy.real128, 2.0**-112, 1e-22, 1e-25)


MOST_REVERSALS = 400
FAST, SHARE = 2.0, 0.3
"""Speed in vs above which steps are kept short, and the part of the speed that may be lost in one."""
FARTHEST = 0.1
"""Largest relative distance of a solution from its guess."""
STEEP, BENT = 1e3, 1e-6
"""Ratio of the first two singular values, and relative closure error, above which the leading direction goes first."""


@dataclass(frozen=True, eq=False)
class Half:
    """y at the next x1 = 0 (3,), the time it took [s], the largest |x1| [rad], the steps taken."""

    y: Any
    duration: Any
    largest: Any
    steps: int


@lru_cache(maxsize=4)
def _integrator(events: bool, real: Any) -> Any:
    import heyoka as hy

    x1, x2, x3, z = hy.make_vars("x1", "x2", "x3", "z")
    J, kp, kd, ki, Fs, Fc, vs, s2, s0, s1, s = (hy.par[i] for i in range(11))
    g = Fc + (Fs - Fc) * hy.exp(-(x2 / vs) * (x2 / vs))
    rate = x2 - s0 * s * x2 * z / g
    m = -(kp * x1 + kd * x2 + ki * x3)
    system = [(x1, x2), (x2, (m - (s0 * z + s1 * rate + s2 * x2)) / J), (x3, x1), (z, rate)]
    return hy.taylor_adaptive(
        system, state=np.array([real(1)] * 4), pars=np.array([real(1)] * 11), fp_type=real,
        t_events=[hy.t_event(e, fp_type=real) for e in (x2, x1, x2 * x2 - FAST**2 * vs * vs)] if events else [],
    )  # fmt: skip


def _parameters(servo: Servo, gain: Any, real: Any) -> Any:
    f = servo.friction
    factor = real(gain) * real(servo.motor_gain)
    return np.array([real(value) for value in (
        servo.inertia, *(factor * k for k in shape(servo, real)), f.static, f.coulomb,
        f.stribeck_velocity, f.viscous, f.stiffness, f.damping, 1.0,
    )])  # fmt: skip


def half(servo: Servo, gain: Any, y: Any, longest: float, precision: Precision = EXTENDED) -> Half:
    """The motion from x1 = 0, (x2, x3, z) = y; Lost where the next x1 = 0 takes more than `longest` seconds."""
    real = precision.real
    first, ta = _integrator(False, real), _integrator(True, real)
    p = _parameters(servo, gain, real)
    p[10] = _sign(y[0], real)
    # The first step leaves x1 = 0 without an eye on it.
    first.time, first.state[:], first.pars[:] = real(0), [real(0), *y], p
    first.step()
    ta.reset_cooldowns()
    ta.time, ta.state[:], ta.pars[:] = first.time, first.state, p
    largest = real(0)
    reversals = steps = 0
    while reversals < MOST_REVERSALS:
        fast = abs(ta.state[1]) > FAST * p[6]
        outcome = ta.step(_short(ta.state, ta.pars)) if fast else ta.propagate_until(real(longest))
        steps += 1 if fast else int(outcome[3])
        # A terminal event stops with -index - 1; heyoka's own outcomes lie far below.
        index = -int(outcome[0].value) - 1
        if index == 2 or (fast and index not in (0, 1) and ta.time < longest):
            continue
        if index not in (0, 1):
            raise Lost(f"the motion did not reach the next x1 = 0 within {longest:g} s")
        if index == 1:
            return Half(ta.state[1:].copy(), ta.time, largest, steps)
        reversals += 1
        largest = max(largest, abs(ta.state[0]))
        ta.state[1] = real(0)
        torque = -(p[1] * ta.state[0] + p[3] * ta.state[2]) - p[8] * ta.state[3]
        ta.pars[10] = _sign(torque, real)
    raise Lost(f"no x1 = 0 after {MOST_REVERSALS} reversals")


def _sign(number: Any, real: Any) -> Any:
    return real(1) if number > 0 else -real(1)


def _short(x: Any, p: Any) -> Any:
    """A step in which the speed cannot fall from far above vs into the drop of the friction curve unseen.

    Up there the exponential has no visible Taylor coefficients, and the step that they allow knows nothing of the drop.
    """
    J, kp, kd, ki, Fs, _, vs, s2, s0, s1, _ = p
    force = abs(kp * x[0] + kd * x[1] + ki * x[2]) + Fs + (s1 + s2) * abs(x[1])
    return type(J)(SHARE) * max(vs, abs(x[1]) - 8 * vs) * J / force


def cycle(
    servo: Servo, gain: float, y: Any, half_period: float, precision: Precision = EXTENDED
) -> tuple[Truth, Any]:
    """(the symmetric cycle next to y = (x2, x3, z) at x1 = 0, its own y); the stick position of the Truth is zero."""

    def equations(y: Any) -> tuple[Any, Half]:
        there = half(servo, gain, y, 3 * half_period, precision)
        return -there.y - y, there

    y, there = _newton(equations, np.array([precision.real(value) for value in y]), precision)
    mu = np.linalg.eigvals(_jacobian(equations, y, -there.y - y, abs(y), precision) + np.eye(3))
    leading = mu[np.argmax(np.abs(mu))].real
    return _truth(gain, there, leading, precision), y


def fold(servo: Servo, gain: float, y: Any, half_period: float) -> Truth:
    """The gain at which a cycle passes x1 = 0 with the velocity y[0] that it is said to have at the fold.

    The gain is largest there: an error of the velocity changes it by its square only.
    """
    velocity = EXTENDED.real(y[0])

    def equations(u: Any) -> tuple[Any, Half]:
        state = np.array([velocity, u[0], u[1]])
        there = half(servo, u[2], state, 3 * half_period)
        return -there.y - state, there

    u, there = _newton(equations, np.array([y[1], y[2], gain], dtype=EXTENDED.real), EXTENDED)
    return _truth(u[2], there, 1.0, EXTENDED)


def _newton(equations: Callable[[Any], tuple[Any, Half]], y: Any, precision: Precision) -> tuple[Any, Half]:
    start, scale, jacobian, last = y, abs(y), None, np.inf
    for _ in range(30):
        f, there = equations(y)
        if jacobian is None:
            jacobian = _jacobian(equations, y, f, scale, precision)
        step, whole = _newton_step(jacobian, f.astype(float), scale.astype(float))
        size = float(np.max(np.abs(step) / scale.astype(float)))
        if whole and (size < precision.last or (last < 1e4 * precision.last and size > 0.1 * last)):
            return y, there
        y = y + np.array([precision.real(value) for value in step])
        if float(np.max((abs(y - start) / scale).astype(float))) > FARTHEST:
            raise Lost(f"no cycle within {FARTHEST:g} of the guess")
        if size > 1e-3 * last:
            jacobian = None
        last = size if whole else np.inf
    raise Lost("Newton on the closure does not converge")


def _jacobian(equations: Callable[[Any], tuple[Any, Half]], y: Any, f: Any, scale: Any, precision: Precision) -> Any:
    jacobian = np.empty((3, 3))
    for k in range(3):
        moved = y.copy()
        moved[k] += precision.real(precision.step) * scale[k]
        jacobian[:, k] = ((equations(moved)[0] - f) / (moved[k] - y[k])).astype(float)
    return jacobian


def _newton_step(jacobian: Any, f: Any, scale: Any) -> tuple[Any, bool]:
    """(-J^-1 f, True); (its part along the leading direction, False) where a large multiplier has carried f far.

    The curve that f lies on bends there, and what f has in other directions means nothing.
    """
    u, size, v = np.linalg.svd(jacobian * scale / scale[:, None])
    parts = u.T @ (f / scale)
    whole = not (size[0] > STEEP * size[1] and abs(parts[0]) > BENT)
    if not whole:
        parts[1:] = 0.0
    return -scale * (v.T @ (parts / size)), whole


def _truth(gain: Any, there: Half, mu: float, precision: Precision) -> Truth:
    numbers = (gain, 0.0, there.largest, 2 * there.duration, mu)
    noise = precision.eps * there.steps * max(abs(mu), 1.0)
    return Truth(*(Decimal(str(number)) for number in numbers), noise)
