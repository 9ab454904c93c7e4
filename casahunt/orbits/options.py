"""How orbits are computed: settings that hold no problem data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..checks import known, of_kind, require, shown, whole
from ..collocation.scheme import Kind
from ..errors import InputError
from ..hybrid.problem import Problem

TOLERANCE_RANGE = (1e-12, 1e-2)
"""Reachable tolerances: rounding below, meaningless meshes above."""
SOLVERS = ("auto", "ipopt", "newton")


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
    sketched : orbits on a way whose end is computed anew: their errors, which are not estimated, stand as infinite.

    Examples
    --------
    >>> from casahunt.orbits import Options
    >>> Options(tol=1e-9, solver="newton").tol
    1e-09
    """

    tol: float = 1e-6
    solver: Literal["auto", "ipopt", "newton"] = "auto"
    degree: int | None = None
    kind: Kind | None = None
    half: bool = True
    sketched: bool = False

    def __post_init__(self) -> None:
        low, high = TOLERANCE_RANGE
        if not low <= require("tol", self.tol) <= high:
            raise InputError(f"tol = {shown(self.tol)}: must lie between {low:g} and {high:g}")
        known("solver", self.solver, SOLVERS)
        whole("degree", self.degree or 1, at_least=1)
        of_kind("half", self.half, bool)

    def scheme_of(self, problem: Problem) -> tuple[int, Kind]:
        """(degree, kind) for a problem."""
        degree, kind = problem.scheme
        return self.degree or degree, self.kind or kind
