"""Tasks that cannot be met are refused with evidence only, and wrong input in one sentence."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from tuning import TIME, crossover_phase

from casahunt import Drive, Options, find_fold, margins
from casahunt.cli import main
from casahunt.design.tune.best_gain import Given, Outlook
from casahunt.design.tune.demands import Demands, check_bounds
from casahunt.design.tune.problem import TuningPoint
from casahunt.design.tune.search import TuningSearch
from casahunt.design.tune.tuning import tune
from casahunt.design.uncertainty.set import Uncertainty
from casahunt.errors import InputError, NoOrbit


@pytest.mark.slow
def test_what_is_in_the_way_is_said(servo, plain):
    with pytest.raises(NoOrbit, match="cannot be met") as error:
        tune(servo, "switch", demands=Demands(phase_margin=55, delay=0.01))
    said = str(error.value)
    assert f"the hunting margin of 10 % asks for a gain of at least {1.1 * plain.fold_gain:.5g}" in said
    allowed = float(said.partition("the phase margin of 55 degrees with a delay of 0.01 s")[2].split(" to ")[1])
    assert crossover_phase(servo, allowed, 0.01) == pytest.approx(55, abs=1e-2)
    with pytest.raises(NoOrbit, match=r"at least 0.71207.*; the bounds of the gain allow 0.1 to 0.5$"):
        tune(servo, "switch", bounds={"gain": (0.1, 0.5)})
    with pytest.raises(NoOrbit, match=r"in the way: the phase margin of 60 .* is kept at no gain \(.* at best"):
        tune(servo, "switch", demands=Demands(phase_margin=60, delay=0.1))


@pytest.mark.slow
def test_a_gain_that_misses_its_margins_as_built_is_not_recommended(servo):
    """The largest gain told has the margin of the sampled loop; half a sample of delay alone would let it pass."""
    T = 0.008
    with pytest.raises(NoOrbit, match="cannot be met; in the way: the hunting margin of 10 %") as error:
        tune(servo, "switch", demands=Demands(gain_margin=4.0, phase_margin=0, sample_time=T))
    said = str(error.value).partition("the gain margin of 4 when the gain rises with samples of 0.008 s ")[2]
    most = float(said.partition("at most ")[2].split(";")[0])
    assert margins(servo, most, drive=Drive(sample_time=T)).highest_factor == pytest.approx(4.0, rel=1e-4)
    assert margins(servo, 0.712073, delay=T / 2).highest_factor > 4.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "free, demands, ways",
    [
        (["integral_time"], Demands(delay=0.03, gain_margin=5), ["hunting margin", "gain margin of 5 when the gain r"]),
        (["lead_time", "integral_time"], Demands(delay=0.05, phase_margin=60), ["phase margin of 60 degrees"]),
    ],
)  # fmt: skip
def test_free_times_that_do_not_help_are_refused_with_evidence(servo, free, demands, ways):
    with pytest.raises(NoOrbit, match="the tuning cannot be met: [0-9]+ pairs of controller times") as error:
        tune(servo, "switch", free=free, demands=demands)
    assert all(way in str(error.value) for way in ways)
    # Not even the loop alone has a gain anywhere near: the largest with the margins, against half of the fold gain.
    for part in np.geomspace(0.5, 2, 5):
        times = {f"controller.{name}": TIME * float(part) for name in free}
        member = servo.replace(**times)
        gain = 0.5 * find_fold(member, "switch").gain
        factor = demands.gain_margin if demands.gain_margin > 2 else 1.0
        least = 0.0 if factor > 1 else demands.phase_margin
        assert crossover_phase(member, factor * gain, demands.delay) < least


@pytest.mark.slow
def test_a_feasible_task_is_not_refused(unscanned, servo):
    """The gain's bounds shut the given times out, and the answer lies far away from them."""
    bounds = {"gain": (0.01, 0.2), "lead_time": (0.05, 0.6)}
    found = tune(servo, "switch", free=["lead_time"], bounds=bounds)
    fold = find_fold(servo.replace(**{"controller.lead_time": 0.6}), "switch")
    assert found.servo.controller.lead_time == pytest.approx(0.6, rel=1e-5)
    assert found.gain == pytest.approx(1.1 * fold.gain, rel=1e-5) and found.gain_only is None


def searched(servo, monkeypatch, v) -> TuningSearch:
    """A search over the lead time, v [ln K or rad] a function of ln(tau_d/TIME)."""
    bounds = {"lead_time": (TIME / 2, 2 * TIME)}
    given = Given(servo, "switch", Demands(), None, ("lead_time",), bounds, "gain", Options())

    def outlook(q):
        missed = float(v(q[0] - math.log(TIME)))
        return Outlook(q, missed, 1.0, math.inf if missed > 0 else 1.0 + missed)

    # v as a function in closed form: how deep its well is decides, which folds of a servo do not let one choose.
    monkeypatch.setattr(given, "outlook", outlook)
    return TuningSearch(given)


def test_that_it_cannot_be_met_is_said_with_evidence_only(servo, monkeypatch):
    far = searched(servo, monkeypatch, lambda x: 1 + 0.5 * x)
    assert far._starts() == [] and far.excluded
    # A well between two points of the grid that all but touches zero: nothing is claimed.
    near = searched(servo, monkeypatch, lambda x: 3 * abs(x - 0.26) + 1e-12)
    start = near._starts()[0]
    assert not near.excluded and start.missed > 0 and start.q[0] - math.log(TIME) == pytest.approx(0.26, abs=0.02)
    # One that reaches below: found, although no point of the grid is feasible.
    well = searched(servo, monkeypatch, lambda x: 3 * abs(x - 0.26) - 0.02)
    assert all(abs(axis - math.log(TIME) - 0.26) > 0.02 / 3 for axis in well.axes[0])
    assert well._starts()[0].missed <= 0


@pytest.mark.slow
def test_times_are_found_where_ipopt_gives_up(unscanned, monkeypatch, servo):
    """The search without derivatives takes over; the optimum is at a corner of the bounds, which it reaches."""

    def gives_up(r):
        return TuningPoint(r.q, r.k, np.zeros(4), False, "Maximum_Iterations_Exceeded")

    # No problem is known that IPOPT does not solve.
    monkeypatch.setattr("casahunt.design.tune.search.solve_round", gives_up)
    found = tune(servo, "switch", free=["lead_time"], bounds={"lead_time": (0.05, 0.6), "gain": (0.01, 0.2)})
    expected = 1.1 * find_fold(servo.replace(**{"controller.lead_time": 0.6}), "switch").gain
    assert found.gain == pytest.approx(expected, rel=1e-5)


WRONG = [
    (["--margin", "-0.1"], "margin = -0.1: must be at least 0"),
    (["--margin", "nan"], "margin = nan: must be a finite number"),
    (["--free", "motor_gain"], "unknown free 'motor_gain'"),
    (["--cost", "speed"], "unknown cost 'speed'"),
    (["--model", "lugree"], "unknown model 'lugree'"),
    (["--bounds", "lead_time=0.1"], "must have the form NAME=LOW,HIGH"),
    (["--bounds", "lead=0.1,1"], "unknown bounds 'lead'"),
    (["--bounds", "lead_time=0.1,1"], "must be left out unless --free lead_time is given"),
    (["--free", "lead_time", "--bounds", "lead_time=1,0.1"], "the first must be less than the second"),
    (["--free", "lead_time", "--bounds", "lead_time=0.5,1"], "must contain the servo's own value"),
    (["--bounds", "gain=0,1"], "bounds gain = 0: must be greater than 0"),
    (["--phase-margin", "200"], "phase-margin = 200: must be at most 180"),
    (["--gain-margin", "0.5"], "gain-margin = 0.5: must be at least 1"),
    (["--delay", "-1"], "delay = -1: must be at least 0"),
    (["--set", "controller.lead_time=0"], "controller.lead_time = 0: must be greater than 0"),
    (["--uncertainty", "missing.toml"], "no such file"),
]


@pytest.mark.parametrize("arguments, sentence", WRONG)
def test_wrong_input_is_one_sentence_and_code_2(arguments, sentence, capsys, tmp_path):
    assert main(["tune", *arguments, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.out == "" and sentence in said.err and said.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_empty_set_is_refused(capsys, tmp_path):
    for text in ("", "[interval]\n"):
        (tmp_path / "set.toml").write_text(text)
        assert main(["tune", "--uncertainty", str(tmp_path / "set.toml")]) == 2
        assert "set.toml" in capsys.readouterr().err


def test_a_time_is_not_free_and_uncertain(servo):
    with pytest.raises(InputError, match="it is in the uncertainty set"):
        tune(servo, "switch", free=["lead_time"], uncertainty=Uncertainty({"controller.lead_time": (0.15, 0.16)}))
    assert check_bounds(servo, ["lead_time"], {})["lead_time"] == pytest.approx((TIME / 2, TIME * 2))


def test_a_task_that_cannot_be_met_is_code_1(capsys):
    assert main(["tune", "--bounds", "gain=0.1,0.5", "--json"]) == 1
    said = capsys.readouterr()
    told = json.loads(said.out)["refused"]
    assert "in the way: the hunting margin" in told and told in said.err
