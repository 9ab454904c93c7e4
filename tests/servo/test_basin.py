"""The border between settling and hunting: against the reference amplitudes and by the Taylor engine."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import InputError, NoOrbit, Options, Servo, cli
from casahunt.orbits import Crossings
from casahunt.servo.basin import Trial, _Motions, _of_a_loop, basin, let_go, stick_position
from casahunt.servo.parts import (
    BY_DIRECTION,
    DEAD_BAND,
    DERIVATIVE_FILTER,
    FREEZE,
    INERTIA,
    INTEGRATOR,
    PID_BY_TIMES,
    SWITCH,
    TWO_MASSES,
    Loop,
    loop_of,
    transfer_function,
)
from problems import table1
from problems.taylor import switch_half_cycle

UNSTABLE = {model: {row["K"]: row for row in table1.REFERENCE[model]["unstable"]} for model in ("switch", "lugre")}


@pytest.mark.parametrize("gain", [0.1, 0.4, 0.61])
def test_switch_border(gain):
    found = basin(Servo(), "switch", gain, options=Options(tol=1e-9))
    assert found.border == pytest.approx(UNSTABLE["switch"][gain]["amplitude"], rel=3e-9)
    assert found.confirmed and found.inside.start < found.border < found.outside.start
    for sign in (-1, 1):  # the first swing, by the independent engine
        a = found.border * (1 + sign * 0.01)
        assert (switch_half_cycle(Servo(), gain, a)[0] > a) == (sign > 0)


@pytest.mark.parametrize("gain", [0.1, 0.6])
def test_lugre_border(gain):
    """The unstable amplitude is the reference's; the stick position lies within 4 Fs/sigma0 of it."""
    found = basin(Servo(), "lugre", gain)
    assert found.unstable.amplitude == pytest.approx(UNSTABLE["lugre"][gain]["amplitude"], rel=2e-6)
    assert found.confirmed and 0 < found.unstable.amplitude - found.border < 4 * 0.53 / 2.2e4


def test_the_outer_motion_starts_half_way_to_the_outer_cycle():
    """Next to the fold both cycles are nearer to each other than the offset."""
    found = basin(Servo(), "switch", 0.64, offset=0.5)
    assert found.outer_position < 1.5 * found.border
    assert found.outside.start == pytest.approx((found.border + found.outer_position) / 2, rel=1e-12)
    assert found.inside.start == pytest.approx(0.5 * found.border, rel=1e-12) and found.confirmed


def test_a_border_is_confirmed_from_both_sides():
    found = basin(Servo(), "switch", 0.4)
    for inside, outside, confirmed in (
        ("at rest", "hunting", True), ("decaying", "growing", True), ("at rest", "decaying", False),
        ("hunting", "hunting", False), ("undecided", "hunting", False), ("at rest", "undecided", False),
    ):  # fmt: skip
        sides = {"inside": replace(found.inside, outcome=inside), "outside": replace(found.outside, outcome=outside)}
        assert replace(found, **sides).confirmed is confirmed


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_where_a_lugre_servo_is_stuck(side):
    """At the last standstill at which the torque that pulls it back comes up; not where a slip passes that torque."""

    def stuck(speeds):
        """It stands on that side, where one torque comes up four times; the other one comes up nowhere."""
        states = side * np.array([[0.03, 0.02, 0.01, 0.04], [*speeds, 1e-3], [0.0] * 4, [0.0] * 4])
        ups = Crossings(np.arange(4.0), states, np.array([1.0, 1.0, 1.0, -1.0]))
        none = Crossings(np.zeros(0), np.zeros((4, 0)), np.zeros(0))
        asked = iter([ups, none] if side < 0 else [none, ups])  # the left side first
        return SimpleNamespace(model="lugre", servo=Servo(), gain=0.1, error_estimate=0.0,
                               extrema=lambda what: SimpleNamespace(amplitude=1.0),
                               crossings=lambda what: next(asked))  # fmt: skip

    assert stick_position(stuck([0.0, 1e-3, 1.0])) == 0.02
    with pytest.raises(NoOrbit, match="does not stand still"):
        stick_position(stuck([0.5, 1.0, 1.0]))


@pytest.mark.parametrize(("gain", "dies", "grows"), [(0.04, 0.486926e-3, 0.486929e-3), (0.1, 0.612869e-3, 0.612871e-3)])
def test_the_border_of_a_lugre_servo_is_known_to_its_error(gain, dies, grows):
    """Between starts from which scipy's motions die out and grow; and to its error, whatever mesh its cycle has."""
    borders = [basin(Servo(), "lugre", gain, options=Options(tol=tol)) for tol in (1e-5, 1e-10)]
    coarse, fine = ((found.border, found.border * found.error_estimate) for found in borders)
    assert dies < fine[0] < grows and fine[1] < 1e-10 * fine[0]
    assert abs(coarse[0] - fine[0]) < 3 * (coarse[1] + fine[1]) and coarse[1] < 5e-6 * fine[0]


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.04, 0.1, 0.3])
def test_motions_of_scipy_part_at_the_border_of_a_lugre_servo(gain):
    """A part of 1e-5 of it on either side: they turn ever nearer to the set point, or ever farther off.

    Where bristles begin at rest, and the cycle creeps, a part of some 1e-6 of the place lies between the two.
    """
    border = basin(Servo(), "lugre", gain).border
    for side in (-1, 1):
        places = _swings_of_scipy(gain, border * (1 + side * 1e-5))
        assert all(side * (after - before) > 0 for before, after in pairwise(places)) and len(places) > 1
        assert side < 0 or places[-1] > 3 * border


def _swings_of_scipy(gain, a):
    """Where Table 1 stands with LuGre friction at 0.9 Fs, from one standstill to the next, by Radau IIA of scipy."""
    servo, f = Servo(), Servo().friction
    kp, kd, ki = servo.torque_gains(gain)
    level = 0.9 * f.static

    def torque(y):
        return -(kp * y[0] + kd * y[1] + ki * y[2])

    def rates(t, y):
        x, v, _, z = y
        sliding = f.coulomb + (f.static - f.coulomb) * math.exp(-((v / f.stribeck_velocity) ** 2))
        bends = v - f.stiffness * abs(v) * z / sliding
        friction = f.stiffness * z + f.damping * bends + f.viscous * v
        return [v, (torque(y) - friction) / servo.inertia, x, bends]

    def followed(y, duration, event=None):
        return solve_ivp(rates, (0, duration), y, "Radau", events=event, rtol=1e-10, atol=[1e-15, 1e-14, 1e-14, 1e-17])

    def up_to(y, function, direction):
        def event(t, y):
            return function(y)

        event.terminal, event.direction = True, direction
        motion = followed(y, 4e3, event)
        return motion.y[:, -1] if motion.t_events[0].size else None

    places, side = [a], -1  # where it stands, and on which side of the set point
    y = np.array([-a, 0.0, (kp * a - level) / ki, level / f.stiffness])
    while a / 3 < places[-1] < 3 * a:
        if (y := up_to(y, lambda y: y[0], -side)) is None:
            break
        side, y[0] = -side, -side * 1e-18
        while (y := up_to(y, lambda y, side=side: -side * torque(y) - level, 1)) is not None and abs(y[1]) > 1e-4:
            y = followed(y, 1e-3).y[:, -1]  # it slips as the torque comes up
        if y is None:
            break
        places.append(abs(y[0]))
    return places


def test_no_cycle_no_border(capsys):
    with pytest.raises(NoOrbit, match="no hunting limit cycle"):
        basin(Servo(), "switch", 0.7)
    with pytest.raises(InputError):
        basin(Servo(), "switch", 0.1, offset=0.9)
    assert cli.main(["basin", "--gain", "0.7"]) == 1
    assert cli.main(["basin"]) == 2
    capsys.readouterr()
    assert cli.main(["basin", "--gain", "0.6", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["confirmed"] and record["inside"]["outcome"] == "at rest"
    assert cli.main(["basin", "--gain", "0.6", "--details"]) == 0 and "at rest after" in capsys.readouterr().out


TWO = Loop((TWO_MASSES, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.1, "shaft_damping": 0.3})


@pytest.mark.slow
def test_the_border_of_two_masses_against_another_integrator():
    """Let go at rest a little nearer it comes nearer from stick to stick, a little farther off it swings out."""
    found = basin(TWO)
    assert found.confirmed and found.error_estimate < 1e-5 and found.unstable is None and found.motions > 10
    assert two_masses(TWO, 0.97 * found.border) < 0.5 * found.border
    assert two_masses(TWO, 1.03 * found.border) > 3 * found.border


def two_masses(loop: Loop, a: float) -> float:
    """Where the motor sticks [rad], once that is less than half of a or more than three times a: scipy's integrator,
    and the equations written out once more, from breakaway at x1 = -a with the load at rest."""
    J, JL, k, d = (loop.value(n) for n in ("inertia", "load_inertia", "shaft_stiffness", "shaft_damping"))
    Fs, Fc, vs, b = (loop.value(n) for n in ("static", "coulomb", "stribeck_velocity", "viscous"))
    K, ti, td = loop.value("gain") * loop.value("motor_gain"), loop.value("integral_time"), loop.value("lead_time")
    kp, kd, ki = K * (1 + td / ti), K * td, K / ti

    def pull(x):
        return -(kp * x[0] + kd * x[1] + ki * x[4]) - k * (x[0] - x[2]) - d * (x[1] - x[3])

    def rates(x, s):
        g = s * (Fc + (Fs - Fc) * math.exp(-((x[1] / vs) ** 2))) + b * x[1]
        motor = (x[1], (pull(x) - g) / J) if s else (0.0, 0.0)
        return [*motor, x[3], (k * (x[0] - x[2]) + d * (x[1] - x[3])) / JL, x[0]]

    x, s = np.array([-a, 0.0, -a, 0.0, (kp * a - Fs) / ki]), 1
    for _ in range(40):
        def event(t, x, s=s):
            return (x[1] if t > 1e-6 else float(s)) if s else Fs - abs(pull(x))

        event.terminal, event.direction = True, -s if s else -1
        run = solve_ivp(lambda t, x, s=s: rates(x, s), (0, 1e5), x, "DOP853", events=event, rtol=1e-9, atol=1e-13)
        x = run.y[:, -1].copy()
        if s:
            x[1] = 0.0
            if abs(x[0]) < 0.5 * a or abs(x[0]) > 3 * a:
                break
        s = (0 if abs(pull(x)) <= Fs else int(np.sign(pull(x)))) if s else int(np.sign(pull(x)))
    return abs(x[0])


@pytest.mark.slow
def test_a_loop_of_one_inertia_has_the_border_of_its_servo():
    """By motions alone, against the unstable cycle in 34 digits; on both sides, as friction is the same on both."""
    found = _of_a_loop(loop_of(Servo(), "switch", 0.4), Options())
    assert found.border == pytest.approx(UNSTABLE["switch"][0.4]["amplitude"], rel=found.error_estimate + 1e-6)
    assert found.confirmed and found.side == -1 and found.outer.amplitude > found.border
    # with bristles, where it stands differs by what it has crept on the cycle
    bristles = _of_a_loop(loop_of(Servo(), "lugre", 0.4), Options())
    assert bristles.border == pytest.approx(basin(Servo(), "lugre", 0.4).border, rel=2e-4)


@pytest.mark.slow
def test_a_dead_band_and_a_clock():
    """Inside the dead band it stays where it is; the frozen integrator holds it where it does not wind up in a dwell:
    the torque at rest is kp a, and 0.53 N m break it away after (0.53 - kp a)/(ki a) s."""
    plain = loop_of(Servo(), "switch", 0.04)
    found = basin(plain.with_parts(DEAD_BAND, dead_band=0.01))
    assert found.border == pytest.approx(0.01, rel=1e-4) and found.border > 0.01 * (1 - found.error_estimate)
    kp, _, ki = Servo().torque_gains(0.04)
    found = basin(plain.with_parts(FREEZE, dwell=8.0))
    assert found.border == pytest.approx(0.53 / (kp + ki * 8.0), rel=1e-5)


@pytest.mark.slow
def test_filters_have_settled_where_the_servo_stands():
    """A derivative with a filter, as a part and inside a controller with other states: one servo in two forms.  With
    nothing wound up the torque is kp a in both; from filters at zero the derivative would add kd a/T."""
    kp, ki, kd, T = 2.0, 2 * math.pi, 1 / (2 * math.pi), 0.01
    whole = transfer_function([kd + kp * T, kp + ki * T, ki], [T, 1.0, 0.0])
    filtered = loop_of(Servo(), "switch", 0.04).with_parts(DERIVATIVE_FILTER, derivative_filter=T)
    loops = filtered, Loop((INERTIA, SWITCH, whole), {"gain": 0.04})
    for loop in loops:
        torque = loop.signal("torque", *let_go(loop, -0.01)[1])[0]
        assert torque == pytest.approx(0.04 * 16 * kp * 0.01, rel=1e-12)
    found, other = (basin(loop) for loop in loops)
    assert found.border == pytest.approx(other.border, rel=found.error_estimate + other.error_estimate)
    assert found.confirmed


@pytest.mark.slow
def test_friction_by_direction_is_looked_at_on_both_sides():
    """With less static friction on the way back it breaks away more easily above the set point."""
    loop = Loop((INERTIA, BY_DIRECTION, PID_BY_TIMES, INTEGRATOR), {"gain": 0.1, "static_back": 0.5})
    found, turned = basin(loop), basin(loop.replace(static=0.5, static_back=0.53))
    assert found.confirmed and {found.side, turned.side} == {-1, 1}
    assert found.border == pytest.approx(turned.border, rel=2 * found.error_estimate)


@pytest.mark.slow
def test_what_settles_from_nowhere_or_everywhere(capsys, tmp_path, monkeypatch):
    """Below the fold gain the servo hunts, above it comes to rest from every start."""
    path = tmp_path / "loop.toml"
    parts = '[loop]\nparts = ["one inertia", "Switch friction", "PID by times", "integrator", "loads"]\n[values]\n'
    path.write_text(f"{parts}gain = 0.7\n")
    assert cli.main(["basin", str(path)]) == 1
    assert "comes to rest from each of 13 starts" in " ".join(capsys.readouterr().err.split())
    assert cli.main(["basin", str(path), "--gain", "0.5", "--json", "--plot", str(tmp_path / "p.png")]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["border"] == pytest.approx(basin(Servo(), "switch", 0.5).border, rel=1e-5)
    assert record["parts"][0] == "one inertia" and record["confirmed"]
    assert cli.main(["basin", str(path), "--gain", "0.5", "--details"]) == 0
    assert "motions from rest" in " ".join(capsys.readouterr().out.split())
    monkeypatch.setattr(_Motions, "follow", lambda _, x1: Trial(abs(x1), np.array([abs(x1)]), "hunting"))
    with pytest.raises(NoOrbit, match=r"no border of coming to rest .* of 19 starts at rest, .*, 19 hunt"):
        _of_a_loop(loop_of(Servo(), "switch", 0.5), Options())
    with pytest.raises(InputError, match="a loop has its friction as a part"):
        basin(TWO, "switch", 0.1)


def test_a_loop_that_is_a_servo_has_its_border():
    for model in ("switch", "lugre"):
        found, servo = basin(loop_of(Servo(), model, 0.4)), basin(Servo(), model, 0.4)
        assert found.border == pytest.approx(servo.border, rel=found.error_estimate + servo.error_estimate)
        assert found.unstable is not None and found.confirmed
