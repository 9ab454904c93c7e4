"""The curve of the equilibria of a mode in one parameter: its points, tangents and corrections.

    f(x; p) = 0 along s:    f_x x' + f_p p' = 0,    |(x, lambda)'| = 1,    x and lambda in units of their own

A point is n + 1 numbers with an exact Jacobian, without phases, mesh or error estimate: of the walk along a branch of
cycles (walk.py) and of that along special points (plane_curve.py, which has no Jacobian) these steps could share little
but the halving of a step that has failed.

Symbols: n states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..hybrid.language import System
from .equilibrium import NormalForm, normal_form, rates

Array = np.ndarray

CORRECTIONS, CORRECTED = 8, 1e-12
"""Newton steps after which a step has failed; length of the last one."""
LEAST_ALONG = 0.95
"""Cosine between the tangents at both ends of a step, at least: a fold is rounded in several."""
CROSSED = 1e-5
"""Smallest over largest singular value of [f_x f_p] at a point at which two curves cross, which is known to less."""
BESIDE_IT = 1e-8
"""A Lyapunov coefficient that changes its sign, or by its size, so far aside in units of the parameter is zero."""

KINDS = FOLD_POINT, HOPF, BRANCH_POINT, BOUNDARY = "fold", "Hopf", "branch point", "boundary"
"""What is met on a branch of equilibria."""


@dataclass(frozen=True, eq=False)
class Place:
    """A point of the curve: y = (x, lambda), its tangent, of length one in these units, and the monitors there."""

    y: Array
    tangent: Array
    units: Array
    values: Array


class Curve:
    """f(x; p) = 0 as a curve in (x, one parameter)."""

    def __init__(self, system: System, mode: str, p: Array, vary: str) -> None:
        self.system, self.p, self.i = system, p, system.names.parameters.index(vary)
        form = system.vector_form
        self.mode, self.exits = form.modes[mode], form.exits[mode]

    def at(self, value: float) -> Array:
        """(np,) the parameters."""
        p = self.p.copy()
        p[self.i] = value
        return p

    def tangent(self, y: Array, units: Array, like: Array) -> Array | None:
        """The direction of the curve at a point.

        y, units, like: (n + 1,) each: the point, units of its entries, and a direction that it makes an acute angle
        with. Returns (n + 1,) y' in these units, of length one; None where the field is not finite.
        """
        here = rates(self.mode.field, self.mode.sign, y[:-1], self.at(y[-1]))
        if not here.finite:
            return None
        matrix = np.column_stack([here.A, here.by_p[:, self.i]]) * units
        size = np.linalg.norm(matrix, axis=1, keepdims=True)
        found = np.linalg.svd(matrix / np.where(size > 0, size, 1.0))[2][-1]
        return found if float(found @ like) >= 0 else -found

    def corrected(self, y: Array, row: Array, units: Array) -> tuple[Array, int] | None:
        """The point of the curve in a plane.

        y, row, units: (n + 1,) each: a point of the plane, the direction that is orthogonal to it, and the units of
        both. Returns the point and the number of Newton steps; None where they do not converge.
        """
        for k in range(CORRECTIONS):
            here = rates(self.mode.field, self.mode.sign, y[:-1], self.at(y[-1]))
            if not here.finite:
                return None
            matrix = np.vstack([np.column_stack([here.A, here.by_p[:, self.i]]) * units, row])
            try:
                step = np.linalg.solve(matrix, np.append(here.f, 0.0))
            except np.linalg.LinAlgError:
                return None
            y = y - step * units
            if np.linalg.norm(step) <= CORRECTED * max(1.0, float(np.linalg.norm(y / units))):
                return y, k + 1
        return None

    def ahead(self, place: Place, ds: float) -> tuple[Place, int] | None:
        """The point a step further on.

        place, ds: where the step begins, and its length along the tangent there.
        Returns the point and the number of Newton steps; None where the curve turns away.
        """
        guess = place.y + ds * place.tangent * place.units
        found = self.corrected(guess, place.tangent, place.units)
        if found is None or np.linalg.norm((found[0] - guess) / place.units) > abs(ds):
            return None
        tangent = self.tangent(found[0], place.units, place.tangent)
        if tangent is None or float(tangent @ place.tangent) < LEAST_ALONG:
            return None
        return self.place(found[0], tangent, place.units), found[1]

    def in_units(self, place: Place, units: Array) -> Place:
        """A point in other units.

        place, units: the point, and (n + 1,) units of its entries.
        """
        tangent = place.tangent * place.units / units
        return replace(place, tangent=tangent / np.linalg.norm(tangent), units=units)

    def eigenvalues(self, y: Array) -> Array:
        """(n,) of f_x, the one that grows fastest first."""
        values = np.linalg.eigvals(rates(self.mode.field, self.mode.sign, y[:-1], self.at(y[-1])).A).astype(complex)
        return values[np.argsort(-values.real, kind="stable")]

    def margins(self, y: Array) -> Array:
        """What must not be negative for the equilibrium to be one of the mode: `holds`, and its events."""
        x, p = y[:-1], self.at(y[-1])
        found = [] if self.mode.admissible is None else [float(self.mode.admissible(x, p, self.mode.sign))]
        for way_out in self.exits:
            if not way_out.mark or way_out.reset is not None:
                found.append(-way_out.direction * float(way_out.event.function(x, 0.0, p)))
        return np.array(found)

    def place(self, y: Array, tangent: Array, units: Array) -> Place:
        """A point with the functions that change sign at a special point, in the order of `KINDS`.

        y, tangent, units: (n + 1,) each, as of `Place`.
        """
        mu = self.eigenvalues(y)
        sums = [(a + b) / (abs(a) + abs(b) or 1.0) for a, b in combinations(mu, 2)]
        det = np.prod(mu / (np.max(np.abs(mu)) or 1.0)).real
        inside = float(np.min(self.margins(y), initial=np.inf))
        inside = inside / (1 + abs(inside)) if math.isfinite(inside) else 1.0
        return Place(y, tangent, units, np.array([tangent[-1], np.prod(sums).real if sums else 1.0, det, inside]))

    def normal_form(self, place: Place, omega: float) -> NormalForm | None:
        """The normal form of a Hopf bifurcation, its Lyapunov coefficient 0 where it is one of a point aside.

        Returns NormalForm; None where another eigenvalue is zero there, or the pair is two real ones next to it.
        """
        field, sign, x, value = self.mode.field, self.mode.sign, place.y[:-1], float(place.y[-1])
        aside = BESIDE_IT * float(place.units[-1])
        try:
            form = normal_form(field, sign, x, self.at(value), omega)
            other = normal_form(field, sign, x + aside * form.x_by_p[:, self.i], self.at(value + aside), omega)
        except np.linalg.LinAlgError:
            return None
        if not (form.omega > 0 and other.omega > 0 and math.isfinite(abs(form.c))):
            return None
        return form if abs(other.l1 - form.l1) < abs(form.l1) else form._replace(l1=0.0)

    def crossed(self, place: Place) -> bool:
        """Whether two curves of equilibria cross at a point: [f_x f_p] has a rank less than n there."""
        here = rates(self.mode.field, self.mode.sign, place.y[:-1], self.at(place.y[-1]))
        sizes = np.linalg.svd(np.column_stack([here.A, here.by_p[:, self.i]]) * place.units, compute_uv=False)
        return bool(sizes[-1] <= CROSSED * sizes[0])


def units_of(before: Array, y: Array) -> Array:
    """The units of a point.

    before, y: (n + 1,) those of the point before, zeros for none, and the point.
    Returns (n + 1,) the largest magnitudes so far; 1 for what has been zero.
    """
    larger = np.maximum(np.where(before == 1.0, 0.0, before), np.abs(y))
    return np.where(larger > 0, larger, 1.0)


def value_of(kind: str, place: Place) -> float:
    """The function that changes sign at a kind of special point.

    kind, place: one of `KINDS`, and a point.
    """
    return float(place.values[KINDS.index(kind)])
