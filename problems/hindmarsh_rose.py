"""Hindmarsh and Rose's nerve: spikes under a strong current, which flip on the way to bursts.

    x' = y - x^3 + 3 x^2 - z + I,    y' = 1 - 5 x^2 - y,    z' = e (4 (x + 1.6) - z),    e = 0.006

Under a current beyond I = 25.265 the nerve rests; below, it spikes.

Source: J. L. Hindmarsh and R. M. Rose, Proceedings of the Royal Society B 221 (1984) 87-102.  The digits:
scripts/peers/branch_truths.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from casahunt.hybrid import Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course


def field(x: Any, p: Any) -> dict[str, Any]:
    """The nerve."""
    return {
        "x": x.y - x.x**3 + 3 * x.x**2 - x.z + p.I,
        "y": 1 - 5 * x.x**2 - x.y,
        "z": p.e * (4 * (x.x + 1.6) - x.z),
    }


SYSTEM = System("Hindmarsh and Rose's nerve", ("x", "y", "z"), {"I": 5.0, "e": 0.006}, (Mode("smooth", field=field),))
FLIP, HOPF = 3.49425473922, 25.265120823872
"""scripts/peers/branch_truths.py."""


def cycle() -> SystemOrbit:
    """The spikes at I = 5."""
    return find_cycle(SYSTEM, x=0.0, y=0.0, z=4.0)


def branches() -> Iterator[Course]:
    """Down through the flip, and up to rest."""
    yield Course("Hindmarsh-Rose, down", cycle, "I", 3.0, (("flip", FLIP),))
    yield Course("Hindmarsh-Rose, up", cycle, "I", 30.0, (("Hopf", HOPF),), ("Hopf",))
