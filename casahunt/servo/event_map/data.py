"""What a scan of the event map has seen, as data: its fixed points P(a) = a, mu = P'(a), and where P jumps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ...axis_units import Units, carried, quantity, several
from ...export import Columns, columns_from
from ...results import Result
from ..servo import Servo
from .slopes import MapPoint

CSV_COLUMNS = (
    "kind", "stick_position_rad", "stick_position_error_rad", "half_multiplier", "period_s", "period_error_s", "stable",
    "next_below_rad", "next_above_rad",
)  # fmt: skip
"""Of the table of fixed points and jumps; the last two: where the servo sticks next on the two sides of a jump."""


@dataclass(frozen=True, eq=False, repr=False)
class FixedPoint(Result):
    """P(a) = a: a symmetric hunting cycle.

    Attributes
    ----------
    amplitude : a [rad].
    multiplier : mu = P'(a).
    period : [s].
    error : estimated relative error of the amplitude.
    period_error : of the period: |dT/da| times the rounding of a, many times that of a on steep pieces.
    units : in which its numbers are shown.
    """

    _quantities = (
        "amplitude [rad] ~ error", "half_multiplier = multiplier", "period [s] ~ period_error", "stable",
    )  # fmt: skip
    _details = ("error_estimate = error",)

    amplitude: float
    multiplier: float
    period: float
    error: float
    period_error: float
    units: Units = carried()

    @property
    def stable(self) -> bool:
        """|mu| < 1."""
        return abs(self.multiplier) < 1


@dataclass(frozen=True)
class Jump:
    """A discontinuity of P between two neighbouring stick positions.

    Attributes
    ----------
    start : a [rad].
    below, above : P just below and just above a [rad]; nan where the servo swings on without stick.
    crosses : P - a has different signs on the two sides: no fixed point, although a scan sees a change of sign.
    """

    start: float
    below: float
    above: float
    crosses: bool


@dataclass(frozen=True, eq=False, repr=False)
class FixedPoints(Result):
    """Everything that a scan of the event map saw.

    Attributes
    ----------
    servo, gain, low, high : the problem, and the range of stick positions [rad].
    points : the motions computed, by increasing a.
    fixed : the fixed points, by increasing amplitude.
    jumps : the discontinuities met, by increasing a.
    unresolved : (a, b) intervals [rad] in which the subdivision ended without telling.
    failures : stick positions [rad] at which the motion could not be computed.

    Examples
    --------
    >>> from casahunt import Servo, fixed_points
    >>> seen = fixed_points(Servo(), 0.6, 1e-3, 3e-3, points=10)  # stick positions [rad]
    >>> [point.stable for point in seen.fixed], seen.conclusive
    ([False, True], True)
    """

    _quantities = ("gain [V/rad]", "from = low [rad]", "to = high [rad]", "found = fixed.size", "conclusive")
    _details = (
        "fixed_points = fixed", "unresolved", "failures", "evidence = sentence", "motions = points.size", "servo",
    )  # fmt: skip

    servo: Servo
    gain: float
    low: float
    high: float
    points: tuple[MapPoint, ...]
    fixed: tuple[FixedPoint, ...]
    jumps: tuple[Jump, ...]
    unresolved: tuple[tuple[float, float], ...]
    failures: tuple[float, ...]

    @property
    def conclusive(self) -> bool:
        """The scan met nothing that it could not resolve."""
        return not self.unresolved and not self.failures

    def sentence(self) -> str:
        """What was found, and what supports it."""
        count = len(self.fixed)
        known = [p for p in self.points if math.isfinite(p.position)]
        found = {0: "no fixed point", 1: "1 fixed point"}.get(count, f"{count} fixed points")
        where = several((self.low, self.high), "rad", by=" and ")
        text = f"{found} of the event map between {where}: {len(self.points)} motions"
        if count == 0 and known:
            best = max(known, key=lambda p: p.excess)
            far = f"{1 + best.excess:.8g} times as far from the set point as before"
            text += f", a swing leads at most {far}, from {quantity(best.start, 'rad', '.8g')}"
        text += ", computed more closely until interpolation between neighbours agreed with the motion half-way"
        crossing = sum(jump.crosses for jump in self.jumps)
        if self.jumps:
            jumps = "1 jump" if len(self.jumps) == 1 else f"{len(self.jumps)} jumps"
            text += f"; {jumps} in where it sticks next (or pieces too steep to resolve)"
            text += f", {crossing} of them from nearer to farther" if crossing else ""
        swinging = len(self.points) - len(known)
        if swinging:
            text += f"; {swinging} motions that do not come to stick"
        if not self.conclusive:
            text += (
                f"; not conclusive: {len(self.unresolved)} intervals unresolved, {len(self.failures)} motions failed"
            )
        return text

    def _columns(self) -> Columns:
        nan = math.nan
        rows: list[tuple[Any, ...]] = [
            ("fixed point", f.amplitude, f.amplitude * f.error, f.multiplier, f.period, f.period * f.period_error,
             f.stable, nan, nan)
            for f in self.fixed
        ]  # fmt: skip
        rows += [("jump", j.start, nan, nan, nan, nan, None, j.below, j.above) for j in self.jumps]
        return columns_from(CSV_COLUMNS, rows)

    def _more(self) -> dict[str, Any]:
        return {"jumps": [{"at": j.start, "below": j.below, "above": j.above, "crosses": j.crosses}
                          for j in self.jumps]}  # fmt: skip
