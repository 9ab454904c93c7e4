"""The special points of the branches of problems/, computed again without the package: by shooting.

    python -m scripts.peers.branch_truths [lorenz duffing ...]

Smooth systems and piecewise linear ones: branch_shooting.py; the others as their functions say.  A start is taken from
anywhere: what counts is where Newton's method ends.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

from .branch_shooting import TIGHT, Linear, Rates, Smooth, hopf

Array = np.ndarray


def _lorenz(t: Any, x: Any, r: Any) -> Sequence[Any]:
    return 10 * (x[1] - x[0]), r * x[0] - x[1] - x[0] * x[2], x[0] * x[1] - 8 / 3 * x[2]


def _rossler(t: Any, x: Any, c: Any) -> Sequence[Any]:
    return -x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - c)


def _hindmarsh(t: Any, x: Any, current: Any) -> Sequence[Any]:
    x1, y, z = x
    return y - x1**3 + 3 * x1**2 - z + current, 1 - 5 * x1**2 - y, 0.006 * (4 * (x1 + 1.6) - z)


def _nerve(t: Any, x: Any, current: Any) -> Sequence[Any]:
    return x[0] - x[0] ** 3 / 3 - x[1] + current, 0.08 * (x[0] + 0.7 - 0.8 * x[1])


def _morris(v3: float, v4: float, gca: float, phi: float) -> Rates:
    def rates(t: Any, x: Any, current: Any) -> Sequence[Any]:
        v, w = x
        m, n = 0.5 * (1 + np.tanh((v + 1.2) / 18)), 0.5 * (1 + np.tanh((v - v3) / v4))
        gates = gca * m * (v - 120) + 8 * w * (v + 84) + 2 * (v + 60)
        return (current - gates) / 20, phi * (n - w) * np.cosh((v - v3) / (2 * v4))

    return rates


def _duffing(c: float, k: float, F: float | None, w: float | None) -> Rates:
    """With F or w, whichever is None, as lambda."""
    return lambda t, x, lam: (
        x[1], (lam if F is None else F) * np.cos((lam if w is None else w) * t) - c * x[1] - k * x[0] - x[0] ** 3
    )  # fmt: skip


HOPF_LIKE, CIRCLE = _morris(2.0, 30.0, 4.4, 0.04), _morris(12.0, 17.4, 4.0, 0.066)
ODD, TURNED = (-1.0, -1.0), (-1.0, -1.0, 1.0)
RESONANCE = Smooth(_duffing(0.1, 1.0, 0.5, None), None, ODD, lambda w: np.pi / w)
UEDA = Smooth(_duffing(0.1, 0.0, None, 1.0), None, ODD, lambda F: np.pi)
WELL = Smooth(_duffing(0.25, -1.0, None, 1.0), None, None, lambda F: 2 * np.pi)
STARTS: Mapping[str, Sequence[tuple[Smooth, str, Sequence[float], int]]] = {
    "duffing": (
        (RESONANCE, "fold", (-0.6846731, 0.212682, 1.4386701), 0),
        (RESONANCE, "fold", (-0.0596724, 4.4470855, 2.2119353), 0),
        (UEDA, "flip", (1.8898747, 0.3279166, 2.2863817), -1),
        (WELL, "fold", (1.2855687, 0.2548891, 0.2649795), 0),
        (WELL, "fold", (0.6539396, 0.5488823, 0.1598021), 0),
        (WELL, "flip", (0.3750377, 0.3615374, 0.1817424), -1),
    ),
    "lorenz": (
        (Smooth(_lorenz, (0, 0.0), TURNED), "fold", (0.0, -41.5563214, 152.5831256, 0.5664678, 166.0614921), 2),
        (Smooth(_lorenz, (2, 264.852968), TURNED), "flip", (0.0, 37.2467978, 264.852968, 0.205583, 312.973533), -1),
    ),
    "rossler": (
        (Smooth(_rossler, (2, 2.3766719)), "flip", (0.5130504, 3.3156473, 2.3766719, 5.76982, 2.832445), -1),
        (Smooth(_rossler, (0, 0.7516245)), "flip", (0.7516245, 4.8817239, 0.4342553, 11.5726888, 3.8373582), -1),
        (Smooth(_rossler, (0, 0.8549721)), "flip", (0.8549721, 4.8647794, 0.2325115, 23.2026112, 4.1242147), -1),
    ),
    "morris_lecar": (
        (Smooth(HOPF_LIKE, (0, -8.5051433)), "fold", (-8.5051433, 0.4915575, 135.3861436, 88.2932505), 1),
        (Smooth(HOPF_LIKE, (1, 0.5066678)), "fold", (-8.5052339, 0.5066678, 77.9290518, 216.8998014), 0),
        (Smooth(CIRCLE, (0, -6.7553532)), "fold", (-6.7553532, 0.1440122, 37.410378, 116.4302642), 1),
    ),
    "hindmarsh_rose": (
        (Smooth(_hindmarsh, (0, 0.429942)), "flip", (0.429942, -4.8499721, 3.6002303, 31.9337131, 3.4942547), -1),
    ),
    "fitzhugh_nagumo": ((Smooth(_nerve, (1, 0.285595)), "fold", (0.0, 0.285595, 68.5264466, 0.3241785), 0),),
}
"""By file of problems/: (what is shot, kind, (x, T, lambda) or (x, lambda) next to it, the entry that is moved)."""
HOPFS = {
    "morris_lecar": ((HOPF_LIKE, (-26.0, 0.13), 93.0), (HOPF_LIKE, (7.8, 0.6), 212.0), (CIRCLE, (8.0, 0.4), 98.0)),
    "hindmarsh_rose": ((_hindmarsh, (1.3, -7.45, 11.6), 24.0),),
    "fitzhugh_nagumo": ((_nerve, (-0.967, -0.334), 0.33),),
}


def _chua(alpha: float, inner: bool) -> Array:
    slope, offset = (-8 / 7, 0.0) if inner else (-5 / 7, -3 / 7)
    A = [[-alpha * (1 + slope), alpha, 0, -alpha * offset], [1, -1, 1, 0], [0, -100 / 7, 0, 0], [0, 0, 0, 0]]
    return np.array(A)


def _gear(w: float, spring: float) -> Array:
    A = np.zeros((5, 5))
    A[0, 1], A[2, 3], A[3, 2] = 1.0, -w, w
    A[1] = [-spring, -0.1, 0.02, 0.0, 0.1 + spring]
    return A


def chua() -> Iterator[tuple[str, float]]:
    """The flip, and the centre of the outer zone."""
    border = np.array([1.0, 0.0, 0.0]), 1.0
    linear = Linear(lambda alpha: (_chua(alpha, False), _chua(alpha, True)), (border, border), 3)
    start = np.array([1.0, 0.2466767, -0.2195159, 1.3394142, 0.939811, 8.1752084])
    yield "flip", linear.special("flip", start)[-1]

    def growth(alpha: float) -> float:
        eig = np.linalg.eigvals(_chua(alpha, False)[:3, :3])
        return float(eig[np.argmax(np.abs(eig.imag))].real)

    yield "centre", brentq(growth, 6.0, 8.0, xtol=1e-14)


def gears() -> Iterator[tuple[str, float]]:
    """Both folds."""
    border = np.array([1.0, 0.0]), 1.0
    linear = Linear(lambda w: (_gear(w, 1.0), _gear(w, 0.0)), (border, border), 2, lambda w: w)
    for start in ((1.0, 0.1831927, -0.2751861, 4.1872039, 3.6865596, 0.7979901),
                  (1.0, 0.0337511, -2.2626196, 6.0963346, 0.8133211, 0.9093341)):  # fmt: skip
        yield "fold", linear.special("fold", start, held=1, step=1e-5)[-1]


def threshold_harvest() -> Iterator[tuple[str, float]]:
    """The largest y of the cycle without harvest, by following it until it is the same."""

    def rates(t: float, x: Any) -> list[Any]:
        caught = x[0] / (1 + x[0])
        return [x[0] * (1 - x[0] / 4) - caught * x[1], x[1] * (caught - 0.5)]

    def top(t: float, x: Any) -> float:
        return float(x[0] / (1 + x[0]) - 0.5)

    top.direction = -1  # type: ignore[attr-defined]
    found = solve_ivp(rates, (0, 1500), [1.0, 1.0], events=top, method="DOP853", rtol=TIGHT, atol=TIGHT)
    yield "grazing", found.y_events[0][-2, 1]


def cubic_friction() -> Iterator[tuple[str, float]]:
    """The cycle without stick whose velocity comes up to the belt's: (V, T) by Newton's method."""

    def rates(t: float, x: Any, V: float) -> list[Any]:
        u = (V - x[1]) / 0.5
        return [x[1], 0.4 - 0.225 * (u - u**3 / 3) - 0.1 * x[1] - x[0]]

    def off(unknowns: Any) -> Array:
        V, T = unknowns
        start = np.array([0.4 - 0.1 * V, V])
        end = solve_ivp(rates, (0, T), start, args=(V,), method="DOP853", rtol=TIGHT, atol=TIGHT)
        return end.y[:, -1] - start

    yield "grazing", fsolve(off, (0.3958, 6.3676), xtol=1e-13)[0]


RC, LC, RAMP = (22.0 * 47e-6, 47e-6), 0.02, (11.75238, 1309.524, 400e-6)
BUCK = np.array([[-1 / RC[0], 1 / RC[1]], [-1 / LC, 0.0]])
LOOKS = 200
"""Places in what is left of a ramp at which the voltage is held against it."""


def _ramp_later(x: Array, E: float) -> Array:
    """(v, i) one ramp later."""
    t, on = 0.0, bool(x[0] < RAMP[0])
    while True:
        rest = -np.linalg.solve(BUCK, np.array([0.0, on * E / LC]))

        def flown(tau: float, x: Array = x, rest: Array = rest) -> Array:
            return np.asarray(rest + expm(BUCK * tau) @ (x - rest))

        def over(tau: float, t: float = t, flown: Callable[[float], Array] = flown) -> float:
            return float(flown(tau)[0] - RAMP[0] - RAMP[1] * (t + tau))

        times = np.linspace(1e-9, RAMP[2] - t, LOOKS)
        wrong = np.flatnonzero((np.array([over(tau) for tau in times]) > 0) == on)
        if wrong.size == 0:
            return flown(RAMP[2] - t)
        k = wrong[0]
        tau = brentq(over, times[k - 1], times[k], xtol=1e-17, rtol=1e-14) if k else times[0]
        x, t, on = flown(tau), t + tau, not on


def buck() -> Iterator[tuple[str, float]]:
    """Flips of the cycles of one and two ramps: 1 + trace + determinant of the map, by central differences."""

    def ramps(x: Array, E: float, n: int) -> Array:
        for _ in range(n):
            x = _ramp_later(x, E)
        return x

    def gap(E: float, x: Array, n: int) -> tuple[float, Array]:
        for _ in range(8):
            steps = [(ramps(x + h, E, n) - ramps(x - h, E, n)) / 2e-6 for h in 1e-6 * np.eye(2)]
            J = np.array(steps).T
            x = x - np.linalg.solve(J - np.eye(2), ramps(x, E, n) - x)
        return float(1 + np.trace(J) + np.linalg.det(J)), x

    for n, E in ((1, 24.4), (2, 30.9)):
        x = ramps(np.array([12.0, 0.55]), E, 600)
        (a, (ga, x)), b = (E, gap(E, x, n)), E + 0.1
        gb, x = gap(b, x, n)
        while abs(b - a) > 1e-9:
            a, ga, b = b, gb, b - gb * (b - a) / (gb - ga)
            gb, x = gap(b, x, n)
        yield "flip", b


OTHERS = {f.__name__: f for f in (buck, chua, cubic_friction, gears, threshold_harvest)}


def main(names: Sequence[str]) -> None:
    """Print the numbers of these files, or of all."""
    for name in names or sorted({*STARTS, *HOPFS, *OTHERS}):
        for smooth, kind, start, held in STARTS.get(name, ()):
            print(f"{name}: {kind} {smooth.special(kind, start, held, 1e-5)[-1]:.13g}", flush=True)
        for rates, x, value in HOPFS.get(name, ()):
            print(f"{name}: Hopf {hopf(rates, x, value):.13g}", flush=True)
        for kind, value in OTHERS[name]() if name in OTHERS else ():
            print(f"{name}: {kind} {value:.13g}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
