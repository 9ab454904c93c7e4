"""
The gain at which hunting ends
==============================

Raised far enough, the gain ends hunting: the stable and the unstable cycle meet in a *fold* and are gone. The same
solve tells by how much each parameter of the servo moves that gain.
"""

import matplotlib.pyplot as plt

from casahunt import Options, Servo, find_fold, fold_sensitivities

fold = find_fold(Servo(), "switch", options=Options(tol=1e-9))
print(fold.gain, fold.gain_error)

# %%
# The elasticity of a parameter is by how many per cent the gain moves for one per cent of it.

slopes = fold_sensitivities(fold)
moving = {name: e for name, e in slopes.elasticities.items() if abs(e) > 1e-6}
figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
ax.barh(list(moving), list(moving.values()))
ax.axvline(0, color="black", linewidth=0.8)
ax.set(xlabel="per cent of the fold gain for one per cent of the parameter")

# %%
# From outside: the event map in 34 digits, and finite differences of such folds.

from problems import table1

assert abs(fold.gain / table1.REFERENCE["switch"]["fold"]["K"] - 1) < 1e-9
assert abs(moving["friction.static"] - 6.081563) < 1e-5
assert abs(moving["friction.coulomb"] + 5.048845) < 1e-5
