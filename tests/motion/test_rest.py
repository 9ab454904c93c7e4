"""A motion that comes to rest in modes that end again and again: what is left of it is rounding."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from casahunt.errors import NoOrbit
from casahunt.hybrid import Event, Mode, System
from casahunt.motion import simulate
from casahunt.motion.rest import dies_out_at
from casahunt.motion.segment import Segment
from casahunt.motion.simulation import _difference
from casahunt.orbits import find_cycle
from problems import canudas_gain

HIGH_GAIN = {"K": 47.0}


@pytest.mark.parametrize("x", [1.0, 0.1])
def test_no_cycle_is_sought_in_the_rounding_of_a_motion_at_rest(x):
    """The bristle creeps for thousands of seconds, and turns back with v = 1e-19 behind that."""
    with pytest.raises(NoOrbit, match="was found: the motion comes to rest") as refusal:
        find_cycle(canudas_gain.SYSTEM, "backwards", parameters=HIGH_GAIN, x=x, v=0.0, w=0.0, z=0.0)
    assert "fold" not in str(refusal.value)  # there is a cycle at this gain: tries on the way say nothing of it


def test_it_rests_where_the_forces_do():
    motion = simulate(canudas_gain.SYSTEM, "backwards", duration=5e4, parameters=HIGH_GAIN, x=1.0, v=0.0, w=0.0, z=0.0)
    end, p = motion.end, canudas_gain.SYSTEM.parameters
    assert motion.duration == pytest.approx(5e4, rel=1e-12) and motion.error < 0.01  # of the last reversal, at 1e-15
    assert abs(end["v"]) < 1e-15 and abs(end["x"]) < 1e-15
    assert HIGH_GAIN["K"] * p["ki"] * end["w"] == pytest.approx(-p["sigma0"] * end["z"], rel=1e-9)
    times, states = motion.sample()
    assert times[-1] == pytest.approx(5e4) and np.ptp(states[:, times > 2.5e4], axis=1).max() < 1e-13


def run(last, *at):
    """Phases of 4 s and `last`, to 0.3 and 0; then by times and ends."""
    times = (4.0, last, *at[::2])
    ends = np.array([[1.0], [0.3], [0.0], *([x] for x in at[1::2])])
    names = zip(("up", "down") * 3, times, ends[:-1], ends[1:], strict=False)
    return [Segment(mode, "turns", T, np.array([0.0, 1.0]), np.array([a, b]), b) for mode, T, a, b in names]


@pytest.mark.parametrize("beside", [1e-16, 1e-9, 1e-7])
@pytest.mark.parametrize("often", [True, False])
def test_two_runs_of_a_motion_may_rest_in_other_phases(beside, often):
    """One of them turns back where it rests, at other times or where the other does not: the last reversal before is
    that of both, and what it does within the tolerance, 1e-8, is not told from rest."""

    one = run(5.0, 10.0, beside, 10.0, -beside, 10.0, beside)
    other = run(5.0 + 3.9e-8, *((7.0, -beside, 13.0, -beside, 10.0, beside) if often else (30.0, beside)))
    found = _difference(one, other, np.ones(1), 1e-8)
    told_apart = 3 / 39 if often else np.inf
    assert found == pytest.approx(max(1e-9, 2 * beside) if beside < 1e-8 else told_apart, rel=1e-6)


def test_a_motion_that_sets_out_again_has_not_come_to_rest_with_the_other():
    stays, leaves = run(5.0, 30.0, 0.0), run(5.0, 10.0, 0.0, 10.0, 0.3, 10.0, 0.0)
    assert _difference(stays, leaves, np.ones(1), 1e-8) == _difference(leaves, stays, np.ones(1), 1e-8) == np.inf


def test_two_runs_that_rest_elsewhere_differ():
    at = np.array([0.5])
    here, there = run(5.0, 30.0, 0.0), [*run(5.0), Segment("up", "turns", 30.0, np.array([0.0, 1.0]), at[None], at)]
    assert _difference(here, there, np.ones(1), 1e-8) == 0.5


def test_an_event_in_the_rounding_of_a_creep_to_rest_may_be_met_at_any_time():
    """Both creep to 0 as exp(-t), and stop by rounding at 30 s, or at 33 s: after 20 s nothing is left of it. A stop at
    speed, at 30 s or at 33 s, is another motion."""

    def crept(stops, decays):
        breaks = np.append(np.arange(0.0, 30.0, 2.0), stops)
        at = np.exp(-breaks) if decays else 1 - breaks / stops
        creep = Segment("up", "turns", stops, breaks / stops, at[:-1, None], at[-1:])
        return [creep, Segment("down", "", 100 - stops, np.array([0.0, 1.0]), at[-1:, None], at[-1:])]

    found = [_difference(crept(30.0, decays), crept(33.0, decays), np.ones(1), 1e-8) for decays in (True, False)]
    assert found == [pytest.approx(np.exp(-28.0)), pytest.approx(3 / 100)]


@pytest.mark.parametrize(("last", "tol", "rests_from"), [
    ([(1.0, 1e-10)], 1e-9, 3), ([(1.0, 1e-8)], 1e-9, 4),  # less than before, but not by what an event is known to
    ([(1.0, 1e-10), (1.0, 0.5)], 1e-9, 3),  # the event that led to the last phase was met by rounding
    ([(1.0, 1e-10), (1.0, 0.5), (1.0, 0.5)], 1e-9, 6),
    ([(1e-12, 1e-22)], 1e-9, 4), ([(0.0, 0.0)], 1e-9, 4),  # too short to be told from rounding: events crowd
    ([(1e-30, 2e-16), (1.0, 1e-8)], 1e-9, 5),  # nor was it fast because it moved by rounding in no time
    ([(1.0, 1e-8)] * 4, 1e-7, 3), ([(1.0, 1e-8)] * 3, 1e-7, 6), ([(1.0, 1e-8)] * 4, 1e-9, 7),  # within its error
    ([(1.0, 1e-6)] * 4, 1e-4, 7), ([(1e-4, 1e-8)] * 4, 1e-7, 7),  # whatever that is; events that crowd there
])  # fmt: skip
def test_a_motion_that_cannot_be_followed_rests_where_its_forces_balance(last, tol, rests_from):
    """Phases by how long they take and how far they lead; the first three take 1 s and lead 1 to and fro."""
    phases = [(1.0, 1.0)] * 3 + last
    x = np.cumsum([0.0, *(far * (-1) ** k for k, (_, far) in enumerate(phases))])
    segments = [
        Segment("slip", "stop", lasts, np.array([0.0, 1.0]), np.array([[a]]), np.array([b]))
        for (lasts, _), a, b in zip(phases, x, x[1:], strict=False)
    ]
    assert dies_out_at(segments, np.ones(1), tol) == rests_from
    left = dies_out_at(segments[3:], np.ones(1), tol)
    assert left == len(segments) - 3  # it begins next to an equilibrium, and leaves it


def _two_modes(damping: float, stiff: bool) -> System:
    """x'' + damping x' + x = 0 beside a state that stands, in modes by the sign of v."""

    def field(x, p):
        return {"x": x.v, "v": -damping * x.v - x.x, "y": 0 * x.y}

    def speed(x, p):
        return x.v

    return System(
        "two modes", ("x", "v", "y"), {},
        (
            Mode("forth", field, stiff=stiff, ends=(Event("turns back", speed, -1, to="back"),)),
            Mode("back", field, stiff=stiff, ends=(Event("turns forth", speed, +1, to="forth"),)),
        ),
    )  # fmt: skip


def test_a_motion_that_leaves_an_equilibrium_is_not_at_rest():
    """For 60 reversals it is less than 1e-13 of what it comes to."""
    motion = simulate(_two_modes(-0.1, stiff=False), "back", duration=780.0, x=1e-17, v=0.0, y=1.0)
    w = np.sqrt(1 - 0.05**2)
    exact = 1e-17 * np.exp(39.0) * (np.cos(780 * w) - 0.05 / w * np.sin(780 * w))
    assert motion.end["x"] == pytest.approx(exact, rel=1e-7) and len(motion.events) == int(780 * w / np.pi)


def test_one_that_decays_comes_to_rest():
    motion = simulate(_two_modes(0.1, stiff=True), "back", duration=1e4, x=1.0, v=0.0, y=1.0)
    assert motion.duration == pytest.approx(1e4) and abs(motion.end["x"]) < 1e-12 and motion.end["y"] == 1.0


@pytest.mark.parametrize("stiff", [False, True])
def test_it_is_said_of_a_motion_that_repeats_only_because_it_rests(stiff):
    with pytest.raises(NoOrbit, match="was found: the motion comes to rest"):
        find_cycle(_two_modes(0.1, stiff), "back", x=1.0, v=0.0, y=1.0)


@pytest.mark.parametrize("how", ["flow", "field"])
@pytest.mark.parametrize("seed", range(12))
def test_a_ball_whose_bounces_end_lies_on_the_table(how, seed):
    """Infinitely many bounces end at sqrt(2 h/g) (1 + r)/(1 - r); behind that it lies there, or says why not."""
    rng = np.random.default_rng(seed)
    h, r = (10.0 ** rng.uniform(-3, 3), rng.uniform(0.1, 0.9)) if seed else (1.0, 0.5)
    flight = {
        "flow": {"flow": lambda x, t, p: {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t}},
        "field": {"field": lambda x, p: {"x": x.v, "v": -p.g}},
    }[how]
    bounces = Event("bounces", lambda x, p: x.x, -1, to="flight", reset=lambda x, p: {"v": -p.r * x.v})
    ball = System("ball", ("x", "v"), {"g": 9.81, "r": r}, (Mode("flight", ends=(bounces,), **flight),))
    over = math.sqrt(2 * h / 9.81) * (1 + r) / (1 - r)
    try:
        motion = simulate(ball, x=h, v=0.0, duration=rng.uniform(1.1, 5) * over if seed else 5.0)
    except NoOrbit as refusal:
        time = float(re.search(r"near ([\d.e+-]+) events follow each other ever faster", str(refusal))[1])
        assert time == pytest.approx(over, rel=1e-4)
    else:
        assert motion.events[-1].time == pytest.approx(over, rel=1e-9)
        assert abs(motion.end["x"]) <= 1e-12 * h and abs(motion.end["v"]) <= 1e-9 * math.sqrt(20 * h)
