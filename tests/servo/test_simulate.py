"""Simulated motions against closed forms, the Taylor engine, tighter tolerances and computed limit cycles."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from casahunt import (
    InputError,
    NoOrbit,
    Servo,
    Status,
    Trajectory,
    basin,
    cli,
    equilibria,
    find_fold,
    find_orbit,
    simulate,
)
from casahunt.errors import ComesToRest
from casahunt.motion.phases import MarchFailure
from casahunt.servo import simulate as searching
from casahunt.servo.other_end import other_end
from casahunt.servo.parts import loop_of
from casahunt.servo.parts.plain_loop import servo_of_loop
from casahunt.servo.simulate import _Runs
from problems import taylor

TABLE_1 = Servo()
COULOMB = Servo().replace(**{"friction.static": 0.44})


@cache
def regulator(model: str = "switch", tol: float = 1e-9, time: float = 100.0) -> Trajectory:
    """The regulator task of the report at K = 0.04."""
    return simulate(TABLE_1, model, 0.04, tol=tol, time=time)


# The other engine ------------------------------------------------------------------------------------------


def taylor_switch(servo: Servo, gain: float, x: np.ndarray, end: float) -> list[tuple[float, str, np.ndarray]]:
    """(time, event, state) of the Switch servo from rest at x until `end`."""
    flow = taylor.Flow(servo, gain, "switch")
    events: list[tuple[float, str, np.ndarray]] = []
    now, x = 0.0, x.copy()
    velocity = np.array([0.0, 1.0, 0.0])
    scale = np.array([1.0, 1.0, 1.0])
    while True:
        m = flow.torque(x)
        if abs(m) <= flow.Fs:
            sign = -float(np.sign(x[0]))
            wait = (m - sign * flow.Fs) / (flow.ki * x[0])
            now, x = now + wait, x + np.array([0, 0, wait * x[0]])
            if now > end:
                return events
            events.append((now, f"breakaway{'+' if sign > 0 else '-'}", x))
        else:
            sign = float(np.sign(m))
        first = True
        while True:
            c = flow.series(x, sign)
            h = taylor._step(c, scale, flow.vs)
            h = min(h, 1e-3) if first else h
            samples = np.array([sign * taylor._value(c, s)[1] for s in np.linspace(0, h, 9)[1:]])
            if not first and (samples < 0).any():
                i = int(np.flatnonzero(samples < 0)[0])
                h = taylor._root(c, velocity, h * i / 8, h * (i + 1) / 8)
                x, now = taylor._value(c, h), now + h
                break
            x, now, first = taylor._value(c, h), now + h, False
        x[1] = 0.0
        if now > end:
            return events
        events.append((now, "stop", x))


def taylor_lugre(servo: Servo, gain: float, x: np.ndarray, sign: float, end: float) -> tuple[list[float], np.ndarray]:
    """(times of the reversals, final state) of the LuGre servo that starts with velocity of `sign`."""
    flow = taylor.Flow(servo, gain, "lugre")
    scale = np.array([1.0, 1.0, 1.0, flow.Fs / flow.s0])
    velocity = np.array([0.0, 1.0, 0.0, 0.0])
    now, times = 0.0, []
    while True:
        c = flow.series(x, sign)
        h = min(taylor._step(c, scale, flow.vs), end - now)
        grid = np.linspace(0, h, 9)
        values = np.array([taylor._value(c, s) for s in grid])
        back = np.flatnonzero(sign * values[1:, 1] < 0)
        if back.size:
            i = int(back[0])
            h = taylor._root(c, velocity, grid[i], grid[i + 1])
            x, now, sign = taylor._value(c, h), now + h, -sign
            times.append(now)
            x[1] = 0.0
            c = flow.series(x, sign)
            tiny = 1e-3 * taylor._step(c, scale, flow.vs)
            x, now = taylor._value(c, tiny), now + tiny
        else:
            x, now = values[-1], now + h
        if now >= end * (1 - 1e-15):
            return times, x


# Accuracy --------------------------------------------------------------------------------------------------


def test_switch_against_taylor_series():
    """100 s of the regulator task: every event, its time to 1e-9 s and its state to 1e-9."""
    found = regulator()
    known = taylor_switch(TABLE_1, 0.04, np.array([-1.0, 0, 0]), 100.0)
    assert [e.name for e in found.events] == [name for _, name, _ in known]
    times = np.array([e.time for e in found.events])
    assert np.max(np.abs(times - [t for t, _, _ in known])) < 1e-9
    states = np.array([x for _, _, x in known]).T
    # The states at the events are mesh states; sampled beside the rounding of a time they are the same.
    assert np.max(np.abs(found.sample(times) - states)) < 1e-9


@pytest.mark.parametrize(
    ("gain", "start", "changes"),
    [
        (0.2, (-0.5, 0, 0), {}),
        (0.1, (0.3, 0, 0.2), {}),
        (0.04, (-1.0, 0, 0), {"friction.viscous": 0.0}),
        (0.04, (-0.9, 0, 0), {"friction.static": 0.44}),
    ],
)
def test_other_switch_motions_against_taylor_series(gain, start, changes):
    servo = Servo().replace(**changes)
    found = simulate(
        servo, "switch", gain, set_point=2.0, position=2 + start[0], integral=start[2], time=25.0, tol=1e-9
    )
    known = taylor_switch(servo, gain, np.array(start, float), 25.0)
    assert [e.name for e in found.events] == [name for _, name, _ in known]
    assert np.max(np.abs(np.array([e.time for e in found.events]) - [t for t, _, _ in known]), initial=0) < 1e-9
    assert found.status.ok


@pytest.mark.slow
def test_lugre_against_taylor_series():
    """The first swing and the ring-down after it, in which bristle rates reach 1e5 1/s."""
    found = simulate(TABLE_1, "lugre", 0.04, time=0.6, tol=1e-9)
    times, x = taylor_lugre(TABLE_1, 0.04, np.array([-1.0, 0, 0, 0]), 1.0, 0.6)
    ours = [e.time for e in found.events if e.name == "reversal"]
    assert len(ours) == len(times) >= 5
    assert np.max(np.abs(np.array(ours) - times)) < 1e-9
    assert np.max(np.abs(found.end - x) / np.array([1, 1, 1, 1e-5])) < 1e-8


@pytest.mark.parametrize("model", ["switch", "lugre"])
@pytest.mark.parametrize("tol", [1e-4, 1e-6])
def test_error_estimate_is_honest(model, tol):
    """The true errors, against a motion at 1e-9, are within the estimate, and that within the tolerance."""
    found, fine = regulator(model, tol, 30.0), regulator(model, 1e-9, 30.0)
    assert found.status is fine.status is Status.CONVERGED
    assert [e.name for e in found.events] == [e.name for e in fine.events]
    true = max(abs(a.time - b.time) for a, b in zip(found.events, fine.events, strict=True))
    assert true <= found.time_error + 2e-9 and found.time_error <= tol
    t = np.linspace(0, 30, 7001)
    errors = np.max(np.abs(found.sample(t) - fine.sample(t)), axis=1)
    # The estimate is the largest difference at points of the mesh, not at these times.
    assert (errors <= 3 * found.state_errors + 1e-8).all()
    assert found.end_error <= tol


def test_stick_is_its_closed_form():
    """Stuck beside the set point: m falls by ki x1 each second, breakaway where it meets -Fs."""
    kp, _, ki = TABLE_1.torque_gains(0.04)
    found = simulate(TABLE_1, "switch", 0.04, set_point=0.1, time=20.0, integral=0.05)
    x1, x3 = -0.1, 0.05
    wait = (-(kp * x1 + ki * x3) - 0.53) / (ki * x1)
    first = found.events[0]
    assert (first.name, first.before, first.after) == ("breakaway+", "stick", "slip+")
    assert first.time == pytest.approx(wait, rel=1e-12)
    t = np.linspace(0, wait, 11)
    assert found.sample(t)[0] == pytest.approx(np.full(11, x1), abs=1e-15)
    assert found.sample(t)[2] == pytest.approx(x3 + t * x1, abs=1e-14)
    assert found.signal("torque", np.array([wait]))[0] == pytest.approx(0.53, rel=1e-12)
    # A motion that ends in a stick ends at the time asked for.
    short = simulate(TABLE_1, "switch", 0.04, set_point=0.1, time=wait / 2, integral=0.05)
    assert short.times[-1] == wait / 2 and not short.events
    assert short.end[2] == pytest.approx(x3 + wait / 2 * x1, abs=1e-15)
    assert short.verdict.kind == "hunting" and short.verdict.waits == pytest.approx(wait / 2, rel=1e-9)


def test_slip_with_coulomb_friction_is_its_closed_form():
    """Fs = Fc: a slip is a linear system with a constant force, x = x* + exp(A t)(x0 - x*)."""
    gain, f = 0.04, COULOMB.friction
    kp, kd, ki = COULOMB.torque_gains(gain)
    J = COULOMB.inertia
    A = np.array([[0, 1, 0], [-kp / J, -(kd + f.viscous) / J, -ki / J], [1, 0, 0]])
    star = np.linalg.solve(A, [0, f.coulomb / J, 0])
    values, vectors = np.linalg.eig(A)
    found = simulate(COULOMB, "switch", gain, time=10.0, tol=1e-9)
    start = np.array([-1.0, 0, 0])
    stop = found.events[0]
    assert stop.name == "stop"
    for t in np.linspace(0, stop.time, 9):
        exact = star + (vectors @ (np.exp(values * t) * np.linalg.solve(vectors, start - star))).real
        assert found.sample(np.array([t]))[:, 0] == pytest.approx(exact, abs=1e-9)


def test_samples_are_continuous_and_meet_the_mesh():
    found = regulator("lugre", 1e-6, 30.0)
    assert found.sample(found.times) == pytest.approx(found.states, abs=1e-9)
    inner = found.times[1:-1]
    before = found.sample(inner * (1 - 1e-15))
    assert np.max(np.abs(before - found.sample(inner))[:3]) < 1e-8
    for outside in (-1e-9, 30.001, math.nan):
        with pytest.raises(InputError, match="must lie between 0 and 30"):
            found.sample(np.array([1.0, outside]))


def test_tolerance_that_rounding_forbids_is_not_claimed():
    found = simulate(TABLE_1, "lugre", 0.04, time=30.0, tol=1e-12)
    assert found.status is Status.TOLERANCE_NOT_REACHED
    assert 1e-12 < found.error_estimate < 1e-8


@pytest.mark.parametrize("gain", [0.6, 0.8])
def test_stiff_start_of_a_high_gain(gain):
    """25 N m on a servo at rest: bristle rates of 1e5 1/s; the Switch servo gets to rest along nearly the same way."""
    stiff, rigid = (simulate(TABLE_1, model, gain, time=20.0, tol=1e-7) for model in ("lugre", "switch"))
    assert stiff.status is rigid.status is Status.CONVERGED
    t = np.linspace(0, 20, 500)
    # The bristle gives way by g/sigma0 = 2e-5 rad, and the motion is delayed accordingly.
    assert np.max(np.abs(stiff.sample(t)[0] - rigid.sample(t)[0])) < 1e-3


# The verdict -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_the_regulator_task_ends_in_the_limit_cycle(orbit, model):
    cycle, found = orbit(model, 0.04), regulator(model)
    verdict = found.verdict
    assert verdict.kind == "hunting" and verdict.amplitude == pytest.approx(cycle.amplitude, rel=1e-5)
    assert verdict.period == pytest.approx(cycle.period, rel=1e-5)
    crossings, peaks = found.shape()
    assert 2 * np.diff(crossings[-5:]) == pytest.approx(np.full(4, cycle.period), rel=2e-9)
    assert peaks[-5:-1] == pytest.approx(np.full(4, cycle.amplitude), rel=2e-9)


@pytest.mark.parametrize(
    ("servo", "model", "gain", "kind", "more"),
    [
        (COULOMB, "switch", 0.04, "decaying", {}),  # no cycle without a drop (Bisoffi et al.)
        (COULOMB, "lugre", 0.04, "decaying", {}),
        (TABLE_1, "switch", 0.8, "at rest", {}),
        (TABLE_1, "lugre", 0.8, "at rest", {}),  # its integrator wound up, its bristles bent
        (TABLE_1, "switch", 0.04, "at rest", {"position": 1.0}),
        (TABLE_1, "lugre", 0.04, "at rest", {"position": 1.0}),
        (TABLE_1, "switch", 0.04, "hunting", {"time": 3.0}),
        (TABLE_1.replace(**{"friction.viscous": 0, "controller.lead_time": 0}), "switch", 0.1, "growing", {}),
    ],
)
def test_verdicts(servo, model, gain, kind, more):
    found = simulate(servo, model, gain, **more)
    assert found.status.ok
    assert bool(found.ended) == (kind == "growing")  # then it is not followed to the end
    assert found.verdict.kind == kind, found.verdict.sentence
    assert found.verdict.sentence


@pytest.mark.slow
def test_release_on_either_side_of_the_unstable_cycle(orbit):
    """The unstable cycle bounds the basin: a little inside the servo settles, a little outside it hunts."""
    gain = 0.4
    kp, _, ki = TABLE_1.torque_gains(gain)
    stable, unstable = orbit("switch", gain), orbit("switch", gain, "unstable")
    for factor, smaller in ((0.9, True), (1.1, False)):
        a = factor * unstable.amplitude
        found = simulate(TABLE_1, "switch", gain, set_point=0, position=-a, integral=(kp * a - 0.53) / ki, time=600.0)
        peaks = found.shape()[1]
        assert found.status.ok
        assert (peaks[-1] < 0.5 * a) == smaller
        if not smaller:
            assert found.verdict.amplitude == pytest.approx(stable.amplitude, rel=1e-2)


# Refusals --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "gain", "more", "words"),
    [
        ("swich", 0.1, {}, "did you mean 'switch'"),
        ("switch", 0, {}, "gain = 0: must be greater than 0"),
        ("switch", 0.1, {"time": 0}, "time = 0: must be greater than 0"),
        ("switch", 0.1, {"time": math.inf}, "time = inf"),
        ("switch", 0.1, {"position": math.nan}, "position = nan"),
        ("switch", 0.1, {"velocity": "fast"}, "velocity = 'fast'"),
        ("switch", 0.1, {"tol": 1e-15}, "tol = 1e-15: must lie between"),
        ("switch", 0.1, {"bristle": 1e-6}, "no bristle"),
    ],
)
def test_wrong_input(model, gain, more, words):
    with pytest.raises(InputError, match=words):
        simulate(TABLE_1, model, gain, **more)


def test_a_servo_without_its_friction_model_or_gain_says_how_it_is_asked():
    loop = loop_of(TABLE_1, "switch", 0.1)
    for verb in (simulate, find_orbit, basin, equilibria):
        for asked in ((), ("switch",), (None, 0.1)):
            with pytest.raises(InputError, match=r'must be given with a Servo, such as \(servo, "switch", 0.04\)'):
                verb(TABLE_1, *asked)
        with pytest.raises(InputError, match="a loop has its friction as a part"):
            verb(loop, "lugre")
    with pytest.raises(InputError, match="a loop has its friction as a part"):
        find_fold(loop, "lugre")
    for wrong in ({"vary": "static"}, {"start": {"x1": -0.1}}):
        with pytest.raises(InputError, match="vary, start: must be left out with a Servo"):
            find_orbit(TABLE_1, "switch", 0.1, **wrong)


def test_a_loop_whose_numbers_no_servo_has_is_none():
    """Without integral action it stops where kp |x1| is below static friction, for good."""
    loop = loop_of(TABLE_1, "switch", 0.04).replace(ki=0.0)
    assert servo_of_loop(loop) is None and servo_of_loop(loop.replace(ki=1.0)) is not None
    found = simulate(loop, time=20.0)
    kp = TABLE_1.torque_gains(0.04)[0]
    assert found.verdict.kind == "at rest" and kp * abs(found.end[0]) < 0.53 and other_end(found) is None
    with pytest.raises(ComesToRest):
        find_orbit(loop)


def test_a_motion_is_cut_short_only_where_it_is_seen_to_grow(monkeypatch):
    """Asked at every event, a motion that hunts or rests goes on; and one of two runs cut short is no other's error."""
    monkeypatch.setattr(searching, "THROWN_OUT", 1e-3)
    for gain in (0.04, 0.8):
        found = simulate(TABLE_1, "switch", gain, time=20.0)
        assert found.ended == "" and found.duration == 20.0
    monkeypatch.undo()
    real, runs = _Runs.__call__, []

    def one_cut(self, tau):
        runs.append(tau)
        return replace(real(self, tau), ended="" if len(runs) % 2 else "cut short")

    monkeypatch.setattr(_Runs, "__call__", one_cut)
    found = simulate(TABLE_1, "switch", 0.04, time=5.0)
    assert found.end_error == math.inf and found.status is Status.TOLERANCE_NOT_REACHED


def test_two_runs_that_are_two_motions_know_no_time(monkeypatch, capsys):
    """The finer runs begin elsewhere: events without a partner, and states that differ."""
    real, runs = _Runs.__call__, []

    def elsewhere(self, tau):
        runs.append(tau)
        other = _Runs(self.loop, {**self.start, "x1": self.start["x1"] * (1 - 0.3 * (len(runs) % 2))}, self.time)
        return real(other, tau)

    monkeypatch.setattr(_Runs, "__call__", elsewhere)
    found = simulate(TABLE_1, "switch", 0.04, time=20.0)
    assert found.status is Status.TOLERANCE_NOT_REACHED and found.end_error > 1e-3 and found.time_error > 1e-3
    assert cli.main(["simulate", "--gain", "0.04", "--time", "20", "--quiet"]) == 1
    assert "not to the tolerance" in capsys.readouterr().err
    monkeypatch.setattr(searching, "_event_errors", lambda fine, coarse: np.full(len(fine[0]), np.nan))
    assert simulate(TABLE_1, "switch", 0.04, time=20.0).time_error == math.inf
    assert cli.main(["simulate", "--gain", "0.04", "--time", "20", "--quiet"]) == 1
    assert "not even its sequence of events" in capsys.readouterr().err


def test_a_march_that_fails_is_reported(monkeypatch):
    """Coarser motions are tried first; where two can be had, the tolerance is not claimed."""
    real, seen = _Runs.__call__, []

    def failing(self, tau):
        seen.append(tau)
        if tau < limit:
            raise MarchFailure("no end")
        return real(self, tau)

    monkeypatch.setattr(_Runs, "__call__", failing)
    limit = 1.0
    with pytest.raises(NoOrbit, match="the motion of switch servo cannot be followed"):
        simulate(TABLE_1, "switch", 0.04, time=5.0)
    limit = 1e-6
    found = simulate(TABLE_1, "switch", 0.04, time=5.0, tol=1e-9)
    assert found.status is Status.TOLERANCE_NOT_REACHED and 1e-9 < found.time_error < 1e-2


def test_the_largest_torque_of_a_step_is_that_of_another_integrator():
    """From rest at 1 rad the torque grows a little more before the servo comes nearer: by scipy's DOP853."""
    solve_ivp = pytest.importorskip("scipy.integrate").solve_ivp
    kp, kd, ki = TABLE_1.torque_gains(0.04)
    f = TABLE_1.friction

    def field(t, y):
        m = -(kp * y[0] + kd * y[1] + ki * y[2])
        F = f.coulomb + (f.static - f.coulomb) * np.exp(-((y[1] / f.stribeck_velocity) ** 2)) + f.viscous * y[1]
        return [y[1], (m - F) / TABLE_1.inertia, y[0]]

    run = solve_ivp(field, (0, 0.5), [-1.0, 0, 0], "DOP853", rtol=1e-10, atol=1e-12, dense_output=True)
    y = run.sol(np.linspace(0, 0.5, 20001))
    truth = np.abs(kp * y[0] + kd * y[1] + ki * y[2]).max()
    found = simulate(TABLE_1, "switch", 0.04, time=5.0)
    assert truth > kp and found.peak_torque == pytest.approx(truth, rel=1e-3)
    assert found.peak_voltage == found.peak_torque / TABLE_1.motor_gain


# The command -----------------------------------------------------------------------------------------------

KEYS = {
    "model", "gain", "set_point", "time", "tol", "verdict", "reason", "amplitude", "period", "pattern",
    "ahead", "rests_since", "position", "velocity", "integral", "bristle", "events", "time_error", "end_error",
    "state_errors",
    "status", "advice", "ended", "intervals", "wall_s", "other_end", "other_end_reason",
    "peak_torque", "peak_voltage",
}  # fmt: skip


def run(capsys, *words: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = cli.main(["simulate", *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


def test_command(capsys, tmp_path):
    table, plot = tmp_path / "m.csv", tmp_path / "m.png"
    code, out, err = run(capsys, "--gain", 0.04, "--json", "--csv", table, "--plot", plot)
    found = json.loads(out)
    assert (code, err) == (0, "") and set(found) >= KEYS and out.count("\n") == 1
    assert found["verdict"] == "hunting" and found["status"] == "converged" and found["advice"] is None
    assert found["period"] == pytest.approx(10.2814152, rel=1e-5)
    assert found["bristle"] is None and len(found["events"]) == 41
    assert found["events"][0][1:4] == ["stop", "slip+", "stick"]
    assert plot.read_bytes().startswith(b"\x89PNG")
    with table.open() as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[0]["position_rad"]) == 0.0 and rows[0]["mode"] == "slip+"
    assert float(rows[-1]["time_s"]) == 100.0 and float(rows[-1]["position_rad"]) == found["position"]
    code, out, _ = run(capsys, "--gain", 0.04)
    assert code == 0 and out.startswith("switch servo at gain 0.04 V/rad, set point 1 rad, 100 s: hunting\n")


def test_command_with_a_step_and_another_start(capsys, tmp_path):
    table = tmp_path / "m.csv"
    words = ["--gain", 0.1, "--model", "lugre", "--set-point", -0.5, "--position", 0.5, "--velocity", -0.1, "--time", 2]
    code, out, _ = run(capsys, *words, "--integral", 0.1, "--bristle", 1e-6, "--csv", table, "--step", 0.1, "--json")
    found = json.loads(out)
    with table.open() as stream:
        rows = list(csv.DictReader(stream))
    assert code == 0 and [float(row["time_s"]) for row in rows] == pytest.approx(np.arange(21) * 0.1)
    first = {key: float(value) for key, value in rows[0].items() if key != "mode"}
    begun = [first[name] for name in ("position_rad", "velocity_rad_per_s", "integral_rad_s", "bristle_rad")]
    assert begun == pytest.approx([0.5, -0.1, 0.1, 1e-6], rel=1e-15)
    kp, kd, ki = TABLE_1.torque_gains(0.1)
    assert first["torque_Nm"] == pytest.approx(-(kp * 1.0 - kd * 0.1 + ki * 0.1))
    assert float(rows[-1]["bristle_rad"]) == pytest.approx(found["bristle"])


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ([], "gain: must be given"),
        (["--gain", "0"], "gain = 0: must be greater than 0"),
        (["--gain", "0.1", "--time", "-1"], "time = -1: must be greater than 0"),
        (["--gain", "0.1", "--set-point", "far"], "set-point = 'far': must be a finite number"),
        (["--gain", "0.1", "--set-pont", "1"], "did you mean '--set-point'?"),
        (["--gain", "0.1", "--tol", "1"], "tol = 1: must lie between"),
        (["--gain", "0.1", "--step", "0.1"], "step: must be left out without --csv"),
        (["--gain", "0.1", "--csv", "a.csv", "--step", "1e-12"], "step = 1e-12: must be at least"),
        (["--gain", "0.1", "--csv", "a.txt"], "csv = 'a.txt': the name must end in .csv"),
        (["--gain", "0.1", "--plot", "a.txt"], "plot = 'a.txt'"),
    ],
)
def test_command_refuses(capsys, tmp_path, monkeypatch, words, part):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "") and part in err and err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_command_says_what_it_does_not_know(capsys):
    code, out, err = run(capsys, "--gain", 0.04, "--model", "lugre", "--time", 12, "--tol", "1e-12", "--json")
    found = json.loads(out)
    assert code == 1 and found["status"] == "tolerance_not_reached" and found["advice"] in err
