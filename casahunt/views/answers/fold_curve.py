"""What `casahunt fold-curve` says: where hunting ends, while another parameter runs over a range."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...checks import to_error
from ...design.fold_curve import FoldCurve
from ...servo.parts.table import unit_of
from .answer import Answer, called, named, parts_of, short
from .fold import PLAIN_DECIMALS, sensitivity_text

PLAIN_ROW, ROW = "  {:>26s} {:>11s} {:>13s} {:>9s} {:>8s}", "  {:>26s} {:>16s} {:>13s} {:>9s} {:>8s}"
"""A row: the parameter, where hunting ends, amplitude and period there, per cent."""
HEADINGS = "amplitude rad", "period s", "%"


def fold_curve_answer(curves: Sequence[FoldCurve], tol: float) -> Answer:
    """What is said of the curves of a servo."""
    return Answer([line for curve in curves for line in _plain(curve)], _details(curves, tol))


def _border(curve: FoldCurve) -> str:
    """The heading of the parameter in which hunting ends."""
    return f"{curve.fold_in} {unit_of(curve.fold_in)}".rstrip()


def _plain(curve: FoldCurve) -> Iterator[str]:
    whose, what = ("loop", curve.fold_in) if curve.model is None else ("servo", "that gain")
    name = called(curve.servo, curve.model)
    yield f"{name}: where hunting ends, at {len(curve.points)} values of {curve.vary}; {curve.ended}"
    yield from parts_of(curve.servo)
    yield PLAIN_ROW.format(curve.vary, _border(curve), *HEADINGS)
    for point in curve.points:
        numbers = (short(x, point.error_estimate) for x in (point.border, point.orbit.amplitude, point.orbit.period))
        yield PLAIN_ROW.format(f"{point.value:.6g}", *numbers, sensitivity_text(point.elasticity, 0.0, PLAIN_DECIMALS))
    can = f"{curve.way} to which the {whose} can hunt"
    yield f"  {named(curve.vary)}; {curve.fold_in}: {can}; amplitude and period there;"
    yield f"  %: change of {what} for one per cent more of {curve.vary}"


def _details(curves: Sequence[FoldCurve], tol: float) -> Iterator[str]:
    for curve in curves:
        yield ROW.format(curve.vary, _border(curve), *HEADINGS)
        for point in curve.points:
            numbers = (
                to_error(value, point.error_estimate, most=most)
                for value, most in ((point.border, 9), (point.orbit.amplitude, 7), (point.orbit.period, 7))
            )
            yield ROW.format(f"{point.value:.9g}", *numbers, sensitivity_text(point.elasticity, tol))
        for point in curve.cusps:
            yield f"  cusp at {curve.vary} = {point.value:.9g}"
        yield f"  {curve.wall_s:.2f} s"
