"""Unknowns made from functions of time that are known: what the tests put on a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from casahunt.collocation.transcription import Transcription, transcribe
from casahunt.hybrid.system import Cycle, Phase, VectorEvent, VectorMode

Array = np.ndarray
Motion = Callable[[Array], Array]
"""Times as fractions of a phase (m,) -> states (m, n)."""

END = VectorEvent("end", lambda x, T, p: T - 1)


def still(x: object, p: object, sign: object) -> ca.SX:
    """x' = 0, of two states."""
    return ca.SX.zeros(2)


def cycle_of(*modes: VectorMode) -> Cycle:
    """Two states, one phase for every mode, closed by the identity."""
    return Cycle("known", ("a", "b"), ("c",), tuple(Phase(mode, END) for mode in modes), np.eye(2), 1)


def laid_out(
    cycle: Cycle,
    breaks: Sequence[Array],
    motions: Sequence[Motion],
    durations: Sequence[float],
    *,
    degree: int,
    kind: str = "gauss",
) -> tuple[Transcription, Array, Array]:
    """(transcription, u, fractions) with the states of phase k given by motions[k]; scale 1.

    A closed-form phase has breaks (0, 1) and its start alone among the unknowns.
    """  # fmt: skip
    counts = tuple(0 if phase.mode.flow else len(b) - 1 for phase, b in zip(cycle.phases, breaks, strict=True))
    t = transcribe(cycle, counts, degree, kind)
    w, nodes, fractions = [], [], []
    for count, b, motion in zip(counts, breaks, motions, strict=True):
        nodes.append(motion(b[:-1]))
        if count:
            times = b[:-1, None] + np.diff(b)[:, None] * t.scheme.points
            w.append(motion(times.ravel()).reshape(count, -1))
            fractions.append(np.diff(b))
    nodes.append(motions[-1](np.array([1.0])))
    return t, t.pack(np.vstack(w), np.vstack(nodes), np.array(durations, float)), np.concatenate(fractions)
