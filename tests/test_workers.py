"""Worker processes end with their parent, however that one ends."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
import textwrap
import time

import pytest
from signal_support import PATIENCE, SLOW_IMPORT

from scripts.interrupts import ROOT, SIGNALS, session

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")


def test_idle_workers_end_with_a_killed_parent():
    code = """
        import multiprocessing, os, time
        from concurrent.futures import ProcessPoolExecutor
        from casahunt.interrupts import serve

        os.setsid()
        pool = ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"), initializer=serve)
        waiting = [pool.submit(time.sleep, 0.5) for _ in range(2)]
        [each.result() for each in waiting]
        print(os.getpid(), flush=True)
        time.sleep(120)
        """
    command = [sys.executable, "-c", textwrap.dedent(code)]
    process = subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE)
    assert process.stdout is not None
    leader = int(process.stdout.readline())
    try:
        assert len(session(leader)) >= 3
        process.kill()
        process.wait()
        end = time.monotonic() + PATIENCE
        while session(leader):
            assert time.monotonic() < end
            time.sleep(0.05)
    finally:
        for pid in session(leader):
            os.kill(pid, signal.SIGKILL)
        process.stdout.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", SIGNALS)
def test_workers_that_still_import_end_with_their_parent(tmp_path, kind):
    slow = "import sys\nif '--multiprocessing-fork' in sys.orig_argv:\n" + textwrap.indent(
        SLOW_IMPORT.replace('print("ready", flush=True)', 'open(f"ready-{time.time_ns()}", "w").close()'), "    "
    )
    (tmp_path / "sitecustomize.py").write_text(slow)
    (tmp_path / "uncertain.toml").write_text('[interval]\n"friction.static" = [0.47, 0.53]\n')
    words = "uncertainty --uncertainty uncertain.toml --samples 4 --jobs 2 --quiet"
    process = subprocess.Popen(
        [sys.executable, "-m", "casahunt", *words.split()],
        cwd=tmp_path, start_new_session=True, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        end = time.monotonic() + PATIENCE
        while not list(tmp_path.glob("ready-*")):  # a worker imports CasADi when it gets its first task
            assert process.poll() is None and time.monotonic() < end
            time.sleep(0.02)
        number, code = SIGNALS[kind]
        process.send_signal(number)
        assert process.wait(PATIENCE) == code
        while session(process.pid):
            assert time.monotonic() < end + PATIENCE
            time.sleep(0.02)
    finally:
        for pid in session(process.pid):
            os.kill(pid, signal.SIGKILL)
        process.communicate()


SOURCES = [*ROOT.glob("casahunt/**/*.py"), *ROOT.glob("scripts/*.py")]


def test_every_pool_ends_with_its_parent():
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "Pool" in text else ():
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("ProcessPoolExecutor", "Pool"):
                assert any(k.arg == "initializer" for k in node.keywords), f"{path.name}, line {node.lineno}"
