"""Any linear controller, by its state space or its transfer function.

    c' = A c + B e,   m = -K cm (C c + D e),     C(s) = C (s - A)^-1 B + D = numerator/denominator

An integral action is a pole at zero of its own.  e' is not used: a controller with more zeros than poles has none.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiled import kept
from ...errors import InputError
from .part import Function, Law, Part, PartMode

Rows = tuple[tuple[float, ...], ...]
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
    a, b = np.atleast_2d(np.asarray(A, float)), np.asarray(B, float).reshape(-1)
    c, d = np.asarray(C, float).reshape(-1), np.asarray(D, float).reshape(-1)
    n = b.size
    if a.size != n * n or c.size != n or d.size != 1:
        raise InputError(f"state space: A {a.shape}, B, C and D must be (n, n), (n, 1), (1, n) and (1, 1)")
    if n > MOST_STATES:
        raise InputError(f"state space: {n} states; a controller has at most {MOST_STATES}")
    if not all(np.isfinite(matrix).all() for matrix in (a, b, c, d)):
        raise InputError("state space: every entry of A, B, C and D must be a finite number")
    rows = tuple(tuple(map(float, row)) for row in a.reshape(n, n))
    return _state_space(rows, tuple(map(float, b)), tuple(map(float, c)), float(d[0]))


def transfer_function(numerator: Any, denominator: Any) -> Part:
    """The controller numerator(s)/denominator(s), coefficients from the highest power on: controllable canonical form.

    Parameters
    ----------
    numerator, denominator
        coefficients.

    Returns
    -------
    Part, as of `state_space`.

    Raises
    ------
    InputError : improper, or no polynomial.

    Examples
    --------
    A PID with a filter of a millisecond on its derivative; without the filter the period is 10.28 s.

    >>> from casahunt.orbits import find_cycle
    >>> from casahunt.servo.parts import INERTIA, SWITCH, Loop, transfer_function
    >>> kp, ki, kd, Tf = 2.0, 6.283185, 0.159155, 1e-3
    >>> controller = transfer_function([kd + kp * Tf, kp + ki * Tf, ki], [Tf, 1.0, 0.0])
    >>> loop = Loop((INERTIA, SWITCH, controller), {"gain": 0.04})
    >>> start = loop.state(x1=-0.05)
    >>> round(find_cycle(loop.system, loop.mode_at(**start), start=start, follow="gain").period, 1)
    10.3
    """
    num, den = np.trim_zeros(np.asarray(numerator, float), "f"), np.trim_zeros(np.asarray(denominator, float), "f")
    if not den.size or not num.size:
        raise InputError("transfer function: numerator and denominator must each have a coefficient that is not zero")
    n = den.size - 1
    if num.size > den.size:
        raise InputError(
            f"transfer function: improper, {num.size - 1} zeros and {n} poles: a derivative needs a filter, such as "
            "s/(0.01 s + 1)"
        )
    num = np.concatenate([np.zeros(den.size - num.size), num]) / den[0]
    den = den / den[0]
    A = np.vstack([-den[1:], np.eye(n)[: n - 1]]) if n else np.zeros((0, 0))
    return state_space(A, np.eye(n)[:, :1] if n else [], num[1:] - num[0] * den[1:], [num[0]])


def from_object(controller: Any) -> Part:
    """The controller of a TransferFunction or StateSpace of python-control or scipy.signal.

    Returns
    -------
    Part, as of `state_space`.

    Raises
    ------
    InputError : it is neither, or has more than one input or output, or is sampled.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from casahunt.servo.parts import from_object
    >>> from_object(SimpleNamespace(num=[2.0, 6.28], den=[1.0, 0.0]))  # as scipy.signal.TransferFunction has them
    <Part: linear controller>
    """
    if getattr(controller, "dt", None) not in (None, 0):
        raise InputError("controller: is sampled; a continuous one is needed here")
    ways = [getattr(controller, name, 1) for name in ("ninputs", "noutputs", "inputs", "outputs")]
    if any(isinstance(number, int) and number != 1 for number in ways):
        raise InputError("controller: has several inputs or outputs; one of each is needed here, error and torque")
    if all(hasattr(controller, name) for name in "ABCD"):
        return state_space(controller.A, controller.B, controller.C, controller.D)
    if hasattr(controller, "num") and hasattr(controller, "den"):
        num, den = (getattr(controller, name) for name in ("num", "den"))
        if np.ndim(num[0]):  # python-control: a list of lists, one for each output and input
            num, den = num[0][0], den[0][0]
        return transfer_function(num, den)
    raise InputError(f"controller: {type(controller).__name__} has neither num and den nor A, B, C and D")


def _again(*matrices: Any) -> Part:
    """The part in another process; what is kept cannot be sent by its name."""
    part: Part = _state_space(*matrices)
    return part


@kept(maxsize=64)
def _state_space(A: Rows, B: tuple[float, ...], C: tuple[float, ...], D: float) -> Part:
    names = tuple(f"c{i + 1}" for i in range(len(B)))

    def row(i: int) -> Function:
        return lambda x, s, p: sum(A[i][j] * getattr(x, names[j]) for j in range(len(B)) if A[i][j]) + B[i] * s.error

    def demand(x: Any, s: Any, p: Any) -> Any:
        out = sum(C[j] * getattr(x, names[j]) for j in range(len(B)) if C[j]) + D * s.error
        return -p.gain * p.motor_gain * out

    size = abs(D) + max(map(abs, C), default=0.0)
    return Part(
        "linear controller", names, {"motor_gain": 16.0, "gain": 0.04}, made_by=(_again, (A, B, C, D)),
        gives={"demand": demand, "kp": lambda x, s, p: p.gain * p.motor_gain * size},
        modes=(PartMode("", Law({name: row(i) for i, name in enumerate(names)})),),
    )  # fmt: skip
