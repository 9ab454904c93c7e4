"""
A measured record
=================

Amplitude and period of a hunting record: here one with noise and the steps of an encoder, made from the sum of three
sines so that its numbers are known.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Record, measure

random = np.random.default_rng(1)
times = np.arange(0, 120, 0.02)
phase = 2 * np.pi * times / 10.28
clean = 0.05 * np.sin(phase) + 0.008 * np.sin(3 * phase) + 0.002 * np.sin(5 * phase)
step = 2 * np.pi / 4096
positions = step * np.round((clean + 2e-4 * random.standard_normal(times.size)) / step)
found = measure(Record(times, positions))
print(found)

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
ax.plot(times[:2000], positions[:2000], linewidth=0.8)
ax.set(xlabel="time [s]", ylabel="position [rad]")

# %%
# Half of the peak-to-peak value of the sum, and its period.

assert abs(found.period - 10.28) <= 3 * found.period_error
assert abs(found.amplitude - np.ptp(clean) / 2) <= 3 * found.amplitude_error
