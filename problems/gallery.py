"""What the files of the gallery share: what is known of a cycle from outside, and how a computed one compares.

A file of the gallery has the equations in its docstring, a `SYSTEM`, its `TRUTH`, and `cycles`, which finds what the
truth speaks of.  Run as a module it prints a line for each cycle and draws them:

    python -m problems.van_der_pol --out van_der_pol.png

No truth comes from this package: closed forms, published digits, or scripts/peers/gallery_truths.py, which computes
them with Taylor series (heyoka) in extended precision or with mpmath.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from casahunt.orbits import SystemOrbit


@dataclass(frozen=True)
class Truth:
    """What is known of a cycle from outside.

    Attributes
    ----------
    period : of the full cycle.
    extrema : state: (smallest, largest value), of those that are known.
    multipliers : the nontrivial ones of the full period, the largest first; None where they are not known.
    """

    period: float
    extrema: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    multipliers: tuple[complex, ...] | None = None


class Found(NamedTuple):
    """One cycle of a gallery: its caption, the orbit, what is known of it."""

    caption: str
    orbit: SystemOrbit
    truth: Truth


class Course(NamedTuple):
    """A branch of a gallery and what is known of it from outside.

    Attributes
    ----------
    caption : what it is.
    start : -> the orbit that it starts at.
    vary, to : the parameter, and the value that it is followed towards.
    special : (kind, value of the parameter) of all its special points, in any order.
    end : kind of its end; where a word more fits, all of them.
    how : further arguments of `follow`.
    within : relative error, in units of the larger of one and the value, to which the values are computed by default.
    """

    caption: str
    start: Callable[[], SystemOrbit]
    vary: str
    to: float
    special: tuple[tuple[str, float], ...]
    end: tuple[str, ...] = ("range",)
    how: Mapping[str, Any] = {}
    within: float = 1e-7


class Compared(NamedTuple):
    """Special points of a branch beside those that are known: what is `lost`, and what is `invented`."""

    lost: tuple[tuple[str, float], ...]
    invented: tuple[tuple[str, float], ...]


def compared(found: Iterable[tuple[str, float]], known: Iterable[tuple[str, float]], within: float) -> Compared:
    """Match special points by kind and value.

    Parameters
    ----------
    found, known
        (kind, value) of each.
    within
        largest error of a value, in units of the larger of one and the value.

    Returns
    -------
    Compared: both empty where each has its partner.
    """
    left, invented = list(known), []
    for kind, value in found:
        near = [one for one in left if one[0] == kind and abs(one[1] - value) <= within * max(1.0, abs(one[1]))]
        if near:
            left.remove(min(near, key=lambda one: abs(one[1] - value)))
        else:
            invented.append((kind, value))
    return Compared(tuple(left), tuple(invented))


def root(function: Callable[[float], float], near: float) -> float:
    """A root of a function, by the secant method to rounding; for the closed forms.

    Parameters
    ----------
    function
        of one number.
    near
        a number near the root.

    Returns
    -------
    The root.
    """
    a, b = near, near * (1 + 1e-4)
    fa, fb = function(a), function(b)
    for _ in range(60):
        if fb == fa or abs(b - a) <= 1e-16 * abs(b):
            break
        a, b, fa = b, b - fb * (b - a) / (fb - fa), fb
        fb = function(b)
    return b


def errors(orbit: SystemOrbit, truth: Truth) -> dict[str, float]:
    """What an orbit is off by.

    Parameters
    ----------
    orbit
        the computed one.
    truth
        what is known.

    Returns
    -------
    {"period": relative error, "x": error of the extrema of the state x relative to the larger of them, ...,
    "multipliers": largest error, relative to those that are larger than one}.
    """
    off = {"period": abs(orbit.period / truth.period - 1)}
    for state, (low, high) in truth.extrema.items():
        found = orbit.extrema(state)
        off[state] = max(abs(found.low.value - low), abs(found.high.value - high)) / max(abs(low), abs(high))
    if truth.multipliers is not None:
        found_multipliers = orbit.multipliers.full[1 : 1 + len(truth.multipliers)]
        exact = np.array(truth.multipliers, complex)
        worst = np.abs(np.sort_complex(found_multipliers) - np.sort_complex(exact)) / np.maximum(1.0, np.abs(exact))
        off["multipliers"] = float(np.max(worst))
    return off


def line(found: Found) -> str:
    """The period of a cycle, its truth, and what everything is off by."""
    orbit, truth = found.orbit, found.truth
    off = ", ".join(f"{what} {error:.1e}" for what, error in errors(orbit, truth).items())
    verdict = "stable" if orbit.stable else "unstable"
    return (
        f"{found.caption}: period {orbit.period:.13g}, truth {truth.period:.13g}, estimated error "
        f"{orbit.period_error:.1e}; true errors: {off}; {verdict}, {orbit.wall_s:.2f} s"
    )


def portrait(orbit: SystemOrbit, across: str, up: str, ax: Any = None, **style: Any) -> Any:
    """Draw one state over another, or over the time.

    Parameters
    ----------
    orbit
        what is drawn.
    across, up
        names of states; "t" is the time.
    ax
        matplotlib axes; default new ones.
    **style
        for `ax.plot`.

    Returns
    -------
    The axes.
    """
    if ax is None:
        from matplotlib.figure import Figure

        ax = Figure(figsize=(6.4, 4.2), layout="constrained").subplots()
    times, states = orbit.sample(48)
    named = {**dict(zip(orbit.cycle.states, states, strict=True)), "t": times}
    ax.plot(named[across], named[up], **{"linewidth": 1.5, **style})
    ax.set(xlabel=across, ylabel=up)
    return ax


Draw = Callable[[Sequence[Found], Any], None]
"""(cycles, axes): draws them."""


def present(cycles: Iterable[Found], draw: Draw, title: str, arguments: Sequence[str] | None = None) -> None:
    """What the gallery's files do when they are run.

    Parameters
    ----------
    cycles
        what is found, one by one.
    draw
        draws all of them.
    title
        of the picture.
    arguments
        of the command line: --out FILE, where the picture goes.
    """
    parser = argparse.ArgumentParser(description=title)
    parser.add_argument("--out", help="where the picture goes, such as cycle.png; default none is made")
    chosen = parser.parse_args(arguments)
    seen = []
    for found in cycles:
        print(line(found))
        seen.append(found)
    if chosen.out:
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        axes = figure.subplots()
        draw(seen, axes)
        axes.set_title(title)
        figure.savefig(chosen.out, dpi=120)
