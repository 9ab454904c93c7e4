"""The states at which a loop of parts can stand still for ever: corners of polytopes, one or more for each mode.

    A x + b = 0     rates of what is felt, velocities       x = x0 + N y,   d = dim y
    G x <= h        no part leaves its mode                 at a corner d of these hold with equality

Bristles rest where rigid friction sticks, bent by z = F/sigma0.  A row of G is an event that is affine, or the square
of what is affine: inside of it two rows, outside either of two.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ..results import Result
from .parts.loop import Loop
from .parts.lugre import LUGRE
from .parts.part import Part, PartMode
from .parts.product import mode_name, wiring_of
from .parts.switch import SWITCH
from .parts.wiring import Numbers, Signals, Wiring

Array = np.ndarray
Parts = tuple[Part, ...]
Modes = tuple[PartMode, ...]
Row = tuple[Array, float]
"""(n,) and h, of g x <= h."""

FAR_OUT_AT = 1e6
"""Within it corners are sought; what grows with it has no limit."""
HELD_TO = 1e-9
"""Part of its size to which an equation, or a condition of order one, holds."""
VELOCITIES = "x2", "load_rate"
"""What is zero at rest."""


@dataclass(frozen=True, eq=False, repr=False)
class Rests(Result):
    """The states at which a loop can rest in one combination of modes, or a part of them.

    Attributes
    ----------
    mode : of the loop, as if its friction were rigid.
    names : the states, and "torque", that of the motor.
    corners : (k, n + 1) of the polytope [SI]; infinite where nothing limits it.
    directions : in which it extends.
    loop, modes : the loop, and the mode of each part.
    """

    _quantities = ("mode", "directions")
    _details = ("names", "corners")

    mode: str
    names: tuple[str, ...]
    corners: Array
    directions: int
    loop: Loop
    modes: Modes

    @cached_property
    def _jacobian(self) -> ca.Function:
        """The derivative of the field from v > 0 at a bristle bent by z."""
        parts, x = self.loop.present, _symbols(self.loop.present)
        modes = tuple(LUGRE.modes[0] if part is LUGRE else mode for part, mode in zip(parts, self.modes, strict=True))
        rates, at = wiring_of(parts, modes, None).field(x, Numbers(**self.loop.parameters)), ca.vertcat(*_values(x))
        J = ca.jacobian(ca.vertcat(*[rates[name] for name in vars(x)]), at)
        others = ca.vertcat(*[value for name, value in vars(x).items() if name != "x4"])
        return ca.Function("members", [x.x4], [ca.substitute(J, others, ca.DM.zeros(others.numel()))])

    def members(self, c: Array) -> Array:
        """(m, n, n) members of the generalised Jacobian at c (m,), see equilibria.py; of a loop with bristles."""
        limit = self.loop.value("static") / self.loop.value("stiffness")
        return np.array([np.array(self._jacobian(limit * (1 - each))) for each in c])


def rest_states(loop: Loop) -> tuple[tuple[Rests, ...], tuple[str, ...]]:
    """Where a loop can rest, and the combinations of modes of which that is not known, with the reason."""
    parts = tuple(SWITCH if part is LUGRE else part for part in loop.present)
    found, unknown = list[Rests](), list[str]()
    for modes in itertools.product(*[[m for m in part.modes if "stick" in m.name] or part.modes for part in parts]):
        try:
            polytopes, directions = _polytopes(loop, parts, modes)
        except _NotLinear as reason:
            unknown.append(f"{mode_name(modes)}: {reason}")
            continue
        names = (*loop.system.states, "torque")
        found += [Rests(mode_name(modes), names, corners, directions, loop, modes) for corners in polytopes]
    return tuple(found), tuple(unknown)


class _NotLinear(Exception):
    """What is no linear condition of the states at rest."""


def _polytopes(loop: Loop, parts: Parts, modes: Modes) -> tuple[list[Array], int]:
    """Corners (k, n + 1) of each, none where there is no rest, and directions.  Raises _NotLinear."""
    wiring, x, p = wiring_of(parts, modes, None), _symbols(parts), Numbers(**loop.parameters)
    at, still = ca.vertcat(*_values(x)), ca.vertcat(*[getattr(x, name) for name in VELOCITIES if hasattr(x, name)])
    nothing = ca.DM.zeros(still.numel())
    rates, signals = wiring.field(x, p), Signals(wiring, x, p)
    ends = [wiring.value(edge.function, mode.sign, x, p) for mode in modes for edge in mode.ends]
    felt = _felt(x, rates, ca.vertcat(signals.torque, signals.pull, *ends))
    equations = ca.vertcat(*[ca.substitute(ca.SX(rates[name]), still, nothing) for name in felt], still)
    A, b = _affine(equations, at, "its rates are")
    size = np.linalg.norm(A, axis=1)
    size[size == 0] = 1.0
    A, b = A / size[:, None], b / size
    x0 = np.linalg.lstsq(A, -b, rcond=None)[0]
    if np.abs(A @ x0 + b).max() > HELD_TO * np.abs(b).max():
        return [], 0  # something always changes
    _, sizes, V = np.linalg.svd(A)
    N = V[int((sizes > HELD_TO * sizes[0]).sum()) :].T
    told = ca.Function("told", [at], [ca.vertcat(signals.torque, signals.pull)])
    found = []
    for rows in itertools.product(*_conditions(wiring, modes, (x, p), at)):
        every = list(itertools.chain(*rows))
        G, h = np.array([g for g, _ in every]).reshape(-1, x0.size), np.array([level for _, level in every])
        corners = _corners(G @ N, h - G @ x0)
        found.append([_state(loop, parts, x0 + N @ y, N @ outward, told) for y, outward in corners])
    return [np.array(corners) for corners in found if corners], N.shape[1]


def _felt(x: SimpleNamespace, rates: Mapping[str, Any], told: ca.SX) -> list[str]:
    """The states that something depends on, by way of others or not: an integral of which nothing is taken is none."""
    felt = ca.SX(told)
    for _ in rates:
        felt = ca.vertcat(told, *[rates[name] for name, state in vars(x).items() if ca.depends_on(felt, state)])
    return [name for name, state in vars(x).items() if ca.depends_on(felt, state)]


def _state(loop: Loop, parts: Parts, corner: Array, outward: Array, told: ca.Function) -> Array:
    """(n + 1,) every state of the loop at a corner (m,), and the torque; outward: its derivative by `FAR_OUT_AT`."""
    torque, pull = np.array(told(corner))[:, 0]
    ends = np.where(np.abs(outward) > HELD_TO, np.copysign(np.inf, outward), corner)
    state = dict(zip((name for part in parts for name in part.states), ends, strict=True))
    if LUGRE in loop.present:
        state["x4"] = pull / loop.value("stiffness")
    return np.array([*(state[name] for name in loop.system.states), torque]) + 0.0  # no -0


def _corners(G: Array, h: Array) -> Iterator[tuple[Array, Array]]:
    """The corners y (d,) of G y <= h within `FAR_OUT_AT`, each with its derivative by that."""
    d, sizes = G.shape[1], np.linalg.norm(G, axis=1)
    fixed = sizes <= HELD_TO * np.maximum(np.abs(h), sizes.max(initial=0.0))
    if np.any(h[fixed] < -HELD_TO):
        return
    outward = np.append(np.zeros((~fixed).sum()), np.ones(2 * d))
    G, h = np.vstack([G[~fixed], np.eye(d), -np.eye(d)]), np.append(h[~fixed], np.full(2 * d, FAR_OUT_AT))
    for chosen in itertools.combinations(range(h.size), d):
        rows = list(chosen)
        if d and np.linalg.cond(G[rows]) > 1 / np.finfo(float).eps:
            continue
        y, moves = np.linalg.solve(G[rows], np.column_stack([h[rows], outward[rows]])).T
        if np.all(G @ y - h <= HELD_TO * (np.abs(h) + np.abs(G) @ np.abs(y))):
            yield y, moves


def _conditions(
    wiring: Wiring, modes: Modes, symbols: tuple[SimpleNamespace, Numbers], at: ca.SX
) -> Iterator[list[list[Row]]]:
    """Of each event that may end the rest, the alternatives, each some rows.  Raises _NotLinear."""
    for mode in modes:
        for edge in mode.ends:
            e = ca.SX(wiring.value(edge.function, mode.sign, *symbols)) * edge.direction
            if ca.jacobian(ca.jacobian(e, at), at).is_zero():
                g, h = _affine(e, at, f"its {edge.name} is")
                yield [[(g[0], -h[0])]]
                continue
            curved, linear = _affine(ca.gradient(e, at), at, f"its {edge.name} is")
            values, V = np.linalg.eigh(curved)
            k = int(np.argmax(np.abs(values)))
            if np.any(linear) or np.abs(np.delete(values, k)).max(initial=0.0) > HELD_TO * abs(values[k]):
                raise _NotLinear(f"its {edge.name} is not linear")
            level = float(ca.substitute(e, at, ca.DM.zeros(at.numel())))
            v, r = V[:, k], math.sqrt(max(-2 * level / values[k], 0.0))
            yield [[(v, r), (-v, r)]] if values[k] > 0 else [[(-v, -r)], [(v, -r)]]


def _affine(f: ca.SX, at: ca.SX, what: str) -> tuple[Array, Array]:
    """A (m, n) and b (m,) of f = A x + b.  Raises _NotLinear."""
    A = ca.jacobian(f, at)
    if ca.symvar(A):
        raise _NotLinear(f"{what} not linear")
    return np.array(ca.DM(A)), np.array(ca.DM(ca.substitute(f, at, ca.DM.zeros(at.numel()))))[:, 0]


def _symbols(parts: Parts) -> SimpleNamespace:
    """Each state as a symbol."""
    return SimpleNamespace(**{name: ca.SX.sym(name) for part in parts for name in part.states})


def _values(x: SimpleNamespace) -> list[ca.SX]:
    return list(vars(x).values())
