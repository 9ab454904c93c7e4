"""A motion as data: its phases, its events, its states at any times.

Symbols: n states, d stages, N intervals of a phase, m sample points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..collocation.joints import flow_at
from ..collocation.scheme import Kind, scheme
from ..export import Columns
from ..hybrid import system as engine
from ..hybrid.language import System
from ..results import Result
from .segment import Segment

Array = np.ndarray


class Crossing(NamedTuple):
    """An event that was met: time, its name, the mode that it ends, the states in front of it and behind (n,)."""

    time: float
    event: str
    mode: str
    before: Array
    behind: Array


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Result):
    """A motion, as far as it was followed.

    Attributes
    ----------
    system : whose it is.
    p : (np,) parameters.
    phases : its phases, one after the other; the last one ends where the time is over.
    error : estimated error of states and times of events at the end, relative to the sizes of the states and to the
        duration.
    scale : (n,) sizes of the states.
    kind : collocation scheme.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import simulate
    >>> motion = simulate(belt, "slip", x=0.0, v=0.0, duration=5.0)
    >>> motion.duration, round(motion.end["x"], 4)
    (5.0, 0.9719)
    """

    _quantities = ("duration ~ error", "number_of_events = events.size", "end")
    _details = ("error", "events", "p", "kind")

    system: System
    p: Array
    phases: tuple[Segment, ...]
    error: float
    scale: Array
    kind: Kind

    @property
    def duration(self) -> float:
        """Time that was followed."""
        return float(sum(phase.duration for phase in self.phases))

    @property
    def sizes(self) -> dict[str, float]:
        """The sizes of the states that its error is relative to, by name."""
        return dict(zip(self.system.names.states, map(float, self.scale), strict=False))

    @property
    def end(self) -> dict[str, float]:
        """The states at the end, by name; in a forced system the time."""
        x, names = self.phases[-1].end, self.system.names
        found = dict(zip(names.states, map(float, x), strict=False))
        return found | ({"t": float(x[-1]) * float(names.turn(self.p))} if names.forcing_period else {})

    @property
    def events(self) -> tuple[Crossing, ...]:
        """The events on the way."""
        times = np.cumsum([phase.duration for phase in self.phases])
        return tuple(
            Crossing(float(t), phase.event, phase.mode, phase.end, phase.behind)
            for t, phase in zip(times, self.phases, strict=True)
            if phase.event
        )

    def sample(self, per_interval: int = 8) -> tuple[Array, Array]:
        """Dense where the motion is fast.

        Returns
        -------
        times : (m,) from the start; twice the same where the state jumps.
        states : (n, m), in the order of `system.names.entries`.
        """
        return sampled(self.system.vector_form, self.phases, self.p, self.kind, per_interval)

    def at(self, times: Array) -> Array:
        """States at any times.

        Parameters
        ----------
        times
            (m,) from the start, not behind the end.  At that of an event, the state behind it.

        Returns
        -------
        (n, m), in the order of `system.names.entries`.
        """
        t, of = np.asarray(times, float), self.phase_at(times)
        starts = np.cumsum([0.0, *(phase.duration for phase in self.phases)])
        states = np.empty((self.scale.size, t.size))
        for k in np.unique(of):
            here = of == k
            states[:, here] = self._in_phase(self.phases[k], t[here] - starts[k]).T
        states[:, t >= starts[-1]] = self.phases[-1].end[:, None]  # more accurate than its polynomial
        return states

    def phase_at(self, times: Array) -> Array:
        """(m,) numbers of the phases in which times (m,) lie; at an event, of the next one."""
        ends = np.cumsum([phase.duration for phase in self.phases])
        return np.searchsorted(ends[:-1], np.asarray(times, float), side="right")

    def _in_phase(self, phase: Segment, t: Array) -> Array:
        """(m, n) states at times (m,) from the start of a phase on."""
        n = phase.end.size
        if phase.w.shape[1] == n:
            return flow_at(self.system.vector_form.modes[phase.mode], phase.start, t, self.p)
        part = t / phase.duration if phase.duration else np.zeros(t.size)
        i = np.clip(np.searchsorted(phase.breaks, part, side="right") - 1, 0, len(phase.w) - 1)
        tau = (part - phase.breaks[i]) / (phase.breaks[i + 1] - phase.breaks[i])
        matrix = scheme(phase.w.shape[1] // n - 1, self.kind).interpolation(tau)
        return np.einsum("mj,mjn->mn", matrix, phase.w.reshape(len(phase.w), -1, n)[i])

    def _columns(self) -> Columns:
        times, states = self.sample()
        return dict(zip(("t", *self.system.names.states), (times, *states), strict=False))


def sampled(
    system: engine.VectorSystem, phases: tuple[Segment, ...] | list[Segment], p: Array, kind: Kind, per_interval: int
) -> tuple[Array, Array]:
    """Marched phases at points.

    p, kind: parameter vector and collocation scheme of the march; per_interval: points in an interval; both ends of a
    phase are there besides. Returns times (m,) from the start, states (n, m).
    """
    tau = np.linspace(0, 1, per_interval, endpoint=False)
    times, states, start = [], [], 0.0
    for phase in phases:
        n = phase.end.size
        if phase.w.shape[1] == n:
            times.append(start + phase.duration * tau)
            states.append(flow_at(system.modes[phase.mode], phase.start, phase.duration * tau, p))
        else:
            matrix = scheme(phase.w.shape[1] // n - 1, kind).interpolation(tau)
            lengths = np.diff(phase.breaks)
            times.append((start + phase.duration * (phase.breaks[:-1, None] + lengths[:, None] * tau)).ravel())
            states.append(np.einsum("kj,ijn->ikn", matrix, phase.w.reshape(len(phase.w), -1, n)).reshape(-1, n))
        start += phase.duration
        times.append(np.array([start]))
        states.append(phase.end[None])
    return np.concatenate(times), np.concatenate(states).T
