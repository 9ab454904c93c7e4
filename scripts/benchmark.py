"""Run time against error: casahunt, AUTO-07p, solve_bvp and single shooting on the same problems in one run.

    python scripts/benchmark.py [--out DIR] [--quick] [--only orbit-stable orbit-unstable fold diagram]

Scenes, for the servo of Table 1 and both friction models:

    orbit-stable     K = 0.1, from nothing: the starting guess is part of the time
    orbit-unstable   K = 0.4, from nothing: casahunt goes round the fold; the peers start at the solution of 0.41
                     (shooting on the stable branch starts from a simulation, solve_bvp from the solution of 0.1025)
    fold             the largest gain, from nothing; AUTO's is that of its diagram
    diagram          from the stable orbit at K = 0.0321, given to casahunt and AUTO alike, round the fold to 0.0321;
                     casahunt's tolerance is that of the points, the fold is located to 1e-10 (Switch) or 1e-9
                     (LuGre); errors are the fold's

Errors are relative, against the reference values of problems/table1.py (two independent programs), never
against casahunt; they saturate at the digits of that table, about 1e-10.  Every time is the best of some repeats in
this process, without imports; AUTO's is that of its own process.  A peer that is missing, or that fails, is a row
with the reason.  Needs scipy (extra "bench"); AUTO-07p needs Debian's packages auto-07p and gfortran.
Writes benchmark.csv, benchmark.json, benchmark.png and the table to standard output.
"""

from __future__ import annotations

import argparse
import cProfile
import csv
import json
import multiprocessing
import platform
import pstats
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import casadi  # noqa: E402

from casahunt import NoOrbit, Options, find_fold, find_orbit  # noqa: E402
from casahunt.collocation.solve import newton  # noqa: E402
from casahunt.collocation.transcription import transcribe  # noqa: E402
from casahunt.continuation.special_points import FOLD, crossings  # noqa: E402
from casahunt.continuation.walk import run as run_walk  # noqa: E402
from casahunt.continuation.walk import walk  # noqa: E402
from casahunt.hybrid.system import Cycle, Phase  # noqa: E402
from casahunt.interrupts import end_with_parent  # noqa: E402
from casahunt.orbits.orbit import unknowns_of  # noqa: E402
from casahunt.servo.hunting import MODELS  # noqa: E402
from problems import table1  # noqa: E402

SCENES = ("orbit-stable", "orbit-unstable", "fold", "diagram")
START = 0.0321
TOLERANCES = {"switch": (1e-3, 1e-5, 1e-7, 1e-8, 1e-9, 1e-11), "lugre": (1e-3, 1e-5, 1e-7, 1e-9, 1e-10)}
SMALLEST_STEP, PATIENCE = 1e-3, 60.0
"""Relative step in K and seconds after which a peer's way down the unstable branch is over."""
LONG_ENOUGH, MOST_REPEATS = 0.5, 50
"""What takes milliseconds is repeated for so long [s], or so often: the best of a few is chance."""
DIAGRAM_REPEATS = {"switch": 4, "lugre": 1}
"""Times as many repeats of a whole diagram, for casahunt and AUTO alike."""
FOLD_TOLERANCE = {"switch": 1e-10, "lugre": 1e-9}
DIAGRAM_TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7)
GAINS = {"orbit-stable": 0.1, "orbit-unstable": 0.4}
AUTO_MESHES = {"switch": ((25, 4), (50, 4), (100, 4)), "lugre": ((400, 4), (800, 5), (1200, 4))}


@dataclass(frozen=True)
class Row:
    """One measurement; `error` and `seconds` are None where there is only a `note`."""

    scene: str
    model: str
    method: str
    setting: str
    seconds: float | None
    error: float | None
    points: int | None = None
    note: str = ""


def best_of(repeats: int, action: Callable[[], Any]) -> tuple[float, Any]:
    """(shortest time, last result) of so many repeats, and of more where they are short."""
    times: list[float] = []
    result = None
    while len(times) < repeats or (sum(times) < LONG_ENOUGH and len(times) < MOST_REPEATS):
        began = time.perf_counter()
        result = action()
        times.append(time.perf_counter() - began)
    return min(times), result


def reference(model: str, scene: str) -> dict[str, float]:
    """The row of the reference table that a scene is compared with."""
    if scene in ("fold", "diagram"):
        return table1.REFERENCE[model]["fold"]
    rows = table1.REFERENCE[model]["stable" if scene == "orbit-stable" else "unstable"]
    return next(row for row in rows if row["K"] == GAINS[scene])


def orbit_error(orbit: Any, row: dict[str, float]) -> float:
    """Largest relative error of amplitude and period."""
    return max(abs(orbit.amplitude / row["amplitude"] - 1), abs(orbit.period / row["period"] - 1))


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


def peer_orbits(scene: str, model: str) -> list[Row]:
    """solve_ivp shooting and solve_bvp on one orbit."""
    try:
        from scripts.peers import bvp, shooting
    except ImportError as error:
        return [Row(scene, model, "scipy", "", None, None, None, f"left out: {error}")]
    servo, gain, row = table1.servo(), GAINS[scene], reference(model, scene)
    branch = scene.removeprefix("orbit-")
    # What a simulation does not find starts at the cycle of a gain 2.5 % higher, which costs the peers nothing.
    near = find_orbit(servo, model, 1.025 * gain, branch=branch, options=Options(tol=1e-6))  # type: ignore[arg-type]
    known = unknowns_for_shooting(near)
    stable = branch == "stable"
    tasks: list[tuple[str, str, Callable[[], Any]]] = []
    for rtol in (1e-6, 1e-8, 1e-9, 1e-10) if model == "switch" else (1e-8, 1e-9):
        shoot = shooting.switch if model == "switch" else shooting.lugre
        guess = None if stable else known
        tasks.append(("solve_ivp shooting", f"rtol {rtol:.0e}", lambda t=rtol, g=guess, f=shoot: f(servo, gain, g, t)))
        if model == "switch":
            name = "solve_ivp shooting, reduced by hand"
            tasks.append(
                (name, f"rtol {rtol:.0e}", lambda t=rtol: shooting.switch_reduced(servo, gain, near.amplitude, t))
            )
    start = bvp.start_of(near)
    for tol in (1e-3, 1e-5, 1e-7, 1e-9) if model == "switch" else (1e-3, 1e-5, 1e-6):
        tasks.append(("solve_bvp", f"tol {tol:.0e}", lambda t=tol: bvp.solve(servo, model, gain, start, t)))
    rows = []
    for method, setting, action in tasks:
        began = time.perf_counter()
        try:
            seconds, shot = best_of(3 if model == "switch" else 1, action)
            rows.append(Row(scene, model, method, setting, seconds, orbit_error(shot, row)))
        except (shooting.Failed, np.linalg.LinAlgError, ValueError) as error:
            note = f"fails after {time.perf_counter() - began:.1f} s: {error}"
            rows.append(Row(scene, model, method, setting, None, None, None, note))
    return rows


def unknowns_for_shooting(orbit: Any) -> np.ndarray:
    """The unknowns of peers/shooting.py at an orbit of casahunt."""
    x = orbit.arcs[0].states[0, 0]
    states = x[[0, 2]] if orbit.model == "switch" else x[1:]
    return np.append(states, orbit.period / 2)


def peers_down_the_branch(model: str) -> list[Row]:
    """Down the unstable branch from K = 0.6, each solution the guess of the next, the step halved where one fails."""
    try:
        from scripts.peers import bvp, shooting
    except ImportError as error:
        return [Row("orbit-unstable", model, "scipy", "", None, None, None, f"left out: {error}")]
    servo = table1.servo()

    def truth(gain: float) -> Any:
        return find_orbit(servo, model, gain, branch="unstable", options=Options(tol=1e-8))  # type: ignore[arg-type]

    first = truth(0.6)
    rows = []
    for method in ("solve_ivp shooting", "solve_bvp"):
        start: Any = bvp.start_of(first) if method == "solve_bvp" else unknowns_for_shooting(first)
        reached, step, reason, began = 0.6, 0.02, "", time.perf_counter()
        while reached > START and step > SMALLEST_STEP and time.perf_counter() - began < PATIENCE:
            gain = max(reached * (1 - step), START)
            try:
                if method == "solve_bvp":
                    shot = bvp.solve(servo, model, gain, start, 1e-4)
                else:
                    shoot = shooting.switch if model == "switch" else shooting.lugre
                    shot = shoot(servo, gain, start, 1e-10 if model == "switch" else 1e-8)
                error = abs(shot.amplitude / truth(gain).amplitude - 1)
                if error > 1e-2:
                    raise shooting.Failed(f"another solution, its amplitude {error:.2g} off")
                start = bvp.start_of(truth(gain)) if method == "solve_bvp" else shot.unknowns
                reached, step = gain, min(2 * step, 0.05)
            except (shooting.Failed, np.linalg.LinAlgError, ValueError) as error:
                reason, step = str(error), step / 2
        ended = "the end" if reached <= START else f"then: {reason or 'out of time'}"
        if time.perf_counter() - began >= PATIENCE:
            ended = f"stopped after {PATIENCE:.0f} s"
        note = f"down to K = {reached:.4g}, {ended}"
        rows.append(Row("orbit-unstable", model, f"{method}, down the branch", "", None, None, None, note))
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
        found, _ = crossings(orbits[before], orbits[after], vary="gain", monitors=(FOLD,), options=options)
        fold = found[0].orbit.gain if found else fold
    return len(orbits) + 1, fold


def diagram_rows(model: str, repeats: int, quick: bool) -> list[Row]:
    """The whole diagram: casahunt and AUTO-07p, interleaved so that both see the same machine."""
    from scripts.peers import auto

    truth = reference(model, "fold")["K"]
    rows: dict[tuple[str, str], Row] = {}

    def keep(row: Row) -> None:
        old = rows.get((row.method, row.setting))
        if old is None or (row.seconds or 1e9) < (old.seconds or 1e9):
            rows[row.method, row.setting] = row

    start = find_orbit(table1.servo(), model, START, options=Options(tol=1e-9))  # type: ignore[arg-type]
    with tempfile.TemporaryDirectory() as folder:
        try:
            exe, missing = auto.compiled(model, Path(folder)), ""  # type: ignore[arg-type]
        except auto.Missing as error:
            missing = f"left out: {error}"
            keep(Row("diagram", model, "AUTO-07p", "", None, None, None, missing))
        for _ in range(repeats * DIAGRAM_REPEATS[model]):
            for tol in DIAGRAM_TOLERANCES:
                began = time.perf_counter()
                points, fold = whole_diagram(start, tol, FOLD_TOLERANCE[model])
                seconds = time.perf_counter() - began
                keep(Row("diagram", model, "casahunt", f"tol {tol:.0e}", seconds, abs(fold / truth - 1), points))
            meshes = AUTO_MESHES[model][-1:] if quick and model == "lugre" else AUTO_MESHES[model]
            for intervals, degree in meshes if not missing else ():
                setting = f"{intervals} x {degree}"
                if model == "lugre" and ("AUTO-07p", setting) in rows:
                    continue  # a minute each
                branch = auto.run(exe, start, intervals=intervals, points=degree, low=START)
                i = branch.fold
                error = abs(branch.gains[i] / truth - 1) if i is not None else None
                keep(Row("diagram", model, "AUTO-07p", setting, branch.seconds, error, len(branch.gains), branch.ended))
    return list(rows.values())


SHARES = (
    ("collocation equations and their Jacobian (CasADi)", ("interval.py",)),
    ("stage elimination (numpy.linalg)", ("_linalg.py",)),
    ("node systems: sparse QR (CasADi)", ("node_system.py", "casadi.py", "_casadi")),
    ("assembly and Newton steps", ("transcription.py", "solve.py")),
    ("error estimate and meshes", ("mesh.py", "scheme.py", "adapt.py")),
    ("predictor, tangents, records", ("walk.py", "special_points.py", "orbit.py")),
    (
        "checks that a root is a motion",
        ("admissibility.py", "hunting.py", "sequences.py", "restart.py", "march.py", "march_step.py", "march_exits.py"),
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


def table(rows: list[Row]) -> str:
    """The rows as text."""
    titles = f"{'scene':15s} {'model':7s} {'method':36s} {'setting':18s} {'seconds':>9s} {'error':>9s} {'points':>6s}"
    lines = [f"{titles}  note"]
    for r in rows:
        seconds = f"{r.seconds:9.4f}" if r.seconds is not None else f"{'-':>9s}"
        error = f"{r.error:9.1e}" if r.error is not None else f"{'-':>9s}"
        points = f"{r.points or '':>6}"
        line = f"{r.scene:15s} {r.model:7s} {r.method:36s} {r.setting:18s} {seconds} {error} {points}  {r.note}"
        lines.append(line.rstrip())
    return "\n".join(lines)


def ratios(rows: list[Row]) -> list[str]:
    """The comparisons that the project has promised, from the rows of this run."""

    def fastest(scene: str, model: str, method: str, error: float, setting: str = "") -> Row | None:
        fit = [r for r in rows if (r.scene, r.model, r.method) == (scene, model, method) and r.seconds is not None
               and r.error is not None and r.error <= error and (not setting or r.setting == setting)]  # fmt: skip
        return min(fit, key=lambda r: r.seconds or 0, default=None)

    out = []
    for model, error, setting, goal in (("lugre", 1e-8, "1200 x 4", 0.1), ("switch", 1e-10, "50 x 4", 1.0)):
        ours = fastest("diagram", model, "casahunt", error)
        peer = fastest("diagram", model, "AUTO-07p", 1.0, setting)
        if ours and peer and peer.seconds and ours.seconds:
            out.append(
                f"diagram, {model}: casahunt {ours.seconds:.3f} s ({ours.points} points, fold {ours.error:.0e}) / "
                f"AUTO-07p {setting} {peer.seconds:.3f} s ({peer.points} points, fold {peer.error:.0e}) = "
                f"{ours.seconds / peer.seconds:.3f}  (goal {goal})"
            )
    for model, goal in (("switch", 10), ("lugre", 5)):
        ours = fastest("orbit-stable", model, "casahunt", 1e-8)
        peer = fastest("orbit-stable", model, "solve_ivp shooting", 1e-8)
        if ours and ours.seconds and peer and peer.seconds:
            out.append(
                f"one stable orbit to 1e-8, {model}: shooting {peer.seconds:.3f} s / casahunt {ours.seconds:.3f} s = "
                f"{peer.seconds / ours.seconds:.1f}  (goal {goal})"
            )
    return out


def peak_memory(scene: str, model: str) -> float:
    """Peak memory [MB] of casahunt alone on one scene; to be called in a process of its own."""
    servo = table1.servo()
    if scene == "fold":
        find_fold(servo, model)  # type: ignore[arg-type]
    elif scene == "diagram":
        whole_diagram(find_orbit(servo, model, START), 1e-6, FOLD_TOLERANCE[model])  # type: ignore[arg-type]
    else:
        find_orbit(servo, model, GAINS[scene], branch=scene.removeprefix("orbit-"))  # type: ignore[arg-type]
    status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) / 1024  # getrusage would report the parent's


def memories(scenes: list[str], models: list[str]) -> dict[str, float]:
    """Peak memory [MB] of each scene."""
    tasks = [(scene, model) for scene in scenes for model in models]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context, initializer=end_with_parent, max_tasks_per_child=1) as pool:
        found = [pool.submit(peak_memory, *task) for task in tasks]
        return {" ".join(task): future.result() for task, future in zip(tasks, found, strict=True)}


COLOURS = {"casahunt": "#0b2f6b", "AUTO-07p": "#b3440c", "solve_ivp shooting": "#6b8e23", "solve_bvp": "#8a2be2"}
DECADES = 30.0
"""The time axes span this factor at least."""
MARKERS = {"casahunt": "o", "AUTO-07p": "s", "solve_ivp shooting": "^", "solve_bvp": "D"}


def picture(rows: list[Row], path: Path) -> None:
    """Work-precision diagrams, one per scene and model."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    scenes = [scene for scene in SCENES if any(r.scene == scene for r in rows)]
    models = [model for model in MODELS if any(r.model == model for r in rows)]
    figure = Figure(figsize=(4.2 * len(scenes), 3.6 * len(models)), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(models), len(scenes), squeeze=False)
    for line, model in zip(grid, models, strict=True):
        for axes, scene in zip(line, scenes, strict=True):
            for method, colour in COLOURS.items():
                found = [r for r in rows if (r.scene, r.model, r.method) == (scene, model, method)]
                done = [(r.seconds, max(r.error, 1e-13)) for r in found if r.seconds and r.error is not None]
                if done:
                    x, y = zip(*done, strict=True)
                    axes.loglog(x, y, MARKERS[method] + "-", color=colour, label=method, markersize=5)
                elif found:
                    axes.plot([], [], MARKERS[method], color=colour, label=f"{method}: fails")
            axes.set_title(f"{scene}, {model}")
            axes.set_xlabel("run time [s]")
            axes.set_ylabel("relative error")
            axes.grid(True, which="major", alpha=0.3)
            low, high = axes.get_xlim()
            widen = max(1.0, DECADES * low / high) ** 0.5  # narrow ranges would drown in tick labels
            axes.set_xlim(low / widen, high * widen)
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.legend(fontsize=8)
    figure.savefig(path, dpi=130)


def main() -> None:
    """Measure, write, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="benchmark", metavar="DIR", help="folder to write into (default benchmark)")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES), help="scenes to measure")
    parser.add_argument("--model", nargs="+", choices=MODELS, default=list(MODELS), help="friction models")
    parser.add_argument("--quick", action="store_true", help="fewer repeats, AUTO-07p's LuGre run at one mesh only")
    options = parser.parse_args()
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    repeats = 2 if options.quick else 5
    rows: list[Row] = []
    for scene in options.only:
        for model in options.model:
            fresh: list[Row] = []
            if scene.startswith("orbit"):
                fresh += casahunt_orbits(scene, model, repeats)
                fresh += stick_rows(scene) if model == "switch" and scene == "orbit-stable" else []
                fresh += peer_orbits(scene, model)
                fresh += peers_down_the_branch(model) if scene == "orbit-unstable" else []
            elif scene == "fold":
                fresh += fold_rows(model, repeats)
            else:
                fresh += diagram_rows(model, repeats, options.quick)
            print(table(fresh), flush=True)
            rows += fresh
    facts: dict[str, Any] = {
        "python": platform.python_version(), "casadi": casadi.__version__, "numpy": np.__version__,
        "processor": platform.machine(), "peak_memory_MB": memories(options.only, options.model),
        "ratios": ratios(rows),
    }  # fmt: skip
    facts["where_the_time_goes"] = {m: where_the_time_goes(m) for m in options.model if "diagram" in options.only}
    for line in facts["ratios"]:
        print(line)
    for model, shares in facts["where_the_time_goes"].items():
        print(f"where the time of the {model} diagram goes: "
              + ", ".join(f"{what} {share:.0%}" for what, share in shares.items()))  # fmt: skip
    print("peak memory [MB], import included: "
          + ", ".join(f"{scene} {peak:.0f}" for scene, peak in facts["peak_memory_MB"].items()))  # fmt: skip
    (out / "benchmark.json").write_text(json.dumps(facts | {"rows": [asdict(r) for r in rows]}, indent=1) + "\n")
    with (out / "benchmark.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])))
        writer.writeheader()
        writer.writerows(asdict(r) for r in rows)
    picture(rows, out / "benchmark.png")


if __name__ == "__main__":
    main()
