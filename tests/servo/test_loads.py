"""A constant load, and friction that differs by direction: against sums by hand, scipy's DOP853 and mirror images."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import Drive, basin, cli, equilibria, linear_loop, margins, simulate_sampled
from casahunt.design.tune.demands import cost_of
from casahunt.design.tune.parts_set import parts_box
from casahunt.servo.basin import let_go, pull_on
from casahunt.servo.linear.sampled_loop import Lag
from casahunt.servo.parts import (
    BY_DIRECTION,
    CLAMPING,
    INERTIA,
    INTEGRATOR,
    LEAK,
    LOADS,
    LUGRE,
    PID_BY_TIMES,
    SWITCH,
    Loop,
    series,
    transfer_function,
)
from casahunt.views.explore.numbers import friction_curve

J, VS, TAU = 0.026, 0.02, 1 / (2 * math.pi)
LOPSIDED = {"static": 0.53, "static_back": 0.5, "coulomb": 0.44, "coulomb_back": 0.42, "viscous": 0.1,
            "viscous_back": 0.13}  # fmt: skip
ALIKE = {"static_back": 0.53, "coulomb_back": 0.44, "viscous_back": 0.1}


def mirrored(values):
    """The same axis, seen from the other side."""
    swapped = {name: values[name.removesuffix("_back") if "_back" in name else f"{name}_back"] for name in LOPSIDED}
    return {**values, **swapped, "load_torque": -values.get("load_torque", 0.0)}


def axis(friction=BY_DIRECTION, **values):
    return Loop((INERTIA, friction, PID_BY_TIMES, INTEGRATOR, LOADS), {"gain": 0.1, **values})


def swing(x1, gain, friction, load):
    """Where the axis stops that breaks away at x1, by DOP853."""
    K = 16 * gain
    kp, kd, ki = 2 * K, K * TAU, K / TAU
    sign = -math.copysign(1, x1)
    static, coulomb, viscous = friction[sign]

    def field(t, x):
        F = sign * (coulomb + (static - coulomb) * math.exp(-((x[1] / VS) ** 2))) + viscous * x[1]
        return [x[1], (-kp * x[0] - kd * x[1] - ki * x[2] - load - F) / J, x[0]]

    def stops(t, x):
        return sign * x[1] if t > 0 else 1.0

    stops.terminal, stops.direction = True, -1
    x3 = (-kp * x1 - load - sign * static) / ki
    # At breakaway the net torque is zero and grows: at first x1''' = -ki x1/J
    h, jerk = 1e-4, -ki * x1 / J
    start = [x1 + jerk * h**3 / 6, jerk * h**2 / 2, x3 + x1 * h]
    found = solve_ivp(field, (0, 10), start, "DOP853", events=stops, rtol=1e-12, atol=1e-18)
    x = found.y_events[0][0]
    stuck = -kp * x[0] - ki * x[2] - load
    assert -friction[-1][0] <= stuck <= friction[1][0]
    return x[0]


def border_of(gain, values, load):
    """The nearer start, of either side, between those whose swings die out and those whose swings grow."""
    friction = {+1: [values[name] for name in ("static", "coulomb", "viscous")],
                -1: [values[f"{name}_back"] for name in ("static", "coulomb", "viscous")]}  # fmt: skip

    def grows(x1):
        first = abs(x1)
        while first / 10 < abs(x1) < 10 * first:
            x1 = swing(x1, gain, friction, load)
        return abs(x1) > first

    def border(side):
        low, high = 1e-4, 1e-3
        assert grows(side * high) and not grows(side * low)
        while high - low > 1e-7 * high:
            low, high = (low, (low + high) / 2) if grows(side * (low + high) / 2) else ((low + high) / 2, high)
        return (low + high) / 2

    return min(border(-1), border(+1))


@pytest.mark.parametrize("values", [{**LOPSIDED, **ALIKE}, LOPSIDED])
def test_a_constant_load_leaves_the_border_where_it_is(values):
    """By DOP853, whose field has the load in it, and to rounding of two motions the same without it."""
    found = basin(axis(**values))
    assert found.confirmed
    borders = [border_of(0.1, values, load) for load in (0.0, 1.0)]
    assert borders[0] == pytest.approx(borders[1], rel=1e-6)
    for load in (0.0, 1.0, -1.0):
        loaded = basin(axis(**values, load_torque=load))
        assert loaded.border == pytest.approx(found.border, rel=1e-6) and loaded.side == found.side
        assert loaded.border == pytest.approx(borders[0], rel=1.1 * found.error_estimate)
    other = basin(axis(**mirrored({**values, "load_torque": 1.0})))
    assert other.border == pytest.approx(found.border, rel=2 * found.error_estimate)
    assert other.side == -found.side or values["static"] == values["static_back"]


@pytest.mark.parametrize("load", [0.0, 1.0, -40.0])
@pytest.mark.parametrize("more", [(), (series("low-pass"),), (CLAMPING,), (LEAK,)])
def test_a_start_at_rest_is_pulled_by_what_it_was_meant_to_be(load, more):
    """Wound up is what carries the load, whatever filters the torque: near by, the pull is that of kp alone."""
    loop = axis(**LOPSIDED, load_torque=load).with_parts(*more)
    if CLAMPING in more:
        loop = loop.replace(torque_limit=60.0)
    if LEAK in more:
        loop = loop.replace(leak=0.1)
    for x1 in (-0.01, 0.0, 0.01):
        start, at = let_go(loop, x1)
        assert pull_on(loop, at) == pytest.approx(-3.2 * x1, abs=1e-9)
        assert start["x3"] == pytest.approx(-load / (1.6 / TAU), rel=1e-9)
        assert "stick" in at[0]


def test_a_start_far_away_is_held_by_nine_tenths_of_its_direction(monkeypatch):
    """Behind a filter and a limit, below and above."""
    seen = []
    monkeypatch.setattr("casahunt.servo.basin.fate", lambda loop, start, *_, **__: seen.append((loop, start)) or 1 / 0)
    from casahunt.servo.basin import Swing, _Motions

    for more in ((), (series("low-pass"),), (CLAMPING,)):
        loop = axis(**LOPSIDED, load_torque=0.3).with_parts(*more)
        loop = loop.replace(torque_limit=1.0) if CLAMPING in more else loop
        for x1, pull in ((-5.0, 0.9 * 0.53), (5.0, -0.9 * 0.5)):
            with pytest.raises(ZeroDivisionError):
                _Motions(loop, Swing({}, 1.0, 1.0)).follow(x1)
            _, start = seen.pop()
            at = loop.mode_at(**start), np.array(list(start.values()))[:, None]
            assert pull_on(loop, at) == pytest.approx(pull, rel=1e-9) and "stick" in at[0]


def test_a_controller_that_integrates_in_a_state_of_its_own_carries_a_load():
    """The whole PID as one transfer function, with a filtered derivative."""
    kp, ki, kd, T = 2.0, 2 * math.pi, TAU, 0.01
    whole = transfer_function([kd + kp * T, kp + ki * T, ki], [T, 1.0, 0.0])
    loop = Loop((INERTIA, SWITCH, whole, LOADS), {"gain": 0.04, "load_torque": 1.3})
    assert pull_on(loop, let_go(loop, -0.01)[1]) == pytest.approx(0.04 * 16 * kp * 0.01, rel=1e-9)
    alone = transfer_function([0.2, 2.0], [0.01, 1.0])
    proportional = Loop((INERTIA, SWITCH, alone, LOADS), {"gain": 0.04, "load_torque": 0.3})
    assert not any(proportional.at_rest(0.0).values())  # nothing can carry it


def test_rest_sets_by_hand_and_in_a_mirror(tmp_path, capsys):
    """-static_back <= -kp x1 - ki x3 - load <= static: the range of x3 at x1 = 0; with the load carried, that of x1."""
    kp, ki = 3.2, 1.6 / TAU
    loop = axis(**LOPSIDED, load_torque=1.0)
    found, other = equilibria(loop), equilibria(axis(**mirrored({**LOPSIDED, "load_torque": 1.0})))
    assert found.ranges["x3"] == pytest.approx((-1.53 / ki, -0.5 / ki), rel=1e-12)
    assert found.position_limits == pytest.approx((0.53 / kp, 0.5 / kp), rel=1e-12)
    assert other.ranges["x3"] == pytest.approx((0.5 / ki, 1.53 / ki), rel=1e-12)
    assert other.position_limits == pytest.approx(found.position_limits[::-1], rel=1e-12)
    assert found.position_limit == other.position_limit == min(found.position_limits)
    path = tmp_path / "axis.toml"
    parts = '[loop]\nparts = ["one inertia", "{}", "PID by times", "integrator", "loads"]\n[values]\ngain = 0.1\n'
    numbers = "".join(f"{name} = {value}\n" for name, value in LOPSIDED.items())

    def said(friction, more, *options):
        path.write_text(parts.format(friction) + more)
        assert cli.main(["equilibria", str(path), *options]) == 0
        return " ".join(capsys.readouterr().out.split())

    answer = said("Switch friction by direction", f"{numbers}load_torque = 1.0\n", "--details")
    assert "with any integral of the error from -0.1522 to -0.04974 rad s" in answer
    assert "an integral that carries the load, holds it up to 0.1656 rad (9.49 degrees) below and 0.1562 rad" in answer
    assert "-0.5 <= m - load <= 0.53 N m: with nothing but for the load wound up -0.165625 rad <= x1 <=" in answer
    answer = said("Switch friction", "load_torque = 1.0\n")
    assert "from -0.1522 to -0.04675 rad s" in answer and "carries the load, holds it up to 0.1656 rad" in answer
    answer = said("Switch friction", "")
    assert "up to 0.05272 rad s" in answer and "friction alone holds it up to 0.1656 rad (9.49 degrees) away" in answer


def test_the_linear_loop_of_each_direction(tmp_path, capsys):
    """That of a motion back has the poles of its own viscous friction; margins and stability hold in both."""
    loop, roots = axis(**LOPSIDED), {}
    kp, kd, ki = 3.2, 1.6 * TAU, 1.6 / TAU
    for name, viscous in (("forwards", 0.1), ("back", 0.13)):
        roots[name] = np.sort_complex(np.roots([J, kd + viscous, kp, ki]))
        found = linear_loop(loop, back=name == "back")
        assert found.direction == name and np.sort_complex(found.poles) == pytest.approx(roots[name], rel=1e-9)
    plain = [margins(axis(SWITCH, viscous=viscous)) for viscous in (0.1, 0.13)]
    for each in (loop, axis(**mirrored(LOPSIDED))):
        assert margins(each).phase_margin == pytest.approx(min(m.phase_margin for m in plain), rel=1e-12)
    # without viscous friction, below the lowest stable gain, a single direction is unstable
    for values in ({"viscous": 0.0, "viscous_back": 0.2}, {"viscous": 0.2, "viscous_back": 0.0}):
        one_way = axis(gain=0.01, **values)
        assert equilibria(one_way).linear_stable is False and not margins(one_way).stable
        assert math.isnan(margins(one_way).lowest_factor) and math.isnan(margins(one_way).highest_factor)
    path = tmp_path / "axis.toml"
    path.write_text('[loop]\nparts = ["one inertia", "Switch friction by direction", "PID by times", "integrator"]\n'
                    "[values]\ngain = 0.1\nviscous_back = 0.13\n[drive]\nsample_time = 0.002\n")  # fmt: skip
    assert cli.main(["loop", str(path), "--json", "--plot", str(tmp_path / "loop.png")]) == 0
    record = json.loads(capsys.readouterr().out)
    assert [each["direction"] for each in record["loops"]] == ["forwards", "back"]
    assert len(record["as_built"]["margins"]) == 2
    assert cli.main(["loop", str(path)]) == 0
    answer = " ".join(capsys.readouterr().out.split())
    assert all(f"viscous friction of a motion {way}: stable" in answer for way in roots)


def test_the_friction_curve_of_the_page_has_both_directions():
    """Seen from the other side it is turned round."""
    one, other = (friction_curve(axis(**each).parameters) for each in (LOPSIDED, mirrored(LOPSIDED)))
    assert [-F for F in other["torque"][::-1]] == one["torque"]
    v, F = np.array(one["velocity"]), np.array(one["torque"])
    back = v < 0
    assert F[back] == pytest.approx(-0.42 - 0.08 * np.exp(-((v[back] / VS) ** 2)) + 0.13 * v[back], rel=1e-3)


def test_a_bristle_bends_under_the_load_as_without():
    """The drive's verdict on a LuGre servo that creeps to its set point by bending bristles is that of no load."""
    kinds = {}
    for load in (0.0, 1.0):
        loop = axis(LUGRE, load_torque=load)
        drive = Drive(sample_time=1e-3)
        motion = simulate_sampled(loop, None, drive, time=2.0, set_point=0.0, start=loop.at_rest(-5e-6))
        kinds[load] = motion.verdict.kind
    assert kinds == {0.0: "at rest", 1.0: "at rest"}


def test_what_tune_asks_of_the_linear_loop_holds_in_either_direction():
    """Phase margin and settling are those of the worse one, wherever it is."""
    loops = [axis(**LOPSIDED), axis(**mirrored(LOPSIDED))]
    plain = [axis(SWITCH, viscous=viscous) for viscous in (0.1, 0.13)]
    least = min(margins(each).phase_margin for each in plain)
    for loop in loops:
        assert math.degrees(parts_box(loop, {}, Lag()).worst(0.1, (1.0, 1.0)).phase) == pytest.approx(least, rel=1e-4)
        ends = {"viscous": (0.09, 0.14), "viscous_back": (0.09, 0.14), "static": (0.5, 0.6)}
        assert set(parts_box(loop, ends, Lag()).names) == {"viscous", "viscous_back", "motor_gain"}
        slowest = max(cost_of("settling", each, 0.1) for each in plain)
        assert cost_of("settling", loop, 0.1) == pytest.approx(slowest, rel=1e-9)
