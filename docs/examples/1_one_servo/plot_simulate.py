"""
A motion that ends in the cycle
===============================

The regulator task, simulated: the servo is sent from 0 to 1 rad at K = 0.04, and at a gain above the fold. The verdict
on its end is not read off the picture but proved by the event map.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Servo, simulate

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
motions = {gain: simulate(Servo(), "switch", gain, time=100) for gain in (0.04, 0.7121)}
for gain, motion in motions.items():
    times = np.linspace(0, motion.times[-1], 4000)
    ax.plot(times, motion.sample(times)[0], label=f"K = {gain}: {motion.verdict.kind}")
    print(gain, motion.verdict.sentence)
ax.set(xlabel="time [s]", ylabel="position off the set point [rad]", ylim=(-0.1, 0.1))
ax.legend()

# %%
# It ends in the cycle of the event map in 34 digits; above the fold, 0.6473, it does not hunt.

from problems import table1

truth = next(row for row in table1.REFERENCE["switch"]["stable"] if row["K"] == 0.04)
assert motions[0.04].verdict.kind == "hunting"
assert abs(motions[0.04].verdict.amplitude / truth["amplitude"] - 1) < 1e-4
assert motions[0.7121].verdict.kind in ("decaying", "at rest")
