"""The linear loop of any servo, dry friction left out: its response, poles and margins, with delay or as built.

open_loop.py      L(s), opened at the torque, of one inertia or of a loop of parts
pulse_transfer.py L(z) of the loop as built, of one inertia or of a loop of parts
sampled_loop.py   continuous loops that have nearly the same, of one inertia
margins.py        how much phase and gain a loop can lose
linear_loop.py    poles, stability, crossovers
"""
