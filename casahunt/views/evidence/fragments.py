"""Fragments of an HTML page that shows what is in a JSON object.

The page is self-contained: no file, script or font from elsewhere, images inlined as base64.  Every number in it stands
in an element with the attribute data-key, its path in the JSON object ("verification/loops/nominal/phase_margin").
"""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Mapping, Sequence
from typing import Any

from ...axis_units import shown
from ...checks import known_digits
from ...servo.outcome import SETTLES
from ..glossary import GLOSSARY, words_in


def value_at(record: Mapping[str, Any], key: str) -> Any:
    """The entry of a record at a path.

    key: keys and indices, separated by "/".
    """
    value: Any = record
    for part in key.split("/"):
        value = value[int(part)] if isinstance(value, list) else value[part]
    return value


STYLE = """
:root { --ink: #1c1f24; --dim: #5d6570; --line: #d9dde2; --good: #1d6b3f; --bad: #a3231f; --ground: #f6f7f8; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 1rem/1.5 system-ui, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 2rem 1.5rem 4rem; background: #fff; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .25rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .5rem; border-bottom: 1px solid var(--line); padding-bottom: .25rem; }
p { margin: .5rem 0; max-width: 46rem; }
table { border-collapse: collapse; width: 100%; margin: .5rem 0; font-size: .95rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid var(--line); }
th { font-weight: 600; color: var(--dim); }
.answer { font-size: 2.2rem; font-weight: 650; line-height: 1.2; margin: .6rem 0 0; }
.answer small { font-size: 1rem; font-weight: 400; color: var(--dim); }
[data-key] { font-variant-numeric: tabular-nums; }
.good { color: var(--good); font-weight: 600; } .bad { color: var(--bad); font-weight: 600; }
.open { color: #8a5a00; font-weight: 600; }
.dim { color: var(--dim); } figure { margin: 1rem 0; } img { max-width: 100%; height: auto; }
figcaption { color: var(--dim); font-size: .9rem; } dt { font-weight: 600; break-after: avoid; }
dd { margin: 0 0 .4rem 0; } td { overflow-wrap: break-word; }
td .good, td .bad, td .dim { white-space: nowrap; } td .said { white-space: normal; }
.pair td:first-child { width: 45%; }
@media (max-width: 640px) {
  main { padding: 1rem .9rem 2rem; } td { overflow-wrap: anywhere; } h1 { font-size: 1.35rem; }
  .rows thead { display: none; } .rows tr { display: block; border-bottom: 2px solid var(--line); padding: .4rem 0; }
  .rows td { display: block; border: 0; padding: .1rem 0; }
  .rows td[data-label]::before { content: attr(data-label) ": "; color: var(--dim); font-weight: 600; }
}
@page { margin: 16mm 14mm; }
@media print {
  :root { font-size: 11px; } body { background: #fff; } p { max-width: none; } main { max-width: none; padding: 0; }
  h1, h2 { break-after: avoid; } figure, tr, li, dd { break-inside: avoid; } p { orphans: 3; widows: 3; }
  figure img { display: block; max-height: 95mm; width: auto; } figcaption { break-before: avoid; }
  thead { display: table-header-group; }
}
"""


class Fragments:
    """Fragments of the page, with the record that their numbers come from."""

    def __init__(self, record: Mapping[str, Any]) -> None:
        self.record = record

    def n(self, key: str, form: str = ".8g", factor: float = 1.0) -> str:
        """The number at `key`, shown in the given form; a dash where there is none."""
        value = value_at(self.record, key)
        if value is None:
            return f"<span {keyed(key)}>\N{EN DASH}</span>"
        shown = format(value * factor, form).replace("-", "\N{MINUS SIGN}")
        times = f' data-factor="{factor:g}"' if factor != 1 else ""
        return f'<data {keyed(key)} data-form="{form}"{times} value="{value!r}">{shown}</data>'

    def known(self, key: str, unit: str, error: float, most: int = 8) -> str:
        """As `with_unit`, to the digits that the relative error vouches for."""
        value = value_at(self.record, key)
        return self.with_unit(key, unit, f".{known_digits(value or 0.0, error, most)}g")

    def with_unit(self, key: str, unit: str, form: str = ".8g") -> str:
        """As `n`, with the unit behind the number."""
        value = value_at(self.record, key)
        there = unit and value is not None
        label = shown().near(value or 0.0, unit)
        factor = float(shown().number(1.0, unit, label))
        label = label.replace("m2", "m\N{SUPERSCRIPT TWO}").replace("1/s", "s\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}")
        return self.n(key, form, factor) + (f"&nbsp;{label.replace(' ', '&nbsp;')}" if there else "")

    def text(self, key: str) -> str:
        """The text at `key`."""
        return f"<span {keyed(key)}>{html.escape(str(value_at(self.record, key)))}</span>"


def keyed(key: str) -> str:
    """The attribute that says where in the record a number or a text stands."""
    return f'data-key="{html.escape(key)}"'


def table(head: list[str], rows: list[list[str]]) -> str:
    """Rows of cells; on a narrow screen each cell of a wide row on a line of its own, behind its heading."""
    top = "".join(f"<th>{cell}</th>" for cell in head)
    labels = [f' data-label="{cell}"' for cell in head] or [""] * len(rows[0])
    cells = ("".join(f"<td{label}>{cell}</td>" for label, cell in zip(labels, row, strict=True)) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    kind = "pair" if len(rows[0]) == 2 and not head else "rows"
    return f"<table class={kind}>{f'<thead><tr>{top}</tr></thead>' if head else ''}<tbody>{body}</tbody></table>"


def margins(p: Fragments, at: str, form: str) -> list[str]:
    """The cells of the margins of a stable linear loop: phase, and by which factors its gain may fall and rise."""
    loop = value_at(p.record, at)
    factors = [p.n(f"{at}/{key}", form) + " times" if loop[key] else "any gain"
               for key in ("lowest_factor", "highest_factor")]  # fmt: skip
    return [p.n(f"{at}/phase_margin", form) + " degrees", *factors]


def words(name: str) -> str:
    """The name of a number as words."""
    return html.escape(shown().word(name).replace("_", " ").replace(".", ": "))


def figure(caption: str, seen: str, data: bytes) -> str:
    """A picture with its caption, and what is seen on it in words."""
    said, image = html.escape(caption), base64.b64encode(data).decode("ascii")
    source = f"data:image/png;base64,{image}"
    return f'<figure><img alt="{html.escape(seen)}" src="{source}"><figcaption>{said}</figcaption></figure>'


def meanings(page_so_far: str) -> list[str]:
    """The words of the trade on the page, explained."""
    said = words_in(html.unescape(re.sub(r"<[^>]*>", " ", page_so_far)))
    items = "".join(f"<dt>{word}</dt><dd>{html.escape(GLOSSARY[word])}</dd>" for word in said)
    return [f"<h2>What the words mean</h2><dl>{items}</dl>"] if said else []


def made_line(p: Fragments) -> str:
    """When, by what and for which servo: one line; "" for a record that does not say."""
    made = p.record.get("made")
    if made is None:
        return ""
    changed = ", ".join(p.text(f"made/set/{i}") for i in range(len(made["set"])))
    file = f"servo file {p.text('made/servo_file')}" if made["servo_file"] else "the servo built in, no servo file"
    with_changes = f" with {changed}" if changed else ""
    return f"<p class=dim>{p.text('made/date')}, casahunt {p.text('made/casahunt')}, {file}{with_changes}</p>"


def built_section(p: Fragments, checks: Mapping[str, str]) -> list[str]:
    """What answers do in the loop as built: keys of the checks in the record by names of answers."""
    rows = [[words(name), *_built(p, at)] for name, at in checks.items()]
    said = "<p>The drive of the servo file, sampled, with Switch friction, from a few starts and set points.</p>"
    head = ["", "what motions do", "dead band that ends it"]
    return ["<h2>In the loop as built</h2>", said, table(head, rows)] if rows else []


def _built(p: Fragments, at: str) -> list[str]:
    seen = value_at(p.record, at)
    if isinstance(seen, str):
        return [p.text(at), ""]
    ends = "good" if seen["kind"] in SETTLES else "bad"
    band = "" if seen["dead_band"] is None else p.with_unit(f"{at}/dead_band", "rad", ".4g")
    return [f'<span class="{ends} said">' + f"{p.text(f'{at}/sentence')}</span>", band]


def document(title: str, parts: Sequence[str]) -> str:
    """The whole page of its parts, with the words of the trade explained at its end."""
    parts = [part if "base64" in part else shown().relabelled(part) for part in parts]
    parts = [*parts, *meanings(" ".join(parts))]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"{title}<style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )
