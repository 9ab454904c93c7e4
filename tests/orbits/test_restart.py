"""Phases cut and joined: the states at any time stay what they were, and the times add up."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt.collocation.mesh import evaluate_phase
from casahunt.collocation.transcription import Setting, transcribe
from casahunt.hybrid.system import Cycle, Phase, VectorEvent, VectorMode
from casahunt.motion.phases import Segment
from casahunt.orbits.restart import breaks_of, from_segments, piece, relabelled
from casahunt.orbits.sequences import joined_phases

DEGREE = 4
ROUNDING = 1e-12
BREAKS = ([0, 0.3, 0.5, 1.0], [0, 0.6, 1.0], [0, 0.25, 0.8, 1.0])
DURATIONS = (1.0, 0.4, 2.0)


def cycle_of(phases: int, name: str = "known") -> Cycle:
    free, end = VectorMode("free", lambda x, p, sign: 0 * x), VectorEvent("end", lambda x, T, p: T - 1)
    return Cycle(name, ("a", "b"), ("c",), (Phase(free, end),) * phases, np.eye(2), 1)


def polynomial(phase: int):
    """The states of a phase (m, 2) at times [s] from its start."""
    coefficients = np.random.default_rng(phase).standard_normal((DEGREE + 1, 2))
    return lambda time: np.vander(np.atleast_1d(time), DEGREE + 1) @ coefficients


def start(durations=DURATIONS):
    """Three phases, every one a polynomial of its own; the jumps between them are nobody's business here."""
    t = transcribe(cycle_of(3), tuple(len(b) - 1 for b in BREAKS), DEGREE, "gauss")
    w = [
        polynomial(k)(durations[k] * (np.array(b)[:-1, None] + np.diff(b)[:, None] * t.scheme.points).ravel())
        for k, b in enumerate(BREAKS)
    ]
    w = np.vstack([states.reshape(-1, (DEGREE + 1) * 2) for states in w])
    nodes = np.vstack([w[:, :2], polynomial(2)(durations[2])])
    fractions = np.concatenate([np.diff(b) for b in BREAKS])
    return t, t.pack(w, nodes, np.array(durations)), Setting(fractions, np.zeros(1), np.ones(2), np.zeros(1))


def at(place, phase: int, time) -> np.ndarray:
    """The states of a phase at a time from its start."""
    t, u, setting = place
    return evaluate_phase(t, u, setting.fractions, phase, np.atleast_1d(time) / t.durations_of(u)[phase])


def test_a_piece_of_a_phase():
    t, u, setting = start()
    breaks, w, duration = piece(t, u, setting, 2, 0.1, 0.9)
    assert duration == pytest.approx(1.6, rel=ROUNDING)
    np.testing.assert_allclose(breaks, [0, 0.15 / 0.8, 0.7 / 0.8, 1], atol=ROUNDING)
    times = 2.0 * (0.1 + 0.8 * (breaks[:-1, None] + np.diff(breaks)[:, None] * t.scheme.points))
    np.testing.assert_allclose(w.reshape(-1, 2), polynomial(2)(times.ravel()), atol=100 * ROUNDING)
    # A boundary that the piece all but begins or ends at makes no stub.
    for a, b, expected in ((0.2499, 1.0, [0, 0.5501 / 0.7501, 1]), (0.0, 0.8003, [0, 0.25 / 0.8003, 1])):
        np.testing.assert_allclose(piece(t, u, setting, 2, a, b)[0], expected, atol=ROUNDING)
    np.testing.assert_allclose(breaks_of(t, setting, 1), BREAKS[1], atol=ROUNDING)


@pytest.mark.parametrize("middle", [0.4, 0.0, -0.1])
def test_a_phase_that_shrinks_to_nothing_is_taken_out(middle):
    """Its neighbours become one; where its own time runs backwards there is nothing of it to keep."""
    t, u, setting = start((1.0, middle, 2.0))
    parts = []
    for k in range(3):
        breaks, w, duration = piece(t, u, setting, k)
        parts.append(Segment("free", "end", duration, breaks, w, w[-1, -2:]))
    whole, lasts = joined_phases(parts), max(middle, 0.0)
    assert whole.duration == pytest.approx(3.0 + lasts, rel=ROUNDING) and len(whole.w) == (8 if middle > 0 else 6)
    stages = t.scheme.points
    times = whole.duration * (whole.breaks[:-1, None] + np.diff(whole.breaks)[:, None] * stages)
    for states, at in zip(whole.w.reshape(len(whole.w), -1, 2), times, strict=True):
        k, began = next((k, b) for k, b, e in ((0, 0.0, 1.0), (1, 1.0, 1 + lasts), (2, 1 + lasts, 9.0)) if at[-1] < e)
        np.testing.assert_allclose(states, polynomial(k)(at - began), atol=1e-10)


def test_the_same_unknowns_for_another_cycle():
    t, u, setting = start()
    other = cycle_of(3, "another")
    new, v, there = relabelled(other, t, u, setting)
    assert new.cycle == other and new != t and v is u and there is setting
    assert (new.counts, new.degree, new.kind) == (t.counts, t.degree, t.kind)


def test_a_motion_becomes_the_unknowns_of_a_cycle():
    """Two passes through one segment, the second mirrored, and a rest in closed form between them."""
    rest = VectorMode("rest", lambda x, p, sign: 0 * x, flow=lambda x, T, p: x)
    end = VectorEvent("end", lambda x, T, p: T - 1)
    free = cycle_of(1).phases[0]
    cycle = Cycle("there and back", ("a", "b"), ("c",), (free, Phase(rest, end), free), np.eye(2), 1)
    t, u, setting = start()
    breaks, w, duration = piece(t, u, setting, 0)
    reach = np.max(np.abs(w.reshape(-1, 2)), axis=0)
    stop = w[-1, -2:]
    slip = Segment("free", "end", duration, breaks, w, stop)
    stand = Segment("rest", "end", 5.0, np.array([0.0, 1.0]), stop[None], stop)
    p, dp = np.array([1.5]), np.array([1.0])
    new, v, fresh = from_segments(cycle, [(1.0, slip), (1.0, stand), (-1.0, slip)], p, dp, degree=DEGREE, kind="gauss")
    assert new.counts == (3, 0, 3)
    np.testing.assert_array_equal(new.durations_of(v), [duration, 5.0, duration])
    np.testing.assert_allclose(fresh.scale, reach, rtol=ROUNDING)
    np.testing.assert_allclose(fresh.fractions, np.tile(np.diff(breaks), 2), atol=ROUNDING)
    assert fresh.p is p and fresh.dp is dp
    found = new.intervals_of(v).reshape(6, -1, 2) * fresh.scale
    np.testing.assert_allclose(found[:3].reshape(3, -1), w, rtol=ROUNDING)
    np.testing.assert_allclose(found[3:].reshape(3, -1), -w, rtol=ROUNDING)
    nodes = new.nodes_of(v) * fresh.scale
    np.testing.assert_allclose(nodes, np.vstack([w[:, :2], stop, -w[:, :2], -stop]), rtol=ROUNDING)
