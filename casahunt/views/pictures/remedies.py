"""Pictures of remedies: amplitude of the hunting against the size of each, up to where it ends; where it rests."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np

from ...axis_units import label, quantity, shown, word
from ...design.remedies.cures import Cure, Cures
from ...errors import InputError, NoOrbit
from ...servo.outcome import SETTLES
from .fold_curve import HEADROOM
from .plotting import ALONE, NEUTRAL, Axes, legend, logarithmic, panels, picture, png

MOST_COLUMNS = 4
"""Panels in a row: more cannot be read."""
PANEL_SIZE = 3.4, 2.8
"""Width and height of a panel [in]."""
ROOM_BELOW = 0.06
"""Room for marks at zero, in heights of a panel."""
RESTING = "#1d6b3f"
MOST_IN_LEGEND = 4
LOGARITHMIC_FROM = 60.0
"""Ratio of sizes from which their axis is logarithmic."""
MOST_TICKS = 4
"""Intervals between ticks at most: more run into each other."""


@picture("axes of the first panel")
def remedy_sizes(found: Cures, *, ax: Axes | None = None) -> Axes:
    """A panel for each remedy with a border: amplitude against size, the border marked, and what is behind it.

    Parameters
    ----------
    found
        what `remedies` has found.

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
    return _panel_each(rows, ax, "have a border", _size, f"max |x1| [{label('rad')}]")


def _size(place: Axes, row: Cure) -> None:
    """Amplitude against size, up to the border and behind it."""
    values, highest = [], 1.0
    try:
        branch = row.branch()
        values, amplitudes = list(branch.values), [orbit.amplitude for orbit in branch.orbits]
        # Behind the border unstable cycles may become as large as anything.
        highest = max(amplitudes[: 1 + int(np.argmax(np.abs(np.array(values) - values[0])))])
        amplitudes = shown().number(np.array(amplitudes), "rad")
        values, highest = list(shown().number(np.array(values), row.unit)), shown().number(highest, "rad")
        place.plot(values, amplitudes, label="cycles")
    except NoOrbit:
        place.text(0.5, 0.5, "branch not followed", ha="center", transform=place.transAxes)
    size, beyond = shown().number(row.size, row.unit), [shown().number(x, row.unit) for x in row.beyond]
    place.axvline(size, color="C3", linestyle="--", label="no stable cycle beyond")
    for ended, marker, colour, said in ((True, "o", RESTING, "motions end at rest"), (False, "x", "C3", "they do not")):
        sizes = [at for at, seen in zip(beyond, row.stays, strict=True) if (seen in SETTLES) is ended]
        place.plot(sizes, [0.0] * len(sizes), marker, color=colour, label=said)
    top = HEADROOM * highest
    place.set_ylim(-ROOM_BELOW * top, top)
    sizes = [size, *beyond, *values]
    if min(sizes) > 0 and max(sizes) > LOGARITHMIC_FROM * min(sizes):
        logarithmic(place, "x")
    place.set_title(f"{row.name}: {quantity(row.size, row.unit)}".rstrip())
    place.set_xlabel(f"size [{label(row.unit)}]" if row.unit else "size")


@picture("axes of the first panel")
def rest_positions(found: Cures, *, ax: Axes | None = None) -> Axes:
    """A panel for each remedy: error and torque at which the servo may stand still for ever, with the size to choose.

    Without a remedy that is the set point, with any torque that static friction holds.  Of a remedy that does not end
    hunting the set is that of the last size that was looked at; it may be wider than its panel, which all share.

    Parameters
    ----------
    found
        what `remedies` has found.

    Raises
    ------
    InputError : of no remedy the set is known, or axes are given for several.

    Examples
    --------
    >>> from casahunt import Servo, pictures, remedies
    >>> found = remedies(Servo(), "switch", 0.04, only=["leak"])
    >>> pictures.rest_positions(found).get_title()
    'leak: within 0.03294 rad'
    """
    rows = [row for row in found.remedies if row.rests]
    if not rows:
        raise InputError("remedies: of none of them the set of rest positions is known, so there is nothing to draw")
    ending = [row for row in rows if row.ends_hunting] or rows
    corners = np.abs([corner for row in ending for corner in row.rests]).max(axis=0)
    reach, torque = shown().number(corners[0], "rad"), shown().number(corners[1], "N m")
    swing = shown().number(found.amplitude, "rad")
    first = _panel_each(rows, ax, "have a set", _rest_set, f"{word('torque')} [{label('N m')}]")
    if ax is None:
        for place in first.figure.axes:
            place.set_xlim(-HEADROOM * (reach or swing), HEADROOM * (reach or swing))
            place.set_ylim(-HEADROOM * (torque or 1.0), HEADROOM * (torque or 1.0))
    return first


def _rest_set(place: Axes, row: Cure) -> None:
    """The set of rest positions."""
    x1, torque = np.array([*row.rests, row.rests[0]]).T
    corners = np.array([shown().number(x1, "rad"), shown().number(torque, "N m")]).T
    place.axhline(0, color=NEUTRAL, linewidth=0.5)
    place.axvline(0, color=NEUTRAL, linewidth=0.5)
    place.fill(corners[:, 0], corners[:, 1], color=RESTING, alpha=0.25)
    place.plot(corners[:, 0], corners[:, 1], color=RESTING, linewidth=2 * ALONE, marker="o", label="rests")
    reach = np.abs(x1).max()
    within = f"within {quantity(reach, 'rad')}"
    place.locator_params("x", nbins=MOST_TICKS)
    place.set_title(f"{row.name}: {within if reach else 'set point alone'}")
    place.set_xlabel(f"x1 [{label('rad')}]")


def page_images(found: Cures) -> dict[str, bytes]:
    """The images of the page: PNG files by name; what cannot be drawn is left out."""
    images = {}
    for name, draw in (("sizes", remedy_sizes), ("rests", rest_positions)):
        with suppress(InputError):
            images[name] = png(draw(found))
    return images


def _panel_each(
    rows: Sequence[Cure], ax: Axes | None, have: str, draw: Callable[[Axes, Cure], None], ordinate: str
) -> Axes:
    """A panel for every remedy, of a new figure or, for one of them, of the user's; the axes of the first."""
    if ax is not None and len(rows) > 1:
        raise InputError(f"ax: holds one remedy, and {len(rows)} {have}; ask for one with `only`")
    columns = min(MOST_COLUMNS, len(rows))
    lines = -(-len(rows) // columns)
    figure, axes = panels(ax, lines, columns)
    every = list(axes.flat)
    for place, row in zip(every, rows, strict=False):
        draw(place, row)
    for place in every[::columns]:
        place.set_ylabel(ordinate)
    for place in every[len(rows) :]:
        place.set_visible(False)
    if figure is not None:
        figure.set_size_inches(PANEL_SIZE[0] * columns, PANEL_SIZE[1] * lines)
    legend(figure, every[0], every[0].get_legend_handles_labels()[0], ncols=min(columns + 1, MOST_IN_LEGEND))
    return every[0]
