"""The linear loop of any servo, dry friction left out: its response, poles and margins, with delay or as built.

open_loop.py      L(s), opened at the torque, of one inertia or of a loop of parts
sampled_loop.py   L(z) of the loop as built, and continuous loops that have nearly the same
margins.py        how much phase and gain a loop can lose
linear_loop.py    poles, stability, crossovers
"""
