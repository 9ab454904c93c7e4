"""Does a small slip of the Switch servo ever stop?  A closed form, where a march would follow rounding.

After a breakaway from x1 = -b, at the torque Fs, and while the drop of the friction is not felt, the slip is linear,

    x1' = x2,   J x2' = -kp x1 - (kd + sigma2) x2 - ki y,   y' = x1,      x1(0) = -b,  x2(0) = 0,  y(0) = kp b/ki,

with y = x3 + Fs/ki, whatever b is.  It stops where x2 = sum_k c_k exp(lambda_k t) vanishes again.  Where it does not
before x1 is next to nothing, the servo creeps to the set point, and from there on the torques differ from Fs by less
than a double holds.

Symbols: K gain, b stick position.
"""

from __future__ import annotations

import math

import numpy as np

from ..event_map.slopes import AT_SET_POINT
from ..gains import matrix
from ..hunting import Model
from ..servo import Servo

TIMES_IN_A_TURN, MOST_LOOKED_AT = 64, 10**6
"""Times in 2 pi/omega, the fastest that x2 turns, at which its sign is looked at; at most so many."""
LINEAR = 1e-3
"""Drop of the friction torque relative to kp a below which a slip is linear."""
FAR_INSIDE = 1e-3
"""Part of the range of small slips from which none leads out: a swing may be that many times its start."""


def linear_stick_range(servo: Servo, model: Model, gain: float) -> float:
    """The range of stick positions in which the drop of the friction is not felt in a slip.

    servo, model, gain: the problem; gain K > 0 [V/rad]. Returns its upper end [rad].
    """
    kp, kd, _ = servo.torque_gains(gain)
    f = servo.friction
    rate = min(math.sqrt(kp / servo.inertia), kp / max(kd + f.viscous, 1e-300))
    drop = max(f.static - f.coulomb, 1e-300)
    b = min(LINEAR * kp * f.stribeck_velocity**2 / (drop * rate**2), f.static / kp)  # without a drop, any b is
    return b if model == "switch" else max(b, f.static / f.stiffness)


def creeps(servo: Servo, gain: float) -> bool:
    """Whether every small slip of the Switch servo ends at the set point, without a stop before.

    servo, gain: the problem; gain K > 0 [V/rad]. Returns False where it stops before, or where that is not certain.
    """
    kp, _, ki = servo.torque_gains(gain)
    rates, modes = np.linalg.eig(matrix(servo, gain))
    slowest, omega = float(rates.real.max()), float(np.abs(rates.imag).max())
    if not slowest < 0:
        return False
    if omega == 0:  # three real exponentials vanish at two times at most, and twice at the start
        return True
    end = math.log(AT_SET_POINT) / slowest
    step = 2 * math.pi / (omega * TIMES_IN_A_TURN)
    if end > MOST_LOOKED_AT * step:
        return False
    weights = modes[1] * np.linalg.solve(modes, np.array([-1.0, 0.0, kp / ki]))
    times = step * np.arange(1, 2 + int(end / step))
    return bool((np.exp(np.outer(times, rates)) @ weights).real.min() > 0)


def distance(servo: Servo, gain: float, x: np.ndarray) -> float:
    """How far from the set point the torques of a state that slips would hold it: of x1, x2, and of m beside Fs [rad].

    servo, gain: the problem; gain K > 0 [V/rad]; x: (3,) state. Returns the sum of the three, in units of x1.
    """
    kp, kd, ki = servo.torque_gains(gain)
    m = kp * x[0] + kd * x[1] + ki * x[2]
    slowing = (kd + servo.friction.viscous) * abs(x[1])
    return float(abs(x[0]) + (slowing + abs(abs(m) - servo.friction.static)) / kp)


def crept(servo: Servo, gain: float, x: np.ndarray) -> tuple[float, str] | None:
    """Where a Switch servo that slips next to the set point could still stick, if it has crept there for good.

    servo, gain, x: as in `distance`. Returns an upper bound of |x1| [rad], and the beginning of a sentence; None where
    it may go farther, or that is not certain.
    """
    a = distance(servo, gain, x)
    near = 0 < a <= FAR_INSIDE * linear_stick_range(servo, "switch", gain)
    return (a, "it creeps to the set point; ") if near and creeps(servo, gain) else None
