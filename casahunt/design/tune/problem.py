"""One problem of a tuning for IPOPT: cost, folds and linear loops in gain and controller times, or gains.

    minimise    c(K, tau_d, tau_i)     demands.py; by gains (kp, ki, kd) stand for the times here and below
    subject to  ln K >= ln(1 + margin) + ln K_b                     for every servo b that must not hunt
                ln kp <= ln (largest torque / step)
                G_b = 0,  G_b,u^T nu_b = 0,  nu_b . G_b,lambda = 1,   K_b = K_b0 (1 + lambda_b)   its fold
                |L_c(j w_c)| = 1,    phi_c(w_c) >= least             for every loop c in the way (loop_set.py)
                bounds on K, tau_d, tau_i

in (ln K, ln tau_d, ln tau_i), the logarithms of the crossovers, and u_b, lambda_b, nu_b of every fold:
continuation/fold_conditions.py, servo/linear.  Jacobian and Hessian are exact.  With b_2, b_1, b_0 the
coefficients of chi(s - rho)/J, the settling cost adds the Routh-Hurwitz conditions of the shifted polynomial, b_2 >= 0,
b_1 >= 0, b_0 >= 0, b_2 b_1 >= b_0.

Every constraint but the bounds and the torque may be broken at a price of `PRICE` per unit of its logarithm or
radian.  Below the price of breaking it no constraint is broken (exact penalty).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...collocation import minimise
from ...compiled import alone
from ...continuation import FoldConstraints
from ...servo.controller import torque_gains_of
from ...servo.linear.linear_loop import linear_loop
from ...servo.linear.margins import margins_of
from ...servo.linear.open_loop import OpenLoop
from ...servo.linear.sampled_loop import Lag, squared_size
from ...servo.problem import HuntingFold
from ...servo.servo import Servo
from .demands import DEMANDS, log_numbers, with_numbers

Array = np.ndarray

PRICE = 1e3
"""Of breaking a constraint, in units of the cost: what it gains, ratios of logarithms, is of size one."""
DERIVATIVE = ("controller.lead_time", "controller.kd")
"""What the high-frequency gain grows with."""
SLACKS = ("hunting margin", *DEMANDS)


@dataclass(frozen=True)
class Cut:
    """A loop that must keep a demand.

    Attributes
    ----------
    servo : its parameters, with the controller times as given; the motor gain may hold a factor of the gain.
    demand : one of `DEMANDS`.
    least : smallest phi [rad].
    """

    servo: Servo
    demand: str
    least: float


@dataclass(frozen=True, eq=False)
class TuningPoint:
    """A solution of one problem.

    Attributes
    ----------
    q, k : ln of the times, ln K.
    slack : by how much each of `SLACKS` is broken.
    converged, message : IPOPT's word.
    """

    q: Array
    k: float
    slack: Array
    converged: bool
    message: str


@dataclass(frozen=True, eq=False)
class Round:
    """What one problem is made of.

    Attributes
    ----------
    servo : the nominal servo with the times exp(q0) as given.
    cost : its name.
    q, k : where it starts.
    low, high : (2,) bounds of ln of the times; equal where a time is not free, or where it may not move.
    gains : bounds of K.
    needed : (1 + margin).
    folds : of the servos that must not hunt, at the times exp(q).
    cuts : loops.
    lag : sampling and delay.
    most : the largest kp of the nominal servo that the torque allows [N m/rad]; inf without a limit.
    """

    servo: Servo
    cost: str
    q: Array
    k: float
    low: Array
    high: Array
    gains: tuple[float, float]
    needed: float
    folds: Sequence[HuntingFold]
    cuts: Sequence[Cut]
    lag: Lag
    most: float = math.inf


@alone
def solve_round(r: Round) -> TuningPoint:
    """Solve one problem, from its start."""
    k, times, slack = ca.MX.sym("k"), ca.MX.sym("q", r.q.size), ca.MX.sym("slack", len(SLACKS))
    p = _Problem()
    p.add(k, [r.k], math.log(r.gains[0]), math.log(r.gains[1]))
    p.add(times, r.q, r.low, r.high)
    p.add(slack, np.zeros(len(SLACKS)), 0.0, np.inf)
    gain = math.exp(r.k)
    if math.isfinite(r.most):
        p.row(ca.log(_torque_gains(r.servo.motor_gain, k, times)[0]), -np.inf, math.log(r.most))
    for cut in r.cuts:
        _loop(p, cut, log_numbers(cut.servo) - log_numbers(r.servo), r, k, times, slack)
    derivative = [n in DERIVATIVE for n in r.servo.controller_names].index(True)
    cost = {"gain": k, "high-frequency": k + times[derivative]}.get(r.cost)
    if cost is None:
        cost = _settling(p, r.servo, k, times, gain)
    for fold in r.folds:
        constraints = FoldConstraints.of(fold, r.servo.controller_names)
        z, n = ca.MX.sym("z", constraints.z.size), ca.MX.sym("n", constraints.n.size)
        p.add(z, constraints.z, constraints.lowest, np.inf)
        p.add(n, constraints.n, -np.inf, np.inf)
        excess = k - math.log(r.needed * fold.gain) - ca.log(1 + z[-1]) + slack[0]
        p.row(excess, 0.0, np.inf)
        p.fold(constraints, times + (log_numbers(fold.orbit.servo) - r.q), times, z, n)
    found = p.solve(cost + PRICE * ca.sum1(slack))
    x, n = found.x, 1 + r.q.size
    return TuningPoint(x[1:n], float(x[0]), x[n : n + len(SLACKS)], found.status.ok, found.message)


def _loop(p: _Problem, cut: Cut, offset: Array, r: Round, k: ca.MX, times: ca.MX, slack: ca.MX) -> None:
    """Crossover and phase of one linear loop."""
    servo, y = cut.servo, ca.MX.sym("y")
    plant, there = (servo.inertia, servo.friction.viscous), with_numbers(servo, r.q + offset)
    J, sigma2, kp, kd, ki = r.lag.seen(*plant, *there.torque_gains(math.exp(r.k)))
    opened = OpenLoop(np.array([kd, kp, ki]), np.array([J, sigma2, 0.0, 0.0]))
    late = margins_of(opened, r.lag.delay + 2 * r.lag.half)
    start = math.log(late.frequency)  # with several crossovers the one of least phi is in the way
    p.add(y, [start], start - 20, start + 20)
    loop = r.lag.seen(*plant, *_torque_gains(servo.motor_gain, k, times + offset))
    p.row(ca.log(squared_size(loop, ca.exp(y))), 0.0, 0.0)
    p.row(r.lag.phase(loop, ca.exp(y)) + slack[SLACKS.index(cut.demand)], cut.least, np.inf)


def _torque_gains(motor_gain: float, k: ca.MX | float, times: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
    """kp, kd, ki of symbols."""
    return torque_gains_of(ca.exp(k) * motor_gain, *ca.vertsplit(ca.exp(times)))


def _settling(p: _Problem, servo: Servo, k: ca.MX, times: ca.MX, gain: float) -> ca.MX:
    """-ln rho, with the conditions that no pole is slower than rho."""
    plain = linear_loop(servo, gain)
    unit = plain.gain_crossovers[-1].frequency  # time in units of 1/unit makes the coefficients of size one
    rate = max(-float(np.max(plain.poles.real)), 1e-3 * unit)
    y = ca.MX.sym("ln_rho")
    p.add(y, [math.log(rate)], math.log(rate) - 20, math.log(rate) + 20)
    J, rho = servo.inertia, ca.exp(y) / unit
    kp, kd, ki = _torque_gains(servo.motor_gain / J, k, times)
    a2 = (kd + servo.friction.viscous / J) / unit
    a1, a0 = kp / unit**2, ki / unit**3
    b2, b1 = a2 - 3 * rho, a1 - 2 * a2 * rho + 3 * rho**2
    b0 = a0 - a1 * rho + a2 * rho**2 - rho**3
    for value in (b2, b1, b0, b2 * b1 - b0):
        p.row(value, 0.0, np.inf)
    return -y


class _Problem:
    """Variables and rows with their bounds, gathered; the Jacobian of the folds is given, the rest derived."""

    def __init__(self) -> None:
        self.symbols: list[ca.MX] = []
        self.starts: list[Array] = []
        self.bounds: list[Array] = []
        self.rows: list[ca.MX] = []
        self.row_bounds: list[Array] = []
        self.jacobians: list[tuple[ca.MX, list[tuple[ca.MX, ca.MX]]] | None] = []

    def add(self, symbol: ca.MX, start: Array | Sequence[float], low: Array | float, high: Array | float) -> None:
        """A variable."""
        x = np.asarray(start, float)
        self.symbols.append(symbol)
        self.starts.append(x)
        self.bounds.append(np.column_stack([np.broadcast_to(low, x.shape), np.broadcast_to(high, x.shape)]))

    def row(self, value: ca.MX, low: float, high: float) -> None:
        """A scalar constraint."""
        self.rows.append(value)
        self.row_bounds.append(np.array([[low, high]]))
        self.jacobians.append(None)

    def fold(self, constraints: FoldConstraints, own: ca.MX, times: ca.MX, z: ca.MX, n: ca.MX) -> None:
        """The conditions of a fold at the controller numbers exp(own); own = times + numbers."""
        self.rows.append(constraints.equations(own, z, n))
        self.row_bounds.append(np.column_stack([constraints.right, constraints.right]))
        J = constraints.jacobian(own, z, n)
        i, j = times.numel(), times.numel() + z.numel()
        self.jacobians.append((J, [(times, J[:, :i]), (z, J[:, i:j]), (n, J[:, j:])]))

    def solve(self, objective: ca.MX):  # type: ignore[no-untyped-def]
        """IPOPT's answer."""
        # A fresh symbol for the whole, of which the pieces are slices: CasADi wants one vector.
        x = ca.MX.sym("x", sum(s.numel() for s in self.symbols))
        pieces = ca.vertsplit(x, [0, *np.cumsum([s.numel() for s in self.symbols]).tolist()])
        few = ca.vertcat(*self.symbols)
        blocks = []
        for row, given in zip(self.rows, self.jacobians, strict=True):
            if given is None:
                blocks.append(ca.jacobian(row, few))
                continue
            height = row.numel()
            places = {id(symbol): block for symbol, block in given[1]}
            blocks.append(ca.horzcat(*[
                places.get(id(s), ca.MX(height, s.numel())) for s in self.symbols
            ]))  # fmt: skip
        expressions = [objective, ca.vertcat(*self.rows), ca.vertcat(*blocks)]
        f, g, J = ca.graph_substitute(expressions, self.symbols, pieces)
        return minimise(
            x, f, g, J, np.concatenate(self.starts), np.concatenate(self.bounds), np.concatenate(self.row_bounds)
        )
