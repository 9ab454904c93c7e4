"""casahunt cure: from a record to what stops the hunting, each step as by its own command."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import one_json, run

from casahunt import Status, cli, find_fold, load, load_uncertainty, remedies
from casahunt.servo.sampled.check import AsBuilt
from casahunt.views.commands import cure as command
from casahunt.views.evidence.cure_page import cure_page

GAIN, SOUGHT = 0.04, ("--free", "friction.static,friction.coulomb", "--set", "friction.static=0.6")
TRUE = {"friction.static": 0.53, "friction.coulomb": 0.44}
BAND = 0.0433457242337
"""Of the servo that made the record, by an independent event map [rad]."""


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    path = tmp_path_factory.mktemp("cure") / "record.csv"
    words = ["simulate", "--gain", str(GAIN), "--time", "120", "--step", "0.05", "--csv", str(path), "--quiet"]
    assert cli.main(words) == 0
    return path


@pytest.fixture(scope="module")
def cured(record, tmp_path_factory):
    out = tmp_path_factory.mktemp("page") / "page"
    words = ["cure", str(record), "--gain", str(GAIN), *SOUGHT, "--only", "dead band", "--out", str(out), "--quiet"]
    assert cli.main(words) == 0
    return out


def test_the_remedy_is_that_of_the_servo_that_made_the_record(cured):
    """Its friction is found to a per cent, and what is chosen for the worst that the record allows is enough."""
    said = json.loads((cured / "cure.json").read_text())
    for name, true in TRUE.items():
        assert said["identified"]["parameters"][name]["value"] == pytest.approx(true, rel=1e-2)
    (row,) = said["remedies"]["remedies"]
    assert row["size"] == pytest.approx(BAND, rel=0.05) and BAND < row["recommended"] < 1.5 * BAND
    assert row["worst_size"] >= row["size"] and row["recommended"] == pytest.approx(1.1 * row["worst_size"])
    assert "dead band" in said["advice"] and said["as_built"] == {} and said["gain"] == GAIN


def test_each_step_is_the_command_that_exists(cured):
    """The files beside the page lead to the same fold and the same size."""
    said, servo = json.loads((cured / "cure.json").read_text()), load(cured / "servo.toml")
    allowed = load_uncertainty(cured / "friction.toml", servo)
    assert find_fold(servo, "switch").gain == pytest.approx(said["fold"]["gain"], rel=1e-6)
    assert said["fold"]["worst"] > said["fold"]["gain"]
    (again,) = remedies(servo, "switch", GAIN, only=["dead band"], uncertainty=allowed).remedies
    assert again.worst_size == pytest.approx(said["remedies"]["remedies"][0]["worst_size"], rel=1e-5)
    page = (cured / "cure.html").read_text()
    assert all(f"href='{name}'" in page for name in ("servo.toml", "friction.toml", "cure.json"))
    assert "casahunt identify" in page and "data:image/png" in page


def test_what_no_remedy_meets(capsys, record):
    words = "cure", record, "--gain", GAIN, *SOUGHT, "--only", "dead band", "--max-error", 0.001, "--quiet"
    code, out, err = run(capsys, *words)
    assert code == 1 and "friction.static" in out and "no remedy ends hunting with error at rest up to 0.001 rad" in err
    assert "positions from column" in out  # which column and unit the friction hangs on is said


def test_what_hunts_as_built_is_no_cure(capsys, record, monkeypatch):
    """The remedy is held against the loop as built, where that is described."""
    seen = AsBuilt("hunting", "one of 6 motions hunts", "one of 6 motions hunts", math.nan, None)
    monkeypatch.setattr("casahunt.views.commands.remedies.remedies_as_built", lambda *a: {"dead band": seen})
    code, out, err = run(capsys, "cure", record, "--gain", GAIN, *SOUGHT, "--only", "dead band", "--quiet")
    assert code == 1 and "in the loop as built" in out
    assert "dead band does not do in the loop as built: one of 6 motions hunts" in err


@pytest.mark.slow
def test_a_remedy_that_rests_as_built(capsys, record):
    words = "--set", "drive.sample_time=0.001", "--set", "drive.encoder=20000", "--only", "dead band", "--quiet"
    code, out, _ = run(capsys, "cure", record, "--gain", GAIN, *SOUGHT, *words, "--json")
    assert code == 0 and one_json(out)["as_built"]["dead band"]["kind"] == "at rest"


def test_bounds_that_a_record_does_not_have_are_told(cured):
    """The worst servo is then one of a box that the program has made."""
    said = json.loads((cured / "cure.json").read_text())
    page = cure_page(said, {})
    assert not list(command._unbounded(SimpleNamespace(intervals={"friction.static": (0.5, 0.6)})))
    loose = {"friction.static": (0.5, math.inf), "friction.viscous": (0.0, 0.1)}
    above, below = command._unbounded(SimpleNamespace(intervals=loose))
    assert "static has no end: the worst servo has 10 times" in above and "viscous may be next to nothing" in below
    assert said["bounded"] and "do not bound" not in page and "<span class=good>the model explains" in page
    assert "may be too little" not in page
    said["bounded"], said["identified"]["explained"] = False, False
    said["remedies"]["remedies"][0]["worst_size"] = None
    page = cure_page(said, {"fit": b""})
    assert "do not bound every parameter" in page and "<span class=bad>the model does not explain" in page
    assert "may be too little" in page
    assert 'alt="the model does not explain the records"' in page
    assert "of the amplitude is left" in page and "misfit" not in page  # which is 9 of a fit that explains too


def test_a_fold_that_is_not_found_says_so(capsys, record, monkeypatch):
    def refused(*a, **k):
        raise command.NoOrbit("nothing there")

    monkeypatch.setattr(command, "find_fold", refused)
    words = "cure", record, "--gain", GAIN, *SOUGHT, "--only", "dead band", "--quiet", "--json"
    code, out, _ = run(capsys, *words)
    assert code == 0 and one_json(out)["fold"] == {"gain": None, "worst": None, "refused": "nothing there"}


@pytest.mark.parametrize(("step", "name"), [("find_fold", "fold"), ("worst_corner", "uncertainty")])
def test_a_fold_that_takes_too_long_is_left_to_its_own_command(capsys, record, monkeypatch, step, name):
    """Remedies are what is asked for."""
    monkeypatch.setattr(command, step, lambda *a, **k: command.effort.problem(int(command.MOST_WORK_BESIDE) + 1))
    words = "cure", record, "--gain", GAIN, *SOUGHT, "--only", "dead band", "--quiet", "--json"
    code, out, _ = run(capsys, *words)
    fold = one_json(out)["fold"]
    assert code == 0 and fold["worst"] is None and (fold["gain"] is None) is (name == "fold")
    assert f"casahunt {name} looks longer" in fold["refused"]


@pytest.mark.parametrize(("words", "says"), [
    (("--only", "brake"), "unknown remedy 'brake'"), (("--max-error", "-1"), "max_error = -1"),
    (("--free", "friction.stiction"), "friction.static"), (("--gain", "0"), "gain"),
])  # fmt: skip
def test_what_is_wrong_is_said_before_anything_is_written(capsys, record, tmp_path, words, says):
    code, out, err = run(capsys, "cure", record, "--gain", GAIN, *words, "--out", tmp_path / "page")
    assert (code, out) == (2, "") and says in err and not list(tmp_path.iterdir())


def test_a_servo_at_rest_has_nothing_to_cure(capsys, tmp_path):
    path = tmp_path / "rest.csv"
    path.write_text("time,position\n" + "\n".join(f"{0.01 * k},0.3" for k in range(4000)))
    code, out, err = run(capsys, "cure", path, "--gain", GAIN, "--out", tmp_path / "page")
    assert (code, out) == (2, "") and "rest" in err and not (tmp_path / "page").exists()


def test_a_fit_that_did_not_settle_is_no_servo(capsys, record, monkeypatch):
    """Nothing is computed of its values."""
    fit = SimpleNamespace(status=Status.FIT_NOT_CONVERGED)
    monkeypatch.setattr(command.identification, "fit_of", lambda options: (lambda: fit, []))
    code, out, err = run(capsys, "cure", record, "--gain", GAIN, "--quiet")
    assert code == 1 and not out and "the records were not fitted: " in err


@pytest.mark.parametrize(("explained", "best"), [(True, "dead band"), (False, "dead band"), (False, ""), (True, "")])
def test_what_speaks_against_the_answer(capsys, explained, best):
    judgement = SimpleNamespace(explained=explained, repeats=True, systematic=0.3, misfit=9.0)
    data, left = SimpleNamespace(quantum=0.0, name="mine.csv"), np.repeat([3.0, 1.0 if best else 3.0], 50)
    found = SimpleNamespace(judgement=judgement, model="switch", records=(data,), residuals=(left,))
    cures = SimpleNamespace(best=best, remedies=())
    assert command._judged(found, command.Table(cures)) == int(not (explained and best))
    err = capsys.readouterr().err
    assert ("does not explain the record" in err) is not explained and ("no remedy ends hunting" in err) == (not best)
    assert ("of its first half: leave more out by --from" in err) is (not explained and bool(best))
