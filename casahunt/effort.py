"""How far a computation has come: who is told where it is, and where one without an end in sight is given up.

    work   collocation intervals linearised: N for a boundary value problem of N intervals (transcription.py of the
           room collocation); an interval that a motion tries (motion/phases.py) takes as long as `MARCHED` of those

That makes some 4e4 a second, whatever is computed, and their number depends on nothing but the problem: what is given
up is given up at the same place on every machine.  Only the command line watches (cli.py); for a call from Python
nothing is counted but where a part of it is bounded (`at_most`), in worker threads and processes neither.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

MEMBERS_OF_A_PASS = 48
"""Members of one pass: few enough for the caches, enough to hide the price of a call."""
ROWS_OF_A_TASK = 96
"""Rows of a task: enough to hide what a task costs, few enough to keep the workers of a long run busy to its end."""
EVERY = 2.0
"""Seconds between two lines."""
MARCHED = 20
"""Work of an interval of a motion."""


WORTH_SAYING = 1.0
"""Seconds that are left, below which nothing is said of them."""


def left(done: float, total: float, began: float) -> str:
    """How long a computation of a known length will still take, if it goes on as it went.

    began: `time.monotonic()` when none of it was done.
    Returns ", about 12 s left"; "" where nothing is known yet, or nothing is left.
    """
    if not 0 < done < total:
        return ""
    seconds = (time.monotonic() - began) * (total - done) / done
    if seconds < WORTH_SAYING:
        return ""
    return f", about {seconds:.0f} s left" if seconds < 100 else f", about {seconds / 60:.0f} min left"


class GivenUp(Exception):
    """The work that was allowed is done; the message says how far it has led.

    No NoOrbit: whoever catches that goes another way to the same end, and none is to be gone any more.
    """


class PartGivenUp(GivenUp):
    """The work that was allowed for a part of it is done, and some is left of that for the whole."""


class Dropped(Exception):
    """Nobody waits for the answer any more.  No NoOrbit, as `GivenUp`."""


class WorkCount:
    """What has been done since a computation began, and what may be.

    Attributes
    ----------
    work, motions, problems : what was done in all, motions begun, boundary value problems linearised.
    place : says where the computation is.
    """

    def __init__(
        self, tell: Callable[[str], None] | None, limit: float, dropped: Callable[[], bool] | None = None
    ) -> None:
        self.work = self.motions = self.problems = 0
        self._tell, self._limit, self._dropped = tell, limit, dropped
        self._raised: type[GivenUp] = GivenUp
        self.place: Callable[[], str] | None = None
        self._began = self._last = time.monotonic()

    def sentence(self) -> str:
        """Where the computation is."""
        counts = f"{self.motions} motions and {self.problems} Newton steps of cycles so far"
        return counts if self.place is None else f"{self.place()} ({counts})"

    def add(self, work: int) -> None:
        """Count, and tell where the computation is, if it is time to.

        Raises GivenUp: beyond the limit; Dropped: nobody waits for the answer any more.
        """
        self.work += work
        if self._dropped is not None and self._dropped():
            raise Dropped
        if self.work > self._limit:
            raise self._raised(
                f"given up, because no answer came after the work of {self.work:.1e} collocation intervals: "
                f"{self.sentence()}; are all parameters and the gain meant?"
            )
        now = time.monotonic()
        if self._tell is not None and now - self._last >= EVERY:
            self._last = now
            self._tell(f"{now - self._began:.0f} s: {self.sentence()}")

    def within(self, limit: float) -> WorkCount:
        """A count of a part of it, of which so much is allowed."""
        left = self._limit - self.work
        part = WorkCount(self._tell, min(limit, left), self._dropped)
        part._raised = PartGivenUp if limit < left else self._raised
        return part

    def took(self, part: WorkCount) -> None:
        """Count what a part of it took.  Raises as `add`."""
        self.motions, self.problems = self.motions + part.motions, self.problems + part.problems
        self.add(part.work)

    def heard(self) -> None:
        """Something was said that tells as much."""
        self._last = time.monotonic()


class OutOfTime(Exception):
    """The seconds that were allowed are over.  No NoOrbit, as `GivenUp`."""


_watch: ContextVar[WorkCount | None] = ContextVar("watch", default=None)
_deadline: ContextVar[float] = ContextVar("deadline", default=float("inf"))


@contextmanager
def until(seconds: float) -> Iterator[None]:
    """Let what is computed inside take so many seconds, from now on.

    Raises OutOfTime: when they are over, at the next interval or Newton step.
    """
    token = _deadline.set(min(_deadline.get(), time.monotonic() + seconds))
    try:
        yield
    finally:
        _deadline.reset(token)


def _in_time() -> None:
    if time.monotonic() > _deadline.get():
        raise OutOfTime


@contextmanager
def counting_work(
    tell: Callable[[str], None] | None, *, limit: float = float("inf"), dropped: Callable[[], bool] | None = None
) -> Iterator[WorkCount]:
    """Count what is computed inside.

    tell: hears every `EVERY` seconds where the computation is; None: nobody; limit: collocation intervals after which
    it is given up; dropped: says whether the answer is not waited for any more.
    Raises GivenUp: beyond `limit`; Dropped: it is not.
    """
    watch = WorkCount(tell, limit, dropped)
    token = _watch.set(watch)
    try:
        yield watch
    finally:
        _watch.reset(token)


@contextmanager
def at_most(limit: float) -> Iterator[None]:
    """Let what is computed inside take so much work, whether anybody watches or not.

    Raises PartGivenUp: beyond it; GivenUp: beyond what is allowed in all.
    """
    whole = _watch.get()
    part = (whole or WorkCount(None, float("inf"))).within(limit)
    token = _watch.set(part)
    try:
        yield
    finally:
        _watch.reset(token)
        if whole is not None:
            whole.took(part)


def motion_begins() -> None:
    """A motion begins."""
    watch = _watch.get()
    if watch is not None:
        watch.motions += 1


def interval() -> None:
    """An interval of a motion is tried."""
    _in_time()
    watch = _watch.get()
    if watch is not None:
        watch.add(MARCHED)


def pieces(count: int) -> None:
    """So many steps of a sampled motion were computed, each of the work of an interval that is linearised."""
    _in_time()
    watch = _watch.get()
    if watch is not None:
        watch.add(count)


def problem(intervals: int) -> None:
    """A boundary value problem is linearised."""
    _in_time()
    watch = _watch.get()
    if watch is not None:
        watch.problems += 1
        watch.add(intervals)


def at(place: Callable[[], str]) -> None:
    """The computation that begins now says where it is."""
    watch = _watch.get()
    if watch is not None:
        watch.place = place


def heard() -> None:
    """The command has said something itself."""
    watch = _watch.get()
    if watch is not None:
        watch.heard()
