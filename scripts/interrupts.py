"""Commands that are interrupted, terminated or killed at random times: how they end, and what they leave.

    python -m scripts.interrupts                            34 signals of each kind, over six commands
    python -m scripts.interrupts --signals int --trials 100

A time is drawn between a process's first moments and the end of an undisturbed run.  Each trial must end within a
second with the exit code of its signal; without a traceback; with every file whole, and as many orbits in the archive
of a diagram as in its table; and with no process left two seconds later.

Until the package answers signals, Python does: none is sent before that, some 50 ms after the start.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from casahunt import InputError, load_branch, load_orbit

ROOT = Path(__file__).resolve().parent.parent
UNCERTAIN = '[interval]\n"friction.static" = [0.47, 0.53]\n"friction.coulomb" = [0.42, 0.45]\n'
COMMANDS = {
    "orbit": "orbit --model lugre --gain 0.3 --solver ipopt --tol 1e-9 --save orbit.npz --plot orbit.png",
    "diagram": "diagram --out out",
    "diagram-ipopt": "diagram --model lugre --solver ipopt --out out",
    "fold-curve": "fold-curve --vary friction.static --from 0.5 --to 1 --csv curve.csv --plot curve.png",
    "tune": "tune --out out",
    "uncertainty": "uncertainty --uncertainty uncertain.toml --samples 60 --jobs 2 --plot samples.png",
}
SIGNALS = {"int": (signal.SIGINT, 130), "term": (signal.SIGTERM, 143), "kill": (signal.SIGKILL, -signal.SIGKILL)}
PATIENCE = 30.0  # s
LATE = 0.1  # s; a run that ends well so soon after a signal had no part in it


@dataclass(frozen=True)
class Trial:
    """One signal.

    Attributes
    ----------
    command, kind, at : what was interrupted, by which signal, how long after its start [s].
    seconds : from the signal to the end of the process.
    complaints : what should not be.
    """

    command: str
    kind: str
    at: float
    seconds: float
    complaints: tuple[str, ...]


def session(leader: int) -> list[int]:
    """The processes of a session that are still there (Linux)."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            state, _, _, sid = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(sid) == leader and state != "Z":
            found.append(int(entry.name))
    return found


def answers(pid: int) -> bool:
    """Whether a process has a handler for SIGTERM, as Python of itself has not; True where that cannot be seen."""
    try:
        status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
    except OSError:
        return True
    return bool(int(status.get("SigCgt", "f" * 16), 16) >> (signal.SIGTERM - 1) & 1)


def torn(folder: Path, *, between: int = 0) -> list[str]:
    """What is not whole in a folder; tables may be so many rows behind their archives."""
    found = []
    orbits, rows = {}, {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        data = path.read_bytes()
        if path.suffix == ".csv":
            table = list(csv.reader(data.decode().splitlines()))
            rows[path.with_suffix("")] = len(table) - 1
            if not data.endswith(b"\n") or any(len(row) != len(table[0]) for row in table):
                found.append(f"{path.name} is torn")
        elif path.suffix == ".npz":
            try:
                if path.name != "orbit.npz":
                    orbits[path.with_suffix("")] = load_branch(path)
                else:
                    load_orbit(path)
            except InputError as error:
                found.append(str(error))
        elif path.suffix == ".png" and not data.endswith(b"IEND\xaeB`\x82"):
            found.append(f"{path.name} is torn")
    for name, branch in orbits.items():
        extra = sum(not any(s.orbit is o for o in branch.orbits) for s in branch.special)
        if name in rows and not len(branch.orbits) - between <= rows[name] <= len(branch.orbits) + extra:
            found.append(f"{name.name}: {rows[name]} rows, {len(branch.orbits)} orbits")
    return found


def started(command: str, folder: Path, err: IO[bytes]) -> subprocess.Popen[bytes]:
    """A command in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "casahunt", *COMMANDS[command].split()],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=err, start_new_session=True,
        # What is started in the background ignores Ctrl-C, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def signalled(process: subprocess.Popen[bytes], kind: str, wait: float, *, group: bool) -> float | None:
    """Signal a process after `wait` [s]; the time of that, None where the process ended before."""
    try:
        process.wait(wait)
        return None
    except subprocess.TimeoutExpired:
        while kind != "kill" and process.poll() is None and not answers(process.pid):
            time.sleep(0.001)
        if process.poll() is not None:
            return None
        sent = time.monotonic()
        (os.killpg if group else os.kill)(process.pid, SIGNALS[kind][0])
        return sent


def ending(process: subprocess.Popen[bytes], kind: str, sent: float, limit: float) -> tuple[float, list[str]] | None:
    """(seconds from the signal to the end, complaints about it); None where the signal had no part in it."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(PATIENCE)
    seconds, complaints = time.monotonic() - sent, []
    if process.returncode == 0 and seconds < LATE:
        return None  # the interpreter was on its way out and asked for no signals any more
    if process.returncode != SIGNALS[kind][1]:
        complaints.append(f"exit code {process.returncode}")
    if seconds > limit:
        complaints.append(f"{seconds:.2f} s")
    while (left := session(process.pid)) and time.monotonic() < sent + seconds + 2 * limit:
        time.sleep(0.02)
    if left:
        complaints.append(f"processes left: {left}")
    return seconds, complaints


def said(text: str, kind: str) -> list[str]:
    """Complaints about what stands on standard error."""
    if kind == "kill":
        return []
    found = [f"{word!r} on standard error" for word in ("Traceback", "Exception ignored", "leaked") if word in text]
    if text.count("terminated" if kind == "term" else "interrupted") != 1:
        found.append(f"not said once: {text[-300:]!r}")
    return found


def trial(command: str, kind: str, at: float, folder: Path, *, group: bool = False, limit: float = 1.0) -> Trial | None:
    """Run a command in an empty folder and signal it (`group`: its workers, too); None where it ended before that.

    It is to end within `limit` [s], and every worker at most twice as long after it.
    """
    (folder / "uncertain.toml").write_text(UNCERTAIN)
    began = time.monotonic()
    with (folder / "stderr").open("w+b") as err:
        process = started(command, folder, err)
        try:
            sent = signalled(process, kind, max(at - (time.monotonic() - began), 0), group=group)
            end = None if sent is None else ending(process, kind, sent, limit)
        finally:
            for pid in session(process.pid):
                os.kill(pid, signal.SIGKILL)
            process.wait()
        if end is None:
            return None
        err.seek(0)
        text = err.read().decode()
    seconds, complaints = end
    # SIGKILL may come between the renaming of an archive and that of its table, which some file systems wait for.
    unfinished = torn(folder, between=int(kind == "kill"))
    return Trial(command, kind, at, seconds, (*complaints, *said(text, kind), *unfinished))


def duration(command: str, most: float) -> float:
    """Seconds of an undisturbed run, `most` where it takes longer."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "uncertain.toml").write_text(UNCERTAIN)
        began = time.monotonic()
        with contextlib.suppress(subprocess.TimeoutExpired):
            done = subprocess.run(
                [sys.executable, "-m", "casahunt", *COMMANDS[command].split(), "--quiet"],
                cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=most,
            )  # fmt: skip
            if done.returncode not in (0, 1):
                raise SystemExit(f"{command} cannot run: {done.stderr}")
        return min(time.monotonic() - began, most)


def main(words: Sequence[str] | None = None) -> int:
    """Run the trials and print what was found; 1 where anything is not as it should be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=34, help="signals of each kind (default 34)")
    parser.add_argument("--signals", nargs="+", choices=SIGNALS, default=list(SIGNALS))
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--until", type=float, default=15.0, help="latest time of a signal [s] (default 15)")
    parser.add_argument("--group", action="store_true", help="signal the whole process group, as a terminal does")
    options = parser.parse_args(words)
    rng = random.Random(options.seed)
    lengths = {command: duration(command, options.until) for command in options.commands}
    for command, seconds in lengths.items():
        print(f"{command:14s} {seconds:.1f} s", flush=True)
    bad = 0
    for kind in options.signals:
        ended: list[Trial] = []
        while len(ended) < options.trials:
            command = options.commands[len(ended) % len(options.commands)]
            at = rng.uniform(0, lengths[command])
            with tempfile.TemporaryDirectory() as folder:
                found = trial(command, kind, at, Path(folder), group=options.group)
            if found is None:
                continue
            ended.append(found)
            if found.complaints:
                bad += 1
                print(f"  {kind} {command} after {at:.3f} s: {'; '.join(found.complaints)}", flush=True)
        times = sorted(t.seconds for t in ended)
        good = sum(not t.complaints for t in ended)
        print(f"{kind:4s} {good} of {len(ended)} as they should be; median {times[len(times) // 2]:.2f} s, "
              f"longest {times[-1]:.2f} s", flush=True)  # fmt: skip
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
