"""What branches off from a cycle that begins in the middle of a stick: its second half begins at the mirror image."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt.continuation import branch_off, follow
from casahunt.servo.parts.plain_loop import loop_of
from casahunt.servo.parts.table import remedy_of
from casahunt.servo.parts.verbs import loop_cycle
from casahunt.servo.servo import Servo
from scripts.random_servos import draw


@pytest.mark.slow
def test_a_pair_of_lopsided_cycles_branches_off_in_the_middle_of_a_stick():
    """A leaking integrator of a servo drawn at random; near the point the pair is the cycle but for its half-turns."""
    leak = remedy_of("leak", "switch").part
    loop = loop_of(Servo().replace(**draw(4242, 6)), "switch", 1.047678134539889).with_parts(leak, leak=0.29)
    cycle = loop_cycle(loop, "leak")
    (special,) = follow(cycle, "leak", to=0.2972, until=lambda point: point.kind == "symmetry breaking").special
    pair = [branch_off(special, "leak", off=off) for off in (0.02, -0.02)]
    turns = [[arc.states[0, -1, 0] for arc in orbit.arcs] for orbit in pair]
    assert len(turns[0]) == 2 * len(special.orbit.arcs) and pair[0].period == pytest.approx(pair[1].period, rel=1e-7)
    assert np.ptp(np.abs(turns[0])) > 1e-6 * cycle.amplitude
