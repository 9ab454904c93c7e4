"""The evidence of a tuning as one HTML page that shows what is in the JSON object (record.py, fragments.py).

Sentences with numbers in them are entries of the object themselves.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from typing import Any

from ...checks import known_decimals
from ...servo.outcome import SETTLES
from ...servo.units import GAIN_UNIT, unit_of
from ..answers.answer import ENDS, PLAIN_DIGITS
from ..answers.tune import BINDS, form_of, known_to, loop_name, numbers_in, unless
from .fragments import Fragments, built_section, document, figure, made_line, margins, table, value_at, words

TITLE = "<title>casahunt tune: evidence</title>"
CONTROLLER = {
    "lead_time": "lead time", "integral_time": "integral time",
    "kp": "proportional gain kp", "ki": "integral gain ki", "kd": "derivative gain kd",
}  # fmt: skip
"""Numbers of a controller in the record, and their names."""


class _Page(Fragments):
    """The evidence of a tuning, with what its numbers are known to."""

    def __init__(self, record: Mapping[str, Any]) -> None:
        super().__init__(record)
        self.tol = record.get("tol", 1e-6)
        self.fold_error = known_to(record, self.tol)
        margin = "hunting margin" in record["binding"] and not record["free"]
        self.gain_error = self.fold_error if margin else self.tol

    def verdict(self, key: str, good: str, bad: str) -> str:
        """One of two phrases."""
        ok = bool(value_at(self.record, key))
        return f'<span class="{"good" if ok else "bad"}">{good if ok else bad}</span>'


CAPTIONS = {
    "diagram": "Hunting cycles against the gain, stable solid, unstable dashed, with the recommended gain.",
    "sensitivities": "Per cent of the fold gain for one per cent more of each parameter, at the worst friction.",
    "responses": "The simulated regulator tasks.",
}


def evidence_page(record: Mapping[str, Any], images: Mapping[str, bytes]) -> str:
    """The evidence as one HTML page.

    record: of `record_of`; images: PNG files by name: any of `CAPTIONS`. Returns HTML, with the images in it.
    """
    p = _Page(record)
    figures = {name: figure(CAPTIONS[name], _seen(name, record), data) for name, data in images.items()}
    ranked = sorted(record["elasticities"].items(), key=lambda item: -abs(item[1]))
    moves = [[words(name), p.n(f"elasticities/{name}", f"+.{known_decimals(p.tol, 4)}f") + " %"] for name, _ in ranked]
    return document(TITLE, [
        *_answer(p),
        *_demands(p),
        *_fold(p),
        figures.get("diagram", ""),
        *(["<h2>What moves the fold</h2>", table(["one per cent more of", "changes the fold gain by"], moves),
           figures.get("sensitivities", "")] if moves else []),
        *_verification(p),
        *built_section(p, {"the tuned servo": "as_built"} if "as_built" in record else {}),
        "<h2>Simulated regulator tasks</h2>",
        table(["gain [V/rad]", "friction", "start", "largest torque [N m]", "voltage [V]", "what it does", "why"],
              [_task_row(p, f"verification/tasks/{i}") for i in range(len(record["verification"]["tasks"]))]),
        figures.get("responses", ""),
        "<h2>What this does not prove</h2><ul>",
        *[f"<li>{p.text(f'proves_not/{i}')}</li>" for i in range(len(record["proves_not"]))],
        "</ul><h2>The servo as given</h2>",
        table([], [[words(key), p.with_unit(f"servo/{key}", unit_of(key))] for key in record["servo"]]),
        f"<p class=dim>Computed in {p.n('wall_s', '.1f')} s, status {p.text('status')}.</p>",
    ])  # fmt: skip


def _seen(name: str, record: Mapping[str, Any]) -> str:
    """What a picture shows, with its numbers, for who does not see it."""
    gain, fold = f"{record['gain']:.4g} V/rad", f"{record['fold_gain']:.4g} V/rad"
    if name == "diagram":
        return (
            f"Amplitude and period of the hunting cycles of the {record['model']} servo against the gain. The stable "
            f"and the unstable cycle come together at {fold}, the largest gain at which the servo can hunt; the "
            f"recommended gain, {gain}, is a vertical line behind the grey margin of {100 * record['margin']:.4g} %."
        )
    if name == "sensitivities":
        ranked = sorted(record["elasticities"].items(), key=lambda item: -abs(item[1]))
        bars = ", ".join(f"{key.replace('_', ' ').replace('.', ': ')} {value:+.3g} %" for key, value in ranked if value)
        return f"Bars: change of the largest gain that hunts, {fold}, for one per cent more of each parameter: {bars}."
    after = [task for task in record["verification"]["tasks"] if task["friction"] == "nominal"]
    said = "; ".join(f"{task['start']}: {ENDS[task['verdict']].does}" for task in after)
    return f"Distance from the set point against time, at gain {gain}. {said[:1].upper()}{said[1:]}."


def _answer(p: _Page) -> list[str]:
    """The gain and whether it is to be trusted, then the whole tuning."""
    record, check, free = p.record, p.record["verification"], p.record["free"]
    above = "the servo cannot hunt at any gain."
    if record["fold_gain"]:
        above = (
            f"the gain lies {p.n('verification/margin', '.4g', 100.0)} % above the largest gain at which "
            f"the servo can hunt, {p.known('verification/fold_gain', GAIN_UNIT, p.fold_error)}"
            f"{' at the worst friction of the set' if record['worst']['corner'] else ''}."
        )
    form, friction = form_of(record), f", {p.text('model')} friction" if record["model"] else ""
    unit = html.escape(record["cost_unit"])
    colour, said = {
        "verified": ("good", "Verified"),
        "not everything verified": ("open", "Not everything is verified"),
        "speaks against it": ("bad", "The verification speaks against it"),
    }[check["result"]]
    only = ""
    if record["cost_gain_only"] is not None:
        only = f" ({p.known('cost_gain_only', unit, p.tol)} with the {form} as given)"
    return [
        f"<h1>Which gain makes this servo stop hunting?</h1><p class=dim>casahunt tune{friction}</p>",
        made_line(p),
        f"<p class=answer>{p.known('gain', '', p.gain_error, most=PLAIN_DIGITS)} <small>V/rad, the recommended gain"
        f"{html.escape(unless(record))}</small></p>",
        f'<p><span class="{colour}">{said}</span>: {above}</p>',
        *[f"<p class=bad>{p.text(f'verification/against/{i}')}</p>" for i in range(len(check["against"]))],
        *[f"<p class=open>Not verified: {p.text(f'verification/unverified/{i}')}</p>"
          for i in range(len(check["unverified"]))],
        "<h2>The answer</h2>",
        table([], [
            ["gain K", p.known("gain", GAIN_UNIT, p.gain_error)],
            *[[name, p.known(key, unit_of(key), p.tol if key in free else 0.0) + ("" if key in free else ", as given")]
              for key, name in ((key, CONTROLLER.get(key, words(key))) for key in numbers_in(record))],
            ["cost", f"{html.escape(record['cost_meaning'])}: {p.known('cost_value', unit, p.gain_error)}" + only],
            ["what keeps it from being less",
             ", ".join(words(BINDS.get(name, name)) for name in record["binding"]) or "nothing"],
        ]),
    ]  # fmt: skip


def _demands(p: _Page) -> list[str]:
    return [
        "<h2>What was asked for</h2>",
        table([], [
            ["margin above the fold", p.n("margin", ".4g", 100.0) + " %"],
            *([["largest torque, at most", p.with_unit("demands/max_torque", "N m", "g")]]
              if p.record["demands"].get("max_torque") is not None else []),
            ["delay, sample time", f"{p.n('demands/delay', 'g')} s, {p.n('demands/sample_time', 'g')} s"],
            *[[f"bounds of {words(name)}", f"{p.n(f'bounds/{name}/0', '.6g')} to "
               + p.with_unit(f"bounds/{name}/1", unit_of(name), ".6g")] for name in p.record["bounds"]],
        ]),
    ]  # fmt: skip


def _fold(p: _Page) -> list[str]:
    rows = [
        ["fold gain, nominal friction", p.known("fold/nominal", GAIN_UNIT, value_at(p.record, "fold/error") or p.tol)],
        ["its numerical error, relative", p.n("fold/error", ".1e")],
        [
            "cycle there",
            f"amplitude {p.known('fold/amplitude', 'rad', p.tol, 6)}, period {p.known('fold/period', 's', p.tol, 6)}",
        ],
    ]
    corner = p.record["worst"]["corner"]
    if corner:
        if p.record["fold"]["linear_low"] is not None:
            low, high = (p.known(f"fold/linear_{end}", "", p.tol, 6) for end in ("low", "high"))
            rows.append(["over the uncertainty set, to first order", f"{low} to {high} V/rad"])
        rows.append(["fold gain, worst friction", p.known("worst/fold_gain", GAIN_UNIT, p.fold_error)])
        rows += [[f"worst {words(name)}", p.with_unit(f"worst/corner/{name}", unit_of(name))] for name in corner]
    return ["<h2>The fold and its uncertainty</h2>", table([], rows)]


def _verification(p: _Page) -> list[str]:
    check = p.record["verification"]
    factor = p.n("demands/gain_margin", "g")
    least = f"at least {p.n('demands/phase_margin', 'g')} degrees"
    return [
        "<h2>Verified apart from the optimisation</h2>",
        table([], [
            ["fold solved again", p.verdict("verification/margin_kept", "margin kept", "margin not kept"),
             f"fold gain {p.known('verification/fold_gain', GAIN_UNIT, p.fold_error)}, "
             f"relative error {p.n('verification/fold_error', '.1e')}"],
            *([["a stable cycle", p.known("verification/stable/value", GAIN_UNIT, p.tol),
                p.text("verification/stable/sentence")]] if check["stable"] else []),
            ["event map" if p.record["model"] else "motions from rest",
             p.verdict("verification/scan_clear", "no cycle", "not clear"), p.text("verification/scan")],
            *([["folds of the set", p.n("verification/set/folds", "g") + " servos",
                "largest fold gain " + p.known("verification/set/largest_fold_gain", GAIN_UNIT, p.tol)]]
              if check["set"] else []),
            ["linear loop", p.verdict("verification/loops_kept", "margins kept", "margins not kept"),
             f"{p.n('verification/loops_checked', 'g')} servos"],
        ]),
        table(["linear loop, without dry friction", "phase margin", "stable down to", "stable up to"],
              [["asked for", least, f"{factor} times less", f"{factor} times more"], *_loop_rows(p)]),
    ]  # fmt: skip


def _loop_rows(p: _Page) -> list[list[str]]:
    """A row for each set of margins: the servos that have the same ones share it."""
    check, alike = p.record["verification"], dict[str, list[str]]()
    for name, loop in check["loops"].items():
        if name == "nominal" or p.record["worst"]["corner"] or name in check["loop_corners"]:
            alike.setdefault(json.dumps(loop, sort_keys=True), []).append(name)
    rows = [("; ".join(_loop_names(p, names)), names[0]) for names in alike.values()]
    return [[said, *margins(p, f"verification/loops/{name}", ".5g")] for said, name in rows]


def _loop_names(p: _Page, names: Sequence[str]) -> list[str]:
    """What servos are called that have the same margins; the extreme ones of the set by what is extreme, and where."""
    corners = p.record["verification"]["loop_corners"]
    said = [loop_name(name, corners) for name in names if name not in corners]
    alike = dict[str, list[str]]()
    for name in names:
        if name in corners:
            alike.setdefault(json.dumps(corners[name], sort_keys=True), []).append(name)
    for same in alike.values():
        at = ", ".join(
            f"{words(key)} {p.with_unit(f'verification/loop_corners/{same[0]}/{key}', unit_of(key), '.6g')}"
            for key in corners[same[0]]
        )
        said.append(f"least {', '.join(same)}" + (f" of the set: {at}" if at else ""))
    return said


def _task_row(p: _Page, key: str) -> list[str]:
    kind = value_at(p.record, f"{key}/verdict")
    colour = "bad" if kind in ("hunting", "growing") else "good" if kind in SETTLES else "dim"
    verdict = f'<span class="{colour} said">{ENDS[kind].does}</span>'
    shown = p.known("gain", "", p.gain_error, most=6)
    torque, voltage = (p.n(f"{key}/peak_{what}", ".3g") for what in ("torque", "voltage"))
    return [shown, p.text(f"{key}/friction"), p.text(f"{key}/start"), torque, voltage, verdict, p.text(f"{key}/reason")]
