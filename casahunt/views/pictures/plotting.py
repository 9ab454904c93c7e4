"""Pictures of branches and orbits: the only module that imports matplotlib, and no other module imports it.

Results carry data, plotting takes results.  Every function returns a `matplotlib.figure.Figure` on an Agg
canvas of its own: no display, no pyplot, no global state.  `save` writes it.

A colour never says anything alone, so that the pictures survive grey printing: the Switch model is thin, dark
and square, the LuGre model wide, light and triangular; along a branch stable is solid, unstable is dashed.

Symbols: n states, m sample points.  States are x1 [rad], x2 [rad/s], x3 [rad s] and, for LuGre, x4 = z [rad].
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from ...errors import InputError
from ...files import whole
from ...servo.branch import Branch
from ...servo.problem import HuntingOrbit

Array = np.ndarray
Axes = Any

SIZE = (8.0, 6.0)
"""Width and height of a figure [in]."""
DPI = 150
LONG = 24
"""Characters of a legend entry of which four do not fit side by side."""
SMALL = 9
"""Font size of legends and notes [pt]; the rest is matplotlib's 10."""
STUCK = 1e-3
"""Slower than this part of the largest |x2| counts as stick."""
ALONE = 1.5
"""Line width [pt] where a wide line would only hide its own details."""
SAMPLES = 16
"""Points per mesh interval of a drawn orbit."""
GAIN_LABEL = "controller gain K [V/rad]"


class Look(NamedTuple):
    """How the line of a model or of an orbit is drawn."""

    colour: str
    width: float
    marker: str
    zorder: float
    dashes: Any = "-"


LOOKS = {
    "switch": Look("#0b2f6b", 1.3, "s", 4),
    "lugre": Look("#f2a03d", 2.8, "^", 3),
}
MORE_LOOKS = (
    Look("#7a1f3d", 1.3, "D", 6, (0, (6, 2))),
    Look("#5fae8c", 2.2, "v", 5, (0, (1, 1.2))),
    Look("#555555", 1.3, "P", 7, (0, (6, 2, 1, 2))),
    Look("#b0509b", 1.8, "X", 5.5, (0, (2, 1))),
    Look("#111111", 1.0, "o", 8, (0, (10, 2, 1, 2, 1, 2))),
)
"""For orbits of a model that is in the picture already, in turn."""
NAMES = {"switch": "Switch", "lugre": "LuGre"}

SPECIAL_MARKERS = {"fold": "o", "symmetry breaking": "X", "grazing": "v", "superstable": "*"}
OTHER_MARKERS = ("P", "d", "p", "h", "<", ">")
"""For the kinds of special points that users define, in turn."""
FAR = 1e3
"""A detour longer than any in a picture of size one."""
TINY = 1e-12
"""Span below which all gains, or all amplitudes, are the same."""
NEUTRAL = "#444444"
"""Colour of what belongs to no model."""
EXCHANGING = ("fold", "symmetry breaking")
"""Special points with |mu| = 1: the end of a stable run and the start of an unstable one."""


def diagram(branches: Sequence[Branch], *, equilibria: bool = True) -> Figure:
    """Bifurcation diagram: amplitude [rad] and period [s] of the cycles against the controller gain.

    Parameters
    ----------
    branches
        one per model, as a rule.
    equilibria
        say that the stuck servo, x = 0, exists at every gain; its amplitude is off the log axis.

    Raises
    ------
    InputError : no branch, or a branch without orbits.
    """
    curves = _curves(branches)
    markers = _special_markers(branches)
    figure = new_figure()
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.35, 1))
    for axes, quantity in ((above, "amplitude"), (below, "period")):
        for curve in curves:
            values = np.array([getattr(orbit, quantity) for orbit in curve.orbits])
            _draw_curve(axes, curve, values, markers)
        axes.set_ylabel({"amplitude": "amplitude max |x$_1$| [rad]", "period": "period [s]"}[quantity])
        axes.grid(True, which="major", color="0.88", linewidth=0.6)
        axes.margins(x=0.04, y=0.08)
    above.set_yscale("log")
    low, high = below.dataLim.intervaly
    if high > 10 * low:
        below.set_yscale("log")
    below.set_xlabel(GAIN_LABEL)
    if equilibria:
        _draw_equilibria(above)
    _label_folds(above, curves)
    figure.legend(handles=_legend(curves, markers), loc="outside upper center", fontsize=SMALL, ncols=5)
    return figure


def multipliers(branches: Sequence[Branch]) -> Figure:
    """Leading half multiplier mu against the controller gain, linear between -1 and 1, logarithmic beyond.

    Orbits that were not computed on the half cycle have no mu and leave a gap.

    Parameters
    ----------
    branches
        one per model, as a rule.

    Raises
    ------
    InputError : no branch, or a branch without orbits.
    """
    curves = _curves(branches)
    markers = _special_markers(branches)
    figure = new_figure()
    axes = figure.subplots()
    axes.axhspan(-1, 1, color="0.93", zorder=0)
    everything = [-1.0, 1.0]
    for curve in curves:
        mu = np.array([orbit.half_multiplier for orbit in curve.orbits])
        everything += list(mu[np.isfinite(mu)])
        _draw_curve(axes, curve, mu, markers)
    _multiplier_axis(axes, min(everything), max(everything))
    beside = axes.get_yaxis_transform()  # x in axes fractions, y in data
    for level, text in ((1, "fold\nμ = +1"), (0, "stable\n|μ| < 1"), (-1, "symmetry\nbreaking\nμ = −1")):
        if level:
            axes.axhline(level, color=NEUTRAL, linewidth=1.0, zorder=2)
        axes.text(1.015, level, text, transform=beside, va="center", fontsize=SMALL, color="black")
    axes.margins(x=0.04)
    axes.set_xlabel(GAIN_LABEL)
    axes.set_ylabel("leading half multiplier μ [–]")
    axes.grid(True, which="major", color="0.85", linewidth=0.6)
    figure.legend(handles=_legend(curves, markers), loc="outside upper center", fontsize=SMALL, ncols=5)
    return figure


def time_traces(orbits: Sequence[HuntingOrbit]) -> Figure:
    """One full period of every orbit against time [s], shifted so that x1 rises through zero at t = 0.

    The window opens a quarter of a period before that, so that no slip is cut in two.

    Parameters
    ----------
    orbits
        one or two, for instance both models at the same gain.

    Raises
    ------
    InputError : no orbit.
    """
    _at_least_one("orbits", orbits)
    traces = [rolled(*orbit.sample(SAMPLES)) for orbit in orbits]
    n = max(len(states) for _, states in traces)
    figure = new_figure()
    panels = figure.subplots(n, 1, sharex=True)
    names = (("x$_1$", "rad"), ("x$_2$", "rad/s"), ("x$_3$", "rad s"), ("z", "rad"))
    for i, (axes, (name, unit)) in enumerate(zip(panels, names, strict=False)):
        peak = max(float(np.max(np.abs(states[i]))) for _, states in traces if i < len(states))
        factor, label = _scaled(name, unit, peak)
        shown = [(*t, look) for t, look in zip(traces, _looks(orbits), strict=True) if i < len(t[1])]
        for times, states, look in shown:
            width = look.width if len(shown) > 1 else ALONE
            axes.plot(
                times, states[i] / factor, color=look.colour, linewidth=width, linestyle=look.dashes,
                zorder=look.zorder,
            )  # fmt: skip
        axes.set_ylabel(label)
        axes.axhline(0, color="0.6", linewidth=0.7, zorder=1)
        axes.axvline(0, color="0.6", linewidth=0.7, zorder=1)
        axes.grid(True, color="0.9", linewidth=0.6)
        axes.margins(x=0.01, y=0.1)
    panels[-1].set_xlabel("time from the rise of x$_1$ through zero [s]")
    figure.align_ylabels(panels)
    labels = [f"{_name(o)}: period {o.period:.4g} s, amplitude {_rounded(o.amplitude)} rad" for o in orbits]
    figure.legend(handles=_orbit_handles(orbits, labels), loc="outside upper center", fontsize=SMALL, frameon=False)
    return figure


def phase_portrait(orbits: Sequence[HuntingOrbit]) -> Figure:
    """Orbits laid over each other in (x1, x2, x3) and in the planes (x1, x2) and (x1, x3).

    Stick, |x2| < STUCK max |x2|, is drawn thick.

    Parameters
    ----------
    orbits
        one or more.

    Raises
    ------
    InputError : no orbit.
    """
    _at_least_one("orbits", orbits)
    samples = [orbit.sample(SAMPLES)[1][:3] for orbit in orbits]
    peaks = np.max([np.max(np.abs(states), axis=1) for states in samples], axis=0)
    units = (("x$_1$", "rad"), ("x$_2$", "rad/s"), ("x$_3$", "rad s"))
    scales = [_scaled(name, unit, float(peak)) for (name, unit), peak in zip(units, peaks, strict=True)]
    labels = [label for _, label in scales]
    figure = new_figure()
    grid = figure.add_gridspec(2, 2, width_ratios=(1.6, 1))
    space = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
    planes = ((figure.add_subplot(grid[0, 1]), 1), (figure.add_subplot(grid[1, 1]), 2))
    for look, states in zip(_looks(orbits), samples, strict=True):
        x = states / np.array([factor for factor, _ in scales])[:, None]
        stuck = np.abs(x[1]) < STUCK * np.max(np.abs(x[1]))
        _draw_orbit(space, x, stuck, look)
        for axes, row in planes:
            _draw_orbit(axes, x[[0, row]], stuck, look)
    for axis, label in zip((space.xaxis, space.yaxis, space.zaxis), labels, strict=True):
        axis.set_label_text(label)
        axis.labelpad = 7
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    space.margins(x=0.15, y=0.15, z=0.03)  # keeps the last tick labels of neighbouring axes apart
    space.view_init(elev=20, azim=-55)
    space.set_box_aspect((1, 1, 1.5), zoom=0.95)
    for axes, row in planes:
        axes.set(xlabel=labels[0], ylabel=labels[row])
        axes.grid(True, color="0.9", linewidth=0.6)
        axes.margins(0.08)
    names = _distinct_names(orbits)
    handles = _orbit_handles(orbits, names)
    handles += [Line2D([], [], color=NEUTRAL, linewidth=1.3, label="slip (thin)")]
    handles += [Line2D([], [], color=NEUTRAL, linewidth=4.5, label="stick (thick)")]
    columns = min(len(handles), 4) if all(len(name) < LONG for name in names) else 2
    figure.legend(handles=handles, loc="outside upper center", fontsize=SMALL, frameon=False, ncols=columns)
    return figure


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure; the suffix of `path` decides on the format, PNG has 150 dpi.

    Raises
    ------
    InputError : the folder is missing or cannot be written to, or the suffix is unknown.
    OSError : the disk is full.
    """
    path = Path(path)
    suffixes = sorted(figure.canvas.get_supported_filetypes())
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in suffixes:
        raise InputError(f"figure {str(path)!r}: the suffix must be one of {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise InputError(f"figure {str(path)!r}: there is no folder {str(path.parent)!r}")
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=DPI, format=suffix)
    with whole(path) as stream:
        stream.write(drawn.getvalue())


# Curves against the gain


class _Curve(NamedTuple):
    """A branch ready to be drawn: its orbits with the special points between them, where they belong."""

    look: Look
    name: str
    orbits: list[HuntingOrbit]
    kinds: list[str]
    """Kind of the special point, "" for an ordinary orbit."""

    @property
    def gains(self) -> Array:
        """(m,) controller gains."""
        return np.array([orbit.gain for orbit in self.orbits])

    def runs(self) -> list[tuple[bool, slice]]:
        """(stable, points) of the runs of one stability; neighbours share a point, so that no gap is left.

        A stretch is stable if neither of its ends is unstable; a point with |mu| = 1 decides nothing.
        """
        unstable = [k not in EXCHANGING and not o.stable for o, k in zip(self.orbits, self.kinds, strict=True)]
        stretches = [not (a or b) for a, b in zip(unstable, unstable[1:], strict=False)]
        result, start = [], 0
        for stable, group in groupby(stretches):
            stop = start + len(list(group))
            result.append((stable, slice(start, stop + 1)))
            start = stop
        return result


def _curves(branches: Sequence[Branch]) -> list[_Curve]:
    _at_least_one("branches", branches)
    result = []
    for branch in branches:
        _at_least_one("orbits of the branch", branch.orbits)
        orbits, kinds = _with_special(branch)
        result.append(_Curve(LOOKS[branch.model], NAMES[branch.model], orbits, kinds))
    return result


def _at_least_one(what: str, items: Sequence[Any]) -> None:
    if len(items) == 0:
        raise InputError(f"{what} = {items!r}: must be at least one to draw")


def _with_special(branch: Branch) -> tuple[list[HuntingOrbit], list[str]]:
    """The orbits with every special point put in where it belongs, and the kinds ("" for the others).

    That is where the detour to it is shortest in gain and logarithm of the amplitude, both over their span;
    for a point with |mu| = 1, of the places where stability changes.
    """
    orbits, kinds = list(branch.orbits), [""] * len(branch.orbits)
    inside = {id(orbit): i for i, orbit in enumerate(orbits)}
    apart = []
    for special in branch.special:
        if id(special.orbit) in inside:
            kinds[inside[id(special.orbit)]] = special.kind
        else:
            apart.append(special)

    every = [*orbits, *(special.orbit for special in apart)]
    place = np.array([(orbit.gain, math.log(orbit.amplitude)) for orbit in every])  # (m, 2)
    place /= np.maximum(np.ptp(place, axis=0), TINY)
    for special, target in zip(apart, place[len(orbits) :].copy(), strict=True):
        path = place[: len(orbits)]
        to = np.linalg.norm(path - target, axis=1)
        between = np.linalg.norm(np.diff(path, axis=0), axis=1)
        detours = np.concatenate([to[:1], to[:-1] + to[1:] - between, to[-1:]])  # before, between, after
        if special.kind in EXCHANGING:
            stable = np.array([orbit.stable for orbit in orbits])
            changes = np.concatenate([[False], stable[:-1] != stable[1:], [False]])
            detours[~changes] += changes.any() * FAR
        where = int(np.argmin(detours))
        orbits.insert(where, special.orbit)
        kinds.insert(where, special.kind)
        place = np.insert(path, where, target, axis=0)
    return orbits, kinds


def _special_markers(branches: Sequence[Branch]) -> dict[str, str]:
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
    gains, look = curve.gains, curve.look
    for stable, run in curve.runs():
        axes.plot(
            gains[run], values[run], color=look.colour, linewidth=look.width, linestyle=_dashes(stable),
            dash_capstyle="butt", zorder=look.zorder,
        )  # fmt: skip
    ordinary = np.array([kind == "" for kind in curve.kinds])
    axes.plot(
        gains[ordinary], values[ordinary], linestyle="none", marker=look.marker, markersize=3.2 + 0.5 * look.width,
        markerfacecolor=look.colour, markeredgecolor="black", markeredgewidth=0.4, zorder=look.zorder + 0.5,
    )  # fmt: skip
    for kind, marker in markers.items():
        here = np.array([k == kind for k in curve.kinds])
        if here.any():
            style = _special_style(kind, marker, look.colour)
            axes.plot(gains[here], values[here], zorder=9 if kind == "fold" else 8, **style)


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


def _draw_equilibria(axes: Axes) -> None:
    """A strip of ticks at the bottom edge for what a logarithmic axis cannot show."""
    room = 0.16  # of the height, for the strip and its note
    low, high = np.log10(axes.get_ylim())
    axes.set_ylim(bottom=10 ** (low - (high - low) * room / (1 - room)))
    axes.plot(
        np.linspace(0, 1, 101), np.full(101, 0.02), transform=axes.transAxes, linestyle="none", marker="|",
        markersize=8, color="0.3", zorder=2, scalex=False, scaley=False,
    )  # fmt: skip
    axes.text(
        0.012, 0.05, "equilibria (stuck): x = 0 exists at every gain; amplitude 0 is below this axis",
        transform=axes.transAxes, fontsize=SMALL, color="0.15", va="bottom",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0}, zorder=2,
    )  # fmt: skip


def _label_folds(axes: Axes, curves: list[_Curve]) -> None:
    """Write K at every fold, on its open side, the labels of one side kept apart."""
    room, away, apart = 0.17, 0.03, 0.13  # of the axes: for a label, from its fold, between labels
    sides: dict[int, list[tuple[HuntingOrbit, str]]] = {-1: [], 1: []}
    for curve in curves:
        for i in (i for i, kind in enumerate(curve.kinds) if kind == "fold"):
            orbit, beside = curve.orbits[i], curve.orbits[i - 1 if i else min(1, len(curve.orbits) - 1)]
            text = f"{curve.name} fold\nK = {orbit.gain:.4g}"
            sides[1 if beside.gain <= orbit.gain else -1].append((orbit, text))
    left, right = axes.get_xlim()
    extra = (right - left) * room / (1 - room)
    axes.set_xlim(left - extra * bool(sides[-1]), right + extra * bool(sides[1]))
    to_axes = axes.transData + axes.transAxes.inverted()
    for side, labels in sides.items():
        at = sorted(((*to_axes.transform((o.gain, o.amplitude)), text) for o, text in labels), key=lambda a: a[1])
        heights = [y for _, y, _ in at]
        for i in range(1, len(at)):
            heights[i] = max(heights[i], heights[i - 1] + apart)
        lift = sum(y for _, y, _ in at) / max(len(at), 1) - sum(heights) / max(len(at), 1)
        for (x, y, text), height in zip(at, heights, strict=True):
            axes.annotate(
                text, (x, y), (x + side * away, height + lift), xycoords="axes fraction", fontsize=SMALL,
                ha="left" if side > 0 else "right", va="center", zorder=7,
                arrowprops={"arrowstyle": "-", "color": "0.3", "linewidth": 0.7, "shrinkA": 0, "shrinkB": 4},
            )  # fmt: skip


def _multiplier_axis(axes: Axes, low: float, high: float) -> None:
    """Linear from -1 to 1, logarithmic beyond, with ticks that can be read in both parts."""
    decades = math.log10(high) + math.log10(max(-low, 1.0))
    axes.set_yscale("symlog", linthresh=1.0, linscale=max(1.0, decades / 3))
    axes.set_ylim(3 * min(low, -1.0), 3 * max(high, 1.0))
    step = max(1, math.ceil(decades / 6))
    powers = [10.0**k for k in range(step, math.floor(math.log10(max(high, 1.0))) + 1, step)]
    negative = [-(10.0**k) for k in range(step, math.floor(math.log10(max(-low, 1.0))) + 1, step)]
    axes.yaxis.set_major_locator(FixedLocator([*reversed(negative), -1, -0.5, 0, 0.5, 1, *powers]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(_multiplier_tick))


def _multiplier_tick(value: float, position: int) -> str:
    if abs(value) <= 1:
        return f"{value:g}".replace("-", "−")
    return f"${'-' if value < 0 else ''}10^{{{round(math.log10(abs(value)))}}}$"


# Orbits


def new_figure() -> Figure:
    """An empty figure on an Agg canvas of its own."""
    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _looks(orbits: Sequence[HuntingOrbit]) -> list[Look]:
    """The look of its model for the first orbit of a model, others for the rest."""
    if len(orbits) == 1:
        return [LOOKS[orbits[0].model]._replace(width=ALONE)]
    seen: set[str] = set()
    result, spare = [], 0
    for orbit in orbits:
        if orbit.model in seen:
            result.append(MORE_LOOKS[spare % len(MORE_LOOKS)])
            spare += 1
        else:
            result.append(LOOKS[orbit.model])
        seen.add(orbit.model)
    return result


def _name(orbit: HuntingOrbit) -> str:
    return f"{NAMES[orbit.model]}, K = {orbit.gain:.4g}"


def _distinct_names(orbits: Sequence[HuntingOrbit]) -> list[str]:
    """Model and gain; and the amplitude, where these are not enough."""
    names = [_name(orbit) for orbit in orbits]
    return [
        name if names.count(name) == 1 else f"{name}, amplitude {_rounded(orbit.amplitude)} rad"
        for name, orbit in zip(names, orbits, strict=True)
    ]


def _rounded(value: float) -> str:
    """Four digits, with a power of ten as print has it."""
    exponent = math.floor(math.log10(value))
    if -3 < exponent < 4:
        return f"{value:.4g}"
    return f"{value / 10.0**exponent:.3f}·10$^{{{exponent}}}$"


def _orbit_handles(orbits: Sequence[HuntingOrbit], labels: Sequence[str]) -> list[Line2D]:
    return [
        Line2D([], [], color=look.colour, linewidth=look.width, linestyle=look.dashes, label=label)
        for look, label in zip(_looks(orbits), labels, strict=True)
    ]


def _scaled(name: str, unit: str, peak: float) -> tuple[float, str]:
    """(factor, axis label) that bring numbers of size `peak` between 0.1 and 100."""
    exponent = 3 * math.floor((math.log10(peak) + 1) / 3) if peak > 0 else 0
    return 10.0**exponent, f"{name} [{unit}]" if exponent == 0 else f"{name} [10$^{{{exponent}}}$ {unit}]"


def rolled(times: Array, states: Array) -> tuple[Array, Array]:
    """A periodic motion with t = 0 where x1 rises through zero, from -T/4 on.

    Parameters
    ----------
    times
        (m,) [s] of one period, both ends included.
    states
        (n, m).

    Returns
    -------
    times (m,) and states (n, m) of one period, both ends included.
    """
    x1, x2, period = states[0], states[1], times[-1] - times[0]
    rising = np.flatnonzero((x1[:-1] < 0) & (x1[1:] >= 0))
    if rising.size:
        i = rising[np.argmax(x2[rising])]
        zero = times[i] - x1[i] * (times[i + 1] - times[i]) / (x1[i + 1] - x1[i])
    else:
        zero = times[np.argmax(x2)]
    shifted = (times[:-1] - zero + period / 4) % period - period / 4
    order = np.argsort(shifted, kind="stable")
    closed = np.append(order, order[0])
    return np.append(shifted[order], shifted[order[0]] + period), states[:, closed]


def _draw_orbit(axes: Axes, x: Array, stuck: Array, look: Look) -> None:
    """A closed line in two or three dimensions, x (2 or 3, m), with the stick part (m,) bool thick."""
    axes.plot(*x, color=look.colour, linewidth=look.width, linestyle=look.dashes, zorder=look.zorder)
    for is_stuck, group in groupby(range(stuck.size), key=lambda i: bool(stuck[i])):
        part = list(group)
        if is_stuck and len(part) > 1:
            axes.plot(
                *x[:, part], color=look.colour, linewidth=look.width + 2.6, solid_capstyle="round", zorder=look.zorder
            )
