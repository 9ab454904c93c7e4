"""casahunt fold: the largest gain at which the servo can hunt, and the largest one with a stable cycle.

Key `stable` of the JSON object: see views/answers/fold.py; `as_built`: as of orbit; `beyond`: what the drive may do at
higher gains, or null.  Of a loop of parts: the border of hunting in any parameter; `parameters` are those at the fold,
`way` is "up" where the loop hunts below it; `other` what hunts a little beyond it all the same, or null.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...axis_units import word
from ...design.sensitivity import fold_sensitivities
from ...results import tables_of
from ...servo.find_fold import find_fold
from ...servo.parts.verbs import beyond_fold, loop_fold
from ...servo.stable_up_to import stable_ranges
from ..answers.answer import angle, called, item, parts_of, record_of, runs_away, short
from ..answers.fold import WHAT_TO_DO, fold_answer, stability_of, value_of
from .arguments import Asked, add_command, add_solver, add_vary
from .console import orbit_line
from .output import give
from .progress import tell
from .sampled import seen_by_encoder


def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "the largest gain at which the servo can hunt"
    command = add_command(commands, "fold", about, model="", csv="the sensitivities", plot="the sensitivities")
    add_vary(command, "in which hunting ends")
    add_solver(command)


WAS_FOLLOWED = "the hunting that was followed goes"
"""Said where other hunting may go on."""


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    (servo, model), how, vary = options.subject(), options.how(), options.varied()
    fold, other = (find_fold(servo, model, vary=vary, options=how), None) if model else loop_fold(servo, vary, how)
    slopes, orbit = fold_sensitivities(fold), fold.orbit
    more: dict[str, Any] = {"elasticities": slopes.elasticities, "solver": how.solver}
    ranges, way = stable_ranges(fold, None if model else servo), "up" if fold.sense > 0 else "down"
    more["stable"] = stable = stability_of(fold, ranges)
    possible, last, named, name = "hunting is possible", stable["value"], word(vary), called(servo, model)
    if model:
        below, built = seen_by_encoder(options, orbit.amplitude, beyond=True)
        more |= built
    else:
        at_fold = servo.replace(**{vary: fold.value})
        below = [*runs_away(at_fold), *parts_of(servo)]
        more |= {key: getattr(orbit, key) for key in ("amplitude", "amplitude_error", "period", "period_error")}
        more |= {"way": way, **record_of(at_fold), "other": None}
        possible = possible if vary == "gain" else WAS_FOLLOWED
        if other is not None:
            at, possible = beyond_fold(fold), WAS_FOLLOWED
            more["other"] = {vary: at, "amplitude": other.amplitude}
            low, high = np.broadcast_to(other.amplitude, 2)
            far = angle(float(low)) if low == high else f"{angle(float(low))} to {angle(float(high))}"
            said = f"at {named} {value_of(vary, at)} other hunting, of {far}: casahunt orbit"
            below = [item("beyond it", f"{said}; where that ends is not known"), *below]
    tell(orbit_line(orbit, mu="+1 (fold)", vary=vary))
    first = value_of(vary, fold.value, short, fold.value_error)
    head = f"{name}: {possible} {way} to {named} {first}"
    if last is not None and last != fold.value:
        ends = value_of(vary, last)
        head = f"{name}: {WAS_FOLLOWED} {way} to {named} {ends}; its cycles go on, unstable, to their fold at {first}"
    answer = fold_answer(head, fold, slopes, ranges, how, WHAT_TO_DO if model else "", below)
    picture = "fold_curve.elasticities", [fold], [slopes]
    give(options, fold.to_dict(table=False) | more, answer, table=tables_of([slopes]), picture=picture)
    return 0
