"""Pictures of orbits: time traces and phase portraits.

Symbols: n states, m sample points.  States are x1 [rad], x2 [rad/s], x3 [rad s] and, for LuGre, x4 = z [rad].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle, groupby
from typing import Any

import numpy as np

from ...axis_units import quantity, shown
from ...errors import InputError
from ...orbits import Orbit
from ...servo.friction import MODELS, Model
from ...servo.problem import HuntingOrbit
from .plotting import (
    ALONE,
    BOTTOM,
    LOOKS,
    MORE_LOOKS,
    NAMES,
    NEUTRAL,
    PANELS_APART,
    Array,
    Axes,
    Figure,
    Line2D,
    LineStyle,
    MaxNLocator,
    at_least_one,
    fix_labels,
    fixed_grid,
    legend,
    panels,
    picture,
    power,
    stacked,
)

LONG = 24
"""Characters of a legend entry of which four do not fit side by side."""
STATE_NAMES = {"x1": ("x₁", "rad"), "x2": ("x₂", "rad/s"), "x3": ("x₃", "rad s"), "x4": ("z", "rad")}
"""Symbol and unit of the states that a servo has; those of other parts of a loop are written out."""
STUCK = 1e-3
"""Slower than this part of the largest |x2| counts as stick."""
SPACE_EDGE, PLANES_APART = 0.1, 0.2
"""Room left of the picture in space [in], whose labels lie inside, and between it and the planes, of a mean width."""
DRAWN_POINTS = 16
"""Points per mesh interval of a drawn orbit."""


@picture("axes, one for every state")
def time_traces(orbits: Sequence[Orbit], *, ax: Any = None) -> Array:
    """One full period of every orbit against time [s], shifted so that x1 rises through zero at t = 0.

    The window opens a quarter of a period before that, so that no slip is cut in two.

    Parameters
    ----------
    orbits
        one or two, for instance both models at the same gain.

    Raises
    ------
    InputError : no orbit.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from casahunt import Servo, find_orbit, pictures
    >>> three = Figure().subplots(3)
    >>> drawn = pictures.time_traces([find_orbit(Servo(), "switch", 0.1)], ax=three)
    >>> drawn[0] is three[0], len(drawn)
    (True, 3)
    """
    at_least_one("orbits", orbits)
    traces = [rolled(*orbit.sample(DRAWN_POINTS)) for orbit in orbits]
    n = max(len(states) for _, states in traces)
    figure, all_of_them = stacked(ax, (1,) * n, legend_rows=len(orbits))
    states_named = max((orbit.cycle.states for orbit in orbits), key=len)
    for i, (ax, state) in enumerate(zip(all_of_them, states_named, strict=True)):
        name, unit = STATE_NAMES.get(state, (state.replace("_", " "), ""))
        peak = max(float(np.max(np.abs(states[i]))) for _, states in traces if i < len(states))
        factor, label = _scaled(name, unit, peak)
        shown = [(*t, look) for t, look in zip(traces, _looks(orbits), strict=True) if i < len(t[1])]
        for times, states, look in shown:
            width = look.width if len(shown) > 1 else ALONE
            ax.plot(
                times, states[i] / factor, color=look.colour, linewidth=width, linestyle=look.dashes,
                zorder=look.zorder,
            )  # fmt: skip
        ax.set_ylabel(label)
        ax.axhline(0, color="0.6", linewidth=0.7, zorder=1)
        ax.axvline(0, color="0.6", linewidth=0.7, zorder=1)
        ax.grid(True, color="0.9", linewidth=0.6)
        ax.margins(x=0.01, y=0.1)
    all_of_them[-1].set_xlabel("time from the rise of x₁ through zero [s]")
    sizes = [quantity(orbit.amplitude, "rad", _rounded) for orbit in orbits]
    labels = [f"{name_of(o)}: period {o.period:.4g} s, amplitude {size}" for o, size in zip(orbits, sizes, strict=True)]
    legend(figure, all_of_them[0], _orbit_handles(orbits, labels), frameon=False)
    return all_of_them


@picture("three axes: space, in three dimensions, and the planes (x1, x2) and (x1, x3)")
def phase_portrait(orbits: Sequence[Orbit], *, ax: Any = None) -> Array:
    """Orbits laid over each other in (x1, x2, x3) and in the planes (x1, x2) and (x1, x3).

    Stick, |x2| < STUCK max |x2|, is drawn thick.

    Parameters
    ----------
    orbits
        one or more.

    Raises
    ------
    InputError : no orbit, or a first axes without a third dimension.

    Examples
    --------
    >>> from casahunt import Servo, find_orbit, pictures
    >>> space, upper, lower = pictures.phase_portrait([find_orbit(Servo(), "switch", 0.1)])
    >>> space.name, upper.name
    ('3d', 'rectilinear')
    """
    at_least_one("orbits", orbits)
    samples = [orbit.sample(DRAWN_POINTS)[1][:3] for orbit in orbits]
    peaks = np.max([np.max(np.abs(states), axis=1) for states in samples], axis=0)
    units = (("x₁", "rad"), ("x₂", "rad/s"), ("x₃", "rad s"))
    scales = [_scaled(name, unit, float(peak)) for (name, unit), peak in zip(units, peaks, strict=True)]
    labels = [label for _, label in scales]
    # Model and gain; and the amplitude, where these are not enough
    names = [name_of(orbit) for orbit in orbits]
    names = [
        name if names.count(name) == 1 else f"{name}, amplitude {quantity(orbit.amplitude, 'rad', _rounded)}"
        for name, orbit in zip(names, orbits, strict=True)
    ]
    handles = _orbit_handles(orbits, names)
    handles += [Line2D([], [], color=NEUTRAL, linewidth=1.3, label="slip (thin)")]
    handles += [Line2D([], [], color=NEUTRAL, linewidth=4.5, label="stick (thick)")]
    columns = min(len(handles), 4) if all(len(name) < LONG for name in names) else 2
    figure, three = _space_and_planes(ax, math.ceil(len(handles) / columns))
    space, planes = three[0], ((three[1], 1), (three[2], 2))
    for look, states in zip(_looks(orbits), samples, strict=True):
        x = states / np.array([factor for factor, _ in scales])[:, None]
        stuck = np.abs(x[1]) < STUCK * np.max(np.abs(x[1]))
        _draw_orbit(space, x, stuck, look)
        for plane, row in planes:
            _draw_orbit(plane, x[[0, row]], stuck, look)
    for axis, label in zip((space.xaxis, space.yaxis, space.zaxis), labels, strict=True):
        axis.set_label_text(label)
        axis.labelpad = 7
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    space.margins(x=0.15, y=0.15, z=0.03)  # keeps the last tick labels of neighbouring axes apart
    space.view_init(elev=20, azim=-55)
    space.set_box_aspect((1, 1, 1.5), zoom=0.95)
    for plane, row in planes:
        plane.set(xlabel=labels[0], ylabel=labels[row])
        plane.grid(True, color="0.9", linewidth=0.6)
        plane.margins(0.08)
    legend(figure, three[1], handles, frameon=False, ncols=columns)
    return three


def _space_and_planes(given: Any, legend_rows: int) -> tuple[Figure | None, Array]:
    if given is not None:
        _, three = panels(given, 3)
        if not hasattr(three[0], "zaxis"):
            raise InputError('axes: the first one must have three dimensions (projection="3d")')
        return None, three
    figure, grid = fixed_grid(
        legend_rows, left=SPACE_EDGE, rows_apart=BOTTOM + PANELS_APART, nrows=2, ncols=2, width_ratios=(1.6, 1),
        wspace=PLANES_APART,
    )  # fmt: skip
    space = figure.add_subplot(grid[:, 0], projection="3d", computed_zorder=False)
    planes = (figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1]))
    fix_labels(planes)
    return figure, np.array([space, *planes], dtype=object)


def _looks(orbits: Sequence[Orbit]) -> list[LineStyle]:
    """The look of its model for the first orbit of a model, others for the rest."""
    if len(orbits) == 1:
        return [look_of(orbits[0])._replace(width=ALONE)]
    models, others = [_model(orbit) for orbit in orbits], cycle(MORE_LOOKS)
    return [next(others) if model in models[:i] else LOOKS[model] for i, model in enumerate(models)]


def look_of(orbit: Orbit) -> LineStyle:
    """The look of an orbit that is alone of its model."""
    return LOOKS[_model(orbit)]


def _model(orbit: Orbit) -> Model:
    """The friction model whose look an orbit has; a loop of parts has that of the first one."""
    return orbit.model if isinstance(orbit, HuntingOrbit) else MODELS[0]


def name_of(orbit: Orbit) -> str:
    """What an orbit is called in a legend."""
    if isinstance(orbit, HuntingOrbit):
        return f"{NAMES[orbit.model]}, K = {orbit.gain:.4g}"
    vary = orbit.problem.principal
    return f"loop, {vary.replace('_', ' ')} = {orbit.problem.value(vary):.4g}"


def _rounded(value: float) -> str:
    """Four digits, with a power of ten as print has it."""
    exponent = math.floor(math.log10(value))
    if -3 < exponent < 4:
        return f"{value:.4g}"
    return f"{value / 10.0**exponent:.3f}·{power(exponent)}"


def _orbit_handles(orbits: Sequence[Orbit], labels: Sequence[str]) -> list[Line2D]:
    return [
        Line2D([], [], color=look.colour, linewidth=look.width, linestyle=look.dashes, label=label)
        for look, label in zip(_looks(orbits), labels, strict=True)
    ]


def _scaled(name: str, unit: str, peak: float) -> tuple[float, str]:
    """(factor, axis label) that bring numbers of size `peak` between 0.1 and 100."""
    if not shown().plain and unit:
        named = shown().near(peak, unit)
        return 1 / float(shown().number(1.0, unit, named)), f"{name} [{named}]"
    exponent = 3 * math.floor((math.log10(peak) + 1) / 3) if peak > 0 else 0
    said = " ".join(part for part in (power(exponent) if exponent else "", unit) if part)
    return 10.0**exponent, f"{name} [{said}]" if said else name


def rolled(times: Array, states: Array) -> tuple[Array, Array]:
    """A periodic motion with t = 0 where x1 rises through zero, from -T/4 on.

    times: (m,) [s] of one period, both ends included; states: (n, m).
    Returns times (m,) and states (n, m) of one period, both ends included.
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


def _draw_orbit(axes: Axes, x: Array, stuck: Array, look: LineStyle) -> None:
    """A closed line in two or three dimensions, x (2 or 3, m), with the stick part (m,) bool thick."""
    axes.plot(*x, color=look.colour, linewidth=look.width, linestyle=look.dashes, zorder=look.zorder)
    for is_stuck, group in groupby(range(stuck.size), key=lambda i: bool(stuck[i])):
        part = list(group)
        if is_stuck and len(part) > 1:
            axes.plot(
                *x[:, part], color=look.colour, linewidth=look.width + 2.6, solid_capstyle="round", zorder=look.zorder
            )
