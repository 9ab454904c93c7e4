"""Whether a field, a closed form or an event of a user's jumps where its mode goes on: looked at when a system is made.

    sign, <, <=, floor, ceil, fmod, remainder, copysign, the cut of atan2:    a step s(x), constant between its jumps

What is jumped over changes how neighbouring motions part, and no mesh shows it: a jump is stated as an event between
two modes, with what it does to neighbours there.  A step makes no jump of the whole where the parts meet (|x|, a
saturation by if_else), so that the expression is written as f(x, s) with the steps for themselves, and on lines through
the states on which steps change, at the places where they do, both sides are compared:

    |f(x, s_behind) - f(x, s_before)| <= ONE_PART (|f| + |f|) + (STEP_PLACE |d(f - f)/dx| + ENDS_ROUNDING |df/dx|) |x|

Where something is divided by, |x|, fmin and fmax are steps, too: x/|x| jumps, x |x|/(1 + |x|) does not.
The second term is what the place is not known to, the third rounding of the states, as in an angle of many turns.

Without a step a jump is where something is divided by that vanishes, as in tanh(1/x), at a pole of tan, a root or a
logarithm of zero: where that changes its sign on a line, or turns, f has limits from both sides, and not one.
Parameters are tried at their values and next to them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..compiled import caller
from ..errors import InputError
from .vector_form import Names

Array = np.ndarray

LINES = 256
"""Through the states, a fourth of them in each of the ways of `_ends`, those of a size near one first."""
LOWEST_POWER, HIGHEST_POWER = -9.0, 9.0
"""Powers of ten between which the sizes of the states on them lie."""
LINE_HALVED = 60
"""Leave rounding of a line."""
ONE_PART, STEP_PLACE, ENDS_ROUNDING, NO_JUMP = 1e-9, 1e-12, 1e-13, 1e-30
"""Parts that meet to this part of their sizes are one; the place of a step, as part of its line; rounding, as part of
the sizes at the ends of the line; nothing at all."""
OFF_ZERO, LARGEST_LINE = np.geomspace(1e-13, 1e-11, 16), 1e4
"""How far beside a zero limits are looked at, as parts of a line, and how long lines may be for that: at so many places
that what is zero but for rounding is not seen to have two limits."""
ONE_LIMIT = 1e-2
"""Values beside a zero have a limit where they differ by less than this part of the jump."""
TRIED_NEXT_TO = 0.1
"""How far from their values parameters are tried, relative to these and to one."""
LONGEST_TEXT = 60
"""A condition that takes more letters is not written out."""

_STEPS = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL,
          ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_COPYSIGN, ca.OP_ATAN2}  # fmt: skip
_KINKS, _DIVIDES = {ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX}, {ca.OP_DIV, ca.OP_INV, ca.OP_POW, ca.OP_CONSTPOW}
_SINGULAR = _DIVIDES | {ca.OP_TAN, ca.OP_LOG, ca.OP_ATAN2}


class Looked(NamedTuple):
    """An expression that is looked at: what it is called, its value, and whether only a jump across zero counts."""

    what: str
    value: ca.SX
    event: bool


class _Steps(NamedTuple):
    """Expressions with the steps in them for themselves.

    Attributes
    ----------
    values : (m,) of the symbols, and of the steps as symbols.
    symbols, steps : these, and what they are; texts : where each of them steps.
    zeros : what is singular where it vanishes.
    """

    values: ca.SX
    symbols: ca.SX
    steps: ca.SX
    texts: list[tuple[int, list[ca.SX]]]
    zeros: ca.SX


def _split(operation: int, u: list[ca.SX], s: ca.SX) -> ca.SX:
    """An operation of these operands with its step for itself."""
    if operation == ca.OP_COPYSIGN:
        return ca.fabs(u[0]) * s
    if operation in _KINKS:
        return u[0] * s if operation == ca.OP_FABS else u[0] * s + u[1] * (1 - s)
    if operation in (ca.OP_FMOD, ca.OP_REMAINDER):
        return u[0] - u[1] * s
    if operation == ca.OP_ATAN2:  # s = +-1 beside the cut, seen from the other side of the origin, and 0 elsewhere
        beside = 1 - 2 * ca.fabs(s)
        return s * ca.pi + ca.atan2(beside * u[0], beside * u[1])
    return s


def _step(operation: int, u: list[ca.SX]) -> ca.SX:
    """What steps in an operation of these operands."""
    if operation == ca.OP_COPYSIGN:
        return ca.copysign(1, u[1])
    if operation in (ca.OP_FABS, ca.OP_SIGN):  # by the whole jump, without what it is at zero alone
        return 2 * (u[0] >= 0) - 1
    if operation in _KINKS:
        return u[0] > u[1] if operation == ca.OP_FMAX else u[0] < u[1]
    if operation in (ca.OP_FMOD, ca.OP_REMAINDER):
        turns = u[0] / u[1]
        return ca.sign(turns) * ca.floor(ca.fabs(turns)) if operation == ca.OP_FMOD else ca.floor(turns + 0.5)
    if operation == ca.OP_ATAN2:
        return (u[1] < 0) * (2 * (u[0] >= 0) - 1)
    return (ca.SX.unary if len(u) == 1 else ca.SX.binary)(operation, *u)


def _zero(operation: int, u: list[ca.SX]) -> ca.SX:
    """What an operation of these operands is singular at the zeros of."""
    if operation in (ca.OP_POW, ca.OP_CONSTPOW) and u[1].is_constant() and float(u[1]) >= 0:
        return ca.SX(1)
    return ca.cos(u[0]) if operation == ca.OP_TAN else u[operation == ca.OP_DIV]


def _steps_of(values: ca.SX, given: tuple[ca.SX, ...], moving: int) -> _Steps | None:
    """The steps in (m,) expressions of the symbols `given`, of which the first `moving` change; None for none."""
    graph = ca.Function("graph", list(given), [ca.densify(values)])
    operations = [graph.instruction_id(k) for k in range(graph.n_instructions())]
    stepping = _STEPS | _KINKS if _DIVIDES.intersection(operations) else _STEPS
    if not (stepping | _SINGULAR).intersection(operations):
        return None
    natural: list[Any] = [None] * graph.sz_w()
    split, moves = list(natural), [False] * graph.sz_w()
    out, found, zeros = ca.SX(values.numel(), 1), [], []
    for k, operation in enumerate(operations):
        of, into = graph.instruction_input(k), graph.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            out[into[1]] = split[of[0]]
        elif operation == ca.OP_INPUT:
            natural[into[0]] = split[into[0]] = given[of[0]][of[1]]
            moves[into[0]] = of[0] < moving
        elif operation == ca.OP_CONST:
            natural[into[0]] = split[into[0]] = ca.SX(graph.instruction_constant(k))
            moves[into[0]] = False
        else:
            apply = ca.SX.unary if len(of) == 1 else ca.SX.binary
            u, v, move = [natural[i] for i in of], [split[i] for i in of], [moves[i] for i in of]
            natural[into[0]], split[into[0]] = apply(operation, *u), apply(operation, *v)
            moves[into[0]] = any(move)
            vanishes = move[operation == ca.OP_DIV]  # along a line: what does not has no two limits on it
            if operation in _SINGULAR and vanishes and not _zero(operation, u).is_constant():
                zeros.append(_zero(operation, u))
            if operation in stepping and moves[into[0]]:
                found.append((ca.SX.sym("s"), _step(operation, u), (operation, u)))
                split[into[0]] = _split(operation, v, found[-1][0])
    symbols, steps, texts = zip(*found, strict=True) if found else ((), (), ())
    return _Steps(out, ca.vertcat(*symbols), ca.vertcat(*steps), list(texts), ca.vertcat(*zeros))


def _ends(n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """(n, LINES) both ends of lines: of any signs; of any signs, one state moving; positive; positive but for one."""
    powers = sorted(rng.uniform(LOWEST_POWER, HIGHEST_POWER, LINES), key=abs)
    size = 10 ** (np.array(powers) + rng.normal(0, 0.5, (n, LINES)))
    a, b = (size * rng.uniform(0.0, 3.0, (n, LINES)) for _ in range(2))
    way, line = np.arange(LINES) % 4, np.arange(LINES)
    one = line // 4 % n
    signs = rng.choice([-1.0, 1.0], (2, n, LINES))
    signs[:, :, way > 1] = 1.0
    signs[1, one[way == 3], line[way == 3]] = -1.0
    a, b = signs[0] * a, signs[1] * b
    alone = np.flatnonzero(way == 1)
    moved = b[one[alone], alone]
    b[:, alone] = a[:, alone]
    b[one[alone], alone] = moved
    return a, b


def _changes(
    natural: ca.Function, a: Array, b: Array, p: Array, sign: float
) -> tuple[Array, tuple[Array, Array], tuple[Array, Array]]:
    """Where steps change on lines from a to b (n, LINES), the first change of a bisection of each.

    natural: function (z, p, sign) -> the steps. Returns (n, LINES) places just before it; the steps (s, LINES) there
    and just behind, and at both ends.
    """
    shapes = [(LINES, len(a)), (LINES, len(p)), 1], [(LINES, natural.numel_out(0))]
    buffers = caller(natural.map("steps", "serial", LINES, [2], []), *shapes).buffers
    buffers.inputs[1][:], buffers.inputs[2][:] = p.T, sign

    def stepped(place: Array) -> Array:
        buffers.inputs[0][:] = (a + place * (b - a)).T
        buffers.trigger()
        return buffers.outputs[0].T.copy()

    low, high = np.zeros(LINES), np.ones(LINES)
    before, last = stepped(low), stepped(high)
    behind = last
    for _ in range(LINE_HALVED):
        middle = (low + high) / 2
        there = stepped(middle)
        same = np.all(there == before, axis=0)
        low, high, behind = np.where(same, middle, low), np.where(same, high, middle), np.where(same, behind, there)
    return a + low * (b - a), (before, behind), (before, last)


class _Lines(NamedTuple):
    """Where expressions are looked at: on lines from a to b, both (n, LINES).

    Attributes
    ----------
    looked, names : what is looked at, and what the entries of x and p are called.
    given : the symbols (x, T, p, sign).
    a, b : the ends, of (x, T); at, p, sign : the parameters tried (np, LINES), given, and the sign of the mode.
    """

    looked: list[Looked]
    names: Names
    given: tuple[ca.SX, ...]
    a: Array
    b: Array
    at: Array
    p: Array
    sign: float

    def refuse(self, jumps: Array, f: Array, g: Array, which: Callable[[int], tuple[int, list[ca.SX]]]) -> None:
        """Raise InputError where one of the expressions `jumps` (m, LINES) from f to g; `which`: where, by the line."""
        jumps = jumps & (np.array([not one.event for one in self.looked])[:, None] | (np.sign(f) * np.sign(g) <= 0))
        if jumps.any():
            i = int(np.flatnonzero(jumps.any(axis=1))[0])
            k = int(min(np.flatnonzero(jumps[i]), key=lambda line: np.any(self.at[:, line] != self.p)))
            where = _text(which(k), self.given, self.names)
            raise InputError(_refusal(self.looked[i], where, float(g[i, k] - f[i, k])))


def check_jumps(looked: list[Looked], given: tuple[ca.SX, ...], names: Names, p: Array, sign: float) -> None:
    """Refuse what jumps.

    looked: expressions of a mode; given: the symbols (x, T, p, sign) in them; p, sign: (np,) parameters, sign of the
    mode. Raises InputError: one of them jumps; says which, where, and how that is stated.
    """
    parts = _steps_of(ca.vertcat(*[one.value for one in looked]), given, 2)
    if parts is None:
        return
    rng = np.random.default_rng(0)
    a, b = _ends(given[0].numel() + 1, rng)
    a[-1], b[-1] = np.abs(a[-1]), np.abs(b[-1])  # the time in a mode
    # (np, LINES) parameters: their values, and every second time others next to them
    off = TRIED_NEXT_TO * rng.standard_normal((p.size, LINES)) * np.maximum(np.abs(p), 0.0)[:, None]
    off[p == 0] = TRIED_NEXT_TO * rng.uniform(0, 1, (int(np.sum(p == 0)), LINES))
    lines = _Lines(looked, names, given, a, b, p[:, None] + off * (np.arange(LINES) // 4 % 2), p, sign)
    if parts.texts:
        _check_steps(lines, parts)
    if parts.zeros.numel():
        _check_zeros(lines, parts.zeros)


def _check_steps(lines: _Lines, parts: _Steps) -> None:
    """Refuse what jumps where a step does."""
    z, others, a, b = ca.vertcat(*lines.given[:2]), list(lines.given[2:]), lines.a, lines.b
    at, sign = lines.at, lines.sign
    natural = ca.Function("natural", [z, *others], [ca.densify(parts.steps)])
    place, (before, behind), ends = _changes(natural, a, b, at, sign)
    value = ca.Function("value", [z, *others, parts.symbols], [ca.densify(parts.values)])
    s = ca.SX.sym("s", parts.symbols.numel())
    slopes = ca.jacobian(value(z, *others, s) - parts.values, z)
    # What is beside a step is known to the rounding of the states, and where they meet to that of the place.
    weighed = ca.horzcat(STEP_PLACE * slopes, ENDS_ROUNDING * ca.jacobian(parts.values, z))
    slope = ca.Function("slope", [z, *others, parts.symbols, s], ca.horzsplit(ca.densify(weighed)))
    f, g, first, last = (
        np.array(value(where, at, sign, steps))
        for where, steps in ((place, before), (place, behind), (a, ends[0]), (b, ends[1]))
    )
    with np.errstate(all="ignore"):
        by_state = zip(slope(place, at, sign, before, behind), 2 * [*np.abs(a)], 2 * [*np.abs(b)], strict=True)
        unknown = sum(np.abs(np.array(rate)) * np.maximum(*sizes) for rate, *sizes in by_state)
        least = unknown + ENDS_ROUNDING * (np.abs(first) + np.abs(last)) + NO_JUMP
        jumps = np.isfinite(least) & (np.abs(g - f) > ONE_PART * (np.abs(f) + np.abs(g)) + least)
    jumps &= np.any(before != behind, axis=0)
    lines.refuse(jumps, f, g, lambda k: parts.texts[int(np.flatnonzero(before[:, k] != behind[:, k])[0])])


def _check_zeros(lines: _Lines, zeros: ca.SX) -> None:
    """Refuse what has two limits where one of `zeros` vanishes."""
    (*x, p, sign), a, b, at = lines.given, lines.a, lines.b, lines.at
    z, way = ca.vertcat(*x), ca.SX.sym("way", len(a))
    turns = ca.sign(ca.vertcat(zeros, ca.jtimes(zeros, z, way)))
    natural = ca.Function("natural", [z, ca.vertcat(p, way), sign], [ca.densify(turns)])
    place, (before, behind), _ = _changes(natural, a, b, np.vstack([at, b - a]), lines.sign)
    value = ca.Function("value", [z, p, sign], [ca.densify(ca.vertcat(*[one.value for one in lines.looked]))])
    beside = np.stack([np.array(value(place + s * (b - a), at, lines.sign)) for s in (*-OFF_ZERO, *OFF_ZERO)])
    left, right = beside[: OFF_ZERO.size], beside[OFF_ZERO.size :]
    f, g = left[0], right[0]
    with np.errstate(all="ignore"):
        strays = np.maximum(np.abs(np.diff(left, axis=0)).max(axis=0), np.abs(np.diff(right, axis=0)).max(axis=0))
        jumps = (strays < ONE_LIMIT * np.abs(g - f)) & (np.abs(g - f) > ONE_PART * (np.abs(f) + np.abs(g)) + NO_JUMP)
    jumps &= np.any(before != behind, axis=0) & (np.maximum(np.abs(a), np.abs(b)).max(axis=0) < LARGEST_LINE)
    sizes = np.abs(np.array(ca.Function("sizes", [z, p, sign], [ca.densify(zeros)])(place, at, lines.sign)))
    sizes[~np.any((before != behind).reshape(2, -1, LINES), axis=0)] = np.inf
    lines.refuse(jumps, f, g, lambda k: (ca.OP_SIGN, [zeros[int(np.argmin(sizes[:, k]))]]))


def _refusal(one: Looked, where: str, jump: float) -> str:
    """What is told of a jump."""
    if one.event:
        return (
            f"{one.what} jumps over zero{where}; an event is where a scalar goes through zero: take for it the scalar "
            "whose sign is asked for"
        )
    return (
        f"{one.what} jumps (by {abs(jump):.3g}, for example){where}: write two modes, each with what is valid on its "
        "side and an event there that leads to the other, and a third that stays there if both sides can lead to it; "
        "fabs, fmin, fmax and if_else with parts that meet may stay in one mode"
    )


def _text(step: tuple[int, list[ca.SX]], given: tuple[ca.SX, ...], names: Names) -> str:
    """Where a step jumps, in the user's names; nothing where that is long."""
    operation, u = step
    called = [*names.entries, "t", *names.parameters, "sign"]
    written = [
        str(value) for value in ca.substitute(
            [ca.SX(each) for each in u], [ca.vertcat(*given)], [ca.vertcat(*map(ca.SX.sym, called))])
    ]  # fmt: skip
    if operation in (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_FMIN, ca.OP_FMAX):
        text = f" where {' = '.join(reversed(written) if ca.SX(u[0]).is_constant() else written)}"
    elif operation in (ca.OP_SIGN, ca.OP_FABS):
        text = f" where {written[0]} = 0"
    else:
        name = {ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_FMOD: "fmod", ca.OP_REMAINDER: "remainder",
                ca.OP_COPYSIGN: "copysign", ca.OP_ATAN2: "atan2"}.get(operation, "")  # fmt: skip
        text = f" where {name}({', '.join(written)}) does" if name else ""
    return text if len(text) <= LONGEST_TEXT else ""
