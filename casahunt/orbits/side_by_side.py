"""Multipliers of orbits before anyone reads them: of many side by side they take half as long.

Whoever has computed several orbits, all of which will be asked for theirs, says so; the numbers are the same but for
rounding (multiplier_mesh.py).
"""

from __future__ import annotations

from collections.abc import Sequence

from .multiplier_mesh import multipliers_of_many
from .orbit import Orbit, linearised, unknowns_of

ORBITS_AHEAD = 8
"""Orbits of a branch that are waited for: multipliers take half as long for eight at once."""


def know_multipliers(orbits: Sequence[Orbit]) -> None:
    """Compute the multipliers of some orbits, to be had when they are read.

    orbits: the orbits; nothing is done for those whose multipliers are known.
    """
    unknown = [orbit for orbit in orbits if "multipliers" not in vars(orbit)]
    for solver in sorted({orbit.solver for orbit in unknown}):
        some = [orbit for orbit in unknown if orbit.solver == solver]
        places = [
            linearised(orbit, orbit.problem.principal) if orbit.problem.names else (*unknowns_of(orbit), None)
            for orbit in some
        ]
        for orbit, found in zip(some, multipliers_of_many(places, solver), strict=True):
            vars(orbit)["multipliers"] = found  # where its cached property looks for them
