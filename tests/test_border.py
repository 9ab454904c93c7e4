"""Hostile input and surroundings: one sentence, the right exit code, at once; what long commands say meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from casahunt import InputError, Servo, cli, find_fold, find_orbit, simulate
from casahunt.checks import LARGEST, SMALLEST, moderate, quoted, sensible, to_error, to_error_beside
from casahunt.design.tune.demands import Demands
from casahunt.servo.event_map.fixed_points import fixed_points
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.views.commands import progress
from problems.taylor import switch_half_cycle

ROOT = Path(__file__).parents[1]
FILES = {
    "digits.toml": "[servo]\ninertia = " + "1" * 5000,
    "brackets.toml": "[servo]\ninertia = " + "[" * 20000 + "]" * 20000,
    "zeros.toml": '[covariance]\nnames = ["friction.static"]\nmatrix = [[1' + "0" * 400 + "]]",
    "large.toml": '[covariance]\nnames = ["friction.static"]\nmatrix = [[1e308]]',
    "interval.toml": '[interval]\n"friction.static" = [0.5, 1' + "0" * 400 + "]",
    "good.toml": '[interval]\n"friction.static" = "1%"',
    "cell.csv": "time,position\n0,0\n1," + "1" * 140_000 + "\n",
    "quoted.csv": 'time,position\n0,0\n1,"' + "a" * 140_000 + '"\n',
    "huge.csv": "time,position\n0,0\n1,1e308\n2,0\n",
    "tiny.csv": "time,position\n0,0\n1,1e-320\n2,0\n",
}
BETWEEN = "must be between 1e-12 and 1e+12 in SI units"
WHY = "leave the range of double arithmetic"
WITH_GAIN = ["orbit", "loop", "equilibria", "map", "basin", "simulate"]
HOSTILE = [
    *(([c, "--gain", g], [f"gain = {float(g):g}", BETWEEN, WHY]) for c in WITH_GAIN for g in ("5e-324", "1.7e308")),
    *(
        ([*c, "--set", f"{key}={value}"], [f"{key} = {value}", BETWEEN, WHY])
        for c in (["fold"], ["tune"], ["basin", "--gain", "0.1"], ["diagram", "--out", "new"])
        for key, value in (("controller.integral_time", "1e+300"), ("friction.static", "1e+308"))
    ),
    (["loop", "--gain", "1e300"], ["gain = 1e+300", BETWEEN]),
    (["diagram", "--from", "5e-324", "--out", "new"], ["from = 4.94066e-324", BETWEEN]),
    (["fold-curve", "--vary", "friction.static", "--from", "0.5", "--to", "1e300"], ["static = 1e+300", BETWEEN]),
    (["map", "--gain", "0.1", "--to", "1e300"], ["to = 1e+300", BETWEEN]),
    (["simulate", "--gain", "0.1", "--time", "1e300"], ["time = 1e+300", BETWEEN]),
    (["simulate", "--gain", "0.1", "--position=-1e300"], ["position = -1e+300", "between -1e+12 and 1e+12"]),
    (["tune", "--margin", "1e300"], ["margin = 1e+300: must be at most 1e+06"]),
    (["tune", "--gain-margin", "1e300"], ["gain-margin = 1e+300: must be at most 1e+06"]),
    (["tune", "--delay", "1e300"], ["delay = 1e+300", "0 or between 1e-12 and 1e+12"]),
    (["tune", "--bounds", "gain=1e-300,1"], ["bounds gain = 1e-300", BETWEEN]),
    (["fold", "digits.toml"], ["'digits.toml': cannot be read: it holds a number of too many digits"]),
    (["fold", "brackets.toml"], ["'brackets.toml': cannot be read: its brackets are nested too deeply"]),
    *(
        (["uncertainty", "--uncertainty", name, *more], parts)
        for name, more, parts in (
            ("zeros.toml", [], ["covariance: must be a matrix of numbers"]),
            ("large.toml", [], ["covariance: must be", "finite numbers up to 1e+24"]),
            ("interval.toml", [], ["friction.static = 1000", "...", "must be a finite number"]),
            ("good.toml", ["--samples", "1000000000000"], ["samples = 1000000000000: must be at most 1000000"]),
            ("good.toml", ["--samples", "1" * 5000], ["samples = '1111", "must be a whole number"]),
        )
    ),
    (["orbit", "--gain", "1" * 5000], ["gain = 1111", "...", "must be a finite number"]),
    (["record", "cell.csv"], ["line 3", "cannot be read"]),
    (["record", "quoted.csv"], ["line 3", "field larger than field limit"]),
    (["record", "huge.csv"], ["positions must lie in", "1e+308"]),
    (["record", "tiny.csv"], ["positions must lie in", "not near 9.99989e-321"]),
    (["record", "huge.csv", "--set-point", "1e300"], ["set-point = 1e+300", "between -1e+12 and 1e+12"]),
]


@pytest.mark.parametrize(("words", "parts"), HOSTILE, ids=[" ".join(words)[:60] for words, _ in HOSTILE])
def test_hostile_input(capsys, tmp_path, monkeypatch, words, parts):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text + "\n")
    monkeypatch.chdir(tmp_path)
    began = time.process_time()
    code = cli.main(words)
    took = time.process_time() - began
    out, err = capsys.readouterr()
    assert (code, out) == (2, "") and err.count("\n") == 1 and len(err) < 400
    assert err.startswith(f"casahunt {words[0]}: ")
    for part in parts:
        assert part in err
    assert took < 1
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)


APART = "cycles are computed up to a factor of 6.7e+07 between them"
ENDS = [
    *(
        ([*command, "--set", f"{key}={value}"], 2, [part, APART])
        for command in (["fold"], ["orbit", "--gain", "0.1"])
        for key, value, part in (
            ("servo.inertia", "1e-12", "takes 2.2e-13 s"),
            ("servo.inertia", "1e12", "takes 2.2e+11 s"),
            ("friction.stribeck_velocity", "1e-12", "the drop of the friction curve"),
            ("friction.stribeck_velocity", "1e12", "the drop of the friction curve"),
            ("friction.static", "0.44000000000044", "the drop of the friction curve"),
            ("friction.viscous", "1e12", "viscous friction"),
            ("controller.lead_time", "1e12", "the controller's times are 1e+12 s together"),
        )
    ),
    (["fold", "--set", "controller.lead_time=1e-9"], 2, ["the shorter one alone takes 1e-09 s", APART]),
    (["orbit", "--gain", "1e-12"], 2, ["the controller at gain 1e-12 takes 3.1e+09 s", APART]),
    (["basin", "--gain", "0.1", "--set", "servo.motor_gain=1e-12"], 2, ["the controller at gain 0.1 takes", APART]),
    (["fold", "--model", "lugre", "--set", "friction.stiffness=1e12"], 2, ["the bristle (coulomb/(stiff", APART]),
    (["fold", "--model", "lugre", "--set", "friction.stiffness=1e-12"], 2, ["the bristle (coulomb/(stiff", APART]),
    (["fold", "--model", "lugre", "--set", "friction.damping=1e12"], 2, ["the damping of the bristle", APART]),
    # Far above the fold no motion has to be computed to say so.
    (["orbit", "--gain", "1e12"], 1, ["no hunting limit cycle", "up to gain 0.6473 V/rad, and not above"]),
    (["basin", "--gain", "1e12"], 1, ["no hunting limit cycle", "up to gain 0.6473 V/rad, and not above"]),
]


@pytest.mark.parametrize(("words", "code", "parts"), ENDS, ids=[" ".join(words) for words, *_ in ENDS])
def test_ends_of_the_ranges(capsys, words, code, parts):
    """Not products but times leave double arithmetic: one sentence, at once."""
    began = time.process_time()
    assert cli.main([*words, "--quiet"]) == code
    assert time.process_time() - began < 1
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and all(part in err for part in parts), err


def test_ranges_of_times_spare_what_can_be_computed():
    """A lead time that does nothing, no lead time, next to no viscous friction, next to no Coulomb friction."""
    for change in ({"controller.lead_time": 1e-12}, {"friction.viscous": 1e-12}, {"friction.coulomb": 1e-12}):
        assert find_orbit(Servo().replace(**change), "switch", 0.1).status.ok
    alone = Servo().replace(**{"controller.lead_time": 0})
    fold = find_fold(alone, "switch")
    a, h = fold.orbit.amplitude, 1e-4
    inner, there, outer = (switch_half_cycle(alone, fold.gain, x)[0] for x in (a * (1 - h), a, a * (1 + h)))
    assert there == pytest.approx(a, rel=1e-9)  # by Taylor series: a fixed point of the event map, of slope one
    assert (outer - inner) / (2 * h * a) == pytest.approx(1, abs=1e-5)


def test_library_has_the_same_border():
    servo = Servo()
    for call in (
        lambda: linear_loop(servo, 1e300),
        lambda: simulate(servo, "switch", 5e-324),
        lambda: simulate(servo, "switch", 0.1, time=1e300),
        lambda: simulate(servo, "switch", 0.1, velocity=-1e300),
        lambda: fixed_points(servo, 1e60),
        lambda: fixed_points(servo, 0.1, 1e-60),
        lambda: Demands(sample_time=1e-13),
    ):
        with pytest.raises(InputError, match="double arithmetic"):
            call()


def test_ranges():
    assert sensible("x", SMALLEST) == SMALLEST and sensible("x", LARGEST) == LARGEST
    assert sensible("x", 0, zero=True) == 0 and moderate("x", -LARGEST) == -LARGEST
    assert sensible("x", 1e48, power=4) == 1e48 and moderate("x", -1e48, power=4) == -1e48
    for wrong in (0.0, -1.0, 1e-13, 1e13, float("nan")):
        with pytest.raises(InputError):
            sensible("x", wrong)
    assert len(quoted("x" * 10_000)) < 70 and quoted("abc") == "'abc'"


def test_digits_follow_the_error():
    """The shown number is off by no more than the error for being rounded, and has no digit far below the error."""
    random = np.random.default_rng(5)
    for x, error in 10.0 ** np.column_stack([random.uniform(-6, 6, 200), random.uniform(-11.5, -3, 200)]):
        shown = to_error(-x, error)
        assert abs(float(shown) + x) <= error * x * (1 + 1e-9)
        place = Decimal(shown).normalize().as_tuple().exponent  # of the last digit that is not 0
        assert 10.0**place > 0.2 * error * x
    assert to_error(0.647339163, 1.2e-7) == "0.6473392"
    assert (to_error(123456.0, 0.5), to_error(0.0, 0.1)) == ("1e+05", "0")


@pytest.mark.parametrize(
    ("other", "shown"),
    [(1.0, "0.6474"), (0.6, "0.6474"), (0.64737, "0.6474"), (0.64739, "0.64738"), (0.6474, "0.64738")],
)
def test_a_number_beside_another_has_the_digits_that_tell_them_apart(other, shown):
    assert to_error_beside(0.64738, 1e-9, other, 4) == shown


# The surroundings of a process -----------------------------------------------------------------------------------


def process(words: list[str], folder: Path, **kwargs) -> subprocess.CompletedProcess:
    """The program in a process of its own; `shell` redirects its streams."""
    shell, more = kwargs.pop("shell", ""), kwargs.pop("env", {})
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", **more}
    command = [sys.executable, *kwargs.pop("start", ["-m", "casahunt"]), *words]
    if shell:
        command = ["sh", "-c", f'exec "$@" {shell}', "sh", *command]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace")


@pytest.mark.skipif(os.name != "posix", reason="a shell")
def test_closed_output(tmp_path):
    """Results that nobody can read are no results; a closed standard error does not mix progress into them."""
    done = process(["loop", "--gain", "0.1", "--plot", "a.png"], tmp_path, shell=">&-")
    assert done.returncode == 1
    assert done.stderr == "casahunt loop: the output could not be written: standard output is closed\n"
    assert not list(tmp_path.iterdir())
    done = process(["fold", "--json"], tmp_path, shell="2>&-")
    assert done.returncode == 0 and done.stdout.startswith("{") and done.stdout.count("\n") == 1
    done = process(["loop", "--gain", "nan"], tmp_path, shell=">&- 2>&-")
    assert done.returncode == 1
    # No file that is opened later takes the place of a closed stream.
    code = "from casahunt.views.commands.console import own_process; own_process(); print(open('a.txt', 'w').fileno())"
    done = process([code], tmp_path, shell="<&- 2>&-", start=["-c"])
    assert int(done.stdout) > 2


def test_gains_that_a_computation_comes_upon_are_no_input(capsys):
    """A servo at the end of the range has its cycles at gains beyond it."""
    code = cli.main(["basin", "--gain", "0.1", "--set", "servo.motor_gain=1e12"])
    assert code != 2 and "double arithmetic" not in capsys.readouterr().err


def test_backend_that_does_not_exist(tmp_path):
    surroundings = {"MPLBACKEND": "nonsense", "PYTHONIOENCODING": "ascii"}
    done = process(["loop", "--gain", "0.1", "--plot", "tü.png"], tmp_path, env=surroundings)
    assert (done.returncode, done.stderr) == (0, "") and (tmp_path / "tü.png").stat().st_size > 10_000


def test_names_that_the_output_cannot_show(tmp_path):
    t = np.arange(0, 60, 0.1)
    np.savetxt(tmp_path / "tü.csv", np.column_stack([t, np.sin(t)]), delimiter=",", header="time,position", comments="")
    done = process(["record", "tü.csv"], tmp_path, env={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0 and done.stderr == "" and done.stdout.startswith("record t\\xfc.csv: hunting, ")


def test_warnings_of_numpy_are_not_for_the_user(tmp_path):
    """Of the program only, and of the processes that it starts: a library leaves them to its caller."""
    code = (
        "import sys, warnings, subprocess; from casahunt.views.commands.console import own_process; own_process()\n"
        "import numpy as np; np.float64(1e308) * np.float64(1e308); print(subprocess._args_from_interpreter_flags())"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stderr == "" and "-Wignore::RuntimeWarning" in done.stdout


# Where long commands are -------------------------------------------------------------------------------------------


def test_uncertainty_says_where_it_is(capsys, tmp_path, telling_at_once):
    (tmp_path / "set.toml").write_text('[interval]\n"friction.static" = "0.2%"\n')
    assert cli.main(["uncertainty", "--uncertainty", str(tmp_path / "set.toml"), "--samples", "2", "--details"]) == 0
    err = capsys.readouterr().err
    assert "2 of 2 samples solved" in err and "searching the worst corner: fold 1" in err


@pytest.mark.slow
def test_tune_says_where_it_is(capsys, tmp_path, telling_at_once):
    (tmp_path / "set.toml").write_text('[interval]\n"friction.static" = "0.2%"\n')
    assert cli.main(["tune", "--uncertainty", str(tmp_path / "set.toml"), "--details"]) == 0
    err = capsys.readouterr().err
    for part in ("searching the worst servo", "folds of the set", "motions of the event map", "simulating the tasks"):
        assert part in err
    assert cli.main(["tune", "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_lines_come_every_few_seconds(capsys, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    progress.begin(every=True)
    tell = progress.teller()
    for i in range(50):
        clock[0] = i * 0.1
        tell(f"{i}")
    assert [float(line) for line in capsys.readouterr().err.split()] == [20, 40]
