"""The linearised map of a cycle, in factors, by two routes.

The end-to-start maps A_e of the intervals (collocation/transcription.py) are the exact sensitivities of the implicit
Runge-Kutta integrator that collocation is.  With a saltation matrix at every event where the field or the state jumps,
x+ = R(x),

    DR + (f+ - DR f-) h_x^T / (h_x . f-),

and the closure S they give the map of the computed piece, S A_E ... A_1.  The second route takes the sensitivities of
CasADi's own integrators in the place of the A_e.

Symbols: n states, E elements, P phases.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..collocation.batched_newton import Corrected
from ..collocation.interval import point_map
from ..collocation.node_system import Linearisation
from ..collocation.transcription import Setting, Transcription
from ..compiled import alone
from ..errors import NoOrbit, Status
from ..hybrid.system import Cycle, Field, VectorMode

Array = np.ndarray

GROWTH = 100.0
"""An integrator starts anew from the orbit where disturbances have grown by this factor."""
FACTOR_ROUNDING = 10 * float(np.finfo(float).eps)
"""Noise of a factor, in units of its largest entry."""
STATE_ERROR = 1e-12
"""Error of the states at an event on a mesh made for multipliers, in units of their scale."""


@dataclass(frozen=True, eq=False)
class MapChain:
    """A period map in factors.

    Attributes
    ----------
    factors : (m, n, n) matrices in time order, the closure last.
    flows : (m + 1, n) flow directions before the first factor and after each factor.
    noise : (m,) uncertainty of the entries of each factor.
    elements : (E,) which of the factors belong to elements; the others are saltations and the closure.
    """

    factors: Array
    flows: Array
    noise: Array
    elements: Array = field(default_factory=lambda: np.zeros(0, dtype=int))

    def flow_defects(self) -> Array:
        """(E,) by how much the map of every element misses the flow behind it, relative: what its mesh leaves.

        A f- = f+ for the exact maps: of all directions it is the one whose image is known.
        """
        off, behind = self._flows_missed()
        return off / np.where(behind > 0, behind, 1.0)

    @property
    def jumps_by(self) -> float:
        """The most that the map of an element misses the flow, of the larger one at its ends: not small, a field jumps.

        Where the time is a state its map is exact, and the trivial multiplier 1, whatever the others are.
        """
        off, behind = self._flows_missed()
        size = np.maximum(behind, np.linalg.norm(self.flows[self.elements], axis=1))
        return float(np.max(off / np.where(size > 0, size, 1.0), initial=0.0))

    def _flows_missed(self) -> tuple[Array, Array]:
        """(E,) |A f- - f+| and |f+| of every element."""
        behind = self.flows[self.elements + 1]
        image = (self.factors[self.elements] @ self.flows[self.elements][:, :, None])[:, :, 0]
        return np.linalg.norm(image - behind, axis=1), np.linalg.norm(behind, axis=1)


def saltation(f_before: Array, f_after: Array, h_x: Array, jump: Array | None = None) -> Array:
    """Saltation matrix (n, n) of an event: DR + (f+ - DR f-) h_x' / (h_x f-).

    f_before, f_after: (n,) the field in front of the event and behind it; h_x: (n,) gradient of the event; jump: (n, n)
    derivative DR of the state behind by the state in front; None where the state does not jump.
    Returns (n, n); not finite where the motion stands still on the event, next to an equilibrium.
    """
    through = np.eye(f_before.size) if jump is None else jump
    with np.errstate(divide="ignore", invalid="ignore"):
        return through + np.outer(f_after - through @ f_before, h_x) / np.float64(h_x @ f_before)


def collocation_chain(t: Transcription, u: Array, setting: Setting, lin: Linearisation | None = None) -> MapChain:
    """The period map from the condensed collocation blocks.

    lin: the equations linearised there, where that is known. Returns MapChain, states scaled.
    """
    lin = lin or t.linearise(u, setting)
    return _chain(t.cycle, (t.phase_start, t.phase_end), t.nodes_of(u), setting, (lin.maps, lin.events, lin.closure))


def refined_chain(solved: Corrected) -> MapChain:
    """`collocation_chain` of a solution on the mesh of its parts.

    Returns MapChain, states scaled.
    """
    places, setting = (solved.phase_start, solved.phase_end), solved.member.setting.moved(solved.parameter)
    return _chain(solved.member.t.cycle, places, solved.nodes, setting, (solved.maps, solved.events, solved.closure))


def _chain(
    cycle: Cycle, places: tuple[Array, Array], nodes: Array, setting: Setting, linear: tuple[Array, Array, Array]
) -> MapChain:
    """The period map from maps, events and closure of a linearisation, the phases between the nodes `places`."""
    maps, events, closure = linear
    n, along = nodes.shape[1], _flows(cycle, places, nodes, setting)
    pieces = [(maps[start:end, :, 1 : n + 1], flows) for start, end, flows in zip(*places, along, strict=True)]
    return _closed(pieces, _jumps(cycle, places[1], maps), events[1 : n + 1], closure)


def _jumps(cycle: Cycle, ends: Array, maps: Array) -> list[Array | None]:
    """DR (n, n) of the jump at the end of every phase, None where the state does not jump."""
    return [
        None if phase.reset is None else maps[end, :, 1 : maps.shape[1] + 1]
        for phase, end in zip(cycle.phases, ends, strict=True)
    ]


def integrator_chain(t: Transcription, u: Array, setting: Setting, *, tol: float = 1e-12) -> MapChain:
    """The period map from the forward sensitivities of CasADi's own integrators, phase by phase.

    An independent second route: explicit Runge-Kutta (`erk`) where the mode is not stiff, `rosenbrock`
    where it is.  The orbit gives the states at which phases start and their durations, and states inside a phase where
    disturbances have grown by `GROWTH` since the last one: no integrator follows an orbit that repels it by 1e14.

    tol: relative tolerance of the integrators. Returns MapChain, states scaled. Raises NoOrbit: an integrator fails.
    """
    lin = t.linearise(u, setting)
    nodes, durations = t.nodes_of(u), t.durations_of(u)
    starts, along = t.phase_start, _flows(t.cycle, (t.phase_start, t.phase_end), nodes, setting)
    pieces = []
    for k, phase in enumerate(t.cycle.phases):
        inside = slice(starts[k], t.phase_end[k])
        maps = lin.maps[inside, :, 1 : t.n + 1]
        cuts = np.array([0, 1]) if phase.mode.flow is not None else _cuts(maps)
        flows = along[k][cuts]
        if phase.mode.flow is not None:
            pieces.append(([maps[0]], flows))
            continue
        lengths = setting.fractions[t.phase_intervals(k)]
        at = np.concatenate([[0.0], np.cumsum(lengths)]) / np.sum(lengths) * durations[k]
        try:
            factors = _sensitivities(phase.mode, setting, tol, nodes[starts[k] + cuts[:-1]], np.diff(at[cuts]))
        except _IntegratorFailed as error:
            raise NoOrbit(
                f"the multipliers by the integrators were not computed: CasADi's {_integrator_of(phase.mode)} failed "
                f"in the phase {phase.mode.name!r}, which lasts {durations[k]:.6g} s; collocation does not need it",
                Status.NOT_CONVERGED,
            ) from error
        pieces.append((factors, flows))
    return _closed(pieces, _jumps(t.cycle, t.phase_end, lin.maps), lin.events[1 : t.n + 1], lin.closure)


def _cuts(maps: Array) -> Array:
    """Numbers of the nodes of a phase, first and last among them, between which no disturbance grows by much."""
    cuts, product = [0], np.eye(maps.shape[1])
    for e, factor in enumerate(maps[:-1], start=1):
        product = factor @ product
        if float(np.max(np.abs(product))) > GROWTH:
            cuts.append(e)
            product = np.eye(maps.shape[1])
    return np.array([*cuts, len(maps)])


class _IntegratorFailed(Exception):
    """CasADi's integrator did not reach the end."""


def _integrator_of(mode: VectorMode) -> str:
    return "rosenbrock" if mode.stiff else "erk"


@alone
def _sensitivities(mode: VectorMode, setting: Setting, tol: float, starts: Array, durations: Array) -> list[Array]:
    """(n, n) sensitivity of the end to the start of each way (m, n), (m,), states scaled.

    Raises _IntegratorFailed: it gave up, or came to no number.
    """
    n = setting.scale.size
    x, p, T = ca.SX.sym("x", n), ca.SX.sym("p", setting.p.size), ca.SX.sym("T")
    scale = ca.DM(setting.scale)
    rate = T * mode.field(scale * x, p, mode.sign) / scale
    flow = ca.integrator(
        "flow", _integrator_of(mode), {"x": x, "p": ca.vertcat(p, T), "ode": rate}, 0.0, 1.0,
        {"abstol": tol, "reltol": tol, "max_num_steps": 1_000_000},
    )  # fmt: skip
    x0, parameters = ca.MX.sym("x0", n), ca.MX.sym("p", setting.p.size + 1)
    end = flow(x0=x0, p=parameters)["xf"]
    sensitivity = ca.Function("sensitivity", [x0, parameters], [ca.jacobian(end, x0)])
    found = []
    for start, duration in zip(starts, durations, strict=True):
        try:
            found.append(np.array(sensitivity(start, np.append(setting.p, duration))))
        except RuntimeError as error:
            # NotImplementedError, arguments that do not fit, is one too; and CasADi words an interrupt like a failure.
            if type(error) is not RuntimeError or "KeyboardInterrupt" in str(error):
                raise
            raise _IntegratorFailed from error
    return found


def _closed(pieces: Sequence[tuple[Any, Array]], jumps: list[Array | None], h_x: Array, closure: Array) -> MapChain:
    """Join the factors of the phases with saltation matrices and the closure."""
    starts, ends = (np.array([along[i] for _, along in pieces]) for i in (0, -1))
    follow = np.concatenate([starts[1:], np.linalg.solve(closure, starts[0])[None]])
    kinked = np.abs(follow - ends).max(axis=1) > 1e-9 * np.abs(ends).max(axis=1)
    factors: list[Array] = []
    flows: list[Array] = [starts[:1]]
    saltations: list[int] = []
    count, slants = 0, []
    for k, (maps, along) in enumerate(pieces):
        factors.append(np.asarray(maps))
        flows.append(along[1:])
        count += len(maps)
        if kinked[k] or jumps[k] is not None:
            factors.append(saltation(ends[k], follow[k], h_x[:, k], jumps[k])[None])
            flows.append(follow[k : k + 1])
            saltations.append(count)
            slants.append(_slant(ends[k], h_x[:, k]))
            count += 1
    chain = np.concatenate([*factors, closure[None]])
    noise = np.abs(chain).max(axis=(1, 2))
    noise[saltations] *= slants
    is_element = np.ones(count, dtype=bool)
    is_element[saltations] = False
    noise[:count][is_element] *= FACTOR_ROUNDING
    noise[-1] = FACTOR_ROUNDING
    return MapChain(chain, np.concatenate([*flows, (closure @ flows[-1][-1])[None]]), noise, np.flatnonzero(is_element))


def _slant(f: Array, h_x: Array) -> float:
    """Relative uncertainty of h_x . f, and so of a saltation: large where the motion hardly crosses the event."""
    through = abs(float(h_x @ f))
    along = STATE_ERROR * float(np.linalg.norm(h_x) * np.linalg.norm(f))
    return along / through if through > 0 else math.inf


def _flows(cycle: Cycle, places: tuple[Array, Array], nodes: Array, setting: Setting) -> list[Array]:
    """Scaled fields (count + 1, n) of every phase at its nodes (E + 1, n), those between the two `places`."""
    (first, last), (fields, place, mode_signs) = places, _fields(cycle)
    sizes = last - first + 1
    behind = np.cumsum(sizes)
    x = nodes[np.arange(behind[-1]) + np.repeat(first - behind + sizes, sizes)]
    signs = np.repeat(mode_signs, sizes)
    if len(fields) == 1:
        found = point_map(fields[0], x.shape[1], setting.p.size)(x, signs, setting.p, setting.scale)
    else:
        found, of = np.empty_like(x), np.repeat(place, sizes)
        for i, field_ in enumerate(fields):
            at = point_map(field_, x.shape[1], setting.p.size)
            found[of == i] = at(x[of == i], signs[of == i], setting.p, setting.scale)
    return [found[end - size : end] for end, size in zip(behind.tolist(), sizes.tolist(), strict=True)]


@lru_cache(maxsize=16)
def _fields(cycle: Cycle) -> tuple[tuple[Field, ...], Array, Array]:
    """The vector fields of a cycle, and of every phase (P,) which one and the sign of its mode."""
    modes = [phase.mode for phase in cycle.phases]
    fields = tuple({mode.field: None for mode in modes})
    signs = np.array([float(mode.sign) for mode in modes])
    return fields, np.array([fields.index(mode.field) for mode in modes]), signs
