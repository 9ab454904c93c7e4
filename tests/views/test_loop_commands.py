"""The commands on a file that holds a loop of parts."""

from __future__ import annotations

import csv
import math
import re

import numpy as np
import pytest
from command_line import is_picture, one_json, run

from casahunt import Drive, Servo, find_fold, load_branch, simulate_sampled
from casahunt.servo.parts import load_loop
from casahunt.views.commands.diagram import PICTURES

PLAIN = ["one inertia", "Switch friction", "PID by times", "integrator"]
FOLD, BAND, LEAK = 0.647339084, 0.0433457242337, 0.246844841
"""Folds of the plain servo (problems/table1.py), and by independent event maps [V/rad], [rad], [1/s]."""


@pytest.fixture
def loop_file(tmp_path):
    def write(*parts, **values):
        path = tmp_path / "loop.toml"
        lines = [f"{name} = {value}" for name, value in values.items()]
        names = ", ".join(f'"{part}"' for part in (*PLAIN, *parts))
        path.write_text("\n".join([f"[loop]\nparts = [{names}]", "[values]", *lines]))
        return path

    return write


@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_the_plain_servo_as_a_loop_has_its_cycles(capsys, loop_file, branch):
    words = "--gain", 0.4, "--tol", "1e-9", "--json", "--quiet", "--branch", branch
    plain = one_json(run(capsys, "orbit", *words)[1])
    code, out, err = run(capsys, "orbit", loop_file(), *words)
    found = one_json(out)
    assert (code, err, found["stable"], found["branch"]) == (0, "", branch == "stable", branch)
    assert found["gain"] == 0.4 and found["parts"] == PLAIN and found["parameters"]["static"] == 0.53
    for key in ("amplitude", "period"):
        assert found[key] == pytest.approx(plain[key], rel=2e-9)
    assert found["half_multiplier"] == pytest.approx(plain["half_multiplier"], rel=1e-6)


def test_a_gain_at_which_no_motion_from_rest_settles(capsys, loop_file):
    """Next to the fold hardly any does: the cycle is that of a smaller gain, followed; beyond it there is none.

    The leak takes 1e-8 of the integrator's sum in a period; a loop without one is a servo, and asked as that.
    """
    path = loop_file("leak", leak=5e-10)
    code, out, _ = run(capsys, "orbit", path, "--gain", 0.6473, "--quiet", "--json")
    assert code == 0 and one_json(out)["period"] == pytest.approx(20.42, abs=0.05)
    code, out, err = run(capsys, "orbit", path, "--gain", 0.65)
    assert (code, out) == (1, "") and re.search(r"gain 0\.65: no motion settles .*: fold at gain = 0\.64733", err)
    code, out, err = run(capsys, "orbit", loop_file(), "--gain", 0.65)
    assert (code, out) == (1, "") and "can hunt up to gain 0.6473 V/rad, and not above" in err


def test_the_lines_the_table_the_picture_and_the_file_of_a_cycle(capsys, loop_file, tmp_path):
    path, written = loop_file("leak", leak=0.1), [tmp_path / name for name in ("o.csv", "o.png", "o.npz")]
    files = [word for pair in zip(("--csv", "--plot", "--save"), written, strict=True) for word in pair]
    words = "--gain", 0.04, "--set", "leak=0.2", "--multipliers", "integrator", "--details"
    code, out, err = run(capsys, "orbit", path, *words, *files)
    lines = out.splitlines()
    assert code == 0 and lines[0] == "loop at gain 0.04 V/rad: hunts"
    assert "  parts            one inertia, Switch friction, PID by times, integrator, leak" in lines
    assert "by integrators" in out and re.match(r"loop    K = 0\.04 +amplitude = 0\.0342", err)
    (row,) = csv.DictReader(written[0].read_text(encoding="ascii").splitlines())
    assert (float(row["leak"]), float(row["gain"]), row["stable"]) == (0.2, 0.04, "True")
    assert float(row["amplitude_rad"]) == pytest.approx(0.034276, abs=1e-6)
    assert is_picture(written[1])
    from casahunt.orbits import load_orbit

    system = load_loop(path).replace(leak=0.2).system
    assert load_orbit(written[2], system).period == float(row["period_s"])


@pytest.mark.parametrize(("parts", "values", "vary", "way", "truth", "off"), [
    ((), {}, "gain", "up", FOLD, 1e-8),
    (("dead band",), {"dead_band": 0.02}, "dead_band", "up", BAND, 1e-9),
    (("leak",), {"leak": 0.1}, "leak", "up", LEAK, 1e-8),
])  # fmt: skip
def test_folds_in_any_parameter(capsys, loop_file, parts, values, vary, way, truth, off):
    words = "--vary", vary, "--tol", "1e-9", "--json", "--quiet"
    code, out, _ = run(capsys, "fold", loop_file(*parts, **values), *words)
    found = one_json(out)
    assert code == 0 and (found["parameter"], found["way"]) == (vary, way)
    assert found["value"] == pytest.approx(truth, rel=off) and found["parameters"][vary] == found["value"]
    assert found["confirmed_value"] == pytest.approx(truth, rel=off)
    if vary == "gain":  # exact: only the product with the gain counts
        assert found["elasticities"]["motor_gain"] == pytest.approx(-1)


@pytest.mark.slow
def test_hunting_ends_downwards_in_the_static_friction(capsys, loop_file):
    """Where it does, the servo's own fold gain is the gain of the loop."""
    words = "--vary", "static", "--tol", "1e-9", "--json", "--quiet"
    found = one_json(run(capsys, "fold", loop_file(gain=0.1), *words)[1])
    assert found["way"] == "down" and 0.44 < found["value"] < 0.53
    servo = Servo().replace(**{"friction.static": found["value"]})
    assert find_fold(servo, "switch").gain == pytest.approx(0.1, rel=1e-7)


def test_the_lines_of_a_fold(capsys, loop_file, tmp_path):
    words = "--vary", "dead_band", "--details", "--csv", tmp_path / "f.csv", "--plot", tmp_path / "f.png"
    code, out, err = run(capsys, "fold", loop_file("dead band", dead_band=0.02), *words)
    assert code == 0 and out.startswith("loop: the hunting that was followed goes up to dead_band 0.04335 rad\n")
    assert "  dead_band there  0.04334572" in out and "\n  parts " in out
    assert "  one per cent more of        changes that dead_band by" in out
    assert err.startswith("loop    dead_band = 0.0433457") and is_picture(tmp_path / "f.png")
    rows = {row["parameter"]: row for row in csv.DictReader((tmp_path / "f.csv").read_text().splitlines())}
    assert float(rows["gain"]["elasticity"]) == pytest.approx(float(rows["motor_gain"]["elasticity"]))
    assert float(rows["gain"]["fold_dead_band_rad"]) == pytest.approx(BAND, rel=1e-6)


@pytest.mark.slow
def test_the_diagram_of_a_loop(capsys, loop_file, tmp_path):
    """Up, round the fold and back, where the cycle is the unstable one; what is written is whole."""
    out_folder, path = tmp_path / "drawn", loop_file("leak", leak=0.2)
    words = "--vary", "leak", "--out", out_folder, "--tol", "1e-7", "--details"
    code, out, err = run(capsys, "diagram", path, *words)
    assert code == 0 and re.match(r"loop: \d+ cycles along leak; leak reached 0\.2, the end of the range\n", out)
    assert "fold at leak = 0.24684" in out and f"written to {out_folder}" in " ".join(out.split())
    rows = list(csv.DictReader((out_folder / "loop.csv").read_text().splitlines()))
    values = [float(row["leak"]) for row in rows]
    assert values[0] == values[-1] == 0.2 and max(values) == pytest.approx(LEAK, rel=1e-2)
    seen = [row["stable"] for row in rows]
    assert seen[0] == "True" and "False" in seen and seen[-1] != "True"  # where it is not to be trusted, it is left out
    written = load_branch(out_folder / "loop.npz", load_loop(path))
    (fold,) = written.special
    assert fold.kind == "fold" and fold.value == pytest.approx(LEAK, rel=1e-6)
    assert [row["special"] for row in rows] == [kind for _, kind in written.along()]
    assert len([line for line in err.splitlines() if line.startswith("loop    leak = ")]) == len(written.orbits)
    pictures = [name for name in PICTURES if is_picture(out_folder / name)]
    assert sorted(path.name for path in out_folder.iterdir()) == sorted([*pictures, "loop.csv", "loop.npz"])
    code, out, _ = run(capsys, "diagram", path, *words, "--to", 0.19, "--from", 0.21, "--json", "--quiet")  # over it
    (branch,) = one_json(out)["branches"]
    assert code == 0 and branch["ended"] == "leak reached 0.19, the end of the range" and branch["special"] == []


def test_the_step_of_the_plain_servo_as_a_loop(capsys, loop_file):
    words = "--gain", 0.04, "--time", 40, "--tol", "1e-9", "--json", "--quiet"
    plain = one_json(run(capsys, "simulate", *words)[1])
    code, out, err = run(capsys, "simulate", loop_file(), *words)
    found = one_json(out)
    assert (code, err, found["verdict"], found["status"]) == (0, "", "hunting", "converged")
    assert found["start"] == {"x1": -1.0, "x2": 0.0, "x3": 0.0}
    assert found["end"]["x1"] == pytest.approx(plain["position"] - 1, abs=1e-9)
    assert found["end"]["x3"] == pytest.approx(plain["integral"], abs=1e-9)
    assert [event[1:4] for event in found["events"]] == [event[1:4] for event in plain["events"]]
    assert [event[0] for event in found["events"]] == pytest.approx([event[0] for event in plain["events"]], abs=1e-8)
    cycle = one_json(run(capsys, "orbit", "--gain", 0.04, "--json", "--quiet")[1])
    assert [found["period"], found["amplitude"]] == pytest.approx([cycle["period"], cycle["amplitude"]], rel=1e-4)
    assert found["peak_torque"] == pytest.approx(16 * found["peak_voltage"])
    assert found["peak_torque"] == pytest.approx(plain["peak_torque"], rel=1e-3)  # of points that differ


@pytest.mark.slow
def test_a_motion_that_rests_its_lines_table_and_picture(capsys, loop_file, tmp_path):
    """Two masses: both angles step; a band that is wider than the smallest one ends hunting."""
    path = tmp_path / "two.toml"
    parts = ["two masses", *PLAIN[1:], "dead band"]
    path.write_text(f"[loop]\nparts = {parts}\n[values]\nshaft_damping = 0.05\ndead_band = 0.06\n".replace("'", '"'))
    written = "--csv", tmp_path / "s.csv", "--plot", tmp_path / "s.png"
    words = "--gain", 0.04, "--position", 0.5, "--state", "load_rate=0.1", "--details"
    code, out, _ = run(capsys, "simulate", path, *words, *written)
    said = " ".join(out.split())
    assert code == 0 and out.startswith("loop at gain 0.04 V/rad, from 0.5 rad to set point 1 rad, 100 s: at rest\n")
    assert "when followed on it stays there" in said
    assert "largest torque" in said and "breakaways" in said
    rows = list(csv.DictReader((tmp_path / "s.csv").read_text(encoding="ascii").splitlines()))
    first, last = ({k: v if k == "mode" else float(v) for k, v in row.items()} for row in (rows[0], rows[-1]))
    states = "time_s", "position_rad", "velocity_rad_per_s", "load_angle_rad", "load_rate_rad_per_s"
    begins = [first[name] for name in states]
    assert begins == pytest.approx([0, 0.5, 0, -0.5, 0.1], abs=1e-12)
    assert last["time_s"] == 100 and abs(last["position_rad"] - 1) < 0.06 and last["mode"].startswith("stick")
    assert is_picture(tmp_path / "s.png")


@pytest.mark.slow
def test_the_border_in_two_parameters(capsys, loop_file, tmp_path):
    """Gain against dead band, and back: at the first and the last point the stick map has the same border."""
    border = pytest.importorskip("stick_map_support").border
    words = "--from", 0.02, "--to", 0.03, "--points", 2, "--csv", tmp_path / "b.csv", "--plot", tmp_path / "b.png"
    words = "--vary", "dead_band", "--tol", "1e-7", "--details", *words
    code, out, err = run(capsys, "fold-curve", loop_file("dead band"), *words)
    rows = list(csv.DictReader((tmp_path / "b.csv").read_text().splitlines()))
    assert code == 0 and re.match(r"loop: where hunting ends, at \d+ values of dead_band; dead_band reached 0\.03", out)
    assert [float(rows[i]["value"]) for i in (0, -1)] == [0.02, 0.03] and is_picture(tmp_path / "b.png")
    assert "K = 0.0827375" in err.splitlines()[0] and "dead_band [rad]; gain: up to which the loop can hunt" in out
    size, K = float(rows[-1]["value"]), float(rows[-1]["gain"])
    assert border(K, "dead band", size, 1.001 * size, 1.8 * size) == pytest.approx(size, rel=1e-6)


def test_a_border_between_two_parameters_that_are_no_gain(capsys, loop_file):
    """Leak against integral time: on the border at 1/(2 pi) s it is that of the event map."""
    words = "--vary", "integral_time", "--fold-in", "leak", "--from", 0.2, "--to", 0.15915494309189535, "--points", 2
    code, out, _ = run(capsys, "fold-curve", loop_file("leak", leak=0.1), *words, "--json", "--quiet")
    found = one_json(out)
    (curve,) = found["curves"]
    assert (code, found["failures"], found["way"]) == (0, [], "up")
    assert (curve["fold_in"], curve["vary"]) == ("leak", "integral_time")
    assert curve["points"][-1]["border"] == pytest.approx(LEAK, rel=1e-5)


OF_OPTIONS = "--dead-band", "0.1"


def test_a_motion_with_a_remedy_that_the_file_has_not(capsys, loop_file):
    """As with one that it has; it was refused."""
    how = "--gain", 0.04, "--time", "60", "--json", "--quiet"
    with_it = one_json(run(capsys, "simulate", loop_file("dead band", dead_band=0.1), *how)[1])
    given, without = (one_json(run(capsys, "simulate", loop_file(), *how, *more)[1]) for more in (OF_OPTIONS, ()))
    assert given["verdict"] == with_it["verdict"] != without["verdict"]


def test_the_gain_is_set_as_any_other_number(capsys, loop_file):
    asked = [("--gain", 2), ("--set", "gain=2")]
    given, set_ = (one_json(run(capsys, "loop", loop_file(), *words, "--json")[1])["loops"] for words in asked)
    assert given[0]["gain"] == set_[0]["gain"] == 2 and given[0]["poles"] == set_[0]["poles"]


CURVE = "fold-curve", "--from", 0.5, "--to", 0.6
REFUSED = [
    (("orbit", "--gain", 1, "--model", "switch"), "model: must be left out, the friction of a loop is one of"),
    (("orbit", "--gain", 1, "--full"), "full: must be left out"),
    (("orbit", "--gain", 1, "--branch", "lopsided"), "branch of a loop 'lopsided'"),
    (("orbit", "--gain", -1), "gain = -1"),
    (("orbit", "--gain", 1, "--set", "gain=2"), "--gain and --set gain=: both give the gain"),
    (("orbit", "--gain", 1, "--set", "dead_bnd=1"), "unknown parameter 'dead_bnd'; did you mean 'dead_band'?"),
    (("orbit", "--gain", 1, "--set", "dead_band"), "must have the form name=value"),
    (("orbit", "--gain", 1, "--set", "dead_band=-1"), "dead_band = -1: must be at least 0 (dead band)"),
    (("fold", "--vary", "dead_bnd"), "unknown parameter 'dead_bnd'; did you mean 'dead_band'?"),
    (("diagram", "--vary", "dead_band"), "dead_band: with dead_band = 0 there is no dead band; give it another"),
    (("diagram", "--to", "0.04"), "gain is 0.04 at the start: it cannot go to 0.04"),
    (("diagram", "--to", "high"), "to = 'high': must be a finite number"),
    (("simulate", "--gain", 1, "--state", "x7=1"), "unknown state 'x7'"),
    (("simulate", "--gain", 1, "--bristle", "1"), "bristle = 1.0: must be 0, as the servo has no bristle"),
    ((*CURVE, "--vary", "gain"), "fold-in = gain: must be another parameter than that of --vary"),
    ((*CURVE, "--vary", "dead_bnd"), "unknown parameter 'dead_bnd'; did you mean 'dead_band'?"),
    ((*CURVE, "--vary", "static", "--fold-in", "dead_band"), "dead_band: with dead_band = 0 there is no dead band"),
    (("fold", "--vary", "dead_band"), "dead_band: with dead_band = 0 there is no dead band; give it another dead_band"),
]


@pytest.mark.parametrize(("words", "says"), REFUSED)
def test_what_is_refused(capsys, loop_file, tmp_path, words, says):
    path = loop_file("dead band")
    written = "--out" if words[0] == "diagram" else "--csv"
    code, out, err = run(capsys, words[0], path, *words[1:], "--quiet", written, tmp_path / "o.csv")
    assert (code, out) == (2, "") and says in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [path]


def test_the_linear_loop_has_the_poles_of_two_masses(capsys, tmp_path):
    """Roots of s (s ((J s + b)(JL s^2 + k) + k JL s)) + K (kd s^2 + kp s + ki)(JL s^2 + k), without shaft damping."""
    path, J, JL, k, b = tmp_path / "two.toml", 0.026, 0.01, 100.0, 0.1
    parts = ["two masses", "Switch friction", "PID by gains", "integrator"]
    values = {"inertia": J, "load_inertia": JL, "shaft_stiffness": k, "shaft_damping": 0.0, "viscous": b,
              "motor_gain": 2.0, "kp": 2.0, "ki": 6.0, "kd": 0.16}  # fmt: skip
    lines = [f"{name} = {value}" for name, value in values.items()]
    path.write_text("\n".join([f"[loop]\nparts = {parts}", "[values]", *lines]).replace("'", '"'))
    code, out, err = run(capsys, "loop", path, "--gain", 0.5, "--json", "--plot", tmp_path / "bode.png")
    (found,) = one_json(out)["loops"]
    bar = np.array([JL, 0, k])
    plant = np.polymul([1, 0, 0], np.polyadd(np.polymul([J, b], bar), [k * JL, 0]))
    exact = np.sort_complex(np.roots(np.polyadd(plant, np.polymul([0.16, 2.0, 6.0], bar))))
    poles = np.sort_complex([complex(*pole) for pole in found["poles"]])
    assert code == 0 and poles == pytest.approx(exact, rel=1e-9) and found["stable"] == (exact.real.max() < 0)
    assert (tmp_path / "bode.png").stat().st_size > 10_000
    code, out, _ = run(capsys, "loop", path, "--gain", 0.5)
    assert code == 0 and "phase margin" in out and "friction     stable" not in out


@pytest.mark.parametrize(("plant", "told"), [("two masses, load measured", True), ("one inertia", False)])
def test_of_which_mass_positions_are(capsys, tmp_path, plant, told):
    path = tmp_path / "axis.toml"
    path.write_text(f'[loop]\nparts = ["{plant}", "Switch friction", "PID by times", "integrator"]\n')
    code, out, _ = run(capsys, "equilibria", path)
    assert code == 0 and ("those of the motor" in out) is told


def test_the_linear_loop_as_built_of_two_masses(capsys, tmp_path):
    """The margins of its drive, whose motions die out within them and grow beyond, and its response in the picture."""
    path = tmp_path / "two.toml"
    parts = ["two masses, load measured", "Switch friction", "cascade P-PI", "integrator"]
    values = {"inertia": 4e-4, "load_inertia": 1.6e-3, "shaft_stiffness": 60.0, "shaft_damping": 0.01, "viscous": 0.002,
              "motor_gain": 1.0, "position_gain": 20.0, "velocity_gain": 0.03, "reset_time": 0.05,
              "static": 2e-9, "coulomb": 1e-9}  # fmt: skip
    lines = [f"{name} = {value}" for name, value in values.items()]
    text = "\n".join([f"[loop]\nparts = {parts}", "[values]", *lines, "[drive]", "sample_time = 2e-3"])
    path.write_text(text.replace("'", '"'))
    words = ("loop", path, "--gain", 1, "--set", "drive.delay=8e-4")
    code, out, _ = run(capsys, *words, "--json", "--quiet", "--plot", tmp_path / "bode.png")
    (found,) = one_json(out)["as_built"]["margins"]
    assert code == 0 and found["stable"] and (tmp_path / "bode.png").stat().st_size > 10_000
    said = " ".join(run(capsys, *words)[1].split())
    assert f"gain 1 V/rad as built: phase margin {found['phase_margin']:.4g} degrees, stable down to" in said
    loop, drive = load_loop(path), Drive(sample_time=2e-3, delay=8e-4)
    for factor, grows in ((0.98, False), (1.02, True)):
        limited = loop.replace(gain=factor * found["highest_factor"])
        x = simulate_sampled(limited, None, drive, time=6.0, set_point=0.0, start=loop.at_rest(0.01)).states[0]
        assert bool(np.abs(x[-300:]).max() > np.abs(x[-1800:-1500]).max()) is grows


@pytest.mark.parametrize(("words", "says"), [
    (("map", "--gain", 1), "casahunt map has no answer for 'leak': the event map has one coordinate, where"),
    (("map", "--set", "leak=0"), "\n"),
])  # fmt: skip
def test_commands_that_take_a_servo_alone_name_the_part(capsys, loop_file, words, says):
    """A loop that is a servo is asked as one."""
    code, out, err = run(capsys, words[0], loop_file("leak", leak=0.1), *words[1:])
    assert (code, out == "") == ((2, True) if "no answer" in says else (0, False)) and says in out + err


def test_the_event_map_is_that_of_rigid_friction(capsys, loop_file):
    path = loop_file()
    path.write_text(path.read_text().replace("Switch", "LuGre"))
    code, out, err = run(capsys, "map", path)
    assert (code, out) == (2, "") and "has no answer for 'LuGre friction'" in err


def test_where_the_branch_of_a_servo_ends(capsys, tmp_path):
    words = "--model", "switch", "--from", 0.08, "--to", 0.1, "--out", tmp_path / "some", "--json", "--quiet"
    code, out, err = run(capsys, "diagram", *words)
    (branch,) = one_json(out)["branches"]
    assert (code, err, branch["gain_range"]) == (0, "", [0.08, 0.1])


def test_a_servo_is_followed_in_its_gain_alone(capsys):
    code, out, err = run(capsys, "fold", "--vary", "friction.static")
    assert (code, out) == (2, "") and "vary = friction.static: must be gain, or a parameter of a loop of parts" in err


def test_a_servo_file_is_read_once(capsys, tmp_path, monkeypatch):
    """It may be a pipe, which is empty when it is read again."""
    from casahunt.views.commands import arguments

    path, times = tmp_path / "servo.toml", []
    path.write_text("[friction]\nstatic = 0.5\n")
    read = arguments.read_toml
    monkeypatch.setattr(arguments, "read_toml", lambda *asked: times.append(1) or read(*asked))
    code, out, _ = run(capsys, "orbit", path, "--gain", 0.04, "--json", "--quiet")
    assert code == 0 and one_json(out)["servo"]["friction"]["static"] == 0.5 and len(times) == 1


@pytest.mark.slow
def test_a_loop_whose_cycle_rests_on_its_way_hunts_wherever_its_motion_is_cut(capsys, loop_file):
    """Its shaft rings out in each stick; stops of a fourth order integrator with steps of 2.5e-6 s: 0.040751 rad."""
    values = {
        "inertia": 0.0012, "load_inertia": 0.004, "shaft_stiffness": 180, "shaft_damping": 0.5, "load_damping": 0.01,
        "motor_gain": 1, "kp": 4, "ki": 30, "kd": 0.12, "static": 0.8, "coulomb": 0.55,
        "stribeck_velocity": 0.08, "viscous": 0.02,
    }  # fmt: skip
    lines = [f"{name} = {value}" for name, value in values.items()]
    parts = '"two masses", "Switch friction", "PID by gains", "integrator"'
    path = loop_file()
    path.write_text("\n".join([f"[loop]\nparts = [{parts}]", "[values]", *lines]))
    found = one_json(run(capsys, "simulate", path, "--gain", 1, "--time", 60, "--json", "--quiet")[1])
    assert found["verdict"] == "hunting" and found["amplitude"] == pytest.approx(0.040751, abs=1e-6)


@pytest.mark.slow
def test_a_record_beside_the_cycle_of_a_loop(capsys, tmp_path):
    """Written by scipy's DOP853, event by event, of a servo on whose load there is a spring."""
    solve_ivp = pytest.importorskip("scipy.integrate").solve_ivp
    J, spring, K, kp, kd, ki, Fs, Fc, vs, b = 0.026, 0.5, 1.0, 4.0, 0.3, 20.0, 0.53, 0.44, 0.02, 0.1

    def torque(y):
        return -K * (kp * y[0] + kd * y[1] + ki * y[2]) - spring * y[0]

    def slip(sign):
        return lambda t, y: [y[1], (torque(y) - sign * (Fc + (Fs - Fc) * math.exp(-((y[1] / vs) ** 2))) - b * y[1]) / J,
                             y[0]]  # fmt: skip

    def stops(t, y):
        return y[1]

    stops.terminal = True
    now, y, times, places = 0.0, np.array([-0.05, 0.0, 0.0]), [], []
    while now < 60.0:
        m = torque(y)
        if abs(m) < Fs:  # the integrator alone moves
            wait = (Fs + abs(m) * np.sign(m * y[0])) / (K * ki * abs(y[0]))
            t = np.arange(math.ceil(now / 5e-3), math.ceil((now + wait) / 5e-3)) * 5e-3
            times, places = [*times, *t], [*places, *np.full(t.size, y[0])]
            now, y = now + wait, np.array([y[0], 0.0, y[2] + wait * y[0]])
            m = -np.sign(y[0]) * Fs
        stops.direction = -float(np.sign(m))
        way = solve_ivp(slip(np.sign(m)), (now, now + 10), y + [0, 1e-12 * np.sign(m), 0], "DOP853", rtol=1e-10,
                        atol=1e-13, events=stops, dense_output=True)  # fmt: skip
        t = np.arange(math.ceil(now / 5e-3), math.ceil(way.t[-1] / 5e-3)) * 5e-3
        times, places = [*times, *t], [*places, *way.sol(t)[0]]
        now, y = way.t[-1], np.array([way.y[0, -1], 0.0, way.y[2, -1]])
    record, loop = tmp_path / "r.csv", tmp_path / "loop.toml"
    lines = [f"{t:.6f},{x:.9f}\n" for t, x in zip(times, places, strict=True)]
    record.write_text("".join(["time [s],position [rad]\n", *lines]))
    values = {"inertia": J, "spring": spring, "gain": K, "motor_gain": 1, "kp": kp, "ki": ki, "kd": kd, "static": Fs,
              "coulomb": Fc, "stribeck_velocity": vs, "viscous": b}  # fmt: skip
    parts = '["one inertia", "Switch friction", "PID by gains", "integrator", "loads"]'
    loop.write_text("\n".join([f"[loop]\nparts = {parts}\n[values]", *(f"{k} = {v}" for k, v in values.items())]))
    code, out, err = run(capsys, "record", record, "--servo", loop, "--json", "--quiet", "--plot", tmp_path / "r.png")
    said = one_json(out)
    assert (code, err, said["kind"], said["prediction_failed"]) == (0, "", "hunting", None)
    assert said["predicted"]["amplitude_ratio"] == pytest.approx(1, abs=1e-3)
    assert said["predicted"]["frequency_ratio"] == pytest.approx(1, abs=1e-3)
    assert is_picture(tmp_path / "r.png")


BELT = {
    "inertia": 4e-4, "load_inertia": 1.6e-3, "shaft_stiffness": 60.0, "shaft_damping": 0.01, "motor_gain": 1.0,
    "kp": 2.0, "ki": 12.0, "kd": 0.06, "static": 0.25, "coulomb": 0.18, "stribeck_velocity": 0.05, "viscous": 0.002,
}  # fmt: skip
"""A motor and a load with a belt between them."""


@pytest.mark.parametrize("position", [0.0005, 0.0017])
def test_a_motion_that_creeps_to_rest_has_one_verdict(capsys, tmp_path, position):
    """Its last slip is slower and slower: whether that still stops, and how often, is rounding, and no error of it.

    It is at rest with the load where the motor is, and the integrator carries less than the static friction.
    """
    path, parts = tmp_path / "belt.toml", '["two masses", "Switch friction", "PID by gains", "integrator"]'
    lines = [f"{name} = {value}" for name, value in BELT.items()]
    path.write_text("\n".join([f"[loop]\nparts = {parts}\n[values]\ngain = 1.0", *lines]))
    words = "--gain", 7.5, "--position", position
    code, out, err = run(capsys, "simulate", path, *words, "--json", "--quiet")
    said = one_json(out)
    assert (code, err, said["verdict"]) == (0, "", "at rest") and said["end_error"] <= said["tol"]
    assert abs(said["end"]["x1"] - said["end"]["load_angle"]) < 1e-9
    assert 7.5 * 12.0 * abs(said["end"]["x3"]) <= 0.25 * (1 + 1e-6)


@pytest.mark.parametrize("command", ["identify", "cure"])
def test_records_of_a_loop_have_their_gains(capsys, loop_file, tmp_path, command):
    """Of each record one: the option was read as that of commands with one gain, which is no list."""
    (tmp_path / "still.csv").write_text("t,x\n" + "".join(f"{k},1.0\n" for k in range(100)))
    words = tmp_path / "still.csv", "--servo", loop_file(), "--gain", "0.04", "--quiet"
    code, out, err = run(capsys, command, *words)
    assert (code, out) == (2, "") and err.count("\n") == 1 and "still.csv" in err
