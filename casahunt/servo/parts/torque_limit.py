"""A motor whose torque is limited, |m| <= limit, with anti-windup.

    clamping           the integrator stands still while the torque is at its limit, whichever way the error is
    back calculation   x3' is moved by (m_commanded - m)/(ki T): the integrator unwinds with the time T
    none               it winds up

Where the command leads beyond the limit with the integrator on, and back with it off, a clamped servo slides along it
(Filippov): the integrator is on for that share of the time with which the command stays there,

    command' = a + b share = 0;     share = 1 lets it go inside,     share = 0 beyond

A drive looks at its samples alone, where it is on or off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ...checks import SMALLEST
from .part import Edge, Function, Law, Part, PartMode
from .wiring import UNGIVEN

ON_THE_LIMIT = 1e-9
"""A command that is off its limit by no more than this part of it is on it."""


def _limited(
    name: str, at_the_limit: Mapping[str, Function], *, slides: bool = False, sampled: Part | None = None, **more: float
) -> Part:
    free = {signal: UNGIVEN[signal] for signal in at_the_limit}
    (upper, *at_upper), (lower, *at_lower) = (
        _side(word, sign, at_the_limit, slides) for word, sign in (("upper", +1), ("lower", -1))
    )

    def again(x: Any, s: Any, p: Any) -> str:
        return at_upper[0].again(x, s, p) or at_lower[0].again(x, s, p)

    return Part(
        name, (), {"torque_limit": math.inf, **more}, ranges={"torque_limit": (SMALLEST, math.inf)},
        size="torque_limit", absent=math.inf, saturates=True, sampled=sampled,
        modes=(
            PartMode("", Law(gives={"torque": lambda x, s, p: s.command, **free}), (upper, lower),
                     where=lambda x, s, p: not again(x, s, p), again=again),
            *at_upper, *at_lower,
        ),
    )  # fmt: skip


def _side(word: str, sign: int, gives: Mapping[str, Function], slides: bool) -> tuple[Any, ...]:
    """The way to one of the limits, and the modes at it; gives: what the part gives there beside the torque."""
    at, along = f"at {word} limit", f"along {word} limit"

    def off(x: Any, s: Any, p: Any) -> Any:
        return s.command / p.torque_limit - sign

    def limit(x: Any, s: Any, p: Any) -> Any:
        return sign * p.torque_limit

    def share(x: Any, s: Any, p: Any) -> Any:
        a, b = s.affine_rate("command", "integrates")
        return -a / b

    def slides_there(x: Any, s: Any, p: Any) -> Any:
        part = share(x, s, p)
        return part * (1 - part)

    def on_it(x: Any, s: Any, p: Any) -> str:
        a, b = (sign * float(each) for each in s.affine_rate("command", "integrates"))
        return "" if a + b < 0 else along if a < 0 else at

    def again(x: Any, s: Any, p: Any) -> str:
        beyond = sign * float(off(x, s, p))
        return on_it(x, s, p) if slides and abs(beyond) <= ON_THE_LIMIT else at if beyond > 0 else ""

    def there(mode: str) -> Function:
        return lambda x, s, p: again(x, s, p) == mode

    leaves = f"leaves {word} limit"
    stays = PartMode(
        at, Law(gives={"torque": limit, **gives}), (Edge(leaves, off, -sign, on_it if slides else ""),),
        where=there(at), again=again,
    )  # fmt: skip
    slide = PartMode(
        along, Law(gives={"torque": limit, "integrates": share}, holds=slides_there),
        (Edge(leaves, lambda x, s, p: share(x, s, p) - 1, +1, ""), Edge(f"stays at {word} limit", share, -1, at)),
        where=there(along), again=again,
    )  # fmt: skip
    return Edge(f"{word} limit", off, sign, on_it if slides else at), stays, *([slide] if slides else [])


_CLAMPED = {"integrates": lambda x, s, p: 0.0}
TORQUE_LIMIT = _limited("torque limit", {})
CLAMPING = _limited("torque limit with clamping", _CLAMPED, slides=True, sampled=_limited("clamping", _CLAMPED))
BACK_CALCULATION = _limited(
    "torque limit with back calculation",
    {"unwinding": lambda x, s, p: (s.command - s.torque) / (s.ki * p.unwinding_time)}, unwinding_time=1.0,
)  # fmt: skip
