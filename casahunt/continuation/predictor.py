"""The predictor: the last two points of a branch and their tangents, interpolated and carried on.

    z(s) through z_j with the derivatives z'_j at s_j,  j = 0 (here), 1 (before):  a cubic
    z = (x/sigma, ln sigma, ln T, ln p),    sigma the root mean square of each state over the unknowns

A cycle keeps its shape far longer than its size: along a branch sizes, durations and the parameter follow powers of one
another, so that it is their logarithms that polynomials tell.  A parameter that is not moved in units of its own value
may be zero, and stands as lambda itself.

The mesh moves along (moving_mesh.py): x are the states at the collocation points of intervals that start at the same
parts of the way, and the logarithms of the lengths of those are linear in s.

Symbols: n states, N intervals, P phases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..collocation.mesh import AS_GOOD_AS_ZERO, SHORTEST_INTERVAL
from ..collocation.transcription import Transcription
from .moving_mesh import Progress, carried, resampled

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
    way : how far the motion has come.
    """

    s: float
    t: Transcription
    u: Array
    du: Array
    fractions: Array
    lam: float
    rate: float
    way: Progress


@dataclass(frozen=True, eq=False)
class Bend:
    """The way along a branch from one of its points: z + s z' + s^2 c_0 + s^3 c_1.

    Attributes
    ----------
    here : z and z' at the point.
    coefficients : (k, size + n + 1) c, k = 0 or 2.
    lengths, drift : (N,) logarithms of the lengths of the intervals and their derivative; 0 where the mesh stays.
    way : how far the motion at the point has come along its cycle.
    """

    here: Logarithms
    coefficients: Array
    lengths: Array
    drift: Array
    way: Progress

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
        return _shares(t, self.lengths + ds * self.drift)

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


def _shares(t: Transcription, q: Array) -> Array:
    """(N,) lengths of the intervals from logarithms of what they are in proportion to."""
    f = np.exp(q)
    shares = f / _per_phase(t, f)
    if shares.size and shares.min() < SHORTEST_INTERVAL:
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
    lengths = np.log(here.fractions)
    return Bend(z, np.empty((0, z.value.size)), lengths, np.zeros_like(lengths), here.way)


def bent(here: RelativePoint, there: RelativePoint, sign: float) -> Bend | None:
    """The cubic through two points of a branch and their tangents.

    here, there: the point from which predictions are made, at s = 0, and another one, on a mesh of any kind; sign: as
    in `logarithms`. Returns bend; None where the motions are so unlike that the mesh of the one is none for the other.
    """
    sized, s = alive(here.t, here.u), there.s
    there = _on_mesh_of(here, there)
    if not np.all(there.fractions > 0):
        return None
    lengths = np.log(here.fractions)
    drift = (np.log(there.fractions) - lengths) / s
    z, other = (logarithms(_moving(place, drift), sign, sized) for place in (here, there))
    first = (other.value - z.value - s * z.rate) / s**2
    second = (other.rate - z.rate) / s
    return Bend(z, np.array([3 * first - second, (second - 2 * first) / s]), lengths, drift, here.way)


def _on_mesh_of(here: RelativePoint, place: RelativePoint) -> RelativePoint:
    """A point on the mesh whose intervals start at the same parts of the way as those of `here`."""
    t, old, n, N = here.t, place.t, here.t.n, here.t.intervals
    if t == old and np.array_equal(here.way.ways, place.way.ways):
        return place
    fractions = place.way.fractions(t, here.way.ways[:-1].reshape(N, -1)[:, 0])
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
