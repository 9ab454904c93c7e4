"""Cycles of loops of parts against motions by scipy: periods and amplitudes of random servos with each kind of part.

    python scripts/parts.py [--servos N] [--first I] [--seed S] [--only KIND ...]

Each servo is drawn as in scripts/random_servos.py, and asked at a part of its fold's gain, drawn between SHARES, with

    two masses      motor and load, shaft of random stiffness and damping
    direction       static, Coulomb and viscous friction drawn anew for the way back
    table           friction as a table of 6 to 14 entries beside the Stribeck curve, each off by up to 2 percent
    filter          a filter of the derivative
    saturation      the torque limited to 1.02 to 3 times static friction, with clamping, back calculation or nothing

The cycle is that on which a motion from rest beside the set point settles, by casahunt's find_cycle and by scipy's
solve_ivp (DOP853, rtol 1e-12; scripts/peers/part_motion.py), which has equations, events and modes of its own.

    agrees     period and amplitude differ by less than AGREES
    differs    they do not; listed
    one alone  one of the two finds a cycle; listed
    none       neither does

Servos are drawn until N of each kind have a cycle.  Exit code 1 if anything differs.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Servo, find_fold, find_orbit  # noqa: E402
from casahunt.orbits import find_cycle  # noqa: E402
from casahunt.servo.parts import (  # noqa: E402
    BACK_CALCULATION,
    BY_DIRECTION,
    CLAMPING,
    DERIVATIVE_FILTER,
    INERTIA,
    INTEGRATOR,
    PID_BY_GAINS,
    SWITCH,
    TORQUE_LIMIT,
    TWO_MASSES,
    Loop,
    friction_table,
    loop_of,
)
from scripts.peers.part_motion import Curve, PartMotion  # noqa: E402
from scripts.random_servos import draw  # noqa: E402

KINDS = ("two masses", "direction", "table", "filter", "saturation")
SHARES = 0.1, 0.8
AGREES = 1e-7
TOL = 1e-9
LONGEST = 80.0
"""Periods of the plain servo after which no cycle is expected any more."""
MOST_DRAWN = 4
"""Times as many servos are drawn, of which not all hunt."""


def stribeck(static: float, coulomb: float, velocity: float, viscous: float) -> Curve:
    """Friction at |v|."""
    return lambda v: coulomb + (static - coulomb) * math.exp(-((v / velocity) ** 2)) + viscous * v


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number, log-uniformly."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def one(kind: str, seed: int, number: int) -> tuple[Loop, PartMotion, dict[str, float], float]:
    """(loop, the same by scipy, states at the start, period of the plain servo)."""
    rng, servo = np.random.default_rng([seed, number, KINDS.index(kind)]), Servo().replace(**draw(seed, number))
    gain = between(rng, *SHARES) * find_fold(servo, "switch").gain
    cycle = find_orbit(servo, "switch", gain)
    return *with_part(kind, rng, servo, gain, cycle.amplitude, cycle.period), cycle.period


def with_part(
    kind: str, rng: np.random.Generator, servo: Servo, gain: float, amplitude: float, period: float
) -> tuple[Loop, PartMotion, dict[str, float]]:
    """(loop, the same by scipy, states at the start) of a servo that hunts with this amplitude and period."""
    f, loop = servo.friction, loop_of(servo, "switch", gain)
    factor = gain * servo.motor_gain
    kp, ki, kd = (factor * loop.value(name) for name in ("kp", "ki", "kd"))
    curve = stribeck(f.static, f.coulomb, f.stribeck_velocity, f.viscous)
    peer = PartMotion(servo.inertia, (curve, curve), (f.static, f.static), (kp, kd, ki))
    start = {"x1": -between(rng, 0.3, 1.5) * amplitude}
    values, plant, friction, more = dict(loop.values), INERTIA, SWITCH, ()
    if kind == "two masses":
        part, J = rng.uniform(0.2, 0.8), servo.inertia
        w, damping = between(rng, 20.0, 2000.0) / period, between(rng, 0.02, 0.5)
        reduced = part * (1 - part) * J
        shaft = (1 - part) * J, reduced * w**2, 2 * damping * reduced * w
        plant, start["load_angle"] = TWO_MASSES, start["x1"]
        values |= dict(zip(("load_inertia", "shaft_stiffness", "shaft_damping"), shaft, strict=True))
        values["inertia"] = peer.inertia = part * J
        peer.shaft = shaft
    elif kind == "direction":
        Fs, Fc, b = f.static * between(rng, 0.7, 1.4), 0.0, f.viscous * between(rng, 0.5, 2.0)
        Fc = Fs * rng.uniform(0.6, 0.97)
        friction, values = BY_DIRECTION, values | {"static_back": Fs, "coulomb_back": Fc, "viscous_back": b}
        peer.curve, peer.static = (curve, stribeck(Fs, Fc, f.stribeck_velocity, b)), (f.static, Fs)
    elif kind == "table":
        last, entries = between(rng, 10.0, 1000.0), int(rng.integers(5, 14))
        v = np.append(0.0, f.stribeck_velocity * np.geomspace(0.3, last, entries))
        torque = np.array([curve(k) for k in v]) * np.append(1.0, rng.uniform(0.98, 1.02, v.size - 1))
        torque[-1] = max(torque[-1], 1.001 * torque[-2])  # so that scipy's end is the part's
        friction = friction_table(v, torque, static=f.static)
        cubic, slope = PchipInterpolator(v, torque), float(PchipInterpolator(v, torque).derivative()(v[-1]))
        table: Curve = lambda u: float(cubic(u)) if u <= v[-1] else float(torque[-1] + slope * (u - v[-1]))  # noqa: E731
        peer.curve = table, table
    elif kind == "filter":
        Tf = between(rng, 5e-3, 0.3) * period / 10
        more, values["derivative_filter"], peer.filter_time = (DERIVATIVE_FILTER,), Tf, Tf
    else:
        limit, way = f.static * between(rng, 1.02, 3.0), int(rng.integers(3))
        more, values["torque_limit"], peer.limit = ((TORQUE_LIMIT, CLAMPING, BACK_CALCULATION)[way],), limit, limit
        peer.unwinding = (None, 0.0, between(rng, 0.02, 1.0) * period)[way]
        if way == 2:
            values["unwinding_time"] = peer.unwinding
    parts = plant, friction, PID_BY_GAINS, INTEGRATOR, *more
    wanted = {name for part in parts for name in part.parameters}
    values = {name: value for name, value in values.items() if name in wanted}
    return Loop(parts, values), peer, start


def check(kind: str, seed: int, number: int) -> tuple[str, str]:
    """(outcome, what was seen)."""
    loop, peer, start, period = one(kind, seed, number)
    state, said, began = loop.state(**start), [], time.process_time()
    try:
        orbit = find_cycle(loop.system, loop.mode_at(**state), start=state, follow="gain", tol=TOL)
    except NoOrbit as refusal:
        orbit = None
        said.append(f"casahunt: {refusal}")
    ours, began = time.process_time() - began, time.process_time()
    y = peer.rest(start["x1"])
    try:
        T, a, n = peer.cycle(y, LONGEST * period)
    except RuntimeError as none:
        T = a = math.nan
        said.append(f"scipy: {none}")
    said.append(f"{ours:.2f} s and {time.process_time() - began:.2f} s")
    if orbit is None or math.isnan(T):
        found = f"casahunt {orbit.period:.9g}" if orbit is not None else f"scipy {T:.9g} s, {a:.9g} rad"
        return ("none" if orbit is None and math.isnan(T) else "one alone"), "; ".join([found, *said])
    off = orbit.period / T - 1, orbit.amplitude / a - 1
    outcome = "agrees" if max(map(abs, off)) < AGREES else "differs"
    return outcome, f"period {T:.9g} s off {off[0]:.1e}, amplitude {a:.6g} off {off[1]:.1e}, {n} breakaways; {said[-1]}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Servos of every kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--servos", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first servo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=list(KINDS))
    asked = parser.parse_args(arguments)
    sums: Counter[tuple[str, str]] = Counter()
    for kind in asked.only:
        for number in range(asked.first, asked.first + MOST_DRAWN * asked.servos):
            if sums[kind, "agrees"] + sums[kind, "differs"] >= asked.servos:
                break
            try:
                outcome, seen = check(kind, asked.seed, number)
            except NoOrbit as refusal:
                outcome, seen = "none", f"plain: {refusal}"
            sums[kind, outcome] += 1
            print(f"{kind} {number}: {outcome}: {seen}", flush=True)
    for kind in asked.only:
        print(f"{kind:12}", ", ".join(f"{n} {what}" for (of, what), n in sorted(sums.items()) if of == kind))
    return int(any(what == "differs" and n for (_, what), n in sums.items()))


if __name__ == "__main__":
    raise SystemExit(main())
