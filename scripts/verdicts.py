"""Verdicts of timed simulations against motions ten times as long, or as long as they took: 500 of 50 random servos.

    python scripts/verdicts.py [--quick] [--servos 50] [--motions 10] [--seed 1] [--model switch|lugre] [--json F]

Servos, log-uniform: static friction 0.1 to 5 N m, static/coulomb 1.02 to 2.5, Stribeck velocity 0.002 to 0.2 rad/s,
viscous friction 0.001 to 1 N m s/rad or none, inertia 0.003 to 0.3 kg m2, motor gain 1 to 50 N m/V, lead and integral
time 0.02 to 1 s.  Gains 0.05 to 1.2 times the fold (a third of them within 1 % of it), starts of 0.003 to 30 times
Fs/kp from rest, with a velocity, with an integral, or on the verge of breakaway; lengths of 3 to 600 times the
controller's times, cut after `MOST` swings.

The long motion is judged by a rule of its own, on the largest |x1| of two windows, from 40 to 70 % and from 70 to
100 % of its time, A1 and A2.  It contradicts

    hunting    where A2 is not within 5 % of the amplitude claimed, or x1 does not change its sign in the second window
    decaying   where A2 exceeds the last swing of the short one, or what is reached on both sides of the set point does
               not fall from the first window to the second
    at rest    where |x1| exceeds, after the end of the short motion, what was said it stays within
    growing    where it neither reaches twice the last swing nor is given up on its way out

Exit code 1 if a verdict is contradicted.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Servo, Trajectory, find_fold, simulate  # noqa: E402
from casahunt.motion.phases import MarchFailure  # noqa: E402
from casahunt.servo.gains import routh_hurwitz_gain  # noqa: E402

LONGER, BEFORE_THE_WINDOWS = 10.0, 0.4
MOST = {"switch": 40, "lugre": 12}
"""Swings of a short motion."""
NEAR, STEADY = 0.05, 1e-6
"""Of the claimed amplitude; A2 this close to A1 has not decayed."""


@dataclass(frozen=True)
class Case:
    """One timed simulation, as the arguments of `simulate`."""

    servo: Servo
    model: str
    gain: float
    share: float
    time: float
    start: dict[str, float]

    def motion(self, factor: float = 1.0) -> Trajectory:
        """The motion, `factor` times as long."""
        return simulate(self.servo, self.model, self.gain, time=self.time * factor, **self.start)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Outcome:
    """A verdict and what the long motion says to it; `against` is "" where it agrees."""

    case: Case
    kind: str
    sentence: str
    against: str
    seconds: float


def random_servo(rng: np.random.Generator) -> Servo:
    """A servo of the ranges above."""

    def log(low: float, high: float) -> float:
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    static = log(0.1, 5)
    changes = {
        "friction.static": static,
        "friction.coulomb": static / log(1.02, 2.5),
        "friction.stribeck_velocity": log(0.002, 0.2),
        "friction.viscous": log(1e-3, 1) if rng.random() < 0.9 else 0.0,
        "servo.inertia": log(0.003, 0.3),
        "servo.motor_gain": log(1, 50),
        "controller.lead_time": log(0.02, 1),
        "controller.integral_time": log(0.02, 1),
    }
    return Servo().replace(**changes)


def fold_gain(servo: Servo) -> float:
    """The fold gain of the event map; where it has none, the gain of the report's lower bound."""
    try:
        return find_fold(servo, "switch").gain
    except (NoOrbit, MarchFailure):
        return routh_hurwitz_gain(servo)


def cases(rng: np.random.Generator, model: str, motions: int) -> list[Case]:
    """Timed simulations of one random servo."""
    servo = random_servo(rng)
    fold, c = fold_gain(servo), servo.controller
    made = []
    for _ in range(motions):
        near = rng.random() < 1 / 3
        share = float(1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-5, -2) if near else 10 ** rng.uniform(-1.3, 0.08))
        gain = share * fold
        kp, kd, ki = servo.torque_gains(gain)
        unit = servo.friction.static / kp
        a = unit * 10 ** rng.uniform(-2.5, 1.5)
        start = {"set_point": 0.0, "position": -a}
        how = rng.integers(4)
        if how == 1:
            start["velocity"] = rng.normal() * a * kp / (kd + servo.friction.viscous)
        elif how == 2:
            start["integral"] = rng.normal() * servo.friction.static / ki
        elif how == 3:
            start["integral"] = (kp * a - servo.friction.static) / ki
        length = (c.lead_time + c.integral_time) * 10 ** rng.uniform(0.5, 2.8)
        made.append(Case(servo, model, gain, share, length, start))
    return made


def rest_of(motion: Trajectory) -> float:
    """Within which a servo is at rest [rad]."""
    numbers = motion.loop.parameters
    unit = numbers["static"] / (motion.gain * numbers["motor_gain"] * numbers["kp"])
    return max(1e-6 * unit, 1e-7 * float(np.abs(motion.states[0]).max()), float(motion.state_errors[0]))


def contradiction(short: Trajectory, long: Trajectory) -> str:
    """What the long motion says against the verdict of the short one; "" where it agrees."""
    verdict = short.verdict
    t, x = long.dense(8)
    x1, end = np.abs(x[0]), float(t[-1])
    first, second = (t >= 0.4 * end) & (t < 0.7 * end), t >= 0.7 * end
    A1, A2 = float(np.max(x1[first])), float(np.max(x1[second]))
    turns = bool(x[0][second].min() < 0 < x[0][second].max())
    own_t, own = short.dense(8)
    last = float(np.max(np.abs(own[0, own_t >= 0.5 * own_t[-1]])))
    if verdict.kind == "hunting":
        if not turns:
            return f"no swing from {0.7 * end:.4g} to {end:.4g} s"
        # A lopsided cycle's amplitude is the mean of its two sides.
        swings = (float(np.max(x[0][second])) - float(np.min(x[0][second]))) / 2
        return "" if abs(swings / verdict.amplitude - 1) < NEAR else f"{swings:.6g} rad, not {verdict.amplitude:.6g}"
    if verdict.kind == "decaying":
        floor = max(rest_of(short), long.state_errors[0])
        if A2 > last * (1 + 1e-9) + floor:
            return f"{A2:.6g} rad, more than {last:.6g}"
        # What is reached on both sides: a window that begins in a stick begins with the swing before.
        B1, B2 = (min(float(np.max(x[0][w])), -float(np.min(x[0][w]))) for w in (first, second))
        return f"{B2:.9g} rad after {B1:.9g}" if min(B1, B2) > 3 * floor and B2 > B1 * (1 - STEADY) else ""
    if verdict.kind == "at rest":
        later = float(np.max(x1[t >= own_t[-1]]))
        floor = rest_of(short) + float(long.state_errors[0])
        return "" if later <= floor else f"{later:.3g} rad later, more than {floor:.3g}"
    if verdict.kind == "growing":
        grown = bool(long.ended) or max(A1, A2) > 2 * abs(float(short.end[0]))
        return "" if grown else f"{max(A1, A2):.4g} rad after {last:.4g}"
    return ""


def outcome(case: Case) -> Outcome:
    """The verdict on a case, and the long motion's word."""
    began = time.perf_counter()
    try:
        short = case.motion()
        crossings = short.shape()[0]
        if crossings.size > MOST[case.model]:
            case = replace(case, time=float(crossings[MOST[case.model]]))
            short = case.motion()
        kind, sentence = short.verdict.kind, short.verdict.sentence
        reached = (short.duration + short.verdict.behind) / case.time / BEFORE_THE_WINDOWS
        against = "" if kind == "undecided" else contradiction(short, case.motion(max(LONGER, reached)))
    except NoOrbit as failure:
        kind, sentence, against = "refused", str(failure), ""
    return Outcome(case, kind, sentence, against, time.perf_counter() - began)


def main(words: list[str] | None = None) -> int:
    """Run, print, write; 1 where a verdict is contradicted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 servos, 4 motions each")
    parser.add_argument("--servos", type=int, default=50)
    parser.add_argument("--motions", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model", choices=("switch", "lugre"), default="switch")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(words)
    servos, motions = (5, 4) if options.quick else (options.servos, options.motions)
    found: list[Outcome] = []
    for k in range(servos):
        for case in cases(np.random.default_rng([options.seed, k]), options.model, motions):
            found.append(outcome(case))
            if found[-1].against or options.servos == 1:
                print(f"servo {k}: {described(found[-1])}", flush=True)
    print(table(found))
    if options.json:
        options.json.write_text(json.dumps([record(o) for o in found], indent=1), encoding="ascii")
    return int(any(o.against for o in found))


def described(o: Outcome) -> str:
    """One line on a case."""
    c = o.case
    return f"{c.share:.6f} of the fold, gain {c.gain!r}, {c.time:.6g} s from {c.start}: {o.kind} ({o.sentence})" + (
        f"; BUT {o.against}" if o.against else ""
    )


def record(o: Outcome) -> dict[str, Any]:
    """A case as JSON."""
    from casahunt.servo.servo import flatten

    c = o.case
    return {
        "servo": flatten(c.servo), "model": c.model, "gain": c.gain, "share": c.share, "time": c.time,
        "start": c.start, "verdict": o.kind, "sentence": o.sentence, "against": o.against, "seconds": o.seconds,
    }  # fmt: skip


def table(found: list[Outcome]) -> str:
    """Verdicts by how far the gain is from the fold."""
    kinds = ("hunting", "decaying", "at rest", "growing", "undecided", "refused")
    rows = [("all", found)]
    near = [o for o in found if abs(o.case.share - 1) <= 0.01]
    rows += [("within 1 % of the fold", near), ("farther", [o for o in found if o not in near])]
    lines = [f"{'gains':24s}" + "".join(f"{k:>10s}" for k in kinds) + f"{'contradicted':>14s}"]
    for name, part in rows:
        count = Counter(o.kind for o in part)
        wrong = sum(bool(o.against) for o in part)
        lines.append(f"{name:24s}" + "".join(f"{count[k]:10d}" for k in kinds) + f"{wrong:14d}")
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
