"""casahunt fold-curve: the largest gain at which the servo can hunt, while another parameter runs over a range.

Of a loop of parts: the border of hunting in any parameter; its JSON object says `way`, "up" or "down" to it, besides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...axis_units import label, quantity, shown
from ...checks import to_error
from ...design.fold_curve import RANGE_POINTS, FoldCurve, FoldPoint, check_range, fold_curve
from ...errors import NoOrbit, Status
from ...export import write_csv
from ...interrupts import held, word
from ...orbits import Options
from ...results import tables_of
from ...servo.friction import Model
from ...servo.parts.loop import Loop
from ...servo.parts.table import unit_of
from ...servo.servo import Servo
from ...servo.units import kinds_of
from ..answers.answer import Answer, called, named, parts_of, record_of, short
from ..answers.fold import PLAIN_DECIMALS, sensitivity_text
from .arguments import Asked, add_command, add_models, count_of, finite
from .console import complain
from .output import give
from .progress import tell


def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "the fold gain against another parameter: where the servo cannot hunt"
    plot = "the gains with and without hunting"
    command = add_command(commands, "fold-curve", about, csv="the points", plot=plot)
    command.add_required("--vary", example="friction.static", metavar="KEY", help="the parameter, e.g. friction.static")
    command.add_required("--from", example="0.5", dest="start", metavar="A", help="where its range begins")
    command.add_required("--to", example="0.6", metavar="B", help="where its range ends")
    command.add_argument(
        "--fold-in", metavar="NAME", help="of a loop of parts: the parameter in which hunting ends (default gain)"
    )
    add_models(command)
    points = f"about how many points (default {RANGE_POINTS})"
    command.add_argument("--points", default=RANGE_POINTS, metavar="N", help=points)


def run(options: Asked) -> int:
    """Compute, write and print; returns the exit code."""
    servo, models, how = options.loop() or options.servo(), options.friction_models(), options.how()
    if models[0]:
        options.leave_out("a servo's hunting ends in its gain; it is of a loop of parts", "fold_in")
    asked: dict[str, Any] = {"vary": options.vary, "fold_in": options.fold_in or "gain"}
    asked |= {"start": finite("from", options.start, *kinds_of(options.vary))}
    asked |= {"end": finite("to", options.to, *kinds_of(options.vary))}
    check_range(servo, **asked)
    asked |= {"points": count_of("points", options.points, 2, 1000)}
    desk = _Desk(servo, asked, how, options)
    for model in models:
        desk.follow(model)
    curves, failures = desk.curves, desk.failures
    if not curves:
        whole = [each for each in failures if isinstance(each, NoOrbit)]
        evidence = "; ".join(each.evidence for each in whole if each.evidence)
        raise NoOrbit("; ".join(each.plain for each in whole), Status.NOT_FOUND, evidence=evidence)
    for failure in failures:
        complain("casahunt fold-curve", failure, details=options.details)
    said = [str(each) for each in failures]
    record = {"curves": curves, "failures": said, "wall_s": options.outputs.seconds}
    record |= record_of(servo) | ({} if curves[0].model else {"way": curves[0].way})
    answer = Answer([line for curve in curves for line in _plain(curve)], _details(curves, how.tol))
    give(options, record, answer, picture=("fold_curve.fold_curves", curves))
    return 1 if failures else 0


@dataclass
class _Desk:
    """A run: what is asked for, and what is computed so far, on the disk after every point."""

    servo: Servo | Loop
    asked: dict[str, Any]
    """vary, start, end, fold_in, points: arguments of `fold_curve`."""
    how: Options
    options: Asked
    curves: list[FoldCurve] = field(default_factory=list)
    failures: list[str | NoOrbit] = field(default_factory=list)
    there: list[FoldPoint] = field(default_factory=list)
    """The points of the curve under way, as they were found."""

    def follow(self, model: Model | None) -> None:
        """Compute a curve, from the points that are there on."""
        try:
            curve = fold_curve(
                self.servo, model, **self.asked, options=self.how, report=lambda point: self.arrived(model, point)
            )
            self.keep(curve)
        except NoOrbit as error:
            self.failures.append(error)
        except KeyboardInterrupt:
            if self.options.csv and (self.curves or self.there):
                raise KeyboardInterrupt(f"{word()}; the points computed so far are in {self.options.csv}") from None
            raise
        else:
            self.curves.append(curve)
            self.there.clear()
            if not curve.status.ok:
                self.failures.append(f"the curve of the {called(self.servo, model)} is not complete: {curve.ended}")

    def arrived(self, model: Model | None, point: FoldPoint) -> None:
        """The files are whole after every point, as they would be if it were the last."""
        vary, there = self.asked["vary"], self.there
        with held():
            there.append(point)
            ordered = tuple(there if there[0].value == self.asked["start"] else there[::-1])
            wall_s, fold_in = self.options.outputs.seconds, self.asked["fold_in"]
            ended = "interrupted", Status.NOT_CONVERGED
            self.keep(FoldCurve(model, self.servo, vary, ordered, (), *ended, wall_s, False, fold_in))
        border, period = (
            to_error(value, point.error_estimate, most=most)
            for value, most in ((point.border, 8), (point.orbit.period, 6))
        )
        amplitude = quantity(point.orbit.amplitude, "rad", lambda x: to_error(x, point.error_estimate, most=6))
        tell(
            f"{model or 'loop':7s} {vary} = {point.value:.8g}  {'K' if fold_in == 'gain' else fold_in} = {border}  "
            f"amplitude = {amplitude}  period = {period} s"
        )

    def keep(self, curve: FoldCurve) -> None:
        """Write what is asked for, `curve` behind the curves before it."""
        if self.options.csv:
            write_csv(shown().columns(tables_of([*self.curves, curve])), self.options.csv)


# What `casahunt fold-curve` says: where hunting ends, while another parameter runs over a range

PLAIN_ROW, ROW = "  {:>26s} {:>11s} {:>13s} {:>9s} {:>8s}", "  {:>26s} {:>16s} {:>13s} {:>9s} {:>8s}"
"""A row: the parameter, where hunting ends, amplitude and period there, per cent."""


def _headings() -> tuple[str, str, str]:
    return f"amplitude {label('rad')}", "period s", "%"


def _amplitude(point: FoldPoint) -> float:
    """In the unit in which it is shown."""
    return float(shown().number(point.orbit.amplitude, "rad"))


def _border(curve: FoldCurve) -> str:
    """The heading of the parameter in which hunting ends."""
    return f"{curve.fold_in} {unit_of(curve.fold_in)}".rstrip()


def _plain(curve: FoldCurve) -> Iterator[str]:
    whose, what = ("loop", curve.fold_in) if curve.model is None else ("servo", "that gain")
    name = called(curve.servo, curve.model)
    yield f"{name}: where hunting ends, at {len(curve.points)} values of {curve.vary}; {curve.ended}"
    yield from parts_of(curve.servo)
    yield PLAIN_ROW.format(curve.vary, _border(curve), *_headings())
    for point in curve.points:
        numbers = (short(x, point.error_estimate) for x in (point.border, _amplitude(point), point.orbit.period))
        yield PLAIN_ROW.format(f"{point.value:.6g}", *numbers, sensitivity_text(point.elasticity, 0.0, PLAIN_DECIMALS))
    can = f"{curve.way} to which the {whose} can hunt"
    yield f"  {named(curve.vary)}; {curve.fold_in}: {can}; amplitude and period there;"
    yield f"  %: change of {what} for one per cent more of {curve.vary}"


def _details(curves: Sequence[FoldCurve], tol: float) -> Iterator[str]:
    for curve in curves:
        yield ROW.format(curve.vary, _border(curve), *_headings())
        for point in curve.points:
            numbers = (
                to_error(value, point.error_estimate, most=most)
                for value, most in ((point.border, 9), (_amplitude(point), 7), (point.orbit.period, 7))
            )
            yield ROW.format(f"{point.value:.9g}", *numbers, sensitivity_text(point.elasticity, tol))
        for point in curve.cusps:
            yield f"  cusp at {curve.vary} = {point.value:.9g}"
        yield f"  {curve.wall_s:.2f} s"
