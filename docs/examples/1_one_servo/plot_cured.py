"""
A servo that hunts, and the same one cured
==========================================

A step of one radian with the same servo, the same gain and the same torque. As it is, it never stands still: it sticks
beside its set point, the integral action winds up until it breaks away, and it slips past. With an integrator that
takes no notice of errors below 0.048 rad it comes to rest, and stays there.
"""

import matplotlib.pyplot as plt

from casahunt import Servo, simulate
from casahunt.servo.parts import DEAD_BAND, loop_of

BAND = 0.048  # rad; casahunt remedies says that 0.0434 is the least that will do
plain = loop_of(Servo(), "switch", 0.04)
loops = {"as it is": plain, "with a dead band": plain.with_parts(DEAD_BAND, dead_band=BAND)}
steps = [simulate(loop, time=60.0) for loop in loops.values()]

for step, title, color in zip(steps, loops, ("tab:red", "tab:green"), strict=True):
    figure, ax = plt.subplots(figsize=(4.6, 2.9), dpi=200, layout="constrained")
    ax.axhline(0, color="0.6", linewidth=0.8)
    times, states = step.dense()
    ax.plot(times, states[0], color=color)
    ax.set(title=title, xlim=(0, 60), ylim=(-0.12, 0.12))
    ax.set(xlabel="time [s]", ylabel="off the set point [rad]")

# %%
# The first one ends in the cycle that Taylor series with 34 digits have. The second one is stuck inside the band,
# with a torque that static friction holds: there the integrator stands still, so nothing changes any more.

from problems import table1

truth = next(row for row in table1.REFERENCE["switch"]["stable"] if row["K"] == 0.04)
hunting, cured = steps
assert abs(hunting.verdict.amplitude / truth["amplitude"] - 1) < 1e-3
assert cured.verdict.kind == "at rest" and abs(cured.end[0]) < BAND
assert not cured.signal("moving", [60.0])[0] and abs(cured.signal("torque", [60.0])[0]) < Servo().friction.static
assert abs(cured.peak_torque / hunting.peak_torque - 1) < 1e-3
