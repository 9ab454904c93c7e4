"""The servo as a one-dimensional map from one stick to the next: a cycle is a fixed point.

    a = |x1| at a stick,    P(a) = |x1| at the next one,    P(a) = a

half_cycle.py    the map by a short march, of both models
secant_search.py a motion beside a stable fixed point by a few steps, at one gain and along the gain
scan.py          all stick positions: the outermost stable fixed point, or how far out motions lead at most
slopes.py        the map of the Switch servo to rounding, with its derivatives and the cubics through them
data.py          what a scan of it has seen, as data
fixed_points.py  all its fixed points in a range, and the jumps that are none
"""
