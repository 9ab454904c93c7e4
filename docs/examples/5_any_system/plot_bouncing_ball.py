"""
A bouncing ball: fold and flip in closed form
=============================================

A ball on a shaking table, in closed form between its impacts. Below an amplitude of the table it cannot bounce once in
every turn (a fold), above another it bounces in two heights (a flip).
"""

import math

import matplotlib.pyplot as plt

from casahunt.continuation import follow, smallest
from casahunt.orbits import find_cycle
from problems import bouncing_ball

a, turns = 1.2 * bouncing_ball.fold(1) / 400, 1
truth, near = bouncing_ball.truth(a, turns, +1)
orbit = find_cycle(bouncing_ball.SYSTEM, tol=1e-9, parameters={"a": a}, settled=True, start=near)
branch = follow(orbit, "a", to=0.05)
flip = next(point for point in branch.special if point.kind == "flip")
lowest = smallest(orbit, "a")
print(lowest.value, flip.meaning)

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
ax.plot(branch.values, branch.amplitudes, ".-")
ax.axvline(flip.value, color="C1", linestyle="--", label="flip")
ax.axvline(lowest.value, color="C2", linestyle="--", label="fold")
ax.set(xlabel="amplitude of the table [m]", ylabel="height of the ball [m]")
ax.legend()

# %%
# Holmes (1982), exactly.

e, w, g = 0.8, 20.0, 9.81
fold = math.pi * g * (1 - e) / (1 + e)
assert abs(lowest.value * w**2 / fold - 1) < 1e-8
assert abs(flip.value * w**2 / math.hypot(fold, 2 * g * (1 + e**2) / (1 + e) ** 2) - 1) < 1e-7
