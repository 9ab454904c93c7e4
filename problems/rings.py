"""Cycles of which every multiplier is a formula, and with it every special point of their branches.

The circle x^2 + y^2 = 1, or another one, is run through in 2 pi:

    x' = g x - y,    y' = g y + x,    g a function of w = x^2 + y^2 - 2, or 1 - x^2 - y^2 where others follow

isola           g = 1 - lam^2 - w^2                 a closed curve of cycles: folds at lam = -1, 1
hysteresis      g = lam + s w - w^3                 folds at lam = -2 (s/3)^(3/2), +2 (s/3)^(3/2)
band            (u, v)' = R(a/2) diag(m, -1/5) R(-a/2) (u, v) + half a turn in a turn of a, m = k (width^2 - lam^2)
                multipliers -exp(2 pi m), -exp(-2 pi/5): flips at lam = -width, width
crossing        z' = lam z - z^2                    z = 0 has the multiplier exp(2 pi lam), meets z = lam at lam = 0
torus           x' = (z - b) x - 7/2 y, y' = (z - b) y + 7/2 x, z' = lam + z - z^3/3 - (x^2 + y^2) (1 + c z)

In the last, z = b and r^2 = (lam + b - b^3/3)/(1 + b c): a torus branches off where the trace 1 - b^2 - c r^2 of the
(r, z) plane is zero, and the cycle shrinks to an equilibrium at lam = b^3/3 - b.  A small s, or a small width, puts
two points so near to each other that a step goes over both.

Source of the torus: W. F. Langford, Numerical studies of torus bifurcations, ISNM 70 (1984) 285-295, without the term
that turns with the angle.  The others are made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from casahunt.hybrid import Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

SPIN, B, C = 3.5, 0.7, 0.25
SECOND = -0.2


def _ring(name: str, rate: Callable[[Any, Any], Any], **parameters: float) -> System:
    def field(x: Any, p: Any) -> dict[str, Any]:
        g = rate(x.x**2 + x.y**2 - 2, p)
        return {"x": g * x.x - x.y, "y": g * x.y + x.x}

    return System(name, ("x", "y"), parameters, (Mode("smooth", field=field),))


def _band(x: Any, p: Any) -> dict[str, Any]:
    first = p.k * (p.width**2 - p.lam**2)
    m, d, g = (first + SECOND) / 2, (first - SECOND) / 2, 1 - x.x**2 - x.y**2
    r2 = x.u**2 + x.v**2
    return {
        "x": g * x.x - x.y,
        "y": g * x.y + x.x,
        "u": -x.v / 2 + m * x.u + d * (x.x * x.u + x.y * x.v) - r2 * x.u,
        "v": x.u / 2 + m * x.v + d * (x.y * x.u - x.x * x.v) - r2 * x.v,
    }


def _crossing(x: Any, p: Any) -> dict[str, Any]:
    g = 1 - x.x**2 - x.y**2
    return {"x": g * x.x - x.y, "y": g * x.y + x.x, "z": p.lam * x.z - x.z**2}


def _torus(x: Any, p: Any) -> dict[str, Any]:
    g, r2 = x.z - p.b, x.x**2 + x.y**2
    z = p.lam + x.z - x.z**3 / 3 - r2 * (1 + p.c * x.z)
    return {"x": g * x.x - SPIN * x.y, "y": g * x.y + SPIN * x.x, "z": z}


ISOLA = _ring("an isola of cycles", lambda w, p: 1 - p.lam**2 - w**2, lam=0.25)
HYSTERESIS = _ring("hysteresis of cycles", lambda w, p: p.lam + p.s * w - w**3, lam=1.0, s=1.0)
BAND = System(
    "a cycle on a twisted band",
    ("x", "y", "u", "v"),
    {"lam": -1.0, "width": 0.3, "k": 0.1},
    (Mode("smooth", field=_band),),
)
CROSSING = System("two crossing cycles", ("x", "y", "z"), {"lam": -0.3}, (Mode("smooth", field=_crossing),))
TORUS = System("Langford's torus", ("x", "y", "z"), {"lam": 3.0, "b": B, "c": C}, (Mode("smooth", field=_torus),))


def _hysteresis(s: float) -> Course:
    top = 2 * (s / 3) ** 1.5

    def start() -> SystemOrbit:
        return find_cycle(HYSTERESIS, parameters={"s": s}, x=1.8, y=0.0)

    return Course(f"hysteresis, s = {s:g}", start, "lam", -1.0, (("fold", -top), ("fold", top)))


def _flips(width: float) -> Course:
    def start() -> SystemOrbit:
        return find_cycle(BAND, parameters={"width": width}, settled=True, x=1.0, y=0.0, u=0.0, v=0.0)

    return Course(f"band, width {width:g}", start, "lam", 1.0, (("flip", -width), ("flip", width)))


def branches() -> Iterator[Course]:
    """All of them."""
    yield Course(
        "isola", lambda: find_cycle(ISOLA, x=1.7, y=0.0), "lam", 2.0, (("fold", 1.0), ("fold", -1.0)), ("closed",),
        {"back": -2.0},
    )  # fmt: skip
    yield from (_hysteresis(s) for s in (1.0, 0.03))
    yield from (_flips(width) for width in (0.3, 0.05))
    crossing = partial(find_cycle, CROSSING, x=1.0, y=0.0, z=0.1)
    yield Course("crossing", crossing, "lam", 0.3, (("branch point", 0.0),))
    bifurcates = (1 - B**2) / C * (1 + B * C) - B + B**3 / 3
    points = (("Neimark-Sacker", bifurcates), ("Hopf", B**3 / 3 - B))
    yield Course("torus", lambda: find_cycle(TORUS, x=math.sqrt(3.0), y=0.0, z=B), "lam", -1.0, points, ("Hopf",))
