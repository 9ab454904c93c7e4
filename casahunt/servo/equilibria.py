"""Equilibria of the servo: the fixed points of both friction models, and what linearising there proves.

Switch (report, sections 3.2 and 4.1): x2 = 0 and x3' = x1 = 0, stuck while |m| <= Fs, m = -ki x3:
    the segment   x1 = x2 = 0,  |x3| <= Fs/ki.
The stick region x2 = 0, |kp x1 + ki x3| <= Fs is a strip of the plane (x1, x3) around it.  In the strip
x1 stays and x3' = x1, so that the equilibria are all of it that does not leave: every other point reaches
kp x1 + ki x3 = sign(x1) Fs after a finite time.

LuGre: x2 = 0 makes z' = 0, and x1 = 0, J x2' = -ki x3 - sigma0 z = 0:
    the segment   x1 = x2 = 0,  x3 = -sigma0 z/ki,  z = q.
The bristle cannot be bent beyond |q| = Fs/sigma0: z z' <= 0 there, since g <= Fs, so this set of z is invariant.  The
equations have fixed points beyond it, which no motion from inside reaches.

Generalised (Clarke) Jacobian there.  |x2| has the generalised derivative 2 alpha - 1, alpha in [0, 1]; with
c = 1 - (2 alpha - 1) sigma0 q/Fs in [0, 2] (g(0) = Fs, g'(0) = 0), states (x1, x2, x3, z):

        [   0                 1               0        0     ]
    A = [ -kp/J   -(kd + sigma2 + sigma1 c)/J  -ki/J  -sigma0/J ]
        [   1                 0               0        0     ]
        [   0                 c               0        0     ]

    det(s - A) J = s (J s^3 + (kd + sigma2 + sigma1 c) s^2 + (kp + sigma0 c) s + ki).

One eigenvalue is always 0, along the segment.  The other three are in the open left half-plane if and only if
(kd + sigma2 + sigma1 c)(kp + sigma0 c) > J ki (Routh-Hurwitz), and the left side grows with c: the worst member is
c = 0, at the ends |q| = Fs/sigma0 of the segment, and there the condition is

    sharp     kd + sigma2 > J/(kp/ki),   kp/ki = tau_i + tau_d, kd = K cm tau_d for a controller by times,

the stability of the linear loop (gains.py), independent of sigma0 and sigma1.  For all K > 0 at once it is
    simple    sigma2/J > 1/(kp/ki)   (>= where kd > 0)
which is the report's sigma2/J > pi (section 4.1) only for its times tau_i = tau_d = 1/(2 pi).  It is sufficient for one
K, and necessary as well for all of them.
Where the sharp condition fails only members with c below `threshold` are unstable, a layer at the ends of the
segment that is thin because sigma0 is large.

What this does not prove: the members of the generalised Jacobian being stable (up to the zero) does not prove that a
switched system made of them is; nor does an unstable member prove that an equilibrium is unstable.  And neither
says anything about hunting, which is a cycle away from the equilibria.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import COMPUTED, choice_of, require, sensible
from ..export import Columns
from ..results import Result
from .friction import MODELS, Model
from .servo import Servo, a_servo
from .units import column

Array = np.ndarray

POSITIONS, SLOPES = 41, 21
"""Grid of q in [-Fs/sigma0, Fs/sigma0] and of alpha in [0, 1]."""
PROVES = (
    "what it proves: the eigenvalues of the linearisations at the equilibria. What it does not: left half-plane "
    "members of the generalised Jacobian do not prove stability of the switched system, an unstable member does not "
    "prove instability, and neither excludes a hunting cycle."
)


@dataclass(frozen=True, eq=False, repr=False)
class Equilibria(Result):
    """The equilibria of a servo at one gain.

    Attributes
    ----------
    model, servo, gain : the problem.
    integral_limit : Fs/ki: |x3| of the ends of the segment [rad s].
    position_limit : Fs/kp: |x1| of the strip of the stick region where x3 = 0 [rad].
    bristle_limit : Fs/sigma0 [rad]; nan for Switch.
    sharp : (left, right) sides of kd + sigma2 > J/(kp/ki) [N m s/rad].
    simple : (left, right) sides of sigma2/J > 1/(kp/ki) [1/s].
    q, alpha : (Q,), (A,) grid of the generalised Jacobian; empty for Switch.
    largest : (Q, A) largest real part [1/s] of the three eigenvalues of each member that are not the zero.
    threshold : members with c below it have an eigenvalue in the right half-plane; 0 where none has, nan for Switch.

    Examples
    --------
    >>> from casahunt import Servo, equilibria
    >>> found = equilibria(Servo(), "switch", 0.1)
    >>> round(found.integral_limit, 4), found.sharp_holds  # rad s
    (0.0527, True)
    """

    _quantities = (
        "model", "gain [V/rad]", "integral_limit [rad s]", "position_limit [rad]", "sharp_holds", "simple_holds",
    )  # fmt: skip
    _details = (
        "servo", "bristle_limit [rad]", "largest_real_part [1/s]", "members = largest.size", "threshold",
    )  # fmt: skip

    model: Model
    servo: Servo
    gain: float
    integral_limit: float
    position_limit: float
    bristle_limit: float
    sharp: tuple[float, float]
    simple: tuple[float, float]
    q: Array
    alpha: Array
    largest: Array
    threshold: float

    @property
    def largest_real_part(self) -> float:
        """Of the eigenvalues of all members but the zeros [1/s]; nan for Switch."""
        return float(self.largest.max()) if self.largest.size else math.nan

    def _more(self) -> dict[str, Any]:
        conditions = ("sharp", self.sharp, self.sharp_holds), ("simple", self.simple, self.simple_holds)
        said = {
            f"{name}_condition": {"left": left, "right": right, "holds": holds}
            for name, (left, right), holds in conditions
        }
        return {**said, "proves": PROVES}

    def _columns(self) -> Columns:
        row = {
            "model": self.model,
            column("gain"): self.gain,
            "integral_limit_rad_s": self.integral_limit,
            "position_limit_rad": self.position_limit,
            "bristle_limit_rad": self.bristle_limit,
            "largest_real_part_per_s": self.largest_real_part,
            "sharp_left_Nms_per_rad": self.sharp[0],
            "sharp_right_Nms_per_rad": self.sharp[1],
            "simple_left_per_s": self.simple[0],
            "simple_right_per_s": self.simple[1],
            "threshold": self.threshold,
        }
        return {name: [value] for name, value in row.items()}

    @property
    def sharp_holds(self) -> bool:
        """Every member has its three eigenvalues in the open left half-plane."""
        return self.sharp[0] > self.sharp[1]

    @property
    def simple_holds(self) -> bool:
        """The same at every gain K > 0."""
        return self.simple[0] > self.simple[1]


def member(servo: Servo, gain: float, q: float, alpha: float) -> Array:
    """One member A (4, 4) of the generalised Jacobian of the LuGre servo at the equilibrium with z = q.

    servo, gain: the problem; gain K > 0 [V/rad]; q: bristle deflection [rad], |q| <= Fs/sigma0; alpha: weight of the
    side x2 > 0, in [0, 1]. Returns (4, 4) matrix A in x1, x2, x3, z. Raises InputError: q or alpha out of range.
    """
    f = servo.friction
    require("q", q, at_least=-f.static / f.stiffness, at_most=f.static / f.stiffness)
    require("alpha", alpha, at_least=0, at_most=1)
    kp, kd, ki = servo.torque_gains(gain)
    J = servo.inertia
    c = 1 - (2 * alpha - 1) * f.stiffness * q / f.static
    return np.array([
        [0, 1, 0, 0],
        [-kp / J, -(kd + f.viscous + f.damping * c) / J, -ki / J, -f.stiffness / J],
        [1, 0, 0, 0],
        [0, c, 0, 0],
    ])  # fmt: skip


def cubic(servo: Servo, gain: float, c: Array) -> Array:
    """The cubic factor of det(s - A) J of members of the generalised Jacobian.

    servo, gain: the problem; gain K > 0 [V/rad]; c: (m,) slopes of the module docstring.
    Returns (m, 4) coefficients, highest power first.
    """
    f = servo.friction
    kp, kd, ki = servo.torque_gains(gain)
    c = np.atleast_1d(np.asarray(c, float))
    one = np.ones_like(c)
    return np.column_stack([servo.inertia * one, kd + f.viscous + f.damping * c, kp + f.stiffness * c, ki * one])


def threshold(servo: Servo, gain: float) -> float:
    """The c below which a member is unstable.

    servo, gain: the problem; gain K > 0 [V/rad].
    Returns the positive root of (kd + sigma2 + sigma1 c)(kp + sigma0 c) = J ki; 0 where no c >= 0 is unstable.
    """
    f = servo.friction
    kp, kd, ki = servo.torque_gains(gain)
    D = kd + f.viscous
    missing = D * kp - servo.inertia * ki
    if missing >= 0:
        return 0.0
    linear = D * f.stiffness + f.damping * kp
    # The positive root of sigma1 sigma0 c^2 + linear c + missing, without cancellation.
    return float(-2 * missing / (linear + np.sqrt(linear**2 - 4 * f.damping * f.stiffness * missing)))


def equilibria(servo: Servo, model: Model, gain: float) -> Equilibria:
    """The equilibria of a servo, with the generalised Jacobian of LuGre on a grid.

    Parameters
    ----------
    servo, model, gain
        the problem; gain K > 0 [V/rad].

    Returns
    -------
    Equilibria; the grid (POSITIONS, SLOPES) of the Jacobian is empty for the Switch servo.

    Raises
    ------
    InputError : unknown model, or gain not a finite number > 0.

    Examples
    --------
    >>> from casahunt import Servo, equilibria
    >>> found = equilibria(Servo(), "lugre", 0.1)
    >>> float(found.largest.max()) < 0  # no member of the generalised Jacobian has an eigenvalue on the right
    True
    """
    a_servo(servo)
    choice_of("model", model, MODELS)
    sensible("gain", gain, power=COMPUTED)
    f, reset = servo.friction, servo.controller.reset_time
    kp, kd, ki = servo.torque_gains(gain)
    q, alpha, largest = np.zeros(0), np.zeros(0), np.zeros((0, 0))
    limit = f.static / f.stiffness if model == "lugre" else math.nan
    if model == "lugre":
        q, alpha = np.linspace(-limit, limit, POSITIONS), np.linspace(0, 1, SLOPES)
        values = 1 - np.outer(q / limit, 2 * alpha - 1)
        roots = [np.roots(row) for row in cubic(servo, gain, values.ravel())]
        largest = np.max(np.real(roots), axis=1).reshape(values.shape)
    return Equilibria(
        model=model,
        servo=servo,
        gain=gain,
        integral_limit=f.static / ki,
        position_limit=f.static / kp,
        bristle_limit=limit,
        sharp=(kd + f.viscous, servo.inertia / reset),
        simple=(f.viscous / servo.inertia, 1 / reset),
        q=q,
        alpha=alpha,
        largest=largest,
        threshold=threshold(servo, gain) if model == "lugre" else math.nan,
    )
