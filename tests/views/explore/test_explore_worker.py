"""The worker of the page: the newest question wins, a worker that ends is replaced."""

from __future__ import annotations

import math
import os
import platform
import queue
import signal
import threading
import time
from types import SimpleNamespace

import pytest

from casahunt import Servo, find_orbit
from casahunt.servo.parts.table import remedies_for
from casahunt.views.explore import worker as module
from casahunt.views.explore.worker import DONE, STAGES, Worker

LONG = 60.0
"""Seconds within which an answer must come, on however busy a machine."""


@pytest.fixture(scope="module")
def heard():
    return queue.Queue()


@pytest.fixture(scope="module")
def worker(heard):
    made = Worker(lambda *said: heard.put(said))
    yield made
    made.close()


def until_done(heard, number):
    said = {}
    while DONE not in said:
        of, stage, shown = heard.get(timeout=LONG)
        assert of <= number
        if of == number:
            said[stage] = shown
    return said


def test_it_answers_as_the_library_does(worker, heard):
    worker.ask(1, "gain=0.2")
    said = until_done(heard, 1)
    assert tuple(said) == (*STAGES, DONE)
    assert said["hunts"]["amplitude"]["value"] == find_orbit(Servo(), "switch", 0.2).amplitude


@pytest.mark.slow
def test_of_fifty_quick_moves_the_last_one_wins(worker, heard):
    """The others are dropped: not even their curves are drawn, and it takes no fifty answers' time."""
    for number in range(2, 52):
        worker.ask(number, f"model=lugre&gain={0.1 + number / 1000!r}&friction.viscous={0.1 + number / 1000!r}")
        time.sleep(0.01)
    said = until_done(heard, 51)
    servo = Servo().replace(**{"friction.viscous": 0.151})
    assert said["hunts"]["amplitude"]["value"] == find_orbit(servo, "lugre", 0.1 + 0.051).amplitude
    assert heard.empty()


@pytest.mark.slow
def test_dropped_in_the_middle(worker, heard):
    """A question in its first stage is left within that stage, not at its end."""
    worker.ask(100, "model=lugre&remedy=dead+band&dead_band=0.01")
    heard.get(timeout=LONG)
    worker.ask(101, "gain=0.3")
    assert until_done(heard, 101)["hunts"]["verdict"] == "hunts"


def a_pipe(questions: list, send, waits=lambda: True) -> SimpleNamespace:
    """A pipe that holds these questions; waits: whether there is one by now."""
    return SimpleNamespace(recv=lambda: questions.pop(0), send=send, poll=lambda *_: waits())


def test_an_idle_worker_compiles_for_what_may_be_chosen(monkeypatch):
    """One choice of all in each idle moment; behind it the question is answered."""
    made, waits, said = [], iter([False, False, True, True]), []
    answers = module.Answers

    class Seen(answers):
        def of(self, state, dropped=None):
            made.append((state.model, state.remedy))
            return super().of(state, dropped)

    monkeypatch.setattr(module, "Answers", Seen)
    monkeypatch.setattr(module.interrupts, "serve", lambda: None)
    monkeypatch.setattr(module, "MOST_MEGABYTES", math.inf)
    pipe = a_pipe([(1, "gain=0.2"), None], lambda answer: said.append(answer[1]), lambda: next(waits, True))
    module.serve(pipe, SimpleNamespace(value=1), SimpleNamespace(value=0))
    first = list(module._ahead())[0]
    assert made == [("switch", ""), (first.model, first.remedy), ("switch", "")] and said == [*STAGES, DONE]


def test_every_remedy_of_both_models_is_compiled_ahead():
    ahead = {(state.model, state.remedy) for state in module._ahead()}
    every = {(model, name) for model in ("switch", "lugre") for name in ("", *remedies_for(model))}
    assert ahead == every - {("switch", "")}  # which comes first anyhow


def test_a_choice_that_cannot_be_made_ahead_ends_no_worker(monkeypatch):
    waits, said = iter([False, False, True, True]), []

    def ahead():
        yield "no state"  # whatever goes wrong
        raise AssertionError("it is not tried again")

    monkeypatch.setattr(module, "_ahead", ahead)
    monkeypatch.setattr(module.interrupts, "serve", lambda: None)
    monkeypatch.setattr(module, "MOST_MEGABYTES", math.inf)
    pipe = a_pipe([(1, "gain=0.2"), None], lambda answer: said.append(answer[1]), lambda: next(waits, True))
    module.serve(pipe, SimpleNamespace(value=1), SimpleNamespace(value=0))
    assert said == [*STAGES, DONE]


def test_no_stage_is_computed_for_nobody(monkeypatch):
    """The worker's own side: behind its first answer there is a newer question."""
    newest, said, questions = SimpleNamespace(value=1), [], [(1, "gain=0.2"), (2, "gain=0.3"), None]

    def send(answer):
        said.append(answer[:2])
        newest.value = 2

    monkeypatch.setattr(module.interrupts, "serve", lambda: None)
    monkeypatch.setattr(module, "MOST_MEGABYTES", math.inf)  # a process that runs many tests has grown
    module.serve(a_pipe(questions, send), newest, SimpleNamespace(value=0))
    assert said == [(1, "hunts"), *((2, stage) for stage in (*STAGES, DONE))]


def test_one_that_has_grown_ends_behind_an_answer(monkeypatch):
    newest, said, questions = SimpleNamespace(value=1), [], [(1, "gain=0.2"), (2, "gain=0.3"), None]
    monkeypatch.setattr(module.interrupts, "serve", lambda: None)
    monkeypatch.setattr(module, "MOST_MEGABYTES", 1.0)
    if not module._megabytes():
        pytest.skip("this system does not say how much memory a process has")
    module.serve(a_pipe(questions, lambda answer: said.append(answer[1])), newest, SimpleNamespace(value=0))
    assert said[-1] == DONE and len(questions) == 2


def test_what_was_freed_is_given_back_behind_a_dropped_question_too(monkeypatch):
    """Random moves drop nearly all: memory must not wait for an answer that is told to its end."""
    newest, given, questions = SimpleNamespace(value=1), [], [(1, "gain=0.2"), None]
    monkeypatch.setattr(module.interrupts, "serve", lambda: None)
    monkeypatch.setattr(module, "MOST_MEGABYTES", math.inf)
    monkeypatch.setattr(module, "_give_back", lambda: given.append(1))
    module.serve(a_pipe(questions, lambda _: setattr(newest, "value", 2)), newest, SimpleNamespace(value=0))
    assert given == [1]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the C library is another one")
def test_memory_is_what_is_resident_now():
    """What was freed counts no more, though the C library would keep it: small blocks below one that stays."""
    blocks = [bytes(1000) for _ in range(100_000)]
    stays, full = bytes(1000), module._megabytes()
    del blocks
    module._give_back()
    assert stays and module._megabytes() < full - 80


def test_one_that_ends_as_it_should_is_replaced_and_asked_again(worker, heard, caplog):
    before = worker.process_id
    worker._pipe.send(None)
    worker.ask(105, "gain=0.26")
    assert until_done(heard, 105)["hunts"]["verdict"] == "hunts" and worker.process_id != before
    assert "MB of memory and ended (asked last: gain=0.26); another one" in caplog.text


def test_what_rests_says_nothing(worker, heard):
    worker.ask(110, "model=lugre&gain=0.123")
    worker.rest()
    worker.ask(111, "gain=0.21")
    until_done(heard, 111)


@pytest.mark.slow
def test_one_that_ends_is_replaced(worker, heard, caplog):
    """Its question is not asked again, which may have ended it; the next one is answered."""
    worker.ask(120, "model=lugre&friction.viscous=0.123&remedy=dead+band&dead_band=0.01")
    heard.get(timeout=LONG)
    before = worker.process_id  # one that had grown was replaced before it asked
    os.kill(before, getattr(signal, "SIGKILL", signal.SIGTERM))
    assert "broke off" in until_done(heard, 120)[DONE]["why"]
    assert "a worker broke off with exit code" in caplog.text and "friction.viscous=0.123" in caplog.text
    worker.ask(121, "gain=0.25")
    assert until_done(heard, 121)["hunts"]["verdict"] == "hunts" and worker.process_id != before


@pytest.mark.slow
def test_one_that_is_silent_is_ended(worker, heard, monkeypatch, caplog):
    before = worker.process_id
    worker.tend()  # it has no question: nothing happens
    assert worker.process_id == before
    os.kill(before, signal.SIGSTOP)  # it hangs, as in a library
    worker.ask(130, "model=lugre&friction.viscous=0.124&remedy=dead+band&dead_band=0.01")
    monkeypatch.setattr(module, "LONGEST_SILENCE", -1.0)
    worker.tend()
    assert "broke off" in until_done(heard, 130)[DONE]["why"]
    assert "a worker was silent" in caplog.text
    assert worker.process_id != before


def test_one_that_computes_is_not_ended_however_slowly(monkeypatch):
    monkeypatch.setattr(module, "LONGEST_SILENCE", -1.0)
    ended: list[bool] = []
    shared = SimpleNamespace(value=0)
    own = SimpleNamespace(
        _lock=threading.Lock(), _computed=shared, _seen=0, _first=0, _question=(1, ""), _spoke=0.0, _silent=False,
        _process=SimpleNamespace(kill=lambda: ended.append(True)),
    )  # fmt: skip
    for _ in range(3):
        assert not module._passed(SimpleNamespace(value=1), shared, 1)
        Worker.tend(own)
    assert not ended
    Worker.tend(own)
    assert ended == [True]
    own._first = own._seen  # nor is one that has only begun
    Worker.tend(own)
    assert ended == [True]
