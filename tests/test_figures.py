"""scripts/figures.py draws what it is asked for, keeps the captions of the others, and has no numerics of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PNG = b"\x89PNG\r\n\x1a\n"


def draw(out: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "scripts/figures.py", "--quick", "--out", str(out), *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)


def headings(out: Path) -> list[str]:
    return re.findall(r"^## Figure (\d+):", (out / "captions.md").read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.slow
def test_two_figures_in_two_runs(tmp_path):
    for n in ("5", "1"):
        run = draw(tmp_path, "--only", n)
        assert run.returncode == 0, run.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["captions.md", "figure01.png", "figure05.png"]
    for name in ("figure01.png", "figure05.png"):
        assert (tmp_path / name).read_bytes().startswith(PNG)
        assert 10_000 < (tmp_path / name).stat().st_size < 160_000
    assert headings(tmp_path) == ["1", "5"]
    text = " ".join((tmp_path / "captions.md").read_text(encoding="utf-8").split())
    for word in ("K = 0.0320762", "Agrees:", "Does not agree:", "Fs/kp = 0.4141 rad"):
        assert word in text


@pytest.mark.slow
def test_an_unknown_figure(tmp_path):
    run = draw(tmp_path, "--only", "12")
    assert run.returncode == 2 and "12" in run.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_committed_captions_are_complete():
    folder = ROOT / "docs" / "figures"
    assert headings(folder) == [str(n) for n in range(1, 12)]
    assert all((folder / f"figure{n:02d}.png").is_file() for n in range(1, 12))
