"""Where motions start, and what they meet at once: against another integrator, and closed forms."""

from __future__ import annotations

from contextlib import suppress
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from casahunt.errors import NoOrbit
from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid.examples import belt
from casahunt.motion import march, simulate
from casahunt.orbits import find_cycle


def refused(system: System, sentence: str, **how) -> None:
    with pytest.raises(NoOrbit, match=sentence):
        simulate(system, **how)


@pytest.mark.parametrize("rounding", [0.0, 1e-17, -1e-17, 1e-12])
def test_a_start_in_front_of_an_event_meets_it(rounding):
    """A ball that is thrown onto the table on which it lies."""
    bounce = Event("impact", lambda x, p: x.x, -1, to="flight", reset=lambda x, p: {"v": -0.5 * x.v})
    table = System("table", ("x", "v"), {}, (Mode("flight", lambda x, p: {"x": x.v, "v": -1.0}, ends=(bounce,)),))
    motion = simulate(table, x=rounding, v=-0.5, duration=0.6)
    assert [crossing.time for crossing in motion.events] == pytest.approx([0.0, 0.5], abs=1e-10)
    assert motion.end["v"] == pytest.approx(0.125 - 0.1, abs=1e-9)


def swings(x, p):
    s = ca.sin(x.th - p.slope)
    return {"th": x.w, "w": s, "ph": x.u, "u": s + ca.sin(x.ph) * (x.w**2 - ca.cos(x.th - p.slope))}


def strike(x, p):
    c = ca.cos(2 * x.th)
    return {"th": -x.th, "w": c * x.w, "ph": -2 * x.th, "u": c * (1 - c) * x.w}


@pytest.mark.parametrize("legs", [("m",), ("left", "right")])
@pytest.mark.parametrize("slope", [0.004, 0.009])
def test_a_walker_begins_its_step_on_the_event_that_ends_it(legs, slope):
    """Garcia, Chatterjee, Ruina and Coleman (1998), every leg in one mode, against DOP853 with its events."""
    ends = [Event(f"strike {leg}", lambda x, p: x.ph - 2 * x.th, +1, to=legs[k - 1], reset=strike)
            for k, leg in enumerate(legs)]  # fmt: skip
    modes = tuple(Mode(leg, swings, ends=(end,)) for leg, end in zip(legs, ends, strict=True))
    system = System("walker", ("th", "w", "ph", "u"), {"slope": slope}, modes)
    start = [value * (slope / 0.009) ** (1 / 3) for value in (0.2003, -0.1998, 0.4006, -0.0158)]
    motion = simulate(system, start=dict(zip(system.states, start, strict=True)), duration=15.0)
    names = SimpleNamespace(slope=slope)

    def at(x):
        return SimpleNamespace(**dict(zip(system.states, x, strict=True)))

    def gap(t, x):
        return x[2] - 2 * x[0]

    def rate(t, x):
        return [float(value) for value in swings(at(x), names).values()]

    gap.direction, x, t = 1, np.array(start), 0.0
    for crossing in motion.events:
        leg = solve_ivp(rate, (t, t + 10), x, method="DOP853", rtol=1e-12, atol=1e-13, events=gap)
        k = next(k for k, found in enumerate(leg.t_events[0]) if found > t + 1e-6)  # the first is the start itself
        t, x = leg.t_events[0][k], np.array([float(v) for v in strike(at(leg.y_events[0][k]), names).values()])
        assert crossing.time == pytest.approx(t, abs=1e-7)
        assert crossing.behind == pytest.approx(x, abs=1e-7)
    assert len(motion.events) >= 3


def corner(*, one: bool = False) -> System:
    """A ball between two walls that meet in a corner; both as one event, as the refusal asks for."""

    def free(x, p):
        return {"x": x.u, "y": x.v, "u": 0, "v": 0}

    def back(state):
        return lambda x, p: {state: -getattr(x, state)}

    if one:
        return System("corner", ("x", "y", "u", "v"), {}, (Mode("free", free, ends=(
            Event("wall", lambda x, p: ca.fmin(x.x, x.y), -1, to="free", reset=lambda x, p: {
                "u": ca.if_else(x.x < 1e-9, -x.u, x.u), "v": ca.if_else(x.y < 1e-9, -x.v, x.v)}),)),))  # fmt: skip
    walls = (Event("left wall", lambda x, p: x.x, -1, to="free", reset=back("u")),
             Event("floor", lambda x, p: x.y, -1, to="free", reset=back("v")))  # fmt: skip
    return System("corner", ("x", "y", "u", "v"), {}, (Mode("free", free, ends=walls),))


def test_two_events_at_once():
    sentence = "meets two events at once, '.*' and '.*', and .* as one event, .* or start where they do not meet"
    start = {"y": 1.0, "u": -1.0, "v": -1.0}
    refused(corner(), sentence, start={"x": 1.0, **start}, duration=3.0)
    back = simulate(corner(one=True), start={"x": 1.0, **start}, duration=3.0)
    assert list(back.end.values()) == pytest.approx([2.0, 2.0, 1.0, 1.0], rel=1e-12)
    assert [crossing.time for crossing in back.events] == pytest.approx([1.0], rel=1e-12)
    motion = simulate(corner(), start={"x": 1.001, **start}, duration=3.0)
    assert [crossing.event for crossing in motion.events] == ["floor", "left wall"]
    assert [crossing.time for crossing in motion.events] == pytest.approx([1.0, 1.001], rel=1e-10)


def waits(x, p):
    return {"b": 0, "clock": 1}


def jump(y):
    return lambda x, p: {"clock": 0, "b": p.l * x.b + p.u - y}


def after(x, p):
    return "hi" if x.b >= 0 else "lo"


MODULATOR = System(
    "first order modulator", ("b", "clock"), {"u": 0.3, "l": 0.95},
    tuple(Mode(name, waits, ends=(Event("tick", lambda x, p: x.clock - 1, +1, to=after, reset=jump(y)),))
          for name, y in (("hi", 1), ("lo", -1))),
)  # fmt: skip


@pytest.mark.parametrize("beside", [0.0, 1e-300, 1e-18, -1e-18, 1e-12, 1e-6])
def test_a_start_beside_zero_is_followed_as_one_at_zero(beside):
    motion = simulate(MODULATOR, "hi", b=0.1, clock=beside, duration=10.5)
    assert [crossing.time for crossing in motion.events] == pytest.approx(np.arange(1, 11) - beside, rel=1e-12)
    slip = simulate(belt, "slip", x=beside, v=beside, duration=15.0)
    at_zero = simulate(belt, "slip", x=0.0, v=0.0, duration=15.0)
    assert len(slip.events) == 3 and slip.end["x"] == pytest.approx(at_zero.end["x"], abs=1e-6 + 10 * abs(beside))


@pytest.mark.parametrize(("system", "mode", "start"), [(MODULATOR, "hi", {"b": 0.1, "clock": 0.0}),
                                                       (belt, "slip", {"x": 0.0, "v": 0.0})])  # fmt: skip
def test_every_state_of_a_sample_can_be_simulated(system, mode, start):
    """In one of the modes: in front of an event, behind it, and between."""
    cycle = find_cycle(system, mode, start=start)
    _, states = cycle.sample()
    for state in states[:, ::3].T:
        begins = dict(zip(system.states, map(float, state), strict=True))
        followed = []
        for each in system.modes:
            with suppress(NoOrbit):
                followed.append(simulate(system, each.name, start=begins, duration=cycle.period).duration)
        assert followed == pytest.approx([cycle.period] * len(followed)) and followed


@pytest.mark.parametrize(("beyond", "told"), [(0.5, "does not hold where it begins"), (1e-9, "does not hold any more")])
def test_a_mode_that_does_not_hold_at_the_start_is_no_motion_for_ever(beyond, told):
    """A stick beyond what static friction holds has its only event behind it."""
    refused(belt, told, mode="stick", x=1.0 + beyond, v=0.2, duration=5.0)
    with pytest.raises(NoOrbit, match=told):
        find_cycle(belt, "stick", x=1.0 + beyond, v=0.2)


@pytest.mark.parametrize("names", [("stop", "stop"), ("up stops", "down stops")])
def test_modes_on_both_sides_of_an_event_may_give_it_one_name(names):
    """Dry friction without a stick: where both sides lead to v = 0 neither goes on, whatever its event is called."""

    def moves(name, end, sign, to):
        field = lambda x, p: {"x": x.v, "v": -x.x - 0.6 * sign + ca.cos(0.35 * x.t)}  # noqa: E731
        return Mode(name, field, ends=(Event(end, lambda x, p: x.v, -int(sign), to=to),))

    modes = moves("up", names[0], 1.0, "down"), moves("down", names[1], -1.0, "up")
    system = System("dry", ("x", "v"), {}, modes, forcing_period=lambda p: 2 * np.pi / 0.35)
    refused(system, "starts on its own event", mode="up", x=0.0, v=0.5, duration=40.0)


def test_a_balance_of_forces_that_is_off_by_rounding_ends_no_slip():
    """v' = u - c, u' = 1 - 2 t, from v = 0 and u = c but for its last digit: v = t^2/2 - t^3/3, up to t = 3/2."""
    c = 0.3
    stops = Event("stops", lambda x, p: x.v, -1, to="stands")
    breaks_away = Event("breaks away", lambda x, p: x.u - p.c, +1, to="slips")
    rates = lambda v: lambda x, p: {"v": v(x, p), "u": 1 - 2 * x.t, "t": 1.0}  # noqa: E731
    system = System("balance", ("v", "u", "t"), {"c": c},
                    (Mode("slips", rates(lambda x, p: x.u - p.c), ends=(stops,)),
                     Mode("stands", rates(lambda x, p: 0.0), ends=(breaks_away,))))  # fmt: skip
    motion = simulate(system, "slips", start={"v": 0.0, "u": float(np.nextafter(c, 0)), "t": 0.0}, duration=2.0)
    assert [crossing.event for crossing in motion.events] == ["stops"]
    assert motion.events[0].time == pytest.approx(1.5, rel=1e-7)


@pytest.mark.parametrize("stiff", [True, False])
@pytest.mark.parametrize("began", [-1e-17, -1e-13, -1e-11, 0.0])
@pytest.mark.parametrize("away", [-1e-9, -1e-8, -1e-7, -1e-5])
def test_a_start_beside_an_event_that_dips_away_meets_it_on_the_way_back(stiff, began, away):
    """By less than an event is known to: x = x_0 + t - (1 - a)(1 - e^-t), with the rate a < 0 at the start.

    Sooner than is looked, too.  Where it leads is asked of the rate, which is below zero until the way back.
    """

    def field(x, p):
        return {"x": x.v, "v": 1.0 - x.v}

    zero = Event("zero", lambda x, p: x.x, +1, to=lambda x, p: "before" if x.v < 0 else "after")
    one = Event("one", lambda x, p: x.x - 1, +1, to="last")
    modes = (
        Mode("before", field, stiff=stiff, ends=(zero,)),
        Mode("after", field, stiff=stiff, ends=(one,)),
        Mode("last", lambda x, p: {"x": 1.0, "v": 0.0}),
    )
    dip = System("dip", ("x", "v"), {}, modes)
    motion = simulate(dip, mode="before", x=began, v=away, duration=2.0)
    assert [crossing.event for crossing in motion.events] == ["zero", "one"]
    assert motion.events[0].time == pytest.approx(-away + (away**2 - 2 * began) ** 0.5, rel=1e-4, abs=1e-6)
    exact = brentq(lambda t: began + t - (1 - away) * -np.expm1(-t) - 1, 1.0, 3.0, xtol=1e-14)
    assert motion.events[1].time == pytest.approx(exact, rel=1e-10)
    without_mesh = march(
        dip.vector_form, "before", np.array([began, away]), np.zeros(0), scale=np.ones(2), tol=1e-9, max_time=2.0,
        until=lambda segment: segment.event == "one", meshed=False,
    )  # fmt: skip
    assert [segment.event for segment in without_mesh] == ["zero", "one"]
    assert sum(segment.duration for segment in without_mesh) == pytest.approx(exact, rel=1e-8)
