"""Random tune tasks with uncertainty sets, judged by other engines: python-control and an event map of its own.

    python scripts/tuning.py [--quick] [--tasks N] [--seed S] [--only I] [--out FILE.json]

An answer is wrong where a corner or one of 200 samples of the set misses a demand: its linear loop by python-control
(poles, crossovers, margins; the delay exact on the frequency axis, and as a Pade approximation in the poles), its
cycles by an event map that integrates many motions at once with an explicit Runge-Kutta pair.  A refusal is wrong where
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

from casahunt.errors import NoOrbit  # noqa: E402
from casahunt.servo import Servo  # noqa: E402
from casahunt.tune import Tuning, tune  # noqa: E402
from casahunt.tune_demands import Demands  # noqa: E402
from casahunt.uncertainty import Uncertainty  # noqa: E402
from scripts.stress import TooSlow, within  # noqa: E402

Array = np.ndarray

SAMPLES = 200
GAIN_SLACK = 1e-4
"""Relative tolerance of a fold gain: that of the event map on its grid of stick positions."""
PHASE_SLACK = 0.02
"""Tolerance of a phase margin [deg]."""
MOST_STEPS = 6000
"""Steps after which a motion has crept for long enough to be no swing."""
CLEAR = 0.01
"""A grid point counts as feasible where every demand is kept with this relative room in gain."""
TIMES = ("controller.lead_time", "controller.integral_time")
FIELDS = (
    "servo.inertia", "servo.motor_gain", *TIMES, "friction.static", "friction.coulomb", "friction.stribeck_velocity",
    "friction.viscous",
)  # fmt: skip


# The event map ------------------------------------------------------------------------------------------------

# Dormand and Prince, 5(4).
C = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
A = [
    [],
    [1 / 5],
    [3 / 40, 9 / 40],
    [44 / 45, -56 / 15, 32 / 9],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
]
E = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


class Flow:
    """Slips of many servos at once: parameters (m,), states (3, m)."""

    def __init__(self, rows: Array, gain: Array | float) -> None:
        J, cm, lead, integral, Fs, Fc, vs, viscous = rows.T
        factor = np.asarray(gain) * cm
        self.J, self.Fs, self.Fc, self.vs, self.viscous = J, Fs, Fc, vs, viscous
        self.kp, self.kd, self.ki = factor * (1 + lead / integral), factor * lead, factor / integral

    def torque(self, x: Array) -> Array:
        return -(self.kp * x[0] + self.kd * x[1] + self.ki * x[2])

    def __call__(self, x: Array, sign: Array) -> Array:
        friction = sign * (self.Fc + (self.Fs - self.Fc) * np.exp(-((x[1] / self.vs) ** 2))) + self.viscous * x[1]
        return np.array([x[1], (self.torque(x) - friction) / self.J, x[0]])

    def at(self, where: Array) -> Flow:
        part = object.__new__(Flow)
        for name, value in vars(self).items():
            setattr(part, name, np.broadcast_to(value, self.J.shape)[where])
        return part


def _step(flow: Flow, x: Array, sign: Array, h: Array) -> tuple[Array, Array, Array]:
    """(new state, error, field at the end)."""
    k = [flow(x, sign)]
    for row in A[1:]:
        k.append(flow(x + h * sum(a * f for a, f in zip(row, k, strict=True) if a), sign))
    new = x + h * sum(a * f for a, f in zip(A[6], k[:6], strict=True) if a)
    return new, h * sum(e * f for e, f in zip(E, k, strict=True) if e), k[-1]


def event_map(rows: Array, gain: Array | float, a: Array, *, tol: float = 1e-8, most_slips: int = 12) -> Array:
    """P(a)/a (m,) of many servos (m, 8): from breakaway at x1 = -a to the next stick; inf where it swings on."""
    flow = Flow(rows, gain)
    m = a.size
    x = np.array([-a, np.zeros(m), (flow.kp * a - flow.Fs) / flow.ki])
    sign, ratio = np.ones(m), np.full(m, np.nan)
    rate = np.sqrt(flow.kp / flow.J)
    scale = np.array([a, np.minimum(a * rate, np.maximum(flow.vs, 1e-3 * a * rate)), flow.Fs / flow.ki])
    h = 1e-3 / rate
    slips, alive = np.zeros(m, int), np.arange(m)
    begun = np.zeros(m, bool)
    for _ in range(MOST_STEPS):
        if not alive.size:
            break
        f, s, here, dt = flow.at(alive), sign[alive], x[:, alive], h[alive]
        new, error, _ = _step(f, here, s, dt)
        e = np.max(np.abs(error) / (tol * scale[:, alive]), axis=0)
        good = e <= 1
        h[alive] = dt * np.clip(0.9 * np.maximum(e, 1e-12) ** -0.2, 0.2, 4.0)
        stop = good & begun[alive] & (s * new[1] < 0)
        move = good & ~stop
        x[:, alive[move]] = new[:, move]
        begun[alive[move]] |= (s * new[1] > 0)[move]
        # A servo that creeps up to its set point, and could not coast past it, comes no nearer to a again.
        coasts = np.abs(x[1, alive]) * f.J / (f.kd + f.viscous)
        creeps = move & (np.abs(x[0, alive]) < 0.01 * a[alive]) & (coasts < 0.01 * a[alive])
        ratio[alive[creeps]] = 0.0
        ended = alive[creeps]
        if stop.any():
            i = alive[stop]
            part, si, xi, hi = flow.at(i), sign[i], x[:, i], dt[stop]
            low, high = np.zeros(i.size), np.ones(i.size)
            for _ in range(45):
                middle = (low + high) / 2
                back = si * _step(part, xi, si, hi * middle)[0][1] < 0
                low, high = np.where(back, low, middle), np.where(back, middle, high)
            x[:, i] = _step(part, xi, si, hi * low)[0]
            x[1, i] = 0.0
            torque = part.torque(x[:, i])
            stuck = np.abs(torque) <= part.Fs
            ratio[i[stuck]] = x[0, i[stuck]] / a[i[stuck]]
            slips[i] += 1
            wild = ~stuck & ((slips[i] >= most_slips) | (np.abs(x[0, i]) > 3 * a[i]))
            ratio[i[wild]] = np.inf
            on = ~stuck & ~wild
            sign[i[on]] = np.sign(torque[on])
            begun[i[on]] = False
            h[i] = 1e-3 / rate[i]
            ended = np.concatenate([ended, i[stuck | wild]])
        slow = h[alive] * rate[alive] > 1e6  # it creeps for ever
        ratio[alive[slow]] = 0.0
        alive = np.setdiff1d(alive, np.concatenate([ended, alive[slow]]))
    return np.abs(ratio)


def largest_ratio(rows: Array, gain: Array | float, *, points: int = 30, rounds: int = 5) -> Array:
    """(m,) max over a of |P(a)|/a: below one no cycle with sticking exists."""
    m = len(rows)
    gain = np.broadcast_to(np.asarray(gain, float), (m,))
    flow = Flow(rows, gain)
    grid = np.tile(np.geomspace(3e-4, 10.0, points), (m, 1)) * (flow.Fs / flow.kp)[:, None]
    best = np.zeros(m)
    for k in range(rounds):
        n = grid.shape[1]
        values = event_map(np.repeat(rows, n, axis=0), np.repeat(gain, n), grid.ravel()).reshape(m, n)
        values = np.nan_to_num(values, nan=0.0, posinf=np.inf)
        i = np.argmax(values, axis=1)
        best = np.maximum(best, values[np.arange(m), i])
        if k < rounds - 1:
            low, high = grid[np.arange(m), np.maximum(i - 1, 0)], grid[np.arange(m), np.minimum(i + 1, n - 1)]
            grid = np.geomspace(low, high, 9).T
    return best


# The linear loop ----------------------------------------------------------------------------------------------


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


# Tasks --------------------------------------------------------------------------------------------------------


def row_of(servo: Servo) -> Array:
    f, c = servo.friction, servo.controller
    return np.array([servo.inertia, servo.motor_gain, c.lead_time, c.integral_time, f.static, f.coulomb,
                     f.stribeck_velocity, f.viscous])  # fmt: skip


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
        if (ratio >= 1).any():
            i = int(np.argmax(ratio))
            faults.append(f"hunts at {gain / tuning.gain:.6g} K: ratio {ratio[i]:.8g} at {rows[i].tolist()}")
    return faults


def grid_search(servo: Servo, arguments: dict, seed: int, points: int) -> str:
    """A feasible point of a refused task, in words; "" where the grid has none."""
    demands, uncertainty, free = arguments["demands"], arguments["uncertainty"], arguments["free"]
    axes = [
        np.geomspace(t / 2, 2 * t, points) if name in free else [t]
        for name, t in (("lead_time", servo.controller.lead_time), ("integral_time", servo.controller.integral_time))
    ]
    for lead, integral in itertools.product(*axes):
        here = servo.replace(**{TIMES[0]: float(lead), TIMES[1]: float(integral)}) if free else servo
        rows = set_rows(here, uncertainty, 12, seed)
        unit = here.inertia / (here.motor_gain * lead * (lead + integral))
        gains = unit * np.geomspace(1e-2, 1e4, 1200)
        kept = kept_gains(rows, demands, gains)
        inner = np.flatnonzero(kept[:-2] & kept[1:-1] & kept[2:]) + 1  # a hair's breadth is nobody's fault
        if not inner.size:
            continue
        tried = gains[inner[np.linspace(0, inner.size - 1, 8).astype(int)]]
        corners = rows[: 1 + 2 ** len(uncertainty.parameters)]
        part = (1 + demands.margin) * (1 + CLEAR)
        # Feasible: no servo hunts at K/(1 + margin), and one does at a gain not too far below, the default bound.
        hunts = [
            (largest_ratio(np.repeat(corners, 8, axis=0), np.tile(tried / p, len(corners))).reshape(-1, 8) >= 1).any(0)
            for p in (part, 9 * part)
        ]
        good = np.flatnonzero(~hunts[0] & hunts[1])
        if good.size:
            return f"lead_time {lead:.6g}, integral_time {integral:.6g}, gain {tried[good[0]]:.6g}"
    return ""


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
