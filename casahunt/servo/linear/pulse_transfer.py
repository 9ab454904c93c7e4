"""The loop as built, without dry friction, opened at the torque: a pulse transfer function.

    L(z) = -C(z) P(z) z^-l,   z = exp(i omega T),   delay = l T + p,   0 <= p < T

P is that of the angle that is read by the torque u which is held, from the plant's field x' = A x, u one of its states:
exp(A p) under the torque before, then exp(A (T - p)) under the present one.  C is that of u by the angle, from the
parts that the drive runs, as difference equations (sampled/controller.py): their slopes.  Parts that the drive adds
itself and that are not linear, as a dead band, are taken as far off: as if they were not there.

    P(z) = c (delta - N)^-1 (b + b_before/z),   N = exp(A T) - 1,   delta = z - 1
    C(z) = r (delta - M)^-1 (f + f' d(z)) + k + k' d(z),   d(z) = (1 - 1/z)/T, the difference quotient

The states' own gain in a sample is what is computed, not what they become: an integrator is a zero, not a rounded one.
Stability is that of the matrix that takes the closed loop from sample to sample.

Source: Middleton and Goodwin, Digital Control and Estimation (1990), for delta in the place of z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...compiled import Caller, caller, kept
from ...errors import InputError
from ..drive import Drive
from ..parts.loop import Loop
from ..parts.part import Part
from ..sampled.controller import NOT_FINITE, READ, RUN, numbers_of, sample_of
from ..sampled.plant import as_run, plant_of
from .open_loop import not_linear, slopes_of, smooth

Array = np.ndarray

SERIES_WITHIN, TERMS = 0.25, 16
"""The series of exp is taken where A t has this size, by so many terms: to rounding."""
CLOSED_BY_MATRIX = 100
"""Samples of delay up to which the closed loop is looked at as a matrix."""


@dataclass(frozen=True, eq=False)
class PulseTransfer:
    """L(z).

    Attributes
    ----------
    plant, held, angle : (n, n) N, (n, 2) b_before and b, (n,) c.
    controller, reads, torque, direct : (m, m) M, (m, 2) f and f', (m,) r, (2,) k and k'.
    sample_time, late : T [s], l.
    """

    plant: Array
    held: Array
    angle: Array
    controller: Array
    reads: Array
    torque: Array
    direct: Array
    sample_time: float
    late: int

    def response(self, omega: Array) -> Array:
        """(m,) L at frequencies [rad/s] up to pi/T."""
        half = omega * self.sample_time / 2
        delta = 2j * np.sin(half) * np.exp(1j * half)
        before = np.exp(-2j * half)
        read = np.array([np.ones_like(before), before * delta / self.sample_time])
        P = _through(self.plant, self.held @ np.array([before, np.ones_like(before)]), delta, self.angle)
        C = _through(self.controller, self.reads @ read, delta, self.torque) + self.direct @ read
        return np.asarray(-C * P * np.exp(-2j * half * self.late))

    def closed(self) -> Array:
        """The gain in a sample of (x, torques on their way, the one that acts first, controller, last angle)."""
        n, m, T = self.angle.size, self.torque.size, self.sample_time
        on_way, own = slice(n, n + self.late + 1), slice(n + self.late + 1, n + self.late + 1 + m)
        one = np.eye(own.stop + 1)
        angle = self.angle @ one[:n]
        read = np.array([angle, (angle - one[-1]) / T])
        torques = np.vstack([one[on_way], self.direct @ read + self.torque @ one[own]])
        return np.vstack([
            self.plant @ one[:n] + self.held @ torques[:2],
            np.diff(torques, axis=0),
            self.controller @ one[own] + self.reads @ read,
            angle - one[-1],
        ])  # fmt: skip

    @property
    def stable(self) -> bool | None:
        """Whether the closed loop is stable; None where its delay makes it too large to be looked at so."""
        if self.late > CLOSED_BY_MATRIX:
            return None
        gains = np.linalg.eigvals(self.closed())
        return bool(np.all(2 * gains.real + np.abs(gains) ** 2 < 0))

    @property
    def poles(self) -> Array:
        """Poles of L as those of a continuous loop [1/s]; of what is forgotten within a sample none."""
        gains = np.concatenate([np.linalg.eigvals(self.plant), np.linalg.eigvals(self.controller)])
        gains = gains[np.abs(1 + gains) > 1e-9].astype(complex)
        return np.asarray(np.log1p(gains) / self.sample_time)


def pulse_transfer(loop: Loop, drive: Drive) -> PulseTransfer:
    """L(z) of a loop of parts with its drive.  Raises InputError: it is not linear."""
    loop = loop.within_limits
    if smooth(loop)[1]:
        raise not_linear(loop)
    run = as_run(loop, drive)
    plant, own = plant_of(run)
    found = slopes_of(smooth(plant)[0], run, "angle")
    if found is None:
        raise not_linear(loop)
    T, (late, part) = drive.sample_time, divmod(drive.delay, drive.sample_time)
    A, c = _seen(*found, keep=1)
    first, then, whole = (gain_in(A, lasts)[:-1] for lasts in (part, T - part, T))
    held = np.column_stack([first[:, -1] + then[:, :-1] @ first[:, -1], then[:, -1]])
    compiled = _controller(own, tuple(run.parameters))
    if compiled is None:
        raise InputError(f"{loop.name}: is not linear as its drive runs it; there are no margins")
    buffers = compiled.buffers
    buffers.inputs[0][:] = list(numbers_of(run, drive).values())
    buffers.trigger()
    M, reads, torque, direct = (each.copy() for each in buffers.outputs)
    if not all(np.isfinite(each).all() for each in (M, reads, torque, direct)):
        raise InputError(f"{loop.name}: {NOT_FINITE}; there are no margins")
    M, torque, reads = _seen(M, torque, reads)
    return PulseTransfer(whole[:, :-1], held, c[:-1], M, reads, torque, direct, T, int(late))


def gain_in(A: Array, t: float) -> Array:
    """exp(A t) - 1, by its series and by doublings; a column of zeros stays one."""
    X = A * t
    size = max(np.abs(np.linalg.matrix_power(X, k)).sum(axis=0).max() ** (1 / k) for k in (4, 5))
    doublings = max(0, math.ceil(math.log2(size / SERIES_WITHIN))) if size > 0 else 0
    X = X / 2**doublings
    term, total = X, X
    for k in range(2, TERMS):
        term = term @ X / k
        total = total + term
    for _ in range(doublings):
        total = 2 * total + total @ total
    return np.asarray(total)


def _through(N: Array, given: Array, delta: Array, row: Array) -> Array:
    """row (delta - N)^-1 given, of (n, m) at (m,) deltas."""
    matrices = delta[:, None, None] * np.eye(len(N)) - N
    try:
        return np.asarray(np.linalg.solve(matrices, given.T[:, :, None])[..., 0] @ row)
    except np.linalg.LinAlgError:  # one is a pole on the unit circle: beside it
        return _through(N, given, delta * (1 + 2 * np.finfo(float).eps), row)


def _seen(N: Array, row: Array, *columns: Array, keep: int = 0) -> tuple[Array, ...]:
    """A map and its output without the states that are never seen in it, but for the last ones, which are kept."""
    seen = (row != 0) | (np.arange(row.size) >= row.size - keep)
    for _ in range(row.size):
        seen = seen | (N[seen] != 0).any(axis=0)
    return N[np.ix_(seen, seen)], row[seen], *(column[seen] for column in columns)


@kept(maxsize=64)
def _controller(parts: tuple[Part, ...], names: tuple[str, ...]) -> Caller | None:
    """Parameters and rules -> M, f and f', r, k and k' of the parts that a drive runs; None where it is not linear."""
    step = sample_of(parts, tuple(part.modes[0] for part in parts), names).step
    Y, read, p = (ca.SX.sym(name, step.size1_in(i)) for i, name in enumerate(("Y", "read", "p")))
    angle, rate = ca.SX.sym("angle"), ca.SX.sym("rate")
    given = ca.vertcat(angle, angle - p[-len(RUN)] * rate, *[0] * (len(READ) - 2))
    after, torque, _ = step(Y, given, p)
    u = ca.vertcat(angle, rate)
    slopes = [ca.jacobian(what, by) for what in (after - Y, torque) for by in (Y, u)]
    if ca.depends_on(ca.vertcat(*(ca.vec(ca.densify(slope)) for slope in slopes)), ca.vertcat(Y, u)):
        return None
    n = Y.numel()
    function = ca.Function("controller", [p], [ca.densify(slope.T) for slope in slopes])
    return caller(function, [p.numel()], [(n, n), (n, 2), n, 2])
