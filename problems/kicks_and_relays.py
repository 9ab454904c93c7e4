"""Cycles born of kicks, of relays with hysteresis, and where two switching manifolds meet (hopf_like.py says what is told).

    impulsive             x' = y, y' = -x - 2 z y;  y -> (1 + kick) y - c y^2 where x rises through 0
                          born at 1 + kick = exp(2 pi z/w), w^2 = 1 - z^2;  amplitude kick - kick_0, period 2 pi/w
    hysteresis            x' = 2, y' = 1 - y until x = 1 + eps;  x' = -1, y' = -1 - y until x = 1 - eps
                          shrinks to the pseudo-equilibrium (1, -1/3);  amplitude eps, period 3 eps
    hysteresis, two-fold  x' = y, y' = -u - d y;  u = 1 until x falls to -eps, u = -1 until it rises to eps
                          amplitude eps^1/3 (of x: eps^2/3), period eps^1/3
    two manifolds         (-1, g - k y), (-1, -1), (1, -1), (1, 1) in the four quadrants, in their order
                          born at g = 1;  amplitude g - 1, period g - 1

Source: the review named in hopf_like.py.
"""

from __future__ import annotations

import math
from typing import Any

from casahunt.hybrid import Event, Mode, System

from .hopf_like import Birth, fixed

DAMPING, LIMIT = 0.1, 0.5
"""z and c of the kicks."""
LOSS = 0.5
"""d of the relay."""
BRAKE = 0.5
"""k of the four quadrants."""

TURN = math.sqrt(1 - DAMPING**2)
DECAY = math.exp(-2 * math.pi * DAMPING / TURN)


def kicked(kick: float) -> tuple[float, float]:
    """The truth: y decays to DECAY y in a turn.

    Parameters
    ----------
    kick
        the parameter.

    Returns
    -------
    Period, y after the kick.
    """
    return 2 * math.pi / TURN, ((1 + kick) * DECAY - 1) / (LIMIT * DECAY**2)


def drifting(eps: float) -> tuple[float, float]:
    """The truth: x rises in the time eps, falls in 2 eps.

    Parameters
    ----------
    eps
        the parameter.

    Returns
    -------
    Period, and how far below -1/3 y is where x begins to rise.
    """
    rises = -2 * math.expm1(-2 * eps) + math.expm1(-3 * eps)
    return 3 * eps, -rises / math.expm1(-3 * eps) - 1 / 3


def thrown(eps: float) -> tuple[float, float]:
    """The truth: half a period h, y = tanh(d h/2)/d where u switches, and 2 eps = (h - 2 y)/d.

    Parameters
    ----------
    eps
        the parameter.

    Returns
    -------
    Period, y.
    """

    def excess(h: float) -> float:  # (a - tanh a)/a^3 with a = d h/2, by its series where that is exact
        a = LOSS * h / 2
        return 1 / 3 - 2 * a**2 / 15 + 17 * a**4 / 315 - 62 * a**6 / 2835 if a < 0.01 else (a - math.tanh(a)) / a**3

    near = (24 * eps / LOSS) ** (1 / 3)
    h = fixed(lambda h: near / (3 * excess(h)) ** (1 / 3), near / 2, 4 * near)
    return 2 * h, math.tanh(LOSS * h / 2) / LOSS


def around(g: float) -> tuple[float, float]:
    """The truth: from (r, 0) to (0, r) in the time r, y' = g - k y.

    Parameters
    ----------
    g
        the parameter.

    Returns
    -------
    Period, and x where y begins to rise.
    """
    r = fixed(lambda r: -g * math.expm1(-BRAKE * r) / BRAKE, (g - 1) / BRAKE / 10, 10 * (g - 1) / BRAKE)
    return 4 * r, r


def swinging(x: Any, p: Any) -> dict[str, Any]:
    """An oscillator between kicks.

    Parameters
    ----------
    x, p
        states and parameters.

    Returns
    -------
    The derivatives by name.
    """
    return {"x": x.y, "y": -x.x - 2 * DAMPING * x.y}


CLOCK = System(
    "clock",
    ("x", "y"),
    {"kick": 1.2},
    (
        Mode("swings", swinging,
             ends=(Event("is kicked", lambda x, p: x.x, +1, to="swings",
                         reset=lambda x, p: {"y": (1 + p.kick) * x.y - LIMIT * x.y**2}),)),
    ),
)  # fmt: skip

PUSHED = System(
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

THROWN = System(
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
    Birth("impulsive", CLOCK, "kick", 1 / DECAY - 1, 1.2, {"x": 0.1, "y": 1.0}, "swings", "y", 1.0, 0.0,
          (1 / (LIMIT * DECAY), 2 * math.pi / TURN), kicked),
    Birth("hysteresis, pseudo-equilibrium", PUSHED, "eps", 0.0, 0.2, {"x": 0.8, "y": -0.4}, "up", "y", 1.0, 1.0,
          (2 / 3, 3.0), drifting, point=(1.0, -1 / 3)),
    Birth("hysteresis, two-fold", THROWN, "eps", 0.0, 0.1, {"x": 0.1, "y": 0.8}, "back", "y", 1 / 3, 1 / 3,
          ((3 / LOSS) ** (1 / 3), 2 * (24 / LOSS) ** (1 / 3)), thrown),
    Birth("two manifolds", QUADRANTS, "g", 1.0, 1.2, {"x": 0.5, "y": 0.0}, "first", "x", 1.0, 1.0,
          (2 / BRAKE, 8 / BRAKE), around),
)  # fmt: skip
