"""What the figures share, each computed when first asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from casahunt import Branch, Options, Orbit, Servo, Trajectory, diagram, find_fold, find_orbit, simulate, walk
from casahunt.servo.friction import Model
from casahunt.views.pictures.plotting import Figure
from problems import table1
from scripts.report.attraction import Attraction, attraction

Array = np.ndarray
T = TypeVar("T")

EXPERIMENT: dict[str, float] = table1.REFERENCE["experiment"]
GAIN = EXPERIMENT["K"]
MEASURED_AMPLITUDE, MEASURED_PERIOD = EXPERIMENT["amplitude"], 1 / EXPERIMENT["frequency_hz"]
START = 0.0321
"""The gain at which the report's diagrams begin."""
ENDED: dict[Model, float] = {"lugre": 0.615, "switch": 0.634}
"""The gains at which the report's Figures 6 and 9 end."""
SECONDS = 100.0
TRANSIENT = 40.0
"""Seconds of the regulator task that are left out of averages."""
WINDOW = 75.0
"""The time [s] at which the period of the report's Figure 4 begins."""
ENLARGED = 0.02
"""Range of gains below the fold in the enlargements."""
FINE_STEP: dict[Model, float] = {"switch": 0.01, "lugre": 0.02}
"""Arclength between the points of an enlargement, about 25 of them."""
POSITIONS = (-0.8, -0.4, 0.0, 0.4, 0.8)
"""x1 [rad] of the sections of Figures 5 and 12."""


class Study:
    """The servo of Table 1 and what was computed of it.

    Parameters
    ----------
    quick
        looser tolerances, diagrams that begin near the fold, coarser slices: to see that everything is drawn.
    """

    def __init__(self, quick: bool = False) -> None:
        self.quick = quick
        self.servo: Servo = table1.servo()
        self.start = 0.55 if quick else START
        self.options = Options(tol=1e-6 if quick else 1e-9)
        self.grid = 31 if quick else 121
        self._kept: dict[tuple[Any, ...], Any] = {}

    def _once(self, key: tuple[Any, ...], make: Callable[[], T]) -> T:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def motion(self) -> Trajectory:
        """The regulator task theta_d = 1 rad from rest at theta = 0, LuGre."""
        tol = 1e-5 if self.quick else 1e-7
        return self._once(("motion",), lambda: simulate(self.servo, "lugre", GAIN, time=SECONDS, tol=tol))

    def orbit(self, model: Model, gain: float = GAIN, branch: str = "stable") -> Orbit:
        """A hunting cycle."""
        return self._once(
            ("orbit", model, gain, branch),
            lambda: find_orbit(self.servo, model, gain, branch=branch, options=self.options),
        )

    def fold(self, model: Model) -> Orbit:
        """The cycle at the fold."""
        return self._once(("fold", model), lambda: find_fold(self.servo, model, options=self.options).orbit)

    def branch(self, model: Model) -> Branch:
        """From the first gain round the fold and back."""
        options = Options(tol=1e-5 if self.quick else 1e-7)
        return self._once(
            ("branch", model),
            lambda: diagram(self.servo, model, start=self.start, options=options),
        )

    def enlarged(self, model: Model) -> Branch:
        """The branch next to its fold, in small steps, with the special points of the whole one."""
        low, step = round(self.fold(model).gain - ENLARGED, 3), 0.1 if self.quick else FINE_STEP[model]

        def make() -> Branch:
            first = self.orbit(model, low)
            steps = walk(first, low=low, high=1.0, options=Options(tol=1e-7), first_step=step, largest_step=step)
            return Branch("gain", (first, *steps), self.branch(model).special)

        return self._once(("enlarged", model), make)

    def slice(self, gain: float, x1: float, x2: float, x3: float) -> Slice:
        """Where the states of a slice x1 = const lead: |x2| <= `x2`, x3 within `x3` of the bound's middle."""

        def make() -> Slice:
            kp, _, ki = self.servo.torque_gains(gain)
            across = np.linspace(-x3, x3, self.grid) - kp * x1 / ki
            up = np.linspace(-x2, x2, self.grid)
            grid3, grid2 = np.meshgrid(across, up)
            states = np.stack([np.full(grid3.size, x1), grid2.ravel(), grid3.ravel()])
            cycles = self.orbit("switch", gain, "unstable"), self.orbit("switch", gain)
            return Slice(x1, across, up, attraction(*cycles, states))

        return self._once(("slice", gain, x1, x2, x3), make)


@dataclass(frozen=True, eq=False)
class Slice:
    """States with one x1, on a grid of x3 (columns) and x2 (rows), and where they lead."""

    x1: float
    x3: Array
    x2: Array
    found: Attraction

    def shaped(self, values: Array) -> Array:
        """(rows, columns)."""
        return np.asarray(values).reshape(self.x2.size, self.x3.size)


@dataclass(frozen=True)
class Entry:
    """One figure: what it is called, its caption and its picture as functions of the study."""

    number: int
    title: str
    caption: Callable[[Study], str]
    draw: Callable[[Study], Figure]
