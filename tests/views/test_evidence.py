"""The evidence page: every number has its key, nothing comes from elsewhere, and a browser shows it."""

from __future__ import annotations

import base64
import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from page_support import Reader, every_number_has_its_key

import casahunt
from casahunt.cli import main
from casahunt.views.evidence import page as evidence
from casahunt.views.evidence.page import evidence_page
from casahunt.views.evidence.record import made as made_of
from casahunt.views.glossary import GLOSSARY, words_in

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("evidence") / "out"
    (uncertain := folder.parent / "set.toml").write_text('[interval]\n"friction.static" = [0.529, 0.531]\n')
    code = main(["tune", "--out", str(folder), "--uncertainty", str(uncertain), "--json", "--quiet"])
    assert code == 0
    return folder


@pytest.fixture(scope="module")
def record(out) -> dict:
    return json.loads((out / "tune.json").read_text())


@pytest.fixture(scope="module")
def text(out) -> str:
    return (out / "tune.html").read_text()


@pytest.fixture(scope="module")
def reader(text) -> Reader:
    found = Reader()
    found.feed(text)
    return found


def test_every_number_has_its_key(reader, record):
    assert len(reader.keyed) > 60
    every_number_has_its_key(reader, record)


def test_the_answer_is_in_it(reader, record):
    keys = {attributes["data-key"] for attributes, _ in reader.keyed}
    for key in ("gain", "fold/nominal", "worst/fold_gain", "fold/linear_low", "fold/linear_high",
                "verification/fold_gain", "elasticities/friction.static"):  # fmt: skip
        assert key in keys
    assert record["gain"] == pytest.approx(1.1 * record["worst"]["fold_gain"], rel=1e-6)
    assert record["worst"]["corner"] == {"friction.static": 0.531}
    assert {task["verdict"] for task in record["verification"]["tasks"]} <= {"at rest", "decaying"}
    assert record["verification"]["result"] == "verified" and record["verification"]["unverified"] == []


def test_what_is_not_verified_stands_on_the_page(record):
    check = record["verification"] | {"result": "not everything verified", "unverified": ["a task: undecided"]}
    shown = evidence_page(record | {"verification": check}, {})
    assert "Not everything is verified" in shown and "a task: undecided" in shown and ">Verified<" not in shown
    check |= {"result": "speaks against it", "against": ["a loop is unstable"]}
    shown = evidence_page(record | {"verification": check}, {})
    assert "The verification speaks against it" in shown and "a loop is unstable" in shown


WRONG = '<b onclick="x">A & B'


def test_what_the_drive_does_is_on_the_page(record):
    seen = {"kind": "hunting", "sentence": "half-way it hunts by one count", "dead_band": 0.00173}
    page = evidence_page(record | {"as_built": seen}, {})
    assert "<h2>In the loop as built</h2>" in page and "half-way it hunts by one count" in page
    assert 'data-key="as_built/dead_band"' in page and "In the loop as built" not in evidence_page(record, {})


def hostile(value, key=""):
    """A record whose texts, and names of elasticities, each hold HTML; but for the texts that the page chooses by."""
    if isinstance(value, dict):
        end = WRONG if key == "elasticities" else ""
        return {name + end: hostile(entry, name) for name, entry in value.items()}
    if isinstance(value, list):
        return [hostile(entry, key) for entry in value]
    return value + WRONG if isinstance(value, str) and key not in ("result", "verdict", "binding") else value


def test_no_text_is_taken_for_html(record, monkeypatch):
    """Whatever stands in a text: a servo file's name, what was set, a reason, a caption, an explanation."""
    pictures = dict.fromkeys(evidence.CAPTIONS, b"")
    check = record["verification"] | {"against": ["a loop"], "unverified": ["a task"]}
    made = made_of("my servo.toml", ["friction.static=0.55"])
    plain = record | {"verification": check, "made": made}
    before = evidence_page(plain, pictures)
    for texts, name in [(evidence.CAPTIONS, "diagram"), (GLOSSARY, "fold"), (GLOSSARY, "event map")]:
        monkeypatch.setitem(texts, name, texts[name] + WRONG)
    after = evidence_page(hostile(plain), pictures)
    tags = [re.findall(r"<(/?\w+)", text) for text in (before, after)]
    assert tags[0] == tags[1] and after.count("A &amp; B") > 60
    assert WRONG not in after and 'onclick="' not in after and "A & B" not in after


def test_nothing_comes_from_elsewhere(text, reader):
    assert len(reader.sources) == 3
    for source in reader.sources:
        head, _, data = source.partition(",")
        assert head == "data:image/png;base64"
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG")
    assert "<script" not in text and "url(" not in text and "http" not in text and "@import" not in text


def rows_of_numbers(text: str) -> list[tuple[list[str], str]]:
    """(keys, text) of every row of every table that holds a number."""
    rows = []
    for row in re.findall(r"<tr>(?!<th)(.*?)</tr>", text):
        keys = re.findall(r'<data data-key="([^"]+)"', row)
        if keys:
            rows.append((keys, html.unescape(re.sub(r"<[^>]*>", " ", row))))
    return rows


PLAIN = ("fold/error", "elasticities/", "demands/gain_margin", "verification/loops_checked")
"""Numbers without a unit; what they are is said beside them."""


def test_every_row_of_numbers_has_its_unit(text):
    rows = rows_of_numbers(text)
    assert len(rows) > 35
    unit = re.compile(r"\d\s*(V/rad|N m/V|N m s/rad|N m/rad|N m|kg m²|rad/s|rad|s⁻¹|s|%|degrees)(?=[\s,)]|$)")
    head = re.compile(r"<th>gain \[V/rad\]</th>")
    for keys, said in rows:
        in_head = keys == ["gain"]
        assert unit.search(said.replace("\xa0", " ")) or any(key.startswith(PLAIN) for key in keys) or in_head, said
    assert head.search(text)


def test_numbers_have_the_digits_that_are_known(record):
    """Of the same tuning at a rough tolerance, and with a fold gain of three digits."""
    check = record["verification"] | {"fold_error": 2e-3}
    shown = evidence_page(record | {"verification": check, "tol": 1e-2}, {})
    assert f"{record['gain']:.3g}<" in shown and f"{record['gain']:.4g}" not in re.sub(r'value="[^"]*"', "", shown)
    known = record["elasticities"]["friction.static"]
    assert f">{known:+.2f}<" in shown and f">{known:+.3f}<" not in shown


def test_the_page_says_when_by_what_and_for_which_servo(tmp_path, monkeypatch, record, text, capsys):
    made = record["made"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", made["date"]) and made["date"] in text
    assert made["casahunt"] == casahunt.__version__ and f">{casahunt.__version__}<" in text
    assert made["servo_file"] is None and "no servo file" in text
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1000000000")
    again = made_of("my servo.toml", ["friction.static=0.55"])
    assert again["date"] == "2001-09-09"
    shown = evidence_page(record | {"made": again}, {})
    assert all(f">{part}<" in shown for part in ("2001-09-09", "my servo.toml", "friction.static=0.55"))
    assert "no servo file" not in shown and evidence_page(record | {"made": again}, {}) == shown


def test_pictures_are_described_with_their_numbers(text, record):
    """Who does not see them reads in the alternative text what they show; captions only say what they are."""
    diagram, bars, tasks = (html.unescape(found) for found in re.findall(r'<img alt="([^"]*)"', text))
    for part in (f"{record['gain']:.4g} V/rad", f"{record['fold_gain']:.4g} V/rad", "10 %"):
        assert part in diagram
    assert f"friction: static {record['elasticities']['friction.static']:+.3g} %" in bars
    assert "A step of 1 rad from rest: comes to rest" in tasks and f"{record['gain']:.4g} V/rad" in tasks


def test_margins_stand_in_one_block(record):
    """What was asked for, then a row for each set of margins, with all servos that have it and where in the set."""
    loop = {**record["verification"]["loops"]["nominal"], "phase_margin": 40.0}
    other = {**loop, "phase_margin": 35.0}
    names = ("phase margin", "gain margin (lowering)", "gain margin (raising)")
    corners = dict.fromkeys(names[:2], {"friction.viscous": 0.09}) | {names[2]: {"friction.viscous": 0.11}}
    loops = {"nominal": loop, "worst": other, **dict.fromkeys(names[:2], other), names[2]: loop}
    check = record["verification"] | {"loops": loops, "loop_corners": corners}
    worst = record["worst"] | {"corner": {"friction.viscous": 0.09}}
    shown = evidence_page(record | {"verification": check, "worst": worst}, {})
    before, _, behind = shown.partition("stable up to</th>")
    block, _, below = behind.partition("</table>")
    assert "degrees" not in before and "degrees" not in below.partition("What this does not prove")[0]
    rows = re.findall(r"<tr>.*?</tr>", block, re.DOTALL)
    rows = [" ".join(html.unescape(re.sub(r"<[^>]*>", " ", row)).split()) for row in rows]
    assert len(rows) == 3 and rows[0] == "asked for at least 30 degrees 2 times less 2 times more"
    assert rows[1].startswith("nominal; least gain margin (raising) of the set: friction: viscous 0.11 N m s/rad 40")
    where = "least phase margin, gain margin (lowering) of the set: friction: viscous 0.09 N m s/rad 35 degrees"
    assert rows[2].startswith(f"worst friction; {where}")


def test_words_of_the_trade_are_explained_on_the_page(text):
    before, _, explained = text.partition("<h2>What the words mean</h2>")
    words = words_in(html.unescape(re.sub(r"<[^>]*>", " ", re.sub(r"<style>.*?</style>", "", before, flags=re.DOTALL))))
    assert "fold" in words and "event map" in words
    for word in words:
        assert f"<dt>{word}</dt><dd>{html.escape(GLOSSARY[word])}</dd>" in explained


def test_a_wide_row_is_stacked_on_a_narrow_screen(text):
    """Every cell of a table with headings carries its own; the browser test below measures the page."""
    for table in re.findall(r"<table class=rows><thead>(.*?)</table>", text):
        heads = re.findall(r"<th>(.*?)</th>", table)
        for row in re.findall(r"<tr>(<td.*?)</tr>", table):
            assert re.findall(r'<td data-label="([^"]*)">', row) == heads


def as_built_hunting(record: dict) -> dict:
    """The record of a gain that hunts in the loop as built, with as long a sentence as there is."""
    seen = {"kind": "hunting", "sentence": "with the set point on a reading it is hunting: " * 5, "dead_band": 0.00173}
    return record | {"as_built": seen}


def test_a_gain_that_hunts_as_built_is_not_called_good_alone(record):
    """In the heading, where the gain stands: what is verified below is the loop of the model."""
    page = evidence_page(as_built_hunting(record), {})
    (answer,) = re.findall("<p class=answer>(.*?)</p>", page)
    assert "but not alone: in the loop as built it hunts there" in answer
    assert "but not alone" not in evidence_page(record, {})


@pytest.mark.slow
@pytest.mark.parametrize("width", [400, 1200])
def test_the_page_fits_the_screen(out, record, tmp_path, width):
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        pytest.skip("no headless browser is installed")
    frame = tmp_path / "frame.html"  # a window is never as narrow as that
    measure = "document.title = 'wide ' + this.contentDocument.documentElement.scrollWidth"
    images = {name: base64.b64decode(data) for name, data in zip(
        evidence.CAPTIONS, re.findall(r"base64,([^\"]*)", (out / "tune.html").read_text()), strict=True)}  # fmt: skip
    content = html.escape(evidence_page(as_built_hunting(record), images))
    frame.write_text(f'<title></title><iframe srcdoc="{content}" width={width} height=900 onload="{measure}"></iframe>')
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1300,1000",
        f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", frame.as_uri(),
    ]  # fmt: skip
    run = subprocess.run(command, capture_output=True, text=True, timeout=120)
    found = re.search(r"<title>wide (\d+)</title>", run.stdout)
    if found is None:
        pytest.skip(f"{browser} does not run here: {run.stderr.strip()[-200:]}")
    assert int(found[1]) <= width


@pytest.mark.slow
def test_a_browser_shows_it(out, tmp_path):
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        pytest.skip("no headless browser is installed")
    picture = tmp_path / "page.png"
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=900,6000",
        f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={picture}", (out / "tune.html").as_uri(),
    ]  # fmt: skip
    run = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if not picture.exists():
        pytest.skip(f"{browser} does not run here: {run.stderr.strip()[-200:]}")
    import matplotlib.image

    pixels = matplotlib.image.imread(picture)[..., :3]
    assert pixels.shape[:2] == (6000, 900)
    # The pictures, decoded and in place: the dark blue of the Switch model, the green of the tasks.
    for colour in ("#0b2f6b", "#1d6b3f"):
        rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        assert np.sum(np.max(np.abs(pixels - rgb), axis=2) < 0.02) > 200
