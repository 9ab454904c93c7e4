"""The diagram as a generator: some orbits ahead for the sake of their multipliers, and no more than that."""

from __future__ import annotations

from functools import cache

import pytest

from casahunt import InputError, NoOrbit, Servo, effort, find_orbit
from casahunt.continuation import FOLD
from casahunt.design import diagram as design
from casahunt.orbits.batched_multipliers import ORBITS_AHEAD
from casahunt.servo.problem import HuntingOrbit

START, GAINS = 0.2, [0.21 + 0.01 * k for k in range(11)]


@cache
def orbit(gain: float) -> HuntingOrbit:
    """A cycle of the Switch servo."""
    return find_orbit(Servo(), "switch", gain)


def walking(monkeypatch, gains: list[float], with_what: str | BaseException) -> list[float]:
    """The walk is replaced by one over these gains that ends so; the gains that it has come to."""
    reached: list[float] = []

    def walk(*_, **__):
        for gain in gains:
            reached.append(gain)
            yield orbit(gain)
        if isinstance(with_what, BaseException):
            raise with_what
        return with_what

    # How a walk ends, and after how many orbits, cannot be asked of a servo.
    monkeypatch.setattr(design, "walk", walk)
    monkeypatch.setattr(design, "find_orbit", lambda servo, model, gain, *, options: orbit(gain))
    return reached


@pytest.mark.parametrize("count", [0, 1, ORBITS_AHEAD, len(GAINS)])
@pytest.mark.parametrize("end", [NoOrbit("lost"), KeyboardInterrupt(), effort.GivenUp("enough")], ids=type)
def test_what_ends_a_walk_comes_behind_the_orbits_that_it_found(monkeypatch, count, end):
    walking(monkeypatch, GAINS[:count], end)
    points, found = design.diagram_points(Servo(), "switch", start=START), []
    with pytest.raises(type(end)):
        for point in points:
            found.append(point.orbit.gain)
    assert found == [START, *GAINS[:count]]


@pytest.mark.parametrize("count", [0, 1, ORBITS_AHEAD, len(GAINS)])
def test_the_sentence_at_the_end(monkeypatch, count):
    walking(monkeypatch, GAINS[:count], "that is all")
    points, found = design.diagram_points(Servo(), "switch", start=START), []
    while True:
        try:
            found.append(next(points).orbit.gain)
        except StopIteration as end:
            assert end.value == "that is all" and found == [START, *GAINS[:count]]
            return


@pytest.mark.parametrize(("monitors", "ahead"), [(design.STANDARD, ORBITS_AHEAD), ((FOLD,), 1)])
def test_how_far_ahead(monkeypatch, monitors, ahead):
    """As many as are computed in batches; where no multipliers are asked for, none, and none are computed."""
    orbit.cache_clear()
    reached = walking(monkeypatch, GAINS, "that is all")
    points = design.diagram_points(Servo(), "switch", start=START, monitors=monitors)
    next(points)
    assert reached == []
    next(points)
    assert reached == GAINS[:ahead]
    assert all(("multipliers" in vars(orbit(gain))) is (ahead > 1) for gain in reached)


@pytest.mark.slow
def test_a_diagram_of_both_models_is_that_of_each():
    both = design.diagram(Servo(), start=START)
    assert [branch.model for branch in both] == ["switch", "lugre"]
    for branch in both:
        alone = design.diagram(Servo(), branch.model, start=START)
        points = list(design.diagram_points(Servo(), branch.model, start=START))
        for other in (alone.orbits, [point.orbit for point in points]):
            assert [orbit.gain for orbit in branch.orbits] == [orbit.gain for orbit in other]
        assert branch.ended == alone.ended and branch.servo == Servo()
    with pytest.raises(InputError, match="model"):
        design.diagram(Servo(), "dahl", start=START)
