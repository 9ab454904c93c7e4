"""What becomes of motions: those that creep to the set point, take too long to follow, or outgrow what was before."""

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from casahunt import Controller, Friction, NoOrbit, Options, Pid, Servo, Uncertainty, effort, find_orbit, remedies
from casahunt.design.remedies import border, handed_on
from casahunt.design.remedies import remedies as table
from casahunt.design.remedies import scan as scans
from casahunt.errors import Status
from casahunt.servo.outcome import SETTLES
from casahunt.servo.parts import fate, turns
from casahunt.servo.parts.plain_loop import loop_of
from casahunt.servo.parts.table import remedy_of, with_remedy
from scripts.random_servos import draw

CREEPS = Servo(
    inertia=0.0049, motor_gain=13.6, controller=Pid(kp=1.6, ki=0.018, kd=0.3),
    friction=Friction(static=0.1044, coulomb=0.0538, stribeck_velocity=0.0092, viscous=0.63),
)  # fmt: skip
"""With so little integral action that its motions creep to the set point for minutes."""
LEAVES = Servo(
    inertia=0.012550807537822064, motor_gain=74.29135425408762,
    controller=Pid(kp=0.34301477200987407, ki=2.764025593270691, kd=0.03884336965305818),
    friction=Friction(static=0.40682173821742007, coulomb=0.20254122629246887,
                      stribeck_velocity=0.16197077074535887, viscous=0.17200639101574144),
)  # fmt: skip
"""Its cycle loses its symmetry at ki = 0.1496 on the way to less integral action, and folds at 0.1315 only."""
SMALLER = Servo(
    inertia=0.011133596229981828, motor_gain=4.536596948555415,
    controller=Pid(kp=0.4734400416729371, ki=7.788943187392915, kd=0.04837530394454342),
    friction=Friction(static=1.9875933183076677, coulomb=0.9842759086163977,
                      stribeck_velocity=0.030705399424633347, viscous=0.1571553548702559),
)  # fmt: skip
"""With a filter of the error its cycle folds at 9.75 ms, and one of less than half of its amplitude goes on."""
SLIDES = Servo(
    inertia=0.15004699307686678, motor_gain=9.978438681753723,
    controller=Controller(integral_time=0.8593720011483226, lead_time=0.020629756243169598),
    friction=Friction(static=0.3438367386150341, coulomb=0.16457013654266853,
                      stribeck_velocity=0.041677547591055866, viscous=0.0422861764434727),
)  # fmt: skip
"""With a dead band on the error its cycles go on, unstable, far beyond where motions hunt."""


def swing(amplitude=1.0):
    return fate.Swing({}, amplitude, 1.0)


def test_a_motion_that_creeps_to_the_set_point_is_over_there():
    """What follows is rounding."""
    loop = loop_of(CREEPS, "switch", 0.0182)
    before = fate.Swing({}, 0.0476, 1409.0, {"x1": 0.05, "x2": 0.01, "x3": 10.0})
    for start in (0.5, 1.0, 3.0):
        for size in (0.017, 0.0185):
            with effort.counting_work(None, limit=1e9) as spent:
                seen = fate.fate(loop.replace(ki=size), loop.at_rest(-0.0476 * start), before)
            assert seen.kind in SETTLES and spent.work < 12000, (start, size)


def test_a_smaller_cycle_is_hunting_and_what_dies_out_is_not():
    """DOP853 with events finds the cycle of 0.0032756 rad and 3.0045 s that motions end in, 0.45 of that today."""
    orbit, loop = find_orbit(SMALLER, "switch", 21.904276553476613), loop_of(SMALLER, "switch", 21.904276553476613)
    filtered = with_remedy(loop, remedy_of("error filter", "switch"), 0.0107260658)
    before = fate.Swing.of(orbit)
    for start in (0.003, 0.0073):
        seen = fate.fate(filtered, filtered.at_rest(-start), before)
        assert seen.kind == "hunting" and seen.swing.amplitude == pytest.approx(0.0032756, rel=0.03)
    loop = loop_of(Servo(), "switch", 0.7)  # above the fold, at 0.647
    dies = scans.scan(loop, fate.Swing.of(find_orbit(Servo(), "switch", 0.6)))
    assert dies.kind in SETTLES


def test_turns_that_shrink_towards_a_cycle_do_not_die_out():
    signs = (-1.0) ** np.arange(120)
    assert not turns.shrinks(np.abs(np.diff(signs * (1e-4 + 0.9 ** np.arange(120)))))
    assert turns.shrinks(np.abs(np.diff(signs * 0.9 ** np.arange(120))))
    assert not turns.settles(list(signs * 0.9 ** np.arange(120)), 1, -1.0, 0.05)
    for left, many in ((0.05, 40), (1e-5, 120)):  # 0.9^40 is 0.015: beside the cycle, and not yet on it
        assert turns.settles(list(signs[:many] * (1 + 0.9 ** np.arange(many))), 1, -1.0, left)
    assert not turns.settles(list(signs[:40] * (1 + 0.9 ** np.arange(40))), 1, -1.0, 1e-5)


def test_no_pattern_that_settles_is_left_out():
    """Patterns of 1 to 4 turns, plain or mirrored, with changes that shrink and noise, of every size."""
    random, settled = np.random.default_rng(1), 0
    for _ in range(1000):
        many, n = random.integers(4, 60), random.integers(1, 5)
        mirror, r = random.choice([-1.0, 1.0]), random.random() ** random.integers(1, 4)
        places = np.resize(random.normal(size=n), many) * mirror ** (np.arange(many) // n)
        places += random.normal() * 10.0 ** random.integers(-8, 1) * r ** np.arange(many) * (-1.0) ** np.arange(many)
        places += random.normal(size=many) * 10.0 ** random.integers(-16, -3)
        every = [(k, sign) for k in range(1, min(turns.PATTERN, (many - 1) // 4) + 1) for sign in (-1.0, 1.0)]
        settle = [each for each in every if turns.settles(places.tolist(), *each, 1e-3)]
        settled += bool(settle)
        assert set(settle) <= set(turns.may_settle(places))
    assert settled > 300


@pytest.mark.slow
def test_a_fold_of_cycles_that_are_unstable_is_no_border():
    """Where the cycle loses its symmetry, at 0.14963, hunting ends, or soon after, and not at the fold."""
    (row,) = remedies(LEAVES, "switch", 0.05365340371988707, only=["integral"]).remedies
    assert row.kind == "instability" and row.size == pytest.approx(0.14963, abs=1e-5)
    assert row.fold == pytest.approx(0.13148286517, rel=1e-8) and row.ends_hunting


@pytest.mark.slow
@pytest.mark.parametrize(("number", "gain", "name", "hunts", "ended"), [
    (1, 16.31326155931602, "integral", 3.6, 3.49), (0, 3.3846633039347376, "reset", 0.91, 0.9045),
])  # fmt: skip
def test_a_multiplier_that_runs_through_its_place_next_to_a_fold_wins_nothing_back(number, gain, name, hunts, ended):
    """Thirty motions by a Dormand-Prince integrator with events, 6000 swings each: some hunt, and none hunts on.

    Next to the fold of the cycles that are unstable a multiplier passes -1 and 1 within the error of an orbit.
    """
    (row,) = remedies(Servo().replace(**draw(777, number)), "switch", gain, only=[name]).remedies
    assert row.kind == "instability" and ended < row.size < hunts and row.ends_hunting


@pytest.mark.slow
def test_a_motion_that_seems_to_come_to_a_cycle_and_grows_is_not_handed_on():
    """The same integrator hunts from 23 of 30 starts at 0.0098 s, and grows from all at 0.0105 s; it said 0.0115."""
    servo, gain = Servo().replace(**draw(101, 1)), 0.3127550844232424
    (row,) = remedies(servo, "switch", gain, only=["error filter"]).remedies
    assert row.kind == "fold" and 0.0098 < row.size < 0.0105 and not row.ends_hunting


@pytest.mark.slow
def test_cycles_that_meet_those_they_branch_off_from_are_followed_on_as_these():
    """On the way swings repeat after 4, 2, and 1 half-cycle: so says the same integrator, begun on a cycle each time.

    At 4.25, 4.155 and 4.1407 1/s; it decays from there at 4.14.
    """
    servo, gain = Servo().replace(**draw(4242, 12)), 3.668811493778329
    (row,) = remedies(servo, "switch", gain, only=["integral"]).remedies
    assert row.kind == "fold" and 4.14 < row.size < 4.1407 and row.ends_hunting


@pytest.mark.slow
def test_a_larger_cycle_to_which_few_motions_come_is_handed_on_to_a_smaller_size():
    """Of 400 motions by the same integrator 26 hunt at 0.0163 rad, with 2.9 times the amplitude, and 88 at 0.0295."""
    servo, gain = Servo().replace(**draw(4242, 9)), 1.3699738753472719
    (row,) = remedies(servo, "switch", gain, only=["error dead band"]).remedies
    assert row.recommended == pytest.approx(0.0163, rel=0.01) and row.stays[0] == "hunting" and not row.ends_hunting


@pytest.mark.slow
def test_hunting_is_handed_down_in_steps_that_become_smaller():
    """It rests up to 7.8 amplitudes beside the set point; beyond, 21 of 140 motions come to lopsided swings.

    DOP853 from 1.381 sizes: between 1.0926 and -1.3913 sizes for ever. 
    """
    servo, gain = Servo().replace(**draw(4242, 24)), 2.6451967422646887
    (row,) = remedies(servo, "switch", gain, only=["error dead band"]).remedies
    assert row.recommended == pytest.approx(0.06124, rel=0.01) and row.stays[0] == "hunting" and not row.ends_hunting


@pytest.mark.slow
def test_hunting_ends_where_it_is_seen_to_end():
    """Forty motions by another integrator hunt at 0.026 rad, and none at 0.03; its cycles go on to 0.79 rad."""
    (row,) = remedies(SLIDES, "switch", 0.5256444748083339, only=["error dead band"]).remedies
    assert row.kind == "instability" and 0.026 < row.size < 0.028 and row.keeps_it_ended


def test_no_size_with_which_the_loop_is_unstable_is_looked_at():
    """The large cycle folds at 0.009751; that of less than half of its amplitude goes on to where, by Routh's rule,

    T J s^4 + (J + b T) s^3 + (b + kd) s^2 + kp s + ki    is stable no more: large motions grow from there on.
    """
    gain, named = 21.904276553476613, SMALLER.controller.pid()
    kp, ki, kd = (gain * SMALLER.motor_gain * k for k in (named.kp, named.ki, named.kd))
    J, b = SMALLER.inertia, SMALLER.friction.viscous
    (row,) = remedies(SMALLER, "switch", gain, only=["error filter"]).remedies
    assert row.kind == "none" and "unstable" in row.why and not row.ends_hunting

    def left(T: float) -> float:
        return (J + b * T) * (b + kd) * kp - T * J * kp**2 - (J + b * T) ** 2 * ki

    up_to, limit = (float(number) for number in re.findall(r"(\d[\d.e-]*) s", row.why))
    assert left(0.999 * limit) > 0 > left(1.001 * limit) and up_to == pytest.approx(0.99 * limit, rel=1e-3)
    loop = with_remedy(loop_of(SMALLER, "switch", gain), remedy_of("error filter", "switch"), 1.3 * limit)
    assert fate.fate(loop, loop.at_rest(-5.0), fate.Swing.of(find_orbit(SMALLER, "switch", gain))).kind == "growing"


@pytest.mark.parametrize(("times", "known"), [(10.0, True), (1.001, False)])
def test_the_worst_servo_may_need_so_much_more(monkeypatch, times, known):
    """Ten times the size of the servo as given are looked at; what is beyond is told as not found."""
    monkeypatch.setattr(table, "MOST_FOR_THE_WORST", times)
    uncertain = Uncertainty({"friction.static": (0.53, 0.55)})
    (row,) = remedies(Servo(), "switch", 0.1, only=["dead band"], uncertainty=uncertain).remedies
    assert math.isfinite(row.worst_size) == known and row.ends_hunting


def test_corners_that_are_no_servo_are_left_out(monkeypatch):
    """The worst servo of a set is one with static above Coulomb friction; slopes may point to another one."""
    set_ = Uncertainty({"friction.static": (0.42, 0.53), "friction.coulomb": (0.40, 0.46)})
    loop, seen = loop_of(Servo(), "switch", 0.1), []
    asked = table._Asked(loop, "switch", swing(), True, None, (Servo(), set_), 0.1)
    found = border.Border("motions", 0.1, 0.0, None, None, {}, swing=swing())

    def looked_at(at, *more):
        seen.append((at.value("static"), at.value("coulomb")))
        return handed_on.EndOfMotions(0.2, found.swing, 0.2, "at rest")

    monkeypatch.setattr(table, "end_of_motions", looked_at)
    leak = remedy_of("leak", "switch")
    monkeypatch.setattr(table, "scale_of", lambda *given: 1.0)
    assert table._worst(asked, leak, found) == 0.2
    assert seen == [(0.42, 0.40), (0.53, 0.40), (0.53, 0.46)]
    slopes = replace(found, kind="fold", moves={"static": -1.0, "coulomb": 1.0})
    monkeypatch.setattr(table, "border", lambda *given: replace(slopes, size=0.3, moves={}))
    assert math.isnan(table._worst(asked, leak, slopes))
    assert table._worst(asked, leak, replace(slopes, moves={"static": 1.0, "coulomb": -1.0})) == 0.3


def test_what_grows_beside_what_nobody_knows_is_not_over(monkeypatch):
    """A motion that is unclear may hunt: that others grow says nothing of it, and no border lies there."""
    told = iter(["at rest", "undecided", "at rest", "growing"])
    loop = loop_of(Servo(), "switch", 0.04)
    seen = [fate.Fate(verdict, np.array([1.0, 1.0]), None) for verdict in told]
    monkeypatch.setattr(scans, "fate", lambda *more: seen.pop(0) if len(seen) > 1 else seen[0])
    monkeypatch.setattr(scans, "_gap", lambda ways: None)
    found = scans.scan(loop, fate.Swing({"x1": 1.0}, 1.0, 1.0))
    assert found.kind == "growing" and found.unclear and not found.over
    assert scans.Scan("growing").over and not scans.Scan("undecided").over


@pytest.mark.parametrize("at_the_end", [False, True])
def test_a_branch_that_comes_back_to_its_first_size_has_not_reached_the_last(monkeypatch, at_the_end):
    """As behind a fold that was passed without being located: its end is one of the range as well."""
    loop = with_remedy(loop_of(Servo(), "switch", 0.04), remedy_of("dead band", "switch"), 0.01)
    cycle = border.loop_cycle(loop, "dead_band", start=loop.at_rest(-0.05), options=Options(tol=1e-6))
    back = SimpleNamespace(special=(), orbits=[cycle, cycle], end=SimpleNamespace(kind="range", error=math.nan))
    monkeypatch.setattr(border, "follow", lambda *_, **__: back)
    last = 0.01 if at_the_end else 0.05
    asked = loop, remedy_of("dead band", "switch"), fate.Swing.of(cycle), last, Options(tol=1e-6), []
    if at_the_end:
        assert border._end_of_stable(*asked).kind == "none"
    else:
        with pytest.raises(NoOrbit):
            border._end_of_stable(*asked)


def test_a_cycle_that_could_not_be_followed_is_not_followed_again(monkeypatch):
    """From another state of the same motion, but at its own size alone."""
    remedy, tried = remedy_of("dead band", "switch"), []

    def refused(cycle, *_, **__):
        tried.append(cycle.problem.value("dead_band"))
        raise NoOrbit("it leads nowhere", Status.NOT_FOUND)

    monkeypatch.setattr(border, "follow", refused)
    lost, whys = [], []
    for size, start in ((0.01, -0.05), (0.01, -0.06), (0.02, -0.05)):
        loop = with_remedy(loop_of(Servo(), "switch", 0.04), remedy, size)
        swing = fate.Swing(loop.at_rest(start), 0.05, 10.0)
        with pytest.raises(NoOrbit) as refusal:
            border._end_of_stable(loop, remedy, swing, 0.05, Options(tol=1e-8), lost)
        whys.append(str(refusal.value))
    assert tried == [0.01, 0.02]
    assert whys == ["it leads nowhere", border.SAME_CYCLE, "it leads nowhere"]


@pytest.mark.parametrize(("again", "known"), [(math.inf, True), (0.5, False)])
def test_a_loop_that_more_of_it_makes_stable_again_has_no_last_size(monkeypatch, again, known):
    """Unstable from 0.2 on: "from there on" is said where that is so of all larger sizes."""
    loop, remedy = loop_of(Servo(), "switch", 0.04), remedy_of("error filter", "switch")
    monkeypatch.setattr(border, "grows_without_friction", lambda loop: 0.2 <= loop.value("filter_time") < again)
    limit, last = border._of_stable_loops(loop, remedy, 0.01, 1.0)
    if known:
        assert limit == pytest.approx(0.2, rel=1e-4) and last == pytest.approx(0.198, rel=1e-4)
    else:
        assert math.isnan(limit) and last == 1.0
