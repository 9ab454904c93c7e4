"""The stages (answers.py) of a servo, by the verbs of a servo, and of a loop of parts, by those of a loop.

    step          followed for three periods, or a hundred reset times where there is no cycle
    diagram       from a twentieth of the fold gain, or from below the present one, round the fold and back;
                  of a loop from a power of two below the present gain, or of four below that
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any, cast

import numpy as np

from ... import effort
from ...continuation import Fold, follow
from ...continuation.walk import walk
from ...design.remedies.border import BORDERS, Border, border
from ...errors import ComesToRest, HuntsIrregularly, NoOrbit
from ...orbits import Options, Orbit
from ...servo.find_fold import HIGHEST, find_fold
from ...servo.find_orbit import find_orbit
from ...servo.linear.margins import margins_of
from ...servo.linear.open_loop import open_loop_of_parts
from ...servo.other_end import other_end
from ...servo.outcome import SETTLES
from ...servo.parts import Loop, Remedy, loop_of
from ...servo.parts.fate import Swing, on_the_cycle
from ...servo.parts.verbs import FIRST_OFF, fold_in, loop_cycle
from ...servo.problem import motor_torque
from ...servo.servo import Servo
from ...servo.simulate import simulate
from ...servo.trajectory import Trajectory
from ...servo.units import GAIN_UNIT
from ..answers.simulate import HEADS
from .numbers import (
    HUNTING,
    ROUNDING_OF_A_SUM,
    branches_shown,
    brief,
    curve,
    ends_at,
    friction_curve,
    hunts,
    hunts_from,
    left_open,
    margins_shown,
    ratio_shown,
    refused,
    seen_number,
    sentence_of,
    shown_number,
)
from .state import GAIN, Problem

PERIODS_OF_A_STEP, RESETS_OF_A_STEP = 3.0, 100.0
DRAWN_MOTION_TOLERANCE, MOTION_POINTS = 1e-4, 6
"""Of the simulated step: a picture and a peak need no more."""
CYCLE_POINTS = 8
BELOW_THE_FOLD, BELOW_THE_GAIN = 20.0, 2.0
"""A diagram begins so many times below the fold gain, or below a gain that is smaller still; that of a loop at a power
of the latter which is at least so many times below its gain."""
DRAWN_CYCLES, DIAGRAM_STEP, MOST_DIAGRAM_POINTS = Options(tol=1e-4, provisional=True), 0.3, 120
"""Of the cycles of a diagram, whose errors nobody reads."""
UNFINISHED = ("stuck", "points")
"""Ends of a branch behind which it goes on."""
LOWER_GAINS = (1.0, 0.25, 0.0625)
"""Parts of that gain at which a cycle of a loop is looked for in turn."""
FAR_ABOVE = 1e3
"""A branch of a loop is followed up to so many times the gain."""
ROUGH = Options(tol=1e-6)
"""Tolerance of the numbers of a loop."""


class ServoAnswers:
    """The stages of a servo without load and remedy."""

    def __init__(self, problem: Problem, memory: Callable[..., dict[Any, Any]]) -> None:
        self.problem, self.remembered = problem, memory
        self.memory = memory(GAIN)
        self.orbit: Orbit | None = None
        self.said, self.more, self.verdict = "", "", "unknown"
        self.rests = False
        self.later: dict[str, Any] = {}
        self.drawn: list[Any] = []

    def hunts(self) -> dict[str, Any]:
        """Does it hunt."""
        servo, model, gain = self.problem[:3]
        assert servo is not None
        try:
            self.orbit = orbit = find_orbit(servo, model, gain)
        except NoOrbit as why:
            return self._no_cycle(why, proved=why.status is None)
        times, states = orbit.sample(CYCLE_POINTS)
        return self._cycle(orbit, times, states, motor_torque(states, servo.parameters(gain)))

    def _no_cycle(self, why: NoOrbit, proved: bool) -> dict[str, Any]:
        self.verdict, more = "rests" if proved else "unknown", refused(why)
        self.said = "It does not hunt at this gain." if proved else "Whether it hunts is not known."
        if isinstance(why, HuntsIrregularly):
            self.verdict, more = "uneven", {"why": "none: no swing repeats", "evidence": str(why)}
            self.said = "It hunts irregularly: it turns {:.4g} to {:.4g} rad from the set point.".format(*why.amplitude)
        if isinstance(why, ComesToRest):
            self.verdict, self.rests, more = "unknown", True, {"evidence": str(why)}
            self.said = "No hunting was found: from every start that was tried it comes to rest."
        return {"verdict": self.verdict, "sentence": self.said, **more}

    def _cycle(self, orbit: Any, times: Any, states: Any, torque: Any, *, partly: bool = False) -> dict[str, Any]:
        stable = orbit.stable
        self.said = hunts(orbit.amplitude, orbit.period, stable, partly=partly)
        self.verdict = "hunts" if stable else "uneven" if stable is False else "can"
        return {
            "verdict": self.verdict, "sentence": self.said,
            "amplitude": shown_number(orbit.amplitude, orbit.amplitude_error),
            "period": shown_number(orbit.period, orbit.period_error),
            "cycle": curve(time=times, angle=states[0], velocity=states[1], torque=torque),
        }  # fmt: skip

    @cached_property
    def loop(self) -> Loop:
        """The servo as a loop of parts."""
        servo, model, gain = self.problem[:3]
        return self.problem.loop or loop_of(cast(Servo, servo), model, gain)

    def linear(self) -> dict[str, Any]:
        """Friction curve and margins, where there are any."""
        numbers, opened = self.loop.parameters, open_loop_of_parts(self.loop)
        known = {"static", "coulomb", "stribeck_velocity", "viscous"} <= set(numbers)
        shown = {"friction": friction_curve(numbers)} if known else {}
        if opened is None:
            return {**shown, "why": "with this part the loop is not linear: it has no margins"}
        return {**shown, **margins_shown(margins_of(opened))}

    def step(self) -> dict[str, Any]:
        """A step of the set point, followed for a hundred reset times where there is no cycle."""
        if self.orbit is not None:
            duration = PERIODS_OF_A_STEP * self.orbit.period
        else:
            p = self.loop.parameters
            by_gains = {"kp", "ki"} <= set(p)
            reset = p["kp"] / p["ki"] if by_gains else p.get("integral_time", 1.0) + p.get("lead_time", 0.0)
            duration = RESETS_OF_A_STEP * reset
        motion = simulate(self.loop, set_point=self.problem.step, time=duration, tol=DRAWN_MOTION_TOLERANCE)
        times, states = motion.dense(MOTION_POINTS)
        # one + other, zero where they cancel to rounding: a picture of that would show nothing else
        other = states[motion.names.index(self.loop.angles[-1])]
        whole = motion.set_point + np.asarray(other)
        angle = np.where(np.abs(whole) > ROUNDING_OF_A_SUM * abs(motion.set_point), whole, 0.0)
        voltage = motion.peak_voltage
        shown = {
            "motion": curve(time=times, angle=angle, torque=motion.signal("torque", times)),
            "peak": seen_number(motion.peak_torque),
            **({} if math.isnan(voltage) else {"voltage": seen_number(voltage)}),
        }  # fmt: skip
        return shown | (self._end_of(motion) if self.problem.loop is None else {"ends": ""})

    def _end_of(self, motion: Trajectory) -> dict[str, Any]:
        """Where a step ends; and where it comes to rest though the servo can hunt, from which start that does."""
        kind = motion.verdict.kind
        ends = f"the step ends: {HEADS[kind]}" if kind != "undecided" else "where the step ends is not seen yet"
        if self.verdict not in HUNTING or kind not in SETTLES:
            return {"ends": ends}
        assert self.orbit is not None
        self.said = hunts(self.orbit.amplitude, self.orbit.period, self.orbit.stable, partly=True)
        with suppress(effort.GivenUp):
            other = other_end(motion)
            ends += f"; {hunts_from(other.start)}" if other is not None and other.hunts else ""
        return {"ends": ends, "sentence": sentence_of((self.said, self.more))}

    def _fold(self) -> Fold[Any]:
        """The fold, found once for all gains.  Raises NoOrbit."""
        servo, model = self.problem[:2]
        assert servo is not None
        if "fold" not in self.memory:
            self.memory["fold"] = find_fold(servo, model)
        found: Fold[Any] = self.memory["fold"]
        return found

    def border(self) -> dict[str, Any]:
        """The fold gain, and how far off it is."""
        fold = self._fold()
        return self._gain_border(fold.value, fold.value_error)

    def _gain_border(self, value: float, error: float) -> dict[str, Any]:
        gain = self.problem.gain
        self.more = ends_at("the gain", GAIN_UNIT, value, gain, error, self.verdict)
        return {
            "gain": shown_number(value, error), "ratio": ratio_shown(value, gain, error, self.verdict),
            "sentence": sentence_of((self.said, self.more)),
        }  # fmt: skip

    def diagram(self) -> dict[str, Any]:
        """Amplitude against gain."""
        servo, model, gain = self.problem[:3]
        assert servo is not None
        start = self._start()
        if ("diagram", start) not in self.memory:
            first = find_orbit(servo, model, start, options=Options(tol=DRAWN_CYCLES.tol))
            self.drawn.append(first)
            steps = walk(first, low=start, high=start * HIGHEST, options=DRAWN_CYCLES, largest_step=DIAGRAM_STEP)
            ended = self._drawn_to_end(steps)
            fold = self.memory["fold"].orbit if "fold" in self.memory else None
            self.memory["diagram", start] = branches_shown(self.drawn, fold) | (
                left_open(self.drawn) if getattr(ended, "kind", "stuck") in UNFINISHED else {}
            )
        return {**self.memory["diagram", start], "present": gain}

    def _drawn_to_end(self, steps: Any) -> Any:
        """Draw the orbits of a walk; returns why it ends."""
        while True:
            try:
                self.drawn.append(next(steps))
            except StopIteration as end:
                return end.value

    def so_far(self) -> dict[str, Any]:
        """What is known of the diagram where it was given up; {} where that is no curve."""
        if len(self.drawn) < 2:
            return {}
        return {**branches_shown(self.drawn), **left_open(self.drawn), "present": self.problem.gain}

    def _start(self) -> float:
        """The gain at which the diagram begins: the same for most gains, so that a move along it computes nothing."""
        gain = self.problem.gain
        with suppress(NoOrbit):
            start = self._fold().value / BELOW_THE_FOLD
            while start > gain:
                start /= BELOW_THE_GAIN
            return start
        return gain / BELOW_THE_GAIN


class LoopAnswers(ServoAnswers):
    """The stages of a loop of parts: of a servo with load or remedy, or of a file."""

    _bare: Any = None
    """The cycle of the servo without load and remedy, where one was found."""

    def hunts(self) -> dict[str, Any]:
        """Does it hunt."""
        try:
            orbit = self._settled() if self.problem.servo is not None else loop_cycle(self.loop, options=ROUGH)
        except NoOrbit as why:
            return self._no_cycle(why, proved=False)
        return self._of_cycle(orbit)

    def _of_cycle(self, orbit: Any, *, partly: bool = False) -> dict[str, Any]:
        self.orbit = orbit
        times, states = orbit.sample(CYCLE_POINTS)
        names = self.loop.system.states
        angle = next((states[names.index(name)] for name in self.loop.angles), states[0])
        velocity = states[names.index("x2")] if "x2" in names else np.gradient(angle, times)
        # Torque of the motor along a cycle of a loop, which may be closed by its mirror image (orbit.repeats = 2)
        ends = np.cumsum([arc.duration for arc in orbit.arcs])
        half = times.size if orbit.repeats == 1 else (times.size - 1) // 2
        of = np.searchsorted(ends, times[:half], side="right").clip(max=len(ends) - 1)
        torque = np.empty(half)
        for i, arc in enumerate(orbit.arcs):
            at = of == i
            if at.any():
                torque[at] = self.loop.signal("torque", arc.mode, states[:, :half][:, at])
        torque = torque if orbit.repeats == 1 else np.concatenate([torque, -torque, torque[:1]])
        return self._cycle(orbit, times, np.array([angle, velocity]), torque, partly=partly)

    def _settled(self) -> Any:
        """The cycle on which a motion settles that starts on that of the servo alone.  Raises NoOrbit."""
        servo, model, gain = self.problem[:3]
        assert servo is not None
        with suppress(NoOrbit):
            self._bare = find_orbit(servo, model, gain)
        return cycle_beside(self.loop, self._bare)

    def _foot(self) -> Any:
        """The cycle from which the branch in the gain is followed: the same for most gains, as `_start`.

        Where none is found at a lower gain it is the present one.  Raises NoOrbit: there is none either.
        """
        servo, model = self.problem[:2]
        low = BELOW_THE_GAIN ** (math.floor(math.log(self.problem.gain, BELOW_THE_GAIN)) - 1)
        for gain in (part * low for part in LOWER_GAINS):
            if ("foot", gain) not in self.memory:
                found = None
                with suppress(NoOrbit):
                    bare = None if servo is None else find_orbit(servo, model, gain)
                    found = cycle_beside(self.loop.replace(gain=gain), bare)
                self.memory["foot", gain] = found
            if (found := self.memory["foot", gain]) is not None:
                return found
        if self.orbit is None:
            raise NoOrbit("no hunting was found at this gain or below, from which its cycles could be followed")
        return self.orbit

    def border(self) -> dict[str, Any]:
        """The gain at which hunting ends, and the size of the remedy that ends it at this gain.

        Where `hunts` has found nothing, and one of them is farther on, a branch may lead to a cycle all the same.
        """
        remedy, found = self.problem.remedy, self._size_border()
        if remedy is not None and found is not None and found.first is not None:
            self._led_to(found.first, remedy.size, found.size, remedy.sense)
        try:
            fold = self._fold()
        except NoOrbit as why:
            shown = refused(why)
        else:
            self._led_to(self._foot(), GAIN, fold.value)
            shown = self._gain_border(fold.value, fold.value_error)
        return shown | (self._remedy_border(remedy, found) if remedy is not None else {})

    def _led_to(self, first: Any, name: str, last: float, sense: int = 1) -> None:
        """Where no cycle was found, that of a branch, from `first` in `name`, which ends at `last` or goes on there."""
        present = self.loop.value(name)
        if self.verdict in HUNTING or not sense * (last - present) > 0:
            return
        with suppress(NoOrbit, effort.GivenUp):
            branch = follow(first, name, to=present, options=ROUGH, monitors=())
            if branch.values[-1] == present:
                self.later = self._of_cycle(branch.orbits[-1], partly=self.rests)

    def _fold(self) -> Fold[Any]:
        """The fold of the branch in the gain, found once for all gains that it is followed for.  Raises NoOrbit."""
        foot = self._foot()
        key = "fold", foot.problem.value(GAIN)
        if key not in self.memory:
            way = [foot]
            self.memory[key] = fold_in(foot, GAIN, options=ROUGH, progress=way.append), way
        found: Fold[Any] = self.memory[key][0]
        return found

    def _remedy_border(self, remedy: Remedy, found: Border | None) -> dict[str, Any]:
        """The smallest size of the remedy that ends hunting at this gain."""
        if found is None:
            return {"remedy_why": "without the remedy no hunting was found either, that it could end"}
        if found.kind not in BORDERS:
            # What is said where no size of a remedy was found that ends hunting
            if math.isnan(found.size):
                why = f"not found: no hunting cycle with little {remedy.name} was found to begin with"
                return {"remedy_why": why, "evidence": found.evidence}
            size = f"{brief(found.size)} {remedy.unit}".rstrip()
            if found.kind == "none":
                return {"remedy_why": f"hunting goes on up to {size}"}
            return {"remedy_why": f"not found: hunting was followed up to {size} only", "evidence": found.evidence}
        error = found.error / abs(found.size) if found.size else math.nan
        self.more = ends_at(f"the {remedy.name}", remedy.unit, found.size, self.loop.value(remedy.size), error,
                            self.verdict, remedy.sense)  # fmt: skip
        return {
            "size": shown_number(found.size, error), "size_unit": remedy.unit, "size_name": remedy.name,
            "sentence": sentence_of((self.said, self.more)),
        }  # fmt: skip

    def _size_border(self) -> Border | None:
        """Where the remedy ends hunting at this gain; None without a remedy, or without a cycle that it could end."""
        remedy, without, bare = self.problem.remedy, self.problem.without, self._bare
        if remedy is None or without is None or bare is None:
            return None
        memory = self.remembered(remedy.size)  # it does not depend on the present size
        if "border" not in memory:
            memory["border"] = border(without, remedy, Swing.of(bare), ROUGH)
        found: Border = memory["border"]
        return found

    def diagram(self) -> dict[str, Any]:
        """Amplitude against gain, from a cycle up, round the fold and back."""
        foot = self._foot()
        low = foot.problem.value(GAIN)
        if ("diagram", low) not in self.memory:
            known = ("fold", low) in self.memory
            fold, way = self.memory["fold", low] if known else (None, [foot])
            self.drawn += way  # what led to the fold is the first part of the branch
            branch = follow(way[-1], GAIN, to=low * FAR_ABOVE, back=low, options=DRAWN_CYCLES, monitors=(),
                            previous=way[-2] if len(way) > 1 else None, largest_step=DIAGRAM_STEP,
                            max_points=MOST_DIAGRAM_POINTS, progress=self.drawn.append)  # fmt: skip
            self.memory["diagram", low] = branches_shown(
                [*way[:-1], *branch.orbits], None if fold is None else fold.orbit
            ) | (left_open(branch.orbits) if branch.end.kind in UNFINISHED else {})
        return {**self.memory["diagram", low], "present": self.problem.gain}


def cycle_beside(loop: Loop, bare: Any) -> Any:
    """The cycle of a loop on which a motion settles that starts on a servo's own cycle, or from rest beside its aim.

    bare: the servo's cycle, or None. Raises NoOrbit.
    """
    start = loop.at_rest(-FIRST_OFF) if bare is None else loop.state(**on_the_cycle(bare))
    return loop_cycle(loop, start=start, options=ROUGH)
