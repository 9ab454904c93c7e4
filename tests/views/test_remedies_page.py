"""The page of the remedies: every number has its key, nothing is taken for HTML, and what is no page of it stays."""

from __future__ import annotations

import base64
import html
import json
import re
from functools import cache
from pathlib import Path

import pytest
from command_line import is_picture, run
from page_support import Reader, every_number_has_its_key

from casahunt import Servo, remedies
from casahunt.cli import main
from casahunt.views.commands import remedies as command
from casahunt.views.evidence.remedies_page import CAPTIONS, remedies_page

GAIN = ("remedies", "--gain", "0.04", "--quiet")
LEAK = 0.246844841
"""Fold by an independent event map [1/s]."""


@cache
def of_the_leak():
    return remedies(Servo(), "switch", 0.04, only=["leak"])


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("remedies") / "out"
    (uncertain := folder.parent / "set.toml").write_text('[interval]\n"friction.static" = [0.529, 0.531]\n')
    words = ["--only", "leak,gain", "--only", "feedforward", "--max-error", "0.1", "--uncertainty", str(uncertain)]
    assert main([*GAIN, *words, "--out", str(folder), "--json"]) == 0
    return folder


@pytest.fixture(scope="module")
def record(out) -> dict:
    return json.loads((out / "remedies.json").read_text())


@pytest.fixture(scope="module")
def text(out) -> str:
    return (out / "remedies.html").read_text()


def test_every_number_of_the_page_is_that_of_the_object(text, record):
    reader = Reader()
    reader.feed(text)
    every_number_has_its_key(reader, record)
    keys = {attributes["data-key"] for attributes, _ in reader.keyed}
    row = next(i for i, row in enumerate(record["remedies"]) if row["name"] == "leak")
    for key in ("size", "recommended", "recommended_rest_error", "peak_torque", "peak_voltage", "phase_margin",
                "worst_size", "moves/static"):  # fmt: skip
        assert f"remedies/{row}/{key}" in keys
    assert {"best", "advice", "command", "made/casahunt", "servo/friction.static"} <= keys
    found = record["remedies"][row]
    assert found["size"] == pytest.approx(LEAK, rel=1e-6) and found["worst_size"] > found["size"]
    assert max(abs(x1) for x1, _ in found["rests"]) == found["recommended_rest_error"]
    assert "--max-error 0.1" in record["command"] and "--only leak,gain --only feedforward" in record["command"]
    assert "cheapest remedy with error at rest up to 0.1 rad: leak" in record["advice"]
    no_remedy = next(row for row in record["remedies"] if row["name"] == "feedforward")
    assert not no_remedy["ends_hunting"] and html.escape(no_remedy["said"]) in text


def test_what_the_drive_does_with_a_remedy_is_on_the_page(record):
    """Where the servo file describes it; each number with its key."""
    seen = {"kind": "hunting", "sentence": "on a reading it is hunting", "dead_band": 0.00173}
    more = record | {"as_built": {"gain": seen, "leak": "not checked, <none>"}}
    page = remedies_page(more, {})
    assert "<h2>In the loop as built</h2>" in page and "not checked, &lt;none&gt;" in page
    assert '<span class="bad said">' in page and 'data-key="as_built/gain/dead_band"' in page and "0.00173" in page
    seen |= {"kind": "at rest", "sentence": "every one of 6 motions comes to rest for ever", "dead_band": None}
    page = remedies_page(more, {})
    assert "every one of 6 motions" in page and "as_built/gain/dead_band" not in page
    assert "In the loop as built" not in remedies_page(record, {})
    hunts = record | {"as_built": {record["best"]: seen | {"kind": "hunting"}}}
    assert "<p class=answer>" in page and "<p class=answer>" not in remedies_page(hunts, {})


def test_nothing_comes_from_elsewhere_and_the_pictures_are_in_it(text, tmp_path):
    assert "<script" not in text and "http" not in text and "url(" not in text
    pictures = re.findall(r'<img alt="([^"]*)" src="data:image/png;base64,([^"]*)"', text)
    assert len(pictures) == 2
    for i, (said, data) in enumerate(pictures):
        (path := tmp_path / f"{i}.png").write_bytes(base64.b64decode(data))
        assert is_picture(path) and "leak" in said and re.search(r"\d", said)


WRONG = '<b onclick="x">A & B'


def hostile(value, key=""):
    """A record whose texts each hold HTML, but for the names that the page chooses by."""
    if isinstance(value, dict):
        return {name: hostile(entry, name) for name, entry in value.items()}
    if isinstance(value, list):
        return [hostile(entry, key) for entry in value]
    return value + WRONG if isinstance(value, str) and key not in ("name", "best") else value


def test_no_text_is_taken_for_html(record):
    pictures = dict.fromkeys(CAPTIONS, b"")
    before, after = remedies_page(record, pictures), remedies_page(hostile(record), pictures)
    tags = [re.findall(r"<(/?\w+)", text) for text in (before, after)]
    assert tags[0] == tags[1] and after.count("A &amp; B") >= 10
    assert WRONG not in after and 'onclick="' not in after and "A & B" not in after


def test_where_no_remedy_ends_it_there_is_a_page_too(record):
    rows = [row for row in record["remedies"] if row["name"] == "feedforward"]
    shown = remedies_page(record | {"remedies": rows, "best": ""}, {})
    assert "What does not end it" in shown and "class=answer" not in shown


@pytest.mark.parametrize("name", command.FILES)
def test_what_casahunt_has_not_written_stays(capsys, tmp_path, monkeypatch, name):
    monkeypatch.setattr(command, "remedies", lambda *a, **k: pytest.fail("computed"))
    (tmp_path / name).write_text("mine")
    code, shown, err = run(capsys, *GAIN, "--out", tmp_path)
    assert (code, shown) == (2, "") and f"holds a {name} that this version of casahunt did not write" in err
    assert (tmp_path / name).read_text() == "mine" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.slow
def test_what_comes_while_it_computes_stays(capsys, tmp_path, monkeypatch):
    def page(*_):
        (tmp_path / "remedies.html").write_text("mine")
        return "<html>"

    monkeypatch.setattr(command, "remedies", lambda *a, **k: of_the_leak())
    monkeypatch.setattr(command, "remedies_page", page)
    code, _, err = run(capsys, *GAIN, "--only", "leak", "--out", tmp_path)
    assert code == 2 and "holds a remedies.html that this version of casahunt did not write" in err
    assert (tmp_path / "remedies.html").read_text() == "mine" and not (tmp_path / "remedies.json").exists()


@pytest.mark.slow
def test_its_own_files_are_written_over(capsys, out, monkeypatch):
    monkeypatch.setattr(command, "remedies", lambda *a, **k: of_the_leak())
    assert run(capsys, *GAIN, "--only", "leak", "--out", out)[0] == 0
    assert len(json.loads((out / "remedies.json").read_text())["remedies"]) == 1


def test_a_file_that_is_read_is_not_written(capsys, tmp_path):
    (tmp_path / "remedies.json").write_text("{}")
    words = ("--uncertainty", tmp_path / "remedies.json", "--out", tmp_path)
    code, _, err = run(capsys, *GAIN, *words)
    assert code == 2 and "must be another file than the uncertainty file" in err
