"""A state, or any expression g(x; p) of a user's, as numbers: its value, its rate along a mode, its gradients.

    g(x; p),    g_x . f(x; p),    g_x,    g_p

Symbols: n states, m points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..checks import choice_of
from ..compiled import Caller, alone, caller, kept
from ..errors import InputError
from ..hybrid.system import Cycle, VectorMode
from ..hybrid.vector_form import Names, Scalar

Array = np.ndarray
Expression = Callable[[Any, Any], Any]
"""(x, p) -> scalar, of CasADi symbols."""

AT_ONCE = 136
"""Points at which an expression is evaluated by one call: those of eight intervals.  What is not asked costs less than
two more calls."""


def scalar_of(what: Any, names: Names) -> Scalar:
    """A state, or a function of the user's, as a scalar of the vectors.

    what: name of a state, or a function (x, p) of named states and parameters; names: what the entries of the vectors
    are called. Raises InputError: it is neither.
    """
    if isinstance(what, str):
        i = names.entries.index(choice_of("state", what, names.states))
        return Scalar(_Coordinate(names.states[i]), names)
    if not callable(what):
        raise InputError(f"{what!r}: must be the name of a state or a function (x, p)")
    return Scalar(what, names)


@dataclass(frozen=True)
class _Coordinate:
    """(x, p) -> one state."""

    name: str

    def __call__(self, x: Any, p: Any) -> Any:
        return getattr(x, self.name)


def is_mirrored(g: Expression, cycle: Cycle) -> bool:
    """Whether g is a state that is the same one computed piece later, or minus that: |g| shows nothing new then."""
    if not (isinstance(g, Scalar) and isinstance(g.function, _Coordinate)):
        return False
    i = cycle.states.index(g.function.name)
    others = np.delete(np.linalg.inv(cycle.closure)[i], i)
    return abs(cycle.closure[i, i]) == 1 and not others.any() and not np.any(cycle.shift)


@dataclass(frozen=True)
class Later:
    """g where the motion is k computed pieces later, as a function of where it is now."""

    g: Expression
    cycle: Cycle
    pieces: int

    def __call__(self, x: Any, p: Any) -> Any:
        inverse = np.linalg.inv(self.cycle.closure)
        for _ in range(self.pieces):
            x = ca.mtimes(ca.DM(inverse), x + ca.DM(self.cycle.shift or np.zeros(x.shape[0])))
        return self.g(x, p)


class Values:
    """g, its rate along the field of a mode, and its gradients, at numbers."""

    @alone
    def __init__(self, mode: VectorMode, g: Expression, n: int, parameters: int) -> None:
        x, p = ca.SX.sym("x", n), ca.SX.sym("p", parameters)
        try:
            value = ca.SX(g(x, p))
        except NotImplementedError:
            raise InputError("the expression must be a scalar: one made of the states by CasADi's functions") from None
        if value.shape != (1, 1):
            raise InputError(f"the expression must be a scalar, not one of shape {value.shape}")
        if value.is_constant() and not np.isfinite(float(value)):
            raise InputError("the expression is no number; of states, functions are CasADi's: casadi.sin for math.sin")
        gradient = ca.densify(ca.gradient(value, x))
        rate = ca.dot(gradient, mode.field(x, p, mode.sign))
        function = ca.Function("g", [x, p], [ca.densify(value), ca.densify(rate), gradient])
        by_parameters = ca.Function("g_p", [x, p], [ca.densify(ca.gradient(value, p))])
        self._by_parameters = caller(by_parameters, [n, parameters], [parameters])
        self._at_one = caller(function, [n, parameters], [1, 1, n])
        self._at_many = caller(
            function.map("many", "serial", AT_ONCE, [1], []),
            [(AT_ONCE, n), parameters], [AT_ONCE, AT_ONCE, (AT_ONCE, n)],
        )  # fmt: skip

    def __call__(self, points: Array, p: Array) -> tuple[Array, Array, Array]:
        """(g (m,), its rate (m,), g_x (m, n)) at the states (m, n)."""
        m = len(points)
        buffers = (self._at_one if m == 1 else self._at_many).buffers
        g, rate, g_x = np.empty(m), np.empty(m), np.empty(points.shape)
        for first in range(0, m, AT_ONCE):
            chunk = slice(first, first + AT_ONCE)
            count = len(points[chunk])
            buffers.inputs[0].reshape(-1, points.shape[1])[:count], buffers.inputs[1][:] = points[chunk], p
            buffers.trigger()
            for store, out in zip((g, rate, g_x), buffers.outputs, strict=True):
                store[chunk] = out.reshape(-1, *store.shape[1:])[:count]
        return g, rate, g_x

    def by_parameters(self, x: Array, p: Array) -> Array:
        """The gradient by the parameters.

        x, p: (n,) state and (np,) parameters. Returns (np,) g_p.
        """
        buffers = self._by_parameters.buffers
        buffers.inputs[0][:], buffers.inputs[1][:] = x, p
        buffers.trigger()
        return buffers.outputs[0].copy()


@kept(maxsize=64)
def kept_values(mode: VectorMode, g: Expression, n: int, parameters: int) -> Values:
    """`Values`, kept for reuse: for expressions that are as old as their problem."""
    return Values(mode, g, n, parameters)


@kept(maxsize=32)
def _sensitivity_map(mode: VectorMode, n: int, parameters: int) -> Caller:
    assert mode.flow is not None
    x, T = ca.SX.sym("x", n), ca.SX.sym("T")
    p, dp = ca.SX.sym("p", parameters), ca.SX.sym("dp", parameters)
    end = mode.flow(x, T, p)
    through = ca.densify(ca.horzcat(ca.jacobian(end, x), ca.jacobian(end, T), ca.jtimes(end, p, dp)))
    return caller(ca.Function("sensitivity", [x, T, p, dp], [through]), [n, 1, parameters, parameters], [(n + 2, n)])


def flow_sensitivity(mode: VectorMode, x: Array, time: float, p: Array, dp: Array) -> Array:
    """The derivative of a closed form by the state at its start, the time and lambda.

    x, time: (n,) state at its start; how much later; p, dp: parameters, and the direction in which lambda moves them.
    Returns (n, n + 2).
    """
    buffers = _sensitivity_map(mode, x.size, p.size).buffers
    for store, value in zip(buffers.inputs, (x, time, p, dp), strict=True):
        store[...] = value
    buffers.trigger()
    return buffers.outputs[0].T.copy()
