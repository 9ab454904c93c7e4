"""The notebooks run from top to bottom, say what is true, and are stored without output."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from problems import belt, table1

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
MINUTES = 5


def test_they_are_there_and_hold_no_output():
    assert [path.stem for path in NOTEBOOKS] == ["hunting_servo", "your_own_system"]
    for path in NOTEBOOKS:
        content = json.loads(path.read_text(encoding="utf-8"))
        assert content["nbformat"] == 4 and content["cells"][0]["cell_type"] == "markdown"
        code = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
        assert len(code) > 5 and not any(cell["outputs"] or cell["execution_count"] for cell in code)


def run(name: str, patch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The outputs of all cells of a notebook, in order."""
    pytest.importorskip("pandas")
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    patch.delenv("MPLBACKEND", raising=False)  # pictures go into the notebook
    where = {"metadata": {"path": str(FOLDER.parents[1])}}
    nbclient.NotebookClient(notebook, timeout=60 * MINUTES, kernel_name="python3", resources=where).execute()
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def printed(outputs: list[dict[str, Any]]) -> str:
    assert not [output for output in outputs if output.get("name") == "stderr"], outputs
    return "".join(output["text"] for output in outputs if output["output_type"] == "stream")


def shown(outputs: list[dict[str, Any]], kind: str) -> list[str]:
    return [output["data"][kind] for output in outputs if kind in output.get("data", {})]


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # those of the libraries that talk to the kernel
def test_the_hunting_servo(monkeypatch):
    outputs = run("hunting_servo", monkeypatch)
    text, truth = printed(outputs), table1.REFERENCE["switch"]
    said = {key: float(re.search(pattern, text).group(1)) for key, pattern in {
        "amplitude": r"amplitude ([\d.]+) rad", "period": r"period ([\d.]+) s", "fold": r"hunting up to K = ([\d.]+)",
        "gain": r"\nK = ([\d.]+) V/rad, 10% above",
    }.items()}  # fmt: skip
    stable = next(row for row in truth["stable"] if row["K"] == 0.04)
    assert said["amplitude"] == pytest.approx(stable["amplitude"], abs=1e-6)
    assert said["period"] == pytest.approx(stable["period"], abs=1e-5)
    assert said["fold"] == pytest.approx(truth["fold"]["K"], abs=1e-6)
    assert said["gain"] == pytest.approx(1.1 * truth["fold"]["K"], abs=1e-4)
    assert "at rest" in text
    assert len(shown(outputs, "image/png")) == 4 and len(shown(outputs, "text/html")) >= 6


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_your_own_system(monkeypatch):
    outputs = run("your_own_system", monkeypatch)
    text = printed(outputs)
    period = float(re.search(r"period ([\d.]+), estimated", text).group(1))
    assert period == pytest.approx(belt.TRUTH[0.2].period, abs=1e-8)
    found, exact = map(float, re.search(r"a = ([\d.]+), exact ([\d.]+)", text).groups())
    assert found == pytest.approx(exact, abs=1e-9)
    assert text.count("breaks away") >= 2 and len(shown(outputs, "image/png")) == 1
    assert sum("dataframe" in page for page in shown(outputs, "text/html")) == 2
