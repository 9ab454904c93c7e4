"""problems/rossler.py against Taylor series in extended precision."""

from __future__ import annotations

import pytest
from problem_support import assert_true

from casahunt.errors import NoOrbit
from casahunt.orbits import find_cycle
from problems import rossler


def test_true():
    for found in rossler.cycles():
        assert_true(found)
        assert found.orbit.stable == (abs(found.truth.multipliers[0]) < 1)


@pytest.mark.slow
def test_chaos_is_no_cycle():
    """The motion at c = 5.7 comes near to itself by chance, next to cycles that it leaves at once."""
    with pytest.raises(NoOrbit, match="did not repeat within"):
        find_cycle(rossler.SYSTEM, parameters={"c": 5.7}, x=-5.0, y=0.0, z=0.0)
