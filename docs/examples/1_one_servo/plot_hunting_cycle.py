"""
The hunting cycle of a servo
============================

A servo with integral action and dry friction breaks away, slips past its set point, sticks there, and the integral
action pulls it back: it *hunts*. One call gives that cycle, for the exact Switch model and for LuGre friction.
"""

import matplotlib.pyplot as plt

from casahunt import Options, Servo, find_orbit

servo = Servo()  # Table 1 of the report
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(6.4, 5), layout="constrained")
orbits = {model: find_orbit(servo, model, 0.04, options=Options(tol=1e-9)) for model in ("switch", "lugre")}
for model, orbit in orbits.items():
    times, states = orbit.sample()
    axes[0].plot(times, states[0], label=model)
    axes[1].plot(times, states[1])
    print(f"{model}: {orbit.amplitude:.9g} rad, {orbit.period:.9g} s, half multiplier {orbit.half_multiplier:.6f}")
axes[0].set(ylabel="position off the set point [rad]")
axes[1].set(xlabel="time [s]", ylabel="velocity [rad/s]")
axes[0].legend()

# %%
# Taylor series with 34 digits (Switch) and of order 22 in extended precision (LuGre) have the same cycles.

from problems import table1

for model, orbit in orbits.items():
    truth = next(row for row in table1.REFERENCE[model]["stable"] if row["K"] == 0.04)
    assert abs(orbit.period / truth["period"] - 1) < 1e-9
    assert abs(orbit.amplitude / truth["amplitude"] - 1) < 1e-9
