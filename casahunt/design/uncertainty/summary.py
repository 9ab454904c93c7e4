"""Linear answer, samples and worst corner side by side.

    K(q) ~ K(q0) + g . (q - q0),    g = dK/dq at q0, exact (design/sensitivity.py)
    box: low, high = K(q0) + sum_i min, max(g_i (l_i - q0_i), g_i (h_i - q0_i));    covariance: std^2 = g . C g
    relative error of the linear answer = K_linear/K_solved - 1, both at the same parameters

It misleads from an error of 2 % on, where a sample cannot hunt at all, or where its lower end is no gain.

Units: K in V/rad.  Symbols: k uncertain parameters, n servos, g (k,) gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...results import Result
from ..nearby import AnyFold, values_of
from .samples import Samples
from .set import Array, Uncertainty
from .worst_corner import WorstCase, gradient

MISLEADS = 0.02
"""Relative error of a fold gain from which the linear answer is said to mislead."""


@dataclass(frozen=True, repr=False)
class Summary(Result):
    """Linear and solved answers side by side.

    Attributes
    ----------
    linear : (low, high) of `linear_range`.
    mean, std : `linear_moments`.
    linear_quantiles, quantiles : of the linear gains at the samples, and of the solved ones.
    range_name : what `linear` is, "interval" or so many standard deviations.
    relative_error : by place ("worst corner", "5%", "95%"), how far the linear answer is off, relative to the solved.
    misleading : whether, and where, the linear answer misleads.

    Examples
    --------
    >>> from casahunt import Servo, Uncertainty, compare_uncertainty, find_fold, sample_fold_gains, worst_corner
    >>> servo, uncertainty = Servo(), Uncertainty({"friction.static": (0.525, 0.535)})
    >>> fold = find_fold(servo, "switch")
    >>> given = servo, "switch", uncertainty
    >>> samples, worst = sample_fold_gains(*given, 8, fold=fold), worst_corner(*given, fold=fold)
    >>> seen = compare_uncertainty(fold, uncertainty, samples, worst)
    >>> [round(gain, 3) for gain in seen.linear]
    [0.61, 0.684]
    """

    _quantities = ("linear [V/rad]", "mean [V/rad]", "std [V/rad]", "misleading")
    _details = ("range_name", "quantiles", "linear_quantiles", "relative_error")

    linear: tuple[float, float]
    mean: float
    std: float
    linear_quantiles: dict[str, float]
    quantiles: dict[str, float]
    relative_error: dict[str, float]
    misleading: str
    range_name: str

    def _more(self) -> dict[str, Any]:
        low, high = self.linear
        return {"linear": {"low": low, "high": high, "std": self.std}}


def summary(fold: AnyFold, uncertainty: Uncertainty, samples: Samples, worst: WorstCase) -> Summary:
    """Compare the linear answer with samples and worst corner, each at the same parameter values.

    Parameters
    ----------
    fold
        of the nominal servo, where the gain is linearised.
    uncertainty
        of its parameters.
    samples, worst
        what was solved.

    Returns
    -------
    Summary, with a sentence that says whether the linear answer misleads.

    Examples
    --------
    >>> from casahunt import Servo, Uncertainty, compare_uncertainty, find_fold, sample_fold_gains, worst_corner
    >>> servo, uncertainty = Servo(), Uncertainty({"friction.static": (0.525, 0.535)})
    >>> fold = find_fold(servo, "switch")
    >>> given = servo, "switch", uncertainty
    >>> samples, worst = sample_fold_gains(*given, 8, fold=fold), worst_corner(*given, fold=fold)
    >>> compare_uncertainty(fold, uncertainty, samples, worst).relative_error["worst corner"] < 0.01
    True
    """
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


def linear_range(fold: AnyFold, uncertainty: Uncertainty) -> tuple[float, float]:
    """Range of the linearised fold gain.

    fold: where it is linearised.
    Returns (low, high) [V/rad]: extremes over the intervals; mean -+ sigmas std for a covariance.
    """
    if uncertainty.covariance is not None:
        mean, std = linear_moments(fold, uncertainty)
        return mean - uncertainty.sigmas * std, mean + uncertainty.sigmas * std
    g, q = gradient(fold, uncertainty.parameters), values_of(fold.orbit.problem, uncertainty.parameters)
    ends = np.array([g * (bound - q) for bound in uncertainty.box(fold.orbit.problem)])
    return fold.value + float(ends.min(axis=0).sum()), fold.value + float(ends.max(axis=0).sum())


def linear_moments(fold: AnyFold, uncertainty: Uncertainty) -> tuple[float, float]:
    """Moments of the linearised fold gain, with uniform distributions on intervals.

    fold: where it is linearised. Returns (mean, standard deviation) [V/rad].
    """
    g, problem = gradient(fold, uncertainty.parameters), fold.orbit.problem
    if uncertainty.covariance is not None:
        return fold.value, float(np.sqrt(max(g @ uncertainty.covariance @ g, 0.0)))
    low, high = uncertainty.box(problem)
    shift = float(g @ ((low + high) / 2 - values_of(problem, uncertainty.parameters)))
    return fold.value + shift, float(np.linalg.norm(g * uncertainty.std))


def linear_gains(fold: AnyFold, names: Sequence[str], rows: Array) -> Array:
    """Linearised fold gains.

    fold: where it is linearised; rows: (n, k) their values. Returns (n,) [V/rad].
    """
    return fold.value + (rows - values_of(fold.orbit.problem, names)) @ gradient(fold, names)
