"""
A block on a belt
=================

Leine's stick-slip oscillator: another hybrid system in twenty lines. Equations, names, events; nothing else.
"""

import matplotlib.pyplot as plt

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle


def slip(x, p):
    return {"x": x.v, "v": p.static / (1 + p.decay * (p.belt - x.v)) - x.x}


def stick(x, t, p):
    return {"x": x.x + p.belt * t, "v": p.belt}


caught = Event("catches up", lambda x, p: x.v - p.belt, direction=+1, to="stick")
freed = Event("breaks away", lambda x, p: x.x - p.static, direction=+1, to="slip")
modes = Mode("slip", field=slip, ends=(caught,)), Mode("stick", flow=stick, ends=(freed,))
belt = System("block on a belt", ("x", "v"), {"static": 1.0, "decay": 3.0, "belt": 0.2}, modes)

orbit = find_cycle(belt, "slip", x=0.0, v=0.0, tol=1e-9)
print(orbit)
figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
orbit.plot("x", "v", ax=ax)

# %%
# Period and amplitude of Leine et al. (Nonlinear Dynamics 16, 1998), recomputed in extended precision.

assert abs(orbit.period / 12.001031294830579 - 1) < 1e-9
assert abs(orbit.extrema("x").high.value - 1.133944676441657) < 1e-9
