"""What is asked of a servo: a function each, from a `Subject` to an `Answer`.  Whoever renames a verb, renames it here.

The numbers of a question follow from the subject's, never from another answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from casahunt import (
    Drive,
    Uncertainty,
    as_built,
    basin,
    diagram,
    find_fold,
    find_orbit,
    margins,
    remedies,
    sample_fold_gains,
    simulate,
    tune,
    with_lopsided,
    worst_corner,
)  # fmt: skip
from scripts import tuning
from scripts.answers.servos import MODELS, Subject, rounded
from scripts.processors import Answer, said, said_of_branch, said_of_fold
from scripts.remedies import LOOKED_AT

TOL = 1e-6
ROUNDED, FOLLOWED, CHOSEN = 1e-9, 1e-4, 1e-3
"""Relative errors of numbers that come without one: of closed forms, of timed motions, of searches that choose."""
STARTS = (0.3, 3.0)
"""Of a motion from rest, in Fs/kp."""
TIMES_OF_RESET, SAMPLES_OF_LOOP, COUNTS = 60.0, 0.02, 20.0
"""Length of a motion in kp/ki; sample time in 1/omega, omega^2 = kp/J; counts of an encoder in Fs/kp."""
UNCERTAIN, WIDTH, SAMPLES = ("friction.static", "servo.inertia"), 0.03, 30
ENDS = ("low", "high")


def answer(words: dict[str, Any], **numbers: tuple[Any, float]) -> Answer:
    """(value, relative error) of numbers; those that are none go to the words."""
    none = [name for name, (value, _) in numbers.items() if value is None or not math.isfinite(value)]
    known = {name: [float(v), abs(float(v)) * error] for name, (v, error) in numbers.items() if name not in none}
    return {"words": {"status": "answered", **words, **dict.fromkeys(none, "no number")}, "numbers": known}


def cycle(branch: Any, s: Subject) -> Answer:
    return said(find_orbit(s.servo, s.model, s.gain, branch=branch))


def fold(s: Subject) -> Answer:
    return said_of_fold(find_fold(s.servo, s.model))


def branch(s: Subject) -> Answer:
    return said_of_branch(diagram(s.servo, s.model), TOL)


def lopsided(s: Subject) -> Answer:
    pairs = with_lopsided(diagram(s.servo, s.model)).lopsided
    told = [said_of_branch(pair, TOL) for pair in pairs]
    numbers = {f"pair {k + 1}: {name}": n for k, one in enumerate(told) for name, n in one["numbers"].items()}
    return {"words": {"status": "answered", "points": [one["words"] for one in told]}, "numbers": numbers}


def motion(start: float, s: Subject) -> Answer:
    kp, _, ki = s.torque_gains()
    away, time = start * s.servo.friction.static / kp, TIMES_OF_RESET * kp / ki
    verdict = simulate(s.servo, s.model, s.gain, set_point=0.0, position=-rounded(away), time=rounded(time)).verdict
    hunts = verdict.kind == "hunting"
    more = {"amplitude": (verdict.amplitude, FOLLOWED), "period": (verdict.period, FOLLOWED)} if hunts else {}
    return answer({"verdict": verdict.kind}, **more)


def border(s: Subject) -> Answer:
    found = basin(s.servo, s.model, s.gain)
    return answer({"confirmed": found.confirmed}, border=(found.border, found.error_estimate),
                  outer=(found.outer.amplitude if found.outer else None, TOL))  # fmt: skip


def loop_margins(s: Subject) -> Answer:
    kp, kd, _ = s.torque_gains()
    found = margins(s.servo, s.gain, delay=rounded(0.01 * kd / kp))
    return answer({"stable": found.stable}, **{
        name: (getattr(found, name), ROUNDED)
        for name in ("phase_margin", "frequency", "lowest_factor", "highest_factor")
    })  # fmt: skip


def remedy(name: str, s: Subject) -> Answer:
    return cure(remedies(s.servo, s.model, s.gain, only=[name]).remedies[0])


def cure(row: Any) -> Answer:
    """A row of the table of remedies."""
    words = {"verdict": row.kind, "ends": row.ends_hunting, "stays": list(row.stays)}
    error = row.size_error / abs(row.size) if row.size else math.nan
    known = error if math.isfinite(error) else CHOSEN
    return answer(words, size=(row.size, known), recommended=(row.recommended, known),
                  rest_error=(row.recommended_rest_error, CHOSEN), torque=(row.peak_torque, CHOSEN))  # fmt: skip


def built(s: Subject) -> Answer:
    kp, _, _ = s.torque_gains()
    count = s.servo.friction.static / kp / COUNTS
    drive = Drive(sample_time=rounded(SAMPLES_OF_LOOP * math.sqrt(s.servo.inertia / kp)),
                  encoder=rounded(2 * math.pi / count))  # fmt: skip
    found = as_built(s.servo, s.gain, drive)
    return answer({"verdict": found.kind}, dead_band=(found.dead_band, CHOSEN))


def uncertain(s: Subject) -> Uncertainty:
    """The set of a servo."""
    values = {"friction.static": s.servo.friction.static, "servo.inertia": s.servo.inertia}
    return Uncertainty({name: (rounded(v * (1 - WIDTH)), rounded(v * (1 + WIDTH))) for name, v in values.items()})


def corner(s: Subject) -> Answer:
    box = uncertain(s)
    found = worst_corner(s.servo, s.model, box)
    ends = [f"{name} {ENDS[value > sum(box.intervals[name]) / 2]}" for name, value in found.corner.items()]
    return answer({"corner": ends, "failures": len(found.failures)}, gain=(found.gain, found.fold.gain_error))


def samples(s: Subject) -> Answer:
    found = sample_fold_gains(s.servo, s.model, uncertain(s), SAMPLES, seed=0)
    gains = found.gains[np.isfinite(found.gains)]
    return answer({"hunt": int(gains.size), "failures": len(found.failures)}, **{
        name: (of(gains) if gains.size else None, TOL)
        for name, of in (("least", np.min), ("mean", np.mean), ("largest", np.max))
    })  # fmt: skip


def tuned(number: int) -> Answer:
    """A task of scripts/tuning.py."""
    servo, arguments = tuning.random_task(number)
    found = tune(servo, "switch", **arguments)
    words = {"binding": list(found.binding), "verified": bool(found.verification.ok)}
    return answer(words, gain=(found.gain, CHOSEN), cost=(found.cost_value, CHOSEN))


class Verb(NamedTuple):
    """What is asked; of every which servo of each model (in the order of `MODELS`; 0: of none); whether at its gain."""

    name: str
    ask: Callable[[Subject], Answer]
    every: tuple[int, int]
    at_gain: bool = True


VERBS = (
    Verb("fold", fold, (1, 1), False),
    *(Verb(name, partial(cycle, name), (1, 2)) for name in ("stable", "unstable")),
    Verb("diagram", branch, (3, 12), False),
    Verb("lopsided", lopsided, (15, 0), False),
    *(Verb(f"motion from {start:g}", partial(motion, start), (1, 3)) for start in STARTS),
    Verb("basin", border, (1, 6)),
    Verb("margins", loop_margins, (1, 0)),
    Verb("as built", built, (8, 0)),
    Verb("worst corner", corner, (10, 15), False),
    Verb("samples", samples, (3, 15), False),
    *(Verb(f"remedy {name}", partial(remedy, name), (20, 0)) for name in LOOKED_AT),
)
OFTEN = 6
"""What is asked of every sixth servo or more is asked of Table 1 at all its gains; the rest at the first."""


def asked_of(model: str, number: int | None, gains_before: int = 0) -> Iterator[Verb]:
    """What is asked of servo n, the verbs that are not asked of all each of others; of Table 1 (None) by its gains."""
    for k, verb in enumerate(VERBS):
        every = verb.every[MODELS.index(model)]
        if number is None:
            if every and (not gains_before or (verb.at_gain and every <= OFTEN)):
                yield verb
        elif every and (number - k) % every == 0:
            yield verb
