"""Picture of fold curves: the gains with and without hunting, against another parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...axis_units import word
from ...continuation import Fold
from ...design.fold_curve import FoldCurve, cubic_through_points
from ...design.fold_map import FoldMap
from ...design.sensitivity import Sensitivities
from ...errors import InputError
from ...servo.friction import MODELS
from ...servo.problem import HuntingFold
from ..answers.answer import named
from .orbits import look_of
from .plotting import (
    GAIN_LABEL,
    LOOKS,
    NAMES,
    NEUTRAL,
    SMALL,
    Axes,
    MaxNLocator,
    logarithmic,
    panels,
    picture,
)

LABELS = {
    "servo.inertia": "inertia J [kg m$^2$]",
    "servo.motor_gain": "motor gain c$_m$ [N m/V]",
    "controller.lead_time": "lead time τ$_d$ [s]",
    "controller.integral_time": "integral time τ$_i$ [s]",
    "controller.kp": "proportional gain k$_p$ (times K)",
    "controller.ki": "integral gain k$_i$ [1/s] (times K)",
    "controller.kd": "derivative gain k$_d$ [s] (times K)",
    "friction.static": "static friction F$_s$ [N m]",
    "friction.coulomb": "Coulomb friction F$_c$ [N m]",
    "friction.stribeck_velocity": "Stribeck velocity v$_s$ [rad/s]",
    "friction.viscous": "viscous friction σ$_2$ [N m s/rad]",
    "friction.stiffness": "bristle stiffness σ$_0$ [N m/rad]",
    "friction.damping": "bristle damping σ$_1$ [N m s/rad]",
}
"""Name, symbol and unit of every parameter."""
SHADING = 0.16
"""Of the gains that hunt: faint enough that grid and lines of two models, one over the other, are seen through it."""
WIDE = 30.0
"""Ratio of the values of an axis from which on it is logarithmic."""
HEADROOM = 1.12
"""The axis reaches this factor beyond the highest gain."""


@picture()
def fold_curves(curves: Sequence[FoldCurve], *, ax: Axes | None = None) -> Axes:
    """The fold gain against a parameter of the servo, the gains with hunting shaded; or that of a loop.

    The line is the cubic through the computed points with their exact slopes.  A curve that turns back in a cusp is
    drawn without shade: what lies below it is not the gains with hunting.

    Parameters
    ----------
    curves
        fold curves in the same parameter, one of each model at most, or that of a loop of parts.

    Raises
    ------
    InputError : none, or curves in different parameters.

    Examples
    --------
    >>> from casahunt import Servo, fold_curve, pictures
    >>> curve = fold_curve(Servo(), "switch", vary="friction.static", start=0.53, end=0.54, points=2)
    >>> pictures.fold_curves([curve]).get_xlabel()
    'static friction F$_s$ [N m]'
    """
    if not curves or len({curve.vary for curve in curves}) != 1:
        raise InputError(f"{len(curves)} fold curves: must be at least one, all in the same parameter")
    vary = curves[0].vary
    _, (axes,) = panels(ax, 1)
    highest = max(float(curve.gains.max()) for curve in curves)
    lowest = min(float(curve.gains.min()) for curve in curves)
    wide = highest > WIDE * lowest and not any(curve.vanishes for curve in curves)
    if wide:
        logarithmic(axes, "y")
    floor, ceiling = (lowest / 3, highest * 3) if wide else (0.0, highest * HEADROOM)
    for curve in curves:
        _one(axes, curve, floor, ceiling)
    axes.set_ylim(floor, ceiling)
    least, most = min(float(c.values.min()) for c in curves), max(float(c.values.max()) for c in curves)
    if least > 0 and most > WIDE * least:
        logarithmic(axes, "x")
    axes.set_xlim(least, most)
    if not any(curve.cusps or curve.way == "down" for curve in curves):
        _words(axes, curves, wide)
    axes.set_xlabel(LABELS.get(vary, named(vary)))
    axes.set_ylabel(GAIN_LABEL if curves[0].fold_in == "gain" else named(curves[0].fold_in))
    axes.grid(True, which="major", color="0.88", linewidth=0.6)
    axes.legend(loc="best", fontsize=SMALL)
    of_loop = curves[0].model is None
    axes.set_title("Where hunting ends" if of_loop else "The largest gain at which the servo can hunt")
    return axes


def _one(axes: Any, curve: FoldCurve, floor: float, ceiling: float) -> None:
    """A curve, with its shade."""
    look = LOOKS[curve.model or MODELS[0]]
    q, K = cubic_through_points(curve)
    label = "fold" if curve.model is None else f"fold, {NAMES[curve.model]} friction"
    axes.plot(q, K, color=look.colour, linewidth=look.width, zorder=look.zorder)
    axes.plot(
        curve.values, curve.gains, color=look.colour, linestyle="none", marker=look.marker, markersize=4,
        zorder=look.zorder,
    )  # fmt: skip
    axes.plot([], [], color=look.colour, linewidth=look.width, marker=look.marker, markersize=4, label=label)
    if not curve.cusps:
        beyond = floor if curve.way == "up" else ceiling
        axes.fill_between(q, beyond, K, color=look.colour, alpha=SHADING, linewidth=0, zorder=1)
    for cusp in curve.cusps:
        axes.plot(cusp.value, cusp.border, color=look.colour, marker="D", markersize=8, fillstyle="none", zorder=9)
        axes.annotate("cusp", (cusp.value, cusp.border), textcoords="offset points", xytext=(8, 4), fontsize=SMALL)


def _words(axes: Any, curves: Sequence[FoldCurve], wide: bool) -> None:
    """What the regions are, where each is widest."""
    left, right = axes.get_xlim()
    floor, ceiling = axes.get_ylim()
    spread = np.geomspace if axes.get_xscale() == "log" else np.linspace
    place = spread(left, right, 41)[5:-5]
    size = np.log if wide else np.asarray
    lower = np.full(place.size, np.inf)
    upper = np.full(place.size, -np.inf)
    for curve in curves:
        q, K = cubic_through_points(curve)
        order = np.argsort(q)
        there = np.interp(place, q[order], K[order])
        lower, upper = np.minimum(lower, there), np.maximum(upper, there)
    back = np.exp if wide else np.asarray
    below, above = int(np.argmax(size(lower))), int(np.argmin(size(upper)))
    texts = (
        (place[below], back((size(floor) + size(lower[below])) / 2), "hunting"),
        (place[above], back((size(upper[above]) + size(ceiling)) / 2), "no hunting cycle"),
    )
    for x, y, text in texts:
        axes.text(x, float(y), text, color=NEUTRAL, ha="center", va="center", zorder=10)


# Picture of the fold gain over two parameters: contours, with what could not be computed left white

CONTOURS = 9
"""At most: more of them stand closer than their labels are high."""
NEVER = "#d9d9d9"
"""Colour where no gain hunts."""


@picture("axes; the colour bar beside them has its own")
def fold_map(folds: FoldMap, *, ax: Axes | None = None) -> Axes:
    """The fold gain as contours over two parameters; above a contour's gain the servo on it does not hunt.

    Parameters
    ----------
    folds
        what `fold_map` returned.

    Raises
    ------
    InputError : no fold was computed.

    Examples
    --------
    >>> from casahunt import Servo, fold_map, pictures
    >>> names, values = ("friction.static", "friction.viscous"), ([0.53, 0.54], [0.09, 0.1])
    >>> pictures.fold_map(fold_map(Servo(), "switch", names, *values)).get_ylabel()
    'viscous friction σ$_2$ [N m s/rad]'
    """
    gains = folds.gains.T
    positive = gains[gains > 0]
    if not positive.size:
        raise InputError("fold map: at least one fold must be computed to draw")
    _, (axes,) = panels(ax, 1)
    low, high = float(positive.min()), float(positive.max())
    q, r = folds.values
    seen = np.ma.masked_where(~(gains > 0), gains)
    # Round gains from the lowest to the highest: equally far apart, or 1, 2, 5, 10 where they span decades
    levels, norm = np.array([low * (1 - 1e-9), low * (1 + 1e-9)]), "log" if high > WIDE * low else "linear"
    if norm == "log":
        decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
        levels = np.sort(np.outer(decades, [1.0, 2.0, 5.0]).ravel())
        levels = levels[(levels > low / 2.5) & (levels < high * 2.5)]
    elif high > low:
        levels = np.asarray(MaxNLocator(CONTOURS).tick_values(low, high))
    filled = axes.contourf(q, r, seen, levels=levels, cmap="cividis", extend="both", norm=norm)
    lines = axes.contour(q, r, seen, levels=levels, colors="black", linewidths=0.5)
    for text in axes.clabel(lines, fontsize=SMALL, fmt="%.3g"):
        text.set_bbox({"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8})
    never = np.ma.masked_where(gains != 0, np.ones_like(gains))
    if never.count():
        axes.pcolormesh(q, r, never, cmap="gray", vmin=0, vmax=1.15, shading="nearest", zorder=0)
        axes.plot([], [], "s", color=NEVER, label="hunts at no gain")
    axes.set(xlim=(q[0], q[-1]), ylim=(r[0], r[-1]))
    here = [folds.servo.value(name) for name in folds.names]
    if q[0] <= here[0] <= q[-1] and r[0] <= here[1] <= r[-1]:
        axes.plot(*here, marker="o", color="white", markeredgecolor="black", linestyle="none", label="servo as given")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best", fontsize=SMALL)
    bar = axes.figure.colorbar(filled, ax=axes)
    bar.set_label("fold gain K [V/rad]: above it the servo does not hunt")
    across, up = (LABELS.get(name, named(name)) for name in folds.names)
    axes.set(xlabel=across, ylabel=up)
    friction = "" if folds.model is None else f", {NAMES[folds.model]} friction"
    axes.set_title(f"The largest gain at which the servo can hunt{friction}")
    return axes


# Pictures of a fold: the elasticities of its gain, as bars

MINUS = "\N{MINUS SIGN}"


@picture()
def elasticities(folds: Sequence[Fold[Any]], slopes: Sequence[Sensitivities], *, ax: Axes | None = None) -> Axes:
    """Per cent of the fold gain for one per cent of each parameter, the largest on top.

    Parameters
    ----------
    folds, slopes
        folds and their sensitivities, one of each model at most.

    Raises
    ------
    InputError : none, or not as many sensitivities as folds.

    Examples
    --------
    >>> from casahunt import Servo, find_fold, fold_sensitivities, pictures
    >>> fold = find_fold(Servo(), "switch")
    >>> pictures.elasticities([fold], [fold_sensitivities(fold)]).get_title()
    'What moves the gain at which hunting ends'
    """
    if not folds or len(folds) != len(slopes):
        raise InputError(f"{len(folds)} folds with {len(slopes)} sensitivities: must be as many, at least one")
    _, (axes,) = panels(ax, 1)
    every = dict.fromkeys(name for each in slopes for name in each.elasticities)
    largest = {name: max(abs(s.elasticities.get(name, 0.0)) for s in slopes) for name in every}
    names = sorted((name for name in every if largest[name] > 0), key=lambda name: largest[name])
    place = np.arange(len(names))
    height = 0.8 / len(folds)
    for k, (fold, slope) in enumerate(zip(folds, slopes, strict=True)):
        values = np.array([slope.elasticities.get(name, 0.0) for name in names])
        bars = axes.barh(
            place + (len(folds) - 1 - 2 * k) * height / 2, values, height, color=look_of(fold.orbit).colour,
            label=f"{fold.orbit.model}, K = {fold.gain:.6g}" if isinstance(fold, HuntingFold)
            else f"loop, {fold.parameter.replace('_', ' ')} = {fold.value:.6g}",
        )  # fmt: skip
        axes.bar_label(bars, [f"{value:+.3g}".replace("-", MINUS) for value in values], padding=3, fontsize=9)
    axes.set_yticks(place, [word(name).replace("_", " ").replace(".", ": ") for name in names])
    axes.axvline(0, color="0.3", linewidth=0.8)
    axes.margins(x=0.15)
    what = folds[0].parameter.replace("_", " ")
    axes.set_xlabel(f"per cent of the fold {what} for one per cent more of the parameter")
    axes.set_title(f"What moves the {what} at which hunting ends")
    axes.legend(loc="lower right")
    return axes
