"""From records of random servos to a remedy: does `casahunt cure` end with one that works in the servo that made them?

    python scripts/cure.py [--first I] [--count N] [--seed S] [--only I ...] [--counts LOW HIGH] [--remedies NAME,...]

The servos, their records and the wrong values to start from are those of scripts/identify.py.  A record goes as a file
through the command `casahunt cure`; then the true servo gets the remedy that the command names, of the size that it
says, and is followed by a program that shares nothing with the one that fitted (scripts/peers/remedy_motion.py, needs
heyoka): from the hunting motion, from starts beside the set point and from the edges of the remedy.  LuGre servos are
followed by scripts/peers/hunting_record.py, for 40 periods from 0.3, 1 and 3 amplitudes; it has a dead band, a leak and
the numbers of the controller, and what still decays then is taken for one that comes to rest.

    works       no motion hunts
    hunts       one does: the remedy is none
    unclear     a motion whose swings neither repeat nor come to rest, or that stood still and broke away once
    no remedy   the command names none, or says that the model does not explain its own record
    refused     the command has no answer
    too slow    or none within `TIME_LIMIT`

and the same of every other row of its table that is said to end hunting, as "rows".  Prints a line per servo and the
sums, the servos that do not work by name; exit code 1 where fewer than `WANTED` of them work.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, find_orbit  # noqa: E402
from casahunt.cli import main as casahunt  # noqa: E402
from casahunt.servo.friction import Model  # noqa: E402
from casahunt.servo.outcome import SETTLES  # noqa: E402
from casahunt.servo.servo import flatten  # noqa: E402
from scripts.identify import Made  # noqa: E402
from scripts.limits import TooSlow, within  # noqa: E402
from scripts.peers.hunting_record import remedied  # noqa: E402
from scripts.remedies import truth  # noqa: E402

REMEDIES = "dead band,leak,derivative,integral"
"""That are looked at where nothing else is said: a dead band, a leak and the plain numbers of the controller."""
WANTED, TIME_LIMIT = 0.95, 600.0
"""Share that is to work; processor time of an answer [s]."""
STARTS, PERIODS, SAMPLES, LATE = (0.3, 1.0, 3.0), 40, 100, 10
"""Of a LuGre motion: where it starts, in amplitudes, its periods, samples in each, and those that are late."""
WITH_BRISTLE = {"leak": "leak", "dead band": "band"}
"""Remedies of a LuGre servo that are parts of their own, by the argument of `remedied`."""
STANDS, SMALLER, BROKEN_AWAY = 0.01, 0.9, 10.0
"""Part of its start within which one stays that rests; of its reach before, below which it falls, and above which it
has stood still until then."""


def cured(made: Made, model: str, remedies: str) -> tuple[int, dict[str, Any], str]:
    """The exit code of `casahunt cure` on a record, its JSON object ({} without), and what it complains."""
    with tempfile.TemporaryDirectory() as folder:
        record = Path(folder, "record.csv")
        rows = np.column_stack([made.record.times, made.record.position])
        np.savetxt(record, rows, "%.17g", ",", header="time_s,position_rad", comments="")
        sets = [word for key, value in flatten(made.starts[0]).items() for word in ("--set", f"{key}={value!r}")]
        out, err = io.StringIO(), io.StringIO()
        with redirect_stdout(out), redirect_stderr(err):
            code = casahunt(["cure", str(record), "--gain", repr(made.gain), "--model", model, "--only", remedies,
                             "--json", "--quiet", *sets])  # fmt: skip
    text = out.getvalue()
    return code, json.loads(text) if text.strip() else {}, err.getvalue().strip()


def followed(made: Made, model: Model, name: str, size: float) -> tuple[str, str]:
    """What the true servo does with a remedy, and what was seen."""
    cycle = find_orbit(made.servo, model, made.gain)
    if model != "switch":
        said = [_with_bristle(made, name, size, start * cycle.amplitude, cycle.period) for start in STARTS]
        return next((one for one in ("hunts", "unclear") if one in said), "works"), str(dict(Counter(said)))
    motion = truth(made.servo, made.gain, name, size, cycle)
    hunts, said = motion.hunts(motion.at_brink(1.0))
    return {True: "hunts", False: "works", None: "unclear"}[hunts], str(dict(Counter(said)))


def _with_bristle(made: Made, name: str, size: float, start: float, period: float) -> str:
    """What a motion of the LuGre servo does that begins stuck at -start: its reach in windows as long as a period."""
    pid, gain, parts = made.servo.controller.pid(), made.gain, dict[str, float]()
    if name == "integral":
        period *= pid.ki / size  # it winds up so much more slowly
        pid = replace(pid, ki=size)
    elif name == "derivative":
        pid = replace(pid, kd=size)
    elif name == "gain":
        gain = size
    else:
        parts = {WITH_BRISTLE[name]: size}
    times = np.linspace(0.0, PERIODS * period, PERIODS * SAMPLES)
    x = remedied(replace(made.servo, controller=pid), gain, start, times, **parts)
    reach = np.ptp(x.reshape(PERIODS, SAMPLES), axis=1)
    late, before = reach[-LATE:].max(), reach[-2 * LATE : -LATE].max()
    if late < STANDS * start:
        return "rests"
    return "decays" if late < SMALLER * before else "hunts" if late < BROKEN_AWAY * before else "unclear"


def checked(made: Made, model: Model, remedies: str) -> tuple[str, str, Counter[str]]:
    """(outcome, what was seen, outcomes of all rows)."""
    rows, began = Counter[str](), time.process_time()
    try:
        with within(TIME_LIMIT):
            code, found, complaint = cured(made, model, remedies)
    except TooSlow:
        return "too slow", f"no answer within {TIME_LIMIT:g} s", rows
    complaint = f"{complaint} answer after {time.process_time() - began:.1f} s"
    if not found:
        return "refused", f"exit {code}: {complaint}", rows
    table = found["remedies"]
    best, outcome, seen, others = table["best"], "no remedy", complaint, ""
    for row in table["remedies"]:
        if row["kind"] in ("none", "not found", "does not fit") or row["stays"][0] not in SETTLES:
            continue
        did, how = followed(made, model, row["name"], row["recommended"])
        rows[did] += 1
        sizes = [f"{row[key] or math.nan:.4g}" for key in ("recommended", "worst_size", "size")]
        text = f"{row['name']} {sizes[0]} (worst {sizes[1]}, as found {sizes[2]})"
        if row["name"] == best:
            outcome, seen = did, f"{text}: {how} {complaint}"
        elif did != "works":
            others += f"; [{text}: {did} {how}]"
    return outcome, seen + others, rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; returns 1 where too few work."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0, help="number of the first servo")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--model", default="switch")
    parser.add_argument("--only", type=int, nargs="+")
    parser.add_argument("--counts", type=float, nargs=2, default=(2000.0, 20000.0))
    parser.add_argument("--remedies", default=REMEDIES)
    options = parser.parse_args(arguments)
    others = {name.strip() for name in options.remedies.split(",")} - {*WITH_BRISTLE, "integral", "derivative", "gain"}
    if options.model != "switch" and others:
        parser.error(f"a LuGre servo is not followed with {', '.join(sorted(others))}")
    sums, every, named = Counter[str](), Counter[str](), list[str]()
    for number in options.only or range(options.first, options.first + options.count):
        try:
            made = Made(number, options.seed, options.model, tuple(options.counts))
        except NoOrbit as error:
            print(f"{number:4d} no record: {error}"[:150], flush=True)
            continue
        outcome, seen, rows = checked(made, options.model, options.remedies)
        sums[outcome] += 1
        every += rows
        if outcome != "works":
            named.append(f"{number} {outcome}: {seen}")
        print(f"{number:4d} {outcome}: {seen}", flush=True)
    print("\n".join(named))
    print(f"{dict(sums)} of {sums.total()} servos; rows: {dict(every)}")
    return int(sums["works"] < WANTED * sums.total())


if __name__ == "__main__":
    sys.exit(main())
