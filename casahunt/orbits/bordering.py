"""The row under which the parameter is free: the correction of a point of a branch is orthogonal to a direction y'.

y' . (x_0, ln T_1, lambda)  as it was,      T_1 the duration of the first phase (continuation/curve.py)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from ..checks import choice_of, of_kind, require, shown, whole_number
from ..collocation.node_system import Linearisation
from ..collocation.scheme import Kind
from ..collocation.transcription import Setting, Transcription
from ..errors import InputError
from ..hybrid.problem import Problem

Array = np.ndarray

THE_SAME = 0.1
"""A first phase is that of another phase sequence too where its duration differs by no more than this part; and without
it more than this part of a direction must be left, that is to say where a point is."""


def curve_border(t: Transcription, u: Array, weights: Array) -> Array:
    """The border row of the node system with weights on the first node, on ln T_1 and on lambda.

    weights: (n + 2,), see continuation/curve.py. Returns border row (NodeSystem.border).
    """
    nodes, durations = np.zeros((t.phases + 1, t.n)), np.zeros(t.phases)
    nodes[0] = weights[: t.n]
    durations[0] = weights[t.n] / t.durations_of(u)[0]
    return t.system.border(nodes=nodes, durations=durations, parameter=float(weights[-1]))


def row_along(t: Transcription, u: Array, setting: Setting, lin: Linearisation | None = None) -> Array:
    """The weights that measure the way along the curve at a point of it, without lambda, as at a fold (newton.py).

    lin: the equations linearised there, where that is known.
    Returns (n + 2,) of length one, its last entry zero: the tangent itself.
    """
    lin = lin or t.linearise(u, setting)
    # Next to the sharpest folds the first node moves no more than lambda does: the first duration tells.
    for trial in (np.append(np.ones(t.n), [0.0, 0.0]), np.append(np.zeros(t.n), [1.0, 0.0])):
        du, y = lin.tangent(curve_border(t, u, trial))
        if np.isfinite(y).all():
            break
    row = np.concatenate([y[: t.n], [t.durations_of(du)[0] / t.durations_of(u)[0], 0.0]])
    return row / np.linalg.norm(row)


def with_other_phases(weights: Array, before: float, after: float) -> Array:
    """The weights where a point of a branch is sought with other phases than it was predicted with.

    A first phase that is cut ends elsewhere: its duration is another thing, and would drag the parameter along.

    weights: (n + 2,) as of `curve_border`; before, after: duration of the first phase among the phases of the
    prediction, and among the others. Returns (n + 2,) weights, none of them on ln T_1 where that is another thing; as
    they are where it is nearly all there is.
    """
    if abs(after - before) <= THE_SAME * before:
        return weights
    others = weights.copy()
    others[-2] = 0.0
    return others if np.linalg.norm(others) > THE_SAME * np.linalg.norm(weights) else weights


# How orbits are computed: settings that hold no problem data

WALK_TOLERANCE = 1e-5
"""The way to a fold and round it needs no more accuracy than this; its end is computed to the tolerance."""


@dataclass(frozen=True)
class Options:
    """How orbits are computed; holds no problem data.

    Attributes
    ----------
    tol : relative tolerance of period and amplitude.
    solver : "ipopt" or "newton" makes every solve, alone: of a first cycle, along a branch, after a change of mesh,
        for multipliers.  "auto": Newton where the start is close, IPOPT where it is not or Newton fails, and after a
        change of mesh Newton corrects.
    degree, kind : collocation scheme; None for the default of the problem.
    half : exploit the symmetry x(t + T/2) = -x(t), where a cycle is made from nothing.
    provisional : orbits on a way whose end is computed anew: their errors, which are not estimated, stand as infinite.
    TOLERANCES : the smallest and the largest tolerance: rounding below, meaningless meshes above.
    SOLVERS : what `solver` may be.

    Examples
    --------
    >>> from casahunt.orbits import Options
    >>> Options(tol=1e-9, solver="newton").tol
    1e-09
    """

    TOLERANCES: ClassVar[tuple[float, float]] = (1e-12, 1e-2)
    SOLVERS: ClassVar[tuple[str, ...]] = ("auto", "ipopt", "newton")

    tol: float = 1e-6
    solver: Literal["auto", "ipopt", "newton"] = "auto"
    degree: int | None = None
    kind: Kind | None = None
    half: bool = True
    provisional: bool = False

    def __post_init__(self) -> None:
        low, high = self.TOLERANCES
        if not low <= require("tol", self.tol) <= high:
            raise InputError(f"tol = {shown(self.tol)}: must lie between {low:g} and {high:g}")
        choice_of("solver", self.solver, self.SOLVERS)
        whole_number("degree", self.degree or 1, at_least=1)
        of_kind("half", self.half, bool)

    def rough(self) -> Options:
        """The same for a way whose end is computed to the tolerance: no more accuracy than that needs."""
        return replace(self, tol=max(self.tol, WALK_TOLERANCE))

    def finer(self, part: float) -> Options:
        """The same to a part of the tolerance, as far as rounding allows."""
        return replace(self, tol=max(part * self.tol, self.TOLERANCES[0]))

    def scheme_of(self, problem: Problem) -> tuple[int, Kind]:
        """(degree, kind) for a problem."""
        degree, kind = problem.scheme
        return self.degree or degree, self.kind or kind
