"""Leine's block on a belt, a system that is no servo: m x'' + k x = F(v_rel), stick and slip, not symmetric.

    slip   v < belt:  F = Fs / (1 + delta (belt - v)),  until v = belt
    stick  v = belt:  x = x_0 + belt t, exactly,        until k x = Fs

Leine, van Campen, de Kraker and van den Steen, Nonlinear Dynamics 16 (1998), with m = k = Fs = 1, delta = 3.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from casahunt.hybrid.problem import FixedSequence
from casahunt.hybrid.system import Cycle, Event, Exit, Mode, Phase, System

PARAMETERS = ("mass", "stiffness", "static", "decay", "belt")
VALUES = (1.0, 1.0, 1.0, 3.0, 0.2)


def slip_field(x: Any, p: Any, sign: Any) -> Any:
    """The slip, as CasADi expression.

    Parameters
    ----------
    x
        (2,) position and velocity.
    p
        parameters, in the order of `PARAMETERS`.
    sign
        not used: the block never overtakes the belt.

    Returns
    -------
    (2,) x'.
    """
    m, k, static, decay, belt = (p[i] for i in range(5))
    return ca.vertcat(x[1], (static / (1 + decay * (belt - x[1])) - k * x[0]) / m)


def stick_field(x: Any, p: Any, sign: Any) -> Any:
    """The stick, as CasADi expression.

    Parameters
    ----------
    x
        not used.
    p
        parameters, in the order of `PARAMETERS`.
    sign
        not used.

    Returns
    -------
    (2,) x'.
    """
    return ca.vertcat(p[4], 0)


def stick_flow(x: Any, duration: Any, p: Any) -> Any:
    """The stick in closed form.

    Parameters
    ----------
    x
        (2,) position and velocity at its start.
    duration
        its length.
    p
        parameters, in the order of `PARAMETERS`.

    Returns
    -------
    (2,) position and velocity at its end.
    """
    return ca.vertcat(x[0] + p[4] * duration, p[4])


def slower(x: Any, p: Any, sign: float) -> Any:
    """Whether the block is not faster than the belt.

    Parameters
    ----------
    x, p
        (2,) state; parameters.
    sign
        not used.

    Returns
    -------
    At least 0 where that holds; in units of the belt's velocity.
    """
    return (p[4] - x[1]) / p[4]


def held(x: Any, p: Any, sign: float) -> Any:
    """Whether the spring pulls no more than static friction holds.

    Parameters
    ----------
    x, p
        (2,) state; parameters.
    sign
        not used.

    Returns
    -------
    At least 0 where that holds; in units of static friction.
    """
    return 1 - p[1] * x[0] / p[2]


CATCHES_UP = Event("catches up", lambda x, duration, p: (x[1] - p[4]) / p[4])
BREAKS_AWAY = Event("breaks away", lambda x, duration, p: p[1] * x[0] / p[2] - 1)
SLIP = Mode("slip", slip_field, admissible=slower)
STICK = Mode("stick", stick_field, flow=stick_flow, admissible=held)

SYSTEM = System(
    "block on a belt",
    ("x", "v"),
    {"slip": SLIP, "stick": STICK},
    {
        "slip": (Exit(CATCHES_UP, +1, lambda x, p: "stick"),),
        "stick": (Exit(BREAKS_AWAY, +1, lambda x, p: "slip"),),
    },
)
CYCLE = Cycle("block on a belt", SYSTEM.states, PARAMETERS, (Phase(SLIP, CATCHES_UP), Phase(STICK, BREAKS_AWAY)),
              closure=np.eye(2), repeats=1)  # fmt: skip
PROBLEM = FixedSequence(CYCLE, VALUES, followed="belt", scheme=(8, "gauss"))

TRUTH = {
    0.2: (4.2959995254799, -0.54100635386999, 12.00103129483),
    0.35: (4.4029280912054, -0.73451202380549, 9.3586767306496),
    0.5: (4.5165667565407, -0.88308838306866, 8.282743522678),
}
"""Belt speed: duration of the slip, position where it ends, period; scipy's DOP853 with its events, rtol 1e-13."""
