"""
What LuGre adds: the bristle rings
==================================

In the LuGre model the servo does not stand still when it sticks: the bristles behind the contact ring, through many
reversals of 1e-5 rad, and creep. Every reversal is a boundary of the collocation, so that no polynomial meets a kink.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Options, Servo, find_orbit

orbit = find_orbit(Servo(), "lugre", 0.04, options=Options(tol=1e-9))
times, states = orbit.sample()
first = next(arc for arc in orbit.arcs)
print(f"{len(orbit.arcs)} phases in half a period; the first slip takes {first.duration:.4g} s of {orbit.period:.6g} s")

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
start = times[np.argmax(states[1] < 0)]  # the first reversal
near = (times > start - 0.01) & (times < start + 0.06)
ax.plot(times[near] - start, 1e6 * states[3][near])
ax.set(xlabel="time after the first reversal [s]", ylabel="bristle deflection [1e-6 rad]")

# %%
# Period and half multiplier from an explicit event solver with Taylor series of order 22.

from problems import table1

truth = next(row for row in table1.REFERENCE["lugre"]["stable"] if row["K"] == 0.04)
assert abs(orbit.period / truth["period"] - 1) < 1e-9
assert abs(orbit.half_multiplier - truth["mu"]) < 1e-8
