"""
A forced oscillator with dry friction
=====================================

Slip forwards, slip backwards, stick; which mode follows a stop is decided by a function of the state.
"""

import matplotlib.pyplot as plt

from problems import dry_friction
from problems.gallery import errors

figure, ax = plt.subplots(figsize=(6.4, 4), layout="constrained")
found = list(dry_friction.cycles())
dry_friction.draw(found, ax)
for one in found:  # Taylor series in extended precision
    assert max(errors(one.orbit, one.truth).values()) < 1e-8
