"""From a flip, or a loss of symmetry, to the cycles that branch off there.

A multiplier of the computed piece is -1: its equations with an antiperiodic closure are singular,

    J_k du = 0 in every phase,    x_0 = -S x_E:    the direction in which the map of the piece turns over.

Two pieces one after the other, the first moved by +eps du and the second by -eps du, are next to the new cycle: of
twice the period where the piece was the period, a lopsided one where it was half of a symmetric cycle.  The phases of
the second piece are those of the first, or their mirror images.  The new cycle is solved with its distance held and
the parameter free; it can be followed from there.

    lambda - lambda_0 = a eps^2,    d lambda/d eps = 2 a eps,    multipliers mu_i^2, one of them +1

A cycle is next to the point where its pieces are 2 eps du apart, where lambda follows this law, and where no multiplier
but the one that is +1 has gone through the unit circle: then there is no other special point between.  Else it is
looked for nearer.

A symmetric cycle whose symmetry a parameter breaks: from half a cycle to the whole.

    x(T/2) -> S^-1 (x(0) + c),  half of the phases      ->      x(T) -> x(0) + c',  all of them

A cycle that is found symmetric is computed on half its period.  A parameter along which the system loses the symmetry
takes it from the cycle, too; half of it solves equations that are no longer the system's.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from ..collocation.mesh import phase_breaks
from ..collocation.transcription import Setting, Transcription, transcribe
from ..errors import InputError, NoOrbit, Status
from ..hybrid.system import Signature
from ..hybrid.vector_form import TURNS
from ..motion.phases import Segment
from ..orbits.adapt import Options
from ..orbits.closure import Closure, Section, turned, with_sections
from ..orbits.family import Cycles
from ..orbits.orbit import AnyOrbit, Complaint, Orbit, unknowns_of
from ..orbits.recurrence import image_of
from ..orbits.restart import Start
from ..orbits.sequences import later, segments_of, start_of, uncut
from .bifurcations import FLIP, SYMMETRY_LOST
from .curve import along, curve_point, parameter_value, solved_along, solved_at
from .special_points import SpecialPoint

Array = np.ndarray

OFF = 0.02
"""Distance of the new cycle from the old one, in units of the state scale."""
OFF_AGAIN, OFF_TRIES = 0.25, 8
"""Where the new cycle is not found at a distance, it is looked for at this part of it, until so many have failed."""
BY_THE_LAW = 0.25
"""Next to the point the laws of lowest order in eps hold to this part; at a fold d lambda/d eps is off by all of it."""
KNOWN_TO = 10.0
"""lambda - lambda_0 is known to so many of the errors of lambda."""
TOLD_APART = 0.1
"""Part of the error of the orbit at the special point to which the new cycle is computed: lambda - lambda_0 is second
order in its distance, and off by what comes of another mesh."""
NEAR_ONE = 0.5
"""The multiplier that is +1 at the point has moved by less than this; where it has moved by 2 the next flip is met."""
SEVERAL = (
    "several cycles branch off there, and in which directions the multipliers do not tell; let what is equal differ a "
    "little, as by a parameter of one of equal units: then the points lie apart, and a cycle branches off at each"
)
"""What is said where several multipliers are -1."""
SINGULAR = 1e-4
"""Smallest over largest singular value below which there is a direction that turns over."""


def branch_off(
    special: SpecialPoint[AnyOrbit], vary: str, *, off: float = OFF, options: Options | None = None
) -> AnyOrbit:
    """The cycle that branches off: of twice the period at a flip, lopsided where a symmetric one loses its symmetry.

    Parameters
    ----------
    special
        a located flip or symmetry breaking of a cycle of a user's system.
    vary
        name of the parameter.
    off
        how far from the old cycle, in units of the state scale: a quarter of it, a sixteenth ... where the cycle as far
        off lies beyond another special point, or is not found; of a lopsided pair -off gives the other one.
    options
        tolerance and method; default a tenth of the error of the orbit at the special point, or 1e-8.

    Returns
    -------
    Orbit, next to the special point; the parameter is what it turns out to be.

    Raises
    ------
    InputError : nothing branches off at such a point.
    NoOrbit : the new cycle was not computed, or is the old one; or several branch off there.

    Examples
    --------
    >>> from casahunt.continuation import branch_off, follow
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> (flip,) = follow(orbit, "a", to=0.05).special
    >>> twice = branch_off(flip, "a")
    >>> round(twice.period / orbit.period, 6)
    2.0
    """
    began = time.perf_counter()
    orbit, family = special.orbit, cast(Cycles, special.orbit.problem)
    if special.kind not in (FLIP.kind, SYMMETRY_LOST.kind) or family.system is None:
        raise InputError(f"special point {special.kind!r}: must be a flip or a symmetry breaking of a system's cycle")
    if special.multiplicity > 1:
        raise NoOrbit(f"{special.meaning}: {SEVERAL}", Status.NOT_FOUND)
    options = options or Options(tol=max(TOLD_APART * orbit.error_estimate, 1e-8))
    # How two pieces close: x(start) = S S x(end) - (c + S c)
    S, c = np.array(family.closure.matrix), np.array(family.closure.shift)
    problem = family.closing(Closure.of(S @ S, c + S @ c, 1), _both_sections(family))
    t, u, setting = unknowns_of(orbit)
    du = _turned_over(t, u, setting)
    direction = du[t.node_index[0]]
    row = np.append(direction, [0.0, 0.0])
    for distance in off * OFF_AGAIN ** np.arange(OFF_TRIES):
        start = _two_pieces(orbit, family, problem, distance * du, along(family, vary))
        found = solved_along(problem, start, vary, row, options, began=began)
        if isinstance(found, Complaint):
            fault = found
            continue
        fault = Complaint(_not_next_to(found, orbit, vary, distance * direction), Status.NOT_CONVERGED)
        if not fault:
            return cast(AnyOrbit, found)
    raise NoOrbit(f"what branches off at the {special.meaning} was not computed: {fault}", fault.status)


def _not_next_to(found: Orbit, orbit: Orbit, vary: str, off: Array) -> str:
    """Why a cycle is not the one that branches off next to an orbit; "" where it is.

    `off` (n,) is where its first node was looked for, from that of the orbit, in units of the state scale.
    """
    if len(found.arcs) != 2 * len(orbit.arcs):
        return "the phases of the cycle next to it are others"
    point, second = curve_point(found, vary), len(orbit.arcs)
    rates = point.t.nodes_of(point.du)[point.t.phase_start] * point.setting.scale
    opened, scale = orbit.cycle.opened, orbit.scale
    still = opened(np.zeros(scale.size))
    along_it = (opened(off * scale) - still) / scale
    apart = (opened(found.arcs[0].states[0, 0]) - found.arcs[second].states[0, 0]) / (2 * scale)
    moving = (opened(rates[0]) - still - rates[second]) / (2 * scale)
    eps, rate = (float(x @ along_it) / float(along_it @ along_it) for x in (apart, moving))
    if not abs(eps - 1) <= BY_THE_LAW:
        return f"the cycle found next to it is {eps:.2g} times as far off as was asked (0 is the old one)"
    gone = orbit.problem.distance(vary, parameter_value(found, vary))
    unknown = KNOWN_TO * max(orbit.parameter_error, found.parameter_error)
    by_the_law = abs(eps * point.row[-1] / rate - 2 * gone) <= BY_THE_LAW * abs(2 * gone) + unknown
    if not (by_the_law and _same_sides(orbit, found)):
        return f"the cycle found at {vary} = {parameter_value(found, vary):.8g} lies beyond another special point"
    return ""


def _same_sides(orbit: Orbit, found: Orbit) -> bool:
    """Whether a cycle that branches off has its multipliers where two rounds of an orbit have them, one next to +1."""
    if not (orbit.multipliers.trusted and found.multipliers.trusted):
        return True
    twice, once = found.multipliers.full[1:], orbit.multipliers.half[1:]
    one, minus_one = int(np.argmin(np.abs(twice - 1))), int(np.argmin(np.abs(once + 1)))
    unstable = [int(np.sum(np.abs(np.delete(mu, k)) > 1)) for mu, k in ((twice, one), (once, minus_one))]
    return bool(abs(twice[one] - 1) <= NEAR_ONE and unstable[0] == unstable[1])


def _both_sections(family: Cycles) -> tuple[Section, ...]:
    """The sections of both pieces: turns of the forcing are counted on in the second, planes are mirrored."""
    entries, closure = family.system.names.entries, family.closure
    found = list(family.sections)
    for section in family.sections:
        i = entries.index(section.state)
        if section.state == TURNS or section.state in family.system.angles:
            second = replace(section, level=section.level + closure.shift[i])
        else:
            sign = family.system.mode(section.mode).sign if closure.matrix[i][i] < 0 else None
            image = section.mode if sign is None else next(
                (mode.name for mode in family.system.modes if mode.sign == -sign), section.mode)  # fmt: skip
            second = replace(section, mode=image, level=closure.matrix[i][i] * section.level)
        found += [] if second in found else [second]
    return tuple(found)


def _turned_over(t: Transcription, u: Array, setting: Setting) -> Array:
    """(size,) du with x_0 = -S x_E, its first node of length one in scaled states and its largest entry positive."""
    lin = t.linearise(u, setting)
    antiperiodic = replace(lin, closure=-lin.closure)
    matrix = t.system.dense(antiperiodic.matrix(t.system.border(parameter=1.0)))
    _, values, rows = np.linalg.svd(matrix)
    y = rows[-1]
    if not values[-1] < SINGULAR * values[0]:
        raise NoOrbit("no direction is turned over by the map here: nothing branches off", Status.NOT_CONVERGED)
    first = y[: t.n]
    return lin.expand(y, 0.0) / float(np.copysign(np.linalg.norm(first), first[np.argmax(np.abs(first))]))


def _two_pieces(orbit: Orbit, family: Cycles, problem: Cycles, du: Array, dp: Array) -> Start:
    """Two pieces of a cycle, the first moved by du and the second by -du."""
    t, u, setting = unknowns_of(orbit)
    signature = (*t.cycle.signature, *_second_piece(orbit, problem, setting))
    new = transcribe(problem.cycle(signature, 1), (*t.counts, *t.counts), t.degree, t.kind)
    first, second = u + du, u - du

    def opened(states: Array) -> Array:
        return t.cycle.opened(states * setting.scale) / setting.scale

    w = t.intervals_of(second).reshape(t.intervals, t.degree + 1, t.n)
    w = np.concatenate([t.intervals_of(first), opened(w).reshape(t.intervals, t.rows)])
    nodes = np.concatenate([t.nodes_of(first)[:-1], opened(t.nodes_of(second))])
    durations = np.concatenate([t.durations_of(first), t.durations_of(second)])
    fractions = np.concatenate([np.zeros(0), *(np.diff(b) for b in 2 * phase_breaks(t, setting.fractions))])
    return new, new.pack(w, nodes, durations), replace(setting, fractions=fractions, dp=dp)


def _second_piece(orbit: Orbit, both: Cycles, setting: Setting) -> Signature:
    """The phases that follow those of the computed piece, as `both` calls them: the images of those by S^-1 (x + c)."""
    form = with_sections(both.system, both.sections)
    shift = orbit.cycle.shift or tuple(np.zeros(orbit.scale.size))
    if orbit.repeats == 1 and not any(section.state == TURNS for section in both.sections):
        return orbit.signature
    closure, found = Closure.of(orbit.cycle.closure, np.array(shift), orbit.repeats), []
    for segment in segments_of(*unknowns_of(orbit)):
        image = image_of(form, segment, closure, setting.p, orbit.scale)
        if image is None:
            raise NoOrbit(f"no mode of {both.title} is the mirror image of {segment.mode!r}", Status.NOT_CONVERGED)
        found.append(image)
    return tuple(found)


LOOKED_FOR = (1.0, 0.618)
"""Parts of the way that the parameter is to go at which the symmetry is looked for."""
LITTLE = 0.1
"""The way where it has no end, in units of the parameter."""


def as_whole_as_needed(orbit: AnyOrbit, vary: Sequence[str], to: Sequence[float], options: Options) -> AnyOrbit:
    """A cycle whose computed piece stays a part of it along parameters.

    orbit, vary, to: the cycle, names of parameters, and values towards which they go, infinite where that is not known.
    Returns Orbit: the same; or the whole cycle, where a parameter breaks the symmetry by which half of it was computed.
    Raises NoOrbit: the whole cycle was not computed.
    """
    family = orbit.problem
    if family.system is None or orbit.repeats == 1:
        return orbit
    if keeps_symmetry(orbit, vary, to):
        return orbit
    found = _whole(orbit, options)
    if found is None:
        names = " and ".join(vary)
        sentence = f"along {names} the cycle of {family.title} loses its symmetry, and the whole of it was not computed"
        raise NoOrbit(f"{sentence}: start from a cycle at another {names}, where it has none", Status.NOT_CONVERGED)
    return found


def keeps_symmetry(orbit: AnyOrbit, vary: Sequence[str], to: Sequence[float]) -> bool:
    """Whether a cycle that is computed on a part of its period may stay so along parameters.

    orbit, vary, to: as in `as_whole_as_needed`.
    Returns True where the system has its symmetry all along, as far as one looks; and of what is no user's system.
    """
    family = orbit.problem
    if family.system is None or orbit.repeats == 1:
        return True
    places = _looked_at(cast(Cycles, family), vary, to)
    return all(_image(orbit, cast(Cycles, family.with_value(name, value))) is not None for name, value in places)


def _looked_at(family: Cycles, vary: Sequence[str], to: Sequence[float]) -> list[tuple[str, float]]:
    places = []
    for name, end in zip(vary, to, strict=True):
        here = family.value(name)
        way = end - here if math.isfinite(end) else math.copysign(LITTLE * family.unit(name), end)
        places += [(name, here + part * way) for part in LOOKED_FOR]
    return places


def _image(orbit: AnyOrbit, family: Cycles) -> tuple[list[Segment], tuple[Section, ...]] | None:
    """The other half of a cycle by the symmetry at some parameters, and the images of the planes that cut it.

    None where the system has not got that symmetry there.
    """
    own, posed = cast(Cycles, orbit.problem), family.asked()
    entries, found = family.system.names.entries, []
    planes: list[Section] = []
    of_mark = {event.event.name: s for s in own.sections for event in s.exits(entries)}
    segments = segments_of(*unknowns_of(orbit))
    for segment in segments:
        if segment.event in of_mark:
            section, end = of_mark[segment.event], later(posed.closure, segment).end
            level = float(end[entries.index(section.state)])
            planes += [replace(section, mode=mode, level=level) for mode in family.system.vector_form.modes]
    form = with_sections(family.system, (*own.sections, *planes))
    for segment in segments:
        names = image_of(form, segment, family.closure, family.vector(), orbit.scale)
        if names is None:
            return None
        found.append(replace(later(posed.closure, segment), mode=names[0], event=names[1]))
    return found, tuple(planes)


def _whole(orbit: AnyOrbit, options: Options) -> AnyOrbit | None:
    """The whole cycle, cut by no plane if it meets events; else by the image of the one that ended the half of it."""
    family, start = cast(Cycles, orbit.problem), unknowns_of(orbit)
    image = _image(orbit, family)
    if image is None:
        return None
    halves, (others, planes), entries = segments_of(*start), image, family.system.names.entries
    marks = {event.event.name: s for s in (*family.sections, *planes) for event in s.exits(entries)}
    last = others[-1]
    sections = tuple(s for s in planes if last.event in marks and s == replace(marks[last.event], mode=last.mode))
    segments = uncut((*halves, *others), marks)
    closure = Closure.of(np.eye(orbit.scale.size), turned(family.system, segments[0].start, segments[-1].behind), 1)
    whole = family.closing(closure, sections)
    return cast("AnyOrbit | None", solved_at(whole, start_of(whole.asked(), segments, start), options))
