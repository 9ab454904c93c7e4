"""Extrema over cycles against closed forms: inside intervals, at ends of phases, in closed forms, of expressions."""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np
import pytest

from casahunt.errors import InputError
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import Options, find_cycle
from casahunt.orbits.event_passage import passed, turning_values
from casahunt.orbits.orbit import Orbit, unknowns_of

TOLERANCES = (1e-4, 1e-7, 1e-10)


def assert_extreme(found, value: float, *, size: float = 1.0) -> None:
    """The error estimate holds within a factor of ten, and rounding."""
    assert abs(found.value - value) <= 10 * found.error + 1e-13 * size


def highest(function) -> float:
    """The largest value over a turn: at 20,000 times, and at as many around the best of them."""
    t = np.linspace(0, 2 * math.pi, 20_001)
    best = t[np.argmax(function(t))]
    return float(function(best + np.linspace(-t[1], t[1], 20_001)).max())


# A circle -------------------------------------------------------------------------------------------------------------


@cache
def circle(tol: float, rate: float = 1.0, degree: int | None = None) -> Orbit:
    """The unit circle, turned about (0.3, 0) so that nothing is symmetric: x from -0.7 to 1.3, cut anywhere."""

    def field(x, p):
        u = x.x - p.off
        grows = p.rate * (1 - u**2 - x.y**2)
        return {"x": grows * u - p.omega * x.y, "y": grows * x.y + p.omega * u}

    system = System("circle", ("x", "y"), {"omega": 1.3, "off": 0.3, "rate": rate}, (Mode("smooth", field),))
    return find_cycle(system, x=1.0, y=0.0, options=Options(tol=tol, degree=degree))


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("level", [0.0, 0.37, -0.69])
def test_where_an_expression_is_zero(tol, level):
    """The circle at x = level: y = -+sqrt(1 - (level - 0.3)^2), twice a turn, the time between them an arc."""
    orbit = circle(tol)
    found = orbit.crossings(lambda x, p: x.x - level)
    y = math.sqrt(1 - (level - 0.3) ** 2)
    error = 10 * orbit.error_estimate + 1e-13
    assert found.states[0] == pytest.approx([level, level], abs=1e-13)
    assert np.sort(found.states[1]) == pytest.approx([-y, y], abs=error / y)
    assert np.sort(found.rates) == pytest.approx([-1.3 * y, 1.3 * y], rel=error / y**2)
    arc = 2 * math.acos(level - 0.3) / 1.3
    between = float(np.diff(found.times)[0])
    assert min(abs(between - arc), abs(orbit.period - between - arc)) < error * orbit.period / y


def test_a_zero_next_to_a_point_that_the_polynomial_puts_on_its_other_side():
    """Levels that polynomials of a coarse orbit reach at the points at which they are looked at, or a little beside."""
    orbit = circle(1e-4)
    x = orbit.sample(16)[1][0]
    for level in x[np.abs(x - 0.3) < 0.9][:40]:
        for beside in (-1e-7, 0.0, 1e-7):
            found = orbit.crossings(lambda x, p, at=level + beside: x.x - at)
            assert found.states[0] == pytest.approx([level + beside] * 2, abs=1e-13)


def test_where_half_a_cycle_is_zero():
    """A circle about the origin, of which half is computed: at y = 0.6 on both sides, -0.6 in the other half."""

    def field(x, p):
        grows = 1 - x.x**2 - x.y**2
        return {"x": grows * x.x - p.omega * x.y, "y": grows * x.y + p.omega * x.x}

    system = System("circle", ("x", "y"), {"omega": 1.3}, (Mode("smooth", field),))
    orbit = find_cycle(system, options=Options(tol=1e-9, half=True), x=1.0, y=0.1)
    assert orbit.half
    for level in (0.6, -0.6):
        found = orbit.crossings(lambda x, p, level=level: x.y - level)
        assert found.states == pytest.approx(np.array([0.8 * np.sign(found.rates), [level, level]]), abs=1e-8)
        assert np.all(np.diff(found.times) > 0) and 0 <= found.times[0] and found.times[1] < orbit.period
    assert np.diff(orbit.crossings("y").times) == pytest.approx([orbit.period / 2], rel=1e-8)


def test_the_time_of_a_place_in_a_later_phase():
    """A circle cut where y passes zero: y is smallest half a turn after it is largest, in the other phase."""

    def field(x, p):
        u = x.x - 0.3
        grows = 1 - u**2 - x.y**2
        return {"x": grows * u - p.omega * x.y, "y": grows * x.y + p.omega * u}

    upper = Mode("upper", field, ends=(Event("falls", lambda x, p: x.y, direction=-1, to="lower"),))
    lower = Mode("lower", field, ends=(Event("rises", lambda x, p: x.y, direction=+1, to="upper"),))
    system = System("circle in halves", ("x", "y"), {"omega": 1.3}, (upper, lower))
    orbit = find_cycle(system, "upper", x=1.0, y=0.1, tol=1e-9)
    assert len(orbit.arcs) == 2
    y, turn = orbit.extrema("y"), 2 * math.pi / 1.3
    assert_extreme(y.low, -1.0)
    assert (y.low.time - y.high.time) % turn == pytest.approx(turn / 2, rel=1e-6)
    assert min(y.low.time, y.high.time) == pytest.approx(turn / 4, rel=1e-6)


@pytest.mark.parametrize("tol", TOLERANCES)
def test_a_circle(tol):
    orbit = circle(tol)
    assert orbit.repeats == 1
    x, y = orbit.extrema("x"), orbit.extrema("y")
    for found, value in ((x.low, -0.7), (x.high, 1.3), (y.low, -1.0), (y.high, 1.0)):
        assert_extreme(found, value)
        assert abs(found.value - value) <= 10 * tol
    assert x.amplitude == x.high.value and x.high.error < tol
    quarter = 2 * math.pi / 1.3 / 4
    assert (y.high.time - x.high.time) % (4 * quarter) == pytest.approx(quarter, rel=1e-3 if tol > 1e-5 else 1e-6)
    ahead = orbit.extrema(lambda x, p: x.x + x.y + p.off)
    assert_extreme(ahead.high, 0.6 + math.sqrt(2))
    assert_extreme(ahead.low, 0.6 - math.sqrt(2))


@pytest.mark.parametrize("tol", TOLERANCES[:2])
def test_a_circle_that_forgets_its_errors(tol):
    """Errors of the nodes before fade on the way to the place: what is left is that of the last step."""
    orbit = circle(tol, rate=30.0)
    y = orbit.extrema("y")
    assert_extreme(y.low, -1.0)
    assert_extreme(y.high, 1.0)
    ahead = orbit.extrema(lambda x, p: x.x + x.y)
    assert_extreme(ahead.high, 0.3 + math.sqrt(2))


@pytest.mark.parametrize("degree", [2, 3])
def test_the_error_of_the_last_step_is_that_of_its_length(degree):
    """At eleven places of their intervals, each (s/h)^2d of what the whole interval adds: the estimate is the error."""
    orbit = circle(1e-5, rate=30.0, degree=degree)
    for angle in np.arange(0.1, 2 * math.pi, 0.6):
        ahead = orbit.extrema(lambda x, p, a=angle: (x.x - p.off) * math.cos(a) + x.y * math.sin(a)).high
        assert ahead.error == pytest.approx(abs(ahead.value - 1), rel=0.3) and ahead.error > 1e-9


@pytest.mark.parametrize("angle", [0.5, 2.0, 4.0, 5.5])
def test_what_is_passed_between_two_looks(angle):
    """One direction turns at 1: a level 1e-9 below the top is passed, one above it is not."""
    orbit = circle(1e-10)
    t, u, setting = unknowns_of(orbit)
    ahead = lambda x, p: (x[0] - 0.3) * math.cos(angle) + x[1] * math.sin(angle)  # noqa: E731
    x, y = orbit.arcs[0].states[0, 0]
    begins = math.atan2(y, x - 0.3)  # half a turn, and the other
    here, other = (0, 1) if (angle - begins) % (2 * math.pi) < math.pi else (1, 0)
    assert t.phases == 2
    assert turning_values(t, u, setting, ahead, here, +1) == pytest.approx([1.0], abs=1e-11)
    assert turning_values(t, u, setting, ahead, other, -1) == pytest.approx([-1.0], abs=1e-11)
    for level, slack, expected in ((0.99, 0, True), (1 - 1e-9, 0, True), (1 - 1e-9, 1e-8, False), (1 + 1e-9, 0, False)):
        beside = lambda x, p, level=level: ahead(x, p) - level  # noqa: E731
        assert passed(t, u, setting, beside, here, +1, slack=slack) is expected
        assert not passed(t, u, setting, beside, other, +1, slack=slack)


def test_an_expression_that_is_constant():
    radius = circle(1e-9).extrema(lambda x, p: (x.x - p.off) ** 2 + x.y**2)
    assert radius.low.value == pytest.approx(1.0, abs=1e-8) and radius.high.value == pytest.approx(1.0, abs=1e-8)


def test_what_is_no_scalar_is_refused():
    orbit = circle(1e-4)
    with pytest.raises(InputError, match="^unknown state 'z'"):
        orbit.extrema("z")
    with pytest.raises(InputError, match="^3: must be the name of a state or a function"):
        orbit.extrema(3)
    with pytest.raises(InputError, match=r"must be a scalar, not one of shape \(2, 1\)"):
        orbit.extrema(lambda x, p: ca.vertcat(x.x, x.y))
    with pytest.raises(InputError, match="^there is no state 'z'"):
        orbit.extrema(lambda x, p: x.z)
    with pytest.raises(InputError, match="must be a scalar: one made of the states"):
        orbit.extrema(lambda x, p: (x.x, x.y))
    with pytest.raises(InputError, match=r"casadi\.sin for math\.sin"):
        orbit.extrema(lambda x, p: math.sin(x.x))
    with pytest.raises(InputError, match="per_interval = 0: must be a whole number, at least 1"):
        orbit.sample(0)


# Forced: several extrema in a turn ----------------------------------------------------------------------------------


@pytest.mark.parametrize("tol", TOLERANCES)
def test_two_harmonics(tol):
    """x = cos t + 0.8 cos(2 t + 1) solves x'' + d x' + k x = force, the force made for it; four extrema in a turn."""
    d, k = 0.6, 3.0

    def force(t):
        first = (k - 1) * ca.cos(t) - d * ca.sin(t)
        return first + 0.8 * ((k - 4) * ca.cos(2 * t + 1) - 2 * d * ca.sin(2 * t + 1))

    free = Mode("free", lambda x, p: {"x": x.v, "v": force(x.t) - p.d * x.v - p.k * x.x})
    values = {"d": d, "k": k}
    system = System("harmonics", ("x", "v"), values, (free,), forcing_period=lambda p: 2 * math.pi)
    orbit = find_cycle(system, x=1.4, v=-1.3, tol=tol)

    def x(t):
        return np.cos(t) + 0.8 * np.cos(2 * t + 1)

    def v(t):
        return -np.sin(t) - 1.6 * np.sin(2 * t + 1)

    def stored(t):
        return (v(t) ** 2 + k * x(t) ** 2) / 2

    energy = orbit.extrema(lambda x, p: (x.v**2 + p.k * x.x**2) / 2)
    for found, exact in ((orbit.extrema("x"), x), (orbit.extrema("v"), v), (energy, stored)):
        assert_extreme(found.low, -highest(lambda t, g=exact: -g(t)), size=100)
        assert_extreme(found.high, highest(exact), size=100)
    kick = orbit.extrema(lambda x, p: ca.cos(x.t) * x.x)  # the time is a state like the others
    assert_extreme(kick.high, highest(lambda t: np.cos(t) * x(t)), size=100)


# Half cycles ----------------------------------------------------------------------------------------------------------


def test_the_other_half():
    """Only the half that is computed is looked at, and the other by the symmetry."""
    smooth = Mode("smooth", lambda x, p: {"x": x.v, "v": (1 - x.x**2) * x.v - x.x})
    orbit = find_cycle(System("van der Pol", ("x", "v"), {"mu": 1.0}, (smooth,)), x=2.0, v=0.0, tol=1e-10)
    assert orbit.repeats == 2
    x, v = orbit.extrema("x"), orbit.extrema("v")
    assert_extreme(x.high, 2.00861986087484313651)
    assert_extreme(x.low, -2.00861986087484313651)
    assert v.low.value == pytest.approx(-v.high.value, rel=1e-10)
    assert abs(x.high.time - x.low.time) == pytest.approx(orbit.period / 2, rel=1e-9)
    t, states = orbit.sample(200)
    lopsided = orbit.extrema(lambda x, p: x.x + 0.3 * x.v**2)
    values = states[0] + 0.3 * states[1] ** 2
    assert lopsided.high.value == pytest.approx(values.max(), abs=1e-3)
    assert lopsided.low.value == pytest.approx(values.min(), abs=1e-3)
    assert lopsided.high.value > values.max() - 1e-6 and lopsided.low.value < values.min() + 1e-6


# Phases ---------------------------------------------------------------------------------------------------------------


def saw(tol: float = 1e-9) -> Orbit:
    """A relay in closed form: x between -1 and 1, both at ends of phases; y = 1 - (t - 1/2)^2 inside each."""

    def moves(rate):
        return lambda x, t, p: {"x": x.x + rate * t, "y": x.y + x.z * t - t**2, "z": x.z - 2 * t}

    def restarts(x, p):
        return {"y": 0.75, "z": 1.0}

    up = Mode("up", flow=moves(2), ends=(Event("high", lambda x, p: x.x - 1, +1, to="down", reset=restarts),))
    down = Mode("down", flow=moves(-2), ends=(Event("low", lambda x, p: x.x + 1, -1, to="up", reset=restarts),))
    return find_cycle(System("saw", ("x", "y", "z"), {}, (up, down)), x=-1.0, y=0.75, z=1.0, tol=tol)


def test_at_the_ends_of_phases_and_inside_closed_forms():
    orbit = saw()
    assert orbit.period == pytest.approx(2.0, rel=1e-13)
    x, y, z = (orbit.extrema(name) for name in ("x", "y", "z"))
    assert_extreme(x.low, -1.0)
    assert_extreme(x.high, 1.0)
    assert_extreme(y.high, 1.0)
    assert_extreme(y.low, 0.75)
    assert_extreme(z.low, -1.0)  # in front of the jump
    assert_extreme(z.high, 1.0)  # behind it
    assert y.high.time % 1 == pytest.approx(0.5, abs=1e-9)
    assert orbit.amplitude == pytest.approx(1.0, rel=1e-12)


def test_the_apex_of_a_ball():
    """It is thrown up again by a table that does not move: v+ = kick, so x = kick^2 / (2 g) at the top."""
    kicked = Event("hits", lambda x, p: x.x, -1, to="flight", reset=lambda x, p: {"v": p.kick})
    for flight in (
        Mode("flight", lambda x, p: {"x": x.v, "v": -p.g}, holds=lambda x, p: x.x, ends=(kicked,)),
        Mode("flight", flow=lambda x, t, p: {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t},
             holds=lambda x, p: x.x, ends=(kicked,)),
    ):  # fmt: skip
        system = System("ball", ("x", "v"), {"g": 9.81, "kick": 3.0}, (flight,))
        orbit = find_cycle(system, x=1.0, v=0.0, tol=1e-9)
        assert orbit.period == pytest.approx(6 / 9.81, rel=1e-12)
        x = orbit.extrema("x")
        assert_extreme(x.high, 9 / (2 * 9.81))
        assert x.low.value == pytest.approx(0.0, abs=1e-12)
        assert x.high.time == pytest.approx(3 / 9.81, rel=1e-9)
        assert_extreme(orbit.extrema("v").high, 3.0)
        assert_extreme(orbit.extrema("v").low, -3.0)
        energy = orbit.extrema(lambda x, p: p.g * x.x + x.v**2 / 2)
        assert energy.low.value == pytest.approx(4.5, rel=1e-12) and energy.high.value == pytest.approx(4.5, rel=1e-12)
