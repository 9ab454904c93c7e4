"""The distance from the set point within which a servo that stands still settles, and beyond which it hunts.

The servo stands at x1 = -a, held by friction.  Its integral winds up until it breaks away, and from swing to swing it
comes nearer to the set point, or to hunting.  Between the two lies what leads to an unstable cycle: from a little
nearer the swings die out, from a little farther off they grow.  Both is seen by following two motions to their end
(parts/fate.py), whatever parts the loop is made of.

    where it stands   filters have settled, the integral carries a constant load, and nothing more is wound up, or so
                      much that the pull, of controller and loads, is no more than 0.9 Fs of its direction; bristles
                      creep while they are bent, by the size of Fs/sigma0, so that with them the place is that at
                      0.9 Fs before breakaway
    the border        of one inertia with a PID, by its unstable cycle: its only free number behind a stick is a, and
                      the motions start delta a beside it.  Of other loops, whose masses may ring on while they stand,
                      by motions alone: a is halved until one settles, and the bracket down to `PARTED_BY`

What the swings grow to.  As a rule the stable cycle; past a symmetry breaking a lopsided one beside it; irregular
hunting; where the linear loop is unstable, nothing may bound them.  The border is the same.

delta: one rounding error of a grows to mu eps; delta = 0.01 is 1e-2/eps times larger and the first swing already takes
the motion away by mu delta.  The claim tested is that of the two sides; the digits are those of the cycle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..axis_units import in_its_units, several
from ..checks import of_kind, require
from ..errors import HuntsIrregularly, InputError, NoOrbit, Status
from ..export import Columns, columns_from
from ..orbits import Options, Orbit
from ..results import Result
from ..roots import boundary
from .event_map.half_cycle import SECTION
from .find_orbit import find_orbit
from .friction import Model
from .outcome import SETTLES, Kind
from .parts.fate import LEFT_OF_A_SWING, Swing, fate
from .parts.loop import OF_MOTION, Loop, breakaway_of, static_of
from .parts.lugre import LUGRE
from .parts.plain_loop import LoopResult, loop_asked, servo_of_loop
from .parts.verbs import loop_cycle
from .problem import HuntingOrbit, torque_of
from .servo import Servo

Array = np.ndarray

OFFSET = 0.01
"""`delta` of the module docstring."""
START_DOUBLED, START_HALVED, ON_AND_ON = 3, 16, 2
"""Starts beside the set point: from so many times twice as far as the servo hunts to so many times half as far, or
until one and so many more in a row settle, or are not decided."""
WORK_OF_A_MOTION = 3e5
"""Work (effort.py) of a motion; a tenth of that decides all but those whose masses ring for ever."""
PARTED_BY = 1e-5
"""Relative width of a bracket of motions: from nearer to an unstable cycle they may repeat to what tells a cycle."""
SHRUNK = 1e-2
"""A motion whose every turn was nearer than the one before, down to this part of its start, has settled: its sticks
last ever longer, and their end is not waited for."""
UNBENT = 1 - 1e-6
"""Of what a bristle is bent by at rest, so that it yields in the direction in which the torque grows."""

CSV_COLUMNS = ("from", "swing", "stick_position_rad", "outcome", "border_rad", "border_error_rad")
"""Columns of the table of a border: the places at which the two motions stand or turn."""


@dataclass(frozen=True, eq=False, repr=False)
class Trial(Result):
    """A motion followed from one side of the border.

    Attributes
    ----------
    start : distance from the set point at which it stands [rad].
    positions : (s + 1,) distances at which it stands or turns, `start` first [rad].
    outcome : what becomes of it, as of `Outcome`: "at rest", "decaying", "hunting", "growing" or "undecided".
    """

    _quantities = ("start [rad]", "outcome")
    _details = ("positions",)

    start: float
    positions: Array
    outcome: Kind

    @property
    def settles(self) -> bool:
        """Whether it rests or is on its way to."""
        return self.outcome in SETTLES

    @property
    def hunts(self) -> bool:
        """Whether it hunts, or leaves the set point for good."""
        return self.outcome in ("hunting", "growing")


@dataclass(frozen=True, eq=False, repr=False)
class Basin(LoopResult):
    """The border between settling and hunting.

    Attributes
    ----------
    loop : the servo, as a loop of parts.
    border : distance from the set point at which the servo stands [rad]: from nearer it settles.
    error_estimate : relative, of `border`.
    side : -1 or +1: on which side of the set point it stands; on the other one the border is no nearer.
    unstable : the unstable cycle, of one inertia with a PID; None of other loops.
    outer : the cycle in which the servo hunts, or the symmetric one beside that; None where it was not found.
    why_no_outer : why it was not, or how the servo hunts irregularly.
    irregular : whether it does.
    outer_position : where the outer cycle stands, or turns [rad]; nan where there is none.
    inside, outside : the motions from both sides.
    offset : relative distance from the border at which they start, at most.
    motions : how many were followed.

    Examples
    --------
    >>> from casahunt import Servo, basin
    >>> found = basin(Servo(), "switch", 0.5)
    >>> found.inside.outcome, found.outside.outcome, found.confirmed
    ('at rest', 'hunting', True)
    """

    _quantities = (
        "model", "gain [V/rad]", "border [rad] ~ error_estimate", "outer_position [rad]", "confirmed",
    )  # fmt: skip
    _details = (
        "unstable_amplitude = unstable.amplitude [rad]", "outer_amplitude = outer.amplitude [rad]", "unstable", "outer",
        "why_no_outer", "irregular", "inside", "outside", "offset", "side", "motions",
    )  # fmt: skip

    loop: Loop
    border: float
    error_estimate: float
    inside: Trial
    outside: Trial
    offset: float
    unstable: HuntingOrbit | None = None
    outer: Orbit | None = None
    why_no_outer: str = ""
    irregular: bool = False
    outer_position: float = math.nan
    side: int = -1
    motions: int = 2

    def _more(self) -> dict[str, Any]:
        multiplier, stable = (self.outer.half_multiplier, self.outer.stable) if self.outer else (None, None)
        return {"outer_half_multiplier": multiplier, "outer_stable": stable}

    def _columns(self) -> Columns:
        error = self.border * self.error_estimate
        rows = [
            (name, i, position, trial.outcome, self.border, error)
            for name, trial in (("inside", self.inside), ("outside", self.outside))
            for i, position in enumerate(trial.positions)
        ]
        return columns_from(CSV_COLUMNS, rows)

    @property
    def confirmed(self) -> bool:
        """The motion from inside settles, the one from outside does not."""
        return self.inside.settles and self.outside.hunts


@in_its_units
def basin(
    servo: Servo | Loop, model: Model | None = None, gain: float | None = None, *, options: Options | None = None,
    offset: float = OFFSET,
) -> Basin:  # fmt: skip
    """The distance from the set point within which a servo that stands still settles, checked by two motions.

    Parameters
    ----------
    servo, model, gain
        the servo, its friction model and gain K > 0 [V/rad]; or a loop of parts, without a model, at its own gain or
        another one.
    options
        tolerance of the cycles.
    offset
        of one inertia with a PID, relative distance from the border at which the two motions start, between 1e-6 and
        0.5; the outer one starts at most half-way to the outer cycle.

    Returns
    -------
    Basin: the border [rad], the two motions and the cycles that are known; without an outer cycle, why there is none.

    Raises
    ------
    InputError : a value out of range, or a loop without dry friction.
    NoOrbit : everything settles, as far as it was looked for; or from every distance it hunts; or a cycle was not
        computed.  Says which.

    Examples
    --------
    >>> from casahunt import Servo, basin
    >>> round(1e3 * basin(Servo(), "switch", 0.5).border, 3)  # mrad
    1.181
    """
    if not 1e-6 <= require("offset", offset) <= 0.5:
        raise InputError(f"offset = {offset:g}: must lie between 1e-6 and 0.5")
    options = of_kind("options", options or Options(), Options)
    loop = loop_asked(servo, model, gain)
    static_of(loop)  # refuses a loop without
    asked = servo_of_loop(loop) if isinstance(servo, Loop) else (servo, model, gain)
    return _of_a_loop(loop, options) if asked is None else _of_one_inertia(*asked, loop, options, offset)


def _of_a_loop(loop: Loop, options: Options) -> Basin:
    """The border by motions alone.  Raises NoOrbit."""
    outer, why = None, ""
    try:
        outer = loop_cycle(loop, options=options)
        hunting = Swing.of(outer)
    except HuntsIrregularly as irregular:
        hunting, why = irregular.swing, str(irregular)
    # The border by motions from rest, on the side where it is nearer
    motions = _Motions(loop, hunting)
    found = _on_a_side(motions, -1)
    if not (motions.follow(found.inside.start).settles and motions.follow(found.outside.start).hunts):
        found = min(found, _on_a_side(motions, +1), key=lambda each: each.border)
    found = replace(found, motions=motions.count)
    position = outer.amplitude if outer else math.nan
    return replace(found, outer=outer, why_no_outer=why, irregular=outer is None, outer_position=position)


def _of_one_inertia(servo: Servo, model: Any, gain: Any, loop: Loop, options: Options, offset: float) -> Basin:
    """The border by the unstable cycle of the servo.  Raises InputError, NoOrbit."""
    unstable = find_orbit(servo, model, gain, branch="unstable", options=replace(options, half=True))
    outer, why, outer_position = None, "", math.nan
    try:
        outer = find_orbit(servo, model, gain, options=options)
        outer_position = stick_position(outer)
    except NoOrbit as refusal:
        why = str(refusal)
    border, error = stuck_at(unstable)
    beyond = offset if outer is None else min(offset, 0.5 * abs(outer_position / border - 1))
    motions = _Motions(loop, Swing.of(outer or unstable))
    inside, outside = (motions.follow(-border * factor) for factor in (1 - offset, 1 + beyond))
    return Basin(motions.loop, border, error, inside, outside, offset, unstable, outer, why,
                 outer_position=outer_position)  # fmt: skip


@dataclass(eq=False)
class _Motions:
    """A loop whose motions are followed; the hunting that measures them; how many were."""

    loop: Loop
    hunting: Swing
    count: int = 0

    def follow(self, x1: float) -> Trial:
        """What becomes of the loop that stands still at x1 [rad]."""
        self.count += 1
        # Every state where the loop stands still at x1 [rad], held by friction: see the module
        loop = self.loop
        start, at = let_go(loop, x1)
        pull, level = pull_on(loop, at), SECTION * (breakaway_of(loop)[0] if x1 < 0 else -breakaway_of(loop)[1])
        bristles = LUGRE in loop.present
        if bristles or abs(pull) > abs(level):
            ki = float(loop.signal("ki", *at)[0]) if "x3" in start else 0.0
            if ki:
                # of the demand, which nothing limits; its filters settle anew
                beyond = float((loop.signal("demand", *at) - loop.signal("torque", *at))[0]) + pull - level
                start, pull = let_go(loop, x1, wound_up=beyond / ki)[0], level
            if bristles:
                start["x4"] = UNBENT * pull / loop.value("stiffness")
        seen = fate(self.loop, start, self.hunting, rest=LEFT_OF_A_SWING, work=WORK_OF_A_MOTION)
        positions = np.abs([x1, *seen.turns])
        shrunk = np.all(np.diff(positions) < 0) and positions[-1] < SHRUNK * positions[0]
        return Trial(abs(x1), positions, "decaying" if seen.kind == "undecided" and shrunk else seen.kind)


def let_go(loop: Loop, x1: float, wound_up: float = 0.0) -> tuple[dict[str, float], tuple[str, Array]]:
    """A loop that stands still at x1 [rad]: every state, and its mode with the states as (n, 1).

    wound_up: of the integral, beside what carries the load [rad s].
    States of filters have come to their end: c' = A c + b in decaying directions, as they were in those that integrate.
    """
    start = loop.at_rest(x1)
    if wound_up:
        start["x3"] += wound_up
    mode = loop.system.vector_form.modes[loop.mode_at(**start)]
    at = [i for i, name in enumerate(start) if name not in (*loop.angles, *OF_MOTION, "x3")]
    if at:
        x = ca.SX.sym("x", len(start))
        rate = mode.field(x, ca.DM(loop.system.values(None)), mode.sign)[at]
        both = ca.Function("both", [x], [ca.jacobian(rate, x[at]), rate])
        A, b = (np.array(each) for each in both(ca.DM(list(start.values()))))
        values, V = np.linalg.eig(A)
        falls = values.real < 0
        settled = V[:, falls] @ (np.linalg.solve(V, b)[falls] / -values[falls][:, None])
        for i, moved in zip(at, settled[:, 0].real, strict=True):
            start[list(start)[i]] += float(moved)
    return start, (loop.mode_at(**start), np.array(list(start.values()))[:, None])


def pull_on(loop: Loop, at: tuple[str, Array]) -> float:
    """The net pull of controller and loads [N m] on what stands, as of `let_go`; what acts by the sign of a slip is
    left out."""
    return float((loop.signal("pull", *at) - loop.signal("compensation", *at))[0])


def _on_a_side(motions: _Motions, side: int) -> Basin:
    """The border on one side of the set point.  Raises NoOrbit."""
    seen: dict[float, Trial] = {}

    def hunts(a: float) -> bool:
        seen[a] = motions.follow(side * a)
        return seen[a].hunts

    settled = undecided = 0
    for k in range(START_DOUBLED, -START_HALVED, -1):
        a = motions.hunting.amplitude * 2.0**k
        if hunts(a):
            settled = undecided = 0
        settled, undecided = settled + seen[a].settles, undecided + (seen[a].outcome == "undecided")
        if max(settled, undecided) > ON_AND_ON and any(trial.hunts for trial in seen.values()):
            break
    hunting = [a for a, trial in seen.items() if trial.hunts]
    inner = max((a for a, trial in seen.items() if trial.settles and a < min(hunting, default=0.0)), default=0.0)
    if not inner:
        many = ", ".join(f"{n} {word}" for word, n in (
            ("hunt", len(hunting)), ("settle", sum(trial.settles for trial in seen.values())),
            ("are not decided", sum(trial.outcome == "undecided" for trial in seen.values())),
        ) if n)  # fmt: skip
        where = several((min(seen), max(seen)), "rad", ".2g", " to ")
        starts = f"{len(seen)} starts at rest, {where} beside the set point"
        sentence = f"no border of coming to rest was found of {motions.loop.name}: of {starts}, {many}"
        raise NoOrbit(f"{sentence}; casahunt simulate follows one of them", Status.NOT_FOUND)
    low, high = boundary(hunts, inner, min(hunting), width=PARTED_BY * inner)
    inner = max(a for a, trial in seen.items() if trial.settles and a <= low)
    border, half = (inner + high) / 2, (high - inner) / 2
    return Basin(motions.loop, border, half / border, seen[inner], seen[high], half / border, side=side)


def stick_position(orbit: HuntingOrbit) -> float:
    """|x1| of the stuck servo [rad]: the amplitude for Switch, |x1| where m = 0.9 Fs comes up for LuGre.

    Raises NoOrbit: the torque does not come up to 0.9 Fs at a standstill.
    """
    return stuck_at(orbit)[0]


def stuck_at(orbit: HuntingOrbit) -> tuple[float, float]:
    """(`stick_position`, relative error).  Raises NoOrbit."""
    if orbit.model == "switch":
        return orbit.amplitude, orbit.error_estimate
    level = SECTION * orbit.servo.friction.static
    fast = 1e-2 * orbit.extrema("x2").amplitude
    # Breakaway in either direction: stuck on one side of the set point, torque towards the other.
    for side in (-1.0, 1.0):
        found = orbit.crossings(lambda x, p, side=side: -side * torque_of(orbit.servo, x, p) - level)
        stands = (found.rates > 0) & (np.abs(found.states[1]) < fast) & (side * found.states[0] > 0)
        if stands.any():
            return abs(float(found.states[0, stands][-1])), orbit.error_estimate
    raise NoOrbit(
        f"the {orbit.model} cycle at gain {orbit.gain:g} does not stand still at {SECTION:g} Fs: no stick position",
        Status.INADMISSIBLE,
    )
