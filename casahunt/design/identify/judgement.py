"""Does the model explain the record, what can the record not tell, and which further one would?

Standardised residuals, whatever the rounding: s_i/sqrt(I_i), score over its expected size, of mean 0 and variance 1.

    misfit     sum over parts of a period (sum s)^2/(sum I), over their number less that of the unknowns: 1 of noise
    scatter    the same over consecutive stretches of time: above 1 where noise lasts longer than a sample
    untold     v' J v small for a unit vector v of logarithms, J the marginal information: q_1^v_1 q_2^v_2 ... free
    further    the gain with the largest ln det(J + J_gain) - ln det J, J_gain of a record as long and as noisy

Symbols: k parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import NoOrbit
from ...servo.find_fold import find_fold
from ..record.verdict import chi_square
from .fit import Array, Data, Point, Question, at
from .intervals import marginal_information
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
UNTOLD = 0.25
"""Standard deviation of a combination of logarithms from which on the record does not tell it."""
IN_IT = 0.3
"""Part of a combination from which on a parameter is named."""
FURTHER_GAINS = 7
"""Gains at which a further record is thought of."""
LOWEST_SHARE, HIGHEST_SHARE = 0.1, 0.95
"""Of the fold gain: between these the further record is sought."""
LEAST_GAINED = 0.5
"""ln det below which a further record is not worth its name."""


@dataclass(frozen=True)
class Judgement:
    """How well the model explains the records.

    Attributes
    ----------
    misfit : of the model, 1 where the residual is noise.
    scatter : of stretches of time.
    explained : the misfit may be chance, or is negligible.
    systematic : what is left over a period, relative to the amplitude (root mean square, noise taken off).
    factor : by which the rise of the deviance at the ends of intervals is multiplied.
    """

    misfit: float
    scatter: float
    explained: bool
    systematic: float
    factor: float


def judged(question: Question, point: Point, noises: Sequence[Noise]) -> Judgement:
    """The misfit of the best point."""
    parts: list[float] = []
    stretches: list[float] = []
    left, size = 0.0, 0.0
    for data, noise, y, x, whole in _channels(question, point, noises):
        score = noise.slopes(y, x).score
        offset = float(y[0] % noise.quantum) if noise.quantum else 0.0
        information = noise.information(x, offset)
        for by, into in ((_parts(data.times, data.period), parts), (_stretches(data.times, data.period), stretches)):
            sums, sizes = np.bincount(by, score), np.bincount(by, information)
            told = sizes > 1e-3 * sizes.mean()
            into += list(sums[told] ** 2 / sizes[told])
        by = _parts(data.times, data.period)
        held = np.bincount(by) > 0
        count = np.bincount(by)[held]
        mean = np.bincount(by, y - x)[held] / count
        left += float(np.mean(np.maximum(mean**2 - noise.variance / count, 0.0))) / whole**2
        size += 1
    unknowns = point.z.size
    misfit, chance = _ratio(parts, unknowns)
    scatter, other = _ratio(stretches, unknowns)
    factor = max(1.0, misfit if chance < UNSURE else 1.0, scatter if other < UNSURE else 1.0)
    systematic = math.sqrt(left / size)
    return Judgement(misfit, scatter, chance >= IMPROBABLE or systematic < NEGLIGIBLE, systematic, factor)


def _channels(
    question: Question, point: Point, noises: Sequence[Noise]
) -> Iterator[tuple[Data, Noise, Array, Array, float]]:
    """What was measured: record, noise, measured and computed, amplitude; of positions, and of torques if there are."""
    for data, noise, x, m in zip(question.records, noises, point.positions, point.torques, strict=True):
        yield data, noise, data.position, x, data.amplitude
        if data.torque is not None and m is not None:
            r, sigma = residual(data.torque, m)
            yield data, Noise(sigma, 0.0), m + r, m, float(np.ptp(m)) / 2


def _ratio(squares: list[float], unknowns: int) -> tuple[float, float]:
    """Their sum over its expectation, and the probability of a larger one."""
    freedom = max(len(squares) - unknowns, 1)
    total = float(np.sum(squares))
    return total / freedom, 1 - chi_square(freedom, min(total, 1e4 * freedom))


def _parts(times: Array, period: float) -> Array:
    return np.floor(times / period % 1 * PARTS_OF_PERIOD).astype(int) % PARTS_OF_PERIOD


def _stretches(times: Array, period: float) -> Array:
    return np.floor((times - times[0]) / period * PARTS_OF_PERIOD).astype(int)


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


def further_gain(question: Question, point: Point, noises: Sequence[Noise]) -> tuple[float, float] | None:
    """(gain, information gained) of the further record that would tell most; None where none would tell much."""
    J = marginal_information(question, point)
    first = point.orbits[0]
    try:
        fold = find_fold(first.servo, question.model, options=question.options.rough(), start=first).gain
    except NoOrbit:
        return None
    data, noise = question.records[0], noises[0].plain
    known = np.linalg.slogdet(J)[1]
    best: tuple[float, float] | None = None
    for gain in fold * np.geomspace(LOWEST_SHARE, HIGHEST_SHARE, FURTHER_GAINS):
        other = replace(question, records=(replace(data, gain=float(gain), torque=None),))
        z = np.concatenate([point.z[: len(question.free)], [0.0, 0.0]])
        there = at(other, z, [noise])
        if there is None:
            continue
        gained = float(np.linalg.slogdet(J + marginal_information(question, there))[1] - known) / 2
        if best is None or gained > best[1]:
            best = float(gain), gained
    return best if best is not None and best[1] > LEAST_GAINED else None
