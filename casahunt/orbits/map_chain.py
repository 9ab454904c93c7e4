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
from typing import Any

import casadi as ca
import numpy as np

from ..collocation.interval import point_map
from ..collocation.linearisation import Linearisation
from ..collocation.transcription import Setting, Transcription
from ..compiled import alone
from ..errors import NoOrbit, Status
from ..hybrid.system import Mode

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
        behind = self.flows[self.elements + 1]
        image = (self.factors[self.elements] @ self.flows[self.elements][:, :, None])[:, :, 0]
        size = np.linalg.norm(behind, axis=1)
        return np.linalg.norm(image - behind, axis=1) / np.where(size > 0, size, 1.0)


def saltation(f_before: Array, f_after: Array, h_x: Array, jump: Array | None = None) -> Array:
    """Saltation matrix (n, n) of an event: DR + (f+ - DR f-) h_x' / (h_x f-).

    Parameters
    ----------
    f_before, f_after
        (n,) the field in front of the event and behind it.
    h_x
        (n,) gradient of the event.
    jump
        (n, n) derivative DR of the state behind by the state in front; None where the state does not jump.

    Returns
    -------
    (n, n); not finite where the motion stands still on the event, next to an equilibrium.
    """
    through = np.eye(f_before.size) if jump is None else jump
    with np.errstate(divide="ignore", invalid="ignore"):
        return through + np.outer(f_after - through @ f_before, h_x) / np.float64(h_x @ f_before)


def collocation_chain(t: Transcription, u: Array, setting: Setting, lin: Linearisation | None = None) -> MapChain:
    """The period map from the condensed collocation blocks.

    Parameters
    ----------
    t, u, setting
        a solution: transcription, unknowns, setting.
    lin
        the equations linearised there, where that is known.

    Returns
    -------
    MapChain, states scaled.
    """
    lin = lin or t.linearise(u, setting)
    along = _flows(t, t.nodes_of(u), setting)
    pieces = [
        (lin.maps[start:end, :, 1 : t.n + 1], flows)
        for start, end, flows in zip(t.phase_start, t.phase_end, along, strict=True)
    ]
    return _closed(pieces, _jumps(t, lin), lin.events[1 : t.n + 1], lin.closure)


def _jumps(t: Transcription, lin: Linearisation) -> list[Array | None]:
    """DR (n, n) of the jump at the end of every phase, None where the state does not jump."""
    return [
        None if phase.reset is None else lin.maps[end, :, 1 : t.n + 1]
        for phase, end in zip(t.cycle.phases, t.phase_end, strict=True)
    ]


def integrator_chain(t: Transcription, u: Array, setting: Setting, *, tol: float = 1e-12) -> MapChain:
    """The period map from the forward sensitivities of CasADi's own integrators, phase by phase.

    An independent second route: explicit Runge-Kutta (`erk`) where the mode is not stiff, `rosenbrock`
    where it is.  The orbit gives the states at which phases start and their durations, and states inside a phase where
    disturbances have grown by `GROWTH` since the last one: no integrator follows an orbit that repels it by 1e14.

    Parameters
    ----------
    t, u, setting
        a solution: transcription, unknowns, setting.
    tol
        relative tolerance of the integrators.

    Returns
    -------
    MapChain, states scaled.

    Raises
    ------
    NoOrbit : an integrator fails.
    """
    lin = t.linearise(u, setting)
    nodes, durations = t.nodes_of(u), t.durations_of(u)
    starts, along = t.phase_start, _flows(t, nodes, setting)
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
    return _closed(pieces, _jumps(t, lin), lin.events[1 : t.n + 1], lin.closure)


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


def _integrator_of(mode: Mode) -> str:
    return "rosenbrock" if mode.stiff else "erk"


@alone
def _sensitivities(mode: Mode, setting: Setting, tol: float, starts: Array, durations: Array) -> list[Array]:
    """(n, n) sensitivity of the end to the start of each way (m, n), (m,), states scaled.

    Raises
    ------
    _IntegratorFailed : it gave up, or came to no number.
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


def _closed(
    pieces: Sequence[tuple[Any, Array]], jumps: list[Array | None], h_x: Array, closure: Array
) -> MapChain:
    """Join the factors of the phases with saltation matrices and the closure."""
    starts = [along[0] for _, along in pieces]
    follow = [*starts[1:], np.linalg.inv(closure) @ starts[0]]
    factors: list[Array] = []
    noise: list[Any] = []
    flows: list[Any] = [starts[:1]]
    elements: list[Array] = []
    count = 0
    for k, (maps, along) in enumerate(pieces):
        maps = np.asarray(maps)
        factors.append(maps)
        noise.append(FACTOR_ROUNDING * np.abs(maps).max(axis=(1, 2)))
        flows.append(along[1:])
        elements.append(np.arange(count, count + len(maps)))
        count += len(maps)
        before, after = along[-1], follow[k]
        kinked = np.abs(after - before).max() > 1e-9 * np.abs(before).max()
        if kinked or jumps[k] is not None:
            jump = saltation(before, after, h_x[:, k], jumps[k])
            factors.append(jump[None])
            noise.append([_slant(before, h_x[:, k]) * float(np.abs(jump).max())])
            flows.append(after[None])
            count += 1
    last = flows[-1][-1]
    return MapChain(
        np.concatenate([*factors, closure[None]]),
        np.concatenate([*flows, (closure @ last)[None]]),
        np.concatenate([*noise, [FACTOR_ROUNDING]]),
        np.concatenate(elements),
    )


def _slant(f: Array, h_x: Array) -> float:
    """Relative uncertainty of h_x . f, and so of a saltation: large where the motion hardly crosses the event."""
    through = abs(float(h_x @ f))
    along = STATE_ERROR * float(np.linalg.norm(h_x) * np.linalg.norm(f))
    return along / through if through > 0 else math.inf


def _flows(t: Transcription, nodes: Array, setting: Setting) -> list[Array]:
    """Scaled fields (count + 1, n) of every phase at its nodes (E + 1, n)."""
    modes = [phase.mode for phase in t.cycle.phases]
    sizes = t.phase_end - t.phase_start + 1
    x = nodes[np.concatenate([np.arange(a, b + 1) for a, b in zip(t.phase_start, t.phase_end, strict=True)])]
    signs = np.repeat([float(mode.sign) for mode in modes], sizes)
    found = np.empty_like(x)
    for field_ in {mode.field: None for mode in modes}:
        chosen = np.repeat([mode.field == field_ for mode in modes], sizes)
        found[chosen] = point_map(field_, t.n, setting.p.size)(x[chosen], signs[chosen], setting.p, setting.scale)
    return np.split(found, np.cumsum(sizes)[:-1])
