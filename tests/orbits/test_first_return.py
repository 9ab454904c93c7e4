"""A guess some percent beside a cycle, stable or not, leads to that cycle; how far it lies from the guess is said."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt.errors import NoOrbit, Status
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle
from problems import impact_oscillator, lorenz

BESIDE = [0.95, 0.99, 0.9999, 1.0001, 1.01, 1.05]


def dry() -> System:
    """x'' = 0.4 x' - x - sign(x'): the half turn is a spiral about -+1, outwards by E = exp(0.2 pi / sqrt(0.96))."""

    def moves(name, sign, to):
        end = Event(f"{name} ends", lambda x, p: x.y, -int(sign), to=to)
        field = lambda x, p: {"x": x.y, "y": -x.x + p.b * x.y - sign}  # noqa: E731
        return Mode(name, field, holds=lambda x, p: sign * x.y, ends=(end,))

    return System("dry", ("x", "y"), {"b": 0.4}, (moves("plus", 1.0, "minus"), moves("minus", -1.0, "plus")))


@pytest.mark.parametrize("x", [2.7, 3.06, 3.2, 3.25, 3.3, 3.386, 3.7])
def test_disturbances_that_double_in_half_a_turn(x):
    """A = (E + 1)/(E - 1), in half a period pi / sqrt(0.96); before, from 3.2 and 3.25 a refusal."""
    omega = math.sqrt(0.96)
    E = math.exp(0.2 * math.pi / omega)
    A = (E + 1) / (E - 1)
    orbit = find_cycle(dry(), "minus", x=x, y=0.0, settled=True)
    assert orbit.extrema("x").high.value == pytest.approx(A, rel=1e-9)
    assert orbit.period == pytest.approx(2 * math.pi / omega, rel=1e-9)
    assert orbit.repeats == 2 and orbit.half_multiplier == pytest.approx(E, rel=1e-8)
    assert orbit.from_start <= abs(x / A - 1) * (1 + 1e-6) and orbit.from_start > 0.9 * abs(x / A - 1)
    assert f"{orbit.from_start:.2g} from the start" in str(orbit)


def saddle(a: float, b: float) -> System:
    """A circle of radius 1, unstable as exp(4 pi a), on a tilted plane that attracts with -b."""

    def field(x, p):
        g = a * (x.x**2 + x.y**2 - 1)
        return {"x": g * x.x - x.y, "y": g * x.y + x.x, "z": b * (x.z - x.x) - x.y}

    return System("saddle", ("x", "y", "z"), {}, (Mode("smooth", field),))


@pytest.mark.parametrize("a, b", [(0.1, -0.2), (0.2, -0.5)])
@pytest.mark.parametrize("off", [(0, 0, 0), (0.01, 0.01, 0.01), (-0.05, -0.05, -0.05), (0, 0, 0.05), (0.05, 0, 0)])
def test_saddles(a, b, off):
    """They attract neither forwards nor backwards; outwards the motion is at infinity within a turn."""
    x, y, z = np.array([0.6, 0.8, 0.6]) * (1 + np.array(off))
    orbit = find_cycle(saddle(a, b), x=x, y=y, z=z, settled=True, tol=1e-9)
    assert orbit.period == pytest.approx(2 * math.pi, rel=1e-9)
    expected = [math.exp(2 * math.pi * b), 1.0, math.exp(4 * math.pi * a)]
    assert sorted(orbit.multipliers.full.real) == pytest.approx(expected, rel=1e-7)
    turn = np.linspace(0, 2 * math.pi, 100_001)  # by brute force: all sizes are one
    on_it = np.array([np.cos(turn), np.sin(turn), np.cos(turn)])
    nearest = np.abs(on_it - np.array([[x], [y], [z]])).max(axis=0).min()
    assert orbit.from_start == pytest.approx(nearest, abs=3e-5)


@pytest.mark.parametrize("beside", BESIDE)
def test_an_unstable_outer_cycle(beside):
    """x'' = -x + e (1 - q)(4 - q) x', q = x^2 + x'^2: disturbances of q = 4 grow by some thousand in a turn."""
    mode = Mode("smooth", lambda x, p: {"x": x.v, "v": -x.x + 0.1 * (1 - (q := x.x**2 + x.v**2)) * (4 - q) * x.v})
    orbit = find_cycle(System("two rings", ("x", "v"), {}, (mode,)), x=2.0 * beside, v=0.0, settled=True, tol=1e-9)
    assert orbit.period == pytest.approx(2 * math.pi, rel=1e-9) and orbit.stable is False
    assert orbit.extrema("x").high.value == pytest.approx(2, rel=1e-9)
    assert orbit.from_start == pytest.approx(abs(beside - 1), rel=0.05)


@pytest.mark.parametrize("mode", ["right", "left"])
@pytest.mark.parametrize("v", [-2.17, 2.172713])
def test_a_start_on_an_event(mode, v):
    """Van der Pol in two modes, from the place where they change: in the mode that ends at once, and in the other."""
    field = lambda x, p: {"x": x.v, "v": (1 - x.x**2) * x.v - x.x}  # noqa: E731
    left = Mode("left", field, ends=(Event("up", lambda x, p: x.x, 1, to="right"),))
    right = Mode("right", field, ends=(Event("down", lambda x, p: x.x, -1, to="left"),))
    orbit = find_cycle(System("vdp", ("x", "v"), {}, (left, right)), mode, x=0.0, v=v, settled=True, tol=1e-9)
    assert orbit.period == pytest.approx(6.6632868593231301, rel=1e-9) and orbit.from_start < 1e-3


@pytest.mark.parametrize("v", [2.0, 2.172713, 2.3])
def test_van_der_pol_backwards(v):
    """Disturbances grow by 1163 in a turn; the period is that forwards."""
    field = lambda x, p: {"x": -x.v, "v": x.x - p.mu * (1 - x.x**2) * x.v}  # noqa: E731
    orbit = find_cycle(System("back", ("x", "v"), {"mu": 1.0}, (Mode("smooth", field),)), x=0.0, v=v, settled=True)
    assert orbit.period == pytest.approx(6.66328685932313, rel=1e-9) and not orbit.stable


def walker(*, modes: int) -> System:
    """The simplest walker (Garcia et al. 1998) at slope 0.009, stated as one mode, or parted where the feet pass."""

    def swings(x, p):
        s = ca.sin(x.th - p.slope)
        return {"th": x.w, "w": s, "ph": x.u, "u": s + ca.sin(x.ph) * (x.w**2 - ca.cos(x.th - p.slope))}

    def strike(x, p):
        c = ca.cos(2 * x.th)
        return {"th": -x.th, "w": c * x.w, "ph": -2 * x.th, "u": c * (1 - c) * x.w}

    def gap(x, p):
        return x.ph - 2 * x.th

    late = Mode("late", swings, ends=(Event("strike", gap, +1, to="early" if modes > 1 else "late", reset=strike),))
    early = Mode("early", swings, ends=(Event("passes", gap, -1, to="late"),))
    return System("walker", ("th", "w", "ph", "u"), {"slope": 0.009}, (early, late)[-modes:])


@pytest.mark.parametrize("modes", [1, 2])
@pytest.mark.parametrize("beside", BESIDE)
def test_the_unstable_gait_of_a_walker(modes, beside):
    """Its steps are shorter by 3 % than those of the stable one, to which a search from 1e-4 beside it went before."""
    start = {"th": 0.19393737, "w": -0.20386693, "ph": 0.38787474, "u": -0.01514426}
    system = walker(modes=modes)
    guess = {name: beside * value for name, value in start.items()}
    orbit = find_cycle(system, system.modes[0].name, start=guess, settled=True, tol=1e-9)
    assert orbit.extrema("th").high.value == pytest.approx(0.193937369810, abs=2e-12)
    assert not orbit.stable and len(orbit.arcs) == modes
    assert orbit.from_start <= abs(beside - 1) * 1.01


@pytest.mark.parametrize("beside", BESIDE)
def test_a_saddle_in_chaos(beside):
    """Of an impact oscillator with an impact in every turn of its forcing."""
    truth = impact_oscillator.TRUTH[(2.8, 0.0)]
    start = {name: beside * value for name, value in impact_oscillator.SADDLE.items()}
    orbit = find_cycle(impact_oscillator.SYSTEM, parameters={"w": 2.8, "d": 0.0}, settled=True, start=start, tol=1e-9)
    assert orbit.period == pytest.approx(truth.period, rel=1e-12) and not orbit.stable
    assert orbit.extrema("v").high.value == pytest.approx(truth.extrema["v"][1], rel=1e-8)


@pytest.mark.parametrize("beside", BESIDE)
def test_lorenz(beside):
    """The unstable cycle about one equilibrium."""
    start = {name: beside * value for name, value in lorenz.SMALL.items()}
    orbit = find_cycle(lorenz.SYSTEM, parameters={"r": 20.0}, settled=True, start=start)
    assert orbit.period == pytest.approx(lorenz.small().period, rel=1e-8) and not orbit.stable


def spring(x: float) -> float:
    """With a clearance from -1 to 1."""
    return 4 * (x - min(max(x, -1), 1))


@pytest.mark.parametrize("beside", BESIDE)
def test_three_modes(beside):
    """x'' = -0.3 x' + 0.1 x'^3 - k(x): backwards it is pushed up to its cycle, which DOP853 follows."""

    def mode(name, force, *ends):
        return Mode(name, lambda x, p: {"x": x.v, "v": -0.3 * x.v + 0.1 * x.v**3 - force(x)}, ends=ends)

    right, left = (lambda x, p: x.x - 1), (lambda x, p: x.x + 1)
    gap = mode("gap", lambda x: 0, Event("hits", right, +1, to="right"), Event("hits back", left, -1, to="left"))
    system = System("clearance", ("x", "v"), {}, (
        gap,
        mode("right", lambda x: 4 * (x.x - 1), Event("leaves", right, -1, to="gap")),
        mode("left", lambda x: 4 * (x.x + 1), Event("leaves back", left, +1, to="gap")),
    ))  # fmt: skip

    def top(t, y):
        return y[1]

    top.direction = -1
    back = solve_ivp(
        lambda t, y: [y[1], 0.3 * y[1] - 0.1 * y[1] ** 3 - spring(y[0])], (0, 150), [2.0, 0.0],
        method="DOP853", rtol=1e-11, atol=1e-12, events=top, max_step=0.05,
    )  # fmt: skip
    high, period = back.y_events[0][-1][0], float(np.diff(back.t_events[0])[-1])
    orbit = find_cycle(system, "right", x=high * beside, v=0.0, settled=True, tol=1e-9)
    assert orbit.period == pytest.approx(period, rel=1e-7)
    assert orbit.extrema("x").high.value == pytest.approx(high, rel=1e-7) and not orbit.stable
    assert "gap" in (modes := {arc.mode for arc in orbit.arcs}) and len(modes) == (2 if orbit.half else 3)


# What is said --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("x", "why"), [(0.3, "start nearer to a cycle"), (1.6, "start nearer to a cycle")])
def test_a_cycle_far_from_the_guess_is_none_of_it(x, why):
    """The unit circle is stable: the motion goes there, and that is no answer for a guess so far away."""

    def field(x, p):
        g = 1 - x.x**2 - x.y**2
        return {"x": g * x.x - x.y, "y": g * x.y + x.x}

    circle = System("circle", ("x", "y"), {}, (Mode("smooth", field),))
    assert find_cycle(circle, x=x, y=0.0).period == pytest.approx(2 * math.pi, rel=1e-9)
    with pytest.raises(NoOrbit, match=why) as refusal:
        find_cycle(circle, x=x, y=0.0, settled=True)
    assert refusal.value.status is Status.NOT_FOUND
    near = find_cycle(circle, x=1.1, y=0.0, settled=True)
    assert near.from_start == pytest.approx(0.1, rel=0.01) and math.isnan(find_cycle(circle, x=x, y=0.0).from_start)
