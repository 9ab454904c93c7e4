"""Files appear whole or not at all; nothing is removed that nothing new replaces; one run at a time in a folder."""

from __future__ import annotations

import ast
import csv
import errno
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure

import casahunt
from casahunt import Servo, cli, files, find_fold, load_branch, save_branch
from casahunt.design.diagram import diagram
from casahunt.errors import InputError
from casahunt.views.commands import diagram as command_diagram
from casahunt.views.commands import fold_curve as command_fold_curve
from casahunt.views.commands import tune as command_tune
from casahunt.views.commands.console import folder
from casahunt.views.pictures import plotting
from casahunt.views.pictures import tune as pictures_tune
from problems import table1

ROOT = Path(__file__).resolve().parent.parent
posix = pytest.mark.skipif(os.name != "posix", reason="signals, links, devices")


def contents(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir()}


def run(capsys, *words: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = cli.main([str(word) for word in words])
    return code, *capsys.readouterr()


def full_disk(monkeypatch, *, numbers: Sequence[int] = range(1000)) -> None:
    """What is written gets as far as the disk and no further; of the files those with these numbers."""
    count, fsync = itertools.count(), os.fsync

    def full(handle: int) -> None:
        if next(count) in numbers:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", full)


# Whole files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trouble", [KeyboardInterrupt(), ZeroDivisionError(), OSError(errno.EIO, "broken")], ids=repr)
def test_trouble_leaves_the_old_file(tmp_path, trouble):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(type(trouble)), files.whole_text(path) as stream:
        stream.write("half")
        raise trouble
    assert contents(tmp_path) == {"a.txt": b"old"}
    with files.whole_text(path) as stream:
        stream.write("θ\n")
    assert contents(tmp_path) == {"a.txt": "θ\n".encode()}


@pytest.mark.parametrize("missing", ["O_TMPFILE", "link"])
def test_other_file_systems(tmp_path, monkeypatch, missing):
    """Without files that have no name, and where such a file cannot be given one."""
    if missing == "link":
        monkeypatch.setattr(os, "link", lambda *a, **k: os.open("/nowhere/at/all", os.O_RDONLY))
    else:
        monkeypatch.delattr(os, missing, raising=False)
    path = tmp_path / "a.txt"
    for text in ("one", "another"):
        with files.whole_text(path) as stream:
            stream.write(text)
        assert contents(tmp_path) == {"a.txt": text.encode()}
    with pytest.raises(ZeroDivisionError), files.whole_text(path) as stream:
        raise ZeroDivisionError
    assert contents(tmp_path) == {"a.txt": b"another"}


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="files without a name")
def test_what_is_being_written_has_no_name(tmp_path):
    try:
        os.close(os.open(tmp_path, os.O_TMPFILE | os.O_RDWR))
    except OSError:
        pytest.skip("not on this file system")
    with files.whole(tmp_path / "a.bin") as stream:
        stream.write(b"half")
        stream.flush()
        assert not list(tmp_path.iterdir())
    assert contents(tmp_path) == {"a.bin": b"half"}


@posix
def test_what_is_replaced_keeps_its_permissions_and_its_links(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    with files.whole_text(link) as stream:
        stream.write("new")
    assert link.is_symlink() and path.read_text() == "new" and path.stat().st_mode & 0o777 == 0o640


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full")
def test_a_device_is_written_and_not_replaced(tmp_path, capsys):
    path = tmp_path / "a.csv"
    path.symlink_to("/dev/full")
    code, out, err = run(capsys, "simulate", "--gain", 0.1, "--time", 1, "--csv", path)
    assert code == 1 and out.startswith("switch servo at gain 0.1, ")
    assert err == f"casahunt simulate: the output could not be written: {str(path)!r}: the disk is full\n"
    assert Path("/dev/full").is_char_device() and path.is_symlink()


def test_a_reader_sees_the_old_or_the_new(tmp_path):
    """Two writers and a reader at the same time."""
    path, seen, ended = tmp_path / "a.bin", set(), threading.Event()
    path.write_bytes(b"0" * 300_000)

    def write(letter: bytes) -> None:
        for _ in range(20):
            with files.whole(path) as stream:
                for _ in range(300):
                    stream.write(letter * 1000)

    def read() -> None:
        while not ended.is_set():
            content = path.read_bytes()
            seen.add((len(content), len(set(content))))

    writers = [threading.Thread(target=write, args=(letter,)) for letter in (b"a", b"b")]
    reader = threading.Thread(target=read)
    for thread in (reader, *writers):
        thread.start()
    for thread in writers:
        thread.join()
    ended.set()
    reader.join()
    assert seen == {(300_000, 1)} and [p.name for p in tmp_path.iterdir()] == ["a.bin"]


@posix
def test_a_kill_leaves_no_torn_file_and_no_lock(tmp_path):
    code = (
        "import sys\nfrom pathlib import Path\nfrom casahunt.files import alone_in, whole\n"
        "with alone_in(Path('.')):\n"
        "    for i in range(10**6):\n"
        "        with whole('a.bin') as stream:\n"
        "            for _ in range(500): stream.write(bytes([i % 256]) * 1000)\n"
        "        print(i, flush=True)\n"
    )
    for wait in (1, 4):
        where = {**os.environ, "PYTHONPATH": str(ROOT)}
        child = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, env=where)
        try:
            for _ in range(wait):
                assert child.stdout is not None and child.stdout.readline()
            with pytest.raises(InputError, match="another run is writing into this folder"), files.alone_in(tmp_path):
                pass
        finally:
            child.kill()
            child.communicate()
        content = (tmp_path / "a.bin").read_bytes()
        assert len(content) == 500_000 and len(set(content)) == 1
        with files.alone_in(tmp_path):
            pass


# Every format of every command, and a disk that is full --------------------------------------------------------


def cheap_tuning(monkeypatch) -> None:
    """A tuning that takes no time: only what is written matters here."""
    found = SimpleNamespace(verification=SimpleNamespace(unverified=(), against=()))
    for name, value in (("tune", found), ("before_tasks", None), ("record_of", {"gain": 1.0}), ("page", "<html>")):
        monkeypatch.setattr(command_tune, name, lambda *a, value=value, **k: value)
    monkeypatch.setattr(pictures_tune, "evidence_images", lambda *a, **k: {})


VARY = ["--model", "switch", "--vary", "friction.static", "--from", 0.52, "--to", 0.54, "--points", 2]
WRITERS = {
    "npz": (["orbit", "--gain", 0.1, "--save", "a.npz"], ["a.npz"]),
    "csv": (["simulate", "--gain", 0.1, "--time", 1, "--csv", "a.csv"], ["a.csv"]),
    "points": (["fold-curve", *VARY, "--csv", "a.csv"], ["a.csv"]),
    "html": (["tune", "--out", "."], ["tune.html", "tune.json"]),
    "picture": (["loop", "--gain", 0.1, "--plot", "a.png"], ["a.png"]),
}


@pytest.mark.parametrize("what", WRITERS)
def test_a_full_disk_says_so_and_leaves_what_was_there(capsys, tmp_path, monkeypatch, what):
    words, names = WRITERS[what]
    cheap_tuning(monkeypatch)
    monkeypatch.chdir(tmp_path)
    for name in names:
        Path(name).write_text("old")
    with monkeypatch.context() as patch:
        full_disk(patch)
        code, out, err = run(capsys, *words, "--quiet", "--json")
    # What was computed is said all the same; a curve ends with its first point that cannot be kept.
    assert code == 1 and err.count("\n") == 1
    assert out == "" if what == "points" else isinstance(json.loads(out), dict)
    assert "could not be written" in err and "the disk is full" in err
    assert contents(tmp_path) == {name: b"old" for name in names}
    assert run(capsys, *words, "--quiet", "--json")[0] == 0
    assert set(contents(tmp_path)) == set(names) and b"old" not in contents(tmp_path).values()


@pytest.mark.parametrize("full", [[0], [1], [0, 1]])
def test_the_result_and_every_file_stand_for_themselves(capsys, tmp_path, monkeypatch, full):
    """The archive and the picture of an orbit, each on a disk of its own."""
    paths = [tmp_path / "a.npz", tmp_path / "a.png"]
    command = ["orbit", "--gain", 0.1, "--save", paths[0], "--plot", paths[1], "--quiet"]
    full_disk(monkeypatch, numbers=full)
    code, out, err = run(capsys, *command)
    assert code == 1 and out.startswith("switch servo at gain 0.1: stable hunting cycle") and "status" in out
    said = "; ".join(f"{str(paths[i])!r}: the disk is full" for i in full)
    assert err == f"casahunt orbit: the output could not be written: {said}\n"
    assert set(contents(tmp_path)) == {path.name for i, path in enumerate(paths) if i not in full}


@posix
@pytest.mark.slow
def test_who_reads_nothing_gets_the_files(tmp_path):
    """Nobody reads the output any more (`| head -0`), or it goes to a full disk."""
    words = "orbit --gain 0.1 --save a.npz --plot a.png --quiet"
    for where in ("| true", "> /dev/full"):
        command = f"{sys.executable} -m casahunt {words} {where}; exit ${{PIPESTATUS[0]}}"
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(["bash", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 1 and done.stderr.startswith("casahunt orbit: the output could not be written: ")
        assert set(contents(tmp_path)) == {"a.npz", "a.png"}
        for path in tmp_path.iterdir():
            path.unlink()


@pytest.mark.parametrize("numbers", [[0], [1], [2], [3]])
def test_files_that_belong_together_have_the_same_points(capsys, tmp_path, monkeypatch, numbers):
    """Archive and table of a diagram, the disk being full at either file of either point."""
    full_disk(monkeypatch, numbers=numbers)
    code, _, err = run(capsys, "diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet")
    assert code == 1 and "the disk is full" in err
    if numbers[0] < 2:
        assert not contents(tmp_path)
    else:
        assert set(contents(tmp_path)) == {"switch.csv", "switch.npz"}
        rows = (tmp_path / "switch.csv").read_text().splitlines()[1:]
        assert len(rows) == len(load_branch(tmp_path / "switch.npz").orbits) == 1


def test_files_take_their_places_together(tmp_path, monkeypatch):
    """All are whole, with the content on the disk, before the first is renamed; none where the block fails."""
    paths = [tmp_path / "a", tmp_path / "b"]
    synced, seen, replace, fsync = [], [], os.replace, os.fsync

    def watched(source, target):
        seen.append((len(synced), sorted(len(path.read_bytes()) for path in tmp_path.iterdir())))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", lambda handle: (synced.append(handle), fsync(handle)))
    monkeypatch.setattr(os, "replace", watched)
    for text, trouble in (("old", None), ("newer", ZeroDivisionError), ("newer", None)):
        try:
            with files.together():
                for path in paths:
                    with files.whole_text(path) as stream:
                        stream.write(text)
                if trouble:
                    raise trouble
        except ZeroDivisionError:
            pass
        assert contents(tmp_path) == {path.name: b"old" if trouble else text.encode() for path in paths}
    assert seen == [(2, [3, 3]), (2, [3, 3]), (6, [3, 3, 5, 5]), (6, [3, 5, 5])]
    with files.whole_text(paths[0]) as stream:  # by itself again
        stream.write("latest")
    assert paths[0].read_text() == "latest"


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_a_full_disk_leaves_the_old_picture(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"a.{suffix}"
    path.write_text("old")
    figure = Figure()
    with monkeypatch.context() as patch:
        full_disk(patch)
        with pytest.raises(OSError, match="the disk is full"):
            plotting.save(figure, path)
    assert contents(tmp_path) == {path.name: b"old"}
    plotting.save(figure, path)
    assert path.read_bytes().startswith({"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[suffix])


def test_a_full_disk_ends_a_diagram(capsys, tmp_path, monkeypatch):
    """What was there stays, under another name where the new run had begun."""
    (tmp_path / "switch.csv").write_text("old")
    full_disk(monkeypatch)
    code, out, err = run(capsys, "diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet")
    assert (code, out) == (1, "") and "the disk is full" in err and "Traceback" not in err
    assert list(contents(tmp_path).values()) == [b"old"]


def test_nobody_else_writes_files():
    """Every other way to a file would have to be made whole once more."""
    for path in Path(casahunt.__file__).parent.rglob("*.py"):
        if path.name == "files.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            assert name not in ("write_text", "write_bytes", "savetxt", "unlink", "rmtree", "remove"), path
            if name == "open":
                modes = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                assert not any(set(mode) & set("wax+") for mode in modes), path
            if name in ("savefig", "savez"):
                assert ast.unparse(node.args[0]) in ("stream", "drawn"), path


# What is the user's ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["tune", "--bounds", "x=1,2"], 2),
        (["tune", "--bounds", "gain=2,1"], 2),
        (["tune", "--set", "controller.lead_time=0"], 2),
        (["tune", "--margin", "-1"], 2),
        (["diagram", "--from", "0.8", "--model", "switch"], 1),
        (["diagram", "--from", "100", "--resume"], 2),
        (["diagram", "--tol", "1"], 2),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_run_that_writes_nothing_touches_nothing(capsys, tmp_path, words, code):
    keep = tmp_path / "keep"
    keep.mkdir()
    models = [f"{model}{end}" for model in ("switch", "lugre") for end in (".csv", ".npz")]
    for name in (*command_tune.FILES, *command_diagram.PICTURES, *models, "notes.txt"):
        (keep / name).write_text("mine")
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in keep.iterdir()}
    assert run(capsys, *words, "--out", keep, "--quiet")[:2] == (code, "")
    assert {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in keep.iterdir()} == before


# One run at a time -------------------------------------------------------------------------------------------


@pytest.fixture(params=["flock", "lock file"])
def lock(request, monkeypatch):
    """Both ways to lock a folder."""
    if request.param == "lock file":
        monkeypatch.setattr(files, "_flock", lambda *_: False)
    return request.param


@pytest.mark.parametrize("words", [["tune"], ["diagram", "--model", "switch", "--from", 0.6]], ids=lambda w: w[0])
def test_a_second_run_is_refused(capsys, tmp_path, monkeypatch, words, lock):
    cheap_tuning(monkeypatch)
    out = tmp_path / "out"
    with folder(str(out), []):
        (out / "switch.csv").write_text("of the first run")
        before = contents(out)
        code, text, err = run(capsys, *words, "--out", out, "--quiet")
        assert (code, text) == (2, "") and err.count("\n") == 1
        assert f"out = {str(out)!r}: another run is writing into this folder" in err
        assert contents(out) == before
    assert set(contents(out)) == {"switch.csv"}


@pytest.mark.parametrize("trouble", [None, KeyboardInterrupt(), ZeroDivisionError()], ids=repr)
def test_the_folder_is_free_again(tmp_path, trouble, lock):
    out = tmp_path / "new" / "out"
    for _ in range(2):
        try:
            with folder(str(out), []):
                assert out.is_dir()
                if trouble:
                    raise trouble
        except type(trouble) as error:
            assert error is trouble
        assert not list(tmp_path.iterdir())  # made, not used, unmade


# What was computed before an interrupt -----------------------------------------------------------------------


def stopping(points: int):
    """The diagram, interrupted after so many new points."""

    def stopped(*args, **kwargs):
        steps = diagram(*args, **kwargs)
        for _ in range(points):
            yield next(steps)
        raise KeyboardInterrupt

    return stopped


@pytest.mark.parametrize(("natural", "stops"), [(False, [1, 1, 3]), (True, [1, 2])], ids=["arclength", "natural"])
def test_a_diagram_goes_on_where_it_was_interrupted(capsys, tmp_path, monkeypatch, natural, stops):
    """Nothing twice, nothing left out: the fold of the report, once, and back to the gain where it began."""
    monkeypatch.setattr(command_diagram, "_pictures", lambda *_: None)
    command = ["diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet", *["--natural"] * natural]
    table, before = tmp_path / "switch.csv", b""
    for i, points in enumerate(stops):
        with monkeypatch.context() as patch:
            patch.setattr(command_diagram, "diagram", stopping(points))
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


@pytest.mark.parametrize("to", [0.55, 0.6], ids=["from the end", "from the start"])
def test_a_fold_curve_goes_on_where_it_was_interrupted(capsys, tmp_path, monkeypatch, to):
    """Each point once, and each the fold of its servo, computed by itself."""
    table, save = tmp_path / "curve.csv", tmp_path / "curve.npz"
    ends = (0.5, to) if to == 0.55 else (0.53, to)
    command = ["fold-curve", "--model", "switch", "--vary", "friction.static", "--from", ends[0], "--to", ends[1]]
    command += ["--points", 4, "--csv", table, "--save", save, "--quiet"]
    real = command_fold_curve.fold_curve
    before: list[str] = []
    for number, more in ((1, []), (2, ["--resume"]), (99, ["--resume"])):

        def stopped(*args, report, number=number, **kwargs):
            seen = []

            def arrived(point):
                report(point)
                seen.append(point)
                if len(seen) == number or number == 99 and point.value in ends:  # the last time when all is computed
                    raise KeyboardInterrupt

            return real(*args, report=arrived, **kwargs)

        with monkeypatch.context() as patch:
            patch.setattr(command_fold_curve, "fold_curve", stopped)
            assert run(capsys, *command, *more)[0] == 130
        rows = table.read_text().splitlines()[1:]
        assert set(before) < set(rows) and len(set(rows)) == len(rows)
        assert len(rows) == len(before) + number or number == 99
        before = rows
    untouched = contents(tmp_path)
    for other in (["--tol", 1e-7], ["--to", 0.61], ["--points", 5], ["--set", "friction.coulomb=0.43"]):
        code, _, err = run(capsys, *command, *other, "--resume")
        assert code == 2 and "is of another run" in err and contents(tmp_path) == untouched
    assert run(capsys, *command, "--resume")[0] == 0
    rows = table.read_text().splitlines()[1:]
    assert before == rows and all(row.endswith(",converged,") for row in rows)
    found = [(float(row.split(",")[2]), float(row.split(",")[3])) for row in rows]
    assert (found[0][0], found[-1][0]) == ends and found == sorted(set(found))
    value, gain = found[-2]
    assert find_fold(Servo().replace(**{"friction.static": value}), "switch").gain == pytest.approx(gain, rel=2e-6)
    done = table.read_bytes()
    assert run(capsys, *command, "--resume")[0] == 0 and table.read_bytes() == done


@posix
def test_a_signal_ends_a_process_with_its_points(tmp_path):
    """SIGKILL after two points: the files are whole, and the run can be taken up."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "casahunt", "diagram", "--model", "switch", "--from", "0.6", "--out", str(out)]
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
    command = [sys.executable, "-m", "casahunt", "diagram", "--model", "switch", "--from", "0.6", "--out", str(out)]

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
    assert table.startswith(before) and table.count(",fold\n") == 1
    assert set(contents(out)) == {"switch.csv", "switch.npz", *command_diagram.PICTURES}
