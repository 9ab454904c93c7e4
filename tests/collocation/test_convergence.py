"""The transcription against exact solutions (order of convergence) and against itself written densely."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casahunt import Options, find_orbit
from casahunt.collocation.graphs import graphs, lagrangian_hessian
from casahunt.collocation.ipopt import _ipopt_solver, ipopt
from casahunt.collocation.newton import newton
from casahunt.collocation.transcription import Setting, Transcription, transcribe
from casahunt.errors import Status
from casahunt.hybrid import language
from casahunt.hybrid.system import Cycle, Phase, Signature, VectorEvent
from casahunt.orbits.floquet import multipliers
from casahunt.orbits.orbit import unknowns_of
from casahunt.servo.problem import Hunting, mirrored
from casahunt.servo.servo import PARAMETERS, Servo
from problems import stuart_landau as sl
from problems import table1

Array = np.ndarray

P_KEPLER = (0.25, 1.5, 0.8, 0.2)  # mu, omega, shear, e
ROUND_OFF = 1e-12
"""Errors below this are rounding: about 1000 unknowns, each update good to a few 1e-16."""


def circle_guess(cycle: Cycle, p: tuple[float, ...], intervals: int, degree: int, kind: str):
    """A deliberately wrong start on a uniform mesh: 10 % too large, 5 % too slow, run through evenly."""
    phases = len(cycle.phases)
    t = transcribe(cycle, (intervals // phases,) * phases, degree, kind)
    turn = 2 * np.pi / t.intervals
    angles = turn * (np.arange(t.intervals)[:, None] + t.scheme.points)
    w = 1.1 * np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(t.intervals, -1)
    nodes = np.vstack([w[:, :2], w[0, :2]])
    durations = np.full(phases, 1.05 * sl.period(*p) / phases)
    setting = Setting(
        np.full(t.intervals, phases / t.intervals), np.array(p), np.full(2, np.sqrt(p[0])), np.zeros(len(p))
    )
    return t, t.pack(w, nodes, durations), setting


def period_error(cycle, p, intervals, degree, kind, solver=newton) -> float:
    t, u, setting = circle_guess(cycle, p, intervals, degree, kind)
    solution = solver(t, u, setting)
    assert solution.status is Status.CONVERGED
    return abs(float(t.durations_of(solution.u).sum()) / sl.period(*p) - 1)


def fitted_order(intervals: list[int], errors: list[float]) -> float:
    """Slope of log error against log h over the points above round-off."""
    n, e = np.array(intervals), np.array(errors)
    use = e > ROUND_OFF
    assert use.sum() >= 3, f"too few points above round-off: {e}"
    return float(-np.polyfit(np.log(n[use]), np.log(e[use]), 1)[0])


MESHES = {2: [48, 64, 96, 128, 192], 3: [24, 32, 48, 64, 96], 4: [12, 14, 16, 20, 24], 5: [10, 12, 14, 16, 18]}
"""Numbers of intervals from where the error has become a power of h; round-off ends them."""
SLOPE = 0.3
"""The next term of the error bends the fitted slope: by 0.25 at degree 5, where round-off leaves 10 to 14
intervals to fit, by less than 0.05 at degrees 2 to 4."""


@pytest.mark.parametrize("solver", [newton, ipopt])
@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("kind", ["gauss", "radau"])
def test_order_of_the_period(kind, degree, solver):
    """Superconvergence at the nodes: h^(2d) for Gauss-Legendre, h^(2d-1) for Radau IIA."""
    errors = [period_error(sl.KEPLER, P_KEPLER, n, degree, kind, solver) for n in MESHES[degree]]
    expected = 2 * degree if kind == "gauss" else 2 * degree - 1
    order = fitted_order(MESHES[degree], errors)
    assert order == pytest.approx(expected, abs=SLOPE), f"{order:.2f} from {errors}"


@pytest.mark.parametrize("degree", [2, 3, 4])
@pytest.mark.parametrize("kind", ["gauss", "radau"])
def test_order_on_the_uniform_circle(kind, degree):
    """By symmetry even Radau reaches 2d here: its leading error is a change of radius alone."""
    errors = [period_error(sl.UNIFORM, P_KEPLER[:2], n, degree, kind) for n in MESHES[degree]]
    assert fitted_order(MESHES[degree], errors) == pytest.approx(2 * degree, abs=SLOPE)


@pytest.mark.parametrize("kind", ["gauss", "radau"])
def test_order_with_two_fields(kind):
    """A phase boundary where the field jumps, resolved by an event, costs no order."""
    degree = 3
    errors = [period_error(sl.TWO_CLOCKS, P_KEPLER, n, degree, kind) for n in MESHES[degree]]
    expected = 2 * degree if kind == "gauss" else 2 * degree - 1
    assert fitted_order(MESHES[degree], errors) == pytest.approx(expected, abs=SLOPE)


@pytest.mark.parametrize("kind", ["gauss", "radau"])
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_order_between_the_nodes(kind, degree):
    """The collocation polynomial itself is good to h^(d+1)."""
    errors = []
    tau = np.linspace(0.05, 0.95, 19)
    for n in MESHES[degree]:
        t, u, setting = circle_guess(sl.KEPLER, P_KEPLER, n, degree, kind)
        solution = newton(t, u, setting)
        times = (np.arange(n)[:, None] + tau) / n * sl.period(*P_KEPLER)
        exact = sl.states(times.ravel(), *P_KEPLER).T.reshape(n, tau.size, 2)
        w = t.intervals_of(solution.u).reshape(n, degree + 1, 2) * setting.scale
        errors.append(float(np.max(np.abs(t.scheme.interpolation(tau) @ w - exact))))
    # A maximum over a grid of points, not one number that converges smoothly: hence the wider margin.
    assert fitted_order(MESHES[degree], errors) == pytest.approx(degree + 1, abs=2 * SLOPE)


@pytest.mark.parametrize("solver", [newton, ipopt])
@pytest.mark.parametrize(("cycle", "p"), [(sl.UNIFORM, P_KEPLER[:2]), (sl.KEPLER, P_KEPLER), (sl.TWO_CLOCKS, P_KEPLER)])
def test_exact_cycle_and_multipliers(cycle, p, solver):
    """48 intervals of degree 5 leave nothing but rounding: about 1e-16 per unknown, summed over 600."""
    t, u, setting = circle_guess(cycle, p, 48, 5, "gauss")
    solution = solver(t, u, setting)
    assert solution.status is Status.CONVERGED
    assert t.durations_of(solution.u).sum() == pytest.approx(sl.period(*p), rel=ROUND_OFF)
    radius = np.linalg.norm(t.nodes_of(solution.u) * setting.scale, axis=1)
    np.testing.assert_allclose(radius, np.sqrt(p[0]), rtol=ROUND_OFF)
    found = multipliers(t, solution.u, setting)
    assert found.half[0] == pytest.approx(1, abs=ROUND_OFF)
    assert found.leading == pytest.approx(sl.multiplier(*p), rel=10 * ROUND_OFF)
    np.testing.assert_allclose(found.full, [1, sl.multiplier(*p)], rtol=10 * ROUND_OFF)
    assert found.stable is None and found.trivial_error < ROUND_OFF  # one mesh alone tells no error
    assert not found.trusted  # on one mesh nobody knows their error


def test_exact_states_solve_the_equation():
    """The reference itself: Kepler's solution, differentiated numerically, against the field."""
    times = np.linspace(0, sl.period(*P_KEPLER), 50)
    h = 1e-3  # central differences of fourth order: h^4 against rounding 1e-16/h
    slope = (
        8 * (sl.states(times + h, *P_KEPLER) - sl.states(times - h, *P_KEPLER))
        - (sl.states(times + 2 * h, *P_KEPLER) - sl.states(times - 2 * h, *P_KEPLER))
    ) / (12 * h)
    for at, expected in zip(sl.states(times, *P_KEPLER).T, slope.T, strict=True):
        field = np.array(sl.kepler_field(ca.DM(at), ca.DM(P_KEPLER), 0.0)).ravel()
        np.testing.assert_allclose(field, expected, atol=1e-10)


# The Jacobian against CasADi's own, and the condensed step against a dense solve ------------------------------

LUGRE: Signature = (
    ("slide+", "reversal"),
    ("slide-", "reversal"),
    ("slide+", "reversal"),
    ("slide", "centre"),
)
SLIPS_BACK: Signature = (("slip+", "stop"), ("slip-", "stop"), ("stick", "breakaway+"))
SWITCH: Signature = (("slip+", "stop"), ("stick", "breakaway-"))


def servo_cycle(model, half: Signature, *, whole: bool = False) -> Cycle:
    problem = Hunting(model, Servo(), 0.1)
    return problem.whole().cycle(half + mirrored(half), 1) if whole else problem.cycle(half, 2)


SERVO_CYCLES = {
    "switch half": (servo_cycle("switch", SWITCH), (4, 0)),
    "switch full": (servo_cycle("switch", SWITCH, whole=True), (3, 0, 4, 0)),
    "switch reversal": (servo_cycle("switch", SLIPS_BACK), (2, 3, 0)),
    "lugre half": (servo_cycle("lugre", LUGRE), (3, 1, 2, 4)),
    "lugre full": (servo_cycle("lugre", LUGRE, whole=True), (2, 1, 1, 2, 1, 2, 1, 1)),
}
JUGGLER = language.System(
    "juggler", ("x", "v"), {"g": 9.0, "d": 0.4, "r": 0.8, "w": 2.5},
    (language.Mode("flight", lambda x, p: {"x": x.v, "v": -p.g - p.d * x.v**3 + ca.cos(p.w * x.t)}, ends=(
        language.Event("catch", lambda x, p: x.x - p.d * ca.sin(p.w * x.t), -1, to="held",
                       reset=lambda x, p: {"v": -p.r * x.v + x.x**2 * ca.cos(p.w * x.t)}),)),
     language.Mode("held", flow=lambda x, t, p: {"x": x.x + x.v * ca.sin(p.w * t), "v": x.v * ca.exp(-p.d * t)}, ends=(
        language.Event("throw", lambda x, p: x.x * x.v - p.r, +1, to="flight",
                       reset=lambda x, p: {"x": x.x * p.r, "v": x.v**2 + p.g * x.x}),))),
    forcing_period=lambda p: 2 * np.pi / p.w,
)  # fmt: skip
"""Every event with a jump, in a mode with a field and in one in closed form; the time a state."""
SHIFT = (0.3, 0.0, 0.5)


def juggling(*sequence: str) -> Cycle:
    """Half a cycle of these modes: mirrored in x and v, and half a turn later; the last event jumps too."""
    form = JUGGLER.vector_form
    phases = tuple(Phase(form.modes[name], form.exits[name][0].event, form.exits[name][0].reset) for name in sequence)
    mirror = np.diag([-1.0, -1.0, 1.0])
    return Cycle(form.name, form.states, tuple(JUGGLER.parameters), phases, mirror, repeats=2, shift=SHIFT)


JUMPS = {"jumps": (("flight", "held"), (3, 0)), "more jumps": (("held", "flight", "flight"), (0, 2, 1))}
SCALES = {3: [0.02, 0.1, 0.05], 4: [0.02, 0.1, 0.05, 2e-5]}
"""Sizes of the states of a hunting cycle at gain 0.1 [rad, rad/s, rad s, rad]."""


def case(name: str) -> tuple[Transcription, Setting, Array]:
    """A transcription, a setting with a parameter direction, and a random point: no solution of anything."""
    rng = np.random.default_rng(7)
    if name in ("two fields", "two timed fields"):
        cycle, counts, p = sl.TWO_CLOCKS, (3, 2), np.array(P_KEPLER)
        if name == "two timed fields":
            timed = VectorEvent("timed", lambda x, T, p: x[1] - p[1] * T * x[0])
            cycle = replace(cycle, phases=tuple(replace(phase, end=timed) for phase in cycle.phases))
        scale, dp = np.array([0.5, 0.7]), np.array([0.3, 1.0, -0.5, 0.2])
    elif name in JUMPS:
        sequence, counts = JUMPS[name]
        cycle, p = juggling(*sequence), JUGGLER.values()
        scale, dp = np.array([0.7, 2.0, 1.0]), np.array([0.3, -0.2, 0.5, 1.0])
    else:
        cycle, counts = SERVO_CYCLES[name]
        p, scale = Servo().parameters(0.1), np.array(SCALES[len(cycle.states)])
        dp = np.zeros(p.size)
        dp[[PARAMETERS.index("gain"), PARAMETERS.index("friction.static")]] = 0.1, 0.5
    t = transcribe(cycle, counts, 3, "gauss" if "switch" in name else "radau")
    fractions = np.concatenate([rng.dirichlet(np.full(count, 5.0)) for count in counts if count])
    u = rng.uniform(-1, 1, t.size)
    t.durations_of(u)[:] = rng.uniform(0.1, 0.3, t.phases)
    return t, Setting(fractions, p, scale, dp), u


CASES = [*SERVO_CYCLES, "two fields", "two timed fields", *JUMPS]


def evaluated(t: Transcription, setting: Setting, u: Array, lam: float, nu: Array, *expressions: ca.MX) -> list[Array]:
    """CasADi expressions on the symbols of `graphs(t)` as dense arrays."""
    g = graphs(t)
    f = ca.Function("f", [g.z, g.data, g.nu], list(expressions))
    data = np.concatenate([setting.fractions, setting.p, setting.dp, setting.scale])
    values = f.call([ca.DM(np.append(u, lam)), ca.DM(data), ca.DM(nu)])
    return [np.array(ca.DM(value).full()) for value in values]


def dense(t: Transcription, setting: Setting, u: Array) -> tuple[Array, Array, Array]:
    """(residual, d residual/du, d residual/d lambda) at lambda = 0, differentiated by CasADi as a whole."""
    g = graphs(t)
    r, J = evaluated(t, setting, u, 0.0, np.zeros(t.size), g.residual, ca.jacobian(g.residual, g.z))
    return r.ravel(), J[:, :-1], J[:, -1]


@pytest.mark.parametrize("name", CASES)
def test_placed_jacobian_is_the_jacobian(name):
    t, setting, u = case(name)
    g = graphs(t)
    own = ca.jacobian(g.residual, g.z)
    placed, reference = evaluated(t, setting, u, 0.01, np.zeros(t.size), g.jacobian, own)
    assert placed.shape == reference.shape == (t.size, t.size + 1)
    assert np.isfinite(reference).all()
    # Two orders of summation of the same products: relative to the largest entry of the row.
    size = np.max(np.abs(reference), axis=1, keepdims=True)
    np.testing.assert_allclose(placed / size, reference / size, rtol=0, atol=1e-13)
    # A missing place would be a derivative lost, a place too many memory alone.
    assert (g.jacobian.sparsity() + own.sparsity()).nnz() == g.jacobian.nnz()


@pytest.mark.parametrize("name", CASES)
def test_placed_hessian_is_the_hessian(name):
    t, setting, u = case(name)
    g = graphs(t)
    nu = np.random.default_rng(9).standard_normal(t.size)
    placed = lagrangian_hessian(t)
    own = ca.triu(ca.hessian(ca.dot(g.nu, g.residual), g.z)[0])
    found, reference = evaluated(t, setting, u, 0.01, nu, placed, own)
    assert np.isfinite(reference).all()
    np.testing.assert_allclose(found, reference, rtol=0, atol=1e-13 * float(np.max(np.abs(reference))))
    assert (placed.sparsity() + own.sparsity()).nnz() == placed.nnz()


@pytest.mark.parametrize("name", CASES)
def test_condensed_step_is_the_newton_step(name):
    """Linearisation.step, stages eliminated, against LU of the whole bordered matrix."""
    t, setting, u = case(name)
    residual, J, along = dense(t, setting, u)
    lin = t.linearise(u, setting)
    assert lin.residual_norm() == pytest.approx(float(np.max(np.abs(residual))), rel=1e-13)
    rng = np.random.default_rng(8)
    ends = np.concatenate([[0], t.phase_end])
    nodes, durations, weight = rng.standard_normal((t.phases + 1, t.n)), rng.standard_normal(t.phases), 0.7
    for row in (
        t.system.border(parameter=1.0),
        t.system.border(nodes=nodes, durations=durations, parameter=weight),
    ):
        border = np.zeros(t.size + 1)
        border[-1] = row[-1]
        if row[:-1].any():
            border[t.node_index[ends].ravel()] = nodes.ravel()
            border[t.size - t.phases : t.size] = durations
        value = 0.25
        matrix = np.vstack([np.column_stack([J, along]), border])
        expected = np.linalg.solve(matrix, np.append(-residual, value))
        du, y, dlam = lin.step(row, value)
        # Either way of solving errs by the condition number of the matrix, at worst, in units of 1e-16.
        close = {"rtol": 0, "atol": 1e-15 * np.linalg.cond(matrix) * float(np.max(np.abs(expected)))}
        assert close["atol"] < 1e-6 * float(np.max(np.abs(expected)))
        np.testing.assert_allclose(np.append(du, dlam), expected, **close)
        np.testing.assert_allclose(y[: (t.elements + 1) * t.n].reshape(-1, t.n), du[t.node_index], rtol=0, atol=0)

        tangent, y = lin.tangent(row)
        direction = np.linalg.solve(matrix, np.append(np.zeros(t.size), 1.0))
        close["atol"] *= max(1.0, float(np.max(np.abs(direction)) / np.max(np.abs(expected))))
        np.testing.assert_allclose(np.append(tangent, y[-1]), direction, **close)


@pytest.mark.parametrize("name", JUMPS)
def test_jumps_and_shifts_as_they_are_written(name):
    """The residuals of joints and closure in numbers, and their derivatives by central differences."""
    t, setting, u = case(name)
    lin, D, p = t.linearise(u, setting), setting.scale, setting.p
    nodes = t.nodes_of(u) * D
    names = JUGGLER.names
    closed = iter(lin.flow_residual)
    e = 0
    for phase, count, duration in zip(t.cycle.phases, t.counts, t.durations_of(u), strict=True):
        if count == 0:
            held = JUGGLER.mode("held").flow
            assert held is not None
            end = held(names.x(nodes[e], p), duration, names.p(p))
            turns = nodes[e, 2] + duration * p[3] / (2 * np.pi)
            expected = nodes[e + 1] - [float(end["x"]), float(end["v"]), turns]
            np.testing.assert_allclose(next(closed) * D, expected, atol=1e-14)
        e += max(count, 1)
        reset = JUGGLER.mode(phase.mode.name).ends[0].reset
        assert reset is not None
        jumped = {"x": nodes[e, 0]} | dict(reset(names.x(nodes[e], p), names.p(p)))
        expected = nodes[e + 1] - [float(jumped["x"]), float(jumped["v"]), nodes[e, 2]]
        np.testing.assert_allclose(next(closed) * D, expected, atol=1e-14)
        e += 1
    mirrored = np.array([-1, -1, 1]) * nodes[-1] - SHIFT
    np.testing.assert_allclose(lin.closure_residual * D, nodes[0] - mirrored, atol=1e-14)

    def residual(z: Array) -> Array:
        there = t.linearise(z[:-1], setting.moved(z[-1]))
        parts = (there.interval_residual, there.flow_residual, there.closure_residual, there.events[0])
        return np.concatenate([part.ravel() for part in parts])

    z, h = np.append(u, 0.0), 1e-6
    by_differences = np.stack([(residual(z + h * e) - residual(z - h * e)) / (2 * h) for e in np.eye(z.size)], axis=1)
    r, J, along = dense(t, setting, u)
    np.testing.assert_allclose(residual(z), r, atol=1e-13)
    size = float(np.max(np.abs(by_differences)))
    np.testing.assert_allclose(np.column_stack([J, along]), by_differences, atol=1e-8 * size)


@pytest.mark.parametrize("name", CASES)
def test_adjoint_solve_is_the_transpose(name):
    """The node system is the Schur complement of the stages: its adjoint gives the same sensitivities."""
    t, setting, u = case(name)
    residual, J, _ = dense(t, setting, u)
    lin = t.linearise(u, setting)
    goal = np.zeros(t.system.size)
    goal[-1 - t.phases : -1] = 1.0  # the half period
    (psi,) = t.system.solve_transposed(lin.matrix(t.system.border(parameter=1.0)), goal[None])
    expected = float(np.sum(np.linalg.solve(J, -residual)[-t.phases :]))
    assert psi @ lin.rhs() == pytest.approx(expected, rel=1e-15 * np.linalg.cond(J) + 1e-12)


def test_a_singular_node_system_has_no_answer():
    """CasADi's sparse solve leaves its output buffer alone where the matrix is singular."""
    found = find_orbit(table1.servo(), "switch", 0.3, options=Options(tol=1e-6))
    t, u, setting = unknowns_of(found)
    lin = t.linearise(u, setting)
    good, _ = lin.tangent(t.system.border(parameter=1.0))
    assert np.isfinite(good).all()
    bad, y = lin.tangent(t.system.border())
    assert not np.isfinite(y).all() and not np.isfinite(bad).all()


@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_newton_leaves_out_no_more_than_it_may(branch):
    """The point it stops at is as close to the solution with all digits as asked for, and no closer than need be."""
    found = find_orbit(table1.servo(), "switch", 0.3, branch=branch, options=Options(tol=1e-6))
    t, u, setting = unknowns_of(found)
    start = u * (1 + 1e-3 * np.random.default_rng(4).standard_normal(u.size))
    whole = newton(t, start, setting)
    part = newton(t, start, setting, accuracy=1e-8)
    assert whole.status.ok and part.status.ok and part.iterations <= whole.iterations
    assert float(np.max(np.abs(part.u - whole.u) / np.maximum(1.0, np.abs(whole.u)))) <= 1e-8


def test_transcriptions_of_one_structure_are_interchangeable():
    """An IPOPT solver built for one serves another, however often transcriptions are made anew."""
    t, u, setting = unknowns_of(find_orbit(table1.servo(), "switch", 0.3))
    other = Transcription(t.cycle, t.counts, t.degree, t.kind)
    assert other is not t and other == t and hash(other) == hash(t)
    assert other != Transcription(t.cycle, t.counts, t.degree - 1, t.kind)
    _ipopt_solver.cache_clear()
    for equal in (t, other):
        np.testing.assert_allclose(ipopt(equal, u, setting).u, u, rtol=1e-7, atol=1e-9)
    assert _ipopt_solver.cache_info().misses == 1
