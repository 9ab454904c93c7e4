"""Motions of users' systems against closed forms; the error estimate; what cannot be followed is refused."""

from __future__ import annotations

import math
import re

import casadi as ca
import numpy as np
import pytest

from casahunt.errors import NoOrbit, Status
from casahunt.hybrid import Event, Mode, System
from casahunt.motion.simulation import Motion, simulate
from problems import belt

# Systems --------------------------------------------------------------------------------------------------------------

OSCILLATOR = System(
    "oscillator", ("x", "v"), {"omega": 2.0}, (Mode("free", lambda x, p: {"x": x.v, "v": -(p.omega**2) * x.x}),)
)
RELAY = System(
    "relay", ("x",), {"rate": 1.0},
    (Mode("up", flow=lambda x, t, p: {"x": 2 + (x.x - 2) * ca.exp(-p.rate * t)},
          ends=(Event("high", lambda x, p: x.x - 1, +1, to="down"),)),
     Mode("down", flow=lambda x, t, p: {"x": -2 + (x.x + 2) * ca.exp(-p.rate * t)},
          ends=(Event("low", lambda x, p: x.x + 1, -1, to="up"),))),
)  # fmt: skip
"""x' = 2 - x up to 1, x' = -2 - x down to -1: each takes log 3."""
FORCED = System(
    "forced oscillator", ("x", "v"), {"omega": 3.0},
    (Mode("free", lambda x, p: {"x": x.v, "v": ca.cos(p.omega * x.t) - x.x}),),
    forcing_period=lambda p: 2 * math.pi / p.omega,
)  # fmt: skip

G, R = 9.81, 0.8


def ball(how: str) -> System:
    """It falls on a table; its flight in closed form or by its field."""
    flight = {
        "flow": {"flow": lambda x, t, p: {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t}},
        "field": {"field": lambda x, p: {"x": x.v, "v": -p.g}},
    }[how]
    bounces = Event("bounces", lambda x, p: x.x, -1, to="flight", reset=lambda x, p: {"v": -p.r * x.v})
    return System(
        "ball", ("x", "v"), {"g": G, "r": R}, (Mode("flight", holds=lambda x, p: x.x, ends=(bounces,), **flight),)
    )


def times(motion: Motion) -> np.ndarray:
    return np.array([crossing.time for crossing in motion.events])


def impacts(count: int, height: float = 1.0) -> np.ndarray:
    """Times of the first impacts from a height."""
    falls = math.sqrt(2 * height / G)
    return falls + np.concatenate([[0.0], np.cumsum(2 * falls * R ** np.arange(1, count))])


# Truth ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["flow", "field"])
def test_a_bouncing_ball(how):
    motion = simulate(ball(how), x=1.0, v=0.0, duration=4.0)
    assert len(motion.events) == 19
    np.testing.assert_allclose(times(motion), impacts(19), rtol=0, atol=1e-10)
    speeds = math.sqrt(2 * G) * R ** np.arange(19)
    np.testing.assert_allclose([c.before[1] for c in motion.events], -speeds, rtol=1e-10)
    np.testing.assert_allclose([c.behind[1] for c in motion.events], R * speeds, rtol=1e-10)
    assert motion.error < 1e-9 and motion.duration == pytest.approx(4.0, rel=1e-14)
    left = 4.0 - impacts(19)[-1]
    assert motion.end["x"] == pytest.approx(R * speeds[-1] * left - G * left**2 / 2, abs=1e-10)
    assert {c.event for c in motion.events} == {"bounces"} and {c.mode for c in motion.events} == {"flight"}


@pytest.mark.parametrize("tol", [1e-2, 1e-4, 1e-6, 1e-8])
def test_an_oscillator_and_its_error(tol):
    """The estimate bounds the error, at every tolerance."""
    motion = simulate(OSCILLATOR, x=1.0, v=0.0, duration=10.0, tol=tol)
    off = max(abs(motion.end["x"] - math.cos(20)), abs(motion.end["v"] + 2 * math.sin(20)) / 2)
    assert off <= motion.error + 1e-14
    assert motion.error < tol


@pytest.mark.parametrize("tol", [1e-3, 1e-5, 1e-7])
def test_the_error_of_times_of_events(tol):
    motion = simulate(belt.BELT, "slip", x=1.0, v=belt.VALUES[-1], duration=30.0, tol=tol)
    (slip, stop), period = belt.SLIPS[0.2], belt.TRUTH[0.2].period
    expected = np.sort(np.concatenate([slip + period * np.arange(3), period * np.arange(1, 3)]))
    found = times(motion)
    assert [c.event for c in motion.events] == ["catches up", "breaks away"] * 2 + ["catches up"]
    assert np.max(np.abs(found - expected)) <= 30.0 * motion.error + 1e-11
    assert motion.error < 1e2 * tol
    assert motion.events[0].before[0] == pytest.approx(stop, abs=motion.error + 1e-11)


def test_stick_slip():
    motion = simulate(belt.BELT, "slip", x=1.0, v=belt.VALUES[-1], duration=25.0)
    (slip, stop), period = belt.SLIPS[0.2], belt.TRUTH[0.2].period
    np.testing.assert_allclose(times(motion)[:4], [slip, period, period + slip, 2 * period], rtol=1e-11)
    assert motion.events[2].before[0] == pytest.approx(stop, rel=1e-10)
    t, x = motion.sample()
    sticking = (t > slip) & (t < period)
    assert sticking.sum() > 4
    np.testing.assert_allclose(x[0, sticking], stop + 0.2 * (t[sticking] - slip), rtol=0, atol=1e-10)


def test_a_closed_form_that_is_nonlinear_in_time_is_no_rest():
    motion = simulate(RELAY, "up", x=-1.0, duration=10.0)
    np.testing.assert_allclose(times(motion), math.log(3) * np.arange(1, 10), rtol=1e-12)
    left = 10 - 9 * math.log(3)
    assert motion.end["x"] == pytest.approx(-2 + 3 * math.exp(-left), rel=1e-12)


def test_a_duration_that_ends_inside_a_closed_form():
    motion = simulate(belt.BELT, "stick", x=-0.5, v=0.2, duration=3.0)
    assert motion.duration == 3.0 and not motion.events
    assert motion.end == pytest.approx({"x": 0.1, "v": 0.2}, rel=1e-14)
    t, x = motion.sample()
    assert t[-1] == 3.0 and x[0, -1] == pytest.approx(0.1, rel=1e-14)
    motion = simulate(RELAY, "up", x=-1.0, duration=0.5)
    assert motion.end["x"] == pytest.approx(2 - 3 * math.exp(-0.5), rel=1e-13)


def test_rest_for_ever_lasts_as_long_as_asked_for():
    both = Mode("rest", lambda x, p: {"x": 0}), Mode("flow", flow=lambda x, t, p: {"x": x.x})
    rest = System("rest", ("x",), {}, both)
    for mode in ("rest", "flow"):
        motion = simulate(rest, mode, x=2.0, duration=7.0)
        assert motion.duration == pytest.approx(7.0, rel=1e-14) and motion.end == {"x": 2.0} and not motion.events


def test_a_forced_system_that_starts_at_any_time():
    """x = cos(3 t) / (1 - 9)."""

    def exact(t: float) -> dict[str, float]:
        return {"x": -math.cos(3 * t) / 8, "v": 3 * math.sin(3 * t) / 8, "t": t}

    for begin in (0.0, 0.7, -20.0):
        motion = simulate(FORCED, duration=5.0, start=exact(begin))
        assert motion.end == pytest.approx(exact(begin + 5.0), abs=1e-12)


def test_a_stiff_mode():
    """x' = y, y' = -k (x + y) - y: one direction decays 1e6 times as fast as the other."""
    field = {"field": lambda x, p: {"x": x.y, "y": -p.k * (x.y + x.x) - x.y}, "stiff": True}
    stiff = System("stiff", ("x", "y"), {"k": 1e6}, (Mode("fast", **field),))
    motion = simulate(stiff, x=1.0, y=0.0, duration=3.0)
    b = 1e6 + 1
    fast = (-b - math.sqrt(b * b - 4e6)) / 2
    slow = 1e6 / fast  # product of the roots
    truth = (slow * math.exp(fast * 3) - fast * math.exp(slow * 3)) / (slow - fast)
    assert motion.end["x"] == pytest.approx(truth, rel=1e-9)
    assert motion.kind == "radau" and len(motion.phases[0].w) < 200


def test_where_a_motion_goes_may_depend_on_the_numbers():
    """Past 1 upwards: fast ones go on, slow ones come back."""
    ahead = Event("passes", lambda x, p: x.x - 1, +1, to=lambda x, p: "on" if x.v > p.enough else "back")
    gate = System(
        "gate", ("x", "v"), {"enough": 1.0},
        (Mode("to", lambda x, p: {"x": x.v, "v": 0}, ends=(ahead,)),
         Mode("on", lambda x, p: {"x": x.v, "v": 0}), Mode("back", lambda x, p: {"x": -x.v, "v": 0})),
    )  # fmt: skip
    assert simulate(gate, x=0.0, v=2.0, duration=1.0).end["x"] == pytest.approx(2.0, rel=1e-12)
    assert simulate(gate, x=0.0, v=0.8, duration=2.0).end["x"] == pytest.approx(1 - 0.8 * 0.75, rel=1e-12)
    late = {"parameters": {"enough": 5.0}, "duration": 1.0}
    assert simulate(gate, x=0.0, v=2.0, **late).end["x"] == pytest.approx(0.0, abs=1e-12)


# Refusals -------------------------------------------------------------------------------------------------------------


def refused(system: System, sentence: str, **how) -> None:
    with pytest.raises(NoOrbit, match=f"^the motion of {system.name} cannot be followed: {sentence}") as refusal:
        simulate(system, **how)
    assert refusal.value.status is Status.NOT_CONVERGED and "\n" not in str(refusal.value)


@pytest.mark.parametrize("how", ["flow", "field"])
def test_a_ball_on_the_table_and_one_that_comes_to_rest_there(how):
    """Bounces without end in a finite time: never a ball below the table."""
    refused(ball(how), "at .* the mode 'flight' does not hold any more", x=0.0, v=0.0, duration=1.0)
    end = impacts(400)[-1]
    with pytest.raises(NoOrbit, match="events follow each other ever faster"):
        simulate(ball(how), x=1.0, v=0.0, duration=1.2 * end)


def test_a_motion_that_runs_away():
    away = System("runaway", ("x",), {}, (Mode("free", lambda x, p: {"x": x.x**2}),))
    refused(away, ".*(vanished|no exit)", x=1.0, duration=2.0)
    assert simulate(away, x=1.0, duration=0.9).end["x"] == pytest.approx(10.0, rel=1e-8)


def test_a_closed_form_that_is_no_flow():
    """t^2 from any start: its rate at the start is zero, and the motion would be taken for rest."""
    up = Mode("up", flow=lambda x, t, p: {"x": x.x + t**2}, ends=(Event("high", lambda x, p: x.x - 1, +1, to="up"),))
    no_flow = System("no flow", ("x",), {}, (up,))
    refused(no_flow, "mode 'up': after .* closed form .* off the motion", x=0.0, duration=3.0)


def test_a_field_beside_its_closed_form():
    both = Mode("up", lambda x, p: {"x": x.x}, lambda x, t, p: {"x": x.x * ca.exp(2 * t)},
                ends=(Event("high", lambda x, p: x.x - 50, +1, to="up"),))  # fmt: skip
    refused(System("two", ("x",), {}, (both,)), re.escape("mode 'up': after 2 its closed form"), x=1.0, duration=2.0)


def test_a_missing_exit():
    """The condition says that the motion ends, and no event does."""
    free = Mode("free", lambda x, p: {"x": 1}, holds=lambda x, p: 1 - x.x)
    ramp = System("ramp", ("x",), {}, (free,))
    refused(ramp, "at .* 'free' does not hold any more .* an exit is missing", x=0.0, duration=3.0)
