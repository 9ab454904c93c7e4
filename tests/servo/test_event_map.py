"""The event map as a second engine: against Taylor series, the collocation orbits, and folds of wide servos."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

import numpy as np
import pytest
from map_support import map_fold, peak

from casahunt import InputError, NoOrbit, Options, Servo, cli, find_fold
from casahunt.collocation.scheme import scheme
from casahunt.motion.march_step import Stepper
from casahunt.motion.march_watch import EventWatch
from casahunt.servo.event_map import fixed_points as module
from casahunt.servo.event_map.fixed_points import fixed_points
from casahunt.servo.event_map.half_cycle import SECTION, half_cycle
from casahunt.servo.event_map.scan import Scan, _fixed_point
from casahunt.servo.event_map.slopes import (
    MapPoint,
    cubic_is_good,
    map_at,
    nothing_between,
    one_sided,
    rounding,
)
from casahunt.servo.problem import system_of
from problems import table1
from problems.taylor import switch_half_cycle

UNSTABLE = {row["K"]: row for row in table1.REFERENCE["switch"]["unstable"]}
STABLE = {row["K"]: row for row in table1.REFERENCE["switch"]["stable"]}


@pytest.mark.parametrize(("gain", "a"), [(0.04, 0.05), (0.1, 0.0003478), (0.1, 0.01), (0.61, 0.0015), (0.02, 3.0)])
def test_map_against_taylor(gain, a):
    """P to a few roundings of the start times the slope; P' and the duration's by differences of the Taylor engine."""
    p = map_at(Servo(), gain, a)
    h = 1e-5 if gain > 0.6 else 1e-4
    exact = switch_half_cycle(Servo(), gain, a)[0]
    noise = 20 * rounding(Servo(), gain, a) * (1 + abs(p.slope) * a / abs(exact))
    assert p.position == pytest.approx(exact, rel=max(noise, 3e-12))

    def difference(step: float) -> np.ndarray:
        up, down = (np.array(switch_half_cycle(Servo(), gain, a * (1 + s))[:2]) for s in (step, -step))
        return (up - down) / (2 * a * step)

    richardson = (4 * difference(h) - difference(2 * h)) / 3
    np.testing.assert_allclose([p.slope, p.duration_slope], richardson, rtol=2e-5)
    gains = [map_at(Servo(), gain * (1 + s), a).position for s in (1e-5, -1e-5)]
    assert p.gain_slope == pytest.approx((gains[0] - gains[1]) / (2e-5 * gain), rel=1e-5)


@pytest.mark.parametrize("gain", [0.1, 0.61, *(pytest.param(gain, marks=pytest.mark.slow) for gain in (0.04, 0.4))])
def test_fixed_points_are_the_orbits(orbit, gain):
    """Amplitudes to 1e-9 on both branches, whatever the slope; mu to 1e-9, and to 1000 |mu| eps where that is more.

    That much is rounding: at mu = 1e5 the map's own slope jumps by 2e-8 between gains 1e-5 apart.
    """
    seen = fixed_points(Servo(), gain)
    assert seen.conclusive and [f.stable for f in seen.fixed] == [False, True]
    for f, branch in zip(seen.fixed, ("unstable", "stable"), strict=True):
        known = orbit("switch", gain, branch, 1e-11)
        size = max(1e-9, 1000 * abs(f.multiplier) * 2.2e-16)
        assert f.amplitude == pytest.approx(known.amplitude, rel=1e-9)
        assert f.multiplier == pytest.approx(known.half_multiplier, rel=size)
        assert f.period == pytest.approx(known.period, rel=1e-9)
    # And the published-quality digits of the table, the last of which is not certain.
    for rows, f in ((UNSTABLE, seen.fixed[0]), (STABLE, seen.fixed[1])):
        if gain in rows:
            assert f.amplitude == pytest.approx(rows[gain]["amplitude"], rel=2e-9)
            assert f.multiplier == pytest.approx(rows[gain]["mu"], rel=2e-7)


def test_error_is_measured():
    """Against other intervals and another scheme."""
    a = STABLE[0.6]["amplitude"]
    best, other = map_at(Servo(), 0.6, a), map_at(Servo(), 0.6, a, tol=1e-9, degree=7)
    assert abs(other.position / best.position - 1) < 1e-11 and abs(other.slope / best.slope - 1) < 1e-10


def test_a_rising_map_and_no_cycle_above_the_fold():
    """Above the fold gain of Table 1, 0.6473, none; just below it two, however close."""
    fold = table1.REFERENCE["switch"]["fold"]
    above = fixed_points(Servo(), fold["K"] * 1.001)
    assert above.fixed == () and above.conclusive and above.sentence().startswith("no fixed point")
    near = fixed_points(Servo(), fold["K"] * (1 - 1e-6), fold["amplitude"] * 0.9, fold["amplitude"] * 1.1)
    assert len(near.fixed) == 2 and near.fixed[0].multiplier > 1 > near.fixed[1].multiplier
    # Square root law: amplitudes a* (1 -+ O(sqrt(1e-6))).
    assert near.fixed[0].amplitude < fold["amplitude"] < near.fixed[1].amplitude


def on(y: np.polynomial.Polynomial, t: float, off: float = 0.0) -> MapPoint:
    """The map P(a)/a - 1 = y(log2 a), at a = 2^t."""
    a, rate = 2.0**t, y.deriv()(t) / math.log(2)
    return MapPoint(a, a * (1 + y(t) + off), 1 + y(t) + rate, 0.0, 1.0, 0.0, a, 1)


@pytest.mark.parametrize(
    ("y", "off", "nothing"),
    [
        ([-0.5], 0.0, True), ([-0.5, 0.3, 0.1, -0.2], 0.0, True), ([0.2, 0.1], 0.0, True),
        ([-0.5], 0.12, True), ([-0.5], 0.15, False),  # a hundredth, and a quarter of the distance from zero
        ([-0.5, 1.0], 0.0, False), ([-0.5, 2.0, -1.7], 0.0, False),  # zero beyond the middle; zero twice
        ([-0.5], 0.6, False), ([-0.5], math.nan, False),
        ([-1e-4], 0.0, True), ([-1e-4, 5e-5], 0.0, True), ([-9e-6, 6e-5, -1e-4], 0.0, False),  # -1e-4 (t - 0.3)^2
    ],
)  # fmt: skip
def test_that_there_is_nothing_between_two_motions(y, off, nothing):
    """Cubics along log a are the map itself: but for what the motion half-way is off, of which nobody knows."""
    y = np.polynomial.Polynomial(y)
    assert nothing_between(on(y, 0.0), on(y, 0.5, off), on(y, 1.0)) is nothing
    assert not nothing_between(on(y, 0.0), on(y, 0.5, -2 * y(0.5)), on(y, 1.0))  # the sign changes, and back


def test_one_side_is_kept_with_room_to_spare():
    for y, one in (
        ([-1e-4], True), ([-1e-4, 1e-5], True), ([-9e-6, 6e-5, -1e-4], False), ([-1e-4, 1.9e-4], False),
        ([-1e-4, 9.4e-5], True), ([-1e-4, 9.7e-5], False),
    ):  # fmt: skip
        y = np.polynomial.Polynomial(y)
        assert one_sided(*(on(y, t) for t in (0.0, 0.5, 1.0))) is one


@pytest.mark.parametrize(("slope", "good"), [(0.1, False), (400.0, False), (600.0, True), (-600.0, True)])
def test_a_step_that_slopes_do_not_explain_is_a_jump(slope, good):
    """P rises by 1 over 1e-3: a slope of 1000 explains all of it."""
    left, right = (MapPoint(a, P, slope, 0.0, 1.0, 0.0, a, 1) for a, P in ((1.0, 0.2), (1.001, 1.2)))
    assert cubic_is_good(left, right) is good


@pytest.mark.parametrize(
    ("excess", "slope", "width", "steep"),
    [
        (1e-9, 2.0, 1e-14, False), (1e-9, 1e8, 1e-14, True), (1e-9, -1e8, 1e-14, True), (1e-3, 1e8, 1e-14, False),
        (1e-9, 2.0, 1e-8, True), (1e-15, 1.0, 0.0, True), (1e-13, 1.0, 0.0, False),
    ],
)  # fmt: skip
def test_what_is_left_at_a_fixed_point_is_rounding_times_the_slope(excess, slope, width, steep):
    """Of a = 1 rad, which is known to 2e-16: 8 times that, and the bracket's width, are allowed for."""
    best = MapPoint(1.0, 1.0 + excess, slope, 0.0, 1.0, 0.0, 1.0, 1)
    state = module._Scan(Servo(), 0.3)
    assert rounding(state.servo, state.gain, 1.0) == np.finfo(float).eps
    assert module._steep_not_jump(state, best, width) is steep


@pytest.mark.parametrize(("failed", "conclusive"), [(0, True), (20, True), (21, False), (100, False)])
def test_a_scan_of_which_too_much_failed_shows_nothing(failed, conclusive):
    assert Scan(1e-4, 1.0, 0.5, 0.1, None, (0.1,) * failed, 100).conclusive is conclusive


def test_jumps_are_not_fixed_points():
    """Table 1 at K = 0.1: P leaps from 1e-3 to 2e-2 rad next to a = 3.487e-4, far above P = a on both sides."""
    seen = fixed_points(Servo(), 0.1, 3.4e-4, 3.6e-4, points=9)
    assert len(seen.fixed) == 1 and len(seen.jumps) == 1
    jump = seen.jumps[0]
    assert not jump.crosses and jump.below < 3e-3 < 0.02 < jump.above
    low, high = (switch_half_cycle(Servo(), 0.1, jump.start * (1 + s))[0] for s in (-1e-6, 1e-6))
    assert low < 3e-3 < 0.02 < high


def test_a_wall_across_the_diagonal_is_no_fixed_point_of_the_scan():
    """Fs = 0.9: P leaps from below a to 25 a between two doubles, and the scan's bracket ends in mid-air, at 1.3 a."""
    servo = Servo().replace(**{"friction.static": 0.9})
    jump = 4.15186e-4
    low, high = (switch_half_cycle(servo, 1.0, jump * (1 + s))[0] for s in (-2e-6, 2e-6))
    assert low < jump and high > 20 * jump
    below, above = (half_cycle("switch", servo, 1.0, jump * s) for s in (0.95, 1.05))
    assert _fixed_point(lambda a: half_cycle("switch", servo, 1.0, a), above, below) is None


def test_a_map_of_jumps_without_end_is_given_up(monkeypatch):
    """Motions of an unstable loop swing dozens of times before they stick: slips are what costs, not motions.

    Patched: with as many slips as it may take, it takes a minute.
    """
    servo = Servo().replace(
        **{
            "servo.inertia": 0.16838869820931657, "servo.motor_gain": 28.31674240323281,
            "controller.lead_time": 0.02338545420603901, "controller.integral_time": 0.04264053025708951,
            "friction.static": 0.13830258634315928, "friction.coulomb": 0.07339314036116219,
            "friction.stribeck_velocity": 0.021644533942020733, "friction.viscous": 0.15333309269969053,
        }
    )  # fmt: skip
    monkeypatch.setattr(module, "MOST_SLIPS_IN_ALL", 60)
    unit = servo.friction.static / servo.torque_gains(2.155)[0]
    seen = fixed_points(servo, 2.155, unit, 20 * unit, points=5)
    assert seen.unresolved and not seen.conclusive and len(seen.points) < 30


@pytest.mark.slow
def test_fold_of_the_map_is_the_fold():
    """Independent of the collocation equations; the tolerance of the collocation fold is 1e-9."""
    found = map_fold(Servo())
    assert found.gain == pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-11)
    assert found.gain == pytest.approx(find_fold(Servo(), "switch", options=Options(tol=1e-9)).gain, rel=1e-9)
    assert found.multiplier == pytest.approx(1, abs=1e-5) and abs(found.excess) < 1e-11


def peaked(peak: float, sticks_up_to: float, crosses_from: float = 0.0):
    """A map P/a = exp(-log(a/peak)^2); beyond `sticks_up_to` it swings on, short of `crosses_from` it rests."""

    def at(servo, gain, a):
        if a > sticks_up_to:
            return MapPoint(a, np.nan, np.nan, np.nan, 1.0, np.nan, a, 40)
        if a < crosses_from:
            return MapPoint(a, 0.0, 0.0, 0.0, np.inf, 0.0, a, 1)
        y = np.log(a / peak)
        ratio = float(np.exp(-y * y))
        return MapPoint(a, a * ratio, ratio * (1 - 2 * y), -1.0, 1.0, 0.0, a, 1)

    return at


@pytest.mark.parametrize(("sticks_up_to", "crosses_from"), [(9.0, 0.0), (0.0131, 0.0), (9.0, 0.0113), (0.0131, 0.0113)])
def test_a_peak_between_motions_that_never_stick_and_that_rest(sticks_up_to, crosses_from):
    """Of both only the side is known that they are on: the bracket is halved until it has slopes at both ends."""
    at = peaked(0.0123, sticks_up_to, crosses_from)
    for low, high in ((0.01, 0.02), (0.002, 0.003), (0.03, 0.05)):
        top = peak(Servo(), 0.1, low, high, at)
        assert top.start == pytest.approx(0.0123, rel=1e-6) and top.excess == pytest.approx(0, abs=1e-11)


def test_a_map_that_rises_for_ever_has_no_peak():
    with pytest.raises(NoOrbit, match="no smooth maximum"):
        peak(Servo(), 0.1, 0.01, 0.02, peaked(1e30, 1e31))


def test_bad_input():
    for arguments in ((0.1, -1.0), (0.1, 1.0, 0.5), (-1.0,), (float("nan"),)):
        with pytest.raises(InputError):
            fixed_points(Servo(), *arguments)
    with pytest.raises(InputError):
        fixed_points(Servo(), 0.1, points=1)
    with pytest.raises(NoOrbit):
        map_fold(Servo().replace(**{"friction.static": 0.44}))


def test_command(capsys, tmp_path):
    picture = tmp_path / "map.png"
    words = ["map", "--gain", "0.6", "--from", "1e-3", "--to", "3e-3", "--points", "9"]
    assert cli.main([*words, "--json", "--plot", str(picture)]) == 0
    out = capsys.readouterr().out
    record = json.loads(out)
    assert out.count("\n") == 1 and picture.stat().st_size > 10_000 and record["conclusive"]
    assert [f["stable"] for f in record["fixed_points"]] == [False, True]
    assert cli.main([*words, "--details"]) == 0 and "half multiplier P' = " in capsys.readouterr().out
    for wrong in ([], ["--gain", "0"], [*words[1:5], "--to", "1e-4"], [*words[1:3], "--points", "x"]):
        assert cli.main(["map", *wrong]) == 2


WIDE = (
    {"friction.static": 0.7},
    {"servo.inertia": 0.005},
    {"controller.lead_time": 1.0},
    {"friction.stribeck_velocity": 0.005},
)


@pytest.mark.slow
@pytest.mark.parametrize("changes", WIDE, ids=str)
def test_folds_of_wide_servos_by_taylor(changes):
    """2e-4 below the fold gain some motion grows, 1e-5 above it none does, by series with no collocation in them."""
    # P climbs to its peak within 1e-4 to 1e-12 of a, at a place that moves with the gain: first the foot of that wall
    # is found by bisection, then positions are tried at log-spaced distances beyond it, and around the fold's own.
    servo = Servo().replace(**changes)
    fold = find_fold(servo, "switch", options=Options(tol=1e-9))
    delta = np.geomspace(1e-10, 1e-2, 12)
    around = fold.orbit.amplitude * (1 + np.concatenate([-delta[::-1], [0.0], delta]))

    def excess(gain: float, a: float) -> float:
        return switch_half_cycle(servo, gain, a)[0] / a - 1

    def excesses(gain: float) -> Iterator[float]:
        below, above = fold.orbit.amplitude * 0.98, fold.orbit.amplitude * 1.01
        assert excess(gain, below) < -0.5 < excess(gain, above)
        for _ in range(50):
            middle = (below + above) / 2
            yield (tried := excess(gain, middle))
            below, above = (middle, above) if tried < -0.5 else (below, middle)
        near = above * (1 + np.geomspace(1e-16, 1e-2, 50))
        yield from (excess(gain, float(a)) for a in (*around, *near))

    # Below the fold the peak is so steep that doubles may step over its last 1e-4; above it none may be there at all.
    assert any(e > 0 for e in excesses(fold.gain * (1 - 2e-4))), "no motion grows just below the fold gain"
    assert max(excesses(fold.gain * (1 + 1e-5))) < 0, "a motion grows just above the fold gain"


def test_weak_reversals_are_met_at_a_coarse_tolerance():
    """A phase begins with no longer an interval than the one before ended with: no last ring is stepped over."""
    servo = table1.servo()
    a = half_cycle("switch", servo, 0.1, 0.1 * servo.friction.static / servo.torque_gains(0.1)[0]).position
    coarse, fine = (half_cycle("lugre", servo, 0.1, a, tol=tol).segments for tol in (1e-4, 1e-8))
    assert [s.mode for s in coarse] == [s.mode for s in fine]


def test_what_a_watched_interval_hides_of_a_servo():
    """The drop of friction, looked at with the exits: as by the feature itself."""
    p, scale = table1.servo().parameters(0.1), np.array([0.01, 1.0, 0.05, 2e-5])
    system = system_of("lugre", p.size).vector_form
    mode = system.modes["slide+"]
    watch = EventWatch(
        system.exits["slide+"], mode.feature, Stepper(mode.field, scheme(7, "radau"), p, scale, mode.sign)
    )
    start, end = np.array([-1.0, 0.0, 0.0, 0.0]), np.array([-0.9, 0.5, 0.0, 0.0])
    for fastest, hidden in ((0.01, False), (0.5, True)):
        stages = start + np.linspace(0.1, 1, 7)[:, None] * np.array([0.1, fastest, 0.0, 0.0])
        end[1] = fastest
        found = watch.crossings(start, stages.ravel(), end, None)[1]
        assert found == watch.hides(start, stages.ravel(), end) == hidden


def test_where_a_servo_with_a_bristle_breaks_away():
    """Radau's method (scipy), to where the torque has come back to nearly static friction."""
    integrate = pytest.importorskip("scipy.integrate")
    servo, gain, a = Servo(), 0.6, 2e-3
    f, (kp, kd, ki) = servo.friction, servo.torque_gains(gain)

    def motion(t, x):
        position, v, integral, z = x
        g = f.coulomb + (f.static - f.coulomb) * math.exp(-((v / f.stribeck_velocity) ** 2))
        rate = v - f.stiffness * abs(v) / g * z
        force = -(kp * position + kd * v + ki * integral) - f.stiffness * z - f.damping * rate - f.viscous * v
        return [v, force / servo.inertia, position, rate]

    def breaks_away(t, x):
        return side * (kp * x[0] + kd * x[1] + ki * x[2]) - SECTION * f.static

    found = half_cycle("lugre", servo, gain, a, tol=1e-9)
    first = found.segments[0]  # from where the position passes zero
    side, start = math.copysign(1.0, first.end[0]), first.w[0, :4]
    breaks_away.terminal, breaks_away.direction = True, 1.0
    events = {"events": breaks_away, "rtol": 1e-9, "atol": 1e-13, "method": "Radau"}
    end = integrate.solve_ivp(motion, (0.0, 60.0), start, **events)
    assert abs(end.y_events[0][0][0]) == pytest.approx(abs(found.position), rel=2e-3)  # linear between two nodes
