"""The motion of the loop as built, as data.

The equations are those of controller.py and loop.py.  Between two samples the plant moves exactly but for rounding:
there is no step to refine and no error to estimate.  What two programs can still differ in is which count is read where
the position lies within rounding of the edge between two.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...checks import COMPUTED, choice_of, moderate, of_kind, sensible
from ...errors import InputError
from ...export import Columns
from ...results import Result
from ..drive import Drive
from ..hunting import MODELS, Model
from ..outcome import Outcome
from ..servo import Servo, a_servo
from .loop import SampledLoop
from .turning_points import Ending, judge

Array = np.ndarray

LONGEST_MOTION = 5_000_000
"""Of a motion: 200 megabytes."""
AT_A_STOP = ("dwell", "reset_at_stop")
"""Remedies that wait for a reading to stay."""
FAR_AWAY = 1e3
"""A servo that never comes back is not followed beyond so many times its first distance, or Fs/kp."""


@dataclass(frozen=True, eq=False, repr=False)
class SampledMotion(Result):
    """The motion of the loop as built.

    Attributes
    ----------
    model, servo, gain, drive, set_point : the loop; set point theta_d [rad].
    bristle : its deflection at the end [rad] (LuGre), else 0.
    times : (n,) of the samples [s].
    states : (3, n) theta - theta_d [rad], theta' [rad/s], and the controller's sum [rad s] before the sample.
    torque : (n - 1,) what each sample asks for [N m].
    stops : times at which it stops [s].
    rests_since : from when on it is known to rest for ever [s]; nan where it is not.
    far : whether it was given up far away from the set point.
    wall_s : time to compute it [s].

    Examples
    --------
    >>> from casahunt import Drive, Servo, simulate_sampled
    >>> motion = simulate_sampled(Servo(), 2.0, Drive(sample_time=1e-3, encoder=20000), time=20.0, set_point=0.0,
    ...                           position=0.1)
    >>> motion.verdict.kind
    'at rest'
    """

    _quantities = ("model", "gain [V/rad]", "set_point [rad]", "duration [s]", "verdict = verdict.kind", "wall_s [s]")
    _details = (
        "servo", "reason = verdict.sentence", "amplitude = verdict.amplitude [rad]", "period = verdict.period [s]",
        "pattern = verdict.pattern", "swings = verdict.swings", "rests_since [s]", "peak_torque [N m]",
        "number_of_stops = stops.size", "readings",
    )  # fmt: skip

    model: Model
    servo: Servo
    gain: float
    drive: Drive
    set_point: float
    bristle: float
    times: Array
    states: Array
    torque: Array
    stops: Array
    rests_since: float
    far: bool
    wall_s: float

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return float(self.times[-1])

    @property
    def peak_torque(self) -> float:
        """The largest |torque| [N m]."""
        return float(np.abs(self.torque).max(initial=0.0))

    @property
    def readings(self) -> tuple[int, int]:
        """The lowest and the highest count that is read in the second half of the motion; (0, 0) without an encoder."""
        q, theta = self.drive.count, self.set_point + self.states[0, self.times.size // 2 :]
        return (int(np.floor(theta.min() / q + 0.5)), int(np.floor(theta.max() / q + 0.5))) if q else (0, 0)

    @cached_property
    def verdict(self) -> Outcome:
        """What the end of the motion shows."""
        friction = self.servo.friction
        kp = self.servo.torque_gains(self.gain)[0]
        unit, step = (friction.static - friction.coulomb) / kp, self.drive.quantise_torque / kp
        bends = friction.static / friction.stiffness if self._bristles_hold(kp) else 0.0
        end = Ending(self.rests_since, self.far, self._waits(), self.drive.count, unit, bends, step)
        return judge(self.times, self.states[0], end)

    def _bristles_hold(self, kp: float) -> bool:
        """Whether a LuGre servo that does not slip stays: its sum comes to a stand, or its bristles bend to the set
        point, by an exact torque, before that torque is static friction."""
        if self.model != "lugre":
            return False
        w = self.states[2, -(self.times.size // 2) - 1 :]
        middle = w[w.size // 2]
        if abs(w[-1] - middle) <= abs(middle - w[0]) / 2:
            return True
        friction = self.servo.friction
        bent = abs(float(self.torque[-1])) + (friction.stiffness + kp) * abs(float(self.states[0, -1]))
        return not self.drive.quantises and bent < friction.static

    def _waits(self) -> str:
        """What is said of a servo that ends stuck."""
        x, v, _ = self.states[:, -1]
        return f"; it ends stuck {x:+.4g} rad beside the set point" if v == 0 else ""

    def _columns(self) -> Columns:
        x, v, w = self.states[:, :-1]
        return {
            "time_s": self.times[:-1], "position_rad": self.set_point + x, "velocity_rad_per_s": v, "sum_rad_s": w,
            "torque_Nm": self.torque,
        }  # fmt: skip

    def _more(self) -> dict[str, Any]:
        x, v, w = self.states[:, -1]
        return {"drive": vars(self.drive), "position": self.set_point + x, "velocity": v, "integral": w,
                "bristle": self.bristle if self.model == "lugre" else None}  # fmt: skip


def _check_stops(model: str, drive: Drive) -> None:
    """Refuse a remedy that waits for what never is."""
    for key in AT_A_STOP if model == "lugre" and not drive.encoder else ():
        if getattr(drive, key) != getattr(Drive, key):
            raise InputError(f"drive.{key}: needs an encoder or the model 'switch'; LuGre's bristles never stand still")


def simulate_sampled(
    servo: Servo, gain: float, drive: Drive, *, model: Model = "switch", set_point: float = 1.0, time: float = 100.0,
    position: float = 0.0, velocity: float = 0.0, integral: float = 0.0, bristle: float = 0.0,
) -> SampledMotion:  # fmt: skip
    """The motion of the loop as built from an initial state.

    Parameters
    ----------
    servo, gain, drive
        the loop; gain > 0.
    model
        "switch" or "lugre", whose sticks are followed sample by sample.
    set_point
        theta_d [rad]; where it lies between two counts of the encoder the error that is read is never 0.
    time
        length of the motion [s], > 0; whole samples.
    position, velocity
        theta [rad] and theta' [rad/s] at the start.
    integral
        the controller's sum at the start [rad s].
    bristle
        z at the start [rad] (LuGre only).

    Returns
    -------
    SampledMotion.

    Raises
    ------
    InputError : a value out of range, or more than `LONGEST_MOTION` samples.

    Examples
    --------
    >>> from casahunt import Drive, Servo, simulate_sampled
    >>> simulate_sampled(Servo(), 0.04, Drive(sample_time=1e-3, encoder=2000), time=150.0).verdict.kind
    'hunting'
    """
    began = clock.perf_counter()
    a_servo(servo)
    of_kind("drive", drive, Drive, "such as Drive(sample_time=1e-3, encoder=2000)")
    sensible("gain", gain, power=COMPUTED)
    sensible("time", time, power=COMPUTED)
    _check_stops(choice_of("model", model, MODELS), drive)
    if bristle != 0 and model != "lugre":
        raise InputError(f"bristle = {bristle!r}: must be 0 with the model {model!r}, which has no bristle")
    given = {"set_point": set_point, "position": position, "velocity": velocity, "integral": integral,
             "bristle": bristle}  # fmt: skip
    numbers = {key: moderate(key, value) for key, value in given.items()}
    T = drive.sample_time
    samples = round(time / T)
    if not 1 <= samples <= LONGEST_MOTION:
        raise InputError(f"time = {time:g}: must be between 1 and {LONGEST_MOTION} samples of {T:g} s")
    x = numbers["position"] - numbers["set_point"]
    start = x, numbers["velocity"], numbers["integral"]
    z = numbers["bristle"] if model == "lugre" else None
    loop = SampledLoop(servo, gain, drive, numbers["set_point"], start, z)
    farthest = FAR_AWAY * max(abs(x), servo.friction.static / loop.controller.kp)
    found = loop.run(samples, farthest)
    n = found.states.shape[1]
    return SampledMotion(
        model=model, servo=servo, gain=gain, drive=drive, set_point=numbers["set_point"],
        bristle=loop.slips.z, times=T * np.arange(n),
        states=found.states, torque=found.torque, stops=found.stops,
        rests_since=T * found.rests_from if found.rests_from >= 0 else float("nan"),
        far=bool(abs(found.states[0, -1]) > farthest), wall_s=clock.perf_counter() - began,
    )  # fmt: skip
