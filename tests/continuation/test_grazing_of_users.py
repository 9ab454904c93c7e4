"""Grazings of users' systems, against the equations of the grazing cycle, solved by themselves."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

from casahunt.continuation import follow
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle


def opens(x, p):
    return {"y": x.v, "v": -p.k * x.v - (x.y + p.d) + x.q, "q": p.b * (p.flow - x.y * casadi.sqrt(x.q))}


SEAT = Event("seat", lambda x, p: x.y, -1, to="open", reset=lambda x, p: {"v": -p.r * x.v})
VALVE = System(
    "pressure relief valve", ("y", "v", "q"), {"k": 1.25, "d": 10.0, "b": 20.0, "flow": 8.0, "r": 0.8},
    (Mode("open", opens, ends=(SEAT,)),),
)  # fmt: skip
"""Hos and Champneys, Physica D 241 (2012): its valve begins to beat on the seat as the flow falls."""


def off_the_seat(z):
    """(3,) how far the motion from rest on the seat is from it again, after a time T; z: pressure, T, flow."""
    q, T, flow = z
    p = {**VALVE.parameters, "flow": flow}

    def rate(_, x):
        return [x[1], -p["k"] * x[1] - (x[0] + p["d"]) + x[2], p["b"] * (flow - x[0] * np.sqrt(x[2]))]

    return solve_ivp(rate, (0, T), [0, 0, q], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1] - [0, 0, q]


def test_a_cycle_that_meets_no_event_grazes_one():
    """It is cut by a plane until it touches the seat, and goes on with the cycle that beats."""
    branch = follow(find_cycle(VALVE, y=1.0, v=0.0, q=11.5), "flow", to=7.4)
    _, T, flow = fsolve(off_the_seat, [40.0, 2.656, 7.56], xtol=1e-13)
    special = branch.special[0]
    assert special.kind == "grazing" and "goes on" in special.meaning and branch.end.kind == "range"
    np.testing.assert_allclose([special.value, special.orbit.period], [flow, T], rtol=1e-7)


def stands(pushed):
    return lambda x, p: {"y": x.v, "v": -p.g - p.k * (x.y - 1 - (p.push if pushed else 0)) - p.c * x.v}


HOPPER = System(
    "vertical hopper", ("y", "v"), {"g": 9.81, "k": 400.0, "c": 3.0, "push": 0.03},
    (
        Mode("flight", flow=lambda x, t, p: {"y": x.y + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t},
             ends=(Event("touch down", lambda x, p: x.y - 1, -1, to="compression"),)),
        Mode("compression", stands(False), ends=(Event("bottom", lambda x, p: x.v, +1, to="thrust"),)),
        Mode("thrust", stands(True),
             ends=(Event("lift off", lambda x, p: (p.k * (x.y - 1 - p.push) + p.c * x.v) / p.g, +1, to="flight"),)),
    ),
)  # fmt: skip
"""Its spring is made longer at the bottom: by too little and it does not leave the ground."""


def short_of_lift_off(push, k=400.0):
    """The largest force of the foot's spring in the thrust behind a flight that began with no speed of that force."""
    g, _, c, _ = HOPPER.parameters.values()
    v = c * g / k
    touches = -np.sqrt(v**2 + 2 * g * (push - c * v / k))

    def stance(y, v, t, rest):
        return expm(np.array([[0, 1], [-k, -c]]) * t) @ [y - rest, v]

    lowest, longer = -g / k, (400 / k) ** 0.5
    t = brentq(lambda t: stance(1, touches, t, 1 + lowest)[1], 0.03 * longer, 0.2 * longer, xtol=1e-15)
    bottom = stance(1, touches, t, 1 + lowest)[0] + lowest
    force = np.array([k, c])
    rate = force @ [[0, 1], [-k, -c]]
    top = brentq(lambda t: rate @ stance(bottom, 0, t, push + lowest), 0.05 * longer, 0.16 * longer, xtol=1e-15)
    return force @ stance(bottom, 0, top, push + lowest) + k * lowest


@pytest.mark.parametrize(("vary", "to", "between"), [("push", 0.0, (0.005, 0.01)), ("k", 50.0, (140.0, 160.0))])
def test_an_event_that_is_met_with_no_speed_is_no_fold(vary, to, between):
    """The equations turn round where the foot no longer leaves the ground; all multipliers stay inside."""
    branch = follow(find_cycle(HOPPER, y=1.3, v=0.0), vary, to=to)
    value = brentq(lambda x: short_of_lift_off(**{"push": 0.03, vary: x}), *between, xtol=1e-14)
    assert branch.end.kind == "grazing" and [special.kind for special in branch.special] == ["grazing"]
    assert abs(branch.end.value - value) <= branch.end.error < 1e-4 * value and not branch.missed
    assert branch.stable.all()
