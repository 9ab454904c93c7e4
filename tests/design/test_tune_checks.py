"""What is verified of a tuning: motions, servos worse than the worst, folds that are not known."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import find_fold
from casahunt.cli import main
from casahunt.design.tune.check import scanned
from casahunt.design.tune.tasks import until_decided, waits
from casahunt.design.tune.tuning import tune
from casahunt.design.uncertainty.set import Uncertainty
from casahunt.design.uncertainty.worst_corner import WorstCase
from casahunt.errors import NoOrbit
from casahunt.servo.linear_loop import linear_loop
from casahunt.servo.simulation.simulate import simulate


def undecided(motion):
    """The motion with a verdict that needs more time, whatever the judge of motions makes of it."""
    motion.__dict__["verdict"] = replace(motion.verdict, kind="undecided", sentence="more time is needed")
    return motion


def test_a_task_is_simulated_until_it_is_decided(servo, monkeypatch):
    """Longer and longer, until there is a verdict; and not for ever."""
    lengths = []

    def slow(servo, model, gain, *, time, **start):
        lengths.append(time)
        motion = simulate(servo, model, gain, time=time, **start)
        return motion if time > decided_after else undecided(motion)

    monkeypatch.setattr("casahunt.design.tune.tasks.simulate", slow)
    decided_after = 20.0
    motion = until_decided(servo, "switch", 0.7121, 0.5, {"set_point": 0.1})
    assert motion.times[-1] > 20 and motion.verdict.kind in ("at rest", "decaying")
    assert abs(motion.states[0, -1]) < 1e-3  # from 0.1 rad beside the set point
    assert all(later >= 2 * sooner for sooner, later in zip(lengths, lengths[1:], strict=False))
    decided_after = math.inf
    assert until_decided(servo, "switch", 0.7121, 0.5, {"set_point": 0.1}).verdict.kind == "undecided"
    # The wait of a stuck servo, m(t) = m - ki x1 t up to static friction, against the event of a longer motion.
    stuck = simulate(servo, "switch", 0.04, set_point=0.0, position=-0.01, integral=0.0, time=1.0)
    assert stuck.modes[-1] == "stick"
    longer = simulate(servo, "switch", 0.04, set_point=0.0, position=-0.01, integral=0.0, time=1.1 + waits(stuck))
    away = next(e.time for e in longer.events if e.name.startswith("breakaway"))
    assert float(stuck.times[-1]) + waits(stuck) == pytest.approx(away, abs=1e-6)


def test_what_stays_undecided_is_said(unscanned, monkeypatch, servo, capsys):
    """Neither verified nor refused: the sentence stands in the text, the record and on standard error."""

    def too_short(servo, model, gain, _, start):
        return undecided(simulate(servo, model, gain, time=0.3, **start))

    monkeypatch.setattr("casahunt.design.tune.tasks.until_decided", too_short)
    assert main(["tune", "--quiet"]) == 0
    said = capsys.readouterr()
    assert "not everything verified" in said.out
    sentence = "not verified nominal friction, a step of 1 rad from rest: undecided after 0.3 s"
    assert sentence in " ".join(said.out.split())
    assert "not verified: nominal friction" in said.err
    assert main(["tune", "--quiet", "--json"]) == 0
    check = json.loads(capsys.readouterr().out)["verification"]
    assert not check["ok"] and check["result"] == "not everything verified" and len(check["unverified"]) >= 1


@pytest.mark.slow
def test_a_worse_servo_than_the_worst_joins(unscanned, monkeypatch, servo):
    """A search that stops too early is found out by the corners, and goes on from there."""
    box = Uncertainty({"friction.static": (0.525, 0.535)})
    from casahunt.design.tune import given as tune_given

    search = tune_given.worst_corner

    def lazy(servo, model, uncertainty, *, starts=(), **rest):
        if starts:
            return search(servo, model, uncertainty, starts=starts, **rest)
        return WorstCase(servo, find_fold(servo, model), {"friction.static": 0.53}, 1)

    monkeypatch.setattr(tune_given, "worst_corner", lazy)
    found = tune(servo, "switch", uncertainty=box)
    worst = find_fold(servo.replace(**{"friction.static": 0.535}), "switch")
    assert found.gain == pytest.approx(1.1 * worst.gain, rel=1e-6)


@pytest.mark.slow
def test_servos_of_the_set_whose_fold_is_not_known_are_named(unscanned, monkeypatch, servo):
    """A fold that is not computed at a corner, and an event map that does not help, leave it unverified."""
    from casahunt.design.tune import check as tune_check
    from casahunt.design.uncertainty import nearby, worst_corner

    honest, honest_batch = nearby.fold_near, tune_check.fold_gains

    def failing(servo, *rest):
        if servo.inertia > 0.027:
            raise NoOrbit("not today")
        return honest(servo, *rest)

    def failing_batch(servo, model, names, rows, **rest):
        gains, failures = honest_batch(servo, model, names, rows, **rest)
        lost = np.flatnonzero(rows[:, 0] > 0.027)
        return np.where(rows[:, 0] > 0.027, np.nan, gains), failures | {int(i): "not today" for i in lost}

    for module in (nearby, worst_corner):
        monkeypatch.setattr(module, "fold_near", failing)
    monkeypatch.setattr(tune_check, "fold_gains", failing_batch)
    monkeypatch.setattr("casahunt.design.tune.check._no_cycle", lambda *_: False)
    found = tune(servo, "switch", uncertainty=Uncertainty({"servo.inertia": (0.025, 0.028)}))
    check = found.verification
    assert not check.ok and not check.against
    assert any("no fold was computed at servo.inertia = 0.028: not today" in said for said in check.unverified)
    assert any("in the search for the worst friction: at servo.inertia = 0.028" in said for said in check.unverified)


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


def test_a_servo_that_cannot_hunt_is_left_to_its_margins(servo):
    found = tune(servo.replace(**{"friction.static": 0.44}), "switch")
    assert found.fold_gain == 0 and found.verification.ok
    assert linear_loop(servo, found.gain).gain_crossovers[0].margin == pytest.approx(30, abs=1e-5)
