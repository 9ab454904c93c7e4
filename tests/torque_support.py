"""The friction torque along a simulated motion.

    F = m - J x2',   m = -(kp x1 + kd x2 + ki x3)                                    [N m]

with x2' from the field of the mode that the motion is in, so that one formula serves slip, stick (x2' = 0, F = m)
and the bristle of LuGre: F is what the model says, not a curve looked up at a velocity.  Where the
motion slides steadily it is g(v) sgn(v) + sigma2 v, the curve of `sliding_torque`, for both models (report, section
3); the difference is what the models add to it.

Symbols: n states, m samples, v = x2 velocity [rad/s].
"""

from __future__ import annotations

import numpy as np

from casahunt.collocation.interval import point_function
from casahunt.compiled import alone
from casahunt.hybrid.system import VectorMode
from casahunt.servo.friction import Friction, stribeck
from casahunt.servo.parts.plain_loop import servo_of_loop
from casahunt.servo.problem import system_of
from casahunt.servo.trajectory import Trajectory

Array = np.ndarray


def friction_torque(trajectory: Trajectory, times: Array) -> Array:
    """The friction torque F in a motion.

    times: (m,) [s], between 0 and the end of the motion. Returns (m,) [N m]. Raises InputError: a time outside the
    motion, or not a number.
    """
    t = np.asarray(times, float).ravel()
    x = trajectory.sample(t)
    servo, _, gain = servo_of_loop(trajectory.loop)
    p = servo.parameters(gain)
    system = system_of(trajectory.model, p.size).vector_form
    modes = np.array(trajectory.mode_at(t))
    acceleration = np.zeros(t.size)
    for name in dict.fromkeys(modes.tolist()):
        mode, here = system.modes[name], np.flatnonzero(modes == name)
        acceleration[here] = _rates(mode, x[:, here], p)[1]
    return trajectory.signal("torque", t) - servo.inertia * acceleration


@alone
def _rates(mode: VectorMode, x: Array, p: Array) -> Array:
    """(n, m) x' at the states x (n, m)."""
    n, m = x.shape
    field = point_function(mode.field, n, p.size).map(m)
    return np.array(field(x, np.full((1, m), mode.sign), np.tile(p[:, None], m), np.ones((n, m))))


@alone
def sliding_torque(friction: Friction, v: Array) -> Array:
    """Friction torque of steady sliding, g(v) sgn(v) + sigma2 v: the same for both models.

    v: (m,) velocities [rad/s]; at v = 0 the value is 0, although all of [-Fs, Fs] is possible there.
    Returns (m,) [N m].
    """
    v = np.asarray(v, float).ravel()
    g = np.array(stribeck(v, friction.static, friction.coulomb, friction.stribeck_velocity), float).ravel()
    return np.sign(v) * g + friction.viscous * v
