"""Every public name has an example in its docstring, and every example runs.

Public are the names of `casahunt`, of the rooms of the engine, of `casahunt.servo.parts`, and of `casahunt.pictures`.
An example is read and
copied on its own, so each runs in a scope of its own.  Where several ask for the same result, it is computed once:
results are frozen, and depend on nothing that was computed before (test_history.py).
"""

from __future__ import annotations

import doctest
import functools
import inspect
from collections.abc import Callable, Iterator
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest

import casahunt

PUBLIC_ROOMS = ("hybrid", "collocation", "motion", "orbits", "continuation", "servo.parts", "pictures")
ROOMS = ("casahunt", *(f"casahunt.{room}" for room in PUBLIC_ROOMS))
SHARED = {
    "casahunt": ("find_fold", "find_orbit", "fixed_points", "simulate", "tune"),
    "casahunt.orbits": ("find_cycle",),
}
"""Functions whose results several examples ask for."""


def public() -> Iterator[tuple[str, Any]]:
    """(name, value) of everything public; what is public in two places, once."""
    seen: set[int] = set()
    for room in map(import_module, ROOMS):
        for name in room.__all__:
            value = getattr(room, name)
            if id(value) not in seen and not isinstance(value, tuple):  # the table of remedies: a list has no docstring
                seen.add(id(value))
                yield f"{room.__name__}.{name}", value


PUBLIC = dict(public())
LONG = ("casahunt.Tuning", "casahunt.tune", "casahunt.pictures.operating_point", "casahunt.pictures.tasks",
         "casahunt.as_built", "casahunt.pictures.remedy_sizes")  # fmt: skip
"""Examples of a tuning, of its check, or of a table of remedies, which takes more than a second."""


def example_of(name: str, value: Any) -> doctest.DocTest:
    """The section Examples of a docstring; without examples where there is none."""
    doc = inspect.cleandoc(value.__doc__ or "")
    section = doc.partition("Examples\n--------\n")[2]
    return doctest.DocTestParser().get_doctest(section, {}, name, None, 0)


def once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, computing what it has computed before only once."""
    kept = functools.cache(function)

    def called(*args: Any, **kwargs: Any) -> Any:
        try:
            return kept(*args, **kwargs)
        except TypeError:  # a mapping or a list among what it was given
            return function(*args, **kwargs)

    return called


@pytest.fixture(scope="module", autouse=True)
def shared() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for room, names in SHARED.items():
            for name in names:
                patch.setattr(f"{room}.{name}", once(getattr(import_module(room), name)))
        yield


def test_public_names_are_found():
    assert len(PUBLIC) > 90 and all(value.__module__.startswith("casahunt.") for value in PUBLIC.values())


def shortcomings(name: str, value: Any) -> list[str]:
    """What is wrong with the example of a public name, without running it."""
    test = example_of(name, value)
    said = [] if any(example.want for example in test.examples) else ["no section Examples with a result"]
    skipped = [example for example in test.examples if doctest.SKIP in example.options]
    return said + (["skips"] if skipped else [])


def test_public_names_have_examples():
    found = {name: shortcomings(name, value) for name, value in PUBLIC.items()}
    assert not {name: said for name, said in found.items() if said}


@pytest.mark.parametrize(
    ("doc", "said"),
    [
        ("A thing.", ["no section Examples with a result"]),
        ("A thing.\n\n>>> 1\n1", ["no section Examples with a result"]),
        ("A thing.\n\nExamples\n--------\n>>> x = 1", ["no section Examples with a result"]),
        ("A thing.\n\nExamples\n--------\n>>> 1  # doctest: +SKIP\n1", ["skips"]),
        ("A thing.\n\nExamples\n--------\n>>> 1\n1", []),
    ],
)
def test_what_is_no_example(doc, said):
    assert shortcomings("thing", SimpleNamespace(__doc__=doc)) == said


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in PUBLIC]
)
def test_an_example_runs(name):
    said: list[str] = []
    result = doctest.DocTestRunner(verbose=False).run(example_of(name, PUBLIC[name]), out=said.append)
    assert result.attempted and not result.failed, "".join(said)


def test_the_first_example_runs():
    """That of the package itself."""
    said: list[str] = []
    test = doctest.DocTestParser().get_doctest(inspect.cleandoc(casahunt.__doc__), {}, "casahunt", None, 0)
    result = doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    assert result.attempted == 4 and not result.failed, "".join(said)
