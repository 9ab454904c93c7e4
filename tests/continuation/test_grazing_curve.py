"""Cycles that contact an event, in two parameters, against a closed form and an integrator with events."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from casahunt import InputError, NoOrbit
from casahunt.continuation import follow, grazing, special_curve
from casahunt.continuation.grazing_contact import Loose, contacts
from casahunt.continuation.special_points import SpecialPoint
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import Options, find_cycle
from problems import belt, impact_oscillator
from problems.fixed_sequence import FixedSequence

TIGHT = Options(tol=1e-9)


def amplitude(w):
    """A at which the linear oscillator without impacts just reaches d = 1, and its derivative by w."""
    A = np.hypot(1 - w**2, 0.1 * w)
    return A, (-2 * w * (1 - w**2) + 0.01 * w) / A


@pytest.fixture(scope="module")
def resting():
    """A cycle that keeps clear of the stop."""
    return find_cycle(impact_oscillator.SYSTEM, parameters={"A": 0.08}, x=0.0, v=0.0)


@pytest.fixture(scope="module")
def touching(resting):
    return grazing(resting, "A", "impact", to=0.2, options=TIGHT)


def test_a_grazing_is_found_from_a_cycle_that_keeps_clear(touching):
    assert touching.kind == "grazing" and "'impact' is grazed" in touching.meaning
    orbit = touching.orbit
    assert orbit.problem.value("A") == pytest.approx(0.1, abs=1e-10)
    assert orbit.extrema("x").high.value == pytest.approx(1.0, abs=1e-9)
    assert not isinstance(orbit.problem, Loose)


def assert_grazes(curve, to):
    A, w = curve.values.T
    exact, slope = amplitude(w)
    assert curve.kind == "grazing" and curve.complete and w[-1] == to
    assert np.all(abs(A - exact) < 1e-8)
    np.testing.assert_allclose(curve.slopes, slope, rtol=1e-4, atol=1e-5)
    assert all(type(orbit.problem) is type(curve.orbits[0].problem) for orbit in curve.orbits)


@pytest.mark.parametrize("to", [0.5, pytest.param(1.5, marks=pytest.mark.slow)])
def test_the_grazing_curve_of_the_impact_oscillator(touching, to):
    """From the side that keeps clear; 1 s for about 20 cycles."""
    curve = special_curve(touching, "A", "w", to=to, options=TIGHT)
    assert_grazes(curve, to)
    assert all(orbit.extrema("x").high.value == pytest.approx(1.0, abs=1e-8) for orbit in curve.orbits[::4])


@pytest.mark.slow
@pytest.mark.parametrize("to", [0.5, 1.5])
def test_the_same_curve_from_impacts_that_have_lost_their_speed(to):
    """A branch locates the grazing, from the side of the impacts; 0.4 s for 12 cycles, after 4 s for the branch."""
    branch = follow(find_cycle(impact_oscillator.SYSTEM, x=0.0, v=0.0), "A", to=0.095)
    (special,) = (special for special in branch.special if special.kind == "grazing")
    curve = special_curve(special, "A", "w", to=to, options=TIGHT)
    assert_grazes(curve, to)
    assert all(abs(orbit.arcs[-1].end[1]) < 1e-8 for orbit in curve.orbits)


def two_stops(event: bool) -> System:
    """A stop at x = 1 and another at x = -b, or only a mode that does not hold beyond."""
    (free,) = impact_oscillator.SYSTEM.modes
    lower = Event("knock", lambda x, p: x.x + p.b, -1, to="free", reset=lambda x, p: {"v": -p.e * x.v})
    ends, holds = ((*free.ends, lower), None) if event else (free.ends, lambda x, p: (p.d - x.x) * (x.x + p.b))
    parameters = {"A": 0.08, "b": 1.4, "k": 1.0, "c": 0.1, "w": 1.0, "d": 1.0, "e": 0.8}
    mode = Mode("free", field=free.field, ends=ends, holds=holds)
    return System("two stops", ("x", "v"), parameters, (mode,), forcing_period=lambda p: 2 * ca.pi / p.w)


@pytest.mark.slow
@pytest.mark.parametrize("event, words, off", [(True, "'knock'", 1e-4), (False, "no motion of the system", 2e-3)])
def test_a_grazing_curve_ends_where_another_event_is_touched(event, words, off):
    """The cycle that grazes the upper stop reaches -1: the lower one is in its way from b = 1 on.

    Where the mode does not hold there, the cycles beside it, 1e-3 away, must be motions too.
    """
    orbit = find_cycle(two_stops(event), x=0.0, v=0.0)
    special = grazing(orbit, "A", "impact", to=0.2, options=TIGHT)
    curve = special_curve(special, "A", "b", to=0.8, options=TIGHT)
    assert not curve.complete and words in curve.ended
    assert curve.values[-1, 1] == pytest.approx(1.0, abs=off)
    np.testing.assert_allclose(curve.values[:, 0], 0.1, atol=1e-9)


@pytest.mark.slow
def test_a_cycle_that_touches_is_judged_by_the_rules_of_the_system():
    """Nothing is asked of the phase that grazes while its root is sought, but of the cycle that is reported."""
    branch = follow(find_cycle(two_stops(False), parameters={"A": 1.0, "b": 3.0}, x=0.0, v=0.0), "A", to=0.095)
    (special,) = (special for special in branch.special if special.kind == "grazing")
    curve = special_curve(special, "A", "b", to=0.8, options=TIGHT)
    assert not curve.complete and "grazes 'impact' is no motion of the system" in curve.ended
    assert curve.values[-1, 1] == pytest.approx(1.0, abs=1e-4)


def test_what_touches_nothing_is_refused(resting):
    with pytest.raises(NoOrbit, match="grazes 'impact' on the way"):
        grazing(resting, "A", "impact", to=0.09)
    with pytest.raises(InputError, match="event"):
        grazing(resting, "A", "knock", to=0.2)
    with pytest.raises(NoOrbit, match="grazes no event"):
        special_curve(SpecialPoint("grazing", resting, ""), "A", "w", to=1.5)
    posed = belt.cycles()
    orbit = next(posed).orbit
    fixed = FixedSequence(belt.CYCLE, belt.VALUES, followed="belt")
    with pytest.raises(InputError, match="only cycles of a user's system"):
        grazing(replace(orbit, problem=fixed), "belt", "catches up", to=1.0)


@pytest.mark.slow
def test_a_cycle_with_a_stop_on_one_side_is_not_symmetric(resting):
    """It keeps clear of the stop, and half of it is the other's mirror image; the stop is not.

    Half a cycle would go on as if there were none: where the other half passes it nothing is seen.
    """
    assert resting.repeats == 1
    branch = follow(resting, "A", to=0.11, back=0.05)
    assert branch.special[0].kind == "grazing" and branch.special[0].orbit.problem.value("A") < 0.1001
    assert contacts(resting)[0][0] == pytest.approx(0.2, rel=1e-8)


def damped_slip(x, p):
    return {"x": x.v, "v": 1 / (1 + 3 * (p.belt - x.v)) - x.x - p.damping * x.v}


DAMPED = System(
    "damped block on a belt", ("x", "v"), {"belt": 0.6, "damping": 0.5},
    (
        Mode("slip", field=damped_slip, holds=lambda x, p: 1 - x.v / p.belt,
             ends=(Event("catches up", lambda x, p: x.v / p.belt - 1, +1, to="stick"),)),
        Mode("stick", flow=lambda x, t, p: {"x": x.x + p.belt * t, "v": p.belt},
             holds=lambda x, p: 1 - x.x - p.damping * p.belt,
             ends=(Event("breaks away", lambda x, p: x.x + p.damping * p.belt - 1, +1, to="slip"),)),
    ),
)  # fmt: skip


def speed_missing(belt_speed, damping):
    """Largest speed of a slip that starts where the stick would end, less the belt's: zero where the cycle grazes."""

    def field(t, y):
        return [y[1], 1 / (1 + 3 * (belt_speed - y[1])) - y[0] - damping * y[1]]

    def largest(t, y):
        return field(t, y)[1]

    largest.direction, largest.terminal = -1, 2
    start = [1 - damping * belt_speed, belt_speed - 1e-15]
    found = solve_ivp(field, (0, 20), start, method="DOP853", rtol=1e-13, atol=1e-14, events=largest, max_step=0.05)
    return found.y_events[0][-1][1] - belt_speed


@pytest.mark.slow
def test_where_the_stick_vanishes():
    """Beyond it the block only slips, on an unstable cycle that grazes the belt's speed; 3 s for 8 cycles."""
    branch = follow(find_cycle(DAMPED, "slip", x=0.7, v=0.59), "belt", to=0.7, options=TIGHT)
    special = branch.special[-1]
    assert special.kind == "grazing"
    curve = special_curve(special, "belt", "damping", to=0.65, options=TIGHT)
    assert curve.complete
    for speed, damping in curve.values[::3]:
        truth = brentq(speed_missing, 0.99 * speed, 1.01 * speed, args=(damping,), xtol=1e-14)
        assert speed == pytest.approx(truth, abs=1e-9)
    further = special_curve(special, "belt", "damping", to=0.75, options=TIGHT)
    assert further.complete
    speed, damping = further.values[-1]
    truth = brentq(speed_missing, 0.99 * speed, 1.01 * speed, args=(damping,), xtol=1e-14)
    assert damping == 0.75 and speed == pytest.approx(truth, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("start", [("slip", 0.7, 0.59), ("stick", 0.0, 0.6)])
def test_a_first_phase_that_vanishes_is_no_fold(start):
    """The branch is the same wherever its cycle starts: with the stick first, ln T_1 would go on for ever."""
    mode, x, v = start
    branch = follow(find_cycle(DAMPED, mode, x=x, v=v), "belt", to=0.7, options=TIGHT)
    (special,) = branch.special
    truth = brentq(speed_missing, 0.665, 0.678, args=(0.5,), xtol=1e-14)
    assert special.kind == "grazing" and not branch.missed
    # Beyond it the block only slips, on an unstable cycle: the branch comes back with that.
    assert branch.end.kind == "range" and {arc.mode for arc in branch.orbits[-1].arcs} == {"slip"}
    assert branch.orbits[-1].stable is False and branch.values[-1] < truth
    assert special.orbit.problem.value("belt") == pytest.approx(truth, rel=1e-8)
