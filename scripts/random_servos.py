"""Random servos against an engine of another kind with more digits: no false denial, no error estimate too small.

    python scripts/random_servos.py [--model switch|lugre] [--servos N] [--seed S] [--only I ...] [--tol T ...]
                                    [--out FILE.jsonl] [--jobs N] [--quick]

Each servo is drawn log-uniformly from

    static friction 0.1 to 5 N m, static/coulomb 1.02 to 2.5, Stribeck velocity 0.002 to 0.2 rad/s, viscous friction 0
    (every fifth) or 1e-3 to 1 N m s/rad, inertia 0.003 to 0.3 kg m2, motor gain 1 to 50 N m/V, both times 0.02 to 1 s

and asked, for every tolerance, for its fold and for the stable and the unstable cycle at 0.05, 0.5, 0.95, 0.995 and
0.999 of it.  The fold gain that places the questions is the engine's own where it finds one.

Truth.  Switch: the event map P(a) by Taylor series in decimal arithmetic (scripts/peers/switch_digits.py): its fixed
point next to the answer, to some thirty digits; with heyoka (extra `bench`) and multipliers below 1e7 in extended
precision (switch_long.py), a hundred times faster.  Where the answer is a refusal the engine looks for the cycle
itself: it follows the place of the largest P(a)/a from the fold down to the gain; P(a) > a there is a cycle beyond a,
whose fixed points on either side are then computed.
LuGre: half a cycle by Taylor series with events in extended, where needed in quadruple precision
(scripts/peers/lugre_digits.py, needs heyoka), closed by Newton next to the answer.  The fold's gain is the one at which
a cycle passes the set point with the speed of the answer, its amplitude and period are taken there.  A refused cycle is
sought by following its branch from the next gain at which the program found one; where there is none, a refusal proves
nothing.

Verdicts, error and estimate relative, of period and amplitude (folds: and gain), the larger of them:

    solved         with the true error at most 10 estimates and 10 tolerances, and the multiplier on the asked side of 1
    wrong          not so
    none           "there is none", and the engine finds none
    false denial   "there is none" (NoOrbit without a status), and the engine finds it
    refused        "not found", whether or not the engine finds it
    unchecked      answered, and the engine finds no fixed point next to the answer, or one that differs by no more than
                   the engine's own rounding; listed

The file holds one line of JSON per servo; a run adds the servos that it does not hold yet.  Prints a table over
all of them; exit code 1 if anything is wrong, falsely denied or unchecked.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Options, Servo, find_fold, find_orbit  # noqa: E402
from casahunt.interrupts import end_with_parent  # noqa: E402
from casahunt.servo.linear_loop import routh_hurwitz_gain  # noqa: E402
from scripts.peers import lugre_digits  # noqa: E402
from scripts.peers import switch_digits as digits  # noqa: E402
from scripts.peers.switch_long import STEEPEST, LongMap  # noqa: E402
from scripts.stress import TooSlow, within  # noqa: E402

HEYOKA = importlib.util.find_spec("heyoka") is not None
ROUGH: type[digits.SwitchMap] = LongMap if HEYOKA else digits.SwitchMap
"""The Switch engine for searches, and for cycles with multipliers up to STEEPEST."""
SHARES = (0.05, 0.5, 0.95, 0.995, 0.999)
BRANCHES = ("stable", "unstable")
HONEST = 10.0
BLURRED = 0.1
"""Rounding of the LuGre engine, in units of the error estimate to be judged, that more digits are taken for."""
TIME_LIMIT, ENGINE_LIMIT = 60.0, 300.0
"""Processor time [s] of one answer, beyond which it counts as refused; of one of the engine's, which then has none."""
RANGES: dict[str, tuple[float, float]] = {
    "friction.static": (0.1, 5.0),
    "friction.coulomb": (1.02, 2.5),  # static over coulomb
    "friction.stribeck_velocity": (0.002, 0.2),
    "friction.viscous": (1e-3, 1.0),
    "servo.inertia": (0.003, 0.3),
    "servo.motor_gain": (1.0, 50.0),
    "controller.integral_time": (0.02, 1.0),
    "controller.lead_time": (0.02, 1.0),
}
WITHOUT_VISCOUS = 0.2
"""Part of the servos without viscous friction."""
ROUGH_DIGITS = 18
"""For the search of cycles that the program denies."""
NARROW_FOLD = 1e3
"""Half multiplier at a located fold, where it should be 1, that tells of a fold too narrow for a quick engine."""
SMALLEST, LARGEST = Decimal("1e-5"), Decimal("1e3")
"""Amplitudes up to which it looks, in units of the place of the largest P(a)/a."""
NARROW = Decimal("1e-3")
"""Relative width of a bracket from which Newton takes over."""
WAY_DOWN = (0.9999, 0.9995, 0.999, 0.997, 0.995, 0.98, 0.95, 0.88, 0.75, 0.6, 0.5, 0.35, 0.24, 0.16, 0.11, 0.075, 0.05)
"""Shares of the fold gain at which the engine's own search halts on its way to lower gains."""


def draw(seed: int, number: int) -> dict[str, float]:
    """The parameters of servo `number`: the same whatever else is drawn."""
    rng = np.random.default_rng([seed, number])
    out = {key: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for key, (low, high) in RANGES.items()}
    out["friction.coulomb"] = out["friction.static"] / out["friction.coulomb"]
    if rng.random() < WITHOUT_VISCOUS:
        out["friction.viscous"] = 0.0
    return out


def command(parameters: dict[str, float], row: dict[str, Any]) -> str:
    """The line that reproduces an answer."""
    sets = "".join(f" --set {key}={value!r}" for key, value in parameters.items())
    verb = "fold" if row["branch"] == "fold" else f"orbit --gain {row['gain']!r} --branch {row['branch']}"
    return f"casahunt {verb} --model {row['model']} --tol {row['tol']:g}{sets}"


# What the program says.


def answer(model: str, servo: Servo, gain: float | None, branch: str, tol: float) -> tuple[Any, str, bool, float]:
    """(answer or None, reason, whether the reason denies that there is one, seconds of processor time)."""
    began = time.process_time()
    found, reason, denies = None, "", False
    try:
        with within(TIME_LIMIT):
            options = Options(tol=tol)
            if branch == "fold":
                found = find_fold(servo, model, options=options)  # type: ignore[arg-type]
            else:
                found = find_orbit(servo, model, gain, branch=branch, options=options)  # type: ignore[arg-type]
    except NoOrbit as error:
        reason, denies = str(error), error.status is None
    except TooSlow:
        reason = f"no answer within {TIME_LIMIT:g} s"
    return found, reason, denies, time.process_time() - began


# What the engine says, for the Switch servo.


class SwitchTruth:
    """Folds and cycles of one Switch servo by its event map in decimal arithmetic; each is computed once."""

    patient = True
    """Whether multipliers above STEEPEST, for which decimal arithmetic takes minutes, are checked with it."""

    def __init__(self, servo: Servo) -> None:
        self.servo = servo
        self.top: digits.Truth | None = None
        self.places: dict[float, Decimal] = {}

    def fold(self, found: Any) -> digits.Truth | None:
        """The fold next to the program's; where that has none, one of the engine's own search."""
        if found is not None and not self.patient and abs(found.orbit.half_multiplier) > NARROW_FOLD:
            return None
        if found is not None:
            try:
                self.top = digits.fold(self.servo, found.gain, abs(float(found.orbit.arcs[-1].end[0])))
            except (digits.Lost, ArithmeticError):
                self.top = None
        return self.top

    def hunts_somewhere(self) -> tuple[float, float] | None:
        """(gain, a) with P(a) > a and P < a beyond, of the highest gain on a coarse grid; None if there is none."""
        base = routh_hurwitz_gain(self.servo)
        if not math.isfinite(base) or base <= 0:
            base = self.servo.inertia / (self.servo.motor_gain * self.servo.controller.integral_time**2)
        for gain in base * 2.0 ** np.arange(8, -9, -1):
            unit = self.servo.friction.static / self.servo.torque_gains(gain)[0]
            outside = False
            for a in unit * np.geomspace(20, 1e-4, 40):
                ratio = self._ratio(gain, Decimal(float(a)))
                outside = outside or ratio < 1
                if outside and ratio > 1:
                    return float(gain), float(a)
        return None

    def _ratio(self, gain: float, a: Decimal) -> Decimal:
        """P(a)/a; 1 where the motion does not get to a stick, which says neither."""
        try:
            return ROUGH(self.servo, gain, ROUGH_DIGITS).half(a).position / a
        except (digits.Lost, ArithmeticError):
            return Decimal(1)

    def next_to(self, found: Any) -> digits.Truth | None:
        """The fixed point next to an orbit of the program."""
        try:
            place = abs(float(found.arcs[-1].end[0]))
            if HEYOKA and abs(found.half_multiplier) < STEEPEST:
                return LongMap(self.servo, found.gain).cycle(place, error=max(found.error_estimate, 1e-13))
            if not self.patient:
                return None
            # A multiplier of 1e18 takes 18 digits of the place for the first one of P(a).
            more = max(0, math.ceil(math.log10(max(abs(found.half_multiplier), 1.0))))
            the_map = digits.SwitchMap(self.servo, found.gain, digits.DIGITS + more)
            return the_map.cycle(place, error=max(found.error_estimate, 1e-15))
        except (digits.Lost, ArithmeticError):
            return None

    def own(self, gain: float, branch: str) -> digits.Truth | None:
        """The cycle found without the program's help: from the largest P(a)/a outwards; None where it is not met."""
        place = self._largest(gain)
        if place is None or self._ratio(gain, place) <= 1:
            return None
        # Away from the fold the two cycles lie to either side of the place; steps that grow.
        up = 1 if branch == "stable" else -1
        inside, step = place, Decimal("1e-6")
        while SMALLEST < inside / place < LARGEST:
            outside = inside * (1 + step) ** up
            if self._ratio(gain, outside) < 1:
                break
            inside, step = outside, min(step * 3, Decimal("0.4"))
        else:
            return None
        while abs(outside / inside - 1) > NARROW:
            middle = (inside * outside).sqrt()
            if self._ratio(gain, middle) < 1:
                outside = middle
            else:
                inside = middle
        try:
            return ROUGH(self.servo, gain).cycle((inside * outside).sqrt(), error=float(NARROW) / 6)
        except (digits.Lost, ArithmeticError):
            return None

    def _largest(self, gain: float) -> Decimal | None:
        """The place of the largest P(a)/a at a gain, followed from the fold."""
        if self.top is None:
            return None
        share = gain / float(self.top.gain)
        if share >= 1:
            return None
        place = self.top.a
        for halt in (*[s for s in WAY_DOWN if s > share], share):
            if halt not in self.places:
                self.places[halt] = self._climb(float(self.top.gain) * halt, place)
            place = self.places[halt]
        return place

    def _climb(self, gain: float, a: Decimal) -> Decimal:
        """The nearby maximum of P(a)/a, by the sign of its slope: a P' - P."""
        the_map = ROUGH(self.servo, gain, ROUGH_DIGITS)

        def rises(a: Decimal) -> bool:
            half = the_map.half(a)
            return a * half.slope > half.position

        try:
            up = rises(a)
            step, last = Decimal("1e-5"), a
            for _ in range(60):
                if self._ratio(gain, a) > 1:
                    return a  # anywhere above 1 will do
                a = last * (1 + step) ** (1 if up else -1)
                if rises(a) != up:
                    break
                last, step = a, step * Decimal("1.6")
            low, high = min(a, last), max(a, last)
            for _ in range(40):
                middle = (low * high).sqrt()
                if self._ratio(gain, middle) > 1:
                    return middle
                low, high = (middle, high) if rises(middle) else (low, middle)
            return (low * high).sqrt()
        except (digits.Lost, ArithmeticError):
            return a


# And for the LuGre servo.


class LugreTruth:
    """Folds and cycles of one LuGre servo by Taylor series in extended precision."""

    def __init__(self, servo: Servo) -> None:
        self.servo = servo
        self.patient = True
        self.top: digits.Truth | None = None
        self.seen: list[tuple[float, str, Any, float]] = []

    def fold(self, found: Any) -> digits.Truth | None:
        """The fold next to the program's."""
        if found is not None:
            orbit = found.orbit
            try:
                self.top = lugre_digits.fold(self.servo, found.gain, orbit.arcs[0].states[0, 0][1:], orbit.period / 2)
            except (digits.Lost, np.linalg.LinAlgError):
                self.top = None
        return self.top

    def hunts_somewhere(self) -> Any:
        """What the Switch servo with the same curve does: LuGre's neighbour, no proof."""
        return SwitchTruth(self.servo).hunts_somewhere()

    def next_to(self, found: Any) -> digits.Truth | None:
        """The cycle next to an orbit of the program; in quadruple precision where rounding would blur the judgement."""
        start = found.arcs[0].states[0, 0][1:]
        truth = None
        for precision in (lugre_digits.EXTENDED, lugre_digits.quadruple()):
            with suppress(digits.Lost, np.linalg.LinAlgError):
                truth, y = lugre_digits.cycle(self.servo, found.gain, start, found.period / 2, precision)
            if truth is not None and truth.noise <= BLURRED * found.error_estimate:
                break
        if truth is None:
            return None
        self.seen.append((found.gain, "unstable" if truth.mu > 1 else "stable", y, found.period / 2))
        return truth

    def own(self, gain: float, branch: str) -> digits.Truth | None:
        """The cycle followed by the engine itself from the next gain at which it knows one; None where it is lost."""
        known = [s for s in self.seen if s[1] == branch]
        if not known:
            return None
        at, _, y, half_period = min(known, key=lambda s: abs(math.log(s[0] / gain)))
        factor, truth = 1.02, None
        while at != gain:
            target = min(gain, at * factor) if gain > at else max(gain, at / factor)
            try:
                truth, y = lugre_digits.cycle(self.servo, target, y, half_period)
                at, half_period, factor = target, float(truth.period) / 2, 1 + 1.5 * (factor - 1)
            except (digits.Lost, np.linalg.LinAlgError):
                factor = 1 + 0.3 * (factor - 1)
                if factor < 1 + 1e-6:
                    return None
        if truth is not None and (truth.mu > 1) == (branch == "unstable"):
            return truth
        return None


ENGINES = {"switch": SwitchTruth, "lugre": LugreTruth}


# Verdicts.


def off(value: float, truth: Decimal) -> float:
    """Relative error, computed with all digits."""
    return abs(float(Decimal(value) / truth - 1))


def judge(row: dict[str, Any], found: Any, truth: Any, reason: str, denies: bool) -> dict[str, Any]:
    """The row with its verdict."""
    row["reason"] = reason
    if found is None:
        row["exists"] = truth is not None
        row["verdict"] = ("false denial" if truth is not None else "none") if denies else "refused"
        return row
    orbit = found.orbit if row["branch"] == "fold" else found
    row |= {"estimate": found.error_estimate, "amplitude": orbit.amplitude, "period": orbit.period,
            "mu": orbit.half_multiplier}  # fmt: skip
    if truth is None:
        return row | {"verdict": "unchecked"}
    errors = [off(orbit.amplitude, truth.amplitude), off(orbit.period, truth.period)]
    if row["branch"] == "fold":
        errors.append(off(found.gain, truth.gain))
    mu = float(truth.mu)
    row |= {"true": max(errors), "true_mu": mu, "ratio": max(errors) / found.error_estimate,
            "mu_error": abs(orbit.half_multiplier / mu - 1)}  # fmt: skip
    fine = row["ratio"] <= HONEST and row["true"] <= HONEST * row["tol"]
    right_side = row["branch"] == "fold" or (mu > 1) == (row["branch"] == "unstable")
    noisy = right_side and row["true"] <= truth.noise
    return row | {"verdict": "solved" if fine and right_side else "unchecked" if noisy else "wrong"}


def patiently(question: Callable[..., Any], *arguments: Any) -> Any:
    """What the engine answers within its time limit; None beyond."""
    try:
        with within(ENGINE_LIMIT):
            return question(*arguments)
    except TooSlow:
        return None


def examine(model: str, seed: int, number: int, tolerances: Sequence[float], fast: bool = False) -> dict[str, Any]:
    """All questions about one servo."""
    parameters = draw(seed, number)
    servo = Servo().replace(**parameters)
    engine = ENGINES[model](servo)
    engine.patient = not fast
    rows: list[dict[str, Any]] = []
    top = None
    for tol in tolerances:
        found, reason, denies, seconds = answer(model, servo, None, "fold", tol)
        truth = patiently(engine.fold, found) if found is not None or engine.top is None else engine.top
        exists = truth if found is not None or truth is not None else patiently(engine.hunts_somewhere)
        row = {"model": model, "branch": "fold", "share": 1.0, "tol": tol, "seconds": seconds,
               "gain": found.gain if found is not None else None}  # fmt: skip
        rows.append(judge(row, found, exists, reason, denies))
        top = top or (float(truth.gain) if truth is not None else found.gain if found is not None else None)
    for share in SHARES if top else ():
        for branch in BRANCHES:
            gain = share * top
            answers = [answer(model, servo, gain, branch, tol) for tol in tolerances]
            truth = None
            # From the most accurate answer: where mu is 1e12 no other is near enough.
            for found, *_ in sorted(answers, key=lambda a: a[0].error_estimate if a[0] is not None else math.inf):
                truth = truth or (
                    patiently(engine.next_to, found) if found is not None else patiently(engine.own, gain, branch)
                )
            for tol, (found, reason, denies, seconds) in zip(tolerances, answers, strict=True):
                row = {"model": model, "branch": branch, "share": share, "tol": tol, "seconds": seconds, "gain": gain}
                rows.append(judge(row, found, truth, reason, denies))
    return {"model": model, "seed": seed, "number": number, "parameters": parameters, "rows": rows}


# The table.


def table(servos: list[dict[str, Any]]) -> str:
    """What was asked, what came of it, the worst ratios, and everything that is not solved."""
    verdicts = ("solved", "none", "refused", "false denial", "wrong", "unchecked")
    rows = [(s, row) for s in servos for row in s["rows"]]
    lines = [f"{'':>22}" + "".join(f"{v:>14}" for v in verdicts) + f"{'worst ratio':>14}{'worst mu':>10}{'slowest':>9}"]

    def line(name: str, chosen: list[dict[str, Any]]) -> str:
        count = Counter(row["verdict"] for row in chosen)
        ratio = max((row["ratio"] for row in chosen if "ratio" in row), default=math.nan)
        mu = max((row["mu_error"] for row in chosen if "mu_error" in row), default=math.nan)
        slowest = max((row["seconds"] for row in chosen), default=math.nan)
        return f"{name:>22}" + "".join(f"{count[v]:14d}" for v in verdicts) + f"{ratio:14.2f}{mu:10.1e}{slowest:8.1f}s"

    for branch, share in [("fold", 1.0), *((b, s) for b in BRANCHES for s in SHARES)]:
        chosen = [row for _, row in rows if row["branch"] == branch and row["share"] == share]
        lines.append(line("fold" if branch == "fold" else f"{branch} at {share:g}", chosen))
    for tol in sorted({row["tol"] for _, row in rows}):
        lines.append(line(f"all at tolerance {tol:g}", [row for _, row in rows if row["tol"] == tol]))
    lines += [line("all", [row for _, row in rows]), f"{len(servos)} servos"]
    for verdict in verdicts[1:]:
        chosen = [(s, row) for s, row in rows if row["verdict"] == verdict]
        if chosen:
            lines += ["", f"{verdict}:"]
        for s, row in chosen:
            what = f"ratio {row['ratio']:.3g}, mu {row['mu']:.6g} ({row['true_mu']:.6g})" if "ratio" in row else ""
            seen = {True: " [it exists]", False: " [the engine finds none]", None: ""}[row.get("exists")]
            where = f"#{s['number']} {row['branch']} at {row['share']:g}, tol {row['tol']:g}, {row['seconds']:.1f} s"
            lines += [f"  {where}{seen}: {what}{row['reason']}", f"      {command(s['parameters'], row)}"]
    worst = sorted((r for r in rows if "ratio" in r[1]), key=lambda r: -r[1]["ratio"])[:8]
    lines += ["", "largest true error in estimates:"]
    for s, row in worst:
        lines.append(f"  {row['ratio']:6.2f}  true {row['true']:.2e}  estimate {row['estimate']:.2e}  #{s['number']}  "
                     f"{command(s['parameters'], row)}")  # fmt: skip
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run, append, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", choices=sorted(ENGINES), default="switch")
    parser.add_argument("--servos", type=int, help="default 200 Switch, 60 LuGre; with --quick 5")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--only", type=int, nargs="+", help="numbers of the servos, instead of the first --servos")
    parser.add_argument("--tol", type=float, nargs="+", default=[1e-6, 1e-8])
    parser.add_argument("--out", type=Path, help="file to continue; default: nothing is kept")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument(
        "--fast", action="store_true",
        help="no decimal arithmetic: multipliers above 1e7 and folds narrower than doubles resolve stay unchecked",
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true")
    args = parser.parse_args(argv)
    count = args.servos or (5 if args.quick else {"switch": 200, "lugre": 60}[args.model])
    numbers = args.only or range(count)
    known: dict[int, dict[str, Any]] = {}
    if args.out and args.out.exists():
        for text in args.out.read_text().splitlines():
            s = json.loads(text)
            if s["model"] == args.model and s["seed"] == args.seed:
                known[s["number"]] = s
    jobs = [(args.model, args.seed, n, args.tol, args.fast) for n in numbers if n not in known]
    with ProcessPoolExecutor(args.jobs, initializer=end_with_parent) as pool:
        for s in pool.map(examine, *zip(*jobs, strict=True)) if jobs else ():
            known[s["number"]] = s
            said = Counter(row["verdict"] for row in s["rows"])
            print(f"#{s['number']}: " + ", ".join(f"{n} {v}" for v, n in said.items()), file=sys.stderr, flush=True)
            if args.out:
                with args.out.open("a") as file:
                    file.write(json.dumps(s) + "\n")
    servos = [known[n] for n in numbers if n in known]
    print(table(servos))
    return int(any(row["verdict"] in ("wrong", "false denial", "unchecked") for s in servos for row in s["rows"]))


if __name__ == "__main__":
    sys.exit(main())
