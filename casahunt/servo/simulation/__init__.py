"""The servo's motion from any initial state, and what its end shows.

small_swings.py     does a small slip ever stop: a closed form
long_run.py         what lies ahead of a stuck servo: rest, a cycle, or growth
swings.py           do the swings of a motion converge, and where to
waiting.py          how long a servo that is stuck beside its set point stays there
verdict.py          what the end of a motion shows, and from which swings
trajectory.py       a simulated motion as data
simulate.py         the motion, with an error estimate
"""
