"""The fold in two parameters: the curve K_f(q), below which the servo can hunt.

    d lambda/d s = 0:    s along the branch of orbits in the gain

At a fold of the branch in the gain the tangent has no parameter component.  With a second parameter q the folds are a
curve, which may turn back in q: a cusp, where two folds meet and vanish.  It is followed as that of any special point
is (continuation/two_parameters.py).

data.py     a fold curve as data: its points, the cubic through them
curve.py    `fold_curve`: where it begins, and where a gain tends to zero
"""
