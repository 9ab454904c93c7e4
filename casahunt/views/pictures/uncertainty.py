"""Picture of an uncertain fold gain: histogram of the samples, the linear interval, the worst corner."""

from __future__ import annotations

import numpy as np

from ...design.nearby import AnyFold
from ...design.uncertainty.samples import Samples
from ...design.uncertainty.summary import Summary
from ...design.uncertainty.worst_corner import WorstCase
from ...errors import InputError
from .plotting import GAIN_LABEL, LOOKS, NEUTRAL, Axes, legend, panels, picture

MOST_BINS = 40
"""Narrower ones are bars of a few pixels."""


@picture()
def histogram(fold: AnyFold, samples: Samples, worst: WorstCase, seen: Summary, *, ax: Axes | None = None) -> Axes:
    """Fold gains of the samples, with the servo's own, the linear interval and the worst corner.

    Parameters
    ----------
    fold, samples, worst
        what `find_fold`, `sample` and `worst_corner` returned.
    seen
        their `summary`.

    Raises
    ------
    InputError : no sample was computed.

    Examples
    --------
    >>> from casahunt import Servo, Uncertainty, compare_uncertainty, find_fold
    >>> from casahunt import pictures, sample_fold_gains, worst_corner
    >>> servo, uncertainty = Servo(), Uncertainty({"friction.static": (0.525, 0.535)})
    >>> fold = find_fold(servo, "switch")
    >>> given = servo, "switch", uncertainty
    >>> samples, worst = sample_fold_gains(*given, 8, fold=fold), worst_corner(*given, fold=fold)
    >>> seen = compare_uncertainty(fold, uncertainty, samples, worst)
    >>> pictures.histogram(fold, samples, worst, seen).get_ylabel()
    'samples'
    """
    gains = samples.gains[samples.computed]
    if not gains.size:
        raise InputError("samples: at least one must be computed to draw")
    figure, (axes,) = panels(ax, 1)
    bins = int(np.clip(1.3 * np.sqrt(gains.size), 5, MOST_BINS))
    look = LOOKS[getattr(fold.orbit, "model", "switch")]
    alive = int((gains > 0).sum())
    dead = "" if alive == gains.size else f", {gains.size - alive} cannot hunt (0)"
    heights, _, _ = axes.hist(
        gains, bins=bins, color="#c9d3e6", edgecolor="0.35", linewidth=0.5, label=f"{gains.size} samples{dead}"
    )
    top = float(np.max(heights))
    axes.axvline(fold.value, color=look.colour, linewidth=1.8, label=f"servo as given: {fold.value:.4g}")
    low, high = seen.linear
    axes.errorbar(
        [(low + high) / 2], [1.08 * top], xerr=[[(high - low) / 2]] * 2, color=NEUTRAL, linewidth=1.8, capsize=6,
        capthick=1.8, label=f"linear {seen.range_name.replace('+-', '±')}: {low:.4g} to {high:.4g}",
    )  # fmt: skip
    axes.axvline(
        worst.gain, color="#7a1f3d", linewidth=1.8, linestyle=(0, (6, 2)), label=f"worst corner: {worst.gain:.4g}"
    )
    axes.set(ylim=(0, 1.15 * top), xlabel=GAIN_LABEL.replace("controller gain", "fold gain"), ylabel="samples")
    axes.yaxis.get_major_locator().set_params(integer=True)
    axes.set_title("Up to which gain the servo may hunt")
    legend(figure, axes, loc="outside lower center", ncols=2)
    return axes
