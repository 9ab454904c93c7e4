"""The drive as built: its sample time, delay, encoder, and its controller as a difference equation; as a frozen record.

    table [drive] of a servo file, the keys as the attributes of `Drive`

The equations are those of sampled/loop.py.  Like the gain, the drive is not part of the servo: what is computed for the
continuous loop does not depend on it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..checks import choice_of, floated, require, sensible, shown
from ..errors import InputError

DRIVE_TABLE = "drive"
"""The table of a servo file."""
DERIVATIVES, INTEGRATIONS = ("difference", "filtered"), ("rectangle", "trapezoid")
LONGEST_DELAY = 1000
"""Samples of a delay, at most: far beyond where any loop is stable."""


@dataclass(frozen=True, kw_only=True)
class Drive:
    """How a drive runs its controller.

    Attributes
    ----------
    sample_time : T [s], > 0.
    delay : from a sample to the torque that it makes [s], >= 0, `LONGEST_DELAY` samples at most.
    encoder : counts per revolution; 0: the position is read exactly.
    quantise_torque : step of the torque [N m]; 0: it has none.
    derivative : "difference" of two readings by T, or that "filtered".
    filter_time : of the filtered derivative [s]; None: a tenth of kd/kp.
    integration : by "rectangle", the present reading held since the last one, or "trapezoid".
    dead_band : error [rad] up to which nothing is integrated.
    leak : rate at which the integral is forgotten [1/s], less than one in a sample.

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
    quantise_torque: float = 0.0
    derivative: str = "difference"
    filter_time: float | None = None
    integration: str = "rectangle"
    dead_band: float = 0.0
    leak: float = 0.0

    def __post_init__(self) -> None:
        sensible("drive.sample_time", self.sample_time)
        for key in ("delay", "encoder", "quantise_torque", "dead_band", "leak"):
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
        floated(self)

    @property
    def count(self) -> float:
        """One count of the encoder [rad]; 0 without one."""
        return 2 * math.pi / self.encoder if self.encoder else 0.0

    @property
    def quantises(self) -> bool:
        """Whether it quantises anything."""
        return bool(self.encoder or self.quantise_torque)

    def exact(self) -> Drive:
        """The same drive without any quantisation."""
        return dataclasses.replace(self, encoder=0.0, quantise_torque=0.0)


DRIVE_KEYS = tuple(field.name for field in dataclasses.fields(Drive))


def drive_of_table(table: Any, **changes: Any) -> Drive:
    """The drive of the table [drive].

    changes: what stands in the place of its keys. Raises InputError: no table, an unknown key, no sample time, or a
    value out of range.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{DRIVE_TABLE} = {table!r}: must be a table [{DRIVE_TABLE}]")
    for name in table:
        choice_of("key", f"{DRIVE_TABLE}.{name}", [f"{DRIVE_TABLE}.{key}" for key in DRIVE_KEYS])
    values = {**table, **changes}
    if "sample_time" not in values:
        raise InputError(f"{DRIVE_TABLE}.sample_time: must be given, the time [s] between two samples")
    return Drive(**values)
