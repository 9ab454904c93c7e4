"""
How near to the set point it must come
======================================

The unstable cycle is the border: stuck nearer to the set point than it, the servo settles; farther, it hunts. Two
motions, one from each side, confirm it.
"""

import matplotlib.pyplot as plt

from casahunt import Servo, basin

found = basin(Servo(), "switch", 0.4)
print(found.border, found.confirmed)

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
for trial, colour in ((found.inside, "C2"), (found.outside, "C3")):
    ax.semilogy(trial.positions, "o-", color=colour, label=f"{trial.outcome}")
ax.axhline(found.border, color="black", linestyle="--", label="border")
ax.set(xlabel="stick", ylabel="distance from the set point [rad]")
ax.legend()

# %%
# The unstable cycle of the event map in 34 digits.

from problems import table1

truth = next(row for row in table1.REFERENCE["switch"]["unstable"] if row["K"] == 0.4)
assert found.confirmed and abs(found.border / truth["amplitude"] - 1) < 1e-6
