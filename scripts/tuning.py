"""Random tune tasks with uncertainty sets, judged by other engines: python-control and an event map of its own.

    python scripts/tuning.py [--quick] [--tasks N] [--seed S] [--only I] [--out FILE.json]

An answer is wrong where a corner or one of 200 samples of the set misses a demand: its linear loop by python-control
(poles, crossovers, margins; the delay exact on the frequency axis, and as a Pade approximation in the poles), its
cycles by an event map of Taylor series with events (heyoka; both are in the extra `bench`).  A refusal is wrong where
a grid search of its own over times and gains finds a feasible point.  Nothing of casahunt takes part in the judging but
the record of the servo.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt.design.tune.demands import Demands  # noqa: E402
from casahunt.design.tune.tuning import Tuning, tune  # noqa: E402
from casahunt.design.uncertainty.set import Uncertainty  # noqa: E402
from casahunt.errors import NoOrbit  # noqa: E402
from casahunt.servo.servo import Servo  # noqa: E402
from scripts.limits import TooSlow, within  # noqa: E402
from scripts.peers.stick_map import FIELDS, TIMES, Array, Hunts, largest_ratio, row_of  # noqa: E402

SAMPLES = 200
GAIN_SLACK = 1e-4
"""Relative tolerance of a fold gain: that of the event map on its grid of stick positions."""
PHASE_SLACK = 0.02
"""Tolerance of a phase margin [deg]."""
TRIED, FINEST = 8, 0.02
"""Gains tried at a pair of times, and the smallest step in the logarithm of a time."""
CLEAR = 0.01
"""A grid point counts as feasible where every demand is kept with this relative room in gain."""


def loop_faults(row: Array, gain: float, demands: Demands) -> list[str]:
    """What a linear loop misses, by python-control."""
    import control

    J, cm, lead, integral, *_, viscous = row
    numerator = gain * cm * np.array([lead * integral, lead + integral, 1.0])
    loop = control.tf(numerator, integral * np.array([J, viscous, 0.0, 0.0]))
    _, phase_margin, _, _, crossover, _ = control.stability_margins(loop)
    lag, f = demands.delay + demands.sample_time / 2, demands.gain_margin
    margin = phase_margin - math.degrees(crossover * lag)
    faults = []
    if not margin >= demands.phase_margin - PHASE_SLACK:
        faults.append(f"phase margin {margin:.6g}")
    for factor in (1 / f, 1.0, f):
        delay = control.tf(*control.pade(lag, 8)) if lag else control.tf(1, 1)
        poles = control.feedback(factor * (1 - GAIN_SLACK * np.sign(factor - 1)) * loop * delay).poles()
        if not np.max(poles.real) < 0:
            faults.append(f"unstable at {factor:.4g} times the gain (pole {np.max(poles.real):.4g})")
    omega = np.geomspace(1e-4 * crossover, 1e4 * crossover, 4001)
    L = loop(1j * omega) * np.exp(-1j * omega * lag)
    across = np.flatnonzero((L.imag[:-1] * L.imag[1:] <= 0) & (L.real[:-1] < 0) & (L.real[1:] < 0))
    for i in across:  # L crosses the negative real axis: 1/|L| is a factor at which stability changes
        t = L.imag[i] / (L.imag[i] - L.imag[i + 1])
        factor = 1 / abs(L[i] + t * (L[i + 1] - L[i]))
        if (1 + 1e-3) / f < factor < f * (1 - 1e-3):
            faults.append(f"a pole crosses at {factor:.5g} times the gain")
    return faults


def kept_gains(rows: Array, demands: Demands, gains: Array) -> Array:
    """(k,) whether the loops (m, 8) all keep the demands at the gains, on the frequency axis; for a grid search."""
    J, cm, lead, integral, _, _, _, viscous = (v[:, None] for v in rows.T)
    lag, f = demands.delay + demands.sample_time / 2, demands.gain_margin
    y = np.linspace(-14, 16, 6001)
    omega = np.exp(y)[None, :]
    s = 1j * omega
    L = cm * (lead * s + 1) * (integral * s + 1) / (integral * s * s * (J * s + viscous))
    phi = np.arctan(lead * omega) + np.arctan(integral * omega) - np.arctan2(J * omega, viscous) - omega * lag
    good = np.ones(gains.size, bool)
    for i in range(len(rows)):
        size = -np.log(np.abs(L[i]))  # rises: ln K of the crossover at omega
        for least, factors in ((math.radians(demands.phase_margin), (1.0,)), (0.0, np.geomspace(1 / f, f, 21))):
            for factor in factors:
                good &= np.interp(np.log(gains * factor), size, phi[i]) > least
    return good


def random_servo(random: np.random.Generator) -> Servo:
    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    static = between(0.1, 5)
    lead = between(0.03, 0.5)
    return Servo().replace(**{
        "servo.inertia": between(0.003, 0.3), "servo.motor_gain": between(1, 50),
        "controller.lead_time": lead, "controller.integral_time": between(max(0.03, lead / 4), min(1.0, 6 * lead)),
        "friction.static": static, "friction.coulomb": static / between(1.05, 2.0),
        "friction.stribeck_velocity": between(0.005, 0.1), "friction.viscous": float(random.uniform(0, 0.5)),
    })  # fmt: skip


def random_task(seed: int) -> tuple[Servo, dict]:
    """A servo, and the other arguments of `tune`."""
    random = np.random.default_rng([11, seed])
    servo = random_servo(random)
    names = [str(n) for n in random.choice(FIELDS, size=random.integers(1, 5), replace=False)]
    free = [n.removeprefix("controller.") for n in TIMES if n not in names and random.random() < 0.35]
    row = dict(zip(FIELDS, row_of(servo), strict=True))
    width = {n: float(random.uniform(0.005, 0.02) if n in FIELDS[4:6] else random.uniform(0.02, 0.3)) for n in names}
    gap = 1 - row["friction.coulomb"] / row["friction.static"]
    for n in FIELDS[4:6]:
        if n in width:
            width[n] = min(width[n], 0.3 * gap)
    if random.random() < 0.25:
        std = np.array([width[n] * row[n] / 3 for n in names])
        root = random.normal(size=(len(names), len(names)))
        correlation = root @ root.T + 0.5 * np.eye(len(names))
        correlation /= np.sqrt(np.outer(np.diag(correlation), np.diag(correlation)))
        uncertainty = Uncertainty(names=tuple(names), covariance=correlation * np.outer(std, std))
    else:
        uncertainty = Uncertainty({n: (row[n] * (1 - width[n]), row[n] * (1 + width[n])) for n in names})
    lag = 0.0 if random.random() < 0.3 else float(row[TIMES[0]] * np.exp(random.uniform(np.log(0.005), np.log(0.3))))
    demands = Demands(
        margin=float(random.uniform(0.02, 0.3)), phase_margin=float(random.uniform(15, 60)),
        gain_margin=float(random.uniform(1.2, 4)), delay=lag,
    )  # fmt: skip
    cost = str(random.choice(["gain", "high-frequency", "settling"]))
    return servo, {"demands": demands, "uncertainty": uncertainty, "free": free, "cost": cost}


def set_rows(servo: Servo, uncertainty: Uncertainty, samples: int, seed: int) -> Array:
    """(m, 8) the servo, all corners of the set, and samples of it."""
    names = list(uncertainty.parameters)
    base = row_of(servo)
    if uncertainty.covariance is None:
        low, high = np.array(list(uncertainty.intervals.values())).T
    else:
        middle = np.array([base[FIELDS.index(n)] for n in names])
        half = uncertainty.sigmas * np.sqrt(np.diag(uncertainty.covariance))
        low, high = middle - half, middle + half
    random = np.random.default_rng([12, seed])
    points = [np.array(p) for p in itertools.product(*zip(low, high, strict=True))]
    points += list(low + (high - low) * random.random((samples, low.size)))
    rows = np.tile(base, (len(points) + 1, 1))
    for i, point in enumerate(points):
        rows[i + 1, [FIELDS.index(n) for n in names]] = point
    return rows


def judge_answer(tuning: Tuning, seed: int, samples: int) -> list[str]:
    """What is wrong with an answer."""
    assert tuning.uncertainty is not None
    rows = set_rows(tuning.servo, tuning.uncertainty, samples, seed)
    faults = []
    for row in rows:
        found = loop_faults(row, tuning.gain, tuning.demands)
        if found:
            faults.append(f"{found[0]} at {np.round(row, 6).tolist()}")
            break
    lowest = tuning.gain / (1 + tuning.demands.margin) * (1 + GAIN_SLACK)
    for gain in (lowest, tuning.gain):
        ratio = largest_ratio(rows, gain, rounds=5 if gain == lowest else 1)
        if not (ratio < 1).all():
            i = int(np.argmax(ratio))
            faults.append(f"hunts at {gain / tuning.gain:.6g} K: ratio {ratio[i]:.8g} at {rows[i].tolist()}")
    return faults


def grid_search(servo: Servo, arguments: dict, seed: int, points: int) -> str:
    """A feasible point of a refused task, in words; "" where the search finds none.

    Pairs of times on a grid, then from the nearest of them downhill in the largest |P(a)|/a of the set at the largest
    gain that its loops allow.
    """
    free, hunts = arguments["free"], Hunts()
    given = np.log([servo.controller.lead_time, servo.controller.integral_time])
    width = [math.log(2) if name in free else 0.0 for name in ("lead_time", "integral_time")]
    axes = [np.linspace(-w, w, points if len(free) == 2 else 2 * points - 1) if w else [0.0] for w in width]
    compass = [np.array(m) for m in itertools.product((-1, 0, 1), repeat=2)]
    near: list[tuple[float, Array]] = []
    for move in itertools.product(*axes):
        gain, missed = _feasible(servo, arguments, seed, given + move, hunts)
        if gain:
            return _said(given + move, gain)
        near.append((missed, np.array(move)))
    least, here = min(near, key=lambda pair: pair[0])
    step = math.log(2) / (points - 1) if free and math.isfinite(least) else 0.0
    while step > FINEST:
        moves = np.unique([np.clip(here + step * m, np.negative(width), width) for m in compass], axis=0)
        moves = [m for m in moves if (m != here).any()]
        tried = [(*_feasible(servo, arguments, seed, given + m, hunts), m) for m in moves]
        gain, _, move = max(tried, key=lambda t: t[0])
        if gain:
            return _said(given + move, gain)
        _, missed, move = min(tried, key=lambda t: t[1])
        least, here, step = (missed, move, step) if missed < least else (least, here, step / 2)
    return ""


def _said(q: Array, gain: float) -> str:
    return f"lead_time {math.exp(q[0]):.6g}, integral_time {math.exp(q[1]):.6g}, gain {gain:.6g}"


def _feasible(servo: Servo, arguments: dict, seed: int, q: Array, hunts: Hunts) -> tuple[float, float]:
    """(a feasible gain at the times exp(q), or 0; the largest |P(a)|/a at the largest gain that the loops allow)."""
    demands, uncertainty = arguments["demands"], arguments["uncertainty"]
    times = {name: math.exp(v) for name, v in zip(TIMES, q, strict=True)}
    here = servo.replace(**times) if arguments["free"] else servo
    rows = set_rows(here, uncertainty, 12, seed)
    lead, integral = here.controller.lead_time, here.controller.integral_time
    gains = here.inertia / (here.motor_gain * lead * (lead + integral)) * np.geomspace(1e-2, 1e4, 1200)
    kept = kept_gains(rows, demands, gains)
    inner = np.flatnonzero(kept[:-2] & kept[1:-1] & kept[2:]) + 1  # a hair's breadth is nobody's fault
    if not inner.size:
        return 0.0, math.inf
    corners = rows[: 1 + 2 ** len(uncertainty.parameters)]
    part = (1 + demands.margin) * (1 + CLEAR)
    # Feasible: no servo hunts at K/(1 + margin), and one does at a gain not too far below, the default bound.
    ends = inner[np.flatnonzero(np.diff(inner, append=inner[-1] + 2) > 1)]
    tried = np.union1d(inner[np.linspace(0, inner.size - 1, TRIED).astype(int)], ends)
    for gain in gains[tried].tolist():
        if not hunts(corners, gain / part):
            if hunts(corners, gain / part / 9):
                return gain, 0.0
            break  # so does none at higher gains
    if not arguments["free"]:
        return 0.0, math.inf
    worst = [hunts.servo, 0]
    return 0.0, float(np.max(largest_ratio(corners[worst], float(gains[inner[-1]]) / part, rounds=1)))


def one(seed: int, quick: bool, limit: int) -> dict:
    """Run and judge one task."""
    servo, arguments = random_task(seed)
    began = time.perf_counter()
    result: dict = {"task": seed, "free": arguments["free"], "cost": arguments["cost"],
                    "set": list(arguments["uncertainty"].parameters)}  # fmt: skip
    try:
        with within(limit):
            tuning = tune(servo, "switch", **arguments)
    except TooSlow:
        return result | {"outcome": "not finished", "tune_s": time.perf_counter() - began}
    except NoOrbit as error:
        result |= {"outcome": "refused", "said": str(error), "tune_s": time.perf_counter() - began}
        if "cannot be met" in str(error) or "not found" in str(error):
            found = grid_search(servo, arguments, seed, 3 if quick else 7)
            result |= {"outcome": "infeasible" if not found else "WRONGLY REFUSED", "grid": found}
        return result
    result |= {"gain": tuning.gain, "binding": tuning.binding, "tune_s": time.perf_counter() - began,
               "unverified": tuning.verification.unverified, "against": tuning.verification.against}  # fmt: skip
    faults = judge_answer(tuning, seed, 20 if quick else SAMPLES)
    state = "verified" if tuning.verification.ok else "partly verified"
    state = "spoken against" if tuning.verification.against else state
    result |= {"outcome": "WRONG" if faults and not tuning.verification.against else state, "faults": faults}
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="8 tasks, 20 samples each")
    parser.add_argument("--tasks", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0, help="of the first task")
    parser.add_argument("--only", type=int, help="one task")
    parser.add_argument("--limit", type=int, default=300, help="seconds for one task")
    parser.add_argument("--out", help="write every result there")
    options = parser.parse_args()
    tasks = range(options.seed, options.seed + (8 if options.quick else options.tasks))
    results = []
    for seed in tasks if options.only is None else [options.only]:
        results.append(one(seed, options.quick, options.limit))
        r = results[-1]
        said = r.get("said", "") or r.get("faults") or r.get("against") or r.get("unverified") or ""
        print(f"{seed:3d} {r['outcome']:16s} {r['tune_s']:6.1f} s  {str(said)[:400]} {r.get('grid', '')}", flush=True)
        if options.out:
            Path(options.out).write_text(json.dumps(results, indent=1, default=str) + "\n")
    for outcome in sorted({r["outcome"] for r in results}):
        print(f"{outcome}: {sum(r['outcome'] == outcome for r in results)}")


if __name__ == "__main__":
    main()
