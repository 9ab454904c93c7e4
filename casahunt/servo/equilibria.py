"""Where a servo can stand still for ever, and what linearising there proves.

Rest.  While friction holds nothing moves, and the servo rests where nothing else changes either: all rates are zero,
friction holds the pull, and no part leaves its mode,

    f(x) = 0,   v = 0,   -Fs <= pull <= Fs,   e_j(x) <= 0 of the events of the parts' modes.

In each combination of modes f is affine, an e_j affine or the square of an affine one: the rest states are a polytope,
whose corners are found from the parts.  With an integrator it is the segment x1 = 0, |m| <= Fs; with a dead band on
its input, a leak, or without one, a range of positions.  A frozen integrator rests anywhere that its content allows.
Everywhere else in a stick something winds up, or a filter settles, until the servo breaks away.

LuGre rests there too, on a bristle bent by z = F/sigma0.  It cannot be bent beyond Fs/sigma0: z z' <= 0 there, since
g <= Fs, so this set of z is invariant.  The equations have fixed points beyond it, which no motion from inside reaches.

Generalised (Clarke) Jacobian there.  |v| has the generalised derivative 2 alpha - 1, alpha in [0, 1], and z' = c v with
c = 1 - (2 alpha - 1) sigma0 z/Fs in [0, 2] (g(0) = Fs, g'(0) = 0).  All members are those of alpha = 1 at
z = (1 - c) Fs/sigma0: the derivatives of the loop's field from v > 0.  Each has as many zero eigenvalues as the rest
states have directions.  At c = 0, at the ends |z| = Fs/sigma0, the bristle takes no part, and the others are the poles
of the linear loop without dry friction.  Of one inertia with a PID they are the roots of

    J s^3 + (kd + sigma2 + sigma1 c) s^2 + (kp + sigma0 c) s + ki,

in the open left half-plane if and only if (kd + sigma2 + sigma1 c)(kp + sigma0 c) > J ki (Routh-Hurwitz): the worst
member is c = 0, and there the condition is

    sharp     kd + sigma2 > J/(kp/ki),   kp/ki = tau_i + tau_d, kd = K cm tau_d for a controller by times,

the stability of the linear loop (gains.py), independent of sigma0 and sigma1.  For all K > 0 at once it is
    simple    sigma2/J > 1/(kp/ki)   (>= where kd > 0)
which is the report's sigma2/J > pi (section 4.1) only for its times tau_i = tau_d = 1/(2 pi).  It is sufficient for one
K, and necessary as well for all of them.
Where the sharp condition fails only members with c below `threshold` are unstable, a layer at the ends of the
segment that is thin because sigma0 is large.

What this does not prove: the members of the generalised Jacobian being stable (up to the zeros) does not prove that a
switched system made of them is; nor does an unstable member prove that an equilibrium is unstable.  And neither
says anything about hunting, which is a cycle away from the equilibria.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..axis_units import in_its_units
from ..export import Columns
from ..roots import boundary
from .basin import let_go, pull_on
from .friction import Model
from .linear.open_loop import linear_stable
from .parts.cascade import P_PI, P_PI_FILTERED
from .parts.inertia import INERTIA
from .parts.loop import Loop, breakaway_of, torque_gain
from .parts.lugre import LUGRE
from .parts.pid import INTEGRATOR, PID_BY_GAINS, PID_BY_TIMES
from .parts.plain_loop import LoopResult, loop_asked
from .parts.switch import SWITCH
from .rest_states import Rests, rest_states
from .servo import Servo
from .units import column

Array = np.ndarray

MEMBERS = np.concatenate([[0.0], np.geomspace(1e-9, 2.0, 200)])
"""Values of c at which members of the generalised Jacobian are looked at."""
FARTHEST_HELD = 1e9
"""Distance [rad] beyond which friction is not asked whether it holds the servo."""
HALVED_TO_ROUNDING = 50
"""Halvings of what is between two of them: to rounding."""
OF_A_PID = {INERTIA, SWITCH, LUGRE, PID_BY_TIMES, PID_BY_GAINS, P_PI, P_PI_FILTERED, INTEGRATOR}
"""Parts of one inertia with a PID."""
PROVES = (
    "what it proves: the eigenvalues of the linearisations at the equilibria. What it does not: left half-plane "
    "members of the generalised Jacobian do not prove stability of the switched system, an unstable member does not "
    "prove instability, and neither excludes a hunting cycle."
)


@dataclass(frozen=True, eq=False, repr=False)
class Equilibria(LoopResult):
    """The equilibria of a servo at one gain.

    Attributes
    ----------
    loop : the servo, as a loop of parts.
    rests : where it can stand still for ever: polytopes, one or more for each combination of modes to rest in.
    not_answered : combinations of modes whose rest states are not known, and why.
    ranges : of each state, "torque" [N m] that of the motor, over all rest states: least and largest; infinite where
        the equations set no limit.
    integral_limit : the largest |x3| of them [rad s]; nan without an integrator.
    position_limits : how far below and above the set point friction holds the servo that stands there with nothing
        wound up but what carries the load [rad]: Fs/kp of each direction.
    position_limit : the smaller one [rad].
    bristle_limit : Fs/sigma0 [rad]; nan for Switch.
    linear_stable : whether the loop without dry friction is; None where it is not linear.
    sharp : (left, right) sides of kd + sigma2 > J/(kp/ki) [N m s/rad]; nan but for one inertia with a PID.
    simple : (left, right) sides of sigma2/J > 1/(kp/ki) [1/s]; likewise.
    c, largest : (m,) members of the generalised Jacobian, and the largest real part [1/s] of their eigenvalues beside
        the zeros, in any of `rests`; empty for Switch.
    threshold : members with c below it have an eigenvalue in the right half-plane; 0 where none has, nan for Switch.

    Examples
    --------
    >>> from casahunt import Servo, equilibria
    >>> found = equilibria(Servo(), "switch", 0.1)
    >>> round(found.integral_limit, 4), found.sharp_holds  # rad s
    (0.0527, True)
    """

    _quantities = (
        "model", "gain [V/rad]", "integral_limit [rad s]", "position_limit [rad]", "sharp_holds", "simple_holds",
    )  # fmt: skip
    _details = (
        "ranges", "rests", "not_answered", "position_limits", "linear_stable", "bristle_limit [rad]",
        "largest_real_part [1/s]", "members = largest.size", "threshold",
    )  # fmt: skip

    loop: Loop
    rests: tuple[Rests, ...]
    not_answered: tuple[str, ...] = ()
    position_limits: tuple[float, float] = (math.nan, math.nan)
    linear_stable: bool | None = None
    sharp: tuple[float, float] = (math.nan, math.nan)
    simple: tuple[float, float] = (math.nan, math.nan)
    c: Array = field(default_factory=lambda: np.zeros(0))
    largest: Array = field(default_factory=lambda: np.zeros(0))
    threshold: float = math.nan

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Least and largest of each state and of the torque."""
        names = self.rests[0].names if self.rests else ()
        corners = np.vstack([each.corners for each in self.rests]) if self.rests else np.zeros((0, 0))
        return {name: (float(x.min()), float(x.max())) for name, x in zip(names, corners.T, strict=True)}

    @property
    def integral_limit(self) -> float:
        """The largest |x3|."""
        return max(abs(x) for x in self.ranges.get("x3", (math.nan,)))

    @property
    def position_limit(self) -> float:
        """|x1| up to which friction holds the servo on either side."""
        return min(self.position_limits)

    @property
    def bristle_limit(self) -> float:
        """Fs/sigma0."""
        return self.loop.value("static") / self.loop.value("stiffness") if self.model == "lugre" else math.nan

    @property
    def largest_real_part(self) -> float:
        """Of the eigenvalues of all members but the zeros [1/s]; nan for Switch."""
        return float(self.largest.max()) if self.largest.size else math.nan

    def _more(self) -> dict[str, Any]:
        conditions = ("sharp", self.sharp, self.sharp_holds), ("simple", self.simple, self.simple_holds)
        said = {
            f"{name}_condition": {"left": left, "right": right, "holds": holds}
            for name, (left, right), holds in conditions
        }
        return {**said, "proves": PROVES}

    def _columns(self) -> Columns:
        row = {
            "model": self.model,
            column("gain"): self.gain,
            "integral_limit_rad_s": self.integral_limit,
            "position_limit_rad": self.position_limit,
            "bristle_limit_rad": self.bristle_limit,
            "largest_real_part_per_s": self.largest_real_part,
            "sharp_left_Nms_per_rad": self.sharp[0],
            "sharp_right_Nms_per_rad": self.sharp[1],
            "simple_left_per_s": self.simple[0],
            "simple_right_per_s": self.simple[1],
            "threshold": self.threshold,
        }
        for name, of, unit in (("position", "x1", "rad"), ("torque", "torque", "Nm")):
            low, high = self.ranges.get(of, (math.nan, math.nan))
            row |= {f"least_rest_{name}_{unit}": low, f"largest_rest_{name}_{unit}": high}
        return {name: [value] for name, value in row.items()}

    @property
    def sharp_holds(self) -> bool | None:
        """Every member of one inertia with a PID has its three eigenvalues on the left; None of others."""
        return _exceeds(*self.sharp)

    @property
    def simple_holds(self) -> bool | None:
        """The same at every gain K > 0."""
        return _exceeds(*self.simple)


def _exceeds(left: float, right: float) -> bool | None:
    """Whether a condition holds; None where it is not asked."""
    return None if math.isnan(left) else left > right


def largest_of(rests: tuple[Rests, ...], c: Array) -> Array:
    """(m,) largest real part [1/s] of the eigenvalues of members c (m,) beside the zeros, in any of the rest sets."""
    largest = np.full(c.size, -math.inf)
    for each in rests:
        values = np.linalg.eigvals(each.members(c))
        beside = np.argsort(np.abs(values), axis=1)[:, each.directions :]
        largest = np.maximum(largest, np.take_along_axis(values, beside, axis=1).real.max(axis=1))
    return largest


@in_its_units
def equilibria(servo: Servo | Loop, model: Model | None = None, gain: float | None = None) -> Equilibria:
    """The equilibria of a servo, with the generalised Jacobian of LuGre.

    Parameters
    ----------
    servo, model, gain
        the servo, its friction model and gain K > 0 [V/rad]; or a loop of parts, without a model, at its own gain or
        another one.

    Returns
    -------
    Equilibria; `c` and `largest` (MEMBERS.size,) are empty without bristles.

    Raises
    ------
    InputError : unknown model, gain not a finite number > 0, or a loop without dry friction.

    Examples
    --------
    >>> from casahunt import Servo, equilibria
    >>> found = equilibria(Servo(), "lugre", 0.1)
    >>> float(found.largest.max()) < 0  # no member of the generalised Jacobian has an eigenvalue on the right
    True
    """
    loop = loop_asked(servo, model, gain)
    rests, not_answered = rest_states(loop)
    c, largest, limit = np.zeros(0), np.zeros(0), math.nan
    if LUGRE in loop.present and rests:
        c, largest = MEMBERS, largest_of(rests, MEMBERS)
        unstable = np.flatnonzero(largest > 0)
        limit = 0.0 if not unstable.size else float(c[-1])
        if unstable.size and unstable[-1] + 1 < c.size:
            low, high = c[unstable[-1]], c[unstable[-1] + 1]
            limit, _ = boundary(
                lambda at: bool(largest_of(rests, np.array([at]))[0] <= 0), low, high, rounds=HALVED_TO_ROUNDING
            )
    stable = linear_stable(loop)
    return Equilibria(loop, rests, not_answered, _held(loop), stable, *_of_the_report(loop), c, largest, float(limit))


def _held(loop: Loop) -> tuple[float, float]:
    """How far below and above the set point friction holds the loop that stands with nothing wound up but what carries
    the load [rad]; nan where it never does."""
    forward, back = breakaway_of(loop)
    if LUGRE not in loop.present and not any("stick" in mode.name for part in loop.present for mode in part.modes):
        return math.nan, math.nan

    def held(side: int) -> float:
        def slips(a: float) -> bool:
            return not -back <= pull_on(loop, let_go(loop, side * a)[1]) <= forward

        if slips(0.0):
            return math.nan
        return boundary(slips, 0.0, FARTHEST_HELD)[0] if slips(FARTHEST_HELD) else math.inf

    return held(-1), held(+1)


def _of_the_report(loop: Loop) -> tuple[tuple[float, float], tuple[float, float]]:
    """The sides of the sharp and of the simple condition, of one inertia with a PID; nan of other loops."""
    if not set(loop.present) <= OF_A_PID:
        return (math.nan, math.nan), (math.nan, math.nan)
    kp, kd, ki = (torque_gain(loop, name) for name in ("kp", "kd", "ki"))
    inertia, viscous = loop.value("inertia"), loop.value("viscous")
    return (kd + viscous, inertia * ki / kp), (viscous / inertia, ki / kp)
