"""The likeliest noise of records, and the likeliest model with it.

    D*(sigma) = min over z of D(z, sigma),    dD*/d log sigma = dD/d log sigma at that z:    secants to its zero

Symbols: m samples, z unknowns, D deviance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .climb import FIT_SETTLED, ROUGHLY_SETTLED, climb, settled_from
from .fit import Array, Point, Question, at
from .likelihood import LEAST_NOISE, Noise, likeliest

WIDE_NOISE = 0.3
"""Noise in units of the quantum of the first fit to counts: with less they are walls, along which no step leads."""
MOST_NOISE_STEPS, LONGEST_NOISE_STEP, NOISE_APART = 24, 0.5, 0.01
"""Of the logarithm of the noise, to where that is likeliest; and between two whose deviances are compared."""
SHORTEST_NOISE_STEP = 0.02
"""Half of one that was taken in vain, below which there is none."""
SETTLED_PART = 0.1
"""Of what another noise is expected to gain, to which the model with it is found."""
LESS_LIKELY = 0.05
"""Decrease of the deviance below which another noise is none that is likelier."""


def with_noise(question: Question, point: Point, noises: Sequence[Noise]) -> tuple[Point, list[Noise]]:
    """The likeliest noise and the likeliest point with it.

    Without rounding that is the scatter of what is left.  Counts that noise hardly moves are walls between which the
    model has room, and noise and model make up for each other: from wide noise on it is lowered with the model behind.
    """
    laid = list(zip(question.records, point.positions, strict=True))
    found = [likeliest(d.position, x, d.quantum, d.size) for d, x in laid]
    found = [replace(n, sigma=max(n.sigma, WIDE_NOISE * n.quantum)) for n in found]
    counted = any(n.quantum for n in found)
    again = settled_from(question, point.z, found, near=point, settled=ROUGHLY_SETTLED if counted else FIT_SETTLED)
    if again is None:
        return point, list(noises)
    point = again
    if not counted:
        found = [likeliest(d.position, x, 0.0, d.size) for d, x in zip(question.records, point.positions, strict=True)]
        return at(question, point.z, found, point) or point, found
    before, longest = None, LONGEST_NOISE_STEP
    for _ in range(MOST_NOISE_STEPS):
        size = np.log([n.sigma for n in found])
        slope, bend = _noise_slopes(question, point, found)
        if before is not None:
            moved = np.abs(size - before[0]) > 0
            secant = np.divide(slope - before[1], size - before[0], out=bend.copy(), where=moved)
            bend = np.where(secant > 0, secant, bend)
        step = np.clip(-slope / bend, -longest, longest)
        trial = [_scaled(n, math.exp(each)) for n, each in zip(found, step, strict=True)]
        gain = -float(slope @ (np.log([n.sigma for n in trial]) - size)) / 2
        if gain <= LESS_LIKELY or longest < SHORTEST_NOISE_STEP:
            break
        settled = min(max(SETTLED_PART * gain, FIT_SETTLED), ROUGHLY_SETTLED)
        again = at(question, point.z, trial, point)
        other = None if again is None else climb(question, again, trial, settled=settled)
        if other is None or other.deviance > point.deviance:
            longest = float(np.abs(step).max()) / 2
            continue
        before, point, found = (size, slope), other, trial
    return climb(question, point, found), found


def _noise_slopes(question: Question, point: Point, noises: Sequence[Noise]) -> tuple[Array, Array]:
    """First and second derivative of the deviance by the logarithm of each noise, the model as it is: at its optimum
    the first one is also that of the deviance with the model behind."""
    laid = list(zip(question.records, noises, point.positions, strict=True))
    less, at_it, more = (
        np.array([_scaled(noise, math.exp(way)).deviance(data.position, x) for data, noise, x in laid])
        for way in (-NOISE_APART, 0.0, NOISE_APART)
    )
    slope, bend = (more - less) / (2 * NOISE_APART), (more - 2 * at_it + less) / NOISE_APART**2
    return slope, np.maximum(bend, np.abs(slope) / LONGEST_NOISE_STEP)


def _scaled(noise: Noise, factor: float) -> Noise:
    return replace(noise, sigma=max(noise.sigma * factor, LEAST_NOISE * noise.quantum))
