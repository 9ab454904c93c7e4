"""What the page shows, without a browser: stages, copies, what is kept and what is given up."""

from __future__ import annotations

import contextlib
import json
import re
import time
from urllib.parse import urlencode

import numpy as np
import pytest
from explore_support import STATES, TABLE1, turned

from casahunt import NoOrbit, Options, Servo, Status, effort, find_fold, find_orbit, margins, remedies, simulate
from casahunt.cli import main
from casahunt.continuation import follow
from casahunt.errors import HuntsIrregularly
from casahunt.servo.parts import load_loop
from casahunt.servo.parts.verbs import loop_cycle
from casahunt.views.explore import page_stages
from casahunt.views.explore import worker as stages
from casahunt.views.explore.numbers import compared, ends_at
from casahunt.views.explore.page import command_line, python, servo_file
from casahunt.views.explore.state import FIRST_GAIN, own_numbers, remedy_called, state_of_address
from casahunt.views.explore.worker import STAGES, Answers
from problems import table1


@pytest.fixture
def shown(monkeypatch):
    """Called with a state and the names of stages: what these show."""

    def show(state, *names):
        monkeypatch.setattr(stages, "STAGES", names or STAGES)
        return dict(Answers().of(state))

    return show


@pytest.mark.parametrize("name", ["table 1", "by gains", "canudas"])
def test_the_command_line_and_the_python_give_the_numbers_of_the_page(name, capsys, shown):
    state = STATES[name]
    page = shown(state, "hunts")["hunts"]
    words = command_line(state).split()
    assert words[0] == "casahunt" and main([*words[1:], "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    scope: dict = {}
    with contextlib.redirect_stdout(None):
        exec(python(state), scope)  # what the page offers to be copied
    for key in ("amplitude", "period"):
        assert page[key]["value"] == told[key] == getattr(scope["orbit"], key)


def test_the_copies_of_a_loop_give_the_numbers_of_the_page(tmp_path, monkeypatch, capsys, shown):
    monkeypatch.chdir(tmp_path)
    state = turned(TABLE1.choose("remedy", "leak"), leak=0.1, gain=0.04)
    page = shown(state, "hunts")["hunts"]
    (tmp_path / "servo.toml").write_text(servo_file(state), encoding="utf-8")
    scope: dict = {}
    with contextlib.redirect_stdout(None):
        exec(python(state), scope)
    words = command_line(state).partition("#")[0].split()
    assert main([*words[1:], "--json", "--quiet"]) == 0
    told = json.loads(capsys.readouterr().out)
    truth = loop_cycle(load_loop(tmp_path / "servo.toml"))
    for key in ("amplitude", "period"):
        value = getattr(truth, key)
        assert [page[key]["value"], told[key], getattr(scope["orbit"], key)] == pytest.approx([value] * 3, rel=1e-6)


@pytest.fixture(scope="module")
def told():
    """The stages of Table 1 at the page's first gain."""
    return dict(Answers().of(TABLE1))


def test_the_stages_show_what_the_library_says(told):
    servo = table1.servo()
    orbit, fold = find_orbit(servo, "switch", FIRST_GAIN), find_fold(servo, "switch")
    assert tuple(told) == STAGES
    assert told["hunts"]["verdict"] == "hunts"
    assert told["hunts"]["amplitude"]["value"] == orbit.amplitude
    assert told["hunts"]["period"]["text"] == f"{orbit.period:.4g}"
    assert told["hunts"]["amplitude"]["error"] == pytest.approx(orbit.amplitude * orbit.amplitude_error)
    assert told["border"]["gain"]["value"] == fold.gain
    assert told["border"]["ratio"]["value"] == pytest.approx(fold.gain / FIRST_GAIN)
    assert told["border"]["ratio"]["said"] == f"{fold.gain / FIRST_GAIN:.4g} times the present gain"
    assert told["linear"]["phase_margin"]["value"] == pytest.approx(
        margins(servo, FIRST_GAIN).phase_margin, rel=1e-14)  # fmt: skip
    kp = servo.torque_gains(FIRST_GAIN)[0]
    assert told["step"]["peak"]["value"] == pytest.approx(kp * 1.0, rel=1e-3)  # kp times the step, at its start
    assert json.loads(json.dumps(told, allow_nan=False)) == told


def test_the_curves_belong_to_the_numbers(told):
    cycle, at = told["hunts"]["cycle"], told["diagram"]
    assert max(map(abs, cycle["angle"])) == pytest.approx(told["hunts"]["amplitude"]["value"], rel=1e-4)
    assert cycle["time"][-1] == pytest.approx(told["hunts"]["period"]["value"], rel=1e-5)
    gains = [x for name in ("stable", "unstable") for x in at[name]["gain"] if x is not None]
    assert max(gains) == pytest.approx(told["border"]["gain"]["value"], rel=1e-3) and min(gains) < FIRST_GAIN
    # J x2' = m - F along the period: the torque is that of the motion
    x, v, t = (cycle[name] for name in ("angle", "velocity", "time"))
    assert sum(v[i] * (t[i + 1] - t[i]) for i in range(len(t) - 1)) == pytest.approx(x[-1] - x[0], abs=1e-3)
    speed = told["linear"]["friction"]
    assert max(speed["torque"]) <= 0.53 + 0.1 * max(speed["velocity"])


def test_torque_along_a_loop_is_that_of_the_servo(told, shown):
    """A servo as a loop, closed by its mirror image or, with a load, over the whole period."""
    largest = max(told["hunts"]["cycle"]["torque"])
    spring = shown(turned(TABLE1, spring=1e-9), "hunts")["hunts"]["cycle"]["torque"]
    load = shown(turned(TABLE1, load_torque=0.2), "hunts")["hunts"]["cycle"]["torque"]
    assert max(spring) == pytest.approx(largest, rel=1e-4) and min(spring) == pytest.approx(-largest, rel=1e-4)
    assert (max(load) - min(load)) / 2 == pytest.approx(largest, rel=1e-4)
    assert (max(load) + min(load)) / 2 == pytest.approx(0.2, rel=1e-3)  # the integrator carries it


def test_next_to_the_fold_a_distance_is_told():
    """In per cent, in as many digits as the error vouches for; and none where nothing is known of it."""
    fold = find_fold(table1.servo(), "switch")
    ratios = 1.25, 1.00006, 1.0 + 1e-12
    far, near, at = (compared(fold.gain, fold.gain / x, fold.value_error, "it", 4) for x in ratios)
    assert (far, near, at) == ("1.25 times it", "0.006 % above it", "it, as nearly as it is known")
    assert compared(1.0, 1.05, 1e-9, "it", 4) == "it is 5 % above that"


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("verdict", ["hunts", "unknown"])
@pytest.mark.parametrize("present", [0.5, 2.0])
def test_no_sentence_of_the_border_is_against_the_verdict(sense, verdict, present):
    said = ends_at("the leak", "1/s", 1.0, present, 1e-9, verdict, sense)
    inside = sense * (1.0 - present) > 0
    assert said.startswith("Hunting ends ") == (inside == (verdict == "hunts"))
    assert ("none of them" in said) == (verdict == "hunts" and not inside)
    assert ("not tried" in said) == (verdict == "unknown" and inside)


def test_where_it_does_not_hunt_the_evidence_is_said(shown):
    told = shown(turned(TABLE1, gain=1.0), "hunts", "border")
    assert told["hunts"]["verdict"] == "rests" and told["hunts"]["sentence"] == "It does not hunt at this gain."
    assert told["hunts"]["why"].endswith("it can hunt up to gain 0.6473 V/rad, and not above")
    assert "in a fold" in told["hunts"]["evidence"] and "amplitude" not in told["hunts"]
    assert told["border"]["ratio"]["value"] < 1
    times = 1.0 / find_fold(table1.servo(), "switch").gain
    assert told["border"]["ratio"]["said"] == f"the present gain is {times:.4g} times that: it does not hunt"


def test_not_found_is_not_there_is_none(monkeypatch, shown):
    """Of a servo too: without evidence it is not said that it does not hunt."""

    def nothing(*_, **__):
        raise NoOrbit("nobody knows", Status.NOT_FOUND)

    monkeypatch.setattr("casahunt.views.explore.page_stages.find_orbit", nothing)
    told = shown(TABLE1, "hunts")["hunts"]
    assert told == {"verdict": "unknown", "sentence": "Whether it hunts is not known.", "why": "nobody knows"}


def test_what_is_not_found_is_a_sentence_in_its_place(shown):
    """No hunting was found is not: there is none."""
    told = shown(turned(TABLE1.choose("remedy", "leak"), leak=0.5), "hunts", "diagram")
    assert told["hunts"]["verdict"] == "unknown" and told["hunts"]["sentence"].startswith("No hunting was found")
    assert "why" not in told["hunts"] and "followed for" in told["hunts"]["evidence"]
    assert "why" in told["diagram"]


def test_the_border_of_a_remedy_is_that_of_the_table_of_remedies(shown):
    told = shown(turned(TABLE1.choose("remedy", "dead band"), gain=0.04, dead_band=0.01), "hunts", "border")
    row = remedies(Servo(), "switch", 0.04, only=["dead band"]).remedies[0]
    assert told["border"]["size"]["value"] == pytest.approx(row.size, rel=1e-6)
    assert told["border"]["size"]["value"] == pytest.approx(0.0433457242, rel=1e-5)
    assert "4.33 times" in told["border"]["sentence"]


def test_the_numbers_of_a_remedy():
    assert own_numbers(remedy_called("dither", "switch")) == {"dither": 0.0}
    assert list(own_numbers(remedy_called("hysteresis", "switch"))) == ["hysteresis", "enter_ratio"]


def test_a_move_of_the_gain_computes_no_fold_and_no_diagram_again(monkeypatch):
    asked = Answers()
    first = dict(asked.of(TABLE1))
    monkeypatch.setattr("casahunt.views.explore.page_stages.find_fold", None)
    monkeypatch.setattr("casahunt.views.explore.page_stages.follow", None)
    second = dict(asked.of(turned(TABLE1, gain=0.2)))
    assert second["border"]["gain"] == first["border"]["gain"]
    assert second["diagram"]["stable"] == first["diagram"]["stable"] and second["diagram"]["present"] == 0.2


DEAD_BAND = turned(TABLE1.choose("remedy", "dead band"), gain=0.04, dead_band=0.01)


@pytest.mark.parametrize(
    "before, moved, stages_asked, what, kept",
    [
        (DEAD_BAND, {"gain": 0.05}, ("hunts", "border", "diagram"), ("fold_in", "follow"), ("gain", "stable")),
        (DEAD_BAND, {"dead_band": 0.02}, ("hunts", "border"), ("border",), ("size",)),
    ],
)
def test_a_move_computes_nothing_again_that_does_not_depend_on_it(
    monkeypatch, before, moved, stages_asked, what, kept
):
    monkeypatch.setattr(stages, "STAGES", stages_asked)
    asked = Answers()
    first = dict(asked.of(before))
    for name in what:
        monkeypatch.setattr(f"casahunt.views.explore.page_stages.{name}", None)
    after = turned(before, **moved)
    second = dict(asked.of(after))
    for name in kept:
        assert all(name not in told or second[stage][name] == told[name] for stage, told in first.items())
    monkeypatch.undo()
    monkeypatch.setattr(stages, "STAGES", stages_asked)
    assert dict(Answers().of(after)) == second  # and what is shown does not depend on what was asked before


def test_what_is_kept_has_a_limit(monkeypatch):
    """Where there is no fold a diagram begins below the gain, wherever that is turned."""

    def nothing(*_, **__):
        raise NoOrbit("nobody knows", Status.NOT_FOUND)

    monkeypatch.setattr("casahunt.views.explore.page_stages.find_fold", nothing)
    monkeypatch.setattr("casahunt.views.explore.page_stages.find_orbit", nothing)
    monkeypatch.setattr(stages, "STAGES", ("diagram",))
    asked = Answers()
    for gain in range(stages.MOST_FOUND + 3):
        list(asked.of(turned(TABLE1, gain=0.1 + 0.01 * gain)))
    (memory,) = asked._kept.values()
    assert len(memory) == stages.MOST_FOUND
    for inertia in range(stages.MOST_KEPT + 3):
        list(asked.of(turned(TABLE1, **{"inertia": 0.02 + 0.001 * inertia})))
    assert len(asked._kept) == stages.MOST_KEPT


def test_the_latest_are_those_set_or_read_last():
    some = stages.Latest(2)
    some["a"], some["b"] = 1, 2
    assert some["a"] == 1
    some["c"] = 3
    assert dict(some) == {"a": 1, "c": 3}


def test_a_loop_above_its_fold_gain_has_the_border_and_diagram_of_those_below(shown):
    above = shown(turned(TABLE1, gain=0.7, spring=0.01), "hunts", "border", "diagram")
    below = shown(turned(TABLE1, gain=0.5, spring=0.01), "border")
    assert above["hunts"]["verdict"] == "unknown" and above["border"]["ratio"]["value"] < 1
    assert above["border"]["ratio"]["said"].endswith("that: no hunting was found")  # less than that it does not
    assert above["border"]["gain"]["value"] == pytest.approx(below["border"]["gain"]["value"], rel=1e-8)
    drawn = [x for name in ("stable", "unstable") for x in above["diagram"][name]["gain"] if x is not None]
    assert max(drawn) == pytest.approx(above["border"]["gain"]["value"], rel=1e-5)


@pytest.mark.slow
def test_the_border_of_a_remedy_is_that_with_its_other_numbers(shown):
    """With a part of the gain left inside an error dead band the servo hunts inside, where that is wide: the cycle that
    crosses its edges folds, and a smaller gain's goes on; with none of it left it is pushed through."""
    for part in (0.3, 0.0):
        asked = turned(TABLE1.choose("remedy", "error dead band"), gain=0.04, error_dead_band=0.01, remaining_gain=part)
        found = shown(asked, "hunts", "border")["border"]
        assert "size" not in found and "goes on" in found["remedy_why"]
        if part:
            wide = asked.problem.loop.replace(error_dead_band=1.0)
            inside = loop_cycle(wide, "error_dead_band", start=wide.at_rest(-0.3))
            assert inside.amplitude < 0.2 and inside.stable


@pytest.mark.slow
def test_stability_at_a_glance_is_that_of_the_multipliers(monkeypatch):
    """Along the branches that the page draws, stable, unstable, and next to the fold."""
    drawn = []
    real = page_stages.branches_shown
    monkeypatch.setattr(page_stages, "branches_shown", lambda orbits, fold: drawn.extend(orbits) or real(orbits, fold))
    for state in (TABLE1, DEAD_BAND):
        dict(Answers().of(state))
    some = [orbit for k, orbit in enumerate(drawn) if k % 4 == 0 or 0.1 < orbit.provisional_multiplier < 10]
    assert [orbit.seen_stable for orbit in some] == [orbit.stable for orbit in some]
    assert {orbit.stable for orbit in some} == {True, False}


def test_nobody_waits_for_an_answer_that_is_dropped():
    calls = 0

    def dropped() -> bool:
        nonlocal calls
        calls += 1
        return calls > 20

    with pytest.raises(effort.Dropped):
        dict(Answers().of(TABLE1, dropped))
    assert calls == 21


def test_a_stage_that_goes_on_for_ever_is_given_up(monkeypatch):
    monkeypatch.setattr(stages, "MOST_WORK_OF_A_STAGE", 50)
    told = dict(Answers().of(TABLE1))
    assert told["step"]["why"] == "given up, because it takes too long here; the command line goes on longer"
    assert "collocation intervals" in told["step"]["evidence"] and told["linear"]["phase_margin"]["value"] > 0


@pytest.mark.parametrize("state", [TABLE1, DEAD_BAND])
def test_a_diagram_that_is_given_up_shows_what_is_known_so_far(monkeypatch, shown, state):
    """Its curve begins as the whole one does, ends at a point that is marked, and a sentence says why."""
    whole = shown(state, "diagram")["diagram"]

    class Limited(list):
        def append(self, orbit):
            if len(self) == 11:
                raise effort.GivenUp("enough")
            super().append(orbit)

    begin = page_stages.Stages.__init__

    def limited(self, *arguments):
        begin(self, *arguments)
        self.drawn = Limited()

    monkeypatch.setattr(page_stages.Stages, "__init__", limited)
    told = shown(state, "diagram")["diagram"]
    assert "given up" in told["why"] and told["evidence"] == "enough"
    known = [x for x in told["stable"]["gain"] if x is not None]
    assert len(known) == 11 and known == [x for x in whole["stable"]["gain"] if x is not None][:11]
    assert told["unfinished"]["gain"] == [known[-1]] and "unfinished" not in whole


def test_a_diagram_begins_with_what_has_led_to_its_fold(shown):
    """The same branch as one that is followed from its foot, both ways, though its points are others."""
    behind, alone = (shown(DEAD_BAND, *names)["diagram"] for names in (("hunts", "border", "diagram"), ("diagram",)))
    for name in ("stable", "unstable"):
        curves = []
        for told in (behind, alone):
            points = [(g, a) for g, a in zip(told[name]["gain"], told[name]["amplitude"], strict=True) if g is not None]
            curves.append(np.log(np.array(sorted(points))).T)
        (g, a), (gains, amplitudes) = curves
        inside = g < gains.max() - 0.05  # next to the fold chords are no curve
        assert a[inside] == pytest.approx(np.interp(g[inside], gains, amplitudes), abs=0.02)
        assert g.min() == pytest.approx(gains.min(), abs=1e-6) and g.max() == pytest.approx(gains.max(), abs=0.01)


def test_what_is_given_up_does_not_hang_on_the_clock(monkeypatch, shown):
    """On a machine that is a thousand times slower the page shows the same."""
    here = shown(TABLE1, "hunts", "border", "diagram")
    clock = time.monotonic
    monkeypatch.setattr("time.monotonic", lambda: 1000 * clock())
    assert shown(TABLE1, "hunts", "border", "diagram") == here


def test_a_cycle_beyond_the_reach_of_the_first_motion_is_found_along_the_branch(monkeypatch, shown):
    """Next to the end of hunting a motion from the cycle of the bare servo comes to rest: that is no contradiction."""
    asked = turned(TABLE1.choose("remedy", "leak"), gain=0.07, leak=0.25)
    told = shown(asked, "hunts", "border", "step", "diagram")
    border = remedies(Servo(), "switch", 0.07, only=["leak"]).remedies[0].size
    assert 0.25 < border == pytest.approx(told["border"]["size"]["value"], rel=1e-6)
    near = loop_cycle(asked.problem.loop.replace(leak=0.2), "leak", options=Options(tol=1e-9))
    truth = follow(near, "leak", to=0.25, monitors=()).orbits[-1]
    assert told["hunts"]["amplitude"]["value"] == pytest.approx(truth.amplitude, rel=1e-6)
    assert told["border"]["sentence"].startswith("It hunts, but not from every start: ")  # that motion rests
    assert told["border"]["sentence"].endswith(f"{100 * (border / 0.25 - 1):.3g} % above the present one.")
    assert told["border"]["gain"]["value"] > 0.07 and told["diagram"]["stable"]
    beyond = shown(turned(asked, leak=0.253), "hunts", "border")
    assert beyond["hunts"]["verdict"] == "unknown" and "present one is" in beyond["border"]["sentence"]


def test_irregular_hunting_is_an_answer(monkeypatch, shown):
    """Where no swing repeats there is no cycle to be shown, and how far it swings is said."""
    def irregular(*_: object, **__: object) -> None:
        raise HuntsIrregularly("it hunts irregularly", Status.NOT_FOUND, amplitude=(0.05186, 0.05356), between=(1, 2))

    monkeypatch.setattr(page_stages, "find_orbit", irregular)
    told = shown(turned(TABLE1.choose("remedy", "leak"), gain=0.07, leak=0.25), "hunts")["hunts"]
    assert told["verdict"] == "uneven" and "amplitude" not in told
    assert told["sentence"] == "It hunts irregularly: it turns 0.05186 to 0.05356 rad from the set point."


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_step_that_rests_beside_hunting_says_from_where_it_hunts(shown, model):
    """As `casahunt simulate` does; by a motion from the start that is named."""
    told = shown(turned(TABLE1.choose("model", model), gain=0.6), "hunts", "border", "step")
    assert told["hunts"]["verdict"] == "hunts" and told["step"]["ends"].startswith("the step ends: at rest; ")
    assert told["step"]["sentence"].startswith("It hunts, but not from every start: ")
    assert told["step"]["sentence"].endswith("above the present one.")
    at = float(re.search(r"at rest at ([0-9.]+) rad it hunts", told["step"]["ends"])[1])
    seen = simulate(Servo(), model, 0.6, position=at, time=200.0)
    assert seen.verdict.kind == "hunting"
    below = shown(turned(TABLE1.choose("model", model), gain=0.04), "hunts", "step")["step"]
    assert below["ends"] == "the step ends: hunting" and "sentence" not in below


def test_kept_servos_are_few(monkeypatch):
    monkeypatch.setattr(stages, "STAGES", ("linear",))
    asked = Answers()
    for i in range(3 * stages.MOST_KEPT):
        list(asked.of(turned(TABLE1, friction__viscous=0.1 + i / 100)))
    assert len(asked._kept) == stages.MOST_KEPT


@pytest.mark.slow
@pytest.mark.parametrize("name", [*(n for n in STATES if not n.startswith("lugre ")), "lugre reset", "lugre dead band"])
def test_everything_has_an_answer(name, shown):
    """Numbers that JSON has, whatever the load, the remedy; with bristles of two remedies, which take longest."""
    told = shown(STATES[name])
    assert tuple(told) == STAGES and json.dumps(told, allow_nan=False)
    assert "sentence" in told["hunts"]


@pytest.mark.slow
def test_a_motion_that_is_no_cycle_of_the_system_ends_no_page():
    """Between a stop and the breakaway at the same moment there is no phase; once the worker ended by that."""
    pairs = {
        "gain": 0.1, "servo.inertia": 0.009162, "servo.motor_gain": 4.94, "friction.static": 0.5245,
        "friction.coulomb": 0.3034, "friction.stribeck_velocity": 0.06805, "friction.viscous": 0.0325,
        "load_torque": -1.215, "spring": 1.173, "controller.kp": 1.171, "controller.ki": 6.13, "controller.kd": 0.05,
        "reset_at_stop": 0.95, "remedy": "reset at a stop",
    }  # fmt: skip
    state = state_of_address(urlencode({"model": "switch", **pairs}))
    said = dict(Answers().of(state))
    assert said["hunts"]["sentence"].startswith("It hunts") and {"border", "diagram"} <= set(said)
