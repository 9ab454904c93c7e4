"""The loop as built against another program: the same difference equations, its plant by scipy.

    python scripts/sampled.py                       50 random cases
    python scripts/sampled.py --count 200 --seed 7  others
    python scripts/sampled.py --remedies            with remedies in the controller
    python scripts/sampled.py --lugre --samples 500 LuGre friction

A case: inertia, friction, PID, gain, sample time, delay (none, a part of a sample, several), encoder (none, 500 to
20000 counts), torque step, filtered derivative, trapezoid, dead band, leak, set point, start; followed for `SAMPLES`
samples by casahunt and by peers/sampled_motion.py.

The largest difference of position, velocity and integral, each by its largest size in the motion, must be below
`AGREES` up to the horizon: as long as the other program stays within `APART` of itself when start and inertia are
`NUDGE` of themselves larger.  Beyond it no two programs can agree in double arithmetic: in a slip whose friction falls
differences grow by up to exp(0.86 (Fs - Fc) t/(J vs)), and where the position passes the edge between two counts within
rounding of a sample the two read different counts, and all that follows differs.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import Drive, Friction, Pid, Servo  # noqa: E402
from casahunt.servo.parts import loop_of  # noqa: E402
from casahunt.servo.sampled.loop import Sampled, SampledLoop  # noqa: E402
from casahunt.servo.sampled.plant import as_run  # noqa: E402
from scripts.peers.sampled_motion import SampledServo  # noqa: E402

Array = np.ndarray

SAMPLES = 3000
"""Of a case."""
AGREES = 1e-9
"""Relative difference that is allowed."""
NUDGE, APART = 1e-14, 1e-11
"""The other program against itself: by how much its start and its inertia differ, and what the difference may grow to,
relative."""


def case(seed: int) -> dict[str, Any]:
    """A random case: servo, gain, drive, set point and start."""
    r = np.random.default_rng([seed, 26])

    def spread(low: float, high: float) -> float:
        return float(math.exp(r.uniform(math.log(low), math.log(high))))

    def one_of(*values: Any) -> Any:
        return values[int(r.integers(len(values)))]

    J, Fc = spread(0.003, 0.1), spread(0.1, 1.0)
    ratio, vs, sigma2 = spread(1.05, 1.6), spread(0.01, 0.2), spread(0.005, 0.2)
    omega = spread(5.0, 40.0)  # of the loop: kp = J omega^2
    kd, reset = spread(0.8, 2.0) * J * omega, spread(0.15, 1.0)
    kp = J * omega**2
    T = spread(2e-4, 0.04 / omega)
    servo = Servo(
        inertia=J, motor_gain=1.0, controller=Pid(kp=1.0, ki=1 / reset, kd=kd / kp),
        friction=Friction(static=ratio * Fc, coulomb=Fc, stribeck_velocity=vs, viscous=sigma2),
    )  # fmt: skip
    counts, derivative = one_of(0.0, spread(500, 20000), spread(500, 20000)), one_of("difference", "filtered")
    drive = Drive(
        sample_time=T, delay=T * one_of(0.0, 1.0, float(r.uniform(0, 1)), float(r.uniform(1, 4))), encoder=counts,
        quantise_torque=one_of(0.0, spread(1e-4, 1e-2) * Fc), derivative=derivative,
        filter_time=spread(0.5, 20) * T if derivative == "filtered" else None,
        integration=one_of("rectangle", "trapezoid"),
        dead_band=one_of(0.0, 0.3, 2.0) * 2 * math.pi / (counts or 3000.0),
    )  # fmt: skip
    drive = replace(drive, leak=one_of(0.0, 0.0, spread(0.02, 0.5) / reset))
    start = (-spread(0.02, 1.0) * one_of(1, -1), one_of(0.0, float(r.normal())), one_of(0.0, 0.02 * float(r.normal())))
    return {"servo": servo, "gain": kp, "drive": drive, "set_point": one_of(0.0, float(r.normal())), "start": start}


def remedied(case: dict[str, Any]) -> dict[str, Any]:
    """The case with some of the remedies of its controller, from a start of its own so near that they matter."""
    drive, servo, r = case["drive"], case["servo"], np.random.default_rng(int(1e9 * case["servo"].friction.static))
    T, q = drive.sample_time, drive.count or 2 * math.pi / 3000
    holds = servo.friction.static / case["gain"]  # the error at which the proportional torque breaks it away

    def some(low: float, high: float, none: Any = 0.0) -> Any:
        return float(math.exp(r.uniform(math.log(low), math.log(high)))) if r.random() < 0.3 else none

    band, size = r.choice(["dead_band", "shifted_dead_band", "hysteresis"]), some(0.3 * q, max(holds, 2 * q), 0.3 * q)
    more = {band: float(size), "dwell": some(T, 300 * T, None), "error_filter_time": some(0.3 * T, 6 * T)}
    more |= {"enter_ratio": float(r.uniform(0.2, 1))} if band == "hysteresis" else {}
    if (band := some(0.3 * q, max(holds, 2 * q))) > 0:
        more |= {"error_dead_band": band, "remaining_gain": float(r.choice([0.0, r.uniform(0, 1)]))}
    more |= {key: 1 - some(0.1, 1.5) for key in ("reset", "reset_at_stop")} | {"compensated": some(0.1, 1.0)}
    near = float(r.uniform(1.0, 4.0)) * max(holds, 2 * q)
    x, v, w = case["start"]
    return {**case, "drive": replace(drive, **{"dead_band": 0.0, **more}), "start": (math.copysign(near, x), v, w)}


def bristles(case: dict[str, Any]) -> dict[str, Any]:
    """The case with LuGre friction: bristles that bend by a thousandth to a hundredth of vs/omega, and are damped."""
    servo, r = case["servo"], np.random.default_rng(int(1e9 * case["servo"].friction.static))
    f, omega = servo.friction, math.sqrt(case["gain"] / servo.inertia)
    stiffness = f.static * omega / f.stribeck_velocity * 10 ** float(r.uniform(2, 3))
    damping = float(r.uniform(0.3, 2.0)) * math.sqrt(stiffness * servo.inertia)
    changed = servo.replace(**{"friction.stiffness": stiffness, "friction.damping": damping})
    return {**case, "servo": changed, "bristle": 0.0}


def built(
    servo: Servo, gain: float, drive: Drive, set_point: float, start: tuple[float, float, float],
    bristle: float | None = None,
) -> SampledLoop:  # fmt: skip
    """A servo with its drive; start: x1, x2, x3; bristle: of LuGre friction at the start [rad]; None: Switch."""
    loop = loop_of(servo, "switch" if bristle is None else "lugre", gain)
    states = dict(zip(("x1", "x2", "x3", "x4"), (*start, bristle or 0.0), strict=True))
    return SampledLoop(as_run(loop, drive), drive, set_point, states)


def ours(case: dict[str, Any], samples: int) -> Sampled:
    """The motion by casahunt; its states x1, x2, x3."""
    loop = built(*(case[key] for key in ("servo", "gain", "drive", "set_point", "start")), case.get("bristle"))
    found = loop.run(samples, math.inf)
    return replace(found, states=found.states[[found.names.index(name) for name in ("x1", "x2", "x3")]])


def theirs(case: dict[str, Any], samples: int, nudge: float = 0.0) -> tuple[Array, Array]:
    """The motion by the other program: states and stops; nudge: of start and inertia, relative."""
    servo, drive, f = case["servo"], case["drive"], case["servo"].friction
    kp, kd, ki = servo.torque_gains(case["gain"])
    peer = SampledServo(
        servo.inertia * (1 + nudge), f.static, f.coulomb, f.stribeck_velocity, f.viscous, kp, ki, kd,
        drive.sample_time, drive.delay, drive.encoder, drive.quantise_torque, drive.filter_time or 0.0,
        drive.integration == "trapezoid", drive.dead_band, case["set_point"],
        drive.leak, drive.shifted_dead_band, (drive.enter_ratio * drive.hysteresis, drive.hysteresis),
        drive.dwell or 0.0, drive.reset, drive.reset_at_stop, (drive.error_dead_band, drive.remaining_gain),
        drive.error_filter_time, drive.compensated * f.coulomb,
    )  # fmt: skip
    if "bristle" in case:
        peer.bristle = f.stiffness, f.damping
    x, v, w = case["start"]
    return peer.motion(x * (1 + nudge), v, w, samples)


def compared(seed: int, samples: int, *, lugre: bool = False, remedies: bool = False) -> dict[str, float]:
    """Largest relative difference of the states and of the stops [samples] up to the horizon, and numbers of samples up
    to there, of those that slip, of stops and of counts read."""
    one = remedied(case(seed)) if remedies else case(seed)
    one = bristles(one) if lugre else one
    began = time.perf_counter()
    found = ours(one, samples)
    took = time.perf_counter() - began
    states, stops = theirs(one, samples)
    size = np.abs(states).max(axis=1)
    size = np.where(size > 0, size, 1.0)[:, None]
    spread = (np.abs(states - theirs(one, samples, NUDGE)[0]) / size).max(axis=0)
    horizon = int(np.flatnonzero(np.append(spread, np.inf) > APART)[0])
    off = (np.abs(found.states - states) / size).max(axis=0)[:horizon].max(initial=0.0)
    T, q = one["drive"].sample_time, one["drive"].count
    met, same = (s[s < (horizon - 1) * T] for s in (found.stops, stops))
    late = float(np.abs(met - same).max(initial=0.0)) / T if met.size == same.size else math.inf
    counts = len(np.unique(np.floor((one["set_point"] + states[0]) / q + 0.5))) if q else 0
    return {
        "off": float(off), "late": late, "stops": same.size, "counts": counts, "took": took,
        "slips": int(np.count_nonzero(states[1, :horizon])), "horizon": horizon,
    }  # fmt: skip


def main() -> int:
    """Print each case; returns 1 where one disagrees."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--samples", type=int, default=SAMPLES)
    parser.add_argument("--lugre", action="store_true")
    parser.add_argument("--remedies", action="store_true")
    options = parser.parse_args()
    print("seed  difference  of stops, T  samples  that slip  stops  counts read  casahunt, s")
    worst = 0.0
    for seed in range(options.seed, options.seed + options.count):
        row = compared(seed, options.samples, lugre=options.lugre, remedies=options.remedies)
        worst = max(worst, row["off"])
        flag = "" if row["off"] <= AGREES else "  DIFFERS"
        print(
            f"{seed:4d}  {row['off']:10.1e}  {row['late']:11.1e}  {row['horizon']:7.0f}  {row['slips']:9.0f}  "
            f"{row['stops']:5.0f}  "
            f"{row['counts']:11.0f}  {row['took']:11.3f}{flag}", flush=True,
        )  # fmt: skip
    print(f"largest difference {worst:.1e}; allowed {AGREES:.0e}")
    return 0 if worst <= AGREES else 1


if __name__ == "__main__":
    sys.exit(main())
