"""How far the loop as built is from the continuous one, over random servos.

    python scripts/as_built.py order [--count 12]      as the sample time falls: fitted order of amplitude, period, fold
    python scripts/as_built.py encoder [--count 100]   by the counts of the amplitude: how often it hunts, how different
    python scripts/as_built.py remedies [--count 6]    which remedies of the continuous loop end hunting as built

order: the sample time is a part of the time 1/omega of the loop, omega^2 = kp/J; no encoder, so that only sampling
differs.  The continuous cycle is found_orbit's, the fold find_fold's.  A motion as built starts on the cycle and is
followed for `PERIODS` periods; amplitude and period are means over all whole swings of its second half: samples do not
fit the period.  The fold gain as built is where hunting that starts on the cycle next to the fold ends, by halving;
it is compared with the end of the first of `stable_ranges`, beyond which motions go to no symmetric cycle any more.

encoder: a servo at a part of its fold gain hunts in the continuous loop with an amplitude A.  A count of the encoder is
A/c, c from `COUNTS`; the set point lies anywhere between two.  The same motion is computed with and without.

remedies: the servo of problems/as_built.toml at gain 1, and servos of random_servos.py (by kp, ki, kd) at half of their
fold gain that 1 ms suits: 1/omega and kp/ki as `FEWEST_OF_LOOP` and `LONGEST_RESET` say.  Each remedy has the size that
`remedies` recommends, and the drive 1 ms and each encoder of `ENCODERS` (0: none), without and with a dead band of the
integrator of `NARROW_BAND` counts besides.  It holds where all motions of `as_built` come to rest or die out.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import (  # noqa: E402
    Drive,
    Friction,
    InputError,
    NoOrbit,
    Pid,
    Servo,
    find_fold,
    find_orbit,
    remedies,
    simulate_sampled,
)  # fmt: skip
from casahunt.servo.drive import BANDS, with_remedy  # noqa: E402
from casahunt.servo.outcome import BY_SEVERITY  # noqa: E402
from casahunt.servo.parts import loop_of  # noqa: E402
from casahunt.servo.sampled.check import motions_of, told_apart  # noqa: E402
from casahunt.servo.sampled.motion import turning_points  # noqa: E402
from casahunt.servo.sampled.plant import DRIVE_PARTS  # noqa: E402
from casahunt.servo.stable_up_to import stable_ranges  # noqa: E402
from casahunt.views.commands.remedies import OWN  # noqa: E402
from scripts.random_servos import draw  # noqa: E402

Array = np.ndarray

PARTS = (0.08, 0.04, 0.02, 0.01, 0.005)
"""Sample times by 1/omega."""
PERIODS = 20
"""Of a motion that is followed."""
COUNTS = (0.5, 1, 2, 3, 5, 8, 12, 20, 40, 80)
"""Of the amplitude."""
FOLD_STEPS, LOWEST, HIGHEST = 11, 0.7, 1.15
"""Halvings of the range, in gains of the continuous fold, in which the fold gain as built is looked for."""
ENCODER_SAMPLE = 0.01
"""Sample time by 1/omega beside an encoder."""

ENCODERS = (0, 2000, 20000)
"""Counts per revolution of the remedies' drives."""
NARROW_BAND = 0.55
"""Counts: no reading of any set point is nearer to it on both sides."""
FEWEST_OF_LOOP, LONGEST_RESET = 10.0, 1.0
"""Samples in 1/omega, at least; kp/ki [s], at most: slower ones hunt by minutes."""


def servo_of(seed: int) -> Servo:
    """A random servo; K = 1 is a gain of its own scale."""
    r = np.random.default_rng([seed, 4])

    def spread(low: float, high: float) -> float:
        return float(math.exp(r.uniform(math.log(low), math.log(high))))

    J, Fc, omega = spread(0.003, 0.1), spread(0.1, 1.0), spread(5.0, 30.0)
    kp = J * omega**2
    return Servo(
        inertia=J, motor_gain=kp, controller=Pid(kp=1.0, ki=omega * spread(0.15, 0.4), kd=spread(0.8, 1.6) / omega),
        friction=Friction(static=Fc * spread(1.1, 1.6), coulomb=Fc, stribeck_velocity=spread(0.02, 0.1),
                          viscous=spread(0.01, 0.1) * J * omega),
    )  # fmt: skip


def start_of(orbit: Any) -> dict[str, float]:
    """Where a cycle is stuck, on the verge of its slip, as a start at the set point 0."""
    x = orbit.arcs[0].states[0, 0]
    return {"position": float(x[0]), "velocity": 0.0, "integral": float(x[2])}


def means(motion: Any) -> tuple[float, float]:
    """Mean amplitude [rad] and time of two swings [s] of the second half of a motion; nan where it does not swing."""
    half = motion.times.size // 2
    x, t = motion.states[0, half:], motion.times[half:]
    turns = turning_points(x, 0.25 * float(np.ptp(x)))
    if turns.size < 5:
        return math.nan, math.nan
    swings = np.abs(np.diff(x[turns]))
    return float(swings.mean()) / 2, float(2 * (t[turns[-1]] - t[turns[0]]) / (turns.size - 1))


def hunts_on(servo: Servo, gain: float, drive: Drive, start: dict[str, float], period: float, amplitude: float) -> bool:
    """Whether hunting that starts on a cycle goes on."""
    motion = simulate_sampled(servo, gain, drive, set_point=0.0, time=PERIODS * period, **start)
    late = motion.states[0, 3 * motion.times.size // 4 :]
    return float(np.ptp(late)) > amplitude and motion.verdict.kind in ("hunting", "undecided")


def fold_as_built(servo: Servo, drive: Drive, fold: Any) -> float:
    """The gain at which hunting ends, by halving."""
    orbit = fold.orbit
    low, high = LOWEST * fold.gain, HIGHEST * fold.gain
    start = start_of(orbit)
    for _ in range(FOLD_STEPS):
        middle = (low + high) / 2
        hunts = hunts_on(servo, middle, drive, start, orbit.period, orbit.amplitude / 2)
        low, high = (middle, high) if hunts else (low, middle)
    return (low + high) / 2


def order(count: int, first: int = 1) -> Iterator[tuple[str, Array]]:
    """Relative differences from the continuous loop of each servo: (3, len(PARTS)) amplitude, period, fold gain."""
    seed, found = first - 1, 0
    while found < count:
        seed += 1
        servo = servo_of(seed)
        try:
            fold = find_fold(servo, "switch")
            gain = 0.5 * fold.gain
            orbit = find_orbit(servo, "switch", gain)
        except NoOrbit:
            continue
        found += 1
        rows, reference = np.empty((3, len(PARTS))), stable_ranges(fold)[0][1]
        omega = math.sqrt(servo.torque_gains(gain)[0] / servo.inertia)
        for i, part in enumerate(PARTS):
            drive = Drive(sample_time=part / omega)
            motion = simulate_sampled(
                servo, gain, drive, set_point=0.0, time=PERIODS * orbit.period, **start_of(orbit)
            )
            amplitude, period = means(motion)
            ends = fold_as_built(servo, drive, fold)
            rows[:, i] = amplitude / orbit.amplitude - 1, period / orbit.period - 1, ends / reference - 1
        yield f"{seed:3d}", rows


def fitted(errors: Array) -> float:
    """The order of errors (m,) in the sample time."""
    known = np.isfinite(errors) & (errors != 0)
    if np.count_nonzero(known) < 3:
        return math.nan
    return float(np.polyfit(np.log(np.array(PARTS)[known]), np.log(np.abs(errors[known])), 1)[0])


def encoder(count: int, seed: int) -> Iterator[tuple[float, str, float]]:
    """(counts of the amplitude, cause, or what it does if it does not hunt, largest difference of the means)."""
    r, done = np.random.default_rng([seed, 5]), 0
    while done < count:
        servo = servo_of(int(r.integers(10**6)))
        share = float(r.uniform(0.2, 0.9))
        try:
            gain = share * find_fold(servo, "switch").gain
            orbit = find_orbit(servo, "switch", gain)
        except NoOrbit:
            continue
        done += 1
        omega = math.sqrt(servo.torque_gains(gain)[0] / servo.inertia)
        start = start_of(orbit)
        exact = Drive(sample_time=ENCODER_SAMPLE / omega)
        free = simulate_sampled(servo, gain, exact, set_point=0.0, time=PERIODS * orbit.period, **start)
        if free.verdict.kind != "hunting":
            continue
        for counts in COUNTS:
            q = orbit.amplitude / counts
            offset = float(r.uniform(0, q))
            drive = Drive(sample_time=ENCODER_SAMPLE / omega, encoder=2 * math.pi / q)
            moved = start | {"position": start["position"] + offset}
            motion = simulate_sampled(servo, gain, drive, set_point=offset, time=PERIODS * orbit.period, **moved)
            off = np.abs(np.array(means(motion)) / np.array(means(free)) - 1).max()
            hunts = motion.verdict.kind == "hunting"
            yield counts, told_apart(motion.verdict, free.verdict)[0] if hunts else motion.verdict.kind, float(off)


def servos_to_cure(count: int, seed: int) -> Iterator[tuple[str, Servo, float]]:
    """(name, servo, gain) of the one that is known, and of random ones."""
    known = Servo(
        inertia=0.012, motor_gain=4.2, controller=Pid(kp=1, ki=8, kd=0.05),
        friction=Friction(static=0.40, coulomb=0.30, stribeck_velocity=0.05, viscous=0.02),
    )  # fmt: skip
    yield "known", known, 1.0
    number, found = 0, 1
    while found < count:
        number += 1
        servo = Servo().replace(**draw(seed, number, "pid"))
        try:
            gain = 0.5 * find_fold(servo, "switch").gain
            find_orbit(servo, "switch", gain)
        except NoOrbit:
            continue
        kp, _, ki = servo.torque_gains(gain)
        if math.sqrt(servo.inertia / kp) >= FEWEST_OF_LOOP * 1e-3 and kp / ki <= LONGEST_RESET:
            found += 1
            yield f"{number:5d}", servo, gain


def cured_as_built(row: Any, servo: Servo, gain: float, drive: Drive) -> tuple[str, float]:
    """The worst verdict of the loop as built with a remedy; the largest amplitude of what hunts [rad]."""
    size, pid = row.recommended, servo.controller.pid()
    if row.name == "gain":
        gain = size
    elif row.name in OWN:
        servo = servo.replace(**{f"controller.{name}": value for name, value in
                                 ({**vars(pid), OWN[row.name]: size}).items()})  # fmt: skip
    else:
        drive = with_remedy(drive, DRIVE_PARTS[row.name], size)
    seen = [motion.verdict for motion in motions_of(loop_of(servo, "switch", gain), drive)]
    hunts = [one.amplitude for one in seen if one.kind == "hunting"]
    return max((one.kind for one in seen), key=BY_SEVERITY.index), max(hunts, default=0.0)


def cured(count: int, seed: int) -> Iterator[tuple[str, str, int, bool, str, float]]:
    """(servo, remedy, encoder, whether there is a narrow dead band besides, verdict, counts that it hunts by)."""
    for name, servo, gain in servos_to_cure(count, seed):
        found = remedies(servo, "switch", gain)
        counts = find_orbit(servo, "switch", gain).amplitude / (2 * math.pi / 2000)
        print(f"servo {name}: hunts by {counts:.3g} counts of 2000", flush=True)
        for row in (row for row in found.remedies if row.ends_hunting and row.name != "dither"):
            for encoder in ENCODERS:
                drive = Drive(sample_time=1e-3, encoder=encoder)
                for besides in (False, True):
                    band = DRIVE_PARTS.get(row.name) in BANDS
                    if besides and (band or not encoder):
                        continue
                    more = with_remedy(drive, "dead_band", NARROW_BAND * drive.count) if besides else drive
                    try:
                        kind, left = cured_as_built(row, servo, gain, more)
                    except InputError as error:
                        kind, left = f"none: {error}", math.nan
                    yield name, row.name, encoder, besides, kind, left / (drive.count or 1.0)


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("order", "encoder", "remedies"))
    parser.add_argument("--count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    if options.what == "order":
        print("relative differences at T omega = " + ", ".join(f"{part:g}" for part in PARTS) + "; order")
        orders = []
        for name, rows in order(options.count or 12):
            orders.append([fitted(row) for row in rows])
            for what, row, p in zip(("amplitude", "period", "fold gain"), rows, orders[-1], strict=True):
                print(f"{name} {what:10s} {' '.join(f'{value:+9.2e}' for value in row)}  {p:5.2f}", flush=True)
        print("median orders: " + ", ".join(map("{:.2f}".format, np.nanmedian(orders, 0))))
        return 0
    if options.what == "remedies":
        return print_cured(options.count or 6, options.seed)
    rows = list(encoder(options.count or 300, options.seed))
    print("counts  rests  not decided  hunts  by quantisation  difference of the means: median  90 %")
    for counts in COUNTS:
        own = [row for row in rows if row[0] == counts]
        causes = [row[1] for row in own]
        hunting = [row for row in own if row[1] in ("stiction", "quantisation", "not certain")]
        off = np.array([row[2] for row in hunting] or [math.nan])
        print(
            f"{counts:6g} {causes.count('at rest'):6d} {len(own) - len(hunting) - causes.count('at rest'):12d} "
            f"{len(hunting):6d} {causes.count('quantisation'):16d} {np.nanmedian(off):32.3f} "
            f"{np.nanquantile(off, 0.9):5.3f}"
        )
    return 0


def print_cured(count: int, seed: int) -> int:
    """Print all verdicts, and how often a remedy holds + is undecided/of how many servos."""
    rows = []
    for row in cured(count, seed):
        rows.append(row)
        left = f"{row[5]:.3g} counts" if row[2] and row[5] else ""
        print(f"  {row[1]:18s} {row[2]:6d} {'+ band' if row[3] else '':8s} {row[4]:10s} {left}", flush=True)
    print("remedy            " + "".join(f"{n or 'exact':>10} {'+ band' if n else '':6s}" for n in ENCODERS))
    for name in dict.fromkeys(row[1] for row in rows):
        cells = []
        for at, band in ((n, b) for n in ENCODERS for b in (False, True)):
            own = [row[4] for row in rows if row[1:4] == (name, at, band)]
            holds, open_ = (sum(kind in kinds for kind in own) for kinds in (BY_SEVERITY[:2], ("undecided",)))
            cells.append(f"{holds}+{open_}/{len(own)}" if own else "")
        print(f"{name:18s}" + " ".join(f"{cell:>8s}" for cell in cells))
    return 0


if __name__ == "__main__":
    sys.exit(main())
