"""Whether the closed form of a mode is a motion, and that of its field where it has one too: looked at with numbers.

    y = flow(x, 0),    flow(y, 0) = y,    d flow(y, T)/dT = f(flow(y, T))    at T = 0 and at one T > 0

A closed form may put the state where the mode holds it (v = belt), hence y.  Where a number is not finite, or the mode
does not hold, nothing is said.

Symbols: n states.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiled import Caller, caller, kept
from ..errors import InputError
from ..hybrid import system as engine
from ..hybrid.language import System

Array = np.ndarray

POINTS = 4
"""Around the start of the motion at which a closed form is tried, besides the start itself."""
TRIED_AROUND = 0.1
"""How far around, relative to the states and to one; how much later, in times in which a state changes by its size."""
SAME_MOTION = 1e-6
"""Rates and states that agree to this, relative to their sizes, are the same."""


def check_closed_forms(system: System, x: Array, p: Array) -> None:
    """Refuse a closed form that contradicts itself, or the field of its mode.

    x, p: (n,) the state near which it is tried, (np,) parameters. Raises InputError: one does; names its mode.
    """
    rng = np.random.default_rng(0)
    around = TRIED_AROUND * np.maximum(np.abs(x), 1.0) * rng.standard_normal((POINTS, x.size))
    for mode in system.vector_form.modes.values():
        if mode.flow is not None:
            of_field = system.mode(mode.name).field is not None
            for point in np.vstack([x, x + around]):
                _check_at(mode, point, p, of_field)


def _check_at(mode: engine.VectorMode, x: Array, p: Array, of_field: bool) -> None:
    """One state."""
    y, *_ = _along(mode, x, 0.0, p)
    if not np.isfinite(y).all() or mode.admissible is not None and not _holds(mode, y, p):
        return
    again, rate, slope = _along(mode, y, 0.0, p)
    size = np.maximum(np.abs(y), 1.0)
    moved = float(np.max(np.abs(slope) / size)) if np.isfinite(slope).all() else 0.0
    if np.isfinite(again).all() and np.max(np.abs(again - y) / size) > SAME_MOTION:
        raise InputError(f"mode {mode.name!r}: its flow is not where it starts after no time")
    _compare(mode, 0.0, rate, slope, of_field)
    T = TRIED_AROUND / max(moved, TRIED_AROUND)
    z, rate, slope = _along(mode, y, T, p)
    if np.isfinite(z).all() and (mode.admissible is None or _holds(mode, z, p)):
        _compare(mode, T, rate, slope, of_field)


def _compare(mode: engine.VectorMode, T: float, rate: Array, slope: Array, of_field: bool) -> None:
    """The rate of the flow against the field at the same state."""
    size = max(float(np.max(np.abs(slope))), float(np.max(np.abs(rate))))
    if np.isfinite(size) and np.max(np.abs(rate - slope)) > SAME_MOTION * size:
        other = "its field" if of_field else "its own rate from there on"
        raise InputError(
            f"mode {mode.name!r}: its flow contradicts {other}: a time {T:.3g} from its start the one moves at "
            f"{_listed(rate)}, the other at {_listed(slope)}"
        )


def _listed(values: Array) -> str:
    return "(" + ", ".join(f"{v:.6g}" for v in values) + ")"


def _holds(mode: engine.VectorMode, x: Array, p: Array) -> bool:
    assert mode.admissible is not None
    return bool(np.all(np.asarray(mode.admissible(x, p, mode.sign)) >= -mode.slack))


def _along(mode: engine.VectorMode, x: Array, T: float, p: Array) -> tuple[Array, Array, Array]:
    """(flow(x, T), its derivative by T, the field there), (n,) each."""
    buffers = _compiled(mode, x.size, p.size).buffers
    for store, value in zip(buffers.inputs, (x, T, p), strict=True):
        store[...] = value
    buffers.trigger()
    end, rate, slope = (out.copy() for out in buffers.outputs)
    return end, rate, slope


@kept(maxsize=32)
def _compiled(mode: engine.VectorMode, n: int, parameters: int) -> Caller:
    assert mode.flow is not None
    x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
    end = mode.flow(x, T, p)
    field = ca.Function("field", [x, p], [mode.field(x, p, mode.sign)])
    outputs = [ca.densify(out) for out in (end, ca.jacobian(end, T), field(end, p))]
    return caller(ca.Function("along", [x, T, p], outputs), [n, 1, parameters], [n, n, n])
