"""casahunt simulate: the motion of the closed loop from an initial state.

    start   angles: position - set point; velocity x2, integral x3, bristle x4; any other by its name; else zero

Keys of the JSON object beside those of the motion (`Trajectory.to_dict`): advice, null where it has converged; wall_s;
other_end, where a servo comes to rest: the cycle at the same gain that it has not come to, with start, from which, at
rest, a motion was followed that hunts: position, integral, time and, on the cycle itself, velocity and bristle (null
where none hunts); null without such a cycle, of which other_end_reason says why, and of a loop with other parts.
Those of the loop as built: sampled.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ... import effort
from ...axis_units import shown
from ...checks import error_text, moderate
from ...errors import InputError
from ...servo.drive import DERIVATIVES, DRIVE_KEYS, INTEGRATIONS, SHARES, drive_value
from ...servo.other_end import OtherEnd, other_end
from ...servo.parts.loop import Loop
from ...servo.parts.lugre import LUGRE
from ...servo.parts.plain_loop import loop_asked
from ...servo.parts.table import remedies_for, with_remedy
from ...servo.sampled.plant import DRIVE_PARTS
from ...servo.simulate import simulate
from ...servo.units import assigned, numbers_of
from ..answers.simulate import simulation_answer
from .arguments import Asked, add_command, finite, positive
from .console import complain
from .output import give
from .price_options import PROFILE, add_profile, move_of
from .sampled import REMEDIES, of_drive

OF_DRIVE_ALONE = tuple(key for key in DRIVE_KEYS if key not in (*DRIVE_PARTS.values(), *SHARES, "sample_time"))
"""Keys that mean nothing to the continuous loop."""
START_UNITS = {
    "set_point": "rad", "position": "rad", "velocity": "rad/s", "integral": "rad s", "bristle": "rad", "tol": "",
}  # fmt: skip
"""Numbers of the command line, and their units."""
MOST_ROWS = 10_000_000
"""Of a table: a gigabyte, of which nobody reads more."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "the motion from an initial state"
    command = add_command(commands, "simulate", about, gain=True, model="", csv="the motion", plot="the motion")
    command.add_argument("--set-point", help="theta_d in rad (default 1 rad, or one unit of length)")
    command.add_argument("--time", default=100.0, help="length of the motion in s (default 100)")
    command.add_argument("--position", default=0.0, help="position theta at the start in rad (default 0)")
    command.add_argument("--velocity", default=0.0, help="velocity at the start in rad/s (default 0)")
    command.add_argument("--integral", default=0.0, help="integral of theta - theta_d so far in rad s (default 0)")
    command.add_argument("--bristle", default=0.0, help="bristle deflection at the start in rad (lugre, default 0)")
    command.add_argument(
        "--state", action="append", default=[], metavar="NAME=VALUE", help="any other state of the loop at the start"
    )
    add_profile(command)
    command.add_argument("--step", help="time step of the CSV file in s (default: dense where the motion is fast)")
    # The options of the drive as built; each is called like its key in the table [drive]
    group = command.add_argument_group("the loop as built (docs/howto/as_built.md)")
    group.add_argument("--sample-time", metavar="S", help="of the controller in s; 0: the continuous loop")
    group.add_argument("--delay", metavar="S", help="from a sample to its torque in s (default 0)")
    group.add_argument("--encoder", metavar="COUNTS", help="per revolution (default: the position is read exactly)")
    group.add_argument("--noise", metavar="RAD", help="standard deviation of the reading (default: none)")
    group.add_argument("--seed", metavar="N", help="which noise, a whole number (default 0)")
    group.add_argument("--quantise-torque", metavar="NM", help="step of the torque in N m (default: none)")
    group.add_argument("--derivative", metavar="WAY", help=f"{' (default) or '.join(DERIVATIVES)}")
    group.add_argument("--filter-time", metavar="S", help="of the filtered derivative in s (default kd/kp/10)")
    group.add_argument("--integration", metavar="RULE", help=f"{' (default) or '.join(INTEGRATIONS)}")
    group.add_argument("--dead-band", metavar="RAD", help="error up to which nothing is integrated (default 0)")
    group.add_argument("--leak", metavar="RATE", help="at which the integral is forgotten in 1/s (default 0)")
    for key, (metavar, about) in REMEDIES.items():
        group.add_argument(f"--{key.replace('_', '-')}", metavar=metavar, help=about)


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    asked: Any = options.subject(gain=True)
    length = positive("time", options.time, "s")
    numbers: dict[str, Any] = {
        key: moderate(name := key.replace("_", "-"), finite(name, text, unit))
        for key, unit in START_UNITS.items()
        if (text := getattr(options, key)) is not None
    }
    step = None if options.step is None else positive("step", options.step, "s")
    if step is not None and options.csv is None:
        raise InputError("step: must be left out without --csv")
    if step is not None and length / step > MOST_ROWS:
        raise InputError(f"step = {step:g}: must be at least {length / MOST_ROWS:g} s, for {MOST_ROWS} rows at most")
    remedies = remedies_given(options)
    drive = options.drive(by_options=True)
    loop = with_remedies(loop_asked(*asked), remedies)
    numbers["start"] = numbers_of(assigned(options.state, "state", loop.system.states, "name=value"), loop.units)
    if drive is not None:
        options.leave_out("moves by a profile are those of the continuous loop", *PROFILE)
        return of_drive(options, loop, drive, length, numbers)
    found = simulate(loop, time=length, move=move_of(options), **numbers)
    kind = found.verdict.kind
    try:
        other = other_end(found)
    except effort.GivenUp as error:
        other = OtherEnd(None, str(error))
    wall_s = options.outputs.seconds
    sure = found.status.ok or kind == "growing"  # as what errors are relative to, they grow with it
    known = f"the event times to {error_text(found.time_error)} s and the final state to {error_text(found.end_error)}"
    known = known if math.isfinite(found.time_error) else "not even its sequence of events"
    advice = None if sure else (
        f"the motion is computed, but not to the tolerance {found.tol:g}: known are {known}; ask for a larger "
        "tolerance or a shorter time"
    )  # fmt: skip
    record = {**found.to_dict(table=False), "other_end": None, "other_end_reason": (other and other.reason) or None}
    if other is not None and other.orbit is not None:
        record["other_end"] = {**other.orbit.to_dict(table=False), "start": other.start or None}
    record |= {"advice": advice, "wall_s": wall_s}
    answer, picture = simulation_answer(found, other, wall_s), ("simulation.motion", found)
    times = None  # dense where the motion is fast
    if step is not None:
        times = np.minimum(np.arange(math.floor(found.times[-1] / step * (1 + 1e-12)) + 1) * step, found.times[-1])
    give(options, record, answer, table=found.table(times) if options.csv else None, picture=picture)
    if advice:
        complain("casahunt simulate", advice)
    cut = bool(found.ended) and kind != "growing"
    if cut:
        complain("casahunt simulate", f"the motion was followed only until {found.ended}, not to {length:g} s")
    return 0 if sure and not cut else 1


def remedies_given(options: Asked) -> dict[str, float]:
    """The remedies of the options where they are asked of the continuous loop: numbers by key; {} without any.

    What is returned is taken out of the options. Raises InputError: one is no number, or there is something beside it
    that only the loop as built has.
    """
    given = {key: text for key in (*DRIVE_PARTS.values(), *SHARES) if (text := getattr(options, key)) is not None}
    if options.sample_time is None and (not given or options.drive() is not None):
        return {}
    if options.sample_time is not None and finite("sample-time", options.sample_time, "s") != 0:
        return {}
    why = "it is of the loop as built, and without a sample time the loop is a continuous one"
    options.leave_out(why, *OF_DRIVE_ALONE)
    numbers = {key: finite(key.replace("_", "-"), drive_value(key, text, shown())) for key, text in given.items()}
    for key in given:
        setattr(options, key, None)
    return numbers


def with_remedies(loop: Loop, given: Mapping[str, float]) -> Loop:
    """The continuous loop with remedies; given: as of `remedies_given`.  Raises InputError: one does not go with it."""
    there = remedies_for("lugre" if LUGRE in loop.present else "switch")
    for key, of in SHARES.items():
        if key in given and of not in given:
            raise InputError(f"{key.replace('_', '-')}: must be left out without {of.replace('_', '-')}")
    for name, key in DRIVE_PARTS.items():
        if key in given:
            if name not in there:
                only = "in the continuous loop it goes with Switch friction alone"
                raise InputError(f"{key.replace('_', '-')}: must be left out, {only}")
            loop = with_remedy(loop, there[name], given[key])
    return loop.replace(**{key: given[key] for key in SHARES if key in given})
