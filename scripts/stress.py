"""Numerical stability under a grid of extremes: solved, rightly found to have no cycle, honestly refused, or wrong.

    python scripts/stress.py [--out DIR] [--quick] [--jobs N] [--rows WORD ...] [--limit N] [--no-extras]

The grid: from the servo of Table 1, one parameter at a time to its extremes, then pairs at their extremes, then
seeded random servos; for each of them and for both friction models the fold, and the stable and the unstable cycle at
half the fold gain; and at Table 1 itself gains from 1e-3 to 0.9999 of the fold and beyond it, tolerances from 1e-2 to
1e-12, degrees 2 to 9 of both kinds.  sigma1 goes to and beyond its passivity limit: with the storage sigma0 z^2/2,

    v F - d/dt(sigma0 z^2/2) = |v| (y^2/g + (sigma1 + sigma2) |v| - sigma1 |v| y/g),   y = sgn(v) sigma0 z,  |y| <= Fs,

is never negative if and only if sigma1 <= sigma2 Fc/(Fs - Fc) (N. Barabanov and R. Ortega, IEEE Transactions on
Automatic Control 45 (2000) 830-832).  For Table 1 the limit is 0.489 N m s/rad: its sigma1 = 7.58 is 15.5 times beyond.

Truth is never the solve in question:

    Switch cycles   Taylor series with events (problems/taylor.py): P(a) - a changes sign within the claimed error, its
                    root gives the true amplitude and the period
    LuGre cycles    half a cycle by Taylor series from the computed state, where its stiffness allows, whose closure,
                    period and amplitude may be off by 10 (1 + |mu|) errors; and always a second solve
    folds           a second solve; for Switch also no stable fixed point of the map by Taylor 2 % above
    second solve    another collocation degree and kind, a tolerance 100 times tighter
    no cycle        the scan of the map by Taylor shows none (Switch; for LuGre the same map, which lies close), or the
                    gain lies beyond the confirmed fold

A case is wrong if the true error exceeds 10 times the estimate or 10 times the tolerance (rounding apart), if a
refusal denies a cycle that exists or names no reason, or if anything but NoOrbit is raised.  Refusals where no truth
is at hand count as refused although a cycle exists, answers that nothing could be compared with as unchecked.

Writes stress.csv, stress.json, stress.png; prints the summary; exit code 1 if anything is wrong.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import multiprocessing
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Options, Servo, find_fold, find_orbit  # noqa: E402
from casahunt.continuation.walk import walk  # noqa: E402
from casahunt.interrupts import end_with_parent  # noqa: E402
from casahunt.orbits.adapt import solve_adaptively  # noqa: E402
from casahunt.orbits.orbit import unknowns_of  # noqa: E402
from casahunt.servo.hunting import MODELS, SCHEMES  # noqa: E402
from casahunt.servo.linear_loop import routh_hurwitz_gain  # noqa: E402
from problems import taylor  # noqa: E402

SOLVED, NONE, REFUSED, UNCHECKED, WRONG = "solved", "no cycle", "refused", "unchecked", "wrong"
HONEST = 10.0
"""True errors up to this many times the estimate, and the tolerance, are as announced."""
SOLVE_LIMIT = 120.0
"""Time for one solve [s], 20 s for the quick grid; beyond, the case counts as refused."""
MEMORY_LIMIT, LEAK_LIMIT, LEAK_GAINS = 400.0, 20.0, 5
"""Peak memory [MB]; growth per solve [kB] over the second half of the solves, at this many gains in turn."""
BLURRED = 1e-7
"""Relative width of the periods that Taylor series give around its cycle, above which they are no truth."""
STEP_COST = 1e-3
"""Time of the Taylor engine per radian of the bristle's oscillation [s], roughly."""


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


class TooSlow(BaseException):
    """The time limit was reached; no `except Exception` on the way keeps it."""


@contextmanager
def within(seconds: float) -> Iterator[None]:
    """Raise TooSlow where the block takes more processor time: how busy the machine is must not decide an answer."""

    late = False

    def stop(*_: Any) -> None:
        nonlocal late
        late = True
        raise TooSlow

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)  # again and again, in case a callback swallows the first
    try:
        yield
    except KeyboardInterrupt:  # CasADi makes one of whatever a signal raises within IPOPT
        if late:
            raise TooSlow from None
        raise
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


# The grid.

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


def grid(quick: bool, seed: int = 1) -> list[Case]:
    """All cases; `quick` keeps the ends of each row and alternates what is asked for."""
    cases: list[Case] = []
    turn = 0

    def add(row: str, column: str, model: str, whats: tuple[str, ...], **more: Any) -> None:
        nonlocal turn
        turn += 1
        for what in (whats[turn % len(whats)],) if quick else whats:
            cases.append(Case(row, column, model, what, **more))

    for model in MODELS:
        for symbol, (key, values) in VARIED.items():
            if model == "switch" and symbol in LUGRE_ONLY:
                continue
            for value in (values[0], values[-1]) if quick else values:
                add(symbol, value_label(symbol, value), model, WHATS, changes=((key, value),))
        for share in (0.01, 0.9999, 1.0001) if quick else SHARES:
            whats = ("stable",) if share > 1 else ("stable", "unstable")
            add("K/K_fold", f"{share:g}", model, whats, share=share)
        for tol in (1e-2, 1e-12) if quick else TOLERANCES:
            add("tolerance", f"{tol:g}", model, WHATS, tol=tol)
        for kind in ("gauss", "radau"):
            for degree in (2, 9) if quick else range(2, 10):
                add(f"degree, {kind}", f"{degree}", model, ("stable", "fold"), degree=degree, kind=kind, tol=1e-7)
        for name, pair in list(PAIRS.items())[:: 5 if quick else 1]:
            if model == "lugre" or not any(key in pair for key in ("friction.stiffness", "friction.damping")):
                add("pairs", name, model, WHATS, changes=tuple(pair.items()))
        rng = np.random.default_rng(seed)

        def between(low: float, high: float, rng: np.random.Generator = rng) -> float:
            return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")

        for number in range(2 if quick else 8):
            changes = {
                "servo.inertia": between(2.6e-3, 0.26), "servo.motor_gain": between(1.6, 160),
                "controller.integral_time": between(0.03, 3), "controller.lead_time": between(0.03, 3),
                "friction.static": round(0.44 * between(1.02, 3), 4), "friction.stribeck_velocity": between(1e-3, 0.2),
                "friction.viscous": between(0.01, 1), "friction.stiffness": between(1e3, 1e6),
                "friction.damping": between(0.1, 50),
            }  # fmt: skip
            add("random", f"#{number + 1}", model, WHATS, changes=tuple(changes.items()))
    return cases


# Truth.


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


# Verdicts.


class Desk:
    """Answers the cases of one servo and model, whose fold is computed once."""

    def __init__(self, quick: bool) -> None:
        self.quick = quick
        self.limit = 20.0 if quick else SOLVE_LIMIT
        self.folds: dict[tuple[Any, ...], tuple[Any, float, str]] = {}

    def fold(self, case: Case) -> tuple[Any, float, str]:
        """(fold or None, seconds, reason)."""
        key = (case.model, case.changes, case.options)
        if key not in self.folds:
            self.folds[key] = solved(self.limit, lambda: find_fold(case.servo, case.model, options=case.options))  # type: ignore[arg-type]
        return self.folds[key]

    def verdict(self, case: Case) -> Result:
        """Solve, compare, judge."""
        servo, notes = case.servo, []
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            if case.what == "fold":
                found, seconds, reason = self.fold(case)
                gain = found.gain if found is not None else None
            else:
                fold = self.fold(replace(case, tol=1e-6, degree=None, kind=None))[0]
                if fold is None:
                    notes.append("no fold: gain placed at twice the Routh-Hurwitz gain")
                gain = case.share * fold.gain if fold is not None else 2 * finite_gain(servo)
                found, seconds, reason = solved(
                    self.limit, lambda: find_orbit(servo, case.model, gain, branch=case.what, options=case.options)  # type: ignore[arg-type]
                )
        notes += sorted({str(w.message)[:120] for w in heard})
        if found is None:
            return self.refusal(case, servo, gain, seconds, reason, notes)
        truths = self.truths(case, servo, found)
        mu = (found.orbit if case.what == "fold" else found).half_multiplier
        estimate = found.error_estimate
        value = found.gain if case.what == "fold" else found.amplitude
        allowed = min(HONEST * estimate, HONEST * case.tol)
        late = [t for t in truths if not t.error <= allowed + t.rounding]
        verdict = WRONG if late else SOLVED
        if not truths:
            notes.append("not checked: no truth could be computed")
            verdict = UNCHECKED
        off = [f"off by {t.error:.1e} (rounding {t.rounding:.0e}) against {t.by}" for t in late]
        reason = "; ".join(off)
        worst = max((t.error for t in truths), default=None)
        return Result(case, verdict, seconds, gain, value, mu, estimate, worst, " + ".join(t.by for t in truths),
                      reason, notes)  # fmt: skip

    def truths(self, case: Case, servo: Servo, found: Any) -> list[Truth]:
        """What the answer is compared with."""
        out: list[Truth | None] = []
        limit = 6.0 if self.quick else 40.0
        if case.what == "fold":
            out.append(second_solve(case, servo, found, self.limit))
            if case.model == "switch":
                above = taylor_scan(servo, 1.02 * found.gain, 12 if self.quick else 24)
                if above[0]:
                    out.append(Truth(0.02, 0.0, f"Taylor: a stable cycle at gain {1.02 * found.gain:.6g}"))
                elif above[2] <= 0.2:
                    out.append(Truth(0.0, 0.0, "Taylor scan 2 % above"))
        elif case.model == "switch":
            first = taylor_cycle(servo, found, limit)
            out.append(first)
            if first is None or first.rounding > case.tol or first.by != "Taylor":
                out.append(second_solve(case, servo, found, self.limit))
        else:
            out += [taylor_lugre(servo, found, limit / 2), second_solve(case, servo, found, self.limit)]
        return [t for t in out if t is not None]

    def refusal(
        self, case: Case, servo: Servo, gain: float | None, seconds: float, reason: str, notes: list[str]
    ) -> Result:
        """Is there really no cycle, or was it only not found?"""
        if reason.startswith("crash"):
            return Result(case, WRONG, seconds, gain, reason=reason, notes=notes)
        if len(reason) < 20:
            return Result(case, WRONG, seconds, gain, reason=f"no reason given: {reason!r}", notes=notes)
        denies = "no hunting limit cycle" in reason
        fold = None if gain is None else self.fold(replace(case, what="fold", tol=1e-6, degree=None, kind=None))[0]
        gains = [gain] if gain is not None else [finite_gain(servo) * 4.0**k for k in range(-2, 4)]
        points = 16 if self.quick else 32
        scans = [taylor_scan(servo, k, points) for k in gains]
        exists = any(s[0] for s in scans)
        seen = f"Taylor scan of the Switch map at {len(gains)} gain{'s' * (len(gains) > 1)}"
        seen += ", the LuGre's neighbour" if case.model == "lugre" else ""

        def result(verdict: str, by: str = seen) -> Result:
            return Result(case, verdict, seconds, gain, checked_by=by, reason=reason, notes=notes)

        if fold is not None and gain is not None and gain > fold.gain:
            return result(NONE if denies else REFUSED, "fold")
        if exists:
            at = next(k for k, s in zip(gains, scans, strict=True) if s[0])
            notes.append(f"a stable cycle of the Switch servo exists at gain {at:.6g}")
            # The LuGre servo need not have what its rigid neighbour has: that proves no denial wrong.
            return result(WRONG if denies and case.model == "switch" and "not certain" not in reason else REFUSED)
        sure = max(s[2] for s in scans) <= 0.2
        return result(NONE if sure and denies else REFUSED)


def finite_gain(servo: Servo) -> float:
    """A gain of the right size."""
    base = routh_hurwitz_gain(servo)
    return base if math.isfinite(base) else servo.inertia / (servo.motor_gain * servo.controller.integral_time**2)


def solved(limit: float, action: Callable[[], Any]) -> tuple[Any, float, str]:
    """(result or None, seconds, reason): everything but NoOrbit is a crash."""
    began = time.perf_counter()
    try:
        with within(limit):
            result = action()
        return result, time.perf_counter() - began, ""
    except NoOrbit as error:
        name = "" if error.status is None else f"{error.status.name}: "
        return None, time.perf_counter() - began, name + str(error)
    except TooSlow:
        return None, time.perf_counter() - began, f"TIME: no answer within {limit:.0f} s"
    except Exception as error:
        return None, time.perf_counter() - began, crash(error)


def crash(error: Exception) -> str:
    """What was raised, and where in this checkout."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(ROOT))]
    return f"crash: {type(error).__name__}: {error} ({Path(frames[-1].filename).name}:{frames[-1].lineno})"


def run_job(job: tuple[list[Case], bool]) -> list[Result]:
    """The cases of one servo and model."""
    cases, quick = job
    desk = Desk(quick)
    out = []
    for case in cases:
        try:
            out.append(desk.verdict(case))
        except Exception as error:
            out.append(Result(case, WRONG, reason=crash(error)))
    return out


def jobs_of(cases: list[Case], quick: bool) -> list[tuple[list[Case], bool]]:
    """Cases that share a servo and a model, together: they share its fold."""
    together: dict[tuple[Any, ...], list[Case]] = {}
    for case in cases:
        # Table 1 has many cases and a quick fold.
        key = (case.model, case.changes) if case.changes else (case.model, case.row, case.column)
        together.setdefault(key, []).append(case)
    jobs = [(group, quick) for group in together.values()]
    # Mixed, so that slow rows do not come together and a run that is cut short has seen something of all.
    return [jobs[k] for k in np.random.default_rng(0).permutation(len(jobs))]


# Beyond the grid: perturbed starts, same bits, memory, leaks.


def memory() -> float:
    """Resident memory [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def peak_memory() -> float:
    """Largest resident memory of this process so far [MB]."""
    status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) / 1024  # getrusage would report the parent's


def perturbed_starts(quick: bool) -> dict[str, Any]:
    """Every unknown of an orbit moved at random; what the solver then calls a solution must be that orbit."""
    rng, counts, wrong = np.random.default_rng(3), Counter[str](), []
    for model in MODELS:
        for branch in ("stable", "unstable"):
            orbit = find_orbit(Servo(), model, 0.3, branch=branch, options=Options(tol=1e-8))  # type: ignore[arg-type]
            t, u, setting = unknowns_of(orbit)
            for size in (1e-4, 1e-3, 1e-2, 1e-1):
                for solver in ("newton", "ipopt"):
                    for _ in range(1 if quick else 5):
                        start = u * np.exp(size * rng.standard_normal(u.size))
                        found = solve_adaptively(orbit.problem, (t, start, setting), Options(tol=1e-8), solver=solver)
                        if not found.status.ok:
                            counts[f"{size:g} refused"] += 1
                            continue
                        period = 2 * float(np.sum(found.t.durations_of(found.solution.u)))
                        same = abs(period / orbit.period - 1) <= 1e-7
                        counts[f"{size:g} {'same orbit' if same else 'another root'}"] += 1
                        if not same:
                            what = f"{model} {branch} {solver} {size:g}"
                            wrong.append(f"{what}: period {period:.10g}, not {orbit.period:.10g}")
    return {"counts": dict(sorted(counts.items())), "other": wrong}


def bits(rounds: int) -> list[str]:
    """Orbits and folds as exact texts, several times over."""
    out = []
    for model in MODELS * rounds:
        for branch in ("stable", "unstable"):
            orbit = find_orbit(Servo(), model, 0.3, branch=branch)  # type: ignore[arg-type]
            out += [orbit.amplitude.hex(), orbit.period.hex(), orbit.half_multiplier.hex()]
        out.append(find_fold(Servo(), model).gain.hex())  # type: ignore[arg-type]
    return out


def long_branch(job: tuple[str, int]) -> dict[str, Any]:
    """A branch of many points, all kept: points, time, memory."""
    model, points = job
    began, before = time.perf_counter(), memory()
    start = find_orbit(Servo(), model, 0.0321)  # type: ignore[arg-type]
    kept = []
    for orbit in walk(start, low=0.0321, high=10, largest_step=4.0 / points, max_points=points):
        kept.append(orbit)
        if len(kept) == points:
            break
    return {"model": model, "points": len(kept), "seconds": time.perf_counter() - began,
            "memory_before_MB": before, "peak_MB": peak_memory()}  # fmt: skip


def leak(job: tuple[str, int]) -> dict[str, Any]:
    """Many solves: memory after the first tenth, half and all of them.

    The same few gains again and again: transcriptions and compiled maps of new mesh sizes are kept for reuse, up to a
    number, which is no leak.
    """
    model, solves = job
    seen = []
    for k in range(solves):
        find_orbit(Servo(), model, 0.04 + 0.5 * (k % LEAK_GAINS * 0.618034 % 1))  # type: ignore[arg-type]
        if k + 1 in (solves // 10, solves // 2, solves):
            seen.append(memory())
    growth = 1024 * (seen[-1] - seen[-2]) / (solves - solves // 2)
    return {"model": model, "solves": solves, "memory_MB": seen, "growth_kB_per_solve": growth,
            "peak_MB": peak_memory()}  # fmt: skip


def extras(pool: ProcessPoolExecutor, quick: bool) -> tuple[dict[str, Any], list[str]]:
    """(facts, complaints).  Every task has a process of its own."""
    points, solves = (100, 100) if quick else (1000, 1000)
    branches = [pool.submit(long_branch, (model, points)) for model in MODELS]
    leaks = [pool.submit(leak, (model, solves)) for model in MODELS]
    starts, first, again = pool.submit(perturbed_starts, quick), pool.submit(bits, 2), pool.submit(bits, 1)
    facts: dict[str, Any] = {
        "branches": [b.result() for b in branches], "leaks": [x.result() for x in leaks],
        "perturbed_starts": starts.result(), "same_bits": first.result() == again.result() * 2,
    }  # fmt: skip
    complaints = [f"perturbed start: {text}" for text in facts["perturbed_starts"]["other"]]
    if not facts["same_bits"]:
        complaints.append("repeated solves differ in their bits")
    for known in facts["branches"] + facts["leaks"]:
        if known["peak_MB"] > MEMORY_LIMIT:
            complaints.append(f"{known['peak_MB']:.0f} MB of memory: {known}")
        if known.get("growth_kB_per_solve", 0) > LEAK_LIMIT and not quick:  # caches still fill
            complaints.append(f"a leak: {known}")
    return facts, complaints


# Output.

LOOK = {SOLVED: ("#2a7f62", "o"), NONE: ("#8fb3d9", "D"), REFUSED: ("#e0a030", "^"), UNCHECKED: ("#808080", "s"),
        WRONG: ("#b3202c", "X")}  # fmt: skip
WIDTH = 7


def picture(results: list[Result], path: Path) -> None:
    """Rows: what was varied and what was asked for; columns: the extremes; colour and symbol: the verdict."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    models = [model for model in MODELS if any(r.case.model == model for r in results)]
    lines: dict[str, list[tuple[str, list[Result]]]] = {}
    counts = Counter((r.case.model, r.case.row) for r in results)
    for model in models:
        rows: dict[tuple[str, str], list[Result]] = {}
        for r in results:
            if r.case.model == model:
                few = counts[model, r.case.row] <= WIDTH
                rows.setdefault((r.case.row, "" if few else f": {r.case.what}"), []).append(r)
        lines[model] = [
            (row + what, found[i : i + WIDTH])
            for (row, what), found in rows.items()
            for i in range(0, len(found), WIDTH)
        ]
    longest = max(len(x) for x in lines.values())
    figure = Figure(figsize=(8.5 * len(models), 1.6 + 0.45 * longest), layout="constrained")
    FigureCanvasAgg(figure)
    for axes, model in zip(figure.subplots(1, len(models), squeeze=False)[0], models, strict=True):
        for y, (_, found) in enumerate(lines[model]):
            for x, r in enumerate(found):
                colour, symbol = LOOK[r.verdict]
                axes.plot(x, y, symbol, color=colour, markersize=9 if r.verdict == WRONG else 7)
                asked = f"\n{r.case.what}" if counts[model, r.case.row] <= WIDTH else ""
                axes.text(x, y + 0.22, r.case.column + asked, ha="center", va="top", fontsize=6)
        axes.set_yticks(range(len(lines[model])), [name for name, _ in lines[model]], fontsize=8)
        axes.set_xticks([])
        axes.set_xlim(-0.6, WIDTH - 0.4)
        axes.set_ylim(longest - 0.2, -0.7)
        axes.set_title(model)
        for side in ("top", "right", "bottom"):
            axes.spines[side].set_visible(False)
    handles = [Line2D([], [], color=c, marker=m, linestyle="", label=name) for name, (c, m) in LOOK.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.savefig(path, dpi=110)


def flat(r: Result) -> dict[str, Any]:
    """One row of the table."""
    case = asdict(r.case)
    case["changes"] = " ".join(f"{key}={value!r}" for key, value in r.case.changes)
    rest = {key: value for key, value in vars(r).items() if key not in ("case", "notes")}
    return case | rest | {"notes": "; ".join(r.notes), "command": r.case.command}


def summary(results: list[Result]) -> tuple[dict[str, Any], list[str]]:
    """(numbers, lines)."""
    numbers: dict[str, Any] = {}
    titles = "".join(f" {verdict:>9s}" for verdict in LOOK)
    lines = [f"{'':10s} {'cases':>6s}{titles}  solved where a cycle exists"]
    names = [*MODELS, "fold", "stable", "unstable", "all"]
    for name in names:
        part = [r for r in results if name in (r.case.model, r.case.what, "all")]
        count = Counter(r.verdict for r in part)
        exist = len(part) - count[NONE]
        share = 100 * count[SOLVED] / exist if exist else math.nan
        numbers[name] = {"cases": len(part), **{v: count[v] for v in LOOK}, "solved_percent": share}
        counts = "".join(f" {count[verdict]:9d}" for verdict in LOOK)
        lines.append(f"{name:10s} {len(part):6d}{counts}  {share:.1f} %")
    for r in results:
        if r.verdict in (REFUSED, UNCHECKED, WRONG):
            gain = f" --gain {r.gain!r}" if r.gain is not None and r.case.what != "fold" else ""
            lines.append(f"{r.verdict.upper()} [{r.case.row} {r.case.column}] {r.case.command}{gain}")
            lines.append(f"    {r.seconds:.1f} s: {r.reason[:400]} {'; '.join(r.notes)[:300]}".rstrip())
    slowest = sorted(results, key=lambda r: -r.seconds)[:3]
    lines.append("slowest: " + "; ".join(f"{r.case.row} {r.case.column} {r.case.model} {r.case.what} {r.seconds:.1f} s"
                                         for r in slowest))  # fmt: skip
    return numbers, lines


def main(arguments: list[str] | None = None) -> int:
    """Run, judge, write, print; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="stress", metavar="DIR", help="folder to write into (default stress)")
    parser.add_argument("--quick", action="store_true", help="the ends of each row, one question each")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--rows", nargs="+", metavar="WORD", help="only rows whose name starts so")
    parser.add_argument("--limit", type=int, metavar="N", help="only the first N cases")
    parser.add_argument("--minutes", type=float, metavar="M", help="begin no more cases of the grid after this time")
    parser.add_argument("--no-extras", action="store_true", help="the grid alone")
    options = parser.parse_args(arguments)
    began = time.perf_counter()
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    cases = grid(options.quick)
    if options.rows:
        cases = [c for c in cases if c.row.startswith(tuple(options.rows))]
    cases = cases[: options.limit]
    if not cases:
        parser.error("no such rows")
    jobs = jobs_of(cases, options.quick)
    results: list[Result] = []
    if options.jobs <= 1:
        batches: Any = map(run_job, jobs)
        results = [r for batch in batches for r in batch]
    else:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(options.jobs, mp_context=context, initializer=end_with_parent) as pool:
            waiting = [pool.submit(run_job, job) for job in jobs]
            for number, future in enumerate(waiting, 1):
                if options.minutes and time.perf_counter() - began > 60 * options.minutes and future.cancel():
                    continue
                batch = future.result()
                results += batch
                last = batch[-1]
                found = ", ".join(r.verdict for r in batch)
                print(f"{number}/{len(jobs)} {last.case.model} {last.case.row} {last.case.column}: {found}",
                      file=sys.stderr, flush=True)  # fmt: skip
    facts, complaints = {}, []
    if not options.no_extras:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(
            max(options.jobs, 1), mp_context=context, initializer=end_with_parent, max_tasks_per_child=1
        ) as pool:
            facts, complaints = extras(pool, options.quick)
    place = {case: number for number, case in enumerate(cases)}
    results.sort(key=lambda r: place[r.case])
    numbers, lines = summary(results)
    seconds = time.perf_counter() - began
    whole = {"seconds": seconds, "summary": numbers, "extras": facts, "complaints": complaints,
             "cases": [flat(r) for r in results]}  # fmt: skip
    (out / "stress.json").write_text(json.dumps(whole, indent=1) + "\n")
    with (out / "stress.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(flat(results[0])))
        writer.writeheader()
        writer.writerows(flat(r) for r in results)
    picture(results, out / "stress.png")
    print("\n".join(lines))
    for known in facts.get("branches", []) + facts.get("leaks", []):
        print(known)
    if facts:
        print(f"perturbed starts: {facts['perturbed_starts']['counts']}; same bits: {facts['same_bits']}")
    for text in complaints:
        print(f"WRONG {text}")
    missing = f", {len(cases) - len(results)} not run" if len(results) < len(cases) else ""
    print(f"{len(results)} cases in {seconds:.0f} s{missing}")
    return int(bool(complaints) or numbers["all"][WRONG] > 0)


if __name__ == "__main__":
    sys.exit(main())
