"""
Van der Pol's oscillator, mildly and very stiff
===============================================

No event at all: the cycle is cut by a plane that is found on the way, and half of it is computed, because x to -x maps
it to the other half.
"""

import matplotlib.pyplot as plt

from casahunt.orbits import find_cycle
from problems import van_der_pol

figure, axes = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
for mu, ax in zip((1.0, 1000.0), axes, strict=True):
    orbit = find_cycle(van_der_pol.SYSTEM, tol=1e-9, parameters={"mu": mu}, x=2.0, v=0.0)
    times, states = orbit.sample()
    ax.plot(times, states[0])
    ax.set(xlabel="t", ylabel="x", title=f"mu = {mu:g}, T = {orbit.period:.10g}")
    assert abs(orbit.period / van_der_pol.TRUTH[mu].period - 1) < 1e-9  # Taylor series in extended precision
