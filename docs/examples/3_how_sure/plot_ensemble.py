"""
Two thousand servos in one call
===============================

The hunting cycles of servos that differ in friction and gain, solved in batches.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Servo, orbit_ensemble

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
# The first row against the event map in 34 digits, others against the fixed point of one marched by Taylor series.

from problems import table1, taylor

truth = next(row for row in table1.REFERENCE["switch"]["stable"] if row["K"] == 0.1)
assert abs(servos.amplitudes[0] / truth["amplitude"] - 1) < 1e-6
for i in (-1, int(servos.amplitudes.argmin()), int(servos.amplitudes.argmax())):
    servo, gain = Servo().replace(**{"friction.static": float(rows[i, 1])}), float(rows[i, 0])
    amplitude, period = taylor.switch_cycle(servo, gain, float(servos.amplitudes[i]))
    assert abs(servos.amplitudes[i] / amplitude - 1) < 1e-6 and abs(servos.periods[i] / period - 1) < 1e-6
