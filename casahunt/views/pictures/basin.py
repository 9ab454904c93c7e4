"""The border between settling and hunting: where two motions stand or turn, swing after swing, from a little inside of
it and a little outside."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...axis_units import quantity
from ...servo.basin import Basin
from .plotting import (
    LOOKS,
    MORE_LOOKS,
    NEUTRAL,
    Axes,
    MaxNLocator,
    in_one_unit,
    in_units_of_the_axis,
    legend,
    logarithmic,
    panels,
)


@in_units_of_the_axis
def basin(found: Basin, *, ax: Any = None) -> Axes:
    """Stick position against the number of the swing, of the motions from both sides, with the two cycles as lines.

    Parameters
    ----------
    found
        the border.
    ax
        axes to draw into; default: those of a new figure.

    Returns
    -------
    The axes.

    Raises
    ------
    InputError : what was given are no axes, or not as many as there are panels.

    Examples
    --------
    >>> from casahunt import Servo, basin, pictures
    >>> ax = pictures.basin(basin(Servo(), "switch", 0.5))
    >>> ax.get_xlabel(), ax.get_yscale()
    ('swing', 'log')
    """
    figure, (panel,) = panels(ax, 1)
    look = LOOKS[found.model]
    named, (border, outer, outside, inside) = in_one_unit(
        "rad", found.border, found.outer_position, found.outside.positions, found.inside.positions
    )
    for trial, positions, style, word in (
        (found.outside, outside, look, "outside"), (found.inside, inside, MORE_LOOKS[0], "inside"),
    ):  # fmt: skip
        there = positions > 0
        panel.plot(
            np.flatnonzero(there), positions[there], color=style.colour, marker=style.marker,
            linewidth=style.width, label=f"from a little {word}: {trial.outcome}",
        )  # fmt: skip
    panel.axhline(border, color=NEUTRAL, linestyle="--", linewidth=1.2,
                  label=f"border: {quantity(found.border, 'rad')}")  # fmt: skip
    if found.outer is not None:
        kind = "stable" if found.outer.stable else "symmetric"
        panel.axhline(outer, color=NEUTRAL, linewidth=1.2,
                      label=f"{kind} cycle: {quantity(found.outer_position, 'rad')}")  # fmt: skip
    logarithmic(panel, "y")
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    panel.set(xlabel="swing", ylabel=f"stick position [{named}]")
    panel.grid(True, color="0.9", linewidth=0.6)
    legend(figure, panel, frameon=False, ncols=2)
    return panel
