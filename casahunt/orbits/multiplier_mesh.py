"""Multipliers on meshes made for them, finer than the orbit's, until they are known.

    every interval in parts, solved anew:    |trivial - 1| small,  and the same leading multiplier as on the mesh before

Every interval is cut in two at least.  Of all directions the flow is the one whose image under the map A of an interval
is known: where A misses it, |A f - f+| > 0 (map_chain.py), the mesh is too coarse for the linearised flow, by orders of
magnitude more than it is on the average, and that interval is cut in as many parts as bring this down to `DEFECT`.

The first mesh is compared with the orbit's own; where that is too coarse to vouch for the leading one, with the mesh of
intervals twice as long, half as many parts.

Symbols: n states, N intervals.
"""

from __future__ import annotations

from collections.abc import Generator, Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..collocation.batched_newton import Corrected, Member, solve_batch
from ..collocation.ipopt import solve
from ..collocation.mesh import divided
from ..collocation.newton import Solver
from ..collocation.node_system import Linearisation
from ..collocation.transcription import Setting, Transcription
from . import floquet
from .map_chain import MapChain, collocation_chain, refined_chain

Array = np.ndarray
Place = tuple[Transcription, Array, Setting]

HEALTHY = 4e-9
"""Trivial multipliers nearer to 1 than this need no finer mesh: that of the full period, its square, is within 1e-8."""
MORE_MESHES = 3
LARGE_MULTIPLIER = 10.0
"""Larger half multipliers are computed on two meshes at least, until they agree to `floquet.TRUSTED`."""
AS_TRUSTED = floquet.TRUSTED / floquet.SHARE_LEFT
"""Smaller ones may differ by this: what is left of it on the finer mesh is to be trusted."""
NEXT_TO_FOLD = 0.02
"""Share of the parameter in the unit tangent below which a point counts as next to a fold."""
DEFECT = 1e-9
"""By how much the map of an interval may miss the flow behind it, relative."""
DEFECT_POWER, MOST_CUTS = 1 / 6, 8
"""An interval is cut in (defect / DEFECT)^DEFECT_POWER parts, no more than MOST_CUTS: orders are 11 and more, but for
kinks."""
JUMPS = 1e-3
"""A flow that the map of some interval misses by more, on any mesh, jumps there, and the multipliers are off."""
NO_STEP = 1e-11
"""A Newton step smaller than this is not taken: what it moves is below what is asked of multipliers."""


@dataclass(frozen=True, eq=False)
class _SolvedForMultipliers:
    """The orbit on a mesh, and the factors of its linearised map there."""

    at: Place | Corrected
    chain: MapChain

    @property
    def place(self) -> Place:
        """The orbit: transcription, unknowns, setting."""
        return self.at.place() if isinstance(self.at, Corrected) else self.at


@dataclass(frozen=True, eq=False)
class _Request:
    """The orbit is to be solved with every interval of a mesh in some parts; weights as of `_fold_border`."""

    place: Place
    parts: Array
    weights: Array | None


Found = tuple[floquet.Multipliers, _SolvedForMultipliers]


def refined_multipliers(
    t: Transcription, u: Array, setting: Setting, *, solver: Solver = "newton", lin: Linearisation | None = None
) -> tuple[floquet.Multipliers, Place]:
    """Multipliers on a mesh made for them: finer than the orbit's, until the trivial one is 1.

    They depend on the whole linearised flow, which converges later than period and amplitude.  Their error is that
    against a mesh of intervals twice as long, or against the orbit's own, whose intervals are as long or longer.

    lin: the equations linearised there, where that is known.
    Returns multipliers, and the orbit (transcription, unknowns, setting) on the mesh on which they came out best.
    """
    ((found, solved),) = _of_many([(t, u, setting, lin)], solver)
    return found, solved.place


def multipliers_of_many(
    orbits: Sequence[tuple[Transcription, Array, Setting, Linearisation | None]], solver: Solver = "newton"
) -> list[floquet.Multipliers]:
    """Those of many orbits, each on a mesh of its own, solved in batches.

    orbits, solver: transcription, unknowns, setting, linearisation of each, and the solver, as in
    `refined_multipliers`. Returns as many, the same but for rounding as one by one.
    """
    return [found for found, _ in _of_many(orbits, solver)]


def _of_many(
    orbits: Sequence[tuple[Transcription, Array, Setting, Linearisation | None]], solver: Solver
) -> list[Found]:
    """Every orbit asks for meshes until it is content; what they ask for in a round is solved in batches."""
    asking = {k: _refining(*orbit) for k, orbit in enumerate(orbits)}
    requests, found = {k: next(one) for k, one in asking.items()}, {}
    while requests:
        answers = _solved_in_batch(list(requests.values()), solver)
        for k, answer in zip(list(requests), answers, strict=True):
            try:
                requests[k] = asking[k].send(answer)
            except StopIteration as end:
                found[k] = end.value
                del requests[k]
    return [found[k] for k in range(len(orbits))]


def _refining(
    t: Transcription, u: Array, setting: Setting, lin: Linearisation | None
) -> Generator[_Request, _SolvedForMultipliers | None, Found]:
    """`refined_multipliers` of one orbit, to whom it is told what its meshes show."""
    start: Place = (t, u, setting)
    if lin is None:
        lin = t.linearise(u, replace(setting, dp=setting.dp * (setting.dp @ setting.p or 1.0)))
    # Weights of the phase-end nodes along which to hold u where the parameter cannot be held: next to a fold. There
    # the equations at a fixed parameter are singular; on a finer mesh it must be free to move by the error of the
    # coarser one
    rhs = np.zeros(t.system.size)
    rhs[-1] = 1.0
    y = t.system.solve(lin.matrix(t.system.border(parameter=1.0)), rhs)  # as `lin.tangent`
    length = float(np.linalg.norm(np.append(y[: t.n], y[-1])))
    if np.isfinite(length) and abs(y[-1]) > NEXT_TO_FOLD * length:
        weights = None
    else:
        first = y[: t.n] / length if np.isfinite(length) else np.ones(t.n)
        weights = np.zeros((t.phases + 1, t.n))
        weights[0] = first
    own = _SolvedForMultipliers(start, collocation_chain(t, u, setting, lin))
    coarse, frame = floquet.rough_multipliers(own.chain)
    parts = np.maximum(_parts(own), 2)
    halves = (parts + 1) // 2
    best: floquet.Multipliers | None = None
    last = place = own
    for k in range(1 + MORE_MESHES):
        solved = yield _Request(last.place, parts, weights)
        if solved is None:
            break
        last = solved
        fresh = floquet.chain_multipliers(solved.chain, t.cycle.repeats, frame)
        frame = fresh.frame
        if k == 0 and not _settled(fresh, coarse) and halves.max(initial=1) > 1:
            between = yield _Request(start, halves, weights)
            coarse = coarse if between is None else floquet.rough_multipliers(between.chain, frame)[0]
        found, settled = floquet.compared(fresh, coarse), _settled(fresh, coarse)
        better = best is None or found.trivial_error < best.trivial_error or best.error >= floquet.TRUSTED
        if best is None or better or abs(found.leading) >= LARGE_MULTIPLIER:
            best, place = found, solved
        if best.trivial_error < HEALTHY and best.error < floquet.TRUSTED and settled:
            break
        if settled:
            parts = _parts(solved)
        if not settled or parts.max(initial=1) == 1:
            parts, coarse = np.full(solved.place[0].intervals, 2), found.half[1:]
    if best is None:  # nothing was solved: the orbit's own mesh, against its halves
        best = floquet.chain_multipliers(own.chain, t.cycle.repeats, frame)
        finer = collocation_chain(*_intervals_cut(start, np.full(t.intervals, 2)))
        best = floquet.compared(best, floquet.rough_multipliers(finer, best.frame)[0], share=1.0)
    jump = place.chain.jumps_by
    return (replace(best, error=max(best.error, jump)) if jump > JUMPS else best), place


def _solved_in_batch(requests: Sequence[_Request], solver: Solver) -> list[_SolvedForMultipliers | None]:
    """What is asked for; what Newton's method does not find in a batch, one by one."""
    answers: list[_SolvedForMultipliers | None] = [None] * len(requests)
    alike: dict[Hashable, list[int]] = {}
    for k, (t, _, _) in enumerate(request.place for request in requests if solver == "newton"):
        alike.setdefault((t.cycle, t.degree, t.kind), []).append(k)
    for members in alike.values():
        found = solve_batch([_member(requests[k]) for k in members], NO_STEP)
        for k, one in zip(members, found, strict=True):
            answers[k] = None if one is None else _SolvedForMultipliers(one, refined_chain(one))
    for k, request in enumerate(requests):
        answers[k] = answers[k] or _solved(request.place, request.parts, request.weights, solver)
    return answers


def _member(request: _Request) -> Member:
    """What is asked for, to be solved with others."""
    t, u, setting = request.place
    return Member(t, u, setting, request.parts, _border(t, request.weights))


def _border(t: Transcription, weights: Array | None) -> Array:
    """The border row of the node system: lambda fixed, or the weights of `_fold_border`."""
    return t.system.border(parameter=1.0) if weights is None else t.system.border(nodes=weights, parameter=0.0)


def _settled(found: floquet.Multipliers, coarse: Array) -> bool:
    """Whether the leading multiplier came out the same on the mesh of the half multipliers `coarse`.

    Where the flow expands a lot, the trivial multiplier says nothing about the leading one.
    """
    if not coarse.size:
        return True
    off, size = float(np.min(np.abs(found.leading - coarse))), abs(found.leading)
    return off < floquet.TRUSTED * size if size >= LARGE_MULTIPLIER else off < AS_TRUSTED


def _parts(solved: _SolvedForMultipliers) -> Array:
    """(N,) parts for every interval, by how much its map misses the flow."""
    t = solved.place[0]
    jumps = [end for phase, end in zip(t.cycle.phases, t.phase_end, strict=True) if phase.reset is not None]
    # A jump is an element of the node system, and none of the chain's: it stands in the saltation.
    own = t.interval_elements - np.searchsorted(np.array(jumps, dtype=int), t.interval_elements)
    defects = solved.chain.flow_defects()[own]
    return np.clip(np.ceil((defects / DEFECT) ** DEFECT_POWER), 1, MOST_CUTS).astype(int)


def _intervals_cut(place: Place, parts: Array) -> Place:
    """The same orbit with every interval cut in some parts, not solved again."""
    t, u, setting = place
    t, u, fractions = divided(t, u, setting.fractions, parts)
    return t, u, replace(setting, fractions=fractions)


def _solved(place: Place, parts: Array, weights: Array | None, solver: Solver) -> _SolvedForMultipliers | None:
    """The orbit with every interval cut in some parts, solved anew; None where the solver fails.

    By a node system of its own: where an interval expands much, products along its parts drown what is small.
    """
    t, u, setting = _intervals_cut(place, parts)
    row = None if weights is None else _border(t, weights)
    solution = solve(t, u, setting, solver=solver, border=row, accuracy=NO_STEP)
    if not solution.status.ok:
        return None
    u, setting = solution.u, setting.moved(solution.parameter)
    return _SolvedForMultipliers((t, u, setting), collocation_chain(t, u, setting, solution.linearisation))
