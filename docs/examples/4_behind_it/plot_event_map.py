"""
The event map: every cycle in a range
=====================================

From one stick to the next the Switch servo has one number, its distance a from the set point, and a map P(a) of it. Its
fixed points are the hunting cycles; a scan shows all of them between two positions, or that there is none.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Servo, fixed_points

seen = fixed_points(Servo(), 0.4)
for point in seen.fixed:
    print(f"a = {point.amplitude:.10g} rad, P'(a) = {point.multiplier:.6g}")

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
a = np.array([p.start for p in seen.points])
ax.loglog(a, [p.position for p in seen.points], ".-", label="P(a)")
ax.loglog(a, a, "k--", linewidth=0.8, label="a")
ax.set(xlabel="a [rad]", ylabel="P(a) [rad]")
ax.legend()

# %%
# Unstable and stable cycle, Taylor series with 34 digits.

from problems import table1

truth = table1.REFERENCE["switch"]
known = [next(row for row in truth[name] if row["K"] == 0.4)["amplitude"] for name in ("unstable", "stable")]
assert np.allclose([p.amplitude for p in seen.fixed], known, rtol=1e-8)
