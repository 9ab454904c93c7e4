"""
An impact oscillator
====================

A forced mass that hits a stop: velocity jumps, and time enters the field. The parameters are those of COCO's recipes.
"""

import matplotlib.pyplot as plt

from casahunt.orbits import find_cycle
from problems import impact_oscillator

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
for w in (1.0, 0.7):
    orbit = find_cycle(impact_oscillator.SYSTEM, tol=1e-9, parameters={"w": w}, x=0.0, v=0.0)
    orbit.plot("x", "v", ax=ax)
    low, high = impact_oscillator.TRUTH[w, 1.0].extrema["x"]  # Taylor series in extended precision
    assert abs(orbit.extrema("x").low.value - low) < 1e-8 and abs(orbit.extrema("x").high.value - high) < 1e-8
