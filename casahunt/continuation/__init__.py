"""Following orbits in a parameter, and the points where a branch turns.

    G(u, lambda) = 0 along s:    G_u u' + G_lambda lambda' = 0,    |(x_0, ln T_1, lambda)'| = 1;   fold: lambda' = 0

curve.py            the curve of a branch: its points, tangent and predictor
walk.py             by pseudo-arclength or by natural continuation
special_points.py   folds, symmetry breaking, superstable and grazing cycles, located
bifurcations.py     flips, losses of symmetry and tori, by the multipliers
branching.py        from a flip or a loss of symmetry to the cycles that branch off
branch.py           a branch of a user's system, with what is met on the way
fold_conditions.py  the conditions of a fold as constraints of a larger problem
turning_point.py    the largest lambda on a mesh by Newton's method alone
fold.py             a fold as a point of the branch and as an optimum, confirmed
plane_curve.py      a curve phi(s, c) = 0 by pseudo-arclength, through its turning points
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .branch import Branch, follow
    from .branching import branch_off
    from .special_points import Missed, SpecialPoint

__all__ = ["Branch", "Missed", "SpecialPoint", "branch_off", "follow"]
__getattr__ = lazily(
    __name__,
    {"branch": ("Branch", "follow"), "branching": ("branch_off",), "special_points": ("Missed", "SpecialPoint")},
)
