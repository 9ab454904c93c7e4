"""Outcomes of motions against other engines (Taylor series), and against motions at least ten times as long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import Servo, cli, find_orbit, simulate
from casahunt.servo.parts import loop_of
from casahunt.servo.parts.ahead import Moved, ahead
from problems import taylor
from scripts import verdicts

TABLE_1 = Servo()
ABOVE_FOLD = 0.6473456  # by 1e-5 of itself: the fold of Table 1 is 0.64733908365 (problems/table1.py)
UNDAMPED = Servo().replace(**{"friction.viscous": 0.0, "controller.lead_time": 0.0})
DAMPED = Servo(inertia=0.00833013, motor_gain=27.1614).replace(**{
    "controller.lead_time": 0.306233, "controller.integral_time": 0.387414, "friction.static": 1.26049,
    "friction.coulomb": 0.866749, "friction.stribeck_velocity": 0.0150762, "friction.viscous": 0.0537052,
})  # fmt: skip


def verge(servo: Servo, gain: float, a: float) -> dict[str, float]:
    """The start stuck at -a on the verge of breakaway."""
    kp, _, ki = servo.torque_gains(gain)
    return {"set_point": 0.0, "position": -a, "integral": (kp * a - servo.friction.static) / ki}


def test_just_above_the_fold_nothing_hunts():
    """Swings of 1e-4 relative difference; the map by Taylor series is below P = a from there down, so they decay."""
    start = {"set_point": 0.0, "position": -0.00158455, "integral": -0.00763966057}
    found = simulate(TABLE_1, "switch", ABOVE_FOLD, time=100.0, **start)
    a = abs(float(found.end[0]))
    for b in a * np.array([1.0, 0.9995, 0.999, 0.998, 0.99, 0.9, 0.5, 0.1]):
        assert abs(taylor.switch_half_cycle(TABLE_1, ABOVE_FOLD, b)[0]) < b
    assert found.verdict.kind == "decaying"


def test_just_below_the_fold_it_hunts():
    gain = 0.6473
    found = simulate(TABLE_1, "switch", gain, time=150.0, **verge(TABLE_1, gain, 0.00157)).verdict
    amplitude, period = taylor.switch_cycle(TABLE_1, gain, found.amplitude)
    assert found.kind == "hunting" and found.pattern == 2
    assert found.amplitude == pytest.approx(amplitude, rel=1e-3) and found.period == pytest.approx(period, rel=1e-3)


@pytest.mark.parametrize("gain", [0.1, 0.4])
def test_rest_below_the_unstable_cycle_and_hunting_above(orbit, gain):
    stable, unstable = orbit("switch", gain).amplitude, orbit("switch", gain, "unstable").amplitude
    below, above = (
        simulate(TABLE_1, "switch", gain, time=0.05, **verge(TABLE_1, gain, unstable * f)).verdict
        for f in (1 - 1e-3, 1 + 1e-3)  # in the time simulated it hardly begins to move
    )
    assert below.kind == "decaying" and above.kind == "hunting"
    assert above.amplitude == pytest.approx(stable, rel=1e-3)


def test_what_the_motion_is_not_known_to_is_not_decided(orbit):
    """Stuck beside the unstable cycle, nearer to it than its position is known: either end is possible."""
    gain, unstable = 0.4, orbit("switch", 0.4, "unstable").amplitude
    kinds = {}
    for error in (1e-5, 1e-2, np.inf):
        motion = simulate(TABLE_1, "switch", gain, time=0.05, **verge(TABLE_1, gain, unstable * (1 - 1e-3)))
        errors = np.array([error * unstable, 0.0, 0.0])
        seen = ahead(loop_of(TABLE_1, "switch", gain), Moved(motion.times, motion.states, errors))
        kinds[error] = seen.kind
    assert list(kinds.values()) == ["decaying", "undecided", "undecided"]


def test_a_stuck_servo_is_judged_by_where_it_breaks_away_to():
    """Corner of the friction's uncertainty: stuck for hundreds of seconds beside the set point, and a cycle exists."""
    corner = TABLE_1.replace(
        **{"friction.static": 0.54, "friction.coulomb": 0.435, "friction.stribeck_velocity": 0.019,
           "friction.viscous": 0.09}
    )  # fmt: skip
    gain = 0.7121
    amplitude, _ = taylor.switch_cycle(corner, gain, 0.0017)
    wait = simulate(corner, "switch", gain, time=3.0, set_point=0.0, position=-1.02 * amplitude).verdict
    assert wait.kind == "hunting" and wait.waits > 1
    assert wait.amplitude == pytest.approx(amplitude, rel=1e-3)  # what it is on its way to
    small = simulate(corner, "switch", gain, time=5.0, set_point=0.0, position=-1e-4).verdict
    assert small.kind == "decaying" and small.waits > 10
    assert abs(taylor.switch_half_cycle(corner, gain, 1e-4)[0]) < 1e-4


def test_a_motion_that_ends_in_the_kink_of_its_bristles_goes_on_beside_it():
    """At rest: |x2| as it is takes ever shorter steps there."""
    motion = simulate(TABLE_1, "lugre", 0.5, position=0.9995)
    loop, (times, states) = motion.loop, motion.motion.sample(1)
    errors = np.zeros(len(states))
    for mode in ("", "slide"):
        assert ahead(loop, Moved(times, states, errors, mode)).kind == "at rest"


def test_rounding_is_not_judged():
    """A servo that creeps to its set point leaves positions of 1e-18 rad, which grow or shrink by rounding."""
    found = simulate(TABLE_1, "switch", 0.7721022688090521, set_point=0.1, time=51.56885110479699).verdict
    assert found.kind == "at rest" and np.isnan(found.amplitude) and 0 < found.rests_since < 51


def test_a_servo_that_has_crept_to_the_set_point_is_at_rest():
    """Its slip ends 1e-16 rad beside it, and no march says where."""
    for gain in 0.88383 * (1 + 1e-3 * np.arange(12)):
        motion = simulate(DAMPED, "switch", gain, position=1.0048, time=380.0)
        assert motion.verdict.kind == "at rest", motion.verdict.sentence
    assert simulate(DAMPED, "switch", 0.88383, position=1.0048, time=1.0).verdict.kind != "at rest"


def test_a_stuck_servo_waits_until_the_next_event():
    """m(t) = m - ki x1 t up to static friction, against the event of a longer motion."""
    start = {"set_point": 0.0, "position": -0.01}
    stuck, longer = (simulate(TABLE_1, "switch", 0.04, time=time, **start) for time in (1.0, 90.0))
    away = next(e.time for e in longer.events if e.name.startswith("breakaway"))
    assert stuck.motion.phases[-1].mode == "stick" and 1.0 + stuck.verdict.waits == pytest.approx(away, abs=1e-6)


def test_a_fast_start_is_not_thrown_out():
    """A velocity of 1e4 rad/s carries a stable servo a thousand times Fs/kp away, and it comes back."""
    found = simulate(TABLE_1, "switch", 0.04, set_point=0.0, velocity=1e4, time=60.0, tol=1e-4)
    assert found.ended == "" and found.verdict.kind != "growing"


@pytest.mark.slow
@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_lugre_started_on_a_cycle(orbit, branch):
    """Its swings agree from the first to the last on either cycle.

    The unstable one multiplies an error by 138 in half a period, so its last digits decide to which side the motion
    leaves it: to rest, or to the stable cycle.
    """
    cycle = orbit("lugre", 0.6, branch)
    x = cycle.sample()[1][:, 0]
    start = {"set_point": 0.0, "position": x[0], "velocity": x[1], "integral": x[2], "bristle": x[3]}
    found = simulate(TABLE_1, "lugre", 0.6, time=4.2 * cycle.period, tol=1e-7, **start).verdict
    stable = orbit("lugre", 0.6, "stable")
    if branch == "stable" or found.kind == "hunting":
        assert found.kind == "hunting" and found.amplitude == pytest.approx(stable.amplitude, rel=1e-3)
    else:
        assert found.kind in {"undecided", "decaying", "at rest"}


@pytest.mark.slow
@pytest.mark.parametrize(("servo", "number"), [(1, 1), (3, 0)])
def test_a_stuck_servo_springs_on_its_bristles_and_that_is_no_turn(servo, number):
    """Between two swings of these LuGre servos lie a hundred turns of 1e-5 of one: they hunt, and not irregularly.  In
    a pattern of six swings the second one settled before two of it were alike to 1e-6."""
    case = verdicts.cases(np.random.default_rng([77, servo]), "lugre", 5)[number]
    seen = case.motion().verdict
    assert seen.kind == "hunting" and seen.pattern == 2
    assert seen.amplitude == pytest.approx(find_orbit(case.servo, "lugre", case.gain).amplitude, rel=1e-3)


@pytest.mark.parametrize("step", [1.0, 1e4])
def test_the_amplitude_is_that_of_the_cycle_behind_any_step(step):
    """The error of a large step is no error of the hunting behind it."""
    found = simulate(TABLE_1, "switch", 0.04, set_point=step, time=100.0).verdict
    amplitude, period = taylor.switch_cycle(TABLE_1, 0.04, 0.05)
    assert (found.amplitude, found.period) == pytest.approx((amplitude, period), rel=1e-6)


def test_command_prints_the_swings(capsys):
    assert cli.main(["simulate", "--gain", "0.04"]) == 0
    assert "swings ahead" not in capsys.readouterr().out
    assert cli.main(["simulate", "--gain", "0.04", "--details"]) == 0
    assert "swings ahead     0.10009, 0.10009" in capsys.readouterr().out


def compared(k: int, count: int, model: str) -> list[verdicts.Outcome]:
    """Verdicts on one random servo of the script."""
    return [verdicts.outcome(case) for case in verdicts.cases(np.random.default_rng([1, k]), model, count)]


def test_the_comparison_sees_a_wrong_verdict():
    hunts, rests, hunts_on = (simulate(TABLE_1, "switch", gain, time=t, tol=1e-5) for gain, t in
                              ((0.04, 60.0), (0.8, 120.0), (0.04, 120.0)))  # fmt: skip
    assert hunts.verdict.kind == "hunting" and verdicts.contradiction(hunts, rests)
    later = simulate(TABLE_1, "switch", 0.04, time=9 * 120.0, tol=1e-5)
    assert rests.verdict.kind == "at rest" and verdicts.contradiction(rests, later)
    assert not verdicts.contradiction(hunts, hunts_on)
    for wrong in ("decaying", "growing"):
        claimed = replace(hunts)
        claimed.__dict__["verdict"] = replace(hunts.verdict, kind=wrong)
        assert verdicts.contradiction(claimed, hunts_on)


@pytest.mark.slow
def test_the_script_counts_what_is_contradicted(monkeypatch, capsys, tmp_path):
    case = verdicts.Case(TABLE_1, "switch", 0.8, 1.2358, 10.0, {})
    monkeypatch.setattr(verdicts, "cases", lambda *_: [case, case])
    assert verdicts.main(["--servos", "2", "--json", str(tmp_path / "v.json")]) == 0
    assert "contradicted" in capsys.readouterr().out and (tmp_path / "v.json").read_text().count('"at rest"') == 4
    monkeypatch.setattr(verdicts, "contradiction", lambda *_: "it hunts")
    assert verdicts.main(["--servos", "1"]) == 1 and "BUT it hunts" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("k", [3, 6])
def test_no_verdict_is_contradicted_by_a_longer_motion(k):
    assert not [o.against for o in compared(k, 6, "switch") if o.against]


def test_the_amplitude_of_a_motion_that_has_just_arrived():
    """Its last stick is at the cycle, its periods are not yet."""
    changes = {
        "servo.inertia": 0.0032677, "servo.motor_gain": 7.00823, "controller.lead_time": 0.16415,
        "controller.integral_time": 0.0872366, "friction.static": 1.82555, "friction.coulomb": 1.61659,
        "friction.stribeck_velocity": 0.0216367, "friction.viscous": 0.0014652,
    }  # fmt: skip
    servo = Servo().replace(**changes)
    start = {"position": -0.0665170752831, "velocity": -1.45416126849}
    found = simulate(servo, "switch", 1.88063506567, time=20.8529, set_point=0.0, **start)
    assert found.verdict.kind == "hunting"
    amplitude, _ = taylor.switch_cycle(servo, 1.88063506567, found.verdict.amplitude)
    assert found.verdict.amplitude == pytest.approx(amplitude, rel=1e-3)
