"""The torque of the motor, or its current, as a further measured output.

    m_i = c + m(t_i - tau; q) + noise,   m = -(kp x1 + kd x2 + ki x3),   D = n ln(sum r_i^2/n),   r_i = m_i - m - c

The offset c and the standard deviation of the noise are the likeliest ones of each point, so that neither is an
unknown; D is -2 log of the likelihood that this leaves, but for a constant.  A position tells only what torques are to
each other, such as friction to the motor gain; with a torque they have a size.

Symbols: n samples, k parameters.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...orbits import StateSensitivity
from ...servo.controller import torque_gains_of
from ...servo.problem import HuntingOrbit
from ...servo.servo import flatten
from .likelihood import Rows

Array = np.ndarray

ALL_BUT_NONE = 1e-6
"""Least noise, in units of the largest torque."""
COMPLEX_STEP = 1e-30
"""Of a derivative by an imaginary part, which loses no digits."""


class Torque(NamedTuple):
    """Of the motor at n times: itself, its rate, and its derivatives (k, n) by parameters at fixed times."""

    value: Array
    rate: Array
    derivatives: Array


def torque_of(orbit: HuntingOrbit, found: StateSensitivity, names: tuple[str, ...]) -> Torque:
    """The torque at the times of a sensitivity, with its derivatives by parameters of the servo."""
    gains = np.array(orbit.servo.torque_gains(orbit.gain))
    slopes = np.zeros((len(names), 3))  # of (kp, kd, ki)
    for row, name in zip(slopes, names, strict=True):
        values: dict[str, complex] = {key: complex(value) for key, value in flatten(orbit.servo).items()}
        values[name] += 1j * COMPLEX_STEP
        K = orbit.gain * values["servo.motor_gain"]
        moved = torque_gains_of(K, *(values[key] for key in orbit.servo.controller_names))
        row[:] = [complex(each).imag / COMPLEX_STEP for each in moved]
    x = found.states[:3]
    by_state = np.einsum("a,kam->km", gains, found.derivatives[:, :3])
    return Torque(-gains @ x, -gains @ found.rates[:3], -(by_state + slopes @ x))


def residual(measured: Array, torque: Array) -> tuple[Array, float]:
    """Measured less computed, but for an offset; and the noise that it is taken for."""
    r = measured - torque
    r = r - r.mean()
    return r, math.sqrt(max(float(np.mean(r**2)), (ALL_BUT_NONE * float(np.abs(torque).max())) ** 2))


def term(measured: Array, torque: Array, J: Array) -> Rows:
    """What a measured torque adds.

    measured, torque: (n,); J: (n, u) derivatives of the torque by unknowns.
    """
    r, sigma = residual(measured, torque)
    deviance = r.size * (math.log(sigma**2) + float(np.mean(r**2)) / sigma**2)
    return Rows(deviance, -r, r / sigma**2, np.full(r.size, sigma**-2), J - J.mean(axis=0))
