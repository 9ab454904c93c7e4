"""A clamped integrator whose command slides along the torque limit, against scipy with a law made by hand.

    c = -(kp e + kd r + ki x3) stands still where x3' = -(kp e' + kd r')/ki, which lies between its rates off and on
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import simulate
from casahunt.servo.parts import (
    CLAMPING,
    DEAD_BAND,
    DERIVATIVE_FILTER,
    ERROR_FILTER,
    INERTIA,
    INTEGRATOR,
    LEAK,
    P_PI,
    PID_BY_GAINS,
    RESET_AT_STOP,
    SWITCH,
    TORQUE_LIMIT,
    TWO_MASSES,
    Loop,
    series,
    state_space,
)
from casahunt.servo.parts.verbs import loop_cycle

J, CM, FS, FC, VS, SIGMA2 = 0.026, 16.0, 0.53, 0.44, 0.02, 0.1
KP, KI, KD = 2.0, 2 * math.pi, 1 / (2 * math.pi)
TOL = 1e-12
PLAIN = INERTIA, SWITCH, PID_BY_GAINS, INTEGRATOR
HALVES = {"inertia": J / 2, "load_inertia": J / 2, "shaft_damping": 0.2}


class Clamped:
    """The servo of Table 1, its states those of the loop: by name."""

    def __init__(self, states, values):
        self.states, self.v = states, {"gain": 0.04, "leak": 0.0, "dead_band": 0.0, "inertia": J, **values}

    def named(self, y):
        return dict(zip(self.states, y, strict=True))

    def command(self, y):
        s, v, gain = self.named(y), self.v, self.v["gain"] * CM
        e, rate = s["x1"], s["x2"]
        if "filtered" in s:
            e, rate = s["filtered"], (e - s["filtered"]) / v["filter_time"]
        if "lagging" in s:
            rate = (e - s["lagging"]) / v["derivative_filter"]
        return -gain * (KP * e + KD * rate + KI * s["x3"])

    def shaft(self, s):
        if "load_rate" not in s:
            return 0.0
        return 100.0 * (s["x1"] - s["load_angle"]) + HALVES["shaft_damping"] * (s["x2"] - s["load_rate"])

    def rates(self, y, sign, how="on"):
        """y' of a slip with this sign, or stuck (0); how the integrator is: on, off or sliding."""
        s, v, f = self.named(y), self.v, {}
        m = min(max(self.command(y), -v["torque_limit"]), v["torque_limit"])
        friction = sign * (FC + (FS - FC) * math.exp(-((s["x2"] / VS) ** 2))) + SIGMA2 * s["x2"]
        f["x1"] = s["x2"] if sign else 0.0
        f["x2"] = (m - self.shaft(s) - friction) / v["inertia"] if sign else 0.0
        e, of_e, of_r = s["x1"], f["x1"], f["x2"]
        if "filtered" in s:
            e, of_e = s["filtered"], (s["x1"] - s["filtered"]) / v["filter_time"]
            f["filtered"], of_r = of_e, (f["x1"] - of_e) / v["filter_time"]
        if "lagging" in s:
            f["lagging"] = (e - s["lagging"]) / v["derivative_filter"]
            of_r = (of_e - f["lagging"]) / v["derivative_filter"]
        if "load_rate" in s:
            f["load_angle"], f["load_rate"] = s["load_rate"], self.shaft(s) / HALVES["load_inertia"]
        off = -v["leak"] * s["x3"]
        on = off + e * (abs(e) > v["dead_band"])
        f["x3"] = {"on": on, "off": off, "slides": -(KP * of_e + KD * of_r) / KI}[how]
        self.share = (f["x3"] - off) / (on - off) if on != off else math.nan
        return [f[name] for name in self.states]

    def to(self, event, y, sign, how="on"):
        """(state, time) where a function falls through zero."""
        event.terminal, event.direction = True, -1
        way = solve_ivp(lambda t, y: self.rates(y, sign, how), (0, 1e3), y, "DOP853", events=event, rtol=TOL, atol=TOL)
        return way.y[:, -1], way.t[-1]

    def half(self, y):
        """From stop to stop of symmetric hunting, sliding once: (mirrored state, time)."""
        x2, limit = self.states.index("x2"), self.v["torque_limit"]
        y, waits = self.to(lambda t, y: FS - abs(self.command(y) - self.shaft(self.named(y))), y, 0)
        sign = math.copysign(1.0, self.command(y))
        y, before = self.to(lambda t, y: limit - sign * self.command(y), y, sign)

        def lets_go(t, y):
            self.rates(y, sign, "slides")
            return 1 - self.share

        assert 0 < 1 - lets_go(0, y) < 1
        y, slides = self.to(lets_go, y, sign, "slides")
        y, behind = self.to(lambda t, y: sign * y[x2], y, sign)
        y[x2] = 0.0
        return -y, waits + before + slides + behind

    def multiplier(self, y, off=1e-3):
        """The largest of half a cycle, by differences."""
        moved, columns = [k for k, name in enumerate(self.states) if name != "x2"], []
        for k in moved:
            step = np.zeros(len(y))
            step[k] = off * max(abs(y[k]), 1e-2)
            columns.append((self.half(y + step)[0] - self.half(y - step)[0])[moved] / (2 * step[k]))
        values = np.linalg.eigvals(np.array(columns).T)
        return values[np.argmax(np.abs(values))].real


@pytest.mark.parametrize(("parts", "values"), [
    (PLAIN, {"torque_limit": 1.002 * FS}),
    ((*PLAIN, LEAK), {"torque_limit": 1.0005 * FS, "leak": 0.05}),
    ((*PLAIN, DERIVATIVE_FILTER), {"torque_limit": 1.002 * FS, "derivative_filter": 0.01}),
    ((*PLAIN, ERROR_FILTER), {"torque_limit": 1.002 * FS, "filter_time": 0.002}),
    ((*PLAIN, DEAD_BAND), {"torque_limit": 1.002 * FS, "dead_band": 0.002}),
    pytest.param(
        (TWO_MASSES, SWITCH, P_PI, INTEGRATOR), {"torque_limit": 1.002 * FS, **HALVES}, marks=pytest.mark.slow
    ),
])  # fmt: skip
def test_a_cycle_that_slides_along_its_limit(parts, values):
    """Its period, that it closes, and its multiplier."""
    loop = Loop((*parts, CLAMPING), {**values, "gain": 0.1})
    cycle = loop_cycle(loop)
    assert any("along" in arc.mode for arc in cycle.arcs)
    peer = Clamped(loop.system.states, loop.parameters)
    start = next(arc for arc in cycle.arcs if "stick" in arc.mode).states[0, 0]
    again, time = peer.half(start)
    assert time == pytest.approx(cycle.period / 2, rel=1e-8)
    assert again == pytest.approx(start, rel=1e-8, abs=1e-9)
    assert peer.multiplier(start) == pytest.approx(cycle.multipliers.leading, abs=1e-4)


def switched(loop, y, duration, reset, h=2e-5):
    """The end of a motion in steps of Euler, whose integrator is switched by the command at each step's start."""
    peer, y, sign = Clamped(loop.system.states, loop.parameters), np.array(y), math.copysign(1.0, y[1])
    limit = peer.v["torque_limit"]
    for _ in range(round(duration / h)):
        how = "off" if CLAMPING in loop.parts and abs(peer.command(y)) >= limit else "on"
        if not sign:
            m = min(max(peer.command(y), -limit), limit)
            sign = math.copysign(1.0, m) if abs(m) > FS else 0.0
        y = y + h * np.array(peer.rates(y, sign, how))
        if sign * y[1] < 0:
            y[1], y[2], sign = 0.0, reset * y[2], 0.0
    return y


@pytest.mark.parametrize(("more", "limit", "start", "through"), [
    ({}, 0.6, (-1.5, -0.3), ["slip-, along upper limit", "slip+, along upper limit"]),
    ({}, 0.5, (-1.5, -0.3), ["slip-, along upper limit", "stick, at upper limit"]),  # Fs = 0.53
    ({"dead_band": 1.0}, 0.6, (-1.05, 0.3), ["slip+, along upper limit", "slip+, inside"]),
    ({"reset_at_stop": 0.5}, 0.6, (-0.1, -0.3, -0.4), ["slip-, at upper limit", "slip+, at upper limit", "slip+"]),
    ({"reset_at_stop": -1.9}, 0.6, (-0.1, -0.1, -0.2), ["slip-, at upper limit", "slip-, at lower limit"]),
])  # fmt: skip
@pytest.mark.parametrize("limits", [CLAMPING, TORQUE_LIMIT])
def test_where_the_events_of_other_parts_lead_at_a_limit(limits, more, limit, start, through):
    """A start of two numbers is on the limit."""
    parts = (*PLAIN, *({"dead_band": DEAD_BAND, "reset_at_stop": RESET_AT_STOP}[name] for name in more), limits)
    loop = Loop(parts, {"torque_limit": limit, **more})
    gain = loop.value("gain") * CM
    y = [*start, -(limit / gain + KP * start[0] + KD * start[1]) / KI][:3]
    motion = simulate(loop, set_point=0.0, time=0.4, start=dict(zip(("x1", "x2", "x3"), y, strict=True))).motion
    if limits is CLAMPING:
        assert [phase.mode for phase in motion.phases] == through
    peer = switched(loop, y, 0.4, more.get("reset_at_stop", 1.0))
    assert motion.phases[-1].end == pytest.approx(peer, abs=2e-4)


@pytest.mark.parametrize("controller", [
    (PID_BY_GAINS, INTEGRATOR, series("low-pass")), (state_space([[0]], [[1]], [[6.28]], [[2]]),),
])  # fmt: skip
def test_nothing_slides_where_the_integrator_does_not_move_the_command_at_once(controller):
    system = Loop((INERTIA, SWITCH, *controller, CLAMPING), {"torque_limit": 0.6}).system
    assert not any("along" in mode.name for mode in system.modes)
