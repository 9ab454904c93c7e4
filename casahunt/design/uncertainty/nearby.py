"""Folds of servos nearby: looked for where the fold of one of them lets them be expected.

    K(q) ~ K0 prod_i (q_i/q0_i)^e_i,    e_i = d ln K/d ln q_i at q0: positive everywhere, unlike the linear answer

One by one: the way to a fold starts at a cycle below the gain that is expected; where none is met there, from nothing.
Many at once are those of batch.py, which leaves to this what it cannot do.  A fold depends on its own servo and on the
fold from which it is predicted, not on what was computed before it.

Units: K in V/rad.  Symbols: k uncertain parameters, n servos, q (k,) values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import NoOrbit, Status
from ...orbits import Options
from ...servo.cold_start import stable_at
from ...servo.event_map.half_cycle import StickMap
from ...servo.event_map.scan import scan
from ...servo.find_fold import find_fold
from ...servo.hunting import Model
from ...servo.problem import HuntingFold
from ...servo.servo import Servo
from ..sensitivity import fold_sensitivities
from .set import Array, values_of

BELOW = 0.7
"""Part of the predicted fold gain at which the way to the fold starts; the cold search costs three times as much."""


def fold_near(servo: Servo, model: Model, expected: float, options: Options) -> HuntingFold | None:
    """The fold of a servo whose gain is about known.

    expected: its fold gain [V/rad], about; nan: unknown. Returns the fold; None where the servo cannot hunt. Raises
    NoOrbit: the fold was not computed.
    """
    start = None
    if np.isfinite(expected):
        try:
            rough = options.rough()
            met = stable_at(servo, model, BELOW * expected, options=rough)  # where it meets none, that proves nothing
            if met.orbit is not None and (met.clearly_stable or met.orbit.multipliers.leading.real <= 1):
                start = met.orbit
        except NoOrbit:
            pass  # the prediction was too far off: search from nothing
    try:
        return find_fold(servo, model, options=options, start=start)
    except NoOrbit as error:
        if error.status is not None:
            raise
        # A proof says that it hunts at no gain; the map at the expected gain is asked all the same.
        if np.isfinite(expected) and scan(StickMap("switch", servo, BELOW * expected)).upper is not None:
            sentence = f"{error}, but the event map has one near gain {expected:.4g}"
            raise NoOrbit(sentence, Status.NOT_CONVERGED) from None
        return None


@dataclass(frozen=True)
class Prediction:
    """K(q) ~ K0 prod (q_i/q0_i)^e_i, e the elasticities: positive everywhere, unlike the linear one."""

    gain: float
    q: Array
    elasticities: Array

    def __call__(self, rows: Array) -> Array:
        """(n,) gains predicted at rows (n, k)."""
        usable = (self.q > 0) & (rows > 0)
        logs = np.log(np.where(usable, rows, 1.0) / np.where(usable, self.q, 1.0))
        return self.gain * np.exp(np.clip(np.where(usable, logs, 0.0) @ self.elasticities, -50, 50))


def prediction(servo: Servo, fold: HuntingFold | None, names: Sequence[str]) -> Prediction:
    """The gains to be expected of servos near one.

    servo, fold: that servo and its fold; None: nothing is expected.
    Returns prediction: (n, k) parameter values -> (n,) gains [V/rad], nan without a fold.
    """
    q = values_of(servo, names)
    if fold is None:
        return Prediction(float("nan"), q, np.zeros(q.size))
    elasticities = fold_sensitivities(fold).elasticities
    return Prediction(fold.gain, q, np.array([elasticities[name] for name in names]))


def nominal_fold(servo: Servo, model: Model, options: Options, fold: HuntingFold | None) -> HuntingFold | None:
    """The servo's own fold, computed where it is not given.

    fold: the fold, where known. Returns the fold; None where it cannot hunt or was not computed.
    """
    if fold is not None:
        return fold
    try:
        return find_fold(servo, model, options=options)
    except NoOrbit:
        return None


def fold_beside(
    servo: Servo, model: Model, known: HuntingFold, *, options: Options | None = None
) -> HuntingFold | None:
    """The fold of a servo, looked for where that of a servo nearby lets it be expected.

    Returns the fold; None where a proof shows that it hunts at no gain (servo/denial.py).
    Raises NoOrbit: it was not computed.
    """
    names = tuple(fold_sensitivities(known).elasticities)
    expected = prediction(known.orbit.servo, known, names)(values_of(servo, names)[None, :])
    return fold_near(servo, model, float(expected[0]), options or Options())
