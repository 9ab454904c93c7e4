"""Folds and cycles of many servos at once against each of them alone: are they the same, and what do they cost?

    python scripts/ensembles.py [--count 1000] [--model switch lugre] [--what folds orbits] [--seed 0]

Servos about that of Table 1, every parameter drawn from +-2 %: fold gains differ by factors of two; cycles at K = 0.4.
A member is wrong where its gain, period or amplitude differs from that of `find_fold` or `find_orbit`
by more than both error estimates together, or where one of the two ways has an answer and the other one none.
Prints a line for each model and kind, a line for each wrong member, and ends with status 1 where there is one.
Times are processor times of this process, without the known fold or cycle.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Options, Servo, find_fold, find_orbit  # noqa: E402
from casahunt.design.ensemble import fold_ensemble, orbit_ensemble  # noqa: E402
from problems import table1  # noqa: E402
from scripts.limits import peak_memory  # noqa: E402

GAIN, TOLERANCE, SPREAD = 0.4, 1e-8, 0.02
KINDS = ("folds", "orbits")


def drawn(model: str, count: int, seed: int) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the parameters that a model has, and `count` rows of them."""
    own = table1.servo()
    bristle = ("friction.stiffness", "friction.damping") if model == "switch" else ()
    names = tuple(name for name in own.names if name not in ("gain", *bristle))
    values = dict(zip(own.names, own.parameters(1.0), strict=True))
    ways = np.random.default_rng(seed).uniform(-1, 1, (count, len(names)))
    return names, np.array([values[name] for name in names]) * (1 + SPREAD * ways)


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


def one(kind: str, model: Any, servo: Servo) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Values and errors of one servo, as `together`; NoOrbit where there is none."""
    options = Options(tol=TOLERANCE)
    if kind == "folds":
        fold = find_fold(servo, model, options=options)
        orbit = fold.orbit
        errors = fold.gain_error, orbit.period_error, orbit.amplitude_error
        return (fold.gain, orbit.period, orbit.amplitude), errors
    orbit = find_orbit(servo, model, GAIN, options=options)
    return (orbit.period, orbit.amplitude), (orbit.period_error, orbit.amplitude_error)


def compared(kind: str, model: str, count: int, seed: int, say: Callable[[str], None] = print) -> int:
    """Compare, print, and return how many are wrong."""
    names, rows = drawn(model, count, seed)
    values, errors, ensemble, seconds = together(kind, model, names, rows)
    peak, wrong, worst = peak_memory(), 0, 0.0
    began = time.process_time()
    for i, row in enumerate(rows):
        servo = table1.servo().replace(**dict(zip(names, map(float, row), strict=True)))
        try:
            known, known_errors = map(np.array, one(kind, model, servo))
            share = float(np.max(np.abs(values[i] / known - 1) / (errors[i] + known_errors)))
        except NoOrbit as error:
            share = np.inf if np.isfinite(values[i]).any() else 0.0
            known = np.array([str(error)])
        worst = max(worst, share) if np.isfinite(share) else np.inf
        if not share <= 1:
            wrong += 1
            say(f"  wrong: member {i} ({ensemble.how[i]}): {values[i]} and {known}, {share:.3g} of both errors")
    alone = time.process_time() - began
    ways = ", ".join(f"{n} {how}" for how, n in sorted(Counter(ensemble.how).items()))
    say(
        f"{kind} of {count} {model} servos: {seconds:.2f} s together ({ways}; {peak:.0f} MB), {alone:.1f} s one by one, "
        f"{alone / seconds:.0f} times; largest difference {worst:.2g} of both errors; wrong: {wrong}"
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
