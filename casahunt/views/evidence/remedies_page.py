"""The remedies of a servo as one HTML page that shows what is in the JSON object beside it (fragments.py)."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

from ...axis_units import quantity
from ...servo.outcome import SETTLES
from ...servo.parts.table import unit_of
from ...servo.units import GAIN_UNIT
from .fragments import Fragments, built_section, document, figure, made_line, margins, table, words

TITLE = "<title>casahunt remedies</title>"
HEAD = ("remedy", "ends hunting", "choose", "error at rest", "torque", "voltage", "settles in", "larger sizes")
CAPTIONS = {
    "sizes": "Amplitude of the hunting cycles against the size of each remedy, up to where they end; behind it marks "
    "at zero where motions were followed.",
    "rests": "Errors and torques at which the servo may stand still for ever, with the size to choose; of a remedy "
    "that does not end hunting with the last size that was looked at.",
}
MOVED_BY = ("static", "coulomb", "stribeck_velocity", "viscous", "inertia")
"""Parameters by which sizes are moved, of those in the record: friction, and what it moves."""
PROVES_NOT = (
    "The border is where the branch of cycles ends that begins at the hunting cycle of this servo; other cycles are "
    "looked for by motions alone.",
    "Those motions are samples, of starts and of sizes: they find what is there to be found, and prove no absence.",
    "Dither is an approximation, for a vibration that is fast against the motion of the servo.",
    "Flexibility, noise, backlash, sampling and delay are not in these loops.",
)


def remedies_page(record: Mapping[str, Any], images: Mapping[str, bytes]) -> str:
    """The table of remedies as one HTML page.

    record: what `remedies` has found, with the keys that commands/remedies.py adds; images: PNG files by name: any of
    `CAPTIONS`. Returns HTML, with the images in it.
    """
    p = Fragments(record)
    figures = {name: figure(CAPTIONS[name], _seen(name, record), data) for name, data in images.items()}
    ending = [i for i, row in enumerate(record["remedies"]) if row["ends_hunting"]]
    rows = [i for i, row in enumerate(p.record["remedies"]) if not row["ends_hunting"]]
    items = [f"<li>{p.text(f'remedies/{i}/name')}: {p.text(f'remedies/{i}/said')}</li>" for i in rows]
    worst = [[p.text(f"remedies/{i}/name"), _sized(p, i, "worst_size")] for i in ending if record["uncertain"]]
    moved = [i for i in ending if record["remedies"][i]["moves"]]
    names = [name for name in MOVED_BY if all(name in record["remedies"][i]["moves"] for i in moved)]
    linear = []
    for i, row in enumerate(record["remedies"]):
        if row["phase_margin"] is not None:
            phase, *factors = margins(p, f"remedies/{i}", ".4g")
            ends = ["<span class=bad>unstable</span>"] * 2 if row["lowest_factor"] is None else factors
            linear.append([p.text(f"remedies/{i}/name"), phase, *ends])
    return document(TITLE, [
        *_answer(p),
        *(["<h2>What ends it, the cheapest first</h2>", table([*HEAD], [_row(p, i) for i in ending]),
           f"<p class=dim>To choose: {p.n('margin', 'g', 100.0)} % more of the remedy than ends hunting"
           f"{' of the worst servo of the set' if record['uncertain'] else ''}; torque, voltage and settling are those "
           f"of a {p.text('task')} from rest with that size.</p>"] if ending else []),
        *(["<h2>The worst servo of the set</h2>", table(["remedy", "ends hunting"], worst)] if worst else []),
        *built_section(p, {name: f"as_built/{name}" for name in record.get("as_built", {})}),
        figures.get("sizes", ""),
        *(["<h2>What does not end it</h2><ul>", *items, "</ul>"] if items else []),
        "<h2>Where the servo may rest</h2>",
        "<p>Without a remedy the servo rests at its set point alone, with any torque that static friction holds.</p>",
        figures.get("rests", ""),
        *(["<h2>Linear loop without dry friction</h2>",
           "<p>With the size to choose. Remedies that are not here make the loop nonlinear, or have no size that ends "
           "hunting.</p>",
           table(["remedy", "phase margin", "stable down to", "stable up to"], linear)] if linear else []),
        *(["<h2>What moves the smallest size</h2>", "<p>Per cent of it for one per cent more of each.</p>",
           table(["remedy", *map(words, names)],
                 [[p.text(f"remedies/{i}/name"), *[p.n(f"remedies/{i}/moves/{name}", "+.3g") for name in names]]
                  for i in moved])] if moved and names else []),
        "<h2>What this does not prove</h2><ul>",
        *[f"<li>{html.escape(sentence)}</li>" for sentence in PROVES_NOT],
        "</ul><h2>The servo as given</h2>",
        table([], [[words(key), p.with_unit(f"servo/{key}", unit_of(key.split(".")[-1]))] for key in record["servo"]]),
        f"<p class=dim>Computed by {p.text('command')}</p>",
    ])  # fmt: skip


def _answer(p: Fragments) -> list[str]:
    """The cheapest remedy, in one sentence."""
    record = p.record
    best = next((i for i, row in enumerate(record["remedies"]) if row["name"] == record["best"]), None)
    seen = record.get("as_built", {}).get(record["best"])
    holds = " that holds in the loop as built" if isinstance(seen, Mapping) and seen["kind"] in SETTLES else ""
    fails = isinstance(seen, Mapping) and seen["kind"] not in SETTLES  # the advice says so below
    answer = "" if best is None or fails else (
        f"<p class=answer>{p.text('best')}, {_sized(p, best, 'recommended')} "
        f"<small>the cheapest remedy{holds}</small></p>"
    )
    return [
        f"<h1>What stops the hunting?</h1><p class=dim>casahunt remedies, {p.text('model')} friction</p>",
        made_line(p),
        answer,
        f"<p>{p.text('advice')}</p>",
        f"<p>Without a remedy, at gain {p.with_unit('gain', GAIN_UNIT, '.6g')}, the servo hunts with an amplitude of "
        f"{p.with_unit('amplitude', 'rad', '.4g')} and a period of {p.with_unit('period', 's', '.4g')}.</p>",
    ]


def _sized(p: Fragments, i: int, key: str) -> str:
    return p.with_unit(f"remedies/{i}/{key}", html.escape(p.record["remedies"][i]["unit"]), ".4g")


def _row(p: Fragments, i: int) -> list[str]:
    """A remedy that ends hunting."""
    at, row = f"remedies/{i}", p.record["remedies"][i]
    way = "from" if row["recommended"] > row["size"] else "up to"
    error = abs((row["size_error"] or 0.0) / row["size"]) if row["size"] else 0.0
    larger = "<span class=good>keep it ended</span>" if row["keeps_it_ended"] else p.text(f"{at}/said")
    return [
        p.text(f"{at}/name"),
        f"{way} {p.known(f'{at}/size', html.escape(row['unit']), error)} ({p.text(f'{at}/kind')})",
        _sized(p, i, "recommended"), p.with_unit(f"{at}/recommended_rest_error", "rad", ".4g"),
        p.with_unit(f"{at}/peak_torque", "N m", ".4g"), p.with_unit(f"{at}/peak_voltage", "V", ".4g"),
        p.with_unit(f"{at}/settling", "s", ".3g"), larger,
    ]  # fmt: skip


def _seen(name: str, record: Mapping[str, Any]) -> str:
    """What a picture shows, with its numbers, for who does not see it."""
    if name == "rests":
        sets = [(row["name"], max(abs(x1) for x1, _ in row["rests"])) for row in record["remedies"] if row["rests"]]
        reaches = [(row, f"within {quantity(reach, 'rad')}" if reach else "the set point") for row, reach in sets]
        said = "; ".join(f"{row}: {reach}" for row, reach in reaches)
        return f"Sets of error and torque at which the servo rests. {said}."
    rows = [row for row in record["remedies"] if row["size"] is not None]
    said = "; ".join(f"{row['name']}: {quantity(row['size'], row['unit'])}".rstrip() for row in rows)
    return f"Amplitude against size for each remedy. Cycles end at {said}."
