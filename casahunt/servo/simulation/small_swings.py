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
from ..servo import Servo

TIMES_IN_A_TURN, MOST_LOOKED_AT = 64, 10**6
"""Times in 2 pi/omega, the fastest that x2 turns, at which its sign is looked at; at most so many."""


def creeps(servo: Servo, gain: float) -> bool:
    """Whether every small slip of the Switch servo ends at the set point, without a stop before.

    Parameters
    ----------
    servo, gain
        the problem; gain K > 0 [V/rad].

    Returns
    -------
    False where it stops before, or where that is not certain.
    """
    kp, kd, ki = servo.torque_gains(gain)
    J, damping = servo.inertia, kd + servo.friction.viscous
    rates, modes = np.linalg.eig(np.array([[0, 1, 0], [-kp / J, -damping / J, -ki / J], [1, 0, 0]], dtype=float))
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
