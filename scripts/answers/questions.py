"""All questions, in groups that share a subject: what is computed for one may be kept for the next."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

from scripts.answers import gallery, loops, servos, verbs
from scripts.limits import TooSlow, within
from scripts.processors import Answer, asked

WORK, SECONDS = 6e5, 300.0
"""Work after which a question is given up (effort.py), some 20 to 60 s; processor time where none is counted."""
TASKS = 30
"""Tasks of scripts/tuning.py."""


class Question(NamedTuple):
    """What is asked; `name` says all of it, `kind` is that of the sums, `truth` what is known from outside."""

    name: str
    kind: str
    ask: Callable[[], Answer]
    truth: dict[str, Any]


Group = tuple[str, Callable[[], Iterator[Question]]]


def answered(question: Question) -> Answer:
    """The answer, whatever happens."""
    try:
        with within(SECONDS):
            found, refusal = asked(question.ask, WORK)
    except TooSlow:
        return {"words": {"status": "ran away"}, "numbers": {}}
    except Exception as error:  # a corpus is not cut by what it should tell
        return {"words": {"status": f"error, {type(error).__name__}", "sentence": str(error)}, "numbers": {}}
    answer: Answer = refusal or found
    return {"truth": question.truth, **answer} if question.truth else answer


def of_servo(subject: servos.Subject, asked_of: Iterable[verbs.Verb]) -> Iterator[Question]:
    """What is asked of a servo; its fold alone where it has no gain."""
    for verb in asked_of:
        if subject.gain or verb.name == "fold":
            at = f" at {subject.gain!r}" if verb.at_gain else ""
            name, ask = f"{subject.name}, {verb.name}{at}", partial(verb.ask, subject)
            yield Question(name, f"{subject.model} {verb.name}", ask, subject.truths.get(verb.name, {}))


def of_table1(model: str) -> Iterator[Question]:
    """At its first gain all, at the others what is cheap."""
    for k, subject in enumerate(servos.table1(model)):
        yield from of_servo(subject, verbs.asked_of(model, None, k))


def of_random(model: str, number: int) -> Iterator[Question]:
    """What is asked of a random servo."""
    return of_servo(servos.random(model, number), verbs.asked_of(model, number))


def groups(count: int = servos.SERVOS, tasks: int = TASKS, each: int = loops.EACH) -> Iterator[Group]:
    """Table 1, random servos, tasks, loops, the gallery."""
    for model in servos.MODELS:
        yield f"{model} Table 1", partial(of_table1, model)
    for number in range(count):
        for model in servos.MODELS:
            yield f"{model} servo {number}", partial(of_random, model, number)
    for number in range(tasks):
        yield f"task {number}", lambda n=number: iter([Question(f"task {n}", "tune", partial(verbs.tuned, n), {})])
    for kind, number in list(loops.chosen())[: each * len(loops.KINDS)]:
        yield f"{kind} {number}", lambda k=kind, n=number: (Question(*row) for row in loops.questions(k, n))
    for name, module in gallery.files():
        yield f"gallery {name}", lambda n=name, m=module: (Question(*row) for row in gallery.questions(n, m))
