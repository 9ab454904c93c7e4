"""Switch friction by a table of velocity and torque, with a monotone cubic h between them; breakaway is a number apart.

    F = friction_scale h(v);   stick while -static_back <= pull <= static

Beyond the last entry h goes on straight, and never down; before the first one straight to v = 0.

The table is a piecewise cubic h(v) with a continuous slope, monotone between two entries:

    h_k'  the weighted harmonic mean of the slopes of the chords beside entry k, 0 where they differ in sign

Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5 (1984); at the ends a one-sided slope in three entries.  Beyond its
entries the curve goes on straight, behind the last one never down.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...checks import number
from ...compiled import kept
from ...errors import InputError
from .part import ABOVE_ZERO, Part
from .switch import by_sign, switch_friction

Entries = tuple[tuple[float, float], ...]
"""(v, h), v rising."""


def slopes(v: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The slopes of the monotone cubic at its entries (n,)."""
    step, chord = np.diff(v), np.diff(h) / np.diff(v)
    w1, w2 = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    one_way = chord[:-1] * chord[1:] > 0
    safe = np.where(one_way, chord[:-1] * chord[1:], 1.0)
    inner = np.where(one_way, (w1 + w2) * safe / np.where(one_way, w1 * chord[1:] + w2 * chord[:-1], 1.0), 0.0)

    def end(h0: float, h1: float, d0: float, d1: float) -> float:
        """One-sided in three entries, held to be monotone."""
        slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
        return 0.0 if slope * d0 <= 0 else 3 * d0 if d0 * d1 <= 0 and abs(slope) > 3 * abs(d0) else slope

    if len(chord) == 1:
        first = last = float(chord[0])
    else:
        first, last = end(*step[:2], *chord[:2]), end(*step[:-3:-1], *chord[:-3:-1])
    return np.array([first, *inner, max(last, 0.0)])


def interpolated(entries: Entries, v: Any) -> Any:
    """h(v) as an expression, v >= 0."""
    knots, values = np.array(entries).T
    d = slopes(knots, values)
    h = values[0] + d[0] * (v - knots[0])
    for k, step in enumerate(np.diff(knots)):
        chord = (values[k + 1] - values[k]) / step
        t = v - knots[k]
        c2, c3 = (3 * chord - 2 * d[k] - d[k + 1]) / step, (d[k] + d[k + 1] - 2 * chord) / step**2
        h = ca.if_else(t > 0, values[k] + t * (d[k] + t * (c2 + t * c3)), h)
    return ca.if_else(v > knots[-1], values[-1] + d[-1] * (v - knots[-1]), h)


def friction_table(velocity: Sequence[float], torque: Sequence[float], static: float | None = None,
                   static_back: float | None = None) -> Part:  # fmt: skip
    """Friction by a table.

    Parameters
    ----------
    velocity, torque
        (n,) rising rates [rad/s] >= 0 and the friction at them [N m]; or rates of both signs, with torques of theirs:
        then friction is that of each direction.
    static, static_back
        breakaway torque forward and back [N m]; None for the table's at v = 0. Back it is `static` without a table.

    Returns
    -------
    Part with the parameters static, static_back and friction_scale, a factor of the table.

    Raises
    ------
    InputError : velocities that do not rise, a torque with the wrong sign, too few entries, no finite number, a
        breakaway torque below the table's at v = 0.

    Examples
    --------
    >>> from casahunt.servo.parts import friction_table
    >>> part = friction_table([0.0, 0.02, 0.05, 1.0], [0.5, 0.47, 0.44, 0.54], static=0.53)
    >>> dict(part.parameters)
    {'static': 0.53, 'static_back': 0.53, 'friction_scale': 1.0}
    """
    v, m = list(velocity), list(torque)
    if len(v) != len(m):
        raise InputError(f"friction table: {len(v)} velocities and {len(m)} torques; must be as many")
    for k in range(len(v)):
        # refuse an entry
        called = f"friction table, entry {k + 1}"
        number(f"{called}: velocity", v[k])
        number(f"{called}: torque", m[k])
        if m[k] == 0 or v[k] * m[k] < 0:
            raise InputError(f"{called}: torque = {m[k]:g} at {v[k]:g} rad/s: must have the sign of the velocity")
        if k and not v[k - 1] < v[k] and not (v[k - 1] == v[k] == 0 and m[k - 1] < 0 < m[k]):
            raise InputError(f"{called}: velocity = {v[k]:g} behind {v[k - 1]:g} rad/s: velocities must rise")
    back = tuple((-a, -b) for a, b in zip(v, m, strict=True) if b < 0)[::-1]
    forward = tuple((float(a), float(b)) for a, b in zip(v, m, strict=True) if b > 0)
    for way, entries in (("v >= 0", forward), ("v <= 0", back)):
        if len(entries) < 2 and (entries or way == "v >= 0"):
            raise InputError(f"friction table: {len(entries)} entries with {way}: must be at least 2")
    back = back or forward
    static = _breakaway("static", static, forward)
    static_back = static if static_back is None and back == forward else _breakaway("static_back", static_back, back)
    return _friction_table(forward, back, static, static_back)


def _breakaway(name: str, value: float | None, entries: Entries) -> float:
    at_rest = float(interpolated(entries, ca.DM(0.0)))
    if value is not None and number(name, value) < at_rest:
        raise InputError(f"friction table: {name} = {value:g}: must be at least the table's at v = 0, {at_rest:g} N m")
    return at_rest if value is None else float(value)


@kept(maxsize=64)
def _friction_table(forward: Entries, back: Entries, static: float, static_back: float) -> Part:
    def torque(v: Any, p: Any) -> Any:
        h = interpolated(forward, p.sign * v)
        return p.friction_scale * p.sign * (h if back == forward else by_sign(p, h, interpolated(back, p.sign * v)))

    drops = [v for v, _ in forward[1:]]
    return switch_friction(
        "friction table", {"static": static, "static_back": static_back, "friction_scale": 1.0}, torque,
        back="static_back", scale=lambda p: drops[0], made_by=(_again, (forward, back, static, static_back)),
        ranges={"friction_scale": ABOVE_ZERO},
    )  # fmt: skip


def _again(*arguments: Any) -> Part:
    """The part in another process; what is kept cannot be sent by its name."""
    part: Part = _friction_table(*arguments)
    return part
