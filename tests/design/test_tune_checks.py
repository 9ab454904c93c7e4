"""What is verified of a tuning: motions, servos worse than the worst, folds that are not known."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from casahunt import Drive, find_fold, margins
from casahunt.cli import main
from casahunt.design.tune import best_gain, check
from casahunt.design.tune.check import scanned
from casahunt.design.tune.demands import Demands
from casahunt.design.tune.tuning import tune
from casahunt.design.uncertainty.set import Uncertainty
from casahunt.design.uncertainty.worst_corner import WorstCase
from casahunt.errors import InputError, NoOrbit
from casahunt.servo.event_map.fixed_points import FixedPoint, FixedPoints
from casahunt.servo.event_map.scan import Scan
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.margins import Margins
from casahunt.servo.simulate import simulate


def undecided(motion):
    """The motion with a verdict that needs more time, whatever the judge of motions makes of it."""
    motion.__dict__["verdict"] = replace(motion.verdict, kind="undecided", sentence="more time is needed")
    return motion


def test_what_stays_undecided_is_said(unscanned, monkeypatch, servo, capsys):
    """Neither verified nor refused: the sentence stands in the text, the record and on standard error."""

    def too_short(servo, model, gain, *, time, **start):
        return undecided(simulate(servo, model, gain, time=0.3, **start))

    monkeypatch.setattr("casahunt.design.tune.check.simulate", too_short)
    assert main(["tune", "--quiet"]) == 0
    said = capsys.readouterr()
    assert "not everything verified" in said.out
    sentence = "not verified nominal friction, a step of 1 rad from rest: undecided after 0.3 s"
    assert sentence in " ".join(said.out.split())
    assert "not verified: nominal friction" in said.err
    assert main(["tune", "--quiet", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["verification"]
    assert not shown["ok"] and shown["result"] == "not everything verified" and len(shown["unverified"]) >= 1


@pytest.mark.slow
def test_a_worse_servo_than_the_worst_joins(unscanned, monkeypatch, servo):
    """A search that stops too early is found out by the corners, and goes on from there."""
    box = Uncertainty({"friction.static": (0.525, 0.535)})
    from casahunt.design.tune import best_gain as tune_given

    search = tune_given.worst_corner

    def lazy(servo, model, uncertainty, *, starts=(), **rest):
        if starts:
            return search(servo, model, uncertainty, starts=starts, **rest)
        return WorstCase(servo, find_fold(servo, model), {"friction.static": 0.53}, 1)

    # No box is known where the search misses the worst corner: one that stops at its start does.
    monkeypatch.setattr(tune_given, "worst_corner", lazy)
    found = tune(servo, "switch", uncertainty=box)
    worst = find_fold(servo.replace(**{"friction.static": 0.535}), "switch")
    assert found.gain == pytest.approx(1.1 * worst.gain, rel=1e-6)


@pytest.mark.slow
def test_servos_of_the_set_whose_fold_is_not_known_are_named(unscanned, monkeypatch, servo):
    """A fold that is not computed at a corner, and an event map that does not help, leave it unverified."""
    from casahunt.design import nearby
    from casahunt.design.uncertainty import worst_corner

    honest, honest_batch = nearby.fold_near, check.folds_of

    def failing(servo, *rest):
        if servo.inertia > 0.027:
            raise NoOrbit("not today")
        return honest(servo, *rest)

    def failing_batch(servo, model, names, rows, **rest):
        found = honest_batch(servo, model, names, rows, **rest)
        failures = tuple((int(i), "not today") for i in np.flatnonzero(rows[:, 0] > 0.027))
        return replace(found, gains=np.where(rows[:, 0] > 0.027, np.nan, found.gains), failures=failures)

    # Every fold near Table 1 is found: those of one end of the set are lost on purpose.
    for module in (nearby, worst_corner):
        monkeypatch.setattr(module, "fold_near", failing)
    monkeypatch.setattr(check, "folds_of", failing_batch)
    monkeypatch.setattr("casahunt.design.tune.check._no_cycle", lambda *_: False)
    found = tune(servo, "switch", uncertainty=Uncertainty({"servo.inertia": (0.025, 0.028)}))
    shown = found.verification
    assert not shown.ok and not shown.against
    assert any("no fold was computed at servo.inertia = 0.028 kg m2: not today" in said for said in shown.unverified)
    assert any("in the search for the worst friction: at servo.inertia = 0.028 kg" in said for said in shown.unverified)


@pytest.mark.slow
def test_a_set_with_servos_that_cannot_hunt(unscanned, servo):
    """At static = Coulomb friction there is no cycle; the largest static friction of the set decides."""
    found = tune(servo, "switch", uncertainty=Uncertainty({"friction.static": (0.44, 0.5)}))
    worst = find_fold(servo, "switch")  # the servo as given, 0.53, is outside of the set and worse
    assert found.gain == pytest.approx(1.1 * worst.gain, rel=1e-6) and found.corner == {}
    assert found.verification.ok


@pytest.mark.slow
def test_a_motion_that_grows_speaks_against_a_tuning(servo, plain):
    assert scanned(servo, "switch", 0.9 * plain.fold_gain)[1] == "cycle"
    assert scanned(servo, "lugre", plain.gain)[1] == "clear"
    assert scanned(servo, "lugre", 0.5 * plain.fold_gain)[1] == "cycle"


def test_a_servo_joins_once(servo):
    """The same but for rounding is no new one, and a search that finds nothing new ends."""
    near, worse = (servo.replace(**{"friction.static": value}) for value in (0.53 * (1 + 1e-10), 0.53 * (1 + 1e-8)))
    assert (
        best_gain._same(servo, near) and not best_gain._same(servo, worse) and best_gain._same(servo, worse, rtol=1e-6)
    )
    search = SimpleNamespace(folds={}, free=(), members=[servo])
    for each, new in ((near, False), (worse, True), (worse, False)):
        assert best_gain.Given.join(search, WorstCase(each, None, {}, 1), np.zeros(2)) is new
    assert search.members == [servo, worse]


@pytest.mark.parametrize(
    ("phase", "low", "high", "stable", "kept"),
    [
        (30.0, 0.5, 2.0, True, True), (60.0, 0.0, math.inf, True, True), (29.9, 0.5, 2.0, True, False),
        (30.0, 0.51, 2.0, True, False), (30.0, 0.5, 1.99, True, False), (40.0, 0.1, 9.0, False, False),
        (-10.0, math.nan, math.nan, False, False),
    ],
)  # fmt: skip
def test_each_margin_is_asked_for(phase, low, high, stable, kept):
    loop = Margins(10.0, phase, low, high, stable)
    assert check._keeps(loop, Demands(phase_margin=30.0, gain_margin=2.0)) is kept


def seen(starts, positions, **others) -> FixedPoints:
    """The event map at some stick positions."""
    pairs = zip(starts, positions, strict=True)
    points = tuple(SimpleNamespace(start=a, position=p, excess=p / a - 1) for a, p in pairs)
    rest = {"fixed": (), "jumps": (), "unresolved": (), "failures": ()} | others
    return FixedPoints(None, 0.1, starts[0], starts[-1], points, **rest)


@pytest.mark.parametrize(
    ("positions", "others", "state"),
    [
        ((0.5, -1.9, 0.0), {}, "clear"),
        ((0.5, 2.0, 1.0), {}, "cycle"), ((0.5, -2.1, 1.0), {}, "cycle"),  # it goes out, to either side
        ((0.5, 1.0, 1.0), {"fixed": (FixedPoint(1.5, 0.5, 1.0, 0.0, 0.0),)}, "cycle"),
        ((0.5, math.nan, 1.0), {}, "open"),  # it swings on
        ((0.5, 1.0, 1.0), {"unresolved": ((1.0, 1.1),)}, "open"), ((0.5, 1.0, 1.0), {"failures": (2.5,)}, "open"),
    ],
)  # fmt: skip
def test_what_the_event_map_shows(monkeypatch, servo, positions, others, state):
    # Each verdict of the map, as its record has it: no servo at hand shows all of them.
    monkeypatch.setattr(check, "fixed_points", lambda *_, **__: seen((1.0, 2.0, 3.0), positions, **others))
    assert scanned(servo, "switch", 0.1)[1] == state


@pytest.mark.parametrize(
    ("best", "upper", "failures", "state"),
    [(0.9, False, (), "clear"), (0.9, False, (0.1,), "open"), (1.0, False, (), "cycle"), (0.9, True, (), "cycle")],
)
def test_what_a_scan_shows(monkeypatch, servo, best, upper, failures, state):
    cycle = SimpleNamespace(start=0.02) if upper else None
    # As above, for the scan.
    monkeypatch.setattr(check, "scan", lambda *_: Scan(1e-4, 1.0, best, 0.01, cycle, failures, 50))
    assert scanned(servo, "lugre", 0.1)[1] == state
    assert check._no_cycle(servo, "lugre", 0.1) is (state == "clear")


def test_a_servo_that_cannot_hunt_is_left_to_its_margins(servo):
    found = tune(servo.replace(**{"friction.static": 0.44}), "switch")
    assert found.fold_gain == 0 and found.verification.ok and found.verification.scan_clear
    for seen_there in ("cycle", "open"):
        assert not replace(found.verification, seen=seen_there).scan_clear
    for against in ({"against": ("a loop",)}, {"unverified": ("a task",)}):
        assert not replace(found.verification, **against).ok
    assert linear_loop(servo, found.gain).gain_crossovers[0].margin == pytest.approx(30, abs=1e-5)


def test_the_margins_of_a_drive_are_those_of_the_sampled_loop(servo):
    """With a sample time alone, the defaults; with a drive its times are the demands'."""
    drive = Drive(sample_time=0.01, delay=0.004, derivative="filtered")
    asked = Demands(drive=drive)
    assert (asked.delay, asked.sample_time, asked.built) == (0.004, 0.01, drive)
    assert replace(asked, phase_margin=40.0).built == drive
    assert Demands(sample_time=0.01).built == Drive(sample_time=0.01) and Demands(delay=0.004).built is None
    for demands, exact in (
        (asked, margins(servo, 0.7, drive=drive)),
        (Demands(delay=0.004), margins(servo, 0.7, delay=0.004)),
    ):
        assert check._margins_of(servo, 0.7, demands) == exact
    with pytest.raises(InputError, match="delay = 0.003: must be left out, or that of the drive"):
        Demands(drive=drive, delay=0.003)
