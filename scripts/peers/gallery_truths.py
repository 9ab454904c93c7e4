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


def strobed(machine: Machine, mode: Callable[[], str], turn: Any) -> Callable[[Array, bool], tuple[Array, Any]]:
    """The map over one or more turns of the forcing, from time 0 on in the mode that the motion is in then."""

    def back(y: Array, watch: bool) -> tuple[Array, Any]:
        _, z, time = machine.run(mode(), y, end=turn, watch=watch)
        return z, time

    return back


def impact_oscillator() -> Cycles:
    """Stroboscopic, from rest."""
    x, v = hy.make_vars("x", "v")
    for w, c, d, turns in ((1.0, 0.1, 1.0, 1), (0.7, 0.1, 1.0, 1), (0.5, 0.1, 1.0, 1), (2.8, 0.1, 0.0, 1)):

        def struck(z: Array, t: Any, d: float = d) -> Array:
            return np.array([d, -L(0.8) * z[1]], L)

        free = [(x, v), (v, hy.cos(w * hy.time) - c * v - x)]
        machine = Machine({"free": Piece(free, [Way("impact", x - d, +1, "free", struck)])})
        back = strobed(machine, lambda: "free", turns * PI2 / L(w))
        yield f"w = {w:g}, c = {c:g}, d = {d:g}", cycle(back, [d - 1.0, 0.0], settle=100)


ALL = {f.__name__: f for f in (van_der_pol, belt, impact_oscillator)}


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
