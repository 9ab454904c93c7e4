"""Branches that end as few do, and some that seem to: each end in closed form.

friction      x'' = -x + d x' - sign(x'), d -> 0: half a cycle takes the top x to q (x - 1) - 1, q = exp(pi d/(2 w)), so
              that it is (q + 1)/(q - 1), and grows without bound as 4/(pi d)
relay         u = -+1 on 1/(s + 1)^3 with hysteresis eps: half the period, h, solves F(h) = eps,
              F = tanh(h/2) - (h/2 + h^2/4 tanh(h/2))/cosh(h/2)^2: a fold at its minimum, a point at eps = F(0) = 0
level         x' = 1 - x up to a level, -1 - x down to -1/2: the time up is log(3/2/(1 - level)), there is no level of 1
thermostat    x' = 1 - x up to 2/5 + h, -x down to 2/5 - h: a point at h = 0
rest          a forced cycle of amplitude F, F through 0: no end, that of -F is that of F half a period later
load          x'' + x'/5 + x + x^3 = cos(3/2 t) + load: symmetric at load = 0 alone, half a cycle is not enough
reset         y'' = y'/5 + k u - y'^3, u' = -y, u = 0 where y = 0, k -> 0: y and T grow as k^(-1/2)
Bouc-Wen      x'' = cos(w t) - x'/10 - x/5 - 4/5 z, z' = x' - |x'| z/2 - 3/10 x' |z|: no end, nothing on the way

Sources: Ya. Z. Tsypkin, Relay Control Systems, Cambridge 1984; J. C. Clegg, Transactions of the AIEE 77 II (1958)
41-42; Y. K. Wen, Journal of the Engineering Mechanics Division 102 (1976) 249-263.  The others are made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

Values = Callable[[Any, Any], dict[str, Any]]


def _dragged(x: Any, p: Any) -> dict[str, Any]:
    return {"x": x.v, "v": -x.x + p.d * x.v - p.sign}


FRICTION = System(
    "negative damping and dry friction",
    states=("x", "v"),
    parameters={"d": 0.1},
    modes=(
        Mode("forth", field=_dragged, sign=+1, ends=(Event("stops", lambda x, p: x.v, -1, to="back"),)),
        Mode("back", field=_dragged, sign=-1, ends=(Event("starts", lambda x, p: x.v, +1, to="forth"),)),
    ),
)


def _lagged(x: Any, p: Any) -> dict[str, Any]:
    return {"y": x.b - x.y, "b": x.a - x.b, "a": p.sign - x.a}


RELAY = System(
    "a relay and three lags",
    states=("y", "a", "b"),
    parameters={"eps": 0.1},
    modes=(
        Mode("down", field=_lagged, sign=-1, ends=(Event("falls", lambda x, p: x.y + p.eps, -1, to="up"),)),
        Mode("up", field=_lagged, sign=+1, ends=(Event("rises", lambda x, p: x.y - p.eps, +1, to="down"),)),
    ),
)
RELAY_FOLD = -0.02852630715593
"""The minimum of F, at h = 1.3169579."""


def _towards(goal: float) -> Values:
    return lambda x, p: {"x": goal - x.x}


LEVEL = System(
    "a level that comes up to an equilibrium",
    states=("x",),
    parameters={"level": 0.4},
    modes=(
        Mode("up", field=_towards(1.0), ends=(Event("full", lambda x, p: x.x - p.level, +1, to="down"),)),
        Mode("down", field=_towards(-1.0), ends=(Event("empty", lambda x, p: x.x + 0.5, -1, to="up"),)),
    ),
)
THERMOSTAT = System(
    "a thermostat",
    states=("x",),
    parameters={"h": 0.2, "goal": 0.4},
    modes=(
        Mode("heats", field=_towards(1.0), ends=(Event("warm", lambda x, p: x.x - p.goal - p.h, +1, to="cools"),)),
        Mode("cools", field=_towards(0.0), ends=(Event("cold", lambda x, p: x.x - p.goal + p.h, -1, to="heats"),)),
    ),
)


def _forced(x: Any, p: Any) -> dict[str, Any]:
    return {"x": x.v, "v": p.F * ca.cos(p.w * x.t) + p.load - 0.2 * x.v - x.x - x.x**3}


FORCED = System(
    "a forced oscillator with a load",
    states=("x", "v"),
    parameters={"F": 1.0, "w": 1.5, "load": 0.0},
    modes=(Mode("smooth", field=_forced),),
    forcing_period=lambda p: 2 * math.pi / p.w,
)
RESET = System(
    "two integrators and one that is reset",
    states=("y", "v", "u"),
    parameters={"k": 3.0},
    modes=(
        Mode("runs", field=lambda x, p: {"y": x.v, "v": 0.2 * x.v + p.k * x.u - x.v**3, "u": -x.y},
             ends=(Event("passes zero", lambda x, p: x.y, 0, to="runs", reset=lambda x, p: {"u": 0.0}),)),
    ),
)  # fmt: skip


def _hysteretic(x: Any, p: Any) -> dict[str, Any]:
    return {
        "x": x.v,
        "v": ca.cos(p.w * x.t) - 0.1 * x.v - 0.2 * x.x - 0.8 * x.z,
        "z": x.v - 0.5 * ca.fabs(x.v) * x.z - 0.3 * x.v * ca.fabs(x.z),
    }


BOUC_WEN = System(
    "a forced hysteretic oscillator",
    states=("x", "v", "z"),
    parameters={"w": 1.0},
    modes=(Mode("smooth", field=_hysteretic, smooth=False),),
    forcing_period=lambda p: 2 * math.pi / p.w,
)


def dragged(d: float = 0.1) -> SystemOrbit:
    """The unstable cycle with friction, from its closed form."""
    q = math.exp(math.pi * d / 2 / math.sqrt(1 - d * d / 4))
    return find_cycle(FRICTION, "back", parameters={"d": d}, settled=True, x=(q + 1) / (q - 1), v=0.0)


def branches() -> Iterator[Course]:
    """All of them."""
    yield Course("friction, past its end", dragged, "d", -0.1, (), ("grows without bound",))
    yield Course("friction, to its end", dragged, "d", 0.0, (), ("grows without bound",))
    relay = partial(find_cycle, RELAY, "down", y=0.5, a=0.1, b=0.1)
    yield Course("relay", relay, "eps", -0.1, (("fold", RELAY_FOLD),), ("shrinks to a point",), {"back": 0.2})
    yield Course("level", partial(find_cycle, LEVEL, "up", x=0.0), "level", 2.0, (), ("level reached",))
    heats = partial(find_cycle, THERMOSTAT, "heats", x=0.4)
    yield Course("thermostat", heats, "h", -0.2, (), ("shrinks to a point",))
    weak = partial(find_cycle, FORCED, parameters={"F": 0.2}, x=0.0, v=0.0)
    yield Course("rest", weak, "F", -0.2, ())
    yield Course("load", partial(find_cycle, FORCED, x=0.0, v=0.0), "load", 0.5, ())
    yield Course("reset", partial(find_cycle, RESET, y=0.5, v=0.5, u=0.0), "k", -1.0, (), ("grows without bound",))
    yield Course("Bouc-Wen", partial(find_cycle, BOUC_WEN, x=0.0, v=0.0, z=0.0), "w", 0.4, ())
