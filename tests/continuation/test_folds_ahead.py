"""Folds ahead in batches: what a batch does not reach, or must not be accepted in, is followed step by step."""

from __future__ import annotations

from dataclasses import replace

import pytest

from casahunt import NoOrbit, Options, Servo
from casahunt.continuation import folds_ahead
from casahunt.design.fold_curve import FoldCurve, fold_curve
from casahunt.errors import Status


def static_curve() -> FoldCurve:
    return fold_curve(
        Servo(), "switch", vary="friction.static", start=0.53, end=0.57, points=5, options=Options(tol=1e-6)
    )


def test_what_batches_do_not_reach_is_followed(monkeypatch):
    """From the third place on nothing is found in a batch; the points, their slopes and curvatures are the same."""
    whole = static_curve()
    assert [point.how for point in whole.points] == ["followed", *["batch"] * 4]
    honest = folds_ahead.folds_near

    def loses(known, p, tol, *, slopes_by):
        folds = honest(known, p, tol, slopes_by=slopes_by)
        there = p[:, known.problem.names.index("friction.static")] < 0.555
        return replace(folds, solutions=tuple(s if t else None for s, t in zip(folds.solutions, there, strict=True)))

    # Where a batch ends depends on its expansion; here it is known.
    monkeypatch.setattr(folds_ahead, "folds_near", loses)
    parts = static_curve()
    assert [point.how for point in parts.points][1:3] == ["batch"] * 2 and parts.points[-1].how == "followed"
    assert parts.status is Status.CONVERGED and parts.ended == whole.ended
    for ours, known in zip((parts.points[0], parts.points[-1]), (whole.points[0], whole.points[-1]), strict=True):
        assert ours.gain == pytest.approx(known.gain, rel=2e-6)
        assert ours.slope == pytest.approx(known.slope, rel=1e-5)
        # Arclength is in units of the scale of an orbit, here that of the fold it was predicted from.
        assert ours.curvature == pytest.approx(known.curvature, rel=0.05)
        assert ours.orbit.period == pytest.approx(known.orbit.period, rel=1e-5)


@pytest.mark.parametrize("much", [1.1, 1.6])
def test_a_batch_does_not_leap(monkeypatch, much):
    """Other gains than the slopes explain, or far greater ones, are not those of the next points of the curve."""
    honest = folds_ahead.folds_near

    def leaps(known, p, tol, *, slopes_by):
        folds = honest(known, p, tol, slopes_by=slopes_by)
        return replace(folds, values=much * folds.values)

    whole = static_curve()
    # A batch that is right never leaps: the guard is shown one that is wrong.
    monkeypatch.setattr(folds_ahead, "folds_near", leaps)
    alone = static_curve()
    assert all(point.how == "followed" for point in alone.points)
    assert alone.gains[-1] == pytest.approx(whole.gains[-1], rel=2e-6)


def test_a_fold_that_cannot_be_expanded_is_followed(monkeypatch):
    def fails(*_):
        raise NoOrbit("not today")

    # No fold is known that is found and cannot be solved again.
    monkeypatch.setattr(folds_ahead, "expansion_at", fails)
    assert {point.how for point in static_curve().points} == {"followed"}


def test_a_parameter_that_is_zero_has_no_elasticity():
    found = fold_curve(Servo(), "switch", vary="friction.viscous", start=0.0, end=0.1, points=5)
    assert [point.how for point in found.points] == ["followed", *["batch"] * 3, "followed"]
    assert found.points[0].slope == pytest.approx((found.gains[1] - found.gains[0]) / found.values[1], rel=0.02)
    from_zero = Servo().replace(**{"friction.viscous": 0.0})
    up = fold_curve(from_zero, "switch", vary="friction.viscous", start=0.0, end=0.01, points=3)
    assert up.status is Status.CONVERGED and up.gains[0] == pytest.approx(found.gains[0], rel=2e-6)
