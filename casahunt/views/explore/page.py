"""The page as text: as the server sends it, and as a file that shows one state without a server."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from ...export import plain
from ...servo.servo import LARGEST_TOML
from .controls import choices_of, controls_of
from .copies import copies_of
from .figures import PANELS, figure_items, library
from .presets import presets
from .state import State

FOLDER = Path(__file__).parent
STATIC = {"page.js": "text/javascript", "page.css": "text/css", "bokeh.js": "text/javascript"}
"""What the page asks for besides, and nothing else is there."""


def static(name: str) -> bytes:
    """One of `STATIC`."""
    return library() if name == "bokeh.js" else (FOLDER / name).read_bytes()


def page() -> str:
    """The page."""
    scripts = "".join(f'<script src="{name}"></script>\n' for name in ("bokeh.js", "page.js"))
    return _filled('<link rel="stylesheet" href="page.css">', scripts, "null")


def frozen_page(messages: Iterable[Mapping[str, Any]]) -> str:
    """The page of what the server has said of one state, all in one file."""
    said = {"n": 0, "messages": [{**message, "n": 0} for message in messages]}
    style = f"<style>{static('page.css').decode()}</style>"
    scripts = "".join(f"<script>{_in_a_script(static(name).decode())}</script>\n" for name in ("bokeh.js", "page.js"))
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
        "copies": copies_of(state), "note": state.note(),
    }  # fmt: skip


def _filled(style: str, scripts: str, frozen: str) -> str:
    figures = "".join(
        f'<figure id="{f.name}-figure" data-stage="{f.name}"><figcaption>{escape(f.caption)}</figcaption>'
        f'<div class="plot" id="{f.name}-plot" role="img" aria-label="{escape(f.caption)}"></div>'
        '<div class="missing"></div></figure>'
        for f in PANELS
    )
    options = "".join(f'<option value="{escape(name)}">{escape(name)}</option>' for name in presets())
    return Template((FOLDER / "page.html").read_text(encoding="utf-8")).substitute(
        style=style, presets=options, figures=figures, items=figure_items(), frozen=frozen, scripts=scripts,
        largest=int(LARGEST_TOML),
    )


def _in_a_script(text: str) -> str:
    """A script that may stand inside a page: it closes no element."""
    return text.replace("</script", "<\\/script")
