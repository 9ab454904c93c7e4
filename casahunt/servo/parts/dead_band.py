"""Dead bands: what the controller takes no notice of, or less, where the error e is small.

    dead band           integrand = e where |e| > delta, else 0
    shifted dead band   integrand = e - delta sgn(e) where |e| > delta, else 0: continuous
    hysteresis          the integrator stops where |e| falls below r delta, and goes on where |e| rises above delta
    error dead band     e -> e - (1 - r) delta sgn(e) where |e| > delta, else r e: for all parts of the controller

Inside, a stuck servo rests for ever, at any |x1| <= delta; with the error dead band only where r = 0, as here.
"""

from __future__ import annotations

from typing import Any

from .part import Edge, Function, Law, Part, PartMode
from .remedy import Remedy, anywhere_within


def _two(name: str, size: str, enter: Function, leave: Function, **more: float) -> Part:
    """An integrator's input, cut inside."""
    return Part(
        name, (), {size: 0.0, **more}, ranges=dict.fromkeys(more, (0.0, 1.0)), size=size,
        modes=(
            PartMode("", Law(gives={"integrand": lambda x, s, p: s.error}), (Edge("enters", enter, -1, "inside"),),
                     where=lambda x, s, p: leave(x, s, p) > 0),
            PartMode("inside", Law(gives={"integrand": lambda x, s, p: 0.0}), (Edge("leaves", leave, +1, ""),)),
        ),
    )  # fmt: skip


def _three(name: str, size: str, angle: str, above: Law, inside: Law, below: Law, **more: float) -> Part:
    """Something that goes on continuously on both sides of a band."""

    def upper(x: Any, s: Any, p: Any) -> Any:
        return getattr(s, angle) / getattr(p, size) - 1

    def lower(x: Any, s: Any, p: Any) -> Any:
        return getattr(s, angle) / getattr(p, size) + 1

    return Part(
        name, (), {size: 0.0, **more}, ranges=dict.fromkeys(more, (0.0, 1.0)), size=size,
        modes=(
            PartMode("above", above, (Edge("enters from above", upper, -1, "inside"),),
                     where=lambda x, s, p: upper(x, s, p) > 0),
            PartMode("below", below, (Edge("enters from below", lower, +1, "inside"),),
                     where=lambda x, s, p: lower(x, s, p) < 0),
            PartMode("inside", inside, (Edge("leaves above", upper, +1, "above"),
                                        Edge("leaves below", lower, -1, "below"))),
        ),
    )  # fmt: skip


def _square(x: Any, s: Any, p: Any) -> Any:
    return s.error**2 / p.dead_band**2 - 1


DEAD_BAND = _two("dead band", "dead_band", _square, _square)
HYSTERESIS = _two(
    "hysteresis", "hysteresis",
    lambda x, s, p: s.error**2 / (p.enter_ratio * p.hysteresis) ** 2 - 1,
    lambda x, s, p: s.error**2 / p.hysteresis**2 - 1, enter_ratio=0.5,
)  # fmt: skip
SHIFTED_DEAD_BAND = _three(
    "shifted dead band", "shifted_dead_band", "error",
    Law(gives={"integrand": lambda x, s, p: s.error - p.shifted_dead_band}),
    Law(gives={"integrand": lambda x, s, p: 0.0}),
    Law(gives={"integrand": lambda x, s, p: s.error + p.shifted_dead_band}),
)  # fmt: skip
ERROR_DEAD_BAND = _three(
    "error dead band", "error_dead_band", "seen",
    Law(gives={"error": lambda x, s, p: s.seen - (1 - p.remaining_gain) * p.error_dead_band,
               "error_rate": lambda x, s, p: s.seen_rate}),
    Law(gives={"error": lambda x, s, p: p.remaining_gain * s.seen,
               "error_rate": lambda x, s, p: p.remaining_gain * s.seen_rate}),
    Law(gives={"error": lambda x, s, p: s.seen + (1 - p.remaining_gain) * p.error_dead_band,
               "error_rate": lambda x, s, p: s.seen_rate}),
    remaining_gain=0.0,
)  # fmt: skip

REMEDIES = (
    Remedy("dead band", "dead_band", "rad", anywhere_within, DEAD_BAND, scale="amplitude", last=2.0),
    Remedy("shifted dead band", "shifted_dead_band", "rad", anywhere_within, SHIFTED_DEAD_BAND,
           scale="amplitude", last=4.0),
    Remedy("hysteresis", "hysteresis", "rad", anywhere_within, HYSTERESIS, scale="amplitude", last=4.0),
    Remedy("error dead band", "error_dead_band", "rad", anywhere_within, ERROR_DEAD_BAND,
           scale="amplitude", last=20.0,
           why_not="inside only the integral's content acts, and it pushes the servo through to the other side"),
)  # fmt: skip
