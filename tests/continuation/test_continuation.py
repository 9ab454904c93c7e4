"""Branches: natural and pseudo-arclength continuation, special points, and whole diagrams of many servos."""

from __future__ import annotations

import csv
import itertools
import json
import math
import re

import pytest

from casahunt import NoOrbit, Options, Servo, find_orbit
from casahunt.cli import main
from casahunt.continuation import special_points_between
from casahunt.continuation.special_points import FOLD, user_monitor
from casahunt.continuation.walk import walk, walk_naturally, walk_to_end
from casahunt.design.diagram import STANDARD, diagram
from problems import table1

FOLDS = {model: table1.REFERENCE[model]["fold"]["K"] for model in ("switch", "lugre")}


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])  # the command does both
def test_natural_continuation_ends_at_the_fold(orbit, model):
    orbits, why = walk_to_end(
        walk_naturally(orbit(model, 0.5, tol=1e-6), low=0.0321, high=1.0, options=Options(tol=1e-6))
    )
    assert FOLDS[model] * (1 - 1e-3) < orbits[-1].gain < FOLDS[model] * (1 + 1e-6)
    assert "the branch ends" in why
    assert all(b.gain > a.gain for a, b in itertools.pairwise(orbits))
    assert all(o.multipliers.leading.real < 1 for o in orbits)


def test_natural_continuation_uses_given_range():
    start = find_orbit(Servo(), "switch", 0.1)
    orbits, why = walk_to_end(walk_naturally(start, low=0.05, high=0.2, sense=-1.0))
    assert orbits[-1].gain == 0.05
    assert "reached" in why


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_natural_diagram_ends_at_the_fold_and_says_where(model):
    branch = diagram(Servo(), model, start=0.6, natural=True)
    assert branch.orbits[-1].gain == pytest.approx(FOLDS[model], rel=1e-6)
    assert branch.special[-1].kind == "fold" and branch.special[-1].orbit is branch.orbits[-1]
    assert all(b.gain > a.gain for a, b in itertools.pairwise(branch.orbits))
    assert all(o.multipliers.leading.real < 1 for o in branch.orbits[:-1])
    said = float(re.search(r"ends at the fold at gain = ([\d.]+)", branch.ended).group(1))
    assert said == pytest.approx(FOLDS[model], rel=1e-6)


def test_natural_diagram_by_ipopt_alone():
    options = Options(tol=1e-8, solver="ipopt")
    branch = diagram(Servo(), "switch", start=0.6, options=options, natural=True)
    assert branch.orbits[-1].gain == pytest.approx(FOLDS["switch"], rel=1e-8)
    assert {o.solver for o in branch.orbits} == {"ipopt"}


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_walk_by_ipopt_alone_down_the_unstable_branch(model):
    """Round the fold by pseudo-arclength, past multipliers of 1e10, to where the diagrams begin."""
    options = Options(solver="ipopt")
    first = find_orbit(Servo(), model, 0.5, options=options)
    orbits, why = walk_to_end(walk(first, low=0.0321, high=10.0, options=options))
    assert "reached 0.0321" in why and {o.solver for o in orbits} == {"ipopt"}
    assert max(o.gain for o in orbits) == pytest.approx(FOLDS[model], rel=0.02)
    assert orbits[-1].period == pytest.approx(3318 if model == "switch" else 1273, rel=1e-3)
    top = max(range(len(orbits)), key=lambda k: orbits[k].gain)
    steep = min(orbits[top:], key=lambda o: abs(o.gain - 0.4))
    assert steep.multipliers.log10_leading > 4.5 and steep.multipliers.trusted and orbits[-1].multipliers.trusted


def test_a_natural_diagram_that_meets_no_fold_says_so(monkeypatch, undrawn, capsys, tmp_path):
    """Patched: no fold of a servo is known that is not met so."""

    def lost(*_arguments):
        raise NoOrbit("the optimisation problem was not solved")

    monkeypatch.setattr("casahunt.design.diagram.next_fold", lost)
    out = tmp_path / "out"
    command = ["diagram", "--natural", "--model", "switch", "--from", "0.6", "--out", str(out), "--quiet", "--json"]
    assert main(command) == 1
    captured = capsys.readouterr()
    assert "not to a fold" in captured.err and "is not shown" in captured.err
    assert json.loads(captured.out)["failures"]


def test_command_line_natural(undrawn, capsys, tmp_path):
    out = tmp_path / "out"
    command = ["diagram", "--natural", "--model", "switch", "--from", "0.6", "--out", str(out), "--quiet"]
    assert main([*command, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["continuation"] == "natural" and not record["failures"]
    (branch,) = record["branches"]
    assert branch["gain_range"] == pytest.approx([0.6, FOLDS["switch"]], rel=1e-6)
    with (out / "switch.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == branch["points"] + len(branch["special"]) - 1
    assert [row["special"] for row in rows].count("fold") == 1 and rows[-1]["special"] == "fold"
    assert float(rows[-1]["gain"]) == pytest.approx(FOLDS["switch"], rel=1e-6)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_walk_passes_through_the_reference_rows(orbit, model):
    """Down the unstable branch, onto each reference gain."""
    start = orbit(model, 0.6)
    for row in table1.REFERENCE[model]["unstable"]:
        if row["K"] > 0.6:
            continue
        orbits, _ = walk_to_end(walk(start, low=row["K"], high=10.0, options=Options(tol=1e-9)))
        # The first pass goes round the fold and comes down onto the bound.
        assert orbits[-1].gain == row["K"]
        assert orbits[-1].amplitude == pytest.approx(row["amplitude"], rel=1e-7)
        assert orbits[-1].period == pytest.approx(row["period"], rel=1e-7)


def test_walk_in_another_parameter(orbit):
    """Stribeck velocity instead of gain: the end agrees with a fresh search there."""
    orbits, why = walk_to_end(walk(orbit("switch", 0.3), vary="friction.stribeck_velocity", low=0.01, high=0.025))
    assert "friction.stribeck_velocity reached 0.025" in why
    fresh = find_orbit(orbits[-1].servo, "switch", 0.3, options=Options(tol=1e-9))
    assert orbits[-1].servo.friction.stribeck_velocity == 0.025
    assert orbits[-1].amplitude == pytest.approx(fresh.amplitude, rel=1e-6)


def test_walk_can_be_resumed_in_either_direction(orbit):
    start = orbit("switch", 0.6)
    options = Options(tol=1e-9)
    forwards = list(itertools.islice(walk(start, low=0.1, high=10.0, options=options), 6))
    resumed = list(itertools.islice(walk(forwards[2], previous=forwards[1], low=0.1, high=10.0, options=options), 12))
    assert resumed[-1].amplitude < forwards[2].amplitude
    back = list(itertools.islice(walk(forwards[2], previous=forwards[3], low=0.1, high=10.0, options=options), 3))
    assert back[0].amplitude > forwards[2].amplitude


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_fold_between_two_orbits_of_a_walk(model):
    """Their units differ; it lies on either side of the highest one, and in no two steps."""
    orbits, _ = walk_to_end(walk(find_orbit(Servo(), model, 0.3), low=0.3, high=1.0, options=Options(tol=1e-5)))
    top = max(range(len(orbits)), key=lambda k: orbits[k].gain)
    found = []
    for before, after in ((orbits[top - 1], orbits[top]), (orbits[top], orbits[top + 1])):
        found += special_points_between(before, after, vary="gain", monitors=(FOLD,), options=Options(tol=1e-10))[0]
    (fold,) = found
    assert fold.orbit.gain == pytest.approx(FOLDS[model], rel=1e-10)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_special_points(model):
    """The fold lies at the reference gain; mu is what the kind says, by the integrator-free multipliers."""
    branch = diagram(Servo(), model, start=0.55, options=Options(tol=1e-9))
    kinds = {s.kind: s for s in branch.special}
    assert kinds["fold"].orbit.gain == pytest.approx(FOLDS[model], rel=1e-9 if model == "switch" else 1e-8)
    assert kinds["fold"].orbit.half_multiplier == pytest.approx(1, abs=1e-4)
    assert kinds["superstable"].orbit.half_multiplier == pytest.approx(0, abs=1e-6)
    assert list(branch.stable) == sorted(branch.stable, reverse=True)
    assert branch.orbits[0].gain == branch.orbits[-1].gain == 0.55
    assert "fold" in kinds["fold"].meaning


def test_user_monitor_is_located(orbit):
    a, b = orbit("switch", 0.2), None
    for b in walk(a, low=0.1, high=0.6, options=Options(tol=1e-9)):
        if b.period > 15:
            break
    assert b is not None
    before = orbit("switch", 0.2)
    points = list(walk(before, low=0.1, high=0.6, options=Options(tol=1e-9)))
    monitor = user_monitor("period of 15 s", lambda o: o.period - 15)
    found = [
        s
        for first, second in itertools.pairwise([before, *points])
        for s in special_points_between(first, second, vary="gain", monitors=(monitor,), options=Options(tol=1e-9))[0]
    ]
    assert len(found) == 1
    assert found[0].orbit.period == pytest.approx(15, abs=1e-8)
    assert not any(m.kind == monitor.kind for m in STANDARD)


@pytest.mark.parametrize(("jump", "most"), [(0.0, 12), (4e-7, 16)])
def test_a_monitor_that_jumps_over_zero(orbit, jump, most):
    """By less than is accepted: halving on to the jump, forty orbits more, tells nothing that is known."""
    seen = []

    def value(o):
        seen.append(o.period - 15 + math.copysign(jump, o.period - 15 - 1e-7))
        return seen[-1]

    monitor, ends = user_monitor("period of 15 s", value), (orbit("switch", 0.3), orbit("switch", 0.4))
    found, missed = special_points_between(*ends, vary="gain", monitors=(monitor,), options=Options())
    assert not missed and abs(found[0].orbit.period - 15) < 1e-6 and len(seen) <= most


VARIANTS = {
    "Table 1": {},
    "Fs = 0.50": {"friction.static": 0.50},
    "Fc = 0.42": {"friction.coulomb": 0.42},
    "vs = 0.03": {"friction.stribeck_velocity": 0.03},
    "J = 0.05": {"servo.inertia": 0.05},
    "sigma2 = 0.2": {"friction.viscous": 0.2},
    "sigma0 = 1e5": {"friction.stiffness": 1e5, "friction.damping": 16.16},
    "tau": {"controller.integral_time": 0.12, "controller.lead_time": 0.25},
}


@pytest.mark.slow
@pytest.mark.parametrize("changes", VARIANTS.values(), ids=VARIANTS.keys())
@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_whole_diagrams(model, changes):
    """From K = 0.0321 round the fold to K = 0.0321 without a hand on it."""
    servo = Servo().replace(**changes)
    branch = diagram(servo, model, start=0.0321, options=Options(tol=1e-9), largest_step=0.5)
    assert branch.gains[0] == branch.gains[-1] == 0.0321
    assert [s.kind for s in branch.special].count("fold") == 1
    assert all(o.status.ok and o.error_estimate <= 1e-9 for o in branch.orbits)
    assert all(o.multipliers.trivial_error < 1e-8 for o in branch.orbits if o.stable)
    assert all(o.multipliers.trusted for o in branch.orbits)
    assert branch.stable[0] and not branch.stable[-1]
    if not changes:
        assert branch.periods[-1] == pytest.approx(3318 if model == "switch" else 1273, rel=1e-3)


def test_large_steps_do_not_turn_back_at_the_fold():
    """A step over the fold turns the tangent by more than a right angle: it must not lead back unnoticed."""
    servo = Servo().replace(**{"friction.viscous": 0.2})
    branch = diagram(servo, "switch", start=0.3, options=Options(tol=1e-9), largest_step=0.5)
    assert [s.kind for s in branch.special].count("fold") == 1
    assert branch.orbits[-1].gain == 0.3 and branch.amplitudes[-1] < 0.5 * branch.amplitudes[0]
    assert not branch.stable[-1]


LEAD = Servo().replace(**{
    "friction.viscous": 0.2239, "friction.static": 0.8884, "friction.stribeck_velocity": 0.0884,
    "servo.inertia": 0.0725, "controller.integral_time": 0.2139, "controller.lead_time": 0.1158,
})  # fmt: skip
LONGEST_LEAD = 0.12079349612278774
"""Lead time at which its fold gain is 0.875, by the event map to 24 digits (scripts/peers/switch_digits.py)."""


def test_a_walk_starts_in_the_sense_asked_for_however_long_its_first_step():
    """Cycles exist up to a lead time 4 % longer; one step over that fold would come out where it is much shorter."""
    start = find_orbit(LEAD, "switch", 0.875, branch="unstable", options=Options(tol=1e-8))
    way = walk(start, vary="controller.lead_time", low=0.05, high=0.3, first_step=1.0, options=Options(tol=1e-8))
    points = [start, *itertools.islice(way, 3)]
    times = [o.servo.controller.lead_time for o in points]
    assert times[0] < times[1] < LONGEST_LEAD
    (fold,) = [
        s for pair in itertools.pairwise(points)
        for s in special_points_between(
            *pair, vary="controller.lead_time", monitors=(FOLD,), options=Options(tol=1e-9)
        )[0]
    ]  # fmt: skip
    assert fold.orbit.servo.controller.lead_time == pytest.approx(LONGEST_LEAD, rel=1e-9)
