"""Whether a servo with given numbers comes to rest in the loop as built, from a few starts and at a few set points.

    set points  on a count of the encoder, a quarter of one beside it, and half-way between two: on a count the error
                that is read can be 0, half-way it cannot
    starts      a step of 1 rad; and at rest beside the set point by what the proportional torque holds, Fs/kp

Each motion is followed `WOUND_UP` times as long as the integral takes from one breakaway to the other, 2 Fs/(ki |e|),
at the error of half a count q/2 or at that of hunting by stiction, about (Fs - Fc)/kp, whichever is smaller, but no
longer than `MOST_CHECKED` samples: a motion that rests is proven to (loop.py), of others the end is judged.
What still hunts gets the dead band of the integrator that ends it at the set points of this check.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

from ...axis_units import in_its_units
from ...results import Result
from ..drive import Drive, with_remedy
from ..outcome import BY_SEVERITY, SETTLES
from ..parts.loop import Loop
from ..parts.plain_loop import loop_asked
from ..servo import Servo
from .cause import cause_of, smallest_dead_band
from .motion import SampledMotion, followed, static_of, torque_gain

OFFSETS = (0.0, 0.25, 0.5)
"""Of the set point from a count, in counts."""
WOUND_UP = 20.0
"""Times that the integral is wound up from one side to the other in a motion that is followed."""
LEAST_DROP = 1e-2
"""Part of Fs that the drop Fs - Fc counts for at least, in that time."""
WIDER_BAND = 1.1
"""Of the smallest dead band at one set point: readings of another one may lie on its edge."""
MOST_CHECKED = 1_000_000
"""Samples of a motion of the check."""
SET_POINT_STEP = 1.0
"""Of the first start [rad]."""
UNENDED = {
    "undecided": "in {:.4g} s it neither comes to rest nor repeats its swings",
    "growing": "it leaves the set point for good",
}
BY_CAUSE = {
    "quantisation": "by quantisation", "stiction": "by stiction", "not certain": "by what, is not certain",
}  # fmt: skip


@dataclass(frozen=True, repr=False)
class AsBuilt(Result):
    """What a servo does in the loop as built.

    Attributes
    ----------
    kind : the worst verdict of its motions: "at rest", "decaying", "undecided", "hunting" or "growing".
    plain : what was seen; sentence : the same with what supports it, and where it hunts, why.
    dead_band : of the integrator, one that ends what still hunts at all set points of the check, a tenth more than the
        smallest at one of them [rad]; nan where nothing hunts, or none was found.
    worst : the motion of the worst verdict.

    Examples
    --------
    >>> from casahunt import Drive, Servo, as_built
    >>> as_built(Servo(), 2.0, Drive(sample_time=1e-3, encoder=2000, dead_band=0.004)).kind
    'at rest'
    """

    _quantities = ("kind", "dead_band [rad]")
    _details = ("plain", "sentence")

    kind: str
    plain: str
    sentence: str
    dead_band: float
    worst: SampledMotion

    @property
    def ends(self) -> bool:
        """Whether every motion comes to rest, or dies out."""
        return self.kind in SETTLES

    @property
    def goes_on(self) -> bool:
        """Whether a motion hunts on, or leaves the set point for good."""
        return self.kind in ("hunting", "growing")


@in_its_units
def as_built(servo: Servo | Loop, gain: float | None, drive: Drive) -> AsBuilt:
    """Whether a servo comes to rest in the loop as built, from a few starts and at a few set points.

    Parameters
    ----------
    servo, gain, drive
        the servo with Switch friction, its gain > 0, and its drive; or a loop of parts, at its own gain or another one.

    Returns
    -------
    AsBuilt.

    Examples
    --------
    >>> from casahunt import Drive, Servo, as_built
    >>> found = as_built(Servo(), 2.0, Drive(sample_time=1e-3, encoder=2000))
    >>> found.kind, round(found.dead_band, 5)  # rad: it hunts by counts
    ('hunting', 0.00173)
    """
    loop = loop_asked(servo, None, gain, usual="switch")
    motions = motions_of(loop, drive)
    worst = max(motions, key=lambda motion: BY_SEVERITY.index(motion.verdict.kind))
    kind, count = worst.verdict.kind, len(motions)
    if kind in SETTLES:
        how = "comes to rest for ever" if kind == "at rest" else "dies out"
        said = f"every one of {count} motions {how}"
        return AsBuilt(kind, said, said, math.nan, worst)
    beside = worst.set_point / drive.count if drive.encoder else 0.0
    where = f"{beside:g} of a count beside a reading" if beside else "on a reading" if drive.encoder else "0"
    text = f"with the set point {where} it is {kind}: {worst.verdict.sentence}"
    if kind != "hunting":
        return AsBuilt(kind, UNENDED[kind].format(worst.duration), text, math.nan, worst)
    cause = cause_of(worst)
    plain = "it hunts" if cause is None else f"it hunts, {BY_CAUSE[cause.kind]}"
    said = f"; {cause.kind}: {cause.sentence}" if cause is not None else ""
    first = cause.dead_band if cause is not None else smallest_dead_band(worst)
    return AsBuilt(kind, plain, f"{text}{said}", _ending(loop, drive, first), worst)


def motions_of(loop: Loop, drive: Drive) -> list[SampledMotion]:
    """The motions of the check."""
    (static, coulomb), q = static_of(loop), drive.count
    kp, ki = (torque_gain(loop, name) for name in ("kp", "ki"))
    error = max(static - coulomb, LEAST_DROP * static) / kp
    error = min(error, q / 2) if q else error
    length = max(WOUND_UP * 2 * static / (ki * error), drive.sample_time)
    length = min(length, MOST_CHECKED * drive.sample_time)
    starts = product(OFFSETS if q else (0.0,), (SET_POINT_STEP, static / kp))
    return [followed(loop, drive, offset * q, length, loop.at_rest(-beside)) for offset, beside in starts]


def _ending(loop: Loop, drive: Drive, first: float) -> float:
    """The dead band that ends it at all set points, from that of one of them; nan where none does."""
    band = WIDER_BAND * first
    for _ in range(len(OFFSETS) * 2):
        if math.isnan(band):
            return band
        motions = motions_of(loop, with_remedy(drive, "dead_band", band))
        left = [motion for motion in motions if motion.verdict.kind not in SETTLES]
        if not left:
            return band
        following = WIDER_BAND * smallest_dead_band(left[0])
        if not following > band:
            return math.nan
        band = following
    return math.nan
