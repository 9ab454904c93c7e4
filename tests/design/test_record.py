"""Records synthesised from computed cycles, resampled unevenly, with noise, drift and offset; and bad ones."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import InputError, Record, Servo, cli, find_orbit, measure, simulate
from casahunt.design.record.file import read_record
from casahunt.servo.parts import BY_DIRECTION, INERTIA, INTEGRATOR, PID_BY_GAINS, Loop
from casahunt.views.commands import record as record_command

KEYS = {
    "file", "columns", "kind", "reason", "periods", "amplitude", "amplitude_scatter", "amplitude_error", "frequency",
    "frequency_scatter", "frequency_error", "period", "period_scatter", "period_error", "mean_level", "drift", "noise",
    "quantum", "above", "missing", "left_out_before", "left_out_behind", "offset", "amplitudes", "period_lengths",
    "predicted", "prediction_failed", "wall_s",
}  # fmt: skip


def synthetic(
    cycle, *, periods=8.0, rate=50.0, noise=0.0, drift=0.0, offset=0.0, phase=0.3, factor=1.0, seed=0
) -> Record:
    """A record of `periods` periods with samples at random times; noise, drift per period and offset in amplitudes."""
    rng = np.random.default_rng(seed)
    T, A = cycle.period, cycle.amplitude
    times, states = cycle.sample(16)
    t = np.unique(rng.uniform(0, periods * T, round(rate * periods * T)))
    y = factor * np.interp((t + phase * T) % T, times, states[0])
    return Record(t, y + A * (offset + drift * t / T + noise * rng.standard_normal(t.size)))


@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize(
    ("how", "amplitude", "period"),
    [
        # Without noise what is left is the distance between samples: 20 ms in slips of 0.3 s.
        ({}, 3e-4, 3e-5),
        ({"noise": 0.01}, 2e-3, 3e-4),
        # Noise of 5 %: peaks are averages over thousands of samples, crossings lines through a dozen.
        ({"noise": 0.05, "drift": 0.05, "offset": 20.0}, 5e-3, 1e-3),
        ({"noise": 0.1, "drift": -0.2, "rate": 200.0}, 1e-2, 1e-3),
        ({"noise": 0.02, "rate": 10.0, "periods": 12}, 1e-2, 2e-3),
        ({"noise": 0.02, "periods": 4.2}, 5e-3, 1e-3),
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_what_was_put_in_comes_out(orbit, model, how, amplitude, period, seed):
    cycle = orbit(model, 0.04)
    record = synthetic(cycle, seed=seed, **how)
    found = measure(record)
    assert found.hunting and found.reason == ""
    assert found.periods.size in (math.floor(how.get("periods", 8)), math.floor(how.get("periods", 8)) - 1)
    assert found.amplitude == pytest.approx(cycle.amplitude, rel=amplitude)
    assert found.period == pytest.approx(cycle.period, rel=period)
    assert found.frequency * found.period == pytest.approx(1)
    assert found.amplitude_scatter < 0.02 * cycle.amplitude and found.period_scatter < 0.01 * cycle.period
    assert found.drift == pytest.approx(how.get("drift", 0.0) * cycle.amplitude / cycle.period, abs=1e-2 * 0.005)
    assert found.noise == pytest.approx(how.get("noise", 0.0) * cycle.amplitude, rel=0.2, abs=2e-3 * cycle.amplitude)
    assert found.above == pytest.approx(0.5, abs=0.01)


def test_changing_periods_are_averaged():
    """Periods and amplitudes that scatter: mean and standard deviation of what was put in."""
    rng = np.random.default_rng(5)
    lengths, sizes = 8 + 0.4 * rng.standard_normal(12), 0.06 * (1 + 0.05 * rng.standard_normal(12))
    edges = np.concatenate([[0], np.cumsum(lengths)])
    t = np.arange(0.75 * lengths[0], edges[-1], 0.01)  # as many upward crossings as downward ones
    i = np.searchsorted(edges, t, side="right") - 1
    y = sizes[i] * np.sin(2 * np.pi * (t - edges[i]) / lengths[i])
    found = measure(Record(t, y + 1))
    first, k = 1, found.periods.size
    assert found.hunting and found.rising and k == 10
    # The mean over a period that cuts two unequal waves is not zero: it moves the level, and a crossing with it.
    assert found.periods == pytest.approx(lengths[first : first + k], rel=2e-2)
    assert found.period == pytest.approx(np.mean(lengths[first : first + k]), rel=2e-3)
    assert found.period_scatter == pytest.approx(np.std(lengths[first : first + k], ddof=1), rel=0.1)
    assert found.amplitudes == pytest.approx(sizes[first : first + k], rel=3e-2)
    assert found.amplitude_scatter == pytest.approx(np.std(sizes[first : first + k], ddof=1), rel=0.2)


def test_asymmetry():
    """Three quarters of the period above, with peaks that are half as high as the valleys are deep."""
    t = np.linspace(0, 60, 6001)
    phase = (t / 7) % 1
    y = np.where(phase < 0.75, np.sin(np.pi * phase / 0.75), -2 * np.sin(np.pi * (phase - 0.75) / 0.25))
    found = measure(Record(t, 0.1 * y + 0.5))
    assert found.hunting
    assert found.amplitude == pytest.approx(0.15, rel=5e-3)
    assert found.period == pytest.approx(7, rel=1e-4)
    mean = 0.1 * (0.75 - 2 * 0.25) * 2 / np.pi
    assert found.mean_level == pytest.approx(0.5 + mean, rel=1e-3)
    lower = math.asin(mean / 0.1) / np.pi * 0.75  # phase at which the rising arc meets the level
    assert found.above == pytest.approx(0.75 - 2 * lower, abs=0.01)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_simulated_motion_is_a_record(orbit, model):
    cycle = orbit(model, 0.04)
    found = measure(simulate(Servo(), model, 0.04, time=80.0), start=20.0)
    assert found.hunting
    assert found.amplitude == pytest.approx(cycle.amplitude, rel=3e-4)
    assert found.period == pytest.approx(cycle.period, rel=3e-5)
    assert found.mean_level == pytest.approx(1.0, abs=1e-3 * cycle.amplitude)


# What is no limit cycle ------------------------------------------------------------------------------------

T = np.linspace(0, 100, 5001)
RNG = np.random.default_rng(3)
TURNS = np.cumsum(np.random.default_rng(0).uniform(1, 9, 60)) - 5


@pytest.mark.parametrize(
    ("position", "kind", "words"),
    [
        (np.zeros(T.size), "still", "does not oscillate"),
        (1 + 0.01 * T, "still", "does not oscillate"),
        (1 - np.exp(-T / 10), "still", "does not oscillate"),
        (0.01 * RNG.standard_normal(T.size) + np.exp(-T), "still", "does not oscillate"),
        # To and fro with periods anywhere from 1 to 9 s.
        (np.sin(2 * np.pi * np.interp(T, TURNS, np.arange(TURNS.size))), "irregular", "no shape repeats"),
        (np.exp(-T / 30) * np.sin(T), "decaying", "amplitude changes steadily"),
        (np.exp(-T / 1000) * np.sin(T) + 0.01 * RNG.standard_normal(T.size), "decaying", "amplitude changes steadily"),
        (np.exp(T / 40) * np.sin(T), "growing", "amplitude changes steadily"),
    ],
)
def test_no_limit_cycle(position, kind, words):
    found = measure(Record(T, position))
    assert (found.kind, found.hunting) == (kind, False)
    assert words in found.reason


@pytest.mark.parametrize("seed", range(5))
def test_a_random_walk_is_no_limit_cycle(seed):
    """It may go to and fro by chance, which is not for the seed to say."""
    found = measure(Record(T, np.cumsum(np.random.default_rng(seed).standard_normal(T.size))))
    assert not found.hunting and found.kind in ("still", "irregular")


def test_the_motion_of_pure_coulomb_friction_decays():
    """Without a drop in the friction curve swings shrink quickly, and take longer and longer."""
    motion = simulate(Servo().replace(**{"friction.static": 0.44}), "switch", 0.005, time=200.0)
    found = measure(motion)
    assert not found.hunting and found.reason


@pytest.mark.parametrize(("periods", "said"), [
    (1.9, "in 19 s none was seen twice; record longer"), (2.6, r"holds 2 of about (9\.9|10).* s in 26 s"),
])  # fmt: skip
def test_too_few_periods(periods, said):
    t = np.linspace(0, periods * 10, 800)
    with pytest.raises(InputError, match=f"must hold at least 3 whole periods, but {said}"):
        measure(Record(t, np.sin(2 * np.pi * t / 10 + 0.3)))


def test_a_part_of_a_period_has_no_length():
    """Of half a period of hunting, a rest, a slip and a rest, 1.25 s were said to be the period."""
    t, rng = np.arange(0.0, 2.4, 0.004), np.random.default_rng(0)
    x = 1 - 8.6e-3 * np.tanh((t - 1.2) / 0.02) + 2e-5 * rng.standard_normal(t.size)
    with pytest.raises(InputError, match="whole periods, but in .* s none was seen twice"):
        measure(Record(t, x))


# Files -----------------------------------------------------------------------------------------------------

WAVE = [(t, math.sin(t)) for t in np.arange(0, 40, 0.05)]


def text(header: str = "", separator: str = ",", rows=WAVE) -> str:
    lines = [separator.join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join([header] * bool(header) + lines) + "\n"


@pytest.mark.parametrize(
    "content",
    [
        text(),
        text("time,position"),
        text("t,theta"),
        text("t [s];theta (rad)", ";"),
        text("time_s\tposition_rad", "\t"),
        text("a,b"),
        text("# measured\n\nTime, Position"),
        "\ufeff" + text("t,theta"),
        text("", " "),
        text("theta,other,t", rows=[(y, 7.0, t) for t, y in WAVE]),
    ],
)
def test_layouts(tmp_path, content):
    path = tmp_path / "a.csv"
    path.write_text(content, encoding="utf-8")
    record = read_record(path)
    assert record.times == pytest.approx(np.array(WAVE)[:, 0])
    assert record.position == pytest.approx(np.array(WAVE)[:, 1], abs=1e-8)


BAD = [
    ("", "must hold samples, but is empty"),
    ("# nothing\n", "must hold samples, but is empty"),
    ("t,theta\n", "has a header only"),
    ("1\n2\n", "must have two columns"),
    ("t\n1\n", "must have two columns"),
    ("t,speed\n1,2\n", "has no column 'position' (columns: t, speed)"),
    ("speed,theta\n1,2\n", "has no column 'time'"),
    ("t,theta\n0,1\n1\n", "line 3: has 1 columns only"),
    ("t,theta\n0,1\n1,high\n", "line 3: 'high' is no number"),
    ("t,theta\n0,1\n\n1,nan\n", "line 4: must be a finite number, not NaN or infinity"),
    ("0,1\ninf,2\n", "line 2: must be a finite number"),
    ("0,1\n1,\n", "line 2: '' is no number"),
    (text(rows=[*WAVE[:50], *WAVE[49:]]), "time must increase from sample to sample"),
    (text(rows=WAVE[::-1]), "time must increase from sample to sample"),
    (text(rows=WAVE[:5]), "must hold at least 12 samples, not 5"),
    (text(rows=WAVE[:200]), "must hold at least 3 whole periods"),
    ("\x00\x01\x02", "must have two columns"),
]


@pytest.mark.parametrize(("content", "words"), BAD)
def test_bad_files(tmp_path, capsys, monkeypatch, content, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(content)
    code, out, err = run(capsys, "a.csv", "--gain", "0.04", "--plot", "a.png")
    assert (code, out) == (2, "") and words in err and err.count("\n") == 1
    assert err.startswith("casahunt record: record 'a.csv'")
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


def test_files_that_cannot_be_read(tmp_path, capsys):
    (tmp_path / "binary.csv").write_bytes(bytes(range(128, 256)))
    (tmp_path / "excel.csv").write_bytes("Zeit;Lage\n0;1\n".encode("utf-16"))
    for name, words in (("missing.csv", "no such file"), ("", "cannot be read"), ("binary.csv", "must be text"),
                        ("excel.csv", "must be text (UTF-8 or Windows-1252); save it as CSV")):  # fmt: skip
        code, out, err = run(capsys, tmp_path / name)
        assert (code, out) == (2, "") and words in err and err.count("\n") == 1


def test_a_servo_file_in_the_place_of_the_record_is_told(tmp_path, capsys):
    code, out, err = run(capsys, tmp_path / "servo.toml", tmp_path / "a.csv")
    assert (code, out) == (2, "") and "is a servo file by its name; the record stands before it" in err


# The command -----------------------------------------------------------------------------------------------


def run(capsys, *words: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = cli.main(["record", *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


def written(path, record: Record):
    table = np.column_stack([record.times, record.position])
    np.savetxt(path, table, delimiter=",", header="time,position", comments="")
    return path


def test_command(orbit, capsys, tmp_path):
    """A record a fifth larger than the prediction, round the set point 1 rad."""
    cycle = orbit("lugre", 0.04)
    record = synthetic(cycle, noise=0.02, offset=1.05 / cycle.amplitude, factor=1.2)
    path, plot = written(tmp_path / "a.csv", record), tmp_path / "a.png"
    words = [path, "--gain", 0.04, "--model", "lugre", "--set-point", 1, "--plot", plot]
    code, out, err = run(capsys, *words, "--json")
    found = json.loads(out)
    assert (code, err) == (0, "") and set(found) >= KEYS and out.count("\n") == 1
    assert found["kind"] == "hunting" and found["reason"] is None and found["prediction_failed"] is None
    assert found["predicted"]["amplitude"] == pytest.approx(cycle.amplitude, rel=1e-6)
    assert found["predicted"]["amplitude_ratio"] == pytest.approx(1.2, rel=1e-2)
    assert found["predicted"]["frequency_ratio"] == pytest.approx(1, rel=1e-3)
    assert found["offset"] == pytest.approx(0.05, abs=1e-3)
    assert len(found["amplitudes"]) == len(found["period_lengths"]) == found["periods"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    code, out, _ = run(capsys, *words[:-2])
    assert code == 0 and "measured" in out and "predicted" in out and "off the set point" in out


def test_command_without_prediction(orbit, capsys, tmp_path):
    path = written(tmp_path / "a.csv", synthetic(orbit("switch", 0.04)))
    code, out, err = run(capsys, path, "--json")
    assert (code, err, json.loads(out)["predicted"]) == (0, "", None)
    code, out, err = run(capsys, path, "--gain", 0.9, "--json")
    found = json.loads(out)
    assert code == 1 and found["kind"] == "hunting" and found["predicted"] is None
    assert "no hunting limit cycle" in found["prediction_failed"] and found["prediction_failed"] in err


def test_command_says_that_positions_are_clipped(orbit, capsys, tmp_path):
    """The cut is behind the two measured extremes; a whole record is not said to be."""
    record = synthetic(orbit("switch", 0.04), noise=0.01)
    whole = written(tmp_path / "whole.csv", record)
    assert json.loads(run(capsys, whole, "--json")[1])["clipped"] is None
    half = 0.7 * np.abs(record.position - record.position.mean()).max()
    cut = record.position.mean() + np.clip(record.position - record.position.mean(), -half, half)
    path = written(tmp_path / "cut.csv", Record(record.times, cut))
    assert "positions are clipped at" in json.loads(run(capsys, path, "--json")[1])["clipped"]
    assert "positions are clipped at" in run(capsys, path)[1]


def test_command_says_that_it_is_no_limit_cycle(capsys, tmp_path):
    path = written(tmp_path / "a.csv", Record(T, np.exp(-T / 30) * np.sin(T)))
    code, out, err = run(capsys, path, "--json", "--plot", tmp_path / "a.png")
    assert code == 1 and json.loads(out)["kind"] == "decaying"
    assert "shows no limit cycle: the amplitude changes steadily" in err
    path = written(tmp_path / "b.csv", Record(T, 1 - np.exp(-T)))
    code, out, err = run(capsys, path, "--plot", tmp_path / "b.png")
    assert code == 1 and "no oscillation" in out and "does not oscillate" in err
    assert not (tmp_path / "b.png").exists()


def test_periods_that_differ_by_more_than_they_last_have_no_numbers(capsys, tmp_path, monkeypatch):
    """Such as the steps of an encoder that are taken for some."""
    path = written(tmp_path / "a.csv", Record(T, np.exp(-T / 30) * np.sin(T)))
    assert "amplitude  " in run(capsys, path)[1]
    unknown = replace(measure(path), kind="irregular", reason="nothing repeats", period_error=1e7)
    monkeypatch.setattr(record_command, "measured", lambda _: unknown)
    code, out, err = run(capsys, path)
    assert code == 1 and "irregular, no period that repeats" in out and "shows no limit cycle" in err
    assert "amplitude" not in out and "Hz" not in out and "noise" not in out


def test_the_steps_of_a_slow_motion_are_no_limit_cycle():
    """A ramp read by an encoder repeats at each count; a servo that hunts by a count does not go away from it."""
    t, step = np.arange(0, 5, 0.004), 2 * np.pi / 8192
    slow = np.round((1 + 0.005 * t + 1e-5 * np.sin(40 * t)) / step) * step
    found = measure(Record(t, slow))
    assert found.kind == "irregular" and "what repeats are steps of 0.000767 rad, " in found.reason
    by_a_count = 1 + step * (np.sin(6 * t) > 0)
    assert measure(Record(t, by_a_count)).hunting


def test_what_simulate_writes_record_reads(capsys, tmp_path):
    table = tmp_path / "m.csv"
    assert cli.main(["simulate", "--gain", "0.04", "--csv", str(table), "--quiet"]) == 0
    code, out, _ = run(capsys, table, "--gain", 0.04, "--from", 20, "--json")
    found = json.loads(out)
    assert code == 0
    assert found["predicted"]["amplitude_ratio"] == pytest.approx(1, abs=1e-4)
    assert found["predicted"]["frequency_ratio"] == pytest.approx(1, abs=1e-4)
    code, _, err = run(capsys, table, "--from", 200)
    assert code == 2 and "from = 200: must lie before the end" in err


def test_a_long_record_says_where_it_is(tmp_path, capsys, monkeypatch):
    from casahunt.views.commands import record as command_record

    monkeypatch.setattr(command_record, "LARGE", 100)
    monkeypatch.setattr(command_record, "MANY", 100)
    t = np.arange(0, 60, 0.1)
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, np.sin(t)]), delimiter=",", header="time,position", comments="")
    assert cli.main(["record", str(tmp_path / "a.csv"), "--details"]) == 0
    assert capsys.readouterr().err == "reading 0 MB\n600 samples read, looking for the period\n"
    assert cli.main(["record", str(tmp_path / "a.csv"), "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_a_file_its_samples_and_a_motion_are_measured_alike(tmp_path):
    """One verb, whatever the samples are in; and what it measured is in its answer."""
    motion = simulate(Servo(), "switch", 0.04, time=60.0)
    of_motion = measure(motion)
    record = of_motion.record
    path = tmp_path / "record.csv"
    rows = "".join(f"{1e3 * t!r},{x!r}\n" for t, x in zip(record.times.tolist(), record.position.tolist(), strict=True))
    path.write_text("anything,else\n" + rows, encoding="utf-8")
    stated = measure(path, time_unit="ms", position_unit="rad")
    for found in (measure(record), stated, measure(str(path), time_unit="ms")):
        assert found.period == pytest.approx(of_motion.period, rel=1e-12)
        assert found.record.times.size == record.times.size
    later = measure(path, time_unit="ms", start=20.0)
    assert later.record.times[0] >= 20.0 and later.periods.size < of_motion.periods.size
    with pytest.raises(InputError, match="time_unit: must be left out where no file is read"):
        measure(record, time_unit="ms")
    with pytest.raises(InputError, match="no such file"):
        measure(tmp_path / "none.csv")


def test_lopsided_hunting_is_predicted_as_it_is_measured():
    """Half of its swing, as a motion that settles on it has it, and not its farther end from the set point."""
    loop = Loop((INERTIA, BY_DIRECTION, PID_BY_GAINS, INTEGRATOR), {"static_back": 0.47})
    orbit, motion = find_orbit(loop), simulate(loop, time=300.0)
    x = motion.states[0][motion.times > 250.0]
    swing = (x.max() - x.min()) / 2
    assert record_command.half_swing(orbit) == pytest.approx(swing, rel=1e-5)
    assert orbit.amplitude == pytest.approx(max(x.max(), -x.min()), rel=1e-5) and orbit.amplitude > 1.01 * swing
