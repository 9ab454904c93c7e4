"""Loops of parts: `EACH` of every kind of scripts/parts.py, of random servos.

Their gain is that of the plain servo, whose amplitude and period, of six digits, place their starts.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from casahunt import InputError, NoOrbit, Options, find_orbit, remedies
from casahunt.servo.parts.verbs import fold_in, loop_cycle, unstable_cycle
from scripts.answers import servos
from scripts.answers.verbs import cure
from scripts.parts import KINDS, TOL, with_part
from scripts.processors import Answer, said, said_of_fold

EACH = 8


def chosen() -> Iterator[tuple[str, int]]:
    """(kind, number of its servo) of all loops; of servos by times."""
    yield from zip(EACH * KINDS, (n for n in range(servos.SERVOS) if n % 3 != 2), strict=False)


def made(kind: str, number: int) -> tuple[Any, Any, dict[str, float], float] | None:
    """(loop, the same by scipy, states at the start, period of the plain servo); None where that does not hunt."""
    subject = servos.random("switch", number)
    known = subject.truths.get("stable")
    try:
        orbit = None if known else find_orbit(subject.servo, "switch", subject.gain)
    except (NoOrbit, InputError):
        return None
    amplitude, period = (
        servos.rounded(known[name][0] if known else getattr(orbit, name), 6) for name in ("amplitude", "period")
    )
    rng = np.random.default_rng([servos.SEED, number, KINDS.index(kind)])
    return *with_part(kind, rng, subject.servo, subject.gain, amplitude, period), period


def cycle(loop: Any, start: dict[str, float]) -> Answer:
    """That on which a motion from rest settles."""
    return said(loop_cycle(loop, start=start, options=Options(tol=TOL)))


def unstable(loop: Any, start: dict[str, float]) -> Answer:
    """That on the other side of the fold."""
    return said(unstable_cycle(loop_cycle(loop, start=start)))


def fold(loop: Any, start: dict[str, float]) -> Answer:
    """Up to which gain it hunts."""
    return said_of_fold(fold_in(loop_cycle(loop, start=start), "gain"))


def remedy(name: str, loop: Any, start: dict[str, float]) -> Answer:
    """The smallest size that ends hunting."""
    return cure(remedies(loop, only=[name]).remedies[0])


def questions(kind: str, number: int) -> Iterator[tuple[str, str, Any, dict[str, Any]]]:
    """(question, kind, how it is asked, truth) of a loop."""
    if (found := made(kind, number)) is None:
        return
    loop, _, start, _ = found
    for name, ask in (("cycle", cycle), ("unstable", unstable), ("fold", fold), ("remedy", partial(remedy, "leak"))):
        truth = servos.known().get(f"loop {kind} {number}") if ask is cycle else None
        yield f"loop, {kind} {number}, {name}", f"loop {name}", partial(ask, loop, start), truth or {}
