"""What `casahunt uncertainty` says of a servo whose parameters are not known exactly."""

from __future__ import annotations

from collections.abc import Iterator

from ...axis_units import quantity, word
from ...checks import to_error
from ...design.nearby import AnyFold
from ...design.uncertainty.samples import Samples
from ...design.uncertainty.summary import Summary
from ...design.uncertainty.worst_corner import WorstCase
from ...servo.units import unit_of
from .answer import HARD_SPACE, Answer, item, short


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
