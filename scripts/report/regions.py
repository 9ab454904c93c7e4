"""Figures 12 and 13, not in the report: the regions of attraction to the stick phase and to the fixed points."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import ListedColormap

from casahunt.views.pictures.plotting import SMALL, Figure
from scripts.report.attraction import WITNESSES, FirstStick

from .drawing import FIXED, Axes, key, line, sheet
from .state_space import SPEED, bound
from .study import ENDED, GAIN, POSITIONS, Entry, Slice, Study

Array = np.ndarray

NARROW = 0.01
"""Where less than this part of a slice comes to rest, the middle of the band is drawn."""
SLICES = tuple(x1 for x1 in POSITIONS if x1 >= 0)
"""x1 [rad] of the slices of Figure 12; those with x1 < 0 are their mirror images."""
FAR = 4.0
"""The motions of the regulator task are as fast as this [rad/s]."""
ACROSS = 2.2
"""Half width of a slice in units of Fs/ki."""
CLASSES = ("#cfe3f5", "#6fa8d6", "#f6d9a8", "#d9822b")
CLASS_NAMES = (
    "the speed falls until it sticks",
    "speeds up first, sticks at its first stop",
    "reverses once, then sticks",
    "reverses more than once",
)
RESTS, HUNTS = "#8fd0ac", "#f6e3c8"
CASES = ((GAIN, 0.0, 0.3), (GAIN, 0.05, 3.0), (ENDED["switch"], 0.0, 0.5), (ENDED["switch"], 0.0025, 0.5))
"""Gain, x1 [rad] and largest |x2| [rad/s] of the slices of Figure 13."""


def _slice(study: Study, gain: float, x1: float, x2: float) -> Slice:
    limit = study.servo.friction.static / study.servo.torque_gains(gain)[2]
    return study.slice(gain, x1, x2, ACROSS * limit)


def _classes(part: Slice) -> Array:
    """0 to 3 (`CLASS_NAMES`), nan where no stick was reached."""
    first = part.found.first
    kind = np.where(first.falling, 0, np.where(first.reversals == 0, 1, np.where(first.reversals == 1, 2, 3)))
    return part.shaped(np.where(np.isnan(first.position), np.nan, kind))


def _inside(study: Study, part: Slice) -> Array:
    """(rows, columns) bool: inside the bound of Figure 5."""
    left, right = bound(study, part.x1, part.x2)
    return (part.x3 > left[:, None]) & (part.x3 < right[:, None])


def caption12(study: Study) -> str:
    """Attraction to the stick phase."""
    words = []
    for x1 in SLICES:
        part = _slice(study, GAIN, x1, FAR)
        kind, inside = _classes(part), _inside(study, part)
        words.append(
            f"x1 = {x1:g} rad: {100 * np.mean(kind[inside] == 0):.0f} % of the states inside the bound keep falling "
            f"until they stick, {100 * np.mean(kind[inside] <= 1):.0f} % stick at their first stop, and so do "
            f"{100 * np.mean(kind[~inside] <= 1):.0f} % of those outside"
        )
    return (
        "Not in the report: what its section 4.1 says could not be computed, the region of attraction to the stick "
        f"phase, on slices of the state space around Figure 5 (K = {GAIN}, exact Switch; for x1 < 0 the mirror "
        "image). Each state is followed through its slips to its first stick, above with |x2| "
        f"as in Figure 5, below up to {FAR:g} rad/s. Agrees: inside the bound of Figure 5 (dashed) the speed falls "
        "at that instant, and most states there go on to stick. Beyond: the bound is neither necessary nor "
        f"sufficient for that. Of the states drawn with |x2| <= {FAR:g} rad/s, {'; '.join(words)}. The number of "
        f"states that do not reach the stick phase is {_lost(study)}; none reverses more than "
        f"{('never', 'once', 'twice')[_most_reversals(study)]} on the way."
    )


def _far(study: Study) -> list[FirstStick]:
    return [_slice(study, GAIN, x1, FAR).found.first for x1 in SLICES]


def _lost(study: Study) -> int:
    return sum(int(np.sum(np.isnan(first.position))) for first in _far(study))


def _most_reversals(study: Study) -> int:
    return max(int(np.max(first.reversals)) for first in _far(study))


def draw12(study: Study) -> Figure:
    """Three slices, near the stick phase and far from it."""
    figure = sheet(10.0, 6.8)
    panels = figure.subplots(2, len(SLICES))
    for row, speed in zip(panels, (SPEED, FAR), strict=True):
        for axes, x1 in zip(row, SLICES, strict=True):
            part = _slice(study, GAIN, x1, speed)
            _filled(axes, part, _classes(part), CLASSES)
            _bound(axes, study, part)
            axes.set_title(f"x$_1$ = {x1:g} rad", fontsize=10)
        row[0].set_ylabel("x$_2$ [rad/s]")
    for axes in panels[1]:
        axes.set_xlabel("x$_3$ [rad s]")
    seen = min(3, 1 + _most_reversals(study))
    handles = [_patch(CLASSES[i], CLASS_NAMES[i]) for i in range(seen + 1)]
    handles.append(line("bound of Figure 5", color="black", linewidth=1.2, linestyle=(0, (5, 3))))
    key(figure, handles, 2)
    return figure


def caption13(study: Study) -> str:
    """Attraction to the fixed points."""
    words = []
    for gain in dict.fromkeys(case[0] for case in CASES):
        parts = [(case[1], case[2], _slice(study, *case)) for case in CASES if case[0] == gain]
        inner, outer = parts[0][2].found.resting, parts[0][2].found.hunting
        shares = " and ".join(
            f"{100 * np.mean(part.found.rests):.1f} % at x1 = {x1:g} rad, |x2| <= {x2:g} rad/s"
            for x1, x2, part in parts
        )
        words.append(
            f"At K = {gain} a servo stuck within {inner:.4g} rad of the set point, the amplitude of the unstable "
            f"cycle, comes to rest, and one stuck between {outer[0]:.4g} and {outer[1]:.4g} rad hunts; "
            f"of the states drawn {shares} come to rest"
        )
    undecided = sum(int(np.sum(~(part.found.rests | part.found.hunts))) for part in _parts(study))
    total = sum(part.found.rests.size for part in _parts(study))
    return (
        "Not in the report: the region of attraction to the fixed points, x1 = x2 = 0, |x3| <= Fs/ki, on slices of "
        f"the state space (exact Switch), at the gain of Figure 5 and at that of Figure 11. Each of {total} states "
        "is followed from stick to stick until it is in a set that the motion does not leave: below the unstable "
        "cycle, where each stick is nearer than the one before, or around the stable cycle, where each comes nearer "
        f"to it ({WITNESSES} motions show either); undecided are {undecided}. Agrees: the fixed points attract, as "
        f"section 4.1 concludes from linearising. Beyond: how far they attract. {'. '.join(words)}. So at K = "
        f"{CASES[0][0]} nearly every state drawn ends hunting, and at K = {CASES[-1][0]}, with a stable cycle all the "
        "same, at rest. The region comes in bands: states that one swing or more takes to the border, the unstable "
        "cycle's "
        f"stable manifold. At K = {CASES[1][0]}, x1 = {CASES[1][1]:g} rad the line is where the first stick is at "
        "the set point, the middle of a band narrower than the grid; other bands that narrow are not drawn."
    )


def _parts(study: Study) -> list[Slice]:
    return [_slice(study, *case) for case in CASES]


def draw13(study: Study) -> Figure:
    """Two slices at two gains."""
    figure = sheet(9.0, 7.4)
    panels = figure.subplots(2, 2)
    for axes, case, part in zip(panels.ravel(), CASES, _parts(study), strict=True):
        found = part.found
        kind = np.where(found.rests, 0.0, np.where(found.hunts, 1.0, np.nan))
        _filled(axes, part, part.shaped(kind), (RESTS, HUNTS))
        first = part.shaped(np.where(found.first.falling, found.first.position, np.nan))
        if np.mean(found.rests) < NARROW:
            axes.contour(part.x3, part.x2, first, levels=[0.0], colors=[FIXED], linewidths=1.2)
        _bound(axes, study, part, case[0])
        axes.set_title(f"K = {case[0]:g}, x$_1$ = {case[1]:g} rad", fontsize=10)
        axes.set_xlabel("x$_3$ [rad s]")
        axes.set_ylabel("x$_2$ [rad/s]")
    handles = [
        _patch(RESTS, "comes to rest at a fixed point"),
        _patch(HUNTS, "hunts"),
        line("first stick at x$_1$ = 0", color=FIXED, linewidth=1.2),
        line("bound of Figure 5", color="black", linewidth=1.2, linestyle=(0, (5, 3))),
    ]
    key(figure, handles, 4)
    return figure


def _filled(axes: Axes, part: Slice, kind: Array, colours: tuple[str, ...]) -> None:
    axes.pcolormesh(
        part.x3, part.x2, kind, cmap=ListedColormap(list(colours)), vmin=-0.5, vmax=len(colours) - 0.5,
        shading="nearest", rasterized=True,
    )  # fmt: skip
    axes.set_xlim(part.x3[0], part.x3[-1])
    axes.set_ylim(part.x2[0], part.x2[-1])
    axes.tick_params(labelsize=SMALL)


def _bound(axes: Axes, study: Study, part: Slice, gain: float = GAIN) -> None:
    x2 = np.linspace(part.x2[0], part.x2[-1], 801)
    for x3 in bound(study, part.x1, x2, gain):
        axes.plot(x3, x2, color="black", linewidth=1.2, linestyle=(0, (5, 3)), zorder=5)


def _patch(colour: str, name: str) -> object:
    return line(name, color=colour, linewidth=9)


FIGURES = (
    Entry(12, "Region of attraction to the stick phase", caption12, draw12),
    Entry(13, "Region of attraction to the fixed points", caption13, draw13),
)
