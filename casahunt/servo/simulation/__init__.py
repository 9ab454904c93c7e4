"""The servo's motion from any initial state, and what its end shows.

trajectory.py       a simulated motion as data
simulate.py         the motion, with an error estimate
"""
