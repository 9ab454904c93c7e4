"""A function of a point, at many points: its operations in turn, each for all of them.

    y = f(x, p):    instructions  w_k = op(w_i, w_j),  as CasADi has made them of an expression

CasADi carries out all instructions for one point, then for the next; numpy one instruction for all points.  What is the
same at several points, such as an expression of a member's parameters, is one number for them: arrays are broadcast.
Every operation goes element by element, so that what a point gives does not depend on the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

Array = np.ndarray


def _number(truth: Callable[..., Any]) -> Callable[..., Array]:
    """A comparison as CasADi means it: 1 or 0."""
    return lambda *values: truth(*values).astype(float)


OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda x: x, ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide, ca.OP_NEG: np.negative, ca.OP_EXP: np.exp, ca.OP_LOG: np.log, ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power, ca.OP_SQRT: np.sqrt, ca.OP_SQ: np.square, ca.OP_TWICE: lambda x: x + x,
    ca.OP_INV: lambda x: 1.0 / x, ca.OP_SIN: np.sin, ca.OP_COS: np.cos, ca.OP_TAN: np.tan, ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos, ca.OP_ATAN: np.arctan, ca.OP_SINH: np.sinh, ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh, ca.OP_ACOSH: np.arccosh, ca.OP_ATANH: np.arctanh, ca.OP_ATAN2: np.arctan2,
    ca.OP_FLOOR: np.floor, ca.OP_CEIL: np.ceil, ca.OP_FMOD: np.fmod, ca.OP_FABS: np.fabs, ca.OP_SIGN: np.sign,
    ca.OP_COPYSIGN: np.copysign, ca.OP_FMIN: np.fmin, ca.OP_FMAX: np.fmax, ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1, ca.OP_HYPOT: np.hypot, ca.OP_ERF: np.vectorize(math.erf, otypes=[float]),
    ca.OP_LT: _number(np.less), ca.OP_LE: _number(np.less_equal), ca.OP_EQ: _number(np.equal),
    ca.OP_NE: _number(np.not_equal), ca.OP_NOT: _number(np.logical_not), ca.OP_AND: _number(np.logical_and),
    ca.OP_OR: _number(np.logical_or), ca.OP_IF_ELSE_ZERO: lambda truth, x: np.where(truth != 0, x, 0.0),
}  # fmt: skip
"""What numpy calls CasADi's operations; the others (a call that is not inlined) are CasADi's own affair."""


class OverArrays:
    """A function of scalar expressions (SX), evaluated over arrays.

    Parameters
    ----------
    function
        its inputs are dense vectors; its outputs may be sparse.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._places = [function.sparsity_out(i).nnz() for i in range(function.n_out())]
        self._steps: list[tuple[int, Any, Any, Any]] = []
        self._width = function.sz_w()
        for k in range(function.n_instructions()):
            op, into = function.instruction_id(k), function.instruction_output(k)
            if op == ca.OP_CONST:
                self._steps.append((op, into[0], function.instruction_constant(k), None))
            elif op in (ca.OP_INPUT, ca.OP_OUTPUT):
                self._steps.append((op, tuple(into), tuple(function.instruction_input(k)), None))
            else:
                self._steps.append((op, into[0], tuple(function.instruction_input(k)), OPERATIONS.get(op)))
        self.by_numpy = all(
            step[3] is not None or step[0] in (ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT) for step in self._steps
        )

    def __call__(self, *inputs: Sequence[Array]) -> list[list[Any]]:
        """The nonzeros of every output, column after column, as arrays or numbers that can be broadcast.

        `inputs` are the entries of every input: arrays, or numbers, that can be broadcast.
        """
        if not self.by_numpy:
            # The same by CasADi
            shape = np.broadcast_shapes(*(np.shape(entry) for entries in inputs for entry in entries))
            columns = [np.array([np.broadcast_to(e, shape).ravel() for e in entries], float) for entries in inputs]
            found = self._function.map(max(math.prod(shape), 1)).call([ca.DM(column) for column in columns])
            values = [np.array(ca.densify(each).nonzeros()) for each in found]
            return [list(each.reshape(-1, places).T.reshape(places, *shape)) for each, places in
                    zip(values, self._places, strict=True)]  # fmt: skip
        w: list[Any] = [0.0] * self._width
        out: list[list[Any]] = [[0.0] * places for places in self._places]
        with np.errstate(all="ignore"):
            for op, into, of, apply in self._steps:
                if apply is not None:
                    w[into] = apply(*[w[i] for i in of])
                elif op == ca.OP_CONST:
                    w[into] = np.float64(of)
                elif op == ca.OP_INPUT:
                    w[into[0]] = inputs[of[0]][of[1]]
                else:
                    out[into[0]][into[1]] = w[of[0]]
        return out
