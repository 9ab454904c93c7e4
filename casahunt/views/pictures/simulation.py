"""Pictures of simulated motions and of measured records beside the predicted cycle.

Symbols: n states, m sample points.  States are x1 [rad], x2 [rad/s], x3 [rad s] and, for LuGre, x4 = z [rad].
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...axis_units import quantity, shown
from ...design.record.measure import Measurement
from ...orbits import Orbit
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import servo_of_loop
from ...servo.trajectory import Trajectory
from .orbits import look_of, name_of, rolled
from .plotting import (
    ALONE,
    LOOKS,
    NAMES,
    NEUTRAL,
    SMALL,
    Array,
    Line2D,
    in_one_unit,
    legend,
    panels,
    picture,
)

if TYPE_CHECKING:
    from ...servo.sampled.motion import SampledMotion

PER_INTERVAL = 8
"""Points of a drawn line in each interval of a motion, which its polynomial bends once or twice."""
DRAWN_SAMPLES, SHORT_STICK = 20_000, 10
"""Samples of a motion that are drawn; samples of a stick that is shown, more than."""
MOST_DOTS = 20_000
"""Samples of a record that are drawn."""
SPIKE, TIMES_THE_USUAL, LEAST_SHOWN = 4.0, 2.0, 1e-4
"""Where a curve exceeds what it is in the second half of the time by the first factor, as at a step, the picture goes
up to the second times that, and the peak is written down: beside it nothing else could be read.  Not where that is less
than the last part of the peak: a motion that has come to rest."""
STILL_SHOWN, MOSTLY_STILL = 0.25, 2.0
"""Of a motion that changes no more, as parts of the time in which it does; where a motion is so many times as long as
that, the rest is not drawn, and the time axis says so."""
SHADE = "0.9"
"""Colour behind a stick."""
LEVEL_COLOUR = "#b03020"


@picture("three axes")
def motion(trajectory: Trajectory, *, ax: Any = None) -> Array:
    """Position, velocity and motor torque of a simulated motion against time [s].

    Where the motor sticks the background is grey; the torque is shown with its static friction +-Fs, if it has any.

    Parameters
    ----------
    trajectory
        the motion.

    Examples
    --------
    >>> from casahunt import Servo, simulate, pictures
    >>> axes = pictures.motion(simulate(Servo(), "switch", 0.04, time=60.0))
    >>> axes[2].get_xlabel()
    'time [s]'
    """
    t, x = trajectory.dense(PER_INTERVAL)
    verdict = trajectory.verdict
    loop = trajectory.loop
    called = NAMES[trajectory.model] if servo_of_loop(loop) else "loop" if loop.name == Loop.name else loop.name
    name = f"{called}, K = {trajectory.gain:.4g}"
    name += f": {verdict.kind}{', irregularly' if verdict.irregular else ''}"
    if verdict.kind == "hunting":
        name += f", amplitude {quantity(verdict.amplitude, 'rad')}, period {verdict.period:.4g} s"
    curves = trajectory.set_point + x[0], x[1], trajectory.signal("torque", t)
    colour, static = LOOKS[trajectory.model].colour, trajectory.loop.parameters.get("static")
    levels = () if static is None else (-static, static)
    three = _three(ax, t, curves, trajectory.sticks, name, colour, trajectory.set_point, levels)
    if trajectory.move is not None:
        way = trajectory.set_point - trajectory.signal("remaining", t)
        three[0].plot(t, way, color=NEUTRAL, linewidth=1.0, linestyle=(0, (5, 2)), zorder=3)
    return three


@picture("three axes")
def sampled_motion(found: SampledMotion, *, ax: Any = None) -> Array:
    """As `motion`, of the loop as built; the torque is what each sample asks for.

    Parameters
    ----------
    found
        the motion.

    Examples
    --------
    >>> from casahunt import Drive, Servo, simulate_sampled, pictures
    >>> axes = pictures.sampled_motion(simulate_sampled(Servo(), 0.04, Drive(sample_time=1e-3, encoder=2000)))
    >>> axes[2].get_xlabel()
    'time [s]'
    """
    every = max(1, found.torque.size // DRAWN_SAMPLES)
    t, x, torque = found.times[:-1], found.states[:, :-1], found.torque
    edges = np.flatnonzero(np.diff((x[1] == 0).astype(int)))
    pieces = zip([0, *(edges + 1)], [*edges, t.size - 1], strict=True)
    sticks = [(t[a], t[b]) for a, b in pieces if x[1, a] == 0 and b > a + SHORT_STICK]
    kept = np.unique(np.concatenate([np.arange(0, t.size, every), edges]))
    title = f"as built, {found.drive.sample_time:g} s, K = {found.gain:.4g}: {found.verdict.kind}"
    curves = found.set_point + x[0, kept], x[1, kept], torque[kept]
    levels = (-found.static, found.static)
    return _three(ax, t[kept], curves, sticks, title, LOOKS[found.model].colour, found.set_point, levels)


def _three(
    given: Any, t: Array, curves: Sequence[Array], sticks: Sequence[tuple[float, float]], title: str, colour: str,
    set_point: float, levels: Sequence[float],
) -> Array:  # fmt: skip
    """Position, velocity and torque over the time, the sticks grey, the torque with the levels of static friction."""
    figure, three = panels(given, 3, sharex=True, height_ratios=(1.4, 1, 1))
    position, (*first, set_point) = in_one_unit("rad", curves[0], set_point)
    velocity, second = in_one_unit("rad/s", curves[1])
    torque, (*third, levels) = in_one_unit("N m", curves[2], np.array(levels))
    curves, units = (*first, *second, *third), (position, velocity, torque)
    symbols = ("x", "x'", "motor force F") if shown().linear else ("θ", "θ'", "motor torque m")
    labels = f"position {symbols[0]}", f"velocity {symbols[1]}", symbols[2]
    for ax, values, label, unit in zip(three, curves, labels, units, strict=True):
        for stick in sticks:
            ax.axvspan(*stick, color=SHADE, linewidth=0, zorder=0)
        ax.plot(t, values, color=colour, linewidth=ALONE, zorder=4)
        ax.set_ylabel(f"{label} [{unit}]")
        ax.grid(True, color="0.85", linewidth=0.6)
        ax.margins(x=0, y=0.08)
    dashed = {"color": NEUTRAL, "linewidth": 1.0, "linestyle": (0, (5, 2)), "zorder": 3}
    three[0].axhline(set_point, **dashed)
    for level in levels:
        three[2].axhline(level, **dashed)
    for ax, values, centre, least, unit in (
        (three[0], curves[0], set_point, 0.0, units[0]), (three[1], curves[1], 0.0, 0.0, units[1]),
        (three[2], curves[2], 0.0, max(levels, default=0.0), units[2]),
    ):  # fmt: skip
        # Cut off a spike, as at a step, beside which nothing else could be read; least: that is shown about the centre
        away = np.abs(values - centre)
        usual, peak = max(float(away[t >= t[-1] / 2].max()), least), float(away.max())
        if LEAST_SHOWN * peak < usual < peak / SPIKE:
            ax.set_ylim(centre - TIMES_THE_USUAL * usual, centre + TIMES_THE_USUAL * usual)
            said = f"off the scale, farthest: {values[np.argmax(away)]:.3g} {unit}"
            box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2}
            ax.text(0.99, 0.93, said, transform=ax.transAxes, ha="right", va="top", fontsize=SMALL, bbox=box, zorder=5)
    # The time axis goes to the end, or a little beyond the time behind which no curve changes any more.
    changed = [np.flatnonzero(np.abs(each - each[-1]) > LEAST_SHOWN * np.ptp(each)) for each in curves]
    last = max(int(away[-1]) + 1 if away.size else 0 for away in changed)
    still = t[0] + (1 + STILL_SHOWN) * (t[last] - t[0])
    end = float(still if 0 < last and still < t[-1] / MOSTLY_STILL else t[-1])
    if end < t[-1]:
        three[2].set_xlim(t[0], end)
    three[2].set_xlabel("time [s]" + (f"; nothing more happens until {t[-1]:.4g} s" if end < t[-1] else ""))
    if figure is not None:
        figure.align_ylabels(three)
    handles = [Line2D([], [], label="set point; static friction ±F$_s$" if len(levels) else "set point", **dashed)]
    three[0].set_title(title, fontsize="medium")
    if sticks:
        handles.append(Line2D([], [], color=SHADE, linewidth=8, label="stick"))
    legend(figure, three[0], handles, frameon=False, ncols=len(handles))
    return three


def _size(amplitude: float, frequency: float) -> str:
    return f"amplitude {quantity(amplitude, 'rad')}, frequency {frequency:.4g} Hz"


@picture("two axes")
def folded_record(measurement: Measurement, orbit: Orbit | None = None, *, ax: Any = None) -> Array:
    """A record above, and below all its periods laid over each other with one period of the predicted cycle.

    Parameters
    ----------
    measurement
        of a record with whole periods.
    orbit
        the prediction, or None.

    Examples
    --------
    >>> from casahunt import Servo, find_orbit, measure, simulate, pictures
    >>> found = measure(simulate(Servo(), "switch", 0.04, time=60.0))
    >>> axes = pictures.folded_record(found, find_orbit(Servo(), "switch", 0.04))
    >>> axes[0].get_ylabel()
    'position [rad]'
    """
    figure, both = panels(ax, 2, height_ratios=(1, 1.6))
    (above, below), record = both, measurement.record
    every = max(1, record.times.size // MOST_DOTS)
    t = record.times[::every]
    named, (y, drawn) = in_one_unit("rad", record.position[::every], measurement.level[::every])
    beside = shown().near(measurement.amplitude, "rad")
    gap = np.flatnonzero(np.diff(t) > measurement.period / 4) + 1  # no line across a gap
    above.plot(np.insert(t, gap, np.nan), np.insert(y, gap, np.nan), color=NEUTRAL, linewidth=0.8, zorder=3)
    above.plot(t, drawn, color=LEVEL_COLOUR, linewidth=1.4, linestyle=(0, (5, 2)), zorder=4)
    for edge in measurement.crossings:
        above.axvline(edge, color="0.8", linewidth=0.7, zorder=1)
    above.set(xlabel="time [s]", ylabel=f"position [{named}]")
    above.margins(x=0, y=0.08)

    dots = {"linestyle": "none", "marker": "o", "markersize": 2.2, "color": "0.55", "alpha": 0.6, "zorder": 2}
    period = measurement.period
    for edge, own in zip(measurement.starts, measurement.periods, strict=True):
        here = (t >= edge - period / 4) & (t < edge + own - period / 4)
        off = (record.position - measurement.level)[::every][here]
        below.plot(t[here] - edge, shown().number(off, "rad", beside), **dots)
    averages = _size(measurement.amplitude, measurement.frequency)
    handles = [
        Line2D([], [], label=f"record, {measurement.periods.size} periods: {averages}", **dots | {"markersize": 4}),
        Line2D([], [], color=LEVEL_COLOUR, linewidth=1.4, linestyle=(0, (5, 2)), label="level"),
    ]
    if orbit is not None:
        look, sense = look_of(orbit), 1.0 if measurement.rising else -1.0
        times, states = orbit.sample(PER_INTERVAL)
        times, states = rolled(times, sense * states)
        below.plot(times, shown().number(sense * states[0], "rad", beside), color=look.colour, linewidth=2.0, zorder=5)
        foretold = f"{name_of(orbit)}: {_size(orbit.amplitude, 1 / orbit.period)}"
        handles.append(Line2D([], [], color=look.colour, linewidth=2.0, label=foretold))
    below.axhline(0, color="0.6", linewidth=0.7, zorder=1)
    rise = "rise" if measurement.rising else "fall"
    below.set(xlabel=f"time from the {rise} through the level [s]", ylabel=f"position − level [{beside}]")
    below.grid(True, color="0.9", linewidth=0.6)
    below.margins(x=0.01, y=0.1)
    legend(figure, below, handles, frameon=False)
    if figure is not None:
        figure.align_ylabels(both)
    return both
