"""Threads: every public call at once from four threads gives the bits that it gives alone.

In processes of their own, so that a crash is a failed test.  Every process starts with nothing built: the threads of
the first build the same functions at the same time, the other does everything in one thread.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

SOLVES = """
import hashlib, sys
from concurrent.futures import ThreadPoolExecutor

from casahunt import Options, Servo, find_fold, find_orbit, simulate
from casahunt.servo.event_map.fixed_points import fixed_points
from casahunt.design.sensitivity import fold_sensitivities

sys.setswitchinterval(1e-5)  # threads take turns as often as they can
servo = Servo()

def orbit(model, branch, solver, gain):
    o = find_orbit(servo, model, gain, branch=branch, options=Options(tol=1e-6, solver=solver))
    return [o.period, o.amplitude, o.error_estimate, *(arc.states for arc in o.arcs)]

def multipliers(model, gain):
    o = find_orbit(servo, model, gain, options=Options(tol=1e-6))
    return [o.multipliers.half, o.multipliers.full, o.integrator_multipliers.half]

def fold(static):
    f = find_fold(servo.replace(**{"friction.static": static}), "switch", options=Options(tol=1e-6))
    return [f.gain, f.confirmed_gain, *fold_sensitivities(f).derivatives.values()]

def motion(model, gain):
    m = simulate(servo, model, gain, time=10.0)
    return [m.sample([1.0, 5.0, 10.0]), m.signal("torque", [1.0, 5.0, 9.0])]

def points(gain):
    seen = fixed_points(servo, gain, 0.02, 0.06, points=4)
    return [seen.to_dict(), *seen.points]

def bits(job):
    function, *given = job
    text = "".join(v.tobytes().hex() if hasattr(v, "tobytes") else repr(v) for v in function(*given))
    return " ".join(map(str, (function.__name__, *given, hashlib.sha256(text.encode()).hexdigest())))

jobs = []
for k in range(int(sys.argv[2])):
    gain = 0.05 + 0.003 * k
    jobs += JOBS
with ThreadPoolExecutor(int(sys.argv[1])) as pool:
    print(*pool.map(bits, jobs), sep="\\n")
"""

EVERY_CALL = """[
    (orbit, "switch", "stable", "newton", gain), (orbit, "lugre", "stable", "newton", gain),
    (orbit, "switch", "unstable", "newton", gain + 0.2), (orbit, "switch", "stable", "ipopt", gain),
    (motion, "switch", gain), (motion, "lugre", gain), (points, gain), (multipliers, "switch", gain),
    (fold, 0.53), (orbit, "lugre", "stable", "newton", gain), (orbit, "switch", "stable", "newton", gain),
]"""
"""One round, of a few seconds."""

MANY_EACH = """[
    (orbit, "switch", "stable", "auto", gain), (orbit, "lugre", "stable", "auto", gain),
    (orbit, "switch", "unstable", "auto", gain + 0.2), (orbit, "switch", "stable", "ipopt", gain),
    (motion, "switch", gain), (motion, "lugre", gain), (points, gain),
    (orbit, *(("switch", "stable", "ipopt") if k % 10 else ("lugre", "unstable", "auto")), gain + 0.2),
]"""
"""Twelve rounds are 96 solves, 24 a thread."""


def solved(jobs: str, *, threads: int, rounds: int) -> list[str]:
    """One line a solve, with the digest of everything that came out."""
    script = SOLVES.replace("JOBS", jobs)
    run = subprocess.run(
        [sys.executable, "-X", "faulthandler", "-c", script, str(threads), str(rounds)],
        cwd=ROOT, capture_output=True, text=True, timeout=900, env=os.environ | {"OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert run.returncode == 0, f"exit code {run.returncode}\n{run.stderr[-3000:]}"
    return run.stdout.splitlines()


def test_four_threads_give_the_bits_of_one():
    assert solved(EVERY_CALL, threads=4, rounds=1) == solved(EVERY_CALL, threads=1, rounds=1)


@pytest.mark.slow
def test_four_threads_with_many_solves_each():
    alone = solved(MANY_EACH, threads=1, rounds=12)
    assert len(alone) == 96
    assert solved(MANY_EACH, threads=4, rounds=12) == alone
