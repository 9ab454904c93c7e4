"""The gallery, casahunt and peers on the same cycles: from a start off the cycle, and from the cycle of a neighbour.

Errors are the larger of the relative errors of the period and of the largest size of the first state, against the
truths of problems/ (closed forms, Taylor series in extended precision).  What follows the motion from the start until
it is near the cycle is part of the time; the neighbour's cycle, at a parameter 2.5 % higher, is given.  Times are the
processor's, the least of some repeats, with OMP_NUM_THREADS=1 those of one thread: other programs count little.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from casahunt import NoOrbit
from casahunt.orbits import SystemOrbit
from scripts.history import emptied
from scripts.race.entries import Entry, entries
from scripts.race.rows import LONG_ENOUGH, MOST_REPEATS, Row

OFF, BESIDE = "off the cycle", "from a neighbour"
NEIGHBOUR = 1.025
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-9, 1e-10, 1e-11)
BVP_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
SHOOTING_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-13)
TAYLOR_TOLERANCES = (1e-4, 1e-6, 1e-9, 1e-12, 2.2e-16)
AUTO_INTERVALS = ((20, 4), (50, 4), (100, 4), (100, 7), (200, 7), (400, 7))
SLOW = 1.0
"""What takes so long [s] is not repeated."""
TABLE_TOLERANCE = 1e-9
TABLE_BVP, TABLE_SHOOTING = (1e-6, 1e-7, 1e-8), (1e-9, 1e-11, 1e-13)
"""Of casahunt and of the others in the table of the gallery, around a true error of 1e-9."""


SCENE_ENTRIES = {
    "van-der-pol": ("van der Pol, mu = 10", "van der Pol, mu = 1000"),
    "belt": ("belt",),
    "relay": ("relay",),
}
"""Scenes with work-precision curves; the scene "gallery" is the table of all entries."""


class Gave(Exception):
    """A peer gave up; the message says why."""


@dataclass(frozen=True)
class Task:
    """One thing to be timed: action() gives (period, largest size of the first state)."""

    method: str
    setting: str
    action: Callable[[], tuple[float, float]]


def rows_of(scene: str, repeats: int) -> Iterator[Row]:
    """All rows of a scene of the gallery.

    Parameters
    ----------
    scene
        a name of SCENE_ENTRIES, or "gallery".
    repeats
        how often a thing is timed at least.

    Yields
    ------
    Rows, as they are measured.
    """
    makers = entries()
    for name in SCENE_ENTRIES.get(scene, tuple(makers)):
        entry = makers[name]()
        if scene == "gallery":
            yield from measured(scene, entry.known.title, table_tasks(entry), entry, repeats)
            continue
        for where, factor in ((OFF, None), (BESIDE, NEIGHBOUR)):
            model = f"{entry.known.title}, {where}"
            tasks = [*ours(entry, factor, TOLERANCES), *peers(entry, factor)]
            yield from measured(scene, model, tasks, entry, repeats)
            if factor is not None:
                yield from auto_rows(scene, model, entry, factor, repeats)


def measured(scene: str, model: str, tasks: list[Task], entry: Entry, repeats: int) -> Iterator[Row]:
    """A row for each task.

    Parameters
    ----------
    scene, model
        for the rows.
    tasks
        what is timed, from loose tolerances to tight ones: a method that has failed slowly is not asked for more.
    entry
        with the truth.
    repeats
        how often, at least, where it is not slow.

    Yields
    ------
    Rows.
    """
    hopeless: set[str] = set()
    for task in tasks:
        if task.method in hopeless:
            continue
        began = time.process_time()
        try:
            found = task.action()
            seconds = time.process_time() - began
            if seconds < SLOW and not task.method.endswith("first time"):
                seconds, found = least_of(repeats, task.action)
            yield Row(scene, model, task.method, task.setting, seconds, entry.error(*found))
        except (Gave, NoOrbit, ValueError, np.linalg.LinAlgError) as error:
            spent = time.process_time() - began
            note = f"fails after {spent:.1f} s: {str(error)[:120]}"
            hopeless |= {task.method} if spent > SLOW else set()
            yield Row(scene, model, task.method, task.setting, None, None, None, note)


def least_of(repeats: int, action: Callable[[], Any]) -> tuple[float, Any]:
    """(least processor time, last result) of so many repeats, and of more where they are short."""
    times: list[float] = []
    result = None
    while len(times) < repeats or (sum(times) < LONG_ENOUGH and len(times) < MOST_REPEATS):
        began = time.process_time()
        result = action()
        times.append(time.process_time() - began)
    return min(times), result


def read(orbit: SystemOrbit) -> tuple[float, float]:
    """(period, largest size of the first state) of an orbit of casahunt."""
    x = orbit.extrema(orbit.cycle.states[0])
    return orbit.period, max(abs(x.low.value), abs(x.high.value))


def ours(entry: Entry, factor: float | None, tolerances: tuple[float, ...]) -> list[Task]:
    """casahunt, and what its first search in a process takes.

    Parameters
    ----------
    entry
        the cycle.
    factor
        of the neighbour that is given; None starts off the cycle.
    tolerances
        one task each.

    Returns
    -------
    Tasks.
    """
    tasks = []
    for tol in tolerances:
        if factor is None:

            def action(tol: float = tol) -> tuple[float, float]:
                return read(entry.find(tol))

            def first(tol: float = tol) -> tuple[float, float]:
                emptied()
                return read(entry.find(tol))

            if tol == TABLE_TOLERANCE:
                tasks.append(Task("casahunt, first time", f"tol {tol:.0e}", first))
        else:
            near: list[SystemOrbit] = []

            def action(tol: float = tol, near: list[SystemOrbit] = near) -> tuple[float, float]:
                return read(entry.follow(near[0], tol))

            near.append(entry.find(tol, factor))
            action()  # CasADi's functions are there, as the neighbour's are
        tasks.append(Task("casahunt", f"tol {tol:.0e}", action))
    return tasks


def peers(entry: Entry, factor: float | None) -> list[Task]:
    """solve_bvp, solve_ivp shooting and heyoka shooting at many settings.

    Parameters
    ----------
    entry, factor
        as in `ours`.

    Returns
    -------
    Tasks; of a peer that is missing, one that fails with the reason.
    """
    return [
        *bvp_tasks(entry, factor, BVP_TOLERANCES),
        *shooting_tasks(entry, factor, SHOOTING_TOLERANCES),
        *taylor_tasks(entry, factor, TAYLOR_TOLERANCES),
    ]


def table_tasks(entry: Entry) -> list[Task]:
    """What the table of the gallery is made of: all from the same start off the cycle."""
    return [
        *ours(entry, None, (TABLE_TOLERANCE,)),
        *bvp_tasks(entry, None, TABLE_BVP),
        *shooting_tasks(entry, None, TABLE_SHOOTING),
        *taylor_tasks(entry, None, TAYLOR_TOLERANCES[-1:]),
    ]


def _missing(method: str, error: ImportError) -> list[Task]:
    def action() -> tuple[float, float]:
        raise Gave(f"left out: {error}")

    return [Task(method, "", action)]


def bvp_tasks(entry: Entry, factor: float | None, tolerances: tuple[float, ...]) -> list[Task]:
    """solve_bvp; from the start, the motion is simulated first.

    Parameters
    ----------
    entry, factor, tolerances
        as in `ours`.

    Returns
    -------
    Tasks.
    """
    try:
        from scripts.peers import gallery_bvp as bvp
        from scripts.peers import gallery_shooting as shooting
    except ImportError as error:
        return _missing("solve_bvp", error)
    known, method = entry.known, entry.methods[0]
    guess = None
    if factor is not None:
        near = known.beside(factor)
        u = shooting.solve(near, TABLE_TOLERANCE, method).unknowns
        guess = bvp.Guess(shooting.Scipy(near, TABLE_TOLERANCE, method), u)

    def action(tol: float) -> tuple[float, float]:
        try:
            found = bvp.from_the_start(known, tol, method) if guess is None else bvp.solve(guess, known, tol)
        except shooting.Failed as error:
            raise Gave(str(error)) from None
        return found.period, found.largest

    return [Task("solve_bvp", f"tol {tol:.0e}", lambda tol=tol: action(tol)) for tol in tolerances]


def shooting_tasks(entry: Entry, factor: float | None, tolerances: tuple[float, ...]) -> list[Task]:
    """Single shooting with solve_ivp.

    Parameters
    ----------
    entry, factor, tolerances
        as in `ours`.

    Returns
    -------
    Tasks.
    """
    try:
        from scripts.peers import gallery_shooting as shooting
    except ImportError as error:
        return _missing("solve_ivp shooting", error)
    known = entry.known

    def action(tol: float, method: str, guess: Any) -> tuple[float, float]:
        try:
            found = shooting.solve(known, tol, method, guess)
        except shooting.Failed as error:
            raise Gave(str(error)) from None
        return found.period, found.largest

    tasks = []
    for method in entry.methods:
        guess = None if factor is None else shooting.solve(known.beside(factor), TABLE_TOLERANCE, method).unknowns
        for tol in tolerances if method != "Radau" else tolerances[:-2]:
            name = f"{method} {tol:.0e}"
            tasks.append(Task("solve_ivp shooting", name, lambda a=(tol, method, guess): action(*a)))
    return tasks


def taylor_tasks(entry: Entry, factor: float | None, tolerances: tuple[float, ...]) -> list[Task]:
    """Shooting with heyoka, and the same with what its compiler takes.

    Parameters
    ----------
    entry, factor, tolerances
        as in `ours`.

    Returns
    -------
    Tasks.
    """
    try:
        import heyoka

        from scripts.peers import gallery_heyoka as taylor
        from scripts.peers import gallery_shooting as shooting
    except ImportError as error:
        return _missing("heyoka shooting", error)
    known = entry.known
    guess = None
    if factor is not None:
        near = known.beside(factor)
        guess = taylor.solve(taylor.Taylor(near, 1e-15), near).unknowns

    def action(engine: Any) -> tuple[float, float]:
        try:
            found = taylor.solve(engine, known, guess)
        except shooting.Failed as error:
            raise Gave(str(error)) from None
        return found.period, found.largest

    def first(tol: float) -> tuple[float, float]:
        heyoka.llvm_state.clear_memcache()
        return action(taylor.Taylor(known, tol))

    tasks = []
    for tol in tolerances:
        engine = taylor.Taylor(known, tol)
        tasks.append(Task("heyoka shooting, first time", f"tol {tol:.0e}", lambda tol=tol: first(tol)))
        tasks.append(Task("heyoka shooting", f"tol {tol:.0e}", lambda engine=engine: action(engine)))
    return tasks


def auto_rows(scene: str, model: str, entry: Entry, factor: float, repeats: int) -> Iterator[Row]:
    """AUTO-07p from the neighbour, for problems that it can have; timed as a process.

    Parameters
    ----------
    scene, model
        for the rows.
    entry, factor
        as in `ours`.
    repeats
        how often.

    Yields
    ------
    Rows; nothing for problems with events.
    """
    from scripts.peers import gallery_auto as auto

    if not entry.known.title.startswith(tuple(auto.SMOOTH)):
        return
    near, here = entry.find(TABLE_TOLERANCE, factor), entry.parameters[entry.vary]
    times, states = near.sample(12)
    distinct = np.append(True, np.diff(times) > 0)
    with tempfile.TemporaryDirectory() as folder:
        try:
            exe = auto.ready(entry.known.title, Path(folder))
        except auto.Missing as error:
            yield Row(scene, model, "AUTO-07p", "", None, None, None, f"left out: {error}")
            return
        for intervals, points in AUTO_INTERVALS:
            setting, best = f"{intervals} x {points}", np.inf
            try:
                for _ in range(repeats):
                    seconds, found = auto.run(
                        exe, states[:, distinct], times[distinct], (factor * here, here), intervals=intervals,
                        points=points, stiff=entry.known.stiff,
                    )  # fmt: skip
                    best = min(best, seconds)
                error = entry.error(found.period, found.largest)
                yield Row(scene, model, "AUTO-07p", setting, best, error, None, "of its own process")
            except auto.Failed as refusal:
                yield Row(scene, model, "AUTO-07p", setting, None, None, None, str(refusal))
