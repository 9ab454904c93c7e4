"""
A drill string: two masses and a flexible shaft
===============================================

The motor turns on, the bit sticks and breaks away.
"""

import matplotlib.pyplot as plt

from problems import drill_string
from problems.gallery import errors

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
found = list(drill_string.cycles())
drill_string.draw(found, ax)
for one in found:  # Taylor series in extended precision
    assert max(errors(one.orbit, one.truth).values()) < 1e-8
