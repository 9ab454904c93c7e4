"""Cycles born of kicks, of hysteresis, where switching manifolds intersect (hopf_like.py says what is told).

    impulsive           x' = y, y' = -x - 2 z y;  y -> (1 + kick) y - c y^2 where x rises through 0
                        born at 1 + kick = exp(2 pi z/w), w^2 = 1 - z^2;  amplitude ~ kick - kick_0, period = 2 pi/w
    hysteresis          x' = 2, y' = 1 - y until x = 1 + eps;  x' = -1, y' = -1 - y until x = 1 - eps
                        shrinks to the pseudo-equilibrium (1, -1/3);  amplitude ~ eps, period = 3 eps
    hysteretic folds    x' = y, y' = -u - d y;  u = 1 until x falls to -eps, u = -1 until it rises to eps
                        amplitude ~ eps^1/3 (that of x: eps^2/3), period ~ eps^1/3
    four quadrants      (x', y') = (-1, g - k y), (-1, -1), (1, -1), (1, 1) in the first, second, third, fourth one
                        born at g = 1;  amplitude ~ g - 1, period ~ g - 1

Source: the review named in hopf_like.py.
"""

from __future__ import annotations

import math
from typing import Any

from casahunt.hybrid import Event, Mode, System

from .hopf_like import Birth, Turn, series, zero

DAMPING, LIMIT = 0.1, 0.5
"""z and c of the kicks."""
LOSS = 0.5
"""d of the relay."""
BRAKE = 0.5
"""k of the quadrants."""

RATE = math.sqrt(1 - DAMPING**2)
DECAY = math.exp(-2 * math.pi * DAMPING / RATE)
"""w, and what is left of y after a turn without a kick."""


def kicked(kick: float) -> Turn:
    """The truth."""
    return Turn(2 * math.pi / RATE, 0.0, ((1 + kick) * DECAY - 1) / (LIMIT * DECAY**2))


def drifting(eps: float) -> Turn:
    """The truth: x rises in the time eps and falls in 2 eps."""
    return Turn(3 * eps, 1 - eps, (2 * math.expm1(-2 * eps) - math.expm1(-3 * eps)) / -math.expm1(-3 * eps))


def thrown(eps: float) -> Turn:
    """The truth: half a period is h = 2 a/d, y = tanh(a)/d where u switches, and a - tanh a = d^2 eps."""
    a = (3 * LOSS**2 * eps) ** (1 / 3)
    # a - tanh a = (a cosh a - sinh a)/cosh a, whose numerator is the sum of 2 n a^(2 n + 1)/(2 n + 1)!
    a = zero(
        lambda a: series(lambda n: 2 * n * a ** (2 * n - 2) / math.factorial(2 * n + 1), 1) / math.cosh(a)
        - LOSS**2 * eps / a**3, a / 2, 4 * a,
    )  # fmt: skip
    return Turn(4 * a / LOSS, eps, math.tanh(a) / LOSS)


def around(g: float) -> Turn:
    """The truth: from (r, 0) to (0, r) in the time r, where g (1 - exp(-k r)) = k r."""

    def residual(z: float) -> float:  # (exp(-z) - 1 + z)/z = (g - 1)(1 - exp(-z))/z with z = k r
        return series(lambda n: -((-z) ** (n - 1)) / math.factorial(n), 2) / (-math.expm1(-z) / z) / (g - 1) - 1

    r = zero(residual, (g - 1) / 2, 8 * (g - 1)) / BRAKE
    return Turn(4 * r, r, 0.0)


def swinging(x: Any, p: Any) -> dict[str, Any]:
    """An oscillator between kicks."""
    return {"x": x.y, "y": -x.x - 2 * DAMPING * x.y}


def kick(x: Any, p: Any) -> dict[str, Any]:
    """What a kick makes of the speed."""
    return {"y": (1 + p.kick) * x.y - LIMIT * x.y**2}


CLOCK = System(
    "clock",
    ("x", "y"),
    {"kick": 1.2},
    (
        Mode("right", swinging, holds=lambda x, p: x.x,
             ends=(Event("swings back", lambda x, p: x.x, -1, to="left"),)),
        Mode("left", swinging, holds=lambda x, p: -x.x,
             ends=(Event("is kicked", lambda x, p: x.x, +1, to="right", reset=kick),)),
    ),
)  # fmt: skip

THERMOSTAT = System(
    "thermostat",
    ("x", "y"),
    {"eps": 0.2},
    (
        Mode("up", lambda x, p: {"x": 2.0, "y": 1 - x.y},
             ends=(Event("is high", lambda x, p: x.x - 1 - p.eps, +1, to="down"),)),
        Mode("down", lambda x, p: {"x": -1.0, "y": -1 - x.y},
             ends=(Event("is low", lambda x, p: x.x - 1 + p.eps, -1, to="up"),)),
    ),
)  # fmt: skip

RELAY = System(
    "relay with hysteresis",
    ("x", "y"),
    {"eps": 0.1},
    (
        Mode("back", lambda x, p: {"x": x.y, "y": -1 - LOSS * x.y},
             ends=(Event("falls", lambda x, p: x.x + p.eps, -1, to="forth"),)),
        Mode("forth", lambda x, p: {"x": x.y, "y": 1 - LOSS * x.y},
             ends=(Event("rises", lambda x, p: x.x - p.eps, +1, to="back"),)),
    ),
)  # fmt: skip

QUADRANTS = System(
    "four quadrants",
    ("x", "y"),
    {"g": 1.2},
    (
        Mode("first", lambda x, p: {"x": -1.0, "y": p.g - BRAKE * x.y},
             ends=(Event("to the second", lambda x, p: x.x, -1, to="second"),)),
        Mode("second", lambda x, p: {"x": -1.0, "y": -1.0},
             ends=(Event("to the third", lambda x, p: x.y, -1, to="third"),)),
        Mode("third", lambda x, p: {"x": 1.0, "y": -1.0},
             ends=(Event("to the fourth", lambda x, p: x.x, +1, to="fourth"),)),
        Mode("fourth", lambda x, p: {"x": 1.0, "y": 1.0},
             ends=(Event("to the first", lambda x, p: x.y, +1, to="first"),)),
    ),
)  # fmt: skip

BIRTHS = (
    Birth("impulsive", CLOCK, "kick", 1 / DECAY - 1, 1.2, "right", "y", (1.0, 0.0),
          (1 / (LIMIT * DECAY), 2 * math.pi / RATE), kicked),
    Birth("hysteresis", THERMOSTAT, "eps", 0.0, 0.2, "up", "y", (1.0, 1.0), (2 / 3, 3.0), drifting,
          point=(1.0, -1 / 3)),
    Birth("hysteretic folds", RELAY, "eps", 0.0, 0.1, "back", "y", (1 / 3, 1 / 3),
          ((3 / LOSS) ** (1 / 3), 4 * (3 / LOSS) ** (1 / 3)), thrown),
    Birth("four quadrants", QUADRANTS, "g", 1.0, 1.2, "first", "x", (1.0, 1.0), (2 / BRAKE, 8 / BRAKE), around),
)  # fmt: skip
