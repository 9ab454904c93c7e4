"""A cycle of a user's system: its sentence, its curve, its file."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from casahunt.errors import InputError
from casahunt.orbits import SystemOrbit, find_cycle, load_orbit, sequences
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


@pytest.mark.parametrize(
    ("behind", "last", "image", "past"),
    [
        ((0.1, -0.1), "back", "up", True), ((0.1, -0.1), "on", "up", True),  # it depends on the numbers
        ((0.1, 0.1), "back", "up", False), ((-0.1, -0.1), "on", "up", False), ((0.1, -0.1), "up", "up", False),
        ((0.1, -0.1), None, "back", True), ((0.1, 0.1), None, "back", False), ((0.1, -0.1), None, None, False),
    ],
)  # fmt: skip
def test_an_event_leads_past_a_phase_where_it_may_lead_to_the_next(behind, last, image, past):
    """From "up", by the sign of x to "on" or "back"; behind the last phase comes the image of the first."""
    way_out = SimpleNamespace(successor=lambda x, p: "on" if x[0] > 0 else "back")
    posed = SimpleNamespace(exit_of=lambda mode, event: way_out, image=lambda *_: image and (image, "an event"))
    modes = ["up", "short", *([last] if last else [])]
    x = [*behind, 0.0]
    segments = [SimpleNamespace(mode=m, event="an event", behind=np.array([v])) for m, v in zip(modes, x, strict=False)]
    assert sequences._leads_past(posed, segments, 1, SimpleNamespace(p=None, scale=np.ones(1))) is past
