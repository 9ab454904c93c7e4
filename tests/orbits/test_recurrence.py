"""When a motion repeats: as it is or mirrored, and what is no symmetry."""

from __future__ import annotations

import math
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from oscillator import START, VAN_DER_POL, assert_period, van_der_pol

from casahunt.hybrid import Event, Mode, System
from casahunt.motion.segment import Segment
from casahunt.orbits import find_cycle
from casahunt.orbits.closure import Closure
from casahunt.orbits.recurrence import Recurrence, comes_in, image_of, loop_distance
from casahunt.orbits.returning import REPEATED, Returning


def test_nearly_symmetric_is_not_symmetric():
    """A small constant force: half a cycle would be another problem."""
    orbit = find_cycle(van_der_pol(force=1e-3), tol=1e-11, **START)
    period, stands = VAN_DER_POL[1e-3]
    assert orbit.repeats == 1
    assert_period(orbit, period)
    extrema = orbit.extrema("x")
    assert extrema.high.value == pytest.approx(stands, rel=1e-10)
    assert extrema.high.value + extrema.low.value > 1e-3


def test_a_symmetry_of_ones_own():
    """x' = y and y' of van der Pol, z driven by x^2: only (x, y, z) -> (-x, -y, z) halves the cycle."""

    def field(x, p):
        return {"x": x.v, "v": (1 - x.x**2) * x.v - x.x, "z": x.x**2 - x.z}

    for symmetries, repeats in (((), 1), ((np.diag([-1.0, -1.0, 1.0]),), 2), ((np.diag([1.0, -1.0, 1.0]),), 1)):
        driven = System("driven", ("x", "v", "z"), {}, (Mode("smooth", field),), symmetries=symmetries)
        orbit = find_cycle(driven, x=2.0, v=0.0, z=0.0, tol=1e-10)
        assert orbit.repeats == repeats
        assert_period(orbit, VAN_DER_POL[0.0][0])


def test_how_far_a_loop_is_from_the_one_before():
    """Half a turn later mirrored, a whole turn later not: what is left are the distances put in, by size."""
    free = Mode("free", lambda x, p: {"x": x.v, "v": ca.cos(x.t) - x.x})
    system = System("forced", ("x", "v"), {}, (free,), forcing_period=lambda p: 2 * math.pi)

    def ends(*states):
        return [Segment("free", "", 1.0, np.array([0.0, 1.0]), np.zeros((1, 3)), np.array(x)) for x in states]

    scale = np.array([2.0, 5.0, 1.0])
    for S, shift, repeats, states in (
        (np.diag([-1.0, -1.0, 1.0]), [0.0, 0.0, 0.5], 2, ([1.0, -3.0, 0.3], [-1.0, 3.0, 0.8])),
        (np.eye(3), [0.0, 0.0, 1.0], 1, ([1.0, -3.0, 0.3], [1.0, -3.0, 1.3])),
    ):
        r = Recurrence(1, Closure.of(S, np.array(shift), repeats), 0.0)
        assert loop_distance(system, ends(*states), r, scale) == pytest.approx(0.0, abs=1e-15)
        for entry, off, distance in ((0, 0.02, 0.01), (1, -0.2, 0.04), (2, 0.2, 0.2)):
            later = np.array(states[1])
            later[entry] += off
            assert loop_distance(system, ends(states[0], later), r, scale) == pytest.approx(distance)
            watched = SimpleNamespace(system=system, segments=ends(states[0], later), scale=scale)
            assert Returning.repeated(watched, r) is (distance < REPEATED)
        assert loop_distance(system, ends(states[0]), r, scale) == math.inf


@pytest.mark.parametrize(
    ("M", "before", "now", "expected"),
    [
        ([[0.5]], [1.0], [0.5], True),
        ([[0.5]], [1.0], [0.7], True),
        ([[0.5]], [1.0], [0.8], False),  # 0.3 beyond the linear map, which contracts by 0.5
        ([[-0.9]], [1.0], [-0.9], True),
        ([[-0.9]], [1.0], [-0.5], False),  # nearer, by what is not linear
        ([[0.0, 100.0], [0.0, 0.0]], [0.0, 1.0], [100.0, 0.0], True),  # it comes back in two returns
        ([[0.0, 100.0], [0.0, 0.0]], [0.0, 1.0], [0.0, 1.0], False),
    ],
)
def test_whether_a_return_shows_that_a_motion_comes_in(M, before, now, expected):
    assert comes_in(np.array(M), np.array(before), np.array(now)) is expected


def test_conditions_that_are_not_mirrored_are_no_symmetry():
    """Van der Pol's cycle in two modes, of which one is a motion at x < 3 and the other at x > -2.5."""

    def field(x, p):
        return {"x": x.v, "v": (1 - x.x**2) * x.v - x.x}

    def halves(low):
        up = Mode("up", field, holds=lambda x, p: 3 - x.x, ends=(Event("top", lambda x, p: x.v, -1, to="down"),))
        down = Mode("down", field, holds=lambda x, p: x.x + low, ends=(Event("end", lambda x, p: x.v, +1, to="up"),))
        return System("two modes", ("x", "v"), {}, (up, down))

    for low, repeats in ((3.0, 2), (2.5, 1)):
        orbit = find_cycle(halves(low), "down", x=2.0, v=0.0, tol=1e-10)
        assert orbit.repeats == repeats
        assert_period(orbit, VAN_DER_POL[0.0][0])


def test_an_event_that_is_crossed_either_way_is_mirrored():
    """v = 0 of van der Pol, rising or falling: the one is the image of the other."""
    field = lambda x, p: {"x": x.v, "v": (1 - x.x**2) * x.v - x.x}  # noqa: E731
    for scalar, repeats in ((lambda x, p: x.v, 2), (lambda x, p: x.v + 0.1 * x.v**2, 1)):
        either = Mode("smooth", field, ends=(Event("turns", scalar, 0, to="smooth"),))
        orbit = find_cycle(System("either", ("x", "v"), {}, (either,)), x=2.0, v=0.0, tol=1e-10)
        assert orbit.repeats == repeats
        assert_period(orbit, VAN_DER_POL[0.0][0])


def test_what_a_phase_is_called_when_mirrored():
    """Of a mode with an event on either side: the image of one side is the other, whichever of them stands first."""
    sides = (Event("right", lambda x, p: x.x - 1, +1, to="in"), Event("left", lambda x, p: x.x + 1, -1, to="in"))
    for ends in (sides, sides[::-1]):
        form = System("gap", ("x", "v"), {}, (Mode("in", lambda x, p: {"x": x.v, "v": -x.x}, ends=ends),)).vector_form
        end = np.array([1.0, 0.5])
        phase = Segment("in", "right", 0.5, np.array([0.0, 1.0]), np.array([[0.5, 1.0], end]), end)
        assert image_of(form, phase, Closure.of(-np.eye(2), np.zeros(2), 2), np.zeros(0), np.ones(2)) == ("in", "left")


@pytest.mark.parametrize(("offset", "image"), [(0.0, ("in", "left")), (0.1, None)])
def test_a_jump_is_mirrored_with_the_parameters_that_are_asked_for(offset, image):
    """A speed that is multiplied by k at either side stays mirrored for every k, whatever k the motion has jumped with;
    one that is also shifted by 0.1 (k - 0.5) is mirrored at the motion's own k = 0.5 alone.  With the states behind
    the motion's own jump a reset lost its symmetry wherever it was varied."""

    def bounces(x, p):
        return {"v": p.k * x.v + offset * (p.k - 0.5)}

    right = Event("right", lambda x, p: x.x - 1, +1, to="in", reset=bounces)
    left = Event("left", lambda x, p: x.x + 1, -1, to="in", reset=bounces)
    mode = Mode("in", lambda x, p: {"x": x.v, "v": -x.x}, ends=(right, left))
    form = System("gap", ("x", "v"), {"k": 0.5}, (mode,)).vector_form
    end, half = np.array([1.0, 0.5]), Closure.of(-np.eye(2), np.zeros(2), 2)
    phase = Segment("in", "right", 0.5, np.array([0.0, 1.0]), np.array([[0.5, 1.0], end]), end, np.array([1.0, 0.25]))
    assert image_of(form, phase, half, np.array([0.5]), np.ones(2)) == ("in", "left")
    assert image_of(form, phase, half, np.array([-1.0]), np.ones(2)) == image
