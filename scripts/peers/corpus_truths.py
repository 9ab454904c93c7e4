"""What scripts/corpus.py asks of random servos, and what independent programs know of it: writes answers/truths.json.

    python -m scripts.peers.corpus_truths [--first 0] [--servos 300] [--out FILE]      two hours

The gain of a servo is a share of its fold gain, of four digits, and fixed from then on: whoever compares two versions
asks both of them the same.  Folds and cycles: event map (switch_search.py) and Taylor series (lugre_search.py, for the
first `LUGRE` servos), next to the package's; loops of parts: scipy (part_motion.py).  Rows without a truth are those of
which these programs know nothing, or see no more digits than would judge an estimate.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from casahunt import NoOrbit, find_fold, find_orbit
from scripts.answers import loops, servos
from scripts.limits import TooSlow, within
from scripts.parts import AGREES, LONGEST
from scripts.peers.lugre_search import LugreTruth
from scripts.peers.switch_search import SwitchTruth

LUGRE = 20
SECONDS = 60.0
"""Of processor time, for one answer of either side."""
NAMES = ("gain", "amplitude", "period")


def known_of(truth: Any, fold: bool) -> dict[str, list[float]]:
    """{name: [value, error]} of what an engine knows."""
    error = max(float(truth.noise), 1e-15)
    values = {name: float(getattr(truth, name)) for name in NAMES[not fold :]}
    return {name: [value, error * abs(value)] for name, value in values.items()}


def patiently(question: Any, *arguments: Any) -> Any:
    """What comes back within the time; None beyond it, or where there is nothing."""
    try:
        with within(SECONDS):
            return question(*arguments)
    except (NoOrbit, TooSlow):
        return None


def of_servo(model: str, number: int) -> Iterator[tuple[str, Any]]:
    """("gain", K), and (what, truth) of fold, stable and unstable cycle."""
    servo = servos.drawn(number)
    fold = patiently(find_fold, servo, model)
    if fold is None:
        return
    gain = servos.rounded(servos.share(number) * fold.gain)
    yield "gain", gain
    engine = SwitchTruth(servo) if model == "switch" else LugreTruth(servo)
    engine.patient = False
    if model == "lugre" and number >= LUGRE:
        return
    if (truth := patiently(engine.fold, fold)) is not None:
        yield "fold", known_of(truth, True)
    for branch in ("stable", "unstable"):
        orbit = patiently(lambda branch=branch: find_orbit(servo, model, gain, branch=branch))
        if orbit is not None and (truth := patiently(engine.next_to, orbit)) is not None:
            yield branch, known_of(truth, False)


def of_loop(kind: str, number: int) -> dict[str, list[float]] | None:
    """Period and amplitude of the cycle on which a motion settles, by scipy."""
    if (made := loops.made(kind, number)) is None:
        return None
    _, peer, start, period = made
    try:
        with within(SECONDS):
            T, a, _ = peer.cycle(peer.rest(start["x1"]), LONGEST * period)
    except (RuntimeError, TooSlow):
        return None
    return {"period": [T, AGREES * T], "amplitude": [a, AGREES * a]}


def main() -> int:
    """Compute what the file lacks, and write it after every servo."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--servos", type=int, default=servos.SERVOS)
    parser.add_argument("--model", nargs="+", default=list(servos.MODELS))
    parser.add_argument("--loops", action="store_true", help="the loops instead")
    parser.add_argument("--out", type=Path, default=servos.TRUTHS)
    args = parser.parse_args()
    known: dict[str, Any] = json.loads(args.out.read_text()) if args.out.exists() else {}
    jobs: list[tuple[str, Any]] = [
        (f"{model} {n}", lambda model=model, n=n: dict(of_servo(model, n)))
        for n in range(args.first, args.first + args.servos) for model in args.model
    ]  # fmt: skip
    if args.loops:
        jobs = [(f"loop {k} {n}", lambda k=k, n=n: of_loop(k, n)) for k, n in loops.chosen()]
    for name, job in jobs:
        if name not in known:
            known[name] = job()
            print(name, known[name], flush=True)
            rows = ",\n".join(f"{json.dumps(name)}: {json.dumps(row)}" for name, row in known.items())
            beside = args.out.with_suffix(".new")
            beside.write_text(f"{{\n{rows}\n}}\n", encoding="ascii")
            beside.replace(args.out)  # whoever reads meanwhile, reads all of it
    return 0


if __name__ == "__main__":
    sys.exit(main())
