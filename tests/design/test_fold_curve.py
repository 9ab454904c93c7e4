"""Fold curves: against folds computed from nothing, exact symmetries, and cusps known in closed form."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from casahunt import InputError, NoOrbit, Options, Servo, find_fold
from casahunt.continuation import SpecialPoint, special_curve, two_parameters
from casahunt.design.fold_curve import FoldCurve, cubic_through_points, fold_curve, unfed
from casahunt.errors import Status

TOL = 1e-8


@cache
def curve(model: str, vary: str, start: float, end: float, tol: float = TOL, points: int = 9) -> FoldCurve:
    return fold_curve(
        Servo(),
        model,
        vary=vary,
        start=start,
        end=end,
        points=points,
        options=Options(tol=tol),  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("model", "vary", "start", "end", "tol", "points"),
    [
        ("switch", "friction.static", 0.48, 0.6, TOL, 9),
        ("switch", "controller.lead_time", 0.05, 0.4, TOL, 5),
        ("switch", "friction.viscous", 0.0, 0.5, TOL, 5),
        ("lugre", "friction.static", 0.53, 0.55, 1e-6, 2),
        pytest.param("lugre", "friction.static", 0.5, 0.56, TOL, 5, marks=pytest.mark.slow),
        pytest.param("lugre", "friction.stribeck_velocity", 0.01, 0.04, TOL, 5, marks=pytest.mark.slow),
        pytest.param("lugre", "friction.damping", 2.0, 12.0, TOL, 5, marks=pytest.mark.slow),
        pytest.param("switch", "friction.static", 0.6, 0.7, TOL, 9, marks=pytest.mark.slow),  # folds 1e-7 wide
    ],
)
def test_points_are_the_folds_computed_from_nothing(model, vary, start, end, tol, points):
    found = curve(model, vary, start, end, tol, points)
    assert found.status is Status.CONVERGED
    assert found.ended in [f"{vary} reached {bound:g}, the end of the range" for bound in (start, end)]
    assert (found.points[0].value, found.points[-1].value) == (start, end)
    assert not found.cusps
    for point in found.points[1::3]:
        fresh = find_fold(Servo().replace(**{vary: point.value}), model, options=Options(tol=tol))
        assert point.gain == pytest.approx(fresh.gain, rel=2 * tol)
        assert point.error_estimate <= tol
        assert point.orbit.amplitude == pytest.approx(fresh.orbit.amplitude, rel=1e-5)


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_slopes_are_those_of_the_gains(model):
    """The stored slope (adjoint) against the chord of two folds close by, computed from nothing."""
    point = curve(model, "friction.static", 0.5, 0.56, TOL, 5).points[1]
    h = 1e-4
    servo = Servo().replace(**{"friction.static": point.value})
    above, below = (
        find_fold(servo.replace(**{"friction.static": point.value + d}), model, options=Options(tol=1e-9)).gain
        for d in (h, -h)
    )
    # The chord is wrong by h^2 K'''/6, about 1e-7 of the slope; the gains by 1e-9 over 2 h.
    assert point.slope == pytest.approx((above - below) / (2 * h), rel=1e-5)


def test_neighbours_agree_with_the_slopes():
    """The cubic of every other point and its slopes meets the points left out: to 1e-4 of the gain or better."""
    found = curve("switch", "friction.static", 0.48, 0.6)
    half = replace(found, points=found.points[::2])
    q, K = cubic_through_points(half, samples=400)
    left_out = found.points[1 : len(half.points) * 2 - 2 : 2]
    assert left_out
    for point in left_out:
        assert np.interp(point.value, q, K) == pytest.approx(point.gain, rel=1e-4)


def test_motor_gain_times_fold_gain_is_constant():
    found = curve("switch", "servo.motor_gain", 5.0, 50.0)
    assert found.gains * found.values == pytest.approx(found.gains[0] * found.values[0], rel=1e-8)
    assert [point.elasticity for point in found.points] == pytest.approx([-1.0] * len(found.points), abs=1e-6)


def test_friction_enters_through_the_drop_over_velocity():
    """K_fold(Fs) and K_fold(vs) are one curve in (Fs - Fc)/vs."""
    static = curve("switch", "friction.static", 0.5, 0.56, tol=1e-9)
    for point in static.points[::4]:
        drop = (point.value - 0.44) / 0.02
        vs = 0.09 / drop
        velocity = fold_curve(
            Servo(), "switch", vary="friction.stribeck_velocity", start=vs, end=1.01 * vs, points=2,
            options=Options(tol=1e-9),
        )  # fmt: skip
        assert velocity.points[0].gain == pytest.approx(point.gain, rel=1e-8)
        # d ln K/d ln(drop), from either side.
        by_static = point.elasticity * (point.value - 0.44) / point.value
        assert -velocity.points[0].elasticity == pytest.approx(by_static, rel=1e-5)


def test_controller_times_can_be_swapped():
    """tau_i <-> tau_d with K/tau_i fixed: where one runs and the other is kept, and the other way round."""
    tau = Servo().controller.lead_time
    lead = curve("switch", "controller.lead_time", 0.1, 0.3, points=4)
    integral = curve("switch", "controller.integral_time", 0.1, 0.3, points=4)
    assert lead.values[[0, -1]].tolist() == integral.values[[0, -1]].tolist()
    for k in (0, -1):  # K/tau_i of (tau_i, tau_d) = (tau, x) and (x, tau)
        assert lead.gains[k] / tau == pytest.approx(integral.gains[k] / integral.values[k], rel=1e-7)


def test_the_other_direction_gives_the_same_curve():
    up = curve("switch", "friction.static", 0.48, 0.6)
    down = curve("switch", "friction.static", 0.6, 0.48)
    assert down.values[[0, -1]].tolist() == [0.6, 0.48]
    assert down.gains[[0, -1]] == pytest.approx(up.gains[[-1, 0]], rel=2 * TOL)


def test_it_ends_before_coulomb_friction():
    """Without a drop there is no cycle: the curve ends before it, and says so."""
    found = curve("switch", "friction.static", 0.44, 0.46, tol=1e-6, points=3)
    assert found.status is Status.CONVERGED
    assert found.vanishes
    assert "tends to zero" in found.ended
    assert 0.44 < found.points[0].value < 0.443
    assert found.points[-1].value == 0.46
    # Nearly proportional to the drop down there.
    fresh = find_fold(Servo().replace(**{"friction.static": found.points[0].value}), "switch")
    assert found.points[0].gain == pytest.approx(fresh.gain, rel=2e-6)


def test_folds_are_followed_across_changes_of_the_phases(monkeypatch):
    """A fold of any system stands for itself: with fewer reversals of the velocity in a cycle it is still one."""
    # Batches would leap over it: a fold of theirs may have other phases.
    monkeypatch.setattr(two_parameters, "folds_ahead", lambda *_: iter(()))
    options = Options(tol=1e-6)
    first = find_fold(Servo().replace(**{"friction.damping": 6.0}), "lugre", options=options)
    found = special_curve(SpecialPoint("fold", first.orbit, ""), "gain", "friction.damping", to=8.5, options=options)
    last = find_fold(Servo().replace(**{"friction.damping": 8.5}), "lugre", options=options)
    assert found.complete and len({len(orbit.signature) for orbit in found.orbits}) > 1
    assert found.values[[0, -1], 0] == pytest.approx([first.gain, last.gain], rel=2e-6)


def test_unfed():
    """The least slope of g(v) + sigma2 v by sampling, against J/(tau_i + tau_d)."""
    for viscous in (0.1, 3.8, 3.92, 3.96, 5.0):
        servo = Servo().replace(**{"friction.viscous": viscous})
        v = np.linspace(0, 0.1, 200001)
        torque = 0.44 + 0.09 * np.exp(-((v / 0.02) ** 2)) + viscous * v
        least = np.diff(torque).min() / v[1]
        assert unfed(servo) == (least >= 0.026 / (2 * Servo().controller.lead_time))
    assert unfed(Servo().replace(**{"friction.static": 0.44, "friction.viscous": 0.0}))


@pytest.mark.slow
def test_no_fold_in_the_range():
    with pytest.raises(NoOrbit, match="no fold to follow at either end"):
        fold_curve(Servo(), "switch", vary="friction.viscous", start=4.5, end=5.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"vary": "friction.statc", "start": 0.5, "end": 0.6}, "did you mean 'friction.static'"),
        ({"vary": "gain", "start": 0.5, "end": 0.6}, "unknown parameter"),
        ({"vary": "friction.static", "start": 0.5, "end": 0.5}, "must differ"),
        ({"vary": "friction.static", "start": 0.3, "end": 0.5}, "at least 0.44"),
        ({"vary": "friction.static", "start": 0.5, "end": 0.6, "points": 1}, "at least 2"),
    ],
)
def test_what_is_refused(words, said):
    with pytest.raises(InputError, match=said):
        fold_curve(Servo(), "switch", **words)
