"""Meshes: polynomials survive every change, intervals go where they are asked for, and errors are what they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from layout import cycle_of, laid_out, still
from test_convergence import P_KEPLER, circle_guess

from casahunt.collocation import error_estimate, mesh, remesh
from casahunt.collocation.ipopt import ipopt
from casahunt.collocation.newton import newton
from casahunt.collocation.transcription import Setting, transcribe
from casahunt.continuation import predictor
from casahunt.hybrid.system import VectorMode
from problems import stuart_landau as sl

DEGREE = 4
FREE, HELD = VectorMode("free", still), VectorMode("held", still, flow=lambda x, T, p: x)
ROUNDING = 1e-13


def polynomial(seed: int):
    """Two polynomials of degree 4 in the time of a phase."""
    coefficients = np.random.default_rng(seed).standard_normal((DEGREE + 1, 2))
    return lambda tau: np.vander(np.asarray(tau, float), DEGREE + 1) @ coefficients


def three_phases():
    """(transcription, u, fractions, breaks, motions): collocated, closed form, collocated; continuous."""
    one, three = polynomial(1), polynomial(3)
    start = one(np.array([1.0]))
    two = lambda tau: start + np.asarray(tau)[:, None] * (three(np.array([0.0])) - start)  # noqa: E731
    breaks = [np.array([0, 0.3, 0.5, 1.0]), np.array([0.0, 1.0]), np.array([0, 0.6, 1.0])]
    t, u, fractions = laid_out(cycle_of(FREE, HELD, FREE), breaks, (one, two, three), (1.0, 2.0, 0.5), degree=DEGREE)
    return t, u, fractions, [breaks[0], breaks[2]], (one, two, three)


@pytest.mark.parametrize("how", ["transfer", "halved", "divided"])
def test_a_polynomial_is_the_same_on_every_mesh(how):
    t, u, fractions, breaks, motions = three_phases()
    if how == "transfer":
        fresh = [np.array([0, 0.45, 0.5, 0.8, 0.9, 1.0]), np.array([0, 1.0])]
        other, v, lengths = mesh.transfer(t, u, fractions, fresh)
    elif how == "divided":
        fresh = [np.array([0, 0.1, 0.2, 0.3, 0.5, 0.75, 1.0]), np.array([0, 0.15, 0.3, 0.45, 0.6, 1.0])]
        other, v, lengths = mesh.divided(t, u, fractions, np.array([3, 1, 2, 4, 1]))
    else:
        fresh = mesh.halved(breaks)
        other, v, lengths = mesh.on_halved_mesh(t, u, fractions)
        np.testing.assert_allclose(fresh[0], [0, 0.15, 0.3, 0.4, 0.5, 0.75, 1], atol=ROUNDING)
        np.testing.assert_allclose(fresh[1], [0, 0.3, 0.6, 0.8, 1], atol=ROUNDING)
    all_breaks = [fresh[0], np.array([0.0, 1.0]), fresh[1]]
    same, expected, same_lengths = laid_out(t.cycle, all_breaks, motions, (1.0, 2.0, 0.5), degree=DEGREE)
    assert other == same
    np.testing.assert_allclose(lengths, same_lengths, atol=ROUNDING)
    np.testing.assert_allclose(v, expected, atol=10 * ROUNDING)
    # No event is moved, not by rounding either.
    ends, old_ends = np.append(0, other.phase_end), np.append(0, t.phase_end)
    np.testing.assert_array_equal(other.nodes_of(v)[ends], t.nodes_of(u)[old_ends])
    for a, b in zip(mesh.phase_breaks(other, lengths), fresh, strict=True):
        np.testing.assert_allclose(a, b, atol=ROUNDING)


def test_states_between_the_nodes():
    t, u, fractions, _, motions = three_phases()
    times = np.array([0.0, 0.1, 0.3, 0.5, 0.61, 0.99, 1.0])
    for phase in (0, 2):
        found = mesh.evaluate_phase(t, u, fractions, phase, times)
        np.testing.assert_allclose(found, motions[phase](times), atol=10 * ROUNDING)


def test_four_in_place_of_one():
    t, _, fractions, _, _ = three_phases()
    first, last = mesh.quartered_where(t, fractions, np.array([False, True, False, False, True]))
    np.testing.assert_allclose(first, [0, 0.3, 0.35, 0.4, 0.45, 0.5, 1], atol=ROUNDING)
    np.testing.assert_allclose(last, [0, 0.6, 0.7, 0.8, 0.9, 1], atol=ROUNDING)


def test_the_measured_state_at_the_ends_of_the_phases():
    t, u, _, _, motions = three_phases()
    ends = np.abs([motions[0](np.array([0.0, 1.0]))[:, 0], motions[2](np.array([0.0, 1.0]))[:, 0]]).ravel()
    value, place = error_estimate.amplitude_row(t, u)
    assert value == pytest.approx(ends.max(), rel=ROUNDING) and place == int(np.argmax(ends))


# The next mesh -----------------------------------------------------------------------------------------------

TOL = 1e-6


def wanted(blame: list[float], shape: list[float], *, changes: int = 0, mode: VectorMode = FREE) -> np.ndarray:
    """The next boundaries of ten equal intervals of one phase, blame in units of the share of an interval."""
    breaks = np.linspace(0, 1, 11)
    t, _, fractions = laid_out(cycle_of(mode), [breaks], [polynomial(1)], (1.0,), degree=DEGREE)
    share = remesh.SAFETY * TOL / 10
    e = error_estimate.Estimate(0.0, 0.0, 0.0, np.array(blame) * share, np.array(shape) * min(remesh.SHAPE, TOL**0.5))
    (found,) = remesh.better_breaks(t, fractions, e, TOL, changes)
    return found


def cut(k: int, parts: int) -> np.ndarray:
    """Ten equal intervals, the k-th of them in so many parts."""
    return np.sort(np.append(np.linspace(0, 1, 11), 0.1 * k + 0.1 * np.arange(1, parts) / parts))


def test_intervals_go_where_the_error_is():
    """Blame falls like h^9 at degree 4 (Gauss), h^3 next to a kink; a Legendre coefficient like h^4."""
    ones, small = np.ones(10), np.full(10, 1e-9)
    np.testing.assert_allclose(wanted(ones, small), np.linspace(0, 1, 11), atol=1e-12)
    for k in (0, 4):
        blame = ones.copy()
        blame[k] = 3.0**9
        np.testing.assert_allclose(wanted(blame, small), cut(k, 3), atol=1e-9)
        blame[k] = 3.0**3
        np.testing.assert_allclose(wanted(blame, small, mode=replace(FREE, smooth=False)), cut(k, 3), atol=1e-9)
        shape = ones.copy()
        shape[k] = 3.0**4
        np.testing.assert_allclose(wanted(ones, shape), cut(k, 3), atol=1e-9)
        blame[k] = 1e30
        np.testing.assert_allclose(wanted(blame, small), cut(k, 4), atol=1e-9)


@pytest.mark.parametrize(("changes", "left"), [(0, 1), (1, 3), (2, 10), (7, 10)])
def test_a_mesh_is_coarsened_ever_less(changes, left):
    """Meshes that keep coarsening go round in circles."""
    nothing = np.full(10, 1e-30)
    np.testing.assert_allclose(wanted(nothing, nothing, changes=changes), np.linspace(0, 1, left + 1), atol=1e-12)


def test_the_shape_is_the_last_legendre_coefficient():
    """P_4 has the coefficient 35/8 of x^4, and x = 2 tau - 1 on the interval."""
    quartic = lambda tau: np.stack([0 * tau, 0.7 * (2 * np.asarray(tau) - 1) ** 4], axis=1)  # noqa: E731
    t, u, _ = laid_out(cycle_of(FREE), [np.array([0.0, 1.0])], [quartic], (1.0,), degree=DEGREE)
    np.testing.assert_allclose(mesh.shape(t, u), 0.7 * 8 / 35, rtol=1e-12)
    t, u, _ = laid_out(cycle_of(FREE), [np.array([0.0, 0.5, 1.0])], [quartic], (1.0,), degree=DEGREE)
    np.testing.assert_allclose(mesh.shape(t, u), 0.7 * 8 / 35 / 16, rtol=1e-12)


# Errors that are known -----------------------------------------------------------------------------------------


def uneven(cycle, intervals: int, degree: int, kind: str):
    """A solution of the oscillator on intervals of unequal length."""
    t, u, setting = circle_guess(cycle, P_KEPLER, intervals, degree, kind)
    count = intervals // t.phases
    b = np.linspace(0, 1, count + 1)
    breaks = [b + 0.1 * np.sin(2 * np.pi * b) / (2 * np.pi)] * t.phases
    _, u, fractions = mesh.transfer(t, u, setting.fractions, breaks, target=t)
    setting = replace(setting, fractions=fractions)
    solution = newton(t, u, setting)
    assert solution.status.ok
    return t, solution.u, setting


@pytest.mark.parametrize("cycle", [sl.KEPLER, sl.TWO_CLOCKS], ids=["one phase", "two phases"])
@pytest.mark.parametrize(("kind", "degree", "intervals"), [("gauss", 2, 96), ("radau", 3, 48), ("gauss", 3, 40)])
def test_the_first_order_estimate_is_the_error(cycle, kind, degree, intervals):
    """To a tenth: the next order of the error, and that of the halved mesh, 2^(2d - 1) times smaller."""
    t, u, setting = uneven(cycle, intervals, degree, kind)
    rough = error_estimate.estimate(t, u, setting, accepted=0.0)
    period = t.durations_of(u).sum() / sl.period(*P_KEPLER) - 1
    amplitude = error_estimate.amplitude_row(t, u)[0] * setting.scale[0] / np.sqrt(P_KEPLER[0]) - 1
    assert abs(period) > 1e-10, "above rounding"
    assert rough.period == pytest.approx(abs(period), rel=0.1)
    assert rough.amplitude == pytest.approx(abs(amplitude), rel=0.1)
    assert rough.parameter == 0 and rough.error == max(rough.period, rough.amplitude)
    assert rough.indicators.shape == (t.intervals,) and rough.indicators.min() >= 0
    assert rough.indicators.sum() >= 0.99 * rough.error, "some interval is to blame for every part of it"
    # What may have been overlooked is added, no more than a few times as much where nothing was.
    whole = error_estimate.estimate(t, u, setting)
    assert whole.period >= abs(period) and whole.amplitude >= abs(amplitude)
    assert rough.period <= whole.period <= 10 * rough.period
    assert rough.amplitude <= whole.amplitude and np.all(rough.indicators <= whole.indicators)


def test_an_error_of_the_parameter():
    """The clock is held, omega is free: 2 pi/T is the truth."""
    t, u, setting = uneven(sl.KEPLER, 40, 3, "radau")
    omega = P_KEPLER[1]
    setting = replace(setting, dp=np.array([0.0, omega, 0.0, 0.0]))
    row = t.system.border(durations=np.array([1.0]))
    t.durations_of(u)[:] = sl.period(*P_KEPLER)
    for solver in (newton, ipopt):
        solution = solver(t, u, setting, border=row)
        assert solution.status.ok
        assert t.durations_of(solution.u)[0] == pytest.approx(sl.period(*P_KEPLER), rel=1e-12)
        e = error_estimate.estimate(t, solution.u, setting.moved(solution.parameter), border=row, accepted=0.0)
        assert abs(solution.parameter) > 1e-10 and e.parameter == pytest.approx(abs(solution.parameter), rel=0.1)
        assert e.period < 1e-12 and e.error == max(e.parameter, e.amplitude)


@pytest.mark.parametrize("seed", [0, 1])
def test_both_solvers_hold_the_same_border(seed):
    """A row over all the nodes at phase ends, the durations and lambda, on two phases."""
    t, u, setting = uneven(sl.TWO_CLOCKS, 24, 4, "gauss")
    setting = replace(setting, dp=np.array([0.0, P_KEPLER[1], 0.0, 0.0]))
    rng = np.random.default_rng(seed)
    nodes, durations = rng.standard_normal((3, 2)), rng.standard_normal(2)
    row = t.system.border(nodes=nodes, durations=durations, parameter=2.0)
    start = u * (1 + 1e-2 * rng.standard_normal(u.size))
    ends = np.append(0, t.phase_end)

    def held(v, lam: float) -> float:
        return float(np.sum(nodes * t.nodes_of(v)[ends]) + durations @ t.durations_of(v) + 2.0 * lam)

    found = [solver(t, start, setting, border=row, parameter=0.01) for solver in (newton, ipopt)]
    for solution in found:
        assert solution.status.ok
        assert held(solution.u, solution.parameter) == pytest.approx(held(start, 0.01), abs=1e-10)
    np.testing.assert_allclose(found[0].u, found[1].u, rtol=0, atol=1e-9)
    assert found[0].parameter == pytest.approx(found[1].parameter, abs=1e-9)
    assert found[1].solver == "ipopt" and abs(found[0].parameter - 0.01) > 1e-4


def test_a_setting_along_its_direction():
    moved = Setting(np.ones(1), np.array([1.0, 2.0]), np.ones(2), np.array([0.5, -1.0])).moved(0.1)
    np.testing.assert_allclose(moved.p, [1.05, 1.9], atol=1e-15)


def test_numbers_of_intervals_that_do_not_fit():
    for counts in ((0, 0, 2), (3, 1, 2)):
        with pytest.raises(ValueError, match="do not fit its mode"):
            transcribe(three_phases()[0].cycle, counts, DEGREE, "gauss")


@pytest.mark.parametrize("wanted", [1.0, 4.0])
def test_no_interval_has_no_length(wanted):
    """One that is cut again and again comes down to rounding, where times within it are 0/0."""
    breaks = np.array([0.0, 3e-14, 0.5, 0.5 + 4e-14, 1 - 3e-14, 1.0])
    new = remesh._redistribute(breaks, np.full(5, wanted))
    assert new[0] == 0 and new[-1] == 1 and np.diff(new).min() > 1e-13 and len(new) == 2 * wanted + 1


def test_nor_where_all_are_halved_or_a_mesh_moves():
    t, _, fractions, breaks, _ = three_phases()
    stub = np.array([0.0, 1e-13, 1.0])
    (cut,) = mesh.halved([stub])
    assert np.diff(cut).min() > mesh.SHORTEST_INTERVAL and cut.size == 3
    moved = predictor._stretched(t, fractions * np.exp([0.0, -40.0, 0.0, 0.0, -40.0]), np.ones(5))
    assert moved.min() > 0.99 * mesh.SHORTEST_INTERVAL
    assert moved[:3].sum() == pytest.approx(1, abs=ROUNDING) == moved[3:].sum()
