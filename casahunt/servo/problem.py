"""The hunting servo as a problem for the engine (hybrid/problem.py), and its orbits as a servo's user reads them.

A problem is (model, servo, gain): p is the vector of `Servo.names`, the gain K is what is followed, and the cycles
are those of hunting.py.  An orbit of it is a `HuntingOrbit`: `model`, `servo` and `gain` are views of its problem.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ..checks import require
from ..continuation.fold import Fold
from ..hybrid import System
from ..orbits import Closure, Cycles, Orbit
from .friction import Model
from .hunting import SCHEMES, STATES, Kind, system_of
from .servo import Servo, record_of

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
    optimised_gain, multipliers : what the optimisation problem on the same mesh says [V/rad], and its multipliers.
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
    _details = ("optimised_gain [V/rad]", "error_estimate", "servo = orbit.servo", "sensitivities", "wall_s [s]")

    @property
    def gain(self) -> float:
        """The fold gain K."""
        return self.value

    @property
    def gain_error(self) -> float:
        """Estimated relative error of the gain."""
        return self.value_error

    @property
    def optimised_gain(self) -> float:
        """The fold gain of the optimisation problem on the same mesh (of the turning point, by Newton alone)."""
        return self.optimised_value


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
        """That of hunting.py; its numbers are those of any servo."""
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
