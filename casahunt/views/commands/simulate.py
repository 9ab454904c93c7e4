"""casahunt simulate: the motion of the closed loop from an initial state.

Keys of the JSON object: model, gain, set_point, time (reached), regularised, tol; verdict ("hunting", "decaying",
"growing", "at rest", "undecided"), reason, amplitude [rad] and period [s] (null without whole periods), swings (their
number); judged: swings [rad], since [s], ratios of each to the one before, limit (the cycle's swing, also
of one that an undecided motion is on its way to; 0 for rest, else null) [rad], multiplier (or null), floor [rad] below
which nothing is judged, map_motions (beyond the motion itself);
position, velocity, integral and bristle (null for Switch) at the end; other_end, where a motion comes to rest: the
cycle at the same gain that it has not come to, amplitude, period, half_multiplier (null where not to be trusted) and
start, from which, at rest, a motion was followed that hunts: position, integral, time and, on the cycle itself,
velocity and bristle (null where none hunts); null without such a cycle, of which other_end_reason says why;
events, a list of [time, name, mode before, mode after, estimated error of the time or null]; time_error [s], end_error,
state_errors (null where unknown);
status, advice (null where converged), ended (why it stopped early, or null), intervals, wall_s.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ... import effort
from ...checks import error_text, finite_or_none, known, moderate, to_absolute_error, to_error
from ...errors import InputError
from ...files import whole_text
from ...servo.hunting import MODELS
from ...servo.other_end import OtherEnd, other_end
from ...servo.simulation.simulate import simulate
from ...servo.simulation.trajectory import Trajectory
from ...tables import table as csv_table
from .arguments import add_common, add_csv, add_gain, csv_of, finite, gain_of, picture_of, positive, servo_of
from .console import complain
from .printed import show

COLUMNS = ("time_s", "position_rad", "velocity_rad_per_s", "integral_rad_s", "torque_Nm", "mode")
"""Columns of the CSV file; for LuGre bristle_rad stands before the torque."""
EVENT_WORDS = {
    "stop": "stops", "breakaway+": "breakaways forwards", "breakaway-": "breakaways backwards",
    "reversal": "reversals", "centre": "times the bristle slack",
}  # fmt: skip
"""How many of an event are told."""
MOST_ROWS = 10_000_000


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("simulate", allow_abbrev=False, help="the motion from an initial state")
    add_gain(command)
    add_common(command)
    command.add_argument("--model", default="switch", help="switch (default) or lugre")
    command.add_argument("--set-point", default=1.0, help="theta_d in rad (default 1)")
    command.add_argument("--time", default=100.0, help="length of the motion in s (default 100)")
    command.add_argument("--position", default=0.0, help="position theta at the start in rad (default 0)")
    command.add_argument("--velocity", default=0.0, help="velocity at the start in rad/s (default 0)")
    command.add_argument("--integral", default=0.0, help="integral of theta - theta_d so far in rad s (default 0)")
    command.add_argument("--bristle", default=0.0, help="bristle deflection at the start in rad (lugre, default 0)")
    command.add_argument("--regularised", action="store_true", help="switch with the report's stick band eta")
    add_csv(command, "the motion")
    command.add_argument("--step", help="time step of the CSV file in s (default: dense where the motion is fast)")
    command.add_argument("--plot", metavar="F.png", help="write a picture of the motion")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code.

    Raises InputError: the command line is wrong.; NoOrbit: the motion could not be computed.
    """
    model = known("model", options.model, MODELS)
    gain = gain_of(options)
    length = positive("time", options.time)
    keys = ("set_point", "position", "velocity", "integral", "bristle", "tol")
    numbers = {key: _size(key.replace("_", "-"), getattr(options, key)) for key in keys}
    step = None if options.step is None else positive("step", options.step)
    if step is not None and options.csv is None:
        raise InputError("step: must be left out without --csv")
    if step is not None and length / step > MOST_ROWS:
        raise InputError(f"step = {step:g}: must be at least {length / MOST_ROWS:g} s, for {MOST_ROWS} rows at most")
    servo = servo_of(options)
    plot = picture_of(options)
    table = csv_of(options)
    began = time.perf_counter()
    found = simulate(servo, model, gain, time=length, regularised=options.regularised, **numbers)  # type: ignore[arg-type]
    kind, other = found.verdict.kind, _other_end(found)
    wall_s = time.perf_counter() - began
    if table:
        options.outputs.write(_write, found, table, step)
    if plot:
        from ..pictures import plotting
        from ..pictures import simulation as pictures_simulation

        options.outputs.draw(lambda: plotting.save(pictures_simulation.motion(found), plot))
    advice = None if found.status.ok else _advice(found)
    if options.json:
        print(json.dumps(_record(found, other, advice, wall_s)))
    else:
        show(_lines(found, other, wall_s))
    if advice:
        complain("casahunt simulate", advice)
    cut = bool(found.ended) and kind != "growing"
    if cut:
        complain("casahunt simulate", f"the motion was followed only until {found.ended}, not to {length:g} s")
    return 0 if found.status.ok and not cut else 1


def _other_end(found: Trajectory) -> OtherEnd | None:
    """The cycle that a motion which rests has not come to, as far as the work that is allowed leads."""
    try:
        return other_end(found)
    except effort.GivenUp as error:
        return OtherEnd(None, str(error))


def _lines(found: Trajectory, other: OtherEnd | None, wall_s: float) -> Iterator[str]:
    x, verdict, errors = found.end, found.verdict, found.state_errors
    partly = ", but not from every start" if other is not None and other.hunts else ""
    name = f"{found.model} servo{' with stick band' if found.regularised else ''} at gain {found.gain:.10g} V/rad"
    yield f"{name}, set point {found.set_point:.10g} rad, {found.times[-1]:.10g} s: {verdict.kind}{partly}"
    yield f"  because          {verdict.sentence}"
    if other is not None:
        yield f"  other starts     {_elsewhere(other, found.duration)}"
    if verdict.judged:
        swings = ", ".join(to_absolute_error(a, verdict.floor, most=6) for a in verdict.judged)
        since = to_absolute_error(verdict.since, found.time_error, most=6)
        yield f"  judged from      {swings} rad since {since} s; floor {verdict.floor:.1e} rad"
    if math.isfinite(verdict.amplitude):
        count = verdict.swings
        of = "the cycle's: no period agrees yet"
        if count:
            of = f"mean of the last {count} periods" if count > 1 else "of the last period"
        yield f"  amplitude        {to_absolute_error(verdict.amplitude, errors[0], most=10)} rad ({of})"
    if math.isfinite(verdict.period):
        yield f"  period           {to_absolute_error(verdict.period, 2 * found.time_error, most=10)} s"
    end = (found.set_point + x[0], errors[0]), (x[1], errors[1])
    position, velocity = (to_absolute_error(value, error, most=10) for value, error in end)
    yield f"  at the end       position {position} rad, velocity {velocity} rad/s"
    yield f"  events           {_counts(found)}"
    yield (
        f"  error estimate   {error_text(found.time_error)} s of event times, {error_text(found.end_error)} of the "
        "final state"
    )
    yield f"  status           {found.status.name.lower()}, {len(found.modes)} intervals, {wall_s:.2f} s"


def _elsewhere(other: OtherEnd, duration: float) -> str:
    """What a motion from another start could come to; `duration` is that of the one that rests [s]."""
    orbit = other.orbit
    if orbit is None:
        return "at this gain there is no hunting cycle to end in" if other.none else (
            "whether there is a hunting cycle at this gain is not known (casahunt orbit says what was tried)"
        )  # fmt: skip
    amplitude, period = (
        to_error(value, error, most=7)
        for value, error in ((orbit.amplitude, orbit.amplitude_error), (orbit.period, orbit.period_error))
    )
    size = f"{'stable' if orbit.stable else 'symmetric'} cycle of amplitude {amplitude} rad and period {period} s"
    if not other.hunts:
        return f"there is a {size}, but no motion was found that stays beside it"
    left_out = {"time": duration, "integral": 0.0, "velocity": 0.0}
    words = [f"--{key} {value:.12g}" for key, value in other.start.items() if left_out.get(key) != value]
    ends = f"in a {size}" if orbit.stable else f"swinging unevenly beside a {size}, which is not stable"
    return f"let go at rest with {' '.join(words)} it hunts: it ends {ends}"


def _size(key: str, text: Any) -> float:
    return moderate(key, finite(key, text))


def _advice(found: Trajectory) -> str:
    what = f"the event times to {error_text(found.time_error)} s and the final state to {error_text(found.end_error)}"
    if not math.isfinite(found.time_error):
        what = "not even its sequence of events"
    return (
        f"the motion is computed, but not to the tolerance {found.tol:g}: known are {what}; ask for a larger "
        "tolerance or a shorter time"
    )


def _counts(found: Trajectory) -> str:
    names = [event.name for event in found.events]
    listed = ", ".join(f"{names.count(name)} {EVENT_WORDS.get(name, name)}" for name in dict.fromkeys(names))
    return f"{len(names)}{f' ({listed})' if names else ''}"


def _other_record(other: OtherEnd | None) -> dict[str, Any] | None:
    if other is None or other.orbit is None:
        return None
    orbit = other.orbit
    return {
        "amplitude": orbit.amplitude,
        "period": orbit.period,
        "half_multiplier": orbit.half_multiplier if orbit.multipliers.trusted else None,
        "start": other.start or None,
    }


def _record(found: Trajectory, other: OtherEnd | None, advice: str | None, wall_s: float) -> dict[str, Any]:
    x, verdict = found.end, found.verdict
    return {
        "model": found.model,
        "gain": found.gain,
        "set_point": found.set_point,
        "time": float(found.times[-1]),
        "regularised": found.regularised,
        "tol": found.tol,
        "verdict": verdict.kind,
        "reason": verdict.sentence,
        "amplitude": finite_or_none(verdict.amplitude),
        "period": finite_or_none(verdict.period),
        "swings": verdict.swings,
        "judged": {
            "swings": list(verdict.judged),
            "since": finite_or_none(verdict.since),
            "ratios": [finite_or_none(ratio) for ratio in verdict.ratios],
            "limit": finite_or_none(verdict.limit),
            "multiplier": finite_or_none(verdict.multiplier),
            "floor": finite_or_none(verdict.floor),
            "map_motions": verdict.motions,
        },
        "other_end": _other_record(other),
        "other_end_reason": (other.reason or None) if other is not None else None,
        "position": found.set_point + float(x[0]),
        "velocity": float(x[1]),
        "integral": float(x[2]),
        "bristle": float(x[3]) if x.size > 3 else None,
        "events": [[e.time, e.name, e.before, e.after, finite_or_none(e.error)] for e in found.events],
        "time_error": finite_or_none(found.time_error),
        "end_error": finite_or_none(found.end_error),
        "state_errors": [finite_or_none(value) for value in found.state_errors],
        "status": found.status.name.lower(),
        "advice": advice,
        "ended": found.ended or None,
        "intervals": len(found.modes),
        "wall_s": wall_s,
    }


def _write(found: Trajectory, path: Path, step: float | None) -> None:
    """The motion as CSV; numbers in full, so that they read back exactly."""
    if step is None:
        t, x = found.dense()
    else:
        t = np.minimum(np.arange(math.floor(found.times[-1] / step * (1 + 1e-12)) + 1) * step, found.times[-1])
        x = found.sample(t)
    columns = [*COLUMNS[:4], *(["bristle_rad"] if len(x) > 3 else []), *COLUMNS[4:]]
    numbers = np.vstack([t, found.set_point + x[0], x[1:], found.torque(x)]).T
    with whole_text(path) as stream:
        write = csv_table(stream, columns)
        write([*row, mode] for row, mode in zip(numbers.tolist(), found.mode_at(t), strict=True))
