"""Branches of users' systems: folds, flips, tori and grazings against closed forms, and none where there is none."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from casahunt.continuation import bifurcations, branch_off, follow
from casahunt.errors import InputError
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import Options, find_cycle
from problems import belt

TIGHT = Options(tol=1e-9)
G, R, W = 9.81, 0.8, 20.0

BALL = System(
    "bouncing ball",
    ("x", "v"),
    {"a": 0.012, "g": G, "r": R, "w": W},
    (
        Mode(
            "flight",
            flow=lambda x, t, p: {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t},
            holds=lambda x, p: (x.x - p.a * ca.sin(p.w * x.t)) / p.a,
            ends=(
                Event(
                    "impact", lambda x, p: (x.x - p.a * ca.sin(p.w * x.t)) / p.a, -1, to="flight",
                    reset=lambda x, p: {"v": -p.r * x.v + (1 + p.r) * p.a * p.w * ca.cos(p.w * x.t)},
                ),
            ),
        ),
    ),
    forcing_period=lambda p: 2 * math.pi / p.w,
)  # fmt: skip
"""One bounce a turn: v = g pi/w behind the impact and a w cos phi = v (1 - r)/(1 + r), phi its phase."""
SLOWEST = math.pi * G * (1 - R) / (1 + R) / W**2
"""Fold: cos phi = 1."""
FLIP = math.hypot(SLOWEST, 2 * G * (1 + R**2) / (1 + R) ** 2 / W**2)
"""Flip: the trace of the map's derivative is -(1 + r^2)."""


def bouncing() -> object:
    return find_cycle(BALL, x=0.0119, v=1.54, t=0.07, settled=True)


def trace(a: float) -> float:
    """Of the derivative of the map from impact to impact of the bouncing ball, by differences of the map itself."""

    def image(phase: float, v: float) -> np.ndarray:
        start = a * math.sin(phase)

        def gap(T: float) -> float:
            return start + v * T - G * T**2 / 2 - a * math.sin(phase + W * T)

        T = 2 * math.pi / W
        for _ in range(60):
            T -= gap(T) / (v - G * T - a * W * math.cos(phase + W * T))
        speed = v - G * T
        return np.array([phase + W * T, -R * speed + (1 + R) * a * W * math.cos(phase + W * T)])

    v = G * math.pi / W
    phase = math.acos(v * (1 - R) / (1 + R) / (a * W))
    h = 1e-6
    dphase = (image(phase + h, v) - image(phase - h, v)) / (2 * h)
    dv = (image(phase, v + h) - image(phase, v - h)) / (2 * h)
    return float(dphase[0] + dv[1])


def test_the_closed_form_of_the_flip():
    assert trace(FLIP) == pytest.approx(-(1 + R**2), abs=1e-6)


def test_fold_and_flip_of_the_bouncing_ball():
    up = follow(bouncing(), "a", to=0.05, options=TIGHT)
    (flip,) = up.special
    assert flip.kind == "flip" and up.values[-1] == 0.05
    assert flip.orbit.problem.value("a") == pytest.approx(FLIP, rel=1e-9)
    assert up.stable.tolist() == [a < FLIP for a in up.values]
    down = follow(bouncing(), "a", to=0.001, back=0.02, options=TIGHT)
    (fold,) = down.special
    assert fold.kind == "fold" and fold.orbit.problem.value("a") == pytest.approx(SLOWEST, rel=1e-9)
    assert not down.missed and down.values[-1] == 0.02 and not down.stable[-1]


def test_a_branch_ends_at_the_special_point_that_is_asked_for():
    """At the flip, wherever the range ends behind it, and not at a fold, of which it has none."""
    for to, most in ((0.05, 0.05), (10.0, 5.0)):
        up = follow(bouncing(), "a", to=to, options=TIGHT, until=lambda special: special.kind == "flip")
        assert up.end.kind == "flip" and up.end.value == pytest.approx(FLIP, rel=1e-9)
        assert FLIP < up.values[-1] <= most
    other = follow(bouncing(), "a", to=0.03, options=TIGHT, until=lambda special: special.kind == "fold")
    assert other.end.kind == "range" and other.values[-1] == 0.03


def test_two_bounces_branch_off_at_the_flip():
    """Followed until both bounces differ; each maps to the other."""
    (flip,) = follow(bouncing(), "a", to=0.05, options=TIGHT).special
    two = follow(branch_off(flip, "a"), "a", to=0.028, options=TIGHT).orbits[-1]
    assert two.period == pytest.approx(4 * math.pi / W, rel=1e-10) and two.stable
    first, second = (arc.states[0, 0] for arc in two.arcs)
    a = 0.028
    for (x, v, turns), after, far in ((first, second, 0.0), (second, first, 1.0)):
        phase = 2 * math.pi * turns
        T = (after[2] + far * 2 - turns) * 2 * math.pi / W
        assert x == pytest.approx(a * math.sin(phase), abs=1e-12)
        assert x + v * T - G * T**2 / 2 == pytest.approx(a * math.sin(phase + W * T), abs=1e-10)
        assert -R * (v - G * T) + (1 + R) * a * W * math.cos(phase + W * T) == pytest.approx(after[1], abs=1e-9)
    assert abs(first[1] - second[1]) > 0.1


def test_nothing_branches_off_at_a_fold():
    (fold,) = follow(bouncing(), "a", to=0.001, back=0.02, options=TIGHT).special
    with pytest.raises(InputError, match="must be a flip"):
        branch_off(fold, "a")


def turning(growth: float = 0.0, beat: float = 0.0) -> System:
    """The unit circle, run through in 2 pi, with z' = (alpha + i omega) z across it, alpha = growth, omega = beat."""
    return System(
        "circle with a transversal spiral", ("x", "y", "u", "w"), {"alpha": growth, "omega": beat},
        (
            Mode(
                "turn",
                field=lambda x, p: {
                    "x": x.x * (1 - x.x**2 - x.y**2) - x.y,
                    "y": x.y * (1 - x.x**2 - x.y**2) + x.x,
                    "u": p.alpha * x.u - p.omega * x.w,
                    "w": p.omega * x.u + p.alpha * x.w,
                },
            ),
        ),
    )  # fmt: skip


def test_a_torus_is_found_where_the_pair_crosses_the_circle():
    """mu = exp(2 pi (alpha +- i omega)): on the circle at alpha = 0, and nowhere else."""
    orbit = find_cycle(turning(-0.05, 0.3), x=1.0, y=0.0, u=0.0, w=0.0, settled=True)
    branch = follow(orbit, "alpha", to=0.04, options=TIGHT)
    (torus,) = branch.special
    assert torus.kind == "Neimark-Sacker"
    assert torus.orbit.problem.value("alpha") == pytest.approx(0.0, abs=1e-9)
    assert branch.values[-1] == 0.04


def test_the_scheme_that_is_asked_for_is_taken():
    """Leine's belt; period at 0.5 from Taylor series in extended precision."""
    orbit = find_cycle(belt.BELT, "slip", x=0.0, v=0.0, tol=1e-8)
    for degree, kind in ((5, "gauss"), (4, "radau")):
        branch = follow(orbit, "belt", to=0.5, options=Options(tol=1e-8, degree=degree, kind=kind))
        assert {(one.degree, one.kind) for one in branch.orbits} == {(degree, kind)}
        assert branch.periods[-1] == pytest.approx(belt.TRUTH[0.5].period, rel=1e-8)
    with pytest.raises(InputError, match="degree"):
        follow(orbit, "belt", to=0.5, options=Options(degree=0.5))


@pytest.mark.slow
def test_a_parameter_passes_through_zero():
    """Van der Pol's oscillator at -mu is the one at mu with the time reversed: T is the same, mu_2 the inverse."""
    system = System(
        "van der Pol", ("x", "v"), {"mu": 1.0},
        (Mode("smooth", field=lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}),),
    )  # fmt: skip
    orbit = find_cycle(system, x=2.0, v=0.0)
    branch = follow(orbit, "mu", to=-1.0, options=TIGHT)
    last = branch.orbits[-1]
    assert last.problem.value("mu") == -1.0 and last.period == pytest.approx(orbit.period, rel=1e-8)
    assert abs(last.multipliers.leading * orbit.multipliers.leading) == pytest.approx(1.0, rel=1e-6)


IMPACT = System(
    "impact oscillator", ("x", "v"), {"A": 1.0, "k": 1.0, "c": 0.1, "w": 1.0, "d": 1.0, "e": 0.8},
    (
        Mode(
            "free", field=lambda x, p: {"x": x.v, "v": p.A * ca.cos(p.w * x.t) - p.c * x.v - p.k * x.x},
            holds=lambda x, p: p.d - x.x,
            ends=(Event("impact", lambda x, p: x.x - p.d, +1, to="free", reset=lambda x, p: {"v": -p.e * x.v}),),
        ),
    ),
    forcing_period=lambda p: 2 * math.pi / p.w,
)  # fmt: skip


@pytest.mark.slow
def test_no_wall_is_gone_through_where_no_mode_says_that_it_holds():
    """Without impacts the amplitude is A/sqrt((k - w^2)^2 + (c w)^2) = 10 A; d = 1 is in its way from A = 0.1 on."""
    silent = replace(IMPACT, modes=tuple(replace(mode, holds=None) for mode in IMPACT.modes))
    branch = follow(find_cycle(silent, x=0.0, v=0.0, parameters={"A": 0.08}), "A", to=0.12)
    assert [special.kind for special in branch.special] == ["grazing", "fold"]
    assert branch.special[0].value == pytest.approx(0.1, abs=1e-8)
    assert max(orbit.extrema("x").high.value for orbit in branch.orbits) < 1 + 1e-6


@pytest.mark.slow
def test_a_grazing_is_located_and_passed():
    """Without impacts the amplitude is A/sqrt((k - w^2)^2 + (c w)^2) = 10 A: it reaches d at A = 0.1."""
    branch = follow(find_cycle(IMPACT, x=0.0, v=0.0), "A", to=0.05)
    kinds = [special.kind for special in branch.special]
    assert kinds == ["fold", "grazing"]
    assert branch.special[1].value == pytest.approx(0.1, abs=1e-8)
    last = branch.orbits[-1]
    assert last.problem.value("A") == 0.05 and last.extrema("x").high.value == pytest.approx(0.5, rel=1e-8)
    assert last.signature != branch.orbits[0].signature


@pytest.mark.parametrize("to, back", [(0.5, 0.4), (1.0, None)])
def test_a_range_that_is_none_is_refused(to, back):
    orbit = find_cycle(IMPACT, x=0.0, v=0.0)
    with pytest.raises(InputError, match="cannot go to"):
        follow(orbit, "A", to=to, back=back)
    with pytest.raises(InputError, match="parameter"):
        follow(orbit, "B", to=2.0)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 25, 3))])
def test_nothing_is_reported_that_is_not_there(seed):
    """Random spirals across the circle, four at a time: a torus where alpha(lambda) = 0 with omega no half turn."""
    rng = np.random.default_rng(seed)
    for _ in range(4):
        alpha, slope, omega = rng.uniform(-0.2, 0.2), rng.uniform(-0.3, 0.3), rng.uniform(0.1, 0.4)
        system = System(
            "circle with a spiral", ("x", "y", "u", "w"), {"s": 0.0},
            (
                Mode(
                    "turn",
                    field=lambda x, p, a=alpha, b=slope, o=omega: {
                        "x": x.x * (1 - x.x**2 - x.y**2) - x.y,
                        "y": x.y * (1 - x.x**2 - x.y**2) + x.x,
                        "u": (a + b * p.s) * x.u - o * x.w,
                        "w": o * x.u + (a + b * p.s) * x.w,
                    },
                ),
            ),
        )  # fmt: skip
        orbit = find_cycle(system, x=1.0, y=0.0, u=0.0, w=0.0, settled=True)
        branch = follow(orbit, "s", to=1.0)
        there = [-alpha / slope] if 0 < -alpha / slope < 1 else []
        assert [special.kind for special in branch.special] == ["Neimark-Sacker"] * len(there)
        found = [special.orbit.problem.value("s") for special in branch.special]
        np.testing.assert_allclose(found, there, atol=1e-7)
        assert not branch.missed


DUFFING = System(
    "Duffing", ("x", "v"), {"A": 1.0, "d": 0.2},
    (Mode("smooth", field=lambda x, p: {"x": x.v, "v": p.A * ca.cos(x.t) - p.d * x.v - x.x**3}),),
    forcing_period=lambda p: 2 * math.pi,
)  # fmt: skip


def one_turn(A: float, x: float, v: float, t: float, steps: int = 4000) -> np.ndarray:
    """Duffing's oscillator 2 pi later, by the classical Runge-Kutta method."""

    def f(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[1], A * math.cos(t) - 0.2 * y[1] - y[0] ** 3])

    y, h = np.array([x, v]), 2 * math.pi / steps
    for _ in range(steps):
        k1 = f(t, y)
        k2 = f(t + h / 2, y + h / 2 * k1)
        k3 = f(t + h / 2, y + h / 2 * k2)
        k4 = f(t + h, y + h * k3)
        y, t = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), t + h
    return y


def test_a_symmetric_cycle_becomes_lopsided():
    """x(t + T/2) = -x(t) is found and used; where it is lost two cycles branch off, each the other's mirror image."""
    symmetric = find_cycle(DUFFING, x=0.0, v=0.0)
    assert symmetric.repeats == 2
    branch = follow(symmetric, "A", to=4.0, options=TIGHT)
    (lost,) = branch.special
    assert lost.kind == "symmetry breaking"
    one, other = (follow(branch_off(lost, "A", off=off), "A", to=2.8, options=TIGHT).orbits[-1]
                  for off in (0.02, -0.02))
    low, high = one.extrema("x")
    mirrored = other.extrema("x")
    assert abs(high.value + low.value) > 0.05
    assert high.value == pytest.approx(-mirrored.low.value, rel=1e-6)
    for orbit in (one, other):
        assert orbit.repeats == 1 and orbit.stable and orbit.period == pytest.approx(2 * math.pi, rel=1e-10)
        x, v, turns = orbit.arcs[0].states[0, 0]
        np.testing.assert_allclose(one_turn(2.8, x, v, 2 * math.pi * turns), [x, v], rtol=0, atol=1e-7)
    x, v, turns = lost.orbit.arcs[0].states[0, 0]
    A = lost.orbit.problem.value("A")
    np.testing.assert_allclose(one_turn(A, x, v, 2 * math.pi * turns), [x, v], rtol=0, atol=1e-7)


def loss_of_symmetry(low: float, high: float) -> float:
    """A at which the map x -> -phi(x) of half a turn of Duffing's oscillator has the multiplier -1: by DOP853."""
    x = np.array([0.8, 1.2])

    def f(t: float, y: np.ndarray, A: float) -> np.ndarray:
        slope = np.array([[0.0, 1.0], [-3 * y[0] ** 2, -0.2]])
        return np.concatenate([[y[1], A * math.cos(t) - 0.2 * y[1] - y[0] ** 3], (slope @ y[2:].reshape(2, 2)).ravel()])

    def multiplier(A: float) -> float:
        nonlocal x
        for _ in range(20):
            start = np.concatenate([x, np.eye(2).ravel()])
            end = -solve_ivp(f, (0.0, math.pi), start, "DOP853", args=(A,), rtol=1e-13, atol=1e-13).y[:, -1]
            map_slope = end[2:].reshape(2, 2)
            step = np.linalg.solve(np.eye(2) - map_slope, end[:2] - x)
            x = x + step
            if np.max(np.abs(step)) < 1e-12:
                break
        return float(np.min(np.linalg.eigvals(map_slope).real)) + 1

    return float(brentq(multiplier, low, high, xtol=1e-13))


@pytest.mark.parametrize("off", [0.02, -0.02])
def test_a_lopsided_branch_ends_where_it_meets_its_image(off):
    """At the loss of symmetry that it comes from, come to along the other branch: where lambda turns back like d^2."""
    (lost,) = follow(find_cycle(DUFFING, x=0.0, v=0.0), "A", to=4.0, options=TIGHT).special
    lopsided = follow(branch_off(lost, "A", off=off), "A", to=2.8, options=TIGHT).orbits[-1]
    branch = follow(lopsided, "A", to=2.0, options=TIGHT)
    (met,) = branch.special
    assert met.kind == "symmetry breaking" and "meets in the symmetric one" in met.meaning
    assert "own image" in branch.ended
    x, v, turns = lost.orbit.arcs[0].states[0, 0]
    A = loss_of_symmetry(2.39, 2.42)
    for special in (lost, met):
        assert special.orbit.problem.value("A") == pytest.approx(A, rel=2e-9) and special.orbit.repeats == 2
    assert branch.orbits[-1] is met.orbit and not branch.missed
    assert all(a > A for a in branch.values[:-1])


def test_two_bounces_meet_the_single_one():
    """They end at the flip; what is not told from its image (`LOPSIDED`) has met nothing."""
    (flip,) = follow(bouncing(), "a", to=0.05, options=TIGHT).special
    two = follow(branch_off(flip, "a"), "a", to=0.028, options=TIGHT).orbits[-1]
    branch = follow(two, "a", to=0.01, options=TIGHT)
    (met,) = branch.special
    assert met.kind == "flip" and "half its period" in met.meaning and not branch.missed
    assert met.orbit.problem.value("a") == pytest.approx(FLIP, rel=2e-9)
    assert met.orbit.period == pytest.approx(2 * math.pi / W, rel=1e-10)
    assert np.all(branch.values > FLIP) and branch.periods == pytest.approx(4 * math.pi / W, rel=1e-9)


def test_a_real_pair_whose_product_passes_one_is_no_torus():
    """mu = exp(2 pi (1 + s)) and exp(-2 pi): their product is exp(2 pi s), real all along, and nothing branches off."""
    system = System(
        "circle with a saddle", ("x", "y", "u", "w"), {"s": -0.3},
        (
            Mode(
                "turn",
                field=lambda x, p: {
                    "x": x.x * (1 - x.x**2 - x.y**2) - x.y,
                    "y": x.y * (1 - x.x**2 - x.y**2) + x.x,
                    "u": (1 + p.s) * x.u,
                    "w": -x.w,
                },
            ),
        ),
    )  # fmt: skip
    orbit = find_cycle(system, x=1.0, y=0.0, u=0.0, w=0.0, settled=True)
    branch = follow(orbit, "s", to=0.3)
    assert branch.values[-1] == 0.3 and not branch.special and not branch.missed


def test_multipliers_that_are_not_trusted_have_no_sign():
    """On one mesh nobody knows their error: no torus, no flip, whatever they are."""

    class Unknown:
        class multipliers:
            error, half, floor = math.inf, np.array([1.0, 2.0, -3.0]), np.zeros(3)

        scale = np.ones(3)

    for monitor in (bifurcations.BRANCH_POINT, bifurcations.FLIP, bifurcations.NEIMARK_SACKER):
        assert all(one.noise(Unknown()) == math.inf for one in monitor.each(Unknown()))
    assert not bifurcations.NEIMARK_SACKER.confirmed(Unknown())


def test_a_branch_of_many_points_is_said_in_few_lines():
    branch = follow(bouncing(), "a", to=0.05, options=TIGHT)
    many = replace(branch, special=branch.special * 40)
    lines = str(many).splitlines()
    assert len(str(branch).splitlines()) == 2 and "more" not in str(branch)
    assert len(lines) == 10 and lines[-1] == "and 32 more"
