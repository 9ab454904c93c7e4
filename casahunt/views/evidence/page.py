"""The evidence of a tuning as one HTML page that shows what is in the JSON object (record.py).

The page is self-contained: no file, script or font from elsewhere, images inlined as base64.  Every number in it stands
in an element with the attribute data-key, its path in the JSON object ("verification/loops/nominal/phase_margin");
sentences with numbers in them are entries of the object themselves.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from typing import Any

CONTROLLER = {
    "lead_time": ("lead time", " s"), "integral_time": ("integral time", " s"),
    "kp": ("proportional gain kp", ""), "ki": ("integral gain ki", " 1/s"), "kd": ("derivative gain kd", " s"),
}  # fmt: skip
"""Numbers of a controller in the record: their names, and their units where the gain is in V/rad."""


def value_at(record: Mapping[str, Any], key: str) -> Any:
    """The entry of a record at a path.

    Parameters
    ----------
    record
        tables and lists within tables.
    key
        keys and indices, separated by "/".

    Returns
    -------
    The entry.
    """
    value: Any = record
    for part in key.split("/"):
        value = value[int(part)] if isinstance(value, list) else value[part]
    return value


STYLE = """
:root { --ink: #1c1f24; --dim: #5d6570; --line: #d9dde2; --good: #1d6b3f; --bad: #a3231f; --ground: #f6f7f8; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 2rem 1.5rem 4rem; background: #fff; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .25rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .5rem; border-bottom: 1px solid var(--line); padding-bottom: .25rem; }
p { margin: .5rem 0; max-width: 46rem; }
table { border-collapse: collapse; width: 100%; margin: .5rem 0; font-size: .95rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid var(--line); }
th { font-weight: 600; color: var(--dim); }
.answer { font-size: 2.2rem; font-weight: 650; margin: .6rem 0 0; }
.answer small { font-size: 1rem; font-weight: 400; color: var(--dim); }
[data-key] { font-variant-numeric: tabular-nums; }
.good { color: var(--good); font-weight: 600; } .bad { color: var(--bad); font-weight: 600; }
.open { color: #8a5a00; font-weight: 600; }
.dim { color: var(--dim); } figure { margin: 1rem 0; } img { max-width: 100%; height: auto; }
figcaption { color: var(--dim); font-size: .9rem; }
@media print { body { background: #fff; } main { padding: 0; } figure, table { break-inside: avoid; } }
"""


class _Page:
    """Fragments of the page, with the record that their numbers come from."""

    def __init__(self, record: Mapping[str, Any]) -> None:
        self.record = record

    def n(self, key: str, form: str = ".8g", factor: float = 1.0) -> str:
        """The number at `key`, shown in the given form; a dash where there is none."""
        value = value_at(self.record, key)
        if value is None:
            return f'<span data-key="{key}">\N{EN DASH}</span>'
        shown = format(value * factor, form).replace("-", "\N{MINUS SIGN}")
        times = f' data-factor="{factor:g}"' if factor != 1 else ""
        return f'<data data-key="{html.escape(key)}" data-form="{form}"{times} value="{value!r}">{shown}</data>'

    def text(self, key: str) -> str:
        """The text at `key`."""
        return f'<span data-key="{html.escape(key)}">{html.escape(str(value_at(self.record, key)))}</span>'

    def verdict(self, key: str, good: str, bad: str) -> str:
        """One of two phrases."""
        ok = bool(value_at(self.record, key))
        return f'<span class="{"good" if ok else "bad"}">{good if ok else bad}</span>'


def _table(head: list[str], rows: list[list[str]]) -> str:
    top = "".join(f"<th>{cell}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table>{f'<thead><tr>{top}</tr></thead>' if head else ''}<tbody>{body}</tbody></table>"


def _words(name: str) -> str:
    return html.escape(name.replace("_", " ").replace(".", ": "))


CAPTIONS = {
    "diagram": "Hunting cycles against the gain, stable solid, unstable dashed, with the recommended gain.",
    "sensitivities": "Per cent of the fold gain for one per cent more of each parameter, at the worst friction.",
    "responses": "The same regulator tasks simulated before and after.",
}


def page(record: Mapping[str, Any], images: Mapping[str, bytes]) -> str:
    """The evidence as one HTML page.

    Parameters
    ----------
    record
        of `record_of`.
    images
        PNG files by name: any of `CAPTIONS`.

    Returns
    -------
    HTML, with the images in it.
    """
    p = _Page(record)
    figures = {name: _figure(CAPTIONS[name], data) for name, data in images.items()}
    parts = [
        *_answer(p),
        *_demands(p),
        *_fold(p),
        figures.get("diagram", ""),
        *([*_elasticities(p), figures.get("sensitivities", "")] if record["elasticities"] else []),
        *_verification(p),
        *_tasks(p),
        figures.get("responses", ""),
        *_limits(p),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>casahunt tune: evidence</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )


def _figure(caption: str, data: bytes) -> str:
    said, image = html.escape(caption), base64.b64encode(data).decode("ascii")
    return f'<figure><img alt="{said}" src="data:image/png;base64,{image}"><figcaption>{said}</figcaption></figure>'


def _answer(p: _Page) -> list[str]:
    """The gain and whether it is to be trusted, then the whole tuning."""
    record, check, free = p.record, p.record["verification"], p.record["free"]
    above = "the servo cannot hunt at any gain."
    if record["fold_gain"]:
        above = (
            f"the gain lies {p.n('verification/margin', '.4g', 100.0)} % above the largest gain at which "
            f"the servo can hunt, {p.n('verification/fold_gain', '.8g')} V/rad"
            f"{' at the worst friction of the set' if record['worst']['corner'] else ''}."
        )
    form = "gains" if "kp" in record else "times"
    only = f" ({p.n('cost_gain_only')} with the {form} as given)" if record["cost_gain_only"] is not None else ""
    return [
        f"<h1>Which gain makes this servo stop hunting?</h1><p class=dim>casahunt tune, {p.text('model')} friction</p>",
        f"<p class=answer>{p.n('gain', '.6g')} <small>V/rad, the recommended gain</small></p>",
        f"<p>{_result(check)}: {above}</p>",
        *[f"<p class=bad>{p.text(f'verification/against/{i}')}</p>" for i in range(len(check["against"]))],
        *[f"<p class=open>Not verified: {p.text(f'verification/unverified/{i}')}</p>"
          for i in range(len(check["unverified"]))],
        "<h2>The answer</h2>",
        _table([], [
            ["gain K", p.n("gain", ".10g") + " V/rad"],
            *[[name, p.n(key) + unit + ("" if key in free else ", as given")]
              for key, (name, unit) in CONTROLLER.items() if key in record],
            ["cost", f"{html.escape(record['cost_meaning'])}: {p.n('cost_value')} {html.escape(record['cost_unit'])}"
             + only],
            ["what keeps it from being less", ", ".join(map(_words, record["binding"])) or "nothing"],
        ]),
    ]  # fmt: skip


def _demands(p: _Page) -> list[str]:
    return [
        "<h2>What was asked for</h2>",
        _table([], [
            ["margin above the fold", p.n("margin", ".4g", 100.0) + " %"],
            ["phase margin, at least", p.n("demands/phase_margin", "g") + " degrees"],
            ["gain margin, up and down", p.n("demands/gain_margin", "g")],
            ["delay, sample time", f"{p.n('demands/delay', 'g')} s, {p.n('demands/sample_time', 'g')} s"],
            *[[f"bounds of {_words(name)}", f"{p.n(f'bounds/{name}/0')} to {p.n(f'bounds/{name}/1')}"]
              for name in p.record["bounds"]],
        ]),
    ]  # fmt: skip


def _fold(p: _Page) -> list[str]:
    rows = [
        ["fold gain, nominal friction", p.n("fold/nominal", ".10g") + " V/rad"],
        ["its numerical error, relative", p.n("fold/error", ".1e")],
        ["cycle there", f"amplitude {p.n('fold/amplitude', '.6g')} rad, period {p.n('fold/period', '.6g')} s"],
    ]
    corner = p.record["worst"]["corner"]
    if corner:
        if p.record["fold"]["linear_low"] is not None:
            low, high = p.n("fold/linear_low", ".6g"), p.n("fold/linear_high", ".6g")
            rows.append(["over the uncertainty set, to first order", f"{low} to {high} V/rad"])
        rows.append(["fold gain, worst friction", p.n("worst/fold_gain", ".10g") + " V/rad"])
        rows += [[f"worst {_words(name)}", p.n(f"worst/corner/{name}")] for name in corner]
    return ["<h2>The fold and its uncertainty</h2>", _table([], rows)]


def _elasticities(p: _Page) -> list[str]:
    ranked = sorted(p.record["elasticities"].items(), key=lambda item: -abs(item[1]))
    rows = [[_words(name), p.n(f"elasticities/{name}", "+.4f") + " %"] for name, _ in ranked]
    return ["<h2>What moves the fold</h2>", _table(["one per cent more of", "changes the fold gain by"], rows)]


def _verification(p: _Page) -> list[str]:
    record, check = p.record, p.record["verification"]
    loops = [
        _loop_row(p, name, loop)
        for name, loop in check["loops"].items()
        if name == "nominal" or record["worst"]["corner"] or name in check["loop_corners"]
    ]
    return [
        "<h2>Verified apart from the optimisation</h2>",
        _table([], [
            ["fold solved again", p.verdict("verification/margin_kept", "margin kept", "margin not kept"),
             f"fold gain {p.n('verification/fold_gain', '.10g')}, "
             f"relative error {p.n('verification/fold_error', '.1e')}"],
            ["event map", p.verdict("verification/scan_clear", "no cycle", "not clear"), p.text("verification/scan")],
            *([["folds of the set", p.n("verification/set/folds", "g") + " servos",
                f"largest fold gain {p.n('verification/set/largest_fold_gain', '.10g')}"]] if check["set"] else []),
            ["linear loop", p.verdict("verification/loops_kept", "margins kept", "margins not kept"),
             f"{p.n('verification/loops_checked', 'g')} servos"],
        ]),
        _table(["linear loop", "phase margin", "gain may fall to", "gain may rise to"], loops),
    ]  # fmt: skip


def _loop_row(p: _Page, name: str, loop: Mapping[str, Any]) -> list[str]:
    at, free = f"verification/loops/{name}", "without limit"
    return [
        _loop_name(p, name, p.record["verification"]["loop_corners"]),
        p.n(f"{at}/phase_margin", ".5g") + " degrees",
        free if not loop["lowest_factor"] else p.n(f"{at}/lowest_factor", ".5g"),
        free if loop["highest_factor"] is None else p.n(f"{at}/highest_factor", ".5g"),
    ]


def _tasks(p: _Page) -> list[str]:
    rows = []
    if p.record["before"] is not None:
        rows += [_task_row(p, f"before/tasks/{i}", "before/gain") for i in range(len(p.record["before"]["tasks"]))]
    rows += [_task_row(p, f"verification/tasks/{i}", "gain") for i in range(len(p.record["verification"]["tasks"]))]
    return ["<h2>Simulated regulator tasks</h2>", _table(["gain", "friction", "start", "verdict", "why"], rows)]


def _limits(p: _Page) -> list[str]:
    """What the evidence does not prove, and the servo it is about."""
    return [
        "<h2>What this does not prove</h2><ul>",
        *[f"<li>{p.text(f'proves_not/{i}')}</li>" for i in range(len(p.record["proves_not"]))],
        "</ul><h2>The servo as given</h2>",
        _table([], [[_words(key), p.n(f"servo/{key}")] for key in p.record["servo"]]),
        f"<p class=dim>Computed in {p.n('wall_s', '.1f')} s, status {p.text('status')}.</p>",
    ]


def _result(check: Mapping[str, Any]) -> str:
    colour, said = {
        "verified": ("good", "Verified"),
        "not everything verified": ("open", "Not everything is verified"),
        "speaks against it": ("bad", "The verification speaks against it"),
    }[check["result"]]
    return f'<span class="{colour}">{said}</span>'


def _loop_name(p: _Page, name: str, corners: Mapping[str, Any]) -> str:
    if name not in corners:
        return {"worst": "worst friction"}.get(name, name)
    at = ", ".join(f"{_words(key)} {p.n(f'verification/loop_corners/{name}/{key}', '.6g')}" for key in corners[name])
    return f"least {name}" + (f" of the set: {at}" if at else "")


def _task_row(p: _Page, key: str, gain: str) -> list[str]:
    hunts = value_at(p.record, f"{key}/verdict") in ("hunting", "growing")
    colour = "bad" if hunts else "good" if value_at(p.record, f"{key}/verdict") in ("at rest", "decaying") else "dim"
    verdict = f'<span class="{colour}">{p.text(f"{key}/verdict")}</span>'
    return [p.n(gain, ".6g"), p.text(f"{key}/friction"), p.text(f"{key}/start"), verdict, p.text(f"{key}/reason")]
