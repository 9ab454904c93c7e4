"""Folds and cycles of many servos at once against each of them alone: are they the same, and what do they cost?

    python scripts/ensembles.py [--count 1000] [--model switch lugre] [--what folds orbits] [--seed 0]

Servos about that of Table 1, every parameter drawn from +-2 %: fold gains differ by factors of two; cycles at K = 0.4.
A member differs where its gain, period or amplitude is not that of `find_fold` or `find_orbit` within both error
estimates together, or where one of the two ways has an answer and the other one none.  It is wrong where it differs
from the single way's answer to a thousandth of the tolerance too; else the single way's estimate was short.
Prints a line for each member that differs, a line for each model and kind, and ends with status 1 where one is wrong.
Times are processor times of this process, without the known fold or cycle.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Options, Servo, find_fold, find_orbit  # noqa: E402
from casahunt.design.ensemble import fold_ensemble, orbit_ensemble  # noqa: E402
from problems import table1  # noqa: E402
from scripts.limits import peak_memory  # noqa: E402
from scripts.race.scaling import TOLERANCE, servos  # noqa: E402

GAIN = 0.4
KINDS = ("folds", "orbits")


def together(
    kind: str, model: Any, names: tuple[str, ...], rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Any, float]:
    """((n, k) values, (n, k) errors, the ensemble, seconds)."""
    servo, options = table1.servo(), Options(tol=TOLERANCE)
    if kind == "folds":
        fold = find_fold(servo, model, options=options)
        began = time.process_time()
        folds = fold_ensemble(servo, model, names, rows, options=options, fold=fold)
        seconds = time.process_time() - began
        values = (folds.gains, folds.periods, folds.amplitudes)
        errors = (folds.gain_errors, folds.period_errors, folds.amplitude_errors)
        return np.column_stack(values), np.column_stack(errors), folds, seconds
    orbit = find_orbit(servo, model, GAIN, options=options)
    began = time.process_time()
    orbits = orbit_ensemble(servo, model, GAIN, names, rows, options=options, orbit=orbit)
    seconds = time.process_time() - began
    found = np.column_stack((orbits.periods, orbits.amplitudes))
    return found, np.column_stack((orbits.period_errors, orbits.amplitude_errors)), orbits, seconds


def one(kind: str, model: Any, servo: Servo, tol: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and errors of one servo, as `together`; nan where there is no answer."""
    options = Options(tol=tol)
    try:
        if kind == "folds":
            fold = find_fold(servo, model, options=options)
            orbit, gains, gain_errors = fold.orbit, [fold.gain], [fold.gain_error]
        else:
            orbit, gains, gain_errors = find_orbit(servo, model, GAIN, options=options), [], []
    except NoOrbit:
        return np.array([np.nan]), np.array([np.nan])
    values = [*gains, orbit.period, orbit.amplitude]
    return np.array(values), np.array([*gain_errors, orbit.period_error, orbit.amplitude_error])


def share(values: np.ndarray, errors: np.ndarray, known: np.ndarray, known_errors: np.ndarray) -> float:
    """The largest difference in units of both errors; 0 where neither has an answer, infinite where one of them has."""
    if np.isnan(known).any() or np.isnan(values).any():
        return 0.0 if np.isnan(known).any() and np.isnan(values).any() else np.inf
    return float(np.max(np.abs(values / known - 1) / (errors + known_errors)))


def compared(kind: str, model: str, count: int, seed: int) -> int:
    """Compare, print, and return how many are wrong."""
    names, rows = servos(model, count, seed)
    values, errors, ensemble, seconds = together(kind, model, names, rows)
    peak, wrong, differ, worst, alone = peak_memory(), 0, 0, 0.0, 0.0
    for i, row in enumerate(rows):
        servo = table1.servo().replace(**dict(zip(names, map(float, row), strict=True)))
        began = time.process_time()
        single = one(kind, model, servo, TOLERANCE)
        alone += time.process_time() - began
        off = share(values[i], errors[i], *single)
        worst = max(worst, off)
        if off > 1:
            sharp = one(kind, model, servo, TOLERANCE / 1000)
            ours, theirs = share(values[i], errors[i], *sharp), share(*single, *sharp)
            differ, wrong = differ + 1, wrong + (not ours <= 1)
            print(f"  member {i} ({ensemble.how[i]}): {off:.3g} of both errors from the single way; from its sharper "
                  f"answer {ours:.3g}, the single way {theirs:.3g}", flush=True)  # fmt: skip
    ways = ", ".join(f"{n} {how}" for how, n in sorted(Counter(ensemble.how).items()))
    print(
        f"{kind} of {count} {model} servos: {seconds:.2f} s together ({ways}; {peak:.0f} MB), {alone:.1f} s one "
        f"by one; largest difference {worst:.3g} of both errors, {differ} differ; wrong: {wrong}",
        flush=True,
    )
    return wrong


def main() -> int:
    """Compare what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="servos (default 1000)")
    parser.add_argument("--model", nargs="+", choices=("switch", "lugre"), default=["switch", "lugre"])
    parser.add_argument("--what", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    wrong = [compared(kind, model, given.count, given.seed) for model in given.model for kind in given.what]
    return int(any(wrong))


if __name__ == "__main__":
    sys.exit(main())
