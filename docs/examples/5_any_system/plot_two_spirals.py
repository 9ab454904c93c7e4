"""
Two smooth laws side by side
============================

A piecewise smooth oscillator: one spiral on the left of x = 0, another one on the right. Its period is known up to the
root of one equation.
"""

import matplotlib.pyplot as plt

from problems import two_spirals
from problems.gallery import errors

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
found = list(two_spirals.cycles())
two_spirals.draw(found, ax)
for one in found:
    assert max(errors(one.orbit, one.truth).values()) < 1e-8
