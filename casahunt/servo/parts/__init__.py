"""A loop is made of parts: plant, friction, controller, loads and limits, remedies; their product is a `System`.

    x' = product of the parts' fields,   modes = tuples of their modes,   y = signals that they exchange

part.py                  the words: Part, PartMode, Law, Edge
addresses.py             where parts and their functions stand, for other processes
wiring.py                the parts in one mode each, wired by their signals
loop.py                  the product of parts, as a system like any user's
remedy.py                what is to be known of a part to find and to price its smallest size
inertia.py               plant: one inertia
two_masses.py            plant: motor and load with a shaft
switch.py                Switch friction
by_direction.py          Switch friction that differs by direction
lugre.py                 LuGre friction
pid.py                   PID by times or by gains, and the integrator
cascade.py               cascade P-PI
filtered_derivative.py   PID by gains with a filtered derivative
state_space.py           any linear controller, by state space or transfer function
loads.py                 a constant torque, a spring
torque_limit.py          a limited torque, with anti-windup
dead_band.py             remedies: dead bands on the integrator's input, or on the error
leak.py                  remedy: a leaking integrator
freeze.py                remedy: an integrator that is frozen at standstill
reset.py                 remedies: an integrator that is reset
error_filter.py          remedy: a filtered error
feedforward.py           remedy: friction compensated by its estimate
dither.py                remedy: dither, by its averaged friction curve
plain.py                 remedies: gain, derivative and integral action
table.py                 all remedies
plain_loop.py            a servo as a loop
"""
