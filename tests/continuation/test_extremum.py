"""The largest and the smallest value of a parameter with their sensitivities, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from casahunt import InputError, NoOrbit
from casahunt.continuation import Vanishing, follow, largest, smallest
from casahunt.continuation.special_points import SpecialPoint
from casahunt.errors import Status
from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid.examples import ball
from casahunt.orbits import Options, find_cycle
from problems import bouncing_ball

TIGHT = Options(tol=1e-9)


def slowest(e=0.8, w=20.0, g=9.81):
    """The smallest a with a bounce in every turn (problems/bouncing_ball.py)."""
    return math.pi * g * (1 - e) / (1 + e) / w**2


@pytest.fixture(scope="module")
def bouncing():
    return next(found.orbit for found in bouncing_ball.cycles() if found.caption.startswith("1 turns, 1.46 folds, u"))


def difference(**at):
    """Five-point difference of the closed form by one of its parameters."""
    ((name, value),) = at.items()
    h = 1e-3 * value
    f = [slowest(**{name: value + k * h}) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h)


def test_the_smallest_amplitude_of_the_bouncing_ball(bouncing):
    fold = smallest(bouncing, "a", options=TIGHT)
    assert fold.value == pytest.approx(slowest(), rel=1e-11) and fold.error_estimate < 1e-9
    assert fold.confirmed_value == pytest.approx(slowest(), rel=1e-11)
    exact = {"e": -2 * slowest() / (1 - 0.8**2), "w": -2 * slowest() / 20, "g": slowest() / 9.81}
    assert fold.sensitivities == pytest.approx(exact, rel=1e-8)
    by_difference = {"e": difference(e=0.8), "w": difference(w=20.0), "g": difference(g=9.81)}
    assert fold.sensitivities == pytest.approx(by_difference, rel=1e-8)
    assert "a = 0.0085608" in str(fold) and "w -0.000856" in str(fold)


def test_any_parameter_has_its_extremum(bouncing):
    """The same fold: the smallest w, and the largest g, at this a."""
    a = bouncing.problem.value("a")
    slow = smallest(bouncing, "w", options=TIGHT)
    w = math.sqrt(slowest(w=1.0) / a)
    assert slow.value == pytest.approx(w, rel=1e-9)
    exact = {"a": -w / (2 * a), "e": -w / (1 - 0.8**2), "g": w / (2 * 9.81)}
    assert slow.sensitivities == pytest.approx(exact, rel=1e-7)
    assert largest(bouncing, "g", options=TIGHT).value == pytest.approx(9.81 * a / slowest(), rel=1e-9)


def test_from_a_located_fold_only_what_it_is(bouncing):
    a = bouncing.problem.value("a")
    (special,) = follow(bouncing, "a", to=a / 2, back=2 * a, options=TIGHT).special
    assert smallest(special, "a", options=TIGHT).value == pytest.approx(slowest(), rel=1e-11)
    with pytest.raises(NoOrbit, match="not largest .* try `smallest`"):
        largest(special, "a", options=TIGHT)
    with pytest.raises(InputError, match="must be a fold"):
        smallest(SpecialPoint("flip", special.orbit, ""), "a")


def test_where_there_is_none(bouncing):
    with pytest.raises(NoOrbit, match="no smallest a on this branch between .* and 0.01") as none:
        smallest(bouncing, "a", to=0.01)
    with pytest.raises(NoOrbit, match="stopped after") as unknown:  # it lies farther on
        smallest(bouncing, "a", max_points=2)
    assert (none.value.status, unknown.value.status) == (Status.NOT_FOUND, Status.NOT_CONVERGED)
    with pytest.raises(InputError, match="its way down cannot end at 1"):
        smallest(bouncing, "a", to=1.0)
    with pytest.raises(InputError, match="parameter"):
        smallest(bouncing, "b")


def test_a_value_of_zero():
    """With rho = r^2 - 1: lam = m + beta rho - rho^2, largest at m + beta^2/4, which is zero here."""
    hump = System(
        "hump", ("x", "y"), {"lam": -0.5, "m": -0.01, "beta": 0.2},
        (
            Mode(
                "turn",
                field=lambda x, p: {
                    "x": x.x * (p.lam - p.m - p.beta * (r := x.x**2 + x.y**2 - 1) + r**2) - x.y,
                    "y": x.y * (p.lam - p.m - p.beta * (r := x.x**2 + x.y**2 - 1) + r**2) + x.x,
                },
            ),
        ),
    )  # fmt: skip
    orbit = find_cycle(hump, x=math.sqrt(1 + 0.1 - math.sqrt(0.5)), y=0.0)
    fold = largest(orbit, "lam", options=TIGHT)
    assert abs(fold.value) < 1e-10 and abs(fold.confirmed_value) < 1e-10
    assert fold.sensitivities == pytest.approx({"m": 1.0, "beta": 0.1}, rel=1e-8)
    assert np.isfinite(fold.error_estimate) and fold.error_estimate < 1e-9
    assert "lam = " in str(fold)


def test_the_way_to_a_fold_is_told():
    """Each orbit of the branch, up to the first one behind the fold: no value lies beyond that of the fold."""
    orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    told = []
    fold = smallest(orbit, "a", progress=told.append)
    values = [each.problem.value("a") for each in told]
    assert len(values) > 1 and min(values) >= fold.value * (1 - 1e-6) and values[0] < orbit.problem.value("a")


def test_a_cycle_that_moves_less_and_waits_longer():
    """x grows like exp(p) and falls to 0.9 in a turn, and waits for 1/x: it ends at p = -log 0.9, but z does not."""

    def until_one(to, left):
        return Event(to, lambda x, p: x.z - 1, +1, to=to, reset=lambda x, p: {"x": left * x.x, "z": 0 * x.z})

    move = Mode("move", lambda x, p: {"x": x.x * (p.p - x.x), "z": 1.0}, ends=(until_one("wait", 0.9),))
    wait = Mode("wait", lambda x, p: {"x": 0 * x.x, "z": x.x}, ends=(until_one("move", 1.0),))
    orbit = find_cycle(System("moves and waits", ("x", "z"), {"p": 0.5}, (move, wait)), "move", x=0.5, z=0.0)
    end = follow(orbit, "p", to=-1.0).end
    assert end.kind == "comes to rest" and abs(end.value + np.log(0.9)) <= end.error < 1e-9
    assert (end.exponent, end.period_exponent) == pytest.approx((1.0, -1.0), abs=0.01)
    last = smallest(orbit, "p")
    assert isinstance(last, Vanishing) and abs(last.value + np.log(0.9)) <= last.absolute_error < 1e-9
