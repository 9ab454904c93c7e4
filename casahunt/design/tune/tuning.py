"""The controller that costs least and does not hunt: gain, and controller times where they are free.

    minimise    c(K, tau_d, tau_i)                    gain, high-frequency gain or settling time    (demands.py)
    subject to  K >= (1 + margin) K_fold              for every servo of the uncertainty set
                phase margin, gain margins, delay     for the linear loop of every servo of the set (loop_set.py)
                torque of the motor on a step         kp (step), with which it begins; simulated besides (check.py)
                bounds on K, tau_d, tau_i

The search (search.py) takes the worst servos for fold and loops as cutting planes; what the answer rests on
besides is computed apart from it (check.py).  Servos of the set that the check finds worse join, and the search
goes on from there.

None of that is a proof: a fold is the largest gain on the branch that is found, the minimum is a local one, the worst
servo the worst that is found, and the delay is in the linear loop only.

Source of the hunting condition: the fold ends hunting (report DCT 2001.021, section 5); symbols as in servo/servo.py.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...axis_units import in_its_units
from ...checks import choice_of, of_kind
from ...errors import InputError, Status
from ...orbits import Options
from ...results import Result
from ...servo.friction import Model
from ...servo.linear.sampled_loop import Lag
from ...servo.parts.loop import Loop
from ...servo.servo import Servo, flatten
from ..nearby import check_asked
from ..sensitivity import fold_sensitivities
from ..uncertainty.set import Uncertainty, check_box
from ..uncertainty.summary import linear_range
from .best_gain import Answer, Given
from .check import Verification, verified
from .demands import COSTS, Demands, check_bounds, cost_of, log_numbers, silent
from .search import TuningSearch

REPAIRS = 3
"""Most times that the check may find servos worse than the worst."""
PROVES_NOT = (
    "The fold ends the symmetric hunting cycle that was found; the scan of the event map speaks against all cycles "
    "with sticking, lopsided ones too, but not against cycles without.",
    "The scan and the simulated tasks are samples: they find what is there to be found, and prove no absence.",
    "Optimum and worst friction are local; a better tuning, or a worse friction inside the set, may exist.",
    "Friction outside the set, flexibility, noise, backlash and saturation are not in the model.",
)
PROVES_NOT_OF_PARTS = (
    "The fold ends the hunting cycle that was found; motions from rest speak against others, and prove no absence.",
    PROVES_NOT[2],
    "Friction outside the set, and what is none of the parts, noise and backlash among it, are not in the model.",
)
INSIDE_SENTENCE = (
    "Inside of the uncertainty set the worst servo is searched for, from its corners and from samples; a worse one "
    "that is not near any of them may exist."
)
DELAY_SENTENCE = "The delay is in the margins of the linear loop only; fold, scan and simulation are without it."


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(Result):
    """A tuned servo.

    Attributes
    ----------
    model, before : the problem: friction model and the servo given; a loop of parts has no model.
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

    Examples
    --------
    >>> from casahunt import Servo, tune
    >>> tuning = tune(Servo(), "switch")
    >>> tuning.status.ok, round(tuning.gain / tuning.fold_gain, 3)
    (True, 1.1)
    """

    _quantities = (
        "model", "gain [V/rad]", "cost", "cost_value", "fold_gain [V/rad]", "binding", "status",
    )  # fmt: skip
    _details = (
        "cost_gain_only = gain_only", "demands", "free", "bounds", "verification", "rounds", "evaluations",
        "wall_s [s]",
    )  # fmt: skip

    model: Model | None
    before: Any
    servo: Any
    gain: float
    cost: str
    cost_value: float
    gain_only: float | None
    demands: Demands
    free: tuple[str, ...]
    bounds: dict[str, tuple[float, float]]
    worst: Any
    corner: dict[str, float]
    uncertainty: Uncertainty | None
    fold_gain: float
    binding: tuple[str, ...]
    verification: Verification
    rounds: int
    evaluations: int
    wall_s: float

    def _more(self) -> dict[str, Any]:
        what, _, unit = COSTS[self.cost].rpartition(" [")
        fold, nominal = self.verification.fold, self.verification.nominal_fold
        linear = self.uncertainty is not None and nominal is not None
        names = dict.fromkeys((*self.servo.controller_names, *(n for n in self.free if n in self.servo.names)))
        low, high = linear_range(nominal, self.uncertainty) if linear else (None, None)  # type: ignore[arg-type]
        return {
            **{name.removeprefix("controller."): self.servo.value(name) for name in names},
            "cost_meaning": what,
            "cost_unit": unit.rstrip("]"),
            "margin": self.demands.margin,
            "worst": {"corner": self.corner, "fold_gain": self.fold_gain, "evaluations": self.evaluations},
            "fold": {
                "nominal": nominal.value if nominal is not None else None,
                "error": nominal.value_error if nominal is not None else None,
                "amplitude": nominal.orbit.amplitude if nominal is not None else None,
                "period": nominal.orbit.period if nominal is not None else None,
                "linear_low": low,
                "linear_high": high,
            },
            "elasticities": fold_sensitivities(fold).elasticities if fold is not None else {},
            "proves_not": [
                *(PROVES_NOT if self.model is not None else PROVES_NOT_OF_PARTS),
                *[INSIDE_SENTENCE] * bool(self.corner), *[DELAY_SENTENCE] * (self.demands.lag != Lag()),
            ],
            "servo": flatten(self.before) if self.model is not None else self.before.parameters,
        }  # fmt: skip

    @property
    def status(self) -> Status:
        """CONVERGED where the verification has nothing against it."""
        return Status.CONVERGED if self.verification.ok else Status.NOT_CONVERGED


@in_its_units
def tune(
    servo: Servo | Loop,
    model: Model | None = None,
    *,
    demands: Demands | None = None,
    uncertainty: Uncertainty | None = None,
    free: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    cost: str = "gain",
    options: Options | None = None,
    report: Callable[[str], None] | None = None,
) -> Tuning:
    """The controller of least cost that does not hunt.

    Parameters
    ----------
    servo, model
        the problem; the controller times are where the search starts.  A loop of parts has no model.
    demands
        margins, delay and sample time, largest torque.
    uncertainty
        a set of servos, each of which must not hunt; default: this servo alone.
    free
        numbers of the controller to be tuned besides the gain: "lead_time", "integral_time", or of a controller by
        gains up to two of "kp", "ki", "kd"; of a loop up to two of its controller's and its filters' parameters.
    bounds
        (low, high) of "gain" [V/rad] and of free times [s]; a free time may double or halve by default.
    cost, options
        one of `COSTS`; tolerance of every fold.
    report
        called, often, with a sentence that says where the computation is.

    Returns
    -------
    Tuning: the controller, the folds and loops that bound it, and its verification.

    Raises
    ------
    InputError : a value out of range, or an unknown name.
    NoOrbit : the task cannot be met, and what is in the way; or a fold was not computed.

    Examples
    --------
    >>> from casahunt import Servo, tune
    >>> tuning = tune(Servo(), "switch")
    >>> round(tuning.gain, 3), tuning.binding  # V/rad
    (0.712, ('hunting margin',))
    """
    began = time.perf_counter()
    check_asked(servo, model)
    choice_of("cost", cost, COSTS)
    demands = of_kind("demands", demands or Demands(), Demands)
    options = of_kind("options", options or Options(), Options)
    free = tuple(dict.fromkeys(free if not isinstance(free, str) else [free]))
    limits = check_bounds(servo, free, bounds or {})
    _check_set(servo, uncertainty, free)
    given = Given(servo, model, demands, uncertainty, free, limits, cost, options, report or silent)
    search = TuningSearch(given)
    answer = search.run()
    verification = verified(answer, given)
    for _ in range(REPAIRS):
        if verification.set_check is None or not verification.set_check.above:
            break
        answer = search.again(log_numbers(answer.servo, given.numbers), list(verification.set_check.above))
        verification = verified(answer, given)
    return _tuning(search, answer, verification, began)


def _tuning(search: TuningSearch, answer: Answer, verification: Verification, began: float) -> Tuning:
    """The answer with what it was asked for and what supports it."""
    given, worst = search.given, answer.worst
    bounds = {"gain": given.gains((1 + given.demands.margin) * worst.gain, answer.servo), **given.limits}
    return Tuning(
        model=given.model,
        before=given.servo,
        servo=answer.servo,
        gain=answer.gain,
        cost=given.cost,
        cost_value=cost_of(given.cost, answer.servo, answer.gain),
        gain_only=search.gain_only,
        demands=given.demands,
        free=given.free,
        bounds=bounds,
        worst=worst.servo,
        corner=worst.corner,
        uncertainty=given.uncertainty,
        fold_gain=worst.gain,
        binding=answer.binding,
        verification=verification,
        rounds=search.rounds,
        evaluations=given.evaluations,
        wall_s=time.perf_counter() - began,
    )


def _check_set(servo: Servo | Loop, uncertainty: Uncertainty | None, free: Sequence[str]) -> None:
    for name in () if isinstance(servo, Loop) else servo.controller_names:
        if servo.value(name) == 0:
            raise InputError(f"{name} = 0: must be greater than 0 to tune (there is no phase margin)")
    if uncertainty is None:
        return
    check_box(servo, uncertainty)
    for name, low in zip(uncertainty.parameters, uncertainty.box(servo)[0], strict=True):
        if name.removeprefix("controller.") in free:
            raise InputError(f"free {name.removeprefix('controller.')}: must be left out, it is in the uncertainty set")
        if name in servo.controller_names and low <= 0:
            raise InputError(f"{name} = {low:g} in the uncertainty set: must be greater than 0 to tune")
