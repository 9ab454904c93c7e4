"""The remedies of random servos against motions by heyoka: does hunting end where the table says that it does?

    python scripts/remedies.py [--servos N] [--seed S] [--only NAME ...] [--share LOW HIGH]

Each servo is drawn as in scripts/random_servos.py and asked at a part of its fold's gain, drawn between LOW and HIGH.
Of every remedy sizes beside its border are looked at (SIZES; more of the remedy is more): Taylor series with events
(scripts/peers/remedy_motion.py, needs heyoka) follow motions from a scan of starts.

    agrees         less of it than at the border hunts from some start; more, of a remedy that ends hunting, from none
    contradicts    more of it hunts, although the table says that hunting has ended; listed
    rests earlier  less of it hunts from no start any more: the cycles up to the border are unstable
    unclear        a motion whose swings neither repeat nor come to rest
    no claim       more of a remedy of which the table says itself that motions grow or hunt on beyond its border
    not found      the table says that it does not know
    hunts on       some motion does, up to the size up to which the table says that hunting goes on
    border agrees  P(a) has a fixed point with KNOWN less of the remedy than at the border, and none with so much more
    border differs it has one with so much more
    border unseen  it has none with less: beyond its last digit P rises from a slip that all but stops to one that does
                   not, and a cycle there no motion in doubles can show

Prints a line per servo and remedy and the sums; exit code 1 if anything contradicts or differs.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Servo, find_fold, find_orbit, remedies  # noqa: E402
from scripts.peers.remedy_motion import RemedyMotion  # noqa: E402
from scripts.random_servos import draw  # noqa: E402

SIZES = (0.9, 0.99, 1.01, 1.1, 2.0)
UP_TO = (0.1, 0.5, 1.0)
"""Sizes of a remedy that does not end hunting, as parts of the last that was looked at."""
SWEEP = (0.5, 0.7, 0.8)
"""Sizes on the way to the border for remedies whose stops have no map on a line: hunting is handed on."""
KNOWN = 1e-6
"""A border is where it is said to be, if there is a fixed point of the map with so much less of the remedy, and none
with so much more."""
LOOKED_AT = (
    "dead band", "shifted dead band", "hysteresis", "error dead band", "leak", "freeze", "reset", "error filter",
    "feedforward", "dither", "gain", "derivative", "integral",
)  # fmt: skip
LESS_IS_MORE = ("freeze", "integral")
SHARES = (0.05, 0.9)
"""Gains, as parts of that of the fold."""


def truth(servo: Servo, gain: float, remedy: str, size: float, cycle: Any) -> RemedyMotion:
    """The same servo with a remedy, by heyoka."""
    friction, pid = servo.friction, servo.controller.pid()
    factor = gain * servo.motor_gain
    gains = {"kp": factor * pid.kp, "kd": factor * pid.kd, "ki": factor * pid.ki}
    if remedy == "gain":
        gains = {name: value * size / gain for name, value in gains.items()}
    elif remedy in ("derivative", "integral"):
        name = "kd" if remedy == "derivative" else "ki"
        gains[name] = factor * size
    numbers = {
        "J": servo.inertia, "Fs": friction.static, "Fc": friction.coulomb, "vs": friction.stribeck_velocity,
        "b": friction.viscous,
    }  # fmt: skip
    return RemedyMotion(
        numbers, (gains["kp"], gains["kd"], gains["ki"]), remedy, size, cycle.amplitude, cycle.period
    )


def more(remedy: str, size: float, factor: float) -> float:
    """So much of a remedy: of a reset 1 is none."""
    if remedy == "reset":
        return 1 + (size - 1) * factor
    return size / factor if remedy in LESS_IS_MORE else size * factor


def check(servo: Servo, gain: float, only: Sequence[str], sizes: Sequence[float] = SIZES) -> list[tuple[str, str, str]]:
    """(remedy, outcome, what was seen) of every remedy and size."""
    cycle, out = find_orbit(servo, "switch", gain), list[tuple[str, str, str]]()
    for name in only:
        row = remedies(servo, "switch", gain, only=[name]).remedies[0]
        if row.kind == "not found":
            out.append((name, row.kind, row.why))
            continue
        if row.kind == "none":
            for factor in UP_TO:
                hunts, said = truth(servo, gain, name, factor * row.followed_to, cycle).hunts()
                out.append((name, "hunts on" if hunts else "contradicts", f"{row.why}, x {factor}: {Counter(said)}"))
            continue
        motion, before = truth(servo, gain, name, row.size, cycle), None
        for factor in sizes if motion.kind == "plain" else sorted((*SWEEP, *sizes)):
            motion = truth(servo, gain, name, more(name, row.size, factor), cycle)
            hunts, said = motion.hunts(before)
            before = motion.hunted if motion.kind != "plain" else None
            seen = f"{row.kind} {row.size!r} x {factor}: {dict(Counter(said))}"
            if factor > 1 and not row.ends_hunting:
                out.append((name, "no claim", f"{seen}, the table: {'/'.join(row.stays)}"))
            elif factor not in SWEEP and abs(factor - 1) * row.size > row.size_error:  # nearer it says nothing
                outcome = "unclear" if hunts is None else "contradicts" if factor > 1 else "rests earlier"
                outcome = "agrees" if hunts == (factor < 1) else outcome
                out.append((name, outcome, seen))
        if motion.kind == "plain" and row.kind in ("fold", "grazing"):  # behind an instability cycles go on
            beside = [truth(servo, gain, name, more(name, row.size, 1 + d), cycle).cycles() for d in (-KNOWN, KNOWN)]
            outcome = "border differs" if beside[1] else "border agrees" if beside[0] else "border unseen"
            out.append((name, outcome, f"{row.kind} {row.size!r} +- {row.size_error:.1g}: {beside}"))
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Servos, remedies, sizes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--servos", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="number of the first servo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=list(LOOKED_AT))
    parser.add_argument("--share", nargs=2, type=float, default=SHARES)
    asked = parser.parse_args(arguments)
    sums: Counter[tuple[str, str]] = Counter()
    for number in range(asked.first, asked.first + asked.servos):
        servo = Servo().replace(**draw(asked.seed, number))
        low, high = asked.share
        share = float(np.exp(np.random.default_rng([asked.seed, number, 1]).uniform(np.log(low), np.log(high))))
        try:
            gain = share * find_fold(servo, "switch").gain
        except NoOrbit as refusal:
            print(f"servo {number}: {refusal}", flush=True)
            continue
        for name in asked.only:
            began = time.process_time()
            try:
                found = check(servo, gain, [name])
            except NoOrbit as refusal:
                found = [(name, "refused", str(refusal))]
            for name, outcome, seen in found:
                sums[name, outcome] += 1
                if not outcome.endswith(("agrees", "hunts on")):
                    print(f"servo {number}, gain {gain:.6g}: {name}: {outcome}: {seen}", flush=True)
            print(f"servo {number} {name}: {time.process_time() - began:.1f} s", flush=True)
    for name in asked.only:
        print(f"{name:20}", ", ".join(f"{n} {what}" for (of, what), n in sorted(sums.items()) if of == name))
    total = Counter[str]()
    for (_, what), n in sums.items():
        total[what] += n
    print(dict(total))
    return int(total["contradicts"] + total["border differs"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
