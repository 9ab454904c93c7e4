"""A computed periodic orbit: solved, judged, its error estimated, its mesh placed anew until the tolerance holds.

    G(u) = 0,    |error of period and amplitude| <= tol,    multipliers: eigenvalues of S dx(T)/dx(0)

floquet.py   Floquet multipliers
extrema.py   the largest and smallest value of a state or an expression
orbit.py     Orbit and Arc: results as frozen numpy
restart.py   starting points for another phase sequence
adapt.py     solve, judge, estimate, refine, until the tolerance holds
archive.py   orbits in files
system_orbit.py  a cycle of a user's system, as its user reads it
family.py    the cycles of a user's system at one p
recurrence.py  when a motion repeats, as it is or mirrored
cycle_search.py the cycle that a motion of a user's system settles on
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .adapt import Options
    from .cycle_search import find_cycle
    from .family import load_orbit
    from .orbit import Orbit
    from .system_orbit import SystemOrbit

__all__ = ["Options", "Orbit", "SystemOrbit", "find_cycle", "load_orbit"]
__getattr__ = lazily(
    __name__,
    {
        "adapt": ("Options",),
        "cycle_search": ("find_cycle",),
        "family": ("load_orbit",),
        "orbit": ("Orbit",),
        "system_orbit": ("SystemOrbit",),
    },
)
