"""Two masses with Switch friction of the motor under a PID controller, by scipy's DOP853 with events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

FOR_EVER = 50.0
"""Stuck for so long [s] the integrator and the shaft have settled."""


def stops(
    p: Mapping[str, float], start: float | np.ndarray, most: int, step: float = 0.0, load_seen: bool = False
) -> list[Any]:
    """(time, place) at which the motor stops, until it is stuck for ever; with a step [s] its pieces (times, states).

    start: where it stands still beside its set point, or its five states where it sticks.
    """
    pieces = []
    kp, ki, kd = (p["gain"] * p["motor_gain"] * p[name] for name in ("kp", "ki", "kd"))

    def rates(t, y, sign):
        x, v, load, rate, sum_ = y
        at, speed = (load, rate) if load_seen else (x, v)
        shaft = p["shaft_stiffness"] * (x - load) + p["shaft_damping"] * (v - rate)
        drop = (p["static"] - p["coulomb"]) * np.exp(-((v / p["stribeck_velocity"]) ** 2))
        net = -(kp * at + kd * speed + ki * sum_) - shaft - sign * (p["coulomb"] + drop) - p["viscous"] * v
        load_net = shaft - p.get("load_damping", 0.0) * rate
        return [v, net / p["inertia"] if sign else 0.0, rate, load_net / p["load_inertia"], at]

    def pull(y):
        return p["inertia"] * rates(0.0, y, 1e-300)[1]  # without dry friction, at standstill

    y, time, sign, found = np.array([start, 0.0, start, 0.0, 0.0]) if np.isscalar(start) else start, 0.0, 0.0, []
    while len(found) < most:
        if sign:
            events = [lambda t, y, sign: sign * y[1] if t > 0 else 1.0]
        else:
            events = [lambda t, y, sign, s=s: s * pull(y) - p["static"] for s in (1, -1)]
        for event in events:
            event.terminal, event.direction = True, -1.0 if sign else 1.0
        run = solve_ivp(
            rates, (0, FOR_EVER), y, "DOP853", events=events, args=(sign,), rtol=1e-9, atol=1e-12,
            dense_output=bool(step),
        )  # fmt: skip
        if step:
            times = np.append(np.arange(0.0, run.t[-1], step), run.t[-1])
            pieces.append((time + times, run.sol(times)))
        y, time = run.y[:, -1], time + run.t[-1]
        if run.status == 0:
            break
        if sign:
            y[1] = 0.0
            found.append((time, float(y[0])))
        m = pull(y)
        sign = float(np.sign(m)) if not sign or abs(m) > p["static"] else 0.0
    return pieces if step else found


def recorded(
    p: Mapping[str, float], start: float, stopped: int, step: float, load_seen: bool = False
) -> tuple[Any, Any]:
    """Times [s] and the positions that the controller sees, of a motion from rest to so many stops."""
    pieces = stops(p, start, stopped, step / 10, load_seen)
    times, states = np.concatenate([t for t, _ in pieces]), np.concatenate([x[2 * load_seen] for _, x in pieces])
    even = np.arange(0.0, times[-1], step)
    return even, np.interp(even, times, states)
