"""How the figures look: one size, one grid, stable solid and unstable dashed, fixed points green."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from casahunt import Branch
from casahunt.orbits.orbit import Orbit
from casahunt.views.pictures.plotting import LOOKS, SMALL, Figure, Line2D, new_figure

Axes = Any

MARK = "#b03020"
"""What the report says of its own."""
FIXED = "#1b7f4d"
DASHED = (0, (3.2, 1.6))
SAMPLES = 16
"""Points per mesh interval of a drawn orbit."""


def sheet(width: float = 8.0, height: float = 6.0) -> Figure:
    """An empty figure [in]."""
    figure = new_figure()
    figure.set_size_inches(width, height)
    return figure


def grid(axes: Axes) -> None:
    """The faint grid that all panels have."""
    axes.grid(True, which="major", color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)


def key(figure: Figure, handles: list[Line2D], columns: int) -> None:
    """The legend above the panels."""
    figure.legend(handles=handles, loc="outside upper center", fontsize=SMALL, frameon=False, ncols=columns)


def plain(value: float) -> str:
    """A power of ten as one writes it, 1e-6."""
    return f"{value:g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def below(value: float, *levels: float) -> str:
    """The first of some levels that a numerical error is below, and not the error itself, which is the machine's."""
    return plain(next(level for level in levels if value < level))


def line(label: str, **style: Any) -> Line2D:
    """An entry of a legend."""
    return Line2D([], [], label=label, **style)


def with_fold(*branches: Branch) -> tuple[list[Orbit], list[Orbit]]:
    """The stable and the unstable part of branches that meet in one fold, each ordered by gain, with the fold."""
    fold = next(special.orbit for special in branches[0].special if special.kind == "fold")
    stable, unstable = [fold], [fold]
    for branch in branches:
        stable += [special.orbit for special in branch.special if special.kind == "superstable"]
        for orbit in branch.orbits:
            (stable if orbit.stable else unstable).append(orbit)
    return sorted(stable, key=lambda o: o.gain), sorted(unstable, key=lambda o: o.gain)


def both_parts(axes: Axes, value: Callable[[Orbit], float], *branches: Branch) -> None:
    """A quantity of the orbits against the gain: stable solid, unstable dashed."""
    look = LOOKS[branches[0].model]
    for orbits, style in zip(with_fold(*branches), ("-", DASHED), strict=True):
        axes.plot(
            [o.gain for o in orbits], [value(o) for o in orbits], color=look.colour, linewidth=look.width,
            linestyle=style, dash_capstyle="butt", zorder=look.zorder,
        )  # fmt: skip


def space(figure: Figure, position: Any) -> Axes:
    """Axes in three dimensions."""
    axes = figure.add_subplot(position, projection="3d", computed_zorder=False)
    axes.view_init(elev=22, azim=-58)
    return axes


def label_space(axes: Axes, labels: tuple[str, str, str], zoom: float, ticks: int = 5) -> None:
    """Name the axes of (x1, x2, x3), with few ticks."""
    for axis, label in zip((axes.xaxis, axes.yaxis, axes.zaxis), labels, strict=True):
        axis.set_label_text(label)
        axis.labelpad = 8
        axis.set_tick_params(labelsize=SMALL)
    axes.zaxis.set_tick_params(pad=6)
    axes.locator_params(nbins=ticks)
    axes.set_box_aspect((1, 1, 1.1), zoom=zoom)
