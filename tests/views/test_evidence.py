"""The evidence page: every number has its key, nothing comes from elsewhere, and a browser shows it."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from casahunt.cli import main
from casahunt.views.evidence.page import page, value_at

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("evidence") / "out"
    (uncertain := folder.parent / "set.toml").write_text('[interval]\n"friction.static" = [0.529, 0.531]\n')
    code = main(["tune", "--gain", "0.04", "--out", str(folder), "--uncertainty", str(uncertain), "--json", "--quiet"])
    assert code == 0
    return folder


@pytest.fixture(scope="module")
def record(out) -> dict:
    return json.loads((out / "tune.json").read_text())


@pytest.fixture(scope="module")
def text(out) -> str:
    return (out / "tune.html").read_text()


class Reader(HTMLParser):
    """Elements with a key, and the text outside of them."""

    def __init__(self) -> None:
        super().__init__()
        self.keyed: list[tuple[dict, str]] = []
        self.outside: list[str] = []
        self.sources: list[str] = []
        self._open: dict | None = None
        self._silent = 0

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.sources += [found[name] for name in ("src", "href") if name in found]
        self._silent += tag in ("style", "script")
        if "data-key" in found:
            assert self._open is None
            self._open = found
            self.keyed.append((found, ""))

    def handle_endtag(self, tag):
        self._silent -= tag in ("style", "script")
        if self._open is not None and tag in ("data", "span"):
            self._open = None

    def handle_data(self, data):
        if self._silent:
            return
        if self._open is not None:
            self.keyed[-1] = (self._open, self.keyed[-1][1] + data)
        else:
            self.outside.append(data)


@pytest.fixture(scope="module")
def reader(text) -> Reader:
    found = Reader()
    found.feed(text)
    return found


def test_every_number_has_its_key(reader, record):
    stray = [data for data in reader.outside if re.search(r"\d", data)]
    assert not stray
    assert len(reader.keyed) > 60
    for attributes, shown in reader.keyed:
        value = value_at(record, attributes["data-key"])
        if "value" in attributes:
            assert float(attributes["value"]) == value
            factor = float(attributes.get("data-factor", 1))
            assert shown == format(value * factor, attributes["data-form"]).replace("-", "\N{MINUS SIGN}")
        else:
            assert shown == ("\N{EN DASH}" if value is None else str(value))


def test_the_answer_is_in_it(reader, record):
    keys = {attributes["data-key"] for attributes, _ in reader.keyed}
    for key in ("gain", "fold/nominal", "worst/fold_gain", "fold/linear_low", "fold/linear_high",
                "verification/fold_gain", "elasticities/friction.static"):  # fmt: skip
        assert key in keys
    assert record["gain"] == pytest.approx(1.1 * record["worst"]["fold_gain"], rel=1e-6)
    assert record["worst"]["corner"] == {"friction.static": 0.531}
    assert {task["verdict"] for task in record["before"]["tasks"]} == {"hunting"}
    assert {task["verdict"] for task in record["verification"]["tasks"]} <= {"at rest", "decaying"}
    assert record["verification"]["result"] == "verified" and record["verification"]["unverified"] == []


def test_what_is_not_verified_stands_on_the_page(record):
    check = record["verification"] | {"result": "not everything verified", "unverified": ["a task: undecided"]}
    shown = page(record | {"verification": check}, {})
    assert "Not everything is verified" in shown and "a task: undecided" in shown and ">Verified<" not in shown
    check |= {"result": "speaks against it", "against": ["a loop is unstable"]}
    shown = page(record | {"verification": check}, {})
    assert "The verification speaks against it" in shown and "a loop is unstable" in shown


def test_nothing_comes_from_elsewhere(text, reader):
    assert len(reader.sources) == 3
    for source in reader.sources:
        head, _, data = source.partition(",")
        assert head == "data:image/png;base64"
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG")
    assert "<script" not in text and "url(" not in text and "http" not in text and "@import" not in text


def test_a_browser_shows_it(out, tmp_path):
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        pytest.skip("no headless browser is installed")
    picture = tmp_path / "page.png"
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=900,4500",
        f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={picture}", (out / "tune.html").as_uri(),
    ]  # fmt: skip
    run = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if not picture.exists():
        pytest.skip(f"{browser} does not run here: {run.stderr.strip()[-200:]}")
    import matplotlib.image

    pixels = matplotlib.image.imread(picture)[..., :3]
    assert pixels.shape[:2] == (4500, 900)
    # The three pictures, decoded and in place: the dark blue of the Switch model, the green and red of the tasks.
    for colour in ("#0b2f6b", "#1d6b3f", "#b03020"):
        rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        assert np.sum(np.max(np.abs(pixels - rgb), axis=2) < 0.02) > 200
