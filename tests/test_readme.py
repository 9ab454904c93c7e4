"""What the README and the pages of commands show works as it is written."""

from __future__ import annotations

import itertools
import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from casahunt import Controller, Pid, Servo, find_fold
from casahunt.cli import build_parser, main
from casahunt.design.uncertainty.set import load_uncertainty
from casahunt.servo.servo import KEYS, servo_of_tables
from problems import ball_screw, table1
from problems.taylor import switch_cycle, switch_fold, switch_half_cycle

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
SERVO_FILE = (ROOT / "docs" / "reference" / "servo_file.md").read_text(encoding="utf-8")
PAGES = [TEXT, *(page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs" / "howto").glob("*.md")))]
MOST_LINES = 120


def blocks(language: str, text: str = TEXT) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_readme_is_a_landing_page():
    assert len(TEXT.splitlines()) <= MOST_LINES


def test_python_example(capsys):
    """Runs, and prints the numbers that its comments promise."""
    (code,) = blocks("python")
    scope: dict = {}
    exec(compile(code, "README.md", "exec"), scope)  # the code is our own
    assert scope["orbit"].amplitude == pytest.approx(0.0500469727, rel=1e-8)
    assert scope["orbit"].period == pytest.approx(10.2814152, rel=1e-8)
    assert scope["orbit"].half_multiplier == pytest.approx(-0.1504772, rel=1e-6)
    assert scope["fold"].gain == pytest.approx(0.64733908365, rel=1e-9)
    assert capsys.readouterr().out


def test_servo_file_example():
    times, gains, linear, _ = map(tomllib.loads, blocks("toml", SERVO_FILE))  # the last: test_complete_axes.py
    assert servo_of_tables(linear, "the page") == ball_screw.BY_HAND
    for tree in (times, gains):
        assert {f"{section}.{key}" for section, table in tree.items() for key in table} <= set(KEYS)
    assert Pid(**gains["controller"]) == Pid(kp=1, ki=6, kd=0.15)
    assert Controller(**times["controller"]).pid() == Pid(kp=2, ki=2 * np.pi, kd=1 / (2 * np.pi))


LINES = [
    line
    for text in PAGES
    for block in blocks("sh", text)
    for line in block.splitlines()
    if line.startswith("casahunt ")
]
PROMISED: dict[str, list[str]] = {}
"""The commands, and the numbers that the comments behind them promise: those of three decimals and more are results."""
for said, _, comment in (line.partition("#") for line in LINES):
    PROMISED.setdefault(said.strip(), []).extend(re.findall(r"(?<![\w.])\d+\.\d{3,}", comment))
COMMANDS = list(PROMISED)
TO_THE_LETTER = "casahunt remedies --gain 0.04"
"""It takes longest; tests/test_site.py looks at every line that it prints."""


STORY = next(line for line in TEXT.splitlines() if line.startswith("casahunt tune") and "--uncertainty" in line)
ENDS_IN = float(re.search(r"K = ([0-9.]+)", STORY).group(1))  # type: ignore[union-attr]


def json_of(capsys, words: list[str]) -> dict:
    assert main([*words, "--json", "--quiet"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_story_ends_at_rest(tmp_path, monkeypatch, capsys):
    """The gain that the story ends in, at the worst servo of its set; and the one that it warns of hunts there."""
    after = [command for command in COMMANDS if command.startswith(f"casahunt simulate --gain {ENDS_IN} ")]
    assert len(after) == 2
    monkeypatch.chdir(tmp_path)
    for command in after:
        said = json_of(capsys, shlex.split(command)[1:])
        assert said["verdict"] == "at rest" and said["other_end"] is None
    names = re.findall(r"--set (\S+)=(\S+)", after[1])
    worst = Servo().replace(**{name: float(value) for name, value in names})
    assert largest_swing(worst, ENDS_IN) < 1
    warned = float(re.search(r"above the nominal fold, K = ([0-9.]+)", TEXT).group(1))
    assert 1.1 * table1.REFERENCE["switch"]["fold"]["K"] == pytest.approx(warned, abs=1e-4)
    amplitude, period = switch_cycle(worst, warned, 0.0017)
    # The step that is shown comes to rest, and names the start from which it hunts: on that cycle.
    (step,) = (shlex.split(c)[1:] for c in COMMANDS if c.startswith(f"casahunt simulate --gain {warned} "))
    rests = json_of(capsys, step)
    assert rests["verdict"] == "at rest" and abs(1 - rests["other_end"]["start"]["position"]) < 0.01
    said = json_of(capsys, [*step, "--position", str(rests["other_end"]["start"]["position"])])
    assert said["verdict"] == "hunting" and said["other_end"] is None
    assert said["amplitude"] == pytest.approx(amplitude, rel=1e-4) == pytest.approx(0.0017, abs=1e-5)
    assert rests["other_end"]["amplitude"] == pytest.approx(amplitude, rel=1e-6)
    assert rests["other_end"]["period"] == pytest.approx(period, rel=1e-6)


@pytest.mark.slow
def test_the_story_ends_at_rest_all_over_its_set():
    """At every corner of the uncertainty and between them, by the Taylor engine."""
    words, servo = shlex.split(STORY.partition("#")[0]), Servo()
    uncertainty = load_uncertainty(ROOT / words[words.index("--uncertainty") + 1], servo)
    low, high = uncertainty.box(servo)
    corners = [np.array(q) for q in itertools.product(*zip(low, high, strict=True))]
    between = low + (high - low) * np.random.default_rng(5).random((4, low.size))
    for q in [*corners, *between]:
        member = servo.replace(**dict(zip(uncertainty.parameters, map(float, q), strict=True)))
        assert largest_swing(member, ENDS_IN) < 1


def largest_swing(servo: Servo, gain: float) -> float:
    """max over stick positions a of |P(a)|/a; above one there is a cycle."""
    unit = servo.friction.static / servo.torque_gains(gain)[0]
    return max(
        abs(switch_half_cycle(servo, gain, float(a), thrown_out=10 * unit, most_slips=20)[0]) / a
        for a in np.geomspace(0.01, 3, 10) * unit
    )


@pytest.mark.slow
def test_the_story_s_numbers_by_another_engine():
    """0.8007 is the fold of its worst servo, by Taylor series; no corner has a larger one; 10 % above it, 0.8808."""
    words, servo = shlex.split(STORY.partition("#")[0]), Servo()
    uncertainty = load_uncertainty(ROOT / words[words.index("--uncertainty") + 1], servo)
    corners = [
        servo.replace(**dict(zip(uncertainty.parameters, map(float, q), strict=True)))
        for q in itertools.product(*zip(*uncertainty.box(servo), strict=True))
    ]
    worst, fold = max(((corner, find_fold(corner, "switch")) for corner in corners), key=lambda found: found[1].gain)
    shown = re.search(r"casahunt simulate --gain \S+ --time 100 (--set .*)", TEXT).group(1)  # type: ignore[union-attr]
    named = {name: float(value) for name, value in re.findall(r"--set (\S+)=(\S+)", shown)}
    assert worst == servo.replace(**named)
    largest, _ = switch_fold(worst, round(fold.gain, 5), fold.orbit.amplitude)
    said = re.search(r"# ([0-9.]+) at the worst", TEXT).group(1)  # type: ignore[union-attr]
    assert f"{largest:.4f}" == said and f"{1.1 * largest:.4f}" == f"{ENDS_IN}"


WRITTEN = re.compile(r"--(?:plot|save|csv|out) (\S+)")


def arguments_of(command: str) -> list[str]:
    """What a command is called with, where the files of the checkout are elsewhere."""
    return [str(ROOT / word) if word.endswith(".toml") and (ROOT / word).exists() else word
            for word in shlex.split(command)[1:]]  # fmt: skip


def makers(command: str) -> list[str]:
    """The commands before this one that write what it reads, and before them those that write what they read."""
    read = shlex.split(WRITTEN.sub("", command))
    for other in reversed(COMMANDS[: COMMANDS.index(command)]):
        if any(word == name or word.startswith(f"{name}/") for name in WRITTEN.findall(other) for word in read):
            return [*makers(other), other]
    return []


@pytest.mark.slow
@pytest.mark.parametrize("command", [command for command in COMMANDS if command != TO_THE_LETTER])
def test_commands(command, tmp_path, monkeypatch, capsys):
    """Each runs, and prints the numbers that the comment behind it promises."""
    monkeypatch.chdir(tmp_path)
    for before in makers(command):
        assert main(arguments_of(before)) == 0
    capsys.readouterr()
    assert main(arguments_of(command)) == 0
    out = capsys.readouterr().out
    assert out
    for promised in PROMISED[command]:
        decimals = len(promised.partition(".")[2])
        assert promised in {f"{float(number):.{decimals}f}" for number in re.findall(r"\d+\.\d+", out)}


@pytest.mark.skipif(shutil.which("git") is None or not (ROOT / ".git").exists(), reason="no checkout")
def test_what_the_examples_write_is_none_of_the_repository():
    """Who tries them in the checkout has nothing to add or to remove."""
    written = {name.rstrip("`") for text in (TEXT, *COMMANDS) for name in WRITTEN.findall(text)}
    written = {name for name in written if re.search(r"[a-z]", name) and name not in ("F.npz", "F.csv", "F.png")}
    written.add(parser_default("diagram", "out"))
    assert {"before.png", "tuned", "casahunt-diagram", "pictures"} <= written
    names = sorted(f"{name}/x" if "." not in name else name for name in written)
    run = subprocess.run(["git", "check-ignore", *names], cwd=ROOT, capture_output=True, text=True)
    assert sorted(run.stdout.split()) == names


def parser_default(command: str, option: str) -> str:
    return build_parser().parse_args([command]).__dict__[option]


def test_the_first_command_is_what_a_fresh_machine_does():
    """.ci/run does the same, by the installed package; the comments promise numbers that test_commands looks for."""
    assert blocks("sh")[0].endswith("pip install . && casahunt diagram\n")
    steps = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "python -m pip install --quiet .\n" in steps and "        casahunt diagram --quiet\n" in steps
    assert [numbers for command, numbers in PROMISED.items() if numbers] == [
        ["0.6473"], ["0.8007"], ["0.8808"], ["0.04335", "0.2468", "0.6473"], ["0.209"], ["2.494"],
    ]  # fmt: skip


def test_the_lowest_versions_are_those_of_the_extras_too():
    """Of each library that a user installs with an extra and that has a lowest version."""
    script = Path(__file__).parents[1] / ".ci" / "floors.py"
    printed = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True).stdout.split()
    assert {line.partition("==")[0] for line in printed} >= {
        "casadi", "numpy", "matplotlib", "bokeh", "tornado", "pandas"
    } and len(printed) == len(set(printed))  # fmt: skip


def test_the_lowest_versions_are_asked_without_the_packages_of_tests():
    """What .ci/run asks in their environment is collected where there is none of them but pytest's own."""
    steps = (ROOT / ".ci" / "run").read_text(encoding="utf-8").replace("\\\n", " ")
    words = shlex.split(steps[steps.index("DeprecationWarning tests/") :].splitlines()[0])[1:]
    absent = ["scipy", "heyoka", "control", "dask", "numpydoc", "nbclient", "nbformat", "mypy"]
    words += ["--collect-only", "-q", "-n0", "-p", "no:cacheprovider"]
    code = f"import sys, pytest; sys.modules.update(dict.fromkeys({absent})); sys.exit(pytest.main({words}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def test_there_are_commands():
    assert len(COMMANDS) >= 15


def test_every_command_that_is_named_stands_in_a_block():
    """What stands inside a sentence is a word of it, `casahunt COMMAND`, not a line to be typed unseen by tests."""
    for text in PAGES:
        prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
        for said in re.findall(r"`casahunt ([^`]+)`", prose):
            assert said.startswith("record") or len(said.split()) <= 2 or f"casahunt {said}" in COMMANDS, said


def test_pictures_exist():
    for path in re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT):
        assert (ROOT / path).stat().st_size > 10_000
