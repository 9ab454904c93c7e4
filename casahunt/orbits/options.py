"""How orbits are computed: settings that hold no problem data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from ..checks import choice_of, of_kind, require, shown, whole_number
from ..collocation.scheme import Kind
from ..errors import InputError
from ..hybrid.problem import Problem

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
