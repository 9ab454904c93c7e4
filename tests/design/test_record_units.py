"""Units of records: read from the header or stated, converted and said, or refused; never guessed in silence."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from casahunt import InputError, cli
from casahunt.design.record.file import read_record
from casahunt.design.record.units import parsed_unit, split_header

DEG, MIN = math.pi / 180, 60.0
ROWS = [(0.0, 1.0), (1.0, 2.5), (2.0, -4.0)]


def file(tmp_path, header: str, rows=ROWS, separator=","):
    path = tmp_path / "a.csv"
    lines = [separator.join(map(str, row)) for row in rows]
    path.write_text("\n".join([header] * bool(header) + lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "second", "radian"),
    [
        ("Time (ms),Position (deg)", 1e-3, DEG),
        ("t [s],pos_deg", 1, DEG),
        ("time_us,angle/deg", 1e-6, DEG),
        ("Time [µs],Theta [mrad]", 1e-6, 1e-3),
        ("Time[Min],phi[REV]", MIN, 2 * math.pi),
        ("t/ms,theta/rad", 1e-3, 1),
        ("Time in ms,angle °", 1e-3, DEG),
        ("time (h),shaft angle (degrees)", 3600, DEG),
        ("ms,deg", 1e-3, DEG),
        ("seconds,turns", 1, 2 * math.pi),
        ("Time [sec.],Angle [arcmin]", 1, DEG / 60),
        ("time_s,position_rad", 1, 1),
        ("timestamps [s],angle [rad]", 1, 1),
        ("# time_ms,pos_deg", 1e-3, DEG),
        ("time,pos\nms,deg", 1e-3, DEG),
        ("Time,Position\n[ms],[deg]", 1e-3, DEG),
        ('"Time, ms","Position, deg"', 1e-3, DEG),
    ],
)
def test_headers(tmp_path, header, second, radian):
    record = read_record(file(tmp_path, header))
    assert record.times == pytest.approx(second * np.array([0, 1, 2]), rel=1e-15)
    assert record.position == pytest.approx(radian * np.array([1, 2.5, -4]), rel=1e-15)
    assert {record.reading.time.origin, record.reading.position.origin} == {"header"}
    assert ("converted to s" in record.reading.sentence) == (second != 1)
    assert ("converted to rad" in record.reading.sentence) == (radian != 1)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("samples,theta [rad]", "column 'samples': 'samples' is a count, no unit; state how many s one count is"),
        ("t,position_counts", "'counts' is a count, no unit; state how many rad one count is, as --position-unit"),
        ("t,encoder counts", "'encoder counts' is a count, no unit"),
        ("t,speed", "has no column 'position' (columns: t, speed); say which it is, as --position-column NAME"),
        ("t,theta [Grad]", "'Grad' is degrees in some languages and gon in others; state which, as --pos"),
        ("Time (s),Position (mm)", "column 'Position (mm)': 'mm' is no unit of angle that is known (rad, mrad"),
        ("Time (m),Position", "column 'Time (m)': 'm' is no unit of time that is known (s, ms"),
        ("Time (deg),Position (s)", "'deg' is no unit of time"),
        ("Time (from start),angle", "'from start' is no unit of time"),
        ("t,theta [rad/s]", "'rad/s' is no unit of angle"),
        ("t,theta rad/s", "no unit of angle"),
        ("t,theta_rad_per_s", "'rad per s' is no unit of angle"),
        ("t,pos_volts", "'volts' is no unit of angle"),
        ("t,theta_ref", "has no column 'position'"),
    ],
)
def test_what_is_refused(tmp_path, capsys, header, words):
    path = file(tmp_path, header)
    with pytest.raises(InputError) as error:
        read_record(path)
    assert words in str(error.value)
    assert cli.main(["record", str(path)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and words in err and err.count("\n") == 1


def test_what_nobody_states_is_said(tmp_path):
    for header in ("", "time,position", "a,b"):
        record = read_record(file(tmp_path, header))
        assert record.reading.sentence.count("(the file states no unit)") == 2
        assert "taken as s" in record.reading.sentence and "taken as rad" in record.reading.sentence


def test_a_unit_of_two_meanings_is_asked_for(tmp_path):
    """A German "Grad" is a degree, the grad of a pocket calculator a gon: nine tenths of it."""
    path = file(tmp_path, "Zeit [s],Istlage [Grad]")
    for unit, size in (("deg", DEG), ("gon", 0.9 * DEG)):
        assert read_record(path, time_column="1", position_column="2", position_unit=unit).position[0] == (
            pytest.approx(size, rel=1e-15)
        )
    with pytest.raises(InputError, match="position-unit: 'grad' is degrees in some languages"):
        read_record(path, time_column="1", position_column="2", position_unit="grad")


def test_units_that_are_stated(tmp_path):
    path = file(tmp_path, "")
    record = read_record(path, time_unit="ms", position_unit="0.25")
    assert record.times.tolist() == [0, 1e-3, 2e-3] and record.position.tolist() == [0.25, 0.625, -1.0]
    assert record.reading.sentence.count("as stated on the command line") == 2
    record = read_record(file(tmp_path, "sample,encoder counts"), time_unit="0.5", position_unit="0.25")
    assert record.times.tolist() == [0, 0.5, 1.0] and record.position.tolist() == [0.25, 0.625, -1.0]
    # What a person states goes before what a header does, also where that is unknown.
    record = read_record(file(tmp_path, "time [ticks],theta [deg]"), time_unit="0.5", position_unit="rad")
    assert record.times.tolist() == [0, 0.5, 1.0] and record.position.tolist() == [1.0, 2.5, -4.0]


@pytest.mark.parametrize("text", ["x", "samples", "deg", "", "0", "-1", "nan", "inf", "1e999"])
def test_stated_units_that_are_none(tmp_path, text):
    with pytest.raises(InputError, match="^time-unit: "):
        read_record(file(tmp_path, ""), time_unit=text)
    assert parsed_unit("angle", "deg").factor == DEG


def test_columns_are_found_by_name(tmp_path):
    rows = [(9.0, 1.0, 7.0, 0.0), (9.0, 2.0, 7.0, 1.0)]
    record = read_record(file(tmp_path, "theta_d,theta [deg],velocity_rad_per_s,time [ms]", rows))
    assert record.times.tolist() == [0, 1e-3] and record.position.tolist() == [DEG, 2 * DEG]
    assert record.reading.position.name == "'theta [deg]'" and record.reading.time.name == "'time [ms]'"


@pytest.mark.parametrize(
    ("cell", "found"),
    [
        ("Time (ms)", (["time"], "ms")),
        ("theta", (["theta"], None)),
        ("theta_meas", (["theta", "meas"], None)),
        ("theta_meas_deg", (["theta", "meas"], "deg")),
        ("a", (["a"], None)),
        ("", ([], None)),
    ],
)
def test_split_header(cell, found):
    assert split_header(cell) == found


def test_command_converts_and_says(capsys, tmp_path):
    """A wave of 0.05 rad and 10 s, written in degrees and milliseconds."""
    t = np.arange(0, 60, 0.02)
    rows = [(f"{1000 * a:.6f}", f"{math.degrees(0.05 * math.sin(0.2 * math.pi * a)):.9f}") for a in t]
    path = file(tmp_path, "Time (ms),Position (deg)", rows)
    assert cli.main(["record", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["amplitude"] == pytest.approx(0.05, rel=1e-3) and found["period"] == pytest.approx(10, rel=1e-4)
    assert found["columns"]["time"] == {"column": "'Time (ms)'", "unit": "ms", "factor": 1e-3, "stated_by": "header"}
    assert found["columns"]["position"]["unit"] == "deg" and found["columns"]["position"]["factor"] == DEG
    assert cli.main(["record", str(path)]) == 0
    assert "times from column 'Time (ms)', in ms, converted to s; positions from column 'Position (deg)', in deg" in (
        " ".join(capsys.readouterr().out.split())
    )
    bare = file(tmp_path, "", rows)
    assert cli.main(["record", str(bare), "--time-unit", "ms", "--position-unit", "deg", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["amplitude"] == pytest.approx(0.05, rel=1e-3)


def test_what_the_slow_reader_takes(tmp_path):
    """Numbers that numpy does not read, float() does; and comments between the samples."""
    path = tmp_path / "a.csv"
    path.write_text("time,position\n0,1\n# a remark\n\n1_0,2\n", encoding="utf-8")
    record = read_record(path)
    assert record.times.tolist() == [0, 10] and record.position.tolist() == [1, 2]
