"""CasADi from several threads at once.

CasADi's Python module lets other threads run inside every call, and its scalar graphs count their references without
a lock, those to shared constants too; MUMPS under IPOPT keeps global state.  Hence two rules:

    1. Graphs and functions are built, called, looked up and dropped by one thread at a time: `alone`, `kept`.
    2. A compiled function is called without that lock through a `Caller`, whose buffers every thread has for itself.

Results do not depend on the threads: nothing that one writes is read by another.

And CasADi swallows Ctrl-C: to convert an argument it calls Python (`shape`, `__array__`, `DM_from_array`), and takes
whatever is raised there for an argument of another type; IPOPT has "failed".  Hence a third:

    3. What a Ctrl-C has raised is raised again where the work inside CasADi ends without it: `Heard`.
"""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]  # what `signal` wraps in enumerations, which cost fifty times as much
import threading
import traceback
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from functools import lru_cache, update_wrapper
from types import TracebackType
from typing import Any, Generic, ParamSpec, TypeVar

import casadi as ca
import numpy as np

Array = np.ndarray
P = ParamSpec("P")
R = TypeVar("R")

CASADI = threading.RLock()
"""Held by whoever is inside CasADi, but for the evaluation of a compiled function on buffers."""
_DROPPED: deque[dict[str, Any]] = deque()
"""What was given up while another thread was inside CasADi; dropped by whoever enters next."""


class _Memory:
    """The handler of Ctrl-C that was there, with a memory for what it raises."""

    def __init__(self) -> None:
        self.before: Callable[..., Any] = _signal.default_int_handler
        self.owner: Callable[[], Heard | None] = lambda: None
        self.times = 0
        self.kind: type[BaseException] = KeyboardInterrupt
        self.args: tuple[Any, ...] = ()

    def __call__(self, number: int, frame: Any) -> None:
        try:
            self.before(number, frame)
        except BaseException as error:  # not the error itself, which would keep the frames it came through alive
            self.times, self.kind, self.args = self.times + 1, type(error), error.args
            raise


_MEMORY = _Memory()
_MAIN = threading.main_thread().ident


class Heard:
    """A block of code at whose end a Ctrl-C that something inside has swallowed is raised again.

    Of the main thread, which alone receives signals, and where a handler of Python's raises something: the handler of
    the command line or of another program is asked as ever, and stands in its place again behind the block.
    A handler that an interrupt on the way in or out leaves behind does what the one that it stands for does, and goes
    with the next block.
    """

    def __enter__(self) -> None:
        self.installed = False
        if threading.get_ident() != _MAIN:
            return
        before = _signal.getsignal(_signal.SIGINT)
        self.times = _MEMORY.times
        if before is _MEMORY:
            self.installed = _MEMORY.owner() is None
        elif callable(before):
            _MEMORY.before = before
            _signal.signal(_signal.SIGINT, _MEMORY)
            self.installed = True
        if self.installed:
            _MEMORY.owner = weakref.ref(self)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if threading.get_ident() != _MAIN:
            return
        if self.installed:
            _signal.signal(_signal.SIGINT, _MEMORY.before)
        if _MEMORY.times != self.times and not (kind and issubclass(kind, _MEMORY.kind)):
            traceback.clear_frames(trace)
            raise _MEMORY.kind(*_MEMORY.args) from None


def alone(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, run by one thread at a time; what it built and does not return is dropped before the next enters.

    Not for what takes a lock of its own inside: a `functools.cached_property` holds one while it computes (Python
    3.11), and two locks taken in either order wait for each other.
    """

    def locked(*args: P.args, **kwargs: P.kwargs) -> R:
        with CASADI:
            _DROPPED.clear()
            try:
                with Heard():
                    return function(*args, **kwargs)
            except BaseException as error:
                traceback.clear_frames(error.__traceback__)  # which would keep graphs alive beyond the lock
                raise

    return update_wrapper(locked, function)


class Kept(Generic[P, R]):
    """A function with a cache of its `maxsize` latest results; built, looked up and dropped by one thread at a time.

    Threads that ask at once get the same object, which `functools.lru_cache` does not promise.
    """

    def __init__(self, function: Callable[P, R], maxsize: int | None) -> None:
        self._cached: Any = lru_cache(maxsize)(alone(function))
        self.cache_info, self.cache_clear = self._cached.cache_info, alone(self._cached.cache_clear)
        update_wrapper(self, function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        with CASADI:
            return self._cached(*args, **kwargs)


def kept(maxsize: int | None) -> Callable[[Callable[P, R]], Kept[P, R]]:
    """Decorator: see `Kept`."""
    return lambda function: Kept(function, maxsize)


class _Owner:
    """Holds CasADi objects that only who holds the lock may drop.

    The garbage collector may call `__del__` anywhere, inside other locks too: it must not wait.
    """

    def __del__(self, lock: Any = CASADI, dropped: deque[dict[str, Any]] = _DROPPED) -> None:
        if lock.acquire(blocking=False):
            try:
                self.__dict__.clear()
            finally:
                lock.release()
        else:
            dropped.append(self.__dict__)


class Buffers(_Owner):
    """Arrays of one thread: fill `inputs`, call `trigger()`, read `outputs`, which the next call overwrites."""

    def __init__(self, function: _Function) -> None:
        with CASADI, Heard():
            self.inputs = tuple(np.zeros(shape) for shape in function.inputs)
            self.outputs = tuple(np.zeros(shape) for shape in function.outputs)
            found = [self._part(part, rows) for part, rows in function.parts]
            self._buffers, triggers = [buffer for buffer, _ in found], [trigger for _, trigger in found]
            self.trigger = triggers[0] if len(found) == 1 else _in_turn(triggers)

    def _part(self, function: ca.Function, rows: slice) -> tuple[Any, Callable[[], None]]:
        """(buffer, trigger) of a function on its rows of the arrays."""
        buffer, trigger = function.buffer()
        for place, arrays in ((buffer.set_arg, self.inputs), (buffer.set_res, self.outputs)):
            for i, array in enumerate(arrays):
                if array.size:
                    place(i, array[rows].data)
        return buffer, trigger


def _in_turn(triggers: Sequence[Callable[[], None]]) -> Callable[[], None]:
    def trigger() -> None:
        for one in triggers:
            one()

    return trigger


class _Function(_Owner):
    """CasADi functions, each with its rows of the arrays, and the shapes of these."""

    def __init__(self, parts: Sequence[tuple[ca.Function, slice]], inputs: Sequence[Any], outputs: Sequence[Any]):
        self.parts, self.inputs, self.outputs = tuple(parts), tuple(inputs), tuple(outputs)


class Caller(threading.local):
    """A CasADi function that every thread calls through buffers of its own, made at the thread's first call.

    The buffers save the conversion between numpy and CasADi matrices, which costs eight times as much as an
    interval's evaluation itself.
    """

    def __init__(self, function: _Function) -> None:
        self.buffers = Buffers(function)


def caller(function: ca.Function, inputs: Sequence[Any], outputs: Sequence[Any]) -> Caller:
    """A compiled function that every thread may call.

    inputs, outputs: shapes of its arrays; numpy's order of axes is the reverse of CasADi's.
    """
    return Caller(_Function([(function, slice(None))], inputs, outputs))


def caller_by_rows(parts: Sequence[tuple[ca.Function, int]], inputs: Sequence[int], outputs: Sequence[Any]) -> Caller:
    """Compiled functions of some rows each, one behind the other, that every thread may call as one.

    CasADi takes 15 ms to map a function over 300 points, where maps over powers of two are there already.

    parts: functions of CasADi, and of how many rows each is; inputs, outputs: numbers in a row of its arrays; shapes of
    a row. Returns caller, of arrays (sum of the rows, ...).
    """
    ends = np.cumsum([rows for _, rows in parts]).tolist()
    placed = [(function, slice(end - rows, end)) for (function, rows), end in zip(parts, ends, strict=True)]
    shapes = [(ends[-1], width) for width in inputs]
    return Caller(_Function(placed, shapes, [(ends[-1], *shape) for shape in outputs]))
