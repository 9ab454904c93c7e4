"""casahunt fold-curve of a loop of parts: the border of hunting in one parameter, while another one runs over a range.

Keys of the JSON object: parts, parameters (at the first point), curves: one, with its table, failures, wall_s.
"""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from ....continuation import SpecialOrbit, special_curve
from ....errors import InputError
from ....orbits import Options
from ....servo.find_fold import find_fold
from ....servo.units import kinds_of
from ...answers.fold_curve import loop_curve_answer
from ..arguments import finite
from ..console import complain, orbit_line
from ..output import give
from ..progress import progress, tell
from .shared import named, parts_line, record_of, way_to

if TYPE_CHECKING:
    from ....servo.parts import Loop


def of_loop(options: argparse.Namespace, loop: Loop, points: int, how: Options) -> int:
    """Follow and print; returns the exit code."""
    from ....servo.parts.verbs import check_present

    start, end = (
        finite(key, text, *kinds_of(options.vary)) for key, text in (("from", options.start), ("to", options.to))
    )
    vary, ends_in = options.vary, options.fold_in or "gain"
    loop = loop.replace(**{vary: start})
    check_present(loop, vary)
    if vary == ends_in:
        raise InputError(f"fold-in = {ends_in}: must be another parameter than that of --vary")
    began, stream = time.perf_counter(), progress(options)
    fold = find_fold(loop, vary=ends_in, options=how)
    way = way_to(fold, loop)

    def found(point: SpecialOrbit) -> None:
        orbit = point.orbit
        tell(stream, f"{orbit_line(stream, orbit, '+1 (fold)', ends_in)}  {vary} = {orbit.problem.value(vary):.8g}")

    curve = special_curve(fold, fold.parameter, vary, to=end, options=how, points=points, progress=found)
    failures = [] if curve.complete else [curve.ended]
    for failure in failures:
        complain("casahunt fold-curve", failure)
    record = record_of(loop.replace(**{ends_in: fold.value})) | {
        "curves": [curve.to_dict()], "way": way, "failures": failures, "wall_s": time.perf_counter() - began,
    }  # fmt: skip
    picture = ("fold_curve.loop_border", curve, way)
    answer = loop_curve_answer(curve, way, parts_line(loop), (named(curve.vary), named(curve.other)), how.tol)
    give(options, record, answer, table=curve._columns(), picture=picture)
    return 1 if failures else 0
