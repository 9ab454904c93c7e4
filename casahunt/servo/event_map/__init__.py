"""The servo as a one-dimensional map from one stick to the next: a cycle is a fixed point.

    a = |x1| at a stick,    P(a) = |x1| at the next one,    P(a) = a

scan.py          the map by half cycles: guesses, and evidence that no cycle exists
fixed_points.py  the map to rounding: slopes, all fixed points in a range, fold
"""
