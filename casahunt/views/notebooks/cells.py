"""A text as the cells of a notebook.

    Markdown            ```python becomes code; ```sh too, where its commands follow from the page itself; all else text
    example of the      the docstring and each comment below "# %%" are text, what follows it is code; a part that is
    gallery             checked with `problems`, which an installed package has not, is left out

Links lead to other notebooks; where there is none they are their text, and a picture its title.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

Cell = dict[str, Any]
Leads = Callable[[str], str]
"""From the target of a link to the notebook with it; "" where there is none."""

FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```\n?", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"(!?)\[([^]]*)\]\(([^)\s]+)\)")
DOWNLOAD = re.compile(r"\{download\}`([^<`]*?)\s*<([^>]*)>`")
PART = re.compile(r"^# %%\n((?:#.*\n)*)", re.MULTILINE)
HERE_DOCUMENT = re.compile(r"cat > (\S+) <<'(\w+)'\n(.*?)^\2\n", re.DOTALL | re.MULTILINE)
PICTURE_OF = re.compile(r"--plot (\S+\.png)")
FROM_CHECKOUT = re.compile(r"^(?:from|import) problems\b", re.MULTILINE)
RUN = '!"{sys.executable}" -m casahunt'
"""The command line of the interpreter that runs the notebook, whatever the shell would find."""


def text_cell(text: str) -> Cell:
    """A cell to read."""
    return {"cell_type": "markdown", "metadata": {}, "source": text.strip("\n")}


def code_cell(code: str) -> Cell:
    """A cell to run, with no output yet."""
    return {
        "cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": code.strip("\n")
    }  # fmt: skip


def cells_of_page(page: str, leads: Leads, *, commands: bool) -> list[Cell]:
    """The cells of a page in Markdown; commands: its commands are run, too."""
    cells: list[Cell] = []
    for text, language, block in _fenced(page):
        if text.strip():
            cells.append(text_cell(relinked(text, leads)))
        if language == "python":
            cells.append(code_cell(block))
        elif language == "sh" and commands and "pip install" not in block:
            cells += _command_cells(block)
        elif language and not language.startswith("{"):
            cells.append(text_cell(f"```{language}\n{block}```"))
    if any(cell["source"].startswith(RUN) for cell in cells):
        at = next(i for i, cell in enumerate(cells) if cell["cell_type"] == "code")
        cells.insert(at, code_cell("import sys"))
    return cells


def _fenced(page: str) -> Iterator[tuple[str, str, str]]:
    """The text before each fenced block, its language and what is in it; at last the text behind them."""
    at = 0
    for match in FENCE.finditer(page):
        yield page[at : match.start()], match[1].strip() or "text", match[2]
        at = match.end()
    yield page[at:], "", ""


def _command_cells(block: str) -> Iterator[Cell]:
    """Files that are written, and commands that are run, with the picture that they draw, in a notebook's words."""
    at = 0
    for match in [*HERE_DOCUMENT.finditer(block), None]:
        commands = block[at : match.start() if match else None].splitlines()
        lines = []
        for command in (line.partition("  #")[0].rstrip() for line in commands):
            lines += [command.replace("casahunt", RUN, 1)] if command.startswith("casahunt ") else []
        drawn = PICTURE_OF.findall("\n".join(lines))
        lines += ["from IPython.display import Image", f'Image("{drawn[-1]}")'] if drawn else []
        if lines:
            yield code_cell("\n".join(lines))
        if match:
            at = match.end()
            yield code_cell(f"%%writefile {match[1]}\n{match[3]}")


def cells_of_example(code: str, leads: Leads) -> list[Cell]:
    """The cells of an example of the gallery; none where it cannot run without the checkout."""
    heading, _, rest = code.removeprefix('"""').lstrip("\n").partition('"""')
    title, _, about = re.sub(r"\n=+\n", "\n", heading, count=1).partition("\n")
    cells = [text_cell(f"# {title}\n{relinked(_markdown(about), leads)}")]
    first, *parts = PART.split(rest)
    for text, part in [("", first), *zip(parts[::2], parts[1::2], strict=True)]:
        if FROM_CHECKOUT.search(part):
            continue
        if text:
            cells.append(text_cell(_markdown(re.sub(r"^# ?", "", text, flags=re.MULTILINE))))
        if part.strip():
            cells.append(code_cell(part))
    return cells if not FROM_CHECKOUT.search(first) else []


def _markdown(text: str) -> str:
    """What reStructuredText of an example says otherwise: headings and literals."""
    text = re.sub(r"^(.+)\n-{3,}$", r"## \1", text, flags=re.MULTILINE)
    return re.sub(r"``([^`]+)``", r"`\1`", text)


def relinked(text: str, leads: Leads) -> str:
    """A text whose links lead to notebooks."""

    def replaced(mark: str, words: str, target: str) -> str:
        if mark:
            return f"*(On the site a picture: {' '.join(words.split())}.)*"
        if re.match(r"https?:|#", target):
            return f"[{words}]({target})"
        notebook = leads(target)
        return f"[{words}]({notebook})" if notebook else words

    text = LINK.sub(lambda match: replaced(*match.groups()), text)
    return DOWNLOAD.sub(lambda match: replaced("", match[1], match[2]), text)
