"""Canudas de Wit's servo (canudas.py) with all gains of its controller scaled by K: u = -K (kp x + kv x' + ki w).

From the paper's K = 1 the cycle goes up to a fold and back below it on the unstable side, where a disturbance grows by
1e10 in half a period.  Next to the fold it loses its symmetry, and regains it; the pair of lopsided cycles that
branches off at the one meets again in the symmetric cycle at the other.  On the way a weak reversal of the ring-down
dies.

Source of the system: canudas.py.  Source of the numbers: scripts/peers/gallery_truths.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from casahunt.continuation import Branch, branch_off, follow
from casahunt.hybrid import System
from casahunt.orbits import Options, find_cycle

from . import canudas
from .gallery import Course

TOL = 1e-7


def scaled(field: Any) -> Any:
    """A field of canudas.py with its controller K times as strong."""

    def stronger(x: Any, p: Any) -> dict[str, Any]:
        u = -(p.kp * x.x + p.kv * x.v + p.ki * x.w)
        rates = field(x, p)
        return {**rates, "v": rates["v"] + (p.K - 1) * u / p.m}

    return stronger


SYSTEM = System(
    "PID servo with LuGre friction, all gains K times",
    states=canudas.SYSTEM.states,
    parameters={"K": 1.0, **canudas.SYSTEM.parameters},
    modes=tuple(replace(mode, field=scaled(mode.field)) for mode in canudas.SYSTEM.modes),
)

NEAR_BREAKING = (
    (48.02022, (0.0017402945724885022, -0.007941146032140719, 1.0240843942551722e-05)),
    (48.44462, (0.0009298770867072468, -0.007884778132443036, 1.2568281751060183e-05)),
)
"""K, and (v, w, z) where x passes zero, next to the losses of symmetry: where the independent search begins."""
NEAR_FOLD = (48.4548, (0.0007398637580574439, -0.007883723204257408, 1.3126463355958961e-05))
"""The same next to the fold."""
NEAR_FLIPS = (
    (47.99822, (0.00173398282, -0.00793425523, 1.02415099e-05)),
    (48.43318, (0.00129472532, -0.00788555849, 1.1497791e-05)),
)
NEAR_LOPSIDED_FOLD = (47.9671, (0.00173469442, -0.00793845418, 1.02408842e-05))
"""The same next to where the lopsided cycles flip, and next to their fold."""
BREAKING = (48.0202208712, 48.4446231204)
"""K at which the symmetric cycle loses and regains its symmetry: scripts/peers/gallery_truths.py, correct to 1e-9."""
FOLD = 48.4548207627
"""The largest K that it has: the same, correct to 1e-9."""
LOPSIDED_FOLD, FLIPS = 47.9671040217, (47.9982255572, 48.4331844445)
"""K at which the lopsided cycles have their fold and their flips: the same, correct to 1e-9."""


def symmetric(to: float = 100.0, back: float = 0.99, start: float = 1.0) -> Branch[Any]:
    """The branch of the symmetric cycle, from K = `start` round the fold.

    to, back: where it would end without a fold, and where it ends behind it.
    """
    orbit = find_cycle(SYSTEM, "backwards", tol=TOL, parameters={"K": start}, x=1.0, v=0.0, w=0.0, z=0.0)
    return follow(orbit, "K", to=to, back=back, options=Options(tol=TOL), max_points=1500)


def lopsided(special: Any, off: float) -> Branch[Any]:
    """One of the pair that branches off, followed away from the symmetric cycle as far as it exists.

    off: how far off the branch begins; -off gives the other one of the pair.
    """
    first = branch_off(special, "K", off=off)
    return follow(first, "K", to=40.0, back=100.0, options=Options(tol=TOL))


def branches() -> Iterator[Course]:
    """Round the fold next to which it loses and regains its symmetry."""
    start = {"x": 1.0, "v": 0.0, "w": 0.0, "z": 0.0}
    begins = partial(find_cycle, SYSTEM, "backwards", tol=TOL, parameters={"K": 44.0}, start=start)
    special = (*(("symmetry breaking", K) for K in BREAKING), ("fold", FOLD))
    yield Course("Canudas, all gains", begins, "K", 60.0, special, within=1e-7)
