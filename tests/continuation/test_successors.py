"""What an event leads to is what follows, on every cycle; where that changes a branch goes on with the other phases."""

import math

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from casahunt.continuation import GRAZING, follow
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

FRICTION, DAMPING, COUPLING, SLIP = 0.1, 0.2, 1.5, -0.5


def slips(x, p):
    return {
        "a": x.v,
        "v": -x.a - DAMPING * x.v - p.sign * FRICTION - COUPLING * x.q,
        "q": p.V * (x.a - x.q) + SLIP * x.v,
    }


def rests(x, p):
    return {"a": 0 * x.a, "v": 0 * x.v, "q": p.V * (x.a - x.q)}


def pull(x, p):
    return (-x.a - COUPLING * x.q) / FRICTION


def after(x, p):
    return "sticks" if abs(pull(x, p)) <= 1 else ("up" if pull(x, p) > 0 else "down")


def caster():
    """A caster with dry friction and a tyre, whose slips state no condition: only `after` knows that it may stick."""
    up = Event("stops", lambda x, p: x.v, -1, to=after)
    down = Event("stops going down", lambda x, p: x.v, +1, to=after)
    leaves = (
        Event("leaves upwards", lambda x, p: pull(x, p) - 1, +1, to="up"),
        Event("leaves downwards", lambda x, p: pull(x, p) + 1, -1, to="down"),
    )
    modes = (
        Mode("up", slips, sign=1, ends=(up,)),
        Mode("down", slips, sign=-1, ends=(down,)),
        Mode("sticks", rests, ends=leaves),
    )
    return System("caster", ("a", "v", "q"), {"V": 1.0}, modes)


def stops_with_the_pull(guess):
    """(a, q, V) of the half cycle at whose stop the pull is as large as friction, by an integrator of others."""

    def missing(unknown):
        a, q, V = unknown

        def field(t, y):
            return [y[1], -y[0] - DAMPING * y[1] + FRICTION - COUPLING * y[2], V * (y[0] - y[2]) + SLIP * y[1]]

        def stop(t, y):
            return y[1] if t > 0.1 else -1.0

        stop.terminal, stop.direction = True, 1
        end = solve_ivp(field, (0, 50), [a, 0.0, q], events=stop, rtol=1e-12, atol=1e-14, method="DOP853").y[:, -1]
        return [end[0] + a, end[2] + q, abs(end[0] + COUPLING * end[2]) / FRICTION - 1]

    return fsolve(missing, guess, xtol=1e-12)


@pytest.mark.slow
def test_a_stop_that_must_stick_gets_its_stick():
    """The branch of cycles without a stick goes on with one where the pull at the stop falls to friction."""
    cycle = find_cycle(caster(), "down", a=0.13427189, v=0.0, q=0.00961986, settled=True, tol=1e-9)
    branch = follow(cycle, "V", to=0.3)
    assert branch.end.kind == "range"
    (special,) = branch.special
    assert special.kind in ("the successor changes", "grazing")  # the stick that is born there has no duration yet
    _, states = special.orbit.sample()
    truth = stops_with_the_pull([abs(states[0, 0]), abs(states[2, 0]), 0.67])
    assert special.value == pytest.approx(truth[2], abs=1e-7)
    for orbit in branch.orbits:
        assert any(arc.mode == "sticks" for arc in orbit.arcs) == (orbit.problem.value("V") < truth[2] - 1e-6)


# The other mode is not left at once: nothing goes on ----------------------------------------------------------------


@pytest.mark.slow
def test_a_branch_ends_where_the_mode_that_should_follow_lasts():
    """y = exp(-1/r) at the top decides, at 0.3: r = 1/ln(1/0.3). Nothing says so but the successor."""

    def rising(x, p):
        return {"x": p.r, "y": -x.y}

    def falling(x, p):
        return {"x": -p.r * p.sign, "y": 0 * x.y}

    top = Event("top", lambda x, p: x.x - 1, +1, to=lambda x, p: "falls" if x.y > 0.3 else "plunges")
    bottom = Event("bottom", lambda x, p: x.x, -1, to="rises", reset=lambda x, p: {"y": 1.0})
    modes = (
        Mode("rises", rising, ends=(top,)),
        *(Mode(n, falling, sign=s, ends=(bottom,)) for n, s in (("falls", 1), ("plunges", 5))),
    )
    system = System("pump", ("x", "y"), {"r": 1.0}, modes)
    branch = follow(find_cycle(system, "rises", x=0.0, y=1.0, tol=1e-9), "r", to=0.5)
    (special,) = branch.special
    assert branch.end.kind == special.kind == "the successor changes"
    assert special.value == pytest.approx(1 / math.log(1 / 0.3), rel=1e-9)
    assert "'top' leads to 'plunges' beyond" in special.meaning and "not found" not in branch.ended
    assert all(orbit.problem.value("r") >= special.value - 1e-9 for orbit in branch.orbits)


@pytest.mark.parametrize("u", [0.137, 0.3, -0.41])
def test_a_modulator_has_the_modes_of_its_own_signs(u):
    """x' = -x/5 + u - sign of x at the last tick of a clock: the periodic signs are those of the exact map.

    The successor is asked after the jump, where the clock stands at zero.
    """

    def held(x, p):
        return {"x": -x.x / 5 + p.u - p.sign, "c": 1.0}

    tick = Event(
        "tick",
        lambda x, p: x.c - 1,
        +1,
        to=lambda x, p: "plus" if x.x > 0 and x.c < 0.5 else "minus",
        reset=lambda x, p: {"c": 0.0},
    )
    modes = tuple(Mode(name, held, sign=s, ends=(tick,)) for name, s in (("plus", 1), ("minus", -1)))
    cycle = find_cycle(System("modulator", ("x", "c"), {"u": u}, modes), "plus", x=0.1, c=0.0, tol=1e-9)
    x, signs = float(cycle.arcs[0].states[0, 0, 0]), []
    for _ in cycle.arcs:
        signs.append(1 if x > 0 else -1)
        x = x * math.exp(-0.2) + (u - signs[-1]) * 5 * (1 - math.exp(-0.2))
    assert [1 if arc.mode == "plus" else -1 for arc in cycle.arcs] == signs
    assert x == pytest.approx(float(cycle.arcs[0].states[0, 0, 0]), abs=1e-9) or np.isclose(cycle.repeats, 2)


# A half cycle: what follows its last phase is the image of the first -------------------------------------------------


def coulomb():
    """x'' + x = cos(0.8 t) with dry friction mu, which sticks where the pull at a stop is less."""

    def pull(x, p):
        return casadi.cos(0.8 * x.t) - x.x

    def after(x, p):
        return "sticks" if abs(float(pull(x, p))) <= p.mu else ("up" if pull(x, p) > 0 else "down")

    def slides(x, p):
        return {"x": x.v, "v": pull(x, p) - p.sign * p.mu}

    leaves = (
        Event("leaves upwards", lambda x, p: pull(x, p) - p.mu, +1, to="up"),
        Event("leaves downwards", lambda x, p: pull(x, p) + p.mu, -1, to="down"),
    )
    modes = (
        Mode("up", slides, sign=1, ends=(Event("stops", lambda x, p: x.v, -1, to=after),)),
        Mode("down", slides, sign=-1, ends=(Event("stops going down", lambda x, p: x.v, +1, to=after),)),
        Mode("sticks", lambda x, p: {"x": 0 * x.x, "v": 0 * x.v}, ends=leaves),
    )
    return System("mass", ("x", "v"), {"mu": 0.85}, modes, forcing_period=lambda p: 2 * math.pi / 0.8)


@pytest.mark.slow
def test_a_rest_does_not_go_on_through_the_events_that_end_it():
    """At x = 0 the force cos(0.8 t) is held where friction is above 1; below, no stick lasts half a turn."""
    branch = follow(find_cycle(coulomb(), "down", x=1.27, v=0.0, t=0.5, tol=1e-9), "mu", to=1.06, monitors=(GRAZING,))
    rest = branch.orbits[-1]
    assert branch.end.kind == "range" and [arc.mode for arc in rest.arcs] == ["sticks"]
    back = follow(rest, "mu", to=0.3, monitors=(GRAZING,))
    sticks = [orbit for orbit in back.orbits if all(arc.mode == "sticks" for arc in orbit.arcs)]
    assert min(orbit.problem.value("mu") for orbit in sticks) == pytest.approx(1.0, abs=1e-9)
    assert back.special[0].value == pytest.approx(1.0, abs=1e-9)
