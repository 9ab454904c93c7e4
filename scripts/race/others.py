"""The peers on the same scenes: shooting and solve_bvp on an orbit and down the branch, AUTO-07p on a whole diagram."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from casahunt import Options, find_orbit
from problems import table1
from scripts.race.ours import FOLD_TOLERANCE, whole_diagram
from scripts.race.rows import GAINS, START, Row, best_of, orbit_error, reference

SMALLEST_STEP, PATIENCE = 1e-3, 60.0
"""Relative step in K and seconds after which a peer's way down the unstable branch is over."""
DIAGRAM_REPEATS = {"switch": 4, "lugre": 1}
"""Times as many repeats of a whole diagram, for casahunt and AUTO alike."""
DIAGRAM_TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7)
AUTO_MESHES = {"switch": ((25, 4), (50, 4), (100, 4)), "lugre": ((400, 4), (800, 5), (1200, 4))}


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
                began = time.process_time()
                points, fold = whole_diagram(start, tol, FOLD_TOLERANCE[model])
                seconds = time.process_time() - began
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
