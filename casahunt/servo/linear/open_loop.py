"""The loop without dry friction, opened at the torque: a rational transfer function.

    one inertia       L(s) = K cm C(s) / (s (J s + sigma2)),    C(s) of controller.py at K = 1
    a loop of parts   x' = A x + b u,   torque that is commanded, behind all filters, = -c x:
                      L(s) = c (s I - A)^-1 b = (n_0 s^(n-1) + ... + n_(n-1)) / (s^n + d_1 s^(n-1) + ... + d_n)
                      n_k = sum over i <= k of d_i h_(k-i),   h_k = c A^k b: what is zero comes out as zero

Viscous friction stays, of the motor and of a load: where it differs by direction there is an L for each.  Only a loop
of which every part has one law and no event is linear: in a dead band, or with a reset, there is no L.  Under a torque
limit L is that within it, which says nothing of large motions: `linear_stable` does not know.  Stability is
that of denominator + numerator, by Routh's array, not by rounded poles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ...checks import COMPUTED, sensible
from ...compiled import Caller, caller, kept
from ...errors import InputError
from ..parts.loop import Loop
from ..parts.part import Part
from ..parts.plain_loop import loop_asked
from ..parts.wiring import Numbers, Signals, wired
from ..servo import Servo, a_servo

Array = np.ndarray

NO_COEFFICIENT = 1e-12
"""A coefficient of the characteristic polynomial below this part of what its degree would have is zero."""
OPENED = Part("opened loop", ("held",), gives={"torque": lambda x, s, p: x.held})


def _viscous(at: str) -> Part:
    """What is viscous of a friction whose signals and parameters begin so."""
    return Part(f"viscous {at}friction", gives={
        at + "friction": lambda x, s, p: getattr(p, at + "viscous") * getattr(s, (at or "motor_") + "rate"),
        at + "moving": lambda x, s, p: 1.0, at + "direction": lambda x, s, p: 0.0,
    })  # fmt: skip


VISCOUS = {at: _viscous(at) for at in ("", "load_")}


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """L(s).

    Attributes
    ----------
    numerator, denominator : coefficients, highest power first.
    """

    numerator: Array
    denominator: Array

    def response(self, omega: Array | float, delay: float = 0.0) -> Array:
        """L(i omega) exp(-i omega delay) at frequencies (m,) [rad/s]; complex ones are i times a point of the plane."""
        s = 1j * np.asarray(omega)
        L = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(L * np.exp(-s * delay) if delay else L)

    @property
    def closed(self) -> Array:
        """The characteristic polynomial of the closed loop, highest power first."""
        return np.polyadd(self.numerator, self.denominator)

    @property
    def poles(self) -> Array:
        """(n,) poles of the closed loop [1/s], by falling real part."""
        poles = np.roots(self.closed)
        return poles[np.lexsort((-poles.imag, -poles.real))]

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable."""
        return is_hurwitz(self.closed)


def open_loop(servo: Servo | Loop, gain: float | None = None) -> OpenLoop:
    """L of a servo at a gain [V/rad], or of a loop of parts, which has its own; of friction by direction, forwards.

    Raises InputError: a gain out of range, or a loop that is not linear.
    """
    if isinstance(servo, Loop):
        found = open_loop_of_parts(loop_asked(servo, None, gain, usual="switch").within_limits)
        if found is None:
            raise not_linear(servo)
        return found
    kp, kd, ki = a_servo(servo).torque_gains(sensible("gain", gain, power=COMPUTED))
    denominator = np.array([servo.inertia, servo.friction.viscous, 0.0, 0.0])
    return OpenLoop(np.trim_zeros(np.array([kd, kp, ki]), "f"), denominator)


def not_linear(loop: Loop) -> InputError:
    """The refusal of a loop that has no L."""
    why = smooth(loop)[1] or "the rate of a state bends with the states"
    return InputError(f"{loop.name}: is not linear: {why}; there are no margins unless that is left out")


def is_hurwitz(polynomial: Sequence[float] | Array) -> bool:
    """Whether all roots lie to the left of the imaginary axis: the first column of Routh's array has one sign."""
    c = np.trim_zeros(np.asarray(polynomial, float), "f")
    above, row = c[::2], c[1::2]
    for _ in range(c.size - 1):
        if not row[0] / above[0] > 0:
            return False
        reach = np.append(row[1:], np.zeros(above.size - row.size))
        above, row = row, above[1:] - above[0] / row[0] * reach
    return True


def open_loop_of_parts(loop: Loop) -> OpenLoop | None:
    """L of a loop of parts; None where it is not linear, or its friction has no viscous part."""
    parts, why = smooth(loop)
    found = None if why else slopes_of((*parts, OPENED), loop, "command")
    if found is None:
        return None
    A, c = found
    return OpenLoop(*_polynomials(A[:-1, :-1], A[:-1, -1], -c[:-1]))


def either_way(servo: Any) -> dict[str, Any]:
    """The loop with the viscous friction of each direction in both, by direction; by "" where that is the same, as of
    a servo."""
    numbers = servo.parameters if isinstance(servo, Loop) else {}
    forwards, back = (numbers.get(name) for name in ("viscous", "viscous_back"))
    if forwards is None or back is None or forwards == back:
        return {"": servo}
    return {"forwards": servo.replace(viscous_back=forwards), "back": servo.replace(viscous=back)}


def linear_stable(loop: Loop) -> bool | None:
    """Whether a loop of parts without dry friction is stable, in either direction; None where it is not linear."""
    opened = [open_loop_of_parts(each) for each in either_way(loop).values()]
    return None if None in opened else all(each.stable for each in opened if each is not None)


def grows_without_friction(loop: Loop) -> bool:
    """Whether a loop of parts without dry friction is unstable, with the viscous friction of either direction: where it
    is with that of one alone, the two of a swing may yet damp it."""
    opened = [open_loop_of_parts(each) for each in either_way(loop).values()]
    return all(each is not None and not each.stable for each in opened)


def smooth(loop: Loop) -> tuple[tuple[Part, ...], str]:
    """The parts of a loop without its dry friction; why they are not linear, as far as they say it, or ""."""
    parts, switching = list[Part](), list[str]()
    for part in loop.present:
        gives = {name for mode in part.modes for name in (*part.gives, *mode.law.gives)}
        at = next((at for at in VISCOUS if at + "friction" in gives), None)
        switches = len(part.modes) > 1 or part.modes[0].ends or part.upon
        if at is not None and at + "viscous" in part.parameters:
            parts.append(VISCOUS[at])
        elif at is not None and switches:
            return (), "its friction has no viscous part"
        else:
            parts.append(part)
            switching += [part.name] if switches else []
    return tuple(parts), f"{' and '.join(switching)} switch" if switching else ""


def slopes_of(parts: tuple[Part, ...], loop: Loop, output: str) -> tuple[Array, Array] | None:
    """x' = A x of parts whose last state is a torque that is held, (n, n), and a signal of theirs, c x, (n,), at the
    numbers of a loop; None where they are not linear.

    Angles are measured from the first one: what all of them turn by together is a column of zeros, not of rounding,
    unless a spring holds it.
    """
    angles = tuple(state for part in parts for state in part.angles)
    compiled = _slopes(parts, tuple(loop.parameters), angles, output)
    if compiled is None:
        return None
    buffers = compiled.buffers
    buffers.inputs[0][:] = list(loop.parameters.values())
    buffers.trigger()
    A, c = buffers.outputs
    return A.copy(), c.copy()


@kept(maxsize=128)
def _slopes(parts: tuple[Part, ...], names: tuple[str, ...], angles: tuple[str, ...], output: str) -> Caller | None:
    wiring = wired(tuple((part, part.modes[0].law, None) for part in parts))
    own = {state: ca.SX.sym(state) for part in parts for state in part.states}
    n, at, numbers = len(own), ca.vertcat(*own.values()), ca.SX.sym("p", len(names))
    x, p = SimpleNamespace(**own), Numbers(**dict(zip(names, ca.vertsplit(numbers), strict=True)))
    for angle in angles[1:]:
        setattr(x, angle, own[angle] + own[angles[0]])
    rates = wiring.field(x, p)
    rate = ca.vertcat(*[rates[state] - (rates[angles[0]] if state in angles[1:] else 0) for state in own])
    slopes = ca.jacobian(rate, at), ca.jacobian(ca.SX(getattr(Signals(wiring, x, p), output)), at)
    if ca.depends_on(ca.vertcat(*(ca.vec(ca.densify(slope)) for slope in slopes)), at):
        return None
    function = ca.Function("slopes", [numbers], [ca.densify(slope.T) for slope in slopes])
    return caller(function, [len(names)], [(n, n), n])


def _polynomials(A: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Numerator and denominator of L(s), highest power first."""
    denominator = np.real(np.poly(A))
    n, scale = len(b), float(np.abs(np.linalg.eigvals(A)).max())
    denominator[np.abs(denominator) <= NO_COEFFICIENT * scale ** np.arange(n + 1)] = 0.0
    markov, column = [], b
    for _ in range(n):
        markov.append(float(c @ column))
        column = A @ column
    return np.convolve(denominator, markov)[:n], denominator
