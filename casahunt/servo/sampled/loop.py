"""The loop as built: a controller that is run by its samples, and between its torques the exact motion of the plant.

At t_k = k T the controller reads an angle and forms a torque u_k (controller.py), and the plant (plant.py) has

    m = u_k for t_k + delay <= t < t_{k+1} + delay, and 0 before the first of them

Where the torque moves nothing of the plant, and the reading stays, all samples up to a breakaway or a new mode of the
controller are one array.  The loop rests for ever, and that is a proof, where so it is and the torques on their way and
all that the controller can still ask for leave it there.  A load that is read and rings down leaves the reading where
it is when all of its ringing is within one count; without an encoder the ringing is part of the controller's map.
Readings with noise never stay: each stick is followed by its samples, and what is known at its end are the torques
between which it stays stuck.  LuGre friction never sticks: it is followed by its samples, as slips are, some in a row.

Symbols: T sample time [s], u, m torques [N m].

Samples in a row, compiled, in which neither the plant nor the controller changes its mode:

    Z = (x, Y, torques on their way, last reading, whether it moved)  ->  Z a sample later, u, and whether all is well:
    one step of the plant's series is enough, no event of it can be met, and no mode of the controller ends
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ... import effort
from ...compiled import Caller, caller, kept
from ...errors import InputError
from ..drive import Drive
from ..parts.loop import Loop
from .controller import Controller, Sample
from .plant import HELD, SHOWS, TOO_SMALL_TO_SHOW, Plant, plant_of
from .steps import LAST_COEFFICIENTS, Stepped, step_of

Array = np.ndarray

MOST_SINGLE = 15
"""Samples that are taken one by one at most where rows are tried in vain, before the next one is."""
TRIED_AT_ONCE = 4, 24
"""Samples that are tried at once: behind what ended a mode, and then."""
ASKED_AGAIN = 100
"""Samples after which it is asked again whether it rests for ever, while what is read rings on."""


def in_a_row(plant: Plant, controller: Controller, seen: int, waiting: int, parted: bool) -> tuple[Caller, ...]:
    """As many samples as `TRIED_AT_ONCE` says; parted: a sample begins with the torque of the one before."""
    mode = plant.mode
    kinds = controller.q > 0, controller.step > 0, parted, controller.waits
    found: tuple[Caller, ...] = _compiled(
        mode.stepped, plant.held, controller.compiled, seen, waiting, kinds
    )
    return found


@kept(maxsize=256)
def _compiled(
    stepped: Stepped, held: int, sample: Sample, seen: int, waiting: int,
    kinds: tuple[bool, bool, bool, bool],
) -> tuple[Caller, ...]:  # fmt: skip
    """The same of a mode of the plant and modes of the controller; kinds: see above."""
    reads_counts, in_steps, parted, waits = kinds
    found = step_of(*stepped)
    assert found is not None  # the mode has a series
    step, n, parameters = found[0], stepped[3], stepped[4]
    Y_size, numbers = sample.step.size1_in(0), sample.step.size1_in(2)
    x, Y, W, off = ca.SX.sym("x", n), ca.SX.sym("Y", Y_size), ca.SX.sym("W", waiting), ca.SX.sym("off")
    a_last, moved_last = ca.SX.sym("a"), ca.SX.sym("moved")
    q, theta_d, smallest, part, sign = (ca.SX.sym(name) for name in ("q", "theta_d", "smallest", "part", "sign"))
    sides = ca.SX.sym("sides", len(sample.edges) + 1)
    p, own = ca.SX.sym("p", parameters), ca.SX.sym("own", numbers)
    a = q * ca.floor((theta_d + x[seen] + off) / q + 0.5) - theta_d if reads_counts else x[seen] + off
    moved = a != a_last
    after, u, events = sample.step(Y, ca.vertcat(a, a_last, moved, ca.sign(a - a_last)), own)
    good = [
        edge.direction * (events[i] - beyond) <= 0 if edge.direction else sides[i] * events[i] > 0
        for i, (_, edge, beyond) in enumerate(sample.edges)
    ]
    good += [moved == moved_last, sides[-1] * after[-2] > 0] if waits else []
    u = smallest * ca.floor(u / smallest + 0.5) if in_steps else u
    torques = ca.vertcat(W, u)
    T = own[numbers - 2]
    state = x
    for torque, lasts in ((torques[0], part), (torques[1], T - part))[not parted :]:
        begins = ca.vertcat(state[:held], torque, state[held + 1 :])
        _, state, _, seen = step(begins, lasts, sign, p)
        tail, before, behind, most = ca.vertsplit(seen)
        good += [tail <= LAST_COEFFICIENTS, ca.logic_or(before >= TOO_SMALL_TO_SHOW, behind <= SHOWS), most < 0]
    well = ca.SX(1)
    for each in good:
        well = ca.logic_and(well, each)
    Z, more = ca.vertcat(x, Y, W, a_last, moved_last), ca.vertcat(q, theta_d, smallest, part, sign, sides)
    Z_after = ca.vertcat(state, after, torques[1:], a, moved)
    one = ca.Function("sample", [Z, off, more, p, own], [Z_after, u, well])
    sizes, several = [more.numel(), parameters, numbers], []
    for count in TRIED_AT_ONCE:
        first, noise = ca.MX.sym("Z", Z.numel()), ca.MX.sym("noise", count)
        same = [ca.MX.sym(f"i{i}", size) for i, size in enumerate(sizes)]
        rows = one.mapaccum("samples", count)(first, noise.T, *(ca.repmat(each, 1, count) for each in same))
        several.append(caller(ca.Function("samples", [first, noise, *same], rows), [Z.numel(), count, *sizes],
                              [(count, Z.numel()), (count, 1), (count, 1)]))  # fmt: skip
    return tuple(several)


@dataclass(frozen=True, eq=False)
class Sampled:
    """The states at the samples.

    Attributes
    ----------
    names : of the n states: those of the plant, and those of the controller as they are before the sample.
    states : (n, m + 1) angles from the set point [rad], rates [rad/s], and what the controller has.
    torque : (m,) u [N m].
    stops : times of the stops [s].
    rests_from : sample from which it is known to rest for ever; -1 where it is not.
    held : torques [N m] between which it stays stuck at the end, for ever; nan where something moves.
    """

    names: tuple[str, ...]
    states: Array
    torque: Array
    stops: Array
    rests_from: int
    held: tuple[float, float]


class SampledLoop:
    """A loop with its drive.

    loop, drive: what it is; set_point: theta_d [rad]; start: states by name, angles from the set point.
    """

    def __init__(self, loop: Loop, drive: Drive, set_point: float, start: Mapping[str, float]) -> None:
        plant, run_by_the_drive = plant_of(loop)
        given = {name: value for name, value in start.items() if value or name in plant.system.states}
        self.plant = Plant(plant, given)
        self._many = len(self.plant.names) - len(HELD.states)
        # Which state of the plant the encoder reads
        nowhere = np.eye(len(loop.system.states))
        read = loop.signal("angle", loop.system.modes[0].name, nowhere)
        found = [name for name, value in zip(loop.system.states, read, strict=True) if value == 1]
        if len(found) != 1 or found[0] not in self.plant.names or np.count_nonzero(read) != 1:
            raise InputError(f"{loop.name}: its angle is no state that an encoder could read")
        self._seen = self.plant.names.index(found[0])
        first = self.x + float(drive.noises(1)[0])
        self.controller = Controller(loop, run_by_the_drive, drive, set_point, first, given)
        self.names = (*self.plant.names[: self._many], *self.controller.names)
        self.T, self._noises = drive.sample_time, drive.noises if drive.noise else np.zeros
        late, self._part = divmod(drive.delay, self.T)
        self.waiting = [0.0] * (int(late) + 1)
        """Torques on their way, the one that acts at the sample first."""

    @property
    def x(self) -> float:
        """The angle that is read, from the set point [rad]."""
        return float(self.plant.x[self._seen])

    def run(self, samples: int, farthest: float) -> Sampled:
        """The motion; it ends early where the angle is more than `farthest` [rad] from the set point."""
        noise = self._noises(samples)
        self.noise, noisy = np.append(noise, np.zeros(max(TRIED_AT_ONCE))), bool(noise.any())
        self.states, self.torque = np.empty((samples + 1, len(self.names))), np.empty(samples)
        stops: list[float] = []
        k, rests_from = 0, -1
        effort.motion_begins()
        effort.at(lambda: f"followed to sample {k} of {samples}")
        few, single, wait, asked_at = True, 0, 0, -ASKED_AGAIN
        while k < samples and abs(self.x) <= farthest:
            asked = not noisy and rests_from < 0 and (wait == 0 or self.plant.still) and self.plant.left_alone
            ringing = self.plant.ringing(self._seen) if asked else None
            if ringing is not None and self.controller.stays(self.x, ringing.least, ringing.most):
                if self.rests():
                    rests_from, k = k, self._stuck(k, samples, for_ever=True)
                    break
                k = self._stuck(k, samples)
                if k == samples:
                    break
            elif ringing is not None and not self.controller.q and k >= asked_at + ASKED_AGAIN:
                rests_from, asked_at = k if self.rests() else -1, k
            if wait > 0:
                wait -= 1
            elif not self.plant.still and (taken := self._row(k, samples, few)) > 0:
                k, few, single = k + taken, taken < TRIED_AT_ONCE[not few], 0
                continue
            else:
                single = wait = min(2 * single + 1, MOST_SINGLE) if not self.plant.still else 0
            self._sample(k, stops)
            k, few = k + 1, True
        self._keep(k)
        held = math.nan, math.nan
        if self.plant.left_alone:
            _, lows, highs = self.plant.ahead(self.T, 1)
            held = float(lows[0]), float(highs[0])
        return Sampled(self.names, self.states[: k + 1].T, self.torque[:k], np.array(stops), rests_from, held)

    def _keep(self, k: int) -> None:
        self.states[k, : self._many] = self.plant.x[: self._many]
        self.states[k, self._many :] = self.controller.Y[:-2]

    def _sample(self, k: int, stops: list[float]) -> None:
        """One sample, whatever it does."""
        self._keep(k)
        u = self.controller.sample(self.x + self.noise[k])
        self.torque[k] = u
        self.waiting.append(u)
        now = k * self.T
        before = self.waiting.pop(0)
        for m, at, lasts in ((before, now, self._part), (self.waiting[0], now + self._part, self.T - self._part)):
            if lasts > 0:
                stops += [at + t for t in self.plant(m, lasts)]

    def _row(self, k: int, samples: int, few: bool) -> int:
        """Go on by some samples in which no mode of the plant or the controller ends; how many these are."""
        if not self.plant.mode.has_series:
            return 0
        compiled = in_a_row(self.plant, self.controller, self._seen, len(self.waiting), self._part > 0)
        buffers = compiled[not few].buffers
        n, plant, controller = self._many, self.plant, self.controller
        given = (
            (*plant.x, *controller.Y, *self.waiting, controller.a, controller.moved),
            self.noise[k : k + TRIED_AT_ONCE[not few]],
            (controller.q, controller.theta_d, controller.step, self._part, plant.mode.mode.sign, *controller.sides),
            plant.p, controller.p,
        )  # fmt: skip
        for store, value in zip(buffers.inputs, given, strict=True):
            store[:] = value
        buffers.trigger()
        Z, u, good = buffers.outputs
        bad = np.flatnonzero(good != 1)  # a number that is none is not good either
        count = min(int(bad[0]) if bad.size else len(good), samples - k)
        if count == 0:
            return 0
        many, end, own = plant.x.size, plant.x.size + controller.Y.size - 2, slice(None, n)
        self._keep(k)
        self.states[k + 1 : k + count, own] = Z[: count - 1, own]
        self.states[k + 1 : k + count, n:] = Z[: count - 1, many:end]
        self.torque[k : k + count] = u[:count, 0]
        last = Z[count - 1]
        plant.x[:], controller.Y[:] = last[:many], last[many : end + 2]
        *self.waiting, controller.a, moved = last[end + 2 :].tolist()
        controller.moved = moved > 0
        effort.pieces(count)
        return count

    def rests(self) -> bool:
        """Whether a loop that is left alone rests for ever, but for what dies out: its counts stay, or it has none."""
        _, lows, highs = self.plant.ahead(self.T, 1)
        low, high = float(lows[0]), float(highs[0])
        if (ringing := self.plant.ringing(self._seen)) is None:
            return False
        holds = low <= min(self.waiting) <= max(self.waiting) <= high
        return holds and self.controller.stays_within(low, high, None if self.controller.q else ringing)

    def _stuck(self, k: int, samples: int, for_ever: bool = False) -> int:
        """Go on to the sample in which the mode ends or the controller changes, or to the last one; returns which."""
        asked, kept = 0, len(self.waiting)
        while k < samples:
            Y, u, complete = self.controller.ahead(asked)
            there, asked = len(u), asked + 1
            Y, u = Y[: samples - k], u[: samples - k]
            if not u.size:
                return k
            states, low, high = self.plant.ahead(self.T, u.size)
            # torques[j] acts from the part of sample k + j - 1 on up to that of the next one
            torques, since = np.concatenate([self.waiting, u]), np.arange(u.size + kept).clip(1, u.size) - 1
            beyond = np.flatnonzero((torques < low[since]) | (torques > high[since])) [: None if not for_ever else 0]
            n = min(max(int(beyond[0]) - 1, 0), u.size) if beyond.size else u.size
            if n == 0:
                return k
            self._keep(k)
            self.states[k + 1 : k + n, : self._many] = states[: n - 1, : self._many]
            self.states[k + 1 : k + n, self._many :] = Y[: n - 1, :-2]
            self.torque[k : k + n] = u[:n]
            self.waiting = [*self.waiting, *u[:n].tolist()][-kept:]
            self.plant.x[:], self.controller.Y[:] = states[n - 1], Y[n - 1]
            k += n
            effort.pieces(1)
            if n < there or not complete:
                return k
            if not for_ever and asked & (asked - 1) == 0 and self.rests():  # what dies out may have done so
                return k
        return k
