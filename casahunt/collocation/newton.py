"""Newton's method on the square system

    G(u, lambda) = 0,    border . (u - u_start, lambda - lambda_start) = 0,

where the border row holds lambda fixed, or measures arclength; on the condensed node system (transcription.py).  At an
extremum of lambda the way along the border row is one more unknown:

    linearise -> step -> small enough already? -> done
        ^                  | no
        |                  v
        +------------ take it -> was it the last? -> what is left of the equations? -> done

Many members at once have loops of their own: orbits/ensemble.py at fixed parameters, continuation/turning_points.py at
extrema, batched_newton.py on meshes of parts.  One member as a batch of one takes 2.2 times as long to linearise (three
states, ten intervals: 0.24 ms for 0.11; four states, 61 stiff intervals: 0.62 for 0.47), since points of many members
are evaluated over arrays; and of many no member's next step is judged by the residual, which costs a pass over all.

A solution, whoever found it, is checked with numpy: finite, small residual, close to where it started.
Steps and residuals are measured in units of the state scale; durations relative to themselves.

The extended system of a fold: the equations, and a slope of the parameter that vanishes.

    G(u, lambda) = 0,    g(u, lambda) = d lambda/d a = 0,       a = w . (x_0 - x_0*, ln T_1 - ln T_1*)

With a row w along the curve, G is regular at a fold while a is held, and one factorisation of the bordered matrix
gives Newton's step n at fixed a and the tangent v with da = 1, whose last entry is g.  Newton's step of the extended
system is

    (u, lambda) += n + da v,     da = -g/g',

g' from the slopes at the last two points: its steps at fixed a leave the way between them as it was gone.  Only sums of
a member's own numbers enter, so that one fold is a batch of one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..errors import Status
from .node_system import Linearisation
from .transcription import Setting, Transcription

FIRST_WAY = 1e-6
"""First way along the curve where of the bend only the sign is known: shorter than all but the sharpest folds are wide,
and long enough for two slopes to differ by more than rounding."""
ACCEPTED_STEP = 0.1
"""A Newton step below this lets the tangent be accepted."""
CLEAN_STEP = 0.01
"""Of the way between two points: their slopes are compared where Newton's steps at both are smaller than that.  With a
tenth, a step that was 7 % of the way made a bend a hundred times too small."""
LARGEST_WAY = 0.1
"""Of one step along the curve, in scaled units: where the bend was expected ten times too small, ways of 0.3 left
Newton's steps no time to lead back to the curve."""
REDUCED = 0.5
"""Part of the last slope that is left where the bend is about right."""
MOST_TURNS = 16
"""Steps: from the cubic between two orbits that lie on the same side of the fold it took up to 13."""


class Turn:
    """How far B members go along their curves to where their slopes vanish.

    bend: (B,) d2 lambda/d a2, about; the sign is that of the extremum that is sought, and no slopes make it another;
    infinite where only that is known, NaN where any extremum will do.
    """

    def __init__(self, bend: Array) -> None:
        self.bend = np.array(bend, dtype=float)
        self._slope, self._way = np.full(len(self.bend), np.nan), np.zeros(len(self.bend))
        self._step = np.full(len(self.bend), np.inf)

    def way(self, members: Array | slice, step: Array, length: Array, slope: Array) -> Array:
        """(b,) ways along the curve of some members, NaN where the slope bends the other way.

        step, length, slope: (b,) sizes of Newton's steps at fixed a, and of the tangents; d lambda/d a.
        """
        chosen = np.arange(len(self.bend))[members].tolist()
        asked = zip(chosen, step.tolist(), length.tolist(), slope.tolist(), strict=True)
        return np.array([self._of_one(*one) for one in asked])

    def _of_one(self, b: int, step: float, length: float, slope: float) -> float:
        """By numbers: arrays of one number take as long as those of hundreds."""
        bend, gone, last = float(self.bend[b]), float(self._way[b]), float(self._slope[b])
        limit = CLEAN_STEP * abs(gone) * length
        began = gone != 0 and bool(self._step[b] <= limit)
        clean = began and step <= limit
        if clean and ((fresh := (slope - last) / gone) * bend > 0 or math.isnan(bend)):
            self.bend[b] = bend = fresh
        unknown = not math.isfinite(bend)
        if unknown:
            first = _over(-FIRST_WAY if slope * bend > 0 else FIRST_WAY, length)
            way = first if step <= CLEAN_STEP * FIRST_WAY else 0.0
        else:
            way = -_over(slope, bend)
        longest = _over(LARGEST_WAY, length)
        way = max(min(way if step <= ACCEPTED_STEP else 0.0, longest), -longest)
        # Where the slope has not vanished as it should, the bend is told first, from the corrected point at the same a.
        if began and not clean and (unknown or not abs(slope) <= REDUCED * abs(last)):
            way = 0.0
        elif unknown and clean:
            way = math.nan
        if gone == 0 or way != 0:
            self._slope[b], self._step[b], self._way[b] = slope, step, way
        return way

    def rise(self, members: Array | slice, way: Array, slope: Array) -> Array:
        """(b,) changes of lambda that their ways bring."""
        bend = self.bend[members]
        return way * (slope + np.where(np.isfinite(bend), bend, 0.0) / 2 * way)


def _over(a: float, b: float) -> float:
    """a/b, infinite or not a number where b is zero."""
    return a / b if b else math.nan if a == 0 else math.copysign(math.inf, a) * math.copysign(1.0, b)


Array = np.ndarray
Solver = Literal["ipopt", "newton"]

STEP_TOLERANCE = 1e-9
"""A Newton step below this leaves an error of its square."""
FORESEEN_STEP = 1e-10
"""Where the next Newton step is sure to be smaller than this, it is not taken."""
ROUNDED = 1e-8
"""A Newton step below this that shrinks no more is rounding: that of a ring-down of microseconds before a stick of
hours, for example.  No accuracy asked for is worse."""
RESIDUAL_LIMIT = 1e-8
"""Largest residual of an accepted solution, after the last step; where rounding leaves more, because an interval of
hours multiplies it, the next Newton step must be below `ROUNDED`."""
MOST_NEWTON_STEPS = 12
"""Steps after which Newton's method is given up: from a guess that leads anywhere it takes four to eight."""
LARGEST_MOVE = 2.0
"""An accepted solution lies within this of its guess, in scaled units."""
LOST, ROUGH_ITERATIONS = 1.0, 7
"""A rough solution is given up, and a shorter way gone, after a Newton step larger than this, or that many."""
QUADRATIC = 0.01
"""A Newton step below this part of the one before is one of a sequence that shrinks quadratically."""
DIVERGED = 1e3
"""A Newton step larger than this leads nowhere."""


@dataclass(frozen=True, eq=False)
class Solution:
    """What a solver found.

    Attributes
    ----------
    u : (size,) unknowns, meaningful only where status.ok.
    parameter : lambda, zero unless a border row let it move.
    status, iterations : how it ended.
    residual : largest residual at u, scaled.
    linearisation : the equations linearised at u (where rough or nearby: where the last step began; at the last iterate
        where the solver failed), or None.
    solver : which one found it.
    bend : d2 lambda/d a2 along the border row, where the extremum of lambda was sought.
    """

    u: Array
    parameter: float
    status: Status
    iterations: int
    residual: float
    linearisation: Linearisation | None
    solver: Solver = "newton"
    bend: float | None = None


def newton(
    t: Transcription,
    u: Array,
    setting: Setting,
    *,
    border: Array | None = None,
    parameter: float = 0.0,
    max_iterations: int = MOST_NEWTON_STEPS,
    largest_move: float = LARGEST_MOVE,
    accuracy: float = 0.0,
    rough: float = 0.0,
    nearby: float = 0.0,
    turn: Turn | None = None,
) -> Solution:
    """Newton's method from u.

    border, parameter: border row (NodeSystem.border) orthogonal to the correction, default: lambda fixed; lambda at the
    start, with p + lambda dp in the equations; max_iterations, largest_move: when to give up, and how far from u a
    solution may lie; accuracy: a point whose Newton step is no larger than this, and than `ROUNDED`, is a solution as
    it stands; 0 for all digits; rough: above zero, a point is a solution too whose next step is sure to be no larger,
    with no more left of the equations; the linearisation is that where the last step began; nearby: above zero, so is
    one, from no further than this, whose next step is below `accuracy` for sure (`_sure`); turn: of one
    member: what is sought is the extremum of lambda along the border row; without rough and nearby.
    Returns solution, whose status says how it ended.
    """
    row = t.system.border(parameter=1.0) if border is None else border
    start, u, lam, last, before = u, u.copy(), parameter, np.inf, None
    for iteration in range(1, (ROUGH_ITERATIONS if rough else max_iterations) + 1):
        step = _step(t, u, setting.moved(lam), row, turn)
        if isinstance(step, Status):
            return Solution(u, lam, step, iteration, np.inf, None)
        lin = step.linearisation
        if step.whole <= min(accuracy, ROUNDED):
            status = status_of(t, start, u, residual := lin.residual_norm(), True, largest_move)
            return Solution(u, lam, status, iteration, residual, lin)
        u += step.du
        lam += step.dlam
        # The next step is at most this one times the last reduction; where that is enough, what is left decides.
        foreseen = step.size * (step.size / last) if last < np.inf else np.inf
        limit = rough if min(step.size, foreseen) <= rough else RESIDUAL_LIMIT * _sure(step, before, nearby, accuracy)
        if limit and (residual := t.residual_norm(u, setting.moved(lam))) <= limit:
            return Solution(u, lam, status_of(t, start, u, residual, True, largest_move), iteration, residual, lin)
        rounding = step.size <= ROUNDED and step.size > 0.3 * last
        # Secants shrink less quickly than Newton's steps do: where the extremum is, the next step is to show.
        if rounding or (turn is None and (step.size <= STEP_TOLERANCE or foreseen <= FORESEEN_STEP)):
            # The solution after the last step, judged by the residual and, where that is not small, by the next step
            try:
                lin = t.linearise(u, setting.moved(lam))
            except np.linalg.LinAlgError:
                return Solution(u, lam, Status.SINGULAR, iteration, np.inf, None)
            residual = lin.residual_norm()
            small = residual <= RESIDUAL_LIMIT or size_of_step(t, u, lin.step(row)[0]) <= ROUNDED
            return Solution(u, lam, status_of(t, start, u, residual, small, largest_move), iteration, residual, lin)
        if step.size > (LOST if rough else DIVERGED) or (turn is None and iteration > 3 and step.size > 2 * last):
            break
        if (t.durations_of(u) <= 0).any():
            return Solution(u, lam, Status.INADMISSIBLE, iteration, np.inf, lin)
        last, before = step.size, step
    return Solution(u, lam, Status.NOT_CONVERGED, iteration, np.inf, lin)


@dataclass(frozen=True, eq=False)
class _Step:
    """A Newton step: of u and of lambda, how large it is, and the equations linearised where it starts."""

    du: Array
    dlam: float
    size: float
    linearisation: Linearisation

    @property
    def whole(self) -> float:
        """How large with lambda, which next to a fold may have a way to go where the states have none."""
        return max(self.size, abs(self.dlam))


def _sure(step: _Step, before: _Step | None, nearby: float, accuracy: float) -> bool:
    """Whether the step after this one, which is short enough, is below an accuracy for sure.

    |step_(k+1)| <= C |step_k|^2 with the C of the two steps at hand (Deuflhard, Newton methods, 2004, section 2.1),
    where it shows that the steps have begun to shrink like that.
    """
    if before is None or not step.whole <= min(nearby, QUADRATIC * before.whole):
        return False
    return step.whole * (step.whole / before.whole) ** 2 <= accuracy


def _step(t: Transcription, u: Array, setting: Setting, row: Array, turn: Turn | None) -> _Step | Status:
    """The Newton step at u under a border row, or why there is none."""
    try:
        lin = t.linearise(u, setting)
    except np.linalg.LinAlgError:
        return Status.SINGULAR
    if not lin.finite():
        return Status.NOT_FINITE
    if turn is None:
        du, _, dlam = lin.step(row)
        size = size_of_step(t, u, du)
    else:
        # Newton's step at fixed a and the way along the curve, (du, dlambda) of both, and how large the larger one is
        step, tangent = lin.step_and_tangent(row)
        du, along, slope = lin.expand(step, 1.0), lin.expand(tangent, 0.0), tangent[-1:]
        size, length, one = max(size_of_step(t, u, du), abs(float(step[-1]))), size_of_step(t, u, along), slice(None)
        way = turn.way(one, np.array([size]), np.array([length]), slope)
        further = float(way[0])
        dlam = float(step[-1] + turn.rise(one, way, slope)[0])
        du, dlam, size = (du + further * along, dlam, float(np.maximum(size, abs(further) * length)))
    return _Step(du, dlam, size, lin) if np.isfinite(size) else Status.SINGULAR


def size_of_step(t: Transcription, u: Array, du: Array) -> float:
    """How large an update of the unknowns is: states as they are (scaled), durations relative.

    u, du: (size,) unknowns and their update. Returns the largest; NaN stays NaN.
    """
    sizes, P = np.abs(du), t.phases
    sizes[-P:] /= np.maximum(np.abs(u[-P:]), 1e-300)
    return float(sizes.max())


def status_of(t: Transcription, start: Array, u: Array, residual: float, small: bool, largest_move: float) -> Status:
    """What becomes of a point as a solution.

    start, u: (size,) where the solver started, and the point; residual, small: what is left of the equations there, and
    whether that is small; largest_move: how far from `start` a solution may lie, in the scaled states of the nodes.
    """
    if not np.isfinite(u).all() or not np.isfinite(residual):
        return Status.NOT_FINITE
    if not small:
        return Status.NOT_CONVERGED
    durations = t.durations_of(u)
    if (durations <= np.finfo(float).eps * durations.sum()).any():  # no phase lasts for what is rounding of the period
        return Status.INADMISSIBLE
    if float(np.abs(t.nodes_of(u) - t.nodes_of(start)).max()) > largest_move:
        return Status.FAR_FROM_GUESS
    return Status.CONVERGED
