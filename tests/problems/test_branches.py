"""Branches of problems/ against closed forms, published numbers and shooting: no point lost, none invented.

All of them, by default and by tenth-size steps: `python scripts/branches.py`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from casahunt.continuation import follow
from casahunt.orbits import find_cycle
from problems import chua, ends, gears, impact_pair, rings
from problems.gallery import Course, compared
from scripts import branches
from scripts.peers import branch_truths

QUICK = (
    "hysteresis, s = 1", "hysteresis, s = 0.03", "band, width 0.3", "band, width 0.05", "torus", "Lorenz, large cycle",
    "Lorenz, window at 166", "Duffing, up", "Ueda", "two wells", "Chua, up", "impact pair, down", "impact pair, up",
    "threshold harvest", "buck converter, one ramp", "buck converter, two ramps", "Rossler, turns: 2",
    "crossing", "isola", "friction, past its end", "level", "thermostat", "rest", "load",
)  # fmt: skip
"""Captions of those that take less than a second."""
COURSES = {course.caption: course for course in branches.courses()}


def assert_followed(course: Course) -> None:
    row = branches.row_of(course, course.start(), None, math.inf)
    assert not row.fails, str(row)


@pytest.mark.parametrize("caption", QUICK)
def test_quick_branches(caption):
    assert_followed(COURSES[caption])


@pytest.mark.slow
@pytest.mark.parametrize("caption", [caption for caption in COURSES if caption not in QUICK])
def test_all_branches(caption):
    assert_followed(COURSES[caption])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["duffing", "gears", "morris_lecar"])
def test_steps_of_a_tenth_find_the_same(name, capsys):
    assert branches.main(["--only", name]) == 0
    assert " 0 failures" in capsys.readouterr().out


# The truths themselves ----------------------------------------------------------------------------------------------


def test_the_twisted_band_turns_over():
    """The multiplier that the docstring gives, by shooting the equations with numpy."""

    def rates(t, x, lam):
        first = 0.1 * (0.3**2 - lam**2)
        m, d, g = (first - 0.2) / 2, (first + 0.2) / 2, 1 - x[0] ** 2 - x[1] ** 2
        return (g * x[0] - x[1], g * x[1] + x[0],
                -x[3] / 2 + m * x[2] + d * (x[0] * x[2] + x[1] * x[3]),
                x[2] / 2 + m * x[3] + d * (x[1] * x[2] - x[0] * x[3]))  # fmt: skip

    smooth = branch_truths.Smooth(rates, (1, 0.0))
    _, M = smooth.solved(np.array([1.0, 0.0, 0.0, 0.0, 2 * math.pi, -0.5]), 5)
    expected = [-math.exp(0.2 * math.pi * (0.09 - 0.25)), -math.exp(-0.4 * math.pi), math.exp(-4 * math.pi), 1.0]
    assert np.sort(np.linalg.eigvals(M).real) == pytest.approx(np.sort(expected), rel=1e-9)


@pytest.mark.parametrize("name", [pytest.param("duffing", marks=pytest.mark.slow), "gears", "chua"])
def test_shooting_gives_the_numbers_of_the_files(name, capsys):
    branch_truths.main([name])
    shot = sorted(float(line.split()[-1]) for line in capsys.readouterr().out.splitlines())
    known = [value for caption, course in COURSES.items() for _, value in course.special if caption in FILES[name]]
    expected = {round(value, 8): value for value in known if value not in gears.GRAZINGS}
    assert shot == pytest.approx(sorted(expected.values()), rel=1e-10)


FILES = {
    "duffing": ("Duffing, up", "Ueda", "two wells"), "gears": ("gears, down",), "chua": ("Chua, up", "Chua, down"),
}  # fmt: skip


def test_the_impact_pair_of_the_closed_form_is_a_motion():
    """Half a period from the right wall, by the parabola and the cosine, ends at the left one with v/e."""
    a, e = 0.2, impact_pair.E
    phi = math.atan2(2, impact_pair.SLOPE) + math.asin(1 / (a * math.hypot(impact_pair.SLOPE, 2)))
    v = -2 * e * a * math.sin(phi) / (1 - e)
    s = np.linspace(0, math.pi, 200)
    x = 0.5 + (v - a * math.sin(phi)) * s + a * (math.cos(phi) - np.cos(phi + s))
    assert x[-1] == pytest.approx(-0.5, abs=1e-12) and np.all(np.abs(x[1:-1]) < 0.5)
    assert v - 2 * a * math.sin(phi) == pytest.approx(v / e, rel=1e-12)


def test_the_centre_of_the_outer_zone():
    a, b, k = chua.CENTRE, 100 / 7, 1 - 5 / 7
    a1, a2, a3 = 1 + a * k, b + a * (k - 1), a * b * k
    assert a1 * a2 == pytest.approx(a3, rel=1e-11)


# The counting -------------------------------------------------------------------------------------------------------


def test_points_are_matched_one_by_one():
    known = (("fold", 1.0), ("fold", 1.0 + 5e-8), ("flip", 2.0))
    assert compared(known, known, 1e-7) == ((), ())
    assert compared(known[:1], known, 1e-7) == (known[1:], ())
    assert compared((*known, ("fold", 1.0)), known, 1e-7) == ((), (("fold", 1.0),))
    assert compared((("fold", 2.0),), (("flip", 2.0),), 1e-7) == ((("flip", 2.0),), (("fold", 2.0),))


def test_a_point_that_is_dropped_is_noticed():
    """By the list, by the count of multipliers, and, where it is a fold, by the parameter that turns round."""
    course = next(c for c in rings.branches() if c.caption == "hysteresis, s = 1")
    branch = follow(course.start(), course.vary, to=course.to, largest_step=0.1)
    at = branches.places(branch)
    assert branches.uncounted(branch, at) == [] and branches.turns(branch, at) == []
    without = replace(branch, special=branch.special[1:])
    at = branches.places(without)
    assert len(branches.uncounted(without, at)) == 1 and len(branches.turns(without, at)) == 1


def test_a_symmetry_by_chance_is_not_followed():
    """The cycle is its own mirror image without the load only: with it, it is the one that a motion settles on."""
    course = COURSES["load"]
    branch = follow(course.start(), course.vary, to=course.to)
    settled = find_cycle(ends.FORCED, parameters={"load": course.to}, x=0.0, v=0.0).extrema("x")
    reached = branch.orbits[-1].extrema("x")
    assert reached.high.value == pytest.approx(settled.high.value, rel=1e-7)
    assert reached.low.value == pytest.approx(settled.low.value, rel=1e-7)


def test_periods_and_sizes_of_the_ends():
    """In front of its end each cycle is the one of its closed form."""
    friction = follow(ends.dragged(), "d", to=0.0).orbits[-1]
    d = friction.problem.value("d")
    assert d * friction.amplitude == pytest.approx(4 / math.pi, rel=0.01)
    level = follow(COURSES["level"].start(), "level", to=0.99).orbits[-1]
    assert level.period == pytest.approx(math.log(1.5 / 0.01) + math.log(1.99 / 0.5), rel=1e-8)
    h = 0.05
    thermostat = follow(COURSES["thermostat"].start(), "h", to=h).orbits[-1]
    up, down = math.log((0.6 + h) / (0.6 - h)), math.log((0.4 + h) / (0.4 - h))
    assert thermostat.period == pytest.approx(up + down, rel=1e-8)


def test_the_fold_of_the_relay_is_the_minimum_of_its_closed_form():
    def F(h):
        return math.tanh(h / 2) - (h / 2 + h**2 / 4 * math.tanh(h / 2)) / math.cosh(h / 2) ** 2

    found = minimize_scalar(F, bounds=(0.5, 3.0), method="bounded", options={"xatol": 1e-9})
    assert found.fun == pytest.approx(ends.RELAY_FOLD, rel=1e-11)
