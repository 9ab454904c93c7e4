"""casahunt fold-map: the largest gain at which the servo can hunt, over two of its parameters."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ... import effort
from ...axis_units import shown
from ...checks import to_error
from ...design.fold_map import SIDES, FoldMap, fold_map
from ...design.nearby import check_asked, upper
from ...errors import InputError, NoOrbit, Status
from ...results import tables_of
from ...servo.find_fold import find_fold
from ...servo.units import kinds_of
from ..answers.answer import Answer, called, item, short
from .arguments import Asked, add_command, count_of, finite
from .console import orbit_line
from .output import give
from .progress import tell, teller

MAP_SIDE = 25
"""Values of each parameter: 625 folds make smooth contours, and take some seconds."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "the fold gain over two parameters, as contours"
    command = add_command(commands, "fold-map", about, model="", csv="the gains", plot="the contours")
    for which, example in (("vary", "friction.static 0.5 0.6"), ("and", "servo.inertia 0.02 0.03")):
        command.add_required(
            f"--{which}", example=example, dest=which, nargs=3, metavar=("KEY", "FROM", "TO"),
            help=f"a parameter and its range, e.g. {example}",
        )  # fmt: skip
    points = f"values of each parameter (default {MAP_SIDE})"
    command.add_argument("--points", default=MAP_SIDE, metavar="N", help=points)


def run(options: Asked) -> int:
    """Compute, write and print; returns the exit code."""
    how, (servo, model) = options.how(), options.subject()
    check_asked(servo, model)
    points = count_of("points", options.points, *SIDES)
    names, axes = [], []
    for which in ("vary", "and"):
        key, *ends = getattr(options, which)
        name = shown().own_name(key)
        low, high = (finite(f"{which} {name}", end, *kinds_of(name)) for end in ends)
        if not low < high:
            raise InputError(f"{which} {name} {low:g} {high:g}: the range must begin below its end")
        names.append(name)
        axes.append(np.linspace(low, high, points))
    tell("computing the fold of the servo itself")
    fold = upper(find_fold(servo, model, options=how))
    tell(orbit_line(fold.orbit, mu="+1 (fold)"))
    report = _reporter(points**2)
    found = fold_map(servo, model, (names[0], names[1]), *axes, options=how, fold=fold, report=report)
    answer = Answer(_plain(found), _details(found))
    give(options, found, answer, table=tables_of([found]), picture=("fold_curve.fold_map", found))
    if not np.isfinite(found.gains).any():
        raise NoOrbit("none of the folds was computed", Status.NOT_CONVERGED)
    return 0 if found.status.ok else 1


def _reporter(total: int) -> Callable[[int], None]:
    """Takes the number of folds computed, of a total, and says now and then how long the others will take."""
    told = teller()
    first: list[tuple[int, float]] = []  # what came before the first report is not what follows it

    def report(count: int) -> None:
        if not first:
            first.append((count, time.monotonic()))
        before, since = first[0]
        told(f"{count} of {total} folds computed{effort.left(count - before, total - before, since)}")

    return report


# What `casahunt fold-map` says: where hunting ends, over two parameters


def _plain(found: FoldMap) -> Iterator[str]:
    (m, n), (q, r) = found.gains.shape, found.values
    extremes = _extremes(found)
    ends = " and ".join(short(float(found.gains[place]), found.tolerance) for place, _ in extremes)
    head = f"hunting ends between gain {ends} V/rad" if extremes else "no gain was found at which hunting ends"
    yield f"{called(found.servo, found.model)}: {head}, over {m} x {n} values of {found.names[0]} and {found.names[1]}"
    for (i, j), text in extremes:
        yield item(text, f"at {found.names[0]} = {q[i]:.6g}, {found.names[1]} = {r[j]:.6g}")
    missing = list(found.failures.values())
    for sentence in dict.fromkeys(missing):
        yield f"  {missing.count(sentence)} without a gain: {sentence}"
    if (found.gains == 0).any():
        yield f"  {int((found.gains == 0).sum())} of the servos hunt at no gain"


def _details(found: FoldMap) -> Iterator[str]:
    for place, text in _extremes(found):
        yield item(text, f"{to_error(float(found.gains[place]), found.tolerance, most=8)} V/rad")
    yield f"  relative error of every gain below {found.tolerance:g}; {found.wall_s:.1f} s"


def _extremes(found: FoldMap) -> list[tuple[tuple[int, int], str]]:
    """Places of the smallest and the largest fold gain."""
    gains = np.where(found.gains > 0, found.gains, np.nan)
    if not np.isfinite(gains).any():
        return []
    low, high = (np.unravel_index(int(pick(gains)), gains.shape) for pick in (np.nanargmin, np.nanargmax))
    return [((int(low[0]), int(low[1])), "smallest"), ((int(high[0]), int(high[1])), "largest")]
