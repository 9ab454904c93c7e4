"""The small cycle that is born at a Hopf bifurcation: where a branch of cycles begins.

    x(t) = x* + 2 Re(z q) + Re(z^2 h_20) + |z|^2 h_11 + x*' (lambda - lambda_0),    z = rho e^(i w t)
    lambda - lambda_0 = -Re c rho^2 / mu',    w = omega + Im c rho^2 + omega' (lambda - lambda_0)

(equilibrium.py) is what the boundary value problem starts from.  The cycle is cut by a plane through x*; its first node
is held as far from x* as rho says, the parameter free.  What is found is the cycle that is born there where what is
next to it grows with -2 mu' (lambda - lambda_0); else it is looked for nearer.

Symbols: n states.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from ..checks import of_kind, require
from ..collocation.scheme import scheme
from ..errors import InputError, NoOrbit, Status
from ..hybrid.language import Function, System
from ..hybrid.problem import Kind
from ..motion.phases import Segment
from ..orbits.adapt import Options
from ..orbits.closure import Closure, Section, with_sections
from ..orbits.family import Family, measured_of
from ..orbits.recurrence import is_symmetry, symmetries
from ..orbits.restart import from_segments
from ..orbits.system_orbit import SystemOrbit
from .curve import along, parameter_value, solved_along
from .equilibrium import HOPF, NormalForm
from .equilibrium_branch import SpecialEquilibrium

Array = np.ndarray

SMALL_CYCLE = 0.1
"""Radius of the first cycle, as a part of that at which the next terms are as large as those that are there."""
NEARER, BIRTHS = 0.3, 8
"""Where it is not found, a cycle of this part of the radius is looked for, until so many have failed."""
AS_BORN = 0.3
"""A cycle that is born follows the laws of lowest order to this part."""
KNOWN_TO_TOLERANCES = 100.0
"""They are known to so many tolerances."""
INTERVALS_OF_A_TURN = 12
"""A polynomial of degree 4 has a twelfth of an ellipse to 1e-6 of its size; from there the mesh is adapted."""
SEEN = 1e-6
"""A state that swings by less than this part of its size is no place to cut."""
SAME_VECTOR = 1e-8
"""Eigenvectors are mirror images to this."""


def born_at(
    hopf: SpecialEquilibrium,
    *,
    small: float = SMALL_CYCLE,
    measure: str | Function | None = None,
    options: Options | None = None,
) -> SystemOrbit:
    """The small cycle that is born at a Hopf bifurcation.

    Parameters
    ----------
    hopf
        a located point of a branch of equilibria (`equilibria`).
    small
        its size, between 0 and 1: at 1 it is no ellipse any more; smaller where the cycle of that size is not found.
    measure
        the state, or the function (x, p), whose largest magnitude is the amplitude: default the first state that is no
        angle.
    options
        tolerance and method; default a tolerance of 1e-9.

    Returns
    -------
    Orbit, stable or not, next to the bifurcation; the parameter is what it turns out to be.

    Raises
    ------
    InputError : cycles are not born at such a point, or the mode is stated in closed form.
    NoOrbit : the cycle was not computed.

    Examples
    --------
    >>> from casahunt.continuation import born_at, equilibria, follow
    >>> from casahunt.hybrid import Mode, System
    >>> def field(x, p):
    ...     return {"x": x.v, "v": p.mu * x.v - x.x - x.v**3}
    >>> rayleigh = System("Rayleigh's oscillator", ("x", "v"), {"mu": -1.0}, (Mode("smooth", field),))
    >>> (hopf,) = equilibria(rayleigh, vary="mu", to=1.0, x=0.0, v=0.0).special
    >>> cycle = born_at(hopf)
    >>> cycle.stable, abs(cycle.amplitude**2 / cycle.parameters["mu"] - 4 / 3) < 0.01
    (True, True)
    >>> branch = follow(cycle, "mu", to=1.0)
    >>> print(round(branch.values[-1], 6), round(branch.periods[-1], 4))
    1.0 6.6633
    """
    began = time.perf_counter()
    of_kind("hopf", hopf, SpecialEquilibrium)
    if not require("small", small, above=0.0) < 1:
        raise InputError(f"small = {small:g}: must lie between 0 and 1")
    if hopf.kind != HOPF or hopf.normal_form is None:
        raise InputError(f"{hopf.meaning}: must be a Hopf bifurcation, and no degenerate one; cycles are born there")
    if hopf.equilibrium.system.mode(hopf.equilibrium.mode).flow is not None:
        sentence = f"mode {hopf.equilibrium.mode!r} has a closed form, and its cycles are not computed"
        raise InputError(f"{sentence}; state it by its field alone")
    options, measured = options or Options(tol=1e-9), measured_of(hopf.equilibrium.system, measure)
    # The radius at which terms of the second or third order are as large as those of the first
    form = hopf.normal_form
    x = np.array(list(hopf.equilibrium.states.values()))
    size = np.where(x != 0, np.abs(x), 1.0)
    second = np.linalg.norm((np.abs(form.h_11) + np.abs(form.h_20)) / size) / np.linalg.norm(2 * form.q / size)
    third = math.sqrt(abs(form.c) / form.omega)
    largest = 1.0 / (max(float(second), third) or 1.0 / float(np.max(size)))
    for part in NEARER ** np.arange(BIRTHS):
        orbit = _solved(_foretold(hopf, hopf.normal_form, small * float(part) * largest), measured, options, began)
        if isinstance(orbit, SystemOrbit):
            return orbit
    raise NoOrbit(f"no cycle was computed next to the {hopf.meaning}: {orbit}", Status.NOT_CONVERGED)


@dataclass(frozen=True, eq=False)
class _NormalFormCycle:
    """A cycle next to a Hopf bifurcation as the normal form has it.

    Attributes
    ----------
    hopf, form : the bifurcation and its normal form.
    x, p : (n,) equilibrium and (np,) parameters at it.
    rho, by, w : radius, change of the parameter, frequency.
    k : number of the state at whose value in the equilibrium it is cut.
    """

    hopf: SpecialEquilibrium
    form: NormalForm
    x: Array
    p: Array
    rho: float
    by: float
    w: float
    k: int

    @property
    def system(self) -> System:
        """Whose cycle it is."""
        return self.hopf.equilibrium.system

    @property
    def parameter(self) -> int:
        """Number of the parameter that is followed."""
        return self.system.names.parameters.index(self.hopf.vary)

    def states(self, turns: Array) -> Array:
        """(..., n) states after parts of a turn; at 0 state k falls through its value in the equilibrium."""
        form, angle = self.form, math.pi / 2 - float(np.angle(self.form.q[self.k])) + 2 * math.pi * turns
        z = self.rho * np.exp(1j * angle)[..., None]
        swings = (2 * z * form.q + z**2 * form.h_20).real + self.rho**2 * form.h_11
        return np.asarray(self.x + self.by * form.x_by_p[:, self.parameter] + swings)


def _foretold(hopf: SpecialEquilibrium, form: NormalForm, rho: float) -> _NormalFormCycle:
    """The cycle of a radius."""
    here, names = hopf.equilibrium, hopf.equilibrium.system.names
    x, p = np.array(list(here.states.values())), np.array(list(here.parameters.values()))
    passes = complex(form.by_p[names.parameters.index(hopf.vary)])
    by = -form.c.real * rho**2 / passes.real if passes.real else 0.0
    w = form.omega + form.c.imag * rho**2 + passes.imag * by
    swings = np.abs(form.q)
    twisted = (np.abs(form.h_11) + np.abs(form.h_20)) / np.where(swings > 0, swings, 1.0)
    seen = (swings > 0) & (rho * swings >= SEEN * np.abs(x))
    turning = np.array([name in here.system.angles for name in names.states])
    worst = np.where(seen & ~turning, twisted, np.inf)
    k = int(np.argmin(worst if np.isfinite(worst).any() else np.where(seen, twisted, np.inf)))
    return _NormalFormCycle(hopf, form, x, p, rho, by, w, k)


def _segments(told: _NormalFormCycle, section: Section, degree: int, kind: Kind) -> list[Segment]:
    """The two halves of a turn, from plane to plane."""
    half, s = INTERVALS_OF_A_TURN // 2, scheme(degree, kind)
    breaks = np.linspace(0.0, 1.0, half + 1)
    found = []
    for first, way_out in zip((0.0, 0.5), section.exits(told.system.names.entries), strict=True):
        turns = first + (breaks[:-1, None] + np.diff(breaks)[:, None] * s.points) / 2
        states = told.states(turns)
        w = states.reshape(half, -1)
        end = told.states(np.array(first + 0.5))
        found.append(Segment(section.mode, way_out.event.name, math.pi / told.w, breaks, w, end))
    return found


def _mirrored(told: _NormalFormCycle, section: Section, segments: list[Segment], p: Array) -> Closure | None:
    """The symmetry that maps one half of the cycle to the other, where there is one."""
    q, x, form = told.form.q, told.x, with_sections(told.system, (section,))
    scale = np.max(np.abs(np.vstack([told.x, *(s.start for s in segments)])), axis=0)
    scale, still = np.where(scale > 0, scale, 1.0), np.zeros(x.size)
    for S in symmetries(told.system):
        alike = np.max(np.abs(S @ q + q)) <= SAME_VECTOR and np.all(np.abs(S @ x - x) <= SAME_VECTOR * scale)
        if alike and is_symmetry(form, segments, S, still, p, scale):
            return Closure.of(S, still, 2)
    return None


def _solved(told: _NormalFormCycle, measured: str | Function, options: Options, began: float) -> SystemOrbit | str:
    """The cycle that was foretold, or why it was not found."""
    hopf, system, n = told.hopf, told.system, told.x.size
    vary, state = hopf.vary, told.k
    section = Section(hopf.equilibrium.mode, system.names.states[state], float(told.x[state]),
                      float(max(abs(told.x[state]), 2 * told.rho * abs(told.form.q[state]))))  # fmt: skip
    p = told.p.copy()
    p[told.parameter] += told.by
    whole = Closure.of(np.eye(n), np.zeros(n), 1)
    problem = Family(system, tuple(map(float, p)), whole, vary, measured, (section,))
    degree, kind = options.scheme_of(problem)
    segments = _segments(told, section, degree, kind)
    if (closure := _mirrored(told, section, segments, p)) is not None:
        segments, problem = segments[:1], Family(system, problem.values, closure, vary, measured, (section,))
    cycle = problem.cycle(tuple((s.mode, s.event) for s in segments), problem.closure.repeats)
    start = from_segments(cycle, [(1.0, s) for s in segments], p, along(problem, vary), degree=degree, kind=kind)
    row = (segments[0].start - told.x) / start[2].scale
    row = np.append(row / np.linalg.norm(row), [0.0, 0.0])
    orbit: SystemOrbit | str = solved_along(problem, start, vary, row, options, began=began)
    if isinstance(orbit, str) or _as_born(orbit, told, options.tol):
        return orbit
    return f"the one found at {vary} = {parameter_value(orbit, vary):.8g} is another one"


def _as_born(orbit: SystemOrbit, told: _NormalFormCycle, tol: float) -> bool:
    """Whether what is next to a cycle grows as fast as the parameter foretells; where that is not known, the parameter.

    A fold of the cycles between it and the bifurcation would have turned the one round, and not the other.
    """
    gone = parameter_value(orbit, told.hopf.vary) - told.hopf.value
    unknown, passes = KNOWN_TO_TOLERANCES * tol, told.form.by_p[told.parameter].real
    if not orbit.multipliers.trusted:
        return bool(abs(gone - told.by) <= AS_BORN * abs(told.by) + unknown * orbit.problem.unit(told.hopf.vary))
    beside = orbit.multipliers.full[1:]
    grows = np.log(beside[np.argmin(np.abs(beside - 1))]).real / orbit.period
    return bool(abs(grows + 2 * passes * gone) <= AS_BORN * abs(2 * passes * gone) + unknown * told.form.omega)
