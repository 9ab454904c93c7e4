"""Why a drive hunts: stiction, which the continuous loop has too, or quantisation; and the dead band that ends it.

The same motion is computed without any quantisation.  Quantisation is the cause

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
from typing import Literal

import numpy as np

from ...axis_units import in_its_units, quantity
from ...results import Result
from ..drive import with_remedy
from ..outcome import SETTLES, Outcome
from .motion import SampledMotion, again

Array = np.ndarray

OTHERWISE = 0.1
"""Relative."""
READINGS_BEYOND = 3
"""Readings beyond a dead band that must end hunting too."""
WIDEST = 8.0
"""Dead bands in units of the largest error of the hunting, at most."""

Kind = Literal["stiction", "quantisation", "not certain"]


@dataclass(frozen=True, repr=False)
class Cause(Result):
    """Why a drive hunts.

    Attributes
    ----------
    kind : "stiction", "quantisation", or "not certain".
    sentence : what supports it.
    without : what the motion does without quantisation.
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
    Cause; None where it does not hunt, or its drive quantises nothing.

    Examples
    --------
    >>> from casahunt import Drive, Servo, cause_of, simulate_sampled
    >>> motion = simulate_sampled(Servo(), 2.0, Drive(sample_time=1e-3, encoder=2000), time=60.0)
    >>> cause_of(motion).kind
    'quantisation'
    """
    seen, drive = motion.verdict, motion.drive
    if seen.kind != "hunting" or not drive.quantises:
        return None
    without = again(motion, drive.exact()).verdict
    kind, sentence = told_apart(seen, without)
    counts = seen.amplitude / drive.count if drive.encoder else math.nan
    return Cause(kind, sentence, without, counts, smallest_dead_band(motion))


def told_apart(seen: Outcome, without: Outcome) -> tuple[Kind, str]:
    """Kind and sentence, from the verdicts on the same motion with and without quantisation."""
    if without.kind in SETTLES:
        return "quantisation", f"without quantisation the same loop does not hunt: {without.sentence}"
    if without.kind != "hunting":
        return "not certain", f"without quantisation the same loop is {without.kind}: {without.sentence}"
    off = max(abs(seen.mean_period / without.mean_period - 1), abs(seen.amplitude / without.amplitude - 1))
    hunts = f"without quantisation it hunts with {quantity(without.amplitude, 'rad')} and {without.period:.4g} s"
    hunts = f"{hunts}, {off:.1%} different in the mean"
    if seen.unevenness - without.unevenness > OTHERWISE:
        low, high = min(seen.lasts), max(seen.lasts)
        return "quantisation", f"{hunts}, and swings that take {without.lasts[-1]:.4g} s, not {low:.4g} to {high:.4g} s"
    return ("quantisation" if off > OTHERWISE else "stiction"), hunts


def smallest_dead_band(motion: SampledMotion) -> float:
    """The smallest dead band of the integrator that ends the hunting of a motion [rad]; nan where none was found."""
    sizes = _sizes(motion)

    def ends(i: int) -> bool:
        drive = with_remedy(motion.drive, "dead_band", float(sizes[i]))
        return all(again(motion, drive, from_end=late).verdict.kind == "at rest" for late in (True, False))

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
