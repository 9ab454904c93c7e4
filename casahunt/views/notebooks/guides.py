"""Which guides there are, in the order in which they are read: begin, the gallery's examples, how to.

An installed package brings the texts along; a checkout has them in docs/.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath

from .cells import Cell, cells_of_example, cells_of_page, text_cell

FOLDERS = (Path(__file__).with_name("texts"), Path(__file__).parents[3] / "docs")
"""Of an installed package, and of a checkout."""
BEGIN = "begin"
"""The notebook that lists the others."""
READ_FIRST = ("tutorial.md", "notebooks/hunting_servo.ipynb", "notebooks/your_own_system.ipynb")
"""What is read first."""
SECTIONS = {"first": "Begin", "example": "Examples", "guide": "How to"}
"""What a guide is, and the heading above it in the list."""
WELCOME = """# casahunt: the guides as notebooks

Open one, run all of it, then change what you like. They were written by `casahunt examples`, which writes them again
where they are unchanged, and none that you have changed.
"""


@dataclass(frozen=True)
class Guide:
    """A guide: what it is (of `SECTIONS`), its title, where its text stands below docs/, and its cells."""

    kind: str
    title: str
    source: str
    cells: tuple[Cell, ...]


@cache
def guides() -> dict[str, Guide]:
    """All guides that run, by the names of their notebooks, with the list of them first."""
    texts = next(folder for folder in FOLDERS if (folder / READ_FIRST[0]).is_file())
    pages = {source: (texts / source).read_text(encoding="utf-8") for source in _sources(texts).values()}
    places = {source: name for name, source in _sources(texts).items() if _runs(_cells(source, pages[source], {}))}
    found: dict[str, Guide] = {}
    for source, name in places.items():
        cells = _cells(source, pages[source], places)
        title = "".join(cells[0]["source"]).partition("\n")[0].lstrip("# ")
        found[name] = Guide(_kind(name), title, source, tuple(cells))
    lines = [WELCOME]
    for kind, heading in SECTIONS.items():
        lines += [f"\n## {heading}\n"]
        lines += [f"* [{guide.title}]({name}.ipynb)" for name, guide in found.items() if guide.kind == kind]
    return {BEGIN: Guide("first", "The guides", "", (text_cell("\n".join(lines)),)), **found}


def _runs(cells: list[Cell]) -> bool:
    """Whether there is anything to run."""
    return any(cell["cell_type"] == "code" for cell in cells)


def _kind(name: str) -> str:
    kind = name.partition("_")[0]
    return kind if kind in SECTIONS else "first"


def _sources(texts: Path) -> dict[str, str]:
    """Where the text of each notebook stands, in their order."""
    first = {PurePosixPath(source).stem: source for source in READ_FIRST}
    order = (texts / "examples" / "order.txt").read_text(encoding="utf-8").split()
    stand = {path.name: path.relative_to(texts).as_posix() for path in sorted((texts / "examples").glob("*/*.py"))}
    examples = {f"example_{name.removeprefix('plot_').removesuffix('.py')}": stand[name] for name in order}
    listed = re.search(r"```\{toctree\}\n(.*?)```", (texts / "howto/index.md").read_text(encoding="utf-8"), re.DOTALL)
    pages = [str(_resolved("howto", f"{page}.md")) for page in (listed[1].split() if listed else ())]
    return first | examples | {f"guide_{PurePosixPath(page).stem}": page for page in pages}


def _resolved(folder: str, target: str) -> PurePosixPath:
    """A path below docs/, from one that begins in a folder of it."""
    parts: list[str] = []
    for part in (*PurePosixPath(folder).parts, *PurePosixPath(target).parts):
        parts = parts[:-1] if part == ".." else [*parts, part]
    return PurePosixPath(*parts)


def _cells(source: str, text: str, places: dict[str, str]) -> list[Cell]:
    """The cells of a text; places: the notebooks by where their texts stand."""

    def leads(target: str) -> str:
        path = _resolved(str(PurePosixPath(source).parent), target.partition("#")[0])
        if path.parts[:1] == ("auto_examples",):
            path = PurePosixPath("examples", *path.parts[1:]).with_suffix(".py")
        return f"{places[str(path)]}.ipynb" if str(path) in places else ""

    if source.endswith(".py"):
        return cells_of_example(text, leads)
    if source.endswith(".ipynb"):
        return [{key: value for key, value in cell.items() if key != "id"} for cell in json.loads(text)["cells"]]
    return cells_of_page(text, leads, commands=source == READ_FIRST[0])


