"""The states of a cycle at given times and their derivatives: against differences of cycles, and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import Servo, find_orbit
from casahunt.errors import InputError
from casahunt.hybrid.examples import ball, belt
from casahunt.orbits import Options, find_cycle, refined, state_sensitivity
from casahunt.servo.parts import INTEGRATOR, PID_BY_TIMES, SWITCH, TWO_MASSES, Loop
from casahunt.servo.parts.verbs import loop_cycle

FINE = Options(tol=1e-11)
STEP = 1e-5
"""Of a central difference, relative: its error is of order STEP^2 = 1e-10, that of the cycles over it 1e-6."""


def test_a_block_on_a_belt_moves_as_its_neighbours_do():
    orbit = find_cycle(belt, "slip", x=0.0, v=0.0, options=FINE)
    times = np.linspace(-0.8, 2.4, 97) * orbit.period
    found = state_sensitivity(orbit, times, ["belt", "static"])
    for i, name in enumerate(found.names):
        h = STEP * orbit.parameters[name]
        near = []
        for moved in (orbit.parameters[name] + h, orbit.parameters[name] - h):
            other = replace(belt, parameters=belt.parameters | {name: moved})
            near.append(find_cycle(other, "slip", x=0.0, v=0.0, options=FINE))
        ends = [np.concatenate([[0.0], np.cumsum([a.duration for a in o.arcs])]) for o in (orbit, *near)]
        away = [np.abs(times[:, None] % o.period - e).min(axis=1) for o, e in zip((orbit, *near), ends, strict=True)]
        inside = np.min(away, axis=0) > 0.01
        difference = np.subtract(*(state_sensitivity(o, times).states for o in near)) / (2 * h)
        assert inside.sum() > 80
        assert found.derivatives[i][:, inside] == pytest.approx(difference[:, inside], rel=1e-5, abs=1e-5)
        assert found.period_derivatives[i] == pytest.approx((near[0].period - near[1].period) / (2 * h), rel=1e-6)


def test_a_parameter_that_is_zero_moves_it_too():
    """Viscous friction from none on: a difference to one side, whose error is of first order."""
    none = Servo().replace(**{"friction.viscous": 0.0})
    orbit = find_orbit(none, "switch", 0.1, options=FINE)
    other = refined(orbit, FINE, at={"friction.viscous": 1e-6})
    found = state_sensitivity(orbit, [1.0, 3.0], ["friction.viscous"])
    assert found.period_derivatives[0] == pytest.approx((other.period - orbit.period) / 1e-6, rel=1e-3)
    assert np.isfinite(found.derivatives).all()


def test_half_a_cycle_is_continued_by_its_image():
    orbit = find_orbit(Servo(), "switch", 0.1, options=Options(tol=1e-9))
    t, states = orbit.sample(16)
    found = state_sensitivity(orbit, t + 3 * orbit.period, ["gain"])
    inside = np.abs(found.rates[1]) < 1e3
    assert found.states[:, inside] == pytest.approx(states[:, inside], abs=1e-7)
    half = state_sensitivity(orbit, t + orbit.period / 2, ["gain"])
    assert half.states == pytest.approx(-found.states, abs=1e-7)


def test_a_whole_cycle_is_its_half_and_the_image():
    """Two closed forms that do not follow each other, beside collocated phases."""
    half, whole = (find_orbit(Servo(), "switch", 0.1, options=Options(tol=1e-9, half=each)) for each in (True, False))
    times = np.linspace(-1.3, 2.4, 200) * half.period
    found, known = (state_sensitivity(orbit, times, ["gain", "friction.static"]) for orbit in (whole, half))
    assert len(whole.arcs) == 2 * len(half.arcs)
    assert found.states == pytest.approx(known.states, abs=1e-9)
    assert found.period_derivatives == pytest.approx(known.period_derivatives, rel=1e-8)
    inside = np.abs(found.rates[1] - known.rates[1]) < 1e-6
    assert inside.mean() > 0.9
    assert found.derivatives[..., inside] == pytest.approx(known.derivatives[..., inside], rel=1e-6, abs=1e-6)


def test_a_jump_and_a_forcing_go_round_with_it():
    """The ball that bounces once a turn of the table: x = table's height + v t - g t^2/2, T = 2 pi/omega whatever a."""
    orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True, options=FINE)
    times = np.linspace(0.05, 3.95, 40) * orbit.period
    found = state_sensitivity(orbit, times, ["a", "g"])
    fall = times % orbit.period
    first = state_sensitivity(orbit, [1e-9], ["a"]).states[:, 0]
    g = orbit.parameters["g"]
    assert found.states[0] == pytest.approx(first[0] + first[1] * fall - g * fall**2 / 2, abs=1e-7)
    assert found.states[1] == pytest.approx(first[1] - g * fall, abs=1e-7)
    assert found.period_derivatives == pytest.approx([0.0, 0.0], abs=1e-9)
    # It leaves with v = g T/2, which a does not move.
    assert found.derivatives[0, 1] == pytest.approx(np.zeros(40), abs=1e-8)
    assert found.derivatives[1, 1] == pytest.approx(orbit.period / 2 - fall, abs=1e-8)


def test_an_unknown_parameter_is_refused():
    orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    with pytest.raises(InputError, match="parameter"):
        state_sensitivity(orbit, [0.0], ["speed"])


def test_an_orbit_goes_along_where_a_parameter_changes():
    """Against the cycle that a motion at the new parameter settles on."""
    orbit = find_cycle(belt, "slip", x=0.0, v=0.0, options=FINE)
    other = replace(belt, parameters=belt.parameters | {"belt": 0.21})
    settled = find_cycle(other, "slip", x=0.0, v=0.0, options=FINE)
    moved = refined(orbit, FINE, at={"belt": 0.21})
    assert moved.period == pytest.approx(settled.period, rel=2e-11) and moved.parameters["belt"] == 0.21
    with pytest.raises(InputError):
        refined(orbit, FINE, at={"speed": 0.21})


def test_and_where_it_changes_by_much():
    """A third of the speed, twice the period: Newton's method starts from where the derivatives lead."""
    orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    slow = replace(belt, parameters=belt.parameters | {"belt": 0.06})
    moved = refined(orbit, Options(), at={"belt": 0.06})
    assert moved.period == pytest.approx(find_cycle(slow, "slip", x=0.0, v=0.0).period, rel=1e-6) and moved.period > 20


def test_each_time_by_itself_is_that_of_all():
    """Of two masses slip and stick are two fields, in one of which a time does not lie."""
    cycle = loop_cycle(Loop((TWO_MASSES, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.1, "shaft_damping": 0.3}))
    times = np.linspace(0.0, cycle.period, 9)
    every = state_sensitivity(cycle, times, ["static"])
    for k, t in enumerate(times):
        one = state_sensitivity(cycle, [t], ["static"])
        assert one.states[:, 0] == pytest.approx(every.states[:, k], rel=1e-12, abs=1e-12)
        assert one.derivatives[0, :, 0] == pytest.approx(every.derivatives[0, :, k], rel=1e-9, abs=1e-9)
