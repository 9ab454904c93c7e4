"""A record whose swings begin one by one: a controller that reads counts waits another time in each stick.

    t -> t + t*_j - t_j,    t_j: passage j through the level,    t*_j = t_0 + j T/2

What its integrator has summed of a position between two counts differs from stick to stick, so slips come earlier or
later, and that adds up: laid over a cycle of one period the tenth slip would be compared with a stick.  So each sample
is moved with the passage that is nearest; the period, the mean of the swings to and that of those fro, is one datum
with the errors of both means, and with their difference.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ...errors import InputError
from ..record.verdict import deviation
from ..record.waveform import SIDE
from .fit import Array, Data

FEWEST_TO_AND_FRO = 6
"""That tell a mean and how far it may be off."""
OWN_PART = 0.3
"""Of a period about a passage: what is farther off belongs to one that the record does not hold."""
STILL_SETTLING = 2
"""Swings behind a transient that are left out: a rest that is off by a count weighs as much as a whole slip."""
NOISY = 0.25
"""Share of the moves to another count that go against the one before, from which on counts carry noise (clipped.py)."""
LEAST_PERIOD_ERROR = 1e-4
"""Relative error below which a measured period is not trusted on the way."""


def passages(t: Array, y: Array, least: float) -> tuple[Array, Array]:
    """(n,) times at which positions y about their level pass it from beyond `least` on one side to the other, and 1
    where they rise, else -1."""
    strong = np.flatnonzero(np.abs(y) > least)
    turns = np.flatnonzero(np.diff(np.sign(y[strong])))
    found = []
    for i, j in zip(strong[turns], strong[turns + 1], strict=True):
        k = i + int(np.flatnonzero(y[i:j] * y[i] > 0)[-1])
        found.append(t[k] + (t[k + 1] - t[k]) * y[k] / (y[k] - y[k + 1]))
    return np.array(found), np.sign(y[strong[turns + 1]])


def one_by_one(data: Data, level: float) -> Data:
    """A record with its swings about a level [rad] so moved, and the period of these.  Raises InputError: too few."""
    t = data.times
    at, rising = passages(t, data.position - level, SIDE * data.amplitude)
    if at.size <= FEWEST_TO_AND_FRO:
        least = f"must hold more than {FEWEST_TO_AND_FRO} whole swings"
        raise InputError(f"{data.name}: {least}, not {at.size}; record longer")
    lasts = np.diff(at)
    ways = lasts[::2], lasts[1::2]
    period = float(sum(way.mean() for way in ways))
    scatter = [deviation(way) / math.sqrt(way.size) for way in ways]
    apart = float(ways[0].mean() - ways[1].mean())
    error = math.hypot(*scatter, apart, float(np.median(np.diff(t))) / at.size) / period
    near = np.searchsorted((at[1:] + at[:-1]) / 2, t)
    own = (np.abs(t - at[near]) < OWN_PART * period) & (near >= STILL_SETTLING)
    passage = (at[0] + np.arange(at.size) * period / 2)[near]
    return replace(
        data, times=(t - at[near] + passage)[own], position=data.position[own], passage=passage[own],
        rising=rising[near][own], period=period, period_error=max(error, LEAST_PERIOD_ERROR),
    )  # fmt: skip


def once_each(data: Data) -> Data:
    """A record without what a drive that reads counts says again and again.

    Of samples in a row that read one count the first and the last say it all: between them the position lay in it, too.
    Where a servo rests is one fact, and no so many independent ones.  Counts that noise moves say more, each by itself.
    """
    moves = np.sign(np.diff(data.position))
    moved = moves[moves != 0]
    if not data.quantum or data.passage is None or np.mean(moved[1:] != moved[:-1]) > NOISY:
        return data
    held = np.append(moves, 1) != 0
    return data.only(held | np.append(True, held[:-1]))
