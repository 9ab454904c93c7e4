"""Next to the fold, where motions from inside the unstable cycle creep to rest: few motions lead to the cycle."""

from __future__ import annotations

import importlib

import pytest
from peer_support import needs

from casahunt import Options, find_fold, find_orbit
from casahunt.servo import cold_start
from casahunt.servo.denial import no_cycle
from casahunt.servo.event_map.half_cycle import StickMap
from problems import table1

FOLD = table1.REFERENCE["lugre"]["fold"]
MOST_MOTIONS = 2
"""Of the LuGre servo from nothing: one that starts outside the cycle, and one more."""


@pytest.fixture
def motions(monkeypatch):
    """The LuGre motions that were computed, as (stick position, P/a)."""
    seen, original = [], StickMap.__call__

    def watched(P, a, **how):
        run = original(P, a, **how)
        seen.extend([(a, run.ratio)] if P.model == "lugre" else [])
        return run

    monkeypatch.setattr(StickMap, "__call__", watched)
    return seen


@pytest.mark.parametrize("gain", [0.58, 0.6, 0.615, 0.619])
def test_one_motion_from_outside_leads_to_the_stable_cycle(gain, motions):
    """The truth is heyoka's, whose motions share nothing with the program."""
    peer = needs("scripts.peers.servo_heyoka")
    orbit = find_orbit(table1.servo(), "lugre", gain, options=Options(tol=1e-8))
    truth = peer.LugreTaylor(1e-12).cycle(table1.servo(), gain)
    assert orbit.period == pytest.approx(truth.period, rel=1e-7)
    assert orbit.amplitude == pytest.approx(truth.amplitude, rel=1e-7)
    assert 1 <= len(motions) <= MOST_MOTIONS
    assert all(ratio > 0.5 for _, ratio in motions)  # none came to rest


def test_nothing_is_followed_from_where_a_motion_has_come_to_rest(motions):
    """Above the fold: there is no cycle, and what starts next to x1 = 0 would creep for hundreds of intervals."""
    gain = 1.02 * FOLD["K"]
    assert cold_start._at_once(cold_start.AtGain(StickMap("lugre", table1.servo(), gain), Options())) is None
    assert len(motions) == 1 and motions[0][1] < cold_start.CAME_TO_REST


def test_both_cycles_right_below_the_fold():
    stable, unstable = (find_orbit(table1.servo(), "lugre", 0.62, branch=b) for b in ("stable", "unstable"))
    assert unstable.amplitude < FOLD["amplitude"] < stable.amplitude
    assert stable.multipliers.leading.real < 1 < unstable.multipliers.leading.real


def test_no_motion_is_followed_where_it_is_proved_that_there_is_no_cycle(monkeypatch):
    module = importlib.import_module("casahunt.servo.find_fold")
    asked, original = [], module.near_typical

    def watched(P, **how):
        asked.append(P.gain)
        return original(P, **how)

    monkeypatch.setattr(module, "near_typical", watched)
    fold = find_fold(table1.servo(), "switch")
    assert fold.gain == pytest.approx(table1.REFERENCE["switch"]["fold"]["K"], rel=1e-6)
    assert asked and not any(no_cycle(table1.servo(), "switch", gain) for gain in asked)
