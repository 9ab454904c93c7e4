"""A fold curve on the disk, and taken up behind an interruption, round a cusp too."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from curve_support import Known

from casahunt import NoOrbit, Options, Servo
from casahunt.continuation import two_parameters
from casahunt.continuation.sheet import Axis
from casahunt.continuation.special_charts import SpecialOrbit
from casahunt.continuation.special_points import FOLD
from casahunt.design.fold_curve.curve import fold_curve
from casahunt.design.fold_curve.data import FoldCurve, FoldPoint, as_found
from casahunt.design.fold_curve.files import load_curve, save_curve
from casahunt.errors import Status
from casahunt.servo.saved import INTERRUPTED


@pytest.mark.parametrize("first", [0.0, 1.0], ids=["from the start", "from the end"])
def test_a_curve_round_a_cusp_goes_on_where_it_was_interrupted(monkeypatch, first):
    """Behind every point: on along c = cusp -+ 3 s^2, the cusp once, and back to the end where it began."""
    axis, cusp = Axis("friction.static", 0.5, 0.6), abs(first - 0.8)
    sign = 1 - 2 * first

    def phi(s: float, c: float) -> float:
        return sign * (c - cusp) + 3 * s**2

    class Turning(Known):
        """Charts that carry the fold there, as those of a servo do."""

        sheet, task = None, SimpleNamespace(monitor=FOLD, options=Options())

        @property
        def special(self) -> SpecialOrbit:
            problem = SimpleNamespace(value=lambda _: axis.value(self.position))
            orbit = SimpleNamespace(s=self.s, problem=problem, gain=1 + self.s / 10, status=Status.CONVERGED)
            return SpecialOrbit(orbit, 1e-9, 0.0, 6 * self.s)

    def again(_: object, orbit: Any, __: object, ___: object, position: float, *____: object) -> Turning:
        return Turning(orbit.s, position, phi)

    def fold(_: object, c: float) -> Any:
        if c != first:
            raise NoOrbit("the other end")
        return Turning(-np.sqrt(0.8 / 3), first, phi).special.orbit

    # No servo is known to have a cusp: charts of one in closed form stand for those of its folds.
    monkeypatch.setattr(two_parameters, "folds_ahead", lambda *_: iter(()))
    monkeypatch.setattr(two_parameters, "chart_at", again)
    monkeypatch.setattr("casahunt.design.fold_curve.curve._FoldCurveTask.fold", fold)

    def computed(begun: Sequence[FoldPoint], most: int = 1000) -> tuple[list[FoldPoint], FoldCurve | None]:
        seen: list[FoldPoint] = []

        def report(point: FoldPoint) -> None:
            seen.append(point)
            if len(seen) == most:
                raise KeyboardInterrupt

        found = None
        with suppress(KeyboardInterrupt):
            found = fold_curve(
                Servo(), "switch", vary=axis.vary, start=axis.start, end=axis.end, report=report,
                begun=begun if first == 0 else begun[::-1],
            )  # fmt: skip
        return seen, found

    whole, _ = computed([])
    (k,) = [i for i, point in enumerate(whole) if point.turns]
    assert 2 < k < len(whole) - 2
    for number in range(1, len(whole)):
        before, _ = computed([], number)
        assert [point.value for point in before] == [point.value for point in whole[:number]]
        _, found = computed(before)
        assert found is not None and found.status is Status.CONVERGED and "where it began, after a cusp" in found.ended
        points = found.points if first == 0 else found.points[::-1]
        kept = before[:-1] if before[-1].turns else before
        assert list(points[: len(kept)]) == kept
        (at,) = found.cusps
        assert at.value == pytest.approx(axis.value(cusp)) and at.orbit.s == pytest.approx(0, abs=1e-6)
        s = np.array([point.orbit.s for point in points])
        assert (np.diff(s) > 0).all() and s[-1] == pytest.approx(-s[0])
        assert all(abs(phi(p.orbit.s, axis.place(p.value))) <= 1e-8 for p in points)
        done, finished = computed(points)
        assert done == [] and finished is not None and len(finished.points) == len(points)


def test_a_cusp_is_kept_in_the_file(tmp_path, orbit):
    numbers: Any = (0.3, 0.1, orbit("switch", 0.3), 1e-9, 0.0, Status.CONVERGED)
    points = (FoldPoint(0.54, *numbers), FoldPoint(0.55, *numbers, turns=True))
    saved = FoldCurve("switch", Servo(), "friction.static", points, points[1:], INTERRUPTED, Status.NOT_CONVERGED, 1.0)
    save_curve(saved, tmp_path / "curve.npz", {})
    curve, _ = load_curve(tmp_path / "curve.npz")
    assert [point.value for point in curve.cusps] == [0.55] and [point.turns for point in curve.points] == [False, True]
    assert as_found(curve.points, 0.54) == [curve.points[0]]


def test_how_a_point_was_computed_is_kept_in_the_file(tmp_path):
    asked = {"vary": "friction.static", "start": 0.53, "end": 0.57, "points": 5}
    whole = fold_curve(Servo(), "switch", **asked, options=Options(tol=1e-6))
    save_curve(whole, tmp_path / "curve.npz", {})
    assert [point.how for point in load_curve(tmp_path / "curve.npz")[0].points] == [p.how for p in whole.points]
