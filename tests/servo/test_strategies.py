"""Tables of strategies: the order, what ends a search, and what a refusal says of the ways that were tried."""

from __future__ import annotations

import pytest

from casahunt import NoOrbit, Servo, Status, find_fold, find_orbit
from casahunt.servo import find_fold as fold
from casahunt.servo import find_orbit as find
from casahunt.servo.find_orbit import first_of

TABLES = {"STABLE": find.STABLE, "UNSTABLE": find.UNSTABLE}


def says(name, answer):
    """A strategy that finds, ends with a sentence, or refuses with (sentence, status)."""

    def run(asked):
        asked.append(name)
        if isinstance(answer, tuple):
            raise NoOrbit(*answer)
        return answer

    return name, run


def test_the_first_that_finds_wins():
    asked: list[str] = []
    table = (
        says("a", "in vain"), says("b", ("stuck", Status.NOT_CONVERGED)), says("d", None), says("e", 2),
        says("f", 3),
    )  # fmt: skip
    assert first_of(table, asked, "") == 2
    assert asked == ["a", "b", "d", "e"]


def test_a_denial_ends_the_search():
    asked: list[str] = []
    with pytest.raises(NoOrbit, match="^none$") as refused:
        first_of((says("a", "in vain"), says("b", ("none", None)), says("c", 1)), asked, "")
    assert refused.value.status is None and asked == ["a", "b"]


@pytest.mark.parametrize(
    ("table", "sentence", "status"),
    [
        ((says("a", ("lost", Status.NOT_FOUND)), says("b", None)), "lost", Status.NOT_FOUND),
        ((says("a", "to 1 only"),), "what to 1 only", Status.NOT_FOUND),
        ((says("a", "to 1"), says("b", "to 2")), "what a to 1; b to 2", Status.NOT_FOUND),
        (
            (says("a", ("stuck", Status.NOT_CONVERGED)), says("b", ("lost", Status.NOT_FOUND)), says("c", "in vain")),
            "stuck (tried besides: b: lost; c: in vain)", Status.NOT_CONVERGED,
        ),
        (
            (says("a", ("lost", Status.NOT_FOUND)), says("b", ("lost too", Status.NOT_FOUND))),
            "lost too (tried besides: a: lost)", Status.NOT_FOUND,
        ),
    ],
)  # fmt: skip
def test_what_a_refusal_says(table, sentence, status):
    with pytest.raises(NoOrbit) as refused:
        first_of(table, [], "what")
    assert (str(refused.value), refused.value.status) == (sentence, status)


def test_a_refusal_lists_motions_and_fold(monkeypatch):
    """Patched, so that one way after the other fails."""

    def lost(*arguments, **options):
        raise NoOrbit("lost", Status.NOT_CONVERGED)

    monkeypatch.setattr(find, "find_fold", lost)
    listed = r"does not prove that there is none.*not located .* \(lost; tried besides: motions at this gain: scanned"
    with pytest.raises(NoOrbit, match=listed) as refused:
        find_orbit(Servo(), "switch", 0.9)
    assert refused.value.status is Status.NOT_FOUND  # a scan alone is no evidence
    # One that was found and not computed says more than that no other was found.
    monkeypatch.setattr(find, "stable_at", lost)
    with pytest.raises(NoOrbit, match=r"^lost \(tried besides: down from the fold: no hunting limit cycle") as refused:
        find_orbit(Servo(), "switch", 0.9)
    assert refused.value.status is Status.NOT_CONVERGED


def test_a_walk_that_ends_before_the_fold_says_where(monkeypatch, orbit):
    """Patched: how far up a walk may go."""
    monkeypatch.setattr(fold, "HIGHEST", 1.001)
    with pytest.raises(NoOrbit, match="^the gain .* stops hunting was not found: .* from gain 0.3") as refused:
        find_fold(Servo(), "switch", start=orbit("switch", 0.3))
    assert refused.value.status is Status.NOT_CONVERGED
