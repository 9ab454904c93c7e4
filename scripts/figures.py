"""The report's eleven figures as the report has them, and two of ours: one PNG each, and captions.md.

    python scripts/figures.py [--out DIR] [--only N [N ...]] [--quick]

Report: Hensen, van de Molengraft and Steinbuch, "Friction induced limit cycling: hunting", DCT 2001.021.  What each of
its figures shows is known from a list of their subjects, axes and panels; no curve was read off its pages, and the
measured record is not public.  A caption says what agrees with the report, what goes beyond it, and what differs; every
number in it is computed in the run that draws the figure, or stands in problems/table1.py as the report's.  The PNG
carries its caption as its Description, so that a test can see which of the two is stale.

The figures themselves are in scripts/report/.  --quick draws all of them with looser tolerances.
"""

from __future__ import annotations

import argparse
import re
import sys
import textwrap
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from scripts.report import branches, cycles, regions, response, state_space  # noqa: E402
from scripts.report.study import Entry, Study  # noqa: E402

FIGURES: dict[int, Entry] = {
    entry.number: entry
    for group in (response, state_space, cycles, branches, regions)
    for entry in sorted(group.FIGURES, key=lambda entry: entry.number)
}
LAST_OF_THE_REPORT = 11
DPI = 110
"""Keeps each file small enough for a repository."""
WIDTH = 118
"""Characters in a line of captions.md."""
HEAD = """# The report's figures, redrawn

Hensen, van de Molengraft and Steinbuch, *Friction induced limit cycling: hunting*, DCT 2001.021. Written by `python
scripts/figures.py`. What each figure of the report shows is known from a list of their subjects, axes and panels; no
curve was read off its pages. *Agrees* compares with that list and with numbers that the report's text prints; *Beyond*
is ours; *Differs* is where the two do not match. Every number is computed in the run that draws the figure, except
those marked as the report's or as measured. Figures 12 and 13 are ours alone.
"""


def name_of(number: int) -> str:
    """The file of a figure."""
    return f"figure{number:02d}.png"


def section(number: int, caption: str) -> str:
    """The section of captions.md about one figure; "Agrees", "Beyond" and "Differs" begin a paragraph each."""
    entry = FIGURES[number]
    parts = re.split(r" (?=(?:Agrees|Beyond|Differs): )", caption)
    marked = [re.sub(r"^(Agrees|Beyond|Differs):", r"**\1:**", part) for part in parts]
    text = "\n\n".join(textwrap.fill(part, WIDTH, break_on_hyphens=False) for part in marked)
    ours = "" if number <= LAST_OF_THE_REPORT else " (ours)"
    return f"## Figure {number}{ours}: {entry.title}\n\n![{entry.title}]({name_of(number)})\n\n{text}\n"


def sections(path: Path) -> dict[int, str]:
    """The sections of a captions.md; none where there is no such file."""
    if not path.is_file():
        return {}
    pieces = re.split(r"^(?=## Figure \d+)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {int(re.match(r"## Figure (\d+)", piece)[1]): piece.rstrip() + "\n" for piece in pieces}  # type: ignore[index]


def write(study: Study, number: int, out: Path) -> str:
    """Draw one figure; its caption."""
    entry = FIGURES[number]
    caption = entry.caption(study)
    figure = entry.draw(study)
    figure.legends[0].set_title(f"Figure {number}: {entry.title}", prop={"size": 11})
    figure.savefig(out / name_of(number), dpi=DPI, metadata={"Description": caption})
    return caption


def main(arguments: list[str] | None = None) -> int:
    """Draw what was asked for; captions of the others are kept."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures", help="folder (default docs/figures)")
    parser.add_argument("--only", type=int, nargs="+", choices=sorted(FIGURES), metavar="N", help="figures to draw")
    parser.add_argument("--quick", action="store_true", help="looser tolerances, diagrams from near the fold")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "captions.md"
    written, study = sections(path), Study(options.quick)
    for number in sorted(options.only or FIGURES):
        began = time.perf_counter()
        written[number] = section(number, write(study, number, options.out))
        size = (options.out / name_of(number)).stat().st_size
        print(f"{options.out / name_of(number)}  {size / 1000:.0f} kB  {time.perf_counter() - began:.1f} s", flush=True)
        path.write_text("\n".join([HEAD, *(written[n] for n in sorted(written))]), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
