"""A fold curve as data: its points, the cubic through them.  Units: K in V/rad, q as in servo/servo.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Status
from ...export import Columns, columns_from
from ...results import Result
from ...servo.friction import Model
from ...servo.problem import HuntingOrbit
from ...servo.servo import Servo

Array = np.ndarray

CSV_COLUMNS = (
    "model",
    "parameter",
    "value",
    "gain",
    "amplitude_rad",
    "period_s",
    "slope",
    "elasticity",
    "error_estimate",
    "status",
    "special",
)
"""Columns of the table of a fold curve."""


@dataclass(frozen=True, eq=False, repr=False)
class FoldPoint(Result):
    """A point of a fold curve.

    Attributes
    ----------
    value : the second parameter q.
    gain : the fold gain K [V/rad].
    slope : dK/dq.
    orbit : the orbit at the fold, with the servo there.
    error_estimate : the largest estimated relative error of gain, amplitude and period.
    curvature : phi_s, the second derivative of lambda along the branch: < 0 where the gain is the largest, > 0 where
        it is the smallest, 0 at a cusp.
    status : as everywhere.
    turns : whether the curve turns back in q here: a cusp.
    how : "batch" where it was computed together with others (folds_ahead.py); "followed" where step by step, and
        confirmed alone.
    """

    _quantities = ("value", "gain [V/rad] ~ error_estimate", "slope", "turns", "status")
    _details = (
        "amplitude = orbit.amplitude [rad]", "period = orbit.period [s]", "elasticity", "curvature", "how",
        "servo = orbit.servo",
    )  # fmt: skip

    value: float
    gain: float
    slope: float
    orbit: HuntingOrbit
    error_estimate: float
    curvature: float
    status: Status
    turns: bool = False
    how: str = "followed"

    @property
    def elasticity(self) -> float:
        """q/K dK/dq, per cent of gain for one per cent of the parameter."""
        return self.value * self.slope / self.gain


@dataclass(frozen=True, eq=False, repr=False)
class FoldCurve(Result):
    """The fold gain against a second parameter.

    Attributes
    ----------
    model, servo, vary : the problem; the servo as given.
    points : in order along the curve, cusps among them.
    cusps : the points where the curve turns back in q.
    ended : sentence that says why the curve ended.
    status : CONVERGED where the whole range, or all of it that has a fold, was covered.
    wall_s : time [s].
    vanishes : whether the curve was left where the gain tends to zero.

    Examples
    --------
    >>> from casahunt import Servo, fold_curve
    >>> curve = fold_curve(Servo(), "switch", vary="friction.static", start=0.53, end=0.54, points=2)
    >>> len(curve.points), curve.status.ok
    (2, True)
    >>> [f"{gain:.4f}" for gain in curve.gains]
    ['0.6473', '0.7212']
    """

    _quantities = ("model", "vary", "number_of_points = points.size", "status", "ended")
    _details = ("servo", "points", "vanishes", "wall_s [s]")

    model: Model
    servo: Servo
    vary: str
    points: tuple[FoldPoint, ...]
    cusps: tuple[FoldPoint, ...]
    ended: str
    status: Status
    wall_s: float
    vanishes: bool = False

    @property
    def values(self) -> Array:
        """The second parameter."""
        return np.array([point.value for point in self.points])

    @property
    def gains(self) -> Array:
        """The fold gains."""
        return np.array([point.gain for point in self.points])

    @property
    def slopes(self) -> Array:
        """dK/dq."""
        return np.array([point.slope for point in self.points])

    def _columns(self) -> Columns:
        rows = [
            (p.orbit.model, self.vary, p.value, p.gain, p.orbit.amplitude, p.orbit.period, p.slope, p.elasticity,
             p.error_estimate, p.status.name.lower(), "cusp" if p.turns else "")
            for p in self.points
        ]  # fmt: skip
        return columns_from(CSV_COLUMNS, rows)

    def _more(self) -> dict[str, Any]:
        return {"special": [{"kind": "cusp", "value": point.value, "gain": point.gain} for point in self.cusps]}


def cubic_through_points(curve: FoldCurve, samples: int = 24) -> tuple[Array, Array]:
    """The cubic through the points of a curve with their exact slopes.

    Returns q, and K [V/rad] there.
    """
    q, K, slope = curve.values, curve.gains, curve.slopes
    if len(q) < 2:
        return q, K
    x = np.linspace(0, 1, samples, endpoint=False)
    h, rise = np.diff(q)[:, None], np.diff(K)[:, None]
    a, b = slope[:-1, None] * h - rise, rise - slope[1:, None] * h
    between = K[:-1, None] + x * rise + x * (1 - x) * (a * (1 - x) + b * x)
    return np.append((q[:-1, None] + x * h).ravel(), q[-1]), np.append(between.ravel(), K[-1])
