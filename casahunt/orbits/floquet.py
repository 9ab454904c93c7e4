"""Floquet multipliers of a collocation solution.

The end-to-start maps A_e of the intervals (collocation/transcription.py) are the exact sensitivities of the implicit
Runge-Kutta integrator that collocation is.  Their product around the cycle, with a saltation matrix at
every event where the field or the state jumps, x+ = R(x),

    DR + (f+ - DR f-) h_x^T / (h_x . f-),

and the closure S give the half-period map S A_E ... A_1.  The flow direction f is its eigenvector to +1,
since x(t + T/2) = S x(t); the other eigenvalues are the half multipliers mu, and the Floquet multipliers
of the full period are mu^repeats.  mu = +1 is a fold, mu = -1 breaks the symmetry.

Three things make the numbers trustworthy:

* The trivial direction is divided out.  At every node P holds an orthonormal basis of the complement of
  f; the product of P'^T A P is the linearised Poincare map.  Near a fold, where mu meets the trivial 1 in
  a defective pair, an eigenvalue solver on the full map loses half the digits; here nothing meets.
* On unstable branches the product spans 20 decades and must not be formed: graded.py.
* They are computed on two meshes (`compared`).  The trivial multiplier says nothing about the others where the flow
  expands by much or contracts by much, and the sign of a multiplier that one mesh shows may be wrong.

The full map is iterated too: how far its trivial multiplier is from 1 is the health figure.

What is smaller than arithmetic or the mesh can resolve is bounded, not given.  Factors carry tiny multipliers to all
digits, 1e-68 as well as 1; but an interval in which the flow contracts by e^-z has the stability function of its scheme
in the place of e^-z, whose size for a large z is 1 (Gauss) or z^-1 (Radau).  The coarser mesh then shows the larger
value, and both are above the true one.

Symbols: n states, E elements, P phases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ..collocation.interval import point_function
from ..collocation.transcription import Linearisation, Setting, Transcription
from ..compiled import alone
from ..errors import NoOrbit, Status
from ..hybrid.system import Mode
from .graded import LARGEST_MULTIPLIER, spectrum

Array = np.ndarray

GROWTH = 100.0
"""An integrator starts anew from the orbit where disturbances have grown by this factor."""
TRUSTED = 1e-5
"""A set whose trivial multiplier or whose leading one is off by more than this is not to be trusted."""
FACTOR_ROUNDING = 10 * float(np.finfo(float).eps)
"""Noise of a factor, in units of its largest entry."""
STATE_ERROR = 1e-12
"""Error of the states at an event on a mesh made for multipliers, in units of their scale."""
SHARE_LEFT = 0.1
"""Error of a multiplier in units of its difference from that on a mesh of intervals twice as long: measured, 1e-2 to
1e-5 where the field is smooth, 1e-1 where kinks lie inside intervals."""
NOT_THE_SAME = 0.1
"""Values of one multiplier on two meshes that differ by more than this, relative, are bounds of it only."""


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Floquet multipliers of one periodic orbit.

    Attributes
    ----------
    half : (n,) complex eigenvalues of the half-period map (of the period map for a full cycle): the
        trivial one first, then by decreasing modulus.
    full : (n,) complex multipliers of the full period, in the same order.
    leading : the nontrivial entry of `half` of largest modulus.
    log10_leading : log10 |leading|.
    trivial_error : |trivial multiplier - 1|, the health figure; inf where a multiplier was cut to `LARGEST_MULTIPLIER`.
    error : estimated error of `leading`, relative where that is above 1 in size; inf where only one mesh was seen.
    rounding : the part of `error` that is rounding's.
    floor : (n,) bounds on the moduli of those entries of `half` of which no more is known, because rounding or the mesh
        hides them; 0 for the others.
    repeats : how many half-period maps make up the period.
    frame : (n - 1, n - 1) transversal directions at the start, by decreasing growth.
    """

    half: Array
    full: Array
    leading: complex
    log10_leading: float
    trivial_error: float
    error: float
    rounding: float
    floor: Array
    repeats: int
    frame: Array = field(repr=False)

    @property
    def leading_floor(self) -> float:
        """The bound on |leading| where no more is known of it, else 0."""
        return float(np.max(self.floor[1:2], initial=0.0))

    @property
    def full_floor(self) -> Array:
        """(n,) bounds like `floor`, for the entries of `full`."""
        return np.asarray(self.floor**self.repeats)

    @property
    def stable(self) -> bool:
        """All nontrivial multipliers inside the unit circle."""
        return abs(self.leading) < 1

    @property
    def trusted(self) -> bool:
        """The trivial multiplier came out as 1, and the leading one the same on two meshes."""
        return self.trivial_error < TRUSTED and self.error < TRUSTED


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
    """
    through = np.eye(f_before.size) if jump is None else jump
    return through + np.outer(f_after - through @ f_before, h_x) / float(h_x @ f_before)


def collocation_chain(t: Transcription, u: Array, setting: Setting, lin: Linearisation | None = None) -> MapChain:
    """The period map from the condensed collocation blocks, states scaled; `lin` where they are linearised already."""
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


def chain_multipliers(chain: MapChain, repeats: int) -> Multipliers:
    """The multipliers of a period map in factors; `repeats` of it make up the period.  Of one mesh: error unknown."""
    found = spectrum(transversal(chain), np.array([*chain.noise, FACTOR_ROUNDING]))
    others = found.values.astype(complex)
    trivial = _trivial(spectrum(chain.factors).values.astype(complex), others)
    leading = complex(others[0]) if others.size else 0j
    half = np.concatenate([[trivial], others])
    floor = np.concatenate([[0.0], found.floor])
    return Multipliers(
        half=half,
        full=half**repeats,
        leading=leading,
        log10_leading=float(np.log10(max(abs(leading), 1e-300))),
        trivial_error=float(abs(trivial - 1)) if np.max(np.abs(half)) < 0.99 * LARGEST_MULTIPLIER else math.inf,
        error=math.inf,
        rounding=max(float(found.uncertainty) * min(1.0, abs(leading)), *map(float, floor[:2])),
        floor=floor,
        repeats=repeats,
        frame=found.frame,
    )


def rough_multipliers(t: Transcription, u: Array, setting: Setting, frame: Array) -> Array:
    """(n - 1,) half multipliers without the trivial one, to be compared with those of `frame` on another mesh."""
    return spectrum(transversal(collocation_chain(t, u, setting)), frame=frame).values


def compared(found: Multipliers, coarse: Array, share: float = SHARE_LEFT) -> Multipliers:
    """With the error and the bounds that the half multipliers (n - 1,) on a coarser mesh show, without the trivial one.

    The error is `share` of the difference where that is small; meshes that show nothing alike bound what is below 1,
    and say nothing of the rest.  An entry that is not the same on both is below the larger of the two.
    """
    own, other = np.abs(found.half[1:]), np.abs(coarse)
    unlike = np.abs(own - other) > NOT_THE_SAME * own
    floor = np.maximum(found.floor[1:], np.where(unlike, np.maximum(own, other), 0.0))
    size = abs(found.leading)
    off = float(np.min(np.abs(found.leading - coarse), initial=math.inf)) if coarse.size else 0.0
    if off > NOT_THE_SAME * size:
        off, share = max(own[0], other[0]), 1.0
        off = off if off < 1 else math.inf
    error = max(share * off / max(1.0, size), found.rounding, found.trivial_error)
    return replace(found, error=float(error), floor=np.append(0.0, floor))


def transversal(chain: MapChain) -> list[Array]:
    """The factors (n - 1, n - 1) on the complements of the flow, in orthonormal bases."""
    bases = _complements(np.array(chain.flows))
    found = bases[1:].transpose(0, 2, 1) @ np.array(chain.factors) @ bases[:-1]
    # The last basis belongs to S f(end) = f(start), the first one to f(start): turn one into the other.
    return [*found, bases[0].T @ bases[-1]]


def _complements(flows: Array) -> Array:
    """Orthonormal bases (m, n, n - 1) of the complements of the directions (m, n)."""
    n = flows.shape[1]
    unit = np.array([f / np.linalg.norm(f) for f in flows])
    spanning = np.concatenate([unit[:, :, None], np.broadcast_to(np.eye(n), (len(flows), n, n))], axis=2)
    return np.linalg.qr(spanning)[0][:, :, 1:n]


def _trivial(full: Array, others: Array) -> complex:
    """The eigenvalue of the full map that belongs to no transversal one.

    Next to a fold it forms a defective pair with mu and only the sum of the two is accurate.
    """
    order = np.argsort(np.abs(full - 1))
    nearest = complex(full[order[0]])
    if others.size and full.size > 1:
        partner = complex(others[np.argmin(np.abs(others - 1))])
        if abs(partner - 1) < 0.1:
            return complex(full[order[0]] + full[order[1]]) - partner
    return nearest


def multipliers(t: Transcription, u: Array, setting: Setting, lin: Linearisation | None = None) -> Multipliers:
    """The Floquet multipliers of a converged solution, from its collocation blocks; `lin` as in `collocation_chain`."""
    return chain_multipliers(collocation_chain(t, u, setting, lin), t.cycle.repeats)
