"""Hybrid motions by Taylor series in extended precision (heyoka, extra `bench`): no collocation, no CasADi.

A mode is a system of heyoka's equations with ways out; the motion is followed from one event to the next in numpy's
longdouble.  A cycle is a fixed point of the return map y -> P(y), which Newton's method finds; its multipliers are the
eigenvalues of P's Jacobian, by central differences: 19 digits leave 12 of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import heyoka as hy
import numpy as np

Array = np.ndarray
L = np.longdouble
TOLERANCE = L(1e-18)
DIFFERENCE = 1e-6
"""Step of the central differences, relative to the sizes of the coordinates."""


class Way(NamedTuple):
    """A way out of a mode: name, heyoka's expression, +1 rising or -1 falling, next mode, (x, t) -> x behind it.

    The next mode may be a function (x, t), too.
    """

    name: str
    function: Any
    direction: int
    to: str | Callable[[Array, Any], str]
    reset: Callable[[Array, Any], Array] | None = None


class Piece(NamedTuple):
    """A mode: [(variable, derivative), ...], its ways out, and how long it looks away from its events at first."""

    equations: Sequence[tuple[Any, Any]]
    ways: Sequence[Way] = ()
    blind: float = 1e-6


@dataclass(frozen=True)
class Cycle:
    """A cycle as it came out.

    Attributes
    ----------
    y : fixed point of the return map.
    period : of the cycle.
    extrema : (n, 2) smallest and largest value of every state.
    multipliers : the nontrivial ones, the largest first.
    """

    y: Array
    period: Any
    extrema: Array
    multipliers: Array


TURNS: list[Array] = []
"""States at which a state may be extreme.  It stands here because heyoka copies what a callback is bound to."""


def _turn(integrator: Any, time: Any, sign: int) -> None:
    integrator.update_d_output(time)
    TURNS.append(integrator.d_output.copy())


class Machine:
    """A hybrid system, ready to run."""

    def __init__(self, pieces: Mapping[str, Piece]) -> None:
        self.pieces = pieces
        n = len(next(iter(pieces.values())).equations)
        self._blind, self._seeing, self._watching = {}, {}, {}
        for name, piece in pieces.items():
            way = {1: hy.event_direction.positive, -1: hy.event_direction.negative}
            ends = [hy.t_event(e.function, direction=way[e.direction], fp_type=L) for e in piece.ways]
            rates = [rate for _, rate in piece.equations if hy.get_variables(rate)]
            watch = [hy.nt_event(rate, callback=_turn, fp_type=L) for rate in rates]

            def built(piece: Piece = piece, **events: Any) -> Any:
                return hy.taylor_adaptive(
                    list(piece.equations), state=np.zeros(n, L), fp_type=L, tol=TOLERANCE, **events
                )

            self._blind[name] = built()
            self._seeing[name] = built(t_events=ends)
            self._watching[name] = built(nt_events=watch)

    def set_parameter(self, value: Any) -> None:
        """The value of heyoka's par[0] in all modes."""
        for integrators in (self._blind, self._seeing, self._watching):
            for integrator in integrators.values():
                integrator.pars[0] = value

    def run(
        self, mode: str, x: Any, t: Any = 0, *, until: str = "", times: int = 1, end: Any = np.inf, watch: bool = False
    ) -> tuple[str, Array, Any]:
        """From x at t to the event `until`, so many times, or to the time `end`: mode, x behind the event, t."""
        x, t, left = np.array(x, L), L(t), times
        for _ in range(100_000):
            piece = self.pieces[mode]
            TURNS.append(x.copy())
            first = self._blind[mode]
            first.state[:], first.time = x, t
            first.propagate_until(min(t + L(piece.blind), L(end)))
            if first.time >= end:
                return mode, first.state.copy(), first.time
            seeing = self._seeing[mode]
            seeing.reset_cooldowns()
            seeing.state[:], seeing.time = first.state, first.time
            outcome = seeing.propagate_until(min(L(end), first.time + L(1e6)))[0]
            if watch:  # the same once more: events that do not end anything make heyoka overlook some that do
                watching = self._watching[mode]
                watching.state[:], watching.time = first.state, first.time
                watching.propagate_until(seeing.time)
            x, t = seeing.state.copy(), seeing.time
            TURNS.append(x.copy())
            index = -int(outcome) - 1
            if not 0 <= index < len(piece.ways):
                return mode, x, t
            way = piece.ways[index]
            x = x if way.reset is None else way.reset(x, t)
            mode = way.to if isinstance(way.to, str) else way.to(x, t)
            left -= way.name == until
            if until and left == 0:
                return mode, x, t
        raise RuntimeError("too many events")


def cycle(
    back: Callable[[Array, bool], tuple[Array, Any]], y: Sequence[float], *, settle: int = 0, mirror: bool = False
) -> Cycle:
    """A fixed point of y -> P(y), where back(y, watch) returns P(y) and the time that it takes.

    With `mirror` it is y -> -P(y) that has it, half a cycle that is the same under x -> -x.
    """
    sign = -1 if mirror else 1
    y = np.array(y, L)
    for _ in range(settle):
        y = sign * back(y, False)[0]
    for _ in itertools.repeat(None, 12):
        J = sign * jacobian(lambda z: back(z, False)[0], y)
        step = np.linalg.solve(np.eye(len(y)) - J, np.array(sign * back(y, False)[0] - y, float))
        y = y + step
        if np.max(np.abs(step)) < 1e-17 * max(1.0, float(np.max(np.abs(y)))):
            break
    TURNS.clear()
    _, time = back(y, True)
    points = np.array(TURNS)
    points = np.vstack([points, -points]) if mirror else points
    extrema = np.array([points.min(axis=0), points.max(axis=0)]).T
    multipliers = np.linalg.eigvals(jacobian(lambda z: back(z, False)[0], y)) ** (2 if mirror else 1)
    return Cycle(y, (2 if mirror else 1) * time, extrema, multipliers[np.argsort(-np.abs(multipliers))])


def jacobian(function: Callable[[Array], Array], y: Array, step: float = DIFFERENCE) -> Array:
    """(k, k) by central differences."""
    size = step * np.maximum(np.abs(np.array(y, float)), 1e-3)
    columns = []
    for i, h in enumerate(size):
        e = np.zeros(len(y), L)
        e[i] = h
        columns.append((function(y + e) - function(y - e)) / (2 * L(h)))
    return np.array(np.array(columns).T, float)
