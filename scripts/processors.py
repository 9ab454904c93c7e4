"""Every processor gives the same answers: digits may differ within their errors, words may not.

    python scripts/processors.py [--servos N] [--lugre N] [--seed S] [--gallery NAME ...] [--processors NAME ...]
                                 [--tol T] [--jobs N] [--limit W] [--out FILE.json]

OpenBLAS and numpy choose their kernels by the processor, and these round differently.  Another processor can be had by
name: OPENBLAS_CORETYPE=Haswell and numpy's faster instructions switched off; `own` is the machine as it is.  Under
every name, in a process of its own, these questions are asked:

    servo      drawn as in history.py: its fold; the stable and the unstable cycle at a share of the fold gain between
               0.3 and 0.995; the branch from the stable one round the fold and down to half the gain, with all its
               special points; the verdict on a motion there.  The first name says at which gains.
    gallery    the cycles of problems/, and the branch of canudas_gain.py with its special points

An answer is words: phases, status, stability, kinds of special points, what is missing, why it ended, the kind of a
verdict, or the sentence of a refusal, its numbers left out; and numbers with their errors, of which those are compared
that both processors know.  Special points are located to the tolerance.  What of a servo is given up after the work W,
which is a limit of this script, is no answer: it is counted and not compared.  The gallery has no limit.

Prints a table and everything that differs in its words, or in a number by more than the sum of both errors; exit code 1
if anything does.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Options, effort, find_fold, find_orbit, simulate  # noqa: E402
from casahunt.continuation import follow  # noqa: E402
from problems import canudas_gain  # noqa: E402
from scripts.history import SHARES, WORK, draw  # noqa: E402

OWN = "own"
PROCESSORS = (OWN, "Prescott", "Nehalem", "Haswell", "Zen")
GALLERY = (
    "belt", "bouncing_ball", "canudas", "canudas_gain", "circle", "drill_string", "dry_friction", "impact_oscillator",
    "relay", "rossler", "two_spirals", "van_der_pol",
)  # fmt: skip
AS_FAR = 0.5
"""Share of its first gain down to which a branch is followed behind the fold."""
PERIODS = 12.0
"""Of the stable cycle, that a motion is followed for; from twice its amplitude."""
ROUNDING = 1e-11
"""Relative, below which no estimate of an error says anything."""
NUMBER = re.compile(r"[-+]?\d+([.,]\d+)*(e[-+]?\d+)?")

Answer = dict[str, Any]
"""{"words": {"status": ..., ...}, "numbers": {name: [value, absolute error], ...}}: JSON gives it back as it was."""
GIVEN_UP: Answer = {"words": {"status": "given up"}, "numbers": {}}


def environment(processor: str) -> dict[str, str]:
    """The variables of a process on that processor; `own` without those that the user has set."""
    asked = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES")
    if processor == OWN:
        return {name: value for name, value in os.environ.items() if name not in asked}
    try:
        from numpy._core._multiarray_umath import __cpu_dispatch__ as faster  # type: ignore[import-not-found]
    except ImportError:  # numpy 1
        from numpy.core._multiarray_umath import __cpu_dispatch__ as faster
    return os.environ | {"OPENBLAS_CORETYPE": processor, "NPY_DISABLE_CPU_FEATURES": " ".join(faster)}


def said(orbit: Any) -> Answer:
    """What is said of a cycle."""
    m = orbit.multipliers
    numbers = {
        "period": [orbit.period, orbit.period * orbit.period_error],
        "amplitude": [orbit.amplitude, orbit.amplitude * orbit.amplitude_error],
    }
    if m.trusted:
        numbers["leading multiplier"] = [abs(m.leading), m.leading_error]
    words = {"status": orbit.status.name, "phases": str(orbit.signature), "stable": orbit.stable}
    return {"words": words, "numbers": numbers}


def said_of_fold(fold: Any) -> Answer:
    """What is said of a fold: its leading multiplier is 1, and on which side of it the orbit lies is rounding."""
    answer = said(fold.orbit)
    known = {"leading multiplier": [1.0, 0.0], "gain": [fold.value, abs(fold.value) * fold.value_error]}
    words = {name: answer["words"][name] for name in ("status", "phases")}
    return {"words": words, "numbers": answer["numbers"] | known}


def said_of_branch(branch: Any, tol: float) -> Answer:
    """What is said of a branch: its special points, what it missed, how it ended."""
    points = [f"{s.kind}, {len(s.orbit.arcs)} phases" for s in branch.special]
    missed = [f"{m.kind}, {without_numbers(m.meaning)}" for m in branch.missed]
    # Next to a sharp fold no step converges: by what the last of many fails is rounding.
    stuck = hasattr(branch, "end") and branch.end.kind == "stuck"
    end = "stuck" if stuck else without_numbers(branch.ended)
    words = {"status": "answered", "points": points, "missed": missed, "end": end}
    values = {f"{k + 1}, {s.kind}": [s.value, tol * abs(s.value)] for k, s in enumerate(branch.special)}
    return {"words": words, "numbers": values}


def without_numbers(sentence: str) -> str:
    """A sentence whose digits may differ."""
    return NUMBER.sub("#", sentence)


def asked(question: Any, limit: float) -> tuple[Any, Answer | None]:
    """(what comes back, None), or (None, the refusal)."""
    with effort.counting_work(None, limit=limit):
        try:
            return question(), None
        except effort.GivenUp:
            return None, GIVEN_UP
        except NoOrbit as refusal:
            status = refusal.status.name if refusal.status else "there is none"
            words = {"status": f"refused, {status}", "sentence": without_numbers(str(refusal))}
            return None, {"words": words, "numbers": {}}


def servo_answers(
    seed: int, number: int, model: Any, gains: dict[str, float], first: bool, tol: float, limit: float
) -> Iterator[tuple[str, Answer]]:
    """(question, answer) about one servo; `gains` are the fold gains of the first processor, which puts them in."""
    servo, options, name = draw(seed, number), Options(tol=tol), f"{model} servo {number}"
    fold, refusal = asked(partial(find_fold, servo, model, options=options), limit)
    if refusal is None:
        if first:
            gains[name] = fold.gain
        refusal = said_of_fold(fold)
    yield f"{name}, fold", refusal
    if name not in gains:  # the first processor has found none
        return
    rng, stable = np.random.default_rng([seed, number, 1]), None
    for what in ("stable", "unstable"):
        gain = gains[name] * float(rng.uniform(*SHARES))
        branch: Any = what
        orbit, refusal = asked(partial(find_orbit, servo, model, gain, branch=branch, options=options), limit)
        stable = orbit if what == "stable" else stable
        yield f"{name}, {what} at gain {gain!r}", refusal or said(orbit)
    if stable is None:
        return
    way = partial(follow, stable, "gain", to=2 * gains[name], back=AS_FAR * stable.gain, options=options)
    branch, refusal = asked(way, limit)
    yield f"{name}, branch from gain {stable.gain!r}", refusal or said_of_branch(branch, tol)
    start = {"position": 1 + 2 * float(f"{stable.amplitude:.6g}"), "time": PERIODS * float(f"{stable.period:.6g}")}
    motion, refusal = asked(lambda: simulate(servo, model, stable.gain, **start), limit)
    yield f"{name}, motion at gain {stable.gain!r}", refusal or {
        "words": {"verdict": motion.verdict.kind, "status": motion.status.name, "end": without_numbers(motion.ended)},
        "numbers": {},
    }  # fmt: skip


def gallery_answers(name: str, tol: float, limit: float) -> Iterator[tuple[str, Answer]]:
    """(question, answer) of one problem."""
    if name == "canudas_gain":
        branch, refusal = asked(canudas_gain.symmetric, limit)
        yield f"{name}, branch", refusal or said_of_branch(branch, canudas_gain.TOL)
        return
    cycles, refusal = asked(lambda: list(import_module(f"problems.{name}").cycles(tol)), limit)
    if refusal is not None:
        yield f"{name}, cycles", refusal
        return
    for found in cycles:
        yield f"{name}, {found.caption}", said(found.orbit)


def answers(task: dict[str, Any]) -> dict[str, Any]:
    """All answers, and the gains at which they were asked for: what a process of another processor does."""
    first, out = task["gains"] is None, {}
    gains = dict(task["gains"] or {})
    for number, model in task["servos"]:
        out.update(servo_answers(task["seed"], number, model, gains, first, task["tol"], task["limit"]))
    for name in task["gallery"]:
        out.update(gallery_answers(name, task["tol"], math.inf))
    return {"gains": gains, "answers": out}


def on_processor(processor: str, task: dict[str, Any]) -> dict[str, Any]:
    """`answers` in a process on that processor."""
    began = time.perf_counter()
    run = subprocess.run(
        [sys.executable, __file__, "--answer"], input=json.dumps(task), env=environment(processor), text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    if run.returncode:
        raise SystemExit(f"{processor}: {run.stderr}")
    found: dict[str, Any] = json.loads(run.stdout)
    print(f"{processor}: {len(found['answers'])} answers, {time.perf_counter() - began:.0f} s", flush=True)
    return found


def unlike(a: Answer | None, b: Answer | None) -> str:
    """How two answers differ: "words", "digits" or not at all."""
    if GIVEN_UP in (a, b):
        return ""
    if a is None or b is None or a["words"] != b["words"]:
        return "words"
    for name in a["numbers"].keys() & b["numbers"].keys():
        (x, dx), (y, dy) = a["numbers"][name], b["numbers"][name]
        if not abs(x - y) <= dx + dy + ROUNDING * max(abs(x), abs(y)):
            return "digits"
    return ""


def differences(runs: dict[str, dict[str, Answer]]) -> dict[str, dict[str, str]]:
    """{question: {processor: how its answer differs from the first one's}}."""
    (_, first), *others = runs.items()
    found: dict[str, dict[str, str]] = {}
    for question in dict.fromkeys(q for run in runs.values() for q in run):
        for name, run in others:
            if how := unlike(first.get(question), run.get(question)):
                found.setdefault(question, {})[name] = how
    return found


def table(runs: dict[str, dict[str, Answer]]) -> str:
    """How many answers of each kind there are and differ, and these."""
    found, (first, *_) = differences(runs), runs
    kinds = dict.fromkeys(kind_of(q) for q in runs[first])
    lines = [f"{'':20s}{'asked':>7s}{'refused':>9s}{'given up':>10s}{'words':>7s}{'digits':>8s}"]
    for kind in [*kinds, ""]:
        part = [q for q in runs[first] if kind in ("", kind_of(q))]
        refused = sum(runs[first][q]["words"]["status"].startswith("refused") for q in part)
        given_up = sum(GIVEN_UP in [run.get(q) for run in runs.values()] for q in part)
        counts = [sum(how in found.get(q, {}).values() for q in part) for how in ("words", "digits")]
        lines.append(f"{kind or 'all':20s}{len(part):7d}{refused:9d}{given_up:10d}{counts[0]:7d}{counts[1]:8d}")
    for question, others in found.items():
        lines.append(f"{question}: {', '.join(f'{name} differs in {how}' for name, how in others.items())}")
        lines += [f"  {name}: {runs[name].get(question)}" for name in (first, *others)]
    return "\n".join(lines)


def kind_of(question: str) -> str:
    """switch fold, lugre branch, ...; gallery."""
    words = question.split()
    return f"{words[0]} {words[3]}" if words[1] == "servo" else "gallery"


def main(arguments: Sequence[str] | None = None) -> int:
    """Ask, compare, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--servos", type=int, default=60, help="Switch servos")
    parser.add_argument("--lugre", type=int, default=6, help="LuGre servos besides")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--gallery", nargs="*", default=GALLERY, help="files of problems/")
    parser.add_argument("--processors", nargs="+", default=PROCESSORS, help="the first one says at which gains")
    parser.add_argument("--tol", type=float, default=1e-6)
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--limit", type=float, default=WORK, help="work after which a servo is given up")
    parser.add_argument("--out", type=Path, help="file for all answers, JSON")
    parser.add_argument("--answer", action="store_true", help="what this script calls itself with")
    args = parser.parse_args(arguments)
    if args.answer:
        print(json.dumps(answers(json.load(sys.stdin))))
        return 0
    servos = [(k, "switch") for k in range(args.servos)] + [(k, "lugre") for k in range(args.lugre)]
    task = {"servos": servos, "gallery": list(args.gallery), "seed": args.seed, "tol": args.tol, "limit": args.limit}
    first, *others = args.processors
    asked_first = on_processor(first, task | {"gains": None})
    runs = {first: asked_first["answers"]}
    with ThreadPoolExecutor(args.jobs) as pool:
        found = pool.map(lambda name: on_processor(name, task | {"gains": asked_first["gains"]}), others)
        runs |= {name: run["answers"] for name, run in zip(others, found, strict=True)}
    if args.out:
        args.out.write_text(json.dumps(runs, indent=1), encoding="utf-8")
    print(table(runs))
    return 1 if differences(runs) else 0


if __name__ == "__main__":
    raise SystemExit(main())
