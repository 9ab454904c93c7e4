"""Ctrl-C of who uses the package as a library, where CasADi swallows it."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import FrameType

import numpy as np
import pytest

from casahunt import NoOrbit, Options, Servo, compiled, find_orbit, simulate
from casahunt.collocation import interval
from casahunt.orbits.orbit import unknowns_of

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")


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


def places_of(work: Callable[[], object]) -> dict[tuple[object, ...], None]:
    """Each place where `work` calls CasADi, in the order in which it first comes there."""
    places: dict[tuple[object, ...], None] = {}

    def watch(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and inside(frame):
            places[place(frame)] = None

    sys.setprofile(watch)
    try:
        work()
    finally:
        sys.setprofile(None)
    return places


def lost(
    work: Callable[[], object], *, every: int = 1, but: dict[tuple[object, ...], None] | None = None
) -> tuple[int, list[tuple[object, ...]]]:
    """(number of places where Ctrl-C was sent, those where it did not arrive): each place where `work` calls CasADi.

    `work` is begun again until it meets no new place: it is sent at the first that it meets, or at every third new one.
    What was built and kept by then is there the next time, and nothing half built.
    """
    met, tried, gone = dict(but or {}), 0, []
    while True:
        struck = None

        def strike(frame: FrameType, event: str, _: object) -> None:
            nonlocal struck
            if event == "call" and inside(frame) and (where := place(frame)) not in met:
                met[where] = None
                if len(met) % every == 0:
                    struck = where
                    sys.setprofile(None)
                    signal.raise_signal(signal.SIGINT)

        try:
            sys.setprofile(strike)
            work()
        except KeyboardInterrupt:
            tried += 1
            continue
        finally:
            sys.setprofile(None)
        if struck is None:
            return tried, gone
        tried += 1
        gone.append(struck)


@pytest.fixture
def ctrl_c():
    """Python's own handler, which a test run in the background has not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    compiled.alone(lambda: None)()  # an interrupt on its way out may have left the handler
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


# From Python 3.13 on the interpreter says which of its own questions swallowed one.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
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


def test_a_handler_left_behind_goes_with_the_next_block(ctrl_c):
    """An interrupt on the way out of a block may leave its handler; the next block clears up."""
    left = compiled.Heard()
    left.__enter__()
    del left
    assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    with compiled.Heard():
        pass
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
    """At every place where a computation calls CasADi, from nothing built to all of it.

    Every third of them; of the others than the first, of those that it has not.
    """
    caches = [found for found in gc.get_objects() if isinstance(found, compiled.Kept)]

    def emptied() -> None:
        for cache in caches:
            cache.cache_clear()

    def work(what: str = what) -> object:
        if what == "simulate":
            return simulate(Servo(), "switch", 0.3, time=5.0).end
        model = "lugre" if what == "lugre" else "switch"
        solver = what if what in ("newton", "ipopt") else "auto"
        found = find_orbit(Servo(), model, 0.1, options=Options(tol=1e-4, solver=solver))
        return found.integrator_multipliers.half if what == "integrator" else found.period

    emptied()
    before = work()
    emptied()
    first = {} if what == "newton" else places_of(lambda: work("newton"))
    emptied()
    number, gone = lost(work, every=3, but=first)
    assert number and not gone
    assert np.array_equal(work(), before)
