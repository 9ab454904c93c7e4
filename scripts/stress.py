"""Numerical stability under a grid of extremes: solved, rightly found to have no cycle, honestly refused, or wrong.

    python scripts/stress.py [--out DIR] [--quick] [--jobs N] [--rows WORD ...] [--limit N] [--no-extras]

The grid: from the servo of Table 1, one parameter at a time to its extremes, then pairs at their extremes, then
seeded random servos; for each of them and for both friction models the fold, and the stable and the unstable cycle at
half the fold gain; and at Table 1 itself gains from 1e-3 to 0.9999 of the fold and beyond it, tolerances from 1e-2 to
1e-12, degrees 2 to 9 of both kinds.  sigma1 goes to and
beyond its passivity limit.  The parts are in scripts/extremes/.

Truth is never the solve in question:

    Switch cycles   Taylor series with events (problems/taylor.py): P(a) - a changes sign within the claimed error, its
                    root gives the true amplitude and the period
    LuGre cycles    half a cycle by Taylor series from the computed state, where its stiffness allows, whose closure,
                    period and amplitude may be off by 10 (1 + |mu|) errors; and always a second solve
    folds           a second solve; for Switch also no stable fixed point of the map by Taylor 2 % above
    second solve    another collocation degree and kind, a tolerance 100 times tighter
    no cycle        the scan of the map by Taylor shows none (Switch; for LuGre the same map, which lies close), or the
                    gain lies beyond the confirmed fold

A case is wrong if the true error exceeds 10 times the estimate or 10 times the tolerance (rounding apart), if a
refusal denies a cycle that exists or names no reason, or if anything but NoOrbit is raised.  Refusals where no truth
is at hand count as refused although a cycle exists, answers that nothing could be compared with as unchecked.

Writes stress.csv, stress.json, stress.png; prints the summary; exit code 1 if anything is wrong.
"""

from __future__ import annotations

import argparse
import csv
import json
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt.interrupts import end_with_parent  # noqa: E402
from scripts.extremes.beyond import extras  # noqa: E402
from scripts.extremes.cases import WRONG, Result, grid  # noqa: E402
from scripts.extremes.desk import jobs_of, run_job  # noqa: E402
from scripts.extremes.table import flat, picture, summary  # noqa: E402


def arguments_of(words: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="stress", metavar="DIR", help="folder to write into (default stress)")
    parser.add_argument("--quick", action="store_true", help="the ends of each row, one question each")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--rows", nargs="+", metavar="WORD", help="only rows whose name starts so")
    parser.add_argument("--limit", type=int, metavar="N", help="only the first N cases")
    parser.add_argument("--minutes", type=float, metavar="M", help="begin no more cases of the grid after this time")
    parser.add_argument("--no-extras", action="store_true", help="the grid alone")
    options = parser.parse_args(words)
    options.cases = grid(options.quick)
    if options.rows:
        options.cases = [c for c in options.cases if c.row.startswith(tuple(options.rows))]
    options.cases = options.cases[: options.limit]
    if not options.cases:
        parser.error("no such rows")
    return options


def pool_of(processes: int, tasks: int | None = None) -> ProcessPoolExecutor:
    """Fresh interpreters, each for so many tasks."""
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(
        max(processes, 1), mp_context=context, initializer=end_with_parent, max_tasks_per_child=tasks
    )


def answered(options: argparse.Namespace, began: float) -> list[Result]:
    """The verdicts on the cases, in their order; those that the time was too short for are left out."""
    jobs = jobs_of(options.cases, options.quick)
    results: list[Result] = []
    if options.jobs <= 1:
        results = [r for job in jobs for r in run_job(job)]
    else:
        with pool_of(options.jobs) as pool:
            for number, future in enumerate([pool.submit(run_job, job) for job in jobs], 1):
                if options.minutes and time.perf_counter() - began > 60 * options.minutes and future.cancel():
                    continue
                batch = future.result()
                results += batch
                last = batch[-1]
                found = ", ".join(r.verdict for r in batch)
                print(f"{number}/{len(jobs)} {last.case.model} {last.case.row} {last.case.column}: {found}",
                      file=sys.stderr, flush=True)  # fmt: skip
    place = {case: number for number, case in enumerate(options.cases)}
    return sorted(results, key=lambda r: place[r.case])


def write(out: Path, results: list[Result], whole: dict[str, Any]) -> None:
    """stress.json, stress.csv and stress.png."""
    (out / "stress.json").write_text(json.dumps(whole, indent=1) + "\n")
    with (out / "stress.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(flat(results[0])))
        writer.writeheader()
        writer.writerows(flat(r) for r in results)
    picture(results, out / "stress.png")


def main(arguments: list[str] | None = None) -> int:
    """Run, judge, write, print; the exit code."""
    options = arguments_of(arguments)
    began = time.perf_counter()
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    results = answered(options, began)
    facts, complaints = {}, []
    if not options.no_extras:
        with pool_of(options.jobs, tasks=1) as pool:
            facts, complaints = extras(pool, options.quick)
    numbers, lines = summary(results)
    seconds = time.perf_counter() - began
    whole = {"seconds": seconds, "summary": numbers, "extras": facts, "complaints": complaints,
             "cases": [flat(r) for r in results]}  # fmt: skip
    write(out, results, whole)
    print("\n".join(lines))
    for known in facts.get("branches", []) + facts.get("leaks", []):
        print(known)
    if facts:
        print(f"perturbed starts: {facts['perturbed_starts']['counts']}; same bits: {facts['same_bits']}")
    for text in complaints:
        print(f"WRONG {text}")
    left = len(options.cases) - len(results)
    print(f"{len(results)} cases in {seconds:.0f} s" + (f", {left} not run" if left else ""))
    return int(bool(complaints) or numbers["all"][WRONG] > 0)


if __name__ == "__main__":
    sys.exit(main())
