"""Ctrl-C and SIGTERM: exit code, cleaning up, what swallows an interrupt; workers end with their parent."""

from __future__ import annotations

import ast
import gc
import os
import random
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import FrameType

import pytest

from casahunt import NoOrbit, Options, Servo, compiled, find_orbit, simulate
from casahunt.collocation import interval
from casahunt.orbits.orbit import unknowns_of
from scripts.interrupts import COMMANDS, ROOT, SIGNALS, session, trial

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")
PATIENCE = 30.0  # s; what takes as long is stuck

COMMAND_LINE = """
import os, signal, sys, time
sys.argv = ["casahunt", "loop"]
from casahunt import NoOrbit, cli, interrupts

def wait(seconds=120.0, said=[]):
    if not said:
        said.append(True)
        print("ready", flush=True)  # the signal comes here or later
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(0.01)

def swallow(work=wait):
    try:
        work()
    except KeyboardInterrupt:
        pass

cli.command_loop.run = lambda options: work(options)
"""


def outcome(code: str, *numbers: signal.Signals, ready: str = "ready") -> tuple[int, str, str]:
    """(exit code, output, errors) of a program that gets signals when it is ready."""
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        # A test run started in the background ignores Ctrl-C, and its children would, too.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:  # fmt: skip
        try:
            assert process.stdout is not None and process.stdout.readline().strip() == ready
            for number in numbers:
                process.send_signal(number)
            out, err = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    return process.returncode, out, err


def on_the_command_line(work: str, *numbers: signal.Signals) -> tuple[int, str, str]:
    """The same for a command that does `work`."""
    code = COMMAND_LINE + textwrap.dedent(work) + "\nsys.exit(cli.main())\n"
    return outcome(code, *(numbers or (signal.SIGINT,)))


WORK = {
    "swallowed once": "def work(options): swallow(); wait()",
    "swallowed by the last thing it does": "def work(options): swallow(); return 0",
    "taken for a failure": """
        def work(options):
            swallow()
            raise NoOrbit("not found")
        """,
    "taken for another mistake": """
        def work(options):
            swallow()
            raise RuntimeError("of a library")
        """,
    "while a thread goes on": """
        import threading

        def work(options):
            threading.Thread(target=time.sleep, args=(120,)).start()
            wait()
        """,
    "raised in a destructor": """
        class Slow:
            def __del__(self):
                wait(1)

        def work(options):
            Slow()
            wait()
        """,
    "cleaned up after for ever": """
        def work(options):
            try:
                wait()
            finally:
                wait()
        """,
}


@pytest.mark.parametrize("work", WORK.values(), ids=WORK)
def test_an_interrupt_ends_a_command(work):
    by_thread = work == WORK["cleaned up after for ever"]
    said = "casahunt: interrupted\n" if by_thread else "casahunt loop: interrupted\n"
    assert on_the_command_line(work) == (130, "", said)


def test_terminated():
    assert on_the_command_line("def work(options): wait()", signal.SIGTERM) == (143, "", "casahunt loop: terminated\n")


def test_cleaning_up_is_not_interrupted():
    """Neither by the second signal nor by those that make sure that the first one arrives."""
    work = """
        def work(options):
            try:
                wait()
            finally:
                wait(0.3)
                print("kept")
        """
    both = (signal.SIGINT, signal.SIGINT)
    assert on_the_command_line(work, *both) == (130, "kept\n", "casahunt loop: interrupted\n")


def test_a_piece_of_work_is_done_as_a_whole():
    work = """
        def work(options):
            with interrupts.held():
                wait(0.3)
                print("whole")
            print("too late")
        """
    assert on_the_command_line(work) == (130, "whole\n", "casahunt loop: interrupted\n")


SLOW_IMPORT = """
import sys, time
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == "casadi":
            print("ready", flush=True)
            time.sleep(120)
sys.meta_path.insert(0, Slow())
"""


@pytest.mark.parametrize("start", [
    "sys.argv = ['casahunt']; import casahunt.cli",  # what the script does
    "import runpy; sys.argv = sys.orig_argv = ['-m', 'casahunt']; runpy._run_module_as_main('casahunt')",
], ids=["script", "python -m"])  # fmt: skip
def test_imports_are_interrupted(start):
    """Before there is a command: no traceback, whatever is being imported."""
    assert outcome(SLOW_IMPORT + start, signal.SIGINT) == (130, "", "casahunt: interrupted\n")


def test_the_handlers_of_others_are_left_alone():
    """Of a program that imports the package, also as a module or with a like name, and of the worker processes."""
    code = """
        import signal, sys
        sys.argv = ["mine.py", "casahunt"]
        sys.orig_argv = ["python", *sys.argv]
        before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM), sys.unraisablehook
        from casahunt import cli, interrupts
        assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM), sys.unraisablehook) == before
        sys.orig_argv = ["python", "-c", "..."]
        words = [["-c"], [""], [], ["-m"], ["casahunt_mine"], ["-m", "casahunt"]]
        for sys.argv in words:
            assert not interrupts._is_command_line(), sys.argv
        sys.argv, sys.orig_argv = ["/usr/bin/casahunt"], ["python", "-c", "...", "--multiprocessing-fork"]
        assert not interrupts._is_command_line()
        print("ready")
        """
    assert outcome(textwrap.dedent(code)) == (0, "", "")


def test_who_ignores_interrupts_goes_on_ignoring_them():
    """nohup, or & in a script."""
    work = "def work(options): wait(0.2); print('done'); return 0"
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)" + COMMAND_LINE + work
    assert outcome(code + "\nsys.exit(cli.main())", signal.SIGINT) == (0, "done\n", "")


def test_who_uses_the_package_can_interrupt_ipopt():
    """CasADi turns what a signal raises there into a failure of IPOPT."""
    code = """
        import signal, sys
        from casahunt import Options, Servo, find_orbit
        from casahunt.collocation import ipopt

        def late(number, frame):
            # Within the solver's C++, which asks for signals: `call` is the last frame of Python before it.
            if frame.f_code.co_name == "call" and frame.f_back.f_back.f_code.co_name == "_call":
                signal.setitimer(signal.ITIMER_REAL, 0)
                raise KeyboardInterrupt

        signal.signal(signal.SIGALRM, late)
        print("ready")
        for _ in range(3):
            ipopt._ipopt_solver.cache_clear()
            signal.setitimer(signal.ITIMER_REAL, 0.003, 0.003)
            try:
                find_orbit(Servo(), "switch", 0.1, options=Options(solver="ipopt"))
            except KeyboardInterrupt:
                print("interrupted")
        """
    code, out, _ = outcome(textwrap.dedent(code))
    assert (code, out) == (0, 3 * "interrupted\n")


# Ctrl-C of who uses the package, where CasADi swallows it


def inside(frame: FrameType) -> bool:
    """A function of CasADi's Python, or of the module that deals with it; from a destructor no exception gets out."""
    return frame.f_code.co_name != "__del__" and frame.f_code.co_filename.endswith(("casadi.py", "compiled.py"))


def place(frame: FrameType) -> tuple[object, ...]:
    """What is called, by whom, and for which line of the package."""
    line, by = frame, frame.f_back
    while line is not None and line.f_globals.get("__name__", "").partition(".")[0] != "casahunt":
        line = line.f_back
    assert by is not None
    return frame.f_code, by.f_code, by.f_lineno, line and (line.f_code, line.f_lineno)


def lost(work: Callable[[], object], *, every: int = 1) -> tuple[int, list[tuple[object, ...]]]:
    """(number of places where Ctrl-C was sent, those where it did not arrive): each place where `work` calls CasADi.

    It is sent once for every place, when `work` first comes there.
    """
    places: dict[tuple[object, ...], None] = {}

    def watch(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and inside(frame):
            places[place(frame)] = None

    sys.setprofile(watch)
    try:
        work()
    finally:
        sys.setprofile(None)
    gone = []
    tried = list(places)[::every]
    for where in tried:

        def strike(frame: FrameType, event: str, _: object, where: tuple[object, ...] = where) -> None:
            if event == "call" and inside(frame) and place(frame) == where:
                sys.setprofile(None)
                signal.raise_signal(signal.SIGINT)

        try:
            sys.setprofile(strike)
            work()
            gone.append(where)
        except KeyboardInterrupt:
            pass
        finally:
            sys.setprofile(None)
    return len(tried), gone


@pytest.fixture
def ctrl_c():
    """Python's own handler, which a test run in the background has not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    compiled.alone(lambda: None)()  # an interrupt on its way out may have left the handler
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


def test_an_interrupt_that_casadi_swallows_arrives(ctrl_c, orbit):
    """In the conversion of an argument, which CasADi takes for one that does not fit; and nothing half done stays."""
    t, _, setting = unknowns_of(orbit("switch", 0.3))
    mode = t.cycle.phases[0].mode

    def build() -> list[str]:
        for function in (interval.point_function, interval.interval_function):
            function.cache_clear()
        point = interval.point_function(mode.field, t.n, setting.p.size)
        block = interval.interval_function(mode.field, t.n, setting.p.size, t.degree, t.kind)
        return [point.serialize(), block.serialize()]

    before = build()
    number, gone = lost(build, every=3)
    assert number > 50 and not gone
    assert build() == before

    def swallowed() -> None:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        compiled.alone(swallowed)()
    with pytest.raises(KeyboardInterrupt):  # inside another block, of which something makes a failure
        compiled.alone(lambda: _failed(compiled.alone(swallowed)))()
    compiled.alone(lambda: None)()  # said once
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def _failed(work: Callable[[], object]) -> None:
    try:
        work()
    except BaseException as error:
        raise NoOrbit("not found") from error


@pytest.mark.parametrize("handler", [lambda *_: None, signal.SIG_IGN, signal.SIG_DFL], ids=["counts", "ignored", "own"])
def test_who_does_not_raise_is_not_asked_to(handler):
    before = signal.signal(signal.SIGINT, handler)
    try:
        if handler is not signal.SIG_DFL:
            assert compiled.alone(lambda: signal.raise_signal(signal.SIGINT) or "done")() == "done"
        with ThreadPoolExecutor(1) as pool:
            assert pool.submit(compiled.alone(lambda: "done")).result() == "done"
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["newton", "ipopt", "integrator", "lugre", "simulate"])
def test_no_interrupt_is_lost(ctrl_c, what):
    """At every place where a computation calls CasADi, everything being built anew each time."""
    model = "lugre" if what == "lugre" else "switch"
    solver = what if what in ("newton", "ipopt") else "auto"
    caches = [found for found in gc.get_objects() if isinstance(found, compiled.Kept)]

    def work() -> None:
        for cache in caches:
            cache.cache_clear()
        if what == "simulate":
            simulate(Servo(), "switch", 0.3, time=5.0)
            return
        found = find_orbit(Servo(), model, 0.1, options=Options(tol=1e-4, solver=solver))
        if what == "integrator":
            _ = found.integrator_multipliers

    number, gone = lost(work)
    assert number > 100 and not gone


# Workers


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


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_every_pool_ends_with_its_parent(path: Path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("ProcessPoolExecutor", "Pool"):
            assert any(k.arg == "initializer" for k in node.keywords), f"line {node.lineno}"


# Real commands


def test_a_random_moment(tmp_path):
    found = trial("diagram", "int", 0.9, tmp_path, limit=PATIENCE)
    assert found is not None and not found.complaints


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", SIGNALS)
def test_random_moments(tmp_path, command, kind):
    rng = random.Random(f"{command} {kind}")
    for k in range(2):
        (tmp_path / str(k)).mkdir()
        found = trial(command, kind, rng.uniform(0, 3), tmp_path / str(k), group=k == 1, limit=PATIENCE)
        assert found is None or not found.complaints
