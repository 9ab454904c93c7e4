"""Where cycles are not followed to their end, motions tell where hunting ends; and what is said where nobody knows."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from casahunt import Controller, Friction, Options, Servo, Uncertainty, effort, find_orbit, remedies
from casahunt.design.remedies import border, handed_on
from casahunt.design.remedies import scan as scans
from casahunt.errors import NoOrbit, Status
from casahunt.servo.parts import REMEDIES, fate


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
@pytest.mark.parametrize(("servo", "gain", "size"), [
    (Servo(inertia=0.0096004, motor_gain=3.7978, controller=Controller(lead_time=0.043276, integral_time=0.044034),
           friction=Friction(static=0.66985, coulomb=0.3806, stribeck_velocity=0.0025886, viscous=0.0016539)),
     39.245, 0.000457),
    (Servo(inertia=0.09437, motor_gain=2.615, controller=Controller(lead_time=0.50836, integral_time=0.21342),
           friction=Friction(static=0.41549, coulomb=0.31823, stribeck_velocity=0.0065995, viscous=0.0017082)),
     0.20491, 0.0456),
])  # fmt: skip
def test_a_branch_that_turns_back_as_an_arc_vanishes_ends_hunting_there(servo, gain, size):
    """By heyoka it hunts with 0.999 of the hysteresis and rests with 1.001 of it; what turns back there is rounding."""
    (row,) = remedies(servo, "switch", gain, only=["hysteresis"]).remedies
    assert row.kind == "grazing" and row.size == pytest.approx(size, rel=1e-3)
    assert row.size_error <= 1e-6 * row.size


def without_end_of_cycles(*more):
    raise NoOrbit("its cycles are not to be followed", Status.NOT_CONVERGED)


@pytest.mark.slow
def test_a_branch_without_an_end_in_sight_is_given_up(monkeypatch):
    """After so much work, whoever asks: motions go on, and it is said what stopped the cycles.

    The cycles of a LuGre servo that creep along half-way change in steps that become ever smaller; an answer took
    minutes.
    """
    def asked():
        return remedies(Servo(), "switch", 0.1, only=["dead band"]).remedies[0]

    end = asked().size
    monkeypatch.setattr(border, "MOST_WORK_OF_AN_END", 300)
    row = asked()
    assert row.kind == "motions" and row.size == pytest.approx(end, rel=border.MOTIONS_ERROR)
    assert "no answer came after the work of 3" in row.evidence  # 300, and what was begun
    monkeypatch.setattr(border, "MOST_WORK_OF_AN_END", 20)
    row = asked()
    assert row.kind == "not found" and math.isnan(row.followed_to) and border.NO_FIRST in row.why
    monkeypatch.undo()
    with pytest.raises(effort.GivenUp), effort.counting_work(None, limit=2000):  # of all, and not of the remedy
        asked()


def test_where_nobody_knows_the_row_says_so(monkeypatch):
    """No motion hunts beside the first cycle, or what becomes of it is unclear up to the last size."""
    for verdict, says in (("at rest", "no motion hunts on the cycle"), ("undecided", "beyond is not known")):
        monkeypatch.setattr(handed_on, "scan", lambda *more, rest=0.0, verdict=verdict: scans.Scan(verdict))
        row = remedies(Servo(), "switch", 0.04, only=["dead band"]).remedies[0]
        assert row.kind == "not found" and says in row.why and row.first is not None


def test_what_branches_off_and_was_not_followed_is_told(monkeypatch):
    """Hunting may go on along it: the loss of stability is the border that is known, and its evidence says so."""
    def refused(*more, **options):
        raise NoOrbit("several cycles branch off there", Status.NOT_FOUND)

    leak = next(remedy for remedy in REMEDIES if remedy.name == "leak")
    lost = SimpleNamespace(value=0.4, error=1e-9, orbit=None, meaning="symmetry breaking")
    monkeypatch.setattr(border, "branch_off", refused)
    found = border._behind([lost], math.nan, leak, 1.0, Options())
    assert (found.kind, found.size) == ("instability", 0.4) and "several cycles branch off" in found.evidence


@pytest.mark.slow
@pytest.mark.parametrize("name", ["derivative", "dead band", "leak"])
def test_where_cycles_are_followed_no_further_motions_tell_the_border(monkeypatch, name):
    """The same size as the fold, to what motions know: those beside it are slow to leave."""
    exact = remedies(Servo(), "switch", 0.1, only=[name]).remedies[0]
    monkeypatch.setattr(border, "_end_of_stable", without_end_of_cycles)
    seen = remedies(Servo(), "switch", 0.1, only=[name]).remedies[0]
    assert exact.kind == "fold" and seen.kind == "motions" and seen.ends_hunting
    assert seen.size == pytest.approx(exact.size, rel=border.MOTIONS_ERROR)
    assert seen.size_error == pytest.approx(border.MOTIONS_ERROR * seen.size) and "motions hunt up to" in seen.why
    assert seen.evidence == "its cycles are not to be followed"


@pytest.mark.slow
def test_motions_tell_the_worst_servo_as_folds_do(monkeypatch):
    """Its size is 13 % beyond that of the servo as given: motions go on from the last one that hunts there."""
    uncertain = Uncertainty({"friction.static": (0.52, 0.54), "friction.viscous": (0.095, 0.105)})

    def asked():
        return remedies(Servo(), "switch", 0.1, only=["derivative"], uncertainty=uncertain).remedies[0]

    exact = asked()
    monkeypatch.setattr(border, "_end_of_stable", without_end_of_cycles)
    seen = asked()
    assert exact.kind == "fold" and seen.kind == "motions"
    assert seen.worst_size == pytest.approx(exact.worst_size, rel=border.MOTIONS_ERROR)
    assert seen.worst_size > 1.1 * seen.size


def test_a_motion_that_hunts_is_handed_on_until_it_ends(monkeypatch):
    """One that ends there already, at a size beyond, or not up to the last one; and one that is unclear from the start,
    and unclear on the way, which is taken to hunt."""
    leak = next(remedy for remedy in REMEDIES if remedy.name == "leak")
    first = fate.Swing({}, 1.0, 1.0)
    monkeypatch.setattr(handed_on, "with_remedy", lambda loop, remedy, size: size)

    def end(hunts, unclear=lambda size: False):
        def scan(size, before, rest):
            if not hunts(size):
                return scans.Scan("at rest")
            return scans.Scan("undecided") if unclear(size) else scans.Scan("hunting", fate.Swing({}, 1.0, 1.0))

        monkeypatch.setattr(handed_on, "scan", scan)
        return handed_on.end_of_motions(None, leak, first, 1.0, 10.0, border.MOTIONS_KNOW)

    assert end(lambda size: False).ended == 1.0
    found = end(lambda size: size < 3.7)
    assert found.hunts < 3.7 <= found.ended < (1 + border.MOTIONS_KNOW) * found.hunts
    found = end(lambda size: True)
    assert found.hunts == 10.0 and math.isnan(found.ended)
    found = end(lambda size: True, lambda size: size > 1.1)
    assert found.hunts == 1.0 and math.isnan(found.ended)
    found = end(lambda size: size < 3.7, lambda size: size > 3.6)
    assert found.ended == pytest.approx(3.7, rel=2 * border.MOTIONS_KNOW) and found.hunts <= 3.6


def test_no_size_is_told_where_motions_alone_do_not_show_the_end(monkeypatch):
    """Cycles are not followed, and looked at more finely motions become unclear: it is not found, and not "at nan"."""
    ends = iter([0.04, math.nan])
    swing = fate.Swing.of(find_orbit(Servo(), "switch", 0.04))
    monkeypatch.setattr(
        border, "end_of_motions", lambda *more: handed_on.EndOfMotions(0.03, swing, next(ends), "undecided")
    )
    monkeypatch.setattr(border, "_end_of_stable", without_end_of_cycles)
    row = remedies(Servo(), "switch", 0.04, only=["dead band"]).remedies[0]
    assert row.kind == "not found" and row.evidence == "its cycles are not to be followed"
    assert "whether any hunts beyond is not known" in row.why


def test_cycles_may_take_twice_the_work_where_motions_alone_are_left(monkeypatch):
    """The first time they are tried again from where motions come nearer to them, the second time nothing is."""
    allowed, swing = list[float](), fate.Swing.of(find_orbit(Servo(), "switch", 0.04))
    seen = handed_on.EndOfMotions(0.03, swing, 0.05, "at rest")

    def end_of_cycles(*more):
        allowed.append(0.0)
        while True:
            effort.problem(10_000)
            allowed[-1] += 10_000

    monkeypatch.setattr(border, "end_of_motions", lambda *more: seen)
    monkeypatch.setattr(border, "_end_of_stable", end_of_cycles)
    assert remedies(Servo(), "switch", 0.04, only=["dead band"]).remedies[0].kind == "motions"
    assert allowed == [border.MOST_WORK_OF_AN_END, 2 * border.MOST_WORK_OF_AN_END]


def test_what_motions_leave_open_is_the_error_of_their_size(monkeypatch):
    """None is known to hunt from 0.03 on, none does from 0.05 on."""
    swing = fate.Swing.of(find_orbit(Servo(), "switch", 0.04))
    seen = handed_on.EndOfMotions(0.03, swing, 0.05, "at rest")
    monkeypatch.setattr(border, "end_of_motions", lambda *more: seen)
    monkeypatch.setattr(border, "_end_of_stable", without_end_of_cycles)
    row = remedies(Servo(), "switch", 0.04, only=["dead band"]).remedies[0]
    assert row.kind == "motions" and row.size == 0.05 and row.size_error == pytest.approx(0.02)


def test_a_fold_that_is_not_known_is_no_size(monkeypatch):
    """Motions tell it then, and the row says what is wrong with the fold."""
    real = border.largest

    def known_badly(special, vary, options):
        found = real(special, vary, options=options)
        return replace(found, value_error=1e-3)

    monkeypatch.setattr(border, "largest", known_badly)
    row = remedies(Servo(), "switch", 0.04, only=["dead band"]).remedies[0]
    assert row.kind == "motions" and "known to 0.001 only" in row.evidence
    assert row.size == pytest.approx(0.04334572, rel=border.MOTIONS_ERROR)
