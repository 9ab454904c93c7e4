"""Processes that a command shares its work out to."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager

from ... import interrupts
from ...errors import NoOrbit, Status
from .arguments import Asked, count_of


def jobs_of(options: Asked) -> int:
    """Of the option --jobs: how many processes; by default all processors that this one may run on.

    Raises InputError: it is no whole number above zero.
    """
    if options.jobs is not None:
        return count_of("jobs", options.jobs, 1)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def processes(jobs: int) -> Iterator[Executor | None]:
    """So many processes; None for one, which is this one.  Raises NoOrbit: one has died."""
    if jobs == 1:
        yield None
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    # Fresh interpreters: a forked one would inherit CasADi's state and whatever threads there are.
    with interrupts.held():  # a semaphore that is only half there nobody would give back
        spawn = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(jobs, mp_context=spawn, initializer=interrupts.serve)
    done = False
    try:
        with interrupts.kept_from_children():
            for _ in range(jobs):  # every task starts a process, as long as none is idle
                pool.submit(int)
        yield pool
        done = True
    except BrokenExecutor:
        raise NoOrbit(
            "a process that computes has died, perhaps for want of memory; take fewer --jobs", Status.NOT_CONVERGED
        ) from None
    finally:
        pool.shutdown(wait=done, cancel_futures=True)  # an interrupt does not wait for what is under way
