"""How an expression g(x; p) passes along a cycle: where it turns, and where it goes through zero.

    g turns where g_x . f = 0:  bracketed between points of an interval, polished by the equations (extrema.py)
    g = 0:                      likewise

An event is grazed where its scalar turns at zero inside a phase; it is passed where that goes through.

Symbols: n states, m points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..collocation.transcription import Setting, Transcription
from ..results import Result
from .extrema import SampledPiece
from .observables import Expression, Later, Values, kept_values

Array = np.ndarray

WORTH_POLISHING = 0.05
"""Turns where g is this part of its range short of the best are polished too."""


@dataclass(frozen=True, eq=False, repr=False)
class Crossings(Result):
    """Where an expression is zero over a cycle, m times.

    Attributes
    ----------
    times : (m,) from the start of the first phase, increasing.
    states : (n, m) there, as accurate as the ends of the intervals.
    rates : (m,) of the expression by the time: whether it rises or falls.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> found = find_cycle(belt, "slip", x=0.0, v=0.0).crossings("x")
    >>> found.times.size, int((found.rates > 0).sum())
    (2, 1)
    """

    _quantities = ("times", "rates")
    _details = ("states",)

    times: Array
    states: Array
    rates: Array


def crossings(t: Transcription, u: Array, setting: Setting, g: Expression) -> Crossings:
    """Where g goes through zero over a cycle, not by a jump.  Raises InputError: g is no scalar."""
    found = []
    for piece in range(t.cycle.repeats):
        look = SampledPiece(t, u, setting, Later(g, t.cycle, piece) if piece else g, piece, Values)
        begins = piece * float(np.sum(t.durations_of(u)))
        for seen in look.seen:
            a, b = seen.g[:, :-1], seen.g[:, 1:]
            for i, j in np.argwhere((a < 0) & (b >= 0) | (a > 0) & (b <= 0)):
                time, x, rate = look.crossed(seen, int(i), int(j))
                for _ in range(piece):
                    x = t.cycle.opened(x)
                found.append((begins + time, x, rate))
    found.sort(key=lambda each: each[0])
    times, states, rates = (np.array([each[k] for each in found]) for k in range(3))
    return Crossings(times, states.reshape(-1, t.n).T, rates)


def turning_values(
    t: Transcription, u: Array, setting: Setting, g: Expression, phase: int, sense: int, *, piece: int = 0
) -> list[float]:
    """The values of g where it turns inside a phase.

    g, phase: (x, p) -> scalar, of CasADi symbols, that can be hashed; number of the phase; sense, piece: +1 for its
    largest values, -1 for its smallest ones; number of the computed piece in the period. Returns those within
    `WORTH_POLISHING` of the range of g from the best, in the order of time; none where it does not turn.
    """
    passage = _Passage(t, u, setting, g, phase, sense, piece)
    if not passage.turns.any():
        return []
    best = float(passage.tops[passage.turns].max()) - passage.margin
    return [passage.turning(int(k), int(j)) for k, j in np.argwhere(passage.turns & (passage.tops >= best))]


def passed(
    t: Transcription, u: Array, setting: Setting, g: Expression, phase: int, sense: int, *, slack: float, piece: int = 0
) -> bool:
    """Whether g goes through zero inside a phase.

    t, u, setting, g, phase: as in `turning_values`; sense: +1 for rising, -1 for falling; slack, piece: |g| that counts
    as zero; number of the computed piece in the period.
    Returns True where it has been beyond zero by more than the slack on both sides, in that order.
    """
    passage, below = _Passage(t, u, setting, g, phase, sense, piece), False
    for k, values in enumerate(passage.values):
        for j, value in enumerate(values[:-1]):
            below = below or value < -slack
            highest = values[j + 1]
            if passage.turns[k, j] and passage.tops[k, j] > -passage.margin:
                highest = max(highest, sense * passage.turning(k, j))
            if below and highest > slack:
                return True
    return False


class _Passage:
    """g along one phase, counted along `sense`: values and rates at the points (N, m) of its elements."""

    def __init__(
        self, t: Transcription, u: Array, setting: Setting, g: Expression, phase: int, sense: int, piece: int
    ) -> None:
        g = Later(g, t.cycle, piece) if piece else g
        self.look = SampledPiece(t, u, setting, g, piece, kept_values)
        self.seen = self.look.of_phase(phase)
        self.values, rate = sense * self.seen.g, sense * self.seen.rate
        self.turns = (rate[:, :-1] > 0) & (rate[:, 1:] <= 0)
        """(N, m - 1) the gaps in which g turns."""
        self.tops = np.maximum(self.values[:, :-1], self.values[:, 1:])
        self.margin = WORTH_POLISHING * float(np.ptp(self.values))

    def turning(self, k: int, j: int) -> float:
        """g where it turns in gap j of element k."""
        return self.look.polished(self.seen, k, j).value
