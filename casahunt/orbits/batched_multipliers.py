"""Multipliers of orbits before anyone reads them: of many in a batch they take half as long.

Whoever has computed several orbits, all of which will be asked for theirs, says so; the numbers are the same but for
rounding (multiplier_mesh.py).
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

from .. import effort
from ..errors import NoOrbit
from .multiplier_mesh import multipliers_of_many
from .orbit import AnyOrbit, Orbit, linearised, unknowns_of

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


def with_multipliers(
    steps: Generator[AnyOrbit, None, str], *, ahead: bool = True
) -> Generator[tuple[AnyOrbit, bool], None, str]:
    """The orbits of a walk that is some steps ahead, whose multipliers are computed in batches.

    Parameters
    ----------
    steps
        orbits one by one, such as `casahunt.walk` gives them.
    ahead
        False: the walk is no step ahead, and nothing is computed.

    Yields
    ------
    The same orbits, whose multipliers take half as long, each with whether the next one is found already.  The
    generator returns what `steps` does.

    Raises
    ------
    NoOrbit, KeyboardInterrupt, GivenUp : as `steps`, behind the orbits that were found before.

    Examples
    --------
    >>> from casahunt import walk
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle, with_multipliers
    >>> start = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> orbits = list(with_multipliers(walk(start, vary="belt", low=0.2, high=0.21)))
    >>> all(orbit.stable for orbit, _ in orbits)
    True
    """
    while True:
        some: list[AnyOrbit] = []
        ended: str | BaseException | None = None
        while ended is None and len(some) < (ORBITS_AHEAD if ahead else 1):
            try:
                some.append(next(steps))
            except StopIteration as end:
                ended = str(end.value)
            except (NoOrbit, KeyboardInterrupt, effort.GivenUp) as error:
                ended = error
        if ahead:
            know_multipliers(some)
        yield from ((orbit, orbit is not some[-1]) for orbit in some)
        if isinstance(ended, BaseException):
            raise ended
        if ended is not None:
            return ended
