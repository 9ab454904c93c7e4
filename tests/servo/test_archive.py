"""Orbits and branches in files: what is read is what was written, and goes on as if it had not been away."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from archived import ORBITS, assert_same, computed, refusal

from casahunt import (
    Branch,
    Options,
    Servo,
    SpecialPoint,
    find_orbit,
    load_branch,
    load_orbit,
    save_branch,
    save_orbit,
    walk,
)
from casahunt.continuation import End, follow
from casahunt.hybrid.examples import belt
from casahunt.orbits import load_orbit as load_cycle
from casahunt.orbits.archive import VERSION
from casahunt.servo.parts import DEAD_BAND, INERTIA, INTEGRATOR, PID_BY_TIMES, SWITCH, Loop
from problems import table1

OLD = Path(__file__).parent / "version_0_2"


@pytest.mark.parametrize("name", ORBITS)
def test_orbit(tmp_path, name):
    path = tmp_path / "orbit.npz"
    save_orbit(computed(name), path)
    loaded = load_orbit(str(path))
    assert_same(loaded, computed(name))
    # Computed anew from the numbers read, by the same operations in the same order.
    assert np.array_equal(loaded.multipliers.full, computed(name).multipliers.full)
    assert loaded.cycle is computed(name).cycle
    assert [p.name for p in tmp_path.iterdir()] == ["orbit.npz"]


def test_files_of_an_earlier_version():
    """Written by 0.2: an orbit, a diagram and a fold curve to 1e-3, the cycle of a user's system; all are known."""
    orbit, cycle = load_orbit(OLD / "orbit.npz"), load_cycle(OLD / "cycle.npz", belt)
    now = find_orbit(Servo(), "switch", 0.1)
    assert orbit.period == pytest.approx(now.period, rel=3 * orbit.period_error + now.period_error)
    assert cycle.period == pytest.approx(12.001031294830579, rel=1e-9)  # problems/belt.py
    branch = load_branch(OLD / "switch.npz")
    fold = next(special for special in branch.special if special.kind == "fold")
    assert len(branch.orbits) == 3 and "the end of the range" in branch.ended and (fold.at, fold.vary) == (None, "")
    before, after = fold.behind, branch.orbits[[o is fold.behind for o in branch.orbits].index(True) + 1]
    assert before.stable and not after.stable and [kind for _, kind in branch.along()].count("fold") == 1
    assert fold.value == pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-3)


def test_a_special_point_beside_its_orbit(tmp_path):
    """Where the orbit is the last one next to the point, the value of the parameter there is not the orbit's."""
    special = SpecialPoint("grazing", computed("switch"), "met beside it", at=0.123, vary="gain")
    save_branch(Branch("gain", (computed("switch"),), (special,)), tmp_path / "branch.npz")
    (again,) = load_branch(tmp_path / "branch.npz").special
    assert (again.at, again.vary, again.value) == (0.123, "gain", 0.123)


def test_the_branch_of_a_loop(tmp_path):
    """Read again with the loop, which no file holds, at other values; refused without it and with another one."""
    loop = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR), {"gain": 0.1})
    branch = follow(find_orbit(loop), "gain", to=0.11)
    save_branch(branch, tmp_path / "loop.npz")
    again = load_branch(tmp_path / "loop.npz", loop.replace(gain=0.2))
    for name in ("values", "periods", "amplitudes", "stable"):
        assert np.array_equal(getattr(again, name), getattr(branch, name))
    assert (again.ended, again.end.kind, again.vary) == (branch.ended, "range", "gain")
    for other in (None, loop.with_parts(DEAD_BAND, dead_band=0.01)):
        assert "do not fit" in refusal(load_branch, tmp_path / "loop.npz", other)


def test_the_orbit_of_a_loop(tmp_path):
    """Its functions stand in no file: who reads it is told by what."""
    loop = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR, DEAD_BAND), {"gain": 0.04, "dead_band": 0.01})
    orbit, path = find_orbit(loop), tmp_path / "orbit.npz"
    save_orbit(orbit, path)
    assert "casahunt.orbits.load_orbit(path, loop.system) reads it" in refusal(load_orbit, path)
    assert load_cycle(path, loop.system).period == orbit.period


def test_branch(tmp_path):
    first, second = computed("switch"), computed("switch full cycle")
    special = (
        SpecialPoint("fold", second, "the stable and the unstable cycle merge"),
        SpecialPoint("of my own", first, "größer als 1"),
    )
    branch = Branch("gain", (first, second), special, end=End("range", "the end of the range", 0.1))
    path = tmp_path / "branch.npz"
    save_branch(branch, path)
    loaded = load_branch(path)
    assert (loaded.model, loaded.servo, loaded.ended) == (branch.model, branch.servo, branch.ended)
    assert (loaded.end.kind, loaded.end.value, np.isnan(loaded.end.error)) == ("range", 0.1, True)
    for a, b in zip(loaded.orbits, branch.orbits, strict=True):
        assert_same(a, b)
    assert [kind for _, kind in loaded.along()] == [kind for _, kind in branch.along()] == ["of my own", "fold"]
    for x, y in zip(loaded.special, branch.special, strict=True):
        assert (x.kind, x.meaning) == (y.kind, y.meaning)
        assert_same(x.orbit, y.orbit)


def test_branch_without_orbits(tmp_path):
    save_branch(Branch("gain", (), end=End("stuck", "nothing found")), tmp_path / "empty.npz")
    loaded = load_branch(tmp_path / "empty.npz")
    assert (loaded.vary, loaded.orbits, loaded.special, loaded.ended) == ("gain", (), (), "nothing found")


def test_saving_again_replaces(tmp_path):
    path = tmp_path / "orbit.npz"
    save_orbit(computed("lugre"), path)
    save_orbit(computed("switch"), path)
    assert_same(load_orbit(path), computed("switch"))


def test_file_is_plain_data(tmp_path):
    """Two arrays, readable without pickle and without this package; the metadata say what made them."""
    path = tmp_path / "orbit.npz"
    save_orbit(computed("switch"), path)
    with np.load(path, allow_pickle=False) as file:
        assert sorted(file.files) == ["metadata", "numbers"]
        metadata = json.loads(bytes(file["metadata"]))
        numbers = file["numbers"]
    assert (metadata["schema"], metadata["version"], metadata["kind"]) == ("casahunt", VERSION, "orbit")
    assert {"numpy", "casadi"} <= set(metadata)
    assert numbers.dtype == float and np.isfinite(numbers).all()
    record = metadata["orbit"]
    assert record["servo"]["friction.static"] == 0.53
    place = record["arcs"][0]["end"]
    end = numbers[place["at"] : place["at"] + 3]
    assert np.array_equal(end, computed("switch").arcs[0].end)


@pytest.mark.parametrize("gains", [(0.3, 1.0), (0.6, 1.0)], ids=["stable", "round the fold"])
def test_walk_goes_on_from_a_file(tmp_path, gains):
    """The curve behind the last two orbits of a loaded branch is the one that a search from nothing finds."""
    start, high = gains
    options = Options(tol=1e-9)
    first = find_orbit(Servo(), "switch", start, options=options)
    steps = 3 if start == 0.3 else 7
    before = list(islice(walk(first, low=0.1, high=high, options=options), steps))
    save_branch(Branch("gain", (first, *before)), tmp_path / "branch.npz")
    loaded = load_branch(tmp_path / "branch.npz")
    previous, last = loaded.orbits[-2:]
    onwards = np.sign(last.gain - previous.gain)
    assert onwards == (1 if start == 0.3 else -1)
    after = list(islice(walk(last, previous=previous, low=0.1, high=high, options=options), 3))
    gains_passed = np.array([last.gain, *(orbit.gain for orbit in after)])
    assert (np.diff(gains_passed) * onwards > 0).all()
    branch = "stable" if start == 0.3 else "unstable"
    independent = find_orbit(Servo(), "switch", after[-1].gain, branch=branch, options=options)
    assert after[-1].amplitude == pytest.approx(independent.amplitude, rel=1e-8)  # both to 1e-9
    assert after[-1].period == pytest.approx(independent.period, rel=1e-8)
    assert after[-1].stable == independent.stable == (branch == "stable")


@pytest.mark.parametrize(
    ("name", "complaint"),
    [("missing/a.npz", "there is no folder"), ("file/a.npz", "there is no folder"), ("folder", "directory")],
)
def test_cannot_be_written(tmp_path, name, complaint):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    path = tmp_path / name
    for save, what in ((save_orbit, computed("switch")), (save_branch, Branch("gain", ()))):
        message = refusal(save, what, path)
        assert message.startswith(f"cannot write {str(path)!r}: ") and complaint in message
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("trouble", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=repr)
def test_trouble_while_writing_leaves_the_old_file(tmp_path, monkeypatch, trouble):
    path = tmp_path / "orbit.npz"
    save_orbit(computed("switch"), path)

    def savez(stream, **arrays):
        stream.write(b"PK half a file")
        raise trouble

    monkeypatch.setattr(np, "savez", savez)
    with pytest.raises(type(trouble)):
        save_orbit(computed("lugre"), path)
    assert [p.name for p in tmp_path.iterdir()] == ["orbit.npz"]
    assert_same(load_orbit(path), computed("switch"))


def test_what_could_not_be_read_is_not_written(tmp_path):
    orbit = computed("switch")
    arc = replace(orbit.arcs[1], end=np.full(3, np.nan))
    for broken in (replace(orbit, arcs=(orbit.arcs[0], arc)), replace(orbit, period=float("inf"))):
        message = refusal(save_orbit, broken, tmp_path / "a.npz")
        assert "NaN or infinite" in message
    assert not list(tmp_path.iterdir())
