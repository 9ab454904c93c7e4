"""The loop as built: a sampled controller and the exact motion of the servo between its samples.

border.py     when an encoder may decide how a servo hunts
slip.py       a slip under constant torque, by its Taylor series
bristle.py    a LuGre servo under constant torque, likewise
controller.py the difference equations, and whole sticks of them at once
remedied.py   remedies in them
loop.py       controller and servo, sample by sample, and whole sticks at once
turning_points.py  what a motion shows by its turning points, and the pattern that hunting repeats
motion.py     the motion as data
cause.py      stiction or quantisation, and the dead band that ends it
check.py      whether given numbers come to rest in the loop as built
"""
