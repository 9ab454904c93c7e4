"""Any linear controller, by its transfer function or as an object of python-control or scipy.signal.

    C(s) = numerator/denominator = C (s - A)^-1 B + D
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import InputError
from .linear_controller import floats, state_space
from .part import Part


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
    num, den = (
        np.trim_zeros(np.atleast_1d(floats(f"transfer function: {name}", value)), "f")
        for name, value in (("numerator", numerator), ("denominator", denominator))
    )
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
    >>> from scipy.signal import TransferFunction
    >>> from casahunt.servo.parts import from_object
    >>> from_object(TransferFunction([2.0, 6.28], [1.0, 0.0]))
    <Part: linear controller>
    """
    homes = {base.__module__.partition(".")[0] for base in type(controller).__mro__}
    of_control, matrices = "control" in homes, all(hasattr(controller, name) for name in "ABCD")
    if not (of_control or "scipy" in homes) or not (matrices or hasattr(controller, "num")):
        neither = "is no TransferFunction or StateSpace of python-control or scipy.signal; take its to_tf(), or give"
        verbs = "its numbers to transfer_function(num, den) or state_space(A, B, C, D)"
        raise InputError(f"controller: {type(controller).__name__} {neither} {verbs}")
    if controller.dt not in (None, 0):
        raise InputError(
            "controller: is sampled; a continuous one is needed here: take that from which it was made, and state the "
            "sampling apart, as a drive"
        )
    ways = ("ninputs", "noutputs") if of_control else ("inputs", "outputs")
    if any(getattr(controller, way) != 1 for way in ways):
        raise InputError(
            "controller: has several inputs or outputs; one of each is needed here, error and torque: take that "
            "channel, such as controller[0, 0]"
        )
    if matrices:
        return state_space(controller.A, controller.B, controller.C, controller.D)
    num, den = controller.num, controller.den
    return transfer_function(num[0][0], den[0][0]) if of_control else transfer_function(num, den)
