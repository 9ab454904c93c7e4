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

LuGre friction is no function of v.  Without a drop its bristle goes z' = v h with h = 1 - sgn(v) z/zc, zc = Fc/sigma0,
where h' = -|v| h/zc between two stops, and |z| <= zc on a cycle, so 0 <= h <= 2.  By parts, over a period,

    int z' v   = int v^2 h                    int z'' v  = -1/(2 zc) int |v|^3 h
    int z' v'  = 1/(2 zc) int |v|^3 h         int z'' v' = A - B/3,     A = int v'^2 h,   B = 1/zc^2 int v^4 h,

and B^2 <= 9 A B by Cauchy and Schwarz, so that A - B/3 >= -2 A >= -4 int v'^2.  The torque balance, differentiated,
times v' + v ki/kp, with F = sigma0 z + sigma1 z' + sigma2 v, then leaves no solution but v = 0 where

    (kd + sigma2 - 4 sigma1) kp/ki > J      and      sigma1 <= sigma0 kp/ki

This is sufficient, and far from necessary: the bristle of Table 1 is damped too strongly.  What then holds in the limit
of a stiff bristle is said to hold there, and no more (refused.py).
"""

from __future__ import annotations

from ..axis_units import in_its_units, quantity
from .friction import Model, steepest
from .servo import Servo, a_servo


@in_its_units
def no_cycle(servo: Servo, model: Model, gain: float = 0.0) -> str:
    """Why the servo has no limit cycle at a gain nor above it.

    Parameters
    ----------
    servo, model
        the problem.
    gain
        K [V/rad]; 0: at any gain.

    Returns
    -------
    A clause that says why; "" where that is not proved.

    Raises
    ------
    InputError : what was given is no servo.

    Examples
    --------
    >>> from casahunt import Friction, Servo, no_cycle
    >>> no_cycle(Servo(), "switch", 0.7)  # above the fold, but not proved
    ''
    >>> no_cycle(Servo(friction=Friction(static=0.44)), "switch", 0.1)[:37]
    'static equals Coulomb friction, and w'
    """
    a_servo(servo)
    f, c = servo.friction, servo.controller
    drop, reset = f.static > f.coulomb, c.reset_time
    if model == "lugre" and (drop or f.damping > f.stiffness * reset):
        return ""
    taken = 4 * f.damping if model == "lugre" else steepest(f)
    derivative = gain * servo.motor_gain * c.shape[1]
    if not (derivative + f.viscous - taken) * reset > servo.inertia:
        return ""
    if model == "lugre":
        return (
            "static equals Coulomb friction, and the damping of the bristle is so much smaller than viscous friction "
            "and the controller's that over a period the bristle takes more energy than it gives"
        )
    if not drop:
        return (
            "static equals Coulomb friction, and without a drop in the friction curve the integral action cannot "
            "sustain an oscillation"
        )
    falls = quantity(steepest(f), "N m s/rad")
    return (
        f"the friction curve falls by at most {falls}, and viscous friction and the controller damp the loop so well "
        "that it stays stable even if that is taken away: over a period more energy is lost than falling friction can "
        "supply"
    )
