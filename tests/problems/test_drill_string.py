"""problems/drill_string.py against Taylor series in extended precision."""

from __future__ import annotations

import pytest
from problem_support import assert_true

from casahunt.errors import NoOrbit
from casahunt.orbits import find_cycle
from problems import drill_string


def test_true():
    for found in drill_string.cycles():
        assert_true(found)


def test_a_bit_that_the_motor_cannot_turn_comes_to_rest():
    """At rest it pulls with kp speed = 0.6, less than Ts = 1."""
    with pytest.raises(NoOrbit, match="comes to rest"):
        find_cycle(drill_string.SYSTEM, "sticks", parameters={"speed": 0.2}, phi=0.0, w1=0.2, w2=0.0)
