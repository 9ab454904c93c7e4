"""The turning points of many members: turning_point.py for all of them in one loop.

With a row w along the curve at a known fold, a = w . (x_0 - x_0*, ln T_1 - ln T_1*) measures the way: with a held, the
equations are regular at the fold, and their tangent (du/da, dlambda/da = g) tells how far that is.  For every member:

    linearise at (u, lambda) -> Newton's step at fixed a, and the tangent
    da = -g / g',   g' from the last two g (the known fold's to begin with)         (u, lambda) += step + da tangent

until what a next step would bring is a small part of the tolerance; who is done leaves the batch.  The bend is never
believed to have another sign than that of the known fold: the loop leaves a smallest lambda where a largest is sought.
What it finds far from its start is another fold.  A member that is lost is approached by way of the turning point
halfway.

Symbols: B members, n states, P phases, y unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..collocation.linearisation import Linearisation
from ..collocation.newton import LARGEST_MOVE
from ..collocation.transcription import Setting, Transcription, settings_of
from ..errors import Status
from ..orbits.adapt import LEFT_OUT
from ..orbits.ensemble import sizes_of_steps
from .fold_expansion import Expansion

Array = np.ndarray

MOST_TURNS = 14
MOST_STATIONS, ORDER_LEFT_OUT = 3, 3
"""A way is halved at most so often; what an expansion to second order leaves out is of this order."""
BELIEVED_STEP = 0.1
"""A Newton step below this lets the tangent be believed."""
CLEAN_STEP = 0.1
"""Of the last way along the curve: two slopes are compared where Newton's steps at both are smaller than that."""
LARGEST_TURN = 0.3
"""Of one step along the curve, in scaled units."""


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
    start, u, lam, bends = u, u.copy(), lam.copy(), bend.copy()
    statuses = [Status.NOT_CONVERGED] * B
    last, slope, way = np.full(B, np.inf), np.full(B, np.nan), np.zeros(B)
    unclean = np.full(B, np.inf)
    active = np.arange(B)
    for iteration in range(MOST_TURNS):
        if not active.size:
            break
        lin = t.linearise(u[active], settings.of(active).moved(lam[active]))
        newton, tangent = step_and_tangent(t, u[active], lin, row)
        du, along_curve = lin.expand(newton, 1.0), lin.expand(tangent, 0.0)
        with np.errstate(all="ignore"):
            size = np.maximum(sizes_of_steps(t, u[active], du), np.abs(newton[:, -1]))
            length, g = sizes_of_steps(t, u[active], along_curve), tangent[:, -1]
            fresh = (g - slope[active]) / way[active]
            compared = np.maximum(size, unclean[active]) <= CLEAN_STEP * np.abs(way[active]) * length
            compared &= (way[active] != 0) & (fresh * bends[active] > 0)
            bends[active] = np.where(compared, fresh, bends[active])
            da = np.where(size <= BELIEVED_STEP, -g / bends[active], 0.0)
            da = np.clip(da, -LARGEST_TURN / length, LARGEST_TURN / length)
            total = np.maximum(size, np.abs(da) * length)
            du += da[:, None] * along_curve
            u[active] += du
            lam[active] += newton[:, -1] + da * g + 0.5 * bends[active] * da**2
            foreseen = np.where(last[active] < np.inf, total * (total / last[active]), np.inf)
        slope[active], way[active], unclean[active] = g, da, size
        finite = np.isfinite(total) & lin.finite()
        positive = (u[active][:, -t.phases :] > 0).all(axis=1)
        done = finite & positive & (size <= BELIEVED_STEP) & (foreseen <= LEFT_OUT * tol)
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
    return Found(u, lam, bends, statuses)


def step_and_tangent(t: Transcription, u: Array, lin: Linearisation, row: Array) -> tuple[Array, Array]:
    """Newton's step at fixed a, and the tangent with da = 1.

    t, u, lin, row: the equations linearised at (B, size) unknowns, and (n + 2,) weights of a. Returns both (B, y).
    """
    rhs = np.zeros((len(u), 2, t.system.size))
    rhs[:, 0] = lin.rhs()
    rhs[:, 1, -1] = 1.0
    y = t.system.solve(lin.matrix(borders(t, u, row)), rhs)
    return y[:, 0], y[:, 1]
