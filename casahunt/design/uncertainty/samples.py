"""Fold gains of servos drawn from the uncertainty.

    q_j uniform in the box, or    q_j = q0 + D R z_j:    D = diag sqrt(C_ii), R R = D^-1 C D^-1, z_j standard normal

Of the box, what is no servo is left out (set.py).

Units: K in V/rad.  Symbols: k uncertain parameters, n samples.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from ...checks import of_kind, quoted
from ...errors import InputError
from ...export import Columns
from ...orbits import Options
from ...results import Result
from ...servo.friction import Model
from ...servo.parts.loop import Loop
from ...servo.servo import Servo
from ...servo.units import GAIN_UNIT, column
from ..ensemble import folds_of
from ..nearby import AnyFold, are_servos, check_asked, nominal_fold, servo_at, values_of
from .set import Array, Uncertainty, check_box

MOST_SAMPLES = 1_000_000
"""Beyond so many the folds would take days."""
DRAWN_FOR_A_SAMPLE = 1000
"""Points of the box that are drawn for a sample, on average: where fewer of them are servos, hardly any is."""
QUANTILES = {"min": 0.0, "5%": 0.05, "25%": 0.25, "50%": 0.5, "75%": 0.75, "95%": 0.95, "max": 1.0}
"""Quantiles of the sampled fold gains."""


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Result):
    """Solved samples.

    Attributes
    ----------
    names : the k uncertain parameters.
    parameters : (n, k) their values.
    gains : (n,) fold gains; 0 where a proof shows that no gain hunts, nan where the fold was not computed.
    failures : (index, sentence) of every sample that was not computed.
    tolerance : bound on the estimated relative error of every gain.

    Examples
    --------
    >>> from casahunt import Servo, Uncertainty, sample_fold_gains
    >>> samples = sample_fold_gains(Servo(), "switch", Uncertainty({"friction.static": (0.52, 0.54)}), 8)
    >>> int(samples.computed.sum()), list(samples.quantiles())[:3]
    (8, ['min', '5%', '25%'])
    """

    _quantities = ("names", "n = gains.size", "quantiles")
    _details = ("failures",)

    names: tuple[str, ...]
    parameters: Array
    gains: Array
    failures: tuple[tuple[int, str], ...]
    tolerance: float

    @property
    def computed(self) -> Array:
        """(n,) bool."""
        return np.isfinite(self.gains)

    @property
    def worst(self) -> int | None:
        """Index of the largest fold gain; None where none was computed."""
        return int(np.nanargmax(self.gains)) if self.computed.any() else None

    def quantiles(self) -> dict[str, float]:
        """Quantiles (`QUANTILES`) of the fold gains that were computed; empty where none was."""
        gains = self.gains[self.computed]
        return {key: float(np.quantile(gains, level)) for key, level in QUANTILES.items()} if gains.size else {}

    def _columns(self) -> Columns:
        sentences, gains = dict(self.failures), self.gains.tolist()
        parameters = zip(self.names, self.parameters.T, strict=True)
        return {
            "sample": [i + 1 for i in range(len(gains))],
            **{column(name): values for name, values in parameters},
            column("fold_gain", GAIN_UNIT): gains,
            column("fold_gain_error", GAIN_UNIT): [self.tolerance * gain for gain in gains],
            "status": [sentences.get(i, "converged" if gain else "hunts at no gain") for i, gain in enumerate(gains)],
        }


def draw(servo: Servo | Loop, uncertainty: Uncertainty, n: int, *, seed: int = 0) -> Array:
    """Parameter values: uniform in the intervals, where they are of a servo, or normal about the servo's values.

    servo, uncertainty: the servo, and k of its parameters as they may be; seed: >= 0, of the random numbers. Returns
    (n, k); the first rows do not depend on n. Raises InputError: n or seed is no such number, hardly any value of the
    intervals is of a servo, or a normal one is not, for example with static below Coulomb friction.
    """
    if isinstance(n, bool) or int(n) != n or n < 1:
        raise InputError(f"samples = {quoted(n)}: must be a whole number, at least 1")
    if n > MOST_SAMPLES:
        raise InputError(f"samples = {quoted(n)}: must be at most {MOST_SAMPLES} (each is a fold to be computed)")
    if isinstance(seed, bool) or int(seed) != seed or seed < 0:
        raise InputError(f"seed = {seed!r}: must be a whole number, at least 0")
    random = np.random.default_rng(np.random.SeedSequence(int(seed)))
    names, (low, high) = uncertainty.parameters, uncertainty.box(servo)
    if uncertainty.covariance is None:  # the first n servos of a sequence of points of the box
        rows = np.empty((0, len(names)))
        for _ in range(DRAWN_FOR_A_SAMPLE):
            drawn = low + (high - low) * random.random((int(n), len(names)))
            rows = np.vstack([rows, drawn[are_servos(servo, names, drawn)]])[:n]
            if len(rows) == n:
                break
        else:
            few = f"of {int(n) * DRAWN_FOR_A_SAMPLE} values drawn only {len(rows)} are of a servo"
            raise InputError(f"{few}, the others have static below Coulomb friction; narrow one of the intervals")
    else:
        # The symmetric root exists for a singular matrix too, and has no sign to choose; of the correlations,
        # because the variances differ by many orders of magnitude.
        std = np.where(uncertainty.std > 0, uncertainty.std, 1.0)
        w, v = np.linalg.eigh(uncertainty.covariance / np.outer(std, std))
        root = (v * np.sqrt(np.maximum(w, 0))) @ v.T
        rows = values_of(servo, names) + std * (random.standard_normal((int(n), len(names))) @ root)
    for i, q in enumerate(rows):
        try:
            servo_at(servo, names, q)
        except InputError as error:
            raise InputError(f"sample {i + 1} of {n}: {error}; make the uncertainty smaller") from None
    return rows


def sample(
    servo: Servo | Loop,
    model: Model | None,
    uncertainty: Uncertainty,
    n: int,
    *,
    seed: int = 0,
    executor: Executor | None = None,
    options: Options | None = None,
    fold: AnyFold | None = None,
    report: Callable[[int], None] | None = None,
) -> Samples:
    """Fold gains of n servos drawn from the uncertainty.

    Every sample starts from the fold that the servo's own one predicts for it, none from another sample: results depend
    neither on the executor nor on the order.

    Parameters
    ----------
    servo, model, uncertainty, n
        the problem; a loop of parts has no model.
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
        called with the number of samples solved so far, batch after batch (ensemble.py).

    Returns
    -------
    Samples; a servo that provably cannot hunt has the fold gain 0, one without a fold within reach a sentence.

    Raises
    ------
    InputError : a sample out of range.

    Examples
    --------
    >>> from casahunt import Servo, Uncertainty, sample_fold_gains
    >>> uncertainty = Uncertainty({"friction.static": (0.52, 0.54)})
    >>> gains = sample_fold_gains(Servo(), "switch", uncertainty, 8, seed=1).gains
    >>> bool(((0.57 < gains) & (gains < 0.73)).all())
    True
    """
    check_asked(servo, model)
    check_box(servo, uncertainty)
    options = of_kind("options", options or Options(), Options)
    names = uncertainty.parameters
    rows = draw(servo, uncertainty, n, seed=seed)
    found = folds_of(
        servo, model, names, rows, options=options, fold=nominal_fold(servo, model, options, fold), executor=executor,
        report=report,
    )  # fmt: skip
    return Samples(names, rows, found.gains, found.failures, options.tol)
