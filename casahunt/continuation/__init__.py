"""Following orbits in a parameter, and the points where a branch turns.

    G(u, lambda) = 0 along s:    G_u u' + G_lambda lambda' = 0,    |(x_0, ln T_1, lambda)'| = 1;   fold: lambda' = 0

predictor.py        the last two points of a branch, interpolated and carried on
curve.py            the curve of a branch: its points and tangents, and the cycle next to one
walk.py             orbits along it, by pseudo-arclength, or at prescribed values of the parameter
special_points.py   folds, symmetry breaking, superstable and grazing cycles: what they are
poincare_section.py another plane for a cycle that is cut by planes
grazing_contact.py  cycles that contact an event
locating.py         the orbit between two at which a monitor vanishes, or where a branch turns
vanishing.py        where a phase shrinks to nothing, and where between two orbits the phases change
bifurcations.py     branch points, flips, losses of symmetry and tori, by the multipliers
crossings.py        what a branch passes from orbit to orbit
branching.py        from a flip or a loss of symmetry to the cycles that branch off
beyond_grazing.py   behind a grazing: the cycle that a branch goes on with
equilibrium.py      the curve of equilibria of a mode, and the normal form of their Hopf bifurcations
equilibrium_crossings.py where eigenvalues of equilibria pass the imaginary axis
equilibrium_branch.py equilibria of a mode, followed in a parameter
birth.py            the cycle that is born at a Hopf bifurcation
terminations.py     where cycles end: shrunk, grown, at an equilibrium; and through a rest
branch.py           a branch on its way, and as it is handed out
closed_branch.py    where a branch closes
over_contacts.py    steps of a walk that lead over a contact
following.py        a branch of a user's system, with what is met on the way
fold_expansion.py   a known fold and how it changes with parameters; the folds of many members from there, in one loop
fold.py             a fold as a point of the branch, and how much it moves with every parameter
fold_conditions.py  a fold as constraints of a larger optimisation problem
fold_check.py       a located fold, confirmed, on its mesh and on finer ones
fold_ensemble.py    folds of many problems near one whose fold is known, with their errors and derivatives
plane_curve.py      a curve phi(s, c) = 0 by pseudo-arclength, through its turning points
surface.py          orbits beside a special one, as a surface over two parameters, and the special points on it
folds_ahead.py      a curve of folds in batches
two_parameters.py   the curve of special points in two parameters
extremum.py         the largest and the smallest value of a parameter, with what moves it
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .bifurcations import monitors_of
    from .birth import born_at
    from .branch import Branch
    from .branching import branch_off
    from .crossings import special_points_between
    from .equilibrium_branch import Equilibrium, EquilibriumBranch, SpecialEquilibrium, equilibria
    from .extremum import grazing, largest, left_by_motions, smallest
    from .fold import Fold, Vanishing, fold_between
    from .fold_check import next_fold
    from .fold_conditions import FoldConstraints
    from .fold_ensemble import Folds, expansion, expansion_beside, folds_near
    from .fold_expansion import Expansion
    from .following import follow
    from .special_points import (
        FOLD,
        GRAZING,
        SUPERSTABLE,
        SYMMETRY_BREAKING,
        Missed,
        Monitor,
        SpecialPoint,
        user_monitor,
    )
    from .surface import Axis, SpecialOrbit
    from .terminations import End
    from .two_parameters import SpecialCurve, special_curve, special_walk
    from .walk import walk_to_end

__all__ = [
    "FOLD", "GRAZING", "SUPERSTABLE", "SYMMETRY_BREAKING", "Axis", "Branch", "End", "Equilibrium",
    "EquilibriumBranch", "Expansion", "Fold", "FoldConstraints", "Folds", "Missed", "Monitor", "SpecialCurve",
    "SpecialEquilibrium", "SpecialOrbit", "SpecialPoint", "Vanishing", "born_at", "branch_off", "equilibria",
    "expansion", "expansion_beside", "fold_between", "folds_near", "follow", "grazing", "largest", "left_by_motions",
    "monitors_of", "next_fold", "smallest", "special_curve", "special_points_between", "special_walk", "user_monitor",
    "walk_to_end",
]  # fmt: skip
__getattr__ = lazily(__name__)
