"""The gallery's table, problem by problem, and its work-precision diagrams: error against time, a curve per method."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from scripts.race.rows import Row

EXACT = 1e-9
"""The true error that the peers of the table are asked for."""
FLOOR = 1e-15
"""Errors below are drawn here: truths have no more digits."""
COLUMNS = {
    "casahunt": "casahunt", "first time": "casahunt, first time", "solve_bvp": "solve_bvp",
    "shooting": "solve_ivp shooting", "heyoka": "heyoka shooting", "heyoka, first time": "heyoka shooting, first time",
}  # fmt: skip
"""Titles of the table and methods of the rows."""
STYLES: dict[str, dict[str, Any]] = {
    "casahunt": {"color": "#0b2f6b", "marker": "o"},
    "casahunt, first time": {"color": "#0b2f6b", "marker": "o", "markerfacecolor": "none", "linestyle": "--"},
    "solve_bvp": {"color": "#8a2be2", "marker": "D"},
    "solve_ivp shooting": {"color": "#6b8e23", "marker": "^"},
    "heyoka shooting": {"color": "#d4a017", "marker": "v"},
    "heyoka shooting, first time": {
        "color": "#d4a017", "marker": "v", "markerfacecolor": "none", "linestyle": "--",
    },
    "AUTO-07p": {"color": "#b3440c", "marker": "s"},
}  # fmt: skip
"""Of the curves; hollow and dashed are those with what is compiled the first time."""


def best(rows: Iterable[Row]) -> Row | None:
    """The fastest of the rows that are exact, or the most exact one where none is."""
    done = [r for r in rows if r.seconds is not None and r.error is not None]
    exact = [r for r in done if (r.error or 0.0) <= EXACT]
    if exact:
        return min(exact, key=lambda r: r.seconds or 0.0)
    return min(done, key=lambda r: r.error or 0.0, default=None)


def in_table(rows: list[Row]) -> list[dict[str, str]]:
    """The rows of the scene "gallery" as a table.

    Parameters
    ----------
    rows
        of all scenes.

    Returns
    -------
    A line for each problem: milliseconds of each method to a true error of EXACT; where that is not reached, the error
    that is, and "fails" where there is none.
    """
    lines = []
    for problem in dict.fromkeys(r.model for r in rows if r.scene == "gallery"):
        line = {"problem": problem}
        for title, method in COLUMNS.items():
            mine = [r for r in rows if (r.scene, r.model, r.method) == ("gallery", problem, method)]
            found = best(mine)
            if found is None or found.seconds is None or found.error is None:
                line[title] = "left out" if any("left out" in r.note for r in mine) else "fails"
            else:
                line[title] = _milliseconds(found.seconds)
                if title == "casahunt":
                    line["its error"] = f"{found.error:.0e}"
                elif found.error > EXACT:
                    line[title] += f" ({found.error:.0e})"
        lines.append(line)
    return lines


def _milliseconds(seconds: float) -> str:
    ms = 1e3 * seconds
    return f"{ms:.0f}" if ms >= 9.5 else f"{ms:.1f}" if ms >= 0.95 else f"{ms:.2g}"


def as_markdown(lines: list[dict[str, str]]) -> str:
    """The table as text."""
    titles = list(lines[0])
    rule = ["---"] + ["--:"] * (len(titles) - 1)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (titles, rule, *(list(x.values()) for x in lines)))


def write_table(lines: list[dict[str, str]], path: Path) -> None:
    """The table as CSV."""
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(lines[0]))
        writer.writeheader()
        writer.writerows(lines)


def front(rows: Iterable[Row]) -> list[tuple[float, float]]:
    """(seconds, error) of the settings that no other one beats in both, the fastest first."""
    out: list[tuple[float, float]] = []
    done = [(r.seconds, max(r.error, FLOOR)) for r in rows if r.seconds is not None and r.error is not None]
    for seconds, error in sorted(done):
        if not out or error < out[-1][1]:
            out.append((seconds, error))
    return out


def panels(rows: list[Row], path: Path) -> None:
    """A column for each problem, a row for each kind of start.

    Parameters
    ----------
    rows
        of all scenes.
    path
        of the picture.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    split = [(r, *r.model.rsplit(", ", 1)) for r in rows if r.scene in ("van-der-pol", "belt", "relay")]
    problems, starts = (list(dict.fromkeys(x[k] for x in split)) for k in (1, 2))
    if not problems:
        return
    figure = Figure(figsize=(3.6 * len(problems), 3.2 * len(starts) + 0.7), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(starts), len(problems), squeeze=False, sharex=True, sharey=True)
    handles: dict[str, Any] = {}
    for line, start in zip(grid, starts, strict=True):
        for axes, problem in zip(line, problems, strict=True):
            for method, style in STYLES.items():
                mine = [r for r, p, s in split if (p, s, r.method) == (problem, start, method)]
                points = front(mine)
                if points:
                    (handles[method],) = axes.loglog(*zip(*points, strict=True), markersize=5, **style)
            axes.set_title(f"{problem}\n{start}", fontsize=9)
            axes.grid(True, which="major", alpha=0.3)
    for axes in grid[-1]:
        axes.set_xlabel("processor time [s]")
    for axes in grid[:, 0]:
        axes.set_ylabel("relative error")
    order = [method for method in STYLES if method in handles]
    columns = min(len(order), 2 * len(problems))
    figure.legend([handles[m] for m in order], order, loc="outside lower center", ncols=columns, fontsize=8)
    figure.savefig(path, dpi=110)
