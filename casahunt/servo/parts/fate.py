"""What becomes of a motion of a loop, event by event: it rests, decays, hunts, or grows.

    turns      places t_k at which x1 turns back, by more than a bristle springs;   swings s_k = |t_k - t_(k-1)|

    at rest    nothing moves any more: a phase without an end, or no state in the second half of a look; or it is at the
               set point, but for rounding
    decaying   the swings shrank geometrically down their last decade, whatever their size: towards a smaller cycle they
               would shrink ever more slowly
    hunting    the turns repeat, n by n or mirrored, of whatever size they are; or what they still change by shrinks
               geometrically, and leaves them their size; or they neither repeat nor shrink nor grow, for
               `TURNS_OF_A_FATE`: it hunts irregularly
    growing    its swings have become so large that they are beyond any hunting
    undecided  none of these with the work that is allowed, or it cannot be followed

A motion is followed once, in looks that become longer; where it has events, its fate ends it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ... import effort
from ...motion import MarchFailure, Motion, Segment, march
from ...orbits import Orbit
from ..outcome import Kind
from .loop import Loop
from .lugre import LUGRE
from .part import Edge, Part, PartMode
from .turns import PATTERN, drifts, grows, may_settle, settles, shrinks, width

Array = np.ndarray
Points = Literal["gauss", "radau"]
LOOK_OF_A_FATE, MOST_LOOKS = 8.0, 40
"""Periods of the first look at a motion; each next one is twice as long: of swings that shrink to a twelfth each stick
lasts twelve times as long, and five of them are to be seen."""
WORK_OF_A_FATE = 2e5
"""Work (effort.py) of a motion; most take a tenth."""
TOLERANCE_OF_A_FATE, TO_BE_SAMPLED = 1e-7, 1e-9
"""Error of an interval; and where the motion is sampled, whose largest torque is looked for among its points."""
MOVES_NOT = 1e-7
"""A state that moves by less than this part of its size stands still."""
ROUNDING_OF_A_STATE = 1e-12
"""A state that is so small a part of its size is zero."""
ALIKE_PATTERNS, TURNS_OF_A_FATE = 1e-4, 240
"""How well a shorter pattern repeats which is told instead; turns after which a motion repeats in none: twice as many
where it still comes from far away."""
HANDED_ON = 6
"""Of irregular hunting that is handed on to another servo so many times fewer turns are followed: it is there already,
and hunts on where its swings become no smaller, in a pattern or in none."""
REPEATS_NOT, DIFFERS, AS_MUCH_AS_BEFORE = 0.1, 1e-3, 2.0
"""Swings that differ by more than the first part for so long, without becoming smaller, repeat in no pattern; or by
more than the second, and by as much as before but for a factor: of a motion that leaves a cycle, or comes to one, they
differ by ever more, or ever less."""
LEFT_OF_A_SWING = 0.05
"""What is left of the changes of turns that shrink geometrically, in swings, of motions that are handed on."""
NEARLY_THERE = 1e-5
"""What is left of them elsewhere: on a longer way an event may end hunting, as where a stop becomes as long as the time
after which an integrator is frozen."""
GROWN_BY, FARTHER_BY = 50.0, 2.0
"""So many times as large as the hunting before, and as at its start, a motion grows, if its last swing leads so many
times as far as its first: what was thrown far away comes back."""
LAST_TURNS_MEASURE, LEFT_OF_SIZES = 5, 1e-6
"""Turns that tell how far a motion has come down from where it began, and the least part of that which counts."""
NO_TURN = 1e-10
"""What turns back by less, in sizes of the state, does so by rounding."""
SPRINGS_BY, MOST_SPRINGS = 3.0, 400
"""A stuck LuGre servo springs on its bristles, which static friction bends by Fs/sigma0: what moves back by no more
than so many times that is no turn, but for one that does so many times in a row, and no more than that."""
TURNS = Part("turns", modes=(PartMode("", ends=(Edge("turn", lambda x, s, p: s.motor_rate, 0, ""),)),))
"""Where nothing else happens, the turns of a motion are events."""


@dataclass(frozen=True, eq=False)
class Swing:
    """Hunting: a state on it, its amplitude [rad] and period [s], the sizes of the states; whether it is irregular: its
    period is then the mean one."""

    state: dict[str, float]
    amplitude: float
    period: float
    sizes: dict[str, float] = field(default_factory=dict)
    irregular: bool = False

    @classmethod
    def of(cls, cycle: Orbit) -> Swing:
        """That of a cycle."""
        sizes = dict(zip(cycle.problem.system.states, cycle.scale.tolist(), strict=False))
        return cls(on_the_cycle(cycle), cycle.amplitude, cycle.period, sizes)


def on_the_cycle(orbit: Orbit) -> dict[str, float]:
    """A state of a cycle away from events: where something has just stopped, or in mid-slip."""
    stuck = next((arc for arc in orbit.arcs if "stick" in arc.mode), None)
    states = (stuck or orbit.arcs[0]).states
    largest = np.max([np.abs(arc.states).max(axis=(0, 1)) for arc in orbit.arcs], axis=0)
    state = states[0, states.shape[1] // 2]
    state = np.where(np.abs(state) > ROUNDING_OF_A_STATE * largest, state, 0.0)  # a rounding of zero would slip
    return dict(zip(orbit.problem.system.states, state.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Fate:
    """What became of a motion.

    Attributes
    ----------
    kind : see the module.
    turns : (k,) places at which x1 turned back [rad].
    motion : its phases.
    swing : where it hunts, that.
    at : times of the turns but the last [s].
    pattern : swings after which it repeats; 0 where it hunts irregularly, or does not.
    """

    kind: Kind
    turns: Array
    motion: Motion
    swing: Swing | None = None
    at: Array = field(default_factory=lambda: np.zeros(0))
    pattern: int = 0

    @property
    def still_grows(self) -> bool:
        """Whether it is not decided, and has become larger from swing to swing as far as it was followed."""
        return self.kind == "undecided" and grows(np.abs(np.diff(self.turns[:-1])), TURNS_OF_A_FATE // 4)


@dataclass
class _Watched:
    """A motion that is being followed, of which more is known with each phase."""

    loop: Loop
    before: Swing
    scale: Array
    start: float
    rest: float
    meshed: bool
    grown: float
    phases: list[Segment] = field(default_factory=list)
    time: float = 0.0
    turns: list[float] = field(default_factory=list)
    at: list[float] = field(default_factory=list)
    """Times of the turns."""
    way: float = 0.0
    """The direction of x1, 0 as long as it has not moved."""
    springs: int = 0
    """Times that it has sprung back a little since the last turn."""
    farthest: tuple[float, float] = (0.0, 0.0)
    """Time and x1 of the last place."""
    outcome: Kind | None = None
    repeats: tuple[int, bool] = (0, False)
    """Turns of the pattern, and whether its mirror image follows."""

    def __post_init__(self) -> None:
        self.system, self.sizes = self.loop.system, self.scale
        self.place = self.system.states.index("x1")
        self.farthest = 0.0, self.start
        self.kind: Points = "radau" if any(mode.stiff for mode in self.system.modes) else "gauss"
        self.tol = TO_BE_SAMPLED if self.meshed else TOLERANCE_OF_A_FATE
        bristles = LUGRE in self.loop.present
        spring = SPRINGS_BY * self.loop.value("static") / self.loop.value("stiffness") if bristles else 0.0
        self.spring = spring if spring < self.before.amplitude else 0.0  # or it is bristles that hunt
        self.meshed |= not all(mode.ends for mode in self.system.modes)  # turns are no events there

    def motion(self, phases: list[Segment]) -> Motion:
        """Phases as a motion."""
        return Motion(self.system, self.system.values(None), tuple(phases), math.nan, self.scale, self.kind)

    def measure(self, since: int) -> None:
        """Let sizes of the states, by which it is followed, be those of the last look: it may come from far away."""
        swings, last = np.abs(np.diff(self.turns[-LAST_TURNS_MEASURE:])), self.phases[since:]
        if swings.size < LAST_TURNS_MEASURE - 1 or not last:
            return
        part = min(max(float(swings.max() / self.scale[self.place]), LEFT_OF_SIZES), 1.0)
        late = np.max([np.abs(segment.nodes).max(axis=0) for segment in last[len(last) // 2 :]], axis=0)
        self.sizes = np.clip(late[: self.scale.size], part * self.scale, self.scale)

    def seen(self, segment: Segment) -> bool:
        """A phase more; whether it decides."""
        self.phases.append(segment)
        if math.isinf(segment.duration):  # what is kept of it is as long as a look at first
            self.phases[-1] = replace(segment, duration=LOOK_OF_A_FATE * self.before.period)
            self.outcome = "at rest"
            return True
        many = len(self.turns)
        for t, x in self._places(segment):
            self._place(self.time + t, x)
        self.time += segment.duration
        if len(self.turns) > many:
            self.outcome = self._told()
        if self.outcome is None and segment.event and self._is_there(segment.end[:, None]):
            self.outcome = "at rest"
        return self.outcome is not None

    def _is_there(self, states: Array) -> bool:
        """Whether states (n, m) are those at the set point, but for rounding."""
        rate = self.system.states.index("x2") if "x2" in self.system.states else self.place
        near = np.abs(states[self.place]).max() <= MOVES_NOT * self.before.amplitude
        return bool(near and np.abs(states[rate]).max() <= MOVES_NOT * self.scale[rate])

    def _places(self, segment: Segment) -> list[tuple[float, float]]:
        """Time and x1 of the end of a phase, and of where it turns inside."""
        ends = float(segment.start[self.place]), float(segment.end[self.place])
        if segment.w.shape[0] > 1:
            inside, meshed = segment.w[:, self.place], segment.w.shape[1] > segment.end.size
            by = 0.0 if meshed else NO_TURN * self.scale[self.place]
            if inside.max() > max(ends) + by or inside.min() < min(ends) - by:
                times, states = self.motion([segment] if meshed else self._again(segment)).sample()
                x = states[self.place]
                return [_top(times, x, i) for i in _tops(x)] + [(segment.duration, ends[1])]
        return [(segment.duration, ends[1])]

    def _again(self, segment: Segment) -> list[Segment]:
        """A phase with a mesh."""
        return march(
            self.system.vector_form, segment.mode, segment.start, self.system.values(None), scale=self.sizes,
            until=lambda _: True, tol=self.tol, kind=self.kind, max_time=segment.duration,
        )  # fmt: skip

    def _place(self, t: float, x: float) -> None:
        """The next place on the way of x1."""
        moved = x - self.farthest[1]
        if abs(moved) <= NO_TURN * self.scale[self.place]:
            return
        if moved * self.way < 0:
            self.springs += 1
            if self.springs < MOST_SPRINGS and abs(moved) <= self.spring:
                return
            self.springs = 0
            self.at.append(self.farthest[0])
            self.turns.append(self.farthest[1])
        self.way, self.farthest = math.copysign(1.0, moved), (t, x)

    def _told(self) -> Kind | None:
        """What the turns tell."""
        turns = np.array(self.turns)
        swings = np.abs(np.diff(turns))
        if swings.size < 3:
            return None
        far = np.abs(turns[-2:]).max() > min(GROWN_BY * max(self.before.amplitude, abs(self.start)), self.grown)
        if far and swings[-1] > FARTHER_BY * swings[0]:
            return "growing"
        for n, mirror in may_settle(turns):
            if settles(self.turns, n, mirror, self.rest):
                self.repeats = self._shortest(n, mirror)
                return "hunting"
        if shrinks(swings):
            return "decaying"
        fewer = HANDED_ON if self.before.irregular else 1
        if swings.size < TURNS_OF_A_FATE // fewer:
            return None
        quarter = TURNS_OF_A_FATE // fewer // 4
        late, earlier = swings[-quarter:], swings[-2 * quarter : -quarter]
        differ, before = np.ptp(late), np.ptp(earlier)
        irregular = differ > REPEATS_NOT * late.max()
        irregular |= differ > DIFFERS * late.max() and before / AS_MUCH_AS_BEFORE < differ < AS_MUCH_AS_BEFORE * before
        settled = late.max() > (1 - LEFT_OF_A_SWING / fewer) * earlier.max()
        if (irregular or fewer > 1) and settled and not grows(swings, quarter) and not drifts(swings[-2 * quarter :]):
            self.repeats = quarter, False
            return "hunting"
        comes = not settled or differ <= before / AS_MUCH_AS_BEFORE
        return None if swings.size < (1 + comes) * TURNS_OF_A_FATE else "undecided"

    def _shortest(self, most: int, mirror: float) -> tuple[int, bool]:
        """The shortest pattern that the turns repeat in, where a longer one was found to settle."""
        for n in range(1, most):
            for sign in (-1.0, 1.0):
                last, before = self.turns[-n:], [sign * x for x in self.turns[-2 * n : -n]]
                if max(abs(a - b) for a, b in zip(last, before, strict=True)) <= ALIKE_PATTERNS * width(last, sign):
                    return n, sign < 0
        return most, mirror < 0

    def stands(self, since: int) -> bool:
        """Whether no state moved in the second half of the last look, or it is at the set point."""
        looked = self.phases[since:]
        ends = np.cumsum([segment.duration for segment in looked])
        times = np.concatenate([end - (1 - s.breaks) * s.duration for end, s in zip(ends, looked, strict=True)])
        many, states = len(self.system.states), np.vstack([segment.nodes for segment in looked])
        begins = max(int(np.searchsorted(times, ends[-1] / 2)) - 1, 0)  # one step may be all of it
        late = states[begins:, :many].T
        return bool(np.all(np.ptp(late, axis=1) <= MOVES_NOT * self.scale[:many])) or self._is_there(late)

    def swing(self) -> Swing:
        """The hunting that it has come to."""
        n, mirrored = self.repeats
        turns, period = np.array(self.turns[-2 * n - 1 :]), self.at[-1] - self.at[-1 - n]
        stopped = next((s for s in reversed(self.phases) if "stick" in s.mode), self.phases[-1])
        sizes, irregular = dict(zip(self.system.states, self.scale.tolist(), strict=False)), n > PATTERN
        period *= 2 / n if irregular else 2 if mirrored else 1
        return Swing(self.named(stopped.start), float(np.ptp(turns)) / 2, period, sizes, irregular)

    def named(self, x: Array) -> dict[str, float]:
        """States by name; nothing, where rounding has left something."""
        kept = np.where(np.abs(x) > ROUNDING_OF_A_STATE * self.scale, x, 0.0)
        return dict(zip(self.system.states, kept.tolist(), strict=False))


def fate(
    loop: Loop, start: Mapping[str, float], before: Swing, rest: float = NEARLY_THERE, meshed: bool = False,
    work: float = WORK_OF_A_FATE, mode: str = "", grown: float = math.inf,
) -> Fate:  # fmt: skip
    """What becomes of a motion.

    start: its states at the start, by name, all others zero; before: the hunting that is to end, which measures it;
    rest: how near to a cycle it hunts, in its swings; meshed: its motion is to be sampled; work: allowed (effort.py);
    mode: in which it starts, where it goes on from another motion; grown: from where motions are known to grow.
    """
    if not meshed and not any(each.ends or each.flow for each in loop.system.modes):
        loop = loop.with_parts(TURNS)
    state = loop.state(**start)
    sizes = [before.sizes.get(name) or abs(value) or 1.0 for name, value in state.items()]
    watched = _Watched(loop, before, np.array(sizes), state["x1"], rest, meshed, grown)
    x, name, length = np.array(list(state.values())), mode or loop.mode_at(**state), LOOK_OF_A_FATE * before.period
    try:
        with effort.at_most(work):
            for _ in range(MOST_LOOKS):
                x, name, length = _look(watched, x, name, length)
                if watched.outcome is not None:
                    break
    except (MarchFailure, effort.PartGivenUp) as failure:
        if mode and not watched.phases and isinstance(failure, MarchFailure):  # rounding of an end contradicts its mode
            return fate(loop, start, before, rest, meshed, work, grown=grown)
        watched.outcome = None
    kind = watched.outcome or "undecided"
    swing = watched.swing() if kind == "hunting" else None
    n, mirrored = watched.repeats
    pattern = (2 * n if mirrored else n) if swing is not None and n <= PATTERN else 0
    turns = np.array([*watched.turns, watched.farthest[1]])
    return Fate(kind, turns, watched.motion(watched.phases), swing, np.array(watched.at), pattern)


def _look(watched: _Watched, x: Array, mode: str, length: float) -> tuple[Array, str, float]:
    """A look at a motion: where the next one begins, and how long it is.  Raises MarchFailure, effort.PartGivenUp."""
    since = len(watched.phases)
    phases = march(
        watched.system.vector_form, mode, x, watched.system.values(None), scale=watched.sizes, until=watched.seen,
        tol=watched.tol, kind=watched.kind, max_time=length, strict=True, meshed=watched.meshed,
        max_intervals=sys.maxsize,  # its work is bounded
    )  # fmt: skip
    if watched.outcome is not None:
        return x, mode, length
    watched.measure(since)
    last, came_to_rest = phases[-1], len(phases) <= len(watched.phases) - since
    if not last.event and not came_to_rest:
        watched.seen(last)
    if not last.event:
        if watched.outcome not in ("hunting", "growing") and (came_to_rest or watched.stands(since)):
            watched.outcome = "at rest"
        return last.end, last.mode, 2 * length
    # a phase in closed form does not see the time: it is followed again, in a longer look
    del watched.phases[-1]
    watched.time -= last.duration
    return last.start, last.mode, 2 * max(length, last.duration)


def _tops(x: Array) -> Array:
    """Places (k,) of a polyline x (m,) at which it turns."""
    rising = np.sign(np.diff(x))
    return 1 + np.flatnonzero(rising[1:] * rising[:-1] < 0)


def _top(times: Array, x: Array, i: int) -> tuple[float, float]:
    """Time and value of the top of the parabola through three points of a motion."""
    (a, b), (d, e) = np.diff(times[i - 1 : i + 2]), np.diff(x[i - 1 : i + 2])
    if not min(a, b) > 0:
        return float(times[i]), float(x[i])
    slope, curve = (b * b * d + a * a * e) / (a * b * (a + b)), (e / b - d / a) / (a + b)
    back = -slope / (2 * curve) if curve else 0.0
    return float(times[i] + back), float(x[i] - curve * back * back)
