"""Where a fit starts: the friction of a swing of servos whose friction is known; and records that nothing fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import Options, Record, Servo, find_orbit, identify
from casahunt.design.identify import matched as matching
from casahunt.design.identify.fit import Data, Question
from casahunt.design.identify.matched import matched
from casahunt.design.identify.start import laid_over, lowest_of, scales_of, starts, trials
from casahunt.design.identify.suitable import data_of, suitable
from casahunt.orbits import state_sensitivity
from casahunt.servo.cold_start import quickly_at
from casahunt.servo.servo import flatten
from scripts.identify import Made


def swing_of(servo: Servo, model: str, gain: float) -> Data:
    """What a record of a servo's cycle says of amplitude and period."""
    orbit = find_orbit(servo, model, gain)
    nothing = np.zeros(1)
    return Data(nothing, nothing, gain, orbit.period, 1e-3, orbit.amplitude, 0.0, 0.0, nothing, "swing")


@pytest.mark.parametrize("phase", [0.0, 0.3217, 0.9999])
def test_a_cycle_is_laid_over_a_record_to_a_part_of_its_slip(phase):
    """Which lasts half a thousandth of the period: beside it the deviance has no slope that leads there."""
    servo, gain = Servo().replace(**{
        "servo.inertia": 0.0281, "servo.motor_gain": 3.56, "controller.lead_time": 0.0847,
        "controller.integral_time": 0.854, "friction.static": 3.626, "friction.coulomb": 3.548,
        "friction.stribeck_velocity": 0.0077, "friction.viscous": 0.001,
    }), 5.28  # fmt: skip
    orbit = find_orbit(servo, "switch", gain)
    assert orbit.arcs[0].duration < 1e-3 * orbit.period
    times = np.arange(-3.0, 3.0, 1 / 700.37) * orbit.period
    x = state_sensitivity(orbit, times - phase * orbit.period).states[0] + 0.3 * orbit.amplitude
    data = replace(swing_of(servo, "switch", gain), times=times, position=x)
    tau, b, rest = laid_over(orbit, data)
    assert abs((tau - phase + 0.5) % 1 - 0.5) < 2e-4
    assert b == pytest.approx(0.3, abs=0.01) and rest < 0.1


@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize("factors", [(1.4, 0.6), (0.6, 0.1), (2.0, 1.9), (1.0, 1.0)])
def test_a_swing_tells_static_and_coulomb_friction(model, factors):
    """From values that are far off, and hunt with no gain, hunt elsewhere, or are right."""
    true = Servo().replace(**{"friction.static": 0.5, "friction.coulomb": 0.41})
    wrong = true.replace(**{"friction.static": 0.5 * factors[0], "friction.coulomb": 0.41 * factors[1]})
    found = matched(wrong, model, swing_of(true, model, 0.1))
    assert found is not None
    assert found.friction.static == pytest.approx(0.5, rel=0.01)
    assert found.friction.coulomb == pytest.approx(0.41, rel=0.01)


@pytest.mark.parametrize("period", [0.01, 0.5])
def test_a_swing_that_no_friction_gives_is_not_found(period):
    """A period so short is that of no servo with this inertia."""
    assert matched(Servo(), "switch", replace(swing_of(Servo(), "switch", 0.1), period=period)) is None


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_swing_without_slopes_is_taken_as_it_is(model, monkeypatch):
    """Where the swings beside it do not come across: no division by nothing."""
    data, far = swing_of(Servo(), "switch", 0.1), Servo().replace(**{"friction.coulomb": 0.45})
    whole = matching._swing

    def alone(servo, kind, data, u):
        return whole(servo, kind, data, u) if np.allclose(u, found.u, rtol=1e-9) else None

    found = whole(far, "switch", data, np.log([0.08, 0.53]))
    monkeypatch.setattr(matching, "_swing", alone)
    assert matching._closer(far, model, data, found) is not None


def question_of(servo: Servo, record: Record, free: tuple[str, ...]) -> Question:
    data = data_of(record, suitable(record), 0.1)
    scales, lowest = scales_of(data, servo, free), lowest_of(servo, free)
    return Question((data,), servo, "switch", free, Options(), scales, lowest)


@pytest.fixture(scope="module")
def record() -> Record:
    """Of the servo of Table 1 at gain 0.1, clean."""
    orbit = find_orbit(Servo(), "switch", 0.1)
    times = np.arange(0.0, 5 * orbit.period, 0.02)
    t, states = orbit.sample(400)
    return Record(times, np.interp(times % orbit.period, t, states[0]))


def test_one_friction_that_does_not_go_with_the_other_leaves_the_stated_one(record):
    """The static friction of the record is less than the Coulomb friction that is stated, and held."""
    stated = Servo().replace(**{"friction.static": 0.65, "friction.coulomb": 0.54})
    (z, *_) = starts(question_of(stated, record, ("friction.static",)))
    assert question_of(stated, record, ("friction.static",)).values(z)["friction.static"] == pytest.approx(0.65)


def test_viscous_friction_is_tried_by_the_motor_gain_that_is_tried(record):
    """A tenth of all friction, which goes with the motor gain as all torque does."""
    stated = Servo().replace(**{"friction.viscous": 0.0})
    tried = list(trials(question_of(stated, record, ("friction.viscous", "servo.motor_gain"))))
    shares = {round(servo.friction.viscous / servo.motor_gain, 12) for servo in tried}
    assert len(tried) == 9 and len(shares) == 1


def test_a_motion_from_where_the_record_sticks_finds_what_a_typical_one_does_not():
    """Servo 81 of seed 7: its cycle sticks far inside where most do, and motions from there come to rest."""
    made = Made(81, 7, "switch", (2000.0, 20000.0))
    assert quickly_at(made.servo, "switch", made.gain, options=Options()) is None
    found = quickly_at(made.servo, "switch", made.gain, options=Options(), start=1.2e-4)
    true = find_orbit(made.servo, "switch", made.gain)
    assert found is not None and found.period == pytest.approx(true.period, rel=1e-6)


@pytest.mark.parametrize(
    "seed, number, model",
    [(7, 15, "switch"), *(pytest.param(*each, marks=pytest.mark.slow) for each in (
        (7, 63, "lugre"), (13, 46, "lugre"), (7, 2, "switch"), (7, 60, "lugre"), (7, 76, "switch"),
    ))],
)  # fmt: skip
def test_its_own_model_explains_a_record(seed, number, model):
    """That sticks for a part in two hundred of a period, or hardly moves, or comes to its cycle slowly: all refused."""
    made = Made(number, seed, model, (2000.0, 20000.0))
    found = identify([made.record], made.starts[0], made.gain, model, advise=False)
    assert found.judgement.explained
    for name in ("friction.static", "friction.coulomb"):
        assert found.values[name] == pytest.approx(flatten(made.servo)[name], rel=0.05), name
