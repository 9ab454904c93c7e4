"""The numbers of problems/: what the TRUTH of each file says, computed again without the package.

    python -m scripts.peers.gallery_truths [van_der_pol belt ...]

Smooth pieces by Taylor series in extended precision (taylor_machine.py); where a problem has a closed form, its own
file holds it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any

import heyoka as hy
import numpy as np

from .taylor_machine import Cycle, L, Machine, Piece, Way, cycle

Array = np.ndarray
NOTHING = hy.expression(0.0)
Cycles = Iterator[tuple[str, Cycle]]


def van_der_pol() -> Cycles:
    """Section v = 0; the multiplier of large mu is zero in the differences, and exp of an integral here."""
    x, v, s = hy.make_vars("x", "v", "s")
    for mu in (1.0, 10.0, 100.0, 1000.0):
        rate = mu * (1.0 - x * x)
        ways = [Way("top", v, -1, "falls"), Way("bottom", v, +1, "falls")]
        machine = Machine({"falls": Piece([(x, v), (v, rate * v - x), (s, rate)], ways, blind=1e-9)})

        def back(y: Array, watch: bool, machine: Machine = machine) -> tuple[Array, Any]:
            _, z, time = machine.run("falls", [y[0], 0, 0], until="bottom", watch=watch)
            return z[:1], time

        found = cycle(back, [2.0], settle=4, mirror=True)
        _, z, _ = machine.run("falls", [found.y[0], 0, 0], until="bottom")
        print(f"    log of the multiplier {2 * z[2]}")
        yield f"mu = {mu:g}", found


def belt() -> Cycles:
    """From breaking away, x = 1."""
    x, v = hy.make_vars("x", "v")
    for speed in (0.2, 0.35, 0.5):
        slip, stick = [(x, v), (v, 1.0 / (1.0 + 3.0 * (speed - v)) - x)], [(x, hy.expression(speed)), (v, NOTHING)]
        machine = Machine({
            "slip": Piece(slip, [Way("catches up", v - speed, +1, "stick")], blind=1e-2),
            "stick": Piece(stick, [Way("breaks away", x - 1.0, +1, "slip")]),
        })  # fmt: skip

        def back(y: Array, watch: bool, machine: Machine = machine, speed: float = speed) -> tuple[Array, Any]:
            _, z, time = machine.run("slip", [y[0], speed], until="breaks away", watch=watch)
            return z[:1], time

        yield f"speed {speed:g}", cycle(back, [1.0])


PI2 = 2 * L("3.14159265358979323846264338327950288")


def impact_oscillator() -> Cycles:
    """Stroboscopic, from rest."""
    x, v = hy.make_vars("x", "v")
    for w, c, d in ((1.0, 0.1, 1.0), (0.7, 0.1, 1.0), (0.5, 0.1, 1.0), (2.8, 0.1, 0.0)):

        def struck(z: Array, t: Any, d: float = d) -> Array:
            return np.array([d, -L(0.8) * z[1]], L)

        free = [(x, v), (v, hy.cos(w * hy.time) - c * v - x)]
        machine = Machine({"free": Piece(free, [Way("impact", x - d, +1, "free", struck)])})

        def back(y: Array, watch: bool, machine: Machine = machine, w: float = w) -> tuple[Array, Any]:
            _, z, time = machine.run("free", y, end=PI2 / L(w), watch=watch)
            return z, time

        yield f"w = {w:g}, c = {c:g}, d = {d:g}", cycle(back, [d - 1.0, 0.0], settle=100)


def dry_friction() -> Cycles:
    """From one stop to the next but one, in x and the time."""
    x, v = hy.make_vars("x", "v")
    zeta, eta = 0.05, 1.0
    for f0, w, tau in ((1.5, 0.9, 1.1), (1.5, 0.3, 1.1), (3.0, 0.9, 1.1), (1.5, 0.6, 1.0)):
        pull = f0 * hy.cos(w * hy.time) - x

        def after(z: Array, t: Any, f0: float = f0, w: float = w, tau: float = tau) -> str:
            force = f0 * np.cos(L(w) * t) - z[0]
            return "stick" if abs(force) <= tau else "forwards" if force > 0 else "backwards"

        def slip(sign: int, pull: Any = pull, after: Callable[[Array, Any], str] = after) -> Piece:
            return Piece([(x, v), (v, pull - 2.0 * zeta * v - eta * sign)], [Way("stops", v, -sign, after)])

        held = [Way("f", pull - tau, +1, "forwards"), Way("b", pull + tau, -1, "backwards")]
        stick = Piece([(x, NOTHING), (v, NOTHING)], held)
        machine = Machine({"forwards": slip(+1), "backwards": slip(-1), "stick": stick})

        def back(
            y: Array, watch: bool, machine: Machine = machine, w: float = w, after: Callable[[Array, Any], str] = after
        ) -> tuple[Array, Any]:
            _, z, t = machine.run(after(y, y[1]), [y[0], 0], y[1], until="stops", times=2, watch=watch)
            return np.array([z[0], t - PI2 / L(w)]), PI2 / L(w)

        yield f"f0 = {f0:g}, w = {w:g}, tau = {tau:g}", cycle(back, [f0 - 0.5, 0.0], settle=60)


def canudas() -> Cycles:
    """From x = 0 in mid-slip to the next one, mirrored; in between the mass turns as often as it will."""
    x, v, w, z = hy.make_vars("x", "v", "w", "z")
    s0, s1, s2, Fc, Fs, vs, kp, kv, ki = 1e5, 1e5**0.5, 0.4, 1.0, 1.5, 1e-3, 3.0, 6.0, 4.0

    def moving(sign: int, to: str) -> Piece:
        z_rate = v - s0 * sign * v * z / (Fc + (Fs - Fc) * hy.exp(-(v / vs) * (v / vs)))
        force = -(kp * x + kv * v + ki * w) - (s0 * z + s1 * z_rate + s2 * v)
        ways = [Way("turns", v, -sign, to), Way("centre", x, +1, "forwards"), Way("centre", x, -1, "backwards")]
        return Piece([(x, v), (v, force), (w, x), (z, z_rate)], ways, blind=1e-7)

    machine = Machine({"forwards": moving(+1, "backwards"), "backwards": moving(-1, "forwards")})

    def back(y: Array, watch: bool) -> tuple[Array, Any]:
        """y = (v, w, z) at x = 0, v > 0."""
        mode = "forwards" if y[0] > 0 else "backwards"
        _, end, time = machine.run(mode, [0, *y], until="centre", watch=watch)
        return end[1:], time

    _, start, _ = machine.run("backwards", [1.0, 0, 0, 0], until="centre", times=12)
    yield "LuGre", cycle(back, start[1:], settle=4, mirror=True)


def rossler() -> Cycles:
    """On y = 0, falling, so many turns; what is unstable by Newton's method from the motion's own section."""
    x, y, z = hy.make_vars("x", "y", "z")
    for c, turns, settle in ((2.5, 1, 400), (3.5, 2, 400), (4.0, 4, 400), (4.0, 1, 0), (5.7, 1, 0)):
        field = [(x, -y - z), (y, x + 0.2 * y), (z, 0.2 + z * (x - c))]
        machine = Machine({"smooth": Piece(field, [Way("falls", y, -1, "smooth")])})

        def back(u: Array, watch: bool, machine: Machine = machine, turns: int = turns) -> tuple[Array, Any]:
            _, end, time = machine.run("smooth", [u[0], 0, u[1]], until="falls", times=turns, watch=watch)
            return end[[0, 2]], time

        found = cycle(back, [-1.3 * c, 0.03], settle=settle)
        print("    (x, z) on y = 0:", *found.y)
        yield f"c = {c:g}, {turns} turns", found


def drill_string() -> Cycles:
    """From breaking away, where the torque in the shaft is Ts = 1, in w1."""
    phi, w1, w2 = hy.make_vars("phi", "w1", "w2")
    k, c, kp, Tc, Ts, ws = 2.0, 0.05, 3.0, 0.4, 1.0, 0.3
    shaft = k * phi + c * (w1 - w2)
    for speed in (0.8, 0.4):
        motor = kp * (speed - w1) - shaft
        turns = [(phi, w1 - w2), (w1, motor), (w2, (shaft - Tc - (Ts - Tc) * hy.exp(-w2 / ws)) / 0.3)]
        sticks = [(phi, w1 - w2), (w1, motor), (w2, NOTHING)]
        machine = Machine({
            "turns": Piece(turns, [Way("stops", w2, -1, "sticks")], blind=1e-2),
            "sticks": Piece(sticks, [Way("breaks away", shaft - Ts, +1, "turns")]),
        })  # fmt: skip

        def back(y: Array, watch: bool, machine: Machine = machine) -> tuple[Array, Any]:
            start = [(Ts - L(c) * y[0]) / k, y[0], 0]
            _, end, time = machine.run("turns", start, until="breaks away", watch=watch)
            return end[1:2], time

        yield f"speed {speed:g}", cycle(back, [speed], settle=5)


ALL = {f.__name__: f for f in (van_der_pol, belt, impact_oscillator, dry_friction, canudas, rossler, drill_string)}


def main(names: list[str]) -> None:
    """Print them."""
    for name in names or ALL:
        print(name)
        for caption, found in ALL[name]():
            extrema = ", ".join(f"({low!s}, {high!s})" for low, high in found.extrema)
            multipliers = ", ".join(f"{m:.13g}" for m in found.multipliers)
            print(f"  {caption}: Truth({found.period!s}, {{{extrema}}}, ({multipliers},))")


if __name__ == "__main__":
    main(sys.argv[1:])
