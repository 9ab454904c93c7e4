"""Which servos are asked, and at which gains.

Servo n is drawn as in scripts/random_servos.py, every third by kp, ki and kd.  Its gain is a share of its fold gain
between `SHARES`, computed once (scripts/peers/corpus_truths.py) and kept: the question stays the same.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from casahunt import NoOrbit, Servo, effort, find_fold
from problems.table1 import REFERENCE
from scripts.history import WORK
from scripts.random_servos import draw

SERVOS, SEED = 300, 39
MODELS = ("switch", "lugre")
SHARES = (0.05, 0.95)
TRUTHS = Path(__file__).with_name("truths.json")
"""{"switch 12": {"gain": K, "fold": {"gain": [value, error], ...}, "stable": ..., "unstable": ...}}; loops besides."""
TABLE1_GAINS = (0.04, 0.1, 0.4, 0.6)


class Subject(NamedTuple):
    """A servo by its numbers, as its file has them; {} is Table 1."""

    name: str
    model: Any
    parameters: dict[str, float]
    gain: float
    truths: dict[str, Any]

    @property
    def servo(self) -> Servo:
        """As the package wants it."""
        return Servo().replace(**self.parameters)

    def torque_gains(self) -> tuple[float, float, float]:
        """(kp, kd, ki) at its gain."""
        return self.servo.torque_gains(self.gain)


def share(number: int) -> float:
    """The part of its fold gain at which servo n is asked."""
    low, high = np.log(SHARES)
    return float(np.exp(np.random.default_rng([SEED, number, 1]).uniform(low, high)))


def rounded(value: float, digits: int = 4) -> float:
    """So many digits of a number."""
    return float(f"{value:.{digits}g}")


def parameters(number: int) -> dict[str, float]:
    """Those of servo n."""
    return draw(SEED, number, "pid" if number % 3 == 2 else "times")


def drawn(number: int) -> Servo:
    """Servo n."""
    return Servo().replace(**parameters(number))


@cache
def known() -> dict[str, Any]:
    """What is kept of gains and truths."""
    found: dict[str, Any] = json.loads(TRUTHS.read_text(encoding="ascii"))
    return found


def table1(model: str) -> Iterator[Subject]:
    """The servo of Table 1 at some gains."""
    for gain in TABLE1_GAINS:
        truths = {"fold": {name.replace("K", "gain"): [v, 1e-9 * v] for name, v in REFERENCE[model]["fold"].items()}}
        for branch in ("stable", "unstable"):
            for row in REFERENCE[model][branch]:
                if row["K"] == gain:
                    truths[branch] = {name: [row[name], 1e-12 * row[name]] for name in ("amplitude", "period")}
        yield Subject(f"{model} Table 1", model, {}, gain, truths)


def random(model: Any, number: int) -> Subject:
    """Servo n at its gain; at 0 where it has no fold.  A gain that is not kept is a share of the fold found now."""
    row = known().get(f"{model} {number}", {})
    gain = row.get("gain", 0.0)
    if not gain:
        with suppress(NoOrbit, effort.GivenUp), effort.counting_work(None, limit=WORK):
            gain = rounded(share(number) * find_fold(drawn(number), model).gain)
    return Subject(f"{model} servo {number}", model, parameters(number), gain, row)
