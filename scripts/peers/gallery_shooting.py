"""Single shooting on the gallery: a return map u -> P(u), here by scipy's solve_ivp with events, and Newton's method.

    P(u) - u = 0,    its Jacobian by forward differences, kept as long as each step takes nine tenths off the residual

From a start off the cycle the motion is followed, roughly, until a return moves u by less than a hundredth of itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.integrate import solve_ivp

from .gallery_systems import Known

Array = np.ndarray
MOST_STEPS, MOST_RETURNS, MOST_PIECES = 20, 100, 1000
ROUGH, NEAR = 1e-5, 1e-2
"""Tolerance while the motion settles; it has settled when a return moves it by less than this."""
SMALL = 1e-3
"""Unknowns below this are as large as this."""
KEEPS = 0.1
"""A Jacobian is kept while the residual falls to this part of itself."""
LONG = 1e4
"""In this time an event is met."""


class Failed(Exception):
    """No cycle; the message says why."""


class Cycle(NamedTuple):
    """A cycle by a peer: unknowns, period, largest size of the first state."""

    unknowns: Array
    period: float
    largest: float


@dataclass
class Trace:
    """The pieces of a motion: (piece, name of the way out, its place among the ways, times, states (n, m)) of each."""

    pieces: list[tuple[str, str, Array, Array]] = field(default_factory=list)


class Engine(Protocol):
    """Something that follows motions."""

    known: Known

    def run(self, piece: str, t: float, y: Any, watch: bool = False) -> tuple[float, Array, float]:
        """From t, y to the section: time, state in front of it, largest size of the first state, where it is watched.

        Parameters
        ----------
        piece, t, y
            where the motion begins.
        watch
            look for the largest first state.
        """


class Scipy:
    """Motions by solve_ivp.

    Parameters
    ----------
    known
        the system.
    rtol
        relative tolerance; the absolute one is a thousandth of it, in units of the states' sizes.
    method
        of solve_ivp.
    """

    def __init__(self, known: Known, rtol: float, method: str) -> None:
        self.known, self.rtol, self.method = known, rtol, method
        self.size = np.ones(len(known.start[2]))
        self._seen = np.zeros(self.size.size)
        self.trace: Trace | None = None
        self._fields, self._events, self._rates = {}, {}, {}
        for name, piece in known.pieces.items():
            self._fields[name] = lambda t, y, f=piece.field: f(t, y.tolist(), known.p, math)
            self._rates[name] = lambda t, y, f=piece.field: f(t, y.tolist(), known.p, math)[0]
            self._events[name] = [self._event(way) for way in piece.ways]

    def _event(self, way: Any) -> Callable[[float, Array], float]:
        def event(t: float, y: Array) -> float:
            return way.function(t, y.tolist(), self.known.p, math)

        event.terminal, event.direction = True, way.direction  # type: ignore[attr-defined]
        return event

    def run(self, piece: str, t: float, y: Any, watch: bool = False) -> tuple[float, Array, float]:
        """See Engine."""
        left, largest, y = self.known.times, 0.0, np.array(y, float)
        for _ in range(MOST_PIECES):
            here = self.known.pieces[piece]
            if here.blind:
                t, y = self._blindly(piece, t, y, here.blind)
            events = [*self._events[piece], *([self._rates[piece]] if watch else [])]
            how = {"method": self.method, "rtol": self.rtol, "atol": self.rtol * 1e-3 * self.size}
            done = solve_ivp(self._fields[piece], (t, t + LONG), y, events=events, **how)
            met = [i for i, times in enumerate(done.t_events[: len(here.ways)]) if times.size]
            if done.status != 1 or not met:
                raise Failed(f"the motion does not leave {piece}: {done.message}")
            self._seen = np.maximum(self._seen, np.max(np.abs(done.y), axis=1))
            self.size = np.where(self._seen > 0, self._seen, 1.0)
            if watch:
                turns = done.y_events[-1][:, 0] if done.t_events[-1].size else np.zeros(0)
                seen = np.concatenate([turns, done.y[0, [0, -1]]])
                largest = max(largest, float(np.max(np.abs(seen))))
            way = here.ways[met[0]]
            t, y = float(done.t[-1]), done.y[:, -1]
            if self.trace is not None:
                self.trace.pieces.append((piece, way.name, done.t, done.y))
            left -= way.name == self.known.until
            if left == 0:
                return t, y, largest
            y = y if way.behind is None else np.array(way.behind(t, y, self.known.p))
            piece = self.known.next_piece(way.to, t, y)
        raise Failed(f"the section is not met in {MOST_PIECES} pieces")

    def _blindly(self, piece: str, t: float, y: Array, span: float) -> tuple[float, Array]:
        how = {"method": self.method, "rtol": self.rtol, "atol": self.rtol * 1e-3 * self.size}
        done = solve_ivp(self._fields[piece], (t, t + span), y, **how)
        return float(done.t[-1]), done.y[:, -1]


def returned(engine: Engine, u: Array, watch: bool = False) -> tuple[Array, float, float]:
    """(P(u), time that it takes, largest size of the first state on the way if it is watched)."""
    known = engine.known
    t, y = known.launch(u.tolist(), known.p)
    end, state, largest = engine.run(known.next_piece(known.first, t, y), t, y, watch)
    return np.array(known.land(end, state.tolist(), known.p)), end - t, largest


def settled(engine: Engine) -> Array:
    """Unknowns near the cycle that the motion from the start settles on."""
    known = engine.known
    piece, t, y = known.start
    end, state, _ = engine.run(piece, t, y)
    u = np.array(known.land(end, state.tolist(), known.p))
    for _ in range(MOST_RETURNS):
        before, u = u, returned(engine, u)[0]
        if np.max(np.abs(u - before) / np.maximum(np.abs(u), SMALL)) < NEAR:
            return u
    raise Failed(f"in {MOST_RETURNS} returns the motion does not settle")


def shoot(engine: Engine, u: Array, tol: float) -> Cycle:
    """Newton on P(u) - u from u.

    Parameters
    ----------
    engine
        what follows the motion.
    u
        (k,) near the cycle.
    tol
        relative size of the last step; sqrt(tol) is the step of the differences.

    Returns
    -------
    Cycle.

    Raises
    ------
    Failed : Newton does not converge.
    """
    known, J, last = engine.known, None, math.inf
    for _ in range(MOST_STEPS):
        there = returned(engine, u)[0]
        size = np.maximum(np.abs(u), SMALL)
        residual = (there - u) / size
        norm = float(np.max(np.abs(residual)))
        if norm < tol:
            break
        if J is None or norm > KEEPS * last:
            step = max(math.sqrt(tol), 1e-7)
            columns = [(returned(engine, u + step * size * e)[0] - there) / size / step for e in np.eye(u.size)]
            J = np.array(columns).T - np.eye(u.size)
        move = -np.linalg.solve(J, residual)
        if not np.isfinite(move).all() or np.max(np.abs(move)) > 1.0:
            raise Failed(f"Newton wants to move by {np.max(np.abs(move)):.2g} of the unknowns")
        u, last = u + move * size, norm
        if np.max(np.abs(move)) < tol:
            break
    else:
        raise Failed(f"Newton did not converge in {MOST_STEPS} steps")
    _, time, largest = returned(engine, u, watch=True)
    return Cycle(u, known.turn(known.p) if known.turn else known.parts * time, largest)


def solve(known: Known, rtol: float, method: str, guess: Array | None = None) -> Cycle:
    """The cycle by solve_ivp: from a near-by one's unknowns, or from the start.

    Parameters
    ----------
    known
        the system.
    rtol, method
        of solve_ivp.
    guess
        (k,) unknowns; None follows the motion from the start.

    Returns
    -------
    Cycle.

    Raises
    ------
    Failed : there is none.
    """
    u = settled(Scipy(known, max(rtol, ROUGH), method)) if guess is None else guess
    return shoot(Scipy(known, rtol, method), u, 10 * rtol)
