"""
The normal form of Hopf
=======================

A uniform circle beside a state that is zero: nothing here has the size of one, and nothing needs to.
"""

import matplotlib.pyplot as plt

from problems import circle
from problems.gallery import errors

figure, ax = plt.subplots(figsize=(4.5, 4.5), layout="constrained")
found = list(circle.cycles())
circle.draw(found, ax)
for one in found:  # closed form
    assert max(errors(one.orbit, one.truth).values()) < 1e-8
