"""The results as a picture, a table and a summary."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from casahunt.servo.friction import MODELS
from scripts.extremes.cases import NONE, REFUSED, SOLVED, UNCHECKED, WRONG, Result

LOOK = {SOLVED: ("#2a7f62", "o"), NONE: ("#8fb3d9", "D"), REFUSED: ("#e0a030", "^"), UNCHECKED: ("#808080", "s"),
        WRONG: ("#b3202c", "X")}  # fmt: skip
WIDTH = 7


def picture(results: list[Result], path: Path) -> None:
    """Rows: what was varied and what was asked for; columns: the extremes; colour and symbol: the verdict."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    models = [model for model in MODELS if any(r.case.model == model for r in results)]
    lines: dict[str, list[tuple[str, list[Result]]]] = {}
    counts = Counter((r.case.model, r.case.row) for r in results)
    for model in models:
        rows: dict[tuple[str, str], list[Result]] = {}
        for r in results:
            if r.case.model == model:
                few = counts[model, r.case.row] <= WIDTH
                rows.setdefault((r.case.row, "" if few else f": {r.case.what}"), []).append(r)
        lines[model] = [
            (row + what, found[i : i + WIDTH])
            for (row, what), found in rows.items()
            for i in range(0, len(found), WIDTH)
        ]
    longest = max(len(x) for x in lines.values())
    figure = Figure(figsize=(8.5 * len(models), 1.6 + 0.45 * longest), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, model in zip(figure.subplots(1, len(models), squeeze=False)[0], models, strict=True):
        for y, (_, found) in enumerate(lines[model]):
            for x, r in enumerate(found):
                colour, symbol = LOOK[r.verdict]
                axes.plot(x, y, symbol, color=colour, markersize=9 if r.verdict == WRONG else 7)
                asked = f"\n{r.case.what}" if counts[model, r.case.row] <= WIDTH else ""
                axes.text(x, y + 0.22, r.case.column + asked, ha="center", va="top", fontsize=6)
        axes.set_yticks(range(len(lines[model])), [name for name, _ in lines[model]], fontsize=8)
        axes.set_xticks([])
        axes.set_xlim(-0.6, WIDTH - 0.4)
        axes.set_ylim(longest - 0.2, -0.7)
        axes.set_title(model)
        for side in ("top", "right", "bottom"):
            axes.spines[side].set_visible(False)
    handles = [Line2D([], [], color=c, marker=m, linestyle="", label=name) for name, (c, m) in LOOK.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.savefig(path, dpi=110)


def flat(r: Result) -> dict[str, Any]:
    """One row of the table."""
    case = asdict(r.case)
    case["changes"] = " ".join(f"{key}={value!r}" for key, value in r.case.changes)
    rest = {key: value for key, value in vars(r).items() if key not in ("case", "notes")}
    return case | rest | {"notes": "; ".join(r.notes), "command": r.case.command}


def summary(results: list[Result]) -> tuple[dict[str, Any], list[str]]:
    """(numbers, lines)."""
    numbers: dict[str, Any] = {}
    titles = "".join(f" {verdict:>9s}" for verdict in LOOK)
    lines = [f"{'':10s} {'cases':>6s}{titles}  solved where a cycle exists"]
    names = [*MODELS, "fold", "stable", "unstable", "all"]
    for name in names:
        part = [r for r in results if name in (r.case.model, r.case.what, "all")]
        count = Counter(r.verdict for r in part)
        exist = len(part) - count[NONE]
        share = 100 * count[SOLVED] / exist if exist else math.nan
        numbers[name] = {"cases": len(part), **{v: count[v] for v in LOOK}, "solved_percent": share}
        counts = "".join(f" {count[verdict]:9d}" for verdict in LOOK)
        lines.append(f"{name:10s} {len(part):6d}{counts}  {share:.1f} %")
    for r in results:
        if r.verdict in (REFUSED, UNCHECKED, WRONG):
            gain = f" --gain {r.gain!r}" if r.gain is not None and r.case.what != "fold" else ""
            lines.append(f"{r.verdict.upper()} [{r.case.row} {r.case.column}] {r.case.command}{gain}")
            lines.append(f"    {r.seconds:.1f} s: {r.reason[:400]} {'; '.join(r.notes)[:300]}".rstrip())
    slowest = sorted(results, key=lambda r: -r.seconds)[:3]
    lines.append("slowest: " + "; ".join(f"{r.case.row} {r.case.column} {r.case.model} {r.case.what} {r.seconds:.1f} s"
                                         for r in slowest))  # fmt: skip
    return numbers, lines
