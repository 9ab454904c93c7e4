"""A process with an engine of its own, which answers the newest question and drops the others.

    page's process   ask(n, address) --pipe-->  worker   newest <- n, shared: looked at after every interval
                     heard(n, stage, what) <--pipe--

A thread would share the interpreter with the page; CasADi's symbols are not safe in two threads, and what is stuck deep
in a library can only be ended with its process.  A worker that says nothing and computes no interval for
`LONGEST_SILENCE` is ended and another one started; one that computes is not, however slow the machine.

What the page shows of a state, in stages: the first numbers first, each stage as plain numbers and texts.

    hunts     does it hunt: sentence, amplitude, period; one period of angle, velocity and torque
    linear    friction curve, margins of the loop without dry friction
    border    the gain, or the size of the remedy, at which hunting ends, and how far off that is
    step      a step of the set point as simulated, with its largest torque
    diagram   amplitude against gain, stable and unstable

Each stage has so much work (effort.py), and is given up beyond it; what is not found is a sentence in its place
(numbers.py).  What does not depend on the gain, or on the size of the remedy, is kept for the next move, which as a
rule changes that alone; what is shown does not depend on the moves before.
"""

from __future__ import annotations

import ctypes
import logging
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from ... import effort, interrupts
from ...errors import InputError, NoOrbit
from ...servo.friction import MODELS
from ...servo.parts.table import remedies_for
from .numbers import refused
from .page_stages import Stages
from .state import SET_POINT, State, state_of_address

_LOG = logging.getLogger(__name__)
Heard = Callable[[int, str, dict[str, Any]], None]
"""(number of the question, stage, what it shows): stage "done" after the last one."""
DONE = "done"
LONGEST_SILENCE, LONGEST_START = 30.0, 300.0
"""Seconds without a word or an interval, which takes 1 ms, after which a worker that has a question is ended; before
its first one it reads what it computes with, for a second where the machine does nothing else."""
TO_END = 1.0
"""Seconds that a worker has to end by itself."""
MOST_MEGABYTES = 400.0
"""Memory beyond which a worker ends, behind an answer, and another one takes its place: some five times its first.
What the engine has compiled it keeps in caches of so many entries each, which random moves fill with some 300."""
WARM = "gain=0.1"
"""A first question to itself: it fills the caches of the engine."""
IDLE = 0.5
"""Seconds without a question after which a worker compiles for one that may come."""


def serve(pipe: Any, newest: Any, computed: Any) -> None:
    """The worker's whole life: questions from the pipe, answers into it.

    newest, computed: number of the newest question, and of intervals so far, shared.
    """
    interrupts.serve()
    asked, ahead = Answers(), _ahead()
    for _ in asked.of(state_of_address(WARM), partial(_passed, newest, computed)):
        pass
    with suppress(EOFError, OSError):
        while True:
            while not pipe.poll(IDLE) and (state := next(ahead, None)) is not None:
                try:
                    next(Answers().of(state, pipe.poll))
                except effort.Dropped:
                    pass  # it compiles when it is chosen, as it would without
                except Exception:
                    _LOG.exception("nothing more is compiled ahead")
                    ahead = iter(())
            question = pipe.recv()
            if question is None:
                return
            number, address = question
            if number != newest.value:
                continue
            with suppress(effort.Dropped):
                for stage, shown in asked.of(state_of_address(address), partial(_passed, newest, computed, number)):
                    pipe.send((number, stage, shown))
                pipe.send((number, DONE, {}))
            _give_back()
            if _megabytes() > MOST_MEGABYTES:
                return


def _ahead() -> Iterator[State]:
    """States that a person may choose: the first time, each model and each remedy compiles for 0.1 to 0.4 s."""
    first = state_of_address(WARM)
    for model in MODELS:
        chosen = first.choose("model", model)
        if chosen != first:
            yield chosen
        yield from (chosen.choose("remedy", name) for name in remedies_for(model))


def _give_back() -> None:
    """Let the system have what was freed, which the C library keeps for later: a third of all, in a millisecond."""
    with suppress(AttributeError, OSError, TypeError):  # not glibc's, or Windows, which has no library None
        ctypes.CDLL(None).malloc_trim(0)


def _megabytes() -> float:
    """Memory of this process, or the most that it has had where the system says that alone; 0 where it says nothing."""
    with suppress(OSError):
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak) / (1e6 if sys.platform == "darwin" else 1e3)


def _passed(newest: Any, computed: Any, number: int | None = None) -> bool:
    """Whether another question than this one, if it is one, is the newest; asked with every interval, and counted."""
    computed.value += 1
    return number is not None and bool(newest.value != number)


class Worker:
    """One process, and a thread that hears it.

    heard: called in that thread with every answer to the newest question.
    """

    def __init__(self, heard: Heard) -> None:
        self._heard = heard
        self._context = multiprocessing.get_context("spawn")
        self._newest, self._computed = (self._context.RawValue(ctypes.c_int64, 0) for _ in range(2))
        self._question: tuple[int, str] | None = None
        self._asked = ""
        self._lock = threading.Lock()
        self._closed = self._silent = False
        self._first = self._seen = 0
        self._start()

    def ask(self, number: int, address: str) -> None:
        """A question that is the newest from here on; the one before is dropped.  Numbers grow."""
        with self._lock:
            self._newest.value, self._question, self._spoke = number, (number, address), time.monotonic()
            self._asked = address
            with suppress(OSError, ValueError):  # it has just ended: `_listen` starts another one and asks again
                self._pipe.send(self._question)

    def tend(self) -> None:
        """End a worker that is silent for too long: another one goes on.  To be called now and then."""
        with self._lock:
            if self._seen != self._computed.value:
                self._seen, self._spoke = self._computed.value, time.monotonic()
            elif self._question is not None and time.monotonic() - self._spoke > (
                LONGEST_SILENCE if self._seen != self._first else LONGEST_START
            ):
                self._spoke, self._silent = time.monotonic(), True
                self._process.kill()

    def close(self) -> None:
        """End it."""
        with self._lock:
            self._closed, self._question = True, None
            self._newest.value = -1
            with suppress(OSError, ValueError):
                self._pipe.send(None)
        self._process.join(TO_END)
        if self._process.is_alive():
            self._process.kill()

    def rest(self) -> None:
        """Ask for nothing any more: what is computed is dropped."""
        with self._lock:
            self._newest.value, self._question = -1, None

    @property
    def process_id(self) -> int:
        """The process."""
        return int(self._process.pid or 0)

    def hears(self, heard: Heard) -> None:
        """Let somebody else hear the answers from here on."""
        self._heard = heard

    def _start(self) -> None:
        ours, theirs = self._context.Pipe()
        self._pipe, self._spoke = ours, time.monotonic()
        self._first = self._seen = self._computed.value
        self._process = self._context.Process(target=serve, args=(theirs, self._newest, self._computed), daemon=True)
        with interrupts.kept_from_children():
            self._process.start()
        theirs.close()
        threading.Thread(target=self._listen, args=(ours,), daemon=True).start()

    def _listen(self, pipe: Any) -> None:
        """Hear this process until it ends; if it was not meant to, start another one."""
        while True:
            try:
                number, stage, shown = pipe.recv()
            except (EOFError, OSError):
                break
            with self._lock:
                newest = number == self._newest.value
                self._spoke = time.monotonic()
                if newest and stage == DONE:
                    self._question = None
            if newest:
                self._heard(number, stage, shown)
        with self._lock:
            if self._closed:
                return
            self._process.join(TO_END)
            meant = self._process.exitcode == 0
            again, number = self._question, self._newest.value
            had = f"had {MOST_MEGABYTES:g} MB of memory and ended"
            why = had if meant else f"broke off with exit code {self._process.exitcode}"
            why = f"was silent for {LONGEST_SILENCE:g} s and was ended" if self._silent else why
            _LOG.warning("a worker %s (asked last: %s); another one takes its place", why, self._asked)
            self._silent = False
            self._start()
            if meant and again is not None:
                self._pipe.send(again)
                return
            self._question = None  # one that ends a worker is not asked twice
        if again is not None:
            why = "the computation broke off; move something, and it is asked again"
            self._heard(number, DONE, {"why": why})


STAGES = ("hunts", "linear", "border", "step", "diagram")
MOST_WORK_OF_A_STAGE = 2e5
"""Work (effort.py): five seconds of a processor for a servo, up to forty for a loop with a bristle and a remedy; what a
stage shows does not hang on the seconds."""
GOES_ON = "the command line goes on longer"
MOST_KEPT = 16
"""Servos, at whatever gain or whatever size of a remedy, of which borders and diagrams are kept."""
MOST_FOUND = 12
"""Borders and diagrams that are kept of each: a person turns a gain for hours, and where there is no fold a diagram
begins below it, wherever it is."""


class Latest(dict[Any, Any]):
    """A dictionary of no more than so many entries: those that were set or read last."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self._most = most

    def __getitem__(self, key: Any) -> Any:
        value = self.pop(key)
        super().__setitem__(key, value)
        return value

    def __setitem__(self, key: Any, value: Any) -> None:
        self.pop(key, None)
        super().__setitem__(key, value)
        while len(self) > self._most:
            del self[next(iter(self))]


class Answers:
    """Answers one state after the other, and remembers what does not depend on the gain."""

    def __init__(self) -> None:
        self._kept = Latest(MOST_KEPT)

    def of(self, state: State, dropped: Callable[[], bool] | None = None) -> Iterator[tuple[str, dict[str, Any]]]:
        """(stage, what it shows) of a state, in order; "hunts" again where the border has led to a cycle.

        dropped: says whether nobody waits any more. Raises effort.Dropped: so it is.
        """
        stages = Stages(state.problem, partial(self._memory, state))
        for stage in STAGES:
            if dropped is not None and dropped():
                raise effort.Dropped
            try:
                with effort.counting_work(None, limit=MOST_WORK_OF_A_STAGE, dropped=dropped):
                    found = getattr(stages, stage)()
            except (NoOrbit, InputError) as why:
                found = refused(why)
            except effort.GivenUp as why:
                found = {"why": f"given up, because it takes too long here; {GOES_ON}", "evidence": str(why)}
            except ArithmeticError as why:  # an extreme servo, beyond what was thought of
                found = {"why": f"could not be computed: {why}"}
            if stage == "diagram" and "why" in found and "stable" not in found:
                found = stages.so_far() | found
            if stage == "hunts" and "sentence" not in found:
                found |= {"verdict": "unknown", "sentence": "Whether it hunts is not known."}
            if stage == "border" and stages.later:
                yield "hunts", stages.later
            yield stage, found

    def _memory(self, state: State, *free: str) -> dict[Any, Any]:
        """What is known of the servo whatever the numbers `free` are."""
        values = tuple((key, value) for key, value in state.values.items() if key not in (*free, SET_POINT))
        key = (free, values, state.model, state.remedy, repr(state.parts))
        if key not in self._kept:
            self._kept[key] = Latest(MOST_FOUND)
        memory: dict[Any, Any] = self._kept[key]
        return memory
