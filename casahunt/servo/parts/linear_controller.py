"""Any linear controller, by its state space.

    c' = A c + B e,   m = -K cm (C c + D e)

An integral action is a pole at zero of its own.  e' is not used: a controller with more zeros than poles has none.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...compiled import kept
from ...errors import InputError
from .part import ABOVE_ZERO, Function, Law, Part, PartMode

Array = np.ndarray
Rows = tuple[tuple[float, ...], ...]
NO_RATE, SLOW_RESPONSE = 1e-9, 1e-3
"""Part of the largest rate below which one is zero; part of the smallest other one at which a response is asked for."""
MOST_STATES = 8
"""A controller with more states than that is a model of something else."""


def state_space(A: Any, B: Any, C: Any, D: Any) -> Part:
    """The controller of four matrices.

    Parameters
    ----------
    A, B, C, D
        (n, n), (n, 1), (1, n), (1, 1), of c' = A c + B e and the output C c + D e.

    Returns
    -------
    Part with the states c1, c2, ... and the parameters gain and motor_gain.

    Raises
    ------
    InputError : shapes that do not fit, or too many states.

    Examples
    --------
    >>> from casahunt.servo.parts import state_space
    >>> state_space([[0.0]], [[1.0]], [[6.28]], [[2.0]]).states  # PI: ki = 6.28, kp = 2
    ('c1',)
    """
    a, b, c, d = (floats(f"state space: {name}", value) for name, value in zip("ABCD", (A, B, C, D), strict=True))
    a, b, c, d = np.atleast_2d(a), b.reshape(-1), c.reshape(-1), d.reshape(-1)
    n = b.size
    if a.size != n * n or c.size != n or d.size != 1:
        raise InputError(f"state space: A {a.shape}, B, C and D must be (n, n), (n, 1), (1, n) and (1, 1)")
    if n > MOST_STATES:
        raise InputError(f"state space: {n} states; a controller has at most {MOST_STATES}")
    rows = tuple(tuple(map(float, row)) for row in a.reshape(n, n))
    return _state_space(rows, tuple(map(float, b)), tuple(map(float, c)), float(d[0]))


def floats(name: str, value: Any) -> Array:
    """An array.  Raises InputError: an entry is no finite number."""
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if not np.isfinite(array).all():
        raise InputError(f"{name}: every entry must be a finite number")
    return array


def _again(*matrices: Any) -> Part:
    """The part in another process; what is kept cannot be sent by its name."""
    part: Part = _state_space(*matrices)
    return part


def _proportional(A: Array, B: Array, C: Array, D: float) -> float:
    """Its proportional action: |Re C(i omega)| far below its rates, where an integral action is imaginary."""
    rates = np.abs(np.linalg.eigvals(A))
    slow = float(rates.min(where=rates > NO_RATE * rates.max(initial=0.0), initial=np.inf))
    omega = SLOW_RESPONSE * (slow if math.isfinite(slow) else 1.0)
    found = D + C @ np.linalg.solve(1j * omega * np.eye(B.size) - A, B)
    return abs(float(found.real)) or abs(D) + float(np.abs(C).max(initial=0.0))


@kept(maxsize=64)
def _state_space(A: Rows, B: tuple[float, ...], C: tuple[float, ...], D: float) -> Part:
    names = tuple(f"c{i + 1}" for i in range(len(B)))

    def row(i: int) -> Function:
        return lambda x, s, p: sum(A[i][j] * getattr(x, names[j]) for j in range(len(B)) if A[i][j]) + B[i] * s.error

    def demand(x: Any, s: Any, p: Any) -> Any:
        out = sum(C[j] * getattr(x, names[j]) for j in range(len(B)) if C[j]) + D * s.error
        return -p.gain * p.motor_gain * out

    size = _proportional(np.array(A).reshape(len(B), len(B)), np.array(B), np.array(C), D)
    return Part(
        "linear controller", names, {"motor_gain": 16.0, "gain": 0.04}, made_by=(_again, (A, B, C, D)),
        ranges={"gain": ABOVE_ZERO},
        gives={"demand": demand, "kp": lambda x, s, p: p.gain * p.motor_gain * size},
        modes=(PartMode("", Law({name: row(i) for i, name in enumerate(names)})),),
    )  # fmt: skip
