"""A mass on a belt with friction that falls and rises again: stick and slip, slip alone, and rest.

    x'' + 2 zeta x' + x = mu(V - x'),    mu(u) = ms - 3/2 (ms - mm) (u/vm - (u/vm)^3/3),    or it is carried, x' = V,

with ms = 0.4, mm = 1/4, vm = 1/2, zeta = 1/20.  The equilibrium is stable from

    V = vm sqrt(1 - 4 zeta vm/(3 (ms - mm)))

on.  Just below, the mass slips all the time; where the fastest part of that cycle reaches the belt it begins to stick.

Source: J. J. Thomsen and A. Fidlin, Analytical approximations for stick-slip vibration amplitudes, International
Journal of Non-Linear Mechanics 38 (2003) 389-403.  The grazing: scripts/peers/branch_truths.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

STATIC, LEAST, VM, ZETA = 0.4, 0.25, 0.5, 0.05


def _slip(x: Any, p: Any) -> dict[str, Any]:
    u = (p.V - x.v) / p.vm
    friction = p.ms - 1.5 * (p.ms - p.mm) * (u - u**3 / 3)
    return {"x": x.v, "v": friction - 2 * p.zeta * x.v - x.x}


def _carried(x: Any, t: Any, p: Any) -> dict[str, Any]:
    return {"x": x.x + p.V * t, "v": p.V}


def _pull(x: Any, p: Any) -> Any:
    return x.x + 2 * p.zeta * p.V - p.ms


SYSTEM = System(
    "cubic friction on a belt",
    states=("x", "v"),
    parameters={"V": 0.3, "ms": STATIC, "mm": LEAST, "vm": VM, "zeta": ZETA},
    modes=(
        Mode("slip", field=_slip, holds=lambda x, p: p.V - x.v,
             ends=(Event("sticks", lambda x, p: x.v - p.V, +1, to="stick"),)),
        Mode("stick", flow=_carried, ends=(Event("slips", _pull, +1, to="slip"),)),
    ),
)  # fmt: skip
GRAZING = 0.395790288798
"""scripts/peers/branch_truths.py."""
HOPF = VM * math.sqrt(1 - 4 * ZETA * VM / (3 * (STATIC - LEAST)))


def cycle() -> SystemOrbit:
    """Stick and slip at V = 0.3."""
    return find_cycle(SYSTEM, "slip", x=0.0, v=0.0)


def branches() -> Iterator[Course]:
    """Up to rest."""
    yield Course("cubic friction", cycle, "V", 0.6, (("grazing", GRAZING), ("Hopf", HOPF)), ("Hopf",))
