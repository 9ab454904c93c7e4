"""Multipliers against exact ones: what is trusted is right, and what cannot be known is bounded.

The truth is Liouville's formula, a closed form, the derivative of an event map worked out by hand, or decimal
arithmetic with 64 digits.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from casahunt.collocation.mesh import on_halved_mesh
from casahunt.collocation.newton import newton
from casahunt.collocation.scheme import scheme
from casahunt.continuation.walk import walk
from casahunt.hybrid.language import Event, Mode, System
from casahunt.orbits import Options, Orbit, find_cycle, floquet, graded, map_chain, multiplier_mesh
from casahunt.orbits.graded import _eigenvalues, _resolved, spectrum
from casahunt.orbits.multiplier_mesh import refined_multipliers
from casahunt.orbits.orbit import unknowns_of

VAN_DER_POL = System(
    "van der Pol",
    ("x", "v"),
    {"mu": 1.0},
    (Mode("swing", field=lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}),),
)


def divergence(orbit: Orbit, rate) -> float:
    """The integral of rate(states (n, m)) over the period, by Gauss's rule on the pieces between sampled points."""
    s = scheme(orbit.degree, orbit.kind)
    at, weights = np.polynomial.legendre.leggauss(20)
    matrix = s.interpolation((at + 1) / 2)
    total = 0.0
    for arc in orbit.arcs:
        states = np.einsum("kj,ijn->nik", matrix, arc.states)
        total += float(np.diff(arc.breaks) @ (rate(states) @ weights)) * arc.duration / 2
    return total * orbit.repeats


@pytest.mark.parametrize(("mu", "size"), [(0.5, -1.40), (2.0, -7.89), (5.0, -37.11), (10.0, -135.43)])
def test_van_der_pol(mu, size):
    """Liouville: the product of the multipliers is the exponential of the integral of the divergence."""
    orbit = find_cycle(VAN_DER_POL, x=2.0, v=0.0, tol=1e-9, parameters={"mu": mu})
    exact = divergence(orbit, lambda x: mu * (1 - x[0] ** 2)) / math.log(10)
    assert exact == pytest.approx(size, abs=0.01)
    m = orbit.multipliers
    assert m.trusted and orbit.stable
    if m.full_floor[1]:  # the mesh hides it: no number, and no bound that is wrong
        assert mu >= 5 and exact < math.log10(m.full_floor[1]) < -30
    else:
        assert math.log10(abs(m.full[1])) == pytest.approx(exact, abs=1e-7)


def test_mesh_fine_enough_for_a_tiny_multiplier():
    """The factors carry 1e-38 as well as 1: on a mesh fine enough there is a number, and it is right."""
    orbit = find_cycle(VAN_DER_POL, x=2.0, v=0.0, tol=1e-9, parameters={"mu": 5.0})
    exact = divergence(orbit, lambda x: 5 * (1 - x[0] ** 2)) / orbit.repeats
    places = [unknowns_of(orbit)]
    for _ in range(3):
        places.append(on_halves(*places[-1]))
    coarse, fine = (floquet.multipliers(*place) for place in places[2:])
    found = floquet.compared(fine, coarse.half[1:])
    assert found.leading_floor == 0 and found.trusted
    assert found.leading.real == pytest.approx(math.exp(exact), rel=1e-6)


def on_halves(t, u, setting):
    """The orbit solved with every interval cut in two."""
    t, u, fractions = on_halved_mesh(t, u, setting.fractions)
    setting = replace(setting, fractions=fractions)
    return t, newton(t, u, setting).u, setting


@pytest.mark.parametrize("rate", [2.0, 5.0])
def test_large_multiplier(rate):
    """r' = rate r (r^2 - 1), phi' = 1: a deviation of r grows by exp(2 rate t), in half a turn by exp(2 pi rate)."""
    system = System(
        "repelling circle",
        ("x", "y"),
        {"rate": rate},
        (Mode("turn", field=lambda x, p: {
            "x": p.rate * x.x * (x.x**2 + x.y**2 - 1) - x.y, "y": p.rate * x.y * (x.x**2 + x.y**2 - 1) + x.x,
        }),),
    )  # fmt: skip
    attracted = find_cycle(system, x=1.0, y=0.0, parameters={"rate": -rate})  # to the same circle
    t, u, setting = unknowns_of(attracted)
    m, _ = refined_multipliers(t, u, replace(setting, p=np.array([rate])))
    turn = 2 * math.pi / m.repeats
    assert m.leading.real == pytest.approx(math.exp(2 * rate * turn), rel=10 * m.error + 1e-12)
    assert m.trusted and m.error < 1e-6 and not m.stable
    assert m.trivial_error < 1e-8  # 27 decades below the other one


# The servo whose friction depends on the direction ------------------------------------------------------------------

J, CM, COULOMB, STRIBECK, VISCOUS, TAU = 0.026, 16.0, 0.44, 0.02, 0.1, 1 / (2 * math.pi)


def torque(x, p):
    """Lead-lag-plus-integral control."""
    return -p.gain * CM * (2 * x.x1 + TAU * x.x2 + x.x3 / TAU)


def slip(sign, x, p):
    static = p.up if sign > 0 else p.down
    friction = sign * (COULOMB + (static - COULOMB) * ca.exp(-((x.x2 / STRIBECK) ** 2))) + VISCOUS * x.x2
    return {"x1": x.x2, "x2": (torque(x, p) - friction) / J, "x3": x.x1}


def after(x, p):
    m = float(torque(x, p))
    return "slip+" if m > p.up else "slip-" if m < -p.down else "stick"


LOPSIDED = System(
    "servo of two directions",
    ("x1", "x2", "x3"),
    {"gain": 0.1, "up": 0.53, "down": 0.528},
    (
        Mode("slip+", field=lambda x, p: slip(1, x, p), holds=lambda x, p: x.x2 / STRIBECK,
             ends=(Event("stop+", lambda x, p: x.x2 / STRIBECK, -1, to=after),)),
        Mode("slip-", field=lambda x, p: slip(-1, x, p), holds=lambda x, p: -x.x2 / STRIBECK,
             ends=(Event("stop-", lambda x, p: x.x2 / STRIBECK, +1, to=after),)),
        Mode("stick", flow=lambda x, t, p: {"x1": x.x1, "x2": x.x2, "x3": x.x3 + t * x.x1},
             holds=lambda x, p: 1 - ca.fmax(torque(x, p) / p.up, -torque(x, p) / p.down),
             ends=(Event("breaks+", lambda x, p: torque(x, p) / p.up - 1, +1, to="slip+"),
                   Event("breaks-", lambda x, p: torque(x, p) / p.down + 1, -1, to="slip-"))),
    ),
)  # fmt: skip

DOWN, TRUTH = 0.457352320, -2.161976680577380532e29
"""Static friction backwards, and the product of the slopes P+' P-' of the event maps (scripts/peers/switch_digits.py,
64 digits): the slip forwards creeps along an unstable balance for a second."""


@cache
def lopsided() -> Orbit:
    """The cycle at DOWN."""
    start = find_cycle(LOPSIDED, "stick", x1=0.05, x2=0.0, x3=0.0, follow="down", tol=1e-6)
    *_, orbit = walk(start, low=DOWN, high=0.53, sense=-1, options=Options(tol=1e-6))
    return orbit


def test_a_servo_of_two_directions():
    m = lopsided().multipliers
    assert m.trusted and m.leading.real == pytest.approx(TRUTH, rel=min(m.error, 1e-7))
    assert m.trivial_error < 1e-8
    # After a stick one number is left: the third multiplier is zero.
    assert abs(m.full[2]) <= m.full_floor[2] < 1e-20


def test_one_mesh_is_wrong_and_not_trusted():
    """The orbit's own mesh resolves period and amplitude, and no more."""
    place = unknowns_of(lopsided())
    own = floquet.multipliers(*place)
    assert abs(own.leading / TRUTH - 1) > 0.9 and not own.trusted
    finer = floquet.multipliers(*on_halves(*place))
    assert not floquet.compared(finer, own.half[1:]).trusted


@pytest.mark.parametrize("more", [0, 1, 2])
def test_right_or_not_trusted(monkeypatch, more):
    """Whatever mesh it has to end on."""
    monkeypatch.setattr(multiplier_mesh, "MORE_MESHES", more)
    m, _ = refined_multipliers(*unknowns_of(lopsided()))
    off = abs(m.leading / TRUTH - 1)
    assert off < 10 * m.error and (off < 1e-5 or not m.trusted)
    assert more or not m.trusted


@pytest.mark.parametrize(
    ("now", "before", "same"),
    [
        ([2.0, 1e-3], [2.0, 1e-3], True), ([2.0, 1e-3], [2.0, 1.001e-3], False), ([2.0, 1e-3], [2.1, 1e-3], False),
        ([2.0, 1e-320], [2.0, 1e-3], True),  # what is zero for every purpose may be any zero
    ],
)  # fmt: skip
def test_rounds_go_on_until_the_moduli_stay(now, before, same):
    assert graded._same(now, before) is same


# The bouncing ball ---------------------------------------------------------------------------------------------------

R, G, A = 0.8, 1.0, 0.02


def table(x, p):
    return p.lift * ca.sin(2 * math.pi * x.t)


def speed(x, p):
    return 2 * math.pi * p.lift * ca.cos(2 * math.pi * x.t)


BALL = System(
    "ball on a shaken table",
    ("y", "v"),
    {"r": R, "lift": A},
    (
        Mode("flight", field=lambda x, p: {"y": x.v, "v": -G}, holds=lambda x, p: 10 * (x.y - table(x, p)) + 1, ends=(
            Event("impact", lambda x, p: 10 * (x.y - table(x, p)), -1, to="flight",
                  reset=lambda x, p: {"v": (1 + p.r) * speed(x, p) - p.r * x.v}),
        )),
    ),
    forcing_period=lambda p: 1.0,
)  # fmt: skip


def test_bouncing_ball():
    """One impact a period: lands with -g/2, leaves with g/2.  The multipliers are those of the map of an impact to the
    next one, (t, v) -> (t', v'), whose determinant is r^2."""
    phase = math.acos(0.5 * G * (1 - R) / (1 + R) / (2 * math.pi * A)) / (2 * math.pi)
    w, rate = 2 * math.pi * A * math.cos(2 * math.pi * phase), -A * (2 * math.pi) ** 2 * math.sin(2 * math.pi * phase)
    lands, leaves = -0.5 * G, 0.5 * G
    later = np.array([1.0, 1 / (w - lands)])  # dt' by (dt, dv); (w - u) dt' = (w - u) dt + T dv
    lower = np.array([0.0, 1.0]) - G * (later - np.array([1.0, 0.0]))  # du
    exact = np.linalg.eigvals(np.array([later, (1 + R) * rate * later - R * lower]))
    assert np.prod(exact) == pytest.approx(R**2)
    orbit = find_cycle(BALL, y=A * math.sin(2 * math.pi * phase), v=leaves, t=phase, settled=True)
    m = orbit.multipliers
    found = sorted(m.full[1:], key=lambda z: z.imag)
    assert orbit.period == pytest.approx(1, abs=1e-12)
    assert found == pytest.approx(sorted(exact, key=lambda z: z.imag), rel=1e-9)
    assert np.prod(m.full[1:]) == pytest.approx(R**2, rel=1e-10) and m.trusted


def test_saltation_of_a_jump():
    """A ball that falls on a floor: the closed-form map over a fixed time, differentiated by differences."""

    def moved(x, duration):
        y, v = x
        t = (v + math.sqrt(v**2 + 2 * G * y)) / G
        back = R * (G * t - v)
        return np.array([back * (duration - t) - G * (duration - t) ** 2 / 2, back - G * (duration - t)])

    start, duration, h = np.array([0.7, -0.3]), 1.3, 1e-6
    t = (start[1] + math.sqrt(start[1] ** 2 + 2 * G * start[0])) / G
    lands = start[1] - G * t
    jump = map_chain.saltation(
        np.array([lands, -G]), np.array([-R * lands, -G]), np.array([1.0, 0.0]), np.diag([1.0, -R])
    )  # fmt: skip
    exact = np.array([[1, duration - t], [0, 1]]) @ jump @ np.array([[1, t], [0, 1]])
    differences = [(moved(start + h * e, duration) - moved(start - h * e, duration)) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(exact, np.transpose(differences), rtol=1e-8, atol=1e-9)


def test_a_motion_that_stands_still_has_no_multipliers():
    """At an event next to an equilibrium the field is zero for rounding: no direction, no number, no trust."""
    f, gradient = np.array([0.0, 1e-20]), np.array([1.0, 0.0])
    assert not np.isfinite(map_chain.saltation(f, np.array([1.0, 0.0]), gradient)).all()
    still = map_chain.MapChain([np.diag([0.5, 0.1]), np.eye(2)], [gradient, np.zeros(2), gradient], [1e-16])
    crossed = map_chain.MapChain([np.diag([np.inf, 0.1]), np.eye(2)], [gradient] * 3, [1e-16])
    for chain in (still, crossed):
        found = floquet.chain_multipliers(chain, 1)
        assert not found.trusted and np.isnan(found.half).all() and found.error == math.inf


# Products ------------------------------------------------------------------------------------------------------------


def test_what_rounding_hides_is_bounded():
    """A factor of rank 1 in the middle of 1e12 and 1e-12: the second eigenvalue is 0, and comes out as anything."""
    rng = np.random.default_rng(3)
    turns = [np.linalg.qr(rng.standard_normal((2, 2)))[0] for _ in range(8)]
    factors = [b @ np.diag([30.0, 1 / 30]) @ a.T for a, b in zip(turns, turns[1:], strict=False)]
    factors.insert(4, np.outer([1.0, 0.3], [0.2, 1.0]))
    noise = np.array([1e-15 * np.abs(factor).max() for factor in factors])
    found = spectrum(factors, noise)
    assert 0 < found.floor[1] < 1e-12 * abs(found.values[0]) and abs(found.values[1]) <= found.floor[1]
    assert found.floor[0] == 0 and found.uncertainty < 1e-10


@pytest.mark.parametrize("slant", [1e-2, 1e-6])
def test_uncertainty_is_that_of_the_factors(slant):
    """Noise of that size put on every factor moves the largest eigenvalue by no more, and by no hundredth of it."""
    rng = np.random.default_rng(5)
    factors = [rng.standard_normal((3, 3)) for _ in range(12)]
    factors[5] = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, slant]]) @ factors[5]
    noise = np.full(12, 1e-9)
    found = spectrum(factors, noise)
    moved = []
    for _ in range(20):
        shaken = [factor + 1e-9 * (e := rng.standard_normal((3, 3))) / np.linalg.norm(e, 2) for factor in factors]
        moved.append(abs(spectrum(shaken).values[0] / found.values[0] - 1))
    assert found.uncertainty / 100 < max(moved) < found.uncertainty


@pytest.mark.parametrize("large", [1.0, 1e6, 1e10, 1e29])
def test_one_round_where_rounding_leaves_what_is_wanted(large):
    """From a frame that is right by a thousandth, 1 is lost below 1e10 in one round, and not below 1e6."""
    rng = np.random.default_rng(7)
    turns = [np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(24)]
    turns.append(turns[0])
    sizes = np.array([large, 1.0, 1e-9]) ** (1 / 24)
    factors = [b @ np.diag(sizes) @ a.T for a, b in zip(turns, turns[1:], strict=False)]
    frame = np.linalg.qr(turns[0] + 1e-3 * rng.standard_normal((3, 3)))[0]
    found = np.sort(np.abs(spectrum(factors, frame=frame, wanted=0.5).values))[::-1]
    assert found[:2] == pytest.approx([max(large, 1.0), 1.0], rel=1e-11)


@pytest.mark.parametrize("seed", range(4))
def test_one_that_rounding_has_made_small_is_not_resolved(seed):
    """Beside 1e29 the solver sees 0 for 1, in some frames that rounding has turned by a little."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(np.eye(3) + 1e-15 * rng.standard_normal((3, 3)))[0]
    triangular = np.triu(rng.standard_normal((3, 3))) * np.array([[1e29], [1.0], [0.0]])
    assert not _resolved(turn, triangular, 0.5)[1]


@pytest.mark.parametrize("count", [40, 400])
def test_growth_that_no_number_holds(count):
    """1e10 in every factor: a few of them at once, and what the product has grown by kept as a power of two."""
    rng = np.random.default_rng(9)
    turns = [np.linalg.qr(rng.standard_normal((2, 2)))[0] for _ in range(count)]
    turns.append(turns[0])
    factors = [b @ np.diag([1e10, 1e-10]) @ a.T for a, b in zip(turns, turns[1:], strict=False)]
    found = spectrum(factors, np.full(count, 1e-20))
    assert abs(found.values[0]) == pytest.approx(1e150, rel=1e-9) and np.isfinite(found.uncertainty)


@pytest.mark.parametrize(
    "matrix",
    [
        [[2.0, 1e-9], [1e-9, 2.0]], [[1.0, 0.0], [0.0, -1.0]], [[0.5, -2.0], [2.0, 0.5]], [[3.0, 1e8], [0.0, 1e-8]],
        [[0.0, 0.0], [0.0, 0.0]], [[1e-150, 0.0], [0.0, 1e150]],
    ],
)  # fmt: skip
def test_eigenvalues_of_two(matrix):
    turn, triangular = np.linalg.qr(np.array(matrix))
    found = _eigenvalues(turn, triangular)
    expected = np.linalg.eigvals(np.array(matrix)).astype(complex)
    for value in expected:
        assert np.min(np.abs(found - value)) <= 1e-13 * abs(value)


def test_two_that_merge_near_zero():
    """A product of rank 1 with eigenvalues 1e-13 and 0: noise of 1e-15 moves them by its root, not by 1e-15 / 1e-13."""
    found = spectrum([np.array([[1e-13, 1.0], [0.0, 0.0]])], np.array([1e-15]))
    moved = np.abs(np.linalg.eigvals(np.array([[1e-13, 1.0], [1e-15, 0.0]]))).max()
    assert moved / 3 < found.uncertainty * 1e-13 < 3 * moved


@pytest.mark.parametrize(("slope", "known"), [(1.0, True), (1e-9, False)])
def test_an_event_hardly_crossed(slope, known):
    """States are known to 1e-12: where the motion crosses the event at a slope of 1e-9, the map behind it is not."""
    before, behind = np.array([1.0, slope, 0.0]), np.array([1.0, 1.0, 0.5])
    shrinks = np.diag([1.0, 1.0, 0.5])  # else a double multiplier, whose uncertainty is a root
    pieces = [([shrinks], np.array([before, before])), ([np.eye(3)], np.array([behind, behind]))]
    borders = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    m = floquet.chain_multipliers(map_chain._closed(pieces, [None, None], borders, np.eye(3)), 1)
    assert (m.rounding < 1e-9) is known and (m.rounding < floquet.TRUSTED) is known


def test_an_orbit_that_is_an_equilibrium_but_for_rounding_has_no_multipliers():
    """An orbit within rounding of an equilibrium: at a node, and on the event at which a mode begins."""
    moving, still = np.array([1.0, 0.5]), np.zeros(2)
    pieces = [([np.eye(2)], np.array([moving, still])), ([np.eye(2)], np.array([moving, moving]))]
    chain = map_chain._closed(pieces, [None, None], np.array([[0.0, 1.0], [1.0, 0.0]]), np.eye(2))
    m = floquet.chain_multipliers(chain, 2)
    assert np.isnan(m.half).all() and math.isinf(m.error) and not m.trusted
    coarse, _ = floquet.rough_multipliers(chain)
    assert np.isnan(coarse).all()
    moves = map_chain.MapChain(np.array([np.eye(2)]), np.array([moving, moving]), np.zeros(1))
    assert not floquet.compared(floquet.chain_multipliers(moves, 1), coarse).trusted


@pytest.mark.parametrize("at", [0.5, 2 * multiplier_mesh.LARGE_MULTIPLIER])
def test_whether_two_meshes_show_the_same_multiplier(at):
    """The nearest of the coarser one counts; a large one is known relative to its size."""
    near = floquet.TRUSTED * at if at >= multiplier_mesh.LARGE_MULTIPLIER else multiplier_mesh.AS_TRUSTED
    found = SimpleNamespace(leading=at)
    for off, settled in ((0.3, True), (3.0, False)):
        assert multiplier_mesh._settled(found, np.array([at / 9, at + off * near])) == settled
    assert multiplier_mesh._settled(found, np.zeros(0))  # there is none that could differ


def test_eigenvectors_that_are_all_but_one_resolve_nothing(monkeypatch):
    """Whether they can be told apart, or overflow, is rounding."""
    monkeypatch.setattr(graded.np.linalg, "inv", lambda matrix: np.full(matrix.shape, np.inf))
    assert not _resolved(np.eye(2), np.diag([2.0, 1.0]), 1.0)[1]


def test_multipliers_of_a_field_that_all_but_jumps_inside_an_interval():
    """x'' = cos 0.6 t - x - 0.2 erf(s x'): to 1e-4 those of the sign, by maps between its zeros, -0.20143 +- 0.42735i.

    The time is a state: its trivial multiplier is 1 on any mesh.  Where no mesh shows the jump the error says so.
    """

    def dry(steep):
        field = lambda x, p: {"x": x.v, "v": -x.x - 0.2 * ca.erf(steep * x.v) + ca.cos(0.6 * x.t)}  # noqa: E731
        return System("dry", ("x", "v"), {}, (Mode("smooth", field),), forcing_period=lambda p: 2 * math.pi / 0.6)

    cycle = find_cycle(dry(1e4), x=0.5, v=1.0, t=0.0, tol=1e-8)
    start = dict(zip(("x", "v", "t"), cycle.sample()[1][:, 0].tolist(), strict=True))
    assert cycle.multipliers.trusted
    for found in (cycle, *(find_cycle(dry(10.0**k), start=start, settled=True, tol=1e-8) for k in (9, 10, 12))):
        assert min(abs(found.multipliers.full - (-0.20143 + 0.42735j))) < max(1e-4, found.multipliers.error)
