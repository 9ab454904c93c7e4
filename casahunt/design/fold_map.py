"""The fold gain over two parameters of a servo: a grid of folds, for contours.

    K(q_i, r_j)    i = 1..m, j = 1..n

    a known fold, expanded -> the next ones around it, in a batch -> the nearest to what is left, expanded -> ...
                                                                       | nothing reached
                                                                       v
                                                         that servo alone (nearby.py)

An expansion costs as much as ten folds of a batch: spread over the plane, folds need fewer than row by row.

A fold is solved and confirmed at its own servo: what it was predicted from decides whether it is found, not what it is.

Units: K in V/rad.  Symbols: m, n values of the first and the second parameter, k places of the grid.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..axis_units import in_its_units
from ..continuation import Expansion, expansion_beside, folds_near
from ..effort import MEMBERS_OF_A_PASS
from ..errors import InputError, NoOrbit, Status
from ..export import Columns
from ..orbits import Options
from ..results import Result
from ..servo.friction import Model
from ..servo.parts.loop import Loop
from ..servo.servo import Servo
from .nearby import AnyFold, are_servos, check_asked, fold_near, known_fold, one_value, servo_at, values_of, vectors

Array = np.ndarray

SIDES = (2, 200)
"""Fewest and most values of a parameter."""
NO_SERVO = "no servo has these two values"


@dataclass(frozen=True, eq=False, repr=False)
class FoldMap(Result):
    """The fold gain over two parameters.

    Attributes
    ----------
    servo, model : whose folds they are, but for the two parameters; a loop of parts has no model.
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

    servo: Servo | Loop
    model: Model | None
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
        whose = f"{self.model} servo" if self.model else "loop"
        return f"{whose}: fold gain {span} over {m} x {n} values of {self.names[0]} and {self.names[1]}"

    def _more(self) -> dict[str, Any]:
        return {"failures": [{"place": place, "sentence": said} for place, said in self.failures.items()]}

    def _columns(self) -> Columns:
        i, j = (place.ravel() for place in np.indices(self.gains.shape))
        return {
            "model": [self.model or "loop"] * i.size,
            "first": [self.names[0]] * i.size,
            "first_value": self.values[0][i],
            "second": [self.names[1]] * i.size,
            "second_value": self.values[1][j],
            "gain": self.gains.ravel(),
            "error_estimate": [self.tolerance] * i.size,
            "status": [
                "not computed" if np.isnan(gain) else "hunts at no gain" if gain == 0 else "converged"
                for gain in self.gains.ravel()
            ],
        }


@in_its_units
def fold_map(
    servo: Servo | Loop,
    model: Model | None,
    names: tuple[str, str],
    first: Array,
    second: Array,
    *,
    options: Options | None = None,
    fold: AnyFold | None = None,
    report: Callable[[int], None] | None = None,
) -> FoldMap:
    """The fold gain at every pair of values of two parameters.

    Parameters
    ----------
    servo, model
        all other values, and the friction model; or a loop of parts, and None.
    names
        two different parameters.
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
    began = time.perf_counter()
    check_asked(servo, model)
    values = _checked(servo, names, (first, second))
    options = options or Options()
    start = fold or fold_near(servo, model, np.nan, options)
    if start is None:
        raise NoOrbit("the servo hunts at no gain: no fold was found to start from")
    gains = np.full((values[0].size, values[1].size), np.nan)
    places = [place for place in np.ndindex(gains.shape) if _is_servo(servo, names, _pair(values, place))]
    failures = dict.fromkeys(sorted(set(np.ndindex(gains.shape)) - set(places)), NO_SERVO)
    q = np.array([_pair(values, place) for place in places]).reshape(-1, 2)
    spreading = _Spreading(servo, model, names, options, q, np.array([np.ptp(axis) for axis in values]))
    for left in spreading.over(start):
        if report is not None:
            report(gains.size - left)
    for place, gain, sentence in zip(places, spreading.gains.tolist(), spreading.sentences, strict=True):
        gains[place] = gain
        if sentence:
            failures[place] = sentence
    return FoldMap(servo, model, names, values, gains, options.tol, failures, time.perf_counter() - began)


@dataclass(eq=False)
class _Spreading:
    """Folds that spread over k servos, from one to those around it.

    Attributes
    ----------
    servo, model, names, options : whose folds they are, but for the two parameters; tolerance of every fold.
    q, span : (k, 2) values of the two parameters, and (2,) how far they go.
    """

    servo: Servo | Loop
    model: Model | None
    names: tuple[str, str]
    options: Options
    q: Array
    span: Array

    def __post_init__(self) -> None:
        k, self.p = len(self.q), vectors(self.servo, self.names, self.q)
        self.where = (self.q - values_of(self.servo, self.names)) / self.span
        self.gains, self.sentences = np.full(k, np.nan), [""] * k
        self.left = np.ones(k, dtype=bool)
        self.bases: dict[int, Expansion] = {}  # those that others were predicted from, by place
        self.found: dict[int, Expansion] = {}  # from which each was predicted that is found; or that fold itself

    def over(self, start: AnyFold) -> Generator[int]:
        """Compute all folds, from the servo's own outwards; how many are left, again and again.

        Gains are 0 where a proof shows that no gain hunts, nan with a sentence where the fold was not computed.
        """
        own = known_fold(self.servo, self.names, start, self.options.tol)
        if own is not None:
            self._reach(own, np.zeros(2))
        yield int(self.left.sum())
        while self.left.any():
            self._go_on()
            yield int(self.left.sum())

    def _go_on(self) -> None:
        """Compute some of the folds that are left: those around a known one, or one alone."""
        i = int(min(np.flatnonzero(self.left), key=lambda i: float(np.linalg.norm(self.where[i]))))
        at = min(self.found, key=lambda j: float(np.linalg.norm(self.where[j] - self.where[i])), default=None)
        near = None if at is None else self.bases.get(at)
        if at is not None and near is None:
            near = expansion_beside(self.found[at], self.p[at], self.options.tol)
            if near is None:
                del self.found[at]
                return
        else:
            at, near = i, self._alone(near, i)
            if near is None:
                return
            self.found[i] = near
        self.bases[at] = near
        self._reach(near, self.where[at])

    def _reach(self, near: Expansion, where: Array) -> None:
        """The folds that a known one leads to, the nearest first, until some of a pass are not reached."""
        whole = True
        while whole and self.left.any():
            left = np.flatnonzero(self.left)
            nearest = left[np.argsort(np.linalg.norm(self.where[left] - where, axis=1), kind="stable")]
            some = nearest[:MEMBERS_OF_A_PASS]
            folds = folds_near(near, self.p[some], self.options.tol)
            for j, i in enumerate(some.tolist()):
                if folds.statuses[j] is Status.CONVERGED:
                    self.gains[i], self.found[i], self.left[i] = folds.values[j], near, False
            whole = not self.left[some].any()

    def _alone(self, near: Expansion | None, i: int) -> Expansion | None:
        """Compute one fold; that from which others are predicted, None where there is none."""
        self.left[i] = False
        expected = np.nan
        if near is not None:
            expected = float(near.there(near.expected(self.p[i : i + 1]))[1][0])
        servo = servo_at(self.servo, self.names, self.q[i])
        try:
            fold = fold_near(servo, self.model, expected, self.options)
        except NoOrbit as error:
            self.sentences[i] = str(error)
            return None
        self.gains[i] = 0.0 if fold is None else fold.value
        return known_fold(servo, self.names, fold, self.options.tol)


def _checked(servo: Servo | Loop, names: tuple[str, str], values: tuple[Array, Array]) -> tuple[Array, Array]:
    """The two axes as arrays.  Raises InputError where one is none."""
    values_of(servo, names)
    if names[0] == names[1]:
        raise InputError(f"{names[0]} and {names[1]}: must be two different parameters")
    axes = []
    for name, given in zip(names, values, strict=True):
        axis = np.asarray(given, float)
        if axis.ndim != 1 or not SIDES[0] <= axis.size <= SIDES[1] or not np.all(np.diff(axis) > 0):
            raise InputError(f"{name}: must be {SIDES[0]} to {SIDES[1]} increasing values")
        axes.append(axis)
    for q in (0, -1):
        if not any(_is_servo(servo, names, _pair((axes[0], axes[1]), (q, r))) for r in (0, -1)):
            one_value(servo, names[0], float(axes[0][q]))  # says what is wrong with it, where that is the value alone
    return axes[0], axes[1]


def _pair(values: tuple[Array, Array], place: tuple[int, ...]) -> tuple[float, float]:
    """The two values at a place of the grid."""
    return float(values[0][place[0]]), float(values[1][place[1]])


def _is_servo(servo: Servo | Loop, names: tuple[str, str], pair: tuple[float, float]) -> bool:
    try:
        servo_at(servo, names, np.array(pair))
    except InputError:
        return False
    return bool(are_servos(servo, names, np.array([pair]))[0])
