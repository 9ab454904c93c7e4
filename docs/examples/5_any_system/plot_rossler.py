"""
A cascade of flips
==================

Rossler's system doubles its period again and again. The first flip is located on the branch, and the branch that leaves
it there is entered.
"""

import matplotlib.pyplot as plt

from casahunt.continuation import branch_off, follow
from casahunt.orbits import find_cycle
from problems import rossler

single = find_cycle(rossler.SYSTEM, tol=1e-8, x=-2.5, y=0.0, z=0.0)
branch = follow(single, "c", to=3.0)
flip = next(point for point in branch.special if point.kind == "flip")
double = branch_off(flip, "c")
print(flip.meaning)

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
single.plot("x", "y", ax=ax)
double.plot("x", "y", ax=ax)

# %%
# The flip, by Taylor series in extended precision and Newton's method on the multiplier.

assert abs(flip.value - 2.832445) < 1e-6
assert abs(double.period / (2 * flip.orbit.period) - 1) < 0.01
