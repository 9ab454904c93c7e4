"""Lorenz' system: the two ends of his unstable cycle, and the windows of large r.

    x' = s (y - x),    y' = r x - y - x z,    z' = x y - b z,    s = 10, b = 8/3

It is the same under (x, y) -> (-x, -y).  The small unstable cycles round the two equilibria shrink to them at

    r = s (s + b + 3)/(s - b - 1) = 24.7368...

and end in a pair of homoclinic orbits at r = 13.926557, as the symmetric cycle does that is stable beyond r = 312.97,
where it loses its symmetry; another symmetric cycle ends in a fold at r = 166.06, beyond which the motion is
intermittent.

Sources: E. N. Lorenz, Journal of the Atmospheric Sciences 20 (1963) 130-141; C. Sparrow, The Lorenz Equations,
Springer 1982 (13.926, 24.74, 313); Y. Pomeau and P. Manneville, Communications in Mathematical Physics 74 (1980)
189-197 (166.06). The digits: scripts/peers/branch_truths.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from casahunt.hybrid import Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

S, B = 10.0, 8 / 3


def field(x: Any, p: Any) -> dict[str, Any]:
    """Lorenz' equations."""
    return {"x": p.s * (x.y - x.x), "y": p.r * x.x - x.y - x.x * x.z, "z": x.x * x.y - p.b * x.z}


SYSTEM = System(
    "Lorenz' system",
    states=("x", "y", "z"),
    parameters={"r": 350.0, "s": S, "b": B},
    modes=(Mode("smooth", field=field),),
    symmetries=(np.diag([-1.0, -1.0, 1.0]),),
)

HOPF = S * (S + B + 3) / (S - B - 1)
BREAKING, FOLD = 312.97353298417, 166.06149210386
"""scripts/peers/branch_truths.py, correct to 1e-10 of themselves."""
HOMOCLINIC = 13.9265574
"""Where the branch ends: 13.926... (Sparrow, section 2.2)."""
SMALL = {"x": 2.9566707, "y": 0.72184126, "z": 19.0}
"""On the small unstable cycle at r = 20, by shooting."""


def small() -> SystemOrbit:
    """The small unstable cycle at r = 20."""
    return find_cycle(SYSTEM, parameters={"r": 20.0}, settled=True, start=SMALL)


def branches() -> Iterator[Course]:
    """The small cycle to either end, the large one to its end, and the window of Pomeau and Manneville."""
    yield Course("Lorenz, small cycle upwards", small, "r", 30.0, (("Hopf", HOPF),), ("Hopf",), {"back": 10.0})
    yield Course("Lorenz, small cycle downwards", small, "r", 10.0, (), ("homoclinic orbit",), {"back": 25.0})
    breaking = (("symmetry breaking", BREAKING),)
    large = {"x": 10.0, "y": 10.0, "z": 350.0}
    yield Course(
        "Lorenz, large cycle", lambda: find_cycle(SYSTEM, start=large), "r", 10.0, breaking, ("homoclinic orbit",)
    )
    window = {"x": 10.0, "y": 10.0, "z": 160.0}
    yield Course(
        "Lorenz, window at 166", lambda: find_cycle(SYSTEM, parameters={"r": 166.0}, start=window), "r", 180.0,
        (("fold", FOLD),), how={"back": 160.0},
    )  # fmt: skip
