"""The questions of the grid, and what a verdict on one of them is.

sigma1 goes to and beyond its passivity limit: with the storage sigma0 z^2/2,

    v F - d/dt(sigma0 z^2/2) = |v| (y^2/g + (sigma1 + sigma2) |v| - sigma1 |v| y/g),   y = sgn(v) sigma0 z,  |y| <= Fs,

is never negative if and only if sigma1 <= sigma2 Fc/(Fs - Fc) (N. Barabanov and R. Ortega, IEEE Transactions on
Automatic Control 45 (2000) 830-832).  For Table 1 the limit is 0.489 N m s/rad: its sigma1 = 7.58 is 15.5 times beyond.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from casahunt import Options, Servo
from casahunt.servo.friction import MODELS

SOLVED, NONE, REFUSED, UNCHECKED, WRONG = "solved", "no cycle", "refused", "unchecked", "wrong"


@dataclass(frozen=True)
class Case:
    """One question: `what` is "fold", "stable" or "unstable"; the gain is `share` of the fold gain."""

    row: str
    column: str
    model: str
    what: str
    changes: tuple[tuple[str, float], ...] = ()
    share: float = 0.5
    tol: float = 1e-6
    degree: int | None = None
    kind: str | None = None

    @property
    def servo(self) -> Servo:
        """Table 1 with the changes."""
        return Servo().replace(**dict(self.changes))

    @property
    def options(self) -> Options:
        """How it is solved."""
        return Options(tol=self.tol, degree=self.degree, kind=self.kind)  # type: ignore[arg-type]

    @property
    def command(self) -> str:
        """The line that reproduces it, but for the gain."""
        scheme = f" (degree {self.degree}, {self.kind})" if self.degree else ""
        verb = "fold" if self.what == "fold" else f"orbit --branch {self.what}"
        sets = "".join(f" --set {key}={value!r}" for key, value in self.changes)
        return f"casahunt {verb} --model {self.model} --tol {self.tol:g}{sets}{scheme}"


@dataclass(frozen=True)
class Result:
    """The verdict on a case; errors are relative, `true` against what `checked_by` names."""

    case: Case
    verdict: str
    seconds: float = 0.0
    gain: float | None = None
    value: float | None = None
    multiplier: float | None = None
    estimate: float | None = None
    true: float | None = None
    checked_by: str = ""
    reason: str = ""
    notes: list[str] = field(default_factory=list)


VARIED: dict[str, tuple[str, tuple[float, ...]]] = {
    "J": ("servo.inertia", (2.6e-4, 2.6e-3, 0.26, 2.6)),
    "cm": ("servo.motor_gain", (0.16, 1.6, 160.0, 1600.0)),
    "tau_i": ("controller.integral_time", (0.01, 0.03, 0.1, 0.5, 2.0, 10.0)),
    "tau_d": ("controller.lead_time", (0.01, 0.03, 0.1, 0.5, 2.0, 10.0)),
    "vs": ("friction.stribeck_velocity", (1e-4, 3e-4, 1e-3, 5e-3, 0.06, 0.2)),
    "Fs/Fc": ("friction.static", tuple(0.44 * r for r in (1.0, 1.001, 1.03, 1.1, 1.5, 2.0, 3.0))),
    "sigma2": ("friction.viscous", (0.0, 0.01, 1.0, 3.0)),
    "sigma0": ("friction.stiffness", (2.2e2, 2.2e3, 2.2e5, 1e6, 1e7)),
    "sigma1": ("friction.damping", (0.0, 0.0489, 0.489, 47.8, 200.0)),
}
"""{symbol: (key, values)}; sigma1: zero, a tenth of and the passivity limit, the bristle's critical damping, more."""
LUGRE_ONLY = ("sigma0", "sigma1")
PAIRS: dict[str, dict[str, float]] = {
    "J, tau_d low": {"servo.inertia": 2.6e-4, "controller.lead_time": 0.01},
    "J high, tau_d high": {"servo.inertia": 2.6, "controller.lead_time": 10.0},
    "tau_i, tau_d low": {"controller.integral_time": 0.01, "controller.lead_time": 0.01},
    "tau_i, tau_d high": {"controller.integral_time": 10.0, "controller.lead_time": 10.0},
    "tau_i low, tau_d high": {"controller.integral_time": 0.01, "controller.lead_time": 10.0},
    "tau_i high, tau_d low": {"controller.integral_time": 10.0, "controller.lead_time": 0.01},
    "Fs/Fc 3, vs 1e-3": {"friction.static": 1.32, "friction.stribeck_velocity": 1e-3},
    "Fs/Fc 3, vs 0.2": {"friction.static": 1.32, "friction.stribeck_velocity": 0.2},
    "Fs/Fc 1.03, vs 1e-3": {"friction.static": 0.4532, "friction.stribeck_velocity": 1e-3},
    "sigma0 1e7, sigma1 0.489": {"friction.stiffness": 1e7, "friction.damping": 0.489},
    "sigma0 1e7, sigma1 162": {"friction.stiffness": 1e7, "friction.damping": 162.0},
    "sigma0 1e6, vs 1e-3": {"friction.stiffness": 1e6, "friction.stribeck_velocity": 1e-3},
}
SHARES = (1e-3, 1e-2, 0.1, 0.9, 0.99, 0.999, 0.9999, 1.0001, 1.1)
TOLERANCES = (1e-2, 1e-4, 1e-8, 1e-10, 1e-11, 1e-12)
WHATS = ("fold", "stable", "unstable")


def value_label(symbol: str, value: float) -> str:
    """The value as the picture shows it."""
    return f"{value / 0.44:.4g}" if symbol == "Fs/Fc" else f"{value:.3g}"


class Question(NamedTuple):
    """A place of the grid: its row and column in the picture, what is asked for there, and how."""

    row: str
    column: str
    whats: tuple[str, ...] = WHATS
    how: Mapping[str, Any] = {}


def extremes(model: str, quick: bool) -> Iterator[Question]:
    """One parameter at a time."""
    for symbol, (key, values) in VARIED.items():
        if model == "lugre" or symbol not in LUGRE_ONLY:
            for value in (values[0], values[-1]) if quick else values:
                yield Question(symbol, value_label(symbol, value), how={"changes": ((key, value),)})


def shares(quick: bool) -> Iterator[Question]:
    """Gains from far below the fold to beyond it."""
    for share in (0.01, 0.9999, 1.0001) if quick else SHARES:
        yield Question("K/K_fold", f"{share:g}", ("stable",) if share > 1 else ("stable", "unstable"), {"share": share})


def tolerances(quick: bool) -> Iterator[Question]:
    """From loose to the last digits."""
    for tol in (1e-2, 1e-12) if quick else TOLERANCES:
        yield Question("tolerance", f"{tol:g}", how={"tol": tol})


def schemes(quick: bool) -> Iterator[Question]:
    """Degrees of both kinds of collocation points."""
    for kind in ("gauss", "radau"):
        for degree in (2, 9) if quick else range(2, 10):
            how = {"degree": degree, "kind": kind, "tol": 1e-7}
            yield Question(f"degree, {kind}", f"{degree}", ("stable", "fold"), how)


def pairs(model: str, quick: bool) -> Iterator[Question]:
    """Two parameters at their extremes."""
    for name, pair in list(PAIRS.items())[:: 5 if quick else 1]:
        if model == "lugre" or not any(key in pair for key in ("friction.stiffness", "friction.damping")):
            yield Question("pairs", name, how={"changes": tuple(pair.items())})


def random_servos(quick: bool, seed: int) -> Iterator[Question]:
    """All parameters at random, the same for both models."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")

    for number in range(2 if quick else 8):
        changes = {
            "servo.inertia": between(2.6e-3, 0.26), "servo.motor_gain": between(1.6, 160),
            "controller.integral_time": between(0.03, 3), "controller.lead_time": between(0.03, 3),
            "friction.static": round(0.44 * between(1.02, 3), 4), "friction.stribeck_velocity": between(1e-3, 0.2),
            "friction.viscous": between(0.01, 1), "friction.stiffness": between(1e3, 1e6),
            "friction.damping": between(0.1, 50),
        }  # fmt: skip
        yield Question("random", f"#{number + 1}", how={"changes": tuple(changes.items())})


def grid(quick: bool, seed: int = 1) -> list[Case]:
    """All cases; `quick` keeps the ends of each row and alternates what is asked for."""
    cases: list[Case] = []
    turn = 0
    for model in MODELS:
        rows = (extremes(model, quick), shares(quick), tolerances(quick), schemes(quick), pairs(model, quick),
                random_servos(quick, seed))  # fmt: skip
        for question in chain(*rows):
            turn += 1
            asked = (question.whats[turn % len(question.whats)],) if quick else question.whats
            cases += [Case(question.row, question.column, model, what, **question.how) for what in asked]
    return cases
