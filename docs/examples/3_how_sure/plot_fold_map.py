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
# At two corners of the map: the fold of an event map marched by Taylor series, apart from the package's solvers.

from problems import taylor

for i, j in ((0, 0), (-1, -1)):
    servo = Servo().replace(**{"friction.static": float(static[i]), "friction.coulomb": float(coulomb[j])})
    near = find_fold(servo, "switch").orbit.amplitude
    truth, _ = taylor.switch_fold(servo, float(folds.gains[i, j]), near)
    assert abs(folds.gains[i, j] / truth - 1) < 2e-6
