"""No history: what is computed does not depend on what was computed before in the process, nor on what is still kept.

    python scripts/history.py [--servos N] [--lugre N] [--seed S] [--orders N] [--tol T] [--solver S] [--limit W]
                              [--out FILE.json]

Every servo, drawn log-uniformly from `RANGES`, is asked for its fold, and for its stable and its unstable cycle at a
share of the fold gain between 0.3 and 0.995, in these runs:

    alone      every question in a process of its own
    together   all questions of all servos in one process, in a random order; `--orders` such runs:
               with the caches as they are; with all of them emptied before every other question; with all of them
               shrunk to one entry; and again, in other orders

An answer is its numbers in hexadecimal digits (fold: gain, its error, the optimised gain; both: period, amplitude,
error estimate, leading multiplier) or the sentence of the refusal, and the work that it took (effort.py): a path that
differs and ends in the same bits is a difference.  A question whose answer takes more than the work W is given up, in
every run at the same place.

Prints a table and every difference; exit code 1 if there is one.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Options, Servo, effort, find_fold, find_orbit  # noqa: E402
from casahunt.compiled import Kept, alone  # noqa: E402
from casahunt.interrupts import end_with_parent  # noqa: E402

RANGES: dict[str, tuple[float, float]] = {
    "friction.static": (0.2, 3.0),
    "friction.coulomb": (1.05, 2.0),  # static over coulomb
    "friction.stribeck_velocity": (0.005, 0.1),
    "friction.viscous": (0.01, 0.5),
    "servo.inertia": (0.005, 0.2),
    "servo.motor_gain": (2.0, 30.0),
    "controller.integral_time": (0.05, 0.5),
    "controller.lead_time": (0.05, 0.5),
}
SHARES = (0.3, 0.995)
"""Of the fold gain: smallest and largest at which cycles are asked for."""
WORK = 8e5
"""Work after which an answer is given up: about 20 s."""

Model = Literal["switch", "lugre"]
Caches = Literal["kept", "emptied", "one entry"]
TREATMENTS: tuple[Caches, ...] = ("kept", "emptied", "one entry")


class Question(NamedTuple):
    """One call: `what` is fold, stable or unstable; a gain of 0 belongs to a fold."""

    number: int
    model: Model
    what: str
    gain: float


Answer = list[str]
"""Numbers in hexadecimal digits or a sentence, and the work; JSON gives it back as it was."""


def draw(seed: int, number: int) -> Servo:
    """Servo `number`: the same whatever else is drawn."""
    rng = np.random.default_rng([seed, number])
    out = {key: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for key, (low, high) in RANGES.items()}
    out["friction.coulomb"] = out["friction.static"] / out["friction.coulomb"]
    return Servo().replace(**out)


def answer(seed: int, question: Question, options: Options, limit: float) -> Answer:
    """What the program says, to the last bit."""
    servo = draw(seed, question.number)
    with effort.counting_work(None, limit=limit) as watch:
        try:
            if question.what == "fold":
                fold = find_fold(servo, question.model, options=options)
                found, numbers = fold.orbit, [fold.gain, fold.gain_error, fold.confirmed_gain]
            else:
                branch: Any = question.what
                found, numbers = find_orbit(servo, question.model, question.gain, branch=branch, options=options), []
        except (NoOrbit, effort.GivenUp) as refusal:
            return [str(refusal), str(watch.work)]
        leading = complex(found.multipliers.leading)
        numbers += [found.period, found.amplitude, found.error_estimate, leading.real, leading.imag]
        return [*(float(x).hex() for x in numbers), str(watch.work)]


def caches() -> Iterator[tuple[Kept[Any, Any] | Any, list[tuple[Any, str]]]]:
    """(every cache of the package, the places (module, name) where it stands)."""
    places: dict[int, tuple[Any, list[tuple[Any, str]]]] = {}
    for key, module in list(sys.modules.items()):
        if key.startswith("casahunt"):
            for name, value in list(vars(module).items()):
                if isinstance(value, Kept) or hasattr(value, "cache_clear"):
                    places.setdefault(id(value), (value, []))[1].append((module, name))
    yield from places.values()


def emptied() -> None:
    """Forget everything that the package keeps."""
    for cache, _ in caches():
        (alone(cache._cached.cache_clear) if isinstance(cache, Kept) else cache.cache_clear)()


_LARGE: list[tuple[Any, str, Any]] = []
"""(object, attribute, value) of what `shrunk` has replaced."""


def shrunk() -> None:
    """Let every cache of the package keep one entry from now on."""
    for cache, places in caches():
        small = lru_cache(1)(alone(cache.__wrapped__) if isinstance(cache, Kept) else cache.__wrapped__)
        for owner, name in [(cache, "_cached")] if isinstance(cache, Kept) else places:
            _LARGE.append((owner, name, getattr(owner, name)))
            setattr(owner, name, small)


def restored() -> None:
    """Give the caches the size that they had."""
    while _LARGE:
        setattr(*_LARGE.pop())


def answers(
    seed: int, questions: Sequence[Question], treatment: Caches, options: Options, limit: float
) -> list[tuple[Question, Answer]]:
    """The answers to questions in this order, in this process."""
    if treatment == "one entry":
        shrunk()
    out = []
    for i, question in enumerate(questions):
        if treatment == "emptied" and i % 2:
            emptied()
        out.append((question, answer(seed, question, options, limit)))
    return out


def differences(runs: dict[str, dict[Question, Answer]]) -> dict[Question, list[str]]:
    """The questions that were not answered alike in all runs, with the runs that differ from the first."""
    first, *others = runs.values()
    names = list(runs)[1:]
    return {
        question: unlike
        for question, said in first.items()
        if (unlike := [name for name, run in zip(names, others, strict=True) if run[question] != said])
    }


def in_a_new_process(*arguments: Any) -> list[tuple[Question, Answer]]:
    """`answers` where nothing was computed before."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=end_with_parent) as pool:
        return pool.submit(answers, *arguments).result()


def alone_each(
    seed: int, numbers: Sequence[tuple[int, Model]], options: Options, limit: float
) -> dict[Question, Answer]:
    """Every question in a process of its own; the fold, asked first, places the gains of the others."""
    run: dict[Question, Answer] = {}
    for number, model in numbers:
        fold = Question(number, model, "fold", 0.0)
        ((_, run[fold]),) = in_a_new_process(seed, [fold], "kept", options, limit)
        if len(run[fold]) == 2:  # a sentence
            print(f"{model} {number}: {run[fold][0]}", flush=True)
            continue
        rng = np.random.default_rng([seed, number, 1])
        for what in ("stable", "unstable"):
            gain = float.fromhex(run[fold][0]) * float(rng.uniform(*SHARES))
            question = Question(number, model, what, gain)
            ((_, run[question]),) = in_a_new_process(seed, [question], "kept", options, limit)
    return run


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--servos", type=int, default=60, help="Switch servos")
    parser.add_argument("--lugre", type=int, default=6, help="LuGre servos besides")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--orders", type=int, default=3, help="runs together")
    parser.add_argument("--tol", type=float, default=1e-6)
    parser.add_argument("--solver", choices=("auto", "newton", "ipopt"), default="auto")
    parser.add_argument("--limit", type=float, default=WORK, help="work after which an answer is given up")
    parser.add_argument("--out", type=Path, help="file for all answers, JSON")
    args = parser.parse_args(arguments)
    numbers: list[tuple[int, Model]] = [(k, "switch") for k in range(args.servos)]
    numbers += [(k, "lugre") for k in range(args.lugre)]
    options = Options(tol=args.tol, solver=args.solver)
    began = time.perf_counter()
    runs = {"alone": alone_each(args.seed, numbers, options, args.limit)}
    questions = list(runs["alone"])
    print(f"alone: {len(questions)} questions, {time.perf_counter() - began:.0f} s", flush=True)
    for k in range(args.orders):
        treatment = TREATMENTS[k % len(TREATMENTS)]
        order = [questions[i] for i in np.random.default_rng([args.seed, 2, k]).permutation(len(questions))]
        began, name = time.perf_counter(), f"order {k + 1}, caches {treatment}"
        runs[name] = dict(in_a_new_process(args.seed, order, treatment, options, args.limit))
        unlike = differences({"alone": runs["alone"], name: runs[name]})
        print(f"{name}: {len(unlike)} differ from alone, {time.perf_counter() - began:.0f} s", flush=True)
    if args.out:
        saved = {name: [[*q, a] for q, a in run.items()] for name, run in runs.items()}
        args.out.write_text(json.dumps(saved, indent=1), encoding="utf-8")
    print(table(runs))
    return 1 if differences(runs) else 0


def table(runs: dict[str, dict[Question, Answer]]) -> str:
    """Questions by model and kind: how many, how many refused, how many not alike in all runs; and these."""
    unlike = differences(runs)
    said = runs["alone"]
    lines = [f"{'model':8s}{'what':10s}{'asked':>7s}{'refused':>9s}{'differ':>8s}"]
    for model in ("switch", "lugre"):
        for what in ("fold", "stable", "unstable"):
            part = [q for q in said if (q.model, q.what) == (model, what)]
            if part:
                refused = sum(len(said[q]) == 2 for q in part)
                lines.append(f"{model:8s}{what:10s}{len(part):7d}{refused:9d}{sum(q in unlike for q in part):8d}")
    for q, names in unlike.items():
        lines.append(f"{q.model} servo {q.number}, {q.what}{f' at gain {q.gain!r}' if q.gain else ''}:")
        lines += [f"  {name}: {' '.join(runs[name][q])}" for name in ("alone", *names)]
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
