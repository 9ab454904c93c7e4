"""The engine on a system that is no servo: found, followed, given multipliers, saved; apart from other problems."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from casahunt.continuation.walk import walk, walk_naturally
from casahunt.errors import InputError
from casahunt.motion.phases import march
from casahunt.orbits import archive
from casahunt.orbits.adapt import Options, finished, refined, solve_adaptively
from casahunt.orbits.orbit import Orbit, unknowns_of
from casahunt.orbits.restart import from_segments
from problems import belt
from problems.fixed_sequence import FixedSequence

ROOT = Path(__file__).resolve().parents[2]
TOL = 1e-9


def found(problem: FixedSequence = belt.PROBLEM, tol: float = TOL) -> Orbit:
    """The cycle, from the motion after its first stick."""
    began, p, options = time.perf_counter(), problem.vector(), Options(tol=tol)
    segments = march(
        belt.SYSTEM, "slip", np.array([1.0, problem.value("belt")]), p, scale=np.ones(2),
        until=lambda segment: segment.mode == "stick", degree=8,
    )  # fmt: skip
    start = from_segments(
        belt.CYCLE, [(1.0, s) for s in segments], p, problem.direction("belt"), degree=8, kind="gauss"
    )
    return finished(solve_adaptively(problem, start, options, solver="newton"), problem, options, began, "the cycle")


def assert_true(orbit: Orbit, speed: float) -> None:
    (slip, stop), period = belt.SLIPS[speed], belt.TRUTH[speed].period
    assert orbit.problem.value("belt") == speed
    assert orbit.period == pytest.approx(period, rel=10 * orbit.period_error + 1e-12)
    assert orbit.arcs[0].duration == pytest.approx(slip, rel=10 * TOL)
    assert orbit.arcs[0].end[0] == pytest.approx(stop, rel=10 * TOL)


def test_found_with_its_multipliers():
    """After a stick every motion leaves from the same point: the multiplier is zero."""
    orbit = found()
    assert_true(orbit, 0.2)
    assert type(orbit) is Orbit and not orbit.half and orbit.error_estimate <= TOL
    assert orbit.multipliers.trivial_error < 1e-8
    assert abs(orbit.multipliers.leading) < 1e-8 and orbit.stable
    t, x = orbit.sample()
    assert t[-1] == pytest.approx(orbit.period, rel=1e-14) and x.shape == (2, t.size)
    np.testing.assert_allclose(x[:, -1], x[:, 0], atol=1e-12)


def test_followed_in_the_belts_speed():
    *_, last = walk(found(), low=0.1, high=0.5, options=Options(tol=TOL))
    assert_true(last, 0.5)
    *_, last = walk_naturally(found(), vary="belt", low=0.1, high=0.35, options=Options(tol=TOL))
    assert_true(last, 0.35)
    with pytest.raises(InputError, match="speed"):
        next(walk(found(), vary="speed", low=0.1, high=0.5))


def read_orbit(path, pose):
    file = archive.Archive(path, "orbit")
    return file.checked(lambda: file.orbit(file.metadata["orbit"], pose))


def test_kept_in_a_file(tmp_path):
    orbit = found()
    archive.save_orbit(orbit, tmp_path / "belt.npz")
    loaded = read_orbit(
        tmp_path / "belt.npz", lambda record: replace(belt.PROBLEM, values=tuple(record["parameters"].values()))
    )
    assert loaded.problem == orbit.problem and loaded.period == orbit.period
    np.testing.assert_array_equal(loaded.multipliers.full, orbit.multipliers.full)
    # More arrays than the format has are none of its business, fewer are.
    with np.load(tmp_path / "belt.npz") as file:
        arrays = dict(file)
    np.savez(tmp_path / "more.npz", **arrays, notes=np.zeros(3))
    assert read_orbit(tmp_path / "more.npz", lambda record: orbit.problem).period == orbit.period
    np.savez(tmp_path / "flat.npz", **{**arrays, "numbers": arrays["numbers"][None]})
    with pytest.raises(InputError, match="2 dimensions"):
        read_orbit(tmp_path / "flat.npz", lambda record: orbit.problem)
    for name in arrays:
        np.savez(tmp_path / "fewer.npz", **{name: arrays[name]})
        with pytest.raises(InputError, match="it has no metadata"):
            read_orbit(tmp_path / "fewer.npz", lambda record: orbit.problem)


def test_a_cycle_of_one_problem_is_never_solved_as_anothers():
    """It would come back converged: the equations do not know whose they are."""
    from casahunt.servo.problem import Hunting
    from casahunt.servo.servo import Servo

    orbit = found()
    start, options = unknowns_of(orbit), Options()
    assert solve_adaptively(belt.PROBLEM, start, options, solver="newton").status.ok
    slower = replace(belt.CYCLE, closure=np.diag([1.0, -1.0]), repeats=2)
    for other in (Hunting("switch", Servo(), 0.1), FixedSequence(slower, belt.VALUES, "belt")):
        with pytest.raises(ValueError, match="no cycle"):
            solve_adaptively(other, start, options, solver="newton")
        with pytest.raises(ValueError, match="no cycle"):
            refined(replace(orbit, problem=other), options)


def test_cycles_are_compared_by_value():
    again = replace(belt.CYCLE)
    assert again == belt.CYCLE and hash(again) == hash(belt.CYCLE) and again is not belt.CYCLE
    others = (
        replace(belt.CYCLE, name="another"),
        replace(belt.CYCLE, phases=belt.CYCLE.phases[::-1]),
        replace(belt.CYCLE, closure=np.diag([1.0, -1.0]), repeats=2),
        replace(belt.CYCLE, measured=1),
    )
    assert len({belt.CYCLE, again, *others}) == 5


def test_problems_are_checked():
    with pytest.raises(ValueError, match="5 parameters are needed"):
        FixedSequence(belt.CYCLE, (1.0,), "belt")
    with pytest.raises(ValueError, match="'speed' is none"):
        FixedSequence(belt.CYCLE, belt.VALUES, "speed")
    with pytest.raises(ValueError, match="measured"):
        replace(belt.CYCLE, measured=2)


def test_without_the_servo_ever_imported():
    """The same in a process of its own, in which `casahunt.servo` is never loaded."""
    code = (
        "import sys; sys.path.insert(0, 'tests/orbits')\n"
        "import test_engine as t\n"
        "t.test_found_with_its_multipliers(); t.test_followed_in_the_belts_speed()\n"
        "loaded = [m for m in sys.modules if m.startswith(('casahunt.servo', 'casahunt.design', 'casahunt.views'))]\n"
        "assert not loaded, loaded\n"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
