"""Figures 3 and 5: a section of the state space at a fixed x1, and the bound of the stick phase for several x1."""

from __future__ import annotations

import numpy as np

from casahunt.collocation.interval import point_function
from casahunt.servo.friction import stribeck
from casahunt.views.pictures.plotting import LOOKS, NEUTRAL, Figure

from . import stick_band as regularised
from .drawing import FIXED, MARK, Axes, grid, key, line, plain, sheet
from .study import GAIN, POSITIONS, Entry, Study

Array = np.ndarray

FASTEST = 1.0
"""Velocities up to this are in Figure 3 [rad/s]."""
BAND_HEIGHT = 2.5
"""Height of half the stick band in Figure 3, in decades of the slip velocities."""
COLOURS = {"slip": LOOKS["switch"].colour, "transition": MARK, "stick": FIXED}
SHADES = ("#0b2f6b", "#3f6fb5", "#444444", "#d98a1f", "#8a4b08")
"""From negative to positive x1."""
SPEED = 0.1
"""Velocities in Figure 5 [rad/s]."""


def bound(study: Study, x1: float, x2: Array, gain: float = GAIN) -> tuple[Array, Array]:
    """x3 [rad s] of both sides of |kp x1 + ki x3| = g(x2)."""
    kp, _, ki = study.servo.torque_gains(gain)
    f = study.servo.friction
    g = np.array(stribeck(x2, f.static, f.coulomb, f.stribeck_velocity), float).ravel()
    return (-g - kp * x1) / ki, (g - kp * x1) / ki


def caption3(study: Study) -> str:
    """Section of the state space."""
    f, orbit = study.servo.friction, study.orbit("switch")
    kp, _, ki = study.servo.torque_gains(GAIN)
    x1 = -orbit.amplitude
    out, into = (-f.static - kp * x1) / ki, (f.static - kp * x1) / ki
    stick = next(arc for arc in orbit.arcs if arc.mode == "stick")
    return (
        f"Section of the state space of the regularised Switch servo at x1 = {x1:.4g} rad, K = {GAIN}: integral x3 "
        f"across, velocity x2 upwards. Agrees: the narrow stick band |x2| <= eta = {plain(f.stick_band)} rad/s and "
        "the vector fields of slip (beyond the band), stick (inside it, |m| <= Fs) and transition (inside it, |m| > "
        "Fs). Arrows have the direction of the field in the axes as drawn, not its length; the x2 axis is linear in "
        "the band and logarithmic beyond, or the band would be no wider than a hair. The list of figures gives "
        "neither K nor x1: the x1 here is that of the hunting cycle's stick. Beyond: the stick of that cycle, "
        f"thick, {stick.duration:.4g} s from x3 = {abs(stick.states[0, 0, 2]):.4g} rad s to breakaway at x3 = "
        f"{out:.4g} rad s; the stick region of this section ends at x3 = {out:.4g} and {into:.4g} rad s. Differs: "
        "the field is that of a consistent form; the stick and transition forces printed in section 3.2 have the "
        "wrong sign."
    )


def _mode_fields(study: Study, states: Array) -> tuple[Array, list[str]]:
    """Field (3, m) of the regularised servo and its modes at states (3, m)."""
    p = regularised.parameters(study.servo, GAIN)
    system = regularised.band_system(study.servo, GAIN)
    names = system.names
    modes = [regularised.mode_of(names.x(x, p), names.p(p)) for x in states.T]
    fields = []
    for x, name in zip(states.T, modes, strict=True):
        mode = system.vector_form.modes[name]
        fields.append(np.array(point_function(mode.field, 3, p.size)(x, mode.sign, p, np.ones(3))).ravel())
    return np.array(fields).T, modes


def draw3(study: Study) -> Figure:
    """Vector fields in the plane of x3 and x2."""
    f, orbit = study.servo.friction, study.orbit("switch")
    kp, _, ki = study.servo.torque_gains(GAIN)
    x1, eta = -orbit.amplitude, f.stick_band
    middle, half = -kp * x1 / ki, f.static / ki
    figure = sheet(8.0, 6.0)
    axes = figure.subplots()
    axes.set_yscale("symlog", linthresh=eta, linscale=BAND_HEIGHT)
    axes.set_xlim(middle - 2.2 * half, middle + 2.2 * half)
    axes.set_ylim(-FASTEST, FASTEST)
    axes.axhspan(-eta, eta, color="0.93", zorder=0)
    axes.fill_between([middle - half, middle + half], -eta, eta, color="#dcefe4", zorder=0.5)
    for level in (-eta, eta):
        axes.axhline(level, color=NEUTRAL, linewidth=0.9, zorder=2)
    for side in (-1, 1):
        axes.plot([middle + side * half] * 2, [-eta, eta], color=FIXED, linewidth=1.4, linestyle=(0, (4, 2)), zorder=3)
    decades = 10.0 ** np.arange(-5.5, 0, 1)
    rows = np.concatenate([-decades[::-1], np.array([-0.8, -0.4, 0, 0.4, 0.8]) * eta, decades])
    columns = middle + half * np.linspace(-2.05, 2.05, 15)
    x3, x2 = (a.ravel() for a in np.meshgrid(columns, rows))
    states = np.stack([np.full(x3.size, x1), x2, x3])
    field, modes = _mode_fields(study, states)
    figure.draw_without_rendering()  # the layout decides on the directions
    _arrows(axes, x3, x2, field, [mode.rstrip("+-") for mode in modes], eta)
    stick = next(arc for arc in orbit.arcs if arc.mode == "stick")
    held = {"color": "#8cc9a4", "linewidth": 7, "solid_capstyle": "butt", "zorder": 3}
    axes.plot([abs(float(stick.states[0, 0, 2])), middle - half], [0, 0], **held)
    _velocity_ticks(axes, eta)
    axes.set_xlabel(f"x$_3$ [rad s]     (section at x$_1$ = {x1:.4g} rad)".replace("-", "−"))
    axes.set_ylabel("x$_2$ [rad/s]")
    names = {"slip": "slip, |x$_2$| > η", "stick": "stick, |m| ≤ F$_s$", "transition": "transition, |m| > F$_s$"}
    handles = [line(names[mode], color=colour, marker=">", markersize=6) for mode, colour in COLOURS.items()]
    handles += [
        line("band |x$_2$| ≤ η", color="0.85", linewidth=9),
        line("|m| = F$_s$ in the band", color=FIXED, linewidth=1.4, linestyle=(0, (4, 2))),
        line("stick of the hunting cycle", **held),
    ]
    key(figure, handles, 3)
    return figure


def _arrows(axes: Axes, x3: Array, x2: Array, field: Array, modes: list[str], eta: float) -> None:
    """Arrows of one length in the direction in which a short piece of the motion is drawn."""
    short = 1e-3 * np.minimum(
        np.maximum(np.abs(x2), eta) / np.maximum(np.abs(field[1]), 1e-300), 1 / np.max(np.abs(field[2]))
    )
    here = axes.transData.transform(np.column_stack([x3, x2]))
    there = axes.transData.transform(np.column_stack([x3 + short * field[2], x2 + short * field[1]]))
    angles = np.degrees(np.arctan2(*(there - here).T[::-1]))
    colours = [COLOURS[mode] for mode in modes]
    axes.quiver(
        x3, x2, np.ones_like(x3), np.zeros_like(x3), angles=angles, color=colours, pivot="mid", scale=34, width=0.0026,
        headwidth=4.5, headlength=5.5, zorder=4,
    )  # fmt: skip


def _velocity_ticks(axes: Axes, eta: float) -> None:
    powers = np.array([-4, -2, 0])
    ticks = [*(-(10.0 ** powers[::-1])), -eta, 0, eta, *(10.0**powers)]
    names = [f"$-10^{{{k}}}$" for k in powers[::-1]] + ["−η", "0", "η"] + [f"$10^{{{k}}}$" for k in powers]
    axes.set_yticks(ticks, names)
    axes.minorticks_off()


def caption5(study: Study) -> str:
    """Bound of the stick phase."""
    kp, _, ki = study.servo.torque_gains(GAIN)
    f = study.servo.friction
    names = ", ".join(f"{x:g}" for x in POSITIONS)
    return (
        f"The bound |kp x1 + ki x3| < g(x2) in the plane of x3 and x2, for x1 = {names} rad, at K = {GAIN}. Agrees: "
        "inside the bound the speed |x2| falls, towards the stick phase x2 = 0; the bound moves with x1 by -kp/ki = "
        f"-{kp / ki:.4g} s, and is widest at x2 = 0, Fs/ki = {f.static / ki:.4g} rad s to each side, and Fc/ki = "
        f"{f.coulomb / ki:.4g} rad s beyond the Stribeck velocity {f.stribeck_velocity:g} rad/s. The list of figures "
        "gives neither K nor the values of x1: these are chosen here. Beyond: the bound speaks of one instant, not "
        "of the motion that follows; Figure 12 shows the states that really end in stick, Figure 13 those that come "
        "to rest."
    )


def draw5(study: Study) -> Figure:
    """The bound for several x1."""
    figure = sheet(8.0, 5.4)
    axes = figure.subplots()
    x2 = np.linspace(-SPEED, SPEED, 401)
    styles = ("-", (0, (6, 2)), "-", (0, (6, 2)), "-")
    handles = []
    for x1, colour, dashes in zip(POSITIONS, SHADES, styles, strict=True):
        style = {"color": colour, "linewidth": 2.4 if x1 == 0 else 1.6, "linestyle": dashes}
        left, right = bound(study, x1, x2)
        axes.fill_betweenx(x2, left, right, color=colour, alpha=0.06, linewidth=0)
        axes.plot(left, x2, **style)
        axes.plot(right, x2, **style)
        handles.append(line(f"x$_1$ = {x1:g} rad".replace("-", "−"), **style))
    axes.axhline(0, color=NEUTRAL, linewidth=0.9)
    limit = study.servo.friction.static / study.servo.torque_gains(GAIN)[2]
    axes.plot([-limit, limit], [0, 0], color=FIXED, linewidth=4, solid_capstyle="butt", zorder=5)
    handles.append(line("fixed points (x$_1$ = 0)", color=FIXED, linewidth=4))
    axes.set_xlabel("x$_3$ [rad s]")
    axes.set_ylabel("x$_2$ [rad/s]")
    axes.margins(x=0.03, y=0)
    grid(axes)
    key(figure, handles, 3)
    return figure


FIGURES = (
    Entry(3, "Section of the state space", caption3, draw3),
    Entry(5, "Bound of the stick phase", caption5, draw5),
)
