"""Random axes of parts against a simulator of its own: does it hunt, how far, how long?

    python scripts/axes.py [--axes N] [--first I] [--seed S] [--as-built | --remedies]

An axis is drawn as one would be built and tuned: one or two masses, its controller (PID by gains or cascade P-PI) for a
bandwidth, on the motor or on the load, friction that may differ by direction, a filter, a torque limit (RANGES).  Its
loop without friction is stable.  In radians, at the screw in SI units (metres, of axes that travel), or millimetres.

casahunt's `loop_cycle` says: a cycle; it hunts irregularly; it comes to rest from each of its starts; or nothing.
Motions of scripts/peers/axis.c (cc) start where `loop_cycle` starts, from some places between, and on the cycle.

    right      a cycle: the motion that starts on it has its amplitude and period, to AGREES; irregular: a motion from
               the same starts repeats in no pattern of up to 8 turns, and WITHIN of its turns are as far and as far
               apart as is said; at rest: from each of these starts; it grows: from one of them, and hunts from none
    WRONG      not so: listed with what was seen
    elsewhere  right, but some other start hunts
    not found  nothing is said

As built: a drive runs it, with a sample time, delay, encoder, and noise; axis.c as well, by the same noise, and without
any for four times as long.

    right      the motions are one, to SAME of Fs/kp, from the first sample to the last, or part by rounding, and the
               swings at the end are as large to ALIKE; and where it is said to rest for ever, or to die out, it does

Remedies: leak, gain, derivative and integral action, of axes that hunt; axis.c with less and more of each (SIZES).

    right      where the table says that hunting has ended, no motion hunts from any of 24 starts; at
               twice where it says so
    WRONG      some motion does
    unclear    none does, and some motion has not come to rest by the end of the time
    earlier    all come to rest with a little less too: the last cycles attract from nowhere

Exit code 1 if anything is wrong.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import Drive, remedies, simulate_sampled  # noqa: E402
from casahunt.errors import ComesToRest, HuntsIrregularly, NoOrbit  # noqa: E402
from casahunt.servo.outcome import SETTLES  # noqa: E402
from casahunt.servo.parts import (  # noqa: E402
    BACK_CALCULATION,
    BY_DIRECTION,
    CLAMPING,
    DERIVATIVE_FILTER,
    INERTIA,
    INTEGRATOR,
    P_PI,
    PID_BY_GAINS,
    SWITCH,
    TORQUE_LIMIT,
    TWO_MASSES,
    TWO_MASSES_LOAD_SEEN,
    Loop,
    series,
)
from casahunt.servo.parts.fate import on_the_cycle  # noqa: E402
from casahunt.servo.parts.turns import PATTERN  # noqa: E402
from casahunt.servo.parts.verbs import loop_cycle  # noqa: E402
from scripts.peers.axis_motion import NAMES, AxisMotion, Fate, built  # noqa: E402

AGREES, WITHIN = 1e-6, (0.05, 0.95)
STARTS = tuple(2.0**-k for k in range(0, 13, 2))
BETWEEN = (3.0, 0.5, 0.05)
"""Starts: of those of `loop_cycle`; and in units of Fs/kp."""
LONGEST, PERIODS = 5e4, 200
"""Of a motion, in 1/bandwidth; and in periods, where it starts on a cycle."""
NOISES = 0.0, 0.0, 1e-4, 3e-3
"""Standard deviations of a reading, in Fs/kp."""
SAME, ALIKE, FAR, LONGER = 1e-6, 0.1, 1e4, 4
"""Of motions as built; farther away, in Fs/kp, none is followed; so many times as long, one that is said to rest is."""
BUILT_FOR, MOST_SAMPLES, STARTED = 1e3, 200_000, 0.3
"""1/bandwidth, and samples, of a motion as built; its start, in Fs/kp."""
SIZES, MANY_STARTS, FOLLOWED = (0.97, 1.03, 2.0), tuple(np.geomspace(3e-3, 3.0, 12).tolist()), (5e3, 2e5)
SEEN_TO, SLIPS_SOON = 1e-10, 0.99
"""So much of a remedy as at its border; starts, in Fs/kp, at rest without torque or with so much of Fs; how long they
are followed, and where that does not tell, in 1/bandwidth; error of a step there."""
REMEDIES = {
    "leak": lambda n, size: {"leak": size},
    "gain": lambda n, size: {name: size * n[name] for name in ("kp", "kd", "ki")},
    "derivative": lambda n, size: {"kd": size},
    "integral": lambda n, size: {"ki": size},
}
UNITS = {"rad": 1.0, "m": 1.0, "mm": 1e3}


class Axis:
    """An axis: its loop, and the numbers of the same in the words of axis.c."""

    def __init__(self, seed: int, number: int) -> None:
        rng = self.rng = np.random.default_rng([seed, number])
        self.unit = str(rng.choice(["rad", "rad", "m", "mm"]))
        while True:
            self.drawn()
            poles = np.linalg.eigvals(self.linear())
            if poles.real.max() < -1e-3 * self.bandwidth:
                break
        self.n["longest_step"] = 3 / np.abs(poles).max()

    def between(self, low: float, high: float) -> float:
        """A number, log-uniformly."""
        return float(np.exp(self.rng.uniform(math.log(low), math.log(high))))

    def drawn(self) -> None:
        """The numbers, and the parts."""
        rng, between = self.rng, self.between
        n = self.n = dict.fromkeys(NAMES, 0.0) | {"M": 1e300}
        masses, load_seen = rng.random() < 0.75, rng.random() < 0.4
        rotary = self.unit == "rad"
        J = between(1e-4, 0.1) if rotary else between(5.0, 500.0) / UNITS[self.unit]
        w = self.bandwidth = between(10.0, 150.0)
        n["kd"], n["kp"], n["ki"] = (J * w**k * f * between(0.6, 1.7) for k, f in ((1, 2.0), (2, 2.5), (3, 1.0)))
        self.scale = between(3e-3, 0.3) if rotary else between(2e-5, 2e-3) * UNITS[self.unit]
        Fs = n["kp"] * self.scale
        self.values = {"motor_gain": 1.0, "gain": 1.0}
        plant, friction, more = INERTIA, SWITCH, []
        if masses:
            share, high = rng.uniform(0.2, 0.8), w * between(4.0, 40.0)  # of the motor; of the shaft's free ringing
            n["J"], n["JL"] = share * J, (1 - share) * J
            reduced = share * (1 - share) * J
            n["k"], n["d"] = reduced * high**2, 2 * between(0.01, 0.15) * reduced * high
            n["seen"], plant = float(load_seen), TWO_MASSES_LOAD_SEEN if load_seen else TWO_MASSES
            self.values |= {"load_inertia": n["JL"], "shaft_stiffness": n["k"], "shaft_damping": n["d"]}
        else:
            n["J"] = J
        n["vs"] = self.scale * w * between(2e-3, 0.2)
        for of, static in (("", Fs), ("_back", Fs * between(0.7, 1.4))):
            n |= {"Fs" + of: static, "Fc" + of: static * rng.uniform(0.55, 0.95), "b" + of: J * w * between(0.003, 0.3)}
        names = {"Fs": "static", "Fc": "coulomb", "b": "viscous"}
        if rng.random() < 0.35:
            friction = BY_DIRECTION
            self.values |= {names[name] + "_back": n[name + "_back"] for name in names}
        else:
            n |= {name + "_back": n[name] for name in names}
        self.values |= {"inertia": n["J"], "stribeck_velocity": n["vs"], **{names[k]: n[k] for k in names}}
        controller = self.controller(rng.random() < 0.5)
        self.filtered(w, more)
        if rng.random() < 0.4:
            way, most = int(rng.integers(3)), max(n["Fs"], n["Fs_back"])
            n |= {"M": most * between(1.1, 4.0), "way": float(way), "Tu": between(0.3, 10) / w}
            more.append((TORQUE_LIMIT, CLAMPING, BACK_CALCULATION)[way])
            self.values |= {"torque_limit": n["M"]} | ({"unwinding_time": n["Tu"]} if way == 2 else {})
        self.loop = Loop((plant, friction, controller, INTEGRATOR, *more), dict(self.values))

    def controller(self, cascade: bool) -> Any:
        """PID, or the cascade of P and PI where the same zeros are real: kd s^2 + kp s + ki = Kv (s + Kp)(s + 1/Tn)."""
        n = self.n
        root = n["kp"] ** 2 - 4 * n["kd"] * n["ki"]
        if not cascade or root < 0:
            self.values |= {name: n[name] for name in ("kp", "kd", "ki")}
            return PID_BY_GAINS
        Kp, reset = ((n["kp"] + s * math.sqrt(root)) / (2 * n["kd"]) for s in (-1, 1))
        self.values |= {"velocity_gain": n["kd"], "position_gain": Kp, "reset_time": 1 / reset}
        return P_PI

    def filtered(self, w: float, more: list[Any]) -> None:
        """A filter or none."""
        n, kind = self.n, int(self.rng.integers(5))
        if kind == 1:
            n["Tf"] = self.values["derivative_filter"] = self.between(0.01, 0.3) / w
            more.append(DERIVATIVE_FILTER)
        elif kind == 2:
            n["kind"], n["w"] = 1.0, w * self.between(5.0, 50.0)
            self.values["low_pass"] = n["w"]
            more.append(series("low-pass"))
        elif kind == 3 and n["JL"]:
            high = math.sqrt(n["k"] * (1 / n["J"] + 1 / n["JL"])) * self.between(0.8, 1.2)
            n |= {"kind": 2.0, "w": high, "z": self.between(0.2, 0.7), "depth": self.between(0.05, 0.5)}
            self.values |= {"notch_frequency": high, "notch_damping": n["z"], "notch_depth": n["depth"]}
            more.append(series("notch"))

    def linear(self) -> np.ndarray:
        """The loop without friction but b, of x1 v x3 phi w lag p q."""
        n, E = self.n, np.eye(8)
        x, v, i, phi, w, lag, p, q = E
        e, rate = (phi, w) if n["seen"] else (x, v)
        slope = (e - lag) / n["Tf"] if n["Tf"] else rate
        u = -(n["kp"] * e + n["kd"] * slope + n["ki"] * i)
        notch = 2 * n["z"] * n["w"]
        torque = p if n["kind"] == 1 else u - notch * (1 - n["depth"]) * q if n["kind"] == 2 else u
        shaft = n["k"] * (x - phi) + n["d"] * (v - w) if n["JL"] else 0 * x
        rows = [v, (torque - shaft - min(n["b"], n["b_back"]) * v) / n["J"], e]
        kept = [0, 1, 2]
        if n["JL"]:
            rows, kept = [*rows, w, shaft / n["JL"]], [*kept, 3, 4]
        if n["Tf"]:
            rows, kept = [*rows, slope], [*kept, 5]
        if n["kind"]:
            rows += [n["w"] * (u - p)] if n["kind"] == 1 else [q, u - n["w"] ** 2 * p - notch * q]
            kept += [6] if n["kind"] == 1 else [6, 7]
        return np.array(rows)[:, kept]

    def state(self, named: dict[str, float]) -> np.ndarray:
        """A state of the loop in the words of axis.c, whose notch has states of its own."""
        n, keys = self.n, ("x1", "x2", "x3", "load_angle", "load_rate", "lagging", "low_pass1")
        y = np.array([*(named.get(key, 0.0) for key in keys), 0.0])
        if n["kind"] == 2:
            drop = 2 * n["z"] * n["w"] * (1 - n["depth"])
            y[6:] = named["notch2"] / (drop * n["w"] ** 2), -named["notch1"] / drop
        return y

    def about_to_slip(self, n: dict[str, float], off: float) -> np.ndarray:
        """At rest, so far from the set point, with the torque of a breakaway."""
        torque = SLIPS_SOON * n["Fs"]
        notch = torque / n["w"] ** 2 if n["kind"] == 2 else torque
        return np.array([-off, 0.0, (n["kp"] * off - torque) / n["ki"], -off, 0.0, -off, notch, 0.0])

    def motion(self, start: dict[str, float], longest: float = 0.0) -> Fate:
        """What becomes of a motion, within a time."""
        return AxisMotion(self.n, self.state(start), self.scale).fate(max(longest, LONGEST / self.bandwidth))


def said_by(axis: Axis) -> tuple[str, Any, float]:
    """(verdict, cycle or refusal, CPU [s])."""
    began = time.process_time()
    try:
        verdict, said = "hunts", loop_cycle(axis.loop)
    except HuntsIrregularly as refusal:
        verdict, said = "irregular", refusal
    except ComesToRest as refusal:
        verdict, said = "rests", refusal
    except NoOrbit as refusal:
        verdict, said = "grows" if "the motion grows" in str(refusal) else "not found", refusal
    return verdict, said, time.process_time() - began


def judged(axis: Axis, verdict: str, said: Any) -> tuple[str, str]:
    """(outcome, what was seen)."""
    same = [axis.motion(axis.loop.at_rest(-size)) for size in STARTS]
    others = [axis.motion(axis.loop.at_rest(size * axis.scale)) for size in BETWEEN]
    seen = f"same starts {dict(Counter(f.verdict for f in same))}, others {dict(Counter(f.verdict for f in others))}"
    hunting = [f for f in (*same, *others) if f.verdict in ("hunts", "irregular")]
    seen += "".join(f"; {f.verdict} {np.abs(f.turns).max():.6g} {f.period:.6g} n={f.n}" for f in hunting[:1])
    if verdict == "hunts":
        on = axis.motion(on_the_cycle(said), PERIODS * said.period)
        off = said.amplitude / on.amplitude - 1, said.period / on.period - 1
        times = max(round(on.period / said.period), 1) if on.verdict == "hunts" else 0
        right = times and max(abs(off[0]), abs(times * said.period / on.period - 1)) < AGREES
        return ("right" if right else "WRONG"), f"{on.verdict} off {off[0]:.1e} {off[1]:.1e}; {seen}"
    if verdict == "rests":
        wrong = any(f.verdict in ("hunts", "irregular", "grows") for f in same)
        return ("WRONG" if wrong else "elsewhere" if hunting else "right"), seen
    if verdict == "irregular":
        likely = [f for f in same if f.verdict == "irregular" or f.n > PATTERN]
        pairs = [((said.amplitude, np.abs(f.turns)), (said.between, np.diff(f.times))) for f in likely]
        fits = [all(low <= q <= high for (low, high), of in each for q in np.quantile(of, WITHIN)) for each in pairs]
        return ("right" if any(fits) else "WRONG"), seen
    if verdict == "grows":
        wrong = hunting or all(f.verdict != "grows" for f in same)
        return ("WRONG" if wrong else "right"), seen
    return ("not found" if hunting else "rests, not found"), seen


def as_built(axis: Axis) -> tuple[str, str, float]:
    """(outcome, what was seen, CPU [s]) of an axis with a drive that is drawn."""
    scale, between, rng = axis.scale, axis.between, axis.rng
    T = between(0.005, 0.05) / axis.bandwidth
    delay, q = float(rng.choice([0, 0, 0.5, 1, 1.5])) * T, scale * between(1e-3, 3e-2) * (rng.random() < 0.7)
    theta_d, off = q * float(rng.choice([0.0, 0.3])), STARTED * scale
    samples = int(min(BUILT_FOR / axis.bandwidth / T, MOST_SAMPLES))
    noise = NOISES[axis.rng.integers(len(NOISES))] * scale
    drive = Drive(sample_time=T, delay=delay, encoder=2 * math.pi / q if q else 0.0, noise=noise)
    began = time.process_time()
    said = simulate_sampled(axis.loop, drive=drive, time=samples * T, set_point=theta_d, position=theta_d - off)
    cpu, verdict = time.process_time() - began, said.verdict
    known = {"sample_time": T, "delay": delay, "count": q, "set_point": theta_d}
    longer = LONGER if verdict.kind in ("at rest", "decaying") and not noise else 2 if verdict.kind == "at rest" else 1
    x = built(axis.n, known, axis.state(axis.loop.at_rest(-off)), drive.noises(longer * samples), FAR * scale)
    x = x[:, 0] / scale
    ours = said.states[0] / scale
    many = min(ours.size, x.size)
    apart = np.flatnonzero(np.abs(ours[:many] - x[:many]) > SAME)
    one = int(apart[0]) if apart.size else many
    end, late = np.ptp(ours[many // 2 : many]), np.ptp(x[x.size // 2 :])
    right = one == many or max(late, end) <= SAME or abs(late / end - 1) <= ALIKE
    if verdict.kind == "at rest":
        right &= bool(np.ptp(x[samples:]) <= SAME)
    if verdict.kind == "decaying":
        right &= bool(np.abs(x[x.size // 2 :]).max() <= max(np.abs(ours[many // 2 :]).max(), q / scale) + SAME)
    seen = f"T = {T * axis.bandwidth:.3g}, delay {delay / T:g} T, count {q / scale:.2g}, noise {noise / scale:.2g}: "
    seen += f"{verdict.kind}, "
    seen += f"{end / 2:.4g} ({late / 2:.4g}) Fs/kp; one motion for {one} of {many} samples"
    return ("right" if right else "WRONG"), seen, cpu


def mended(axis: Axis) -> tuple[str, str, float]:
    """(outcome, what was seen, CPU [s]) of the remedies of an axis that hunts."""
    began = time.process_time()
    try:
        rows = remedies(axis.loop, only=list(REMEDIES)).remedies
    except NoOrbit as refusal:
        return "no hunting", str(refusal), time.process_time() - began
    cpu, seen, outcomes = time.process_time() - began, list[str](), set[str]()
    for row in rows:
        if not row.ends_hunting:
            seen.append(f"{row.name}: {row.kind}")
            continue
        for factor in SIZES if row.stays[2] in SETTLES else SIZES[:-1]:  # the table may say that it hunts at twice
            size = row.size / factor if row.name == "integral" else row.size * factor
            n = axis.n | REMEDIES[row.name](axis.n, size)
            n["longest_step"] /= max(n["kp"] / axis.n["kp"], n["kd"] / axis.n["kd"], 1.0)
            states = [
                state for off in MANY_STARTS
                for state in (axis.state(axis.loop.at_rest(-off * axis.scale)), axis.about_to_slip(n, off * axis.scale))
            ]  # fmt: skip
            motions = [AxisMotion(n, state, axis.scale, SEEN_TO) for state in states]
            said = Counter[str]()
            for motion in motions:
                fates = (motion.fate(many / axis.bandwidth).verdict for many in FOLLOWED)
                said[next((verdict for verdict in fates if verdict not in ("unclear", "grows")), "unclear")] += 1
            hunts, rest = said["hunts"] + said["irregular"] > 0, said["rests"] == len(states)
            outcome = "earlier" if rest else "right"
            if factor > 1:
                outcome = "right" if rest else "WRONG" if hunts else "unclear"
            outcomes.add(outcome)
            if outcome != "right":
                seen.append(f"{row.name}: {outcome} {row.kind} {row.size:.6g} x {factor}: {dict(said)}")
    return next((each for each in ("WRONG", "unclear", "earlier") if each in outcomes), "right"), "; ".join(seen), cpu


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("--axes", 40), ("--first", 0), ("--seed", 1)):
        parser.add_argument(name, type=int, default=value)
    parser.add_argument("--as-built", action="store_true")
    parser.add_argument("--remedies", action="store_true")
    asked = parser.parse_args(arguments)
    sums, took = Counter[str](), list[float]()
    for number in range(asked.first, asked.first + asked.axes):
        axis = Axis(asked.seed, number)
        parts = ", ".join(part.name for part in axis.loop.parts)
        if asked.as_built or asked.remedies:
            left_out = asked.as_built and axis.n["M"] < 1e300 and axis.n["way"]  # axis.c has no drive for these
            ask = as_built if asked.as_built else mended
            outcome, seen, cpu = ("left out", "", 0.0) if left_out else ask(axis)
            sums[outcome] += 1
            took.append(cpu)
            print(f"{number} ({parts}; {axis.unit}): {outcome}: {seen}; {cpu:.1f} s", flush=True)
            continue
        verdict, said, cpu = said_by(axis)
        outcome, seen = judged(axis, verdict, said)
        sums[outcome] += 1
        took.append(cpu)
        what = f"{said.amplitude:.6g} {said.period:.6g}" if verdict == "hunts" else said
        print(f"{number} ({parts}; {axis.unit}): {outcome}: {verdict} {what}; peer: {seen}; {cpu:.1f} s", flush=True)
    print(dict(sums), f"CPU median {np.median(took):.1f} s, largest {max(took):.1f} s")
    return int(sums["WRONG"] > 0)


if __name__ == "__main__":
    raise SystemExit(main())
