"""Floquet multipliers of a collocation solution.

The end-to-start maps A_e of the intervals (collocation/transcription.py) are the exact sensitivities of the implicit
Runge-Kutta integrator that collocation is.  Their product around the cycle, with a saltation matrix at
every event where the field or the state jumps, x+ = R(x),

    DR + (f+ - DR f-) h_x^T / (h_x . f-),

and the closure S give the half-period map S A_E ... A_1.  The flow direction f is its eigenvector to +1,
since x(t + T/2) = S x(t); the other eigenvalues are the half multipliers mu, and the Floquet multipliers
of the full period are mu^repeats.  mu = +1 is a fold, mu = -1 breaks the symmetry.

Two things make the numbers trustworthy:

* The trivial direction is divided out.  At every node P holds an orthonormal basis of the complement of
  f; the product of P'^T A P is the linearised Poincare map.  Near a fold, where mu meets the trivial 1 in
  a defective pair, an eigenvalue solver on the full map loses half the digits; here nothing meets.
* On unstable branches the product spans 20 decades and must not be formed.  Orthogonal iteration around
  the cycle, Q_{e+1} R_{e+1} = A_e Q_e, keeps each factor near one; after a few rounds Q has ordered the
  directions by growth, the product of the triangular factors is graded, and its small and large
  eigenvalues are both accurate.

The full map is iterated too: how far its trivial multiplier is from 1 is the health figure.

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

MULTIPLIER_ROUNDS = 12
ROUND_TOLERANCE = 1e-13
SMALLEST_MULTIPLIER = 1e-12
"""Half multipliers below this are zero for every purpose and do not delay the iteration."""
LARGEST_MULTIPLIER = 1e150
"""Half multipliers beyond this are cut to it, and the set is not trusted: their squares would overflow."""
GROWTH = 100.0
"""An integrator starts anew from the orbit where disturbances have grown by this factor."""
TRUSTED = 1e-5
"""A set whose trivial multiplier is off by more than this is not to be trusted."""


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
    """

    half: Array
    full: Array
    leading: complex
    log10_leading: float
    trivial_error: float

    @property
    def stable(self) -> bool:
        """All nontrivial multipliers inside the unit circle."""
        return abs(self.leading) < 1

    @property
    def trusted(self) -> bool:
        """The trivial multiplier came out as 1."""
        return self.trivial_error < TRUSTED


@dataclass(frozen=True, eq=False)
class MapChain:
    """A period map in factors.

    Attributes
    ----------
    factors : (n, n) matrices in time order, the closure last.
    flows : flow directions (n,) before the first factor and after each factor.
    """

    factors: list[Array]
    flows: list[Array]


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
    (n, n).
    """
    through = np.eye(f_before.size) if jump is None else jump
    return through + np.outer(f_after - through @ f_before, h_x) / float(h_x @ f_before)


def collocation_chain(t: Transcription, u: Array, setting: Setting) -> MapChain:
    """The period map from the condensed collocation blocks.

    Parameters
    ----------
    t, u, setting
        a solution: transcription, unknowns, setting.

    Returns
    -------
    MapChain, states scaled.
    """
    lin = t.linearise(u, setting)
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
    flows: list[Array] = [pieces[0][1][0]]
    start_flow = pieces[0][1][0]
    inverse = np.linalg.inv(closure)
    for k, (maps, along) in enumerate(pieces):
        factors += maps
        flows += list(along[1:])
        before = along[-1]
        after = pieces[k + 1][1][0] if k + 1 < len(pieces) else inverse @ start_flow
        kinked = float(np.max(np.abs(after - before))) > 1e-9 * float(np.max(np.abs(before)))
        if kinked or jumps[k] is not None:
            factors.append(saltation(before, after, h_x[:, k], jumps[k]))
            flows.append(after)
    factors.append(closure)
    flows.append(closure @ flows[-1])
    return MapChain(factors, flows)


@alone
def _field(t: Transcription, k: int, x: Array, setting: Setting) -> Array:
    """Scaled field (m, n) of phase k at the states x (m, n)."""
    mode = t.cycle.phases[k].mode
    f = point_function(mode.field, t.n, setting.p.size)
    return np.array(f(x.T, mode.sign, setting.p, setting.scale)).T


def product_eigenvalues(factors: list[Array]) -> Array:
    """Eigenvalues of factors[-1] ... factors[0], largest first, each to its own relative accuracy.

    Orthogonal iteration around the cycle; see the module docstring.  Moduli beyond `LARGEST_MULTIPLIER` are cut to it.
    """
    n = factors[0].shape[1]
    if n == 0:
        return np.zeros(0)
    q = np.linalg.qr(np.random.default_rng(1).standard_normal((n, n)))[0]
    previous = np.full(n, np.inf, dtype=complex)
    values = previous
    for _ in range(MULTIPLIER_ROUNDS):
        start, triangular, exponent = q, np.eye(n), 0
        for factor in factors:
            q, r = np.linalg.qr(factor @ q)
            triangular = r @ triangular
            size = float(np.max(np.abs(triangular)))
            if size > LARGEST_MULTIPLIER:  # by a power of two: no digit changes
                power = math.frexp(size)[1]
                triangular, exponent = np.ldexp(triangular, -power), exponent + power
        values = _cut(np.linalg.eigvals((start.T @ q) @ triangular), exponent)
        values = values[np.argsort(-np.abs(values), kind="stable")]
        alive = np.abs(values) > SMALLEST_MULTIPLIER
        change = np.abs(np.abs(values) - np.abs(previous))[alive] / np.abs(values[alive])
        if not alive.any() or float(np.max(change)) < ROUND_TOLERANCE:
            break
        previous = values
    return values


def _cut(values: Array, exponent: int) -> Array:
    """values 2^exponent, with moduli of at most `LARGEST_MULTIPLIER`."""
    with np.errstate(divide="ignore"):
        logs = np.log(np.abs(values)) + exponent * math.log(2)
    large = logs > math.log(LARGEST_MULTIPLIER)
    if not large.any():
        return values if exponent == 0 else np.ldexp(values.real, exponent) + 1j * np.ldexp(values.imag, exponent)
    size = np.where(values == 0, 1.0, np.abs(values))
    return values / size * np.where(large, LARGEST_MULTIPLIER, np.exp(np.minimum(logs, math.log(LARGEST_MULTIPLIER))))


def chain_multipliers(chain: MapChain, repeats: int) -> Multipliers:
    """The multipliers of a period map in factors.

    Parameters
    ----------
    chain
        the map.
    repeats
        how many of it make up the period.

    Returns
    -------
    Multipliers.
    """
    bases = [_complement(f) for f in chain.flows]
    transversal = [
        after.T @ factor @ before for before, factor, after in zip(bases, chain.factors, bases[1:], strict=False)
    ]
    # The last basis belongs to S f(end) = f(start), the first one to f(start): turn one into the other.
    transversal.append(bases[0].T @ bases[-1])
    others = product_eigenvalues(transversal).astype(complex)
    trivial = _trivial(product_eigenvalues(chain.factors).astype(complex), others)
    leading = complex(others[0]) if others.size else 0j
    half = np.concatenate([[trivial], others])
    return Multipliers(
        half=half,
        full=half**repeats,
        leading=leading,
        log10_leading=float(np.log10(max(abs(leading), 1e-300))),
        trivial_error=float(abs(trivial - 1)) if np.max(np.abs(half)) < 0.99 * LARGEST_MULTIPLIER else math.inf,
    )


def _complement(f: Array) -> Array:
    """Orthonormal basis (n, n - 1) of the complement of the direction f."""
    return np.linalg.qr(np.column_stack([f / np.linalg.norm(f), np.eye(f.size)]))[0][:, 1 : f.size]


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


def multipliers(t: Transcription, u: Array, setting: Setting) -> Multipliers:
    """The Floquet multipliers of a converged solution, from its collocation blocks.

    Parameters
    ----------
    t, u, setting
        the solution: transcription, unknowns, setting.

    Returns
    -------
    Multipliers.
    """
    return chain_multipliers(collocation_chain(t, u, setting), t.cycle.repeats)
