"""Is a root a motion?  Conditions that are polynomials, whose smallest values and Legendre coefficients are known."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from layout import cycle_of, laid_out, still

from casahunt.collocation.admissibility import (
    Admissibility,
    admissible_many,
    check_admissible,
    hides,
    judged_on_halves,
)
from casahunt.collocation.resolution import RESOLUTION
from casahunt.collocation.transcription import Setting, settings_of
from casahunt.hybrid.system import Exit, VectorEvent, VectorMode

FREE = VectorMode("free", still)
POSITIVE = VectorMode("climb", still, admissible=lambda x, p, sign: sign * x[0], sign=1.0)
KEPT = replace(POSITIVE, name="rest", flow=lambda x, T, p: x)
SCALE = np.array([2.0, 5.0])


def zero(tau):
    return 0 * tau


def one(tau):
    return 1 + 0 * tau


def judged(modes, breaks, functions, *, durations=None, degree=4, kind="gauss", second=None) -> Admissibility:
    """The verdict on phases whose states are functions[k] and second[k] of the time as a fraction of the phase."""
    motions = [
        lambda tau, f=f, g=g: np.stack([f(tau), g(tau)], axis=1) / SCALE
        for f, g in zip(functions, second or [zero] * len(modes), strict=True)
    ]
    durations = durations or [1.0] * len(modes)
    t, u, fractions = laid_out(cycle_of(*modes), breaks, motions, durations, degree=degree, kind=kind)
    setting = Setting(fractions, np.zeros(1), SCALE, np.zeros(1))
    found = check_admissible(t, u, setting)
    many = settings_of(setting, np.zeros((2, 1)), np.zeros((2, 1)))
    admitted = admissible_many(t, np.stack([u, np.full_like(u, np.nan)]), many).tolist()
    within_slack = any(mode.slack for mode in modes) and not admitted[0]
    assert within_slack or admitted == [found.admissible, False]
    return found


ONE, FOUR = np.array([0.0, 1.0]), np.array([0, 0.2, 0.5, 0.75, 1.0])


def well(bottom: float, at: float = 0.625):
    """(tau - at)^2 + bottom: its last Legendre coefficient is zero, so nothing is left to doubt."""
    return lambda tau: (tau - at) ** 2 + bottom


@pytest.mark.parametrize("kind", ["gauss", "radau"])
@pytest.mark.parametrize("phase", [0, 1])
def test_a_condition_that_fails_inside_an_interval(phase, kind):
    functions = [one, one]
    functions[phase] = well(1e-3)
    found = judged([POSITIVE, POSITIVE], [FOUR, FOUR], functions, kind=kind)
    assert found.admissible and found.phase == -1 and not found.unclear.any()
    for bottom in (-1e-3, -0.1):
        functions[phase] = well(bottom)
        found = judged([POSITIVE, POSITIVE], [FOUR, FOUR], functions, kind=kind)
        assert not found.admissible and found.phase == phase
        assert f"phase {phase + 1} is no climb" in found.violated
        assert float(found.violated.rpartition(" ")[2]) == pytest.approx(bottom, rel=1e-2)


def test_a_condition_may_fall_by_its_slack_and_by_rounding():
    loose = replace(POSITIVE, slack=0.01)
    assert judged([loose], [FOUR], [well(-0.009)]).admissible
    assert judged([loose], [FOUR], [well(-0.011)]).violated
    assert judged([POSITIVE], [FOUR], [well(-5e-11)]).violated == ""
    assert judged([POSITIVE], [FOUR], [well(-5e-9)]).violated
    assert judged([POSITIVE], [FOUR], [lambda tau: 1e3 * well(-5e-12)(tau)]).violated == ""
    assert judged([POSITIVE], [FOUR], [lambda tau: 1e3 * well(-5e-11)(tau)]).violated


def test_the_sign_of_the_mode_is_that_of_its_condition():
    backwards = replace(POSITIVE, sign=-1.0)
    assert judged([backwards], [FOUR], [lambda tau: -one(tau)]).admissible
    assert judged([backwards], [FOUR], [one]).violated


def test_a_closed_form_is_judged_at_its_ends():
    assert judged([POSITIVE, KEPT, POSITIVE], [FOUR, ONE, FOUR], [one, one, one]).admissible
    for start, slope in ((-0.5, 1.5), (1.0, -1.5)):
        moved = replace(KEPT, flow=lambda x, T, p, slope=slope: ca.vertcat(x[0] + slope * T, x[1]))
        # The phase after it starts where it ends, at the condition of another mode.
        found = judged([POSITIVE, moved, FREE], [FOUR, ONE, FOUR], [
            one, lambda tau, v=start: v + 0 * tau, lambda tau, v=start + slope: v + 0 * tau
        ])  # fmt: skip
        assert found.phase == 1 and "phase 2 is no rest: its condition falls to -0.5" in found.violated


def test_a_closed_form_that_is_straight_may_fail_half_way():
    """|x| - 1/4 from -1 to 1, of either kind: a kink, and none."""
    for condition in (lambda x, p, sign: abs(x[0]) - 0.25, lambda x, p, sign: x[0] ** 2 - 0.25):
        across = replace(KEPT, admissible=condition, flow=lambda x, T, p: ca.vertcat(x[0] + 2 * T, x[1]))
        found = judged([FREE, across, FREE], [FOUR, ONE, FOUR], [lambda tau: -one(tau), lambda tau: -one(tau), one])
        assert found.violated == "phase 2 is no rest: its condition falls to -0.25"


@pytest.mark.parametrize("fails", [False, True])
def test_a_condition_with_a_kink_is_judged_where_it_is(fails):
    """The polynomial through its values swings below zero next to a kink; below zero it is only where it is said to."""
    at, falls = 0.95, 1.2 if fails else 1.0
    kinked = replace(FREE, admissible=lambda x, p, sign: ca.fmin(x[0] / at, (1 - falls * x[0]) / (1 - at)))
    found = judged([kinked, kinked], [np.array([0, 0.5, 1.0])] * 2, [lambda tau: tau] * 2, degree=8)
    assert bool(found.violated) == fails
    assert fails or found.unclear.tolist() == [False, True] * 2


@pytest.mark.parametrize(("bend", "lowest"), [(1.0, 0.25), (4.0, -0.5)])
def test_a_closed_form_that_bends_is_judged_in_between(bend, lowest):
    """From 1/2 and back to it, with 1/2 - bend/4 half-way."""
    bent = replace(POSITIVE, name="bent", flow=lambda x, T, p: ca.vertcat(x[0] + bend * T * (T - 1), x[1]))
    found = judged([bent, POSITIVE], [ONE, FOUR], [lambda tau: one(tau) / 2] * 2)
    assert found.violated == ("" if lowest > 0 else f"phase 1 is no bent: its condition falls to {lowest:.3g}")


def test_a_phase_of_no_duration_is_none():
    for shortest in (0.0, -0.25):
        found = judged([POSITIVE, FREE], [FOUR, FOUR], [one, one], durations=[1.0, shortest])
        assert found.phase == 1 and f"phase 2 (free) has the duration {shortest:.3g} s" in found.violated


def wave(least: float):
    """Legendre's P_4 on the interval (0, 1), whose smallest value is -3/7, plus 3/7 and `least`."""
    return lambda tau: np.polynomial.legendre.legval(2 * tau - 1, [0, 0, 0, 0, 1]) + 3 / 7 + least


@pytest.mark.parametrize("phase", [0, 1])
def test_known_to_a_few_times_the_last_legendre_coefficient(phase):
    """That coefficient is 1 here."""
    assert RESOLUTION == 3.0
    for least, unclear, violated in ((3.1, False, False), (2.5, True, False), (-2.9, True, False), (-3.1, True, True)):
        functions, breaks = [lambda tau: 9 + 0 * tau] * 2, [FOUR, FOUR]
        functions[phase], breaks[phase] = wave(least), ONE
        found = judged([POSITIVE, POSITIVE], breaks, functions)
        assert bool(found.violated) is violated
        assert found.admissible is not (unclear or violated)
        expected = np.zeros(5, dtype=bool)
        expected[4 * phase] = unclear
        np.testing.assert_array_equal(found.unclear, expected)


SHAPES = {
    "start": lambda tau: tau, "end": lambda tau: 1 - tau, "both": lambda tau: tau * (1 - tau),
    "as a square": lambda tau: tau**2,
}  # fmt: skip


@pytest.mark.parametrize("kind", ["gauss", "radau"])
@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize("name", SHAPES)
def test_a_condition_may_vanish_at_the_ends_of_a_phase(name, degree, kind):
    """There its slope counts; that of a straight line, and of a parabola from its foot, is in no doubt."""
    if degree == 2 and name == "both":
        return  # three points: nothing is left that could tell
    for breaks in (ONE, FOUR):
        found = judged([POSITIVE], [breaks], [SHAPES[name]], degree=degree, kind=kind)
        # A parabola on a later interval is in doubt at degree 2, its own last coefficient.
        assert found.violated == "" and not found.unclear[: 1 if degree == 2 else None].any()
        if degree > 2:
            below = judged([POSITIVE], [breaks], [lambda tau: -1e-3 * SHAPES[name](tau)], degree=degree, kind=kind)
            assert "no climb" in below.violated


@pytest.mark.parametrize("name", ["start", "end", "both"])
def test_what_is_left_when_the_zeros_are_divided_out_must_be_clear(name):
    """At Radau points of degree 4: a polynomial of degree 3, or 2, with the last coefficient 1; above 3 or below."""
    series = np.eye(4)[2 if name == "both" else 3]
    lowest = np.polynomial.legendre.legval(np.linspace(-1, 1, 1001), series).min()
    for least, unclear in ((3.2, False), (1.0, True)):

        def condition(tau, least=least):
            return SHAPES[name](tau) * (np.polynomial.legendre.legval(2 * tau - 1, series) - lowest + least)

        found = judged([POSITIVE], [ONE], [condition], kind="radau")
        assert found.violated == "" and found.unclear.tolist() == [unclear]


# Features ----------------------------------------------------------------------------------------------------------

SUDDEN = VectorMode("sudden", still, feature=lambda x, p: x[1])


@pytest.mark.parametrize("phase", [0, 1])
@pytest.mark.parametrize(("interval", "where"), [(0, 0.4), (2, 0.6), (2, 0.99), (3, 0.99), (3, 0.01)])
def test_a_feature_that_jumps_between_two_points(phase, interval, where):
    """0.99 of an interval lies behind its last Gauss point: the end alone shows it."""
    at = FOUR[interval] + where * (FOUR[interval + 1] - FOUR[interval])
    modes = [FREE, FREE]
    modes[phase] = SUDDEN
    for size, hidden in ((0.85, False), (0.95, True)):
        second = [zero, lambda tau, size=size: size * one(tau)]
        second[phase] = lambda tau, size=size: size * (tau > at)
        found = judged(modes, [FOUR, FOUR], [one, one], second=second)
        expected = np.zeros(8, dtype=bool)
        expected[4 * phase + interval] = hidden
        np.testing.assert_array_equal(found.unclear, expected)
        assert found.admissible is not hidden


def test_a_march_is_told_of_smaller_jumps():
    points = np.zeros((3, 4, 2))
    points[0, 2:, 1], points[1, 2:, 1], points[2, :, 1] = 0.45, -0.55, 7.0
    assert hides(lambda x, p: p * x[1], points, np.array([1.0])).tolist() == [False, True, False]
    assert hides(lambda x, p: p * x[1], points, np.array([1.0]), largest=0.4).tolist() == [True, True, False]


def test_what_halves_make_of_a_solution_is_judged():
    """By whole intervals: those with a half that is not clear, or all of a phase that is wrong elsewhere."""
    coarse = cycle_of(POSITIVE, POSITIVE)

    def halves(dip, last=1.0):
        motions = [lambda tau: np.stack([one(tau), zero(tau)], axis=1) / SCALE,
                   lambda tau: np.stack([1 - dip * (abs(tau - 0.4) < 0.09), zero(tau)], axis=1) / SCALE]  # fmt: skip
        t, u, fractions = laid_out(coarse, [np.linspace(0, 1, 5), np.linspace(0, 1, 9)], motions, [1.0, last], degree=4)
        return t, u, Setting(fractions, np.zeros(1), SCALE, np.zeros(1))

    t = laid_out(coarse, [np.linspace(0, 1, 3), np.linspace(0, 1, 5)], [lambda tau: np.zeros((tau.size, 2))] * 2,
                 [1.0, 1.0], degree=4)[0]  # fmt: skip

    def unclear(better) -> list[int]:
        clear = Admissibility("", -1, np.zeros(t.intervals, dtype=bool))
        return np.flatnonzero(judged_on_halves(t, clear, better).unclear).tolist()

    assert unclear(None) == unclear(halves(0.0)) == []
    assert unclear(halves(1.1)) == [3] and unclear(halves(0.0, last=-1.0)) == [2, 3, 4, 5]


# Many at once ------------------------------------------------------------------------------------------------------


def solution(mode, value, count=3):
    """A phase at rest at x[0] = `value`, as so many members."""
    t, u, fractions = laid_out(cycle_of(mode), [FOUR], [lambda tau: np.tile([value, 0.0], (tau.size, 1)) / SCALE],
                               [1.0], degree=4)  # fmt: skip
    setting = Setting(fractions, np.zeros(1), SCALE, np.zeros(1))
    return t, np.repeat(u[None], count, axis=0), settings_of(setting, np.zeros((count, 1)), np.zeros((count, 1)))


def test_a_member_has_no_slack():
    """Within its slack a condition is another mode's affair, of which no error estimate knows."""
    t, u, settings = solution(replace(POSITIVE, slack=0.01), -0.005)
    assert check_admissible(t, u[0], settings.of(0)).admissible
    assert not admissible_many(t, u, settings).any()


def test_a_condition_that_takes_numbers_alone():
    numeric = replace(POSITIVE, admissible=lambda x, p, sign: np.array([float(value) for value in np.ravel(x[0])]))
    for value, expected in ((1.0, True), (-1.0, False)):
        t, u, settings = solution(numeric, value)
        assert admissible_many(t, u, settings).tolist() == [expected] * 3


def test_an_event_of_the_mode_is_not_passed():
    """x[0] rises through zero in the middle of the phase of the second member alone."""
    way_out = Exit(VectorEvent("wall", lambda x, T, p: x[0]), +1, lambda x, p: "another")
    cycle = cycle_of(FREE)
    _, u, fractions = laid_out(cycle, [FOUR], [lambda tau: np.stack([one(tau), zero(tau)], axis=1)], [1.0], degree=4)
    crossing = laid_out(cycle, [FOUR], [lambda tau: np.stack([tau - 0.6, zero(tau)], axis=1)], [1.0], degree=4)[1]
    setting = Setting(fractions, np.zeros(1), SCALE, np.zeros(1))
    many = settings_of(setting, np.zeros((2, 1)), np.zeros((2, 1)))
    for exits, expected in (((), [True, True]), ((way_out,), [True, False])):
        there = replace(cycle, phases=(replace(cycle.phases[0], exits=exits),))
        known = laid_out(there, [FOUR], [lambda tau: np.stack([one(tau), zero(tau)], axis=1)], [1.0], degree=4)[0]
        assert admissible_many(known, np.stack([u, crossing]), many).tolist() == expected


@pytest.mark.parametrize(
    ("below", "above", "passed"),
    [(2e-6, 2e-6, True), (0.5e-6, 2e-6, False), (2e-6, 0.5e-6, False), (100.0, 2e-4, True), (100.0, 0.5e-4, False)],
)
def test_how_far_beyond_an_event_it_is_passed(below, above, passed):
    """PASSED of the largest value, of at least one: along a straight line, of which nothing is in doubt."""
    way_out = Exit(VectorEvent("wall", lambda x, T, p: x[0]), +1, lambda x, p: "another")
    free = cycle_of(FREE)
    cycle = replace(free, phases=(replace(free.phases[0], exits=(way_out,)),))
    line = [lambda tau: np.stack([(above + below) * tau - below, zero(tau)], axis=1) / SCALE]
    t, u, fractions = laid_out(cycle, [FOUR], line, [1.0], degree=4)
    setting = Setting(fractions, np.zeros(1), SCALE, np.zeros(1))
    assert check_admissible(t, u, setting).violated == ("phase 1 (free) passes 'wall'" if passed else "")
    many = settings_of(setting, np.zeros((1, 1)), np.zeros((1, 1)))
    assert admissible_many(t, u[None], many).item() is not passed


@pytest.mark.parametrize(
    ("successor", "mark", "jumps", "passed"),
    [("another", False, False, True), ("free", False, False, False), ("free", True, False, True),
     ("free", False, True, True)],
)  # fmt: skip
def test_an_event_is_passed_where_it_leads_elsewhere(successor, mark, jumps, passed):
    """To another mode, to a mark, to another state; one that changes nothing may be passed."""
    reset = (lambda x, p: x) if jumps else None
    way_out = Exit(VectorEvent("wall", lambda x, T, p: x[0]), +1, lambda x, p: successor, mark=mark, reset=reset)
    free = cycle_of(FREE)
    cycle = replace(free, phases=(replace(free.phases[0], exits=(way_out,)),))
    line = [lambda tau: np.stack([tau - 0.6, zero(tau)], axis=1) / SCALE]
    t, u, fractions = laid_out(cycle, [FOUR], line, [1.0], degree=4)
    setting = Setting(fractions, np.zeros(1), SCALE, np.zeros(1))
    assert check_admissible(t, u, setting).violated == ("phase 1 (free) passes 'wall'" if passed else "")
    many = settings_of(setting, np.zeros((1, 1)), np.zeros((1, 1)))
    assert admissible_many(t, u[None], many).item() is not passed


@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_an_event_is_met_from_its_own_side(direction):
    falling = VectorMode("falling", lambda x, p, sign: ca.vertcat(-1.0, 0.0))
    cycle = cycle_of(falling)
    phase = replace(cycle.phases[0], end=VectorEvent("floor", lambda x, T, p: x[0]), direction=direction)
    falls = [lambda tau: np.stack([1 - tau, zero(tau)], axis=1) / SCALE]
    t, u, fractions = laid_out(replace(cycle, phases=(phase,)), [FOUR], falls, [1.0], degree=4)
    setting = Setting(fractions, np.zeros(1), SCALE, np.zeros(1))
    many = settings_of(setting, np.zeros((1, 1)), np.zeros((1, 1)))
    assert check_admissible(t, u, setting).admissible is admissible_many(t, u[None], many)[0].item() is (direction <= 0)


@pytest.mark.parametrize(("beyond", "leads"), [(-1e-3, True), (0.5e-6, True), (4e-6, False), (1e-3, False)])
def test_an_event_leads_to_the_mode_that_follows(beyond, leads):
    """Within 1e-6 of the scale (2.0) of where it says another name it may say either."""
    end = VectorEvent("floor", lambda x, T, p: x[0] - 1)
    way_out = Exit(end, 0, lambda x, p: "other" if x[0] > 1.0 - beyond else "free")
    cycle = cycle_of(FREE)
    phase = replace(cycle.phases[0], end=end, exits=(way_out,), follows=("free",))
    states = [lambda tau: np.stack([one(tau), zero(tau)], axis=1) / SCALE]
    t, u, fractions = laid_out(replace(cycle, phases=(phase,)), [FOUR], states, [1.0], degree=4)
    setting = Setting(fractions, np.zeros(1), SCALE, np.zeros(1))
    verdict = check_admissible(t, u, setting)
    assert verdict.violated == ("" if leads else "phase 1 (free): 'floor' leads to 'other', not to what follows")
    many = settings_of(setting, np.zeros((1, 1)), np.zeros((1, 1)))
    assert admissible_many(t, u[None], many).item() is leads


# Events that are all but met ---------------------------------------------------------------------------------------


def hump(top, wiggle=0.0):
    """x[0] comes up to `top` in the middle of the phase; its last Legendre coefficient is about the wiggle's."""

    def motion(tau):
        return np.stack([top - (tau - 0.6) ** 2 + wiggle * np.cos(40 * tau), zero(tau)], axis=1) / SCALE

    exits = (Exit(VectorEvent("wall", lambda x, T, p: x[0]), +1, lambda x, p: "another"),)
    cycle = cycle_of(FREE)
    cycle = replace(cycle, phases=(replace(cycle.phases[0], exits=exits),))
    t, u, fractions = laid_out(cycle, [FOUR], [motion], [1.0], degree=4)
    return t, u, Setting(fractions, np.zeros(1), SCALE, np.zeros(1))


@pytest.mark.parametrize(("top", "wiggle", "unclear", "barely"), [
    (3e-7, 0.0, False, 0), (3e-9, 0.0, False, -1), (-3e-7, 0.0, False, -1),  # known exactly
    (3e-7, 1e-6, True, -1), (-3e-7, 1e-6, True, -1), (3e-9, 1e-6, True, -1),  # known to 1e-6, on whichever side
    (-1e-4, 1e-6, False, -1), (3e-9, 1e-10, False, -1),  # known well enough
])  # fmt: skip
def test_an_event_that_is_all_but_met_must_be_resolved(top, wiggle, unclear, barely):
    t, u, setting = hump(top, wiggle)
    verdict = check_admissible(t, u, setting)
    assert not verdict.violated and verdict.barely == barely
    assert verdict.unclear.tolist() == [False, False, unclear, False]
    many = settings_of(setting, np.zeros((1, 1)), np.zeros((1, 1)))
    assert admissible_many(t, u[None], many).tolist() == [not unclear and barely < 0]


@pytest.mark.parametrize(("own", "finer", "barely"), [(-1e-4, 3e-7, 0), (3e-7, -1e-4, -1)])
def test_the_halved_mesh_says_whether_an_event_is_met(own, finer, barely):
    """What it makes of a solution is nearer to the truth than what that shows itself."""
    t, u, setting = hump(own)
    verdict = check_admissible(t, u, setting)
    assert (verdict.barely == -1) is (barely == 0)
    coarse = laid_out(t.cycle, [FOUR[::2]], [lambda tau: np.zeros((tau.size, 2))], [1.0], degree=4)[0]
    assert judged_on_halves(coarse, verdict, hump(finer)).barely == barely
    assert judged_on_halves(coarse, verdict, None) is verdict


def test_a_phase_that_has_all_but_vanished_is_clear():
    """A condition of nothing but rounding: no shorter interval says more; a little more of it, and one does."""
    noise = np.random.default_rng(1).uniform(-1, 1, 64)

    def ragged(size):
        return lambda tau: size * noise[: tau.size] if tau.size < noise.size else size * np.resize(noise, tau.size)

    assert judged([POSITIVE, FREE], [FOUR, FOUR], [ragged(1e-13), one]).admissible
    assert judged([POSITIVE, FREE], [FOUR, FOUR], [lambda tau: 1e-6 + ragged(1e-6)(tau), one]).unclear.any()
