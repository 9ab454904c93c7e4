"""Servos to begin with: the servo files and loop files of problems/, which an installed package brings along."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

from ...errors import InputError
from .state import GAIN, State, state_of_file

FOLDERS = (Path(__file__).with_name("servos"), Path(__file__).parents[3] / "problems")
"""Of an installed package, and of a checkout."""
PRESET_GAINS = {"canudas": 1.0}
"""Gains to begin with [V/rad], where the first one of the page is none for it."""


@cache
def presets() -> dict[str, State]:
    """The states of the files, by the names of these."""
    paths = {path.stem: path for folder in FOLDERS for path in sorted(folder.glob("*.toml"))}
    found = {}
    for name, path in sorted(paths.items()):
        try:
            state = state_of_file(path.read_text(encoding="utf-8"), name)
        except InputError:  # an uncertainty, or another file that is no servo
            continue
        gain = PRESET_GAINS.get(name, state.values[GAIN])
        found[name] = replace(state, values={**state.values, GAIN: gain})
    return found
