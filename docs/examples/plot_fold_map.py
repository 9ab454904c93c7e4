"""
The fold gain over two parameters
=================================

Which combinations of static and Coulomb friction need which gain? Contours of the fold gain.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Servo, find_fold, fold_map

static, coulomb = np.linspace(0.5, 0.56, 9), np.linspace(0.42, 0.46, 9)
folds = fold_map(Servo(), "switch", ("friction.static", "friction.coulomb"), static, coulomb)

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
lines = ax.contour(static, coulomb, folds.gains.T, levels=12)
ax.clabel(lines)
ax.set(xlabel="static friction [N m]", ylabel="Coulomb friction [N m]", title="fold gain [V/rad]")

# %%
# A fold computed alone, at a corner of the map.

corner = find_fold(Servo().replace(**{"friction.static": 0.56, "friction.coulomb": 0.46}), "switch")
assert abs(folds.gains[-1, -1] / corner.gain - 1) < 2e-6
