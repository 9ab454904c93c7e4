"""How much phase and gain a linear loop can lose, with a delay or as built.

    continuous    L(s) of open_loop.py times exp(-s D)
    as built      L(z) of pulse_transfer.py, at z = exp(i omega T) up to omega = pi/T

Margins are told by Nyquist's criterion from -L along the frequencies.  As the gain is raised, a pair of poles leaves
the stable region at each frequency at which arg -L falls through 0, and enters it where that rises, at the gain factor
1/|L|; at pi/T, of a sampled loop, a single one.

    stable            by the poles of the closed loop: by Routh's array, or the eigenvalues of the map from sample to
                      sample; with a delay, of which there are endlessly many, they are counted: of L's own as many are
                      unstable with next to nothing of the gain, and two more where arg -L < 0 at low frequencies
    phase margin      the least arg -L of all frequencies at which |L| = 1; of a stable loop modulo 360 degrees
    gain margins      the factors next to 1

Of a rational loop, |L| = 1 and arg L = pi are roots of polynomials in w = omega^2; a delay leaves |L| as it is.
Between two frequencies of the grid, which is denser where poles and zeros lie beside the axis, and as dense as the
turns that a delay makes of the phase, a change of sign is enclosed to rounding.  On a pole of L that lies on the axis
arg -L falls by half a turn, through 0 where it was above; on a zero it rises, and no gain is a limit there.  Beyond the
turns that are looked at arg -L is not followed; what crosses there is no limit where |L|, times the gain factor found,
stays below 1.

Source: Nyquist's criterion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...checks import require, shown
from ...errors import InputError
from ...results import Result
from ..drive import Drive
from ..parts.loop import Loop
from ..parts.plain_loop import loop_asked
from ..servo import Servo
from .open_loop import OpenLoop, either_way, linear_stable, open_loop
from .pulse_transfer import pulse_transfer

Array = np.ndarray
Response = Callable[[Array], Array]

FREQUENCIES = 4001
"""Frequencies at which arg -L is looked at for changes of its sign."""
LOWEST_SEEN, HIGHEST_SEEN = 1e-6, 1e6
"""The first and the last of them, in units of the crossover."""
BESIDE_A_POLE, WIDTHS, LEAST_ASIDE = 12, 1e3, 1e-7
"""Frequencies on each side of a pole or zero, and how far they reach, in its distances from the axis, which are at
least so much of its frequency."""
ON_THE_AXIS = 1e-12
"""|L| above the inverse is that of a pole on the axis, below it that of a zero there."""
IN_A_TURN, TURNS_BEYOND, MOST_TURNS_BY_DELAY = 16, 3, 2000
"""Frequencies in a turn of the phase that a delay makes; so many turns beyond the crossover, and of all."""
PARTS_OF_A_STEP, DIVIDED = 16, 14
"""Parts of a step between two frequencies that are looked at at once, and how often: to rounding."""
REAL = 1e-7
"""A root w of a crossover polynomial counts as real below this ratio of imaginary to absolute part: a double root,
where a curve touches, is only known to the square root of rounding."""
POLISH = 3
"""Newton steps that take a simple real root of numpy.roots to rounding."""


@dataclass(frozen=True, repr=False)
class Margins(Result):
    """Margins of a loop.

    Attributes
    ----------
    frequency : crossover |L| = 1 [rad/s]; that of the phase margin, where there are several; nan where there is none.
    phase_margin : there [deg].
    lowest_factor, highest_factor : the gain may be multiplied by anything between them and the loop stays stable;
        0 and inf without such a limit; nan for an unstable loop.
    stable : no unstable pole; where there is a crossover, phase_margin > 0.

    Examples
    --------
    >>> from casahunt import Servo, margins
    >>> margins(Servo(), 0.1)
    <Margins: phase margin 52.2768 deg, frequency 11.9131 rad/s, lowest factor 0, highest factor inf, stable True>
    """

    _quantities = ("phase_margin [deg]", "frequency [rad/s]", "lowest_factor", "highest_factor", "stable")
    _details = ("crossover = frequency [rad/s]",)

    frequency: float
    phase_margin: float
    lowest_factor: float
    highest_factor: float
    stable: bool


@dataclass(frozen=True, repr=False)
class Crossover(Result):
    """A frequency at which the loop crosses |L| = 1, or the negative real axis.

    Attributes
    ----------
    frequency : omega [rad/s].
    margin : at |L| = 1 the phase margin, arg L + 180 degrees in (-180, 180]; at arg L = -180 degrees the
        factor 1/|L| by which the gain would have to change to put a pole on the imaginary axis.
    """

    _quantities = ("frequency [rad/s]", "margin")

    frequency: float
    margin: float


def margins(
    servo: Servo | Loop, gain: float | None = None, *, delay: float = 0.0, drive: Drive | None = None
) -> Margins:
    """Margins of the loop, dry friction left out.

    Parameters
    ----------
    servo, gain
        the servo and its gain K [V/rad]; or a loop of parts, which has its own.
    delay
        D [s], >= 0, of a continuous loop.
    drive
        how it is run: sample time, delay, derivative and its filter, integration, leak, error filter; counts, and what
        is not linear in it, are left out.  Default: continuously.

    Returns
    -------
    Margins; of an unstable loop the factors are nan.  As built, of crossovers up to pi/T; where there is none, the
    frequency is that.  Of viscous friction by direction, what holds in both.

    Raises
    ------
    InputError : a value out of range, a loop that is not linear, or a delay of which too many turns count.

    Examples
    --------
    >>> from casahunt import Drive, Servo, margins
    >>> found = margins(Servo(), 0.1, delay=0.01)  # [s]
    >>> round(found.phase_margin, 2), round(found.highest_factor, 2)  # degrees, and times the gain
    (45.45, 15.43)
    >>> found = margins(Servo(), 0.1, drive=Drive(sample_time=0.01))  # [s]
    >>> round(found.phase_margin, 2), round(found.highest_factor, 2)
    (47.76, 18.48)
    """
    if len(ways := either_way(servo)) > 1:
        return _of_both([margins(each, gain, delay=delay, drive=drive) for each in ways.values()])
    if drive is None:
        return margins_of(open_loop(servo, gain), require("delay", delay, at_least=0))
    if delay:
        raise InputError("delay: must be the drive's, Drive(delay=...)")
    # the margins of a loop as its drive runs it
    loop = pulse_transfer(loop_asked(servo, None, gain, usual="switch"), drive)
    last, poles = math.pi / loop.sample_time, loop.poles
    rough = last * np.geomspace(LOWEST_SEEN**2, 1, FREQUENCIES // 10)
    unit = rough[np.abs(loop.response(rough)) >= 1][-1:]
    grid = np.geomspace(LOWEST_SEEN * (unit[0] if unit.size else rough[0]), last, FREQUENCIES)
    omega = _with(grid, _beside(poles), last)
    L = loop.response(omega)
    crossed = _changes(lambda L: np.abs(L) - 1, loop.response, omega, L)[0]
    own = int((poles.real * loop.sample_time > ON_THE_AXIS).sum())
    crossed = crossed if crossed.size else omega[-1:]
    return _told(loop.response, omega, L, crossed, loop.stable, own, folds=True)


def _of_both(found: Sequence[Margins]) -> Margins:
    """The margins that hold in each direction: the least phase margin and the nearest factors, if both are stable."""
    unstable = next((each for each in found if not each.stable), None)
    if unstable is not None:
        return unstable
    least = min(found, key=lambda each: math.inf if math.isnan(each.phase_margin) else each.phase_margin)
    lowest, highest = max(each.lowest_factor for each in found), min(each.highest_factor for each in found)
    return replace(least, lowest_factor=lowest, highest_factor=highest)


def margins_of_parts(loop: Loop) -> Margins | None:
    """The margins of a loop of parts; None where it is not linear."""
    return None if linear_stable(loop.within_limits) is None else margins(loop)


def margins_of(loop: OpenLoop, delay: float = 0.0) -> Margins:
    """The margins of a rational loop with a delay [s].  Raises InputError: too many of its turns would count."""
    crossed = np.array([c.frequency for c in gain_crossovers(loop.numerator, loop.denominator)])
    poles = np.roots(loop.denominator)
    unit = crossed[-1] if crossed.size else float(np.abs(poles).max())
    roots = np.append(poles, np.roots(loop.numerator))
    omega, last = frequencies_of(loop, unit), math.inf
    if delay:  # behind all that L does by itself the phase only falls, and |L| with it
        last = max(unit, float(np.abs(roots).max())) + TURNS_BEYOND * 2 * math.pi / delay
        turns = min(last * delay / (2 * math.pi), MOST_TURNS_BY_DELAY)
        omega = _with(omega, 2 * math.pi / delay * np.linspace(0, turns, int(IN_A_TURN * turns) + 1), last)
    stable, own = None if delay else loop.stable, int((poles.real > 0).sum())

    def response(at: Array) -> Array:
        return loop.response(at, delay)

    found = _told(response, omega, response(omega), crossed, stable, own)
    beyond = omega[omega * delay > 2 * math.pi * MOST_TURNS_BY_DELAY]
    size = np.abs(loop.response(beyond))
    if np.any(size * (found.highest_factor if found.stable else 1.0) > 1):
        i = int(np.argmax(size))
        raise InputError(
            f"delay = {shown(delay)}: turns the phase {beyond[i] * delay / (2 * math.pi):.3g} times below "
            f"{beyond[i]:.4g} rad/s, where |L| = {size[i]:.3g} decides about the margins, and only the first "
            f"{MOST_TURNS_BY_DELAY} turns are looked at: shorten the delay, or leave out what is so fast in the loop"
        )
    return found


def frequencies_of(loop: OpenLoop, unit: float = math.nan) -> Array:
    """Frequencies [rad/s], far below to far above a unit, default that of the poles, close where L changes fast."""
    poles = np.roots(loop.denominator)
    roots = np.append(poles, np.roots(loop.numerator))
    unit = float(np.abs(poles).max()) if math.isnan(unit) else unit
    return _with(unit * np.geomspace(LOWEST_SEEN, HIGHEST_SEEN, FREQUENCIES), _beside(roots))


def _beside(roots: Array) -> Array:
    """Frequencies beside those of poles and zeros."""
    roots = roots[roots.imag > 0]
    wide = np.maximum(np.abs(roots.real), LEAST_ASIDE * roots.imag)
    aside = wide[:, None] * np.geomspace(1 / WIDTHS, WIDTHS, BESIDE_A_POLE)
    return np.asarray(roots.imag[:, None] + np.hstack([-aside, aside])).ravel()


def _with(omega: Array, more: Array, last: float = math.inf) -> Array:
    """Frequencies with others, from the first of them to a last one."""
    both = np.unique(np.concatenate([omega, more]))
    return np.asarray(both[(both >= omega[0]) & (both <= last)])


def _told(
    response: Response, omega: Array, L: Array, crossed: Array, stable: bool | None, own: int, *, folds: bool = False
) -> Margins:
    """Margins from L at the frequencies (m,).

    crossed: (k,) those at which |L| = 1; stable: whether the loop is, None where its poles are to be counted; own:
    unstable poles of L; folds: the last frequency is pi/T.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        m = omega.size - folds
        at, falls = _changes(lambda L: -L.imag, response, omega[:m], L[:m])
        values, change = -response(at), np.where(falls, 2, -2)
    if folds:
        values, change = np.append(values, -L[-1].real), np.append(change, 1 if L[-2].imag < 0 else -1)
    size = np.nan_to_num(np.abs(values), nan=np.inf)
    pole = size > 1 / ON_THE_AXIS
    limit = ~pole & (values.real > 0) & (size > ON_THE_AXIS)
    factors = 1 / size[limit]
    if stable is None:
        unstable = own + 2 * int(L[0].imag > 0) + int(change[limit][factors < 1].sum())
        stable = unstable + int(change[pole & (change > 0)].sum()) == 0
    phi = np.degrees(np.angle(-response(crossed)))
    phi = np.mod(phi, 360) if stable else phi
    frequency, margin = min(zip(crossed, phi, strict=True), key=lambda c: c[1], default=(math.nan, math.nan))
    if not stable:
        return Margins(float(frequency), min(float(margin), 0.0), math.nan, math.nan, False)
    low, high = max(factors[factors < 1], default=0.0), min(factors[factors > 1], default=math.inf)
    return Margins(float(frequency), float(margin), float(low), float(high), True)


def _changes(of: Response, response: Response, omega: Array, L: Array) -> tuple[Array, Array]:
    """Where something of L changes its sign between the first and the last frequency, and whether it falls there."""
    above = of(L) > 0
    i = np.flatnonzero(above[:-1] != above[1:])
    ends, falls = np.array([omega[i], omega[i + 1]]), above[i]
    for _ in range(DIVIDED if i.size else 0):
        steps = ends[0] + (ends[1] - ends[0]) * np.linspace(0, 1, PARTS_OF_A_STEP + 1)[:, None]
        same = (of(response(steps[1:-1].ravel())).reshape(PARTS_OF_A_STEP - 1, -1) > 0) == falls
        first = np.cumprod(same, axis=0).sum(axis=0)  # the step in which it changes
        ends = np.take_along_axis(steps, np.array([first, first + 1]), axis=0)
    return ends.mean(axis=0), falls


def gain_crossovers(numerator: Sequence[float] | Array, denominator: Sequence[float] | Array) -> tuple[Crossover, ...]:
    """All frequencies with |L(j omega)| = 1.

    numerator, denominator: coefficients of L(s), highest power first. Returns crossovers by increasing frequency
    [rad/s], with their phase margins [deg]. Raises InputError: |L| = 1 at every frequency, as for an all-pass.
    """
    a, b = _along_the_axis(numerator), _along_the_axis(denominator)
    found = []
    for omega in _frequencies(np.polysub(_square(a), _square(b)), "|L| = 1"):
        phase = math.degrees(float(np.angle(np.polyval(a, omega) / np.polyval(b, omega))))
        margin = phase + 180
        found.append(Crossover(omega, margin if margin <= 180 else margin - 360))
    return tuple(found)


def phase_crossovers(numerator: Sequence[float] | Array, denominator: Sequence[float] | Array) -> tuple[Crossover, ...]:
    """All frequencies with L(j omega) real and negative.

    numerator, denominator: coefficients of L(s), highest power first. Returns crossovers by increasing frequency
    [rad/s], with the factors 1/|L|. Raises InputError: L is real at every frequency.
    """
    a, b = _along_the_axis(numerator), _along_the_axis(denominator)
    imaginary = np.polymul(a, np.conj(b)).imag  # odd in omega: only every other coefficient is there
    found = []
    for omega in _frequencies(imaginary[::-1][1::2][::-1], "a real L"):
        value = complex(np.polyval(a, omega) / np.polyval(b, omega))
        if value.real < 0:
            found.append(Crossover(omega, 1 / abs(value)))
    return tuple(found)


def _along_the_axis(polynomial: Sequence[float] | Array) -> Array:
    """Coefficients in omega of a polynomial in s = j omega."""
    c = np.asarray(polynomial, dtype=float)
    powers = np.array([1, 1j, -1, -1j])  # exact, as 1j**k is not
    return c * powers[np.arange(c.size)[::-1] % 4]


def _square(c: Array) -> Array:
    """|c(omega)|^2 as a polynomial in w = omega^2."""
    full = np.polymul(c, np.conj(c)).real
    return full[::-1][::2][::-1]


def _frequencies(polynomial: Array, what: str) -> list[float]:
    """omega = sqrt(w) for the positive roots w of a polynomial in w = omega^2, increasing."""
    size = float(np.max(np.abs(polynomial), initial=0.0))
    if size == 0:
        raise InputError(f"crossover {what}: every frequency is one")
    c = np.trim_zeros(polynomial, "f")
    derivative = np.polyder(c)
    found = []
    for root in np.roots(c):
        if root.real <= 0 or abs(root.imag) > REAL * abs(root):
            continue
        w = float(root.real)
        for _ in range(POLISH):
            slope = float(np.polyval(derivative, w))
            step = float(np.polyval(c, w)) / slope if slope else 0.0
            w = w - step if abs(step) < 1e-6 * w else w
        found.append(math.sqrt(w))
    return sorted(found)
