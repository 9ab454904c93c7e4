"""A known fold and how it changes with parameters; the folds of problems nearby, from where they are to be expected.

    z(q) = z_0 + sum_i dz/dl_i (l_i - l_i0) + 1/2 d2z/dl_i^2 (l_i - l_i0)^2,     l = ln q,    z = (x, ln T, ln value)

The turning points of all members are found in one loop, for every member until what a next step would bring is a small
part of the tolerance; who is done leaves the batch:

    linearise at (u, lambda) -> Newton's step at fixed a, and the tangent -> the way along it
    (collocation/newton.py)

What it finds far from its start is another fold.  A member that is lost is approached by way of the turning point
halfway.

Symbols: B members, k parameters that differ, n states, P phases, y unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..collocation.newton import ACCEPTED_STEP, LARGEST_MOVE, MOST_TURNS, Turn
from ..collocation.scheme import Kind
from ..collocation.transcription import Setting, Transcription, settings_of, transcribe
from ..errors import Status
from ..hybrid.problem import Problem
from ..hybrid.system import Signature
from ..orbits.adapt import LEFT_OUT
from ..orbits.ensemble import sizes_of_steps
from .curve import along

Array = np.ndarray

FARTHEST = 2.0
"""Largest logarithm by which a duration or the value is expected to change."""
MOST_STATIONS, ORDER_LEFT_OUT = 3, 3
"""A way is halved at most so often; what an expansion to second order leaves out is of this order."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """A known fold, and how it changes with parameters; arrays alone, so that any worker can be sent it.

    Attributes
    ----------
    problem : at the fold.
    vary : name of the parameter that is largest there.
    signature, repeats, counts, degree, kind : its cycle and mesh.
    u : (size,) unknowns.
    fractions, scale : of its setting.
    row : (n + 2,) along the curve, without lambda.
    bend : d2 lambda/d a2 there.
    names : the k parameters of the expansion.
    first, second : (k, size + 1) derivatives of (x, ln T, ln value) by the logarithms of the parameters.

    Examples
    --------
    >>> from casahunt.continuation import expansion, largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> known = expansion(largest(orbit, "g"), ("omega",), 1e-6)
    >>> p = known.problem.vector()[None] * 1.001
    >>> change = known.expected(p)
    >>> change.shape == (1, known.u.size + 1), known.there(change)[1].round(3).tolist()
    (True, [13.779])
    """

    problem: Problem
    vary: str
    signature: Signature
    repeats: int
    counts: tuple[int, ...]
    degree: int
    kind: Kind
    u: Array
    fractions: Array
    scale: Array
    row: Array
    bend: float
    names: tuple[str, ...] = ()
    first: Array = field(default_factory=lambda: np.zeros((0, 0)))
    second: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def t(self) -> Transcription:
        """Its transcription."""
        return transcribe(self.problem.cycle(self.signature, self.repeats), self.counts, self.degree, self.kind)

    def setting(self) -> Setting:
        """Its setting, lambda being the parameter in its unit."""
        return Setting(self.fractions, self.problem.vector(), self.scale, along(self.problem, self.vary))

    def expected(self, p: Array) -> Array:
        """(B, size + 1) changes of (x, ln T, ln value) expected at parameters p (B, np)."""
        t, own = self.t, self.problem.vector()
        at = [self.problem.names.index(name) for name in self.names]
        usable = (own[at] > 0) & (p[:, at] > 0)
        logs = np.log(np.where(usable, p[:, at], 1.0) / np.where(own[at] > 0, own[at], 1.0))
        logs = np.where(usable, logs, 0.0)
        change = np.zeros((len(p), t.size + 1))
        for i in range(len(at)):  # in turn, so that no sum depends on how many members there are
            change += logs[:, i : i + 1] * (self.first[i] + 0.5 * logs[:, i : i + 1] * self.second[i])
        return change

    def there(self, change: Array) -> tuple[Array, Array]:
        """(unknowns (B, size), value of the parameter (B,)) after changes (B, size + 1) of (x, ln T, ln value)."""
        t = self.t
        change = change.copy()
        change[:, -1 - t.phases :] = np.clip(change[:, -1 - t.phases :], -FARTHEST, FARTHEST)
        u = self.u + change[:, :-1]
        u[:, -t.phases :] = self.u[-t.phases :] * np.exp(change[:, -1 - t.phases : -1])
        return u, self.problem.value(self.vary) * np.exp(change[:, -1])

    def changes(self, u: Array, values: Array) -> Array:
        """What leads from the known fold to another point.

        Parameters
        ----------
        u, values
            (B, size) unknowns, and (B,) values of the parameter.

        Returns
        -------
        (B, size + 1) changes of (x, ln T, ln value).
        """
        P = self.t.phases
        change = np.column_stack([u - self.u, np.log(values / self.problem.value(self.vary))])
        change[:, -1 - P : -1] = np.log(u[:, -P:] / self.u[-P:])
        return change

    def halfway(self, p: Array) -> Array:
        """(B, np) parameters halfway to p (B, np), in logarithms where both ends are positive."""
        own = self.problem.vector()
        positive = (own > 0) & (p > 0)
        with np.errstate(invalid="ignore"):
            return np.where(positive, np.sqrt(own * p), (own + p) / 2)


@dataclass(frozen=True, eq=False)
class Found:
    """Where the members of a loop have ended: unknowns, lambda, bend, statuses."""

    u: Array
    lam: Array
    bend: Array
    statuses: list[Status]


def settings_at(known: Expansion, p: Array, values: Array) -> Setting:
    """Settings of members, lambda being the parameter in its unit there.

    p, values: (B, np) parameters, and (B,) values of the one that is largest.
    """
    p = p.copy()
    p[:, known.problem.names.index(known.vary)] = values
    units = np.array([known.problem.unit(known.vary, float(value)) for value in values])
    directions = units[:, None] * known.problem.direction(known.vary)
    return settings_of(known.setting(), p, directions)


def from_expansion(known: Expansion, p: Array, tol: float, stations: int = MOST_STATIONS) -> tuple[Found, Setting]:
    """The turning points of members, from where they are expected.

    What the expansion leaves out goes with the cube of the way: where a member is lost, the turning point halfway tells
    how much that is, and is itself found so.

    p, tol: (B, np) parameters; relative error that is wanted; stations: how often the way may be halved.
    Returns found, and the settings there.
    """
    change = known.expected(p)
    found, settings = _from(known, p, change, np.full(len(p), known.bend), tol)
    lost = np.array([i for i, status in enumerate(found.statuses) if status is not Status.CONVERGED], dtype=int)
    if not stations or not lost.size:
        return found, settings
    between = known.halfway(p[lost])
    half, at_half = from_expansion(known, between, tol, stations - 1)
    kept = [i for i, status in enumerate(half.statuses) if status is Status.CONVERGED]
    if not kept:
        return found, settings
    values = at_half.p[kept, known.problem.names.index(known.vary)]
    left_out = known.changes(half.u[kept], values) - known.expected(between[kept])
    again = lost[kept]
    second, there = _from(known, p[again], change[again] + 2**ORDER_LEFT_OUT * left_out, half.bend[kept], tol)
    found.u[again], found.lam[again], found.bend[again] = second.u, second.lam, second.bend
    settings.p[again], settings.dp[again] = there.p, there.dp
    for i, status in zip(again, second.statuses, strict=True):
        found.statuses[i] = status
    return found, settings


def _from(known: Expansion, p: Array, change: Array, bends: Array, tol: float) -> tuple[Found, Setting]:
    """Turning points from changes (B, size + 1) of the known fold and bends (B,); and the settings there."""
    u, values = known.there(change)
    settings = settings_at(known, p, values)
    found = turning_points(known.t, u, np.zeros(len(p)), settings, known.row, bends, tol)
    return found, settings.moved(found.lam)


def borders(t: Transcription, u: Array, row: Array) -> Array:
    """The border rows of many members, as `adapt.curve_border`.

    t, u, row: transcription, (B, size) unknowns, and (n + 2,) weights. Returns (B, .).
    """
    out = np.zeros((len(u), (t.phases + 1) * t.n + t.phases + 1))
    out[:, : t.n] = row[: t.n]
    out[:, (t.phases + 1) * t.n] = row[t.n] / u[:, -t.phases]
    out[:, -1] = row[-1]
    return out


def turning_points(
    t: Transcription, u: Array, lam: Array, settings: Setting, row: Array, bend: Array, tol: float
) -> Found:
    """The loop of the module docstring.

    t, u, lam, settings: the equations, and where to start: (B, size) and (B,); row, bend: (n + 2,) along the curve,
    without lambda; (B,) d2 lambda/d a2, about, and with its sign; tol: relative error that is wanted.
    """
    B = len(u)
    start, u, lam, turn = u, u.copy(), lam.copy(), Turn(bend)
    statuses = [Status.NOT_CONVERGED] * B
    last, active = np.full(B, np.inf), np.arange(B)
    for iteration in range(MOST_TURNS):
        if not active.size:
            break
        lin = t.linearise(u[active], settings.of(active).moved(lam[active]))
        newton, tangent = lin.step_and_tangent(borders(t, u[active], row))
        du, along_curve, g = lin.expand(newton, 1.0), lin.expand(tangent, 0.0), tangent[:, -1]
        with np.errstate(all="ignore"):
            size = np.maximum(sizes_of_steps(t, u[active], du), np.abs(newton[:, -1]))
            length = sizes_of_steps(t, u[active], along_curve)
            da = turn.way(active, size, length, g)
            total = np.maximum(size, np.abs(da) * length)
            u[active] += du + da[:, None] * along_curve
            lam[active] += newton[:, -1] + turn.rise(active, da, g)
            foreseen = np.where(last[active] < np.inf, total * (total / last[active]), np.inf)
        finite = np.isfinite(total) & lin.finite()
        positive = (u[active][:, -t.phases :] > 0).all(axis=1)
        done = finite & positive & (size <= ACCEPTED_STEP) & (foreseen <= LEFT_OUT * tol)
        grows = (iteration > 2) & (total > 2 * last[active])
        last[active] = total
        moved = np.abs(t.nodes_of(u[active] - start[active])).reshape(active.size, -1).max(axis=1)
        for i in np.flatnonzero(done):
            statuses[active[i]] = Status.CONVERGED if moved[i] <= LARGEST_MOVE else Status.FAR_FROM_GUESS
        for i in np.flatnonzero(~finite):
            statuses[active[i]] = Status.NOT_FINITE
        for i in np.flatnonzero(finite & ~positive):
            statuses[active[i]] = Status.INADMISSIBLE
        active = active[finite & positive & ~done & ~grows]
    return Found(u, lam, turn.bend, statuses)
