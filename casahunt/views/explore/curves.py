"""The curves of the page that no motion hands out: branches of cycles, friction, the torque along a loop's cycle.

    friction      F(v) = g(v) sgn v + sigma2 v, where it is Stribeck's
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...servo.parts import Loop
from .numbers import brief, curve
from .state import GAIN

DRAWN_SPEEDS, SPEED_POINTS = 10.0, 200
"""Of the friction curve: up to so many Stribeck velocities."""


def branches_shown(orbits: Any, fold: Any = None) -> dict[str, Any]:
    """Amplitude against gain of cycles along a branch, as two curves: attracting and not; what is not known is neither.

    fold: the first one of the branch, where it is known; it is put in if the branch goes no further up.
    """
    gains = np.array([orbit.problem.value("gain") for orbit in orbits])
    amplitudes = np.array([orbit.amplitude for orbit in orbits])
    stable = np.array([orbit.seen_stable for orbit in orbits], dtype=object)
    if fold is not None and gains.max() < fold.problem.value(GAIN):
        turn = int(np.argmax(gains))
        turn += bool(amplitudes[turn] > fold.amplitude)
        gains = np.insert(gains, turn, fold.problem.value("gain"))
        amplitudes, stable = np.insert(amplitudes, turn, fold.amplitude), np.insert(stable, turn, False)
    curves = {}
    for name, on in (("stable", stable == True), ("unstable", stable == False)):  # noqa: E712, of each one
        # where the one becomes the other the point belongs to both: the curves have no gap
        near = on | (np.roll(on, 1) & (np.arange(on.size) > 0)) if name == "stable" else on
        curves[name] = curve(gain=np.where(near, gains, np.nan), amplitude=np.where(near, amplitudes, np.nan))
    return curves


def left_open(orbits: Any) -> dict[str, Any]:
    """Where a branch goes on that was followed no further: what is shown with its curves."""
    gain, amplitude = orbits[-1].problem.value(GAIN), orbits[-1].amplitude
    where = f"gain {brief(gain)}, swing {brief(amplitude)} rad"
    why = f"unfinished beyond the cross: its cycles were followed no further than to {where}"
    return {"why": why, "unfinished": curve(gain=[gain], amplitude=[amplitude])}


def friction_curve(numbers: Any) -> dict[str, Any]:
    """Friction torque against velocity, with the jump at standstill."""
    Fs, Fc, vs = (numbers[name] for name in ("static", "coulomb", "stribeck_velocity"))
    v = np.linspace(0, DRAWN_SPEEDS * vs, SPEED_POINTS)
    F = Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2)) + numbers["viscous"] * v
    return curve(velocity=[*-v[::-1], *v], torque=[*-F[::-1], *F])


def loop_torque(loop: Loop, orbit: Any, times: Any, states: Any) -> Any:
    """Torque of the motor along a cycle of a loop, which may be closed by its mirror image (orbit.repeats = 2)."""
    ends = np.cumsum([arc.duration for arc in orbit.arcs])
    half = times.size if orbit.repeats == 1 else (times.size - 1) // 2
    of = np.searchsorted(ends, times[:half], side="right").clip(max=len(ends) - 1)
    torque = np.empty(half)
    for i, arc in enumerate(orbit.arcs):
        at = of == i
        if at.any():
            torque[at] = loop.signal("torque", arc.mode, states[:, :half][:, at])
    return torque if orbit.repeats == 1 else np.concatenate([torque, -torque, torque[:1]])
