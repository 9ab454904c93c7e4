"""How the page says what was computed: numbers to the digits that their errors vouch for, and the sentences.

number   {"value", "error", "text"}: error absolute, null where none is estimated; text without the unit
why      {"why", "evidence"}: in the place of what was not found, and what supports it, where that is known

The curves of the page that no motion hands out: branches of cycles, friction, the torque along a loop's cycle.

friction      F(v) = g(v) sgn v + sigma2 v, where it is Stribeck's
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...checks import finite_or_none, to_error
from ...errors import NoOrbit
from ...servo.linear.margins import Margins
from ..answers.answer import PLAIN_DIGITS
from .state import GAIN

IN_PER_CENT = 0.1
"""Sizes that are nearer to each other, relatively, are compared in per cent."""
HUNTING = ("hunts", "uneven", "can")
"""Verdicts with a cycle."""
MARGIN_DIGITS = 3
"""Of a ratio, and of numbers in sentences."""
CURVE_DIGITS = 6
"""Of the points of curves: a pixel is 1e-3 of a picture."""
MOST_CURVE_POINTS = 2000
ROUNDING_OF_A_SUM = 1e-13
"""Relative."""


def shown_number(value: float, relative_error: float = math.nan) -> dict[str, Any]:
    """A number with its error."""
    error = abs(value) * relative_error
    return {
        "value": finite_or_none(float(value)), "error": finite_or_none(error),
        "text": to_error(value, relative_error, PLAIN_DIGITS),
    }  # fmt: skip


def seen_number(value: float) -> dict[str, Any]:
    """A number that was read off a motion: it has no estimated error, and few digits."""
    return {"value": finite_or_none(float(value)), "error": None, "text": brief(value)}


def brief(value: float) -> str:
    """A number in a sentence."""
    return f"{value:.{MARGIN_DIGITS}g}"


def refused(why: Exception) -> dict[str, Any]:
    """The sentence of a refusal, its evidence apart from it."""
    if not isinstance(why, NoOrbit):
        return {"why": str(why)}
    return {"why": why.plain} | ({"evidence": why.evidence} if why.evidence else {})


def curve(**columns: Any) -> dict[str, list[float | None]]:
    """The points of a curve, thinned where there are too many; gaps (nan) stay."""
    arrays = {name: np.asarray(column, float) for name, column in columns.items()}
    step = max(1, math.ceil(max(a.size for a in arrays.values()) / MOST_CURVE_POINTS))
    points = {name: a[::step].tolist() for name, a in arrays.items()}
    return {n: [float(f"{x:.{CURVE_DIGITS}g}") if math.isfinite(x) else None for x in a] for n, a in points.items()}


def hunts(amplitude: float, period: float, stable: bool | None, *, partly: bool = False) -> str:
    """The sentence of a cycle that was found; partly: some motion comes to rest."""
    degrees = math.degrees(amplitude)
    swings = f"{brief(amplitude)} rad ({brief(degrees)}°) to either side, once every {brief(period)} s"
    if stable:
        return f"It hunts{', but not from every start' if partly else ''}: the servo swings by {swings}."
    if stable is None:
        return f"It can hunt: it can swing by {swings}; whether motions come to this swing is not known."
    return f"It may swing unevenly: there is an even swing of {swings}, which motions leave."


def hunts_from(start: Mapping[str, float]) -> str:
    """Where a motion was let go at rest that hunts; start: as of `OtherEnd`."""
    integral = start["integral"]
    wound = f" with the integral {brief(integral)} rad s" if integral else ""
    return f"let go at rest at {start['position']:.{CURVE_DIGITS}g} rad{wound} it hunts"


def ends_at(
    what: str, unit: str, border: float, present: float, error: float, verdict: str, sense: int = 1
) -> str:
    """The sentence of where hunting ends, which is none against the verdict at the present one.

    error: of the border, relative; sense: -1 where less of it ends hunting.
    """
    size = f"{brief(border)} {unit}".rstrip()
    if present * border <= 0:
        return f"Hunting ends at {what} {size}."
    away, side = compared(border, present, error, "the present one", MARGIN_DIGITS), "above" if sense > 0 else "below"
    inside, hunting = sense * (border - present) > error * abs(border), verdict in HUNTING
    if hunting and sense * (present - border) > error * abs(border):
        return f"The cycles that were followed end {side} {what} {size}: {away}; this swing is none of them."
    if inside and not hunting:
        return f"Cycles were followed to {what} {size}, {away}: from starts that were not tried it may hunt."
    return f"Hunting ends {side} {what} {size}: {away}."


def compared(border: float, present: float, error: float, one: str, digits: int) -> str:
    """How many times `one`, the present size, a border is, or by how many per cent they differ.

    error: of the border, relative.
    """
    ratio = border / present
    more = max(ratio, 1 / ratio)
    if more - 1 <= error:
        return f"{one}, as nearly as it is known"
    away = f"{to_error(more, error, digits)} times"
    if more < 1 + IN_PER_CENT:
        away = f"{to_error(100 * (more - 1), error / (more - 1), MARGIN_DIGITS)} % above"
    return f"{away} {one}" if ratio > 1 else f"{one} is {away} that"


def ratio_shown(border: float, present: float, relative_error: float, verdict: str) -> dict[str, Any]:
    """The number by which the gain at which hunting ends is above the present one, or that by which it is below."""
    said = compared(border, present, relative_error, "the present gain", PLAIN_DIGITS)
    if present > border * (1 + relative_error):
        said += {"rests": ": it does not hunt", "unknown": ": no hunting was found"}.get(verdict, "")
    return shown_number(border / present, relative_error) | {"said": said}


def margins_shown(found: Margins) -> dict[str, Any]:
    """The margins of the linear loop."""
    return {
        "stable": found.stable,
        "phase_margin": {"value": found.phase_margin, "text": to_error(found.phase_margin, 1e-3)},
        "crossover": {"value": found.frequency, "text": brief(found.frequency)},
        "factors": [brief(x) for x in (found.lowest_factor, found.highest_factor) if 0 < x < math.inf],
    }


def sentence_of(parts: Sequence[str]) -> str:
    """Sentences in a row."""
    return " ".join(part for part in parts if part)


DRAWN_SPEEDS, SPEED_POINTS = 10.0, 200
"""Of the friction curve: up to so many Stribeck velocities."""


def branches_shown(orbits: Any, fold: Any = None) -> dict[str, Any]:
    """Amplitude against gain of cycles along a branch, as two curves: attracting and not; what is not known is neither.

    fold: the first one of the branch, where it is known; it is put in if the branch goes no further up.
    """
    gains = np.array([orbit.problem.value("gain") for orbit in orbits])
    amplitudes = np.array([orbit.amplitude for orbit in orbits])
    stable = np.array([orbit.seen_stable for orbit in orbits], dtype=object)
    if fold is not None and gains.max() < fold.problem.value(GAIN):
        turn = int(np.argmax(gains))
        turn += bool(amplitudes[turn] > fold.amplitude)
        gains = np.insert(gains, turn, fold.problem.value("gain"))
        amplitudes, stable = np.insert(amplitudes, turn, fold.amplitude), np.insert(stable, turn, False)
    curves = {}
    for name, on in (("stable", stable == True), ("unstable", stable == False)):  # noqa: E712, of each one
        # where the one becomes the other the point belongs to both: the curves have no gap
        near = on | (np.roll(on, 1) & (np.arange(on.size) > 0)) if name == "stable" else on
        curves[name] = curve(gain=np.where(near, gains, np.nan), amplitude=np.where(near, amplitudes, np.nan))
    return curves


def left_open(orbits: Any) -> dict[str, Any]:
    """Where a branch goes on that was followed no further: what is shown with its curves."""
    gain, amplitude = orbits[-1].problem.value(GAIN), orbits[-1].amplitude
    where = f"gain {brief(gain)}, swing {brief(amplitude)} rad"
    why = f"unfinished beyond the cross: its cycles were followed no further than to {where}"
    return {"why": why, "unfinished": curve(gain=[gain], amplitude=[amplitude])}


def friction_curve(numbers: Any) -> dict[str, Any]:
    """Friction torque against velocity, in either direction, with the jump at standstill."""
    vs = numbers["stribeck_velocity"]
    v = np.linspace(0, DRAWN_SPEEDS * vs, SPEED_POINTS)

    def torque(direction: str) -> Any:
        Fs, Fc, viscous = (numbers.get(name + direction, numbers[name]) for name in ("static", "coulomb", "viscous"))
        return Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2)) + viscous * v

    return curve(velocity=[*-v[::-1], *v], torque=[*-torque("_back")[::-1], *torque("")])
