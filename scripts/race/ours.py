"""casahunt on every scene: tolerances and choices, one correction with and without the closed stick, a whole diagram;
where its time goes, and its memory.
"""

from __future__ import annotations

import cProfile
import multiprocessing
import pstats
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from casahunt import NoOrbit, Options, find_fold, find_orbit
from casahunt.collocation.newton import newton
from casahunt.collocation.transcription import transcribe
from casahunt.continuation import special_points_between
from casahunt.continuation.special_points import FOLD
from casahunt.continuation.walk import walk
from casahunt.continuation.walk import walk_to_end as run_walk
from casahunt.hybrid.system import Cycle, Phase
from casahunt.interrupts import end_with_parent
from casahunt.orbits.orbit import unknowns_of
from problems import table1
from scripts.limits import peak_memory
from scripts.race.rows import GAINS, START, Row, best_of, orbit_error, reference

TOLERANCES = {"switch": (1e-3, 1e-5, 1e-7, 1e-8, 1e-9, 1e-11), "lugre": (1e-3, 1e-5, 1e-7, 1e-9, 1e-10)}
FOLD_TOLERANCE = {"switch": 1e-10, "lugre": 1e-9}


def casahunt_orbits(scene: str, model: str, repeats: int) -> list[Row]:
    """Tolerances, and at 1e-7 the choices: solver, symmetry, degree."""
    branch, row, gain = scene.removeprefix("orbit-"), reference(model, scene), GAINS[scene]
    variants = [(f"tol {tol:.0e}", "casahunt", Options(tol=tol)) for tol in TOLERANCES[model]]
    base = Options(tol=1e-7)
    variants += [("IPOPT alone", "casahunt, choices", replace(base, solver="ipopt"))]
    variants += [("full cycle", "casahunt, choices", replace(base, half=False))]
    degrees = (3, 5, 7, 9)
    variants += [(f"degree {d}", "casahunt, choices", replace(base, degree=d)) for d in degrees]
    rows = []
    for setting, method, options in variants:

        def action(options: Options = options) -> Any:
            return find_orbit(table1.servo(), model, gain, branch=branch, options=options)  # type: ignore[arg-type]

        try:
            seconds, orbit = best_of(repeats, action)
            rows.append(Row(scene, model, method, setting, seconds, orbit_error(orbit, row)))
        except NoOrbit as error:
            rows.append(Row(scene, model, method, setting, None, None, None, str(error)[:160]))
    return rows


def stick_rows(scene: str) -> list[Row]:
    """The Switch stick in closed form against the stick collocated like any other phase: one Newton correction."""
    orbit = find_orbit(table1.servo(), "switch", GAINS[scene], options=Options(tol=1e-9))
    t, u, setting = unknowns_of(orbit)
    rows = []
    closed = t.cycle
    stick = closed.phases[1]
    field_only = replace(stick.mode, flow=None)
    collocated = Cycle("switch half cycle, stick collocated", closed.states, closed.parameters,
                       (closed.phases[0], Phase(field_only, stick.end)), closed.closure, closed.repeats)  # fmt: skip
    intervals = 4
    t2 = transcribe(collocated, (t.counts[0], intervals), t.degree, t.kind)
    w, nodes, T = t.intervals_of(u), t.nodes_of(u), t.durations_of(u)
    edges = np.linspace(0, 1, intervals + 1)
    times = (edges[:-1, None] + np.diff(edges)[:, None] * t.scheme.points).ravel()
    a, b = nodes[-2], nodes[-1]
    straight = a + times[:, None] * (b - a)
    w2 = np.vstack([w, straight.reshape(intervals, -1)])
    nodes2 = np.vstack([nodes[:-1], a + edges[1:, None] * (b - a)])
    u2 = t2.pack(w2, nodes2, T)
    setting2 = replace(setting, fractions=np.concatenate([setting.fractions, np.diff(edges)]))
    for name, problem, start, how in (("closed-form stick", t, u, setting), ("collocated stick", t2, u2, setting2)):
        nudged = start * (1 + 1e-4)
        seconds, solution = best_of(20, lambda p=problem, n=nudged, h=how: newton(p, n, h))
        period = 2 * float(np.sum(problem.durations_of(solution.u)))
        error = abs(period / reference("switch", scene)["period"] - 1)
        note = f"{problem.size} unknowns, {solution.iterations} iterations"
        rows.append(Row(scene, "switch", "casahunt, one correction", name, seconds, error, None, note))
    return rows


def fold_rows(model: str, repeats: int) -> list[Row]:
    """find_fold at several tolerances."""
    rows = []
    for tol in TOLERANCES[model][1:]:
        seconds, fold = best_of(repeats, lambda t=tol: find_fold(table1.servo(), model, options=Options(tol=t)))  # type: ignore[arg-type]
        error = abs(fold.gain / reference(model, "fold")["K"] - 1)
        rows.append(Row("fold", model, "casahunt", f"tol {tol:.0e}", seconds, error))
    return rows


def whole_diagram(first: Any, tol: float, fold_tol: float) -> tuple[int, float]:
    """(points, fold gain): the walk with its error estimates and the located fold, and nothing else."""
    orbits, _ = run_walk(walk(first, low=START, high=1e3 * START, options=Options(tol=tol)))
    top = int(np.argmax([orbit.gain for orbit in orbits]))
    fold = float("nan")
    for before, after in ((top - 1, top), (top, top + 1)):
        options = Options(tol=fold_tol)
        found, _ = special_points_between(orbits[before], orbits[after], vary="gain", monitors=(FOLD,), options=options)
        fold = found[0].orbit.gain if found else fold
    return len(orbits) + 1, fold


SHARES = (
    ("collocation equations and their Jacobian (CasADi)", ("interval.py",)),
    ("stage elimination (numpy.linalg)", ("_linalg.py",)),
    ("node systems: sparse QR (CasADi)", ("node_system.py", "casadi.py", "_casadi")),
    ("assembly and Newton steps", ("joints.py", "transcription.py", "newton.py", "ipopt.py", "solve.py")),
    ("error estimate and meshes", ("mesh.py", "error_estimate.py", "remesh.py", "scheme.py", "adapt.py")),
    ("predictor, tangents, records", ("curve.py", "walk.py", "special_points.py", "orbit.py")),
    (
        "checks that a root is a motion",
        (
            "admissibility.py",
            "problem.py",
            "sequences.py",
            "restart.py",
            "phases.py",
            "march_step.py",
            "march_exits.py",
            "march_intervals.py",
            "march_watch.py",
            "segment.py",
            "interval_newton.py",
        ),  # fmt: skip
    ),
)


def where_the_time_goes(model: str) -> dict[str, float]:
    """Shares of the time of a whole diagram, by what is done."""
    start = find_orbit(table1.servo(), model, START, options=Options(tol=1e-9))  # type: ignore[arg-type]
    whole_diagram(start, 1e-7, FOLD_TOLERANCE[model])
    profile = cProfile.Profile()
    profile.enable()
    whole_diagram(start, 1e-7, FOLD_TOLERANCE[model])
    profile.disable()
    times: Counter[str] = Counter()
    for (file, _, name), (_, _, own, _, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        where = file + name
        times[next((what for what, parts in SHARES if any(part in where for part in parts)), "the rest")] += own
    return {what: seconds / sum(times.values()) for what, seconds in times.most_common()}


def memory_of(scene: str, model: str) -> float:
    """Peak memory [MB] of casahunt alone on one scene; to be called in a process of its own."""
    servo = table1.servo()
    if scene == "fold":
        find_fold(servo, model)  # type: ignore[arg-type]
    elif scene == "diagram":
        whole_diagram(find_orbit(servo, model, START), 1e-6, FOLD_TOLERANCE[model])  # type: ignore[arg-type]
    else:
        find_orbit(servo, model, GAINS[scene], branch=scene.removeprefix("orbit-"))  # type: ignore[arg-type]
    return peak_memory()


def memories(scenes: list[str], models: list[str]) -> dict[str, float]:
    """Peak memory [MB] of each scene."""
    tasks = [(scene, model) for scene in scenes for model in models]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=end_with_parent, max_tasks_per_child=1) as pool:
        found = [pool.submit(memory_of, *task) for task in tasks]
        return {" ".join(task): future.result() for task, future in zip(tasks, found, strict=True)}
