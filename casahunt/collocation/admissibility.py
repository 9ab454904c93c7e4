"""Is a root of the collocation equations a motion of the system?

Solvers converge to wrong roots and call it success: a slip that runs backwards, a stick that holds more
than it can, a phase of negative duration.  Every mode states a condition that must not fall
below minus its slack all along its phase; it is evaluated at the nodes and stages of every interval and
interpolated densely between them.
Inside an interval the polynomial is known to a few times the last Legendre coefficient of the condition:
a violation beyond that is a wrong root; a value that is not clear of zero by as much asks for a shorter
interval.  Without that an interval can step over a whole ring-down and see nothing of it.  A condition with a kink is
no polynomial at all: to be violated it must be so at the states of the polynomial, too.

At its end a phase must lead to the mode that follows, as its event says of the state there (successors.py).

Nor may an event of the mode be passed inside the phase: its scalar, counted along the direction of the way out, goes
from below zero to above only at the end.  That needs no condition, and keeps a system without one from roots that go
through a wall.

The same goes for an interval between whose points a feature of the field can hide, such as a sudden drop
at its very end: neither the equations nor the error estimate would ever see it (hybrid.system.Mode).  The march
uses the same look, more strictly.

A phase begins and ends where its condition vanishes by definition.  There the condition is divided by the
distance from that end, so that what must be clear of zero is its slope.

One solution has no axis of members, many have theirs first (...); of many no sentence is asked for, but yes or no.

Symbols: n states, d stages, N intervals, m points.

An event that comes near zero and goes away again is looked at on equidistant times and at the tops between them; a top
no farther from zero than it is known, on whichever side, says nothing: next to a grazing contact that is rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..hybrid.system import Exit, Feature, VectorMode
from ..roots import boundary
from .conditions import Conditions, NotSymbolic
from .resolution import BARELY, NOISE, RESOLUTION, dense_rule, largest_of_phase, not_clear
from .successors import contradicted, taken_over, undecided
from .transcription import Setting, Transcription

Array = np.ndarray
Place = tuple[Transcription, Array, Setting]

PASSED = 1e-6
"""An event is passed where its scalar goes from so far below zero to as far above, relative to its size above one."""
LARGEST_JUMP = 0.5
"""Of a mode's feature between neighbouring collocation points of a march, which has no other look at it."""
NOTHING_LEFT = 0.9
"""The same for a solution: the error estimate looks between the points, but must have something to see."""
MOVES_BELOW = 1e-9
"""States that range over less than this part of their scale do not move: tolerances of cycles are larger."""


def comes_and_goes(values: Array, tops: Array, doubt: Array | float, least: Array | float) -> tuple[Array, Array]:
    """Where an event that is not met in the end is met in between: surely, and perhaps.

    values, tops: (..., N, m) of the event, below zero before it is met, and `tops_of` them; doubt, least: (..., N, 1)
    how well they are known, 0 for exactly; (..., 1, 1) what does not count.
    Returns (..., N, m) bool: above `least` for sure, between times at which it is as far below zero; and no farther
    below zero than it is known, between times at which it is, on intervals that do not resolve `least`.
    """
    near = (tops > least) | ((doubt > least) & (tops > -doubt))
    if not near.any():
        return near, near
    flat = values.reshape(*values.shape[:-2], -1)
    around = np.zeros_like(flat)
    before = np.minimum.accumulate(flat, axis=-1)[..., :-2]
    behind = np.minimum.accumulate(flat[..., ::-1], axis=-1)[..., -3::-1]
    around[..., 1:-1] = np.maximum(before, behind)  # of the points before, and of those behind: tops lie between points
    around = around.reshape(values.shape)
    seen = (around < -least) & (tops > least + doubt)
    unknown = (doubt > least) & (around < -doubt) & (tops > -doubt)
    return np.asarray(seen), np.asarray(unknown | (around < -least) & (tops > least) & ~seen)


def tops_of(values: Array) -> Array:
    """Equidistant values (..., m), or what they come up to next to them: vertices of parabolas through neighbours."""
    tops = values.copy()
    left, middle, right = values[..., :-2], values[..., 1:-1], values[..., 2:]
    bend, tilt = left - 2 * middle + right, left - right
    peaked = (bend < 0) & (np.abs(tilt) <= -2 * bend)
    tops[..., 1:-1] -= np.divide(tilt * tilt, bend, out=np.zeros_like(bend), where=peaked) / 8
    return tops


@dataclass(frozen=True, eq=False)
class Admissibility:
    """What the conditions say.

    Attributes
    ----------
    violated : sentence about the first condition that fails, or "".
    phase : the phase it fails in, or -1.
    unclear : (N,) True for intervals too long to tell.
    barely : the first phase that passes an event by less than a violation, and comes back; -1 for none.
    lowest : to what the condition that fails falls; NaN where it is no condition.
    """

    violated: str
    phase: int
    unclear: Array
    barely: int = -1
    lowest: float = np.nan

    @property
    def admissible(self) -> bool:
        """A motion of the system, without reservation."""
        return not self.violated and not self.unclear.any()


def check_admissible(t: Transcription, u: Array, setting: Setting) -> Admissibility:
    """Check whether a converged solution is a motion: all conditions of its phases.

    Returns verdict: the first condition that is violated, and the intervals on which one is not clear.
    """
    told = Conditions(t, u, setting)
    inside, ways, barely = _inside(told), _WaysOut(told), -1
    for k, phase in enumerate(t.cycle.phases):
        mode = phase.mode
        if not told.durations[k] > 0:
            sentence = f"phase {k + 1} ({mode.name}) has the duration {told.durations[k]:.3g} s"
            return Admissibility(sentence, k, inside.unclear)
        if phase.direction and _from_the_other_side(told, k):
            sentence = f"phase {k + 1} ({mode.name}) meets {phase.end.name!r} from the other side"
            return Admissibility(sentence, k, inside.unclear)
        if mode.admissible is not None:
            lowest, wrong = inside.of_phase(t, k) if t.counts[k] else _closed_form(told, k, mode.slack)
            if wrong:
                sentence = f"phase {k + 1} is no {mode.name}: its condition falls to {lowest:.3g}"
                return Admissibility(sentence, k, inside.unclear, lowest=float(lowest))
        passed, by_little = _passed(ways, k, inside.unclear) if phase.exits else ("", False)
        if passed:
            return Admissibility(f"phase {k + 1} ({mode.name}) passes {passed!r}", k, inside.unclear)
        if why := contradicted(t, u, setting, k):
            return Admissibility(f"phase {k + 1} ({mode.name}): {why}", k, inside.unclear)
        barely = k if by_little and barely < 0 else barely
    return Admissibility("", -1, inside.unclear, barely)


def admissible_many(t: Transcription, u: Array, settings: Setting) -> Array:
    """Whether converged solutions (B, size) are motions, without reservation and without a mode's slack.

    Within its slack a phase may do for a moment what another mode would, without that any estimate of an error knows
    it: a member that is not admitted is left to whoever solves it alone.  One that may pass an event is judged alone.
    Returns (B,) bool.
    """
    with np.errstate(all="ignore"):
        try:
            told = Conditions(t, u, settings)
            inside, ways, asked = _inside(told), _WaysOut(told), np.zeros(len(u), dtype=bool)
            good = (told.durations > 0).all(axis=1) & ~(inside.unclear | inside.below).any(axis=1)
            for k, phase in enumerate(t.cycle.phases):
                if phase.direction:
                    good &= ~_from_the_other_side(told, k)
                if phase.mode.admissible is not None and not t.counts[k]:
                    good &= ~_closed_form(told, k, 0.0)[1]
                for i in range(len(phase.exits)):
                    _, *perhaps = ways.passing(k, i)
                    asked |= np.logical_or.reduce(perhaps).any(axis=(1, 2))
            asked |= [bool(undecided(t, u[b], settings.of(b))) for b in range(len(u))]
        except NotSymbolic:
            return np.array([check_admissible(t, u[b], settings.of(b)).admissible for b in range(len(u))], dtype=bool)
    for b in np.flatnonzero(good & asked).tolist():
        verdict = check_admissible(t, u[b], settings.of(b))
        good[b] = verdict.admissible and verdict.barely < 0
    return np.asarray(good)


def stands_still(t: Transcription, u: Array) -> bool:
    """Whether a solution is an equilibrium, which solves the equations of any cycle whose events do not mind.

    Returns True where no state moves; never where there are closed forms or jumps.
    """
    if not all(t.counts) or any(phase.reset is not None for phase in t.cycle.phases):
        return False
    states = t.intervals_of(u).reshape(-1, t.n)
    return bool(np.max(np.ptp(states, axis=0)) <= MOVES_BELOW * max(1.0, float(np.max(np.abs(states)))))


def judged_on_halves(t: Transcription, verdict: Admissibility, better: Place | None) -> Admissibility:
    """A solution that is a motion, judged again by what a Newton step on its halved mesh makes of it.

    Where an event is all but met, the solution itself may be known less well than it passes that, or keeps clear; and
    an interval may be wrong inside by more than a weak reversal is high, and show nothing of it.

    t, verdict: transcription of the solution, and the verdict on it; better: the solution after that step
    (error_estimate.Estimate); None for nothing to look at. Returns verdict, with what is unclear there and what is
    passed by little.
    """
    if better is None:
        return verdict
    finer = check_admissible(*better)
    unclear: Array = np.asarray(finer.unclear.reshape(-1, 2).any(axis=1))
    if finer.violated and not unclear.any():
        unclear[t.phase_intervals(finer.phase)] = True
    return replace(verdict, unclear=unclear, barely=finer.barely)


def _from_the_other_side(told: Conditions, k: int) -> Array:
    """(...) whether the event at the end of a phase is met from the other side."""
    rate, size = told.end_rate(k)
    return np.asarray(~(told.t.cycle.phases[k].direction * rate >= -NOISE * size))


def _passed(ways: _WaysOut, k: int, unclear: Array) -> tuple[str, bool]:
    """(the event of a way out that is passed inside a phase, or "", whether one is by less than counts).

    Where one may be passed, intervals become unclear.
    """
    told, t, p, by_little = ways.told, ways.told.t, ways.told.p, False
    phase, own = t.cycle.phases[k], t.phase_intervals(k)
    for i, way_out in enumerate(phase.exits):
        surely, beyond, seen, unknown = ways.passing(k, i)
        if not beyond.any():
            if (seen.any() or unknown.any()) and _leaves(way_out, phase.mode, _looked_at(told, k), p):
                by_little |= bool(seen.any())
                if t.counts[k] and not seen.any():
                    unclear[own] |= unknown.any(axis=1)
            continue
        if not surely.any():
            unclear[own] |= beyond.any(axis=1)
        elif way_out.mark or _leaves(way_out, phase.mode, _looked_at(told, k), p):
            return way_out.event.name, False
    return "", by_little


def _looked_at(told: Conditions, k: int) -> Array:
    """(..., m, n) states of a phase at which its ways out are looked at."""
    if told.t.counts[k]:
        return told.w[..., told.t.phase_intervals(k), :, :].reshape(*told.lead, -1, told.t.n)
    return told.along_closed(k)


class _WaysOut:
    """The scalars of the ways out of phases, of those that have the same ones together."""

    def __init__(self, told: Conditions) -> None:
        self.told = told
        self._values: dict[tuple[int, int], tuple[Array, Array, Array]] = {}

    def passing(self, k: int, i: int) -> tuple[Array, Array, Array, Array]:
        """Where (..., N, m) way out i of phase k is passed, surely and as it looks; by little, surely and perhaps."""
        if (k, i) not in self._values:
            self._evaluate(k, i)
        values, tops, doubt = self._values[k, i]
        size = np.maximum(1.0, np.abs(values).max(axis=(-2, -1)))[..., None, None]
        slack, by_little = PASSED * size, comes_and_goes(values, tops, doubt, BARELY * size)
        beyond = values > slack
        if beyond.any():
            flat = values.reshape(*self.told.lead, -1)
            beyond &= (np.minimum.accumulate(flat, axis=-1) < -slack[..., 0]).reshape(values.shape)
        return beyond & (values > slack + doubt), beyond, *by_little

    def _evaluate(self, k: int, i: int) -> None:
        """The scalar (..., N, m) along the direction of way out i, its tops, and how well it is known (..., N, 1)."""
        told, t = self.told, self.told.t
        exits = t.cycle.phases[k].exits
        if not t.counts[k]:
            values = exits[i].direction * told.event(exits[i].event, _looked_at(told, k))[..., None, :]
            self._values[k, i] = values, tops_of(values), np.zeros((1, 1))
            return
        alike = [j for j, phase in enumerate(t.cycle.phases) if phase.exits == exits and t.counts[j]]
        own = np.concatenate([np.arange(t.intervals)[t.phase_intervals(j)] for j in alike])
        states = told.w.take(own, axis=-3).reshape(*told.lead, -1, t.n)
        values = (exits[i].direction * told.event(exits[i].event, states)).reshape(*told.lead, -1, t.degree + 1)
        doubt = RESOLUTION * np.abs(values @ t.scheme.last_mode)[..., None]
        values = values @ dense_rule(t.degree, t.kind)[0]
        tops, first = tops_of(values), 0
        for j in alike:
            rows = slice(first, first := first + t.counts[j])
            self._values[j, i] = values[..., rows, :], tops[..., rows, :], doubt[..., rows, :]


def _leaves(way_out: Exit, mode: VectorMode, states: Array, p: Array) -> bool:
    """Whether one of the states next to which a way out is passed leads to another mode: a contact may lead on."""

    def beyond(low: Array, high: Array) -> bool:
        if way_out.successor(high, p) != mode.name or way_out.reset is not None:
            return True

        def passed(part: float) -> bool:
            return bool(way_out.direction * way_out.event.function(low + part * (high - low), 0.0, p) >= 0)

        return bool(way_out.others and taken_over(mode, way_out, low + boundary(passed, 0.0, 1.0)[1] * (high - low), p))

    values = way_out.direction * np.asarray(way_out.event.function(states.T, 0.0, p), float)
    below = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    return any(map(beyond, states[below], states[below + 1])) or not below.size


def _closed_form(told: Conditions, k: int, slack: float) -> tuple[Array, Array]:
    """(the lowest value (...) of the condition of a phase in closed form, whether that violates it)."""
    values = told.condition(told.t.cycle.phases[k].mode, told.along_closed(k))
    lowest = values.min(axis=-1)
    return lowest, ~(lowest + slack + NOISE * np.maximum(1.0, np.abs(values).max(axis=-1)) >= 0)


@dataclass(frozen=True, eq=False)
class _Inside:
    """The conditions and features of all collocated phases.

    Attributes
    ----------
    unclear : (..., N) as of a Verdict.
    lowest, wrong : (..., N) the lowest value of the condition, and whether that violates it.
    below : (..., N) whether that is below zero, by however little.
    """

    unclear: Array
    lowest: Array
    wrong: Array
    below: Array

    def of_phase(self, t: Transcription, k: int) -> tuple[float, bool]:
        """(the lowest value of its condition in a phase, whether that violates it)."""
        own = t.phase_intervals(k)
        return float(self.lowest[own].min()), bool(self.wrong[own].any())


def _inside(told: Conditions) -> _Inside:
    """The conditions and features inside the intervals, those of one mode together."""
    t, lead, shape = told.t, told.lead, (*told.lead, told.t.intervals)
    found = _Inside(np.zeros(shape, dtype=bool), np.zeros(shape), *np.zeros((2, *shape), dtype=bool))
    if not t.intervals:
        return found
    ends = told.nodes.take(t.interval_elements + 1, axis=-2)
    values, slack = np.zeros((*shape, t.degree + 1)), np.zeros(t.intervals)
    conditioned = np.zeros(t.intervals, dtype=bool)
    for mode, members in t.modes:
        states = told.w.take(members, axis=-3)
        if mode.feature is not None:
            points = np.concatenate([states, ends.take(members, axis=-2)[..., None, :]], axis=-2)
            seen = told.feature(mode.feature, points.reshape(*lead, -1, t.n)).reshape(points.shape[:-1])
            found.unclear[..., members] = _jumps(seen, NOTHING_LEFT)
        if mode.admissible is not None:
            values[..., members, :] = told.condition(mode, states.reshape(*lead, -1, t.n)).reshape(states.shape[:-1])
            slack[members], conditioned[members] = mode.slack, True
    if not conditioned.any():
        return found
    found = replace(found, **_conditioned(t, values, slack, conditioned, found))
    return _witnessed(told, found) if found.wrong.any() else found


def _witnessed(told: Conditions, found: _Inside) -> _Inside:
    """What is wrong, at the states between the points; what is so by the polynomial of the condition alone is not."""
    t, lowest, wrong = told.t, found.lowest.copy(), found.wrong.copy()
    for mode, members in t.modes:
        if mode.admissible is not None and found.wrong[..., members].any():
            states = told.between(members)
            values = told.condition(mode, states.reshape(*told.lead, -1, t.n)).reshape(states.shape[:-1])
            lowest[..., members] = values.min(axis=-1)
            noise = NOISE * np.maximum(1.0, np.abs(values).max(axis=-1))
            wrong[..., members] &= ~(lowest[..., members] + mode.slack + noise >= 0)
    return replace(found, lowest=lowest, wrong=wrong)


def _conditioned(t: Transcription, values: Array, slack: Array, conditioned: Array, found: _Inside) -> dict[str, Array]:
    """What the values (..., N, d + 1) of conditions with some slack (N,) say of the intervals that have one."""
    dense = values @ dense_rule(t.degree, t.kind)[0]
    lowest = dense.min(axis=-1)
    with_noise = lowest + NOISE * np.maximum(1.0, largest_of_phase(t, dense))
    beyond = conditioned & (with_noise + slack < 0)
    wrong = beyond
    if beyond.any():
        wrong = beyond & (with_noise + slack < -RESOLUTION * np.abs(values @ t.scheme.last_mode))
    unclear = found.unclear | conditioned & not_clear(t, values, slack) | beyond
    return {"unclear": unclear, "lowest": lowest, "wrong": wrong, "below": conditioned & ~(with_noise >= 0)}


def hides(feature: Feature, points: Array, p: Array, *, largest: float = LARGEST_JUMP) -> Array:
    """Where a feature of the field jumps between successive points.

    feature: of the mode: a function of states (n, m) and p; points: (N, m, n) successive states of each interval;
    largest: jump that is not taken for one. Returns (N,) bool.
    """
    values = np.asarray(feature(points.reshape(-1, points.shape[-1]).T, p), float).reshape(points.shape[:2])
    return _jumps(values, largest)


def _jumps(values: Array, largest: float) -> Array:
    """(..., N) whether successive ones of the values (..., N, m) differ by more."""
    return np.asarray(np.abs(values[..., 1:] - values[..., :-1]).max(axis=-1) > largest)
