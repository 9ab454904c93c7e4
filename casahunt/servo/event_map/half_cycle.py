"""One half cycle of the hunting servo as a map of an interval: stuck at -a, breakaway, slip, stuck at P(a).

Switch: at breakaway with x1 = -a the torque is m = +Fs, so the state is (-a, 0, (kp a - Fs)/ki) and has
one free number.  The slip ends at the next stick position P(a).  Symmetric hunting cycles are the fixed
points P(a) = a, and P'(a) is minus the half multiplier with the sign convention of orbits/floquet.py taken in.
LuGre has the same map up to the fast transients of the bristle; it starts stuck at -a with m = 0.9 Fs on
the elastic bristle and is read off when m has come down to -0.9 Fs on the other side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...motion import Segment, march
from ..friction import Model
from ..problem import SCHEMES, Kind, motor_torque, system_of
from ..servo import Servo

Array = np.ndarray

TYPICAL = 0.1
"""Stick position of most stable cycles, in units of Fs/kp, where the proportional torque equals static friction."""
SECTION = 0.9
"""LuGre: part of Fs that the motor torque has where the map starts and ends."""
MOST_INTERVALS = {"switch": 1000, "lugre": 4000}
"""Intervals after which one application of the map is given up."""
MOST_SLIPS = 12
"""Slips in a row without a stick after which the swing is taken for what it has become."""
FAR_OUT = 3.0
"""A servo that turns this many times farther out than it started is not followed further."""
PATIENCE = 1e6
"""Longest half period looked for, in units of the controller's times."""
MARCH_TOLERANCE = {"switch": 1e-3, "lugre": 1e-4}
"""A guess is all that is asked for; who wants more says so."""


@dataclass(frozen=True, eq=False)
class HalfCycle:
    """One application of the map.

    Attributes
    ----------
    start : a [rad].
    position : P(a) [rad], positive on the far side; 0 where the servo comes to rest for good; the last
        turning point |x1| of a servo that swings on without sticking.
    segments : the motion between two corresponding points, as phases of a half cycle.
    slope : d log(P/a) / d log a there, where a search has found it out; nan elsewhere.  0 at a fold,
        negative at a stable fixed point.
    swings : of the map that made it.
    """

    start: float
    position: float
    segments: list[Segment]
    slope: float = float("nan")
    swings: int = 2

    @property
    def ratio(self) -> float:
        """P(a)/a."""
        return self.position / self.start

    @property
    def fixed(self) -> float:
        """Stick position of the fixed point next to this motion [rad], by the slope."""
        return float(self.start * self.ratio ** (-1 / self.slope))

    @property
    def moving(self) -> float:
        """Time that the servo moves [s]."""
        return float(sum(s.duration for s in self.segments if s.mode != "stick"))


@dataclass(frozen=True)
class StickMap:
    """The map P of one servo at one gain: from a stick position to the half cycle that begins there.

    swings: how many, each up to a centre, a LuGre motion is followed, two at least; the last one is kept.  The first
    begins with a bristle that does not move; where a swing begins before it is at rest again so do the next ones.
    """

    model: Model
    servo: Servo
    gain: float
    swings: int = 2

    @cached_property
    def gains(self) -> tuple[float, float, float]:
        """Torque gains kp, kd, ki."""
        return self.servo.torque_gains(self.gain)

    @cached_property
    def p(self) -> Array:
        """The parameters of the fields."""
        return self.servo.parameters(self.gain)

    @cached_property
    def patience(self) -> float:
        """Time [s] after which a servo that has not moved across counts as being at rest."""
        return PATIENCE * self.servo.controller.reset_time

    @property
    def unit(self) -> float:
        """Stick position at which the proportional torque equals static friction [rad]."""
        return self.servo.friction.static / self.gains[0]

    @property
    def typical(self) -> float:
        """Stick position of most stable cycles [rad]."""
        return TYPICAL * self.unit

    @property
    def rigid(self) -> StickMap:
        """That of the same servo without a bristle."""
        return replace(self, model="switch")

    def at_gain(self, gain: float) -> StickMap:
        """That of the same servo at another gain."""
        return replace(self, gain=gain)

    def scale(self, a: float) -> Array:
        """(n,) expected size of the states in a motion with an amplitude a > 0 [rad]."""
        (kp, kd, ki), f, inertia = self.gains, self.servo.friction, self.servo.inertia
        rate = min(np.sqrt(kp / inertia), kp / max(kd + f.viscous, 1e-300))
        scale = [a, max(a * rate, 1e-300), max(abs(kp * a - f.static), f.static) / ki]
        return np.array(scale + ([f.static / f.stiffness] if self.model == "lugre" else []))

    def breakaway(self, a: float) -> Array:
        """(3,) state of the Switch servo that breaks away from the stick position -a [rad]."""
        kp, _, ki = self.gains
        return np.array([-a, 0.0, (kp * a - self.servo.friction.static) / ki])

    def __call__(
        self, a: float, *, tol: float | None = None, degree: int = 0, kind: Kind = "gauss", longest: float = math.inf
    ) -> HalfCycle:
        """Let the servo go from the stick position -a < 0 until it is stuck again.

        a: stick position [rad], > 0; tol, degree, kind: of the march; defaults per model; longest: time after which the
        servo counts as being at rest, if that is less than its `patience` [s]. Raises MarchFailure: the motion could
        not be computed.
        """
        if degree == 0:
            degree, kind = SCHEMES[self.model]
        run = _switch if self.model == "switch" else _lugre
        return run(self, a, tol or MARCH_TOLERANCE[self.model], degree, kind, min(longest, self.patience))


def half_cycle(model: Model, servo: Servo, gain: float, a: float, *, tol: float | None = None) -> HalfCycle:
    """One motion of a servo at a gain K > 0 [V/rad] from the stick position a > 0 [rad]: `StickMap`."""
    return StickMap(model, servo, gain)(a, tol=tol)


def _switch(P: StickMap, a: float, tol: float, degree: int, kind: Kind, longest: float) -> HalfCycle:
    slips = 0

    def stuck_or_tired(segment: Segment) -> bool:
        nonlocal slips
        slips += segment.event == "stop"
        thrown_out = abs(float(segment.end[0])) > FAR_OUT * a
        return segment.mode == "stick" or slips == MOST_SLIPS or thrown_out

    segments = march(
        system_of("switch", P.p.size).vector_form, "slip+", P.breakaway(a), P.p,
        scale=P.scale(a), until=stuck_or_tired, tol=tol, degree=degree, kind=kind,
        max_time=longest, max_intervals=MOST_INTERVALS["switch"],
    )  # fmt: skip
    if segments[-1].event == "":
        return HalfCycle(a, 0.0, segments)
    position = float(segments[-1].end[0])
    return HalfCycle(a, position if segments[-1].mode == "stick" else abs(position), segments)


def _lugre(P: StickMap, a: float, tol: float, degree: int, kind: Kind, longest: float) -> HalfCycle:
    """From one centre to the next: the last half cycle is the one that is kept, free of the artificial start."""
    (kp, _, ki), f, p = P.gains, P.servo.friction, P.p
    torque = SECTION * f.static
    x = np.array([-a, ki * a / f.stiffness, (kp * a - torque) / ki, torque / f.stiffness])
    crossings = 0

    def at_last_centre(segment: Segment) -> bool:
        nonlocal crossings
        crossings += segment.event == "centre"
        return crossings == P.swings

    segments = march(
        system_of("lugre", p.size).vector_form, "slide+", x, p,
        scale=P.scale(a), until=at_last_centre, tol=tol, degree=degree, kind=kind,
        max_time=longest, max_intervals=MOST_INTERVALS["lugre"],
    )  # fmt: skip
    if crossings < P.swings:
        return HalfCycle(a, 0.0, segments)
    *_, before, _ = (i for i, s in enumerate(segments) if s.event == "centre")
    kept = segments[before + 1 :]
    side = np.sign(kept[0].end[0])
    last = kept[-1]
    n = x.size
    nodes = np.vstack([last.w[:, :n], last.end])
    torques = motor_torque(nodes.T, p) * side
    below = np.flatnonzero(torques <= -torque)
    i = int(below[0]) if below.size else 0
    if i == 0:
        position = float(nodes[0, 0])
    else:
        weight = (torques[i - 1] + torque) / (torques[i - 1] - torques[i])
        position = float(nodes[i - 1, 0] + weight * (nodes[i, 0] - nodes[i - 1, 0]))
    return HalfCycle(a, position * float(side), kept, swings=P.swings)
