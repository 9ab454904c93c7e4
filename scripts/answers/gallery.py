"""The cycles and branches of problems/, each with its truth."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import problems
from casahunt.continuation import follow
from problems.gallery import Course, Found, compared
from scripts.processors import Answer, said, said_of_branch


def files() -> Iterator[tuple[str, Any]]:
    """(name, module) of those that have cycles or branches."""
    for found in iter_modules(problems.__path__):
        module = import_module(f"problems.{found.name}")
        if hasattr(module, "cycles") or hasattr(module, "branches"):
            yield found.name, module


def cycles(module: Any) -> Answer:
    """What is said of the cycles of a file, with the period that is known of each."""
    words: dict[str, Any] = {"status": "answered"}
    answer: Answer = {"words": words, "numbers": {}, "truth": {}}
    found: Found
    for found in module.cycles():
        one = said(found.orbit)
        for word, value in one["words"].items():
            words.setdefault("phases" if word == "phases" else "verdicts", []).append(f"{found.caption}: {value}")
        answer["numbers"] |= {f"{found.caption}: {name}": number for name, number in one["numbers"].items()}
        answer["truth"][f"{found.caption}: period"] = [found.truth.period, 1e-15 * found.truth.period]
    return answer


def branch(course: Course) -> Answer:
    """What is said of a branch, and which of its known points it lost, or invented."""
    found = follow(course.start(), course.vary, to=course.to, **course.how)
    answer = said_of_branch(found, course.within)
    lost, invented = compared(((s.kind, float(s.value)) for s in found.special), course.special, course.within)
    answer["words"] |= {"lost": [kind for kind, _ in lost], "invented": [kind for kind, _ in invented]}
    return answer


def questions(name: str, module: Any) -> Iterator[tuple[str, str, Any, dict[str, Any]]]:
    """(question, kind, how it is asked, truth) of a file; the answers bring their truths."""
    if hasattr(module, "cycles"):
        yield f"gallery {name}, cycles", "gallery cycles", partial(cycles, module), {}
    for course in module.branches() if hasattr(module, "branches") else ():
        yield f"gallery {course.caption}", "gallery branch", partial(branch, course), {}
