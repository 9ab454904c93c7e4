"""The fold in two parameters: the curve K_f(q), below which the servo can hunt.

    phi(s, c) = d lambda/d s = 0:    s along the branch of orbits in the gain, c along the second parameter q

At a fold of the branch in the gain the tangent has no parameter component.  With a second parameter q the orbits near
a fold form a surface with the coordinates s and c, on which the folds are the curve phi = 0, followed by
continuation/plane_curve.py.  The curve may turn back in q: a cusp, phi_s = 0, where two folds meet and vanish.

points.py   a fold curve as data: its points, the cubic through them
charts.py   the surface of orbits beside a fold, and the fold checked as an extremum
batches.py  as many points of it at once as can be predicted from one
curve.py    all of it: `fold_curve`
files.py    a fold curve on the disk after every point, and taken up again
"""
