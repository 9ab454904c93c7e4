"""Fold curves: against folds computed from nothing, exact symmetries, and cusps known in closed form."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from casahunt import InputError, NoOrbit, Options, Servo, cli, find_fold
from casahunt.continuation import SpecialPoint, folds_ahead, special_curve, two_parameters
from casahunt.continuation.plane_curve import Place, Reading, follow
from casahunt.continuation.sheet import Axis
from casahunt.continuation.special_charts import SpecialOrbit
from casahunt.continuation.special_points import FOLD
from casahunt.continuation.walk import run
from casahunt.design.fold_curve.curve import fold_curve, unfed
from casahunt.design.fold_curve.files import load_curve, save_curve
from casahunt.design.fold_curve.points import FoldCurve, FoldPoint, as_found, hermite
from casahunt.errors import Status
from casahunt.servo.saved import INTERRUPTED

TOL = 1e-8


@cache
def curve(model: str, vary: str, start: float, end: float, tol: float = TOL, points: int = 9) -> FoldCurve:
    return fold_curve(
        Servo(), model, vary=vary, start=start, end=end, points=points, options=Options(tol=tol)  # type: ignore[arg-type]
    )


# The follower alone, on curves known in closed form ----------------------------------------------------------


@dataclass(frozen=True)
class Known:
    """phi of lambda = -(c - cusp) s - s^3 (cusp normal form; fold curve c = cusp - 3 s^2), or of another phi."""

    s: float
    position: float
    phi: object
    reach = (0.3, 0.1)

    def value(self, s: float, m: float) -> Reading | str:
        return Reading(float(self.phi(self.s + s, self.position + m)))  # type: ignore[operator]

    @property
    def gradient(self) -> tuple[float, float]:
        h = 1e-5
        by_s = (self.value(h, 0).value - self.value(-h, 0).value) / (2 * h)  # type: ignore[union-attr]
        by_c = (self.value(0, h).value - self.value(0, -h).value) / (2 * h)  # type: ignore[union-attr]
        return by_s, by_c

    def moved(self, s: float, m: float, reading: Reading) -> Known | str:
        return replace(self, s=self.s + s, position=self.position + m)


def followed(chart: Known, sense: float = 1.0) -> tuple[list[Place], str]:
    places, walk = [], follow(chart, sense=sense)
    while True:
        try:
            places.append(next(walk))
        except StopIteration as stop:
            return places, stop.value


@pytest.mark.parametrize("cusp", [0.35, 0.8, 0.999])
def test_round_a_cusp(cusp):
    """The fold curve of the cusp's normal form turns back exactly at s = 0, c = cusp."""

    def phi(s: float, c: float) -> float:
        return (c - cusp) + 3 * s**2

    places, ended = followed(Known(-np.sqrt(cusp / 3), 0.0, phi))
    assert ended == ""
    turns = [place.chart for place in places if place.turns]
    assert len(turns) == 1
    assert turns[0].position == pytest.approx(cusp, abs=1e-8)
    assert abs(turns[0].s) < 1e-6
    last = places[-1].chart
    assert (last.position, last.s) == (0.0, pytest.approx(np.sqrt(cusp / 3), abs=1e-6))
    assert all(abs(phi(place.chart.s, place.chart.position)) <= 1e-8 for place in places)


def test_round_two_cusps():
    """c = 1/2 + s - 4 s^3 turns back at s = 1/sqrt(12) and at s = -1/sqrt(12)."""

    def c_of(s: float) -> float:
        return 0.5 + s - 4 * s**3

    start = max(float(r.real) for r in np.roots([-4, 0, 1, 0.5]) if abs(r.imag) < 1e-9)
    places, ended = followed(Known(start, 0.0, lambda s, c: c - c_of(s)))
    assert ended == ""
    s = 1 / np.sqrt(12)
    turns = np.array([(place.chart.s, place.chart.position) for place in places if place.turns])
    assert turns == pytest.approx(np.array([(s, c_of(s)), (-s, c_of(-s))]), abs=1e-6)
    assert places[-1].chart.position == 1.0


def test_no_cusp_on_a_curve_that_does_not_turn():
    places, ended = followed(Known(0.0, 1.0, lambda s, c: s - np.sin(3 * (c - 1))), sense=-1.0)
    assert ended == ""
    assert not any(place.turns for place in places)
    assert places[-1].chart.position == 0.0
    assert places[-1].chart.s == pytest.approx(np.sin(-3), abs=1e-9)


def test_a_jump_of_the_tangent_is_no_cusp():
    """Where the gradient is wrong the tangent is turned round: no cusp is reported, and no place off the curve."""

    class Noisy(Known):
        @property
        def gradient(self) -> tuple[float, float]:
            by_s, by_c = super().gradient
            return (-by_s if 0.5 < self.position < 0.8 else by_s), by_c

    places, ended = followed(Noisy(0.0, 0.0, lambda s, c: 2 * s - c))
    assert not any(place.turns for place in places)
    assert ended or places[-1].chart.position in (0.0, 1.0)
    assert all(place.chart.s == pytest.approx(place.chart.position / 2, abs=1e-6) for place in places)


def test_where_phi_ends_the_curve_ends():
    class Ending(Known):
        def value(self, s: float, m: float) -> Reading | str:
            return super().value(s, m) if self.position + m < 0.5 else "nothing there"

        @property
        def gradient(self) -> tuple[float, float]:
            return 1.0, -2 * self.position

    places, ended = followed(Ending(0.0, 0.0, lambda s, c: s - c**2))
    assert ended == "nothing there"
    assert 0.45 < places[-1].chart.position < 0.5


# The servo ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "vary", "start", "end", "tol", "points"),
    [
        ("switch", "friction.static", 0.48, 0.6, TOL, 9),
        ("switch", "controller.lead_time", 0.05, 0.4, TOL, 5),
        ("switch", "friction.viscous", 0.0, 0.5, TOL, 5),
        ("lugre", "friction.static", 0.53, 0.55, 1e-6, 2),
        pytest.param("lugre", "friction.static", 0.5, 0.56, TOL, 9, marks=pytest.mark.slow),
        pytest.param("lugre", "friction.stribeck_velocity", 0.01, 0.04, TOL, 9, marks=pytest.mark.slow),
        pytest.param("lugre", "friction.damping", 2.0, 12.0, TOL, 9, marks=pytest.mark.slow),
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
    point = curve(model, "friction.static", 0.5, 0.56).points[2]
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
    q, K = hermite(half, samples=400)
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
    monkeypatch.setattr(two_parameters, "folds_ahead", lambda *_: iter(()))
    options = Options(tol=1e-6)
    first = find_fold(Servo().replace(**{"friction.damping": 6.0}), "lugre", options=options)
    found = special_curve(SpecialPoint("fold", first.orbit, ""), "gain", "friction.damping", to=8.5, options=options)
    last = find_fold(Servo().replace(**{"friction.damping": 8.5}), "lugre", options=options)
    assert found.complete and len({len(orbit.signature) for orbit in found.orbits}) > 1
    assert found.values[[0, -1], 0] == pytest.approx([first.gain, last.gain], rel=2e-6)


@pytest.mark.parametrize("same", [True, False])
def test_a_curve_that_is_lost_is_taken_up_by_another_way(monkeypatch, same):
    """Nothing is computed for c in 0.48 to 0.525: what lies beyond comes from elsewhere, if the curve is the same."""

    class Gap(Known):
        task = SimpleNamespace(monitor=FOLD, options=Options())
        sheet = SimpleNamespace(agrees=lambda _: same)

        def value(self, s: float, m: float) -> Reading | str:
            return "nothing there" if 0.48 < self.position + m < 0.525 else super().value(s, m)

        @property
        def gradient(self) -> tuple[float, float]:
            return 1.0, -0.5

        @property
        def special(self) -> SpecialOrbit:
            return SpecialOrbit(self.position, 1e-9, 0.5, -1.0)

    def phi(s: float, c: float) -> float:
        return s - c / 2

    asked: list[float] = []

    def again(c: float) -> float:
        asked.append(c)
        return c

    monkeypatch.setattr(two_parameters, "folds_ahead", lambda *_: iter(()))
    monkeypatch.setattr(two_parameters, "special_chart", lambda task, at, sheet, m: Gap(at.data / 2, at.data, phi))
    places, why = run(two_parameters.special_orbits(Gap(0.0, 0.0, phi), sense=1.0, again=again))
    c = np.array([place.orbit for place in places])
    assert len(asked) == 1 and 0.525 < asked[0] <= 0.53
    assert (c[-1] == 1.0 and why == "" and asked[0] in c) if same else (0.47 < c[-1] <= 0.48 and why == "nothing there")
    assert (np.diff(c) > 0).all()


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
    monkeypatch.setattr(folds_ahead, "folds_near", leaps)
    alone = static_curve()
    assert all(point.how == "followed" for point in alone.points)
    assert alone.gains[-1] == pytest.approx(whole.gains[-1], rel=2e-6)


def test_a_fold_that_cannot_be_expanded_is_followed(monkeypatch):
    def fails(*_):
        raise NoOrbit("not today")

    monkeypatch.setattr(folds_ahead, "expansion_at", fails)
    assert {point.how for point in static_curve().points} == {"followed"}


def test_a_parameter_that_is_zero_has_no_elasticity():
    found = fold_curve(Servo(), "switch", vary="friction.viscous", start=0.0, end=0.1, points=5)
    assert [point.how for point in found.points] == ["followed", *["batch"] * 3, "followed"]
    assert found.points[0].slope == pytest.approx((found.gains[1] - found.gains[0]) / found.values[1], rel=0.02)
    from_zero = Servo().replace(**{"friction.viscous": 0.0})
    up = fold_curve(from_zero, "switch", vary="friction.viscous", start=0.0, end=0.01, points=3)
    assert up.status is Status.CONVERGED and up.gains[0] == pytest.approx(found.gains[0], rel=2e-6)


def test_how_a_point_was_computed_is_kept_in_the_file(tmp_path):
    whole = static_curve()
    save_curve(whole, tmp_path / "curve.npz", {})
    assert [point.how for point in load_curve(tmp_path / "curve.npz")[0].points] == [p.how for p in whole.points]


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


# The command --------------------------------------------------------------------------------------------------


def test_command(capsys, tmp_path):
    table, picture = tmp_path / "curve.csv", tmp_path / "curve.png"
    words = ["fold-curve", "--model", "switch", "--vary", "friction.static", "--from", "0.5", "--to", "0.56"]
    code = cli.main([*words, "--points", "4", "--json", "--quiet", "--csv", str(table), "--plot", str(picture)])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    (record,) = json.loads(out)["curves"]
    assert {"model", "vary", "points", "special", "ended", "status", "wall_s"} <= set(record)
    assert record["special"] == []
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [float(row["gain"]) for row in rows] == [point["gain"] for point in record["points"]]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert cli.main([*words, "--points", "3"]) == 0
    out, err = capsys.readouterr()
    assert "friction.static reached" in out
    assert "K = " in err


@pytest.mark.parametrize(
    "words",
    [
        ["--vary", "friction.static", "--from", "0.3", "--to", "0.5"],
        ["--vary", "friction.static", "--from", "x", "--to", "0.5"],
        ["--vary", "friction.static", "--from", "0.5"],
        ["--vary", "friction.static", "--from", "0.5", "--to", "0.6", "--points", "2.5"],
        ["--vary", "friction.static", "--from", "0.5", "--to", "0.6", "--csv", "a.txt"],
        ["--vary", "friction.static", "--from", "0.5", "--to", "0.6", "--model", "switch", "--model", "switch"],
    ],
)
def test_command_refuses(words, capsys):
    assert cli.main(["fold-curve", *words]) == 2
    assert capsys.readouterr().out == ""


# Taken up behind an interruption, round a cusp


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

    monkeypatch.setattr(two_parameters, "folds_ahead", lambda *_: iter(()))
    monkeypatch.setattr(two_parameters, "chart_at", again)
    monkeypatch.setattr("casahunt.design.fold_curve.curve._Task.fold", fold)

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
