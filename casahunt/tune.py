"""The controller that costs least and does not hunt: gain, and controller times where they are free.

    minimise    c(K, tau_d, tau_i)     c = ln K, ln(K tau_d) (high-frequency gain), or -ln rho (settling)
    subject to  ln K >= ln(1 + margin) + ln K_b,     b = nominal servo, worst servo of the uncertainty set
                G_b = 0,  G_b,u^T nu_b = 0,  nu_b . G_b,lambda = 1,   K_b = K_b0 (1 + lambda_b)   the folds
                |L(j w_c)| = 1,    phi(w_c) >= phase margin                                      the linear loop
                |L(j w_l)| = f,    phi(w_l) >= 0                         stable down to the gain K/f
                |L(j w_h)| = 1/f,  phi(w_h) >= 0                         stable up to the gain f K
                bounds on K, tau_d, tau_i

One problem for IPOPT in (ln K, ln tau_d, ln tau_i), the logarithms of the crossovers, and u_b, lambda_b, nu_b of every
fold: fold_conditions.py, delayed_loop.py.  Jacobian and Hessian are exact.  rho [1/s] is the decay rate of the slowest
pole without delay; with b_2, b_1, b_0 the coefficients of chi(s - rho)/J, the settling cost adds the Routh-Hurwitz
conditions of the shifted polynomial, b_2 >= 0, b_1 >= 0, b_0 >= 0, b_2 b_1 >= b_0.  Settling time to two per cent:
ln(50)/rho.

The mesh of a fold is made for its servo, so the times move by at most `STEP` in their logarithms; then the folds are
solved again, on meshes of their own, and the next problem starts from there, until nothing moves.  The worst servo
of the uncertainty set is searched again at the result and joins the others where it is a new one.

Every constraint but the bounds may be broken at a price of `PRICE` per unit of its logarithm or radian.  Below the
price of breaking it no constraint is broken (exact penalty); what is broken at the end is in the way, and is named.

What the answer rests on besides: the folds solved once more from nothing at the result, a scan of the event map
there, and simulated regulator tasks.  None of that is a proof: a fold is the largest gain on the branch that is found,
the minimum and the worst servo are local ones, and the delay is in the linear loop only.

Source of the hunting condition: the fold ends hunting (report DCT 2001.021, section 5); symbols as in servo.py.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from .adapt import Options
from .checks import known, require, shown
from .delayed_loop import Margins, crossover, log_magnitude, margins, phase
from .errors import InputError, NoOrbit, Status
from .event_map import scan
from .fixed_points import fixed_points
from .fold import Fold, find_fold
from .fold_conditions import TIMES, data_of, fold_conditions
from .hunting import MODELS, Model
from .linear_loop import linear_loop
from .orbit import direction_of, unknowns_of
from .servo import Servo
from .simulate import simulate
from .solve import minimise
from .trajectory import Trajectory
from .uncertainty import Uncertainty, WorstCase, worst_corner

Array = np.ndarray

COSTS = {
    "gain": "gain K [V/rad]",
    "high-frequency": "high-frequency gain K tau_d [V s/rad]",
    "settling": "settling time of the linear loop to two per cent [s]",
}
FREE = ("lead_time", "integral_time")
BOUNDED = ("gain", *FREE)
WIDE = 2.0
"""Default bounds of a free time: this factor to both sides."""
GAINS = (1e-3, 10.0)
"""Default bounds of the gain, in units of (1 + margin) times the worst fold gain."""
STEP = 0.25
"""Largest change of ln tau between two meshes."""
SMALLEST_STEP = 1e-3
STILL = 1e-6
"""Change of ln tau at which the rounds end."""
ROUNDS, SEARCHES = 40, 4
"""Most problems, and most searches for the worst servo."""
PRICE = 1e3
BROKEN = 1e-7
"""A constraint broken by more than this is in the way; one kept with less than `TOUCHING` to spare is binding."""
TOUCHING = 1e-5
PERIODS = 60.0
"""Length of the simulated tasks in periods of the cycle at the fold."""
SAFE = 1e-12
"""The gain is rounded up by this part, so that rounding cannot put it below its bound."""


@dataclass(frozen=True, kw_only=True)
class Demands:
    """What the tuned servo must keep.

    Attributes
    ----------
    margin : K >= (1 + margin) K_fold; >= 0.
    phase_margin : [deg], 0 to 180.
    gain_margin : factor by which the gain may fall or rise and the linear loop stays stable; >= 1.
    delay, sample_time : of the loop [s]; >= 0.
    """

    margin: float = 0.1
    phase_margin: float = 30.0
    gain_margin: float = 2.0
    delay: float = 0.0
    sample_time: float = 0.0

    def __post_init__(self) -> None:
        require("margin", self.margin, at_least=0)
        require("phase-margin", self.phase_margin, at_least=0, at_most=180, unit="degrees")
        require("gain-margin", self.gain_margin, at_least=1)
        require("delay", self.delay, at_least=0, unit="s")
        require("sample-time", self.sample_time, at_least=0, unit="s")

    @property
    def lag(self) -> float:
        """D = delay + half a sample [s]."""
        return self.delay + self.sample_time / 2


@dataclass(frozen=True, eq=False)
class Task:
    """A simulated task.

    Attributes
    ----------
    friction : "nominal" or "worst".
    start : how it starts, in words.
    motion : the motion.
    """

    friction: str
    start: str
    motion: Trajectory

    @property
    def hunts(self) -> bool:
        """The motion ends in a cycle or grows."""
        return self.motion.verdict.kind in ("hunting", "growing")


@dataclass(frozen=True, eq=False)
class Verification:
    """What supports a tuning, computed apart from the optimisation.

    Attributes
    ----------
    fold, nominal_fold : of the worst and of the nominal servo, from nothing; None where the servo cannot hunt.
    margin : K/K_fold - 1 at the worst fold; inf without one.
    margin_kept : it is at least the margin asked for, to the tolerance.
    scan_sentence, scan_clear : the event map at the worst friction: from every stick position scanned the servo sticks
        nearer to the set point, and nothing is left unresolved.
    loops : margins of the linear loops of the nominal and the worst servo.
    loops_kept : they are what was asked for.
    span, amplitude : length [s] of the simulated tasks, and where the breakaway of the last one starts [rad].
    tasks : simulated regulator tasks.
    """

    fold: Fold | None
    nominal_fold: Fold | None
    margin: float
    margin_kept: bool
    scan_sentence: str
    scan_clear: bool
    loops: dict[str, Margins]
    loops_kept: bool
    span: float
    amplitude: float
    tasks: tuple[Task, ...]

    @property
    def ok(self) -> bool:
        """Nothing speaks against the tuning."""
        return self.margin_kept and self.scan_clear and self.loops_kept and not any(t.hunts for t in self.tasks)


@dataclass(frozen=True, eq=False)
class Tuning:
    """A tuned servo.

    Attributes
    ----------
    model, before : the problem: friction model and the servo given.
    servo : the servo with the controller times of the answer.
    gain : K [V/rad].
    cost, cost_value : name of the cost, and its value in the unit of `COSTS`.
    gain_only : the cost with the times as given; None where that cannot be met, or where nothing was freed.
    demands, free, bounds : as asked for; bounds of gain and free times.
    worst : the worst servo of the uncertainty set; the nominal one without a set.
    corner : values of the uncertain parameters there.
    uncertainty : the set, or None.
    fold_gain : largest fold gain, at the worst servo; 0 where it cannot hunt.
    binding : what keeps the cost from being less, in words.
    verification : see there.
    rounds, evaluations : problems solved, folds computed by the searches for the worst servo.
    wall_s : time taken [s].
    """

    model: Model
    before: Servo
    servo: Servo
    gain: float
    cost: str
    cost_value: float
    gain_only: float | None
    demands: Demands
    free: tuple[str, ...]
    bounds: dict[str, tuple[float, float]]
    worst: Servo
    corner: dict[str, float]
    uncertainty: Uncertainty | None
    fold_gain: float
    binding: tuple[str, ...]
    verification: Verification
    rounds: int
    evaluations: int
    wall_s: float

    @property
    def status(self) -> Status:
        """CONVERGED where the verification has nothing against it."""
        return Status.CONVERGED if self.verification.ok else Status.NOT_CONVERGED


def check_bounds(
    servo: Servo, free: Sequence[str], bounds: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """The bounds of the free times, and of the gain where given, all checked.

    Raises
    ------
    InputError : an unknown name, a bound that is no bound, or one that leaves the servo's own time out.
    """
    for name in free:
        known("free", name, FREE)
    found: dict[str, tuple[float, float]] = {}
    for name, (low, high) in bounds.items():
        known("bounds", name, BOUNDED)
        require(f"bounds {name}", low, above=0)
        require(f"bounds {name}", high, above=0)
        if not low < high:
            raise InputError(f"bounds {name} = {shown(low)},{shown(high)}: the first must be less than the second")
        if name != "gain" and name not in free:
            pair = f"{shown(low)},{shown(high)}"
            raise InputError(f"bounds {name} = {pair}: must be left out unless --free {name} is given")
        found[name] = (float(low), float(high))
    for name in free:
        value = getattr(servo.controller, name)
        if value <= 0:
            raise InputError(f"free {name}: controller.{name} = {shown(value)} must be greater than 0 to be tuned")
        low, high = found.setdefault(name, (value / WIDE, value * WIDE))
        if not low <= value <= high:
            raise InputError(
                f"bounds {name} = {shown(low)},{shown(high)}: must contain the servo's own value {shown(value)}, "
                "where the search starts"
            )
    return found


def tune(
    servo: Servo,
    model: Model,
    *,
    demands: Demands | None = None,
    uncertainty: Uncertainty | None = None,
    free: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    cost: str = "gain",
    options: Options | None = None,
) -> Tuning:
    """The controller of least cost that does not hunt.

    Parameters
    ----------
    servo, model
        the problem; the controller times are where the search starts.
    demands
        margins, delay and sample time.
    uncertainty
        a set of servos, each of which must not hunt; default: this servo alone.
    free
        controller times to be tuned besides the gain: "lead_time", "integral_time".
    bounds
        (low, high) of "gain" and of free times; a free time may double or halve by default.
    cost
        one of `COSTS`.
    options
        tolerance of every fold.

    Raises
    ------
    InputError : a value out of range, or an unknown name.
    NoOrbit : the task cannot be met, and what is in the way; or a fold was not computed.
    """
    began = time.perf_counter()
    known("model", model, MODELS)
    known("cost", cost, COSTS)
    demands, options = demands or Demands(), options or Options()
    free = tuple(dict.fromkeys(free))
    limits = check_bounds(servo, free, bounds or {})
    if servo.controller.lead_time <= 0:
        raise InputError("controller.lead_time = 0: must be greater than 0 to tune (there is no phase margin)")
    _check_set(servo, uncertainty, free)
    search = _Search(servo, model, demands, uncertainty, free, limits, cost, options)
    answer = search.run()
    gain, tuned, worst = answer.gain, answer.servo, answer.worst
    verification = _verified(tuned, worst.servo, model, gain, demands, worst.fold, options)
    return Tuning(
        model=model,
        before=servo,
        servo=tuned,
        gain=gain,
        cost=cost,
        cost_value=_cost(cost, tuned, gain),
        gain_only=search.gain_only,
        demands=demands,
        free=free,
        bounds=search.limits,
        worst=worst.servo,
        corner=worst.corner,
        uncertainty=uncertainty,
        fold_gain=worst.gain,
        binding=answer.binding,
        verification=verification,
        rounds=search.rounds,
        evaluations=search.evaluations,
        wall_s=time.perf_counter() - began,
    )


def _check_set(servo: Servo, uncertainty: Uncertainty | None, free: Sequence[str]) -> None:
    for name in uncertainty.parameters if uncertainty is not None else ():
        if name.removeprefix("controller.") in free:
            raise InputError(f"free {name.removeprefix('controller.')}: must be left out, it is in the uncertainty set")


def _cost(cost: str, servo: Servo, gain: float) -> float:
    if cost == "gain":
        return gain
    if cost == "high-frequency":
        return gain * servo.controller.lead_time
    rate = -float(np.max(linear_loop(servo, gain).poles.real))
    return math.log(50) / rate if rate > 0 else math.inf


def _times(servo: Servo) -> Array:
    return np.log([servo.controller.lead_time, servo.controller.integral_time])


def _with_times(servo: Servo, q: Array) -> Servo:
    return servo.replace(**{name: float(value) for name, value in zip(TIMES, np.exp(q), strict=True)})


@dataclass(frozen=True, eq=False)
class _Answer:
    servo: Servo
    gain: float
    worst: WorstCase
    binding: tuple[str, ...]
    broken: dict[str, float]


@dataclass(frozen=True, eq=False)
class _Point:
    """A solution of one problem."""

    q: Array
    k: float
    slack: Array
    converged: bool
    message: str


SLACKS = ("hunting margin", "phase margin", "gain margin (lowering)", "gain margin (raising)")


class _Search:
    """The rounds of the module docstring."""

    def __init__(
        self, servo: Servo, model: Model, demands: Demands, uncertainty: Uncertainty | None, free: tuple[str, ...],
        limits: dict[str, tuple[float, float]], cost: str, options: Options,
    ) -> None:  # fmt: skip
        self.servo, self.model, self.demands, self.uncertainty = servo, model, demands, uncertainty
        self.free, self.limits, self.cost, self.options = free, dict(limits), cost, options
        self.rounds = self.evaluations = 0
        self.gain_only: float | None = None
        self.known: dict[Servo, Fold | None] = {}
        self.members: list[Servo] = []
        """Servos that must not hunt, with the times of `self.servo` times their own factors."""

    def run(self) -> _Answer:
        worst = self._worst(self.servo)
        self.members = [self.servo, *([worst.servo] if worst.servo != self.servo else [])]
        if "gain" not in self.limits:
            base = worst.gain or crossover_gain(self.servo)
            self.limits["gain"] = tuple(f * (1 + self.demands.margin) * base for f in GAINS)  # type: ignore[assignment]
        given = self._answer(_times(self.servo), worst)
        if not self.free:
            return self._met(given)
        self.gain_only = None if given.broken else _cost(self.cost, given.servo, given.gain)
        answer = given
        for _ in range(SEARCHES):
            q = self._rounds(_times(answer.servo))
            worst = self._worst(_with_times(self.servo, q))
            own = _with_times(worst.servo, _times(worst.servo) - q + _times(self.servo))
            answer = self._answer(q, worst)
            if any(_same(own, member) for member in self.members):
                break
            self.members.append(own)
        # The times as given are one of the candidates.
        if self.gain_only is not None:
            better = not answer.broken and _cost(self.cost, answer.servo, answer.gain) <= self.gain_only
            answer = answer if better else given
        return self._met(answer)

    def _worst(self, servo: Servo) -> WorstCase:
        """The worst servo of the set, with the controller of `servo`."""
        if self.uncertainty is None:
            fold = self._fold(servo)
            self.evaluations += 1
            return WorstCase(servo, fold, {}, 1)
        worst = worst_corner(servo, self.model, self.uncertainty, options=self.options, fold=self._fold(servo))
        self.evaluations += worst.evaluations
        return worst

    def _member(self, member: Servo, q: Array) -> Servo:
        return _with_times(member, _times(member) - _times(self.servo) + q)

    def _rounds(self, q: Array) -> Array:
        """The times of least cost, from mesh to mesh."""
        step = STEP
        folds = self._folds(q)
        for _ in range(ROUNDS):
            point = self._solve(q, folds, step)
            moved = point.q - q
            if np.max(np.abs(moved)) <= STILL:
                return q
            try:
                if not point.converged:
                    raise NoOrbit(f"the optimisation problem was not solved ({point.message})", Status.NOT_CONVERGED)
                folds = self._folds(point.q)
            except NoOrbit:
                step /= 4
                if step < SMALLEST_STEP:
                    raise
                continue
            q, step = point.q, min(STEP, 2 * step)
        return q

    def _folds(self, q: Array) -> list[Fold]:
        found = [self._fold(self._member(member, q)) for member in self.members]
        return [fold for fold in found if fold is not None]

    def _fold(self, servo: Servo) -> Fold | None:
        if servo not in self.known:
            self.known[servo] = _fold(servo, self.model, self.options)
        return self.known[servo]

    def _answer(self, q: Array, worst: WorstCase) -> _Answer:
        """The gain of least cost at these times, with what it breaks and what binds it."""
        folds = self._folds(q)
        point = self._solve(q, folds, 0.0)
        if not point.converged:
            raise NoOrbit(
                f"the optimisation problem of the tuning was not solved (IPOPT: {point.message}); try other bounds",
                Status.NOT_CONVERGED,
            )
        low, high = self.limits["gain"]
        gain = min(max(math.exp(point.k), low), high)
        needed = (1 + self.demands.margin) * worst.gain * (1 + SAFE)
        if point.slack[0] <= BROKEN and gain < needed:  # by the error of one mesh against another
            gain = min(needed, high)
        servo = _with_times(self.servo, q) if self.free else self.servo
        broken = {name: float(s) for name, s in zip(SLACKS, point.slack, strict=True) if s > BROKEN}
        return _Answer(servo, gain, worst, self._binding(servo, gain, worst), broken)

    def _binding(self, servo: Servo, gain: float, worst: WorstCase) -> tuple[str, ...]:
        demands = self.demands
        found = []
        if worst.gain and gain <= (1 + demands.margin) * worst.gain * (1 + TOUCHING):
            found.append("hunting margin")
        for member in (servo, worst.servo):
            loop = margins(member, gain, delay=demands.lag)
            if loop.phase_margin <= demands.phase_margin + math.degrees(TOUCHING):
                found.append("phase margin")
            if not loop.lowest_factor * demands.gain_margin <= 1 - TOUCHING:
                found.append("gain margin (lowering)")
            if not loop.highest_factor >= demands.gain_margin * (1 + TOUCHING):
                found.append("gain margin (raising)")
        for name in ("gain", *self.free):
            value = gain if name == "gain" else getattr(servo.controller, name)
            low, high = self.limits[name]
            if value <= low * (1 + TOUCHING):
                found.append(f"lower bound of {name}")
            if value >= high * (1 - TOUCHING):
                found.append(f"upper bound of {name}")
        return tuple(dict.fromkeys(found))

    def _met(self, answer: _Answer) -> _Answer:
        """The answer, or NoOrbit with what is in the way."""
        if not answer.broken:
            return answer
        demands, gain, worst = self.demands, answer.gain, answer.worst
        said, at_best = [], "at best" if len(answer.broken) == 1 else "there"
        loops = [margins(s, gain, delay=demands.lag) for s in (answer.servo, worst.servo)]
        for name in answer.broken:
            if name == "hunting margin":
                said.append(
                    f"the hunting margin: the worst fold gain is {worst.gain:.6g}, so that the gain must be at least "
                    f"{(1 + demands.margin) * worst.gain:.6g}, and the other constraints allow {gain:.6g}"
                )
            elif name == "phase margin":
                best = min(loop.phase_margin for loop in loops)
                said.append(f"the phase margin of {demands.phase_margin:g} degrees: it is {best:.5g} degrees {at_best}")
            else:
                lowering = "lowering" in name
                factors = [1 / f.lowest_factor if lowering and f.lowest_factor else f.highest_factor for f in loops]
                best = min((f for f in factors if math.isfinite(f)), default=math.nan)
                what = "fall" if lowering else "rise"
                amount = f"by a factor of {best:.5g} {at_best}" if math.isfinite(best) else "not at all (unstable loop)"
                said.append(f"the gain margin of {demands.gain_margin:g}: the gain may {what} {amount}")
        against = [b for b in answer.binding if b not in answer.broken]
        raise NoOrbit(
            f"the tuning cannot be met; in the way is {'; and '.join(said)} (nearest to it: gain {gain:.6g}"
            + (f", lead_time {answer.servo.controller.lead_time:.5g} s, integral_time "
               f"{answer.servo.controller.integral_time:.5g} s" if self.free else "")
            + (f"; held by the {', the '.join(against)}" if against else "")
            + ")"
        )  # fmt: skip

    def _solve(self, q: Array, folds: list[Fold], step: float) -> _Point:
        """One problem for IPOPT, the times within `step` of q."""
        self.rounds += 1
        demands = self.demands
        low = np.log([self.limits[name][0] if name in self.free else 1e-300 for name in FREE])
        high = np.log([self.limits[name][1] if name in self.free else 1e300 for name in FREE])
        reach = np.array([step if name in self.free else 0.0 for name in FREE])
        gains = np.log(self.limits["gain"])
        needed = [math.log((1 + demands.margin) * fold.gain) for fold in folds]
        k0 = min(max([*needed, gains[0]]), gains[1])
        k, times, slack = ca.MX.sym("k"), ca.MX.sym("q", 2), ca.MX.sym("slack", len(SLACKS))
        p = _Problem()
        p.add(k, [k0], gains[0], gains[1])
        p.add(times, q, np.maximum(q - reach, np.minimum(low, q)), np.minimum(q + reach, np.maximum(high, q)))
        p.add(slack, np.zeros(len(SLACKS)), 0.0, np.inf)
        cost = {"gain": k, "high-frequency": k + times[0]}.get(self.cost)
        members = [self._member(member, q) for member in self.members]
        for member in members:
            self._loop(p, member, _times(member) - q, k, times, slack, math.exp(k0))
        if cost is None:
            cost = self._settling(p, members[0], k, times, math.exp(k0))
        for fold in folds:
            t, u, setting = unknowns_of(fold.orbit)
            setting = replace(setting, dp=direction_of("gain") * fold.gain)
            z, n = ca.MX.sym("z", t.size + 1), ca.MX.sym("n", t.size)
            lower = np.full(t.size + 1, -np.inf)
            lower[t.size - t.phases : t.size] = 0.0
            lower[-1] = -0.9
            S = float(np.max(np.abs(fold.multipliers)))
            p.add(z, np.append(u, 0.0), lower, np.inf)
            p.add(n, fold.multipliers / S, -np.inf, np.inf)
            excess = k - math.log((1 + demands.margin) * fold.gain) - ca.log(1 + z[t.size]) + slack[0]
            p.row(excess, 0.0, np.inf)
            p.fold(t, times + (_times(fold.orbit.servo) - q), times, z, n, data_of(setting), S)
        found = p.solve(cost + PRICE * ca.sum1(slack))
        x = found.x
        return _Point(x[1:3], float(x[0]), x[3 : 3 + len(SLACKS)], found.status.ok, found.message)

    def _loop(
        self, p: _Problem, servo: Servo, offset: Array, k: ca.MX, times: ca.MX, slack: ca.MX, gain: float
    ) -> None:
        """Crossovers and margins of one linear loop."""
        demands, f = self.demands, self.demands.gain_margin
        J, cm, sigma2 = servo.inertia, servo.motor_gain, servo.friction.viscous
        own = times + offset
        required = (math.radians(demands.phase_margin), 0.0, 0.0)
        for i, (level, least) in enumerate(zip((1.0, f, 1 / f), required, strict=True)):
            y = ca.MX.sym("y")
            start = math.log(crossover(servo, gain, level))
            p.add(y, [start], start - 20, start + 20)
            p.row(log_magnitude(J, cm, sigma2, k, own, y) - 2 * math.log(level), 0.0, 0.0)
            p.row(phase(J, sigma2, demands.lag, own, y) + slack[1 + i], least, np.inf)

    def _settling(self, p: _Problem, servo: Servo, k: ca.MX, times: ca.MX, gain: float) -> ca.MX:
        """-ln rho, with the conditions that no pole is slower than rho."""
        rate = max(-float(np.max(linear_loop(servo, gain).poles.real)), 1e-3 * crossover(servo, gain))
        y = ca.MX.sym("ln_rho")
        p.add(y, [math.log(rate)], math.log(rate) - 20, math.log(rate) + 20)
        unit = crossover(servo, gain)  # time in units of 1/unit makes the coefficients of size one
        J, rho = servo.inertia, ca.exp(y) / unit
        lead, integral = ca.exp(times[0]), ca.exp(times[1])
        factor = ca.exp(k) * servo.motor_gain / J
        a2 = (factor * lead + servo.friction.viscous / J) / unit
        a1, a0 = factor * (1 + lead / integral) / unit**2, factor / integral / unit**3
        b2, b1 = a2 - 3 * rho, a1 - 2 * a2 * rho + 3 * rho**2
        b0 = a0 - a1 * rho + a2 * rho**2 - rho**3
        for value in (b2, b1, b0, b2 * b1 - b0):
            p.row(value, 0.0, np.inf)
        return -y


class _Problem:
    """Variables and rows with their bounds, gathered; the Jacobian of the folds is given, the rest derived."""

    def __init__(self) -> None:
        self.symbols: list[ca.MX] = []
        self.starts: list[Array] = []
        self.bounds: list[Array] = []
        self.rows: list[ca.MX] = []
        self.row_bounds: list[Array] = []
        self.jacobians: list[tuple[ca.MX, list[tuple[ca.MX, ca.MX]]] | None] = []

    def add(self, symbol: ca.MX, start: Array | Sequence[float], low: Array | float, high: Array | float) -> None:
        """A variable."""
        x = np.asarray(start, float)
        self.symbols.append(symbol)
        self.starts.append(x)
        self.bounds.append(np.column_stack([np.broadcast_to(low, x.shape), np.broadcast_to(high, x.shape)]))

    def row(self, value: ca.MX, low: float, high: float) -> None:
        """A scalar constraint."""
        self.rows.append(value)
        self.row_bounds.append(np.array([[low, high]]))
        self.jacobians.append(None)

    def fold(self, t, own: ca.MX, times: ca.MX, z: ca.MX, n: ca.MX, data: Array, S: float) -> None:  # type: ignore[no-untyped-def]
        """The conditions of a fold, with the controller times exp(own), own = times + numbers."""
        equations, jacobian = fold_conditions(t)
        self.rows.append(equations(own, z, n, data, S))
        right = np.zeros(2 * t.size + 1)
        right[-1] = 1.0
        self.row_bounds.append(np.column_stack([right, right]))
        J = jacobian(own, z, n, data, S)
        size = t.size + 1
        self.jacobians.append((J, [(times, J[:, :2]), (z, J[:, 2 : 2 + size]), (n, J[:, 2 + size :])]))

    def solve(self, objective: ca.MX):  # type: ignore[no-untyped-def]
        """IPOPT's answer."""
        # A fresh symbol for the whole, of which the pieces are slices: CasADi wants one vector.
        x = ca.MX.sym("x", sum(s.numel() for s in self.symbols))
        pieces = ca.vertsplit(x, [0, *np.cumsum([s.numel() for s in self.symbols]).tolist()])
        few = ca.vertcat(*self.symbols)
        blocks = []
        for row, given in zip(self.rows, self.jacobians, strict=True):
            if given is None:
                blocks.append(ca.jacobian(row, few))
                continue
            height = row.numel()
            places = {id(symbol): block for symbol, block in given[1]}
            blocks.append(ca.horzcat(*[
                places.get(id(s), ca.MX(height, s.numel())) for s in self.symbols
            ]))  # fmt: skip
        expressions = [objective, ca.vertcat(*self.rows), ca.vertcat(*blocks)]
        f, g, J = ca.graph_substitute(expressions, self.symbols, pieces)
        return minimise(
            x, f, g, J, np.concatenate(self.starts), np.concatenate(self.bounds), np.concatenate(self.row_bounds)
        )


def crossover_gain(servo: Servo) -> float:
    """A gain [V/rad] of the right size for a servo without a fold: J/(cm tau_i^2)."""
    return servo.inertia / (servo.motor_gain * servo.controller.integral_time**2)


def _same(a: Servo, b: Servo) -> bool:
    return bool(np.allclose(a.parameters(1.0), b.parameters(1.0), rtol=1e-9, atol=0.0))


def _fold(servo: Servo, model: Model, options: Options) -> Fold | None:
    """The fold; None where no cycle was found at any gain, which the scan at the answer has to confirm."""
    try:
        return find_fold(servo, model, options=options)
    except NoOrbit as error:
        if error.status is None:
            return None
        raise


def _verified(
    servo: Servo, worst: Servo, model: Model, gain: float, demands: Demands, known_fold: Fold | None, options: Options
) -> Verification:
    nominal = _fold(servo, model, options)
    fold = nominal if worst == servo else _fold(worst, model, options)
    largest = max((f.gain for f in (nominal, fold) if f is not None), default=0.0)
    margin = gain / largest - 1 if largest else math.inf
    sentence, clear = _scanned(worst, model, gain)
    loops = {"nominal": margins(servo, gain, delay=demands.lag), "worst": margins(worst, gain, delay=demands.lag)}
    slack = 10 * TOUCHING
    loops_kept = all(
        loop.stable
        and loop.phase_margin >= demands.phase_margin - math.degrees(slack)
        and loop.lowest_factor * demands.gain_margin <= 1 + slack
        and loop.highest_factor >= demands.gain_margin * (1 - slack)
        for loop in loops.values()
    )
    span = PERIODS * (fold.orbit.period if fold is not None else 5.0)
    amplitude = 2 * fold.orbit.amplitude if fold is not None else servo.friction.static / servo.torque_gains(gain)[0]
    tasks = [
        *regulator_tasks(servo, model, gain, span, amplitude, "nominal"),
        *(regulator_tasks(worst, model, gain, span, amplitude, "worst") if worst != servo else []),
    ]
    kept = margin >= demands.margin - 10 * options.tol
    return Verification(
        fold, nominal, margin, kept, sentence, clear, loops, loops_kept, span, amplitude, tuple(tasks)
    )


def _scanned(servo: Servo, model: Model, gain: float) -> tuple[str, bool]:
    """What the event map says, and whether that is: every motion sticks nearer to the set point than it started.

    Then no cycle with sticking exists, lopsided ones included: along a cycle |x1| of the sticks cannot always fall.
    """
    if model == "switch":
        seen = fixed_points(servo, gain)
        falls = all(abs(point.position) < point.start for point in seen.points)  # false for nan: it swings on
        return seen.sentence(), not seen.fixed and seen.conclusive and falls
    found = scan(model, servo, gain)
    clear = found.upper is None and not found.failures and found.best < 1
    cycles = "no cycle" if found.upper is None else f"a cycle at {found.upper.start:.6g} rad"
    return (
        f"{cycles} of the event map between {found.low:.4g} and {found.high:.4g} rad: {found.motions} motions, the "
        f"largest |P(a)|/a is {found.best:.6g} at a = {found.best_at:.6g} rad; {len(found.failures)} motions failed",
        clear,
    )


def regulator_tasks(
    servo: Servo, model: Model, gain: float, span: float, amplitude: float, friction: str
) -> list[Task]:
    """Simulated motions towards a set point: two steps from rest, and a breakaway beside the set point.

    Parameters
    ----------
    servo, model, gain
        the problem.
    span
        length of the motions [s].
    amplitude
        of the breakaway [rad].
    friction
        what the friction is called.
    """
    kp, _, ki = servo.torque_gains(gain)
    brink = (kp * amplitude - servo.friction.static) / ki
    steps = [(f"a step of {size:g} rad from rest", {"set_point": size}) for size in (1.0, 0.1)]
    starts = [
        *steps,
        (
            f"breaking away {amplitude:.4g} rad beside the set point",
            {"set_point": 0.0, "position": -amplitude, "integral": brink},
        ),
    ]
    return [
        Task(friction, name, simulate(servo, model, gain, time=span, **values)) for name, values in starts  # type: ignore[arg-type]
    ]
