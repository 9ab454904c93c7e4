"""Figures 6, 7, 9 and 10: bifurcation diagrams and Floquet multipliers against the gain."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from casahunt import Branch
from casahunt.orbits.orbit import Orbit
from casahunt.servo.friction import Model
from casahunt.views.pictures.plotting import GAIN_LABEL, LOOKS, NAMES, SMALL, Figure

from .drawing import DASHED, FIXED, MARK, Axes, below, both_parts, grid, key, line, plain, sheet, with_fold
from .study import ENDED, START, Entry, Study

CIRCLES = (0.0321, 0.2, 0.4, 0.6)
"""Gains of the single unstable cycles in the report's Figure 9."""
HIGHEST_GAIN = 0.75
FLOOR = 1e-4
"""Amplitudes below this are on a linear axis [rad]: the branch x1 = 0 is in the picture."""
LOOKS_OF_ZERO = (("s", 6.5, "white"), ("x", 4.5, "black"))
"""Marker, size and face of the multipliers near zero."""
ZEROS = 18
"""Marks of the multipliers near zero, at most."""
ENDS = {"color": MARK, "linewidth": 1.1, "linestyle": (0, (1, 1.5)), "zorder": 1}


def _amplitude(orbit: Orbit) -> float:
    return orbit.amplitude


def _period(orbit: Orbit) -> float:
    return orbit.period


def _multiplier(i: int) -> Callable[[Orbit], float]:
    return lambda orbit: float(orbit.multipliers.full[i].real)


def _pair(orbit: Orbit) -> str:
    return f"K = {orbit.gain:g}: {orbit.amplitude:.5g} rad, {orbit.period:.5g} s"


def diagram_caption(study: Study, model: Model) -> str:
    """Bifurcation diagram."""
    fold, end = study.fold(model), ENDED[model]
    first, last = study.orbit(model, START), study.orbit(model, START, "unstable")
    stops = [study.orbit(model, end, branch) for branch in ("stable", "unstable")]
    circles = ""
    if model == "switch":
        single = "; ".join(_pair(study.orbit(model, gain, "unstable")) for gain in CIRCLES)
        circles = f"the single unstable cycles that the report marks by circles at these gains ({single}); "
    return (
        f"Bifurcation diagram of {NAMES[model]}: (a) max |x1| of the cycles with the branch of fixed points x1 = 0, "
        f"(b) their period; stable solid, unstable dashed. Agrees: from K = {START} ({first.amplitude:.5g} rad, "
        f"{first.period:.5g} s) a stable branch, and at K = {end}, where the report's ends, a stable and an unstable "
        f"cycle ({stops[0].amplitude:.5g} and {stops[1].amplitude:.5g} rad, {stops[0].period:.5g} and "
        f"{stops[1].period:.5g} s); {circles}the fixed points exist at every K. Beyond: the fold itself, K = "
        f"{fold.gain:.7g} ({fold.amplitude:.5g} rad, {fold.period:.5g} s), and the whole unstable branch back to K = "
        f"{START}, where its amplitude is {last.amplitude:.4g} rad and its period {last.period:.5g} s. The axis of "
        f"(a) is linear below {plain(FLOOR)} rad and logarithmic above."
    )


def draw_diagram(study: Study, model: Model) -> Figure:
    """Amplitude above, period below."""
    branch = study.branch(model)
    figure = sheet(8.0, 6.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1))
    both_parts(above, _amplitude, branch)
    both_parts(below, _period, branch)
    fold = study.fold(model)
    fixed = {"color": FIXED, "linewidth": 2.4}
    lowest = 0.0 if study.start == START else study.start - 0.02
    above.plot([lowest, HIGHEST_GAIN], [0, 0], **fixed, clip_on=False, zorder=6)
    look = LOOKS[model]
    handles = [
        line("cycles, stable", color=look.colour, linewidth=look.width),
        line("cycles, unstable", color=look.colour, linewidth=look.width, linestyle=DASHED),
        line("fixed points x$_1$ = 0", **fixed),
        line(f"end of the report's, K = {ENDED[model]}", **ENDS),
        line("fold", linestyle="none", marker="o", color=look.colour, markeredgecolor="black"),
    ]
    for axes, value in ((above, _amplitude), (below, _period)):
        axes.plot(fold.gain, value(fold), marker="o", color=look.colour, markeredgecolor="black", zorder=9)
        axes.axvline(ENDED[model], **ENDS)
        if model == "switch":
            shown = [gain for gain in CIRCLES if gain >= study.start]
            orbits = [study.orbit(model, gain, "unstable") for gain in shown]
            axes.plot(shown, [value(o) for o in orbits], linestyle="none", marker="o", markersize=9,
                      markerfacecolor="none", markeredgecolor=MARK, markeredgewidth=1.4, zorder=8)  # fmt: skip
        grid(axes)
    if model == "switch":
        handles.append(
            line("single unstable cycles", linestyle="none", marker="o", markersize=9, markerfacecolor="none",
                 markeredgecolor=MARK, markeredgewidth=1.4)
        )  # fmt: skip
    above.annotate(
        f"fold\nK = {fold.gain:.5g}", (fold.gain, fold.amplitude), (9, 0), textcoords="offset points", fontsize=SMALL,
        va="center",
    )
    above.set_yscale("symlog", linthresh=FLOOR, linscale=0.35)
    above.set_ylim(0, 0.1)
    above.yaxis.set_major_locator(FixedLocator([0, 1e-4, 1e-3, 1e-2, 1e-1]))
    above.set_ylabel("(a)  max |x$_1$| [rad]")
    below.set_yscale("log")
    below.set_ylabel("(b)  period [s]")
    below.set_xlim(lowest, HIGHEST_GAIN)
    below.set_xlabel(GAIN_LABEL)
    figure.align_ylabels([above, below])
    key(figure, handles, 3)
    return figure


def multiplier_caption(study: Study, model: Model) -> str:
    """Floquet multipliers."""
    end, fold = ENDED[model], study.fold(model)
    first, last = study.orbit(model, START), study.orbit(model, START, "unstable")
    stable, unstable = (study.orbit(model, end, branch) for branch in ("stable", "unstable"))
    looked_at = (first, stable, unstable, last)
    trivial = below(max(o.multipliers.trivial_error for o in looked_at), 1e-6, 1e-3, 1.0)
    nothing = [np.maximum(np.abs(o.multipliers.full), o.multipliers.full_floor)[2:] for o in looked_at]
    zero = below(float(np.max(nothing)), 1e-20, 1e-6, 1.0)
    which, others = {
        "lugre": ("lambda_1 to lambda_4", "two near 0 (lambda_3 and lambda_4: stick and the stiff bristle"),
        "switch": ("lambda_1 to lambda_3", "one at 0 (lambda_3: a stick leaves one free number"),
    }[model]
    grown = int(np.floor(np.log10(_lambda(study.orbit(model, PEAKS[model], "unstable")))))
    return (
        f"The Floquet multipliers {which} of the {NAMES[model]} cycles against K; stable solid, unstable dashed. "
        f"Agrees: one at 1 (lambda_1, within {trivial}), {others}, below {zero}), and one through +1 at the fold "
        f"(lambda_2: {_lambda(stable):.4g} on the stable and {_lambda(unstable):.4g} on the unstable cycle at K = "
        f"{end}, where the report's end). Beyond: the fold, K = {fold.gain:.7g}, enlarged in (b), and the whole "
        f"unstable branch, where lambda_2 is above 1e{grown} at K = {PEAKS[model]} and {_lambda(last):.4g} at K = "
        f"{START}. lambda_2 = mu^2 hides the sign of the half multiplier mu: on the stable branch that is "
        f"{first.half_multiplier:.4g} at K = {START} and {stable.half_multiplier:.4g} at K = {end}, and passes "
        "through 0, where lambda_2 touches 0, before it reaches +1. The axis is linear up to 1 and logarithmic "
        "above."
    )


PEAKS: dict[Model, float] = {"lugre": 0.4, "switch": 0.4}
"""Gains on the unstable branch at which lambda_2 is looked up for the captions."""


def _lambda(orbit: Orbit) -> float:
    return float(orbit.multipliers.full[1].real)


def draw_multipliers(study: Study, model: Model) -> Figure:
    """All gains on the left, the fold enlarged on the right."""
    figure = sheet(9.0, 5.4)
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
    whole, near = study.branch(model), study.enlarged(model)
    for axes, branches, title in ((left, (whole, near), "(a) all gains"), (right, (near,), "(b) next to the fold")):
        _multipliers(axes, *branches)
        axes.axvline(ENDED[model], **ENDS)
        axes.set_title(title, fontsize=10)
        axes.set_xlabel(GAIN_LABEL)
        grid(axes)
    fold = study.fold(model)
    right.set_xlim(min(o.gain for o in near.orbits), fold.gain + 0.0025)
    right.annotate(
        f"fold\nK = {fold.gain:.5g}", (fold.gain, 1), (-14, -16), textcoords="offset points", fontsize=SMALL,
        ha="right", va="top", arrowprops={"arrowstyle": "-", "color": "0.3", "linewidth": 0.7, "shrinkB": 0},
    )  # fmt: skip
    left.set_xlim(0 if study.start == START else study.start - 0.02, HIGHEST_GAIN)
    left.set_ylabel("Floquet multiplier λ [–]")
    _scale(left)
    _scale(right)
    look = LOOKS[model]
    handles = [
        line("λ$_1$ (trivial)", color=FIXED, linewidth=2.0),
        line("λ$_2$, stable", color=look.colour, linewidth=look.width),
        line("λ$_2$, unstable", color=look.colour, linewidth=look.width, linestyle=DASHED),
    ]
    for i in range(2, len(fold.multipliers.full)):
        handles.append(line(f"λ$_{i + 1}$", **_dots(i)))
    handles.append(line(f"end of the report's, K = {ENDED[model]}", **ENDS))
    key(figure, handles, len(handles))
    return figure


def _dots(i: int) -> dict[str, Any]:
    marker, size, face = LOOKS_OF_ZERO[i - 2]
    faces = {"markerfacecolor": face, "markeredgecolor": "0.25"}
    return {"linestyle": "none", "marker": marker, "markersize": size, **faces}


def _multipliers(axes: Axes, *branches: Branch) -> None:
    axes.axhspan(0, 1, color="0.95", zorder=0)
    stable, unstable = with_fold(*branches)
    for orbits in (stable, unstable):
        axes.plot([o.gain for o in orbits], [_multiplier(0)(o) for o in orbits], color=FIXED, linewidth=2.0, zorder=6)
    both_parts(axes, _lambda, *branches)
    apart = (stable[-1].gain - stable[0].gain) / ZEROS
    shown = [stable[0]]
    for orbit in stable:
        if orbit.gain - shown[-1].gain > apart:
            shown.append(orbit)
    for i in range(2, len(stable[0].multipliers.full)):
        axes.plot([o.gain for o in shown], [_multiplier(i)(o) for o in shown], zorder=7, clip_on=False, **_dots(i))


def _scale(axes: Axes) -> None:
    """Linear up to 1, where most of it happens, logarithmic above."""
    high = axes.dataLim.intervaly[1]
    decades = np.log10(high)
    axes.set_yscale("symlog", linthresh=1.0, linscale=max(1.0, 0.45 * decades))
    axes.set_ylim(-0.12, 3 * high)
    step = max(1, int(np.ceil(decades / 6)))
    powers = [10.0**k for k in range(step, int(decades) + 1, step)]
    axes.yaxis.set_major_locator(FixedLocator([0, 0.25, 0.5, 0.75, 1, *powers]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(_tick))


def _tick(value: float, position: int) -> str:
    return f"{value:g}" if value <= 1 else f"$10^{{{round(np.log10(value))}}}$"


FIGURES = tuple(
    Entry(number, f"{name}, {NAMES[model]}", partial(caption, model=model), partial(draw, model=model))
    for number, model, name, caption, draw in (
        (6, "lugre", "Bifurcation diagram", diagram_caption, draw_diagram),
        (7, "lugre", "Floquet multipliers", multiplier_caption, draw_multipliers),
        (9, "switch", "Bifurcation diagram", diagram_caption, draw_diagram),
        (10, "switch", "Floquet multipliers", multiplier_caption, draw_multipliers),
    )
)
