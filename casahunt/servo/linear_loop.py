"""The servo without dry friction as a linear loop: stability, poles, margins.

    plant         P(s) = cm / (s (J s + sigma2))                            [rad/V]
    controller    C(s) = (kp + kd s + ki/s)/cm, times K: controller.py      [V/rad]
    loop          L(s) = C(s) P(s)
    closed loop   chi(s) = J s^3 + (kd + sigma2) s^2 + kp s + ki

Routh-Hurwitz, all coefficients being positive: chi is stable if and only if (kd + sigma2) kp > J ki, that is, with the
reset time kp/ki = tau_i + tau_d and kd = K cm kd', kd' = tau_d for a controller by times,

    K cm kd' + sigma2 > J / (kp/ki).

Without viscous friction this is K > J / (cm tau_d (tau_i + tau_d)), the report's lower bound (sections 2 and 5;
0.0321 for its Table 1).  With the viscous friction of Table 1, sigma2 = 0.1 > J/(tau_i + tau_d) = 0.0817, it holds
for every K > 0: the report's bound ignores sigma2.  A stable linear loop does not mean that the servo does not
hunt; dry friction is what hunting comes from.

Crossovers of this loop, w = omega^2:
    |L| = 1      w^2 (J^2 w + sigma2^2) = kd^2 w^2 + (kp^2 - 2 kd ki) w + ki^2: with real zeros kp^2 >= 4 kd ki, one
                 change of sign in the coefficients, so exactly one (Descartes); with kp^2 < 2 kd ki up to three
    arg L = pi   w = (J ki - sigma2 kp) / (J kd): one or none; lowering the gain to the Routh-Hurwitz limit, not raising
                 it, makes the loop unstable there
`gain_crossovers` and `phase_crossovers` make no use of that and find all crossovers of any rational loop.

Report: Hensen, van de Molengraft and Steinbuch, DCT 2001.021, section 2, Figure 1 and Table 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import COMPUTED, sensible
from ..errors import InputError
from ..export import Columns
from ..results import Result
from .controller import Pid
from .servo import Servo, a_servo
from .units import column

Array = np.ndarray

REAL = 1e-7
"""A root w of a crossover polynomial counts as real below this ratio of imaginary to absolute part: a double root,
where a curve touches, is only known to the square root of rounding."""
POLISH = 3
"""Newton steps that take a simple real root of numpy.roots to rounding."""


@dataclass(frozen=True, repr=False)
class Crossover(Result):
    """A frequency at which the loop crosses |L| = 1, or the negative real axis.

    Attributes
    ----------
    frequency : omega [rad/s].
    margin : at |L| = 1 the phase margin, arg L + 180 degrees in (-180, 180]; at arg L = -180 degrees the
        factor 1/|L| by which the gain would have to change to put a pole on the imaginary axis.
    """

    _quantities = ("frequency [rad/s]", "margin")

    frequency: float
    margin: float


@dataclass(frozen=True, eq=False, repr=False)
class LinearLoop(Result):
    """The linear loop at one gain.

    Attributes
    ----------
    gain : K.
    kp, kd, ki : torque gains [N m/rad, N m s/rad, N m/(rad s)].
    poles : (3,) complex roots of chi [rad/s], by decreasing real part.
    stable : by the Routh-Hurwitz inequality, not by the rounded poles.
    gain_crossovers : where |L| = 1, with phase margins [deg].
    phase_crossovers : where arg L = -180 degrees, with gain factors.
    lowest_factor, highest_factor : the loop stays as it is, stable or unstable, while the gain is multiplied by
        anything between them; 0 and inf where there is no such limit.

    Examples
    --------
    >>> from casahunt import Servo, linear_loop
    >>> loop = linear_loop(Servo(), 0.1)
    >>> loop.stable, round(loop.damping_ratio, 3)
    (True, 0.493)
    """

    _quantities = ("gain [V/rad]", "stable", "poles [1/s]", "lowest_factor", "highest_factor")
    _details = ("kp [N m/rad]", "kd [N m s/rad]", "ki [N m/(rad s)]", "damping_ratio")

    gain: float
    kp: float
    kd: float
    ki: float
    poles: Array
    stable: bool
    gain_crossovers: tuple[Crossover, ...]
    phase_crossovers: tuple[Crossover, ...]
    lowest_factor: float
    highest_factor: float

    def _columns(self) -> Columns:
        """A row; of the phase margins the least."""
        least = min(self.gain_crossovers, key=lambda c: abs(c.margin), default=None)
        row: dict[str, Any] = {
            column("gain"): self.gain,
            "stable": bool(self.stable),
            "phase_margin_deg": least.margin if least else math.nan,
            "crossover_rad_per_s": least.frequency if least else math.nan,
            "lowest_factor": self.lowest_factor,
            "highest_factor": self.highest_factor,
            "damping_ratio": self.damping_ratio,
            "kp_Nm_per_rad": self.kp,
            "ki_Nm_per_rad_s": self.ki,
            "kd_Nms_per_rad": self.kd,
        }
        for i, pole in enumerate(self.poles, 1):
            row |= {f"pole_{i}_re_per_s": pole.real, f"pole_{i}_im_per_s": pole.imag}
        return {name: [value] for name, value in row.items()}

    def _more(self) -> dict[str, Any]:
        crossings = (self.gain_crossovers, "phase_margin_deg"), (self.phase_crossovers, "gain_factor")
        gain, phase = ([{"frequency": c.frequency, name: c.margin} for c in items] for items, name in crossings)
        return {"gain_crossovers": gain, "phase_crossovers": phase}

    @property
    def damping_ratio(self) -> float:
        """-Re s/|s| of the least damped pole; negative for an unstable loop."""
        return float(np.min(-self.poles.real / np.abs(self.poles)))


def routh_hurwitz_gain(servo: Servo) -> float:
    """Gain above which the loop without friction is stable, J / (cm kd' kp/ki); inf for no derivative action."""
    c = servo.controller
    if c.shape[1] == 0:
        return float("inf")
    return servo.inertia / (servo.motor_gain * c.shape[1] * c.reset_time)


def typical_gain(servo: Servo) -> float:
    """A gain of the right size, where a search for hunting begins.

    Returns `routh_hurwitz_gain`, or where that is infinite `integral_gain` [V/rad].
    """
    base = routh_hurwitz_gain(servo)
    return base if math.isfinite(base) else integral_gain(servo)


def integral_gain(servo: Servo) -> float:
    """The gain at which inertia and integral action are equally fast.

    Returns J/(cm tau_i^2) for a controller by times; J/(cm kp' (kp'/ki')^2) by gains, the same where there is no kd
    [V/rad].
    """
    c, base = servo.controller, servo.inertia
    if isinstance(c, Pid):
        return base / (servo.motor_gain * c.kp * c.reset_time**2)
    return base / (servo.motor_gain * c.integral_time**2)


def lowest_stable_gain(servo: Servo) -> float:
    """Gain above which the loop with viscous friction is stable; 0: for every K > 0; inf: for none."""
    c = servo.controller
    missing = servo.inertia / c.reset_time - servo.friction.viscous
    if c.shape[1] == 0:
        return 0.0 if missing < 0 else float("inf")
    return max(0.0, missing / (servo.motor_gain * c.shape[1]))


def characteristic_polynomial(servo: Servo, gain: float) -> Array:
    """The characteristic polynomial chi(s) = J s^3 + (kd + sigma2) s^2 + kp s + ki.

    servo, gain: the loop; gain K > 0 [V/rad]. Returns (4,) coefficients, highest power first. Raises InputError: gain
    not a finite number > 0.
    """
    sensible("gain", gain, power=COMPUTED)
    kp, kd, ki = servo.torque_gains(gain)
    return np.array([servo.inertia, kd + servo.friction.viscous, kp, ki])


def matrix(servo: Servo, gain: float) -> Array:
    """(3, 3) A of the loop without dry friction: x' = A x, x = (x1, x2, x3); its eigenvalues are the roots of chi."""
    kp, kd, ki = servo.torque_gains(gain)
    J = servo.inertia
    return np.array([[0, 1, 0], [-kp / J, -(kd + servo.friction.viscous) / J, -ki / J], [1, 0, 0]], dtype=float)


def stable(servo: Servo, gain: float) -> bool:
    """Whether the loop is stable, by the Routh-Hurwitz inequality.

    servo, gain: the loop; gain K [V/rad]. Returns whether (kd + sigma2) kp > J ki.
    """
    kp, kd, ki = servo.torque_gains(gain)
    return bool((kd + servo.friction.viscous) * kp > servo.inertia * ki)


def controller_response(servo: Servo, gain: float, frequencies: Array) -> Array:
    """Frequency response C(j omega) of the controller.

    servo, gain: the controller; gain K [V/rad]; frequencies: (m,) omega [rad/s]. Returns (m,) complex [V/rad].
    """
    return servo.controller.response(gain, 1j * np.asarray(frequencies))


def loop_response(servo: Servo, gain: float, frequencies: Array) -> Array:
    """Frequency response L(j omega) of the open loop.

    servo, gain: the loop; gain K [V/rad]; frequencies: (m,) omega [rad/s]. Returns (m,) complex.
    """
    s = 1j * np.asarray(frequencies)
    plant = servo.motor_gain / (s * (servo.inertia * s + servo.friction.viscous))
    return controller_response(servo, gain, frequencies) * plant


def loop_polynomials(servo: Servo, gain: float) -> tuple[Array, Array]:
    """The open loop L(s) as a quotient of polynomials.

    servo, gain: the loop; gain K [V/rad]. Returns coefficients of numerator and denominator, highest power first.
    """
    numerator, factor = servo.controller.polynomials
    denominator = factor * np.array([servo.inertia, servo.friction.viscous, 0.0, 0.0])
    return np.trim_zeros(gain * servo.motor_gain * numerator, "f"), denominator


def linear_loop(servo: Servo, gain: float) -> LinearLoop:
    """Poles, stability, crossovers and margins of the loop without dry friction.

    Parameters
    ----------
    servo, gain
        the loop; gain K [V/rad].

    Returns
    -------
    LinearLoop; poles [1/s] by falling real part.

    Raises
    ------
    InputError : gain not a finite number > 0.

    Examples
    --------
    >>> from casahunt import Servo, linear_loop
    >>> linear_loop(Servo(), 0.1).poles.round(3).tolist()
    [(-4.424+7.817j), (-4.424-7.817j), (-4.793+0j)]
    """
    a_servo(servo)
    chi = characteristic_polynomial(servo, gain)
    kp, kd, ki = servo.torque_gains(gain)
    poles = np.roots(chi)
    poles = poles[np.lexsort((-poles.imag, -poles.real))]
    numerator, denominator = loop_polynomials(servo, gain)
    crossings = phase_crossovers(numerator, denominator)
    factors = [c.margin for c in crossings]
    return LinearLoop(
        gain=gain,
        kp=kp,
        kd=kd,
        ki=ki,
        poles=poles,
        stable=stable(servo, gain),
        gain_crossovers=gain_crossovers(numerator, denominator),
        phase_crossovers=crossings,
        lowest_factor=max((f for f in factors if f <= 1), default=0.0),
        highest_factor=min((f for f in factors if f >= 1), default=math.inf),
    )


def gain_crossovers(numerator: Sequence[float] | Array, denominator: Sequence[float] | Array) -> tuple[Crossover, ...]:
    """All frequencies with |L(j omega)| = 1.

    numerator, denominator: coefficients of L(s), highest power first. Returns crossovers by increasing frequency
    [rad/s], with their phase margins [deg]. Raises InputError: |L| = 1 at every frequency, as for an all-pass.
    """
    a, b = _along_the_axis(numerator), _along_the_axis(denominator)
    found = []
    for omega in _frequencies(np.polysub(_square(a), _square(b)), "|L| = 1"):
        phase = math.degrees(float(np.angle(np.polyval(a, omega) / np.polyval(b, omega))))
        margin = phase + 180
        found.append(Crossover(omega, margin if margin <= 180 else margin - 360))
    return tuple(found)


def phase_crossovers(numerator: Sequence[float] | Array, denominator: Sequence[float] | Array) -> tuple[Crossover, ...]:
    """All frequencies with L(j omega) real and negative.

    numerator, denominator: coefficients of L(s), highest power first. Returns crossovers by increasing frequency
    [rad/s], with the factors 1/|L|. Raises InputError: L is real at every frequency.
    """
    a, b = _along_the_axis(numerator), _along_the_axis(denominator)
    imaginary = np.polymul(a, np.conj(b)).imag  # odd in omega: only every other coefficient is there
    found = []
    for omega in _frequencies(imaginary[::-1][1::2][::-1], "a real L"):
        value = complex(np.polyval(a, omega) / np.polyval(b, omega))
        if value.real < 0:
            found.append(Crossover(omega, 1 / abs(value)))
    return tuple(found)


def _along_the_axis(polynomial: Sequence[float] | Array) -> Array:
    """Coefficients in omega of a polynomial in s = j omega."""
    c = np.asarray(polynomial, dtype=float)
    powers = np.array([1, 1j, -1, -1j])  # exact, as 1j**k is not
    return c * powers[np.arange(c.size)[::-1] % 4]


def _square(c: Array) -> Array:
    """|c(omega)|^2 as a polynomial in w = omega^2."""
    full = np.polymul(c, np.conj(c)).real
    return full[::-1][::2][::-1]


def _frequencies(polynomial: Array, what: str) -> list[float]:
    """omega = sqrt(w) for the positive roots w of a polynomial in w = omega^2, increasing."""
    size = float(np.max(np.abs(polynomial), initial=0.0))
    if size == 0:
        raise InputError(f"crossover {what}: every frequency is one")
    c = np.trim_zeros(polynomial, "f")
    derivative = np.polyder(c)
    found = []
    for root in np.roots(c):
        if root.real <= 0 or abs(root.imag) > REAL * abs(root):
            continue
        w = float(root.real)
        for _ in range(POLISH):
            slope = float(np.polyval(derivative, w))
            step = float(np.polyval(c, w)) / slope if slope else 0.0
            w = w - step if abs(step) < 1e-6 * w else w
        found.append(math.sqrt(w))
    return sorted(found)
