"""Systems of the gallery as a user of other programs writes them: plain functions of (t, y, p, m), no casahunt.

    piece    y' = field(t, y, p, m), left where one of its ways out is met; m has sin, exp, ...: math, numpy or heyoka
    section  the last way out, met so many times: launch(u, p) -> (t, y) behind it, land(t, y, p) -> u at the next one

A cycle is a fixed point of u -> land(motion from launch(u)).  Where a symmetry maps half of it to the other half, land
holds the symmetry, and half a period is followed: these users know that by themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, NamedTuple

State = Sequence[Any]
Scalar = Callable[[Any, State, Any, Any], Any]
"""(t, y, p, m) to a number."""


class Way(NamedTuple):
    """A way out of a piece: name, function, +1 rising or -1 falling, next piece, (t, y, p) -> y behind it.

    The next piece may be a function (t, y, p), too.
    """

    name: str
    function: Scalar
    direction: int
    to: str | Callable[[float, State, Any], str]
    behind: Callable[[float, State, Any], list[Any]] | None = None


class Piece(NamedTuple):
    """A smooth piece of the motion, and how long it looks away from its ways out at first."""

    field: Callable[[Any, State, Any, Any], list[Any]]
    ways: tuple[Way, ...]
    blind: float = 0.0


@dataclass(frozen=True)
class Known:
    """A cycle as its user knows it.

    Attributes
    ----------
    title : for the table.
    pieces : by name.
    p : parameters, by name.
    vary : of them, which differs in a neighbour.
    launch, land : from the unknowns to a state behind the section, and back.
    first : piece in which the motion goes on behind the section; may be a function (t, y, p).
    until, times : name of the section, how often it is met in a period (or half of it).
    start : (piece, t, y) off the cycle; None where only a place next to it will do.
    parts : 2 where land holds a symmetry.
    turn : (p) -> the period, where a forcing has it.
    stiff : best left to implicit methods.
    """

    title: str
    pieces: Mapping[str, Piece]
    p: SimpleNamespace
    vary: str
    launch: Callable[[State, Any], tuple[float, list[Any]]]
    land: Callable[[float, State, Any], list[Any]]
    first: str | Callable[[float, State, Any], str]
    until: str
    start: tuple[str, float, list[float]]
    times: int = 1
    parts: int = 1
    turn: Callable[[Any], float] | None = None
    stiff: bool = False

    def beside(self, factor: float) -> Known:
        """The same with `vary` so many times as large."""
        return replace(self, p=SimpleNamespace(**{**vars(self.p), self.vary: getattr(self.p, self.vary) * factor}))

    def next_piece(self, to: Any, t: float, y: State) -> str:
        """The name of a piece that is given as such, or as a function."""
        return to if isinstance(to, str) else to(t, y, self.p)


def van_der_pol(mu: float) -> Known:
    """Section v = 0 at the largest x."""

    def field(t: Any, y: State, p: Any, m: Any) -> list[Any]:
        x, v = y
        return [v, p.mu * (1.0 - x * x) * v - x]

    def speed(t: Any, y: State, p: Any, m: Any) -> Any:
        return y[1]

    return Known(
        f"van der Pol, mu = {mu:g}",
        {"falls": Piece(field, (Way("bottom", speed, +1, "rises"),)),
         "rises": Piece(field, (Way("top", speed, -1, "falls"),))},
        SimpleNamespace(mu=mu), "mu", lambda u, p: (0.0, [u[0], 0.0]), lambda t, y, p: [-y[0]], "falls", "bottom",
        ("falls", 0.0, [2.0, 0.0]), parts=2, stiff=mu >= 100,
    )  # fmt: skip


def circle() -> Known:
    """Section y = 0, from below."""

    def field(t: Any, s: State, p: Any, m: Any) -> list[Any]:
        x, y, z = s
        growth = p.mu - x * x - y * y
        return [growth * x - p.omega * y, p.omega * x + growth * y, -p.decay * z]

    def height(t: Any, s: State, p: Any, m: Any) -> Any:
        return s[1]

    return Known(
        "circle",
        {"above": Piece(field, (Way("falls", height, -1, "below"),)),
         "below": Piece(field, (Way("rises", height, +1, "above"),))},
        SimpleNamespace(mu=1.0, omega=1.0, decay=0.1), "omega", lambda u, p: (0.0, [u[0], 0.0, u[1]]),
        lambda t, s, p: [s[0], s[2]], "above", "rises", ("above", 0.0, [0.5, 0.0, 1.0]),
    )  # fmt: skip


def rossler() -> Known:
    """Section y = 0, falling; c = 2.5."""

    def field(t: Any, s: State, p: Any, m: Any) -> list[Any]:
        x, y, z = s
        return [-y - z, x + 0.2 * y, 0.2 + z * (x - p.c)]

    def height(t: Any, s: State, p: Any, m: Any) -> Any:
        return s[1]

    return Known(
        "Rossler, c = 2.5",
        {"above": Piece(field, (Way("falls", height, -1, "below"),)),
         "below": Piece(field, (Way("rises", height, +1, "above"),))},
        SimpleNamespace(c=2.5), "c", lambda u, p: (0.0, [u[0], 0.0, u[1]]), lambda t, s, p: [s[0], s[2]],
        "below", "falls", ("below", 0.0, [-2.5, 0.0, 0.0]),
    )  # fmt: skip


def two_spirals() -> Known:
    """Section x = 0, falling."""

    def turning(y: State, growth: Any, turn: Any) -> list[Any]:
        return [growth * y[0] - turn * y[1], growth * y[1] + turn * y[0]]

    def left(t: Any, y: State, p: Any, m: Any) -> list[Any]:
        return turning(y, 1.0 - m.sqrt(y[0] * y[0] + y[1] * y[1]), 1.0)

    def right(t: Any, y: State, p: Any, m: Any) -> list[Any]:
        r = m.sqrt(y[0] * y[0] + y[1] * y[1])
        return turning(y, p.alpha * (p.beta - r), p.gamma + p.beta - r)

    def across(t: Any, y: State, p: Any, m: Any) -> Any:
        return y[0]

    return Known(
        "two spirals",
        {"left": Piece(left, (Way("to the right", across, +1, "right"),)),
         "right": Piece(right, (Way("to the left", across, -1, "left"),))},
        SimpleNamespace(alpha=1.0, beta=2.0, gamma=1.5), "beta", lambda u, p: (0.0, [0.0, u[0]]),
        lambda t, y, p: [y[1]], "left", "to the left", ("left", 0.0, [-1.0, 0.0]),
    )  # fmt: skip


def relay() -> Known:
    """Third order, eps = 0.02; from one switch to the next, mirrored."""
    a, b = (1.0, 2.0, 3.0), (0.5, -1.0, 0.5)

    def pushed(u: float) -> Callable[..., list[Any]]:
        def field(t: Any, y: State, p: Any, m: Any) -> list[Any]:
            return [bi * u - ai * yi for ai, bi, yi in zip(a, b, y, strict=True)]

        return field

    def low(t: Any, y: State, p: Any, m: Any) -> Any:
        return y[0] + y[1] + y[2] + p.eps

    def high(t: Any, y: State, p: Any, m: Any) -> Any:
        return y[0] + y[1] + y[2] - p.eps

    return Known(
        "relay, order 3, eps = 0.02",
        {"down": Piece(pushed(-1.0), (Way("falls", low, -1, "up"),)),
         "up": Piece(pushed(+1.0), (Way("rises", high, +1, "down"),))},
        SimpleNamespace(eps=0.02), "eps", lambda u, p: (0.0, [u[0], u[1], p.eps - u[0] - u[1]]),
        lambda t, y, p: [-y[0], -y[1]], "down", "falls", ("down", 0.0, [0.1, 0.1, 0.1]), parts=2,
    )  # fmt: skip


def belt() -> Known:
    """From breaking away, where everything is known already: x = 1, v = belt."""

    def slip(t: Any, y: State, p: Any, m: Any) -> list[Any]:
        x, v = y
        return [v, 1.0 / (1.0 + 3.0 * (p.belt - v)) - x]

    return Known(
        "belt at 0.2",
        {"slip": Piece(slip, (Way("catches up", lambda t, y, p, m: y[1] - p.belt, +1, "stick"),), blind=1e-2),
         "stick": Piece(lambda t, y, p, m: [p.belt, 0.0 * y[1]],
                        (Way("breaks away", lambda t, y, p, m: y[0] - 1.0, +1, "slip"),))},
        SimpleNamespace(belt=0.2), "belt", lambda u, p: (0.0, [u[0], p.belt]), lambda t, y, p: [y[0]],
        "slip", "breaks away", ("slip", 0.0, [0.0, 0.0]),
    )  # fmt: skip


def drill_string() -> Known:
    """From breaking away, where the torque in the shaft is Ts = 1."""
    k, c, kp, Tc, Ts, ws, J2 = 2.0, 0.05, 3.0, 0.4, 1.0, 0.3, 0.3

    def shaft(y: State) -> Any:
        return k * y[0] + c * (y[1] - y[2])

    def turns(t: Any, y: State, p: Any, m: Any) -> list[Any]:
        torque = shaft(y)
        friction = Tc + (Ts - Tc) * m.exp(-y[2] / ws)
        return [y[1] - y[2], kp * (p.speed - y[1]) - torque, (torque - friction) / J2]

    def sticks(t: Any, y: State, p: Any, m: Any) -> list[Any]:
        return [y[1] - y[2], kp * (p.speed - y[1]) - shaft(y), 0.0 * y[2]]

    return Known(
        "drill string, speed 0.8",
        {"turns": Piece(turns, (Way("stops", lambda t, y, p, m: y[2], -1, "sticks"),), blind=1e-2),
         "sticks": Piece(sticks, (Way("breaks away", lambda t, y, p, m: shaft(y) - Ts, +1, "turns"),))},
        SimpleNamespace(speed=0.8), "speed", lambda u, p: (0.0, [(Ts - c * u[0]) / k, u[0], 0.0]),
        lambda t, y, p: [y[1]], "turns", "breaks away", ("sticks", 0.0, [0.0, 0.8, 0.0]),
    )  # fmt: skip


def dry_friction() -> Known:
    """f0 = 1.5, w = 0.9, tau = 1.1: from a stop to the opposite one, mirrored."""
    zeta, eta = 0.05, 1.0

    def pull(t: Any, y: State, p: Any, m: Any) -> Any:
        return p.f0 * m.cos(p.w * t) - y[0]

    def slip(sign: int) -> Callable[..., list[Any]]:
        return lambda t, y, p, m: [y[1], pull(t, y, p, m) - 2.0 * zeta * y[1] - eta * sign]

    def after(t: float, y: State, p: Any) -> str:
        force = pull(t, y, p, math)
        return "stick" if abs(force) <= p.tau else "forwards" if force > 0 else "backwards"

    def speed(t: Any, y: State, p: Any, m: Any) -> Any:
        return y[1]

    def at_rest(t: float, y: State, p: Any) -> list[Any]:
        return [y[0], 0.0]

    held = (
        Way("is pulled forth", lambda t, y, p, m: pull(t, y, p, m) - p.tau, +1, "forwards"),
        Way("is pulled back", lambda t, y, p, m: pull(t, y, p, m) + p.tau, -1, "backwards"),
    )
    return Known(
        "dry friction, w = 0.9",
        {"forwards": Piece(slip(+1), (Way("stops in front", speed, -1, after, at_rest),)),
         "backwards": Piece(slip(-1), (Way("stops behind", speed, +1, after, at_rest),)),
         "stick": Piece(lambda t, y, p, m: [0.0 * y[0], 0.0 * y[1]], held)},
        SimpleNamespace(f0=1.5, w=0.9, tau=1.1), "f0", lambda u, p: (u[1], [u[0], 0.0]),
        lambda t, y, p: [-y[0], t - math.pi / p.w], after, "stops behind", ("stick", 0.0, [1.0, 0.0]),
        parts=2, turn=lambda p: 2 * math.pi / p.w,
    )  # fmt: skip


def impact_oscillator() -> Known:
    """w = 1, d = 1: from an impact to the next one, in v and the time."""

    def free(t: Any, y: State, p: Any, m: Any) -> list[Any]:
        return [y[1], m.cos(p.w * t) - 0.1 * y[1] - y[0]]

    impact = Way("impact", lambda t, y, p, m: y[0] - p.d, +1, "free", lambda t, y, p: [p.d, -0.8 * y[1]])
    return Known(
        "impact oscillator, w = 1", {"free": Piece(free, (impact,))}, SimpleNamespace(w=1.0, d=1.0), "d",
        lambda u, p: (u[1], [p.d, u[0]]), lambda t, y, p: [-0.8 * y[1], t - 2 * math.pi / p.w], "free", "impact",
        ("free", 0.0, [0.0, 0.0]), turn=lambda p: 2 * math.pi / p.w,
    )  # fmt: skip


def bouncing_ball(a: float, x: float, v: float, t: float) -> Known:
    """From an impact to the next one, in v and the time; the start is next to the cycle."""
    w, e, g = 20.0, 0.8, 9.81

    def table(t: Any, p: Any, m: Any) -> Any:
        return p.a * m.sin(w * t)

    def behind(t: float, y: State, p: Any) -> list[Any]:
        return [y[0], -e * y[1] + (1 + e) * p.a * w * math.cos(w * t)]

    impact = Way("impact", lambda t, y, p, m: (y[0] - table(t, p, m)) / p.a, -1, "flight", behind)
    return Known(
        "bouncing ball", {"flight": Piece(lambda t, y, p, m: [y[1], -g + 0.0 * y[1]], (impact,))},
        SimpleNamespace(a=a), "a", lambda u, p: (u[1], [table(u[1], p, math), u[0]]),
        lambda t, y, p: [behind(t, y, p)[1], t - 2 * math.pi / w], "flight", "impact", ("flight", t, [x, v]),
        turn=lambda p: 2 * math.pi / w,
    )  # fmt: skip


def canudas() -> Known:
    """From x = 0 in mid-slip to the next one, mirrored; in between the mass turns as often as it will."""
    s0, s1, s2, Fc, Fs, vs, kp, kv, ki = 1e5, 1e5**0.5, 0.4, 1.0, 1.5, 1e-3, 3.0, 6.0, 4.0

    def moving(sign: int) -> Callable[..., list[Any]]:
        def field(t: Any, y: State, p: Any, m: Any) -> list[Any]:
            x, v, w, z = y
            drop = m.exp(-((v / vs) * (v / vs)))
            z_rate = v - s0 * sign * v * z / (Fc + (Fs - Fc) * drop)
            return [v, -(kp * x + kv * v + ki * p.integral * w) - (s0 * z + s1 * z_rate + s2 * v), x, z_rate]

        return field

    def speed(t: Any, y: State, p: Any, m: Any) -> Any:
        return y[1] / vs

    def place(t: Any, y: State, p: Any, m: Any) -> Any:
        return y[0]

    def still(t: float, y: State, p: Any) -> list[Any]:
        return [y[0], 0.0, y[2], y[3]]

    def piece(sign: int, here: str, other: str, turns: str, centre: str) -> Piece:
        ways = (Way(turns, speed, -sign, other, still), Way(centre, place, sign, here))
        return Piece(moving(sign), ways, blind=1e-7)

    return Known(
        "Canudas de Wit's servo",
        {"forwards": piece(+1, "forwards", "backwards", "turns back", "rises"),
         "backwards": piece(-1, "backwards", "forwards", "turns forth", "falls")},
        SimpleNamespace(integral=1.0), "integral", lambda u, p: (0.0, [0.0, *u]),
        lambda t, y, p: [-y[1], -y[2], -y[3]], "forwards", "falls", ("backwards", 0.0, [1.0, 0.0, 0.0, 0.0]),
        parts=2, stiff=True,
    )  # fmt: skip
