"""The hunting servo as a problem for the engine (hybrid/problem.py), and its orbits as a servo's user reads them.

One inertia, its friction, a PID controller and the integrator, as parts (parts/).  A problem is (model, servo, gain):
p is the vector of `Servo.names`, the gain K is what is followed, and an orbit is a `HuntingOrbit`, whose `model`,
`servo`, `gain` are views of its problem.

Controller (see controller.py):   m = -(kp x1 + kd x2 + ki x3),   J x2' = m - F,   x1' = x2,   x3' = x1.

Switch friction, states (x1, x2, x3), a Filippov system with eta -> 0 (parts/switch.py):
    slip+, slip-   s x2 > 0:  F = s g(x2) + sigma2 x2, until x2 = 0 ("stop")
    stick          x2 = 0, x1 constant, x3' = x1, |m| <= Fs; closed form, until m = s Fs ("breakaway")
    at a stop with |m| > Fs the servo slips on with sign(m) at once: reversal without stick.
  Half cycle: slip+ | stick, closed by S = -I.

LuGre friction, states (x1, x2, x3, x4 = z), the kink |x2| split off as a mode (parts/lugre.py):
    slide+, slide-  s x2 >= 0: |x2| = s x2, until x2 = 0 ("reversal")
    slide           |x2| as it is, the mode that both are parts of: once the net torque at a reversal is below
                    `lugre.WEAK` Fs, the kink is too weak to deserve a phase boundary, and tiny reversals come and go
                    along a branch
  Half cycle: from x1 = 0 in mid-slip ("centre", always transversal) to the next one: slip, ring-down
  of alternating short slides, then the long stick and the take-off in the last phase.

Half a cycle closes by its mirror image, S = -I, the whole of it by itself.  Events are scaled to order one: velocities
by vs, torques by Fs, x1 by Fs/kp.  Parameters are called by the last part of their names in a servo file: p.static is
friction.static, Fs; p.sign is s.

Report: Hensen, van de Molengraft and Steinbuch, DCT 2001.021, sections 3.1 and 3.2; its own form of the Switch servo
is in scripts/report.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar, Literal

import numpy as np

from ..checks import require
from ..compiled import kept
from ..continuation.fold import Fold
from ..hybrid import System
from ..orbits import Closure, Cycles, Orbit
from .controller import Controller
from .friction import Model
from .parts.plain_loop import parts_of_servo
from .parts.product import modes_of
from .servo import Servo, called, record_of

STATES = {"switch": ("x1", "x2", "x3"), "lugre": ("x1", "x2", "x3", "x4")}
TITLES = {"switch": "servo with Switch friction", "lugre": "servo with LuGre friction"}
Kind = Literal["gauss", "radau"]
"""Collocation at Gauss points, for smooth fields, or at Radau IIA points, for stiff ones (`collocation.Scheme`)."""
SCHEMES: dict[str, tuple[int, Kind]] = {"switch": (8, "gauss"), "lugre": (7, "radau")}
"""Default collocation degree and kind: Gauss for the smooth slip, Radau IIA for the stiff bristle."""

_FORMS = {len(form.names): form for form in (Servo(), Servo(controller=Controller().pid()))}
"""By the length of p, a servo with such a controller: no function depends on its numbers."""
_MIRROR = str.maketrans("+-", "-+")


@kept(maxsize=8)
def system_of(model: Model, parameters: int) -> System:
    """The servo as a system, its numbers those of any servo; parameters: the length of p, which tells its form."""
    return hunting_system(_FORMS[parameters], model, 1.0)


def motor_torque(x: Any, p: Any) -> Any:
    """The torque of the motor.

    x: (n,) or (n, m) states of either model. Returns m [N m], one number or (m,).
    """
    names = system_of("switch", p.shape[0]).names
    return torque_of(_FORMS[p.shape[0]], names.x(x, p), names.p(p))


def torque_of(servo: Servo, x: Any, p: Any) -> Any:
    """The same of named states and parameters."""
    (_, pid, *_) = parts_of_servo("switch", servo)
    return pid.gives["demand"](x, SimpleNamespace(error=x.x1, derivative=x.x2, integral=x.x3), p)


def slips_back(x: np.ndarray, p: np.ndarray) -> bool:
    """Whether the Switch servo, stopped at x, is reversed at once by more torque than static friction holds.

    x: (3,) state with x2 = 0. Returns False where it sticks.
    """
    return system_of("switch", p.size).vector_form.ways_out("slip+", "stop")[0].successor(x, p) != "stick"


def mirrored(signature: tuple[tuple[str, str], ...]) -> tuple[tuple[str, str], ...]:
    """The phase sequence of the motion -x(t)."""
    return tuple((mode.translate(_MIRROR), event.translate(_MIRROR)) for mode, event in signature)


def hunting_system(servo: Servo, model: Model, gain: float) -> System:
    """A servo as a system like any user's, for `casahunt.motion.simulate` and `casahunt.orbits.find_cycle`.

    servo, model, gain: the problem; gain K > 0 [V/rad]. Returns system with the parameters of `Servo.names`, by the
    last parts of their names. Raises InputError: a value out of range.
    """
    values = dict(zip(called(servo.names), map(float, servo.parameters(gain)), strict=True))
    return System(TITLES[model], STATES[model], values, modes_of(parts_of_servo(model, servo), tuple(values)))


Array = np.ndarray

LARGEST_WALK_STEP = {"switch": 1.0, "lugre": 0.5}
"""Of a walk, in arclength."""
STATE_COLUMNS = ("time_s", "x1_rad", "x2_rad_per_s", "x3_rad_s", "x4_rad")
"""Columns of the table of an orbit; x4 = z of LuGre alone."""


class HuntingOrbit(Orbit):
    """A hunting cycle; amplitude max |x1| [rad].

    States are x1 [rad], x2 [rad/s], x3 [rad s] and, for LuGre, x4 = z [rad].

    Attributes
    ----------
    model, servo, gain : the friction model, the servo, and the gain K [V/rad].
    period, amplitude, period_error, amplitude_error : [s], [rad], and their estimated relative errors.
    frequency : 1/period [Hz].
    multipliers, half_multiplier, stable : Floquet multipliers, computed when they are read.
    status, arcs and all else : as of `casahunt.orbits.Orbit`.

    Examples
    --------
    >>> from casahunt import Servo, find_orbit
    >>> orbit = find_orbit(Servo(), "switch", 0.04)
    >>> round(orbit.amplitude, 4), round(orbit.period, 3), orbit.stable  # rad, s
    (0.05, 10.281, True)
    >>> orbit.to_dict(table=False)["status"]
    'converged'
    """

    _quantities = (
        "model", "gain [V/rad] ~ parameter_error", "amplitude [rad] ~ amplitude_error", "period [s] ~ period_error",
        "status",
    )  # fmt: skip
    _details = (
        "frequency [Hz] ~ period_error", "servo", "error_estimate", "signature", "repeats", "degree", "solver",
        "unknowns", "iterations", "residual", "wall_s [s]",
    )  # fmt: skip

    _size_columns = ("amplitude_rad", "period_s")

    problem: Hunting

    @property
    def model(self) -> Model:
        """The friction model: "switch" or "lugre"."""
        return self.problem.model

    @property
    def servo(self) -> Servo:
        """The servo."""
        return self.problem.servo

    @property
    def gain(self) -> float:
        """The controller gain K."""
        return self.problem.gain

    @property
    def _state_columns(self) -> tuple[str, ...]:
        return STATE_COLUMNS


class HuntingFold(Fold[HuntingOrbit]):
    """The largest (at a second fold the smallest) gain at which a servo hunts.

    Attributes
    ----------
    gain, gain_error : the fold gain K [V/rad], and its estimated relative error.
    orbit : the cycle there.
    confirmed_gain : the fold gain again, on the mesh of halved intervals [V/rad].
    status, wall_s : how it ended, and the time that it took [s].

    Examples
    --------
    >>> from casahunt import Servo, find_fold
    >>> fold = find_fold(Servo(), "switch")
    >>> round(fold.gain, 6), fold.gain_error < 1e-6
    (0.647339, True)
    """

    _quantities = (
        "model = orbit.model", "gain [V/rad] ~ gain_error", "amplitude = orbit.amplitude [rad] ~ orbit.amplitude_error",
        "period = orbit.period [s] ~ orbit.period_error", "status",
    )  # fmt: skip
    _details = ("confirmed_gain [V/rad]", "error_estimate", "servo = orbit.servo", "sensitivities", "wall_s [s]")

    @property
    def gain(self) -> float:
        """The fold gain K."""
        return self.value

    @property
    def gain_error(self) -> float:
        """Estimated relative error of the gain."""
        return self.value_error

    @property
    def confirmed_gain(self) -> float:
        """The fold gain again, on the mesh of halved intervals."""
        return self.confirmed_value


@dataclass(frozen=True)
class Hunting(Cycles):
    """The hunting of one servo with one friction model at one gain.

    Attributes
    ----------
    model, servo, gain : the friction model, the servo, and the gain K [V/rad].
    closure : how its cycles close; default after half a period, by their mirror image.
    sections : planes at which phases may end; the servo's events serve.
    """

    orbit_type: ClassVar[type | None] = HuntingOrbit
    fold_type: ClassVar[type | None] = HuntingFold
    measured: ClassVar[str] = "x1"  # type: ignore[misc]
    watched: ClassVar[bool] = False

    model: Model
    servo: Servo
    gain: float
    closure: Closure = None  # type: ignore[assignment]
    sections: tuple[Any, ...] = ()

    def __post_init__(self) -> None:
        if self.closure is None:
            object.__setattr__(self, "closure", CLOSURES[self.model])

    @property
    def beyond_a_fold(self) -> str:  # type: ignore[override]
        """Of the symmetric cycle: a lopsided pair may end and leave it."""
        return "beyond it the servo does not hunt" if self.closure.repeats == 2 else super().beyond_a_fold

    def whole(self) -> Hunting:
        """The same, its cycles closed after a whole period: the lopsided ones too."""
        n = len(self.system.states)
        return replace(self, closure=Closure.of(np.eye(n), np.zeros(n), 1))

    @property
    def system(self) -> System:  # type: ignore[override]
        """`system_of`; its numbers are those of any servo."""
        return system_of(self.model, len(self.names))

    @property
    def title(self) -> str:
        """ "the switch servo" or "the lugre servo"."""
        return f"the {self.model} servo"

    @property
    def names(self) -> tuple[str, ...]:
        """servo.PARAMETERS, or PID_PARAMETERS."""
        return self.servo.names

    @property
    def principal(self) -> str:
        """The gain."""
        return "gain"

    @property
    def scheme(self) -> tuple[int, Kind]:
        """Gauss for the smooth slip, Radau IIA for the stiff bristle."""
        return SCHEMES[self.model]

    @property
    def largest_step(self) -> float:
        """Of a walk, in arclength."""
        return LARGEST_WALK_STEP[self.model]

    def amplitude_of(self) -> int:
        """That of x1, which is largest where the servo stops: at the end of a phase."""
        return 0

    def vector(self) -> Array:
        """(np,) the values of `names`."""
        return self.servo.parameters(self.gain)

    def labels(self) -> dict[str, Any]:
        """Model and servo."""
        return {"model": self.model, "servo": self.servo}

    def record(self) -> dict[str, Any]:
        """Model, servo and gain; an orbit's record says whether it is half a cycle."""
        return {"model": self.model, **record_of(self.servo), "gain": self.gain}

    def with_value(self, name: str, value: float) -> Hunting:
        """The problem with one parameter changed.

        name, value: name in `names`, and its value. Raises InputError: a servo cannot have that value.
        """
        if name == "gain":
            return replace(self, gain=value)
        return replace(self, servo=self.servo.replace(**{name: value}))

    def with_values(self, names: tuple[str, ...], values: Array) -> Hunting:
        """The problem with several parameters changed at once, between which there may be no servo.

        names, values: k of `names`, and (k,) their values. Raises InputError: a servo cannot have them.
        """
        changes = dict(zip(names, map(float, values), strict=True))
        gain = changes.pop("gain", self.gain)
        return replace(self, servo=self.servo.replace(**changes), gain=require("gain", gain, above=0))


CLOSURES = {model: Closure.of(-np.eye(len(x)), np.zeros(len(x)), 2) for model, x in STATES.items()}
"""Half a period, closed by its mirror image."""


def hunting(model: Model, servo: Servo, gain: float, *, half: bool) -> Hunting:
    """The problem of cycles that are computed on half of their period, or on the whole of it."""
    problem = Hunting(model, servo, gain)
    return problem if half else problem.whole()
