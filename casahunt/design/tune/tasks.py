"""Regulator tasks, simulated until they are decided.

A servo stuck at x1 beside its set point, with the torque m, breaks away after (m + sgn(x1) Fs)/(ki x1) [s]: what it
does then belongs to the task.  So an undecided motion is simulated again, longer, within limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import NoOrbit
from ...results import Result
from ...servo.hunting import Model
from ...servo.servo import Servo
from ...servo.simulation.simulate import simulate
from ...servo.simulation.trajectory import Trajectory

TASK_STEPS = (1.0, 0.1)
"""Sizes [rad] of the steps of the set point."""
LONGER, MOST_LONGER = 2.0, 14
"""An undecided task is simulated again, this many times longer, so many times."""
AFTER_BREAKAWAY = 1.25
"""Part of the time until a stuck servo breaks away that is simulated: what it does then shows behind it."""
MOST_TASK_INTERVALS = 20_000
"""Intervals of a motion from which it is not simulated any longer."""


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


def until_decided(servo: Servo, model: Model, gain: float, span: float, start: Mapping[str, float]) -> Trajectory:
    """A motion, simulated until its verdict is decided, within limits.

    servo, model, gain: the problem; gain K > 0 [V/rad]; span: first length [s]; start: initial values, as `simulate`
    takes them. Returns trajectory over `span`, or over as much longer as its verdict takes; perhaps still undecided.
    Raises NoOrbit: not even the first length could be computed.
    """
    values: dict[str, Any] = dict(start)
    motion = simulate(servo, model, gain, time=span, **values)
    for _ in range(MOST_LONGER):
        if motion.verdict.kind != "undecided" or motion.ended or motion.times.size > MOST_TASK_INTERVALS:
            break
        span = max(LONGER * span, AFTER_BREAKAWAY * (float(motion.times[-1]) + waits(motion)))
        try:
            motion = simulate(servo, model, gain, time=span, **values)
        except NoOrbit:
            break
    return motion


def waits(motion: Trajectory) -> float:
    """Time [s] until a servo that ends stuck breaks away; 0 where it moves, or is at its set point."""
    x = motion.states[:, -1]
    _, _, ki = motion.servo.torque_gains(motion.gain)
    torque = float(motion.torque(x[:, None])[0])
    static = motion.servo.friction.static
    if x[0] == 0 or abs(torque) > static or motion.modes[-1] != "stick":
        return 0.0
    return float((torque + np.sign(x[0]) * static) / (ki * x[0]))


def regulator_tasks(
    servo: Servo, model: Model, gain: float, span: float, amplitude: float, friction: str
) -> list[SimulatedTask]:
    """Simulated motions towards a set point: two steps from rest, and a breakaway beside the set point.

    servo, model, gain: the problem; gain K > 0 [V/rad]; span: length of the motions [s], longer where they are not
    decided by then; amplitude: of the breakaway [rad]. Raises NoOrbit: a motion could not be computed.
    """
    return [
        SimulatedTask(friction, said, until_decided(servo, model, gain, span, start))
        for said, start in stated(servo, gain, amplitude).items()
    ]


def stated(servo: Servo, gain: float, amplitude: float) -> dict[str, dict[str, float]]:
    """How the tasks start, in words and as `simulate` takes it: two steps of the set point, the breakaway [rad]."""
    kp, _, ki = servo.torque_gains(gain)
    brink = (kp * amplitude - servo.friction.static) / ki
    return {
        **{f"a step of {size:g} rad from rest": {"set_point": size} for size in TASK_STEPS},
        f"breaking away {amplitude:.4g} rad beside the set point": {
            "set_point": 0.0, "position": -amplitude, "integral": brink,
        },
    }  # fmt: skip
