"""The loop as built: a controller that is run by its samples, and the exact motion of its plant between them.

steps.py      a mode of a plant: its steps as power series
plant.py      what a drive moves, under a held torque
controller.py the parts that form the torque, as difference equations, and whole sticks of them at once
loop.py       controller and plant, sample by sample, in a row, and whole sticks at once
motion.py     the motion as data
check.py      whether given numbers come to rest in the loop as built
"""
