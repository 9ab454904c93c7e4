"""Pictures of branches: amplitude, period and half multiplier against the controller gain, or what else is varied.

A point on a branch belongs where the detour to it is shortest; stable runs are solid, unstable ones dashed.

Symbols: m points of a branch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from ...axis_units import label, shown
from ...continuation import Branch
from ...errors import InputError
from ...orbits import Orbit
from ...servo.parts.table import unit_of
from .orbits import look_of
from .plotting import (
    GAIN_LABEL,
    NAMES,
    NEUTRAL,
    SMALL,
    Array,
    Axes,
    FixedLocator,
    FuncFormatter,
    Line2D,
    LineStyle,
    NullLocator,
    at_least_one,
    legend,
    logarithmic,
    picture,
    power,
    stacked,
)

SPECIAL_MARKERS = {"fold": "o", "symmetry breaking": "X", "flip": "D", "grazing": "v", "superstable": "*"}
OTHER_MARKERS = ("P", "H", "p", "h", "<", ">")
"""For the kinds of special points that users define, in turn."""
LEGEND_COLUMNS, NOTES = 5, 0.85
"""Entries of the legend side by side, and room for the notes at the right of the multipliers [in]."""
LOPSIDED_MARKER, THIN = "d", 0.6
"""Of lopsided cycles; their line is this part of that of the symmetric ones."""
EXCHANGING = ("fold", "symmetry breaking", "flip")
"""Special points with |mu| = 1: the end of a stable run and the start of an unstable one."""


@picture("two axes, amplitude above period")
def diagram(branches: Sequence[Branch[Any]], *, equilibria: bool = True, ax: Any = None) -> Array:
    """Bifurcation diagram: amplitude [rad] and period [s] of the cycles against the controller gain.

    Parameters
    ----------
    branches
        one per model, as a rule; or branches of a loop of parts in one of its parameters, as `follow` gives them.
    equilibria
        say that the stuck servo, x = 0, exists at every gain; its amplitude is off the log axis; of a loop of parts
        nothing is said.

    Raises
    ------
    InputError : no branch, or a branch without orbits.

    Examples
    --------
    >>> from casahunt import Servo, diagram, pictures
    >>> branch = diagram(Servo(), "switch", start=0.6)
    >>> above, below = pictures.diagram([branch])
    >>> above.get_ylabel(), below.get_ylabel()
    ('amplitude max |x₁| [10⁻³ rad]', 'period [s]')
    """
    # One cycle of each lopsided pair, thin; the other one has the same amplitude and period
    curves, pairs = _curves(branches), [pair for branch in branches for pair in branch.lopsided]
    for curve in map(_curve, pairs):
        look = curve.look._replace(width=THIN * curve.look.width, marker=LOPSIDED_MARKER, zorder=curve.look.zorder + 2)
        curves.append(curve._replace(look=look, name=f"{curve.name}, lopsided"))
    markers = _special_markers([*branches, *pairs])
    handles = _legend(curves, markers)
    figure, both = stacked(ax, (1.35, 1), legend_rows=_rows(handles))
    above, below = both
    for ax, quantity in ((above, "amplitude"), (below, "period")):
        for curve in curves:
            values = np.array([getattr(orbit, quantity) for orbit in curve.orbits])
            values = shown().number(values, "rad") if quantity == "amplitude" else values
            _draw_curve(ax, curve, values, markers)
        ax.set_ylabel({"amplitude": f"amplitude max |x₁| [{label('rad')}]", "period": "period [s]"}[quantity])
        ax.grid(True, which="major", color="0.88", linewidth=0.6)
        ax.margins(x=0.04, y=0.08)
    for ax, spread in ((above, 2), (below, 10)):  # within a factor of 2 labels of powers are too long
        low, high = ax.dataLim.intervaly
        if high > spread * low:
            logarithmic(ax, "y")
        elif not 0.01 <= high < 1e4:
            k = math.floor(math.log10(high))
            ax.yaxis.set_major_formatter(FuncFormatter(lambda x, _, k=k: f"{x / 10**k:g}"))
            ax.set_ylabel(ax.get_ylabel().replace("[", f"[{power(k)} "))
    below.set_xlabel(_label(branches))
    if equilibria and all(hasattr(branch, "model") for branch in branches):
        # A strip of ticks at the bottom edge for what an axis without zero cannot show
        room, (low, high) = 0.16, np.log10(above.get_ylim())  # of the height, for the strip and its note
        above.set_ylim(bottom=10 ** (low - (high - low) * room / (1 - room)))
        above.plot(
            np.linspace(0, 1, 101), np.full(101, 0.02), transform=above.transAxes, linestyle="none", marker="|",
            markersize=8, color="0.3", zorder=2, scalex=False, scaley=False,
        )  # fmt: skip
        above.text(
            0.012, 0.05, "equilibria (stuck): x = 0 exists at every gain; amplitude 0 is below this axis",
            transform=above.transAxes, fontsize=SMALL, color="0.15", va="bottom",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0}, zorder=2,
        )  # fmt: skip
    _label_folds(above, curves)
    legend(figure, below, handles, ncols=LEGEND_COLUMNS)
    return both


@picture()
def multipliers(branches: Sequence[Branch[Any]], *, ax: Axes | None = None) -> Axes:
    """Leading half multiplier mu against the controller gain, linear between -1 and 1, logarithmic beyond.

    Orbits that were not computed on the half cycle have no mu and leave a gap.

    Parameters
    ----------
    branches
        one per model, as a rule; or of a loop of parts.

    Raises
    ------
    InputError : no branch, or a branch without orbits.

    Examples
    --------
    >>> from casahunt import Servo, diagram, pictures
    >>> branch = diagram(Servo(), "switch", start=0.6)
    >>> pictures.multipliers([branch]).get_ylabel()
    'leading half multiplier μ [–]'
    """
    curves = _curves(branches)
    markers = _special_markers(branches)
    handles = _legend(curves, markers)
    figure, (axes,) = stacked(ax, (1,), legend_rows=_rows(handles), right=NOTES)
    axes.axhspan(-1, 1, color="0.93", zorder=0)
    everything = [-1.0, 1.0]
    for curve in curves:
        mu = np.array([orbit.half_multiplier for orbit in curve.orbits])
        everything += list(mu[np.isfinite(mu)])
        _draw_curve(axes, curve, mu, markers)
    # Linear from -1 to 1, logarithmic beyond, with ticks that can be read in both parts
    low, high = min(everything), max(everything)
    decades = math.log10(high) + math.log10(max(-low, 1.0))
    axes.set_yscale("symlog", linthresh=1.0, linscale=max(1.0, decades / 3))
    axes.set_ylim(3 * min(low, -1.0), 3 * max(high, 1.0))
    step = max(1, math.ceil(decades / 6))
    powers = [10.0**k for k in range(step, math.floor(math.log10(max(high, 1.0))) + 1, step)]
    negative = [-(10.0**k) for k in range(step, math.floor(math.log10(max(-low, 1.0))) + 1, step)]
    axes.yaxis.set_major_locator(FixedLocator([*reversed(negative), -1, -0.5, 0, 0.5, 1, *powers]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(_multiplier_tick))
    beside = axes.get_yaxis_transform()  # x in axes fractions, y in data
    for level, text in ((1, "fold\nμ = +1"), (0, "stable\n|μ| < 1"), (-1, "symmetry\nbreaking\nμ = −1")):
        if level:
            axes.axhline(level, color=NEUTRAL, linewidth=1.0, zorder=2)
        axes.text(1.015, level, text, transform=beside, va="center", fontsize=SMALL, color="black")
    axes.margins(x=0.04)
    axes.set(xlabel=_label(branches), ylabel="leading half multiplier μ [–]")
    axes.grid(True, which="major", color="0.85", linewidth=0.6)
    legend(figure, axes, handles, ncols=LEGEND_COLUMNS)
    return axes


class _Curve(NamedTuple):
    """A branch ready to be drawn: its orbits with the special points between them, where they belong."""

    look: LineStyle
    name: str
    vary: str
    orbits: list[Orbit]
    kinds: list[str]
    """Kind of the special point, "" for an ordinary orbit."""

    @property
    def values(self) -> Array:
        """(m,) values of what is varied."""
        return np.array([orbit.problem.value(self.vary) for orbit in self.orbits])

    def runs(self) -> list[tuple[bool, slice]]:
        """(stable, points) of the runs of one stability; neighbours share a point, so that no gap is left.

        A stretch is stable if neither of its ends is unstable; a point with |mu| = 1 decides nothing.
        """
        unstable = [k not in EXCHANGING and o.stable is False for o, k in zip(self.orbits, self.kinds, strict=True)]
        stretches = [not (a or b) for a, b in zip(unstable, unstable[1:], strict=False)]
        result, start = [], 0
        for stable, group in groupby(stretches):
            stop = start + len(list(group))
            result.append((stable, slice(start, stop + 1)))
            start = stop
        return result


def _curves(branches: Sequence[Branch[Any]]) -> list[_Curve]:
    at_least_one("branches", branches)
    return [_curve(branch) for branch in branches]


def _curve(branch: Branch[Any]) -> _Curve:
    at_least_one("orbits of the branch", branch.orbits)
    orbits, kinds = zip(*branch.along(), strict=True)
    name = NAMES[branch.model] if hasattr(branch, "model") else "loop"
    return _Curve(look_of(orbits[0]), name, branch.vary, [*orbits], [*kinds])


def _label(branches: Sequence[Branch[Any]]) -> str:
    """Of the axis of what is varied.  Raises InputError: several things are."""
    names = {branch.vary for branch in branches}
    if len(names) > 1:
        raise InputError(f"branches in {' and in '.join(sorted(names))}: must be in one parameter")
    (vary,) = names
    unit = shown().si.label(unit_of(vary))
    return GAIN_LABEL if vary == "gain" else f"{vary.replace('_', ' ')} [{unit}]" if unit else vary.replace("_", " ")


def _special_markers(branches: Sequence[Branch[Any]]) -> dict[str, str]:
    """Marker of every kind of special point that occurs."""
    kinds = list(dict.fromkeys(special.kind for branch in branches for special in branch.special))
    own = [kind for kind in kinds if kind not in SPECIAL_MARKERS]
    others = {kind: OTHER_MARKERS[i % len(OTHER_MARKERS)] for i, kind in enumerate(own)}
    return {kind: (SPECIAL_MARKERS | others)[kind] for kind in kinds}


def _special_style(kind: str, marker: str, colour: str) -> dict[str, Any]:
    """Filled for a fold, hollow for the others."""
    return {
        "linestyle": "none",
        "marker": marker,
        "markersize": {"superstable": 9}.get(kind, 7),
        "markerfacecolor": colour if kind == "fold" else "white",
        "markeredgecolor": "black",
        "markeredgewidth": 1.0,
    }


def _draw_curve(axes: Axes, curve: _Curve, values: Array, markers: dict[str, str]) -> None:
    """One branch: runs solid or dashed, small markers at the computed orbits, special points on top."""
    places, look = curve.values, curve.look
    for stable, run in curve.runs():
        axes.plot(
            places[run], values[run], color=look.colour, linewidth=look.width, linestyle=_dashes(stable),
            dash_capstyle="butt", zorder=look.zorder,
        )  # fmt: skip
    ordinary = np.array([kind == "" for kind in curve.kinds])
    axes.plot(
        places[ordinary], values[ordinary], linestyle="none", marker=look.marker, markersize=3.2 + 0.5 * look.width,
        markerfacecolor=look.colour, markeredgecolor="black", markeredgewidth=0.4, zorder=look.zorder + 0.5,
    )  # fmt: skip
    for kind, marker in markers.items():
        here = np.array([k == kind for k in curve.kinds])
        if here.any():
            style = _special_style(kind, marker, look.colour)
            axes.plot(places[here], values[here], zorder=9 if kind == "fold" else 8, **style)


def _dashes(stable: bool) -> Any:
    return "-" if stable else (0, (3.2, 1.6))


def _legend(curves: list[_Curve], markers: dict[str, str]) -> list[Line2D]:
    """Models, stabilities and kinds of special points, each once."""
    models = {
        curve.name: Line2D(
            [], [], color=curve.look.colour, linewidth=curve.look.width, marker=curve.look.marker, markersize=5,
            markeredgecolor="black", markeredgewidth=0.4, label=curve.name,
        )
        for curve in curves
    }  # fmt: skip
    seen = {stable for curve in curves for stable, _ in curve.runs()}
    lines = [
        Line2D([], [], color=NEUTRAL, linewidth=1.6, linestyle=_dashes(stable), label=label)
        for stable, label in ((True, "stable"), (False, "unstable"))
        if stable in seen
    ]
    special = [Line2D([], [], label=kind, **_special_style(kind, m, NEUTRAL)) for kind, m in markers.items()]
    return [*models.values(), *lines, *special]


def _rows(handles: Sequence[Any]) -> int:
    return math.ceil(len(handles) / LEGEND_COLUMNS)


def _label_folds(axes: Axes, curves: list[_Curve]) -> None:
    """Write K at every fold, on its open side, each once, the labels of one side kept apart."""
    letter, away, apart = 0.011, 0.03, 0.13  # of the axes: for one of a label, from its fold, between labels
    sides: dict[int, list[tuple[float, float, str]]] = {-1: [], 1: []}
    said = set[tuple[str, str]]()  # a pair has its folds twice, and cycles of two kinds may end in one
    for curve in curves:
        values, word = curve.values, "K" if curve.vary == "gain" else curve.vary.replace("_", " ")
        for i in (i for i, kind in enumerate(curve.kinds) if kind == "fold"):
            value, beside = float(values[i]), values[i - 1 if i else min(1, len(curve.orbits) - 1)]
            text = f"{curve.name} fold\n{word} = {value:.4g}"
            if (curve.look.colour, f"{value:.4g}") in said:
                continue
            said.add((curve.look.colour, f"{value:.4g}"))
            sides[1 if beside <= value else -1].append((value, shown().number(curve.orbits[i].amplitude, "rad"), text))
    left, right = axes.get_xlim()
    for side, labels in sides.items():
        room = away + letter * max((len(line) for _, _, text in labels for line in text.splitlines()), default=0)
        there = [(right - x if side > 0 else x - left) / (right - left) for x, _, _ in labels]
        extra = (right - left) * max(room - min(there, default=1.0), 0.0) / (1 - room)
        left, right = (left, right + extra) if side > 0 else (left - extra, right)
    axes.set_xlim(left, right)
    to_axes = axes.transData + axes.transAxes.inverted()
    paper = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1}
    for side, labels in sides.items():
        at = sorted(((*to_axes.transform((x, y)), text) for x, y, text in labels), key=lambda a: a[1])
        heights = [y for _, y, _ in at]
        for i in range(1, len(at)):
            heights[i] = max(heights[i], heights[i - 1] + apart)
        lift = sum(y for _, y, _ in at) / max(len(at), 1) - sum(heights) / max(len(at), 1)
        for (x, y, text), height in zip(at, heights, strict=True):
            axes.annotate(
                text, (x, y), (x + side * away, height + lift), xycoords="axes fraction", fontsize=SMALL,
                ha="left" if side > 0 else "right", va="center", zorder=7, bbox=paper,
                arrowprops={"arrowstyle": "-", "color": "0.3", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 4},
            )  # fmt: skip


def _multiplier_tick(value: float, position: int) -> str:
    if abs(value) <= 1:
        return f"{value:g}".replace("-", "−")
    return f"{'−' if value < 0 else ''}{power(round(math.log10(abs(value))))}"
