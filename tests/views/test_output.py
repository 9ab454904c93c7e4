"""What every command gives: 80 columns, each word of the trade explained once, a CSV table with all digits; its JSON
object is the mapping of its result: every key of `to_dict`, with the same value.
"""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path

import pytest
from command_line import one_json, run

import casahunt
from casahunt import Servo, cli, find_orbit
from casahunt.checks import to_absolute_error, to_error
from casahunt.cli import main
from casahunt.servo.servo import KEYS
from casahunt.servo.units import PARAMETER_UNITS, column
from casahunt.views.answers.answer import named
from casahunt.views.commands.output import LINE_WIDTH, MEANINGS, meanings, wrapped
from casahunt.views.glossary import FAMILIAR, GLOSSARY, OTHER_FORMS, glossary_page, words_in

ROOT = Path(__file__).parents[2]
SET = ROOT / "problems" / "table1_uncertainty.toml"
GAIN = ("--gain", 0.1)
VS = "friction.stribeck_velocity"  # the longest name
COMMANDS = {
    "orbit": ("--gain", 0.4, "--branch", "unstable", "--multipliers", "integrator"),
    "diagram": ("--model", "switch", "--from", 0.63),
    "fold": (),
    "fold-curve": ("--model", "switch", "--vary", VS, "--from", 0.02, "--to", 0.0201, "--points", 2),
    "fold-map": ("--vary", "friction.static", 0.52, 0.54, "--and", VS, 0.02, 0.021, "--points", 2),
    "loop": (*GAIN, "--gain", 0.4),
    "remedies": ("--gain", 0.04, "--only", "dead band, feedforward"),
    "equilibria": (*GAIN, "--model", "lugre"),
    "map": (*GAIN, "--from", 1e-4, "--to", 0.1, "--points", 20),
    "basin": GAIN,
    "simulate": (*GAIN, "--time", 20),
    "record": (ROOT / "tests" / "design" / "no such record.csv",),
    "identify": (ROOT / "tests" / "design" / "no such record.csv",),
    "cure": (ROOT / "tests" / "design" / "no such record.csv",),
    "uncertainty": ("--uncertainty", SET, "--samples", 2),
    "tune": ("--uncertainty", SET),
    "explore": (),
    "glossary": (),
}  # fmt: skip
"""A quick command line of each."""
SLOW = {"tune"}
ENDLESS = {"explore"}
"""They end with Ctrl-C."""


@pytest.fixture(scope="module")
def record(tmp_path_factory) -> Path:
    """A motion as if it were measured."""
    path = tmp_path_factory.mktemp("record") / "a record with a name of some length that is printed back.csv"
    assert cli.main(["simulate", "--gain", "0.04", "--csv", str(path), "--step", "0.05", "--quiet"]) == 0
    return path


def words_of(command: str, record: Path, out: Path) -> list[object]:
    words = [record, "--gain", 0.04] if command in ("record", "identify", "cure") else list(COMMANDS[command])
    words += ["--free", "friction.static", "--only", "leak"] if command == "cure" else []
    return [command, *words, "--quiet", *(["--out", out] if command == "diagram" else [])]


def test_every_command_is_here():
    assert set(COMMANDS) == set(cli.COMMANDS)


@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=[pytest.mark.slow] if c in SLOW else []) for c in COMMANDS if c not in ENDLESS]
)
def test_results_fit_and_are_explained(capsys, tmp_path, monkeypatch, command, record):
    """No line is longer than 80 columns; every word of the trade has its sentence, once, below the result."""
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *words_of(command, record, Path("out")))
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 80
    result, _, explained = " ".join(out.split()).partition(MEANINGS)
    if command == "glossary":
        assert all(f"{word}: {text}" in result for word, text in GLOSSARY.items())
        return
    used = [word for word in words_in(result) if f"{word} at gain" not in result]  # a special point says what it is
    for word in used:
        assert explained.count(f"{word}: {GLOSSARY[word]}") == 1, word
    assert bool(explained) == bool(used)


@pytest.mark.parametrize("command", ["", *cli.COMMANDS])
def test_help_fits_and_is_explained(capsys, monkeypatch, command):
    """Also on a wide terminal; what must be given stands under a heading of its own, and in no bracket."""
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit):
        cli.main([*([command] if command else []), "--help"])
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    body, _, explained = text.partition(MEANINGS)
    for word in words_in(body):
        assert f"{word}: {GLOSSARY[word]}" in " ".join(explained.split())
    usage, *sections = body.split("\n\n")
    required = next((s for s in sections if s.startswith("required:")), "")
    needed = {"fold-curve", "fold-map", "uncertainty"}
    assert bool(required) == (command in needed)
    assert not required or sections.index(required) < next(i for i, s in enumerate(sections) if s[:8] == "options:")
    for option in re.findall(r"^  (--[\w-]+)", required, re.MULTILINE):
        assert option in usage and f"[{option} " not in usage
    assert ", required" not in text


AS_IT_STANDS = "1 takes kp, ki and kd of a servo file as they stand"
REQUIRED = [
    ("orbit", [], "gain", f"--gain 0.1; {AS_IT_STANDS}"),
    ("loop", [], "gain", f"--gain 0.1 --gain 0.4; {AS_IT_STANDS}"),
    ("fold-curve", ["--vary", "friction.static"], "from, to", "--from 0.5 --to 0.6"),
    ("fold-map", [], "vary, and", "--vary friction.static 0.5 0.6 --and servo.inertia 0.02 0.03"),
    ("uncertainty", [], "uncertainty", "--uncertainty friction.toml"),
]


@pytest.mark.parametrize(("command", "words", "missing", "example"), REQUIRED)
def test_what_is_missing_is_said_with_an_example(capsys, command, words, missing, example):
    code, out, err = run(capsys, command, *words)
    says = f"{missing}: must be given, for example {example} (see casahunt {command} --help)"
    assert (code, out, err) == (2, "", f"casahunt {command}: {says}\n")


def test_a_positional_that_is_missing(capsys):
    assert run(capsys, "record") == (2, "", "casahunt record: F.csv: must be given (see casahunt record --help)\n")


# CSV: every command with a table --------------------------------------------------------------------------------


WORDS = {"model", "branch", "status", "unit", "parameter", "quantity", "kind", "stable", "special", "outcome", "mode",
         "from", "first", "second", "remedy", "why"}  # fmt: skip
PLAIN = {"half_multiplier", "half_multiplier_error", "trivial_multiplier_error", "elasticity", "error_estimate", "gain",
         "value", "first_value", "second_value", "slope", "measured", "error", "scatter", "predicted",
         "predicted_error", "ratio", "swing", "sample", "threshold", "damping_ratio", "lowest_factor",
         "highest_factor", "slope_V_per_rad_per_unit", "size", "size_error", "recommended", "worst_size", "low",
         "high"}  # fmt: skip
UNIT = re.compile(r"_(rad|s|V_per_rad|per_s|deg|Nm|rad_per_s|rad_s|kg_m2|V|N?ms?_per_rad|Nms?_per_rad(_s)?|(re|im))$")
WITH_CSV = [command for command in COMMANDS if command not in ("diagram", "explore", "glossary")]


@pytest.mark.parametrize("command", [pytest.param(c, marks=[pytest.mark.slow] if c in SLOW else []) for c in WITH_CSV])
def test_every_table_has_a_file(capsys, tmp_path, command, record):
    """Columns name their units, numbers have all their digits, and stand as they are in the JSON object."""
    path = tmp_path / "table.csv"
    code, out, _ = run(capsys, *words_of(command, record, tmp_path), "--json", "--csv", path)
    assert code == 0
    header, *rows = csv.reader(path.read_text(encoding="ascii").splitlines())
    assert rows and all(len(row) == len(header) for row in rows)
    for name in header:
        assert name in WORDS | PLAIN or UNIT.search(name) or name.startswith(("multiplier_", "moves_with_")), name
    found = {name: [row[i] for row in rows] for i, name in enumerate(header)}
    for name in set(header) - WORDS:
        for text in found[name]:
            assert text == repr(float(text)) or name in ("swing", "sample"), (name, text)
    numbers = {repr(value) for value in leaves(one_json(out)) if isinstance(value, float)}
    main = {
        "orbit": "period_s", "fold": "elasticity", "fold-curve": "gain", "fold-map": "gain", "loop": "pole_1_re_per_s",
        "equilibria": "largest_real_part_per_s", "map": "stick_position_rad", "basin": "stick_position_rad",
        "record": "measured", "tune": "value",
    }.get(command)  # fmt: skip
    if main:
        assert {text for text in found[main][:4] if math.isfinite(float(text))} <= numbers | {"0.0"}


def leaves(value: object) -> list[object]:
    if isinstance(value, dict):
        return [leaf for item in value.values() for leaf in leaves(item)]
    if isinstance(value, list):
        return [leaf for item in value for leaf in leaves(item)]
    return [value]


def test_errors_stand_in_the_unit_of_their_number(capsys, tmp_path):
    path = tmp_path / "orbit.csv"
    said = one_json(run(capsys, "orbit", "--gain", 0.1, "--json", "--quiet", "--csv", path)[1])
    header, row = csv.reader(path.read_text().splitlines())
    cells = dict(zip(header, row, strict=True))
    orbit = find_orbit(Servo(), "switch", 0.1)
    assert float(cells["amplitude_error_rad"]) == pytest.approx(orbit.amplitude * orbit.amplitude_error)
    assert float(cells["period_error_s"]) == pytest.approx(orbit.period * orbit.period_error)
    relative = (orbit.amplitude_error, orbit.period_error)
    assert max(relative) == pytest.approx(said["error_estimate"]) and min(relative) > 0


def test_the_samples_are_those_of_the_quantiles(capsys, tmp_path):
    path = tmp_path / "samples.csv"
    words = ("uncertainty", "--uncertainty", SET, "--samples", 3, "--json", "--quiet", "--csv", path)
    said = one_json(run(capsys, *words)[1])
    rows = list(csv.DictReader(path.read_text().splitlines()))
    gains = sorted(float(row["fold_gain_V_per_rad"]) for row in rows)
    for row in rows:
        assert float(row["fold_gain_error_V_per_rad"]) == pytest.approx(1e-6 * float(row["fold_gain_V_per_rad"]))
    quantiles = said["samples"]["quantiles"]
    assert (gains[0], gains[1], gains[2]) == (quantiles["min"], quantiles["50%"], quantiles["max"])


# The parts ------------------------------------------------------------------------------------------------------


def test_long_lines_are_folded_below_their_text():
    line = "  because          " + "word " * 30 + "a = 0.001 rad"
    parts = wrapped(line)
    assert all(len(part) <= LINE_WIDTH for part in parts)
    assert all(part.startswith(" " * 19 + "word") for part in parts[1:-1])
    assert " ".join(" ".join(parts).split()) == " ".join(line.split())
    for width in range(20, 80):  # neither a number and its unit nor the two sides of "=" are parted
        assert any("a = 0.001 rad" in part for part in wrapped("x " * 30 + "a = 0.001 rad", width))
    path = "written to /" + "x" * 100
    assert wrapped(path) == ["written to", "  /" + "x" * 100]  # can be copied
    assert wrapped("short") == ["short"] and wrapped("x" * 80) == ["x" * 80]


def test_words_are_found_and_names_are_not():
    assert words_in("two Folds of a half multiplier, pseudo-arclength") == ["fold", "half multiplier", "arclength"]
    assert words_in("casahunt fold-curve, --multipliers, fold.png, unfolded, xfold") == []
    assert words_in("(the fold's place)") == ["fold"]
    assert words_in("a half multiplier") == ["half multiplier"]  # not the multiplier in it
    assert meanings(["the fold"], said=["fold"]) == [] == meanings(["nothing"])
    assert set(OTHER_FORMS) | set(FAMILIAR) <= set(GLOSSARY) and sorted(GLOSSARY, key=str.lower) == list(GLOSSARY)
    for word, text in GLOSSARY.items():
        assert text.endswith(".") and len(text.split()) < 45, word


def test_the_page_of_the_documentation_is_made_of_it():
    """Made again by `print(casahunt.views.glossary.glossary_page(), end="")`."""
    assert (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8") == glossary_page()


def test_a_word_of_the_glossary(capsys):
    assert run(capsys, "glossary", "fixed", "Point")[1].startswith("fixed point: ")
    assert one_json(run(capsys, "glossary", "fold", "--json")[1]) == {"fold": GLOSSARY["fold"]}
    code, out, err = run(capsys, "glossary", "fould")
    assert (code, out) == (2, "") and "did you mean 'fold'?" in err and err.count("\n") == 1


def test_every_parameter_has_its_unit():
    assert set(PARAMETER_UNITS) == {*KEYS, "gain"}
    assert named("friction.viscous") == "friction.viscous [N m s/rad]"
    assert named("controller.kp") == "controller.kp"
    assert column("servo.motor_gain") == "servo.motor_gain_Nm_per_V"
    assert column("controller.ki") == "controller.ki_per_s"


def test_no_digit_stands_beyond_the_error():
    """The last digit is worth more than a fifth of the error, whatever the number; an unknown number is 0."""
    for error in (3e-1, 1e-2, 2e-5, 7e-9):
        for x in (1.0, -math.pi, 9.99999, 2.7e-7, 6.02e23):
            mantissa, _, exponent = to_error(x, error).partition("e")
            unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
            assert abs(float(to_error(x, error)) - x) <= 2 * error * abs(x)
            assert unit > 0.2 * error * abs(x) or "." not in mantissa
    assert to_absolute_error(1e-18, 1e-9) == "0" and to_absolute_error(-0.12345, 1e-3) == "-0.123"


SERVO = Servo()
SAME = {
    "orbit --gain 0.1": (lambda: casahunt.find_orbit(SERVO, "switch", 0.1), None),
    "orbit --gain 0.1 --full": (
        lambda: casahunt.find_orbit(SERVO, "switch", 0.1, options=casahunt.Options(half=False)), None,
    ),
    "fold": (lambda: casahunt.find_fold(SERVO, "switch"), None),
    "loop --gain 0.1": (lambda: casahunt.linear_loop(SERVO, 0.1), "loops"),
    "equilibria --gain 0.1": (lambda: casahunt.equilibria(SERVO, "switch", 0.1), None),
    "equilibria --gain 0.1 --model lugre": (lambda: casahunt.equilibria(SERVO, "lugre", 0.1), None),
    "map --gain 0.6 --from 1e-3 --to 3e-3 --points 10": (
        lambda: casahunt.fixed_points(SERVO, 0.6, 1e-3, 3e-3, points=10), None,
    ),
    "basin --gain 0.5": (lambda: casahunt.basin(SERVO, "switch", 0.5), None),
    "simulate --gain 0.04 --time 20": (lambda: casahunt.simulate(SERVO, "switch", 0.04, time=20.0), None),
    "fold-curve --model switch --vary friction.static --from 0.53 --to 0.54 --points 2": (
        lambda: casahunt.fold_curve(SERVO, "switch", vary="friction.static", start=0.53, end=0.54, points=2), "curves",
    ),
    "fold-map --vary friction.static 0.5 0.53 --and friction.coulomb 0.44 0.51 --points 2": (
        lambda: casahunt.fold_map(
            SERVO, "switch", ("friction.static", "friction.coulomb"), [0.5, 0.53], [0.44, 0.51],
        ), None,
    ),
}  # fmt: skip
"""By command: the result, and the list that it is the first entry of."""


def but_times(value: object) -> object:
    """A value without the times in it."""
    if isinstance(value, dict):
        return {key: but_times(item) for key, item in value.items() if key != "wall_s"}
    return [but_times(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("command", SAME)
def test_the_object_and_the_table_are_those_of_the_result(command, capsys, tmp_path):
    make, within = SAME[command]
    made = make()
    table = tmp_path / "table.csv"
    assert main([*command.split(), "--json", "--quiet", "--csv", str(table)]) == 0
    printed = json.loads(capsys.readouterr().out)
    printed = but_times(printed[within][0] if within else printed)
    mapping = but_times(json.loads(json.dumps(made.to_dict(table=False))))
    assert {key: printed[key] for key in mapping} == mapping
    if command.startswith("orbit"):  # a row of its numbers; the table of an orbit is its motion
        (row,) = csv.DictReader(table.read_text().splitlines())
        assert float(row["period_s"]) == made.period
        return
    (casahunt.fold_sensitivities(made) if command == "fold" else made).to_csv(tmp_path / "own.csv")
    assert table.read_text() == (tmp_path / "own.csv").read_text()
