"""Cycles of users' systems: found where the truth is known, refused where the motion rests, no false symmetries."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from casahunt import effort
from casahunt.collocation.admissibility import judge
from casahunt.errors import InputError, NoOrbit, Status
from casahunt.hybrid import Event, Mode, System
from casahunt.motion import simulate
from casahunt.motion.segment import Segment
from casahunt.orbits import Options, find_cycle
from casahunt.orbits.closure import Closure
from casahunt.orbits.orbit import Orbit, unknowns_of
from casahunt.orbits.recurrence import Recurrence, comes_in, loop_distance
from casahunt.orbits.returning import REPEATED, Returning
from casahunt.orbits.watching import cut, watched
from problems import rossler

START = {"x": 2.0, "v": 0.0}
VAN_DER_POL = {
    0.0: (6.6632868593231301897, 2.00861986087484313651),
    1e-3: (6.663288410191840899744, 2.009205683333108884127),
}
"""Constant force: period and x where v = 0, mu = 1; Taylor series of order 30 in 30 digits."""


def van_der_pol(**changed: float) -> System:
    smooth = Mode("smooth", lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x + p.force})
    return System("van der Pol", ("x", "v"), {"mu": 1.0, "force": 0.0} | changed, (smooth,))


def assert_period(orbit: Orbit, truth: float) -> None:
    """The error estimate holds, and is what was asked for."""
    assert abs(orbit.period / truth - 1) <= 3 * orbit.period_error + 1e-14
    assert orbit.status.ok


@pytest.mark.parametrize("more", [-1e-3, 0.0, 1e-3])
def test_where_a_motion_is_cut_does_not_hang_on_rounding(more):
    """All states of a symmetric motion go from minus their size to plus their size: none is the largest."""
    system = van_der_pol()
    p = np.array(list(system.parameters.values()))
    seen = watched(system, "smooth", np.array([2.0, 0.0]), p, "gauss")
    seen = seen._replace(late=seen.late * np.array([[1.0], [1.0 + more]]))
    ((section,), turning) = cut(system, seen, p)
    assert section.state == "x" and turning is None


# Smooth systems -------------------------------------------------------------------------------------------------------


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


def test_nearly_symmetric_is_not_symmetric():
    """A small constant force: half a cycle would be another problem."""
    orbit = find_cycle(van_der_pol(force=1e-3), tol=1e-11, **START)
    period, stands = VAN_DER_POL[1e-3]
    assert orbit.repeats == 1
    assert_period(orbit, period)
    extrema = orbit.extrema("x")
    assert extrema.high.value == pytest.approx(stands, rel=1e-10)
    assert extrema.high.value + extrema.low.value > 1e-3


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


def test_a_symmetry_of_ones_own():
    """x' = y and y' of van der Pol, z driven by x^2: only (x, y, z) -> (-x, -y, z) halves the cycle."""

    def field(x, p):
        return {"x": x.v, "v": (1 - x.x**2) * x.v - x.x, "z": x.x**2 - x.z}

    for symmetries, repeats in (((), 1), ((np.diag([-1.0, -1.0, 1.0]),), 2), ((np.diag([1.0, -1.0, 1.0]),), 1)):
        driven = System("driven", ("x", "v", "z"), {}, (Mode("smooth", field),), symmetries=symmetries)
        orbit = find_cycle(driven, x=2.0, v=0.0, z=0.0, tol=1e-10)
        assert orbit.repeats == repeats
        assert_period(orbit, VAN_DER_POL[0.0][0])


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


# Rest -----------------------------------------------------------------------------------------------------------------


def refused(system: System, sentence: str, **start: float) -> None:
    with pytest.raises(NoOrbit, match=sentence) as refusal:
        find_cycle(system, **start)
    assert refusal.value.status is Status.NOT_FOUND and "\n" not in str(refusal.value)


@pytest.mark.parametrize("start", [{"x": 1.0, "v": 0.0}, {"x": 0.0, "v": 0.0}])
def test_a_motion_that_comes_to_rest(start):
    damped = System("damped", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": -0.3 * x.v - x.x}),))
    refused(damped, "^no cycle of damped was met: the motion comes to rest", **start)


def test_a_block_that_sticks_for_ever():
    """It slips to where static friction holds it on a belt that stands."""
    slip = Mode("slip", lambda x, p: {"x": x.v, "v": 1 - x.x}, ends=(Event("stops", lambda x, p: x.v, -1, to="stick"),))
    stick = Mode("stick", flow=lambda x, t, p: {"x": x.x, "v": 0})
    refused(System("block", ("x", "v"), {}, (slip, stick)), "^no cycle of block was met: .* rest", x=0.0, v=0.1)


# Forced systems -------------------------------------------------------------------------------------------------------


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


def test_how_far_a_loop_is_from_the_one_before():
    """Half a turn later mirrored, a whole turn later not: what is left are the distances put in, by size."""
    free = Mode("free", lambda x, p: {"x": x.v, "v": ca.cos(x.t) - x.x})
    system = System("forced", ("x", "v"), {}, (free,), forcing_period=lambda p: 2 * math.pi)

    def ends(*states):
        return [Segment("free", "", 1.0, np.array([0.0, 1.0]), np.zeros((1, 3)), np.array(x)) for x in states]

    scale = np.array([2.0, 5.0, 1.0])
    for S, shift, repeats, states in (
        (np.diag([-1.0, -1.0, 1.0]), [0.0, 0.0, 0.5], 2, ([1.0, -3.0, 0.3], [-1.0, 3.0, 0.8])),
        (np.eye(3), [0.0, 0.0, 1.0], 1, ([1.0, -3.0, 0.3], [1.0, -3.0, 1.3])),
    ):
        r = Recurrence(1, Closure.of(S, np.array(shift), repeats), 0.0)
        assert loop_distance(system, ends(*states), r, scale) == pytest.approx(0.0, abs=1e-15)
        for entry, off, distance in ((0, 0.02, 0.01), (1, -0.2, 0.04), (2, 0.2, 0.2)):
            later = np.array(states[1])
            later[entry] += off
            assert loop_distance(system, ends(states[0], later), r, scale) == pytest.approx(distance)
            watched = SimpleNamespace(system=system, segments=ends(states[0], later), scale=scale)
            assert Returning.repeated(watched, r) is (distance < REPEATED)
        assert loop_distance(system, ends(states[0]), r, scale) == math.inf


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
    """A function that returns the mode's own name says that it was only touched."""
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
    verdict = judge(t, u, setting)
    assert not verdict.violated and verdict.unclear[0] == unclear and not verdict.unclear[1:].any()


def test_an_unstable_cycle_next_to_the_start():
    """Stuart-Landau backwards: the multiplier is the inverse."""

    def back(x, p):
        square = x.x**2 + x.y**2
        grows, turns = square - p.a, p.omega
        return {"x": grows * x.x - turns * x.y, "y": grows * x.y + turns * x.x}

    system = System("backwards", ("x", "y"), {"a": 0.01, "omega": 2.0}, (Mode("smooth", back),))
    orbit = find_cycle(system, x=0.1 * (1 + 1e-6), y=0.0, settled=True, tol=1e-10)
    assert_period(orbit, math.pi)
    assert not orbit.stable
    assert sorted(orbit.multipliers.full.real) == pytest.approx([1.0, math.exp(0.02 * math.pi)], rel=1e-8)


@pytest.mark.parametrize("rate", [0.003, 0.1, 1.0])
@pytest.mark.parametrize(("begins", "radius"), [(0.5, 1), (1.9, 1), (1.99, 1), (2.01, 3), (2.1, 3), (3.5, 3)])
def test_which_of_two_cycles_the_motion_goes_to(rate, begins, radius):
    """Circles of radius 1 and 3 attract, that of radius 2 parts them: a first return may be nearer to the wrong one."""

    def field(x, p):
        square = x.x**2 + x.y**2
        grows = -p.rate * (square - 1) * (square - 4) * (square - 9)
        return {"x": grows * x.x - x.y, "y": grows * x.y + x.x}

    rings = System("rings", ("x", "y"), {"rate": rate}, (Mode("smooth", field),))
    orbit = find_cycle(rings, x=begins, y=0.0, tol=1e-9)
    assert_period(orbit, 2 * math.pi)
    assert orbit.stable and orbit.extrema("x").high.value == pytest.approx(radius, rel=1e-8)


def test_a_slow_motion_is_not_where_newtons_method_goes():
    """Circles of radius 1 and 1.1 attract, weakly: from 1.075 Newton's method goes to the wrong one."""

    def field(x, p):
        square = x.x**2 + x.y**2
        grows = -0.02 * (square - 1) * (square - 1.05**2) * (square - 1.1**2)
        return {"x": grows * x.x - x.y, "y": grows * x.y + x.x}

    rings = System("rings", ("x", "y"), {}, (Mode("smooth", field),))
    orbit = find_cycle(rings, x=1.075, y=0.0, tol=1e-9)
    assert orbit.extrema("x").high.value == pytest.approx(1.1, rel=1e-8)


def test_events_that_are_met_at_first_alone():
    """The cycle of x'' = (1 - x^2) x' - x keeps clear of x = 4, from beyond which the motion comes."""
    field = lambda x, p: {"x": x.v, "v": (1 - x.x**2) * x.v - x.x}  # noqa: E731
    ends = tuple(Event(f"{way}", lambda x, p: x.x - 4, way, to="smooth") for way in (-1, +1))
    orbit = find_cycle(System("stop", ("x", "v"), {}, (Mode("smooth", field, ends=ends),)), x=5.0, v=0.0, tol=1e-9)
    assert_period(orbit, VAN_DER_POL[0.0][0])


@pytest.mark.parametrize(
    ("M", "before", "now", "expected"),
    [
        ([[0.5]], [1.0], [0.5], True),
        ([[0.5]], [1.0], [0.7], True),
        ([[0.5]], [1.0], [0.8], False),  # 0.3 beyond the linear map, which contracts by 0.5
        ([[-0.9]], [1.0], [-0.9], True),
        ([[-0.9]], [1.0], [-0.5], False),  # nearer, by what is not linear
        ([[0.0, 100.0], [0.0, 0.0]], [0.0, 1.0], [100.0, 0.0], True),  # it comes back in two returns
        ([[0.0, 100.0], [0.0, 0.0]], [0.0, 1.0], [0.0, 1.0], False),
    ],
)
def test_whether_a_return_shows_that_a_motion_comes_in(M, before, now, expected):
    assert comes_in(np.array(M), np.array(before), np.array(now)) is expected


def test_a_strongly_unstable_cycle_through_the_start():
    """Van der Pol's in reversed time: disturbances grow by 1163 in a turn; the period is the same."""
    reverse = System(
        "reversed van der Pol", ("x", "v"), {"mu": 1.0},
        (Mode("smooth", field=lambda x, p: {"x": -x.v, "v": x.x - p.mu * (1 - x.x**2) * x.v}),),
    )  # fmt: skip
    orbit = find_cycle(reverse, x=0.0, v=2.172713, settled=True)
    assert orbit.period == pytest.approx(6.66328685932313, rel=1e-10) and not orbit.stable
    ahead = Mode("smooth", field=lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x})
    forward = find_cycle(replace(reverse, modes=(ahead,)), x=2.0, v=0.0)
    assert abs(orbit.multipliers.leading) * abs(forward.multipliers.full[1]) == pytest.approx(1.0, rel=1e-7)
    with pytest.raises(NoOrbit, match="comes back no nearer"):
        find_cycle(reverse, x=0.0, v=1.0, settled=True)


# No cycle, and no long search -----------------------------------------------------------------------------------------


SECOND = 4e4
"""Work of a second (casahunt/effort.py); it is the same on every machine."""


def refusal_of(system: System, **asked) -> tuple[str, float]:
    """(the sentence, seconds of work that it has cost)."""
    with effort.watched(None) as watch, pytest.raises(NoOrbit) as refusal:
        find_cycle(system, **asked)
    assert refusal.value.status is Status.NOT_FOUND
    return str(refusal.value), watch.work / SECOND


@pytest.mark.slow
def test_chaos_is_given_up():
    """Rossler's at c = 5.7; before, 3072 phases and the equations of hundreds of phases at once."""
    said, seconds = refusal_of(rossler.SYSTEM, parameters={"c": 5.7}, x=1.0, y=1.0, z=1.0)
    assert "did not repeat within" in said and float(said.split("(followed for ")[1].split(")")[0]) < 5000
    assert seconds < 8


def test_centres_have_no_cycle_of_their_own():
    """One of many: the equations are singular, and going on shows nothing more."""
    spring = System("spring", ("x", "v"), {"k": 1.0}, (Mode("free", lambda x, p: {"x": x.v, "v": -p.k * x.x}),))
    said, seconds = refusal_of(spring, x=1.0, v=0.0)
    assert "the motion repeats after 1 phase, but its cycle was not computed" in said
    assert seconds < 3


def test_drifts_and_growth():
    """x + 1.5 t; exp(0.05 t)."""
    drift = System("drift", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": 1.5 - x.v}),))
    said, seconds = refusal_of(drift, x=1.0, v=0.0)
    assert "the motion does not come back to x" in said and seconds < 3
    grows = System("grows", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": 0.1 * x.v - x.x}),))
    said, seconds = refusal_of(grows, x=1.0, v=0.0)
    assert "the motion grows" in said and seconds < 3


@pytest.mark.slow
def test_a_torus_is_no_cycle():
    """Two oscillators whose frequencies have no common multiple: it nearly repeats, and never settles."""

    def field(x, p):
        r, s = 1 - x.x**2 - x.y**2, 1 - x.u**2 - x.w**2
        w = math.sqrt(2)
        return {"x": r * x.x - x.y, "y": r * x.y + x.x, "u": s * x.u - w * x.w, "w": s * x.w + w * x.u}

    torus = System("torus", ("x", "y", "u", "w"), {}, (Mode("smooth", field),))
    said, seconds = refusal_of(torus, x=1.0, y=0.1, u=0.5, w=0.0)
    assert said.startswith("no cycle of torus was met") and seconds < 8


def test_it_says_how_long_it_watched():
    damped = System("damped", ("x", "v"), {}, (Mode("free", lambda x, p: {"x": x.v, "v": -0.3 * x.v - x.x}),))
    said, _ = refusal_of(damped, x=1.0, v=0.0)
    assert "followed for" in said and "followed for 0)" not in said


# An angle alone -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("settled", [False, True])
@pytest.mark.parametrize(("w", "e"), [(1.0, 0.0), (1.5, 0.3), (-1.5, 0.3), (1.5, 1.49), (1e3, 1.0), (1e-3, 5e-4)])
def test_a_rotor_of_one_state(w, e, settled):
    """theta' = w + e sin theta: one turn in 2 pi / sqrt(w^2 - e^2), either way round."""
    turns = Mode("turns", lambda x, p: {"theta": p.w + p.e * ca.sin(x.theta)})
    rotor = System("rotor", ("theta",), {"w": w, "e": e}, (turns,), angles=("theta",))
    orbit = find_cycle(rotor, theta=0.3, settled=settled, tol=1e-10)
    assert_period(orbit, 2 * math.pi / math.sqrt(w**2 - e**2))
    _, x = orbit.sample()
    assert x[0, -1] - x[0, 0] == pytest.approx(math.copysign(2 * math.pi, w), rel=1e-12)


@pytest.mark.parametrize("w", [0.0, 1.5])
def test_a_rotor_whose_speed_settles(w):
    """w' = (1.5 - w) / 20: at last nothing moves but the angle; the multiplier is exp(-T / 20)."""
    turns = Mode("turns", lambda x, p: {"theta": x.w, "w": p.k * (1.5 - x.w)})
    rotor = System("rotor", ("theta", "w"), {"k": 0.05}, (turns,), angles=("theta",))
    orbit = find_cycle(rotor, theta=0.0, w=w, tol=1e-10)
    assert_period(orbit, 2 * math.pi / 1.5)
    assert sorted(orbit.multipliers.full.real) == pytest.approx([math.exp(-0.05 * orbit.period), 1.0], rel=1e-9)


def test_a_rotor_that_stops():
    turns = Mode("turns", lambda x, p: {"theta": 0.5 + ca.sin(x.theta)})
    refused(System("rotor", ("theta",), {}, (turns,), angles=("theta",)), "comes to rest", theta=0.3)


# What is asked --------------------------------------------------------------------------------------------------------


def test_a_state_given_twice_is_refused():
    with pytest.raises(InputError, match="^x: given both in start= and as a keyword"):
        find_cycle(stuart_landau(), start={"x": 1.0, "y": 0.0}, x=2.0)
    with pytest.raises(InputError, match="^x: given both"):
        simulate(stuart_landau(), start={"x": 1.0, "y": 0.0}, x=1.0, duration=1.0)


def test_conditions_that_are_not_mirrored_are_no_symmetry():
    """Van der Pol's cycle in two modes, of which one is a motion at x < 3 and the other at x > -2.5."""

    def field(x, p):
        return {"x": x.v, "v": (1 - x.x**2) * x.v - x.x}

    def halves(low):
        up = Mode("up", field, holds=lambda x, p: 3 - x.x, ends=(Event("top", lambda x, p: x.v, -1, to="down"),))
        down = Mode("down", field, holds=lambda x, p: x.x + low, ends=(Event("end", lambda x, p: x.v, +1, to="up"),))
        return System("two modes", ("x", "v"), {}, (up, down))

    for low, repeats in ((3.0, 2), (2.5, 1)):
        orbit = find_cycle(halves(low), "down", x=2.0, v=0.0, tol=1e-10)
        assert orbit.repeats == repeats
        assert_period(orbit, VAN_DER_POL[0.0][0])


def test_an_event_that_is_crossed_either_way_is_mirrored():
    """v = 0 of van der Pol, rising or falling: the one is the image of the other."""
    field = lambda x, p: {"x": x.v, "v": (1 - x.x**2) * x.v - x.x}  # noqa: E731
    for scalar, repeats in ((lambda x, p: x.v, 2), (lambda x, p: x.v + 0.1 * x.v**2, 1)):
        either = Mode("smooth", field, ends=(Event("turns", scalar, 0, to="smooth"),))
        orbit = find_cycle(System("either", ("x", "v"), {}, (either,)), x=2.0, v=0.0, tol=1e-10)
        assert orbit.repeats == repeats
        assert_period(orbit, VAN_DER_POL[0.0][0])


def test_what_a_mesh_may_miss_is_named():
    """A motion that leaves its mode without meeting an exit: one is missing, or a mesh has stepped over something."""

    def swing(**named):
        return Mode("swing", lambda x, p: {"x": x.v, "v": -x.x}, holds=lambda x, p: 0.5 - x.x, **named)

    with pytest.raises(NoOrbit, match="named as the `feature` of the mode"):
        find_cycle(System("swing", ("x", "v"), {}, (swing(),)), x=0.0, v=1.0)
    with pytest.raises(NoOrbit, match="does not hold any more") as refusal:
        find_cycle(System("swing", ("x", "v"), {}, (swing(feature=lambda x, p: x.v),)), x=0.0, v=1.0)
    assert "feature" not in str(refusal.value)
