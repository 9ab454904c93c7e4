"""The way from records to a remedy as one HTML page that shows what is in the JSON object beside it (fragments.py)."""

from __future__ import annotations

import html
from collections.abc import Mapping
from typing import Any

from ...servo.outcome import SETTLES
from ...servo.units import GAIN_UNIT, unit_of
from .fragments import Fragments, document, figure, made_line, table, words

TITLE = "<title>casahunt cure</title>"


def cure_page(record: Mapping[str, Any], images: Mapping[str, bytes]) -> str:
    """Records, servo, fold and remedies as one HTML page.

    record: what the command gives, without objects; images: PNG files by name, "fit". Returns HTML.
    """
    p = Fragments(record)
    rows = record["remedies"]["remedies"]
    ending = [i for i, row in enumerate(rows) if row["stays"] and row["stays"][0] in SETTLES]  # as Cure.ends_hunting
    explained = record["identified"]["explained"]
    verdict = f"the model {'explains' if explained else 'does not explain'} the records"
    return document(TITLE, [
        "<h1>What stops the hunting?</h1><p class=dim>casahunt cure, from records</p>", made_line(p),
        f"<p><strong>{p.text('advice')}</strong></p>",
        f"<p class=bad>{p.text('doubt')}</p>" if record["doubt"] else "",
        "<h2>What the records tell</h2>",
        table(["parameter", "value", "95 % from", "to"],
              [[words(name), *[p.with_unit(f"identified/parameters/{name}/{key}", html.escape(unit_of(name)), ".4g")
                               for key in ("value", "low", "high")]] for name in record["identified"]["parameters"]]),
        f"<p><span class={'good' if explained else 'bad'}>{verdict}</span>: beside noise "
        f"{p.n('identified/systematic', '.2g')} of the amplitude is left.</p>",
        f"<p class=bad>{p.text('suspect')}</p>" if record["suspect"] else "",
        *[figure("The records, laid over the period of the fitted cycle, and what is left of them.", verdict, data)
          for data in images.values()],
        "" if record["bounded"] else
        "<p class=bad>The records do not bound every parameter: the worst servo is one between a tenth and ten times "
        "of the values found.</p>",
        "<h2>Where hunting ends if the gain is raised</h2>",
        f"<p>Up to gain {p.with_unit('fold/gain', GAIN_UNIT, '.4g')} with these values, and up to "
        f"{p.with_unit('fold/worst', GAIN_UNIT, '.4g')} with the worst that the records allow. "
        f"{p.text('fold/refused')}</p>",
        *([f"<h2>What ends it at gain {p.with_unit('gain', GAIN_UNIT, '.6g')}, the cheapest first</h2>",
           table(["remedy", "ends hunting", "of the worst servo", "choose", "error at rest", "torque", "as built"],
                 [_row(p, i) for i in ending])] if ending else ["<p>No remedy was found.</p>"]),
        "<p>Where the worst servo has no size, the size to choose is for the values as found: it may be too little.</p>"
        if any(rows[i]["worst_size"] is None for i in ending) else "",
        "<p>Each step is a command: <code>casahunt identify</code>, <code>casahunt fold</code>, "
        "<code>casahunt remedies servo.toml --uncertainty friction.toml</code>, which has the margins, larger sizes "
        "and pictures. The files <a href='servo.toml'>servo.toml</a> and <a href='friction.toml'>friction.toml</a> are "
        "beside this page; all numbers are in <a href='cure.json'>cure.json</a>.</p>",
    ])  # fmt: skip


def _row(p: Fragments, i: int) -> list[str]:
    """A remedy that ends hunting."""
    at, row = f"remedies/remedies/{i}", p.record["remedies"]["remedies"][i]
    unit, keys = html.escape(row["unit"]), ("size", "worst_size", "recommended")
    sizes = [p.with_unit(f"{at}/{key}", unit, ".4g") for key in keys]
    built = p.record["as_built"].get(row["name"], "")
    said = html.escape(built if isinstance(built, str) else built["sentence"])
    prices = [p.with_unit(f"{at}/{key}", unit, ".4g") for key, unit in (("recommended_rest_error", "rad"),
                                                                        ("peak_torque", "N m"))]  # fmt: skip
    return [p.text(f"{at}/name"), *sizes, *prices, said or "not described"]
