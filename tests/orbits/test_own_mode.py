"""An event whose `to` names its own mode: what ignores it rightly goes on, what another mode takes over is refused."""

import math

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import NoOrbit
from casahunt.continuation import follow
from casahunt.hybrid import Event, Mode, System
from casahunt.motion import simulate
from casahunt.orbits import find_cycle


def pull(x, p):
    return (math.cos(p.w * x.t) - x.x) / p.mu


def slips(x, p):
    return {"x": x.v, "v": casadi.cos(p.w * x.t) - x.x - p.sign * p.mu}


def mass(stick, **parameters):
    """Dry friction under a force; without `stick` only slips are known, and each names itself where the other is not.

    stick: whether there is a mode that stays.
    """

    def to(own):
        def after(x, p):
            return "up" if pull(x, p) > 1 else "down" if pull(x, p) < -1 else "stick" if stick else own

        return after

    modes = [
        Mode("up", slips, sign=1, ends=(Event("stops", lambda x, p: x.v, -1, to=to("up")),)),
        Mode("down", slips, sign=-1, ends=(Event("stops", lambda x, p: x.v, +1, to=to("down")),)),
    ]
    if stick:
        ends = tuple(
            Event(f"leaves {mode}", lambda x, p, s=s: s * (casadi.cos(p.w * x.t) - x.x) / p.mu - 1, +1, to=mode)
            for s, mode in ((1, "up"), (-1, "down"))
        )
        modes.append(Mode("stick", lambda x, p: {"x": 0 * x.x, "v": 0 * x.v}, ends=ends))
    known = {"mu": 0.6, "w": 0.35, **parameters}
    return System("mass", ("x", "v"), known, tuple(modes), forcing_period=lambda p: 2 * math.pi / p.w)


def largest(mu, w):
    """The largest |x| of the cycle of the mass that sticks, by an integrator of others, phase by phase."""
    x, t, tops = 0.0, 0.0, []
    while t < 6 * 2 * math.pi / w:
        s = math.copysign(1.0, math.cos(w * t) - x)
        if abs(math.cos(w * t) - x) <= mu * (1 + 1e-12):  # it stays until the force is as large as friction
            grid = np.linspace(t, t + 2 * math.pi / w, 20001)
            over = np.abs(np.cos(w * grid) - x) > mu * (1 + 1e-12)
            low, high = grid[np.argmax(over) - 1], grid[np.argmax(over)]
            for _ in range(60):
                middle = (low + high) / 2
                low, high = (low, middle) if abs(math.cos(w * middle) - x) > mu * (1 + 1e-12) else (middle, high)
            t, s = high, math.copysign(1.0, math.cos(w * high) - x)

        def stops(t, y, s=s, since=t):
            return s * y[1] if t > since + 1e-3 else 1.0

        stops.terminal, stops.direction = True, -1
        found = solve_ivp(
            lambda t, y, s=s: [y[1], math.cos(w * t) - y[0] - s * mu], (t, t + 50), [x, s * 1e-14], events=stops,
            method="DOP853", rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        t, x = found.t[-1], found.y[0, -1]
        tops.append(abs(x))
    return tops[-1]


@pytest.mark.parametrize("mu, w", [(0.6, 0.35), (0.3, 0.5)])
def test_a_mode_that_is_missing_is_named_and_with_it_the_cycle_is_the_true_one(mu, w):
    for ask in (find_cycle, lambda *a, **start: simulate(*a, duration=40.0, **start)):
        with pytest.raises(NoOrbit, match=r"'stops' at speed, and `to` names .* a mode that stays there is missing"):
            ask(mass(False, mu=mu, w=w), "up", x=0.0, v=0.5)
    cycle = find_cycle(mass(True, mu=mu, w=w), "up", x=0.0, v=0.5) if mu == 0.6 else None
    assert cycle is None or abs(cycle.amplitude - largest(mu, w)) < 1e-8


def window(limited, says=None):
    """van der Pol's oscillator, and a spring beyond x = 1 where y < 0.

    limited: the contact ends where y > 0, too; says: the `holds` of the free mode.
    """

    def field(k):
        return lambda x, p: {"x": x.v, "v": 0.3 * (1 - x.x**2) * x.v - x.x - k * (x.x - 1), "y": 0 * x.y}

    wall = Event("wall", lambda x, p: x.x - 1, +1, to=lambda x, p: "contact" if x.y < 0 else "free")
    above = (Event("above", lambda x, p: x.y, +1, to="free"),) if limited else ()
    off = Event("off", lambda x, p: 3 * (x.x - 1), -1, to="free")
    modes = Mode("free", field(0), holds=says, ends=(wall,)), Mode("contact", field(20.0), ends=(off, *above))
    return System("window", ("x", "v", "y"), {"k": 1.0}, modes)


@pytest.mark.parametrize("limited, says", [(True, None), (False, lambda x, p: 1), (True, lambda x, p: 1)])
def test_a_threshold_that_is_to_be_ignored_is(limited, says):
    def passes(t, y):
        return y[0] - 1

    passes.direction = 1
    start = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12, "events": passes}
    found = solve_ivp(lambda t, y: [y[1], 0.3 * (1 - y[0] ** 2) * y[1] - y[0]], (0, 20), [0.5, 1.0], **start)
    motion = simulate(window(limited, says), "free", x=0.5, v=1.0, y=0.5, duration=20.0)
    assert not motion.events
    assert np.allclose([motion.end["x"], motion.end["v"]], found.y[:2, -1], atol=1e-7)


def test_where_only_the_user_knows_whether_it_is_ignored_he_is_asked():
    with pytest.raises(NoOrbit, match="beyond it is 'contact'.*where 'free' goes on, its `holds` says so"):
        simulate(window(False), "free", x=0.5, v=1.0, y=0.5, duration=8.0)
    assert simulate(window(False), "free", x=0.5, v=1.0, y=-0.5, duration=8.0).events


@pytest.mark.parametrize("asks", [lambda x, p: x.y > p.h, lambda x, p: x.y >= p.h])
def test_a_successor_that_rounding_decides_is_refused(asks):
    def towards(u):
        return lambda x, p: {"y": u - x.y}

    hot = Event("hot", lambda x, p: x.y - p.h, +1, to=lambda x, p: "off" if asks(x, p) else "on")
    modes = Mode("on", towards(2.0), ends=(hot,)), Mode("off", towards(0.0), ends=(
        Event("cold", lambda x, p: x.y - 0.8, -1, to="on"),))  # fmt: skip
    answers = []
    for h in np.linspace(1.1, 1.3, 12):
        try:
            cycle = find_cycle(System("heater", ("y",), {"h": float(h)}, modes), "on", y=0.0)
            answers.append(abs(cycle.period - math.log(1.2 / (2 - h)) - math.log(h / 0.8)) < 1e-9)
        except NoOrbit as refusal:
            answers.append("rounding decides" in str(refusal))
    assert all(answers)


@pytest.mark.parametrize("limited, says, ends", [(False, None, 1.0), (True, None, 2.0), (False, lambda x, p: 1, 2.0)])
def test_a_branch_goes_on_through_what_is_ignored_and_through_nothing_else(limited, says, ends):
    """Circles of the radius sqrt(a), with z resting on z = 0.5: from a = 1 on they reach the wall x = 1."""

    def field(k):
        def f(x, p):
            grows = p.a - x.x**2 - x.y**2
            return {"x": grows * x.x - x.y - k * (x.x - 1), "y": grows * x.y + x.x, "z": 0.5 - x.z}

        return f

    wall = Event("wall", lambda x, p: x.x - 1, +1, to=lambda x, p: "contact" if x.z < 0 else "free")
    above = (Event("above", lambda x, p: x.z, +1, to="free"),) if limited else ()
    off = Event("off", lambda x, p: 3 * (x.x - 1), -1, to="free")
    modes = Mode("free", field(0), holds=says, ends=(wall,)), Mode("contact", field(20.0), ends=(off, *above))
    circles = System("circles", ("x", "y", "z"), {"a": 0.5}, modes)
    branch = follow(find_cycle(circles, "free", x=0.7, y=0.0, z=0.5), "a", to=2.0)
    assert abs(branch.values[-1] - ends) < 1e-5
    assert np.allclose(branch.amplitudes, np.sqrt(branch.values), atol=1e-9)
