"""Processor time and memory of a script's own process: how much it takes, and an end to what takes too much."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class TooSlow(BaseException):
    """The time limit was reached; no `except Exception` on the way keeps it."""


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Raise TooSlow where the block takes more processor time: how busy the machine is must not decide an answer."""

    late = False

    def stop(*_: Any) -> None:
        nonlocal late
        late = True
        raise TooSlow

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)  # again and again, in case a callback swallows the first
    try:
        yield
    except KeyboardInterrupt:  # CasADi makes one of whatever a signal raises within IPOPT
        if late:
            raise TooSlow from None
        raise
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def memory() -> float:
    """Resident memory [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def peak_memory() -> float:
    """Largest resident memory of this process so far [MB]."""
    status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) / 1024  # getrusage would report the parent's
