"""A cycle of a user's system, as its user reads it: named parameters, a sentence, a curve, a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..checks import choice_of, error_text, to_error
from ..export import new_axes
from . import archive
from .orbit import Orbit


class SystemOrbit(Orbit):
    """A periodic orbit of a user's system (hybrid/language.py); see `Orbit` for what it holds.

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

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters, by name."""
        return dict(zip(self.problem.names, map(float, self.problem.vector()), strict=True))

    def __str__(self) -> str:
        count = len(self.arcs) * self.repeats
        phases = f"{count} phase{'s' * (count > 1)}" + (", symmetric" if self.repeats > 1 else "")
        stability = {True: "stable", False: "unstable", None: "stability not known"}[self.stable]
        period = to_error(self.period, self.period_error)
        return f"{self.problem.title}: period {period}, {phases}, {stability}, error {error_text(self.error_estimate)}"

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
