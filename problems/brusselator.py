"""The Brusselator: a chemical oscillator, from its birth to relaxation oscillations.

    x' = A + x^2 y - (B + 1) x,    y' = B x - x^2 y

Its one equilibrium (A, B/A) loses its stability at B = 1 + A^2, where the cycle is born.

Source: I. Prigogine and R. Lefever, Journal of Chemical Physics 48 (1968) 1695-1700.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from casahunt.hybrid import Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course


def field(x: Any, p: Any) -> dict[str, Any]:
    """The reactions."""
    return {"x": p.A + x.x**2 * x.y - (p.B + 1) * x.x, "y": p.B * x.x - x.x**2 * x.y}


SYSTEM = System("the Brusselator", ("x", "y"), {"B": 3.0, "A": 1.0}, (Mode("smooth", field=field),))


def cycle() -> SystemOrbit:
    """The cycle at A = 1, B = 3."""
    return find_cycle(SYSTEM, x=1.5, y=3.0)


def branches() -> Iterator[Course]:
    """Down to the birth of the cycle, and up."""
    yield Course("Brusselator, down", cycle, "B", 1.0, (("Hopf", 2.0),), ("Hopf",))
    yield Course("Brusselator, up", cycle, "B", 20.0, ())
