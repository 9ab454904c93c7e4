"""The march of any hybrid system, against closed forms."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from casahunt.collocation.scheme import scheme
from casahunt.hybrid.system import Exit, VectorEvent, VectorMode, VectorSystem
from casahunt.motion.interval_newton import newton_steps
from casahunt.motion.march_exits import end_of_flow, flow_to, locate_exit
from casahunt.motion.march_step import ExtrapolatedStages, Stepper
from casahunt.motion.march_watch import EventWatch, TooLong, _first_beyond
from casahunt.motion.phases import MarchFailure, Segment, march
from casahunt.motion.sensitivity import forward_sensitivity

NO_PARAMETERS = np.zeros(1)


def swing(x: Any, p: Any, sign: Any) -> Any:
    """y'' = -y and a clock."""
    return ca.vertcat(x[1], -x[0], 1)


def marched(
    *exits: Exit, start: float, mode: str = "swing", flow: Any = None, max_time: float = np.inf
) -> list[Segment]:
    system = VectorSystem(
        "pendulum", ("y", "v", "t"),
        {"swing": VectorMode("swing", swing), "clock": VectorMode("clock", swing, flow=flow)},
        {"swing": exits, "clock": exits},
    )  # fmt: skip
    x = np.array([math.sin(start), math.cos(start), start])
    return march(
        system, mode, x, NO_PARAMETERS, scale=np.ones(3), until=lambda segment: segment.event == "end", tol=1e-10,
        max_time=max_time,
    )  # fmt: skip


END = Exit(VectorEvent("end", lambda x, duration, p: (x[2] - 10) / 10), +1, lambda x, p: "swing", mark=True)
DOWN = VectorEvent("down", lambda x, duration, p: x[0])


def test_an_event_that_leads_back_into_its_own_mode_is_passed():
    """y = sin t falls through zero at pi, 3 pi, ... from where it went up: the motion goes on, and ends in time.

    The side of the event on which it goes on is that of the motion there, not that on which the mode began.
    """
    (segment,) = marched(Exit(DOWN, -1, lambda x, p: "swing"), END, start=0.5)
    assert segment.event == "end"
    np.testing.assert_allclose(segment.end, [math.sin(10), math.cos(10), 10], atol=1e-9)
    inner = segment.w[:, :3]
    grazed = [k * math.pi for k in (1, 3)]
    assert [min(abs(inner[:, 2] - t)) < 1e-9 for t in grazed] == [True, True]
    assert len(segment.w) < 60


@pytest.mark.parametrize("width", [1e-1, 1e-2, 1e-3, 1e-4])
def test_an_event_that_is_passed_and_passed_back_between_two_looks_is_met(width: float) -> None:
    """y = sin t is between -w and w from pi - asin w to pi + asin w: for less than from one look to the next."""
    narrow = VectorEvent("end", lambda x, duration, p: 1 - (x[0] / width) ** 2)
    segments = marched(Exit(narrow, +1, lambda x, p: "swing", mark=True), start=0.5)
    assert segments[-1].event == "end"
    assert 0.5 + segments[-1].duration == pytest.approx(math.pi - math.asin(width), abs=1e-9)


def test_a_marked_event_ends_a_segment():
    segments = marched(Exit(DOWN, -1, lambda x, p: "swing", mark=True), END, start=0.5)
    assert [s.event for s in segments] == ["down", "down", "end"]
    np.testing.assert_allclose([s.end[2] for s in segments], [math.pi, 3 * math.pi, 10], rtol=1e-12)


def test_exits_of_a_closed_form():
    """Of four exits the earliest to come that is crossed in its direction; none where none is: it rests for ever."""

    def flow(x: Any, T: Any, p: Any) -> Any:
        return ca.vertcat(x[0] * ca.cos(T) + x[1] * ca.sin(T), x[1] * ca.cos(T) - x[0] * ca.sin(T), x[2] + T)

    late = Exit(VectorEvent("end", lambda x, duration, p: x[2] - 2), +1, lambda x, p: "clock")
    soon = Exit(VectorEvent("end", lambda x, duration, p: x[2] ** 3 - 1), +1, lambda x, p: "clock")
    falling = Exit(VectorEvent("end", lambda x, duration, p: x[2] - 0.7), -1, lambda x, p: "clock")
    past = Exit(VectorEvent("end", lambda x, duration, p: x[2] - 0.2), +1, lambda x, p: "clock")
    (segment,) = marched(late, soon, falling, past, start=0.5, mode="clock", flow=flow)
    assert segment.duration == pytest.approx(0.5, rel=1e-13)
    np.testing.assert_allclose(segment.end, [math.sin(1), math.cos(1), 1], rtol=1e-13)
    (segment,) = marched(falling, start=0.5, mode="clock", flow=flow)
    assert segment.event == "" and segment.duration == math.inf and segment.end[2] == 0.5


@pytest.mark.parametrize("unit", [1.0, 1e10, 1e-10])
def test_of_two_exits_of_a_closed_form_the_first_is_taken(unit: float) -> None:
    """In any unit: of a linear event rounding is left, however large."""
    ramp = VectorMode("ramp", swing, flow=lambda x, T, p: x + unit / 0.7 * T)
    for levels in ((1.3, 2.0), (2.0, 1.3), (2.0, -1.0, 1.3)):
        exits = tuple(
            Exit(
                VectorEvent(str(level), lambda x, T, p, at=level * unit: x[0] - at), +1, lambda x, p: "ramp", mark=True
            )
            for level in levels
        )
        system = VectorSystem("ramp", ("x",), {"ramp": ramp}, {"ramp": exits})
        for start in np.linspace(-0.9, 0.9, 8):
            x = np.full(1, start * unit)
            (found,) = march(system, "ramp", x, NO_PARAMETERS, scale=np.full(1, unit), until=lambda s: True)
            assert found.event == "1.3" and found.duration == pytest.approx((1.3 - start) * 0.7, rel=1e-13)


def test_an_event_that_a_closed_form_does_not_change_is_no_exit() -> None:
    """x[1] stays: no time is its end; one that is only nearly known stays as it is."""
    still = Exit(VectorEvent("still", lambda x, T, p: x[1] - 5), +1, lambda x, p: "ramp")
    ramp, x = VectorMode("ramp", swing, flow=lambda x, T, p: x + ca.vertcat(T, 0)), np.zeros(2)
    assert end_of_flow(ramp, (still,), x, NO_PARAMETERS) is None
    late = Exit(VectorEvent("late", lambda x, T, p: x[0] - 3), +1, lambda x, p: "ramp")
    found = end_of_flow(ramp, (still, late), x, NO_PARAMETERS)
    assert found is not None and found[:2] == (pytest.approx(3.0, rel=1e-13), late)
    for way_out, duration in ((late, 3.0), (still, 2.9), (None, 2.9)):
        T, end = flow_to(ramp, (still, late), way_out, x, 2.9, NO_PARAMETERS)
        assert T == pytest.approx(duration, rel=1e-13) and end == pytest.approx([duration, 0.0])


def test_what_is_no_number_is_no_exit(monkeypatch: pytest.MonkeyPatch) -> None:
    """An event beyond zero on the polynomial that is no number on the motion itself is refused by name and time."""

    def broken(x: Any, duration: Any, p: Any) -> Any:  # by series: at one state; by intervals: see `at`
        return np.nan if isinstance(x, np.ndarray) and x.ndim == 1 else x[2] - 1

    monkeypatch.setattr(EventWatch, "at", lambda self, x: ([math.nan], [math.nan]))
    with pytest.raises(MarchFailure, match="'end' cannot be located at 0.[45]"):
        marched(Exit(VectorEvent("end", broken), +1, lambda x, p: "swing", mark=True), start=0.5)


@pytest.mark.parametrize("flow", [None, lambda x, T, p: x + T])
@pytest.mark.parametrize("wrong", [math.nan, math.inf])
@pytest.mark.parametrize("jumps", [False, True])
def test_a_phase_that_begins_with_no_number_is_refused(flow: Any, wrong: float, jumps: bool) -> None:
    """By the march or by a closed form, from the start or behind a jump; no comparison with no number ends a march."""
    ramp = VectorMode("ramp", lambda x, p, sign: ca.vertcat(1.0, 1.0), flow=flow)

    def reset(x: Any, p: Any) -> Any:
        return ca.vertcat(x[0], wrong)

    end = Exit(VectorEvent("end", lambda x, T, p: x[0] - 2), +1, lambda x, p: "ramp", mark=True, reset=reset)
    system = VectorSystem("ramp", ("position", "load"), {"ramp": ramp}, {"ramp": (end,)})
    x, at = (np.zeros(2), 2) if jumps else (np.array([0.0, wrong]), 0)
    with pytest.raises(MarchFailure, match=f"mode 'ramp': the state 'load' with which it begins at {at} s is not fin"):
        march(system, "ramp", x, NO_PARAMETERS, scale=np.ones(2), until=lambda segment: False)


@pytest.mark.parametrize("stiff", [False, True])
def test_a_field_that_is_no_number_at_the_start_is_refused(stiff: bool) -> None:
    """The length of the first interval is no number either: no smaller than any."""
    root = VectorMode("root", lambda x, p, sign: ca.sqrt(x), stiff=stiff)
    system = VectorSystem("root", ("x",), {"root": root}, {"root": ()})
    with pytest.raises(MarchFailure, match="mode 'root': the step size vanished at 0 s"):
        march(system, "root", -np.ones(1), NO_PARAMETERS, scale=np.ones(1), until=lambda segment: True)


def test_of_two_exits_next_to_each_other_the_first_is_taken() -> None:
    # On straight lines one interval is as long as one likes: both exits lie between the same two watched times.
    for late, early in ((0.50001, 0.5), (0.5, 0.50001)):
        line = VectorMode("line", lambda x, p, sign: ca.vertcat(1.0, 1.0))
        exits = (
            Exit(VectorEvent("x", lambda x, T, p, late=late: x[0] - late), +1, lambda x, p: "line", mark=True),
            Exit(VectorEvent("y", lambda x, T, p, early=early: x[1] - early), +1, lambda x, p: "line", mark=True),
        )
        system = VectorSystem("line", ("x", "y"), {"line": line}, {"line": exits})
        found = march(system, "line", np.zeros(2), np.zeros(0), scale=np.ones(2), until=lambda s: True)
        assert found[0].event == ("y" if early < late else "x")
        assert found[0].duration == pytest.approx(0.5, abs=1e-12)


# Intervals, their exits and their phases ------------------------------------------------------------------------------


def stepper_of(field: Any, n: int, degree: int = 7) -> Stepper:
    return Stepper(lambda x, p, sign: field(x), scheme(degree, "radau"), NO_PARAMETERS, np.ones(n), 0.0)


def ring(x: Any) -> Any:
    """n oscillators, each pushed by the next one: x_k'' = -x_k + 0.1 sin(x_{k+1})."""
    n = x.shape[0] // 2
    return ca.vertcat(x[n:], *(-ca.sin(x[k]) + 0.1 * ca.sin(x[(k + 1) % n]) for k in range(n)))


@pytest.mark.parametrize("n", [1, 4])
def test_an_interval_by_compiled_steps_and_by_numpy(n: int) -> None:
    """Few equations are factorised in the compiled function, many by numpy: the same interval."""
    stepper, x = stepper_of(ring, 2 * n), np.linspace(0.3, 1.1, 2 * n)
    assert (newton_steps(stepper.field, 2 * n, 1, 7, "radau") is None) == (n == 4)
    found = stepper(x, ExtrapolatedStages(x), 0.5, 1e-14)
    truth = stepper._factorised(x, ExtrapolatedStages(x), 0.5, 1e-30)
    assert found is not None and truth is not None
    np.testing.assert_allclose(found.stages, truth.stages, atol=1e-14)
    np.testing.assert_allclose(found.end, truth.end, atol=1e-14)
    assert found.error == pytest.approx(truth.error, rel=1e-6)


def test_an_interval_beyond_which_there_is_no_number() -> None:
    """The largest of some numbers and none is a number: where stages leave the domain of the field is no interval."""
    stepper = stepper_of(lambda x: ca.vertcat(-1, ca.sqrt(x[0])), 2)
    x = np.array([1.0, 0.0])
    good = stepper(x, ExtrapolatedStages(x), 0.5, 1e-12)
    assert good is not None and good.end[1] == pytest.approx((1 - 0.5**1.5) * 2 / 3, rel=1e-6)
    assert stepper(x, ExtrapolatedStages(x), 1.5, 1e-12) is None


def test_a_zero_pivot_is_no_interval() -> None:
    """At h a_11 f' = 1 the factors without pivoting do not exist; a shorter interval is solved."""
    stepper, x = stepper_of(lambda x: ca.vertcat(x[0]), 1), np.array([1.0])
    h = 1 / scheme(7, "radau").matrix[0, 0]
    assert stepper(x, ExtrapolatedStages(x), h, 1e-12) is None
    short = stepper(x, ExtrapolatedStages(x), 0.1, 1e-12)
    assert short is not None and short.end[0] == pytest.approx(math.exp(0.1), rel=1e-13)


class Counting:
    """A stepper that counts its calls, and those of the compiled function."""

    def __init__(self, stepper: Stepper) -> None:
        self.stepper, self.calls, self.triggers, self.buffers = stepper, 0, 0, self
        self._own = stepper._compiled.buffers if stepper._compiled is not None else None
        stepper._compiled = self  # type: ignore[assignment]

    def __call__(self, *arguments: Any) -> Any:
        self.calls += 1
        return self.stepper(*arguments)

    def trigger(self) -> None:
        self.triggers += 1
        self._own.trigger()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._own if name in ("inputs", "outputs") else self.stepper, name)


def test_steps_that_do_not_shrink_are_given_up_early() -> None:
    """x' = 1 + x^2 has no solution beyond pi/2."""
    counting, x = Counting(stepper_of(lambda x: 1 + x[0] ** 2, 1)), np.array([0.0])
    assert counting(x, ExtrapolatedStages(x), 3.0, 1e-12) is None and counting.triggers <= 2


def test_a_crossing_that_true_intervals_do_not_confirm_is_given_up_early() -> None:
    """The polynomial at hand crosses, the motion y = sin t does not: the bracket is not halved to nothing."""
    high = Exit(VectorEvent("high", lambda x, duration, p: x[0] - 2), +1, lambda x, p: "swing")
    counting, start = Counting(stepper_of(lambda x: ca.vertcat(x[1], -x[0]), 2)), np.array([0.0, 1.0])
    watch = EventWatch((high,), None, counting)  # type: ignore[arg-type]
    stages = np.stack([4 * scheme(7, "radau").stages, np.ones(7)], axis=1).ravel()
    assert locate_exit(watch, high, 0.5625, start, stages, 1.0) is None and counting.calls <= 4


@pytest.mark.parametrize("look", [1, 2, 3, 9, 15, 16])
def test_an_exit_is_located_by_few_intervals(look: int) -> None:
    """x = tan t, between any two looks at its interval: Newton's method on true ones."""
    counting, start, h = Counting(stepper_of(lambda x: 1 + x[0] ** 2, 1)), np.array([0.0]), 0.4
    solved = counting(start, ExtrapolatedStages(start), h, 1e-20)
    for part in (-0.5, 1e-6, 0.5, 1 - 1e-6, 1.5):  # of the way from the look before; beyond it the polynomial strays
        time = h * (look - 1 + part) / 16
        if not 0 < time < h:
            continue
        way_out = Exit(VectorEvent("out", lambda x, T, p, at=time: ca.atan(x[0]) - at), +1, lambda x, p: "swing")
        watch, counting.calls = EventWatch((way_out,), None, counting), 0  # type: ignore[arg-type]
        found = locate_exit(watch, way_out, look / 16, start, solved.stages, h)
        assert found is not None and found[0] == pytest.approx(time, abs=1e-13) and counting.calls <= 4


@pytest.mark.parametrize(
    ("h", "first"),
    [
        ([-3, -2, -1, 1, 2], 3),  # crossed
        ([-3, -2, -1, -2, -3], 0),  # not met
        ([-3, -2, 0.1, 2, 3], 3),  # straying across zero where it crosses from clearly before to clearly behind
        ([-3, -2, -1, 2, 0.1], 3),  # what comes behind the exit does not matter
        ([-3, -2, -1, -1, 0.1], 4),  # the end is exact
        ([-3, 0.1, -1, 2, 3], None),  # it may have crossed before
        ([-3, -2, 0.1, -1, -2], None),
        ([-3, -0.1, 0.1, 2, 3], None),
        ([-3, 0.1, 0.2, 2, 3], None),
    ],
)
def test_the_first_watched_time_beyond_zero(h: list[float], first: int | None) -> None:
    if first is None:
        with pytest.raises(TooLong):
            _first_beyond(np.array(h, float), np.zeros(3, dtype=bool), 0.5)
    else:
        assert _first_beyond(np.array(h, float), np.zeros(3, dtype=bool), 0.5) == first


@pytest.mark.parametrize(("hidden", "doubtful"), [([0, 0, 0], False), ([1, 0, 0], True), ([0, 1, 1], False)])
def test_what_hides_before_the_first_watched_time_beyond_zero(hidden: list[int], doubtful: bool) -> None:
    """Of watched times 1 to 3; the event is beyond zero from the third on, which its rise before tells."""
    asked = np.array([-3, -1, -2, 1, 2], float), np.array(hidden, dtype=bool), 0.5
    if doubtful:
        with pytest.raises(TooLong):
            _first_beyond(*asked)
    else:
        assert _first_beyond(*asked) == 3


def test_a_phase_has_its_intervals_when_they_are_asked_for() -> None:
    """Who wants the end of a motion pays for no mesh; copied, sent elsewhere or replaced it has them."""
    (segment,) = marched(END, start=0.5)
    assert (segment.start == [math.sin(0.5), math.cos(0.5), 0.5]).all() and segment.count > 0
    assert not hasattr(segment, "widths")
    copies = [pickle.loads(pickle.dumps(segment)), replace(segment), segment]
    for one in copies:
        assert one.w.shape == (len(one.breaks) - 1, 3 * 8) and one.breaks[-1] == 1
        np.testing.assert_array_equal(one.w, segment.w)
        np.testing.assert_array_equal(one.w[0, :3], one.start)


def test_a_phase_along_series_has_the_intervals_that_are_asked_for() -> None:
    """Of one motion; those of a phase that was followed by intervals, or in closed form, are what they are."""
    (segment,) = marched(END, start=0.5)
    finer = segment.meshed(1e-13)
    assert len(finer.w) > 1.5 * len(segment.w) and finer.duration == segment.duration and finer.count == segment.count
    np.testing.assert_array_equal(finer.end, segment.end)
    s, last = scheme(7), finer.w.reshape(len(finer.w), 8, 3)
    assert np.abs(np.einsum("c,icn->in", s.last_mode, last)).max() < 1e-13
    solved = replace(segment)
    assert solved.meshed(1e-13) is solved


def test_more_intervals_than_there_may_be_are_refused_at_once() -> None:
    """Where a bound of their number allows too many, they are counted before anybody asks for them."""
    system = VectorSystem("pendulum", ("y", "v", "t"), {"swing": VectorMode("swing", swing)}, {"swing": (END,)})

    def run(most: int, degree: int) -> list[Segment]:
        return march(
            system, "swing", np.array([0.0, 1.0, 0.0]), NO_PARAMETERS, scale=np.ones(3), until=lambda s: True,
            tol=1e-6, degree=degree, max_intervals=most,
        )  # fmt: skip

    needed = len(run(20_000, 2)[0].w)
    assert len(run(needed, 2)[0].w) == needed
    with pytest.raises(MarchFailure, match=f"no exit after 10 s and {needed - 1} intervals"):
        run(needed - 1, 2)


def test_an_event_that_changes_by_rounding_alone_is_no_exit() -> None:
    """m(t) = m - k x t - Fs with x = 1e-17: far away, with slopes that are rounding, of whatever sign, in any unit."""
    ramp = VectorMode("ramp", swing, flow=lambda x, T, p: ca.vertcat(x[0], x[1] - x[0] * T))
    x = np.array([1.0, 0.0])
    for unit in (1.0, 1e10, 1e-10):
        for m in np.linspace(-0.6, 0.5, 23):
            for slope in (0.0, 1e-17, -1e-17, 1e-16, -1e-16):

                def far(x, T, p, m=m, slope=slope, unit=unit):
                    return unit * ((m - 0.53) + slope * x[1])

                exit_ = Exit(VectorEvent("far", far), +1, lambda x, p: "ramp", mark=True)
                found = end_of_flow(ramp, (exit_,), x, NO_PARAMETERS)
                assert found is None or found[0] > 1e13


def test_how_the_end_of_a_phase_moves():
    """Against closed forms: y'' = -k y, by the start and by k, at a fixed duration."""

    def field(x: Any, p: Any, sign: Any) -> Any:
        return ca.vertcat(x[1], -p[0] * x[0])

    end = Exit(VectorEvent("down", lambda x, duration, p: x[0]), -1, lambda x, p: "swing", mark=True)
    system = VectorSystem("spring", ("y", "v"), {"swing": VectorMode("swing", field)}, {"swing": (end,)})
    k, scale = 1.7, np.array([0.5, 2.0])
    p, w = np.array([k]), math.sqrt(k)
    (segment,) = march(system, "swing", np.array([0.3, 0.4]), p, scale=scale, until=lambda _: True, tol=1e-12)
    c, s = math.cos(w * segment.duration), math.sin(w * segment.duration)
    dx = np.diag(scale) @ np.eye(2, 3)
    moved, rate = forward_sensitivity(system, segment, dx / scale[:, None], p, np.ones(1), scale=scale, degree=7)
    through = np.array([[c, s / w], [-w * s, c]]) @ dx[:, :2]
    dw, T = 1 / (2 * w), segment.duration
    by_k = dw * np.array([
        -0.3 * T * s + 0.4 * (T * c / w - s / w**2), -0.3 * (s + w * T * c) - 0.4 * T * s,
    ])  # fmt: skip
    np.testing.assert_allclose(moved * scale[:, None], np.column_stack([through, by_k]), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rate * scale, [segment.end[1], -k * segment.end[0]], atol=1e-9)
