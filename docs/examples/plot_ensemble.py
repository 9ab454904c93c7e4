"""
Two thousand servos in one call
===============================

The hunting cycles of servos that differ in friction and gain, solved side by side.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Servo, find_orbit, orbit_ensemble
from problems import table1

random = np.random.default_rng(3)
rows = np.column_stack([random.uniform(0.09, 0.11, 2000), random.uniform(0.52, 0.54, 2000)])
rows[0] = 0.1, 0.53  # the servo of Table 1 itself
servos = orbit_ensemble(Servo(), "switch", 0.1, ["gain", "friction.static"], rows)
print(servos)

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
dots = ax.scatter(rows[:, 0], servos.amplitudes, c=rows[:, 1], s=4)
figure.colorbar(dots, label="static friction [N m]")
ax.set(xlabel="gain K [V/rad]", ylabel="amplitude [rad]")

# %%
# The first row against the event map in 34 digits, the last one against the cycle computed alone.

truth = next(row for row in table1.REFERENCE["switch"]["stable"] if row["K"] == 0.1)
alone = find_orbit(Servo().replace(**{"friction.static": rows[-1, 1]}), "switch", rows[-1, 0])
assert abs(servos.amplitudes[0] / truth["amplitude"] - 1) < 1e-6
assert abs(servos.periods[-1] / alone.period - 1) < 2e-6
