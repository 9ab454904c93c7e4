"""scripts/figures.py: committed captions are those of the library, pictures carry them, every figure is drawn."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from problems import table1
from scripts import figures
from scripts.report.study import Study

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "figures"
COMMITTED = figures.sections(FOLDER / "captions.md")
PNG = b"\x89PNG\r\n\x1a\n"
SLOW = {2, 4, 6, 7, 8, 12, 13}
"""Figures whose captions take seconds: a LuGre motion, LuGre cycles, slices."""
REFERENCE = table1.REFERENCE


@pytest.fixture(scope="module")
def study() -> Study:
    return Study()


def text(section: str) -> str:
    """A section without its line breaks and marks."""
    return " ".join(section.replace("**", "").split())


def test_there_are_eleven_figures_and_two_of_ours():
    assert sorted(figures.FIGURES) == sorted(COMMITTED) == list(range(1, 14))
    assert (FOLDER / "captions.md").read_text(encoding="utf-8").startswith(figures.HEAD)


@pytest.mark.parametrize("number", [pytest.param(n, marks=[pytest.mark.slow] * (n in SLOW)) for n in range(1, 14)])
def test_the_committed_caption_is_not_stale(number, study):
    """To the last digit: whoever changes the library or the script draws again."""
    assert COMMITTED[number] == figures.section(number, figures.FIGURES[number].caption(study))


@pytest.mark.parametrize("number", range(1, 14))
def test_the_picture_was_drawn_with_the_committed_caption(number):
    path = FOLDER / figures.name_of(number)
    assert path.read_bytes().startswith(PNG) and 20_000 < path.stat().st_size < 160_000
    with Image.open(path) as image:
        assert figures.section(number, image.info["Description"]) == COMMITTED[number]


@pytest.mark.parametrize("number", range(1, 14))
def test_each_caption_says_what_agrees_and_what_goes_beyond(number):
    assert "**Agrees:**" in COMMITTED[number] and "**Beyond:**" in COMMITTED[number]
    assert ("Not in the report" in COMMITTED[number]) == (number > 11)


def agrees(printed: str, value: float) -> bool:
    """A printed number is the value to half a unit of its last digit."""
    mantissa, _, exponent = printed.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(float(printed) - value) <= 0.5001 * unit


NUMBER = r"(-?\d+(?:\.\d+)?(?:e[-+]?\d+)?)"


def test_numbers_are_those_of_the_reference_table():
    """Which two programs without collocation have computed."""
    at = {model: REFERENCE[model]["stable"][0] for model in ("switch", "lugre")}
    assert at["switch"]["K"] == at["lugre"]["K"] == 0.04
    pattern = rf"amplitudes {NUMBER} and {NUMBER} rad, periods {NUMBER} and {NUMBER} s.*mu = {NUMBER} and {NUMBER},"
    found = re.search(pattern, text(COMMITTED[4]))
    expected = [at[m][key] for key in ("amplitude", "period", "mu") for m in ("switch", "lugre")]
    assert found and all(agrees(a, b) for a, b in zip(found.groups(), expected, strict=True))
    for numbers, model in (((6, 7, 8), "lugre"), ((9, 10, 11), "switch")):
        fold = REFERENCE[model]["fold"]
        for n in numbers:
            found = re.search(rf"(?:the fold(?: itself)?,|fold is near, at) K = {NUMBER}", text(COMMITTED[n]))
            assert found and agrees(found[1], fold["K"]), n
        found = re.search(rf"the fold itself, K = {NUMBER} \({NUMBER} rad, {NUMBER} s\)", text(COMMITTED[numbers[0]]))
        assert found and agrees(found[2], fold["amplitude"]) and agrees(found[3], fold["period"])
    (row,) = (row for row in REFERENCE["switch"]["unstable"] if row["K"] == 0.4)
    found = re.search(rf"K = 0.4: {NUMBER} rad, {NUMBER} s", text(COMMITTED[9]))
    assert found and agrees(found[1], row["amplitude"]) and agrees(found[2], row["period"])


def draw(out: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "scripts/figures.py", "--quick", "--out", str(out), *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)


@pytest.mark.slow
def test_every_figure_is_drawn(tmp_path):
    run = draw(tmp_path)
    assert run.returncode == 0, run.stderr
    names = [figures.name_of(n) for n in range(1, 14)]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["captions.md", *names])
    for name in names:
        assert (tmp_path / name).read_bytes().startswith(PNG)
        assert 20_000 < (tmp_path / name).stat().st_size < 160_000
    assert list(figures.sections(tmp_path / "captions.md")) == list(range(1, 14))


def test_one_figure_in_each_run_keeps_the_captions_of_the_others(tmp_path, capsys):
    for n in (5, 1):
        assert figures.main(["--quick", "--out", str(tmp_path), "--only", str(n)]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["captions.md", "figure01.png", "figure05.png"]
    assert list(figures.sections(tmp_path / "captions.md")) == [1, 5]
    assert capsys.readouterr().out.count(".png") == 2


def test_an_unknown_figure(tmp_path, capsys):
    with pytest.raises(SystemExit) as refusal:
        figures.main(["--out", str(tmp_path / "out"), "--only", "14"])
    assert refusal.value.code == 2 and "14" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
