"""The numbers of problems/: what the TRUTH of each file says, computed again without the package.

    python -m scripts.peers.gallery_truths [van_der_pol belt ...]

Smooth pieces by Taylor series in extended precision (taylor_machine.py); where a problem has a closed form, its own
file holds it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import heyoka as hy
import numpy as np

from .taylor_machine import Cycle, L, Machine, Piece, Way, cycle, jacobian

Array = np.ndarray
NOTHING = hy.expression(0.0)
Cycles = Iterator[tuple[str, Cycle]]
STEEP = 1e-8
"""Step of the differences where the return map bends within 1e-4 of its coordinates: 1e-6 is off by 1e-3 there."""


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


def canudas_machine(K: Any = 1.0) -> Machine:
    """The servo with all gains of its controller scaled by K."""
    x, v, w, z = hy.make_vars("x", "v", "w", "z")
    s0, s1, s2, Fc, Fs, vs, kp, kv, ki = 1e5, 1e5**0.5, 0.4, 1.0, 1.5, 1e-3, 3.0 * K, 6.0 * K, 4.0 * K

    def moving(sign: int, to: str) -> Piece:
        z_rate = v - s0 * sign * v * z / (Fc + (Fs - Fc) * hy.exp(-(v / vs) * (v / vs)))
        force = -(kp * x + kv * v + ki * w) - (s0 * z + s1 * z_rate + s2 * v)
        ways = [Way("turns", v, -sign, to), Way("centre", x, +1, "forwards"), Way("centre", x, -1, "backwards")]
        return Piece([(x, v), (v, force), (w, x), (z, z_rate)], ways, blind=1e-7)

    return Machine({"forwards": moving(+1, "backwards"), "backwards": moving(-1, "forwards")})


def canudas() -> Cycles:
    """From x = 0 in mid-slip to the next one, mirrored; in between the mass turns as often as it will."""
    machine = canudas_machine()

    def back(y: Array, watch: bool) -> tuple[Array, Any]:
        """y = (v, w, z) at x = 0, v > 0."""
        mode = "forwards" if y[0] > 0 else "backwards"
        _, end, time = machine.run(mode, [0, *y], until="centre", watch=watch)
        return end[1:], time

    _, start, _ = machine.run("backwards", [1.0, 0, 0, 0], until="centre", times=12)
    yield "LuGre", cycle(back, start[1:], settle=4, mirror=True)


def canudas_gains() -> Iterator[tuple[str, Any]]:
    """K at which the symmetric cycle loses and regains its symmetry, and those at which the lopsided ones flip.

    The map of half a period has the eigenvalue -1, and that of a whole one.  From K next to it and (v, w, z) at x = 0
    next to the cycle, both by problems/canudas_gain.py.
    """
    from problems.canudas_gain import NEAR_BREAKING, NEAR_FLIPS

    for halves, K, near in (*((1, *start) for start in NEAR_BREAKING), *((2, *start) for start in NEAR_FLIPS)):
        seen: list[tuple[float, float]] = []
        y = np.array(near, L)
        for _ in range(6):
            machine = canudas_machine(K)

            def back(y: Array, machine: Machine = machine, halves: int = halves) -> Array:
                return (-1) ** halves * machine.run("forwards", [0, *y], until="centre", times=halves)[1][1:]

            for _ in range(6):
                J = jacobian(back, y, STEEP)
                step = np.linalg.solve(np.eye(3) - J, np.array(back(y) - y, float))
                y = y + step
                if np.max(np.abs(step)) < 1e-13:
                    break
            mu = float(np.min(np.linalg.eigvals(jacobian(back, y, STEEP)).real))
            seen.append((K, mu))
            print(f"    K = {K:.12g}: {mu:.10g}", flush=True)
            if abs(mu + 1) < 1e-7:
                break
            if len(seen) == 1:
                K += 1e-4
            else:
                K -= (mu + 1) * (K - seen[-2][0]) / (mu - seen[-2][1])
        yield f"multiplier -1 at K = {K:.10g}", None


def canudas_gain_folds() -> Iterator[tuple[str, Any]]:
    """The largest K of the symmetric cycle and the smallest of the lopsided ones."""
    from problems.canudas_gain import NEAR_FOLD, NEAR_LOPSIDED_FOLD

    yield from canudas_gain_fold(*NEAR_FOLD, halves=1, width=0.02)
    yield from canudas_gain_fold(*NEAR_LOPSIDED_FOLD, halves=2, width=5e-5)


def canudas_gain_fold(K: float, y: Sequence[float], *, halves: int, width: float) -> Iterator[tuple[str, Any]]:
    """A fold: w and z at x = 0 and K as functions of v there, and their turn.

    Where v is held, the fixed points go through the fold; K is a parabola there, and a polynomial of degree 4 through
    five of them has its turn.
    """
    unknown = np.array([*y[1:], K], L)
    machine = canudas_machine(hy.par[0])

    def missing(v: Any, unknown: Array) -> Array:
        machine.set_parameter(unknown[2])
        start = np.array([v, unknown[0], unknown[1]], L)
        return (-1) ** halves * machine.run("forwards", [0, *start], until="centre", times=halves)[1][1:] - start

    def turn(half_width: float, middle: Any) -> tuple[Any, Any]:
        nonlocal unknown
        speeds = [middle * (1 + L(half_width) * i) for i in (-2, -1, 0, 1, 2)]
        values = []
        for v in speeds:
            for _ in range(8):
                J = jacobian(lambda u, v=v: missing(v, u), unknown)
                step = np.linalg.solve(J, np.array(missing(v, unknown), float))
                unknown = unknown - step
                if np.max(np.abs(step) / np.abs(np.array(unknown, float))) < 1e-13:
                    break
            values.append(unknown[2])
            print(f"    v = {v:.12g}: K = {values[-1]:.15g}", flush=True)
        offset = np.array((np.array(values, L) - values[2]), float)
        fit = np.polynomial.Polynomial.fit([-2, -1, 0, 1, 2], offset, 4)
        turns = fit.deriv().roots()
        at = float(turns[np.argmin(np.abs(turns))].real)
        return values[2] + fit(at), middle * (1 + L(half_width) * L(at))

    value, middle = turn(width, L(y[0]))
    for half_width in (width / 2, width / 4):
        value, middle = turn(half_width, middle)
        yield f"fold at K = {value:.12g}, where v = {middle:.8g}", None


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


ALL = {
    f.__name__: f
    for f in (
        van_der_pol, belt, impact_oscillator, dry_friction, canudas, canudas_gains, canudas_gain_folds, rossler,
        drill_string,
    )
}


def main(names: list[str]) -> None:
    """Print them."""
    for name in names or ALL:
        print(name)
        for caption, found in ALL[name]():
            if found is None:
                print(f"  {caption}")
                continue
            extrema = ", ".join(f"({low!s}, {high!s})" for low, high in found.extrema)
            multipliers = ", ".join(f"{m:.13g}" for m in found.multipliers)
            print(f"  {caption}: Truth({found.period!s}, {{{extrema}}}, ({multipliers},))")


if __name__ == "__main__":
    main(sys.argv[1:])
