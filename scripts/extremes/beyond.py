"""Beyond the grid: perturbed starts, the same bits again, long branches, memory and leaks."""

from __future__ import annotations

import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from casahunt import Options, Servo, find_fold, find_orbit
from casahunt.continuation.walk import walk
from casahunt.orbits.adapt import solve_adaptively
from casahunt.orbits.orbit import unknowns_of
from casahunt.servo.friction import MODELS
from scripts.limits import memory, peak_memory

MEMORY_LIMIT, LEAK_LIMIT, LEAK_GAINS = 400.0, 20.0, 5
"""Peak memory [MB]; growth per solve [kB] over the second half of the solves, at this many gains in turn."""


def perturbed_starts(quick: bool) -> dict[str, Any]:
    """Every unknown of an orbit moved at random; what the solver then calls a solution must be that orbit."""
    rng, counts, wrong = np.random.default_rng(3), Counter[str](), []
    for model in MODELS:
        for branch in ("stable", "unstable"):
            orbit = find_orbit(Servo(), model, 0.3, branch=branch, options=Options(tol=1e-8))  # type: ignore[arg-type]
            t, u, setting = unknowns_of(orbit)
            for size in (1e-4, 1e-3, 1e-2, 1e-1):
                for solver in ("newton", "ipopt"):
                    for _ in range(1 if quick else 5):
                        start = u * np.exp(size * rng.standard_normal(u.size))
                        found = solve_adaptively(orbit.problem, (t, start, setting), Options(tol=1e-8), solver=solver)
                        if not found.status.ok:
                            counts[f"{size:g} refused"] += 1
                            continue
                        period = 2 * float(np.sum(found.t.durations_of(found.solution.u)))
                        same = abs(period / orbit.period - 1) <= 1e-7
                        counts[f"{size:g} {'same orbit' if same else 'another root'}"] += 1
                        if not same:
                            what = f"{model} {branch} {solver} {size:g}"
                            wrong.append(f"{what}: period {period:.10g}, not {orbit.period:.10g}")
    return {"counts": dict(sorted(counts.items())), "other": wrong}


def bits(rounds: int) -> list[str]:
    """Orbits and folds as exact texts, several times over."""
    out = []
    for model in MODELS * rounds:
        for branch in ("stable", "unstable"):
            orbit = find_orbit(Servo(), model, 0.3, branch=branch)  # type: ignore[arg-type]
            out += [orbit.amplitude.hex(), orbit.period.hex(), orbit.half_multiplier.hex()]
        out.append(find_fold(Servo(), model).gain.hex())  # type: ignore[arg-type]
    return out


def long_branch(job: tuple[str, int]) -> dict[str, Any]:
    """A branch of many points, all kept: points, time, memory."""
    model, points = job
    began, before = time.perf_counter(), memory()
    start = find_orbit(Servo(), model, 0.0321)  # type: ignore[arg-type]
    kept = []
    for orbit in walk(start, low=0.0321, high=10, largest_step=4.0 / points, max_points=points):
        kept.append(orbit)
        if len(kept) == points:
            break
    return {"model": model, "points": len(kept), "seconds": time.perf_counter() - began,
            "memory_before_MB": before, "peak_MB": peak_memory()}  # fmt: skip


def leak(job: tuple[str, int]) -> dict[str, Any]:
    """Many solves: memory after the first tenth, half and all of them.

    The same few gains again and again: transcriptions and compiled maps of new mesh sizes are kept for reuse, up to a
    number, which is no leak.
    """
    model, solves = job
    seen = []
    for k in range(solves):
        find_orbit(Servo(), model, 0.04 + 0.5 * (k % LEAK_GAINS * 0.618034 % 1))  # type: ignore[arg-type]
        if k + 1 in (solves // 10, solves // 2, solves):
            seen.append(memory())
    growth = 1024 * (seen[-1] - seen[-2]) / (solves - solves // 2)
    return {"model": model, "solves": solves, "memory_MB": seen, "growth_kB_per_solve": growth,
            "peak_MB": peak_memory()}  # fmt: skip


def extras(pool: ProcessPoolExecutor, quick: bool) -> tuple[dict[str, Any], list[str]]:
    """(facts, complaints).  Every task has a process of its own."""
    points, solves = (100, 100) if quick else (1000, 1000)
    branches = [pool.submit(long_branch, (model, points)) for model in MODELS]
    leaks = [pool.submit(leak, (model, solves)) for model in MODELS]
    starts, first, again = pool.submit(perturbed_starts, quick), pool.submit(bits, 2), pool.submit(bits, 1)
    facts: dict[str, Any] = {
        "branches": [b.result() for b in branches], "leaks": [x.result() for x in leaks],
        "perturbed_starts": starts.result(), "same_bits": first.result() == again.result() * 2,
    }  # fmt: skip
    complaints = [f"perturbed start: {text}" for text in facts["perturbed_starts"]["other"]]
    if not facts["same_bits"]:
        complaints.append("repeated solves differ in their bits")
    for known in facts["branches"] + facts["leaks"]:
        if known["peak_MB"] > MEMORY_LIMIT:
            complaints.append(f"{known['peak_MB']:.0f} MB of memory: {known}")
        if known.get("growth_kB_per_solve", 0) > LEAK_LIMIT and not quick:  # caches still fill
            complaints.append(f"a leak: {known}")
    return facts, complaints
