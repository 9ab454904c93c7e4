"""Random servos against an engine of another kind with more digits: no false denial, no error estimate too small.

    python scripts/random_servos.py [--model switch|lugre] [--servos N] [--seed S] [--only I ...] [--tol T ...]
                                    [--controller times|pid] [--out FILE.jsonl] [--jobs N] [--quick] [--rows]

Each servo is drawn log-uniformly from

    static friction 0.1 to 5 N m, static/coulomb 1.02 to 2.5, Stribeck velocity 0.002 to 0.2 rad/s, viscous friction 0
    (every fifth) or 1e-3 to 1 N m s/rad, inertia 0.003 to 0.3 kg m2, motor gain 1 to 50 N m/V, both times 0.02 to 1 s
    (--controller times) or kp' 0.3 to 30, ki' 1 to 50 1/s, kd' 0.02 to 1 s (pid: complex zeros in every third)

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

With --rows the answers are not checked; what is printed is how often each row of each table of ways
(casahunt/servo/find_orbit.py) was tried and how often it had the answer, for all servos: one that has it less than once
in 1,000 questions is not worth its place.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from casahunt import NoOrbit, Options, Servo, find_fold, find_orbit  # noqa: E402
from casahunt.interrupts import end_with_parent  # noqa: E402
from scripts.limits import TooSlow, within  # noqa: E402
from scripts.peers.lugre_search import LugreTruth  # noqa: E402
from scripts.peers.switch_search import SwitchTruth  # noqa: E402

SHARES = (0.05, 0.5, 0.95, 0.995, 0.999)
BRANCHES = ("stable", "unstable")
HONEST = 10.0
TIME_LIMIT, ENGINE_LIMIT = 60.0, 300.0
"""Processor time [s] of one answer, beyond which it counts as refused; of one of the engine's, which then has none."""
RANGES: dict[str, tuple[float, float]] = {
    "friction.static": (0.1, 5.0),
    "friction.coulomb": (1.02, 2.5),  # static over coulomb
    "friction.stribeck_velocity": (0.002, 0.2),
    "friction.viscous": (1e-3, 1.0),
    "servo.inertia": (0.003, 0.3),
    "servo.motor_gain": (1.0, 50.0),
}
CONTROLLERS: dict[str, dict[str, tuple[float, float]]] = {
    "times": {"controller.integral_time": (0.02, 1.0), "controller.lead_time": (0.02, 1.0)},
    "pid": {"controller.kp": (0.3, 30.0), "controller.ki": (1.0, 50.0), "controller.kd": (0.02, 1.0)},
}
"""Ranges of the controller in either form."""
WITHOUT_VISCOUS = 0.2
"""Part of the servos without viscous friction."""


def draw(seed: int, number: int, form: str = "times") -> dict[str, float]:
    """The parameters of servo `number`: the same whatever else is drawn."""
    rng = np.random.default_rng([seed, number])
    ranges = RANGES | CONTROLLERS[form]
    out = {key: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for key, (low, high) in ranges.items()}
    out["friction.coulomb"] = out["friction.static"] / out["friction.coulomb"]
    if rng.random() < WITHOUT_VISCOUS:
        out["friction.viscous"] = 0.0
    return out


def command(parameters: dict[str, float], row: dict[str, Any]) -> str:
    """The line that reproduces an answer."""
    sets = "".join(f" --set {key}={value!r}" for key, value in parameters.items())
    verb = "fold" if row["branch"] == "fold" else f"orbit --gain {row['gain']!r} --branch {row['branch']}"
    return f"casahunt {verb} --model {row['model']} --tol {row['tol']:g}{sets}"


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


class Unchecked:
    """In the place of an engine where no truth is wanted."""

    top = None

    def __init__(self, servo: Servo) -> None: ...

    def none(self, *question: Any) -> None:
        """No answer."""

    fold = hunts_somewhere = next_to = own = none


ENGINES: dict[str, Any] = {"switch": SwitchTruth, "lugre": LugreTruth}


@cache
def watched() -> dict[str, list[int]]:
    """[times tried, times it had the answer] of every way of the tables of find_orbit, counted from now on."""
    counts: dict[str, list[int]] = {}

    def counting(way: Callable[..., Any], count: list[int]) -> Callable[..., Any]:
        def counted(question: Any) -> Any:
            try:
                answered = way(question)
            except NoOrbit as refusal:
                count[0] += 1
                count[1] += refusal.status is None  # that there is none is an answer
                raise
            count[0] += answered is not None
            count[1] += not (answered is None or isinstance(answered, str))
            return answered

        return counted

    ways = importlib.import_module("casahunt.servo.find_orbit")
    for table in ("STABLE", "UNSTABLE"):
        rows = [(name, way, counts.setdefault(f"{table}: {name}", [0, 0])) for name, way in getattr(ways, table)]
        setattr(ways, table, tuple((name, counting(way, count)) for name, way, count in rows))
    return counts


def rows_table(servos: list[dict[str, Any]]) -> str:
    """How often each row of a table of ways was tried, and how often it had the answer."""
    asked = sum(len(s["rows"]) for s in servos)
    lines = [f"{'':>80}{'tried':>8}{'answers':>9}{'per 1,000 questions':>22}"]
    for name in dict.fromkeys(name for s in servos for name in s["strategies"]):
        tried, answers = (sum(s["strategies"].get(name, (0, 0))[i] for s in servos) for i in (0, 1))
        lines.append(f"{name:>80}{tried:8d}{answers:9d}{1000 * answers / asked:22.1f}")
    return "\n".join([*lines, f"{asked} questions about {len(servos)} servos"])


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


def counted(*question: Any) -> dict[str, Any]:
    """`examine` without a truth, with what each row of a table of ways did."""
    ENGINES.update(dict.fromkeys(ENGINES, Unchecked))
    counts = watched()
    for count in counts.values():
        count[:] = 0, 0
    return examine(*question) | {"strategies": counts}


def examine(
    model: str, seed: int, number: int, tolerances: Sequence[float], fast: bool = False, form: str = "times"
) -> dict[str, Any]:
    """All questions about one servo."""
    parameters = draw(seed, number, form)
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
    asked = {"model": model, "seed": seed, "number": number, "controller": form}
    return asked | {"parameters": parameters, "rows": rows}


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
    parser.add_argument("--controller", choices=sorted(CONTROLLERS), default="times", help="form of the controller")
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
    parser.add_argument("--rows", action="store_true", help="count the strategies that have the answers; check none")
    args = parser.parse_args(argv)
    count = args.servos or (5 if args.quick else {"switch": 200, "lugre": 60}[args.model])
    numbers = args.only or range(count)
    known: dict[int, dict[str, Any]] = {}
    if args.out and args.out.exists():
        for text in args.out.read_text().splitlines():
            s = json.loads(text)
            form = s.get("controller", "times")
            if (s["model"], s["seed"], form) == (args.model, args.seed, args.controller):
                known[s["number"]] = s
    jobs = [(args.model, args.seed, n, args.tol, args.fast, args.controller) for n in numbers if n not in known]
    with ProcessPoolExecutor(args.jobs, initializer=end_with_parent) as pool:
        for s in pool.map(counted if args.rows else examine, *zip(*jobs, strict=True)) if jobs else ():
            known[s["number"]] = s
            said = Counter(row["verdict"] for row in s["rows"])
            print(f"#{s['number']}: " + ", ".join(f"{n} {v}" for v, n in said.items()), file=sys.stderr, flush=True)
            if args.out:
                with args.out.open("a") as file:
                    file.write(json.dumps(s) + "\n")
    servos = [known[n] for n in numbers if n in known]
    if args.rows:
        print(rows_table(servos))
        return 0
    print(table(servos))
    return int(any(row["verdict"] in ("wrong", "false denial", "unchecked") for s in servos for row in s["rows"]))


if __name__ == "__main__":
    sys.exit(main())
