"""Cases solved, compared with the truth and judged; the cases of one servo and model share its fold."""

from __future__ import annotations

import math
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from casahunt import NoOrbit, Servo, find_fold, find_orbit
from casahunt.servo.gains import routh_hurwitz_gain
from scripts.extremes.cases import NONE, REFUSED, SOLVED, UNCHECKED, WRONG, Case, Result
from scripts.extremes.truth import Truth, second_solve, taylor_cycle, taylor_lugre, taylor_scan
from scripts.limits import TooSlow, within

ROOT = Path(__file__).resolve().parent.parent
HONEST = 10.0
"""True errors up to this many times the estimate, and the tolerance, are as announced."""
SOLVE_LIMIT = 120.0
"""Time for one solve [s], 20 s for the quick grid; beyond, the case counts as refused."""


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
                    self.limit,
                    lambda: find_orbit(servo, case.model, gain, branch=case.what, options=case.options),  # type: ignore[arg-type]
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
