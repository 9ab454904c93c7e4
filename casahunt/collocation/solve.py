"""Which solver solves: Newton (newton.py) or IPOPT (ipopt.py), alone or one after the other.

A root of the equations, under a border row or at a fixed lambda; or the extremum of lambda (fold_system.py).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import Status
from .ipopt import ipopt, maximise_parameter
from .newton import LARGEST_MOVE, MOST_TURNS, Solution, Solver, Turn, newton, status_of
from .transcription import Setting, Transcription

Array = np.ndarray

POLISHING, POLISHED = 4, 1e-2
"""Newton steps after IPOPT, and how far they may lead away from its point."""
OPTIMAL_INTERVALS = 500
"""Of a mesh on which IPOPT seeks an extremum: it takes minutes and gigabytes on larger ones."""


def ipopt_then_newton(t: Transcription, u: Array, setting: Setting) -> Solution:
    """IPOPT from where Newton's method may not converge, and Newton's method from where it arrives.

    Returns solution, judged by its distance from `u`.
    """
    found = ipopt(t, u, setting)
    if found.status not in (Status.CONVERGED, Status.NOT_CONVERGED):
        return found
    polished = newton(t, found.u, setting, max_iterations=POLISHING, largest_move=POLISHED)
    if not polished.status.ok:
        return found if not found.status.ok else polished
    status = status_of(t, u, polished.u, polished.residual, True, LARGEST_MOVE)
    return replace(polished, status=status, iterations=found.iterations + polished.iterations)


def solve(
    t: Transcription,
    u: Array,
    setting: Setting,
    *,
    solver: Solver,
    border: Array | None = None,
    parameter: float = 0.0,
    accuracy: float = 0.0,
    rough: float = 0.0,
    nearby: float = 0.0,
    bend: float | None = None,
) -> Solution:
    """Solve with the named solver alone.

    border, parameter, accuracy, rough, nearby: as in `newton`; IPOPT always goes for all digits; bend: the extremum of
    lambda is sought, and this is d2 lambda/d a2 along the border row, as of a `Turn`.
    """
    if bend is None:
        if solver == "ipopt":
            return ipopt(t, u, setting, border=border, parameter=parameter)
        return newton(t, u, setting, border=border, parameter=parameter, accuracy=accuracy, rough=rough, nearby=nearby)
    if solver == "ipopt":
        # the extremum of lambda, by IPOPT
        if t.intervals > OPTIMAL_INTERVALS:
            return Solution(u, parameter, Status.NOT_CONVERGED, 0, np.inf, None, "ipopt", bend)
        sense = -float(np.sign(bend))
        moved = setting.moved(parameter)
        best = maximise_parameter(t, u, replace(moved, dp=sense * moved.dp))
        lam, lin = parameter + sense * best.parameter, None
        if best.status.ok:
            lin = t.linearise(best.u, setting.moved(lam))
        residual = np.inf if lin is None else lin.residual_norm()
        return Solution(best.u, lam, best.status, best.iterations, residual, lin, "ipopt", bend)
    turn = Turn(np.array([bend]))
    found = newton(
        t, u, setting, border=border, parameter=parameter, accuracy=accuracy, turn=turn, max_iterations=MOST_TURNS
    )
    return replace(found, bend=float(turn.bend[0]))
