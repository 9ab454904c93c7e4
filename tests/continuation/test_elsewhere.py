"""Branches of two systems from other fields, against their closed forms: a walker and a converter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from casahunt.continuation import follow
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle


def expm(A: np.ndarray) -> np.ndarray:
    """exp A of a matrix with different eigenvalues."""
    values, vectors = np.linalg.eig(A)
    return ((vectors * np.exp(values)) @ np.linalg.inv(vectors)).real


def root(f: Callable[[float], float], low: float, high: float) -> float:
    """By bisection, to rounding."""
    sign = np.sign(f(low))
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if np.sign(f(middle)) == sign else (low, middle)
    return low


# A rimless wheel rolls down a slope (McGeer 1990).  With w the speed in front of a foot strike,
#     w^2 = 4 g/l sin(alpha) sin(slope) / (1 - cos(2 alpha)^2),    multiplier cos(2 alpha)^2
# until it does not get over the top any more: cos(2 alpha)^2 w^2 / 2 = g/l (1 - cos(slope - alpha)).
ALPHA, G = np.pi / 8, 9.81

WHEEL = System(
    "rimless wheel",
    states=("angle", "rate"),
    parameters={"g": G, "l": 1.0, "slope": 0.08, "alpha": ALPHA},
    modes=(
        Mode("swing", field=lambda x, p: {"angle": x.rate, "rate": p.g / p.l * ca.sin(x.angle)},
             ends=(Event("foot strike", lambda x, p: x.angle - p.slope - p.alpha, +1, to="swing",
                         reset=lambda x, p: {"angle": x.angle - 2 * p.alpha, "rate": x.rate * ca.cos(2 * p.alpha)}),)),
    ),
)  # fmt: skip


def strike_speed_squared(slope: float) -> float:
    return 4 * G * np.sin(ALPHA) * np.sin(slope) / (1 - np.cos(2 * ALPHA) ** 2)


def test_a_branch_that_ends_at_an_equilibrium_has_no_folds_there() -> None:
    orbit = find_cycle(WHEEL, angle=0.0, rate=1.0)
    assert orbit.extrema("rate").high.value == pytest.approx(np.sqrt(strike_speed_squared(0.08)), rel=1e-9)
    assert orbit.multipliers.leading.real == pytest.approx(np.cos(2 * ALPHA) ** 2, rel=1e-9)
    branch = follow(orbit, "slope", to=0.02)
    least = root(
        lambda s: np.cos(2 * ALPHA) ** 2 * strike_speed_squared(s) / 2 - G * (1 - np.cos(s - ALPHA)), 0.01, 0.08
    )
    assert branch.special == () and branch.missed == ()
    assert branch.values[-1] == pytest.approx(least, rel=1e-8)
    assert branch.ended.startswith("slope tends to 0.06822945") and "homoclinic" in branch.ended
    assert len(branch.orbits) < 12  # beyond, any period would do


THERMOSTAT = System(
    "thermostat",
    states=("T", "q"),
    parameters={"low": 19.0, "high": 21.0, "out": 5.0, "tau": 600.0, "lag": 60.0, "gain": 40.0},
    modes=(
        Mode("heat", field=lambda x, p: {"T": (p.out - x.T + p.gain * x.q) / p.tau, "q": (1 - x.q) / p.lag},
             ends=(Event("warm", lambda x, p: x.T - p.high, +1, to="idle"),)),
        Mode("idle", field=lambda x, p: {"T": (p.out - x.T + p.gain * x.q) / p.tau, "q": -x.q / p.lag},
             ends=(Event("cold", lambda x, p: x.T - p.low, -1, to="heat"),)),
    ),
)  # fmt: skip


def test_a_cycle_without_hysteresis_has_no_time_left() -> None:
    # With two lags and no hysteresis the relay switches ever faster; with a gain of 16 the room never gets warm.
    orbit = find_cycle(THERMOSTAT, "heat", T=15.0, q=0.0)
    closer = follow(orbit, "low", to=21.5)
    assert closer.special == () and closer.missed == ()
    assert closer.values[-1] == pytest.approx(21.0, abs=1e-5) and closer.end.kind == "shrinks to a point"
    weaker = follow(orbit, "gain", to=10.0)
    assert weaker.special == () and weaker.missed == ()
    assert weaker.values[-1] == pytest.approx(16.0, abs=1e-5) and weaker.end.kind == "level reached"


# A buck converter under a ramp (di Bernardo, Fossas, Olivar and Vasca 1997): flip at 24.51 V.
BUCK = {"R": 22.0, "C": 47e-6, "L": 20e-3, "E": 20.0, "a": 8.4, "V": 11.3, "low": 3.8, "high": 8.2, "T": 400e-6}


def behind_ramp(x: Any, p: Any) -> Any:
    return (p.low + (p.high - p.low) * x.s - p.a * (x.v - p.V)) / 10


def restarted(x: Any, p: Any) -> str:
    return "on" if behind_ramp(x, p) > 0 else "off"


def circuit(on: bool) -> Any:
    return lambda x, p: {"v": (x.i - x.v / p.R) / p.C, "i": (on * p.E - x.v) / p.L, "s": 1 / p.T}


TICK = Event("tick", lambda x, p: x.s - 1, +1, to=restarted, reset=lambda x, p: {"s": 0})
CONVERTER = System(
    "buck converter",
    states=("v", "i", "s"),
    parameters=BUCK,
    modes=(
        Mode("off", field=circuit(False), ends=(Event("closes", behind_ramp, +1, to="on"), TICK)),
        Mode("on", field=circuit(True), ends=(Event("opens", behind_ramp, -1, to="off"), TICK)),
    ),
)


def one_turn(E: float) -> tuple[float, np.ndarray]:
    """(part of the turn that is off, multipliers) of the cycle with one closing: affine maps by matrix exponentials."""
    c = BUCK
    A = np.array([[-1 / (c["R"] * c["C"]), 1 / c["C"]], [-1 / c["L"], 0.0]])
    push = np.linalg.solve(A, np.array([0.0, E / c["L"]]))  # x' = A (x + push) while it is on

    def start(d: float) -> np.ndarray:
        off, on = expm(A * c["T"] * d), expm(A * c["T"] * (1 - d))
        return np.linalg.solve(np.eye(2) - on @ off, on @ push - push)

    def gap(d: float) -> float:
        v = (expm(A * c["T"] * d) @ start(d))[0]
        return c["low"] + (c["high"] - c["low"]) * d - c["a"] * (v - c["V"])

    d = root(gap, 0.01, 0.99)
    off, on = expm(A * c["T"] * d), expm(A * c["T"] * (1 - d))
    x = off @ start(d)
    normal = np.array([-c["a"], 0.0])
    rate = normal @ A @ x + (c["high"] - c["low"]) / c["T"]
    jump = np.eye(2) + np.outer(A @ push, normal) / rate
    return d, np.linalg.eigvals(on @ jump @ off)


def test_the_flip_of_a_converter() -> None:
    orbit = find_cycle(CONVERTER, "off", v=12.0, i=0.55, s=0.0)
    d, multipliers = one_turn(20.0)
    assert orbit.arcs[0].duration == pytest.approx(d * BUCK["T"], rel=1e-8)
    found = sorted(orbit.multipliers.full[1:], key=lambda mu: mu.imag)
    assert found == pytest.approx(sorted(multipliers, key=lambda mu: mu.imag), rel=1e-7)
    branch = follow(orbit, "E", to=30.0)
    flip = root(lambda E: float(np.min(one_turn(E)[1].real)) + 1, 23.0, 26.0)
    assert [special.kind for special in branch.special] == ["flip"]
    assert branch.special[0].orbit.problem.value("E") == pytest.approx(flip, rel=1e-8)


BRUSSELATOR = System(
    "brusselator",
    states=("x", "y"),
    parameters={"a": 1.0, "b": 3.0},
    modes=(
        Mode("reaction", field=lambda x, p: {"x": p.a + x.x**2 * x.y - (p.b + 1) * x.x, "y": p.b * x.x - x.x**2 * x.y}),
    ),
)


def test_a_smooth_cycle_that_shrinks_ends_at_its_hopf_bifurcation() -> None:
    # The equilibrium (a, b/a) has trace b - 1 - a^2 and determinant a^2: omega = a.
    for a in (1.0, 1.3):
        orbit = find_cycle(BRUSSELATOR, x=1.0, y=1.0, parameters={"a": a, "b": 3.2})
        branch = follow(orbit, "b", to=1.0)
        assert [special.kind for special in branch.special] == ["Hopf"]
        assert branch.special[0].at == pytest.approx(1 + a**2, rel=1e-10)
        assert branch.orbits[-1].period == pytest.approx(2 * np.pi / a, rel=1e-3)
        assert "shrunk to an equilibrium" in branch.ended and branch.missed == ()


@pytest.mark.slow
def test_a_canard_explosion_is_one_fold_and_a_hopf_bifurcation() -> None:
    # FitzHugh and Nagumo: the equilibria with 1 - v^2 = b eps; both Hopf bifurcations are subcritical, so that the
    # branch turns once, at a fold, where the cycle is next to a canard.
    neuron = System(
        "FitzHugh-Nagumo",
        states=("v", "w"),
        parameters={"I": 0.5, "eps": 0.08, "a": 0.7, "b": 0.8},
        modes=(
            Mode("neuron", field=lambda x, p: {"v": x.v - x.v**3 / 3 - x.w + p.I,
                                               "w": p.eps * (x.v + p.a - p.b * x.w)}),
        ),
    )  # fmt: skip
    orbit = find_cycle(neuron, v=-1.0, w=1.0)
    for side, to in ((1.0, 2.0), (-1.0, 0.2)):
        branch = follow(orbit, "I", to=to)
        v = side * np.sqrt(1 - 0.8 * 0.08)
        assert [special.kind for special in branch.special] == ["fold", "Hopf"]
        assert branch.special[1].at == pytest.approx(v**3 / 3 - v + (v + 0.7) / 0.8, rel=1e-9)
        assert branch.stable[0] and not branch.stable[-1]
