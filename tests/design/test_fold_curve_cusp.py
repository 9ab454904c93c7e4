"""A fold curve round a cusp."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from curve_support import Known

from casahunt import NoOrbit, Servo
from casahunt.continuation import two_parameters
from casahunt.continuation.special_points import FOLD
from casahunt.continuation.surface import Axis, SpecialOrbit
from casahunt.design.fold_curve import FoldPoint, fold_curve
from casahunt.errors import Status


@pytest.mark.parametrize("first", [0.0, 1.0], ids=["from the start", "from the end"])
def test_a_curve_goes_round_a_cusp(monkeypatch, first):
    """Along c = cusp -+ 3 s^2, the cusp once, and back to the end where it began."""
    axis, cusp = Axis("friction.static", 0.5, 0.6), abs(first - 0.8)
    sign = 1 - 2 * first

    def phi(s: float, c: float) -> float:
        return sign * (c - cusp) + 3 * s**2

    class Turning(Known):
        """Charts that carry the fold there, as those of a servo do."""

        sought = SimpleNamespace(monitor=FOLD, axis=axis)

        @property
        def special(self) -> SpecialOrbit:
            problem = SimpleNamespace(value=lambda _: axis.value(self.position))
            orbit = SimpleNamespace(s=self.s, problem=problem, error_estimate=0.0, status=Status.CONVERGED)
            return SpecialOrbit(orbit, 1e-9, 0.0, 6 * self.s)

        def confirmed(self) -> Turning:
            return self

    def place(_: object, orbit: Any, position: float) -> Turning:
        return Turning(orbit.s, position, phi)

    def fold(_: object, c: float) -> Any:
        if c != first:
            raise NoOrbit("the other end")
        return Turning(-np.sqrt(0.8 / 3), first, phi).special.orbit

    # No servo is known to have a cusp: charts of one in closed form stand for those of its folds.
    monkeypatch.setattr(two_parameters, "folds_ahead", lambda *_: iter(()))
    monkeypatch.setattr(two_parameters, "place_of", place)
    monkeypatch.setattr("casahunt.design.fold_curve._FoldCurveTask.fold", fold)

    seen: list[FoldPoint] = []
    found = fold_curve(Servo(), "switch", vary=axis.vary, start=axis.start, end=axis.end, report=seen.append)
    (k,) = [i for i, point in enumerate(seen) if point.turns]
    assert 2 < k < len(seen) - 2 and list(found.points if first == 0 else found.points[::-1]) == seen
    assert found.status is Status.CONVERGED and "where it began, after a cusp" in found.ended
    (at,) = found.cusps
    assert at.value == pytest.approx(axis.value(cusp)) and at.orbit.s == pytest.approx(0, abs=1e-6)
    s = np.array([point.orbit.s for point in seen])
    assert (np.diff(s) > 0).all() and s[-1] == pytest.approx(-s[0])
    assert all(abs(phi(p.orbit.s, axis.place(p.value))) <= 1e-8 for p in seen)
