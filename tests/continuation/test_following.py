"""How far a branch is followed, in which steps, and what is told on the way."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casahunt import effort
from casahunt.continuation import Branch, End, SpecialPoint, follow, largest, special_curve
from casahunt.continuation.closed_branch import unseen_turns
from casahunt.continuation.special_points import Monitor
from casahunt.errors import NoOrbit
from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid.examples import ball, belt
from casahunt.orbits import Options, find_cycle
from casahunt.roots import hides_a_pair
from problems import rings

RELAY = System(
    "relay", ("x",), {"level": 0.5},
    (
        Mode("up", lambda x, p: {"x": 1 - x.x}, ends=(Event("full", lambda x, p: x.x - p.level, +1, to="down"),)),
        Mode("down", lambda x, p: {"x": -1 - x.x}, ends=(Event("empty", lambda x, p: x.x + 0.5, -1, to="up"),)),
    ),
)  # fmt: skip
DUFFING = System(
    "forced Duffing", ("x", "v"), {"F": 0.3, "load": 0.0},
    (Mode("smooth", lambda x, p: {"x": x.v, "v": p.F * ca.cos(x.t) + p.load - 0.2 * x.v - x.x - x.x**3}),),
    forcing_period=lambda p: 2 * math.pi,
)  # fmt: skip


@pytest.fixture(scope="module")
def stick_slip():
    return find_cycle(belt, "slip", x=0.0, v=0.0)


def test_a_step_changes_the_parameter_by_no_more_than_it_may(stick_slip):
    heard = []
    branch = follow(stick_slip, "belt", to=0.23, largest_change=0.004, first_step=0.5, progress=heard.append)
    assert np.max(np.abs(np.diff(branch.values))) <= 0.004 * 1.02
    assert tuple(heard) == branch.orbits[1:] and branch.end.kind == "range" and branch.end.value == 0.23
    assert len(follow(stick_slip, "belt", to=0.23, first_step=0.5).orbits) < len(branch.orbits)


def test_a_step_that_bends_changes_the_parameter_by_no_more_than_it_may():
    """1e-4 beside a fold the tangent tells of a thirtieth of what a step of 0.5 changes."""
    top = 2 * 3**-1.5
    start = find_cycle(rings.HYSTERESIS, parameters={"s": 1.0, "lam": 1e-4 - top}, x=math.sqrt(2.59), y=0.0)
    branch = follow(start, "lam", to=0.0, largest_change=0.02, first_step=0.5)
    assert np.max(np.abs(np.diff(branch.values))) <= 0.02 * 1.02 and branch.values[-1] == 0.0


def test_another_cycle_at_the_first_value_is_not_where_a_branch_began():
    """Of the three sheets over lam = 0.2 the branch begins on the outer one, and comes by on the inner one."""
    start = find_cycle(rings.HYSTERESIS, parameters={"s": 1.0, "lam": 0.2}, x=1.758, y=0.0)
    branch = follow(start, "lam", to=-1.0, back=1.0)
    assert branch.end.kind == "range" and branch.end.value == -1.0
    assert [special.value for special in branch.special] == pytest.approx([-2 * 3**-1.5, 2 * 3**-1.5], abs=1e-8)


def test_steps_that_come_up_to_the_bound_but_for_rounding_land_on_it():
    """Twenty steps of 0.03 from -0.3 add up to 0.29999999999999993; no step of 1e-16 is taken from there."""

    def ring(x, p):
        rate = 1 - x.x**2 - x.y**2
        return {"x": rate * x.x - x.y, "y": rate * x.y + x.x, "z": p.lam * x.z - x.z**3}

    system = System("ring", ("x", "y", "z"), {"lam": -0.3}, (Mode("smooth", ring),))
    branch = follow(find_cycle(system, x=1.0, y=0.0, z=0.1), "lam", to=0.3, largest_step=0.1, first_step=0.1)
    assert branch.end.kind == "range" and branch.values[-1] == 0.3
    assert branch.values == pytest.approx(np.linspace(-0.3, 0.3, 21))
    assert [special.kind for special in branch.special] == ["symmetry breaking"]  # the multiplier -exp(pi lam) of z
    assert branch.special[0].value == pytest.approx(0, abs=1e-7)


def test_a_branch_that_takes_too_long_ends_with_what_it_has(stick_slip):
    began = time.monotonic()
    branch = follow(stick_slip, "belt", to=0.9, largest_change=1e-4, max_points=10**6, time_limit=0.3)
    assert time.monotonic() - began < 3 and branch.end.kind == "time" and "0.3 s" in branch.ended
    assert len(branch.orbits) > 1 and np.all(np.diff(branch.values) > 0)
    assert follow(stick_slip, "belt", to=0.9, max_points=3).end.kind == "points"


def test_what_was_passed_before_the_time_was_up_is_told():
    """Special points are looked for in several steps at once: also in those that were waiting for more."""
    orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)

    def no_longer(orbit):
        if orbit.problem.value("a") > 0.03:
            raise effort.OutOfTime

    branch = follow(orbit, "a", to=0.05, progress=no_longer)
    assert [special.kind for special in branch.special] == ["flip"] and branch.end.kind == "time"
    assert not branch.orbits[-1].stable


def test_a_point_lies_in_its_step_however_little_is_known_of_its_monitor(stick_slip):
    monitor = Monitor(
        "mark", lambda orbit, point: orbit.problem.value("belt") - 0.21, "at {value:.10g}",
        noise=lambda orbit: 9.0 if abs(orbit.problem.value("belt") - 0.21) < 1e-4 else 0.0,
    )  # fmt: skip
    (special,) = follow(stick_slip, "belt", to=0.23, monitors=(monitor,)).special
    assert float(special.meaning.removeprefix("at ")) == pytest.approx(0.21, abs=0.03)


def test_a_parameter_that_breaks_the_symmetry_is_followed_with_the_whole_cycle():
    """T = ln(1.5/(1 - level)) + ln((1 + level)/0.5); at level = 0.5 half a cycle is enough, and elsewhere wrong."""
    orbit = find_cycle(RELAY, "up", x=0.0)
    assert orbit.repeats == 2
    branch = follow(orbit, "level", to=2.0)
    levels = branch.values
    assert branch.orbits[0].repeats == 1 and branch.end.kind == "level reached"
    assert branch.end.value == pytest.approx(1.0, abs=1e-7)
    some = levels < 0.99
    truth = np.log(1.5 / (1 - levels[some])) + np.log((1 + levels[some]) / 0.5)
    assert branch.periods[some] == pytest.approx(truth, rel=1e-7)


def test_one_that_keeps_it_is_not():
    orbit = find_cycle(DUFFING, x=0.0, v=0.0)
    assert orbit.repeats == 2 and all(o.repeats == 2 for o in follow(orbit, "F", to=0.32).orbits)
    loaded = follow(orbit, "load", to=0.05)
    direct = find_cycle(DUFFING, parameters={"load": 0.05}, x=0.0, v=0.0)
    assert loaded.orbits[-1].extrema("x").high.value == pytest.approx(direct.extrema("x").high.value, rel=1e-7)
    assert loaded.orbits[-1].extrema("x").high.value != pytest.approx(-direct.extrema("x").low.value, rel=1e-3)


def test_a_special_point_of_symmetric_cycles_has_no_curve_where_they_are_not():
    lost = System(
        "pitchfork of cycles", ("x", "y", "z"), {"a": -0.3, "bias": 0.0},
        (Mode("smooth", lambda x, p: {
            "x": (1 - x.x**2 - x.y**2) * x.x - x.y, "y": (1 - x.x**2 - x.y**2) * x.y + x.x,
            "z": p.a * x.z - x.z**3 + p.bias,
        }),),
    )  # fmt: skip
    (special,) = follow(find_cycle(lost, x=1.0, y=0.0, z=0.1), "a", to=0.3).special
    with pytest.raises(NoOrbit, match="loses the symmetry"):
        special_curve(special, "a", "bias", to=0.1)


@pytest.mark.slow
def test_the_fold_of_a_canard():
    """The largest I comes first on the way up; both are known from 40-digit shooting (problems/fitzhugh_nagumo.py)."""
    nerve = System(
        "nerve", ("v", "w"), {"I": 0.5},
        (Mode("smooth", lambda x, p: {"v": x.v - x.v**3 / 3 - x.w + p.I, "w": 0.08 * (x.v + 0.7 - 0.8 * x.w)}),),
    )  # fmt: skip
    orbit = find_cycle(nerve, v=1.0, w=0.0)
    branch = follow(orbit, "I", to=0.2, back=0.6, options=Options(tol=1e-8))
    assert [special.kind for special in branch.special] == ["fold", "Hopf"] and not branch.missed
    assert branch.special[0].value == pytest.approx(0.3241785225037, rel=1e-9)
    # A multiplier is 1 there: the parameter stands still to rounding all around.
    assert branch.special[0].orbit.multipliers.half[1].real == pytest.approx(1.0, abs=1e-3)


def test_largest_of_a_symmetric_start():
    """The relay's cycle has no largest level before its end; half of it would have none at all."""
    with pytest.raises(NoOrbit, match="no largest level"):
        largest(find_cycle(RELAY, "up", x=0.0), "level", to=0.9)


@pytest.mark.parametrize(
    ("at", "values", "mean", "found"),
    [
        ((0, 1, 2, 3), (3.0, 2.0, 1.0, 0.5), None, False),  # a line that ends before zero
        ((0, 1, 2, 3), (2.0, 0.1, 0.1, 2.0), None, True),  # a parabola through zero
        ((0, 1, 2), (2.0, 1.9, -1.0), None, False),  # the first step
        ((0, 1, 2, 3), (2.0, 1.0, -1.0, 2.0), None, False),  # a change of sign is no pair
        ((1, 2), (2.0, 2.0), None, True),  # nothing else is known
        ((1, 2), (2.0, 2.0), 2.1, False),  # but the mean
        ((1, 2), (2.0, 2.0), 1.2, True),
        ((0, 1, 2, 3), (1.0, 1.0, 1.0, 1.0), None, False),
        ((0, 1, 2, 3), (1.0, 1.0, 1.0, 1.0), 0.7, True),  # but its mean is less than its ends are
    ],
)
def test_what_may_hide_inside_a_step(at, values, mean, found):
    low = 0 if len(at) == 3 else 1
    assert hides_a_pair(np.array(at, float), np.array(values), low, low + 1, mean) is found


def test_a_parameter_that_turns_round_without_a_fold_is_told(stick_slip):
    """Orbits up and down again: who lost the point between them says so; one that was located answers for one turn."""
    up = follow(stick_slip, "belt", to=0.23).orbits
    there = Branch("belt", (*up, *up[-2::-1], *up[1:]), (), (), End("range", ""))
    (missed,) = unseen_turns(there)
    assert missed.kind == "fold" and "turns round 2 times" in missed.meaning
    fold = SpecialPoint("fold", up[-1], "a fold", vary="belt")
    assert len(unseen_turns(replace(there, special=(fold,)))) == 1
    assert unseen_turns(replace(there, special=(fold, fold))) == unseen_turns(replace(there, orbits=up)) == ()
    still = replace(there, orbits=(up[0], up[1], replace(up[1], period_error=1.0), up[0]))
    assert unseen_turns(still) == ()  # by less than is known


def test_two_real_multipliers_whose_product_passes_one_are_no_torus():
    """exp(0.4 pi) and exp(2 pi (lam - 0.2)): at lam = 0 the one is the inverse of the other."""

    def saddle(x, p):
        rate = 1 - x.x**2 - x.y**2
        return {"x": rate * x.x - x.y, "y": rate * x.y + x.x, "z": 0.2 * x.z, "w": (p.lam - 0.2) * x.w}

    system = System("saddle", ("x", "y", "z", "w"), {"lam": -0.1}, (Mode("smooth", saddle),))
    start = find_cycle(system, x=1.0, y=0.0, z=0.0, w=0.0, settled=True)
    branch = follow(start, "lam", to=0.1)
    assert branch.end.kind == "range" and not branch.special and not branch.missed
