"""States of the page that tests ask about."""

from __future__ import annotations

from dataclasses import replace

from casahunt.servo.parts.table import remedies_for
from casahunt.views.explore.state import presets, state_of_file, state_of_servo
from problems import table1

LOOP = """
[loop]
parts = ["one inertia", "Switch friction", "PID by times", "integrator", "leak"]
[values]
gain = 0.04
leak = 0.1
"""
TABLE = """
[loop]
parts = ["one inertia", {part = "friction table", velocity = [0.0, 0.02, 0.05, 1.0], torque = [0.5, 0.47, 0.44, 0.54]},
         "PID by times", "integrator"]
"""


def turned(state, **values):
    """The state with other numbers; dots are written as two underscores."""
    return replace(state, values={**state.values, **{k.replace("__", "."): float(v) for k, v in values.items()}})


TABLE1 = state_of_servo(table1.servo())


def every_state():
    yield "table 1", TABLE1
    yield "by gains", TABLE1.choose("controller", "gains")
    yield "load", turned(TABLE1, load_torque=0.1, spring=-0.2)
    for model in ("switch", "lugre"):
        for name in remedies_for(model):
            yield f"{model} {name}", TABLE1.choose("model", model).choose("remedy", name)
    yield "loop", state_of_file(LOOP)
    yield "table", state_of_file(TABLE)
    yield from presets().items()


STATES = dict(every_state())
