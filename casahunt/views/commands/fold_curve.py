"""casahunt fold-curve: the largest gain at which the servo can hunt, while another parameter runs over a range."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...checks import known, to_error
from ...design.fold_curve.curve import POINTS, check_range, fold_curve
from ...design.fold_curve.files import INTERRUPTED, begun, save_curve
from ...design.fold_curve.points import FoldCurve, FoldPoint, as_found
from ...errors import InputError, NoOrbit, Status
from ...files import together, whole_text
from ...interrupts import held, word
from ...orbits.adapt import Options
from ...servo.hunting import MODELS
from ...tables import table as csv_table
from .console import add_common, complain, finite, progress, say, servo_of, writable

CSV_COLUMNS = (
    "model",
    "parameter",
    "value",
    "gain",
    "amplitude_rad",
    "period_s",
    "slope",
    "elasticity",
    "error_estimate",
    "status",
    "special",
)
MOST_POINTS = 1000


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser(
        "fold-curve", allow_abbrev=False, help="the fold gain against another parameter: where the servo cannot hunt"
    )
    add_common(command)
    command.add_argument("--model", action="append", help="switch or lugre; repeat for both (default both)")
    command.add_argument("--vary", required=True, metavar="KEY", help="the parameter, e.g. friction.static")
    command.add_argument("--from", dest="start", required=True, metavar="A", help="where its range begins")
    command.add_argument("--to", required=True, metavar="B", help="where its range ends")
    command.add_argument("--points", default=POINTS, metavar="N", help=f"about how many points (default {POINTS})")
    command.add_argument("--csv", metavar="F.csv", help="write the points")
    command.add_argument("--save", metavar="F.npz", help="keep the points of one model for --resume")
    command.add_argument("--resume", action="store_true", help="go on behind the points that are in the file of --save")
    command.add_argument("--plot", metavar="F.png", help="write a picture of the gains with and without hunting")


def run(options: argparse.Namespace) -> int:
    """Compute, write and print; returns the exit code."""
    models = [known("model", model, MODELS) for model in options.model or MODELS]
    if len(set(models)) != len(models):
        raise InputError(f"model = {', '.join(models)}: each model can be asked for once")
    how = Options(tol=finite("tol", options.tol))
    servo = servo_of(options)
    start, end = finite("from", options.start), finite("to", options.to)
    check_range(servo, options.vary, start, end)
    points = _count(options.points)
    table = writable("csv", options.csv, (".csv",))
    save = writable("save", options.save, (".npz",))
    if save and len(models) != 1:
        raise InputError(f"save = {options.save!r}: holds the points of one model; give one --model")
    if options.resume and not save:
        raise InputError("resume: must be given together with --save, the file to go on from")
    settings = {"vary": options.vary, "from": start, "to": end, "points": points, "tol": how.tol}
    before = begun(save, servo, models[0], settings) if save and options.resume else None  # type: ignore[arg-type]
    plot = writable("plot", options.plot, (".png", ".pdf", ".svg"))
    began = time.perf_counter()
    stream = progress(options.quiet)
    curves: list[FoldCurve] = []
    failures: list[str] = []
    there: list[FoldPoint] = as_found(before.points, start) if before else []

    def keep(curve: FoldCurve) -> None:
        with together():
            if save:
                save_curve(curve, save, settings)
            if table:
                _write([point for part in (*curves, curve) for point in part.points], options.vary, table)

    def arrived(point: FoldPoint) -> None:
        """The files are whole after every point, as they would be if it were the last."""
        with held():
            there.append(point)
            ordered = tuple(there if there[0].value == start else there[::-1])
            model, status = point.orbit.model, Status.NOT_CONVERGED
            keep(FoldCurve(model, servo, options.vary, ordered, (), INTERRUPTED, status, time.perf_counter() - began))
        say(stream, _line(options.vary, point))

    for model in models:
        try:
            curve = before if before and before.ended != INTERRUPTED else fold_curve(
                servo, model, vary=options.vary, start=start, end=end, points=points, options=how, report=arrived,  # type: ignore[arg-type]
                begun=before.points if before else (),
            )  # fmt: skip
            keep(curve)
        except NoOrbit as error:
            failures.append(str(error))
        except KeyboardInterrupt:
            if (table or save) and (curves or there):
                raise KeyboardInterrupt(f"{word()}; the points computed so far are in {table or save}") from None
            raise
        else:
            curves.append(curve)
            there.clear()
            if not curve.status.ok:
                failures.append(f"the curve of the {model} servo is not complete: {curve.ended}")
    if not curves:
        raise NoOrbit("; ".join(failures))
    for failure in failures:
        complain("casahunt fold-curve", failure)
    if plot:
        from ..pictures import fold_curve as pictures_fold_curve
        from ..pictures import plotting

        options.outputs.draw(lambda: plotting.save(pictures_fold_curve.regions(curves), plot))
    if options.json:
        records = [_record(curve) for curve in curves]
        print(json.dumps({"curves": records, "failures": failures, "wall_s": time.perf_counter() - began}))
        return 1 if failures else 0
    for curve in curves:
        print(f"{curve.model} servo: {len(curve.points)} points; {curve.ended}")
        heads = f"{'fold gain':>13s}  {'amplitude rad':>13s}  {'period s':>11s}  {'elasticity':>10s}"
        print(f"  {curve.vary:>26s}  {heads}")
        for point in curve.points:
            print(
                f"  {point.value:26.9g}  {to_error(point.gain, point.error_estimate, most=9):>13s}  "
                f"{to_error(point.orbit.amplitude, point.error_estimate, most=7):>13s}  "
                f"{to_error(point.orbit.period, point.error_estimate, most=7):>11s}  {point.elasticity:+10.4f}"
                + ("  cusp" if point in curve.cusps else "")
            )
        print(f"  {curve.wall_s:.2f} s")
    return 1 if failures else 0


def _count(text: Any) -> int:
    """--points as a whole number."""
    value = finite("points", text)
    if value != int(value) or not 2 <= value <= MOST_POINTS:
        raise InputError(f"points = {text}: must be a whole number from 2 to {MOST_POINTS}")
    return int(value)


def _line(vary: str, point: FoldPoint) -> str:
    """A line of progress."""
    gain, amplitude, period = (
        to_error(value, point.error_estimate, most=most)
        for value, most in ((point.gain, 8), (point.orbit.amplitude, 6), (point.orbit.period, 6))
    )
    return (
        f"{point.orbit.model:7s} {vary} = {point.value:.8g}  K = {gain}  amplitude = {amplitude} rad  "
        f"period = {period} s"
    )


def _record(curve: FoldCurve) -> dict[str, Any]:
    return {
        "model": curve.model,
        "vary": curve.vary,
        "points": [
            {
                "value": point.value,
                "gain": point.gain,
                "amplitude": point.orbit.amplitude,
                "period": point.orbit.period,
                "slope": point.slope,
                "elasticity": point.elasticity,
                "error_estimate": point.error_estimate,
            }
            for point in curve.points
        ],
        "special": [{"kind": "cusp", "value": point.value, "gain": point.gain} for point in curve.cusps],
        "ended": curve.ended,
        "status": curve.status.name.lower(),
        "wall_s": curve.wall_s,
    }


def _write(points: Sequence[FoldPoint], vary: str, path: Path) -> None:
    with whole_text(path) as stream:
        write = csv_table(stream, CSV_COLUMNS)
        write(
            [
                p.orbit.model, vary, p.value, p.gain, p.orbit.amplitude, p.orbit.period, p.slope, p.elasticity,
                p.error_estimate, p.status.name.lower(), "cusp" if p.turns else "",
            ]
            for p in points
        )  # fmt: skip
