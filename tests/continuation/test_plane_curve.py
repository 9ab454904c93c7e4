"""Plane curves that are known: through their turns, onto bounds, and to where they end."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from curve_support import Known

from casahunt.continuation.plane_curve import LOCATED, Evaluation, PlanePoint, follow_curve, tangent_at

ANGLE = 0.35
"""Between successive tangents, at which steps stay as they are [rad]."""
Phi = Callable[[float, float], float | str]


@dataclass(frozen=True)
class Chart:
    """phi(x, c) with its gradient, around the place (x, position)."""

    phi: Phi
    slopes: Callable[[float, float], tuple[float, float]]
    x: float
    position: float
    reach: tuple[float, float] = (1.0, 1.0)
    asked: tuple[list[float], ...] = ()

    @property
    def gradient(self) -> tuple[float, float]:
        return self.slopes(self.x, self.position)

    def value(self, s: float, m: float) -> Evaluation | str:
        for record in self.asked:
            record.append(s)
        found = self.phi(self.x + s, self.position + m)
        return found if isinstance(found, str) else Evaluation(found)

    def moved(self, s: float, m: float, reading: Evaluation) -> Chart | str:
        return replace(self, x=self.x + s, position=self.position + m)


def followed(chart: Chart | Known, **how: float) -> tuple[list[PlanePoint], str]:
    """All places and the sentence at the end."""
    places, generator = [], follow_curve(chart, **{"sense": 1.0, **how})
    while True:
        try:
            places.append(next(generator))
        except StopIteration as end:
            return places, end.value


def line(x: float = 0.0, c: float = 0.0, slope: float = 2.0, **more: object) -> Chart:
    """x = slope c."""
    return Chart(lambda x, c: x - slope * c, lambda x, c: (1.0, -slope), x, c, **more)


def circle(angle: float) -> Chart:
    """x^2 + (c - 1/2)^2 = 0.3^2, the reach its radius."""
    return Chart(
        lambda x, c: (x**2 + (c - 0.5) ** 2) / 0.18 - 0.5,
        lambda x, c: (x / 0.09, (c - 0.5) / 0.09),
        0.3 * np.cos(angle), 0.5 + 0.3 * np.sin(angle), (0.3, 0.3),
    )  # fmt: skip


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_round_a_circle(sense):
    """The turns lie at c = 0.8 and 0.2; steps settle where tangents make the largest angle with each other."""
    places, why = followed(circle(0.3), sense=sense, most=40)
    assert why == "stopped after 40 places"
    assert 38 <= sum(not p.turns for p in places) <= 1 + 40  # a step that fails counts
    for place in places:
        chart = place.chart
        assert abs(chart.phi(chart.x, chart.position)) <= LOCATED
        assert np.linalg.norm(place.tangent) == pytest.approx(1, abs=1e-14)
        assert abs(np.dot(place.tangent, chart.gradient)) <= 1e-14
    angles = np.unwrap([np.arctan2(p.chart.position - 0.5, p.chart.x) for p in places]) * sense
    assert np.all(np.diff(angles) > 0), "it never goes back"
    turns = [k for k, p in enumerate(places) if p.turns]
    assert len(turns) == sum(angles[0] < (n + 0.5) * np.pi < angles[-1] for n in range(-2, 20)) >= 4
    for k in turns:
        assert abs(places[k].chart.position - 0.5) == pytest.approx(0.3, abs=1e-9)  # t_c < 1e-6, squared
        assert abs(places[k].chart.x) < 1e-6
    steps = np.diff([a for a, p in zip(angles, places, strict=True) if not p.turns])[4:]
    # The length of the next step is that of the last over the angle; the reach of a diagonal is sqrt(2) times longer.
    assert steps.max() < np.sqrt(2) * ANGLE and steps.min() > ANGLE / np.sqrt(2)
    assert np.mean(steps) == pytest.approx(ANGLE, rel=0.1)


def test_up_an_s_and_down_again():
    """c = x^3 - x/3 turns at x = -1/3 and 1/3; ends on the bounds, exactly."""

    def s_curve(x: float) -> Chart:
        return Chart(lambda x, c: c - x**3 + x / 3, lambda x, c: (1 / 3 - 3 * x * x, 1.0), x, x**3 - x / 3, (0.2, 0.2))

    low, high = -0.5, 0.4
    for start, sense, bound in ((s_curve(-0.9), 1.0, high), (s_curve(0.9), -1.0, low)):
        places, why = followed(start, sense=sense, low=low, high=high)
        assert why == "" and places[-1].chart.position == bound
        assert np.all(np.diff([p.chart.x for p in places]) * sense > 0)
        turns = [p.chart.x for p in places if p.turns]
        assert np.array(turns) * sense == pytest.approx([-1 / 3, 1 / 3], abs=1e-5)
        assert max(abs(b.chart.x - a.chart.x) for a, b in itertools.pairwise(places)) <= 0.2 * 1.5
        assert start.position not in (low, high) and places[0].chart is start


def test_a_straight_line_is_one_value_a_step():
    """Steps as long as the reach of either coordinate; the last one ends on the bound, no longer than 1.3 steps."""
    for reach in ((0.1, 1.0), (1.0, 0.05)):
        for high, expected in ((0.22, [0, 0.05, 0.1, 0.15, 0.2, 0.22]), (0.21, [0, 0.05, 0.1, 0.15, 0.21])):
            asked: list[float] = []
            places, why = followed(line(reach=reach, asked=(asked,)), high=high, low=-1.0)
            assert why == "" and not any(p.turns for p in places)
            assert [p.chart.position for p in places] == pytest.approx(expected, abs=1e-15)
            assert len(asked) == len(expected) - 1


def test_a_gradient_that_is_off_costs_secants_alone():
    """x - 2 c with the slopes of x - 3 c: the corrector comes back to the true line in three values at most."""
    asked: list[float] = []
    chart = replace(line(reach=(0.1, 0.1), asked=(asked,)), slopes=lambda x, c: (1.0, -3.0))
    places, why = followed(chart, high=0.5)
    assert why == ""
    assert all(abs(p.chart.x - 2 * p.chart.position) <= LOCATED for p in places)
    assert len(asked) <= 3 * (len(places) - 1)


def test_a_bracket_is_closed_down_to_the_curve():
    """Slopes half as steep as they are, on a phi that bends: the first step goes beyond the curve."""

    def phi(x: float, c: float) -> float:
        off = x - 2 * c - 0.3 * np.sin(x)
        return off + 3 * off**2

    chart = Chart(phi, lambda x, c: (0.5 - 0.15 * float(np.cos(x)), -1.0), 0.0, 0.0, (0.5, 0.5))
    places, why = followed(chart, high=0.9)
    assert why == "" and len(places) > 4
    assert all(abs(p.chart.x - 2 * p.chart.position - 0.3 * np.sin(p.chart.x)) <= LOCATED for p in places)


def test_where_phi_ends_the_curve_is_followed_to_there():
    chart = replace(line(reach=(0.1, 0.1)), phi=lambda x, c: "no phi" if x > 0.37 else x - 2 * c)
    places, why = followed(chart)
    assert why == "no phi"
    assert 0.37 - 1e-3 * 0.1 < places[-1].chart.x <= 0.37


def test_a_place_that_is_none_ends_the_curve():
    class Refusing(Chart):
        def moved(self, s: float, m: float, reading: Evaluation) -> Chart | str:
            return "no orbit" if self.x + s > 0.37 else super().moved(s, m, reading)

    whole = line(reach=(0.1, 0.1))
    places, why = followed(Refusing(whole.phi, whole.slopes, 0.0, 0.0, (0.1, 0.1)))
    assert why == "no orbit" and 0.3699 < places[-1].chart.x <= 0.37


def test_after_a_failure_steps_stay_short_for_a_while():
    """Steps beyond 0.06 never succeed: of the tries, most must not be of that kind."""
    tries: list[bool] = []

    class Short(Chart):
        def value(self, s: float, m: float) -> Evaluation | str:
            tries.append(abs(s) <= 0.06)
            return super().value(s, m) if abs(s) <= 0.06 else "too far"

    whole = line(reach=(0.1, 1.0))
    places, why = followed(Short(whole.phi, whole.slopes, 0.0, 0.0, (0.1, 1.0)))
    assert why == "" and places[-1].chart.position == 1.0
    assert 0.6 < np.mean(tries) < 0.95, "it keeps away, and it tries again"
    assert np.mean(np.diff([p.chart.x for p in places])) > 0.04


@pytest.mark.parametrize(
    ("phi", "slopes", "words"),
    [
        (lambda x, c: float("nan"), (1.0, -2.0), "not finite"),
        (lambda x, c: 1.0, (1.0, -2.0), "no root near"),
        (lambda x, c: 1.0, (0.0, 0.0), "does not change across"),
        (lambda x, c: 1.0 if x > 2 * c + 1e-5 else -1.0, (1.0, -2.0), "not located"),
    ],
)
def test_why_there_is_no_root(phi, slopes, words):
    places, why = followed(Chart(phi, lambda x, c: slopes, 0.0, 0.0))
    assert words in why and len(places) == 1


def test_a_corner_is_no_turn():
    """c = 1/2 - |x|/5: t_c jumps from 0.2 to -0.2."""
    slopes = lambda x, c: (0.2 * float(np.sign(x)), 1.0)  # noqa: E731
    places, why = followed(Chart(lambda x, c: c - 0.5 + 0.2 * abs(x), slopes, -0.4, 0.42, (0.1, 0.1)))
    assert "no place is found where it does" in why
    assert not any(p.turns for p in places) and -1e-4 < places[-1].chart.x < 0


def test_a_corrector_that_leaves_the_range_is_a_failure():
    """The curve rises to the bound, and its tangents say that it does not."""
    chart = Chart(lambda x, c: c - 0.4999 + 0.01 * x, lambda x, c: (0.0, 1.0), 0.0, 0.4999, (0.5, 0.5))
    places, why = followed(chart, high=0.5)
    assert why == "the corrector left the range"
    assert 0.5 - 1e-6 < places[-1].chart.position <= 0.5


def test_tangents_are_oriented():
    assert tangent_at(line(), np.array([0.0, 1.0])) == pytest.approx(np.array([2, 1]) / np.sqrt(5))
    assert tangent_at(line(), np.array([0.0, -1.0])) == pytest.approx(-np.array([2, 1]) / np.sqrt(5))
    nowhere = replace(line(), slopes=lambda x, c: (0.0, 0.0))
    like = np.array([0.6, 0.8])
    assert tangent_at(nowhere, like) is like


# Normal forms of folds in two parameters


@pytest.mark.parametrize("cusp", [0.35, 0.8, 0.999])
def test_round_a_cusp(cusp):
    """The fold curve of the cusp's normal form turns back exactly at s = 0, c = cusp."""

    def phi(s: float, c: float) -> float:
        return (c - cusp) + 3 * s**2

    places, ended = followed(Known(-np.sqrt(cusp / 3), 0.0, phi))
    assert ended == ""
    turns = [place.chart for place in places if place.turns]
    assert len(turns) == 1
    assert turns[0].position == pytest.approx(cusp, abs=1e-8)
    assert abs(turns[0].s) < 1e-6
    last = places[-1].chart
    assert (last.position, last.s) == (0.0, pytest.approx(np.sqrt(cusp / 3), abs=1e-6))
    assert all(abs(phi(place.chart.s, place.chart.position)) <= 1e-8 for place in places)


def test_round_two_cusps():
    """c = 1/2 + s - 4 s^3 turns back at s = 1/sqrt(12) and at s = -1/sqrt(12)."""

    def c_of(s: float) -> float:
        return 0.5 + s - 4 * s**3

    start = max(float(r.real) for r in np.roots([-4, 0, 1, 0.5]) if abs(r.imag) < 1e-9)
    places, ended = followed(Known(start, 0.0, lambda s, c: c - c_of(s)))
    assert ended == ""
    s = 1 / np.sqrt(12)
    turns = np.array([(place.chart.s, place.chart.position) for place in places if place.turns])
    assert turns == pytest.approx(np.array([(s, c_of(s)), (-s, c_of(-s))]), abs=1e-6)
    assert places[-1].chart.position == 1.0


def test_no_cusp_on_a_curve_that_does_not_turn():
    places, ended = followed(Known(0.0, 1.0, lambda s, c: s - np.sin(3 * (c - 1))), sense=-1.0)
    assert ended == ""
    assert not any(place.turns for place in places)
    assert places[-1].chart.position == 0.0
    assert places[-1].chart.s == pytest.approx(np.sin(-3), abs=1e-9)


def test_a_jump_of_the_tangent_is_no_cusp():
    """Where the gradient is wrong the tangent is turned round: no cusp is reported, and no place off the curve."""

    class Noisy(Known):
        @property
        def gradient(self) -> tuple[float, float]:
            by_s, by_c = super().gradient
            return (-by_s if 0.5 < self.position < 0.8 else by_s), by_c

    places, ended = followed(Noisy(0.0, 0.0, lambda s, c: 2 * s - c))
    assert not any(place.turns for place in places)
    assert ended or places[-1].chart.position in (0.0, 1.0)
    assert all(place.chart.s == pytest.approx(place.chart.position / 2, abs=1e-6) for place in places)


def test_where_phi_ends_the_curve_ends():
    class Ending(Known):
        def value(self, s: float, m: float) -> Evaluation | str:
            return super().value(s, m) if self.position + m < 0.5 else "nothing there"

        @property
        def gradient(self) -> tuple[float, float]:
            return 1.0, -2 * self.position

    places, ended = followed(Ending(0.0, 0.0, lambda s, c: s - c**2))
    assert ended == "nothing there"
    assert 0.45 < places[-1].chart.position < 0.5
