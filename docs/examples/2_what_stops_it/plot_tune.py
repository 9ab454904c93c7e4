"""
A gain that does not hunt
=========================

The least gain that is ten per cent above the largest fold gain of a set of servos; it is verified apart from the
search, by folds, loops, the event map and simulated tasks.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Servo, Uncertainty, simulate, tune

servo = Servo()
friction = Uncertainty({"friction.static": (0.52, 0.54)})
tuning = tune(servo, "switch", uncertainty=friction)
print(tuning.gain, tuning.fold_gain, tuning.verification.ok)

worst = servo.replace(**{"friction.static": 0.54})
figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
motions = {gain: simulate(worst, "switch", gain, time=150) for gain in (0.04, tuning.gain)}
for gain, motion in motions.items():
    times = np.linspace(0, motion.times[-1], 4000)
    ax.plot(times, motion.sample(times)[0], label=f"K = {gain:.4g}: {motion.verdict.kind}")
ax.set(xlabel="time [s]", ylabel="position off the set point [rad]", ylim=(-0.1, 0.1))
ax.legend()

# %%
# The motions of the worst servo are simulated apart from all of it. From any stick position an event map marched by
# Taylor series comes nearer to the set point at the gain that tuning gives, and farther from some at the lower one.

from problems import taylor

assert tuning.verification.ok
assert motions[0.04].verdict.kind == "hunting" and motions[tuning.gain].verdict.kind in ("decaying", "at rest")
positions = np.geomspace(1e-4, 0.1, 25)
nearer = {
    gain: [abs(taylor.switch_half_cycle(worst, gain, float(a), most_slips=50)[0]) < a for a in positions]
    for gain in motions
}
assert all(nearer[tuning.gain]) and not all(nearer[0.04])
