"""Leine's block on a belt, a system that is no servo: m x'' + k x = F(v_rel), stick and slip, not symmetric.

    slip   v < belt:  F = static / (1 + decay (belt - v)),  until v = belt
    stick  v = belt:  x = x_0 + belt t, exactly,            until k x = static

Every stick ends at the same place, so one cycle attracts every motion at once: its multiplier is zero.

Source: Leine, van Campen, de Kraker and van den Steen, Stick-slip vibrations induced by alternate friction models,
Nonlinear Dynamics 16 (1998) 41-54, with m = k = static = 1, decay = 3, belt = 0.2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from casahunt.hybrid import Event, Mode, System
from casahunt.hybrid.system import Cycle, Phase
from casahunt.orbits import find_cycle
from problems.fixed_sequence import FixedSequence

from .gallery import Found, Truth, portrait, present


def slip(x: Any, p: Any) -> dict[str, Any]:
    """x' while the block is slower than the belt."""
    force = p.static / (1 + p.decay * (p.belt - x.v))
    return {"x": x.v, "v": (force - p.stiffness * x.x) / p.mass}


BELT = System(
    "block on a belt",
    states=("x", "v"),
    parameters={"mass": 1.0, "stiffness": 1.0, "static": 1.0, "decay": 3.0, "belt": 0.2},
    modes=(
        Mode("slip", field=slip, holds=lambda x, p: 1 - x.v / p.belt,
             ends=(Event("catches up", lambda x, p: x.v / p.belt - 1, +1, to="stick"),)),
        Mode("stick", flow=lambda x, t, p: {"x": x.x + p.belt * t, "v": p.belt},
             holds=lambda x, p: 1 - p.stiffness * x.x / p.static,
             ends=(Event("breaks away", lambda x, p: p.stiffness * x.x / p.static - 1, +1, to="slip"),)),
    ),
)  # fmt: skip

SYSTEM = BELT.vector_form
"""In the terms of the engine, as is what follows: a cycle whose phases are known, posed without a search."""
VALUES = tuple(BELT.parameters.values())
CYCLE = Cycle(SYSTEM.name, SYSTEM.states, tuple(BELT.parameters),
              tuple(Phase(SYSTEM.modes[name], SYSTEM.exits[name][0].event) for name in ("slip", "stick")),
              closure=np.eye(2), repeats=1)  # fmt: skip
PROBLEM = FixedSequence(CYCLE, VALUES, followed="belt", scheme=(8, "gauss"))

TRUTH = {
    0.2: Truth(12.001031294830579, {"x": (-0.5554326900602316, 1.133944676441657),
               "v": (-0.8399020492808771, 0.2)}, (0.0,)),
    0.35: Truth(9.358676730650158, {"x": (-0.7751062728926761, 1.241709346252044),
               "v": (-1.006053662015147, 0.35)}, (0.0,)),
    0.5: Truth(8.282743522678118, {"x": (-0.9606482249823916, 1.354505602980898),
               "v": (-1.15623012881116, 0.5)}, (0.0,)),
}  # fmt: skip
"""By the belt's speed; scripts/peers/gallery_truths.py."""
SLIPS = {
    0.2: (4.2959995254799, -0.54100635386999),
    0.35: (4.4029280912054, -0.73451202380549),
    0.5: (4.5165667565407, -0.88308838306866),
}
"""Belt speed: duration of the slip, position where it ends; scipy's DOP853 with its events, rtol 1e-13."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle for each speed."""
    for speed, truth in TRUTH.items():
        orbit = find_cycle(BELT, "slip", tol=tol, parameters={"belt": speed}, follow="belt", x=0.0, v=0.0)
        yield Found(f"belt at {speed:g}", orbit, truth)


def draw(found: Sequence[Found], ax: Any) -> None:
    """The phase plane."""
    for one in found:
        portrait(one.orbit, "x", "v", ax, label=one.caption)
    ax.legend()


if __name__ == "__main__":
    present(cycles(), draw, "Leine's block on a belt")
