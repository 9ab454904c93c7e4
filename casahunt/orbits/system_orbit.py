"""A cycle of a user's system, as its user reads it: named parameters, a sentence, a curve, a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from ..checks import choice_of, error_text, to_error
from ..collocation.joints import flow_at
from ..collocation.mesh import evaluate_phase
from ..export import new_axes
from . import archive
from .closure import sizes_of, turned
from .orbit import Orbit, unknowns_of

Array = np.ndarray

BETWEEN_NODES, LOOKED_NEARER = 16, 6
"""Points of an interval at which it is seen how near a cycle comes to a state, and between the two beside the nearest
of them; so many times: where it is nearest is then known to 1e-6 of an interval."""


@dataclass(frozen=True, eq=False, repr=False)
class SystemOrbit(Orbit):
    """A periodic orbit of a user's system (hybrid/language.py); see `Orbit` for what else it holds.

    Attributes
    ----------
    from_start : of a cycle that was sought next to a state (`find_cycle`, settled), how far it lies from there: the
        largest difference of a state where it is nearest, in units of its largest magnitude on it; nan of any other.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> orbit.parameters["belt"], round(orbit.extrema("x").high.value, 4)
    (0.2, 1.1339)
    """

    _quantities = (
        "problem = problem.title", "parameters", "period ~ period_error", "amplitude ~ amplitude_error", "status",
    )  # fmt: skip

    from_start: float = np.nan

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters, by name."""
        return dict(zip(self.problem.names, map(float, self.problem.vector()), strict=True))

    def __str__(self) -> str:
        beside = "" if np.isnan(self.from_start) else f", {self.from_start:.2g} from the start"
        count = len(self.arcs) * self.repeats
        phases = f"{count} phase{'s' * (count > 1)}" + (", symmetric" if self.repeats > 1 else "")
        stability = {True: "stable", False: "unstable", None: "stability not known"}[self.stable]
        period = to_error(self.period, self.period_error)
        error = f"{error_text(self.error_estimate)}{beside}"
        return f"{self.problem.title}: period {period}, {phases}, {stability}, error {error}"

    def plot(
        self, across: str = "t", up: str = "", *, ax: Any = None, per_interval: int = 24, **style: Any
    ) -> Any:  # fmt: skip
        """Draw one state over another, or over the time.

        Parameters
        ----------
        across, up
            names of states; "t" is the time from the start of the first phase; default the first state over the time.
        ax
            matplotlib axes; default: those of a new figure, which `casahunt.pictures.save` writes to a file.
        per_interval
            points in an interval.
        **style
            for `ax.plot`.

        Returns
        -------
        The axes.

        Raises
        ------
        InputError : there is no such state.
        """
        times, states = self.sample(per_interval)
        curves = {**dict(zip(self.cycle.states, states, strict=True)), "t": times}
        across, up = (choice_of("state", name, curves) for name in (across, up or self.cycle.states[0]))
        ax = new_axes() if ax is None else ax
        ax.plot(curves[across], curves[up], **style)
        ax.set(xlabel=across, ylabel=up)
        return ax

    def save(self, path: str | Path) -> None:
        """Write it to a file (npz), which `casahunt.orbits.load_orbit` reads.

        Raises
        ------
        InputError : `archive.save_orbit` says why it cannot be written.
        """
        archive.save_orbit(self, path)


def off_start(orbit: SystemOrbit, x: Array, scale: Array) -> float:
    """How far an orbit lies from a state x (n,): `SystemOrbit.from_start`; scale (n,) sizes of what is zero on it."""
    t, u, setting = unknowns_of(orbit)
    system, nearest = cast(Any, orbit.problem).system, np.inf
    size = sizes_of(system, orbit.sample()[1].T, scale)
    for k, phase in enumerate(t.cycle.phases):
        inner, arc = np.arange(BETWEEN_NODES) / BETWEEN_NODES, orbit.arcs[k]
        whole = np.append((arc.breaks[:-1, None] + np.diff(arc.breaks)[:, None] * inner).ravel(), 1.0)
        for image in range(t.cycle.repeats):
            times = whole
            for _ in range(LOOKED_NEARER):
                if phase.mode.flow is not None:
                    states = flow_at(phase.mode, arc.states[0, 0], arc.duration * times, setting.p)
                else:
                    states = evaluate_phase(t, u, setting.fractions, k, times) * setting.scale
                for _ in range(image):
                    states = t.cycle.opened(states)
                off = np.max(np.abs(states - turned(system, x, states) - x) / size, axis=1)
                i = int(np.argmin(off))
                nearest = min(nearest, float(off[i]))
                times = np.linspace(times[max(i - 1, 0)], times[min(i + 1, len(times) - 1)], 2 * BETWEEN_NODES + 1)
    return nearest
