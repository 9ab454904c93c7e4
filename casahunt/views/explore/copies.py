"""A state as a command line, as Python, and as a file: each gives the numbers of the page again."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from typing import Any

from ...servo.drive import DRIVE_TABLE
from ...servo.parts import Loop
from ...servo.servo import Servo, flatten
from ...servo.units import unit_of
from .state import State

FILE_NAME = "servo.toml"


def servo_file(state: State) -> str:
    """The text of the servo file, or where the state is a loop of parts, of its file."""
    problem = state.problem
    line = f"# explore: {state.left_out()}\n"
    drive = [f"{key} = {_toml(value)}" for key, value in state.drive.items()]
    if problem.loop is not None:
        said = [f"# [{DRIVE_TABLE}], for which a loop of parts has no place: {', '.join(drive)}"] if drive else []
        parts = state.parts or tuple(part.name for part in problem.loop.parts)
        return "\n".join([*said, _loop_file(problem.loop, parts)]) + line
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
            "from casahunt import find_orbit\nfrom casahunt.servo.parts import load_loop\n\n"
            f'loop = load_loop("{FILE_NAME}").replace(gain={problem.gain!r})  # the servo file\n'
            "orbit = find_orbit(loop)\nprint(orbit)\n"
        )
    assert problem.servo is not None
    changes = ", ".join(f'"{key}": {value!r}' for key, value in _changes(problem.servo).items())
    servo = f"Servo().replace(**{{{changes}}})" if changes else "Servo()"
    return (
        "from casahunt import Servo, find_orbit\n\n"
        f'servo = {servo}\norbit = find_orbit(servo, "{problem.model}", {problem.gain!r})\nprint(orbit)\n'
    )


def copies_of(state: State) -> dict[str, str]:
    """All of them, by what the page calls them."""
    return {"command": command_line(state), "python": python(state), "file": servo_file(state)}


def _changes(servo: Servo) -> dict[str, float]:
    """What differs from Table 1; of a controller in the other form, all its numbers."""
    base = flatten(Servo())
    return {key: value for key, value in flatten(servo).items() if base.get(key) != value}


def _loop_file(loop: Loop, entries: tuple[Any, ...]) -> str:
    there = [_toml(entry) for entry in entries]
    values = [f"{name} = {loop.value(name)!r}" for part in loop.present for name in part.parameters]
    lines = ["[loop]", "parts = [", *(f"    {entry}," for entry in there), "]", "", "[values]", *dict.fromkeys(values)]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    """A value as TOML writes it: a text, a number, a list, a table in one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value) if isinstance(value, str) else repr(value)
