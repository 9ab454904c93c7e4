"""Motions of users' systems against closed forms; the error estimate; what cannot be followed is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casahunt.errors import InputError, NoOrbit, Status
from casahunt.hybrid import Event, Mode, System
from casahunt.motion import simulation
from casahunt.motion.segment import Segment
from casahunt.motion.simulation import Motion, simulate
from casahunt.orbits import find_cycle
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


GROWING = System(
    "logistic growth", ("x",), {"low": 1e-2},
    (Mode("grows", lambda x, p: {"x": x.x * (1 - x.x)},
          ends=(Event("half", lambda x, p: x.x - 0.5, +1, to="grows", reset=lambda x, p: {"x": p.low}),)),),
)  # fmt: skip
"""1/x - 1 falls as exp(-t): from `low` to 1/2 in log(1/low - 1), and again."""


@pytest.mark.parametrize("tol", [1e-2, 1e-4, 1e-6])
def test_the_error_of_what_is_not_linear(tol):
    """No closed form solves it, as one does a linear field: states, and times of events, are off by what is said."""
    motion = simulate(GROWING, x=1e-2, duration=4.0, tol=tol)
    assert not motion.events
    off = abs(motion.end["x"] - 1 / (1 + 99 * math.exp(-4)))
    assert off <= motion.error * motion.end["x"] + 1e-15 and 1e-13 < motion.error < tol
    motion = simulate(GROWING, x=1e-2, duration=20.0, tol=tol)
    off = np.max(np.abs(times(motion) - math.log(99) * np.arange(1, 5)))
    assert off <= 20.0 * motion.error + 1e-14 and 1e-13 < motion.error < tol


def test_what_two_motions_differ_by():
    """The times of events relative to the duration, or the states relative to their sizes, at any of the phases."""

    def phase(duration, *end, event="stops"):
        return Segment("slip", event, duration, np.array([0.0, 1.0]), np.zeros((1, 2)), np.array(end))

    size, fine = np.array([1.0, 100.0]), [phase(1.0, 1.0, 50.0), phase(3.0, 0.5, 90.0)]
    for other, error in (
        (fine, 0.0),
        ([phase(1.0, 1.0, 50.0), phase(3.0, 0.25, 90.0)], 0.25),
        ([phase(1.0, 1.0, 75.0), phase(3.0, 0.5, 90.0)], 0.25),
        ([phase(1.5, 1.0, 50.0), phase(2.5, 0.5, 90.0)], 0.125),  # the first event is late, the second is not
        ([phase(1.0, 1.0, 50.0), phase(3.0, 0.5, 90.0, event="rests")], math.inf),
        ([phase(1.0, 1.0, 50.0)], math.inf),
    ):
        assert simulation._difference(other, fine, size, 1e-8) == error


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
        assert motion.scale[2] == 1.0  # the time, in turns, has no size
        np.testing.assert_allclose(motion.scale[:2], [1 / 8, 3 / 8], rtol=1e-2)


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
    with pytest.raises(NoOrbit, match=f"^the motion of {system.name} cannot be followed[^:]*: {sentence}") as refusal:
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
    grows = System("growth", ("x", "y"), {}, (Mode("free", lambda x, p: {"x": -x.x, "y": 2 * x.y + 0.3}),))
    with pytest.raises(NoOrbit, match="'y' has come to .* as where it grows without bound. Else try") as refusal:
        simulate(grows, x=1.0, y=0.95, duration=1000.0)
    assert "stiff" not in str(refusal.value)
    assert simulate(away, x=1.0, duration=0.9).end["x"] == pytest.approx(10.0, rel=1e-8)


def high(level: float) -> tuple[Event, ...]:
    return (Event("high", lambda x, p: x.x - level, +1, to="up"),)


def test_a_closed_form_that_is_no_flow():
    """t^2 from any start: its rate at the start is zero, and the motion would be taken for rest."""
    no_flow = System("no flow", ("x",), {}, (Mode("up", flow=lambda x, t, p: {"x": x.x + t**2}, ends=high(1)),))
    with pytest.raises(InputError, match="^mode 'up': its flow contradicts its own rate from there on"):
        simulate(no_flow, x=0.0, duration=3.0)
    late = Mode("up", flow=lambda x, t, p: {"x": x.x + t + ca.fmax(t - 1, 0) ** 2}, ends=high(100))
    sentence = "mode 'up': after 3 its closed form is .* off the motion along its field"
    refused(System("late", ("x",), {}, (late,)), sentence, x=0.0, duration=3.0)
    jump = Mode("up", flow=lambda x, t, p: {"x": x.x + 1 + t}, ends=high(100))
    with pytest.raises(InputError, match="^mode 'up': its flow is not where it starts after no time"):
        find_cycle(System("jump", ("x",), {}, (jump,)), x=0.0)


def test_a_field_beside_its_closed_form():
    """exp(2 t) beside x' = x; the right one beside it; one that is right at the start alone."""
    for flow, right in (
        (lambda x, t, p: {"x": x.x * ca.exp(2 * t)}, False),
        (lambda x, t, p: {"x": x.x * ca.exp(t)}, True),
        (lambda x, t, p: {"x": x.x * (1 + t)}, False),
    ):
        two = System("two", ("x",), {}, (Mode("up", lambda x, p: {"x": x.x}, flow, ends=high(50)),))
        if right:
            assert simulate(two, x=1.0, duration=2.0).end["x"] == pytest.approx(math.exp(2), rel=1e-12)
            continue
        with pytest.raises(InputError, match="^mode 'up': its flow contradicts its field"):
            simulate(two, x=1.0, duration=2.0)


def test_a_closed_form_is_tried_where_it_is_a_number_and_the_mode_holds():
    """sqrt of a negative start is none; a block that sticks has the speed of its belt, whatever it had before."""
    root = lambda x, t, p: {"x": (ca.sqrt(x.x) + t) ** 2}  # noqa: E731
    up = Mode("up", lambda x, p: {"x": 2 * ca.sqrt(x.x)}, root, ends=high(100))
    assert simulate(System("root", ("x",), {}, (up,)), x=0.01, duration=1.0).end["x"] == pytest.approx(1.21, rel=1e-12)
    stuck = Mode("up", flow=lambda x, t, p: {"x": x.x + 0.2 * t, "v": 0.2}, ends=high(1))
    assert simulate(System("stuck", ("x", "v"), {}, (stuck,)), x=0.0, v=3.0, duration=1.0).end["v"] == 0.2
    for start in (0.0, 0.98):  # beside the second one, and a little later, the mode does not hold any more
        wall = Mode("up", lambda x, p: {"x": 1 + ca.fmax(x.x - 1, 0)}, lambda x, t, p: {"x": x.x + t},
                    holds=lambda x, p: 1 - x.x, ends=high(1))  # fmt: skip
        motion = simulate(System("wall", ("x",), {}, (wall,)), x=start, duration=0.01)
        assert motion.end["x"] == pytest.approx(start + 0.01)
        free = replace(wall, holds=None)
        if start:
            with pytest.raises(InputError, match="^mode 'up': its flow contradicts its field"):
                simulate(System("free", ("x",), {}, (free,)), x=start, duration=0.01)


def table(how: str) -> System:
    """A ball that nothing forbids to be below the table."""
    fall = {"field": lambda x, p: {"x": x.v, "v": -1.0}}
    if how == "flow":
        fall = {"flow": lambda x, t, p: {"x": x.x + x.v * t - t**2 / 2, "v": x.v - t}}
    bounce = Event("impact", lambda x, p: x.x, -1, to="flight", reset=lambda x, p: {"v": -0.5 * x.v})
    return System("table", ("x", "v"), {}, (Mode("flight", ends=(bounce,), **fall),))


@pytest.mark.parametrize("how", ["field", "flow"])
def test_a_mode_that_starts_on_its_own_event(how):
    """It lies there: without a condition it would fall through, and never meet the table; thrown down it bounces."""
    sentence = "at 0 the mode 'flight' starts on its own event 'impact' and moves on through it.*`holds`"
    refused(table(how), sentence, x=0.0, v=0.0, duration=1.0)
    with pytest.raises(NoOrbit, match="starts on its own event 'impact'"):
        find_cycle(table(how), x=0.0, v=0.0)
    down = simulate(table(how), x=0.0, v=-0.5, duration=0.6)
    assert [crossing.time for crossing in down.events] == pytest.approx([0.0, 0.5], rel=1e-12)
    up = simulate(table(how), x=0.0, v=1.0, duration=2.5)
    assert [crossing.time for crossing in up.events] == pytest.approx([2.0], rel=1e-12)


@pytest.mark.parametrize("left", [0.1, 0.0])
def test_a_ball_that_a_sheet_brakes_falls_on_through_it(left):
    """A tenth of its speed is left behind it, which gravity soon makes far more of; of none it would lie on it."""
    sheet = Event("sheet", lambda x, p: x.x, -1, to="flight", reset=lambda x, p: {"v": left * x.v})
    fall = System("fall", ("x", "v"), {}, (Mode("flight", lambda x, p: {"x": x.v, "v": -1.0}, ends=(sheet,)),))
    if left == 0:
        return refused(fall, "at 1 the mode 'flight' starts on its own event 'sheet'", x=0.5, v=0.0, duration=2.0)
    assert simulate(fall, x=0.5, v=0.0, duration=2.0).end["x"] == pytest.approx(-0.1 - 0.5, rel=1e-9)


def test_a_mark_may_be_where_a_motion_starts():
    """An event that leads on in its own mode is counted from the start on."""
    mark = Event("up", lambda x, p: x.x, +1, to="turns")
    turns = Mode("turns", lambda x, p: {"x": x.v, "v": -x.x}, ends=(mark,))
    motion = simulate(System("circle", ("x", "v"), {}, (turns,)), x=0.0, v=1.0, duration=13.0)
    assert [crossing.time for crossing in motion.events] == pytest.approx([2 * math.pi, 4 * math.pi], rel=1e-8)


def test_a_missing_exit():
    """The condition says that the motion ends, and no event does."""
    free = Mode("free", lambda x, p: {"x": 1}, holds=lambda x, p: 1 - x.x)
    ramp = System("ramp", ("x",), {}, (free,))
    refused(ramp, "at .* 'free' does not hold any more .* an exit is missing", x=0.0, duration=3.0)


def test_a_push_at_an_event_is_no_fall_through_it():
    """A pendulum pushed on where it passes the middle, against the energy that every push adds."""

    def pushed(sign):
        return lambda x, p: {"w": sign * ca.sqrt(x.w**2 + p.push)}

    clock = System(
        "clock", ("a", "w"), {"push": 0.1},
        (Mode("swing", lambda x, p: {"a": x.w, "w": -ca.sin(x.a)},
              ends=(Event("tick", lambda x, p: x.a, +1, to="swing", reset=pushed(+1)),
                    Event("tock", lambda x, p: x.a, -1, to="swing", reset=pushed(-1)))),),
    )  # fmt: skip
    motion = simulate(clock, a=0.5, w=0.0, duration=30.0)
    speeds = [abs(crossing.behind[1]) for crossing in motion.events]
    energy = 2 * (1 - math.cos(0.5))
    assert len(speeds) > 5
    assert speeds == pytest.approx([math.sqrt(energy + 0.1 * (k + 1)) for k in range(len(speeds))], rel=1e-7)


def test_a_motion_goes_on_with_the_sizes_that_it_had():
    """In pieces it is the whole one; each piece alone would be measured by what is left of it."""
    def decays(x, p):
        return {"x": x.v, "v": -p.damping * x.v - x.x}

    system = System("oscillator", ("x", "v"), {"damping": 0.5}, (Mode("swings", decays),))
    whole = simulate(system, x=1.0, v=0.0, duration=60.0)
    first = simulate(system, x=1.0, v=0.0, duration=30.0)
    second = simulate(system, start=first.end, duration=30.0, sizes=first.sizes)
    alone = simulate(system, start=first.end, duration=30.0)
    assert second.sizes == first.sizes and alone.sizes["x"] < 1e-3
    assert second.end["x"] == pytest.approx(whole.end["x"], abs=1e-8 * whole.sizes["x"])
    pieces = [sum(len(phase.w) for phase in motion.phases) for motion in (second, alone)]
    assert pieces[0] < pieces[1]  # nothing but what counts is resolved


@pytest.mark.parametrize(("sizes", "sentence"), [
    ({"x": 1.0, "v": 0.0}, "sizes: v"), ({"x": 1.0}, "sizes: v"), ({"x": 1.0, "v": 1.0, "w": 1.0}, "'w'"),
])  # fmt: skip
def test_sizes_that_are_none(sizes, sentence):
    system = System("oscillator", ("x", "v"), {}, (Mode("swings", lambda x, p: {"x": x.v, "v": -x.x}),))
    with pytest.raises(InputError, match=sentence):
        simulate(system, x=1.0, v=0.0, duration=1.0, sizes=sizes)


@pytest.mark.parametrize("stiff", [False, True])
@pytest.mark.parametrize(("top", "phase"), [(1e-5, 0.3), (1e-4, 1.1), (1e-3, 0.7), (1e-2, 1.9), (3e-5, 1.7)])
def test_a_level_that_is_passed_for_a_moment_is_met(stiff, top, phase):
    """x = sin(t - 2 - phase) stays above 1 - top for 2 arccos(1 - top), from pi/2 - arccos(1 - top) on."""

    def swings(name, direction, to):
        end = Event("level", lambda x, p: x.x - (1 - p.top), direction, to=to)
        return Mode(name, lambda x, p: {"x": x.v, "v": -x.x}, stiff=stiff, ends=(end,))

    system = System("swing", ("x", "v"), {"top": top}, (swings("below", +1, "above"), swings("above", -1, "below")))
    start, above = -2 - phase, math.acos(1 - top)
    motion = simulate(system, "below", start={"x": math.sin(start), "v": math.cos(start)}, duration=6.0, tol=1e-8)
    below, beyond = motion.phases[0].duration, motion.phases[1].duration
    error = 1e-8 / math.sin(above)  # of x, over its rate
    assert below == pytest.approx(math.pi / 2 - above - start, abs=error)
    assert beyond == pytest.approx(2 * above, abs=2 * error)
