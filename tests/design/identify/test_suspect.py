"""A frequency far from the model's: what the record says of its cause, on records made with each."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import one_json, run

from casahunt import Drive, Friction, InputError, Pid, Record, Servo, Status, find_orbit, identify, simulate_sampled
from casahunt.design.identify.identify import _what_else
from casahunt.design.identify.suitable import data_of, suitable
from casahunt.design.identify.suspect import suspicion
from casahunt.design.record.measure import measure
from casahunt.design.record.waveform import swings_of
from casahunt.servo.servo import flatten
from scripts.peers.hunting_record import measured, positions

AS_BUILT = Servo(
    inertia=0.012, motor_gain=4.2, controller=Pid(kp=1, ki=8, kd=0.05),
    friction=Friction(static=0.40, coulomb=0.30, stribeck_velocity=0.05, viscous=0.02),
)  # fmt: skip
GAIN = 0.04


def written(path, record):
    np.savetxt(path, np.column_stack([record.times, record.position]), delimiter=",", header="t,pos", comments="")
    return path


def sampled(servo, gain, drive, time, step, noise=0.0):
    """The record of a drive as built: what its encoder reads, or with noise."""
    motion = simulate_sampled(servo, gain, drive, time=time)
    t = np.arange(time / 4, time, step)
    x = np.interp(t, motion.times, motion.states[0]) + 1.0
    return Record(t, measured(x, noise, drive.encoder, 0.0, np.random.default_rng(1)), "made")


def of(servo, gain, record, **how):
    seen, orbit = measure(record), find_orbit(servo, "switch", gain)
    step = float(np.median(np.diff(record.times)))
    return suspicion(orbit, seen.period, seen.amplitude, seen.quantum, step, swings_of(seen.shape, seen.amplitude),
                     lambda: identify([record], servo, gain, advise=False, **how))  # fmt: skip


def sets(servo):
    return [word for key, value in flatten(servo).items() for word in ("--set", f"{key}={value!r}")]


@pytest.mark.slow
def test_steps_of_an_encoder(capsys, tmp_path):
    """The drive of docs/howto/as_built.md: 0.209 Hz where the continuous loop has 0.401."""
    record = sampled(AS_BUILT, 1.0, Drive(sample_time=1e-3, encoder=2000), 60.0, 0.01)
    said = of(AS_BUILT, 1.0, record)
    assert said.startswith("the frequency is 0.522 times") and "0.4009 Hz: suspect the encoder" in said
    assert "the amplitude is 6.5" in said
    path = written(tmp_path / "record.csv", record)
    servo = tmp_path / "servo.toml"
    servo.write_text("[servo]\ninertia = 0.012\nmotor_gain = 4.2\n[controller]\nkp = 1\nki = 8\nkd = 0.05\n[friction]\n"
                     "static = 0.4\ncoulomb = 0.3\nstribeck_velocity = 0.05\nviscous = 0.02\n")  # fmt: skip
    code, out, _ = run(capsys, "record", path, servo, "--gain", 1, "--quiet", "--json")
    assert one_json(out)["suspect"] == said
    assert "suspect the encoder" in _what_else(data_of(record, suitable(record), 1.0))
    with pytest.raises(InputError, match="suspect the encoder"):  # and what a fit leaves is not taken for noise
        identify([record], AS_BUILT, 1.0, advise=False)


@pytest.mark.parametrize(("time", "angle", "quantum", "says"), [
    (1e3, 1.0, 0.0, "the times look like ms: --time-unit ms"),
    (1.0, 180 / np.pi, 0.0, "the positions look like deg: --position-unit deg"),
    (1.0, 0.5 / np.pi, 0.0, "the positions look like rev: --position-unit rev"),
    (1.0, 1304.0, 1.0, "the positions look like counts: --position-unit"),
    (0.98, 1.2, 0.0, ""),
])  # fmt: skip
def test_a_unit_is_known_by_its_factor(time, angle, quantum, says):
    orbit = find_orbit(Servo(), "switch", GAIN)
    period, amplitude = 1.05 * time * orbit.period, 0.9 * angle * orbit.amplitude
    said = suspicion(orbit, period, amplitude, quantum, 0.01 * period, 2, lambda: pytest.fail("fitted"))
    assert said.startswith(says) and bool(said) is bool(says)


SMALL = Servo(
    inertia=0.0042, motor_gain=1.0, controller=Pid(kp=6, ki=25, kd=0.18),
    friction=Friction(static=0.28, coulomb=0.19, stribeck_velocity=0.06, viscous=0.015),
)  # fmt: skip


@pytest.mark.parametrize(("factor", "says"), [(180 / np.pi, "the positions look like deg"), (1.0, "the frequency is ")])
@pytest.mark.parametrize("changed", [
    {"static": 0.33}, {"static": 0.24}, {"coulomb": 0.23}, {"static": 0.36, "coulomb": 0.25, "stribeck_velocity": 0.08},
])  # fmt: skip
def test_a_unit_is_known_with_a_friction_that_is_not(changed, factor, says):
    """Friction that is off by a third moves amplitude and period by up to a factor of 2, to and fro; degrees are 57."""

    def fit():
        raise InputError("does not fit")

    made = find_orbit(SMALL, "switch", 1.0)
    given = find_orbit(SMALL.replace(**{f"friction.{name}": value for name, value in changed.items()}), "switch", 1.0)
    said = suspicion(given, made.period, factor * made.amplitude, 0.0, 0.004, 2, fit)
    assert said.startswith(says) or (factor == 1 and not said)


def test_a_unit_is_known_with_a_gain_that_is_not(capsys, tmp_path):
    """Of a record in degrees at another gain the frequency is about right, and nothing was said."""
    made = find_orbit(SMALL, "switch", 1.0)
    t = np.arange(0.0, 6 * made.period, made.period / 200)
    record = Record(t, np.degrees(positions(SMALL, "switch", 1.0, made.amplitude, t)), "made")
    path = written(tmp_path / "record.csv", record)
    code, out, _ = run(capsys, "record", path, "--gain", 1.3, *sets(SMALL), "--quiet", "--json")
    assert code == 0 and one_json(out)["suspect"] == "the positions look like deg: --position-unit deg"


@pytest.mark.parametrize("explained", [True, False])
def test_few_counts_are_suspected_beside_the_friction_that_explains_the_record(explained):
    """Rounding of the file alone: a fit that explains the record names its friction first."""
    orbit = find_orbit(Servo(), "switch", GAIN)
    fit = SimpleNamespace(status=Status.CONVERGED, judgement=SimpleNamespace(explained=explained),
                          intervals={"friction.static": (0.4, 0.45)}, values={"friction.static": 0.42})  # fmt: skip
    said = suspicion(orbit, 2 * orbit.period, orbit.amplitude, orbit.amplitude / 8, 0.01, 2, lambda: fit)
    friction, encoder = said.find("friction.static, 0.42 N m, not 0.53"), said.find("the encoder, of whose steps")
    assert encoder > 0 and (0 < friction < encoder if explained else friction == -1)


def test_a_factor_of_one_of_two_is_no_unit():
    """A period a thousand times as long, with another amplitude, is another servo; so is one 57 times as long."""
    orbit = find_orbit(Servo(), "switch", GAIN)

    def fit():
        raise InputError("does not fit")

    for longer, larger in ((1e3, 3.0), (180 / np.pi, 1.0)):
        said = suspicion(orbit, longer * orbit.period, larger * orbit.amplitude, 0.0, 1.0, 2, fit)
        assert said.startswith("the frequency is")


@pytest.mark.slow
def test_a_pattern_of_an_encoder_whose_steps_are_not_seen():
    """The same drive, its position measured apart from its encoder: 4 swings in a period, as its verdict says."""
    motion = simulate_sampled(AS_BUILT, 1.0, Drive(sample_time=1e-3, encoder=2000), time=60.0)
    t = np.arange(15.0, 60.0, 0.01)
    record = Record(t, np.interp(t, motion.times, motion.states[0]) + 1.0, "made")
    seen = measure(record)
    assert swings_of(seen.shape, seen.amplitude) == motion.verdict.pattern == 4 and seen.quantum == 0
    said = of(AS_BUILT, 1.0, record)
    mean = float(re.match(r"to and fro it takes (\S+) s in the mean, about as predicted, but", said)[1])
    assert mean == pytest.approx(motion.verdict.mean_period, rel=1e-3)  # a tenth of its samples' distance
    assert "repeats only after 4 swings" in said and "suspect the encoder" in said
    with pytest.raises(InputError, match="it repeats only after 4 swings") as refusal:  # and no gain that would fit
        identify([record], AS_BUILT, 1.0, advise=False)
    assert "times that gain" not in str(refusal.value)


def test_another_friction(capsys, tmp_path):
    """Made by another integrator with a third more static friction than the servo that is given."""
    other = Servo().replace(**{"friction.static": 0.53 * 1.3})
    orbit, rng = find_orbit(other, "switch", GAIN), np.random.default_rng(2)
    t = np.arange(0.0, 8 * orbit.period, orbit.period / 300)
    x = positions(other, "switch", GAIN, orbit.amplitude, t)
    record = Record(t[450:], measured(x[450:], 0.01 * orbit.amplitude, 0.0, 0.0, rng), "made")
    said = of(Servo(), GAIN, record, free=["friction.static"])
    assert "suspect friction.static, 0.689 N m, not 0.53" in said and said.endswith("switch model explains the record")
    path = written(tmp_path / "record.csv", record)
    code, out, _ = run(capsys, "identify", path, "--gain", GAIN, "--free", "friction.static", "--quiet", "--json")
    assert code == 0 and one_json(out)["suspect"] == said


@pytest.mark.slow
def test_a_delay_that_no_friction_explains():
    record = sampled(Servo(), GAIN, Drive(sample_time=5e-3, delay=0.1), 120.0, 0.01, noise=1e-3)
    said = of(Servo(), GAIN, record)
    assert "suspect a filter or a delay in the loop, or its sampling: no friction was found" in said
    assert "samples are" not in said


def test_coarse_samples_are_told():
    record = sampled(Servo(), GAIN, Drive(sample_time=0.1), 150.0, 0.1, noise=1e-3)
    orbit, seen = find_orbit(Servo(), "switch", GAIN), measure(record)

    def refused():
        raise InputError("none")

    said = suspicion(orbit, seen.period, seen.amplitude, seen.quantum, 0.1, 2, refused)
    assert "samples are 0.1 s apart, 0.7" in said


def test_nothing_is_suspected_where_the_frequency_is_about_right(capsys, tmp_path):
    orbit = find_orbit(Servo(), "switch", GAIN)
    assert suspicion(orbit, 0.95 * orbit.period, 0.05, 0.04, 0.01, 2, lambda: 1 / 0) == ""
    t = np.arange(0.0, 6 * orbit.period, orbit.period / 200)
    path = written(tmp_path / "record.csv", Record(t, positions(Servo(), "switch", GAIN, orbit.amplitude, t), "made"))
    code, out, _ = run(capsys, "record", path, "--gain", GAIN, "--quiet", "--json")
    assert code == 0 and one_json(out)["suspect"] is None
