"""The command line as a process: exit codes, output that cannot be written, interrupts, crashes."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import PROGRESS, ROOT, contents, one_json, process, rows_of

from casahunt import Branch
from casahunt.servo.saved import load_branch


def test_process_orbit():
    """Neither CasADi nor IPOPT adds a word to what is printed."""
    done = process("orbit", "--gain", "0.1", "--json", "--quiet")
    assert (done.returncode, done.stderr) == (0, "")
    assert one_json(done.stdout)["period"] == pytest.approx(11.35587139, rel=1e-6)


def test_process_exit_codes():
    for words, code in ((["orbit", "--gain", "0"], 2), (["orbit", "--gain", "0.8"], 1), (["--version"], 0)):
        done = process(*words)
        assert done.returncode == code
        assert "Traceback" not in done.stderr and (done.stdout == "") == (code != 0)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full")
def test_output_that_cannot_be_written():
    with Path("/dev/full").open("w") as full:
        done = process("orbit", "--gain", "0.1", "--quiet", capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert done.stderr == "casahunt orbit: the output could not be written: No space left on device\n"


@pytest.mark.skipif(os.name != "posix", reason="pipes")
def test_a_reader_that_has_gone_is_no_fault():
    """As `casahunt glossary | head -1`: quiet, with the exit code of SIGPIPE."""
    reader, writer = os.pipe()
    os.close(reader)
    done = process("glossary", capture_output=False, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


@contextlib.contextmanager
def diagram_under_way(out: Path):
    """A LuGre diagram of which at least three points are on disk, still running."""
    command = ["diagram", "--model", "lugre", "--tol", "1e-9", "--out", str(out)]
    running = subprocess.Popen(
        [sys.executable, "-m", "casahunt", *command],
        cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        # A test run started in the background ignores Ctrl-C, and its children would, too.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 120
        path = out / "lugre.csv"
        while not path.exists() or path.read_bytes().count(b"\n") < 4:
            assert running.poll() is None, running.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        yield running
    finally:
        running.kill()
        running.communicate()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_interrupt(tmp_path):
    out = tmp_path / "out"
    with diagram_under_way(out) as running:
        running.send_signal(signal.SIGINT)
        text, err = running.communicate(timeout=60)
    assert (running.returncode, text) == (130, "")
    *progress, last = err.splitlines()
    assert all(PROGRESS.fullmatch(line) or re.match(r"\d+ s: ", line) for line in progress)  # where a busy machine is
    assert last == f"casahunt diagram: interrupted; the points computed so far are in {out}"
    rows, branch = rows_of(out / "lugre.csv"), load_branch(out / "lugre.npz")
    assert isinstance(branch, Branch) and branch.ended == "interrupted"
    assert 3 <= len(branch.orbits) <= len(rows) <= len(branch.orbits) + 1
    assert [float(row["gain"]) for row in rows][: len(branch.orbits)] == list(branch.gains)
    assert set(contents(out)) == {"lugre.csv", "lugre.npz"}


@pytest.mark.slow  # test_resumed.py kills a Switch diagram
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_crash(tmp_path):
    out = tmp_path / "out"
    with diagram_under_way(out) as running:
        running.kill()
        running.wait(timeout=60)
    rows = rows_of(out / "lugre.csv")
    assert len(rows) >= 3 and all(row["status"] == "converged" for row in rows)
    assert abs(len(load_branch(out / "lugre.npz").orbits) - len(rows)) <= 1
    assert {name for name in contents(out) if not name.endswith(".partial")} == {"lugre.csv", "lugre.npz"}
