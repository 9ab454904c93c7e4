"""Curves of special points in two parameters, against closed forms and integrators that share nothing with them."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import mathieu_a, mathieu_b

from casahunt import InputError, NoOrbit
from casahunt.continuation import SpecialPoint, follow, special_curve, two_parameters, user_monitor
from casahunt.continuation.bifurcations import FLIP, NEIMARK_SACKER
from casahunt.continuation.plane_curve import Evaluation
from casahunt.continuation.special_points import FOLD
from casahunt.continuation.surface import Axis, Place, Sought, not_what_it_is_called, place_of
from casahunt.hybrid import Mode, System
from casahunt.orbits import Options, find_cycle
from casahunt.orbits.orbit import unknowns_of
from problems import bouncing_ball, rossler

TIGHT = Options(tol=1e-9)
G = bouncing_ball.SYSTEM.parameters["g"]


def true_to_its_error(curve, exact, slopes, room=1e-12):
    """Values and slopes are the closed form's, no further off than the curve says."""
    x = curve.values[:, 0]
    unit = np.maximum(abs(exact), abs(curve.orbits[0].problem.system.parameters[curve.vary]))
    assert np.all(abs(x - exact) <= (curve.errors + room) * unit)
    assert np.max(curve.errors) < 1e-8
    np.testing.assert_allclose(curve.slopes, slopes, rtol=1e-5, atol=1e-6)
    assert all(orbit.error_estimate <= 1e-9 for orbit in curve.orbits)


def fold_and_slope(r, w):
    """a = pi g (1 - r)/((1 + r) w^2), with its derivatives by r and w."""
    a = math.pi * G * (1 - r) / (1 + r) / w**2
    return a, a * (-1 / (1 - r) - 1 / (1 + r)), -2 * a / w


def flip_and_slope(r, w):
    """a of the flip (problems/bouncing_ball.py), with its derivatives by r and w."""
    fold, by_r, by_w = fold_and_slope(r, w)
    rest = 2 * G * (1 + r**2) / (1 + r) ** 2 / w**2
    a = np.hypot(fold, rest)
    rest_by_r = rest * (2 * r / (1 + r**2) - 2 / (1 + r))
    return a, (fold * by_r + rest * rest_by_r) / a, (fold * by_w - 2 * rest**2 / w) / a


@pytest.fixture(scope="module")
def ball():
    """The fold and the flip of a bouncing ball in the amplitude of the table."""
    orbit = next(found.orbit for found in bouncing_ball.cycles() if found.caption.startswith("1 turns, 1.46 folds, u"))
    a = orbit.problem.value("a")
    down, up = follow(orbit, "a", to=a / 2, back=2 * a, options=TIGHT), follow(orbit, "a", to=4 * a, options=TIGHT)
    return {"fold": down.special[0], "flip": up.special[0]}


@pytest.mark.parametrize("kind, truth, other, to", [
    ("fold", fold_and_slope, "e", 0.3), ("flip", flip_and_slope, "w", 60.0),
    pytest.param("fold", fold_and_slope, "w", 60.0, marks=pytest.mark.slow),
    pytest.param("flip", flip_and_slope, "e", 0.3, marks=pytest.mark.slow),
])  # fmt: skip
def test_fold_and_flip_of_the_bouncing_ball(ball, kind, truth, other, to):
    """0.2 to 1 s for 12 cycles."""
    curve = special_curve(ball[kind], "a", other, to=to, options=TIGHT)
    assert curve.kind == kind and curve.complete and curve.values[-1, 1] == to and not curve.turns.any()
    q = curve.values[:, 1]
    a, by_r, by_w = truth(q, 20.0) if other == "e" else truth(0.8, q)
    true_to_its_error(curve, a, by_r if other == "e" else by_w)
    assert f"{other} = {to:.8g}" in str(curve) and "the end of the range" in curve.ended


def test_folds_in_batches_are_those_one_by_one(ball, monkeypatch):
    """Patched: without batches, which go as far as they can."""
    quickly = special_curve(ball["fold"], "a", "e", to=0.5, options=TIGHT)
    monkeypatch.setattr(two_parameters, "folds_ahead", lambda *_: iter(()))
    singly = special_curve(ball["fold"], "a", "e", to=0.5, options=TIGHT)
    np.testing.assert_allclose(quickly.values[-1], singly.values[-1], rtol=1e-9)
    np.testing.assert_allclose(quickly.slopes[-1], singly.slopes[-1], rtol=1e-7)


def test_axes_join_what_the_user_draws(ball):
    from matplotlib.figure import Figure

    curve = special_curve(ball["fold"], "a", "e", to=0.7, options=TIGHT, points=3)
    ax = Figure().subplots()
    assert curve.plot(ax=ax, color="k") is ax and ax.get_xlabel() == "e" and ax.get_ylabel() == "a"
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), curve.values[:, ::-1])


def circle(**parameters) -> System:
    """The unit circle in 2 pi; across it z' = (alpha + beta^2 - 1/100 + i omega) z."""
    return System(
        "circle with a spiral", ("x", "y", "u", "w"), {"alpha": -0.02, "beta": 0.02, "omega": 0.3} | parameters,
        (
            Mode(
                "turn",
                field=lambda x, p: {
                    "x": x.x * (1 - x.x**2 - x.y**2) - x.y,
                    "y": x.y * (1 - x.x**2 - x.y**2) + x.x,
                    "u": (p.alpha + p.beta**2 - 0.01) * x.u - p.omega * x.w,
                    "w": p.omega * x.u + (p.alpha + p.beta**2 - 0.01) * x.w,
                },
            ),
        ),
    )  # fmt: skip


def torus_of(system, vary, to):
    orbit = find_cycle(system, x=1.0, y=0.0, u=0.0, w=0.0, settled=True)
    (torus,) = follow(orbit, vary, to=to, options=TIGHT).special
    assert torus.kind == "Neimark-Sacker"
    return torus


@pytest.mark.slow
def test_a_torus_curve_turns_back():
    """In beta against alpha: beta^2 = 0.01 - alpha, which turns at alpha = 0.01, beta = 0."""
    torus = torus_of(circle(alpha=-0.02), "beta", 0.25)
    curve = special_curve(torus, "beta", "alpha", to=0.05, options=TIGHT)
    beta, alpha = curve.values.T
    assert np.all(abs(beta**2 - 0.01 + alpha) < 1e-9)
    assert curve.complete and curve.values[-1, 1] == -0.02 and curve.values[-1, 0] == pytest.approx(-math.sqrt(0.03))
    assert curve.turns.sum() == 1
    turn = curve.values[curve.turns][0]
    assert turn[1] == pytest.approx(0.01, abs=1e-9) and abs(turn[0]) < 1e-4
    steep = ~curve.turns & (abs(beta) > 0.02)
    np.testing.assert_allclose(curve.slopes[steep], -0.5 / beta[steep], rtol=1e-3)
    assert "turns back at alpha = 0.01" in str(curve)


@pytest.mark.slow
@pytest.mark.parametrize("to, bound, resonance", [(0.6, 0.5, "1:2"), (-0.1, 0.0, "1:1")])
def test_a_torus_curve_ends_at_a_strong_resonance(to, bound, resonance):
    """mu = exp(2 pi i omega): both are -1 at omega = 1/2 and 1 at omega = 0, though on both sides they are complex."""
    curve = special_curve(torus_of(circle(beta=0.0), "alpha", 0.05), "alpha", "omega", to=to, options=TIGHT)
    assert not curve.complete and resonance in curve.ended
    assert curve.values[-1, 1] == pytest.approx(bound, abs=1e-4)
    assert np.all(abs(curve.values[:, 0] - 0.01) < 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("to, resonance", [(0.3, "1:2"), (-0.1, "1:1")])
def test_a_torus_curve_ends_at_a_tongue(to, resonance):
    """Mathieu's equation across the circle: complex multipliers between its tongues (scipy's characteristic values)."""
    swing = System(
        "swing", ("x", "y", "u", "w"), {"alpha": -0.02, "delta": 0.15, "epsilon": 0.1},
        (
            Mode(
                "turn",
                field=lambda x, p: {
                    "x": x.x * (1 - x.x**2 - x.y**2) - x.y,
                    "y": x.y * (1 - x.x**2 - x.y**2) + x.x,
                    "u": x.w,
                    "w": 2 * p.alpha * x.w - (p.delta + p.epsilon * x.x) * x.u,
                },
            ),
        ),
    )  # fmt: skip
    curve = special_curve(torus_of(swing, "alpha", 0.02), "alpha", "delta", to=to, options=TIGHT)
    edge = (mathieu_b(1, 0.2) if to > 0.15 else mathieu_a(0, 0.2)) / 4
    assert not curve.complete and resonance in curve.ended
    assert curve.values[-1, 1] == pytest.approx(edge, abs=2e-5)
    assert np.all(abs(curve.values[:, 0]) < 1e-10)


CUSP = System(
    "cusp of cycles", ("x", "y"), {"lam": -0.2, "beta": 0.3},
    (
        Mode(
            "turn",
            field=lambda x, p: {
                "x": x.x * (p.lam + p.beta * (x.x**2 + x.y**2 - 1) - (x.x**2 + x.y**2 - 1) ** 3) - x.y,
                "y": x.y * (p.lam + p.beta * (x.x**2 + x.y**2 - 1) - (x.x**2 + x.y**2 - 1) ** 3) + x.x,
            },
        ),
    ),
)  # fmt: skip
"""With rho = r^2 - 1: lam = rho^3 - beta rho, folds at lam^2 = 4 (beta/3)^3, which meet in a cusp at zero."""


@pytest.mark.slow
def test_a_fold_curve_through_its_cusp():
    """Both parameters pass through zero, and the second fold is the first one's mirror image."""
    orbit = find_cycle(CUSP, x=0.7, y=0.0)
    (fold,) = follow(orbit, "lam", to=0.3, back=-0.3, options=TIGHT, monitors=(FOLD,)).special[:1]
    curve = special_curve(fold, "lam", "beta", to=-0.1, options=TIGHT)
    lam, beta = curve.values.T
    assert np.all(abs(lam**2 - 4 * (beta / 3) ** 3) < 1e-9)
    assert curve.complete and beta[-1] == 0.3 and lam[-1] == pytest.approx(-lam[0], rel=1e-8)
    assert curve.turns.sum() == 1 and np.all(abs(curve.values[curve.turns]) < 1e-6)


def turn_of_rossler(a, b, c, x, steps):
    """(state, its derivative by the state at the start) after one turn, by scipy's DOP853."""

    def field(t, y):
        x, y, z, W = *y[:3], y[3:].reshape(3, 3)
        J = np.array([[0, -1, -1], [1, a, 0], [z, 0, x - c]])
        return np.concatenate([[-y - z, x + a * y, b + z * (x - c)], (J @ W).ravel()])

    start = np.concatenate([x, np.eye(3).ravel()])
    found = solve_ivp(field, (0, steps), start, method="DOP853", rtol=1e-12, atol=1e-13)
    return found.y[:3, -1], found.y[3:, -1].reshape(3, 3)


@pytest.mark.slow
@pytest.mark.parametrize("other, to", [pytest.param("a", 0.3, marks=pytest.mark.slow), ("b", 0.5)])
def test_flips_of_rosslers_system(other, to):
    """At three points of the curve an integrator finds the cycle closed, with a multiplier -1; 2 s for 12 cycles."""
    orbit = find_cycle(rossler.SYSTEM, x=-2.5, y=0.0, z=0.0)
    (flip,) = follow(orbit, "c", to=3.2, options=TIGHT).special
    curve = special_curve(flip, "c", other, to=to, options=TIGHT)
    assert curve.complete
    for found in (curve.orbits[k] for k in (0, 5, -1)):
        p = found.parameters
        start = found.arcs[0].states[0, 0]
        end, map_of_it = turn_of_rossler(p["a"], p["b"], p["c"], start, found.period)
        np.testing.assert_allclose(end, start, atol=1e-8)
        assert np.min(abs(np.linalg.eigvals(map_of_it) + 1)) < 1e-7
    chords = np.diff(curve.values[:, 0]) / np.diff(curve.values[:, 1])
    np.testing.assert_allclose((curve.slopes[1:] + curve.slopes[:-1]) / 2, chords, rtol=2e-3)


@pytest.mark.slow
def test_where_duffings_cycle_loses_its_symmetry():
    """Half a turn, mirrored, has a multiplier -1, by an integrator; 0.8 s for 12 cycles."""
    import casadi as ca

    duffing = System(
        "Duffing", ("x", "v"), {"A": 1.0, "d": 0.2},
        (Mode("smooth", field=lambda x, p: {"x": x.v, "v": p.A * ca.cos(x.t) - p.d * x.v - x.x**3}),),
        forcing_period=lambda p: 2 * math.pi,
    )  # fmt: skip
    (lost,) = follow(find_cycle(duffing, x=0.0, v=0.0), "A", to=4.0, options=TIGHT).special
    curve = special_curve(lost, "A", "d", to=0.05, options=TIGHT)
    assert curve.kind == "symmetry breaking" and curve.complete
    for found in (curve.orbits[k] for k in (0, 5, -1)):
        A, d = found.parameters["A"], found.parameters["d"]

        def field(t, y, A=A, d=d):
            W = np.array([[0, 1], [-3 * y[0] ** 2, -d]]) @ y[2:].reshape(2, 2)
            return [y[1], A * math.cos(t) - d * y[1] - y[0] ** 3, *W.ravel()]

        x, v, turns = found.arcs[0].states[0, 0]
        t = 2 * math.pi * turns
        end = solve_ivp(field, (t, t + math.pi), [x, v, 1, 0, 0, 1], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        np.testing.assert_allclose(end[:2], [-x, -v], atol=1e-8)
        assert np.min(abs(np.linalg.eigvals(-end[2:].reshape(2, 2)) + 1)) < 1e-7


def test_a_monitor_of_ones_own():
    """Cycles of the period 6: r^2 = mu, T = 2 pi/(omega + shear mu)."""
    sheared = System(
        "sheared", ("x", "y"), {"mu": 0.3, "omega": 1.0, "shear": 0.3},
        (
            Mode(
                "turn",
                field=lambda x, p: {
                    "x": x.x * (p.mu - x.x**2 - x.y**2) - (p.omega + p.shear * (x.x**2 + x.y**2)) * x.y,
                    "y": x.y * (p.mu - x.x**2 - x.y**2) + (p.omega + p.shear * (x.x**2 + x.y**2)) * x.x,
                },
            ),
        ),
    )  # fmt: skip
    monitor = user_monitor("period 6", lambda orbit: orbit.period - 6)
    orbit = find_cycle(sheared, x=0.5, y=0.0)
    (special,) = follow(orbit, "mu", to=0.1, options=TIGHT, monitors=(monitor,)).special
    with pytest.raises(InputError, match="its monitor must be given"):
        special_curve(special, "mu", "shear", to=0.6)
    curve = special_curve(special, "mu", "shear", to=0.6, monitor=monitor, options=TIGHT)
    shear = curve.values[:, 1]
    np.testing.assert_allclose(curve.values[:, 0], (2 * math.pi / 6 - 1) / shear, rtol=1e-8)


def test_what_is_refused(ball):
    fold = ball["fold"]
    with pytest.raises(InputError, match="must differ"):
        special_curve(fold, "a", "a", to=1.0)
    with pytest.raises(InputError, match="parameter"):
        special_curve(fold, "a", "b", to=1.0)
    with pytest.raises(InputError, match="cannot go to"):
        special_curve(fold, "a", "e", to=0.8)
    with pytest.raises(InputError, match="points"):
        special_curve(fold, "a", "e", to=0.5, points=1)
    with pytest.raises(NoOrbit, match="was not begun"):  # at a fold nothing flips
        special_curve(replace(fold, kind="flip"), "a", "e", to=0.5)


def multipliers(*values, error=0.0, trusted=True):
    half = np.array([1.0, *values], complex)
    return SimpleNamespace(multipliers=SimpleNamespace(half=half, error=error, trusted=trusted))


@pytest.mark.parametrize("monitor, orbit, words", [
    (FLIP, multipliers(-1.0, 0.5), ""),
    (FLIP, multipliers(-1.001, 0.5), "no multiplier is -1"),
    (FLIP, multipliers(-1.0, trusted=False), "not known well enough"),
    (NEIMARK_SACKER, multipliers(np.exp(1j), np.exp(-1j)), ""),
    (NEIMARK_SACKER, multipliers(1.1 * np.exp(1j), 1.1 * np.exp(-1j)), "no pair"),
    (NEIMARK_SACKER, multipliers(-2.0, -0.5), "1:2"),
    (NEIMARK_SACKER, multipliers(2.0, 0.5), "1:1"),
    (FOLD, multipliers(1.0), ""),
])  # fmt: skip
def test_special_points_are_what_they_are_called(monitor, orbit, words):
    said = not_what_it_is_called(monitor, orbit)
    assert words in said and bool(said) == bool(words)


def beside(fold, monitor=FOLD) -> Place:
    """The place of the ball's fold on the surface over a and e."""
    return place_of(Sought(monitor, "a", Axis("e", 0.8, 0.5), TIGHT, 0.1), fold.orbit, 0.0)


def test_a_change_of_the_phases_ends_a_curve(ball):
    class Elsewhere(Place):
        def orbit_at(self, s, m):
            return replace(self.orbit, arcs=(*self.orbit.arcs, *self.orbit.arcs))

    place = beside(ball["fold"], FLIP)
    other = Elsewhere(*(getattr(place, name) for name in Place.__dataclass_fields__))
    assert "phases of the cycle change" in other.value(0.1, 0.0)
    assert isinstance(place.value(0.0, 0.0), Evaluation)


def test_the_tangent_plane_of_the_surface(ball):
    """Cycles beside it in e, corrected, against u_m; da/dc of the closed form against lambda_m."""
    place = beside(ball["fold"])
    _, by_e, _ = fold_and_slope(0.8, 20.0)
    assert place.steepness * place.orbit.problem.unit("a") == pytest.approx(by_e * (0.5 - 0.8), rel=1e-7)
    h = 1e-4
    there, back = (unknowns_of(place.orbit_at(0.0, m))[1] for m in (h, -h))
    np.testing.assert_allclose((there - back) / (2 * h), place.tilt, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("start", "end", "middle"),
    [(0.8, 0.5, 0.65), (1e-3, 1e3, 1.0), (1e3, 1e-3, 1.0), (-1e-3, 1e3, 499.9995), (0, 4.0, 2.0), (-4.0, -1.0, -2.5)],
)
def test_a_wide_range_is_spread_over_its_logarithm(start, end, middle):
    """Where both ends are above zero, and far from each other."""
    axis = Axis("e", start, end)
    assert axis.value(0.5) == pytest.approx(middle, rel=1e-12) and axis.place(middle) == pytest.approx(0.5, rel=1e-12)
    assert [axis.value(c) for c in (0.0, 1.0)] == [start, end] and [axis.place(q) for q in (start, end)] == [0, 1]
    for c in (0.2, 0.9):
        slope = (axis.value(c + 1e-6) - axis.value(c - 1e-6)) / 2e-6
        assert axis.rate(c) == pytest.approx(slope, rel=1e-6)


def test_another_part_of_the_surface_is_seen(ball):
    """The slopes on both sides explain the change of the parameter, or the corrector went somewhere else."""
    steep = replace(beside(ball["fold"]), steepness=2.0)
    problem = steep.orbit.problem
    a = problem.value("a")

    def moved(change):
        there = replace(steep.orbit, problem=problem.with_value("a", a + change * problem.unit("a")))
        return replace(steep, orbit=there, position=0.1)

    assert steep.agrees(moved(0.2)) and not steep.agrees(moved(0.3)) and not steep.agrees(moved(0.1))


def test_a_special_point_is_sought_next_to_the_given_one(ball):
    """From a cycle beside the fold the curve begins at the fold."""
    fold = ball["fold"]
    near = SpecialPoint("fold", beside(fold).orbit_at(0.01, 0.0), "")
    curve = special_curve(near, "a", "e", to=0.7, options=TIGHT, points=3)
    assert curve.values[0, 0] == pytest.approx(fold.orbit.problem.value("a"), rel=1e-11)


def test_next_to_a_fold_the_parameter_moves_where_the_states_hardly_do(ball):
    """a = fold/cos(phi) on the branch: 1e-5 beside the fold Newton's step is nothing in the states, 1e-10 in a."""
    place = beside(ball["fold"])
    for s in (1e-5, -3e-5, 1e-4):
        orbit = place.orbit_at(s, 0.0)
        phi = 2 * math.pi * orbit.arcs[0].states[0, 0, 2]
        assert orbit.problem.value("a") == pytest.approx(fold_and_slope(0.8, 20.0)[0] / math.cos(phi), rel=1e-10)
