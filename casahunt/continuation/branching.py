"""From a flip to the cycle of twice the period that branches off there.

At a flip the equations with an antiperiodic closure are singular,

    J_k du = 0 in every phase,    x_0 = -S x_E:    the direction in which the map of the period turns over.

Two turns of the cycle, moved by +eps du on the first and by -eps du on the second, are next to the new one; it is
solved with its distance held and the parameter free, and can be followed from there.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from ..collocation.mesh import phase_breaks
from ..collocation.transcription import Setting, Transcription, transcribe
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options, solve_adaptively
from ..orbits.family import Closure, Family
from ..orbits.orbit import Orbit, orbit_of, unknowns_of
from ..orbits.restart import Start
from .curve import along
from .special_points import SpecialPoint

Array = np.ndarray

OFF = 0.02
"""Distance of the new cycle from the old one, in units of the state scale."""
SINGULAR = 1e-4
"""Smallest over largest singular value, relative, below which there is a direction that turns over."""


def doubled(special: SpecialPoint[Orbit], vary: str, *, off: float = OFF, options: Options | None = None) -> Orbit:
    """The cycle of twice the period next to a flip.

    Parameters
    ----------
    special
        a located flip of a full cycle.
    vary
        name of the parameter.
    off
        how far from the old cycle, in units of the state scale.
    options
        tolerance and method; default those of the orbit at the flip.

    Returns
    -------
    Orbit, next to the flip; the parameter is what it turns out to be.

    Raises
    ------
    InputError : it is no flip of a cycle of a user's system.
    NoOrbit : the new cycle was not computed, or is the old one.
    """
    began = time.perf_counter()
    orbit, family = special.orbit, special.orbit.problem
    if special.kind != "flip" or not isinstance(family, Family) or orbit.repeats != 1:
        raise InputError(f"special point {special.kind!r}: must be a flip of a cycle of a system")
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    t, u, setting = unknowns_of(orbit)
    turned = _turned_over(t, u, setting)
    shift = np.array(family.closure.shift)
    closure = Closure.of(np.array(family.closure.matrix), 2 * shift, 1)
    start, row = _two_turns(replace(family, closure=closure), t, u, setting, off * turned, shift, along(family, vary))
    solved = solve_adaptively(replace(family, closure=closure), start, options, solver="newton", border=row)
    if not solved.status.ok:
        raise NoOrbit(f"the cycle of twice the period next to {special.meaning} was not computed: {solved.complaint()}",
                      solved.status)  # fmt: skip
    problem = replace(family, closure=closure)
    problem = problem.with_value(vary, problem.moved(vary, solved.solution.parameter))
    found: Orbit = orbit_of(solved, problem, wall_s=time.perf_counter() - began)
    first, second = found.arcs[0].states[0, 0], found.arcs[len(orbit.arcs)].states[0, 0] - shift
    if np.max(np.abs(first - second) / found.scale) < off * 1e-2:
        sentence = f"next to {special.meaning}: only the old cycle, run through twice, was found"
        raise NoOrbit(sentence, Status.NOT_CONVERGED)
    return found


def _turned_over(t: Transcription, u: Array, setting: Setting) -> Array:
    """(size,) du with x_0 = -S x_E, its first node of length one in scaled states."""
    lin = t.linearise(u, setting)
    antiperiodic = replace(lin, closure=-lin.closure)
    matrix = t.system.dense(antiperiodic.matrix(t.system.border(parameter=1.0)))
    _, values, rows = np.linalg.svd(matrix)
    y = rows[-1]
    if not values[-1] < SINGULAR * values[0]:
        raise NoOrbit("no direction is turned over by the map of the period here: it is no flip", Status.NOT_CONVERGED)
    return lin.expand(y, 0.0) / float(np.linalg.norm(y[: t.n]))


def _two_turns(
    family: Family, t: Transcription, u: Array, setting: Setting, du: Array, shift: Array, dp: Array
) -> tuple[Start, Array]:
    """(starting point, border row) of two turns of a cycle, moved by +du and by -du."""
    signature = t.cycle.signature
    cycle = family.cycle((*signature, *signature), 1)
    new = transcribe(cycle, (*t.counts, *t.counts), t.degree, t.kind)
    turns = [u + du, u - du]
    w = np.concatenate([t.intervals_of(v) for v in turns])
    nodes = np.concatenate([t.nodes_of(turns[0])[:-1], t.nodes_of(turns[1])])
    # What angles and the time have made in the first turn, they have made at the start of the second.
    ahead = shift / setting.scale
    w[t.intervals :] += np.tile(ahead, t.degree + 1)
    nodes[t.elements :] += ahead
    durations = np.concatenate([t.durations_of(v) for v in turns])
    fractions = np.concatenate([np.zeros(0), *(np.diff(b) for b in 2 * phase_breaks(t, setting.fractions))])
    row = np.concatenate([du[t.node_index[0]], [0.0, 0.0]])
    start = new, new.pack(w, nodes, durations), replace(setting, fractions=fractions, dp=dp)
    return start, row / np.linalg.norm(row)
