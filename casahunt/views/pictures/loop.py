"""Bode pictures of the linear loop: the fixed controller shape of the report's Figure 1, and the loop itself.

    C(s) of servo/controller.py [V/rad],   L(s) of servo/linear/open_loop.py, C(s) cm/(s (J s + sigma2)) for one inertia

The gain moves the magnitude curves up and down; the phase curves are the same for every gain.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from ...errors import InputError
from ...servo.drive import Drive
from ...servo.linear.linear_loop import LinearLoop
from ...servo.linear.open_loop import OpenLoop, either_way, open_loop
from ...servo.linear.pulse_transfer import pulse_transfer
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import loop_asked
from ...servo.servo import Servo
from .plotting import LOOKS, MORE_LOOKS, NEUTRAL, Array, legend, logarithmic, panels, picture

BODE_POINTS = 600
"""One for every second pixel of a panel."""
ROOM = 30.0
"""The frequencies drawn reach this factor beyond every corner and crossover."""
_LOOKS = [LOOKS["switch"], LOOKS["lugre"], *MORE_LOOKS]


@picture("axes: magnitude of C and of L, phase of C and of L [deg], of a loop of parts those of L")
def bode(
    servo: Servo | Loop, loops: Sequence[LinearLoop], drive: Drive | None = None, *, ax: Any = None
) -> Array:
    """Magnitude and phase of the controller C (left) and of the loop L (right), crossovers marked.

    Parameters
    ----------
    servo, loops
        the servo, and its linear loops at the gains to be drawn; or a loop of parts, of which L alone is drawn.
    drive
        how it is run: L as built is drawn too, dotted, up to half the sample rate.

    Raises
    ------
    InputError : no loop, or one that its drive does not run as a linear one.

    Examples
    --------
    >>> from casahunt import Servo, linear_loop, pictures
    >>> axes = pictures.bode(Servo(), [linear_loop(Servo(), 0.1)])
    >>> [ax.get_ylabel() for ax in axes[:2]]
    ['|C| [V/rad]', '|L| [–]']
    """
    if not loops:
        raise InputError("loops = []: must be at least one to draw")
    ways, controller = either_way(servo), getattr(servo, "controller", None)
    opened = [open_loop(ways[loop.direction], loop.gain) for loop in loops]
    last = math.pi / drive.sample_time if drive is not None else math.nan
    omega = _frequencies(loops, opened, last)
    figure, axes = panels(ax, 2, 1 if controller is None else 2, sharex=True)
    sizes, phases = np.reshape(axes, (2, -1)).tolist()
    l_size, l_phase, firsts = sizes[-1], phases[-1], {loop.direction: i for i, loop in reversed([*enumerate(loops)])}
    phase_of_L = {way: _degrees(opened[i].response(omega)) for way, i in firsts.items()}
    handles = []
    for i, (loop, L) in enumerate(zip(loops, opened, strict=True)):
        look = _LOOKS[i % len(_LOOKS)]
        style = {"color": look.colour, "linewidth": look.width, "linestyle": look.dashes}
        if controller is not None:
            sizes[0].plot(omega, np.abs(controller.response(loop.gain, 1j * omega)), **style)
        told = ", ".join(filter(None, (loop.direction, "stable" if loop.stable else "unstable")))
        handles += l_size.plot(omega, np.abs(L.response(omega)), label=f"K = {loop.gain:.4g} ({told})", **style)
        dot = {"marker": "o", "markersize": 5, "color": look.colour, "markeredgecolor": "black"}
        for crossing in loop.gain_crossovers:
            l_size.plot(crossing.frequency, 1.0, **dot)
            at = np.interp(crossing.frequency, omega, phase_of_L[loop.direction])
            turns = round((at - crossing.margin + 180) / 360)  # the curve goes on where an angle begins anew
            l_phase.plot(crossing.frequency, crossing.margin - 180 + 360 * turns, **dot, zorder=5)
    if drive is not None:
        built = [loop_asked(ways[loop.direction], None, loop.gain, usual="switch") for loop in loops]
        handles += _as_built(built, drive, omega[omega <= last], l_size, l_phase, firsts.values())
    if controller is not None:
        phases[0].semilogx(omega, _degrees(controller.response(loops[0].gain, 1j * omega)), color=NEUTRAL)
    for way, phase in phase_of_L.items():
        l_phase.semilogx(omega, phase, color=_of_a_phase(firsts[way], firsts.values()))
    l_size.axhline(1.0, color=NEUTRAL, linewidth=0.8)
    l_phase.axhline(-180.0, color=NEUTRAL, linewidth=0.8)
    _labelled(sizes, phases)
    l_size.set_title("loop L, dry friction left out; dots: |L| = 1", fontsize=10)
    legend(figure, sizes[0], handles, frameon=False, ncols=min(len(loops), 4))
    return axes


def _of_a_phase(i: int, firsts: Collection[int]) -> str:
    """The colour of a phase that loops share: that of the first of them, where others have another phase."""
    return _LOOKS[i % len(_LOOKS)].colour if len(firsts) > 1 else NEUTRAL


def _as_built(
    loops: Sequence[Loop], drive: Drive, omega: Array, size: Any, phase: Any, firsts: Collection[int]
) -> list[Any]:
    """Draw L as built below the continuous one, its phase for the first of those that share it; returns a handle."""
    built = [pulse_transfer(loop, drive).response(omega) for loop in loops]
    for i, L in enumerate(built):
        size.plot(omega, np.abs(L), color=_LOOKS[i % len(_LOOKS)].colour, linestyle=":")
    how = {"linestyle": ":", "label": "as built"}
    drawn = [phase.semilogx(omega, _degrees(built[i]), color=_of_a_phase(i, firsts), **how) for i in firsts]
    return list(drawn[0])


def _frequencies(loops: Sequence[LinearLoop], opened: Sequence[OpenLoop], last: float) -> Array:
    """(m,) frequencies that are drawn [rad/s]: beyond every pole, zero and crossover, and a last one, if any."""
    marked = [c.frequency for loop in loops for c in (*loop.gain_crossovers, *loop.phase_crossovers)]
    marked += [abs(root) for L in opened for c in (L.numerator, L.denominator) for root in np.roots(c) if root]
    marked += [] if math.isnan(last) else [last]
    return np.geomspace(min(marked) / ROOM, max(marked) * ROOM, BODE_POINTS)


def _labelled(sizes: Sequence[Any], phases: Sequence[Any]) -> None:
    """Axes with their names, and phases with ticks where turns are."""
    for ax, label in zip(sizes[::-1], ("|L| [–]", "|C| [V/rad]"), strict=False):
        logarithmic(ax, "x", "y")
        ax.set_ylabel(label)
    for ax, label in zip(phases[::-1], ("phase of L [°], every K", "phase of C [°], every K"), strict=False):
        ax.set_ylabel(label)
        ax.set_xlabel("frequency ω [rad/s]")
        bottom, top = ax.get_ylim()
        step = 45 if top - bottom > 90 else 15
        ax.set_yticks(np.arange(math.floor(bottom / step), math.ceil(top / step) + 1) * step)
    for ax in (*sizes, *phases):
        ax.grid(True, color="0.9", linewidth=0.6)
    if len(sizes) > 1:
        sizes[0].set_title("controller C", fontsize=10)


def _degrees(response: np.ndarray) -> np.ndarray:
    """Phase [deg], continuous along the curve, starting in (-360, 0]."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    return phase - 360 * math.ceil(phase[0] / 360)
