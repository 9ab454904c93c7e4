"""casahunt uncertainty: the fold gain of a servo whose parameters are not known exactly."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from ... import effort
from ...axis_units import quantity, word
from ...checks import to_error
from ...design.nearby import AnyFold, check_asked, upper
from ...design.uncertainty.samples import Samples, draw, sample
from ...design.uncertainty.summary import Summary, summary
from ...design.uncertainty.worst_corner import WorstCase, worst_corner
from ...errors import NoOrbit, Status
from ...results import tables_of
from ...servo.find_fold import find_fold
from ...servo.units import unit_of
from ..answers.answer import HARD_SPACE, Answer, called, item, record_of, short
from .arguments import Asked, add_command, count_of
from .console import orbit_line
from .output import give
from .pool import jobs_of, processes
from .progress import say, tell, teller

DEFAULT_SAMPLES = 200
"""The 5 and 95 % quantiles are then known to a fiftieth of the distribution: sqrt(0.05 0.95 / 200) = 0.015."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "uncertainty", "the fold gain where parameters are not known exactly", model="",
        csv="the samples: parameters and fold gain of each", plot="the fold gains (histogram)",
    )  # fmt: skip
    command.add_required(
        "--uncertainty", example="friction.toml", metavar="FILE.toml",
        help='intervals or a covariance of parameters: below [interval] lines such as "friction.static" = "5%%"',
    )  # fmt: skip
    samples = f"servos to solve (default {DEFAULT_SAMPLES})"
    command.add_argument("--samples", default=DEFAULT_SAMPLES, metavar="N", help=samples)
    command.add_argument("--jobs", default=1, metavar="J", help="processes (default 1)")
    command.add_argument("--seed", default=0, metavar="S", help="of the samples (default 0)")


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    how = options.how()
    n, jobs = count_of("samples", options.samples, 1), jobs_of(options)
    seed = count_of("seed", options.seed, 0)
    servo, model = options.subject()
    check_asked(servo, model)
    uncertainty = options.uncertainty_of(servo)
    assert uncertainty is not None  # the command requires it
    draw(servo, uncertainty, n, seed=seed)  # refuse impossible samples before anything is computed
    tell("computing the fold of the servo itself")
    fold = upper(find_fold(servo, model, options=how))
    tell(orbit_line(fold.orbit, mu="+1 (fold)"))
    tell(f"solving {n} samples in {jobs} process{'es' if jobs > 1 else ''}")
    told, since = teller(), time.monotonic()
    with processes(jobs) as pool:
        samples = sample(
            servo, model, uncertainty, n, seed=seed, executor=pool, options=how, fold=fold,
            report=lambda i: told(f"{i} of {n} samples solved{effort.left(i, n, since)}"),
        )  # fmt: skip
    tell(f"{int(samples.computed.sum())} of {n} computed; searching the worst corner")
    low, high = uncertainty.box(servo)
    sampled = [] if samples.worst is None else [samples.parameters[samples.worst]]
    worst = worst_corner(
        servo, model, uncertainty, options=how, fold=fold,
        starts=[q for q in sampled if ((low <= q) & (q <= high)).all()],  # normal ones may lie outside of the box
        report=lambda i: told(f"searching the worst corner: fold {i}"),
    )  # fmt: skip
    seen = summary(fold, uncertainty, samples, worst)
    wall_s = options.outputs.seconds
    answer = uncertainty_answer(called(servo, model), fold, samples, worst, seen, how.tol, wall_s)
    complete = not samples.failures and not worst.failures
    record = {
        **record_of(servo),
        **seen.to_dict(table=False),
        "model": model,
        "gain": fold.value,
        "worst": worst,
        "samples": {**samples.to_dict(table=False), "failures": len(samples.failures)},
        "status": (Status.CONVERGED if complete else Status.NOT_CONVERGED).name.lower(),
        "wall_s": wall_s,
    }
    picture = "uncertainty.histogram", fold, samples, worst, seen
    give(options, record, answer, table=tables_of([samples]), picture=picture)
    for i, sentence in samples.failures:
        say(f"sample {i + 1} was not computed: {sentence}")
    for sentence in worst.failures:
        say(f"in the search for the worst corner: {sentence}")
    if not samples.computed.any():
        raise NoOrbit(f"none of the {n} samples was computed: {samples.failures[0][1]}", Status.NOT_CONVERGED)
    return 0


# What `casahunt uncertainty` says of a servo whose parameters are not known exactly


def uncertainty_answer(
    title: str, fold: AnyFold, samples: Samples, worst: WorstCase, seen: Summary, tol: float, wall_s: float
) -> Answer:
    """What is said of fold gains over an uncertainty; title: what the servo is called."""
    gain = short(fold.value, fold.value_error)
    largest = short(worst.gain, worst.fold.value_error if worst.fold is not None else 0.0)
    plain = [
        f"{title}: hunting is possible up to gain {largest} V/rad with the worst values that are "
        f"allowed, up to {gain} V/rad with those given",
        item("what to do", f"choose the gain, with a margin, above {largest} V/rad (casahunt tune)"),
    ]
    if seen.quantiles:
        half, most, top = (short(seen.quantiles[key], tol) for key in ("50%", "95%", "max"))
        said = f"in half of them hunting ends below {half} V/rad, in 95 % below {most}, in the worst at {top}"
        plain.append(item(f"{len(samples.gains)} samples", said))
    plain.append("  the worst values")
    plain += [f"    {word(name):26s} {quantity(value, unit_of(name), '.8g')}" for name, value in worst.corner.items()]
    return Answer(plain, _details(fold, samples, worst, seen, tol, wall_s))


def _details(
    fold: AnyFold, samples: Samples, worst: WorstCase, seen: Summary, tol: float, wall_s: float
) -> Iterator[str]:
    error = fold.value_error
    yield item("as given", f"up to gain {to_error(fold.value, error)} V/rad")
    low, high = (to_error(value, error, most=6) for value in seen.linear)
    spread = to_error(seen.std, tol, most=3)
    yield item("linearised", f"{low} to {high} V/rad ({seen.range_name}; standard deviation {spread})")
    if seen.quantiles:
        shown = ", ".join(f"{key}{HARD_SPACE}{to_error(value, tol, most=6)}" for key, value in seen.quantiles.items())
        yield item(f"{len(samples.gains)} samples", shown)
    largest = to_error(worst.gain, worst.fold.value_error if worst.fold is not None else 0.0)
    yield item("worst corner", f"{largest} V/rad ({worst.evaluations} folds computed)")
    yield f"  {seen.misleading}"
    yield f"  {wall_s:.1f} s"
