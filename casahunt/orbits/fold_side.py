"""On which side of a fold a cycle lies.

At a fixed parameter the Jacobian J of the node system is singular at a fold, and its determinant has another sign on
either side.  With the singular vectors of the known cycle's J_0 that belong to its smallest singular value s,

    J_0 v = s b:        h = v . J^-1 b = - det [J b; v 0] / det J,    1/s at the known cycle,

and the bordered matrix is regular where J_0 has nearly become singular: h > 0 on the side of the known cycle, h < 0
behind the fold, with infinity between.  Where phases or mesh differ, the determinant goes with

    sign det (1 - M) = (-1)^(number of real multipliers beyond +1),    M the map across the flow.

Symbols: y unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..collocation.linearisation import Linearisation
from ..collocation.transcription import Setting, Transcription
from . import floquet
from .map_chain import collocation_chain

Array = np.ndarray

SINGULAR_ROUNDS = 4
"""Of the iteration for singular vectors: next to a fold one would do, far from it none is needed that is exact."""


@dataclass(frozen=True, eq=False)
class Side:
    """The side of a fold on which a known cycle lies.

    Attributes
    ----------
    right, left : (y,) b, and v with the weights of a relative measure of durations.
    odd : whether an odd number of its real multipliers is beyond +1.
    """

    right: Array
    left: Array
    odd: bool

    def holds(self, answers: Array) -> Array:
        """(B,) whether members lie on it, from J^-1 b (B, y) of each."""
        return np.asarray(np.matmul(answers[:, None], self.left[:, None])[:, 0, 0] > 0)


def side_of(t: Transcription, u: Array, setting: Setting) -> Side:
    """The side on which a cycle lies."""
    lin = t.linearise(u, setting)
    nonzeros = lin.matrix(t.system.border(parameter=1.0))
    size = t.system.size
    units = np.ones(size)
    units[-1 - t.phases : -1] = t.durations_of(u)
    right = np.append(np.ones(size - 1), 0.0)
    for _ in range(SINGULAR_ROUNDS):
        right /= np.linalg.norm(right)
        answer = t.system.solve(nonzeros, right)
        left = answer / units**2 / np.linalg.norm(answer / units)
        following = t.system.solve_transposed(nonzeros, left)
        following[-1] = 0.0
        last, right = right, following
    return Side(last, left, odd_beyond_one(t, u, setting, lin))


def odd_beyond_one(t: Transcription, u: Array, setting: Setting, lin: Linearisation | None = None) -> bool:
    """Whether an odd number of the real multipliers of a cycle is beyond +1.

    lin: the equations linearised there, where that is known.
    """
    others = floquet.chain_multipliers(collocation_chain(t, u, setting, lin), t.cycle.repeats).half[1:]
    return int(((others.imag == 0) & (others.real > 1)).sum()) % 2 == 1
