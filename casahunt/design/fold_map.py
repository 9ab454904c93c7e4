"""The fold gain over two parameters of a servo: a grid of folds, for contours.

    K(q_i, r_j)    i = 1..m, j = 1..n

The folds of one row, r as the servo has it, are followed from the servo's own outwards, and those of a column from that
row (fold_chain.py).  A fold depends on its own servo, not on the order.

Units: K in V/rad.  Symbols: m, n values of the first and the second parameter.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import known
from ..errors import InputError, Status
from ..export import Columns
from ..orbits.adapt import Options
from ..results import Result
from ..servo.find_fold import find_fold
from ..servo.hunting import MODELS, Model
from ..servo.problem import HuntingFold
from ..servo.servo import Servo, a_servo
from .fold_chain import Chain
from .sensitivity import NAMES

Array = np.ndarray

SIDES = (2, 200)
"""Fewest and most values of a parameter."""
NO_SERVO = "no servo has these two values"


@dataclass(frozen=True, eq=False, repr=False)
class FoldMap(Result):
    """The fold gain over two parameters.

    Attributes
    ----------
    servo, model : whose folds they are, but for the two parameters.
    names : the two parameters.
    values : (m,) and (n,) values of them.
    gains : (m, n) fold gains [V/rad]; 0 where a proof shows that no gain hunts, nan where none was computed.
    tolerance : bound on the estimated relative error of every gain.
    failures : why there is no gain, by (i, j).
    wall_s : time that it took [s].

    Examples
    --------
    >>> from casahunt import Servo, fold_map
    >>> names, values = ("friction.static", "friction.viscous"), ([0.53, 0.54], [0.09, 0.1])
    >>> found = fold_map(Servo(), "switch", names, *values)
    >>> found.gains.shape, found.status.ok
    ((2, 2), True)
    """

    _quantities = ("model", "parameters = names", "size = gains.shape", "tolerance", "status")
    _details = ("servo", "values", "gains", "wall_s [s]")

    servo: Servo
    model: Model
    names: tuple[str, str]
    values: tuple[Array, Array]
    gains: Array
    tolerance: float
    failures: dict[tuple[int, int], str]
    wall_s: float

    @property
    def status(self) -> Status:
        """Converged where every servo of the grid has its answer."""
        whole = all(sentence == NO_SERVO for sentence in self.failures.values())
        return Status.CONVERGED if whole else Status.NOT_CONVERGED

    def __str__(self) -> str:
        computed = self.gains[self.gains > 0]
        span = f"{computed.min():.5g} to {computed.max():.5g}" if computed.size else "none"
        m, n = self.gains.shape
        return f"{self.model} servo: fold gain {span} over {m} x {n} values of {self.names[0]} and {self.names[1]}"

    def status_at(self, i: int, j: int) -> str:
        """What is known at a place of the grid.

        Parameters
        ----------
        i, j
            the place.

        Returns
        -------
        "converged", "hunts at no gain", or "not computed".
        """
        gain = self.gains[i, j]
        return "not computed" if np.isnan(gain) else "hunts at no gain" if gain == 0 else "converged"

    def _more(self) -> dict[str, Any]:
        return {"failures": [{"place": place, "sentence": said} for place, said in self.failures.items()]}

    def _columns(self) -> Columns:
        i, j = (place.ravel() for place in np.indices(self.gains.shape))
        return {
            "model": [self.model] * i.size,
            "first": [self.names[0]] * i.size,
            "first_value": self.values[0][i],
            "second": [self.names[1]] * i.size,
            "second_value": self.values[1][j],
            "gain": self.gains.ravel(),
            "error_estimate": [self.tolerance] * i.size,
            "status": [self.status_at(*place) for place in zip(i.tolist(), j.tolist(), strict=True)],
        }


def fold_map(
    servo: Servo,
    model: Model,
    names: tuple[str, str],
    first: Array,
    second: Array,
    *,
    options: Options | None = None,
    fold: HuntingFold | None = None,
    report: Callable[[int], None] | None = None,
) -> FoldMap:
    """The fold gain at every pair of values of two parameters.

    Parameters
    ----------
    servo, model
        all other values, and the friction model.
    names
        two different parameters (sensitivity.NAMES).
    first, second
        (m,) and (n,) values of them, increasing.
    options
        tolerance of every fold.
    fold
        the servo's own, where it is known already.
    report
        called with the number of folds computed so far.

    Returns
    -------
    FoldMap.

    Raises
    ------
    InputError : a name, a value or an order that cannot be.
    NoOrbit : no fold was found to start from.

    Examples
    --------
    >>> from casahunt import Servo, fold_map
    >>> names, values = ("friction.static", "friction.coulomb"), ([0.53, 0.54], [0.44, 0.45])
    >>> gains = fold_map(Servo(), "switch", names, *values).gains
    >>> f"{gains[0, 0]:.4f}", bool(gains[1, 0] > gains[1, 1])
    ('0.6473', True)
    """
    a_servo(servo)
    began = time.perf_counter()
    known("model", model, MODELS)
    values = _checked(servo, names, (first, second))
    options = options or Options()
    start = fold or find_fold(servo, model, options=options)
    task = Chain(servo, model, names, options)
    gains = np.full((values[0].size, values[1].size), np.nan)
    failures: dict[tuple[int, int], str] = {}
    for i, base in enumerate(task.folds_along(values[0], start)):
        q = float(values[0][i])
        there = [_is_servo(servo, {names[0]: q, names[1]: float(r)}) for r in values[1]]
        failures.update({(i, int(j)): NO_SERVO for j in np.flatnonzero(~np.array(there))})
        kept = np.flatnonzero(there)
        gains[i, kept], said = task.gains(base, q, values[1][kept])
        failures.update({(i, int(kept[k])): sentence for k, sentence in said.items()})
        if report is not None:
            report((i + 1) * values[1].size)
    return FoldMap(servo, model, names, values, gains, options.tol, failures, time.perf_counter() - began)


def _checked(servo: Servo, names: tuple[str, str], values: tuple[Array, Array]) -> tuple[Array, Array]:
    """The two axes as arrays.  Raises InputError where one is none."""
    allowed = [name for name in NAMES if name in servo.names]
    for name in names:
        known("parameter", name, allowed)
    if names[0] == names[1]:
        raise InputError(f"{names[0]} and {names[1]}: must be two different parameters")
    axes = []
    for name, given in zip(names, values, strict=True):
        axis = np.asarray(given, float)
        if axis.ndim != 1 or not SIDES[0] <= axis.size <= SIDES[1] or not np.all(np.diff(axis) > 0):
            raise InputError(f"{name}: must be {SIDES[0]} to {SIDES[1]} increasing values")
        axes.append(axis)
    for q in (axes[0][0], axes[0][-1]):
        if not any(_is_servo(servo, {names[0]: float(q), names[1]: float(r)}) for r in (axes[1][0], axes[1][-1])):
            servo.replace(**{names[0]: float(q)})  # says what is wrong with it, where that is the value alone
    return axes[0], axes[1]


def _is_servo(servo: Servo, changed: dict[str, float]) -> bool:
    try:
        servo.replace(**changed)
    except InputError:
        return False
    return True
