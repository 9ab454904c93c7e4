"""A computed periodic orbit: solved, judged, its error estimated, its mesh placed anew until the tolerance holds.

    G(u) = 0,    |error of period and amplitude| <= tol,    multipliers: eigenvalues of S dx(T)/dx(0)

graded.py    eigenvalues of a product that spans many decades
map_chain.py the linearised map of a cycle, in factors
floquet.py   Floquet multipliers
observables.py a state or an expression as numbers
extrema.py   its largest and smallest value over a cycle
event_passage.py where an expression turns or goes through zero inside a phase
amplitude.py what is measured of a cycle, with the errors
multiplier_mesh.py  the multipliers on meshes made for them
orbit.py     Orbit and Arc: results as frozen numpy
state_sensitivity.py the states at given times, and how they move with the parameters
batched_multipliers.py the multipliers of many orbits
restart.py   starting points for another phase sequence
bordering.py the row under which the parameter is free
closure.py   how a cycle of a user's system closes, and where it is cut
recurrence.py  when a motion repeats, as it is or mirrored
watching.py  a first look at a motion: sizes, where it is cut
sequences.py   other phase sequences, where one has stopped being a motion
simulated_phases.py the phases that the motion itself has
adapt.py     solve, judge, estimate, refine, until the tolerance holds
fold_side.py on which side of a fold a cycle lies
ensemble.py  cycles of many problems near one whose cycle is known
archive.py   orbits in files
system_orbit.py  a cycle of a user's system, as its user reads it
returning.py a motion followed until it comes back
family.py    the cycles of a user's system at one p
marched_mesh.py  from a motion that is not yet the orbit to the orbit
first_return.py  where a motion first comes back: the guess of a cycle next to a state
cycle_search.py the cycle that a motion of a user's system settles on
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .adapt import refined
    from .archive import Archive, write_archive
    from .batched_multipliers import with_multipliers
    from .bordering import Options
    from .closure import Closure
    from .cycle_search import find_cycle
    from .ensemble import OrbitEnsemble, orbit_ensemble
    from .event_passage import Crossings
    from .family import Cycles, load_orbit, posed
    from .floquet import Multipliers
    from .marched_mesh import orbit_from_motion
    from .orbit import Arc, Orbit
    from .state_sensitivity import StateSensitivity, state_sensitivity
    from .system_orbit import SystemOrbit

__all__ = [
    "Arc", "Archive", "Closure", "Crossings", "Cycles", "Multipliers", "Options", "Orbit", "OrbitEnsemble",
    "StateSensitivity", "SystemOrbit", "find_cycle", "load_orbit", "orbit_ensemble", "orbit_from_motion", "posed",
    "refined", "state_sensitivity", "with_multipliers", "write_archive",
]  # fmt: skip
__getattr__ = lazily(__name__)
