"""Morris and Lecar's muscle fibre: both ways in which a nerve begins to fire.

    20 v' = I - gca m(v) (v - 120) - 8 w (v + 84) - 2 (v + 60),    m = (1 + tanh((v + 1.2)/18))/2
    w' = phi (n(v) - w) cosh((v - v3)/(2 v4)),    n = (1 + tanh((v - v3)/v4))/2

"Hopf" (v3 = 2, v4 = 30, gca = 4.4, phi = 0.04): equilibrium loses its stability at I = 93.86 and regains it at
212.02, and unstable cycles born there fold at I = 88.29 and 216.90.  "Circle" (v3 = 12, v4 = 17.4, gca = 4, phi =
0.066): two equilibria merge on the cycle at I = 39.96, its period grows without bound, with the square root of the
distance.

Sources: C. Morris and H. Lecar, Biophysical Journal 35 (1981) 193-213; J. Rinzel and B. Ermentrout, Analysis of
neural excitability and oscillations, in Methods in Neuronal Modeling, MIT Press 1998 (93.86, 212, 88.3, 217; 39.96).
The digits: scripts/peers/branch_truths.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca

from casahunt.hybrid import Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course


def field(x: Any, p: Any) -> dict[str, Any]:
    """The fibre."""
    m, n = (1 + ca.tanh((x.v + 1.2) / 18)) / 2, (1 + ca.tanh((x.v - p.v3) / p.v4)) / 2
    return {
        "v": (p.I - p.gca * m * (x.v - 120) - 8 * x.w * (x.v + 84) - 2 * (x.v + 60)) / 20,
        "w": p.phi * (n - x.w) * ca.cosh((x.v - p.v3) / (2 * p.v4)),
    }


SYSTEM = System(
    "Morris and Lecar's fibre",
    states=("v", "w"),
    parameters={"I": 100.0, "v3": 2.0, "v4": 30.0, "gca": 4.4, "phi": 0.04},
    modes=(Mode("smooth", field=field),),
)
CIRCLE = {"v3": 12.0, "v4": 17.4, "gca": 4.0, "phi": 0.066}
HOPF, FOLDS = (93.8576183737, 212.0188161004), (88.293250543, 216.8998013894)
CIRCLE_FOLD, CIRCLE_HOPF = 116.4302642263, 98.0715541854
"""scripts/peers/branch_truths.py, correct to 1e-11 of themselves."""


def cycle() -> SystemOrbit:
    """The cycle at I = 100."""
    return find_cycle(SYSTEM, v=0.0, w=0.2)


def on_circle() -> SystemOrbit:
    """The cycle of the other parameters at I = 50."""
    return find_cycle(SYSTEM, parameters={**CIRCLE, "I": 50.0}, v=0.0, w=0.2)


def branches() -> Iterator[Course]:
    """Each to both ends."""
    yield Course("Morris-Lecar, down", cycle, "I", 60.0, (("fold", FOLDS[0]), ("Hopf", HOPF[0])), ("Hopf",))
    yield Course("Morris-Lecar, up", cycle, "I", 260.0, (("fold", FOLDS[1]), ("Hopf", HOPF[1])), ("Hopf",))
    yield Course("Morris-Lecar, to the circle", on_circle, "I", 30.0, (), ("homoclinic orbit",))
    ends = (("fold", CIRCLE_FOLD), ("Hopf", CIRCLE_HOPF))
    yield Course("Morris-Lecar, from the circle", on_circle, "I", 150.0, ends, ("Hopf",))
