"""The page as text: as the server sends it, and as a file that shows one state without a server.

What there is to turn: a control for every number of a state, with its unit and the range of its slider.

logarithmic   from 1/30 to 30 times the value that the control was made with; where zero is allowed, at its left end
linear        a number between two limits, or of either sign: a factor, a load
whole         what may be typed is wider: whatever the servo itself accepts

The figures of the page, drawn by Bokeh: empty, each with a data source of a name that the page fills.

Only this module imports Bokeh, when a page is made.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterable, Mapping
from functools import cache
from html import escape
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from ...export import extra, plain
from ...servo.drive import DRIVE_TABLE
from ...servo.parts import LOADS
from ...servo.parts.part import Part
from ...servo.parts.table import unit_of as unit_of_a_part
from ...servo.servo import LARGEST_TOML, Servo, flatten, toml_value
from ...servo.units import PARAMETER_UNITS, unit_of
from .state import GAIN, SET_POINT, State, own_numbers, presets, remedy_called

FOLDER = Path(__file__).parent
STATIC = {"page.js": "text/javascript", "page.css": "text/css", "bokeh.js": "text/javascript"}
"""What the page asks for besides, and nothing else is there."""


def static(name: str) -> bytes:
    """One of `STATIC`.  Raises InputError: Bokeh is not installed."""
    if name != "bokeh.js":
        return (FOLDER / name).read_bytes()
    return Path(extra("bokeh.util.paths", "explore", "explore").bokehjs_path(), "js", "bokeh.min.js").read_bytes()


def page() -> str:
    """The page."""
    scripts = "".join(f'<script src="{name}"></script>\n' for name in ("bokeh.js", "page.js"))
    return _filled('<link rel="stylesheet" href="page.css">', scripts, "null")


def frozen_page(messages: Iterable[Mapping[str, Any]]) -> str:
    """The page of what the server has said of one state, all in one file."""
    said = {"n": 0, "messages": [{**message, "n": 0} for message in messages]}
    style = f"<style>{static('page.css').decode()}</style>"
    both = (static(name).decode().replace("</script", "<\\/script") for name in ("bokeh.js", "page.js"))
    scripts = "".join(f"<script>{text}</script>\n" for text in both)
    return _filled(style, scripts, json.dumps(said, allow_nan=False).replace("</", "<\\/"))


def state_message(state: State) -> dict[str, Any]:
    """What the page must know of a state before anything is computed.  Raises InputError: a number is out of range."""
    assert state.problem
    choices = {
        what: {**choice, "options": list(choice["options"].items())} for what, choice in choices_of(state).items()
    }
    controls = [plain(control._asdict()) for control in controls_of(state)]
    return {
        "kind": "state", "address": state.address(), "controls": controls, "choices": choices,
        "copies": {"command": command_line(state), "python": python(state), "file": servo_file(state)},
        "note": state.note(),
    }  # fmt: skip


def _filled(style: str, scripts: str, frozen: str) -> str:
    figures = "".join(
        f'<figure id="{name}-figure" data-stage="{name}"><figcaption>{escape(caption)}</figcaption>'
        f'<div class="plot" id="{name}-plot" role="img" aria-label="{escape(caption)}"></div>'
        '<div class="missing"></div></figure>'
        for name, caption in PANELS.items()
    )
    options = "".join(f'<option value="{escape(name)}">{escape(name)}</option>' for name in presets())
    # The figures as JSON: {name: item for Bokeh.embed.embed_item}; the same for every page
    return Template((FOLDER / "page.html").read_text(encoding="utf-8")).substitute(
        style=style, presets=options, figures=figures, items=_items(), frozen=frozen, scripts=scripts,
        largest=int(LARGEST_TOML),
    )


SLIDER_DECADE = 30.0
"""A logarithmic slider goes so many times up and down."""
FIRST_AT_ZERO = 1e-3
"""Where a logarithmic slider stands at zero: the middle of its range, in SI units."""
MOST_NEGATIVE_FACTOR = -1.0
"""The left end of the slider of a factor that has no least one: beyond it a reset would wind up."""
HIDDEN = ("friction.stick_band", "friction.stick_rate")
"""Of the report's regularised simulation, which the page does not show; they stay in the file and in the address."""
LUGRE_ALONE = ("friction.stiffness", "friction.damping")
GROUPS = {"gain": "Gain", "step": "Step", "controller": "Controller", "friction": "Friction", "servo": "Motor",
          "load": "Load", "remedy": "Remedy"}  # fmt: skip
ZEROS = ("controller.lead_time", "controller.kd", "friction.viscous", "friction.damping")
"""Numbers of a servo that may be zero."""
LABELS = {GAIN: "gain K", SET_POINT: "step of the set point", "load_torque": "constant torque"}


class Control(NamedTuple):
    """One number: its key, what it is called, its unit, its group, its value, and the range of its slider."""

    key: str
    label: str
    unit: str
    group: str
    value: float
    low: float
    high: float
    log: bool
    zero: bool


def controls_of(state: State) -> list[Control]:
    """The controls of a state, in order."""
    loop = state.problem.loop
    owners = dict.fromkeys(LOADS.parameters, ("Load", LOADS))
    if state.is_loop and loop is not None:
        each = [(name, part) for part in loop.parts for name in part.parameters if name != GAIN]
        owners = {name: (part.name.capitalize(), part) for name, part in each}
    elif state.remedy:
        remedy = remedy_called(state.remedy, state.model)
        assert remedy.part is not None
        owners |= dict.fromkeys(own_numbers(remedy), ("Remedy", remedy.part))
    made = [
        _ranged(key, value, *owners[key], state.values)
        if key in owners
        else _logarithmic(key, value, GROUPS[key.partition(".")[0]], _unit(key), zero=key in ZEROS)
        for key, value in state.values.items()
        if key not in HIDDEN and (key not in LUGRE_ALONE or state.model == "lugre")
    ]
    order = list(dict.fromkeys([*GROUPS.values(), *(control.group for control in made)]))
    return sorted(made, key=lambda control: order.index(control.group))


def choices_of(state: State) -> dict[str, dict[str, Any]]:
    """What can be chosen of a servo: {what: {"label", "options": {choice: label}, "chosen"}}."""
    from ...servo.parts.table import remedies_for

    if state.is_loop:
        return {}
    form = "gains" if "controller.kp" in state.values else "times"
    return {
        "model": {"label": "friction model", "options": {"switch": "Switch", "lugre": "LuGre"}, "chosen": state.model},
        "controller": {
            "label": "controller given by", "options": {"times": "its times", "gains": "its gains"}, "chosen": form,
        },
        "remedy": {
            "label": "remedy", "options": {"": "none", **{name: name for name in remedies_for(state.model)}},
            "chosen": state.remedy,
        },
    }  # fmt: skip


def _unit(key: str) -> str:
    return "rad" if key == SET_POINT else PARAMETER_UNITS[key] if key in PARAMETER_UNITS else unit_of_a_part(key)


def _label(key: str) -> str:
    return LABELS.get(key, key.rpartition(".")[2].replace("_", " "))


def _ranged(key: str, value: float, group: str, part: Part, values: Mapping[str, float]) -> Control:
    """The control of a number of a part."""
    low, high = part.ranges.get(key, (0.0, math.inf))
    unit = {"load_torque": "N m", "spring": "N m/rad"}.get(key) or _unit(key)
    if math.isinf(low) and math.isinf(high):
        size = 2 * max(abs(value), abs(values.get("friction.static", values.get("static", 1.0))))
        return Control(key, _label(key), unit, group, value, -size, size, False, False)
    if math.isfinite(high):
        low = MOST_NEGATIVE_FACTOR if math.isinf(low) else low
        return Control(key, _label(key), unit, group, value, min(low, value), high, False, False)
    return _logarithmic(key, value, group, unit, zero=low == 0)


def _logarithmic(key: str, value: float, group: str, unit: str, *, zero: bool) -> Control:
    middle = abs(value) if 0 < abs(value) < math.inf else FIRST_AT_ZERO
    low, high = (float(f"{middle * factor:.2g}") for factor in (1 / SLIDER_DECADE, SLIDER_DECADE))
    return Control(key, _label(key), unit, group, value, low, high, True, zero)


# A state as a command line, as Python, and as a file: each gives the numbers of the page again

FILE_NAME = "servo.toml"


def servo_file(state: State) -> str:
    """The text of the servo file, or where the state is a loop of parts, of its file."""
    problem = state.problem
    line = f"# explore: {state.left_out()}\n"
    drive = [f"{key} = {toml_value(value)}" for key, value in state.drive.items()]
    if problem.loop is not None:
        said = [f"# [{DRIVE_TABLE}], for which a loop of parts has no place: {', '.join(drive)}"] if drive else []
        there = [toml_value(part) for part in state.parts or [part.name for part in problem.loop.parts]]
        own = [f"{name} = {problem.loop.value(name)!r}" for part in problem.loop.present for name in part.parameters]
        lines = ["[loop]", "parts = [", *(f"    {part}," for part in there), "]", "", "[values]", *dict.fromkeys(own)]
        return "\n".join([*said, *lines, line])
    assert problem.servo is not None
    tables: dict[str, list[str]] = {"servo": [], "controller": [], "friction": []}
    for key, value in flatten(problem.servo).items():
        table, _, name = key.partition(".")
        unit = unit_of(key)
        tables[table].append(f"{name} = {value!r}" + (f"  # [{unit}]" if unit else ""))
    tables |= {DRIVE_TABLE: drive} if drive else {}
    text = "\n".join(row for name, rows in tables.items() for row in (f"[{name}]", *rows, ""))
    return f"# a servo file has no gain and no model of friction: casahunt explore reads its last line\n{text}{line}"


def command_line(state: State) -> str:
    """The command that computes the cycle."""
    problem = state.problem
    words = ["casahunt", "orbit"]
    if problem.loop is not None:
        return f"{shlex.join([*words, FILE_NAME, '--gain', repr(problem.gain)])}  # {FILE_NAME}: the servo file"
    assert problem.servo is not None
    words += ["--model", problem.model, "--gain", repr(problem.gain)]
    for key, value in _changes(problem.servo).items():
        words += ["--set", f"{key}={value!r}"]
    for key, value in state.drive.items():
        words += ["--set", f"{DRIVE_TABLE}.{key}={value}"]
    return shlex.join(words)


def python(state: State) -> str:
    """The lines of Python that compute the cycle."""
    problem = state.problem
    if problem.loop is not None:
        return (
            "from casahunt import find_orbit, load\n\n"
            f'loop = load("{FILE_NAME}").replace(gain={problem.gain!r})  # the servo file\n'
            "orbit = find_orbit(loop)\nprint(orbit)\n"
        )
    assert problem.servo is not None
    changes = ", ".join(f'"{key}": {value!r}' for key, value in _changes(problem.servo).items())
    servo = f"Servo().replace(**{{{changes}}})" if changes else "Servo()"
    return (
        "from casahunt import Servo, find_orbit\n\n"
        f'servo = {servo}\norbit = find_orbit(servo, "{problem.model}", {problem.gain!r})\nprint(orbit)\n'
    )


def _changes(servo: Servo) -> dict[str, float]:
    """What differs from Table 1; of a controller in the other form, all its numbers."""
    base = flatten(Servo())
    return {key: value for key, value in flatten(servo).items() if base.get(key) != value}


HEIGHT = 210
"""Of a figure, in pixels; its width is that of the page."""
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#666666"
"""Told apart by those who see few colours; the unstable branch is dashed besides."""


PANELS = {
    "angle": "One period: angle from the set point", "velocity": "One period: velocity",
    "torque": "One period: torque of the motor", "phase": "Phase portrait: velocity against angle",
    "diagram": "Swing against gain: tap or drag to choose a gain", "position": "Step of the set point: angle",
    "effort": "Step of the set point: torque of the motor", "friction": "Friction torque against velocity",
}  # fmt: skip
"""The figures, and what they show, in words for who does not see it."""
_LINES = {
    "angle": ("cycle", "time", "angle", "time [s]", "angle [rad]"),
    "velocity": ("cycle", "time", "velocity", "time [s]", "velocity [rad/s]"),
    "torque": ("cycle", "time", "torque", "time [s]", "torque [N m]"),
    "phase": ("cycle", "angle", "velocity", "angle [rad]", "velocity [rad/s]"),
    "position": ("motion", "time", "angle", "time [s]", "angle [rad]"),
    "effort": ("motion", "time", "torque", "time [s]", "torque [N m]"),
    "friction": ("friction", "velocity", "torque", "velocity [rad/s]", "friction [N m]"),
}
"""By figure: the source, its columns, the labels of the axes."""


@cache
def _items() -> str:
    embed = extra("bokeh.embed", "explore", "explore")
    items = {name: embed.json_item(_drawn(name), name) for name in PANELS}
    return json.dumps(items).replace("</", "<\\/")


def _drawn(name: str) -> Any:
    plotting, models = (extra(f"bokeh.{part}", "explore", "explore") for part in ("plotting", "models"))
    log = {"x_axis_type": "log", "y_axis_type": "log"} if name == "diagram" else {}
    figure = plotting.figure(
        height=HEIGHT, sizing_mode="stretch_width", tools="", toolbar_location=None, min_border_right=12, **log,
    )  # fmt: skip
    if name == "diagram":
        for branch, colour, dash in (("stable", BLUE, "solid"), ("unstable", ORANGE, "dashed")):
            source = models.ColumnDataSource({"gain": [], "amplitude": []}, name=branch)
            figure.line("gain", "amplitude", source=source, color=colour, line_dash=dash, line_width=2)
        for name_of, alpha in (("now", 1.0), ("reach", 0.0)):  # the present cycle; its gain, where there is none
            source = models.ColumnDataSource({"gain": [], "amplitude": []}, name=name_of)
            figure.scatter("gain", "amplitude", source=source, color=GREY, size=9, alpha=alpha)
        source = models.ColumnDataSource({"gain": [], "amplitude": []}, name="unfinished")
        figure.scatter("gain", "amplitude", source=source, color=ORANGE, size=9, marker="x", line_width=2)
        for at, look in (("present", {"line_width": 3}), ("border", {"line_dash": "dotted"})):
            figure.add_layout(models.Span(location=1, dimension="height", name=at, line_color=GREY, **look))
        figure.xaxis.axis_label, figure.yaxis.axis_label = "gain K [V/rad]", "swing [rad]"
    else:
        of, x, y, across, up = _LINES[name]
        source = models.ColumnDataSource({x: [], y: []}, name=of)
        figure.line(x, y, source=source, color=BLUE, line_width=2)
        figure.xaxis.axis_label, figure.yaxis.axis_label = across, up
        if name == "position":
            span = models.Span(location=1, dimension="width", name="set point", line_color=GREY, line_dash="dotted")
            figure.add_layout(span)
    figure.axis.axis_label_text_font_style = "normal"
    figure.axis.minor_tick_line_color = None
    figure.axis.major_label_policy = models.NoOverlap()  # those of a logarithm crowd at its upper end
    return figure
