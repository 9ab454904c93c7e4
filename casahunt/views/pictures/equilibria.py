"""Equilibria as pictures: where the servo rests, in the stick region of Switch; the generalised Jacobian of LuGre."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...axis_units import quantity, shown
from ...servo.equilibria import Equilibria
from .plotting import LOOKS, MORE_LOOKS, NEUTRAL, SMALL, Array, logarithmic, panels, picture

LEVELS = (0.0, 0.001, 0.01, 0.1, 1.0, 2.0)
"""Values of c whose eigenvalues get a colour of their own."""
DRAWN_TO, STRETCHED = 10.0, 1e3
"""What has no limit is drawn up to so many rad; by so much position is stretched to tell the order of corners."""


@picture("one axes, or of LuGre two: the largest real part, and the eigenvalues")
def equilibria(found: Equilibria, *, ax: Any = None) -> Array:
    """Equilibria of Switch in the plane (x1, x3) with the stick region, of other loops in that of x1 and the torque; or
    the eigenvalues of LuGre.

    Parameters
    ----------
    found
        the equilibria.

    Examples
    --------
    >>> from casahunt import Servo, equilibria, pictures
    >>> (axes,) = pictures.equilibria(equilibria(Servo(), "switch", 0.1))
    >>> axes.get_title()
    'stick region of the Switch servo, K = 0.1'
    """
    if found.largest.size:
        return _eigenvalues(found, ax)
    return _strip(found, ax) if math.isfinite(found.sharp[0]) else _rests(found, ax)


def _rests(found: Equilibria, given: Any) -> Array:
    _, (axes,) = panels(given, 1)
    units, looks = shown(), [LOOKS["switch"], LOOKS["lugre"], *MORE_LOOKS]
    for each, look in zip(found.rests, looks, strict=False):
        x1, torque = each.corners[:, each.names.index("x1")].clip(-DRAWN_TO, DRAWN_TO), each.corners[:, -1]
        round_it = np.argsort(np.arctan2(torque - torque.mean(), (x1 - x1.mean()) * STRETCHED))
        corners = units.number(x1[round_it], "rad"), units.number(torque[round_it], "N m")
        axes.fill(*corners, color=look.colour, alpha=0.4, linewidth=4, label=each.mode)
    of_motor = f"{units.word('torque of the motor')} [{units.label('N m')}]"
    axes.set(xlabel=f"x₁ [{units.label('rad')}]", ylabel=of_motor)
    axes.set_title(f"where the servo can stand still for ever, K = {found.gain:.6g}", fontsize=10)
    axes.grid(True, color="0.9", linewidth=0.6)
    axes.legend(fontsize=SMALL)
    return np.array([axes], dtype=object)


def _strip(found: Equilibria, given: Any) -> Array:
    _, (axes,) = panels(given, 1)
    a, b = found.position_limit, found.integral_limit
    x1 = np.linspace(-3, 3, 121)
    axes.fill_between(x1, -1 - x1, 1 - x1, color="0.9", label="stick: |kp x1 + ki x3| ≤ Fs, x2 = 0")
    for sign in (1, -1):
        leaves = sign * x1 >= 0  # x3' = x1: the upper line is left for x1 > 0
        axes.plot(x1[leaves], (sign - x1)[leaves], color=MORE_LOOKS[0].colour, linewidth=1.6,
                  label="breakaway" if sign > 0 else None)  # fmt: skip
        axes.plot(x1[~leaves], (sign - x1)[~leaves], color=NEUTRAL, linewidth=1.2, linestyle="--",
                  label="boundary where motions enter" if sign > 0 else None)  # fmt: skip
    for start in (-2.0, -1.0, -0.4, 0.4, 1.0, 2.0):
        side = np.sign(start)
        axes.annotate("", (start, 0.85 * side - start), (start, -0.85 * side - start),
                      arrowprops={"arrowstyle": "->", "color": NEUTRAL, "linewidth": 0.9})  # fmt: skip
    axes.plot([0, 0], [-1, 1], color=LOOKS["switch"].colour, linewidth=5, solid_capstyle="butt", label="equilibria")
    x, y = f"x₁ / (Fs/kp), Fs/kp = {quantity(a, 'rad')}", f"x₃ / (Fs/ki), Fs/ki = {quantity(b, 'rad s')}"
    axes.set(xlim=(-3, 3), ylim=(-4, 4), xlabel=x, ylabel=y)
    axes.set_title(f"stick region of the Switch servo, K = {found.gain:.6g}", fontsize=10)
    axes.grid(True, color="0.95", linewidth=0.6)
    axes.legend(fontsize=SMALL, loc="upper right")
    return np.array([axes], dtype=object)


def _eigenvalues(found: Equilibria, given: Any) -> Array:
    figure, both = panels(given, 1, 2)
    left, right = both
    left.plot(found.c[1:], found.largest[1:], color=LOOKS["switch"].colour, linewidth=1.8)
    left.axhline(0, color=NEUTRAL, linewidth=0.9)
    logarithmic(left, "x")
    logarithmic(left, "y", linear=1e-3)
    left.grid(True, color="0.9", linewidth=0.6)
    left.set(xlabel="c of the member; ends of the segment: c → 0", ylabel="largest real part beside the 0 [1/s]")
    stable = {None: "not linear", True: "stable", False: "unstable"}[found.linear_stable]
    left.set_title(f"without dry friction {stable}", fontsize=10)
    looks = [LOOKS["switch"], LOOKS["lugre"], *MORE_LOOKS]
    for look, level in zip(looks, LEVELS, strict=False):
        roots = np.linalg.eigvals(found.rests[0].members(np.array([level]))[0])
        right.plot(roots.real, roots.imag, marker=look.marker, linestyle="none", color=look.colour,
                   markeredgecolor="black", markeredgewidth=0.4, label=f"c = {level:g}")  # fmt: skip
    right.axvline(0, color=NEUTRAL, linewidth=0.9)
    logarithmic(right, "x", "y", linear=1.0)
    right.set(xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
    right.set_title("c = 1 − (2α − 1) σ₀z/Fs", fontsize=10)
    right.grid(True, color="0.9", linewidth=0.6)
    right.legend(fontsize=SMALL)
    if figure is not None:
        figure.suptitle(f"generalised Jacobian of the LuGre servo, K = {found.gain:.6g}", fontsize=10)
    return both
