"""Cycles found and cycles denied: what is said to be absent is absent, by the Taylor engine and the reference folds."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from casahunt import Friction, NoOrbit, Options, Pid, Servo, Status, cli, find_fold, find_orbit
from casahunt.collocation.node_system import Linearisation
from casahunt.continuation.walk import walk
from casahunt.servo import find_fold as folds
from casahunt.servo import find_orbit as searching
from casahunt.servo.basin import basin
from casahunt.servo.event_map.half_cycle import StickMap
from casahunt.servo.event_map.scan import scan
from casahunt.servo.parts.fate import Swing, fate
from casahunt.servo.parts.plain_loop import loop_of
from casahunt.servo.problem import HuntingFold, HuntingOrbit
from problems import table1
from problems.taylor import switch_cycle, switch_half_cycle
from scripts.random_servos import draw

FOLD = {model: table1.REFERENCE[model]["fold"]["K"] for model in ("switch", "lugre")}

# The linear loop is unstable below K = 3.62, so that far-out motions grow while the servo hunts near its set point.
UNSTABLE_LOOP = Servo().replace(
    **{
        "servo.inertia": 0.16838869820931657, "servo.motor_gain": 28.31674240323281,
        "controller.lead_time": 0.02338545420603901, "controller.integral_time": 0.04264053025708951,
        "friction.static": 0.13830258634315928, "friction.coulomb": 0.07339314036116219,
        "friction.stribeck_velocity": 0.021644533942020733, "friction.viscous": 0.15333309269969053,
    }
)  # fmt: skip
UNSTABLE_LOOP_FOLD = 2.159105684
# A servo whose cycles lose their stick at a seventh of the fold gain, and turn back a little below.
NO_STICK = Servo().replace(
    **{
        "servo.inertia": 0.057, "servo.motor_gain": 1.1527522792327205, "controller.lead_time": 0.0243,
        "controller.integral_time": 0.03, "friction.static": 0.8426, "friction.coulomb": 0.3716,
        "friction.stribeck_velocity": 0.0456, "friction.viscous": 0.0,
    }
)  # fmt: skip

# Its unstable cycle shrinks to nothing at 0.39 of the fold gain.
SHRINKS = {
    "friction.static": 0.1588296818474372, "friction.coulomb": 0.13561382507632053,
    "friction.stribeck_velocity": 0.012726346468370777, "friction.viscous": 0.07412945993595328,
    "servo.inertia": 0.23799254814912715, "servo.motor_gain": 1.3406387108387103,
    "controller.integral_time": 0.14657697396715216, "controller.lead_time": 0.05375729241015507,
}  # fmt: skip


def slope(servo: Servo, gain: float, a: float, step: float = 1e-4) -> float:
    """P'(a) by central differences of the Taylor engine."""
    above, below = (switch_half_cycle(servo, gain, a * (1 + s))[0] for s in (step, -step))
    return (above - below) / (2 * step * a)


@pytest.mark.parametrize("part", [0.995, pytest.param(0.9999, marks=pytest.mark.slow)])
def test_both_cycles_below_a_fold_where_far_motions_grow(part):
    gain = part * UNSTABLE_LOOP_FOLD
    stable, unstable = (find_orbit(UNSTABLE_LOOP, "switch", gain, branch=b) for b in ("stable", "unstable"))
    assert unstable.amplitude < stable.amplitude
    for found in (stable, unstable):
        amplitude, period = switch_cycle(UNSTABLE_LOOP, gain, found.amplitude)
        assert found.amplitude == pytest.approx(amplitude, rel=1e-5)  # the default tolerance, 1e-6, and a margin
        assert found.period == pytest.approx(period, rel=1e-5)
        assert found.half_multiplier == pytest.approx(slope(UNSTABLE_LOOP, gain, amplitude), rel=1e-4)
    assert unstable.half_multiplier > 1 > stable.half_multiplier


def test_the_scan_climbs_the_inner_peak():
    """The highest ratio is that of a motion thrown out; the pair of fixed points is below a lower peak."""
    P = StickMap("switch", UNSTABLE_LOOP, 0.9999 * UNSTABLE_LOOP_FOLD)
    seen = scan(P)
    assert seen.best > 3 and seen.upper is not None
    assert P(0.9 * seen.upper.start).ratio < 1 < P(0.9999 * seen.upper.start).ratio


@pytest.mark.slow
def test_the_unstable_cycle_without_a_stable_one():
    """At half the fold gain no stable cycle bounds the motions; the border of coming to rest is there all the same."""
    gain = 0.5 * UNSTABLE_LOOP_FOLD
    found = basin(UNSTABLE_LOOP, "switch", gain)
    amplitude, _ = switch_cycle(UNSTABLE_LOOP, gain, found.border)
    assert found.border == pytest.approx(amplitude, rel=1e-5)
    assert found.confirmed and found.outside.outcome == "growing" and math.isnan(found.outer_position)
    with pytest.raises(NoOrbit) as refused:
        find_orbit(UNSTABLE_LOOP, "switch", gain)
    assert refused.value.status is None  # shown by a second fold, above the gain
    second = re.search(r"turn back at ([0-9.]+), in a second fold", str(refused.value))
    assert gain < float(second[1]) < UNSTABLE_LOOP_FOLD


LUGRE_TWICE = pytest.param("lugre", 0.63, "unstable", marks=pytest.mark.slow)  # the same fold once more


@pytest.mark.parametrize(
    ("model", "gain", "branch"),
    [*(("switch", gain, branch) for gain in (0.9, 0.65) for branch in ("stable", "unstable"))]
    + [pytest.param("lugre", 0.63, "stable", marks=pytest.mark.slow), LUGRE_TWICE],
)
def test_a_denial_names_the_located_fold(model, gain, branch):
    """Whatever gain is asked for, the fold named is the one of the reference, to five units of its last digit."""
    with pytest.raises(NoOrbit, match="no hunting limit cycle .*its cycles end at gain") as refused:
        find_orbit(Servo(), model, gain, branch=branch)
    assert refused.value.status is None
    named = re.search(r"end at gain ([0-9.]+), in a fold", str(refused.value)).group(1)
    assert float(named) == pytest.approx(FOLD[model], abs=5.5 * 10.0 ** -(len(named) - 2)) and len(named) >= 7


def test_a_denial_does_not_contradict_itself():
    """A fold at 0.64738, which in four digits is above the gain that is asked for."""
    servo = Servo().replace(**{"servo.motor_gain": 16 * FOLD["switch"] / 0.64738})
    with pytest.raises(NoOrbit, match="can hunt up to gain 0.64738 V/rad, and not above") as refused:
        find_orbit(servo, "switch", 0.647385)
    assert refused.value.status is None


@pytest.mark.slow
@pytest.mark.parametrize("distance", [1e-5, 1e-8])
def test_a_hair_on_either_side_of_the_fold(distance):
    fold = FOLD["switch"]
    for branch in ("stable", "unstable"):
        found = find_orbit(Servo(), "switch", fold * (1 - distance), branch=branch)
        amplitude, _ = switch_cycle(Servo(), found.gain, found.amplitude)
        assert found.amplitude == pytest.approx(amplitude, rel=1e-6)
        with pytest.raises(NoOrbit, match="its cycles end at gain") as refused:
            find_orbit(Servo(), "switch", fold * (1 + distance), branch=branch)
        assert refused.value.status is None


@pytest.mark.slow
def test_cycles_without_stick_down_to_a_second_fold():
    """Further down the servo is reversed without sticking; then the cycles turn back, and below every motion grows."""
    fold = find_fold(NO_STICK, "switch")
    with pytest.raises(NoOrbit, match="turn back at .*, in a second fold") as refused:
        find_orbit(NO_STICK, "switch", 0.05 * fold.gain)
    assert refused.value.status is None
    lower = float(re.search(r"turn back at ([0-9.]+)", str(refused.value)).group(1))
    assert 0.05 * fold.gain < lower < fold.gain
    gain = 1.01 * lower
    found = find_orbit(NO_STICK, "switch", gain)
    assert [mode for mode, _ in found.signature] == ["slip+"]
    swings, _, slips = switch_half_cycle(NO_STICK, gain, found.amplitude, most_slips=80)
    assert swings == pytest.approx(found.amplitude, rel=1e-4) and 2 * slips[-1] == pytest.approx(found.period, rel=1e-4)
    swings, _, slips = switch_half_cycle(NO_STICK, 0.8 * lower, found.amplitude, thrown_out=3 * found.amplitude)
    assert swings > 3 * found.amplitude


@pytest.mark.slow
def test_a_symmetric_cycle_past_its_symmetry_breaking_is_not_called_stable(capsys):
    """Half multiplier -1.035 by both engines; the motion from outside is no proof of a border."""
    changes = {
        "servo.inertia": 0.0126425, "servo.motor_gain": 29.109, "controller.lead_time": 0.252257,
        "controller.integral_time": 0.242681, "friction.static": 0.70947, "friction.coulomb": 0.421059,
        "friction.stribeck_velocity": 0.0102243, "friction.viscous": 0.510541,
    }  # fmt: skip
    servo = Servo().replace(**changes)
    found = basin(servo, "switch", 1.1773, options=Options(tol=1e-8))
    amplitude, _ = switch_cycle(servo, 1.1773, found.outer.amplitude)
    assert found.outer.half_multiplier == pytest.approx(slope(servo, 1.1773, amplitude), rel=1e-3)
    assert not found.outer.stable and not found.outside.hunts
    # A start 1 % beside it is "arrived" at a stable cycle after one swing; in truth it leaves, and comes to rest.
    a = 1.01 * amplitude
    assert fate(found.loop, {"x1": -a}, Swing.of(found.outer)).kind == "at rest"
    swings = 0
    while a > 0.5 * found.border and swings < 100:
        a, swings = abs(switch_half_cycle(servo, 1.1773, a)[0]), swings + 1
    assert a < 0.5 * found.border
    words = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    assert cli.main(["basin", "--gain", "1.1773", "--details", *words]) == 1
    out, _, _ = capsys.readouterr().out.partition("what the words mean")
    plain = " ".join(out.split()).replace("unstable cycle", "")
    assert "stable cycle amplitude" not in plain and "not stable (half multiplier -1.03" in plain


def test_cycles_that_cannot_be_computed_are_not_denied(monkeypatch):
    """The map shows cycles and no solver arrives: that is no evidence that there is none.

    Patched: no servo is known of which no solver finds any cycle that its map shows.
    """
    from casahunt.servo import find_fold as fold

    def stuck(*arguments, **options):
        raise NoOrbit("stuck", Status.NOT_CONVERGED)

    monkeypatch.setattr(fold, "quickly_at", lambda *_, **__: None)
    monkeypatch.setattr(fold, "stable_at", stuck)
    with pytest.raises(NoOrbit, match="was computed, though the event map .*8 of them were tried") as refused:
        find_fold(Servo(), "switch")
    assert refused.value.status is Status.NOT_CONVERGED


def test_the_solver_may_slip_to_the_other_side_of_the_fold():
    """From a motion on the stable side the solver arrives at the unstable cycle: its multiplier, 2.06, tells."""
    servo = Servo().replace(
        **{
            "friction.static": 3.1179566968299746, "friction.coulomb": 2.6869745139311845,
            "friction.stribeck_velocity": 0.1765778356790582, "friction.viscous": 0.836277343761565,
            "servo.inertia": 0.02632471655649212, "servo.motor_gain": 26.788301389159834,
            "controller.integral_time": 0.1996925326256266, "controller.lead_time": 0.04363973395698024,
        }
    )  # fmt: skip
    gain = 0.2671081771664363
    stable = find_orbit(servo, "switch", gain, options=Options(tol=1e-8))
    amplitude, _ = switch_cycle(servo, gain, stable.amplitude)
    assert stable.amplitude == pytest.approx(amplitude, rel=1e-8)
    assert stable.amplitude > 0.016 and slope(servo, gain, amplitude) < 1


@pytest.mark.slow
def test_a_motion_that_passes_by_an_unstable_outer_cycle_has_not_arrived():
    """Half multiplier -1.54: the outer motion comes within a fifth of the way to that cycle, and then settles."""
    servo = Servo().replace(
        **{
            "friction.static": 0.7898283490454006, "friction.coulomb": 0.6925435909533575,
            "friction.stribeck_velocity": 0.007132342413441757, "friction.viscous": 0.2325828766753118,
            "servo.inertia": 0.03286797748425303, "servo.motor_gain": 16.771749942744105,
            "controller.integral_time": 0.11223659932189527, "controller.lead_time": 0.10322362759393604,
        }
    )  # fmt: skip
    gain = 2.865505663083899
    found = basin(servo, "switch", gain, options=Options(tol=1e-8), offset=1e-4)
    a, nearest = found.outside.start, math.inf
    for _ in range(100):
        a = abs(switch_half_cycle(servo, gain, a)[0])
        nearest = min(nearest, abs(a - found.outer_position))
        if a < 0.5 * found.border:
            break
    assert a < 0.5 * found.border and nearest < 0.2 * (found.outer_position - found.border)
    assert found.outside.settles and not found.confirmed


@pytest.mark.slow
def test_an_unstable_cycle_that_shrinks_to_nothing_is_not_said_to_turn_back():
    """Rounding makes its gain go up and down there; small motions grow below that gain, and not above."""
    servo = Servo().replace(**SHRINKS)
    with pytest.raises(NoOrbit, match="shrinks to nothing") as refused:
        find_orbit(servo, "switch", 0.49452051160029964, branch="unstable")
    assert refused.value.status is Status.NOT_FOUND
    last = float(re.search(r"to gain ([0-9.]+) only", str(refused.value)).group(1))
    for factor, size, grows in ((0.99, 1e-6, True), (0.99, 1e-4, True), (1.01, 1e-6, False)):
        a = size * servo.friction.static / servo.torque_gains(factor * last)[0]
        assert (switch_half_cycle(servo, factor * last, a)[0] > a) == grows


@pytest.mark.slow
def test_both_sides_of_a_fold_that_no_double_can_resolve():
    """Multipliers beyond 1e80 on either side: at the fold neither gain nor first node moves, the slip's time does.

    Two searches of the same cycle must agree: down from the fold, and with another collocation scheme.
    """
    changes = {
        "friction.static": 1.072462225211622, "friction.coulomb": 0.46424170103874596,
        "friction.stribeck_velocity": 0.0023117302470143874, "friction.viscous": 0.15222331252618806,
        "servo.inertia": 0.07265576304858756, "servo.motor_gain": 1.6807302961590147,
        "controller.integral_time": 0.2193324775293366, "controller.lead_time": 0.8021964829567066,
    }  # fmt: skip
    servo = Servo().replace(**changes)
    gain = 0.999 * find_fold(servo, "switch", options=Options(tol=1e-8)).gain
    for branch, sign in (("stable", -1), ("unstable", 1)):
        found, other = (
            find_orbit(servo, "switch", gain, branch=branch, options=Options(tol=1e-8, degree=degree))
            for degree in (8, 6)
        )
        assert sign * found.half_multiplier > 1e80
        assert found.amplitude == pytest.approx(other.amplitude, rel=2e-8)
        assert found.period == pytest.approx(other.period, rel=2e-8)


def test_the_side_of_a_fold_is_told_by_the_multipliers(monkeypatch, orbit):
    """Of a random LuGre servo with the half multiplier -8.2e5 a glance gave +8.5e5, on one processor: patched."""
    fold = find_fold(Servo(), "switch")
    monkeypatch.setattr(Linearisation, "return_map_eigenvalues", lambda *_: np.array([8.5e5, 0.0]))
    found = searching._down_from(fold, 0.6, "stable", Options())
    monkeypatch.undo()
    assert found.amplitude == pytest.approx(orbit("switch", 0.6).amplitude, rel=1e-5)


SECOND_FOLD = Servo().replace(**draw(11, 0))
"""Its stable cycles end in a second fold, at a twentieth of the gain of the first."""


def test_a_second_fold_on_either_side_of_the_smallest_gain_met(monkeypatch):
    """A step may lead past the fold and yet lower: the gain rises only with the next one, and the fold lies before."""
    fold = find_fold(SECOND_FOLD, "switch")
    gain = 0.05 * fold.gain
    with pytest.raises(NoOrbit, match="turn back at .* in a second fold") as refused:
        searching._down_from(fold, gain, "stable", Options())
    kp, kd, ki = SECOND_FOLD.torque_gains(gain)
    poles = np.roots([SECOND_FOLD.inertia, SECOND_FOLD.friction.viscous + kd, kp, ki])  # without dry friction
    assert poles.real.max() > 0 and "the loop is unstable: large motions grow" in refused.value.plain
    met: list = []
    monkeypatch.setattr(searching, "deny_below", lambda around, *_: met.extend(around))
    searching._followed_down(fold, gain, "stable", Options())
    monkeypatch.undo()
    near, past = next(pair for pair in pairwise(met) if pair[0].half_multiplier < 1 < pair[1].half_multiplier)
    farther = next(walk(past, low=gain, high=fold.gain, options=Options(), first_step=0.01, largest_step=0.01))
    assert farther.gain > past.gain and farther.half_multiplier > 1
    with pytest.raises(NoOrbit, match="turn back at .* in a second fold") as refused:
        folds.deny_below([near, past, farther], fold, gain, "stable", Options())
    assert refused.value.status is None
    # What is not known between two of them takes nothing from a fold between the others.
    lowest = folds.confirmed_between(near, past, Options(), sense=-1.0)
    assert lowest is not None

    def known_before(before: HuntingOrbit, *_: Any, **__: Any) -> HuntingFold:
        if before is past:
            raise NoOrbit("not converged", Status.NOT_CONVERGED)
        return lowest

    monkeypatch.setattr(folds, "confirmed_between", known_before)
    with pytest.raises(NoOrbit, match="turn back at .* in a second fold"):
        folds.deny_below([near, past, farther], fold, gain, "stable", Options())
    # Where a cycle was found at a smaller gain, that fold is not the end of them.
    monkeypatch.setattr(folds, "confirmed_between", lambda *_, **__: lowest)
    folds.deny_below([near, past, SimpleNamespace(gain=0.99 * lowest.gain)], fold, gain, "stable", Options())


@pytest.mark.slow
def test_the_unstable_cycle_of_a_bristle_written_in_parts():
    """The one of the servo that the loop is: no motion from a single state of it comes back before it has left."""
    friction = Friction(static=32.7, coulomb=19.5, stribeck_velocity=4.38e-3, viscous=4.6,
                        stiffness=1.8e5, damping=123.0)  # fmt: skip
    servo = Servo(inertia=0.936, motor_gain=1.0, controller=Pid(kp=921.0, ki=11800.0, kd=43.6), friction=friction)
    one = find_orbit(servo, "lugre", 1.0, branch="unstable")
    other = find_orbit(loop_of(servo, "lugre", 1.0), branch="unstable")
    assert [other.amplitude, other.period] == pytest.approx([one.amplitude, one.period], rel=1e-6) and not other.stable
