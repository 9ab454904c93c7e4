"""From a servo to an orbit: starting guess, solve, mesh adaptation, verdict.

    event map -> half cycle -> transcription -> IPOPT -> [ error estimate -> mesh -> solve ] -> Orbit

Nothing is taken on trust on the way: after every solve the phases must be admissible, or the next
admissible phase sequence is sought by marching from the solution; at the end the error estimate must be
below the tolerance.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from .admissibility import judge
from .checks import known, require
from .collocation import Kind
from .errors import InputError, NoOrbit, Status
from .event_map import SCHEMES, HalfCycle, half_cycle, near_stable, scan
from .hunting import MODELS, SYSTEMS, Model, hunting_cycle, mirrored, softened
from .march import MarchFailure, Segment, march
from .mesh import Estimate, better_breaks, estimate, halved_where, transfer
from .orbit import Orbit, orbit_of, setting_of
from .servo import Servo
from .solve import Solution, Solver, newton, solve
from .transcription import Setting, Transcription, transcribe

Array = np.ndarray
BranchName = Literal["stable", "unstable"]

TOLERANCE_RANGE = (1e-12, 1e-2)
"""Reachable tolerances: rounding below, meaningless meshes above."""
MAX_INTERVALS = 3000
MESH_ROUNDS = 14
MAX_SEQUENCES = 3


@dataclass(frozen=True)
class Options:
    """How orbits are computed; holds no problem data.

    Attributes
    ----------
    tol : relative tolerance of period and amplitude.
    solver : "ipopt" or "newton" for first solves; Newton corrects after a change of mesh.
    degree, kind : collocation scheme; None for the default of the model.
    half : exploit the symmetry x(t + T/2) = -x(t).
    """

    tol: float = 1e-6
    solver: Solver = "ipopt"
    degree: int | None = None
    kind: Kind | None = None
    half: bool = True

    def __post_init__(self) -> None:
        low, high = TOLERANCE_RANGE
        if not low <= require("tol", self.tol) <= high:
            raise InputError(f"tol = {self.tol:g}: must lie between {low:g} and {high:g}")

    def scheme_of(self, model: Model) -> tuple[int, Kind]:
        """(degree, kind) for a model."""
        degree, kind = SCHEMES[model]
        return self.degree or degree, self.kind or kind


@dataclass(frozen=True, eq=False)
class Solved:
    """An orbit in the solver's terms.

    Attributes
    ----------
    t, solution, setting, estimate : transcription, its solution, the numbers, the error.
    status : verdict.
    iterations : total over all meshes.
    """

    t: Transcription
    solution: Solution
    setting: Setting
    estimate: Estimate | None
    status: Status
    iterations: int
    note: str = ""


def guess_from_segments(
    model: Model, servo: Servo, gain: float, segments: list[Segment], options: Options
) -> tuple[Transcription, Array, Setting]:
    """Transcription, unknowns and setting of a marched half cycle (mirrored for a full cycle).

    A march that starts with negative velocity is mirrored first, so that every cycle starts its phase
    sequence with the positive slip.
    """
    degree, kind = options.scheme_of(model)
    n = segments[0].end.size
    signature = tuple((s.mode, s.event) for s in segments)
    sign = -1.0 if signature[0][0].endswith("-") else 1.0
    if sign < 0:
        signature = mirrored(signature)
    cycle = hunting_cycle(model, signature, half=options.half)
    passes = (sign,) if options.half else (sign, -sign)
    counts, w, nodes, fractions, durations = [], [], [], [], []
    for factor in passes:
        for segment in segments:
            collocated = SYSTEMS[model].modes[segment.mode].flow is None
            counts.append(len(segment.w) if collocated else 0)
            durations.append(segment.duration)
            nodes.append(factor * segment.w[:, :n])
            if collocated:
                w.append(factor * segment.w)
                fractions.append(np.diff(segment.breaks))
    nodes.append(passes[-1] * segments[-1].end[None])
    t = transcribe(cycle, tuple(counts), degree, kind)
    all_w, all_nodes = np.vstack(w), np.vstack(nodes)
    scale = np.max(np.abs(np.vstack([all_nodes, all_w.reshape(-1, n)])), axis=0)
    u = t.pack(all_w / np.tile(scale, degree + 1), all_nodes / scale, np.array(durations))
    return t, u, setting_of(servo, gain, np.concatenate(fractions), scale)


def solve_adaptively(
    model: Model, t: Transcription, u: Array, setting: Setting, options: Options, *, solver: Solver
) -> Solved:
    """Solve at fixed parameters and adapt mesh and phase sequence until the tolerance holds."""
    iterations, sequences = 0, 0
    solution = solve(t, u, setting, solver=solver)
    accepted: Solved | None = None
    for _ in range(MESH_ROUNDS):
        iterations += solution.iterations
        if not solution.status.ok and solver == "newton":
            solution = solve(t, u, setting, solver="ipopt")
            iterations += solution.iterations
        if not solution.status.ok:
            return accepted or Solved(t, solution, setting, None, solution.status, iterations)
        verdict = judge(t, solution.u, setting)
        if verdict.violated:
            sequences += 1
            again = resequence(model, t, solution.u, setting, options) if sequences <= MAX_SEQUENCES else None
            again = again or soften(model, t, solution.u, setting, verdict.phase)
            if again is None:
                return Solved(t, solution, setting, None, Status.INADMISSIBLE, iterations, verdict.violated)
            t, u, setting = again
        else:
            e = estimate(t, solution.u, setting)
            if not np.isfinite(e.error):
                return Solved(t, solution, setting, None, Status.NOT_FINITE, iterations)
            if e.error <= options.tol and verdict.admissible:
                return Solved(t, solution, setting, e, Status.CONVERGED, iterations)
            accepted = Solved(t, solution, setting, e, Status.TOLERANCE_NOT_REACHED, iterations)
            if e.error <= options.tol:
                breaks = halved_where(t, setting.fractions, verdict.unclear)
            else:
                breaks = better_breaks(t, setting.fractions, e, options.tol)
            if sum(b.size - 1 for b in breaks) > MAX_INTERVALS:
                return accepted
            t, u, fractions = transfer(t, solution.u, setting.fractions, breaks)
            setting = replace(setting, fractions=fractions)
        solver = "newton"
        solution = newton(t, u, setting)
    return accepted or Solved(t, solution, setting, None, Status.INADMISSIBLE, iterations)


def resequence(
    model: Model, t: Transcription, u: Array, setting: Setting, options: Options
) -> tuple[Transcription, Array, Setting] | None:
    """The phase sequence that the motion really has, by marching half a cycle from the start of u."""
    x = t.nodes_of(u)[0] * setting.scale
    mode = t.cycle.phases[0].mode.name
    degree, kind = t.degree, t.kind
    try:
        segments = march(
            SYSTEMS[model], mode, x, setting.p, scale=setting.scale,
            until=lambda s: s.mode == "stick" if model == "switch" else s.event == "centre",
            tol=1e-5, degree=degree, kind=kind,
        )  # fmt: skip
    except MarchFailure:
        return None
    if segments[-1].event == "" or tuple((s.mode, s.event) for s in segments) == t.cycle.signature:
        return None
    return _guess_like(model, segments, setting, replace(options, degree=degree, kind=kind))


def soften(
    model: Model, t: Transcription, u: Array, setting: Setting, phase: int
) -> tuple[Transcription, Array, Setting] | None:
    """The same unknowns for the sequence with the kink left unsplit in `phase` (hunting.softened)."""
    half = t.cycle.repeats == 2
    signature = t.cycle.signature
    if not half:
        signature = signature[: len(signature) // 2]
    softer = softened(signature, phase % len(signature))
    if softer is None:
        return None
    cycle = hunting_cycle(model, softer, half=half)
    return transcribe(cycle, t.counts, t.degree, t.kind), u, setting


def _guess_like(
    model: Model, segments: list[Segment], setting: Setting, options: Options
) -> tuple[Transcription, Array, Setting]:
    t, u, fresh = guess_from_segments(model, Servo(), 1.0, segments, options)
    return t, u, replace(fresh, p=setting.p, dp=setting.dp)


def starting_half_cycle(
    servo: Servo, model: Model, gain: float, branch: BranchName
) -> tuple[HalfCycle | None, str]:
    """(a half cycle close to the wanted orbit or None, the evidence of the scan in words).

    The LuGre cycle mostly lies close to the Switch cycle, whose map costs a tenth; the full LuGre scan is
    for servos where that short cut does not lead to a stable fixed point.
    """
    if model == "lugre" and branch == "stable":
        rigid = scan("switch", servo, gain)
        if rigid.upper is not None:
            start = near_stable(model, servo, gain, rigid.upper.start)
            if start is not None:
                return start, ""
    seen = scan(model, servo, gain, want_lower=branch == "unstable")
    return (seen.upper if branch == "stable" else seen.lower), seen.sentence()


def find_orbit(
    servo: Servo,
    model: Model,
    gain: float,
    *,
    branch: BranchName = "stable",
    options: Options | None = None,
) -> Orbit:
    """The hunting cycle of a servo at one gain, from nothing but the servo.

    Parameters
    ----------
    servo, model, gain : the problem; gain > 0.
    branch : the stable cycle, or the unstable one that bounds its basin.
    options : tolerance and method.

    Returns
    -------
    Orbit with status CONVERGED.

    Raises
    ------
    InputError : a value out of range.
    NoOrbit : there is no such cycle (with the scan that shows it), or it could not be computed.
    """
    began = time.perf_counter()
    options = options or Options()
    known("model", model, MODELS)
    known("branch", branch, ("stable", "unstable"))
    require("gain", gain, above=0)
    if servo.friction.static == servo.friction.coulomb:
        raise NoOrbit(
            "no hunting limit cycle: static equals Coulomb friction, and without a Stribeck drop in the "
            "friction curve the integral action cannot sustain an oscillation (Bisoffi et al.); nothing was scanned"
        )
    start, evidence = starting_half_cycle(servo, model, gain, branch)
    if start is None:
        raise NoOrbit(f"no hunting limit cycle ({branch} branch) of the {model} servo at gain {gain:g}: {evidence}")
    if options.scheme_of(model) != SCHEMES[model]:
        degree, kind = options.scheme_of(model)
        start = half_cycle(model, servo, gain, start.start, degree=degree, kind=kind)
    solved = solve_adaptively(
        model, *guess_from_segments(model, servo, gain, start.segments, options), options, solver=options.solver
    )
    if not solved.status.ok or solved.estimate is None:
        raise NoOrbit(
            f"the {branch} hunting cycle of the {model} servo at gain {gain:g} was not computed: "
            f"{solved.status.advice}" + (f" ({solved.note})" if solved.note else ""),
            solved.status,
        )
    return orbit_of(
        solved.t, solved.solution, solved.setting, solved.estimate,
        model=model, servo=servo, gain=gain, status=solved.status, solver=options.solver,
        iterations=solved.iterations, wall_s=time.perf_counter() - began,
    )  # fmt: skip


