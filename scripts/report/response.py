"""Figures 1 and 2: the controller, and the hunting response."""

from __future__ import annotations

import numpy as np

from casahunt.servo.gains import routh_hurwitz_gain
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.views.pictures.plotting import LOOKS, NEUTRAL, Figure

from .drawing import DASHED, MARK, below, grid, key, line, sheet
from .study import GAIN, MEASURED_AMPLITUDE, MEASURED_PERIOD, SECONDS, START, TRANSIENT, Entry, Study

LOOP_GAINS = (GAIN, 0.1)
BELOW = 0.02
"""A gain below the report's bound."""
SHOWN_VELOCITY = 0.45
"""Limit of the panel of Figure 2 [rad/s]: the first swing leaves it."""


def caption1(study: Study) -> str:
    """Controller."""
    c = study.servo.controller
    corner = 1 / (2 * np.pi * c.lead_time)
    low, high = (abs(c.response(k, np.array([1j / c.lead_time]))[0]) for k in LOOP_GAINS)
    slow, *loops = (linear_loop(study.servo, k) for k in (BELOW, *LOOP_GAINS))
    margins = [loop.gain_crossovers[0].margin for loop in loops]
    return (
        f"Magnitude and phase of the controller C(s) for K = {LOOP_GAINS[0]} and {LOOP_GAINS[1]}. Agrees: the fixed "
        f"shape tau_i = tau_d = 1/(2 pi) s (Table 1), a double zero at {corner:.4g} Hz, where |C| is {low:.4g} and "
        f"{high:.4g} V/rad; K moves the magnitude and leaves the phase alone; without viscous friction the loop is "
        f"stable above K = {routh_hurwitz_gain(study.servo):.6g}, the report's {START}. Differs: with the viscous "
        f"friction of Table 1 the linear loop is stable at every K > 0; at K = {BELOW}, below that bound, its phase "
        f"margin is {slow.gain_crossovers[0].margin:.3g} degrees and its slowest pole has the real part "
        f"{slow.poles[0].real:.3g} 1/s. Beyond: the phase margins of the loop are {margins[0]:.3g} degrees at K = "
        f"{LOOP_GAINS[0]} and {margins[1]:.3g} degrees at K = {LOOP_GAINS[1]}; a stable linear loop does not mean that "
        "the servo does not hunt."
    )


def draw1(study: Study) -> Figure:
    """Bode diagram of the controller."""
    figure = sheet(7.0, 5.2)
    size, phase = figure.subplots(2, 1, sharex=True)
    hertz = np.geomspace(0.01, 100, 401)
    handles = []
    for gain, colour, dashes in zip(LOOP_GAINS, ("black", MARK), ("-", (0, (5, 3))), strict=True):
        response = study.servo.controller.response(gain, 2j * np.pi * hertz)
        style = {"color": colour, "linewidth": 1.8, "linestyle": dashes}
        size.plot(hertz, 20 * np.log10(np.abs(response)), **style)
        phase.plot(hertz, np.degrees(np.angle(response)), **style)
        handles.append(line(f"K = {gain} V/rad", **style))
    size.set_ylabel("magnitude |C| [dB re 1 V/rad]")
    phase.set_ylabel("phase of C [°]")
    phase.set_yticks(np.arange(-90, 91, 45))
    phase.set_xscale("log")
    phase.set_xlabel("frequency [Hz]")
    for axes in (size, phase):
        axes.margins(x=0, y=0.08)
        grid(axes)
    key(figure, handles, 2)
    return figure


def settled(study: Study) -> tuple[np.ndarray, np.ndarray]:
    """Swings (k,) [rad] and durations of the half periods (k,) [s] of the response after the transient."""
    crossings, peaks = study.motion().shape()
    late = crossings > TRANSIENT
    return peaks[1:-1][late[:-1]], np.diff(crossings[late])


def caption2(study: Study) -> str:
    """Hunting response."""
    swings, halves = settled(study)
    amplitude, period, orbit = float(np.mean(swings)), 2 * float(np.mean(halves)), study.orbit("lugre")
    apart = max(np.max(np.abs(swings / orbit.amplitude - 1)), np.max(np.abs(2 * halves / orbit.period - 1)))
    motion = study.motion()
    x = motion.dense(6)[1]
    effort = motion.torque(x) / study.servo.motor_gain
    return (
        f"The hunting response at K = {GAIN}, theta_d = 1 rad, {SECONDS:.0f} s: angle, velocity, integral of theta - "
        "theta_d and control effort u. Measured there; simulated here (LuGre, from rest at theta = 0), since the "
        f"record is not public. The first swing, up to {np.max(np.abs(x[1])):.3g} rad/s, leaves the panel of the "
        f"velocity; its effort is {np.max(np.abs(effort)):.3g} V at most. Agrees: the servo ends hunting about the "
        f"set point. Differs: the mean of {halves.size} half periods after {TRANSIENT:.0f} s is an amplitude of "
        f"{amplitude:.3g} rad at {1 / period:.3g} Hz; measured were {MEASURED_AMPLITUDE} rad and "
        f"{1 / MEASURED_PERIOD:.3g} Hz. Beyond: each of these half periods is the limit cycle computed as a boundary "
        f"value problem, {orbit.amplitude:.5g} rad and {orbit.period:.5g} s, to within "
        f"{below(float(apart), 1e-4, 1e-3, 1e-2, 1.0)} of both; the measured ones are averages over periods that "
        "differ."
    )


def draw2(study: Study) -> Figure:
    """Four panels against time."""
    motion = study.motion()
    t, x = motion.dense(6)
    figure = sheet(8.0, 7.0)
    panels = figure.subplots(4, 1, sharex=True)
    effort = motion.torque(x) / study.servo.motor_gain
    curves = (
        (motion.set_point + x[0], "angle θ [rad]"),
        (x[1], "velocity θ' [rad/s]"),
        (x[2], "∫(θ − θ$_d$) dt [rad s]"),
        (effort, "control effort u [V]"),
    )
    look = LOOKS["lugre"]
    for axes, (values, label) in zip(panels, curves, strict=True):
        axes.plot(t, values, color=look.colour, linewidth=1.6, zorder=4)
        axes.set_ylabel(label)
        axes.margins(x=0, y=0.08)
        grid(axes)
    dashed = {"color": NEUTRAL, "linewidth": 1.0, "linestyle": DASHED, "zorder": 3}
    measured = {"color": MARK, "linewidth": 1.0, "linestyle": (0, (1, 1.5)), "zorder": 3}
    limit = {"color": NEUTRAL, "linewidth": 1.0, "linestyle": (0, (6, 2, 1, 2)), "zorder": 3}
    panels[0].axhline(motion.set_point, **dashed)
    for sign in (1, -1):
        panels[0].axhline(motion.set_point + sign * MEASURED_AMPLITUDE, **measured)
        panels[3].axhline(sign * study.servo.friction.static / study.servo.motor_gain, **limit)
    panels[3].set_yticks([-0.05, 0, 0.05])
    panels[1].set_ylim(-SHOWN_VELOCITY, SHOWN_VELOCITY)
    panels[3].set_xlabel("time [s]")
    figure.align_ylabels(panels)
    handles = [
        line("simulated, LuGre", color=look.colour, linewidth=1.6),
        line("set point θ$_d$", **dashed),
        line("measured mean amplitude (report)", **measured),
        line("±F$_s$/c$_m$", **limit),
    ]
    key(figure, handles, 4)
    return figure


FIGURES = (
    Entry(1, "Controller", caption1, draw1),
    Entry(2, "Hunting response", caption2, draw2),
)
