"""The arguments of the commands: what they share, and what they ask, read and checked before anything is computed.

What is wrong is refused in one sentence (errors.InputError).
"""

from __future__ import annotations

import argparse
import math
import shutil
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ...axis_units import UNITS_TABLE, show_in, shown, units_of_table
from ...checks import choice_of, quoted, sensible, shortened, typed
from ...errors import InputError
from ...orbits import Options
from ...quantities import with_its_unit
from ...servo.controller import Pid
from ...servo.drive import DRIVE_KEYS, DRIVE_TABLE, DRIVE_WORDS, Drive, drive_of_table, drive_value
from ...servo.friction import MODELS, Model
from ...servo.servo import LOOP_TABLE, Servo, check_bristle, read_toml, servo_of_tables, with_overrides
from ...servo.units import GAIN_UNIT, assigned, check_motor_gain, numbers_of
from .output import LINE_WIDTH, meanings, wrapped
from .output_paths import Signs
from .progress import say
from .taken import of_the_continuous_loop, servo_of_parts, taken_from_table_1

if TYPE_CHECKING:
    from ...design.uncertainty.set import Uncertainty
    from ...servo.parts import Loop

OF_DRIVE = f"{DRIVE_TABLE}."
"""Keys of --set that are of the drive begin so."""
_ARGPARSE_WORDS = {
    "expected one argument": "must be followed by a value",
    "ignored explicit argument": "takes no value, but was given",
}
_MISSING = "the following arguments are required: "


class _Help(argparse.HelpFormatter):
    """Help that fits 80 columns, and a narrower terminal."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        keywords["width"] = min(LINE_WIDTH, shutil.get_terminal_size().columns) - 2
        super().__init__(*arguments, **keywords)

    def add_argument(self, action: argparse.Action) -> None:
        """Give the names of commands room for their deeper indentation, which argparse forgets."""
        super().add_argument(action)
        if isinstance(action, argparse._SubParsersAction):
            self._action_max_length += self._indent_increment


class _Once(argparse.Action):
    """The servo file, which stands alone or behind its option, once."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        if getattr(namespace, self.dest, None) is not None:
            raise InputError(f"servo = {values}: must be left out, one servo file is enough")
        setattr(namespace, self.dest, values)


class Parser(argparse.ArgumentParser):
    """Argument errors in the form of all other input errors; required options under a heading of their own."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **{"formatter_class": _Help, "allow_abbrev": False, **keywords})
        self._required: Any = None
        self._examples: dict[str, str] = {}

    def add_required(self, name: str, *, example: str, **keywords: Any) -> None:
        """Add an option that must be given.

        example: how it is given, for who leaves it out; **keywords: of `add_argument`.
        """
        if self._required is None:
            self._required = self.add_argument_group("required")
            self._action_groups.insert(1, self._action_groups.pop())  # above what may be left out
        self._required.add_argument(name, required=True, **keywords)
        self._examples[name] = f"{name} {example}"

    def options_of(self, command: str) -> list[str]:
        """The names of the options of a command."""
        found = next(action for action in self._actions if isinstance(action, argparse._SubParsersAction))
        return list(found.choices[command]._option_string_actions)

    def format_help(self) -> str:
        """The help, with the words of the trade explained below it."""
        text = super().format_help()
        below = [part for line in meanings(text.splitlines()) for part in wrapped(line)]
        return text + ("\n" + "\n".join(below) + "\n" if below else "")

    def error(self, message: str) -> Any:
        """Refuse with argparse's message in our words.

        Raises InputError: always.
        """
        text = message.removeprefix("argument ")
        for theirs, ours in _ARGPARSE_WORDS.items():
            text = text.replace(theirs, ours)
        if text.startswith(_MISSING):
            names = text.removeprefix(_MISSING).split(", ")
            example = " ".join(self._examples[name] for name in names if name in self._examples)
            text = f"{', '.join(name.lstrip('-') for name in names)}: must be given"
            text += f", for example {example}" if example else ""
        raise InputError(f"{text} (see {self.prog} --help)")


def add_command(
    commands: Any, name: str, about: str, *, file: str = "", gain: bool = False, tol: bool = True,
    model: str | None = None, csv: str = "", plot: str = "", records: str = "",
) -> Parser:  # fmt: skip
    """A command with the arguments that it shares with others, which its module goes on with.

    about: one line of help; file: what it reads, "" where it reads none; records: as `file`, of several, behind which
    no servo file can stand without its option; gain: it has one; tol: it computes to a tolerance;
    model: it has one, and what for ("": for everything); csv, plot: what its table holds and
    its picture shows, "" where it has none.
    """
    command: Parser = commands.add_parser(name, help=about)
    if gain:
        add_gain(command)
    if file:
        command.add_argument("file", metavar="F.csv", help=file)
    low, high = Options.TOLERANCES
    if records:
        command.add_argument("records", nargs="+", metavar="F.csv", help=records)
    file_of: dict[str, Any] = {"metavar": "SERVO.toml", "help": "servo file; default: Table 1 of the report"}
    if not records:
        command.add_argument("servo_file", nargs="?", action=_Once, **file_of | {"default": argparse.SUPPRESS})
        file_of["help"] = "the same, as an option"
    command.add_argument("--servo", dest="servo_file", action=_Once, **file_of)
    if tol:
        command.add_argument("--tol", default=1e-6, help=f"relative tolerance, {low:g} to {high:g} (default 1e-6)")
    command.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="override a value, e.g. friction.static=0.5"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    command.add_argument("--quiet", action="store_true", help="no progress on standard error")
    command.add_argument("--details", action="store_true", help="the mathematics too, and every digit that is known")
    if model is not None:
        command.add_argument("--model", help=f"switch (default) or lugre{model}")
    if csv:
        command.add_argument("--csv", metavar="F.csv", help=f"write {csv}, with all digits")
    if plot:
        command.add_argument("--plot", metavar="F.png", help=f"write a picture of {plot}")
    return command


def add_vary(command: Parser, what: str) -> None:
    """The parameter of a loop.

    what: what it is for.
    """
    command.add_argument("--vary", metavar="NAME", help=f"the parameter {what}, of a loop of parts (default gain)")


def add_models(command: Parser) -> None:
    """The choice of one friction model, or of both."""
    command.add_argument("--model", action="append", help="switch or lugre; repeat for both (default both)")


def add_solver(command: argparse.ArgumentParser) -> None:
    """The choice of the solver."""
    command.add_argument(
        "--solver", default="auto",
        help="auto (default: Newton, and IPOPT where a start is far off), or ipopt or newton: that one alone makes "
        "every solve; ipopt takes 2 to 4 times as long, down the unstable LuGre branch 10 times",
    )  # fmt: skip


def finite(key: str, text: Any, *units: str) -> float:
    """A finite number.

    key, text: what the user calls it, and what was given; units: that it may have, in SI, of a rotary axis.
    Raises InputError: it is none, or has a unit of another kind.
    """
    value = shown().read(key, text, *units) if any(units) and with_its_unit(text) else typed(key, text)
    if not math.isfinite(value):
        raise InputError(f"{key} = {shortened(str(text))}: must be a finite number, not NaN or infinity")
    return value


def count_of(key: str, text: Any, least: int, most: float = math.inf) -> int:
    """A whole number within limits.

    key, text: what the user calls it, and what was given. Raises InputError: it is none, or beyond them.
    """
    value = None
    with suppress(InputError, ValueError, OverflowError):
        x = typed(key, text)
        value = int(text) if str(text).isdecimal() else int(x) if x == int(x) else None
    if value is None or not least <= value <= most:
        limits = f" from {least} to {most:g}" if math.isfinite(most) else f", at least {least}"
        raise InputError(f"{key} = {quoted(text)}: must be a whole number{limits}")
    return value


def positive(key: str, text: Any, *units: str) -> float:
    """A gain, a time or a position.

    key, text, units: as of `finite`. Raises InputError: it is none in the range of `checks`.
    """
    return sensible(key, finite(key, text, *units))


def add_gain(command: Parser, example: str = "0.1", **keywords: Any) -> None:
    """The gain of a command that must have one; example: how it is given, for who leaves it out."""
    help_text = "controller gain in V/rad; it multiplies kp, ki and kd of the servo file, which stand as they are "
    command.add_argument("--gain", **{"metavar": "K", "help": f"{help_text}without it"} | keywords)
    command.set_defaults(example_of_gain=example)


def add_out(command: Parser, results: Callable[[Asked], Signs], **keywords: Any) -> None:
    """The folder of a command that writes several files.

    results: from the parsed command line to what is written there; **keywords: of `add_argument`.
    """
    command.add_argument("--out", **{"metavar": "DIR"} | keywords)
    command.set_defaults(results=results)


class Asked(argparse.Namespace):
    """What a command is asked: its options as they were given, and what they say, read and checked when it is wanted.

    outputs: what it leaves beside its printed result.
    """

    outputs: Any
    told = continuous = False
    """Whether it has been said what is taken from elsewhere, and what is left out of the drive."""

    @cached_property
    def read(self) -> dict[str, Any] | InputError:
        """The tables of the servo file, or what is wrong with it; read once: it may be a pipe."""
        what = f"servo file {self.servo_file!r}"
        try:
            tables = read_toml(self.servo_file, what)
        except InputError as error:
            return error
        try:
            show_in(units_of_table(tables.get(UNITS_TABLE, {})))
        except InputError as error:
            return InputError(f"{what}: {error}")
        return tables

    def tables(self) -> dict[str, Any]:
        """The tables of the servo file, {} without one.  Numbers are shown in its units from then on.

        Raises InputError: it cannot be read, or its units are wrong.
        """
        if self.servo_file is None:
            return {}
        if isinstance(self.read, InputError):
            raise self.read
        return self.read

    def show(self) -> None:
        """Show numbers, and take them with their units, as the servo file says.

        What is wrong with it is told where the command reads it.
        """
        if getattr(self, "servo_file", None) is not None:
            with suppress(InputError):
                self.tables()
        for key in ("vary", "fold_in"):
            if isinstance(named := getattr(self, key, None), str):
                setattr(self, key, shown().own_name(named))

    def tell_once(self, sentences: Iterable[str]) -> None:
        """Say what of a servo file is not as it may seem, the first time that it is made into something."""
        if not self.told:
            self.told = True
            for sentence in sentences:
                say(sentence)

    def subject(self, *, gain: bool = False) -> Any:
        """What it is asked about, as the verbs take it: a servo and its model, or a loop and None.

        gain: that of the servo too, of a loop None.
        """
        asked: Any = (self.loop(), None, None)
        if asked[0] is None:
            model = self.friction_model()
            asked = self.servo(), model, self.at_gain() if gain else None
        return asked if gain else asked[:2]

    def servo(self) -> Servo:
        """The servo: file or Table 1, with the overrides."""
        of_servo = [text for text in self.set if not text.strip().startswith(OF_DRIVE)]
        if self.servo_file is None:
            return with_overrides(Servo(), of_servo)
        tables, what = self.tables(), f"servo file {self.servo_file!r}"
        if loop := self.loop():
            return servo_of_parts(what, loop)
        servo = with_overrides(servo_of_tables(tables, what), of_servo)
        taken = taken_from_table_1(servo, tables, of_servo, sought=hasattr(self, "sought"))
        self.tell_once([*taken, *of_the_continuous_loop(self.command, tables)])
        return servo

    def loop(self, gain: float | None = None) -> Loop | None:
        """The loop of parts: file, overrides and gain; None where there is no such file.

        Raises InputError: the file or an override is wrong, or a friction model is asked for, which is one of its
        parts.
        """
        tables = self.tables()
        if LOOP_TABLE not in tables:
            return None
        from ...servo.parts.file import loop_of_tables

        if hasattr(self, "model"):
            self.leave_out("the friction of a loop is one of its parts", "model")
        loop = loop_of_tables(tables, f"loop file {self.servo_file!r}")
        given = [text for text in self.set if not text.strip().startswith(OF_DRIVE)]
        texts = assigned(given, "parameter", [n for part in loop.parts for n in part.parameters], "name=value")
        if "gain" in texts and getattr(self, "gain", None) is not None:
            raise InputError("--gain and --set gain=: both give the gain; leave one of them out")
        if gain is None and not isinstance(getattr(self, "gain", None), list | None):  # of records there is a list
            gain = self.at_gain()
        loop = loop.replace(**numbers_of(texts, loop.units) | ({} if gain is None else {"gain": gain}))
        check_motor_gain(texts, loop.parameters.get("motor_gain", 1.0))
        self.tell_once(of_the_continuous_loop(self.command, tables))
        return loop

    def drive(self, *, by_options: bool = False) -> Drive | None:
        """The drive: [drive] of the file and overrides; None without any, or with a sample time of 0.

        by_options: also by the options that are called like its keys. Raises InputError: one is wrong.
        """
        table = self.tables().get(DRIVE_TABLE, {})
        given: dict[str, Any] = {}
        for text in self.set:
            key, _, value = text.strip().partition("=")
            if key.startswith(OF_DRIVE):
                own = shown().own_name(key.strip())
                name = choice_of("key", own, [f"{OF_DRIVE}{name}" for name in DRIVE_KEYS])
                given[name.removeprefix(OF_DRIVE)] = value.strip()
        given |= {key: value for key in DRIVE_KEYS if by_options and (value := getattr(self, key)) is not None}
        read = {key: drive_value(key, value, shown()) for key, value in given.items()}
        numbers = {
            key: value if key in DRIVE_WORDS else finite(f"{OF_DRIVE}{key}", value) for key, value in read.items()
        }
        if numbers.get("sample_time") == 0:
            dropped = ", ".join(f"{OF_DRIVE}{key}" for key in {**table, **numbers} if key != "sample_time")
            if dropped and not self.continuous:
                say(f"the loop is taken as a continuous one: {dropped} left out")
            self.continuous = True
            return None
        stated = {key: given[key] if with_its_unit(given[key]) else value for key, value in numbers.items()}
        return drive_of_table(table, shown(), **stated) if table or stated else None

    def uncertainty_of(self, servo: Servo | Loop) -> Uncertainty | None:
        """What is uncertain by the file of the command line, a part of it that is no servo said; None without one."""
        if self.uncertainty is None:
            return None
        from ...design.uncertainty.set import load_uncertainty, part_without_servos

        uncertainty = load_uncertainty(self.uncertainty, servo)
        if said := part_without_servos(servo, uncertainty):
            say(said)
        return uncertainty

    def friction_model(self) -> Model:
        """The one friction model of a servo."""
        model = choice_of("model", getattr(self, "model", None) or MODELS[0], MODELS)
        return self._with_its_bristle(model)[0]

    def friction_models(self) -> list[Any]:
        """Those of a command that may have several: each once, all where none is named; [None] of a loop.

        Raises InputError: an unknown model, or one that is named twice.
        """
        models = [choice_of("model", model, MODELS) for model in self.model or MODELS]
        if len(set(models)) != len(models):
            raise InputError(f"model = {', '.join(models)}: each model can be asked for once")
        return [None] if self.loop() else self._with_its_bristle(*models)

    def _with_its_bristle(self, *models: Any) -> list[Any]:
        if "lugre" in models:
            check_bristle(self.tables(), self.set)
        return [*models]

    def how(self) -> Options:
        """The tolerance, and the solver where there is a choice."""
        solver: Any = choice_of("solver", getattr(self, "solver", "auto"), Options.SOLVERS)
        return Options(tol=finite("tol", self.tol), solver=solver)

    def at_gain(self) -> float:
        """The one gain of a command that must have one [V/rad]: what is given, or what the file states."""
        return self.stated_gain() if self.gain is None else positive("gain", self.gain, GAIN_UNIT)

    def stated_gain(self) -> float:
        """The gain [V/rad] of a loop of parts, or of a file with kp, ki and kd.  Raises InputError: it is left open."""
        loop = self.loop()
        if loop is not None:
            return loop.value("gain")
        if isinstance(self.servo().controller, Pid):  # final: no gain multiplies it
            return 1.0
        said = f"--gain {self.example_of_gain}; 1 takes kp, ki and kd of a servo file as they stand"
        raise InputError(f"gain: must be given, for example {said} (see casahunt {self.command} --help)")

    def varied(self) -> str:
        """The parameter that is varied: of a servo the gain, of a loop one of its own.  Raises InputError: not so."""
        if self.vary not in (None, "gain") and self.loop() is None:
            raise InputError(
                f"vary = {self.vary}: must be gain, or a parameter of a loop of parts, which SERVO.toml then holds "
                "(docs/howto/parts.md)"
            )
        return self.vary or "gain"

    def leave_out(self, why: str, *names: str) -> None:
        """Refuse options that do not go with the others.  Raises InputError: one was given."""
        for name in names:
            if getattr(self, name) not in (None, False, []):
                raise InputError(f"{name.replace('_', '-')}: must be left out, {why}")
