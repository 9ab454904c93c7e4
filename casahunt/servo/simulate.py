"""The motion of a closed loop from any initial state: a march, event by event, with an error estimate.

    x1 = theta - theta_d,   x' = the product of the parts' fields (parts/product.py)

theta [rad] is the position of the servo, theta_d [rad] its constant set point.  The regulator task of the report is
theta_d = 1 rad from rest at theta = 0.

Accuracy.  `march` bounds the last Legendre coefficient of each interval; the ends of the intervals are
much better, and what that does to the times of the events depends on the servo.  Measured on 100 s of
the regulator task at K = 0.04: event times err by 1e-4 to 20 times the march tolerance [s].  So that is
not promised: the motion is computed twice, the second time with a march tolerance `REFINEMENT` times
smaller, and the difference is the error estimate.  While it exceeds the tolerance, the next pair follows.
The finer motion of the last pair is the result; as a rule its error is well below the estimate.  Two motions
may agree by chance: no estimate is smaller than `LEAST` of the finer march tolerance.

An event is compared with the nearest one of its kind that has it for its own nearest.  Weak ones come and go, as
reversals of bristles do and what a servo at rest still does by rounding: what that means for the motion is seen by its
states.  Where these do not agree either, no time of an event is known.

Symbols: n states, N intervals, m samples.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .. import effort
from ..axis_units import in_its_units, quantity
from ..checks import COMPUTED, choice_of, moderate, number, sensible
from ..errors import InputError, NotFollowed, Status
from ..motion import MarchFailure, Motion, Segment, follow_for
from ..orbits import Options
from .friction import Model
from .move import Move, a_move, begins_in, moving
from .parts.ahead import errors_of, measured
from .parts.fate import fate
from .parts.loop import Loop
from .parts.plain_loop import loop_asked
from .problem import Kind
from .servo import Servo
from .trajectory import Happening, Trajectory, told_first

Array = np.ndarray

REFINEMENT = 30.0
"""Ratio of the march tolerances of two motions that are compared."""
FIRST, COARSEST, FINEST = 1 / 30, 1e-4, 1e-11
"""March tolerance of the first motion in units of the tolerance; the largest one; the smallest one that rounding lets
the march reach."""
LEAST = 0.1
"""Smallest error estimate in units of the finer march tolerance."""
HOPELESS = 1e-2
"""No motion is marched with a larger tolerance."""
AS_IT_HUNTS, SPAN = 0.1, 20.0
"""March tolerances are relative to the sizes that states have in a motion from rest at this part of the error at which
the torque is static friction, and at least to this part of those that they have at first: a step may be so many times
as large as the hunting that it ends in."""
PHASES_LOOKED_AT = 3
"""From the start: more of them show sizes that a motion which grows comes to later."""
MOST_EVENTS, LONGEST_MESH = 20_000, 2_000_000
"""After which a motion is not followed further: some thousand periods."""
THROWN_OUT = 100.0
"""Times its size at first, from which on it is asked, each time that it is as much farther away, whether it comes
back."""
OF_ITS_SIZE = 1e-4
"""Two runs whose states differ by more than this part of their sizes are two motions."""
RESTS_WITHIN = 1e-9
"""What a servo still does within this part of the sizes of its states is rounding."""
NAMED = {"velocity": "x2", "integral": "x3", "bristle": "x4"}
"""States of a start that have a name of their own."""


@in_its_units
def simulate(
    servo: Servo | Loop, model: Model | None = None, gain: float | None = None, *, set_point: float | None = None,
    time: float = 100.0, position: float = 0.0, velocity: float = 0.0, integral: float = 0.0, bristle: float = 0.0,
    start: Mapping[str, float] | None = None, move: Move | None = None, tol: float = 1e-6,
) -> Trajectory:  # fmt: skip
    """The motion of the closed loop from an initial state.

    Parameters
    ----------
    servo, model, gain
        the servo, "switch" or "lugre", and the gain > 0; or a loop of parts, without a model, at its own gain or
        another one.
    set_point
        theta_d [rad]; default 1 rad, or one unit of length.
    time
        length of the motion [s], > 0.
    position, velocity
        theta [rad], which all angles of the loop are, and theta' [rad/s] at the start.
    integral
        x3 [rad s] at the start: the integral of theta - theta_d so far.
    bristle
        z [rad] at the start (LuGre only).
    start
        any other state of the loop at the start, by name, angles from the set point.
    move
        the profile by which the set point goes from `position` to theta_d; default: at once.
    tol
        bound on the error of event times [s] and of the final states relative to their largest values.

    Returns
    -------
    Trajectory; its status is TOLERANCE_NOT_REACHED where the estimated errors stay above `tol`.

    Raises
    ------
    InputError : a value out of range, or a state that the loop has not.
    NotFollowed : a NoOrbit: the motion could not be computed; says until when it was.

    Examples
    --------
    >>> from casahunt import Servo, simulate
    >>> motion = simulate(Servo(), "switch", 0.04, time=60.0)
    >>> motion.verdict.kind, motion.status.ok
    ('hunting', True)
    """
    loop = loop_asked(servo, model, gain)
    sensible("time", time, power=COMPUTED)
    tol = number("tol", tol)
    low, high = Options.TOLERANCES
    if not low <= tol <= high:
        raise InputError(f"tol = {tol:g}: must lie between {low:g} and {high:g}")
    theta_d = moderate("set_point", loop.units.step if set_point is None else set_point, power=COMPUTED)
    given = {"velocity": velocity, "integral": integral, "bristle": bristle}
    if (move := a_move(move)) is not None:
        # Refuse a motion that ends before its move does, behind which alone it rests or hunts
        lasts = move.time(theta_d - position)
        if not time > lasts:
            raise InputError(f"time = {time:g}: must be longer than the move, which takes {lasts:.4g} s")
    x = start_of(loop, theta_d, position, given, start, move)
    return followed(loop, theta_d, x, time, tol, move)


def start_of(
    loop: Loop, set_point: float, position: float, given: Mapping[str, float], others: Mapping[str, float] | None,
    move: Move | None = None,
) -> dict[str, float]:
    """Every state of a loop at a start, by name; filters have settled, before a move at the error zero.

    given: velocity, integral, bristle; others: states by name. Raises InputError: one is out of range, or not there.
    """
    beside = moderate("position", position, power=COMPUTED) - set_point
    x = loop.state(**dict.fromkeys(loop.angles, beside))
    for name, value in given.items():
        if moderate(name, value, power=COMPUTED) != 0 and NAMED[name] not in x:
            raise InputError(f"{name} = {value!r}: must be 0, as the {loop.name} has no {name}")
        if NAMED[name] in x:
            x[NAMED[name]] = float(value)
    own = {choice_of("state", name, x): moderate(name, value) for name, value in (others or {}).items()}
    x |= own
    return moving(loop, move, -x["x1"]).settled(x, own)


def followed(
    loop: Loop, set_point: float, start: Mapping[str, float], time: float, tol: float, move: Move | None = None
) -> Trajectory:
    """The motion of a loop from the states of a start; of one that grows until it cannot be followed, half of it.

    Raises NotFollowed: it cannot be, and does not grow.
    """
    began = clock.perf_counter()
    found = _refined(_Runs(loop, start, time, move), tol)
    if isinstance(found, _Pair):
        return _told(loop, set_point, found, tol, move, found.fine.ended, began)
    half = _refined(_Runs(loop, start, found.time / 2, move), tol) if found.time > 0 else found
    if isinstance(half, _Pair):
        told = _told(loop, set_point, half, tol, move, f"it could not be followed beyond {found.time:.6g} s", began)
        if told.verdict.kind == "growing":
            return told
    what = f"the motion of {loop.name} cannot be followed"
    raise NotFollowed(what, Status.NOT_CONVERGED, evidence=str(found), time=found.time)


@dataclass(frozen=True, eq=False)
class _Run:
    """A motion, the time that was asked for [s], why it ended early, and its march tolerance."""

    motion: Motion
    time: float
    ended: str
    tau: float

    def events(self, size: Array) -> tuple[list[tuple[str, str]], Array]:
        """Mode and name of each event, and its time; "" of those at which it rests, but for rounding: they are none.

        size: (n,) of the states.
        """
        times, states = self.motion.sample(2)
        away = np.flatnonzero((np.abs(states - states[:, -1:]) > RESTS_WITHIN * size[:, None]).any(axis=0))
        until = times[min(away[-1] + 1, times.size - 1)] if away.size else -np.inf
        happened = self.motion.events
        named = [(event.mode, event.event) if event.time <= until else ("", "") for event in happened]
        return named, np.array([event.time for event in happened])


class _Pair:
    """Two runs of one motion, and what they differ by.

    state_errors (n,): the largest differences at points of the finer mesh; end_error: at the end, relative to the sizes
    of the states; event_errors (k,) [s]; time_error: the largest of them.
    """

    def __init__(self, coarse: _Run, fine: _Run) -> None:
        self.fine = fine
        times, states = fine.motion.sample(3)
        shared = times <= coarse.motion.duration
        apart = np.abs(states[:, shared] - coarse.motion.at(times[shared]))
        size, least = np.abs(states).max(axis=1), LEAST * fine.tau
        size = np.where(size > 0, size, 1.0)
        self.state_errors = apart.max(axis=1) + least * size
        at_end = np.abs(fine.motion.phases[-1].end - coarse.motion.phases[-1].end) / size
        # motions that were both thrown out are compared at the last time that they share
        both = bool(fine.ended) == bool(coarse.ended)
        self.end_error = float((apart[:, -1] / size if fine.ended else at_end).max()) + least if both else np.inf
        self.event_errors = _event_errors(*(run.events(size) for run in (fine, coarse))) + least
        self.time_error = float(np.fmax.reduce(self.event_errors, initial=least))
        if np.isnan(self.event_errors).any() and (self.state_errors > OF_ITS_SIZE * size).any():
            self.time_error = np.inf

    def within(self, tol: float) -> bool:
        """Whether they agree to a tolerance."""
        return self.time_error <= tol and self.end_error <= tol


def _event_errors(fine: tuple[list[tuple[str, str]], Array], coarse: tuple[list[tuple[str, str]], Array]) -> Array:
    """(k,) by how much the times of events of the finer run differ from those of the coarser [s]; nan where it has no
    such event, or rests."""
    (ours, at), (theirs, other) = fine, coarse
    lively = [each for each in ours if each[0]]
    if lively == [each for each in theirs if each[0]]:
        of = [np.array([bool(each[0]) for each in events], bool) for events in (ours, theirs)]
        errors = np.full(at.size, np.nan)
        errors[of[0]] = np.abs(at[of[0]] - other[of[1]])
        return errors
    errors = np.full(at.size, np.nan)
    for kind in set(lively) & set(theirs):
        i, k = (np.flatnonzero([each == kind for each in events]) for events in (ours, theirs))
        apart = np.abs(at[i][:, None] - other[k])
        nearest = apart.argmin(axis=1)
        own = apart.argmin(axis=0)[nearest] == np.arange(i.size)
        errors[i[own]] = apart[np.arange(i.size), nearest][own]
    return errors


def _refined(run: _Runs, tol: float) -> _Pair | MarchFailure:
    """The first pair of runs that agrees to `tol`, or the finest pair that could be marched.

    Stiff and wide motions meet rounding before the march reaches `FINEST`: then the pair is made of the
    finest motion there is and a coarser one.
    """
    tau = max(min(FIRST * tol, COARSEST), FINEST * REFINEMENT)
    coarse: _Run | None = None
    found: _Pair | None = None
    while True:
        try:
            fine = run(tau)
        except MarchFailure as failure:
            if found is not None:
                return found
            if coarse is None:
                tau *= REFINEMENT
                if tau > HOPELESS:
                    return failure
                continue
            try:
                return _Pair(run(tau * REFINEMENT**2), coarse)
            except MarchFailure:
                return failure
        if coarse is not None:
            found = _Pair(coarse, fine)
            if found.within(tol) or tau <= FINEST:
                return found
        coarse, tau = fine, max(tau / REFINEMENT, FINEST)


class _Runs:
    """One motion, marched with any march tolerance."""

    def __init__(self, rest: Loop, start: Mapping[str, float], time: float, move: Move | None = None) -> None:
        loop = moving(rest, move, -start["x1"])
        self.begins = begins_in(loop, move, start)
        self.loop, self.start, self.time, self.system = loop, loop.state(**start), time, loop.system
        beside = AS_IT_HUNTS * (max(errors_of(rest)) or 1.0)
        first, hunting = (
            np.array([sizes.get(name, np.inf) for name in self.system.states])
            for sizes in (measured(loop, start, 0.0, many=PHASES_LOOKED_AT).sizes,
                          measured(rest, rest.at_rest(-beside), 0.0).sizes)
        )
        self.far = float(first[self.system.states.index("x1")]) or 1.0
        scale = np.minimum(np.maximum(hunting, first / SPAN), first)
        self.scale = np.where(scale > 0, scale, 1.0)
        self.kind: Kind = "radau" if any(mode.stiff for mode in self.system.modes) else "gauss"

    def __call__(self, tau: float) -> _Run:
        p, form = self.system.values(None), self.system.vector_form
        place = self.system.states.index("x1")
        limit, now, events, ended = THROWN_OUT * self.far, 0.0, 0, ""
        began = clock.monotonic()
        effort.at(
            lambda: f"followed to {now:.4g} s of {self.time:.4g} s{effort.left(now, self.time, began)}, to the march "
            f"tolerance {tau:.0e}"
        )  # fmt: skip

        def enough(segment: Segment) -> bool:
            nonlocal limit, now, events, ended
            now, events = now + segment.duration, events + bool(segment.event)
            if events > MOST_EVENTS:
                ended = f"{MOST_EVENTS} events by {now:.6g} s"
            elif (far := abs(float(segment.behind[place]))) > limit:
                limit = THROWN_OUT * far
                state = dict(zip(self.system.states, segment.behind.tolist(), strict=True))
                if fate(self.loop, state, measured(self.loop, state, far)).kind == "growing":
                    ended = f"{quantity(far, 'rad', '.3g')} away from the set point at {now:.6g} s"
            return bool(ended)

        phases = follow_for(
            form, self.begins, self.system.state(self.start, None), p, self.scale, self.kind,
            self.time, tau, enough, LONGEST_MESH,
        )  # fmt: skip
        return _Run(Motion(self.system, p, tuple(phases), np.nan, self.scale, self.kind), self.time, ended, tau)


def _told(
    loop: Loop, set_point: float, pair: _Pair, tol: float, move: Move | None, ended: str, began: float
) -> Trajectory:
    """The finer one of two runs, with what they differ by as its errors."""
    duration = pair.fine.motion.duration if pair.fine.ended else pair.fine.time
    motion = replace(pair.fine.motion, error=max(pair.end_error, pair.time_error / pair.fine.motion.duration))
    behind = [phase.mode for phase in motion.phases[1:]]
    if motion.phases[-1].event:
        last = motion.phases[-1]
        whole = moving(loop, move, -float(motion.phases[0].start[motion.system.states.index("x1")]))
        behind.append(whole.mode_at(**dict(zip(motion.system.states, last.behind.tolist(), strict=True))))
    happened = zip(motion.events, behind, pair.event_errors.tolist(), strict=False)
    order = [motion.system.states.index(name) for name in told_first(loop.system.states)]
    return Trajectory(
        loop=loop, set_point=set_point, duration=duration, motion=motion, move=move,
        events=tuple(Happening(e.time, e.event, e.mode, after, error) for e, after, error in happened), tol=tol,
        time_error=pair.time_error, end_error=pair.end_error, state_errors=pair.state_errors[order],
        status=Status.CONVERGED if pair.within(tol) else Status.TOLERANCE_NOT_REACHED, ended=ended,
        wall_s=clock.perf_counter() - began,
    )  # fmt: skip
