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
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..collocation.interval import point_function
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
    factors : (n, n) matrices in time order, the closure last.
    flows : flow directions (n,) before the first factor and after each factor.
    noise : uncertainty of the entries of each factor.
    """

    factors: list[Array]
    flows: list[Array]
    noise: list[float]


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
    nodes = t.nodes_of(u)
    pieces = []
    for k in range(t.phases):
        inside = range(t.phase_start[k], t.phase_end[k])
        flows = _field(t, k, nodes[t.phase_start[k] : t.phase_end[k] + 1], setting)
        pieces.append(([lin.maps[e, :, 1 : t.n + 1] for e in inside], flows))
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
    starts = t.phase_start
    pieces = []
    for k, phase in enumerate(t.cycle.phases):
        inside = slice(starts[k], t.phase_end[k])
        maps = lin.maps[inside, :, 1 : t.n + 1]
        cuts = np.array([0, 1]) if phase.mode.flow is not None else _cuts(maps)
        flows = _field(t, k, nodes[starts[k] + cuts], setting)
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
    pieces: list[tuple[list[Array], Array]], jumps: list[Array | None], h_x: Array, closure: Array
) -> MapChain:
    """Join the factors of the phases with saltation matrices and the closure."""
    factors: list[Array] = []
    noise: list[float] = []
    flows: list[Array] = [pieces[0][1][0]]
    start_flow = pieces[0][1][0]
    inverse = np.linalg.inv(closure)
    for k, (maps, along) in enumerate(pieces):
        factors += maps
        noise += list(FACTOR_ROUNDING * np.abs(np.array(maps)).max(axis=(1, 2)))
        flows += list(along[1:])
        before = along[-1]
        after = pieces[k + 1][1][0] if k + 1 < len(pieces) else inverse @ start_flow
        kinked = float(np.max(np.abs(after - before))) > 1e-9 * float(np.max(np.abs(before)))
        if kinked or jumps[k] is not None:
            factors.append(saltation(before, after, h_x[:, k], jumps[k]))
            noise.append(_slant(before, h_x[:, k]) * float(np.max(np.abs(factors[-1]))))
            flows.append(after)
    factors.append(closure)
    noise.append(FACTOR_ROUNDING)
    flows.append(closure @ flows[-1])
    return MapChain(factors, flows, noise)


def _slant(f: Array, h_x: Array) -> float:
    """Relative uncertainty of h_x . f, and so of a saltation: large where the motion hardly crosses the event."""
    through = abs(float(h_x @ f))
    along = STATE_ERROR * float(np.linalg.norm(h_x) * np.linalg.norm(f))
    return along / through if through > 0 else math.inf


@alone
def _field(t: Transcription, k: int, x: Array, setting: Setting) -> Array:
    """Scaled field (m, n) of phase k at the states x (m, n)."""
    mode = t.cycle.phases[k].mode
    f = point_function(mode.field, t.n, setting.p.size)
    return np.array(f(x.T, mode.sign, setting.p, setting.scale)).T
