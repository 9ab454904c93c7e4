"""Friction from records that an integrator of another kind has made (scripts/peers/hunting_record.py)."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from casahunt import (
    Friction,
    InputError,
    NoOrbit,
    Pid,
    Record,
    Servo,
    cli,
    find_orbit,
    identify,
    load,
    load_uncertainty,
    pictures,
)
from casahunt.design.identify import fit, judgement
from casahunt.design.identify import identify as room
from casahunt.design.identify.identify import FREE
from casahunt.design.identify.intervals import Interval
from casahunt.design.identify.suitable import data_of, suitable
from casahunt.design.identify.transient import behind_a_transient, on_its_way
from casahunt.errors import Status
from casahunt.orbits import Options, refined
from casahunt.servo.servo import flatten
from casahunt.views.commands.identify import identified_lines
from scripts.peers.hunting_record import measured, positions

GAIN, PERIOD = 0.1, 11.36
TRUE = {"friction.static": 0.53, "friction.coulomb": 0.44, "friction.viscous": 0.1, "friction.stribeck_velocity": 0.02}
"""Table 1 of the report."""
WRONG_ONES = {
    "friction.static": 1.06, "friction.coulomb": 0.22, "friction.viscous": 0.05, "friction.stribeck_velocity": 0.04,
}  # fmt: skip
"""Each value by a factor of two."""
WRONG = Servo().replace(**WRONG_ONES)


def made(counts: float = 0.0, noise: float = 0.01, *, each: int = 500, whole: float = 6, model="switch") -> Record:
    """A record of the servo of Table 1 at GAIN; noise relative to the amplitude, 0.0177 rad."""
    rng = np.random.default_rng(3)
    times = np.arange(0.0, (whole + 1) * PERIOD, PERIOD / each)
    x = positions(Servo(), model, GAIN, 0.0177, times)
    later = times > PERIOD
    return Record(times[later], measured(x[later], noise * 0.0177, counts, 0.4, rng), "bench")


@pytest.fixture(scope="module")
def found():
    return identify([made()], WRONG, GAIN)


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("records") / "bench.csv"
    record = made(each=250)
    np.savetxt(path, np.column_stack([record.times, record.position]), delimiter=",", header="time_s,position_rad")
    return path


def test_true_values_lie_in_the_intervals(found):
    for name, value in TRUE.items():
        low, high = found.intervals[name]
        assert low < value < high, name
    assert found.intervals["friction.static"][1] < 1.03 * found.intervals["friction.static"][0]
    assert found.judgement.explained and 0.4 < found.judgement.misfit < 1.7
    assert found.noises[0].sigma == pytest.approx(0.01 * 0.0177, rel=0.05) and found.noises[0].quantum == 0
    assert found.bounded and found.values.keys() == set(FREE)


def test_the_cycle_of_a_fit_is_known_to_its_error(found):
    """Those on the way have none: the last one is computed to a tenth of the tolerance."""
    (orbit,) = found.orbits
    again = find_orbit(found.servo, "switch", GAIN, options=Options(tol=1e-10))
    assert 0 < orbit.error_estimate <= 1e-7
    assert orbit.amplitude == pytest.approx(again.amplitude, rel=1e-7)
    assert orbit.period == pytest.approx(again.period, rel=1e-7)


def test_no_interval_is_known_where_the_cycle_is_not(monkeypatch):
    def lost(orbit, how, *, at=None):
        if at is None:
            raise NoOrbit("the tolerance is not reached")
        return refined(orbit, how, at=at)

    record = made(each=250)
    free = ["friction.static", "friction.coulomb"]
    assert identify([record], Servo(), GAIN, free=free, advise=False).status.ok
    monkeypatch.setattr(room, "climb", lambda question, point, *args, **kwargs: point)
    monkeypatch.setattr(fit, "refined", lost)
    assert identify([record], Servo(), GAIN, free=free, advise=False).status is Status.FIT_NOT_CONVERGED


@pytest.mark.slow
def test_other_wrong_values_lead_to_the_same_optimum(found):
    other = {"friction.static": 0.3, "friction.coulomb": 0.25, "friction.viscous": 0.2,
             "friction.stribeck_velocity": 0.01}  # fmt: skip
    again = identify([made()], Servo().replace(**other), GAIN, advise=False)
    for name, value in found.values.items():
        low, high = found.intervals[name]
        assert abs(math.log(again.values[name] / value)) < 0.1 * math.log(high / low)


def test_counts_are_told_from_noise():
    """20000 counts a revolution, 56 of the amplitude, noise of half a count."""
    record = made(2e4)
    found = identify([record], WRONG, GAIN, advise=False)
    assert all(found.intervals[name][0] < value < found.intervals[name][1] for name, value in TRUE.items())
    assert found.noises[0].quantum == pytest.approx(2 * math.pi / 2e4, rel=1e-6)
    assert found.noises[0].sigma == pytest.approx(0.01 * 0.0177, rel=0.3)


def test_one_parameter_has_the_interval_of_least_squares():
    """Sensitivity by differences of cycles, all other parameters known: 1.96 sigma/|dx/dFs|, phase and offset free."""
    record = made()
    found = identify([record], Servo(), GAIN, free=["friction.static"], advise=False)
    low, high = found.intervals["friction.static"]
    data = data_of(record, suitable(record), GAIN)
    h, curves = 1e-5, []
    for value in (found.values["friction.static"] + h, found.values["friction.static"] - h):
        orbit = find_orbit(Servo().replace(**{"friction.static": value}), "switch", GAIN)
        t, states = orbit.sample(60)
        curves.append(np.interp((data.times - found.phases[0]) % orbit.period, t, states[0]))
        if value < found.values["friction.static"]:
            step = 1e-3
            moved = np.interp((data.times - found.phases[0] + step) % orbit.period, t, states[0])
            phase = (moved - curves[1]) / step
    J = np.column_stack([(curves[0] - curves[1]) / (2 * h), phase, np.ones(phase.size)])
    sigma = found.noises[0].sigma * math.sqrt(np.linalg.inv(J.T @ J)[0, 0])
    assert high - low == pytest.approx(2 * 1.96 * sigma, rel=0.1)
    assert low < TRUE["friction.static"] < high


def test_a_filtered_record_is_not_explained():
    """A low pass of 60 ms in the position, which the model knows nothing of."""
    record = made(noise=0.003)
    y, step = record.position.copy(), record.times[1] - record.times[0]
    for i in range(1, y.size):
        y[i] = y[i - 1] + (record.position[i] - y[i - 1]) * (1 - math.exp(-step / 0.06))
    found = identify([Record(record.times, y)], Servo(), GAIN, free=["friction.static", "friction.coulomb"],
                     advise=False)  # fmt: skip
    assert not found.judgement.explained and found.judgement.misfit > 5 and found.judgement.factor > 5


def test_what_a_record_cannot_tell_is_said():
    """Inertia, motor gain and all torques scale together: a common factor moves nothing."""
    names = ("servo.inertia", "servo.motor_gain", "friction.static", "friction.coulomb", "friction.viscous")
    found = identify([made(each=250)], Servo(), GAIN, free=names, advise=False)
    powers = min(found.untold, key=lambda each: max(each.values()) - min(each.values()))
    assert set(powers) == set(names) and all(power == pytest.approx(1.0, abs=0.05) for power in powers.values())
    assert not found.bounded


@pytest.mark.slow
def test_lugre_friction():
    """With what else the servo has known; with half the viscous friction and twice the velocity, nothing does."""
    record, free = made(each=300, whole=4, model="lugre"), ["friction.static", "friction.coulomb"]
    start = Servo().replace(**{name: value for name, value in WRONG_ONES.items() if name in free})
    found = identify([record], start, GAIN, "lugre", free=free, advise=False)
    assert found.model == "lugre" and found.judgement.explained and found.judgement.misfit < 1.7
    assert all(found.intervals[name][0] < TRUE[name] < found.intervals[name][1] for name in free)
    assert not identify([record], WRONG, GAIN, "lugre", free=free, advise=False).judgement.explained


@pytest.mark.slow
def test_several_records_at_several_gains():
    """Their common interval is narrower than that of either."""
    times, a = np.arange(0.0, 60.0, 0.03), find_orbit(Servo(), "switch", 0.05).amplitude
    x = positions(Servo(), "switch", 0.05, a, times)
    other = Record(times, measured(x, 0.01 * a, 0, -0.2, np.random.default_rng(6)))
    names = ["friction.static", "friction.coulomb"]
    both = identify([made(), other], Servo(), [GAIN, 0.05], free=names, advise=False)
    one = identify([made()], Servo(), GAIN, free=names, advise=False)
    for name in names:
        assert both.intervals[name][0] < TRUE[name] < both.intervals[name][1]
        assert np.ptp(both.intervals[name]) < np.ptp(one.intervals[name])


def test_the_further_record_has_a_gain_that_hunts(found):
    gain, information = found.further
    assert 0.04 < gain < 0.65 and information > 1
    assert find_orbit(found.servo, "switch", gain).period > 0


def test_a_higher_gain_for_a_further_record_is_one_at_which_the_ends_hunt_too(monkeypatch):
    """If static friction may be 0.46 N m, next to Coulomb friction, a gain near the fold of Table 1 shows nothing."""
    monkeypatch.setattr(judgement, "GAINS_BELOW", 0)
    monkeypatch.setattr(judgement, "LEAST_GAINED", -math.inf)

    def asked(low: float) -> float:
        ends = [Interval(low, 0.54)]
        monkeypatch.setattr(room, "further_gain", lambda *args: judgement.further_gain(*args[:3], ends))
        found = identify([made(each=250)], Servo(), GAIN, free=["friction.static"])
        return found.further[0] if found.further is not None else GAIN

    likely, sure = asked(0.52), asked(0.46)
    weak = Servo().replace(**{"friction.static": 0.46})
    with pytest.raises(NoOrbit):
        find_orbit(weak, "switch", likely)
    assert GAIN <= sure < likely and find_orbit(weak, "switch", sure).stable


@pytest.mark.slow
def test_a_record_that_begins_with_its_transient_is_fitted_behind_it():
    """A step of 1 rad, behind which a cycle of 0.009 rad is come to slowly: the servo is found all the same."""
    true = Friction(static=0.19, coulomb=0.15, stribeck_velocity=0.03, viscous=0.009)
    servo = Servo(inertia=0.0042, motor_gain=1.9, controller=Pid(kp=2.2, ki=14.0, kd=0.09), friction=true)
    times = np.arange(0.0, 40.0, 0.016)
    record = Record(times, positions(servo, "switch", 1.0, 1.0, times))
    start = servo.replace(**{"friction.static": 0.22, "friction.viscous": 0.004, "friction.stribeck_velocity": 0.02})
    found = identify([record], start, 1.0, advise=False)
    assert found.judgement.explained and found.left_out >= 0.5
    truth = flatten(servo)
    assert all(low < truth[name] < high for name, (low, high) in found.intervals.items())
    later = replace(found, left_out=0.75)
    assert any("left out: the first 75% of the record, in which" in text for text in identified_lines(later, ""))


def test_a_record_that_is_refused_and_still_on_its_way_says_so():
    """A fit that is refused of the whole and of its later half; of a record without a transient nothing is added."""

    def refused(records):
        raise InputError("it does not fit; are gain, servo and units right?")

    times = np.arange(0.0, 12.0, 0.01)
    steady, settling = np.sin(2 * np.pi * times), np.sin(2 * np.pi * times) * (1 + 0.05 * np.exp(-times / 3))
    assert on_its_way(Record(times, settling)) and not on_its_way(Record(times, steady))
    for position, said in ((settling, "still on the way to its cycle"), (steady, "units right")):
        with pytest.raises(InputError, match=said) as refusal:
            behind_a_transient([Record(times, position)], refused)
        assert ("--from" in str(refusal.value)) is (position is settling)


def test_no_further_record_is_asked_for_where_the_model_does_not_explain_this_one(monkeypatch):
    monkeypatch.setattr(judgement.Judgement, "explained", False)
    assert identify([made(each=250)], Servo(), GAIN, free=["friction.static"]).further is None


@pytest.mark.parametrize("more", [1.0, 3.0])
def test_nothing_is_suspected_of_what_a_transient_leaves(found, more):
    left = np.repeat([more * 1e-4, 1e-4], 300)
    other = replace(found, judgement=replace(found.judgement, fits=False), residuals=(left,))
    assert ("  suspect a filter" in list(identified_lines(other, "suspect a filter"))) is (more == 1.0)


def test_its_picture_has_the_residual(found):
    above, below = pictures.fitted_records(found, ax=Figure().subplots(2))
    rest = below.get_lines()[0].get_ydata()
    assert np.std(rest) == pytest.approx(found.noises[0].sigma, rel=0.1)


# Refused --------------------------------------------------------------------------------------------------------

T = np.arange(0.0, 80.0, 0.05)
SINE = 0.02 * np.sin(2 * np.pi * T / 10)
NOISE = 1e-4 * np.random.default_rng(0).standard_normal(T.size)
BAD = {
    "no whole period": (T[:480], SINE[:480] + NOISE[:480], "whole periods"),
    "drifting": (T, SINE + NOISE + 5e-4 * T, "drifts"),
    "at rest": (T, 0.3 + NOISE, "rest|no limit cycle"),
    "clipped": (T, np.clip(SINE + NOISE, -0.015, 1), "clipped"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_record_that_cannot_be_fitted_is_refused(capsys, tmp_path, kind):
    t, y, says = BAD[kind]
    np.savetxt(tmp_path / "bad.csv", np.column_stack([t, y]), delimiter=",")
    words = ["identify", str(tmp_path / "bad.csv"), "--gain", "0.1", "--out", str(tmp_path / "new"), "--quiet"]
    assert cli.main(words) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and any(word in err for word in says.split("|"))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("low", "high"), [(-2.0, 0.7), (-0.8, 0.8)])
@pytest.mark.slow
def test_counts_that_are_cut_off_are_told_by_the_model(low, high):
    """With few counts and samples in a slip the record alone does not tell them from a rest."""
    quantum, half = 2 * math.pi / 8000, 0.0177
    whole = made(8000.0, each=400)
    y = np.clip(whole.position, *(quantum * round((0.4 + part * half) / quantum) for part in (low, high)))
    suitable(Record(whole.times, y, "cut"))
    with pytest.raises(InputError, match=r"clipped at .* explains the others, and goes 0\.00\d+ rad beyond"):
        identify([Record(whole.times, y, "cut")], WRONG, GAIN, advise=False)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 10.0])
def test_a_gain_that_does_not_fit_is_refused(capsys, tmp_path, file, factor):
    """It is the gain, since another one explains the record; and it is the right one that is named."""
    words = ["--gain", str(GAIN * factor), "--out", str(tmp_path / "new"), "--plot", str(tmp_path / "new.png")]
    assert cli.main(["identify", str(file), *words, "--json", "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and f"gain = {GAIN * factor:g}: does not fit" in err
    at = float(err.partition("times that gain, ")[2].partition(" V/rad")[0])
    assert at == pytest.approx(GAIN, rel=0.06)  # two digits
    assert not (tmp_path / "new").exists() and not (tmp_path / "new.png").exists()


@pytest.mark.slow
def test_a_gain_far_from_all_that_fits_is_refused(capsys, file):
    """Two hundred times too small, beyond what is looked at: no other gain is named."""
    assert cli.main(["identify", str(file), "--gain", "0.0005", "--free", "friction.static", "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and "does not fit the switch servo at gain 0.0005" in err


@pytest.mark.slow
def test_without_inertia_a_record_does_not_tell_the_gain():
    """K -> c K, F -> c F, J -> c J leaves a motion as it is: exactly, so with J known too no fit can see it."""
    other = Servo().replace(**{name: 2 * value for name, value in TRUE.items() if "stribeck" not in name})
    other = other.replace(**{"servo.inertia": 2 * Servo().inertia})
    one, two = find_orbit(Servo(), "switch", GAIN), find_orbit(other, "switch", 2 * GAIN)
    assert two.period == pytest.approx(one.period, rel=1e-9) and two.amplitude == pytest.approx(one.amplitude, rel=1e-9)
    seen = identify([made()], other, 2 * GAIN, advise=False)
    assert seen.judgement.explained
    assert seen.values["friction.static"] == pytest.approx(2 * 0.53, rel=0.02)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--free", "friction.stiffness"], "the switch model has no such parameter"),
        (["--free", "friction.sticky"], "friction.sticky"),
        (["--free", "friction.static,friction.static"], "each once"),
        (["--gain", "0.2"], "gains: must be one, or one for each of the 1 records"),
        (["--skip", "x"], "skip = 'x'"),
    ],
)
def test_a_wrong_command_line_is_refused(capsys, file, words, says):
    assert cli.main(["identify", str(file), "--gain", "0.1", *words, "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and says in err


def test_the_command_writes_what_others_take(capsys, file, tmp_path):
    words = ["identify", str(file), "--gain", "0.1", "--free", "friction.static,friction.coulomb", "--json", "--quiet"]
    assert cli.main([*words, "--out", str(tmp_path / "out")]) == 0
    said = json.loads(capsys.readouterr().out)
    assert set(said["parameters"]) == {"friction.static", "friction.coulomb"} and said["explained"]
    for name, found in said["parameters"].items():
        assert found["low"] < TRUE[name] < found["high"] and found["low"] < found["value"] < found["high"]
    assert 0.3 < said["misfit"] < 2
    servo = load(tmp_path / "out" / "servo.toml")
    assert servo.friction.static == said["parameters"]["friction.static"]["value"]
    low, high = load_uncertainty(tmp_path / "out" / "friction.toml", servo).box(servo)
    assert low[0] == said["parameters"]["friction.static"]["low"]
    assert cli.main([*words[:-2], "--out", str(tmp_path / "out"), "--quiet"]) == 0  # over its own files
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80 and any("friction.static" in line for line in lines)
    with pytest.raises(InputError, match="friction"):
        identify([made(each=250)], Servo(), GAIN, free=["friction"])


@pytest.mark.slow
@pytest.mark.parametrize("stated", [2e-5, 0.02, 2.0])
def test_a_stribeck_velocity_that_is_stated_far_off_does_not_matter(stated):
    """Sought by what the record shows: down to a fiftieth of a value a hundred times too large it was not found, and
    the intervals of the others lay beside the truth."""
    found = identify([made()], Servo().replace(**{"friction.stribeck_velocity": stated}), GAIN, advise=False)
    assert found.judgement.explained
    for name, (low, high) in found.intervals.items():
        assert low <= flatten(Servo())[name] <= high, name
