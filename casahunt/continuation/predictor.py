"""The predictor: the last two points of a branch and their tangents, interpolated and carried on.

    z(s) through z_j with the derivatives z'_j at s_j,  j = 0 (here), 1 (before):  a cubic
    z = (x/sigma, ln sigma, ln T, ln p),    sigma the root mean square of each state over the unknowns

A cycle keeps its shape far longer than its size: along a branch sizes, durations and the parameter follow powers of one
another, so that it is their logarithms that polynomials tell.  A parameter that is not moved in units of its own value
may be zero, and stands as lambda itself.

The mesh moves along: the fast part of a phase stands at another fraction tau of its duration at every point of a
branch, and at a fixed fraction the states jump from one orbit to the next.  How fast the mesh goes, m = d tau/ds, the
tangent dx/ds and the motion x' tell, in every phase with m = 0 at its ends:

    integral_0^1 |dx/ds + m x'|^2 + (m')^2 d tau  =  min,     x and dx/ds by their sizes, and without what they grow

What is fast stays where it is on the mesh, what is slow stretches.  x are the states at the collocation points; the
logarithms of the lengths of the intervals are linear in s.

Symbols: n states, d stages, N intervals, P phases, K collocated phases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.polynomial import legendre

from ..collocation.mesh import AS_GOOD_AS_ZERO, SHORTEST_INTERVAL
from ..collocation.scheme import Kind, scheme
from ..collocation.transcription import Transcription

MOST_STRETCHED = 1.0
"""Largest logarithm by which an interval becomes longer or shorter in one step."""


def stiff(t: Transcription) -> bool:
    """Whether meshes always move along: in smooth modes, of few and long intervals, steps that are longer would lead
    past what happens on a branch."""
    return any(mode.stiff for mode, _ in t.modes)


def starts(t: Transcription, fractions: Array) -> Array:
    """Times at which the intervals start.

    t, fractions: transcription, and (N,) lengths of the intervals. Returns (N,), counted on from phase to phase.
    """
    ends = np.cumsum(fractions)
    first = (ends - fractions)[t.first_intervals]
    return ends - fractions + np.repeat(np.arange(first.size) - first, t.collocated_counts)


@lru_cache(maxsize=32)
def _rules(degree: int, kind: Kind) -> tuple[Array, Array, Array]:
    """At start, stages and end (m + 1): slopes from values at the points, integrals (d, m) of values at the stages."""
    s = scheme(degree, kind)
    whole = s.points[-1] == 1.0
    points = s.points if whole else np.append(s.points, 1.0)
    local = legendre.legvander(2 * s.points - 1, degree)
    rates = np.array([legendre.legval(2 * points - 1, legendre.legder(row)) for row in np.eye(degree + 1)]).T
    return np.asarray(2 * rates @ np.linalg.inv(local)), (s.sums[:-1] if whole else s.sums).T.copy(), points


def drift_along(t: Transcription, u: Array, du: Array, fractions: Array) -> Array:
    """How a mesh moves along a branch.

    t, u, du, fractions: transcription, unknowns, their derivative along the branch at fixed times, (N,) lengths of the
    intervals. Returns (N,) derivatives of the logarithms of those.
    """
    N, f, count, on = t.intervals, fractions, t.collocated_counts, t.scheme.points[1:]
    weights = f[:, None] * t.scheme.weights
    x, dx = (t.intervals_of(each).reshape(N, t.degree + 1, t.n) for each in (u, du))
    square, grown = (np.einsum("ij,ijk->k", weights, x[:, 1:] * each[:, 1:]) / max(count.size, 1) for each in (x, dx))
    size = np.where(square > AS_GOOD_AS_ZERO**2, np.sqrt(square), 1.0)
    speed = (_rules(t.degree, t.kind)[0][: t.degree + 1] @ (x / size) / f[:, None, None])[:, 1:]
    moves = ((dx - x * (grown / size**2)) / size)[:, 1:]
    steep, along = (weights * np.einsum("ijk,ijk->ij", each, speed) for each in (speed, moves))
    left = np.arange(N) + np.repeat(np.arange(count.size), count)  # of the N + K nodes, of each interval
    A, b = np.zeros((N + count.size, N + count.size)), np.zeros(N + count.size)
    shapes = (1 - on, on)
    for i, j in product((0, 1), (0, 1)):
        A[left + i, left + j] += steep @ (shapes[i] * shapes[j]) + (1 - 2 * (i != j)) / f
    for i in (0, 1):
        b[left + i] -= along @ shapes[i]
    ends = np.concatenate([left[t.first_intervals], left[t.first_intervals] + count])
    A[ends], b[ends] = np.eye(N + count.size)[ends], 0.0
    m = np.linalg.solve(A, b)
    return np.asarray((m[left + 1] - m[left]) / f)


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


Array = np.ndarray

FARTHEST_LOGARITHM = 1.0
"""Largest logarithm by which a size, a duration or the parameter is predicted to change."""


@dataclass(frozen=True, eq=False)
class Logarithms:
    """z and z' at a point of a branch, in the units of the one from which a prediction is made.

    Attributes
    ----------
    value, rate : (size + n + 1,) z and its derivative by some length.
    """

    value: Array
    rate: Array


@dataclass(frozen=True, eq=False)
class RelativePoint:
    """A point of a branch as it is seen from the one from which a prediction is made.

    Attributes
    ----------
    s : where it is.
    t, u, du, fractions : transcription, (size,) unknowns and their derivative by s, (N,) lengths of the intervals.
    lam, rate : lambda and its derivative by s.
    moves : whether the mesh moves along.
    """

    s: float
    t: Transcription
    u: Array
    du: Array
    fractions: Array
    lam: float
    rate: float
    moves: bool = True

    @property
    def drift(self) -> Array:
        """(N,) derivatives of the logarithms of the lengths of the intervals, where the mesh moves."""
        return drift_along(self.t, self.u, self.du, self.fractions) if self.moves else np.zeros(self.t.intervals)


@dataclass(frozen=True, eq=False)
class Bend:
    """The way along a branch from one of its points: z + s z' + s^2 c_0 + s^3 c_1.

    Attributes
    ----------
    here : z and z' at the point.
    coefficients : (k, size + n + 1) c, k = 0 or 2.
    lengths, drift : (N,) lengths of the intervals, and derivatives of their logarithms; 0 where the mesh stays.
    """

    here: Logarithms
    coefficients: Array
    lengths: Array
    drift: Array

    def ahead(self, ds: float) -> Array:
        """The point further on.

        ds: how far on. Returns (size + n + 1,) z.
        """
        z = self.here.value + ds * self.here.rate
        return z + ds**2 * (self.coefficients[0] + ds * self.coefficients[1]) if len(self.coefficients) else z

    def fractions(self, t: Transcription, ds: float) -> Array:
        """The mesh further on.

        t, ds: transcription, and how far on. Returns (N,) lengths of the intervals.
        """
        return _stretched(t, self.lengths, ds * self.drift)

    def through(self, ds: float, z: Array) -> Bend:
        """The same through a point further on: the highest power takes up the defect.

        ds, z: how far on, and (size + n + 1,) z there.
        """
        defect, c = z - self.ahead(ds), self.coefficients
        c = np.array([c[0], c[1] + defect / ds**3] if len(c) else [defect / ds**2, np.zeros_like(defect)])
        return replace(self, coefficients=c)

    def backwards(self) -> Bend:
        """The same, s being counted the other way."""
        here, signs = Logarithms(self.here.value, -self.here.rate), np.array([[1.0], [-1.0]])[: len(self.coefficients)]
        return replace(self, here=here, coefficients=self.coefficients * signs, drift=-self.drift)


def _stretched(t: Transcription, lengths: Array, by: Array) -> Array:
    """(N,) lengths of the intervals, from others and the logarithms of what those are stretched by."""
    if not by.any():
        return lengths
    f = lengths * np.exp(np.clip(by, -MOST_STRETCHED, MOST_STRETCHED))
    shares = f / _per_phase(t, f)
    if shares.min() < SHORTEST_INTERVAL:
        shares = np.maximum(shares, SHORTEST_INTERVAL)
        shares /= _per_phase(t, shares)
    return np.asarray(shares)


def _per_phase(t: Transcription, f: Array) -> Array:
    """(N,) for every interval the sum over its phase."""
    return np.repeat(np.add.reduceat(f, t.first_intervals), t.collocated_counts) if f.size else f


def alive(t: Transcription, u: Array) -> Array:
    """Which states are not zero all along.

    Returns (n,) bool.
    """
    return np.asarray(np.abs(u[: -t.phases].reshape(-1, t.n)).max(axis=0) > AS_GOOD_AS_ZERO)


def rms_of_states(t: Transcription, u: Array, sized: Array) -> Array:
    """Root mean squares of the states over the unknowns.

    t, u, sized: transcription, unknowns, and (n,) True for the states that have a size.
    Returns (n,), 1 where they have none.
    """
    x = u[: -t.phases].reshape(-1, t.n)
    return np.where(sized, np.sqrt(np.einsum("ij,ij->j", x, x) / len(x)), 1.0)


def logarithms(place: RelativePoint, sign: float, sized: Array) -> Logarithms:
    """z and z' at a point.

    sign: of the parameter there where lambda is in units of its value, which is then told by its logarithm; else 0;
    sized: (n,) True for the states that have a size.
    """
    t, u, du = place.t, place.u, place.du
    P, size = t.phases, rms_of_states(t, u, sized)
    x, dx = u[:-P].reshape(-1, t.n), du[:-P].reshape(-1, t.n)
    growth = np.where(sized, np.einsum("ij,ij->j", x, dx) / (len(x) * size * size), 0.0)
    durations, value, rate = u[-P:], place.lam, place.rate
    if sign:
        rate = rate / (1 + sign * value)
        value = sign * float(np.log1p(sign * value))
    shape = x / size
    return Logarithms(
        np.concatenate([shape.ravel(), np.log(size), np.log(durations), [value]]),
        np.concatenate([(dx / size - shape * growth).ravel(), growth, du[-P:] / durations, [rate]]),
    )


def unknowns(t: Transcription, z: Array, here: Array, sign: float) -> tuple[Array, float]:
    """The unknowns, and lambda, of z.

    z, here: (size + n + 1,) z, and that from which it was predicted; sign: as in `logarithms`.
    Returns (size,) u, and lambda.
    """
    P, n = t.phases, t.n
    logs = here[-1 - P - n :] + np.clip(z[-1 - P - n :] - here[-1 - P - n :], -FARTHEST_LOGARITHM, FARTHEST_LOGARITHM)
    u = np.empty(t.size)
    u[:-P] = (z[: -1 - P - n].reshape(-1, n) * np.exp(logs[:n])).ravel()
    u[-P:] = np.exp(logs[n : n + P])
    return u, sign * float(np.expm1(sign * logs[-1])) if sign else float(z[-1])


def straight(here: RelativePoint, sign: float) -> Bend:
    """The tangent alone, on the mesh as it is.

    here, sign: as in `bent`.
    """
    z = logarithms(here, sign, alive(here.t, here.u))
    return Bend(z, np.empty((0, z.value.size)), here.fractions, np.zeros_like(here.fractions))


def bent(here: RelativePoint, there: RelativePoint, sign: float) -> Bend:
    """The cubic through two points of a branch and their tangents.

    here, there: the point from which predictions are made, at s = 0, and another one, on a mesh of any kind; sign: as
    in `logarithms`.
    """
    sized, s, drift = alive(here.t, here.u), there.s, here.drift
    there = _on_mesh(there, here.t, _stretched(here.t, here.fractions, s * drift))
    z, other = (logarithms(_moving(place, drift), sign, sized) for place in (here, there))
    first = (other.value - z.value - s * z.rate) / s**2
    second = (other.rate - z.rate) / s
    return Bend(z, np.array([3 * first - second, (second - 2 * first) / s]), here.fractions, drift)


def _on_mesh(place: RelativePoint, t: Transcription, fractions: Array) -> RelativePoint:
    """A point on another mesh."""
    old, n, N = place.t, t.n, t.intervals
    if old == t and np.array_equal(place.fractions, fractions):
        return place
    both = np.concatenate([old.intervals_of(x).reshape(old.intervals, -1, n) for x in (place.u, place.du)], axis=2)
    both = resampled(old, both, place.fractions, t, fractions)
    u, du = np.empty(t.size), np.empty(t.size)
    for new, was, w in ((u, place.u, both[:, :, :n]), (du, place.du, both[:, :, n:])):
        new[N * t.rows :] = was[old.intervals * old.rows :]
        t.intervals_of(new)[:] = w.reshape(N, -1)
    return replace(place, t=t, u=u, du=du, fractions=fractions)


def _moving(place: RelativePoint, drift: Array) -> RelativePoint:
    """A point with the derivative of its unknowns on the mesh that moves."""
    t, f = place.t, place.fractions
    if not drift.any():
        return place
    du, rates = place.du.copy(), f * (drift - _per_phase(t, f * drift))
    w = t.intervals_of(place.u).reshape(t.intervals, t.degree + 1, t.n)
    t.intervals_of(du)[:] += carried(t, w, f, rates).reshape(t.intervals, -1)
    return replace(place, du=du)
