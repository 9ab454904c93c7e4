"""The event map of the Switch servo as a cobweb picture: P(a) and the line P = a, with motions between them.

The border between settling and hunting: where two motions stand or turn, swing after swing, from a little inside of
it and a little outside.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from ...axis_units import quantity
from ...motion import MarchFailure
from ...servo.basin import Basin
from ...servo.event_map.fixed_points import FixedPoints
from ...servo.event_map.slopes import map_at
from .plotting import (
    LOOKS,
    MORE_LOOKS,
    NEUTRAL,
    Axes,
    MaxNLocator,
    in_one_unit,
    legend,
    logarithmic,
    panels,
    picture,
)

DRAWN_SWINGS = 12
"""Half periods drawn of each motion."""
ASIDE = 0.02
"""A motion starts this part above and below the unstable fixed point."""


@picture()
def cobweb(seen: FixedPoints, *, ax: Axes | None = None) -> Axes:
    """P(a) against a, both logarithmic, gaps at jumps, with two motions from beside the innermost fixed point.

    Parameters
    ----------
    seen
        a scan of the map.

    Examples
    --------
    >>> from casahunt import Servo, fixed_points, pictures
    >>> pictures.cobweb(fixed_points(Servo(), 0.6, 1e-3, 3e-3, points=10)).get_xscale()
    'log'
    """
    figure, (axes,) = panels(ax, 1)
    a = np.array([p.start for p in seen.points])
    P = np.array([abs(p.position) for p in seen.points])
    back = np.array([p.position < 0 for p in seen.points])
    shown = np.where(P > 0, P, np.nan)
    for jump in seen.jumps:
        where = int(np.searchsorted(a, jump.start))
        a, shown, back = np.insert(a, where, jump.start), np.insert(shown, where, np.nan), np.insert(back, where, False)
    look = LOOKS["switch"]
    axes.plot(a, np.where(back, np.nan, shown), color=look.colour, linewidth=1.8, label="P(a), across the set point")
    if np.any(back):
        axes.plot(a, np.where(back, shown, np.nan), color=look.colour, linewidth=1.8, linestyle=":",
                  label="|P(a)|, stuck on the same side")  # fmt: skip
    axes.plot([seen.low, seen.high], [seen.low, seen.high], color=NEUTRAL, linewidth=1.0, label="P = a")
    for f in seen.fixed:
        axes.plot(
            f.amplitude, f.amplitude, marker="o", markersize=8, linestyle="none", zorder=8, markeredgecolor="black",
            markerfacecolor=look.colour if f.stable else "white",
            label=f"{'stable' if f.stable else 'unstable'}, a = {f.amplitude:.4g} rad, μ = {f.multiplier:.4g}",
        )  # fmt: skip
    if seen.fixed:
        inner = seen.fixed[0].amplitude
        for factor, more, word in ((1 + ASIDE, MORE_LOOKS[0], "above"), (1 - ASIDE, MORE_LOOKS[1], "below")):
            x, y = [inner * factor], [inner * factor]
            with suppress(MarchFailure):
                for _ in range(DRAWN_SWINGS):
                    if not (P_a := abs(map_at(seen.servo, seen.gain, x[-1]).position)) > 0:
                        break
                    x, y = [*x, x[-1], P_a], [*y, P_a, P_a]
            axes.plot(x, y, color=more.colour, linewidth=1.1, linestyle=more.dashes, zorder=5,
                      label=f"motion from 2 % {word} the innermost")  # fmt: skip
    logarithmic(axes, "x", "y")
    axes.set(xlim=(seen.low, seen.high), ylim=(seen.low, seen.high))
    axes.set(xlabel="stick position a [rad]", ylabel="next stick position P(a) [rad]")
    axes.set_title(f"event map of the Switch servo, K = {seen.gain:.6g}", fontsize=10)
    axes.grid(True, color="0.9", linewidth=0.6)
    legend(figure, axes, frameon=False, ncols=2)
    return axes


@picture()
def basin(found: Basin, *, ax: Any = None) -> Axes:
    """Stick position against the number of the swing, of the motions from both sides, with the two cycles as lines.

    Parameters
    ----------
    found
        the border.

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
