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
# The fold of the worst corner, computed alone, is above them all, and not by much.

worst = find_fold(servo.replace(**{"friction.static": 0.54, "friction.coulomb": 0.435}), "switch").gain
assert 0.97 * worst < np.nanmax(drawn.gains) < worst
