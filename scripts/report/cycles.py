"""Figures 4, 8 and 11: limit cycles, against time and in the space of x1, x2, x3."""

from __future__ import annotations

from typing import Any

import numpy as np

from casahunt.orbits.orbit import Orbit
from casahunt.servo.equilibria import equilibria
from casahunt.servo.friction import Model
from casahunt.views.pictures.orbits import rolled
from casahunt.views.pictures.plotting import LOOKS, MORE_LOOKS, NAMES, Figure

from .drawing import DASHED, FIXED, MARK, SAMPLES, grid, key, label_space, line, sheet, space
from .study import ENDED, GAIN, MEASURED_AMPLITUDE, MEASURED_PERIOD, WINDOW, Entry, Study

Array = np.ndarray
MODELS: tuple[Model, ...] = ("lugre", "switch")
LABELS = ("x$_1$ [rad]", "x$_2$ [rad/s]", "x$_3$ [rad s]")
DOTS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 2.2, "color": "0.2", "zorder": 7}
MEASURED: dict[str, Any] = {"color": MARK, "linewidth": 1.2, "linestyle": (0, (1, 1.5)), "zorder": 1}
RECORD_POINTS = 121
UNSTABLE = MORE_LOOKS[0].colour


def rise(study: Study) -> float:
    """The rise of the response through the set point a quarter of a period after `WINDOW` [s]."""
    motion, quarter = study.motion(), study.orbit("lugre").period / 4
    crossings = motion.shape()[0]
    rising = crossings[motion.sample(crossings)[1] > 0]
    return float(rising[np.argmin(np.abs(rising - quarter - WINDOW))])


def record(study: Study) -> tuple[Array, Array]:
    """Times (m,) and states (3, m) of one period of the response, where the report's begins."""
    period, zero = study.orbit("lugre").period, rise(study)
    t = np.linspace(zero - period / 4, zero + 3 * period / 4, RECORD_POINTS)
    return t, study.motion().sample(t)[:3]


def caption4(study: Study) -> str:
    """One period."""
    a, b = study.orbit("switch"), study.orbit("lugre")
    t, _ = record(study)
    ratios = [
        (100 * (o.amplitude / MEASURED_AMPLITUDE - 1), 100 * (o.period / MEASURED_PERIOD - 1)) for o in (a, b)
    ]
    return (
        f"(a) The states over one period at K = {GAIN}, (b) the phase portrait of x1, x2, x3. In the report the "
        "period from about 75 to 85 s, measured, LuGre and Switch. The measured one is not public: dots are the "
        f"simulated response of Figure 2 (LuGre) from {t[0]:.1f} to {t[-1]:.1f} s, and the dotted frame shows the "
        "measured averages. Agrees: short slips and long sticks on both sides, Switch and LuGre close to each "
        f"other: amplitudes {a.amplitude:.5g} and {b.amplitude:.5g} rad, periods {a.period:.5g} and {b.period:.5g} "
        f"s, about the 10 s of that window. Differs: the measured averages of section 2 are {MEASURED_AMPLITUDE} rad "
        f"and {MEASURED_PERIOD:.2g} s; against them the amplitude is {ratios[0][0]:+.0f} % (Switch) and "
        f"{ratios[1][0]:+.0f} % (LuGre), the period {ratios[0][1]:+.0f} % and {ratios[1][1]:+.0f} %. Beyond: the "
        "cycles are solved as boundary value problems, not simulated until they seem to repeat; half multipliers mu "
        f"= {a.half_multiplier:.4g} and {b.half_multiplier:.4g}, both stable."
    )


def draw4(study: Study) -> Figure:
    """States against time on the left, phase portrait on the right."""
    figure = sheet(10.0, 5.6)
    cells = figure.add_gridspec(3, 2, width_ratios=(1.15, 1))
    panels = [figure.add_subplot(cells[0, 0])]
    panels += [figure.add_subplot(cells[i, 0], sharex=panels[0]) for i in (1, 2)]
    portrait = space(figure, cells[:, 1])
    zero = rise(study)
    t, x = record(study)
    for axes, values in zip(panels, x, strict=True):
        axes.plot(t, values, **DOTS)
    portrait.plot(*x, **DOTS)
    handles = [line("simulated response (LuGre)", **DOTS)]
    for model in MODELS:
        look, orbit = LOOKS[model], study.orbit(model)
        times, states = rolled(*orbit.sample(SAMPLES))
        style = {"color": look.colour, "linewidth": look.width, "zorder": look.zorder}
        for axes, values in zip(panels, states, strict=False):
            axes.plot(zero + times, values, **style)
        portrait.plot(*states[:3], **style)
        handles.append(line(NAMES[model], **style))
    for sign in (1, -1):
        panels[0].axhline(sign * MEASURED_AMPLITUDE, **MEASURED)
    for edge in (zero - MEASURED_PERIOD / 4, zero + 3 * MEASURED_PERIOD / 4):
        panels[0].axvline(edge, **MEASURED)
    handles.append(line("measured amplitude and period", **MEASURED))
    for axes, label in zip(panels, LABELS, strict=True):
        axes.set_ylabel(label)
        axes.margins(x=0.02, y=0.1)
        grid(axes)
    for axes in panels[:2]:
        axes.tick_params(labelbottom=False)
    panels[2].set_xlabel("time [s]")
    panels[0].set_title("(a)", fontsize=10)
    portrait.set_title("(b)", fontsize=10)
    label_space(portrait, LABELS, 0.85, ticks=3)
    figure.align_ylabels(panels)
    key(figure, handles, 4)
    return figure


def _cycle_words(orbit: Orbit) -> str:
    mu = orbit.half_multiplier
    return (
        f"amplitude {orbit.amplitude:.5g} rad, period {orbit.period:.5g} s, mu = {mu:.4g}, lambda = {mu**2:.3g}"
    )


def _in_space(study: Study, model: Model) -> Figure:
    """Fixed points, stable and unstable cycle at the gain where the report's diagram ends."""
    gain = ENDED[model]
    limit = equilibria(study.servo, model, gain).integral_limit
    figure = sheet(7.5, 6.2)
    axes = space(figure, 111)
    fixed = {"color": FIXED, "linewidth": 4, "solid_capstyle": "butt", "zorder": 2}
    axes.plot([0, 0], [0, 0], [-limit, limit], **fixed)
    handles = [line("fixed points", **fixed)]
    styles = {
        "stable": {"color": LOOKS[model].colour, "linewidth": 2.2, "linestyle": "-", "zorder": 4},
        "unstable": {"color": UNSTABLE, "linewidth": 1.5, "linestyle": DASHED, "zorder": 5},
    }
    for branch, style in styles.items():
        orbit = study.orbit(model, gain, branch)
        axes.plot(*orbit.sample(SAMPLES)[1][:3], **style)
        handles.append(line(f"{branch} cycle", **style))
    label_space(axes, LABELS, 0.98)
    key(figure, handles, 3)
    return figure


def _space_caption(study: Study, model: Model) -> str:
    gain, number = ENDED[model], {"lugre": 6, "switch": 9}[model]
    stable, unstable = (study.orbit(model, gain, branch) for branch in ("stable", "unstable"))
    limit = equilibria(study.servo, model, gain).integral_limit
    bristle = ", with the bristle bent to z = -ki x3/sigma0" if model == "lugre" else ""
    return (
        f"Fixed points, stable and unstable cycle of {NAMES[model]} at K = {gain}, in (x1, x2, x3). Agrees: the "
        f"three sets at the gain where the report's Figure {number} ends. Fixed points: x1 = x2 = 0, |x3| <= Fs/ki = "
        f"{limit:.5g} rad s{bristle}. Stable cycle: {_cycle_words(stable)}. Unstable cycle: "
        f"{_cycle_words(unstable)}. Beyond: the two cycles are this close because the fold is near, at K = "
        f"{study.fold(model).gain:.6g}; shooting over one period multiplies its errors by lambda = mu^2."
    )


FIGURES = (
    Entry(4, "One period and phase portrait", caption4, draw4),
    Entry(8, "Fixed points and cycles, LuGre", lambda study: _space_caption(study, "lugre"),
          lambda study: _in_space(study, "lugre")),
    Entry(11, "Fixed points and cycles, Switch", lambda study: _space_caption(study, "switch"),
          lambda study: _in_space(study, "switch")),
)  # fmt: skip
