"""
Friction is known to two per cent: which gain?
==============================================

A thousand servos drawn from the uncertainty, each with its own fold gain, in one call. The gain must exceed the
largest.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Options, Servo, Uncertainty, find_fold, sample_fold_gains

servo = Servo()
known = Uncertainty({"friction.static": (0.52, 0.54), "friction.coulomb": (0.435, 0.445)})
drawn = sample_fold_gains(servo, "switch", known, 1000, seed=1, options=Options(tol=1e-7))
print(np.nanmin(drawn.gains), np.nanmax(drawn.gains))

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
ax.hist(drawn.gains, bins=40)
ax.set(xlabel="fold gain [V/rad]", ylabel="servos of 1000")

# %%
# The fold of the worst corner is above them all, and not by much. There and at the largest of the drawn ones an event
# map marched by Taylor series, apart from the package's solvers, has its fold as well.

from problems import taylor

corner = servo.replace(**{"friction.static": 0.54, "friction.coulomb": 0.435})
largest = int(np.nanargmax(drawn.gains))
drawn_worst = servo.replace(**dict(zip(drawn.names, map(float, drawn.parameters[largest]), strict=True)))
truth = []
for one in (corner, drawn_worst):
    alone = find_fold(one, "switch")
    truth.append(taylor.switch_fold(one, alone.gain, alone.orbit.amplitude)[0])
assert abs(drawn.gains[largest] / truth[1] - 1) < 1e-7
assert 0.97 * truth[0] < drawn.gains[largest] < truth[0]
