"""A diagram and a fold curve go on from the points that were computed before an interrupt, a signal or a kill."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import subprocess
import sys

import pytest
from command_line import contents, run
from file_support import ROOT, posix

from casahunt import load_branch, save_branch
from casahunt.design.diagram import diagram_points
from casahunt.views.commands import diagram as command_diagram
from casahunt.views.commands import fold_curve as command_fold_curve
from problems import table1


def stopping(points: int):
    """The diagram, interrupted after so many new points."""

    def stopped(*args, **kwargs):
        steps = diagram_points(*args, **kwargs)
        for _ in range(points):
            yield next(steps)
        raise KeyboardInterrupt

    return stopped


@pytest.mark.parametrize(("natural", "stops"), [(False, [1, 1, 3]), (True, [1, 2])], ids=["arclength", "natural"])
def test_a_diagram_goes_on_where_it_was_interrupted(capsys, tmp_path, undrawn, monkeypatch, natural, stops):
    """Nothing twice, nothing left out: the fold of the report, once, and back to the gain where it began."""
    command = ["diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet", *["--natural"] * natural]
    table, before = tmp_path / "switch.csv", b""
    for i, points in enumerate(stops):
        with monkeypatch.context() as patch:
            patch.setattr(command_diagram, "diagram_points", stopping(points))
            code, _, err = run(capsys, *command, *["--resume"] * (i > 0))
        assert code == 130 and "the points computed so far are in" in err
        assert table.read_bytes().startswith(before)
        before = table.read_bytes()
        assert len(load_branch(tmp_path / "switch.npz").orbits) == sum(stops[: i + 1])
    untouched = contents(tmp_path)
    for other in (["--tol", 1e-7], ["--solver", "newton"], ["--from", 0.61], ["--set", "friction.static=0.55"]):
        code, _, err = run(capsys, *command, *other, "--resume")
        assert code == 2 and "is of another run" in err and contents(tmp_path) == untouched

    assert run(capsys, *command, "--resume")[0] == 0
    assert table.read_bytes().startswith(before)
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    folds = [float(row["gain"]) for row in rows if row["special"] == "fold"]
    assert folds == [pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-6)]
    gains = [float(row["gain"]) for row in rows]
    top = gains.index(folds[0])
    assert gains[:top] == sorted(set(gains[:top])) and gains[top:] == sorted(set(gains[top:]), reverse=True)
    assert gains[0] == 0.6 and rows[-1]["special" if natural else "gain"] == ("fold" if natural else "0.6")

    done = table.read_bytes()
    assert run(capsys, *command, "--resume")[0] == 0
    assert table.read_bytes() == done and set(contents(tmp_path)) == {"switch.csv", "switch.npz"}

    # In one go: other steps behind the interruption, the same branch; what is located does not depend on the steps.
    assert run(capsys, *command, "--out", tmp_path / "whole")[0] == 0
    with (tmp_path / "whole" / "switch.csv").open(newline="") as stream:
        whole = list(csv.DictReader(stream))
    assert rows[: stops[0]] == whole[: stops[0]]
    for name in ("gain", "amplitude_rad", "period_s"):
        located, again = ({r["special"]: float(r[name]) for r in run_ if r["special"]} for run_ in (rows, whole))
        assert located == pytest.approx(again, rel=1e-9 if name == "gain" else 2e-6)
    shutil.rmtree(tmp_path / "whole")

    save_branch(load_branch(tmp_path / "switch.npz"), tmp_path / "switch.npz")  # as Python users write one
    code, _, err = run(capsys, *command, "--resume")
    assert code == 2 and "it does not say how it was computed" in err


def test_a_fold_curve_keeps_its_points(capsys, tmp_path, monkeypatch):
    """The table holds every point as soon as it is found, in the order of the whole one."""
    path, seen = tmp_path / "curve.csv", []
    real = command_fold_curve.fold_curve

    def watched(*args, report, **kwargs):
        def arrived(point):
            report(point)
            seen.append(path.read_text())
            if len(seen) == 3:
                raise KeyboardInterrupt

        return real(*args, report=arrived, **kwargs)

    # The servo's own value, 0.54, is next to the end of the range: the curve is computed from there.
    command = ["fold-curve", "--model", "switch", "--vary", "friction.static", "--from", 0.5, "--to", 0.55]
    command += ["--points", 4, "--csv", path, "--quiet"]
    with monkeypatch.context() as patch:
        patch.setattr(command_fold_curve, "fold_curve", watched)
        code, out, err = run(capsys, *command)
    assert (code, out) == (130, "")
    assert err == f"casahunt fold-curve: interrupted; the points computed so far are in {path}\n"
    assert [len(text.splitlines()) for text in seen] == [2, 3, 4] and path.read_text() == seen[-1]
    code, out, _ = run(capsys, *command, "--json")
    assert code == 0
    (curve,) = json.loads(out)["curves"]
    assert len(curve["points"]) > 3 and path.read_text().splitlines()[-3:] == seen[-1].splitlines()[1:]


@posix
def test_a_signal_ends_a_process_with_its_points(tmp_path):
    """SIGKILL after two points: the files are whole, and the run can be taken up."""
    out = tmp_path / "out"
    words = "diagram", "--model", "switch", "--from", "0.6", "--out", str(out), "--details"
    command = [sys.executable, "-m", "casahunt", *words]
    child = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
    try:
        assert child.stderr is not None
        points = (line for line in child.stderr if line.startswith(b"switch "))  # a busy machine says where it is
        assert next(points) and next(points)
    finally:
        child.send_signal(signal.SIGKILL)
        child.communicate()
    rows = (out / "switch.csv").read_text().splitlines()
    assert len(rows) >= 3 and len({row.count(",") for row in rows}) == 1
    assert len(load_branch(out / "switch.npz").orbits) >= 2


@posix
@pytest.mark.slow
def test_two_runs_after_a_kill(tmp_path):
    """The lock of a killed run holds nobody up; of two that take it up at once one is refused, and nothing is mixed."""
    out = tmp_path / "out"
    words = "diagram", "--model", "switch", "--from", "0.6", "--out", str(out), "--details"
    command = [sys.executable, "-m", "casahunt", *words]

    def started(*more: str) -> subprocess.Popen[str]:
        return subprocess.Popen([*command, *more], cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    first = started()
    try:
        assert first.stderr is not None and first.stderr.readline()
    finally:
        first.kill()
        first.communicate()
    before = (out / "switch.csv").read_text()
    runs = [started("--resume") for _ in range(2)]
    ends = sorted((child.wait(), *child.communicate()) for child in runs)
    # The second may have come when the first was done: then it has found nothing left to do.
    assert [code for code, *_ in ends] in ([0, 2], [0, 0])
    if ends[1][0] == 2:
        assert ends[1][1] == "" and "another run is writing into this folder" in ends[1][2]
    table = (out / "switch.csv").read_text()
    assert table.startswith(before) and table.count(",fold,") == 1
    assert set(contents(out)) == {"switch.csv", "switch.npz", *command_diagram.PICTURES}
