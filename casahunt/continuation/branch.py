"""A branch of cycles in one parameter: orbits in order, special points, and why it ends; on its way and handed out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Generic

import numpy as np

from ..checks import of_kind
from ..export import Columns, columns_from
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit
from ..results import Result
from .crossings import Crossings, Passed
from .curve import parameter_value
from .special_points import FOLD, GRAZING, Missed, Monitor, SpecialPoint
from .terminations import End

Array = np.ndarray

MOST_SAID = 8
"""Special points that the text of a branch names."""
COLUMNS = (
    "half_multiplier",
    "log10_abs_half_multiplier",
    "stable",
    "trivial_multiplier_error",
    "error_estimate",
    "status",
    "unknowns",
    "iterations",
    "special",
    "lopsided",
)
"""Columns of the table of a branch behind the parameter, the amplitude and the period."""
NOT_ENDED = End("", "")
INTERRUPTED = End("interrupted", "interrupted")
"""Of a branch on its way, and of one that was not computed to its end."""


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Result, Generic[AnyOrbit]):
    """Cycles along a parameter.

    Attributes
    ----------
    vary : name of the parameter.
    orbits : in the order of computation, the one that it starts at first.
    special : the special points that were located, in the same order.
    missed : those that the branch has, but that were not located.
    end : why the branch ends where it does.
    lopsided : of a branch of symmetric cycles, those of lopsided ones that branch off from it: of each pair one, the
        other one is its mirror image.

    What its cycles are named after (`Problem.labels`) is an attribute too, and so are the values by the plural of the
    parameter's name.

    Examples
    --------
    >>> from casahunt.continuation import follow
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> branch = follow(orbit, "a", to=0.013)
    >>> f"{branch.values[-1]:.4f}", branch.ended
    ('0.0130', 'a reached 0.013, the end of the range')
    """

    _quantities = ("vary", "points = orbits.size", "ended")
    _details = ("missed", "end", "lopsided")

    vary: str
    orbits: tuple[AnyOrbit, ...]
    special: tuple[SpecialPoint[AnyOrbit], ...] = ()
    missed: tuple[Missed, ...] = ()
    end: End = NOT_ENDED
    lopsided: tuple[Branch[AnyOrbit], ...] = ()

    def __post_init__(self) -> None:
        of_kind("orbits", self.orbits, tuple, 'of cycles: Branch("a", orbits, special, missed, end)')

    def __getattr__(self, name: str) -> Any:
        orbits = self.__dict__.get("orbits", ())
        labels = orbits[0].problem.labels() if orbits else {}
        if orbits and name == f"{self.vary}s":
            return self.values
        if name not in labels:
            raise AttributeError(f"a branch has no attribute {name!r}")
        return labels[name]

    @property
    def ended(self) -> str:
        """One sentence that says why the branch ends where it does."""
        return self.end.sentence

    @property
    def values(self) -> Array:
        """(m,) values of the parameter."""
        return np.array([orbit.problem.value(self.vary) for orbit in self.orbits])

    @property
    def range(self) -> tuple[float, ...]:
        """The smallest and the largest value of the parameter; empty without orbits."""
        return (float(self.values.min()), float(self.values.max())) if self.orbits else ()

    @property
    def periods(self) -> Array:
        """(m,) periods."""
        return np.array([orbit.period for orbit in self.orbits])

    @property
    def amplitudes(self) -> Array:
        """(m,) amplitudes: of the first state that is no angle, or of what the cycles measure."""
        return np.array([orbit.amplitude for orbit in self.orbits])

    @property
    def half_multipliers(self) -> Array:
        """(m,) leading half multipliers mu; computed now where nobody has read them before."""
        return np.array([orbit.half_multiplier for orbit in self.orbits])

    @property
    def stable(self) -> Array:
        """(m,) bool: which are known to be."""
        return np.array([orbit.stable is True for orbit in self.orbits])

    def __str__(self) -> str:
        met = [special.meaning for special in self.special] + [missed.meaning for missed in self.missed]
        more = [f"and {len(met) - MOST_SAID} more"] if len(met) > MOST_SAID else []
        return "\n".join([f"{len(self.orbits)} cycles along {self.vary}; {self.ended}", *met[:MOST_SAID], *more])

    def along(self) -> Iterator[tuple[AnyOrbit, str]]:
        """Orbits and special points in their order along the branch, each with the kind of special point, or ""."""
        kinds, inside = {id(s.orbit): s.kind for s in self.special}, set(map(id, self.orbits))
        apart = [special for special in self.special if id(special.orbit) not in inside]
        for orbit in self.orbits:
            yield orbit, kinds.get(id(orbit), "")
            yield from ((special.orbit, special.kind) for special in apart if special.behind is orbit)
        yield from ((special.orbit, special.kind) for special in apart if id(special.behind) not in inside)

    def _columns(self) -> Columns:
        sizes = (self.orbits[0] if self.orbits else Orbit)._size_columns
        rows = [self._row(orbit, kind) for orbit, kind in self.along()]
        for number, pair in enumerate(self.lopsided, 1):
            rows += [self._row(orbit, kind, number) for orbit, kind in pair.along()]
        return columns_from((self.vary, *sizes, *COLUMNS), rows)

    def _row(self, orbit: AnyOrbit, kind: str, pair: int = 0) -> tuple[Any, ...]:
        """One row of the table: of a special point by its kind, of a lopsided pair by its number.

        A symmetric cycle that a pair meets is told as lopsided too.
        """
        multipliers = orbit.multipliers
        trusted, symmetric = multipliers.trusted, orbit.half or not pair
        return (
            orbit.problem.value(self.vary),
            orbit.amplitude,
            orbit.period,
            orbit.half_multiplier if trusted and symmetric else math.nan,
            multipliers.log10_leading if trusted and symmetric and not multipliers.leading_floor else math.nan,
            orbit.stable if trusted and kind != FOLD.kind else "",  # at a fold it is neither
            multipliers.trivial_error,
            orbit.error_estimate,
            orbit.status.name.lower(),
            orbit.unknowns,
            orbit.iterations,
            kind,
            pair,
        )

    def _more(self) -> dict[str, Any]:
        special = [
            {
                **s.to_dict(table=False), self.vary: s.orbit.problem.value(self.vary),
                "amplitude": s.orbit.amplitude, "period": s.orbit.period,
            }
            for s in self.special
        ]  # fmt: skip
        labels = self.orbits[0].problem.labels() if self.orbits else {}
        return {**labels, f"{self.vary}_range": self.range, "special": special}


@dataclass(frozen=True)
class Departure(Generic[AnyOrbit]):
    """How a walk sets out.

    Attributes
    ----------
    sense, previous, heading : its sense; the orbit before or None; its direction on the curve or None.
    first_step : the length of its first step; None for that of the branch.
    watched, insisted : for cycles cut by planes, whether the plane is watched, and whether another was asked for in
        need.
    """

    sense: float
    previous: AnyOrbit | None = None
    heading: Array | None = None
    first_step: float | None = None
    watched: bool = True
    insisted: bool = False


@dataclass
class Run(Generic[AnyOrbit]):
    """A branch on its way: what it has come to, and what stays the same."""

    branch: Branch[AnyOrbit]
    line: Crossings[AnyOrbit]
    looked_for: tuple[Monitor, ...]
    until: Callable[[SpecialPoint[AnyOrbit]], bool] | None
    options: Options
    max_points: int
    progress: Callable[[AnyOrbit], None] | None
    report: Callable[[Branch[AnyOrbit]], None] | None
    recut: bool
    natural: bool
    how: dict[str, Any]
    told: AnyOrbit | None = None

    @property
    def last(self) -> AnyOrbit:
        """The last orbit."""
        return self.branch.orbits[-1]

    def value(self, orbit: AnyOrbit) -> float:
        """The parameter there."""
        return parameter_value(orbit, self.branch.vary)

    def told_to_end(self) -> End | None:
        """The end at a special point that was to be the last one."""
        last = next((each for each in self.branch.special if self.until is not None and self.until(each)), None)
        return None if last is None else End(last.kind, last.meaning, last.value, last.error)

    def within(self, orbit: AnyOrbit) -> bool:
        """Whether its parameter is within the range."""
        return bool(self.how["low"] <= self.value(orbit) <= self.how["high"])

    def of_contact(self, special: SpecialPoint[AnyOrbit]) -> Passed[AnyOrbit]:
        """A contact that the branch passes, where these are looked for."""
        return Passed((special,)) if GRAZING in self.looked_for else Passed()

    def add(self, *orbits: AnyOrbit, passed: Passed[AnyOrbit] | None = None) -> None:
        """Give the branch orbits further on, and what was passed on the way.

        *orbits, passed: in order; default nothing.
        """
        b, p = self.branch, passed or Passed()
        self.branch = replace(
            b, orbits=(*b.orbits, *orbits), special=(*b.special, *p.special), missed=(*b.missed, *p.missed)
        )
        for orbit in orbits:
            if self.progress is not None:
                self.progress(orbit)
        if self.report is not None and passed is not None and self.line.known is not self.told:
            orbits, self.told = self.branch.orbits, self.line.known
            behind = next((k for k in range(len(orbits)) if orbits[-1 - k] is self.told), 0)
            self.report(replace(self.branch, orbits=orbits[: len(orbits) - behind], end=INTERRUPTED))

    def replaced(self, orbit: AnyOrbit) -> None:
        """The last orbit is another picture of itself, in other coordinates."""
        self.add(passed=self.line.rest())
        self.branch = replace(self.branch, orbits=(*self.branch.orbits[:-1], orbit))
        self.line.go_on_from(orbit, same=True)
