"""What branches off at a loss of symmetry lies next to it: a pitchfork in closed form, whose branches have a fold.

    r' = r (1 - r^2),  phi' = 1,  y' = y (l + y^2 - y^4):    l = -y^2 + y^4,    multiplier exp(2 pi (2 y^2 - 4 y^4))
    w' = w (y^2 - 0.01):                                                        multiplier exp(2 pi (y^2 - 0.01))

From y = 0 at l = 0 the lopsided cycles go to a fold at y^2 = 1/2, l = -1/4, and behind it back to l = 0 at y = 1.
"""

from __future__ import annotations

import numpy as np
import pytest

from casahunt.continuation import branch_off, follow
from casahunt.hybrid import Mode, System
from casahunt.orbits import find_cycle


def turning(x, p):
    r2 = x.a**2 + x.b**2
    return {"a": x.a * (1 - r2) - x.b, "b": x.b * (1 - r2) + x.a, "y": x.y * (p.l + x.y**2 - x.y**4)}


def turning_both(x, p):
    return {**turning(x, p), "w": x.w * (x.y**2 - 0.01)}


PITCHFORK = System("pitchfork of cycles", ("a", "b", "y"), {"l": -0.3}, (Mode("turns", turning),))
TWICE = System("two of them", ("a", "b", "y", "w"), {"l": -0.3}, (Mode("turns", turning_both),))


@pytest.fixture(scope="module")
def pitchfork():
    (special,) = follow(find_cycle(PITCHFORK, a=1.0, b=0.0, y=0.0), "l", to=0.2).special
    assert special.kind == "symmetry breaking" and abs(special.value) < 1e-8
    return special


@pytest.mark.parametrize("off", [1.0, 0.72, 0.6, 0.02, -0.02])
def test_the_lopsided_cycle_is_next_to_the_point(pitchfork, off):
    """At 1.0 and 0.72 of the sizes of states the cycles there lie behind the fold."""
    orbit = branch_off(pitchfork, "l", off=off)
    y = orbit.arcs[0].states[0, 0, 2]
    assert 0 < y / off <= 1 + 1e-9 and 2 * y**2 < 0.5
    assert orbit.parameters["l"] == pytest.approx(-(y**2) + y**4, abs=1e-8)
    assert orbit.multipliers.full[1].real == pytest.approx(np.exp(4 * np.pi * (y**2 - 2 * y**4)), rel=1e-6)


def test_no_other_multiplier_has_passed_one():
    """At y = 0.15, a quarter of what is asked, and the first that serves but for that, w grows already."""
    special, *others = follow(find_cycle(TWICE, a=1.0, b=0.0, y=0.0, w=0.0), "l", to=0.2).special
    assert special.kind == "symmetry breaking" and not others
    orbit = branch_off(special, "l", off=0.6)
    y = orbit.arcs[0].states[0, 0, 2]
    assert y == pytest.approx(0.6 / 16, rel=0.01)
    assert np.max(np.abs(np.sort(orbit.multipliers.full.real) - np.sort(_multipliers(y)))) < 1e-6


def _multipliers(y: float) -> np.ndarray:
    return np.array([1.0, *np.exp(2 * np.pi * np.array([2 * y**2 - 4 * y**4, y**2 - 0.01, -2.0]))])
