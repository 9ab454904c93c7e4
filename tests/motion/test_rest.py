"""A motion that comes to rest in modes that end again and again: what is left of it is rounding."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt.errors import NoOrbit
from casahunt.hybrid import Event, Mode, System
from casahunt.motion import simulate
from casahunt.motion.segment import Segment
from casahunt.motion.simulation import _difference
from casahunt.orbits import find_cycle
from problems import canudas_gain

HIGH_GAIN = {"K": 47.0}


@pytest.mark.parametrize("x", [1.0, 0.1])
def test_no_cycle_is_sought_in_the_rounding_of_a_motion_at_rest(x):
    """The bristle creeps for thousands of seconds, and turns back with v = 1e-19 behind that."""
    with pytest.raises(NoOrbit, match="was found: the motion comes to rest") as refusal:
        find_cycle(canudas_gain.SYSTEM, "backwards", parameters=HIGH_GAIN, x=x, v=0.0, w=0.0, z=0.0)
    assert "fold" not in str(refusal.value)  # there is a cycle at this gain: tries on the way say nothing of it


def test_it_rests_where_the_forces_do():
    motion = simulate(canudas_gain.SYSTEM, "backwards", duration=5e4, parameters=HIGH_GAIN, x=1.0, v=0.0, w=0.0, z=0.0)
    end, p = motion.end, canudas_gain.SYSTEM.parameters
    assert motion.duration == pytest.approx(5e4, rel=1e-12) and motion.error < 0.01  # of the last reversal, at 1e-15
    assert abs(end["v"]) < 1e-15 and abs(end["x"]) < 1e-15
    assert HIGH_GAIN["K"] * p["ki"] * end["w"] == pytest.approx(-p["sigma0"] * end["z"], rel=1e-9)
    times, states = motion.sample()
    assert times[-1] == pytest.approx(5e4) and np.ptp(states[:, times > 2.5e4], axis=1).max() < 1e-13


@pytest.mark.parametrize(("rests", "same"), [(1e-16, True), (1e-9, False)])
def test_two_runs_of_a_motion_may_rest_in_other_phases(rests, same):
    """One of them turns back in its rounding, the other does not: the last reversal before is that of both."""

    def run(last, *at):
        times = (4.0, last, *np.full(len(at), 10.0))
        ends = np.array([[1.0], [0.3], [0.0], *([x] for x in at)])
        names = zip(("up", "down") * 3, times, ends[:-1], ends[1:], strict=False)
        return [Segment(mode, "turns", T, np.array([0.0, 1.0]), np.array([a, b]), b) for mode, T, a, b in names]

    found = _difference(run(5.0, rests, -rests, rests), run(25.0, rests), np.ones(1))
    assert found == (pytest.approx(20 / 39) if same else np.inf)


def _two_modes(damping: float, stiff: bool) -> System:
    """x'' + damping x' + x = 0 beside a state that stands, in modes by the sign of v."""

    def field(x, p):
        return {"x": x.v, "v": -damping * x.v - x.x, "y": 0 * x.y}

    def speed(x, p):
        return x.v

    return System(
        "two modes", ("x", "v", "y"), {},
        (
            Mode("forth", field, stiff=stiff, ends=(Event("turns back", speed, -1, to="back"),)),
            Mode("back", field, stiff=stiff, ends=(Event("turns forth", speed, +1, to="forth"),)),
        ),
    )  # fmt: skip


def test_a_motion_that_leaves_an_equilibrium_is_not_at_rest():
    """For 60 reversals it is less than 1e-13 of what it comes to."""
    motion = simulate(_two_modes(-0.1, stiff=False), "back", duration=780.0, x=1e-17, v=0.0, y=1.0)
    w = np.sqrt(1 - 0.05**2)
    exact = 1e-17 * np.exp(39.0) * (np.cos(780 * w) - 0.05 / w * np.sin(780 * w))
    assert motion.end["x"] == pytest.approx(exact, rel=1e-7) and len(motion.events) == int(780 * w / np.pi)


def test_one_that_decays_comes_to_rest():
    motion = simulate(_two_modes(0.1, stiff=True), "back", duration=1e4, x=1.0, v=0.0, y=1.0)
    assert motion.duration == pytest.approx(1e4) and abs(motion.end["x"]) < 1e-12 and motion.end["y"] == 1.0


@pytest.mark.parametrize("stiff", [False, True])
def test_it_is_said_of_a_motion_that_repeats_only_because_it_rests(stiff):
    with pytest.raises(NoOrbit, match="was found: the motion comes to rest"):
        find_cycle(_two_modes(0.1, stiff), "back", x=1.0, v=0.0, y=1.0)
