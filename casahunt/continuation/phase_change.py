"""Where between two orbits of a branch the phases change: a phase of the longer sequence has vanished there.

    from the orbit with more phases      its shortest phase shrunk to nothing (vanishing.py)
    where that is too far                the same from the orbits of a walk towards the other one, nearer and nearer
    where no phase vanishes              the cycle with fewer phases that touches an event, or the last of them found
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from ..errors import NoOrbit
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit
from ..roots import boundary
from .curve import curve_point, in_units_of, parameter_value, secant
from .cut_elsewhere import same_events
from .locating import FIRST_PART, STEPS_NEARER
from .touching import touching_orbit
from .vanishing import AS_FAR, touched
from .walk import step_along, walk

CHANGE_WIDTH, CHANGE_ROUNDS = 1e-7, 40
"""Relative width to which the last orbit with the phases of the first one is sought; steps of that search."""


def change_of_phases(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit at which the phases change from those of `before` to those of `after`.

    It is the cycle at which a phase of the longer sequence has vanished, or the one with fewer phases that touches an
    event, or the last of those that was found; of what is no user's system, the last one with the phases of `before`.
    Where only a plane cuts the one elsewhere than the other, no phase of
    the motion changes.

    vary, options: name of the parameter; tolerance and method of the orbits.
    Returns Orbit; None where the events are the same.
    """
    if same_events(before, after):
        return None
    fewer, more = sorted((before, after), key=lambda orbit: len(orbit.arcs))
    for orbit in _nearer(more, fewer, vary, options):
        gone = touched(orbit, vary, options)
        if gone is not None and _on_the_way(before, gone, after, vary):
            return gone
    last = _last_alike(fewer, more, vary, options)
    touch = touching_orbit(last, vary, options)
    return last if isinstance(touch, str) else touch


def _nearer(more: AnyOrbit, fewer: AnyOrbit, vary: str, options: Options) -> Iterator[AnyOrbit]:
    """The orbit with more phases, and those with the same phases on the way to the other one."""
    yield more
    low, high = more.problem.range_of(vary)
    way = secant(more, fewer, vary)
    with suppress(NoOrbit):
        for orbit in walk(
            more, vary=vary, low=low, high=high, heading=way, options=options,
            first_step=FIRST_PART * float(np.linalg.norm(way)), max_points=STEPS_NEARER,
        ):  # fmt: skip
            if orbit.signature != more.signature:
                return
            yield orbit


def _on_the_way(before: Orbit, touch: Orbit, after: Orbit, vary: str) -> bool:
    """Whether a touch is that between two orbits.

    It need not lie between them: the branch may turn there, and the cycle without the phase goes on beyond it by what a
    mode puts up with.
    """
    if min(_way(before, touch, after, vary), _way(after, touch, before, vary)) > 0:
        return True
    fewer, more = sorted((before, after), key=lambda orbit: len(orbit.arcs))
    off, step = (abs(parameter_value(orbit, vary) - parameter_value(fewer, vary)) for orbit in (touch, more))
    return len(touch.arcs) == len(fewer.arcs) and off <= AS_FAR * step


def _way(one: Orbit, between: Orbit, other: Orbit, vary: str) -> float:
    """How far an orbit is from one towards another, in the parameter."""
    here = parameter_value(one, vary)
    return (parameter_value(between, vary) - here) * float(np.sign(parameter_value(other, vary) - here))


def _last_alike(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> AnyOrbit:
    """The last orbit towards `after` with the phases of `before`."""
    start = curve_point(before, vary, like=secant(before, after, vary))
    length = float(in_units_of(secant(before, after, vary), before.scale, start.setting.scale) @ start.row)
    found = [before]

    def beyond(ds: float) -> bool:
        outcome = step_along(start, before, vary, ds, *before.problem.range_of(vary), options)
        if isinstance(outcome, str) or outcome[0].signature != before.signature:
            return True
        found.append(outcome[0])
        return False

    boundary(beyond, 0.0, length, width=CHANGE_WIDTH, rounds=CHANGE_ROUNDS)
    return found[-1]
