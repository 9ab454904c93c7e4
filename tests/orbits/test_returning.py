"""A motion that is followed until it comes back: to which cycle, or why to none; and turns of angles."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from oscillator import VAN_DER_POL, assert_period, van_der_pol

from casahunt import effort
from casahunt.errors import NoOrbit, Status
from casahunt.hybrid import Event, Mode, System
from casahunt.motion.segment import NoEnd
from casahunt.orbits import find_cycle
from casahunt.orbits.returning import Returning
from casahunt.orbits.watching import LOOKED_AT_MOST, NotFound, section_of, watch_motion
from problems import rossler


@pytest.mark.parametrize("more", [-1e-3, 0.0, 1e-3])
def test_where_a_motion_is_cut_does_not_hang_on_rounding(more):
    """All states of a symmetric motion go from minus their size to plus their size: none is the largest."""
    system = van_der_pol()
    p = np.array(list(system.parameters.values()))
    seen = watch_motion(system, "smooth", np.array([2.0, 0.0]), p, "gauss")
    seen = seen._replace(late=seen.late * np.array([[1.0], [1.0 + more]]))
    ((section,), turning) = section_of(system, seen, p)
    assert section.state == "x" and turning is None


def _right(x, p):
    return x.x


def refused(system: System, sentence: str, **start: float) -> None:
    with pytest.raises(NoOrbit, match=sentence) as refusal:
        find_cycle(system, **start)
    assert refusal.value.status is Status.NOT_FOUND and "\n" not in str(refusal.value)


@pytest.mark.parametrize("start", [{"x": 1.0, "v": 0.0}, {"x": 0.0, "v": 0.0}])
def test_a_motion_that_comes_to_rest(start):
    damped = System("damped", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": -0.3 * x.v - x.x}),))
    refused(damped, "^no cycle of damped was found: the motion comes to rest", **start)


@pytest.mark.parametrize("k", [1.0, 2.0])
def test_a_motion_that_comes_to_rest_among_its_events(k):
    """It meets them for ever, and repeats in the end but for rounding."""
    right = Mode("right", lambda x, p: {"x": x.v, "v": -0.3 * x.v - x.x}, ends=(Event("out", _right, -1, to="left"),))
    left = Mode("left", lambda x, p: {"x": x.v, "v": -0.3 * x.v - k * x.x}, ends=(Event("in", _right, +1, to="right"),))
    system = System("damped", ("x", "v"), {}, (right, left))
    refused(system, "^no cycle of damped was found: the motion comes to rest", x=1.0, v=0.0)


def test_a_block_that_sticks_for_ever():
    """It slips to where static friction holds it on a belt that stands."""
    slip = Mode("slip", lambda x, p: {"x": x.v, "v": 1 - x.x}, ends=(Event("stops", lambda x, p: x.v, -1, to="stick"),))
    stick = Mode("stick", flow=lambda x, t, p: {"x": x.x, "v": 0})
    refused(System("block", ("x", "v"), {}, (slip, stick)), "^no cycle of block was found: .* rest", x=0.0, v=0.1)


def test_an_unstable_cycle_next_to_the_start():
    """Stuart-Landau backwards: the multiplier is the inverse."""

    def back(x, p):
        square = x.x**2 + x.y**2
        grows, turns = square - p.a, p.omega
        return {"x": grows * x.x - turns * x.y, "y": grows * x.y + turns * x.x}

    system = System("backwards", ("x", "y"), {"a": 0.01, "omega": 2.0}, (Mode("smooth", back),))
    orbit = find_cycle(system, x=0.1 * (1 + 1e-6), y=0.0, settled=True, tol=1e-10)
    assert_period(orbit, math.pi)
    assert not orbit.stable
    assert sorted(orbit.multipliers.full.real) == pytest.approx([1.0, math.exp(0.02 * math.pi)], rel=1e-8)


def rings(rate: float) -> System:
    """Circles of radius 1 and 3 attract, that of radius 2 parts them."""

    def field(x, p):
        square = x.x**2 + x.y**2
        grows = -p.rate * (square - 1) * (square - 4) * (square - 9)
        return {"x": grows * x.x - x.y, "y": grows * x.y + x.x}

    return System("rings", ("x", "y"), {"rate": rate}, (Mode("smooth", field),))


def test_a_motion_that_is_slow_to_leave_an_unstable_cycle_does_not_go_to_it():
    """Its multiplier is exp(240 pi rate): 1.46, a motion of a few turns gets away; or 1.08, it does not."""
    orbit = find_cycle(rings(5e-4), x=2 * (1 + 1e-9), y=0.0, tol=1e-9)
    assert orbit.stable and orbit.extrema("x").high.value == pytest.approx(3, rel=1e-8)
    refused(rings(1e-4), "an unstable cycle was passed, which the motion leaves", x=2 * (1 + 1e-9), y=0.0)


@pytest.mark.parametrize("rate", [0.003, 0.1, 1.0])
@pytest.mark.parametrize(("begins", "radius"), [(0.5, 1), (1.9, 1), (1.99, 1), (2.01, 3), (2.1, 3), (3.5, 3)])
def test_which_of_two_cycles_the_motion_goes_to(rate, begins, radius):
    """A first return may be nearer to the wrong one."""
    orbit = find_cycle(rings(rate), x=begins, y=0.0, tol=1e-9)
    assert_period(orbit, 2 * math.pi)
    assert orbit.stable and orbit.extrema("x").high.value == pytest.approx(radius, rel=1e-8)


@pytest.mark.slow
def test_a_slow_motion_is_not_where_newtons_method_goes():
    """Circles of radius 1 and 1.1 attract, weakly: from 1.075 Newton's method goes to the wrong one."""

    def field(x, p):
        square = x.x**2 + x.y**2
        grows = -0.02 * (square - 1) * (square - 1.05**2) * (square - 1.1**2)
        return {"x": grows * x.x - x.y, "y": grows * x.y + x.x}

    rings = System("rings", ("x", "y"), {}, (Mode("smooth", field),))
    orbit = find_cycle(rings, x=1.075, y=0.0, tol=1e-9)
    assert orbit.extrema("x").high.value == pytest.approx(1.1, rel=1e-8)


def test_events_that_are_met_at_first_alone():
    """The cycle of x'' = (1 - x^2) x' - x keeps clear of x = 4, from beyond which the motion comes."""
    field = lambda x, p: {"x": x.v, "v": (1 - x.x**2) * x.v - x.x}  # noqa: E731
    ends = tuple(Event(f"{way}", lambda x, p: x.x - 4, way, to="smooth") for way in (-1, +1))
    orbit = find_cycle(System("stop", ("x", "v"), {}, (Mode("smooth", field, ends=ends),)), x=5.0, v=0.0, tol=1e-9)
    assert_period(orbit, VAN_DER_POL[0.0][0])


def test_a_strongly_unstable_cycle_through_the_start():
    """Van der Pol's in reversed time: disturbances grow by 1163 in a turn; the period is the same."""
    reverse = System(
        "reversed van der Pol", ("x", "v"), {"mu": 1.0},
        (Mode("smooth", field=lambda x, p: {"x": -x.v, "v": x.x - p.mu * (1 - x.x**2) * x.v}),),
    )  # fmt: skip
    orbit = find_cycle(reverse, x=0.0, v=2.172713, settled=True)
    assert orbit.period == pytest.approx(6.66328685932313, rel=1e-10) and not orbit.stable
    ahead = Mode("smooth", field=lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x})
    forward = find_cycle(replace(reverse, modes=(ahead,)), x=2.0, v=0.0)
    assert abs(orbit.multipliers.leading) * abs(forward.multipliers.full[1]) == pytest.approx(1.0, rel=1e-7)
    with pytest.raises(NoOrbit, match="does not come back nearer"):
        find_cycle(reverse, x=0.0, v=1.0, settled=True)


SECOND = 4e4
"""Work of a second (casahunt/effort.py); it is the same on every machine."""


def refusal_of(system: System, **asked) -> tuple[str, float]:
    """(the sentence, seconds of work that it has cost)."""
    with effort.counting_work(None) as watch, pytest.raises(NoOrbit) as refusal:
        find_cycle(system, **asked)
    assert refusal.value.status is Status.NOT_FOUND
    return str(refusal.value), watch.work / SECOND


@pytest.mark.slow
def test_chaos_is_given_up():
    """Rossler's at c = 5.7; before, 3072 phases and the equations of hundreds of phases at once."""
    said, seconds = refusal_of(rossler.SYSTEM, parameters={"c": 5.7}, x=1.0, y=1.0, z=1.0)
    assert int(said.split("did not repeat within ")[1].split(" phases")[0]) < 3072
    assert seconds < 8


def test_centres_have_no_cycle_of_their_own():
    """One of many, and said so at once: going on shows nothing more."""
    spring = System("spring", ("x", "v"), {"k": 1.0}, (Mode("free", lambda x, p: {"x": x.v, "v": -p.k * x.x}),))
    said, seconds = refusal_of(spring, x=1.0, v=0.0)
    assert "the motion repeats after 1 phase, but it is one of many" in said
    assert seconds < 3


def test_drifts_and_growth():
    """x + 1.5 t; exp(0.05 t)."""
    drift = System("drift", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": 1.5 - x.v}),))
    said, seconds = refusal_of(drift, x=1.0, v=0.0)
    assert "the motion does not come back to x" in said and seconds < 3
    grows = System("grows", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": 0.1 * x.v - x.x}),))
    said, seconds = refusal_of(grows, x=1.0, v=0.0)
    assert "the motion grows" in said and seconds < 3


@pytest.mark.slow
def test_a_torus_is_no_cycle():
    """Two oscillators whose frequencies have no common multiple: it nearly repeats, and never settles."""

    def field(x, p):
        r, s = 1 - x.x**2 - x.y**2, 1 - x.u**2 - x.w**2
        w = math.sqrt(2)
        return {"x": r * x.x - x.y, "y": r * x.y + x.x, "u": s * x.u - w * x.w, "w": s * x.w + w * x.u}

    torus = System("torus", ("x", "y", "u", "w"), {}, (Mode("smooth", field),))
    said, seconds = refusal_of(torus, x=1.0, y=0.1, u=0.5, w=0.0)
    assert said.startswith("no cycle of torus was found") and seconds < 8


def test_it_says_how_long_it_watched():
    damped = System("damped", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": -0.3 * x.v - x.x}),))
    said, _ = refusal_of(damped, x=1.0, v=0.0)
    assert "followed for" in said and "followed for 0)" not in said


@pytest.mark.parametrize("settled", [False, True])
@pytest.mark.parametrize(("w", "e"), [(1.0, 0.0), (1.5, 0.3), (-1.5, 0.3), (1.5, 1.49), (1e3, 1.0), (1e-3, 5e-4)])
def test_a_rotor_of_one_state(w, e, settled):
    """theta' = w + e sin theta: one turn in 2 pi / sqrt(w^2 - e^2), either way round."""
    turns = Mode("turns", lambda x, p: {"theta": p.w + p.e * ca.sin(x.theta)})
    rotor = System("rotor", ("theta",), {"w": w, "e": e}, (turns,), angles=("theta",))
    orbit = find_cycle(rotor, theta=0.3, settled=settled, tol=1e-10)
    assert_period(orbit, 2 * math.pi / math.sqrt(w**2 - e**2))
    _, x = orbit.sample()
    assert x[0, -1] - x[0, 0] == pytest.approx(math.copysign(2 * math.pi, w), rel=1e-12)


@pytest.mark.parametrize("w", [0.0, 1.5])
def test_a_rotor_whose_speed_settles(w):
    """w' = (1.5 - w) / 20: at last nothing moves but the angle; the multiplier is exp(-T / 20)."""
    turns = Mode("turns", lambda x, p: {"theta": x.w, "w": p.k * (1.5 - x.w)})
    rotor = System("rotor", ("theta", "w"), {"k": 0.05}, (turns,), angles=("theta",))
    orbit = find_cycle(rotor, theta=0.0, w=w, tol=1e-10)
    assert_period(orbit, 2 * math.pi / 1.5)
    assert sorted(orbit.multipliers.full.real) == pytest.approx([math.exp(-0.05 * orbit.period), 1.0], rel=1e-9)


def test_a_rotor_that_stops():
    turns = Mode("turns", lambda x, p: {"theta": 0.5 + ca.sin(x.theta)})
    refused(System("rotor", ("theta",), {}, (turns,), angles=("theta",)), "comes to rest", theta=0.3)


# Looks ----------------------------------------------------------------------------------------------------------------


def searched(field, span: float, looks: int) -> Returning:
    """A motion whose event is met no more, so often looked at again, in the middle of its march."""
    never = Event("never", lambda x, p: x.x - 1e9, +1, to="on")
    system = System("never again", ("x", "v"), {}, (Mode("on", field, ends=(never,)),))
    return Returning(
        system=system, p=np.zeros(0), mode="on", x=np.array([0.0, 1.0]), kind="gauss",
        scale=np.ones(2), form=system.vector_form, span=span, looks=looks,
    )  # fmt: skip


def test_a_motion_is_looked_at_again_and_not_for_ever():
    """x' = 1 until the time is over, and x'' = -x for more intervals than are waited: another look, up to the last."""
    drift, swing = (lambda x, p: {"x": 1.0, "v": 0.0}), (lambda x, p: {"x": x.v, "v": -x.x})
    for field, span, why in ((drift, 1.0, NotFound), (swing, 1e6, NoEnd)):
        search = searched(field, span, LOOKED_AT_MOST - 1)
        search.marched(1)
        assert search.looks == LOOKED_AT_MOST and not search.segments
        with pytest.raises(why, match="does not meet another event" if why is NotFound else "no exit after"):
            search.marched(1)
