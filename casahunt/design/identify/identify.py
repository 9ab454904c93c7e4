"""From records of a hunting servo to its friction: values, intervals, and whether the model explains what was measured.

    records -> measured (design/record) -> starts -> stretched fit -> fit -> noise <-> fit -> intervals, judgement

The parameters that are sought are free, all others those of the servo.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...axis_units import in_its_units
from ...checks import of_kind
from ...errors import InputError, NoOrbit, Status
from ...export import Columns
from ...orbits import Options
from ...results import Result
from ...servo.drive import Drive
from ...servo.friction import MODELS, Model
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import model_asked
from ...servo.servo import Servo
from ...servo.trajectory import Trajectory
from ...servo.units import unit_of
from ..record.file import Record
from ..record.measure import as_record
from ..uncertainty.set import Uncertainty
from .axis import question_of, sought
from .best import best_of_starts, cut_off, explained_from, gain_that_fits
from .built import as_built
from .climb import climb, expected
from .clipped import CLIPPED_SHARE, LARGER_RANGE, flat_share
from .fit import NEXT_TO_NOTHING, Array, Data, Point, Question, sharpened
from .intervals import BetterFound, Interval, Unsettled, marginal_information, profile, student_95
from .judgement import LEAST_TOLD, Judgement, further_gain, judged, untold
from .likelihood import Noise
from .noise import with_noise
from .readings import unread, widened
from .start import COULOMB, STATIC, STRIBECK, VISCOUS
from .suitable import data_of, in_a_pattern, of_few_steps, suitable
from .torque import residual
from .transient import behind_a_transient

FREE = (STATIC, COULOMB, VISCOUS, STRIBECK)
"""What is sought where nothing else is said."""
MOST_BETTER = 4
"""Better points that refits may come upon, until it is said that there is no knowing where the best one lies."""
LITTLE_TO_GAIN = 0.05
"""Decrease of the deviance that may still be expected at an optimum: a ninth of the way to the end of an interval."""
GROSS = 0.1
"""Systematic rest, relative to the amplitude, of a fit that is none."""
MOST_LEFT = 0.3
"""Of what a fit leaves, relative to the amplitude: more is no noise, however likely, since a period was measured."""
CYCLE_SHARE = 0.1
"""Part of the tolerance to which cycles are computed: the error of a cycle shifts the deviance by more than it seems,
and differently on every mesh."""
BOUND_FACTOR = 10.0
"""Factor at which an interval that nothing bounds ends in the uncertainty file."""
STATE_THE_DRIVE = (
    "a drive that reads counts swings unevenly: state its sample time and encoder (drive, [drive] of a servo file)"
)
"""What may explain a record of counts that no continuous loop does."""


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """Parameters of a servo as records tell them.

    Attributes
    ----------
    status : CONVERGED; FIT_NOT_CONVERGED: the fit stopped short of an optimum, no interval is known.
    model, servo : the friction model, None of a loop of parts, and the servo with the values found.
    intervals : (low, high) of each free parameter, 95 %; 0 and infinity where the records do not bound it, nan
        where the fit has not converged.
    covariance : (k, k) of the logarithms of the free parameters.
    judgement : whether the model explains the records (judgement.py).
    untold : combinations of parameters that the records do not tell, as their powers.
    further : (gain [V/rad], information gained) of the record that would tell most besides; None where none would.
    noises : standard deviation of the noise and quantum of the rounding of each record [rad].
    torque_noises : standard deviation of each measured torque [N m]; None where there is none.
    orbits : the cycle of each record.
    records : the records as they were fitted; times [s] from the middle of each.
    residuals : (m,) of each record: position less model [rad].
    phases : at which time of each record its cycle begins [s].
    deviance : -2 log of the likelihood.
    left_out : part of each record, its beginning, that was on its way to the cycle and is not fitted; 0 where all is.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt import Record, Servo, find_orbit, identify
    >>> t, states = find_orbit(Servo(), "switch", 0.04).sample(100)
    >>> times = np.arange(0.0, 60.0, 0.02)
    >>> record = Record(times, np.interp(times % t[-1], t, states[0]))
    >>> found = identify([record], Servo(), 0.04, free=["friction.static"])
    >>> round(found.values["friction.static"], 3)
    0.53
    """

    _quantities = ("status", "model", "values", "misfit = judgement.misfit", "explained = judgement.explained")
    _details = ("untold", "scatter = judgement.scatter", "systematic = judgement.systematic",
                "unsteady = judgement.unsteady", "servo")  # fmt: skip

    status: Status
    model: Model | None
    servo: Any
    intervals: Mapping[str, tuple[float, float]]
    covariance: Array
    judgement: Judgement
    untold: Sequence[Mapping[str, float]]
    further: tuple[float, float] | None
    noises: tuple[Noise, ...]
    torque_noises: tuple[float | None, ...]
    orbits: tuple[Any, ...]
    records: tuple[Data, ...] = field(repr=False)
    residuals: tuple[Array, ...] = field(repr=False)
    phases: tuple[float, ...] = field(repr=False)
    deviance: float
    left_out: float = 0.0

    @property
    def values(self) -> dict[str, float]:
        """The free parameters by name."""
        return {name: self.servo.value(name) for name in self.intervals}

    @property
    def uncertainty(self) -> Uncertainty:
        """The intervals as `fold_sensitivities`' neighbours take them; without bounds they end at a factor.

        Raises
        ------
        NoOrbit : the fit has not converged.
        """
        if not self.status.ok:
            raise NoOrbit(self.status.advice, self.status)
        return Uncertainty(
            {
                name: (low if low > 0 else value / BOUND_FACTOR, high if math.isfinite(high) else value * BOUND_FACTOR)
                for (name, (low, high)), value in zip(self.intervals.items(), self.values.values(), strict=True)
            }
        )

    @property
    def bounded(self) -> bool:
        """Whether the records bound every parameter on both sides."""
        return all(low > 0 and math.isfinite(high) for low, high in self.intervals.values())

    def _more(self) -> dict[str, Any]:
        values = self.values
        return {
            "parameters": {
                name: {"value": values[name], "low": low, "high": high if math.isfinite(high) else None}
                for name, (low, high) in self.intervals.items()
            },
            "further_gain": None if self.further is None else self.further[0],
            "covariance_of_logarithms": self.covariance,
            "records": [
                {
                    "name": data.name, "gain": data.gain, "samples": data.times.size, "period": orbit.period,
                    "amplitude": orbit.amplitude, "noise": noise.sigma, "quantum": noise.quantum,
                    "torque_noise": torque,
                }
                for data, orbit, noise, torque in zip(
                    self.records, self.orbits, self.noises, self.torque_noises, strict=True
                )
            ],
        }  # fmt: skip

    def _columns(self) -> Columns:
        values = self.values
        return {
            "parameter": list(values),
            "unit": [unit_of(name) for name in values],
            "value": list(values.values()),
            "low": [low for low, _ in self.intervals.values()],
            "high": [high for _, high in self.intervals.values()],
        }


@in_its_units
def identify(
    records: Sequence[Record | Trajectory | str | Path],
    servo: Servo | Loop,
    gains: float | Sequence[float] | None = None,
    model: Model | None = None,
    *,
    free: Sequence[str] = FREE,
    drive: Drive | None = None,
    options: Options | None = None,
    advise: bool = True,
) -> Identification:
    """The friction of a servo, or other parameters of it, from records of its hunting.

    Parameters
    ----------
    records
        one or several, as of `measure`, each with three whole periods or more; positions about any mean.
    servo
        its known parameters, and values of the others to start from; or a loop of parts, of which friction is sought.
    gains
        the gain of all records, or of each [V/rad]; of a loop its own by default.
    model
        "switch" (default) or "lugre"; of a loop None.
    free
        the parameters that are sought.
    drive
        that made the records, whose lags are taken into account where they can be; None: a continuous loop.
    options
        tolerance of the computed cycles.
    advise
        look for the gain of a further record that would tell most besides.

    Returns
    -------
    Identification.

    Raises
    ------
    InputError : a record that cannot be fitted, a parameter that the model does not have, or a gain that does not fit.
    NoOrbit : the fit failed.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt import Record, Servo, find_orbit, identify
    >>> t, states = find_orbit(Servo(), "switch", 0.04).sample(100)
    >>> times = np.arange(0.0, 60.0, 0.02)
    >>> record = Record(times, np.interp(times % t[-1], t, states[0]))
    >>> identify([record], Servo(), 0.04, free=["friction.coulomb"]).judgement.explained
    True
    """
    samples = [as_record(record) for record in records]
    model = model_asked(servo, model, MODELS[0])
    free, each, drive, left_out = sought(servo, model, gains, free, drive, samples)
    how = of_kind("options", options or Options(), Options).finer(CYCLE_SHARE)

    def fit(records: Sequence[Record]) -> Identification:
        data = tuple(
            data_of(record, suitable(record), gain, drive, left_out)
            for record, gain in zip(records, each, strict=True)
        )
        return fitted(question_of(servo, model, data, tuple(free), how), advise=advise and model is not None)

    found: Identification = behind_a_transient(samples, fit)
    return found


def fitted(question: Question, *, advise: bool = True) -> Identification:
    """The identification of suitable records.  Raises InputError: a gain that does not fit; NoOrbit: no fit."""
    found, asked = best_of_starts(question), False
    if found is None:
        found, asked = _elsewhere(question), True
    if found is None:
        raise _does_not_fit(question, "it hunts with no friction that amplitude and period allow")
    stated = question
    question, best, noises = as_built(question, *found)
    for _ in range(MOST_BETTER + 1):
        question, best = sharpened(question, best, noises)
        best = climb(replace(question, exact=True), best, noises)
        judgement = judged(question, best, noises)
        left = [np.std(d.position - x) / d.amplitude for d, x in zip(question.records, best.positions, strict=True)]
        far = max(left) > MOST_LEFT or not judgement.fits and judgement.systematic > GROSS
        if (far or not judgement.fits) and not asked:
            if (cut := cut_off(question, best)) is not None:
                raise _cut_off(*cut)
            asked, found = True, _elsewhere(stated)
            if found is not None:
                question, best, noises = as_built(stated, *found)
                continue
        if far:
            off = max(*left, judgement.systematic)
            raise _does_not_fit(stated, f"its nearest cycle is off by {off:.0%} of the amplitude")
        try:
            ends = _ends(question, best, noises, judgement.factor)
            break
        except BetterFound as better:
            best, noises = with_noise(question, climb(question, better.point, noises), noises)
    else:
        ends = None
    J, off = marginal_information(question, best), unread(question, best)
    ends = None if ends is None else widened(ends, question.numbers(best.z), off)
    relative = off / np.maximum(question.numbers(best.z), NEXT_TO_NOTHING * question.scales)
    nowhere = [Interval(math.nan, math.nan)] * len(question.free)
    return Identification(
        status=Status.FIT_NOT_CONVERGED if ends is None else Status.CONVERGED,
        model=question.model,
        servo=question.servo_at(best.z),
        intervals={name: (end.low, end.high) for name, end in zip(question.free, ends or nowhere, strict=True)},
        covariance=np.linalg.inv(J + LEAST_TOLD * np.eye(len(J))) * judgement.factor + relative.T @ relative,
        judgement=judgement,
        untold=untold(question, J, judgement.factor),
        further=further_gain(question, best, noises, ends) if advise and ends and judgement.explained else None,
        noises=tuple(noises),
        torque_noises=tuple(
            None if data.torque is None or torque is None else residual(data.torque, torque)[1]
            for data, torque in zip(question.records, best.torques, strict=True)
        ),
        orbits=best.orbits,
        records=question.records,
        residuals=tuple(d.position - x for d, x in zip(question.records, best.positions, strict=True)),
        deviance=best.deviance,
        phases=tuple(float(best.z[question.own(i)][0]) * d.period for i, d in enumerate(question.records)),
    )


def _ends(question: Question, best: Point, noises: Sequence[Noise], factor: float) -> list[Interval] | None:
    """The interval of each parameter; None where the best point, or one of those along a profile, is no optimum, or
    its cycles are not known to the tolerance.

    Raises BetterFound: a refit came out below the best point.
    """
    known = all(math.isfinite(orbit.error_estimate) for orbit in best.orbits)
    if not known or expected(best) > LITTLE_TO_GAIN:
        return None
    freedom = sum(data.times.size for data in question.records) - best.z.size
    rise = student_95(freedom) ** 2 * factor
    try:
        return [profile(question, best, noises, j, rise) for j in range(len(question.free))]
    except Unsettled:
        return None


def _elsewhere(question: Question) -> tuple[Point, list[Noise]] | None:
    """What explains records that the starts do not, with their noise; None where nothing was found.

    Raises InputError: another gain explains them, and the one that is stated does not from there either.
    """
    patterned = any(data.swings > 2 for data in question.records)  # of which no gain makes a cycle
    other = None if question.model is None or patterned else gain_that_fits(question)
    if other is None:
        return None
    data, (factor, z) = question.records[0], other
    found = explained_from(question, z)
    if found is None:
        raise InputError(
            f"gain = {data.gain:g}: does not fit {data.name}: no friction explains it there, but one does at "
            f"{factor:.2g} times that gain, {data.gain * factor:.2g} V/rad; are gain, motor gain and inertia right?"
        )
    return found


def _does_not_fit(question: Question, how: str) -> Exception:
    """The refusal of records that no cycle comes near."""
    data, whose = question.records[0], f"the {question.model} servo" if question.model else question.servo.name
    return InputError(
        f"{data.name}: does not fit {whose} at gain {data.gain:g}, of amplitude "
        f"{data.amplitude:.4g} rad and period {data.period:.4g} s: {how}; {_what_else(data)}"
    )


def _cut_off(data: Data, end: float, beyond: float) -> Exception:
    share = float(np.mean(data.position == end))
    return InputError(
        f"{data.name}: its positions are clipped at {end:.6g} rad, where {share:.0%} of the samples lie exactly: "
        f"the model explains the others, and goes {beyond:.2g} rad beyond; {LARGER_RANGE}"
        f"{'' if data.drive is not None or not data.quantum else f'; or, if it rests there, {STATE_THE_DRIVE}'}"
    )


def _what_else(data: Data) -> str:
    """What to look at where no cycle fits."""
    encoder = of_few_steps(data.amplitude, data.quantum)
    if not encoder and data.swings > 2:
        return f"it {in_a_pattern(data.swings)}"
    told = data.drive is not None or not data.quantum
    else_ = "are gain, servo and units right?" if told else f"are gain, servo and units right? Or {STATE_THE_DRIVE}"
    return (f"suspect {encoder}" if encoder else else_) + maybe_cut_off(data)


def maybe_cut_off(data: Data) -> str:
    """That counts may be cut off, where many are the last one: with few samples in a slip that looks like a rest."""
    flat = flat_share(data.position) if data.quantum else 0.0
    if flat < CLIPPED_SHARE:
        return ""
    return f"; {flat:.0%} of the samples are the last count at an end: if that is no rest, {LARGER_RANGE}"
