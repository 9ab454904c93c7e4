"""Ctrl-C and SIGTERM end the command line: within a second, with exit code 128 + signal, whatever runs.

    importing, or done   the process ends at once: there is nothing to unwind
    computing            KeyboardInterrupt is raised, so that files are closed and what was computed is kept; it is
                         raised again every `AGAIN` seconds until it is under way, since C++ and destructors
                         swallow it (CasADi makes a warning of it, and IPOPT has "failed")
    after `LIMIT`        the process is ended by a thread, however deep in C the main one is

Only the command line installs this, and before the slow imports; who imports the package keeps his own handlers.
Until this module is imported, Python's own answer holds: so it imports only what the interpreter has at hand.

Worker processes leave Ctrl-C, which a terminal sends to all, to the process that started them, and end with it.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

AGAIN = 0.05  # s; longer than an exception needs from where it is raised to the first handler
LIMIT = 0.7  # s from the signal to the end: what is left of a second is for a busy machine
CLEARING = 0.1  # s of that second for what is to be cleared up by force; it takes milliseconds
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


class _State:
    """What the handler knows; there is one main thread, and this is its."""

    installed = False
    computing = False
    held = 0
    received: int | None = None


def install() -> None:
    """Answer SIGINT and SIGTERM in this process, unless it was started to ignore them (nohup, a shell's &)."""
    for number in WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _answer)
    sys.unraisablehook = _unraisable
    _State.installed = True


def begin() -> None:
    """From here signals raise KeyboardInterrupt."""
    _State.computing = True


def end() -> None:
    """From here signals end the process at once, and one that was received is not raised again."""
    _State.computing = False


def check() -> None:
    """Answer a signal that was received, though something on the way may have swallowed it.

    Raises KeyboardInterrupt: one was received.
    """
    if _State.received is not None:
        raise KeyboardInterrupt


@contextmanager
def held() -> Iterator[None]:
    """A short piece of work that is done as a whole: a signal is answered after it."""
    _State.held += 1
    try:
        yield
    finally:
        _State.held -= 1
    check()


def word() -> str:
    """What happened, for the user."""
    return WORDS[signal.Signals(_State.received or signal.SIGINT)]


def leave() -> int:
    """End an interrupted command line at once, with 130 (143 after SIGTERM).

    The interpreter's own way out waits for threads and worker processes, which may be at work for long.
    Where this module is not installed, the exit code is returned.
    """
    code = _code()
    if _State.installed:
        _clear_up()
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):
                stream.flush()
        os._exit(code)
    return code


def _clear_up() -> None:
    """End the worker processes, and give back the semaphores that they shared.

    The processes may still be importing and see nothing of what becomes of this one.  The semaphores have names in the
    system, which destructors remove; a process that ends at once runs none, and multiprocessing's resource tracker
    would remove them in its place and complain of a leak.
    """
    process, synchronize, util = (
        sys.modules.get(f"multiprocessing.{name}") for name in ("process", "synchronize", "util")
    )
    if process is not None:
        with suppress(Exception):
            for child in process.active_children():
                child.kill()
    if synchronize is not None and util is not None:
        with suppress(Exception):
            for finalizer in list(util._finalizer_registry.values()):
                if finalizer._callback == synchronize.SemLock._cleanup:
                    finalizer()


def _code() -> int:
    return 128 + (_State.received or signal.SIGINT)


def _answer(number: int, frame: object) -> None:
    if _State.received is None:
        _State.received = number
        if not _State.computing:
            _say_so()
            leave()
        # Not threading.Thread: the main thread may hold the locks of that module right now.
        _thread.start_new_thread(_insist, (number,))
    if _State.computing and not _State.held and not _under_way():
        raise KeyboardInterrupt


def _say_so() -> None:
    """A message past the stream, whose lock the main thread may hold; none where nobody reads it."""
    import select

    with suppress(OSError, ValueError):
        if select.select([], [2], [], 0)[1]:
            os.write(2, f"casahunt: {word()}\n".encode())


def _under_way() -> bool:
    """Whether a KeyboardInterrupt is being handled: an `except`, `finally` or `with` is cleaning up after it."""
    error = sys.exc_info()[1]
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False


def _insist(number: int) -> None:
    """Send the signal again until the process has ended, and end it in the end."""
    import threading

    main = threading.main_thread().ident or 0
    last = time.monotonic() + LIMIT
    while time.monotonic() < last:
        time.sleep(AGAIN)
        if hasattr(signal, "pthread_kill"):
            signal.pthread_kill(main, number)  # also wakes it where it waits
        else:
            _thread.interrupt_main(signal.Signals(number))
    _say_so()
    cleared = _thread.allocate_lock()
    cleared.acquire()

    def clear() -> None:
        _clear_up()
        cleared.release()

    _thread.start_new_thread(clear, ())  # the main thread, wherever it is, may hold a lock that is needed there
    cleared.acquire(timeout=CLEARING)
    os._exit(_code())


def _unraisable(found: sys.UnraisableHookArgs) -> None:
    """No traceback for an interrupt that came up in a destructor and went no further: it is raised again."""
    if _State.received is None or not issubclass(found.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(found)


def end_with_parent() -> None:
    """Initialise a worker process so that it ends when its parent does, however that one ends.

    A worker of a pool whose parent was killed would wait for its next task for ever: its siblings hold the other end
    of the queue open.
    """
    import multiprocessing
    import threading
    from multiprocessing.connection import wait

    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def serve() -> None:
    """Initialise a worker process of the command line: an interrupt is its parent's, with which it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Processes started here never see Ctrl-C, not even while they import; it reaches this one afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _is_command_line() -> bool:
    """Whether this process is `python -m casahunt` or the script `casahunt`, and no worker of one.

    sys.argv[0] is "-m" only until the module that was asked for has been found, and its package imported.
    """
    script = os.path.basename(sys.argv[0]) if getattr(sys, "argv", None) else ""
    asked = script == "-m" and any(word in ("casahunt", "-mcasahunt") for word in sys.orig_argv)
    return (asked or script in ("casahunt", "casahunt.exe")) and "--multiprocessing-fork" not in sys.orig_argv


def _is_worker() -> bool:
    """Whether this process works for a command line: it is started with the arguments of that one."""
    script = sys.argv[0] if getattr(sys, "argv", None) else ""
    folder, name = os.path.split(script)
    asked = name in ("casahunt", "casahunt.exe") or (os.path.basename(folder), name) == ("casahunt", "__main__.py")
    return asked and "--multiprocessing-fork" in sys.orig_argv


def _end_with_parent_while_importing() -> None:
    """End this process when it has got another parent; `end_with_parent` can begin only when all is imported."""
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(AGAIN)
    os._exit(1)


if _is_command_line():
    install()
elif _is_worker():
    _thread.start_new_thread(_end_with_parent_while_importing, ())
