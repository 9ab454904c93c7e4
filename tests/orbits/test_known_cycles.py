"""Orbits of the sheared oscillator (problems/stuart_landau.py): states, periods and multipliers are known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from casahunt import NoOrbit, Options
from casahunt.collocation.error_estimate import estimate
from casahunt.collocation.mesh import transfer
from casahunt.collocation.newton import newton
from casahunt.collocation.transcription import Setting, transcribe
from casahunt.errors import InputError, Status
from casahunt.orbits import adapt, floquet, map_chain, multiplier_mesh
from casahunt.orbits.adapt import finished, refined, solve_adaptively
from casahunt.orbits.bordering import curve_border
from casahunt.orbits.graded import _limited, spectrum
from casahunt.orbits.marched_mesh import remeshed
from casahunt.orbits.orbit import Orbit, orbit_of, unknowns_of
from problems import belt
from problems import stuart_landau as sl
from problems.fixed_sequence import FixedSequence

P = (0.6, 1.5, 2.4, 2.0, 0.6)
LARGEST_C = P[2] ** 2 / (4 * (1 - P[0]))


def start(p=P, *, larger: bool = True, half: bool = False, intervals: int = 8, degree: int = 5, off: float = 1.0):
    """(problem, starting point): the exact circle on a uniform mesh, `off` times as large."""
    posed = sl.SHEARED_HALF if half else sl.SHEARED
    problem = FixedSequence(posed, p, followed="c", scheme=(degree, "gauss"))
    t = transcribe(posed, (intervals,), degree, "gauss")
    turn = np.pi * (1 if half else 2)
    square = sl.sheared_square(*p, larger=larger)
    angles = turn / intervals * (np.arange(intervals)[:, None] + t.scheme.points)
    w = off * np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(intervals, -1)
    nodes = np.vstack([w[:, :2], -w[0, :2] if half else w[0, :2]])
    u = t.pack(w, nodes, np.array([sl.sheared_period(square, *p) * turn / (2 * np.pi)]))
    setting = Setting(np.full(intervals, 1 / intervals), problem.vector(), np.full(2, np.sqrt(square)), np.zeros(5))
    return problem, (t, u, setting)


def cycle(p=P, *, tol: float = 1e-9, solver="newton", **how) -> Orbit:
    problem, place = start(p, **how)
    options = Options(tol=tol)
    return finished(solve_adaptively(problem, place, options, solver=solver), problem, options, 0.0, "the cycle")


def at_c(c: float) -> tuple[float, ...]:
    return (*P[:3], c, P[4])


# Multipliers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize(
    ("c", "larger"),
    [(2.0, True), (2.0, False), (1.0, False), (LARGEST_C * (1 - 1e-6), True), (LARGEST_C - 1e-4, False)],
)
@pytest.mark.parametrize("tol", [1e-3, 1e-9])
def test_the_multipliers_of_every_cycle(c, larger, half, tol):
    """Next to the fold, where 1 and mu are a defective pair, and where mu is 100; of rough orbits too."""
    p = at_c(c)
    orbit = cycle(p, larger=larger, half=half, tol=tol)
    square = sl.sheared_square(*p, larger=larger)
    mu = sl.sheared_multiplier(square, *p)
    found = orbit.multipliers
    # mu changes with r^2, which at the fold is the root of what c is good to.
    near = 1e-3 if abs(c / LARGEST_C - 1) < 1e-3 else 1e-7
    assert found.leading.real == pytest.approx(np.sqrt(mu) if half else mu, rel=near) and found.leading.imag == 0
    assert found.full[1].real == pytest.approx(mu, rel=2 * near)
    assert found.log10_leading == pytest.approx(np.log10(found.leading.real), rel=1e-12)
    assert found.trivial_error < 1e-8 and found.trusted and found.half[0] == pytest.approx(1, abs=1e-8)
    assert found.stable is orbit.stable is (mu < 1)
    assert orbit.half is half
    if half:
        assert orbit.half_multiplier == found.leading.real
    else:
        assert np.isnan(orbit.half_multiplier)
    if near < 1e-3:
        second = orbit.integrator_multipliers
        assert second.leading.real == pytest.approx(np.sqrt(mu) if half else mu, rel=1e-6)


def test_the_interval_that_misses_the_flow_is_cut():
    """One four times as long as the others, of a circle: by the order, its map misses the flow by 4^11 as much."""
    _, (t, u, setting) = start(intervals=16)
    breaks = [np.concatenate([np.arange(6), np.arange(9, 17)]) / 16]
    t, u, fractions = transfer(t, u, setting.fractions, breaks)
    setting = replace(setting, fractions=fractions)
    solution = newton(t, u, setting)
    assert solution.status.ok
    found = multiplier_mesh._SolvedForMultipliers(
        (t, solution.u, setting), map_chain.collocation_chain(t, solution.u, setting)
    )
    defects = found.chain.flow_defects()
    others = np.arange(13) != 5
    assert 4**11 / 30 < defects[5] / np.median(defects[others]) < 4**11 * 30
    parts = multiplier_mesh._parts(found)
    assert (parts[others] == parts[0]).all() and parts[5] >= parts[0] + 2


CUT = 1e150
"""Multipliers beyond are cut to this: their squares would overflow."""


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def product_eigenvalues(factors):
    return spectrum(factors).values


def test_products_beyond_the_largest_number():
    """Factors of 1e100 and 1e-100, and of 1e100 alone, turned by complex angles."""
    scaled = lambda k: [1e100 * rotation(0.3)] * k  # noqa: E731
    back = [1e-100 * rotation(0.4)] * 2
    found = product_eigenvalues([*scaled(2), *back])
    np.testing.assert_allclose(np.sort_complex(found), [np.exp(-1.4j), np.exp(1.4j)], rtol=1e-12)
    found = product_eigenvalues(scaled(3))
    np.testing.assert_allclose(np.sort_complex(found), CUT * np.exp([-0.9j, 0.9j]), rtol=1e-12)
    # One that is cut beside ones that are not; a zero stays one.
    found = product_eigenvalues([np.diag([-1e100, 2.0, 1e-3])] * 3)
    np.testing.assert_allclose(found, [-CUT, 8.0, 1e-9], rtol=1e-6)
    assert product_eigenvalues([np.zeros((0, 0))]).size == 0
    singular = product_eigenvalues([np.diag([1e200, 0.0])])
    assert singular[0] == pytest.approx(CUT) and singular[1] == 0


def test_a_set_that_was_cut_is_not_trusted():
    grow = [np.diag([1.0, 1e100])] * 2
    flows = [np.array([1.0, 0.0])] * 3
    found = floquet.chain_multipliers(map_chain.MapChain(grow, flows, [0.0, 0.0]), 2)
    assert np.isinf(found.trivial_error) and not found.trusted and not found.stable
    assert found.leading == pytest.approx(CUT) and found.log10_leading == pytest.approx(150)
    fine = floquet.chain_multipliers(map_chain.MapChain([np.diag([1.0, -0.5])] * 2, flows, [0.0, 0.0]), 2)
    assert fine.trivial_error < 1e-12 and fine.stable is None and fine.leading == pytest.approx(0.25)
    np.testing.assert_allclose(fine.full, [1, 0.0625])


def test_next_to_a_fold_the_pair_is_told_from_the_others():
    """1 and mu = 1 + 1e-9 are all but defective and half the digits are lost, of their sum none; a third is 1.9."""
    basis = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
    near = np.array([[1.0, 5.0, 0.3], [0.0, 1 + 1e-9, 0.0], [0.0, 0.0, 1.9]])
    flow = basis[:, 0]
    found = floquet.chain_multipliers(map_chain.MapChain([basis @ near @ basis.T], [flow, flow], [0.0]), 1)
    assert found.trivial_error < 1e-12
    np.testing.assert_allclose(found.half, [1, 1.9, 1 + 1e-9], rtol=0, atol=1e-12)


def test_starts_anew_where_disturbances_have_grown():
    """By 100 since the last time, whatever shrinks besides."""
    growing = np.array([np.diag([3.0, 0.1])] * 12)
    assert map_chain._cuts(growing).tolist() == [0, 5, 10, 12]  # 3^5 = 243
    assert map_chain._cuts(growing[:5]).tolist() == [0, 5]
    assert map_chain._cuts(np.array([np.eye(2)] * 3)).tolist() == [0, 3]


# Orbits ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("half", [False, True])
def test_the_states_at_any_time(half):
    orbit = cycle(half=half, tol=1e-10)
    square = sl.sheared_square(*P)
    period = sl.sheared_period(square, *P)
    assert orbit.period == pytest.approx(period, rel=1e-10)
    assert orbit.amplitude == pytest.approx(np.sqrt(square), rel=1e-10)
    times, states = orbit.sample(5)
    assert times[0] == 0 and times[-1] == pytest.approx(period, rel=1e-10) and np.all(np.diff(times) > 0)
    assert times.size == orbit.repeats * 5 * len(orbit.arcs[0].states) + 1
    angle = 2 * np.pi * times / period
    np.testing.assert_allclose(states, np.sqrt(square) * np.array([np.cos(angle), np.sin(angle)]), atol=1e-5)
    ends = orbit.arcs[0]
    assert (ends.mode, ends.event) == orbit.signature[0] == ("turn", "y = 0")
    assert ends.duration == pytest.approx(period / orbit.repeats, rel=1e-10)


def test_a_stick_is_sampled_in_closed_form():
    """The block on the belt: the belt's speed, and a straight line."""
    from test_engine import found

    orbit = found()
    times, (x, v) = orbit.sample(9)
    slip, stick = orbit.arcs
    sticking = times >= slip.duration
    assert sticking.sum() == 9 + 1
    since = times[sticking] - slip.duration
    np.testing.assert_allclose(since[:-1], np.arange(9) / 9 * stick.duration, atol=1e-12)
    np.testing.assert_allclose(v[sticking], 0.2, atol=1e-9)
    np.testing.assert_allclose(x[sticking], slip.end[0] + 0.2 * since, atol=1e-9)
    assert type(belt.PROBLEM) is FixedSequence


def test_an_orbit_has_the_unknowns_it_was_made_of():
    problem, place = start()
    solved = solve_adaptively(problem, place, Options(tol=1e-8), solver="newton")
    orbit = orbit_of(solved, problem, wall_s=1.5)
    t, u, setting = unknowns_of(orbit)
    assert t == solved.t and orbit.wall_s == 1.5
    np.testing.assert_allclose(u, solved.solution.u, rtol=0, atol=1e-14)
    np.testing.assert_allclose(setting.fractions, solved.setting.fractions, atol=1e-14)
    np.testing.assert_array_equal(setting.p, solved.setting.p)
    np.testing.assert_array_equal(setting.dp, problem.direction("c"))
    assert orbit.unknowns == t.size and orbit.error_estimate == max(orbit.period_error, orbit.amplitude_error)
    worse = replace(orbit, parameter_error=0.5)
    assert worse.error_estimate == 0.5


# Adaptation --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["auto", "newton", "ipopt"])
@pytest.mark.parametrize("tol", [1e-4, 1e-7, 1e-10])
def test_the_tolerance_holds(tol, solver):
    """From two intervals, or from many too many; the estimate is no less than a tenth of the error."""
    square = sl.sheared_square(*P)
    for intervals in (2, 64):
        problem, place = start(intervals=intervals, degree=3)
        solved = solve_adaptively(problem, place, Options(tol=tol, solver=solver), solver="newton")
        orbit = orbit_of(solved, problem, wall_s=0.0)
        assert solved.status is Status.CONVERGED and orbit.error_estimate <= tol
        wrong = max(abs(orbit.period / sl.sheared_period(square, *P) - 1), abs(orbit.amplitude / np.sqrt(square) - 1))
        assert wrong <= 10 * orbit.error_estimate + 1e-13
        assert orbit.solver == ("newton" if solver == "auto" else solver)


def test_auto_takes_the_other_solver_where_one_fails(monkeypatch):
    """Patched: which one fails on which machine, rounding decides."""
    failed = lambda t, u, setting, **_: replace(true(t, u, setting, max_iterations=1), status=Status.NOT_CONVERGED)  # noqa: E731
    true = adapt.newton
    problem, place = start()
    monkeypatch.setattr(adapt, "newton", failed)
    solved = solve_adaptively(problem, place, Options(tol=1e-6), solver="newton")
    assert solved.status.ok


def test_no_more_intervals_than_there_may_be(at_most):
    problem, place = start(intervals=4, degree=2)
    at_most(20)
    solved = solve_adaptively(problem, place, Options(tol=1e-10), solver="newton")
    assert solved.status is Status.TOLERANCE_NOT_REACHED and solved.t.intervals <= 20
    assert solved.estimate is not None and f"error estimate {solved.estimate.error:.2g}" in solved.complaint()
    with pytest.raises(NoOrbit, match="the cycle of sheared oscillator at c 2 was not computed") as caught:
        finished(solved, problem, Options(solver="ipopt"), 0.0, "the cycle")
    assert "ipopt worked alone" in str(caught.value) and caught.value.status is Status.TOLERANCE_NOT_REACHED
    with pytest.raises(NoOrbit, match=r"error estimate [^;]*$"):
        finished(solved, problem, Options(), 0.0, "the cycle")


def test_another_tolerance():
    rough = cycle(tol=1e-3, degree=3)
    fine = refined(rough, Options(tol=1e-9))
    square = sl.sheared_square(*P)
    assert fine.error_estimate <= 1e-9 < rough.error_estimate
    assert fine.amplitude == pytest.approx(np.sqrt(square), rel=1e-8)
    assert fine.degree == rough.degree == 3


def test_a_motion_on_a_mesh_for_the_tolerance():
    """Nothing is solved: the states stay those of the motion, the mesh gets finer where the motion is too coarse."""
    _, place = start(intervals=3, degree=3)
    assert remeshed(place, Options(tol=1e-2))[0] is not place[0]
    t, u, setting = remeshed(place, Options(tol=1e-6))
    fit = start(intervals=10, degree=3)[1]
    tighter, looser = (remeshed(fit, Options(tol=tol))[0].intervals for tol in (1e-10, 1e-4))
    assert tighter > 30 and looser <= 10  # at most four in place of one at a time
    assert t.intervals > 6 and setting.fractions.sum() == pytest.approx(1)
    assert float(t.durations_of(u)[0]) == float(place[0].durations_of(place[1])[0])
    _, fine = start(intervals=40, degree=5)
    assert remeshed(fine, Options(tol=1e-4)) is fine
    rest = estimate(*fine, accepted=0.0).indicators.sum()
    assert rest <= 1e-4


def test_a_border_along_the_curve():
    """Weights of x_0, ln T_1 and lambda; the other durations and nodes have none."""
    t = transcribe(sl.TWO_CLOCKS, (3, 2), 3, "gauss")
    u = np.linspace(0.5, 2.0, t.size)
    row = curve_border(t, u, np.array([1.0, 2.0, 3.0, 4.0]))
    expected = t.system.border(
        nodes=np.array([[1.0, 2.0], [0, 0], [0, 0]]), durations=np.array([3.0 / t.durations_of(u)[0], 0]), parameter=4.0
    )
    np.testing.assert_allclose(row, expected, rtol=1e-15)


@pytest.mark.parametrize("tol", [1e-12, 1e-6, 1e-2])
def test_tolerances_within_reach(tol):
    assert Options(tol=tol).tol == tol
    assert Options(degree=4).scheme_of(FixedSequence(sl.SHEARED, P, "c", (6, "gauss"))) == (4, "gauss")
    assert Options(kind="radau").scheme_of(FixedSequence(sl.SHEARED, P, "c", (6, "gauss"))) == (6, "radau")
    for wrong in (0.99e-12, 1.01e-2):
        with pytest.raises(InputError, match="must lie between 1e-12 and 0.01"):
            Options(tol=wrong)


# Other phase sequences -------------------------------------------------------------------------------------------


ASKED: list[tuple[int, bool]] = []


@pytest.fixture(autouse=True)
def told_by_the_problem(monkeypatch):
    """A problem below says itself what sequences.py would find out of a system."""
    for name in ("other_sequences", "marched"):
        true = getattr(adapt, name)
        own = lambda posed, *at, name=name, true=true, **how: getattr(posed, name, partial(true, posed))(*at, **how)  # noqa: E731
        monkeypatch.setattr(adapt, name, own)


def impossible(lowest):
    """The sheared cycle in a mode that does not let x fall below minus so much."""
    (phase,) = sl.SHEARED.phases
    mode = replace(phase.mode, name="no turn", admissible=lambda x, p, sign: x[0] + lowest)
    return replace(sl.SHEARED, phases=(replace(phase, mode=mode),))


@dataclass(frozen=True)
class Elsewhere(FixedSequence):
    """Its only mode is no motion where x < -0.1; it knows of a cycle without that condition, or of none.

    The cycles on the way there are ever less wrong, or as wrong as the first one.
    """

    helps: int = 0
    as_wrong: bool = False

    def cycle(self, signature, repeats):
        return self.posed if signature == (("no turn", "y = 0"),) else sl.SHEARED

    def asked(self):
        return self

    def other_sequences(self, start, phase, *, soft):
        t, u, setting = start
        ASKED.append((phase, soft))
        if self.helps and len(ASKED) >= self.helps:
            nothing = t, np.full_like(u, np.nan), setting
            there = transcribe(sl.SHEARED, t.counts, t.degree, t.kind), u, setting
            return [nothing, there]
        by = 0.0 if self.as_wrong else 0.1 * len(ASKED)
        return [(transcribe(impossible(0.1 + by), t.counts, t.degree, t.kind), u, setting)]


def elsewhere(**about):
    """The problem whose first cycle is no motion, and where its solution begins."""
    problem, (_, (t, u, setting)) = Elsewhere(impossible(0.1), P, "c", **about), start()
    setting = replace(setting, dp=problem.direction("c"))
    return problem, (transcribe(problem.posed, t.counts, t.degree, t.kind), u, setting)


@dataclass(frozen=True)
class Marching(FixedSequence):
    """It knows its motion: the exact one, on 37 intervals, with parameters that are not those asked for."""

    knows: bool = True

    def asked(self):
        return self

    def marched(self, known):
        ASKED.append((known[0].intervals, True))
        if not self.knows:
            return []
        _, (there, v, fresh) = start(self.values, intervals=37, degree=3)
        return [(there, v, replace(fresh, p=np.full(5, np.nan)))]


@pytest.mark.parametrize("knows", [True, False])
def test_where_no_mesh_leads_on_the_motion_is_looked_at(monkeypatch, knows):
    """Once: 6 intervals of degree 3 are too few, and every other number of them but 37 fails, by a patch."""
    ASKED.clear()
    true = adapt.newton

    def picky(t, u, setting, **more):
        found = true(t, u, setting, **more)
        return found if t.intervals in (6, 37) else replace(found, status=Status.NOT_CONVERGED)

    monkeypatch.setattr(adapt, "newton", picky)
    monkeypatch.setattr(adapt, "ipopt_then_newton", picky)
    _, place = start(intervals=6, degree=3)
    problem = Marching(sl.SHEARED, P, "c", scheme=(3, "gauss"), knows=knows)
    solved = solve_adaptively(problem, place, Options(tol=1e-5), solver="newton")
    assert ASKED == [(6, True)]
    assert solved.status is (Status.CONVERGED if knows else Status.TOLERANCE_NOT_REACHED)
    assert solved.t.intervals == (37 if knows else 6)
    np.testing.assert_array_equal(solved.setting.p, P)


@pytest.mark.parametrize("border", [None, np.array([0.0, 0.0, 1.0, 0.0])])
@pytest.mark.parametrize("helps", [0, 1, 3])
@pytest.mark.parametrize("soft", [False, True])
def test_where_a_sequence_has_stopped_being_a_motion(helps, soft, border):
    ASKED.clear()
    problem, place = elsewhere(helps=helps)
    solved = solve_adaptively(problem, place, Options(tol=1e-8), solver="newton", soft=soft, border=border)
    assert set(ASKED) == {(0, soft)}
    if helps:
        assert solved.status is Status.CONVERGED and len(ASKED) == helps and solved.t.cycle == sl.SHEARED
        assert solved.solution.parameter == pytest.approx(0, abs=1e-6)  # it holds the exact period, or c
    else:
        assert solved.status is Status.INADMISSIBLE and "is no no turn" in solved.note
        assert len(ASKED) == adapt.MAX_SEQUENCES


def test_other_phases_that_leave_a_root_as_wrong_as_it_was_end_the_search():
    """On a branch of many short phases each of them used to be taken out in turn, in vain."""
    ASKED.clear()
    problem, place = elsewhere(helps=3, as_wrong=True)
    solved = solve_adaptively(problem, place, Options(tol=1e-8), solver="newton")
    assert solved.status is Status.INADMISSIBLE and "is no no turn" in solved.note and len(ASKED) == 1


def test_subnormal_values_beside_one_that_is_cut():
    """The quotient of a subnormal number by its modulus is a direction, not an overflow."""
    found = _limited(np.array([1e10 + 0j, 5e-324j]), 600)
    assert found[0] == pytest.approx(CUT) and 0 < found[1].imag < 1e-130
