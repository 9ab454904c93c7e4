"""The evidence of a tuning: as one JSON object, and as one HTML page that shows what is in it.

The page is self-contained: no file, script or font from elsewhere, images inlined as base64.  Every number in it stands
in an element with the attribute data-key, its path in the JSON object ("verification/loops/nominal/phase_margin");
sentences with numbers in them are entries of the object themselves.  Keys: views/commands/tune.py.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping
from typing import Any

from ..checks import finite_or_none
from ..design.sensitivity import fold_sensitivities
from ..design.tune.check import Verification
from ..design.tune.demands import COSTS
from ..design.tune.tasks import Task, regulator_tasks
from ..design.tune.tuning import Tuning
from ..design.uncertainty.linear import linear_range
from ..servo.delayed_loop import Margins
from ..servo.servo import flatten

BEFORE = 0.5
"""Gain of the tasks before, in units of the nominal fold gain, where none is given."""
SHORTER = 1 / 6
"""Length of the tasks before, in units of those after: hunting shows sooner than rest, and costs more to follow."""
PROVES_NOT = (
    "The fold ends the symmetric hunting cycle that was found; the scan of the event map speaks against all cycles "
    "with sticking, lopsided ones too, but not against cycles without.",
    "The scan and the simulated tasks are samples: they find what is there to be found, and prove no absence.",
    "Optimum and worst friction are local; a better tuning, or a worse friction inside the set, may exist.",
    "Friction outside the set, flexibility, noise, backlash and saturation are not in the model.",
)
INSIDE = (
    "Inside of the uncertainty set the worst servo is searched for, from its corners and from samples; a worse one "
    "that is not near any of them may exist."
)
DELAY = "The delay is in the margins of the linear loop only; fold, scan and simulation are without it."


def before_tasks(tuning: Tuning, gain: float | None) -> tuple[float, tuple[Task, ...]]:
    """The simulated tasks with the controller as given, and their gain.

    Parameters
    ----------
    tuning
        the tuning.
    gain
        K used before; default: half the fold gain of the nominal friction with the times as given or tuned.
    """
    check = tuning.verification
    fold = check.nominal_fold or check.fold
    gain = gain or (BEFORE * fold.gain if fold is not None else tuning.gain / 2)
    span = SHORTER * check.span
    tasks = regulator_tasks(tuning.before, tuning.model, gain, span, check.amplitude, "nominal", decide=False)
    return gain, tuple(tasks)


def result_of(check: Verification) -> str:
    """One of "verified", "not everything verified", "speaks against it"."""
    return "speaks against it" if check.against else "not everything verified" if check.unverified else "verified"


def _loop(loop: Margins) -> dict[str, Any]:
    return {
        "crossover": loop.frequency,
        "phase_margin": loop.phase_margin,
        "lowest_factor": finite_or_none(loop.lowest_factor),
        "highest_factor": finite_or_none(loop.highest_factor),
        "stable": loop.stable,
    }


def _task(task: Task) -> dict[str, Any]:
    verdict = task.motion.verdict
    return {
        "friction": task.friction,
        "start": task.start,
        "time": float(task.motion.times[-1]),
        "verdict": verdict.kind,
        "reason": verdict.sentence,
        "status": task.motion.status.name.lower(),
    }


def record_of(tuning: Tuning, before: tuple[float, tuple[Task, ...]] | None = None) -> dict[str, Any]:
    """The JSON object of a tuning; keys in views/commands/tune.py.

    Parameters
    ----------
    tuning
        the tuning.
    before
        gain and tasks of `before_tasks`.
    """
    check, demands = tuning.verification, tuning.demands
    fold, nominal = check.fold, check.nominal_fold
    linear: tuple[float | None, float | None] = (None, None)
    if tuning.uncertainty is not None and nominal is not None:
        linear = linear_range(nominal, tuning.uncertainty)
    slopes = fold_sensitivities(fold) if fold is not None else None
    what, _, unit = COSTS[tuning.cost].rpartition(" [")
    return {
        "model": tuning.model,
        "gain": tuning.gain,
        "lead_time": tuning.servo.controller.lead_time,
        "integral_time": tuning.servo.controller.integral_time,
        "cost": tuning.cost,
        "cost_meaning": what,
        "cost_value": finite_or_none(tuning.cost_value),
        "cost_unit": unit.rstrip("]"),
        "cost_gain_only": tuning.gain_only,
        "fold_gain": tuning.fold_gain,
        "margin": demands.margin,
        "demands": {
            "phase_margin": demands.phase_margin,
            "gain_margin": demands.gain_margin,
            "delay": demands.delay,
            "sample_time": demands.sample_time,
        },
        "free": list(tuning.free),
        "bounds": {name: list(pair) for name, pair in tuning.bounds.items()},
        "worst": {"corner": tuning.corner, "fold_gain": tuning.fold_gain, "evaluations": tuning.evaluations},
        "fold": {
            "nominal": nominal.gain if nominal is not None else None,
            "error": nominal.gain_error if nominal is not None else None,
            "amplitude": nominal.orbit.amplitude if nominal is not None else None,
            "period": nominal.orbit.period if nominal is not None else None,
            "linear_low": linear[0],
            "linear_high": linear[1],
        },
        "binding": list(tuning.binding),
        "verification": {
            "ok": check.ok,
            "result": result_of(check),
            "against": list(check.against),
            "unverified": list(check.unverified),
            "fold_gain": fold.gain if fold is not None else None,
            "fold_error": fold.gain_error if fold is not None else None,
            "nominal_fold_gain": nominal.gain if nominal is not None else None,
            "margin": finite_or_none(check.margin),
            "margin_kept": check.margin_kept,
            "scan": check.scan_sentence,
            "scan_clear": check.scan_clear,
            "loops": {name: _loop(loop) for name, loop in check.loops.items()},
            "loops_kept": check.loops_kept,
            "loops_checked": check.loops_checked,
            "loop_corners": check.loop_corners,
            "set": None
            if check.set_check is None
            else {"folds": check.set_check.computed, "largest_fold_gain": check.set_check.largest},
            "tasks": [_task(task) for task in check.tasks],
        },
        "elasticities": slopes.elasticities if slopes is not None else {},
        "proves_not": [*PROVES_NOT, *([INSIDE] if tuning.corner else []), *([DELAY] if demands.lag else [])],
        "before": None
        if before is None
        else {
            "gain": before[0],
            "lead_time": tuning.before.controller.lead_time,
            "integral_time": tuning.before.controller.integral_time,
            "tasks": [_task(task) for task in before[1]],
        },
        "servo": flatten(tuning.before),
        "rounds": tuning.rounds,
        "evaluations": tuning.evaluations,
        "status": tuning.status.name.lower(),
        "wall_s": tuning.wall_s,
    }


def value_at(record: Mapping[str, Any], key: str) -> Any:
    """The entry of a record at a path; parts are separated by "/"."""
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
    """
    p = _Page(record)
    figures = {
        name: f'<figure><img alt="{html.escape(CAPTIONS[name])}" '
        f'src="data:image/png;base64,{base64.b64encode(data).decode("ascii")}">'
        f"<figcaption>{html.escape(CAPTIONS[name])}</figcaption></figure>"
        for name, data in images.items()
    }
    check = record["verification"]
    hunts, free = bool(record["fold_gain"]), record["free"]
    parts = [
        f"<h1>Which gain makes this servo stop hunting?</h1><p class=dim>casahunt tune, {p.text('model')} friction</p>",
        f"<p class=answer>{p.n('gain', '.6g')} <small>V/rad, the recommended gain</small></p>",
        f"<p>{_result(check)}: "
        + (f"the gain lies {p.n('verification/margin', '.4g', 100.0)} % above the largest gain at which "
           f"the servo can hunt, {p.n('verification/fold_gain', '.8g')} V/rad"
           f"{' at the worst friction of the set' if record['worst']['corner'] else ''}." if hunts
           else "the servo cannot hunt at any gain.") + "</p>",
        *[f"<p class=bad>{p.text(f'verification/against/{i}')}</p>" for i in range(len(check["against"]))],
        *[f"<p class=open>Not verified: {p.text(f'verification/unverified/{i}')}</p>"
          for i in range(len(check["unverified"]))],
        "<h2>The answer</h2>",
        _table([], [
            ["gain K", p.n("gain", ".10g") + " V/rad"],
            ["lead time", p.n("lead_time") + " s" + ("" if "lead_time" in free else ", as given")],
            ["integral time", p.n("integral_time") + " s" + ("" if "integral_time" in free else ", as given")],
            ["cost", f"{html.escape(record['cost_meaning'])}: {p.n('cost_value')} {html.escape(record['cost_unit'])}"
             + (f" ({p.n('cost_gain_only')} with the times as given)" if record["cost_gain_only"] is not None else "")],
            ["what keeps it from being less", ", ".join(map(_words, record["binding"])) or "nothing"],
        ]),
        "<h2>What was asked for</h2>",
        _table([], [
            ["margin above the fold", p.n("margin", ".4g", 100.0) + " %"],
            ["phase margin, at least", p.n("demands/phase_margin", "g") + " degrees"],
            ["gain margin, up and down", p.n("demands/gain_margin", "g")],
            ["delay, sample time", f"{p.n('demands/delay', 'g')} s, {p.n('demands/sample_time', 'g')} s"],
            *[[f"bounds of {_words(name)}", f"{p.n(f'bounds/{name}/0')} to {p.n(f'bounds/{name}/1')}"]
              for name in record["bounds"]],
        ]),
    ]  # fmt: skip
    parts.append("<h2>The fold and its uncertainty</h2>")
    rows = [
        ["fold gain, nominal friction", p.n("fold/nominal", ".10g") + " V/rad"],
        ["its numerical error, relative", p.n("fold/error", ".1e")],
        ["cycle there", f"amplitude {p.n('fold/amplitude', '.6g')} rad, period {p.n('fold/period', '.6g')} s"],
    ]
    if record["worst"]["corner"]:
        if record["fold"]["linear_low"] is not None:
            low, high = p.n("fold/linear_low", ".6g"), p.n("fold/linear_high", ".6g")
            rows.append(["over the uncertainty set, to first order", f"{low} to {high} V/rad"])
        rows.append(["fold gain, worst friction", p.n("worst/fold_gain", ".10g") + " V/rad"])
        rows += [[f"worst {_words(name)}", p.n(f"worst/corner/{name}")] for name in record["worst"]["corner"]]
    parts += [_table([], rows), figures.get("diagram", "")]
    if record["elasticities"]:
        parts.append("<h2>What moves the fold</h2>")
        ranked = sorted(record["elasticities"].items(), key=lambda item: -abs(item[1]))
        parts.append(
            _table(
                ["one per cent more of", "changes the fold gain by"],
                [[_words(name), p.n(f"elasticities/{name}", "+.4f") + " %"] for name, _ in ranked],
            )
        )
        parts.append(figures.get("sensitivities", ""))
    loops = [
        [
            _loop_name(p, name, check["loop_corners"]),
            p.n(f"verification/loops/{name}/phase_margin", ".5g") + " degrees",
            "without limit" if not loop["lowest_factor"] else p.n(f"verification/loops/{name}/lowest_factor", ".5g"),
            "without limit" if loop["highest_factor"] is None
            else p.n(f"verification/loops/{name}/highest_factor", ".5g"),
        ]
        for name, loop in check["loops"].items()
        if name == "nominal" or record["worst"]["corner"] or name in check["loop_corners"]
    ]  # fmt: skip
    parts += [
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
        "<h2>Simulated regulator tasks</h2>",
    ]  # fmt: skip
    head = ["gain", "friction", "start", "verdict", "why"]
    tasks = []
    if record["before"] is not None:
        tasks += [_task_row(p, f"before/tasks/{i}", "before/gain") for i in range(len(record["before"]["tasks"]))]
    tasks += [_task_row(p, f"verification/tasks/{i}", "gain") for i in range(len(check["tasks"]))]
    parts += [_table(head, tasks), figures.get("responses", "")]
    parts.append("<h2>What this does not prove</h2><ul>")
    parts += [f"<li>{p.text(f'proves_not/{i}')}</li>" for i in range(len(record["proves_not"]))]
    parts.append("</ul><h2>The servo as given</h2>")
    parts.append(_table([], [[_words(key), p.n(f"servo/{key}")] for key in record["servo"]]))
    parts.append(f"<p class=dim>Computed in {p.n('wall_s', '.1f')} s, status {p.text('status')}.</p>")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>casahunt tune: evidence</title><style>{STYLE}</style></head>\n<body><main>\n"
        + "\n".join(part for part in parts if part)
        + "\n</main></body></html>\n"
    )


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
