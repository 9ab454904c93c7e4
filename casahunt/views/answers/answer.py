"""The form of an answer: plain lines, details, and how numbers stand in both.

A plain number has `PLAIN_DIGITS` digits at most: friction is known to per cents, and a gain in ten digits would promise
what no servo keeps.  The details have all that the estimated error vouches for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from ...axis_units import label, quantity
from ...checks import error_text, to_absolute_error, to_error
from ...orbits import Orbit
from ...servo.linear.open_loop import linear_stable
from ...servo.outcome import Kind
from ...servo.parts.loop import Loop
from ...servo.parts.table import unit_of
from ...servo.servo import Servo
from ...servo.units import GAIN_UNIT

PLAIN_DIGITS = 4
"""Digits of a number in a plain line."""
HARD_SPACE = "\N{NO-BREAK SPACE}"
"""Where a long line must not be broken; printed as a space."""
MULTIPLIER_DIGITS = 8
"""Digits of a multiplier, at most."""
LEFT_BY_ROUNDING = 1e-12
"""Relative error of a multiplier that is left by rounding alone."""


class Told(NamedTuple):
    """What a motion is said to be, to do, and to have done."""

    state: str
    does: str
    did: str


ENDS: dict[Kind, Told] = {
    "at rest": Told("at rest", "comes to rest", "it came to rest"),
    "decaying": Told("on its way to rest", "is on its way to rest", "it came to rest"),
    "hunting": Told("hunting", "hunts", "it hunted on"),
    "growing": Told("leaves the set point for good", "leaves the set point for good", "it swung ever farther away"),
    "undecided": Told("not certain where it ends", "was not followed to its end", "its end was not certain"),
}
"""What becomes of a motion, in words."""


class Answer(NamedTuple):
    """What a command says: plain lines, and the mathematics; either is put into words where it is asked for."""

    plain: Iterable[str]
    details: Iterable[str] = ()


def item(label: str, text: str) -> str:
    """A line with its label."""
    return f"  {label:15s}  {text}"


def called(servo: Servo | Loop, model: str | None = None) -> str:
    """What a servo or a loop is called; a file gives a loop no name."""
    name = getattr(servo, "name", f"{model} servo")
    return "loop" if name == Loop.name else name


def parts_of(servo: Servo | Loop) -> list[str]:
    """The line of its parts, of a loop of a file; and of which mass positions are, where it has more than one."""
    if not isinstance(servo, Loop) or servo.name != Loop.name:
        return []
    lines = [item("parts", ", ".join(part.name for part in servo.present))]
    if any(len(part.angles) > 1 for part in servo.present):
        lines.append(item("positions are", "those of the motor, and so are amplitudes; its load swings otherwise"))
    return lines


def runs_away(loop: Loop) -> list[str]:
    """The line of a loop that leaves the set point from far enough, where friction holds a cycle in."""
    away = "from far enough the servo leaves the set point for good; casahunt simulate shows it"
    said = item("farther away", f"the loop without dry friction is unstable (casahunt loop): {away}")
    return [said] if linear_stable(loop) is False else []


def record_of(servo: Servo | Loop) -> dict[str, Any]:
    """What the JSON object says of a loop of parts; {} of a servo."""
    return {} if isinstance(servo, Servo) else {**servo.to_dict(), "gain": servo.value("gain")}


def named(parameter: str) -> str:
    """A parameter, with its unit in brackets where it has one."""
    unit = unit_of(parameter)
    return f"{parameter} [{unit}]" if unit else parameter


def short(x: float, error: float = 0.0) -> str:
    """A number of a plain line; error: relative, of what is known less."""
    return f"{float(to_error(x, error, most=PLAIN_DIGITS)):.10g}"


def within(x: float, error: float) -> str:
    """A number of a plain line by its absolute error: "0" where that is as large."""
    return short(x, error / abs(x)) if abs(x) > error else "0"


def angle(x: float, error: float = 0.0) -> str:
    """A position [rad] of a plain line; where it is shown in radians in degrees too."""
    degrees = f" ({short(math.degrees(x), error)} degrees)" if label("rad").endswith("rad") else ""
    return f"{quantity(x, 'rad', lambda shown: short(shown, error))}{degrees}"


def known(x: float, error: float, unit: str = "rad", most: int = 12) -> str:
    """A quantity to the digits that its relative error vouches for."""
    return quantity(x, unit, lambda shown: to_error(shown, error, most))


def position(x: float, error: float = 0.0) -> str:
    """A position [rad] of a plain line; error: relative."""
    return quantity(x, "rad", lambda shown: short(shown, error))


def volts_per(gain: float, error: float = 0.0) -> str:
    """A gain [V/rad] of a plain line; error: relative."""
    return quantity(gain, GAIN_UNIT, lambda shown: short(shown, error))


def at_gain(gain: float) -> str:
    """The gain [V/rad] at which something was asked."""
    return f"at gain {quantity(gain, GAIN_UNIT, '.10g')}"


def rhythm(period: float, error: float = 0.0) -> str:
    """A period [s] of a plain line, with its frequency."""
    return f"{short(period, error)} s ({short(1 / period, error)} Hz)"


def exactly(orbit: Orbit) -> list[str]:
    """Amplitude and period of an orbit in all the digits that are known."""
    return [
        item("amplitude", known(orbit.amplitude, orbit.amplitude_error)),
        item("period", f"{to_error(orbit.period, orbit.period_error)} s"),
        item("error estimate", f"{error_text(orbit.error_estimate)} (relative, of period and amplitude)"),
    ]


def complex_text(value: complex, error: float, floor: float = 0.0) -> str:
    """A multiplier as the user reads it, to the digits that its error vouches for, `MULTIPLIER_DIGITS` at most.

    error: relative for those above 1 in size, absolute for smaller ones; floor: a bound where no more is known, else 0.
    Returns text such as "0.5+0.1j".
    """
    if floor > 0:
        return f"below 1e{math.ceil(math.log10(floor))}"
    error = max(error, LEFT_BY_ROUNDING) * max(1.0, abs(value))

    def part(x: float) -> str:
        return to_absolute_error(x, error, most=MULTIPLIER_DIGITS)

    if abs(value.imag) <= error:
        return part(value.real)
    return f"{part(value.real)}{'' if value.imag < 0 else '+'}{part(value.imag)}j"
