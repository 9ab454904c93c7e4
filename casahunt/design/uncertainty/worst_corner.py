"""The largest fold gain in a box of servos.

    max K(q) over l <= q <= h,    with the exact gradient at every iterate

The search is a local one.  K is monotone in most parameters, so it goes straight to the corner that the signs of g
give, takes the gradient there, and goes on until no bound and no interior point is better to first order: what a
concave K could still gain, sum_i |g_i| room_i, is below the tolerance.  A coordinate along which the gradient changes
sign is brought to its zero by a search along that coordinate.  It is started from the servo, from a few random corners,
and from where the caller likes, all in one batch: the folds of one round are one batch.  The fold at the best point is
computed once more, alone.

Units: K in V/rad.  Symbols: k uncertain parameters, q, l, h (k,) values and bounds, g (k,) gradient.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ... import effort
from ...axis_units import in_its_units
from ...continuation import folds_near
from ...errors import NoOrbit, Status
from ...orbits import Options
from ...results import Result
from ...roots import Bracket
from ...servo.friction import Model, pairs_of
from ...servo.parts.loop import Loop
from ...servo.servo import Servo
from ..nearby import (
    AnyFold,
    are_servos,
    check_asked,
    expected_gains,
    fold_near,
    known_fold,
    nominal_fold,
    said,
    servo_at,
    values_of,
    vectors,
)
from ..sensitivity import fold_sensitivities
from .set import Array, Uncertainty, check_box

RANDOM_CORNERS = 2
"""Corners that are searched from besides: K is monotone in most parameters, where one start is enough."""
MOST_WORK_OF_A_FOLD = {"switch": 3e5, "lugre": 9e5, None: 9e5}
"""Work (effort.py), 8 s and 20 s of a processor, after which a fold is given up: twice what the slowest of the random
servos takes, None for a loop of parts.  Where slips become ever shorter a branch goes on for minutes."""
LEAST_END = 1e-6
"""Of the upper end of an interval, for which a lower end of zero counts where intervals are compared."""
MOST_EVALUATIONS, MOST_FOLDS_ALONG, MOST_FAILED_FOLDS = 100, 25, 6
"""Folds per search for a worst corner, which takes a few on a monotone way, and per search along one coordinate; and of
those that are not computed, behind which it is given up: where two masses hunt irregularly, each takes seconds."""


@dataclass(frozen=True, eq=False, repr=False)
class WorstCase(Result):
    """The largest fold gain found in a box.

    Attributes
    ----------
    servo : the servo there.
    fold : its fold; None where no servo of the box was found to hunt.
    corner : the values of the uncertain parameters there.
    evaluations : folds computed.
    failures : what went wrong at points that were not computed.

    Examples
    --------
    >>> from casahunt import Servo, Uncertainty, worst_corner
    >>> worst = worst_corner(Servo(), "switch", Uncertainty({"friction.static": (0.52, 0.54)}))
    >>> worst.corner, round(worst.gain, 3)
    ({'friction.static': 0.54}, 0.721)
    """

    _quantities = ("gain [V/rad] ~ gain_error", "corner", "evaluations")
    _details = ("servo", "failures", "fold")

    servo: Any
    fold: AnyFold | None
    corner: dict[str, float]
    evaluations: int
    failures: tuple[str, ...] = ()

    @property
    def gain(self) -> float:
        """The fold gain; 0 without a fold."""
        return self.fold.value if self.fold is not None else 0.0

    @property
    def gain_error(self) -> float | None:
        """Its estimated relative error; None without a fold."""
        return self.fold.value_error if self.fold is not None else None


@dataclass(frozen=True, eq=False)
class _SearchPoint:
    """A point of the search: K = -inf where it is no servo or was not computed; no gradient where K <= 0."""

    q: Array
    gain: float
    gradient: Array | None = None
    fold: AnyFold | None = None


Ascent = Generator[list[Array], list[_SearchPoint], None]
"""A search from one point: asks for the folds at points, is told them."""


class _CornerSearch:
    """The folds computed so far in one box; every point is computed once, those of all searches together."""

    def __init__(self, servo: Servo | Loop, model: Model | None, uncertainty: Uncertainty, options: Options,
                 fold: AnyFold | None, report: Callable[[int], None] | None):  # fmt: skip
        self.report = report
        self.servo, self.model, self.options = servo, model, options
        self.names, self.pairs = uncertainty.parameters, pairs_of(servo)
        self.low, self.high = uncertainty.box(servo)
        self.fold = fold
        self.known = known_fold(servo, self.names, fold, options.tol)
        self.places: dict[bytes, _SearchPoint] = {}
        self.evaluations = 0
        self.failures: list[str] = []
        self.given_up = ""
        if fold is not None:
            self._keep(_SearchPoint(values_of(servo, self.names), fold.value, gradient(fold, self.names), fold))

    def _keep(self, place: _SearchPoint) -> _SearchPoint:
        self.places[place.q.tobytes()] = place
        return place

    def compute(self, asked: list[Array]) -> None:
        """The folds at points (k,) that are not known yet, in one batch."""
        rows: dict[bytes, Array] = {}
        for q in asked:
            if q.tobytes() in self.places or q.tobytes() in rows:
                continue
            if not are_servos(self.servo, self.names, q[None])[0]:  # the other bounds have been checked
                self._keep(_SearchPoint(q, -np.inf))
            else:
                self.evaluations += 1
                if self.report is not None:
                    self.report(self.evaluations)
                rows[q.tobytes()] = q
        if not rows:
            return
        table = np.array(list(rows.values()))
        expected, p = expected_gains(self.fold, self.names, table), vectors(self.servo, self.names, table)
        folds = None if self.known is None else folds_near(self.known, p, self.options.tol, slopes_by=self.names)
        for i, q in enumerate(table):
            if folds is not None and folds.how[i] and q.all():  # of a parameter that is zero no elasticity tells
                gain = float(folds.values[i])
                self._keep(_SearchPoint(q, gain, gain * folds.slopes[i] / q))
            else:
                self._keep(self._alone(_SearchPoint(q, float(expected[i]))))

    def _alone(self, place: _SearchPoint) -> _SearchPoint:
        """The fold at a point computed alone, where its gain is about known."""
        try:
            with effort.at_most(MOST_WORK_OF_A_FOLD[self.model]):
                fold = fold_near(servo_at(self.servo, self.names, place.q), self.model, place.gain, self.options)
        except (NoOrbit, effort.GivenUp) as error:
            self.failures.append(f"at {said(dict(zip(self.names, place.q, strict=True)))}: {error}")
            if isinstance(error, effort.GivenUp) or len(self.failures) == MOST_FAILED_FOLDS:
                many = f"{len(self.failures)} of {self.evaluations} folds were not computed, the last one "
                self.given_up = self.given_up or many + self.failures[-1]
            return _SearchPoint(place.q, -np.inf)
        return (
            _SearchPoint(place.q, 0.0)
            if fold is None
            else _SearchPoint(place.q, fold.value, gradient(fold, self.names), fold)
        )

    def run(self, ascents: Iterable[Ascent]) -> None:
        """Searches in one batch: what they ask for in one round is one batch."""
        asked = {ascent: next(ascent) for ascent in ascents}
        while asked:
            self.compute([q for points in asked.values() for q in points])
            for ascent, points in list(asked.items()):
                del asked[ascent]
                with suppress(StopIteration):
                    asked[ascent] = ascent.send([self.places[q.tobytes()] for q in points])

    def climb(self, q: Array) -> Ascent:
        """From q to a point from which no step within the box leads up, to first order."""
        (here,) = yield [q]
        searched = list[int]()  # the coordinate along which it has just been: up to a jump of K it rises still
        while here.gradient is not None and self.evaluations < MOST_EVALUATIONS and not self.given_up:
            g = here.gradient
            rise = self._rise(here)
            rise[searched] = 0.0
            if rise.sum() <= self.options.tol * here.gain:
                return
            (there,) = yield [np.where(rise > 0, np.where(g > 0, self.high, self.low), here.q)]
            searched = [] if there.gain > here.gain else [int(np.argmax(rise))]
            if searched:
                there = yield from self._along(here, searched[0])
            if not there.gain > here.gain * (1 + self.options.tol):
                return
            here = there

    def _rise(self, here: _SearchPoint) -> Array:
        """(k,) what K may still gain along each coordinate, to first order."""
        assert here.gradient is not None
        room = np.where(here.gradient > 0, self.high, self.low) - here.q
        return np.asarray(here.gradient * room)

    def sure(self, best: _SearchPoint) -> bool:
        """Whether nothing was given up, or the best point is one without it."""
        if not self.given_up:
            return True
        known = best.fold is not None and best.gradient is not None
        return known and float(self._rise(best).sum()) <= self.options.tol * best.gain

    def _along(self, here: _SearchPoint, i: int) -> Generator[list[Array], list[_SearchPoint], _SearchPoint]:
        """The best point along coordinate i, upwards from `here`: the zero of the gradient by Illinois steps."""
        assert here.gradient is not None
        sense = np.sign(here.gradient[i])
        start, end = float(here.q[i]), float((self.high if sense > 0 else self.low)[i])
        # Up to where K falls again; of the far end no more is known yet.
        bracket = Bracket(end, -np.inf, start, float(abs(here.gradient[i])))
        best, x = here, end
        for _ in range(0 if self.given_up else MOST_FOLDS_ALONG):
            q = here.q.copy()
            q[i] = x
            (place,) = yield [q]
            slope = np.nan if place.gradient is None else float(sense * place.gradient[i])
            best = place if place.gain > best.gain else best
            if self.given_up or (x == end and slope > 0 and best is place):
                break
            rises = slope > 0 and place.gain >= here.gain
            bracket = bracket.told(x, slope if rises or slope < 0 else -np.inf)
            x = bracket.illinois
            # where K jumps, no slope vanishes: what it may still gain is what counts
            if not bracket.holds(x) or abs(slope) * bracket.width <= self.options.tol * place.gain:
                break
        return best

    def starts(self, given: Iterable[Array], seed: int) -> list[Array]:
        """(k,) each: the servo itself, what the caller likes, and random corners."""
        random = np.random.default_rng(np.random.SeedSequence(seed))
        corners = [np.where(random.random(self.low.size) < 0.5, self.low, self.high) for _ in range(RANDOM_CORNERS)]
        return [np.clip(values_of(self.servo, self.names), self.low, self.high), *given, *corners]

    def possible(self, q: Array) -> Array:
        """q, with the friction that hunts most where static would not exceed Coulomb friction."""
        for static, coulomb in self.pairs.items():
            own = {name: self.servo.value(name) for name in (static, coulomb)}
            known = own | dict(zip(self.names, q, strict=True))
            if known[static] <= known[coulomb]:
                q = np.where([name == static for name in self.names], self.high, q)
                q = np.where([name == coulomb for name in self.names], self.low, q)
        return q

    def best(self) -> _SearchPoint:
        """The best point of the box, the corner that favours hunting most where none was found to hunt.

        Its fold is computed alone too: what a batch has found there decides nothing by itself.
        """
        favourable = np.where([name in self.pairs for name in self.names], self.high, self.low)
        if max(place.gain for place in self.places.values()) <= 0:
            self.run([self.climb(favourable)])
        while True:
            inside = [p for p in self.places.values() if (self.low <= p.q).all() and (p.q <= self.high).all()]
            best = max(inside, key=lambda p: (p.gain, np.array_equal(p.q, favourable)))
            if best.fold is not None or not best.gain > 0 or self.given_up:
                return best
            self._keep(self._alone(best))


def gradient(fold: AnyFold, names: Sequence[str]) -> Array:
    """The gradient dK/dq of the fold gain.

    fold: where it is taken. Returns (k,) [V/rad] per unit of each parameter.
    """
    derivatives = fold_sensitivities(fold).derivatives
    return np.array([derivatives[name] for name in names], dtype=float)


@in_its_units
def worst_corner(
    servo: Servo | Loop,
    model: Model | None,
    uncertainty: Uncertainty,
    *,
    options: Options | None = None,
    fold: AnyFold | None = None,
    starts: Iterable[Array] = (),
    seed: int = 0,
    report: Callable[[int], None] | None = None,
) -> WorstCase:
    """The largest fold gain over the box of the uncertainty, by a local search (module docstring).

    Parameters
    ----------
    servo, model, uncertainty
        the problem; a loop of parts has no model.
    options
        tolerance of every fold, and of the search.
    fold
        the servo's own fold, where it is known already.
    starts
        more points (k,) of the box to start from, for example the worst of the samples.
    seed
        of the random corners.
    report
        called before every fold with its number.

    Returns
    -------
    WorstCase; where no point of the box was found to hunt, gain 0 at the corner that favours hunting most
    (largest static, smallest Coulomb friction).

    Raises
    ------
    InputError : the box is no servo's.
    NoOrbit : no point of the box could be computed.

    Examples
    --------
    >>> from casahunt import Servo, Uncertainty, worst_corner
    >>> uncertainty = Uncertainty({"friction.static": (0.52, 0.54), "friction.coulomb": (0.43, 0.45)})
    >>> worst_corner(Servo(), "switch", uncertainty).corner
    {'friction.static': 0.54, 'friction.coulomb': 0.43}
    """
    check_asked(servo, model)
    check_box(servo, uncertainty)
    options = options or Options()
    search = _CornerSearch(servo, model, uncertainty, options, nominal_fold(servo, model, options, fold), report)
    search.run([search.climb(search.possible(np.array(q, dtype=float))) for q in search.starts(starts, seed)])
    best = search.best()
    if best.gain == -np.inf:
        raise NoOrbit(f"no fold in the box was computed: {'; '.join(search.failures)}", Status.NOT_CONVERGED)
    if not search.sure(best):
        widest = search.names[int(np.argmax(search.high / np.maximum(search.low, LEAST_END * search.high)))]
        said = f"the worst servo within the intervals was not found: {search.given_up}"
        raise NoOrbit(f"{said}; narrow the intervals, first that of {widest}", Status.NOT_CONVERGED)
    corner = {name: float(value) for name, value in zip(search.names, best.q, strict=True)}
    where = servo_at(servo, search.names, best.q)
    return WorstCase(where, best.fold, corner, search.evaluations, tuple(search.failures))
