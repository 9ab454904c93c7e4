"""Floquet multipliers of a collocation solution.

The half-period map S A_E ... A_1 comes in factors (map_chain.py).  The flow direction f is its eigenvector to +1,
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
from typing import Any

import numpy as np

from ..collocation.transcription import Setting, Transcription
from ..results import Result
from .graded import LARGEST_MULTIPLIER, MULTIPLIER_ROUNDS, UNCERTAIN, spectrum
from .map_chain import FACTOR_ROUNDING, MapChain, collocation_chain

Array = np.ndarray

CLEARLY = 0.1
"""Eigenvalues of the return map are told from the unit circle by this without multipliers on meshes made for them."""
TRUSTED = 1e-5
"""A set whose trivial multiplier or whose leading one is off by more than this is not to be trusted."""
SHARE_LEFT = 0.1
"""Error of a multiplier in units of its difference from that on a mesh of intervals twice as long: measured, 1e-2 to
1e-5 where the field is smooth, 1e-1 where kinks lie inside intervals."""
NEXT_TO_TRIVIAL = 0.5
"""No multiplier that is smaller is taken for the trivial one."""


@dataclass(frozen=True, eq=False, repr=False)
class Multipliers(Result):
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

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> multipliers = find_cycle(belt, "slip", x=0.0, v=0.0).multipliers
    >>> multipliers.stable, multipliers.trusted, multipliers.trivial_error < 1e-6
    (True, True, True)
    """

    _quantities = ("leading +- leading_error", "trivial_error", "trusted")
    _details = ("error", "log10_leading", "half", "full", "floor", "repeats")

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
    def stable(self) -> bool | None:
        """All nontrivial multipliers inside the unit circle; None where their error does not tell."""
        size = abs(self.leading)
        return size < 1 if self.trivial_trusted and abs(size - 1) > self.leading_error else None

    @property
    def trivial_trusted(self) -> bool:
        """The trivial multiplier came out as 1."""
        return self.trivial_error < TRUSTED

    @property
    def trusted(self) -> bool:
        """The trivial multiplier came out as 1, and the leading one the same on two meshes."""
        return self.trivial_trusted and self.error < TRUSTED

    @property
    def leading_error(self) -> float:
        """Estimated absolute error of `leading`."""
        return self.error * max(1.0, abs(self.leading))


def clearly_attracts(M: Array) -> bool | None:
    """Whether all eigenvalues of a return map (n, n) lie inside the unit circle; None where that is not clear."""
    if not np.isfinite(M).all():
        return None
    largest = float(np.max(np.abs(np.linalg.eigvals(M)), initial=0.0))
    return None if abs(largest - 1) <= CLEARLY else largest < 1


def chain_multipliers(chain: MapChain, repeats: int, frame: Array | None = None) -> Multipliers:
    """The multipliers of a period map in factors.

    repeats: how many of it make up the period; frame: (n - 1, n - 1) that of the multipliers on another mesh, where
    they are known. Returns multipliers, of one mesh: their error is unknown; no numbers where the motion stands still
    at a node, for rounding next to an equilibrium, and has no direction there.
    """
    if not _moves(chain):
        # Multipliers of which nothing is known
        n = len(chain.flows[0])
        nothing, nan = np.full(n, np.nan, complex), math.nan
        return Multipliers(
            half=nothing, full=nothing, leading=complex(nan), log10_leading=nan, trivial_error=math.inf, error=math.inf,
            rounding=math.inf, floor=np.full(n, math.inf), repeats=repeats, frame=np.eye(n - 1),
        )  # fmt: skip
    bases = _complements(np.asarray(chain.flows))
    found = spectrum(_transversal(chain, bases), np.append(chain.noise, FACTOR_ROUNDING), frame)
    others = found.values.astype(complex)
    # The flow among the transversal directions, by growth: where it comes first, a frame that is right at once.
    place, along = int(np.sum(np.abs(others) > 1)), chain.flows[0] / np.linalg.norm(chain.flows[0])
    start = np.insert(bases[0] @ found.frame, place, along, axis=1)
    trivial = _trivial(spectrum(chain.factors, frame=start, wanted=NEXT_TO_TRIVIAL).values.astype(complex), others)
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


def _moves(chain: MapChain) -> bool:
    """Whether the motion has a direction at every node."""
    return bool(np.isfinite(chain.factors).all() and np.any(chain.flows, axis=1).all())


def rough_multipliers(chain: MapChain, frame: Array | None = None) -> tuple[Array, Array]:
    """Half multipliers without the trivial one, to be compared with those on another mesh.

    frame: (n - 1, n - 1) that of the multipliers on the other mesh, where they are known.
    Returns (n - 1,) by decreasing modulus, and their frame; no numbers where the motion stands still at a node.
    """
    if not _moves(chain):
        n = len(chain.flows[0])
        return np.full(n - 1, np.nan), np.eye(n - 1)
    bases = _complements(np.asarray(chain.flows))
    found = spectrum(_transversal(chain, bases), frame=frame, rounds=MULTIPLIER_ROUNDS if frame is None else 1)
    return found.values, found.frame


def compared(found: Multipliers, coarse: Array, share: float = SHARE_LEFT) -> Multipliers:
    """With the error and the bounds that the half multipliers (n - 1,) on a coarser mesh show, without the trivial one.

    The error is `share` of the difference where that is small; meshes that show nothing alike bound what is below 1,
    and say nothing of the rest.  An entry that is not the same on both is below the larger of the two.

    coarse: (n - 1,) half multipliers on the coarser mesh; share: of the difference that is left on the finer one.
    Returns multipliers, `found` with `error` and `floor`.
    """
    own, other = np.abs(found.half[1:]), np.abs(coarse)
    unlike = np.abs(own - other) > UNCERTAIN * own
    floor = np.maximum(found.floor[1:], np.where(unlike, np.maximum(own, other), 0.0))
    size = abs(found.leading)
    off = float(np.min(np.abs(found.leading - coarse), initial=math.inf)) if coarse.size else 0.0
    if off > UNCERTAIN * size:
        off, share = max(own[0], other[0]), 1.0
        off = off if off < 1 else math.inf
    error = max(share * off / max(1.0, size), found.rounding, found.trivial_error)
    return replace(found, error=float(error), floor=np.append(0.0, floor))


def _transversal(chain: MapChain, bases: Array) -> Array:
    """(m + 1, n - 1, n - 1) the factors on the complements of the flow, in orthonormal bases (m + 1, n, n - 1)."""
    found = bases[1:].transpose(0, 2, 1) @ np.asarray(chain.factors) @ bases[:-1]
    # The last basis belongs to S f(end) = f(start), the first one to f(start): turn one into the other.
    return np.concatenate([found, (bases[0].T @ bases[-1])[None]])


def _complements(flows: Array) -> Array:
    """Orthonormal bases (m, n, n - 1) of the complements of the directions (m, n): Householder's reflection of each.

    H = I - v v^T / (1 + |f_1|), v = f + sign(f_1) e_1, takes f to -sign(f_1) e_1, and so e_2, ..., e_n to the others.
    """
    n = flows.shape[1]
    unit = flows / np.abs(flows).max(axis=1)[:, None]
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    first = np.copysign(1.0, unit[:, 0])
    v = unit.copy()
    v[:, 0] += first
    return np.eye(n)[:, 1:] - v[:, :, None] * (v[:, None, 1:] / (1 + np.abs(unit[:, 0]))[:, None, None])


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
    """The Floquet multipliers of a converged solution on its own mesh, from its collocation blocks."""
    return chain_multipliers(collocation_chain(t, u, setting), t.cycle.repeats)


def multiplier_record(m: Multipliers, half: bool) -> dict[str, Any]:
    """The multipliers of an orbit by name; None for what is not to be trusted, or not known for a full cycle.

    half: whether half a cycle was computed.
    """
    known = m.trusted and not m.leading_floor
    return {
        "half_multiplier": m.leading.real if m.trusted and half else None,
        "log10_abs_half_multiplier": m.log10_leading / (1 if half else 2) if known else None,
        "multipliers": m.full if m.trusted else None,
        "multipliers_below": [float(floor) or None for floor in m.full_floor] if m.trusted else None,
        "multiplier_error": m.error,
        "trivial_multiplier_error": m.trivial_error,
        "multipliers_trusted": m.trusted,
        "stable": m.stable,
    }
