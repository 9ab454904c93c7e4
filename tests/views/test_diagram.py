"""`casahunt diagram`: points, files, pictures, and what an end before the end leaves behind."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from itertools import islice

import pytest
from command_line import PROGRESS, contents, is_picture, one_json, process, rows_of, run

from casahunt import NoOrbit, Servo, find_fold, find_orbit, load
from casahunt.continuation import Branch, End, crossings, following
from casahunt.continuation import special_points as monitor
from casahunt.design.diagram import diagram, starting_gain
from casahunt.orbits.batched_multipliers import ORBITS_AHEAD
from casahunt.orbits.orbit import Complaint
from casahunt.servo.saved import load_branch
from casahunt.views.commands import diagram as command_diagram
from casahunt.views.commands import fold as command_fold
from casahunt.views.commands import orbit as command_orbit
from problems import canudas_gain, canudas_servo, table1
from problems.taylor import switch_cycle


def test_diagram(capsys, tmp_path):
    """Pictures and data; twice into the same folder, which is made with its parents."""
    out = tmp_path / "new" / "folder"
    command = ["diagram", "--model", "switch", "--from", "0.3", "--out", out, "--details"]
    code, text, err = run(capsys, *command)
    assert code == 0
    assert set(contents(out)) == {*command_diagram.PICTURES, "switch.csv", "switch.npz"}
    assert all(is_picture(out / name) for name in command_diagram.PICTURES)

    rows, branch = rows_of(out / "switch.csv"), load_branch(out / "switch.npz")
    points = [row for row in rows if not row["special"]]
    assert len(points) == len(branch.orbits) > 20
    assert [float(row["gain"]) for row in points] == list(branch.gains)
    assert [float(row["amplitude_rad"]) for row in points] == list(branch.amplitudes)
    assert [float(row["period_s"]) for row in points] == list(branch.periods)
    assert [float(row["half_multiplier"]) for row in points] == list(branch.half_multipliers)
    assert float(points[0]["gain"]) == float(points[-1]["gain"]) == 0.3
    assert all(row["status"] == "converged" and float(row["error_estimate"]) <= 1e-6 for row in rows)
    assert all(float(row["trivial_multiplier_error"]) < 1e-5 for row in points)
    assert all(int(row["unknowns"]) > 50 and int(row["iterations"]) >= 1 for row in rows)

    # Stable, superstable, fold, unstable: the fold divides the two.
    kinds = [row["special"] for row in rows]
    assert kinds.count("fold") == kinds.count("superstable") == 1
    fold = kinds.index("fold")
    assert kinds.index("superstable") < fold
    assert {row["stable"] for row in rows[:fold]} == {"True"} and rows[fold]["stable"] == ""
    assert {row["stable"] for row in rows[fold + 1 :]} == {"False"}
    known = table1.REFERENCE["switch"]["fold"]
    assert float(rows[fold]["gain"]) == pytest.approx(known["K"], rel=1e-6)
    assert float(rows[fold]["amplitude_rad"]) == pytest.approx(known["amplitude"], rel=1e-5)
    assert float(rows[fold]["period_s"]) == pytest.approx(known["period"], rel=1e-5)
    assert [special.kind for special in branch.special] == ["superstable", "fold"]

    # A progress line per point, a sentence per special point, the same sentences in the summary.
    lines = err.splitlines()
    assert sum(bool(PROGRESS.fullmatch(line)) for line in lines) == len(points)
    assert len(lines) == len(rows)
    for special in branch.special:
        assert f"switch  {special.meaning}" in lines and special.meaning in " ".join(text.split())
    plain, _, details = text.partition("\ndetails\n")
    assert plain.startswith("switch: the servo can hunt up to gain 0.6473 V/rad") and plain.split()[-1] == str(out)
    assert details.startswith(f"switch: {len(points)} points; ")
    other = find_orbit(Servo().replace(**{"friction.static": 0.6}), "switch", 0.7)  # as if beyond the fold
    head, *_ = command_diagram.diagram_answer([replace(branch, orbits=(*branch.orbits, other))], [], "").plain
    assert "where that ends was not met" in head

    files, gains = set(contents(out)), [float(row["gain"]) for row in rows]
    code, text, err = run(capsys, *command, "--quiet", "--json")
    assert (code, err) == (0, "")
    assert one_json(text)["out"] == str(out)
    assert set(contents(out)) == files
    assert [float(row["gain"]) for row in rows_of(out / "switch.csv")] == pytest.approx(gains, rel=1e-9)


ANOTHER = """
[servo]
inertia = 0.012
motor_gain = 4.2
[controller]
kp = 1
ki = 8
kd = 0.05
[friction]
static = 0.40
coulomb = 0.30
stribeck_velocity = 0.05
viscous = 0.02
"""
"""A servo whose loop without friction is stable from K = J ki/(cm kd kp) = 0.457 on."""


def test_the_range_comes_from_the_servo(capsys, tmp_path):
    """Without --from: the Routh-Hurwitz gain without friction, three digits, rounded up; its cycle by Taylor series."""
    (tmp_path / "my.toml").write_text(ANOTHER)
    command = ["diagram", tmp_path / "my.toml", "--model", "switch", "--natural", "--out", tmp_path / "out"]
    assert run(capsys, *command, "--quiet", "--json")[0] == 0
    first, *_, fold = rows_of(tmp_path / "out" / "switch.csv")
    lowest = 0.012 * 8 / (4.2 * 0.05 * 1)
    assert lowest < float(first["gain"]) == 0.458 < lowest * 1.01 and fold["special"] == "fold"
    amplitude, period = switch_cycle(load(tmp_path / "my.toml"), 0.458, float(first["amplitude_rad"]))
    assert float(first["amplitude_rad"]) == pytest.approx(amplitude, rel=1e-6)
    assert float(first["period_s"]) == pytest.approx(period, rel=1e-6)
    assert is_picture(tmp_path / "out" / "diagram.png")
    # Table 1: the report's.
    assert [starting_gain(Servo(), model) for model in ("switch", "lugre")] == [0.0321, 0.0321]


def test_a_start_without_a_cycle_gives_way_to_the_servos_own(capsys, tmp_path, monkeypatch):
    """Said, with exit code 1; a gain above the cycles does not: a diagram below it is not what was asked for."""
    first = find_orbit(Servo(), "switch", 0.6)

    def nowhere(servo, model, *, start, **_):
        if start != 0.6:
            raise NoOrbit(f"none at gain {start:g}")
        return Branch("gain", (first, find_orbit(servo, model, 0.61)), end=End("stuck", "the end"))

    monkeypatch.setattr(command_diagram, "diagram", nowhere)
    monkeypatch.setattr(command_diagram, "starting_gain", lambda *_: 0.6)
    command = ["diagram", "--model", "switch", "--out", tmp_path, "--quiet", "--from"]
    code, out, err = run(capsys, *command, 0.5)
    assert code == 1 and "none at gain 0.5; it is drawn from gain 0.6" in err
    assert out.startswith("switch: the servo can hunt; where that ends was not met (the end)\n")
    assert is_picture(tmp_path / "diagram.png") and len(rows_of(tmp_path / "switch.csv")) == 2
    before = contents(tmp_path)
    assert run(capsys, *command, 0.7) == (1, "", "casahunt diagram: none at gain 0.7\n")
    assert contents(tmp_path) == before


@pytest.mark.slow
def test_a_gain_below_the_cycles_is_replaced(capsys, tmp_path):
    """Between K = 0.0321 and the second fold at 0.146 this servo has no stable cycle: what there is, is drawn."""
    (tmp_path / "my.toml").write_text(ANOTHER)
    command = ["diagram", tmp_path / "my.toml", "--model", "switch", "--natural", "--from", 0.0321, "--out", tmp_path]
    code, out, err = run(capsys, *command, "--quiet")
    assert code == 1 and out.startswith("switch: ") and "hunt up to gain 4.053 V/rad" in out
    assert "no stable hunting cycle of the switch servo at gain 0.0321: it has such cycles from" in err
    assert "it is drawn from gain 0.458" in err
    assert float(rows_of(tmp_path / "switch.csv")[0]["gain"]) == 0.458 and is_picture(tmp_path / "diagram.png")


def test_a_model_without_a_start_does_not_take_the_other_with_it(capsys, tmp_path, monkeypatch):
    def start(servo, model, options):
        if model == "switch":
            raise NoOrbit("no hunting limit cycle of the switch servo")
        return 0.58

    monkeypatch.setattr(command_diagram, "starting_gain", start)
    code, out, err = run(capsys, "diagram", "--out", tmp_path, "--quiet")
    assert code == 1 and out.startswith("lugre: ") and "no hunting limit cycle of the switch servo" in err
    assert float(rows_of(tmp_path / "lugre.csv")[0]["gain"]) == 0.58 and is_picture(tmp_path / "diagram.png")


@pytest.mark.slow
def test_a_range_below_the_bound_of_the_linear_loop():
    """So much viscous friction that the fold lies below it: a twentieth of the fold gain."""
    servo = Servo().replace(**{"friction.viscous": 3.3})
    start = starting_gain(servo, "switch")
    fold = find_fold(servo, "switch").gain
    assert fold < 0.0321 and fold / 20 <= start < fold / 19.9
    assert find_orbit(servo, "switch", start).half_multiplier < 1


@pytest.mark.slow
def test_diagram_of_both_models(capsys, tmp_path):
    code, text, err = run(capsys, "diagram", "--from", 0.55, "--out", tmp_path, "--json", "--quiet")
    assert (code, err) == (0, "")
    found = one_json(text)
    assert set(found) >= {"out", "branches", "failures", "wall_s"} and found["failures"] == []
    assert set(contents(tmp_path)) == {*command_diagram.PICTURES, "switch.csv", "switch.npz", "lugre.csv", "lugre.npz"}
    for branch, model in zip(found["branches"], ("switch", "lugre"), strict=True):
        fold = next(special for special in branch["special"] if special["kind"] == "fold")
        assert branch["model"] == model
        assert fold["gain"] == pytest.approx(table1.REFERENCE[model]["fold"]["K"], rel=1e-6)
        assert branch["gain_range"][0] == 0.55
        assert branch["gain_range"][1] <= fold["gain"] * (1 + 1e-6)
        assert branch["points"] == len(load_branch(tmp_path / f"{model}.npz").orbits)


@pytest.mark.slow
def test_diagram_as_it_is_asked_for(tmp_path):
    """The main job of the program, in a process of its own: both models, all the way down."""
    done = process("diagram", "--out", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    found = one_json(done.stdout)
    assert [branch["gain_range"][0] for branch in found["branches"]] == [0.0321, 0.0321]
    for model, period in (("switch", 3318), ("lugre", 1273)):  # at the lower end of the unstable branches
        rows = rows_of(tmp_path / "out" / f"{model}.csv")
        assert float(rows[-1]["gain"]) == 0.0321 and rows[-1]["stable"] == "False"
        assert float(rows[-1]["period_s"]) == pytest.approx(period, abs=1)
        assert all(row["status"] == "converged" for row in rows)
    assert all(is_picture(tmp_path / "out" / name) for name in command_diagram.PICTURES)


@pytest.mark.slow
def test_earlier_results_are_replaced(capsys, tmp_path):
    """By new ones of the same name, and not before those are there: without a cycle nothing is touched."""
    old = dict.fromkeys(command_diagram.PICTURES, command_diagram.PICTURE_SIGN) | {"notes.txt": b"mine"}
    old |= {f"{model}{end}": sign for model in ("switch", "lugre") for end, sign in command_diagram.SIGNS.items()}
    del old["lugre.npz"]
    for name, content in old.items():
        (tmp_path / name).write_bytes(content)
    before = contents(tmp_path)
    code, out, err = run(capsys, "diagram", "--model", "switch", "--from", 0.8, "--out", tmp_path)
    assert (code, out) == (1, "")
    assert contents(tmp_path) == before
    # Between the two folds only the Switch servo hunts: the LuGre table of another servo is no longer called so.
    code, out, err = run(capsys, "diagram", "--from", 0.63, "--out", tmp_path, "--quiet")
    assert code == 1 and out.startswith("switch: ")
    denial, left = err.splitlines()
    assert "no hunting limit cycle of the lugre servo at gain 0.63" in denial
    assert "lugre.csv.old is of an earlier run" in left
    after = contents(tmp_path)
    assert set(after) == {*command_diagram.PICTURES, "switch.csv", "switch.npz", "lugre.csv.old", "notes.txt"}
    assert {name for name, content in after.items() if content in old.values()} == {"lugre.csv.old", "notes.txt"}


def walk_that_ends(with_what):
    """A stand-in for the walk: a point, then `with_what`."""

    def walk(start, **_):
        yield find_orbit(start.servo, start.model, start.gain * 1.1)
        if isinstance(with_what, BaseException):
            raise with_what
        return with_what

    return walk


@pytest.mark.parametrize(
    "end", [Complaint("no step converged: try this"), NoOrbit("no step converged: try this")], ids=type
)
def test_branch_that_does_not_come_back(capsys, tmp_path, monkeypatch, end):
    """Exit code 1, and what has been computed is drawn and kept."""
    monkeypatch.setattr(following, "walk", walk_that_ends(end))
    command = ["diagram", "--model", "switch", "--from", 0.3, "--out", tmp_path, "--quiet", "--json"]
    code, out, err = run(capsys, *command)
    assert code == 1 and one_json(out)["failures"] == [err.removeprefix("casahunt diagram: ").rstrip("\n")]
    assert err.startswith("casahunt diagram: the branch of the switch servo was followed from gain 0.3 to gain 0.33")
    assert "no step converged: try this" in err and "--tol" in err
    assert len(rows_of(tmp_path / "switch.csv")) == len(load_branch(tmp_path / "switch.npz").orbits) == 2
    assert is_picture(tmp_path / "diagram.png")


@pytest.mark.parametrize(("kind", "expected"), [("fold", 1), ("symmetry breaking", 0)])
def test_a_special_point_that_is_not_located(capsys, tmp_path, monkeypatch, undrawn, kind, expected):
    """Said, and kept with the branch; a diagram without its fold has failed.

    Patched: what is passed is located wherever it is known to be.
    """
    # The multiplier falls through 0.5 next to the fold, where it is 1.
    passed = replace(monitor.SYMMETRY_BREAKING, value=lambda orbit, point: orbit.half_multiplier - 0.5)
    monitors = (monitor.FOLD, *([] if kind == "fold" else [passed]))
    locate = crossings.locate_special_point
    monkeypatch.setattr(
        crossings, "locate_special_point", lambda *a, **k: None if a[2].kind == kind else locate(*a, **k)
    )
    monkeypatch.setattr(command_diagram, "diagram", partial(diagram, monitors=monitors))
    command = ["diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet", "--json"]
    code, out, err = run(capsys, *command)
    assert code == expected
    (branch,) = one_json(out)["branches"]
    gaps = branch["missed"]
    assert gaps and all(gap["kind"] == kind for gap in gaps)
    assert all(special["kind"] != kind for special in branch["special"])
    assert err == "".join(f"casahunt diagram: switch: {gap['meaning']}\n" for gap in gaps)
    bounds = [float(bound) for bound in re.findall(r"between gain = (\S+) and (\S+) was not located", err)[0]]
    assert all(0.6 <= bound < table1.REFERENCE["switch"]["fold"]["K"] for bound in bounds) and bounds[0] != bounds[1]
    assert one_json(out)["failures"] == [gap["meaning"] for gap in gaps if kind == "fold"]
    assert [(m.kind, m.meaning) for m in load_branch(tmp_path / "switch.npz").missed] == [
        (gap["kind"], gap["meaning"]) for gap in gaps
    ]


@pytest.mark.parametrize("trouble", [KeyboardInterrupt(), ZeroDivisionError()], ids=repr)
def test_trouble_on_the_way_keeps_the_points(capsys, tmp_path, monkeypatch, trouble):
    monkeypatch.setattr(following, "walk", walk_that_ends(trouble))
    command = ["diagram", "--model", "switch", "--from", 0.3, "--out", tmp_path / "out", "--quiet"]
    if isinstance(trouble, KeyboardInterrupt):
        assert run(capsys, *command) == (
            130, "", f"casahunt diagram: interrupted; the points computed so far are in {tmp_path / 'out'}\n"
        )  # fmt: skip
    else:
        with pytest.raises(ZeroDivisionError):
            run(capsys, *command)
    branch = load_branch(tmp_path / "out" / "switch.npz")
    assert len(rows_of(tmp_path / "out" / "switch.csv")) == len(branch.orbits) == 1  # what was looked at
    assert branch.ended == "interrupted"


def test_points_found_together_are_written_together(capsys, tmp_path, monkeypatch):
    """Announced when they are on disk, in order, what lies before each being known."""
    monkeypatch.setattr(command_diagram, "_pictures", lambda *_: None)
    on_disk: list[int] = []

    def kept(branch, path):
        on_disk.append(len(branch.orbits))
        to_csv(branch, path)

    def cut_short(*args, **how):
        yield from islice(walk(*args, **how), 2 * ORBITS_AHEAD + 1)
        raise KeyboardInterrupt

    to_csv, walk = Branch.to_csv, following.walk
    monkeypatch.setattr(Branch, "to_csv", kept)
    monkeypatch.setattr(following, "walk", cut_short)
    code, _, err = run(capsys, "diagram", "--model", "switch", "--from", 0.3, "--out", tmp_path, "--details")
    branch = load_branch(tmp_path / "switch.npz")
    first, second, last = on_disk  # the third time where the branch has turned
    assert (code, first, second) == (130, 1, 1 + ORBITS_AHEAD) and second < last <= second + ORBITS_AHEAD
    assert len(branch.orbits) == last
    assert sum(bool(PROGRESS.fullmatch(line)) for line in err.splitlines()) == on_disk[-1]


@pytest.mark.parametrize("words", [["orbit", "--gain", "0.1"], ["fold"], ["diagram", "--out", "new/out"]])
def test_interrupt_before_the_first_point(capsys, tmp_path, monkeypatch, words):
    def stop(*args, **kwargs):
        raise KeyboardInterrupt

    stopped = (command_orbit, "find_orbit"), (command_fold, "find_fold"), (command_diagram, "diagram")
    for module, name in stopped:
        monkeypatch.setattr(module, name, stop)
    monkeypatch.chdir(tmp_path)
    what = "; no point was computed" if words[0] == "diagram" else ""
    assert run(capsys, *words) == (130, "", f"casahunt {words[0]}: interrupted{what}\n")
    assert not contents(tmp_path)


@pytest.mark.slow
def test_a_lopsided_pair(capsys, tmp_path):
    """To the end: announced, followed, drawn, written; taken up again without being computed again."""
    out = tmp_path / "out"
    command = ["diagram", canudas_servo.TOML, "--model", "lugre", "--from", "44", "--tol", "1e-7", "--out", out]
    command.append("--details")
    code, text, err = run(capsys, *command)
    assert code == 0 and all(is_picture(out / name) for name in command_diagram.PICTURES)
    words = " ".join(text.split())
    assert "lopsided, one of a pair whose other is its mirror image" in words and "own image" in words
    branch = load_branch(out / "lugre.npz")
    (pair,) = branch.lopsided
    breaking = [special.orbit.gain for special in branch.special if special.kind == "symmetry breaking"]
    assert breaking == pytest.approx(canudas_gain.BREAKING, rel=1e-7)
    assert [s.orbit.gain for s in branch.special if s.kind == "fold"] == pytest.approx([canudas_gain.FOLD], rel=1e-7)
    found = {(special.kind, round(special.orbit.gain, 4)) for special in pair.special}
    assert found == {("fold", 47.9671), ("flip", 47.9982), ("flip", 48.4332), ("symmetry breaking", 48.4446)}
    rows = rows_of(out / "lugre.csv")
    lopsided = [row for row in rows if row["lopsided"] != "0"]
    *others, met = pair.orbits  # the last one is the symmetric cycle that it meets
    assert [float(row["gain"]) for row in lopsided if not row["special"]] == [orbit.gain for orbit in others]
    assert met is pair.special[-1].orbit
    assert {row["special"] for row in lopsided} == {"", "fold", "flip", "symmetry breaking"}
    assert all(row["lopsided"] == "1" for row in rows[-len(lopsided) :]) and len(rows) > len(lopsided)
    assert sum(bool(line.endswith("  lopsided")) for line in err.splitlines()) >= len(pair.orbits)
    kinds = [(kind, orbit.gain) for orbit, kind in branch.along()]
    at = [kinds.index(("symmetry breaking", gain)) for gain in breaking]
    assert kinds[at[0] + 1][1] > breaking[0] and kinds[at[1] - 1][1] < breaking[1] and at[1] > at[0] + 1
