"""A branch of cycles of a user's system in one of its parameters, with what is met on the way.

    for every two orbits of a walk (walk.py)    the monitors that change sign between them (crossings.py), located

Where the phases of the cycle change, the walk goes on with those that the motion really has (orbits/family.py).  Where
none continues it, an event being met with no speed, the walk has ended at that grazing, to a step of 1e-10.  On the
other side of the parameter, or on the same one, there may be a cycle that keeps clear of the event: where the motion
settles on one next to the last, the branch goes on with it.

    walk -> next orbit ----> its own image? an end of all cycles (terminations.py)? -> the branch has ended
                |      |--> small, or its plane left behind -> cut by another plane (poincare_section.py), and on
                |-- fails -> an end? a grazing (beyond_grazing.py)? -> on behind it; else it is stuck
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import replace
from enum import Enum, auto
from typing import Any, cast

import numpy as np

from .. import effort
from ..checks import choice_of, of_kind, to_and_back
from ..errors import NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.fold_side import one_of_many
from ..orbits.orbit import AnyOrbit, Complaint, Orbit, unknowns_of
from .beyond_grazing import (
    LEADS_ELSEWHERE,
    MET_FROM_BEHIND,
    PHASE_GONE,
    behind_grazing,
    lacks_a_phase,
    leads_elsewhere,
    without_speed,
)
from .bifurcations import monitors_of
from .branch import Branch, Departure, Run
from .branching import as_whole_as_needed
from .closed_branch import came_round, met_itself, unseen_turns
from .crossings import Crossings, Passed
from .curve import CurvePoint, curve_point, in_asked_scheme, parameter_value, solved_at
from .over_contacts import leapt_over, phase_gone, said_to_turn, turns_round
from .poincare_section import (
    badly_cut,
    cut_by_planes,
    cut_elsewhere,
    section_outgrown,
    with_better_section,
)
from .special_points import GRAZING, Monitor, SpecialPoint
from .terminations import POINT_KIND, SHRUNK_TO, SPACED, End, comes_to, hopf_point, ranges, through_rest
from .vanishing import first_shrinks, from_strongest, seen_better
from .walk import FIRST_STEP, SMALLEST_STEP, Stopped, walk, walk_naturally

Array = np.ndarray

NATURAL = ("low", "high", "first_step", "largest_step")
"""What natural steps take of how a branch is walked along."""
NEXT_TO_MANY = 1e-3
"""How far at most a multiplier is from 1, and in its unit the parameter from a bound, where a cycle is one of many."""


class _Pause(Enum):
    """Why a walk is left where the branch goes on."""

    FIRST_SHRINKS = auto()  # the first phase may be about to vanish
    CUT_SHRINKS = auto()  # an event is about to move past the plane that cuts the cycle
    LEFT_BEHIND = auto()  # the plane that cuts the cycle is left behind
    NEXT_TO_NOTHING = auto()  # the cycle has shrunk to nothing


def follow(
    orbit: AnyOrbit,
    vary: str,
    *,
    to: float,
    back: float | None = None,
    previous: AnyOrbit | None = None,
    options: Options | None = None,
    monitors: tuple[Monitor, ...] | None = None,
    until: Callable[[SpecialPoint[AnyOrbit]], bool] | None = None,
    first_step: float = FIRST_STEP,
    smallest_step: float = SMALLEST_STEP,
    largest_step: float | None = None,
    largest_change: float | None = None,
    max_points: int = 500,
    time_limit: float = math.inf,
    progress: Callable[[AnyOrbit], None] | None = None,
    report: Callable[[Branch[AnyOrbit]], None] | None = None,
    recut: bool = True,
    natural: bool = False,
) -> Branch[AnyOrbit]:
    """Follow a cycle in a parameter, round folds.

    Parameters
    ----------
    orbit
        where the branch starts.
    vary
        name of the parameter.
    to
        value towards which it goes, and at which it ends; infinity for none.
    back
        value at which it ends on the other side, where a fold has turned it round; default the one it starts at.
    previous
        the orbit before, to go on in that direction.
    options
        tolerance and method; default the tolerance to which the orbit is known, or 1e-8.  A scheme that is asked for
        and is not that of the orbit is taken from the first cycle on.
    monitors
        what is looked for; default fold, branch point, flip or symmetry breaking, Neimark-Sacker and changes of the
        phases, but for those at a kink (`Mode.unsplit`).  A branch goes on through changes of the phases all the same.
    until
        the branch ends at the first special point for which it holds, with some orbits beyond, which are looked at
        together.
    first_step, smallest_step, largest_step
        arclength of a step, in units of the state, of the logarithm of the first duration, and of the parameter; below
        the smallest one it gives up.
    largest_change
        of the parameter in one step, in its own unit.
    max_points, time_limit
        number of orbits, and seconds, after which it ends with what it has.
    progress
        called with every orbit as it is found.
    report
        called with the branch so far, special points included, each time that more of it is known.
    recut
        whether its cycles may begin at another of their events, which is crossed faster, than `orbit` does.
    natural
        steps in the parameter, which end at a fold, in place of pseudo-arclength.

    Returns
    -------
    Branch.

    Raises
    ------
    InputError : unknown parameter, or `to` and `back` on the same side of the start.
    NoOrbit : the cycle could not be computed in the scheme that is asked for.

    Examples
    --------
    >>> from casahunt.continuation import follow
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> branch = follow(orbit, "a", to=0.05)
    >>> [special.kind for special in branch.special]
    ['flip']
    """
    of_kind("orbit", orbit, Orbit)
    choice_of("parameter", vary, orbit.problem.names)
    here = orbit.problem.value(vary)
    to, back = to_and_back(vary, here, to, back, endless=True)
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    orbit, previous = in_asked_scheme(orbit, options), None if previous is None else in_asked_scheme(previous, options)
    orbit = as_whole_as_needed(orbit, (vary,), (to,), options)
    previous = previous if previous is None or previous.repeats == orbit.repeats else None
    looked_for = (*monitors_of(orbit), GRAZING) if monitors is None else monitors
    span = max(abs(value) for value in (here, to, back) if math.isfinite(value))
    orbit = replace(orbit, problem=orbit.problem.over(span or 1.0))
    recut = recut and not cut_by_planes(orbit)
    if recut and badly_cut(orbit) and (cut := cut_elsewhere(orbit, options)) is not None:
        orbit, previous = cut, None
    elif recut:
        orbit, previous = from_strongest(orbit, previous, options)
    line = Crossings(orbit, vary=vary, monitors=looked_for, options=options, at_kinks=GRAZING in (monitors or ()))
    steps = {"first_step": first_step, "smallest_step": smallest_step, "largest_step": largest_step}
    how = {"low": min(to, back), "high": max(to, back), "largest_change": largest_change} | steps
    begun = Branch(vary, (orbit,))
    run = Run(begun, line, looked_for, until, options, max_points, progress, report, recut, natural, how)
    try:
        run.add(passed=Passed())
        with effort.until(time_limit):
            end = _followed(run, float(np.sign(to - here)), previous)
            run.add(passed=line.rest())
            end = run.told_to_end() or end
    except effort.OutOfTime:
        value = parameter_value(run.branch.orbits[-1], vary)
        end = End("time", f"stopped after {time_limit:g} s at {vary} = {value:.6g}")
        run.add(passed=line.in_haste(run.last))
    missed = (*run.branch.missed, *line.unresolved())
    return replace(run.branch, missed=(*missed, *unseen_turns(replace(run.branch, missed=missed))), end=end)


def _followed(run: Run[AnyOrbit], sense: float, previous: AnyOrbit | None) -> End:
    """The branch from its last orbit on to its end."""
    way: Departure[AnyOrbit] = Departure(sense, previous)
    while True:
        along: dict[str, Any] = {"previous": way.previous, "heading": way.heading, **run.how}
        along["first_step"] = way.first_step or along["first_step"]
        steps = (walk_naturally if run.natural else walk)(
            run.last, vary=run.branch.vary, sense=way.sense, options=run.options,
            max_points=run.max_points - len(run.branch.orbits),
            **{name: along[name] for name in NATURAL} if run.natural else along,
        )  # fmt: skip
        length = len(run.branch.orbits)
        outcome = _walked(run, steps, way)
        if isinstance(outcome, Complaint):
            outcome = comes_to(run.branch.orbits, run.branch.vary, stuck=True) or _one_of_many(run) or outcome
        following = _after(run, outcome, way, len(run.branch.orbits) > length)
        if isinstance(following, End):
            return following
        way = following


def _after(run: Run[AnyOrbit], outcome: Any, way: Departure[AnyOrbit], came: bool) -> End | Departure[AnyOrbit]:
    """How the branch goes on after a walk, or its end; `came` where the walk had led to any orbit at all."""
    if isinstance(outcome, Departure):
        return outcome
    if outcome is _Pause.FIRST_SHRINKS:
        return _cut_anew(run, from_strongest(run.last, None, run.options)[0], way.sense)
    if outcome is _Pause.CUT_SHRINKS:
        # on with the last cycle cut elsewhere, where it can be
        fresh = cut_elsewhere(run.last, run.options)
        if fresh is None:
            return replace(way, previous=run.branch.orbits[-2], heading=None)
        return _cut_anew(run, fresh, way.sense)
    if isinstance(outcome, End) and outcome.kind == POINT_KIND:
        outcome = through_rest(run.branch.orbits, run.branch.vary, outcome.value, run.options) or outcome
    if not isinstance(outcome, Orbit) and cut_by_planes(run.last):
        outcome = _after_planes(run, outcome, way, came)
    if isinstance(outcome, Complaint):  # natural steps end at a fold, which no contact explains
        natural = run.natural and GRAZING not in run.looked_for
        outcome = End("stuck", str(outcome)) if natural else _grazed(run, outcome)
    if isinstance(outcome, End | Departure):
        return outcome
    if not run.within(outcome):
        # the branch goes on with a cycle beyond its range: it ends with that cycle on the bound, where it is one
        vary = run.branch.vary
        bound = run.how["high"] if run.value(outcome) > run.how["high"] else run.how["low"]
        problem = outcome.problem.with_value(vary, bound)
        reached = cast("AnyOrbit | None", solved_at(problem, unknowns_of(outcome), run.options))
        if reached is None:
            return End("range", f"the next cycle that was found lies beyond {vary} = {bound:.6g}, the end of the range")
        run.add(passed=run.line.rest())
        run.add(reached)
        return End("range", f"{vary} reached {bound:.6g}, the end of the range", bound)
    if len(run.branch.orbits) + 1 >= run.max_points:
        return End("points", f"stopped after {run.max_points} points")
    sense = float(np.sign(run.value(outcome) - run.value(run.last))) or _sense(run.branch, way.sense)
    run.add(passed=run.line.rest())
    run.add(outcome)
    run.line.go_on_from(outcome)
    return Departure(sense)


def _after_planes(
    run: Run[AnyOrbit], outcome: Any, way: Departure[AnyOrbit], came: bool
) -> End | Complaint | Departure[AnyOrbit]:
    """The same of cycles that are cut by planes, which may be others; the Complaint where no plane is to blame."""
    failed = isinstance(outcome, Complaint)
    point = isinstance(outcome, End) and outcome.kind == POINT_KIND
    hopf = _shrunk(run.branch) if failed or point or outcome is _Pause.NEXT_TO_NOTHING else None
    if hopf is not None:
        run.add(passed=run.line.rest())
        run.add(passed=Passed((hopf,)))
        return End("Hopf", hopf.meaning, hopf.value, 0.0, 0.5, 0.0)
    if isinstance(outcome, End):
        return outcome
    insist = failed and outcome.status is Status.INADMISSIBLE and (came or not way.insisted)
    if failed and not insist:
        return cast(Complaint, outcome)
    fresh = with_better_section(run.last, run.branch.vary, run.options, insist=insist)
    if fresh is not None:
        return replace(_cut_anew(run, fresh, way.sense), insisted=insist)
    if insist:
        return cast(Complaint, outcome)
    return Departure(way.sense, run.branch.orbits[-2], watched=False)  # there is no better plane


def _grazed(run: Run[AnyOrbit], failure: Complaint) -> AnyOrbit | End:
    """The cycle that the branch goes on with behind the grazing that it has come to; its end where there is none."""
    found = behind_grazing(run.branch.orbits, run.branch.vary, failure, run.options)
    if found.grazing is None:
        return found.following or End("stuck", str(failure))
    special, reached = found.grazing, found.reached(run.branch.orbits)
    if found.following is not None and turns_round(reached, special.orbit, found.following, run.branch.vary):
        special = said_to_turn(special)
    if run.within(special.orbit):
        run.add(passed=run.line.rest())
        run.branch = replace(run.branch, orbits=reached)
        run.add(passed=run.of_contact(special))
        run.line.go_on_from(run.last)
    return found.following or End(special.kind, f"no cycle follows: {special.meaning}", special.value, special.error)


def _walked(run: Run[AnyOrbit], steps: Generator[AnyOrbit, None, str], way: Departure[AnyOrbit]) -> Any:
    """How a walk has ended whose orbits the branch has been given.

    By an End; by the orbit behind a grazing that it came to; by the Complaint that it has failed by; by a Departure
    where it is seen better from another phase on; by a _Pause where the first phase is about to vanish, or a cycle that
    is cut by planes has become small or (`watched`) leaves its plane behind.
    """
    by_planes = cut_by_planes(run.last)
    largest = np.max([ranges(orbit) for orbit in run.branch.orbits if by_planes], axis=0, initial=0.0)
    while True:
        try:
            after = next(steps)
        except StopIteration as end:
            why = end.value
            return End(why.kind, str(why), run.value(run.last)) if isinstance(why, Stopped) else cast(Complaint, why)
        except NoOrbit as error:
            return Complaint(str(error), error.status)
        before = run.last
        by_planes = cut_by_planes(before) and cut_by_planes(after)
        if by_planes and before.signature != after.signature and _shrunk(run.branch) is not None:
            return _Pause.NEXT_TO_NOTHING  # stepped over: the same cycles, half a turn later
        if (found := leapt_over(run, after, way) or _at_an_end(run, after)) is not None:
            return found
        if by_planes:
            largest = np.maximum(largest, ranges(after))
            if way.watched and np.all(ranges(after) <= SHRUNK_TO * largest):
                return _Pause.NEXT_TO_NOTHING
            if way.watched and section_outgrown(after):
                return _Pause.LEFT_BEHIND
            continue
        if (anew := _cut_badly(run, before, after, way)) is not None:
            return anew
        if (gone := phase_gone(run, before, after)) is not None:
            return gone


def _cut_badly(
    run: Run[AnyOrbit], before: AnyOrbit, after: AnyOrbit, way: Departure[AnyOrbit]
) -> _Pause | Departure[AnyOrbit] | None:
    """How the branch goes on where the cycle had better be cut elsewhere; None where it is cut well."""
    if run.recut and badly_cut(after) and not badly_cut(before):
        return _Pause.CUT_SHRINKS
    searching = run.options.provisional and run.line.point is not None
    fresh = seen_better(after, cast(CurvePoint, run.line.point), run.options) if searching else None
    if fresh is not None:
        return _cut_anew(run, fresh, way.sense)
    return _Pause.FIRST_SHRINKS if run.recut and first_shrinks(before, after) else None


def _one_of_many(run: Run[AnyOrbit]) -> End | None:
    """The end of a branch whose cycle is one of many, or becomes so at a bound; None where it stands alone there."""
    orbit, vary = run.last, run.branch.vary
    (t, u, setting), problem = unknowns_of(orbit), orbit.problem
    if problem.system is None or not np.any(abs(orbit.multipliers.half[1:] - 1) <= NEXT_TO_MANY):
        return None
    bounds = (run.how["low"], run.how["high"])
    for value in (*(x for x in bounds if abs(problem.distance(vary, x)) <= NEXT_TO_MANY), run.value(orbit)):
        there = replace(setting, p=problem.with_value(vary, value).vector())
        if many := one_of_many((t, u, there)):
            return End("one of many", f"the branch ends at {vary} = {value:.6g}: {many}", value)
    return None


def _at_an_end(run: Run[AnyOrbit], after: AnyOrbit) -> End | Complaint | None:
    """The end that a branch has come to with the next orbit, which it is given; None where it goes on.

    A Complaint where an event has begun to lead elsewhere: no step goes beyond.  And where one is met from behind, by
    less than counts: the equations turn round there, and that orbit is none of the branch.  Or a phase is gone but for
    rounding, by which they turn back: a fold in that step is none; what changes the stability is looked for in it.
    """
    if after.signature == run.last.signature and without_speed(after):
        return MET_FROM_BEHIND
    if (closed := met_itself(run, after) or came_round(run, after)) is not None:
        return closed
    before, gone = run.last, lacks_a_phase(after, run.branch.vary)
    run.add(after)
    if gone and before.seen_stable is after.seen_stable:
        return PHASE_GONE
    run.add(passed=run.line.past(after))
    if gone:
        return PHASE_GONE
    end = run.told_to_end() or comes_to(run.branch.orbits, run.branch.vary)
    return end or (LEADS_ELSEWHERE if leads_elsewhere(after) else None)


def _shrunk(branch: Branch[AnyOrbit]) -> SpecialPoint[AnyOrbit] | None:
    """The Hopf bifurcation that the last cycles lead to."""
    *others, last = branch.orbits
    size = float(np.max(ranges(last)))
    # Steps shrink where they fail: of cycles that hardly differ in size no law is seen.
    larger = (orbit for orbit in reversed(others) if float(np.max(ranges(orbit))) >= (1 + SPACED) * size)
    before = next(larger, others[-1] if others else None)
    return None if before is None else hopf_point(before, last, branch.vary)


def _cut_anew(run: Run[AnyOrbit], fresh: AnyOrbit, sense: float) -> Departure[AnyOrbit]:
    """On with the last orbit as it is cut now: period and parameter go as they did."""
    was, now = run.line.point, curve_point(fresh, run.branch.vary, sense=sense)
    run.replaced(fresh)
    heading = now.row if was is None or float(_rates(was) @ _rates(now)) >= 0 else -now.row
    return Departure(float(np.sign(heading[-1])), heading=heading)


def _rates(point: CurvePoint) -> Array:
    """(2,) how the logarithm of the period and the parameter go along the curve."""
    T, rate = (float(point.t.durations_of(u).sum()) for u in (point.u, point.du))
    return np.array([rate / T, point.row[-1]])


def _sense(branch: Branch[AnyOrbit], sense: float) -> float:
    """Which way the parameter went last."""
    ways = np.sign(np.diff(branch.values))
    return float(ways[np.flatnonzero(ways)[-1]]) if ways.any() else sense
