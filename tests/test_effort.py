"""Long computations say where they are, and those without an end in sight are given up with a sentence."""

from __future__ import annotations

import json

import pytest

from casahunt import Servo, cli, effort, find_orbit, simulate
from casahunt.effort import GivenUp, counting_work

SIMULATE = ["simulate", "--gain", "0.04", "--time", "20"]
UNSTABLE = ["orbit", "--model", "lugre", "--gain", "0.1", "--branch", "unstable"]


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (SIMULATE, ["s of 20 s, to the march tolerance", "motions"]),
        (["orbit", "--gain", "0.1"], ["Newton steps of cycles so far"]),
        (["fold"], ["on the way to the fold, at gain 0."]),
    ],
)
def test_commands_say_where_they_are(words, parts, capsys, monkeypatch):
    monkeypatch.setattr(effort, "EVERY", 0.0)
    assert cli.main([*words, "--details"]) == 0
    err = capsys.readouterr().err
    assert all(part in err for part in parts), err[-500:]
    assert cli.main([*words, "--quiet"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("words", [SIMULATE, UNSTABLE, ["basin", "--gain", "0.1"]])
def test_what_takes_too_much_work_is_given_up(words, capsys, monkeypatch):
    """In one sentence, and at the same place each time: also where a failure would be an answer of another kind."""
    said = []
    for _ in range(2):
        monkeypatch.setattr(cli, "MOST_WORK", 700)
        assert cli.main([*words, "--quiet"]) == 1
        out, err = capsys.readouterr()
        assert out == "" and err.count("\n") == 1
        assert err.startswith(f"casahunt {words[0]}: given up, because no answer came after the work of 7")
        said.append(err)
    assert said[0] == said[1]


def test_lines_come_after_a_silence(monkeypatch):
    clock, lines = [0.0], []
    monkeypatch.setattr(effort, "EVERY", 2.0)
    monkeypatch.setattr(effort.time, "monotonic", lambda: clock[0])
    with counting_work(lines.append) as watch:
        for tenths in range(50):
            clock[0] = tenths / 10
            if tenths == 30:
                watch.heard()
            effort.problem(10)
    assert [line.split(" s:")[0] for line in lines] == ["2"]
    assert watch.work == 500 and watch.problems == 50


def test_the_library_is_not_watched():
    """Nothing counts after the block, nor for a call from Python; inside, work is what the units say."""
    with counting_work(None) as watch:
        find_orbit(Servo(), "switch", 0.1)
    done = watch.work
    assert done >= effort.MARCHED * watch.motions > 0 and watch.problems > 0
    find_orbit(Servo(), "switch", 0.1)
    assert watch.work == done
    with pytest.raises(GivenUp), counting_work(None, limit=done - 1):
        find_orbit(Servo(), "switch", 0.1)
    with counting_work(None, limit=done):
        find_orbit(Servo(), "switch", 0.1)


def test_a_motion_of_very_many_events_ends_early(capsys, monkeypatch):
    monkeypatch.setattr("casahunt.servo.simulate.MOST_EVENTS", 5)
    assert cli.main([*SIMULATE, "--json"]) == 1
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["ended"].startswith("5 events by") and found["time"] < 20
    assert "the motion was followed only until 5 events by" in err and "not to 20 s" in err
    assert simulate(Servo(), "switch", 0.04, time=20).ended


def test_a_part_may_take_so_much_and_counts_for_the_whole():
    """With nobody watching too; beyond the whole the whole is given up, not the part."""
    with pytest.raises(GivenUp), effort.at_most(5):
        effort.problem(6)
    with counting_work(None, limit=30) as whole:
        with pytest.raises(GivenUp), effort.at_most(5):
            effort.problem(6)
        with effort.at_most(50):
            effort.problem(20)
        assert (whole.work, whole.problems) == (26, 2)
        with pytest.raises(GivenUp, match=r"work of 3.6e\+01"), effort.at_most(50):
            effort.problem(10)


def test_a_part_that_is_allowed_more_than_is_left_of_another_part_ends_that_one():
    """And no more than that: the whole goes on."""
    with effort.at_most(1000):
        with pytest.raises(effort.PartGivenUp), effort.at_most(10), effort.at_most(100):
            effort.problem(20)
        effort.problem(20)
