"""Where motions of the Switch servo lead, for many initial states at once: to which stick, and to rest or to hunting.

    slip, s = sign(x2):   x1' = x2,   J x2' = m - s g(x2) - sigma2 x2,   x3' = x1
    m = -(kp x1 + kd x2 + ki x3),     g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)
    at x2 = 0:            |m| <= Fs is stick; |m| > Fs is a reversal, slip with s = sign(m)

To the stick phase.  `first_stick` follows each state through its slips to the first stick.  The report's Figure 5
draws |kp x1 + ki x3| < g(x2) for several x1: there s J x2' = -s (kp x1 + ki x3) - g - (kd + sigma2) |x2| < 0, the
speed falls.  That is said of one instant.  While the speed falls x1 and x3 move on, and the motion may leave the bound
before it stops, or enter it from outside; the region of attraction takes the whole motion.

To the fixed points.  After a stick at |x1| = a every motion is that of the event map P (servo/event_map/scan.py):
breakaway from (-+a, 0, +-(kp a - Fs)/ki), stick next at |P(a)|.  `attraction` iterates it until a is in one of two sets
that P maps into themselves, each shown by `WITNESSES` motions: the largest a0 up to the unstable cycle's amplitude with
|P(a)| < a for all a < a0 (it rests: x1 -> 0, at a fixed point x1 = x2 = 0, |x3| <= Fs/ki), and the widest interval
around the stable cycle's amplitude A with |P(a) - A| < |a - A| (it hunts).

Integration: Dormand and Prince 5(4), a step of its own for each motion, errors per step below `TOLERANCE` of the
swing's size sqrt(x1^2 + J x2^2/kp).  It shares nothing but the parameters with motion/phases.py, so that the two check
each other; it is for classifying some ten thousand states a second, not for digits.

Symbols: m motions, s sign of the slip, h step [s], P event map.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from casahunt.checks import COMPUTED, require, sensible
from casahunt.errors import InputError
from casahunt.servo.problem import HuntingOrbit
from casahunt.servo.servo import Servo

Array = np.ndarray

TOLERANCE = 1e-9
"""Error of one step in units of the swing's size."""
INITIAL_STEP = 1e-3
"""First step in units of the loop's time sqrt(J/kp)."""
LEAP = 0.5
"""No step changes the velocity by more than this part of max(|x2|, vs): the Stribeck peak, 2 vs wide, is not missed."""
CREPT = 1e-7
"""A slip that has come this near to x1 = 0, x2 = 0, m = s Fs, in units of its size, ends there: it creeps on, without a
stop, or to one that is as near."""
MOST_STEPS_OF_A_SLIP = 20_000
MOST_SLIPS_TO_STICK = 60
MOST_ITERATES = 200
WITNESSES = 400
"""Motions that show that P maps a set into itself."""
INNERMOST, BELOW_BORDER = 1e-4, 1e-6
"""The witnesses of rest start between INNERMOST and 1 - BELOW_BORDER of the unstable cycle's amplitude; further in, the
motion is that of the linear loop (g is flat at v = 0), P(a)/a constant."""
ROOT_ROUNDS, ROOT_TOLERANCE = 60, 1e-13
"""Steps of the root finder inside a step, and the part of the step, or of what is to vanish, that is left then."""
STUCK_TORQUE = 1 + 4 * np.finfo(float).eps
"""|m| up to this many Fs is stick: m = Fs but for rounding at the ends of the set of fixed points."""

# Dormand and Prince (1980): nodes are not needed, the field does not depend on time.
_A = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)


@dataclass(frozen=True, eq=False)
class FirstStick:
    """Where motions stick first.

    Attributes
    ----------
    position : (m,) x1 [rad] at the stick; 0 where the servo creeps to the set point without a stop (damped loops do);
        nan where it had not stuck after `MOST_SLIPS_TO_STICK` slips.
    integral : (m,) x3 [rad s] when it begins.
    time : (m,) [s] until then; inf for creeping.
    reversals : (m,) stops without stick on the way.
    falling : (m,) bool: the speed fell from the start to the stick (true for a state that is stuck).
    """

    position: Array
    integral: Array
    time: Array
    reversals: Array
    falling: Array


@dataclass(frozen=True, eq=False)
class Attraction:
    """Which of many initial states come to rest, and which hunt.

    Attributes
    ----------
    first : the first stick of each.
    rests, hunts : (m,) bool; neither where it was not decided after `MOST_ITERATES` swings.
    swings : (m,) swings after the first stick until that was decided.
    resting : stuck at |x1| below this [rad], the servo comes to rest.
    hunting : (low, high): stuck between these |x1| [rad], it ends in the stable cycle.
    """

    first: FirstStick
    rests: Array
    hunts: Array
    swings: Array
    resting: float
    hunting: tuple[float, float]


def first_stick(servo: Servo, gain: float, states: Array) -> FirstStick:
    """Follow motions of the Switch servo to their first stick.

    servo, gain: the servo; gain > 0; states: (3, m) initial x1 [rad], x2 [rad/s], x3 [rad s].  At x2 = 0 a state with
    |m| <= Fs is stuck. Returns FirstStick; position 0 for a motion that creeps to the set point, nan for one that does
    not come to stick. Raises InputError: gain not a finite number > 0, or states not (3, m) finite numbers.
    """
    sensible("gain", gain, power=COMPUTED)
    x = np.array(states, float)
    if x.ndim != 2 or len(x) != 3 or not np.isfinite(x).all():
        raise InputError(f"states with the shape {x.shape}: must be (3, m) finite numbers")
    return _first_stick(_Slip(servo, gain), x, np.sign(x[1]))


def swing(servo: Servo, gain: float, a: Array) -> Array:
    """The event map P(a) of the Switch servo at many stick positions.

    servo, gain: the servo; gain > 0; a: (m,) [rad], > 0. Returns (m,) the next stick positions [rad], with sign; nan
    where no stick was reached. Raises InputError: gain or an a that is not a finite number > 0.
    """
    sensible("gain", gain, power=COMPUTED)
    a = np.asarray(a, float).ravel()
    require("a", np.min(a, initial=np.inf) if np.isfinite(a).all() else np.nan, above=0)
    slip = _Slip(servo, gain)
    x = np.stack([-a, np.zeros_like(a), (slip.kp * a - slip.Fs) / slip.ki])
    return _first_stick(slip, x, np.ones_like(a)).position


def attraction(unstable: HuntingOrbit, stable: HuntingOrbit, states: Array) -> Attraction:
    """Which initial states come to rest at a fixed point, and which end in the hunting cycle.

    unstable, stable: the two Switch cycles at one gain (`find_orbit`); states: (3, m) initial x1 [rad], x2 [rad/s], x3
    [rad s].
    Returns attraction; a state of which neither is decided after `MOST_SWINGS` swings is in none of the two sets.
    Raises InputError: cycles of different servos, models or gains, or not one of each kind; states as `first_stick`.
    """
    servo, gain = stable.servo, stable.gain
    if unstable.model != "switch" or stable.model != "switch":
        raise InputError(f"model = {unstable.model!r}, {stable.model!r}: must be 'switch' for both cycles")
    if unstable.servo != servo or unstable.gain != gain:
        raise InputError(f"gains {unstable.gain:g} and {gain:g}: must be cycles of the same servo at the same gain")
    if unstable.stable or not stable.stable:
        raise InputError("the cycles: must be an unstable and a stable one, in this order")
    first = first_stick(servo, gain, states)
    inner, outer = _resting(unstable), _hunting(unstable, stable)
    a = np.abs(first.position)
    swings = np.zeros(a.size, int)
    for _ in range(MOST_ITERATES):
        rests, hunts = a <= inner, (a > outer[0]) & (a < outer[1])
        open_ = np.flatnonzero(~(rests | hunts | np.isnan(a)))
        if open_.size == 0:
            break
        a[open_] = np.abs(swing(servo, gain, a[open_]))
        swings[open_] += 1
    return Attraction(first, rests, hunts, swings, inner, outer)


def _resting(unstable: HuntingOrbit) -> float:
    """The largest a below which all witnesses have |P(a)| < a, at most the amplitude of the unstable cycle."""
    a = unstable.amplitude * (1 - np.geomspace(BELOW_BORDER, 1 - INNERMOST, WITNESSES))[::-1]
    smaller = np.abs(swing(unstable.servo, unstable.gain, a)) < a
    # Above the last witness the map is steep and crosses P = a only at the cycle itself.
    if smaller.all():
        return unstable.amplitude
    return float(a[np.argmin(smaller) - 1]) if smaller[0] else 0.0


def _hunting(unstable: HuntingOrbit, stable: HuntingOrbit) -> tuple[float, float]:
    """The widest interval around the amplitude of the stable cycle that all its witnesses approach it from."""
    middle, reach = stable.amplitude, abs(stable.amplitude - unstable.amplitude)
    away = np.geomspace(1e-3, 1 - BELOW_BORDER, WITNESSES // 2) * min(reach, 0.999 * middle)
    nearer = np.ones(away.size, bool)
    for side in (-1, 1):
        P = swing(stable.servo, stable.gain, middle + side * away)
        nearer &= np.abs(P - middle) < away
    count = away.size if nearer.all() else int(np.argmin(nearer))
    half = float(away[count - 1]) if count else 0.0
    return middle - half, middle + half


class _Slip:
    """The field of slip with sign s, for many motions at once."""

    def __init__(self, servo: Servo, gain: float) -> None:
        f = servo.friction
        self.J = servo.inertia
        self.kp, self.kd, self.ki = servo.torque_gains(gain)
        self.Fs, self.Fc, self.vs, self.sigma2 = f.static, f.coulomb, f.stribeck_velocity, f.viscous
        self.units = np.array([1.0, np.sqrt(self.J / self.kp), self.ki / self.kp])[:, None]
        """What makes errors of x1, x2, x3 comparable [rad]."""

    def torque(self, x: Array) -> Array:
        return -(self.kp * x[0] + self.kd * x[1] + self.ki * x[2])

    def __call__(self, x: Array, s: Array) -> Array:
        g = self.Fc + (self.Fs - self.Fc) * np.exp(-np.minimum((x[1] / self.vs) ** 2, 700.0))
        return np.stack([x[1], (self.torque(x) - s * g - self.sigma2 * x[1]) / self.J, x[0]])

    def size(self, x: Array) -> Array:
        """(m,) size of the swings that start here [rad]."""
        driven = np.maximum(np.abs(self.torque(x)) - self.Fs, 0.0) / self.kp
        return np.maximum(np.hypot(x[0], self.units[1] * x[1]), driven)

    def distance(self, x: Array, s: Array) -> Array:
        """(m,) from the end of the set of fixed points that a slip can creep to [rad]."""
        return np.maximum(np.hypot(x[0], self.units[1] * x[1]), np.abs(self.torque(x) - s * self.Fs) / self.kp)

    def step(self, x: Array, s: Array, h: Array, slope: Array) -> tuple[Array, Array, Array]:
        """(state, field, error) after a step h (m,) from x, where the field is `slope`."""
        k = [slope]
        for row in _A:
            y = x + h * sum(c * slope_i for c, slope_i in zip(row, k, strict=True) if c)
            k.append(self(y, s))
        error = np.abs(h * sum(c * slope_i for c, slope_i in zip(_ERROR, k, strict=True) if c))
        return y, k[-1], np.max(self.units * error, axis=0)


def _first_stick(slip: _Slip, x: Array, s: Array) -> FirstStick:
    """`s` (m,) is the sign of the first slip; 0 where it follows from the torque, or the state is stuck."""
    m = s.size
    time, reversals = np.zeros(m), np.zeros(m, int)
    falling, lost = np.ones(m, bool), np.zeros(m, bool)
    x, s = x.copy(), s.copy()
    moving = np.arange(m)
    for _ in range(MOST_SLIPS_TO_STICK + 1):
        resting = moving[s[moving] == 0]
        torque = slip.torque(x[:, resting])
        s[resting] = np.where(np.abs(torque) > STUCK_TORQUE * slip.Fs, np.sign(torque), 0.0)
        moving = moving[s[moving] != 0]
        if moving.size == 0:
            break
        starts_at_rest = x[1, moving] == 0
        end, took, fell, stopped = _to_the_stop(slip, x[:, moving], s[moving], starts_at_rest)
        x[:, moving], falling[moving] = end, falling[moving] & fell & ~starts_at_rest
        time[moving] += took
        lost[moving[~stopped]] = True
        moving = moving[stopped]
        reversals[moving] += np.abs(slip.torque(x[:, moving])) > STUCK_TORQUE * slip.Fs
        s[moving] = 0.0
    lost[moving] = True
    nan = np.where(lost, np.nan, 0.0)
    return FirstStick(x[0] + nan, x[2] + nan, time + nan, reversals, falling & ~lost)


def _to_the_stop(slip: _Slip, x: Array, s: Array, fresh: Array) -> tuple[Array, Array, Array, Array]:
    """Slips to x2 = 0: (state, duration, speed fell all the way, stopped); `fresh` ones start at x2 = 0."""
    m = s.size
    end, took, fell, stopped = x.copy(), np.zeros(m), np.ones(m, bool), np.zeros(m, bool)
    here, x, fresh = np.arange(m), x.copy(), fresh.copy()
    size, slope = slip.size(x), slip(x, s)
    h = np.full(m, INITIAL_STEP * np.sqrt(slip.J / slip.kp))
    t = np.zeros(m)
    for _ in range(MOST_STEPS_OF_A_SLIP):
        y, after, error = slip.step(x, s, h, slope)
        accurate, change = error <= TOLERANCE * size, np.abs(y[1] - x[1])  # nan is not accurate
        # The speed may dip to zero, or into the Stribeck peak, between the ends of a step: look at its minimum.
        turns = accurate & ~fresh & (s * slope[1] < 0) & (s * after[1] > 0) & (s * y[1] > 0)
        until = np.ones(here.size)
        if turns.any():
            until[turns] = _first_zero(slip, x, s, h, slope, turns, lambda y, after: after[1])
            low = slip.step(x[:, turns], s[turns], until[turns] * h[turns], slope[:, turns])[0]
            change[turns] = np.maximum(change[turns], np.abs(low[1] - x[1, turns]))
            until[turns] = np.where(s[turns] * low[1] <= 0, until[turns], 1.0)
        leap = change / (LEAP * np.maximum(np.abs(x[1]), slip.vs))
        bad = ~(accurate & (leap <= 1))
        crossed = ~bad & ~fresh & ((s * y[1] <= 0) | (until < 1))
        crept = ~bad & ~fresh & ~crossed & (slip.distance(y, s) < CREPT * size)
        fell[here[~bad]] &= (s * slope[1] < 0)[~bad]
        if crossed.any():
            theta = _first_zero(slip, x, s, h * until, slope, crossed, lambda y, after: y[1]) * until[crossed]
            final = slip.step(x[:, crossed], s[crossed], theta * h[crossed], slope[:, crossed])[0]
            final[1] = 0.0
            at = here[crossed]
            end[:, at], took[at], stopped[at] = final, t[crossed] + theta * h[crossed], True
        if crept.any():
            end[:, here[crept]] = np.array([[0.0], [0.0], [-slip.Fs / slip.ki]]) * np.where(s[crept], s[crept], 1.0)
            took[here[crept]], stopped[here[crept]] = np.inf, True
        good = ~bad & ~crossed & ~crept
        x[:, good], slope[:, good], t[good] = y[:, good], after[:, good], t[good] + h[good]
        size = np.maximum(size, slip.size(x))
        fresh[good] = False
        grow = 0.9 * np.maximum(np.nan_to_num(error, nan=np.inf) / (TOLERANCE * size), 1e-12) ** -0.2
        h = h * np.clip(np.minimum(grow, 0.9 / np.maximum(np.nan_to_num(leap, nan=np.inf), 1e-12)), 0.2, 4.0)
        if crossed.any() or crept.any():
            kept = ~(crossed | crept)
            here, s, h, t, fresh, size = here[kept], s[kept], h[kept], t[kept], fresh[kept], size[kept]
            x, slope = x[:, kept], slope[:, kept]
        if here.size == 0:
            break
    end[:, here], took[here] = x, t
    return end, took, fell, stopped


def _first_zero(
    slip: _Slip, x: Array, s: Array, h: Array, slope: Array, where: Array, value: Callable[[Array, Array], Array]
) -> Array:
    """Part of the step h at which s value(state, field) changes sign, for the motions `where`: Illinois iteration."""
    x, s, h, slope = x[:, where], s[where], h[where], slope[:, where]
    low, high = np.zeros(s.size), np.ones(s.size)
    f_low = s * value(x, slope)
    start = np.abs(f_low)
    y, after, _ = slip.step(x, s, h, slope)
    f_high = s * value(y, after)
    middle, side = high, np.zeros(s.size, int)
    for _ in range(ROOT_ROUNDS):
        width = f_high - f_low
        before = middle
        middle = np.where(width != 0, low - f_low * (high - low) / np.where(width != 0, width, 1.0), high)
        y, after, _ = slip.step(x, s, middle * h, slope)
        f = s * value(y, after)
        on_low = np.sign(f) == np.sign(f_low)
        # The end that stays twice in a row is given half its value: that is what makes the other one move.
        f_high = np.where(on_low, np.where(side == 1, 0.5, 1.0) * f_high, f)
        f_low = np.where(on_low, f, np.where(side == -1, 0.5, 1.0) * f_low)
        side = np.where(on_low, 1, -1)
        low, high = np.where(on_low, middle, low), np.where(on_low, high, middle)
        if np.all((np.abs(f) <= ROOT_TOLERANCE * start) | (np.abs(middle - before) < ROOT_TOLERANCE)):
            break
    return middle
