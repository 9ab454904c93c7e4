"""A computed cycle as data: arcs, period, amplitude, error estimate, status, multipliers.

An `Orbit` is frozen numpy in physical units and knows everything needed to go on from it: the problem with its
parameters, the phase sequence, the mesh and the stages.  Multipliers are computed when they are read.

Symbols: n states, d stages, N intervals of an arc, m sample points.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar, TypeVar

import numpy as np

from .. import effort
from ..checks import whole_number
from ..collocation.error_estimate import Estimate
from ..collocation.joints import flow_at
from ..collocation.mesh import phase_breaks
from ..collocation.newton import Solution, Solver
from ..collocation.node_system import Linearisation
from ..collocation.scheme import Kind, scheme
from ..collocation.transcription import Setting, Transcription, transcribe
from ..errors import Status
from ..export import Columns
from ..hybrid.problem import Problem
from ..hybrid.system import Cycle, Signature
from ..results import Result
from . import floquet, map_chain
from .event_passage import Crossings, crossings
from .extrema import Extrema, extrema
from .multiplier_mesh import multipliers_of_many, refined_multipliers
from .observables import scalar_of

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Arc(Result):
    """One phase of an orbit.

    Attributes
    ----------
    mode, event : names of the phase's mode and of the event at its end.
    duration : [s].
    breaks : (N + 1,) interval boundaries as fractions of the duration.
    states : (N, d + 1, n) start and stages of each interval; (1, 1, n) for a closed-form phase.
    end : (n,) state at the end.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> [arc.mode for arc in find_cycle(belt, "slip", x=0.0, v=0.0).arcs]
    ['slip', 'stick']
    """

    _quantities = ("mode", "event", "duration")
    _details = ("breaks", "states", "end")

    mode: str
    event: str
    duration: float
    breaks: Array
    states: Array
    end: Array


@dataclass(frozen=True, eq=False, repr=False)
class Orbit(Result):
    """A periodic orbit of a hybrid system, in physical units.

    Attributes
    ----------
    problem : whose cycle it is, with its parameters.
    repeats : how often the computed arcs make up the period: 2 for a half cycle.
    degree, kind : collocation scheme.
    arcs : the computed phases.
    period, frequency : [s] of the full cycle, and 1/period [Hz].
    amplitude : largest magnitude of what is measured: of a state at the ends of the phases, or of a function over the
        whole cycle (Cycle.measured).
    period_error, amplitude_error : estimated relative errors.
    parameter_error : estimated relative error of the varied parameter itself, for points of a branch that
        were computed with it free, such as a fold; 0 where it was given.
    status : how the computation ended; only a CONVERGED orbit is to be trusted.
    solver, iterations, unknowns, residual : what the last solve did.
    wall_s : time from the request to the result [s].

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> round(orbit.period, 6), orbit.error_estimate < 1e-8, orbit.stable
    (12.001031, True, True)
    """

    _quantities: ClassVar[tuple[str, ...]] = (
        "problem = problem.title", "period ~ period_error", "amplitude ~ amplitude_error", "status",
    )  # fmt: skip
    _details: ClassVar[tuple[str, ...]] = (
        "frequency ~ period_error", "error_estimate", "parameter_error", "signature", "repeats", "degree", "solver",
        "unknowns", "iterations", "residual", "wall_s",
    )  # fmt: skip

    problem: Problem
    repeats: int
    degree: int
    kind: Kind
    arcs: tuple[Arc, ...]
    period: float
    amplitude: float
    period_error: float
    amplitude_error: float
    parameter_error: float
    status: Status
    solver: Solver
    iterations: int
    unknowns: int
    residual: float
    wall_s: float
    scale: Array = field(repr=False)

    @property
    def error_estimate(self) -> float:
        """Estimated relative error of period, amplitude and (where it was free) parameter: the largest."""
        return max(self.period_error, self.amplitude_error, self.parameter_error)

    @property
    def frequency(self) -> float:
        """1/period [Hz]."""
        return 1 / self.period

    @property
    def signature(self) -> Signature:
        """((mode, event), ...) of the computed phases."""
        return tuple((arc.mode, arc.event) for arc in self.arcs)

    @property
    def cycle(self) -> Cycle:
        """The boundary value problem that this orbit solves."""
        return self.problem.cycle(self.signature, self.repeats)

    @property
    def half(self) -> bool:
        """Computed on half a period, x(t + T/2) = S x(t)."""
        return self.repeats == 2

    @cached_property
    def multipliers(self) -> floquet.Multipliers:
        """Floquet multipliers, computed at the first reading on a mesh that is made for them."""
        place = linearised(self, self.problem.principal) if self.problem.names else (*unknowns_of(self), None)
        return multipliers_of_many([place], self.solver)[0]

    @cached_property
    def provisional_multiplier(self) -> float:
        """Largest real part of the multipliers of the orbit's own mesh, of half a period where half was computed.

        At a glance, without an error: a few digits of a large one, and of one beyond them not even its sign.  NaN where
        it could not be computed.
        """
        t, u, setting = unknowns_of(self)
        return leading_of(t.linearise(u, setting))

    @cached_property
    def seen_stable(self) -> bool | None:
        """`stable` for a picture: at a glance where that tells it clearly, by `multipliers` where it does not.

        A glance are the multipliers of the orbit's own mesh, which takes a thirtieth of the time.
        """
        t, u, setting = unknowns_of(self)
        seen = None
        with suppress(np.linalg.LinAlgError):
            seen = floquet.clearly_attracts(t.linearise(u, setting).return_map())
        return self.stable if seen is None else seen

    @cached_property
    def integrator_multipliers(self) -> floquet.Multipliers:
        """The multipliers by the second route: CasADi's own integrators, phase by phase (map_chain.integrator_chain).

        From the orbit on the mesh of `multipliers`: an error of the orbit grows as the multiplier says.  Their error is
        the difference of the two routes.
        """
        first, (t, u, setting) = refined_multipliers(*unknowns_of(self), solver=self.solver)
        second = floquet.chain_multipliers(map_chain.integrator_chain(t, u, setting), t.cycle.repeats)
        return floquet.compared(second, first.half[1:], share=1.0)

    @property
    def half_multiplier(self) -> float:
        """The leading nontrivial multiplier mu of the half-period map (real part); see floquet.py."""
        leading = self.multipliers.leading
        return leading.real if self.half else float("nan")

    @property
    def stable(self) -> bool | None:
        """All nontrivial Floquet multipliers inside the unit circle; None where their error does not tell."""
        return self.multipliers.stable

    def extrema(self, what: Any) -> Extrema:
        """Smallest and largest value of a state, or of an expression, over the cycle, with their errors.

        Parameters
        ----------
        what
            name of a state, or a function (x, p) of named states and parameters.

        Returns
        -------
        Extrema: low and high, each (value, time, error).

        Raises
        ------
        InputError : there is no such state, or the function returns no scalar.
        """
        cycle = self.cycle
        return extrema(*unknowns_of(self), scalar_of(what, self.problem.vocabulary(cycle.states)))

    def crossings(self, what: Any) -> Crossings:
        """Where a state or an expression goes through zero over the cycle: times, states, rates.  `what` and what is
        raised are as of `extrema`."""
        return crossings(*unknowns_of(self), scalar_of(what, self.problem.vocabulary(self.cycle.states)))

    def sample(self, per_interval: int = 8) -> tuple[Array, Array]:
        """The full period, dense where the motion is fast.

        Returns
        -------
        times : (m,) [s] from the start of the first phase, increasing; twice the same where the state jumps.
        states : (n, m).
        """
        s, per_interval = scheme(self.degree, self.kind), whole_number("per_interval", per_interval, at_least=1)
        tau = np.linspace(0, 1, per_interval, endpoint=False)
        matrix = s.interpolation(tau)
        cycle = self.cycle
        times, states, start = [], [], 0.0
        for arc, phase in zip(self.arcs, cycle.phases, strict=True):
            lengths = np.diff(arc.breaks)
            if phase.mode.flow is None:
                times.append((start + arc.duration * (arc.breaks[:-1, None] + lengths[:, None] * tau)).ravel())
                states.append(np.einsum("kj,ijn->ikn", matrix, arc.states).reshape(-1, arc.end.size))
            else:
                times.append(start + arc.duration * tau)
                states.append(flow_at(phase.mode, arc.states[0, 0], arc.duration * tau, self.problem.vector()))
            start += arc.duration
            if phase.reset is not None or arc is self.arcs[-1]:
                times.append(np.array([start]))
                states.append(arc.end[None])
        part_times, part = np.concatenate(times), np.concatenate(states)
        behind = 0 if cycle.phases[-1].reset is not None else 1
        t_all, x_all, piece = [part_times], [part], part
        for k in range(1, cycle.repeats):
            piece = cycle.opened(piece)
            t_all.append(part_times[behind:] + k * start)
            x_all.append(piece[behind:])
        return np.concatenate(t_all), np.concatenate(x_all).T

    _size_columns: ClassVar[tuple[str, str]] = ("amplitude", "period")
    """What amplitude and period are called in a table."""

    @property
    def _state_columns(self) -> tuple[str, ...]:
        """Names of time and states in its table."""
        return ("t", *self.cycle.states)

    def _columns(self) -> Columns:
        times, states = self.sample()
        return dict(zip(self._state_columns, (times, *states), strict=False))

    def _more(self) -> dict[str, Any]:
        return floquet.multiplier_record(self.multipliers, self.half)


AnyOrbit = TypeVar("AnyOrbit", bound=Orbit)
"""An orbit of whatever class its problem names; a function of one gives back the same class."""


def leading_of(linearisation: Linearisation) -> float:
    """Largest real part of the multipliers that a linearisation shows; NaN where they were not computed."""
    with suppress(np.linalg.LinAlgError):
        return float(linearisation.return_map_eigenvalues().real.max())
    return float("nan")


def unknowns_of(orbit: Orbit) -> tuple[Transcription, Array, Setting]:
    """The transcription, unknowns and setting that `orbit` solves."""
    cycle = orbit.cycle
    counts = tuple(
        0 if phase.mode.flow is not None else len(arc.states)
        for arc, phase in zip(orbit.arcs, cycle.phases, strict=True)
    )
    t = transcribe(cycle, counts, orbit.degree, orbit.kind)
    nodes = []
    for arc, phase in zip(orbit.arcs, cycle.phases, strict=True):
        nodes += [arc.states[:, 0], *([] if phase.reset is None else [arc.end])]
    last = orbit.arcs[-1].end if phase.reset is None else cycle.opened(orbit.arcs[0].states[0, 0])
    collocated = [arc for arc, count in zip(orbit.arcs, counts, strict=True) if count]
    w = np.concatenate([np.zeros((0, t.degree + 1, t.n)), *(arc.states for arc in collocated)])
    durations = np.array([arc.duration for arc in orbit.arcs])
    u = t.pack((w / orbit.scale).reshape(t.intervals, t.rows), np.vstack([*nodes, last]) / orbit.scale, durations)
    fractions = np.concatenate([np.zeros(0), *(np.diff(arc.breaks) for arc in collocated)])
    problem = orbit.problem
    return t, u, Setting(fractions, problem.vector(), orbit.scale, problem.direction(problem.principal))


def linearised(orbit: Orbit, vary: str) -> tuple[Transcription, Array, Setting, Linearisation]:
    """What `unknowns_of` says of an orbit, and the equations linearised there.

    Who follows a branch asks twice for every orbit, on the way there and on the way on, and its multipliers once more,
    some orbits later where they are computed for several at once (batched_newton.py).

    orbit, vary: the orbit, and the name of the parameter that lambda moves, in its units (Problem.unit).
    Returns transcription, unknowns, setting, and linearisation: not to be written into.
    """
    found = _linearised(orbit, vary)
    effort.problem(found[0].intervals)  # kept or not: when work is given up must not depend on what was asked before
    return found


@lru_cache(maxsize=12)
def _linearised(orbit: Orbit, vary: str) -> tuple[Transcription, Array, Setting, Linearisation]:
    t, u, setting = unknowns_of(orbit)
    setting = replace(setting, dp=orbit.problem.direction(vary) * orbit.problem.unit(vary))
    return t, u, setting, t.linearise(u, setting, counted=False)


class Complaint(str):
    """A sentence about what went wrong, with the status that it belongs to; None where no solve has ended so."""

    status: Status | None

    def __new__(cls, sentence: str, status: Status | None = None) -> Complaint:
        """A sentence and a status."""
        self = super().__new__(cls, sentence)
        self.status = status
        return self


@dataclass(frozen=True, eq=False)
class SolvedOrbit:
    """An orbit in the solver's terms.

    Attributes
    ----------
    t, solution, setting, estimate : transcription, its solution, the numbers, the error.
    status : verdict.
    iterations : total over all meshes.
    note : what is special about it, in words.
    off : how far the first solution lies from where its solver started, as a Newton step is measured.
    border : (n + 2,) weights of the border row (bordering.py) under which it was solved in the end; None: lambda held.
    """

    t: Transcription
    solution: Solution
    setting: Setting
    estimate: Estimate | None
    status: Status
    iterations: int
    note: str = ""
    off: float = np.inf
    border: Array | None = None

    def complaint(self) -> Complaint:
        """The advice of the status with the note."""
        return Complaint(self.status.advice + (f" ({self.note})" if self.note else ""), self.status)


def orbit_of(solved: SolvedOrbit, problem: Problem, *, wall_s: float) -> Any:
    """The orbit of a solution with an estimate.

    problem: with the parameters at which the equations were solved; wall_s: time that it took [s].
    Returns Orbit, of the class that the problem names.
    """
    t, solution, setting, error = solved.t, solved.solution, solved.setting, solved.estimate
    assert error is not None
    u = solution.u
    nodes = t.nodes_of(u) * setting.scale
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n) * setting.scale
    durations = t.durations_of(u)
    breaks = iter(phase_breaks(t, setting.fractions))
    arcs = []
    for k, phase in enumerate(t.cycle.phases):
        start, end = t.phase_start[k], t.phase_end[k]
        collocated = t.counts[k] > 0
        arcs.append(
            Arc(
                phase.mode.name,
                phase.end.name,
                float(durations[k]),
                next(breaks) if collocated else np.array([0.0, 1.0]),
                w[t.phase_intervals(k)].copy() if collocated else nodes[start][None, None],
                nodes[end].copy(),
            )
        )
    return (problem.orbit_type or Orbit)(
        problem=problem,
        repeats=t.cycle.repeats,
        degree=t.degree,
        kind=t.kind,
        arcs=tuple(arcs),
        period=float(np.sum(durations)) * t.cycle.repeats,
        amplitude=error.measured,
        period_error=error.period,
        amplitude_error=error.amplitude,
        parameter_error=error.parameter,
        status=solved.status,
        solver=solution.solver,
        iterations=solved.iterations,
        unknowns=t.size,
        residual=solution.residual,
        wall_s=wall_s,
        scale=setting.scale.copy(),
    )
