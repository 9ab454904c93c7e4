"""casahunt fold-curve of a loop of parts: the border of hunting in one parameter, while another one runs over a range.

Keys of the JSON object: parts, parameters (at the first point), curves: one, with its table, failures, wall_s.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ....checks import to_error
from ....continuation import SpecialCurve, SpecialOrbit, special_curve
from ....errors import InputError
from ....orbits import Options
from ..arguments import finite
from ..console import complain, progress, progress_line, say, sensitivity_text
from ..output import give
from .shared import border_of, named, parts_line, record_of

if TYPE_CHECKING:
    from ....servo.parts import Loop


def of_loop(options: argparse.Namespace, loop: Loop, points: int, how: Options) -> int:
    """Follow and print; returns the exit code."""
    from ....servo.parts.verbs import check_present

    start, end = finite("from", options.start), finite("to", options.to)
    vary, ends_in = options.vary, options.fold_in or "gain"
    loop = loop.replace(**{vary: start})
    check_present(loop, vary)
    if vary == ends_in:
        raise InputError(f"fold-in = {ends_in}: must be another parameter than that of --vary")
    began, stream = time.perf_counter(), progress(options.quiet)
    fold, way = border_of(loop, ends_in, how)

    def found(point: SpecialOrbit) -> None:
        orbit = point.orbit
        say(stream, f"{progress_line(orbit, '+1 (fold)', ends_in)}  {vary} = {orbit.problem.value(vary):.8g}")

    curve = special_curve(fold, fold.parameter, vary, to=end, options=how, points=points, progress=found)
    failures = [] if curve.complete else [curve.ended]
    for failure in failures:
        complain("casahunt fold-curve", failure)
    record = record_of(loop.replace(**{ends_in: fold.value})) | {
        "curves": [curve.to_dict()], "way": way, "failures": failures, "wall_s": time.perf_counter() - began,
    }  # fmt: skip
    picture = ("fold_curve.loop_border", curve, way)
    give(options, record, _lines(loop, curve, way, how.tol), table=curve._columns(), picture=picture)
    return 1 if failures else 0


def _lines(loop: Loop, curve: SpecialCurve, way: str, tol: float) -> Iterator[str]:
    yield f"loop: {len(curve.orbits)} points; {curve.ended}"
    yield parts_line(loop)
    yield f"  {curve.other:>26s} {curve.vary:>16s} {'amplitude rad':>13s} {'period s':>9s} {'%':>8s}"
    for orbit, error, slope, (x, q) in zip(curve.orbits, curve.errors, curve.slopes, curve.values, strict=True):
        value, amplitude, period = (
            to_error(number, max(error, orbit.error_estimate), most=most)
            for number, most in ((x, 9), (orbit.amplitude, 7), (orbit.period, 7))
        )
        yield f"  {q:26.9g} {value:>16s} {amplitude:>13s} {period:>9s} {sensitivity_text(slope * q / x, tol):>8s}"
    yield f"  {named(curve.other)}; {named(curve.vary)}: {way} to which the loop can hunt;"
    yield f"  amplitude and period there; %: change of it for one per cent more of {curve.other}"
    for q in curve.values[curve.turns, 1]:
        yield f"  cusp at {curve.other} = {q:.9g}"
    yield f"  {curve.wall_s:.2f} s"
