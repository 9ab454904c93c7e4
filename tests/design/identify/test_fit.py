"""The fit itself: its slopes against differences, the bottom of a curved valley, and an optimum that is none."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import NoOrbit, Options, Record, Servo, Status, cli, identify
from casahunt.design.identify import identify as rooms
from casahunt.design.identify import intervals
from casahunt.design.identify.fit import Question, at, climb, expected
from casahunt.design.identify.identify import CYCLE_SHARE, FREE, LITTLE_TO_GAIN, data_of
from casahunt.design.identify.likelihood import Noise
from casahunt.design.identify.start import scales_of, starts
from casahunt.design.identify.suitable import suitable
from scripts.identify import ALIKE, Made
from scripts.peers.hunting_record import measured, positions

GAIN, PERIOD, AMPLITUDE = 0.1, 11.36, 0.0177


@pytest.fixture(scope="module")
def record() -> Record:
    """Of the servo of Table 1, four periods of 150 samples, noise of 1 %."""
    times = np.arange(0.0, 5 * PERIOD, PERIOD / 150)
    x = positions(Servo(), "switch", GAIN, AMPLITUDE, times)
    later = times > PERIOD
    rng = np.random.default_rng(4)
    return Record(times[later], measured(x[later], 0.01 * AMPLITUDE, 0.0, 0.3, rng), "bench")


def question(record: Record, servo: Servo, gain: float, share: float = CYCLE_SHARE) -> Question:
    data = data_of(record, suitable(record), gain)
    return Question((data,), servo, "switch", FREE, Options().finer(share), scales_of(data, servo, FREE))


@pytest.mark.parametrize("stretched", [False, True])
@pytest.mark.parametrize("quantum", [0.0, 4e-4])
def test_slopes_are_those_of_differences(record, stretched, quantum):
    """Of half the deviance, by parameters, phase and offset, away from the optimum."""
    asked = question(record, Servo(), GAIN, 1e-3)
    noises = [Noise(4e-4, quantum)]
    z = starts(asked)[0] + np.array([0.01, -0.02, 0.05, 0.03, 0.002, 0.01])
    point = at(asked, z, noises, stretched=stretched)
    for i, size in enumerate((1e-4, 1e-4, 1e-3, 1e-3, 1e-5, 1e-4)):
        step = np.zeros(z.size)
        step[i] = size
        ahead, behind = (at(asked, z + s * step, noises, point, stretched=stretched).deviance for s in (1, -1))
        assert point.gradient[i] == pytest.approx((behind - ahead) / (4 * size), rel=2e-3), i


def test_a_curved_valley_is_followed_to_its_end():
    """Servo 6 of scripts/identify.py without rounding: condition 1e9; another start, and the true values, as likely."""
    made = Made(6, 0, "switch", (0.0, 0.0))
    ends = []
    for servo in (*made.starts, made.servo):
        asked = question(made.record, servo, made.gain)
        point, noises = rooms._best(asked)
        assert expected(point) < LITTLE_TO_GAIN
        ends.append(point.deviance)
    assert max(ends) - min(ends) < ALIKE


def test_what_is_expected_of_a_step_is_what_it_gains(record):
    """Near the optimum, where the deviance is a parabola."""
    asked = question(record, Servo(), GAIN)
    best, noises = rooms._best(asked)
    assert expected(best) < LITTLE_TO_GAIN
    away = at(asked, best.z + np.array([0, 0, 0, 0, 1e-4, 0]), noises, best)
    assert expected(away) == pytest.approx(away.deviance - climb(asked, away, noises).deviance, rel=0.1)
    assert expected(away) > LITTLE_TO_GAIN


@pytest.fixture
def short(monkeypatch):
    """Fits that stop where the stretched one ends."""
    monkeypatch.setattr(rooms, "climb", lambda *args, **more: climb(*args, **more) if "stretched" in more else args[1])


def test_a_fit_that_stops_short_has_no_intervals(short, record):
    servo = Servo().replace(**{"friction.viscous": 0.2, "friction.stribeck_velocity": 0.04})
    found = identify([record], servo, GAIN)
    assert found.status is Status.FIT_NOT_CONVERGED and not found.bounded and "fit not converged" in repr(found)
    assert all(math.isnan(end) for ends in found.intervals.values() for end in ends)
    with pytest.raises(NoOrbit, match="stopped short of an optimum"):
        _ = found.uncertainty


def test_and_the_command_fails(short, record, tmp_path, capsys):
    table = np.column_stack([record.times, record.position])
    np.savetxt(tmp_path / "r.csv", table, delimiter=",", header="time_s,position_rad")
    words = ["identify", str(tmp_path / "r.csv"), "--gain", str(GAIN), "--set", "friction.viscous=0.2", "--quiet"]
    assert cli.main([*words, "--json", "--out", str(tmp_path / "out")]) == 1
    out, err = capsys.readouterr()
    said = json.loads(out)
    assert said["status"] == "fit_not_converged" and said["parameters"]["friction.static"]["low"] is None
    assert err.count("\n") == 1 and "other values" in err and not (tmp_path / "out").exists()
    assert cli.main(words) == 1 and "NOT CONVERGED" in capsys.readouterr().out


def test_better_points_without_end_are_no_optimum(monkeypatch, record):
    """Refits that come out below the best point, again and again."""

    def better(asked, best, *_):
        raise rooms.BetterFound(best)

    monkeypatch.setattr(rooms, "profile", better)
    assert identify([record], Servo(), GAIN).status is Status.FIT_NOT_CONVERGED


def test_a_refit_that_stops_short_ends_no_interval(monkeypatch, record):
    """Refits whose slope says that there is more to gain."""
    refit = intervals._refit

    def slanted(*args):
        point = refit(*args)
        return replace(point, gradient=point.gradient + np.sqrt(np.diag(point.curvature)) * 3)

    monkeypatch.setattr(intervals, "_refit", slanted)
    assert identify([record], Servo(), GAIN, advise=False).status is Status.FIT_NOT_CONVERGED
