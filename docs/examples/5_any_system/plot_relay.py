"""
Relay feedback in closed form
=============================

A relay around a linear plant oscillates; the half period solves one transcendental equation.
"""

import matplotlib.pyplot as plt

from casahunt.orbits import find_cycle
from problems import relay

system = relay.relay(*relay.THIRD_ORDER)
orbit = find_cycle(system, "down", tol=1e-9, parameters={"eps": 0.02}, start=dict.fromkeys(system.states, 0.1))
print(orbit, orbit.multipliers.full)
figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
times, states = orbit.sample()
ax.plot(times, states.sum(axis=0))
ax.set(xlabel="t", ylabel="output of the plant")

# %%
# The closed form.

truth = relay.truth(*relay.THIRD_ORDER, 0.02, 3.0)
assert abs(orbit.period / truth.period - 1) < 1e-9
