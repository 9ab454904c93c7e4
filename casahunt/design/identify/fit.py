"""The computed cycle laid over records: what they say against it, and how that changes with the unknowns.

    y_i = b + x1(t_i - tau; q) + noise,      unknowns z = (z_1 ... z_k | tau_1/T_1, b_1/a_1 | tau_2/T_2, ...)
    q_j = s_j z_j,      or q_j = s_j ln(1 + e^z_j) of what bends the friction;      q_j >= s_j l_j

So most parameters are linear in their unknowns, down to where the one is next to nothing: friction enters a cycle
linearly, and what a record cannot tell apart, such as Coulomb and viscous friction, lies on a straight line.  Where a
peak of friction is too narrow to be seen, its height goes with a power of its width: with the logarithm of that it lies
on a straight line too.  tau, b, T, a: phase, offset, measured period and amplitude of a record.  x1 and its derivatives
by q are those of the boundary value problem (orbits/state_sensitivity.py): one solve, and as many back substitutions as
there are parameters.  Score s, curvature C of the samples (likelihood.py) and the Jacobian J of their positions give

    gradient J's,      curvature J'CJ         of minus half the deviance, and of half of it

On the way the times are stretched to the period of the model, t T(q)/T, and the period counts as one datum: otherwise a
period that is one per cent off would lay the tenth slip where there is none.

Symbols: m samples, k parameters, z unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ...errors import InputError, NoOrbit, Status
from ...orbits import Options, Orbit, StateSensitivity, refined, state_sensitivity
from ...servo.cold_start import quickly_at
from ...servo.drive import Drive
from ...servo.friction import Model
from ...servo.linear.sampled_loop import as_continuous
from ...servo.parts import TWO_MASSES_LOAD_SEEN
from ...servo.parts.loop import Loop
from ...servo.parts.verbs import loop_cycle
from ...servo.refused import check_hunts, check_problem, check_times
from ..record.waveform import swings_of
from .likelihood import Noise, Rows
from .torque import term, torque_of

Array = np.ndarray

MOST_OF_A_STEP = 0.4
"""Relative change of a parameter in one step: a model that is half as large is another cycle."""
ALL_BUT_NOTHING, NEXT_TO_NOTHING = 1e-3, 0.1
"""Unknown below which a parameter is not followed: it is next to none there; and one that must not be none, whose
cycles are ever harder to find: it is a fiftieth of what was stated."""
BENDING = ("friction.stribeck_velocity", "stribeck_velocity")
"""Parameters whose unknowns are logarithms where they are small: scales of a velocity, in which friction is not
linear."""
WALLS = 0.1
"""Noise, in units of the quantum, below which the deviance feels every error of a cycle: a fit to counts without noise
takes five times as long with provisional ones."""
OF_SAMPLES = ("times", "position", "torque", "passage", "rising", "beside", "apart")
"""What a record has of each sample."""
HALVED_STEPS = 2
"""Of a step along which the cycle is not found from the last one."""


@dataclass(frozen=True, eq=False)
class Data:
    """One record as it is fitted.

    Attributes
    ----------
    times, position : (m,) [s] from its middle, [rad].
    gain : at which it was taken [V/rad].
    period, period_error, amplitude : measured [s], relative, [rad].
    quantum, noise : [rad] of the rounding, 0 where there is none; and about that of the noise.
    shape : the waveform, measured at even phases (measure.py) [rad].
    name : of the file.
    torque : (m,) of the motor [N m]; None where it was not measured.
    drive, left_out : that made it, None: a continuous loop; what its lags leave out, relative to the amplitude.
    passage, rising : (m,) of each sample, and whether the position rises there, 1 or -1, where its swings begin one by
        one (swings.py); None: it repeats as the cycle does.
    beside : (m,) by how much the loop as built is beside the continuous one (built.py) [rad].
    apart : (m, n) errors of that, of one standard deviation each, since its swings differ [rad].
    """

    times: Array
    position: Array
    gain: float
    period: float
    period_error: float
    amplitude: float
    quantum: float
    noise: float
    shape: Array
    name: str
    torque: Array | None = None
    drive: Drive | None = None
    left_out: float = 0.0
    passage: Array | None = None
    rising: Array | None = None
    beside: Array | float = 0.0
    apart: Array | None = None

    def only(self, held: Array) -> Data:
        """With some samples alone, those that are held (m,)."""
        each = {name: getattr(self, name) for name in OF_SAMPLES}
        return replace(self, **{name: of[held] for name, of in each.items() if isinstance(of, np.ndarray)})

    @property
    def swings(self) -> int:
        """In a period, 2 of a plain cycle."""
        return swings_of(self.shape, self.amplitude)

    @property
    def count(self) -> float:
        """Of the encoder that the controller of a drive reads [rad], its own or the record's; 0 without a drive."""
        return 0.0 if self.drive is None else max(self.quantum, self.drive.count)

    @property
    def size(self) -> float:
        """Noise and rounding as one standard deviation [rad]."""
        return math.hypot(self.noise, self.quantum / math.sqrt(12), 1e-6 * self.amplitude)


@dataclass(frozen=True, eq=False)
class Question:
    """What is fitted: records, the servo with its known parameters, the friction model, k free ones, their scales.

    And how small the unknown of each of these may be; exact: every cycle is computed to the tolerance.  On the way none
    needs an error estimate, a quarter of the time.  tried: loops of parts from which their fit may start.
    """

    records: tuple[Data, ...]
    servo: Any
    model: Model | None
    free: tuple[str, ...]
    options: Options
    scales: Array
    lowest: Array
    exact: bool = False
    tried: tuple[Loop, ...] = ()

    @property
    def bends(self) -> Array:
        """(k,) which unknowns are logarithms where they are small."""
        return np.array([name in BENDING for name in self.free])

    def numbers(self, z: Array) -> Array:
        """(k,) the free parameters of the unknowns."""
        own = z[: len(self.free)]
        return np.asarray(self.scales * np.where(self.bends, np.logaddexp(0.0, own), own))

    def unknowns(self, q: Array) -> Array:
        """(k,) the unknowns of free parameters."""
        own = np.maximum(q / self.scales, self.lowest)
        bent = np.where(self.bends, np.maximum(own, np.finfo(float).tiny), 1.0)
        return np.asarray(np.where(self.bends, own + np.log(-np.expm1(-bent)), own))

    def slopes(self, z: Array) -> Array:
        """(k,) derivatives of the free parameters by their unknowns."""
        return np.asarray(self.scales * np.where(self.bends, -np.expm1(-self.numbers(z) / self.scales), 1.0))

    def steps(self, z: Array) -> Array:
        """(k,) what a change of an unknown is measured by: so many times `MOST_OF_A_STEP` may it change in a step."""
        linear = np.maximum(z[: len(self.free)], 1.0)
        shrinks = -math.log1p(-MOST_OF_A_STEP) / MOST_OF_A_STEP
        return np.where(self.bends, np.maximum(self.numbers(z) / self.slopes(z), shrinks), linear)

    def values(self, z: Array) -> dict[str, float]:
        """The free parameters by name."""
        return dict(zip(self.free, map(float, self.numbers(z)), strict=True))

    def servo_at(self, z: Array) -> Any:
        """The servo of the unknowns.  Raises InputError: there is none."""
        return self.servo.replace(**self.values(z))

    def own(self, i: int) -> slice:
        """Where phase and offset of record i stand."""
        return slice(len(self.free) + 2 * i, len(self.free) + 2 * i + 2)


@dataclass(frozen=True, eq=False)
class Point:
    """The model at z, k of which are parameters: cycles and positions for each record; the deviance and its slopes.

    lowest, steps (k,): how small the unknowns of these may be, and what a change of them is measured by; torques: of
    the motor, None where a record has none [N m].
    gradient and curvature are those of -deviance/2 and deviance/2, by sums of J's and J'WJ over the rows.
    """

    z: Array
    lowest: Array
    steps: Array
    orbits: tuple[Any, ...]
    positions: tuple[Array, ...]
    deviance: float
    gradient: Array
    curvature: Array
    torques: tuple[Array | None, ...]
    rows: tuple[Rows, ...] = ()

    @property
    def k(self) -> int:
        """How many parameters there are."""
        return self.lowest.size


def at(
    question: Question, z: Array, noises: Sequence[Noise], near: Point | None = None, *, stretched: bool = False
) -> Point | None:
    """The model at z; None where it has no cycle there, or none was found."""
    k = len(question.free)
    question = replace(question, exact=question.exact or any(noise.sigma < WALLS * noise.quantum for noise in noises))
    try:
        servo = question.servo_at(z)
        orbits = tuple(
            _cycle(question, servo, z, i, near) for i in range(len(question.records))
        )  # fmt: skip
    except (NoOrbit, InputError):
        return None
    rows: list[Rows] = []
    positions: list[Array] = []
    torques: list[Array | None] = []
    for i, (data, orbit, noise) in enumerate(zip(question.records, orbits, noises, strict=True)):
        laid = _laid(question, orbit, data, z, question.own(i), stretched)
        at_z = [*range(k), *range(k + 2 * i, k + 2 * i + 2)]
        compared = _compared(data, laid, noise, orbit, stretched)
        rows += [each._replace(J=each.J @ np.eye(z.size)[at_z]) for each in compared]
        positions.append(laid.position)
        torques.append(laid.torque)
    deviance = sum(each.deviance for each in rows)
    if not np.isfinite(deviance):
        return None
    gradient = sum((each.J.T @ each.score for each in rows), np.zeros(z.size))
    curvature = sum((each.J.T @ (each.weights[:, None] * each.J) for each in rows), np.zeros((z.size, z.size)))
    return Point(
        z, question.unknowns(np.zeros(k)), question.steps(z), orbits, tuple(positions), deviance, gradient, curvature,
        tuple(torques), tuple(rows),
    )  # fmt: skip


def _compared(data: Data, laid: _Laid, noise: Noise, orbit: Orbit, stretched: bool) -> Iterator[Rows]:
    """What a record says of a cycle that is laid over it, with derivatives by its own unknowns."""
    found = noise.slopes(data.position, laid.position)
    yield Rows(-2 * float(np.sum(found.value)), laid.position, found.score, found.curvature, laid.J)
    if stretched or data.passage is not None:
        off = math.log(data.period / orbit.period) / data.period_error
        J = np.append(laid.log_period / data.period_error, (0.0, 0.0))
        yield Rows(off**2, np.array([-off]), np.array([off]), np.ones(1), J[None])
    if data.torque is not None and laid.torque is not None:
        yield term(data.torque, laid.torque, laid.torque_J)


def _cycle(q: Question, servo: Any, z: Array, i: int, near: Point | None) -> Orbit:
    k = len(q.free)
    if near is not None:
        if np.array_equal(z[:k], near.z[:k]):
            return near.orbits[i]
        with suppress(NoOrbit, InputError):
            return _followed(q, near.orbits[i], near.z, z, HALVED_STEPS)
    return cycle_at(servo, q.model, q.records[i], q.options)  # other phases, or too far: from nothing


def _followed(q: Question, orbit: Any, start: Array, end: Array, halvings: int) -> Orbit:
    """What a cycle becomes, in one step, or in two where that fails.  Raises NoOrbit, InputError."""
    try:
        return refined(orbit, replace(q.options, solver="newton", provisional=not q.exact), at=q.values(end))
    except NoOrbit:
        if not halvings:
            raise
    middle = (start + end) / 2
    half = _followed(q, orbit, start, middle, halvings - 1)
    return _followed(q, half, middle, end, halvings - 1)


def cycle_at(servo: Any, model: Model | None, data: Data, options: Options) -> Orbit:
    """The stable cycle at the gain of a record where motions lead to it; the first one begins where the record sticks.

    What no motion leads to is not worth a search for the fold: the fit goes elsewhere.
    Raises NoOrbit: they lead to none; InputError: the problem cannot be.
    """
    gain = data.gain
    if model is None:  # a loop of parts
        at_it = servo.replace(gain=gain)
        return loop_cycle(at_it, start=at_it.at_rest(-data.amplitude), options=options)
    if data.drive is not None:
        servo = as_continuous(servo, gain, data.drive)
    check_problem(servo, model, gain)
    check_hunts(servo, model)
    check_times(servo, model, gain)
    orbit = quickly_at(servo, model, gain, options=options, start=data.amplitude)
    if orbit is None:
        raise NoOrbit(f"no motion leads to a hunting cycle of the {model} servo at gain {gain:g}", Status.NOT_FOUND)
    return orbit


def seen_by(servo: Any) -> int:
    """Which state a record is of: the position that the controller sees."""
    load = TWO_MASSES_LOAD_SEEN in getattr(servo, "present", ())
    return servo.system.states.index("load_angle") if load else 0


class _Laid(NamedTuple):
    """The cycle at the times of a record: position (m,) with derivatives (m, k + 2) by the unknowns, phase and offset;
    derivatives of ln T (k,); the torque of the motor and its derivatives, where the record has one."""

    position: Array
    J: Array
    log_period: Array
    torque: Array | None
    torque_J: Array


def state_at(
    orbit: Orbit, data: Data, tau: float, names: tuple[str, ...], stretched: bool
) -> tuple[StateSensitivity, Array, float]:
    """A cycle at the times of a record; (m,) by how much these go with ln T, and the factor of its times, T/measured T.

    All go where it is stretched; where its swings begin one by one the passages, and samples beside these stay so.
    """
    along = data.times if stretched and data.passage is None else data.passage
    if along is None:
        return state_sensitivity(orbit, data.times - tau * data.period, names), np.zeros(data.times.size), 1.0
    factor = orbit.period / data.period
    way = data.times - along + factor * (along - tau * data.period)
    return state_sensitivity(orbit, way, names), factor * (along - tau * data.period), factor


def _laid(question: Question, orbit: Any, data: Data, z: Array, own: slice, stretched: bool) -> _Laid:
    """A cycle laid over a record."""
    tau, b = z[own]
    found, with_period, factor = state_at(orbit, data, tau, question.free, stretched)
    slopes = question.slopes(z)
    log_period = found.period_derivatives * slopes / orbit.period

    def by_unknowns(derivatives: Array, rate: Array) -> Array:
        J = np.zeros((data.times.size, len(question.free) + 2))
        J[:, :-2] = (derivatives * slopes[:, None]).T + (rate * with_period)[:, None] * log_period
        J[:, -2] = -rate * data.period * factor
        return J

    seen = seen_by(question.servo)
    J, torque, torque_J = by_unknowns(found.derivatives[:, seen], found.rates[seen]), None, np.zeros((0, 0))
    J[:, -1] = data.amplitude
    if data.torque is not None:
        of_motor = torque_of(orbit, found, question.free)
        torque, torque_J = of_motor.value, by_unknowns(of_motor.derivatives, of_motor.rate)
    return _Laid(found.states[seen] + b * data.amplitude + data.beside, J, log_period, torque, torque_J)


def sharpened(question: Question, point: Point, noises: Sequence[Noise]) -> tuple[Question, Point]:
    """The question with the periods of an optimum as the measured ones, and as exactly as the records tell them; and
    the optimum, its cycles to the tolerance, where they can be.

    That is d ln T = T/sqrt(mean t^2 H), H the information about the phase.
    """
    with suppress(NoOrbit):
        how = replace(question.options, solver="newton")
        point = replace(point, orbits=tuple(refined(orbit, how) for orbit in point.orbits))
    records, z = [], point.z.copy()
    for i, (data, orbit) in enumerate(zip(question.records, point.orbits, strict=True)):
        phase = question.own(i).start
        known = float(np.mean(data.times**2)) * point.curvature[phase, phase] / data.period**2
        if data.passage is not None or not known > 0:  # a cycle so long that the record would be all stick
            records.append(data)
            continue
        z[phase] *= data.period / orbit.period
        records.append(replace(data, period=orbit.period, period_error=1 / math.sqrt(known)))
    question = replace(question, records=tuple(records))
    return question, at(question, z, noises, point) or point
