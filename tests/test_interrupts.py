"""Ctrl-C and SIGTERM: exit code, cleaning up, what swallows an interrupt; real commands."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import textwrap

import pytest
from signal_support import PATIENCE, SLOW_IMPORT

from scripts.interrupts import COMMANDS, ROOT, SIGNALS, trial

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")


COMMAND_LINE = """
import os, signal, sys, time
sys.argv = ["casahunt", "loop", "--gain", "1"]
from casahunt import NoOrbit, cli, interrupts
from casahunt.views.commands import loop

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

loop.run = lambda options: work(options)
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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("by_thread", [False, True])
def test_worker_processes_leave_nothing(number, by_thread):
    """No process, and no semaphore for multiprocessing's resource tracker, which would complain on standard error."""
    work = f"""
        import multiprocessing
        from concurrent.futures import ProcessPoolExecutor

        def work(options):
            spawn = multiprocessing.get_context("spawn")
            pool = ProcessPoolExecutor(2, mp_context=spawn, initializer=interrupts.serve)
            pool.submit(time.sleep, 120)
            try:
                wait()
            finally:
                {"wait()" if by_thread else "pool.shutdown(wait=False, cancel_futures=True)"}
        """
    said = f"casahunt{'' if by_thread else ' loop'}: {'interrupted' if number == signal.SIGINT else 'terminated'}\n"
    assert on_the_command_line(work, number) == (128 + number, "", said)


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
        print("ready", flush=True)  # what comes after it in one block would be read with it
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


def test_a_random_moment(tmp_path):
    found = trial("diagram", "int", 0.9, tmp_path, limit=PATIENCE)
    assert found is not None and not found.complaints


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", SIGNALS)
def test_random_moments(tmp_path, command, kind):
    rng = random.Random(f"{command} {kind}")
    found = trial(command, kind, rng.uniform(0, 3), tmp_path, group=rng.random() < 0.5, limit=PATIENCE)
    assert found is None or not found.complaints
