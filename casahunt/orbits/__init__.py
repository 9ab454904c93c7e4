"""A computed periodic orbit: solved, judged, its error estimated, its mesh placed anew until the tolerance holds.

    G(u) = 0,    |error of period and amplitude| <= tol,    multipliers: eigenvalues of S dx(T)/dx(0)

floquet.py   Floquet multipliers
orbit.py     Orbit and Arc: results as frozen numpy
restart.py   starting points for another phase sequence
adapt.py     solve, judge, estimate, refine, until the tolerance holds
archive.py   orbits in files
recurrence.py  when a motion repeats, as it is or mirrored
find_cycle.py  the cycle that a motion of a user's system settles on
"""
