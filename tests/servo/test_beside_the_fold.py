"""Next to the fold, where motions from inside the unstable cycle creep to rest: few motions lead to the cycle."""

from __future__ import annotations

import pytest
from map_support import watched
from peer_support import needs

from casahunt import Options, find_orbit
from casahunt.servo import cold_start
from casahunt.servo.event_map.half_cycle import StickMap
from problems import table1

FOLD = table1.REFERENCE["lugre"]["fold"]


@pytest.mark.parametrize("gain", [0.58, 0.6, 0.615, 0.619])
def test_the_stable_cycle_next_to_the_fold(gain):
    """The truth is heyoka's, whose motions share nothing with the program."""
    peer = needs("scripts.peers.servo_heyoka")
    orbit = find_orbit(table1.servo(), "lugre", gain, options=Options(tol=1e-8))
    truth = peer.LugreTaylor(1e-12).cycle(table1.servo(), gain)
    assert orbit.period == pytest.approx(truth.period, rel=1e-7)
    assert orbit.amplitude == pytest.approx(truth.amplitude, rel=1e-7)


def test_nothing_is_followed_from_where_a_motion_has_come_to_rest():
    """Above the fold: there is no cycle, and what starts next to x1 = 0 would creep for hundreds of intervals."""
    P, motions = watched(StickMap("lugre", table1.servo(), 1.02 * FOLD["K"]))
    assert cold_start._at_once(cold_start.AtGain(P, Options())) is None
    bristle = [run.ratio for run in (run for _, _, run, _ in motions) if len(run.segments[0].end) == 4]
    assert len(bristle) == 1 and bristle[0] < cold_start.CAME_TO_REST


def test_both_cycles_right_below_the_fold():
    stable, unstable = (find_orbit(table1.servo(), "lugre", 0.62, branch=b) for b in ("stable", "unstable"))
    assert unstable.amplitude < FOLD["amplitude"] < stable.amplitude
    assert stable.multipliers.leading.real < 1 < unstable.multipliers.leading.real
