"""What proves that a servo has no limit cycle, without computing any.

With v = x2, the torque balance J v' + kd v + F(v) + kp x1 + ki x3 = 0, differentiated, times v and times v', each
integrated over a period (F is a function of v but for v = 0, where it lies between -Fs and Fs):

    J int v'^2 = kp int v^2,        (kd kp/J - ki) int v^2 + int v' dF = 0

F + s v grows with v if s is at least the steepest fall of F.  Then its part of int v' dF is not negative, at the jumps
of F at a stop or a reversal neither, and

    (kd + sigma2 - s) kp/ki > J,      s = sqrt(2/e) (Fs - Fc)/vs                 [N m s/rad]

leaves no solution but v = 0: there is no cycle, symmetric or not, at that gain and above, since kd grows with it (or
stays 0) and kp/ki = tau_i + tau_d does not.  Of the controller only kp > 0 and ki > 0 are used: its zeros may be
complex.  Without a drop of friction, s = 0, that is the loop's stability without dry friction, and the
theorem of Bisoffi et al.; where that loop is unstable, motions far out grow and near the set point they settle, and
an unstable cycle parts the two.

LuGre friction is no function of v.  Its cycles are denied only without a drop, as those of the servo that it has in the
limit of a stiff bristle.
"""

from __future__ import annotations

import math

from .hunting import Model
from .servo import Servo


def no_cycle(servo: Servo, model: Model, gain: float = 0.0) -> str:
    """Why the servo has no limit cycle at a gain nor above it, as a clause; "" where that is not proved.

    Parameters
    ----------
    servo, model, gain
        the problem; gain 0: at any gain.
    """
    f, c = servo.friction, servo.controller
    drop = f.static > f.coulomb
    if drop and model != "switch":
        return ""
    steepest = math.sqrt(2 / math.e) * (f.static - f.coulomb) / f.stribeck_velocity if drop else 0.0
    derivative = gain * servo.motor_gain * c.shape[1]
    if not (derivative + f.viscous - steepest) * c.reset_time > servo.inertia:
        return ""
    if not drop:
        return (
            "static equals Coulomb friction, and without a drop in the friction curve the integral action cannot "
            "sustain an oscillation (Bisoffi et al.)"
        )
    return (
        f"the friction curve falls by at most {steepest:.4g} N m s/rad, and viscous friction and the controller damp "
        "the loop so well that it stays stable even if that is taken away: over a period more energy is lost than "
        "falling friction can supply"
    )
