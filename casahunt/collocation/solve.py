"""Which solver solves: Newton (newton.py) or IPOPT (ipopt.py), alone or one after the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import Status
from .ipopt import ipopt
from .newton import LARGEST_MOVE, Solution, Solver, newton, verdict
from .transcription import Setting, Transcription

Array = np.ndarray

POLISHING, POLISHED = 4, 1e-2
"""Newton steps after IPOPT, and how far they may lead away from its point."""


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
    status = verdict(t, u, polished.u, polished.residual, True, LARGEST_MOVE)
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
) -> Solution:
    """Solve with the named solver alone.

    border, parameter, accuracy, rough, nearby: as in `newton`; IPOPT always goes for all digits.
    """
    if solver == "ipopt":
        return ipopt(t, u, setting, border=border, parameter=parameter)
    return newton(
        t, u, setting, border=border, parameter=parameter, accuracy=accuracy, rough=rough, nearby=nearby
    )
