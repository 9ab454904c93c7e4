"""Half a LuGre cycle in extended precision (64-bit mantissa): heyoka's adaptive Taylor series with events.

    x1' = x2,   J x2' = m - (s0 z + s1 z' + s2 x2),   x3' = x1,   z' = x2 - s0 s x2 z/g(x2),   s = sign of x2

From x1 = 0 in mid-slip, y = (x2, x3, z), to the next x1 = 0; every x2 = 0 on the way is an event at which s becomes the
sign of the net torque.  The symmetric cycle is y = -Phi(y), found by Newton with differences of Phi, its half
multiplier the leading eigenvalue of -dPhi/dy.  Explicit steps, small ones through a stiff stick, but of a few
microseconds each.  No collocation, no CasADi, nothing shared with the program but the equations.

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

from .switch_digits import Lost, Truth

LONG = np.longdouble
MOST_REVERSALS = 400
FAST, SHARE = 2.0, 0.3
"""Speed in vs above which steps are kept short, and the part of the speed that may be lost in one."""
FARTHEST = 0.1
"""Largest relative distance of a solution from its guess."""
STEP = LONG(1e-9)
"""Relative difference for derivatives: half the digits."""


@dataclass(frozen=True, eq=False)
class Half:
    """y at the next x1 = 0 (3,), the time it took [s], the largest |x1| [rad], the steps taken."""

    y: Any
    duration: Any
    largest: Any
    steps: int


@lru_cache(maxsize=2)
def _integrator(events: bool) -> Any:
    import heyoka as hy

    x1, x2, x3, z = hy.make_vars("x1", "x2", "x3", "z")
    J, kp, kd, ki, Fs, Fc, vs, s2, s0, s1, s = (hy.par[i] for i in range(11))
    g = Fc + (Fs - Fc) * hy.exp(-(x2 / vs) * (x2 / vs))
    rate = x2 - s0 * s * x2 * z / g
    m = -(kp * x1 + kd * x2 + ki * x3)
    system = [(x1, x2), (x2, (m - (s0 * z + s1 * rate + s2 * x2)) / J), (x3, x1), (z, rate)]
    return hy.taylor_adaptive(
        system, state=np.ones(4, dtype=LONG), pars=np.ones(11, dtype=LONG), fp_type=LONG,
        t_events=[hy.t_event(e, fp_type=LONG) for e in (x2, x1, x2 * x2 - FAST**2 * vs * vs)] if events else [],
    )  # fmt: skip


def _parameters(servo: Servo, gain: Any) -> Any:
    f, c = servo.friction, servo.controller
    factor = LONG(gain) * LONG(servo.motor_gain)
    lead, integral = LONG(c.lead_time), LONG(c.integral_time)
    return np.array([
        servo.inertia, factor * (1 + lead / integral), factor * lead, factor / integral, f.static, f.coulomb,
        f.stribeck_velocity, f.viscous, f.stiffness, f.damping, 1.0,
    ], dtype=LONG)  # fmt: skip


def half(servo: Servo, gain: Any, y: Any, longest: float) -> Half:
    """The motion from x1 = 0, (x2, x3, z) = y; Lost where the next x1 = 0 takes more than `longest` seconds."""
    first, ta = _integrator(False), _integrator(True)
    p = _parameters(servo, gain)
    p[10] = np.sign(y[0])
    # The first step leaves x1 = 0 without an eye on it.
    first.time, first.state[:], first.pars[:] = LONG(0), [LONG(0), *y], p
    first.step()
    ta.reset_cooldowns()
    ta.time, ta.state[:], ta.pars[:] = first.time, first.state, p
    largest = LONG(0)
    reversals = steps = 0
    while reversals < MOST_REVERSALS:
        fast = abs(ta.state[1]) > FAST * p[6]
        outcome = ta.step(_short(ta.state, ta.pars)) if fast else ta.propagate_until(LONG(longest))
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
        ta.state[1] = 0
        torque = -(p[1] * ta.state[0] + p[3] * ta.state[2]) - p[8] * ta.state[3]
        ta.pars[10] = np.sign(torque)
    raise Lost(f"no x1 = 0 after {MOST_REVERSALS} reversals")


def _short(x: Any, p: Any) -> Any:
    """A step in which the speed cannot fall from far above vs into the drop of the friction curve unseen.

    Up there the exponential has no visible Taylor coefficients, and the step that they allow knows nothing of the drop.
    """
    J, kp, kd, ki, Fs, _, vs, s2, s0, s1, _ = p
    force = abs(kp * x[0] + kd * x[1] + ki * x[2]) + Fs + (s1 + s2) * abs(x[1])
    return LONG(SHARE) * max(vs, abs(x[1]) - 8 * vs) * J / force


def cycle(servo: Servo, gain: float, y: Any, half_period: float) -> tuple[Truth, Any]:
    """(the symmetric cycle next to y = (x2, x3, z) at x1 = 0, its own y); the stick position of the Truth is zero."""

    def equations(y: Any) -> tuple[Any, Half]:
        there = half(servo, gain, y, 3 * half_period)
        return -there.y - y, there

    y, there, jacobian = _newton(equations, np.asarray(y, dtype=LONG))
    mu = np.linalg.eigvals(jacobian + np.eye(3))
    leading = mu[np.argmax(np.abs(mu))].real
    return _truth(gain, there, leading), y


def fold(servo: Servo, gain: float, y: Any, half_period: float) -> Truth:
    """The gain at which a cycle passes x1 = 0 with the velocity y[0] that it is said to have at the fold.

    The gain is largest there: an error of the velocity changes it by its square only.
    """
    velocity = LONG(y[0])

    def equations(u: Any) -> tuple[Any, Half]:
        state = np.array([velocity, u[0], u[1]])
        there = half(servo, u[2], state, 3 * half_period)
        return -there.y - state, there

    u, there, _ = _newton(equations, np.array([y[1], y[2], gain], dtype=LONG))
    return _truth(u[2], there, 1.0)


def _newton(equations: Callable[[Any], tuple[Any, Half]], y: Any) -> tuple[Any, Half, Any]:
    start, scale, jacobian, last = y, np.abs(y), None, np.inf
    for _ in range(15):
        f, there = equations(y)
        if jacobian is None:
            jacobian = np.empty((3, 3))
            for k in range(3):
                moved = y.copy()
                moved[k] += STEP * scale[k]
                jacobian[:, k] = (equations(moved)[0] - f) / (moved[k] - y[k])
        step = -np.linalg.solve(jacobian, f.astype(float)).astype(LONG)
        size = float(np.max(np.abs(step) / scale))
        if size < 1e-15 or (last < 1e-11 and size > 0.1 * last):
            return y, there, jacobian
        y = y + step
        if float(np.max(np.abs(y - start) / scale)) > FARTHEST:
            raise Lost(f"no cycle within {FARTHEST:g} of the guess")
        if size > 1e-3 * last:
            jacobian = None
        last = size
    raise Lost("Newton on the closure does not converge")


def _truth(gain: Any, there: Half, mu: float) -> Truth:
    numbers = (LONG(gain), LONG(0), there.largest, 2 * there.duration, LONG(mu))
    noise = float(np.finfo(LONG).eps) * there.steps * max(abs(mu), 1.0)
    return Truth(*(Decimal(np.format_float_scientific(number, unique=True)) for number in numbers), noise)
