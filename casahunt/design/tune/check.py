"""What supports a tuning, computed apart from the search.

* The folds of the nominal and of the worst servo once more from nothing; folds at corners and samples of the set,
  none of which may need a larger gain.
* The event map at the worst friction: from every stick position scanned the servo sticks nearer to the set point.  Then
  no cycle with sticking exists, lopsided ones included: along a cycle |x1| of the sticks cannot always fall.  A loop of
  parts has none: from 1 rad beside its set point, a half, a quarter, ... it comes to rest.
* The margins of the linear loops of corners and samples of the set, by the search for crossings of
  servo/linear/margins.py, or with a drive those of the loop as built.
* Simulated regulator tasks, each simulated until it is decided (tasks.py).

What speaks against the tuning, and what could not be verified, are kept apart.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ... import effort
from ...axis_units import quantity
from ...continuation import Vanishing
from ...errors import ComesToRest, NoOrbit
from ...results import Result
from ...servo.event_map.fixed_points import fixed_points
from ...servo.event_map.half_cycle import StickMap
from ...servo.event_map.scan import Scan, scan
from ...servo.find_orbit import find_orbit
from ...servo.friction import Model, pairs_of
from ...servo.linear.margins import Margins, margins
from ...servo.simulate import simulate
from ..ensemble import folds_of
from ..nearby import AnyFold, are_servos, fold_beside, said, servo_at
from ..uncertainty.set import Uncertainty
from .best_gain import Answer, Given
from .demands import DEMANDS, Demands, log_numbers, silent
from .tasks import SimulatedTask, gives_way_at, stated

Array = np.ndarray

PERIODS = 60.0
"""Length of the simulated tasks, to begin with, in periods of the cycle at the fold."""
SLACK = 1e-4
"""Relative miss of a margin that counts as kept: the margins are solved for to 1e-9, the gain lies on their edge."""
CORNERS = {"switch": 32, "lugre": 8, None: 32}
"""Corners of the set whose folds are computed, drawn where there are more: all of five parameters, or of three."""
SAMPLES = {"switch": 16, "lugre": 4, None: 16}
"""Servos inside of the set whose folds are computed as well: half as many."""
LOOP_SAMPLES = 200
"""The same of those whose loops are looked at, which cost nothing beside a fold."""
MOST_NAMED = 5
"""Servos without a fold that are named one by one: a page's worth."""
MOST_SCANS = 6
"""Servos without a computed fold that the event map is asked about."""
IRRELEVANT = {"switch": ("friction.stiffness", "friction.damping"), "lugre": (), None: ()}

Seen = Literal["clear", "cycle", "open"]


@dataclass(frozen=True, eq=False)
class SetCheck:
    """Folds at corners and samples of the set.

    Attributes
    ----------
    computed : how many.
    largest : the largest fold gain among them.
    above : (k,) parameter values of servos whose fold gain is above that of the worst servo.
    open : sentences about servos of which nothing is known.
    """

    computed: int
    largest: float
    above: tuple[Array, ...]
    open: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Verification(Result):
    """What supports a tuning.

    Attributes
    ----------
    fold, nominal_fold : of the worst and of the nominal servo, from nothing; None where the servo cannot hunt.
    margin : K/K_fold - 1 at the worst fold; inf without one.
    margin_kept : it is at least the margin asked for, to the tolerance, at every fold computed.
    scan_sentence, seen : the event map at the worst friction: clear, with a cycle or a growing motion, or open.
    loops : margins of the linear loops of the nominal servo, of the worst friction, and of the servos of the set that
        have the least of each demand.
    loop_corners : the uncertain parameters of the latter.
    loops_checked, loops_kept : loops looked at besides, and whether all are what was asked for.
    set_check : the folds of the set; None without one.
    tasks : simulated regulator tasks.
    span, amplitude : length [s] that the tasks begin with, and where the breakaway of the last one starts [rad].
    against : sentences that speak against the tuning.
    unverified : what could not be verified, in sentences.
    """

    _quantities = ("ok", "result", "margin", "margin_kept", "loops_kept", "against", "unverified")
    _details = (
        "fold_gain = fold.value [V/rad]", "fold_error = fold.value_error",
        "nominal_fold_gain = nominal_fold.value [V/rad]", "scan = scan_sentence", "scan_clear", "loops",
        "loops_checked", "loop_corners", "tasks",
    )  # fmt: skip

    fold: AnyFold | None
    nominal_fold: AnyFold | None
    margin: float
    margin_kept: bool
    scan_sentence: str
    seen: Seen
    loops: dict[str, Margins]
    loop_corners: dict[str, dict[str, float]]
    loops_checked: int
    loops_kept: bool
    set_check: SetCheck | None
    span: float
    amplitude: float
    tasks: tuple[SimulatedTask, ...]
    against: tuple[str, ...]
    unverified: tuple[str, ...]

    def _more(self) -> dict[str, Any]:
        folds = self.set_check
        return {"set": None if folds is None else {"folds": folds.computed, "largest_fold_gain": folds.largest}}

    @property
    def result(self) -> str:
        """One of "verified", "not everything verified", "speaks against it"."""
        return "speaks against it" if self.against else "verified" if self.ok else "not everything verified"

    @property
    def scan_clear(self) -> bool:
        """From every stick position scanned the servo sticks nearer to the set point, and nothing is left open."""
        return self.seen == "clear"

    @property
    def ok(self) -> bool:
        """Everything was verified, and nothing speaks against the tuning."""
        return not self.against and not self.unverified


def verified(answer: Answer, given: Given) -> Verification:
    """Everything of the module docstring, of the answer to what is given."""
    servo, worst, gain = answer.servo, answer.worst.servo, answer.gain
    model, demands, tell = given.model, given.demands, given.tell
    unverified: list[str] = []

    def again(of: Any) -> AnyFold | None:
        tell("verifying: the fold once more, from nothing")
        try:
            return fold_beside(of, model, None, options=given.options)
        except NoOrbit as error:
            unverified.append(f"the fold was not found again from nothing: {error}")
            return answer.worst.fold if of == worst else None

    nominal = again(servo)
    fold = nominal if worst == servo else again(worst)
    checked = None if given.uncertainty is None else _check_set(answer, given, given.uncertainty)
    largest = max([f.value if f is not None else 0.0 for f in (nominal, fold)] + ([checked.largest] if checked else []))
    margin = gain / largest - 1 if largest else math.inf
    kept = margin >= demands.margin - 10 * given.options.tol
    tell("verifying: the event map")
    sentence, seen = scanned(worst, model, gain, tell)
    loops, corners, number, missed = _loops(answer, given)
    swings = None if fold is None or isinstance(fold, Vanishing) else fold.orbit
    span = PERIODS * (5.0 if swings is None else swings.period)
    amplitude = gives_way_at(servo, gain) if swings is None else 2 * swings.amplitude
    tasks, missing = _simulated(answer, given, span, amplitude)
    unverified += missing
    against = [] if kept else [f"the gain is only {100 * margin:.4g} % above the largest fold gain, {largest:.8g}"]
    against += missed
    if seen == "cycle":
        against.append(f"the event map at the worst friction: {sentence}")
    against += [f"{t.friction} friction, {t.start}: {t.motion.verdict.kind}" for t in tasks if t.hunts]
    against += [
        f"{t.friction} friction, {t.start}: takes {t.motion.peak_torque:.6g} N m, more than {demands.max_torque:g}"
        for t in tasks if t.motion.peak_torque > demands.max_torque * (1 + SLACK)
    ]  # fmt: skip
    unverified += [f"the event map at the worst friction is not conclusive: {sentence}"] if seen == "open" else []
    unverified += checked.open if checked else ()
    unverified += [f"in the search for the worst friction: {failure}" for failure in answer.worst.failures]
    unverified += [
        f"{t.friction} friction, {t.start}: {t.motion.verdict.kind} after {t.motion.times[-1]:.4g} s "
        f"({t.motion.verdict.sentence if t.motion.status.ok else t.motion.status.advice})"
        for t in tasks
        if not t.decided and not t.hunts
    ]
    return Verification(
        fold, nominal, margin, kept, sentence, seen, loops, corners, number, not missed, checked, span, amplitude,
        tuple(tasks), tuple(against), tuple(unverified),
    )  # fmt: skip


def _simulated(answer: Answer, given: Given, span: float, amplitude: float) -> tuple[list[SimulatedTask], list[str]]:
    """(the tasks with the nominal and the worst friction, sentences about those that were not simulated)."""
    tasks: list[SimulatedTask] = []
    missing = []
    servos = {"nominal": answer.servo} | ({"worst": answer.worst.servo} if answer.worst.servo != answer.servo else {})
    for friction, servo in servos.items():
        given.tell(f"verifying: simulating the tasks with the {friction} friction")
        try:
            tasks += [
                SimulatedTask(friction, said, simulate(servo, given.model, answer.gain, time=span, **start))
                for said, start in stated(servo, answer.gain, amplitude, given.step).items()
            ]
        except NoOrbit as error:
            missing.append(f"the tasks with the {friction} friction were not simulated: {error}")
    return tasks, missing


# The set


def _points_of(box: tuple[Array, Array], corners: int, samples: int, varied: Array) -> Array:
    """(m, k) points of a box: its corners in the coordinates `varied`, drawn where there are more, then samples."""
    low, high = box
    random = np.random.default_rng(np.random.SeedSequence(1))
    middle = (low + high) / 2
    size = int(varied.sum())
    if 2**size <= corners:
        picks = np.array(list(itertools.product((False, True), repeat=size)), bool).reshape(2**size, size)
    else:
        picks = random.random((corners, size)) < 0.5
    rows = np.tile(middle, (len(picks), 1))
    rows[:, varied] = np.where(picks, high[varied], low[varied])
    return np.concatenate([rows, low + (high - low) * random.random((samples, low.size))])


def _check_set(answer: Answer, given: Given, uncertainty: Uncertainty) -> SetCheck:
    """Folds at corners and samples of the set, and what the event map says of servos without one."""
    model, options = given.model, given.options
    names, (low, high) = uncertainty.parameters, uncertainty.box(answer.servo)
    varied = np.array([name not in IRRELEVANT[model] for name in names]) & (high > low)
    servos, rows = [], []
    for q in _points_of((low, high), CORNERS[model], SAMPLES[model], varied):
        if are_servos(answer.servo, names, q[None])[0]:
            servos.append(servo_at(answer.servo, names, q))
            rows.append(q)
    began, tell = time.monotonic(), given.tell
    found = folds_of(
        answer.servo, model, names, np.array(rows), options=options, fold=answer.worst.fold,
        report=lambda i: tell(f"verifying: {i} of {len(rows)} folds of the set{effort.left(i, len(rows), began)}"),
    )  # fmt: skip
    gains, failures = found.gains, dict(found.failures)
    above = [q for q, k in zip(rows, gains, strict=True) if k > answer.worst.gain * (1 + 10 * options.tol)]
    pairs = pairs_of(answer.servo).items()  # of friction, some of which must be less once it slides
    falls = [any(servo.value(static) > servo.value(coulomb) for static, coulomb in pairs) for servo in servos]
    unknown = [i for i, k in enumerate(gains) if not k > 0 and falls[i]]
    left = []
    for n, i in enumerate(unknown):
        if n < MOST_SCANS and _no_cycle(servos[i], model, answer.gain / (1 + given.demands.margin)):
            continue
        if i in failures or n < MOST_SCANS:
            corner = said(dict(zip(names, rows[i], strict=True)))
            left.append(f"no fold was computed at {corner}: {failures.get(i, 'no cycle was found')}")
    if len(left) > MOST_NAMED:
        left = [*left[:MOST_NAMED], f"and {len(left) - MOST_NAMED} more servos of the set without a fold"]
    largest = float(np.nanmax(gains, initial=0.0))
    return SetCheck(int(np.isfinite(gains).sum()), largest, tuple(above), tuple(left))


def _no_cycle(servo: Any, model: Model | None, gain: float) -> bool:
    """The scan of the event map, or motions of a loop, find neither a cycle at this gain nor a motion that grows."""
    if model is None:
        return scanned(servo, model, gain)[1] == "clear"
    return _shown(scan(StickMap(model, servo, gain))) == "clear"


def _shown(found: Scan) -> Seen:
    return "cycle" if found.upper is not None or found.best >= 1 else "open" if found.failures else "clear"


def _loops(answer: Answer, given: Given) -> tuple[dict[str, Margins], dict[str, dict[str, float]], int, list[str]]:
    """(margins by what has them, their corners, loops looked at, sentences about those that miss a demand)."""
    servo, gain, demands, uncertainty = answer.servo, answer.gain, given.demands, given.uncertainty
    named = {"nominal": servo, "worst": answer.worst.servo}
    corners: dict[str, dict[str, float]] = {}
    others: list[Any] = []
    if uncertainty is not None:
        names, (low, high) = uncertainty.parameters, uncertainty.box(servo)
        of_loops = given.boxes(log_numbers(servo, given.numbers))[0].names
        for name in DEMANDS:
            least = answer.loops[name]
            values = least.values | {of_loops[-1]: least.kappa / gain}  # by a factor off the set's, perhaps
            corners[name] = {
                key: float(np.clip(values[key], low[i], high[i])) for i, key in enumerate(names) if key in values
            }
            named[name] = servo.replace(**corners[name])
        used = np.isin(names, of_loops)
        points = _points_of((low, high), CORNERS["switch"], LOOP_SAMPLES, used & (high > low))
        others = [servo_at(servo, np.array(names)[used].tolist(), q) for q in points[:, used]]
    loops = {name: _margins_of(each, gain, demands) for name, each in named.items()}
    missed = [
        f"the linear loop of the {'servo with the least ' if name in DEMANDS else ''}{name}"
        f"{' friction' if name == 'worst' else ''} misses the margins: {_margins_said(loop)}"
        for name, loop in loops.items()
        if not _keeps(loop, demands)
    ]
    for other in others:
        found = _margins_of(other, gain, demands)
        if not _keeps(found, demands):
            where = {key: other.value(key) for key in names if other.value(key) != servo.value(key)}
            missed.append(f"a linear loop of the set misses the margins: {_margins_said(found)} at {said(where)}")
            break
    return loops, corners, len(loops) + len(others), missed


def _margins_of(servo: Any, gain: float, demands: Demands) -> Margins:
    """Those of the loop as built, where there is a drive."""
    drive = demands.built
    return margins(servo, gain, delay=demands.delay if drive is None else 0.0, drive=drive)


def _keeps(loop: Margins, demands: Demands) -> bool:
    """Whether a loop has the margins asked for, to `SLACK`."""
    return (
        loop.stable
        and loop.phase_margin >= demands.phase_margin - math.degrees(SLACK)
        and loop.lowest_factor * demands.gain_margin <= 1 + SLACK
        and loop.highest_factor >= demands.gain_margin * (1 - SLACK)
    )


def _margins_said(loop: Margins) -> str:
    if not loop.stable:
        return f"unstable, phase margin {loop.phase_margin:.4g} degrees"
    return (
        f"phase margin {loop.phase_margin:.4g} degrees, stable from {loop.lowest_factor:.4g} to "
        f"{loop.highest_factor:.4g} times the gain"
    )


# The event map


def scanned(servo: Any, model: Model | None, gain: float, tell: Callable[[str], None] = silent) -> tuple[str, Seen]:
    """What the event map says of a servo, or motions from rest of a loop of parts.

    servo, model, gain: the problem; gain K > 0 [V/rad]; tell: takes sentences that say where the scan is.
    Returns A sentence, and what it shows: "clear", every motion sticks nearer to the set point; "cycle", a fixed point,
    or a motion that goes farther out; "open", a motion that does not come to stick, or a part of the range that was not
    resolved.
    """
    if model is None:
        try:
            orbit = find_orbit(servo, None, gain)
        except ComesToRest as rests:
            return str(rests).partition(": ")[2], "clear"
        except NoOrbit as other:
            return str(other), "open" if other.status is not None else "clear"
        return f"a cycle of {quantity(orbit.amplitude, 'rad', '.4g')} and {orbit.period:.4g} s was found", "cycle"
    if model == "switch":
        found = fixed_points(servo, gain, report=lambda n, a: tell(f"verifying: {n} motions of the event map"))
        grows = any(abs(point.position) >= point.start for point in found.points)
        falls = all(abs(point.position) < point.start for point in found.points)  # false for nan: it swings on
        state: Seen = "cycle" if found.fixed or grows else "clear" if found.conclusive and falls else "open"
        return found.sentence(), state
    seen = scan(StickMap(model, servo, gain))
    cycles = "no cycle" if seen.upper is None else f"a cycle at {seen.upper.start:.6g} rad"
    return (
        f"{cycles} of the event map between {seen.low:.4g} and {seen.high:.4g} rad: {seen.motions} motions, the "
        f"largest |P(a)|/a is {seen.best:.6g} at a = {seen.best_at:.6g} rad; {len(seen.failures)} motions failed",
        _shown(seen),
    )
