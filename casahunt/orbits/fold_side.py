"""On which side of a fold a cycle lies.

At a fixed parameter the Jacobian J of the node system is singular at a fold, and its determinant has another sign on
either side.  With the singular vectors of the known cycle's J_0 that belong to its smallest singular value s,

    J_0 v = s b:        h = v . J^-1 b = - det [J b; v 0] / det J,    1/s at the known cycle,

and the bordered matrix is regular where J_0 has nearly become singular: h > 0 on the side of the known cycle, h < 0
behind the fold, with infinity between.  Where phases or mesh differ, the determinant goes with

    sign det (1 - M) = (-1)^(number of real multipliers beyond +1),    M the map across the flow.

Symbols: y unknowns of the node system.

Whether a cycle is one of many at the same parameters, and in what they differ.

    J dy = 0 at a solution of the equations G(u) = 0 (collocation/node_system.py) at fixed parameters

At a fold there is no solution beside it: along the null vector G grows with the square of the way.  Of a family each
point of a way along it becomes one by Newton steps of least length, J^+ G.  What is kept there (a total, an energy) or
pulled back by nothing (a clock of its own, an idle state) has the null vector from the left, in the rows of the
closure, as its gradient.

Symbols: n states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..collocation.admissibility import stands_still
from ..collocation.newton import RESIDUAL_LIMIT, STEP_TOLERANCE, size_of_step
from ..collocation.node_system import Linearisation
from ..collocation.transcription import Setting, Transcription
from . import floquet
from .map_chain import collocation_chain
from .restart import Start

NO_SINGULAR_VALUE = 1e-7
"""A singular value that is smaller, as a part of the largest, is zero at a solution known to rounding."""
A_WAY_ALONG, STAYS_THERE = 1e-3, 0.5
"""How far a family is gone along, in units of the states, and the part of that which steps to it must leave."""
LEAST_STEPS_TO_IT = 8
MOST_NODE_UNKNOWNS = 1500
"""Of a cycle with more, hundreds of phases, the singular values would take longer than the search: it is not asked."""
TAKES_PART = 0.02
"""A state that moves by less than this part of the one that moves most does not."""


def one_of_many(start: Start) -> str:
    """What a cycle next to a starting point has beside it, as a sentence.

    "" where it stands alone, or is at a fold, or has so many unknowns that it is not asked.
    """
    here = _nearest(start) if start[0].system.size <= MOST_NODE_UNKNOWNS else None
    if here is None or stands_still(*here[:2]):
        return ""
    t, u, setting = here
    names = t.cycle.states
    lin = t.linearise(u, setting)
    left, sizes, right = np.linalg.svd(_dense(lin))
    free = np.flatnonzero(sizes <= NO_SINGULAR_VALUE * sizes[0])
    moves, keeps = np.zeros(t.n), np.zeros(t.n)
    nodes = t.elements * t.n
    for k in free:
        way = lin.expand(right[k], 0.0)
        way *= A_WAY_ALONG / size_of_step(t, u, way)
        beside = _nearest((t, u + way, setting))
        if beside is None or size_of_step(t, u, beside[1] - u) < STAYS_THERE * A_WAY_ALONG:
            return ""
        moves = np.maximum(moves, np.abs(right[k, : nodes + t.n].reshape(-1, t.n)).max(axis=0))
        keeps = left[nodes : nodes + t.n, k] / setting.scale
    if not free.size:
        return ""
    which = [name for name, way in zip(names, moves, strict=True) if way > TAKES_PART * moves.max()]
    return _sentence(which, names, keeps if free.size == 1 else np.zeros(t.n), free.size)


def _sentence(which: list[str], names: tuple[str, ...], keeps: Array, many: int) -> str:
    """What is said of states that are free, and of what a motion keeps, by its derivatives."""
    kept = f" in {many} ways"
    if np.any(keeps):
        parts = zip(names, keeps / keeps[np.argmax(np.abs(keeps))], strict=True)
        terms = [f"{part:.2g} {name}".removeprefix("1 ") for name, part in parts if abs(part) > TAKES_PART]
        kept = f" (near its start it keeps {' + '.join(terms).replace('+ -', '- ')})"
    differ = f"beside it are other cycles at the same parameters, which differ in {' and '.join(which)}{kept}"
    return (
        f"it is one of many: {differ}; fix what is free there: take what the motion keeps, or the state that nothing "
        f"pulls back, as a parameter, so that {which[-1]} is a state no more, or let something act on it"
    )


def _dense(lin: Linearisation) -> Array:
    """The matrix of the node system, the parameter held."""
    system = lin.transcription.system
    return system.dense(lin.matrix(system.border(parameter=1.0)))


def _nearest(start: Start) -> Start | None:
    """The solution next to a starting point, by steps of least length; None where they do not lead to one."""
    t, u, setting = start
    for _ in range(LEAST_STEPS_TO_IT):
        lin = t.linearise(u, setting)
        if not lin.finite():
            return None
        du = lin.expand(np.linalg.lstsq(_dense(lin), lin.rhs(), rcond=NO_SINGULAR_VALUE)[0], 1.0)
        size = size_of_step(t, u, du)
        if not size < 1:
            return None
        u = u + du
        if size <= STEP_TOLERANCE:
            return (t, u, setting) if t.residual_norm(u, setting) <= RESIDUAL_LIMIT else None
    return None


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
