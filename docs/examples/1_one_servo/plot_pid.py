"""
Any PID controller
==================

A controller is given by its two times, which makes its zeros real, or by its gains kp, ki, kd, with any zeros. Where
both forms describe the same controller, they give the same cycle.
"""

import matplotlib.pyplot as plt

from casahunt import Controller, Options, Pid, Servo, find_orbit

by_times = Servo(controller=Controller(lead_time=0.2, integral_time=0.5))
pid = by_times.controller.pid()
by_gains = Servo(controller=Pid(kp=pid.kp, ki=pid.ki, kd=pid.kd))
tight = Options(tol=1e-9)
one, other = (find_orbit(servo, "switch", 0.1, options=tight) for servo in (by_times, by_gains))
print(f"{pid}: periods {one.period:.11g} s and {other.period:.11g} s")

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
times, states = other.sample()
ax.plot(times, states[0])
ax.set(xlabel="time [s]", ylabel="position off the set point [rad]")

# %%
# The relation of the two forms is exact; the cycle is the fixed point of an event map that Taylor series march, apart
# from the package's solvers.

from problems import taylor

assert abs(pid.kp - (1 + 0.2 / 0.5)) < 1e-15 and abs(pid.ki - 1 / 0.5) < 1e-15 and abs(pid.kd - 0.2) < 1e-15
amplitude, period = taylor.switch_cycle(by_gains, 0.1, other.amplitude)
for orbit in (one, other):
    assert abs(orbit.period / period - 1) < 1e-9 and abs(orbit.amplitude / amplitude - 1) < 1e-9
