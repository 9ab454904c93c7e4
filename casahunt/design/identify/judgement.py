"""Does the model explain the record, what can the record not tell, and which further one would?

Standardised residuals, whatever the rounding: s_i/sqrt(I_i), score over its expected size, of mean 0 and variance 1.

    misfit     sum over parts of a period (sum s)^2/(sum I), over their number less that of the unknowns: 1 of noise;
               parts of as much time and way as each other, so that a slip has as many as the rest
    scatter    the same over consecutive stretches of time: above 1 where noise lasts longer than a sample
    unsteady   variance between stretches less that of the parts, and less what the samples within them make by
               chance; its root by the amplitude: of a motion that does not repeat, whatever the noise of its samples
    untold     v' J v small for a unit vector v of logarithms, J the marginal information: q_1^v_1 q_2^v_2 ... free
    doubt      sum I e^2, e the error that no record is free of: what it may shift lies in no residual, since it is
               fitted; of all errors of that size the worst raises the deviance at the true values by that much
    further    the gain with the largest ln det(J + J_gain) - ln det J, J_gain of a record as long and as noisy

Symbols: k parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..record.verdict import chi_square
from .fit import Array, Point, Question, at
from .intervals import NORMAL_95, Interval, marginal_information
from .likelihood import Noise
from .torque import residual

PARTS_OF_PERIOD = 40
"""Of a period over which residuals are summed."""
IMPROBABLE = 1e-3
"""Probability of so large a misfit of a model that is right, below which it is said not to explain the record."""
NEGLIGIBLE = 0.003
"""Systematic residual, relative to the amplitude, of a model that is good enough: records without noise show less."""
UNSURE = 0.01
"""The same below which the intervals are widened."""
UNSTEADY = 0.05
"""Difference of periods from one another, relative to the amplitude, above which they do not repeat.  Steady records
with noise of 1 % have 0.011 at most, with 15 % 0.035; drives whose derivative sees counts of the encoder 0.18, 0.29."""
MOST_OFF = 3.0
"""Errors of a measured period by which that of a model may be off, where it is one datum (swings.py); and of a mean
swing, which differs from that of the drive by what single ones do (built.py)."""
LASTING_ERROR = 3e-5
"""Error, relative to the amplitude, that lasts: of a transient's end, of rounded rests, of samples between which a
simulation was interpolated.  However many samples there are, none is told to more."""
UNTOLD = 0.25
"""Standard deviation of a combination of logarithms from which on the record does not tell it."""
IN_IT = 0.3
"""Part of a combination from which on a parameter is named."""
GAIN_UP, GAIN_DOWN, GAINS_ABOVE, GAINS_BELOW = 1.4, 0.5, 12, 1
"""Factors between the gains at which a further record is thought of; upwards as long as the servo hunts."""
LEAST_GAINED = 0.5
"""ln det below which a further record is not worth its name."""

LEAST_TOLD = 1e-6
"""Information about a logarithm that is added to all directions: one that nothing tells has the variance 1e6."""
MOST_MADE_UP = math.log(10)
"""By which the logarithm of a parameter is moved at most, to make up for another one."""


@dataclass(frozen=True)
class Judgement:
    """How well the model explains the records.

    Attributes
    ----------
    misfit : of the model, 1 where the residual is noise.
    scatter : of stretches of time.
    fits : the misfit may be chance, or is negligible.
    systematic : what is left over a period, relative to the amplitude (root mean square, noise taken off).
    factor : by which the rise of the deviance at the ends of intervals is multiplied.
    unsteady : by how much periods differ from one another, relative to the amplitude.
    """

    misfit: float
    scatter: float
    fits: bool
    systematic: float
    factor: float
    unsteady: float

    @property
    def repeats(self) -> bool:
        """Whether the periods are alike but for noise."""
        return self.unsteady <= UNSTEADY

    @property
    def explained(self) -> bool:
        """Whether the records bear the model out: it fits, and not because what does not repeat is taken for noise."""
        return self.fits and self.repeats


def judged(question: Question, point: Point, noises: Sequence[Noise]) -> Judgement:
    """The misfit of the best point."""
    parts: list[float] = []
    stretches: list[float] = []
    left, size, differ = 0.0, 0.0, 0.0
    doubt, trusted = 0.0, max(LASTING_ERROR, question.options.tol, *(data.left_out for data in question.records))
    for (periods, part), noise, y, x, whole in _channels(question, point, noises):
        score = noise.slopes(y, x).score
        offset = float(y[0] % noise.quantum) if noise.quantum else 0.0
        information = noise.information(x, offset)
        doubt += float(np.sum(information)) * (trusted * whole) ** 2
        own = periods * PARTS_OF_PERIOD + part
        for by, into in ((part, parts), (own, stretches)):
            sums, sizes = np.bincount(by, score), np.bincount(by, information)
            told = sizes > 1e-3 * sizes.mean()
            into += list(sums[told] ** 2 / sizes[told])
        mean, count = _means(part, y - x)
        of_own, each = _means(own, y - x)
        sampled = (np.sum((y - x) ** 2) - np.sum(each * of_own**2)) / max(y.size - each.size, 1)
        by_chance = sampled * (np.mean(1 / each) - np.mean(1 / count))
        differ += max(float(np.mean(of_own**2) - np.mean(mean**2) - by_chance), 0.0) / whole**2
        left += float(np.mean(np.maximum(mean**2 - noise.variance / count, 0.0))) / whole**2
        size += 1
    unknowns = point.z.size
    misfit, chance = _ratio(parts, unknowns)
    scatter, other = _ratio(stretches, unknowns)
    periods_off = [row.deviance for row in point.rows if row.values.size == 1]
    factor = max(1.0, misfit if chance < UNSURE else 1.0, scatter if other < UNSURE else 1.0)
    factor += doubt / NORMAL_95**2
    systematic = math.sqrt(left / size)
    # What the mean swings of the records differ by from those of their drives, relative to the amplitude.
    built = [data.apart / data.amplitude for data in question.records if data.apart is not None]
    apart = math.sqrt(sum(float(np.mean(np.sum(of**2, axis=1))) for of in built) / len(question.records))
    fits = chance >= IMPROBABLE or systematic < max(NEGLIGIBLE, MOST_OFF * apart)
    fits = fits and sum(periods_off) <= MOST_OFF**2 * len(periods_off)
    return Judgement(misfit, scatter, fits, systematic, factor, math.sqrt(differ / size))


def _means(by: Array, values: Array) -> tuple[Array, Array]:
    """Of the values of each number, and how many there are; of numbers that there are."""
    count = np.bincount(by)
    held = count > 0
    return np.bincount(by, values)[held] / count[held], count[held]


def _channels(
    question: Question, point: Point, noises: Sequence[Noise]
) -> Iterator[tuple[tuple[Array, Array], Noise, Array, Array, float]]:
    """What was measured, positions and torques: parts of the period, noise, measured and computed, amplitude."""
    laid = zip(question.records, noises, point.orbits, point.positions, point.torques, strict=True)
    for i, (data, noise, orbit, x, m) in enumerate(laid):
        # which period each sample belongs to, from 0 on, and which part of it
        phase = data.times / data.period - point.z[question.own(i).start]
        times, states = orbit.sample()
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(states[0])))])
        done = np.interp(phase % 1 * times[-1], times, (times / times[-1] + way / way[-1]) / 2)
        periods = np.floor(phase).astype(int)
        parts = periods - periods.min(), np.minimum(done * PARTS_OF_PERIOD, PARTS_OF_PERIOD - 1).astype(int)
        yield parts, noise, data.position, x, data.amplitude
        if data.torque is not None and m is not None:
            r, sigma = residual(data.torque, m)
            yield parts, Noise(sigma, 0.0), m + r, m, float(np.ptp(m)) / 2


def _ratio(squares: list[float], unknowns: int) -> tuple[float, float]:
    """Their sum over its expectation, and the probability of a larger one."""
    freedom = max(len(squares) - unknowns, 1)
    total = float(np.sum(squares))
    return total / freedom, 1 - chi_square(freedom, min(total, 1e4 * freedom))


def untold(question: Question, J: Array, factor: float) -> list[dict[str, float]]:
    """Combinations that the records do not tell: powers of the parameters in each, the largest one 1."""
    values, vectors = np.linalg.eigh(J)
    found = []
    for value, v in zip(values, vectors.T, strict=True):
        if value > 0 and math.sqrt(factor / value) < UNTOLD:
            continue
        v = v / v[np.argmax(np.abs(v))]
        found.append({name: float(part) for name, part in zip(question.free, v, strict=True) if abs(part) >= IN_IT})
    return found


def further_gain(
    question: Question, point: Point, noises: Sequence[Noise], ends: Sequence[Interval]
) -> tuple[float, float] | None:
    """(gain, information gained) of the further record that would tell most; None where none would tell much.

    ends: the intervals of the parameters; a higher gain is one at which the servos at the ends of all of them hunt too.
    """
    J = marginal_information(question, point)
    data, noise = question.records[0], noises[0].plain
    known = np.linalg.slogdet(J)[1]
    z = np.concatenate([point.z[: len(question.free)], [0.0, 0.0]])

    def at_gain(gain: float) -> Question:
        return replace(question, records=(replace(data, gain=gain, torque=None),))

    def gained(gain: float) -> float | None:
        other = at_gain(gain)
        there = at(other, z, [noise])
        if there is None:
            return None
        return float(np.linalg.slogdet(J + marginal_information(other, there))[1] - known) / 2

    found = [(data.gain * GAIN_DOWN**k, gained(data.gain * GAIN_DOWN**k)) for k in range(1, GAINS_BELOW + 1)]
    for k in range(1, GAINS_ABOVE + 1):
        found.append((data.gain * GAIN_UP**k, gained(data.gain * GAIN_UP**k)))
        if found[-1][1] is None:
            break
    told = sorted(((more, gain) for gain, more in found if more is not None and more > LEAST_GAINED), reverse=True)
    for more, gain in told:
        if gain < data.gain or all(at(at_gain(gain), other, [noise]) for other in _at_ends(question, z, J, ends)):
            return gain, more
    return None


def _at_ends(question: Question, z: Array, J: Array, ends: Sequence[Interval]) -> Iterator[Array]:
    """The unknowns where one parameter is at an end of its interval, and the others make up for it."""
    C, q = np.linalg.inv(J + LEAST_TOLD * np.eye(len(J))), question.numbers(z)
    for j, end in enumerate(ends):
        for value in (end.low, end.high):
            if 0 < value < math.inf and q[j] > 0:
                by = np.clip(C[:, j] / C[j, j] * math.log(value / q[j]), -MOST_MADE_UP, MOST_MADE_UP)
                yield np.concatenate([question.unknowns(q * np.exp(by)), [0.0, 0.0]])
