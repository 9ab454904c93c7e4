"""What an answer is compared with: Taylor series with events, and a second solve of another kind.

    Switch cycles   P(a) - a changes sign within the claimed error; its root gives the true amplitude and the period
    LuGre cycles    half a cycle from the computed state, where its stiffness allows
    second solve    another collocation degree and kind, a tolerance 100 times tighter

P(a): the next stick position of a Switch servo that breaks away at x1 = -a.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from casahunt import NoOrbit, Options, Servo, find_fold, find_orbit
from casahunt.servo.problem import SCHEMES
from problems import taylor
from scripts.extremes.cases import Case
from scripts.limits import TooSlow, within

BLURRED = 1e-7
"""Relative width of the periods that Taylor series give around its cycle, above which they are no truth."""
STEP_COST = 1e-3
"""Time of the Taylor engine per radian of the bristle's oscillation [s], roughly."""


@dataclass(frozen=True)
class Truth:
    """A comparison: relative `error`, the part of it that is `rounding` of the truth itself, and who says so."""

    error: float
    rounding: float
    by: str


def taylor_cycle(servo: Servo, orbit: Any, limit: float) -> Truth | None:
    """The Switch cycle next to `orbit`: the root of P(a) - a, bracketed; None where it cannot be computed."""
    gain, claimed = orbit.gain, max(orbit.error_estimate, 1e-13)
    kp, _, _ = servo.torque_gains(gain)
    a0 = abs(float(orbit.arcs[-1].end[0]))
    mu = orbit.half_multiplier if orbit.half else math.nan
    slope = mu if math.isfinite(mu) else -1.0
    conditioning = max(1.0, servo.friction.static / (kp * a0))
    noise = 2e-14 * conditioning * (abs(slope) + 10) / max(abs(slope - 1), 1e-12)

    def excess(a: float) -> float:
        return taylor.switch_half_cycle(servo, gain, a)[0] - a

    try:
        with within(limit):
            width, low, high = claimed + noise, a0, a0
            f_low = f_high = 0.0
            while width < 0.03:
                low, high = a0 * (1 - width), a0 * (1 + width)
                f_low, f_high = excess(low), excess(high)
                if f_low * f_high <= 0:
                    break
                width *= 10
            else:
                return Truth(math.inf, noise, "Taylor: no root of P(a) - a within 3 %")
            for k in range(80):
                if high - low <= 1e-15 * high or f_low == f_high:
                    break
                theta = 0.5 if k % 3 == 2 else min(max(f_low / (f_low - f_high), 1e-3), 1 - 1e-3)
                middle = low + theta * (high - low)
                f = excess(middle)
                if f * f_low > 0:
                    low, f_low = middle, f
                else:
                    high, f_high = middle, f
                if f == 0:
                    low = high = middle
                    break
            a = (low + high) / 2
            periods = [2 * taylor.switch_half_cycle(servo, gain, a * (1 + s))[1] for s in (0, noise, -noise)]
    except (TooSlow, ArithmeticError, ValueError):
        return None
    spread = (max(periods) - min(periods)) / periods[0]
    if spread > BLURRED:  # one rounding error of a moves the next stick position visibly, and with it the period
        return Truth(abs(a0 / a - 1), noise + 1e-12, "Taylor (amplitude)")
    error = max(abs(a0 / a - 1), abs(orbit.period / periods[0] - 1))
    return Truth(error, noise + 3 * spread + 1e-12, "Taylor")


def taylor_lugre(servo: Servo, orbit: Any, limit: float) -> Truth | None:
    """Half a LuGre cycle by Taylor series from the state of `orbit`; the error is divided by 1 + |mu|."""
    if orbit.period / 2 * math.sqrt(servo.friction.stiffness / servo.inertia) * STEP_COST > limit:
        return None
    x0 = orbit.arcs[0].states[0, 0].copy()
    try:
        with within(limit):
            sign = 1.0 if x0[1] > 0 else -1.0
            x, half, largest = taylor.lugre_half_cycle(servo, orbit.gain, x0.copy(), sign)
    except (TooSlow, ArithmeticError, ValueError):
        return None
    growth = 1 + abs(orbit.half_multiplier)
    period, amplitude = abs(2 * half / orbit.period - 1), abs(largest / orbit.amplitude - 1)
    return Truth(max(period, amplitude) / growth, 1e-11, "Taylor")


def other_options(case: Case, estimate: float) -> Options:
    """Another scheme and a tolerance 100 times tighter, and tighter than the claimed error."""
    degree, kind = case.degree or SCHEMES[case.model][0], case.kind or SCHEMES[case.model][1]  # type: ignore[index]
    if case.model == "switch":
        other = (7, "radau") if kind == "gauss" else (8, "gauss")
    else:
        other = (9, "radau") if degree == 7 and kind == "radau" else (7, "radau")
    return Options(tol=max(min(case.tol / 100, estimate / 5), 1e-12), degree=other[0], kind=other[1])  # type: ignore[arg-type]


def second_solve(case: Case, servo: Servo, found: Any, limit: float) -> Truth | None:
    """The same question, solved otherwise."""
    best = other_options(case, found.error_estimate)
    for options in (best, replace(best, tol=max(case.tol / 10, 10 * best.tol))):
        try:
            with within(limit), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                if case.what == "fold":
                    other = find_fold(servo, case.model, options=options)  # type: ignore[arg-type]
                    one, two = found.orbit, other.orbit
                    pairs = [(found.gain, other.gain), (one.amplitude, two.amplitude), (one.period, two.period)]
                else:
                    other = find_orbit(servo, case.model, found.gain, branch=case.what, options=options)  # type: ignore[arg-type]
                    pairs = [(found.amplitude, other.amplitude), (found.period, other.period)]
        except (NoOrbit, TooSlow, ArithmeticError, np.linalg.LinAlgError):
            continue
        by = f"second solve ({options.kind} {options.degree}, {options.tol:.0e})"
        return Truth(max(abs(a / b - 1) for a, b in pairs), other.error_estimate + 1e-13, by)
    return None


@lru_cache(maxsize=64)
def taylor_scan(servo: Servo, gain: float, points: int) -> tuple[bool, float, float]:
    """(a stable cycle is bracketed, largest P(a)/a, part of the motions that failed) of the Switch map."""
    kp, _, _ = servo.torque_gains(gain)
    outside, best, failed = False, 0.0, 0
    for a in servo.friction.static / kp * np.geomspace(20, 1e-4, points):
        try:
            with within(1.0):
                ratio = taylor.switch_half_cycle(servo, gain, float(a), thrown_out=3 * a, most_slips=12)[0] / a
        except (TooSlow, ArithmeticError, ValueError, IndexError):
            failed += 1
            continue
        best = max(best, ratio)
        if ratio < 1:
            outside = True
        elif outside:
            return True, best, failed / points
    return False, best, failed / points
