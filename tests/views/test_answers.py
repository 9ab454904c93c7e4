"""What commands say first: plain words, few digits; the mathematics and every digit with --details; one line of
progress that moves, milestones in a log.
"""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from casahunt import Servo, cli, find_orbit, simulate
from casahunt.servo.parts.table import REMEDY_NAMES
from casahunt.views.answers.answer import complex_text, short, within
from casahunt.views.answers.simulate import simulation_answer
from casahunt.views.commands import progress
from casahunt.views.commands.output import DETAILS, MEANINGS
from casahunt.views.glossary import CHAPTERS, GLOSSARY, TEN_WORDS, words_in

ROOT = Path(__file__).parents[2]
SET = ROOT / "problems" / "table1_uncertainty.toml"
CANUDAS = ROOT / "problems" / "canudas.toml"
MATHEMATICS = re.compile(
    r"multiplier|fixed point|floquet|residual|colloc|P\(a\)|P = a|P'|admissib|bifurc|eigenvalue|jacobian|newton|ipopt"
    r"|iteration|unknowns|mesh|half.cycle|superstable|symmetry break|perturb|linearis|event map|stick position"
    r"|corrector|continuation|converged|intervals|\bmu\b|\bx1\b|tangent|manifold|hopf|grazing|arclength|without limit"
    r"|decaying|in a fold",
    re.IGNORECASE,
)
FEW = 4
"""Digits of what is known to per cents."""
LONG = re.compile(r"\d[\d.]*\d(?:e[-+]\d+)?")

ANSWERS = {
    "orbit": (["orbit", "--gain", 0.04], "half multiplier"),
    "unstable": (["orbit", "--gain", 0.04, "--branch", "unstable"], "multipliers"),
    "orbit of a PID": (["orbit", CANUDAS, "--gain", 0.5, "--model", "lugre"], "multipliers"),
    "no orbit": (["orbit", "--gain", 2], "in a fold"),
    "fold": (["fold"], "turning point"),
    "fold of a PID": (["fold", CANUDAS], "turning point"),
    "diagram": (["diagram", "--model", "switch", "--from", 0.6], "superstable"),
    "no diagram": (["diagram", "--model", "switch", "--from", 0.8], "in a fold"),
    "map": (["map", "--gain", 0.04], "fixed point"),
    "empty map": (["map", "--gain", 0.9], "event map"),
    "basin": (["basin", "--gain", 0.5], "max |x1|"),
    "equilibria": (["equilibria", "--gain", 0.1, "--model", "lugre"], "generalised Jacobian"),
    "equilibria, stuck": (["equilibria", "--gain", 0.1], "eigenvalue"),
    "loop": (["loop", "--gain", 0.1], "poles"),
    "simulate": (["simulate", "--gain", 0.04, "--time", 60], "swings ahead"),
    "simulate to rest": (["simulate", "--gain", 0.8808, "--time", 60], "final state"),
    "as built": (["simulate", "--gain", 0.04, "--sample-time", 0.002, "--encoder", 2000], "samples"),
    "fold-curve": (["fold-curve", "--model", "switch", "--vary", "friction.static", "--from", 0.53, "--to", 0.54,
                    "--points", 2], "gain V/rad"),
    "fold-map": (["fold-map", "--vary", "friction.static", 0.52, 0.54, "--and", "servo.inertia", 0.02, 0.03,
                  "--points", 2], "relative error"),
    "uncertainty": (["uncertainty", "--uncertainty", SET, "--samples", 4], "linearised"),
    "remedies": (["remedies", "--gain", 0.04, "--only", "leak,dead band"], "0.2468448"),
    "record": (["record", "RECORD", "--gain", 0.1], "error estimate"),
    "identify": (["identify", "RECORD", "--gain", 0.1, "--free", "friction.static,friction.coulomb"], "misfit"),
    "cure": (["cure", "RECORD", "--gain", 0.1, "--only", "leak,dead band"], "misfit"),
    "tune": (["tune", "--uncertainty", SET], "event map"),
}  # fmt: skip
"""A command, and what its details say."""
SLOW = {"tune", "cure", "fold of a PID", "remedies"}


def plainly(text: str) -> str:
    """The lines of an answer, without the words that are explained below it."""
    return " ".join(text.partition(MEANINGS)[0].split())


def written_record(folder: Path) -> Path:
    """Of the servo of Table 1 at gain 0.1, with noise."""
    orbit = find_orbit(Servo(), "switch", 0.1)
    t = np.arange(0.0, 6 * orbit.period, orbit.period / 250)
    times, states = orbit.sample(200)
    y = np.interp(t % orbit.period, times, states[0]) + 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    path = folder / "record.csv"
    np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="time_s,position_rad")
    return path


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in ANSWERS])
def test_the_mathematics_stands_in_the_details(capsys, tmp_path, monkeypatch, undrawn, name):
    """The plain lines have no word beyond the ten of the glossary and no gain in ten digits; they stay with --details,
    below which the mathematics and all digits stand."""
    monkeypatch.chdir(tmp_path)
    words, detail = ANSWERS[name]
    words = [written_record(tmp_path) if word == "RECORD" else word for word in words]
    _, out, err = run(capsys, *words, "--quiet")
    said = plainly(out) or plainly(err)
    assert said and not MATHEMATICS.search(said), MATHEMATICS.search(said)
    assert set(words_in(said)) <= {*TEN_WORDS, *REMEDY_NAMES}
    given = {str(word) for word in words}
    for number in LONG.findall(re.sub(r"--\w+ \S+|\S*tmp\S*", "", said)):
        digits = number.partition("e")[0].replace(".", "").strip("0")
        assert len(digits) <= FEW or number in given, number
    _, more, more_err = run(capsys, *words, "--quiet", "--details")
    whole = plainly(more) or plainly(more_err)
    assert detail in whole and (f" {DETAILS} " in whole or not out)
    assert not out or whole.startswith(said)


def test_the_object_is_the_same(capsys):
    """--details changes nothing in JSON, but for the time that it took."""
    found = [json.loads(run(capsys, "orbit", "--gain", 0.1, "--json", "--quiet", *more)[1])
             for more in ([], ["--details"])]  # fmt: skip
    for one in found:
        one.pop("wall_s")
    assert found[0] == found[1] and len(repr(found[0]["amplitude"])) > 10


def test_what_waits_is_not_at_rest():
    """Stuck beside the set point until the integral has grown: when it breaks away again is said first."""
    servo = Servo().replace(**{"friction.static": 0.54, "friction.coulomb": 0.435, "friction.stribeck_velocity": 0.019})
    found = simulate(servo, "switch", 0.88, position=1 - 0.002847, time=60.0)
    assert found.verdict.kind == "decaying"
    kp, kd, ki = servo.torque_gains(0.88)
    x1, x2, x3 = found.end
    m = -(kp * x1 + kd * x2 + ki * x3)
    wait = (servo.friction.static + m * (1 if x1 > 0 else -1)) / (ki * abs(x1))  # |m| = Fs, which grows by ki |x1| dt
    assert found.verdict.waits == pytest.approx(wait, rel=1e-9)
    head, because, *_ = simulation_answer(found, None, 0.0).plain
    assert head.endswith(": stuck for now, on its way to rest")
    assert f"breaks it away again about {short(wait)} s later" in because


def test_numbers_of_plain_lines():
    assert [short(x) for x in (0.64733908, 48.578681, 12345.678, 2.17483e-4, 0.0, 1e-7, 0.5)] == [
        "0.6473", "48.58", "12350", "0.0002175", "0", "1e-07", "0.5",
    ]  # fmt: skip
    assert short(0.123456, 1e-2) == "0.123" and within(-3e-20, 1e-10) == "0" and within(2.5, 1e-9) == "2.5"
    assert complex_text(0.5 - 0.25j, 1e-3) == "0.5-0.25j"


def test_ten_words():
    """Each has a sentence in which no word of mathematics stands."""
    assert len(TEN_WORDS) == 10 and not MATHEMATICS.search(" ".join(GLOSSARY[word] for word in TEN_WORDS))
    assert sorted(word for words in CHAPTERS.values() for word in words) == sorted(GLOSSARY)


# Progress ---------------------------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    """A stream that is read by a person."""

    def isatty(self) -> bool:
        return True

    def screen(self) -> list[str]:
        """The lines as they stand in the end."""
        return [row.split("\r")[-1].rstrip() if row.split("\r")[-1] else "" for row in self.getvalue().split("\n")]


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_one_line_moves_on_a_terminal(monkeypatch, clock):
    """It is written over, milestones stay above it, and in the end it is gone."""
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    told = progress.Progress(stream)
    for i in range(100):
        clock[0] += 1.0
        told.tell(f"point {i} " + "x" * (i % 7) * 30)
        if i == 50:
            told.say("half-way")
    assert stream.getvalue().count("\n") == 1 and "point 99" in stream.screen()[-1]
    assert all(len(part) <= 80 for part in re.split(r"[\r\n]", stream.getvalue()))
    told.clear()
    assert stream.screen() == ["half-way", ""] and stream.getvalue().endswith("\r")


def test_nothing_moves_where_nothing_can(monkeypatch, clock):
    monkeypatch.setenv("TERM", "dumb")
    stream = Terminal()
    progress.Progress(stream).tell("point 1")
    assert stream.getvalue() == ""


def test_a_log_has_milestones(clock):
    """And where the command is, each time as long as before has gone by once more: an hour in nine lines."""
    stream = io.StringIO()
    told = progress.Progress(stream)
    for second in range(3600):
        clock[0] = float(second)
        told.tell(f"{second} s")
        if second == 100:
            told.say("the end of hunting")
    before, after = stream.getvalue().split("the end of hunting\n")
    assert [before.split("\n"), after.split("\n")] == [
        ["10 s", "20 s", "40 s", "80 s", ""], ["160 s", "320 s", "640 s", "1280 s", "2560 s", ""],
    ]  # fmt: skip


def test_a_diagram_in_a_log(capsys, tmp_path, undrawn):
    """One milestone, where hunting ends; with --details a line for each point."""
    words = ["diagram", "--model", "switch", "--from", 0.3, "--out", tmp_path]
    assert run(capsys, *words)[2].splitlines() == ["switch: cycles of one kind end at gain 0.6473 V/rad"]
    assert len(run(capsys, *words, "--details")[2].splitlines()) > 20
    assert run(capsys, *words, "--quiet")[2] == ""


def test_every_command_with_an_answer_has_details(capsys):
    for name in {words[0] for words, _ in ANSWERS.values()}:
        with pytest.raises(SystemExit):
            cli.main([name, "--help"])
        assert "--details" in capsys.readouterr().out, name
