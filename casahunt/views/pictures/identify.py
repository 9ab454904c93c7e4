"""Picture of an identification: the records laid over the cycle that was fitted, and what is left of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...design.identify.fit import seen_by
from ...design.identify.identify import Identification
from .plotting import LOOKS, NAMES, Array, Line2D, legend, panels, picture
from .simulation import MOST_DOTS

DOTS = ("0.55", "#7a1f3d", "#5fae8c", "#b0509b", "#555555")
"""Colours of the records, in turn."""


@picture("two axes")
def fitted_records(found: Identification, *, ax: Any = None) -> Array:
    """Positions of all records against the time in their period, with the cycle at the first gain; below, what is left.

    Parameters
    ----------
    found
        what `identify` returned.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt import Record, Servo, find_orbit, identify, pictures
    >>> t, states = find_orbit(Servo(), "switch", 0.04).sample(100)
    >>> times = np.arange(0.0, 60.0, 0.02)
    >>> record = Record(times, np.interp(times % t[-1], t, states[0]))
    >>> found = identify([record], Servo(), 0.04, free=["friction.static"], advise=False)
    >>> pictures.fitted_records(found)[1].get_ylabel()
    'position − model [rad]'
    """
    figure, both = panels(ax, 2, height_ratios=(1.6, 1))
    above, below = both
    look, handles = LOOKS[found.model or "switch"], []
    for i, (data, rest, phase, orbit) in enumerate(
        zip(found.records, found.residuals, found.phases, found.orbits, strict=True)
    ):
        every = max(1, data.times.size // MOST_DOTS)
        part = ((data.times - phase) / orbit.period % 1)[::every]
        dots = {"linestyle": "none", "marker": "o", "markersize": 2.2, "color": DOTS[i % len(DOTS)], "alpha": 0.5}
        level = float(np.mean(data.position))
        above.plot(part, (data.position - level)[::every], zorder=2, **dots)
        below.plot(part, rest[::every], zorder=2, **dots)
        t, states = orbit.sample()
        above.plot(t / orbit.period, states[seen_by(found.servo)], color=look.colour, linewidth=look.width, zorder=4)
        label = f"{data.name}, K = {data.gain:.4g}: amplitude {orbit.amplitude:.4g} rad, period {orbit.period:.4g} s"
        handles.append(Line2D([], [], label=label, **dots | {"markersize": 4}))
    judgement = found.judgement
    verdict = "explains" if judgement.explained else "does not explain"
    left = f"{judgement.systematic:.2g} of the amplitude is left beside noise"
    label = f"{NAMES[found.model] if found.model else 'the loop'}, which {verdict} it: {left}"
    handles.append(Line2D([], [], color=look.colour, linewidth=look.width, label=label))
    below.axhline(0, color=look.colour, linewidth=1.0, zorder=4)
    above.set(ylabel="position − mean [rad]")
    below.set(xlabel="part of a period", ylabel="position − model [rad]")
    for ax in both:
        ax.grid(True, color="0.9", linewidth=0.6)
        ax.margins(x=0.01)
    legend(figure, below, handles, frameon=False)
    if figure is not None:
        figure.align_ylabels(both)
    return both
