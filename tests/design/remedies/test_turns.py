"""A branch that turns where no cycle can be computed to its tolerance: the border lies between its cycles."""

import math

import numpy as np
import pytest

from casahunt import Controller, Friction, Options, Servo, Uncertainty, effort, find_orbit, remedies
from casahunt.design.remedies import border, fate
from casahunt.design.remedies import remedies as table
from casahunt.design.remedies.border import TURN_KNOWN
from casahunt.errors import NoOrbit, Status
from casahunt.servo.parts import REMEDIES


class Branch:
    """As much of a branch as is looked at."""

    def __init__(self, values, *kinds):
        self.values, self.orbits = np.array(values), list(values)
        self.missed = [type("Missed", (), {"kind": kind, "meaning": "between two cycles"}) for kind in kinds]


@pytest.mark.parametrize("sense", [1, -1])
def test_the_border_is_the_outermost_cycle_and_known_to_its_neighbours(sense):
    values = 1 + sense * np.array([-0.5, -1e-5, 0.0, -2e-5, -0.3])
    found = border._turned(Branch(values, "fold"), sense)
    assert (found.kind, found.size, found.why) == ("fold", 1.0, "between two cycles")
    assert found.error == pytest.approx(2e-5, rel=1e-6)


@pytest.mark.parametrize(("values", "kinds"), [
    ([1 - 1e-6, 1.0, 1 - 1e-6], ()), ([0.5, 1.0, 0.5], ("fold",)), ([0.5, 0.9, 1.0], ("fold",)),
    ([1 - 1e-6, 1.0, 1 - 2 * TURN_KNOWN], ("fold",)),
])  # fmt: skip
def test_what_is_no_border(values, kinds):
    """No turn was met; cycles too far apart on either side; a branch that only ends."""
    assert border._turned(Branch(values, *kinds), 1) is None


@pytest.mark.slow
def test_cycles_that_go_on_unstable_are_no_hunting(monkeypatch):
    """A servo whose cycle loses its stability on the way, and whose motions come to rest at the last size."""
    servo = Servo(
        inertia=0.0341, motor_gain=48.8, controller=Controller(lead_time=0.959, integral_time=0.0324),
        friction=Friction(static=0.93, coulomb=0.729, stribeck_velocity=0.06, viscous=0.00736),
    )  # fmt: skip
    row = remedies(servo, "switch", 0.00944, only=["error dead band"]).remedies[0]
    assert row.kind == "not found" and "is not stable there, and motions came to rest" in row.why
    for seen, kind, says in (
        ("hunts", "none", "hunting goes on"), ("grows", "none", "hunting goes on"),
        ("undecided", "not found", "could not be followed to their end"),
    ):  # fmt: skip
        monkeypatch.setattr(table, "scan", lambda *a, seen=seen: fate.Scan(seen))
        row = remedies(servo, "switch", 0.00944, only=["error dead band"]).remedies[0]
        assert row.kind == kind and says in row.why


@pytest.mark.slow
def test_a_freeze_ends_hunting_where_it_is_as_long_as_the_stop():
    """The grazing is where the cycle itself would be frozen; what lies next to it is the other half of the same."""
    servo = Servo(
        inertia=0.16618, motor_gain=2.8158, controller=Controller(lead_time=0.040025, integral_time=0.084466),
        friction=Friction(static=0.40839, coulomb=0.23037, stribeck_velocity=0.038958, viscous=0.010726),
    )  # fmt: skip
    cycle = find_orbit(servo, "switch", 7.126, options=Options(tol=1e-9))
    stick = next(arc.duration for arc in cycle.arcs if arc.mode == "stick")
    (row,) = remedies(servo, "switch", 7.126, only=["freeze"]).remedies
    assert row.kind == "grazing" and row.size == pytest.approx(stick, rel=1e-7)


@pytest.mark.slow
def test_a_branch_without_an_end_in_sight_is_given_up(monkeypatch):
    """After so much work, whoever asks: it is not said that there is no end, but how far it was followed.

    The cycles of a LuGre servo that creep along half-way change in steps that become ever smaller; an answer took
    minutes.  Here motions tell nothing either.
    """
    def asked():
        return remedies(Servo(), "switch", 0.1, only=["dead band"]).remedies[0]

    end = asked().size
    monkeypatch.setattr(border, "end_of_motions", lambda *a: None)
    for work, begun in ((300, True), (20, False)):
        monkeypatch.setattr(border, "MOST_WORK_OF_A_BORDER", work)
        row = asked()
        assert row.kind == "not found" and (row.first is not None) is begun
        if begun:
            assert 0 < row.followed_to < end and "given up after the work of 300 intervals" in row.evidence
        else:
            assert math.isnan(row.followed_to) and "no cycle with a little of it was found" in row.why
    monkeypatch.undo()
    with pytest.raises(effort.GivenUp), effort.counting_work(None, limit=2000):  # of all, and not of the remedy
        asked()


@pytest.mark.parametrize("least", [0.535, 0.0])
def test_a_branch_that_cannot_be_followed_is_a_row_that_says_so(monkeypatch, least):
    """It is no end of the table, of the worst servo of a set or the one that is given; the fold: an event map's."""
    along = border._along

    def followed(cycle, *more):
        if cycle.problem.value("static") > least:
            raise NoOrbit("its cycles are not to be followed", Status.NOT_CONVERGED)
        return along(cycle, *more)

    monkeypatch.setattr(border, "_along", followed)
    monkeypatch.setattr(border, "end_of_motions", lambda *a: None)
    allowed = Uncertainty({"friction.static": (0.52, 0.54)})
    row = remedies(Servo(), "switch", 0.04, only=["dead band"], uncertainty=allowed).remedies[0]
    assert math.isnan(row.worst_size)
    if least:
        assert row.ends_hunting and row.size == pytest.approx(0.0433457242337, rel=1e-9)
    else:
        assert row.kind == "not found" and row.evidence == "its cycles are not to be followed"
        assert "could not be farther" in row.why and row.first is not None


@pytest.mark.slow
@pytest.mark.parametrize(("name", "work"), [("derivative", 1500), ("dead band", 300), ("leak", 300)])
def test_where_cycles_are_followed_no_further_motions_tell_the_border(monkeypatch, name, work):
    """The same size as the fold, to what motions know: those beside it are slow to leave."""
    exact = remedies(Servo(), "switch", 0.1, only=[name]).remedies[0]
    monkeypatch.setattr(border, "MOST_WORK_OF_A_BORDER", work)
    seen = remedies(Servo(), "switch", 0.1, only=[name]).remedies[0]
    assert exact.kind == "fold" and seen.kind == "motions" and seen.ends_hunting
    assert seen.size == pytest.approx(exact.size, rel=2 * border.MOTIONS_KNOW)
    assert seen.size_error == pytest.approx(border.MOTIONS_ERROR * seen.size) and "on as motions" in seen.why


@pytest.mark.slow
def test_motions_tell_the_worst_servo_as_folds_do(monkeypatch):
    """Its size is 13 % beyond that of the servo as given: motions go on from the last one that hunts there."""
    uncertain = Uncertainty({"friction.static": (0.52, 0.54), "friction.viscous": (0.095, 0.105)})

    def asked():
        return remedies(Servo(), "switch", 0.1, only=["derivative"], uncertainty=uncertain).remedies[0]

    exact = asked()
    monkeypatch.setattr(border, "MOST_WORK_OF_A_BORDER", 1500)
    seen = asked()
    assert exact.kind == "fold" and seen.kind == "motions"
    assert seen.worst_size == pytest.approx(exact.worst_size, rel=border.MOTIONS_ERROR)
    assert seen.worst_size > 1.1 * seen.size


def test_a_motion_that_hunts_is_handed_on_until_it_ends(monkeypatch):
    """One that ends there already, at a size beyond, or not up to the last one; and one that is unclear from the start,
    which would run away, and unclear on the way, which is taken to hunt."""
    leak = next(remedy for remedy in REMEDIES if remedy.name == "leak")
    first = fate.Swing({}, 1.0, 1.0)
    monkeypatch.setattr(border, "with_remedy", lambda loop, remedy, size: size)

    def end(hunts, unclear=lambda size: False):
        def scan(size, before):
            if not hunts(size):
                return fate.Scan("rests")
            return fate.Scan("undecided") if unclear(size) else fate.Scan("hunts", fate.Swing({}, 1.0, 1.0))

        monkeypatch.setattr(border, "scan", scan)
        found = border.end_of_motions(None, leak, first, 1.0, 10.0)
        return found and found[0]

    assert end(lambda size: False) == 1.0
    assert end(lambda size: size < 3.7) == pytest.approx(3.7, rel=2 * border.MOTIONS_KNOW)
    assert end(lambda size: True) is None
    assert end(lambda size: size < 3.7, lambda size: size > 1.1) is None
    assert end(lambda size: size < 3.7, lambda size: size > 3.6) == pytest.approx(3.7, rel=2 * border.MOTIONS_KNOW)


def test_one_that_is_unclear_wherever_it_is_handed_on_ends_the_search(monkeypatch):
    """Behind one that has come to rest: it went on to larger sizes for ever."""
    leak = next(remedy for remedy in REMEDIES if remedy.name == "leak")
    seen = []

    def scan(size, before):
        seen.append(size)
        assert len(seen) < 30
        if size == 1.0:
            return fate.Scan("hunts", fate.Swing({}, 1.0, 1.0))
        return fate.Scan("rests" if len(seen) == 2 else "undecided")

    monkeypatch.setattr(border, "with_remedy", lambda loop, remedy, size: size)
    monkeypatch.setattr(border, "scan", scan)
    found = border.end_of_motions(None, leak, fate.Swing({}, 1.0, 1.0), 1.0, 10.0)
    assert found[0] == 1 + border.FIRST_MORE and max(seen) == found[0]
