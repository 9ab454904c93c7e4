"""Power series of a motion: the rule of every operation, steps and their meshes, and when intervals take over."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from casahunt import effort
from casahunt.collocation.scheme import scheme
from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid import system as engine
from casahunt.motion import march_series, series
from casahunt.motion.phases import Segment, march
from casahunt.motion.recursion import taylor_coefficients
from casahunt.motion.simulation import simulate

# Coefficients ---------------------------------------------------------------------------------------------------------

FIELDS = {
    "products and quotients": lambda x, p, s: (x[1] * x[0] / (1 + x[2] ** 2), s * x[0] - x[1] ** 5, p[0] / x[1] + 2),
    "powers": lambda x, p, s: (ca.sqrt(2 + x[1]) * x[2] ** 3, x[0] ** p[0], x[1] ** -2),
    "varying powers": lambda x, p, s: (p[0] ** x[0], (2 + x[1]) ** x[2], x[0]),
    "exponentials": lambda x, p, s: (ca.exp(-((x[1] / p[0]) ** 2)), ca.log(x[0]) - x[2], ca.sinh(x[0]) + ca.cosh(x[1])),
    "angles": lambda x, p, s: (ca.sin(x[0]) * x[1] - ca.cos(x[0]), ca.tan(x[1]) + ca.atan(x[2]), ca.tanh(x[0])),
    "more": lambda x, p, s: (ca.atanh(x[2]), 1 / x[0] - 2 / ca.cosh(x[1]), x[1] + x[1]),
    "at zero": lambda x, p, s: (1, x[2] ** 4 + ca.sin(x[2]) ** 2, (x[0] - 0.3) ** 7 + x[2]),
    "numbers": lambda x, p, s: (ca.fabs(p[0]) * x[1], ca.if_else(p[0] > 0, x[0], 3 * x[1]), ca.sign(-p[0]) + s),
}  # fmt: skip


@pytest.mark.parametrize("name", FIELDS)
def test_coefficients_are_derivatives(name: str) -> None:
    """By Lie derivatives of the field, one after the other: x^(k) = L_f^k x."""

    def field(x: Any, p: Any, sign: Any) -> Any:
        return ca.vertcat(*FIELDS[name](x, p, sign))

    start, p0, scale, unit = np.array([0.3, 0.4, 0.0 if name == "at zero" else -0.5]), [0.7], [2.0, 0.5, 1.0], 0.25
    function = taylor_coefficients(field, 3, 1, 9)
    assert function is not None
    found = np.array(function(start / scale, 1.5, p0, scale, unit))
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", 1)
    f, derivative = field(x, p, 1.5), x
    for k in range(10):
        value = np.array(ca.Function("d", [x, p], [ca.densify(derivative)])(start, p0)).ravel()
        expected = value * unit**k / math.factorial(k) / scale
        assert found[:, k] == pytest.approx(expected, rel=1e-12, abs=1e-14), k
        derivative = ca.jtimes(derivative, x, f)


@pytest.mark.parametrize(
    "kink", [ca.fabs, ca.sign, ca.floor, lambda x: ca.if_else(x > 0, x, 2 * x), lambda x: ca.fmax(x, 0), ca.asin]
)
def test_what_has_no_rule_has_no_series(kink: Any) -> None:
    assert taylor_coefficients(lambda x, p, sign: ca.vertcat(kink(x[0])), 1, 0, 6) is None


# Motions --------------------------------------------------------------------------------------------------------------


def marched(field: Any, x: list[float], duration: float, tol: float = 1e-8, **of_mode: Any) -> Segment:
    mode = engine.VectorMode("free", lambda x, p, sign: ca.vertcat(*field(x)), **of_mode)
    system = engine.VectorSystem("free", tuple(f"x{i}" for i in range(len(x))), {"free": mode}, {"free": ()})
    (segment,) = march(
        system, "free", np.array(x), np.zeros(0), scale=np.ones(len(x)), until=lambda s: True, tol=tol,
        max_time=duration,
    )  # fmt: skip
    return segment


@pytest.mark.parametrize(("tol", "error"), [(1e-4, 2e-6), (1e-6, 2e-8), (1e-10, 1e-12)])
def test_an_oscillator_for_sixteen_turns(tol: float, error: float) -> None:
    """Hundred steps err by `SERIES_TOLERANCE` of the tolerance each, with nothing solved for."""
    found = marched(lambda x: (x[1], -x[0]), [0.0, 1.0], 100.0, tol)
    assert found.end == pytest.approx([math.sin(100), math.cos(100)], abs=error)
    assert found.duration == pytest.approx(100.0, rel=1e-14)


@pytest.mark.parametrize(("degree", "kind"), [(3, "gauss"), (7, "radau"), (8, "gauss")])
def test_the_mesh_of_a_motion(degree: int, kind: Any) -> None:
    """Every interval is resolved as it was asked for, none is needlessly short, stages lie on the motion."""
    tol, s = 1e-6, scheme(degree, kind)
    swing = engine.VectorMode("swing", lambda x, p, sign: ca.vertcat(x[1], -x[0]))
    form = engine.VectorSystem("swing", ("y", "v"), {"swing": swing}, {"swing": ()})
    (found,) = march(
        form, "swing", np.array([0.0, 1.0]), np.zeros(0), scale=np.ones(2), until=lambda s: True, tol=tol,
        degree=degree, kind=kind, max_time=30.0,
    )  # fmt: skip
    w = found.w.reshape(len(found.w), -1, 2)
    errors = np.max(np.abs(s.last_mode @ w), axis=1)
    assert errors.max() <= tol and np.median(errors) > 1e-3 * tol
    times = found.duration * (found.breaks[:-1, None] + np.diff(found.breaks)[:, None] * s.points)
    np.testing.assert_allclose(w[:, :, 0], np.sin(times), atol=1e-8)
    assert found.breaks[0] == 0 and found.breaks[-1] == 1


@pytest.mark.slow
def test_no_interval_is_left_for_what_rounding_leaves_of_the_time() -> None:
    for k in range(1, 60):
        found = marched(lambda x: (x[1], -x[0]), [0.0, 1.0], 0.1 * k)
        assert np.diff(found.breaks).min() > 1e-3 and found.duration == pytest.approx(0.1 * k, rel=1e-14)


def test_a_mesh_that_would_be_endless_is_refused() -> None:
    with pytest.raises(Exception, match="no exit after 1 s and 20000 intervals; .* marked as stiff$"):
        marched(lambda x: (1e4 * x[1], -1e4 * x[0]), [0.0, 1.0], 1.0, 1e-10)


def test_intervals_that_hide_something_are_halved_until_they_do_not() -> None:
    """Something at a third of the way is seen in intervals of less than 1e-3, and only there they are halved."""
    third = 1 / 3
    C = np.zeros((1, series.SERIES_ORDER + 1, 1))
    C[0, 1] = 1.0  # x = t

    def hidden(states: Any) -> Any:
        begin, end = states[:, 0, 0], states[:, -1, 0]
        return (begin < third) & (third < end) & (end - begin > 1e-3)

    motion = series.Piece(np.zeros(1), np.ones(1), C)
    breaks, _ = series.meshed([motion], scheme(6, "gauss"), 1e-6, hidden, 1000)
    k = int(np.searchsorted(breaks, third))
    assert breaks[k] - breaks[k - 1] <= 1e-3 and np.diff(breaks).max() > 0.1


# What series do not see -----------------------------------------------------------------------------------------------

HIGH = 50.0


def test_a_step_is_right_where_its_polynomial_is_the_motion() -> None:
    """x' = x, scaled: the Taylor polynomial of exp; not with a wrong coefficient, another rate or another length."""
    of = series.series_of(lambda x, p, sign: x, 1.0, np.zeros(0), np.array([2.0]))
    assert of is not None
    h, theta = 0.1, 1e-12
    C = np.array([[h**k / math.factorial(k)] for k in range(len(of(np.ones(1), h, h, h, theta).C[0]))])
    assert march_series._is_right(of, C, h, theta) and march_series._right_part(of, C, h, theta) > 0.5
    wrong = C.copy()
    wrong[3] *= 1 + 1e-4
    for other, length in ((wrong, h), (C * 2.0 ** np.arange(len(C))[:, None], h), (C, 1.01 * h)):
        assert not march_series._is_right(of, other, length, theta)


def way(width: float, to: float, at: float = 5.0) -> engine.VectorSystem:
    """x' = 1 + a bump, up to a place."""

    runs = engine.VectorMode("runs", lambda x, p, sign: ca.vertcat(1 + HIGH * ca.exp(-(((x[0] - at) / width) ** 2))),
                       feature=lambda x, p: np.exp(-(((x[0] - at) / width) ** 2)))  # fmt: skip
    there = engine.Exit(
        engine.VectorEvent("there", lambda x, T, p: (x[0] - to) / 10), +1, lambda x, p: "runs", mark=True
    )
    return engine.VectorSystem("way", ("x",), {"runs": runs}, {"runs": (there,)})


def time_to(width: float, to: float, at: float = 5.0) -> float:
    """The time from 0."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    low, high = max(at - 8 * width, 0.0), min(to, at + 8 * width)
    x = low + (high - low) * (nodes + 1) / 2
    inside = float(np.sum(weights / (1 + HIGH * np.exp(-(((x - at) / width) ** 2)))) * (high - low) / 2)
    return low + inside + max(to - high, 0.0)


@pytest.mark.parametrize(("width", "to"), [(1e-3, 5.0), (0.4, 5.0), (0.4, 9.0)])
def test_a_step_does_not_pass_over_what_is_hidden(width: float, to: float) -> None:
    """A bump in the middle of the way, of which the series at its foot knows nothing; the event on it, or behind."""
    (found,) = march(
        way(width, to), "runs", np.zeros(1), np.zeros(0), scale=np.full(1, 10.0), until=lambda s: True, tol=1e-8
    )
    assert found.duration == pytest.approx(time_to(width, to), rel=1e-9)


@pytest.mark.parametrize("at", [2.5, 5.0, 6.3])
def test_nor_a_step_that_meets_no_event(at: float) -> None:
    """Nor the part of it that is kept, whose slope at the end is right on the far side of the bump too."""
    (found,) = march(
        way(0.4, 1e3, at), "runs", np.zeros(1), np.zeros(0), scale=np.full(1, 10.0), until=lambda s: True, tol=1e-8,
        max_time=9.0,
    )  # fmt: skip
    assert time_to(0.4, float(found.end[0]), at) == pytest.approx(9.0, rel=1e-9)


def test_a_slope_that_is_another_one_at_the_end_of_a_step() -> None:
    """The field falls off to nothing at one, as seen from zero suddenly: nothing is named, but the slopes do not meet.

    t = x + e (exp((x - 1)/e) - exp(-1/e)).
    """
    e = 1e-2

    def field(x: Any) -> tuple[Any, ...]:
        return (1 / (1 + ca.exp((x[0] - 1) / e)),)

    found = marched(field, [0.0], 3.0, 1e-8)
    x = float(found.end[0])
    assert x + e * (math.exp((x - 1) / e) - math.exp(-1 / e)) == pytest.approx(3.0, rel=1e-7)


# When intervals take over ---------------------------------------------------------------------------------------------


def test_a_kink_is_left_to_intervals() -> None:
    found = marched(lambda x: (1 + ca.fabs(x[0]),), [0.0], 1.0)
    assert found.end[0] == pytest.approx(math.e - 1, rel=1e-10)


def test_a_start_without_a_series() -> None:
    """x' = 1 + x^(3/2) from 0, where it has one derivative: t = integral of dx / (1 + x^(3/2)), with x = y^2."""
    found = marched(lambda x: (1 + x[0] ** 1.5,), [0.0], 1.0)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    y = math.sqrt(found.end[0]) * (nodes + 1) / 2
    time = float(np.sum(weights * 2 * y / (1 + y**3))) * math.sqrt(found.end[0]) / 2
    assert time == pytest.approx(1.0, rel=1e-7)


def test_a_stiff_mode_that_nobody_calls_stiff() -> None:
    """x' = -k (x - sin t) + cos t, x = sin t: 1e5 steps of a series, and a few dozen intervals."""
    k = 1e5
    with effort.counting_work(None) as watch:
        found = marched(lambda x: (-k * (x[0] - ca.sin(x[1])) + ca.cos(x[1]), 1.0), [0.0, 0.0], 10.0, 1e-8)
    assert found.end[0] == pytest.approx(math.sin(10), abs=1e-8)
    assert watch.work < 200 * effort.MARCHED


def test_an_event_where_the_time_is_over_is_met() -> None:
    """Twenty turns end on an event, but for rounding: it ends the motion, and none begins on it."""
    tick = Event("tick", lambda x, p: x.s - 1, +1, to="on", reset=lambda x, p: {"s": 0})
    clock = System("clock", ("s",), {"T": 400e-6}, (Mode("on", lambda x, p: {"s": 1 / p.T}, ends=(tick,)),))
    for turns in (1, 3, 20):
        motion = simulate(clock, s=0.0, duration=turns * 400e-6)
        s = motion.end["s"]
        assert len(motion.events) == turns and min(s, 1 - s) < 1e-12


def test_steps_of_a_motion_at_rest_are_long() -> None:
    found = marched(lambda x: (0 * x[0],), [2.0], 1e9)
    assert found.end[0] == 2.0 and found.duration == pytest.approx(1e9) and len(found.w) < 60
    assert series.AT_MOST_LONGER > 1
