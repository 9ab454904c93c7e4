"""`casahunt examples`: notebooks that are the guides, run from top to bottom, and spare what somebody has changed."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from command_line import contents, run

from casahunt.views.notebooks.cells import cells_of_example, cells_of_page, relinked
from casahunt.views.notebooks.guides import BEGIN, SECTIONS, guides
from casahunt.views.notebooks.written import notebook

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "docs"
MOST_BYTES = 250_000
"""Of all notebooks together."""
QUICK = ("example_loop", "example_record", "example_pid", "guide_controller")
"""Their cells take a second or two."""
RUN_ELSEWHERE = ("hunting_servo", "your_own_system")
"""By tests/test_notebooks.py."""
MINUTES = 5
NAMES = [name for name in guides() if name != BEGIN]


def code_of(name: str) -> list[str]:
    return [cell["source"] for cell in map(lines_joined, guides()[name].cells) if cell["cell_type"] == "code"]


def lines_joined(cell: dict[str, Any]) -> dict[str, Any]:
    return {**cell, "source": "".join(cell["source"])}


def test_all_are_written_and_listed(tmp_path, capsys):
    out = tmp_path / "new" / "guides"
    code, said, err = run(capsys, "examples", out)
    assert (code, err) == (0, "") and f"wrote {len(NAMES) + 1} notebooks" in said
    files = {path.stem: path.read_text(encoding="utf-8") for path in out.iterdir()}
    assert set(files) == {*NAMES, BEGIN} and sum(map(len, files.values())) < MOST_BYTES
    for name, text in files.items():
        content = json.loads(text)
        assert (content["nbformat"], content["nbformat_minor"]) == (4, 5)
        first = content["cells"][0]
        assert first["cell_type"] == "markdown" and "".join(first["source"]).startswith("# ")
        assert not any(cell.get("outputs") or cell.get("execution_count") for cell in content["cells"])
        prose = "".join("".join(c["source"]) for c in content["cells"] if c["cell_type"] == "markdown")
        prose = re.sub(r"^```.*?^```", "", prose, flags=re.DOTALL | re.MULTILINE)
        for target in re.findall(r"\]\(([^)\s]+)\)", prose):
            assert target.startswith(("http", "#")) or (out / target).is_file(), f"{name}: {target}"
        assert "{download}" not in prose and "{toctree}" not in prose
    listed = re.findall(r"\((\w+)\.ipynb\)", files[BEGIN])
    assert listed == NAMES and {guide.kind for guide in guides().values()} == set(SECTIONS)


def test_they_are_valid_notebooks():
    nbformat = pytest.importorskip("nbformat")
    for guide in guides().values():
        nbformat.validate(nbformat.reads(notebook(guide.cells), as_version=4))


def test_the_code_is_that_of_the_pages():
    """Those that the tests and the site run; and nothing that an installed package does not have."""
    for name in NAMES:
        guide, code = guides()[name], code_of(name)
        page = (DOCS / guide.source).read_text(encoding="utf-8")
        assert code and not any(re.search(r"^(?:from|import) problems\b", block, re.MULTILINE) for block in code), name
        if guide.source.endswith(".md"):
            blocks = re.findall(r"^```python\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
            python = [block for block in code if not re.search(r"^[!%]|^import sys$", block)]
            assert [block.strip("\n") for block in blocks] == python
        elif guide.source.endswith(".py"):
            assert all(block in page for block in code)
    servos = [p for p in (DOCS / "examples").glob("[1-4]_*/*.py")]
    assert {f"example_{path.stem.removeprefix('plot_')}" for path in servos} <= set(NAMES)


def test_the_commands_of_the_tutorial_become_cells():
    """All of them; a file that they need is written by a cell, a picture that they draw is shown."""
    page = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    code = "\n".join(code_of("tutorial"))
    shell = "".join(re.findall(r"^```sh\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE))
    commands = re.findall(r"^casahunt (.*)", shell, re.MULTILINE)
    assert len(commands) >= 8
    assert re.findall(r'^!"\{sys\.executable\}" -m casahunt (.*)', code, re.MULTILINE) == commands
    assert code.count("%%writefile") == page.count("<<'END'") and 'Image("gains.png")' in code
    assert code.index("import sys") < code.index("sys.executable")


def test_a_wheel_has_the_texts():
    """What stands in docs/ and is read here goes along, to where it is looked for."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        along = tomllib.load(stream)["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    texts = "casahunt/views/notebooks/texts/"
    for source in [guides()[name].source for name in NAMES] + ["examples/order.txt", "howto/index.md"]:
        covers = [given for given in along if f"docs/{source}" == given or f"docs/{source}".startswith(f"{given}/")]
        assert covers and along[covers[0]] == texts + covers[0].removeprefix("docs/"), source


def test_what_somebody_has_changed_is_spared(tmp_path, capsys):
    """Run and saved by an editor, a notebook is written again; changed, or somebody's own, it is not, nor any other."""
    assert run(capsys, "examples", tmp_path, "example_loop", "example_fold")[0] == 0
    path = tmp_path / "example_loop.ipynb"
    first = path.read_bytes()
    content = json.loads(first)
    for cell in content["cells"]:
        cell["source"] = cell["source"].splitlines(keepends=True)
        if cell["cell_type"] == "code":
            cell["outputs"] = [{"output_type": "stream", "name": "stdout", "text": ["x" * 2_000_000]}]
    path.write_text(json.dumps(content, sort_keys=True), encoding="utf-8")
    assert run(capsys, "examples", tmp_path, "example_loop")[0] == 0 and path.read_bytes() == first
    content["cells"][1]["source"].append("\nprint('mine')")
    path.write_text(json.dumps(content), encoding="utf-8")
    before = contents(tmp_path)
    code, out, err = run(capsys, "examples", tmp_path)
    assert (code, out) == (2, "") and contents(tmp_path) == before
    assert "holds a example_loop.ipynb that was changed since casahunt wrote it; move it away" in err
    for foreign in ("", "{}", '{"cells": [], "metadata": {}}', "[]", "mine"):
        path.write_text(foreign, encoding="utf-8")
        code, out, err = run(capsys, "examples", tmp_path, "example_loop.ipynb")
        assert (code, out) == (2, "") and "that casahunt did not write" in err and path.read_text() == foreign
    path.unlink()
    path.mkdir()
    assert "is a folder" in run(capsys, "examples", tmp_path)[2]


@pytest.mark.parametrize("words", [("{}", "example_flod"), ("{}", "begin", "x/begin")])
def test_an_unknown_name_is_refused(tmp_path, capsys, words):
    code, out, err = run(capsys, "examples", *(word.format(tmp_path / "new") for word in words))
    assert (code, out) == (2, "") and "unknown notebook" in err and not list(tmp_path.iterdir())


def test_as_json(tmp_path, capsys):
    code, out, _ = run(capsys, "examples", tmp_path / "new", "guide_parts", "--json")
    assert code == 0 and json.loads(out) == {"guide_parts.ipynb": "A loop from parts"}
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["guide_parts.ipynb"]


def test_links_and_pictures():
    def leads(target: str) -> str:
        return "here.ipynb" if target == "here.md" else ""

    said = relinked("[a](here.md) [b\nc](gone.md) [d](https://e.org) ![f\ng](h.png) {download}`i <here.md>`", leads)
    assert said == "[a](here.ipynb) b\nc [d](https://e.org) *(On the site a picture: f g.)* [i](here.ipynb)"


def test_what_is_run_and_what_is_read():
    """Commands of other pages need files that are not there: they are read."""
    page = "# T\n\n```sh\ncasahunt fold\n```\n\n```python\nx = 1\n```\n\n```{toctree}\na\n```\n\n```\nplain\n```\n"
    kinds = [(cell["cell_type"], cell["source"]) for cell in cells_of_page(page, lambda _: "", commands=False)]
    assert kinds == [("markdown", "# T"), ("markdown", "```sh\ncasahunt fold\n```"), ("code", "x = 1"),
                     ("markdown", "```text\nplain\n```")]  # fmt: skip

def test_the_parts_of_an_example():
    """That which checks it with the checkout's problems is left out; one that begins with them, altogether."""
    example = '"""\nTitle\n=====\n\nWhy ``x``.\n"""\n\nx = 1\n\n# %%\n# Next\n# ----\n# More.\n\ny = 2\n\n# %%\n# So.\n'
    cells = cells_of_example(f"{example}\nfrom problems import a\n", lambda _: "")
    assert [(cell["cell_type"], cell["source"]) for cell in cells] == [
        ("markdown", "# Title\n\nWhy `x`."), ("code", "x = 1"), ("markdown", "## Next\nMore."), ("code", "y = 2"),
    ]  # fmt: skip
    assert cells_of_example(example.replace("x = 1", "from problems import a"), lambda _: "") == []


@pytest.mark.parametrize("name", QUICK)
def test_a_quick_one_runs(name, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    scope: dict[str, Any] = {"__name__": "notebook"}
    for block in code_of(name):
        exec(compile(block, name, "exec"), scope)  # the code is our own


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # those of the libraries that talk to the kernel
@pytest.mark.parametrize("name", [name for name in NAMES if name not in RUN_ELSEWHERE])
def test_it_runs_from_top_to_bottom(name, tmp_path, monkeypatch):
    """In a folder of its own, as it is written; examples draw, and no command of the tutorial is refused."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    needed = {"tutorial": "control", "guide_explore": "bokeh"}
    pytest.importorskip("ipykernel")
    if name in needed:
        pytest.importorskip(needed[name])
    monkeypatch.delenv("MPLBACKEND", raising=False)  # pictures go into the notebook
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    content = nbformat.reads(notebook(guides()[name].cells), as_version=4)
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(content, timeout=60 * MINUTES, kernel_name="python3", resources=where).execute()
    outputs = [output for cell in content.cells if cell.cell_type == "code" for output in cell.outputs]
    printed = "".join(output["text"] for output in outputs if output["output_type"] == "stream")
    assert not re.search(r"^casahunt [\w-]+: ", printed, re.MULTILINE), printed
    pictures = sum("image/png" in output.get("data", {}) for output in outputs)
    assert pictures >= 1 or not name.startswith("example_")
    if name == "tutorial":
        assert pictures == 2 and "verified" in printed and (tmp_path / "tuned" / "tune.html").is_file()
