"""Meshes that move with a branch: their intervals start at fixed parts of the way of the motion, not of its time.

The fast part of a phase stands at another fraction of its duration at every point of a branch.  At a fixed fraction the
states jump from one orbit to the next; at a fixed part of the way they change as little as the orbit does.

    xi(tau) = integral_0^tau |(x/sigma)', WAY_AT_REST| / integral_0^1       in every phase

Times and ways of the collocated phases are counted from 0 to 1 in the first one, from 1 to 2 in the second, and so on.

Symbols: n states, d stages, N intervals, K collocated phases.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from ..collocation.mesh import AS_GOOD_AS_ZERO
from ..collocation.scheme import Kind, scheme
from ..collocation.transcription import Transcription

Array = np.ndarray

WAY_AT_REST = 0.03
"""The way that time alone is, in a phase: where nothing moves, a mesh goes by the time."""


def stiff(t: Transcription) -> bool:
    """Whether meshes move along: in smooth modes, of few and long intervals, they would cost more steps than they
    save."""
    return any(mode.stiff for mode, _ in t.modes)


def starts(t: Transcription, fractions: Array) -> Array:
    """Times at which the intervals start.

    t, fractions: transcription, and (N,) lengths of the intervals. Returns (N,), counted on from phase to phase.
    """
    ends = np.cumsum(fractions)
    first = (ends - fractions)[t.first_intervals]
    return ends - fractions + np.repeat(np.arange(first.size) - first, t.collocated_counts)


@dataclass(frozen=True, eq=False)
class Progress:
    """How far a motion has come, as a function of the time.

    Attributes
    ----------
    times, ways : (m + 1,) at the collocation points and at the end.
    after, before : (m,) d way/d time behind every one of them but the last, and before every one but the first.
    """

    times: Array
    ways: Array
    after: Array
    before: Array

    def fractions(self, t: Transcription, places: Array) -> Array:
        """Lengths of intervals that start at given parts of the way.

        t, places: transcription, and (N,) ways at which its intervals start, the first of each phase at its start.
        Returns (N,).
        """
        i = np.clip(np.searchsorted(self.ways, places, side="right") - 1, 0, self.after.size - 1)
        across, time = self.ways[i + 1] - self.ways[i], self.times[i + 1] - self.times[i]
        s = (places - self.ways[i]) / across
        # The cubic through both ends with their slopes, where these are not the ends of a jump.
        bends = (1 - s) * (across / self.after[i] - time) + s * (time - across / self.before[i])
        at = self.times[i] + s * time + s * (1 - s) * np.clip(bends, -time, time)
        at[t.first_intervals] = np.arange(t.first_intervals.size)
        ends = np.append(at[1:], float(t.first_intervals.size))
        ends[t.first_intervals[1:] - 1] = np.arange(1, t.first_intervals.size)
        return np.asarray(ends - at)


def way_of(t: Transcription, u: Array, fractions: Array) -> Progress:
    """The way of a motion, on any mesh the same: the size of a state is its root mean square over the phases.

    t, u, fractions: transcription, unknowns, (N,) lengths of the intervals.
    """
    slope, sums, points = _rules(t.degree, t.kind)
    steps, f = np.diff(points), fractions[:, None]
    x = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    square = np.einsum("i,j,ijk->k", fractions, t.scheme.weights, x[:, 1:] ** 2) / max(t.collocated_counts.size, 1)
    v = slope @ (x / np.where(square > AS_GOOD_AS_ZERO**2, np.sqrt(square), 1.0))
    speed = np.sqrt(np.einsum("ijk,ijk->ij", v, v) + (WAY_AT_REST * f) ** 2)
    lengths = np.maximum(np.diff(speed[:, 1 : t.degree + 1] @ sums, axis=1, prepend=0.0), WAY_AT_REST * f * steps)
    own = lengths.sum(axis=1)
    count = t.collocated_counts
    whole = np.repeat(np.add.reduceat(own, t.first_intervals), count)[:, None]
    lengths = lengths / whole
    phase = np.repeat(np.arange(count.size), count)
    ends = np.cumsum(lengths).reshape(lengths.shape)
    ways = ends - lengths + (phase - np.repeat((ends - lengths)[t.first_intervals, 0], count))[:, None]
    times, rate = starts(t, fractions)[:, None] + f * points[:-1], speed / (f * whole)
    end = float(count.size)
    return Progress(np.append(times, end), np.append(ways, end), rate[:, :-1].ravel(), rate[:, 1:].ravel())


def by_time(t: Transcription, fractions: Array) -> Progress:
    """The way of a motion that comes along as the time does.

    t, fractions: transcription, and (N,) lengths of the intervals.
    """
    points = _rules(t.degree, t.kind)[2][:-1]
    times = np.append(starts(t, fractions)[:, None] + fractions[:, None] * points, float(t.collocated_counts.size))
    ones = np.ones(times.size - 1)
    return Progress(times, times, ones, ones)


@lru_cache(maxsize=32)
def _rules(degree: int, kind: Kind) -> tuple[Array, Array, Array]:
    """At start, stages and end (m + 1): slopes from values at the points, integrals (d, m) of values at the stages."""
    s = scheme(degree, kind)
    whole = s.points[-1] == 1.0
    points = s.points if whole else np.append(s.points, 1.0)
    local = legendre.legvander(2 * s.points - 1, degree)
    rates = np.array([legendre.legval(2 * points - 1, legendre.legder(row)) for row in np.eye(degree + 1)]).T
    return np.asarray(2 * rates @ np.linalg.inv(local)), (s.sums[:-1] if whole else s.sums).T.copy(), points


def resampled(t: Transcription, w: Array, fractions: Array, new: Transcription, to: Array) -> Array:
    """Polynomials on another mesh.

    t, w, fractions: transcription, (N, d + 1, m) values at the points of every interval, and the lengths of those; new,
    to: transcription of the same cycle and scheme, and the lengths of its intervals. Returns (N, d + 1, m) values.
    """
    old, count = starts(t, fractions), new.collocated_counts
    times = starts(new, to)[:, None] + to[:, None] * new.scheme.points
    last = t.first_intervals + t.collocated_counts - 1
    first, last = np.repeat(t.first_intervals, count)[:, None], np.repeat(last, count)[:, None]
    i = np.clip(np.searchsorted(old, times, side="right") - 1, first, last)
    local = (times - old[i]) / fractions[i]
    matrix = t.scheme.interpolation(local.ravel())
    out = (matrix[:, None] @ w[i.ravel()])[:, 0]
    return np.asarray(out.reshape(*times.shape, -1))


def carried(t: Transcription, w: Array, fractions: Array, rates: Array) -> Array:
    """By how much values change because the mesh moves.

    t, w, fractions: as in `resampled`; rates: (N,) derivatives of the fractions. Returns (N, d + 1, m).
    """
    moved = np.cumsum(rates) - rates
    moved -= np.repeat(moved[t.first_intervals], t.collocated_counts)
    speed = (moved[:, None] + rates[:, None] * t.scheme.points) / fractions[:, None]
    return np.asarray((_rules(t.degree, t.kind)[0][: t.degree + 1] @ w) * speed[:, :, None])
