"""Bode pictures of the linear loop: the fixed controller shape of the report's Figure 1, and the loop itself.

    C(s) of servo/controller.py [V/rad],   L(s) = C(s) cm/(s (J s + sigma2))

The gain moves the magnitude curves up and down; the phase curves are the same for every gain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import InputError
from ...servo.linear_loop import LinearLoop, controller_response, loop_response
from ...servo.servo import Servo
from .plotting import LOOKS, MORE_LOOKS, NEUTRAL, Array, legend, logarithmic, panels

BODE_POINTS = 600
"""One for every second pixel of a panel."""
ROOM = 30.0
"""The frequencies drawn reach this factor beyond every corner and crossover."""


def bode(servo: Servo, loops: Sequence[LinearLoop], *, ax: Any = None) -> Array:
    """Magnitude and phase of the controller C (left) and of the loop L (right), crossovers marked.

    Parameters
    ----------
    servo, loops
        the servo, and its linear loops at the gains to be drawn.
    ax
        four axes to draw into; default: those of a new figure.

    Returns
    -------
    The four axes: magnitude of C and of L, phase of C and of L [deg], against omega [rad/s].

    Raises
    ------
    InputError : no loop.

    Examples
    --------
    >>> from casahunt import Servo, linear_loop, pictures
    >>> axes = pictures.bode(Servo(), [linear_loop(Servo(), 0.1)])
    >>> [ax.get_ylabel() for ax in axes[:2]]
    ['|C| [V/rad]', '|L| [–]']
    """
    if not loops:
        raise InputError("loops = []: must be at least one to draw")
    crossings = [c.frequency for loop in loops for c in (*loop.gain_crossovers, *loop.phase_crossovers)]
    corners = [1 / tau for tau in servo.controller.corners if tau > 0]
    low, high = min(corners + crossings), max(corners + crossings)
    omega = np.geomspace(low / ROOM, high * ROOM, BODE_POINTS)
    figure, four = panels(ax, 2, 2, sharex=True)
    c_size, l_size, c_phase, l_phase = four
    looks = [LOOKS["switch"], LOOKS["lugre"], *MORE_LOOKS]
    handles = []
    for i, loop in enumerate(loops):
        look = looks[i % len(looks)]
        style = {"color": look.colour, "linewidth": look.width, "linestyle": look.dashes}
        handles += c_size.plot(
            omega, np.abs(controller_response(servo, loop.gain, omega)),
            label=f"K = {loop.gain:.4g} ({'stable' if loop.stable else 'unstable'})", **style,
        )  # fmt: skip
        l_size.plot(omega, np.abs(loop_response(servo, loop.gain, omega)), **style)
        dot = {"marker": "o", "markersize": 5, "color": look.colour, "markeredgecolor": "black"}
        for crossing in loop.gain_crossovers:
            l_size.plot(crossing.frequency, 1.0, **dot)
            l_phase.plot(crossing.frequency, crossing.margin - 180, **dot, zorder=5)
    c_phase.semilogx(omega, _degrees(controller_response(servo, loops[0].gain, omega)), color=NEUTRAL)
    l_phase.semilogx(omega, _degrees(loop_response(servo, loops[0].gain, omega)), color=NEUTRAL)
    l_size.axhline(1.0, color=NEUTRAL, linewidth=0.8)
    l_phase.axhline(-180.0, color=NEUTRAL, linewidth=0.8)
    for ax, label in ((c_size, "|C| [V/rad]"), (l_size, "|L| [–]")):
        logarithmic(ax, "x", "y")
        ax.set_ylabel(label)
    for ax, label in ((c_phase, "phase of C [°], every K"), (l_phase, "phase of L [°], every K")):
        ax.set_ylabel(label)
        ax.set_xlabel("frequency ω [rad/s]")
        bottom, top = ax.get_ylim()
        step = 45 if top - bottom > 90 else 15
        ax.set_yticks(np.arange(math.floor(bottom / step), math.ceil(top / step) + 1) * step)
    for ax in four:
        ax.grid(True, color="0.9", linewidth=0.6)
    c_size.set_title("controller C", fontsize=10)
    l_size.set_title("loop L, dry friction left out; dots: |L| = 1", fontsize=10)
    legend(figure, c_size, handles, frameon=False, ncols=min(len(loops), 4))
    return four


def _degrees(response: np.ndarray) -> np.ndarray:
    """Phase [deg], continuous along the curve, starting in (-360, 0]."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    start = math.fmod(phase[0], 360)
    return phase - phase[0] + (start if start <= 0 else start - 360)
