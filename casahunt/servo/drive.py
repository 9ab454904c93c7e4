"""The drive as built: its sample time, delay, encoder, and its controller as a difference equation; as a frozen record.

    table [drive] of a servo file, the keys as the attributes of `Drive`

The equations are those of sampled/loop.py.  Like the gain, the drive is not part of the servo: what is computed for the
continuous loop does not depend on it.

An encoder may decide how a servo hunts, in counts of the amplitude of the continuous cycle:

    A < ENCODER_BORDER q,    q = 2 pi/encoder one count [rad]

Where the continuous loop rests, a set point between two counts leaves an error that the integral winds up on, unless it
has a dead band: the drive hunts by a count.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..axis_units import Units
from ..checks import choice_of, floated, moderate, require, sensible, shown
from ..errors import InputError
from ..quantities import with_its_unit
from .controller import Controller, Pid
from .units import kinds_of

DRIVE_TABLE = "drive"
"""The table of a servo file."""
DERIVATIVES, INTEGRATIONS = ("difference", "filtered"), ("rectangle", "trapezoid")
LONGEST_DELAY = 1000
"""Samples of a delay, at most: far beyond where any loop is stable."""
BANDS = ("dead_band", "shifted_dead_band", "hysteresis")
"""Of the integrator: it has one of them."""
SIZES = (*BANDS, "leak", "error_dead_band", "error_filter_time", "compensated")
"""Of remedies: each 0 where there is none of it."""
RESETS = ("reset", "reset_at_stop")
"""Of the sum: 1 leaves it as it is."""
REMEDIES = (*BANDS[1:], *SIZES[-3:], *RESETS, "dwell")
"""Remedies other than a dead band of the integrator and a leak."""
SHARES = {"enter_ratio": "hysteresis", "remaining_gain": "error_dead_band"}
"""From 0 to 1; by the key without which they mean nothing."""
ENCODER_BORDER = 20.0
"""Counts of the amplitude of hunting by stiction below which an encoder may decide how it hunts.  Of 60 random servos
(scripts/as_built.py encoder) quantisation was the cause, as of sampled/cause.py, of none with 40 counts or more, 12 %
with 20, 28 % with 12, 40 % with 8, 61 % with 5 and nine tenths with 3 or less."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """How a drive runs its controller.

    Attributes
    ----------
    sample_time : T [s], > 0.
    delay : from a sample to the torque that it makes [s], >= 0, `LONGEST_DELAY` samples at most.
    encoder : counts per revolution; 0: the position is read exactly.
    noise, seed : standard deviation of the reading [rad], independent from sample to sample, normal, before it is
        counted; which noise it is, a whole number >= 0: the same seed is the same noise.
    quantise_torque : step of the torque [N m]; 0: it has none.
    derivative : "difference" of two readings by T, or that "filtered".
    filter_time : of the filtered derivative [s]; None: a tenth of kd/kp.
    integration : by "rectangle", the present reading held since the last one, or "trapezoid".
    dead_band : error [rad] up to which nothing is integrated.
    leak : rate at which the integral is forgotten [1/s], less than one in a sample.
    shifted_dead_band : error [rad] up to which nothing is integrated, and beyond it only the rest.
    hysteresis, enter_ratio : error [rad] beyond which it is integrated again, and the part of it below which it is not.
    dwell : time [s] of equal readings after which nothing is integrated; None: it always is.
    reset, reset_at_stop : factor of the sum where the error changes its sign, where the reading stays; at most 1.
    error_dead_band, remaining_gain : angle [rad] up to which the controller sees only this part of the error.
    error_filter_time : of a filter in front of the controller [s].
    compensated : part of the Coulomb friction that is added to the torque while the reading changes.

    Examples
    --------
    >>> from casahunt import Drive
    >>> drive = Drive(sample_time=1e-3, encoder=2000)
    >>> round(drive.count, 6)  # rad
    0.003142
    """

    sample_time: float
    delay: float = 0.0
    encoder: float = 0.0
    noise: float = 0.0
    seed: int = 0
    quantise_torque: float = 0.0
    derivative: str = "difference"
    filter_time: float | None = None
    integration: str = "rectangle"
    dead_band: float = 0.0
    leak: float = 0.0
    shifted_dead_band: float = 0.0
    hysteresis: float = 0.0
    enter_ratio: float = 0.5
    dwell: float | None = None
    reset: float = 1.0
    reset_at_stop: float = 1.0
    error_dead_band: float = 0.0
    remaining_gain: float = 0.0
    error_filter_time: float = 0.0
    compensated: float = 0.0

    def __post_init__(self) -> None:
        sensible("drive.sample_time", self.sample_time)
        for key in ("delay", "encoder", "noise", "quantise_torque", *SIZES):
            sensible(f"drive.{key}", getattr(self, key), zero=True)
        if self.delay > LONGEST_DELAY * self.sample_time:
            longest = LONGEST_DELAY * self.sample_time
            require("drive.delay", self.delay, at_most=longest, unit=f"{LONGEST_DELAY} samples")
        if not self.leak * self.sample_time < 1:
            raise InputError(f"drive.leak = {shown(self.leak)}: must be less than 1/sample_time")
        if self.encoder != 0:
            require("drive.encoder", self.encoder, at_least=1, unit="counts per revolution")
        choice_of("drive.derivative", self.derivative, DERIVATIVES)
        choice_of("drive.integration", self.integration, INTEGRATIONS)
        if self.filter_time is not None:
            sensible("drive.filter_time", self.filter_time)
            if self.derivative != "filtered":
                raise InputError('drive.filter_time: must be left out unless derivative = "filtered"')
        self._check_remedies()
        whole = int(require("drive.seed", self.seed, at_least=0))
        if whole != self.seed:
            raise InputError(f"drive.seed = {shown(self.seed)}: must be a whole number")
        floated(self)
        object.__setattr__(self, "seed", whole)

    def _check_remedies(self) -> None:
        for key in RESETS:
            require(f"{DRIVE_TABLE}.{key}", moderate(f"{DRIVE_TABLE}.{key}", getattr(self, key)), at_most=1)
        for key, of in SHARES.items():
            require(f"{DRIVE_TABLE}.{key}", getattr(self, key), at_least=0, at_most=1)
            if not getattr(self, of) and getattr(self, key) != getattr(Drive, key):
                raise InputError(f"{DRIVE_TABLE}.{key}: must be left out without {DRIVE_TABLE}.{of}")
        if self.dwell is not None:
            sensible("drive.dwell", self.dwell)
        given = [key for key in BANDS if getattr(self, key)]
        if len(given) > 1:
            raise InputError(f"{DRIVE_TABLE}: {' and '.join(given)} exclude each other; the integrator has one of them")

    @property
    def count(self) -> float:
        """One count of the encoder [rad]; 0 without one."""
        return 2 * math.pi / self.encoder if self.encoder else 0.0

    @property
    def quantises(self) -> bool:
        """Whether it quantises anything."""
        return bool(self.encoder or self.quantise_torque)

    def filter_of(self, controller: Controller | Pid) -> float:
        """Time of the filter of the derivative [s]; 0 without one."""
        if self.derivative != "filtered":
            return 0.0
        kp, kd = controller.shape
        return kd / kp / 10 if self.filter_time is None else self.filter_time

    def exact(self) -> Drive:
        """The same drive without any quantisation."""
        return dataclasses.replace(self, encoder=0.0, quantise_torque=0.0)

    def quiet(self) -> Drive:
        """The same drive without noise."""
        return dataclasses.replace(self, noise=0.0)

    def noises(self, samples: int) -> np.ndarray:
        """(samples,) what its readings are off by [rad], before they are counted."""
        return self.noise * np.random.default_rng(self.seed).standard_normal(samples)


DRIVE_KEYS = tuple(field.name for field in dataclasses.fields(Drive))
DRIVE_WORDS = ("derivative", "integration")
"""Those whose values are words."""


def with_remedy(drive: Drive, key: str, size: float) -> Drive:
    """The same drive with this size of a remedy; of dead bands of the integrator in the place of any other.

    Raises InputError: no drive has one of this size.
    """
    others: dict[str, Any] = dict.fromkeys(BANDS, 0.0) | {"enter_ratio": Drive.enter_ratio}
    return dataclasses.replace(drive, **{**(others if key in BANDS else {}), key: size})


def drive_of_table(table: Any, units: Units, **changes: Any) -> Drive:
    """The drive of the table [drive].

    units: of the axis; changes: what stands in the place of its keys. Raises InputError: no table, an unknown key, no
    sample time, or a value out of range.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{DRIVE_TABLE} = {table!r}: must be a table [{DRIVE_TABLE}]")
    own = {name: units.own_name(name) for name in table}
    for name in own.values():
        choice_of("key", f"{DRIVE_TABLE}.{name}", [f"{DRIVE_TABLE}.{key}" for key in DRIVE_KEYS])
    values = {**{own[name]: value for name, value in table.items()}, **changes}
    if "sample_time" not in values:
        key = f"{DRIVE_TABLE}.sample_time"
        raise InputError(f"{key}: must be given, the time [s] between two samples, such as --set {key}=0.001")
    return Drive(**{name: drive_value(name, value, units) for name, value in values.items()})


def drive_value(name: str, value: Any, units: Units) -> Any:
    """A value of the table [drive]: in SI, or a text with its unit; of the encoder the size of a count, or counts.

    Raises InputError: a unit of another kind, or counts per revolution of a linear axis.
    """
    key = f"{DRIVE_TABLE}.{name}"
    if with_its_unit(value) is not None and name not in DRIVE_WORDS:
        if name != "encoder":
            return units.read(key, value, *kinds_of(name))
        return 2 * math.pi / sensible(key, units.read(key, value, "rad"))
    if name == "encoder" and units.linear and value not in (0, "0"):
        raise InputError(f"{key} = {value}: must be the size of a count, such as '1 um', of a linear axis")
    return value


def below_border(amplitude: float, drive: Drive | None) -> str:
    """The sentence for a cycle of the continuous loop that an encoder sees in few counts; "" where there is none.

    amplitude: of the cycle [rad].
    """
    if drive is None or not drive.encoder or amplitude >= ENCODER_BORDER * drive.count:
        return ""
    counts = f"{amplitude / drive.count:.3g} counts of the encoder"
    return f"{counts}: below {ENCODER_BORDER:g} quantisation may decide how it hunts, not stiction alone"


def by_counts(drive: Drive | None) -> str:
    """The sentence for a gain at which the continuous loop does not hunt, and this drive may; "" where it may not."""
    if drive is None or not drive.quantises or any(getattr(drive, key) for key in BANDS) or drive.dwell is not None:
        return ""
    what = "a count of the encoder" if drive.encoder else "a step of the torque"
    may = f"may keep the drive hunting by {what} where the continuous loop rests"
    return f"quantisation, which no gain takes away, {may}"
