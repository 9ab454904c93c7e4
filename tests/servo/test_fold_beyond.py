"""casahunt fold, where hunting ends elsewhere: another cycle goes on, or the one that folds is unstable before."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from servo_files import linear_axis

from casahunt import NoOrbit, Servo, find_fold, find_orbit, simulate
from casahunt.cli import main
from casahunt.continuation.terminations import End
from casahunt.servo.parts import (
    BY_DIRECTION,
    INERTIA,
    INTEGRATOR,
    PID_BY_GAINS,
    PID_BY_TIMES,
    SWITCH,
    TWO_MASSES,
    Loop,
    load_loop,
    loop_of,
    verbs,
)  # fmt: skip
from casahunt.servo.parts.verbs import fold_in, loop_cycle
from casahunt.servo.stable_up_to import ranges_between, stable_ranges

AXIS = """
[loop]
parts = ["two masses, load measured", "Switch friction", "cascade P-PI", "integrator"]
[values]
inertia = 4.0
load_inertia = 15.0
shaft_stiffness = 1.5e6
shaft_damping = 1200.0
position_gain = 15.0
velocity_gain = 800.0
reset_time = 0.03
motor_gain = 1.0
gain = 1.0
static = 50.0
coulomb = 30.0
stribeck_velocity = 3e-3
viscous = 200.0
"""


def axis(K):
    """The torque on the motor, and its motion with friction one way, the other, or (0) stuck."""
    gains = 800 * K * np.array([15 + 1 / 0.03, 1, 15 / 0.03])

    def shaft(x):
        return 1.5e6 * (x[0] - x[2]) + 1200 * (x[1] - x[3])

    def pull(x):
        return -gains @ [x[2], x[3], x[4]] - shaft(x)

    def rate(way):
        def field(_, x):
            friction = way * (30 + 20 * np.exp(-((x[1] / 3e-3) ** 2))) + 200 * x[1]
            return [abs(way) * x[1], abs(way) * (pull(x) - friction) / 4, x[3], shaft(x) / 15, x[2]]

        return field

    return pull, rate


def event(scalar, direction):
    """One that ends the integration."""
    scalar.terminal, scalar.direction = True, direction
    return scalar


def stops(K, off, T):
    """(m, 2) times and motor positions at which the motor stops, let go at rest beside the set point."""
    pull, rate = axis(K)
    t, x, way, found = 0.0, np.array([off, 0, off, 0, 0.0]), 0, []
    while t < T:
        if way:
            ends = [event(lambda _, x: x[1], -way)]
        else:
            ends = [event(lambda _, x, s=s: s * pull(x) - 50, 1) for s in (1, -1)]
        first = {"first_step": 1e-7} if way else {}
        done = solve_ivp(rate(way), (t, T), x, method="LSODA", rtol=1e-9, atol=1e-13, events=ends, **first)
        t, x = done.t[-1], done.y[:, -1].copy()
        if done.status != 1:
            break
        if way:
            found.append((t, x[0]))
            x[1], way = 0, 0 if abs(pull(x)) <= 50 else int(np.sign(pull(x)))
        else:
            way = 1 if done.t_events[0].size else -1
    return np.array(found)


def test_other_hunting_goes_on_beyond_the_fold(tmp_path):
    """One slip a half turn up to gain 2.181; three beyond, as the motion itself does, whose fold is the answer."""
    file = tmp_path / "axis.toml"
    file.write_text(AXIS)
    loop = load_loop(file)
    first = fold_in(loop_cycle(loop), "gain")
    other = verbs.hunting_beyond(loop, first)
    assert other.problem.value("gain") == pytest.approx(1.01 * first.value, rel=1e-9) and 2.18 < first.value < 2.19
    seen = stops(1.01 * first.value, 8e-5, 16.0)
    assert seen[-1, 0] > 12 and np.abs(seen[-12:, 1]).max() == pytest.approx(other.amplitude, rel=1e-4)
    assert find_fold(loop).value > 2.4005  # where a slip of it vanishes: the next test


def half_turn(K, x, ways):
    """Minus the state after slips and sticks that end as they do, the last one where the motor stops."""
    pull, rate = axis(K)
    for way, then in zip(ways, [*ways[1:], 0], strict=True):
        end = event(lambda _, x, w=way: x[1], -way) if way else event(lambda _, x, s=then: s * pull(x) - 50, 1)
        sizes = np.array([1e-4, 1e-2, 1e-4, 1e-3, 1e-5])
        first = {"first_step": 1e-6} if way else {"max_step": 0.02}
        done = solve_ivp(rate(way), (0, 9), x, method="DOP853", rtol=1e-11, atol=1e-11 * sizes, events=[end], **first)
        x = done.y[:, -1].copy()
    return -x


def test_the_fold_of_the_other_hunting_lies_behind_a_slip_that_vanishes(tmp_path):
    """A slip begins at gain 2.216 and is gone again at 2.4005; at the fold the half turn has a multiplier 1."""
    file = tmp_path / "axis.toml"
    file.write_text(AXIS)
    fold = fold_in(loop_cycle(load_loop(file).replace(gain=2.203)), "gain")
    assert 2.4005 < fold.value
    arcs = fold.orbit.arcs
    k = max(range(len(arcs)), key=lambda k: arcs[k].duration * ("slip" in arcs[k].mode))  # behind the long slip
    ways = [{"slip+": 1, "slip-": -1, "stick": 0}[arc.mode] for arc in arcs]
    ways = [*ways[k + 1 :], *(-way for way in ways[: k + 1])]
    start, moves = arcs[k].end, [0, 2, 3, 4]  # the motor stands there

    def turned(part):
        x = start.copy()
        x[moves] *= 1 + part
        return half_turn(fold.value, x, ways)[moves] / start[moves]

    assert np.abs(turned(np.zeros(4)) - 1).max() < 1e-7
    slopes = np.transpose([(turned(h) - turned(-h)) / 2e-6 for h in 1e-6 * np.eye(4)])
    assert np.abs(np.linalg.eigvals(slopes) - 1).min() < 1e-3  # as the root of what the gain is known to


@pytest.mark.slow
def test_the_fold_does_not_depend_on_the_gain_of_the_file():
    """At gain 1 motions end in a lopsided cycle whose branch ends at 1.011, in the symmetric one, which goes on.

    A fixed-step simulator that is not this package's hunts at 12 V/rad, with 2.28 mrad.
    """
    numbers = {"inertia": 0.00356, "static": 0.175, "coulomb": 0.114, "stribeck_velocity": 0.0133, "viscous": 0.0158,
               "motor_gain": 1.0, "kp": 1.03, "ki": 6.31, "kd": 0.0614, "load_inertia": 0.00372,
               "shaft_stiffness": 9.33, "shaft_damping": 0.0255}  # fmt: skip
    loop = Loop((TWO_MASSES, SWITCH, PID_BY_GAINS, INTEGRATOR), numbers | {"gain": 1.0})
    folds = [find_fold(loop.replace(gain=gain)) for gain in (1.0, 1.3, 5.0)]
    assert [fold.value for fold in folds] == pytest.approx([folds[0].value] * 3, rel=1e-8) and folds[0].value > 12
    assert find_orbit(loop.replace(gain=12.0)).amplitude == pytest.approx(2.28e-3, rel=3e-3)


BY_DIRECTION_LOOP = Loop((INERTIA, BY_DIRECTION, PID_BY_TIMES, INTEGRATOR), {"static_back": 0.47, "coulomb_back": 0.40})


def sticks(x, gain):
    """The places of the next two sticks of `BY_DIRECTION_LOOP`, from one that ends forwards at x on, by DOP853."""
    kp, kd, ki = 16 * gain * np.array([2, 1 / (2 * np.pi), 2 * np.pi])
    for sign, static, coulomb in ((1, 0.53, 0.44), (-1, 0.47, 0.40)):

        def rate(t, y, sign=sign, static=static, coulomb=coulomb):
            friction = sign * (coulomb + (static - coulomb) * np.exp(-((y[1] / 0.02) ** 2))) + 0.1 * y[1]
            return [y[1], (-(kp * y[0] + kd * y[1] + ki * y[2]) - friction) / 0.026, y[0]]

        def stops(t, y, sign=sign):
            return sign * y[1] if t > 1e-6 else 1.0

        stops.terminal, stops.direction = True, -1
        begins = [x, sign * 1e-13, -(sign * static + kp * x) / ki]
        x = solve_ivp(rate, (0, 10), begins, "DOP853", events=stops, rtol=1e-12, atol=1e-15).y[0, -1]
        yield x


def test_a_cycle_that_loses_its_stability_in_front_of_its_fold_says_where():
    """Friction by direction: P(x), from the place of one stick to that of the next on the same side, has a slope of -1
    there; from there on motions come to rest, a fifth below the fold."""
    fold = find_fold(BY_DIRECTION_LOOP)
    ((_, gain),) = stable_ranges(fold, BY_DIRECTION_LOOP)

    def following(x):
        _, x = sticks(x, gain)
        return x

    x = brentq(lambda x: following(x) - x, -1.01e-3, -1.0e-3, xtol=1e-15)
    wide, narrow = ((following(x + h) - following(x - h)) / (2 * h) for h in (2e-7, 1e-7))
    assert gain < 0.8 * fold.value and (4 * narrow - wide) / 3 == pytest.approx(-1, abs=1e-4)


def test_both_ends_of_swings_to_one_side_are_told():
    """They were said to reach as far to either side."""
    place = -0.04
    for _ in range(30):
        above, place = sticks(place, 0.04)
    said = simulate(BY_DIRECTION_LOOP, set_point=1.0, time=100.0).verdict.sentence
    assert f"from {place:.4g} rad to {above:.4g} rad beside the set point" in said


def test_a_cycle_that_is_stable_up_to_its_fold_says_so():
    loop = loop_of(Servo(), "switch", 0.3)
    fold = find_fold(loop)
    assert stable_ranges(fold, loop) == ((pytest.approx(0.3, rel=1e-9), fold.value),)


@pytest.mark.parametrize(("stable", "special", "told"), [
    ((True, True, True), [], [(0, 9)]),
    ((True, True, False), [], [(0, math.nan)]),  # lost, and nobody knows where
    ((True, True, False), [("superstable", 0), ("flip", 1)], [(0, 1)]),
    ((True, True, True), [("flip", 2)], [(0, 2)]),  # in the last step
    ((True, False, True), [("flip", 0), ("flip", 1)], [(0, 0), (1, 9)]),  # and wins it back
    ((True, True, True), [("flip", 0.3), ("flip", 0.6)], [(0, 0.3), (0.6, 9)]),  # within one step
    ((True, False, False), [("flip", 0), ("flip", 2)], [(0, 0), (2, 9)]),  # in the last one
    ((True, True, False), [("grazing", 1)], [(0, 1)]),
    ((True, True, True), [("grazing", 2)], [(0, 9)]),  # which it survives
    ((None, None, None), [], []),
])  # fmt: skip
def test_what_is_known_of_where_stability_is_lost(stable, special, told):
    orbits = [SimpleNamespace(seen_stable=each) for each in stable]
    points = [SimpleNamespace(kind=kind, behind=orbits[int(at)], value=at) for kind, at in special]
    found = ranges_between(0.0, orbits, points, 9.0)
    assert np.array_equal(np.array(found), np.array(told, dtype=float), equal_nan=True)


@pytest.mark.slow
def test_a_fold_that_is_not_found_says_from_where_on_motions_leave_the_cycles():
    """Static friction 2.3 times Coulomb's: behind a half multiplier of -1 steps shrink, and the fold is no border of
    anything.  There the slope of the map of half turns, by DOP853, is -1."""
    static, coulomb, vs, viscous, inertia = 4.25595, 1.82521, 2.597866e-3, 0.950973, 5.824687e-3
    servo = Servo().replace(**{
        "friction.static": static, "friction.coulomb": coulomb, "friction.stribeck_velocity": vs,
        "friction.viscous": viscous, "servo.inertia": inertia, "servo.motor_gain": 3.16925,
        "controller.integral_time": 0.776434, "controller.lead_time": 0.0255295,
    })  # fmt: skip
    with pytest.raises(NoOrbit, match="stops hunting was not found") as refusal:
        find_fold(servo, "switch")
    between = re.search(r"between gain = (\S+) and (\S+) its cycles have become unstable", str(refusal.value))
    slopes = []
    for gain in map(float, between.groups()):
        kp, kd, ki = servo.torque_gains(gain)

        def rate(t, y, kp=kp, kd=kd, ki=ki):
            friction = coulomb + (static - coulomb) * np.exp(-((y[1] / vs) ** 2)) + viscous * y[1]
            return [y[1], (-(kp * y[0] + kd * y[1] + ki * y[2]) - friction) / inertia, y[0]]

        def stops(t, y):
            return y[1] if t > 1e-7 else 1.0

        stops.terminal, stops.direction = True, -1

        def half_turn(a, rate=rate, stops=stops, kp=kp, ki=ki):
            begins = [-a, 1e-14, (kp * a - static) / ki]
            return solve_ivp(rate, (0, 1), begins, "DOP853", events=stops, rtol=1e-12, atol=1e-17).y[0, -1]

        a = brentq(lambda a: half_turn(a) - a, 1.60e-4, 1.68e-4, xtol=1e-17)
        slopes.append((half_turn(a + 1e-9) - half_turn(a - 1e-9)) / 2e-9)
    assert slopes[0] > -1 > slopes[1] and np.ptp(slopes) < 1e-3


LIMITED = linear_axis(
    "Switch friction", "torque limit",
    mass=4.84, static=58.1, coulomb=29.9, stribeck_velocity=0.00185, viscous=739.0, position_gain=27.3,
    velocity_gain=379.0, reset_time=0.0293, force_limit=90.5,
)  # fmt: skip
ONE_SIDED = linear_axis(
    "Switch friction by direction",
    mass=2.71, static=21.1, coulomb=10.2, stribeck_velocity=0.00232, viscous=63.0, position_gain=13.7,
    velocity_gain=135.0, reset_time=0.0232, static_back=15.3, viscous_back=80.9, coulomb_back=9.05,
)  # fmt: skip
FILTERED = linear_axis(
    "two masses", "Switch friction", '{part = "series", filters = ["second-order low-pass"]}',
    mass=3.01, static=73.4, coulomb=32.7, stribeck_velocity=0.00176, viscous=219.0, position_gain=28.0,
    velocity_gain=190.0, reset_time=0.0137, filter_frequency="95.811275741321 Hz", filter_damping=0.828,
    load_mass=3.94, shaft_stiffness=828000.0, shaft_damping=326.0,
)  # fmt: skip


def told(capsys, tmp_path, text, command, *words):
    """Exit code, and what a command says of an axis."""
    file = tmp_path / "axis.toml"
    file.write_text(text)
    code = main([command, str(file), *words, "--quiet"])
    captured = capsys.readouterr()
    return code, " ".join((captured.out + captured.err).split())


@pytest.mark.slow
def test_where_a_limit_holds_friction_hunting_ends_below(capsys, tmp_path):
    """Above 90.5 N the limit does not break it away, which is no fold; an own simulator hunts at 35 N, not at 33.87."""
    code, said = told(capsys, tmp_path, LIMITED, "fold", "--vary", "static")
    ends = float(re.search(r"goes down to static (\S+) N", said)[1])
    assert code == 0 and 33.87 < ends < 35


@pytest.mark.slow
def test_the_first_line_is_what_motions_do(capsys, tmp_path):
    """Of 29 starts 24 hunt at 1.35, in an own simulator, and none does at 1.44, 2, 4 or 7; the fold is at 7.2."""
    code, said = told(capsys, tmp_path, ONE_SIDED, "fold")
    ends, fold = re.search(r"goes up to gain (\S+) V/m; its .* unstable, to their fold at (\S+)", said).groups()
    assert code == 0 and 1.35 < float(ends) < 1.44 and float(fold) > 7


def test_a_lopsided_cycle_says_from_where_to_where(capsys, tmp_path):
    """An own simulator turns at -89.6 um and 1.215 mm."""
    code, said = told(capsys, tmp_path, ONE_SIDED, "orbit")
    ends = re.search(r"it reaches from (\S+) to (\S+) mm beside the set point", said).groups()
    assert code == 0 and [float(end) for end in ends] == pytest.approx([-0.0896, 1.215], rel=2e-3)


@pytest.mark.slow
def test_a_slip_that_pauses_at_a_contact_leads_to_the_unstable_cycle(capsys, tmp_path):
    """The branch turns back where a slip comes to a stop with no speed: what follows is decided by zero there.

    An own simulator hunts at 5.7859332584e-5 m at gain 17, on the branch behind it. Its half-turn map at gain 1 takes
    9.686e-7 m to 9.68043946e-7 m, and 9.687e-7 to 9.69429842e-7: the cycle is at 9.68643e-7.
    """
    code, said = told(capsys, tmp_path, FILTERED, "orbit", "--branch", "unstable")
    assert code == 0 and float(re.search(r"amplitude (\S+) nm", said)[1]) == pytest.approx(968.643, rel=1e-4)


def test_a_branch_that_comes_back_stable_is_not_the_unstable_one(capsys, monkeypatch, tmp_path):
    """It would be called the border of hunting."""
    back = SimpleNamespace(end=End("range", "", 1.0), values=np.array([2.0, 1.0]))

    def follow(cycle, vary, **how):
        return SimpleNamespace(**vars(back), orbits=(cycle, cycle))

    monkeypatch.setattr(verbs, "follow", follow)
    code, said = told(capsys, tmp_path, FILTERED, "orbit", "--branch", "unstable")
    assert code == 1 and "comes back to gain = 1 with a stable cycle of amplitude 1.537 mm" in said
