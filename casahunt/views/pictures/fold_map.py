"""Picture of the fold gain over two parameters: contours, with what could not be computed left white."""

from __future__ import annotations

import numpy as np

from ...design.fold_map import FoldMap
from ...errors import InputError
from ..answers.answer import named
from .fold_curve import LABELS, WIDE
from .plotting import NAMES, SMALL, Axes, MaxNLocator, in_units_of_the_axis, panels

CONTOURS = 9
"""At most: more of them stand closer than their labels are high."""
NEVER = "#d9d9d9"
"""Colour where no gain hunts."""


@in_units_of_the_axis
def fold_map(folds: FoldMap, *, ax: Axes | None = None) -> Axes:
    """The fold gain as contours over two parameters; above a contour's gain the servo on it does not hunt.

    Parameters
    ----------
    folds
        what `fold_map` returned.
    ax
        axes to draw into; default those of a new figure.

    Returns
    -------
    The axes; the colour bar beside them has its own.

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
    levels, norm = _levels(low, high), "log" if high > WIDE * low else "linear"
    filled = axes.contourf(q, r, seen, levels=levels, cmap="cividis", extend="both", norm=norm)
    lines = axes.contour(q, r, seen, levels=levels, colors="black", linewidths=0.5)
    for text in axes.clabel(lines, fontsize=SMALL, fmt="%.3g"):
        text.set_bbox({"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.8})
    never = np.ma.masked_where(gains != 0, np.ones_like(gains))
    if never.count():
        axes.pcolormesh(q, r, never, cmap="gray", vmin=0, vmax=1.15, shading="nearest", zorder=0)
        axes.plot([], [], "s", color=NEVER, label="hunts at no gain")
    axes.set_xlim(q[0], q[-1])
    axes.set_ylim(r[0], r[-1])
    here = [folds.servo.value(name) for name in folds.names]
    if q[0] <= here[0] <= q[-1] and r[0] <= here[1] <= r[-1]:
        axes.plot(*here, marker="o", color="white", markeredgecolor="black", linestyle="none", label="servo as given")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best", fontsize=SMALL)
    bar = axes.figure.colorbar(filled, ax=axes)
    bar.set_label("fold gain K [V/rad]: above it the servo does not hunt")
    axes.set_xlabel(LABELS.get(folds.names[0], named(folds.names[0])))
    axes.set_ylabel(LABELS.get(folds.names[1], named(folds.names[1])))
    friction = "" if folds.model is None else f", {NAMES[folds.model]} friction"
    axes.set_title(f"The largest gain at which the servo can hunt{friction}")
    return axes


def _levels(low: float, high: float) -> np.ndarray:
    """Round gains from the lowest to the highest: equally far apart, or 1, 2, 5, 10 where they span decades."""
    if not high > low:
        return np.array([low * (1 - 1e-9), low * (1 + 1e-9)])
    if high <= WIDE * low:
        return np.asarray(MaxNLocator(CONTOURS).tick_values(low, high))
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    levels = np.sort(np.outer(decades, [1.0, 2.0, 5.0]).ravel())
    return levels[(levels > low / 2.5) & (levels < high * 2.5)]
