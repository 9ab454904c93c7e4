"""The bifurcation diagram of a servo: from a gain on the stable branch, round the fold, back to that gain.

Or, by natural continuation in the gain, from there to the fold, which then is the last point.  Where no gain is asked
for, it begins at the report's lower bound, the Routh-Hurwitz gain without friction J/(cm kd' kp/ki) in three digits,
rounded up (0.0321 for its Table 1); where the servo has no stable cycle there, at the first gain that has one, in
factors of two from there up, or from a twentieth of the fold gain where that lies below.

Of a loop of parts in any of its parameters, from the value that it has, up to another one or far up, or round a fold
and back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, overload

from ..axis_units import in_its_units
from ..checks import to_and_back
from ..continuation import (
    FOLD,
    SUPERSTABLE,
    SYMMETRY_BREAKING,
    Branch,
    End,
    Monitor,
    follow,
    next_fold,
)
from ..errors import InputError, NoOrbit, Status
from ..orbits import Options
from ..servo.find_fold import HIGHEST, find_fold
from ..servo.find_orbit import find_orbit
from ..servo.friction import MODELS, Model
from ..servo.gains import typical_gain
from ..servo.parts.loop import Loop
from ..servo.parts.plain_loop import model_asked
from ..servo.parts.verbs import FAR_UP, check_present
from ..servo.problem import HuntingOrbit
from ..servo.servo import Servo, a_servo

FIGURES = 3
"""Digits of a gain to start from that nobody asked for."""
DEEPEST = 20.0
"""Fold gain over the gain to start from, where the linear loop gives none: as for Table 1."""
STANDARD = (FOLD, SYMMETRY_BREAKING, SUPERSTABLE)
"""Special points that are located where none are named, of a servo."""
DRAWING_STEP = 0.15
"""Largest arclength between points, of a servo: the solver could take three times as much, the eye could not."""


def starting_gain(servo: Servo, model: Model, options: Options | None = None) -> float:
    """Where a diagram begins that is asked for without a gain.

    servo, model, options: the problem, and tolerance and method of its orbits.
    Returns A gain [V/rad] at which the servo has a stable hunting cycle, the same for the same problem.
    Raises NoOrbit: the servo has no cycle, or none was found.
    """
    a_servo(servo)
    lowest = _rounded_up(typical_gain(servo))
    with suppress(NoOrbit):
        return find_orbit(servo, model, lowest, options=options).gain
    fold = find_fold(servo, model, options=options).gain
    gain = 2 * lowest if lowest < fold else fold / DEEPEST
    while (gain := _rounded_up(gain)) < fold:
        with suppress(NoOrbit):
            return find_orbit(servo, model, gain, options=options).gain
        gain *= 2
    raise NoOrbit(
        f"no stable hunting cycle was found with which the diagram of the {model} servo could start, though its cycles "
        f"end in a fold at gain {fold:.8g}: give the gain to start from",
        Status.NOT_FOUND,
    )


def _rounded_up(gain: float) -> float:
    """A gain in `FIGURES` digits, not smaller."""
    unit = FIGURES - 1 - math.floor(math.log10(gain))
    return float(f"{math.ceil(gain * 10.0**unit * (1 - 1e-12)) / 10.0**unit:.{FIGURES}g}")


@overload
def diagram(
    servo: Servo, model: Model, *, start: float | None = ..., to: float | None = ..., options: Options | None = ...,
    monitors: tuple[Monitor, ...] | None = ..., largest_step: float | None = ..., natural: bool = ...,
    report: Callable[[Branch[Any]], None] | None = ...,
) -> Branch[HuntingOrbit]: ...  # fmt: skip
@overload
def diagram(
    servo: Servo, model: tuple[Model, ...] | None = ..., *, start: float | None = ..., to: float | None = ...,
    options: Options | None = ..., monitors: tuple[Monitor, ...] | None = ..., largest_step: float | None = ...,
    natural: bool = ..., report: Callable[[Branch[Any]], None] | None = ...,
) -> tuple[Branch[HuntingOrbit], ...]: ...  # fmt: skip
@overload
def diagram(
    servo: Loop, model: None = ..., *, vary: str = ..., start: float | None = ..., to: float | None = ...,
    options: Options | None = ..., monitors: tuple[Monitor, ...] | None = ..., largest_step: float | None = ...,
    natural: bool = ..., report: Callable[[Branch[Any]], None] | None = ...,
) -> Branch[Any]: ...  # fmt: skip
@in_its_units
def diagram(
    servo: Servo | Loop, model: Model | tuple[Model, ...] | None = None, *, vary: str = "gain",
    start: float | None = None, to: float | None = None, options: Options | None = None,
    monitors: tuple[Monitor, ...] | None = None, largest_step: float | None = None, natural: bool = False,
    report: Callable[[Branch[Any]], None] | None = None,
) -> Any:  # fmt: skip
    """The bifurcation diagram of a servo: hunting cycles from a gain round the fold and back.

    Parameters
    ----------
    servo
        the servo, or a loop of parts.
    model
        its friction model, "switch" or "lugre", or several of them; default: both; of a loop None.
    vary
        of a loop: the parameter; of a servo the gain.
    start
        gain [V/rad] at which the stable branch is entered and the unstable one is left; default: `starting_gain` of
        each model, 0.0321 for Table 1; of a loop a value of the parameter, default its own.
    to
        value at which the branch ends on the other side; default: far up.
    options, monitors
        tolerance and method of the orbits; special points to be located.
    largest_step
        of the walk, in arclength; of natural continuation, in relative change of the gain.
    natural
        natural continuation in the gain: the stable branch, up to the fold.
    report
        called with each branch so far, as it grows.

    Returns
    -------
    Branch; of several models one each, in their order.

    Raises
    ------
    InputError, NoOrbit : as `find_orbit` at the gain `start`, or, without one, where no gain to begin at is found.

    Examples
    --------
    >>> from casahunt import Servo, diagram
    >>> branch = diagram(Servo(), "switch", start=0.6)
    >>> branch.ended
    'gain reached 0.6, the end of the range'
    >>> bool(branch.amplitudes[-1] < branch.amplitudes[0])  # the unstable cycle is the smaller one
    True
    >>> [f"{branch.values.max():.2f}" for branch in diagram(Servo(), start=0.6)]  # of both models
    ['0.65', '0.62']
    """
    if not isinstance(servo, Loop) and not isinstance(model, str):
        how: dict[str, Any] = {"vary": vary, "start": start, "to": to, "options": options, "monitors": monitors,
                               "largest_step": largest_step, "natural": natural, "report": report}  # fmt: skip
        return tuple(diagram(servo, each, **how) for each in model or MODELS)
    own: dict[str, Any] = {}
    if isinstance(servo, Loop):
        model_asked(servo, model)  # type: ignore[arg-type]
        servo = servo.replace(**({} if start is None else {vary: start}))
        check_present(servo, vary)
        here = servo.value(vary)
        if to is None and here <= 0:
            raise InputError(f"to: must be given, {vary} = {here:g} at the start cannot be multiplied")
        to, _ = to_and_back(vary, here, FAR_UP * here if to is None else to, None)
        start = None
    else:
        if vary != "gain":
            raise InputError(f"vary = {vary}: must be gain of a servo; casahunt.servo.parts.loop_of makes a loop of it")
        options = options or Options()
        own = {"monitors": STANDARD, "largest_step": DRAWING_STEP, "recut": False}
        start = starting_gain(servo, model, options) if start is None else start  # type: ignore[arg-type]
        to = start * HIGHEST if to is None else to
    own |= {} if monitors is None else {"monitors": monitors}
    own |= {} if largest_step is None else {"largest_step": largest_step}
    at: Any = servo, model, start
    first = find_orbit(*at, vary=vary, options=options)
    branch: Branch[Any] = follow(first, vary, to=to, options=options, natural=natural, report=report, **own)
    return _with_the_fold_behind(branch, options) if natural else branch


def _with_the_fold_behind(branch: Branch[Any], options: Options | None) -> Branch[Any]:
    """A branch of natural continuation with the fold at which it has ended as its last point."""
    last, vary = branch.orbits[-1], branch.vary
    try:
        fold = next_fold(last, vary, options or Options())
    except NoOrbit as error:
        return replace(branch, end=End("stuck", f"{branch.ended}; that this is a fold is not shown: {error}"))
    here = last.problem.value(vary)
    ended = f"natural continuation ends at the {fold.meaning}; the last cycle before it lies at {vary} {here:.10g}"
    end = End(fold.kind, ended, fold.value, fold.error)
    return replace(branch, orbits=(*branch.orbits, fold.orbit), special=(*branch.special, fold), end=end)
