"""What `casahunt fold-curve` says: where hunting ends, while another parameter runs over a range."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...checks import to_error
from ...continuation import SpecialCurve
from ...design.fold_curve.data import FoldCurve
from ...servo.units import with_unit
from .answer import Answer, short
from .fold import PLAIN_DECIMALS, sensitivity_text

PLAIN_ROW, ROW = "  {:>26s} {:>11s} {:>13s} {:>9s} {:>8s}", "  {:>26s} {:>16s} {:>13s} {:>9s} {:>8s}"
"""A row: the parameter, where hunting ends, amplitude and period there, per cent."""
HEADINGS = "amplitude rad", "period s", "%"


def fold_curve_answer(curves: Sequence[FoldCurve], tol: float) -> Answer:
    """What is said of the curves of a servo."""
    return Answer([line for curve in curves for line in _plain(curve)], _details(curves, tol))


def _plain(curve: FoldCurve) -> Iterator[str]:
    yield f"{curve.model} servo: where hunting ends, at {len(curve.points)} values of {curve.vary}; {curve.ended}"
    yield PLAIN_ROW.format(curve.vary, "gain V/rad", *HEADINGS)
    for point in curve.points:
        numbers = (short(x, point.error_estimate) for x in (point.gain, point.orbit.amplitude, point.orbit.period))
        yield PLAIN_ROW.format(f"{point.value:.6g}", *numbers, sensitivity_text(point.elasticity, 0.0, PLAIN_DECIMALS))
    yield f"  {with_unit(curve.vary)}; gain: up to which the servo can hunt; amplitude and period there;"
    yield f"  %: change of that gain for one per cent more of {curve.vary}"


def _details(curves: Sequence[FoldCurve], tol: float) -> Iterator[str]:
    for curve in curves:
        yield ROW.format(curve.vary, "gain V/rad", *HEADINGS)
        for point in curve.points:
            numbers = (
                to_error(value, point.error_estimate, most=most)
                for value, most in ((point.gain, 9), (point.orbit.amplitude, 7), (point.orbit.period, 7))
            )
            yield ROW.format(f"{point.value:.9g}", *numbers, sensitivity_text(point.elasticity, tol))
        for point in curve.cusps:
            yield f"  cusp at {curve.vary} = {point.value:.9g}"
        yield f"  {curve.wall_s:.2f} s"


def loop_curve_answer(curve: SpecialCurve, way: str, parts: str, named: tuple[str, str], tol: float) -> Answer:
    """What is said of the curve of a loop of parts.

    way: "up" where it hunts below the curve; parts: a line; named: the two parameters with their units.
    """
    rows = [
        (q, x, orbit, max(error, orbit.error_estimate), slope * q / x)
        for orbit, error, slope, (x, q) in zip(curve.orbits, curve.errors, curve.slopes, curve.values, strict=True)
    ]
    plain = [f"loop: {len(rows)} points; {curve.ended}", parts, ROW.format(curve.other, curve.vary, *HEADINGS)]
    for q, x, orbit, error, slope in rows:
        numbers = (short(number, error) for number in (x, orbit.amplitude, orbit.period))
        plain.append(ROW.format(f"{q:.6g}", *numbers, sensitivity_text(slope, 0.0, PLAIN_DECIMALS)))
    plain += [
        f"  {named[1]}; {named[0]}: {way} to which the loop can hunt;",
        f"  amplitude and period there; %: change of it for one per cent more of {curve.other}",
    ]

    def details() -> Iterator[str]:
        for q, x, orbit, error, slope in rows:
            numbers = (
                to_error(number, error, most=most)
                for number, most in ((x, 9), (orbit.amplitude, 7), (orbit.period, 7))
            )
            yield ROW.format(f"{q:.9g}", *numbers, sensitivity_text(slope, tol))
        for q in curve.values[curve.turns, 1]:
            yield f"  cusp at {curve.other} = {q:.9g}"
        yield f"  {curve.wall_s:.2f} s"

    return Answer(plain, details())
