"""The stages (worker.py) of a servo, or of a loop of parts.

    step          followed for three periods, or a hundred reset times where there is no cycle
    diagram       of a servo from a twentieth of its fold gain, or below the present one; round the fold and back;
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
from ...design.remedies.border import BORDERS, Border, border
from ...errors import ComesToRest, HuntsIrregularly, NoOrbit
from ...orbits import Options, Orbit, SystemOrbit
from ...servo.find_fold import find_fold
from ...servo.find_orbit import find_orbit
from ...servo.linear.margins import margins_of_parts
from ...servo.other_end import other_end
from ...servo.outcome import SETTLES
from ...servo.parts import Loop, Remedy, loop_of
from ...servo.parts.exponent import told
from ...servo.parts.fate import Swing, on_the_cycle
from ...servo.parts.verbs import first_off, fold_in
from ...servo.servo import Servo
from ...servo.simulate import simulate
from ...servo.units import GAIN_UNIT
from ..answers.answer import ENDS
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
DRAWN_CYCLES, DIAGRAM_STEP, MOST_DIAGRAM_POINTS = Options(tol=1e-4, provisional=True), 0.4, 120
"""Of the cycles of a diagram, whose errors nobody reads."""
UNFINISHED = ("stuck", "points")
"""Ends of a branch behind which it goes on."""
LOWER_GAINS = (1.0, 0.25, 0.0625)
"""Parts of that gain at which a cycle of a loop is looked for in turn."""
FAR_ABOVE = 1e3
"""A branch of a loop is followed up to so many times the gain."""
ROUGH = Options(tol=1e-6)
"""Tolerance of the numbers of a loop."""


class Stages:
    """The stages of a state."""

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
        try:
            return self._of_cycle(self._cycle_at(self.problem.gain, Options()))
        except ComesToRest as rests:
            self.verdict, self.rests, more = "unknown", True, {"evidence": str(rests)}
            self.said = "No hunting was found: from every start that was tried it comes to rest."
        except HuntsIrregularly as irregular:
            self.verdict, more = "uneven", {"why": "none: no swing repeats", "evidence": told(irregular)}
            low, high = irregular.amplitude
            self.said = f"It hunts irregularly: it turns {low:.4g} to {high:.4g} rad from the set point."
        except NoOrbit as why:
            proved = why.status is None
            self.verdict, more = "rests" if proved else "unknown", refused(why)
            self.said = "It does not hunt at this gain." if proved else "Whether it hunts is not known."
        return {"verdict": self.verdict, "sentence": self.said, **more}

    def _of_cycle(self, orbit: Orbit, *, partly: bool = False) -> dict[str, Any]:
        self.orbit, stable = orbit, orbit.stable
        self.said = hunts(orbit.amplitude, orbit.period, stable, partly=partly)
        self.verdict = "hunts" if stable else "uneven" if stable is False else "can"
        times, states = orbit.sample(CYCLE_POINTS)
        names, own = self.loop.system.states, orbit.problem.system.states  # a servo counts them in its own order
        states = states[[own.index(name) for name in names]]
        angle = next((states[names.index(name)] for name in self.loop.angles), states[0])
        velocity = states[names.index("x2")] if "x2" in names else np.gradient(angle, times)
        # Torque of the motor along a cycle, which may be closed by its mirror image (orbit.repeats = 2)
        ends = np.cumsum([arc.duration for arc in orbit.arcs])
        half = times.size if orbit.repeats == 1 else (times.size - 1) // 2
        of = np.searchsorted(ends, times[:half], side="right").clip(max=len(ends) - 1)
        torque = np.empty(half)
        for i, arc in enumerate(orbit.arcs):
            at = of == i
            if at.any():
                torque[at] = self.loop.signal("torque", arc.mode, states[:, :half][:, at])
        torque = torque if orbit.repeats == 1 else np.concatenate([torque, -torque, torque[:1]])
        return {
            "verdict": self.verdict, "sentence": self.said,
            "amplitude": shown_number(orbit.amplitude, orbit.amplitude_error),
            "period": shown_number(orbit.period, orbit.period_error),
            "cycle": curve(time=times, angle=angle, velocity=velocity, torque=torque),
        }  # fmt: skip

    def _cycle_at(self, gain: float, options: Options) -> Orbit:
        """The cycle at a gain, of a servo with these options.  Raises NoOrbit.

        Of a servo with load or remedy it is the one on which a motion settles that starts on the cycle of the servo
        alone, or where that has none, from rest beside its aim.
        """
        servo, model = self.problem[:2]
        loop = self.loop.replace(gain=gain)
        if servo is None:
            return find_orbit(loop, options=ROUGH)
        if self.problem.loop is None:
            return find_orbit(servo, model, gain, options=options)
        bare = self._bare_at(gain)
        start = loop.at_rest(-first_off(loop)) if bare is None else on_the_cycle(bare)
        return find_orbit(loop, start=start, options=ROUGH)

    def _bare_at(self, gain: float) -> Orbit | None:
        """The cycle of the servo without load and remedy at a gain; None where none is found."""
        with suppress(NoOrbit):
            return find_orbit(cast(Servo, self.problem.servo), self.problem.model, gain)
        return None

    @cached_property
    def loop(self) -> Loop:
        """The servo as a loop of parts."""
        servo, model, gain = self.problem[:3]
        return self.problem.loop or loop_of(cast(Servo, servo), model, gain)

    def linear(self) -> dict[str, Any]:
        """Friction curve and margins, where there are any."""
        numbers, linear = self.loop.parameters, margins_of_parts(self.loop)
        known = {"static", "coulomb", "stribeck_velocity", "viscous"} <= set(numbers)
        shown = {"friction": friction_curve(numbers)} if known else {}
        if linear is None:
            return {**shown, "why": "with this part the loop is not linear: it has no margins"}
        return {**shown, **margins_shown(linear)}

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
        # Where a step ends; and where it comes to rest though the servo can hunt, from which start that does
        kind = motion.verdict.kind
        ends = f"the step ends: {ENDS[kind].state}" if kind != "undecided" else "where the step ends is not seen yet"
        if self.verdict not in HUNTING or kind not in SETTLES:
            return shown | {"ends": ends}
        assert self.orbit is not None
        self.said = hunts(self.orbit.amplitude, self.orbit.period, self.orbit.stable, partly=True)
        with suppress(effort.GivenUp):
            other = other_end(motion)
            ends += f"; {hunts_from(other.start)}" if other is not None and other.hunts else ""
        return shown | {"ends": ends, "sentence": sentence_of((self.said, self.more))}

    def _foot(self) -> Orbit:
        """The cycle from which the branch in the gain is followed: the same for most gains, so that a move along it
        computes nothing.

        Where none is found at a lower gain it is the present one.  Raises NoOrbit: there is none either.
        """
        present = self.problem.gain
        low = BELOW_THE_GAIN ** (math.floor(math.log(present, BELOW_THE_GAIN)) - 1)
        if self.problem.loop is None:
            try:
                low = self._fold().value / BELOW_THE_FOLD
                while low > present:
                    low /= BELOW_THE_GAIN
            except NoOrbit as why:
                if self.orbit is None and why.status is None:  # it hunts at no gain
                    raise
                low = present / BELOW_THE_GAIN
        for gain in (part * low for part in LOWER_GAINS):
            if ("foot", gain) not in self.memory:
                self.memory["foot", gain] = None
                with suppress(NoOrbit):
                    self.memory["foot", gain] = self._cycle_at(gain, Options(tol=DRAWN_CYCLES.tol))
            if (found := self.memory["foot", gain]) is not None:
                return found
        if self.orbit is None:
            raise NoOrbit("no hunting was found at this gain or below, from which its cycles could be followed")
        return self.orbit

    def _fold(self) -> Fold[Any]:
        """The fold, found once for all gains of a servo, or for all with one foot.  Raises NoOrbit."""
        servo, model = self.problem[:2]
        if self.problem.loop is None and servo is not None:
            if "fold" not in self.memory:
                self.memory["fold"] = find_fold(servo, model)
            return cast(Fold[Any], self.memory["fold"])
        foot = self._foot()
        key = "fold", foot.problem.value(GAIN)
        if key not in self.memory:
            way = [foot]
            fold = fold_in(cast(SystemOrbit, foot), GAIN, options=ROUGH, progress=way.append)
            self.memory[key], self.memory["way", key[1]] = fold, way
        return cast(Fold[Any], self.memory[key])

    def border(self) -> dict[str, Any]:
        """The gain at which hunting ends, and the size of the remedy that ends it at this gain.

        Where `hunts` has found nothing, and one of them is farther on, a branch may lead to a cycle all the same.
        """
        remedy, without, found = self.problem.remedy, self.problem.without, None
        if remedy is not None and without is not None:
            memory = self.remembered(remedy.size)  # it does not depend on the present size
            if "border" not in memory:
                bare = self._bare_at(self.problem.gain)
                memory["border"] = None if bare is None else border(without, remedy, Swing.of(bare), ROUGH)
            found = memory["border"]
        if remedy is not None and found is not None and found.first is not None:
            self._led_to(lambda: found.first, remedy.size, found.size, remedy.sense)
        try:
            fold = self._fold()
        except NoOrbit as why:
            shown = refused(why)
        else:
            self._led_to(self._foot, GAIN, fold.value)
            gain, value, error = self.problem.gain, fold.value, fold.value_error
            self.more = ends_at("the gain", GAIN_UNIT, value, gain, error, self.verdict)
            shown = {
                "gain": shown_number(value, error), "ratio": ratio_shown(value, gain, error, self.verdict),
                "sentence": sentence_of((self.said, self.more)),
            }  # fmt: skip
        return shown | (self._remedy_border(remedy, found) if remedy is not None else {})

    def _led_to(self, first: Callable[[], Any], name: str, last: float, sense: int = 1) -> None:
        """Where no cycle was found, that of a branch from `first()` in `name`, which ends at `last` or goes on."""
        present = self.loop.value(name)
        if self.verdict in HUNTING or not sense * (last - present) > 0:
            return
        with suppress(NoOrbit, effort.GivenUp):
            branch = follow(first(), name, to=present, options=ROUGH, monitors=())
            if branch.values[-1] == present:
                self.later = self._of_cycle(branch.orbits[-1], partly=self.rests)

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

    def diagram(self) -> dict[str, Any]:
        """Amplitude against gain, from a cycle up, round the fold and back."""
        foot = self._foot()
        low = foot.problem.value(GAIN)
        if ("diagram", low) not in self.memory:
            fold = self.memory.get("fold") or self.memory.get(("fold", low))
            way = self.memory.get(("way", low), [foot])
            self.drawn += way  # what led to the fold is the first part of the branch
            branch = follow(way[-1], GAIN, to=low * FAR_ABOVE, back=low, options=DRAWN_CYCLES, monitors=(),
                            previous=way[-2] if len(way) > 1 else None, largest_step=DIAGRAM_STEP,
                            max_points=MOST_DIAGRAM_POINTS, progress=self.drawn.append)  # fmt: skip
            self.memory["diagram", low] = branches_shown(
                [*way[:-1], *branch.orbits], None if fold is None else fold.orbit
            ) | (left_open(branch.orbits) if branch.end.kind in UNFINISHED else {})
        return {**self.memory["diagram", low], "present": self.problem.gain}

    def so_far(self) -> dict[str, Any]:
        """What is known of the diagram where it was given up; {} where that is no curve."""
        if len(self.drawn) < 2:
            return {}
        return {**branches_shown(self.drawn), **left_open(self.drawn), "present": self.problem.gain}
