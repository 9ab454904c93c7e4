"""Switch friction by a table of velocity and torque, with a monotone cubic h between them; breakaway is a number apart.

    F = friction_scale h(v);   stick while -static_back <= pull <= static

Beyond the last entry h goes on straight, and never down; before the first one straight to v = 0 (monotone_cubic.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca

from ...checks import SMALLEST, number
from ...compiled import kept
from ...errors import InputError
from .by_direction import by_sign
from .monotone_cubic import Entries, interpolated
from .part import Part
from .switch import switch_friction


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
        _check(k, v, m)
    back = tuple((-a, -b) for a, b in zip(v, m, strict=True) if b < 0)[::-1]
    forward = tuple((float(a), float(b)) for a, b in zip(v, m, strict=True) if b > 0)
    for way, entries in (("v >= 0", forward), ("v <= 0", back)):
        if len(entries) < 2 and (entries or way == "v >= 0"):
            raise InputError(f"friction table: {len(entries)} entries with {way}: must be at least 2")
    back = back or forward
    static = _breakaway("static", static, forward)
    static_back = static if static_back is None and back == forward else _breakaway("static_back", static_back, back)
    return _friction_table(forward, back, static, static_back)


def _check(k: int, v: Sequence[float], m: Sequence[float]) -> None:
    """Refuse an entry."""
    called = f"friction table, entry {k + 1}"
    number(f"{called}: velocity", v[k])
    number(f"{called}: torque", m[k])
    if m[k] == 0 or v[k] * m[k] < 0:
        raise InputError(f"{called}: torque = {m[k]:g} at {v[k]:g} rad/s: must have the sign of the velocity")
    if k and not v[k - 1] < v[k] and not (v[k - 1] == v[k] == 0 and m[k - 1] < 0 < m[k]):
        raise InputError(f"{called}: velocity = {v[k]:g} behind {v[k - 1]:g} rad/s: velocities must rise")


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
        ranges=dict.fromkeys(("static", "static_back", "friction_scale"), (SMALLEST, math.inf)),
    )  # fmt: skip


def _again(*arguments: Any) -> Part:
    """The part in another process; what is kept cannot be sent by its name."""
    part: Part = _friction_table(*arguments)
    return part
