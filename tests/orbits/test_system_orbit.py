"""A cycle of a user's system: its sentence, its curve, its file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from casahunt.errors import InputError
from casahunt.orbits import SystemOrbit, find_cycle, load_orbit
from problems import belt


@pytest.fixture(scope="module")
def orbit() -> SystemOrbit:
    return find_cycle(belt.BELT, "slip", x=0.0, v=0.0)


def test_it_says_what_it_is(orbit):
    assert str(orbit).startswith("block on a belt: period 12.0010312948")
    assert "2 phases, stable, error" in str(orbit)
    assert orbit.parameters == belt.BELT.parameters


def test_it_draws_itself_on_axes(orbit):
    ax = Figure().subplots()
    assert orbit.plot("x", "v", ax=ax, color="k") is ax
    (line,) = ax.get_lines()
    x, v = np.asarray(line.get_data())
    assert x.max() == pytest.approx(belt.TRUTH[0.2].extrema["x"][1], rel=1e-3)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x", "v")
    orbit.plot("t", "x", ax=ax)
    assert ax.get_lines()[-1].get_xdata()[-1] == orbit.period
    with pytest.raises(InputError, match="state"):
        orbit.plot("x", "speed", ax=ax)


def test_it_comes_back_from_a_file(orbit, tmp_path):
    orbit.save(tmp_path / "belt.npz")
    loaded = load_orbit(tmp_path / "belt.npz", belt.BELT)
    assert type(loaded) is SystemOrbit and loaded.problem == orbit.problem
    assert loaded.period == orbit.period and loaded.extrema("x") == orbit.extrema("x")
    with pytest.raises(InputError, match="not of 'conveyor'"):
        load_orbit(tmp_path / "belt.npz", replace(belt.BELT, name="conveyor"))
