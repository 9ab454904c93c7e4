"""The limits that continuation is bounded by: each answer changes where its limit is another one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_branch import DUFFING
from test_elsewhere import BRUSSELATOR
from test_grazing_curve import DAMPED

from casahunt import Servo, find_fold, find_orbit
from casahunt.collocation.ipopt import Solution
from casahunt.continuation import (
    FOLD,
    SUPERSTABLE,
    SYMMETRY_BREAKING,
    bifurcations,
    branch_off,
    crossings,
    follow,
    poincare_section,
    special_points,
    special_points_between,
    terminations,
    vanishing,
    walk,
)
from casahunt.continuation import (
    closed_branch as reunion,
)
from casahunt.errors import Status
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import Options, find_cycle, sequences, simulated_phases
from casahunt.orbits import simulated_phases as other_start
from casahunt.orbits.orbit import unknowns_of
from problems import belt
from scripts.random_servos import draw

OPTIONS = Options(tol=1e-8)


class Seen(SimpleNamespace):
    """In the place of an orbit, told apart by identity as orbits are."""

    __hash__ = object.__hash__


@pytest.fixture(scope="module")
def van_der_pol():
    field = {"field": lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}}
    return find_cycle(System("van der Pol", ("x", "v"), {"mu": 1.0}, (Mode("smooth", **field),)), x=2.0, v=0.0)


@pytest.fixture(scope="module")
def sticking():
    """Cut where the block turns, so that the stick stands between two phases of the slip."""
    slip, stick = DAMPED.modes
    turns = Event("turns", lambda x, p: x.v / p.belt, -1, to="slip")
    system = replace(DAMPED, modes=(replace(slip, ends=(*slip.ends, turns)), stick))
    found = []
    for speed in (0.6, 0.61):
        orbit = find_cycle(system, "slip", x=0.7, v=0.59, parameters={"belt": speed})
        first = (orbit.signature.index(("slip", "turns")) + 1) % 3
        start = other_start.rotated(orbit.problem.asked(), unknowns_of(orbit), first)
        found.append(vanishing.solved_at(orbit.problem, start, OPTIONS))
    return found


# special_points.py, crossings.py


@pytest.mark.parametrize(
    "places, passed, apart, order",
    [
        ([0.2, 0.1], [-1.0, 1.0], 1e-6, [1, 0]),
        ([0.2, 0.1], [-1.0, 1.0], 0.2, [0, 1]),
        ([0.2, 0.1], [-1.0, np.nan], 0.2, [1, 0]),
        ([0.3, 0.2, 0.1], [-1.0, 0.0, 1.0], 0.11, [0, 1, 2]),
        ([0.9, 0.3, 0.2, 0.1], [-1.0, -1.0, 0.0, np.nan], 0.11, [3, 2, 1, 0]),
    ],
)
def test_what_is_not_told_apart_comes_in_the_order_of_its_multiplier(places, passed, apart, order):
    assert special_points.by_place(places, passed, apart) == order


@pytest.mark.slow
def test_a_multiplier_passes_all_values_of_a_sharp_fold_in_order(monkeypatch):
    """It passes -1, 0 and +1 within 1e-10 of the gain: of what is located to 1e-6 nothing lies before anything else."""
    servo = Servo().replace(**draw(2026, 2))
    gain = 0.999 * find_fold(servo, "switch").gain
    ends = [find_orbit(servo, "switch", gain, branch=branch, options=OPTIONS) for branch in ("stable", "unstable")]
    located, others = crossings.locate_special_point, {"fold": SYMMETRY_BREAKING, "symmetry breaking": FOLD}
    kinds = ["symmetry breaking", "superstable", "fold"]
    for sense, other in ((1, {}), (-1, others)):

        def swapped(before, after, monitor, other=other, **how):
            return located(before, after, other.get(monitor.kind, monitor), **how)

        monkeypatch.setattr(crossings, "locate_special_point", swapped)
        monitors = FOLD, SYMMETRY_BREAKING, SUPERSTABLE
        found, missed = special_points_between(
            *ends[::sense], vary="gain", monitors=monitors, options=Options(tol=1e-6)
        )
        assert [special.kind for special in found] == kinds[::sense] and not missed


# walk.py


@pytest.mark.parametrize(
    "way, cycle, astray",
    [([1, 1.1], "same", False), ([1, 1.13], "same", True), ([-1, 0], "same", True), ([-1, 0], "other", False)],
)
def test_a_step_keeps_to_the_tangent_at_its_end(monkeypatch, way, cycle, astray):
    """At most acos(1/1.5), 48 degrees off it, as off that at its start; where phases change the tangents differ."""

    def at(cycle):
        row, setting = np.array([1.0, 0.0]), SimpleNamespace(scale=np.ones(1))
        return SimpleNamespace(t=SimpleNamespace(cycle=cycle), setting=setting, row=row)

    monkeypatch.setattr(walk, "secant_direction", lambda before, after, vary: np.array(way))
    orbit = SimpleNamespace(scale=np.ones(1))
    assert walk._astray(at("same"), at(cycle), orbit, orbit, "p") is astray


# bifurcations.py, closed_branch.py


@pytest.mark.parametrize(
    "slope, error, sure",
    [(1e-3, 1e-9, True), (5e-8, 1e-9, False), (-5e-8, 1e-9, False), (-2e-7, 1e-9, True), (1e-3, np.inf, False)],
)
def test_a_slope_that_is_rounding_has_no_sign(slope, error, sure):
    """NOISE_OF_SLOPE."""
    orbit, point = SimpleNamespace(error_estimate=error), SimpleNamespace(row=np.array([1.0, slope]))
    assert bifurcations.TURN.sure(orbit, point) is sure


@pytest.mark.parametrize(
    "mu, error, floor, sure",
    [
        ((0.5, 0.1), 1e-9, (0.0, 0.0), {"branch point", "flip", "Neimark-Sacker"}),
        ((1 + 1e-7, 0.1), 1e-9, (0.0, 0.0), {"branch point", "flip", "Neimark-Sacker"}),
        ((1 + 1e-7, 0.1), 1e-6, (0.0, 0.0), {"flip"}),
        ((-1 + 1e-7, 0.1), 1e-6, (0.0, 0.0), {"branch point"}),
        ((2.0, 0.5 + 1e-7), 1e-6, (0.0, 0.0), {"branch point", "flip", "Neimark-Sacker"}),
        ((np.exp(1j), np.exp(-1j)), 1e-9, (0.0, 0.0), {"branch point", "flip"}),
        ((1e10, 0.1), 1e-6, (0.0, 0.0), {"branch point", "flip", "Neimark-Sacker"}),  # an error relative to its size
        ((1e10, 0.1), 2.0, (0.0, 0.0), set()),
        ((0.5, 0.1), 1e-9, (0.0, 1.5), set()),  # a bound is all that is known of the second
        ((0.5, 0.1), np.inf, (0.0, 0.0), set()),
    ],
)
def test_the_sign_of_a_multiplier_is_sure_where_it_is_off_by_more_than_its_error(mu, error, floor, sure):
    multipliers = SimpleNamespace(error=error, half=np.array([1.0, *mu]), floor=np.array([0.0, *floor]))
    orbit = Seen(multipliers=multipliers, scale=np.ones(3))
    known = (bifurcations.BRANCH_POINT, bifurcations.FLIP, bifurcations.NEIMARK_SACKER)
    ranks = {monitor.kind: monitor.each(orbit) for monitor in known}
    known = {kind for kind, each in ranks.items() if all(abs(m.value(orbit, None)) > m.noise(orbit) for m in each)}
    assert known == sure


@pytest.fixture(scope="module")
def lopsided():
    (lost,) = follow(find_cycle(DUFFING, x=0.0, v=0.0), "A", to=2.5, options=OPTIONS).special
    return branch_off(lost, "A")


@pytest.mark.parametrize(
    "before, after, met",
    [
        (1e-4, -1e-4, True),
        (3e-6, -3e-6, False),
        (1e-4, 1e-9, True),  # the step has gone over to the symmetric cycles: on which side of zero, rounding decides
        (1e-4, -1e-9, True),
        (1e-4, 5e-5, False),
        (1e-9, 1e-4, False),  # and there is no way back from where a branch begins
    ],
)
def test_what_is_hardly_lopsided_has_met_nothing(lopsided, before, after, met):
    """LOPSIDED: a symmetric cycle that is computed whole is off its image by rounding, now and then on either side."""
    half = lopsided.arcs[len(lopsided.arcs) // 2].states[0, 0]

    def off(by):
        states = lopsided.arcs[0].states.copy()
        states[0, 0, :2] = -half[:2] + [by * lopsided.scale[0], 0.0]
        return replace(lopsided, arcs=(replace(lopsided.arcs[0], states=states), *lopsided.arcs[1:]))

    assert (reunion.reunion(off(before), off(after), 1e-9) is not None) is met


# terminations.py


def along(lam, sizes, periods, slowest, monkeypatch, event="", mu=0.5):
    """Cycles whose size and period change along a parameter, the last of them so slow at one place.

    They are made of these numbers alone: what a whole orbit tells of its size and its slowest place is patched.
    """
    monkeypatch.setattr(terminations, "_slowest", lambda orbit: (slowest, "mode", event))
    monkeypatch.setattr(terminations, "ranges", lambda orbit: np.array([orbit.size]))
    problem = [
        SimpleNamespace(value=lambda name, x=x: x, distance=lambda name, value, x=x: value - x, unit=lambda name: 1.0)
        for x in lam
    ]
    multipliers = SimpleNamespace(half=np.array([1.0, mu]))
    return [
        SimpleNamespace(problem=q, size=s, period=T, multipliers=multipliers, parameter_error=0.0)
        for q, s, T in zip(problem, sizes, periods, strict=True)
    ]


@pytest.mark.parametrize(
    "change, period, slowest, stuck, event, kind",
    [
        (1e-8, 2.0, 1e-6, False, "", "homoclinic orbit"),
        (1e-8, 2.0, 1e-6, False, "full", "level reached"),
        (1e-6, 2.0, 1e-6, False, "", None),  # STANDS_STILL
        (1e-6, 2.0, 1e-6, True, "", "homoclinic orbit"),
        (1e-3, 2.0, 1e-6, True, "", None),  # NEARLY_STILL
        (1e-8, 2.0, 1e-4, False, "", None),  # AT_AN_EQUILIBRIUM
        (1e-8, 2.0, 1e-4, True, "", "homoclinic orbit"),
        (1e-8, 2.0, 1e-2, True, "", None),  # NEXT_TO_ONE
        (1e-8, 0.9, 1e-9, True, "", None),  # the period falls
    ],
)
def test_when_a_cycle_takes_for_ever(monkeypatch, change, period, slowest, stuck, event, kind):
    orbits = along([1 - change, 1.0], [1.0, 1.0], [1.0, period], slowest, monkeypatch, event)
    end = terminations.comes_to(orbits, "K", stuck=stuck)
    assert (end and end.kind) == kind


@pytest.mark.parametrize(
    "lam, T", [(1 + 3.0 / (10 * 2.0 ** np.arange(12)) ** 2, 10 * 2.0 ** np.arange(12)),  # past a saddle-node
               (1 + np.exp(-3.0 * np.arange(1, 8)), 10 + 3.0 * np.arange(1, 8))],  # past a saddle
)  # fmt: skip
def test_where_a_period_without_bound_leads(monkeypatch, lam, T):
    end = terminations.comes_to(along(lam, np.ones(T.size), T, 1e-9, monkeypatch), "K", stuck=True)
    assert end.kind == "homoclinic orbit"
    assert abs(end.value - 1) <= max(end.error, 1e-14) < 0.3 * (lam[-1] - 1)


B = 4.0 ** -np.arange(8)


@pytest.mark.parametrize("power", [1 / 3, 1.0, 2.0])
@pytest.mark.parametrize("sense, kind", [(1, "shrinks to a point"), (-1, "grows without bound")])
def test_a_size_that_follows_a_power_leads_to_its_end(monkeypatch, power, sense, kind):
    """lambda = 1 + 0.3 b^p (1 + 0.1 b): the limit and the power come out to the order that b leaves."""
    lam = 1 + 0.3 * B**power * (1 + 0.1 * B)
    orbits = along(lam, B**sense, 1 + B, 1.0, monkeypatch)
    end = terminations.comes_to(orbits, "K", stuck=True)
    assert end.kind == kind and abs(end.value - 1) <= end.error <= 1e-4
    assert end.exponent == pytest.approx(sense / power, rel=1e-3)
    for limit, distance in ((1, "|K - "), (0, "|K|"), (-1, "|K + ")):
        moved = along(lam + limit - 1, B**sense, 1 + B, 1.0, monkeypatch)
        assert f"its size like {distance}" in terminations.comes_to(moved, "K", stuck=True).sentence
    assert terminations.comes_to(orbits[:3], "K", stuck=True) is None  # three are no evidence
    assert terminations.comes_to(orbits[:-3], "K") is None  # SHRUNK_TO
    astray = along(lam + np.where(np.arange(8) == 6, 0.02, 0.0) * B**power, B**sense, 1 + B, 1.0, monkeypatch)
    assert terminations.comes_to(astray, "K", stuck=True) is None  # AGREE


def test_steps_that_shrink_to_nothing_hide_no_law(monkeypatch):
    """Where no step leads on, the last orbits are one orbit but for rounding, in size as in the parameter."""
    rounding = 1e-9 * (-1.0) ** np.arange(5)  # the last one is the largest of them
    b = np.append(B, B[-1] * (1 + rounding))
    end = terminations.comes_to(along(1 + 0.3 * b**2, b, 1 + b, 1.0, monkeypatch), "K", stuck=True)
    assert end.kind == "shrinks to a point" and abs(end.value - 1) <= max(end.error, 1e-12)
    grown = np.append(B, 2 * B[-1])
    assert terminations.comes_to(along(1 + 0.3 * grown**2, grown, 1 + grown, 1.0, monkeypatch), "K", stuck=True) is None


@pytest.mark.parametrize("lam", [2 - B, 1 + B**0.001, 1 - 0.3 * B + 0.6 * (B == B[-1])])
def test_sizes_that_lead_nowhere(monkeypatch, lam):
    """The parameter goes on where the size is gone, or turns round: steps, not a law."""
    lam = lam if lam[0] != 1 else np.linspace(0, 1, 8)
    assert terminations.comes_to(along(lam, B, 1 + B, 1.0, monkeypatch), "K", stuck=True) is None


@pytest.mark.parametrize(
    "change, growth, mu, kind",
    [
        (0.0, 1.5, 1.0, "vertical family"),
        (1e-9, 1.5, 1.0, None),  # VERTICAL_STILL
        (0.0, 1.001, 1.0, None),  # its size stands still, too
        (0.0, 1.5, 1 + 1e-3, None),  # a canard: VERTICAL_MULTIPLIER
    ],
)
def test_when_a_family_is_vertical(monkeypatch, change, growth, mu, kind):
    n = np.arange(4)
    end = terminations.comes_to(along(n * change, growth**n, 1 + 0.0 * n, 1.0, monkeypatch, mu=mu), "K")
    assert (end and end.kind) == kind


def test_a_hopf_point_lies_where_the_amplitude_leads():
    """Of two large cycles the squares lead elsewhere, though the equilibrium has its Hopf point at b = 2."""
    before, last = (find_cycle(BRUSSELATOR, x=1.0, y=1.0, parameters={"b": b}) for b in (3.2, 2.9))
    assert terminations.hopf_point(before, last, "b") is None


# recut.py


def test_a_cycle_is_the_same_cut_by_another_plane(van_der_pol):
    assert poincare_section.cut_by_planes(van_der_pol) and not poincare_section.section_outgrown(van_der_pol)
    again = poincare_section.with_better_section(van_der_pol, "mu", OPTIONS)
    assert again.period == pytest.approx(van_der_pol.period, rel=1e-7)


def test_the_middle_of_a_symmetric_cycle_is_zero(van_der_pol):
    """Not rounding: a symmetry maps the plane x = 0 to itself, and no other."""
    assert 0.0 in [plane.level for plane in poincare_section._planes(van_der_pol)]


# vanishing.py, sequences.py


def test_a_phase_that_does_not_shrink_vanishes_nowhere(sticking):
    assert vanishing.vanishing_soon(*sticking, "belt", OPTIONS) is None  # SOON


def test_a_shrinking_that_does_not_converge_is_given_up(sticking, monkeypatch):
    """SLOWEST: else it would be tried in ever smaller steps for ever.  Patched: Newton's method fails."""
    t, u, setting = unknowns_of(sticking[0])
    failing = Solution(u, 0.0, Status.NOT_CONVERGED, 0, 1.0, None, "newton")
    monkeypatch.setattr(vanishing, "newton", lambda *args, **how: failing)
    assert vanishing._shrunk(t, u, setting, 1, 1e-10) is None


def test_a_long_phase_is_none_that_may_vanish(sticking):
    short = sticking[0]
    assert short.arcs[1].duration < 0.5 * short.arcs[0].duration
    assert next(sequences.without(short.problem.asked(), unknowns_of(short)))[0] == 1
    assert other_start.may_vanish([arc.duration for arc in short.arcs]) == 1
    assert [other_start.may_vanish(durations) for durations in ([1.0], [1.0, 0.6], [0.4, 1.0])] == [None, None, 0]
    for first in range(3):
        turned = other_start.rotated(short.problem.asked(), unknowns_of(short), first) if first else unknowns_of(short)
        assert (first + other_start.strongest(turned)) % 3 == 0


def test_a_motion_that_comes_back_is_the_cycle():
    orbit = next(belt.cycles()).orbit
    again = simulated_phases.marched(orbit.problem.asked(), unknowns_of(orbit))
    assert orbit.signature in [found[0].cycle.signature for found in again] and len(again) == 2


def test_an_event_that_is_zero_by_rounding_is_not_crossed():
    orbit = next(belt.cycles()).orbit
    posed, mode = orbit.problem.asked(), "slip"
    p = orbit.problem.vector()
    speed = p[list(orbit.problem.names).index("belt")]
    for above, crossed in ((3e-16, False), (1e-6, True)):  # EVENT_AT_ZERO
        v = np.array([speed, speed * (1 + above), -0.5, -1.0])
        found = sequences._crossing(posed, mode, np.linspace(0, 1, 4), np.array([np.zeros(4), v]), -1.0, p)
        assert (found is not None) is crossed
