"""How an expression g(x; p) passes along one phase of a cycle: where it turns, and whether it goes through zero.

    g turns where g_x . f = 0:  bracketed between points of an interval, polished by the equations (extrema.py)

An event is grazed where its scalar turns at zero inside a phase; it is passed where that goes through.

Symbols: n states, m points.
"""

from __future__ import annotations

import numpy as np

from ..collocation.transcription import Setting, Transcription
from .extrema import SampledPiece
from .observables import Expression, Later, kept_values

Array = np.ndarray

WORTH_POLISHING = 0.05
"""Turns where g is this part of its range short of the best are polished too."""


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
