"""
The bifurcation diagram
=======================

Amplitude of the hunting cycle against the gain, from K = 0.1 round the fold and back along the unstable cycle, which
bounds what still settles.
"""

import matplotlib.pyplot as plt

from casahunt import Servo, diagram

servo = Servo()
branch = diagram(servo, "switch", start=0.1)
print(branch)
for point in branch.special:
    print(point.meaning)
fold = next(point for point in branch.special if point.kind == "fold")

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
ax.plot(branch.values, branch.amplitudes, ".-")
ax.set(xscale="log", yscale="log", xlabel="gain K [V/rad]", ylabel="amplitude [rad]")

# %%
# Both cycles at K = 0.1 and the fold, against the event map in 34 digits.

from problems import table1

truth = table1.REFERENCE["switch"]
ends = [next(row for row in truth[name] if row["K"] == 0.1)["amplitude"] for name in ("stable", "unstable")]
assert abs(branch.amplitudes[0] / ends[0] - 1) < 1e-6 and abs(branch.amplitudes[-1] / ends[1] - 1) < 1e-6
assert abs(fold.value / truth["fold"]["K"] - 1) < 1e-6
