"""Friction from records of random servos, made by an integrator of another kind: are the true values in the intervals?

    python scripts/identify.py [--count N] [--seed S] [--model switch|lugre] [--only I ...] [--counts LOW HIGH]

Each servo is drawn as in scripts/random_servos.py and records so many periods at a part of its fold's gain, with noise
of 1 % of its amplitude, on an encoder of 2000 to 20000 counts a revolution (scripts/peers/hunting_record.py; where that
makes fewer than `FEWEST` counts of the amplitude, of more).  The fit starts from values each wrong by a factor of two,
up or down by chance, and once more from others.

    inside     share of the true values inside their 95 % intervals, of all and of each parameter
    same       both starts end in the same optimum: deviances within 0.5, or values within a tenth of their intervals
    settled    both fits say that they have converged; the intervals of the first one do not count where it says not
    explained  the model is said to explain its own record
    time       of one record [s of the processor]

Prints a line per servo and the sums.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import InputError, NoOrbit, Record, find_fold, find_orbit, identify  # noqa: E402
from casahunt.design.identify.identify import FREE, Identification  # noqa: E402
from casahunt.servo.servo import flatten, unflatten  # noqa: E402
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


class Made:
    """A servo, its record, and two wrong starts."""

    def __init__(self, number: int, seed: int, model: str, counts: tuple[float, float]) -> None:
        rng = np.random.default_rng([seed, number])
        drawn = draw(seed, number)
        self.servo = unflatten(drawn | {"friction.viscous": drawn["friction.viscous"] or LITTLE})
        fold = find_fold(self.servo, model).gain
        self.gain = float(fold * math.exp(rng.uniform(*np.log(SHARES))))
        orbit = find_orbit(self.servo, model, self.gain)
        a, T = orbit.amplitude, orbit.period
        whole, each = rng.uniform(*PERIODS), rng.uniform(*SAMPLES)
        times = np.arange(0.0, (whole + 2) * T, T / each)
        x = positions(self.servo, model, self.gain, a, times)
        self.counts = 0.0
        if counts[1] > 0:
            self.counts = max(math.exp(rng.uniform(*np.log(counts))), FEWEST * 2 * math.pi / a)
        later = times >= 1.5 * T
        y = measured(x[later], NOISE * a, self.counts, rng.uniform(-1, 1), rng)
        self.record = Record(times[later], y, f"servo {number}")
        self.starts = []
        for _ in range(2):
            values = flatten(self.servo)
            changes = {n: values[n] * rng.choice([0.5, 2.0]) for n in FREE}
            low, high = sorted((changes["friction.coulomb"], changes["friction.static"]))
            changes |= {"friction.coulomb": low, "friction.static": max(high, 1.02 * low)}
            self.starts.append(self.servo.replace(**changes))


def same(a: Identification, b: Identification) -> bool:
    """Whether two answers are one: as likely as each other, or by values."""
    if abs(a.deviance - b.deviance) < ALIKE:
        return True
    for name, (low, high) in a.intervals.items():
        if math.isnan(low):
            return False
        width = math.log(min(high, 1e3 * a.values[name]) / max(low, 1e-3 * a.values[name]))
        if abs(math.log(a.values[name] / b.values[name])) > SAME * max(width, 1e-6):
            return False
    return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; returns 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--model", default="switch")
    parser.add_argument("--only", type=int, nargs="+")
    parser.add_argument("--counts", type=float, nargs=2, default=(2000.0, 20000.0))
    options = parser.parse_args(arguments)
    sums, inside, lost, times = Counter[str](), Counter[str](), 0, []
    for number in options.only or range(options.count):
        try:
            made = Made(number, options.seed, options.model, tuple(options.counts))
        except NoOrbit as error:
            print(f"{number:4d} no record: {error}"[:150], flush=True)
            continue
        answers: list[Any] = []
        for start in made.starts:
            began = time.process_time()
            try:
                found = identify([made.record], start, made.gain, options.model, advise=not answers)
                answers.append(found)
            except (InputError, NoOrbit) as error:
                print(f"{number:4d} {type(error).__name__}: {error}"[:200], flush=True)
            times.append(time.process_time() - began)
        if not answers:
            lost += 1
            continue
        found, truth = answers[0], flatten(made.servo)
        sums["settled"] += all(answer.status.ok for answer in answers)
        said = []
        for name, (low, high) in found.intervals.items():
            good = low <= truth[name] <= high
            inside[name] += good
            mark = " " if good else "!" if found.status.ok else "?"
            said.append(f"{math.log(found.values[name] / truth[name]):+.3f}{mark}")
        sums["told"] += found.status.ok
        sums["servos"] += 1
        sums["explained"] += found.judgement.explained
        sums["same"] += len(answers) == 2 and same(*answers)
        alike = "same" if len(answers) == 2 and same(*answers) else "OTHER"
        print(
            f"{number:4d} {made.record.times.size:6d} samples, amplitude {found.orbits[0].amplitude:.3g} rad, "
            f"{found.orbits[0].amplitude * made.counts / 2 / math.pi:6.1f} counts: {' '.join(said)} misfit "
            f"{found.judgement.misfit:.2f} {alike} {times[-len(answers)]:.1f} s", flush=True,
        )  # fmt: skip
    n, told = max(sums["servos"], 1), max(sums["told"], 1)
    each = ", ".join(f"{name} {count / told:.0%}" for name, count in inside.items())
    print(f"inside {sum(inside.values()) / told / len(FREE):.1%}: {each}")
    shares = ", ".join(f"{name} {sums[name] / n:.1%}" for name in ("same", "settled", "explained"))
    print(f"{shares}, refused {lost}")
    print(f"time: median {np.median(times):.2f} s, 95 % {np.quantile(times, 0.95):.2f} s, longest {max(times):.2f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
