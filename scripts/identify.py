"""Friction from records of random servos, made by an integrator of another kind: are the true values in the intervals?

    python scripts/identify.py [--count N] [--seed S] [--model switch|lugre] [--only I ...] [--counts LOW HIGH]
                               [--as-built] [--no-drive] [--parts] [--out FILE.jsonl]

Each servo is drawn as in scripts/random_servos.py and records so many periods at a part of its fold's gain, with noise
of 1 % of its amplitude, on an encoder of 2000 to 20000 counts a revolution (scripts/peers/hunting_record.py; where that
makes fewer than `FEWEST` counts of the amplitude, of more).  The fit starts from values each wrong by a factor of two,
up or down by chance, and once more from others.

    inside     share of the true values inside their 95 % intervals, of all and of each parameter, with the 95 %
               interval of that share (Wilson)
    same       both starts end in the same optimum: deviances within 0.5, or values within a tenth of their intervals
    settled    both fits say that they have converged; the intervals of the first one do not count where it says not
    explained  the model is said to explain its own record
    time       of one record [s of the processor]

As built, records are those of a drive that moves by a step before it hunts (scripts/peers/drive_record.py): counts of
the encoder, so many of the amplitude, stand in its loop and in the record, which holds one of some samples; controllers
are PID or P-PI, their derivative a difference or filtered.  The fit is told of the drive, and starts once.  Answers are
those that say that the model holds; all others are refused, with the reason.  A P-PI whose velocity is filtered sums
what is filtered: it is a loop of parts, and stands by itself.  With --parts all are.

Prints a line per servo and the sums.  The file holds one line of JSON per servo; a run adds those that it does not
hold yet, and sums over all of them.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import Drive, InputError, NoOrbit, Record, Servo, find_fold, find_orbit, identify  # noqa: E402
from casahunt.design.identify.identify import FREE, Identification  # noqa: E402
from casahunt.servo.parts import (  # noqa: E402
    DERIVATIVE_FILTER,
    INERTIA,
    INTEGRATOR,
    LUGRE,
    P_PI,
    P_PI_FILTERED,
    PID_BY_GAINS,
    SWITCH,
    Loop,
)
from casahunt.servo.problem import HuntingOrbit  # noqa: E402
from casahunt.servo.servo import flatten, unflatten  # noqa: E402
from scripts.peers.drive_record import DriveServo  # noqa: E402
from scripts.peers.hunting_record import measured, positions  # noqa: E402
from scripts.random_servos import draw  # noqa: E402

SHARES = (0.05, 0.8)
"""Gains, as parts of that of the fold."""
PERIODS, SAMPLES = (5, 12), (300, 1500)
"""Whole periods of a record, and samples in each."""
NOISE, FEWEST = 0.01, 20.0
"""Of the positions, in amplitudes; counts of the amplitude."""
LITTLE = 1e-3
"""Viscous friction [N m s/rad] of the servos that are drawn without any: its logarithm is sought."""
ALIKE = 0.5
"""Difference of the deviances of two answers that are one."""
SAME = 0.1
"""Part of an interval by which two answers may differ."""
COUNTS, EVERY = (20.0, 200.0), (1, 20)
"""As built: counts of the amplitude, and samples of the drive from one that is logged to the next."""
SAMPLE_TIMES, MOST_SAMPLES = (0.005, 0.1), 30_000
"""Sample times in units of 1/omega, omega^2 = kp/J; samples of the drive in a period, at most."""
MOST_LOGGED = 6000
"""Samples of a record, about, where one of some is logged."""
FILTERS = (1.0, 10.0)
"""Of the derivative, in sample times."""
STEPS, HUNTED = (3.0, 20.0), (7.0, 14.0)
"""The step of the set point at the start, in amplitudes; and periods of a record."""


class Made:
    """A servo, its record, and two wrong starts."""

    drive: Drive | None = None

    def __init__(self, number: int, seed: int, model: str, counts: tuple[float, float]) -> None:
        rng = np.random.default_rng([seed, number])
        drawn = draw(seed, number)
        self.servo = unflatten(drawn | {"friction.viscous": drawn["friction.viscous"] or LITTLE})
        fold = find_fold(self.servo, model).gain
        self.gain = float(fold * math.exp(rng.uniform(*np.log(SHARES))))
        orbit = find_orbit(self.servo, model, self.gain)
        if not orbit.stable:
            raise NoOrbit(f"its cycle at gain {self.gain:g} is not stable")
        self.counts = 0.0
        self.record = self.recorded(orbit, counts, rng)
        self.starts = []
        for _ in range(2):
            values = flatten(self.servo)
            changes = {n: values[n] * rng.choice([0.5, 2.0]) for n in FREE}
            low, high = sorted((changes["friction.coulomb"], changes["friction.static"]))
            changes |= {"friction.coulomb": low, "friction.static": max(high, 1.02 * low)}
            self.starts.append(self.servo.replace(**changes))

    def recorded(self, orbit: HuntingOrbit, counts: tuple[float, float], rng: np.random.Generator) -> Record:
        """Of the continuous loop, on its cycle."""
        a, T = orbit.amplitude, orbit.period
        whole, each = rng.uniform(*PERIODS), rng.uniform(*SAMPLES)
        times = np.arange(0.0, (whole + 2) * T, T / each)
        state = orbit.arcs[0].states[0, 0] if orbit.model == "lugre" else None
        x = positions(self.servo, orbit.model, self.gain, a, times, state)
        if counts[1] > 0:
            self.counts = max(math.exp(rng.uniform(*np.log(counts))), FEWEST * 2 * math.pi / a)
        later = times >= 1.5 * T
        y = measured(x[later], NOISE * a, self.counts, rng.uniform(-1, 1), rng)
        return Record(times[later], y, "bench")


class AsBuilt(Made):
    """The same of a drive, from a step on."""

    def recorded(self, orbit: HuntingOrbit, counts: tuple[float, float], rng: np.random.Generator) -> Record:
        """Counts of the encoder, every so many samples."""
        servo, (kp, kd, ki) = self.servo, self.servo.torque_gains(self.gain)
        f, a = servo.friction, orbit.amplitude
        T = math.exp(rng.uniform(*np.log(SAMPLE_TIMES))) * math.sqrt(servo.inertia / kp)
        if orbit.period > MOST_SAMPLES * T:
            raise NoOrbit(f"its period has more than {MOST_SAMPLES} samples")
        count = a / math.exp(rng.uniform(*np.log(COUNTS)))
        self.counts = 2 * math.pi / count
        filter_time = T * math.exp(rng.uniform(*np.log(FILTERS))) if rng.integers(2) else 0.0
        zeros = np.roots([1.0, -kp / kd, ki / kd])
        cascade = bool(rng.integers(2)) and bool(np.isreal(zeros).all())
        how = {"derivative": "filtered", "filter_time": filter_time} if filter_time else {}
        self.drive = Drive(sample_time=T, encoder=self.counts, **how)
        bristle = (f.stiffness, f.damping) if orbit.model == "lugre" else (0.0, 0.0)
        built = DriveServo(
            servo.inertia, f.static, f.coulomb, f.stribeck_velocity, f.viscous, kp, ki, kd, T, encoder=self.counts,
            filter_time=filter_time, proportional=float(zeros.real.max()) if cascade else 0.0, bristle=bristle,
        )
        every = max(int(round(math.exp(rng.uniform(*np.log(EVERY))))), 1)
        samples = round(rng.uniform(*HUNTED) * orbit.period / T)
        self.every = every = min(max(every, samples // MOST_LOGGED), EVERY[1])
        self.cascade, self.filter_time = cascade, filter_time
        self.gains = {"kp": kp, "kd": kd, "ki": ki}
        if cascade:
            self.gains = {"velocity_gain": kd, "position_gain": built.proportional,
                          "reset_time": built.proportional * kd / ki}  # fmt: skip
        return Record(*built.record(a * rng.uniform(*STEPS), samples, every), "drive")

    def in_parts(self, start: Servo, model: str) -> tuple[Loop, Drive]:
        """A servo to start from, and its drive, by the parts of its loop."""
        f = start.friction
        controller = (P_PI_FILTERED if self.filter_time else P_PI) if self.cascade else PID_BY_GAINS
        parts = [INERTIA, LUGRE if model == "lugre" else SWITCH, controller, INTEGRATOR]
        parts += [DERIVATIVE_FILTER] if self.filter_time and not self.cascade else []
        numbers = {"inertia": start.inertia, "static": f.static, "coulomb": f.coulomb, "viscous": f.viscous,
                   "stribeck_velocity": f.stribeck_velocity, "stiffness": f.stiffness, "damping": f.damping,
                   "derivative_filter": self.filter_time, "velocity_filter": self.filter_time, **self.gains,
                   "motor_gain": 1.0, "gain": 1.0}  # fmt: skip
        known = {name for part in parts for name in part.parameters}
        return Loop(parts, {n: x for n, x in numbers.items() if n in known}), Drive(
            sample_time=self.drive.sample_time, encoder=self.drive.encoder
        )


def same(a: Identification, b: Identification) -> bool:
    """Whether two answers are one: as likely as each other, or by values."""
    if abs(a.deviance - b.deviance) < ALIKE:
        return True
    for name, (low, high) in a.intervals.items():
        if math.isnan(low):
            return False
        if abs(a.values[name] - b.values[name]) > SAME * (high - low):
            return False
    return True


def examined(
    number: int, seed: int, model: str, counts: tuple[float, float], as_built: bool, told: bool, parts: bool
) -> dict[str, Any]:
    """The row of one servo."""
    row: dict[str, Any] = {"seed": seed, "number": number, "model": model, "counts": list(counts), "refused": [],
                           "as_built": as_built, "told": told, "parts": parts}  # fmt: skip
    try:
        made = (AsBuilt if as_built else Made)(number, seed, model, counts)
    except NoOrbit as error:
        return row | {"record": False, "refused": [str(error)]}
    answers, seconds = [], []
    for start in made.starts[: 1 if as_built else 2]:
        began, drive, question = time.process_time(), made.drive, (start, made.gain, model)
        if isinstance(made, AsBuilt) and (parts or (made.cascade and made.filter_time)):
            loop, drive = made.in_parts(start, model)
            question = loop, None, None
        asked = {"drive": drive if told else None, "advise": not seconds}
        try:
            answers.append(identify([made.record], *question, **asked))
        except (InputError, NoOrbit) as error:
            row["refused"].append(f"{type(error).__name__}: {error}")
        seconds.append(time.process_time() - began)
    row |= {"record": True, "seconds": seconds, "samples": made.record.times.size, "gain": made.gain}
    if isinstance(made, AsBuilt):
        row |= {"cascade": made.cascade, "filtered": made.filter_time > 0}
    if not answers:
        return row
    found, truth = answers[0], flatten(made.servo)
    return row | {
        "counts_of_amplitude": found.orbits[0].amplitude * made.counts / 2 / math.pi,
        "parameters": {
            name: {"true": truth.get(name, truth.get(f"friction.{name}")), "value": found.values[name], "low": low,
                   "high": high}
            for name, (low, high) in found.intervals.items()
        },
        "settled": [answer.status.ok for answer in answers], "same": len(answers) == 2 and same(*answers),
        "explained": found.judgement.explained, "misfit": found.judgement.misfit, "factor": found.judgement.factor,
        "deviances": [answer.deviance for answer in answers], "noise": found.noises[0].sigma,
        "unsteady": found.judgement.unsteady, "systematic": found.judgement.systematic,
    }  # fmt: skip


def line(row: dict[str, Any]) -> str:
    """What is printed of a servo: logarithms of value over truth, ! where that is outside its interval."""
    if "parameters" not in row:
        return f"{row['number']:4d} {'no record' if not row['record'] else 'refused'}: {row['refused'][0]}"[:150]
    said = []
    for p in row["parameters"].values():
        mark = "?" if not row["settled"][0] else " " if p["low"] <= p["true"] <= p["high"] else "!"
        said.append(f"{math.log(max(p['value'] / p['true'], 1e-3)):+.3f}{mark}")
    return (
        f"{row['number']:4d} {row['samples']:6d} samples, {row['counts_of_amplitude']:6.1f} counts: {' '.join(said)} "
        f"misfit {row['misfit']:.2f} {'same' if row['same'] else '' if row['as_built'] else 'OTHER'} "
        f"{'' if row['explained'] else 'NOT explained '}"
        f"{' '.join(f'{each:.1f}' for each in row['seconds'])} s"
    )


def share(count: int, of: int) -> str:
    """A share with its 95 % interval (Wilson)."""
    if not of:
        return "none"
    p, z = count / of, 1.96
    middle, half = p + z * z / 2 / of, z * math.sqrt(p * (1 - p) / of + z * z / 4 / of**2)
    low, high = ((middle + sign * half) / (1 + z * z / of) for sign in (-1, 1))
    return f"{p:.1%} ({low:.1%} to {high:.1%} of {of})"


def sums(rows: list[dict[str, Any]]) -> str:
    """Over all servos that hunt."""
    rows = [row for row in rows if row["record"]]
    fitted = [row for row in rows if "parameters" in row]
    told = [row for row in fitted if row["settled"][0] and (row["explained"] or not row["as_built"])]
    names = list(dict.fromkeys(name for row in told for name in row["parameters"]))
    inside = {
        name: sum(row["parameters"][name]["low"] <= row["parameters"][name]["true"] <= row["parameters"][name]["high"]
                  for row in told)
        for name in names
    }  # fmt: skip
    lines = [f"inside {share(sum(inside.values()), len(told) * len(names))}"]
    for of in (False, True) if any(row["as_built"] for row in rows) else ():
        own = [p for row in told if (row.get("cascade") and row.get("filtered") or False) == of
               for p in row["parameters"].values()]  # fmt: skip
        what = "of a P-PI whose velocity is filtered" if of else "of all others"
        lines.append(f"  {what} {share(sum(p['low'] <= p['true'] <= p['high'] for p in own), len(own))}")
    lines += [f"  {name} {share(count, len(told))}" for name, count in inside.items()]
    for name in ("explained",) if any(row["as_built"] for row in rows) else ("same", "explained"):
        lines.append(f"{name} {share(sum(row[name] for row in fitted), len(fitted))}")
    lines.append(f"settled {share(sum(all(row['settled']) for row in fitted), len(fitted))}")
    lines.append(f"refused {share(sum(bool(row['refused']) for row in rows), len(rows))}")
    if any(row["as_built"] for row in rows):
        lines.append(f"answered {share(len(told), len(rows))}; others are refused or not explained, and say why")
    times = [each for row in rows for each in row["seconds"]] or [math.nan]
    late = np.quantile(times, 0.95)
    lines.append(f"time: median {np.median(times):.2f} s, 95 % {late:.2f} s, longest {max(times):.2f} s")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--model", default="switch")
    parser.add_argument("--only", type=int, nargs="+")
    parser.add_argument("--as-built", action="store_true", help="records of drives, from a step on")
    parser.add_argument("--no-drive", action="store_true", help="whose drive the fit is not told of")
    parser.add_argument("--parts", action="store_true", help="the fit is told of each by the parts of its loop")
    parser.add_argument("--counts", type=float, nargs=2, default=(2000.0, 20000.0))
    parser.add_argument("--out", type=Path)
    options = parser.parse_args(arguments)
    asked = {"seed": options.seed, "model": options.model, "counts": list(options.counts),
             "as_built": options.as_built, "told": not options.no_drive, "parts": options.parts}  # fmt: skip
    rows = {}
    if options.out and options.out.exists():
        kept = [json.loads(text) for text in options.out.read_text().splitlines()]
        rows = {row["number"]: row for row in kept if asked.items() <= row.items()}
    for number in options.only or range(options.count):
        if number not in rows:
            rows[number] = examined(number, options.seed, options.model, tuple(options.counts), options.as_built,
                                    not options.no_drive, options.parts)
            print(line(rows[number]), flush=True)
            if options.out:
                with options.out.open("a") as file:
                    file.write(json.dumps(rows[number]) + "\n")
    print(sums(list(rows.values())))
    return 0


if __name__ == "__main__":
    sys.exit(main())
