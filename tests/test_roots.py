"""Roots against closed forms: simple, multiple, steep, flat, with failures, with NaN, and where there is no bracket."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from casahunt.roots import Bracket, Search, boundary, inverse_interpolation, secant

Function = Callable[[float], float]
NEXT: dict[str, Callable[[Bracket], float]] = {
    "Illinois": lambda bracket: bracket.illinois,
    "halves": lambda bracket: bracket.middle,
}


def between(f: Function, a: float, b: float) -> Bracket:
    return Bracket(a, f(a), b, f(b))


def polished(f: Function, bracket: Bracket, step: Callable[[Bracket], float], goal: float) -> tuple[float, int]:
    """(root, evaluations) where |f| <= goal or the bracket is down to rounding."""
    for k in range(1, 200):
        x = step(bracket)
        assert bracket.holds(x)
        value = f(x)
        if abs(value) <= goal:
            return x, k
        bracket = bracket.told(x, value)
        assert bracket.f_a * bracket.f_b < 0
        if not bracket.holds(bracket.middle):
            return x, k
    raise AssertionError("no end")


SIMPLE = [
    (lambda x: x * x - 2, 0.0, 2.0, math.sqrt(2)),
    (lambda x: math.cos(x) - x, 0.0, 1.5, 0.73908513321516064166),
    (lambda x: 1e3 * math.exp(x) - 1, -20.0, 3.0, math.log(1e-3)),
    (lambda x: 3 - 2 * x, 10.0, -7.0, 1.5),  # a above b
]


@pytest.mark.parametrize(("f", "a", "b", "root"), SIMPLE)
@pytest.mark.parametrize("step", NEXT)
def test_simple_roots(f, a, b, root, step):
    x, count = polished(f, between(f, a, b), NEXT[step], 1e-15)
    assert x == pytest.approx(root, rel=4e-16 / min(1.0, abs(root)))
    assert count <= (60 if step == "halves" else 40)


def test_the_order_of_illinois_steps():
    """x^2 = 2 from [1, 2]: every third step cubes the error; eight steps to rounding, where false position takes 18."""
    f = SIMPLE[0][0]
    assert polished(f, between(f, 1.0, 2.0), NEXT["Illinois"], 1e-15)[1] <= 8
    assert polished(f, between(f, 1.0, 2.0), lambda b: b.at(b.share()), 1e-15)[1] >= 18


def test_newton_inside():
    """From a good place Newton's order 2; where it leads out, and where the slope vanishes, the middle."""
    f = SIMPLE[0][0]
    bracket, x = between(f, 1.0, 2.0), 1.5
    for _ in range(4):  # errors 9e-2, 2e-3, 2e-6, 2e-12, 0
        bracket, x = bracket.told(x, f(x)), bracket.newton(x, f(x), 2 * x)
    assert x == pytest.approx(math.sqrt(2), rel=2e-16)
    bracket = between(math.atan, -10.0, 12.0)
    assert bracket.newton(12.0, math.atan(12.0), 1 / 145) == 1.0
    assert bracket.newton(12.0, 1.0, 0.0) == 1.0
    assert bracket.newton(12.0, math.nan, 1.0) == 1.0


def test_multiple_and_flat_roots():
    """(x - 1)^3 and, of all powers flat, exp(-1/x^2): as near as |f| tells; halving to rounding of x."""
    x, _ = polished(lambda x: (x - 1) ** 3, between(lambda x: (x - 1) ** 3, -1.0, 4.0), NEXT["Illinois"], 1e-24)
    assert abs(x - 1) <= 1e-8

    def flat(x: float) -> float:
        return math.copysign(math.exp(-1 / (x * x)), x) if x else 0.0

    x, _ = polished(flat, between(flat, -1.0, 3.0), NEXT["Illinois"], 1e-40)
    assert abs(x) <= (-math.log(1e-40)) ** -0.5 * (1 + 1e-12)


def test_steep_roots_and_jumps():
    """A slope of 1e12 is found to rounding; at a jump the bracket closes around it."""
    root = 1 / 3
    for step in NEXT.values():
        x, _ = polished(lambda x: math.atan(1e12 * (x - root)), between(lambda x: x - root, -1.0, 1.0), step, 1e-6)
        assert abs(x - root) <= 1.1e-16 + 1e-18

    def jump(x: float) -> float:
        return 1.0 if x > math.pi else -0.3

    x, _ = polished(jump, between(jump, 0.0, 10.0), NEXT["Illinois"], 0.0)
    assert x == pytest.approx(math.pi, rel=1e-15)


def test_an_end_that_stays_is_halved_again_and_again():
    """f = x^9 - 1 on [0, 10], nearly flat on the left: false position creeps, Illinois does not."""
    bracket = between(lambda x: x**9 - 1, 0.0, 10.0)
    assert polished(lambda x: x**9 - 1, bracket, NEXT["Illinois"], 1e-14)[1] <= 60
    for k in range(1, 5):
        bracket = bracket.told(bracket.illinois, -1.0)
        assert (bracket.halved_a, bracket.halved_b) == (0, k - 1)
    assert bracket.told(bracket.middle, 1.0).halved_a == 0


def test_false_position_keeps_off_the_ends():
    assert Bracket(0.0, -1.0, 1.0, 3.0).share() == 0.25
    assert Bracket(0.0, -1e-9, 1.0, 1.0).share(0.02) == 0.02
    assert Bracket(2.0, 1.0, 0.0, -1e-9).share(0.02) == 0.98
    assert Bracket(2.0, 1.0, 0.0, -3.0).at(0.25) == 1.5


def test_ends_of_which_only_the_sign_is_known():
    numpy = Bracket(np.float64(0.0), np.float64(1.0), np.float64(3.0), np.float64(-np.inf))  # which would warn
    for bracket in (Bracket(0.0, -math.inf, 3.0, 1.0), Bracket(3.0, 1e-9, 0.0, -math.inf), numpy):
        assert bracket.illinois == 1.5 and bracket.share(0.1) == 0.5
    assert math.isfinite(Bracket(0.0, -math.inf, 3.0, 1.0).told(1.5, -0.5).illinois)


@pytest.mark.parametrize(
    ("f_a", "f_b"), [(1.0, 2.0), (-1.0, -1e-300), (0.0, 1.0), (1.0, 0.0), (math.nan, 1.0), (-1.0, math.nan)]
)
def test_no_bracket(f_a, f_b):
    with pytest.raises(ValueError, match="opposite signs"):
        Bracket(0.0, f_a, 1.0, f_b)
    for wrong in (0.0, math.nan):
        with pytest.raises(ValueError, match="opposite signs"):
            Bracket(0.0, 1.0, 1.0, -1.0).told(0.5, wrong)
    assert Bracket(0.0, -1e-300, 1.0, 1e-300).share() == 0.5  # the product of the two is zero


def search(f: Function, bracket: Bracket, goal: float, fails: Callable[[int, float], bool]) -> tuple[float, int]:
    """(root, evaluations) of a search whose evaluation k at x fails where fails(k, x)."""
    state = Search.within(bracket)
    for k in range(200):
        x = state.ask()
        assert state.bracket.holds(x)
        if fails(k, x):
            state = state.failed() if k % 2 else state.told(x, math.nan)
            continue
        if abs(f(x)) <= goal:
            return x, k + 1
        state = state.told(x, f(x))
    raise AssertionError("no end")


@pytest.mark.parametrize(("f", "a", "b", "root"), SIMPLE)
def test_a_search_is_inverse_interpolation(f, a, b, root):
    """At most eight evaluations where the function is smooth over the bracket; not many more than halving elsewhere."""
    x, count = search(f, between(f, a, b), 4e-15, lambda k, x: False)
    assert x == pytest.approx(root, rel=1e-14)
    assert count <= (60 if b - a > 20 else 8)


def test_a_search_is_exact_where_x_is_a_parabola_of_f():
    """x = 0.3 + f - f^2/4 is a parabola of f, which three points give; an Illinois step is only near it."""

    def f(x: float) -> float:
        return 2 - math.sqrt(4 - 4 * (x - 0.3))

    state = Search.within(between(f, -0.5, 1.2))
    state = state.told(state.ask(), f(state.ask()))
    assert state.ask() == pytest.approx(0.3, abs=1e-14)
    assert abs(state.bracket.illinois - 0.3) > 1e-3


def test_a_search_goes_round_what_fails():
    """sqrt(2), where every second evaluation fails, and where none succeeds within 0.03 of the first place asked."""
    f, root = SIMPLE[0][0], math.sqrt(2)
    assert search(f, between(f, 1.0, 2.0), 1e-14, lambda k, x: k % 2 == 0)[0] == pytest.approx(root, rel=1e-14)
    first = Search.within(between(f, 1.0, 2.0)).ask()
    assert first == pytest.approx(4 / 3, rel=1e-15)
    assert search(f, between(f, 1.0, 2.0), 1e-14, lambda k, x: abs(x - first) < 0.03)[0] == pytest.approx(
        root, rel=1e-14
    )
    state = Search.within(between(f, 1.0, 2.0))
    asked = []
    for k in range(60):  # all in vain: within the bracket, and counted, so that the caller can give up
        assert state.failures == k
        asked.append(state.ask())
        state = state.failed()
    assert all(1 < x < 2 for x in asked) and len(set(asked[:8])) == 8
    assert state.told(1.4, f(1.4)).failures == 0


def test_inverse_interpolation():
    """Exact where x is a parabola of f; nan where it cannot tell."""
    seen = [(0.3 + 2 * f - f * f, f) for f in (-0.5, 0.2, 0.9, 40.0)]
    assert inverse_interpolation(seen) == pytest.approx(0.3, rel=1e-14)
    assert math.isnan(inverse_interpolation([(0.0, 1.0), (1.0, 1.0), (2.0, 1.0)]))
    assert math.isnan(inverse_interpolation([(0.0, 1.0)]))


def test_boundary():
    """sqrt(2) between neighbouring numbers, from either side; as wide as asked; a failure told as beyond is the end."""
    low, high = boundary(lambda x: x * x > 2, 0.0, 2.0)
    assert high == math.nextafter(low, 2) and low * low <= 2 < high * high
    high, low = boundary(lambda x: x * x <= 2, 2.0, 0.0)
    assert high == math.nextafter(low, 2) and low * low <= 2 < high * high
    low, high = boundary(lambda x: x > math.pi, 0.0, 8.0, width=1e-3)
    assert low <= math.pi < high and high - low == 8 / 2**13
    asked: list[float] = []
    low, high = boundary(lambda x: asked.append(x) or True, 0.0, 8.0, rounds=3)  # type: ignore[func-returns-value]
    assert (low, high) == (0.0, 1.0) and asked == [4.0, 2.0, 1.0]
    assert boundary(lambda x: True, 1.0, math.nextafter(1.0, 2)) == (1.0, math.nextafter(1.0, 2))


def test_secant():
    """A line in one step, sqrt(2) to rounding; f that is flat, NaN or without a root tells so by its value."""
    calls: list[float] = []

    def line(x: float) -> float:
        calls.append(x)
        return 7 - 2 * x

    assert secant(line, 0.0, 1.0, tolerance=1e-13) == (3.5, 0.0) and len(calls) == 3
    x, f = secant(SIMPLE[0][0], 1.0, 2.0, tolerance=1e-15)
    assert x == pytest.approx(math.sqrt(2), rel=4e-16) and abs(f) <= 1e-15
    assert secant(lambda x: 5.0, 0.0, 1.0, tolerance=1e-13) == (1.0, 5.0)
    calls.clear()
    assert math.isnan(secant(lambda x: line(x) * math.nan, 0.0, 1.0, tolerance=1e-13)[1]) and len(calls) == 2
    assert abs(secant(lambda x: x * x + 1, 0.0, 1.0, tolerance=1e-13)[1]) >= 1


@pytest.mark.parametrize("fails_at", [0.0, 1.0, 2.0])
def test_a_function_that_fails_is_asked_no_further(fails_at):
    """Least of all at the place that is no number."""
    asked = []

    def fails(x):
        asked.append(x)
        return math.nan if x == fails_at else x - 2.0

    _, left = secant(fails, 0.0, 1.0, tolerance=1e-12)
    assert not abs(left) <= 1e-12 and np.isfinite(asked).all()


def test_secant_steps_go_on_to_the_tolerance():
    """x^2: each step divides f by 2.6, the square of the golden ratio: they end in every range of that width."""
    for tolerance in 10.0 ** np.arange(-12, -2):
        f = secant(lambda x: x * x, 1.0, 0.9, tolerance=tolerance)[1]
        assert tolerance / 3 < f <= tolerance
