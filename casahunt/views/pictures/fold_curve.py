"""Picture of fold curves: the gains with and without hunting, against another parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...axis_units import shown
from ...continuation import SpecialCurve
from ...design.fold_curve.data import FoldCurve, cubic_through_points
from ...errors import InputError
from ...servo.friction import MODELS
from ...servo.parts.table import unit_of
from .plotting import GAIN_LABEL, LOOKS, NAMES, NEUTRAL, SMALL, Axes, in_units_of_the_axis, logarithmic, panels

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


@in_units_of_the_axis
def fold_curves(curves: Sequence[FoldCurve], *, ax: Axes | None = None) -> Axes:
    """The fold gain against a parameter of the servo, the gains with hunting shaded.

    The line is the cubic through the computed points with their exact slopes.  A curve that turns back in a cusp is
    drawn without shade: what lies below it is not the gains with hunting.

    Parameters
    ----------
    curves
        fold curves in the same parameter, one of each model at most.
    ax
        axes to draw into; default: those of a new figure.

    Returns
    -------
    The axes.

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
        look = LOOKS[curve.model]
        q, K = cubic_through_points(curve)
        label = f"fold, {NAMES[curve.model]} friction"
        axes.plot(q, K, color=look.colour, linewidth=look.width, zorder=look.zorder)
        axes.plot(
            curve.values, curve.gains, color=look.colour, linestyle="none", marker=look.marker, markersize=4,
            zorder=look.zorder,
        )  # fmt: skip
        axes.plot([], [], color=look.colour, linewidth=look.width, marker=look.marker, markersize=4, label=label)
        if not curve.cusps:
            axes.fill_between(q, floor, K, color=look.colour, alpha=SHADING, linewidth=0, zorder=1)
        for cusp in curve.cusps:
            axes.plot(cusp.value, cusp.gain, color=look.colour, marker="D", markersize=8, fillstyle="none", zorder=9)
            axes.annotate("cusp", (cusp.value, cusp.gain), textcoords="offset points", xytext=(8, 4), fontsize=SMALL)
    axes.set_ylim(floor, ceiling)
    least, most = min(float(c.values.min()) for c in curves), max(float(c.values.max()) for c in curves)
    if least > 0 and most > WIDE * least:
        logarithmic(axes, "x")
    axes.set_xlim(least, most)
    if not any(curve.cusps for curve in curves):
        _words(axes, curves, wide)
    axes.set_xlabel(LABELS[vary])
    axes.set_ylabel(GAIN_LABEL)
    axes.grid(True, which="major", color="0.88", linewidth=0.6)
    axes.legend(loc="best", fontsize=SMALL)
    axes.set_title("The largest gain at which the servo can hunt")
    return axes


@in_units_of_the_axis
def loop_border(curve: SpecialCurve, way: str, *, ax: Axes | None = None) -> Axes:
    """The border of hunting of a loop of parts in two parameters; "up" or "down" to it there are cycles.

    ax: as of `fold_curves`.
    """
    _, (axes,) = panels(ax, 1)
    look, (x, q) = LOOKS[MODELS[0]], curve.values.T
    axes.plot(q, x, color=look.colour, linewidth=look.width, marker=look.marker, markersize=4)
    if not curve.turns.any():
        below = way == "up"
        axes.fill_between(q, 0 if below else x, x if below else HEADROOM * x.max(), color=look.colour, alpha=SHADING)
    axes.set_ylim(min(0.0, float(x.min())), HEADROOM * float(x.max()))
    axes.set_xlim(q.min(), q.max())
    for name, label in ((curve.other, axes.set_xlabel), (curve.vary, axes.set_ylabel)):
        unit = shown().si.label(unit_of(name))
        label(GAIN_LABEL if name == "gain" else f"{name.replace('_', ' ')} {f'[{unit}]' if unit else ''}".rstrip())
    axes.grid(True, which="major", color="0.88", linewidth=0.6)
    axes.set_title("Where hunting ends: in the shade there are cycles")
    return axes


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
