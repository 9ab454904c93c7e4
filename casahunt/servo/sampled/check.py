"""Whether a servo with given numbers comes to rest in the loop as built, from a few starts and at a few set points.

    set points  on a count of the encoder, a quarter of one beside it, and half-way between two: on a count the error
                that is read can be 0, half-way it cannot
    starts      a step of 1 rad, or of one unit of length; and at rest beside the set point by what the proportional
                torque holds, Fs/kp

Each motion is followed `WOUND_UP` times as long as the integral takes from one breakaway to the other, 2 Fs/(ki |e|),
at the error of half a count q/2 or at that of hunting by stiction, about (Fs - Fc)/kp, whichever is smaller, but no
longer than `MOST_CHECKED` samples: a motion that rests is proven to (loop.py), of others the end is judged.
What still hunts gets the dead band of the integrator that ends it at the set points of this check.

Why a drive hunts: stiction, which the continuous loop has too, noise of the reading, or quantisation; and the dead band
that ends it.

The same motion is computed without noise, where there is any, and without any quantisation.  What was left out is the
cause

    where that motion comes to rest or dies out,
    or where it hunts, but by more than `OTHERWISE` with another amplitude, in another mean time of two swings, or with
    more even swings: what is seen is then not what the servo does by its friction.

An integrator that takes no notice of |e| <= dead_band ends either kind.  Readings are e = n q - theta_d, so that of all
dead bands only those next to the sizes of readings differ: they are tried in order of size, by halving, from the start
of the motion and from where it ended up; one ends hunting where both motions come to rest for ever, for it and for the
`READINGS_BEYOND` readings beyond it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from ...axis_units import in_its_units, quantity
from ...results import Result
from ..drive import Drive, with_remedy
from ..outcome import BY_SEVERITY, SETTLES, Outcome
from ..parts.loop import Loop, breakaway_of, static_of, torque_gain
from ..parts.plain_loop import loop_asked
from ..servo import Servo
from .motion import SampledMotion, again, followed

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
UNENDED = {
    "undecided": "in {:.4g} s it neither comes to rest nor repeats its swings",
    "growing": "it leaves the set point for good",
}
BY_CAUSE = {
    "noise": "by noise of the reading", "quantisation": "by quantisation", "stiction": "by stiction",
    "not certain": "by what, is not certain",
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
    hunts = f"it hunts with {quantity(worst.verdict.amplitude, 'rad', '.3g')}"
    plain = hunts if cause is None else f"{hunts}, {BY_CAUSE[cause.kind]}"
    said = f"; {cause.kind}: {cause.sentence}" if cause is not None else ""
    first = cause.dead_band if cause is not None else smallest_dead_band(worst)
    return AsBuilt(kind, plain, f"{text}{said}", _ending(loop, drive, first), worst)


def motions_of(loop: Loop, drive: Drive) -> list[SampledMotion]:
    """The motions of the check."""
    (static, coulomb), q = static_of(loop), drive.count
    kp, ki = (torque_gain(loop, name) for name in ("kp", "ki"))
    error = max(static - coulomb, LEAST_DROP * static) / kp
    error = min(error, q / 2) if q else error
    length = max(WOUND_UP * sum(breakaway_of(loop)) / (ki * error), drive.sample_time)
    length = min(length, MOST_CHECKED * drive.sample_time)
    starts = product(OFFSETS if q else (0.0,), (loop.units.step, static / kp))
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


Array = np.ndarray

OTHERWISE = 0.1
"""Relative."""
SEEN_FOR = 25
"""Periods of the hunting after which a motion that rests or hunts need not be looked at to its end."""
READINGS_BEYOND = 3
"""Readings beyond a dead band that must end hunting too."""
WIDEST = 8.0
"""Dead bands in units of the largest error of the hunting, at most."""

Kind = Literal["stiction", "noise", "quantisation", "not certain"]


@dataclass(frozen=True, repr=False)
class Cause(Result):
    """Why a drive hunts.

    Attributes
    ----------
    kind : "stiction", "noise", "quantisation", or "not certain".
    sentence : what supports it.
    without : what the motion does without noise, or where that is not the cause, without quantisation.
    counts : amplitude of the hunting in counts; nan without an encoder.
    dead_band : the smallest one of the integrator that ends it [rad]; nan where none was found.

    Examples
    --------
    >>> from casahunt import Drive, Servo, cause_of, simulate_sampled
    >>> cause = cause_of(simulate_sampled(Servo(), 2.0, Drive(sample_time=1e-3, encoder=2000), time=60.0))
    >>> cause.kind, cause.without.kind, round(cause.dead_band, 5)  # rad
    ('quantisation', 'decaying', 0.00157)
    """

    _quantities = ("kind", "counts", "dead_band [rad]")
    _details = ("sentence", "without = without.kind")

    kind: Kind
    sentence: str
    without: Outcome
    counts: float
    dead_band: float


@in_its_units
def cause_of(motion: SampledMotion) -> Cause | None:
    """Why a motion hunts.

    Parameters
    ----------
    motion
        of a drive.

    Returns
    -------
    Cause; None where it does not hunt, or its drive has neither noise nor quantisation.

    Examples
    --------
    >>> from casahunt import Drive, Servo, cause_of, simulate_sampled
    >>> motion = simulate_sampled(Servo(), 2.0, Drive(sample_time=1e-3, encoder=2000), time=60.0)
    >>> cause_of(motion).kind
    'quantisation'
    """
    seen, drive = motion.verdict, motion.drive
    others: dict[Kind, Drive] = {"noise": drive.quiet()} if drive.noise else {}
    others |= {"quantisation": drive.quiet().exact()} if drive.quantises else {}
    if seen.kind != "hunting" or not others:
        return None
    for of, other in others.items():
        without = again(motion, other).verdict
        kind, sentence = told_apart(seen, without, of)
        if kind != "stiction":
            break
        seen = without
    counts = motion.verdict.amplitude / drive.count if drive.encoder else math.nan
    return Cause(kind, sentence, without, counts, smallest_dead_band(motion))


def told_apart(seen: Outcome, without: Outcome, of: Kind = "quantisation") -> tuple[Kind, str]:
    """Kind and sentence, from the verdicts on the same motion with and without what may be the cause."""
    if without.kind in SETTLES:
        return of, f"without {of} the same loop does not hunt: {without.sentence}"
    if without.kind != "hunting":
        return "not certain", f"without {of} the same loop is {without.kind}: {without.sentence}"
    off = max(abs(seen.mean_period / without.mean_period - 1), abs(seen.amplitude / without.amplitude - 1))
    hunts = f"without {of} it hunts with {quantity(without.amplitude, 'rad')} and {without.period:.4g} s"
    hunts = f"{hunts}, {off:.1%} different in the mean"
    if seen.unevenness - without.unevenness > OTHERWISE:
        low, high = min(seen.lasts), max(seen.lasts)
        return of, f"{hunts}, and swings that take {without.lasts[-1]:.4g} s, not {low:.4g} to {high:.4g} s"
    return (of if off > OTHERWISE else "stiction"), hunts


def smallest_dead_band(motion: SampledMotion) -> float:
    """The smallest dead band of the integrator that ends the hunting of a motion [rad]; nan where none was found."""
    sizes, enough = _sizes(motion), SEEN_FOR * motion.verdict.mean_period

    def ends(i: int) -> bool:
        drive = with_remedy(motion.drive, "dead_band", float(sizes[i]))
        for late in (True, False):
            kind = again(motion, drive, from_end=late, time=min(enough, motion.duration)).verdict.kind
            if kind not in ("at rest", "hunting") and enough < motion.duration:
                kind = again(motion, drive, from_end=late).verdict.kind
            if kind != "at rest":
                return False
        return True

    low = -1  # sizes up to here do not end it
    while low < sizes.size - 1:
        high = low + 1
        step = 1
        while not ends(high):
            low = high
            if high == sizes.size - 1:
                return math.nan
            high, step = min(high + step, sizes.size - 1), 2 * step
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if ends(middle) else (middle, high)
        beyond = [i for i in range(high + 1, min(high + 1 + READINGS_BEYOND, sizes.size)) if not ends(i)]
        if not beyond:
            return float(sizes[high])
        low = beyond[-1]
    return math.nan


def _sizes(motion: SampledMotion) -> Array:
    """Dead bands between the sizes of readings, in order [rad]; without an encoder a tenth apart."""
    half = motion.states[0, motion.states.shape[1] // 2 :]
    farthest = WIDEST * float(np.abs(half).max())
    q, theta_d = motion.drive.count, motion.set_point
    if not q:
        first = motion.verdict.amplitude / 100
        return first * 1.1 ** np.arange(1 + max(0, math.ceil(math.log(farthest / first) / math.log(1.1))))
    n = np.arange(math.floor((theta_d - farthest) / q), math.ceil((theta_d + farthest) / q) + 2)
    read = np.unique(np.abs(n * q - theta_d))
    read = read[np.append(True, np.diff(read) > 1e-6 * q)]  # of both sides where the set point is on a count
    return (read[1:] + read[:-1]) / 2
