"""Cycles of users' systems: found where the truth is known, and what is refused."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from oscillator import START, VAN_DER_POL, assert_period, van_der_pol

from casahunt.collocation.admissibility import check_admissible, stands_still
from casahunt.errors import InputError, NoOrbit
from casahunt.hybrid import Event, Mode, System
from casahunt.motion import simulate
from casahunt.orbits import Options, find_cycle
from casahunt.orbits.orbit import unknowns_of


@pytest.mark.parametrize("tol", [1e-6, 1e-11])
def test_van_der_pol(tol):
    """On half a cycle; the multipliers multiply to the exponential of the divergence."""
    orbit = find_cycle(van_der_pol(), tol=tol, **START)
    period, amplitude = VAN_DER_POL[0.0]
    assert orbit.error_estimate <= tol
    assert_period(orbit, period)
    assert orbit.repeats == 2 and orbit.half and orbit.stable
    assert orbit.extrema("x").high.value == pytest.approx(amplitude, rel=10 * tol)
    t, x = orbit.sample(40)
    divergence = 1 - x[0] ** 2
    integral = float(np.sum(np.diff(t) * (divergence[1:] + divergence[:-1]) / 2))
    assert math.log(abs(np.prod(orbit.multipliers.full))) == pytest.approx(integral, rel=1e-3)


def test_what_stands_still_is_no_cycle():
    """An equilibrium solves the equations of any cycle, whatever its durations; but for rounding."""
    t, u, _ = unknowns_of(find_cycle(van_der_pol(), **START))
    states = u.size - t.durations_of(u).size
    for size, still in ((1.0, False), (1e-3, False), (1e-15, True)):
        assert stands_still(t, np.append(0.3 + size * u[:states], u[states:])) == still


@pytest.mark.parametrize("stiff", [False, True])
def test_relaxation(stiff):
    """mu = 1000, against Dorodnitsyn's expansion of the period: jumps of 1e-3 in 1614."""
    system = van_der_pol(mu=1000.0)
    if stiff:
        (mode,) = system.modes
        system = System(system.name, system.states, system.parameters, (Mode("stiff", mode.field, stiff=True),))
    orbit = find_cycle(system, tol=1e-8, **START)
    mu, alpha = 1000.0, 2.338107410459767
    slow = (3 - 2 * math.log(2)) * mu + 3 * alpha * mu ** (-1 / 3) - 2 * math.log(mu) / (3 * mu)
    assert orbit.period == pytest.approx(slow - 1.3246 / mu, abs=10 * mu ** (-4 / 3))
    assert orbit.stable and orbit.repeats == 2 and orbit.error_estimate < 1e-8


def stuart_landau(**changed: float) -> System:
    """r' = r (a - r^2), theta' = omega + b r^2."""

    def field(x, p):
        square = x.x**2 + x.y**2
        grows, turns = p.a - square, p.omega + p.b * square
        return {"x": grows * x.x - turns * x.y, "y": grows * x.y + turns * x.x}

    values = {"a": 0.5, "omega": 2.0, "b": 0.7} | changed
    return System("Stuart-Landau", ("x", "y"), values, (Mode("smooth", field),))


def test_stuart_landau():
    orbit = find_cycle(stuart_landau(), x=0.1, y=0.0, tol=1e-11)
    assert_period(orbit, 2 * math.pi / 2.35)
    multiplier = math.exp(-2 * 0.5 * 2 * math.pi / 2.35)
    assert sorted(orbit.multipliers.full.real) == pytest.approx([multiplier, 1.0], rel=1e-8)
    for arc in orbit.arcs:
        np.testing.assert_allclose(np.hypot(*arc.states[:, 0].T), math.sqrt(0.5), rtol=1e-10)


@pytest.mark.parametrize(("degree", "kind"), [(3, "radau"), (3, "gauss"), (None, "radau"), (9, None), (2, "radau")])
def test_the_scheme_of_the_question(degree, kind):
    """The motion is marched in another scheme; the cycle is solved in the one that is asked for."""
    orbit = find_cycle(stuart_landau(), x=0.1, y=0.0, options=Options(tol=1e-7, degree=degree, kind=kind))
    assert (orbit.degree, orbit.kind) == (degree or 7, kind or "gauss")
    assert_period(orbit, 2 * math.pi / 2.35)


def test_a_scheme_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="^degree = 13"):
        find_cycle(stuart_landau(), x=0.1, y=0.0, options=Options(degree=13))
    with pytest.raises(InputError, match="^scheme = 'trapezoid'"):
        find_cycle(stuart_landau(), x=0.1, y=0.0, options=Options(kind="trapezoid"))


def test_parameters_of_the_question():
    asked = {"parameters": {"a": 2.0, "b": 0.0}, "measure": "y", "follow": "b"}
    orbit = find_cycle(stuart_landau(), start={"x": 1.0}, y=0.0, **asked)
    assert orbit.parameters == {"a": 2.0, "omega": 2.0, "b": 0.0} and orbit.problem.principal == "b"
    assert_period(orbit, math.pi)


def test_a_rotor_that_turns_over():
    """w = F(theta) = c + e sin theta attracts with rate k: one turn takes 2 pi / sqrt(c^2 - e^2)."""

    def field(x, p):
        on, slope = p.c + p.e * ca.sin(x.theta), p.e * ca.cos(x.theta)
        return {"theta": x.w, "w": slope * x.w - p.k * (x.w - on)}

    values = {"c": 1.5, "e": 0.3, "k": 0.8}
    rotor = System("rotor", ("theta", "w"), values, (Mode("turns", field),), angles=("theta",))
    orbit = find_cycle(rotor, theta=0.0, w=1.0, tol=1e-10)
    assert_period(orbit, 2 * math.pi / math.sqrt(1.5**2 - 0.3**2))
    _, x = orbit.sample()
    assert x[0, -1] - x[0, 0] == pytest.approx(2 * math.pi, rel=1e-10)
    assert sorted(orbit.multipliers.full.real) == pytest.approx([math.exp(-0.8 * orbit.period), 1.0], abs=1e-8)
    assert orbit.extrema("w").high.value == pytest.approx(1.8, rel=1e-9)


def test_a_cycle_of_two_turns():
    """x = cos t, with a force of twice its frequency; the damping vanishes on it."""

    def field(x, p):
        damping = p.damping * (x.x**2 + x.v**2 - 1)
        force = p.b / 2 * (1 + ca.cos(2 * x.t))
        return {"x": x.v, "v": force - x.x - p.b * x.x**2 - damping * x.v}

    values = {"b": 0.2, "damping": 0.3}
    system = System("subharmonic", ("x", "v"), values, (Mode("smooth", field),), forcing_period=lambda p: math.pi)
    orbit = find_cycle(system, x=0.95, v=0.05, settled=True, tol=1e-10)
    assert_period(orbit, 2 * math.pi)
    assert len(orbit.arcs) == 2 and orbit.repeats == 1
    t, x = orbit.sample()
    time = 2 * math.pi * x[2] / 2  # turns
    np.testing.assert_allclose(x[0], np.cos(time), atol=1e-8)
    assert orbit.extrema("x").high.value == pytest.approx(1.0, abs=1e-10)


def test_a_forced_linear_oscillator():
    """One turn; both multipliers of modulus exp(-d T / 2)."""
    field = lambda x, p: {"x": x.v, "v": ca.cos(p.omega * x.t) - p.d * x.v - x.x}  # noqa: E731
    turn = lambda p: 2 * math.pi / p.omega  # noqa: E731
    system = System("resonator", ("x", "v"), {"omega": 1.5, "d": 0.2}, (Mode("free", field),), forcing_period=turn)
    orbit = find_cycle(system, x=0.0, v=0.0, t=0.3, tol=1e-10)
    period = 2 * math.pi / 1.5
    assert orbit.period == pytest.approx(period, rel=1e-13)
    assert orbit.repeats == 2  # x -> -x, half a turn later
    _, states = orbit.sample(4)  # the other half by the closure: S^-1 (x + c), the time half a turn on
    half = states.shape[1] // 2
    np.testing.assert_allclose(states[:2, half:], -states[:2, : half + 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(states[2, half:] - states[2, : half + 1], 0.5, rtol=1e-9)
    amplitude = 1 / math.hypot(1 - 1.5**2, 0.2 * 1.5)
    extrema = orbit.extrema("x")
    assert extrema.high.value == pytest.approx(amplitude, rel=1e-9) == -extrema.low.value
    others = sorted(orbit.multipliers.full, key=lambda m: abs(m - 1))[1:]
    assert [abs(m) for m in others] == pytest.approx([math.exp(-0.2 * period / 2)] * 2, rel=1e-8)


def test_a_ball_on_a_shaking_table():
    """One bounce a turn, in closed form, with its multipliers: mu^2 - trace mu + r^2 = 0."""
    g, r, a, w = 9.81, 0.8, 0.012, 20.0
    impact = Event(
        "impact", lambda x, p: (x.x - p.a * ca.sin(p.w * x.t)) / p.a, -1, to="flight",
        reset=lambda x, p: {"v": -p.r * x.v + (1 + p.r) * p.a * p.w * ca.cos(p.w * x.t)},
    )  # fmt: skip
    flight = Mode(
        "flight", flow=lambda x, t, p: {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t},
        holds=lambda x, p: (x.x - p.a * ca.sin(p.w * x.t)) / p.a, ends=(impact,),
    )  # fmt: skip
    ball = System(
        "ball", ("x", "v"), {"a": a, "g": g, "r": r, "w": w}, (flight,), forcing_period=lambda p: 2 * math.pi / p.w
    )
    orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True, tol=1e-11)
    period = 2 * math.pi / w
    assert orbit.period == pytest.approx(period, rel=1e-12) and orbit.signature == (("flight", "impact"),)
    lift = g * period * (1 - r) / (2 * (1 + r))  # of the table at the impact
    phase = math.acos(lift / (a * w))
    x, v, turns = orbit.arcs[0].states[0, 0]
    assert v == pytest.approx(g * period / 2, rel=1e-10)
    assert x == pytest.approx(a * math.sin(phase), rel=1e-9)
    assert 2 * math.pi * (turns % 1) == pytest.approx(phase, rel=1e-9)
    k = period / (lift + g * period / 2)
    trace = 1 - r + r * g * k - (1 + r) * a * w**2 * math.sin(phase) * k
    expected = np.roots([1.0, -trace, r**2])
    others = sorted(orbit.multipliers.full, key=lambda m: abs(m - 1))[1:]
    np.testing.assert_allclose(np.sort_complex(np.array(others)), np.sort_complex(expected.astype(complex)), atol=1e-8)
    assert orbit.stable


@pytest.mark.parametrize(
    "event, k, c, w", [(True, 0.26, 0.04, 1.0), (False, 0.48783, 0.020765, 2.790278), (False, 1.45, 0.013, 2.899)]
)
def test_a_cycle_is_gone_round_once(event, k, c, w):
    """A linear oscillator may come back nearer after a few turns of its forcing than after one.

    Its response has the period of the forcing, and x = 0.4/k + cos(...)/|k - w^2 + i c w|.
    """
    ends = (Event("rises", lambda x, p: x.x, +1, to="swings"),) if event else ()
    field = Mode("swings", lambda x, p: {"x": x.v, "v": ca.cos(p.w * x.t) + 0.4 - p.c * x.v - p.k * x.x}, ends=ends)
    p = {"k": k, "c": c, "w": w}
    swing = System("swing", ("x", "v"), p, (field,), forcing_period=lambda p: 2 * math.pi / p.w)
    orbit = find_cycle(swing, x=0.9, v=0.3, tol=1e-9)
    assert orbit.period == pytest.approx(2 * math.pi / w, rel=1e-12)
    assert orbit.amplitude == pytest.approx(0.4 / k + 1 / abs(k - w**2 + 1j * c * w), rel=1e-9)


def test_no_event_is_passed_inside_a_phase():
    """On the way to its cycle this linear oscillator misses the level for two turns of three; on it, never."""
    p = {"k": 23.819984275394834, "c": 0.018227141023081986, "w": 0.9812828033747683, "b": 0.6022276659804615}
    mode = Mode(
        "swings", lambda x, p: {"x": x.v, "v": ca.cos(p.w * x.t) + p.b - p.c * x.v - p.k * x.x},
        ends=(Event("rises", lambda x, p: x.x + 0.012589834921212361, +1, to="swings"),),
    )  # fmt: skip
    swing = System("swing", ("x", "v"), p, (mode,), forcing_period=lambda p: 2 * math.pi / p.w)
    orbit = find_cycle(swing, x=0.9, v=0.3, tol=1e-8)
    assert orbit.period == pytest.approx(2 * math.pi / p["w"], rel=1e-12) and len(orbit.arcs) == 1
    high = p["b"] / p["k"] + 1 / abs(p["k"] - p["w"] ** 2 + 1j * p["c"] * p["w"])
    assert orbit.extrema("x").high.value == pytest.approx(high, rel=1e-8)


def through_zero(to):
    """x'' = cos t - x'/2 - x/5, with an event where x rises through zero."""
    mode = Mode(
        "swings", lambda x, p: {"x": x.v, "v": ca.cos(x.t) - x.v / 2 - x.x / 5},
        ends=(Event("rises", lambda x, p: x.x, +1, to=to),),
    )  # fmt: skip
    return System("swing", ("x", "v"), {}, (mode,), forcing_period=lambda p: 2 * math.pi)


def test_an_event_that_leads_on_may_be_passed_inside_a_phase():
    """A function that returns the mode's own name says that it was only grazed."""
    orbit = find_cycle(through_zero(lambda x, p: "swings"), x=0.9, v=0.3, tol=1e-8)
    assert orbit.period == pytest.approx(2 * math.pi, rel=1e-12)
    assert orbit.extrema("x").high.value == pytest.approx(1 / abs(0.2 - 1 + 0.5j), rel=1e-8)
    assert all(arc.event != "rises" for arc in orbit.arcs)


@pytest.mark.parametrize("top, unclear", [(-0.9, False), (-0.4, True), (-0.05, True)])
def test_where_an_event_may_have_been_passed_the_intervals_are_unclear(top, unclear):
    """A polynomial that peaks between its points, above zero or below by less than it resolves, or clear of it."""
    t, u, setting = unknowns_of(find_cycle(through_zero("swings"), x=0.9, v=0.3, tol=1e-6))
    u = u.copy()
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    w[:, :, 0] = -1.0 / setting.scale[0]
    middle = t.degree // 2
    w[0, middle : middle + 2, 0] = top / setting.scale[0]
    verdict = check_admissible(t, u, setting)
    assert not verdict.violated and verdict.unclear[0] == unclear and not verdict.unclear[1:].any()


def test_a_state_given_twice_is_refused():
    with pytest.raises(InputError, match="^x: given both in start= and as a keyword"):
        find_cycle(stuart_landau(), start={"x": 1.0, "y": 0.0}, x=2.0)
    with pytest.raises(InputError, match="^x: given both"):
        simulate(stuart_landau(), start={"x": 1.0, "y": 0.0}, x=1.0, duration=1.0)


def test_what_a_mesh_may_miss_is_named():
    """A motion that leaves its mode without meeting an exit: one is missing, or a mesh has stepped over something."""

    def swing(**named):
        return Mode("swing", lambda x, p: {"x": x.v, "v": -x.x}, holds=lambda x, p: 0.5 - x.x, **named)

    with pytest.raises(NoOrbit, match="named as the `feature` of the mode"):
        find_cycle(System("swing", ("x", "v"), {}, (swing(),)), x=0.0, v=1.0)
    with pytest.raises(NoOrbit, match="does not hold any more") as refusal:
        find_cycle(System("swing", ("x", "v"), {}, (swing(feature=lambda x, p: x.v),)), x=0.0, v=1.0)
    assert "feature" not in str(refusal.value)


@pytest.mark.parametrize("k", [0.5, 0.9, 0.95])
def test_a_condition_may_have_a_kink(k):
    """Between -1 and 1 with y' = s - a y, T = 2/a log((1 + a)/(1 - a)); the condition has its kink at y = k."""
    a = 0.3

    def least(x, p):
        return ca.fmin((1 - x.y) / (1 - k), (1 + x.y) / (1 + k))

    def moves(name, sign, to):
        end = Event(name, lambda x, p: x.y - sign, int(sign), to=to)
        return Mode(f"{sign:+}", lambda x, p: {"y": sign - p.a * x.y}, holds=least, ends=(end,))

    system = System("saw", ("y",), {"a": a}, (moves("top", 1.0, "-1.0"), moves("bottom", -1.0, "+1.0")))
    assert_period(find_cycle(system, "+1.0", y=-0.9, tol=1e-9), 2 / a * math.log((1 + a) / (1 - a)))
