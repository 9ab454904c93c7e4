"""Pictures of remedies: amplitude of the hunting against the size of each, up to where it ends."""

from __future__ import annotations

import math

from ...design.remedies.remedies import Cures
from ...errors import InputError, NoOrbit
from .fold_curve import HEADROOM
from .plotting import Axes, panels

MOST_COLUMNS = 4
"""Panels in a row: more cannot be read."""


def remedy_sizes(found: Cures, *, ax: Axes | None = None) -> Axes:
    """A panel for each remedy with a border: amplitude against size, the border marked.

    Parameters
    ----------
    found
        what `remedies` has found.
    ax
        axes to draw into, of one remedy alone; default: those of a new figure.

    Returns
    -------
    The axes of the first panel.

    Raises
    ------
    InputError : no remedy has a border, or axes are given for several.

    Examples
    --------
    >>> from casahunt import Servo, pictures, remedies
    >>> found = remedies(Servo(), "switch", 0.04, only=["leak"])
    >>> pictures.remedy_sizes(found).get_title()
    'leak: 0.2468 1/s'
    """
    rows = [row for row in found.remedies if row.first is not None and math.isfinite(row.size)]
    if not rows:
        raise InputError("remedies: none of them has a size at which hunting ends, so there is nothing to draw")
    if ax is not None and len(rows) > 1:
        raise InputError(f"ax: holds one remedy, and {len(rows)} have a border; ask for one with `only`")
    columns = min(MOST_COLUMNS, len(rows))
    figure, axes = panels(ax, -(-len(rows) // columns), columns)
    every = list(axes.flat)
    for place, row in zip(every, rows, strict=False):
        try:
            branch = row.branch()
            orbits = branch.orbits
            place.plot(branch.values, [orbit.amplitude for orbit in orbits])
        except NoOrbit:
            orbits = ()
            place.text(0.5, 0.5, "branch not followed", ha="center", transform=place.transAxes)
        place.axvline(row.size, color="C3", linestyle="--", label="no cycle beyond")
        place.set_ylim(0, HEADROOM * max((orbit.amplitude for orbit in orbits), default=1.0))
        place.set_title(f"{row.name}: {row.size:.4g} {row.unit}".rstrip())
        place.set_xlabel(f"size [{row.unit}]" if row.unit else "size")
    for place in every[::columns]:
        place.set_ylabel("max |x1| [rad]")
    for place in every[len(rows) :]:
        place.set_visible(False)
    if figure is not None:
        figure.set_size_inches(3.4 * columns, 2.8 * (-(-len(rows) // columns)))
    every[0].legend()
    return every[0]
