"""Regulator tasks, simulated: two steps of the set point, and a breakaway beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...axis_units import quantity
from ...results import Result
from ...servo.parts.ahead import errors_of
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import loop_asked
from ...servo.trajectory import Trajectory

STEPS_SIMULATED = (1.0, 0.1)
"""Of the step of the set point that is asked for, those that are simulated."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedTask(Result):
    """A simulated task.

    Attributes
    ----------
    friction : "nominal" or "worst".
    start : how it starts, in words.
    motion : the motion.
    """

    _quantities = (
        "friction", "start", "time = motion.duration [s]", "verdict = motion.verdict.kind",
        "reason = motion.verdict.sentence", "status = motion.status", "peak_torque = motion.peak_torque [N m]",
        "peak_voltage = motion.peak_voltage [V]",
    )  # fmt: skip

    friction: str
    start: str
    motion: Trajectory

    @property
    def hunts(self) -> bool:
        """The motion ends in a cycle or grows."""
        return self.motion.verdict.kind in ("hunting", "growing")

    @property
    def decided(self) -> bool:
        """The motion shows where it ends."""
        return self.motion.verdict.kind != "undecided" and self.motion.status.ok


def gives_way_at(servo: Any, gain: float) -> float:
    """How far beside the set point the proportional action alone is static friction [rad]."""
    return errors_of(loop_asked(servo, None, gain, usual="switch"))[0]


def stated(servo: Any, gain: float, amplitude: float, step: float) -> dict[str, dict[str, Any]]:
    """How the tasks start, in words and as `simulate` takes it: two steps of the set point, the breakaway [rad]; of a
    loop whose friction or load differs by direction, both ways.

    A loop of parts stands beside its set point with nothing wound up but what carries a load.
    """
    far, steps = quantity(amplitude, "rad", ".4g"), dict[str, dict[str, Any]]()
    loop = loop_asked(servo, None, gain, usual="switch")
    carried, ways = {"start": loop.carrying}, loop.ways
    for size in (way * part * step for part in STEPS_SIMULATED for way in ways):
        steps[f"a step of {quantity(size, 'rad', 'g')} from rest"] = carried | {"set_point": size}
    beside: dict[str, Any] = carried | {"set_point": 0.0, "position": -amplitude}
    if isinstance(servo, Loop):
        other = {f"let go {far} on its other side": beside | {"position": amplitude}}
        return steps | {f"let go {far} beside the set point": beside} | (other if len(ways) > 1 else {})
    kp, _, ki = servo.torque_gains(gain)
    brink = (kp * amplitude - servo.friction.static) / ki
    return steps | {f"breaking away {far} beside the set point": beside | {"integral": brink}}
