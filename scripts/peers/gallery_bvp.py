"""scipy.integrate.solve_bvp on the gallery, as its user would pose a cycle of several pieces.

    every piece in units of its own duration, side by side: dY_i/ds = T_i f_i(t_i, Y_i),    i = 1 ... k,  0 < s < 1
    unknown parameters T_1 ... T_k, and the time t_1 of the start in a forced system
    conditions: each piece begins behind the last one, ends at its event, and the last one ends where the first begins

The order of the pieces, and the guess, come from a motion (gallery_shooting.py): one that has settled from the start,
or the cycle of a neighbour.  Without Jacobians, as most of its users do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_bvp
from scipy.interpolate import PPoly

from .gallery_shooting import ROUGH, Cycle, Failed, Scipy, Trace, returned, settled
from .gallery_systems import Known, Way

Array = np.ndarray
MOST_NODES = 20_000
DISTINCT = 1e-9
"""Points of the guess lie this far apart."""


class Guess:
    """The pieces of a motion round the cycle, on one mesh.

    Parameters
    ----------
    engine
        whose motion it is.
    u
        (k,) unknowns of its section.
    """

    def __init__(self, engine: Scipy, u: Array) -> None:
        known, engine.trace = engine.known, Trace()
        self.known, self.start = known, known.launch(u.tolist(), known.p)[0]
        returned(engine, u)
        traces, engine.trace = engine.trace.pieces, None
        self.names = [name for name, *_ in traces]
        self.ways: list[Way] = [
            next(way for way in known.pieces[name].ways if way.name == out) for name, out, _, _ in traces
        ]
        begins = [self.start, *[times[-1] for _, _, times, _ in traces]]
        self.durations = np.diff(begins)
        parts = [(times - t0) / T for (_, _, times, _), t0, T in zip(traces, begins[:-1], self.durations, strict=True)]
        mesh = np.unique(np.concatenate([np.linspace(0, 1, 11), *parts]).clip(0, 1))
        keep = np.append(np.diff(mesh) > DISTINCT, True)
        keep[0], keep[-2] = True, keep[-2] and mesh[-1] - mesh[-2] > DISTINCT
        self.mesh = mesh[keep]
        states = [y for _, _, _, y in traces]
        self.y = np.vstack([[np.interp(self.mesh, s, row) for row in y] for s, y in zip(parts, states, strict=True)])
        self.n = len(states[0])
        largest = np.max([np.max(np.abs(y), axis=1) for y in states], axis=0)
        self.size = np.where(largest > 0, largest, 1.0)


def solve(guess: Guess, known: Known, tol: float) -> Cycle:
    """The cycle by solve_bvp.

    Parameters
    ----------
    guess
        order of the pieces, mesh and states.
    known
        the system, perhaps at other parameters than the guess.
    tol
        of solve_bvp.

    Returns
    -------
    Cycle, its unknowns the parameters of the boundary value problem.

    Raises
    ------
    Failed : solve_bvp gives up.
    """
    n, k, size = guess.n, len(guess.names), guess.size
    p, forced = known.p, known.turn is not None
    pieces = [known.pieces[name] for name in guess.names]
    scale = np.tile(size, k)

    def field(s: Array, y: Array, q: Array) -> Array:
        rows, begin = [], q[k] if forced else 0.0
        for i, piece in enumerate(pieces):
            x = y[i * n : (i + 1) * n] * size[:, None]
            rates = piece.field(begin + q[i] * s, x, p, np)
            rows += [q[i] * (rate + 0.0 * s) / size[j] for j, rate in enumerate(rates)]
            begin = begin + q[i]
        return np.vstack(rows)

    def ends(y0: Array, y1: Array, q: Array) -> Array:
        out: list[Any] = []
        time = q[k] if forced else 0.0
        for i, way in enumerate(guess.ways):
            end = y1[i * n : (i + 1) * n] * size
            time += q[i]
            out.append(way.function(time, end, p, np))
            if i + 1 < k:
                behind = end if way.behind is None else np.array(way.behind(time, end, p))
                out += list((y0[(i + 1) * n : (i + 2) * n] * size - behind) / size)
        u = known.land(time, end, p)
        begin, first = known.launch(u, p)
        out += list(y0[:n] - np.array(first) / size)
        return np.array([*out, begin - q[k]] if forced else out)

    q = np.append(guess.durations, guess.start) if forced else guess.durations
    try:
        found = solve_bvp(field, ends, guess.mesh, guess.y / scale[:, None], p=q, tol=tol, max_nodes=MOST_NODES)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise Failed(f"solve_bvp: {error}") from None
    if not found.success:
        raise Failed(f"solve_bvp: {found.message}")
    time = known.parts * float(np.sum(found.p[:k]))
    if not 0.5 < time / (known.parts * float(np.sum(guess.durations))) < 2:
        raise Failed(f"solve_bvp went to a solution of period {time:.4g}")
    return Cycle(found.p, known.turn(p) if known.turn else time, _largest(found.sol, n, k) * float(size[0]))


def _largest(spline: Any, n: int, k: int) -> float:
    """The largest size of the first state, where its spline turns or ends."""
    sizes = []
    for i in range(k):
        one = PPoly(spline.c[:, :, i * n], spline.x)
        turns = one.derivative().roots(extrapolate=False)
        at = np.concatenate([[0.0, 1.0], turns[np.isfinite(turns)]])
        sizes.append(float(np.max(np.abs(one(at)))))
    return max(sizes)


def from_the_start(known: Known, tol: float, method: str) -> Cycle:
    """The cycle by solve_bvp from a motion that has settled.

    Parameters
    ----------
    known
        the system.
    tol
        of solve_bvp.
    method
        of solve_ivp.

    Returns
    -------
    Cycle.

    Raises
    ------
    Failed : there is none.
    """
    engine = Scipy(known, ROUGH, method)
    return solve(Guess(engine, settled(engine)), known, tol)
