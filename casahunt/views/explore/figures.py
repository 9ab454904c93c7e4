"""The figures of the page, drawn by Bokeh: empty, each with a data source of a name that the page fills.

Only this module imports Bokeh, when a page is made.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ...export import extra

HEIGHT = 210
"""Of a figure, in pixels; its width is that of the page."""
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#666666"
"""Told apart by those who see few colours; the unstable branch is dashed besides."""


class Figure(NamedTuple):
    """A figure: its name, its caption, the words for who does not see it."""

    name: str
    caption: str


PANELS = (
    Figure("angle", "One period: angle from the set point"),
    Figure("velocity", "One period: velocity"),
    Figure("torque", "One period: torque of the motor"),
    Figure("phase", "Phase portrait: velocity against angle"),
    Figure("diagram", "Swing against gain: tap or drag to choose a gain"),
    Figure("position", "Step of the set point: angle"),
    Figure("effort", "Step of the set point: torque of the motor"),
    Figure("friction", "Friction torque against velocity"),
)
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


def figure_items() -> str:
    """The figures as JSON: {name: item for Bokeh.embed.embed_item}; the same for every page.

    Raises InputError: Bokeh is not installed; says how to install it.
    """
    return _items()


@cache
def _items() -> str:
    embed = extra("bokeh.embed", "explore", "explore")
    items = {figure.name: embed.json_item(_drawn(figure.name), figure.name) for figure in PANELS}
    return json.dumps(items).replace("</", "<\\/")


def library() -> bytes:
    """BokehJS.  Raises InputError: Bokeh is not installed."""
    paths = extra("bokeh.util.paths", "explore", "explore")
    return Path(paths.bokehjs_path(), "js", "bokeh.min.js").read_bytes()


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
