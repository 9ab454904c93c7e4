"""Relay feedback around a linear plant, with and without hysteresis: y = C x is held down by u = -+1.

    x_i' = -a_i x_i + b_i u,   y = x_1 + ... + x_n,   u = -1 until y falls to -eps,   u = +1 until y rises to eps

with a = (1, 2, 3) and b = (1/2, -1, 1/2): the plant is 1/((s + 1)(s + 2)(s + 3)) in modal form.  With b = (1, -1),
a = (1, 2) it is of second order, 1/((s + 1)(s + 2)), whose cycle shrinks to a point with eps.  Half a period T/2 = h
after a switch of u the state is the negative of itself,

    x_i(0) = b_i/a_i tanh(a_i h/2)  for u = -1,    so    sum_i b_i/a_i tanh(a_i h/2) = eps

is the one equation for h.  The half-period map has the Jacobian -(1 - w C/(C w)) exp(A h), w = x'(h) in front of the
switch: its eigenvalues are the half multipliers, the one along the section is zero.

Sources: K. J. Astrom, Oscillations in systems with relay feedback, in Adaptive Control, Filtering and Signal
Processing, IMA Volumes 74 (1995) 1-25; J. M. Goncalves, A. Megretski and M. A. Dahleh, Global stability of relay
feedback systems, IEEE Transactions on Automatic Control 46 (2001) 550-562.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, present, root

THIRD_ORDER = ((1.0, 2.0, 3.0), (0.5, -1.0, 0.5))
SECOND_ORDER = ((1.0, 2.0), (1.0, -1.0))


def relay(a: Sequence[float], b: Sequence[float]) -> System:
    """Relay feedback around the plant sum b_i/(s + a_i).

    Returns system with the parameter eps, in units of which it is the same for -x.
    """
    states = tuple(f"x{i}" for i, _ in enumerate(a, 1))
    size = sum(abs(bi / ai) for ai, bi in zip(a, b, strict=True))

    def output(x: Any) -> Any:
        return sum(getattr(x, s) for s in states) / size

    def pushed(u: float) -> Any:
        return lambda x, p: {s: -ai * getattr(x, s) + bi * u for s, ai, bi in zip(states, a, b, strict=True)}

    down = Event("falls", lambda x, p: output(x) + p.eps / size, -1, to="up")
    up = Event("rises", lambda x, p: output(x) - p.eps / size, +1, to="down")
    return System(
        f"relay feedback, order {len(a)}",
        states,
        {"eps": 0.0},
        (Mode("down", field=pushed(-1.0), ends=(down,)), Mode("up", field=pushed(+1.0), ends=(up,))),
    )


def truth(a: Sequence[float], b: Sequence[float], eps: float, near: float) -> Truth:
    """The closed form.

    Returns truth: period, extrema of all states, multipliers.
    """
    A, B = np.array(a), np.array(b)
    h = root(lambda h: float(np.sum(B / A * np.tanh(A * h / 2))) - eps, near)
    x = B / A * np.tanh(A * h / 2)
    w = A * x - B  # at the end of u = -1, where the state is -x
    half = np.linalg.eigvals(-(np.eye(A.size) - w[:, None] / np.sum(w)) @ np.diag(np.exp(-A * h)))
    extrema = {f"x{i}": (-abs(float(xi)), abs(float(xi))) for i, xi in enumerate(x, 1)}
    return Truth(2 * h, extrema, tuple(sorted((complex(m**2) for m in half), key=abs, reverse=True))[: A.size - 1])


CASES = (
    (THIRD_ORDER, 0.0, 2.0), (THIRD_ORDER, 1e-6, 2.0), (THIRD_ORDER, 0.02, 3.0),
    (SECOND_ORDER, 0.1, 1.5), (SECOND_ORDER, 1e-3, 0.2),
)  # fmt: skip
"""(plant, eps, half a period, about)."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle of each case."""
    for (a, b), eps, near in CASES:
        system = relay(a, b)
        start = dict.fromkeys(system.states, 0.1)
        orbit = find_cycle(system, "down", tol=tol, parameters={"eps": eps}, start=start)
        yield Found(f"order {len(a)}, eps = {eps:g}", orbit, truth(a, b, eps, near))


def draw(found: Sequence[Found], ax: Any) -> None:
    """The output over the time."""
    for one in found:
        times, states = one.orbit.sample(16)
        ax.plot(times, states.sum(axis=0), label=one.caption)
    ax.set(xlabel="t", ylabel="y")
    ax.legend()


if __name__ == "__main__":
    present(cycles(), draw, "Relay feedback")
