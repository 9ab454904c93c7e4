"""Of a diagram and a fold curve the points are kept that were computed before an interrupt, a signal or a kill."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys

import pytest
from command_line import contents, run
from file_support import ROOT, posix

from casahunt import load_branch
from casahunt.continuation import following
from casahunt.orbits.batched_multipliers import ORBITS_AHEAD
from casahunt.views.commands import diagram as command_diagram
from casahunt.views.commands import fold_curve as command_fold_curve
from problems import table1


def stopping(walk, points: int):
    """The walk, interrupted behind so many points, the one that it sets out from included."""

    def stopped(*args, **kwargs):
        steps = walk(*args, **kwargs)
        for _ in range(points - 1):
            yield next(steps)
        raise KeyboardInterrupt

    return stopped


@pytest.mark.parametrize(("natural", "points"), [(False, 13), (True, 13)], ids=["arclength", "natural"])
def test_a_diagram_keeps_its_points(capsys, tmp_path, undrawn, monkeypatch, natural, points):
    """What was computed before an interrupt is what the whole run begins with."""
    command = ["diagram", "--model", "switch", "--from", 0.3, "--quiet", *["--natural"] * natural, "--out"]
    with monkeypatch.context() as patch:
        name = "walk_naturally" if natural else "walk"
        patch.setattr(following, name, stopping(getattr(following, name), points))
        code, _, err = run(capsys, *command, tmp_path / "part")
    assert code == 130 and "the points computed so far are in" in err
    kept = len(load_branch(tmp_path / "part" / "switch.npz").orbits)
    assert points - ORBITS_AHEAD - 1 <= kept <= points  # what was looked at
    assert set(contents(tmp_path / "part")) == {"switch.csv", "switch.npz"}

    assert run(capsys, *command, tmp_path / "whole")[0] == 0
    part, whole = ((tmp_path / name / "switch.csv").read_text().splitlines() for name in ("part", "whole"))
    assert whole[: len(part)] == part and len(part) > kept
    with (tmp_path / "whole" / "switch.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    folds = [float(row["gain"]) for row in rows if row["special"] == "fold"]
    assert folds == [pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-6)]
    gains = [float(row["gain"]) for row in rows]
    top = gains.index(folds[0])
    assert gains[:top] == sorted(set(gains[:top])) and gains[top:] == sorted(set(gains[top:]), reverse=True)
    assert gains[0] == 0.3 and rows[-1]["special" if natural else "gain"] == ("fold" if natural else "0.3")


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
    """SIGKILL after two points: the table is whole; an archive is written where a branch ends."""
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
    assert not (out / "switch.npz").exists()


@posix
@pytest.mark.slow
def test_two_runs_after_a_kill(tmp_path):
    """The lock of a killed run holds nobody up; of two that begin at once one is refused, and nothing is mixed."""
    out = tmp_path / "out"
    words = "diagram", "--model", "switch", "--from", "0.6", "--out", str(out), "--details"
    command = [sys.executable, "-m", "casahunt", *words]

    def started() -> subprocess.Popen[str]:
        return subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    first = started()
    try:
        assert first.stderr is not None and first.stderr.readline()
    finally:
        first.kill()
        first.communicate()
    runs = [started() for _ in range(2)]
    ends = sorted((child.wait(), *child.communicate()) for child in runs)
    # The second may have come when the first was done.
    assert [code for code, *_ in ends] in ([0, 2], [0, 0])
    if ends[1][0] == 2:
        assert ends[1][1] == "" and "another run is writing into this folder" in ends[1][2]
    table = (out / "switch.csv").read_text()
    assert table.count(",fold,") == 1
    assert set(contents(out)) == {"switch.csv", "switch.npz", *command_diagram.PICTURES}
