"""Verdicts against other engines (Taylor series), against maps made by hand, and against motions ten times as long."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from casahunt import Servo, cli, simulate
from casahunt.servo.simulation import long_run, verdict
from casahunt.servo.simulation.long_run import attracting_cycle_near, escapes, settles
from casahunt.servo.simulation.swings import ABOVE, limit_of, limit_of_sides
from casahunt.servo.simulation.verdict import SWINGS, judge_motion
from problems import taylor
from scripts import verdicts
from scripts.report.attraction import swing

TABLE_1 = Servo()
ABOVE_FOLD = 0.6473456  # by 1e-5 of itself: the fold of Table 1 is 0.64733908365 (problems/table1.py)
UNDAMPED = Servo().replace(**{"friction.viscous": 0.0, "controller.lead_time": 0.0})
SWINGING = Servo(inertia=0.059847, motor_gain=4.3901).replace(**{
    "controller.integral_time": 0.13029, "controller.lead_time": 0.050701, "friction.static": 1.415,
    "friction.coulomb": 0.63447, "friction.stribeck_velocity": 0.17899, "friction.viscous": 0.0032379,
})  # fmt: skip


def verge(servo: Servo, gain: float, a: float) -> dict[str, float]:
    """The start stuck at -a on the verge of breakaway."""
    kp, _, ki = servo.torque_gains(gain)
    return {"set_point": 0.0, "position": -a, "integral": (kp * a - servo.friction.static) / ki}


# Swings as numbers: maps made by hand --------------------------------------------------------------------------


def iterated(g, start: float, count: int) -> np.ndarray:
    """count swings of the map g, fewer where they end at zero."""
    A = [start]
    while len(A) < count and A[-1] > 0:
        A.append(g(A[-1]))
    return np.array(A)


@pytest.mark.parametrize("mu", [-0.9, -0.3, 0.05, 0.5, 0.9])
def test_convergence_is_found_with_its_limit(mu):
    """g(A) = 1 + mu (A - 1) + (A - 1)^2/2: the limit 1 lies within what is claimed, at the latest after 40 swings."""
    A = iterated(lambda A: 1 + mu * (A - 1) + (A - 1) ** 2 / 2, 1.05, 60)
    found = [limit_of(A[:n], 1e-12) for n in range(SWINGS, A.size)]
    assert all(f is None or abs(f[0] - 1) <= f[1] for f in found)
    assert all(f is not None and f[2] == pytest.approx(mu, abs=0.05) for f in found[36:])
    assert limit_of(A, 1.0) is None  # below what the position is known to nothing is concluded


@pytest.mark.parametrize("epsilon", [1e-10, 1e-7, 1e-4])
def test_the_passage_of_a_vanished_cycle_is_no_convergence(epsilon):
    """g(A) = A - epsilon - (A - 1)^2: swings differ by less and less until A = 1, and g has no fixed point."""
    A = iterated(lambda A: A - epsilon - (A - 1) ** 2, 1.01, 600)
    A = A[A > 0.9]
    assert np.min(np.abs(np.diff(A))) < 5e-6 + 2 * epsilon  # some swings agree very well
    for n in range(SWINGS, A.size, 5):
        assert limit_of(A[:n], 1e-15) is None


@pytest.mark.parametrize("ratio", [0.2, 0.9, 0.9995])
def test_a_geometric_decay_leads_to_zero(ratio):
    limit, uncertain, found = limit_of(ratio ** np.arange(30), 1e-15)
    assert abs(limit) <= 10 * uncertain + 1e-9 and found == pytest.approx(ratio, abs=1e-6)


def test_a_lopsided_cycle_converges_side_by_side():
    """1 and 2 in turn, approached by factors of 0.7: no limit of all swings, one of each side."""
    A = 1.0 + np.arange(40) % 2 + 0.1 * 0.7 ** np.arange(40)
    assert limit_of(A, 1e-12) is None
    limit, uncertain, ratio = limit_of_sides(A, 1e-12)
    assert abs(limit - 2) <= uncertain and ratio == pytest.approx(0.49, abs=1e-3)


@pytest.mark.parametrize(("spread", "agree"), [(0.0, True), (0.99, True), (1.01, False), (100.0, False)])
def test_swings_agree_to_what_can_be_read(spread, agree):
    swings = np.array([1.0, 1.0 - spread * ABOVE * 1e-9, 1.0])
    assert verdict._agree(swings, 1e-9) is agree


# What lies ahead: against the Taylor engine and computed cycles ------------------------------------------------


def test_just_above_the_fold_nothing_hunts():
    """Swings of 1e-4 relative difference; the map by Taylor series is below P = a from there down, so they decay."""
    start = {"set_point": 0.0, "position": -0.00158455, "integral": -0.00763966057}
    found = simulate(TABLE_1, "switch", ABOVE_FOLD, time=100.0, **start)
    a = found.verdict.judged[-1]
    assert 1 - 2e-4 < found.verdict.ratios[-1] < 1
    for b in a * np.array([1.0, 0.9995, 0.999, 0.998, 0.99, 0.9, 0.5, 0.1]):
        assert abs(taylor.switch_half_cycle(TABLE_1, ABOVE_FOLD, b)[0]) < b
    assert found.verdict.kind == "decaying" and found.verdict.limit == 0


def test_just_below_the_fold_it_hunts():
    gain = 0.6473
    found = simulate(TABLE_1, "switch", gain, time=150.0, **verge(TABLE_1, gain, 0.00157)).verdict
    amplitude, period = taylor.switch_cycle(TABLE_1, gain, found.limit)
    assert found.kind == "hunting"
    assert found.limit == pytest.approx(amplitude, rel=1e-8)
    assert found.period == pytest.approx(period, rel=1e-2)
    slope = (taylor.switch_half_cycle(TABLE_1, gain, amplitude * 1.0001)[0] - amplitude) / (1e-4 * amplitude)
    assert found.multiplier == pytest.approx(slope, abs=0.05) and 0 < found.multiplier < 1


@pytest.mark.parametrize("gain", [0.1, 0.4])
def test_settling_below_the_unstable_cycle_and_hunting_above(orbit, gain):
    stable, unstable = orbit("switch", gain).amplitude, orbit("switch", gain, "unstable").amplitude
    below, above = (settles(TABLE_1, "switch", gain, unstable * f) for f in (1 - 1e-3, 1 + 1e-3))
    assert below.holds and not above.holds
    cycle = attracting_cycle_near(TABLE_1, gain, stable * 1.02, 1e-6)
    assert cycle.amplitude == pytest.approx(stable, rel=1e-8) and abs(cycle.multiplier) < 1
    assert attracting_cycle_near(TABLE_1, gain, unstable, 1e-9) is None
    # Not drawn to it from everywhere that it may be: that would reach beyond the unstable cycle.
    assert attracting_cycle_near(TABLE_1, gain, stable, stable - 0.999 * unstable) is None


def settled_by(monkeypatch, ratio):
    """What `settles` makes of a map that is made by hand, b -> (P(b)/b, its slope), in the place of the servo's."""
    monkeypatch.setattr(long_run, "_swing", lambda *_: ratio)
    return settles(TABLE_1, "switch", 0.04, 0.01)


@pytest.mark.parametrize("slopes", [True, False])
@pytest.mark.parametrize(("top", "holds"), [(0.9, True), (0.97, True), (1.01, False), (1.5, False)])
def test_a_hump_between_the_first_stick_positions_is_found(monkeypatch, slopes, top, holds):
    """P(b)/b = 1/2 + (top - 1/2) exp(-(ln b/b0)^2/w^2), wherever the hump is between the points first looked at."""
    for shift in (0.0, 0.2, 0.4, 0.6):
        centre, width = math.log(1e-3) + shift, 0.4

        def ratio(b, centre=centre, width=width):
            u = (math.log(b) - centre) / width
            hump = (top - 0.5) * math.exp(-u * u)
            return 0.5 + hump, -2 * u / width * hump if slopes else math.nan

        assert settled_by(monkeypatch, ratio).holds == holds


def test_jumps_of_the_map_are_no_obstacle_below_one(monkeypatch):
    def ratio(b):
        return (0.1, 0.0) if b < 1e-3 else (0.8, 0.0)

    assert settled_by(monkeypatch, ratio).holds
    # A jump up to where P(b) is almost b is not resolved, and the search ends.
    steep = settled_by(monkeypatch, lambda b: (0.1, 0.0) if b < 1e-3 else (0.99, 0.0))
    assert "not resolved" in steep.sentence


def linear_ratio(servo: Servo, gain: float) -> float:
    """rho = P(b)/b of the slip with constant friction, by the matrix exponential: from (-b, 0) without net torque."""
    kp, kd, ki = servo.torque_gains(gain)
    J, s2 = servo.inertia, servo.friction.viscous
    values, vectors = np.linalg.eig(np.array([[0, 1, 0], [-kp / J, -(kd + s2) / J, -ki / J], [1, 0, 0]]))
    weights = np.linalg.solve(vectors, [-1.0, 0.0, kp / ki])
    t = np.linspace(0, 30 / float(np.max(np.abs(values))), 30001)[1:]
    x = (vectors[:2] @ (weights[:, None] * np.exp(np.outer(values, t)))).real
    return float(x[0, np.flatnonzero(x[1] <= 0)[0]])


@pytest.mark.parametrize("gain", [0.35, 0.39, 1.0, 2.0])
def test_small_swings_of_an_unstable_loop_may_settle(gain):
    """The loop without dry friction is unstable below K = 1.47, small swings grow below K = 0.38."""
    rho = linear_ratio(SWINGING, gain)
    found = settles(SWINGING, "switch", gain, 1e-9)
    assert found.holds == (rho < 1) and (gain < 0.38) == (rho > 1)
    said = float(re.search(r"([0-9.]+) times as far", found.sentence)[1])
    assert said == pytest.approx(rho, rel=2e-3)  # the drop of the friction is not felt by more than that


def test_a_stuck_servo_is_judged_by_where_it_breaks_away_to():
    """Corner of the friction's uncertainty: stuck for hundreds of seconds beside the set point, and a cycle exists."""
    corner = TABLE_1.replace(
        **{"friction.static": 0.54, "friction.coulomb": 0.435, "friction.stribeck_velocity": 0.019,
           "friction.viscous": 0.09}
    )  # fmt: skip
    gain = 0.7121
    amplitude, _ = taylor.switch_cycle(corner, gain, 0.0017)
    wait = simulate(corner, "switch", gain, time=3.0, set_point=0.0, position=-1.02 * amplitude).verdict
    assert wait.kind == "undecided" and "s later" in wait.sentence
    assert wait.limit == pytest.approx(amplitude, rel=1e-8)  # what it is on its way to
    small = simulate(corner, "switch", gain, time=5.0, set_point=0.0, position=-1e-4).verdict
    assert small.kind == "decaying" and "s later" in small.sentence
    assert abs(taylor.switch_half_cycle(corner, gain, 1e-4)[0]) < 1e-4


def test_rounding_is_not_judged():
    """A servo that creeps to its set point leaves positions of 1e-18 rad, which grow or shrink by rounding."""
    found = simulate(TABLE_1, "switch", 0.7721022688090521, set_point=0.1, time=51.56885110479699).verdict
    assert found.kind == "at rest" and found.limit == 0 and math.isnan(found.amplitude)
    assert found.judged and min(found.judged) > found.floor
    assert found.floor > 1e-9 and f"{found.floor:.2g}" in found.sentence


def test_growth_is_what_no_friction_can_hold_back():
    """The worst friction the bound allows, F = Fs sgn(..) against growth, exactly integrated: y grows beyond it."""
    gain = 0.1
    J, Fs = UNDAMPED.inertia, UNDAMPED.friction.static
    kp, kd, ki = UNDAMPED.torque_gains(gain)
    A = np.array([[0, 1, 0], [-kp / J, -kd / J, -ki / J], [1, 0, 0]])
    values, vectors = np.linalg.eig(A.T)
    i = int(np.argmax(values.real))
    w, growth = vectors[:, i], values[i].real
    bound = abs(w[1]) * Fs / (J * growth)
    direction = np.linalg.lstsq(np.array([w.real, w.imag]), np.array([1.0, 0.0]), rcond=None)[0]
    assert escapes(UNDAMPED, "switch", gain, 1.1 * bound * direction)
    assert not escapes(UNDAMPED, "switch", gain, 0.9 * bound * direction)
    assert not escapes(TABLE_1, "switch", gain, 1e6 * bound * direction)  # a stable loop does not grow for ever
    y, h = 1.1 * bound + 0j, 1e-3
    for _ in range(2000):
        phase = np.conj(y) * w[1]
        y = np.exp(values[i] * h) * y - h * w[1] / J * Fs * np.sign(phase.real)
    assert abs(y) > 1.2 * bound


def test_a_fast_start_is_not_thrown_out():
    """A velocity of 1e4 rad/s carries a stable servo a thousand times Fs/kp away, and it comes back."""
    found = simulate(TABLE_1, "switch", 0.04, set_point=0.0, velocity=1e4, time=60.0, tol=1e-4)
    assert found.ended == "" and found.verdict.kind != "growing"


@pytest.mark.slow
@pytest.mark.parametrize("branch", ["stable", "unstable"])
def test_lugre_started_on_a_cycle(orbit, branch):
    """Its swings agree from the first to the last on either cycle; only the stable one draws them back.

    The unstable one multiplies an error by 138 in half a period, so its last digits decide to which side the motion
    leaves it: to rest, or to the stable cycle, which then is the limit that is named.
    """
    cycle = orbit("lugre", 0.6, branch)
    x = cycle.sample()[1][:, 0]
    start = {"set_point": 0.0, "position": x[0], "velocity": x[1], "integral": x[2], "bristle": x[3]}
    found = simulate(TABLE_1, "lugre", 0.6, time=4.2 * cycle.period, tol=1e-7, **start).verdict
    stable = orbit("lugre", 0.6, "stable")
    if branch == "stable" or found.kind == "hunting":
        assert found.kind == "hunting" and found.limit == pytest.approx(stable.amplitude, rel=1e-3)
    else:
        assert found.kind in {"undecided", "decaying", "at rest"}
    if branch == "stable":
        assert found.multiplier == pytest.approx(cycle.half_multiplier, abs=1e-3)
        assert found.limit == pytest.approx(cycle.amplitude, rel=1e-6)


# The sentence and the numbers behind it ------------------------------------------------------------------------


def test_the_verdict_names_what_it_was_judged_from():
    found = simulate(TABLE_1, "switch", 0.04)
    v = found.verdict
    sticks = [(e.time, abs(float(found.sample(np.array([e.time]))[0, 0]))) for e in found.events if e.before == "stick"]
    assert v.judged[0] == pytest.approx(dict(sticks)[min(t for t, _ in sticks if t >= v.since - 1e-9)], rel=1e-9)
    assert len(v.judged) == SWINGS + 1 and len(v.ratios) == SWINGS
    assert v.ratios == pytest.approx([b / a for a, b in zip(v.judged, v.judged[1:], strict=False)])
    assert f"{v.limit:.8g}" in v.sentence


def known_to(found, error: float) -> SimpleNamespace:
    """A motion as it is, its position known to an error [rad]."""
    names = "model", "servo", "gain", "times", "states", "modes", "ended", "shape", "dense", "torque"
    return SimpleNamespace(**{name: getattr(found, name) for name in names}, state_errors=np.full(3, error))


@pytest.mark.parametrize("a", [0.0, 1e-12, 1e-3])
@pytest.mark.parametrize(
    ("servo", "model", "gain"),
    [(TABLE_1, "switch", 0.8), (TABLE_1, "lugre", 0.7), (SWINGING, "switch", 1.0), (SWINGING, "lugre", 1.0)],
)
def test_what_is_said_of_all_stick_positions_was_looked_at_among_them(servo, model, gain, a):
    """Whatever was asked about, the distances named are of the range named, and what was asked about is, too."""
    ahead = settles(servo, model, gain, a)
    assert ahead.holds
    top = float(re.search(r"up to (\S+) rad", ahead.sentence)[1])
    assert top >= a * (1 - 1e-3)
    said = re.search(r"at most (\S+) times as far \(from (\S+) rad", ahead.sentence)
    if said is None:
        assert "goes to the set point" in ahead.sentence
        return
    most, where = float(said[1]), float(said[2])
    assert where <= top * (1 + 1e-3)
    if model == "switch":  # the map may jump there, and four digits of the place are said
        beside = where * np.linspace(1 - 1e-3, 1 + 1e-3, 101)
        assert np.max(np.abs(swing(servo, gain, beside)) / beside) == pytest.approx(most, rel=1e-2)


def test_motions_that_are_not_known_are_not_judged():
    assert judge_motion(known_to(simulate(TABLE_1, "switch", 0.04), np.inf)).kind == "undecided"


BORDER = 0.01
"""Of the maps below: stick positions up to it [rad] are followed by smaller ones."""


def map_made_by_hand(monkeypatch, q, slope) -> None:
    """P(b) = b q(b/BORDER), with dP/db given, in the place of the Switch servo's."""
    made = lambda servo, gain, b: SimpleNamespace(position=b * q(b / BORDER), slope=slope(b / BORDER))  # noqa: E731
    monkeypatch.setattr(long_run, "map_at", made)


def stuck(model, at: float, **how):
    """A servo stuck so many BORDERs beside its set point, far from breaking away."""
    return simulate(TABLE_1, model, 0.3, time=0.05, set_point=0.0, position=-at * BORDER, **how)


@pytest.mark.parametrize(("at", "error", "kind"), [(0.9, 0.05, "decaying"), (0.9, 0.15, "undecided")])
def test_what_may_lie_beyond_the_border_does_not_settle(monkeypatch, at, error, kind):
    """P(b) = b^3/BORDER^2: the farthest place where the servo may be stuck decides."""
    map_made_by_hand(monkeypatch, lambda u: u**2, lambda u: 3 * u**2)
    assert judge_motion(known_to(stuck("switch", at), error * BORDER)).kind == kind


@pytest.mark.parametrize(("error", "kind"), [(5e-3, "decaying"), (0.015, "undecided")])
def test_what_may_lie_beyond_the_border_a_swing_later_does_not_settle(monkeypatch, error, kind):
    """q = 1 + 0.4 (u - 1) (3 - u): from 3.69 the next stick is at 0.95, farther by 4.7 times what 3.69 is known to."""
    q, slope = lambda u: 1 + 0.4 * (u - 1) * (3 - u), lambda u: 1 + 0.4 * (-3 * u**2 + 8 * u - 3)
    assert q(3.69) * 3.69 == pytest.approx(0.95, abs=1e-3) and slope(3.69) == pytest.approx(-4.7, abs=0.05)
    map_made_by_hand(monkeypatch, q, slope)
    found = judge_motion(known_to(stuck("switch", 3.69), error * BORDER))
    assert found.kind == kind and ("1 swings later" in found.sentence) == (kind == "decaying")


@pytest.mark.parametrize(("error", "kind"), [(0.05, "decaying"), (0.15, "undecided")])
def test_what_may_lie_beyond_the_border_does_not_settle_in_the_other_model(monkeypatch, error, kind):
    """The same, P(b)/b = (b/BORDER)^2, where no motion carries it on."""
    monkeypatch.setattr(verdict, "_carried_on", lambda motion: None)
    monkeypatch.setattr(long_run, "half_cycle", lambda model, servo, gain, b: SimpleNamespace(ratio=(b / BORDER) ** 2))
    assert judge_motion(known_to(stuck("lugre", 0.9), error * BORDER)).kind == kind


def test_command_prints_the_swings(capsys):
    assert cli.main(["simulate", "--gain", "0.04"]) == 0
    assert "judged from" not in capsys.readouterr().out
    assert cli.main(["simulate", "--gain", "0.04", "--details"]) == 0
    out = capsys.readouterr().out
    assert "judged from      0.050047, 0.050047" in out and "floor" in out


# Motions ten times as long -------------------------------------------------------------------------------------


def compared(k: int, count: int, model: str) -> list[verdicts.Outcome]:
    """Verdicts on one random servo of the script."""
    return [verdicts.outcome(case) for case in verdicts.cases(np.random.default_rng([1, k]), model, count)]


def test_the_comparison_sees_a_wrong_verdict():
    hunts, rests, hunts_on = (simulate(TABLE_1, "switch", gain, time=t, tol=1e-5) for gain, t in
                              ((0.04, 60.0), (0.8, 120.0), (0.04, 120.0)))  # fmt: skip
    assert hunts.verdict.kind == "hunting" and verdicts.contradiction(hunts, rests)
    later = replace(hunts_on, times=hunts_on.times * 9)
    assert rests.verdict.kind == "at rest" and verdicts.contradiction(rests, later)
    assert not verdicts.contradiction(hunts, hunts_on)
    for wrong in ("decaying", "growing"):
        claimed = SimpleNamespace(verdict=replace(hunts.verdict, kind=wrong), dense=hunts.dense, end=hunts.end)
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
    """Its last stick is at the cycle, its periods are not yet: the amplitude is the cycle's, by the Taylor engine."""
    changes = {
        "servo.inertia": 0.0032677, "servo.motor_gain": 7.00823, "controller.lead_time": 0.16415,
        "controller.integral_time": 0.0872366, "friction.static": 1.82555, "friction.coulomb": 1.61659,
        "friction.stribeck_velocity": 0.0216367, "friction.viscous": 0.0014652,
    }  # fmt: skip
    servo = Servo().replace(**changes)
    start = {"position": -0.0665170752831, "velocity": -1.45416126849}
    found = simulate(servo, "switch", 1.88063506567, time=20.8529, set_point=0.0, **start)
    assert found.verdict.kind == "hunting" and found.verdict.swings == 0
    amplitude, _ = taylor.switch_cycle(servo, 1.88063506567, found.verdict.amplitude)
    assert found.verdict.amplitude == pytest.approx(amplitude, rel=1e-6)
