"""Folds and cycles of a LuGre servo by Taylor series in extended or quadruple precision (lugre_digits.py; heyoka).

A refused cycle is sought by following its branch from the next gain at which the program found one.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import numpy as np

from casahunt import Servo
from scripts.peers import lugre_digits
from scripts.peers import switch_digits as digits
from scripts.peers.switch_search import SwitchTruth

BLURRED = 0.1
"""Rounding of the engine, in units of the error estimate to be judged, that more digits are taken for."""


class LugreTruth:
    """Folds and cycles of one LuGre servo by Taylor series."""

    def __init__(self, servo: Servo) -> None:
        self.servo = servo
        self.patient = True
        self.top: digits.Truth | None = None
        self.seen: list[tuple[float, str, Any, float]] = []

    def fold(self, found: Any) -> digits.Truth | None:
        """The fold next to the program's."""
        if found is not None:
            orbit = found.orbit
            try:
                self.top = lugre_digits.fold(self.servo, found.gain, orbit.arcs[0].states[0, 0][1:], orbit.period / 2)
            except (digits.Lost, np.linalg.LinAlgError):
                self.top = None
        return self.top

    def hunts_somewhere(self) -> Any:
        """What the Switch servo with the same curve does: LuGre's neighbour, no proof."""
        return SwitchTruth(self.servo).hunts_somewhere()

    def next_to(self, found: Any) -> digits.Truth | None:
        """The cycle next to an orbit of the program; in quadruple precision where rounding would blur the judgement."""
        start = found.arcs[0].states[0, 0][1:]
        truth = None
        for precision in (lugre_digits.EXTENDED, lugre_digits.quadruple()):
            with suppress(digits.Lost, np.linalg.LinAlgError):
                truth, y = lugre_digits.cycle(self.servo, found.gain, start, found.period / 2, precision)
            if truth is not None and truth.noise <= BLURRED * found.error_estimate:
                break
        if truth is None:
            return None
        self.seen.append((found.gain, "unstable" if truth.mu > 1 else "stable", y, found.period / 2))
        return truth

    def own(self, gain: float, branch: str) -> digits.Truth | None:
        """The cycle followed by the engine itself from the next gain at which it knows one; None where it is lost."""
        known = [s for s in self.seen if s[1] == branch]
        if not known:
            return None
        at, _, y, half_period = min(known, key=lambda s: abs(math.log(s[0] / gain)))
        factor, truth = 1.02, None
        while at != gain:
            target = min(gain, at * factor) if gain > at else max(gain, at / factor)
            try:
                truth, y = lugre_digits.cycle(self.servo, target, y, half_period)
                at, half_period, factor = target, float(truth.period) / 2, 1 + 1.5 * (factor - 1)
            except (digits.Lost, np.linalg.LinAlgError):
                factor = 1 + 0.3 * (factor - 1)
                if factor < 1 + 1e-6:
                    return None
        if truth is not None and (truth.mu > 1) == (branch == "unstable"):
            return truth
        return None
