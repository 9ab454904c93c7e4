"""How far an uncertain servo moves its fold gain: linearised, sampled, and at the worst corner.

The fold gain K(q) depends on the parameters q (servo.PARAMETERS without the gain), of which k are uncertain:
either each in an interval [l_i, h_i], or all together with a covariance C about the servo's own values q0.

    linear      K(q) ~ K(q0) + g . (q - q0),  g = dK/dq at q0, exact (sensitivity.py)
                interval: low, high = the extremes of that over the box;  covariance: std^2 = g . C g
    samples     K(q_j) solved; q_j uniform in the box, or normal with mean q0 and covariance C
    worst       max K(q) over the box l <= q <= h, with the exact gradient at every iterate

The box of a covariance is q0 +- sigmas sqrt(C_ii): it takes no notice of correlations, its corners are farther out
than any likely servo, and normal samples may lie outside it.

The search for the worst corner is a local one.  K is monotone in most parameters, so it goes straight to the corner
that the signs of g give, takes the gradient there, and goes on until no bound and no interior point is better to
first order: what a concave K could still gain, sum_i |g_i| room_i, is below the tolerance.  A coordinate along
which the gradient changes sign is brought to its zero by a search along that coordinate.  It is started from the
servo, from a few random corners, and from where the caller likes.

K is 0 where the search of servo/find_fold.py finds no cycle at any of its gains; with static = Coulomb friction there
is none (Bisoffi et al.), and static < Coulomb is no friction at all.  Such a servo costs a hundred times as much as
another.

Units: K in V/rad, q as in servo/servo.py.
Symbols: k uncertain parameters, n samples, q, l, h (k,) values and bounds, g (k,) gradient.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import LARGEST, SMALLEST, known, number, quoted, require, shown
from ..continuation.fold import WALK_TOLERANCE
from ..errors import InputError, NoOrbit, Status
from ..hybrid.roots import Bracket
from ..orbits.adapt import Options
from ..servo.cold_start import stable_at
from ..servo.event_map.scan import scan
from ..servo.find_fold import find_fold
from ..servo.hunting import MODELS, Model
from ..servo.problem import HuntingFold
from ..servo.servo import Servo, flatten, read_toml
from .sensitivity import NAMES, fold_sensitivities

Array = np.ndarray

SIGMAS = 3.0
ROUNDING = 1e-10
"""Relative asymmetry, and negative eigenvalue of the correlations, that a typed covariance may have."""
BELOW = 0.7
"""Part of the predicted fold gain at which the way to the fold starts; the cold search costs three times as much."""
CHUNK = 5
"""Samples per task: few enough to keep all workers busy to the end, enough to hide what a task costs."""
RANDOM_CORNERS = 2
MOST_EVALUATIONS = 100
MOST_ALONG = 25
"""Folds per search for a worst corner, and per search along one coordinate."""
MOST_SAMPLES = 1_000_000
"""Beyond so many the folds would take days."""
LEVELS = {"min": 0.0, "5%": 0.05, "25%": 0.25, "50%": 0.5, "75%": 0.75, "95%": 0.95, "max": 1.0}
"""Quantiles of the sampled fold gains."""
MISLEADS = 0.02
"""Relative error of a fold gain from which the linear answer is said to mislead."""
STATIC, COULOMB = "friction.static", "friction.coulomb"


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What is uncertain: intervals, or a covariance about the servo's own values.

    Attributes
    ----------
    intervals : (low, high) by parameter name (sensitivity.NAMES), in the parameter's unit.
    names, covariance : k parameter names and their (k, k) covariance, instead of intervals.
    sigmas : half width of a covariance's box, in standard deviations; > 0.

    Raises
    ------
    InputError : nothing or both given, an unknown name, low > high, or a matrix that is no covariance.
    """

    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    covariance: Array | None = None
    sigmas: float = SIGMAS

    def __post_init__(self) -> None:
        given = len(self.intervals) > 0
        if given == (self.covariance is not None):
            raise InputError("uncertainty: must be either intervals (at least one) or names with a covariance")
        require("sigmas", self.sigmas, above=0)
        if given:
            if len(self.names):
                raise InputError(f"names = {list(self.names)!r}: must be left out where intervals are given")
            object.__setattr__(self, "intervals", {name: _interval(name, i) for name, i in self.intervals.items()})
            return
        names = tuple(known("parameter", name, NAMES) for name in self.names)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "covariance", _covariance(names, self.covariance))

    @property
    def parameters(self) -> tuple[str, ...]:
        """The k names of what is uncertain, in the order of every array."""
        return self.names or tuple(self.intervals)

    @property
    def std(self) -> Array:
        """(k,) standard deviations; of an interval those of the uniform distribution."""
        if self.covariance is not None:
            return np.sqrt(np.diag(self.covariance))
        return np.array([high - low for low, high in self.intervals.values()]) / np.sqrt(12)

    def box(self, servo: Servo) -> tuple[Array, Array]:
        """(low, high), (k,) each: the intervals, or q0 +- sigmas standard deviations."""
        if self.covariance is None:
            low, high = np.array(list(self.intervals.values())).T
            return low, high
        q = values_of(servo, self.parameters)
        return q - self.sigmas * self.std, q + self.sigmas * self.std


def _interval(name: str, pair: Any) -> tuple[float, float]:
    known("parameter", name, NAMES)
    if isinstance(pair, str) or not isinstance(pair, Sequence | np.ndarray) or len(pair) != 2:
        raise InputError(f"{name} = {quoted(pair)}: must be an interval [low, high]")
    low, high = number(name, pair[0]), number(name, pair[1])
    if low > high:
        raise InputError(f"{name} = [{shown(low)}, {shown(high)}]: low must not exceed high")
    return low, high


def _covariance(names: tuple[str, ...], matrix: Any) -> Array:
    """The (k, k) matrix, symmetric to the last bit, or InputError."""
    k = len(names)
    if k == 0 or len(set(names)) < k:
        raise InputError(f"names = {list(names)!r}: must be at least one parameter, each once")
    try:
        c = np.array(matrix, dtype=float)
    except (TypeError, ValueError, OverflowError):  # an integer may be too large for a float
        raise InputError(f"covariance: must be a matrix of numbers, {k} rows of {k}") from None
    if c.shape != (k, k) or not (np.abs(c) <= LARGEST**2).all():
        which = f"one for each of {', '.join(names)}"
        raise InputError(f"covariance: must be {k} rows of {k} finite numbers up to {LARGEST**2:g}, {which}")
    spread = np.sqrt(np.abs(np.diag(c)))
    size = np.outer(spread, spread)
    if (np.abs(c - c.T) > ROUNDING * size).any():
        raise InputError("covariance: must be symmetric")
    if (np.diag(c) < 0).any():
        raise InputError("covariance: must have no negative variance on its diagonal")
    correlation = np.divide(c, size, out=np.zeros_like(c), where=size > 0)
    if (np.abs(c[size == 0]) > 0).any() or np.linalg.eigvalsh(correlation)[0] < -ROUNDING * k:
        raise InputError("covariance: must be positive semidefinite (some correlations contradict each other)")
    return (c + c.T) / 2


def values_of(servo: Servo, names: Iterable[str]) -> Array:
    """(k,) values of the named parameters."""
    values = flatten(servo)
    return np.array([values[name] for name in names])


def load_uncertainty(path: str | Path, servo: Servo) -> Uncertainty:
    """Read an uncertainty from a TOML file.

    Either a table [interval] with ``"friction.static" = [0.52, 0.54]``, or ``"2%"`` of the servo's value to both
    sides; or a table [covariance] with names, matrix and perhaps sigmas.

    Raises
    ------
    InputError : missing file, broken TOML, unknown key, or what `Uncertainty` refuses.
    """
    what = f"uncertainty file {str(path)!r}"
    tree = read_toml(path, what)
    try:
        uncertainty = _from_tree(tree, servo)
        check_box(servo, uncertainty)
    except InputError as error:
        raise InputError(f"{what}: {error}") from None
    return uncertainty


def _from_tree(tree: dict[str, Any], servo: Servo) -> Uncertainty:
    for section, table in tree.items():
        known("section", section, ("interval", "covariance"))
        if not isinstance(table, dict):
            raise InputError(f"{section} = {quoted(table)}: must be a table [{section}]")
    if len(tree) != 1:
        raise InputError("must hold one table, either [interval] or [covariance]")
    if "interval" in tree:
        intervals: dict[str, Any] = {}
        for key, value in tree["interval"].items():  # friction.static without quotes is a table in a table
            inner = {f"{key}.{name}": v for name, v in value.items()} if isinstance(value, dict) else {key: value}
            intervals |= {name: _absolute(name, v, servo) for name, v in inner.items()}
        return Uncertainty(intervals)
    table = tree["covariance"]
    for key in table:
        known("key", key, ("names", "matrix", "sigmas"))
    names = table.get("names", [])
    if not isinstance(names, list):
        raise InputError(f"names = {quoted(names)}: must be a list of parameters")
    if "matrix" not in table:
        raise InputError("[covariance]: must have a matrix")
    return Uncertainty(names=tuple(names), covariance=table["matrix"], sigmas=table.get("sigmas", SIGMAS))


def _absolute(name: str, value: Any, servo: Servo) -> Any:
    """An interval as it stands, or that of "2%"."""
    if not isinstance(value, str):
        return value
    known("parameter", name, NAMES)
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*%\s*", value)
    try:
        part = float(match.group(1)) / 100 if match else None
    except ValueError:
        part = None
    if part is None:
        raise InputError(f'{name} = {value!r}: must be [low, high] or a percentage such as "2%"')
    q = float(values_of(servo, [name])[0])
    return q - part * abs(q), q + part * abs(q)


def check_box(servo: Servo, uncertainty: Uncertainty) -> None:
    """Raise InputError where a bound is out of its parameter's range, or static < Coulomb friction all over the box."""
    names = uncertainty.parameters
    low, high = uncertainty.box(servo)
    # Each bound on its own, with the friction that leaves it the most room: static high, Coulomb low.
    roomy = {name: float(high[i] if name == STATIC else low[i]) for i, name in enumerate(names)}
    for name, bounds in zip(names, np.column_stack([low, high]), strict=True):
        for bound in bounds:
            try:
                room = {COULOMB: SMALLEST} if name == STATIC else {STATIC: LARGEST} if name == COULOMB else {}
                servo.replace(**{name: float(bound)}, **room)
            except InputError as error:
                where = "" if uncertainty.covariance is None else f" (at {uncertainty.sigmas:g} standard deviations)"
                raise InputError(f"{error}{where}") from None
    servo.replace(**roomy)


# One fold


@dataclass(frozen=True)
class _Task:
    """Everything a worker needs for a few samples; small, and pickled once per task."""

    servo: Servo
    model: Model
    options: Options
    names: tuple[str, ...]
    rows: Array
    expected: Array


def _work(task: _Task, report: Callable[[int], None] | None = None) -> list[tuple[float, str]]:
    """(fold gain, "" or what went wrong) of every row; a function of the task alone, whoever runs it."""
    results = []
    for q, expected in zip(task.rows, task.expected, strict=True):
        try:
            fold = _fold_near(_servo_at(task.servo, task.names, q), task.model, float(expected), task.options)
            results.append((fold.gain if fold else 0.0, ""))
        except NoOrbit as error:
            results.append((float("nan"), str(error)))
        if report is not None:
            report(len(results))
    return results


def _servo_at(servo: Servo, names: Sequence[str], q: Array) -> Servo:
    return servo.replace(**{name: float(value) for name, value in zip(names, q, strict=True)})


def _fold_near(servo: Servo, model: Model, expected: float, options: Options) -> HuntingFold | None:
    """The fold of a servo whose gain is about `expected` (nan: unknown); None where the servo cannot hunt.

    Raises
    ------
    NoOrbit : the fold was not computed.
    """
    start = None
    if np.isfinite(expected):
        try:
            rough = replace(options, tol=max(options.tol, WALK_TOLERANCE))
            met = stable_at(servo, model, BELOW * expected, options=rough)  # where it meets none, that proves nothing
            if met.orbit is not None and (met.clearly_stable or met.orbit.multipliers.leading.real <= 1):
                start = met.orbit
        except NoOrbit:
            pass  # the prediction was too far off: search from nothing
    try:
        return find_fold(servo, model, options=options, start=start)
    except NoOrbit as error:
        if error.status is not None:
            raise
        # The search found no cycle at any gain; the map at the expected gain is asked once more.
        if np.isfinite(expected) and scan("switch", servo, BELOW * expected).upper is not None:
            sentence = f"{error}, but the event map has one near gain {expected:.4g}"
            raise NoOrbit(sentence, Status.NOT_CONVERGED) from None
        return None


@dataclass(frozen=True)
class _Prediction:
    """K(q) ~ K0 prod (q_i/q0_i)^e_i, e the elasticities: positive everywhere, unlike the linear one."""

    gain: float
    q: Array
    elasticities: Array

    def __call__(self, rows: Array) -> Array:
        """(n,) gains predicted at rows (n, k)."""
        usable = (self.q > 0) & (rows > 0)
        logs = np.log(np.where(usable, rows, 1.0) / np.where(usable, self.q, 1.0))
        return self.gain * np.exp(np.clip(np.where(usable, logs, 0.0) @ self.elasticities, -50, 50))


def _prediction(servo: Servo, fold: HuntingFold | None, names: Sequence[str]) -> _Prediction:
    q = values_of(servo, names)
    if fold is None:
        return _Prediction(float("nan"), q, np.zeros(q.size))
    elasticities = fold_sensitivities(fold).elasticities
    return _Prediction(fold.gain, q, np.array([elasticities[name] for name in names]))


def _nominal(servo: Servo, model: Model, options: Options, fold: HuntingFold | None) -> HuntingFold | None:
    """The servo's own fold, computed where it is not given; None where it cannot hunt or was not computed."""
    if fold is not None:
        return fold
    try:
        return find_fold(servo, model, options=options)
    except NoOrbit:
        return None


# The linear answer


def linear_interval(fold: HuntingFold, uncertainty: Uncertainty) -> tuple[float, float]:
    """The fold gain by linearisation about the servo of `fold`.

    Returns
    -------
    (low, high) of the linear function over intervals; (mean, std) for a covariance.  `linear_range` is
    (low, high), `linear_moments` (mean, std) of either.
    """
    return (linear_range if uncertainty.covariance is None else linear_moments)(fold, uncertainty)


def linear_range(fold: HuntingFold, uncertainty: Uncertainty) -> tuple[float, float]:
    """(low, high): extremes over the intervals; mean -+ sigmas std for a covariance."""
    if uncertainty.covariance is not None:
        mean, std = linear_moments(fold, uncertainty)
        return mean - uncertainty.sigmas * std, mean + uncertainty.sigmas * std
    g, q = _gradient(fold, uncertainty.parameters), values_of(fold.orbit.servo, uncertainty.parameters)
    ends = np.array([g * (bound - q) for bound in uncertainty.box(fold.orbit.servo)])
    return fold.gain + float(ends.min(axis=0).sum()), fold.gain + float(ends.max(axis=0).sum())


def linear_moments(fold: HuntingFold, uncertainty: Uncertainty) -> tuple[float, float]:
    """(mean, std) of the linear function, with uniform distributions on intervals."""
    g, servo = _gradient(fold, uncertainty.parameters), fold.orbit.servo
    if uncertainty.covariance is not None:
        return fold.gain, float(np.sqrt(max(g @ uncertainty.covariance @ g, 0.0)))
    low, high = uncertainty.box(servo)
    shift = float(g @ ((low + high) / 2 - values_of(servo, uncertainty.parameters)))
    return fold.gain + shift, float(np.linalg.norm(g * uncertainty.std))


def linear_gains(fold: HuntingFold, names: Sequence[str], rows: Array) -> Array:
    """(n,) linearised fold gains at parameter values (n, k)."""
    return fold.gain + (rows - values_of(fold.orbit.servo, names)) @ _gradient(fold, names)


def _gradient(fold: HuntingFold, names: Sequence[str]) -> Array:
    derivatives = fold_sensitivities(fold).derivatives
    return np.array([derivatives[name] for name in names], dtype=float)


# Samples


@dataclass(frozen=True, eq=False)
class Samples:
    """Solved samples.

    Attributes
    ----------
    names : the k uncertain parameters.
    parameters : (n, k) their values.
    gains : (n,) fold gains; 0 where the search finds no cycle at any gain, nan where the fold was not computed.
    failures : (index, sentence) of every sample that was not computed.
    """

    names: tuple[str, ...]
    parameters: Array
    gains: Array
    failures: tuple[tuple[int, str], ...]

    @property
    def computed(self) -> Array:
        """(n,) bool."""
        return np.isfinite(self.gains)

    @property
    def worst(self) -> int | None:
        """Index of the largest fold gain; None where none was computed."""
        return int(np.nanargmax(self.gains)) if self.computed.any() else None

    def quantiles(self) -> dict[str, float]:
        """Quantiles (`LEVELS`) of the fold gains that were computed; empty where none was."""
        gains = self.gains[self.computed]
        return {key: float(np.quantile(gains, level)) for key, level in LEVELS.items()} if gains.size else {}


def draw(servo: Servo, uncertainty: Uncertainty, n: int, *, seed: int = 0) -> Array:
    """(n, k) parameter values: uniform in the intervals, or normal about the servo's values.

    The first rows do not depend on n.

    Raises
    ------
    InputError : a value out of its parameter's range, for example static below Coulomb friction.
    """
    if isinstance(n, bool) or int(n) != n or n < 1:
        raise InputError(f"samples = {quoted(n)}: must be a whole number, at least 1")
    if n > MOST_SAMPLES:
        raise InputError(f"samples = {quoted(n)}: must be at most {MOST_SAMPLES} (each is a fold to be computed)")
    if isinstance(seed, bool) or int(seed) != seed or seed < 0:
        raise InputError(f"seed = {seed!r}: must be a whole number, at least 0")
    random = np.random.default_rng(np.random.SeedSequence(int(seed)))
    names = uncertainty.parameters
    if uncertainty.covariance is None:
        low, high = uncertainty.box(servo)
        rows = low + (high - low) * random.random((int(n), len(names)))
    else:
        # The symmetric root exists for a singular matrix too, and has no sign to choose; of the correlations,
        # because the variances differ by many orders of magnitude.
        std = np.where(uncertainty.std > 0, uncertainty.std, 1.0)
        w, v = np.linalg.eigh(uncertainty.covariance / np.outer(std, std))
        root = (v * np.sqrt(np.maximum(w, 0))) @ v.T
        rows = values_of(servo, names) + std * (random.standard_normal((int(n), len(names))) @ root)
    for i, q in enumerate(rows):
        try:
            _servo_at(servo, names, q)
        except InputError as error:
            raise InputError(f"sample {i + 1} of {n}: {error}; make the uncertainty smaller") from None
    return rows


def sample(
    servo: Servo,
    model: Model,
    uncertainty: Uncertainty,
    n: int,
    *,
    seed: int = 0,
    executor: Executor | None = None,
    options: Options | None = None,
    fold: HuntingFold | None = None,
    report: Callable[[int], None] | None = None,
) -> Samples:
    """Fold gains of n servos drawn from the uncertainty.

    Every sample starts from the gain that the servo's own fold predicts for it, none from another sample: results
    depend neither on the executor nor on the order.

    Parameters
    ----------
    servo, model, uncertainty, n
        the problem.
    seed
        of numpy's SeedSequence.
    executor
        any concurrent.futures.Executor: ProcessPoolExecutor (spawn), ``dask.distributed.Client(...).get_executor()``,
        ``MPIPoolExecutor``; default: this process.  Threads give the same results, but hardly sooner.
    options
        tolerance of every fold.
    fold
        the servo's own fold, where it is known already.
    report
        called with the number of samples solved so far.

    Returns
    -------
    Samples; a servo that cannot hunt has the fold gain 0.

    Raises
    ------
    InputError : a sample out of range.
    """
    known("model", model, MODELS)
    check_box(servo, uncertainty)
    options = options or Options()
    names = uncertainty.parameters
    rows = draw(servo, uncertainty, n, seed=seed)
    expected = _prediction(servo, _nominal(servo, model, options, fold), names)(rows)
    tasks = [
        _Task(servo, model, options, names, rows[i : i + CHUNK], expected[i : i + CHUNK])
        for i in range(0, len(rows), CHUNK)
    ]
    batches = map(_work, tasks) if executor is None else executor.map(_work, tasks)
    results: list[tuple[float, str]] = []
    for batch in batches:
        results += batch
        if report is not None:
            report(len(results))
    failures = tuple((i, sentence) for i, (_, sentence) in enumerate(results) if sentence)
    return Samples(names, rows, np.array([gain for gain, _ in results]), failures)


def fold_gains(
    servo: Servo,
    model: Model,
    names: Sequence[str],
    rows: Array,
    *,
    options: Options | None = None,
    fold: HuntingFold | None = None,
    report: Callable[[int], None] | None = None,
) -> tuple[Array, dict[int, str]]:
    """Fold gains at given parameter values.

    Parameters
    ----------
    servo, model
        the problem.
    names, rows
        k parameters and (n, k) values of them.
    options
        tolerance of every fold.
    fold
        a fold from which the others are predicted, of any servo nearby.
    report
        called with the number of folds computed so far.

    Returns
    -------
    (n,) gains; 0 where the search finds no cycle at any gain, nan where the fold was not computed, and the sentence by
    index of the latter.
    """
    near = fold.orbit.servo if fold is not None else servo
    names = tuple(names)
    expected = _prediction(near, fold, names)(rows)
    results = _work(_Task(servo, model, options or Options(), names, rows, expected), report)
    return np.array([gain for gain, _ in results]), {i: said for i, (_, said) in enumerate(results) if said}


def fold_beside(servo: Servo, model: Model, known: HuntingFold, *, options: Options | None = None
) -> HuntingFold | None:
    """The fold of a servo, looked for where that of a servo nearby lets it be expected.

    Parameters
    ----------
    servo, model
        the problem.
    known
        the fold of a servo nearby.
    options
        tolerance.

    Returns
    -------
    The fold; None where the search finds no cycle at any gain.

    Raises
    ------
    NoOrbit : it was not computed.
    """
    names = tuple(fold_sensitivities(known).elasticities)
    expected = _prediction(known.orbit.servo, known, names)(values_of(servo, names)[None, :])
    return _fold_near(servo, model, float(expected[0]), options or Options())


# The worst corner


@dataclass(frozen=True, eq=False)
class WorstCase:
    """The largest fold gain found in a box.

    Attributes
    ----------
    servo : the servo there.
    fold : its fold; None where no servo of the box was found to hunt.
    corner : the values of the uncertain parameters there.
    evaluations : folds computed.
    failures : what went wrong at points that were not computed.
    """

    servo: Servo
    fold: HuntingFold | None
    corner: dict[str, float]
    evaluations: int
    failures: tuple[str, ...] = ()

    @property
    def gain(self) -> float:
        """The fold gain; 0 without a fold."""
        return self.fold.gain if self.fold is not None else 0.0


@dataclass(frozen=True, eq=False)
class _Place:
    """A point of the search: K = -inf where it is no servo or was not computed; no gradient where K <= 0."""

    q: Array
    gain: float
    gradient: Array | None = None
    fold: HuntingFold | None = None


class _Search:
    """The folds computed so far in one box; every point is computed once."""

    def __init__(self, servo: Servo, model: Model, uncertainty: Uncertainty, options: Options, fold: HuntingFold | None,
                 report: Callable[[int], None] | None):  # fmt: skip
        self.report = report
        self.servo, self.model, self.options = servo, model, options
        self.names = uncertainty.parameters
        self.low, self.high = uncertainty.box(servo)
        self.predict = _prediction(servo, fold, self.names)
        self.places: dict[bytes, _Place] = {}
        self.evaluations = 0
        self.failures: list[str] = []
        if fold is not None:
            self._keep(_Place(self.predict.q, fold.gain, _gradient(fold, self.names), fold))

    def _keep(self, place: _Place) -> _Place:
        return self.places.setdefault(place.q.tobytes(), place)

    def at(self, q: Array) -> _Place:
        """The fold at q."""
        if q.tobytes() in self.places:
            return self.places[q.tobytes()]
        try:
            servo = _servo_at(self.servo, self.names, q)
        except InputError:  # static below Coulomb friction; the other bounds have been checked
            return self._keep(_Place(q, -np.inf))
        self.evaluations += 1
        if self.report is not None:
            self.report(self.evaluations)
        try:
            fold = _fold_near(servo, self.model, float(self.predict(q[None, :])[0]), self.options)
        except NoOrbit as error:
            corner = ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.names, q, strict=True))
            self.failures.append(f"at {corner}: {error}")
            return self._keep(_Place(q, -np.inf))
        if fold is None:
            return self._keep(_Place(q, 0.0))
        return self._keep(_Place(q, fold.gain, _gradient(fold, self.names), fold))

    def climb(self, q: Array) -> None:
        """From q to a point from which no step within the box leads up, to first order."""
        here = self.at(q)
        while here.gradient is not None and self.evaluations < MOST_EVALUATIONS:
            g = here.gradient
            room = np.where(g > 0, self.high, self.low) - here.q
            rise = g * room
            if rise.sum() <= self.options.tol * here.gain:
                return
            corner = np.where(rise > 0, np.where(g > 0, self.high, self.low), here.q)
            there = self.at(corner)
            if not there.gain > here.gain:
                there = self._along(here, int(np.argmax(rise)))
            if not there.gain > here.gain:
                return
            here = there

    def _along(self, here: _Place, i: int) -> _Place:
        """The best point along coordinate i, upwards from `here`: the zero of the gradient by Illinois steps."""
        assert here.gradient is not None
        sense = np.sign(here.gradient[i])
        start, end = float(here.q[i]), float((self.high if sense > 0 else self.low)[i])
        # Up to where K falls again; of the far end no more is known yet.
        bracket = Bracket(end, -np.inf, start, float(abs(here.gradient[i])))
        best, x = here, end
        for _ in range(MOST_ALONG):
            q = here.q.copy()
            q[i] = x
            place = self.at(q)
            slope = np.nan if place.gradient is None else float(sense * place.gradient[i])
            best = place if place.gain > best.gain else best
            level = abs(slope) * abs(end - start) <= self.options.tol * place.gain
            if level or (x == end and slope > 0 and best is place):
                break
            rises = slope > 0 and place.gain >= here.gain
            bracket = bracket.told(x, slope if rises or slope < 0 else -np.inf)
            x = bracket.illinois
            if not bracket.holds(x):
                break
        return best


def worst_corner(
    servo: Servo,
    model: Model,
    uncertainty: Uncertainty,
    *,
    options: Options | None = None,
    fold: HuntingFold | None = None,
    starts: Iterable[Array] = (),
    seed: int = 0,
    report: Callable[[int], None] | None = None,
) -> WorstCase:
    """The largest fold gain over the box of the uncertainty, by a local search (module docstring).

    Parameters
    ----------
    servo, model, uncertainty
        the problem.
    options
        tolerance of every fold, and of the search.
    fold
        the servo's own fold, where it is known already.
    starts
        more points (k,) of the box to start from, for example the worst of the samples.
    seed
        of the random corners.
    report
        called before every fold with its number.

    Returns
    -------
    WorstCase; where no point of the box was found to hunt, gain 0 at the corner that favours hunting most
    (largest static, smallest Coulomb friction).

    Raises
    ------
    InputError : the box is no servo's.
    NoOrbit : no point of the box could be computed.
    """
    known("model", model, MODELS)
    check_box(servo, uncertainty)
    options = options or Options()
    search = _Search(servo, model, uncertainty, options, _nominal(servo, model, options, fold), report)
    low, high, names = search.low, search.high, search.names

    def possible(q: Array) -> Array:
        """q, with the friction that hunts most where static would not exceed Coulomb friction."""
        friction = dict(zip(names, q, strict=True))
        if friction.get(STATIC, servo.friction.static) > friction.get(COULOMB, servo.friction.coulomb):
            return q
        return np.array(
            [high[i] if name == STATIC else low[i] if name == COULOMB else q[i] for i, name in enumerate(names)]
        )

    random = np.random.default_rng(np.random.SeedSequence(seed))
    favourable = np.where([name == STATIC for name in names], high, low)
    corners = [np.where(random.random(low.size) < 0.5, low, high) for _ in range(RANDOM_CORNERS)]
    for q in [np.clip(values_of(servo, names), low, high), *starts, *corners]:
        search.climb(possible(np.array(q, dtype=float)))
    if max(place.gain for place in search.places.values()) <= 0:
        search.climb(favourable)
    inside = [p for p in search.places.values() if (low <= p.q).all() and (p.q <= high).all()]
    best = max(inside, key=lambda p: (p.gain, np.array_equal(p.q, favourable)))
    if best.gain == -np.inf:
        raise NoOrbit(f"no fold in the box was computed: {'; '.join(search.failures)}", Status.NOT_CONVERGED)
    corner = {name: float(value) for name, value in zip(names, best.q, strict=True)}
    return WorstCase(servo.replace(**corner), best.fold, corner, search.evaluations, tuple(search.failures))


# What to make of the three


@dataclass(frozen=True)
class Summary:
    """Linear and solved answers side by side.

    Attributes
    ----------
    linear : (low, high) of `linear_range`.
    mean, std : `linear_moments`.
    linear_quantiles, quantiles : of the linear gains at the samples, and of the solved ones.
    range_name : what `linear` is, "interval" or so many standard deviations.
    relative_error : by place ("worst corner", "5%", "95%"), how far the linear answer is off, relative to the solved.
    misleading : whether, and where, the linear answer misleads.
    """

    linear: tuple[float, float]
    mean: float
    std: float
    linear_quantiles: dict[str, float]
    quantiles: dict[str, float]
    relative_error: dict[str, float]
    misleading: str
    range_name: str


def summary(fold: HuntingFold, uncertainty: Uncertainty, samples: Samples, worst: WorstCase) -> Summary:
    """Compare the linear answer with samples and worst corner, each at the same parameter values."""
    names = uncertainty.parameters
    ok = samples.computed
    linear = linear_gains(fold, names, samples.parameters)
    of_linear = replace(samples, gains=np.where(ok, linear, np.nan)).quantiles()
    solved = samples.quantiles()
    at_worst = float(linear_gains(fold, names, np.array([[worst.corner[name] for name in names]]))[0])
    pairs = {"the worst corner": (at_worst, worst.gain)}
    pairs |= {key: (of_linear[key], solved[key]) for key in ("5%", "95%") if solved}
    errors = {key: a / b - 1 for key, (a, b) in pairs.items() if b > 0}
    said = [
        f"at {key if key.startswith('the') else 'the ' + key + ' quantile of the samples'} "
        f"it gives {pairs[key][0]:.4g}, solving gives {pairs[key][1]:.4g} ({100 * error:+.1f} %)"
        for key, error in errors.items()
        if abs(error) > MISLEADS
    ]
    dead = ok & (samples.gains == 0)
    if dead.any():
        highest = float(linear[dead].max())
        said.append(
            f"{int(dead.sum())} of {int(ok.sum())} samples cannot hunt at all"
            + (f", where it gives up to {highest:.4g}" if highest > 0 else "")
        )
    if linear_range(fold, uncertainty)[0] <= 0:
        said.append("its lower end is no gain (not positive)")
    if said:
        text = "the linear answer misleads: " + "; ".join(said)
    else:
        largest = max((abs(e) for e in errors.values()), default=0.0)
        text = (
            f"the linear answer does not mislead here: within {100 * largest:.2g} % of the solved one at the worst "
            "corner and at the 5% and 95% quantiles of the samples"
        )
    mean, std = linear_moments(fold, uncertainty)
    return Summary(
        linear=linear_range(fold, uncertainty),
        mean=mean,
        std=std,
        linear_quantiles=of_linear,
        quantiles=solved,
        relative_error={key.removeprefix("the "): error for key, error in errors.items()},
        misleading=text,
        range_name="interval" if uncertainty.covariance is None else f"+- {uncertainty.sigmas:g} standard deviations",
    )
