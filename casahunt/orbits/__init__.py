"""A computed periodic orbit: solved, judged, its error estimated, its mesh placed anew until the tolerance holds.

    G(u) = 0,    |error of period and amplitude| <= tol,    multipliers: eigenvalues of S dx(T)/dx(0)

graded.py    eigenvalues of a product that spans many decades
floquet.py   Floquet multipliers
orbit.py     Orbit and Arc: results as frozen numpy
restart.py   starting points for another phase sequence
adapt.py     solve, judge, estimate, refine, until the tolerance holds
archive.py   orbits in files
recurrence.py  when a motion repeats, as it is or mirrored
cycle_search.py the cycle that a motion of a user's system settles on
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .adapt import Options
    from .cycle_search import find_cycle
    from .orbit import Orbit

__all__ = ["Options", "Orbit", "find_cycle"]
__getattr__ = lazily(__name__, {"adapt": ("Options",), "cycle_search": ("find_cycle",), "orbit": ("Orbit",)})
