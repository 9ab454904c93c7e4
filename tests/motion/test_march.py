"""The march of any hybrid system, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from casahunt.hybrid.system import Event, Exit, Mode, System
from casahunt.motion.march import MarchFailure, Segment, march
from casahunt.motion.march_watch import Watch

NO_PARAMETERS = np.zeros(1)


def swing(x: Any, p: Any, sign: Any) -> Any:
    """y'' = -y and a clock."""
    return ca.vertcat(x[1], -x[0], 1)


def marched(
    *exits: Exit, start: float, mode: str = "swing", flow: Any = None, max_time: float = np.inf
) -> list[Segment]:
    system = System(
        "pendulum", ("y", "v", "t"), {"swing": Mode("swing", swing), "clock": Mode("clock", swing, flow=flow)},
        {"swing": exits, "clock": exits},
    )  # fmt: skip
    x = np.array([math.sin(start), math.cos(start), start])
    return march(
        system, mode, x, NO_PARAMETERS, scale=np.ones(3), until=lambda segment: segment.event == "end", tol=1e-10,
        max_time=max_time,
    )  # fmt: skip


END = Exit(Event("end", lambda x, duration, p: (x[2] - 10) / 10), +1, lambda x, p: "swing", mark=True)
DOWN = Event("down", lambda x, duration, p: x[0])


def test_an_event_that_leads_back_into_its_own_mode_is_passed():
    """y = sin t falls through zero at pi, 3 pi, ... from where it went up: the motion goes on, and ends in time.

    The side of the event on which it goes on is that of the motion there, not that on which the mode began.
    """
    (segment,) = marched(Exit(DOWN, -1, lambda x, p: "swing"), END, start=0.5)
    assert segment.event == "end"
    np.testing.assert_allclose(segment.end, [math.sin(10), math.cos(10), 10], atol=1e-9)
    inner = segment.w[:, :3]
    touched = [k * math.pi for k in (1, 3)]
    assert [min(abs(inner[:, 2] - t)) < 1e-9 for t in touched] == [True, True]
    assert len(segment.w) < 60


def test_a_marked_event_ends_a_segment():
    segments = marched(Exit(DOWN, -1, lambda x, p: "swing", mark=True), END, start=0.5)
    assert [s.event for s in segments] == ["down", "down", "end"]
    np.testing.assert_allclose([s.end[2] for s in segments], [math.pi, 3 * math.pi, 10], rtol=1e-12)


def test_exits_of_a_closed_form():
    """Of four exits the earliest to come that is crossed in its direction; none where none is: it rests for ever."""

    def flow(x: Any, T: Any, p: Any) -> Any:
        return ca.vertcat(x[0] * ca.cos(T) + x[1] * ca.sin(T), x[1] * ca.cos(T) - x[0] * ca.sin(T), x[2] + T)

    late = Exit(Event("end", lambda x, duration, p: x[2] - 2), +1, lambda x, p: "clock")
    soon = Exit(Event("end", lambda x, duration, p: x[2] ** 3 - 1), +1, lambda x, p: "clock")
    falling = Exit(Event("end", lambda x, duration, p: x[2] - 0.7), -1, lambda x, p: "clock")
    past = Exit(Event("end", lambda x, duration, p: x[2] - 0.2), +1, lambda x, p: "clock")
    (segment,) = marched(late, soon, falling, past, start=0.5, mode="clock", flow=flow)
    assert segment.duration == pytest.approx(0.5, rel=1e-13)
    np.testing.assert_allclose(segment.end, [math.sin(1), math.cos(1), 1], rtol=1e-13)
    (segment,) = marched(falling, start=0.5, mode="clock", flow=flow)
    assert segment.event == "" and segment.duration == math.inf and segment.end[2] == 0.5


def test_what_is_no_number_is_no_exit(monkeypatch: pytest.MonkeyPatch) -> None:
    """An event beyond zero on the polynomial that is no number on the motion itself is refused by name and time."""

    def broken(x: Any, duration: Any, p: Any) -> Any:  # by series: at one state; by intervals: see `at`
        return np.nan if isinstance(x, np.ndarray) and x.ndim == 1 else x[2] - 1

    monkeypatch.setattr(Watch, "at", lambda self, x: ([math.nan], [math.nan]))
    with pytest.raises(MarchFailure, match="'end' cannot be located at 0.[45]"):
        marched(Exit(Event("end", broken), +1, lambda x, p: "swing", mark=True), start=0.5)


def test_of_two_exits_next_to_each_other_the_first_is_taken() -> None:
    # On straight lines one interval is as long as one likes: both exits lie between the same two watched times.
    for late, early in ((0.50001, 0.5), (0.5, 0.50001)):
        line = Mode("line", lambda x, p, sign: ca.vertcat(1.0, 1.0))
        exits = (
            Exit(Event("x", lambda x, T, p, late=late: x[0] - late), +1, lambda x, p: "line", mark=True),
            Exit(Event("y", lambda x, T, p, early=early: x[1] - early), +1, lambda x, p: "line", mark=True),
        )
        system = System("line", ("x", "y"), {"line": line}, {"line": exits})
        found = march(system, "line", np.zeros(2), np.zeros(0), scale=np.ones(2), until=lambda s: True)
        assert found[0].event == ("y" if early < late else "x")
        assert found[0].duration == pytest.approx(0.5, abs=1e-12)
