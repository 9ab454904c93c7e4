"""The servo as a one-dimensional map from one stick to the next: a cycle is a fixed point.

    a = |x1| at a stick,    P(a) = |x1| at the next one,    P(a) = a

half_cycle.py    the map by a short march, of both models
peaks.py         how far out motions between others lead at most
scan.py          the map by half cycles: guesses, and evidence that no cycle exists
climb.py         upwards in the gain along its stable fixed points, and down
slopes.py        the map to rounding, with its derivatives
cubics.py        what motions foretell of those between them
points.py        what a scan of it has seen, as data
fixed_points.py  all fixed points in a range, and the jumps that are none
"""
