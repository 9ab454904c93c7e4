"""What the page asks about: a servo, a gain, perhaps a load and a remedy; or a loop of parts.  No browser in here.

    address   model=switch&gain=0.1&step=1.0&friction.static=0.53&...&remedy=leak&leak=0.1
              part=one inertia&part=Switch friction&...&gain=0.1&dead_band=0.01            of a loop of parts

The address is the state: it says everything, and reading it back gives the same numbers to the last bit.  A servo with
a load or a remedy is computed as a loop of parts (`Problem.loop`), one without as the servo that it is.  What a file
has no place for stands in a line of it that other readers pass over:

    # explore: model=lugre&gain=0.2&step=1.0

The table [drive] of a file goes along (`drive.sample_time=0.001&...`), and nothing that is computed depends on it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlencode

from ...axis_units import Units
from ...checks import choice_of, number, quoted, sensible, typed
from ...design.remedies.sizes import scale_of
from ...errors import InputError
from ...servo.drive import DRIVE_KEYS, DRIVE_TABLE, DRIVE_WORDS, drive_of_table
from ...servo.friction import MODELS, Model
from ...servo.parts import LOADS, Loop, Remedy, loop_of
from ...servo.parts.fate import Swing
from ...servo.parts.file import loop_of_tables, parts_of
from ...servo.parts.table import remedies_for, with_remedy
from ...servo.servo import Servo, flatten, servo_of_tables, toml_tables, unflatten

FIRST_GAIN, FIRST_STEP_RAD = 0.1, 1.0
"""Gain [V/rad] of a servo that is asked about without one, and the step of its set point [rad]."""
GAIN, SET_POINT = "gain", "step"
MOST_FIELDS = 200
"""Entries of an address: more than any loop of parts has."""
GUESSED_AMPLITUDE, GUESSED_PERIOD = 0.1, 30.0
"""Of a cycle that is not computed yet, in units of Fs/kp and of the reset time: a remedy's first size."""
PAGE_LINE = re.compile(r"^# explore: (\S+)$", re.MULTILINE)
"""What the page has written into a file."""


class Problem(NamedTuple):
    """What is computed: the servo, or the loop where there is one; `remedy` and the loop without it."""

    servo: Servo | None
    model: Model
    gain: float
    step: float
    loop: Loop | None = None
    remedy: Remedy | None = None
    without: Loop | None = None


@dataclass(frozen=True)
class State:
    """Everything that the page shows follows from this.

    values : by the key of their control; model, remedy: of a servo, "" without a remedy; parts: entries of a loop file;
    drive: the table [drive] of a servo file.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    model: str = MODELS[0]
    remedy: str = ""
    parts: tuple[Any, ...] = ()
    drive: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_loop(self) -> bool:
        """Whether it is a loop of parts from a file."""
        return bool(self.parts)

    @cached_property
    def problem(self) -> Problem:
        """The problem.  Raises InputError: a number is out of its range, with its key first in the sentence."""
        step = sensible(SET_POINT, self.values[SET_POINT])
        gain = sensible(GAIN, self.values[GAIN])
        if self.is_loop:
            numbers = {key: value for key, value in self.values.items() if key != SET_POINT}
            return Problem(None, MODELS[0], gain, step, Loop(parts_of(self.parts), numbers, "loop"))
        model: Any = choice_of("model", self.model, MODELS)
        servo = unflatten({key: value for key, value in self.values.items() if "." in key})
        loads = {key: number(key, self.values[key]) for key in LOADS.parameters}
        if not self.remedy and not any(loads.values()):
            return Problem(servo, model, gain, step)
        loop = loop_of(servo, model, gain)
        loop = loop.with_parts(LOADS, **loads) if any(loads.values()) else loop
        if not self.remedy:
            return Problem(servo, model, gain, step, loop)
        remedy = remedy_called(self.remedy, model)
        own = {key: self.values[key] for key in own_numbers(remedy)}
        mended = with_remedy(loop, remedy, own[remedy.size]).replace(**own)
        others = {key: value for key, value in own.items() if key != remedy.size}
        if others and not remedy.instead:  # they are the remedy's at whatever size
            assert remedy.part is not None
            loop = mended.replace(**{remedy.size: remedy.part.absent})
        return Problem(servo, model, gain, step, mended, remedy, loop)

    def address(self) -> str:
        """The state as the query of an address."""
        said: list[tuple[str, str]] = [
            ("part", part if isinstance(part, str) else json.dumps(part)) for part in self.parts
        ]
        said += [] if self.is_loop else [("model", self.model)]
        said += [(key, repr(value)) for key, value in self.values.items()]
        said += [("remedy", self.remedy)] if self.remedy else []
        said += [(f"{DRIVE_TABLE}.{key}", str(value)) for key, value in self.drive.items()]
        return urlencode(said)

    def left_out(self) -> str:
        """What a file has no place for, as the query of an address."""
        said = {} if self.is_loop else {"model": self.model}
        values = {key: value for key, value in self.values.items() if key in (GAIN, SET_POINT)}
        return urlencode(said | {key: repr(value) for key, value in values.items()})

    def note(self) -> str:
        """What the page does not show of what it has been given; "" where it shows all."""
        if not self.drive:
            return ""
        return (
            f"[{DRIVE_TABLE}] of the file ({', '.join(self.drive)}) is kept in the copies, and nothing here depends on "
            "it: the page shows the continuous loop; save the file, and casahunt simulate shows the one as built."
        )

    def choose(self, what: str, choice: str) -> State:
        """The state with another choice: of the model, of the form of the controller ("times", "gains"), of a remedy.

        Raises InputError: there is no such choice, or it does not go with the rest.
        """
        choice_of("choice", what, ("model", "controller", "remedy"))
        if self.is_loop:
            raise InputError(f"{what}: must be left alone, the parts of a loop stand in its file")
        if what == "model":
            model = choice_of("model", choice, MODELS)
            kept = self if self.remedy in ("", *remedies_for(model)) else self.choose("remedy", "")
            return replace(kept, model=model)
        if what == "controller":
            return self._by(choice_of("controller", choice, ("times", "gains")))
        old = own_numbers(remedy_called(self.remedy, self.model)) if self.remedy else {}
        values = {key: value for key, value in self.values.items() if key not in old}
        if not choice:
            return replace(self, remedy="", values=values)
        remedy = remedy_called(choice, self.model)
        # A small size of a remedy, in three digits
        servo, model, gain = self.problem[:3]
        assert servo is not None
        loop = loop_of(servo, model, gain)
        amplitude = GUESSED_AMPLITUDE * servo.friction.static / servo.torque_gains(gain)[0]
        unit = scale_of(remedy, loop, Swing({}, amplitude, GUESSED_PERIOD * servo.controller.reset_time))
        first = own_numbers(remedy) | {remedy.size: float(f"{unit * remedy.first:.3g}")}
        return replace(self, remedy=choice, values=values | first)

    def _by(self, form: str) -> State:
        """The same controller by its times or by its gains.

        Raises InputError: it has complex zeros, and no times.
        """
        servo = self.problem.servo
        assert servo is not None
        if (form == "gains") == ("controller.kp" in self.values):
            return self
        rest = {key: value for key, value in self.values.items() if not key.startswith("controller.")}
        if form == "gains":
            pid = servo.controller.pid()
            numbers = {"controller.kp": pid.kp, "controller.ki": pid.ki, "controller.kd": pid.kd}
            return replace(self, values=rest | numbers)
        kp, ki, kd = (self.values[f"controller.{name}"] for name in ("kp", "ki", "kd"))
        if kp**2 < 4 * kd * ki:
            raise InputError(
                "controller: must stay by gains, its zeros are complex (kp^2 < 4 ki kd) and no times have these"
            )
        lead, integral = servo.controller.corners
        times = {"controller.lead_time": lead, "controller.integral_time": integral}
        return replace(self, values=rest | times | {GAIN: self.values[GAIN] * ki * integral})


def remedy_called(name: str, model: str) -> Remedy:
    """The remedy of a name.  Raises InputError: there is none that goes with the model."""
    there = remedies_for(model)
    return there[choice_of("remedy", name, there)]


def own_numbers(remedy: Remedy) -> dict[str, float]:
    """The numbers of a remedy that no loop without it has, with their defaults: its size first."""
    assert remedy.part is not None
    others = () if not remedy.instead else ("static", "coulomb", "stribeck_velocity", "viscous")
    return {key: value for key, value in remedy.part.parameters.items() if key not in others}


def state_of_servo(servo: Servo, model: str = MODELS[0], gain: float = FIRST_GAIN) -> State:
    """The state of a servo at a gain, without load and remedy."""
    values = {GAIN: gain, SET_POINT: FIRST_STEP_RAD, **flatten(servo), **dict.fromkeys(LOADS.parameters, 0.0)}
    return State(values, model)


def state_of_loop(entries: tuple[Any, ...], loop: Loop) -> State:
    """The state of a loop of parts whose file has these entries."""
    numbers = {name: loop.value(name) for part in loop.parts for name in part.parameters}
    if GAIN not in numbers:
        raise InputError("[loop]: must have a controller with a gain")
    return State({GAIN: numbers.pop(GAIN), SET_POINT: FIRST_STEP_RAD, **numbers}, "", "", entries)


def state_of_file(text: str, what: str = "the file", beside: State | None = None) -> State:
    """The state of a servo file or loop file.

    what: the beginning of a refusal; beside: the state whose gain, model and step it has where the file, which has no
    place for them, does not say them in its line `PAGE_LINE`.  Raises InputError: it is none of both.
    """
    tables = toml_tables(text.encode("utf-8", "replace"), what)
    if not tables:
        tables_of_both = "a servo file has [servo], [controller] and [friction], a loop file [loop] and [values]"
        raise InputError(f"{what}: holds nothing; {tables_of_both}")
    line = PAGE_LINE.search(text)
    said = dict(parse_qsl(line[1])) if line else {}
    if "loop" in tables:
        state = state_of_loop(tuple(tables["loop"]["parts"]), loop_of_tables(tables, what))
        kept = {SET_POINT: beside.values[SET_POINT]} if beside else {}
    else:
        state = state_of_servo(servo_of_tables(tables, what))
        state = replace(state, drive=tables.get(DRIVE_TABLE, {}))
        kept = {key: beside.values[key] for key in (GAIN, SET_POINT)} if beside else {}
        state = state.choose("model", said.get("model") or (beside and beside.model) or MODELS[0])
    places = (SET_POINT,) if state.is_loop else (GAIN, SET_POINT)  # a loop file says its gain
    own = {key: typed(key, said[key]) for key in places if key in said}
    return replace(state, values={**state.values, **kept, **own})


def state_of_address(query: str) -> State:
    """The state of the query of an address; what it leaves out is Table 1.

    Raises InputError: an unknown key, or what is no number.
    """
    try:
        pairs = parse_qsl(query, keep_blank_values=True, max_num_fields=MOST_FIELDS)
    except ValueError:
        raise InputError(f"address: must have at most {MOST_FIELDS} entries") from None
    parts = tuple(_part(text) for key, text in pairs if key == "part")
    said = dict(pairs)
    if parts:
        known = state_of_loop(parts, Loop(parts_of(parts)))
    else:
        known = state_of_servo(Servo()).choose("model", said.get("model", MODELS[0]))
        if any(f"controller.{name}" in said for name in ("kp", "ki", "kd")):
            known = known.choose("controller", "gains")
        known = known.choose("remedy", said.get("remedy", ""))
    # The table [drive] of an address
    texts = {key: said[f"{DRIVE_TABLE}.{key}"] for key in DRIVE_KEYS if f"{DRIVE_TABLE}.{key}" in said}
    drive = {key: text if key in DRIVE_WORDS else _number(f"{DRIVE_TABLE}.{key}", text) for key, text in texts.items()}
    if drive:
        drive_of_table(drive, Units())
    others = ("part", "model", "remedy", *(f"{DRIVE_TABLE}.{key}" for key in drive))
    given = {key: text for key, text in said.items() if key not in others}
    values = {choice_of("key", key, known.values): _number(key, text) for key, text in given.items()}
    return replace(known, values={**known.values, **values}, drive=drive)


def _number(key: str, text: str) -> float:
    """A number of an address: not yet in any range.  Raises InputError: it is none."""
    value = typed(key, text)
    if math.isnan(value):
        raise InputError(f"{key} = nan: must be a finite number")
    return value


def _part(text: str) -> Any:
    if not text.startswith("{"):
        return text
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise InputError(f"part = {quoted(text)}: must be the name of a part, or its table as JSON") from None


# Servos to begin with: the servo files and loop files of problems/, which an installed package brings along

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
