"""Pictures of a fold: the elasticities of its gain, as bars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...axis_units import word
from ...continuation import Fold
from ...design.sensitivity import Sensitivities
from ...errors import InputError
from ...servo.problem import HuntingFold
from .orbits import look_of
from .plotting import Axes, in_units_of_the_axis, panels

MINUS = "\N{MINUS SIGN}"


@in_units_of_the_axis
def elasticities(folds: Sequence[Fold[Any]], slopes: Sequence[Sensitivities], *, ax: Axes | None = None) -> Axes:
    """Per cent of the fold gain for one per cent of each parameter, the largest on top.

    Parameters
    ----------
    folds, slopes
        folds and their sensitivities, one of each model at most.
    ax
        axes to draw into; default: those of a new figure.

    Returns
    -------
    The axes.

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
            label=_label(fold),
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


def _label(fold: Fold[Any]) -> str:
    if isinstance(fold, HuntingFold):
        return f"{fold.orbit.model}, K = {fold.gain:.6g}"
    return f"loop, {fold.parameter.replace('_', ' ')} = {fold.value:.6g}"
