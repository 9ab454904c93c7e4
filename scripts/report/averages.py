"""Which friction would explain the report's measured averages, 0.061 rad and 0.122 Hz at K = 0.04?

    python -m scripts.report.averages

Two numbers, a(q) = 0.061 rad and T(q) = 1/0.122 s, fix two parameters where the others are given: Newton's method in
their logarithms, with derivatives by differences of computed cycles.  Static and Coulomb friction are the two; the
Stribeck velocity, the viscous friction and the inertia are then varied, which gives curves of servos that all meet both
averages.  The page docs/report.md says what they share.

Symbols: a amplitude [rad], T period [s], q parameters, z logarithms of the two that are sought.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from casahunt import NoOrbit, Servo, find_orbit
from casahunt.servo.friction import Model
from casahunt.servo.servo import flatten
from scripts.report.study import GAIN, MEASURED_AMPLITUDE, MEASURED_PERIOD

Array = np.ndarray

SOUGHT = ("friction.static", "friction.coulomb")
DIFFERENCE, MOST_STEPS, LONGEST = 1e-5, 30, 0.1
"""Of logarithms: for derivatives; Newton steps, and the longest."""
CLOSED = 1e-8
"""Relative error at which both averages are met."""
VARIED: dict[str, tuple[float, ...]] = {
    "friction.stribeck_velocity": (0.25, 0.5, 1.0, 2.0, 4.0),
    "friction.viscous": (0.025, 0.25, 0.5, 1.0, 2.0, 4.0),
    "servo.inertia": (0.5, 1.0, 2.0),
}
"""Factors of Table 1's values."""


@dataclass(frozen=True)
class Explained:
    """A servo that meets both averages, the parameters that were sought, and what its slips do."""

    servo: Servo
    values: dict[str, float]
    fastest: float


def averages(servo: Servo, model: Model) -> Array:
    """(2,) logarithms of amplitude and period over the measured ones.  Raises NoOrbit."""
    orbit = find_orbit(servo, model, GAIN)
    return np.asarray(np.log([orbit.amplitude / MEASURED_AMPLITUDE, orbit.period / MEASURED_PERIOD]))


def explained(servo: Servo, model: Model, sought: Sequence[str] = SOUGHT) -> Explained | None:
    """The servo that meets both averages by two of its parameters; None where Newton's method finds none."""
    z = np.log([flatten(servo)[name] for name in sought])

    def at(z: Array) -> Servo:
        return servo.replace(**dict(zip(sought, map(float, np.exp(z)), strict=True)))

    try:
        off = averages(at(z), model)
        for _ in range(MOST_STEPS):
            if np.abs(off).max() < CLOSED:
                orbit = find_orbit(at(z), model, GAIN)
                fastest = max(float(np.abs(arc.states[:, :, 1]).max()) for arc in orbit.arcs)
                return Explained(at(z), dict(zip(sought, map(float, np.exp(z)), strict=True)), fastest)
            J = np.array([(averages(at(z + d), model) - off) / DIFFERENCE for d in DIFFERENCE * np.eye(2)]).T
            step = -np.linalg.solve(J, off)
            step *= min(1.0, LONGEST / float(np.abs(step).max()))
            while True:
                try:
                    off = averages(at(z + step), model)
                    break
                except (NoOrbit, ValueError):
                    step /= 2
                    if np.abs(step).max() < 1e-6:
                        return None
            z = z + step
    except (NoOrbit, ValueError, np.linalg.LinAlgError):
        return None
    return None


def main() -> int:
    """Print the tables."""
    table = Servo()
    own = flatten(table)
    for model in ("switch", "lugre"):
        off = averages(table, model)
        print(f"{model}, Table 1: amplitude {math.expm1(off[0]):+.1%}, period {math.expm1(off[1]):+.1%}")
        for name, factors in VARIED.items():
            for factor in factors:
                found = explained(table.replace(**{name: factor * own[name]}), model)
                said = "none found" if found is None else "  ".join(
                    f"{key} {value:.4f} ({value / own[key] - 1:+.1%})" for key, value in found.values.items()
                ) + f"  fastest {found.fastest:.3f} rad/s"
                print(f"  {name} = {factor * own[name]:.4g}: {said}", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
