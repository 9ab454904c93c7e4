"""Servo files for the tests."""

from __future__ import annotations

from casahunt import Servo
from casahunt.servo.servo import flatten


def dump(servo: Servo) -> str:
    """The servo as TOML text; `load` reads back exactly the same numbers."""
    lines: list[str] = []
    section = ""
    for key, value in flatten(servo).items():
        head, name = key.split(".")
        if head != section:
            lines += ([""] if lines else []) + [f"[{head}]"]
            section = head
        lines.append(f"{name} = {value!r}")
    return "\n".join(lines) + "\n"
