"""From records of a hunting servo to its friction.

    y_i = b + x1(t_i - tau; q) + noise, rounded:    q, tau, b of the largest likelihood, 95 % intervals by profiles

likelihood.py positions that carry noise and are rounded
torque.py     the torque of the motor, where it was measured
fit.py        the computed cycle laid over records
swings.py     swings that begin one by one, as counts in the loop make them
climb.py      the way to the likeliest unknowns
noise.py      the likeliest noise, and the model with it
built.py      what the loop as built does beside the continuous one
matched.py    friction with which one swing is that of a record
start.py      where a fit starts
intervals.py  intervals by profile likelihood
readings.py   what rounded readings leave unknown of the controller, and so of friction
judgement.py  misfit, what a record cannot tell, which further one would
clipped.py    positions that are cut off at an end
best.py       the likeliest model of all starts, and whether another gain, or a cut, explains records
suitable.py   records that can be fitted
transient.py  a record that begins on its way to the cycle
axis.py       a loop of parts, from where one inertia would have its friction
identify.py   all of it: `identify`
suspect.py    what to suspect where a record hunts at another frequency
"""
