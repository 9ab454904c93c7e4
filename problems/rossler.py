"""Rossler's system on its way to chaos: period 1, 2, 4, ..., and the unstable cycles that the motion has left.

    x' = -y - z,      y' = x + a y,      z' = b + z (x - c)

With a = b = 0.2 the cycle of one turn flips near c = 2.83, that of two turns near c = 3.84; at c = 5.7, Rossler's own
value, the motion is chaotic and the cycle of one turn is an unstable one inside of it.  At c = 2 sqrt(a b) the two
equilibria meet, at x = c/2, z = -y = c/(2 a), where the Jacobian has the characteristic polynomial

    s^3 + (c/2 - a) s^2 + (1 + c/(2 a) - a c/2) s,

so that with a = b, c = 2 a they do so with eigenvalues 0, +-i omega: there the cycle of one turn shrinks to a point.

Source: O. E. Rossler, An equation for continuous chaos, Physics Letters A 57 (1976) 397-398; the cascade, e.g., in
S. H. Strogatz, Nonlinear Dynamics and Chaos, section 12.3.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from casahunt.hybrid import Mode, System
from casahunt.orbits import find_cycle

from .gallery import Course, Found, Truth, portrait, present


def field(x: Any, p: Any) -> dict[str, Any]:
    """Rossler's equations."""
    return {"x": -x.y - x.z, "y": x.x + p.a * x.y, "z": p.b + x.z * (x.x - p.c)}


SYSTEM = System(
    "Rossler's system",
    states=("x", "y", "z"),
    parameters={"c": 2.5, "a": 0.2, "b": 0.2},
    modes=(Mode("smooth", field=field),),
)

TRUTH = {
    (2.5, 1): Truth(5.748991183278001,
        {"x": (-3.7074627972643595, 4.733558125388612), "y": (-4.431146241236544, 3.0878184523653354),
         "z": (0.03277329580520885, 3.1992568990197308)},
        (-0.76969364173, -5.17430445326e-06)),
    (3.5, 2): Truth(11.545218287762903,
        {"x": (-5.5652054399297555, 7.068429790384412), "y": (-6.614741251969993, 4.772427489115008),
         "z": (0.022149308301614185, 8.243281071245132)},
        (-0.418735419948, 0.0)),
    (4.0, 4): Truth(23.17700105597586,
        {"x": (-6.393691653251938, 8.103673553266667), "y": (-7.5908325125232095, 5.491446539957878),
         "z": (0.019298950118100414, 11.110409781364094)},
        (-0.104919248066, 0.0)),
    (4.0, 1): Truth(5.8253730804017625,
        {"x": (-5.416409979382109, 7.034965553688744), "y": (-6.437222549416993, 4.625746786930967),
         "z": (0.02131450257776477, 5.123174587987678)},
        (-1.67781863507, 0.0)),
    (5.7, 1): Truth(5.881088455553877,
        {"x": (-7.21113541047745, 9.461034394924537), "y": (-8.552054134403955, 6.198806157754927),
         "z": (0.015516774873471056, 7.440661025731793)},
        (-2.40395353184, 0.0)),
}  # fmt: skip
"""By (c, turns); scripts/peers/gallery_truths.py."""
NEXT_TO = {(4.0, 1): {"x": -5.416, "y": 0.0, "z": 0.0214}, (5.7, 1): {"x": -7.211, "y": 0.0, "z": 0.0155}}
"""States next to the unstable cycles."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle of each case."""
    for (c, turns), truth in TRUTH.items():
        start = NEXT_TO.get((c, turns), {"x": -c, "y": 0.0, "z": 0.0})
        settled = (c, turns) in NEXT_TO
        orbit = find_cycle(SYSTEM, tol=tol, parameters={"c": c}, settled=settled, start=start)
        yield Found(f"c = {c:g}, turns: {turns}", orbit, truth)


FLIPS = {1: 2.832445027862, 2: 3.837358168409, 4: 4.124214732075}
"""By turns, in c; scripts/peers/branch_truths.py."""


def branches() -> Iterator[Course]:
    """The cascade, cycle by cycle."""
    for turns, c in ((1, 2.5), (2, 3.5), (4, 4.0)):
        start = partial(find_cycle, SYSTEM, parameters={"c": c}, x=-c, y=0.0, z=0.0)
        yield Course(f"Rossler, turns: {turns}", start, "c", 5.0, (("flip", FLIPS[turns]),))
    start = partial(find_cycle, SYSTEM, x=-2.5, y=0.0, z=0.0)
    yield Course("Rossler, down", start, "c", 0.1, (), ("shrinks to a point",))


def draw(found: Sequence[Found], ax: Any) -> None:
    """The x-y plane."""
    for one in found:
        portrait(one.orbit, "x", "y", ax, label=one.caption, linestyle="-" if one.orbit.stable else "--")
    ax.legend(fontsize="small")


if __name__ == "__main__":
    present(cycles(), draw, "Rossler's system")
