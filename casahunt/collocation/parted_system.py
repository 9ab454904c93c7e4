"""The node system of a mesh whose intervals are parts of those of another one, solved as the system of that one.

Between the nodes of the coarse mesh the unknowns are eliminated along the parts j = 1, 2, ... of an interval,

    dx_j = A_j dx_(j-1) + B_j dT + C_j dlambda + r_j    =    A^j dx_0 + B^j dT + C^j dlambda + r^j,

products of as few maps as there are parts.  What is left is a system that was factorised symbolically when the coarse
mesh was solved: a new mesh costs as much as a linearisation or two before anything is solved on it.

Symbols: n states; E elements of the fine mesh, y unknowns of its node system; P phases.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .node_system import NodeSystem
from .transcription import Transcription

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class _Matrix:
    """Nonzeros of the coarse system; of the parts, A (E, n, n), and the products [A^j | B^j | C^j] (E, n, n + 2)."""

    coarse: Array
    through: Array
    carried: Array


class PartedSystem(NodeSystem):
    """See the module docstring; for steps and tangents, which are all that Newton's method asks for.

    Parameters
    ----------
    t
        transcription on the coarse mesh.
    fine
        on the mesh of the parts.
    parts
        (N,) how many there are of each interval.
    """

    def __init__(self, t: Transcription, fine: Transcription, parts: Array) -> None:
        self._t, self._fine = t, fine
        self.size = (fine.elements + 1) * t.n + t.phases + 1
        counts = np.ones(t.elements, dtype=int)
        counts[t.interval_elements] = parts
        self._last = np.cumsum(counts) - 1  # the last part of every coarse element
        first = self._last - counts + 1
        self._later = [first[counts > j] + j for j in range(1, int(counts.max(initial=1)))]
        self._whole = np.repeat(np.arange(t.elements), counts)  # the coarse element of every part

    def border(self, *, nodes: Array | None = None, durations: Array | None = None, parameter: float = 0.0) -> Array:
        """A border row: that of the coarse system, whose phases end at the same nodes.

        nodes, durations, parameter: as in `NodeSystem.border`. Returns ((P + 1) n + P + 1,).
        """
        return self._t.system.border(nodes=nodes, durations=durations, parameter=parameter)

    def _products(self, maps: Array, of: Array) -> Array:
        """(E, n, k) products along the parts, `maps` the A (E, n, n), `of` what they act on and what each part adds."""
        out = of.copy()
        for e in self._later:
            out[e] += maps[e] @ out[e - 1]
        return out

    def nonzeros(self, maps: Array, closure: Array, events: Array, border: Array) -> Any:
        """The matrix from the blocks of a Linearisation and a border row.

        maps, closure, events, border: as in `NodeSystem.nonzeros`, of the fine mesh. Returns what `solve` takes.
        """
        n, through = self._t.n, maps[:, :, 1 : self._t.n + 1]
        added = maps.copy()
        for e in self._later:
            added[e, :, 1 : n + 1] = 0.0
        carried = self._products(through, added)
        coarse = self._t.system.nonzeros(carried[self._last], closure, events, border)
        return _Matrix(coarse, through, carried[:, :, 1:])

    def solve(self, nonzeros: Any, rhs: Array) -> Array:
        """Solve the node system.

        nonzeros: of `nonzeros`; rhs: (y,) right-hand side. Returns (y,).
        """
        t, E, n = self._t, self._fine.elements, self._t.n
        added = self._products(nonzeros.through, rhs[: E * n].reshape(E, n, 1))[:, :, 0]
        y = t.system.solve(nonzeros.coarse, np.concatenate([added[self._last].ravel(), rhs[E * n :]]))
        nodes, durations = y[: (t.elements + 1) * n].reshape(-1, n), y[(t.elements + 1) * n : -1]
        known = np.empty((E, n + 2, 1))
        known[:, :n, 0] = nodes[self._whole]
        known[:, n, 0] = durations[self._fine.phase_of]
        known[:, n + 1] = y[-1]
        behind = (nonzeros.carried @ known)[:, :, 0] + added
        return np.concatenate([nodes[0], behind.ravel(), durations, y[-1:]])


class PartedTranscription(Transcription):
    """The transcription of a cycle on a mesh of parts, with such a system.

    Parameters
    ----------
    t, parts
        as in `PartedSystem`.
    """

    def __init__(self, t: Transcription, parts: Array) -> None:
        counts = tuple(int(parts[t.phase_intervals(k)].sum()) for k in range(t.phases))
        super().__init__(t.cycle, counts, t.degree, t.kind)
        self._system = PartedSystem(t, self, parts)
