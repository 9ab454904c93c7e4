"""
The loop without dry friction
=============================

Hunting is no instability of the linear loop: at every gain at which this servo hunts, that loop is stable, with a good
margin.
"""

import matplotlib.pyplot as plt
import numpy as np

from casahunt import Servo
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.open_loop import open_loop

servo = Servo()
loop = linear_loop(servo, 0.1)
print(loop.poles, [crossover.margin for crossover in loop.gain_crossovers])

w = np.logspace(-1, 3, 400)
figure, (up, low) = plt.subplots(2, 1, sharex=True, figsize=(6.4, 5), layout="constrained")
response = open_loop(servo, 0.1).response(w)
up.loglog(w, abs(response))
low.semilogx(w, np.degrees(np.unwrap(np.angle(response))))
up.axhline(1, color="black", linewidth=0.8)
up.set(ylabel="magnitude")
low.set(xlabel="frequency [rad/s]", ylabel="phase [degrees]")

# %%
# The poles solve the characteristic equation, J s^3 + (kd + sigma2) s^2 + kp s + ki = 0, and Routh and Hurwitz agree.

J, c, K = servo.inertia, servo.friction.viscous, 0.1 * servo.motor_gain
lead, reset = servo.controller.lead_time, servo.controller.integral_time
kp, ki, kd = K * (1 + lead / reset), K / reset, K * lead
for s in loop.poles:
    assert abs(J * s**3 + (kd + c) * s**2 + kp * s + ki) < 1e-10 * abs(J * s**3)
assert (kd + c) * kp > J * ki and all(s.real < 0 for s in loop.poles)
