"""Folds and cycles of a Switch servo found by its event map alone, without the program's help.

    P(a) = a on either side of the largest P(a)/a, whose place is followed from the fold down to the gain

The map is that of switch_digits.py; with heyoka (extra `bench`) and multipliers below 1e7 that of switch_long.py, a
hundred times faster.
"""

from __future__ import annotations

import importlib.util
import math
from decimal import Decimal
from typing import Any

import numpy as np

from casahunt import Servo
from casahunt.servo.gains import routh_hurwitz_gain
from scripts.peers import switch_digits as digits
from scripts.peers.switch_long import STEEPEST, LongMap

HEYOKA = importlib.util.find_spec("heyoka") is not None
ROUGH: type[digits.SwitchMap] = LongMap if HEYOKA else digits.SwitchMap
"""The Switch engine for searches, and for cycles with multipliers up to STEEPEST."""
ROUGH_DIGITS = 18
"""For the search of cycles that the program denies."""
NARROW_FOLD = 1e3
"""Half multiplier at a located fold, where it should be 1, that tells of a fold too narrow for a quick engine."""
SMALLEST, LARGEST = Decimal("1e-5"), Decimal("1e3")
"""Amplitudes up to which it looks, in units of the place of the largest P(a)/a."""
NARROW = Decimal("1e-3")
"""Relative width of a bracket from which Newton takes over."""
WAY_DOWN = (0.9999, 0.9995, 0.999, 0.997, 0.995, 0.98, 0.95, 0.88, 0.75, 0.6, 0.5, 0.35, 0.24, 0.16, 0.11, 0.075, 0.05)
"""Shares of the fold gain at which the engine's own search halts on its way to lower gains."""


class SwitchTruth:
    """Folds and cycles of one Switch servo by its event map in decimal arithmetic; each is computed once."""

    patient = True
    """Whether multipliers above STEEPEST, for which decimal arithmetic takes minutes, are checked with it."""

    def __init__(self, servo: Servo) -> None:
        self.servo = servo
        self.top: digits.Truth | None = None
        self.places: dict[float, Decimal] = {}

    def fold(self, found: Any) -> digits.Truth | None:
        """The fold next to the program's; where that has none, one of the engine's own search."""
        if found is not None and not self.patient and abs(found.orbit.half_multiplier) > NARROW_FOLD:
            return None
        if found is not None:
            try:
                self.top = digits.fold(self.servo, found.gain, abs(float(found.orbit.arcs[-1].end[0])))
            except (digits.Lost, ArithmeticError):
                self.top = None
        return self.top

    def hunts_somewhere(self) -> tuple[float, float] | None:
        """(gain, a) with P(a) > a and P < a beyond, of the highest gain on a coarse grid; None if there is none."""
        base = routh_hurwitz_gain(self.servo)
        if not math.isfinite(base) or base <= 0:
            _, _, slow = digits.shape(self.servo, float)  # 1/tau_i
            base = self.servo.inertia * slow**2 / self.servo.motor_gain
        for gain in base * 2.0 ** np.arange(8, -9, -1):
            unit = self.servo.friction.static / self.servo.torque_gains(gain)[0]
            outside = False
            for a in unit * np.geomspace(20, 1e-4, 40):
                ratio = self._ratio(gain, Decimal(float(a)))
                outside = outside or ratio < 1
                if outside and ratio > 1:
                    return float(gain), float(a)
        return None

    def _ratio(self, gain: float, a: Decimal) -> Decimal:
        """P(a)/a; 1 where the motion does not get to a stick, which says neither."""
        try:
            return ROUGH(self.servo, gain, ROUGH_DIGITS).half(a).position / a
        except (digits.Lost, ArithmeticError):
            return Decimal(1)

    def next_to(self, found: Any) -> digits.Truth | None:
        """The fixed point next to an orbit of the program."""
        try:
            place = abs(float(found.arcs[-1].end[0]))
            if HEYOKA and abs(found.half_multiplier) < STEEPEST:
                return LongMap(self.servo, found.gain).cycle(place, error=max(found.error_estimate, 1e-13))
            if not self.patient:
                return None
            # A multiplier of 1e18 takes 18 digits of the place for the first one of P(a).
            more = max(0, math.ceil(math.log10(max(abs(found.half_multiplier), 1.0))))
            the_map = digits.SwitchMap(self.servo, found.gain, digits.DIGITS + more)
            return the_map.cycle(place, error=max(found.error_estimate, 1e-15))
        except (digits.Lost, ArithmeticError):
            return None

    def own(self, gain: float, branch: str) -> digits.Truth | None:
        """The cycle found without the program's help: from the largest P(a)/a outwards; None where it is not met."""
        place = self._largest(gain)
        if place is None or self._ratio(gain, place) <= 1:
            return None
        # Away from the fold the two cycles lie to either side of the place; steps that grow.
        up = 1 if branch == "stable" else -1
        inside, step = place, Decimal("1e-6")
        while SMALLEST < inside / place < LARGEST:
            outside = inside * (1 + step) ** up
            if self._ratio(gain, outside) < 1:
                break
            inside, step = outside, min(step * 3, Decimal("0.4"))
        else:
            return None
        while abs(outside / inside - 1) > NARROW:
            middle = (inside * outside).sqrt()
            if self._ratio(gain, middle) < 1:
                outside = middle
            else:
                inside = middle
        try:
            return ROUGH(self.servo, gain).cycle((inside * outside).sqrt(), error=float(NARROW) / 6)
        except (digits.Lost, ArithmeticError):
            return None

    def _largest(self, gain: float) -> Decimal | None:
        """The place of the largest P(a)/a at a gain, followed from the fold."""
        if self.top is None:
            return None
        share = gain / float(self.top.gain)
        if share >= 1:
            return None
        place = self.top.a
        for halt in (*[s for s in WAY_DOWN if s > share], share):
            if halt not in self.places:
                self.places[halt] = self._climb(float(self.top.gain) * halt, place)
            place = self.places[halt]
        return place

    def _climb(self, gain: float, a: Decimal) -> Decimal:
        """The nearby maximum of P(a)/a, by the sign of its slope: a P' - P."""
        the_map = ROUGH(self.servo, gain, ROUGH_DIGITS)

        def rises(a: Decimal) -> bool:
            half = the_map.half(a)
            return a * half.slope > half.position

        try:
            up = rises(a)
            step, last = Decimal("1e-5"), a
            for _ in range(60):
                if self._ratio(gain, a) > 1:
                    return a  # anywhere above 1 will do
                a = last * (1 + step) ** (1 if up else -1)
                if rises(a) != up:
                    break
                last, step = a, step * Decimal("1.6")
            low, high = min(a, last), max(a, last)
            for _ in range(40):
                middle = (low * high).sqrt()
                if self._ratio(gain, middle) > 1:
                    return middle
                low, high = (middle, high) if rises(middle) else (low, middle)
            return (low * high).sqrt()
        except (digits.Lost, ArithmeticError):
            return a
